//! Offline reconstruction in two stages from all keyframes at once: stock 3D Gaussian splatting with adaptive density control in light, then
//! opacity and colour at 60 GHz on the frozen geometry. This is the published baseline RF-3DGS; CORF-GS shares its devices and nothing else.
//!
//! A step depends on its number, the seed and the state of the device. Steps may be taken in portions of any size, and a reconstruction that goes on
//! from a checkpoint ends in the same bytes.

mod checkpoint;
mod config;
mod density;
mod nearest;
pub(crate) mod points;
mod schedule;

pub use checkpoint::Rf3dgsCheckpoint;
pub use config::{InitialPoints, RadioBackground, RadioMoments, Rf3dgsConfig, Rf3dgsRates};
use corf_scene::words::counted;
pub use density::{DensityChange, DensityConfig, DensityCounts, decide};
pub use points::{LEAST_POINTS, SparsePoint, write_ply};
pub use schedule::Rf3dgsSchedule;
pub(crate) use schedule::{Epochs, log_linear};

use corf::{
    Device, Error, Field, FieldMeta, Gaussians, Result,
    device::{Modality, StepReport},
};
use corf_scene::{Keyframe, Pinhole, Rigid3, keyframe::DbRange};
use points::PointView;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Seconds that the parts of a reconstruction took, summed over the sessions of one that was resumed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rf3dgsTimes {
    /// Finding the first Gaussians.
    pub points_s: f64,
    /// The optical stage.
    #[serde(rename = "optical_s")]
    pub light_s: f64,
    /// The RF stage.
    #[serde(rename = "rf_s")]
    pub radio_s: f64,
}

/// A reconstruction at work. Keyframes are [received](Self::receive) first, then it [begins](Self::begin) or is [restored](Self::restore), and
/// [trains](Self::train) until it is [done](Self::is_done).
pub struct Rf3dgsReconstructor {
    device: Box<dyn Device>,
    config: Rf3dgsConfig,
    meta: FieldMeta,
    seed: u64,
    poses: Vec<Rigid3>,
    /// Of the keyframes, until the first Gaussians are there.
    views: Vec<PointView>,
    points: Vec<SparsePoint>,
    /// What it is to begin with, in the place of points and the optical stage.
    given: Option<Gaussians>,
    schedule: Option<Rf3dgsSchedule>,
    extent_m: f64,
    /// Steps of both stages taken.
    done: usize,
    /// Whether the RF stage has taken over the geometry.
    radio_begun: bool,
    counts: DensityCounts,
    times: Rf3dgsTimes,
}

impl Rf3dgsReconstructor {
    /// Nothing received yet. The cameras are those of every keyframe to come, `db_range` the whole dataset's.
    ///
    /// # Errors
    /// A configuration out of range, cameras without pixels, an empty dB range, or a device that already holds Gaussians or was not made with
    /// [`Rf3dgsConfig::empty_field`].
    pub fn new(
        mut device: Box<dyn Device>,
        config: Rf3dgsConfig,
        light_camera: Pinhole,
        radio_camera: Pinhole,
        db_range: DbRange,
        seed: u64,
    ) -> Result<Self> {
        config.validate()?;
        let (radio_target, radio_background) = (Rf3dgsConfig::RADIO_TARGET, Some(config.radio_background_color()));
        let meta =
            FieldMeta { radio_target, db_range, light_camera, radio_camera, radio_background, modalities: Default::default() };
        meta.validate()?;
        if device.gaussians()? != config.empty_field() {
            let what = "the device holds Gaussians, or was made for other channels or harmonic degrees than the configuration's";
            return Err(Error::invalid(device.name(), what, "make a fresh one with Rf3dgsConfig::empty_field"));
        }
        Ok(Self {
            device,
            config,
            meta,
            seed,
            poses: vec![],
            views: vec![],
            points: vec![],
            given: None,
            schedule: None,
            extent_m: 0.0,
            done: 0,
            radio_begun: false,
            counts: DensityCounts::default(),
            times: Rf3dgsTimes::default(),
        })
    }

