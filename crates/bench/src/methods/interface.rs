//! Interface of the compared methods, one per row of a table: training keyframes in, a predictor out. The clock and the metrics are the
//! harness's.

use crate::metrics::Prediction;
use crate::note;
use crate::scenes::behind::SceneBehind;
use crate::split::Split;
use crate::terminal::interrupt;
use anyhow::{Context, Result, bail, ensure};
use corf::depth::DepthQuality;
use corf::device::TrainingTimes;
use corf::{Field, IdleKey, KeyframeTiming};
use corf_scene::config::{ReceiverConfig, SpectrumKind};
use corf_scene::dataset::{Dataset, FixedArray};
use corf_scene::keyframe::{DbRange, Modalities};
use corf_scene::{Keyframe, Pinhole, Raster, Rigid3, Similarity3};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::cell::{Cell, RefCell};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The training keyframes of one cell, in the order of the trajectory, and what of the dataset a method may know besides.
pub struct TrainingSet<'a> {
    dataset: &'a Dataset,
    indices: Vec<usize>,
    held_out: Vec<usize>,
    loading: Cell<Duration>,
    /// Keyframes that have been read and not been asked for.
    held: RefCell<Vec<Option<Keyframe>>>,
}

/// Keyframes are read before the clock starts as long as they take no more memory than this, bytes.
const MOST_HELD: usize = 4 << 30;

impl<'a> TrainingSet<'a> {
    /// The keyframes a split trains with.
    pub fn new(dataset: &'a Dataset, split: &Split) -> Self {
        let (indices, held_out) = (split.train.clone(), split.held_out.clone());
        Self { dataset, indices, held_out, loading: Cell::default(), held: RefCell::default() }
    }

    /// Reads keyframes, on all threads, so that [`Self::keyframe`] has them in memory: what is measured then is not disturbed by reading.
    /// Those beyond 4 GiB, and those that cannot be read, are left to it. Without `light` they have what was heard alone.
    pub fn read_ahead(&self, light: bool) {
        let pixels = |camera: Pinhole| camera.width * camera.height;
        // Colour, depth and surface; a spectrum.
        let bytes = if light { 11 * pixels(self.light_camera()) } else { 0 } + 4 * pixels(self.radio_camera());
        let some = &self.indices[..self.indices.len().min(MOST_HELD / bytes.max(1))];
        let one = |index: &usize| if light { self.dataset.keyframe(*index) } else { self.dataset.heard(*index) };
        let read = some.par_iter().map(|index| one(index).ok()).collect();
        *self.held.borrow_mut() = read;
    }

    /// Indices of the training keyframes in the dataset, ascending.
    pub fn indices(&self) -> &[usize] {
        &self.indices
    }

