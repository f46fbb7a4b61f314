//! Online training of a radio field: emitters are born where keyframes ask for them, and take residuals off in proportion.

use super::anchors::Anchors;
use super::births::{Sighting, meeting};
use super::cloud::Cloud;
use super::config::ArrayConfig;
use super::field::ArrayField;
use super::peaks::{SpectrumRay, rays};
use super::peel::{Peeled, peel};
use super::refine::{prune, refine};
use super::sensor::{ArraySensor, SensorSettings};
use super::stepper::{CpuStepper, Rule, Stepper, View};
use crate::{Error, Result, stage};
use corf_scene::config::AntennaPattern;
use corf_scene::{Pinhole, Raster, Rigid3, Rng, keyframe::DbRange};
use glam::DVec3;
use std::collections::HashSet;

/// What a keyframe brings.
#[derive(Clone, Debug)]
pub struct Observed {
    /// `world_from_camera`.
    pub pose: Rigid3,
    /// The spectrum, linear.
    pub spectrum: Raster<f32>,
    /// Its parts, where surfaces are splatted.
    pub peeled: Option<Peeled>,
    /// True images of the transmitter that are seen from here, where an oracle knows them: they are the sources, and none is born from rays.
    pub images: Option<Vec<Image>>,
}

/// A virtual source that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Image {
    /// World frame, metres.
    pub place_m: DVec3,
    /// Linear power times squared distance, m².
    pub gain: f64,
}

/// Images closer to one another than this are one, metres.
const SAME_IMAGE_M: f64 = 0.05;

/// Trains one field.
pub struct ArrayTrainer {
    config: ArrayConfig,
    sensor: ArraySensor<f32>,
    /// The field.
    pub field: ArrayField,
    floor: f32,
    seed: u64,
    /// Takes the steps.
    pub(super) stepper: Box<dyn Stepper>,
    views: Vec<View>,
    sources_move: bool,
    sightings: Vec<Sighting>,
    cells: HashSet<[i32; 3]>,
    steps: u64,
}

impl ArrayTrainer {
    /// An empty field.
    pub fn new(config: ArrayConfig, settings: SensorSettings, camera: Pinhole, range: DbRange, seed: u64) -> Self {
        let lobes = matches!(settings, SensorSettings::Lobes { .. });
        let over_splats = config.is_over_splats(&settings);
        let settings = if config.array_response { settings } else { settings.without_side_lobes() };
        let field = ArrayField {
            sensor: settings,
            pattern: AntennaPattern::Iso,
            camera,
            half_space: config.half_space,
            over_splats,
            most_power: Some(10f64.powf(0.1 * (range.max_db + settings.unseen_db())) / settings.peak()),
            extent_m: config.point_extent * config.point_spacing_m,
            anchors: Anchors { positions_m: vec![], width_m: config.anchor_width_m },
            sources: Cloud::default(),
            points: Cloud::default(),
        };
        let floor = 10f64.powf(0.1 * range.min_db) as f32;
        let sensor: ArraySensor<f32> = settings.build(&camera);
        Self {
            sources_move: config.refine_sources.unwrap_or(lobes),
            config,
            stepper: Box::new(CpuStepper { rule: rule_of(&config, floor), sensor: sensor.clone() }),
            sensor,
            field,
            floor,
            seed,
            views: vec![],
            sightings: vec![],
            cells: HashSet::new(),
            steps: 0,
        }
    }

    /// Takes a spectrum apart where surfaces are splatted: its remainder is what they are to show.
    pub fn observe(&self, pose: &Rigid3, spectrum: &Raster<f32>) -> Observed {
        let peeled = match self.field.sensor {
            SensorSettings::Lobes { width_deg } if self.field.over_splats && self.config.sources => {
                Some(peel(&self.sensor, &self.field.camera, spectrum, width_deg, self.floor))
            }
            _ => None,
        };
        Observed { pose: *pose, spectrum: spectrum.clone(), peeled, images: None }
    }

