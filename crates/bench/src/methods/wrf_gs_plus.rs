//! The baseline WRF-GS+ (Wen et al. 2025): Gaussians of the spectrum alone, deformed by a network for each receiver. Two rows: as published, and
//! with the displacement used that the published program predicts and leaves unused (docs/baselines.md).

use crate::device::Backend;
#[cfg(feature = "gpu")]
use crate::device::network_options;
use crate::methods::family::{Abilities, Family, Open, Variant, over_defaults};
use crate::methods::field::jet_of;
use crate::methods::interface::{Advance, Checkpoints, Method, Predictor, TrainingSet};
use crate::methods::stepwise::{self, Stepwise};
use crate::metrics::{Prediction, RadioPrediction};
use anyhow::{Result, ensure};
use corf::IdleKey;
use corf_baselines::wrf_gs_plus::{
    FixedArrayTrainer, WrfGsPlusCheckpoint, WrfGsPlusConfig, WrfGsPlusCpuTrainer, WrfGsPlusField, WrfGsPlusModel,
    WrfGsPlusReconstructor, WrfGsPlusTrainer,
};
use corf_scene::Rigid3;
use corf_scene::dataset::{Dataset, FixedArray};
use corf_scene::keyframe::Modalities;
use schemars::schema_for;
use std::path::Path;

/// File of a run folder with the field.
const FIELD: &str = "wrf-gs-plus";

/// WRF-GS+, as published and with its displacements used.
pub const FAMILY: Family = Family {
    variants: &[
        Variant {
            id: "wrf-gs-plus",
            help: "baseline: WRF-GS+ as published, Gaussians of the spectrum alone that a network deforms; for a GPU",
            preset: "",
        },
        Variant {
            id: "wrf-gs-plus-corrected",
            help: "wrf-gs-plus with the predicted displacements used",
            preset: "move_positions = true",
        },
    ],
    decided: &["move_positions"],
    create: |id, settings, backend| Ok(Box::new(WrfGsPlus::new(id, settings, backend)?)),
    open: Open::Saved(|run| Ok(Box::new(WrfGsPlusPredictor::load(run.folder, run.dataset, run.backend)?))),
    schema: || schema_for!(WrfGsPlusConfig),
    inlined: &[],
    raster: None,
    can: Abilities {
        online: false,
        follows: false,
        begins_with_gaussians: false,
        emitters: false,
        on_processor: false,
        looks_up: false,
        fixed_array: true,
    },
};

/// A method of [`FAMILY`].
pub struct WrfGsPlus {
    id: String,
    config: WrfGsPlusConfig,
    backend: Backend,
    checkpoints: Option<Checkpoints>,
}

impl WrfGsPlus {
    /// The method of that name; `settings` are keys of [`WrfGsPlusConfig`].
    ///
    /// # Errors
    /// A key that does not exist, or a value out of range.
    pub fn new(id: &str, settings: toml::Table, backend: &Backend) -> Result<Self> {
        let config: WrfGsPlusConfig = over_defaults(settings)?;
        config.validate()?;
        Ok(Self { id: id.to_owned(), config, backend: backend.clone(), checkpoints: None })
    }
}

/// A trainer without Gaussians, with these parameters of its network.
pub fn trainer(backend: &Backend, config: &WrfGsPlusConfig, parameters: Vec<f32>) -> Result<Box<dyn WrfGsPlusTrainer>> {
    match backend {
        Backend::Cpu => Ok(Box::new(WrfGsPlusCpuTrainer::new(config, parameters)?)),
        #[cfg(feature = "gpu")]
        Backend::Gpu { number, .. } => {
            let options = network_options(*number, config.half_precision);
            Ok(Box::new(corf_baselines::wrf_gs_plus::WrfGsPlusGpuTrainer::new(&options, config, &parameters)?))
        }
    }
}

