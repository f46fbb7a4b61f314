//! CORF-GS and its ablations.

mod geometry;
mod live;
mod online;

use crate::device::Backend;
use crate::methods::family::{Abilities, Family, Open, Variant, over_defaults};
use crate::methods::field::FieldPredictor;
use crate::methods::initial::Initial;
use crate::methods::interface::{Advance, Checkpoints, Method, Predictor, StageTime, TrainingSet};
use crate::note;
use anyhow::{Context, Result};
use corf::config::{Coupling, DepthPriorKind, ReconstructionConfig};
use corf::depth::DepthPrior;
use corf::optimizer::{OptimizerConfig, RasterConfig};
use corf::{Device, FieldMeta, IdleKey, Reconstructor};
use corf_scene::keyframe::Modalities;
use corf_scene::words::counted;
use geometry::Geometry;
pub use geometry::{GeometryConfig, StartOpacity};
pub use live::live_overrides;
pub(super) use online::Checkpointer;
use online::Online;
use schemars::{JsonSchema, schema_for};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Configuration of the four CORF-GS rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CorfGsConfig {
    /// Epochs of offline fine-tuning after the last keyframe (paper: "iterations" of the fine-tuning table).
    pub fine_tune_epochs: usize,
    /// Time of fine-tuning instead, seconds: epochs while there is time, one at least. The result depends on the machine and its load.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fine_tune_s: Option<f64>,
    /// Gaussians of light that another program trained (PLY), which the field begins with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_gaussians: Option<PathBuf>,
    /// The finished run whose light and geometry are kept, where radio alone is learnt; table `geometry` of the overrides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<GeometryConfig>,
    /// Rates and constants of the optimiser; table `optimizer` of the overrides.
    pub optimizer: OptimizerConfig,
    /// Constants of the rasteriser; table `raster` of the overrides.
    pub raster: RasterConfig,
    /// Everything else, at the top level of the overrides.
    pub reconstruction: ReconstructionConfig,
}

impl CorfGsConfig {
    pub(super) fn parse(settings: &toml::Table) -> Result<Self> {
        fn take<T: Serialize + DeserializeOwned + Default>(table: &mut toml::Table, key: &str) -> Result<T> {
            let overrides = table.remove(key).map_or_else(|| Ok(toml::Table::new()), toml::Value::try_into);
            overrides.map_err(Into::into).and_then(over_defaults).with_context(|| format!("in key {key}"))
        }
        let mut rest = settings.clone();
        let epochs = rest.remove("fine_tune_epochs").map_or_else(|| Ok(0), toml::Value::try_into);
        let seconds = rest.remove("fine_tune_s").map_or_else(|| Ok(None), |v| v.try_into().map(Some));
        let initial = rest.remove("initial_gaussians").map_or_else(|| Ok(None), |v| v.try_into().map(Some));
        let geometry = rest.remove("geometry").map(GeometryConfig::parse).transpose()?;
        let config = Self {
            geometry,
            initial_gaussians: initial.context("in key initial_gaussians")?,
            fine_tune_epochs: epochs.context("in key fine_tune_epochs")?,
            fine_tune_s: seconds.context("in key fine_tune_s")?,
            optimizer: take(&mut rest, "optimizer")?,
            raster: take(&mut rest, "raster")?,
            reconstruction: over_defaults(rest)?,
        };
        anyhow::ensure!(
            config.fine_tune_s.is_none_or(|s| (1.0..=86_400.0).contains(&s)),
            "key fine_tune_s: the value is out of range\n  help: give 1 to 86 400 seconds"
        );
        anyhow::ensure!(
            config.fine_tune_s.is_none() || config.fine_tune_epochs == 0,
            "fine_tune_epochs and fine_tune_s both say how long fine-tuning takes\n  help: leave one of the two out"
        );
        config.geometry.as_ref().map_or(Ok(()), GeometryConfig::validate)?;
        config.reconstruction.validate()?;
        config.optimizer.validate()?;
        config.raster.validate()?;
        Ok(config)
    }

    /// Units of work of fine-tuning, for progress: epochs, or seconds.
    fn fine_tune_units(&self) -> usize {
        self.fine_tune_s.map_or(self.fine_tune_epochs, |s| s.ceil() as usize)
    }