    /// Takes a keyframe, and where surfaces are known by now.
    ///
    /// # Errors
    /// A spectrum that is not of the camera's size.
    pub fn receive(&mut self, observed: &Observed, surface: &[[f32; 3]]) -> Result<()> {
        let Observed { pose, spectrum, .. } = observed;
        let (camera, size) = (&self.field.camera, (spectrum.width(), spectrum.height()));
        if size != (camera.width, camera.height) {
            let what = format!("the spectrum is {}x{} and the camera says {}x{}", size.0, size.1, camera.width, camera.height);
            return Err(Error::invalid("the radio field", what, "all keyframes of a sequence share their cameras"));
        }
        self.add_anchor(pose);
        if !self.field.over_splats {
            self.add_points(pose, spectrum, surface);
        }
        self.remember(observed);
        match &observed.images {
            Some(images) => self.add_images(images),
            None if self.config.sources => {
                self.bear_sources();
                if self.sources_move {
                    refine(&mut self.field.sources, &self.sightings, self.config.ray_width_deg.to_radians());
                }
            }
            None => {}
        }
        // A new anchor takes weight from the others.
        for i in 0..self.views.len() {
            self.views[i].receiver = self.field.receiver(&self.views[i].pose);
        }
        if observed.images.is_none() {
            let receivers: Vec<_> = self.views.iter().map(|view| &view.receiver).collect();
            prune(&mut self.field.sources, &receivers, self.floor / self.field.sensor.peak() as f32);
        }
        Ok(())
    }

    /// The same, of an array whose elements have a pattern; before the first keyframe.
    pub fn of_elements(mut self, pattern: AntennaPattern) -> Self {
        self.field.pattern = pattern;
        self
    }

    /// Goes on with a field as it stood after so many keyframes, which have to be [replayed](Self::replay).
    ///
    /// # Errors
    /// A field of another sensor, camera or configuration.
    pub fn restore(&mut self, field: ArrayField, keyframes: usize) -> Result<()> {
        let fixed = |f: &ArrayField| {
            (f.sensor, f.pattern, f.camera, f.half_space, f.over_splats, f.most_power, f.extent_m, f.anchors.width_m)
        };
        if fixed(&field) != fixed(&self.field) {
            let what = "it is of another sensor, camera or configuration";
            return Err(Error::invalid("checkpoint", what, "resume with the command that was interrupted, or start anew"));
        }
        let side = self.config.point_spacing_m as f32;
        self.cells = field.points.position.iter().map(|p| cell(p, side)).collect();
        self.field = field;
        self.steps = (keyframes * self.config.iterations_per_keyframe) as u64;
        Ok(())
    }

    /// Takes a keyframe that the field has learnt from already: as a view to train with and rays to meet, nothing else.
    pub fn replay(&mut self, observed: &Observed) {
        self.remember(observed);
    }

    fn remember(&mut self, Observed { pose, spectrum, peeled, images }: &Observed) {
        if self.config.sources && images.is_none() {
            let found = peeled.as_ref().map_or_else(|| self.strongest(spectrum), |p| p.rays.clone());
            self.sightings.push(Sighting::new(pose, &found, self.field.pattern));
        }
        let log = spectrum.pixels().iter().map(|s| (s + self.floor).ln()).collect();
        let background = peeled.as_ref().map(|p| p.remainder.pixels().to_vec());
        let receiver = self.field.receiver(pose);
        self.views.push(View { pose: *pose, background, log, receiver });
    }

    fn strongest(&self, spectrum: &Raster<f32>) -> Vec<SpectrumRay> {
        let mut found = rays(&self.sensor, &self.field.camera, spectrum.pixels(), self.config.ray_range_db);
        found.truncate(self.config.rays);
        found
    }

    fn add_anchor(&mut self, pose: &Rigid3) {
        if self.config.visibility == 0.0 {
            return;
        }
        let place = pose.translation;
        let near = |a: &DVec3| a.distance(place) < self.config.anchor_spacing_m;
        if !self.field.anchors.positions_m.iter().any(near) {
            let weights = self.field.anchors.weights(place);
            self.field.anchors.positions_m.push(place);
            self.field.sources.add_anchor(&weights);
            self.field.points.add_anchor(&weights);
        }
    }

