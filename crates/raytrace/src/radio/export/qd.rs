//! A link along a way as a scenario of quasi-deterministic (Q-D) channels, as NIST's Q-D channel realization software writes and ns-3 reads them.
//!
//! ```text
//! Input/paraCfgCurrent.txt                     numberOfTimeDivisions, totalTimeDuration s, carrierFrequency Hz; parted by tabs
//! Output/Ns3/QdFiles/Tx0Rx1.txt  Tx1Rx0.txt    as text: for each step the number of paths N and, where that is not 0, seven lines of N numbers
//! Output/Ns3/QdFiles/qdOutput.json             or as JSON: for each ordered pair an object on a line of its own, lists by step
//! Output/Ns3/NodesPosition/NodesPosition.csv   where each node is at first, metres
//! Output/Visualizer/NodePositions.json         where each node is at each step
//! ```
//!
//! Node 0 is the transmitter, which stands; node 1 the receiver, which moves. A path's seven numbers are its delay (s), gain (dB), phase (rad, from 0
//! to 2π), zenith and azimuth of departure, zenith and azimuth of arrival (degrees, world frame, azimuths from 0 to 360, the arrival's from the
//! receiver towards the last interaction). Both readers in ns-3 form h(f) = Σ 10^(gain/20)·e^{jφ}·e^{−j2πfτ}: φ is the phase of the coefficient
//! without propagation, which the delay brings. Delays are therefore written with all their digits; of two steps they differ by the
//! change of the path's length over c, and h turns at the Doppler shift −f·dτ/dt.

use super::PathSet;
use crate::radio::{Angles, Path};
use corf_scene::words::counted;
use corf_scene::{Error, Result};
use glam::DVec3;
use serde_json::json;
use std::f64::consts::TAU;
use std::fmt::Write;

/// The most steps, and the most paths of a step: ns-3 counts both in 16 bits.
const MOST: usize = u16::MAX as usize;
/// Numbers of a path.
const NUMBERS: usize = 7;
/// Their names in JSON, in their order.
const NAMES: [&str; NUMBERS] = ["Delay", "Gain", "Phase", "AODEL", "AODAZ", "AOAEL", "AOAAZ"];

/// How the paths are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QdForm {
    /// A text file an ordered pair of nodes.
    Text,
    /// One file of an object a line.
    Json,
}

/// The files of a scenario: path below its folder, bytes. The receivers of `set` are one that moves, `interval_s` seconds from one to the next.
///
/// # Errors
/// Several transmitters; more steps, or paths of a step, than ns-3 can count; an interval that is no time.
pub fn qd_scenario(set: &PathSet<'_>, interval_s: f64, form: QdForm) -> Result<Vec<(String, Vec<u8>)>> {
    if set.transmitters.len() != 1 {
        let what = format!("{}: ns-3 asks for the channels between them as well", counted(set.transmitters.len(), "transmitter"));
        return Err(Error::invalid("Q-D scenario", what, "write a folder for each"));
    }
    if set.receivers.len() > MOST || set.max_paths() > MOST {
        let what = format!(
            "{} of up to {}, and ns-3 counts to {MOST}",
            counted(set.receivers.len(), "step"),
            counted(set.max_paths(), "path")
        );
        return Err(Error::invalid("Q-D scenario", what, "give fewer receivers, or part the way"));
    }
    if !(interval_s > 0.0 && interval_s.is_finite()) {
        let what = format!("{interval_s} s from one receiver to the next");
        return Err(Error::invalid("Q-D scenario", what, "give a time above 0, seconds"));
    }
    let steps: Vec<Vec<[f64; NUMBERS]>> = (0..set.receivers.len()).map(|step| numbers(set.paths(step, 0))).collect();
    let back: Vec<Vec<[f64; NUMBERS]>> = steps.iter().map(|paths| paths.iter().map(|p| reversed(*p)).collect()).collect();
    let mut files = match form {
        QdForm::Text => vec![
            ("Output/Ns3/QdFiles/Tx0Rx1.txt".to_owned(), text(&steps).into_bytes()),
            ("Output/Ns3/QdFiles/Tx1Rx0.txt".to_owned(), text(&back).into_bytes()),
        ],
        QdForm::Json => {
            let lines = json_line([0, 1], &steps) + &json_line([1, 0], &back);
            vec![("Output/Ns3/QdFiles/qdOutput.json".to_owned(), lines.into_bytes())]
        }
    };
    let nodes: [Vec<DVec3>; 2] = [vec![set.transmitters[0]; set.receivers.len()], set.receivers.clone()];
    let first: String = nodes.iter().map(|places| places[0].to_array().map(|v| v.to_string()).join(",") + "\n").collect();
    let places: String = nodes.iter().enumerate().map(|(node, places)| node_line(node, places)).collect();
    let duration_s = interval_s * set.receivers.len() as f64;
    let settings = format!(
        "ParameterName\tParameterValue\nnumberOfTimeDivisions\t{}\ntotalTimeDuration\t{duration_s}\ncarrierFrequency\t{}\n",
        set.receivers.len(),
        set.frequency_hz
    );
    files.extend([
        ("Output/Ns3/NodesPosition/NodesPosition.csv".to_owned(), first.into_bytes()),
        ("Output/Visualizer/NodePositions.json".to_owned(), places.into_bytes()),
        ("Input/paraCfgCurrent.txt".to_owned(), settings.into_bytes()),
    ]);
    Ok(files)
}