    /// Keys of the overrides that mean nothing beside the others.
    pub(super) fn idle_keys(&self) -> Vec<IdleKey> {
        self.reconstruction.idle_keys()
    }

    /// The rasteriser's settings in a run's resolved configuration.
    ///
    /// # Errors
    /// A configuration of another version.
    pub fn raster_of(config: &serde_json::Value) -> Result<RasterConfig> {
        Ok(serde_json::from_value::<Self>(config.clone())?.raster)
    }

    /// Checks that the keyframes' sizes suit the configuration, and looks for what the depth prior reads of a data set and beside it; `table` is that
    /// of the overrides in which the keys of `method` stand, with its dot.
    ///
    /// # Errors
    /// Those of [`Reconstructor::check_cameras`]; no depth where the prior is made from it; a map that is missing or cannot be used.
    pub(super) fn check_keyframes(&self, method: &str, table: &str, training: &TrainingSet<'_>) -> Result<()> {
        Reconstructor::check_cameras(&self.reconstruction, &training.light_camera(), &training.radio_camera())?;
        let depth = &self.reconstruction.depth;
        anyhow::ensure!(
            training.has_depth() || !self.reconstruction.consumes_ground_truth_depth() || depth.prior == DepthPriorKind::Measured,
            "{method}: its depth prior is made from the depth of the keyframes, and the data set has none\n  help: pass --set {table}depth.prior=none, \
             or bring maps of your own with --set {table}depth.prior=folder --set {table}depth.folder=DIR, or measured depth with `corf dataset \
             import --depth` (docs/reconstruction.md)"
        );
        let camera = training.light_camera();
        // Nothing that is drawn matters to files.
        let prior = DepthPrior::new(depth, 0)?;
        Ok(prior.check_all(training.indices(), (camera.width, camera.height))?)
    }

    /// A fresh device.
    pub(super) fn device(&self, backend: &Backend) -> Result<Box<dyn Device>> {
        backend.make(self.optimizer, self.raster, &self.reconstruction.empty_field())
    }
}

/// Settings of `corf-gs-fast`. All of a keyframe's steps are taken while the
/// next one is expanded. docs/METHODOLOGY.md says what the missing steps cost.
const FAST: &str = "\
iterations_per_keyframe = 40
overlapped_iterations = 40
";

/// Settings of `corf-gs-live`: what a keyframe waits for behind its expansion is its steps. 30 of them take 23 to 29 ms at 1600×900 on an H200, and
/// the expansion 9 to 16, of the 67 that a camera of 15 keyframes/s leaves; docs/live.md has the account.
const LIVE: &str = "iterations_per_keyframe = 30";

/// Settings of `corf-gs-quality`: what offline passes over all keyframes add to the paper's budget. docs/METHODOLOGY.md has the figures.
const QUALITY: &str = "fine_tune_epochs = 300";

/// Settings of `corf-gs-paper`: the constants that the paper gives, and where it is silent those of
/// on-the-fly novel-view synthesis (Meuleman et al. 2025), which it builds on. docs/METHODOLOGY.md lists what each difference is worth.
const PAPER: &str = "\
visits_per_level = 5
finest_share = 1.0
latest_probability = 0.2
depth_weight = 0.01
depth_weight_decay = 0.9
prune_opacity = 0.05
position_rate = 5e-5
depth.correction = false
depth.min_segment_px = 10.0
optimizer.rf.sh_rest_divisor = 20.0
";

