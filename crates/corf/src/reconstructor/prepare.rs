//! Preparation of a keyframe: all that its expansion needs and that does not depend on the field. It has three steps: extraction from the
//! keyframe alone, association with those before it (one keyframe after the other), and completion from both. Steps of several keyframes
//! may run at once.

use crate::{
    Result, Sampling,
    config::ReconstructionConfig,
    depth::{
        self, AlignedPrior, Correction, Dense, DepthPrior, Found, GreyView, Matcher, Neighbour, PixelDepth, Reliability,
        SparseDepth,
    },
    device::{InverseDepth, PackedView, Packer, Planes, Shown, TrainingView},
    field::FieldMeta,
    images::laplacian_of_gaussian,
    stage,
};
use corf_scene::{Keyframe, Light, Pinhole, Raster, Rigid3};
use std::borrow::Cow;
use std::collections::VecDeque;
use std::ops::AddAssign;
use std::sync::Arc;
use std::time::Instant;

/// Rendered depths that stand in for triangulated ones are taken every this many pixels.
const RENDERED_ANCHOR_STRIDE: usize = 4;

/// Largest number of a keyframe's candidate pixels that are matched to correct its prior.
const CORRECTED_BY: usize = 2500;

/// Number of the latest keyframes kept for matching; older ones hardly overlap, and a 1600×900 keyframe is 6 MB of grey values.
const MATCHING_WINDOW: usize = 32;

/// Time of matching, seconds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MatchingTime {
    /// From the question to the answer.
    pub waited_s: f64,
    /// By the clock of a device of its own.
    pub device_s: f64,
}

impl AddAssign for MatchingTime {
    fn add_assign(&mut self, more: Self) {
        self.waited_s += more.waited_s;
        self.device_s += more.device_s;
    }
}

impl MatchingTime {
    /// What was found, and what it took.
    fn of<T>(find: impl FnOnce() -> Result<Found<T>>) -> Result<(Vec<T>, Self)> {
        let begin = Instant::now();
        let Found { depths, device_s } = find()?;
        Ok((depths, Self { waited_s: begin.elapsed().as_secs_f64(), device_s }))
    }
}

/// First stage of a keyframe's preparation: all that follows from the keyframe alone.
pub(super) struct Extracted {
    pub view: Arc<GreyView>,
    index: usize,
    world_from_camera: Rigid3,
    light: Planes,
    radio: Planes,
    mask: Option<Raster<bool>>,
    mono: Option<Dense>,
    probability: Raster<f32>,
    candidates: Vec<(usize, usize)>,
    truth_m: Option<Raster<f32>>,
    work_s: f64,
    matching: MatchingTime,
}

/// Second stage of a keyframe's preparation: with its neighbours among the keyframes before it, and triangulated corners.
pub(super) struct Associated {
    extracted: Extracted,
    neighbours: Vec<Arc<GreyView>>,
    anchors: Vec<SparseDepth>,
    typical_depth_m: f64,
}

/// Last stage of a keyframe's preparation: all that is known of it without the field.
pub(super) struct Prepared {
    pub index: usize,
    /// The training target; its inverse depth is the prior aligned to triangulated corners, if that could be done and it was not packed.
    pub training: TrainingView,
    /// `P_t` of Eq. (13), or the constant of uniform sampling; 0 where a pixel does not count.
    pub probability: Raster<f32>,
    /// Pixels that are drawn wherever nothing is rendered yet, a superset of those that will be.
    pub candidates: Vec<(usize, usize)>,
    /// Pixels about which the field is asked, row by row: those, triangulated corners, and, where the prior may be aligned to the field, a grid.
    pub asked: Vec<(usize, usize)>,
    reference: Arc<GreyView>,
    neighbours: Vec<Arc<GreyView>>,
    pub anchors: Vec<SparseDepth>,
    /// Whether the prior is the true depth.
    is_exact: bool,
    /// The prior as it came.
    pub mono: Option<Dense>,
    pub aligned: Option<AlignedPrior>,
    /// Local correction of the aligned prior, if one was tried and enough was matched.
    pub correction: Option<Correction>,
    /// Depths of all candidates and, without a dense prior, of triangulated corners, row by row, if they were worth finding ahead.
    pub matched: Option<Vec<PixelDepth>>,
    /// The training view, ready for upload.
    pub packed: Option<PackedView>,
    /// True z-depth, metres, where the keyframe has it: depths are judged by it and nothing else is.
    pub truth_m: Option<Raster<f32>>,
    /// Typical depth of the scene after this keyframe.
    pub typical_depth_m: f64,
    /// Seconds its preparation took.
    pub work_s: f64,
    /// Time of its matching, before its expansion and in it.
    pub matching: MatchingTime,
}

