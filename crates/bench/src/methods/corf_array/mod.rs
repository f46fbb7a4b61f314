//! A field that knows its array: light as in `corf-gs`, radio as emitters that are looked at through the receiver's own beam pattern.

mod images;
mod online;
mod predictor;

pub use predictor::{ArrayPredictor, observer};

use super::corf_gs::{Checkpointer, CorfGsConfig, GeometryConfig};
use super::field::FieldPredictor;
use crate::device::Backend;
use crate::methods::family::{Abilities, Family, Open, Variant, over_defaults};
use crate::methods::interface::{Advance, Checkpoints, Method, Predictor, TrainingSet};
use crate::note;
use crate::scenes::behind::SceneBehind;
use anyhow::{Context, Result, bail, ensure};
use corf::array_field::{ArrayConfig, ArrayField, ArrayTrainer, Image, SensorSettings, Surface};
use corf::config::Coupling;
use corf::{Field, IdleKey, RasterConfig, Reconstructor};
use corf_scene::config::{AntennaPattern, RearHalfSpace, ReceiverConfig, SpectrumKind};
use online::Online;
use schemars::{JsonSchema, schema_for};
use serde::{Deserialize, Serialize, Serializer};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};

/// Key of the scene file that the true images are traced in.
pub const ORACLE_SCENE: &str = "oracle_scene";

/// Configuration of `corf-array`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CorfArrayConfig {
    /// Light: keys of `corf-gs`, table `light` of the overrides. Those of radio are of splatted spectra, and refused where surfaces are points.
    pub light: CorfGsConfig,
    /// An oracle, no method: the scene file that the data set was generated from. Virtual sources are then the transmitter's true mirror images,
    /// traced in that scene, and rows say so. A path in a plan is relative to the plan's file.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "file_name")]
    pub oracle_scene: Option<PathBuf>,
    /// Radio: everything else, at the top level of the overrides.
    pub radio: ArrayConfig,
}

/// Of the scene's path records keep the file's name: the data set, whose hash they have, tells which scene it is.
fn file_name<S: Serializer>(path: &Option<PathBuf>, serializer: S) -> Result<S::Ok, S::Error> {
    let name = path.as_deref().and_then(Path::file_name);
    name.map(|name| name.to_string_lossy()).serialize(serializer)
}

impl CorfArrayConfig {
    fn parse(overrides: &toml::Table) -> Result<Self> {
        let mut rest = overrides.clone();
        let own = rest.remove("light").map_or_else(|| Ok(toml::Table::new()), toml::Value::try_into);
        let light: toml::Table = own.context("in key light")?;
        if let Some(geometry) = light.get("geometry") {
            bail!(
                "light.{} has no effect: corf-gs alone keeps the geometry of a run\n  help: leave it out",
                GeometryConfig::keys_of(geometry)
            );
        }
        let light = CorfGsConfig::parse(&light).context("in key light")?;
        let has_stages = light.fine_tune_epochs > 0
            || light.fine_tune_s.is_some()
            || light.initial_gaussians.is_some()
            || light.reconstruction.keyframe_budget_ms.is_some()
            || light.reconstruction.coupling != Coupling::Joint;
        ensure!(
            !has_stages,
            "light.fine_tune_epochs, light.fine_tune_s, light.keyframe_budget_ms, light.initial_gaussians and light.coupling are stages of \
             corf-gs\n  help: leave them out"
        );
        let oracle_scene = rest.remove(ORACLE_SCENE).map_or_else(|| Ok(None), |v| v.try_into().map(Some));
        let oracle_scene: Option<PathBuf> = oracle_scene.with_context(|| format!("in key {ORACLE_SCENE}"))?;
        let radio: ArrayConfig = over_defaults(rest)?;
        radio.validate()?;
        ensure!(
            oracle_scene.is_none() || radio.sources,
            "{ORACLE_SCENE} says which sources there are, and sources = false that there are none\n  help: leave one of them out"
        );
        Ok(Self { light, oracle_scene, radio })
    }
}

/// The rasteriser's settings in a run's resolved configuration.
///
/// # Errors
/// A configuration of another version.
fn raster_of(config: &serde_json::Value) -> Result<RasterConfig> {
    Ok(serde_json::from_value::<CorfArrayConfig>(config.clone())?.light.raster)
}

