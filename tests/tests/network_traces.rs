//! `corf paths --format qd`: links along a way as ns-3 reads them, against image sources.

use crate::common::*;
use glam::DVec3;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const C: f64 = 299_792_458.0;
const CARRIER_HZ: f64 = 60e9;
/// Metres, decibels, radians, parts of a unit vector.
const TOLERANCE: f64 = 1e-6;

/// The paths of each step: delay s, gain dB, phase rad, directions of departure and of arrival.
type Steps = Vec<Vec<(f64, f64, f64, DVec3, DVec3)>>;

fn towards(zenith_deg: f64, azimuth_deg: f64) -> DVec3 {
    assert!((0.0..=180.0).contains(&zenith_deg) && (0.0..360.0).contains(&azimuth_deg), "{zenith_deg} {azimuth_deg}");
    let (theta, phi) = (zenith_deg.to_radians(), azimuth_deg.to_radians());
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// Reads a text file as the format's description has it.
fn read(path: &Path) -> Steps {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.ends_with('\n'), "a step whose last line does not end is lost");
    let (mut lines, mut steps) = (text.lines(), Steps::new());
    while let Some(count) = lines.next() {
        let count: usize = count.parse().unwrap();
        let rows: Vec<Vec<f64>> = (0..if count > 0 { 7 } else { 0 })
            .map(|_| lines.next().unwrap().split(',').map(|v| v.parse().unwrap()).collect())
            .collect();
        assert!(rows.iter().all(|row| row.len() == count));
        let path =
            |i: usize| (rows[0][i], rows[1][i], rows[2][i], towards(rows[3][i], rows[4][i]), towards(rows[5][i], rows[6][i]));
        steps.push((0..count).map(path).collect());
    }
    steps
}

/// Images of a point in the walls of a box with a corner at the origin, up to two reflections: none, six, eighteen.
fn images(point: DVec3, size: DVec3) -> Vec<([i32; 3], DVec3)> {
    let along = |x: f64, side: f64, n: i32| if n % 2 == 0 { f64::from(n) * side + x } else { f64::from(n + 1) * side - x };
    let mut found = Vec::new();
    for n in (0..125).map(|i| [i / 25 - 2, i / 5 % 5 - 2, i % 5 - 2]) {
        if n.iter().map(|k: &i32| k.abs()).sum::<i32>() <= 2 {
            let image = [0, 1, 2].map(|k| along(point[k], size[k], n[k]));
            found.push((n, DVec3::from_array(image)));
        }
    }
    found
}

#[test]
fn an_empty_room_gives_its_image_sources_and_phases_turn_at_the_doppler_shift() {
    let folder = tempfile::tempdir().unwrap();
    let (tx, size, velocity, interval_s) =
        (DVec3::new(1.03, 1.07, 1.93), DVec3::new(6.0, 5.0, 3.0), DVec3::new(0.6, -0.8, 0.1), 1e-3);
    let scene = boxes_scene(folder.path(), &[("room", "wall", [0.0; 3], size.to_array(), CLOSED)], tx.to_array(), "");
    let receivers: Vec<DVec3> = (-1..=1).map(|k| DVec3::new(4.11, 3.37, 1.21) + velocity * interval_s * f64::from(k)).collect();
    let file = folder.path().join("way.csv");
    let lines: String = receivers.iter().map(|p| format!("{},{},{}\n", p.x, p.y, p.z)).collect();
    fs::write(&file, lines).unwrap();
    let (out, json_out) = (folder.path().join("qd"), folder.path().join("qd-json"));
    let call = ["paths", text(&scene), "--rx-file", text(&file), "--interval", "1e-3", "--depth", "2", "--format"];
    corf_ok(&[&call[..], &["qd", "--out", text(&out)]].concat());
    let forth = read(&out.join("Output/Ns3/QdFiles/Tx0Rx1.txt"));
    let back = read(&out.join("Output/Ns3/QdFiles/Tx1Rx0.txt"));
    assert_eq!((forth.len(), back.len()), (3, 3));
    let mut delays = vec![[0.0; 3]; 25];
    for (step, rx) in receivers.iter().enumerate() {
        assert_eq!(forth[step].len(), 25);
        assert!(forth[step].windows(2).all(|pair| pair[0].0 <= pair[1].0), "the earliest comes first");
        // The receiver's images give departures, as the transmitter's give arrivals: of a path that crosses an even number of rooms along an axis
        // the numbers change sign, of others they stay.
        let of_rx = images(*rx, size);
        for (i, (n, image)) in images(tx, size).into_iter().enumerate() {
            let (length_m, arrival) = (image.distance(*rx), (image - *rx).normalize());
            let other = n.map(|k| if k % 2 == 0 { -k } else { k });
            let departure = (of_rx.iter().find(|(m, _)| *m == other).unwrap().1 - tx).normalize();
            let near = |p: &&(f64, f64, f64, DVec3, DVec3)| {
                (p.0 * C - length_m).abs() < TOLERANCE && p.3.distance(departure) < TOLERANCE && p.4.distance(arrival) < TOLERANCE
            };
            let path = forth[step].iter().find(near).unwrap_or_else(|| panic!("no path of image {n:?} at step {step}"));
            let there = back[step].iter().any(|p| (p.0, p.1, p.2) == (path.0, path.1, path.2) && p.3 == path.4 && p.4 == path.3);
            assert!(there, "the way back of image {n:?}");
            delays[i][step] = path.0;
            if n == [0; 3] {
                let free_db = 20.0 * (C / CARRIER_HZ / (4.0 * std::f64::consts::PI * length_m)).log10();
                assert!((path.1 - free_db).abs() < TOLERANCE && path.2 == 0.0, "{path:?} {free_db}");
            }
        }
    }
    // h turns by −2πf·dτ/dt: at f/c times the speed towards where the path comes from.
    for ((n, image), [before, _, after]) in images(tx, size).into_iter().zip(delays) {
        let shift_hz = -CARRIER_HZ * (after - before) / (2.0 * interval_s);
        let expected = CARRIER_HZ / C * (image - receivers[1]).normalize().dot(velocity);
        assert!((shift_hz - expected).abs() < 1e-3, "{n:?}: {shift_hz} Hz instead of {expected}");
    }
    // The other variant has the same numbers.
    corf_ok(&[&call[..], &["qd-json", "--out", text(&json_out)]].concat());
    let lines = fs::read_to_string(json_out.join("Output/Ns3/QdFiles/qdOutput.json")).unwrap();
    let pairs: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let columns = |steps: &Steps, pick: fn(&(f64, f64, f64, DVec3, DVec3)) -> f64| -> Value {
        json!(steps.iter().map(|paths| paths.iter().map(pick).collect::<Vec<_>>()).collect::<Vec<_>>())
    };
    for (pair, (steps, ends)) in pairs.iter().zip([(&forth, [0, 1]), (&back, [1, 0])]) {
        assert_eq!((&pair["TX"], &pair["RX"]), (&json!(ends[0]), &json!(ends[1])));
        assert_eq!((&pair["Delay"], &pair["Gain"]), (&columns(steps, |p| p.0), &columns(steps, |p| p.1)));
    }
    let nodes = fs::read_to_string(json_out.join("Output/Visualizer/NodePositions.json")).unwrap();
    let moving: Value = serde_json::from_str(nodes.lines().nth(1).unwrap()).unwrap();
    assert_eq!(moving["Position"], json!(receivers.iter().map(|p| p.to_array()).collect::<Vec<_>>()));
}

