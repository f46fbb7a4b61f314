//! The diffuse field and spectra of it.

use crate::rooms::{add_box, empty, material, room, settings};
use corf_raytrace::Bvh;
use corf_raytrace::radio::{
    Arrival, DiffuseField, DiffuseSettings, PlanarArray, RadioSettings, RadioTracer, SPEED_OF_LIGHT, Search, WorldExtent,
};
use corf_raytrace::spectrum::{Bartlett, RearHalfSpace, mpc, share_in_frame};
use corf_scene::config::DatasetConfig;
use corf_scene::keyframe::DbRange;
use corf_scene::model::{Object, Scattering, ScatteringPattern, Scene, Triangle};
use corf_scene::{Pinhole, Raster, Rigid3, trajectory};
use glam::{DMat3, DVec3, Vec3};

/// A patch of a wall at y = 2 (x ∈ [−1, 1], z ∈ [0.5, 1.5]) over a large metal floor at z = 0.
fn wall_over_floor(pattern: ScatteringPattern) -> Scene {
    let mut scene = empty();
    let mut wall = material("wall", "concrete", 0.2);
    if let Some(radio) = &mut wall.radio {
        radio.scattering = Scattering { coefficient: 0.5, xpd: 0.0, pattern };
    }
    let mut floor = material("floor", "metal", 0.01);
    if let Some(radio) = &mut floor.radio {
        radio.scattering.coefficient = 0.0;
    }
    scene.materials = vec![wall, floor];
    scene.objects = vec![Object { name: "wall".into() }, Object { name: "floor".into() }];
    scene.positions = vec![
        Vec3::new(-1.0, 2.0, 0.5),
        Vec3::new(1.0, 2.0, 0.5),
        Vec3::new(1.0, 2.0, 1.5),
        Vec3::new(-1.0, 2.0, 1.5),
        Vec3::new(-20.0, -20.0, 0.0),
        Vec3::new(20.0, -20.0, 0.0),
        Vec3::new(20.0, 20.0, 0.0),
        Vec3::new(-20.0, 20.0, 0.0),
    ];
    let quad = |first: u32, number: u32| {
        [[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| Triangle { vertices: t.map(|v| first + v), material: number, object: number })
    };
    scene.triangles = quad(0, 0).into_iter().chain(quad(4, 1)).collect();
    scene
}

/// Metal is not quite a perfect mirror: |R_TM|² away from grazing is this close to 1.
const METAL_MIRROR: f64 = 1e-2;

#[test]
fn a_metal_floor_mirrors_the_scattering_wall() {
    // D: area quadrature of (λ/4π)² S²Γ²f_s cosθ_i dA/(r₁²r₂²) with Γ² of the vertical field, independent of the gathering lattice.
    // DS: the same with the receiver's image under the floor. SD: with the transmitter's.
    let (tx, rx) = (DVec3::new(-0.6, -0.5, 1.3), DVec3::new(0.9, 0.2, 0.8));
    let mirrored = |p: DVec3| DVec3::new(p.x, p.y, -p.z);
    let scene = wall_over_floor(ScatteringPattern::Lambertian);
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings { max_interactions: 2, ..RadioSettings::default() }).unwrap();
    let sampling = DiffuseSettings { directions: 400_000, min_mirror_sr: 0.0, ..DiffuseSettings::default() };
    let found = DiffuseField::new(&tracer, tx, &sampling).unwrap().contributions(rx).unwrap();
    let found = |before: bool, after: usize| -> f64 {
        found.iter().filter(|(_, c)| c.mirrored_before == before && c.after == after).map(|(_, c)| c.power).sum()
    };
    let slab = tracer.geometry().slabs[0].clone().unwrap();
    let quadrature = |tx: DVec3, rx: DVec3| -> f64 {
        let n = 300;
        let mut sum = 0.0;
        for i in 0..n * n {
            let p = DVec3::new(-1.0 + 2.0 * (0.5 + (i % n) as f64) / n as f64, 2.0, 0.5 + (0.5 + (i / n) as f64) / n as f64);
            let (k, s) = ((p - tx).normalize(), (rx - p).normalize());
            let normal = DVec3::NEG_Y;
            let (cos_i, cos_s) = (-k.dot(normal), s.dot(normal));
            let response = corf_raytrace::radio::fresnel::slab_response(&slab, cos_i);
            let e = corf_raytrace::radio::antenna::theta_hat(k);
            let te = e.dot(k.cross(normal).normalize()).powi(2);
            let gamma2 = response.r_te.norm_squared() * te + response.r_tm.norm_squared() * (1.0 - te);
            sum += 0.25 * gamma2 * cos_s / std::f64::consts::PI * cos_i / (tx.distance_squared(p) * rx.distance_squared(p));
        }
        let area = 2.0 / (n * n) as f64;
        (SPEED_OF_LIGHT / 60e9 / (4.0 * std::f64::consts::PI)).powi(2) * sum * area
    };
    for (name, found, expected, tolerance) in [
        ("D", found(false, 0), quadrature(tx, rx), 1e-3),
        ("DS", found(false, 1), quadrature(tx, mirrored(rx)), METAL_MIRROR),
        ("SD", found(true, 0), quadrature(mirrored(tx), rx), METAL_MIRROR),
    ] {
        assert!((found / expected - 1.0).abs() < tolerance, "{name}: {found:e} {expected:e}");
    }
}

