//! `geometry`: light and geometry of a finished run are kept, and radio alone is learnt, for another transmitter or carrier in the same room.

use super::CorfGsConfig;
use crate::device::Backend;
use crate::methods::field::FieldPredictor;
use crate::methods::interface::{Advance, FieldReader, Predictor, StageTime, TrainingSet, shown};
use crate::split::{Protocol, Split};
use anyhow::{Context, Result, ensure};
use corf::expansion::initial::{RadioView, color_by_views};
use corf::gaussians::logit;
use corf::{Appearance, AppearanceRates, Field, FieldMeta, Gaussians, RadioOnGeometry, RasterConfig};
use corf_scene::dataset::{Dataset, LightFrom};
use corf_scene::io::{self, sha256_hex};
use corf_scene::words::counted;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// File of a run folder with its Gaussians.
const GAUSSIANS: &str = "coupled.ply";

/// The table `geometry` of the overrides. What is known of the run is filled in by `--geometry`, and is no key that anybody sets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GeometryConfig {
    /// Folder of the finished run whose light and geometry are kept.
    #[schemars(skip)]
    pub run: PathBuf,
    /// SHA-256 of its Gaussians.
    #[schemars(skip)]
    pub gaussians_sha256: String,
    /// Its method.
    #[schemars(skip)]
    pub method: String,
    /// Folder of the data set that it was made from.
    #[schemars(skip)]
    pub dataset: PathBuf,
    /// Hash of that data set.
    #[schemars(skip)]
    pub dataset_hash: String,
    /// Evaluation protocol of its training: which keyframes it has learnt from.
    #[schemars(skip)]
    pub protocol: Protocol,
    /// The rasteriser's settings that its Gaussians were trained with.
    #[schemars(skip)]
    pub raster: RasterConfig,
    /// Whether it read the data set's depth.
    #[schemars(skip)]
    pub uses_ground_truth_depth: bool,
    /// Its time of reconstruction, seconds, which is none of this run's.
    #[schemars(skip)]
    pub seconds: f64,
    /// Times that every spectrum is trained on, at full resolution. Default 60.
    #[serde(default = "GeometryConfig::usual_epochs")]
    pub epochs: usize,
    /// Radio opacity to begin with. Default `optical`.
    #[serde(default)]
    pub opacity: StartOpacity,
    /// Share of the rates under `optimizer.rf` that is left in the last epoch; they fall by the same factor from one to the next. Default 0.1.
    #[serde(default = "GeometryConfig::usual_rate_at_end")]
    pub rate_at_end: f32,
}

/// Radio opacity to begin with, where radio is learnt on the geometry of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StartOpacity {
    /// What the run has learnt for light.
    #[default]
    #[serde(rename = "optical")]
    Light,
    /// What the run has learnt for its transmitter.
    Run,
    /// The same little opacity everywhere.
    Fresh,
}

impl StartOpacity {
    /// Opacity of [`Self::Fresh`].
    const FRESH: f32 = 0.1;

    /// The opacities, before the logistic function, of a finished field's Gaussians.
    fn logits(self, finished: &Gaussians) -> Vec<f32> {
        match self {
            Self::Run => finished.radio.opacity_logit.clone(),
            Self::Light => finished.light.opacity_logit.clone(),
            Self::Fresh => vec![logit(Self::FRESH); finished.len()],
        }
    }
}

/// Most epochs.
const MOST_EPOCHS: usize = 100_000;
const WITHOUT_EFFECT: &str = "light and geometry are another run's, and radio alone is learnt";

impl GeometryConfig {
    /// The table of the overrides.
    ///
    /// # Errors
    /// Keys without a run, an unknown key, or a value of another type.
    pub(super) fn parse(given: toml::Value) -> Result<Self> {
        ensure!(
            given.get("run").is_some(),
            "{} has no effect without a finished run whose light and geometry are kept\n  help: name the run with --geometry, or leave the key out",
            Self::keys_of(&given)
        );
        given.try_into().context("in key geometry")
    }

