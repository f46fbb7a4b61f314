//! Positional encoding: coordinates and their sines and cosines at doubling frequencies (Mildenhall et al. 2020, Eq. 4).

use corf::numeric::Real;

/// γ(x) = (x, sin x, cos x, sin 2x, cos 2x, …, sin 2ᴸ⁻¹x, cos 2ᴸ⁻¹x) of a vector x of three; without the factor π of the paper, as
/// implementations have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrequencyEncoding {
    /// Frequencies, L.
    pub frequencies: usize,
}

impl FrequencyEncoding {
    /// Numbers that encode one vector.
    pub fn width(self) -> usize {
        3 + 6 * self.frequencies
    }

    /// Writes γ(x) into the first [`Self::width`] places of `out`.
    ///
    /// # Panics
    /// When `out` is shorter.
    pub fn encode<T: Real>(self, x: [T; 3], out: &mut [T]) {
        let (plain, waves) = out[..self.width()].split_at_mut(3);
        plain.copy_from_slice(&x);
        let mut frequency = T::ONE;
        for wave in waves.chunks_exact_mut(6) {
            for (axis, v) in x.iter().enumerate() {
                let (sin, cos) = (*v * frequency).sin_cos();
                wave[axis] = sin;
                wave[3 + axis] = cos;
            }
            frequency = frequency + frequency;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_and_frequencies_are_the_published_ones() {
        let encoding = FrequencyEncoding { frequencies: 3 };
        let (x, mut out) = ([0.3, -1.2, 2.0], [f64::NAN; 21]);
        assert_eq!(encoding.width(), out.len());
        encoding.encode(x, &mut out);
        for (axis, v) in x.iter().enumerate() {
            assert_eq!(out[axis], *v);
            for k in 0..3 {
                let angle = v * f64::from(1 << k);
                assert_eq!([out[3 + 6 * k + axis], out[6 + 6 * k + axis]], [angle.sin(), angle.cos()]);
            }
        }
    }
}
