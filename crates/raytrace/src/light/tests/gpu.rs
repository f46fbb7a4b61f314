//! The GPU against the processor, function by function, then image by image. Needs an adapter, a software one will do: built without
//! `CORF_REQUIRE_GPU=1` the tests are ignored.

mod images;
mod kernels;

use super::*;
use crate::light::bsdf::Bsdf;
use crate::light::sampler::Sampler;
use crate::light::surface::Surface;
use crate::light::{CacheSettings, GpuLight, LightCache, LightSampling, LightView, Renderer, ViewSettings};
use corf_gpu::{AdapterOptions, testing};
use corf_scene::Rng;
use corf_scene::model::{AlphaMode, Filter, PunctualKind, PunctualLight, TextureRef, Wrap};
use glam::{Affine2, Vec2};

/// Whether there is an adapter; a failure without one under `CORF_REQUIRE_GPU=1`.
fn adapter_is_there() -> bool {
    testing::context(&testing::OPTIONS).is_some()
}

fn open<'a>(tracer: &'a LightTracer<'a>, cache: Option<&CacheSettings>) -> GpuLight<'a> {
    GpuLight::new(tracer, cache, &testing::OPTIONS, &|_, _| true).unwrap().unwrap()
}

fn texture(scene: &mut Scene, seed: u64, alpha: bool, wrap: [Wrap; 2], filter: Filter) -> TextureRef {
    let mut rng = Rng::keyed(seed, 1, 0);
    let texels = Raster::from_fn(19, 7, |x, _| {
        let mut byte = || (256.0 * rng.uniform()) as u8;
        [byte(), byte(), byte(), if alpha { [0, 90, 200, 255][x % 4] } else { 255 }]
    });
    scene.textures.push(Texture { name: format!("t{seed}"), texels, wrap, filter });
    let uv_from_uv = Affine2::from_scale_angle_translation(Vec2::new(3.0, 2.0), 0.4, Vec2::new(-0.7, 0.2));
    TextureRef { texture: scene.textures.len() as u32 - 1, uv_from_uv }
}

/// A room with everything that light meets: lamps, lights without extent, textures, normal maps, a polished and a metal surface,
/// panes, holes, veils.
fn everything() -> Scene {
    let mut scene = Scene::default();
    let [t0, t1, t2, t3] = [
        (1, false, [Wrap::Repeat; 2], Filter::Linear),
        (2, false, [Wrap::Mirror, Wrap::Clamp], Filter::Nearest),
        (3, true, [Wrap::Repeat, Wrap::Mirror], Filter::Linear),
        (4, false, [Wrap::Clamp, Wrap::Repeat], Filter::Linear),
    ]
    .map(|(seed, alpha, wrap, filter)| texture(&mut scene, seed, alpha, wrap, filter));
    let of = |material| material;
    let wall = material(&mut scene, of(LightMaterial { base_color_texture: Some(t0), ..LightMaterial::default() }));
    room(&mut scene, Vec3::ZERO, Vec3::new(5.0, 4.0, 3.0), wall);
    let polished = LightMaterial {
        base_color: [0.5, 0.4, 0.3],
        roughness: 0.9,
        metallic: 0.6,
        metallic_roughness_texture: Some(t1),
        normal_texture: Some(t3),
        normal_scale: 0.4,
        ..LightMaterial::default()
    };
    let polished = material(&mut scene, polished);
    quad(&mut scene, Vec3::new(0.5, 0.5, 0.01), Vec3::X * 4.0, Vec3::Y * 3.0, polished);
    let steel = LightMaterial { base_color: [0.7; 3], metallic: 1.0, roughness: 0.2, ..LightMaterial::default() };
    let steel = material(&mut scene, steel);
    sphere(&mut scene, Vec3::new(2.0, 2.2, 1.0), 0.5, steel);
    let glass = LightMaterial { base_color: [0.8, 0.9, 1.0], transmission: 0.8, roughness: 0.0, ..LightMaterial::default() };
    let glass = material(&mut scene, glass);
    quad(&mut scene, Vec3::new(3.5, 0.2, 0.1), Vec3::Y * 3.5, Vec3::Z * 2.5, glass);
    let holes =
        LightMaterial { base_color_texture: Some(t2), alpha_mode: AlphaMode::Mask { cutoff: 0.5 }, ..LightMaterial::default() };
    let holes = material(&mut scene, holes);
    quad(&mut scene, Vec3::new(1.0, 0.4, 0.3), Vec3::X * 2.0, Vec3::new(0.1, 0.2, 1.2), holes);
    let veil =
        LightMaterial { base_color_texture: Some(t2), alpha_mode: AlphaMode::Blend, alpha: 0.7, ..LightMaterial::default() };
    let veil = material(&mut scene, veil);
    quad(&mut scene, Vec3::new(0.4, 3.0, 0.3), Vec3::X * 2.5, Vec3::new(0.0, 0.3, 1.6), veil);
    let lamp = LightMaterial {
        base_color: [0.0; 3],
        emissive: [9.0, 8.0, 6.0],
        emissive_texture: Some(t0),
        double_sided: false,
        ..LightMaterial::default()
    };
    let lamp = material(&mut scene, lamp);
    quad(&mut scene, Vec3::new(1.0, 1.0, 2.9), Vec3::Y * 0.5, Vec3::X * 2.8, lamp);
    quad(&mut scene, Vec3::new(4.0, 3.0, 2.5), Vec3::Y * 0.4, Vec3::X * 0.4, lamp);
    let light = |kind, range_m| PunctualLight {
        kind,
        position: Vec3::new(4.2, 0.7, 2.6),
        direction: Vec3::new(-0.5, 0.3, -1.0).normalize(),
        intensity: [3.0, 2.0, 4.0],
        range_m,
    };
    scene.lights.push(light(PunctualKind::Spot { inner_rad: 0.3, outer_rad: 0.8 }, None));
    scene.lights.push(light(PunctualKind::Point, Some(4.0)));
    scene
}

