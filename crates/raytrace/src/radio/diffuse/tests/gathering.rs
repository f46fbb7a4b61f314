//! Tests of gathering at a receiver.

use super::*;

#[test]
fn two_mirrors_behind_the_scattering_show_the_receiver_twice_mirrored() {
    // A wall in y = 2 over a metal floor (z = 0) beside a metal wall (x = −2); DSS by both, in either order, is D of the receiver's
    // image in the edge between them.
    let mut scene = Scene {
        materials: vec![
            material("concrete", 0.2, scatters(0.5, ScatteringPattern::Lambertian)),
            material("metal", 0.01, scatters(0.0, ScatteringPattern::Lambertian)),
        ],
        ..Scene::default()
    };
    quad(&mut scene, 0, Vec3::new(-1.0, 2.0, 0.5), Vec3::X * 2.0, Vec3::Z);
    quad(&mut scene, 1, Vec3::new(-2.0, -20.0, 0.0), Vec3::X * 22.0, Vec3::Y * 40.0);
    quad(&mut scene, 1, Vec3::new(-2.0, -20.0, 0.0), Vec3::Z * 20.0, Vec3::Y * 40.0);
    let (tx, rx) = (DVec3::new(-0.6, -0.5, 1.3), DVec3::new(0.9, 0.2, 0.8));
    let image = DVec3::new(-4.0 - rx.x, rx.y, -rx.z);
    let tracer = RadioTracer::without_bvh(&scene, settings(3)).unwrap();
    let sampling = DiffuseSettings { directions: 400_000, photons: 0, ..sampling() };
    let found = power(&DiffuseField::new(&tracer, tx, &sampling).unwrap(), rx, |c| !c.mirrored_before && c.after == 2);
    let slab = tracer.geometry().slabs[0].clone().unwrap();
    let n = 200;
    let mut expected = 0.0;
    for i in 0..n * n {
        let p = DVec3::new(-1.0 + 2.0 * (0.5 + (i % n) as f64) / n as f64, 2.0, 0.5 + (0.5 + (i / n) as f64) / n as f64);
        let (k, out) = ((p - tx).normalize(), (image - p).normalize());
        let share = scattered(&slab, k, antenna::theta_hat(k), DVec3::NEG_Y, out);
        // The metal mirrors turn the vertical field; an element that takes all polarisations would see all of it.
        expected += share / (tx.distance_squared(p) * image.distance_squared(p));
    }
    expected *= (SPEED_OF_LIGHT / 60e9 / (4.0 * std::f64::consts::PI)).powi(2) * 2.0 / (n * n) as f64;
    assert!((found / expected - 1.0).abs() < 2.0 * METAL_MIRROR, "{found:e} {expected:e}");
}

