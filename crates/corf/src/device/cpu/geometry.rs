//! From a Gaussian in the world to an ellipse in an image, and the way back for gradients; many Gaussians at a time.
//!
//! Both modalities look from one pose, so the covariance in camera axes is formed once; each grid adds only its own `J`.

use crate::Antialias;
use crate::simd::Lanes;
use corf_scene::{Pinhole, Rigid3};

/// ρ² is not taken below this.
pub(crate) const MIN_DETERMINANT_RATIO: f32 = 2.5e-5;
/// `x/z` is held to this fraction of the image beyond its border in `J`.
const BORDER: f64 = 0.15;

/// Pose of both sensors: `p_camera = rotation · p_world + translation`, by rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pose {
    pub rotation: [[f32; 3]; 3],
    pub translation: [f32; 3],
    /// The camera's centre in the world.
    pub eye: [f32; 3],
}

impl Pose {
    pub fn new(world_from_camera: &Rigid3) -> Self {
        let inverse = world_from_camera.inverse();
        let m = inverse.rotation.transpose().to_cols_array_2d();
        Self {
            rotation: m.map(|row| row.map(|v| v as f32)),
            translation: inverse.translation.to_array().map(|v| v as f32),
            eye: world_from_camera.translation.to_array().map(|v| v as f32),
        }
    }
}

/// One image to render.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grid {
    pub width: usize,
    pub height: usize,
    pub fx: f32,
    pub fy: f32,
    pub cx: f32,
    pub cy: f32,
    /// Bounds of x/z and y/z inside `J`.
    pub x_limits: [f32; 2],
    pub y_limits: [f32; 2],
    pub antialias: Antialias,
}

impl Grid {
    pub fn new(camera: &Pinhole, antialias: Antialias) -> Self {
        let limits = |size: usize, f: f64, c: f64| {
            let size = size as f64;
            [((-BORDER * size - c) / f) as f32, (((1.0 + BORDER) * size - c) / f) as f32]
        };
        Self {
            width: camera.width,
            height: camera.height,
            fx: camera.fx as f32,
            fy: camera.fy as f32,
            cx: camera.cx as f32,
            cy: camera.cy as f32,
            x_limits: limits(camera.width, camera.fx, camera.cx),
            y_limits: limits(camera.height, camera.fy, camera.cy),
            antialias,
        }
    }
}

/// The pose and, per modality, the grid (optical, RF) of what is rendered.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scene {
    pub pose: Pose,
    pub grids: [Option<Grid>; 2],
}

impl Scene {
    pub fn new(world_from_camera: &Rigid3, grids: [Option<Grid>; 2]) -> Self {
        Self { pose: Pose::new(world_from_camera), grids }
    }
}

pub(crate) type Vec3<L> = [L; 3];
/// xx, xy, xz, yy, yz, zz.
pub(crate) type Symmetric<L> = [L; 6];

