//! Survey of the field before an expansion: rendered values at some pixels, and pruning decisions.

use super::{Outline, Rendering, View};
use crate::{gaussians::sigmoid, images::laplacian_of_gaussian};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Rule for pruning Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PruneRule {
    /// Opacity at and below which a Gaussian is faint, strictly between 0 and 1 to have an effect.
    pub opacity: f32,
    /// Whether both opacities have to be that low, or that of light alone.
    pub both_modalities: bool,
    /// Fraction of the image's longer side beyond which a standard deviation is oversized.
    pub image_fraction: f32,
}

/// A question to the field.
#[derive(Clone, Copy, Debug)]
pub struct SurveyRequest<'a> {
    /// Camera and pose of the survey.
    pub view: View,
    /// σ of the Laplacian of Gaussian whose response to the rendered image is wanted (Eq. (14)), pixels; none is wanted without.
    pub sigma_px: Option<f32>,
    /// The pixels (column, row) that are asked about.
    pub pixels: &'a [(usize, usize)],
    /// Rule for pruning Gaussians.
    pub prune: PruneRule,
}

/// Rendered values at one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// `P̃` of Eq. (14); 0 where it was not wanted.
    pub structure: f32,
    /// Composited inverse depth Σ α T / z, 1/m.
    pub inverse_depth: f32,
    /// Transmittance behind the last Gaussian, T_N.
    pub transmittance: f32,
    /// The Gaussian of the largest weight α·T, `u32::MAX` if there is none.
    pub main_contributor: u32,
}

/// Reasons to prune a Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PruneDecision {
    /// It hardly shows.
    pub faint: bool,
    /// Whether it is too large in the image.
    pub oversized: bool,
}

/// The answer.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    /// One of each pixel, in the order of the question.
    pub shown: Vec<Shown>,
    /// One of each Gaussian.
    pub judged: Vec<PruneDecision>,
}

impl Survey {
    /// The answer by way of a rendering with main contributors and of all outlines.
    pub(crate) fn of(rendering: &Rendering, outlines: &[Outline], request: &SurveyRequest<'_>) -> Self {
        let judged = outlines.par_iter().map(|o| judge(o, &request.view, &request.prune)).collect();
        let (Some(layer), Some(main)) = (&rendering.light, &rendering.main_contributor) else {
            return Self { shown: vec![], judged };
        };
        let structure = request.sigma_px.map(|sigma| laplacian_of_gaussian::probability(&layer.color, sigma));
        let shown = |&at: &(usize, usize)| Shown {
            structure: structure.as_ref().map_or(0.0, |s| s[at]),
            inverse_depth: layer.inverse_depth[at],
            transmittance: layer.transmittance[at],
            main_contributor: main[at],
        };
        Self { shown: request.pixels.iter().map(shown).collect(), judged }
    }
}

/// Pruning decision of a Gaussian: faint by its opacities, or oversized where its mean projects into the image and its largest standard
/// deviation exceeds the rule's fraction of it.
pub(crate) fn judge(gaussian: &Outline, view: &View, rule: &PruneRule) -> PruneDecision {
    let extent_px = view.camera.width.max(view.camera.height) as f64;
    let focal_px = (view.camera.fx * view.camera.fy).sqrt();
    let [light, radio] = gaussian.opacity_logit.map(sigmoid);
    let opacity = if rule.both_modalities { light.max(radio) } else { light };
    let p: DVec3 = view.world_from_camera.inverse().transform_point(Vec3::from(gaussian.position).as_dvec3());
    let in_frame = view
        .camera
        .project(p)
        .is_some_and(|u| u.x >= 0.0 && u.y >= 0.0 && u.x < view.camera.width as f64 && u.y < view.camera.height as f64);
    let sigma_m = f64::from(gaussian.largest_log_scale).exp();
    PruneDecision {
        faint: opacity <= rule.opacity,
        oversized: in_frame && sigma_m * focal_px / p.z.max(1e-3) > f64::from(rule.image_fraction) * extent_px,
    }
}
