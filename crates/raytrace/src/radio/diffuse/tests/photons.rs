//! Tests of the light that photons carry.

use super::super::light::cache::{Deposit, RadianceCache};
use super::*;

/// Lobes are interpolated between nodes and few photons smoothed over patches, which adds 0.8 % to a lobe's total with all photons and
/// half a per cent more with the third of them that are scattered behind a pilot (means of twelve fields; Lambertian: −0.2 … +0.2 %).
const TWICE_TOTAL: f64 = 1.5e-2;
/// Fields whose mean is compared: each has its own photons.
const REPEATS: u64 = 3;

#[test]
fn light_scattered_twice_is_what_a_double_surface_integral_makes_of_it() {
    // Two plates at a right angle; the receiver looks at plate B (in the plane y = 0, 1 m square), A is in x = 0.
    let (tx, rx) = (DVec3::new(1.2, 0.9, 0.7), DVec3::new(0.9, 1.4, 0.3));
    for pattern in [
        ScatteringPattern::Lambertian,
        ScatteringPattern::Directive { alpha_r: 4 },
        ScatteringPattern::Backscatter { alpha_r: 3, alpha_i: 5, lambda: 0.6 },
    ] {
        let mut scene = Scene { materials: vec![material("concrete", 0.2, scatters(0.6, pattern))], ..Scene::default() };
        quad(&mut scene, 0, Vec3::new(0.0, 0.2, 0.0), Vec3::Y, Vec3::Z);
        quad(&mut scene, 0, Vec3::new(0.2, 0.0, 0.0), Vec3::X, Vec3::Z);
        let tracer = RadioTracer::without_bvh(&scene, RadioSettings { reflection: false, ..settings(2) }).unwrap();
        // One photon in two hundred hits both plates.
        let mean_of = |field: &dyn Fn(&DiffuseSettings) -> f64| {
            let photons = |phase| DiffuseSettings { photons: 10_000_000, phase, ..sampling() };
            (0..REPEATS).map(|phase| field(&photons(phase))).sum::<f64>() / REPEATS as f64
        };
        let received = |field: &DiffuseField<'_, '_>| power(field, rx, |c| c.indirect && c.object == 1);
        let chain = [Event::Scattered, Event::Scattered];
        let found = mean_of(&|s| received(&DiffuseField::of_chain(&tracer, tx, s, &chain).unwrap()));
        let piloted = mean_of(&|s| received(&DiffuseField::new(&tracer, tx, s).unwrap()));
        let slab = tracer.geometry().slabs[0].clone().unwrap();
        let n = 24;
        let at = |i: usize| (0.5 + i as f64) / n as f64;
        let mut expected = 0.0;
        for a in 0..n * n {
            let p = DVec3::new(0.0, 0.2 + at(a % n), at(a / n));
            for b in 0..n * n {
                let q = DVec3::new(0.2 + at(b % n), 0.0, at(b / n));
                let (k1, k2, k3) = ((p - tx).normalize(), (q - p).normalize(), (rx - q).normalize());
                // The V antenna sends along θ̂, and without K_x the field stays there.
                let first = scattered(&slab, k1, antenna::theta_hat(k1), DVec3::X, k2) / tx.distance_squared(p);
                let second = scattered(&slab, k2, antenna::theta_hat(k2), DVec3::Y, k3) / p.distance_squared(q);
                expected += first * second / q.distance_squared(rx);
            }
        }
        expected *= (SPEED_OF_LIGHT / 60e9 / (4.0 * std::f64::consts::PI) / (n * n) as f64).powi(2);
        assert!((found / expected - 1.0).abs() < TWICE_TOTAL, "{pattern:?}: {found:e} {expected:e}");
        // A pilot changes where photons go, not what they bring.
        assert!((piloted / found - 1.0).abs() < TWICE_TOTAL, "{pattern:?}: {piloted:e} {found:e}");
    }
}

