//! Scenes and receivers of other programs that gave wrong numbers without a word: what an import leaves out, skinned meshes, sheets that lie in
//! one plane, and lists of receivers.

use crate::common::{CLOSED, boxes_scene, corf, corf_ok, corf_refuses, room_with_pillar, shared, text};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

fn fault(name: &str) -> Option<PathBuf> {
    shared(&format!("faults3/{name}"))
}

/// Standard error of a command that ends well.
fn said(arguments: &[&str]) -> String {
    let output = corf(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "corf {arguments:?}\n{stderr}");
    stderr
}

fn parsed(output: &str) -> Value {
    serde_json::from_str(output).unwrap()
}

/// A patch that no reader here draws, behind the room's objects.
fn with_free_form(folder: &Path) -> PathBuf {
    let scene = room_with_pillar(folder, [1.0, 1.0, 2.0], "[trajectory]\nwaypoints_m = [[3.5, 1], [5, 1], [5, 4]]\n");
    let mesh = folder.join("room.obj");
    let obj = fs::read_to_string(&mesh).unwrap() + "cstype bezier\ndeg 1 1\nsurf 0 1 0 1 1 2 3 4\nparm u 0 1\nparm v 0 1\nend\n";
    fs::write(mesh, obj).unwrap();
    scene
}

