//! Truths about scattered power, against quadratures that share no code with the gathering.

use super::cache::{Deposit, RadianceCache};
use super::photons::Event;
use super::*;
use crate::radio::{Polarization, RadioSettings, SPEED_OF_LIGHT, antenna, fresnel, scattering};
use corf_scene::model::{
    Material, Object, OpticalMaterial, Permittivity, RadioMaterial, Scattering, ScatteringPattern, Scene, Triangle,
};
use glam::Vec3;

/// Metal is not quite a perfect mirror: |R_TM|² away from grazing is this close to 1.
const METAL_MIRROR: f64 = 1e-2;
/// Several thousand deposits and more bring a total this close.
const PHOTON_TOTAL: f64 = 1e-2;
/// … and single lobes, all of one width, are interpolated between the nodes of a table this well on average.
const LOBE_TOTAL: f64 = 1.5e-2;

fn material(itu: &str, thickness_m: f64, scattering: Scattering) -> Material {
    let radio = RadioMaterial { id: itu.into(), permittivity: Permittivity::Itu(itu.into()), thickness_m, scattering };
    Material { name: itu.into(), optical: OpticalMaterial::default(), radio: Some(radio) }
}

fn scatters(coefficient: f64, pattern: ScatteringPattern) -> Scattering {
    Scattering { coefficient, xpd: 0.0, pattern }
}

/// A parallelogram as an object of its own.
fn quad(scene: &mut Scene, material: u32, corner: Vec3, a: Vec3, b: Vec3) {
    let (first, object) = (scene.positions.len() as u32, scene.objects.len() as u32);
    scene.objects.push(Object { name: format!("quad {object}") });
    scene.positions.extend([corner, corner + a, corner + a + b, corner + b]);
    for [i, j, k] in [[0, 1, 2], [0, 2, 3]] {
        scene.triangles.push(Triangle { vertices: [first + i, first + j, first + k], material, object });
    }
}

/// A closed room from the origin.
fn room(material: Material, size: Vec3) -> Scene {
    let mut scene = Scene { materials: vec![material], ..Scene::default() };
    let [x, y, z] = [Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z];
    for (corner, a, b) in [(Vec3::ZERO, x, y), (z, x, y), (Vec3::ZERO, y, z), (x, y, z), (Vec3::ZERO, z, x), (y, z, x)] {
        quad(&mut scene, 0, corner, a, b);
    }
    scene
}

fn settings(max_depth: usize) -> RadioSettings {
    RadioSettings { max_depth, ..RadioSettings::default() }
}

fn sampling() -> DiffuseSettings {
    DiffuseSettings { directions: 100_000, patch_size_m: 0.1, min_mirror_sr: 0.0, photons: 500_000, ..DiffuseSettings::default() }
}

fn power(field: &DiffuseField<'_, '_>, rx: DVec3, belongs: impl Fn(&Contribution) -> bool) -> f64 {
    field.contributions(rx).unwrap().iter().filter(|(_, c)| belongs(c)).map(|(_, c)| c.power).sum()
}

/// The scattered share of a linearly polarised wave: F·f_s/F × S²Γ² towards `out`, for a plate of unit `normal` on the wave's side.
fn scattered(slab: &crate::radio::Slab, k: DVec3, axis: DVec3, normal: DVec3, out: DVec3) -> f64 {
    let (cos_i, cos_s) = (-k.dot(normal), out.dot(normal));
    if cos_i <= 0.0 || cos_s <= 0.0 {
        return 0.0;
    }
    let response = fresnel::slab_response(slab, cos_i);
    let te = axis.dot(k.cross(normal).normalize_or(axis)).powi(2);
    let gamma2 = response.r_te.norm_squared() * te + response.r_tm.norm_squared() * (1.0 - te);
    let pattern = slab.scattering.pattern;
    let mirrored = k - normal * (2.0 * k.dot(normal));
    slab.scattering.coefficient.powi(2) * gamma2 * scattering::lobe(pattern, cos_s, out.dot(mirrored), -out.dot(k)) * cos_i
        / scattering::normalisation(pattern, cos_i)
}

