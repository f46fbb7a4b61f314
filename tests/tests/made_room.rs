//! A plain box of a room whose paths anybody can work out: antennas on its surfaces, and chains of another program held against its paths.

use crate::common::*;
use glam::DVec3;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// Sides, metres.
const ROOM: DVec3 = DVec3::new(5.0, 4.0, 2.75);

/// The room as a mesh and a scene file, with a cabinet between the antennas or without.
fn room(folder: &Path, name: &str, cabinet: bool, transmitter: &str) -> PathBuf {
    let mut mesh = String::from("o shell\nusemtl clay\n");
    let mut first = 1;
    let mut add = |mesh: &mut String, low: DVec3, high: DVec3, quads: [[usize; 4]; 6]| {
        for i in 0..8 {
            let pick = |bit: usize, axis: usize| if i >> bit & 1 == 0 { low[axis] } else { high[axis] };
            mesh.push_str(&format!("v {} {} {}\n", pick(0, 0), pick(1, 1), pick(2, 2)));
        }
        for q in quads {
            mesh.push_str(&format!("f {} {} {} {}\n", q[0] + first, q[1] + first, q[2] + first, q[3] + first));
        }
        first += 8;
    };
    let outward = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    // The shell's faces look into the room.
    add(&mut mesh, DVec3::ZERO, ROOM, outward.map(|[a, b, c, d]| [d, c, b, a]));
    if cabinet {
        mesh.push_str("o cabinet\nusemtl clay\n");
        add(&mut mesh, DVec3::new(2.3, 1.9, 1.2), DVec3::new(2.6, 2.2, 1.5), outward);
    }
    fs::write(folder.join(format!("{name}.obj")), mesh).unwrap();
    let scene = folder.join(format!("{name}.toml"));
    let text = format!(
        "[scene]\nfile = \"{name}.obj\"\n[transmitter]\nposition_m = {transmitter}\n[trajectory]\nwaypoints_m = [[1.0, 1.0], [4.0, 1.0], [4.0, 3.0], [1.0, 3.0]]\n\
         height_m = 1.4\n[radio_materials.\"clay\"]\nid = \"clay\"\nitu = \"concrete\"\nthickness_m = 0.1\nscattering_coefficient = 0.0\n"
    );
    fs::write(&scene, text).unwrap();
    scene
}

/// The plane of a wall: its axis and where it is.
fn walls() -> [(usize, f64); 6] {
    [(0, 0.0), (0, ROOM.x), (1, 0.0), (1, ROOM.y), (2, 0.0), (2, ROOM.z)]
}

fn mirrored(p: DVec3, (axis, at): (usize, f64)) -> DVec3 {
    let mut q = p;
    q[axis] = 2.0 * at - p[axis];
    q
}

/// Where the way from a point to an image meets a wall, if it does within the room.
fn bounce(from: DVec3, image: DVec3, (axis, at): (usize, f64)) -> Option<DVec3> {
    let t = (at - from[axis]) / (image[axis] - from[axis]);
    let p = from + (image - from) * t;
    let inside = (0..3).all(|k| k == axis || (1e-9..ROOM[k] - 1e-9).contains(&p[k]));
    (t > 0.0 && t < 1.0 && inside).then_some(p)
}

/// All chains of up to two mirrors, by images.
fn chains(tx: DVec3, rx: DVec3) -> Vec<Vec<DVec3>> {
    let mut all = vec![vec![]];
    for one in walls() {
        let image = mirrored(tx, one);
        all.extend(bounce(rx, image, one).map(|p| vec![p]));
        for two in walls().into_iter().filter(|two| *two != one) {
            let chain = || {
                let second = bounce(rx, mirrored(image, two), two)?;
                Some(vec![bounce(second, image, one)?, second])
            };
            all.extend(chain());
        }
    }
    all
}

const TX: DVec3 = DVec3::new(1.1, 2.3, 1.9);
const RX: DVec3 = DVec3::new(3.8, 1.7, 0.8);

fn file(folder: &Path, scene: &str, chains: &[Vec<DVec3>]) -> PathBuf {
    let chains: Vec<Vec<[f64; 3]>> = chains.iter().map(|chain| chain.iter().map(|p| p.to_array()).collect()).collect();
    let links = json!([{ "tx": TX.to_array(), "rx": RX.to_array(), "chains": chains }]);
    let path = folder.join("chains.json");
    fs::write(&path, json!({ "schema": "corf-chains/1", "scene": scene, "links": links }).to_string()).unwrap();
    path
}

