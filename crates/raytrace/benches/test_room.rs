//! A furnished room built by rule, for timing and looking: textured floor, ceiling panels, pillars, spheres, glass, a metal desk.

use corf_scene::model::{Filter, LightMaterial, Material, Object, Texture, TextureRef, Triangle, Wrap};
use corf_scene::{Raster, Rng, Scene};
use glam::{Affine2, Vec3};

fn material(scene: &mut Scene, name: &str, light: LightMaterial) -> u32 {
    scene.materials.push(Material { name: name.into(), light, radio: None });
    scene.materials.len() as u32 - 1
}

fn quad(scene: &mut Scene, p: Vec3, a: Vec3, b: Vec3, material: u32) {
    let first = scene.positions.len() as u32;
    scene.positions.extend([p, p + a, p + a + b, p + b]);
    scene.normals.extend([a.cross(b).normalize(); 4]);
    let (u, v) = (a.length(), b.length());
    scene.uvs.extend([[0.0, 0.0], [u, 0.0], [u, v], [0.0, v]]);
    let object = scene.objects.len() as u32;
    scene.objects.push(Object { name: format!("object {object}") });
    for vertices in [[first, first + 1, first + 2], [first, first + 2, first + 3]] {
        scene.triangles.push(Triangle { vertices, material, object });
    }
}

fn cuboid(scene: &mut Scene, low: Vec3, size: Vec3, material: u32) {
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    quad(scene, low, y, x, material);
    quad(scene, low + z, x, y, material);
    quad(scene, low, x, z, material);
    quad(scene, low + y, z, x, material);
    quad(scene, low, z, y, material);
    quad(scene, low + x, y, z, material);
}

fn sphere(scene: &mut Scene, centre: Vec3, radius: f32, rings: u32, material: u32) {
    let first = scene.positions.len() as u32;
    for i in 0..=rings {
        for j in 0..=2 * rings {
            let (theta, phi) = (std::f32::consts::PI * i as f32 / rings as f32, std::f32::consts::PI * j as f32 / rings as f32);
            let n = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            scene.positions.push(centre + n * radius);
            scene.normals.push(n);
            scene.uvs.push([j as f32 / rings as f32, i as f32 / rings as f32]);
        }
    }
    let object = scene.objects.len() as u32;
    scene.objects.push(Object { name: format!("sphere {object}") });
    for i in 0..rings {
        for j in 0..2 * rings {
            let a = first + i * (2 * rings + 1) + j;
            let b = a + 2 * rings + 1;
            for vertices in [[a, b, b + 1], [a, b + 1, a + 1]] {
                scene.triangles.push(Triangle { vertices, material, object });
            }
        }
    }
}

/// A 12 × 10 × 3.4 m room with some 60 000 triangles and 30 emitting ones.
pub fn test_room() -> Scene {
    let mut scene = Scene { name: "test room".into(), ..Scene::default() };
    let mut rng = Rng::keyed(1, 1, 1);
    let tiles = Raster::from_fn(128, 128, |x, y| {
        let grout = x % 64 < 2 || y % 64 < 2;
        let shade = if (x / 64 + y / 64) % 2 == 0 { 190.0 } else { 120.0 } + 24.0 * (rng.uniform() - 0.5);
        let c = if grout { 60 } else { shade as u8 };
        [c, c, (f32::from(c) * 0.9) as u8, 255]
    });
    scene.textures.push(Texture { name: "tiles".into(), texels: tiles, wrap: [Wrap::Repeat; 2], filter: Filter::Linear });
    let d = LightMaterial::default;
    let texture = Some(TextureRef { texture: 0, uv_from_uv: Affine2::IDENTITY });
    let floor = material(
        &mut scene,
        "floor",
        LightMaterial { base_color: [1.0; 3], base_color_texture: texture, roughness: 0.35, ..d() },
    );
    let wall = material(&mut scene, "wall", LightMaterial { base_color: [0.75, 0.73, 0.7], roughness: 0.9, ..d() });
    let panel = material(
        &mut scene,
        "panel",
        LightMaterial { base_color: [0.8; 3], emissive: [9.0, 8.6, 8.0], double_sided: false, ..d() },
    );
    let wood = material(&mut scene, "wood", LightMaterial { base_color: [0.45, 0.27, 0.13], roughness: 0.5, ..d() });
    let metal =
        material(&mut scene, "metal", LightMaterial { base_color: [0.9, 0.88, 0.85], metallic: 1.0, roughness: 0.25, ..d() });
    let glass =
        material(&mut scene, "glass", LightMaterial { base_color: [0.92, 0.97, 0.95], transmission: 1.0, roughness: 0.0, ..d() });
    let red = material(&mut scene, "red", LightMaterial { base_color: [0.7, 0.1, 0.08], roughness: 0.6, ..d() });

    let size = Vec3::new(12.0, 10.0, 3.4);
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    quad(&mut scene, Vec3::ZERO, x, y, floor);
    quad(&mut scene, z, y, x, wall);
    quad(&mut scene, Vec3::ZERO, z, x, wall);
    quad(&mut scene, y, x, z, wall);
    quad(&mut scene, Vec3::ZERO, y, z, wall);
    quad(&mut scene, x, z, y, wall);
    for i in 0..5 {
        for j in 0..3 {
            let p = Vec3::new(1.2 + 2.2 * i as f32, 1.6 + 3.0 * j as f32, 3.38);
            quad(&mut scene, p, Vec3::Y * 0.6, Vec3::X * 1.2, panel);
        }
    }
    for p in [Vec3::new(3.5, 3.2, 0.0), Vec3::new(3.5, 6.5, 0.0), Vec3::new(8.5, 3.2, 0.0), Vec3::new(8.5, 6.5, 0.0)] {
        cuboid(&mut scene, p, Vec3::new(0.4, 0.4, 3.4), wall);
    }
    cuboid(&mut scene, Vec3::new(5.0, 8.0, 0.0), Vec3::new(2.5, 0.7, 1.1), wood);
    cuboid(&mut scene, Vec3::new(5.0, 7.95, 1.1), Vec3::new(2.5, 0.8, 0.04), metal);
    quad(&mut scene, Vec3::new(6.5, 0.5, 0.0), Vec3::Y * 2.5, Vec3::Z * 2.4, glass);
    for k in 0..10 {
        let p = Vec3::new(1.0 + 1.1 * k as f32, 1.0 + 0.8 * (k % 3) as f32, 0.0);
        cuboid(&mut scene, p, Vec3::new(0.45, 0.45, 0.45), if k % 2 == 0 { wood } else { red });
        let material = [metal, red, wall][k % 3];
        sphere(&mut scene, p + Vec3::new(0.22, 0.22, 0.67), 0.22, 38, material);
    }
    scene
}
