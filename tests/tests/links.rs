//! `corf paths` and `corf coverage` as a user runs them.

use crate::common::*;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

#[test]
fn a_link_comes_with_its_statistics_responses_and_matrix() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], "");
    let args = [
        "paths",
        text(&scene),
        "--rx",
        "5,4,1.5",
        "--bandwidth",
        "400e6",
        "--subcarriers",
        "16",
        "--rx-array",
        "2x3",
        "--tx-power-dbm",
        "20",
    ];
    let link: Value = serde_json::from_str(&corf_ok(&args)).unwrap();
    let (paths, channel) = (link["paths"].as_array().unwrap(), &link["channel"]);
    assert!(paths.len() > 10);
    let power: f64 = paths.iter().map(|p| p["a"][0].as_f64().unwrap().powi(2) + p["a"][1].as_f64().unwrap().powi(2)).sum();
    assert!((channel["rssi_dbm"].as_f64().unwrap() - 20.0 - 10.0 * power.log10()).abs() < 1e-9);
    assert_eq!(link["channel_matrix"]["shape"], serde_json::json!([6, 1]));
    assert_eq!(link["frequency_response"]["h"].as_array().unwrap().len(), 16);
    // Offset 0 of the band is the coherent gain at the carrier.
    let h = &link["frequency_response"]["h"][8];
    let coherent = 10.0 * (h[0].as_f64().unwrap().powi(2) + h[1].as_f64().unwrap().powi(2)).log10();
    assert!((channel["path_gain_coherent_db"].as_f64().unwrap() - coherent).abs() < 1e-6);
    // There the response of every port is its entry of the channel matrix; taps have a port each as well.
    let (at_ports, taps) = (&link["frequency_response"]["h_ports"], &link["impulse_response"]["h_ports"]);
    for port in 0..6 {
        let [a, b] = [&at_ports[port][0][8], &link["channel_matrix"]["h"][port]]
            .map(|h| [h[0].as_f64(), h[1].as_f64()].map(Option::unwrap));
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-12 * b[0].hypot(b[1]), "{port}: {a:?} {b:?}");
        assert_eq!(taps[port][0].as_array().unwrap().len(), link["impulse_response"]["h"].as_array().unwrap().len());
    }
}

#[test]
fn several_receivers_come_from_points_and_files_and_leave_as_arrays() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], "");
    let file = folder.path().join("rx.csv");
    fs::write(&file, "x,y,z\n5,4,1.5\n4,1,1\n").unwrap();
    let receivers = ["paths", text(&scene), "--rx", "3,4,1", "--rx-file", text(&file), "--depth", "2"];
    let links: Value = serde_json::from_str(&corf_ok(&receivers)).unwrap();
    assert_eq!(links["links"].as_array().unwrap().len(), 3);
    let sionna: Value = serde_json::from_str(&corf_ok(&[&receivers[..], &["--format", "sionna"]].concat())).unwrap();
    for (rx, link) in links["links"].as_array().unwrap().iter().enumerate() {
        let valid = sionna["valid"][rx][0].as_array().unwrap().iter().filter(|v| v.as_bool().unwrap()).count();
        assert_eq!(valid, link["paths"].as_array().unwrap().len());
        assert_eq!(sionna["tau"][rx][0][0], link["paths"][0]["tau"]);
    }
    let out = folder.path().join("a.npz");
    corf_ok(&[&receivers[..], &["--format", "npz", "--out", text(&out)]].concat());
    assert!(fs::read(&out).unwrap().starts_with(b"PK\x03\x04"));
    corf_refuses(&[&receivers[..], &["--format", "npz"]].concat(), &["--out", "npz"]);
    fs::write(&file, "1,2,3\n4,5\n").unwrap();
    corf_refuses(&receivers, &["rx.csv:2", "three numbers"]);
}

/// The columns of float64 in an archive whose files are stored as they are.
fn columns_of(archive: &[u8]) -> BTreeMap<String, Vec<f64>> {
    let (mut columns, mut rest) = (BTreeMap::new(), archive);
    while rest.starts_with(b"PK\x03\x04") {
        let number = |at: usize, bytes: usize| rest[at..at + bytes].iter().rev().fold(0, |n, b| n * 256 + usize::from(*b));
        let (size, name, extra) = (number(18, 4), number(26, 2), number(28, 2));
        let from = 30 + name + extra;
        let array = &rest[from..from + size];
        let header = 10 + usize::from(array[8]) + 256 * usize::from(array[9]);
        assert!(String::from_utf8_lossy(&array[..header]).contains("'<f8'"));
        let values = array[header..].chunks_exact(8).map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap())).collect();
        columns.insert(std::str::from_utf8(&rest[30..30 + name]).unwrap().trim_end_matches(".npy").to_owned(), values);
        rest = &rest[from + size..];
    }
    columns
}

