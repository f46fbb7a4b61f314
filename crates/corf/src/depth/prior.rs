//! Dense, affine-invariant inverse depth: where it comes from.

use super::{dense::Dense, folder::FolderPrior};
use crate::image_networks::depth_anything::DepthNetwork;
use crate::{
    Error, Result,
    config::{DepthConfig, DepthPriorKind, PriorPreset},
    stage,
};
use corf_scene::{Light, Raster, Rng};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::sync::Arc;

/// A source of dense inverse depth, known up to scale and offset.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum DepthPrior {
    /// The ray tracer's depth with a monocular network's error model. **Consumes ground-truth depth.**
    Simulated(SimulatedPrior),
    /// The ray tracer's depth. **Consumes ground-truth depth.**
    Exact,
    /// The keyframe's own depth, where it has one. **Consumes the data set's depth.**
    Measured,
    /// Maps that are there already.
    Folder(FolderPrior),
    /// Depth-Anything-V2.
    DepthAnything(Arc<DepthNetwork>),
    /// No dense prior.
    None,
}

impl DepthPrior {
    /// The prior a configuration asks for; a network's weights are read.
    ///
    /// # Errors
    /// A prior whose files the configuration does not name; weights that cannot be used.
    pub fn new(config: &DepthConfig, seed: u64) -> Result<Self> {
        let named = |key: &str, path: &Option<PathBuf>| {
            let missing = || Error::invalid(format!("reconstruction config, key `depth.{key}`"), "it is missing", "give a path");
            path.clone().ok_or_else(missing)
        };
        Ok(match config.prior {
            DepthPriorKind::Simulated => Self::Simulated(SimulatedPrior::new(config.preset, seed)),
            DepthPriorKind::Exact => Self::Exact,
            DepthPriorKind::Measured => Self::Measured,
            DepthPriorKind::Folder => Self::Folder(FolderPrior::new(named("folder", &config.folder)?, config)),
            DepthPriorKind::DepthAnything => {
                Self::DepthAnything(Arc::new(DepthNetwork::read(&named("weights", &config.weights)?, config)?))
            }
            DepthPriorKind::None => Self::None,
        })
    }

    /// The dense prior of keyframe `index`, of what its camera saw; `None` from [`Self::None`], and from [`Self::Measured`] where the keyframe brings
    /// no depth.
    ///
    /// # Errors
    /// A keyframe without the depth, the map or the image that the prior needs.
    pub fn estimate(&self, index: usize, light: &Light) -> Result<Option<Dense>> {
        let image = &light.image;
        match self {
            Self::Simulated(prior) => prior.estimate(index, light).map(Some),
            Self::Exact => true_depth_of(index, light).map(|depth| Some(inverse_of(depth))),
            Self::Measured => Ok(light.depth_m.as_ref().filter(|depth| has_depth(depth)).map(inverse_of)),
            Self::Folder(prior) => prior.read(index, (image.width(), image.height())).map(Some),
            Self::DepthAnything(network) => network.estimate(image).map(Some),
            Self::None => Ok(None),
        }
    }

    /// Whether it is metric and right: it is neither aligned nor matched.
    pub fn is_exact(&self) -> bool {
        matches!(self, Self::Exact | Self::Measured)
    }

    /// Refuses a keyframe that [`Self::estimate`] could not use, as far as a look at it tells; [`Self::check_all`] reads what is in files.
    ///
    /// # Errors
    /// Those of [`Self::estimate`].
    pub fn check(&self, index: usize, light: &Light) -> Result<()> {
        match self {
            Self::Simulated(_) | Self::Exact => true_depth_of(index, light).map(|_| ()),
            Self::Folder(prior) => prior.check(index),
            Self::DepthAnything(network) => network.input_size((light.image.width(), light.image.height())).map(|_| ()),
            Self::Measured | Self::None => Ok(()),
        }
    }

    /// Looks, before there are keyframes, for all that is needed of keyframes with these indices and of images of this size (columns, rows).
    ///
    /// # Errors
    /// Those of [`Self::estimate`]; what keyframes bring with them is not known yet.
    pub fn check_all(&self, indices: &[usize], image: (usize, usize)) -> Result<()> {
        match self {
            Self::Folder(prior) => prior.check_all(indices, image),
            Self::DepthAnything(network) => network.input_size(image).map(|_| ()),
            Self::Simulated(_) | Self::Exact | Self::Measured | Self::None => Ok(()),
        }
    }