#[test]
fn photons_by_one_mirror_bring_what_the_mirror_image_does() {
    let walls = material("plasterboard", 0.013, scatters(0.4, ScatteringPattern::Directive { alpha_r: 5 }));
    let scene = room(walls, Vec3::new(5.0, 4.0, 3.0));
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings { transmission: false, ..settings(2) }).unwrap();
    let (tx, rx) = (DVec3::new(1.0, 1.2, 2.1), DVec3::new(3.9, 2.9, 1.3));
    let sampling = DiffuseSettings { directions: 20_000, patch_size_m: 0.25, ..sampling() };
    let exact = DiffuseField::new(&tracer, tx, &DiffuseSettings { photons: 0, ..sampling }).unwrap();
    let photons = DiffuseField::of_chain(&tracer, tx, &sampling, &[Event::Specular, Event::Scattered]).unwrap();
    let expected = power(&exact, rx, |c| c.mirrored_before && c.after == 0);
    let found = power(&photons, rx, |c| c.after == 0);
    assert!((found / expected - 1.0).abs() < LOBE_TOTAL, "{found:e} {expected:e}");
    // Small mirrors are brought by photons once they are not among the sources: the sum stays.
    let all = |min_mirror_sr| {
        let field = DiffuseField::new(&tracer, tx, &DiffuseSettings { min_mirror_sr, ..sampling }).unwrap();
        (field.source_count(), power(&field, rx, |_| true))
    };
    let (many, few) = (all(0.0), all(2.0));
    assert!(many.0 == 7 && few.0 < 7 && (few.1 / many.1 - 1.0).abs() < PHOTON_TOTAL, "{many:?} {few:?}");
}

#[test]
fn light_around_what_hides_the_rest_of_a_patch_is_not_spread_beneath_it() {
    // Boards a hand above the floor and before a wall: what they shade from the mirrors they mostly hide from the receiver too. An even
    // share of a patch's light would lose 2 % here.
    let walls = material("plasterboard", 0.013, scatters(0.4, ScatteringPattern::Lambertian));
    let mut scene = room(walls, Vec3::new(3.0, 2.5, 2.2));
    for i in 0..24 {
        let (a, b) = ((i % 6) as f32 * 0.5 + 0.1, (i / 6) as f32 * 0.55 + 0.1);
        quad(&mut scene, 0, Vec3::new(a, b, 0.04), Vec3::X * 0.3, Vec3::Y * 0.3);
        quad(&mut scene, 0, Vec3::new(a, 0.04, b), Vec3::X * 0.3, Vec3::Z * 0.3);
    }
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings { transmission: false, ..settings(2) }).unwrap();
    let (tx, rx) = (DVec3::new(0.6, 1.3, 1.6), DVec3::new(2.1, 1.6, 1.4));
    let sampling = DiffuseSettings { directions: 30_000, patch_size_m: 0.25, photons: 2_000_000, ..sampling() };
    let exact = DiffuseField::new(&tracer, tx, &DiffuseSettings { photons: 0, ..sampling }).unwrap();
    let photons = DiffuseField::of_chain(&tracer, tx, &sampling, &[Event::Specular, Event::Scattered]).unwrap();
    let expected = power(&exact, rx, |c| c.mirrored_before && c.after == 0);
    let found = power(&photons, rx, |c| c.after == 0);
    assert!((found / expected - 1.0).abs() < PHOTON_TOTAL, "{found:e} {expected:e}");
}

#[test]
fn no_point_of_dark_patches_outshines_the_bright_ones_beside_them() {
    // A shelf, one half of it a million times as bright as the other, where all photons of the dark half fall on the middles of its patches.
    let mut scene =
        Scene { materials: vec![material("wood", 0.04, scatters(0.7, ScatteringPattern::Lambertian))], ..Scene::default() };
    quad(&mut scene, 0, Vec3::ZERO, Vec3::X * 1.6, Vec3::Y * 0.8);
    let tracer = RadioTracer::without_bvh(&scene, settings(2)).unwrap();
    let patch_m = 0.2;
    let illumination = Illumination::new(&tracer, DVec3::new(0.8, 0.4, 2.0), NO_MIRRORS_SR);
    let patches = Patches::new(&tracer.geometry, patch_m, DVec2::ZERO).unwrap();
    let mut cache = RadianceCache::new(&illumination, &patches, patch_m, 1);
    let side = usize::from(tracer.geometry.faces[0].normal.z < 0.0);
    let is_bright = |at: DVec3| at.x < 0.8;
    let mut deposits = Vec::new();
    for (_, centre) in patches.of_face(0).filter(|(_, centre)| tracer.geometry.faces[0].contains(*centre)) {
        let (patch, middle) = patches.at(0, centre);
        for i in 0..500 {
            let (subcell, power) =
                if is_bright(centre) { (i % crate::radio::diffuse::light::patches::GRAINS, 1.0) } else { (middle, 1e-6) };
            let (slot, subcell) = cache.slots().place((patch, subcell), side);
            deposits.push(Deposit {
                slot,
                subcell,
                left: 0,
                coherency: [0.5 * power, 0.5 * power, 0.0, 0.0],
                normal: Vec3::Z,
                specular: Vec3::Z,
                back: Vec3::Z,
                length_m: 1.0,
                scattered: true,
            });
        }
    }
    deposits.sort_by_key(|d| d.slot);
    cache.add(&[deposits]);
    cache.finish(&tracer.geometry, &patches, 1.0);
    let mut brightest = [0.0f64; 2];
    for i in 0..320 * 160 {
        let at = DVec3::new((f64::from(i % 320) + 0.5) * 0.005, (f64::from(i / 320) + 0.5) * 0.005, 0.0);
        let power = cache.outgoing(&patches, 0, at, side, DVec3::Z, 0).map_or(0.0, |out| out.coherency[0]);
        let half = usize::from(is_bright(at));
        brightest[half] = brightest[half].max(power);
    }
    assert!(brightest[0] < brightest[1], "{brightest:?}");
}