    /// Number of training keyframes.
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }

    /// Training keyframe `k` (0 … len−1), read if it has not been, or has been asked for before. The harness takes the time this needs off
    /// its clock.
    ///
    /// # Errors
    /// A file that is missing, damaged or of the wrong size.
    pub fn keyframe(&self, k: usize) -> Result<Keyframe> {
        if let Some(keyframe) = self.held.borrow_mut().get_mut(k).and_then(Option::take) {
            return Ok(keyframe);
        }
        let start = Instant::now();
        let index = self.indices[k];
        let keyframe = self.dataset.keyframe(index).with_context(|| format!("while reading training keyframe {index}"))?;
        self.loading.set(self.loading.get() + start.elapsed());
        Ok(keyframe)
    }

    /// The change from the frame of a capture to the world that the data set's import applied; none where nothing was imported.
    pub fn world_from_capture(&self) -> Option<Similarity3> {
        self.dataset.world_from_capture()
    }

    /// Poses of the training keyframes.
    pub fn poses(&self) -> Vec<Rigid3> {
        let all = self.dataset.poses();
        self.indices.iter().map(|i| all[*i].world_from_camera).collect()
    }

    /// The spectrum of training keyframe `k`, which stays to be asked for.
    ///
    /// # Errors
    /// Those of [`Self::keyframe`]; a dataset without spectra.
    pub fn spectrum_of(&self, k: usize) -> Result<Raster<f32>> {
        let held = self.held.borrow().get(k).and_then(|held| Some(held.as_ref()?.radio.as_ref()?.spectrum.clone()));
        let read = || -> Result<Raster<f32>> {
            let (start, index) = (Instant::now(), self.indices[k]);
            let heard = self.dataset.heard(index).with_context(|| format!("while reading training keyframe {index}"))?;
            self.loading.set(self.loading.get() + start.elapsed());
            Ok(heard.radio.with_context(|| self.no_spectra())?.spectrum)
        };
        held.map_or_else(read, Ok)
    }

    /// The array, where it stands still and the transmitter moves.
    pub fn fixed_array(&self) -> Option<&FixedArray> {
        self.dataset.fixed_array()
    }

    /// Whether there are images, and whether there are spectra.
    pub fn modalities(&self) -> Modalities {
        self.dataset.modalities()
    }

    /// Whether every keyframe comes with depth.
    pub fn has_depth(&self) -> bool {
        self.dataset.has_depth()
    }

    /// Intrinsics of the optical images.
    pub fn light_camera(&self) -> Pinhole {
        self.dataset.light_camera()
    }

    /// Intrinsics of the RF images.
    pub fn radio_camera(&self) -> Pinhole {
        self.dataset.radio_camera()
    }

    /// The one dB range of the dataset's spectra (its upper end is the peak over all keyframes); none without spectra.
    pub fn db_range(&self) -> Option<DbRange> {
        self.dataset.db_range()
    }

    /// The same, for a method that [needs](Method::needs) spectra.
    ///
    /// # Errors
    /// A dataset without spectra.
    pub fn required_db_range(&self) -> Result<DbRange> {
        self.db_range().with_context(|| self.no_spectra())
    }

    fn no_spectra(&self) -> String {
        format!(
            "{} has no spectra\n  help: import the capture with them (`corf dataset import`, --rf)",
            self.dataset.dir().display()
        )
    }

    /// Position of the fixed transmitter in the world frame, metres, if it is known.
    pub fn transmitter_m(&self) -> Option<[f64; 3]> {
        self.dataset.header().transmitter.map(|t| t.position_m)
    }

    /// Kind of the spectra, if it is known.
    pub fn spectrum(&self) -> Option<SpectrumKind> {
        self.dataset.header().spectrum
    }

    /// The array of the platform, if it is known.
    pub fn receiver(&self) -> Option<ReceiverConfig> {
        self.dataset.header().receiver
    }

    /// Standard deviation of an `mpc` lobe, degrees, if it is known.
    pub fn lobe_width_deg(&self) -> Option<f64> {
        self.dataset.header().lobe_width_deg()
    }

    /// Diagonal loading of `mvdr` spectra, in units of the covariance's mean eigenvalue, if it is known.
    pub fn mvdr_loading(&self) -> Option<f64> {
        self.dataset.header().mvdr_loading()
    }

    /// The true scene, from the file that the data set was generated from: of oracles alone, whose [`Method::uses_scene`] says so.
    ///
    /// # Errors
    /// Those of [`SceneBehind::open`].
    pub fn scene_behind(&self, path: &Path) -> Result<SceneBehind> {
        SceneBehind::open(self.dataset, path)
    }

    /// The whole data set and the keyframes of it that are held out: to check what was learnt elsewhere against, and to learn nothing from.
    pub(super) fn to_check_against(&self) -> (&Dataset, &[usize]) {
        (self.dataset, &self.held_out)
    }

    /// Time spent in [`Self::keyframe`] so far.
    pub fn loading_time(&self) -> Duration {
        self.loading.get()
    }
}

/// Checkpointing of a method: the file in which it saves its state while it works and on an interrupt, and whether it resumes from it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoints {
    /// The file.
    pub path: PathBuf,
    /// Written after every so many keyframes (or steps, by methods that work in steps), never if 0; when not given, after one that ends half a
    /// minute or more after the last.
    pub every: Option<usize>,
    /// Whether to go on from the file, if it is there.
    pub resume: bool,
    /// Tag that must be the same when it is resumed (the dataset's hash).
    pub tag: String,
    /// The device that works, as records name it: a run stays on the device that it began on.
    pub device: String,
}

