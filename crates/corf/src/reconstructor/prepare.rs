//! What a keyframe's expansion needs and the field does not decide: worked out on another thread while the device still trains with the
//! keyframe before.

use crate::{
    Result, Sampling,
    config::ReconstructionConfig,
    depth::{self, AlignedPrior, DepthPrior, GreyView, Neighbour, PixelDepth, SparseDepth},
    device::{InverseDepth, PackedView, Packer, Planes, TrainingView},
    expansion::log,
    field::FieldMeta,
    stage,
};
use corf_scene::{Keyframe, Raster};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

/// How many of the latest keyframes are kept for matching; older ones hardly overlap, and a 1600×900 keyframe is 6 MB of grey values.
const MATCHING_WINDOW: usize = 32;

/// A keyframe that was received.
pub(super) struct Arrival {
    pub keyframe: Keyframe,
    pub received: Instant,
}

/// A keyframe with all that is known of it without the field.
pub(super) struct Prepared {
    pub index: usize,
    pub received: Instant,
    /// The training target; its inverse depth is the prior aligned to triangulated corners, if that could be done.
    pub training: TrainingView,
    /// `P_t` of Eq. (13), or the constant of uniform sampling.
    pub probability: Raster<f32>,
    /// Pixels that are drawn wherever nothing is rendered yet, a superset of those that will be.
    pub candidates: Vec<(usize, usize)>,
    reference: Arc<GreyView>,
    neighbours: Vec<Arc<GreyView>>,
    pub anchors: Vec<SparseDepth>,
    /// The prior as it came.
    pub mono: Option<Raster<f32>>,
    pub aligned: Option<AlignedPrior>,
    /// Depths of all candidates, if they were worth finding ahead.
    pub matched: Option<Vec<PixelDepth>>,
    /// The training view, ready for upload.
    pub packed: Option<PackedView>,
    /// Typical depth of the scene after this keyframe.
    pub typical_depth_m: f64,
}

impl Prepared {
    /// Depths of pixels, in their order; those without one are left out.
    pub fn match_pixels(
        &self,
        pixels: &[(usize, usize)],
        prior: Option<&AlignedPrior>,
        config: &ReconstructionConfig,
    ) -> Vec<PixelDepth> {
        let neighbours: Vec<Neighbour<'_>> = self.neighbours.iter().map(|v| Neighbour::new(&self.reference, v)).collect();
        match prior {
            Some(aligned) => depth::match_guided(&self.reference, &neighbours, aligned, pixels, &config.depth),
            None => depth::match_wide(&self.reference, &neighbours, pixels, &config.depth),
        }
    }
}

/// Prepares keyframes one after the other; what it keeps in between depends on the keyframes alone.
pub(super) struct Preparer {
    config: ReconstructionConfig,
    meta: FieldMeta,
    seed: u64,
    prior: DepthPrior,
    views: VecDeque<Arc<GreyView>>,
    typical_depth_m: f64,
    packer: Option<Packer>,
    /// Whether the processor has time to match candidates that may not be needed.
    eager: bool,
}

impl Preparer {
    pub fn new(config: &ReconstructionConfig, meta: &FieldMeta, seed: u64, packer: Option<Packer>, eager: bool) -> Self {
        Self {
            config: config.clone(),
            meta: *meta,
            seed,
            prior: DepthPrior::new(&config.depth, seed),
            views: VecDeque::new(),
            typical_depth_m: (config.depth.near_m * config.depth.far_m).sqrt(),
            packer,
            eager,
        }
    }

    /// Refuses a keyframe that [`Self::prepare`] could not prepare.
    pub fn check(&self, keyframe: &Keyframe) -> Result<()> {
        self.prior.check(keyframe)
    }

    /// Whether the prior reads the ray tracer's depth.
    pub fn consumes_ground_truth_depth(&self) -> bool {
        self.prior.consumes_ground_truth_depth()
    }

    /// Goes on as if the keyframes before had been prepared here.
    pub fn set_typical_depth_m(&mut self, typical_depth_m: f64) {
        self.typical_depth_m = typical_depth_m;
    }

    /// Makes a keyframe known to matching, once, in order.
    pub fn look(&mut self, keyframe: &Keyframe) {
        if self.views.back().is_some_and(|v| v.index >= keyframe.index) {
            return;
        }
        if self.views.len() == MATCHING_WINDOW {
            self.views.pop_front();
        }
        let view = GreyView::new(keyframe.index, &keyframe.image, self.meta.optical_camera, keyframe.world_from_camera);
        self.views.push_back(Arc::new(view));
    }