    /// Takes a training keyframe; its depth is not looked at.
    ///
    /// # Errors
    /// After the beginning; a keyframe without light or radio, of the wrong size, or whose pose or spectrum is not finite; the device's errors.
    pub fn receive(&mut self, keyframe: Keyframe) -> Result<()> {
        if self.schedule.is_some() {
            let place = format!("keyframe {}", keyframe.index);
            return Err(Error::invalid(place, "the reconstruction has begun", "give it all keyframes before"));
        }
        corf::keyframe::check(&keyframe, &self.meta)?;
        let Keyframe { index, world_from_camera, light: Some(light), radio: Some(radio), .. } = keyframe else {
            let what = "it has no image or no spectrum";
            return Err(Error::invalid(format!("keyframe {}", keyframe.index), what, "RF-3DGS learns from both"));
        };
        let meta = &self.meta;
        let view = corf::keyframe::training_view(
            world_from_camera,
            corf::keyframe::light(&light),
            corf::keyframe::radio(Some(&radio), meta),
            None,
            light.mask.clone(),
            meta,
        );
        self.device.upload(&view, 1)?;
        self.poses.push(world_from_camera);
        if self.config.initial_points == InitialPoints::Triangulated && self.given.is_none() {
            self.views.push(PointView::new(index, world_from_camera, light, self.meta.light_camera));
        }
        Ok(())
    }

    /// Gives it the result of an optical stage that another program has run, before it begins.
    pub fn start_from(&mut self, gaussians: Gaussians) {
        self.given = Some(gaussians);
    }

