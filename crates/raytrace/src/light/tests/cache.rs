//! Truths of cached light: closed forms, and agreement with the unbiased tracer.

use super::super::{CacheSettings, LightCache, ViewSettings};
use super::*;

fn settings() -> CacheSettings {
    CacheSettings { coarse_points: 4_000, ..CacheSettings::default() }
}

fn cached(scene: &Scene, (camera, pose): &(Pinhole, Rigid3), settings: &CacheSettings) -> LightFrame {
    let bvh = Bvh::build(scene);
    let tracer = LightTracer::new(scene, &bvh);
    let cache = LightCache::new(&tracer, settings, &|_, _| true).unwrap();
    cache.render(camera, pose, &ViewSettings { samples_per_pixel: 32, ..ViewSettings::default() }, 0)
}

/// Mean scattered radiance of a frame in the first channel.
fn scattered(frame: &LightFrame) -> f64 {
    let sum: f64 = frame.radiance.pixels().iter().zip(frame.lamp.pixels()).map(|(p, l)| f64::from(p[0] - l[0])).sum();
    sum / frame.radiance.pixels().len() as f64
}

/// Asserts that cached light and path tracing agree in the mean scattered radiance to a share of it.
fn agrees(name: &str, scene: &Scene, camera: &(Pinhole, Rigid3), tolerance: f64) {
    let path = LightSettings { samples_per_pixel: 2048, max_bounces: 64, ..LightSettings::default() };
    let unbiased = scattered(&render(scene, camera, &path));
    let found = scattered(&cached(scene, camera, &settings()));
    assert!(
        (found / unbiased - 1.0).abs() < tolerance,
        "{name}: {found} cached, {unbiased} unbiased, ratio {}",
        found / unbiased
    );
}

#[test]
fn a_grey_furnace_room_reaches_its_closed_form() {
    let albedo = 0.5f32;
    let mut scene = Scene::default();
    let wall =
        material(&mut scene, LightMaterial { base_color: [albedo; 3], ior: 1.0, emissive: [1.0; 3], ..LightMaterial::default() });
    room(&mut scene, Vec3::ZERO, Vec3::new(3.0, 2.0, 2.5), wall);
    let camera = view(16, 12, 80.0, DVec3::new(1.0, 0.9, 1.2), DVec3::new(3.0, 2.0, 0.0));
    let frame = cached(&scene, &camera, &settings());
    let exact = 1.0 / (1.0 - albedo);
    let (mean, _) = statistics(&frame);
    assert!((mean / f64::from(exact) - 1.0).abs() < 0.003, "{mean} of {exact}");
    for p in frame.radiance.pixels() {
        assert!((p[0] / exact - 1.0).abs() < 0.03, "{} of {exact}", p[0]);
    }
}

#[test]
fn a_diffuse_room_agrees_with_path_tracing() {
    let mut scene = Scene::default();
    let wall = diffuse(&mut scene, 0.7);
    let light = emitter(&mut scene, 10.0);
    room(&mut scene, Vec3::ZERO, Vec3::new(3.0, 3.0, 2.5), wall);
    quad(&mut scene, Vec3::new(1.0, 1.0, 2.45), Vec3::Y, Vec3::X, light);
    quad(&mut scene, Vec3::new(0.8, 0.8, 0.9), Vec3::X, Vec3::Y, wall);
    let camera = view(32, 24, 70.0, DVec3::new(0.3, 0.4, 1.3), DVec3::new(2.2, 2.0, 0.9));
    agrees("diffuse", &scene, &camera, 0.005);
}

#[test]
fn a_glossy_dielectric_room_agrees_with_path_tracing() {
    // From a roughness of 0.8 on highlights are read off the received light, half a per cent too bright here.
    for (roughness, tolerance) in [(0.3, 0.005), (0.75, 0.005), (0.9, 0.01)] {
        let mut scene = Scene::default();
        let wall = material(
            &mut scene,
            LightMaterial { base_color: [0.6, 0.5, 0.4], roughness, metallic: 0.0, ..LightMaterial::default() },
        );
        let light = emitter(&mut scene, 10.0);
        room(&mut scene, Vec3::ZERO, Vec3::new(3.0, 3.0, 2.5), wall);
        quad(&mut scene, Vec3::new(1.0, 1.0, 2.45), Vec3::Y, Vec3::X, light);
        let camera = view(32, 24, 70.0, DVec3::new(0.3, 0.4, 1.3), DVec3::new(2.2, 2.0, 0.9));
        agrees(&format!("roughness {roughness}"), &scene, &camera, tolerance);
    }
}

#[test]
fn a_room_with_metal_agrees_with_path_tracing() {
    let camera = view(32, 24, 70.0, DVec3::new(0.3, 0.4, 1.3), DVec3::new(2.2, 2.0, 0.9));
    agrees("metal", &lit_box(1.2), &camera, 0.006);
}

#[test]
fn cached_bytes_do_not_depend_on_threads_or_on_what_was_rendered_before() {
    let scene = lit_box(1.0);
    let camera = view(24, 18, 70.0, DVec3::new(0.3, 0.4, 1.3), DVec3::new(2.2, 2.0, 0.9));
    let other = view(24, 18, 70.0, DVec3::new(2.3, 0.4, 1.3), DVec3::new(0.2, 2.0, 0.9));
    let run = |threads: usize, first: bool| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let bvh = Bvh::build(&scene);
            let tracer = LightTracer::new(&scene, &bvh);
            let settings = CacheSettings { coarse_points: 1_000, direct_rays: 16, gather_walks: 16, ..settings() };
            let cache = LightCache::new(&tracer, &settings, &|_, _| true).unwrap();
            if first {
                cache.render(&other.0, &other.1, &ViewSettings::default(), 1);
            }
            cache.render(&camera.0, &camera.1, &ViewSettings::default(), 0)
        })
    };
    let one = run(1, false);
    assert_eq!(one, run(2, false));
    assert_eq!(one, run(5, true));
}