#[test]
fn every_class_of_chains_appears_when_the_depth_allows_it() {
    // Glass mirrors well enough for its third and fourth mirror image to survive the roulette of weak rays.
    let walls = material("glass", 0.02, scatters(0.4, ScatteringPattern::Lambertian));
    let mut scene = room(walls, Vec3::new(5.0, 4.0, 3.0));
    quad(&mut scene, 0, Vec3::new(2.5, 0.5, 0.0), Vec3::Y * 2.0, Vec3::Z * 2.0);
    for depth in 1..=5 {
        let tracer = RadioTracer::without_bvh(&scene, settings(depth)).unwrap();
        let sampling = DiffuseSettings { directions: 2_000, photons: 20_000, ..sampling() };
        let field = DiffuseField::new(&tracer, DVec3::new(1.0, 1.2, 2.1), &sampling).unwrap();
        let contributions = field.contributions(DVec3::new(3.9, 2.9, 1.3)).unwrap();
        for after in 0..6 {
            let has = |mirrored: bool, indirect: bool| {
                contributions.iter().any(|(_, c)| c.after == after && c.mirrored_before == mirrored && c.indirect == indirect)
            };
            assert_eq!(has(false, false), after < depth, "D, depth {depth}, {after} after");
            assert_eq!(has(true, false), after + 1 < depth, "SD, depth {depth}, {after} after");
            assert_eq!(has(false, true), after + 1 < depth, "indirect, depth {depth}, {after} after");
        }
    }
}

#[test]
fn a_photon_takes_no_more_interactions_than_the_depth_less_those_behind_it() {
    // SSD needs three interactions before the receiver's own: at depth 4 one more may follow, at depth 3 none.
    let walls = material("plasterboard", 0.013, scatters(0.4, ScatteringPattern::Lambertian));
    let scene = room(walls, Vec3::new(5.0, 4.0, 3.0));
    for (depth, deepest) in [(2, None), (3, Some(0)), (4, Some(1)), (5, Some(2))] {
        let tracer = RadioTracer::without_bvh(&scene, settings(depth)).unwrap();
        let sampling = DiffuseSettings { directions: 2_000, photons: 20_000, ..sampling() };
        let chain = [Event::Specular, Event::Specular, Event::Scattered];
        let field = DiffuseField::of_chain(&tracer, DVec3::new(1.0, 1.2, 2.1), &sampling, &chain).unwrap();
        let most = field.contributions(DVec3::new(3.9, 2.9, 1.3)).unwrap().iter().map(|(_, c)| c.after).max();
        assert_eq!(most, deepest, "depth {depth}");
    }
}

#[test]
fn a_closed_room_of_perfect_scatterers_keeps_all_power_at_every_bounce() {
    // Metal with S = 1 reflects nothing specularly and scatters all but the metal's own loss.
    let scene = room(material("metal", 0.01, scatters(1.0, ScatteringPattern::Lambertian)), Vec3::new(3.0, 2.0, 2.5));
    let tracer = RadioTracer::without_bvh(&scene, settings(5)).unwrap();
    for bounces in 2..=5 {
        let chain = vec![Event::Scattered; bounces];
        let sampling = DiffuseSettings { photons: 20_000, ..sampling() };
        let field = DiffuseField::of_chain(&tracer, DVec3::new(1.0, 0.8, 1.1), &sampling, &chain).unwrap();
        let share = field.cache.as_ref().unwrap().scattered_power() / 20_000.0;
        // Every photon arrives; a per cent of loss a bounce at most.
        assert!(share < 1.0 + 1e-6 && share > 1.0 - METAL_MIRROR * bounces as f64, "{bounces}: {share}");
    }
}
