//! Runs one cell: a method on a dataset with a seed. Keeps the clock and writes the record.

use crate::device;
use crate::methods::abilities;
use crate::methods::interface::{Advance, Method, Predictor, StageTime, TrainingSet};
use crate::methods::registry;
use crate::metrics::input::Input;
use crate::metrics::{FrameMetrics, Prediction};
use crate::record::prediction_folder::PredictionFolder;
use crate::record::provenance::{Provenance, peak_memory_bytes, processor_s, reset_peak_memory};
use crate::record::{CLOCK, CurvePoint, NOT_STATED, Numbers, Outcome, PREDICTIONS, PROTOCOL, Record, SCHEMA, STATED_CLOCK};
use crate::run::evaluation::evaluate;
use crate::run::quality::QualityWatch;
use crate::split::{Protocol, Split};
use crate::terminal::interrupt::Interrupted;
use anyhow::{Result, bail};
use corf::depth::DepthQuality;
use corf::device::TrainingTimes;
use corf::{KeyframeTiming, LatencySummary};
use corf_scene::Keyframe;
use corf_scene::dataset::Dataset;
use corf_scene::words::counted;
use std::time::{Duration, Instant};

/// A finished reconstruction and what the clock says of it.
pub struct Reconstruction {
    /// The field.
    pub predictor: Box<dyn Predictor>,
    /// Seconds on the record's clock.
    pub seconds: f64,
    /// Growth over time.
    pub curve: Vec<CurvePoint>,
    /// Peak resident memory of the process during it, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// Peak of what buffers took on the GPU during it, bytes; `None` where none was at work.
    pub peak_device_memory_bytes: Option<u64>,
    /// Processor time of the process during it, seconds: of all threads, with what stands beside the clock (reading files, looking at quality).
    pub processor_s: Option<f64>,
    /// Timing of each keyframe, for methods that work keyframe by keyframe.
    pub keyframes: Vec<KeyframeTiming>,
    /// Errors of the depths of new Gaussians, for methods that estimate depth, where the dataset has the true depth.
    pub depth: Option<DepthQuality>,
    /// What the stages took, for methods that have some.
    pub stages: Vec<StageTime>,
    /// Where the time of training went, on a device that times itself.
    pub training_times: Option<TrainingTimes>,
    /// Steps that came from a checkpoint, for methods that work in steps.
    pub resumed_steps: usize,
}

/// Checks that there is enough to learn from.
///
/// # Errors
/// Fewer training keyframes than the method needs; images or spectra that it needs and the dataset lacks.
pub fn check_training(method: &dyn Method, dataset: &Dataset, split: &Split) -> Result<()> {
    if dataset.fixed_array().is_some() && !abilities(method.id()).fixed_array {
        bail!(
            "{} reconstructs what a moving receiver sees through a pinhole, and in {} the array stands still, sees a half-sphere, and the transmitter \
             moves\n  help: choose {}",
            method.id(),
            dataset.dir().display(),
            registry::that(|can| can.fixed_array)
        );
    }
    let (has, needs) = (dataset.modalities(), method.needs());
    for (missing, what, flag) in
        [(needs.light && !has.light, "images", "--images or another --from"), (needs.radio && !has.radio, "spectra", "--rf")]
    {
        if missing {
            bail!(
                "{} needs {what}, and {} has none\n  help: import the capture with them (`corf dataset import`, {flag}), or choose corf-gs, \
                 nearest or inverse-distance",
                method.id(),
                dataset.dir().display()
            );
        }
    }
    let (count, least) = (split.train.len(), method.least_keyframes());
    if count < least {
        bail!(
            "{} needs at least {}, the dataset has {count}\n  help: generate more keyframes, or hold fewer out \
             (split.test_every)",
            method.id(),
            counted(least, "training keyframe")
        );
    }
    Ok(())
}

