//! A field that knows its array: light as in `corf-gs`, radio as emitters that are looked at through the receiver's own beam pattern.

use super::corf_gs::CorfGsConfig;
use super::field::FieldPredictor;
use crate::device::Backend;
use crate::method::{Advance, Method, Predictor, StageTime, TrainingSet};
use crate::metrics::Prediction;
use anyhow::{Context, Result, bail, ensure};
use corf::array::{ArrayConfig, ArrayField, ArraySensor, ArrayTrainer, SensorSettings};
use corf::config::Coupling;
use corf::depth::DepthPrior;
use corf::{KeyframeTiming, RasterConfig, Reconstructor};
use corf_scene::config::{AntennaPattern, RearHalfSpace, SpectrumKind};
use corf_scene::dataset::Dataset;
use corf_scene::keyframe::DbRange;
use corf_scene::{Raster, Rigid3};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// File of a run folder with the radio field.
const FIELD: &str = "array";

/// Configuration of `corf-array`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CorfArrayConfig {
    /// Light: keys of `corf-gs`, table `light` of the overrides.
    pub light: CorfGsConfig,
    /// Radio: everything else, at the top level of the overrides.
    pub radio: ArrayConfig,
}

impl CorfArrayConfig {
    fn parse(overrides: &toml::Table) -> Result<Self> {
        let mut rest = overrides.clone();
        // Radio has a field of its own, and the Gaussians need not show it.
        let mut light: toml::Table = "rf_weight = 0.0".parse()?;
        let own = rest.remove("light").map_or_else(|| Ok(toml::Table::new()), toml::Value::try_into);
        super::merge(&mut light, own.context("in key light")?);
        let light = CorfGsConfig::parse(&light).context("in key light")?;
        ensure!(
            light.fine_tune_epochs == 0 && light.reconstruction.coupling == Coupling::Joint,
            "light.fine_tune_epochs and light.coupling are stages of corf-gs\n  help: leave them out"
        );
        let radio: ArrayConfig = super::over_defaults(rest)?;
        radio.validate()?;
        Ok(Self { light, radio })
    }
}

/// The sensor behind a data set's spectra.
///
/// # Errors
/// Spectra or elements whose sensor this method does not know.
fn sensor_of(training: &TrainingSet<'_>) -> Result<SensorSettings> {
    let unknown = "corf-array: the data set does not say which array its spectra are of, or of which kind they are\n  help: use corf-gs for it";
    let (receiver, spectrum) = training.receiver().zip(training.spectrum()).context(unknown)?;
    ensure!(
        receiver.pattern == AntennaPattern::Iso,
        "corf-array: the receiver's elements have the pattern {:?}, and the method knows isotropic ones\n  help: use corf-gs for this data set",
        receiver.pattern
    );
    let settings = match spectrum {
        SpectrumKind::Mpc => {
            let width_deg = training.lobe_width_deg().context(
                "corf-array: the data set does not say how wide a lobe of its spectra is\n  help: keep `config` in its dataset.json",
            )?;
            SensorSettings::Lobes { width_deg }
        }
        // Phases of arrivals are not in a data set: the mean over them is.
        SpectrumKind::Bartlett | SpectrumKind::BartlettCoherent => SensorSettings::Beam {
            elements: [receiver.cols, receiver.rows],
            spacing_wavelengths: receiver.spacing_wavelengths,
            gated: receiver.rear == RearHalfSpace::Gated,
        },
        kind @ SpectrumKind::Mvdr => {
            bail!(
                "corf-array: {} spectra are no power that adds up, and the method forms mpc and bartlett ones\n  help: use corf-gs for this data set",
                kind.name()
            )
        }
    };
    settings.check(&training.rf_camera())?;
    Ok(settings)
}

/// `corf-array`.
pub struct CorfArray {
    config: CorfArrayConfig,
    backend: Backend,
}

impl CorfArray {
    /// The method; `overrides` are keys of [`ArrayConfig`], and in the table `light` keys of `corf-gs`.
    ///
    /// # Errors
    /// A key that does not exist, or a value out of range.
    pub fn new(overrides: &toml::Table, backend: &Backend) -> Result<Self> {
        let config = CorfArrayConfig::parse(overrides).context("in the configuration of corf-array")?;
        Ok(Self { config, backend: backend.clone() })
    }
}

impl Method for CorfArray {
    fn id(&self) -> &str {
        "corf-array"
    }

    fn config(&self) -> serde_json::Value {
        serde_json::json!(self.config)
    }

    fn device(&self) -> String {
        self.backend.name()
    }

    fn uses_ground_truth_depth(&self) -> bool {
        self.config.light.reconstruction.consumes_ground_truth_depth()
    }

    /// Depth comes from views of one thing from several places.
    fn least_keyframes(&self) -> usize {
        2
    }

    fn check_files(&self, training: &TrainingSet<'_>) -> Result<()> {
        sensor_of(training)?;
        let camera = training.optical_camera();
        // Nothing that is drawn matters to files.
        let prior = DepthPrior::new(&self.config.light.reconstruction.depth, 0)?;
        Ok(prior.check_all(training.indices(), (camera.width, camera.height))?)
    }

