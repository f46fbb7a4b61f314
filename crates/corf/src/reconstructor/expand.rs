//! One keyframe's expansion: sample, find depths, spawn, make room.

use super::{
    Past, Reconstructor,
    prepare::{MatchingTime, Prepared, acceptance, anchor_grid, inverse_depth},
};
use crate::{
    Coupling, Gaussians, Result, Sampling,
    depth::{self, PixelDepth, Reliability, SparseDepth},
    device::{PruneDecision, PruneRule, Shown, StepReport, Survey, SurveyRequest, TrainingTimes, View},
    expansion::{prune, spawn},
    field::over_coverage,
    images::laplacian_of_gaussian,
    stage,
};
use corf_scene::Pinhole;
use std::collections::BTreeSet;
use std::time::Instant;

/// Coverage 1 − T from which on a rendered depth is believed.
const LEAST_COVERAGE: f32 = 0.9;

/// Statistics of the expansion of the field by one keyframe.
#[derive(Default)]
pub(super) struct Expansion {
    pub sampled: usize,
    pub spawned: usize,
    pub accurate: usize,
    pub replaced: usize,
    pub pruned: usize,
    pub triangulated: usize,
    pub prior_aligned: bool,
    /// Sampled pixels that found no depth.
    pub dropped: usize,
    /// The steps that were taken before the keyframe joined, if any were.
    pub late: Option<Late>,
    /// Time of the keyframe's matching, before its expansion and in it.
    pub matching: MatchingTime,
}

/// Steps that the keyframe before left to be taken during an expansion.
#[derive(Clone, Copy)]
pub(super) struct Late {
    pub steps: usize,
    pub last: StepReport,
    pub ended: Instant,
}

/// Changes that a keyframe makes to the field's Gaussians.
struct Change {
    /// Per Gaussian of the field, whether it stays; empty where the field is.
    keep: Vec<bool>,
    new: Gaussians,
    /// Pixels and depths of the new Gaussians.
    samples: Vec<PixelDepth>,
}

impl Reconstructor {
    /// Where the time of training and expansion went so far, on a device that was told to time itself.
    ///
    /// # Errors
    /// The device's.
    pub fn take_training_times(&mut self) -> Result<Option<TrainingTimes>> {
        let Some(mut times) = self.device.take_training_times()? else { return Ok(None) };
        let names = ["survey", "decision", "change of the field"];
        times.host = names.into_iter().map(str::to_owned).zip(std::mem::take(&mut self.expanding_s)).collect();
        Ok(Some(times))
    }

    /// Expands the field with one keyframe and adds it to the buffer of the schedule.
    pub(super) fn expand(&mut self, mut keyframe: Prepared) -> Result<Expansion> {
        let view = View { camera: self.meta.light_camera, world_from_camera: keyframe.training.world_from_camera };
        let begin = Instant::now();
        let (seen, judged) = self.survey(view, &mut keyframe)?;
        let surveyed = Instant::now();
        let late = self.online_steps(self.config.overlapped_iterations());
        let trained = if late.is_empty() { None } else { self.device.begin_training(&late)? };
        let (change, mut expansion) = self.decide(view, &mut keyframe, &seen, &judged)?;
        let decided = Instant::now();
        let trained = if trained.is_some() { trained } else { self.device.end_training()? };
        let joining = Instant::now();
        expansion.late = trained.map(|last| Late { steps: late.len(), last, ended: Instant::now() });
        if let Some(truth) = &keyframe.truth_m {
            self.depth_tally.add(expansion.sampled, expansion.dropped, &change.samples, truth);
        }
        self.join(keyframe, &change)?;
        let spent = [surveyed - begin, decided - surveyed, joining.elapsed()];
        self.expanding_s.iter_mut().zip(spent).for_each(|(sum, time)| *sum += time.as_secs_f64());
        Ok(expansion)
    }

