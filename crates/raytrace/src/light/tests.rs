//! Truths of the light tracer.

mod alpha;
mod cache;
#[cfg(feature = "gpu")]
mod gpu;
mod materials;

use super::*;
use corf_scene::model::{LightMaterial, Material, Object, Triangle};
use glam::DVec3;

/// Adds a quad `p, p + a, p + a + b, p + b` (normal a × b) of a material.
fn quad(scene: &mut Scene, p: Vec3, a: Vec3, b: Vec3, material: u32) {
    let first = scene.positions.len() as u32;
    scene.positions.extend([p, p + a, p + a + b, p + b]);
    scene.normals.extend([a.cross(b).normalize(); 4]);
    scene.uvs.extend([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    let object = scene.objects.len() as u32;
    scene.objects.push(Object { name: format!("quad {object}") });
    for vertices in [[first, first + 1, first + 2], [first, first + 2, first + 3]] {
        scene.triangles.push(Triangle { vertices, material, object });
    }
}

/// A box with its faces turned inwards.
fn room(scene: &mut Scene, low: Vec3, high: Vec3, material: u32) {
    let s = high - low;
    let (x, y, z) = (Vec3::X * s.x, Vec3::Y * s.y, Vec3::Z * s.z);
    quad(scene, low, x, y, material);
    quad(scene, low + z, y, x, material);
    quad(scene, low, z, x, material);
    quad(scene, low + y, x, z, material);
    quad(scene, low, y, z, material);
    quad(scene, low + x, z, y, material);
}

fn material(scene: &mut Scene, light: LightMaterial) -> u32 {
    scene.materials.push(Material { name: format!("m{}", scene.materials.len()), light, radio: None });
    scene.materials.len() as u32 - 1
}

fn diffuse(scene: &mut Scene, albedo: f32) -> u32 {
    // An index of refraction of 1 has no specular lobe.
    material(scene, LightMaterial { base_color: [albedo; 3], ior: 1.0, ..LightMaterial::default() })
}

fn emitter(scene: &mut Scene, radiance: f32) -> u32 {
    material(
        scene,
        LightMaterial {
            base_color: [0.0; 3],
            ior: 1.0,
            emissive: [radiance; 3],
            double_sided: false,
            ..LightMaterial::default()
        },
    )
}

/// A faceted sphere, outward normals exact.
fn sphere(scene: &mut Scene, centre: Vec3, radius: f32, material: u32) {
    const RINGS: u32 = 24;
    let first = scene.positions.len() as u32;
    for i in 0..=RINGS {
        for j in 0..=2 * RINGS {
            let (theta, phi) = (std::f32::consts::PI * i as f32 / RINGS as f32, std::f32::consts::PI * j as f32 / RINGS as f32);
            let n = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            scene.positions.push(centre + n * radius);
            scene.normals.push(n);
            scene.uvs.push([0.0; 2]);
        }
    }
    let object = scene.objects.len() as u32;
    scene.objects.push(Object { name: "sphere".into() });
    for i in 0..RINGS {
        for j in 0..2 * RINGS {
            let a = first + i * (2 * RINGS + 1) + j;
            let b = a + 2 * RINGS + 1;
            for vertices in [[a, b, b + 1], [a, b + 1, a + 1]] {
                scene.triangles.push(Triangle { vertices, material, object });
            }
        }
    }
}

fn view(width: usize, height: usize, fov_deg: f64, eye: DVec3, target: DVec3) -> (Pinhole, Rigid3) {
    let up = if (target - eye).normalize().z.abs() > 0.99 { DVec3::Y } else { DVec3::Z };
    (Pinhole::from_horizontal_fov(width, height, fov_deg), Rigid3::looking_at(eye, target, up))
}

fn render(scene: &Scene, (camera, pose): &(Pinhole, Rigid3), settings: &LightSettings) -> LightFrame {
    let bvh = Bvh::build(scene);
    LightTracer::new(scene, &bvh).render(camera, pose, settings, 0)
}

/// Mean and standard error of the mean over pixels of the first channel.
fn statistics(frame: &LightFrame) -> (f64, f64) {
    let values: Vec<f64> = frame.radiance.pixels().iter().map(|p| f64::from(p[0])).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// A furnace of radiance 1 with a sphere in it, seen close enough that the sphere fills the view: mean radiance, its standard error
/// over pixels, and the mean directional albedo.
fn furnace(light: LightMaterial) -> (f64, f64, f64) {
    let mut scene = Scene::default();
    let m = material(&mut scene, light);
    sphere(&mut scene, Vec3::ZERO, 1.0, m);
    let settings = LightSettings { samples_per_pixel: 64, max_bounces: 64, background: [1.0; 3], ..LightSettings::default() };
    let frame = render(&scene, &view(24, 24, 36.0, DVec3::new(2.5, 0.4, 0.3), DVec3::ZERO), &settings);
    let albedo = frame.albedo.pixels().iter().map(|p| f64::from(p[0])).sum::<f64>() / frame.albedo.pixels().len() as f64;
    let (mean, error) = statistics(&frame);
    (mean, error, albedo)
}

#[test]
fn white_dielectric_sphere_vanishes_in_the_furnace() {
    for (ior, roughness, tolerance) in [(1.0, 1.0, 1e-4), (1.5, 0.8, 0.01), (1.5, 0.3, 0.01)] {
        let light = LightMaterial { base_color: [1.0; 3], ior, roughness, ..LightMaterial::default() };
        let (mean, error, _) = furnace(light);
        // Directions reflected into a facet by the interpolated normal are lost: that and the albedo table make the tolerance.
        assert!((mean - 1.0).abs() < tolerance + 5.0 * error, "ior {ior}, roughness {roughness}: {mean} ± {error}");
    }
}

#[test]
fn white_metal_sphere_loses_only_what_single_scattering_loses() {
    for roughness in [0.2, 0.6, 1.0] {
        let light = LightMaterial { base_color: [1.0; 3], metallic: 1.0, roughness, ..LightMaterial::default() };
        let (mean, error, albedo) = furnace(light);
        // The loss is that of the directional albedo (checked against quadrature beside the model) and nothing else; directions
        // that the interpolated normal sends into a facet are worth some 0.003.
        assert!(
            mean < 1.0 && (mean - albedo).abs() < 0.006 + 5.0 * error,
            "roughness {roughness}: {mean} ± {error}, albedo {albedo}"
        );
    }
}

#[test]
fn grey_furnace_room_reaches_its_series() {
    // Inside a closed diffuse room whose walls all emit 1, radiance is Σ albedo^k = 1/(1 − albedo), truncated at the bounce limit.
    let mut scene = Scene::default();
    let albedo = 0.5f32;
    let wall =
        material(&mut scene, LightMaterial { base_color: [albedo; 3], ior: 1.0, emissive: [1.0; 3], ..LightMaterial::default() });
    room(&mut scene, Vec3::ZERO, Vec3::new(3.0, 2.0, 2.5), wall);
    let bounces = 12;
    let settings = LightSettings { samples_per_pixel: 64, max_bounces: bounces, ..LightSettings::default() };
    let (mean, error) =
        statistics(&render(&scene, &view(16, 12, 80.0, DVec3::new(1.0, 0.9, 1.2), DVec3::new(3.0, 2.0, 0.0)), &settings));
    let exact = (1.0 - f64::from(albedo).powi(bounces as i32 + 1)) / (1.0 - f64::from(albedo));
    assert!((mean - exact).abs() < 5.0 * error + 1e-3, "{mean} ± {error}, exactly {exact}");
}

/// A small room with a ceiling panel, a glossy floor, a box and a metal wall.
fn lit_box(light_size: f32) -> Scene {
    let mut scene = Scene::default();
    let wall = diffuse(&mut scene, 0.7);
    let light = emitter(&mut scene, 10.0);
    let glossy = material(&mut scene, LightMaterial { base_color: [0.5, 0.3, 0.2], roughness: 0.4, ..LightMaterial::default() });
    let metal = material(
        &mut scene,
        LightMaterial { base_color: [0.9, 0.8, 0.6], metallic: 1.0, roughness: 0.35, ..LightMaterial::default() },
    );
    room(&mut scene, Vec3::ZERO, Vec3::new(3.0, 3.0, 2.5), wall);
    let half = 0.5 * light_size;
    quad(&mut scene, Vec3::new(1.5 - half, 1.5 - half, 2.45), Vec3::Y * light_size, Vec3::X * light_size, light);
    quad(&mut scene, Vec3::new(0.05, 0.05, 0.01), Vec3::X * 2.9, Vec3::Y * 2.9, glossy);
    quad(&mut scene, Vec3::new(2.95, 0.1, 0.1), Vec3::Z * 2.0, Vec3::Y * 2.5, metal);
    quad(&mut scene, Vec3::new(0.8, 0.8, 0.9), Vec3::X, Vec3::Y, wall);
    scene
}

/// Two unbiased estimates differ by less than this many combined standard errors (one in 16 000 pairs of honest estimates does not).
const SIGNIFICANT_ERRORS: f64 = 4.0;

#[test]
fn next_event_estimation_agrees_with_plain_path_tracing() {
    let camera = view(12, 9, 70.0, DVec3::new(0.3, 0.4, 1.3), DVec3::new(2.2, 2.0, 0.9));
    agree(&lit_box(1.2), &camera, 5);
}

/// Asserts that images with and without next-event estimation have the same mean.
fn agree(scene: &Scene, camera: &(Pinhole, Rigid3), max_bounces: u32) {
    let bvh = Bvh::build(scene);
    let tracer = LightTracer::new(scene, &bvh);
    // The error comes from repeating the whole image under independent keys.
    let estimate = |next_event_estimation: bool, spp: u32| {
        let settings = LightSettings { samples_per_pixel: spp, max_bounces, next_event_estimation, ..LightSettings::default() };
        let means: Vec<f64> = (0..24).map(|key| statistics(&tracer.render(&camera.0, &camera.1, &settings, key)).0).collect();
        let n = means.len() as f64;
        let mean = means.iter().sum::<f64>() / n;
        (mean, (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt())
    };
    let (with, with_error) = estimate(true, 64);
    let (without, without_error) = estimate(false, 256);
    let combined = with_error.hypot(without_error);
    assert!(combined < 0.01 * with, "the test decides something: {combined} of {with}");
    assert!((with - without).abs() < SIGNIFICANT_ERRORS * combined, "{with} ± {with_error} against {without} ± {without_error}");
}

#[test]
fn irradiance_under_a_rectangle_is_the_analytic_one() {
    // Floor point under the corner of an a × b rectangle at height h (Lambert's formula for a corner):
    // E/L = ½ [ A/√(1+A²)·atan(B/√(1+A²)) + B/√(1+B²)·atan(A/√(1+B²)) ], A = a/h, B = b/h.
    let (a, b, h) = (0.8f32, 0.5f32, 0.7f32);
    let (radiance, albedo) = (5.0f32, 0.6f32);
    let mut scene = Scene::default();
    let floor = diffuse(&mut scene, albedo);
    let light = emitter(&mut scene, radiance);
    quad(&mut scene, Vec3::new(-2.0, -2.0, 0.0), Vec3::X * 4.0, Vec3::Y * 4.0, floor);
    quad(&mut scene, Vec3::new(0.0, 0.0, h), Vec3::Y * b, Vec3::X * a, light);
    // A very narrow view of the origin, from the side, so that the light is not in the way.
    let camera = view(8, 8, 0.05, DVec3::new(-1.0, -1.0, 0.5), DVec3::ZERO);
    let settings = LightSettings { samples_per_pixel: 1024, max_bounces: 1, ..LightSettings::default() };
    let (mean, error) = statistics(&render(&scene, &camera, &settings));
    let (x, y) = (f64::from(a / h), f64::from(b / h));
    let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    let irradiance = 0.5 * f64::from(radiance) * (x / rx * (y / rx).atan() + y / ry * (x / ry).atan());
    let exact = irradiance * f64::from(albedo) / std::f64::consts::PI;
    assert!((mean - exact).abs() < 5.0 * error + 2e-4 * exact, "{mean} ± {error}, exactly {exact}");
}

#[test]
fn light_through_a_pane_is_weakened_by_its_transmittance() {
    let mut scene = Scene::default();
    let floor = diffuse(&mut scene, 0.6);
    let light = emitter(&mut scene, 500.0);
    let pane = material(
        &mut scene,
        LightMaterial { base_color: [0.9, 0.9, 0.9], transmission: 1.0, roughness: 0.0, ..LightMaterial::default() },
    );
    quad(&mut scene, Vec3::new(-0.01, -0.01, 0.0), Vec3::X * 0.02, Vec3::Y * 0.02, floor);
    quad(&mut scene, Vec3::new(-0.05, -0.05, 2.0), Vec3::Y * 0.1, Vec3::X * 0.1, light);
    let camera = view(8, 8, 0.1, DVec3::new(-1.0, 0.0, 0.5), DVec3::ZERO);
    let settings = LightSettings { samples_per_pixel: 256, max_bounces: 4, ..LightSettings::default() };
    let (clear, clear_error) = statistics(&render(&scene, &camera, &settings));
    quad(&mut scene, Vec3::new(-0.5, -0.5, 1.0), Vec3::X, Vec3::Y, pane);
    let (glazed, glazed_error) = statistics(&render(&scene, &camera, &settings));
    // Normal incidence: 1 − 2R/(1+R) = 0.92308 for n = 1.5, tinted by 0.9 once; incidence varies by under two degrees.
    let expected = 0.9 * (1.0 - 0.076_923);
    let ratio = glazed / clear;
    let error = ratio * (clear_error / clear).hypot(glazed_error / glazed);
    assert!((ratio - expected).abs() < 5.0 * error + 1e-3, "{ratio} ± {error}, expected {expected}");
}

#[test]
fn depth_and_surface_are_those_of_the_pixel_centre() {
    let mut scene = Scene::default();
    let wall = diffuse(&mut scene, 0.5);
    let pane = material(&mut scene, LightMaterial { transmission: 1.0, ..LightMaterial::default() });
    // Plane x + 0.25 z = 4 as a big quad, and a pane in front of it.
    let (p, a) = (Vec3::new(4.0, -30.0, 0.0), Vec3::new(-5.0, 0.0, 20.0));
    quad(&mut scene, p - a, Vec3::Y * 60.0, a * 2.0, wall);
    quad(&mut scene, Vec3::new(1.0, -9.0, -9.0), Vec3::Y * 18.0, Vec3::Z * 18.0, pane);
    let (camera, pose) = view(33, 21, 80.0, DVec3::new(0.3, 0.2, 0.1), DVec3::new(4.0, 1.0, 0.4));
    let frame = render(&scene, &(camera, pose), &LightSettings { samples_per_pixel: 1, ..LightSettings::default() });
    let normal = DVec3::new(1.0, 0.0, 0.25);
    for y in 0..21 {
        for x in 0..33 {
            let d = pose.transform_vector(camera.unproject(x as f64 + 0.5, y as f64 + 0.5));
            let exact = (4.0 - normal.dot(pose.translation)) / normal.dot(d);
            let got = f64::from(frame.depth_m[(x, y)]);
            // A few roundings of f32 coordinates of up to 30 m.
            assert!((got - exact).abs() < 1e-5 * exact.max(1.0), "{x} {y}: {got} {exact}");
            assert_eq!(frame.surface[(x, y)], 0);
        }
    }
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let scene = lit_box(0.4);
    let (camera, pose) = view(40, 30, 75.0, DVec3::new(0.4, 0.3, 1.4), DVec3::new(2.0, 2.2, 0.7));
    let settings = LightSettings { samples_per_pixel: 4, ..LightSettings::default() };
    let with = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let frame = render(&scene, &(camera, pose), &settings);
            (develop_frame(&frame, 1.0), frame)
        })
    };
    let (one, two) = (with(1), with(2));
    assert_eq!(one, two);
    let other = render(&scene, &(camera, pose), &LightSettings { seed: 1, ..settings });
    assert_ne!(one.1.radiance, other.radiance, "another seed gives other noise");
}
