//! From a Gaussian in the room to an ellipse over azimuth and elevation of an array, and the way back for gradients.
//!
//! ```text
//! p = M (μ − array),  w = x² + y²,  R = w + z²
//! u = W/2π · atan2(y, x) − ½,        j_u = W/2π · (−y, x, 0) / w
//! v = H/(π/2) · asin(z/√R) − ½,      j_v = H/(π/2) · (−xz/√w, −yz/√w, √w) / R
//! S = Σ_k s_k² (a_uk, a_vk)(a_uk, a_vk)ᵀ + 0.3 I,   a_u = (M R(q))ᵀ j_u,  a_v = (M R(q))ᵀ j_v
//! ```
//! Column c is centred on azimuth c + 1 degrees and row r on elevation r + 1 degrees where a pixel is a degree, as the data sets have it.

use crate::wrf_gs_plus::Shape;
use corf::numeric::Real;
use corf_scene::dataset::FixedArray;
use glam::{DMat3, DQuat};
use std::f64::consts::{FRAC_PI_2, TAU};

/// What is added to an ellipse's variances so that it is at least about a pixel wide, pixels².
const DILATION: f64 = 0.3;
/// Gaussians nearer to the zenith than this, as the sine of the angle, are not drawn: azimuth has no derivative there.
const LEAST_SINE: f64 = 0.01;
/// A weight below this is not drawn.
const LEAST_ALPHA: f64 = 1.0 / 255.0;

/// The pixels of an array's spectrum: all azimuths over the columns, the half-sphere above the array over the rows.
#[derive(Clone, Debug)]
pub struct Lens {
    /// Columns, all of the azimuths.
    pub columns: usize,
    /// Rows, elevation 0 to 90 degrees.
    pub rows: usize,
    /// Where the array stands, metres in the room.
    position: [f64; 3],
    /// M, by rows.
    array_from_room: [[f64; 3]; 3],
    /// Nearer Gaussians are not drawn, metres.
    near_m: f64,
}

/// A Gaussian in the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Splat<T> {
    /// Number of the Gaussian.
    pub id: usize,
    /// Distance from the array, metres.
    pub distance: T,
    /// Mean, pixels; the centre of the first pixel is ½.
    pub mean: [T; 2],
    /// Q = S⁻¹: uu, uv, vv.
    pub conic: [T; 3],
    /// o.
    pub opacity: T,
    /// First two channels, not negative.
    pub color: [T; 2],
    /// σ above which the weight is below 1/255.
    pub bound: T,
    /// Half height where σ is that, pixels.
    pub half_height: T,
}

/// What the picture says about a Gaussian.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SplatGradient<T> {
    /// In the colour.
    pub color: [T; 2],
    /// In the opacity.
    pub opacity: T,
    /// Σ dL/dσ (du, dv), mean less pixel.
    pub first: [T; 2],
    /// Σ dL/dσ (du², du dv, dv²).
    pub moments: [T; 3],
}

/// What a projection is made of.
struct Parts<T> {
    p: [T; 3],
    /// w, R, √w.
    lengths: [T; 3],
    j: [[T; 3]; 2],
    /// Unit quaternion and 1/|q|.
    q: [T; 4],
    inverse_norm: T,
    /// M R(q), by rows.
    axes: [[T; 3]; 3],
    variance: [T; 3],
    /// a_u and a_v.
    along: [[T; 3]; 2],
    /// S: uu, uv, vv.
    s: [T; 3],
}

fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `mᵀ v` of a matrix by rows.
fn transposed_times<T: Real>(m: &[[T; 3]; 3], v: [T; 3]) -> [T; 3] {
    [0, 1, 2].map(|c| m[0][c] * v[0] + m[1][c] * v[1] + m[2][c] * v[2])
}