#[test]
fn every_command_says_once_what_the_import_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let scene = with_free_form(folder.path());
    let set = folder.path().join("set.toml");
    let body = format!(
        "name = \"tiny\"\nscene = {scene:?}\nkeyframes = 2\n[optical]\nwidth = 32\nheight = 18\nmethod = \"path\"\nsamples_per_pixel = 2\n\
         max_bounces = 2\n[rf]\nwidth = 16\nheight = 12\nmax_interactions = 1\nphotons = 10000\ndirections = 100000\npatch_size_m = 0.5\nlobe_width_deg = 1.0\n"
    );
    fs::write(&set, body).unwrap();
    let out = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (maps, spectra, sionna, mitsuba, data) = (out("maps"), out("spectra"), out("sionna"), out("mitsuba"), out("data"));
    let scenario = out("scenario");
    let (scene, set) = (text(&scene), text(&set));
    let rx = ["--rx", "4.5,4,1.2"];
    let commands: [&[&str]; 10] = [
        &["paths", scene, rx[0], rx[1], "--depth", "1"],
        &["paths", scene, rx[0], rx[1], "--depth", "1", "--format", "deepmimo", "--out", &scenario],
        &["coverage", scene, "--height", "1.2", "--cell", "1", "--depth", "0", "--out", &maps],
        &["spectrum", scene, rx[0], rx[1], "--size", "16x12", "--depth", "1", "--no-diffuse", "--out", &spectra],
        &["diffuse", scene, rx[0], rx[1], "--depth", "1", "--directions", "20000", "--photons", "10000", "--patch-size", "0.5"],
        &["scene", "export", scene, "--to", "sionna", "--out", &sionna],
        &["scene", "export", scene, "--to", "mitsuba", "--out", &mitsuba],
        &["dataset", "generate", set, "--out", &data],
        &[
            "bench",
            "radio",
            set,
            "--positions",
            "1",
            "--error-positions",
            "1",
            "--replicas",
            "2",
            "--reference-directions",
            "200000",
        ],
        &["bench", "light", set, "--views", "1", "--reference-samples", "4"],
    ];
    for arguments in commands {
        let stderr = said(arguments);
        let lines: Vec<&str> =
            stderr.lines().filter(|line| line.contains("free-form curves and surfaces are not read")).collect();
        assert!(
            lines.len() == 1 && lines[0].starts_with("warning: ") && lines[0].contains("room.obj:"),
            "{arguments:?}: {stderr}"
        );
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn what_stands_nowhere_is_said_where_paths_are_traced() {
    for (scene, word) in [("wall-free-form.toml", "free-form curves"), ("wall-second-scene.toml", "in no scene that is read")] {
        let Some(scene) = fault(&format!("left-out-in-silence/{scene}")) else { return };
        let stderr = said(&["paths", text(&scene), "--rx=3.2,4,1.4", "--depth", "1", "--no-transmission"]);
        assert_eq!(stderr.lines().filter(|line| line.starts_with("warning: ") && line.contains(word)).count(), 1, "{stderr}");
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn a_skinned_wall_stands_where_its_joints_put_it() {
    let Some(scene) = fault("left-out-in-silence/wall-skinned-node-moved.toml") else { return };
    let link = parsed(&corf_ok(&["paths", text(&scene), "--rx=3.2,4,1.4", "--depth", "1", "--no-transmission"]));
    let paths = link["paths"].as_array().unwrap();
    // The metal wall stands between, though its own node says that it is 500 m away.
    assert!(paths.iter().all(|path| !path["interactions"].as_array().unwrap().is_empty()), "{link}");
}

/// Total power and number of the paths past a sheet's edge.
fn past_the_edge(scene: &Path, receiver: [f32; 3], config: &Path) -> (f64, usize) {
    let rx = format!("--rx={}", receiver.map(|x| x.to_string()).join(","));
    let link = parsed(&corf_ok(&["paths", text(scene), &rx, "--config", text(config)]));
    (link["total_power_db"].as_f64().unwrap(), link["paths"].as_array().unwrap().len())
}

/// A receiver past the edge of a sheet, metres.
const RECEIVER: [f32; 3] = [5.0, 0.5, -0.3];

/// Largest difference of two sheets whose corners are rounded to float32 in different places, dB.
const SAME_DB: f64 = 1e-6;

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn sheets_in_one_plane_diffract_as_one() {
    let Some(one) = shared("faults/edges/one.toml") else { return };
    let config = one.with_file_name("rf.toml");
    let (expected_db, count) = past_the_edge(&one, RECEIVER, &config);
    assert!((expected_db + 112.07).abs() < 0.005 && count == 4, "{expected_db}");
    for name in ["ovl", "poster"] {
        let Some(scene) = fault(&format!("coplanar/{name}.toml")) else { return };
        let (found_db, found) = past_the_edge(&scene, RECEIVER, &config);
        assert!((found_db - expected_db).abs() < SAME_DB && found == count, "{name}: {found_db} dB, {found} paths");
    }
}

/// Positions of the receivers of a file, as they come out.
fn receivers(scene: &Path, file: &Path) -> Vec<[f64; 3]> {
    let output = parsed(&corf_ok(&["paths", text(scene), "--rx-file", text(file), "--depth", "0"]));
    let links = output["links"].as_array().cloned().unwrap_or_else(|| vec![output.clone()]);
    links.iter().map(|link| [0, 1, 2].map(|i| link["rx"][i].as_f64().unwrap())).collect()
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn receivers_are_read_by_the_names_of_their_columns() {
    let Some(folder) = fault("receiver-csv") else { return };
    let scene = folder.join("room.toml");
    assert_eq!(receivers(&scene, &folder.join("header-y-x-z.csv")), [[4.0, 1.5, 1.2]]);
    assert_eq!(receivers(&scene, &folder.join("quoted-rows-first.csv")), [[1.0; 3], [2.0, 2.0, 1.5]]);
    assert_eq!(receivers(&scene, &folder.join("units-line.csv")), [[1.0; 3]]);
    let file = folder.join("header-lat-lon.csv");
    corf_refuses(&["paths", text(&scene), "--rx-file", text(&file), "--depth", "0"], &["header-lat-lon.csv:1", "lat, lon"]);
}

#[test]
fn what_a_list_of_receivers_has_besides_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let scene = boxes_scene(folder.path(), &[("room", "wall", [0.0; 3], [6.0, 5.0, 3.0], CLOSED)], [1.0, 1.0, 2.0], "");
    let file = folder.path().join("rx.csv");
    fs::write(&file, "name,y_cm,x_cm,z_cm\nleft,400,500,150\n\"right, by the door\",100,400,100\n").unwrap();
    assert_eq!(receivers(&scene, &file), [[5.0, 4.0, 1.5], [4.0, 1.0, 1.0]]);
    let stderr = said(&["paths", text(&scene), "--rx-file", text(&file), "--depth", "0"]);
    assert!(stderr.contains("not read: name") && stderr.contains("converted to metres"), "{stderr}");
    fs::write(&file, "x;y;z\n5;4;1,5\n").unwrap();
    corf_refuses(&["paths", text(&scene), "--rx-file", text(&file)], &["rx.csv:2", "1,5", "decimal"]);
    fs::write(&file, "x,y,z\n5,4,nan\n").unwrap();
    corf_refuses(&["paths", text(&scene), "--rx-file", text(&file)], &["rx.csv", "finite"]);
}

/// Where the transmitter of [`walls`] stands unless a test turns it, metres.
const BEFORE_THE_WALLS: [f32; 3] = [-5.0, 0.0, -0.3];

/// A scene of metal rectangles, each a node of a glTF, by their corners (x, y, z).
fn walls(folder: &Path, walls: &[[[f32; 3]; 4]], transmitter: [f32; 3]) -> PathBuf {
    let (mut bytes, mut views, mut accessors): (Vec<u8>, Vec<Value>, Vec<Value>) = Default::default();
    let (mut meshes, mut nodes) = (Vec::new(), Vec::new());
    for (i, corners) in walls.iter().enumerate() {
        let values: Vec<u8> = [0, 1, 2, 0, 2, 3].iter().flat_map(|k: &usize| corners[*k]).flat_map(f32::to_le_bytes).collect();
        views.push(json!({ "buffer": 0, "byteOffset": bytes.len(), "byteLength": values.len() }));
        bytes.extend(values);
        accessors.push(json!({ "bufferView": i, "componentType": 5126, "count": 6, "type": "VEC3" }));
        meshes.push(json!({ "primitives": [{ "attributes": { "POSITION": i }, "material": 0 }] }));
        nodes.push(json!({ "mesh": i, "name": format!("w{i}") }));
    }
    fs::write(folder.join("walls.bin"), &bytes).unwrap();
    let gltf = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "nodes": nodes, "meshes": meshes, "materials": [{ "name": "metal" }], "accessors": accessors, "bufferViews": views,
        "buffers": [{ "byteLength": bytes.len(), "uri": "walls.bin" }]
    });
    fs::write(folder.join("walls.gltf"), gltf.to_string()).unwrap();
    let scene = folder.join("walls.toml");
    let body = format!(
        "[scene]\nfile = \"walls.gltf\"\nup = \"z\"\n[transmitter]\nposition_m = {transmitter:?}\n\
         [radio_materials.metal]\nrelative_permittivity = 1.0\nconductivity_s_per_m = 1e7\nthickness_m = 0.2\n"
    );
    fs::write(&scene, body).unwrap();
    scene
}

/// Sheets of the plane x = 0 by their ranges of y and z.
#[test]
fn the_edge_past_which_a_wave_goes_is_the_border_of_all_pieces() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("rf.toml");
    fs::write(&config, "edge_diffraction = true\ndiffraction = true\nmax_interactions = 2\n").unwrap();
    let piece = |[y0, y1, z0, z1]: [f32; 4]| [[y0, z0], [y1, z0], [y1, z1], [y0, z1]].map(|[y, z]| [0.0, y, z]);
    let past = |pieces: &[[f32; 4]]| {
        let list: Vec<_> = pieces.iter().map(|p| piece(*p)).collect();
        past_the_edge(&walls(folder.path(), &list, BEFORE_THE_WALLS), RECEIVER, &config)
    };
    let (expected_db, count) = past(&[[-20.0, 0.0, -20.0, 20.0]]);
    let cases: [&[[f32; 4]]; 5] = [
        // Twice; quarters that overlap; a smaller one flush with the edge; bricks; a strip along the edge.
        &[[-20.0, 0.0, -20.0, 20.0], [-20.0, 0.0, -20.0, 20.0]],
        &[[-20.0, -4.0, -20.0, 1.0], [-6.0, 0.0, -20.0, 2.0], [-20.0, -3.0, -1.0, 20.0], [-5.0, 0.0, -3.0, 20.0]],
        &[[-20.0, 0.0, -20.0, 20.0], [-1.0, 0.0, -0.5, 0.5]],
        &[[-20.0, 0.0, -20.0, -2.0], [-20.0, -7.0, -2.0, 4.0], [-7.0, 0.0, -2.0, 4.0], [-20.0, 0.0, 4.0, 20.0]],
        &[[-20.0, -0.01, -20.0, 20.0], [-0.02, 0.0, -20.0, 20.0]],
    ];
    for pieces in cases {
        let (found_db, found) = past(pieces);
        assert!(
            (found_db - expected_db).abs() < SAME_DB && found == count,
            "{pieces:?}: {found_db}, not {expected_db} dB, {found} paths"
        );
    }
    // A slit of ten centimetres is one.
    let (slit_db, slit) = past(&[[-20.0, 0.0, -20.0, -0.35], [-20.0, 0.0, -0.25, 20.0]]);
    assert!((slit_db - expected_db).abs() > 0.1 || slit != count, "{slit_db} dB, {slit} paths");
}

