//! The online update operator U (paper Eq. (9)): expand the field where a new keyframe needs it, then optimise.

mod expand;

use crate::{
    Device, Error, Field, FieldMeta, Prediction, Result,
    config::{Coupling, ReconstructionConfig, SecondStageOpacity},
    depth::{self, DepthPrior, GreyView},
    device::{Planes, Step, StepReport},
    schedule::{Schedule, StageWeights},
    sensor::RfSensor,
};
use corf_scene::{Keyframe, Pinhole, Raster, Rigid3, keyframe::DbRange};
use std::collections::VecDeque;
use std::ops::ControlFlow;

/// How many of the latest keyframes are kept for matching; older ones hardly overlap, and a 1600×900 keyframe is 6 MB of grey values.
const MATCHING_WINDOW: usize = 32;
/// The mean baseline of the world in which the published constants hold.
const PUBLISHED_BASELINE: f64 = 0.1;
/// Least mean baseline assumed, metres: a platform that stands still must not freeze the geometry.
const LEAST_BASELINE_M: f64 = 1e-3;
/// Steps handed to the device at once where the policy does not need it back in between.
const BATCH: usize = 75;

/// What one pushed keyframe changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct KeyframeReport {
    /// Index along the trajectory of the pushed keyframe.
    pub index: usize,
    /// Keyframes expanded by this push: 0 while the first ones are collected, several when they are complete, then 1.
    pub keyframes_expanded: usize,
    /// Pixels drawn.
    pub sampled: usize,
    /// Gaussians added.
    pub spawned: usize,
    /// Gaussians that gave way to accurate new samples.
    pub replaced: usize,
    /// Gaussians pruned for opacity or size.
    pub pruned: usize,
    /// Gaussians afterwards.
    pub gaussians: usize,
    /// Share of the added Gaussians whose depth is an accurate match or a triangulated corner.
    pub accurate_share: f64,
    /// Triangulated corners.
    pub triangulated: usize,
    /// Whether the dense prior could be aligned (false also where there is no prior).
    pub prior_aligned: bool,
    /// Optimisation steps run.
    pub steps: usize,
    /// Unweighted optical loss of the last step.
    pub optical_loss: f32,
    /// Unweighted RF loss of the last step.
    pub rf_loss: f32,
    /// Unweighted depth loss of the last step, 1/m.
    pub depth_loss: f32,
    /// Whether ground-truth depth was consumed (by the simulated prior).
    pub ground_truth_depth_used: bool,
}

/// A keyframe that was received and not expanded yet.
struct Pending {
    index: usize,
    world_from_camera: Rigid3,
    optical: Planes,
    rf: Planes,
    prior: Option<Raster<f32>>,
}

/// Reconstructs a coupled field from keyframes pushed in order.
///
/// Push training keyframes only: whatever is pushed is sampled, matched, and optimised. Results depend on the keyframes, the configuration and
/// the seed, not on threads.
pub struct Reconstructor {
    device: Box<dyn Device>,
    config: ReconstructionConfig,
    meta: FieldMeta,
    seed: u64,
    prior: DepthPrior,
    views: VecDeque<GreyView>,
    pending: VecDeque<Pending>,
    schedule: Schedule,
    /// Per Gaussian: keyframes expanded before it was born.
    born: Vec<u32>,
    keyframes_expanded: u32,
    last_pose: Option<(usize, Rigid3)>,
    baselines_m: Vec<f64>,
    typical_depth_m: f64,
    finished: bool,
}

impl Reconstructor {
    /// An empty field. The cameras are those of every keyframe to come, `db_range` the whole dataset's.
    ///
    /// # Errors
    /// A configuration out of range, cameras without pixels, an empty dB range, or a device that already holds Gaussians or was not made with
    /// [`ReconstructionConfig::empty_field`].
    pub fn new(
        mut device: Box<dyn Device>,
        config: ReconstructionConfig,
        optical_camera: Pinhole,
        rf_camera: Pinhole,
        db_range: DbRange,
        seed: u64,
    ) -> Result<Self> {
        config.validate()?;
        let meta = FieldMeta { rf_target: config.rf_target, db_range, optical_camera, rf_camera, sensor: RfSensor::Identity };
        meta.validate()?;
        if !device.is_empty() {
            return Err(Error::invalid(
                device.name(),
                "the device already holds Gaussians",
                "start every reconstruction on a fresh device",
            ));
        }
        if device.gaussians() != config.empty_field() {
            return Err(Error::invalid(
                device.name(),
                "the device was made for other channels or harmonic degrees than the configuration's",
                "make it with ReconstructionConfig::empty_field",
            ));
        }
        // The smallest pyramid level must still be an image.
        let coarsest = config.pyramid_levels - 1;
        for (name, camera) in [("optical", &optical_camera), ("RF", &rf_camera)] {
            if camera.width >> coarsest < 8 || camera.height >> coarsest < 8 {
                return Err(Error::invalid(
                    "reconstruction config, key `pyramid_levels`",
                    format!("level {coarsest} of the {}x{} {name} image is below 8 pixels", camera.width, camera.height),
                    "use fewer levels or larger images",
                ));
            }
        }
        if optical_camera.width.saturating_mul(optical_camera.height) > depth::patch::MAX_PIXELS {
            let what = format!("{}x{} pixels are more than 2^24", optical_camera.width, optical_camera.height);
            return Err(Error::invalid("the optical camera", what, "reconstruct from smaller images"));
        }
        Ok(Self {
            prior: DepthPrior::new(&config.depth, seed),
            typical_depth_m: (config.depth.near_m * config.depth.far_m).sqrt(),
            schedule: Schedule::new(seed, config.rf_target.floor_color()),
            device,
            config,
            meta,
            seed,
            views: VecDeque::new(),
            pending: VecDeque::new(),
            born: Vec::new(),
            keyframes_expanded: 0,
            last_pose: None,
            baselines_m: Vec::new(),
            finished: false,
        })
    }