#[test]
fn a_slab_behind_the_scattering_takes_its_share() {
    // A small wall seen through a pane; all at one height, so that the vertical field is perpendicular to the plane of incidence.
    let scene = |pane: bool| {
        let mut scene = Scene {
            materials: vec![
                material("concrete", 0.2, scatters(0.5, ScatteringPattern::Lambertian)),
                material("glass", 0.006, scatters(0.0, ScatteringPattern::Lambertian)),
            ],
            ..Scene::default()
        };
        quad(&mut scene, 0, Vec3::new(-0.02, 2.0, -0.02), Vec3::X * 0.04, Vec3::Z * 0.04);
        if pane {
            quad(&mut scene, 1, Vec3::new(0.2, 1.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
        }
        scene
    };
    let (tx, rx) = (DVec3::new(-1.0, -0.5, 0.0), DVec3::new(1.4, 0.1, 0.0));
    let sampling = DiffuseSettings { directions: 2_000_000, photons: 0, ..sampling() };
    let total = |pane: bool| {
        let scene = scene(pane);
        let tracer = RadioTracer::without_bvh(&scene, settings(2)).unwrap();
        let slab = tracer.geometry().slabs[1].clone();
        (power(&DiffuseField::new(&tracer, tx, &sampling).unwrap(), rx, |c| c.after == usize::from(pane)), slab)
    };
    let (behind, pane) = total(true);
    let cos = (DVec3::new(0.0, 2.0, 0.0) - rx).normalize().y;
    let expected = fresnel::slab_response(&pane.unwrap(), cos).t_te.norm_squared();
    // The wall subtends 1°, over which the glass fringe moves this much.
    assert!((behind / total(false).0 / expected - 1.0).abs() < 2e-2, "{} {expected}", behind / total(false).0);
}

#[test]
fn ports_of_a_receiver_add_and_those_of_a_transmitter_share() {
    let walls =
        material("wood", 0.04, Scattering { coefficient: 0.7, xpd: 0.3, pattern: ScatteringPattern::Directive { alpha_r: 4 } });
    let scene = room(walls, Vec3::new(3.0, 2.5, 2.5));
    let (tx, rx) = (DVec3::new(1.0, 1.2, 1.1), DVec3::new(2.2, 0.9, 1.3));
    let total = |tx_polarization: Polarization, rx_polarization: Polarization| -> f64 {
        let antenna = |polarization| Antenna { polarization, ..Antenna::default() };
        let setup = RadioSettings { tx_antenna: antenna(tx_polarization), ..settings(2) };
        let tracer = RadioTracer::without_bvh(&scene, setup).unwrap();
        let sampling = DiffuseSettings { directions: 4_000, photons: 200_000, ..sampling() };
        let field = DiffuseField::new(&tracer, tx, &sampling).unwrap();
        field.gather(rx, &antenna(rx_polarization), &WorldExtent::Sphere).unwrap().iter().map(|a| a.power).sum()
    };
    use Polarization::{H, V, VH};
    let [vv, vh, hv, hh] = [(V, V), (V, H), (H, V), (H, H)].map(|(t, r)| total(t, r));
    assert!((total(V, VH) / (vv + vh) - 1.0).abs() < 1e-3);
    assert!((total(VH, VH) / (0.5 * (vv + vh + hv + hh)) - 1.0).abs() < PHOTON_TOTAL);
    assert!((total(VH, V) / (0.5 * (vv + hv)) - 1.0).abs() < PHOTON_TOTAL);
}

#[test]
fn an_element_with_a_pattern_turns_with_its_platform() {
    use crate::radio::AntennaPattern;
    let scene = room(material("wood", 0.04, scatters(0.7, ScatteringPattern::Lambertian)), Vec3::new(3.0, 2.5, 2.5));
    let tracer = RadioTracer::without_bvh(&scene, settings(1)).unwrap();
    // One arrival per direction of the same lattice, whatever the antenna.
    let sampling = DiffuseSettings { directions: 4_000, photons: 0, resolution_deg: 0.0, ..sampling() };
    let field = DiffuseField::new(&tracer, DVec3::new(1.0, 1.2, 1.1), &sampling).unwrap();
    let rx = DVec3::new(2.2, 0.9, 1.3);
    let iso = field.gather(rx, field.antenna(), &WorldExtent::Sphere).unwrap();
    for yaw in [0.0, 2.0] {
        let world_from_antenna = DMat3::from_rotation_z(yaw);
        let antenna = Antenna { pattern: AntennaPattern::Tr38901, world_from_antenna, ..Antenna::default() };
        let seen = field.gather(rx, &antenna, &WorldExtent::Sphere).unwrap();
        for (a, b) in iso.iter().zip(&seen) {
            let gain = antenna::amplitude(AntennaPattern::Tr38901, world_from_antenna.transpose() * a.direction).powi(2);
            assert!((b.power / a.power / gain - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn a_hot_spot_is_resolved_between_the_directions_of_the_lattice() {
    let scene = room(material("wood", 0.04, scatters(0.7, ScatteringPattern::Lambertian)), Vec3::new(6.0, 4.0, 3.0));
    let tracer = RadioTracer::without_bvh(&scene, settings(1)).unwrap();
    let rx = DVec3::new(5.2, 0.9, 1.3);
    let field = |directions, resolution_deg, phase| {
        let sampling = DiffuseSettings { directions, photons: 0, resolution_deg, phase, ..sampling() };
        let mut field = DiffuseField::new(&tracer, DVec3::new(0.2, 1.2, 1.1), &sampling).unwrap();
        // The transmitter's own rays would resolve it without.
        field.light_hits = None;
        field.gather(rx, field.antenna(), &WorldExtent::Sphere).unwrap()
    };
    // Power per steradian within a few degrees of the hot spot behind the transmitter, where light varies the most.
    let towards = (DVec3::new(0.0, 1.2, 1.1) - rx).normalize();
    let near = |arrivals: &[Arrival]| -> f64 {
        arrivals.iter().map(|a| a.power * (-(1.0 - a.direction.dot(towards)) / 3.0f64.to_radians().powi(2)).exp()).sum()
    };
    let truth = near(&field(1_000_000, 0.0, 0));
    let error = |resolution_deg| -> f64 {
        let errors = (1..9).map(|phase| (near(&field(4_000, resolution_deg, phase)) / truth - 1.0).powi(2));
        (errors.sum::<f64>() / 8.0).sqrt()
    };
    let (plain, refined) = (error(0.0), error(3.0));
    assert!(refined < 0.7 * plain, "{refined} {plain}");
    assert!(refined < 0.03, "{refined}");
}

#[test]
fn a_bright_shelf_seen_edge_on_sends_what_a_surface_integral_says() {
    // A lamp above a metre of shelf, from 3 m away and 3 cm above its plane: 0.6°, where one direction in 100 000 meets it and counts for 100.
    let mut scene = Scene {
        materials: vec![material("wood", 0.04, scatters(0.7, ScatteringPattern::Directive { alpha_r: 3 }))],
        ..Scene::default()
    };
    quad(&mut scene, 0, Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
    let tracer = RadioTracer::without_bvh(&scene, settings(1)).unwrap();
    let (tx, rx) = (DVec3::new(0.05, -0.1, 0.5), DVec3::new(3.0, 0.2, 0.03));
    let slab = tracer.geometry().slabs[0].clone().unwrap();
    let n = 400;
    let mut expected = 0.0;
    for i in 0..n * n {
        let p = DVec3::new((0.5 + (i % n) as f64) / n as f64 - 0.5, (0.5 + (i / n) as f64) / n as f64 - 0.5, 0.0);
        let (k, out) = ((p - tx).normalize(), (rx - p).normalize());
        let received = scattered(&slab, k, antenna::theta_hat(k), DVec3::Z, out);
        expected += received / (tx.distance_squared(p) * rx.distance_squared(p));
    }
    expected *= (SPEED_OF_LIGHT / 60e9 / (4.0 * std::f64::consts::PI) / n as f64).powi(2);
    let quadrature: f64 =
        DiffuseField::new(&tracer, tx, &sampling()).unwrap().by_quadrature(rx).unwrap().straight[0].iter().sum();
    assert!((quadrature / expected - 1.0).abs() < 1e-4, "{quadrature:e} {expected:e}");
    for phase in 0..6 {
        let sampling = DiffuseSettings { directions: 20_000, photons: 0, phase, ..sampling() };
        let field = DiffuseField::new(&tracer, tx, &sampling).unwrap();
        let even = power(&field, rx, |c| c.after == 0);
        let refined: f64 = field.gather(rx, field.antenna(), &WorldExtent::Sphere).unwrap().iter().map(|a| a.power).sum();
        assert!((even / expected - 1.0).abs() < 0.01, "phase {phase}: {even:e} {expected:e}");
        assert!((refined / expected - 1.0).abs() < 0.01, "phase {phase}, refined: {refined:e} {expected:e}");
    }
}

#[test]
fn the_transmitters_rays_and_the_receivers_count_every_point_once() {
    // A shelf under a pane, half of it behind a screen: lit and seen straight, through glass, and not at all. Most of it is the
    // transmitter's, which is nearer.
    let mut scene = Scene {
        materials: vec![
            material("wood", 0.04, scatters(0.7, ScatteringPattern::Lambertian)),
            material("glass", 0.006, scatters(0.0, ScatteringPattern::Lambertian)),
            material("metal", 0.01, scatters(0.0, ScatteringPattern::Lambertian)),
        ],
        ..Scene::default()
    };
    quad(&mut scene, 0, Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
    quad(&mut scene, 1, Vec3::new(-0.4, -0.3, 0.2), Vec3::X * 0.5, Vec3::Y * 0.6);
    quad(&mut scene, 2, Vec3::new(1.0, 0.1, -0.5), Vec3::Y, Vec3::Z * 1.5);
    let (tx, rx) = (DVec3::new(0.05, -0.1, 0.5), DVec3::new(2.5, 0.2, 0.6));
    for (depth, pattern) in [(1, "no slab can be crossed"), (2, "one slab can be crossed")] {
        let tracer = RadioTracer::without_bvh(&scene, RadioSettings { reflection: false, ..settings(depth) }).unwrap();
        let field = |directions, phase| {
            DiffuseField::new(&tracer, tx, &DiffuseSettings { directions, photons: 0, phase, ..sampling() }).unwrap()
        };
        let truth: f64 = field(1000, 0).by_quadrature(rx).unwrap().straight.iter().flatten().sum();
        let field = field(40_000, 1);
        let (found, landed) = (power(&field, rx, |c| c.after == 0), {
            let lattice = Lattice::new(40_000, false, true);
            field.landed(rx, &tracer.settings.rx_antenna, lattice, |_| true).iter().map(|(_, c)| c.power).sum::<f64>()
        });
        assert!(landed > 0.5 * found, "{pattern}: {landed:e} of {found:e}");
        assert!((found / truth - 1.0).abs() < 5e-3, "{pattern}: {found:e} {truth:e}");
    }
}

/// Forty slats under a lamp, to be seen straight and through a pane, or in a metal door.
fn slats(in_door: bool) -> Scene {
    let mut scene = Scene {
        materials: vec![
            material("wood", 0.04, scatters(0.7, ScatteringPattern::Directive { alpha_r: 3 })),
            material("glass", 0.006, scatters(0.0, ScatteringPattern::Lambertian)),
            material("metal", 0.01, scatters(0.0, ScatteringPattern::Lambertian)),
        ],
        ..Scene::default()
    };
    for i in 0..40 {
        quad(&mut scene, 0, Vec3::new(-1.0 + 0.05 * i as f32, -0.4, 0.001 * i as f32), Vec3::X * 0.008, Vec3::Y * 0.8);
    }
    if in_door {
        quad(&mut scene, 2, Vec3::new(-2.0, 1.0, -1.0), Vec3::X * 6.0, Vec3::Z * 3.0);
    } else {
        quad(&mut scene, 1, Vec3::new(2.0, 0.05, -1.0), Vec3::Y, Vec3::Z * 2.0);
    }
    scene
}

#[test]
fn even_arrivals_count_every_point_once_and_none_for_much() {
    // Few directions meet any one of the slats.
    for in_door in [false, true] {
        let scene = slats(in_door);
        let tracer = RadioTracer::without_bvh(&scene, settings(2)).unwrap();
        let (tx, rx) = (DVec3::new(0.05, -0.1, 0.7), DVec3::new(3.2, 0.1, 0.8));
        let arrivals = |directions, even_arrivals, phase| {
            let sampling = DiffuseSettings { directions, even_arrivals, resolution_deg: 4.0, photons: 0, phase, ..sampling() };
            let field = DiffuseField::new(&tracer, tx, &sampling).unwrap();
            field.gather(rx, field.antenna(), &WorldExtent::Sphere).unwrap()
        };
        let truth: f64 = arrivals(2_000_000, false, 0).iter().map(|a| a.power).sum();
        let [plain, even] = [false, true].map(|even| (1..33).map(|phase| arrivals(20_000, even, phase)).collect::<Vec<_>>());
        let powers: Vec<f64> = even.iter().map(|run| run.iter().map(|a| a.power).sum::<f64>() / truth).collect();
        let mean = powers.iter().sum::<f64>() / 32.0;
        let error = (powers.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / (31.0 * 32.0)).sqrt();
        let [plain, even] = [plain, even].map(|runs| runs.iter().flatten().map(|a| a.power / truth).fold(0.0, f64::max));
        assert!(error < 0.02 && (mean - 1.0).abs() < 4.0 * error, "in door {in_door}: {mean} ± {error}");
        assert!(even < 0.6 * plain, "in door {in_door}: {even} {plain}");
    }
}

#[test]
fn points_of_the_transmitters_rays_count_as_much_where_chance_picks_few() {
    let scene = slats(true);
    let tracer = RadioTracer::without_bvh(&scene, settings(2)).unwrap();
    let (tx, rx) = (DVec3::new(0.05, -0.1, 0.7), DVec3::new(3.2, 0.1, 0.8));
    let [mut all, mut few] = [(0.0, 0usize); 2];
    for phase in 1..65 {
        let sampling = DiffuseSettings { directions: 20_000, even_arrivals: true, photons: 0, phase, ..sampling() };
        let field = DiffuseField::new(&tracer, tx, &sampling).unwrap();
        let gathering = field.gathering(rx, &tracer.settings.rx_antenna, |_| true);
        let views = gathering.views.as_ref().unwrap();
        let add = |sum: &mut (f64, usize), faint: f64| {
            let landed = gathering.landed_by(views, faint, |_| true);
            *sum = (sum.0 + landed.iter().map(|a| a.power).sum::<f64>(), sum.1 + landed.len());
            landed.iter().map(|a| a.power).fold(0.0, f64::max)
        };
        let most = add(&mut all, 0.0);
        add(&mut few, 100.0 * most);
    }
    assert!(all.1 > 8000 && few.1 * 3 < all.1, "{} {}", all.1, few.1);
    assert!((few.0 / all.0 - 1.0).abs() < 0.02, "{:e} {:e}", few.0, all.0);
}
