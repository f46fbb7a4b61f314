//! The polarised field along a ray and what an interaction does to it.

use super::{Complex, Slab, antenna, fresnel};
use glam::DVec3;

/// A complex electric field vector in world axes, perpendicular to its ray.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Field {
    /// Real part.
    pub re: DVec3,
    /// Imaginary part.
    pub im: DVec3,
}

impl Field {
    /// A real field.
    pub fn real(re: DVec3) -> Self {
        Self { re, im: DVec3::ZERO }
    }

    /// The component along a real unit vector.
    pub fn along(&self, axis: DVec3) -> Complex {
        Complex::new(self.re.dot(axis), self.im.dot(axis))
    }

    fn of_components(a: Complex, axis_a: DVec3, b: Complex, axis_b: DVec3) -> Self {
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
pub fn reflect(field: &Field, direction: DVec3, normal: DVec3, slab: &Slab) -> Field {
    let reflected = reflect_unscaled(field, direction, normal, slab);
    let scale = slab.specular_amplitude();
    Field { re: reflected.re * scale, im: reflected.im * scale }
}

/// The Fresnel reflection alone, before any of it is scattered.
pub fn reflect_unscaled(field: &Field, direction: DVec3, normal: DVec3, slab: &Slab) -> Field {
    let e_s = perpendicular(direction, normal);
    let (p_i, p_r) = (direction.cross(e_s), mirrored(direction, normal).cross(e_s));
    let response = fresnel::slab_response(slab, direction.dot(normal).abs().min(1.0));
    Field::of_components(response.r_te * field.along(e_s), e_s, response.r_tm * field.along(p_i), p_r)
}

/// Straight through a slab: T_TE and T_TM on the same axes, not scaled by the scattering coefficient.
pub fn transmit(field: &Field, direction: DVec3, normal: DVec3, slab: &Slab) -> Field {
    let e_s = perpendicular(direction, normal);
    let p = direction.cross(e_s);
    let response = fresnel::slab_response(slab, direction.dot(normal).abs().min(1.0));
    Field::of_components(response.t_te * field.along(e_s), e_s, response.t_tm * field.along(p), p)
}
