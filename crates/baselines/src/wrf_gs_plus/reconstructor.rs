//! A WRF-GS+ reconstruction at work: everything that is decided about it, above the devices.
//!
//! A step depends on its number, the seed and the state of the trainer. Steps may be taken in portions of any size, and a reconstruction that goes
//! on from a checkpoint ends in the same bytes.

use super::field::{self, WrfGsPlusField};
use super::{DeformedStep, WrfGsPlusConfig, WrfGsPlusTrainer};
use crate::rf_3dgs::{DensityCounts, Epochs, control_density, log_linear, points};
use corf::device::{DenseStep, Modality, Planes, Step, StepReport, TrainingView};
use corf::{Error, FieldMeta, RadioTarget, Result};
use corf_scene::dataset::FixedArray;
use corf_scene::words::counted;
use corf_scene::{Keyframe, Pinhole, Rigid3, keyframe::DbRange};

/// Number of its stage among those that visit views in epochs (RF-3DGS's are 0 and 1).
const STAGE: usize = 2;

/// A reconstruction. Keyframes are [received](Self::receive) first, then it [begins](Self::begin) or is [restored](Self::restore), and
/// [trains](Self::train) until it is [done](Self::is_done).
pub struct WrfGsPlusReconstructor {
    pub(super) trainer: Box<dyn WrfGsPlusTrainer>,
    pub(super) config: WrfGsPlusConfig,
    pub(super) meta: FieldMeta,
    /// The array, if it stands still while the transmitter moves.
    pub(super) array: Option<FixedArray>,
    pub(super) seed: u64,
    pub(super) poses: Vec<Rigid3>,
    epochs: Option<Epochs>,
    pub(super) done: usize,
    pub(super) counts: DensityCounts,
}

impl WrfGsPlusReconstructor {
    /// Nothing received yet. The cameras are those of every keyframe to come, `db_range` the whole dataset's; `trainer` holds no Gaussians and is of
    /// the same configuration.
    ///
    /// # Errors
    /// A configuration out of range, cameras without pixels, an empty dB range, or a trainer that holds Gaussians.
    pub fn new(
        mut trainer: Box<dyn WrfGsPlusTrainer>,
        config: WrfGsPlusConfig,
        light_camera: Pinhole,
        radio_camera: Pinhole,
        db_range: DbRange,
        seed: u64,
    ) -> Result<Self> {
        config.validate()?;
        let radio_target = config.radio_target;
        let meta = FieldMeta {
            radio_target,
            db_range,
            light_camera,
            radio_camera,
            radio_background: None,
            modalities: Default::default(),
        };
        meta.validate()?;
        let device = trainer.device();
        if device.gaussians()? != config.empty_field() {
            let what = "the device holds Gaussians, or was made for other channels than the configuration's";
            return Err(Error::invalid(device.name(), what, "make a fresh trainer of the same configuration"));
        }
        let (poses, epochs, done, counts) = (vec![], None, 0, DensityCounts::default());
        Ok(Self { trainer, config, meta, array: None, seed, poses, epochs, done, counts })
    }