    /// Whether results made with this prior must say that they used the depth that keyframes bring.
    pub fn consumes_ground_truth_depth(&self) -> bool {
        matches!(self, Self::Simulated(_) | Self::Exact | Self::Measured)
    }

    /// Whether the depth that keyframes bring can judge the depths found: not where it is what they were found from and may itself be wrong.
    pub fn leaves_a_truth(&self) -> bool {
        !matches!(self, Self::Measured)
    }
}

/// Fourier modes of the smooth random field.
const MODES: u64 = 24;
/// Correlation of the smooth random field from one frame of the trajectory to the next.
const FRAME_CORRELATION: f64 = 0.8;
/// Number of frames over which the random field's recursion is summed: earlier ones weigh less than 1e-6.
const FRAMES_REMEMBERED: usize = 64;
/// Blur of the network's output, pixels of an image whose shorter side is [`NETWORK_SIDE_PX`].
const BLUR_PX: f64 = 1.5;
/// Shorter side of the images the network that is imitated works on, pixels; larger images are reduced to it.
const NETWORK_SIDE_PX: usize = 518;
/// Standard deviation of the per-pixel noise, in units of the median inverse depth.
const NOISE: f64 = 0.004;

/// A monocular network's error model: `m = a·[G_σ ∗ (d^(1+γ)·exp(λF(u) + κ b_obj)) + n] + b` with d the inverse depth over its median.
///
/// F is a unit smooth random field (AR(1) over the frames of the trajectory, ρ = 0.8), b_obj ~ N(0, 1) per surface and fixed over time (left
/// out where a keyframe carries no surface indices), γ ~ N(0, γ₀) per frame, n white, and a, b an arbitrary scale and offset per frame.
#[derive(Clone, Debug)]
pub struct SimulatedPrior {
    seed: u64,
    /// Standard deviation of the depth-curve exponent γ.
    gamma: f64,
    /// Strength λ of the smooth field.
    lambda: f64,
    /// Strength κ of the per-object bias.
    kappa: f64,
}

impl SimulatedPrior {
    /// The error model of a preset.
    pub fn new(preset: PriorPreset, seed: u64) -> Self {
        let (gamma, lambda, kappa) = match preset {
            PriorPreset::Mild => (0.03, 0.025, 0.04),
            PriorPreset::Default => (0.06, 0.05, 0.04),
            PriorPreset::Hard => (0.08, 0.06, 0.08),
        };
        Self { seed, gamma, lambda, kappa }
    }

