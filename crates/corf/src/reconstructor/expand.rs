//! One keyframe's expansion: sample, find depths, spawn, make room.

use super::{Pending, Reconstructor};
use crate::{
    Coupling, Result, Sampling,
    depth::{self, AlignedPrior, GreyView, PixelDepth, Reliability, SparseDepth},
    device::{InverseDepth, Layer, RenderRequest, Rendering, TrainingView, View},
    expansion::{log, prune, spawn},
    field::normalised_inverse_depth,
    stage,
};
use corf_scene::Raster;
use std::collections::BTreeMap;

/// Rendered depths that stand in for triangulated ones are taken every this many pixels.
const RENDERED_ANCHOR_STRIDE: usize = 4;

/// What an expansion did.
#[derive(Default)]
pub(super) struct Expansion {
    pub sampled: usize,
    pub spawned: usize,
    pub accurate: usize,
    pub replaced: usize,
    pub pruned: usize,
    pub triangulated: usize,
    pub prior_aligned: bool,
}

impl Reconstructor {
    /// Expands the field with one keyframe and adds it to the buffer of the schedule.
    pub(super) fn expand(&mut self, keyframe: &Pending) -> Result<Expansion> {
        let view = View { camera: self.meta.optical_camera, world_from_camera: keyframe.world_from_camera };
        let rendering = self.render_before(view)?;
        let rendered = rendering.optical.as_ref();

        // Where: Eqs. (13)–(15), or everywhere alike.
        let (scale_probability, acceptance) = self.sampling_maps(keyframe, rendered);
        let pixels = log::draw(&acceptance, self.seed, stage::keyed(stage::SAMPLING, keyframe.index));

        // How far.
        let depths = self.depths(keyframe, &pixels, &acceptance, rendered);
        let mut expansion = Expansion {
            sampled: pixels.len(),
            triangulated: depths.anchors.len(),
            prior_aligned: depths.prior.is_some(),
            ..Expansion::default()
        };
        let mut samples = depths.samples;
        if let Some(layer) = rendered {
            samples.retain(|s| prune::is_not_behind(s, layer, &self.config));
        }

        // Who makes room.
        if let (Some(main), false) = (&rendering.main_contributor, self.device.is_empty()) {
            let field = self.device.gaussians();
            let replaced = prune::replaced(field.len(), main, &samples, &self.config);
            // A stage that light trains alone leaves the RF opacities as they were born: they say nothing there.
            let both = self.config.coupling == Coupling::Joint;
            let pruned = prune::pruned(&field, &self.born, self.keyframes_expanded, both, &view, &self.config);
            let keep: Vec<bool> = replaced.iter().zip(&pruned).map(|(r, p)| !(r | p)).collect();
            expansion.replaced = replaced.iter().filter(|r| **r).count();
            expansion.pruned = keep.iter().filter(|k| !**k).count() - expansion.replaced;
            self.device.retain(&keep);
            let mut kept = keep.iter();
            self.born.retain(|_| kept.next().copied().unwrap_or(false));
        }

        // The new ones.
        let source = spawn::SpawnSource {
            view,
            optical: &keyframe.optical,
            probability: &scale_probability,
            rf_camera: self.meta.rf_camera,
            rf: &keyframe.rf,
            rf_floor: self.meta.rf_target.floor_color(),
        };
        let new = spawn::spawn(&source, &samples, &self.config);
        self.device.append(&new)?;
        self.born.resize(self.device.len(), self.keyframes_expanded);
        expansion.spawned = samples.len();
        expansion.accurate = samples.iter().filter(|s| s.reliability != Reliability::Prior).count();

        let id = self.device.upload(
            &TrainingView {
                world_from_camera: keyframe.world_from_camera,
                optical_camera: self.meta.optical_camera,
                optical: keyframe.optical.clone(),
                rf_camera: self.meta.rf_camera,
                rf: keyframe.rf.clone(),
                inverse_depth: depths.prior.map(|p| InverseDepth { value: p.inverse_depth, confidence: p.confidence }),
            },
            self.config.pyramid_levels,
        )?;
        self.schedule.push(id);
        self.keyframes_expanded += 1;
        Ok(expansion)
    }

    /// The field as it stands, from the new keyframe's pose; nothing while it is empty.
    fn render_before(&mut self, view: View) -> Result<Rendering> {
        if self.device.is_empty() {
            return Ok(Rendering::default());
        }
        self.device.render(&RenderRequest { optical: Some((view, [0.0; 3])), rf: None, main_contributor: true })
    }

