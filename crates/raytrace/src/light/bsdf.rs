//! The reflection model: glTF 2.0 metallic-roughness (appendix B) with an energy-conserving diffuse term.
//!
//! Directions are unit vectors in the shading frame, z the normal, pointing away from the surface. The specular lobe is GGX with
//! height-correlated Smith shadowing and Schlick's Fresnel term, single scattering. Under it lies a Lambertian base that receives what
//! the specular lobe leaves, in the reciprocal form of Kelemen and Szirmay-Kalos (2001):
//!
//! `f(v, l) = D·G₂·F / (4 v_z l_z) + c_diff/π · (1 − E(v))·(1 − E(l)) / (1 − Ē)`
//!
//! where `E` is the specular lobe's directional albedo and `Ē` its cosine-weighted mean. Appendix B's own mix, `(1 − F(v·h))·c_diff/π`,
//! reflects more than it receives at grazing angles (up to 1.9×) and would make light.

use super::luminance;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};
use std::sync::OnceLock;

/// `alpha = roughness²` is at least this: a mirror is a very narrow lobe, not a special case.
pub(super) const MIN_ALPHA: f32 = 1e-3;

/// Bounds of [`Bsdf::is_nearly_diffuse`]: least `roughness²`, and largest share of the specular lobe in the reflected light.
const WIDE_ALPHA: f32 = 0.4;
const WEAK_SHARE: f32 = 0.15;
/// Least `roughness²` for [`Bsdf::wide_highlight`].
const VERY_WIDE_ALPHA: f32 = 0.64;

/// A point's reflection: linear colours and `alpha`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bsdf {
    diffuse: Vec3,
    f0: Vec3,
    alpha: f32,
    /// `1 / (1 − Ē)`, of the largest channel of `f0`.
    diffuse_scale: f32,
    /// `1 − E(v)`, likewise.
    base_transmittance: f32,
    /// The largest channel of `f0`.
    f0_max: f32,
    /// Probability of sampling the specular lobe.
    specular_probability: f32,
    /// Directional albedo: share of uniform incident light that is reflected towards the viewing direction v, per colour channel.
    pub albedo: Vec3,
    v: Vec3,
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct BsdfSample {
    pub l: Vec3,
    /// `f(v, l)·l_z / pdf`.
    pub weight: Vec3,
    /// Per steradian.
    pub pdf: f32,
}

impl Bsdf {
    /// `base_color`, `metallic`, `roughness` and `ior` as in glTF; `v` with v_z > 0.
    pub fn new(base_color: Vec3, metallic: f32, roughness: f32, ior: f32, v: Vec3) -> Self {
        let dielectric_f0 = ((ior - 1.0) / (ior + 1.0)).powi(2);
        let f0 = Vec3::splat(dielectric_f0).lerp(base_color, metallic);
        let diffuse = base_color * (1.0 - metallic);
        let alpha = (roughness * roughness).max(MIN_ALPHA);
        let f0_max = f0.max_element();
        let (scale, bias) = albedo_table().at(v.z, alpha);
        let specular_albedo = f0 * scale + Vec3::splat(bias);
        let base_transmittance = (1.0 - (f0_max * scale + bias)).max(0.0);
        let mean = albedo_table().mean(alpha);
        let diffuse_scale = 1.0 / (1.0 - (f0_max * mean.0 + mean.1)).max(1e-4);
        let diffuse_albedo = diffuse * base_transmittance;
        let (s, d) = (luminance(specular_albedo), luminance(diffuse_albedo));
        // Neither lobe is starved while both exist.
        let specular_probability = if d <= 0.0 { 1.0 } else { (s / (s + d)).clamp(0.1, 0.9) };
        let albedo = specular_albedo + diffuse_albedo;
        Self { diffuse, f0, alpha, diffuse_scale, base_transmittance, f0_max, specular_probability, albedo, v }
    }

    /// `f(v, l)·l_z` and the density (1/sr) with which [`Bsdf::sample`] chooses `l`; zero below the surface.
    pub fn evaluate(&self, l: Vec3) -> (Vec3, f32) {
        let (specular, specular_pdf) = self.evaluate_specular(l);
        if l.z <= 0.0 || self.v.z <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let diffuse = self.diffuse * (FRAC_1_PI * l.z * self.coupling(l.z));
        let p = self.specular_probability;
        (specular + diffuse, p * specular_pdf + (1.0 - p) * FRAC_1_PI * l.z)
    }