#[inline(always)]
pub(crate) fn dot<L: Lanes>(a: Vec3<L>, b: Vec3<L>) -> L {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// `M v` of a matrix by rows.
#[inline(always)]
pub(crate) fn times<L: Lanes>(rows: &[Vec3<L>; 3], v: Vec3<L>) -> Vec3<L> {
    [dot(rows[0], v), dot(rows[1], v), dot(rows[2], v)]
}

/// Component by component.
#[inline(always)]
pub(crate) fn each<L: Lanes>(a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

#[inline(always)]
fn scaled<L: Lanes>(a: L, v: Vec3<L>) -> Vec3<L> {
    [a * v[0], a * v[1], a * v[2]]
}

#[inline(always)]
fn added<L: Lanes>(a: Vec3<L>, b: Vec3<L>) -> Vec3<L> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a v + b w`.
#[inline(always)]
fn sum_of<L: Lanes>(a: L, v: Vec3<L>, b: L, w: Vec3<L>) -> Vec3<L> {
    [a.mul_add(v[0], b * w[0]), a.mul_add(v[1], b * w[1]), a.mul_add(v[2], b * w[2])]
}

#[inline(always)]
pub(crate) fn symmetric_times<L: Lanes>(s: Symmetric<L>, v: Vec3<L>) -> Vec3<L> {
    [dot([s[0], s[1], s[2]], v), dot([s[1], s[3], s[4]], v), dot([s[2], s[4], s[5]], v)]
}

/// `p = R μ + t`.
#[inline(always)]
pub(crate) fn to_camera<L: Lanes>(pose: &Pose, mean: Vec3<L>) -> Vec3<L> {
    let mut out = mean;
    for r in 0..3 {
        let row = [L::splat(pose.rotation[r][0]), L::splat(pose.rotation[r][1]), L::splat(pose.rotation[r][2])];
        out[r] = dot(row, mean) + L::splat(pose.translation[r]);
    }
    out
}

/// A Gaussian's shape in camera axes: `V = A diag(s²) Aᵀ` with `A = R_camera_from_world · R(q)`. It is never multiplied out: of a needle the small
/// variances would be lost in the rounding of the large one.
pub(crate) struct Shape<L> {
    /// Unit quaternion w, x, y, z.
    pub q: [L; 4],
    /// 1 / |q| of the stored quaternion.
    pub inverse_norm: L,
    /// A by rows.
    pub axes: [Vec3<L>; 3],
    /// Variances s², m².
    pub variance: Vec3<L>,
    /// Products of two variances each, of the axes beside: V's adjugate is `A diag(of_pairs) Aᵀ`.
    pub of_pairs: Vec3<L>,
}

#[inline(always)]
pub(crate) fn shape_of<L: Lanes>(pose: &Pose, rotation: [L; 4], log_scale: Vec3<L>) -> Shape<L> {
    let one = L::splat(1.0);
    let two = L::splat(2.0);
    let [w, x, y, z] = rotation;
    let inverse_norm = one / w.mul_add(w, x.mul_add(x, y.mul_add(y, z * z))).max(L::splat(1e-30)).sqrt();
    let (w, x, y, z) = (w * inverse_norm, x * inverse_norm, y * inverse_norm, z * inverse_norm);
    let columns: [Vec3<L>; 3] = [
        [one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)],
        [two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)],
        [two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)],
    ];
    let mut axes = [[L::splat(0.0); 3]; 3];
    for r in 0..3 {
        let row = [L::splat(pose.rotation[r][0]), L::splat(pose.rotation[r][1]), L::splat(pose.rotation[r][2])];
        for c in 0..3 {
            axes[r][c] = dot(row, columns[c]);
        }
    }
    let variance = [(two * log_scale[0]).exp(), (two * log_scale[1]).exp(), (two * log_scale[2]).exp()];
    let of_pairs = [variance[1] * variance[2], variance[2] * variance[0], variance[0] * variance[1]];
    Shape { q: [w, x, y, z], inverse_norm, axes, variance, of_pairs }
}

/// A Gaussian's ellipse in one image.
pub(crate) struct Ellipse<L> {
    /// Mean, pixels.
    pub u: L,
    pub v: L,
    pub inverse_z: L,
    /// x/z and y/z as used in J (held inside the limits), and 1 where they were free to move, else 0.
    pub x: L,
    pub y: L,
    pub x_free: L,
    pub y_free: L,
    /// Rows of J (the other entries are zero): j00, j02 and j11, j12.
    pub j: [L; 4],
    /// Aᵀ j₀ᵀ and Aᵀ j₁ᵀ: the rows of J along the Gaussian's own axes.
    pub along: [Vec3<L>; 2],
    /// j₀ × j₁, and the same along the Gaussian's own axes.
    pub cross: Vec3<L>,
    pub cross_along: Vec3<L>,
    /// S₂ = J V Jᵀ: xx, xy, yy.
    pub bare: Vec3<L>,
    /// S = S₂ + h·I: xx and yy (xy is that of S₂).
    pub sxx: L,
    pub syy: L,
    /// det S₂ and det S.
    pub bare_determinant: L,
    pub determinant: L,
    /// Antialias factor ρ (1 without antialiasing): ρ² is det S₂ / det S, not below [`MIN_DETERMINANT_RATIO`]; and 1 where that bound is inactive,
    /// else 0.
    pub rho: L,
    pub ratio_free: L,
}

#[inline(always)]
pub(crate) fn ellipse_of<L: Lanes>(grid: &Grid, p: Vec3<L>, s: &Shape<L>) -> Ellipse<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let inverse_z = one / p[2];
    let (xz, yz) = (p[0] * inverse_z, p[1] * inverse_z);
    let x = xz.max(L::splat(grid.x_limits[0])).min(L::splat(grid.x_limits[1]));
    let y = yz.max(L::splat(grid.y_limits[0])).min(L::splat(grid.y_limits[1]));
    let x_free = L::select(L::and(xz.ge(L::splat(grid.x_limits[0])), L::splat(grid.x_limits[1]).ge(xz)), one, zero);
    let y_free = L::select(L::and(yz.ge(L::splat(grid.y_limits[0])), L::splat(grid.y_limits[1]).ge(yz)), one, zero);
    let (fx, fy) = (L::splat(grid.fx), L::splat(grid.fy));
    let u = fx.mul_add(xz, L::splat(grid.cx));
    let v = fy.mul_add(yz, L::splat(grid.cy));
    let (j00, j11) = (fx * inverse_z, fy * inverse_z);
    let (j02, j12) = (-(j00 * x), -(j11 * y));
    // Rows with one zero entry each.
    let [ax, ay, az] = s.axes;
    let (along0, along1) = (sum_of(j00, ax, j02, az), sum_of(j11, ay, j12, az));
    let (v0, v1) = (each(s.variance, along0), each(s.variance, along1));
    let (a, b, c) = (dot(v0, along0), dot(v0, along1), dot(v1, along1));
    // det S₂ = a c − b² cancels where an ellipse is thin. It is the sum of the squares of the minors of J A diag(s) (Cauchy and Binet), which is
    // (j₀ × j₁)ᵀ adj(V) (j₀ × j₁).
    let cross = [-(j02 * j11), -(j00 * j12), j00 * j11];
    let cross_along = added(sum_of(cross[0], ax, cross[1], ay), scaled(cross[2], az));
    let bare_determinant = dot(each(s.of_pairs, cross_along), cross_along);
    let h = L::splat(grid.antialias.dilation());
    let (sxx, syy) = (a + h, c + h);
    let determinant = h.mul_add(a + syy, bare_determinant);
    let raw = bare_determinant / determinant;
    let least = L::splat(MIN_DETERMINANT_RATIO);
    let ratio = raw.max(least);
    let ratio_free = L::select(raw.gt(least), one, zero);
    let rho = if grid.antialias == Antialias::Off { one } else { ratio.sqrt() };
    Ellipse {
        u,
        v,
        inverse_z,
        x,
        y,
        x_free,
        y_free,
        j: [j00, j02, j11, j12],
        along: [along0, along1],
        cross,
        cross_along,
        bare: [a, b, c],
        sxx,
        syy,
        bare_determinant,
        determinant,
        rho,
        ratio_free,
    }
}

/// Gradients of a Gaussian's projected ellipse in one image, from the backward pass of the blending.
pub(crate) struct EllipseGradient<L> {
    /// Σ dL/dσ · (dx², dx·dy, dy²), d = mean − pixel.
    pub moments: Vec3<L>,
    /// Σ dL/dσ · (dx, dy).
    pub first: [L; 2],
    /// dL/d(1/z) by the inverse-depth image.
    pub inverse_z: L,
    /// dL/dρ (before ρ is detached).
    pub rho: L,
}

/// dL/d(projected mean), pixels: what blending says about where a Gaussian lies in the image.
#[inline(always)]
pub(crate) fn mean_backward<L: Lanes>(e: &Ellipse<L>, g: &EllipseGradient<L>) -> [L; 2] {
    let inverse = L::splat(1.0) / e.determinant;
    let (qa, qb, qc) = (e.syy * inverse, -(e.bare[1] * inverse), e.sxx * inverse);
    [qa * g.first[0] + qb * g.first[1], qb * g.first[0] + qc * g.first[1]]
}

/// dL/dp (camera axes), and dL/dV and dL/d(adj V) (full-matrix convention, symmetric).
pub(crate) struct ShapeGradient<L> {
    pub p: Vec3<L>,
    pub covariance: Symmetric<L>,
    pub adjugate: Symmetric<L>,
}

impl<L: Lanes> ShapeGradient<L> {
    #[inline(always)]
    pub fn zero() -> Self {
        let zero = L::splat(0.0);
        Self { p: [zero; 3], covariance: [zero; 6], adjugate: [zero; 6] }
    }

    /// Adds another's lanes of a mask.
    #[inline(always)]
    pub fn add_where(&mut self, mask: L::Mask, more: &Self) {
        let zero = L::splat(0.0);
        for k in 0..3 {
            self.p[k] = self.p[k] + L::select(mask, more.p[k], zero);
        }
        for k in 0..6 {
            self.covariance[k] = self.covariance[k] + L::select(mask, more.covariance[k], zero);
            self.adjugate[k] = self.adjugate[k] + L::select(mask, more.adjugate[k], zero);
        }
    }
}

/// What one image says.
#[inline(always)]
pub(crate) fn ellipse_backward<L: Lanes>(grid: &Grid, s: &Shape<L>, e: &Ellipse<L>, g: &EllipseGradient<L>) -> ShapeGradient<L> {
    let half = L::splat(0.5);
    let two = L::splat(2.0);
    let inverse = L::splat(1.0) / e.determinant;
    let b = e.bare[1];
    // Q = S⁻¹.
    let (qa, qb, qc) = (e.syy * inverse, -(b * inverse), e.sxx * inverse);
    let [du, dvv] = mean_backward(e, g);
    // dS = −Q dQ Q with dQ = ½ Σ dL/dσ d dᵀ.
    let [m0, m1, m2] = g.moments;
    let (r00, r01) = (qa * m0 + qb * m1, qa * m1 + qb * m2);
    let (r10, r11) = (qb * m0 + qc * m1, qb * m1 + qc * m2);
    let mut s00 = -(half * (r00 * qa + r01 * qb));
    let s01 = -(half * (r00 * qb + r01 * qc));
    let mut s11 = -(half * (r10 * qb + r11 * qc));
    let [j00, j02, j11, j12] = e.j;
    let mut adjugate = [L::splat(0.0); 6];
    let mut d_cross = [L::splat(0.0); 3];
    if grid.antialias == Antialias::On {
        // ρ² = D₀/D₁ with D₁ = D₀ + h (tr S₂ + h): ∂ρ/∂D₀ = h (tr S₂ + h)/(2ρ D₁²), ∂ρ/∂tr = −h D₀/(2ρ D₁²).
        let h = L::splat(grid.antialias.dilation());
        let k = g.rho * e.ratio_free * half * h * inverse / e.rho;
        let by_trace = k * e.bare_determinant * inverse;
        s00 = s00 - by_trace;
        s11 = s11 - by_trace;
        // D₀ = nᵀ adj(V) n, n = j₀ × j₁.
        let by_bare = k * (e.bare[0] + e.syy) * inverse;
        let [x, y, z] = e.cross;
        let scaled_cross = scaled(by_bare, e.cross);
        adjugate = [
            scaled_cross[0] * x,
            scaled_cross[0] * y,
            scaled_cross[0] * z,
            scaled_cross[1] * y,
            scaled_cross[1] * z,
            scaled_cross[2] * z,
        ];
        d_cross = scaled(two * by_bare, times(&s.axes, each(s.of_pairs, e.cross_along)));
    }
    // dV = Jᵀ dS J.
    let covariance = [
        s00 * j00 * j00,
        s01 * j00 * j11,
        j00 * (s00 * j02 + s01 * j12),
        s11 * j11 * j11,
        j11 * (s01 * j02 + s11 * j12),
        s00 * j02 * j02 + two * s01 * j02 * j12 + s11 * j12 * j12,
    ];
    // dJ = 2 dS J V, only the entries that exist; and through n = (−j02 j11, −j00 j12, j00 j11).
    let v0 = times(&s.axes, each(s.variance, e.along[0]));
    let v1 = times(&s.axes, each(s.variance, e.along[1]));
    let dj00 = two * (s00 * v0[0] + s01 * v1[0]) + (d_cross[2] * j11 - d_cross[1] * j12);
    let dj02 = two * (s00 * v0[2] + s01 * v1[2]) - d_cross[0] * j11;
    let dj11 = two * (s01 * v0[1] + s11 * v1[1]) + (d_cross[2] * j00 - d_cross[0] * j02);
    let dj12 = two * (s01 * v0[2] + s11 * v1[2]) - d_cross[1] * j00;
    let (fx, fy) = (L::splat(grid.fx), L::splat(grid.fy));
    let iz = e.inverse_z;
    let iz2 = iz * iz;
    // j00 = fx/z, j02 = −fx x̂/z with x̂ = x/z where free: −fx x/z².
    let xz = (e.u - L::splat(grid.cx)) / fx;
    let yz = (e.v - L::splat(grid.cy)) / fy;
    let one = L::splat(1.0);
    let p = [
        du * fx * iz - dj02 * fx * iz2 * e.x_free,
        dvv * fy * iz - dj12 * fy * iz2 * e.y_free,
        -(du * fx * xz * iz) - dvv * fy * yz * iz - (dj00 * fx + dj11 * fy) * iz2
            + dj02 * fx * e.x * iz2 * (one + e.x_free)
            + dj12 * fy * e.y * iz2 * (one + e.y_free)
            - g.inverse_z * iz2,
    ];
    ShapeGradient { p, covariance, adjugate }
}

/// dL/d(quaternion as stored) and dL/d(ln scale).
#[inline(always)]
pub(crate) fn shape_backward<L: Lanes>(pose: &Pose, s: &Shape<L>, d: &ShapeGradient<L>) -> ([L; 4], Vec3<L>) {
    let two = L::splat(2.0);
    let zero = L::splat(0.0);
    let (mut by_variance, mut by_pairs) = ([zero; 3], [zero; 3]);
    // dR by columns: d(column k of A) = 2 (dV s_k² + d(adj V) s_l² s_m²) a_k; d(column k of R) = Wᵀ of it.
    let mut dr = [[zero; 3]; 3];
    for k in 0..3 {
        let column = [s.axes[0][k], s.axes[1][k], s.axes[2][k]];
        let g = scaled(two * s.variance[k], symmetric_times(d.covariance, column));
        let u = scaled(two * s.of_pairs[k], symmetric_times(d.adjugate, column));
        (by_variance[k], by_pairs[k]) = (dot(column, g), dot(column, u));
        let g = added(g, u);
        for r in 0..3 {
            let w = [L::splat(pose.rotation[0][r]), L::splat(pose.rotation[1][r]), L::splat(pose.rotation[2][r])];
            dr[r][k] = dot(w, g);
        }
    }
    // A scale is in its own variance, and in the products that the other axes have.
    let by_others = [by_pairs[1] + by_pairs[2], by_pairs[2] + by_pairs[0], by_pairs[0] + by_pairs[1]];
    let d_log_scale = added(by_variance, by_others);
    let [w, x, y, z] = s.q;
    let dq = [
        two * (x * (dr[2][1] - dr[1][2]) + y * (dr[0][2] - dr[2][0]) + z * (dr[1][0] - dr[0][1])),
        two * (y * (dr[0][1] + dr[1][0]) + z * (dr[0][2] + dr[2][0]) + w * (dr[2][1] - dr[1][2])
            - two * x * (dr[1][1] + dr[2][2])),
        two * (x * (dr[0][1] + dr[1][0]) + z * (dr[1][2] + dr[2][1]) + w * (dr[0][2] - dr[2][0])
            - two * y * (dr[0][0] + dr[2][2])),
        two * (x * (dr[0][2] + dr[2][0]) + y * (dr[1][2] + dr[2][1]) + w * (dr[1][0] - dr[0][1])
            - two * z * (dr[0][0] + dr[1][1])),
    ];
    // q̂ = q/|q|: the part along q̂ does not count.
    let along = w * dq[0] + x * dq[1] + y * dq[2] + z * dq[3];
    let n = s.inverse_norm;
    ([(dq[0] - w * along) * n, (dq[1] - x * along) * n, (dq[2] - y * along) * n, (dq[3] - z * along) * n], d_log_scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Portable;
    use corf_scene::Rng;
    use glam::{DMat3, DQuat, DVec3};

    /// Relative errors of determinants: some ten roundings, and those of the exponential.
    const TOLERANCE: f64 = 2e-5;

    fn splat<const N: usize>(v: [f32; N]) -> [Portable; N] {
        v.map(Portable::splat)
    }

    fn first(v: Portable) -> f64 {
        let mut out = [0.0; 8];
        v.store(&mut out);
        f64::from(out[0])
    }

    /// Determinants in doubles from the definition, in which needles of this kind lose nothing that counts.
    fn truth(pose: &Pose, camera: &Pinhole, p: DVec3, q: [f32; 4], log_scale: [f32; 3], h: f64) -> [f64; 2] {
        let w = DMat3::from_cols_array_2d(&pose.rotation.map(|row| row.map(f64::from))).transpose();
        let [w0, x, y, z] = q.map(f64::from);
        let a = w * DMat3::from_quat(DQuat::from_xyzw(x, y, z, w0).normalize());
        let m = a * DMat3::from_diagonal(DVec3::from_array(log_scale.map(|s| f64::from(s).exp())));
        let j0 = DVec3::new(camera.fx / p.z, 0.0, -camera.fx * p.x / (p.z * p.z));
        let j1 = DVec3::new(0.0, camera.fy / p.z, -camera.fy * p.y / (p.z * p.z));
        let (r0, r1) = (m.transpose() * j0, m.transpose() * j1);
        let bare = r0.cross(r1).length_squared();
        [bare, bare + h * (r0.length_squared() + r1.length_squared() + h)]
    }

    #[test]
    fn determinants_of_needles_discs_and_balls_are_right() {
        let mut rng = Rng::keyed(31, 0, 0);
        let camera = Pinhole::from_horizontal_fov(640, 360, 90.0);
        let grid = Grid::new(&camera, Antialias::On);
        let pose = Pose::new(&Rigid3::looking_at(DVec3::new(0.3, 0.2, 0.1), DVec3::new(3.0, 1.0, 0.4), DVec3::Z));
        for [x, y, z] in [[-3.0, -3.0, -3.0], [1.0, -9.0, -9.0], [2.0, -7.0, -8.0], [1.0, 1.0, -9.0], [0.0, -4.0, -12.0]] {
            for _ in 0..200 {
                let q = [0; 4].map(|_| rng.normal() as f32);
                let log_scale = [x, y, z].map(|s: f32| s + 0.5 * rng.uniform());
                let p = [rng.uniform() - 0.5, 0.5 * (rng.uniform() - 0.5), 1.0 + 3.0 * rng.uniform()];
                let [bare, whole] = truth(&pose, &camera, DVec3::from_array(p.map(f64::from)), q, log_scale, 0.1_f32.into());
                let s = shape_of(&pose, splat(q), splat(log_scale));
                let e = ellipse_of(&grid, splat(p), &s);
                let worst = (first(e.bare_determinant) / bare - 1.0).abs().max((first(e.determinant) / whole - 1.0).abs());
                // Where the long axis points at the camera, its own rounding is what is seen of it.
                let of_ends = if x > y { 40.0 } else { 1.0 };
                assert!(worst < of_ends * TOLERANCE, "{log_scale:?} {q:?}: {worst:e} of {bare:e}, {whole:e}");
            }
        }
    }
}