/// A table has what the JSON says of the same links, whichever its form; its own columns, in any order and unit, are receivers again.
#[test]
fn a_table_of_links_is_written_by_its_ending_and_read_by_its_names() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], "");
    let file = folder.path().join("rx.csv");
    // The last stands behind the pillar, without a line of sight.
    fs::write(&file, "name,z_m,x_m,y_cm\na,1.5,5,400\nb,1,4,100\nc,1,3.5,330\n").unwrap();
    let ask = ["paths", text(&scene), "--rx-file", text(&file), "--depth", "1", "--tx-power-dbm", "20"];
    let json: Value = serde_json::from_str(&corf_ok(&ask)).unwrap();
    let links = json["links"].as_array().unwrap();
    assert_eq!(links[0]["rx"], serde_json::json!([5.0, 4.0, 1.5]));
    let [csv, npz] = ["links.csv", "links.npz"].map(|name| folder.path().join(name));
    for out in [&csv, &npz] {
        corf_ok(&[&ask[..], &["--out", text(out)]].concat());
    }
    assert_eq!(corf_ok(&[&ask[..], &["--format", "table"]].concat()), fs::read_to_string(&csv).unwrap());
    let table = fs::read_to_string(&csv).unwrap();
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().unwrap();
    let archive = columns_of(&fs::read(&npz).unwrap());
    let rows: Vec<Vec<&str>> = lines.collect();
    assert_eq!(rows.len(), 3);
    let mut missing = 0;
    for (column, name) in names.iter().enumerate() {
        for (row, link) in rows.iter().zip(links) {
            assert_eq!(row.len(), names.len());
            let expected = match (name.strip_prefix("tx_"), name.strip_prefix("rx_"), *name) {
                (Some(axis), ..) => link["tx"]["x_m y_m z_m".find(axis).unwrap() / 4].as_f64(),
                (_, Some(axis), _) => link["rx"]["x_m y_m z_m".find(axis).unwrap() / 4].as_f64(),
                (.., "paths") => Some(link["paths"].as_array().unwrap().len() as f64),
                _ => link["channel"][name].as_bool().map(f64::from).or(link["channel"][name].as_f64()),
            };
            assert_eq!(row[column].parse().ok(), expected, "{name}");
            missing += usize::from(expected.is_none());
        }
        let array = &archive[*name];
        let same = |(a, b): (&f64, &Vec<&str>)| b[column].parse::<f64>().map_or(a.is_nan(), |b| *a == b);
        assert!(array.iter().zip(&rows).all(same), "{name}");
    }
    assert!(missing > 0 && names.contains(&"path_gain_db") && names.contains(&"rssi_dbm"), "{names:?}");
    // Round: its receivers are those of the table.
    let again = ["paths", text(&scene), "--rx-file", text(&csv), "--depth", "1", "--tx-power-dbm", "20", "--format", "table"];
    assert_eq!(corf_ok(&again), table);
    // What a table has no place for, and endings that are none.
    let out = |name: &str| folder.path().join(name).display().to_string();
    corf_refuses(&[&ask[..], &["--format", "table", "--out", &out("links.txt")]].concat(), &["links.txt", ".csv"]);
    corf_refuses(&[&ask[..], &["--format", "json", "--out", &out("other.csv")]].concat(), &["other.csv", "--format table"]);
    corf_refuses(&[&ask[..], &["--velocity", "1,0,0", "--out", &out("v.csv")]].concat(), &["--velocity", "table"]);
    corf_refuses(&[&ask[..], &["--bandwidth", "1e8", "--out", &out("b.csv")]].concat(), &["--bandwidth", "table"]);
    fs::write(&file, "name,east,north\na,5,4\n").unwrap();
    corf_refuses(&ask, &["rx.csv:1", "east", "x_m"]);
    assert!(["links.txt", "other.csv", "v.csv", "b.csv"].iter().all(|name| !folder.path().join(name).exists()));
}