    /// Decides which Gaussians to add and which to remove, without the device.
    fn decide(&self, view: View, keyframe: &mut Prepared, seen: &Seen, judged: &[PruneDecision]) -> Result<(Change, Expansion)> {
        // Where: Eqs. (13)–(15), or everywhere alike.
        let (seed, stage) = (self.seed, stage::keyed(stage::SAMPLING, keyframe.index));
        let chance = |keyframe: &Prepared, at: (usize, usize)| acceptance(&self.config, keyframe.probability[at], seen.at(at));
        let width = keyframe.probability.width();
        // On one thread: this takes a few milliseconds, and threads that prepare keyframes would keep others from their share of it.
        let mut shown = seen.in_order();
        let drawn = |at: &(usize, usize)| {
            let chance = acceptance(&self.config, keyframe.probability[*at], shown.at(*at));
            laplacian_of_gaussian::accepted(at.1 * width + at.0, chance, seed, stage)
        };
        let pixels: Vec<(usize, usize)> = keyframe.candidates.iter().copied().filter(drawn).collect();

        // How far.
        let ahead = keyframe.matched.take();
        let mut samples = match &ahead {
            Some(ahead) => among(ahead, &pixels),
            None => self.match_now(keyframe, seen, &pixels)?,
        };
        let dropped = pixels.len() - samples.len();
        let config = &self.config;
        if keyframe.mono.is_none() {
            let corners = missing_corners(&samples, keyframe, |at| chance(keyframe, at) > 0.0);
            let found = match &ahead {
                Some(ahead) => among(ahead, &corners),
                None => {
                    let (found, time) = keyframe.match_pixels(self.ahead.preparer().matcher(), &corners, None, config)?;
                    keyframe.matching += time;
                    found
                }
            };
            samples.extend(found.into_iter().map(|s| PixelDepth { reliability: Reliability::Triangulated, ..s }));
        }

        // Who makes room.
        let mut shown = seen.in_order();
        let shown = samples.iter().filter_map(|s| Some((s, shown.at((s.x, s.y))?)));
        let replaced = prune::replaced(judged.len(), shown, config);
        let pruned = prune::pruned(judged, &self.born, self.keyframes_expanded, config);
        let keep: Vec<bool> = replaced.iter().zip(&pruned).map(|(r, p)| !(r | p)).collect();

        // The new ones.
        let source = spawn::SpawnSource {
            view,
            light: &keyframe.training.light,
            probability: &keyframe.probability,
            radio_camera: self.meta.radio_camera,
            radio: &keyframe.training.radio,
            radio_floor: self.meta.radio_target.floor_color(),
        };
        let new = spawn::spawn(&source, &samples, config);
        let replaced = replaced.iter().filter(|r| **r).count();
        let expansion = Expansion {
            sampled: pixels.len(),
            spawned: samples.len(),
            accurate: samples.iter().filter(|s| s.reliability != Reliability::Prior).count(),
            replaced,
            pruned: keep.iter().filter(|k| !**k).count() - replaced,
            triangulated: keyframe.anchors.len(),
            prior_aligned: keyframe.aligned.is_some(),
            dropped,
            late: None,
            matching: keyframe.matching,
        };
        Ok((Change { keep, new, samples }, expansion))
    }

    /// Depths of pixels that were not found ahead.
    fn match_now(&self, keyframe: &mut Prepared, seen: &Seen, pixels: &[(usize, usize)]) -> Result<Vec<PixelDepth>> {
        if let (None, Some(mono)) = (&keyframe.aligned, &keyframe.mono) {
            // Too little was triangulated: the field itself says how far things are.
            let anchors = rendered_anchors(seen, self.meta.light_camera, LEAST_COVERAGE);
            keyframe.aligned = depth::align(mono, &anchors, &self.config.depth);
            keyframe.training.inverse_depth = keyframe.aligned.as_ref().map(inverse_depth);
            keyframe.correct(self.ahead.preparer().matcher(), &self.config)?;
        }
        let (preparer, config) = (self.ahead.preparer(), &self.config);
        let matched = || keyframe.match_pixels(preparer.matcher(), pixels, keyframe.aligned.as_ref(), config);
        let (matched, packed) = rayon::join(matched, || preparer.pack_late(keyframe));
        keyframe.packed = packed?.or(keyframe.packed.take());
        let (matched, time) = matched?;
        keyframe.matching += time;
        Ok(matched)
    }

    /// Changes the field, and makes the keyframe one that is trained with.
    fn join(&mut self, mut keyframe: Prepared, change: &Change) -> Result<()> {
        if !change.keep.is_empty() {
            self.device.retain(&change.keep)?;
            let mut kept = change.keep.iter();
            self.born.retain(|_| kept.next().copied().unwrap_or(false));
        }
        self.device.append(&change.new)?;
        self.born.resize(self.device.len(), self.keyframes_expanded);
        let id = match keyframe.packed.take() {
            Some(packed) => self.device.upload_packed(packed)?,
            None => self.device.upload(&keyframe.training, self.config.pyramid_levels)?,
        };
        self.schedule.push(id);
        self.keyframes_expanded += 1;
        let alignment = keyframe.aligned.as_ref().map(|a| [a.scale, a.offset]);
        let correction = keyframe.correction.take();
        self.past.push(Past { index: keyframe.index, alignment, correction, typical_depth_m: keyframe.typical_depth_m });
        // Tens of megabytes go back to the system beside the training.
        rayon::spawn(|| drop(keyframe));
        Ok(())
    }

    /// Surveys the field from a new keyframe's pose: the rendered values at the pixels it asks about, and the pruning decision of each
    /// Gaussian. Both are empty while the field is.
    fn survey(&mut self, view: View, keyframe: &mut Prepared) -> Result<(Seen, Vec<PruneDecision>)> {
        if self.device.is_empty() {
            return Ok((Seen::default(), vec![]));
        }
        let prune = PruneRule {
            opacity: self.config.prune_opacity,
            // What light trains alone leaves the RF opacities as they were born: they say nothing there.
            both_modalities: self.config.coupling == Coupling::Joint && self.config.radio_weight > 0.0,
            image_fraction: self.config.prune_image_fraction,
        };
        let sigma_px = (self.config.sampling == Sampling::Log).then_some(self.config.log_sigma_px);
        let Survey { shown, judged } = self.device.survey(&SurveyRequest { view, sigma_px, pixels: &keyframe.asked, prune })?;
        Ok((Seen::new(std::mem::take(&mut keyframe.asked), shown, view.camera.height), judged))
    }
}

