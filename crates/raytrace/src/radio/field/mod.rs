//! The polarised field along a ray and what an interaction does to it.

pub mod antenna;
pub(in crate::radio) mod complex;
pub mod fresnel;
pub mod materials;
pub mod scattering;
pub(in crate::radio) mod tables;

use super::Complex;
use fresnel::SlabResponse;
use glam::DVec3;

/// A complex electric field vector in world axes, perpendicular to its ray.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ElectricField {
    /// Real part.
    pub re: DVec3,
    /// Imaginary part.
    pub im: DVec3,
}

impl ElectricField {
    /// A real field.
    pub fn real(re: DVec3) -> Self {
        Self { re, im: DVec3::ZERO }
    }

    /// The component along a real unit vector.
    pub fn along(&self, axis: DVec3) -> Complex {
        Complex::new(self.re.dot(axis), self.im.dot(axis))
    }

    /// ‖E‖².
    #[inline]
    pub fn norm_squared(&self) -> f64 {
        self.re.length_squared() + self.im.length_squared()
    }

    /// The field times a real number.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { re: self.re * factor, im: self.im * factor }
    }

    /// `a·axis_a + b·axis_b`.
    pub fn of_components(a: Complex, axis_a: DVec3, b: Complex, axis_b: DVec3) -> Self {
        Self { re: axis_a * a.re + axis_b * b.re, im: axis_a * a.im + axis_b * b.im }
    }
}

/// e_s = k × n / |k × n|, perpendicular to the plane of incidence; at normal incidence any perpendicular of k serves.
fn perpendicular(direction: DVec3, normal: DVec3) -> DVec3 {
    let cross = direction.cross(normal);
    let length = cross.length();
    if length > 1e-12 { cross / length } else { antenna::theta_hat(direction) }
}

/// The mirrored direction k_r = k − 2(k·n)n.
pub fn mirrored(direction: DVec3, normal: DVec3) -> DVec3 {
    direction - normal * (2.0 * direction.dot(normal))
}

/// Specular reflection: E_r = √(1−S²)·[R_TE(E·e_s)e_s + R_TM(E·p_i)p_r], p = k × e_s.
pub fn reflect(
    field: &ElectricField,
    direction: DVec3,
    normal: DVec3,
    response: &SlabResponse,
    specular_amplitude: f64,
) -> ElectricField {
    let e_s = perpendicular(direction, normal);
    let (p_i, p_r) = (direction.cross(e_s), mirrored(direction, normal).cross(e_s));
    let (r_te, r_tm) = (response.r_te * specular_amplitude, response.r_tm * specular_amplitude);
    ElectricField::of_components(r_te * field.along(e_s), e_s, r_tm * field.along(p_i), p_r)
}

/// Straight through a slab: T_TE and T_TM on the same axes, not scaled by the scattering coefficient.
pub fn transmit(field: &ElectricField, direction: DVec3, normal: DVec3, response: &SlabResponse) -> ElectricField {
    let e_s = perpendicular(direction, normal);
    let p = direction.cross(e_s);
    ElectricField::of_components(response.t_te * field.along(e_s), e_s, response.t_tm * field.along(p), p)
}

/// Γ² = ‖E_r‖²/‖E_i‖² of the Fresnel reflection: the share of a field's power that is reflected, before any of it is scattered;
/// `te` = |R_TE|², `tm` = |R_TM|².
#[inline]
pub fn reflectivity(field: &ElectricField, direction: DVec3, normal: DVec3, te: f64, tm: f64) -> f64 {
    let cross = direction.cross(normal);
    let (length2, power) = (cross.length_squared(), field.norm_squared());
    if length2 < 1e-24 || power == 0.0 {
        return te;
    }
    // The share of the power that is perpendicular to the plane of incidence.
    let share = field.along(cross).norm_squared() / (length2 * power);
    tm + (te - tm) * share
}

/// cosθ_i of a unit direction on a plane, in [0, 1].
pub fn cos_incidence(direction: DVec3, normal: DVec3) -> f64 {
    direction.dot(normal).abs().min(1.0)
}
