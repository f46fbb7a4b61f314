//! `corf reconstruct --view`: a page sees the field while it grows, and the result is the same as if nobody had looked.

use crate::common::*;
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, ChildStderr, Stdio};
use std::time::{Duration, Instant};

/// Files that the reconstruction decides, and no clock.
const RESULT: [&str; 5] = ["coupled.ply", "optical.ply", "rf.ply", "field.json", "config.json"];
/// Pause between two questions of a page.
const POLL: Duration = Duration::from_millis(20);

/// A reconstruction at work that is looked at.
pub struct Growing {
    child: Child,
    /// Standard error stays open, or the command has nobody to tell of its progress.
    said: BufReader<ChildStderr>,
    pub page: Page,
}

impl Growing {
    /// Starts one on the tiny data set that takes some seconds.
    pub fn start(run: &Path, more: &[&str]) -> Self {
        let arguments = ["reconstruct", text(tiny_dataset()), "--out", text(run), "--device", "cpu", "--no-verify", "--view"];
        let mut child = command(&[&arguments[..], more].concat()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut said = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        while !line.starts_with("http://127.0.0.1:") {
            line.clear();
            assert!(said.read_line(&mut line).unwrap() > 0, "it ended without an address");
        }
        let page = Page::of(line.split_whitespace().next().unwrap());
        Self { child, said, page }
    }

    /// What it answers; nothing once it has ended.
    fn ask(&self, target: &str) -> Option<Answer> {
        let answer = self.page.try_ask("GET", target, &self.page.host()).ok()?;
        assert_eq!(answer.status, 200, "{target}: {}", String::from_utf8_lossy(&answer.body));
        Some(answer)
    }

    /// Waits for its end; the exit code.
    pub fn end(mut self) -> Option<i32> {
        let mut rest = String::new();
        while self.said.read_line(&mut rest).unwrap() > 0 {}
        assert!(!rest.contains("panicked"), "{rest}");
        self.child.wait().unwrap().code()
    }
}

/// Bytes that a layout says a Gaussian has.
fn bytes_a_gaussian(layout: &Value) -> usize {
    let texels = |half: &str| layout[half]["texels"].as_u64().unwrap_or(0) as usize;
    48 + 8 * (texels("optical") + texels("rf"))
}

pub fn results(run: &Path) -> Vec<Vec<u8>> {
    RESULT.iter().map(|file| fs::read(run.join(file)).unwrap()).collect()
}

#[test]
fn a_page_sees_the_field_grow_to_its_end_and_changes_no_byte_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let steps = ["--seed", "5", "--set", "iterations_per_keyframe=40"];
    let growing = Growing::start(&at("seen"), &steps);
    let page = String::from_utf8(growing.ask("/").unwrap().body).unwrap();
    assert!(page.contains("connect-src 'self'") && page.contains("id=\"growth\""));
    let scene = growing.ask("/data/scene").unwrap().json();
    assert_eq!((&scene["title"], &scene["growing"]), (&"corf-gs".into(), &serde_json::json!({"optical": true, "rf": true})));
    let roles: Vec<&str> = scene["keyframes"].as_array().unwrap().iter().map(|k| k["role"].as_str().unwrap()).collect();
    assert_eq!(roles.iter().filter(|role| **role == "train").count(), 8);
    let keyframe = growing.ask("/data/keyframe-2").unwrap().json();
    assert!(keyframe["image"]["observed"].as_str().unwrap().len() > 100 && keyframe["image"]["predicted"].is_null());
    assert!(keyframe["note"].as_str().unwrap().contains("once the reconstruction has ended"));

    // As the page does: ask, and bring every new version.
    let (mut versions, mut sizes, mut last) = (Vec::new(), Vec::new(), Value::Null);
    while let Some(reported) = growing.ask("/data/growth").map(|answer| answer.json()) {
        let (done, before) = (reported["done"].as_u64().unwrap(), last["done"].as_u64().unwrap_or(0));
        assert!(done >= before && reported["total"] == 8 && reported["snapshot_done"].as_u64().unwrap() <= done, "{reported}");
        if reported["version"].as_u64().unwrap() > versions.last().copied().unwrap_or(0) {
            let Some(field) = growing.ask("/data/field") else { break };
            let tag = field.header("etag").unwrap().trim_matches('"');
            versions.push(tag.parse().unwrap());
            assert_eq!(field.body.len() % bytes_a_gaussian(&reported["field"]), 0);
            sizes.push(field.body.len());
        }
        last = reported;
        if last["finished"] == true {
            break;
        }
        std::thread::sleep(POLL);
    }
    assert_eq!(growing.end(), Some(0));
    // Some of it while it grew, each version once, and in the end what was written.
    assert!(versions.len() >= 3 && versions.is_sorted_by(|a, b| a < b), "{versions:?}");
    assert!(sizes[0] < sizes[sizes.len() - 1], "it has grown: {sizes:?}");
    assert_eq!((last["finished"].as_bool(), last["done"].as_u64()), (Some(true), Some(8)));
    let info: Value = serde_json::from_slice(&fs::read(at("seen").join("run.json")).unwrap()).unwrap();
    assert_eq!(sizes[sizes.len() - 1] / bytes_a_gaussian(&last["field"]), info["gaussians"].as_u64().unwrap() as usize);
    assert_eq!(info["curve"].as_array().unwrap().len(), 9, "eight keyframes and the end: looking adds nothing");

    let unseen = at("unseen");
    let arguments = ["reconstruct", text(tiny_dataset()), "--out", text(&unseen), "--device", "cpu", "--no-verify"];
    corf_ok(&[&arguments[..], &steps].concat());
    assert!(results(&at("seen")) == results(&unseen), "looking must not change a byte");
}

#[test]
fn a_run_that_nobody_looks_at_waits_for_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let growing = Growing::start(&folder.path().join("run"), &["--set", "iterations_per_keyframe=2"]);
    assert_eq!(growing.end(), Some(0));
    assert!(folder.path().join("run/run.json").exists());
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_the_server_with_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let growing = Growing::start(&run, &["--set", "iterations_per_keyframe=200"]);
    let (page, start) = (growing.page.clone(), Instant::now());
    while growing.ask("/data/growth").unwrap().json()["done"] == 0 {
        assert!(start.elapsed() < PATIENCE);
        std::thread::sleep(POLL);
    }
    let kill = std::process::Command::new("kill").args(["-INT", &growing.child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    assert_eq!(growing.end(), Some(130));
    assert!(page.connect().is_err(), "nobody listens any more");
    assert!(!run.join("run.json").exists());
}

#[test]
fn what_cannot_be_seen_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let with = |more: &[&str], words: &[&str]| {
        corf_refuses(&[&["reconstruct", text(tiny_dataset()), "--out", text(&out)], more].concat(), words);
        assert!(!out.exists(), "{more:?}");
    };
    with(&["--view", &port], &[&port, "another program listens there", "--view"]);
    with(&["--view", "70000"], &["a port is a number", "65535"]);
    with(&["--view", "--method", "nearest"], &["nearest has no Gaussians", "corf view"]);
    with(&["--view", "--method", "nerf2"], &["nerf2 has no Gaussians"]);
    corf_refuses(&["reconstruct", "--follow", text(folder.path()), "--out", text(&out), "--view"], &["--follow", "corf view"]);
    // The word behind it is taken for the port.
    corf_refuses(&["reconstruct", "--view", "data/mini", "--out", text(&out)], &["data/mini", "name it before --view"]);
}