/// What a checkpoint carries, in the words of its file's tag.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tag {
    run: String,
    device: String,
}

/// What bytes depend on of a device's name for records: of the processor not the number of its threads.
pub fn same_device(a: &str, b: &str) -> bool {
    let processor = |name: &str| name == "cpu" || name.starts_with("cpu (");
    a == b || processor(a) && processor(b)
}

/// Time between checkpoints that nobody asked for: what is lost without them is no more, and what they cost is next to nothing.
const CHECKPOINT_INTERVAL: Duration = Duration::from_secs(30);

impl Checkpoints {
    /// Whether any are written.
    pub fn are_kept(&self) -> bool {
        self.every != Some(0)
    }

    /// Whether one is to be written now, after `done` units of work, where the last was written, or the work begun, at `last`.
    pub fn is_due(&self, done: usize, last: Instant) -> bool {
        match self.every {
            Some(0) => false,
            Some(every) => done.is_multiple_of(every),
            None => last.elapsed() >= CHECKPOINT_INTERVAL,
        }
    }

    /// The file to go on from, where one is there and is to be.
    pub fn to_resume(&self) -> Option<&Path> {
        (self.resume && self.path.exists()).then_some(&self.path)
    }

    /// The tag that a checkpoint is written with.
    pub fn written_tag(&self) -> String {
        serde_json::json!(Tag { run: self.tag.clone(), device: self.device.clone() }).to_string()
    }

    /// Checks the tag of a checkpoint that was read.
    ///
    /// # Errors
    /// Another tag than this one's, or one of another device.
    pub fn check_tag(&self, tag: &str) -> Result<()> {
        let read: Option<Tag> = serde_json::from_str(tag).ok();
        let (path, now) = (self.path.display(), &self.device);
        let Some(Tag { device: before, .. }) = read.filter(|read| read.run == self.tag) else {
            bail!(
                "{path} is of another dataset or configuration\n  help: choose another --out, or resume with the command that was interrupted"
            );
        };
        ensure!(
            same_device(&before, now),
            "{path} was kept on {before}, and this is {now}: devices differ by rounding, and a run that changes them is neither's\n  help: \
             resume on the device that it began on (--device cpu, or gpu:N; `corf doctor` lists them), or start anew with another --out"
        );
        Ok(())
    }

    /// Takes note that the file holds so many units of work.
    pub fn holds(&self, done: usize, unit: &str) {
        let path = self.path.display();
        interrupt::kept(|| format!("{path} holds {done} {unit}: the same command with --resume goes on from there"));
    }
}

/// Progress report of a method at work; the harness adds the time.
#[derive(Clone, Copy, Debug)]
pub struct Advance<'a> {
    /// Units of work done.
    pub done: usize,
    /// Units in all.
    pub total: usize,
    /// Gaussians now, for methods that have them.
    pub gaussians: Option<usize>,
    /// The keyframe that was finished, for methods that work keyframe by keyframe.
    pub keyframe: Option<&'a KeyframeTiming>,
    /// Errors of the depths of new Gaussians, at the end.
    pub depth: Option<DepthQuality>,
    /// What the stages took, at the end, for methods that have some.
    pub stages: &'a [StageTime],
    /// Where the time of training went, at the end, on a device that times itself.
    pub training_times: Option<&'a TrainingTimes>,
    /// Steps that came from a checkpoint, for methods that work in steps.
    pub resumed_steps: usize,
    /// The field as it stands, for whoever wants to look at it, from methods that have one.
    pub field: Option<FieldReader<'a>>,
    /// What predicts as the work stands, from methods whose field is more, or something else, than Gaussians of light and radio
    /// ([`Method::predicts_at_work`]).
    pub predictor: Option<PredictorReader<'a>>,
}

/// Reads the Gaussians of a reconstruction at work back from its device: work that is done only where somebody asks for it.
#[derive(Clone, Copy)]
pub struct FieldReader<'a>(&'a dyn Fn() -> Option<Field>);

impl<'a> FieldReader<'a> {
    /// A reader that calls `read`.
    pub fn new(read: &'a dyn Fn() -> Option<Field>) -> Self {
        Self(read)
    }