#[test]
fn a_coverage_map_says_what_single_links_say_whatever_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], "");
    let run = |name: &str, threads: &str| {
        let out = folder.path().join(name);
        corf_ok(&[
            "--threads",
            threads,
            "coverage",
            text(&scene),
            "--height",
            "1.5",
            "--cell",
            "0.5",
            "--depth",
            "2",
            "--out",
            text(&out),
        ]);
        out
    };
    let (one, two) = (run("one", "1"), run("two", "2"));
    for file in ["coverage.exr", "coverage.png", "coverage.json"] {
        assert_eq!(fs::read(one.join(file)).unwrap(), fs::read(two.join(file)).unwrap(), "{file}");
    }
    let report: Value = serde_json::from_str(&fs::read_to_string(one.join("coverage.json")).unwrap()).unwrap();
    let map = corf_scene::io::read_exr_f32(one.join("coverage.exr")).unwrap();
    assert_eq!((map.width(), map.height()), (12, 10));
    // The pillar covers one cell's centre: column 4 (2.25 m), row 5 from the top (2.25 m).
    assert_eq!(report["cells_without_value"], 1);
    assert!(map[(4, 5)].is_nan());
    // Row 2 from the top lies at y = 3.75 m, column 9 at x = 4.75 m.
    let link: Value = serde_json::from_str(&corf_ok(&["paths", text(&scene), "--rx", "4.75,3.75,1.5", "--depth", "2"])).unwrap();
    let gain_db = 10.0 * f64::from(map[(9, 2)]).log10();
    assert!((gain_db - link["total_power_db"].as_f64().unwrap()).abs() < 1e-5, "{gain_db}");
    // One cell, its centre on a face of the pillar.
    let out = folder.path().join("face");
    let corner = ["1.75,2,1.5", "2.25,2,1.5", "1.75,2.5,1.5"];
    corf_refuses(
        &["coverage", text(&scene), "--plane", corner[0], corner[1], corner[2], "--cell", "0.5", "--out", text(&out)],
        &["no cell has a value"],
    );
    corf_refuses(
        &["coverage", text(&scene), "--height", "7", "--out", text(&folder.path().join("x"))],
        &["7", "0.00 m to 3.00 m"],
    );
    corf_refuses(
        &["coverage", text(&scene), "--height", "1", "--cell", "0", "--out", text(&folder.path().join("x"))],
        &["cell size"],
    );
    assert!(!folder.path().join("x").exists());
}

/// A horizontal element hears nothing of a vertical wave while level, and a little once it is pitched and turned aside: what a path couples into
/// is asked at the pose. `corf paths` of both polarisations receives what `corf spectrum` does.
#[test]
fn polarisations_are_those_of_the_pose_and_powers_those_of_all_ports() {
    let folder = tempfile::tempdir().unwrap();
    let spectrum = |scene: &str, name: &str| -> Value {
        let (out, towards) = (folder.path().join(name), "1,0,2.5");
        let arguments = ["spectrum", scene, "--rx", "4,1.2,1.5", "--towards", towards, "--depth", "0", "--no-diffuse"];
        let more = ["--kind", "bartlett", "--size", "8x6", "--out", text(&out), "--json"];
        serde_json::from_str(&corf_ok(&[&arguments[..], &more[..]].concat())).unwrap()
    };
    let scene = |polarization: &str| {
        let receiver = format!("[receiver]\npolarization = \"{polarization}\"\n");
        let inside = folder.path().join(polarization);
        fs::create_dir(&inside).unwrap();
        room_with_pillar(&inside, [1.0, 1.5, 2.0], &receiver)
    };
    let (h, both) = (scene("H"), scene("VH"));
    let aside = spectrum(text(&h), "aside");
    assert_eq!(aside["paths"], 1, "{aside}");
    assert!(aside["received_power_db"].as_f64().unwrap() < -90.0, "{aside}");
    // An isotropic pair of polarisations takes all of the wave, however it is turned.
    let link: Value = serde_json::from_str(&corf_ok(&["paths", text(&both), "--rx", "4,1.2,1.5", "--depth", "0"])).unwrap();
    let (gain, received) = (link["channel"]["path_gain_db"].as_f64().unwrap(), spectrum(text(&both), "both"));
    assert!((gain - received["received_power_db"].as_f64().unwrap()).abs() < 1e-6, "{gain} {received}");
    assert_eq!(link["paths"][0]["a_ports"].as_array().unwrap().len(), 2);
}