#[test]
fn thread_count_changes_nothing() {
    let scene = room();
    let bvh = Bvh::build(&scene);
    let tracer = RadioTracer::new(&scene, &bvh, settings(Search::Lattice { rays: 20_000 })).unwrap();
    let (tx, rx) = (DVec3::new(1.0, 1.5, 2.0), DVec3::new(4.7, 3.9, 1.1));
    let sampling = DiffuseSettings { directions: 5_000, ..DiffuseSettings::default() };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let field = DiffuseField::new(&tracer, tx, &sampling).unwrap();
            let diffuse = field.gather(rx, field.antenna(), &WorldExtent::Sphere).unwrap();
            (tracer.paths(tx, rx).unwrap(), diffuse)
        })
    };
    assert_eq!(run(1), run(2));
}

#[test]
fn cross_polarisation_takes_its_share_of_the_vertical_power() {
    let power = |xpd: f64| -> f64 {
        let mut scene = wall_over_floor(ScatteringPattern::Directive { alpha_r: 3 });
        if let Some(radio) = &mut scene.materials[0].radio {
            radio.scattering.xpd = xpd;
        }
        let tracer = RadioTracer::without_bvh(&scene, RadioSettings { max_interactions: 1, ..RadioSettings::default() }).unwrap();
        let sampling = DiffuseSettings { directions: 20_000, ..DiffuseSettings::default() };
        let field = DiffuseField::new(&tracer, DVec3::new(-0.6, -0.5, 1.3), &sampling).unwrap();
        field.gather(DVec3::new(0.9, 0.2, 0.8), field.antenna(), &WorldExtent::Sphere).unwrap().iter().map(|a| a.power).sum()
    };
    // The transmitted field is vertical, the receiver takes the vertical component: 1 − K_x of the power.
    assert!((power(0.25) / power(0.0) - 0.75).abs() < 1e-9);
}

/// The pixel-wise criterion for a converged spectrum: scalar PSNR between two samplings.
const CONVERGED_DB: f64 = 40.0;

fn scalar_psnr(a: &Raster<f32>, b: &Raster<f32>, range: &DbRange) -> f64 {
    let squares: f64 =
        a.pixels().iter().zip(b.pixels()).map(|(a, b)| f64::from(range.scalar(*a) - range.scalar(*b)).powi(2)).sum();
    -10.0 * (squares / a.pixels().len() as f64).log10()
}

#[test]
fn lobby_mini_is_converged_with_its_own_settings() {
    let config = DatasetConfig::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/lobby-mini.toml")).unwrap();
    let scene_config = config.load_scene_config().unwrap();
    let (scene, _) = scene_config.load_scene().unwrap();
    let bvh = Bvh::build(&scene);
    let setup =
        RadioSettings { max_interactions: config.radio.max_interactions, ..settings(Search::Auto { rays: config.radio.rays }) };
    let tracer = RadioTracer::new(&scene, &bvh, setup).unwrap();
    let (tx, camera) = (scene_config.transmitter.position(), config.radio_camera());
    let transmitter = tracer.transmitter(tx).unwrap();
    let field = |phase| {
        let radio = &config.radio;
        let sampling = DiffuseSettings {
            patch_size_m: radio.patch_size_m,
            directions: radio.directions,
            photons: radio.photons,
            phase,
            ..DiffuseSettings::default()
        };
        DiffuseField::new(&tracer, tx, &sampling).unwrap()
    };
    let fields = [field(0), field(1)];
    // The range the whole dataset comes out with.
    let range = DbRange { min_db: -52.0 - config.radio.dynamic_range_db, max_db: -52.0 };
    let poses = trajectory::generate_between(scene_config.trajectory.as_ref().unwrap(), config.keyframes, config.way).unwrap();
    for index in [4, 20, 36] {
        let pose = &poses[index].world_from_camera;
        let specular: Vec<Arrival> =
            transmitter.paths(pose.translation).unwrap().iter().map(|p| Arrival::from_path(p, 60e9)).collect();
        let [a, b] = fields.each_ref().map(|field| {
            let mut arrivals = specular.clone();
            arrivals.extend(
                field.gather(pose.translation, field.antenna(), &WorldExtent::View { camera, world_from_camera: *pose }).unwrap(),
            );
            mpc(&arrivals, &camera, pose, config.radio.lobe_width_deg)
        });
        let psnr = scalar_psnr(&a, &b, &range);
        assert!(psnr >= CONVERGED_DB && psnr.is_finite(), "keyframe {index}: {psnr:.1} dB");
    }
}