/// Coupled optimisation, as a method and in its ablations.
pub const FAMILY: Family = Family {
    variants: &[
        Variant {
            id: "corf-gs",
            help: "coupled optimisation, optical-guided expansion: the paper's method at its best",
            preset: "",
        },
        Variant { id: "corf-gs-paper", help: "corf-gs with the paper's constants", preset: PAPER },
        Variant {
            id: "corf-gs-fast",
            help: "corf-gs with 40 iterations a keyframe instead of 75, overlapped with the next keyframe's expansion",
            preset: FAST,
        },
        Variant {
            id: "corf-gs-live",
            help: "corf-gs for the lowest latency: 30 iterations a keyframe, each taken before the next keyframe's turn",
            preset: LIVE,
        },
        Variant {
            id: "corf-gs-quality",
            help: "corf-gs for the most quality: 300 epochs over all keyframes behind the last one",
            preset: QUALITY,
        },
        Variant {
            id: "corf-gs-uniform",
            help: "ablation: every pixel spawns with probability 0.1 instead of optical-guided expansion",
            preset: "sampling = \"uniform\"",
        },
        Variant {
            id: "corf-gs-frozen",
            help: "ablation: two stages, optical geometry frozen in the RF stage",
            preset: "coupling = \"frozen\"",
        },
        Variant {
            id: "corf-gs-rf-tuned",
            help: "ablation: two stages, geometry refined by RF in the second",
            preset: "coupling = \"rf-tuned\"",
        },
    ],
    decided: &["coupling", "sampling"],
    create: |id, settings, backend| Ok(Box::new(CorfGs::new(id, &settings, backend)?)),
    open: Open::Saved(|run| {
        let raster = CorfGsConfig::raster_of(run.config)?;
        Ok(Box::new(FieldPredictor::load(run.folder, raster, run.dataset, run.backend)?))
    }),
    schema: || schema_for!(CorfGsConfig),
    inlined: &["reconstruction"],
    raster: Some(CorfGsConfig::raster_of),
    can: Abilities {
        online: true,
        follows: true,
        begins_with_gaussians: true,
        emitters: false,
        on_processor: false,
        looks_up: false,
        fixed_array: false,
    },
};

/// A method of [`FAMILY`].
pub struct CorfGs {
    id: String,
    config: CorfGsConfig,
    backend: Backend,
    checkpoints: Option<Checkpoints>,
    /// The finished half of the field, once it has been asked for.
    geometry: OnceLock<Geometry>,
}

impl CorfGs {
    /// The method of that name; `settings` are keys of [`ReconstructionConfig`] and the tables and keys beside it.
    ///
    /// # Errors
    /// A key that does not exist, or a value out of range.
    pub fn new(id: &str, settings: &toml::Table, backend: &Backend) -> Result<Self> {
        let config = CorfGsConfig::parse(settings)?;
        anyhow::ensure!(
            config.geometry.is_none() || id == "corf-gs",
            "{id}: it is a way to learn light and radio together, and --geometry keeps another run's light\n  help: choose --method corf-gs"
        );
        Ok(Self { id: id.to_owned(), config, backend: backend.clone(), checkpoints: None, geometry: OnceLock::new() })
    }

    /// The finished half of the field, read when it is first asked for.
    fn geometry(&self, of: &GeometryConfig, training: &TrainingSet<'_>) -> Result<&Geometry> {
        if self.geometry.get().is_none() {
            let read = Geometry::read(&self.config, of, training)?;
            return Ok(self.geometry.get_or_init(|| read));
        }
        self.geometry.get().context("a geometry that was read is there")
    }
}

impl Method for CorfGs {
    fn id(&self) -> &str {
        &self.id
    }

    fn config(&self) -> serde_json::Value {
        serde_json::json!(self.config)
    }

    fn device(&self) -> String {
        self.backend.name()
    }

    fn uses_ground_truth_depth(&self) -> bool {
        match &self.config.geometry {
            Some(of) => of.uses_ground_truth_depth,
            None => self.config.reconstruction.consumes_ground_truth_depth(),
        }
    }