/// A point turned by `angle_rad` about an axis through the origin.
fn turned(p: [f32; 3], axis: [f32; 3], angle_rad: f32) -> [f32; 3] {
    (glam::Quat::from_axis_angle(glam::Vec3::from(axis).normalize(), angle_rad) * glam::Vec3::from(p)).to_array()
}

/// Orientations in which float32 puts the corners of one plane into planes of their own, micrometres apart.
const TURNS: [([f32; 3], f32); 4] = [
    ([0.0, 0.0, 1.0], 0.0),
    ([0.0, 0.0, 1.0], std::f32::consts::FRAC_PI_6),
    ([0.0, 0.0, 1.0], 0.645_771_8),
    ([1.0, 2.0, 3.0], 0.7),
];

/// Largest difference of two sheets whose planes are rounded to float32, dB: some micrometres of 5 mm of wavelength.
const ROUNDED_DB: f64 = 0.05;

/// Largest difference of a reflection and the direct path together where the mirror moves by 1e-5 m, which turns their phase by 1.5 degrees.
const REFLECTED_DB: f64 = 0.5;

#[test]
fn pieces_of_one_plane_are_one_sheet_however_float32_rounds_them() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("rf.toml");
    fs::write(&config, "edge_diffraction = true\ndiffraction = true\nmax_interactions = 2\n").unwrap();
    // Rectangles of the plane x by their ranges of y and z.
    let piece = |x: f32, [y0, y1, z0, z1]: [f32; 4]| [[y0, z0], [y1, z0], [y1, z1], [y0, z1]].map(|[y, z]| [x, y, z]);
    let sheet = piece(0.0, [-20.0, 0.0, -20.0, 20.0]);
    let behind = [5.0, -0.5, -0.3];
    let mut cases = Vec::new();
    for x in [1e-9, 1e-7, 1e-6, -1e-6, 1e-5, -1e-5] {
        cases.push(vec![sheet, piece(x, [-20.0, 0.0, -20.0, 20.0])]);
        cases.push(vec![sheet, piece(x, [-1.0, 0.0, -0.5, 0.5])]);
        cases.push(vec![piece(0.0, [-20.0, -0.01, -20.0, 20.0]), piece(x, [-0.02, 0.0, -20.0, 20.0])]);
    }
    for (axis, angle_rad) in TURNS {
        let turn = |p| turned(p, axis, angle_rad);
        let past = |pieces: &[[[f32; 3]; 4]]| {
            let list: Vec<_> = pieces.iter().map(|piece| piece.map(turn)).collect();
            past_the_edge(&walls(folder.path(), &list, turn(BEFORE_THE_WALLS)), turn(behind), &config)
        };
        let (expected_db, expected) = past(&[sheet]);
        for (number, pieces) in cases.iter().enumerate() {
            let (found_db, found) = past(pieces);
            assert!(
                (found_db - expected_db).abs() < ROUNDED_DB && found == expected && found > 0,
                "{number} turned by {angle_rad}: {found_db}, not {expected_db} dB, {found} paths, not {expected}: {pieces:?}"
            );
        }
    }
}

