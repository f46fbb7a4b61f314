//! The data set of what was taken, written by a thread beside the reconstruction.

use anyhow::{Context, Result, anyhow};
use corf_scene::dataset::{Dataset, DatasetHeader, DatasetWriter, FrameData};
use corf_scene::trajectory::TrajectoryPose;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
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
    /// Comes once for every keyframe that is on the disk.
    kept: Receiver<()>,
    /// Keyframes that are known to be on the disk.
    on_disk: usize,
    thread: Option<JoinHandle<Result<DatasetWriter>>>,
}

impl Recorder {
    /// Starts a data set, or goes on with the one that an earlier session of the same run has left.
    pub fn start(dir: &Path, header: DatasetHeader) -> Result<(Self, Recording)> {
        let mut writer = DatasetWriter::growing(dir, header)?;
        let recording = Recording { names: writer.names().to_vec(), poses: writer.poses().to_vec() };
        let (entries, queue) = sync_channel::<Entry>(BACKLOG);
        let (keeps, kept) = channel();
        let write = move || {
            for Entry { name, sources, pose, frame } in queue {
                writer.append(name, sources, pose, &frame)?;
                // Nobody listens any more where the run has ended with an error.
                let _ = keeps.send(());
            }
            Ok(writer)
        };
        let thread = std::thread::Builder::new().name("recorder".to_owned()).spawn(write)?;
        let on_disk = recording.names.len();
        Ok((Self { dir: dir.to_owned(), entries: Some(entries), kept, on_disk, thread: Some(thread) }, recording))
    }

    /// Hands a keyframe over.
    ///
    /// # Errors
    /// An earlier one could not be written.
    pub fn put(&mut self, entry: Entry) -> Result<()> {
        if self.entries.as_ref().is_some_and(|entries| entries.send(entry).is_ok()) {
            return Ok(());
        }
        Err(self.failure())
    }

    /// Waits until the first `count` keyframes are on the disk, where a later session finds them.
    ///
    /// # Errors
    /// One of them could not be written.
    pub fn wait_for(&mut self, count: usize) -> Result<()> {
        while self.on_disk < count {
            if self.kept.recv().is_err() {
                return Err(self.failure());
            }
            self.on_disk += 1;
        }
        Ok(())
    }

    /// Why the thread takes nothing more.
    fn failure(&mut self) -> anyhow::Error {
        self.join().err().unwrap_or_else(|| anyhow!("the data set was finished already"))
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

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::live::LiveDescription;
    use corf_scene::{Raster, Rigid3};

    fn entry(index: usize, width: usize) -> Entry {
        let image = Raster::filled(width, 48, [index as u8; 3]);
        let frame = FrameData {
            image: Some(image),
            linear: None,
            albedo: None,
            normals: None,
            depth_m: None,
            surface: None,
            mask: None,
            spectrum: Some(Raster::filled(64, 48, 1e-6)),
            sphere: None,
            share_in_frame: None,
            paths_jsonl: None,
        };
        let pose = TrajectoryPose { index, time_s: index as f64, world_from_camera: Rigid3::IDENTITY };
        Entry { name: format!("{index:05}"), sources: BTreeMap::new(), pose, frame }
    }

    #[test]
    fn what_was_waited_for_is_there_for_a_later_session() {
        let dir = tempfile::tempdir().unwrap();
        let text = "schema = \"corf-live/1\"\nname = \"t\"\ndb_range = { min_db = -90.0, max_db = -20.0 }\n\
             optical_camera = { width = 64, height = 48, fx = 32.0, fy = 32.0, cx = 32.0, cy = 24.0 }\n\
             rf_camera = { width = 64, height = 48, fx = 32.0, fy = 32.0, cx = 32.0, cy = 24.0 }\n";
        let description: LiveDescription = toml::from_str(text).unwrap();
        let recorded = || DatasetWriter::growing(dir.path(), description.header()).unwrap().len();
        let (mut recorder, _) = Recorder::start(dir.path(), description.header()).unwrap();
        for count in 1..=4 {
            recorder.put(entry(count - 1, 64)).unwrap();
            recorder.wait_for(count).unwrap();
            assert_eq!(recorded(), count);
        }
        drop(recorder);
        // What an earlier session has left is there, and a keyframe that cannot be written never is.
        let (mut recorder, recording) = Recorder::start(dir.path(), description.header()).unwrap();
        assert_eq!(recording.names.len(), 4);
        recorder.wait_for(4).unwrap();
        recorder.put(entry(4, 63)).unwrap();
        let error = format!("{:#}", recorder.wait_for(5).unwrap_err());
        assert!(error.contains("while writing the data set") && error.contains("63"), "{error}");
        assert_eq!(recorded(), 4);
    }
}