#[test]
fn two_samplings_of_the_diffuse_field_give_the_same_spectrum() {
    let scene = room();
    let bvh = Bvh::build(&scene);
    let tracer = RadioTracer::new(&scene, &bvh, RadioSettings::default()).unwrap();
    let tx = DVec3::new(1.0, 1.5, 2.0);
    let camera = Pinhole::from_horizontal_fov(96, 64, 90.0);
    let pose = Rigid3::looking_at(DVec3::new(5.3, 3.1, 1.6), DVec3::new(2.0, 2.0, 1.2), DVec3::Z);
    let transmitter = tracer.transmitter(tx).unwrap();
    let specular: Vec<Arrival> =
        transmitter.paths(pose.translation).unwrap().iter().map(|p| Arrival::from_path(p, 60e9)).collect();
    let spectrum = |phase: u64| {
        let field = DiffuseField::new(&tracer, tx, &DiffuseSettings { phase, ..DiffuseSettings::default() }).unwrap();
        let mut arrivals = specular.clone();
        arrivals.extend(
            field.gather(pose.translation, field.antenna(), &WorldExtent::View { camera, world_from_camera: pose }).unwrap(),
        );
        mpc(&arrivals, &camera, &pose, 1.0)
    };
    let (a, b) = (spectrum(0), spectrum(9));
    let peak = a.pixels().iter().fold(0f32, |m, v| m.max(*v));
    let max_db = 10.0 * f64::from(peak).log10();
    let range = DbRange { min_db: max_db - 60.0, max_db };
    let psnr = scalar_psnr(&a, &b, &range);
    assert!(psnr >= CONVERGED_DB, "{psnr:.1} dB");
    // Not because the picture is empty: most pixels are above the floor, and the two samplings do differ.
    assert!(a.pixels().iter().filter(|v| range.scalar(**v) > 0.0).count() > 96 * 64 / 2);
    assert!(psnr.is_finite());
}

/// Cells that met something small by chance must not be corrected alone: those that missed theirs never are.
#[test]
fn refining_hardly_changes_an_expectation() {
    let mut scene = room();
    for i in 0..9 {
        // Cubes behind the transmitter, two thirds of a degree wide for a receiver whose directions are four degrees apart.
        let corner = Vec3::new(0.5, 1.2 + 0.3 * (i % 3) as f32, 1.7 + 0.3 * (i / 3) as f32);
        add_box(&mut scene, &format!("cube{i}"), 1, corner, corner + 0.05);
    }
    if let Some(walls) = &mut scene.materials[0].radio {
        walls.scattering.coefficient = 0.05;
    }
    let bvh = Bvh::build(&scene);
    let setup = RadioSettings { max_interactions: 1, ..RadioSettings::default() };
    let tracer = RadioTracer::new(&scene, &bvh, setup).unwrap();
    let rx = DVec3::new(5.3, 3.1, 1.6);
    let powers = |resolution_deg: f64, directions: usize, samplings: u64| -> Vec<f64> {
        let sampling = |phase| DiffuseSettings { photons: 0, resolution_deg, directions, phase, ..DiffuseSettings::default() };
        let field = |phase| DiffuseField::new(&tracer, DVec3::new(1.0, 1.5, 2.0), &sampling(phase)).unwrap();
        let gather = |field: DiffuseField<'_, '_>| field.gather(rx, field.antenna(), &WorldExtent::Sphere).unwrap();
        (1..=samplings).map(|phase| gather(field(phase)).iter().map(|a| a.power).sum()).collect()
    };
    let mean = |powers: &[f64]| powers.iter().sum::<f64>() / powers.len() as f64;
    let error = |powers: &[f64]| {
        let squares: f64 = powers.iter().map(|p| (p - mean(powers)).powi(2)).sum();
        (squares / (powers.len() * (powers.len() - 1)) as f64).sqrt()
    };
    let truth = powers(0.0, 400_000, 4);
    let refined = powers(4.0, 3000, 200);
    let error = error(&truth).hypot(error(&refined)) / mean(&truth);
    let bias = mean(&refined) / mean(&truth) - 1.0;
    // Corrected by all they see, the cells that met a cube would bring −1.1 %.
    assert!(bias.abs() < 0.008 && error < 0.002, "{bias} ± {error}");
}