#[test]
fn pieces_of_one_plane_reflect_once() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("rf.toml");
    fs::write(&config, "max_depth = 3\n").unwrap();
    let piece = |x: f32, half: f32| [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[y, z]| [x, y, z]);
    for (axis, angle_rad) in TURNS {
        let turn = |p| turned(p, axis, angle_rad);
        let off = |pieces: &[[[f32; 3]; 4]]| {
            let list: Vec<_> = pieces.iter().map(|piece| piece.map(turn)).collect();
            past_the_edge(&walls(folder.path(), &list, turn(BEFORE_THE_WALLS)), turn([-4.0, 0.5, 0.3]), &config)
        };
        let (expected_db, expected) = off(&[piece(0.0, 2.0)]);
        assert_eq!(expected, 2, "the direct path and one reflection");
        for x in [0.0, 1e-9, 1e-7, -1e-7, 1e-6, 1e-5, -1e-5] {
            for half in [2.0, 3.0] {
                let (found_db, found) = off(&[piece(0.0, 2.0), piece(x, half)]);
                assert!(
                    (found_db - expected_db).abs() < REFLECTED_DB && found == expected,
                    "{x} m, turned by {angle_rad}: {found_db}, not {expected_db} dB, {found} paths, not {expected}"
                );
            }
        }
    }
}

