//! The online update operator U (paper Eq. (9)): expand the field where a new keyframe needs it, then optimise.

mod admit;
mod checkpoint;
mod expand;
mod latency;
mod pipeline;
mod prepare;
mod radio_on_geometry;
mod report;
pub mod schedule;

pub use checkpoint::Checkpoint;
pub use latency::{KeyframeTiming, LatencySummary, Percentiles};
pub use radio_on_geometry::RadioOnGeometry;
pub use report::KeyframeReport;

use crate::{
    Device, Error, Field, FieldMeta, FieldRendering, Gaussians, Result,
    config::{Coupling, MatchedOn, ReconstructionConfig, SecondStageOpacity},
    depth::{self, Correction, DepthQuality, DepthTally, ProcessorMatcher},
    device::{Step, StepReport},
    reconstructor::schedule::{Schedule, StageWeights},
};
use checkpoint::Replay;
use corf_scene::{
    Keyframe, Pinhole, Rigid3,
    keyframe::{DbRange, Modalities},
};
use pipeline::KeyframePipeline;
use prepare::{Means, Preparer};
use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The mean baseline of the world in which the published constants hold.
const PUBLISHED_BASELINE: f64 = 0.1;
/// Least mean baseline assumed, metres: a platform that stands still must not freeze the geometry.
const LEAST_BASELINE_M: f64 = 1e-3;
/// Keyframes that wait, or are prepared, while the field is expanded with another.
const PREPARED_AT_ONCE: usize = 8;
/// Steps handed to the device at once where the policy does not need it back in between.
const BATCH: usize = 75;

/// Record of a keyframe that was expanded, kept for checkpoints.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
struct Past {
    index: usize,
    /// Scale and offset of its aligned prior.
    alignment: Option<[f32; 2]>,
    /// Local correction of the aligned prior, if one was fitted.
    correction: Option<Correction>,
    /// Typical depth of the scene after it.
    typical_depth_m: f64,
}

/// Reconstructs a coupled field from keyframes received in order.
///
/// Give it training keyframes only: whatever is received is sampled, matched, and optimised. Results depend on the keyframes, the
/// configuration and the seed, not on threads, and not on how many keyframes are received ahead.
pub struct Reconstructor {
    device: Box<dyn Device>,
    config: ReconstructionConfig,
    meta: FieldMeta,
    seed: u64,
    /// Received, not expanded, and when they were received.
    ahead: KeyframePipeline,
    arrivals: VecDeque<Instant>,
    schedule: Schedule,
    /// Per Gaussian: keyframes expanded before it was born.
    born: Vec<u32>,
    keyframes_expanded: u32,
    past: Vec<Past>,
    /// Keyframes of a checkpoint that have not come again.
    replay: Option<Replay>,
    keyframes_received: usize,
    last_pose: Option<(usize, Rigid3)>,
    /// What keyframes have, all of them: the first says it.
    modalities: Option<Modalities>,
    baselines_m: Vec<f64>,
    timings: Vec<KeyframeTiming>,
    depth_tally: DepthTally,
    /// When the latest keyframe's steps, but for its late ones, had been taken.
    trained: Option<Instant>,
    /// Seconds of survey, decision and change of all expansions.
    expanding_s: [f64; 3],
    finished: bool,
}

/// How many steps a keyframe gets.
enum Amount {
    Steps(usize),
    /// As many as there is time for.
    Until(Instant),
}

impl Amount {
    /// Steps between two looks at the clock.
    const BATCH: usize = 5;