    fn reconstruct(
        &self,
        training: &TrainingSet<'_>,
        seed: u64,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>> {
        let CorfArrayConfig { light, radio } = &self.config;
        let (optical, rf, range) = (training.optical_camera(), training.rf_camera(), training.db_range());
        let device = light.device(&self.backend)?;
        let mut online = Online {
            light: Reconstructor::new(device, light.reconstruction.clone(), optical, rf, range, seed)?,
            radio: ArrayTrainer::new(*radio, sensor_of(training)?, rf, range, seed),
            ahead: VecDeque::new(),
            radio_s: vec![],
            total: training.len(),
            advance,
        };
        for k in 0..training.len() {
            let before = training.loading_time();
            let keyframe = training.keyframe(k)?;
            online.light.discount_wait(training.loading_time() - before);
            online.ahead.push_back((keyframe.world_from_camera, keyframe.spectrum.clone()));
            online.light.receive(keyframe)?;
            while online.light.waiting() >= online.light.worth_receiving() {
                online.process()?;
            }
        }
        let Online { mut light, radio, .. } = online.finish()?;
        ensure!(
            light.gaussian_count() > 0,
            "corf-array: {} training keyframes gave no Gaussians, so there is no field\n  help: `corf dataset validate` says whether images are \
             black or depth is empty",
            training.len()
        );
        let field = FieldPredictor::new(light.field(), self.config.light.raster, &self.backend).clearing(light);
        Ok(Box::new(ArrayPredictor::new(field, radio.into_field(), range)))
    }
}

/// Light and radio, keyframe after keyframe.
struct Online<'a> {
    light: Reconstructor,
    radio: ArrayTrainer,
    /// Poses and spectra of keyframes that light has received and radio has not.
    ahead: VecDeque<(Rigid3, Raster<f32>)>,
    /// Time that radio took, by keyframe.
    radio_s: Vec<f64>,
    total: usize,
    advance: &'a mut dyn FnMut(Advance<'_>) -> Result<()>,
}

impl Online<'_> {
    /// One keyframe in light, and then in radio.
    fn process(&mut self) -> Result<()> {
        if self.light.process()?.is_some() {
            self.radio()?;
        }
        Ok(())
    }

    /// The next keyframe in radio.
    fn radio(&mut self) -> Result<()> {
        let Some((pose, spectrum)) = self.ahead.pop_front() else { return Ok(()) };
        let start = Instant::now();
        self.radio.receive(&pose, &spectrum, &self.light.field().gaussians.position)?;
        self.radio.train();
        self.radio_s.push(start.elapsed().as_secs_f64());
        let done = self.radio_s.len();
        (self.advance)(Advance { gaussians: Some(self.light.gaussian_count()), ..Advance::of(done, self.total) })
    }

    /// The keyframes that are left, and what there is to say at the end.
    fn finish(mut self) -> Result<Self> {
        while self.light.waiting() > 0 {
            self.process()?;
        }
        self.light.finish(&mut |_, _| ControlFlow::Continue(()))?;
        while !self.ahead.is_empty() {
            self.radio()?;
        }
        // Radio is the end of a keyframe, and is waited for by those behind it, which light's own clock has counted.
        let timings: Vec<KeyframeTiming> = self.light.timings().to_vec();
        let last = Advance { gaussians: Some(self.light.gaussian_count()), ..Advance::of(self.total, self.total) };
        for (timing, radio_s) in timings.iter().zip(&self.radio_s) {
            let keyframe = KeyframeTiming { train_s: timing.train_s + radio_s, ..*timing };
            (self.advance)(Advance { keyframe: Some(&keyframe), ..last })?;
        }
        let stages = [StageTime { name: "radio".to_owned(), seconds: self.radio_s.iter().sum() }];
        (self.advance)(Advance { depth: self.light.depth_quality(), stages: &stages, ..last })?;
        Ok(self)
    }
}

/// Settings by which a run's Gaussians are drawn.
///
/// # Errors
/// A configuration of another version.
pub fn raster_of(config: &serde_json::Value) -> Result<RasterConfig> {
    Ok(serde_json::from_value::<CorfArrayConfig>(config.clone())?.light.raster)
}

/// A finished field.
pub struct ArrayPredictor {
    light: FieldPredictor,
    radio: ArrayField,
    sensor: ArraySensor<f64>,
    range: DbRange,
}

impl ArrayPredictor {
    fn new(light: FieldPredictor, radio: ArrayField, range: DbRange) -> Self {
        Self { sensor: radio.sensor.build(&radio.camera), light, radio, range }
    }

    /// Reads the field of a run folder, whose configuration is `config`.
    ///
    /// # Errors
    /// A configuration of another version; a missing or damaged file, or a field of another data set's cameras.
    pub fn load(run: &Path, config: &serde_json::Value, dataset: &Dataset, backend: &Backend) -> Result<Self> {
        let config: CorfArrayConfig = serde_json::from_value(config.clone())
            .with_context(|| format!("{}: the configuration is not of this version", run.join("run.json").display()))?;
        let light = FieldPredictor::load(run, config.light.raster, dataset, backend)?;
        let radio = ArrayField::read(&run.join(FIELD))?;
        ensure!(radio.camera == dataset.rf_camera(), "{}: the radio field's camera is not the data set's", run.display());
        Ok(Self::new(light, radio, dataset.db_range()))
    }
}

