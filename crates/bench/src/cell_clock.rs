//! Time of a cell over several processes: what passed before the checkpoint that one of them goes on from.

use crate::json::{read_json, write_json};
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Seconds up to a checkpoint, and which file that is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Kept {
    seconds: f64,
    file: Identity,
}

/// A version of the checkpoint's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Identity {
    bytes: u64,
    modified: Duration,
}

/// The clock of a cell that keeps a checkpoint.
pub struct CellClock {
    folder: PathBuf,
    checkpoint: PathBuf,
    earlier_s: f64,
    start: Instant,
    /// The checkpoint whose time is kept.
    kept: Option<Identity>,
}

fn identity(file: &Path) -> Option<Identity> {
    let metadata = std::fs::metadata(file).ok()?;
    let modified = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH).duration_since(UNIX_EPOCH).unwrap_or_default();
    Some(Identity { bytes: metadata.len(), modified })
}

impl CellClock {
    /// The clock in a folder. A checkpoint whose time is not known, because the process ended between writing the one and the other, is
    /// removed: a cell's time is that of all its work or the work is done again.
    ///
    /// # Errors
    /// A file that cannot be removed.
    pub fn open(folder: &Path) -> Result<Self> {
        let checkpoint = folder.join("checkpoint");
        let file = identity(&checkpoint);
        let kept: Option<Kept> = read_json(&folder.join("clock.json")).ok();
        let kept = kept.filter(|kept| Some(kept.file) == file);
        if file.is_some() && kept.is_none() {
            std::fs::remove_file(&checkpoint).with_context(|| format!("cannot remove {}", checkpoint.display()))?;
        }
        let earlier_s = kept.map_or(0.0, |kept| kept.seconds);
        Ok(Self { folder: folder.to_owned(), checkpoint, earlier_s, start: Instant::now(), kept: kept.map(|kept| kept.file) })
    }

    /// Path of the checkpoint.
    pub fn checkpoint(&self) -> &Path {
        &self.checkpoint
    }

    /// Seconds of the processes before this one, up to the checkpoint that it goes on from.
    pub fn earlier_s(&self) -> f64 {
        self.earlier_s
    }

    /// Keeps the time of a checkpoint that was written since the last call.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn keep(&mut self) -> Result<()> {
        let file = identity(&self.checkpoint);
        if let Some(file) = file.filter(|file| Some(*file) != self.kept) {
            let seconds = self.earlier_s + self.start.elapsed().as_secs_f64();
            write_json(&self.folder.join("clock.json"), &Kept { seconds, file })?;
            self.kept = Some(file);
        }
        Ok(())
    }

    /// Removes the folder: the record is what is left.
    pub fn remove(self) {
        // Files that stay take space and nothing else.
        let _ = std::fs::remove_file(self.folder.join("clock.json"));
        let _ = std::fs::remove_file(&self.checkpoint);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_without_its_time_is_not_gone_on_from() {
        let dir = tempfile::tempdir().unwrap();
        let mut clock = CellClock::open(dir.path()).unwrap();
        std::fs::write(clock.checkpoint(), "state").unwrap();
        clock.keep().unwrap();
        let again = CellClock::open(dir.path()).unwrap();
        assert!(again.earlier_s() > 0.0 && again.checkpoint().exists());
        // Killed behind the next checkpoint, before its time was kept.
        std::fs::write(clock.checkpoint(), "a later state").unwrap();
        let again = CellClock::open(dir.path()).unwrap();
        assert!(again.earlier_s() == 0.0 && !again.checkpoint().exists());
    }
}
