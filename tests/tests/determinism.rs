//! The same seed gives the same bytes, whatever the number of threads; another seed does not.

use crate::common::*;
use std::fs;
use std::path::Path;

fn field(dataset: &Path, folder: &Path, name: &str, extra: &[&str]) -> Vec<u8> {
    let out = folder.join(name);
    let mut arguments = vec!["reconstruct", text(dataset), "--out", text(&out), "--set", "iterations_per_keyframe=12"];
    arguments.extend(extra);
    corf_ok(&arguments);
    fs::read(out.join("coupled.ply")).unwrap()
}

#[test]
fn a_reconstruction_depends_on_its_seed_and_on_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = tiny_dataset();
    let one = field(dataset, folder.path(), "one", &["--seed", "5", "--threads", "1"]);
    let two = field(dataset, folder.path(), "two", &["--seed", "5", "--threads", "2"]);
    let other = field(dataset, folder.path(), "other", &["--seed", "6", "--threads", "2"]);
    assert!(one == two, "1 and 2 threads differ");
    assert!(one != other, "two seeds agree");
}

#[test]
fn a_dataset_is_the_same_whatever_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let config = tiny_cached_config(folder.path(), 3);
    let hash = |name: &str, threads: &str| {
        let out = folder.path().join(name);
        corf_ok(&["dataset", "generate", text(&config), "--out", text(&out), "--threads", threads]);
        fs::read(out.join("dataset.json")).unwrap()
    };
    assert!(hash("a", "1") == hash("b", "2"));
}
