//! Dense, affine-invariant inverse depth: where it comes from.

use crate::{
    Error, Result,
    config::{DepthConfig, DepthPriorKind, PriorPreset},
    stage,
};
use corf_scene::{Keyframe, Raster, Rng};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// A source of dense inverse depth, known up to scale and offset.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum DepthPrior {
    /// The ray tracer's depth with a monocular network's error model. **Consumes ground-truth depth.**
    Simulated(SimulatedPrior),
    /// No dense prior.
    None,
}

impl DepthPrior {
    /// The prior a configuration asks for.
    pub fn new(config: &DepthConfig, seed: u64) -> Self {
        match config.prior {
            DepthPriorKind::Simulated => Self::Simulated(SimulatedPrior::new(config.preset, seed)),
            DepthPriorKind::None => Self::None,
        }
    }

    /// The dense prior of a keyframe, of its image's size; `None` from [`Self::None`].
    ///
    /// # Errors
    /// The simulated prior on a keyframe without depth.
    pub fn estimate(&mut self, keyframe: &Keyframe) -> Result<Option<Raster<f32>>> {
        match self {
            Self::Simulated(prior) => prior.estimate(keyframe).map(Some),
            Self::None => Ok(None),
        }
    }

    /// Refuses a keyframe that [`Self::estimate`] could not use.
    ///
    /// # Errors
    /// As [`Self::estimate`].
    pub fn check(&self, keyframe: &Keyframe) -> Result<()> {
        match self {
            Self::Simulated(_) => SimulatedPrior::depth_of(keyframe).map(|_| ()),
            Self::None => Ok(()),
        }
    }

    /// Whether results made with this prior must say that they used ground-truth depth.
    pub fn consumes_ground_truth_depth(&self) -> bool {
        matches!(self, Self::Simulated(_))
    }
}

/// Fourier modes of the smooth random field.
const MODES: u64 = 24;
/// Correlation of the smooth random field from one frame of the trajectory to the next.
const FRAME_CORRELATION: f64 = 0.8;
/// Blur of the network's output, pixels of an image whose shorter side is [`NETWORK_SIDE_PX`].
const BLUR_PX: f64 = 1.5;
/// Input size of the network that is imitated, pixels.
const NETWORK_SIDE_PX: f64 = 518.0;
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
    /// The field's mode amplitudes (cosine, sine) as of trajectory frame `.0`.
    field: Option<(usize, Vec<[f64; 2]>)>,
}

impl SimulatedPrior {
    /// The error model of a preset.
    pub fn new(preset: PriorPreset, seed: u64) -> Self {
        let (gamma, lambda, kappa) = match preset {
            PriorPreset::Mild => (0.03, 0.025, 0.04),
            PriorPreset::Default => (0.06, 0.05, 0.04),
            PriorPreset::Hard => (0.08, 0.06, 0.08),
        };
        Self { seed, gamma, lambda, kappa, field: None }
    }

    /// The depth of a keyframe that has one.
    fn depth_of(keyframe: &Keyframe) -> Result<&Raster<f32>> {
        let help = "generate the dataset with depth, or set depth.prior = \"none\"";
        let place = || format!("keyframe {}, simulated depth prior", keyframe.index);
        let depth = keyframe.depth_m.as_ref().ok_or_else(|| Error::invalid(place(), "the keyframe carries no depth", help))?;
        if !depth.pixels().iter().any(|z| *z > 0.0 && z.is_finite()) {
            return Err(Error::invalid(place(), "no pixel has a positive, finite depth", help));
        }
        Ok(depth)
    }