    /// Takes the steps that `draw` gives, and says the last one's report and their number.
    fn train(&self, device: &mut dyn Device, draw: &mut dyn FnMut(usize) -> Vec<Step>) -> Result<(StepReport, usize)> {
        let end = match self {
            Self::Steps(count) => {
                let steps = draw(*count);
                return Ok((device.train(&steps)?, steps.len()));
            }
            Self::Until(end) => *end,
        };
        let (mut last, mut taken) = (StepReport::default(), 0);
        repeat_until(end, &mut || {
            let steps = draw(Self::BATCH);
            last = device.train(&steps)?;
            taken += steps.len();
            Ok(if steps.is_empty() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })?;
        Ok((last, taken))
    }
}

/// Does something once, and again while one more like the last has ended by `end`, unless it is over.
fn repeat_until(end: Instant, once: &mut dyn FnMut() -> Result<ControlFlow<()>>) -> Result<()> {
    loop {
        let begin = Instant::now();
        let is_over = once()?.is_break();
        let now = Instant::now();
        if is_over || now + (now - begin) > end {
            return Ok(());
        }
    }
}

impl Reconstructor {
    /// An empty field. The cameras are those of every keyframe to come, `db_range` the whole dataset's. In a capture without light
    /// [growth is guided](crate::keyframe::guide) by spectra, and both cameras are theirs; in one without radio `rf_camera` is any,
    /// `db_range` is [`FieldMeta::RANGE_WITHOUT_RADIO`], and `rf_weight` 0.
    ///
    /// # Errors
    /// A configuration out of range, a depth prior whose files cannot be used, cameras without pixels, an empty dB range, or a device that already
    /// holds Gaussians or was not made with [`ReconstructionConfig::empty_field`].
    pub fn new(
        mut device: Box<dyn Device>,
        mut config: ReconstructionConfig,
        light_camera: Pinhole,
        radio_camera: Pinhole,
        db_range: DbRange,
        seed: u64,
    ) -> Result<Self> {
        config.validate()?;
        config = config.for_images(light_camera.width, light_camera.height);
        let radio_target = config.radio_target;
        let meta = FieldMeta {
            radio_target,
            db_range,
            light_camera,
            radio_camera,
            radio_background: None,
            modalities: Modalities::BOTH,
        };
        meta.validate()?;
        if !device.is_empty() {
            return Err(Error::invalid(
                device.name(),
                "the device already holds Gaussians",
                "start every reconstruction on a fresh device",
            ));
        }
        if device.gaussians()? != config.empty_field() {
            return Err(Error::invalid(
                device.name(),
                "the device was made for other channels or harmonic degrees than the configuration's",
                "make it with ReconstructionConfig::empty_field",
            ));
        }
        Self::check_cameras(&config, &light_camera, &radio_camera)?;
        let background = (!device.trains_on_the_host()).then(rayon::current_num_threads);
        let matcher = if config.depth.matched_on == MatchedOn::Device { device.matcher()? } else { None };
        // Where steps are taken during an expansion, what it needs of the processor can wait for it.
        let eager = background.is_some() && (config.overlapped_iterations() == 0 || matcher.is_some());
        let matcher = matcher.unwrap_or_else(|| Arc::new(ProcessorMatcher));
        let preparer = Preparer::new(&config, &meta, seed, Means { packer: device.packer(), matcher, eager })?;
        Ok(Self {
            ahead: KeyframePipeline::new(preparer, prepare::Past::new(&config), background),
            schedule: Schedule::new(seed, config.radio_target.floor_color()),
            device,
            config,
            meta,
            seed,
            arrivals: VecDeque::new(),
            born: Vec::new(),
            keyframes_expanded: 0,
            past: Vec::new(),
            replay: None,
            keyframes_received: 0,
            last_pose: None,
            modalities: None,
            baselines_m: Vec::new(),
            timings: Vec::new(),
            depth_tally: DepthTally::default(),
            trained: None,
            expanding_s: [0.0; 3],
            finished: false,
        })
    }