fn check(arguments: &[&str]) -> (Option<i32>, Value) {
    let output = corf(&[&["check", "paths", "--json"], arguments].concat());
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    (
        output.status.code(),
        serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}\n{}", String::from_utf8_lossy(&output.stderr))),
    )
}

#[test]
fn chains_of_images_are_found_and_those_that_are_none_are_missing_or_displaced() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    room(folder, "room", false, "[1.1, 2.3, 1.9]");
    let all = chains(TX, RX);
    assert!(all.len() > 20, "{}", all.len());
    // Two interactions at most, as here: the same sets.
    let given = file(folder, "room.toml", &all);
    let (code, report) = check(&[text(&given), "--max-interactions", "2"]);
    assert_eq!((code, report["passed"].as_bool()), (Some(0), Some(true)), "{report}");
    assert_eq!((report["found"].as_u64(), report["only_here"].as_u64()), (Some(all.len() as u64), Some(0)), "{report}");
    assert!(report["worst_m"].as_f64().unwrap() < 1e-6, "float32 corners are exact here: {report}");

    // One bounce 5 cm along its wall, one in the air, one at the wrong place of a wall, one repeated, one through a point that is straight on.
    let mut changed = all.clone();
    let single = changed.iter().position(|c| c.len() == 1 && c[0].z < 1e-9).unwrap();
    changed[single][0].x += 0.05;
    changed.push(vec![DVec3::new(2.0, 2.0, 1.0)]);
    changed.push(vec![DVec3::new(0.6, 0.6, 0.0)]);
    changed.push(all[1].clone());
    changed[0] = vec![TX + (RX - TX) * 0.25];
    let given = file(folder, "room.toml", &changed);
    let (code, report) = check(&[text(&given), "--max-interactions", "2"]);
    assert_eq!(code, Some(1));
    let count = |key: &str| report[key].as_u64().unwrap() as usize;
    assert_eq!(
        [count("chains"), count("found"), count("displaced"), count("missing"), count("repeated")],
        [changed.len(), all.len() - 1, 1, 2, 1],
        "{report}"
    );
    let link = &report["links"][0];
    assert!((link["displaced"][0]["by_m"].as_f64().unwrap() - 0.05).abs() < 1e-6 && link["displaced"][0]["chain"] == single);
    let why = |i: usize| link["missing"][i]["why"].as_str().unwrap();
    assert!(why(0).contains("no surface") && why(1).contains("mirror sends on"), "{link}");
    let table = String::from_utf8_lossy(&corf(&["check", "paths", text(&given), "--max-interactions", "2"]).stdout).into_owned();
    assert!(table.contains("FAIL") && table.contains("displaced by 0.0500 m") && table.contains("missing: point 1"), "{table}");

    // A cabinet in the way, and fewer interactions than a chain has.
    room(folder, "cabinet", true, "[1.1, 2.3, 1.9]");
    let given = file(folder, "cabinet.toml", &all);
    let (code, report) = check(&[text(&given), "--max-interactions", "1", "--no-transmission"]);
    assert_eq!(code, Some(1));
    let missing =
        report["links"][0]["missing"].as_array().unwrap().iter().map(|m| m["why"].as_str().unwrap()).collect::<Vec<_>>();
    assert!(missing.iter().any(|why| why.contains("leg 1 is blocked by \"cabinet\"")), "{missing:?}");
    assert!(missing.iter().any(|why| why.contains("turns 2 times") && why.contains("--max-interactions")), "{missing:?}");

    // Faulty files are refused by what is wrong.
    for (text_of, words) in [
        ("{\"schema\": \"other/1\"}".to_owned(), vec!["corf-chains/1", "other/1"]),
        ("{\"schema\": \"corf-chains/1\", \"links\": []}".to_owned(), vec!["no chain"]),
        ("{\"schema\": \"corf-chains/1\", \"link\": []}".to_owned(), vec!["link", "links"]),
        (
            json!({ "schema": "corf-chains/1", "links": [{ "tx": [0, 0, 1e9], "rx": [1, 1, 1], "chains": [[]] }] }).to_string(),
            vec!["link 0"],
        ),
    ] {
        fs::write(&given, text_of).unwrap();
        corf_refuses(&["check", "paths", text(&given)], &words);
    }
    fs::write(
        &given,
        json!({ "schema": "corf-chains/1", "links": [{ "tx": TX.to_array(), "rx": RX.to_array(), "chains": [[]] }] }).to_string(),
    )
    .unwrap();
    corf_refuses(&["check", "paths", text(&given)], &["names no scene", "--scene"]);
}