    /// The keys of such a table, dotted.
    pub fn keys_of(given: &toml::Value) -> String {
        let keys = given.as_table().into_iter().flatten().map(|(key, _)| format!("geometry.{key}"));
        let keys: Vec<String> = keys.collect();
        if keys.is_empty() { "geometry".to_owned() } else { keys.join(", ") }
    }

    /// Epochs where none are given.
    pub fn usual_epochs() -> usize {
        60
    }

    /// Share of the rates in the last epoch where none is given.
    pub fn usual_rate_at_end() -> f32 {
        0.1
    }

    /// The rates of an epoch.
    fn rates(&self, full: AppearanceRates, epoch: usize) -> AppearanceRates {
        let done = epoch as f32 / (self.epochs.max(2) - 1) as f32;
        let left = self.rate_at_end.powf(done);
        AppearanceRates { sh_dc: left * full.sh_dc, opacity: left * full.opacity, ..full }
    }

    /// SHA-256 of the Gaussians of a run.
    ///
    /// # Errors
    /// A run that has none.
    pub fn hash_of(run: &Path) -> Result<String> {
        Ok(sha256_hex(&io::read(run.join(GAUSSIANS))?))
    }

    /// The geometry that a resolved configuration names, if it names one.
    pub fn of_config(config: &serde_json::Value) -> Option<Self> {
        serde_json::from_value(config.get("geometry")?.clone()).ok()
    }

    /// What of it is one run's and not the row's: seeds of a row may each have a geometry of their own.
    pub const OF_A_RUN: [&'static str; 3] = ["run", "gaussians_sha256", "seconds"];

    /// In words, for whoever reads a run.
    pub fn words(&self) -> String {
        format!(
            "light and geometry are those of {} ({}, {:.1} s, Gaussians {:.12}); radio alone was learnt",
            self.run.display(),
            self.method,
            self.seconds,
            self.gaussians_sha256
        )
    }

    /// # Errors
    /// No epochs, or more than anybody waits for; rates that end at nothing or above where they began.
    pub(super) fn validate(&self) -> Result<()> {
        ensure!(
            (1..=MOST_EPOCHS).contains(&self.epochs),
            "key geometry.epochs: the value is out of range\n  help: give 1 to {MOST_EPOCHS}"
        );
        ensure!(
            (1e-6..=1.0).contains(&self.rate_at_end),
            "key geometry.rate_at_end: the value is out of range\n  help: give a share from 1e-6 to 1, where 1 keeps the rates"
        );
        Ok(())
    }

    /// Keys that mean nothing beside it.
    pub(super) fn idle_keys(config: &CorfGsConfig) -> Result<Vec<corf::IdleKey>> {
        let serde_json::Value::Object(all) = serde_json::to_value(&config.reconstruction)? else { return Ok(Vec::new()) };
        let counts = |key: &str| ["rf_target", "rf_sh_degree", "optical_sh_degree"].contains(&key);
        let more = ["keyframe_budget_ms", "initial_gaussians", "fine_tune_epochs", "fine_tune_s"].map(str::to_owned);
        let of_optimizer = ["position_decay", "log_scale_rate", "rotation_rate", "optical"].map(|key| format!("optimizer.{key}"));
        let keys: Vec<String> = all.keys().filter(|key| !counts(key)).cloned().chain(more).chain(of_optimizer).collect();
        Ok(corf::IdleKey::all(keys.iter().map(|key| (key.as_str(), false, WITHOUT_EFFECT))))
    }
}

/// The finished half of a field, read and checked.
pub(super) struct Geometry {
    field: Field,
}

impl Geometry {
    /// Reads the run's field, and makes sure that it is of the data set's world and has learnt from nothing that is held out there.
    ///
    /// # Errors
    /// Gaussians that have changed since; another light, camera or filter than the configuration and the data set have; a data set of another world; a
    /// held-out keyframe that the run was trained with.
    pub fn read(config: &CorfGsConfig, geometry: &GeometryConfig, training: &TrainingSet<'_>) -> Result<Self> {
        let GeometryConfig { run, raster, .. } = geometry;
        let place = format!("--geometry {}", run.display());
        ensure!(
            GeometryConfig::hash_of(run)? == geometry.gaussians_sha256,
            "{place}: its Gaussians are others than when they were named\n  help: name the run again, and another --out"
        );
        let field = Field::read(run)?;
        let (dataset, held_out) = training.to_check_against();
        let here = dataset.dir().display();
        ensure!(
            dataset.modalities().radio,
            "{place}: {here} has no spectra to learn from\n  help: import the capture with them (`corf dataset import`, --rf)"
        );
        ensure!(
            field.meta.modalities.light == dataset.modalities().light,
            "{place}: one of the run and {here} has images, and the other has none\n  help: name a run on a data set of the same room"
        );
        let (theirs, ours) = (field.meta.light_camera, dataset.light_camera());
        ensure!(
            theirs == ours,
            "{place}: its camera is another than that of {here}: {}x{} pixels, fx {}, against {}x{}, fx {}\n  help: its light stays, so images \
             must be of one camera: generate the data set with the same [optical], or with --light-from",
            theirs.width,
            theirs.height,
            theirs.fx,
            ours.width,
            ours.height,
            ours.fx
        );
        let (degree, own) = (field.gaussians.light.sh_degree, config.reconstruction.light_sh_degree);
        ensure!(
            degree == own,
            "{place}: its harmonics of light are of degree {degree}, and optical_sh_degree is {own}\n  help: pass --set optical_sh_degree={degree}"
        );
        let ours = &config.raster;
        ensure!(
            (raster.antialias, raster.near_m) == (ours.antialias, ours.near_m),
            "{place}: it was trained with raster.antialias {:?} and raster.near_m {}, and here they are {:?} and {}\n  help: pass both with --set as the \
             run has them",
            raster.antialias,
            raster.near_m,
            ours.antialias,
            ours.near_m
        );
        check_world(&place, geometry, dataset, held_out)?;
        Ok(Self { field })
    }