impl Prepared {
    /// Corrects the aligned prior by what some of the candidates match.
    ///
    /// # Errors
    /// The matcher's.
    pub fn correct(&mut self, matcher: &dyn Matcher, config: &ReconstructionConfig) -> Result<()> {
        let Some(aligned) = self.aligned.as_ref().filter(|_| config.depth.correction && !self.is_exact) else { return Ok(()) };
        let stride = self.candidates.len().div_ceil(CORRECTED_BY).max(1);
        let some: Vec<(usize, usize)> = self.candidates.iter().copied().step_by(stride).collect();
        let (matches, time) = self.match_pixels(matcher, &some, Some(aligned), config)?;
        if let Some(correction) = Correction::fit(aligned, &matches, &config.depth) {
            let corrected = correction.apply(aligned, &config.depth);
            self.training.inverse_depth = Some(inverse_depth(&corrected));
            (self.aligned, self.correction) = (Some(corrected), Some(correction));
        }
        self.matching += time;
        Ok(())
    }

    /// Depths of pixels, in their order; those without one are left out.
    ///
    /// # Errors
    /// The matcher's.
    pub fn match_pixels(
        &self,
        matcher: &dyn Matcher,
        pixels: &[(usize, usize)],
        prior: Option<&AlignedPrior>,
        config: &ReconstructionConfig,
    ) -> Result<(Vec<PixelDepth>, MatchingTime)> {
        if let (Some(exact), true) = (prior, self.is_exact) {
            let depth = |&(x, y): &(usize, usize)| {
                let inverse_depth = exact.inverse_depth.at(x, y);
                PixelDepth { x, y, inverse_depth, reliability: Reliability::Accurate }
            };
            return Ok((pixels.iter().map(depth).collect(), MatchingTime::default()));
        }
        let neighbours: Vec<Neighbour<'_>> = self.neighbours.iter().map(|v| Neighbour::new(&self.reference, v)).collect();
        MatchingTime::of(|| match prior {
            Some(aligned) => {
                let range = if self.correction.is_some() { config.depth.corrected_range } else { config.depth.match_range };
                depth::match_guided(matcher, &self.reference, &neighbours, aligned, pixels, range, &config.depth)
            }
            None => depth::match_wide(matcher, &self.reference, &neighbours, pixels, &config.depth),
        })
    }
}

/// State that one keyframe hands on to the next: the views to match with, and the typical depth.
pub(super) struct Past {
    views: VecDeque<Arc<GreyView>>,
    typical_depth_m: f64,
}

impl Past {
    pub fn new(config: &ReconstructionConfig) -> Self {
        Self { views: VecDeque::new(), typical_depth_m: (config.depth.near_m * config.depth.far_m).sqrt() }
    }

    /// Makes a keyframe known to matching, once, in order.
    pub fn meet(&mut self, view: &Arc<GreyView>) {
        if self.views.back().is_some_and(|v| v.index >= view.index) {
            return;
        }
        if self.views.len() == MATCHING_WINDOW {
            self.views.pop_front();
        }
        self.views.push_back(view.clone());
    }

