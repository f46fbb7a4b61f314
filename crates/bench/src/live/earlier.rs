//! What an earlier, unfinished session of a run has left: keyframes on record, and what it said of others.

use super::recorder::Recording;
use anyhow::{Context, Result};
use corf_scene::live::number_of;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::Path;

/// File of the lines about keyframes, in the run folder.
pub(super) const FILE: &str = "live.jsonl";

/// A line of `live.jsonl`, as far as it matters here.
#[derive(Deserialize)]
struct Line {
    event: String,
    #[serde(default)]
    number: Option<u64>,
    #[serde(default)]
    file: Option<String>,
    #[serde(default)]
    reason: Option<String>,
}

/// The earlier sessions of a run; of a new one, nothing.
#[derive(Default)]
pub(super) struct Earlier {
    /// Numbers of the keyframes that were taken, in order.
    pub taken: Vec<u64>,
    /// Keyframes that were left out, and their numbers.
    pub dropped: Vec<u64>,
    /// Files that were refused and whose turn is over, with the reason.
    pub refused: Vec<[String; 2]>,
    /// Names of pose files of which everything was said.
    pub settled: BTreeSet<String>,
    /// Numbered pose files among the refused.
    pub refused_keyframes: usize,
    /// Bytes of whole lines in `live.jsonl`.
    pub whole_bytes: u64,
}

impl Earlier {
    /// Reads what is left in a run folder beside a recording.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn read(run: &Path, recording: &Recording) -> Result<Self> {
        let pose_file = |stem: &String| format!("{stem}.json");
        let mut earlier = Self {
            taken: recording.names.iter().filter_map(|stem| number_of(&pose_file(stem))).collect(),
            settled: recording.names.iter().map(pose_file).collect(),
            ..Self::default()
        };
        let path = run.join(FILE);
        let text = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(earlier),
            Err(e) => return Err(e).with_context(|| format!("cannot read {}", path.display())),
        };
        let end = text.iter().rposition(|b| *b == b'\n').map_or(0, |last| last + 1);
        earlier.whole_bytes = end as u64;
        let Some(last) = earlier.taken.last().copied() else { return Ok(earlier) };
        let lines = String::from_utf8_lossy(&text[..end]).into_owned();
        for line in lines.lines().filter_map(|line| serde_json::from_str::<Line>(line).ok()) {
            // What came behind the last that was taken is looked at again.
            let Some(number) = line.number.filter(|number| *number <= last) else { continue };
            match (line.event.as_str(), line.file, line.reason) {
                ("dropped", ..) if !earlier.taken.contains(&number) && !earlier.dropped.contains(&number) => {
                    earlier.dropped.push(number);
                }
                ("refused", Some(file), Some(reason)) => {
                    let name = file.rsplit('/').next().unwrap_or_default().to_owned();
                    // One that was written again and taken then is among the taken.
                    if earlier.settled.insert(name) {
                        earlier.refused_keyframes += 1;
                    }
                    let entry = [file, reason];
                    if !earlier.refused.contains(&entry) {
                        earlier.refused.push(entry);
                    }
                }
                _ => {}
            }
        }
        Ok(earlier)
    }

    /// Whether a pose file was dealt with.
    pub fn knows(&self, name: &str, number: Option<u64>) -> bool {
        self.settled.contains(name) || number.is_some_and(|number| self.dropped.contains(&number))
    }

    /// Keyframes that had landed and were dealt with.
    pub fn arrived(&self) -> usize {
        self.taken.len() + self.dropped.len() + self.refused_keyframes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_said_of_keyframes_before_the_last_that_was_taken_holds() {
        let dir = tempfile::tempdir().unwrap();
        let text = "{\"event\":\"begin\",\"unix_s\":1.0,\"announced\":null}\n\
            {\"event\":\"refused\",\"file\":\"poses/2.json\",\"number\":2,\"reason\":\"cut short\",\"at_s\":1.0}\n\
            {\"event\":\"refused\",\"file\":\"poses/x.json\",\"number\":null,\"reason\":\"no number\",\"at_s\":1.0}\n\
            {\"event\":\"dropped\",\"number\":3,\"arrived_s\":1.0}\n\
            {\"event\":\"refused\",\"file\":\"poses/9.json\",\"number\":9,\"reason\":\"cut short\",\"at_s\":1.0}\n";
        std::fs::write(dir.path().join(FILE), format!("{text}{{\"event\":\"tra")).unwrap();
        let recording = Recording { names: vec!["01".to_owned(), "4".to_owned()], poses: Vec::new() };
        let earlier = Earlier::read(dir.path(), &recording).unwrap();
        assert_eq!((earlier.taken.as_slice(), earlier.dropped.as_slice()), (&[1, 4][..], &[3][..]));
        assert_eq!(earlier.refused, [["poses/2.json".to_owned(), "cut short".to_owned()]]);
        assert_eq!((earlier.whole_bytes, earlier.arrived()), (text.len() as u64, 4));
        for (name, number, known) in
            [("01.json", 1, true), ("1.json", 1, false), ("2.json", 2, true), ("3.json", 3, true), ("9.json", 9, false)]
        {
            assert_eq!(earlier.knows(name, Some(number)), known, "{name}");
        }
        assert_eq!(Earlier::read(&dir.path().join("new"), &Recording::default()).unwrap().arrived(), 0);
    }
}