    /// [`Bsdf::evaluate`] of the specular lobe alone, with the density of [`Bsdf::sample_specular`].
    pub fn evaluate_specular(&self, l: Vec3) -> (Vec3, f32) {
        let v = self.v;
        if l.z <= 0.0 || v.z <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let h = (v + l).normalize_or(Vec3::Z);
        let v_h = v.dot(h).clamp(0.0, 1.0);
        let a2 = self.alpha * self.alpha;
        let d = ggx_d(h.z, a2);
        let (lambda_v, lambda_l) = (smith_lambda(v.z, a2), smith_lambda(l.z, a2));
        // D·G₂·F·l_z / (4 v_z l_z), G₂ = 1 / (1 + Λ(v) + Λ(l)).
        let specular = self.fresnel(v_h) * (d / ((1.0 + lambda_v + lambda_l) * 4.0 * v.z));
        // Density of visible normals, D·G₁(v)·(v·h)/v_z, over the Jacobian 4 v·h.
        (specular, d / ((1.0 + lambda_v) * 4.0 * v.z))
    }

    /// A direction of the specular lobe for a random point.
    pub fn sample_specular(&self, u: [f32; 2]) -> Option<BsdfSample> {
        let l = self.mirrored(u);
        let (value, pdf) = self.evaluate_specular(l);
        (pdf > 0.0 && pdf.is_finite()).then(|| BsdfSample { l, weight: value / pdf, pdf })
    }

    /// The viewer's direction mirrored at a visible normal.
    fn mirrored(&self, u: [f32; 2]) -> Vec3 {
        let h = sample_visible_normal(self.v, self.alpha, u);
        2.0 * self.v.dot(h) * h - self.v
    }

    /// `c_diff·(1 − E(v))`: what the base sends towards the viewer of the light it received, weighted as by [`Bsdf::received`].
    pub fn diffuse_toward_viewer(&self) -> Vec3 {
        self.diffuse * self.base_transmittance
    }

    /// `(1 − E(l)) / (1 − Ē)`: the weight with which the base receives light from elevation cosine `l_z`. It does not depend on the
    /// viewer, so that the base's light can be worked out once for all views.
    pub fn received(&self, l_z: f32) -> f32 {
        let (scale, bias) = albedo_table().at(l_z, self.alpha);
        (1.0 - (self.f0_max * scale + bias)).max(0.0) * self.diffuse_scale
    }

    /// The specular lobe's share of what is reflected under uniform light, in luminance.
    pub fn specular_share(&self) -> f32 {
        let d = luminance(self.diffuse_toward_viewer());
        let s = luminance(self.albedo) - d;
        if s <= 0.0 { 0.0 } else { s / (s + d) }
    }

    /// Whether the specular lobe is so wide and weak that, seen by a ray that stands for a wide cone, it may send back what it receives
    /// like the base does: with its own albedo, in all directions.
    pub fn is_nearly_diffuse(&self) -> bool {
        self.alpha >= WIDE_ALPHA && self.specular_share() < WEAK_SHARE
    }

    /// Dominant direction of a lobe as wide and weak as [`Bsdf::is_nearly_diffuse`] asks and wider still: the direction (shading frame) about which
    /// it gathers, taken for a cosine lobe (the dominant direction of Lagarde and de Rousiers 2014, *Moving Frostbite to PBR*), and its albedo.
    pub fn wide_highlight(&self) -> Option<(Vec3, Vec3)> {
        (self.alpha >= VERY_WIDE_ALPHA && self.specular_share() < WEAK_SHARE).then(|| {
            let mirrored = Vec3::new(-self.v.x, -self.v.y, self.v.z);
            let smooth = 1.0 - self.alpha;
            let towards = smooth * (smooth.sqrt() + self.alpha);
            (Vec3::Z.lerp(mirrored, towards).normalize_or(Vec3::Z), self.albedo - self.diffuse_toward_viewer())
        })
    }

    /// `roughness²`.
    pub fn alpha(&self) -> f32 {
        self.alpha
    }

