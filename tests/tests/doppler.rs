//! Doppler shifts of paths: what the delays at two places say.

use crate::common::*;
use serde_json::Value;
use std::collections::BTreeMap;

/// Half the time between the two places, seconds.
const STEP_S: f64 = 1e-4;

/// The paths of a link by their interactions and objects, where these tell them apart.
fn paths(scene: &str, tx: [f64; 3], rx: [f64; 3], more: &[&str]) -> BTreeMap<String, Value> {
    let point = |p: [f64; 3]| p.map(|v| format!("{v:.12}")).join(",");
    let (tx, rx) = (format!("--tx={}", point(tx)), format!("--rx={}", point(rx)));
    let arguments = ["paths", scene, &tx, &rx, "--depth", "2", "--diffraction"];
    let json: Value = serde_json::from_str(&corf_ok(&[&arguments[..], more].concat())).unwrap();
    let mut found: BTreeMap<String, Vec<Value>> = BTreeMap::new();
    for path in json["paths"].as_array().unwrap() {
        // A face of a box is known by the side that the vertex lies on: to a decimetre it does not move.
        let vertices: Vec<String> = path["vertices"]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| format!("{:.1?}", v.as_array().unwrap().iter().map(|c| c.as_f64().unwrap()).collect::<Vec<_>>()))
            .collect();
        found.entry(format!("{} {} {vertices:?}", path["types"], path["objects"])).or_default().push(path.clone());
    }
    found.into_iter().filter(|(_, paths)| paths.len() == 1).map(|(key, mut paths)| (key, paths.remove(0))).collect()
}

#[test]
fn shifts_are_the_rates_at_which_delays_shrink() {
    let folder = tempfile::tempdir().unwrap();
    let tx = [1.03, 1.07, 1.93];
    let scene = room_with_pillar(folder.path(), tx, "");
    let (scene, rx) = (text(&scene), [4.11, 3.37, 1.21]);
    let (v_rx, v_tx) = ([1.5, -0.7, 0.4], [-0.3, 0.9, 0.2]);
    let moved = |p: [f64; 3], v: [f64; 3], t: f64| [0, 1, 2].map(|k| p[k] + t * v[k]);
    let written = |flag: &str, v: [f64; 3]| format!("{flag}={}", v.map(|c| c.to_string()).join(","));
    let flags = [written("--velocity", v_rx), written("--tx-velocity", v_tx)];
    let here = paths(scene, tx, rx, &[&flags[0], &flags[1]]);
    let at = |t: f64| paths(scene, moved(tx, v_tx, t), moved(rx, v_rx, t), &[]);
    let (before, after) = (at(-STEP_S), at(STEP_S));
    let mut kinds = std::collections::BTreeSet::new();
    for (key, path) in &here {
        let (Some(a), Some(b)) = (before.get(key), after.get(key)) else { continue };
        assert!(a.get("doppler_hz").is_none(), "it is given where a velocity is");
        let tau = |p: &Value| p["tau"].as_f64().unwrap();
        let expected = -60e9 * (tau(b) - tau(a)) / (2.0 * STEP_S);
        let doppler = path["doppler_hz"].as_f64().unwrap();
        // 2 m/s are 400 Hz at 60 GHz; rounding of a delay of 30 ns over 0.2 ms is 1e-3 Hz.
        assert!((doppler - expected).abs() < 0.05, "{key}: {doppler} Hz, delays say {expected} Hz");
        kinds.insert(path["types"].to_string());
    }
    assert!(kinds.len() >= 4 && here.len() > 10, "{kinds:?}");
    // Towards each other is positive: 1 m/s head on.
    let nearer: Value =
        serde_json::from_str(&corf_ok(&["paths", scene, "--tx=1,1,1", "--rx=1.5,1,1", "--velocity=-1,0,0", "--depth", "0"]))
            .unwrap();
    let shift = nearer["paths"][0]["doppler_hz"].as_f64().unwrap();
    let frequency = nearer["frequency_hz"].as_f64().unwrap();
    assert!((shift - frequency / 299_792_458.0).abs() < 1e-6, "{shift}");
    let sionna: Value =
        serde_json::from_str(&corf_ok(&["paths", scene, "--rx=4,3,1", "--velocity=1,0,0", "--format", "sionna"])).unwrap();
    assert!(sionna["doppler"][0][0].as_array().is_some_and(|d| !d.is_empty()), "{}", sionna["doppler"]);
    let out = folder.path().join("a.npz");
    corf_refuses(&["paths", scene, "--rx=4,3,1", "--velocity=1,0,0", "--format", "npz", "--out", text(&out)], &["stand still"]);
    corf_refuses(&["paths", scene, "--rx=4,3,1", "--velocity=1e6,0,0"], &["metres per second"]);
}