/// The sensor behind a data set's spectra.
///
/// # Errors
/// Spectra or elements whose sensor this method does not know.
fn sensor_of(training: &TrainingSet<'_>) -> Result<SensorSettings> {
    const UNKNOWN: &str = "corf-array: the data set does not say of which kind its spectra are, or which array they are of\n  help: say it when the capture is \
                           imported (`corf dataset import`: --rf-kind, --rf-array, --rf-spacing), or use corf-gs for it";
    let spectrum = training.spectrum().context(UNKNOWN)?;
    // Lobes are of no array.
    let receiver = match (training.receiver(), spectrum) {
        (None, SpectrumKind::Mpc) => ReceiverConfig::default(),
        (receiver, _) => receiver.context(UNKNOWN)?,
    };
    let (elements, spacing_wavelengths) = ([receiver.cols, receiver.rows], receiver.spacing_wavelengths);
    let gated = receiver.rear == RearHalfSpace::Gated;
    let settings = match spectrum {
        SpectrumKind::Mpc => {
            let width_deg = training.lobe_width_deg().context(
                "corf-array: the data set does not say how wide a lobe of its spectra is\n  help: import the capture with --rf-lobe-width-deg; of a generated one keep `config` in its \
                 dataset.json",
            )?;
            SensorSettings::Lobes { width_deg }
        }
        // Phases of arrivals are not in a data set: the mean over them is.
        SpectrumKind::Bartlett | SpectrumKind::BartlettCoherent => SensorSettings::Beam { elements, spacing_wavelengths, gated },
        SpectrumKind::Mvdr => {
            let loading = training.mvdr_loading().context(
                "corf-array: the data set does not say with which diagonal loading its mvdr spectra were formed\n  help: import the \
                 capture with --rf-loading; of a generated one keep `config` in its dataset.json, of which rf.mvdr_loading says it; or use corf-gs",
            )?;
            SensorSettings::Capon { elements, spacing_wavelengths, gated, loading }
        }
    };
    settings.check(&training.radio_camera())?;
    Ok(settings)
}

/// A trainer whose steps are taken on a device; on the processor where the sensor needs double precision, which is said.
///
/// # Errors
/// The device's.
pub fn on_device(trainer: ArrayTrainer, backend: &Backend) -> Result<ArrayTrainer> {
    match backend {
        Backend::Cpu => Ok(trainer),
        #[cfg(feature = "gpu")]
        Backend::Gpu { .. } if trainer.field.pattern != AntennaPattern::Iso => {
            note!("corf-array: elements with a pattern are learnt and observed on the processor; light is on the GPU");
            Ok(trainer)
        }
        #[cfg(feature = "gpu")]
        Backend::Gpu { .. } if !corf::array_field::gpu::forms(&trainer.field.sensor) => {
            note!(
                "corf-array: mvdr spectra with a loading under a ten-thousandth of the number of elements need double precision: they are learnt and observed \
                 on the processor; light is on the GPU"
            );
            Ok(trainer)
        }
        #[cfg(feature = "gpu")]
        Backend::Gpu { number, .. } => {
            use corf_gpu::AdapterOptions;
            Ok(trainer.on_gpu(&AdapterOptions { number: *number, software: true, ..AdapterOptions::default() })?)
        }
    }
}

/// Light as in `corf-gs`, radio as emitters.
pub const FAMILY: Family = Family {
    variants: &[Variant {
        id: "corf-array",
        help: "beyond the paper: light as in corf-gs, radio as emitters seen through the receiver's own array",
        preset: "",
    }],
    decided: &[],
    create: |_, settings, backend| Ok(Box::new(CorfArray::new(&settings, backend)?)),
    open: Open::Saved(|run| Ok(Box::new(ArrayPredictor::load(run.folder, run.config, run.dataset, run.backend)?))),
    schema: || schema_for!(CorfArrayConfig),
    inlined: &["light.reconstruction", "radio"],
    raster: Some(raster_of),
    can: Abilities {
        online: true,
        follows: false,
        begins_with_gaussians: false,
        emitters: true,
        on_processor: false,
        looks_up: false,
        fixed_array: false,
    },
};

/// The method of [`FAMILY`].
pub struct CorfArray {
    config: CorfArrayConfig,
    backend: Backend,
    checkpoints: Option<Checkpoints>,
}

