//! Positive definite Hermitian matrices: the covariance of an array and its inverse.

use crate::radio::Complex;
use rayon::prelude::*;

/// A Hermitian matrix, stored whole, by rows.
#[derive(Clone, Debug)]
pub(super) struct Hermitian {
    n: usize,
    entries: Vec<Complex>,
}

fn conjugate(z: Complex) -> Complex {
    Complex::new(z.re, -z.im)
}

impl Hermitian {
    /// Σ x xᴴ over vectors of `n` entries; zero without any.
    pub fn sum_of_products(n: usize, vectors: &[Vec<Complex>]) -> Self {
        let mut entries = vec![Complex::ZERO; n * n];
        entries.par_chunks_mut(n).enumerate().for_each(|(i, row)| {
            for x in vectors {
                let left = x[i];
                row.iter_mut().zip(x).for_each(|(entry, right)| *entry = *entry + left * conjugate(*right));
            }
        });
        Self { n, entries }
    }

    /// The sum with another of the same size.
    pub fn plus(mut self, other: Self) -> Self {
        self.entries.iter_mut().zip(other.entries).for_each(|(a, b)| *a = *a + b);
        self
    }

    /// All entries, by rows.
    pub fn entries(&self) -> &[Complex] {
        &self.entries
    }

    /// The sum of the diagonal.
    pub fn trace(&self) -> f64 {
        (0..self.n).map(|i| self.entries[i * self.n + i].re).sum()
    }

    /// Adds a real number to every entry of the diagonal.
    pub fn load(&mut self, by: f64) {
        (0..self.n).for_each(|i| self.entries[i * self.n + i].re += by);
    }

    /// The inverse by Cholesky's factorisation A = LLᴴ, or `None` where a pivot is not positive.
    pub fn inverse(&self) -> Option<Self> {
        let n = self.n;
        let l = self.cholesky()?;
        // Columns of L⁻¹ by forward substitution, then A⁻¹ = L⁻ᴴL⁻¹.
        let columns: Vec<Vec<Complex>> = (0..n)
            .into_par_iter()
            .map(|column| {
                let mut x = vec![Complex::ZERO; n];
                for i in column..n {
                    let known = (column..i).fold(Complex::ZERO, |sum, k| sum + l[i * n + k] * x[k]);
                    let right = if i == column { Complex::ONE } else { Complex::ZERO };
                    x[i] = (right - known) * (1.0 / l[i * n + i].re);
                }
                x
            })
            .collect();
        let mut entries = vec![Complex::ZERO; n * n];
        entries.par_chunks_mut(n).enumerate().for_each(|(i, row)| {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = (i.max(j)..n).fold(Complex::ZERO, |sum, k| sum + conjugate(columns[i][k]) * columns[j][k]);
            }
        });
        Some(Self { n, entries })
    }

    /// The lower triangle L of A = LLᴴ, by rows.
    fn cholesky(&self) -> Option<Vec<Complex>> {
        let n = self.n;
        let mut l = vec![Complex::ZERO; n * n];
        for i in 0..n {
            for j in 0..=i {
                let known = (0..j).fold(Complex::ZERO, |sum, k| sum + l[i * n + k] * conjugate(l[j * n + k]));
                let left = self.entries[i * n + j] - known;
                if i == j {
                    if !(left.re > 0.0 && left.re.is_finite()) {
                        return None;
                    }
                    l[i * n + i] = Complex::real(left.re.sqrt());
                } else {
                    l[i * n + j] = left * (1.0 / l[j * n + j].re);
                }
            }
        }
        Some(l)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn the_inverse_undoes_the_matrix_and_a_singular_one_has_none() {
        let n = 12;
        let vectors: Vec<Vec<Complex>> = (0..9)
            .map(|i| {
                let mut rng = Rng::keyed(8, 0, i);
                (0..n).map(|_| Complex::new(rng.normal(), rng.normal())).collect()
            })
            .collect();
        let mut a = Hermitian::sum_of_products(n, &vectors);
        assert!(a.inverse().is_none_or(|inverse| inverse.trace() > 1e10), "rank 9 of 12");
        a.load(1e-3 * a.trace() / n as f64);
        let inverse = a.inverse().unwrap();
        for i in 0..n {
            for j in 0..n {
                let product = (0..n).fold(Complex::ZERO, |sum, k| sum + a.entries()[i * n + k] * inverse.entries()[k * n + j]);
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((product - Complex::real(expected)).norm() < 1e-10, "({i}, {j}) {product:?}");
            }
        }
        assert!(Hermitian::sum_of_products(3, &[]).inverse().is_none());
    }
}