/// The same for an array that stands still, whose spectra only the processor draws.
fn array_trainer(
    backend: &Backend,
    config: &WrfGsPlusConfig,
    array: &FixedArray,
    parameters: Vec<f32>,
) -> Result<Box<dyn WrfGsPlusTrainer>> {
    match backend {
        Backend::Cpu => Ok(Box::new(FixedArrayTrainer::new(config, array, parameters)?)),
        #[cfg(feature = "gpu")]
        Backend::Gpu { .. } => anyhow::bail!(
            "WRF-GS+ of an array that stands still runs on the processor: what draws Gaussians on a GPU draws them through a pinhole\n  help: give \
             --device cpu, and a size for it, such as --set random_points=2000 --set array_spread_m=2 --set density.until=0"
        ),
    }
}

/// A reconstruction at work, and where what predicts is made.
struct AtWork<'a> {
    reconstructor: WrfGsPlusReconstructor,
    backend: &'a Backend,
}

impl Stepwise for AtWork<'_> {
    fn begin(&mut self) -> corf::Result<()> {
        self.reconstructor.begin()
    }

    fn resume(&mut self, path: &Path, checkpoints: &Checkpoints) -> Result<()> {
        let checkpoint = WrfGsPlusCheckpoint::read(path)?;
        checkpoints.check_tag(checkpoint.tag())?;
        Ok(self.reconstructor.restore(&checkpoint)?)
    }

    fn keep(&mut self, path: &Path, tag: &str) -> corf::Result<()> {
        self.reconstructor.checkpoint(tag)?.write(path)
    }

    fn train(&mut self, most: usize) -> corf::Result<()> {
        self.reconstructor.train(most).map(|_| ())
    }

    fn steps_done(&self) -> usize {
        self.reconstructor.steps_done()
    }

    fn gaussian_count(&mut self) -> usize {
        self.reconstructor.gaussian_count()
    }

    fn predictor(&mut self) -> Result<Option<Box<dyn Predictor>>> {
        let field = self.reconstructor.field()?;
        let of =
            |field| Box::new(WrfGsPlusPredictor { field, backend: self.backend.clone(), trainer: None }) as Box<dyn Predictor>;
        Ok((!field.gaussians.is_empty()).then(|| of(field)))
    }
}

impl Method for WrfGsPlus {
    fn id(&self) -> &str {
        &self.id
    }

    fn config(&self) -> serde_json::Value {
        serde_json::json!(self.config)
    }

    fn device(&self) -> String {
        self.backend.name_with_precision(self.config.half_precision)
    }

    fn unit(&self) -> &'static str {
        "steps"
    }

    fn predicts_at_work(&self) -> bool {
        true
    }

    /// The box in which the first Gaussians lie follows from the extent of the receivers.
    fn least_keyframes(&self) -> usize {
        2
    }

    fn needs(&self) -> Modalities {
        Modalities { light: false, radio: true }
    }

    fn idle_keys(&self, training: Option<&TrainingSet<'_>>) -> Result<Vec<IdleKey>> {
        // Before it is known what they are used on, all of them may mean something.
        Ok(training.map_or_else(Vec::new, |training| self.config.idle_keys(training.fixed_array().is_some())))
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
        let (config, total) = (&self.config, self.config.iterations);
        let (range, parameters) = (training.required_db_range()?, WrfGsPlusModel::new(config).network.initial(seed));
        let reconstructor = match training.fixed_array() {
            Some(array) => {
                let trainer = array_trainer(&self.backend, config, array, parameters)?;
                WrfGsPlusReconstructor::of_array(trainer, config.clone(), *array, range, seed)?
            }
            None => {
                let trainer = trainer(&self.backend, config, parameters)?;
                let (light, radio) = (training.light_camera(), training.radio_camera());
                WrfGsPlusReconstructor::new(trainer, config.clone(), light, radio, range, seed)?
            }
        };
        let mut work = AtWork { reconstructor, backend: &self.backend };
        for k in 0..training.len() {
            work.reconstructor.receive(&training.keyframe(k)?)?;
            advance(Advance::of(0, total))?;
        }
        let resumed_steps = stepwise::run(&mut work, total, self.checkpoints.as_ref(), advance)?;
        let mut reconstructor = work.reconstructor;
        let gaussians = Some(reconstructor.gaussian_count());
        advance(Advance { gaussians, resumed_steps, ..Advance::of(total, total) })?;
        let field = reconstructor.field()?;
        field.gaussians.check_learnt()?;
        Ok(Box::new(WrfGsPlusPredictor { field, backend: self.backend.clone(), trainer: Some(reconstructor.into_trainer()) }))
    }
}