/// Runs a method on what a split trains with, on the harness's clock; `quality` is evaluated beside the clock.
///
/// # Errors
/// The method's errors; a dataset without training keyframes.
pub fn reconstruct(
    method: &dyn Method,
    dataset: &Dataset,
    split: &Split,
    seed: u64,
    quality: Option<&mut QualityWatch<'_>>,
    watch: &mut dyn FnMut(Advance<'_>) -> Result<()>,
) -> Result<Reconstruction> {
    check_training(method, dataset, split)?;
    let training = TrainingSet::new(dataset, split);
    training.read_ahead(method.reads_light());
    clocked(|advance| method.reconstruct(&training, seed, advance), &|| training.loading_time(), quality, watch)
}

/// Runs a reconstruction on the harness's clock; `idle` is the time so far that is none of its work, and what `quality` takes is none either.
///
/// # Errors
/// The reconstruction's.
pub fn clocked(
    work: impl FnOnce(&mut dyn FnMut(Advance<'_>) -> Result<()>) -> Result<Box<dyn Predictor>>,
    idle: &dyn Fn() -> Duration,
    mut quality: Option<&mut QualityWatch<'_>>,
    watch: &mut dyn FnMut(Advance<'_>) -> Result<()>,
) -> Result<Reconstruction> {
    reset_peak_memory();
    device::reset_peak_memory();
    let (mut curve, mut keyframes, mut depth) = (Vec::new(), Vec::new(), None);
    let (mut stages, mut training_times, mut resumed_steps) = (Vec::new(), None, 0);
    let (start, processor_before) = (Instant::now(), processor_s());
    let mut evaluating = Duration::ZERO;
    let seconds_but = |evaluating: Duration| start.elapsed().saturating_sub(idle() + evaluating).as_secs_f64();
    let mut predictor = work(&mut |advance: Advance<'_>| {
        let seconds = seconds_but(evaluating);
        let held_out = match &mut quality {
            Some(quality) => {
                let begun = Instant::now();
                let held_out = quality.look(&advance)?;
                evaluating += begun.elapsed();
                held_out
            }
            None => None,
        };
        curve.push(CurvePoint {
            seconds,
            progress: advance.done as f64 / advance.total.max(1) as f64,
            gaussians: advance.gaussians,
            held_out,
        });
        keyframes.extend(advance.keyframe);
        depth = advance.depth.or(depth);
        if !advance.stages.is_empty() {
            stages = advance.stages.to_vec();
        }
        training_times = advance.training_times.cloned().or(training_times.take());
        resumed_steps = advance.resumed_steps.max(resumed_steps);
        watch(advance)
    })?;
    let seconds = seconds_but(evaluating);
    let (peak_memory_bytes, peak_device_memory_bytes) = (peak_memory_bytes(), device::peak_memory_bytes());
    let processor_s = processor_s().zip(processor_before).map(|(after, before)| after - before);
    if let Some(quality) = quality {
        // The finished field, as `corf evaluate` will find it; what was said at the end of the work is of the same moment.
        let held_out = Some(quality.of(predictor.as_mut())?);
        curve.retain(|point| point.progress < 1.0);
        curve.push(CurvePoint { seconds, progress: 1.0, gaussians: predictor.gaussians(), held_out });
    }
    Ok(Reconstruction {
        predictor,
        seconds,
        curve,
        peak_memory_bytes,
        peak_device_memory_bytes,
        processor_s,
        keyframes,
        depth,
        stages,
        training_times,
        resumed_steps,
    })
}

/// The part of a record that its maker has to say: a method, or another program's predictions.
struct Maker {
    method: String,
    config: serde_json::Value,
    device: String,
    uses_ground_truth_depth: bool,
    uses_scene: bool,
    clock: &'static str,
}

impl Maker {
    fn record(self, row: &str, input: &Input, protocol: Protocol, seed: u64, outcome: Outcome) -> Record {
        let dataset = &input.dataset;
        Record {
            schema: SCHEMA.to_owned(),
            protocol: PROTOCOL.to_owned(),
            split: protocol,
            row: row.to_owned(),
            method: self.method,
            config: self.config,
            dataset: dataset.header().name.clone(),
            dataset_hash: dataset.hash().to_owned(),
            dataset_verified: input.verified,
            seed,
            cell: None,
            provenance: Provenance::here(),
            lpips_weights: input.networks.sha256(),
            lpips_device: input.networks.device(),
            device: self.device,
            uses_ground_truth_depth: self.uses_ground_truth_depth,
            uses_scene: self.uses_scene,
            depth_imported: self.uses_ground_truth_depth && dataset.header().imported.is_some(),
            clock: self.clock.to_owned(),
            outcome,
        }
    }
}

/// The record of another program's predictions: what it is of is theirs to say, what it measures was measured here.
pub fn folder_record(
    row: &str,
    folder: &PredictionFolder,
    input: &Input,
    protocol: Protocol,
    seed: u64,
    frames: Vec<FrameMetrics>,
) -> Record {
    let stated = folder.statement();
    let numbers = Numbers::of(frames, stated.seconds, stated.gaussians, None, Vec::new(), None);
    let maker = Maker {
        method: PREDICTIONS.to_owned(),
        config: folder.config(),
        device: stated.device.clone().unwrap_or_else(|| NOT_STATED.to_owned()),
        uses_ground_truth_depth: stated.uses_ground_truth_depth.unwrap_or(false),
        uses_scene: stated.uses_scene.unwrap_or(false),
        clock: STATED_CLOCK,
    };
    maker.record(row, input, protocol, seed, Outcome::Done(Box::new(numbers)))
}

/// A cell's record around its outcome.
pub fn record(row: &str, method: &dyn Method, input: &Input, protocol: Protocol, seed: u64, outcome: Outcome) -> Record {
    let maker = Maker {
        method: method.id().to_owned(),
        config: method.config(),
        device: method.device(),
        uses_ground_truth_depth: method.uses_ground_truth_depth(),
        uses_scene: method.uses_scene(),
        clock: CLOCK,
    };
    maker.record(row, input, protocol, seed, outcome)
}

/// Runs a whole cell; a method that fails gives a record that says so. `look` sees every prediction beside its truth, `keep` then the
/// reconstruction.
///
/// # Errors
/// An interrupt; a failing method is an outcome.
pub fn run_cell(
    row: &str,
    method: &dyn Method,
    input: &Input,
    split: &Split,
    seed: u64,
    mut quality: Option<QualityWatch<'_>>,
    watch: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    look: impl FnMut(&Keyframe, &Prediction) -> Result<()>,
    keep: impl FnOnce(&Reconstruction) -> Result<()>,
) -> Result<Record> {
    let checked = method.check_files(&TrainingSet::new(&input.dataset, split));
    let outcome =
        checked.and_then(|()| reconstruct(method, &input.dataset, split, seed, quality.as_mut(), watch)).and_then(|mut r| {
            let frames = evaluate(r.predictor.as_mut(), input, split, look)?;
            keep(&r)?;
            let latency = LatencySummary::of(&r.keyframes);
            let numbers = Numbers::of(frames, Some(r.seconds), r.predictor.gaussians(), r.peak_memory_bytes, r.curve, latency)
                .with_device_memory(r.peak_device_memory_bytes)
                .with_depth(r.depth)
                .with_stages(r.stages);
            numbers.check()?;
            Ok(Outcome::Done(Box::new(numbers)))
        });
    let outcome = match outcome {
        Err(error) if error.is::<Interrupted>() => return Err(error),
        other => other.unwrap_or_else(|error| Outcome::Failed { error: format!("{error:#}") }),
    };
    Ok(record(row, method, input, split.protocol, seed, outcome))
}
