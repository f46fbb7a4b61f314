//! Local correction of an aligned prior by the matches that were accurate: one scale and one offset per image leave a monocular network's
//! local errors, which differ from surface to surface and change slowly along one.

use super::{AlignedPrior, PixelDepth, Reliability};
use crate::config::DepthConfig;
use corf_scene::Raster;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Fewest accurate matches that correct anything.
const LEAST_MATCHES: usize = 24;
/// Columns, rows and steps of ln(inverse depth) of the two grids, coarse before fine.
const LEVELS: [[usize; 3]; 2] = [[7, 5, 9], [22, 13, 25]];
/// A cell of the grid is drawn to no correction as if it held this much weight of it.
const SHRINKAGE: f32 = 1.0;
/// Rounds of iteratively reweighted averaging at each level.
const ROUNDS: usize = 3;

/// The logarithm of matched over prior inverse depth, over the image and the prior's own inverse depth: a bilateral grid per level, whose
/// interpolated values add up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Correction {
    /// Row by row, then by depth: the values of each level's grid, dimensionless.
    grids: Vec<Vec<f32>>,
}

/// Trilinear interpolation in a grid: eight cells and their weights.
type Corners = [(usize, f32); 8];

/// Positions along the axes of a grid, in `[0, 1]`.
type Place = [f32; 3];

impl Correction {
    /// Fits the matches that are `Accurate`; `None` where they are too few.
    ///
    /// At each level the residual logarithms are averaged in the cells around them, neighbours included, with Huber's weights from the median
    /// absolute residual, so that wrong matches move little.
    pub fn fit(prior: &AlignedPrior, matches: &[PixelDepth], config: &DepthConfig) -> Option<Self> {
        let (w, h) = prior.inverse_depth.image();
        let points: Vec<(Place, f32)> = matches
            .iter()
            .filter(|m| m.reliability == Reliability::Accurate)
            .map(|m| {
                let guess = prior.inverse_depth.at(m.x, m.y);
                let place = [(m.x as f32 + 0.5) / w as f32, (m.y as f32 + 0.5) / h as f32, depth_place(guess, config)];
                (place, (m.inverse_depth / guess).ln())
            })
            .collect();
        if points.len() < LEAST_MATCHES {
            return None;
        }
        let mut residuals: Vec<f32> = points.iter().map(|p| p.1).collect();
        let mut grids = Vec::new();
        for size in LEVELS {
            let corners: Vec<Corners> = points.iter().map(|p| corners(p.0, size)).collect();
            let mut grid = vec![0.0; size.iter().product()];
            for _ in 0..ROUNDS {
                let left: Vec<f32> = residuals.iter().zip(&corners).map(|(r, c)| r - value(&grid, c)).collect();
                let mut sizes: Vec<f32> = left.iter().map(|r| r.abs()).collect();
                let middle = sizes.len() / 2;
                // 1.4826 turns a median absolute deviation into the σ of a normal distribution.
                let sigma = (1.4826 * *sizes.select_nth_unstable_by(middle, f32::total_cmp).1).max(1e-5);
                let weight = |r: f32| if r.abs() > 6.0 * sigma { 0.0 } else { (1.345 * sigma / r.abs()).min(1.0) };
                let mut sums = vec![[0.0f32; 2]; grid.len()];
                for ((r, left), corners) in residuals.iter().zip(&left).zip(&corners) {
                    for (cell, share) in corners {
                        let w = share * weight(*left);
                        sums[*cell][0] += w * r;
                        sums[*cell][1] += w;
                    }
                }
                let sums = smooth(sums, size);
                grid = sums.iter().map(|[sum, weight]| sum / (weight + SHRINKAGE)).collect();
            }
            residuals.iter_mut().zip(&corners).for_each(|(r, c)| *r -= value(&grid, c));
            grids.push(grid);
        }
        Some(Self { grids })
    }