/// The numbers of the paths of a step, by rising delay: ns-3 takes the first path's for the delay of the link. One without any power has no decibels.
fn numbers(paths: &[Path]) -> Vec<[f64; NUMBERS]> {
    let mut paths: Vec<&Path> = paths.iter().filter(|path| path.power() > 0.0).collect();
    paths.sort_by(|a, b| a.delay_s.total_cmp(&b.delay_s).then(b.power().total_cmp(&a.power())));
    paths.into_iter().map(of_path).collect()
}

fn of_path(path: &Path) -> [f64; NUMBERS] {
    let [departure, arrival] =
        [path.aod(), path.aoa()].map(|Angles { theta, phi }| [theta.to_degrees(), once_around(phi.to_degrees(), 360.0)]);
    let phase = once_around(path.a.im.atan2(path.a.re), TAU);
    [path.delay_s, 10.0 * path.power().log10(), phase, departure[0], departure[1], arrival[0], arrival[1]]
}

/// The same path the other way, by reciprocity: what departed arrives.
fn reversed([delay, gain, phase, aod_el, aod_az, aoa_el, aoa_az]: [f64; NUMBERS]) -> [f64; NUMBERS] {
    [delay, gain, phase, aoa_el, aoa_az, aod_el, aod_az]
}

/// An angle from 0 up to, and without, a whole turn.
fn once_around(angle: f64, turn: f64) -> f64 {
    let angle = angle.rem_euclid(turn);
    // What is a little under 0 is rounded to the whole turn.
    if angle < turn { angle } else { 0.0 }
}

/// As text. The last line ends as all do: ns-3 drops a step whose last line does not.
fn text(steps: &[Vec<[f64; NUMBERS]>]) -> String {
    let mut text = String::new();
    for paths in steps {
        let _ = writeln!(text, "{}", paths.len());
        for number in (0..NUMBERS).take_while(|_| !paths.is_empty()) {
            let line: Vec<String> = paths.iter().map(|path| written(path[number])).collect();
            let _ = writeln!(text, "{}", line.join(","));
        }
    }
    text
}

/// The shortest decimal number that is read back as this one.
fn written(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-4 { format!("{value:e}") } else { value.to_string() }
}

fn json_line([tx, rx]: [usize; 2], steps: &[Vec<[f64; NUMBERS]>]) -> String {
    // In the order of NIST's files.
    let mut line = format!("{{\"TX\":{tx},\"RX\":{rx},\"PAA_TX\":0,\"PAA_RX\":0");
    for (number, name) in NAMES.iter().enumerate() {
        let lists: Vec<Vec<f64>> = steps.iter().map(|paths| paths.iter().map(|path| path[number]).collect()).collect();
        let _ = write!(line, ",\"{name}\":{}", json!(lists));
    }
    line + "}\n"
}