    /// The field as it stands; none where the method has no Gaussians that a rasteriser could draw.
    pub fn read(self) -> Option<Field> {
        (self.0)()
    }
}

/// Makes a predictor of a reconstruction at work: work that is done only where somebody asks for it, and changes nothing of it.
#[derive(Clone, Copy)]
pub struct PredictorReader<'a>(&'a dyn Fn() -> Result<Option<Box<dyn Predictor>>>);

impl<'a> PredictorReader<'a> {
    /// A reader that calls `make`.
    pub fn new(make: &'a dyn Fn() -> Result<Option<Box<dyn Predictor>>>) -> Self {
        Self(make)
    }

    /// What predicts as the work stands; none where there is nothing yet that could.
    ///
    /// # Errors
    /// The device's.
    pub fn read(self) -> Result<Option<Box<dyn Predictor>>> {
        (self.0)()
    }
}

impl std::fmt::Debug for PredictorReader<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("PredictorReader")
    }
}

impl std::fmt::Debug for FieldReader<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("FieldReader")
    }
}

/// A field that was read to be looked at, if it could be; where not, that is said, and the reconstruction goes on: what is wrong with its device it
/// will find itself.
pub fn shown(read: corf::Result<Field>) -> Option<Field> {
    read.inspect_err(|error| note!("the field cannot be shown as it stands now: {error}")).ok()
}

/// What a stage of a method took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// Its name.
    pub name: String,
    /// Seconds, summed over the sessions of a run that was resumed.
    pub seconds: f64,
}

impl Advance<'_> {
    /// Units done of all, and no more to say.
    pub fn of(done: usize, total: usize) -> Self {
        Self {
            done,
            total,
            gaussians: None,
            keyframe: None,
            depth: None,
            training_times: None,
            stages: &[],
            resumed_steps: 0,
            field: None,
            predictor: None,
        }
    }
}

/// A way to reconstruct.
pub trait Method {
    /// The name on the command line and in records: `corf-gs`.
    fn id(&self) -> &str;

    /// The resolved configuration, for the record.
    fn config(&self) -> serde_json::Value;

    /// Whether the method reads ground-truth depth (through the simulated monocular prior).
    fn uses_ground_truth_depth(&self) -> bool {
        false
    }

    /// Whether it hands over what predicts while it works ([`Advance::predictor`]).
    fn predicts_at_work(&self) -> bool {
        false
    }

    /// Whether the method knows the true scene: an oracle, which bounds what a method could gain and is none.
    fn uses_scene(&self) -> bool {
        false
    }

    /// The device it runs on, for the record.
    fn device(&self) -> String {
        format!("cpu ({} threads)", rayon::current_num_threads())
    }

    /// The unit its progress is counted in.
    fn unit(&self) -> &'static str {
        "keyframes"
    }

    /// Fewer training keyframes than this are none to it.
    fn least_keyframes(&self) -> usize {
        1
    }

    /// Whether it needs images, and whether it needs spectra.
    fn needs(&self) -> Modalities {
        Modalities::BOTH
    }

    /// Whether it looks at images, depths and surfaces of keyframes: where not, they are not read.
    fn reads_light(&self) -> bool {
        true
    }

    /// Gives settings that nobody chose, and whose usual value depends on the kind of data set, that of this one. Comes before the configuration
    /// is read for a run.
    ///
    /// # Errors
    /// Settings that do not go with those values.
    fn settle(&mut self, _dataset: &Dataset) -> Result<()> {
        Ok(())
    }

    /// Keys of its settings that mean nothing beside the others; `training` says what they are used on, where that is known yet.
    ///
    /// # Errors
    /// A data set that the method does not know how to take.
    fn idle_keys(&self, _training: Option<&TrainingSet<'_>>) -> Result<Vec<IdleKey>> {
        Ok(Vec::new())
    }

    /// Looks, before anything is begun, for what the method reads beside the keyframes, and for whatever else it would refuse them for.
    ///
    /// # Errors
    /// A file that is missing or cannot be used; keyframes that do not suit the configuration.
    fn check_files(&self, _training: &TrainingSet<'_>) -> Result<()> {
        Ok(())
    }

    /// Asks the method to keep its state on disk while it works; methods that finish at once have none.
    fn keep_checkpoints(&mut self, _checkpoints: Checkpoints) {}

    /// Reconstructs from the training keyframes. The same seed gives the same bytes.
    ///
    /// # Errors
    /// Unreadable keyframes, a device that gives up, or whatever `advance` answers (an interrupt).
    fn reconstruct(
        &self,
        training: &TrainingSet<'_>,
        seed: u64,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>>;
}