    /// The prior with its inverse depth corrected; scale, offset and confidence stay.
    pub fn apply(&self, prior: &AlignedPrior, config: &DepthConfig) -> AlignedPrior {
        let (far, near) = ((1.0 / config.far_m) as f32, (1.0 / config.near_m) as f32);
        let old = prior.inverse_depth.grid();
        let (w, h) = (old.width(), old.height());
        // Where a column, and a row, lie in each grid is the same down the image, and across it.
        let along =
            |axis: usize, at: usize, count: usize| LEVELS.map(|size| between((at as f32 + 0.5) / count as f32, size[axis]));
        let columns: Vec<[Between; LEVELS.len()]> = (0..w).map(|x| along(0, x, w)).collect();
        let mut new = Raster::filled(w, h, 0.0);
        let rows = new.pixels_mut().par_chunks_mut(w.max(1)).zip(old.pixels().par_chunks(w.max(1)));
        rows.enumerate().for_each(|(y, (row, guesses))| {
            let down = along(1, y, h);
            for ((out, guess), across) in row.iter_mut().zip(guesses).zip(&columns) {
                let depth = depth_place(*guess, config);
                let value = |level: usize| {
                    let size = LEVELS[level];
                    value_at(&self.grids[level], size, [across[level], down[level], between(depth, size[2])])
                };
                let log: f32 = (0..LEVELS.len()).map(value).sum();
                *out = (guess * log.exp()).clamp(far, near);
            }
        });
        AlignedPrior { inverse_depth: prior.inverse_depth.with(new), ..prior.clone() }
    }
}

/// Normalised logarithm of an inverse depth: 0 at the furthest depth considered, 1 at the nearest.
fn depth_place(inverse_depth: f32, config: &DepthConfig) -> f32 {
    let range = (config.far_m / config.near_m).ln() as f32;
    (inverse_depth * config.far_m as f32).ln() / range
}

/// The first of two neighbouring cells along an axis, and the weight of the second.
type Between = (usize, f32);

fn between(place: f32, cells: usize) -> Between {
    let at = (place * (cells - 1) as f32).clamp(0.0, (cells - 1) as f32);
    let first = (at as usize).min(cells.saturating_sub(2));
    (first, at - first as f32)
}

/// [`value`] at [`corners`], from where a place lies along each axis.
fn value_at(grid: &[f32], size: [usize; 3], [x, y, z]: [Between; 3]) -> f32 {
    let shares = |(_, second): Between| [1.0 - second, second];
    let (of_x, of_y, of_z) = (shares(x), shares(y), shares(z));
    let first = (z.0 * size[1] + y.0) * size[0] + x.0;
    let part = |corner: usize| {
        let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
        of_z[k] * of_y[j] * of_x[i] * grid[first + (k * size[1] + j) * size[0] + i]
    };
    (0..8).map(part).sum()
}

fn corners(place: Place, size: [usize; 3]) -> Corners {
    let axes = [0, 1, 2].map(|k| between(place[k], size[k]));
    std::array::from_fn(|corner| {
        let (mut cell, mut weight) = (0, 1.0);
        for k in (0..3).rev() {
            let upper = corner >> k & 1;
            cell = cell * size[k] + axes[k].0 + upper;
            weight *= if upper == 1 { axes[k].1 } else { 1.0 - axes[k].1 };
        }
        (cell, weight)
    })
}

fn value(grid: &[f32], corners: &Corners) -> f32 {
    corners.iter().map(|(cell, weight)| weight * grid[*cell]).sum()
}

