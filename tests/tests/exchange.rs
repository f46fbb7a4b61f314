//! What other programs read: exported scenes, tables of arrivals.

use crate::common::{corf_ok, corf_refuses, room_with_pillar, text};
use serde_json::Value;
use std::fs;
use std::path::Path;

const TX: [f64; 3] = [1.0, 1.0, 2.0];
/// Sums are printed with 17 digits and added in another order here.
const ROUNDING: f64 = 1e-12;

/// Reads a float64 table of six columns in NumPy's format 1.0.
fn read_npy(path: &Path) -> Vec<[f64; 6]> {
    let bytes = fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let begin = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert_eq!(begin % 64, 0);
    let header = std::str::from_utf8(&bytes[10..begin]).unwrap();
    assert!(header.contains("'descr': '<f8'") && header.contains(", 6)") && header.ends_with('\n'), "{header}");
    let values: Vec<f64> = bytes[begin..].chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
    assert!(header.contains(&format!("({}, 6)", values.len() / 6)), "{header}");
    values.chunks_exact(6).map(|row| row.try_into().unwrap()).collect()
}

fn sum_of(entries: &Value) -> f64 {
    entries.as_object().unwrap().values().map(|e| e["power"].as_f64().unwrap()).sum()
}

#[test]
fn diffuse_power_is_the_same_by_object_by_interactions_and_by_arrival() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), TX, "");
    let out = folder.path().join("arrivals");
    let report = corf_ok(&[
        "diffuse",
        text(&scene),
        "--rx",
        "4,3,1.5",
        "--rx",
        "5,1,1",
        "--depth",
        "2",
        "--directions",
        "4000",
        "--replicas",
        "1",
        "--arrivals",
        text(&out),
    ]);
    let report: Value = serde_json::from_str(&report).unwrap();
    for i in 0..2 {
        let receiver = &report["receivers"][i];
        let total = receiver["total"]["power"].as_f64().unwrap();
        assert!(total > 0.0 && receiver["total"]["standard_error"].is_null(), "one sampling has no error");
        let hops = &receiver["by_interactions_after_the_scattering"];
        let ending = hops["0"]["power"].as_f64().unwrap();
        assert!(hops["1"]["power"].as_f64().unwrap() > 0.0, "a room mirrors what its walls scatter");
        let arrivals = read_npy(&out.join(format!("{i:05}-00.npy")));
        let power = |after: Option<f64>| arrivals.iter().filter(|a| after.is_none_or(|n| a[5] == n)).map(|a| a[3]).sum::<f64>();
        for (what, whole, parts) in [
            ("objects", total, sum_of(&receiver["by_object"])),
            ("interactions", total, sum_of(hops)),
            ("ending, by object", ending, sum_of(&receiver["ending_with_the_scattering_by_object"])),
            ("arrivals", total, power(None)),
            ("arrivals that end", ending, power(Some(0.0))),
        ] {
            assert!((parts - whole).abs() <= ROUNDING * whole, "{what}: {parts} of {whole}");
        }
        assert!(
            arrivals.iter().all(|a| (a[0] * a[0] + a[1] * a[1] + a[2] * a[2] - 1.0).abs() < ROUNDING),
            "directions are unit vectors"
        );
    }
}

#[test]
fn a_scene_is_exported_with_its_radio_materials_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), TX, "");
    let out = folder.path().join("sionna");
    corf_ok(&["scene", "export", text(&scene), "--to", "sionna", "--out", text(&out)]);
    let radio: Value = serde_json::from_slice(&fs::read(out.join("radio.json")).unwrap()).unwrap();
    let shapes = radio["shapes"].as_array().unwrap();
    assert_eq!(shapes.iter().map(|s| s["triangles"].as_u64().unwrap()).sum::<u64>(), 24);
    assert!(shapes.iter().all(|s| out.join(s["file"].as_str().unwrap()).is_file()));
    let xml = fs::read_to_string(out.join("scene.xml")).unwrap();
    assert_eq!(xml.matches("type=\"radio-material\"").count(), 2);
    // The room has no trajectory.
    let refused = folder.path().join("refused");
    corf_refuses(&["scene", "export", text(&scene), "--to", "sionna", "--out", text(&refused), "--poses", "3"], &["trajectory"]);
    assert!(!refused.exists(), "nothing half-written");
}
