//! Documents say what is so: marked places are what the program writes, links lead somewhere, files that are named exist, and the two that everybody
//! reads stay short.

use crate::common::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Files of the repository, as far as they are not built or generated, relative to its root.
fn repository() -> BTreeSet<String> {
    fn walk(folder: &Path, out: &mut BTreeSet<String>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if path.is_dir() {
                if !["target", ".git", "data", "out", "corf-demo", "corpus"].contains(&name) {
                    walk(&path, out);
                }
            } else {
                out.insert(path.strip_prefix(root()).unwrap().to_str().unwrap().replace('\\', "/"));
            }
        }
    }
    let mut out = BTreeSet::new();
    walk(&root(), &mut out);
    out
}

/// Documents of today; results are records of their day.
fn documents() -> Vec<PathBuf> {
    let of = |name: &String| name.ends_with(".md") && !name.starts_with("results/") && !name.starts_with('.');
    let all: Vec<PathBuf> = repository().iter().filter(|name| of(name)).map(|name| root().join(name)).collect();
    assert!(all.len() > 15, "{all:?}");
    all
}

#[test]
fn marked_places_are_what_the_program_writes() {
    let documents = documents();
    let mut arguments = vec!["docs", "--check"];
    arguments.extend(documents.iter().map(|path| path.to_str().unwrap()));
    let output = corf(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}\nrun `corf docs` on what is stale", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn what_everybody_reads_is_short() {
    // A reader counts words, and a terminal columns; marks that the program writes tables at are read by nobody.
    let text = std::fs::read_to_string(root().join("README.md")).unwrap();
    let read: Vec<&str> = text.lines().filter(|line| !line.starts_with("<!-- corf docs")).collect();
    let is_word = |word: &&str| word.contains(char::is_alphanumeric);
    let words: usize = read.iter().map(|line| line.split_whitespace().filter(is_word).count()).sum();
    assert!(words <= 1_000, "README.md has {words} words");
    let longest = read.iter().max_by_key(|line| line.chars().count()).unwrap();
    assert!(longest.chars().count() <= 160, "{longest}");
    let lines = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap().lines().count();
    assert!(lines <= 120, "ARCHITECTURE.md has {lines} lines");
}

#[test]
fn links_lead_somewhere() {
    let mut links = 0;
    for document in documents() {
        let text = std::fs::read_to_string(&document).unwrap();
        for part in text.split("](").skip(1) {
            let target = part.split([')', '#', ' ']).next().unwrap();
            if target.is_empty() || target.contains("://") || target.starts_with('`') {
                continue;
            }
            links += 1;
            assert!(document.parent().unwrap().join(target).exists(), "{}: {target}", document.display());
        }
    }
    assert!(links > 50, "{links} links");
}

#[test]
fn files_that_are_named_exist() {
    let files = repository();
    let mut named = 0;
    for document in documents().iter().filter(|d| !d.ends_with("CHANGELOG.md")) {
        let text = std::fs::read_to_string(document).unwrap();
        // What stands between backticks, outside of blocks of code.
        let prose: String = text.split("```").step_by(2).collect();
        for word in prose.split('`').skip(1).step_by(2) {
            let code = ["rs", "wgsl", "py"].iter().any(|ending| word.rsplit_once('.').is_some_and(|(_, e)| e == *ending));
            if !code || word.contains([' ', '*', '{', '<', '…']) || word.chars().any(char::is_uppercase) {
                continue;
            }
            named += 1;
            let word = word.trim_start_matches("./");
            let found = files.iter().any(|file| file == word || file.ends_with(&format!("/{word}")));
            assert!(found, "{}: there is no file {word}", document.display());
        }
    }
    assert!(named > 50, "{named} files");
}

/// Golden files: the tables of published results are what this version makes of their records, byte for byte.
#[test]
fn published_tables_are_rebuilt_from_their_records() {
    let archives: Vec<String> = repository().into_iter().filter(|name| name.ends_with("records.jsonl.gz")).collect();
    assert!(archives.len() >= 3, "{archives:?}");
    for archive in archives {
        let folder = root().join(&archive).parent().unwrap().to_path_buf();
        // A comparison with failed cells says so by its exit code as well.
        let failed = std::fs::read_to_string(folder.join("table.md")).unwrap().contains("(failed cells)");
        for (notation, file) in [("markdown", "table.md"), ("csv", "table.csv"), ("latex", "table.tex")] {
            let kept = std::fs::read_to_string(folder.join(file)).unwrap();
            let output = corf(&["bench", "table", text(&folder), "--format", notation]);
            assert_eq!(output.status.code(), Some(i32::from(failed)), "{archive}");
            let made = String::from_utf8(output.stdout).unwrap();
            assert_eq!(made.trim_end(), kept.trim_end(), "{} is not what {archive} makes", folder.join(file).display());
        }
        if folder.join("paper.md").exists() {
            let made = tempfile::tempdir().unwrap();
            let output = corf(&["bench", "paper", text(&folder), "--out", text(made.path())]);
            assert_eq!(output.status.code(), Some(i32::from(failed)), "{archive}");
            for file in ["paper.md", "paper.tex", "paper.csv", "paper.svg"] {
                let [made, kept] =
                    [made.path(), folder.as_path()].map(|folder| std::fs::read_to_string(folder.join(file)).unwrap());
                assert!(made == kept, "{} is not what {archive} makes", folder.join(file).display());
            }
        }
    }
}

/// Two files tell indexes what this is: both say what the workspace says, and neither says more than the other.
#[test]
fn the_citation_and_codemeta_state_the_same() {
    let cff = std::fs::read_to_string(root().join("CITATION.cff")).unwrap();
    let cargo: toml::Table = std::fs::read_to_string(root().join("Cargo.toml")).unwrap().parse().unwrap();
    let package = &cargo["workspace"]["package"];
    let codemeta: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(root().join("codemeta.json")).unwrap()).unwrap();
    // A key of the file itself begins its line; those of the article that it prefers are indented.
    let cited = |key: &str| cff.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(": ")).map(|v| v.trim_matches('"'));
    let stated = |key: &str| codemeta.get(key).map(|value| value.as_str().unwrap());
    for (of_cff, of_codemeta) in
        [("title", "name"), ("abstract", "description"), ("version", "version"), ("repository-code", "codeRepository")]
    {
        assert_eq!(cited(of_cff), stated(of_codemeta), "{of_cff}");
    }
    assert_eq!(stated("version"), package["version"].as_str());
    assert_eq!(stated("codeRepository"), package.get("repository").and_then(|repository| repository.as_str()));
    let licences: Vec<&str> = cited("license").unwrap().trim_matches(['[', ']']).split(", ").collect();
    assert_eq!(licences.join(" OR "), package["license"].as_str().unwrap());
    let of_codemeta: Vec<&str> = codemeta["license"].as_array().unwrap().iter().map(|url| url.as_str().unwrap()).collect();
    assert_eq!(of_codemeta, licences.iter().map(|id| format!("https://spdx.org/licenses/{id}")).collect::<Vec<_>>());
    let article = cff.lines().find_map(|line| line.strip_prefix("  title: ")).unwrap().trim_matches('"');
    assert_eq!(codemeta["referencePublication"]["name"], article);
}
