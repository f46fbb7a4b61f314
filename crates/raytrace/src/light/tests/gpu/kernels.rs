//! Kernels against the functions of their names: random numbers, trigonometry, rays, surfaces.

use super::*;

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