    /// Makes the first Gaussians from the keyframes received, or takes those it was given, with the optical stage behind it.
    ///
    /// # Errors
    /// No keyframes, all of them in one place, or too little to triangulate; the device's errors.
    pub fn begin(&mut self) -> Result<()> {
        let start = Instant::now();
        self.settle()?;
        if let Some(given) = self.given.take() {
            self.views = vec![];
            self.device.append(&given)?;
            self.done = self.config.light_steps;
            return Ok(());
        }
        let half_side_m = f64::from(self.config.random_extent) * self.extent_m;
        self.points = match self.config.initial_points {
            InitialPoints::Triangulated => points::triangulated(&self.views)?,
            InitialPoints::Random => points::random(&self.poses, self.config.random_points, half_side_m, self.seed),
        };
        self.views = vec![];
        self.device.append(&points::gaussians(&self.points, self.config.empty_field(), self.config.initial_opacity)?)?;
        self.times.points_s += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// What follows from the keyframes' poses.
    fn settle(&mut self) -> Result<()> {
        if self.schedule.is_some() {
            return Err(Error::invalid("the reconstruction", "it has begun already", "begin or restore a fresh one"));
        }
        self.extent_m = points::extent_m(&self.poses);
        if !(self.extent_m > 0.0 && self.extent_m.is_finite()) {
            let what = format!("{}, all in one place", counted(self.poses.len(), "keyframe"));
            return Err(Error::invalid("the training keyframes", what, "give keyframes from several places"));
        }
        self.schedule = Some(Rf3dgsSchedule::new(&self.config, self.extent_m, self.seed, self.poses.len()));
        Ok(())
    }

    /// Takes the next steps, `most` at most and those of one stage, and reports the last; `None` where all have been taken.
    ///
    /// # Errors
    /// Before the beginning; the device's errors.
    pub fn train(&mut self, most: usize) -> Result<Option<StepReport>> {
        let Some(schedule) = &mut self.schedule else {
            return Err(Error::invalid("the reconstruction", "it has not begun", "call Rf3dgsReconstructor::begin first"));
        };
        let light = self.config.light_steps;
        let end = if self.done < light { light } else { self.config.total_steps() };
        let target = self.done.saturating_add(most.max(1)).min(end);
        if self.done == target {
            return Ok(None);
        }
        let start = Instant::now();
        let radio = self.done >= light;
        if radio && !self.radio_begun {
            begin_radio(self.device.as_mut(), self.config.radio_moments)?;
            self.radio_begun = true;
        }
        let mut last = StepReport::default();
        while self.done < target {
            let event = if radio { usize::MAX } else { self.config.density.steps_to_event(self.done) };
            let count = event.min(target - self.done);
            let steps: Vec<_> = (1..=count).map(|k| schedule.step(self.done + k)).collect();
            last = self.device.train_dense(&steps)?;
            self.done += count;
            if !radio {
                control_density(
                    self.device.as_mut(),
                    Modality::Light,
                    &self.config.density,
                    self.done,
                    self.extent_m,
                    self.seed,
                    &mut self.counts,
                )?;
            }
        }
        let seconds = if radio { &mut self.times.radio_s } else { &mut self.times.light_s };
        *seconds += start.elapsed().as_secs_f64();
        Ok(Some(last))
    }

    /// Steps of both stages taken so far.
    pub fn steps_done(&self) -> usize {
        self.done
    }

    /// Whether all steps have been taken.
    pub fn is_done(&self) -> bool {
        self.done == self.config.total_steps()
    }

    /// Number of Gaussians held.
    pub fn gaussian_count(&self) -> usize {
        self.device.len()
    }

    /// The points it began with.
    pub fn points(&self) -> &[SparsePoint] {
        &self.points
    }

    /// The scene's extent, metres: 1.1 times the largest distance of a camera from the mean of all.
    pub fn extent_m(&self) -> f64 {
        self.extent_m
    }

    /// Gaussians cloned, split and pruned so far.
    pub fn density_counts(&self) -> DensityCounts {
        self.counts
    }

    /// Seconds its parts took.
    pub fn times(&self) -> Rf3dgsTimes {
        self.times
    }

    /// Whether training keeps this machine's processor busy.
    pub fn trains_on_the_host(&self) -> bool {
        self.device.trains_on_the_host()
    }

    /// The field as it stands: reads the Gaussians back. Without an RF stage, or before it, RF is grey.
    ///
    /// # Errors
    /// The device's.
    pub fn field(&mut self) -> Result<Field> {
        Ok(Field { gaussians: self.device.gaussians()?, meta: self.meta })
    }
}

/// Clones, splits, prunes and resets, whatever is due after step `step`. The step itself has been taken with its update: published programs differ
/// in whether that of the step before a change is.
pub(crate) fn control_density(
    device: &mut dyn Device,
    modality: Modality,
    config: &DensityConfig,
    step: usize,
    extent_m: f64,
    seed: u64,
    counts: &mut DensityCounts,
) -> Result<()> {
    if config.is_due(step) {
        let gradients = device.screen_gradients()?;
        let mut change = decide(config, &gradients, &device.outlines()?, modality, extent_m as f32, step, seed);
        if change.copies.is_empty() && change.keep.iter().all(|k| !k) {
            return Err(Error::invalid(
                format!("training step {step}"),
                "density control would prune every Gaussian",
                "set a lower density.prune_opacity or a larger density.prune_fraction",
            ));
        }
        device.duplicate(&change.copies)?;
        change.keep.resize(change.keep.len() + change.copies.len(), true);
        // The sums of gradients begin anew with this, also where all are kept.
        device.retain(&change.keep)?;
        counts.cloned += change.counts.cloned;
        counts.split += change.counts.split;
        counts.pruned += change.counts.pruned;
    }
    if config.resets(step) {
        device.cap_opacity(modality, config.reset_opacity)?;
    }
    Ok(())
}

/// The RF stage's beginning: every Gaussian has the opacity that light has learnt and no colour (grey); Adam's moments of both are light's, or zero.
fn begin_radio(device: &mut dyn Device, moments: RadioMoments) -> Result<()> {
    let mut state = device.state()?;
    let n = state.gaussians.len();
    state.gaussians.radio.opacity_logit.clone_from(&state.gaussians.light.opacity_logit);
    state.gaussians.radio.sh.fill(0.0);
    for part in &mut state.moments {
        match moments {
            RadioMoments::Restored => part.radio.clone_from(&part.light),
            RadioMoments::Zero => *part = zeros(part),
        }
    }
    device.retain(&vec![false; n])?;
    device.restore(&state)
}

/// As many zeros.
fn zeros(like: &Gaussians) -> Gaussians {
    let mut out = like.clone();
    out.position.fill([0.0; 3]);
    out.rotation.fill([0.0; 4]);
    out.log_scale.fill([0.0; 3]);
    for a in [&mut out.light, &mut out.radio] {
        a.opacity_logit.fill(0.0);
        a.sh.fill(0.0);
    }
    out
}

#[cfg(test)]
mod tests;
