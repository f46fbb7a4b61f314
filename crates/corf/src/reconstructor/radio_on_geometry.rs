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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Antialias, CpuDevice, OptimizerConfig, RadioTarget, RasterConfig, config::ReconstructionConfig, gaussians::logit,
    };
    use corf_scene::Rng;
    use corf_scene::keyframe::{DbRange, Modalities};
    use glam::DVec3;

    const CAMERA: fn() -> Pinhole = || Pinhole::from_horizontal_fov(24, 16, 90.0);

    fn meta(target: RadioTarget) -> FieldMeta {
        FieldMeta {
            radio_target: target,
            db_range: DbRange { min_db: -110.0, max_db: -50.0 },
            light_camera: Pinhole::from_horizontal_fov(48, 32, 90.0),
            radio_camera: CAMERA(),
            radio_background: None,
            modalities: Modalities::BOTH,
        }
    }

    /// A wall of Gaussians two metres ahead.
    fn wall(config: &ReconstructionConfig) -> Gaussians {
        let mut rng = Rng::keyed(5, 0, 0);
        let mut g = config.empty_field();
        for _ in 0..300 {
            g.position.push([4.0 * (rng.uniform() - 0.5), 3.0 * (rng.uniform() - 0.5), 2.0]);
            g.rotation.push([1.0, 0.0, 0.0, 0.0]);
            g.log_scale.push([-1.8; 3]);
            for a in [&mut g.light, &mut g.radio] {
                a.opacity_logit.push(logit(0.3));
                a.sh.extend((0..a.stride()).map(|_| 0.2 * (rng.uniform() - 0.5)));
            }
        }
        g
    }

    /// A lobe whose place moves with the pose.
    fn spectrum(k: usize) -> Raster<f32> {
        Raster::from_fn(24, 16, |x, y| {
            let d2 = (x as f32 - 8.0 - 2.0 * k as f32).powi(2) + (y as f32 - 8.0).powi(2);
            1e-6 * (-0.5 * d2 / 4.0).exp()
        })
    }

    #[test]
    fn radio_is_learnt_and_the_rest_keeps_its_bits() {
        for target in [RadioTarget::Jet, RadioTarget::Db] {
            let config = ReconstructionConfig { radio_target: target, ..ReconstructionConfig::default() };
            let finished = wall(&config);
            let device = || {
                let none = config.empty_field();
                Box::new(CpuDevice::new(OptimizerConfig::default(), RasterConfig::default(), &none).unwrap())
            };
            let learn = |seed: u64| {
                let radio = finished.radio.clone();
                let mut learner =
                    RadioOnGeometry::new(device(), finished.clone(), radio, meta(target), config.clone(), seed).unwrap();
                for k in 0..3 {
                    let pose = Rigid3 { translation: DVec3::new(0.2 * k as f64, 0.0, 0.0), ..Rigid3::IDENTITY };
                    learner.add(pose, &spectrum(k)).unwrap();
                }
                let rates = OptimizerConfig::default().radio;
                let first = learner.epoch(rates).unwrap().radio_loss;
                let mut last = StepReport::default();
                for _ in 0..20 {
                    last = learner.epoch(rates).unwrap();
                }
                assert!(last.radio_loss < 0.8 * first && last.light_loss == 0.0, "{first} to {last:?}");
                learner.field().unwrap()
            };
            let field = learn(1);
            let g = &field.gaussians;
            assert!(g.position == finished.position && g.rotation == finished.rotation && g.log_scale == finished.log_scale);
            assert!(g.light == finished.light && g.radio.opacity_logit != finished.radio.opacity_logit);
            assert!(learn(1) == field && learn(2) != field, "the seed decides the order");
            // Written, it is the same file of light.
            let folder = tempfile::tempdir().unwrap();
            let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
            let before = Field { gaussians: finished.clone(), meta: field.meta };
            for (field, at) in [(&before, &a), (&field, &b)] {
                std::fs::create_dir(at).unwrap();
                field.write(at, Antialias::On).unwrap();
            }
            let light = [&a, &b].map(|at| std::fs::read(at.join("optical.ply")).unwrap());
            assert!(light[0] == light[1]);
        }
    }

    #[test]
    fn rates_of_nothing_learn_nothing_and_what_does_not_fit_is_refused() {
        let config = ReconstructionConfig { radio_target: RadioTarget::Db, ..ReconstructionConfig::default() };
        let finished = wall(&config);
        let device =
            || Box::new(CpuDevice::new(OptimizerConfig::default(), RasterConfig::default(), &config.empty_field()).unwrap());
        let new = |device: Box<CpuDevice>, radio: Appearance| {
            RadioOnGeometry::new(device, finished.clone(), radio, meta(RadioTarget::Db), config.clone(), 1)
        };
        let mut learner = new(device(), finished.radio.clone()).unwrap();
        learner.add(Rigid3::IDENTITY, &spectrum(0)).unwrap();
        let still = AppearanceRates { sh_dc: 0.0, opacity: 0.0, ..OptimizerConfig::default().radio };
        learner.epoch(still).unwrap();
        assert!(learner.field().unwrap().gaussians == finished);
        assert!(learner.epoch(AppearanceRates { opacity: -1.0, ..still }).is_err());
        let error = learner.add(Rigid3::IDENTITY, &Raster::filled(9, 9, 0.0)).unwrap_err().to_string();
        assert!(error.contains("9x9") && error.contains("24x16"), "{error}");
        let mut few = finished.radio.clone();
        few.opacity_logit.pop();
        assert!(new(device(), few).is_err());
        let mut held = device();
        held.append(&finished).unwrap();
        assert!(new(held, finished.radio.clone()).err().unwrap().to_string().contains("already holds"));
    }
}
