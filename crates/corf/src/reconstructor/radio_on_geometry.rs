//! Radio learnt anew on a finished geometry: another transmitter or carrier in a room whose light is known already. Opacity and colour at 60 GHz are all
//! that is trained; positions, shapes, and opacity and colour in light stay as they were, bit for bit.

use super::schedule::{Schedule, StageWeights};
use crate::{
    Appearance, AppearanceRates, Device, Error, Field, FieldMeta, Gaussians, ReconstructionConfig, Result,
    device::{Planes, StepReport, TrainingView},
};
use corf_scene::{Pinhole, Raster, Rigid3};

/// Side of the image that stands for light in training views, pixels: nothing looks at it.
const UNSEEN_PX: usize = 8;

/// Learns the radio half of a field whose other half is finished.
///
/// Spectra are [added](Self::add), then [epochs](Self::epoch) are trained; what comes of it is the [field](Self::field).
pub struct RadioOnGeometry {
    device: Box<dyn Device>,
    /// The finished half, and the radio that was begun with.
    begun: Gaussians,
    meta: FieldMeta,
    schedule: Schedule,
    config: ReconstructionConfig,
}

impl RadioOnGeometry {
    /// Begins with the geometry and light of `finished` and with `radio`, an appearance of the same Gaussians. `meta` is what the field is to be looked at
    /// with: its RF camera, target and decibel range are those of the spectra to come.
    ///
    /// # Errors
    /// An appearance of other Gaussians, other channels than the target's or another degree than the device's; an invalid `meta`; the device's errors, or
    /// one that already holds Gaussians.
    pub fn new(
        mut device: Box<dyn Device>,
        finished: Gaussians,
        radio: Appearance,
        meta: FieldMeta,
        config: ReconstructionConfig,
        seed: u64,
    ) -> Result<Self> {
        meta.validate()?;
        if !device.is_empty() {
            let help = "begin radio on a fresh device";
            return Err(Error::invalid(device.name(), "the device already holds Gaussians", help));
        }
        let begun = Gaussians { radio, ..finished };
        device.append(&begun)?;
        let schedule = Schedule::new(seed, meta.radio_target.floor_color());
        Ok(Self { device, begun, meta, schedule, config })
    }

    /// Adds the spectrum that was received at a pose: linear power, over the RF camera's pixels.
    ///
    /// # Errors
    /// A spectrum of another size; the device's errors.
    pub fn add(&mut self, world_from_camera: Rigid3, spectrum: &Raster<f32>) -> Result<()> {
        let camera = self.meta.radio_camera;
        if (spectrum.width(), spectrum.height()) != (camera.width, camera.height) {
            let what = format!(
                "it is {}x{} and the camera says {}x{}",
                spectrum.width(),
                spectrum.height(),
                camera.width,
                camera.height
            );
            return Err(Error::invalid("spectrum", what, "all spectra of a field share its RF camera"));
        }
        let light = Planes { width: UNSEEN_PX, height: UNSEEN_PX, channels: 3, pixels: vec![0.0; 3 * UNSEEN_PX * UNSEEN_PX] };
        let view = TrainingView {
            world_from_camera,
            light_camera: Pinhole::from_horizontal_fov(UNSEEN_PX, UNSEEN_PX, 90.0),
            light,
            radio_camera: camera,
            radio: self.meta.radio_target.encode(spectrum, &self.meta.db_range),
            inverse_depth: None,
            mask: None,
        };
        let view = self.device.upload(&view, 1)?;
        self.schedule.push(view);
        Ok(())
    }

    /// Trains on every spectrum once at full resolution, in an order that the seed decides.
    ///
    /// # Errors
    /// The device's.
    pub fn epoch(&mut self, rates: AppearanceRates) -> Result<StepReport> {
        self.device.set_radio_rates(rates)?;
        // The loss has one term, and Adam is blind to a common factor: its weight is 1.
        let weights = StageWeights { light: 0.0, radio: 1.0, depth: false, geometry: false };
        let steps = self.schedule.epoch(weights, &self.config);
        self.device.train(&steps)
    }

    /// The field as it stands.
    ///
    /// # Errors
    /// The device's; one that has touched what was finished.
    pub fn field(&mut self) -> Result<Field> {
        let gaussians = self.device.gaussians()?;
        let Gaussians { position, rotation, log_scale, light, radio: _ } = &self.begun;
        if (position, rotation, log_scale, light)
            != (&gaussians.position, &gaussians.rotation, &gaussians.log_scale, &gaussians.light)
        {
            let what = "it has changed geometry or light, of which no step was to learn";
            return Err(Error::invalid(self.device.name(), what, "this is a defect of the device"));
        }
        Ok(Field { gaussians, meta: self.meta })
    }

    /// Number of Gaussians.
    pub fn gaussian_count(&self) -> usize {
        self.begun.len()
    }
}
