//! Sparse metric depths: corners swept along their epipolar lines through a fixed range of inverse depths.

use super::{
    matcher::{Found, Matcher},
    patch::{GreyImage, Patch},
    view::{GreyView, Neighbour, parabola_offset},
};
use crate::{Result, config::DepthConfig};
use corf_scene::{Pinhole, Raster};
use rayon::prelude::*;

/// A triangulated corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparseDepth {
    /// Column in the optical image.
    pub x: usize,
    /// Row in the optical image.
    pub y: usize,
    /// 1/z, 1/m.
    pub inverse_depth: f32,
}

/// Radius of the 7×7 window of the coarse sweep.
pub(crate) const RADIUS: usize = 3;
/// The best hypothesis must leave every distant one behind: `1 − ZNCC` at most this fraction of theirs.
pub(crate) const UNIQUENESS: f32 = 0.8;
/// Hypotheses within this many steps of the best one belong to the same peak.
pub(crate) const PEAK_STEPS: usize = 3;
/// Tolerance of the left-right consistency check: distance of the match back from its origin, pixels of the sweep's image.
pub(crate) const LEFT_RIGHT_PX: f32 = 1.5;
/// One corner is wanted per this many pixels of the sweep's image, up to the configured count.
const PIXELS_PER_CORNER: usize = 20;