    /// Goes on as if the keyframes before had been prepared here.
    pub fn set_typical_depth_m(&mut self, typical_depth_m: f64) {
        self.typical_depth_m = typical_depth_m;
    }
}

/// What keyframes are prepared with.
pub(super) struct Means {
    pub packer: Option<Packer>,
    pub matcher: Arc<dyn Matcher>,
    /// Whether candidates are matched that may not be needed, so that nothing waits for those that are.
    pub eager: bool,
}

/// The steps.
pub(super) struct Preparer {
    config: ReconstructionConfig,
    meta: FieldMeta,
    seed: u64,
    prior: DepthPrior,
    packer: Option<Packer>,
    matcher: Arc<dyn Matcher>,
    eager: bool,
}

impl Preparer {
    pub fn new(config: &ReconstructionConfig, meta: &FieldMeta, seed: u64, means: Means) -> Result<Self> {
        let prior = DepthPrior::new(&config.depth, seed)?;
        let Means { packer, matcher, eager } = means;
        Ok(Self { config: config.clone(), meta: *meta, seed, prior, packer, matcher, eager })
    }

    /// What matches keyframes.
    pub fn matcher(&self) -> &dyn Matcher {
        self.matcher.as_ref()
    }

    /// Refuses a keyframe that [`Self::extract`] could not look at.
    pub fn check(&self, keyframe: &Keyframe) -> Result<()> {
        self.prior.check(keyframe.index, &*self.guide(keyframe)?)
    }

    /// Whether the prior reads the ray tracer's depth.
    pub fn consumes_ground_truth_depth(&self) -> bool {
        self.prior.consumes_ground_truth_depth()
    }

