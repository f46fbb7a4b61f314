//! NeRF², as published and corrected: an implicit field of the spectrum alone.
//!
//! The published code regresses the grey value of a spectrum's image, a level in decibels; here the target is the data set's scalar level in
//! `[0, 1]`. Jet colours, which the paper's metrics look at, are made of the prediction.

use crate::device::Backend;
#[cfg(feature = "gpu")]
use crate::device::network_options;
use crate::methods::family::{Abilities, Family, Open, Variant, over_defaults};
use crate::methods::interface::{Advance, Checkpoints, Method, Predictor, PredictorReader, TrainingSet};
use crate::methods::stepwise::report_unless_kept;
use crate::metrics::Prediction;
use crate::terminal::interrupt;
use anyhow::{Context, Result, ensure};
use corf_baselines::nerf2::{
    Nerf2Config, Nerf2CpuTrainer, Nerf2Model, Nerf2Trainer, PUBLISHED_RAYS_M, Sight, TrainedNerf2, TrainingRays,
};
use corf_scene::dataset::{Dataset, FixedArray};
use corf_scene::keyframe::Modalities;
use corf_scene::{Keyframe, Pinhole, Radio, Rigid3};
use schemars::schema_for;
use std::cell::RefCell;
use std::path::Path;
use std::time::{Duration, Instant};

/// Time between two reports of progress.
const REPORT_INTERVAL: Duration = Duration::from_secs(2);
/// File of a run folder with the field.
const FIELD: &str = "nerf2";