    /// The affine-invariant inverse depth this network would have given.
    ///
    /// # Errors
    /// A keyframe without depth, or with no finite depth at all.
    pub fn estimate(&mut self, keyframe: &Keyframe) -> Result<Raster<f32>> {
        let depth = Self::depth_of(keyframe)?;
        let (w, h) = (depth.width(), depth.height());
        let inverse = depth.map(|&z| if z > 0.0 && z.is_finite() { 1.0 / f64::from(z) } else { 0.0 });
        let mut hit: Vec<f64> = inverse.pixels().iter().copied().filter(|&d| d > 0.0).collect();
        let middle = hit.len() / 2;
        let median = *hit.select_nth_unstable_by(middle, f64::total_cmp).1;

        let frame = keyframe.index as u64;
        let mut rng = Rng::keyed(self.seed, stage::PRIOR_FRAME, frame);
        let exponent = 1.0 + self.gamma * rng.normal();
        let (scale, offset) = (3.0 * (0.2 * rng.normal()).exp(), 0.3 * rng.normal());
        let waves = self.waves();
        let amplitudes = self.amplitudes(keyframe.index);
        let bias = |surface: u32| self.kappa * Rng::keyed(self.seed, stage::PRIOR_OBJECT, u64::from(surface)).normal();
        // Neighbours are mostly of one surface.
        let mut biases = BTreeMap::new();
        for run in keyframe.surface.iter().flat_map(|s| s.pixels().chunk_by(|a, b| a == b)) {
            biases.entry(run[0]).or_insert_with(|| bias(run[0]));
        }

        let table = |n: usize, axis: usize| -> Vec<(f64, f64)> {
            (0..n).flat_map(|i| waves.iter().map(move |k| (k[axis] * i as f64 / w as f64).sin_cos())).collect()
        };
        let (columns, rows) = (table(w, 0), table(h, 1));
        let distort = |i: usize| {
            let (column, row) = (&columns[(i % w) * waves.len()..], &rows[(i / w) * waves.len()..]);
            // a₀ cos(k·u) + a₁ sin(k·u) by the addition theorems, from one table per axis.
            let mode = |(k, a): (usize, &[f64; 2])| {
                let ((sx, cx), (sy, cy)) = (column[k], row[k]);
                a[0] * (cx * cy - sx * sy) + a[1] * (sx * cy + cx * sy)
            };
            let smooth: f64 = amplitudes.iter().enumerate().map(mode).sum::<f64>() / (MODES as f64).sqrt();
            let object = keyframe.surface.as_ref().map_or(0.0, |s| biases[&s.pixels()[i]]);
            (inverse.pixels()[i] / median).powf(exponent) * (self.lambda * smooth + object).exp()
        };
        let distorted: Vec<f64> = (0..w * h).into_par_iter().with_min_len(w).map(distort).collect();
        let sigma_px = BLUR_PX * w.min(h) as f64 / NETWORK_SIDE_PX;
        let blurred = blur(&distorted, w, h, sigma_px);
        let noise_stage = stage::keyed(stage::PRIOR_NOISE, keyframe.index);
        let noisy = |(i, d): (usize, &f64)| {
            let n = NOISE * Rng::keyed(self.seed, noise_stage, i as u64).normal();
            (scale * (d + n) + offset) as f32
        };
        Ok(Raster::from_vec(w, h, blurred.par_iter().enumerate().with_min_len(w).map(noisy).collect()))
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
    fn amplitudes(&mut self, frame: usize) -> Vec<[f64; 2]> {
        let innovation = |at: usize, k: u64| {
            let mut rng = Rng::keyed(self.seed, stage::keyed(stage::PRIOR_FIELD, at), k);
            [rng.normal(), rng.normal()]
        };
        let (mut at, mut amplitudes) = match self.field.take() {
            Some((at, amplitudes)) if at <= frame => (at, amplitudes),
            _ => (0, (0..MODES).map(|k| innovation(0, k)).collect()),
        };
        let fresh = (1.0 - FRAME_CORRELATION * FRAME_CORRELATION).sqrt();
        while at < frame {
            at += 1;
            for (k, a) in amplitudes.iter_mut().enumerate() {
                let e = innovation(at, k as u64);
                *a = [FRAME_CORRELATION * a[0] + fresh * e[0], FRAME_CORRELATION * a[1] + fresh * e[1]];
            }
        }
        self.field = Some((at, amplitudes.clone()));
        amplitudes
    }
}

/// A separable Gaussian, truncated at 3 σ, edges repeated.
fn blur(values: &[f64], w: usize, h: usize, sigma_px: f64) -> Vec<f64> {
    let radius = (3.0 * sigma_px).ceil() as isize;
    let weights: Vec<f64> = (-radius..=radius).map(|k| (-0.5 * (k as f64 / sigma_px).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    let pass = |source: &[f64], along_x: bool| -> Vec<f64> {
        (0..w * h)
            .into_par_iter()
            .with_min_len(w)
            .map(|i| {
                let (x, y) = ((i % w) as isize, (i / w) as isize);
                let sum: f64 = weights
                    .iter()
                    .enumerate()
                    .map(|(k, weight)| {
                        let d = k as isize - radius;
                        let (xs, ys) = if along_x { (x + d, y) } else { (x, y + d) };
                        weight * source[ys.clamp(0, h as isize - 1) as usize * w + xs.clamp(0, w as isize - 1) as usize]
                    })
                    .sum();
                sum / total
            })
            .collect()
    };
    pass(&pass(values, true), false)
}