fn node_line(node: usize, places: &[DVec3]) -> String {
    let rotations = vec![[0, 0, 0]; places.len()];
    let places: Vec<[f64; 3]> = places.iter().map(DVec3::to_array).collect();
    format!("{{\"Node\":{node},\"Position\":{},\"Rotation\":{}}}\n", json!(places), json!(rotations))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::{AntennaArray, Complex, export::Link};

    fn path(delay_s: f64, a: Complex, departure: DVec3, arrival: DVec3) -> Path {
        let zero = Complex { re: 0.0, im: 0.0 };
        Path { interactions: Vec::new(), length_m: 0.0, delay_s, a, transfer: [[zero; 2]; 2], arrival, departure }
    }

    fn set(links: Vec<Vec<Path>>) -> PathSet<'static> {
        let receivers: Vec<DVec3> = (0..links.len()).map(|i| DVec3::new(i as f64, 0.5, 1.0)).collect();
        let links = receivers.iter().zip(links).map(|(rx, paths)| Link { tx: DVec3::ZERO, rx: *rx, paths }).collect();
        let array = AntennaArray::single(Default::default());
        PathSet {
            transmitters: vec![DVec3::ZERO],
            receivers,
            links,
            frequency_hz: 60e9,
            tx_arrays: vec![array],
            rx_array: array,
            object_names: Vec::new(),
            velocities: None,
        }
    }

    fn file<'f>(files: &'f [(String, Vec<u8>)], name: &str) -> &'f str {
        std::str::from_utf8(&files.iter().find(|(n, _)| n == name).unwrap().1).unwrap()
    }

    #[test]
    fn a_step_without_paths_is_a_zero_and_the_earliest_path_comes_first() {
        // 0 dB; phases are a quarter of a turn and three.
        let up = |im: f64| Complex { re: 0.0, im };
        let (early, late) = (path(1e-8, up(1.0), DVec3::X, DVec3::NEG_Y), path(2e-8, up(-1.0), DVec3::Z, DVec3::NEG_X));
        let files = qd_scenario(&set(vec![vec![late, early], vec![]]), 0.25, QdForm::Text).unwrap();
        let (quarter, three) = (0.25 * TAU, 0.75 * TAU);
        let expected = format!("2\n1e-8,2e-8\n0,0\n{quarter},{three}\n90,0\n0,0\n90,90\n270,180\n0\n");
        assert_eq!(file(&files, "Output/Ns3/QdFiles/Tx0Rx1.txt"), expected);
        let expected = format!("2\n1e-8,2e-8\n0,0\n{quarter},{three}\n90,90\n270,180\n90,0\n0,0\n0\n");
        assert_eq!(file(&files, "Output/Ns3/QdFiles/Tx1Rx0.txt"), expected);
        assert!(
            file(&files, "Input/paraCfgCurrent.txt")
                .ends_with("Divisions\t2\ntotalTimeDuration\t0.5\ncarrierFrequency\t60000000000\n")
        );
        assert_eq!(file(&files, "Output/Ns3/NodesPosition/NodesPosition.csv"), "0,0,0\n0,0.5,1\n");
    }

    #[test]
    fn json_has_a_pair_a_line_and_lists_by_step() {
        let one = path(1e-8, Complex { re: 0.1, im: 0.0 }, DVec3::X, DVec3::NEG_X);
        let files = qd_scenario(&set(vec![vec![], vec![one]]), 0.25, QdForm::Json).unwrap();
        let lines: Vec<serde_json::Value> =
            file(&files, "Output/Ns3/QdFiles/qdOutput.json").lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(
            lines.iter().map(|l| [l["TX"].as_u64(), l["RX"].as_u64()]).collect::<Vec<_>>(),
            [[Some(0), Some(1)], [Some(1), Some(0)]]
        );
        assert_eq!((&lines[0]["Delay"], &lines[0]["AOAAZ"]), (&json!([[], [1e-8]]), &json!([[], [180.0]])));
        assert_eq!(file(&files, "Output/Visualizer/NodePositions.json").lines().count(), 2);
    }

    #[test]
    fn angles_stay_under_a_whole_turn() {
        assert_eq!((once_around(-1e-30, 360.0), once_around(-90.0, 360.0), once_around(360.0, 360.0)), (0.0, 270.0, 0.0));
    }

    #[test]
    fn what_ns_3_could_not_count_or_time_is_refused() {
        for interval_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(qd_scenario(&set(vec![vec![]]), interval_s, QdForm::Text).is_err(), "{interval_s}");
        }
        assert!(qd_scenario(&set(vec![vec![]; MOST + 1]), 0.1, QdForm::Text).unwrap_err().to_string().contains("65535"));
    }
}
