//! Walls that stand where paths bounce, and edges of sheets laid of panels: the values that are right, through the command.

use crate::common::*;

/// Total power of all paths, dB; `None` where nothing arrives.
fn power_db(arguments: &[&str]) -> Option<f64> {
    let answer: serde_json::Value = serde_json::from_str(&corf_ok(arguments)).unwrap();
    answer["total_power_db"].as_f64()
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn nothing_passes_a_metal_wall_where_it_stands_on_the_floor() {
    let Some(scene) = shared("faults/joint/stand.toml") else { return };
    for rx in ["3,0,1.5", "3.0000001,0,1.5", "2.9999999,0,1.5"] {
        let rx = format!("--rx={rx}");
        assert_eq!(power_db(&["paths", text(&scene), &rx, "--depth", "1"]), None, "{rx}");
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn a_room_behind_metal_is_dark() {
    let Some(scene) = shared("faults/joint/dark.toml") else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("map");
    let map = ["--height", "1.5", "--cell", "0.25", "--depth", "3", "--out", text(&out)];
    corf_ok(&[&["coverage", text(&scene)], &map[..]].concat());
    let answer: serde_json::Value = serde_json::from_slice(&std::fs::read(out.join("coverage.json")).unwrap()).unwrap();
    // Half of the 48 x 24 cells.
    assert_eq!(answer["cells_not_reached"], 576);
}

/// ITU-R P.526's knife edge for the sheet.
const P526_DB: f64 = -112.45;
/// Its approximation is this good.
const P526_ERROR_DB: f64 = 0.5;

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn panels_diffract_as_the_sheet_they_make() {
    let gain_db = |name: &str| {
        let scene = shared(&format!("faults/edges/{name}.toml"))?;
        let settings = shared("faults/edges/rf.toml")?;
        power_db(&["paths", text(&scene), "--rx", "5,0.5,-0.3", "--config", text(&settings)])
    };
    let Some(one) = gain_db("one") else { return };
    assert!((one - P526_DB).abs() < P526_ERROR_DB, "{one}");
    // Panels of objects of their own, a T-junction within one mesh, a gap of 10 µm (whose corners are welded: to rounding of the phase).
    for (name, tolerance_db) in [("sub", 1e-6), ("s4", 1e-6), ("gap", 1e-3)] {
        let found = gain_db(name).unwrap();
        assert!((found - one).abs() < tolerance_db, "{name}: {found} dB, one sheet {one} dB");
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn open_edges_are_offered_and_told() {
    let Some(scene) = shared("faults/edges/one.toml") else { return };
    let arguments = ["paths", text(&scene), "--rx", "5,0.5,-0.3", "--depth", "2", "--diffraction"];
    let reported = corf(&arguments);
    assert_eq!(reported.status.code(), Some(0));
    let reported = String::from_utf8_lossy(&reported.stderr).into_owned();
    assert!(
        reported.contains("4 open edges") && reported.contains("120.0 m") && reported.contains("--edge-diffraction"),
        "{reported}"
    );
    let traced = [&arguments[..], &["--edge-diffraction"]].concat();
    assert!((power_db(&traced).unwrap() - P526_DB).abs() < P526_ERROR_DB);
    assert!(corf_ok(&["paths", "--help"]).contains("--edge-diffraction"));
    corf_refuses(
        &["paths", text(&scene), "--rx", "5,0.5,-0.3", "--edge-diffraction"],
        &["edge_diffraction", "diffraction = true"],
    );
}