    /// Checks that images and spectra of these cameras can be reconstructed with a configuration.
    ///
    /// # Errors
    /// A pyramid whose smallest level is no image any more; images with more pixels than patches can be numbered.
    pub fn check_cameras(config: &ReconstructionConfig, light_camera: &Pinhole, radio_camera: &Pinhole) -> Result<()> {
        // The smallest pyramid level that steps look at must still be an image.
        let config = config.clone().for_images(light_camera.width, light_camera.height);
        let of_light = config.pyramid_levels;
        let (of_radio, radio_key) =
            config.radio_pyramid_levels.map_or((of_light, "pyramid_levels"), |n| (n.min(of_light), "rf_pyramid_levels"));
        for (name, key, levels, camera) in
            [("optical", "pyramid_levels", of_light, light_camera), ("RF", radio_key, of_radio, radio_camera)]
        {
            let coarsest = levels - 1;
            if camera.width >> coarsest < 8 || camera.height >> coarsest < 8 {
                return Err(Error::invalid(
                    format!("reconstruction config, key `{key}`"),
                    format!("level {coarsest} of the {}x{} {name} image is below 8 pixels", camera.width, camera.height),
                    if name == "RF" {
                        "use fewer levels (rf_pyramid_levels) or larger spectra"
                    } else {
                        "use fewer levels or larger images"
                    },
                ));
            }
        }
        if light_camera.width.saturating_mul(light_camera.height) > depth::patch::MAX_PIXELS {
            let what = format!("{}x{} pixels are more than 2^24", light_camera.width, light_camera.height);
            return Err(Error::invalid("the optical camera", what, "reconstruct from smaller images"));
        }
        Ok(())
    }

    /// Begins with Gaussians that are there already, of the channels and degrees of [`ReconstructionConfig::empty_field`]: the first keyframe adds to
    /// them what they lack.
    ///
    /// # Errors
    /// After the first keyframe; Gaussians that are incomplete; the device's errors.
    pub fn begin_with(&mut self, gaussians: &Gaussians) -> Result<()> {
        if self.keyframes_received > 0 || !self.device.is_empty() {
            let help = "give a fresh reconstruction the Gaussians that it begins with";
            return Err(Error::invalid("the reconstruction", "it has begun already", help));
        }
        self.device.append(gaussians)?;
        self.born.resize(self.device.len(), 0);
        Ok(())
    }

    /// Receives `K_t` and processes whatever waits: expands the field and optimises it. The first `bootstrap_keyframes − 1` keyframes are
    /// only collected. A caller that knows the next keyframe already does better with [`Self::receive`] and [`Self::process`].
    ///
    /// # Errors
    /// A keyframe of the wrong size, out of order, with other modalities than those before it, with a pose that is not finite, or without
    /// the depth or map the prior needs; the device's errors.
    pub fn push(&mut self, keyframe: &Keyframe) -> Result<KeyframeReport> {
        self.receive(keyframe.clone())?;
        let mut report = self.report(keyframe.index);
        while let Some(one) = self.process()? {
            report.absorb(&one);
        }
        Ok(report)
    }

    /// Takes `K_t` into the queue. What its expansion needs beside the field is prepared on other threads while [`Self::process`] works on
    /// those before it, if it is received by then.
    ///
    /// # Errors
    /// A keyframe of the wrong size, out of order, with other modalities than those before it, with a pose that is not finite, or without
    /// the depth or map the prior needs.
    pub fn receive(&mut self, keyframe: Keyframe) -> Result<()> {
        self.receive_at(keyframe, Instant::now())
    }

    /// The same for a keyframe that arrived before, from when on it counts as waiting.
    ///
    /// # Errors
    /// Those of [`Self::receive`]; the sequence is then as it was.
    pub fn receive_at(&mut self, keyframe: Keyframe, arrived: Instant) -> Result<()> {
        if self.replay.is_some() {
            let what = "the checkpoint's keyframes have not been replayed";
            return Err(Error::invalid(
                format!("keyframe {}", keyframe.index),
                what,
                "call Reconstructor::replay with each of them",
            ));
        }
        self.admit(&keyframe)?;
        self.arrivals.push_back(arrived);
        self.ahead.receive(keyframe);
        Ok(())
    }

    /// Largest useful number of keyframes to receive before [`Self::process`] is called for the earliest: more would only take memory.
    pub fn worth_receiving(&self) -> usize {
        if self.device.trains_on_the_host() { 2 } else { PREPARED_AT_ONCE }
    }