/// One pass of the kernel (1, 2, 1)/2 along each axis: sums keep their meaning, neighbours lend a share.
fn smooth(mut cells: Vec<[f32; 2]>, size: [usize; 3]) -> Vec<[f32; 2]> {
    let strides = [1, size[0], size[0] * size[1]];
    for (stride, count) in strides.into_iter().zip(size) {
        let old = cells.clone();
        for (i, cell) in cells.iter_mut().enumerate() {
            let at = i / stride % count;
            for (inside, other) in [(at > 0, i.wrapping_sub(stride)), (at + 1 < count, i + stride)] {
                if inside {
                    cell[0] += 0.5 * old[other][0];
                    cell[1] += 0.5 * old[other][1];
                }
            }
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::Dense;
    use corf_scene::Rng;

    const SIZE: (usize, usize) = (120, 80);

    /// A wall at 6 m with a box at 2 m before it.
    fn truth(x: usize, y: usize) -> f32 {
        if (40..80).contains(&x) && y > 30 { 0.5 } else { 1.0 / 6.0 }
    }

    /// Errs by 15 % to both sides across the wall, and by −10 % on the box.
    fn prior(config: &DepthConfig) -> AlignedPrior {
        let wrong = Raster::from_fn(SIZE.0, SIZE.1, |x, y| {
            let t = truth(x, y);
            t * if t > 0.3 { 0.9 } else { 1.0 + 0.15 * (x as f32 / 60.0 - 1.0) }
        });
        AlignedPrior::new(&Dense::new(wrong, SIZE), 1.0, 0.0, config)
    }

    fn matches(outliers: f32) -> Vec<PixelDepth> {
        let mut rng = Rng::keyed(7, 0, 0);
        let some = (0..600).map(|_| (rng.below(SIZE.0), rng.below(SIZE.1), rng.uniform(), rng.uniform()));
        some.map(|(x, y, lot, error)| {
            let error = if lot < outliers { 0.5 + error } else { 0.99 + 0.02 * error };
            PixelDepth { x, y, inverse_depth: truth(x, y) * error, reliability: Reliability::Accurate }
        })
        .collect()
    }

    fn mean_error(prior: &AlignedPrior) -> f32 {
        let error = |i: usize| (prior.inverse_depth.at(i % SIZE.0, i / SIZE.0) / truth(i % SIZE.0, i / SIZE.0) - 1.0).abs();
        (0..SIZE.0 * SIZE.1).map(error).sum::<f32>() / (SIZE.0 * SIZE.1) as f32
    }

    #[test]
    fn local_errors_of_surfaces_are_corrected_and_wrong_matches_move_little() {
        let config = DepthConfig::default();
        let prior = prior(&config);
        let before = mean_error(&prior);
        for (outliers, left) in [(0.0, 0.2), (0.15, 0.3)] {
            let correction = Correction::fit(&prior, &matches(outliers), &config).unwrap();
            let after = mean_error(&correction.apply(&prior, &config));
            assert!(after < left * before, "{outliers}: {before} to {after}");
        }
    }

    #[test]
    fn a_prior_that_is_right_stays_and_few_matches_correct_nothing() {
        let config = DepthConfig::default();
        let right = AlignedPrior::new(&Dense::new(Raster::from_fn(SIZE.0, SIZE.1, truth), SIZE), 1.0, 0.0, &config);
        let correction = Correction::fit(&right, &matches(0.0), &config).unwrap();
        assert!(mean_error(&correction.apply(&right, &config)) < 0.004);
        assert_eq!(Correction::fit(&right, &matches(0.0)[..LEAST_MATCHES - 1], &config), None);
        let unsure: Vec<PixelDepth> =
            matches(0.0).into_iter().map(|m| PixelDepth { reliability: Reliability::Prior, ..m }).collect();
        assert_eq!(Correction::fit(&right, &unsure, &config), None);
    }

    #[test]
    fn every_pixel_has_the_value_of_its_place_to_the_last_bit() {
        let config = DepthConfig::default();
        let prior = prior(&config);
        let correction = Correction::fit(&prior, &matches(0.1), &config).unwrap();
        let (corrected, old) = (correction.apply(&prior, &config), prior.inverse_depth.grid());
        for (y, x) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (y, x))) {
            let place = [(x as f32 + 0.5) / SIZE.0 as f32, (y as f32 + 0.5) / SIZE.1 as f32, depth_place(old[(x, y)], &config)];
            let values = LEVELS.iter().zip(&correction.grids).map(|(size, grid)| value(grid, &corners(place, *size)));
            let expected =
                (old[(x, y)] * values.sum::<f32>().exp()).clamp((1.0 / config.far_m) as f32, (1.0 / config.near_m) as f32);
            assert_eq!(corrected.inverse_depth.grid()[(x, y)].to_bits(), expected.to_bits(), "({x}, {y})");
        }
    }

    #[test]
    fn a_correction_survives_being_written() {
        let config = DepthConfig::default();
        let correction = Correction::fit(&prior(&config), &matches(0.1), &config).unwrap();
        let again: Correction = serde_json::from_str(&serde_json::to_string(&correction).unwrap()).unwrap();
        assert_eq!(again, correction);
    }
}
