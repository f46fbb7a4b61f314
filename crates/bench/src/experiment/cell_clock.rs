//! Time of a cell over several processes: what passed before the checkpoint that one of them goes on from.

use crate::files::json::{read_json, write_json};
use crate::methods::interface::same_device;
use crate::note;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Seconds up to a checkpoint, which file that is, and on which device the work was done; older versions did not keep that.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Kept {
    seconds: f64,
    file: Identity,
    #[serde(default)]
    device: Option<String>,
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
    device: String,
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
    /// removed: a cell's time is that of all its work or the work is done again. So is one of another device than `device`, where the cell happens
    /// to be gone on with: time and result are of one device.
    ///
    /// # Errors
    /// A file that cannot be removed.
    pub fn open(folder: &Path, device: &str) -> Result<Self> {
        let checkpoint = folder.join("checkpoint");
        let file = identity(&checkpoint);
        let kept: Option<Kept> = read_json(&folder.join("clock.json")).ok();
        let kept = kept.filter(|kept| Some(kept.file) == file);
        let another = kept.as_ref().and_then(|kept| kept.device.clone()).filter(|before| !same_device(before, device));
        if let Some(before) = &another {
            note!("{}: kept on {before}, and this is {device}: the cell begins anew", checkpoint.display());
        }
        let kept = kept.filter(|_| another.is_none());
        if file.is_some() && kept.is_none() {
            std::fs::remove_file(&checkpoint).with_context(|| format!("cannot remove {}", checkpoint.display()))?;
        }
        let (earlier_s, kept) = (kept.as_ref().map_or(0.0, |kept| kept.seconds), kept.map(|kept| kept.file));
        let (folder, device) = (folder.to_owned(), device.to_owned());
        Ok(Self { folder, checkpoint, device, earlier_s, start: Instant::now(), kept })
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
            write_json(&self.folder.join("clock.json"), &Kept { seconds, file, device: Some(self.device.clone()) })?;
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
        let mut clock = CellClock::open(dir.path(), "cpu (2 threads)").unwrap();
        std::fs::write(clock.checkpoint(), "state").unwrap();
        clock.keep().unwrap();
        let again = CellClock::open(dir.path(), "cpu (2 threads)").unwrap();
        assert!(again.earlier_s() > 0.0 && again.checkpoint().exists());
        // Killed behind the next checkpoint, before its time was kept.
        std::fs::write(clock.checkpoint(), "a later state").unwrap();
        let again = CellClock::open(dir.path(), "cpu (2 threads)").unwrap();
        assert!(again.earlier_s() == 0.0 && !again.checkpoint().exists());
    }

    #[test]
    fn a_checkpoint_of_another_device_is_not_gone_on_from() {
        let dir = tempfile::tempdir().unwrap();
        let keep = |device: &str| {
            let mut clock = CellClock::open(dir.path(), device).unwrap();
            std::fs::write(clock.checkpoint(), "state").unwrap();
            clock.keep().unwrap();
        };
        keep("cpu (2 threads)");
        let more_threads = CellClock::open(dir.path(), "cpu (16 threads)").unwrap();
        assert!(more_threads.earlier_s() > 0.0 && more_threads.checkpoint().exists());
        let other = CellClock::open(dir.path(), "gpu (one)").unwrap();
        assert!(other.earlier_s() == 0.0 && !other.checkpoint().exists());
        // One that an older version kept says no device.
        keep("gpu (one)");
        let path = dir.path().join("clock.json");
        let mut clock: serde_json::Value = read_json(&path).unwrap();
        clock.as_object_mut().unwrap().remove("device");
        write_json(&path, &clock).unwrap();
        assert!(CellClock::open(dir.path(), "gpu (two)").unwrap().earlier_s() > 0.0);
    }
}
