//! No two public types of the workspace have one name: a name that is met in a signature or a search is of one thing.
//!
//! Arguments of commands are named for their command and stand where nothing else takes from, and `Error` and `Result` are each crate's own, as
//! Rust's libraries have them: these are left out. This reads text, not Rust: a type counts where its line begins with `pub`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Source files below a folder, tests left out.
fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            if !path.ends_with("tests") && !path.ends_with("bench/src/commands") {
                sources(&path, out);
            }
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Name of the public type that a line declares.
fn declared(line: &str) -> Option<&str> {
    let rest = line.strip_prefix("pub ")?;
    let rest = ["struct ", "enum ", "trait ", "type ", "unsafe trait "].iter().find_map(|kind| rest.strip_prefix(kind))?;
    rest.split(|c: char| !c.is_alphanumeric() && c != '_').next()
}

#[test]
fn two_public_types_never_have_one_name() {
    assert_eq!(declared("pub struct Grid<T> {"), Some("Grid"));
    assert_eq!(declared("    pub struct Inner;"), None);
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let mut files = Vec::new();
    for entry in std::fs::read_dir(&crates).unwrap() {
        sources(&entry.unwrap().path().join("src"), &mut files);
    }
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in &files {
        let text = std::fs::read_to_string(file).unwrap();
        for (line, name) in text.lines().enumerate().filter_map(|(i, line)| Some((i + 1, declared(line)?))) {
            places.entry(name.to_owned()).or_default().push(format!("{}:{line}", file.strip_prefix(&crates).unwrap().display()));
        }
    }
    assert!(places.len() > 500, "only {} types were found", places.len());
    places.retain(|name, at| at.len() > 1 && !["Error", "Result"].contains(&name.as_str()));
    assert!(places.is_empty(), "types of one name: {places:#?}");
}
