//! Quadratic forms of steering vectors, vᴴQv, as short Fourier sums.

use crate::radio::{Complex, PlanarArray};
use glam::DVec3;
use rayon::prelude::*;

/// u ↦ v(u)ᴴ Q v(u) for a Hermitian Q and the steering vectors v_m(u) = exp(j2π p_m·u) of a planar array.
///
/// On a uniform grid of elements the phase of every term Q_mn depends on the lag p_n − p_m alone, so Q condenses into (2C−1)×(2R−1)
/// sums over its pairs of equal lag; nothing is approximated, and the cost of a direction does not depend on what Q was made of.
#[derive(Clone, Debug)]
pub(super) struct LagForm {
    array: PlanarArray,
    /// Lags l_y ∈ [0, C) × l_z ∈ (−R, R); the half with l_y < 0 is the conjugate, and counted in.
    lags: Vec<Complex>,
}

/// Plane waves a task condenses; fixed, so that sums come out the same for any thread count.
const WAVES_PER_TASK: usize = 2048;

impl LagForm {
    /// Q = Σ p·v(u)v(u)ᴴ over plane waves from the unit directions u of the array frame with the powers p.
    pub fn of_waves(array: PlanarArray, waves: &[(DVec3, f64)]) -> Self {
        let (columns, rows) = (array.columns, array.rows);
        let width = 2 * rows - 1;
        let partial: Vec<Vec<Complex>> = waves
            .par_chunks(WAVES_PER_TASK)
            .map(|chunk| {
                let mut sums = vec![Complex::ZERO; columns * width];
                for &(u, power) in chunk {
                    let [y, z] = array.phase_steps(u);
                    // Σ p·e^{−j(l_y·y + l_z·z)}
                    let step_z = Complex::new(z.cos(), -z.sin());
                    let start_z = Complex::new(0.0, z * (rows as f64 - 1.0)).exp();
                    for ly in 0..columns {
                        let mut term = Complex::new(0.0, -(ly as f64) * y).exp() * start_z * power;
                        for sum in &mut sums[ly * width..(ly + 1) * width] {
                            *sum = *sum + term;
                            term = term * step_z;
                        }
                    }
                }
                sums
            })
            .collect();
        let mut lags = vec![Complex::ZERO; columns * width];
        for sums in &partial {
            lags.iter_mut().zip(sums).for_each(|(lag, sum)| *lag = *lag + *sum);
        }
        for (i, lag) in lags.iter_mut().enumerate() {
            let (ly, lz) = (i / width, (i % width) as f64 - (rows as f64 - 1.0));
            let pairs = (columns - ly) as f64 * (rows as f64 - lz.abs());
            *lag = *lag * (pairs * if ly > 0 { 2.0 } else { 1.0 });
        }
        Self { array, lags }
    }

    /// Q itself, N×N by rows, in the array's order of elements.
    pub fn of_matrix(array: PlanarArray, q: &[Complex]) -> Self {
        let (columns, rows, n) = (array.columns, array.rows, array.elements());
        let width = 2 * rows - 1;
        let mut lags = vec![Complex::ZERO; columns * width];
        for i in 0..n {
            let (column, row) = (i / rows, i % rows);
            for j in 0..n {
                let (other_column, other_row) = (j / rows, j % rows);
                if other_column < column {
                    continue;
                }
                // Rows run downwards.
                let (ly, lz) = (other_column - column, row + rows - 1 - other_row);
                let lag = &mut lags[ly * width + lz];
                *lag = *lag + q[i * n + j] * if ly > 0 { 2.0 } else { 1.0 };
            }
        }
        Self { array, lags }
    }

    /// The value at a unit direction of the array frame; real, because Q is Hermitian.
    pub fn value(&self, direction: DVec3) -> f64 {
        let (columns, rows) = (self.array.columns, self.array.rows);
        let width = 2 * rows - 1;
        let [y, z] = self.array.phase_steps(direction);
        let step_z = Complex::new(z.cos(), z.sin());
        let start_z = Complex::new(0.0, -z * (rows as f64 - 1.0)).exp();
        let mut sum = 0.0;
        for ly in 0..columns {
            let mut term = Complex::new(0.0, ly as f64 * y).exp() * start_z;
            for lag in &self.lags[ly * width..(ly + 1) * width] {
                // The real part of lag·e^{+j(l_y·y + l_z·z)}.
                sum += lag.re * term.re - lag.im * term.im;
                term = term * step_z;
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn any_hermitian_form_is_its_sum_over_lags() {
        let array = PlanarArray { rows: 3, columns: 4, spacing_wavelengths: [0.6, 0.45] };
        let n = array.elements();
        let mut rng = Rng::keyed(5, 0, 0);
        let mut q = vec![Complex::ZERO; n * n];
        for i in 0..n {
            q[i * n + i] = Complex::real(rng.normal());
            for j in 0..i {
                q[i * n + j] = Complex::new(rng.normal(), rng.normal());
                q[j * n + i] = Complex::new(q[i * n + j].re, -q[i * n + j].im);
            }
        }
        let form = LagForm::of_matrix(array, &q);
        for u in [DVec3::X, DVec3::new(0.3, -0.8, 0.5).normalize(), DVec3::new(-0.4, 0.1, -0.9).normalize()] {
            let v = array.steering(u);
            let mut sum = Complex::ZERO;
            for i in 0..n {
                for j in 0..n {
                    sum = sum + Complex::new(v[i].re, -v[i].im) * q[i * n + j] * v[j];
                }
            }
            assert!((form.value(u) - sum.re).abs() < 1e-11 && sum.im.abs() < 1e-11, "{u}: {} {sum:?}", form.value(u));
        }
    }
}