#[test]
fn an_antenna_on_a_surface_hears_the_limit_from_its_side_and_says_which_that_is() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scene = room(folder, "room", false, "[2.5, 2.0, 2.75]");
    let link = |tx: &str, rx: &str, more: &[&str]| -> Value {
        serde_json::from_str(&corf_ok(&[&["paths", text(&scene), "--tx", tx, "--rx", rx], more].concat())).unwrap()
    };
    let power = |v: &Value| v["channel"]["path_gain_db"].as_f64().unwrap();
    // On the ceiling, on a wall, on both; with scattered power as well.
    for (on, off, key, object_side) in [
        (("2.5,2,2.75", "4,1,1.2"), ("2.5,2,2.749", "4,1,1.2"), "tx_on_surface", [0.0, 0.0, -1.0]),
        (("2.5,2,1.5", "0,1,1.2"), ("2.5,2,1.5", "0.001,1,1.2"), "rx_on_surface", [1.0, 0.0, 0.0]),
    ] {
        for more in [&[][..], &["--diffuse", "--photons", "10000", "--directions", "5000"]] {
            let (here, near) = (link(on.0, on.1, more), link(off.0, off.1, more));
            assert_eq!(here["paths"].as_array().unwrap().len(), near["paths"].as_array().unwrap().len());
            // A millimetre changes lengths and angles by parts in a thousand.
            assert!((power(&here) - power(&near)).abs() < 0.05, "{} {}", power(&here), power(&near));
            let mount = &here[key];
            assert_eq!((mount["object"].as_str(), mount["side"].clone()), (Some("shell"), json!(object_side)), "{here}");
            assert!(near[key].is_null());
        }
    }
    // The scene's own transmitter on the ceiling: the scene is sound, and a data set of it says where it is.
    assert!(
        corf_ok(&["scene", "validate", text(&scene)]).contains("0 errors")
            || corf(&["scene", "validate", text(&scene)]).status.code() == Some(0)
    );
    let config = folder.join("set.toml");
    fs::write(
        &config,
        "name = \"mounted\"\nscene = \"room.toml\"\nkeyframes = 2\n[optical]\nwidth = 16\nheight = 9\nmethod = \"path\"\nsamples_per_pixel = 1\n\
         [rf]\nwidth = 12\nheight = 8\ndiffuse = false\nlobe_width_deg = 6\n",
    )
    .unwrap();
    let out = folder.join("data");
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&out)]);
    let file: Value = serde_json::from_slice(&fs::read(out.join("dataset.json")).unwrap()).unwrap();
    let mounted = file["header"]["on_surfaces"].as_array().unwrap();
    assert_eq!((mounted.len(), mounted[0]["mount"]["side"].clone()), (1, json!([0.0, 0.0, -1.0])), "{mounted:?}");
    // Between a cabinet and what stands on it there is no side.
    let both = room(folder, "cabinet", true, "[1.1, 2.3, 1.9]");
    let mesh = fs::read_to_string(folder.join("cabinet.obj")).unwrap();
    let (low, high) = ([2.3, 1.9, 1.5], [2.6, 2.2, 1.8]);
    let mut box_on_it = String::from("o box\nusemtl clay\n");
    for i in 0..8 {
        let pick = |bit: usize| if i >> bit & 1 == 0 { low[bit] } else { high[bit] };
        box_on_it.push_str(&format!("v {} {} {}\n", pick(0), pick(1), pick(2)));
    }
    for q in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
        box_on_it.push_str(&format!("f {} {} {} {}\n", q[0] + 17, q[1] + 17, q[2] + 17, q[3] + 17));
    }
    fs::write(folder.join("cabinet.obj"), mesh + &box_on_it).unwrap();
    corf_refuses(&["paths", text(&both), "--rx", "2.45,2.05,1.5"], &["receiver at", "every side", "cabinet"]);
}

/// Gain over tilt and pan every so many degrees.
fn pattern_file(path: &Path, step_deg: usize, gain_db: impl Fn(f64, f64) -> f64) {
    let mut text = String::from("tilt_deg,pan_deg,gain_db\n");
    for tilt in (0..=180).step_by(step_deg).map(|t| t as f64 - 90.0) {
        for pan in (0..360).step_by(step_deg).map(|p| p as f64 - 180.0) {
            text.push_str(&format!("{tilt},{pan},{}\n", gain_db(tilt, pan)));
        }
    }
    fs::write(path, text).unwrap();
}