    /// The affine-invariant inverse depth this network would have given, at its resolution or the image's, whichever is lower.
    ///
    /// # Errors
    /// A keyframe without depth, or with no finite depth at all.
    pub fn estimate(&self, index: usize, light: &Light) -> Result<Dense> {
        let depth = true_depth_of(index, light)?;
        let image = (depth.width(), depth.height());
        let (w, h) = network_size(image);
        let columns: Vec<usize> = (0..w).map(|x| (2 * x + 1) * image.0 / (2 * w)).collect();
        let row_of = |y: usize| (2 * y + 1) * image.1 / (2 * h) * image.0;
        let inverse: Vec<f64> = (0..w * h)
            .into_par_iter()
            .with_min_len(w)
            .map(|i| {
                let z = depth.pixels()[row_of(i / w) + columns[i % w]];
                if z > 0.0 && z.is_finite() { 1.0 / f64::from(z) } else { 0.0 }
            })
            .collect();
        let mut hit: Vec<f64> = inverse.iter().copied().filter(|&d| d > 0.0).collect();
        if hit.is_empty() {
            // What was hit fell between the network's pixels.
            hit.push(1.0);
        }
        let middle = hit.len() / 2;
        let median = *hit.select_nth_unstable_by(middle, f64::total_cmp).1;

        let frame = index as u64;
        let mut rng = Rng::keyed(self.seed, stage::PRIOR_FRAME, frame);
        let exponent = 1.0 + self.gamma * rng.normal();
        let (scale, offset) = (3.0 * (0.2 * rng.normal()).exp(), 0.3 * rng.normal());
        let bias = |surface: u32| self.kappa * Rng::keyed(self.seed, stage::PRIOR_OBJECT, u64::from(surface)).normal();
        // Neighbours are mostly of one surface.
        let runs = light.surface.iter().flat_map(|s| s.pixels().chunk_by(|a, b| a == b));
        let mut surfaces: Vec<u32> = runs.map(|run| run[0]).collect();
        surfaces.sort_unstable();
        surfaces.dedup();
        let biases: BTreeMap<u32, f64> = surfaces.into_iter().map(|surface| (surface, bias(surface))).collect();

        let field = SmoothField::new(&self.waves(), &self.amplitudes(index), w);
        let mut distorted = vec![0.0; w * h];
        distorted.par_chunks_mut(w).enumerate().for_each(|(y, row)| {
            field.row(y, row);
            let surfaces = light.surface.as_ref().map(|s| &s.pixels()[row_of(y)..]);
            let mut last = (u32::MAX, biases.get(&u32::MAX).copied().unwrap_or(0.0));
            for (x, value) in row.iter_mut().enumerate() {
                if let Some(surface) = surfaces.map(|s| s[columns[x]]).filter(|s| *s != last.0) {
                    last = (surface, biases[&surface]);
                }
                let object = if surfaces.is_some() { last.1 } else { 0.0 };
                *value = (inverse[y * w + x] / median).powf(exponent) * (self.lambda * *value + object).exp();
            }
        });
        let blurred = blur(&distorted, w, h, BLUR_PX * w.min(h) as f64 / NETWORK_SIDE_PX as f64);
        let noise_stage = stage::keyed(stage::PRIOR_NOISE, index);
        let noisy = |(i, d): (usize, &f64)| {
            let n = NOISE * Rng::keyed(self.seed, noise_stage, i as u64).normal();
            (scale * (d + n) + offset) as f32
        };
        let pixels = blurred.par_iter().enumerate().with_min_len(w).map(noisy).collect();
        Ok(Dense::new(Raster::from_vec(w, h, pixels), image))
    }

    /// Wave vectors of the smooth field, radians per image width: wavelengths between a quarter of the width and the whole of it.
    fn waves(&self) -> Vec<[f64; 2]> {
        (0..MODES)
            .map(|k| {
                let mut rng = Rng::keyed(self.seed, stage::PRIOR_WAVES, k);
                let (cycles, angle) = (1.0 + 3.0 * rng.uniform_f64(), TAU * rng.uniform_f64());
                [TAU * cycles * angle.cos(), TAU * cycles * angle.sin()]
            })
            .collect()
    }

    /// The modes' amplitudes at a trajectory frame: AR(1), so neighbouring frames err alike. Frames that were not asked for still pass.
    fn amplitudes(&self, frame: usize) -> Vec<[f64; 2]> {
        let innovation = |at: usize, k: u64| {
            let mut rng = Rng::keyed(self.seed, stage::keyed(stage::PRIOR_FIELD, at), k);
            [rng.normal(), rng.normal()]
        };
        let first = frame.saturating_sub(FRAMES_REMEMBERED);
        let mut amplitudes: Vec<[f64; 2]> = (0..MODES).map(|k| innovation(first, k)).collect();
        let fresh = (1.0 - FRAME_CORRELATION * FRAME_CORRELATION).sqrt();
        for at in first + 1..=frame {
            for (k, a) in amplitudes.iter_mut().enumerate() {
                let e = innovation(at, k as u64);
                *a = [FRAME_CORRELATION * a[0] + fresh * e[0], FRAME_CORRELATION * a[1] + fresh * e[1]];
            }
        }
        amplitudes
    }
}

/// Whether any pixel has a positive, finite depth.
fn has_depth(depth: &Raster<f32>) -> bool {
    depth.pixels().iter().any(|z| *z > 0.0 && z.is_finite())
}

/// Depth as an exact prior, 0 where there is none.
fn inverse_of(depth: &Raster<f32>) -> Dense {
    let inverse = depth.map(|&z| if z > 0.0 && z.is_finite() { 1.0 / z } else { 0.0 });
    Dense::new(inverse, (depth.width(), depth.height()))
}