/// Several transmitters at once are each what it is alone, with its own antenna.
#[test]
fn several_transmitters_keep_their_antennas() {
    let folder = tempfile::tempdir().unwrap();
    let extra = "[transmitters.east]\nposition_m = [5.5, 1.5, 2.0]\npattern = \"dipole\"\npolarization = \"VH\"\n\
                 [transmitters.west]\nposition_m = [0.5, 3.5, 1.0]\npattern = \"tr38901\"\npolarization = \"H\"\n";
    let scene = room_with_pillar(folder.path(), [1.0, 1.5, 2.0], extra);
    let ask = |more: &[&str]| -> Value {
        let arguments = [&["paths", text(&scene), "--rx", "4,1.2,1.5", "--depth", "1"], more].concat();
        serde_json::from_str(&corf_ok(&arguments)).unwrap()
    };
    let together = ask(&["--transmitter", "west", "--transmitter", "east"]);
    let alone = [ask(&["--transmitter", "west"]), ask(&["--transmitter", "east"])];
    assert_eq!(together["links"].as_array().unwrap().as_slice(), &alone);
    assert_ne!(alone[0]["channel"]["path_gain_db"], alone[1]["channel"]["path_gain_db"]);
    let both = ["paths", text(&scene), "--rx", "4,1.2,1.5", "--transmitter", "west", "--transmitter", "east"];
    corf_refuses(&[&both[..], &["--tx", "1,1,1"]].concat(), &["--tx", "--transmitter"]);
    corf_refuses(&[&both[..], &["--format", "sionna"]].concat(), &["--transmitter", "[1, 2] ports"]);
}

/// Scattered power in the response of a link is that in its channel matrix: one draw of phases, and of each polarisation its share.
#[test]
fn responses_and_matrix_hold_the_same_scattered_power() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], "[receiver]\npolarization = \"VH\"\n");
    let link = ["paths", text(&scene), "--rx", "5,4,1.5", "--depth", "1", "--diffuse", "--directions", "2000"];
    let band = ["--bandwidth", "1e9", "--subcarriers", "4"];
    let link: Value = serde_json::from_str(&corf_ok(&[&link[..], &band[..]].concat())).unwrap();
    let number = |h: &Value| [h[0].as_f64().unwrap(), h[1].as_f64().unwrap()];
    let (response, matrix) = (&link["frequency_response"], &link["channel_matrix"]["h"]);
    let [a, b, c] = [&response["h"][2], &response["h_ports"][0][0][2], &matrix[0]].map(number);
    let off = |x: [f64; 2]| (x[0] - c[0]).hypot(x[1] - c[1]) / c[0].hypot(c[1]);
    assert!(off(a) < 1e-9 && off(b) < 1e-9, "{a:?} {b:?} {c:?}");
    let coherent: f64 = (0..2).map(|port| number(&matrix[port])).map(|[re, im]| re * re + im * im).sum();
    let stated = link["channel"]["path_gain_coherent_db"].as_f64().unwrap();
    assert!((stated - 10.0 * coherent.log10()).abs() < 1e-9, "{stated}");
    // Refused: what no memory holds, and a band below 0 Hz.
    let ask = ["paths", text(&scene), "--rx", "5,4,1.5", "--depth", "1"];
    corf_refuses(&[&ask[..], &["--bandwidth", "1e18"]].concat(), &["--bandwidth", "below 0"]);
    corf_refuses(&[&ask[..], &["--rx-array", "1024x1024"]].concat(), &["1024x1024", "4096 elements"]);
    let many = ["--rx-array", "64x64", "--tx-array", "64x64", "--bandwidth", "1e9"];
    corf_refuses(&[&ask[..], &many[..]].concat(), &["--subcarriers", "pairs of ports"]);
}