    /// Learns radio on it.
    ///
    /// # Errors
    /// Unreadable spectra, the device's errors, or whatever `advance` answers.
    pub fn learn_radio(
        &self,
        config: &CorfGsConfig,
        geometry: &GeometryConfig,
        backend: &Backend,
        training: &TrainingSet<'_>,
        seed: u64,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>> {
        let (begin, epochs) = (Instant::now(), geometry.epochs);
        let Field { gaussians, meta } = &self.field;
        let target = config.reconstruction.radio_target;
        let meta = FieldMeta {
            radio_target: target,
            db_range: training.required_db_range()?,
            radio_camera: training.radio_camera(),
            radio_background: None,
            modalities: training.modalities(),
            ..*meta
        };
        let views = training
            .poses()
            .into_iter()
            .enumerate()
            .map(|(k, world_from_camera)| Ok((world_from_camera, training.spectrum_of(k)?)));
        let views: Vec<_> = views.collect::<Result<_>>()?;
        let shown_views: Vec<RadioView> = views
            .iter()
            .map(|(world_from_camera, spectrum)| RadioView {
                world_from_camera: *world_from_camera,
                radio: target.encode(spectrum, &meta.db_range),
            })
            .collect();
        let opacity_logit = geometry.opacity.logits(gaussians);
        let mut radio = Appearance { opacity_logit, ..config.reconstruction.empty_field().radio };
        color_by_views(&mut radio, &gaussians.position, &shown_views, &meta.radio_camera, target.floor_color());
        drop(shown_views);
        let device = config.device(backend)?;
        let mut learner = RadioOnGeometry::new(device, gaussians.clone(), radio, meta, config.reconstruction.clone(), seed)?;
        for (world_from_camera, spectrum) in &views {
            learner.add(*world_from_camera, spectrum)?;
        }
        let made_ready_s = begin.elapsed().as_secs_f64();
        for epoch in 0..epochs {
            learner.epoch(geometry.rates(config.optimizer.radio, epoch))?;
            let count = Some(learner.gaussian_count());
            let learner = RefCell::new(&mut learner);
            let read = || shown(learner.borrow_mut().field());
            let field = Some(FieldReader::new(&read));
            advance(Advance { gaussians: count, field, ..Advance::of(epoch + 1, epochs) })?;
        }
        let stages = [
            StageTime { name: "making ready".to_owned(), seconds: made_ready_s },
            StageTime {
                name: format!("radio, {}", counted(epochs, "epoch")),
                seconds: begin.elapsed().as_secs_f64() - made_ready_s,
            },
        ];
        advance(Advance { gaussians: Some(learner.gaussian_count()), stages: &stages, ..Advance::of(epochs, epochs) })?;
        let field = FieldPredictor::learnt(learner.field()?, config.raster, backend)?;
        Ok(Box::new(field.clearing(learner)))
    }
}

/// Makes sure that a run and a data set are of one world, and that the run has learnt from nothing that is held out of the data set.
fn check_world(place: &str, info: &GeometryConfig, dataset: &Dataset, held_out: &[usize]) -> Result<()> {
    let here = dataset.dir().display();
    let theirs = if dataset.hash() == info.dataset_hash {
        dataset.clone()
    } else {
        let theirs = Dataset::open(&info.dataset).with_context(|| {
            format!("{place}: the data set of the run, by which frame and poses are compared, cannot be opened\n  help: bring it back to {}", info.dataset.display())
        })?;
        ensure!(
            theirs.hash() == info.dataset_hash,
            "{place}: {} is not the data set any more that the run was made from\n  help: bring that one back",
            info.dataset.display()
        );
        theirs
    };
    let there = theirs.dir().display();
    let [a, b] = [theirs.header(), dataset.header()];
    ensure!(
        a.offset_m() == b.offset_m() && theirs.world_from_capture() == dataset.world_from_capture(),
        "{place}: {there} and {here} are not in one frame: the changes that were made to that of the capture or of the mesh (offset, up, scale) \
         differ\n  help: make the new data set with the same ones"
    );
    let mesh = |h: &corf_scene::dataset::DatasetHeader| h.scene_content_sha256.clone().or(h.scene_sha256.clone());
    let same_poses = theirs.len() == dataset.len()
        && theirs.poses().iter().zip(dataset.poses()).all(|(a, b)| a.world_from_camera == b.world_from_camera);
    let same_light = LightFrom::of(&theirs) == LightFrom::of(dataset);
    match (mesh(a), mesh(b)) {
        _ if same_light => {}
        (Some(there_mesh), Some(here_mesh)) => ensure!(
            there_mesh == here_mesh,
            "{place}: {there} and {here} are of different scenes (mesh {there_mesh:.12} and {here_mesh:.12})\n  help: name a run of the same room"
        ),
        _ => ensure!(
            same_poses,
            "{place}: nothing says that {there} and {here} are of one room: they have no scene in common, and their poses differ\n  help: name a \
             run on a data set of the same poses"
        ),
    }
    let learnt = Split::of(&theirs, info.protocol)?.train;
    let seen = |index: &&usize| {
        let pose = &dataset.poses()[**index].world_from_camera;
        learnt.iter().any(|k| theirs.poses()[*k].world_from_camera == *pose)
    };
    if let Some(index) = held_out.iter().find(seen) {
        anyhow::bail!(
            "{place}: keyframe {index} is held out, and the run has learnt light and geometry from it (its protocol is {})\n  help: reconstruct with \
             --protocol {}, or name a run that holds out the same keyframes",
            info.protocol.name(),
            info.protocol.name()
        );
    }
    Ok(())
}