/// A trained field.
pub struct WrfGsPlusPredictor {
    field: WrfGsPlusField,
    backend: Backend,
    /// One that holds the field; made when it is first needed.
    trainer: Option<Box<dyn WrfGsPlusTrainer>>,
}

impl WrfGsPlusPredictor {
    /// Reads the field of a run folder.
    ///
    /// # Errors
    /// A missing or damaged file, or a field of another dataset's camera.
    pub fn load(run: &Path, dataset: &Dataset, backend: &Backend) -> Result<Self> {
        let field = WrfGsPlusField::read(&run.join(FIELD))?;
        let same = match dataset.fixed_array() {
            Some(array) => field.array.as_ref() == Some(array),
            None => field.array.is_none() && field.meta.radio_camera == dataset.radio_camera(),
        };
        ensure!(same, "{}: the field's camera or array is not the dataset's", run.join(FIELD).display());
        Ok(Self { field, backend: backend.clone(), trainer: None })
    }
}

impl Predictor for WrfGsPlusPredictor {
    fn render(&mut self, world_from_camera: &Rigid3) -> Result<Prediction> {
        let mut trainer = match self.trainer.take() {
            Some(trainer) => trainer,
            None => {
                let (config, parameters) = (&self.field.config, self.field.parameters.clone());
                let mut made = match &self.field.array {
                    Some(array) => array_trainer(&self.backend, config, array, parameters)?,
                    None => trainer(&self.backend, config, parameters)?,
                };
                self.field.load(made.as_mut())?;
                made
            }
        };
        let radio = self.field.render(trainer.as_mut(), world_from_camera)?;
        self.trainer = Some(trainer);
        ensure!(
            radio.pixels.iter().all(|v| v.is_finite()),
            "a pixel of the prediction is not a finite number\n  help: the network has diverged; train it with smaller rates.network"
        );
        let target = self.field.meta.radio_target;
        let scalar = target.scalar(&radio);
        let jet = jet_of(target, &radio, &scalar);
        Ok(Prediction { image: None, radio: Some(RadioPrediction { jet, scalar }), depth_m: None })
    }

    fn gaussians(&self) -> Option<usize> {
        Some(self.field.gaussians.len())
    }

    fn save(&self, run: &Path) -> Result<()> {
        Ok(self.field.write(&run.join(FIELD))?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::registry::settings;
    use corf::target::RadioTarget;

    fn make(id: &str, text: &str) -> Result<WrfGsPlus> {
        WrfGsPlus::new(id, settings(id, &text.parse().unwrap())?, &Backend::Cpu)
    }

    #[test]
    fn the_rows_differ_as_their_names_say_and_yield_to_overrides() {
        let (published, corrected) = (make("wrf-gs-plus", "").unwrap().config, make("wrf-gs-plus-corrected", "").unwrap().config);
        assert_eq!(published, WrfGsPlusConfig::default());
        assert_eq!(corrected, WrfGsPlusConfig { move_positions: true, ..published });
        let other = make("wrf-gs-plus", "iterations = 5000\nrf_target = \"db\"\nrates.network = [1e-3, 1e-4]").unwrap().config;
        assert_eq!((other.iterations, other.radio_target, other.rates.network), (5000, RadioTarget::Db, [1e-3, 1e-4]));
        assert_eq!((other.rates.sh_dc, other.density), (2.5e-3, WrfGsPlusConfig::default().density));
        for (text, words) in [
            ("move_positions = true", "wrf-gs-plus-corrected"),
            ("steps = 1", "steps"),
            ("density.often = 1", "often"),
            ("skip = 9", "`skip`"),
        ] {
            let error = format!("{:#}", make("wrf-gs-plus", text).err().unwrap());
            assert!(error.contains(words), "{error}");
        }
    }
}
