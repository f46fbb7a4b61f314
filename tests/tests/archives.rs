//! `corf bench publish` and `corf bench collect` of its archive.

use crate::common::*;
use corf_scene::io::sha256_hex;
use std::fs;
use std::path::{Path, PathBuf};

/// A finished comparison of two lookups, with the contiguous segment.
fn comparison(folder: &Path) -> PathBuf {
    let (plan, out) = (folder.join("plan.toml"), folder.join("comparison"));
    let body = format!(
        "name = \"Two lookups\"\ndataset = '{}'\nseeds = [1]\nsegment = true\n[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n[[row]]\n\
         label = \"again\"\nmethod = \"nearest\"\n",
        text(tiny_dataset())
    );
    fs::write(&plan, body).unwrap();
    corf_ok(&["bench", "run", text(&plan), "--out", text(&out), "--device", "cpu"]);
    out
}

/// Puts other bytes of the same length into a file of an archive, and its SHA-256 into the list.
fn forged(archive: &[u8], file: &[u8], change: (&str, &str)) -> Vec<u8> {
    assert_eq!(change.0.len(), change.1.len());
    let other = String::from_utf8(file.to_vec()).unwrap().replacen(change.0, change.1, 1).into_bytes();
    let mut forged = archive.to_vec();
    for (from, to) in [(file, other.as_slice()), (sha256_hex(file).as_bytes(), sha256_hex(&other).as_bytes())] {
        let at = forged.windows(from.len()).position(|window| window == from).unwrap();
        forged[at..at + to.len()].copy_from_slice(to);
    }
    forged
}

#[test]
fn an_archive_gives_tables_and_report_again_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let comparison = comparison(folder.path());
    let path = |name: &str| folder.path().join(name);
    let (one, two, again) = (path("one.tar"), path("two.tar"), path("again"));
    for archive in [&one, &two] {
        corf_ok(&["bench", "publish", text(&comparison), "--out", text(archive)]);
    }
    let bytes = fs::read(&one).unwrap();
    assert!(bytes == fs::read(&two).unwrap(), "the same comparison gives the same bytes");
    assert!(!bytes.windows(text(tiny_dataset()).len()).any(|w| w == text(tiny_dataset()).as_bytes()), "where the data set lay");
    corf_refuses(&["bench", "publish", text(&comparison), "--out", text(&one)], &["there already"]);
    let collect = |archive: &Path, dataset: &Path, out: &Path| {
        corf(&["bench", "collect", text(archive), "--dataset", text(dataset), "--out", text(out)])
    };
    assert_eq!(collect(&one, tiny_dataset(), &again).status.code(), Some(0));
    for name in ["table.md", "table.csv", "table.tex", "report.html", "segment/table.md", "segment/report.html"] {
        assert_eq!(fs::read(comparison.join(name)).unwrap(), fs::read(again.join(name)).unwrap(), "{name}");
    }
    // It is a comparison as any.
    corf_ok(&["bench", "report", text(&again)]);
    // A table that is not the records' is noticed, though its hash is the listed one.
    let table = fs::read(comparison.join("table.md")).unwrap();
    fs::write(&one, forged(&bytes, &table, ("| nearest |", "| NEAREST |"))).unwrap();
    let out = path("differs");
    let told = collect(&one, tiny_dataset(), &out);
    assert_eq!(told.status.code(), Some(1));
    let told = String::from_utf8(told.stdout).unwrap();
    assert!(told.contains("table.md differ") && !told.contains("segment"), "{told}");
    assert_eq!(fs::read(out.join("table.md")).unwrap(), table, "what is written are the records' tables");
}

#[test]
fn what_is_not_whole_or_of_other_data_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let comparison = comparison(folder.path());
    let path = |name: &str| folder.path().join(name);
    let (archive, out) = (path("one.tar"), path("out"));
    corf_ok(&["bench", "publish", text(&comparison), "--out", text(&archive)]);
    let bytes = fs::read(&archive).unwrap();
    let refused = |changed: &[u8], dataset: &Path, words: &[&str]| {
        fs::write(&archive, changed).unwrap();
        corf_refuses(&["bench", "collect", text(&archive), "--dataset", text(dataset), "--out", text(&out)], words);
        assert!(!out.exists());
    };
    let at = bytes.windows(14).position(|window| window == b"\"dataset_hash\"").unwrap();
    let mut other = bytes.clone();
    other[at + 1] = b'D';
    refused(&other, tiny_dataset(), &["is another than SHA256SUMS says"]);
    refused(&bytes[..bytes.len() / 2], tiny_dataset(), &["help: it is damaged"]);
    let another = path("another");
    corf_ok(&["dataset", "import", text(&tiny_dataset().join("optical")), "--from", "colmap", "--out", text(&another)]);
    refused(&bytes, &another, &["the records are of", "give the data set that they were made with"]);
    corf_refuses(&["bench", "collect", text(&archive)], &["--dataset FOLDER", "--out FOLDER"]);
    corf_refuses(&["bench", "publish", text(&comparison), "--out", text(&path("a.zip"))], &[".tar"]);
    // Tables that are not the records', and a cell without a record.
    let table = comparison.join("segment/table.csv");
    let whole = fs::read(&table).unwrap();
    fs::write(&table, "changed").unwrap();
    let two = path("two.tar");
    let call = ["bench", "publish", text(&comparison), "--out", text(&two)];
    corf_refuses(&call, &["segment/table.csv", "corf bench report"]);
    fs::write(&table, whole).unwrap();
    fs::remove_file(comparison.join("cells/again-seed1.json")).unwrap();
    corf_refuses(&call, &["again-seed1.json is missing"]);
    assert!(!two.exists());
}
