//! The baseline RF-3DGS (Zhang et al. 2026): stock 3D Gaussian splatting of the images, then RF on its frozen geometry. Two rows: as published, and
//! with the two defects of the published RF stage mended, each alone and both (docs/baselines.md).

use crate::device::Backend;
use crate::methods::family::{Abilities, Family, Open, Variant, over_defaults};
use crate::methods::field::FieldPredictor;
use crate::methods::initial::Initial;
use crate::methods::interface::{Advance, Checkpoints, Method, Predictor, StageTime, TrainingSet, shown};
use crate::methods::stepwise::{self, Stepwise};
use crate::metrics::Prediction;
use anyhow::Result;
use corf::{Field, IdleKey, RasterConfig};
use corf_baselines::rf_3dgs::{Rf3dgsCheckpoint, Rf3dgsConfig, Rf3dgsReconstructor, Rf3dgsTimes, SparsePoint, write_ply};
use corf_scene::Rigid3;
use schemars::schema_for;
use std::path::Path;

/// File of a run folder with the points it began with.
pub const POINTS: &str = "initial_points.ply";

/// RF-3DGS, as published and with the defects of its RF stage mended.
pub const FAMILY: Family = Family {
    variants: &[
        Variant {
            id: "rf-3dgs",
            help: "baseline RF-3DGS: offline 3D Gaussian splatting, then RF on its frozen geometry, as published",
            preset: "",
        },
        Variant {
            id: "rf-3dgs-corrected",
            help: "rf-3dgs with a fresh optimiser in the RF stage and the background of a direction without power",
            preset: "rf_moments = \"zero\"\nrf_background = \"floor\"",
        },
        Variant {
            id: "rf-3dgs-fresh-moments",
            help: "rf-3dgs with a fresh optimiser in the RF stage alone",
            preset: "rf_moments = \"zero\"",
        },
        Variant {
            id: "rf-3dgs-floor",
            help: "rf-3dgs with the background of a direction without power alone",
            preset: "rf_background = \"floor\"",
        },
    ],
    decided: &["rf_moments", "rf_background"],
    create: |id, settings, backend| Ok(Box::new(Rf3dgs::new(id, settings, backend)?)),
    open: Open::Saved(|run| Ok(Box::new(FieldPredictor::load(run.folder, raster_of(run.config)?, run.dataset, run.backend)?))),
    schema: || schema_for!(Rf3dgsConfig),
    inlined: &[],
    raster: Some(raster_of),
    can: Abilities {
        online: false,
        follows: false,
        begins_with_gaussians: true,
        emitters: false,
        on_processor: false,
        looks_up: false,
        fixed_array: false,
    },
};

/// A method of [`FAMILY`].
pub struct Rf3dgs {
    id: String,
    config: Rf3dgsConfig,
    backend: Backend,
    checkpoints: Option<Checkpoints>,
}

/// The rasteriser's settings in a run's resolved configuration.
///
/// # Errors
/// A configuration of another version.
fn raster_of(config: &serde_json::Value) -> Result<RasterConfig> {
    Ok(serde_json::from_value::<Rf3dgsConfig>(config.clone())?.raster())
}

impl Rf3dgs {
    /// The method of that name; `settings` are keys of [`Rf3dgsConfig`].
    ///
    /// # Errors
    /// A key that does not exist, or a value out of range.
    pub fn new(id: &str, settings: toml::Table, backend: &Backend) -> Result<Self> {
        let config: Rf3dgsConfig = over_defaults(settings)?;
        config.validate()?;
        Ok(Self { id: id.to_owned(), config, backend: backend.clone(), checkpoints: None })
    }
}

impl Method for Rf3dgs {
    fn id(&self) -> &str {
        &self.id
    }

    fn config(&self) -> serde_json::Value {
        serde_json::json!(self.config)
    }

    fn device(&self) -> String {
        self.backend.name()
    }

