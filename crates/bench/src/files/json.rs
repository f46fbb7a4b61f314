//! JSON files: read within a bound, with the path in every error; written whole or not at all.

use crate::files::numbers;
use anyhow::{Context, Result};
use corf_scene::io::{read_text_within, write_atomic};
use serde::{Serialize, de::DeserializeOwned};
use std::path::Path;

/// Writes pretty JSON atomically.
///
/// # Errors
/// When the folder cannot be written; the path is named.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    Ok(write_atomic(path, text.as_bytes())?)
}

/// Writes pretty JSON atomically, its numbers checked.
///
/// # Errors
/// A number that is none, by its key; a folder that cannot be written.
pub fn write_numbers(path: &Path, value: &impl Serialize) -> Result<()> {
    numbers::check(&serde_json::to_value(value)?).with_context(|| format!("{} is not written", path.display()))?;
    write_json(path, value)
}

/// Most bytes of a JSON file: a run of a hundred thousand keyframes has a tenth of it.
const MOST_BYTES: u64 = 1 << 28;
/// Most numbers and texts in it.
const MOST_VALUES: usize = 1 << 23;

/// Reads JSON.
///
/// # Errors
/// A missing file, one that is not what it should be (line and column are named), or one that is larger than any of its kind.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    read(path, false)
}

/// Reads what [`write_numbers`] wrote.
///
/// # Errors
/// Those of [`read_json`]; a number that is none, by its key.
pub fn read_numbers<T: DeserializeOwned>(path: &Path) -> Result<T> {
    read(path, true)
}

fn read<T: DeserializeOwned>(path: &Path, of_record: bool) -> Result<T> {
    let text = read_text(path)?;
    numbers::check_text(&text, of_record, MOST_VALUES).with_context(|| format!("in {}", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{} is not the JSON expected here", path.display()))
}

/// Reads the text of a configuration, a plan or a JSON file.
///
/// # Errors
/// A missing file, or one that is larger than any of its kind.
pub fn read_text(path: &Path) -> Result<String> {
    read_text_within(path, MOST_BYTES).with_context(|| format!("cannot read {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn writing_replaces_whole_files_only() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write_json(&path, &[1, 2]).unwrap();
        write_json(&path, &[3]).unwrap();
        assert_eq!(read_json::<Vec<i32>>(&path).unwrap(), [3]);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
