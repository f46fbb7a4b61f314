//! One keyframe's expansion: sample, find depths, spawn, make room.

use super::{
    Past, Reconstructor,
    prepare::{Prepared, acceptance, inverse_depth},
};
use crate::{
    Coupling, Result, Sampling,
    depth::{self, PixelDepth, Reliability, SparseDepth},
    device::{Judgement, Layer, PruneRule, RenderRequest, Shown, Survey, SurveyRequest, View},
    expansion::{log, prune, spawn},
    field::normalised_inverse_depth,
    stage,
};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

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
    pub(super) fn expand(&mut self, mut keyframe: Prepared) -> Result<Expansion> {
        let view = View { camera: self.meta.optical_camera, world_from_camera: keyframe.training.world_from_camera };
        let (seen, judged) = self.survey(view, &keyframe)?;

        // Where: Eqs. (13)–(15), or everywhere alike.
        let (seed, stage) = (self.seed, stage::keyed(stage::SAMPLING, keyframe.index));
        let (sampling, probability) = (self.config.sampling, &keyframe.probability);
        let chance = |at: (usize, usize)| acceptance(sampling, probability[at], seen.at(at).map_or(0.0, |s| s.structure));
        let width = probability.width();
        let drawn = |at: (usize, usize)| log::accepted(at.1 * width + at.0, chance(at), seed, stage);
        let pixels: Vec<(usize, usize)> = keyframe.candidates.par_iter().copied().filter(|&at| drawn(at)).collect();

        // How far.
        if let (None, Some(mono), false) = (&keyframe.aligned, &keyframe.mono, self.device.is_empty()) {
            // Too little was triangulated: the field itself says how far things are.
            let request = RenderRequest { optical: Some((view, [0.0; 3])), ..RenderRequest::default() };
            let rendering = self.device.render(&request)?;
            let anchors = rendering.optical.map_or(vec![], |layer| rendered_anchors(&layer, self.config.behind_coverage));
            let stage = stage::keyed(stage::ALIGNMENT, keyframe.index);
            keyframe.aligned = depth::align(mono, &anchors, &self.config.depth, self.seed, stage);
            keyframe.training.inverse_depth = keyframe.aligned.as_ref().map(inverse_depth);
        }
        let mut samples = match keyframe.matched.take() {
            Some(ahead) => ahead.into_par_iter().filter(|s| drawn((s.x, s.y))).collect(),
            None => keyframe.match_pixels(&pixels, keyframe.aligned.as_ref(), &self.config),
        };
        insert_corners(&mut samples, &keyframe, |at| chance(at) > 0.0);
        samples.retain(|s| seen.at((s.x, s.y)).is_none_or(|shown| prune::is_not_behind(s, shown, &self.config)));
        let mut expansion = Expansion {
            sampled: pixels.len(),
            triangulated: keyframe.anchors.len(),
            prior_aligned: keyframe.aligned.is_some(),
            ..Expansion::default()
        };

        // Who makes room.
        if !self.device.is_empty() {
            let shown = samples.iter().filter_map(|s| Some((s, seen.at((s.x, s.y))?)));
            let replaced = prune::replaced(self.device.len(), shown, &self.config);
            let pruned = prune::pruned(&judged, &self.born, self.keyframes_expanded, &self.config);
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
            optical: &keyframe.training.optical,
            probability: &keyframe.probability,
            rf_camera: self.meta.rf_camera,
            rf: &keyframe.training.rf,
            rf_floor: self.meta.rf_target.floor_color(),
        };
        let new = spawn::spawn(&source, &samples, &self.config);
        self.device.append(&new)?;
        self.born.resize(self.device.len(), self.keyframes_expanded);
        expansion.spawned = samples.len();
        expansion.accurate = samples.iter().filter(|s| s.reliability != Reliability::Prior).count();

        let id = match keyframe.packed.take() {
            Some(packed) => self.device.upload_packed(packed)?,
            None => self.device.upload(&keyframe.training, self.config.pyramid_levels)?,
        };
        self.schedule.push(id);
        self.keyframes_expanded += 1;
        let alignment = keyframe.aligned.map(|a| [a.scale, a.offset]);
        self.past.push(Past { index: keyframe.index, alignment, typical_depth_m: keyframe.typical_depth_m });
        Ok(expansion)
    }

    /// What the field shows of a new keyframe's candidates and corners, and what speaks against each Gaussian; nothing while it is empty.
    fn survey(&mut self, view: View, keyframe: &Prepared) -> Result<(Seen, Vec<Judgement>)> {
        if self.device.is_empty() {
            return Ok((Seen::default(), vec![]));
        }
        let mut pixels = keyframe.candidates.clone();
        pixels.extend(keyframe.anchors.iter().map(|a| (a.x, a.y)));
        pixels.sort_unstable_by_key(|&(x, y)| (y, x));
        pixels.dedup();
        let prune = PruneRule {
            opacity: self.config.prune_opacity,
            // A stage that light trains alone leaves the RF opacities as they were born: they say nothing there.
            both_modalities: self.config.coupling == Coupling::Joint,
            image_fraction: self.config.prune_image_fraction,
        };
        let sigma_px = (self.config.sampling == Sampling::Log).then_some(self.config.log_sigma_px);
        let Survey { shown, judged } = self.device.survey(&SurveyRequest { view, sigma_px, pixels: &pixels, prune })?;
        Ok((Seen { pixels, shown }, judged))
    }
}

/// What pixels show.
#[derive(Default)]
struct Seen {
    /// Row by row.
    pixels: Vec<(usize, usize)>,
    shown: Vec<Shown>,
}

impl Seen {
    /// Of one of the pixels.
    fn at(&self, (x, y): (usize, usize)) -> Option<&Shown> {
        let place = self.pixels.binary_search_by_key(&(y, x), |&(x, y)| (y, x)).ok()?;
        self.shown.get(place)
    }
}

/// Puts triangulated corners in the place of matches at the same pixels.
fn insert_corners(samples: &mut Vec<PixelDepth>, keyframe: &Prepared, wanted: impl Fn((usize, usize)) -> bool) {
    let corners: BTreeMap<(usize, usize), f32> = keyframe.anchors.iter().map(|a| ((a.y, a.x), a.inverse_depth)).collect();
    for s in samples.iter_mut() {
        if let Some(&inverse_depth) = corners.get(&(s.y, s.x)) {
            (s.inverse_depth, s.reliability) = (inverse_depth, Reliability::Triangulated);
        }
    }
    if keyframe.mono.is_none() {
        // Without a prior few pixels find a depth; corners that are needed are not left to chance.
        let drawn: BTreeSet<(usize, usize)> = samples.iter().map(|s| (s.x, s.y)).collect();
        let more = keyframe.anchors.iter().filter(|a| wanted((a.x, a.y)) && !drawn.contains(&(a.x, a.y)));
        samples.extend(more.map(|a| PixelDepth {
            x: a.x,
            y: a.y,
            inverse_depth: a.inverse_depth,
            reliability: Reliability::Triangulated,
        }));
    }
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
