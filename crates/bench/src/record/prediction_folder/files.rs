//! The files of one sub-folder, by keyframe.

use super::Names;
use crate::split::Split;
use anyhow::{Context, Result, bail, ensure};
use corf_scene::contained::check_regular;
use corf_scene::io::{self, sha256_hex};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Files of the held-out keyframes, by index.
#[derive(Clone, Debug)]
pub(super) struct Files {
    folder: PathBuf,
    by_index: BTreeMap<usize, PathBuf>,
}

impl Files {
    /// The files of `dir/name` with one of these endings; `None` where there is no such folder.
    pub(super) fn list(
        dir: &Path,
        name: &str,
        endings: &[&str],
        names: Names,
        keyframes: usize,
        split: &Split,
    ) -> Result<Option<Self>> {
        let folder = dir.join(name);
        if !folder.is_dir() {
            return Ok(None);
        }
        let mut found: BTreeMap<usize, PathBuf> = BTreeMap::new();
        for entry in std::fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))? {
            let path = entry.with_context(|| format!("cannot read {}", folder.display()))?.path();
            let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
            let number = path.file_stem().and_then(|s| s.to_str()).filter(|s| s.bytes().all(|b| b.is_ascii_digit()));
            let (true, Some(Ok(number))) = (endings.contains(&ending), number.map(str::parse::<usize>)) else { continue };
            let index = index_of(number, names, keyframes).with_context(|| path.display().to_string())?;
            if let Some(other) = found.insert(index, path.clone()) {
                bail!("{} and {} are of one keyframe\n  help: keep one of them", other.display(), path.display());
            }
        }
        let missing: Vec<usize> = split.held_out.iter().copied().filter(|i| !found.contains_key(i)).collect();
        if let Some(&index) = missing.first() {
            let number = if names == Names::Stem { index + 1 } else { index };
            bail!(
                "{}: the prediction of keyframe {index} is missing ({} of {} held-out keyframes are not there)\n  help: every held-out keyframe \
                 of the protocol \"{}\" is scored; files are named by the stem of the data set's, from 00001, or by the index from 0 with \
                 \"names\": \"index\" in predictions.json",
                folder.join(format!("{number:05}.{}", endings[0])).display(),
                missing.len(),
                split.held_out.len(),
                split.protocol.name()
            );
        }
        found.retain(|index, _| split.held_out.contains(index));
        for path in found.values() {
            check_regular(path, &path.display().to_string())?;
        }
        Ok(Some(Self { folder, by_index: found }))
    }

    /// The file of a keyframe.
    pub(super) fn path(&self, index: usize) -> Result<&Path> {
        let path = self.by_index.get(&index).map(PathBuf::as_path);
        path.with_context(|| format!("{}: keyframe {index} is not one of those that are scored", self.folder.display()))
    }
}

/// The keyframe's index that a file's number means.
fn index_of(number: usize, names: Names, keyframes: usize) -> Result<usize> {
    match names {
        Names::Stem => {
            ensure!(
                (1..=keyframes).contains(&number),
                "names no keyframe: file stems are 00001 to {keyframes:05}\n  help: if your numbers count from 0, write \"names\": \"index\" into \
                 predictions.json"
            );
            Ok(number - 1)
        }
        Names::Index => {
            ensure!(
                number < keyframes,
                "names no keyframe: indices are 0 to {}\n  help: if your names are the data set's file stems, leave \"names\" out of \
                 predictions.json",
                keyframes - 1
            );
            Ok(number)
        }
    }
}

/// SHA-256 over a line `path sha256` for each file that is scored and for the statement, in the order of their paths, which are relative to
/// the folder and have forward slashes.
pub(super) fn hash(dir: &Path, statement: &Path, read: &[&Files]) -> Result<String> {
    let mut paths: Vec<&Path> = read.iter().flat_map(|files| files.by_index.values().map(PathBuf::as_path)).collect();
    paths.extend(statement.exists().then_some(statement));
    let mut lines = BTreeMap::new();
    for path in paths {
        let relative: Vec<_> = path.strip_prefix(dir)?.iter().map(|part| part.to_string_lossy()).collect();
        lines.insert(relative.join("/"), sha256_hex(&io::read(path)?));
    }
    let mut text = String::new();
    for (path, sha256) in lines {
        writeln!(text, "{path} {sha256}")?;
    }
    Ok(sha256_hex(text.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::split::Protocol;

    fn split() -> Split {
        Split { protocol: Protocol::TEST, train: vec![1, 2], held_out: vec![0, 3] }
    }

    fn listed(names: &[&str], counted: Names) -> Result<Files> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("images")).unwrap();
        names.iter().for_each(|name| std::fs::write(dir.path().join("images").join(name), "x").unwrap());
        Ok(Files::list(dir.path(), "images", &["png"], counted, 4, &split())?.unwrap())
    }

    #[test]
    fn files_are_found_by_stem_or_by_index() {
        let name = |files: &Files, index| files.path(index).unwrap().file_name().unwrap().to_str().unwrap().to_owned();
        let files = listed(&["00001.png", "00004.png", "00002.png", "notes.txt", "depth_9.png"], Names::Stem).unwrap();
        assert_eq!((name(&files, 0), name(&files, 3)), ("00001.png".into(), "00004.png".into()));
        assert!(files.path(1).is_err(), "what is not held out is not scored");
        let files = listed(&["0.png", "003.png"], Names::Index).unwrap();
        assert_eq!((name(&files, 0), name(&files, 3)), ("0.png".into(), "003.png".into()));
    }

    #[test]
    fn numbers_that_are_off_are_told_and_never_guessed() {
        for (names, counted, said) in [
            (&["00000.png", "00003.png"][..], Names::Stem, "count from 0"),
            (&["00001.png", "00004.png", "00005.png"], Names::Stem, "00001 to 00004"),
            (&["0.png", "3.png", "4.png"], Names::Index, "indices are 0 to 3"),
            (&["00001.png"], Names::Stem, "00004.png: the prediction of keyframe 3 is missing (1 of 2"),
            (&["00001.jpg", "00004.png"], Names::Stem, "00001.png: the prediction of keyframe 0 is missing"),
            (&["1.png", "00001.png", "4.png"], Names::Stem, "of one keyframe"),
        ] {
            let error = format!("{:#}", listed(names, counted).unwrap_err());
            assert!(error.contains(said) && error.contains("help"), "{names:?}: {error}");
        }
    }
}