/// The depth of a keyframe that has one.
fn true_depth_of(index: usize, light: &Light) -> Result<&Raster<f32>> {
    let help = "pass --set 'depth.prior=\"none\"', bring maps of your own with depth.prior = \"folder\", or import measured depth with --depth";
    let place = || format!("keyframe {index}, depth prior from ground truth");
    let depth = light.depth_m.as_ref().ok_or_else(|| Error::invalid(place(), "the keyframe carries no depth", help))?;
    if !has_depth(depth) {
        return Err(Error::invalid(place(), "no pixel has a positive, finite depth", help));
    }
    Ok(depth)
}

/// The size at which the network sees an image.
fn network_size((w, h): (usize, usize)) -> (usize, usize) {
    let shorter = w.min(h);
    if shorter <= NETWORK_SIDE_PX {
        return (w, h);
    }
    let reduced = |side: usize| (side * NETWORK_SIDE_PX + shorter / 2) / shorter;
    (reduced(w), reduced(h))
}

/// A sum of plane waves over an image, of unit variance.
struct SmoothField {
    /// Per mode: along and down the image, radians a pixel; amplitudes of cosine and sine.
    modes: Vec<([f64; 2], [f64; 2])>,
    /// Per mode: cosines, then sines, of its phase along a row.
    columns: Vec<f64>,
    width: usize,
}

impl SmoothField {
    /// `waves` in radians per image width.
    fn new(waves: &[[f64; 2]], amplitudes: &[[f64; 2]], width: usize) -> Self {
        let unit = 1.0 / (waves.len() as f64).sqrt();
        let modes: Vec<_> =
            waves.iter().zip(amplitudes).map(|(k, a)| (k.map(|v| v / width as f64), a.map(|v| v * unit))).collect();
        let along = |f: fn(f64) -> f64, k: f64| (0..width).map(move |x| f(k * x as f64));
        let columns = modes.iter().flat_map(|(k, _)| along(f64::cos, k[0]).chain(along(f64::sin, k[0]))).collect();
        Self { modes, columns, width }
    }

    /// Row `y`.
    fn row(&self, y: usize, out: &mut [f64]) {
        out.fill(0.0);
        for ((k, a), columns) in self.modes.iter().zip(self.columns.chunks_exact(2 * self.width)) {
            // a₀ cos(k·u) + a₁ sin(k·u) by the addition theorems.
            let (sin, cos) = (k[1] * y as f64).sin_cos();
            let (with_cos, with_sin) = (a[0] * cos + a[1] * sin, a[1] * cos - a[0] * sin);
            let (cosines, sines) = columns.split_at(self.width);
            for ((value, c), s) in out.iter_mut().zip(cosines).zip(sines) {
                *value += with_cos * c + with_sin * s;
            }
        }
    }
}

/// A separable Gaussian, truncated at 3 σ, edges repeated.
fn blur(values: &[f64], w: usize, h: usize, sigma_px: f64) -> Vec<f64> {
    let radius = (3.0 * sigma_px).ceil() as usize;
    let weights: Vec<f64> = (0..=2 * radius).map(|k| (-0.5 * ((k as f64 - radius as f64) / sigma_px).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    let weights: Vec<f64> = weights.iter().map(|v| v / total).collect();
    let mut down = vec![0.0; w * h];
    down.par_chunks_mut(w).enumerate().for_each(|(y, row)| {
        for (k, weight) in weights.iter().enumerate() {
            let from = (y + k).saturating_sub(radius).min(h - 1) * w;
            row.iter_mut().zip(&values[from..from + w]).for_each(|(sum, v)| *sum += weight * v);
        }
    });
    let mut out = vec![0.0; w * h];
    out.par_chunks_mut(w).zip(down.par_chunks(w)).for_each(|(row, source)| {
        let mut padded = vec![source[0]; radius];
        padded.extend(source);
        padded.extend(std::iter::repeat_n(source[w - 1], radius));
        for (k, weight) in weights.iter().enumerate() {
            row.iter_mut().zip(&padded[k..k + w]).for_each(|(sum, v)| *sum += weight * v);
        }
    });
    out
}
