//! Capon's (minimum variance) spectra of a planar array over the pixels of a pinhole camera, and their gradients.
//!
//! The spectrum of waves of the powers p_j is P(u) = 1 / (v(u)ᴴR⁻¹v(u)) with R = Σ_j p_j·v_j v_jᴴ + ε·Σ_j p_j·I: what `mvdr` means where no two
//! arrivals are coherent. R is the same for elements that lie point-symmetrically as for the real steering vectors b = cas φ = cos φ + sin φ of the
//! phases φ relative to the array's centre, which are those of v turned by a unitary matrix (so that R becomes real, as Lee 1980 has it): b_m b_n =
//! cos(φ_m − φ_n) + sin(φ_m + φ_n), where both angles are lags on the grid of elements. Covariances and quadratic forms are therefore tables of
//! [`ArrayBeam`], and a wave costs what it costs there; what is added is the inverse of an N×N matrix.
//!
//! P is homogeneous of degree one in the powers, so that Σ_j p_j·∂P/∂p_j = P: what a wave accounts for in a pixel is its power times the derivative.
//! Everything is in double precision: forms of R⁻¹ cancel to ε/N of its entries.

use super::beam::ArrayBeam;
use super::symmetric::SymmetricMatrix;
use super::wave::Wave;
use crate::Real;

/// An array among waves, looked at with Capon's beamformer.
#[derive(Clone, Debug)]
pub struct Capon {
    beam: ArrayBeam<f64>,
    /// ε, in units of the power of all waves.
    loading: f64,
}

/// R⁻¹ of waves of the power 1 in all, and its quadratic form at every pixel.
struct Inverse {
    /// Power of all waves.
    total: f64,
    matrix: SymmetricMatrix,
    /// bᵀR⁻¹b, at least N/(N + ε).
    at_pixels: Vec<f64>,
}

impl Capon {
    /// Of an array, with a diagonal loading in units of the power of all waves.
    pub(super) fn new(beam: ArrayBeam<f64>, loading: f64) -> Self {
        Self { beam, loading }
    }

    /// Spectrum of a lone wave of the power 1 in its own direction: 1 + ε/N.
    pub fn peak(&self) -> f64 {
        let [columns, rows] = self.beam.elements();
        1.0 + self.loading / (columns * rows) as f64
    }

    /// The spectrum of waves at every pixel; nothing where there is no power.
    pub fn observe<T: Real>(&self, waves: &[Wave<T>]) -> Vec<T> {
        match self.inverse(&in_double(waves)) {
            Some(inverse) => inverse.at_pixels.iter().map(|form| T::of(inverse.total / form)).collect(),
            None => vec![T::ZERO; self.beam.pixel_count()],
        }
    }

    /// Derivatives of two losses by the waves' powers alone, from those by the pixels; none where there is no power.
    ///
    /// ∂P/∂p_j = P²·((bᵀR⁻¹b_j)² + ε·bᵀR⁻²b), and summed over pixels with the loss's derivatives d: b_jᵀQb_j + ε·tr Q, Q = R⁻¹(Σ d·P²·bbᵀ)R⁻¹.
    pub fn pull_powers<T: Real>(&self, waves: &[Wave<T>], by_pixel: [&[T]; 2]) -> Vec<[T; 2]> {
        let waves = in_double(waves);
        let Some(inverse) = self.inverse(&waves) else { return vec![[T::ZERO; 2]; waves.len()] };
        let pulls = by_pixel.map(|by_pixel| {
            let squared = by_pixel.iter().zip(&inverse.at_pixels).map(|(d, form)| d.to_f64() / (form * form));
            let table = self.beam.table_of_pixels(&squared.collect::<Vec<_>>());
            let q = inverse.matrix.around(&self.matrix(&table, 0.0));
            (self.form(&q), self.loading * q.trace())
        });
        let [(one, from_one), (two, from_two)] = pulls;
        let pull = |[one, two]: [f64; 2]| [T::of(one + from_one), T::of(two + from_two)];
        self.beam.at_waves(&[one, two], &waves).into_iter().map(pull).collect()
    }

    fn inverse(&self, waves: &[Wave<f64>]) -> Option<Inverse> {
        let mut table = self.beam.table_of_waves(waves);
        // The lag of nothing.
        let total = table[0];
        if total < f64::MIN_POSITIVE {
            return None;
        }
        table.iter_mut().for_each(|entry| *entry /= total);
        let matrix = self.matrix(&table, self.loading).inverse()?;
        let at_pixels = self.beam.at_pixels(&self.form(&matrix));
        Some(Inverse { total, matrix, at_pixels })
    }

    /// Σ p·bbᵀ of a table, with something added to the diagonal.
    fn matrix(&self, table: &[f64], diagonal: f64) -> SymmetricMatrix {
        let [columns, rows] = self.beam.elements();
        SymmetricMatrix::new(columns * rows, |m, n| {
            let [difference, sum] = self.lags(m, n);
            let [cos, sin] =
                [difference.cosine(), sum.sine()].map(|terms| terms.iter().map(|(factor, at)| factor * table[*at]).sum::<f64>());
            cos + sin + if m == n { diagonal } else { 0.0 }
        })
    }

    /// bᵀQb as a table.
    fn form(&self, q: &SymmetricMatrix) -> Vec<f64> {
        let [columns, rows] = self.beam.elements();
        let mut table = vec![0.0; 4 * columns * rows];
        for (m, row) in q.rows().enumerate() {
            for (n, entry) in row.iter().enumerate() {
                let [difference, sum] = self.lags(m, n);
                for (factor, at) in difference.cosine().into_iter().chain(sum.sine()) {
                    table[at] += factor * entry;
                }
            }
        }
        table
    }

    /// φ_m − φ_n and φ_m + φ_n as lags between columns and rows.
    fn lags(&self, m: usize, n: usize) -> [Lag; 2] {
        let [columns, rows] = self.beam.elements().map(|n| n as isize);
        let place = |i: usize| (i as isize / rows, i as isize % rows);
        let ((c, r), (d, s)) = (place(m), place(n));
        let lag = |y: isize, z: isize| Lag { y, z, columns: columns as usize, rows: rows as usize };
        [lag(c - d, r - s), lag(c + d - (columns - 1), r + s - (rows - 1))]
    }
}

/// A phase l_y·y + l_z·z on the grid of elements.
struct Lag {
    y: isize,
    z: isize,
    columns: usize,
    rows: usize,
}

impl Lag {
    /// Its cosine as entries of a table, with their signs: cos l_y·cos l_z − sin l_y·sin l_z.
    fn cosine(&self) -> [(f64, usize); 2] {
        [(1.0, self.at(false, false)), (-(self.y.signum() * self.z.signum()) as f64, self.at(true, true))]
    }

    /// Its sine: sin l_y·cos l_z + cos l_y·sin l_z.
    fn sine(&self) -> [(f64, usize); 2] {
        [(self.y.signum() as f64, self.at(true, false)), (self.z.signum() as f64, self.at(false, true))]
    }

    fn at(&self, sine_of_y: bool, sine_of_z: bool) -> usize {
        let row = self.y.unsigned_abs() + if sine_of_y { self.columns } else { 0 };
        row * 2 * self.rows + self.z.unsigned_abs() + if sine_of_z { self.rows } else { 0 }
    }
}

fn in_double<T: Real>(waves: &[Wave<T>]) -> Vec<Wave<f64>> {
    let wave = |w: &Wave<T>| Wave { direction: w.direction.map(T::to_f64), power: w.power.to_f64(), spread2: w.spread2.to_f64() };
    waves.iter().map(wave).collect()
}

#[cfg(test)]
mod tests;
