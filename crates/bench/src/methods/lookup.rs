//! Lookups: what a table must be beaten by to mean anything.

use crate::files::json::write_json;
use crate::methods::family::{Abilities, Family, Open, Variant};
use crate::methods::interface::{Advance, Method, Predictor, TrainingSet};
use crate::metrics::{Prediction, RadioPrediction};
use anyhow::{Result, ensure};
use corf_scene::keyframe::Modalities;
use corf_scene::{Keyframe, Raster, Rigid3};
use schemars::{JsonSchema, schema_for};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Weight of rotation in the distance between poses: metres that one radian counts as.
const METRES_PER_RADIAN: f64 = 1.0;
/// Keyframes blended by `inverse-distance`.
const BLENDED: usize = 4;
/// Added to a distance before it is inverted, metres.
const SOFTENING_M: f64 = 1e-3;

/// Whatever was observed is looked up.
const NEITHER: Modalities = Modalities { light: false, radio: false };

/// Configuration of a lookup.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LookupConfig {
    /// Number of keyframes that are blended (1: the nearest alone).
    pub keyframes: usize,
    /// Metres that one radian of rotation counts.
    pub metres_per_radian: f64,
    /// Power of the inverse distance by which keyframes are weighed (1).
    #[serde(skip_serializing_if = "is_one")]
    pub power: i32,
}

/// Records of versions that weighed by the inverse distance alone say no power.
fn is_one(power: &i32) -> bool {
    *power == 1
}

impl Default for LookupConfig {
    fn default() -> Self {
        Self { keyframes: BLENDED, metres_per_radian: METRES_PER_RADIAN, power: 1 }
    }
}

/// The nearest keyframe.
pub const NEAREST: Family = Family {
    variants: &[Variant { id: "nearest", help: "the nearest training keyframe, as it was observed", preset: "keyframes = 1" }],
    // One keyframe is the nearest.
    decided: &["keyframes"],
    ..INVERSE_DISTANCE
};

/// Keyframes around.
pub const INVERSE_DISTANCE: Family = Family {
    variants: &[Variant { id: "inverse-distance", help: "training keyframes blended by inverse distance", preset: "" }],
    decided: &[],
    create: |id, settings, _| Ok(Box::new(Lookup::new(id, settings)?)),
    open: Open::Again,
    schema: || schema_for!(LookupConfig),
    inlined: &[],
    raster: None,
    can: Abilities {
        online: false,
        follows: false,
        begins_with_gaussians: false,
        emitters: false,
        on_processor: true,
        looks_up: true,
        fixed_array: true,
    },
};

/// A method of [`NEAREST`] or [`INVERSE_DISTANCE`].
pub struct Lookup {
    id: String,
    config: LookupConfig,
}

impl Lookup {
    /// The lookup of that name.
    ///
    /// # Errors
    /// A key that is none of [`LookupConfig`].
    pub fn new(id: &str, settings: toml::Table) -> Result<Self> {
        let config: LookupConfig = settings.try_into()?;
        ensure!(
            (0..=16).contains(&config.power),
            "power = {}\n  help: give 0 to 16; 1 is the inverse distance itself",
            config.power
        );
        ensure!(
            config.keyframes > 1 || config.power == 1,
            "power = {} has no effect: a keyframe alone is not weighed\n  help: leave it out, or blend more keyframes",
            config.power
        );
        Ok(Self { id: id.to_owned(), config })
    }
}

impl Method for Lookup {
    fn id(&self) -> &str {
        &self.id
    }

    fn config(&self) -> serde_json::Value {
        serde_json::json!(self.config)
    }

    fn needs(&self) -> Modalities {
        NEITHER
    }

    fn reconstruct(
        &self,
        training: &TrainingSet<'_>,
        _seed: u64,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>> {
        let range = training.db_range();
        let mut observed = Vec::with_capacity(training.len());
        for k in 0..training.len() {
            let Keyframe { world_from_camera, light, radio, .. } = training.keyframe(k)?;
            let image = light.map(|light| light.image.map(|p| p.map(|v| f32::from(v) / 255.0)));
            let scalar = radio.zip(range).map(|(radio, range)| radio.spectrum.map(|&s| range.scalar(s)));
            observed.push(Observed { world_from_camera, image, scalar });
            advance(Advance::of(k + 1, training.len()))?;
        }
        Ok(Box::new(Table { config: self.config, observed }))
    }
}

/// Distance of two poses, metres, where a radian of rotation counts as many as given.
pub fn distance_m(a: &Rigid3, b: &Rigid3, metres_per_radian: f64) -> f64 {
    let d = a.inverse().compose(b);
    let angle_rad = (0.5 * (d.rotation.x_axis.x + d.rotation.y_axis.y + d.rotation.z_axis.z - 1.0)).clamp(-1.0, 1.0).acos();
    d.translation.length() + metres_per_radian * angle_rad
}

struct Observed {
    world_from_camera: Rigid3,
    /// None of a data set without light, nor a spectrum of one without radio.
    image: Option<Raster<[f32; 3]>>,
    scalar: Option<Raster<f32>>,
}

struct Table {
    config: LookupConfig,
    observed: Vec<Observed>,
}

impl Table {
    /// The blended keyframes with their weights, which sum to 1.
    fn neighbours(&self, world_from_camera: &Rigid3) -> Vec<(f32, &Observed)> {
        let distance = |o: &Observed| distance_m(&o.world_from_camera, world_from_camera, self.config.metres_per_radian);
        let mut near: Vec<(f64, &Observed)> = self.observed.iter().map(|o| (distance(o), o)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(self.config.keyframes.max(1));
        let weight = |d: f64| (1.0 / (d + SOFTENING_M)).powi(self.config.power);
        let total: f64 = near.iter().map(|(d, _)| weight(*d)).sum();
        near.into_iter().map(|(d, o)| ((weight(d) / total) as f32, o)).collect()
    }
}

/// A raster of the size of those that are blended; none where there are none.
fn blended<T>(rasters: &[(f32, &Raster<T>)], at: impl FnMut(usize, usize) -> T) -> Option<Raster<T>> {
    rasters.first().map(|(_, first)| Raster::from_fn(first.width(), first.height(), at))
}

impl Predictor for Table {
    fn render(&mut self, world_from_camera: &Rigid3) -> Result<Prediction> {
        let near = self.neighbours(world_from_camera);
        ensure!(!near.is_empty(), "a lookup needs at least one training keyframe");
        let images: Vec<_> = near.iter().filter_map(|(w, o)| Some((*w, o.image.as_ref()?))).collect();
        let image = blended(&images, |x, y| {
            images.iter().fold([0.0; 3], |sum: [f32; 3], (w, o)| std::array::from_fn(|c| sum[c] + w * o[(x, y)][c]))
        });
        let spectra: Vec<_> = near.iter().filter_map(|(w, o)| Some((*w, o.scalar.as_ref()?))).collect();
        let scalar = blended(&spectra, |x, y| spectra.iter().map(|(w, o)| w * o[(x, y)]).sum());
        Ok(Prediction { image, radio: scalar.map(RadioPrediction::from_scalar), depth_m: None })
    }

    fn save(&self, run: &Path) -> Result<()> {
        // The table is the dataset itself; run.json names it.
        write_json(&run.join("lookup.json"), &self.config)
    }
}
