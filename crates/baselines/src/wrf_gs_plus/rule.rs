//! How a Gaussian is deformed by what the network predicts of it, and the gradient of that.

use corf::numeric::Real;

/// Standard deviations are not taken below this, metres.
pub(crate) const LEAST_DEVIATION_M: f64 = 1e-6;

/// The parameters of a Gaussian that a deformation concerns, or a gradient in them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shape<T> {
    /// Mean, metres, world frame.
    pub position: [T; 3],
    /// Quaternion w, x, y, z, of any length.
    pub rotation: [T; 4],
    /// ln of the standard deviations in metres.
    pub log_scale: [T; 3],
    /// Degree-0 coefficients of the colour; those beyond its channels are 0.
    pub dc: [T; 3],
}

/// What the network predicts of a Gaussian, or a gradient in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Offsets<T> {
    /// Displacement, metres.
    pub position: [T; 3],
    /// Added to the standard deviations, metres.
    pub scale: [T; 3],
    /// Added to the unit quaternion.
    pub rotation: [T; 4],
    /// Added to the degree-0 coefficients.
    pub signal: [T; 3],
}

/// The deformation as published, or with the displacement that the published program predicts and leaves unused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    /// Whether the displacement moves a Gaussian.
    pub move_positions: bool,
    /// Whether what is added to the colour is the signal's size, as the published program has it, whose phase is lost in it; otherwise it has a sign.
    pub signal_is_magnitude: bool,
}

/// A sum of elements.
fn plus<T: Real, const N: usize>(a: [T; N], b: [T; N]) -> [T; N] {
    std::array::from_fn(|k| a[k] + b[k])
}

/// 1 / |q|.
fn inverse_norm<T: Real>(q: [T; 4]) -> T {
    let squared = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    T::ONE / if squared > T::of(1e-30) { squared } else { T::of(1e-30) }.sqrt()
}

/// A standard deviation with its offset, which may turn it negative: a covariance has no use for the sign.
fn deviation<T: Real>(log_scale: T, offset: T) -> T {
    log_scale.exp() + offset
}

impl Rule {
    /// The Gaussian as a receiver finds it: `σ = |exp(ln σ₀) + Δσ|`, `q = q₀/|q₀| + Δq`, both as published; signal added to the colour.
    pub fn apply<T: Real>(self, base: &Shape<T>, offsets: &Offsets<T>) -> Shape<T> {
        let n = inverse_norm(base.rotation);
        let least = T::of(LEAST_DEVIATION_M);
        let log = |k: usize| {
            let size = deviation(base.log_scale[k], offsets.scale[k]).abs();
            if size > least { size } else { least }.ln()
        };
        Shape {
            position: if self.move_positions { plus(base.position, offsets.position) } else { base.position },
            rotation: plus(base.rotation.map(|q| q * n), offsets.rotation),
            log_scale: [0, 1, 2].map(log),
            dc: plus(base.dc, if self.signal_is_magnitude { offsets.signal.map(T::abs) } else { offsets.signal }),
        }
    }

    /// The gradient in the Gaussian and in the offsets from `gradient`, that in the Gaussian as deformed.
    pub fn backward<T: Real>(self, base: &Shape<T>, offsets: &Offsets<T>, gradient: &Shape<T>) -> (Shape<T>, Offsets<T>) {
        let n = inverse_norm(base.rotation);
        let unit = base.rotation.map(|q| q * n);
        let g = gradient.rotation;
        let along = unit[0] * g[0] + unit[1] * g[1] + unit[2] * g[2] + unit[3] * g[3];
        // d ln|s| / ds = 1/s; nothing where the deviation is held at its least.
        let scale = [0, 1, 2].map(|k| {
            let s = deviation(base.log_scale[k], offsets.scale[k]);
            if s.abs() > T::of(LEAST_DEVIATION_M) { gradient.log_scale[k] / s } else { T::ZERO }
        });
        let of_base = Shape {
            position: gradient.position,
            rotation: [0, 1, 2, 3].map(|k| (g[k] - unit[k] * along) * n),
            log_scale: [0, 1, 2].map(|k| scale[k] * base.log_scale[k].exp()),
            dc: gradient.dc,
        };
        let position = if self.move_positions { gradient.position } else { [T::ZERO; 3] };
        let sign =
            |k: usize| if self.signal_is_magnitude && offsets.signal[k] < T::ZERO { -gradient.dc[k] } else { gradient.dc[k] };
        (of_base, Offsets { position, scale, rotation: g, signal: [0, 1, 2].map(sign) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUBLISHED: Rule = Rule { move_positions: false, signal_is_magnitude: false };

    #[test]
    fn scale_is_added_behind_the_exponential_and_rotation_behind_the_normalisation() {
        let base =
            Shape { position: [1.0, 2.0, 3.0], rotation: [2.0, 0.0, 0.0, 0.0], log_scale: [0.0, -1.0, 0.0f64], dc: [0.1; 3] };
        let offsets = Offsets { position: [0.5; 3], scale: [0.5, 0.0, -3.0], rotation: [0.0, 0.25, 0.0, 0.0], signal: [0.2; 3] };
        let published = PUBLISHED.apply(&base, &offsets);
        assert_eq!(published.position, base.position);
        assert_eq!(published.rotation, [1.0, 0.25, 0.0, 0.0]);
        let expected = [1.5f64.ln(), -1.0, 2.0f64.ln()];
        assert!(published.log_scale.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{published:?}");
        let moved = Rule { move_positions: true, ..PUBLISHED }.apply(&base, &offsets);
        assert_eq!(moved, Shape { position: [1.5, 2.5, 3.5], ..published });
        let none = Offsets { scale: [-1.0, 0.0, 0.0], ..Offsets::default() };
        let thin = PUBLISHED.apply(&base, &none);
        assert!((thin.log_scale[0] - LEAST_DEVIATION_M.ln()).abs() < 1e-9);
        let gradient = Shape { log_scale: [1.0; 3], ..Shape::default() };
        assert_eq!(PUBLISHED.backward(&base, &none, &gradient).1.scale[0], 0.0);
    }
}
