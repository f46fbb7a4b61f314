//! The data set of what was taken, written by a thread beside the reconstruction.

use anyhow::{Context, Result, anyhow};
use corf_scene::dataset::{Dataset, DatasetHeader, DatasetWriter, FrameData};
use corf_scene::trajectory::TrajectoryPose;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Keyframes that wait to be written; then the reconstruction waits.
const BACKLOG: usize = 8;

/// A keyframe to be written.
pub(super) struct Entry {
    pub name: String,
    pub sources: BTreeMap<String, String>,
    pub pose: TrajectoryPose,
    pub frame: FrameData,
}

/// Keyframes that an earlier session recorded, in order.
#[derive(Default)]
pub(super) struct Recording {
    /// Their names in the live folder.
    pub names: Vec<String>,
    pub poses: Vec<TrajectoryPose>,
}

/// Writes a data set that grows.
pub(super) struct Recorder {
    dir: PathBuf,
    entries: Option<SyncSender<Entry>>,
    thread: Option<JoinHandle<Result<DatasetWriter>>>,
}

impl Recorder {
    /// Starts a data set, or goes on with the one that an earlier session of the same run has left.
    pub fn start(dir: &Path, header: DatasetHeader) -> Result<(Self, Recording)> {
        let mut writer = DatasetWriter::growing(dir, header)?;
        let recording = Recording { names: writer.names().to_vec(), poses: writer.poses().to_vec() };
        let (entries, queue) = sync_channel::<Entry>(BACKLOG);
        let write = move || {
            for Entry { name, sources, pose, frame } in queue {
                writer.append(name, sources, pose, &frame)?;
            }
            Ok(writer)
        };
        let thread = std::thread::Builder::new().name("recorder".to_owned()).spawn(write)?;
        Ok((Self { dir: dir.to_owned(), entries: Some(entries), thread: Some(thread) }, recording))
    }

    /// Hands a keyframe over.
    ///
    /// # Errors
    /// An earlier one could not be written.
    pub fn put(&mut self, entry: Entry) -> Result<()> {
        if self.entries.as_ref().is_some_and(|entries| entries.send(entry).is_ok()) {
            return Ok(());
        }
        Err(self.join().err().unwrap_or_else(|| anyhow!("the data set was finished already")))
    }

    /// Finishes the data set and opens it.
    ///
    /// # Errors
    /// A file that cannot be written, or spectra without any power.
    pub fn finish(mut self) -> Result<Dataset> {
        let writer = self.join()?;
        writer.finish().with_context(|| format!("while finishing the data set {}", self.dir.display()))?;
        Ok(Dataset::open(&self.dir)?)
    }

    fn join(&mut self) -> Result<DatasetWriter> {
        drop(self.entries.take());
        let ended = self.thread.take().map(JoinHandle::join);
        let context = || format!("while writing the data set {}", self.dir.display());
        match ended {
            Some(Ok(writer)) => writer.with_context(context),
            _ => Err(anyhow!("the thread that writes has ended")).with_context(context),
        }
    }
}
