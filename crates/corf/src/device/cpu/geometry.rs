//! From a Gaussian in the world to an ellipse in an image, and the way back for gradients; many Gaussians at a time.
//!
//! Both modalities look from one pose, so the covariance in camera axes is formed once; each grid adds only its own `J`.

use super::simd::Lanes;
use crate::Antialias;
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

/// A Gaussian's shape in camera axes: `V = A diag(s²) Aᵀ` with `A = R_camera_from_world · R(q)`.
pub(crate) struct Shape<L> {
    /// Unit quaternion w, x, y, z.
    pub q: [L; 4],
    /// 1 / |q| of the stored quaternion.
    pub inverse_norm: L,
    /// A by rows.
    pub axes: [Vec3<L>; 3],
    /// Variances s², m².
    pub variance: Vec3<L>,
    /// V.
    pub covariance: Symmetric<L>,
}

#[inline(always)]
pub(crate) fn shape<L: Lanes>(pose: &Pose, rotation: [L; 4], log_scale: Vec3<L>) -> Shape<L> {
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
    let [a, b, c] = axes;
    let av = [a[0] * variance[0], a[1] * variance[1], a[2] * variance[2]];
    let bv = [b[0] * variance[0], b[1] * variance[1], b[2] * variance[2]];
    let cv = [c[0] * variance[0], c[1] * variance[1], c[2] * variance[2]];
    let covariance = [dot(av, a), dot(av, b), dot(av, c), dot(bv, b), dot(bv, c), dot(cv, c)];
    Shape { q: [w, x, y, z], inverse_norm, axes, variance, covariance }
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
    /// V j₀ᵀ and V j₁ᵀ.
    pub vj: [Vec3<L>; 2],
    /// S₂ = J V Jᵀ: xx, xy, yy.
    pub bare: Vec3<L>,
    /// S = S₂ + h·I: xx and yy (xy is that of S₂).
    pub sxx: L,
    pub syy: L,
    pub determinant: L,
    /// det S₂ / det S, not below [`MIN_DETERMINANT_RATIO`], and 1 where that bound is inactive, else 0.
    pub ratio: L,
    pub ratio_free: L,
    /// Antialias factor ρ (1 without antialiasing).
    pub rho: L,
}

#[inline(always)]
pub(crate) fn ellipse<L: Lanes>(grid: &Grid, p: Vec3<L>, covariance: Symmetric<L>) -> Ellipse<L> {
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
    let s = covariance;
    // V j for rows with one zero entry each.
    let v0 = [s[0] * j00 + s[2] * j02, s[1] * j00 + s[4] * j02, s[2] * j00 + s[5] * j02];
    let v1 = [s[1] * j11 + s[2] * j12, s[3] * j11 + s[4] * j12, s[4] * j11 + s[5] * j12];
    let a = j00 * v0[0] + j02 * v0[2];
    let b = j11 * v0[1] + j12 * v0[2];
    let c = j11 * v1[1] + j12 * v1[2];
    let h = L::splat(grid.antialias.dilation());
    let (sxx, syy) = (a + h, c + h);
    let determinant = sxx * syy - b * b;
    let raw = (a * c - b * b) / determinant;
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
        vj: [v0, v1],
        bare: [a, b, c],
        sxx,
        syy,
        determinant,
        ratio,
        ratio_free,
        rho,
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

/// Adds to dL/dp (camera axes) and dL/dV (full-matrix convention, symmetric).
#[inline(always)]
pub(crate) fn ellipse_backward<L: Lanes>(
    grid: &Grid,
    e: &Ellipse<L>,
    g: &EllipseGradient<L>,
    dp: &mut Vec3<L>,
    dv: &mut Symmetric<L>,
) {
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
    let mut s01 = -(half * (r00 * qb + r01 * qc));
    let mut s11 = -(half * (r10 * qb + r11 * qc));
    if grid.antialias == Antialias::On {
        // ∂ρ/∂a = (c D₁ − D₀ C)/(2ρ D₁²) = (c − (D₀/D₁) C)/(2ρ D₁); b and c likewise. Full-matrix: half of ∂ρ/∂b off the diagonal.
        let k = g.rho * e.ratio_free * inverse * half / e.rho;
        s00 = s00 + k * (e.bare[2] - e.ratio * e.syy);
        s11 = s11 + k * (e.bare[0] - e.ratio * e.sxx);
        s01 = s01 - k * b * (L::splat(1.0) - e.ratio);
    }
    let [j00, j02, j11, j12] = e.j;
    // dV += Jᵀ dS J.
    dv[0] = dv[0] + s00 * j00 * j00;
    dv[1] = dv[1] + s01 * j00 * j11;
    dv[2] = dv[2] + j00 * (s00 * j02 + s01 * j12);
    dv[3] = dv[3] + s11 * j11 * j11;
    dv[4] = dv[4] + j11 * (s01 * j02 + s11 * j12);
    dv[5] = dv[5] + (s00 * j02 * j02 + two * s01 * j02 * j12 + s11 * j12 * j12);
    // dJ = 2 dS J V, only the entries that exist.
    let [v0, v1] = e.vj;
    let dj00 = two * (s00 * v0[0] + s01 * v1[0]);
    let dj02 = two * (s00 * v0[2] + s01 * v1[2]);
    let dj11 = two * (s01 * v0[1] + s11 * v1[1]);
    let dj12 = two * (s01 * v0[2] + s11 * v1[2]);
    let (fx, fy) = (L::splat(grid.fx), L::splat(grid.fy));
    let iz = e.inverse_z;
    let iz2 = iz * iz;
    // j00 = fx/z, j02 = −fx x̂/z with x̂ = x/z where free: −fx x/z².
    let xz = (e.u - L::splat(grid.cx)) / fx;
    let yz = (e.v - L::splat(grid.cy)) / fy;
    dp[0] = dp[0] + (du * fx * iz - dj02 * fx * iz2 * e.x_free);
    dp[1] = dp[1] + (dvv * fy * iz - dj12 * fy * iz2 * e.y_free);
    let one = L::splat(1.0);
    dp[2] = dp[2] - du * fx * xz * iz - dvv * fy * yz * iz - (dj00 * fx + dj11 * fy) * iz2
        + dj02 * fx * e.x * iz2 * (one + e.x_free)
        + dj12 * fy * e.y * iz2 * (one + e.y_free)
        - g.inverse_z * iz2;
}

/// dL/d(quaternion as stored) and dL/d(ln scale) from dL/dV.
#[inline(always)]
pub(crate) fn shape_backward<L: Lanes>(pose: &Pose, s: &Shape<L>, dv: &Symmetric<L>) -> ([L; 4], Vec3<L>) {
    let two = L::splat(2.0);
    let zero = L::splat(0.0);
    let mut d_log_scale = [zero; 3];
    // dR by columns: d(column k of A) = 2 dV a_k s_k²; d(column k of R) = Wᵀ of it.
    let mut dr = [[zero; 3]; 3];
    for k in 0..3 {
        let column = [s.axes[0][k], s.axes[1][k], s.axes[2][k]];
        let g = symmetric_times(*dv, column);
        d_log_scale[k] = two * s.variance[k] * dot(column, g);
        let scale = two * s.variance[k];
        for r in 0..3 {
            let w = [L::splat(pose.rotation[0][r]), L::splat(pose.rotation[1][r]), L::splat(pose.rotation[2][r])];
            dr[r][k] = scale * dot(w, g);
        }
    }
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