    /// Takes time off the waiting of all keyframes received so far, in which the caller was busy with something else, such as reading files.
    pub fn discount_wait(&mut self, idle: Duration) {
        self.arrivals.iter_mut().for_each(|at| *at += idle);
    }

    /// Number of received keyframes that [`Self::process`] could expand now: none while the first ones are collected.
    pub fn waiting(&self) -> usize {
        let collecting = self.keyframes_received < self.config.bootstrap_keyframes && !self.finished;
        if collecting { 0 } else { self.ahead.waiting() }
    }

    /// Whether [`Self::process`] would begin at once: a keyframe waits, and nothing of its preparation has to be waited for. Whoever has more to receive
    /// meanwhile asks first.
    pub fn is_ready(&mut self) -> bool {
        self.waiting() > 0 && {
            self.begin_associating();
            self.ahead.is_ready()
        }
    }

    /// The first keyframes are matched with each other.
    fn begin_associating(&mut self) {
        self.ahead.begin(self.config.bootstrap_keyframes.saturating_sub(self.past.len()));
    }

    /// Expands the field with the earliest keyframe that waits and optimises it, while the next one is prepared. `None` where none waits.
    ///
    /// # Errors
    /// The device's errors.
    pub fn process(&mut self) -> Result<Option<KeyframeReport>> {
        if self.waiting() == 0 {
            return Ok(None);
        }
        self.begin_associating();
        let (Some(received), Some(prepared)) = (self.arrivals.front().copied(), self.ahead.take()?) else { return Ok(None) };
        self.arrivals.pop_front();
        let begin = Instant::now();
        self.apply_world_scale();
        let (index, prepare_s) = (prepared.index, prepared.work_s);
        let expansion = self.expand(prepared)?;
        if let Some(late) = expansion.late {
            self.end_timing(late.ended);
        }
        let expanded = Instant::now();
        let amount = match self.config.keyframe_budget_ms {
            Some(ms) => Amount::Until(begin + Duration::from_secs_f64(ms / 1e3)),
            None => Amount::Steps(self.config.iterations_per_keyframe - self.config.overlapped_iterations()),
        };
        let weights = self.online_weights();
        let Self { device, ahead, schedule, config, .. } = self;
        let on_the_host = device.trains_on_the_host();
        let mut train = || {
            let mut draw = |count| schedule.online(count, config.latest_probability, weights, config);
            amount.train(device.as_mut(), &mut draw).map(|(last, steps)| (last, steps, Instant::now()))
        };
        let (trained, ()) = if on_the_host { rayon::join(train, || ahead.prepare_one()) } else { (train(), ()) };
        let (last, steps, trained) = trained?;
        let timing = KeyframeTiming {
            index,
            wait_s: begin.saturating_duration_since(received).as_secs_f64(),
            prepare_s,
            match_s: expansion.matching.waited_s,
            match_device_s: expansion.matching.device_s,
            expand_s: (expanded - begin).as_secs_f64(),
            train_s: (trained - expanded).as_secs_f64(),
            late_s: 0.0,
            steps: self.config.keyframe_budget_ms.map(|_| steps),
        };
        self.timings.push(timing);
        self.trained = Some(trained);
        let late = expansion.late.filter(|_| steps == 0);
        let mut report = KeyframeReport { keyframes_expanded: 1, ..self.report(index) };
        report.steps = expansion.late.map_or(0, |l| l.steps) + steps;
        report.set_losses(&late.map_or(last, |l| l.last));
        report.set_expansion(&expansion);
        Ok(Some(report))
    }

    /// The latest keyframe's last steps have ended.
    fn end_timing(&mut self, at: Instant) {
        if let (Some(timing), Some(trained)) = (self.timings.last_mut(), self.trained) {
            timing.late_s = at.saturating_duration_since(trained).as_secs_f64();
        }
    }

    /// Takes the steps that the last keyframe has left to be taken while another is expanded, and none has come.
    fn take_late_steps(&mut self, report: &mut KeyframeReport) -> Result<()> {
        let late = self.online_steps(self.config.overlapped_iterations());
        if !late.is_empty() {
            self.train(&late, report)?;
            self.end_timing(Instant::now());
        }
        Ok(())
    }

