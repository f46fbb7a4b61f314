//! Whether a dataset on disk is the one that a configuration makes, and what differs where it is not.

use super::header::{DatasetHeader, generator};
use super::{Dataset, leftovers};
use crate::{Error, Result};
use serde_json::Value;
use std::path::Path;

/// Differences that a message names; more of them say no more.
const NAMED: usize = 6;

/// Checks that the finished dataset in `dir` is what `header` would make, and removes what its making left there. `header` need not hold
/// what is measured before the first keyframe (exposure, sampling error, the range of tutorial images): that follows from the rest.
///
/// # Errors
/// A dataset of another configuration, scene or version, with what differs; a folder that holds none.
pub fn check_finished(dir: impl AsRef<Path>, header: &DatasetHeader) -> Result<()> {
    let dir = dir.as_ref();
    let dataset = Dataset::open(dir)?;
    let there = dataset.header();
    let metered = header.config.as_ref().is_some_and(|c| c.light.exposure_ev.is_none());
    let wanted = DatasetHeader {
        exposure_ev: if metered { there.exposure_ev } else { header.exposure_ev },
        sampling_error: there.sampling_error,
        tutorial_range: there.tutorial_range,
        ..header.clone()
    };
    let by = &dataset.file().generator;
    if *by != generator() || there.hash()? != wanted.hash()? {
        return Err(another(dir, by, there, &wanted));
    }
    leftovers::remove_temporary(dir)?;
    leftovers::forget_progress(dir)
}

/// The refusal to go on with what was made `by` another version or from another header.
pub(super) fn another(dir: &Path, by: &str, there: &DatasetHeader, wanted: &DatasetHeader) -> Error {
    let what = if by != generator() {
        format!("another version ({by} there, {} here)", generator())
    } else {
        format!("another configuration:{}", differences(there, wanted))
    };
    let help = match &there.light_adapter {
        _ if there.light_adapter == wanted.light_adapter => {
            "give a new folder, or the configuration and version it was made with".to_owned()
        }
        Some(adapter) => {
            format!("its light was traced on {adapter}: choose that by --device gpu:N (corf doctor lists them), or a new folder")
        }
        None => "its light was traced on the processor: choose --device cpu, or a new folder".to_owned(),
    };
    Error::invalid(dir.display().to_string(), format!("the dataset there was made with {what}"), help)
}

/// One line for every value that differs: its key, what is there, what is wanted.
fn differences(there: &DatasetHeader, wanted: &DatasetHeader) -> String {
    let (Ok(a), Ok(b)) = (serde_json::to_value(there), serde_json::to_value(wanted)) else { return String::new() };
    let mut lines = Vec::new();
    // What a person wrote first; what follows from it is left out where that says it all.
    for key in ["config", "scene"] {
        compare(key, &a[key], &b[key], &mut lines);
    }
    if lines.is_empty() {
        compare("", &a, &b, &mut lines);
    }
    if a["scene_sha256"] != b["scene_sha256"] || a["scene_content_sha256"] != b["scene_content_sha256"] {
        lines.insert(0, "the scene's mesh, or a file that it names, has changed".to_owned());
    }
    if lines.is_empty() && there.poses != wanted.poses {
        lines.push("trajectory.json: the poses are others".to_owned());
    }
    let more = lines.len().saturating_sub(NAMED);
    lines.truncate(NAMED);
    if more > 0 {
        lines.push(format!("and {more} more"));
    }
    lines.iter().map(|line| format!("\n    {line}")).collect()
}

/// Adds a line for every leaf below `key` in which two values differ.
pub(super) fn compare(key: &str, there: &Value, wanted: &Value, lines: &mut Vec<String>) {
    match (there, wanted) {
        (Value::Object(a), Value::Object(b)) => {
            let keys: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for name in keys {
                let dot = if key.is_empty() { "" } else { "." };
                let of = |map: &serde_json::Map<String, Value>| map.get(name).cloned().unwrap_or(Value::Null);
                compare(&format!("{key}{dot}{name}"), &of(a), &of(b), lines);
            }
        }
        _ if there != wanted => {
            let text = |v: &Value| if v.is_null() { "nothing".to_owned() } else { v.to_string() };
            lines.push(format!("{key}: {} there, {} here", text(there), text(wanted)));
        }
        _ => {}
    }
}