    fn unit(&self) -> &'static str {
        "steps"
    }

    /// The scene's extent is that of the cameras, and points are triangulated.
    fn least_keyframes(&self) -> usize {
        2
    }

    fn keep_checkpoints(&mut self, checkpoints: Checkpoints) {
        self.checkpoints = Some(checkpoints);
    }

    fn idle_keys(&self, _training: Option<&TrainingSet<'_>>) -> Result<Vec<IdleKey>> {
        Ok(self.config.idle_keys())
    }

    fn check_files(&self, training: &TrainingSet<'_>) -> Result<()> {
        self.config.initial_gaussians.as_ref().map_or(Ok(()), |file| Initial::read(file)?.check(training))
    }

    fn reconstruct(
        &self,
        training: &TrainingSet<'_>,
        seed: u64,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>> {
        let config = &self.config;
        let total = config.total_steps();
        let device = self.backend.make(config.optimizer(), config.raster(), &config.empty_field())?;
        let (light, radio, range) = (training.light_camera(), training.radio_camera(), training.required_db_range()?);
        let mut reconstructor = Rf3dgsReconstructor::new(device, config.clone(), light, radio, range, seed)?;
        if let Some(file) = &config.initial_gaussians {
            let initial = Initial::read(file)?;
            initial.report(&self.id, (config.sh_degree, None), config.raster().antialias);
            reconstructor.start_from(initial.coupled(config.empty_field(), Rf3dgsConfig::RADIO_TARGET, training)?);
        }
        for k in 0..training.len() {
            reconstructor.receive(training.keyframe(k)?)?;
            advance(Advance::of(0, total))?;
        }
        let resumed = stepwise::run(&mut reconstructor, total, self.checkpoints.as_ref(), advance)?;
        let stages = stages(reconstructor.times());
        let gaussians = Some(reconstructor.gaussian_count());
        advance(Advance { gaussians, stages: &stages, resumed_steps: resumed, ..Advance::of(total, total) })?;
        let points = reconstructor.points().to_vec();
        let field = FieldPredictor::learnt(reconstructor.field()?, config.raster(), &self.backend)?.clearing(reconstructor);
        Ok(Box::new(WithPoints { field, points }))
    }
}

fn stages(times: Rf3dgsTimes) -> Vec<StageTime> {
    let named = [("points", times.points_s), ("optical", times.light_s), ("rf", times.radio_s)];
    named.map(|(name, seconds)| StageTime { name: name.to_owned(), seconds }).into()
}

impl Stepwise for Rf3dgsReconstructor {
    fn begin(&mut self) -> corf::Result<()> {
        Self::begin(self)
    }

    fn resume(&mut self, path: &Path, checkpoints: &Checkpoints) -> Result<()> {
        let checkpoint = Rf3dgsCheckpoint::read(path)?;
        checkpoints.check_tag(checkpoint.tag())?;
        Ok(self.restore(&checkpoint)?)
    }

    fn keep(&mut self, path: &Path, tag: &str) -> corf::Result<()> {
        self.checkpoint(tag)?.write(path)
    }

    fn train(&mut self, most: usize) -> corf::Result<()> {
        Self::train(self, most).map(|_| ())
    }

    fn steps_done(&self) -> usize {
        Self::steps_done(self)
    }

    fn gaussian_count(&mut self) -> usize {
        Self::gaussian_count(self)
    }

    fn field(&mut self) -> Option<Field> {
        shown(Self::field(self))
    }
}

/// The field, and the points it grew from for whoever wants to begin with the same.
struct WithPoints {
    field: FieldPredictor,
    points: Vec<SparsePoint>,
}

impl Predictor for WithPoints {
    fn render(&mut self, world_from_camera: &Rigid3) -> Result<Prediction> {
        self.field.render(world_from_camera)
    }

    fn gaussians(&self) -> Option<usize> {
        self.field.gaussians()
    }

    fn save(&self, run: &Path) -> Result<()> {
        if !self.points.is_empty() {
            write_ply(&run.join(POINTS), &self.points)?;
        }
        self.field.save(run)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::registry::settings;
    use corf_baselines::rf_3dgs::{RadioBackground, RadioMoments};

    fn make(id: &str, text: &str) -> Result<Rf3dgs> {
        Rf3dgs::new(id, settings(id, &text.parse().unwrap())?, &Backend::Cpu)
    }

    #[test]
    fn the_rows_differ_as_their_names_say_and_yield_to_overrides() {
        let (published, corrected) = (make("rf-3dgs", "").unwrap().config, make("rf-3dgs-corrected", "").unwrap().config);
        assert_eq!((published.light_steps, published.radio_steps), (30_000, 10_000));
        assert_eq!((published.radio_moments, published.radio_background), (RadioMoments::Restored, RadioBackground::Black));
        let mended = Rf3dgsConfig { radio_moments: RadioMoments::Zero, radio_background: RadioBackground::Floor, ..published };
        assert_eq!(corrected, mended);
        let short = make("rf-3dgs", "optical_steps = 15000\nrf_steps = 25000\ndensity.gradient = 1e-4").unwrap().config;
        assert_eq!((short.light_steps, short.radio_steps, short.density.gradient), (15_000, 25_000, 1e-4));
        assert_eq!((short.density.every, short.rates), (100, Rf3dgsConfig::default().rates));
        for (text, words) in [
            ("rf_background = \"floor\"", "rf-3dgs-corrected"),
            ("optical_step = 1", "optical_step"),
            ("density.often = 1", "often"),
            ("sh_degree = 4", "`sh_degree`"),
        ] {
            let error = format!("{:#}", make("rf-3dgs", text).err().unwrap());
            assert!(error.contains(words), "{error}");
        }
    }
}
