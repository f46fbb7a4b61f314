//! A data set played into a live folder while another process reconstructs from it: the same field as ever, whatever the pauses, and every
//! keyframe accounted for.

use crate::common::*;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Steps a keyframe in these tests.
const FEW: &str = "iterations_per_keyframe=5";

/// Follows a folder while `feed` fills it; returns standard error of the follower, which must end with `code`.
fn follow(folder: &Path, run: &Path, more: &[&str], code: i32, feed: impl FnOnce()) -> String {
    let arguments = ["reconstruct", "--follow", text(folder), "--out", text(run), "--set", FEW, "--device", "cpu"];
    let child = command(&[&arguments[..], more].concat()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    feed();
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    stderr
}

fn play(to: &Path, more: &[&str]) {
    corf_ok(&[&["dataset", "play", text(tiny_dataset()), "--to", text(to)][..], more].concat());
}

/// The lines of `live.jsonl` about one event.
fn events(run: &Path, event: &str) -> Vec<serde_json::Value> {
    let text = fs::read_to_string(run.join("live.jsonl")).unwrap();
    let lines = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    lines.filter(|line| line["event"] == event).collect()
}

fn record(run: &Path) -> serde_json::Value {
    serde_json::from_slice::<serde_json::Value>(&fs::read(run.join("run.json")).unwrap()).unwrap()["live"].clone()
}

fn field(run: &Path) -> Vec<u8> {
    fs::read(run.join("coupled.ply")).unwrap()
}

/// Rewrites a played folder by hand, pose by pose, as an unruly bridge would.
struct Bridge {
    from: PathBuf,
    to: PathBuf,
}

impl Bridge {
    /// Plays the data set aside and opens an empty live folder with its description.
    fn open(scratch: &Path) -> Self {
        let bridge = Self { from: scratch.join("played"), to: scratch.join("live") };
        play(&bridge.from, &["--rate", "10000"]);
        for folder in ["images", "spectra", "poses"] {
            fs::create_dir_all(bridge.to.join(folder)).unwrap();
        }
        fs::copy(bridge.from.join("capture.toml"), bridge.to.join("capture.toml")).unwrap();
        bridge
    }

    fn copy(&self, name: &str, as_name: &str) {
        let temporary = self.to.join(format!("{as_name}.part"));
        fs::copy(self.from.join(name), &temporary).unwrap();
        fs::rename(temporary, self.to.join(as_name)).unwrap();
    }

    fn images(&self, stem: &str, as_stem: &str) {
        self.copy(&format!("images/{stem}.png"), &format!("images/{as_stem}.png"));
        self.copy(&format!("spectra/{stem}.exr"), &format!("spectra/{as_stem}.exr"));
    }

    fn keyframe(&self, stem: &str, as_stem: &str) {
        self.images(stem, as_stem);
        self.copy(&format!("poses/{stem}.json"), &format!("poses/{as_stem}.json"));
    }

    fn end(&self) {
        fs::write(self.to.join("end"), "").unwrap();
    }
}

#[test]
fn pauses_do_not_matter_and_the_run_is_one_like_any_other() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // Slowly, with the follower there first; and all at once, before it.
    follow(&at("slow"), &at("slow-run"), &["--seed", "3"], 0, || play(&at("slow"), &["--rate", "25"]));
    play(&at("fast"), &["--rate", "10000"]);
    let stderr = follow(&at("fast"), &at("fast-run"), &["--seed", "3"], 0, || {});
    assert!(field(&at("slow-run")) == field(&at("fast-run")), "when keyframes came must not matter");
    assert!(stderr.contains("FELL BEHIND") || stderr.contains("BEHIND"), "{stderr}");

    let live = record(&at("fast-run"));
    assert_eq!(
        (live["arrived"].as_u64(), live["trained"].as_u64(), live["ended_by"].as_str()),
        (Some(10), Some(10), Some("marker"))
    );
    assert_eq!((live["depth"]["matching"].as_u64(), live["dropped"].as_array().map(Vec::len)), (Some(10), Some(0)));
    assert!(live["longest_queue"].as_u64().unwrap() >= 9, "{live}");
    let trained = events(&at("slow-run"), "trained");
    assert_eq!(trained.len(), 10);
    // Four squares of a legend, and a bar of at most four parts a keyframe, of which training is never nothing.
    let drawn = fs::read_to_string(at("slow-run").join("latency.svg")).unwrap();
    assert!((15..=45).contains(&drawn.matches("<rect").count()) && drawn.contains("of slow<"), "{drawn}");
    for (line, index) in trained.iter().zip(0..) {
        assert_eq!((line["index"].as_u64(), line["number"].as_u64()), (Some(index), Some(index + 1)));
        let [arrived, began, done, latency] = ["arrived_s", "began_s", "done_s", "latency_ms"].map(|k| line[k].as_f64().unwrap());
        assert!(arrived <= began && began < done && (1e3 * (done - arrived) - latency).abs() < 1e-6, "{line}");
        let [others, matching, on_gpu] =
            ["waited_for_others_ms", "match_ms", "match_device_ms"].map(|k| line[k].as_f64().unwrap());
        assert!((0.0..=1e3 * (began - arrived) + 1e-6).contains(&others) && matching > 0.0 && on_gpu == 0.0, "{line}");
    }
    // All at once: they wait for one another.
    let median = |part: &str| live[part]["median_s"].as_f64().unwrap();
    assert!(median("waited_for_others") > median("waited_for_preparation"), "{live}");

    // The keyframes are a data set now, from which an ordinary reconstruction makes the same field.
    let dataset = at("slow-run").join("dataset");
    assert!(corf_ok(&["dataset", "validate", text(&dataset)]).contains("passed"));
    let alone = at("offline");
    let offline = ["reconstruct", text(&dataset), "--out", text(&alone), "--protocol", "all", "--seed", "3", "--device", "cpu"];
    corf_ok(&[&offline[..], &["--set", FEW, "--set", "depth.prior=none"]].concat());
    assert!(field(&at("offline")) == field(&at("slow-run")), "nothing is known in advance, so nothing may differ");
    corf_ok(&["render", text(&at("slow-run")), "--poses", text(&dataset.join("trajectory.json")), "--out", text(&at("views"))]);
    assert!(at("views").join("jet/00010.png").exists());
    corf_refuses(&["evaluate", text(&at("slow-run"))], &["all keyframes train", "--protocol test"]);
}

