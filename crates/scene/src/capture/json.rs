//! JSON files of captures.

use crate::{Error, Result, io};
use serde::de::DeserializeOwned;
use std::path::Path;

/// Reads a JSON file. `NaN` and `Infinity`, which Python writes and JSON does not know, are read as null, so that whoever needs the number can say
/// which one it is.
///
/// # Errors
/// A file that cannot be read or is not of the form; `help` says which form that is.
pub(super) fn read<T: DeserializeOwned>(path: &Path, help: &str) -> Result<T> {
    let text = io::read_text(path)?;
    let fault = |e: serde_json::Error| {
        Error::invalid(format!("{}:{}:{}", path.display(), e.line(), e.column()), format!("not as expected: {e}"), help)
    };
    serde_json::from_str(&text).or_else(|e| {
        let repaired = ["-Infinity", "Infinity", "NaN"].iter().fold(text, |text, word| text.replace(word, "null"));
        serde_json::from_str(&repaired).map_err(|_| fault(e))
    })
}