    /// The same of an array that stands still: keyframes are places of the transmitter, spectra are grey levels over the array's directions, and
    /// `trainer` is an [`FixedArrayTrainer`](super::FixedArrayTrainer) of the same array.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn of_array(
        trainer: Box<dyn WrfGsPlusTrainer>,
        config: WrfGsPlusConfig,
        array: FixedArray,
        levels: DbRange,
        seed: u64,
    ) -> Result<Self> {
        // There is no pinhole: of this one, only the size means something.
        let size = Pinhole { width: array.azimuths, height: array.elevations, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        let mut out = Self::new(trainer, config, size, size, levels, seed)?;
        out.meta.radio_target = RadioTarget::Db;
        out.array = Some(array);
        Ok(out)
    }

    /// Takes a training keyframe; what its camera saw is not looked at.
    ///
    /// # Errors
    /// After the beginning; a keyframe without radio, of the wrong size, or whose pose or spectrum is not finite; the device's errors.
    pub fn receive(&mut self, keyframe: &Keyframe) -> Result<()> {
        if self.epochs.is_some() {
            let place = format!("keyframe {}", keyframe.index);
            return Err(Error::invalid(place, "the reconstruction has begun", "give it all keyframes before"));
        }
        corf::keyframe::check(keyframe, &self.meta)?;
        let Some(radio) = &keyframe.radio else {
            let place = format!("keyframe {}", keyframe.index);
            return Err(Error::invalid(place, "it has no spectrum", "WRF-GS+ learns from spectra alone"));
        };
        let meta = &self.meta;
        // A device's view has an image in light; this one is never rendered.
        let light_camera = Pinhole { width: 1, height: 1, ..meta.light_camera };
        let view = TrainingView {
            world_from_camera: keyframe.world_from_camera,
            light: Planes { width: 1, height: 1, channels: 3, pixels: vec![0.0; 3] },
            light_camera,
            radio: corf::keyframe::radio(Some(radio), meta),
            radio_camera: meta.radio_camera,
            inverse_depth: None,
            mask: None,
        };
        self.trainer.upload(&view)?;
        self.poses.push(keyframe.world_from_camera);
        Ok(())
    }

    /// Makes the first Gaussians, as wide as the distance to their neighbours: uniform in a cube around the receivers, without a signal; around an
    /// array that stands still normal, above it, of any signal.
    ///
    /// # Errors
    /// No keyframes, or all of them in one place; the device's errors.
    pub fn begin(&mut self) -> Result<()> {
        self.settle()?;
        let c = &self.config;
        let first = match &self.array {
            None => {
                let half_side_m = f64::from(c.random_extent) * points::extent_m(&self.poses);
                points::random(&self.poses, c.random_points, half_side_m, self.seed)
            }
            Some(array) => points::above(array, c.random_points, f64::from(c.array_spread_m), self.seed),
        };
        let mut gaussians = points::gaussians(&first, c.empty_field(), c.initial_opacity)?;
        if self.array.is_some() {
            // What a point's colour is in light, it is in the channels here.
            gaussians.radio.sh.clone_from(&gaussians.light.sh);
        }
        gaussians.light.sh.fill(0.0);
        self.trainer.device().append(&gaussians)
    }

    /// What follows from the keyframes' poses.
    pub(super) fn settle(&mut self) -> Result<()> {
        if self.epochs.is_some() {
            return Err(Error::invalid("the reconstruction", "it has begun already", "begin or restore a fresh one"));
        }
        let extent_m = points::extent_m(&self.poses);
        if !(extent_m > 0.0 && extent_m.is_finite()) {
            let what = format!("{}, all in one place", counted(self.poses.len(), "keyframe"));
            return Err(Error::invalid("the training keyframes", what, "give keyframes from several places"));
        }
        self.epochs = Some(Epochs::new(self.seed, self.poses.len(), STAGE));
        Ok(())
    }

    /// Takes the next steps, `most` at most, and reports the last; `None` where all have been taken.
    ///
    /// # Errors
    /// Before the beginning; a loss that is no number; the device's errors.
    pub fn train(&mut self, most: usize) -> Result<Option<StepReport>> {
        let Some(epochs) = &mut self.epochs else {
            let help = "call WrfGsPlusReconstructor::begin first";
            return Err(Error::invalid("the reconstruction", "it has not begun", help));
        };
        let target = self.done.saturating_add(most.max(1)).min(self.config.iterations);
        if self.done == target {
            return Ok(None);
        }
        let mut last = StepReport::default();
        while self.done < target {
            let count = self.config.density.steps_to_event(self.done).min(target - self.done);
            let steps: Vec<_> = (1..=count).map(|k| step(&self.config, &self.meta, epochs, &self.poses, self.done + k)).collect();
            last = self.trainer.train(&steps)?;
            self.done += count;
            if !last.radio_loss.is_finite() {
                let what = format!("the loss is {}", last.radio_loss);
                return Err(Error::invalid(format!("training step {}", self.done), what, "give smaller rates.network"));
            }
            let (device, extent_m) = (self.trainer.device(), f64::from(self.config.extent_m));
            control_density(device, Modality::Radio, &self.config.density, self.done, extent_m, self.seed, &mut self.counts)?;
        }
        Ok(Some(last))
    }

    /// Steps taken so far.
    pub fn steps_done(&self) -> usize {
        self.done
    }

    /// Whether all steps have been taken.
    pub fn is_done(&self) -> bool {
        self.done == self.config.iterations
    }

    /// Whether it has begun or was restored.
    pub(super) fn has_begun(&self) -> bool {
        self.epochs.is_some()
    }

    /// Number of Gaussians held.
    pub fn gaussian_count(&mut self) -> usize {
        self.trainer.device().len()
    }

    /// Gaussians cloned, split and pruned so far.
    pub fn density_counts(&self) -> DensityCounts {
        self.counts
    }

    /// Renders a pose with what it has learnt so far: C_rf channels, as the target has them.
    ///
    /// # Errors
    /// The trainer's.
    pub fn render(&mut self, world_from_camera: &Rigid3) -> Result<Planes> {
        field::render(&self.meta, self.trainer.as_mut(), world_from_camera)
    }

    /// The field as it stands: reads it back.
    ///
    /// # Errors
    /// The trainer's.
    pub fn field(&mut self) -> Result<WrfGsPlusField> {
        let gaussians = self.trainer.device().gaussians()?;
        let parameters = self.trainer.network()?.parameters;
        Ok(WrfGsPlusField { config: self.config.clone(), meta: self.meta, array: self.array, gaussians, parameters })
    }

    /// The trainer, which holds the field.
    pub fn into_trainer(self) -> Box<dyn WrfGsPlusTrainer> {
        self.trainer
    }
}

/// Step `number`, from 1.
fn step(config: &WrfGsPlusConfig, meta: &FieldMeta, epochs: &mut Epochs, poses: &[Rigid3], number: usize) -> DeformedStep {
    let (view, rates) = (epochs.view(number), &config.rates);
    let step = Step {
        view,
        levels: [0; 2],
        light_weight: 0.0,
        radio_weight: 1.0,
        depth_weight: 0.0,
        train_geometry: true,
        light_background: [0.0; 3],
        radio_background: meta.radio_background.unwrap_or(meta.radio_target.floor_color()),
    };
    DeformedStep {
        dense: DenseStep {
            step,
            number: number.min(u32::MAX as usize) as u32,
            position_rate_m: log_linear(rates.position.map(f64::from), rates.position_steps, number) as f32,
            degree: 0,
            screen_gradients: config.density.watches(number),
        },
        receiver_m: poses[view.0].translation.as_vec3().to_array(),
        network_rate: log_linear(rates.network, rates.network_steps, number),
    }
}
