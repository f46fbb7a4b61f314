//! Bounds on the numbers in a mesh file: vertex positions, and the emission of materials and lights.

use crate::{Error, Result, Scene, bounds};
use glam::Vec3;
use std::path::Path;

/// Refuses a scene with numbers beyond physics.
///
/// # Errors
/// The first vertex too far away, and the first material or light that emits more than can be.
pub(super) fn check(scene: &Scene, path: &Path) -> Result<()> {
    let file = path.display();
    let allowed = 0.0..=bounds::MAX_COORDINATE_M;
    let beyond = |p: &Vec3| !p.is_finite() || !allowed.contains(&f64::from(p.abs().max_element()));
    if let Some((i, p)) = scene.positions.iter().enumerate().find(|(_, p)| beyond(p)) {
        let what = format!("vertex {i} lies at [{:?}, {:?}, {:?}] m", p.x, p.y, p.z);
        let help =
            "world coordinates are in metres, at most 1e6 from the origin: check the model's unit and its nodes' transforms";
        return Err(Error::invalid(file.to_string(), what, help));
    }
    let emitted = |values: [f32; 3]| values.iter().all(|v| (0.0..=bounds::MAX_EMISSION).contains(v));
    let help = format!("give 0 to {:e} W/(m² sr), or candela of a light", bounds::MAX_EMISSION);
    for material in &scene.materials {
        let surface = &material.light;
        if !emitted(surface.emissive) {
            let what = format!("it emits {:?}", surface.emissive);
            return Err(Error::invalid(format!("{file}: material \"{}\"", material.name), what, help));
        }
        let shares = surface.base_color.iter().chain([&surface.metallic, &surface.roughness, &surface.transmission]);
        if let Some(value) = shares.copied().find(|v| !(0.0..=MAX_SHARE).contains(v)) {
            let what = format!("a colour or share of {value:?}");
            return Err(Error::invalid(format!("{file}: material \"{}\"", material.name), what, "give numbers from 0 to 1"));
        }
        if !(1.0..=MAX_IOR).contains(&surface.ior) && surface.ior != 0.0 || !surface.normal_scale.is_finite() {
            let what = format!("an index of refraction of {:?} and a normal scale of {:?}", surface.ior, surface.normal_scale);
            let help = format!("give an index of 1 to {MAX_IOR} (or 0) and a finite scale");
            return Err(Error::invalid(format!("{file}: material \"{}\"", material.name), what, help));
        }
    }
    if let Some((i, light)) = scene.lights.iter().enumerate().find(|(_, light)| !emitted(light.intensity)) {
        return Err(Error::invalid(format!("{file}: light {i}"), format!("its intensity is {:?}", light.intensity), help));
    }
    Ok(())
}

/// Above 1 nothing is reflected, but files that are a little above it are common and are cut by the renderer.
const MAX_SHARE: f32 = 1e3;
/// The largest index of refraction.
const MAX_IOR: f32 = 100.0;