#[test]
fn a_step_in_the_shadow_has_no_paths_and_the_trajectory_says_the_time() {
    let folder = tempfile::tempdir().unwrap();
    let trajectory = "[trajectory]\nwaypoints_m = [[4, 0.8], [5, 1.6], [4.6, 0.9]]\nheight_m = 1.5\nspeed_m_per_s = 2.0\n";
    let scene = room_with_pillar(folder.path(), [1.0, 2.3, 1.5], trajectory);
    let out = folder.path().join("shadow");
    // Behind the pillar, and beside it.
    let places = ["--rx=4,2.3,1.5", "--rx=4,4,1.5", "--interval=0.1", "--depth=0"];
    corf_ok(&[&["paths", text(&scene)], &places[..], &["--format", "qd", "--out", text(&out)]].concat());
    let file = fs::read_to_string(out.join("Output/Ns3/QdFiles/Tx0Rx1.txt")).unwrap();
    assert!(file.starts_with("0\n1\n") && file.lines().count() == 9, "{file}");
    let out = folder.path().join("way");
    let stderr =
        String::from_utf8(corf(&["paths", text(&scene), "--rx-trajectory=4", "--format=qd", "--out", text(&out)]).stderr)
            .unwrap();
    assert!(stderr.contains("half a wavelength is 2.50 mm") && stderr.contains("3e8"), "{stderr}");
    let settings = fs::read_to_string(out.join("Input/paraCfgCurrent.txt")).unwrap();
    let value = |key: &str| -> f64 { settings.lines().find_map(|l| l.strip_prefix(key)).unwrap().trim().parse().unwrap() };
    let steps = read(&out.join("Output/Ns3/QdFiles/Tx0Rx1.txt")).len();
    assert_eq!((value("numberOfTimeDivisions"), value("carrierFrequency"), steps), (4.0, CARRIER_HZ, 4));
    let way = corf_scene::config::SceneConfig::load(&scene).unwrap().trajectory.unwrap();
    let loop_s = corf_scene::trajectory::loop_length_m(&way).unwrap() / 2.0;
    assert!((value("totalTimeDuration") - loop_s).abs() < 1e-9, "{settings}");
}

#[test]
fn what_the_format_cannot_hold_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], "");
    let out = folder.path().join("qd");
    let refused = |more: &[&str], words: &[&str]| {
        corf_refuses(&[&["paths", text(&scene), "--rx=4,4,1.5", "--format=qd", "--out", text(&out)], more].concat(), words);
    };
    refused(&[], &["--interval", "no time"]);
    refused(&["--interval=0"], &["--interval", "seconds"]);
    refused(&["--interval=1", "--tx=1,1,1", "--tx=2,1,1"], &["2 transmitters", "a folder for each"]);
    refused(&["--interval=1", "--velocity=1,0,0"], &["--velocity", "one a step"]);
    refused(&["--interval=1", "--diffuse"], &["--diffuse", "no coefficient"]);
    refused(&["--interval=1", "--rx-array=2x2"], &["ns-3 forms arrays itself"]);
    refused(&["--interval=1", "--bandwidth=1e9"], &["--bandwidth"]);
    assert!(!out.exists());
    corf_refuses(&["paths", text(&scene), "--rx=4,4,1.5", "--interval=1"], &["--interval", "qd"]);
}
