//! Choosing a beam by a predicted spectrum: what the choice loses against the best beam of a codebook.
//!
//! The codebook is that of the 8 × 8 half-wavelength array: the 64 vectors of a discrete Fourier transform, shifted by half a step so that they
//! lie evenly over the front half-space and none points along the array. Beam (p, q) has the sines `u_y = (2p + 1)/8 − 1` and
//! `u_z = (2q + 1)/8 − 1`, p and q from 0 to 7, in the array's frame (boresight x, y to the left, z up), and towards a direction u the power gain
//!
//! ```text
//! g_pq(u) = |w_pqᴴ v(u)|² / 64² = F(u_y − u_y,p) · F(u_z − u_z,q),      F(d) = (sin(4πd) / (8 sin(πd/2)))²
//! ```
//!
//! which is 1 in the middle of the beam. The 12 beams with `u_y² + u_z² > 1` have their middle at no real direction; they stay in, as they do
//! in an array that uses the transform.

use super::rate::spectral_efficiency_bps_hz;
use corf_scene::dataset::Quantity;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Pinhole, Raster};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Elements along each side of the array, and beams along each axis.
pub const SIDE: usize = 8;
/// Elements of the array, and beams of the codebook.
pub const ELEMENTS: usize = SIDE * SIDE;

/// What choosing the beam by a prediction costs, for one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BeamMetrics {
    /// `10·log10(max_b P_b / P_b̂)`: observed power of the truly best beam over that of the beam the prediction chooses, dB.
    pub codebook_loss_db: f64,
    /// Whether the chosen beam is a best one: 1 or 0.
    pub beam_top1: f64,
    /// Whether a best beam is among the three that are strongest in the prediction: 1 or 0.
    pub beam_top3: f64,
    /// Spectral efficiency of the best beam minus that of the chosen one, bit/s/Hz.
    pub rate_loss_bps_hz: f64,
    /// The same in per cent of the best beam's.
    pub rate_loss_percent: f64,
}

/// The beams of the codebook as an image of a spectrum shows them.
#[derive(Clone, Debug)]
pub enum Codebook {
    /// Power per steradian: a beam's power is the integral of the spectrum over the image, weighted with the beam's gain.
    Integrated(Pinhole),
    /// Beam power: the image's value at the beam's own direction is the beam's power. Beams that point out of the image are left out.
    Sampled(Vec<SampledBeam>),
}

/// A beam that points into the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledBeam {
    /// Its number in the codebook, 8p + q.
    pub number: usize,
    /// Image position, pixels.
    pub at: [f64; 2],
}

/// Sine of the direction of beam `k` along an axis.
fn sine(k: usize) -> f64 {
    (2 * k + 1) as f64 / SIDE as f64 - 1.0
}

/// Power gain along one axis, `d` sines off the beam's middle.
fn axis_gain(d: f64) -> f64 {
    let half_step = 0.5 * PI * d;
    let below = SIDE as f64 * half_step.sin();
    // In the middle of the beam both vanish, and their ratio is 1.
    if below.abs() < 1e-9 { 1.0 } else { ((SIDE as f64 * half_step).sin() / below).powi(2) }
}

/// Power gains of the codebook's beams towards a direction in the array's frame, along y and along z: a beam's is the product of two.
pub fn axis_gains(u: DVec3) -> [[f64; SIDE]; 2] {
    [u.y, u.z].map(|sine_of_direction| std::array::from_fn(|k| axis_gain(sine_of_direction - sine(k))))
}

impl Codebook {
    /// The codebook over the pixels of `camera`; `None` where a value of the spectrum is no power of beams ([`Quantity::CaponPower`],
    /// [`Quantity::Unknown`]), or the image shows no beam.
    pub fn of(camera: Pinhole, quantity: Quantity) -> Option<Self> {
        match quantity {
            Quantity::PowerPerSteradian => Some(Self::Integrated(camera)),
            Quantity::BeamPower => {
                let beams = beams_in(&camera);
                (!beams.is_empty()).then_some(Self::Sampled(beams))
            }
            Quantity::CaponPower | Quantity::Unknown => None,
        }
    }

    /// The power of every beam, for a spectrum of linear power.
    pub fn powers(&self, spectrum: &Raster<f64>) -> Vec<f64> {
        match self {
            Self::Integrated(camera) => integrated(camera, spectrum),
            Self::Sampled(beams) => beams.iter().map(|beam| interpolated(spectrum, beam.at)).collect(),
        }
    }