#[test]
fn some_are_held_out_and_evaluated_where_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let (live, run) = (folder.path().join("live"), folder.path().join("run"));
    play(&live, &["--rate", "10000", "--depth"]);
    follow(&live, &run, &["--protocol", "test"], 0, || {});
    let held: Vec<u64> = events(&run, "held-out").iter().filter_map(|line| line["index"].as_u64()).collect();
    assert_eq!(held, [0, 8]);
    let live = record(&run);
    assert_eq!(
        (live["trained"].as_u64(), live["held_out"].as_u64(), live["depth"]["files"].as_u64()),
        (Some(8), Some(2), Some(8))
    );
    let metrics: serde_json::Value = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--json"])).unwrap();
    assert_eq!(metrics["frames"].as_array().unwrap().len(), 2);
    assert!(metrics["uses_ground_truth_depth"].as_bool().unwrap(), "depth that came with the keyframes must be owned up to");
}

#[test]
fn what_cannot_be_used_is_refused_with_its_reason_and_the_run_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let bridge = Bridge::open(folder.path());
    let run = folder.path().join("run");
    let taken = |count: usize| {
        // What follows must come after it: only then is its order known.
        let begin = Instant::now();
        let refused_or_kept = || fs::read_to_string(run.join("live.jsonl")).map_or(0, |t| t.lines().count());
        while refused_or_kept() < count {
            assert!(begin.elapsed() < Duration::from_secs(60), "{:?}", fs::read_to_string(run.join("live.jsonl")));
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    let stderr = follow(&bridge.to, &run, &[], 0, || {
        for stem in ["00001", "00002", "00003"] {
            bridge.keyframe(stem, stem);
        }
        taken(4);
        // Again, too late, without its image, cut short, of another size, not finite, no number.
        bridge.copy("poses/00002.json", "poses/2.json");
        bridge.keyframe("00001", "0");
        bridge.copy("poses/00004.json", "poses/00004.json");
        taken(7);
        bridge.images("00004", "00005");
        fs::write(bridge.to.join("poses/00005.json"), "{\"world_from_camera\": [[1, 0").unwrap();
        bridge.images("00005", "00006");
        let bytes = fs::read(bridge.to.join("images/00006.png")).unwrap();
        fs::write(bridge.to.join("images/00006.png"), &bytes[..bytes.len() / 2]).unwrap();
        bridge.copy("poses/00005.json", "poses/00006.json");
        bridge.copy("poses/00005.json", "poses/seven.json");
        taken(10);
        // A keyframe that was refused may come again, whole.
        bridge.images("00004", "00004");
        bridge.copy("poses/00004.json", "poses/00008.json.part");
        fs::rename(bridge.to.join("poses/00008.json.part"), bridge.to.join("poses/00004.json")).unwrap();
        taken(11);
        bridge.keyframe("00009", "00009");
        bridge.end();
    });
    let refused = events(&run, "refused");
    let reason = |file: &str| -> &str {
        let line = refused.iter().find(|line| line["file"] == format!("poses/{file}.json"));
        line.and_then(|line| line["reason"].as_str()).unwrap_or_else(|| panic!("{file} was not refused:\n{stderr}"))
    };
    for (file, word) in [
        ("2", "duplicate"),
        ("0", "out of order"),
        ("00004", "lands last"),
        ("00005", "is no pose"),
        ("00006", "00006.png"),
        ("seven", "no number"),
    ] {
        assert!(reason(file).contains(word), "{file}: {}", reason(file));
    }
    assert_eq!(refused.len(), 6, "{stderr}");
    let numbers: Vec<u64> = events(&run, "trained").iter().filter_map(|line| line["number"].as_u64()).collect();
    assert_eq!(numbers, [1, 2, 3, 4, 9]);
    let live = record(&run);
    assert_eq!((live["arrived"].as_u64(), live["refused"].as_array().map(Vec::len)), (Some(10), Some(6)), "{live}");
    assert!(stderr.contains("REFUSED poses/seven.json"), "{stderr}");
}

#[test]
fn a_strict_run_ends_at_the_first_that_cannot_be_used() {
    let folder = tempfile::tempdir().unwrap();
    let bridge = Bridge::open(folder.path());
    let run = folder.path().join("run");
    let stderr = follow(&bridge.to, &run, &["--strict"], 2, || {
        bridge.keyframe("00001", "00001");
        bridge.copy("poses/00002.json", "poses/00002.json");
    });
    assert!(stderr.contains("images/00002.png") && stderr.contains("--strict"), "{stderr}");
    assert!(!run.join("run.json").exists(), "what did not end well must not look finished");
}

#[test]
fn keyframes_that_come_too_fast_are_dropped_by_name_where_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let (live, run) = (folder.path().join("live"), folder.path().join("run"));
    // Steps enough that a keyframe takes longer than the next one needs to come.
    let slow = ["--when-behind", "drop", "--set", "iterations_per_keyframe=60"];
    let stderr = follow(&live, &run, &slow, 0, || play(&live, &["--rate", "40"]));
    let record = record(&run);
    let dropped: Vec<u64> = record["dropped"].as_array().unwrap().iter().filter_map(serde_json::Value::as_u64).collect();
    let trained: Vec<u64> = events(&run, "trained").iter().filter_map(|line| line["number"].as_u64()).collect();
    assert!(!dropped.is_empty() && stderr.contains(&format!("DROPPED keyframe {}", dropped[0])), "{stderr}");
    let mut all = [dropped.clone(), trained.clone()].concat();
    all.sort_unstable();
    assert_eq!(all, (1..=10).collect::<Vec<u64>>(), "every keyframe is accounted for");
    assert_eq!(
        (trained[..3].to_vec(), *trained.last().unwrap()),
        (vec![1, 2, 3], 10),
        "the first are collected, the last is taken"
    );
    assert_eq!(record["fell_behind"], true);
    let indices: Vec<u64> = events(&run, "trained").iter().filter_map(|line| line["index"].as_u64()).collect();
    assert_eq!(indices, (0..trained.len() as u64).collect::<Vec<u64>>());
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_with_a_finished_field() {
    let folder = tempfile::tempdir().unwrap();
    let bridge = Bridge::open(folder.path());
    let run = folder.path().join("run");
    let arguments = ["reconstruct", "--follow", text(&bridge.to), "--out", text(&run), "--set", FEW, "--device", "cpu"];
    let mut child = start(&arguments);
    for stem in ["00001", "00002", "00003", "00004"] {
        bridge.keyframe(stem, stem);
    }
    let begin = Instant::now();
    while fs::read_to_string(run.join("live.jsonl")).map_or(0, |t| t.lines().count()) < 2 {
        assert!(begin.elapsed() < Duration::from_secs(60) && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let live = record(&run);
    assert_eq!((live["ended_by"].as_str(), live["trained"].as_u64()), (Some("interrupt"), Some(4)));
    assert!(corf_ok(&["dataset", "validate", text(&run.join("dataset"))]).contains("passed"));
}

#[test]
fn what_no_live_run_can_do_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (live, run) = (folder.path().join("live"), folder.path().join("run"));
    play(&live, &["--rate", "10000"]);
    let refuses = |more: &[&str], words: &[&str]| {
        let arguments = ["reconstruct", "--follow", text(&live), "--out", text(&run)];
        corf_refuses(&[&arguments[..], more].concat(), words);
        assert!(!run.join("run.json").exists());
        let _ = fs::remove_dir_all(&run);
    };
    refuses(&["--method", "rf-3dgs"], &["trains on all keyframes at once"]);
    refuses(&["--protocol", "segment"], &["not known"]);
    refuses(&["--set", "depth.prior=\"simulated\""], &["announces none"]);
    refuses(&["--set", "overlapped_iterations=3"], &["nobody knows"]);
    refuses(&["--set", "rf_wieght=3"], &["rf_wieght"]);
    refuses(&["--resume"], &["--resume"]);
    corf_refuses(&["dataset", "play", text(tiny_dataset()), "--to", text(&live)], &["not empty"]);
    fs::write(live.join("capture.toml"), "schema = \"corf-live/9\"\n").unwrap();
    refuses(&[], &["corf-live/9"]);
}
