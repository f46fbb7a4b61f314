//! A comparison's cells run apart: listed, run one by one or several at once, ended in the middle and run again, collected.

use crate::common::*;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

fn read(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// A plan of a lookup and a short reconstruction with two seeds, and the contiguous segment.
fn plan(folder: &Path, iterations: usize) -> PathBuf {
    let path = folder.join("plan.toml");
    let body = format!(
        "name = \"apart\"\ndataset = '{}'\nseeds = [1, 2]\nsegment = true\n[[row]]\nlabel = \"CORF-GS\"\nmethod = \"corf-gs\"\n\
         [row.config]\niterations_per_keyframe = {iterations}\n[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n",
        text(tiny_dataset())
    );
    fs::write(&path, body).unwrap();
    path
}

/// Ids of a folder's cells with the paths of their records.
fn cells(out: &Path) -> Vec<(String, PathBuf)> {
    let list = read(&out.join("cells.json"));
    let record = |cell: &Value| {
        let (row, seed) = (cell["row"].as_str().unwrap().to_lowercase(), cell["seed"].as_u64().unwrap());
        let part = if cell["split"] == "segment" { out.join("segment") } else { out.to_owned() };
        (cell["id"].as_str().unwrap().to_owned(), part.join(format!("cells/{row}-seed{seed}.json")))
    };
    list["cells"].as_array().unwrap().iter().map(record).collect()
}

/// What a record says of quality: its frames, without the time that rendering took.
fn frames(record: &Path) -> String {
    let mut frames = read(record)["frames"].clone();
    for frame in frames.as_array_mut().unwrap() {
        frame.as_object_mut().unwrap().remove("render_s");
    }
    frames.to_string()
}

#[test]
fn cells_run_apart_are_those_of_a_whole_run() {
    let folder = tempfile::tempdir().unwrap();
    let plan = plan(folder.path(), 5);
    let (whole, apart) = (folder.path().join("whole"), folder.path().join("it's apart"));
    corf_ok(&["bench", "run", text(&plan), "--out", text(&whole), "--device", "cpu"]);
    corf_ok(&["bench", "plan", text(&plan), "--out", text(&apart)]);
    let listed = cells(&apart);
    assert_eq!(listed.len(), 8, "two rows, two seeds, two protocols");
    let cell = ["bench", "cell", text(&apart), &listed[0].0, "--device", "cpu"];
    corf_ok(&cell);
    let record = fs::read(&listed[0].1).unwrap();
    assert!(corf_ok(&cell).contains("already there"));
    assert_eq!(record, fs::read(&listed[0].1).unwrap(), "a finished cell is not run again");
    // What has not run is a failed cell of the table, and the exit code says so.
    let collect = corf(&["bench", "collect", text(&apart)]);
    assert_eq!(collect.status.code(), Some(1));
    assert!(fs::read_to_string(apart.join("table.md")).unwrap().contains("has not run"));
    corf_ok(&["bench", "submit", text(&apart), "--local", "2", "--device", "cpu"]);
    for ((_, one), (id, other)) in cells_of(&whole, &listed, &apart).iter().zip(&listed) {
        assert_eq!(frames(one), frames(other), "{}", other.display());
        assert_eq!(read(other)["cell"].as_str(), Some(id.as_str()));
    }
    assert!(!apart.join("work").join(&listed[0].0).exists(), "nothing is left of a finished cell's work");
    assert!(apart.join("segment/table.md").exists() && apart.join("report.html").exists());
}

/// The records of another folder that stand where `listed` do in `out`.
fn cells_of(other: &Path, listed: &[(String, PathBuf)], out: &Path) -> Vec<(String, PathBuf)> {
    listed.iter().map(|(id, path)| (id.clone(), other.join(path.strip_prefix(out).unwrap()))).collect()
}

#[test]
fn an_id_stands_for_all_that_a_cell_depends_on() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let list = |iterations: usize, extra: &[&str]| {
        let path = plan(folder.path(), iterations);
        corf_ok(&[&["bench", "plan", text(&path), "--out", text(&out)][..], extra].concat());
        cells(&out)
    };
    let first = list(5, &[]);
    corf_refuses(&["bench", "plan", text(&folder.path().join("plan.toml")), "--out", text(&out)], &["--resume"]);
    corf_ok(&["bench", "cell", text(&out), &first[1].0, "--device", "cpu"]);
    let again = list(5, &["--resume"]);
    assert_eq!(first, again);
    let other = list(6, &["--resume"]);
    assert!(first[0].0 != other[0].0 && first[1].0 == other[1].0, "the lookup has no iterations");
    assert!(corf_ok(&["bench", "cell", text(&out), &other[1].0, "--device", "cpu"]).contains("already there"));
    corf_refuses(&["bench", "cell", text(&out), &first[0].0, "--device", "cpu"], &["no cell", "bench plan"]);
    corf_refuses(&["bench", "cell", text(folder.path()), "0", "--device", "cpu"], &["no list of cells"]);
    corf_refuses(&["bench", "submit", text(&out), "--slurm", "--sbatch=partition=x"], &["--partition=gpu"]);
    // The plan was changed behind the list's back.
    let path = out.join("plan.toml");
    fs::write(&path, fs::read_to_string(&path).unwrap().replace("iterations_per_keyframe = 6", "iterations_per_keyframe = 7"))
        .unwrap();
    corf_refuses(&["bench", "cell", text(&out), &other[0].0, "--device", "cpu"], &["another than when the list was written"]);
}