    fn add_points(&mut self, pose: &Rigid3, spectrum: &Raster<f32>, surface: &[[f32; 3]]) {
        let side = self.config.point_spacing_m as f32;
        if side <= 0.0 {
            return;
        }
        let fresh: Vec<[f32; 3]> = surface.iter().copied().filter(|p| self.cells.insert(cell(p, side))).collect();
        let level = if self.field.points.is_empty() {
            let mean =
                spectrum.pixels().iter().map(|s| f64::from((s + self.floor).ln())).sum::<f64>() / spectrum.pixels().len() as f64;
            let place = pose.translation.as_vec3();
            let spread = fresh.iter().map(|p| f64::from(glam::Vec3::from(*p).distance_squared(place)).ln()).sum::<f64>();
            let count = fresh.len().max(1) as f64;
            (mean + spread / count - (0.03 * count).max(1.0).ln()) as f32
        } else {
            let mut gains = self.field.points.gain.clone();
            gains.sort_by(f32::total_cmp);
            gains[gains.len() / 2]
        };
        fresh.into_iter().for_each(|p| self.field.points.push(p, level));
    }

    /// Images that are not known yet become sources.
    fn add_images(&mut self, images: &[Image]) {
        for image in images {
            let known = |p: &[f32; 3]| glam::Vec3::from(*p).as_dvec3().distance(image.place_m) < SAME_IMAGE_M;
            if !self.field.sources.position.iter().any(known) {
                self.field.sources.push(image.place_m.as_vec3().to_array(), image.gain.ln() as f32);
            }
        }
    }

    /// Sources are born where rays of the latest keyframe meet those of others.
    fn bear_sources(&mut self) {
        let Some((latest, others)) = self.sightings.split_last() else { return };
        let width = self.config.ray_width_deg.to_radians();
        for ray in 0..latest.rays.len() {
            let place = latest.place_m;
            let (direction, power) = latest.rays[ray];
            let known = |i: usize| {
                let v = glam::Vec3::from(self.field.sources.position[i]).as_dvec3() - place;
                let received = f64::from(self.field.sources.gain[i]).exp() / v.length_squared();
                (v.normalize() - direction).length() < 1.5 * width && received > 0.1 * power
            };
            if (0..self.field.sources.len()).any(known) {
                continue;
            }
            let m = meeting(latest, ray, others, width);
            if m.votes >= self.config.votes {
                self.field.sources.push(m.place_m.as_vec3().to_array(), m.gain.ln() as f32);
            }
        }
    }

    /// The field as it stands.
    pub fn into_field(self) -> ArrayField {
        self.field
    }

    /// Takes the steps of a keyframe; returns the mean squared residual of the last, nepers².
    ///
    /// # Errors
    /// The device's.
    pub fn train(&mut self) -> Result<f32> {
        let visit = |step: u64| {
            let mut rng = Rng::keyed(self.seed, stage::VISITS, step);
            let latest = rng.uniform() < self.config.latest_probability;
            &self.views[if latest { self.views.len() - 1 } else { rng.below(self.views.len()) }]
        };
        let end = self.steps + self.config.iterations_per_keyframe as u64;
        let views: Vec<&View> = (self.steps..end).map(visit).collect();
        let last = self.stepper.take(&mut self.field, &views)?;
        self.steps = end;
        Ok(last)
    }

    /// What its steps depend on.
    #[cfg(feature = "gpu")]
    pub(super) fn rule(&self) -> Rule {
        rule_of(&self.config, self.floor)
    }
}

fn rule_of(config: &ArrayConfig, floor: f32) -> Rule {
    let ArrayConfig { rate, damping, clip, visibility, .. } = *config;
    Rule { rate, damping, clip, visibility, floor }
}

/// The cube of the grid that a point is in.
fn cell(p: &[f32; 3], side: f32) -> [i32; 3] {
    p.map(|v| (v / side).floor() as i32)
}