#[test]
fn patterns_of_files_are_those_that_they_were_sampled_from() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    pattern_file(&folder.join("iso.csv"), 30, |_, _| 0.0);
    let tr38901 = |tilt: f64, pan: f64| {
        let loss = |angle: f64| (12.0 * (angle / 65.0).powi(2)).min(30.0);
        8.0 - (loss(tilt) + loss(pan)).min(30.0)
    };
    pattern_file(&folder.join("sector.csv"), 2, tr38901);
    pattern_file(&folder.join("loud.csv"), 30, |_, _| 6.0);
    let place = "[1.1, 2.3, 1.9]";
    let power = |name: &str, pattern: &str| -> Vec<f64> {
        let scene = room(folder, name, false, &format!("{place}\n{pattern}"));
        let value: Value = serde_json::from_str(&corf_ok(&["paths", text(&scene), "--rx", "3.8,1.7,0.8"])).unwrap();
        let paths = value["paths"].as_array().unwrap();
        paths.iter().map(|p| p["a"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap().powi(2)).sum::<f64>()).collect()
    };
    let (iso, of_file) = (power("plain", "pattern = \"iso\""), power("file", "pattern = { file = \"iso.csv\" }"));
    assert!(iso.len() == of_file.len() && iso.iter().zip(&of_file).all(|(a, b)| (a / b - 1.0).abs() < 1e-9));
    // Two degrees of linear interpolation in decibels: 0.006 dB within the parabola, half a cell of its slope at the floor's corner.
    let (sector, of_file) = (power("sector", "pattern = \"tr38901\""), power("sampled", "pattern = { file = \"sector.csv\" }"));
    assert_eq!(sector.len(), of_file.len());
    let off_db: Vec<f64> = sector.iter().zip(&of_file).map(|(a, b)| (10.0 * (a / b).log10()).abs()).collect();
    assert!(off_db.iter().all(|d| *d < 1.2) && off_db[0] < 0.01, "{off_db:?}");

    // An array of such elements: the method that knows its array knows them as well, from the data set's own record.
    let lobby = fs::read_to_string(root().join("scenes/lobby.toml")).unwrap();
    let mesh = root().join("scenes/lobby.glb").canonicalize().unwrap();
    let lit = lobby.replace("\"lobby.glb\"", &format!("{mesh:?}")).replace(
        "spacing_wavelengths = 0.5\npattern = \"iso\"",
        "spacing_wavelengths = 0.5\npattern = { file = \"sector.csv\" }",
    );
    assert!(lit.contains("sector.csv") && lit.contains(text(&mesh)));
    fs::write(folder.join("array.toml"), lit).unwrap();
    let config = folder.join("set.toml");
    fs::write(
        &config,
        "name = \"sectors\"\nscene = \"array.toml\"\nkeyframes = 8\n[optical]\nwidth = 96\nheight = 54\nmethod = \"path\"\nsamples_per_pixel = 2\n\
         [rf]\nwidth = 48\nheight = 32\ndiffuse = false\nspectrum = \"bartlett\"\n",
    )
    .unwrap();
    let (data, run) = (folder.join("data"), folder.join("run"));
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&data)]);
    assert!(corf_ok(&["dataset", "validate", text(&data)]).contains("passed"));
    fs::remove_file(folder.join("sector.csv")).unwrap();
    corf_ok(&["reconstruct", text(&data), "--method", "corf-array", "--device", "cpu", "--out", text(&run)]);
    let record: Value = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--json"])).unwrap();
    assert!(record["means"]["psnr_rf_jet"].as_f64().unwrap() > 6.0, "{record}");

    // More power than it is fed, and a file that is not there.
    let loud = room(folder, "loud", false, &format!("{place}\npattern = {{ file = \"loud.csv\" }}"));
    corf_refuses(&["paths", text(&loud), "--rx", "3.8,1.7,0.8"], &["loud.csv", "3.98", "normalize = true"]);
    let none = room(folder, "none", false, &format!("{place}\npattern = {{ file = \"none.csv\" }}"));
    corf_refuses(&["paths", text(&none), "--rx", "3.8,1.7,0.8"], &["none.csv"]);
}
