//! Positive definite symmetric matrices in double precision: inverses and products.

use rayon::prelude::*;

/// A symmetric matrix, stored whole, by rows.
#[derive(Clone, Debug)]
pub(super) struct SymmetricMatrix {
    n: usize,
    entries: Vec<f64>,
}

impl SymmetricMatrix {
    /// The matrix of the entries (row, column) ↦ `entry`, of which both triangles are asked for.
    pub fn new(n: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        Self { n, entries: (0..n * n).map(|i| entry(i / n, i % n)).collect() }
    }

    /// Rows.
    pub fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.entries.chunks_exact(self.n)
    }

    /// Sum of the diagonal.
    pub fn trace(&self) -> f64 {
        self.entries.iter().step_by(self.n + 1).sum()
    }

    /// A⁻¹ by Cholesky's factorisation A = LLᵀ, or `None` where a pivot is not positive.
    pub fn inverse(&self) -> Option<Self> {
        let n = self.n;
        let l = self.cholesky()?;
        // L⁻¹ by forward substitution, row by row, then A⁻¹ = L⁻ᵀL⁻¹.
        let mut w = vec![0.0; n * n];
        for i in 0..n {
            let (above, row) = w.split_at_mut(i * n);
            row[i] = 1.0;
            for (factor, other) in l[i * n..].iter().zip(above.chunks_exact(n)) {
                add(&mut row[..i], -factor, other);
            }
            row[..=i].iter_mut().for_each(|v| *v /= l[i * n + i]);
        }
        let row = |i: usize| {
            let mut row = vec![0.0; n];
            w.chunks_exact(n).skip(i).for_each(|other| add(&mut row, other[i], other));
            row
        };
        Some(Self { n, entries: (0..n).into_par_iter().flat_map_iter(row).collect() })
    }

    /// The lower triangle L of A = LLᵀ, by rows.
    fn cholesky(&self) -> Option<Vec<f64>> {
        let n = self.n;
        let mut l = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let known: f64 = l[i * n..i * n + j].iter().zip(&l[j * n..j * n + j]).map(|(a, b)| a * b).sum();
                let left = self.entries[i * n + j] - known;
                l[i * n + j] = if i > j { left / l[j * n + j] } else { left.sqrt() };
            }
            if !(l[i * n + i] > 0.0 && l[i * n + i].is_finite()) {
                return None;
            }
        }
        Some(l)
    }

    /// ABA, with this as A.
    pub fn around(&self, b: &Self) -> Self {
        let n = self.n;
        let times = |a: &[f64], b: &[f64]| -> Vec<f64> {
            let row = |i: usize| {
                let mut row = vec![0.0; n];
                a[i * n..(i + 1) * n].iter().zip(b.chunks_exact(n)).for_each(|(factor, other)| add(&mut row, *factor, other));
                row
            };
            (0..n).into_par_iter().flat_map_iter(row).collect()
        };
        Self { n, entries: times(&times(&self.entries, &b.entries), &self.entries) }
    }
}

fn add(to: &mut [f64], factor: f64, row: &[f64]) {
    to.iter_mut().zip(row).for_each(|(to, v)| *to += factor * v);
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::SymmetricMatrix;
    use corf_scene::Rng;

    #[test]
    fn the_inverse_undoes_the_matrix_and_a_singular_one_has_none() {
        const N: usize = 12;
        let vectors: Vec<Vec<f64>> = (0..9)
            .map(|i| {
                let mut rng = Rng::keyed(8, 0, i);
                (0..N).map(|_| rng.normal()).collect()
            })
            .collect();
        let loaded = |by: f64| {
            let product = |i: usize, j: usize| vectors.iter().map(|v| v[i] * v[j]).sum::<f64>();
            SymmetricMatrix::new(N, |i, j| product(i, j) + if i == j { by } else { 0.0 })
        };
        let (a, inverse) = (loaded(1e-3), loaded(1e-3).inverse().unwrap());
        // A⁻¹AA⁻¹ is A⁻¹, and AA⁻¹ is 1.
        for ((one, other), i) in inverse.around(&a).rows().zip(inverse.rows()).zip(0..) {
            for j in 0..N {
                assert!((one[j] - other[j]).abs() < 1e-9 * inverse.trace(), "({i}, {j})");
                let product: f64 = (0..N).map(|k| a.entries[i * N + k] * inverse.entries[k * N + j]).sum();
                assert!((product - f64::from(i == j)).abs() < 1e-10, "({i}, {j}) {product}");
            }
        }
        assert!(loaded(0.0).inverse().is_none_or(|inverse| inverse.trace() > 1e10), "rank 9 of 12");
        assert!(SymmetricMatrix::new(3, |_, _| 0.0).inverse().is_none());
    }
}