    /// A direction for a random lobe choice and point.
    pub fn sample(&self, lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let l = if lobe < self.specular_probability { self.mirrored(u) } else { sample_cosine(u) };
        let (value, pdf) = self.evaluate(l);
        (pdf > 0.0 && pdf.is_finite()).then(|| BsdfSample { l, weight: value / pdf, pdf })
    }

    /// Schlick: F₀ + (1 − F₀)(1 − v·h)⁵.
    fn fresnel(&self, v_h: f32) -> Vec3 {
        let m = 1.0 - v_h;
        let m5 = m * m * m * m * m;
        self.f0 + (Vec3::ONE - self.f0) * m5
    }

    /// (1 − E(v))(1 − E(l)) / (1 − Ē).
    fn coupling(&self, l_z: f32) -> f32 {
        self.base_transmittance * self.received(l_z)
    }
}

/// GGX (Trowbridge–Reitz) distribution of normals, isotropic.
fn ggx_d(h_z: f32, a2: f32) -> f32 {
    // (h_z² (a² − 1) + 1) written without cancellation at h_z → 1.
    let c2 = h_z * h_z;
    let denominator = c2 * a2 + (1.0 - c2).max(0.0);
    a2 * FRAC_1_PI / (denominator * denominator).max(1e-30)
}

/// Smith's Λ of GGX.
fn smith_lambda(z: f32, a2: f32) -> f32 {
    let c2 = (z * z).max(1e-12);
    0.5 * ((1.0 + a2 * (1.0 - c2).max(0.0) / c2).sqrt() - 1.0)
}

/// A cosine-distributed direction.
pub(super) fn sample_cosine(u: [f32; 2]) -> Vec3 {
    let (r, phi) = (u[0].sqrt(), TAU * u[1]);
    let (sin, cos) = phi.sin_cos();
    Vec3::new(r * cos, r * sin, (1.0 - u[0]).max(0.0).sqrt())
}

