//! Guided multi-view matching: a few candidates around the aligned prior, ZNCC over the neighbours, a gate, a parabola.

use super::{
    AlignedPrior, PixelDepth, Reliability,
    matcher::{Found, Matcher, Start},
    patch::{Patch, Warp},
    view::{GreyView, Neighbour, parabola_offset},
};
use crate::{Result, config::DepthConfig};
use glam::Vec2;
use rayon::prelude::*;

/// Radius of the matching window, 7×7 pixels.
pub(crate) const RADIUS: usize = 3;

/// The shortest epipolar segment worth searching in an image of this width, pixels: in proportion to the width, half a pixel at least (the
/// candidates of anything shorter see the same pixels).
pub(crate) fn least_segment_px(config: &DepthConfig, width: usize) -> f32 {
    (config.min_segment_px * width as f64 / 640.0).max(0.5) as f32
}

/// Depths of sampled pixels around an aligned prior (`range` is the half range of the search, relative to it), in the pixels' order. A pixel
/// whose match passes the gate is `Accurate`; one whose match fails falls back to the `Prior` where that is confident; otherwise it is left out.
///
/// # Errors
/// The matcher's.
pub fn match_guided(
    matcher: &dyn Matcher,
    reference: &GreyView,
    neighbours: &[Neighbour<'_>],
    prior: &AlignedPrior,
    pixels: &[(usize, usize)],
    range: f64,
    config: &DepthConfig,
) -> Result<Found<PixelDepth>> {
    let start = |&(x, y): &(usize, usize)| {
        let slope = slope(prior, reference, x, y);
        Start { x, y, guess: prior.inverse_depth.at(x, y), slope }
    };
    let starts: Vec<Start> = pixels.par_iter().with_min_len(256).map(start).collect();
    let Found { depths, device_s } = matcher.guided(reference, neighbours, &starts, range, config)?;
    let settled = starts.iter().zip(depths).filter_map(|(&Start { x, y, guess, .. }, found)| match found {
        Some(inverse_depth) => Some(PixelDepth { x, y, inverse_depth, reliability: Reliability::Accurate }),
        None => {
            let is_confident = prior.confidence.at_unless_zero(x, y) > 0.0;
            is_confident.then_some(PixelDepth { x, y, inverse_depth: guess, reliability: Reliability::Prior })
        }
    });
    Ok(Found { depths: settled.collect(), device_s })
}

/// Depths of sampled pixels without a prior, in the pixels' order: the coarse sweep of the triangulation finds a unique match over the whole
/// range of depths, and the guided matching confirms and refines it. Everything else is left out.
///
/// # Errors
/// The matcher's.
pub fn match_wide(
    matcher: &dyn Matcher,
    reference: &GreyView,
    neighbours: &[Neighbour<'_>],
    pixels: &[(usize, usize)],
    config: &DepthConfig,
) -> Result<Found<PixelDepth>> {
    // Pixels of one block are swept once, together.
    let (level, stride) = (reference.coarse_level, (reference.fine.width() >> reference.coarse_level) + 1);
    let block = |&(x, y): &(usize, usize)| (y >> level) * stride + (x >> level);
    let mut blocks: Vec<usize> = pixels.iter().map(block).collect();
    blocks.sort_unstable();
    blocks.dedup();
    let places: Vec<(usize, usize)> = blocks.iter().map(|b| (b % stride, b / stride)).collect();
    let swept = matcher.sweep(reference, neighbours, &places, config)?;
    let start = |at: &(usize, usize)| {
        let guess = swept.depths[blocks.binary_search(&block(at)).ok()?]?;
        Some(Start { x: at.0, y: at.1, guess, slope: Vec2::ZERO })
    };
    let starts: Vec<Start> = pixels.iter().filter_map(start).collect();
    let found = matcher.guided(reference, neighbours, &starts, config.match_range, config)?;
    let matched = starts.iter().zip(found.depths).filter_map(|(&Start { x, y, .. }, inverse_depth)| {
        Some(PixelDepth { x, y, inverse_depth: inverse_depth?, reliability: Reliability::Accurate })
    });
    Ok(Found { depths: matched.collect(), device_s: swept.device_s + found.device_s })
}

/// The prior's change of inverse depth per pixel, from differences across the matching window; none where it is not trusted.
fn slope(prior: &AlignedPrior, reference: &GreyView, x: usize, y: usize) -> Vec2 {
    const REACH: usize = 2;
    let (width, height) = (reference.fine.width(), reference.fine.height());
    if x < REACH || y < REACH || x + REACH >= width || y + REACH >= height {
        return Vec2::ZERO;
    }
    let ends = [(x - REACH, y), (x + REACH, y), (x, y - REACH), (x, y + REACH)];
    if ends.iter().any(|&(x, y)| prior.confidence.at_unless_zero(x, y) <= 0.0) {
        return Vec2::ZERO;
    }
    let w = ends.map(|(x, y)| prior.inverse_depth.at(x, y));
    Vec2::new(w[1] - w[0], w[3] - w[2]) / (2 * REACH) as f32
}

/// The parabola is fitted over steps of at most this many pixels.
pub(crate) const FINEST_STEP_PX: f32 = 0.5;

/// The matched inverse depth of one pixel near a guess, or `None` where the gate refuses it.
pub(super) fn match_pixel(
    reference: &GreyView,
    neighbours: &[Neighbour<'_>],
    start: &Start,
    range: f64,
    config: &DepthConfig,
) -> Option<f32> {
    let &Start { x, y, guess, slope } = start;
    let camera = &reference.fine_camera;
    let patch = Patch::new(&reference.fine, x, y, RADIUS)?;
    let (u, v) = (x as f32 + 0.5, y as f32 + 0.5);
    let (low, high) = (guess * (1.0 - range as f32), guess * (1.0 + range as f32));
    let shortest = least_segment_px(config, camera.width);
    // The patch leans as the prior does, in proportion to the inverse depth tried.
    let at = |n: &Neighbour<'_>, w: f32| n.warp_slanted(camera, &n.view.fine_camera, u, v, w, slope * (w / guess));
    let count = config.match_candidates;
    let step = (high - low) / (count - 1) as f32;
    let lands = |n: &Neighbour<'_>, warp: &Warp| patch.lands_inside(&n.view.fine, warp);
    let lands_throughout =
        |n: &Neighbour<'_>| (0..count).all(|k| at(n, low + step * k as f32).is_some_and(|warp| lands(n, &warp)));
    // A neighbour takes part where both ends of the range land inside it, far enough apart, and all between them, which only a mask leaves out: it
    // would lower the scores of the candidates that it cannot tell of.
    let useful: Vec<&Neighbour<'_>> = neighbours
        .iter()
        .filter(|n| {
            let (Some(a), Some(b)) = (at(n, low), at(n, high)) else { return false };
            lands(n, &a)
                && lands(n, &b)
                && (a.center - b.center).length() > shortest
                && (n.view.fine.all_count() || lands_throughout(n))
        })
        .collect();
    if useful.is_empty() {
        return None;
    }
    let score = |w: f32| {
        let sum: f32 = useful.iter().filter_map(|n| patch.zncc(&n.view.fine, &at(n, w)?)).sum();
        sum / useful.len() as f32
    };
    let scores: Vec<f32> = (0..count).map(|k| score(low + step * k as f32)).collect();
    let (best, &best_score) = scores.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    // At an end of the range the true minimum may lie outside.
    if best == 0 || best == count - 1 {
        return None;
    }
    let worst = scores.iter().copied().fold(f32::INFINITY, f32::min);
    let (worst_cost, best_cost) = (1.0 - worst, 1.0 - best_score);
    // The published gate asks only for a cost that varies; a lowest correlation is asked for too, or blank walls pass by chance.
    if best_score < config.min_zncc || f64::from(worst_cost) <= config.cost_ratio * f64::from(best_cost) {
        return None;
    }
    // The published refinement is one parabola through the candidates, ± half a step. Where a step is more than a pixel the peak is narrower
    // than that, so the step is halved towards the best correlation first.
    let (mut center, mut peak, mut step) = (low + step * best as f32, best_score, step);
    let longest = useful.iter().filter_map(|n| Some((at(n, center)?.center - at(n, center + step)?.center).length()));
    let mut step_px = longest.fold(0.0, f32::max);
    while step_px > FINEST_STEP_PX {
        (step, step_px) = (0.5 * step, 0.5 * step_px);
        for candidate in [center - step, center + step] {
            let s = score(candidate);
            if s > peak {
                (center, peak) = (candidate, s);
            }
        }
    }
    Some(center + step * parabola_offset(score(center - step), peak, score(center + step)))
}