/// A map is of single elements; an array of one is the scene's own, its beam kept; and what a file asks for is done.
#[test]
fn link_files_are_done_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(
        folder.path(),
        [1.0, 1.0, 2.0],
        "[transmitters.beam]\nposition_m = [1.0, 1.0, 2.0]\nrows = 4\ncols = 4\n",
    );
    let gain = |more: &[&str]| {
        let link = ["paths", text(&scene), "--transmitter", "beam", "--rx", "4,1.2,1.5", "--depth", "0"];
        let link: Value = serde_json::from_str(&corf_ok(&[&link[..], more].concat())).unwrap();
        link["channel"]["path_gain_db"].as_f64().unwrap()
    };
    assert_eq!(gain(&[]), gain(&["--tx-array", "1x1"]));
    assert_ne!(gain(&[]), gain(&["--tx-array", "2x2"]));
    let radio = folder.path().join("rf.toml");
    let out = folder.path().join("map");
    let map = [
        "coverage",
        text(&scene),
        "--height",
        "1.5",
        "--cell",
        "2",
        "--depth",
        "1",
        "--config",
        text(&radio),
        "--out",
        text(&out),
    ];
    for (asked, words) in [
        ("[receiver]\nrows = 4\ncols = 4\n", ["[receiver]", "4x4"]),
        ("edge_diffraction = true\n", ["edge_diffraction", "diffraction = true"]),
    ] {
        fs::write(&radio, asked).unwrap();
        corf_refuses(&map, &words);
    }
    fs::write(&radio, "diffuse = true\ndirections = 3000\n").unwrap();
    corf_ok(&map);
    let report: Value = serde_json::from_str(&fs::read_to_string(out.join("coverage.json")).unwrap()).unwrap();
    assert_eq!((&report["diffuse_directions"], &report["settings"]["directions"]), (&3000.into(), &3000.into()));
}

/// Maps of several transmitters at once are those of each alone, and the strongest of them.
#[test]
fn the_coverage_of_several_transmitters_is_of_the_strongest() {
    let folder = tempfile::tempdir().unwrap();
    let extra = "[transmitters.east]\nposition_m = [5.5, 1.5, 2.0]\npattern = \"dipole\"\npolarization = \"VH\"\n\
                 [transmitters.west]\nposition_m = [0.5, 3.5, 1.0]\npattern = \"tr38901\"\n";
    let scene = room_with_pillar(folder.path(), [1.0, 1.5, 2.0], extra);
    let map = |name: &str, transmitters: &[&str]| {
        let out = folder.path().join(name);
        let plane = ["coverage", text(&scene), "--height", "1.5", "--cell", "0.5", "--depth", "1", "--out", text(&out)];
        let named = transmitters.iter().flat_map(|tx| ["--transmitter", tx]);
        corf_ok(&plane.into_iter().chain(named).collect::<Vec<_>>());
        out
    };
    let (both, west, east) = (map("both", &["west", "east"]), map("west", &["west"]), map("east", &["east"]));
    for (number, alone) in [&west, &east].into_iter().enumerate() {
        let together = fs::read(both.join(format!("coverage_tx{number}.exr"))).unwrap();
        assert_eq!(together, fs::read(alone.join("coverage.exr")).unwrap(), "{number}");
    }
    let read = |folder: &Path, name: &str| corf_scene::io::read_exr_f32(folder.join(name)).unwrap();
    let (gain, of) = (read(&both, "coverage.exr"), read(&both, "association.exr"));
    let alone = [read(&west, "coverage.exr"), read(&east, "coverage.exr")];
    let mut cells = [0; 2];
    for (i, gain) in gain.pixels().iter().enumerate() {
        let [a, b] = [0, 1].map(|number| alone[number].pixels()[i]);
        if gain.is_nan() {
            assert!(a.is_nan() && b.is_nan() && of.pixels()[i].is_nan());
            continue;
        }
        let strongest = usize::from(b > a);
        cells[strongest] += 1;
        assert_eq!((*gain, of.pixels()[i]), (a.max(b), strongest as f32));
    }
    assert!(cells.iter().all(|n| *n > 10), "{cells:?}");
    let report: Value = serde_json::from_str(&fs::read_to_string(both.join("coverage.json")).unwrap()).unwrap();
    for (number, n) in cells.into_iter().enumerate() {
        assert_eq!(report["transmitters"][number]["cells_strongest"], n, "{report}");
    }
}

