//! Rooms to trace in.

use corf_raytrace::radio::{Path, RadioSettings, Search};
use corf_scene::Rng;
use corf_scene::model::{
    LightMaterial, Material, Object, Permittivity, RadioMaterial, Scattering, ScatteringPattern, Scene, Triangle,
};
use glam::Vec3;

/// Adds an axis-aligned box as one object per side, so that coplanar triangles form six faces.
pub fn add_box(scene: &mut Scene, name: &str, material: u32, min: Vec3, max: Vec3) {
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (side, at) in [("min", min[axis]), ("max", max[axis])] {
            let object = scene.objects.len() as u32;
            scene.objects.push(Object { name: format!("{name}_{}{side}", ["x", "y", "z"][axis]) });
            let corner = |a: f32, b: f32| {
                let mut p = Vec3::ZERO;
                (p[axis], p[u], p[v]) = (at, a, b);
                p
            };
            let first = scene.positions.len() as u32;
            scene.positions.extend([
                corner(min[u], min[v]),
                corner(max[u], min[v]),
                corner(max[u], max[v]),
                corner(min[u], max[v]),
            ]);
            scene.normals.extend([Vec3::Z; 4]);
            scene.uvs.extend([[0.0; 2]; 4]);
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                scene.triangles.push(Triangle { vertices: [first + a, first + b, first + c], material, object });
            }
        }
    }
}

pub fn material(name: &str, itu: &str, thickness_m: f64) -> Material {
    let radio = RadioMaterial {
        id: itu.into(),
        permittivity: Permittivity::Itu(itu.into()),
        thickness_m,
        scattering: Scattering { coefficient: 0.3, xpd: 0.0, pattern: ScatteringPattern::Lambertian },
    };
    Material { name: name.into(), light: LightMaterial::default(), radio: Some(radio) }
}

/// A 6 × 5 × 3 m room of plasterboard with a wooden box and a glass screen inside.
pub fn room() -> Scene {
    let mut scene = Scene { name: "room".into(), ..Scene::default() };
    scene.materials =
        vec![material("walls", "plasterboard", 0.013), material("box", "wood", 0.04), material("screen", "glass", 0.008)];
    add_box(&mut scene, "room", 0, Vec3::ZERO, Vec3::new(6.0, 5.0, 3.0));
    add_box(&mut scene, "box", 1, Vec3::new(2.5, 1.0, 0.0), Vec3::new(3.25, 2.0, 1.25));
    add_box(&mut scene, "screen", 2, Vec3::new(4.0, 3.0, 0.0), Vec3::new(4.01, 4.5, 2.0));
    scene
}

/// A closed room with a few boxes at random places.
pub fn random_room(seed: u64, boxes: usize) -> Scene {
    let mut rng = Rng::keyed(77, 1, seed);
    let mut number = |low: f64, high: f64| (low + (high - low) * rng.uniform_f64()) as f32;
    let mut scene = Scene { name: format!("room{seed}"), ..Scene::default() };
    scene.materials =
        vec![material("walls", "plasterboard", 0.013), material("wood", "wood", 0.04), material("glass", "glass", 0.008)];
    add_box(&mut scene, "room", 0, Vec3::ZERO, Vec3::new(6.0, 5.0, 3.0));
    for i in 0..boxes {
        let min = Vec3::new(number(0.5, 4.5), number(0.5, 3.5), number(0.1, 1.0));
        let size = Vec3::new(number(0.02, 1.2), number(0.3, 1.2), number(0.3, 1.5));
        add_box(&mut scene, &format!("box{i}"), 1 + i as u32 % 2, min, min + size);
    }
    scene
}

pub fn empty() -> Scene {
    Scene { name: "empty".into(), ..Scene::default() }
}

pub fn settings(search: Search) -> RadioSettings {
    RadioSettings { search, ..RadioSettings::default() }
}

pub fn total(paths: &[Path]) -> f64 {
    paths.iter().map(Path::power).sum()
}
