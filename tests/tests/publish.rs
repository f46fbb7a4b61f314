//! `corf dataset publish`: the same bytes each time, whole or not at all, with nothing made up.
//! `tools/check_publication.py` has other programs open it.

use crate::common::*;
use corf_scene::dataset::Dataset;
use corf_scene::io::sha256_hex;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

const SAID: [&str; 6] = ["--licence", "CC-BY-4.0", "--author", "Doe, Jane", "--date", "2026-11-29"];

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { found.extend(files(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

/// Names of the files of a folder, in order.
fn names(folder: &Path) -> Vec<PathBuf> {
    files(folder).iter().map(|f| f.strip_prefix(folder).unwrap().to_owned()).collect()
}

#[test]
fn a_publication_has_the_same_bytes_each_time_and_names_the_hashes_of_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    for (out, threads) in [(&one, "1"), (&two, "2")] {
        corf_ok(&[&["--threads", threads, "dataset", "publish", text(tiny_dataset()), "--out", text(out)], &SAID[..]].concat());
    }
    assert_eq!(names(&one), names(&two));
    for name in names(&one) {
        assert_eq!(fs::read(one.join(&name)).unwrap(), fs::read(two.join(&name)).unwrap(), "{}", name.display());
    }
    let croissant: Value = serde_json::from_slice(&fs::read(one.join("croissant.json")).unwrap()).unwrap();
    let objects: Vec<&Value> =
        croissant["distribution"].as_array().unwrap().iter().filter(|f| f["@type"] == "cr:FileObject").collect();
    for object in &objects {
        let bytes = fs::read(one.join(object["contentUrl"].as_str().unwrap())).unwrap();
        assert_eq!(
            (&object["sha256"], &object["contentSize"]),
            (&sha256_hex(&bytes).into(), &format!("{} B", bytes.len()).into())
        );
    }
    let shards: Vec<&str> =
        objects.iter().filter_map(|o| o["contentUrl"].as_str()).filter(|path| path.ends_with(".parquet")).collect();
    assert_eq!(shards, ["data/train-00000-of-00001.parquet", "data/test-00000-of-00001.parquet"]);
    for shard in shards {
        let bytes = fs::read(one.join(shard)).unwrap();
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"), "{shard}");
    }
    // The data set itself is in it, and corf opens it as the one that it is.
    corf_ok(&["dataset", "validate", text(&one.join("dataset"))]);
    assert_eq!(Dataset::open(one.join("dataset")).unwrap().hash(), Dataset::open(tiny_dataset()).unwrap().hash());
    // What is there is left alone.
    corf_refuses(&[&["dataset", "publish", text(tiny_dataset()), "--out", text(&one)], &SAID[..]].concat(), &["not empty"]);
}

#[test]
fn the_published_set_is_what_this_version_publishes_and_what_its_table_is_of() {
    let published = root().join("published/lobby-mini");
    corf_ok(&["dataset", "validate", text(&published.join("dataset"))]);
    let folder = tempfile::tempdir().unwrap();
    let again = folder.path().join("again");
    let said = ["--licence", "cc0-1.0", "--author", "The authors of corf", "--date", "2026-11-29"];
    corf_ok(&[&["dataset", "publish", text(&published.join("dataset")), "--out", text(&again)], &said[..]].concat());
    assert_eq!(names(&published), names(&again));
    for name in names(&published) {
        assert_eq!(fs::read(published.join(&name)).unwrap(), fs::read(again.join(&name)).unwrap(), "{}", name.display());
    }
    let hash = Dataset::open(published.join("dataset")).unwrap().hash().to_owned();
    assert!(corf_ok(&["bench", "table", "results/2026-11-29-lobby-mini", "--json"]).contains(&hash));
}

#[test]
fn what_only_its_maker_knows_has_to_be_said() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (folder.path().join("capture"), folder.path().join("out"));
    corf_ok(&["dataset", "import", text(&tiny_dataset().join("optical")), "--from", "colmap", "--out", text(&capture)]);
    let publish = |of: &Path, more: &[&str], words: &[&str]| {
        corf_refuses(&[&["dataset", "publish", text(of), "--out", text(&out)], more].concat(), words);
        assert!(!out.exists());
    };
    publish(tiny_dataset(), &[], &["--licence", "--author"]);
    publish(tiny_dataset(), &["--licence", "mit", "--author", "x"], &["cc-by-4.0"]);
    publish(tiny_dataset(), &[&SAID[..], &["--no-verify"]].concat(), &["--no-verify", "hashes"]);
    publish(&capture, &SAID, &["imported", "--collection, --sensitive, --synthetic"]);
    let words = ["--collection", "A walk with a camera.", "--sensitive", "None.", "--synthetic", "false"];
    let call = ["dataset", "publish", text(&capture), "--out", text(&out)];
    corf_ok(&[&call[..], &SAID, &words].concat());
    let croissant: Value = serde_json::from_slice(&fs::read(out.join("croissant.json")).unwrap()).unwrap();
    assert_eq!(
        (&croissant["rai:dataCollection"], &croissant["rai:hasSyntheticData"]),
        (&"A walk with a camera.".into(), &false.into())
    );
    // Neither spectra nor answers are made up.
    assert!(
        croissant.get("rai:dataLimitations").is_none()
            && !fs::read_to_string(out.join("croissant.json")).unwrap().contains("spectrum")
    );
    let card = fs::read_to_string(out.join("README.md")).unwrap();
    assert!(card.contains("**Limits.** Not stated.") && card.contains("![Images](contact-sheet.png)"), "{card}");
    assert!(!["pectr", "room", "GHz", "radio", "OpenEXR"].iter().any(|word| card.contains(word)), "{card}");
    // Spectra alone.
    let (radio, of_radio) = (folder.path().join("radio"), folder.path().join("of radio"));
    let (images, spectra) = (tiny_dataset().join("optical"), tiny_dataset().join("rf/spectra"));
    let import =
        ["dataset", "import", text(&images), "--from", "colmap", "--no-images", "--rf", text(&spectra), "--rf-camera", "90"];
    corf_ok(&[&import[..], &["--out", text(&radio)]].concat());
    corf_ok(&[&["dataset", "publish", text(&radio), "--out", text(&of_radio)], &SAID[..], &words].concat());
    let card = fs::read_to_string(of_radio.join("README.md")).unwrap();
    assert!(card.contains("![Spectra](contact-sheet.png)") && card.contains("keyframes[0][\"spectrum\"]"), "{card}");
    assert!(!["[\"image\"]", "image-to-3d", "room", "depth"].iter().any(|word| card.contains(word)), "{card}");
    // A file that is another than the recorded one is not published.
    let damaged = folder.path().join("damaged");
    copy_folder(tiny_dataset(), &damaged);
    fs::write(damaged.join("optical/depth/00001.exr"), b"no").unwrap();
    let out = folder.path().join("of damaged");
    corf_refuses(&[&["dataset", "publish", text(&damaged), "--out", text(&out)], &SAID[..]].concat(), &["00001.exr"]);
    assert!(!out.exists());
}