    fn unit(&self) -> &'static str {
        if self.config.geometry.is_some() { "epochs" } else { "keyframes" }
    }

    fn reads_light(&self) -> bool {
        self.config.geometry.is_none()
    }

    /// Depth comes from views of one thing from several places.
    fn least_keyframes(&self) -> usize {
        if self.config.geometry.is_some() { 1 } else { 2 }
    }

    /// One modality by itself is learnt as well; what couples the two in stages has nothing to couple then.
    fn needs(&self) -> Modalities {
        let staged = self.config.reconstruction.coupling != Coupling::Joint;
        Modalities { light: staged, radio: staged }
    }

    fn idle_keys(&self, _training: Option<&TrainingSet<'_>>) -> Result<Vec<IdleKey>> {
        match &self.config.geometry {
            Some(_) => GeometryConfig::idle_keys(&self.config),
            None => Ok(self.config.idle_keys()),
        }
    }

    fn check_files(&self, training: &TrainingSet<'_>) -> Result<()> {
        if let Some(of) = &self.config.geometry {
            return self.geometry(of, training).map(|_| ());
        }
        self.config.check_keyframes(&self.id, "", training)?;
        if let Some(file) = &self.config.initial_gaussians {
            Initial::read(file)?.check(training)?;
        }
        Ok(())
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
        if let Some(of) = &self.config.geometry {
            let geometry = self.geometry(of, training)?;
            return geometry.learn_radio(&self.config, of, &self.backend, training, seed, advance);
        }
        let mut config = self.config.reconstruction.clone();
        let has = training.modalities();
        if !has.radio {
            config.radio_weight = 0.0;
            note!("{}: the data set has no spectra, so light alone is reconstructed", self.id);
        }
        if !has.light {
            note!(
                "{}: the data set has no images, so radio alone is reconstructed; the Jet picture of the spectrum guides growth",
                self.id
            );
        }
        let device = self.config.device(&self.backend)?;
        let range = training.db_range().unwrap_or(FieldMeta::RANGE_WITHOUT_RADIO);
        let (light, radio) = (training.light_camera(), training.radio_camera());
        let mut reconstructor = Reconstructor::new(device, config.clone(), light, radio, range, seed)?;
        let resumed = self.checkpoints.as_ref().is_some_and(|c| c.to_resume().is_some());
        if let Some(file) = self.config.initial_gaussians.as_ref().filter(|_| !resumed) {
            let initial = Initial::read(file)?;
            initial.report(&self.id, (config.light_sh_degree, Some("optical_sh_degree")), self.config.raster.antialias);
            reconstructor.begin_with(&initial.coupled(config.empty_field(), config.radio_target, training)?)?;
        }
        let stages = if config.coupling == Coupling::Joint { 1 } else { 2 };
        let total = training.len() * stages + self.config.fine_tune_units();
        let mut online =
            Online { reconstructor, training, checkpointer: Checkpointer::new(self.checkpoints.clone()), total, reported: 0 };
        online.run(advance)?;
        let Online { reconstructor, checkpointer, reported, .. } = online;
        self.conclude(reconstructor, training.len(), reported, &|error| checkpointer.explain(error), advance)
    }
}

impl CorfGs {
    /// Ends a sequence of `keyframes` training keyframes, of `told` of which the harness knows the timing: second stage, fine-tuning, field.
    /// `explain` adds to an error what survives it.
    fn conclude(
        &self,
        mut reconstructor: Reconstructor,
        keyframes: usize,
        reported: usize,
        explain: &dyn Fn(anyhow::Error) -> anyhow::Error,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>> {
        let stages = if self.config.reconstruction.coupling == Coupling::Joint { 1 } else { 2 };
        let total = keyframes * stages + self.config.fine_tune_units();
        // The second stage counts as many units as the first had keyframes.
        let mut relay = Relay { advance, failure: None };
        let second = (stages - 1) * keyframes;
        let ended = reconstructor.finish(&mut |done, of| relay.report(keyframes + second * done / of.max(1), total));
        relay.settle(ended).map_err(explain)?;
        let before = keyframes * stages;
        let mut stages = vec![];
        if let Some(seconds) = self.config.fine_tune_s {
            let begin = Instant::now();
            let most = self.config.fine_tune_units();
            let ended = reconstructor.fine_tune_for(Duration::from_secs_f64(seconds), &mut |spent| {
                relay.report(before + most.min(spent.as_secs() as usize), total)
            });
            let epochs = relay.settle(ended).map_err(explain)?;
            stages.push(StageTime {
                name: format!("fine-tuning, {}", counted(epochs, "epoch")),
                seconds: begin.elapsed().as_secs_f64(),
            });
        } else {
            let ended = reconstructor.fine_tune(self.config.fine_tune_epochs, &mut |done, _| relay.report(before + done, total));
            relay.settle(ended).map_err(explain)?;
        }
        anyhow::ensure!(
            reconstructor.gaussian_count() > 0,
            "{}: {keyframes} training keyframes gave no Gaussians, so there is no field\n  help: `corf dataset validate` says whether images are \
             black or depth is empty; with `depth.prior = \"none\"` neighbouring keyframes must see the same things",
            self.id
        );
        // Keyframes whose last steps waited for another, or that were still collected, have ended now.
        let depth = reconstructor.depth_quality();
        let training_times = reconstructor.take_training_times()?;
        let mut ended = reconstructor.timings()[reported..].iter();
        let keyframe = ended.next_back();
        for timing in ended {
            (relay.advance)(Advance { keyframe: Some(timing), ..Advance::of(total, total) })?;
        }
        (relay.advance)(Advance {
            gaussians: Some(reconstructor.gaussian_count()),
            keyframe,
            depth,
            stages: &stages,
            training_times: training_times.as_ref(),
            ..Advance::of(total, total)
        })?;
        let field = FieldPredictor::learnt(reconstructor.field()?, self.config.raster, &self.backend)?;
        Ok(Box::new(field.clearing(reconstructor)))
    }
}

/// Passes progress on to the harness, and what the harness answers back through the reconstruction.
struct Relay<'a> {
    advance: &'a mut dyn FnMut(Advance<'_>) -> Result<()>,
    failure: Option<anyhow::Error>,
}