    /// What the keyframe's growth is guided by.
    ///
    /// # Errors
    /// Those of [`crate::keyframe::guide`].
    pub fn guide<'k>(&self, keyframe: &'k Keyframe) -> Result<Cow<'k, Light>> {
        crate::keyframe::guide(keyframe, &self.meta)
    }

    /// The keyframe as matching sees it; `light` is its guide, here as below.
    ///
    /// # Errors
    /// The matcher's.
    pub fn view(&self, keyframe: &Keyframe, light: &Light) -> Result<Arc<GreyView>> {
        let mut view = GreyView::of(keyframe.index, keyframe.world_from_camera, light, self.meta.light_camera);
        view.held = self.matcher.hold(&view)?;
        Ok(Arc::new(view))
    }

    /// The keyframe's prior, as it comes, with holes where the keyframe's mask leaves pixels out.
    pub fn mono(&self, keyframe: &Keyframe, light: &Light) -> Result<Option<Dense>> {
        let prior = self.prior.estimate(keyframe.index, light)?;
        Ok(match &light.mask {
            Some(mask) => prior.map(|p| p.masked(mask)),
            None => prior,
        })
    }

    /// The keyframe as a training target.
    pub fn training_view(&self, keyframe: &Keyframe, light: &Light, prior: Option<&AlignedPrior>) -> TrainingView {
        let radio = crate::keyframe::radio(keyframe.radio.as_ref(), &self.meta);
        let (pose, mask) = (keyframe.world_from_camera, light.mask.clone());
        crate::keyframe::training_view(pose, crate::keyframe::light(light), radio, prior.map(inverse_depth), mask, &self.meta)
    }

    /// The training view of a keyframe that could not be packed before the field had aligned its prior, on a device that packs.
    ///
    /// # Errors
    /// A view the device would refuse.
    pub fn pack_late(&self, keyframe: &Prepared) -> Result<Option<PackedView>> {
        let pack = self.packer.as_ref().filter(|_| keyframe.packed.is_none());
        pack.map(|pack| pack(&keyframe.training, self.config.pyramid_levels)).transpose()
    }

    /// First step of the preparation, from the keyframe alone: targets, sampling probability, candidate pixels, monocular prior.
    ///
    /// # Errors
    /// A keyframe from which the prior cannot be estimated.
    pub fn extract(&self, keyframe: &Keyframe) -> Result<Extracted> {
        let begin = Instant::now();
        let guide = &*self.guide(keyframe)?;
        let light = crate::keyframe::light(guide);
        let sampling = self.config.sampling;
        let least = self.config.least_probability;
        let mut probability = match sampling {
            Sampling::Uniform => Raster::filled(light.width, light.height, self.config.uniform_probability),
            Sampling::Log => laplacian_of_gaussian::probability(&light, self.config.log_sigma_px),
        };
        if sampling == Sampling::Log {
            probability.pixels_mut().iter_mut().for_each(|p| *p = p.max(least));
        }
        if let Some(mask) = &guide.mask {
            let pixels = probability.pixels_mut().iter_mut().zip(mask.pixels());
            pixels.filter(|(_, counts)| !**counts).for_each(|(p, _)| *p = 0.0);
        }
        let stage = stage::keyed(stage::SAMPLING, keyframe.index);
        let candidates = laplacian_of_gaussian::draw(&probability, |p| acceptance(&self.config, p, None), self.seed, stage);
        Ok(Extracted {
            view: self.view(keyframe, guide)?,
            index: keyframe.index,
            world_from_camera: keyframe.world_from_camera,
            light,
            radio: crate::keyframe::radio(keyframe.radio.as_ref(), &self.meta),
            mask: guide.mask.clone(),
            mono: self.mono(keyframe, guide)?,
            probability,
            candidates,
            truth_m: guide.depth_m.clone().filter(|_| self.prior.leaves_a_truth()),
            work_s: begin.elapsed().as_secs_f64(),
            matching: MatchingTime::default(),
        })
    }

    /// Second step, one keyframe after the other: selects its neighbours among the views in `past` (which holds its own too) and
    /// triangulates corners with them.
    ///
    /// # Errors
    /// The matcher's.
    pub fn associate(&self, past: &mut Past, mut extracted: Extracted) -> Result<Associated> {
        let begin = Instant::now();
        let reference = &extracted.view;
        let others = past.views.iter().rev().filter(|v| v.index != extracted.index).map(AsRef::as_ref);
        let config = &self.config.depth;
        let neighbours = depth::select_neighbours(reference, others, past.typical_depth_m, config.neighbours);
        let (anchors, time) = MatchingTime::of(|| depth::triangulate(self.matcher(), reference, &neighbours, config))?;
        if !anchors.is_empty() {
            let mut inverse: Vec<f32> = anchors.iter().map(|a| a.inverse_depth).collect();
            inverse.sort_unstable_by(f32::total_cmp);
            past.typical_depth_m = 1.0 / f64::from(inverse[inverse.len() / 2]);
        }
        let chosen: Vec<usize> = neighbours.iter().map(|n| n.view.index).collect();
        let neighbours = chosen.iter().filter_map(|&i| past.views.iter().find(|v| v.index == i)).cloned().collect();
        extracted.work_s += begin.elapsed().as_secs_f64();
        extracted.matching += time;
        Ok(Associated { extracted, neighbours, anchors, typical_depth_m: past.typical_depth_m })
    }

    /// All that can be known of a keyframe without the field.
    ///
    /// # Errors
    /// A view the device would refuse; the matcher's.
    pub fn finalise(&self, associated: Associated) -> Result<Prepared> {
        let begin = Instant::now();
        let Associated { extracted, neighbours, anchors, typical_depth_m } = associated;
        let mono = extracted.mono;
        let aligned = mono.as_ref().and_then(|m| match self.prior.is_exact() {
            true => Some(AlignedPrior::new(m, 1.0, 0.0, &self.config.depth)),
            false => depth::align(m, &anchors, &self.config.depth),
        });
        let grid = (aligned.is_none() && mono.is_some()).then(|| anchor_grid(self.meta.light_camera));
        let mut asked = extracted.candidates.clone();
        asked.extend(anchors.iter().map(|a| (a.x, a.y)).chain(grid.into_iter().flatten()));
        // Nearly in order: what is drawn is.
        asked.sort_by_key(|&(x, y)| (y, x));
        asked.dedup();
        let pose = extracted.world_from_camera;
        let training = crate::keyframe::training_view(pose, extracted.light, extracted.radio, None, extracted.mask, &self.meta);
        let mut prepared = Prepared {
            index: extracted.index,
            training,
            probability: extracted.probability,
            candidates: extracted.candidates,
            asked,
            reference: extracted.view,
            neighbours,
            anchors,
            mono,
            is_exact: self.prior.is_exact(),
            aligned,
            correction: None,
            matched: None,
            packed: None,
            truth_m: extracted.truth_m,
            typical_depth_m,
            work_s: 0.0,
            matching: extracted.matching,
        };
        prepared.correct(self.matcher(), &self.config)?;
        if prepared.training.inverse_depth.is_none() {
            prepared.training.inverse_depth = prepared.aligned.as_ref().map(inverse_depth);
        }
        // A prior that could not be aligned yet may be aligned to the field: then depths have to wait for it.
        if prepared.mono.is_none() || prepared.aligned.is_some() {
            if let Some(pack) = &self.packer {
                prepared.packed = Some(pack(&prepared.training, self.config.pyramid_levels)?);
                prepared.training.inverse_depth = None;
            }
            // Uniform sampling needs them all.
            if self.eager || self.config.sampling == Sampling::Uniform {
                let mut pixels = Cow::Borrowed(&prepared.candidates);
                if prepared.mono.is_none() {
                    pixels.to_mut().extend(prepared.anchors.iter().map(|a| (a.x, a.y)));
                    pixels.to_mut().sort_by_key(|&(x, y)| (y, x));
                    pixels.to_mut().dedup();
                }
                let aligned = prepared.aligned.as_ref();
                let (matched, time) = prepared.match_pixels(self.matcher(), &pixels, aligned, &self.config)?;
                prepared.matched = Some(matched);
                prepared.matching += time;
            }
        }
        prepared.work_s = extracted.work_s + begin.elapsed().as_secs_f64();
        Ok(prepared)
    }
}