    /// Receives `K_t`: expands the field and optimises it. The first `bootstrap_keyframes − 1` keyframes are only collected.
    ///
    /// # Errors
    /// A keyframe of the wrong size, out of order, with a pose that is not finite, or without the depth the prior needs; the device's errors.
    pub fn push(&mut self, keyframe: &Keyframe) -> Result<KeyframeReport> {
        self.receive(keyframe)?;
        let mut report = self.report(keyframe.index);
        if self.keyframes_expanded > 0 || self.pending.len() >= self.config.bootstrap_keyframes {
            self.process_pending(&mut report)?;
        }
        Ok(report)
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
        if self.finished {
            return Ok(report);
        }
        self.process_pending(&mut report)?;
        self.finished = true;
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
        let weights = if self.config.coupling == Coupling::Joint { self.online_weights() } else { self.second_stage_weights() };
        let mut last = StepReport::default();
        for epoch in 0..epochs {
            let steps = self.schedule.epoch(weights, &self.config);
            last = self.device.train(&steps)?;
            if progress(epoch + 1, epochs).is_break() {
                return Err(Error::Stopped);
            }
        }
        Ok(last)
    }

    /// The field as it stands: reads the Gaussians back.
    pub fn field(&mut self) -> Field {
        Field { gaussians: self.device.gaussians(), meta: self.meta }
    }

    /// Renders the field as it stands at any pose.
    ///
    /// # Errors
    /// The device's.
    pub fn render(&mut self, world_from_camera: Rigid3) -> Result<Prediction> {
        self.meta.render(self.device.as_mut(), world_from_camera)
    }

    /// How many Gaussians there are.
    pub fn gaussian_count(&self) -> usize {
        self.device.len()
    }

    /// Cameras, target and dB range.
    pub fn meta(&self) -> &FieldMeta {
        &self.meta
    }

    fn report(&self, index: usize) -> KeyframeReport {
        KeyframeReport {
            index,
            gaussians: self.device.len(),
            ground_truth_depth_used: self.prior.consumes_ground_truth_depth(),
            ..KeyframeReport::default()
        }
    }

    /// Checks a keyframe and keeps what its expansion will need.
    fn receive(&mut self, keyframe: &Keyframe) -> Result<()> {
        let place = || format!("keyframe {}", keyframe.index);
        if self.finished {
            return Err(Error::invalid(place(), "the sequence has ended", "push every keyframe before Reconstructor::finish"));
        }
        check_size(&place(), "optical image", (keyframe.image.width(), keyframe.image.height()), &self.meta.optical_camera)?;
        check_size(&place(), "spectrum", (keyframe.spectrum.width(), keyframe.spectrum.height()), &self.meta.rf_camera)?;
        if let Some(depth) = &keyframe.depth_m {
            check_size(&place(), "depth", (depth.width(), depth.height()), &self.meta.optical_camera)?;
        }
        if let Some(surface) = &keyframe.surface {
            check_size(&place(), "surface index", (surface.width(), surface.height()), &self.meta.optical_camera)?;
        }
        let pose = &keyframe.world_from_camera;
        if !pose.translation.is_finite() || !pose.rotation.is_finite() {
            return Err(Error::invalid(place(), "the pose is not finite", "remove or repair this keyframe"));
        }
        if let Some(i) = keyframe.spectrum.pixels().iter().position(|s| !s.is_finite() || *s < 0.0) {
            let (w, value) = (keyframe.spectrum.width(), keyframe.spectrum.pixels()[i]);
            let what = format!("the spectrum is {value} at row {}, column {}", i / w, i % w);
            return Err(Error::invalid(place(), what, "linear power per steradian is finite and not negative"));
        }
        if let Some((last, _)) = self.last_pose.filter(|l| l.0 >= keyframe.index) {
            let what = format!("it arrived after keyframe {last}");
            return Err(Error::invalid(place(), what, "push keyframes once each, in trajectory order"));
        }
        let prior = self.prior.estimate(keyframe)?;
        if let Some((_, last)) = self.last_pose
            && self.baselines_m.len() < self.config.scale_baselines
        {
            self.baselines_m.push((pose.translation - last.translation).length());
        }
        self.last_pose = Some((keyframe.index, *pose));
        if self.views.len() == MATCHING_WINDOW {
            self.views.pop_front();
        }
        self.views.push_back(GreyView::new(keyframe.index, &keyframe.image, self.meta.optical_camera, *pose));
        let optical = Planes {
            width: keyframe.image.width(),
            height: keyframe.image.height(),
            channels: 3,
            pixels: keyframe.image.pixels().iter().flat_map(|c| c.map(|v| f32::from(v) / 255.0)).collect(),
        };
        let rf = self.config.rf_target.encode(&keyframe.spectrum, &self.meta.db_range);
        self.pending.push_back(Pending { index: keyframe.index, world_from_camera: *pose, optical, rf, prior });
        Ok(())
    }