#[test]
fn an_array_whose_elements_differ_is_that_of_its_file() {
    let folder = tempfile::tempdir().unwrap();
    // Responses to plane waves as a laboratory measures them about the array's centre: element 1 is dead, element 3 is turned by a right angle.
    let own = [(1.0, 0.0), (0.0, 0.0), (0.8, 0.0), (1.0, std::f64::consts::FRAC_PI_2)];
    let file = |name: &str, own: [(f64, f64); 4], sign: f64| {
        let mut lines = String::from("elevation_deg,azimuth_deg,element,re,im\n");
        for (elevation, azimuth) in (-90..=90).step_by(10).flat_map(|e| (-180..180).step_by(10).map(move |a| (e, a))) {
            let [e, a] = [elevation, azimuth].map(|angle: i32| f64::from(angle).to_radians());
            for (m, (amplitude, phase)) in own.iter().enumerate() {
                let (y, z) = ((m / 2) as f64 - 0.5, 0.5 - (m % 2) as f64);
                let place = std::f64::consts::PI * (y * e.cos() * a.sin() + z * e.sin());
                let (sin, cos) = (sign * (place + phase)).sin_cos();
                lines.push_str(&format!("{elevation},{azimuth},{m},{},{}\n", amplitude * cos, amplitude * sin));
            }
        }
        fs::write(folder.path().join(name), lines).unwrap();
    };
    let scene = |receiver: &str| {
        room_with_pillar(folder.path(), [1.0, 1.0, 2.0], &format!("[receiver]\nrows = 2\ncols = 2\n{receiver}\n"))
    };
    let matrix = |receiver: &str| -> Vec<[f64; 2]> {
        let scene = scene(receiver);
        let asked = ["paths", text(&scene), "--rx", "5,4,1.5", "--depth", "2", "--rx-array", "2x2", "--bandwidth", "400e6"];
        let link: Value = serde_json::from_str(&corf_ok(&asked)).unwrap();
        serde_json::from_value(link["channel_matrix"]["h"].clone()).unwrap()
    };
    let plain = matrix("");
    file("uneven.csv", own, 1.0);
    let uneven = matrix("pattern = { file = \"uneven.csv\" }");
    for (m, (amplitude, phase)) in own.into_iter().enumerate() {
        let ([re, im], (sin, cos)) = (plain[m], phase.sin_cos());
        let expected = [amplitude * (re * cos - im * sin), amplitude * (re * sin + im * cos)];
        let off = (uneven[m][0] - expected[0]).hypot(uneven[m][1] - expected[1]);
        assert!(off < 1e-6 * re.hypot(im), "{m}: {:?} {expected:?}", uneven[m]);
    }

    // Elements that are alike form the spectrum of isotropic ones; a dead one changes it.
    file("alike.csv", [(1.0, 0.0); 4], 1.0);
    let spectrum = |receiver: &str| {
        let (scene, out) = (scene(receiver), folder.path().join("spectrum"));
        let asked = [
            "spectrum",
            text(&scene),
            "--rx",
            "5,4,1.5",
            "--out",
            text(&out),
            "--size",
            "24x16",
            "--kind",
            "bartlett",
            "--depth",
            "2",
        ];
        corf_ok(&[&asked[..], &["--no-diffuse"]].concat());
        let linear = corf_scene::io::read_exr_f32(out.join("bartlett.exr")).unwrap();
        fs::remove_dir_all(out).unwrap();
        linear.pixels().to_vec()
    };
    let [plain, alike, uneven] = ["", "pattern = { file = \"alike.csv\" }", "pattern = { file = \"uneven.csv\" }"].map(spectrum);
    let peak = plain.iter().copied().fold(0f32, f32::max);
    let differ = |other: &[f32]| plain.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0f32, f32::max) / peak;
    assert!(differ(&alike) < 1e-5 && differ(&uneven) > 0.1, "{} {}", differ(&alike), differ(&uneven));

    // What is not this array's file is refused before anything is traced.
    let refused = |receiver: &str, words: &[&str]| corf_refuses(&["paths", text(&scene(receiver)), "--rx", "5,4,1.5"], words);
    file("conjugate.csv", own, -1.0);
    refused("pattern = { file = \"conjugate.csv\" }", &["conjugate.csv", "e^{-jωt}"]);
    refused("pattern = { file = \"alike.csv\", phases = \"element\" }", &["alike.csv", "phases = \"array\""]);
    refused(
        "pattern = { file = \"alike.csv\" }\nspacing_wavelengths = 0.5\n[transmitters.b]\nposition_m = [1, 1, 1]\npattern = { file = \"alike.csv\" }",
        &["[receiver]"],
    );
    let other = text(&scene("pattern = { file = \"alike.csv\" }")).to_owned();
    corf_refuses(&["paths", &other, "--rx", "5,4,1.5", "--rx-array", "2x3"], &["2x2 elements", "2x3 elements"]);
}