/// Triangulates up to `config.corners` corners of `reference`.
///
/// Each corner is compared at `config.sweep_candidates` inverse depths, uniform between 1/far and 1/near, with all neighbours; the best is
/// kept where it is unique and where the match leads back; then refined to a fraction of a step. Order: by row, then column.
///
/// # Errors
/// The matcher's.
pub fn triangulate(
    matcher: &dyn Matcher,
    reference: &GreyView,
    neighbours: &[Neighbour<'_>],
    config: &DepthConfig,
) -> Result<Found<SparseDepth>> {
    if neighbours.is_empty() {
        return Ok(Found::here(Vec::new()));
    }
    let wanted = config.corners.min(reference.coarse.width() * reference.coarse.height() / PIXELS_PER_CORNER);
    let corners = corners(&reference.coarse, wanted);
    let Found { depths, device_s } = matcher.sweep(reference, neighbours, &corners, config)?;
    let half = (1usize << reference.coarse_level) / 2;
    let at = |c: usize| (c << reference.coarse_level) + half;
    let found = corners.into_iter().zip(depths);
    let found = found.filter_map(|((x, y), inverse)| Some(SparseDepth { x: at(x), y: at(y), inverse_depth: inverse? }));
    Ok(Found { depths: found.collect(), device_s })
}

/// The unique best inverse depth of a pixel of the sweep's image that leads back to it, or `None` where there is none.
pub(super) fn sweep_pixel(
    reference: &GreyView,
    neighbours: &[Neighbour<'_>],
    x: usize,
    y: usize,
    config: &DepthConfig,
) -> Option<f32> {
    let patch = Patch::new(&reference.coarse, x, y, RADIUS)?;
    let camera = &reference.coarse_camera;
    let (u, v) = (x as f32 + 0.5, y as f32 + 0.5);
    let (far, step) = range(config);
    let score = |inverse_depth: f32| {
        let (mut sum, mut seen) = (0.0, 0u32);
        for n in neighbours {
            let warp = n.warp(camera, &n.view.coarse_camera, u, v, inverse_depth);
            if let Some(z) = warp.and_then(|w| patch.zncc(&n.view.coarse, &w)) {
                sum += z;
                seen += 1;
            }
        }
        if seen == 0 { f32::NAN } else { sum / seen as f32 }
    };
    let scores: Vec<f32> = (0..config.sweep_candidates).map(|k| score(far + step * k as f32)).collect();
    let (best, &best_score) = scores.iter().enumerate().filter(|s| !s.1.is_nan()).max_by(|a, b| a.1.total_cmp(b.1))?;
    let rival = scores
        .iter()
        .enumerate()
        .filter(|(k, s)| k.abs_diff(best) >= PEAK_STEPS && !s.is_nan())
        .fold(-1.0f32, |m, (_, &s)| m.max(s));
    if 1.0 - rival <= 0.0 {
        return None;
    }
    // The coarse steps may straddle a narrow peak: climb it before judging.
    let (inverse_depth, zncc) = refine(&score, far + step * best as f32, best_score, step, far);
    if zncc < config.min_zncc || 1.0 - zncc > UNIQUENESS * (1.0 - rival) {
        return None;
    }
    leads_back(reference, neighbours, u, v, inverse_depth, config).then_some(inverse_depth)
}

/// Smallest inverse depth and step of the sweep, 1/m.
pub(crate) fn range(config: &DepthConfig) -> (f32, f32) {
    let (far, near) = (1.0 / config.far_m, 1.0 / config.near_m);
    (far as f32, ((near - far) / (config.sweep_candidates - 1) as f64) as f32)
}

/// Times that the step is halved around the best hypothesis.
pub(crate) const HALVINGS: usize = 5;

/// Halves the step around the best hypothesis, then a parabola.
fn refine(score: &impl Fn(f32) -> f32, start: f32, start_score: f32, step: f32, far: f32) -> (f32, f32) {
    let (mut center, mut best, mut step) = (start, start_score, step);
    for _ in 0..HALVINGS {
        step *= 0.5;
        for candidate in [center - step, center + step] {
            let s = if candidate > 0.5 * far { score(candidate) } else { f32::NAN };
            if s > best {
                (center, best) = (candidate, s);
            }
        }
    }
    let (before, after) = (score(center - step), score(center + step));
    if before.is_nan() || after.is_nan() || before > best || after > best {
        return (center, best);
    }
    (center + step * parabola_offset(before, best, after), best)
}

/// The left-right check: the match in the neighbour that agrees best, swept back alone, must return to where it came from.
fn leads_back(
    reference: &GreyView,
    neighbours: &[Neighbour<'_>],
    u: f32,
    v: f32,
    inverse_depth: f32,
    config: &DepthConfig,
) -> bool {
    let from = &reference.coarse_camera;
    let (x, y) = ((u - 0.5) as usize, (v - 0.5) as usize);
    let Some(patch) = Patch::new(&reference.coarse, x, y, RADIUS) else { return false };
    let best = neighbours
        .iter()
        .filter_map(|n| {
            let warp = n.warp(from, &n.view.coarse_camera, u, v, inverse_depth)?;
            Some((patch.zncc(&n.view.coarse, &warp)?, n, warp.center))
        })
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, neighbour, landed)) = best else { return false };
    let back = Neighbour::new(neighbour.view, reference);
    // The pixel the match lands in; the way back starts at its centre, so the offset within the pixel is allowed for.
    let (px, py) = (landed.x as usize, landed.y as usize);
    let Some(patch) = Patch::new(&neighbour.view.coarse, px, py, RADIUS) else { return false };
    let there: &Pinhole = &neighbour.view.coarse_camera;
    let (qu, qv) = (px as f32 + 0.5, py as f32 + 0.5);
    let (far, step) = range(config);
    let score =
        |w: f32| back.warp(there, from, qu, qv, w).and_then(|warp| patch.zncc(&reference.coarse, &warp)).unwrap_or(f32::NAN);
    let best = (0..config.sweep_candidates)
        .map(|k| far + step * k as f32)
        .map(|w| (w, score(w)))
        .filter(|s| !s.1.is_nan())
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((w, s)) = best else { return false };
    let (w, _) = refine(&score, w, s, step, far);
    let Some(returned) = back.warp(there, from, qu, qv, w) else { return false };
    // Where the pixel centre itself would return to at the depth claimed: removes the rounding of `landed`.
    let claimed = neighbour.inverse_depth_there(from, u, v, inverse_depth).and_then(|w| back.warp(there, from, qu, qv, w));
    claimed.is_some_and(|c| (c.center - returned.center).length() <= LEFT_RIGHT_PX)
}

/// The strongest Shi–Tomasi corners (smaller eigenvalue of the 5×5 structure tensor) that are maxima of their 3×3 neighbourhood and rest on pixels
/// that count alone; by row, then column.
fn corners(image: &GreyImage, count: usize) -> Vec<(usize, usize)> {
    const BORDER: usize = RADIUS + 1;
    let (w, h) = (image.width(), image.height());
    if w <= 2 * BORDER || h <= 2 * BORDER {
        return Vec::new();
    }
    let gradient = Raster::from_fn(w, h, |x, y| {
        let at = |x: usize, y: usize| image.at(x.min(w - 1), y.min(h - 1));
        (0.5 * (at(x + 1, y) - at(x.saturating_sub(1), y)), 0.5 * (at(x, y + 1) - at(x, y.saturating_sub(1))))
    });
    let strength: Vec<f32> = (0..w * h)
        .into_par_iter()
        .map(|i| {
            let (x, y) = (i % w, i / w);
            if x < BORDER || y < BORDER || x >= w - BORDER || y >= h - BORDER {
                return 0.0;
            }
            // The gradients of the window reach one pixel beyond it.
            if !image.counts([x - RADIUS, y - RADIUS], [x + RADIUS, y + RADIUS]) {
                return 0.0;
            }
            let (mut xx, mut xy, mut yy) = (0.0f32, 0.0, 0.0);
            for v in y - 2..=y + 2 {
                for u in x - 2..=x + 2 {
                    let (gx, gy) = gradient[(u, v)];
                    xx += gx * gx;
                    xy += gx * gy;
                    yy += gy * gy;
                }
            }
            0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt()
        })
        .collect();
    /// Smaller eigenvalue of 25 pixels that each step by 1/255: weaker "corners" are rounding.
    const FLOOR: f32 = 25.0 / (255.0 * 255.0);
    let mut found: Vec<(f32, usize)> = (0..w * h)
        .filter(|&i| strength[i] > FLOOR)
        .filter(|&i| {
            let (x, y) = (i % w, i / w);
            (y - 1..=y + 1).all(|v| (x - 1..=x + 1).all(|u| strength[v * w + u] <= strength[i]))
        })
        .map(|i| (strength[i], i))
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.truncate(count);
    let mut places: Vec<usize> = found.into_iter().map(|f| f.1).collect();
    places.sort_unstable();
    places.into_iter().map(|i| (i % w, i / w)).collect()
}