    /// The probability that sets the scale, and the one with which a pixel is accepted.
    fn sampling_maps(&self, keyframe: &Pending, rendered: Option<&Layer>) -> (Raster<f32>, Raster<f32>) {
        let (w, h) = (keyframe.optical.width, keyframe.optical.height);
        match self.config.sampling {
            Sampling::Uniform => {
                let constant = Raster::filled(w, h, self.config.uniform_probability);
                (constant.clone(), constant)
            }
            Sampling::Log => {
                let p = log::probability(&keyframe.optical, self.config.log_sigma_px);
                let wanted = match rendered {
                    Some(layer) => log::final_probability(&p, &log::probability(&layer.color, self.config.log_sigma_px)),
                    None => p.clone(),
                };
                // Accept where rand < 2·P̄: the distance 1/(2√P) of Eq. (17) then lets neighbours overlap.
                (p, wanted.map(|v| 2.0 * v))
            }
        }
    }

    /// Depths of the drawn pixels, with what they were found from.
    fn depths(
        &mut self,
        keyframe: &Pending,
        pixels: &[(usize, usize)],
        acceptance: &Raster<f32>,
        rendered: Option<&Layer>,
    ) -> Depths {
        let config = &self.config.depth;
        let Some(reference) = self.views.iter().find(|v| v.index == keyframe.index) else {
            return Depths::default();
        };
        let others = self.views.iter().rev().filter(|v: &&GreyView| v.index != keyframe.index);
        let neighbours = depth::select_neighbours(reference, others, self.typical_depth_m, config.neighbours);
        let anchors = depth::triangulate(reference, &neighbours, config);
        let prior = keyframe.prior.as_ref().and_then(|mono| {
            let stage = stage::keyed(stage::ALIGNMENT, keyframe.index);
            depth::align(mono, &anchors, config, self.seed, stage).or_else(|| {
                // Too little was triangulated: the field itself says how far things are.
                depth::align(mono, &rendered_anchors(rendered?, self.config.behind_coverage), config, self.seed, stage)
            })
        });
        let mut samples = match &prior {
            Some(aligned) => depth::match_guided(reference, &neighbours, aligned, pixels, config),
            None => depth::match_wide(reference, &neighbours, pixels, config),
        };
        let corners: BTreeMap<(usize, usize), f32> = anchors.iter().map(|a| ((a.y, a.x), a.inverse_depth)).collect();
        for s in &mut samples {
            if let Some(&inverse_depth) = corners.get(&(s.y, s.x)) {
                (s.inverse_depth, s.reliability) = (inverse_depth, Reliability::Triangulated);
            }
        }
        if keyframe.prior.is_none() {
            // Without a prior few pixels find a depth; corners that are needed are not left to chance.
            let drawn: std::collections::BTreeSet<(usize, usize)> = samples.iter().map(|s| (s.x, s.y)).collect();
            samples.extend(
                anchors.iter().filter(|a| acceptance[(a.x, a.y)] > 0.0 && !drawn.contains(&(a.x, a.y))).map(|a| PixelDepth {
                    x: a.x,
                    y: a.y,
                    inverse_depth: a.inverse_depth,
                    reliability: Reliability::Triangulated,
                }),
            );
        }
        if !anchors.is_empty() {
            let mut inverse: Vec<f32> = anchors.iter().map(|a| a.inverse_depth).collect();
            inverse.sort_unstable_by(f32::total_cmp);
            self.typical_depth_m = 1.0 / f64::from(inverse[inverse.len() / 2]);
        }
        Depths { anchors, prior, samples }
    }
}

/// Depths of a keyframe's drawn pixels.
#[derive(Default)]
struct Depths {
    anchors: Vec<SparseDepth>,
    prior: Option<AlignedPrior>,
    samples: Vec<PixelDepth>,
}

/// Well covered rendered depths on a grid.
fn rendered_anchors(rendered: &Layer, least_coverage: f32) -> Vec<SparseDepth> {
    let inverse_depth = normalised_inverse_depth(rendered);
    let (w, h) = (inverse_depth.width(), inverse_depth.height());
    let grid = (0..h).step_by(RENDERED_ANCHOR_STRIDE).flat_map(|y| (0..w).step_by(RENDERED_ANCHOR_STRIDE).map(move |x| (x, y)));
    grid.filter(|&at| 1.0 - rendered.transmittance[at] >= least_coverage)
        .map(|(x, y)| SparseDepth { x, y, inverse_depth: inverse_depth[(x, y)] })
        .collect()
}
