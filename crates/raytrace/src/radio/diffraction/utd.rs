//! The uniform theory of diffraction at a wedge of two slabs: Kouyoumjian and Pathak 1974 for the four terms, finite-thickness slabs
//! for the two reflections.

use super::super::field::{self, ElectricField};
use super::super::{Complex, Slab};
use super::erfcx::erfcx_diagonal;
use crate::radio::field::fresnel;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_4, PI, TAU};

/// A ray that diffracts at a wedge, seen from the wedge.
#[derive(Clone, Copy, Debug)]
pub struct EdgeRay {
    /// Unit vector along the edge; the normal of face 0 × `edge` points from the edge into face 0.
    pub edge: DVec3,
    /// Angle of the open space around the edge, radians: nπ.
    pub exterior_angle_rad: f64,
    /// Unit direction of propagation before the edge.
    pub incident: DVec3,
    /// Unit direction of propagation after the edge.
    pub diffracted: DVec3,
    /// Unfolded length from the source to the edge, s′, metres.
    pub source_m: f64,
    /// Unfolded length from the edge to the receiver, s, metres.
    pub target_m: f64,
}

/// Model of the two faces' reflections in the diffraction coefficient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DiffractionModel {
    /// D = D₁ + D₂ + R₀D₄ + R_nD₃ (Luebbers 1984; ITU-R P.526-15 §4.5): R₀ at the incident ray's angle with face 0, R_n at the
    /// diffracted ray's angle with face n. The total field is continuous across shadow and reflection boundaries for any material, and on
    /// a conductor it is that of Kouyoumjian and Pathak.
    #[default]
    ItuP526,
    /// The coefficient of sionna-rt 2.2.0, for comparison with it: R₀(D₁ − D₄) + R_n(D₂ − D₃) with both at the incident ray's angles, and
    /// −1 for R_n when the source does not see face n. Its R₀ terms have the wrong sign: the field jumps at the reflection boundary of a
    /// lit face (`a` is −0.49 of the reflected ray's on the lit side of a metal bar where +½ is due) and is not reciprocal on a conductor.
    Sionna,
}

/// A face of the wedge.
#[derive(Clone, Copy, Debug)]
pub struct EdgeFace<'s> {
    /// Material and thickness of the face.
    pub slab: &'s Slab,
    /// Outward unit normal.
    pub normal: DVec3,
}

impl EdgeFace<'_> {
    /// The field mirrored by the face, its specular amplitude √(1 − S²) included.
    fn reflect(&self, field: &ElectricField, direction: DVec3) -> ElectricField {
        let response = fresnel::slab_response(self.slab, field::cos_incidence(direction, self.normal));
        field::reflect(field, direction, self.normal, &response, self.slab.specular_amplitude())
    }
}