#[test]
fn a_view_keeps_the_power_of_the_whole_sphere() {
    let scene = room();
    let bvh = Bvh::build(&scene);
    let tracer = RadioTracer::new(&scene, &bvh, RadioSettings::default()).unwrap();
    let camera = Pinhole::from_horizontal_fov(96, 64, 90.0);
    let pose = Rigid3::looking_at(DVec3::new(5.3, 3.1, 1.6), DVec3::new(2.0, 2.0, 1.2), DVec3::Z);
    let sampling = DiffuseSettings { directions: 60_000, ..DiffuseSettings::default() };
    let field = DiffuseField::new(&tracer, DVec3::new(1.0, 1.5, 2.0), &sampling).unwrap();
    let power = |arrivals: &[Arrival]| -> f64 { arrivals.iter().map(|a| a.power).sum() };
    let (all, view) = (
        field.gather(pose.translation, field.antenna(), &WorldExtent::Sphere).unwrap(),
        field.gather(pose.translation, field.antenna(), &WorldExtent::View { camera, world_from_camera: pose }).unwrap(),
    );
    assert!(view.len() < all.len() / 2);
    // The outside is sampled 16 times sparser: some per cent.
    assert!((power(&view) / power(&all) - 1.0).abs() < 0.03, "{} {}", power(&view), power(&all));
    // Inside the frame nothing changed.
    let (a, b) = (mpc(&all, &camera, &pose, 1.0), mpc(&view, &camera, &pose, 1.0));
    assert!(a.pixels().iter().zip(b.pixels()).all(|(a, b)| (a - b).abs() <= 1e-3 * a.max(*b)));
    assert!(share_in_frame(&all, &camera, &pose) > 0.0);
}

#[test]
fn what_lies_behind_a_gated_array_changes_nothing_but_the_power() {
    let scene = room();
    let bvh = Bvh::build(&scene);
    let tracer = RadioTracer::new(&scene, &bvh, RadioSettings::default()).unwrap();
    let sampling = DiffuseSettings { directions: 60_000, resolution_deg: 4.0, even_arrivals: true, ..DiffuseSettings::default() };
    let field = DiffuseField::new(&tracer, DVec3::new(1.0, 1.5, 2.0), &sampling).unwrap();
    let (rx, antenna) = (DVec3::new(5.3, 3.1, 1.6), tracer.settings().rx_antenna);
    let array = PlanarArray { rows: 8, columns: 8, spacing_wavelengths: [0.5; 2] };
    let world_from_array = DMat3::from_rotation_z(2.6) * DMat3::from_rotation_y(0.2);
    let boresight = world_from_array * DVec3::X;
    let (all, front) = (
        field.gather(rx, &antenna, &WorldExtent::Sphere).unwrap(),
        field.gather(rx, &antenna, &WorldExtent::Front { boresight }).unwrap(),
    );
    assert!(front.len() < all.len() * 2 / 3, "{} {}", front.len(), all.len());
    let power = |arrivals: &[Arrival]| -> f64 { arrivals.iter().map(|a| a.power).sum() };
    assert!((power(&front) / power(&all) - 1.0).abs() < 0.03, "{} {}", power(&front), power(&all));
    let beams = [all, front].map(|arrivals| Bartlett::new(&arrivals, array, world_from_array, RearHalfSpace::Gated));
    let directions = (0..900).map(|i| {
        let (across, up) = (0.1 * f64::from(i % 30) - 1.45, 0.1 * f64::from(i / 30) - 1.45);
        DVec3::new(across.cos() * up.cos(), across.sin() * up.cos(), up.sin())
    });
    let values: Vec<[f64; 2]> = directions.map(|u| beams.each_ref().map(|beam| beam.power(u))).collect();
    let peak = values.iter().fold(0.0f64, |peak, [all, _]| peak.max(*all));
    for [all, front] in values.into_iter().filter(|[all, _]| *all > 1e-3 * peak) {
        // What is faint beside all else is left to chance, and outliers' power goes to all: both know what was gathered alone.
        assert!((front / all - 1.0).abs() < 5e-3, "{front:e} {all:e}");
    }
}
