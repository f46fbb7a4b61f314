//! The GPU against the processor, function by function, then image by image. Needs an adapter, a software one will do; without
//! any the tests say
//! so and pass, unless `CORF_REQUIRE_GPU=1`.

use super::*;
use crate::light::bsdf::Bsdf;
use crate::light::sampler::Sampler;
use crate::light::surface::Surface;
use crate::light::{CacheSettings, GpuLight, LightCache, Renderer, Sampling, View, ViewSettings};
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

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn random_numbers_are_the_processors_bit_for_bit() {
    if !adapter_is_there() {
        return;
    }
    let scene = opaque();
    let bvh = Bvh::build(&scene);
    let tracer = LightTracer::new(&scene, &bvh);
    let gpu = open(&tracer, None);
    let item = "
fn item(i: u32) {
    let seed = vec2(asked[0], asked[1]);
    var draws = draws_of(seed, vec2(i * 977u, i >> 3u));
    draws.index = i % 300u;
    let p = pair(draws, i % 11u);
    var state = rng_ahead(rng_keyed(seed, vec2(0xd10002u, i), vec2(i, 7u)), i % 5u);
    found[5u * i] = bitcast<u32>(p.x);
    found[5u * i + 1u] = bitcast<u32>(p.y);
    found[5u * i + 2u] = bitcast<u32>(rng_uniform(&state));
    found[5u * i + 3u] = rng_below(&state, 3u + i);
    found[5u * i + 4u] = rng_below(&state, 0xfffffff1u);
}";
    let (seed, n) = (0x9234_5678_9abc_def1u64, 5000usize);
    let found = gpu.probe(item, &[seed as u32, (seed >> 32) as u32], n, 5).unwrap();
    for i in 0..n as u64 {
        let mut sampler = Sampler::of_item(seed, (i * 977) | ((i >> 3) << 32));
        sampler.start(i as u32 % 300);
        let mut rng = Rng::keyed(seed, 0xd1_0002 | i << 32, i | 7 << 32);
        (0..i % 5).for_each(|_| {
            rng.next_u64();
        });
        let [x, y] = sampler.pair(i as u32 % 11);
        let expected =
            [x.to_bits(), y.to_bits(), rng.uniform().to_bits(), rng.below(3 + i as usize) as u32, rng.below(0xffff_fff1) as u32];
        assert_eq!(found[5 * i as usize..][..5], expected, "{i}");
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn own_trigonometry_is_exact_to_a_few_roundings() {
    if !adapter_is_there() {
        return;
    }
    let scene = opaque();
    let bvh = Bvh::build(&scene);
    let tracer = LightTracer::new(&scene, &bvh);
    let gpu = open(&tracer, None);
    let n = 20_001usize;
    let item = "
fn item(i: u32) {
    let turns = f32(i) / 20000.0;
    let cs = cos_sin_turns(turns);
    found[3u * i] = bitcast<u32>(cs.x);
    found[3u * i + 1u] = bitcast<u32>(cs.y);
    found[3u * i + 2u] = bitcast<u32>(angle(abs(cs.y) * 7.0, cs.x * 7.0));
}";
    let found = gpu.probe(item, &[0], n, 3).unwrap();
    for i in 0..n {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / 20_000.0).sin_cos();
        let v = vec3(&found[3 * i..]);
        assert!((f64::from(v.x) - cos).abs() < 4e-7 && (f64::from(v.y) - sin).abs() < 4e-7, "{i}: {v} {cos} {sin}");
        assert!((f64::from(v.z) - sin.abs().atan2(cos)).abs() < 1e-6, "{i}: {v}");
    }
}

/// Rays that graze an edge may be let by on one device alone.
const STRAY_RAYS: f64 = 3e-4;

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn rays_meet_what_they_meet_on_the_processor() {
    if !adapter_is_there() {
        return;
    }
    for scene in [everything(), opaque()] {
        let bvh = Bvh::build(&scene);
        let tracer = LightTracer::new(&scene, &bvh);
        let gpu = open(&tracer, None);
        let rays = rays(30_000, 9);
        let item = format!(
            "{RAY}
fn item(i: u32) {{
    let ray = ray_of(i);
    let hit = closest(ray);
    let plain = closest_where(ray, 0.499999, false);
    found[8u * i] = hit.triangle;
    found[8u * i + 1u] = bitcast<u32>(hit.t);
    found[8u * i + 2u] = bitcast<u32>(hit.u);
    found[8u * i + 3u] = bitcast<u32>(hit.v);
    found[8u * i + 4u] = bitcast<u32>(plain.t);
    give(8u * i + 5u, transmittance(Ray(ray.origin, 0.0, ray.direction, min(ray.t_max, 2.5))));
}}"
        );
        let found = gpu.probe(&item, &packed(&rays), rays.len(), 8).unwrap();
        let mut stray = 0;
        for (ray, found) in rays.iter().zip(found.chunks(8)) {
            let hit = tracer.closest_where(ray, 0.0, |_| true);
            let plain = tracer.closest_where(ray, 0.499_999, |cover| !cover.pane);
            let passed = tracer.transmittance(&Ray { t_max: ray.t_max.min(2.5), ..*ray });
            let [t, u, v, plain_t] = [1, 2, 3, 4].map(|k| f32::from_bits(found[k]));
            let same = match hit {
                None => found[0] == u32::MAX,
                Some(hit) => {
                    gpu.number_of(found[0]) == Some(hit.triangle)
                        && (t - hit.t).abs() < 1e-4 * (1.0 + hit.t)
                        && (u - hit.u).abs().max((v - hit.v).abs()) < 1e-3
                }
            };
            let same_plain = plain.map_or(plain_t >= 1e38_f32.min(ray.t_max), |h| (plain_t - h.t).abs() < 1e-4 * (1.0 + h.t));
            stray += u32::from(!(same && same_plain && close(vec3(&found[5..]), passed, 1e-4)));
        }
        assert!(f64::from(stray) <= STRAY_RAYS * rays.len() as f64, "{stray} of {} rays differ", rays.len());
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn surfaces_and_their_reflection_are_the_processors() {
    if !adapter_is_there() {
        return;
    }
    for scene in [everything(), opaque()] {
        let bvh = Bvh::build(&scene);
        let tracer = LightTracer::new(&scene, &bvh);
        let gpu = open(&tracer, None);
        let rays = rays(8000, 4);
        let item = format!(
            "{RAY}
fn item(i: u32) {{
    let ray = ray_of(i);
    let hit = closest(ray);
    found[40u * i] = hit.triangle;
    if (hit.triangle == NONE) {{ return; }}
    let s = surface_at(ray, hit, i % 2u == 1u);
    give(40u * i + 1u, s.position);
    give(40u * i + 4u, s.normal);
    give(40u * i + 7u, s.base_color);
    give(40u * i + 10u, vec3(s.metallic, s.roughness, s.coverage));
    give(40u * i + 13u, s.emitted);
    found[40u * i + 16u] = fate_of(s, ray, f32(i % 101u) / 101.0);
    let frame = frame_of(s.normal);
    let bsdf = reflection(s, ray, MEETS, frame);
    let u = vec2(f32(i % 97u) / 97.0, f32(i % 89u) / 89.0);
    let next = sample_bsdf(bsdf, f32(i % 7u) / 7.0, u);
    give(40u * i + 17u, frame * next.l);
    give(40u * i + 20u, next.weight);
    let high = sample_specular(bsdf, u);
    give(40u * i + 23u, high.weight);
    // The density of a narrow lobe is as uncertain as the half vector.
    give(40u * i + 26u, vec3(min(next.pdf, 50.0), received_by(bsdf, u.x), specular_share(bsdf)));
    give(40u * i + 29u, diffuse_toward_viewer(bsdf));
    give(40u * i + 32u, wide_highlight_axis(bsdf));
    let light = sample_emitters(s.position, u.y, u);
    give(40u * i + 35u, select(vec3(0.0), light.weight, light.pdf != 0.0));
    found[40u * i + 38u] = bitcast<u32>(emitters_pdf(ray.origin, hit, 0.5));
}}"
        );
        let found = gpu.probe(&item, &packed(&rays), rays.len(), 40).unwrap();
        let (mut met, mut wrong) = (0usize, Vec::new());
        for (i, (ray, found)) in rays.iter().zip(found.chunks(40)).enumerate() {
            let Some(hit) = tracer.closest_where(ray, 0.0, |_| true) else { continue };
            if gpu.number_of(found[0]) != Some(hit.triangle) {
                continue;
            }
            met += 1;
            let s = Surface::at(&scene, tracer.cover(&hit), ray, &hit, (i % 2 == 1).then_some(&tracer.coarse[..]));
            let (to_local, bsdf) = s.reflection(ray, surface::Fate::Meets);
            let u = [(i % 97) as f32 / 97.0, (i % 89) as f32 / 89.0];
            let next = bsdf.sample((i % 7) as f32 / 7.0, u);
            let high = bsdf.sample_specular(u);
            let light = tracer.emitters.sample(&scene, &tracer.covers, s.position, u[1], u);
            let local = |b: &Bsdf| b.wide_highlight().map_or(vec3(&found[32..]), |(axis, _)| axis);
            let expected = [
                (1, s.position, 1e-5),
                (4, s.normal, 2e-3),
                (7, s.base_color, 2e-3),
                (10, Vec3::new(s.metallic, s.roughness, s.coverage), 2e-3),
                (13, s.emitted, 2e-3),
                (17, next.map_or(Vec3::ZERO, |n| to_local.transpose() * n.l), 5e-3),
                (20, next.map_or(Vec3::ZERO, |n| n.weight), 5e-3),
                (23, high.map_or(Vec3::ZERO, |n| n.weight), 5e-3),
                (26, Vec3::new(next.map_or(0.0, |n| n.pdf.min(50.0)), bsdf.received(u[0]), bsdf.specular_share()), 1e-2),
                (29, bsdf.diffuse_toward_viewer(), 2e-3),
                (32, local(&bsdf), 2e-3),
                (35, light.map_or(Vec3::ZERO, |l| l.weight), 5e-3),
                (38, Vec3::new(tracer.emitters.pdf(ray.origin, &hit, hit.t, 0.5), 0.0, 0.0), 2e-3),
            ];
            for (at, value, tolerance) in expected {
                let got = if at == 38 { Vec3::X * f32::from_bits(found[38]) } else { vec3(&found[at..]) };
                // Where there is no sample, its direction is left as it was drawn.
                if !(close(got, value, tolerance) || at == 17 && next.is_none()) {
                    wrong.push((i, at, got, value));
                }
            }
            let fate = s.fate(ray, (i % 101) as f32 / 101.0) as u32;
            if found[16] != fate {
                wrong.push((i, 16, Vec3::splat(found[16] as f32), Vec3::splat(fate as f32)));
            }
        }
        assert!(met > 4000, "{met} surfaces");
        // At a texel's or a triangle's edge, a bucket's end, a lobe's or a fate's threshold rounding decides.
        assert!(wrong.len() < met / 200, "{} of {met}: {:?}", wrong.len(), &wrong[..wrong.len().min(12)]);
    }
}

/// Shares of two images' pixels that differ, and the ratio of their mean luminances.
fn compared(a: &LightFrame, b: &LightFrame) -> (f64, f64) {
    let mean = |f: &LightFrame| f.radiance.pixels().iter().map(|p| f64::from(luminance(Vec3::from(*p)))).sum::<f64>();
    let differ =
        a.radiance.pixels().iter().zip(b.radiance.pixels()).filter(|(a, b)| !close(Vec3::from(**a), Vec3::from(**b), 1e-2));
    (differ.count() as f64 / a.radiance.pixels().len() as f64, mean(a) / mean(b))
}

/// Depths that agree to a millimetre; nothing is as far from nothing.
fn same_depth(a: f32, b: f32) -> bool {
    a == b || (a - b).abs() < 1e-3
}

/// Paths that rounding sends elsewhere: pixels in which a path does are so many at most, and the light of all so much off.
const STRAY_PIXELS: f64 = 0.05;
const ENERGY: f64 = 1e-3;

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn images_of_the_path_method_are_the_processors() {
    if !adapter_is_there() {
        return;
    }
    for (scene, settings) in [
        (
            everything(),
            LightSettings {
                samples_per_pixel: 16,
                max_bounces: 12,
                seed: 3,
                background: [0.1, 0.2, 0.3],
                ..LightSettings::default()
            },
        ),
        (opaque(), LightSettings { samples_per_pixel: 8, max_bounces: 3, seed: 4, ..LightSettings::default() }),
        (opaque(), LightSettings { samples_per_pixel: 4, next_event_estimation: false, ..LightSettings::default() }),
    ] {
        let bvh = Bvh::build(&scene);
        let tracer = LightTracer::new(&scene, &bvh);
        let gpu = open(&tracer, None);
        let (camera, world_from_camera) = view(50, 37, 90.0, DVec3::new(0.4, 0.5, 1.6), DVec3::new(4.0, 3.0, 1.0));
        let views = [View { world_from_camera, key: 5 }];
        let expected = tracer.render(&camera, &world_from_camera, &settings, 5);
        let found = gpu.render(&camera, &views, &Sampling::Path(settings)).unwrap().remove(0);
        assert!(found == gpu.render(&camera, &views, &Sampling::Path(settings)).unwrap().remove(0), "the same bytes again");
        let (differ, ratio) = compared(&found, &expected);
        assert!(differ < STRAY_PIXELS && (ratio - 1.0).abs() < ENERGY, "{differ} of the pixels differ, light {ratio}");
        let pixels = || 0..camera.width * camera.height;
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 5e-3);
        let share = |same: &dyn Fn(usize) -> bool| pixels().filter(|k| same(*k)).count() as f64 / pixels().len() as f64;
        assert!(share(&|k| found.surface.pixels()[k] == expected.surface.pixels()[k]) > 0.995);
        assert!(share(&|k| same_depth(found.depth_m.pixels()[k], expected.depth_m.pixels()[k])) > 0.995);
        assert!(share(&|k| near(&found.albedo.pixels()[k], &expected.albedo.pixels()[k])) > 1.0 - STRAY_PIXELS);
        assert!(share(&|k| near(&found.normal.pixels()[k], &expected.normal.pixels()[k])) > 1.0 - STRAY_PIXELS);
        assert!(share(&|k| found.lamp.pixels()[k][3] == expected.lamp.pixels()[k][3]) > 1.0 - STRAY_PIXELS);
        for (a, b) in [
            (found.rays.camera, expected.rays.camera),
            (found.rays.bounce, expected.rays.bounce),
            (found.rays.shadow, expected.rays.shadow),
        ] {
            assert!(a.abs_diff(b) as f64 <= 2e-3 * b as f64, "{:?} {:?}", found.rays, expected.rays);
        }
        // Developed on the GPU as on the processor, but for what lies at a level's edge.
        let developed = gpu.develop(&camera, &views, &Sampling::Path(settings), 0.5).unwrap().remove(0);
        let image = develop_frame(&found, 0.5);
        let off = image.pixels().iter().flatten().zip(developed.image.pixels().iter().flatten()).map(|(a, b)| a.abs_diff(*b));
        assert!(off.clone().max().unwrap() <= 1 && (off.filter(|d| *d > 0).count() as f64) < 0.01 * image.pixels().len() as f64);
        assert!(developed.finite && developed.depth_m == found.depth_m && developed.surface == found.surface);
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_view_without_memory_is_an_error_and_the_next_one_is_rendered() {
    if !adapter_is_there() {
        return;
    }
    let scene = opaque();
    let bvh = Bvh::build(&scene);
    let tracer = LightTracer::new(&scene, &bvh);
    let gpu = open(&tracer, None);
    let sampling = Sampling::Path(LightSettings { samples_per_pixel: 1, ..LightSettings::default() });
    let look = |width: usize| {
        let (camera, world_from_camera) = view(width, 8, 90.0, DVec3::new(0.4, 0.5, 1.6), DVec3::new(4.0, 3.0, 1.0));
        gpu.render(&camera, &[View { world_from_camera, key: 0 }], &sampling).map(|frames| frames.len())
    };
    assert_eq!(look(8).unwrap(), 1);
    gpu.context().limit_allocations(64 << 10);
    let error = look(4096).unwrap_err().to_string();
    assert!(error.contains("out of memory") && error.contains("--device cpu"), "{error}");
    gpu.context().limit_allocations(u64::MAX);
    assert_eq!(look(16).unwrap(), 1);
    assert!(look(1 << 28).unwrap_err().to_string().contains("--device cpu"), "more than a binding holds");
}

const CACHE: CacheSettings = CacheSettings {
    seed: 0,
    background: [0.1, 0.2, 0.3],
    coarse_points: 300,
    coarse_rays: 16,
    coarse_walks: 16,
    direct_rays: 24,
    gather_walks: 40,
    max_passes: 20,
    finest_m: 0.08,
};

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn tiles_of_cached_light_are_the_processors() {
    if !adapter_is_there() {
        return;
    }
    for scene in [everything(), opaque()] {
        let bvh = Bvh::build(&scene);
        let tracer = LightTracer::new(&scene, &bvh);
        let gpu = open(&tracer, Some(&CACHE));
        let [found, expected] = gpu.coarse_of_both(LightCache::new(&tracer, &CACHE, &|_, _| true).unwrap()).unwrap();
        assert_same_points("coarse", &found, &expected);
        // Of direct light the first and the third lattice, of indirect light one.
        for field in [1, 3, 6] {
            let tiles = gpu.tiles_of_both(field, 24).unwrap();
            assert!(tiles.len() > 12, "{} tiles", tiles.len());
            let bits: u32 = tiles.iter().map(|[(_, found), (_, expected)]| (found ^ expected).count_ones()).sum();
            assert!(f64::from(bits) < 0.01 * 64.0 * tiles.len() as f64, "field {field}: {bits} cells of {} tiles", tiles.len());
            let joined = |k: usize| tiles.iter().flat_map(|tile| tile[k].0.iter().copied()).collect::<Vec<u32>>();
            assert_same_points(&format!("field {field}"), &joined(0), &joined(1));
        }
    }
}

/// Of points' words: all but a few alike, and together of the same light.
fn assert_same_points(what: &str, found: &[u32], expected: &[u32]) {
    assert_eq!(found.len(), expected.len());
    let (mut off, mut light) = (0, [0.0f64; 2]);
    for (a, b) in found.chunks(12).zip(expected.chunks(12)) {
        let same = [0, 4, 8].iter().all(|k| close(vec3(&a[*k..]), vec3(&b[*k..]), 0.02));
        off += u32::from(!same || (f32::from_bits(a[3]) - f32::from_bits(b[3])).abs() > 0.02);
        for (sum, words) in light.iter_mut().zip([a, b]) {
            *sum += [0, 4, 8].iter().map(|k| f64::from(vec3(&words[*k..]).abs().element_sum())).sum::<f64>();
        }
    }
    let (points, ratio) = (found.len() / 12, light[0] / light[1]);
    assert!(points > 100 && light[1] > 0.0, "{what}: {points} points");
    // A ray that rounding lets by, or a patch drawn by a neighbouring number.
    assert!(f64::from(off) < 0.02 * points as f64, "{what}: {off} of {points} points are off, light {ratio}");
    assert!((ratio - 1.0).abs() < ENERGY, "{what}: light {ratio}");
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn images_from_cached_light_are_the_processors() {
    if !adapter_is_there() {
        return;
    }
    for scene in [everything(), opaque()] {
        let bvh = Bvh::build(&scene);
        let tracer = LightTracer::new(&scene, &bvh);
        let solve = || LightCache::new(&tracer, &CACHE, &|_, _| true);
        let gpu = open(&tracer, Some(&CACHE));
        let settings =
            ViewSettings { seed: 2, samples_per_pixel: 2, most_samples: 16, exposure_ev: -0.5, ..ViewSettings::default() };
        let (camera, world_from_camera) = view(36, 27, 90.0, DVec3::new(0.4, 0.5, 1.6), DVec3::new(4.0, 3.0, 1.0));
        let (other_camera, other) = view(12, 15, 70.0, DVec3::new(4.5, 3.5, 1.9), DVec3::new(1.0, 1.0, 0.5));
        let views = [View { world_from_camera, key: 5 }];
        let cache = solve().unwrap();
        let expected = cache.render(&camera, &world_from_camera, &settings, 5);
        let found = gpu.render(&camera, &views, &Sampling::Cached(settings)).unwrap().remove(0);
        let (differ, ratio) = compared(&found, &expected);
        assert!(differ < STRAY_PIXELS && (ratio - 1.0).abs() < ENERGY, "{differ} of the pixels differ, light {ratio}");
        let share = |same: &dyn Fn(usize) -> bool| (0..36 * 27).filter(|k| same(*k)).count() as f64 / (36.0 * 27.0);
        assert!(share(&|k| found.lamp.pixels()[k][3] == expected.lamp.pixels()[k][3]) > 1.0 - STRAY_PIXELS);
        assert!(
            found.rays.camera.abs_diff(expected.rays.camera) < expected.rays.camera / 100,
            "{:?} {:?}",
            found.rays,
            expected.rays
        );
        // Whatever was rendered before, and in which order: bytes depend on neither.
        if !scene.colors.is_empty() {
            continue;
        }
        let again = open(&tracer, Some(&CACHE));
        let elsewhere = |gpu: &GpuLight<'_>| {
            gpu.render(&other_camera, &[View { world_from_camera: other, key: 6 }], &Sampling::Cached(settings)).unwrap()
        };
        let first = elsewhere(&again);
        assert!(found == again.render(&camera, &views, &Sampling::Cached(settings)).unwrap().remove(0), "the same bytes");
        assert!(first == elsewhere(&gpu), "the same bytes");
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn views_rendered_together_are_those_rendered_alone() {
    if !adapter_is_there() {
        return;
    }
    let scene = opaque();
    let bvh = Bvh::build(&scene);
    let tracer = LightTracer::new(&scene, &bvh);
    let stamped = AdapterOptions { timestamps: true, ..testing::OPTIONS };
    let gpu = GpuLight::new(&tracer, Some(&CACHE), &stamped, &|_, _| true).unwrap().unwrap();
    let settings = ViewSettings { seed: 2, samples_per_pixel: 2, most_samples: 16, ..ViewSettings::default() };
    let (camera, _) = view(20, 13, 90.0, DVec3::ZERO, DVec3::X);
    let of = |key: u64| {
        let (_, world_from_camera) = view(20, 13, 90.0, DVec3::new(0.4 + 0.3 * key as f64, 0.5, 1.6), DVec3::new(4.0, 3.0, 1.0));
        View { world_from_camera, key }
    };
    let views: Vec<View> = (0..11).map(of).collect();
    for sampling in
        [Sampling::Cached(settings), Sampling::Path(LightSettings { samples_per_pixel: 2, ..LightSettings::default() })]
    {
        let together = gpu.render(&camera, &views, &sampling).unwrap();
        let developed = gpu.develop(&camera, &views, &sampling, 0.3).unwrap();
        // With room for two at a time.
        gpu.context().limit_allocations(80_000);
        gpu.reserve(&camera).unwrap();
        gpu.context().limit_allocations(u64::MAX);
        assert_eq!(gpu.together(&camera), 2);
        assert!(gpu.develop(&camera, &views, &sampling, 0.3).unwrap() == developed, "the same bytes");
        gpu.reserve(&camera).unwrap();
        assert_eq!(gpu.together(&camera), 8);
        for (k, view) in views.iter().enumerate() {
            assert!(gpu.render(&camera, &[*view], &sampling).unwrap()[0] == together[k], "{k}: the same bytes");
            assert!(gpu.develop(&camera, &[*view], &sampling, 0.3).unwrap()[0] == developed[k], "{k}: the same bytes");
        }
    }
    gpu.context().limit_allocations(64);
    let error = gpu.reserve(&camera).unwrap_err().to_string();
    assert!(error.contains("out of memory") && error.contains("--device cpu"), "{error}");
    gpu.context().limit_allocations(u64::MAX);
    let spent = gpu.spent();
    let seconds = |what: &str| spent.iter().find(|s| s.what == what).map(|s| s.seconds);
    assert!(["kernels", "coarse solution", "rendering", "waiting"].iter().all(|what| seconds(what) > Some(0.0)), "{spent:?}");
    if gpu.context().timestamps {
        assert!(
            ["gpu: first paths", "gpu: direct tiles", "gpu: paths"].iter().all(|what| seconds(what) > Some(0.0)),
            "{spent:?}"
        );
    }
}