/// R(q) of a unit quaternion w, x, y, z, by rows.
fn rotation<T: Real>([w, x, y, z]: [T; 4]) -> [[T; 3]; 3] {
    let (one, two) = (T::ONE, T::of(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

impl Lens {
    /// That of an array; Gaussians nearer than `near_m` are not drawn.
    pub fn new(array: &FixedArray, near_m: f64) -> Self {
        let [x, y, z, w] = array.orientation_xyzw;
        let rows = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()).to_cols_array_2d();
        Self {
            columns: array.azimuths,
            rows: array.elevations,
            position: array.position_m,
            // The columns of room-from-array are the rows of its inverse.
            array_from_room: rows,
            near_m,
        }
    }

    /// Pixels per radian of azimuth and of elevation.
    fn pixels_per_rad(&self) -> [f64; 2] {
        [self.columns as f64 / TAU, self.rows as f64 / FRAC_PI_2]
    }

    fn matrix<T: Real>(&self) -> [[T; 3]; 3] {
        self.array_from_room.map(|row| row.map(T::of))
    }

    /// `None` where it is too near to the array or to its zenith.
    fn parts<T: Real>(&self, shape: &Shape<T>) -> Option<Parts<T>> {
        let m = self.matrix::<T>();
        let from_array = [0, 1, 2].map(|k| shape.position[k] - T::of(self.position[k]));
        let p = m.map(|row| dot(row, from_array));
        let [x, y, z] = p;
        let w = x * x + y * y;
        let squared = w + z * z;
        let drawn = squared > T::of(self.near_m * self.near_m) && w > T::of(LEAST_SINE * LEAST_SINE) * squared;
        if !drawn {
            return None;
        }
        let root = w.sqrt();
        let [ku, kv] = self.pixels_per_rad().map(T::of);
        let scaled = kv / (root * squared);
        let j = [[-(ku * y / w), ku * x / w, T::ZERO], [-(x * z * scaled), -(y * z * scaled), kv * root / squared]];
        let length = shape.rotation.iter().fold(T::ZERO, |sum, v| sum + *v * *v);
        let inverse_norm = T::ONE / if length > T::of(1e-30) { length } else { T::of(1e-30) }.sqrt();
        let q = shape.rotation.map(|v| v * inverse_norm);
        let r = rotation(q);
        let axes = m.map(|row| transposed_times(&r, row));
        let variance = shape.log_scale.map(|s| (s + s).exp());
        let along = j.map(|j| transposed_times(&axes, j));
        let sum = |a: [T; 3], b: [T; 3]| dot([variance[0] * a[0], variance[1] * a[1], variance[2] * a[2]], b);
        let h = T::of(DILATION);
        let s = [sum(along[0], along[0]) + h, sum(along[0], along[1]), sum(along[1], along[1]) + h];
        Some(Parts { p, lengths: [w, squared, root], j, q, inverse_norm, axes, variance, along, s })
    }

    /// How Gaussian `id` is drawn, if it is.
    pub(super) fn project<T: Real>(&self, id: usize, shape: &Shape<T>, logit: T, color: [T; 2]) -> Option<Splat<T>> {
        let parts = self.parts(shape)?;
        let [x, y, z] = parts.p.map(T::to_f64);
        let distance = parts.lengths[1].sqrt();
        let [ku, kv] = self.pixels_per_rad();
        let azimuth = y.atan2(x).rem_euclid(TAU);
        let elevation = (z / distance.to_f64()).clamp(-1.0, 1.0).asin();
        let mean = [T::of(ku * azimuth - 0.5), T::of(kv * elevation - 0.5)];
        let [a, b, c] = parts.s;
        let determinant = a * c - b * b;
        let opacity = T::ONE / (T::ONE + (-logit).exp());
        let bound = (opacity / T::of(LEAST_ALPHA)).ln();
        // Written so that NaN is not drawn.
        if !(determinant > T::ZERO && bound > T::ZERO) {
            return None;
        }
        let conic = [c / determinant, -(b / determinant), a / determinant];
        let half_height = (T::of(2.0) * bound * c).sqrt();
        let (low, high) = (mean[1] - half_height, mean[1] + half_height);
        let reaches = high > T::of(0.5) && T::of(self.rows as f64 - 0.5) > low;
        reaches.then_some(Splat { id, distance, mean, conic, opacity, color, bound, half_height })
    }

    /// The gradient in the Gaussian and its opacity's logit, and in its mean, pixels.
    pub(super) fn backward<T: Real>(&self, shape: &Shape<T>, splat: &Splat<T>, g: &SplatGradient<T>) -> (Shape<T>, T, [T; 2]) {
        let (mut out, two, half) = (Shape::default(), T::of(2.0), T::of(0.5));
        let Some(parts) = self.parts(shape) else { return (out, T::ZERO, [T::ZERO; 2]) };
        let [qa, qb, qc] = splat.conic;
        // σ = ½ dᵀQd, d = mean − pixel.
        let mean = [qa * g.first[0] + qb * g.first[1], qb * g.first[0] + qc * g.first[1]];
        // dS = −Q dQ Q with dQ = ½ Σ dL/dσ d dᵀ.
        let [m0, m1, m2] = g.moments;
        let (r00, r01) = (qa * m0 + qb * m1, qa * m1 + qb * m2);
        let (r10, r11) = (qb * m0 + qc * m1, qb * m1 + qc * m2);
        let s = [-(half * (r00 * qa + r01 * qb)), -(half * (r00 * qb + r01 * qc)), -(half * (r10 * qb + r11 * qc))];
        // S = Σ s_k² a_k a_kᵀ.
        let mut of_along = [[T::ZERO; 3]; 2];
        for k in 0..3 {
            let (au, av) = (parts.along[0][k], parts.along[1][k]);
            let by_variance = s[0] * au * au + two * s[1] * au * av + s[2] * av * av;
            out.log_scale[k] = two * parts.variance[k] * by_variance;
            of_along[0][k] = two * parts.variance[k] * (s[0] * au + s[1] * av);
            of_along[1][k] = two * parts.variance[k] * (s[1] * au + s[2] * av);
        }
        // a = Aᵀ j: dj = A da, and dA = Σ j daᵀ, of which dR = Mᵀ dA.
        let of_j = of_along.map(|da| parts.axes.map(|row| dot(row, da)));
        let of_axes = [0, 1, 2].map(|r| [0, 1, 2].map(|c| parts.j[0][r] * of_along[0][c] + parts.j[1][r] * of_along[1][c]));
        let m = self.matrix::<T>();
        let of_r: [[T; 3]; 3] =
            [0, 1, 2].map(|r| [0, 1, 2].map(|c| m[0][r] * of_axes[0][c] + m[1][r] * of_axes[1][c] + m[2][r] * of_axes[2][c]));
        out.rotation = of_quaternion(parts.q, parts.inverse_norm, &of_r);
        let through_j = self.through_j(&parts, &of_j);
        let of_p = [0, 1, 2].map(|k| through_j[k] + mean[0] * parts.j[0][k] + mean[1] * parts.j[1][k]);
        out.position = transposed_times(&m, of_p);
        let o = splat.opacity;
        (out, g.opacity * o * (T::ONE - o), mean)
    }

    /// dL/dp by the Jacobian's own dependence on p.
    fn through_j<T: Real>(&self, parts: &Parts<T>, of_j: &[[T; 3]; 2]) -> [T; 3] {
        let two = T::of(2.0);
        let ([x, y, z], [w, squared, root]) = (parts.p, parts.lengths);
        let [ku, kv] = self.pixels_per_rad().map(T::of);
        let [[u0, u1, _], [v0, v1, v2]] = *of_j;
        // j_u = ku (−y, x, 0)/w.
        let of_w2 = ku / (w * w);
        let (same, cross) = (two * x * y * of_w2, (y * y - x * x) * of_w2);
        let mut out = [u0 * same + u1 * cross, u0 * cross - u1 * same, T::ZERO];
        // j_v = kv (−xz g, −yz g, √w/R) with g = 1/(√w R).
        let g = T::ONE / (root * squared);
        let of_g = [x, y].map(|c| -(g * (c / w + two * c / squared)));
        let of_g = [of_g[0], of_g[1], -(g * two * z / squared)];
        let horizontal = [x, y];
        for (c, v) in [v0, v1].into_iter().enumerate() {
            let h = horizontal[c];
            for k in 0..3 {
                out[k] = out[k] - v * kv * h * z * of_g[k];
            }
            out[c] = out[c] - v * kv * z * g;
            out[2] = out[2] - v * kv * h * g;
        }
        let up = kv * v2;
        for k in 0..2 {
            out[k] += up * horizontal[k] * (T::ONE / (root * squared) - two * root / (squared * squared));
        }
        out[2] = out[2] - up * two * z * root / (squared * squared);
        out
    }
}

/// dL/d(quaternion as stored) from dL/dR(q).
fn of_quaternion<T: Real>(q: [T; 4], inverse_norm: T, d: &[[T; 3]; 3]) -> [T; 4] {
    let two = T::of(2.0);
    let [w, x, y, z] = q;
    let unit = [
        two * (x * (d[2][1] - d[1][2]) + y * (d[0][2] - d[2][0]) + z * (d[1][0] - d[0][1])),
        two * (w * (d[2][1] - d[1][2]) + y * (d[0][1] + d[1][0]) + z * (d[0][2] + d[2][0]) - two * x * (d[1][1] + d[2][2])),
        two * (w * (d[0][2] - d[2][0]) + x * (d[0][1] + d[1][0]) + z * (d[1][2] + d[2][1]) - two * y * (d[0][0] + d[2][2])),
        two * (w * (d[1][0] - d[0][1]) + x * (d[0][2] + d[2][0]) + y * (d[1][2] + d[2][1]) - two * z * (d[0][0] + d[1][1])),
    ];
    let along = unit[0] * q[0] + unit[1] * q[1] + unit[2] * q[2] + unit[3] * q[3];
    [0, 1, 2, 3].map(|k| (unit[k] - q[k] * along) * inverse_norm)
}