/// [`everything`] without what lets light through and without a wall, and with vertex colours.
fn opaque() -> Scene {
    let mut scene = everything();
    // The two triangles of the wall at x = 5, through which the background is seen.
    scene.triangles.drain(10..12);
    for m in &mut scene.materials {
        (m.light.alpha_mode, m.light.transmission) = (AlphaMode::Opaque, 0.0);
    }
    scene.colors = scene.positions.iter().map(|p| [0.5 + 0.1 * p.x, 1.0, 0.7, 1.0]).collect();
    scene
}

fn floats(values: impl IntoIterator<Item = f32>) -> Vec<u32> {
    values.into_iter().map(f32::to_bits).collect()
}

fn direction(rng: &mut Rng) -> Vec3 {
    Vec3::new(rng.normal() as f32, rng.normal() as f32, rng.normal() as f32).normalize()
}

/// Rays from anywhere in the room.
fn rays(count: usize, seed: u64) -> Vec<Ray> {
    let mut rng = Rng::keyed(seed, 2, 0);
    let mut ray = || {
        let origin = Vec3::new(5.0 * rng.uniform(), 4.0 * rng.uniform(), 3.0 * rng.uniform());
        Ray { t_max: if rng.uniform() < 0.3 { 1.5 } else { f32::INFINITY }, ..Ray::new(origin, direction(&mut rng)) }
    };
    (0..count).map(|_| ray()).collect()
}

fn packed(rays: &[Ray]) -> Vec<u32> {
    let of =
        |r: &Ray| [r.origin.x, r.origin.y, r.origin.z, r.t_min, r.direction.x, r.direction.y, r.direction.z, r.t_max.min(3e38)];
    floats(rays.iter().flat_map(of))
}

const RAY: &str = "
fn f(i: u32) -> f32 { return bitcast<f32>(asked[i]); }
fn ray_of(i: u32) -> Ray {
    let origin = vec3(f(8u * i), f(8u * i + 1u), f(8u * i + 2u));
    return Ray(origin, f(8u * i + 3u), vec3(f(8u * i + 4u), f(8u * i + 5u), f(8u * i + 6u)), f(8u * i + 7u));
}
fn give(i: u32, v: vec3<f32>) {
    found[i] = bitcast<u32>(v.x);
    found[i + 1u] = bitcast<u32>(v.y);
    found[i + 2u] = bitcast<u32>(v.z);
}
";

fn vec3(words: &[u32]) -> Vec3 {
    Vec3::new(f32::from_bits(words[0]), f32::from_bits(words[1]), f32::from_bits(words[2]))
}

fn close(a: Vec3, b: Vec3, tolerance: f32) -> bool {
    (a - b).abs().max_element() <= tolerance * (1.0 + b.abs().max_element())
}