/// A normal of the GGX surface as seen from `v` (density D·G₁·(v·h)/v_z), by the spherical-cap construction of Dupuy and Benyoub
/// (*Sampling Visible GGX Normals with Spherical Caps*, 2023).
fn sample_visible_normal(v: Vec3, alpha: f32, u: [f32; 2]) -> Vec3 {
    let stretched = Vec3::new(v.x * alpha, v.y * alpha, v.z).normalize();
    let phi = TAU * u[0];
    let z = (1.0 - u[1]) * (1.0 + stretched.z) - stretched.z;
    let (sin, cos) = phi.sin_cos();
    let s = Vec2::new(cos, sin) * (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let h = s.extend(z) + stretched;
    Vec3::new(h.x * alpha, h.y * alpha, h.z.max(1e-9)).normalize()
}

/// Reflectance of an unpolarised dielectric interface at incidence cosine `cos` from outside.
pub(super) fn fresnel_dielectric(cos: f32, ior: f32) -> f32 {
    let sin2_t = (1.0 - cos * cos).max(0.0) / (ior * ior);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (ior * cos - cos_t) / (ior * cos + cos_t);
    let perpendicular = (cos - ior * cos_t) / (cos + ior * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Reflectance of a thin pane, both faces and all reflections between them: 2R / (1 + R).
pub(super) fn fresnel_pane(cos: f32, ior: f32) -> f32 {
    let r = fresnel_dielectric(cos, ior);
    2.0 * r / (1.0 + r)
}

/// The specular lobe's albedo as `E = F₀·scale + bias`, tabulated over v_z and roughness.
struct AlbedoTable {
    entries: Vec<(f32, f32)>,
    means: Vec<(f32, f32)>,
}

const TABLE_COSINES: usize = 64;
const TABLE_ROUGHNESSES: usize = 32;
/// Hammersley points per table entry. The share of light that a lobe's tail sends below the horizon is a step in the integrand, which
/// this many points resolve to about 1e-3.
const TABLE_POINTS: u32 = 2048;

/// Tables of the specular lobe's albedo (scale, bias): over cosines row by row of roughness, and the means of the rows.
#[cfg(feature = "gpu")]
pub(super) fn albedo_tables() -> [&'static [(f32, f32)]; 2] {
    let table = albedo_table();
    [&table.entries, &table.means]
}

/// Filled on first use, by one thread: parallel work under a lock could wait for itself.
fn albedo_table() -> &'static AlbedoTable {
    static TABLE: OnceLock<AlbedoTable> = OnceLock::new();
    TABLE.get_or_init(AlbedoTable::integrate)
}

impl AlbedoTable {
    fn integrate() -> Self {
        let alpha = |j: usize| (j as f32 / (TABLE_ROUGHNESSES - 1) as f32).powi(2).max(MIN_ALPHA);
        let entries: Vec<(f32, f32)> = (0..TABLE_COSINES * TABLE_ROUGHNESSES)
            .map(|k| Self::entry(Self::cosine(k % TABLE_COSINES), alpha(k / TABLE_COSINES)))
            .collect();
        let mut means = Vec::with_capacity(TABLE_ROUGHNESSES);
        for row in entries.chunks(TABLE_COSINES) {
            // Ē = 2 ∫ E(μ) μ dμ, trapezoids.
            let mut mean = (0.0, 0.0);
            for i in 1..TABLE_COSINES {
                let (m0, m1) = (Self::cosine(i - 1), Self::cosine(i));
                mean.0 += (row[i - 1].0 * m0 + row[i].0 * m1) * (m1 - m0);
                mean.1 += (row[i - 1].1 * m0 + row[i].1 * m1) * (m1 - m0);
            }
            means.push(mean);
        }
        Self { entries, means }
    }

    fn cosine(i: usize) -> f32 {
        (i as f32 / (TABLE_COSINES - 1) as f32).max(1e-3)
    }

    fn entry(v_z: f32, alpha: f32) -> (f32, f32) {
        let v = Vec3::new((1.0 - v_z * v_z).max(0.0).sqrt(), 0.0, v_z);
        let a2 = alpha * alpha;
        let (mut scale, mut bias) = (0.0f64, 0.0f64);
        for i in 0..TABLE_POINTS {
            let u = [(i.reverse_bits() >> 8) as f32 * (1.0 / 16_777_216.0), (i as f32 + 0.5) / TABLE_POINTS as f32];
            let h = sample_visible_normal(v, alpha, u);
            let l = 2.0 * v.dot(h) * h - v;
            if l.z > 0.0 {
                let (lambda_v, lambda_l) = (smith_lambda(v.z, a2), smith_lambda(l.z, a2));
                let weight = f64::from((1.0 + lambda_v) / (1.0 + lambda_v + lambda_l));
                let m5 = f64::from((1.0 - v.dot(h)).clamp(0.0, 1.0)).powi(5);
                scale += weight * (1.0 - m5);
                bias += weight * m5;
            }
        }
        let n = f64::from(TABLE_POINTS);
        ((scale / n) as f32, (bias / n) as f32)
    }

    #[inline]
    fn row(alpha: f32) -> (usize, f32) {
        let y = alpha.sqrt().min(1.0) * (TABLE_ROUGHNESSES - 1) as f32;
        let j = (y as usize).min(TABLE_ROUGHNESSES - 2);
        (j, y - j as f32)
    }

    #[inline]
    fn at(&self, v_z: f32, alpha: f32) -> (f32, f32) {
        let x = v_z.clamp(0.0, 1.0) * (TABLE_COSINES - 1) as f32;
        let i = (x as usize).min(TABLE_COSINES - 2);
        let fx = x - i as f32;
        let (j, fy) = Self::row(alpha);
        let e = |i: usize, j: usize| self.entries[j * TABLE_COSINES + i];
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let (a, b, c, d) = (e(i, j), e(i + 1, j), e(i, j + 1), e(i + 1, j + 1));
        (mix(mix(a.0, b.0, fx), mix(c.0, d.0, fx), fy), mix(mix(a.1, b.1, fx), mix(c.1, d.1, fx), fy))
    }

    fn mean(&self, alpha: f32) -> (f32, f32) {
        let (j, fy) = Self::row(alpha);
        let (a, b) = (self.means[j], self.means[j + 1]);
        (a.0 + (b.0 - a.0) * fy, a.1 + (b.1 - a.1) * fy)
    }
}

#[cfg(test)]
#[path = "bsdf_tests.rs"]
mod tests;