impl CorfArray {
    /// The method; `settings` are keys of [`ArrayConfig`], and in the table `light` keys of `corf-gs`.
    ///
    /// # Errors
    /// A key that does not exist, or a value out of range.
    pub fn new(settings: &toml::Table, backend: &Backend) -> Result<Self> {
        let config = CorfArrayConfig::parse(settings)?;
        Ok(Self { config, backend: backend.clone(), checkpoints: None })
    }

    /// The sensor, where the configuration fits it.
    fn sensor(&self, training: &TrainingSet<'_>) -> Result<SensorSettings> {
        let sensor = sensor_of(training)?;
        ensure!(
            matches!(sensor, SensorSettings::Lobes { .. }) || self.config.radio.surface != Some(Surface::Splats),
            "corf-array: surface = \"splats\" is for mpc spectra: what a beam sees is no picture of surfaces\n  help: leave the key out"
        );
        Ok(sensor)
    }

    /// The settings of light on a data set: where radio has a field of its own, the Gaussians need not show it.
    fn light(&self, training: &TrainingSet<'_>) -> Result<CorfGsConfig> {
        let mut light = self.config.light.clone();
        if !self.config.radio.is_over_splats(&self.sensor(training)?) {
            light.reconstruction.radio_weight = 0.0;
            light.reconstruction.radio_pyramid_levels = Some(1);
        }
        Ok(light)
    }

