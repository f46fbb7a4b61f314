//! Robust alignment of an affine-invariant inverse depth to triangulated ones, and a confidence for every pixel.

use super::{SparseDepth, dense::Dense};
use crate::config::DepthConfig;
use corf_scene::Raster;
use rayon::prelude::*;

/// A dense prior in metric inverse depth.
#[derive(Clone, Debug)]
pub struct AlignedPrior {
    /// 1/z, 1/m, at least 1/far.
    pub inverse_depth: Dense,
    /// `exp(−|Sobel|²/0.2)` of the median/MAD-normalised map, its slopes those per image pixel; 0 where that is 0.5 or less (a depth edge), the
    /// aligned value was beyond far, or the prior has a hole.
    pub confidence: Dense,
    /// `aligned = scale · mono + offset`.
    pub scale: f32,
    /// 1/m.
    pub offset: f32,
}

/// Fewest triangulated depths that define an alignment.
pub const LEAST_ANCHORS: usize = 12;

/// Aligns a prior to triangulated depths. Where there are fewer than [`LEAST_ANCHORS`] or they do not define a positive scale, a metric prior is
/// taken as it is, and of any other there is `None`.
pub fn align(mono: &Dense, anchors: &[SparseDepth], config: &DepthConfig) -> Option<AlignedPrior> {
    let known = anchors.iter().filter(|a| mono.is_known(a.x, a.y));
    let pairs: Vec<(f64, f64)> =
        known.map(|a| (f64::from(mono.at(a.x, a.y)), f64::from(a.inverse_depth))).filter(|p| p.0.is_finite()).collect();
    let fitted = if pairs.len() < LEAST_ANCHORS { None } else { scale_and_offset(&pairs) };
    let (scale, offset) = fitted.or_else(|| mono.is_metric().then_some((1.0, 0.0)))?;
    Some(AlignedPrior::new(mono, scale as f32, offset as f32, config))
}

impl AlignedPrior {
    /// A prior with a scale and an offset that are known.
    pub fn new(mono: &Dense, scale: f32, offset: f32, config: &DepthConfig) -> Self {
        let (far, near) = ((1.0 / config.far_m) as f32, (1.0 / config.near_m) as f32);
        let grid = mono.grid();
        let mut confidence = edge_confidence(grid, mono.cells_per_pixel());
        mono.clear_holes(&mut confidence);
        let mut inverse_depth = Raster::filled(grid.width(), grid.height(), 0.0);
        let cells = inverse_depth.pixels_mut().par_iter_mut().zip(confidence.pixels_mut()).zip(grid.pixels());
        cells.with_min_len(1024).for_each(|((inverse_depth, confidence), m)| {
            let raw = scale * m + offset;
            *inverse_depth = raw.clamp(far, near);
            if raw < far {
                *confidence = 0.0;
            }
        });
        Self { inverse_depth: mono.with(inverse_depth), confidence: mono.with(confidence), scale, offset }
    }
}

/// The middle value (the upper one of an even count); `values` is not empty.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Median and median absolute deviation.
fn location_and_spread(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let mut all: Vec<f64> = values.clone().collect();
    let t = median(&mut all);
    let mut deviations: Vec<f64> = values.map(|v| (v - t).abs()).collect();
    (t, median(&mut deviations))
}

/// t = median, s = median|d − t|; scale = s_tri/s_mono, offset = t_tri − scale·t_mono; errors of 5× the median error and more are dropped and
/// it is fitted once again.
fn scale_and_offset(pairs: &[(f64, f64)]) -> Option<(f64, f64)> {
    let fit = |pairs: &[(f64, f64)]| {
        let (t_mono, s_mono) = location_and_spread(pairs.iter().map(|p| p.0));
        let (t_tri, s_tri) = location_and_spread(pairs.iter().map(|p| p.1));
        let scale = s_tri / s_mono;
        (scale.is_finite() && scale > 0.0).then_some((scale, t_tri - scale * t_mono))
    };
    let (scale, offset) = fit(pairs)?;
    let error = |p: &(f64, f64)| (scale * p.0 + offset - p.1).abs();
    let mut errors: Vec<f64> = pairs.iter().map(error).collect();
    let limit = 5.0 * median(&mut errors);
    let kept: Vec<(f64, f64)> = pairs.iter().copied().filter(|p| error(p) < limit).collect();
    if kept.len() < LEAST_ANCHORS { Some((scale, offset)) } else { fit(&kept) }
}

/// Median and median absolute deviation of a map.
fn location_and_spread_of(map: &Raster<f32>) -> (f32, f32) {
    let mut values = map.pixels().to_vec();
    let middle = values.len() / 2;
    let location = *values.select_nth_unstable_by(middle, f32::total_cmp).1;
    values.iter_mut().for_each(|v| *v = (*v - location).abs());
    (location, *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// `exp(−|Sobel|²/0.2)` of the map normalised by its median and median absolute deviation, 0 where it is 0.5 or less. Slopes are per
/// image pixel, so that what an edge is does not depend on how many cells (`per_pixel` along either axis) the map has.
fn edge_confidence(map: &Raster<f32>, per_pixel: [f32; 2]) -> Raster<f32> {
    let (w, h) = (map.width(), map.height());
    let (_, spread) = location_and_spread_of(map);
    // Sobel's kernels divided by 8, so that a ramp of slope 1 per pixel gives 1.
    let [unit_x, unit_y] = per_pixel.map(|cells| cells / (8.0 * if spread > 0.0 { spread } else { 1.0 }));
    let mut pixels = vec![0.0; w * h];
    pixels.par_chunks_mut(w.max(1)).enumerate().for_each(|(y, out)| {
        let row = |y: usize| &map.pixels()[y * w..(y + 1) * w];
        let (above, here, below) = (row(y.saturating_sub(1)), row(y), row((y + 1).min(h - 1)));
        for (x, confidence) in out.iter_mut().enumerate() {
            let (l, r) = (x.saturating_sub(1), (x + 1).min(w - 1));
            let gx = unit_x * ((above[r] + 2.0 * here[r] + below[r]) - (above[l] + 2.0 * here[l] + below[l]));
            let gy = unit_y * ((below[l] + 2.0 * below[x] + below[r]) - (above[l] + 2.0 * above[x] + above[r]));
            let squared = gx * gx + gy * gy;
            // Beyond ln 2 · 0.2 the confidence is one half or less.
            if squared < 0.2 * std::f32::consts::LN_2 {
                *confidence = (-squared / 0.2).exp();
            }
        }
    });
    Raster::from_vec(w, h, pixels)
}