/// NeRF², as published and corrected.
pub const FAMILY: Family = Family {
    variants: &[
        Variant {
            id: "nerf2",
            help: "baseline: NeRF² as published, an implicit field of the spectrum alone; for a GPU",
            preset: "",
        },
        Variant {
            id: "nerf2-corrected",
            help: "baseline: NeRF² with its schedule, its sampling and its last sample corrected",
            preset: CORRECTED,
        },
    ],
    decided: &[],
    create: |id, settings, backend| Ok(Box::new(Nerf2::new(id, settings, backend)?)),
    open: Open::Saved(|run| Ok(Box::new(Nerf2Field::load(run.folder, run.dataset, run.backend)?))),
    schema: || schema_for!(Nerf2Config),
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

/// Settings of `nerf2-corrected`, which correct what is a defect in the published code: the rate falls over the whole budget instead of rising
/// again, points are drawn anew in each step, so that the field is seen between fixed distances too, and the last point of a ray counts.
const CORRECTED: &str = "\
cosine_steps = 0
jitter = true
last_sample = true
";

/// A method of [`FAMILY`].
pub struct Nerf2 {
    id: String,
    config: Nerf2Config,
    /// Whether beginning and end of rays were chosen.
    chosen: [bool; 2],
    backend: Backend,
    checkpoints: Option<Checkpoints>,
}

impl Nerf2 {
    /// The method of that name; `settings` are keys of [`Nerf2Config`].
    ///
    /// # Errors
    /// A key that does not exist, or a value out of range.
    pub fn new(id: &str, settings: toml::Table, backend: &Backend) -> Result<Self> {
        let chosen = ["near_m", "far_m"].map(|key| settings.contains_key(key));
        let config: Nerf2Config = over_defaults(settings)?;
        config.validate()?;
        Ok(Self { id: id.to_owned(), config, chosen, backend: backend.clone(), checkpoints: None })
    }
}

/// The rays of a data set's pixels: those of a camera, or of an array that stands still.
fn sight(array: Option<&FixedArray>, camera: Pinhole) -> Sight {
    match array {
        None => Sight::Moving(camera),
        Some(array) => Sight::Fixed {
            origin_m: array.position_m.map(|v| v as f32),
            directions: array.directions().map(|d| [d.x as f32, d.y as f32, d.z as f32]),
        },
    }
}

/// A trainer that holds these parameters.
fn trainer(backend: &Backend, field: &TrainedNerf2) -> Result<Box<dyn Nerf2Trainer>> {
    match backend {
        Backend::Cpu => Ok(Box::new(Nerf2CpuTrainer::new(&field.config, field.transmitter_m, field.parameters.clone())?)),
        #[cfg(feature = "gpu")]
        Backend::Gpu { number, .. } => {
            let options = network_options(*number, field.config.half_precision);
            Ok(Box::new(corf_baselines::nerf2::Nerf2GpuTrainer::new(
                &options,
                &field.config,
                field.transmitter_m,
                &field.parameters,
            )?))
        }
    }
}

impl Method for Nerf2 {
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

    fn keep_checkpoints(&mut self, checkpoints: Checkpoints) {
        self.checkpoints = Some(checkpoints);
    }

    fn predicts_at_work(&self) -> bool {
        true
    }

    fn needs(&self) -> Modalities {
        Modalities { light: false, radio: true }
    }

    fn settle(&mut self, dataset: &Dataset) -> Result<()> {
        if dataset.fixed_array().is_some() {
            let c = &mut self.config;
            for ((end, published), chosen) in [&mut c.near_m, &mut c.far_m].into_iter().zip(PUBLISHED_RAYS_M).zip(self.chosen) {
                if !chosen {
                    *end = published;
                }
            }
        }
        Ok(self.config.validate()?)
    }

    fn reconstruct(
        &self,
        training: &TrainingSet<'_>,
        seed: u64,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>> {
        let range = training.required_db_range()?;
        let sight = sight(training.fixed_array(), training.radio_camera());
        let mut rays = TrainingRays::new(sight.clone(), seed);
        for k in 0..training.len() {
            let Keyframe { index, world_from_camera, radio, .. } = training.keyframe(k)?;
            let Radio { spectrum } = radio.with_context(|| format!("keyframe {index} has no spectrum"))?;
            rays.push(world_from_camera, &spectrum.map(|&s| range.scalar(s)))?;
        }
        let mut field = TrainedNerf2 {
            config: self.config,
            // The same for all rays: where it is not known, any other constant does as well.
            transmitter_m: training.transmitter_m().unwrap_or_default().map(|v| v as f32),
            parameters: Nerf2Model::new(&self.config).network.initial(seed),
        };
        let mut trainer = trainer(&self.backend, &field)?;
        let with_seed = |c: Checkpoints| Checkpoints { tag: format!("{} seed {seed}", c.tag), ..c };
        let mut checkpointer = Checkpointer { checkpoints: self.checkpoints.clone().map(with_seed), at: Instant::now() };
        let first = checkpointer.resume(trainer.as_mut())?;
        let (schedule, total) = (self.config.schedule(), self.config.iterations);
        let mut reported = Instant::now();
        for step in first..total {
            let interrupted = |trainer: &mut dyn Nerf2Trainer, error: anyhow::Error| {
                // What could not be kept is done again.
                report_unless_kept(checkpointer.keep(&field, trainer));
                error
            };
            interrupt::check().map_err(|e| interrupted(trainer.as_mut(), e))?;
            trainer.step(&rays.batch(&self.config, step as u64), schedule.at(step as u64))?;
            let done = step + 1;
            if done == total || reported.elapsed() >= REPORT_INTERVAL {
                reported = Instant::now();
                let loss = trainer.loss()?;
                ensure!(
                    loss.is_finite(),
                    "{}: the mean squared error of step {done} is {loss}\n  help: the network has diverged; give a smaller rate",
                    self.id
                );
                let held = RefCell::new(trainer.as_mut());
                let make = || -> Result<Option<Box<dyn Predictor>>> {
                    let field = TrainedNerf2 { parameters: held.borrow_mut().state()?.parameters, ..field.clone() };
                    let predictor = Nerf2Field { field, sight: sight.clone(), backend: self.backend.clone(), trainer: None };
                    Ok(Some(Box::new(predictor) as Box<dyn Predictor>))
                };
                let said = advance(Advance { predictor: Some(PredictorReader::new(&make)), ..Advance::of(done, total) });
                said.map_err(|e| interrupted(trainer.as_mut(), e))?;
            }
            if checkpointer.is_due(done) && done < total {
                checkpointer.keep(&field, trainer.as_mut())?;
                checkpointer.at = Instant::now();
            }
        }
        field.parameters = trainer.state()?.parameters;
        Ok(Box::new(Nerf2Field { field, sight, backend: self.backend.clone(), trainer: Some(trainer) }))
    }
}

/// Keeps checkpoints, if any are wanted.
struct Checkpointer {
    /// With the seed in their tag.
    checkpoints: Option<Checkpoints>,
    /// Time at which the last one was kept, or the work began.
    at: Instant,
}

impl Checkpointer {
    /// Goes on from the checkpoint, if there is one; says how many steps it has behind it.
    fn resume(&self, trainer: &mut dyn Nerf2Trainer) -> Result<usize> {
        let Some((c, path)) = self.checkpoints.as_ref().and_then(|c| Some((c, c.to_resume()?))) else { return Ok(0) };
        let (tag, state) = TrainedNerf2::read_state(path)?;
        c.check_tag(&tag)?;
        trainer.restore(&state)?;
        let steps = usize::try_from(state.steps)?;
        c.holds(steps, "steps");
        Ok(steps)
    }

    fn is_due(&self, done: usize) -> bool {
        self.checkpoints.as_ref().is_some_and(|c| c.is_due(done, self.at))
    }

    fn keep(&self, field: &TrainedNerf2, trainer: &mut dyn Nerf2Trainer) -> Result<()> {
        let Some(c) = self.checkpoints.as_ref().filter(|c| c.are_kept()) else { return Ok(()) };
        let state = trainer.state()?;
        field.write_state(&c.path, &c.written_tag(), &state).context("while keeping a checkpoint")?;
        c.holds(usize::try_from(state.steps)?, "steps");
        Ok(())
    }
}

/// A trained field.
pub struct Nerf2Field {
    field: TrainedNerf2,
    sight: Sight,
    backend: Backend,
    /// Made when it is first needed.
    trainer: Option<Box<dyn Nerf2Trainer>>,
}

impl Nerf2Field {
    /// Reads the field of a run folder.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub fn load(run: &Path, dataset: &Dataset, backend: &Backend) -> Result<Self> {
        let field = TrainedNerf2::read(&run.join(FIELD))?;
        Ok(Self { field, sight: sight(dataset.fixed_array(), dataset.radio_camera()), backend: backend.clone(), trainer: None })
    }
}

impl Predictor for Nerf2Field {
    fn render(&mut self, world_from_camera: &Rigid3) -> Result<Prediction> {
        let mut trainer = match self.trainer.take() {
            Some(trainer) => trainer,
            None => trainer(&self.backend, &self.field)?,
        };
        let amplitudes = self.field.render(trainer.as_mut(), &self.sight, world_from_camera)?;
        self.trainer = Some(trainer);
        ensure!(
            amplitudes.pixels().iter().all(|v| v.is_finite()),
            "a pixel of the prediction is not a finite number\n  help: the network has diverged; train it with a smaller rate"
        );
        Ok(Prediction::from_scalar(None, amplitudes.map(|v| v.clamp(0.0, 1.0))))
    }

    fn save(&self, run: &Path) -> Result<()> {
        Ok(self.field.write(&run.join(FIELD))?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::registry::{create, settings};

    #[test]
    fn the_two_rows_differ_in_what_is_corrected_and_yield_to_overrides() {
        let config =
            |id: &str, text: &str| Nerf2::new(id, settings(id, &text.parse().unwrap()).unwrap(), &Backend::Cpu).unwrap().config;
        let (published, corrected) = (config("nerf2", ""), config("nerf2-corrected", ""));
        assert_eq!(
            (published, corrected),
            (Nerf2Config::default(), Nerf2Config { cosine_steps: 0, jitter: true, last_sample: true, ..published })
        );
        let small = config("nerf2-corrected", "width = 32\niterations = 5");
        assert_eq!(small, Nerf2Config { width: 32, iterations: 5, ..corrected });
        for wrong in ["breadth = 32", "width = 0", "rate = -1.0", "samples = 1"] {
            let error = create("nerf2", &wrong.parse().unwrap(), &Backend::Cpu).err().unwrap();
            assert!(format!("{error:#}").contains("in the configuration of nerf2"), "{error:#}");
        }
    }
}