    /// The number 8p + q of the beam whose power is at this place among [`Self::powers`].
    pub fn number(&self, place: usize) -> usize {
        match self {
            Self::Integrated(_) => place,
            Self::Sampled(beams) => beams[place].number,
        }
    }
}

/// The beams that point into the image.
fn beams_in(camera: &Pinhole) -> Vec<SampledBeam> {
    let camera_from_array = ARRAY_FROM_CAMERA.inverse();
    let beam = |number: usize| {
        let (y, z) = (sine(number / SIDE), sine(number % SIDE));
        let ahead = 1.0 - y * y - z * z;
        let direction = (ahead > 0.0).then(|| camera_from_array.transform_vector(DVec3::new(ahead.sqrt(), y, z)))?;
        let at = camera.project(direction)?;
        let inside = (0.0..=camera.width as f64).contains(&at.x) && (0.0..=camera.height as f64).contains(&at.y);
        inside.then_some(SampledBeam { number, at: [at.x, at.y] })
    };
    (0..ELEMENTS).filter_map(beam).collect()
}

/// `P_pq = Σ S·Ω·g_pq` over the pixels.
fn integrated(camera: &Pinhole, spectrum: &Raster<f64>) -> Vec<f64> {
    let mut powers = vec![0.0; ELEMENTS];
    for y in 0..camera.height {
        for x in 0..camera.width {
            let power = spectrum[(x, y)] * camera.pixel_solid_angle_sr(x, y);
            if power <= 0.0 {
                continue;
            }
            let u = ARRAY_FROM_CAMERA.transform_vector(camera.pixel_direction(x, y));
            let [across, along] = axis_gains(u);
            for (row, across) in powers.chunks_exact_mut(SIDE).zip(across) {
                row.iter_mut().zip(along).for_each(|(sum, along)| *sum += power * across * along);
            }
        }
    }
    powers
}

/// Bilinear between pixel centres, constant beyond the outermost.
fn interpolated(spectrum: &Raster<f64>, [u, v]: [f64; 2]) -> f64 {
    let axis = |at: f64, count: usize| {
        let at = (at - 0.5).clamp(0.0, (count - 1) as f64);
        let low = at.floor() as usize;
        (low, (low + 1).min(count - 1), at - low as f64)
    };
    let (x0, x1, s) = axis(u, spectrum.width());
    let (y0, y1, t) = axis(v, spectrum.height());
    let row = |y: usize| (1.0 - s) * spectrum[(x0, y)] + s * spectrum[(x1, y)];
    (1.0 - t) * row(y0) + t * row(y1)
}

/// The beams, by their places, from the strongest predicted one on. Beams that the prediction holds for equally strong are ordered against it, the
/// weakest observed one first: a prediction without power chooses the worst beam.
fn ranked(predicted: &[f64], observed: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..predicted.len()).collect();
    order.sort_by(|&a, &b| predicted[b].total_cmp(&predicted[a]).then(observed[a].total_cmp(&observed[b])));
    order
}

/// Places of the best beam as observed and of the one that the prediction chooses, of which there is one at least. Of several best ones it is the
/// chosen one, if that is among them, and the first otherwise.
pub fn best_and_chosen(predicted: &[f64], observed: &[f64]) -> [usize; 2] {
    let chosen = ranked(predicted, observed)[0];
    let best = (0..observed.len()).fold(chosen, |best, i| if observed[i] > observed[best] { i } else { best });
    [best, chosen]
}

/// What choosing by `predicted` beam powers loses where the `observed` ones are true; losses in dB end at `limit_db`.
///
/// Equally strong beams are ordered against the prediction. Where nothing is observed every beam is a best one and nothing is lost.
pub fn compare(predicted: &[f64], observed: &[f64], limit_db: f64) -> BeamMetrics {
    let order = ranked(predicted, observed);
    let best = observed.iter().copied().fold(0.0, f64::max);
    let chosen = order.first().map_or(0.0, |beam| observed[*beam]);
    let hit = |among: usize| f64::from(u8::from(order.iter().take(among).any(|beam| observed[*beam] >= best)));
    let (most, got) = (spectral_efficiency_bps_hz(best, ELEMENTS), spectral_efficiency_bps_hz(chosen, ELEMENTS));
    BeamMetrics {
        codebook_loss_db: if chosen >= best { 0.0 } else { (10.0 * (best / chosen).log10()).min(limit_db) },
        beam_top1: hit(1),
        beam_top3: hit(3),
        rate_loss_bps_hz: most - got,
        rate_loss_percent: if most > 0.0 { 100.0 * (most - got) / most } else { 0.0 },
    }
}

#[cfg(test)]
mod tests;