/// The probability with which a pixel is drawn, from that of the image (Eq. (13)) and what the field shows there, if it shows anything: its
/// rendering's own probability (Eq. (14)). Where the image's is the least there is, it counts as far as nothing covers the pixel.
pub(super) fn acceptance(config: &ReconstructionConfig, image: f32, shown: Option<&Shown>) -> f32 {
    match config.sampling {
        Sampling::Uniform => image,
        Sampling::Log => {
            let (rendering, transmittance) = shown.map_or((0.0, 1.0), |s| (s.structure, s.transmittance));
            let image = if image > config.least_probability { image } else { image * transmittance };
            // Accept where rand < 2·P̄: the distance 1/(2√P) of Eq. (17) then lets neighbours overlap.
            2.0 * laplacian_of_gaussian::final_probability(image, rendering)
        }
    }
}

/// Pixels whose rendered depths stand in for triangulated ones.
pub(super) fn anchor_grid(camera: Pinhole) -> impl Iterator<Item = (usize, usize)> {
    let rows = (0..camera.height).step_by(RENDERED_ANCHOR_STRIDE);
    rows.flat_map(move |y| (0..camera.width).step_by(RENDERED_ANCHOR_STRIDE).map(move |x| (x, y)))
}

/// An aligned prior as a training target.
pub(super) fn inverse_depth(prior: &AlignedPrior) -> InverseDepth {
    InverseDepth { value: prior.inverse_depth.to_pixels(), confidence: prior.confidence.to_pixels_unless_zero() }
}