/// Why a field has no spectra.
pub const NO_RADIO: &str = "the field has learnt no radio\n  help: reconstruct a data set with spectra";

/// Receives spectra as they are formed.
pub type Take<'a> = &'a mut dyn FnMut(Vec<Raster<f32>>) -> Result<()>;

/// A reconstructed field, to be asked for any pose.
pub trait Predictor {
    /// Predicts image and spectrum at a pose, at the dataset's resolutions.
    ///
    /// # Errors
    /// When the device gives up.
    fn render(&mut self, world_from_camera: &Rigid3) -> Result<Prediction>;

    /// Predicts spectra alone at poses, on the data set's decibel range from 0 to 1: those of [`Self::render`], without images. They are handed to
    /// `take` in the order of the poses, some at a time; many poses at once are answered faster than one by one.
    ///
    /// # Errors
    /// Those of [`Self::render`]; a field without radio; that of `take`, which ends the work.
    fn spectra(&mut self, poses: &[Rigid3], take: Take<'_>) -> Result<()> {
        for pose in poses {
            take(vec![self.render(pose)?.radio.context(NO_RADIO)?.scalar])?;
        }
        Ok(())
    }

    /// The box that holds what the field knows of the room, but for outliers, least and greatest corner, metres; none of methods without a place for
    /// anything.
    fn room_m(&self) -> Option<[DVec3; 2]> {
        None
    }

    /// Gaussians in the field, for methods that have them.
    fn gaussians(&self) -> Option<usize> {
        None
    }

    /// Changes the camera that images are predicted for from now on; spectra keep theirs.
    ///
    /// # Errors
    /// A method that predicts the data set's images alone; a camera without pixels.
    fn set_light_camera(&mut self, _camera: Pinhole) -> Result<()> {
        bail!(
            "this method predicts images of the data set's camera alone\n  help: leave --size and --fov out, or use a run of corf-gs or rf-3dgs"
        )
    }

    /// Writes the field into a run folder, for `corf render` and `corf evaluate`.
    ///
    /// # Errors
    /// When a file cannot be written.
    fn save(&self, run: &Path) -> Result<()>;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(device: &str) -> Checkpoints {
        Checkpoints {
            path: "run/checkpoint".into(),
            every: None,
            resume: true,
            tag: "hash test {}".to_owned(),
            device: device.to_owned(),
        }
    }

    #[test]
    fn a_checkpoint_is_gone_on_from_on_the_device_that_kept_it() {
        let (gpu, other) = ("gpu (NVIDIA H200)", "gpu (llvmpipe (LLVM 15.0.6, 256 bits))");
        for (before, now) in [("cpu (2 threads)", "cpu (16 threads)"), ("cpu (1 thread)", "cpu (1 threads)"), (gpu, gpu)] {
            of(now).check_tag(&of(before).written_tag()).unwrap();
        }
        for (before, now) in
            [(gpu, "cpu (2 threads)"), ("cpu (2 threads)", gpu), (gpu, other), (gpu, "gpu (NVIDIA H200), f16 products")]
        {
            let error = of(now).check_tag(&of(before).written_tag()).unwrap_err().to_string();
            for part in ["run/checkpoint", before, now, "--device", "--out"] {
                assert!(error.contains(part), "{part} in {error}");
            }
        }
    }

    #[test]
    fn checkpoints_of_other_runs_are_refused() {
        let another = Checkpoints { tag: "another test {}".to_owned(), ..of("cpu (2 threads)") };
        for tag in ["another test {}".to_owned(), another.written_tag(), String::new()] {
            let error = of("cpu (2 threads)").check_tag(&tag).unwrap_err().to_string();
            assert!(error.contains("another dataset or configuration"), "{error}");
        }
    }
}