    /// The keyframe's prior, as it comes.
    pub fn mono(&mut self, keyframe: &Keyframe) -> Result<Option<Raster<f32>>> {
        self.prior.estimate(keyframe)
    }

    /// The keyframe as a training target.
    pub fn training_view(&self, keyframe: &Keyframe, prior: Option<&AlignedPrior>) -> TrainingView {
        let optical = Planes {
            width: keyframe.image.width(),
            height: keyframe.image.height(),
            channels: 3,
            pixels: keyframe.image.pixels().as_flattened().par_iter().with_min_len(1024).map(|v| f32::from(*v) / 255.0).collect(),
        };
        TrainingView {
            world_from_camera: keyframe.world_from_camera,
            optical_camera: self.meta.optical_camera,
            optical,
            rf_camera: self.meta.rf_camera,
            rf: self.config.rf_target.encode(&keyframe.spectrum, &self.meta.db_range),
            inverse_depth: prior.map(inverse_depth),
        }
    }

    /// All that can be known of a keyframe without the field.
    ///
    /// # Errors
    /// What the prior cannot be estimated from; a view the device would refuse.
    pub fn prepare(&mut self, arrival: Arrival) -> Result<Prepared> {
        let keyframe = &arrival.keyframe;
        self.look(keyframe);
        let mono = self.mono(keyframe)?;
        // The reference is the latest view, or, among the first keyframes, one of those collected.
        let position = self.views.iter().rposition(|v| v.index == keyframe.index).unwrap_or(self.views.len() - 1);
        let reference = self.views[position].clone();
        let others = self.views.iter().rev().filter(|v| v.index != keyframe.index).map(AsRef::as_ref);
        let config = &self.config.depth;
        let neighbours = depth::select_neighbours(&reference, others, self.typical_depth_m, config.neighbours);
        let anchors = depth::triangulate(&reference, &neighbours, config);
        let alignment = stage::keyed(stage::ALIGNMENT, keyframe.index);
        let aligned = mono.as_ref().and_then(|mono| depth::align(mono, &anchors, config, self.seed, alignment));
        if !anchors.is_empty() {
            let mut inverse: Vec<f32> = anchors.iter().map(|a| a.inverse_depth).collect();
            inverse.sort_unstable_by(f32::total_cmp);
            self.typical_depth_m = 1.0 / f64::from(inverse[inverse.len() / 2]);
        }
        let chosen: Vec<usize> = neighbours.iter().map(|n| n.view.index).collect();
        let neighbours = chosen.iter().filter_map(|&i| self.views.iter().find(|v| v.index == i)).cloned().collect();
        let training = self.training_view(keyframe, aligned.as_ref());
        let probability = match self.config.sampling {
            Sampling::Uniform => Raster::filled(training.optical.width, training.optical.height, self.config.uniform_probability),
            Sampling::Log => log::probability(&training.optical, self.config.log_sigma_px),
        };
        let chance = probability.map(|&p| acceptance(self.config.sampling, p, 0.0));
        let candidates = log::draw(&chance, self.seed, stage::keyed(stage::SAMPLING, keyframe.index));
        let mut prepared = Prepared {
            index: keyframe.index,
            received: arrival.received,
            probability,
            candidates,
            reference,
            neighbours,
            anchors,
            matched: None,
            packed: None,
            typical_depth_m: self.typical_depth_m,
            training,
            mono,
            aligned,
        };
        // A prior that could not be aligned yet may be aligned to the field: then depths have to wait for it.
        if prepared.mono.is_none() || prepared.aligned.is_some() {
            if let Some(pack) = &self.packer {
                prepared.packed = Some(pack(&prepared.training, self.config.pyramid_levels)?);
            }
            // Uniform sampling needs them all.
            if self.eager || self.config.sampling == Sampling::Uniform {
                prepared.matched = Some(prepared.match_pixels(&prepared.candidates, prepared.aligned.as_ref(), &self.config));
            }
        }
        Ok(prepared)
    }
}

/// The probability with which a pixel is drawn, from that of the image (Eq. (13)) and of its rendering (Eq. (14)).
pub(super) fn acceptance(sampling: Sampling, image: f32, rendering: f32) -> f32 {
    match sampling {
        Sampling::Uniform => image,
        // Accept where rand < 2·P̄: the distance 1/(2√P) of Eq. (17) then lets neighbours overlap.
        Sampling::Log => 2.0 * log::final_probability(image, rendering),
    }
}

/// An aligned prior as a training target.
pub(super) fn inverse_depth(prior: &AlignedPrior) -> InverseDepth {
    InverseDepth { value: prior.inverse_depth.clone(), confidence: prior.confidence.clone() }
}