impl Relay<'_> {
    fn report(&mut self, done: usize, total: usize) -> ControlFlow<()> {
        match (self.advance)(Advance::of(done, total)) {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                self.failure = Some(error);
                ControlFlow::Break(())
            }
        }
    }

    /// Result of the reconstruction; where the harness's callback failed, the callback's error instead of the one about the stop it caused.
    fn settle<T>(&mut self, ended: corf::Result<T>) -> Result<T> {
        match self.failure.take() {
            Some(error) => Err(error),
            None => Ok(ended?),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::registry::settings;
    use corf::optimizer::AppearanceRates;
    use std::path::Path;

    #[test]
    fn the_fast_preset_yields_to_overrides_and_leaves_the_rest_alone() {
        let new =
            |id: &str, text: &str| CorfGs::new(id, &settings(id, &text.parse().unwrap()).unwrap(), &Backend::Cpu).unwrap().config;
        let make = |id: &str, text: &str| new(id, text).reconstruction;
        let (plain, fast) = (make("corf-gs", ""), make("corf-gs-fast", "rf_weight = 0.2\ndepth = { corners = 500 }"));
        assert!(fast.iterations_per_keyframe < plain.iterations_per_keyframe);
        assert_eq!((fast.radio_weight, fast.depth.corners, fast.depth.neighbours), (0.2, 500, plain.depth.neighbours));
        let paper = make("corf-gs-paper", "");
        assert_eq!((paper.iterations_per_keyframe, paper.pyramid_levels, paper.radio_weight), (75, 3, 0.1));
        assert_eq!((paper.latest_probability, paper.depth_weight, paper.depth_weight_decay), (0.2, 0.01, 0.9));
        assert!(!paper.depth.correction && paper.finest_share == Some(1.0));
        assert_eq!(make("corf-gs-fast", "iterations_per_keyframe = 70").iterations_per_keyframe, 70);
        // The quickest to have a keyframe in the field leaves nothing for later; the best takes its time behind the last one.
        let live = make("corf-gs-live", "");
        assert_eq!((live.iterations_per_keyframe, live.overlapped_iterations), (30, 0));
        assert!(live.iterations_per_keyframe < fast.iterations_per_keyframe);
        let best = new("corf-gs-quality", "");
        assert_eq!((&best.reconstruction, best.fine_tune_epochs), (&plain, 300));
        // Part of an inner table leaves the rest of it alone, also where its defaults are not those of its type.
        let rates = |id: &str, text: &str| new(id, text).optimizer.radio;
        let usual = OptimizerConfig::default().radio;
        assert!(usual != AppearanceRates::default());
        assert_eq!(rates("corf-gs", "optimizer.rf.sh_dc = 0.01"), AppearanceRates { sh_dc: 0.01, ..usual });
        assert!(CorfGs::new("corf-gs", &"optimizer.rf.sh_cd = 0.01".parse().unwrap(), &Backend::Cpu).is_err());
        assert_eq!(fast.sampling, plain.sampling);
    }

    #[test]
    fn the_committed_configurations_and_plans_are_of_this_version() {
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
        for plan in [
            "ablation.toml",
            "array.toml",
            "blocks-lobby147.toml",
            "blocks-office480.toml",
            "density-lobby147.toml",
            "density-lobby147-bartlett.toml",
            "density-office480.toml",
            "demo.toml",
            "measured-rfid.toml",
            "measured-rfid-blocks.toml",
            "paper.toml",
        ] {
            crate::experiment::plan::Plan::load(&scenes.join(plan)).unwrap();
        }
    }
}