#[test]
fn a_box_within_a_box_that_is_flush_with_it_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("rf.toml");
    fs::write(&config, "diffraction = true\nmax_interactions = 2\n").unwrap();
    let sides = |low: [f32; 3], high: [f32; 3]| -> Vec<[[f32; 3]; 4]> {
        (0..6)
            .map(|side| {
                let (axis, far) = (side / 2, side % 2 == 1);
                let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[u, v]| {
                    let mut p = [if far { high } else { low }[axis]; 3];
                    for (i, end) in [((axis + 1) % 3, u), ((axis + 2) % 3, v)] {
                        p[i] = [low, high][end][i];
                    }
                    p
                });
                if far { corners } else { [corners[0], corners[3], corners[2], corners[1]] }
            })
            .collect()
    };
    let outer = sides([-1.0; 3], [1.0; 3]);
    let inner = sides([-1.0, -0.2, -1.0], [0.3, 1.0, 0.4]);
    let (tx, rx) = ([-3.0, 0.4, -0.3], [0.5, 1.2, 0.3]);
    for (axis, angle_rad) in TURNS {
        let turn = |p| turned(p, axis, angle_rad);
        let mut list: Vec<_> = outer.iter().map(|side| side.map(turn)).collect();
        let (expected_db, expected) = past_the_edge(&walls(folder.path(), &list, turn(tx)), turn(rx), &config);
        list.extend(inner.iter().map(|side| side.map(turn)));
        let (found_db, found) = past_the_edge(&walls(folder.path(), &list, turn(tx)), turn(rx), &config);
        assert!(
            (found_db - expected_db).abs() < ROUNDED_DB && found == expected && found > 0,
            "turned by {angle_rad}: {found_db}, not {expected_db} dB, {found} paths, not {expected}"
        );
    }
}