    /// When each keyframe expanded so far was waiting, expanded and trained with, in order. The latest is missing while it has steps left to
    /// be taken while another is expanded.
    pub fn timings(&self) -> &[KeyframeTiming] {
        let open = self.config.overlapped_iterations() > 0 && !self.finished;
        &self.timings[..self.timings.len() - usize::from(open && !self.timings.is_empty())]
    }

    /// Errors of the depths of all new Gaussians, where keyframes carried the true depth; after a checkpoint, of those that followed it.
    pub fn depth_quality(&self) -> Option<DepthQuality> {
        self.depth_tally.quality()
    }

    /// Ends the sequence: expands keyframes still waiting and runs the second stage of a two-stage coupling, which repeats the
    /// first one's steps with the RF loss. `progress(done, total)` is called as steps complete and may end the work.
    ///
    /// # Errors
    /// When nothing was pushed; the device's errors; [`Error::Stopped`] when `progress` breaks.
    pub fn finish(&mut self, progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>) -> Result<KeyframeReport> {
        let Some((index, _)) = self.last_pose else {
            return Err(Error::invalid("the reconstruction", "no keyframe was pushed", "push at least two training keyframes"));
        };
        let mut report = self.report(index);
        if self.finished && self.waiting() == 0 {
            return Ok(report);
        }
        self.finished = true;
        while let Some(one) = self.process()? {
            report.absorb(&one);
        }
        self.take_late_steps(&mut report)?;
        if self.config.coupling != Coupling::Joint {
            self.second_stage(&mut report, progress)?;
        }
        Ok(report)
    }

    /// Offline fine-tuning over all keyframes at full resolution; `epochs` times every keyframe once, in random order (the unit of the paper's
    /// fine-tuning table). A two-stage coupling fine-tunes what its second stage trains.
    ///
    /// # Errors
    /// Before [`Self::finish`]; the device's errors; [`Error::Stopped`] when `progress` breaks.
    pub fn fine_tune(&mut self, epochs: usize, progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>) -> Result<StepReport> {
        if !self.finished {
            return Err(Error::invalid("fine-tuning", "the sequence has not ended", "call Reconstructor::finish first"));
        }
        let mut last = StepReport::default();
        for epoch in 0..epochs {
            last = self.epoch()?;
            if progress(epoch + 1, epochs).is_break() {
                return Err(Error::Stopped);
            }
        }
        Ok(last)
    }

    /// The same for as long as `time` has room for another epoch like the one before, one at least; says how many there were. `progress` is
    /// told the time spent. The result depends on the machine and its load.
    ///
    /// # Errors
    /// Those of [`Self::fine_tune`].
    pub fn fine_tune_for(&mut self, time: Duration, progress: &mut dyn FnMut(Duration) -> ControlFlow<()>) -> Result<usize> {
        let (begin, mut epochs) = (Instant::now(), 0);
        repeat_until(begin + time, &mut || {
            self.fine_tune(1, &mut |_, _| ControlFlow::Continue(()))?;
            epochs += 1;
            match progress(begin.elapsed()) {
                ControlFlow::Break(()) => Err(Error::Stopped),
                ControlFlow::Continue(()) => Ok(ControlFlow::Continue(())),
            }
        })?;
        Ok(epochs)
    }

    /// Every keyframe once.
    fn epoch(&mut self) -> Result<StepReport> {
        let weights = if self.config.coupling == Coupling::Joint { self.online_weights() } else { self.second_stage_weights() };
        let steps = self.schedule.epoch(weights, &self.config);
        self.device.train(&steps)
    }

    /// The field as it stands, of what its keyframes have: reads the Gaussians back.
    ///
    /// # Errors
    /// The device's.
    pub fn field(&mut self) -> Result<Field> {
        let modalities = self.modalities.unwrap_or(self.meta.modalities);
        Ok(Field { gaussians: self.device.gaussians()?, meta: FieldMeta { modalities, ..self.meta } })
    }