    /// The true images that are seen from each training keyframe. A note says that this is no method.
    fn images(&self, scene: &SceneBehind, training: &TrainingSet<'_>) -> Result<Vec<Vec<Image>>> {
        note!("corf-array: an oracle, no method: sources are the transmitter's true mirror images in {}", scene.scene.name);
        let least_power = 10f64.powf(0.1 * training.required_db_range()?.min_db) / self.sensor(training)?.peak();
        images::seen(scene, &training.poses(), least_power)
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

    fn predicts_at_work(&self) -> bool {
        true
    }

    fn uses_ground_truth_depth(&self) -> bool {
        self.config.light.reconstruction.consumes_ground_truth_depth()
    }

    fn uses_scene(&self) -> bool {
        self.config.oracle_scene.is_some()
    }

    /// Depth comes from views of one thing from several places.
    fn least_keyframes(&self) -> usize {
        2
    }

    fn idle_keys(&self, training: Option<&TrainingSet<'_>>) -> Result<Vec<IdleKey>> {
        const POINTS: &str = "radio has a field of its own where surfaces are points, and light's Gaussians do not learn it";
        const ORACLE: &str = "with oracle_scene sources are the true images, and none are found";
        let CorfArrayConfig { light, oracle_scene, radio } = &self.config;
        let sensor = training.map(|training| self.sensor(training)).transpose()?;
        let mut idle: Vec<IdleKey> = light.idle_keys();
        if sensor.is_some_and(|sensor| !radio.is_over_splats(&sensor)) {
            let of_radio = ["rf_weight", "rf_target", "rf_pyramid_levels", "rf_sh_degree", "optimizer.rf"];
            idle.extend(IdleKey::all(of_radio.map(|key| (key, false, POINTS))));
        }
        idle = idle.into_iter().map(|key| key.within("light")).collect();
        idle.extend(radio.idle_keys(sensor.as_ref()));
        if oracle_scene.is_some() {
            let of_births = ["rays", "ray_range_db", "votes", "ray_width_deg", "refine_sources"];
            idle.extend(IdleKey::all(of_births.map(|key| (key, false, ORACLE))));
        }
        Ok(idle)
    }

    fn check_files(&self, training: &TrainingSet<'_>) -> Result<()> {
        self.sensor(training)?;
        if let Some(path) = &self.config.oracle_scene {
            training.scene_behind(path).with_context(|| format!("in key {ORACLE_SCENE}"))?;
        }
        self.light(training)?.check_keyframes(self.id(), "light.", training)
    }

    fn keep_checkpoints(&mut self, checkpoints: Checkpoints) {
        self.checkpoints = Some(checkpoints);
    }

    fn reconstruct(
        &self,
        training: &TrainingSet<'_>,
        seed: u64,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>> {
        let CorfArrayConfig { light, oracle_scene, radio } = &self.config;
        let (light_camera, radio_camera, range) =
            (training.light_camera(), training.radio_camera(), training.required_db_range()?);
        let images = oracle_scene.as_ref().map(|path| self.images(&training.scene_behind(path)?, training)).transpose()?;
        let pattern = training.receiver().map_or(AntennaPattern::Iso, |receiver| receiver.pattern);
        if pattern.elements().is_some() {
            note!("corf-array: elements with a response each are taken to be alike, with the mean of their gains");
        }
        let radio = ArrayTrainer::new(*radio, self.sensor(training)?, radio_camera, range, seed).of_elements(pattern);
        let radio = on_device(radio, &self.backend)?;
        let reconstruction = self.light(training)?.reconstruction;
        let device = light.device(&self.backend)?;
        let predict = |light: Field, radio: ArrayField| -> Box<dyn Predictor> {
            let light = FieldPredictor::new(light, self.config.light.raster, &self.backend);
            Box::new(ArrayPredictor::new(light, radio, range, &self.backend))
        };
        let online = Online {
            light: Reconstructor::new(device, reconstruction, light_camera, radio_camera, range, seed)?,
            radio,
            training,
            images,
            checkpointer: Checkpointer::new(self.checkpoints.clone()),
            ahead: VecDeque::new(),
            radio_s: vec![],
            advance,
            predict: &predict,
        };
        let (mut light, radio) = online.run()?;
        ensure!(
            light.gaussian_count() > 0,
            "corf-array: {} training keyframes gave no Gaussians, so there is no field\n  help: `corf dataset validate` says whether images are \
             black or depth is empty",
            training.len()
        );
        let field = FieldPredictor::learnt(light.field()?, self.config.light.raster, &self.backend)?.clearing(light);
        Ok(Box::new(ArrayPredictor::new(field, radio.into_field(), range, &self.backend)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf::array_field::Wave;
    use corf_raytrace::radio::{Arrival, PlanarArray};
    use corf_raytrace::spectrum::SpectrumSettings;
    use corf_scene::model::world_from_array;
    use corf_scene::{Pinhole, Rigid3, Rng};
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
            (SpectrumKind::Mvdr, RearHalfSpace::Gated),
            (SpectrumKind::Mvdr, RearHalfSpace::Aliased),
        ] {
            // Every arrival is in a delay tap of its own, so that none of them are coherent.
            let made = SpectrumSettings {
                kind,
                array,
                elements: None,
                rear,
                lobe_width_deg: 2.0,
                bandwidth_hz: 1e9,
                loading: 0.1,
                seed: 1,
            };
            let truth = made.form(std::slice::from_ref(&arrivals), &camera, &pose);
            let gated = rear == RearHalfSpace::Gated;
            let (elements, spacing_wavelengths) = ([8, 8], [0.5, 0.6]);
            let settings = match kind {
                SpectrumKind::Mpc => SensorSettings::Lobes { width_deg: 2.0 },
                SpectrumKind::Mvdr => SensorSettings::Capon { elements, spacing_wavelengths, gated, loading: 0.1 },
                _ => SensorSettings::Beam { elements, spacing_wavelengths, gated },
            };
            let seen: Vec<_> =
                waves.iter().filter(|w| kind == SpectrumKind::Mpc || !gated || w.direction[0] > 0.0).copied().collect();
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
        assert_eq!(plain.radio, ArrayConfig::default());
        let other = config("rate = 0.25\nlight.iterations_per_keyframe = 40\nlight.optimizer.rf.sh_dc = 0.01").unwrap();
        assert_eq!((other.radio.rate, other.light.reconstruction.iterations_per_keyframe), (0.25, 40));
        for wrong in [
            "rate = -1.0",
            "rf_weight = 0.1",
            "light.iterations = 3",
            "light.fine_tune_epochs = 1",
            "light.coupling = \"frozen\"",
            "oracle_scene = \"lobby.toml\"\nsources = false",
        ] {
            assert!(config(wrong).is_err(), "{wrong}");
        }
        // Of an oracle's scene a record keeps no path of this machine; without one it is as ever.
        let oracle = config("oracle_scene = \"/here/lobby.toml\"").unwrap();
        assert_eq!(serde_json::json!(oracle)["oracle_scene"], "lobby.toml");
        assert!(serde_json::json!(plain).get("oracle_scene").is_none());
    }
}