    /// Expands and optimises with every keyframe that waits, in order.
    fn process_pending(&mut self, report: &mut KeyframeReport) -> Result<()> {
        self.apply_world_scale();
        let (mut accurate, mut spawned) = (0, 0);
        while let Some(pending) = self.pending.pop_front() {
            let expansion = self.expand(&pending)?;
            accurate += expansion.accurate;
            spawned += expansion.spawned;
            report.sampled += expansion.sampled;
            report.replaced += expansion.replaced;
            report.pruned += expansion.pruned;
            report.triangulated += expansion.triangulated;
            report.prior_aligned = expansion.prior_aligned;
            report.keyframes_expanded += 1;
            let count = self.config.iterations_per_keyframe;
            let steps = self.schedule.online(count, self.config.latest_probability, self.online_weights(), &self.config);
            self.train(&steps, report)?;
        }
        report.spawned += spawned;
        report.accurate_share = if spawned > 0 { accurate as f64 / spawned as f64 } else { 0.0 };
        report.gaussians = self.device.len();
        Ok(())
    }

    /// The published constants hold where the mean of the first baselines is 0.1; metres are kept, so the constants are rescaled.
    fn apply_world_scale(&mut self) {
        if self.baselines_m.is_empty() {
            return;
        }
        let mean = self.baselines_m.iter().sum::<f64>() / self.baselines_m.len() as f64;
        let metres_per_unit = (mean.max(LEAST_BASELINE_M) / PUBLISHED_BASELINE) as f32;
        self.device.set_position_rate_m(self.config.position_rate * metres_per_unit);
        // An inverse depth of 1/m is `metres_per_unit` of theirs.
        self.schedule.set_depth_weight(self.config.depth_weight * metres_per_unit);
    }

    fn online_weights(&self) -> StageWeights {
        let rf = if self.config.coupling == Coupling::Joint { self.config.rf_weight } else { 0.0 };
        StageWeights { optical: 1.0, rf, depth: true, geometry: true }
    }

    fn second_stage_weights(&self) -> StageWeights {
        // The loss has one term, and Adam is blind to a common factor: its weight is 1.
        StageWeights { optical: 0.0, rf: 1.0, depth: false, geometry: self.config.coupling == Coupling::RfTuned }
    }

    /// Radio on a geometry learnt from light.
    fn second_stage(
        &mut self,
        report: &mut KeyframeReport,
        progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<()> {
        // No step has touched the RF appearance: colour and opacity are those the Gaussians were born with.
        let field = self.device.gaussians();
        let mut rf = field.rf;
        if self.config.second_stage_opacity == SecondStageOpacity::Optical {
            rf.opacity_logit = field.optical.opacity_logit;
        }
        self.device.reset_rf(&rf);
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
        (report.optical_loss, report.rf_loss, report.depth_loss) = (last.optical_loss, last.rf_loss, last.depth_loss);
        Ok(())
    }
}

fn check_size(place: &str, what: &str, got: (usize, usize), camera: &Pinhole) -> Result<()> {
    if got == (camera.width, camera.height) {
        return Ok(());
    }
    Err(Error::invalid(
        place,
        format!("the {what} is {}x{} and the camera says {}x{}", got.0, got.1, camera.width, camera.height),
        "all keyframes of a sequence share the cameras it was opened with",
    ))
}

#[cfg(test)]
mod end_to_end;
#[cfg(test)]
mod tests;