    /// Renders the field as it stands at any pose.
    ///
    /// # Errors
    /// The device's.
    pub fn render(&mut self, world_from_camera: Rigid3) -> Result<FieldRendering> {
        self.meta.render(self.device.as_mut(), world_from_camera)
    }

    /// Number of Gaussians in the field.
    pub fn gaussian_count(&self) -> usize {
        self.device.len()
    }

    /// Memory that the device has taken at present, bytes, where it has memory of its own and counts it.
    pub fn device_memory_bytes(&self) -> Option<u64> {
        self.device.memory_bytes()
    }

    /// Number of keyframes that have been expanded.
    pub fn keyframes_expanded(&self) -> usize {
        self.past.len()
    }

    /// Cameras, target and dB range.
    pub fn meta(&self) -> &FieldMeta {
        &self.meta
    }

    fn report(&self, index: usize) -> KeyframeReport {
        KeyframeReport {
            index,
            gaussians: self.device.len(),
            ground_truth_depth_used: self.ahead.preparer().consumes_ground_truth_depth(),
            ..KeyframeReport::default()
        }
    }

    /// The published constants hold where the mean of the first baselines is 0.1; metres are kept, so the constants are rescaled.
    fn apply_world_scale(&mut self) {
        // Those up to the present keyframe, or up to the last of the first ones, whatever has been received ahead.
        let known = (self.past.len() + 1).max(self.config.bootstrap_keyframes) - 1;
        let baselines = &self.baselines_m[..known.min(self.baselines_m.len())];
        if baselines.is_empty() {
            return;
        }
        let mean = baselines.iter().sum::<f64>() / baselines.len() as f64;
        let metres_per_unit = (mean.max(LEAST_BASELINE_M) / PUBLISHED_BASELINE) as f32;
        self.device.set_position_rate_m(self.config.position_rate * metres_per_unit);
        // An inverse depth of 1/m is `metres_per_unit` of theirs.
        self.schedule.set_depth_weight(self.config.depth_weight * metres_per_unit);
    }

    /// The next steps, with the keyframes that have joined.
    fn online_steps(&mut self, count: usize) -> Vec<Step> {
        self.schedule.online(count, self.config.latest_probability, self.online_weights(), &self.config)
    }

    fn online_weights(&self) -> StageWeights {
        let radio = if self.config.coupling == Coupling::Joint { self.config.radio_weight } else { 0.0 };
        StageWeights { light: 1.0, radio, depth: true, geometry: true }
    }

    fn second_stage_weights(&self) -> StageWeights {
        // The loss has one term, and Adam is blind to a common factor: its weight is 1.
        StageWeights { light: 0.0, radio: 1.0, depth: false, geometry: self.config.coupling == Coupling::RadioTuned }
    }

    /// Radio on a geometry learnt from light.
    fn second_stage(
        &mut self,
        report: &mut KeyframeReport,
        progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<()> {
        // No step has touched the RF appearance: colour and opacity are those the Gaussians were born with.
        let field = self.device.gaussians()?;
        let mut radio = field.radio;
        if self.config.second_stage_opacity == SecondStageOpacity::Light {
            radio.opacity_logit = field.light.opacity_logit;
        }
        self.device.reset_radio(&radio)?;
        let (weights, total) = (self.second_stage_weights(), self.schedule.online_steps());
        let mut done = 0;
        while done < total {
            let steps = self.schedule.replay(done..(done + BATCH).min(total), weights);
            self.train(&steps, report)?;
            done += steps.len();
            if progress(done, total).is_break() {
                return Err(Error::Stopped);
            }
        }
        Ok(())
    }

    fn train(&mut self, steps: &[Step], report: &mut KeyframeReport) -> Result<()> {
        let last = self.device.train(steps)?;
        report.steps += steps.len();
        report.set_losses(&last);
        Ok(())
    }
}

#[cfg(test)]
mod end_to_end;
#[cfg(test)]
mod online_tests;
#[cfg(test)]
mod tests;