#[cfg(unix)]
#[test]
fn a_cell_that_was_killed_runs_again_to_the_same_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = plan(folder.path(), 40);
    let (killed, whole) = (folder.path().join("killed"), folder.path().join("whole"));
    for out in [&killed, &whole] {
        corf_ok(&["bench", "plan", text(&path), "--out", text(out)]);
    }
    let (id, record) = cells(&killed).remove(0);
    let arguments = ["bench", "cell", text(&killed), &id, "--device", "cpu"];
    // Once without a warning, once with one, behind which its state is kept.
    for signal in ["-KILL", "-TERM"] {
        let mut child = start(&arguments);
        std::thread::sleep(std::time::Duration::from_millis(700));
        std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        child.wait().unwrap();
    }
    corf_ok(&arguments);
    corf_ok(&["bench", "cell", text(&whole), &cells(&whole)[0].0, "--device", "cpu"]);
    assert_eq!(frames(&record), frames(&cells(&whole)[0].1));
}

#[test]
fn a_plan_says_how_long_it_takes_and_a_time_limit_leaves_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("plan.toml"), folder.path().join("out"));
    let write = |iterations: usize, seconds: &str| {
        let body = format!(
            "name = \"limited\"\nmachine = \"two cores\"\ndataset = '{}'\nseeds = [1, 2]\n[[row]]\nlabel = \"CORF-GS\"\nmethod = \"corf-gs\"\n{seconds}\n\
             [row.config]\niterations_per_keyframe = {iterations}\n[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n",
            text(tiny_dataset())
        );
        fs::write(&path, body).unwrap();
    };
    write(5, "seconds = 0");
    let refused = corf(&["bench", "plan", text(&path), "--out", text(&out)]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        String::from_utf8_lossy(&refused.stderr).contains("no time that a cell takes"),
        "{}",
        String::from_utf8_lossy(&refused.stderr)
    );
    write(100_000, "seconds = 90.5");
    let said = corf_ok(&["bench", "plan", text(&path), "--out", text(&out)]);
    assert!(
        said.contains("4 cells, 4 to run; 3 min one after another on two cores and what 2 cells without `seconds` take"),
        "{said}"
    );
    let submit = ["bench", "submit", text(&out), "--local", "1", "--device", "cpu", "--stop-after-s", "2"];
    let stopped = corf(&submit);
    assert_eq!(stopped.status.code(), Some(1), "{}", String::from_utf8_lossy(&stopped.stderr));
    assert!(
        String::from_utf8_lossy(&stopped.stdout).contains("of 4 cells left: the same command goes on"),
        "{}",
        String::from_utf8_lossy(&stopped.stdout)
    );
    assert!(!out.join("table.md").exists(), "what is not finished is no table yet");
    // With what can be done in the time, nothing is left, and there is a table.
    write(5, "seconds = 90.5");
    corf_ok(&["bench", "plan", text(&path), "--out", text(&out), "--resume"]);
    let last = submit.len() - 1;
    corf_ok(&[&submit[..last], &["500"]].concat());
    assert!(out.join("table.md").exists());
}