/// The diffracted field, spreading 1/√(s s′(s + s′)) and propagation phase aside; face 0 is the one that the source sees.
pub fn diffract(
    field: &ElectricField,
    ray: &EdgeRay,
    faces: &[EdgeFace<'_>; 2],
    wavelength_m: f64,
    model: DiffractionModel,
) -> ElectricField {
    let (k_i, k_d) = (ray.incident, ray.diffracted);
    let azimuths = Azimuths::of(ray, faces[0].normal);
    let d = terms(ray, &azimuths, wavelength_m);
    let straight = edge_components(field, k_i, ray.edge);
    let on_0 = edge_components(&faces[0].reflect(field, k_i), field::mirrored(k_i, faces[0].normal), ray.edge);
    let components = match model {
        DiffractionModel::ItuP526 => {
            // The field that face n mirrors into the diffracted ray.
            let before = field::mirrored(k_d, faces[1].normal);
            let carried = of_edge_components(straight, before, ray.edge);
            let on_n = edge_components(&faces[1].reflect(&carried, before), k_d, ray.edge);
            [0, 1].map(|i| straight[i] * (d[0] + d[1]) + on_0[i] * d[3] + on_n[i] * d[2])
        }
        DiffractionModel::Sionna => {
            let lit = ray.exterior_angle_rad <= PI + azimuths.incident;
            let on_n = if lit {
                edge_components(&faces[1].reflect(field, k_i), field::mirrored(k_i, faces[1].normal), ray.edge)
            } else {
                straight
            };
            [0, 1].map(|i| on_0[i] * (d[0] - d[3]) + on_n[i] * (d[1] - d[2]))
        }
    };
    of_edge_components(components, k_d, ray.edge)
}

/// The edge-fixed axes of a ray: φ̂ = k × e / |k × e| and k × φ̂.
fn edge_axes(k: DVec3, edge: DVec3) -> [DVec3; 2] {
    let phi = k.cross(edge).normalize();
    [phi, k.cross(phi)]
}

fn edge_components(field: &ElectricField, k: DVec3, edge: DVec3) -> [Complex; 2] {
    edge_axes(k, edge).map(|axis| field.along(axis))
}

fn of_edge_components(components: [Complex; 2], k: DVec3, edge: DVec3) -> ElectricField {
    let axes = edge_axes(k, edge);
    ElectricField::of_components(components[0], axes[0], components[1], axes[1])
}

/// Azimuths about the edge from face 0, radians in [0, 2π): of the source, φ′, and of the receiver, φ.
struct Azimuths {
    incident: f64,
    diffracted: f64,
}

impl Azimuths {
    fn of(ray: &EdgeRay, n0: DVec3) -> Self {
        let into_face = n0.cross(ray.edge);
        let azimuth = |v: DVec3| v.dot(n0).atan2(v.dot(into_face)).rem_euclid(TAU);
        Self { incident: azimuth(-ray.incident), diffracted: azimuth(ray.diffracted) }
    }
}

/// D₁ … D₄: −e^{−jπ/4}/(2n√(2πk)·sinβ₀) · cot((π ± (φ ∓ φ′))/2n) · F(kL·a±(φ ∓ φ′)).
fn terms(ray: &EdgeRay, azimuths: &Azimuths, wavelength_m: f64) -> [Complex; 4] {
    let n = ray.exterior_angle_rad / PI;
    let wavenumber = TAU / wavelength_m;
    let along = ray.incident.dot(ray.edge);
    let sin2_beta = 1.0 - along * along;
    // L = s·s′/(s + s′)·sin²β₀ for a spherical wave.
    let k_l = wavenumber * ray.source_m * ray.target_m / (ray.source_m + ray.target_m) * sin2_beta;
    let factor = Complex::new(0.0, -FRAC_PI_4).exp() * (-1.0 / (2.0 * n * (TAU * wavenumber * sin2_beta).sqrt()));
    let (difference, sum) = (azimuths.diffracted - azimuths.incident, azimuths.diffracted + azimuths.incident);
    [difference, -difference, sum, -sum].map(|beta| factor * cot_times_transition(beta, n, k_l))
}

/// cot((π + β)/2n)·F(kL·a(β)), a = 2cos²((2πnN − β)/2) with N the integer that brings 2πnN nearest to π + β.
///
/// With ε = π + β − 2πnN, the angle from the nearest boundary: a = 2sin²(ε/2), and cot(ε/2n)·√a stays finite there.
fn cot_times_transition(beta: f64, n: f64, k_l: f64) -> Complex {
    let period = TAU * n;
    let from_boundary = PI + beta - period * ((PI + beta) / period).round();
    let root_x = (2.0 * k_l).sqrt() * (0.5 * from_boundary).sin().abs();
    let half = from_boundary / (2.0 * n);
    let cot_root_x = if half == 0.0 { n * (2.0 * k_l).sqrt() } else { root_x * half.cos() / half.sin() };
    reduced_transition(root_x) * cot_root_x
}

/// F(x)/√x = √π·e^{jπ/4}·erfcx(e^{jπ/4}√x), from F(x) = 2j√x·e^{jx}·∫_{√x}^∞ e^{−jτ²}dτ.
fn reduced_transition(root_x: f64) -> Complex {
    Complex::new(0.0, FRAC_PI_4).exp() * PI.sqrt() * erfcx_diagonal(root_x)
}

/// The UTD transition function F(x), x ≥ 0.
pub fn transition(x: f64) -> Complex {
    reduced_transition(x.sqrt()) * x.sqrt()
}

/// Diffraction point on an edge's line by the law of diffraction (Keller cone), metres along it: the way between the two points is
/// stationary there. Each point is given by its distance along the line and its distance from it, both half-planes unfolded into one.
pub fn keller_point(source: [f64; 2], target: [f64; 2]) -> f64 {
    source[0] + (target[0] - source[0]) * source[1] / (source[1] + target[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transition_function_has_its_known_limits() {
        // F(x) → √(πx)e^{j(π/4 + x)} for small x and 1 + j/(2x) − 3/(4x²) for large x (Kouyoumjian and Pathak, eq. 26 f.).
        for x in [1e-12, 1e-9, 1e-7] {
            let expected = Complex::new(0.0, FRAC_PI_4 + x).exp() * (PI * x).sqrt();
            assert!((transition(x) - expected).norm() <= 3.0 * x, "{x}");
        }
        for x in [1e2, 1e4, 1e6] {
            let expected = Complex::new(1.0 - 0.75 / (x * x), 0.5 / x);
            assert!((transition(x) - expected).norm() <= 2.0 / (x * x * x) + 1e-14, "{x} {:?}", transition(x));
        }
    }

    #[test]
    fn the_keller_point_makes_equal_angles() {
        let (o, e) = (DVec3::new(0.3, -0.2, 0.1), DVec3::new(1.0, 2.0, -0.5).normalize());
        let (s, t) = (DVec3::new(2.0, 0.4, 1.0), DVec3::new(-1.0, 1.5, 3.0));
        let cylindrical = |p: DVec3| [(p - o).dot(e), (p - o).reject_from(e).length()];
        let p = o + e * keller_point(cylindrical(s), cylindrical(t));
        let (k_i, k_d) = ((p - s).normalize(), (t - p).normalize());
        assert!((k_i.dot(e) - k_d.dot(e)).abs() < 1e-14);
    }
}