impl Predictor for ArrayPredictor {
    fn render(&mut self, world_from_camera: &Rigid3) -> Result<Prediction> {
        let light = self.light.render(world_from_camera)?;
        let spectrum = self.radio.observe(&self.sensor, world_from_camera);
        let radio = Prediction::from_scalar(light.image, spectrum.map(|&s| self.range.scalar(s)));
        Ok(Prediction { depth_m: light.depth_m, ..radio })
    }

    fn gaussians(&self) -> Option<usize> {
        self.light.gaussians()
    }

    fn save(&self, run: &Path) -> Result<()> {
        self.radio.write(&run.join(FIELD))?;
        self.light.save(run)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf::array::Wave;
    use corf_raytrace::radio::{Arrival, PlanarArray};
    use corf_raytrace::spectrum::SpectrumSettings;
    use corf_scene::model::world_from_array;
    use corf_scene::{Pinhole, Rng};
    use glam::DVec3;

    /// Arrivals from everywhere, with their waves where the array is let see them.
    fn arrivals(pose: &Rigid3) -> (Vec<Arrival>, Vec<Wave<f64>>) {
        let mut rng = Rng::keyed(1, 2, 3);
        let mut direction = || DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
        let arrival = |i: usize| {
            let power = 1e-9 * (1.0 + i as f64);
            Arrival { direction: direction(), power, delay_s: 1e-9 * i as f64, object: 0, phase_rad: None }
        };
        let arrivals: Vec<Arrival> = (0..60).map(arrival).collect();
        let array_from_world = world_from_array(pose).transpose();
        let wave = |a: &Arrival| Wave { direction: (array_from_world * a.direction).to_array(), power: a.power, spread2: 0.0 };
        let waves = arrivals.iter().map(wave).collect();
        (arrivals, waves)
    }

    #[test]
    fn observations_are_those_that_data_sets_are_made_with() {
        let camera = Pinhole::from_horizontal_fov(48, 32, 90.0);
        let pose = Rigid3::looking_at(DVec3::new(1.0, 2.0, 1.6), DVec3::new(4.0, 3.0, 1.5), DVec3::Z);
        let (arrivals, waves) = arrivals(&pose);
        let array = PlanarArray { rows: 8, columns: 8, spacing_wavelengths: [0.5, 0.6] };
        for (kind, rear) in [
            (SpectrumKind::Bartlett, RearHalfSpace::Gated),
            (SpectrumKind::Bartlett, RearHalfSpace::Aliased),
            (SpectrumKind::Mpc, RearHalfSpace::Gated),
        ] {
            let made = SpectrumSettings { kind, array, rear, lobe_width_deg: 2.0, bandwidth_hz: 1e9, loading: 0.1, seed: 1 };
            let truth = made.form(std::slice::from_ref(&arrivals), &camera, &pose);
            let gated = rear == RearHalfSpace::Gated;
            let (settings, seen) = match kind {
                SpectrumKind::Mpc => (SensorSettings::Lobes { width_deg: 2.0 }, waves.clone()),
                _ => (
                    SensorSettings::Beam { elements: [8, 8], spacing_wavelengths: [0.5, 0.6], gated },
                    waves.iter().filter(|w| !gated || w.direction[0] > 0.0).copied().collect(),
                ),
            };
            let ours = settings.build::<f64>(&camera).observe(&seen);
            let top = truth.pixels().iter().copied().fold(0.0, f32::max);
            for (i, (a, b)) in ours.iter().zip(truth.pixels()).enumerate() {
                // Lobes end at 1e-4 of their own peaks, and their exponential is good to 6e-4 there.
                let tolerance = if kind == SpectrumKind::Mpc { 1e-3 * b + 1e-3 * top } else { 1e-5 * b + 1e-9 * top };
                assert!((a - f64::from(*b)).abs() <= f64::from(tolerance), "{kind:?} {rear:?}, pixel {i}: {a} {b}");
            }
        }
    }

    #[test]
    fn light_and_radio_have_their_own_keys() {
        let config = |text: &str| CorfArrayConfig::parse(&text.parse().unwrap());
        let plain = config("").unwrap();
        assert_eq!((plain.light.reconstruction.rf_weight, plain.radio), (0.0, ArrayConfig::default()));
        let other = config("rate = 0.25\nlight.iterations_per_keyframe = 40\nlight.optimizer.rf.sh_dc = 0.01").unwrap();
        assert_eq!((other.radio.rate, other.light.reconstruction.iterations_per_keyframe), (0.25, 40));
        assert_eq!(other.light.reconstruction.rf_weight, 0.0);
        for wrong in [
            "rate = -1.0",
            "rf_weight = 0.1",
            "light.iterations = 3",
            "light.fine_tune_epochs = 1",
            "light.coupling = \"frozen\"",
        ] {
            assert!(config(wrong).is_err(), "{wrong}");
        }
    }
}