/// Lobes are interpolated between nodes and few photons smoothed over patches, which adds 0.8 % to a lobe's total with all photons and
/// half a per cent more with the third of them that a guide lets be scattered (means of twelve fields; Lambertian: −0.2 … +0.2 %).
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
        let guided = mean_of(&|s| received(&DiffuseField::new(&tracer, tx, s).unwrap()));
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
        // A guide changes where photons go, not what they bring.
        assert!((guided / found - 1.0).abs() < TWICE_TOTAL, "{pattern:?}: {guided:e} {found:e}");
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
    let patches = Patches::new(&tracer.geometry, patch_m, DVec2::ZERO);
    let mut cache = RadianceCache::new(&illumination, &patches, patch_m, 1);
    let side = usize::from(tracer.geometry.faces[0].normal.z < 0.0);
    let is_bright = |at: DVec3| at.x < 0.8;
    let mut deposits = Vec::new();
    for (_, centre) in patches.of_face(0).filter(|(_, centre)| tracer.geometry.faces[0].contains(*centre)) {
        let (patch, middle) = patches.at(0, centre);
        for i in 0..500 {
            let (grain, power) = if is_bright(centre) { (i % patches::GRAINS, 1.0) } else { (middle, 1e-6) };
            let (slot, grain) = cache.slots().place((patch, grain), side);
            deposits.push(Deposit {
                slot,
                grain,
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
        field.gather_with(rx, &antenna(rx_polarization)).unwrap().iter().map(|a| a.power).sum()
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
    let iso = field.gather(rx).unwrap();
    for yaw in [0.0, 2.0] {
        let world_from_antenna = DMat3::from_rotation_z(yaw);
        let antenna = Antenna { pattern: AntennaPattern::Tr38901, world_from_antenna, ..Antenna::default() };
        let seen = field.gather_with(rx, &antenna).unwrap();
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
        field.landings = None;
        field.gather(rx).unwrap()
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
        let refined: f64 = field.gather(rx).unwrap().iter().map(|a| a.power).sum();
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
            DiffuseField::new(&tracer, tx, &sampling).unwrap().gather(rx).unwrap()
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

#[test]
fn quadrature_finds_the_outlines_of_shadows() {
    // A board on a shelf, taller than the lamp and longer than the shelf: beyond it all is dark.
    let edge = 0.1;
    let mut scene = Scene {
        materials: vec![
            material("wood", 0.04, scatters(0.7, ScatteringPattern::Directive { alpha_r: 3 })),
            material("metal", 0.01, scatters(0.0, ScatteringPattern::Lambertian)),
        ],
        ..Scene::default()
    };
    quad(&mut scene, 0, Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
    quad(&mut scene, 1, Vec3::new(edge as f32, -3.0, 0.0), Vec3::Y * 6.0, Vec3::Z * 4.0);
    let tracer = RadioTracer::without_bvh(&scene, settings(1)).unwrap();
    let (tx, rx) = (DVec3::new(-0.2, -0.1, 0.5), DVec3::new(-2.0, 0.2, 0.7));
    let slab = tracer.geometry().slabs[0].clone().unwrap();
    let n = 400;
    let mut expected = 0.0;
    for i in 0..n * n {
        let p = DVec3::new((0.5 + (i % n) as f64) / n as f64 * (0.5 + edge) - 0.5, (0.5 + (i / n) as f64) / n as f64 - 0.5, 0.0);
        let (k, out) = ((p - tx).normalize(), (rx - p).normalize());
        let received = scattered(&slab, k, antenna::theta_hat(k), DVec3::Z, out);
        expected += received / (tx.distance_squared(p) * rx.distance_squared(p));
    }
    expected *= (SPEED_OF_LIGHT / 60e9 / (4.0 * std::f64::consts::PI) / n as f64).powi(2) * (0.5 + edge);
    let field = DiffuseField::new(&tracer, tx, &DiffuseSettings { photons: 0, ..sampling() }).unwrap();
    let found = field.by_quadrature(rx).unwrap().straight.remove(0);
    assert!((found[0] / expected - 1.0).abs() < 1e-4 && found[1] == 0.0, "{found:?} {expected:e}");
}

#[test]
fn quadrature_and_gathering_agree_by_object() {
    let mut scene = room(material("plasterboard", 0.013, scatters(0.5, ScatteringPattern::Lambertian)), Vec3::new(5.0, 4.0, 3.0));
    // A leaning plank, a shelf, and a thin bar that shades both.
    quad(&mut scene, 0, Vec3::new(2.0, 1.5, 0.1), Vec3::new(0.6, 0.3, 0.0), Vec3::new(-0.1, 0.2, 1.5));
    quad(&mut scene, 0, Vec3::new(3.2, 2.1, 1.0), Vec3::X * 0.9, Vec3::Y * 0.4);
    quad(&mut scene, 0, Vec3::new(1.5, 1.4, 1.9), Vec3::new(2.5, 0.7, 0.1), Vec3::Z * 0.05);
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings { transmission: false, ..settings(2) }).unwrap();
    let (tx, rx) = (DVec3::new(0.7, 0.6, 2.6), DVec3::new(4.1, 0.9, 1.3));
    let field = DiffuseField::new(&tracer, tx, &DiffuseSettings { directions: 1_000_000, photons: 0, ..sampling() }).unwrap();
    let found = field.by_quadrature(rx).unwrap();
    let contributions = field.contributions(rx).unwrap();
    for (mirrored_before, found, tolerance) in [(false, &found.straight[0], 4e-3), (true, &found.mirrored, 1e-2)] {
        let mut compared = 0;
        for (object, found) in found.iter().enumerate() {
            let belongs = |c: &Contribution| c.object as usize == object && c.mirrored_before == mirrored_before && c.after == 0;
            let gathered: f64 = contributions.iter().filter(|(_, c)| belongs(c)).map(|(_, c)| c.power).sum();
            assert!(
                (found - gathered).abs() <= tolerance * gathered,
                "object {object}, {mirrored_before}: {found:e} {gathered:e}"
            );
            compared += usize::from(gathered > 0.0);
        }
        assert!(compared >= 8, "{compared}");
    }
}
