//! Array snapshots: the complex signals received by the elements of an array, one vector for each delay tap.

use super::hermitian::Hermitian;
use crate::radio::{Arrival, Complex, PlanarArray, over_mean_gain};
use corf_scene::Rng;
use corf_scene::config::{Elements, RearHalfSpace};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Stream of the phases of diffuse arrivals.
const STAGE_PHASE: u64 = 0x7370_6563_6b6c_6500;
/// Arrivals a task adds up; fixed, so that sums come out the same for any thread count.
const ARRIVALS_PER_TASK: usize = 2048;

/// An array among its arrivals.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aperture {
    pub array: PlanarArray,
    pub world_from_array: DMat3,
    pub rear: RearHalfSpace,
    /// Where each element has a response of its own.
    pub elements: Option<Elements>,
}

impl Aperture {
    /// The direction in the array's frame of an arrival that the array is let see.
    pub fn seen(&self, arrival: &Arrival) -> Option<DVec3> {
        let u = self.world_from_array.transpose() * arrival.direction;
        (self.rear == RearHalfSpace::Aliased || u.x > 0.0).then_some(u)
    }

    /// R = Σ_l x_l x_lᴴ over the taps of every look.
    pub fn covariance(&self, port_pairs: &[Vec<Arrival>], bandwidth_hz: f64, seed: u64) -> Hermitian {
        let snapshots: Vec<Vec<Complex>> = port_pairs.iter().flat_map(|look| self.snapshots(look, bandwidth_hz, seed)).collect();
        Hermitian::sum_of_products(self.array.elements(), &snapshots)
    }

    /// R = Σ |a|²·x xᴴ with x = h(u)∘v(u), wave by wave: the mean over the arrivals' phases.
    pub fn mean_covariance(&self, arrivals: &[Arrival]) -> Hermitian {
        let n = self.array.elements();
        arrivals
            .par_chunks(ARRIVALS_PER_TASK)
            .map(|chunk| {
                let seen = chunk.iter().filter_map(|a| Some((0, self.seen(a)?, Complex::real(a.power.sqrt()))));
                let vectors: Vec<Vec<Complex>> = seen.map(|wave| self.field(&[wave])).collect();
                Hermitian::sum_of_products(n, &vectors)
            })
            .collect::<Vec<_>>()
            .into_iter()
            .fold(Hermitian::sum_of_products(n, &[]), Hermitian::plus)
    }

    /// x_l = Σ a·e^{−j2πfτ}·v(u) over the arrivals nearest to delay l/B: one vector a tap that receives anything, by delay. An arrival
    /// without a phase is given one that the seed and its own bits draw, so that it keeps it in any list and at any thread count.
    fn snapshots(&self, arrivals: &[Arrival], bandwidth_hz: f64, seed: u64) -> Vec<Vec<Complex>> {
        let mut waves: Vec<(i64, DVec3, Complex)> = arrivals
            .par_iter()
            .filter_map(|arrival| {
                let u = self.seen(arrival)?;
                let phase_rad = arrival.phase_rad.unwrap_or_else(|| random_phase_rad(arrival, seed));
                let gain = Complex::new(0.0, phase_rad).exp() * arrival.power.sqrt();
                Some(((arrival.delay_s * bandwidth_hz).round() as i64, u, gain))
            })
            .collect();
        // Stable: within a tap the order of the list stays.
        waves.sort_by_key(|wave| wave.0);
        let taps: Vec<&[(i64, DVec3, Complex)]> = waves.chunk_by(|a, b| a.0 == b.0).collect();
        taps.into_par_iter()
            .map(|tap| {
                let partial: Vec<Vec<Complex>> = tap.par_chunks(ARRIVALS_PER_TASK).map(|chunk| self.field(chunk)).collect();
                partial.into_iter().fold(vec![Complex::ZERO; self.array.elements()], |mut sum, part| {
                    sum.iter_mut().zip(part).for_each(|(s, p)| *s = *s + p);
                    sum
                })
            })
            .collect()
    }

    /// Σ gain·h(u)∘v(u), element by element; h is 1 where elements are alike.
    fn field(&self, waves: &[(i64, DVec3, Complex)]) -> Vec<Complex> {
        let (columns, rows) = (self.array.columns, self.array.rows);
        let mut x = vec![Complex::ZERO; columns * rows];
        let mut responses = vec![Complex::ONE; x.len()];
        for &(_, u, gain) in waves {
            if let Some(elements) = self.elements {
                over_mean_gain(elements, u, |m, response| responses[m] = response);
            }
            let [y, z] = self.array.phase_steps(u);
            // The first element is the left-most and highest in index order: y = −(C−1)/2, z = +(R−1)/2.
            let first = 0.5 * ((rows as f64 - 1.0) * z - (columns as f64 - 1.0) * y);
            let (step_y, step_z) = (Complex::new(0.0, y).exp(), Complex::new(0.0, -z).exp());
            let mut column = gain * Complex::new(0.0, first).exp();
            for (elements, responses) in x.chunks_mut(rows).zip(responses.chunks(rows)) {
                let mut term = column;
                for (element, response) in elements.iter_mut().zip(responses) {
                    *element = *element + if self.elements.is_some() { term * *response } else { term };
                    term = term * step_z;
                }
                column = column * step_y;
            }
        }
        x
    }
}

/// Uniform in [0, 2π), keyed by the arrival itself.
fn random_phase_rad(arrival: &Arrival, seed: u64) -> f64 {
    let d = arrival.direction;
    let key = [d.x, d.y, d.z, arrival.delay_s, arrival.power]
        .iter()
        .fold(0, |key, v| Rng::keyed(key, STAGE_PHASE, v.to_bits()).next_u64());
    std::f64::consts::TAU * Rng::keyed(seed, STAGE_PHASE, key).uniform_f64()
}