/// Rendered values at some pixels, by pixel.
#[derive(Default)]
struct Seen {
    /// Row by row.
    pixels: Vec<(usize, usize)>,
    shown: Vec<Shown>,
    /// Index into `pixels` at which each image row begins, and one past the last.
    rows: Vec<usize>,
}

impl Seen {
    fn new(pixels: Vec<(usize, usize)>, shown: Vec<Shown>, height: usize) -> Self {
        let rows = (0..=height).map(|row| pixels.partition_point(|&(_, y)| y < row)).collect();
        Self { pixels, shown, rows }
    }

    /// [`Self::at`] of many pixels, row by row.
    fn in_order(&self) -> InOrder<'_> {
        InOrder { seen: self, next: 0 }
    }

    /// The rendered values at one pixel (column, row); `None` where it was not asked about.
    fn at(&self, (x, y): (usize, usize)) -> Option<&Shown> {
        let (begin, end) = (*self.rows.get(y)?, *self.rows.get(y + 1)?);
        let place = self.pixels[begin..end].binary_search_by_key(&x, |p| p.0).ok()?;
        self.shown.get(begin + place)
    }
}

/// Looks up one pixel after the other, row by row; an earlier one begins anew.
struct InOrder<'a> {
    seen: &'a Seen,
    /// The first pixel that is not before the last one that was looked up.
    next: usize,
}

impl<'a> InOrder<'a> {
    /// As [`Seen::at`].
    fn at(&mut self, (x, y): (usize, usize)) -> Option<&'a Shown> {
        let Seen { pixels, shown, .. } = self.seen;
        let place = |&(x, y): &(usize, usize)| (y, x);
        if self.next.checked_sub(1).is_some_and(|last| place(&pixels[last]) >= (y, x)) {
            self.next = 0;
        }
        while pixels.get(self.next).is_some_and(|p| place(p) < (y, x)) {
            self.next += 1;
        }
        pixels.get(self.next).filter(|p| **p == (x, y)).and_then(|_| shown.get(self.next))
    }
}

/// Those samples whose pixels are among some, both row by row.
fn among(samples: &[PixelDepth], pixels: &[(usize, usize)]) -> Vec<PixelDepth> {
    let place = |(x, y): (usize, usize)| (y, x);
    let mut wanted = pixels.iter().copied().map(place).peekable();
    let is_wanted = |s: &&PixelDepth| {
        let own = place((s.x, s.y));
        while wanted.next_if(|next| *next < own).is_some() {}
        wanted.peek() == Some(&own)
    };
    samples.iter().filter(is_wanted).copied().collect()
}

/// Triangulated corners that are needed and were not drawn, row by row. They are refined at full resolution: without a prior few pixels find a depth,
/// and none of these is left to chance.
fn missing_corners(samples: &[PixelDepth], keyframe: &Prepared, wanted: impl Fn((usize, usize)) -> bool) -> Vec<(usize, usize)> {
    let drawn: BTreeSet<(usize, usize)> = samples.iter().map(|s| (s.x, s.y)).collect();
    keyframe.anchors.iter().map(|a| (a.x, a.y)).filter(|&at| wanted(at) && !drawn.contains(&at)).collect()
}

/// Well covered rendered depths on the grid.
fn rendered_anchors(seen: &Seen, camera: Pinhole, least_coverage: f32) -> Vec<SparseDepth> {
    let covered = |at: (usize, usize)| seen.at(at).filter(|s| 1.0 - s.transmittance >= least_coverage);
    let anchor = |(x, y), s: &Shown| SparseDepth { x, y, inverse_depth: over_coverage(s.inverse_depth, s.transmittance) };
    anchor_grid(camera).filter_map(|at| covered(at).map(|s| anchor(at, s))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_looked_up_in_order_is_what_is_looked_up_anywhere() {
        let pixels: Vec<(usize, usize)> = (0..200).filter(|i| i % 3 != 1).map(|i| (i % 10, i / 10)).collect();
        let shown = |i: usize| Shown { structure: i as f32, inverse_depth: 0.0, transmittance: 0.0, main_contributor: 0 };
        let seen = Seen::new(pixels.clone(), (0..pixels.len()).map(shown).collect(), 20);
        let mut in_order = seen.in_order();
        // All pixels, then some again from the beginning, one twice.
        let asked = (0..200).chain([7, 7, 30, 31, 199, 0]).map(|i| (i % 10, i / 10));
        for at in asked {
            assert_eq!(in_order.at(at).map(|s| s.structure), seen.at(at).map(|s| s.structure), "{at:?}");
        }
        assert_eq!(Seen::default().in_order().at((3, 4)), None);
    }
}
