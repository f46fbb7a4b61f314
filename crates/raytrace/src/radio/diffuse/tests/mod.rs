//! Truths about scattered power, against quadratures that share no code with the gathering.

mod gathering;
mod photons;
mod quadrature;

use super::*;
use crate::radio::{
    Polarization, RadioSettings, SPEED_OF_LIGHT,
    field::{antenna, fresnel, scattering},
};
use corf_scene::model::{
    LightMaterial, Material, Object, Permittivity, RadioMaterial, Scattering, ScatteringPattern, Scene, Triangle,
};
use glam::Vec3;

/// Metal is not quite a perfect mirror: |R_TM|² away from grazing is this close to 1.
const METAL_MIRROR: f64 = 1e-2;
/// Several thousand deposits and more bring a total this close.
const PHOTON_TOTAL: f64 = 1e-2;
/// Mean relative error of single lobes, all of one width, interpolated between the nodes of a table.
const LOBE_TOTAL: f64 = 1.5e-2;

fn material(itu: &str, thickness_m: f64, scattering: Scattering) -> Material {
    let radio = RadioMaterial { id: itu.into(), permittivity: Permittivity::Itu(itu.into()), thickness_m, scattering };
    Material { name: itu.into(), light: LightMaterial::default(), radio: Some(radio) }
}

fn scatters(coefficient: f64, pattern: ScatteringPattern) -> Scattering {
    Scattering { coefficient, xpd: 0.0, pattern }
}

/// A parallelogram as an object of its own.
fn quad(scene: &mut Scene, material: u32, corner: Vec3, a: Vec3, b: Vec3) {
    let (first, object) = (scene.positions.len() as u32, scene.objects.len() as u32);
    scene.objects.push(Object { name: format!("quad {object}") });
    scene.positions.extend([corner, corner + a, corner + a + b, corner + b]);
    for [i, j, k] in [[0, 1, 2], [0, 2, 3]] {
        scene.triangles.push(Triangle { vertices: [first + i, first + j, first + k], material, object });
    }
}

/// A closed room from the origin.
fn room(material: Material, size: Vec3) -> Scene {
    let mut scene = Scene { materials: vec![material], ..Scene::default() };
    let [x, y, z] = [Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z];
    for (corner, a, b) in [(Vec3::ZERO, x, y), (z, x, y), (Vec3::ZERO, y, z), (x, y, z), (Vec3::ZERO, z, x), (y, z, x)] {
        quad(&mut scene, 0, corner, a, b);
    }
    scene
}

fn settings(max_interactions: usize) -> RadioSettings {
    RadioSettings { max_interactions, ..RadioSettings::default() }
}

fn sampling() -> DiffuseSettings {
    DiffuseSettings { directions: 100_000, patch_size_m: 0.1, min_mirror_sr: 0.0, photons: 500_000, ..DiffuseSettings::default() }
}

fn power(field: &DiffuseField<'_, '_>, rx: DVec3, belongs: impl Fn(&Contribution) -> bool) -> f64 {
    field.contributions(rx).unwrap().iter().filter(|(_, c)| belongs(c)).map(|(_, c)| c.power).sum()
}

/// The scattered share of a linearly polarised wave: F·f_s/F × S²Γ² towards `out`, for a plate of unit `normal` on the wave's side.
fn scattered(slab: &crate::radio::Slab, k: DVec3, axis: DVec3, normal: DVec3, out: DVec3) -> f64 {
    let (cos_i, cos_s) = (-k.dot(normal), out.dot(normal));
    if cos_i <= 0.0 || cos_s <= 0.0 {
        return 0.0;
    }
    let response = fresnel::slab_response(slab, cos_i);
    let te = axis.dot(k.cross(normal).normalize_or(axis)).powi(2);
    let gamma2 = response.r_te.norm_squared() * te + response.r_tm.norm_squared() * (1.0 - te);
    let pattern = slab.scattering.pattern;
    let mirrored = k - normal * (2.0 * k.dot(normal));
    slab.scattering.coefficient.powi(2) * gamma2 * scattering::lobe(pattern, cos_s, out.dot(mirrored), -out.dot(k)) * cos_i
        / scattering::normalisation(pattern, cos_i)
}
