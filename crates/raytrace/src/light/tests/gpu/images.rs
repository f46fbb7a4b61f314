//! Images and cached light against the processor's.

use super::*;

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
        let views = [LightView { world_from_camera, key: 5 }];
        let expected = tracer.render(&camera, &world_from_camera, &settings, 5);
        let found = gpu.render(&camera, &views, &LightSampling::Path(settings)).unwrap().remove(0);
        assert!(found == gpu.render(&camera, &views, &LightSampling::Path(settings)).unwrap().remove(0), "the same bytes again");
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
        let developed = gpu.develop(&camera, &views, &LightSampling::Path(settings), 0.5).unwrap().remove(0);
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
    let sampling = LightSampling::Path(LightSettings { samples_per_pixel: 1, ..LightSettings::default() });
    let look = |width: usize| {
        let (camera, world_from_camera) = view(width, 8, 90.0, DVec3::new(0.4, 0.5, 1.6), DVec3::new(4.0, 3.0, 1.0));
        gpu.render(&camera, &[LightView { world_from_camera, key: 0 }], &sampling).map(|frames| frames.len())
    };
    assert_eq!(look(8).unwrap(), 1);
    gpu.context().limit_allocations(64 << 10);
    let error = look(4096).unwrap_err().to_string();
    assert!(error.contains("out of memory") && error.contains("--device cpu"), "{error}");
    gpu.context().limit_allocations(u64::MAX);
    assert_eq!(look(16).unwrap(), 1);
    assert!(look(1 << 28).unwrap_err().to_string().contains("--device cpu"), "more than a binding holds");
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_lost_device_says_so_and_renders_nothing() {
    if !adapter_is_there() {
        return;
    }
    let scene = opaque();
    let bvh = Bvh::build(&scene);
    let tracer = LightTracer::new(&scene, &bvh);
    let paths = LightSampling::Path(LightSettings { samples_per_pixel: 1, ..LightSettings::default() });
    let cached = LightSampling::Cached(ViewSettings::default());
    for (cache, sampling) in [(None, paths), (Some(&CACHE), cached)] {
        let gpu = open(&tracer, cache);
        let look = || {
            let (camera, world_from_camera) = view(16, 8, 90.0, DVec3::new(0.4, 0.5, 1.6), DVec3::new(4.0, 3.0, 1.0));
            gpu.render(&camera, &[LightView { world_from_camera, key: 0 }], &sampling).map(|frames| frames.len())
        };
        assert_eq!(look().unwrap(), 1);
        gpu.context().device.destroy();
        for _ in 0..2 {
            let error = look().unwrap_err().to_string();
            assert!(error.contains("the device was lost") && error.contains("--resume"), "{error}");
        }
    }
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
        let views = [LightView { world_from_camera, key: 5 }];
        let cache = solve().unwrap();
        let expected = cache.render(&camera, &world_from_camera, &settings, 5);
        let found = gpu.render(&camera, &views, &LightSampling::Cached(settings)).unwrap().remove(0);
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
            gpu.render(&other_camera, &[LightView { world_from_camera: other, key: 6 }], &LightSampling::Cached(settings))
                .unwrap()
        };
        let first = elsewhere(&again);
        assert!(found == again.render(&camera, &views, &LightSampling::Cached(settings)).unwrap().remove(0), "the same bytes");
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
        LightView { world_from_camera, key }
    };
    let views: Vec<LightView> = (0..11).map(of).collect();
    for sampling in
        [LightSampling::Cached(settings), LightSampling::Path(LightSettings { samples_per_pixel: 2, ..LightSettings::default() })]
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
