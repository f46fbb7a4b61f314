//! Importance sampling of the directions in which photons leave the transmitter.
//!
//! Light that mirrors and slabs alone sent on keeps the evenness of the directions it left in, and its noise is made where few of them
//! reach: by way of small facets, in places that nothing else lights. A pilot tells how much every direction's photons disturb what they
//! fall on; the density that makes the sum of variances least is proportional to the root of their mean square.

use crate::radio::lattice;
use corf_scene::Rng;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::PI;

/// Bins along the side of the sphere's octahedral map: 1.6° wide.
const BINS: usize = 128;
/// Least density of photons in a bin, as a share of the uniform density.
const LEAST: f64 = 0.2;
/// Largest density of photons in a bin, in multiples of the uniform density.
const MOST: f64 = 30.0;

/// The directions of a number of photons.
pub enum Emission {
    /// Evenly over the sphere.
    Even {
        /// Photons.
        count: usize,
        /// Turns their lattice.
        world_from_lattice: DMat3,
    },
    /// Directions by bins of different density.
    Guided {
        /// Number of a bin's first photon, by bin; the last entry is that of all photons.
        first: Vec<usize>,
        /// Origin of a bin's lattice, in [0, 1)², by bin.
        shift: Vec<DVec2>,
    },
}

impl Emission {
    /// Importance sampling of at most about `count` photons from a pilot's pairs of direction and squared disturbance.
    pub fn learn(count: usize, pilot: &[(DVec3, f64)], seed: u64, stage: u64) -> Self {
        let mut sums = vec![(0.0f64, 0.0f64); BINS * BINS];
        for (direction, square) in pilot {
            let (sum, n) = &mut sums[lattice::octahedral(*direction, BINS)];
            *sum += square;
            *n += 1.0;
        }
        let mean = pilot.iter().map(|p| p.1).sum::<f64>() / pilot.len().max(1) as f64;
        // Every bin starts with one photon of the mean.
        let density: Vec<f64> = sums.iter().map(|(sum, n)| ((sum + mean) / (n + 1.0)).sqrt()).collect();
        let solid: Vec<f64> = (0..BINS * BINS).map(solid_angle_sr).collect();
        let whole: f64 = density.iter().zip(&solid).map(|(d, s)| d * s).sum();
        let mut first = vec![0];
        let mut shift = Vec::with_capacity(BINS * BINS);
        let mut next = 0;
        for (bin, (d, s)) in density.iter().zip(&solid).enumerate() {
            let even = count as f64 * s / (4.0 * PI);
            let wanted = if whole > 0.0 { count as f64 * d * s / whole } else { even };
            next += (wanted.clamp(LEAST * even, MOST * even).ceil() as usize).max(1);
            first.push(next);
            let mut rng = Rng::keyed(seed, stage, bin as u64);
            shift.push(DVec2::new(rng.uniform_f64(), rng.uniform_f64()));
        }
        Self::Guided { first, shift }
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        match self {
            Self::Even { count, .. } => *count,
            Self::Guided { first, .. } => first.last().copied().unwrap_or(0),
        }
    }

    /// Unit direction of photon `i`, and the solid angle it stands for, steradians.
    pub fn photon(&self, i: usize) -> (DVec3, f64) {
        match self {
            Self::Even { count, world_from_lattice } => {
                (*world_from_lattice * lattice::fibonacci(i, *count), 4.0 * PI / *count as f64)
            }
            Self::Guided { first, shift } => {
                let bin = first.partition_point(|&f| f <= i) - 1;
                let (number, count) = (i - first[bin], first[bin + 1] - first[bin]);
                let at = (shift[bin] + lattice::R2 * number as f64).fract();
                let (direction, density) = unfolded(bin, at);
                (direction, density / count as f64)
            }
        }
    }
}

/// Unit direction at a place in [0, 1)² of a bin, and the steradians that the whole bin would have at that place's scale.
fn unfolded(bin: usize, at: DVec2) -> (DVec3, f64) {
    let p = (DVec2::new((bin % BINS) as f64, (bin / BINS) as f64) + at) * (2.0 / BINS as f64) - 1.0;
    let z = 1.0 - p.x.abs() - p.y.abs();
    let (x, y) = if z >= 0.0 { (p.x, p.y) } else { ((1.0 - p.y.abs()).copysign(p.x), (1.0 - p.x.abs()).copysign(p.y)) };
    let d = DVec3::new(x, y, z);
    // The octahedron's faces are 1/√3 from its centre and √3 times as large as their shadows: dΩ = dx dy / |d|³.
    let bin_area = (2.0 / BINS as f64).powi(2);
    (d.normalize(), bin_area / d.length().powi(3))
}

fn solid_angle_sr(bin: usize) -> f64 {
    unfolded(bin, DVec2::splat(0.5)).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guided_photons_stand_for_the_sphere_whatever_the_density() {
        let count = 200_000;
        let pilot: Vec<(DVec3, f64)> =
            (0..count).map(|i| lattice::fibonacci(i, count)).map(|d| (d, if d.x > 0.9 { 100.0 } else { 1.0 })).collect();
        let emission = Emission::learn(count, &pilot, 3, 1);
        let (mut whole, mut moment, mut square, mut ahead) = (0.0, DVec3::ZERO, DVec3::ZERO, 0);
        for i in 0..emission.len() {
            let (d, sr) = emission.photon(i);
            assert!((d.length() - 1.0).abs() < 1e-12);
            whole += sr;
            moment += d * sr;
            square += d * d * sr;
            ahead += usize::from(d.x > 0.9);
        }
        assert!((whole / (4.0 * PI) - 1.0).abs() < 1e-3, "{whole}");
        assert!(moment.length() < 0.01, "{moment}");
        assert!((square * 3.0 / (4.0 * PI) - 1.0).length() < 2e-3, "{square}");
        // A twentieth of the sphere at ten times the density: a third of all.
        let share = ahead as f64 / emission.len() as f64;
        assert!((0.28..0.4).contains(&share), "{share}");
    }
}
