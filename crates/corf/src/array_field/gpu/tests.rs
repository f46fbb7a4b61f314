//! Observations on a GPU against the same in double precision on the processor, and training steps against the processor's.

#![allow(clippy::unwrap_used)]

use super::shape::Shape;
use super::stepper::GpuStepper;
use super::{GpuObserver, forms};
use crate::array_field::anchors::Anchors;
use crate::array_field::cloud::Cloud;
use crate::array_field::stepper::{CpuStepper, Rule, Stepper, View};
use crate::array_field::tests as online;
use crate::array_field::{ArrayConfig, ArrayField, ArrayTrainer, CpuObserver, Observer, SensorSettings};
use corf_gpu::testing::{OPTIONS, context};
use corf_scene::keyframe::DbRange;
use corf_scene::{Pinhole, Rigid3, Rng};
use glam::DVec3;
use std::sync::Arc;

/// Largest error of a pixel of beams, relative: the exponent of a power, some 20 nepers, is rounded; and as a share of the power of all waves: sums
/// of harmonics whose roundings (6e-8) mostly cancel.
const OF_BEAMS: [f64; 2] = [5e-6, 1e-6];
/// Largest error of a pixel of lobes, relative; and as a share of the strongest lobe's peak, where one ends a hair's breadth from a pixel.
const OF_LOBES: [f64; 2] = [2e-4, 1.2e-4];

/// Largest error of a pixel of Capon's, relative: so much for each element over the loading, to which forms cancel; nothing of other sensors.
fn of_capon(sensor: &SensorSettings) -> f64 {
    match *sensor {
        SensorSettings::Capon { elements, loading, .. } => 2e-7 * elements.iter().product::<usize>() as f64 / loading,
        _ => 0.0,
    }
}

fn beam(elements: [usize; 2], gated: bool) -> SensorSettings {
    SensorSettings::Beam { elements, spacing_wavelengths: [0.5, 0.6], gated }
}

fn capon(elements: [usize; 2], loading: f64) -> SensorSettings {
    SensorSettings::Capon { elements, spacing_wavelengths: [0.5, 0.6], gated: true, loading }
}

fn cloud(count: usize, anchors: usize, seed: u64) -> Cloud<f32> {
    let mut rng = Rng::keyed(seed, 0, 0);
    Cloud {
        position: (0..count).map(|_| [20.0, 16.0, 4.0].map(|side| side * rng.uniform())).collect(),
        gain: (0..count).map(|_| -20.0 + 4.0 * rng.uniform()).collect(),
        seen_from: (0..anchors).map(|_| (0..count).map(|_| rng.uniform() - 0.5).collect()).collect(),
    }
}

/// Emitters around receivers, one where a receiver stands; sizes are no multiples of anything.
fn field(sensor: SensorSettings, sources: usize, points: usize, camera: Pinhole) -> ArrayField {
    let anchors = 5;
    let mut sources = cloud(sources, anchors, 1);
    if let Some(first) = sources.position.first_mut() {
        *first = poses(1)[0].translation.as_vec3().to_array();
    }
    ArrayField {
        sensor,
        pattern: corf_scene::config::AntennaPattern::Iso,
        camera,
        half_space: true,
        over_splats: false,
        // Some waves reach it.
        most_power: Some(2e-9),
        extent_m: 0.06,
        anchors: Anchors {
            positions_m: (0..anchors).map(|i| DVec3::new(6.0 + 0.5 * i as f64, 8.0, 1.5)).collect(),
            width_m: 0.5,
        },
        sources,
        points: cloud(points, anchors, 2),
    }
}

fn poses(count: usize) -> Vec<Rigid3> {
    let pose = |i: usize| {
        let place = DVec3::new(6.0 + 0.4 * i as f64, 8.0, 1.5);
        Rigid3::looking_at(place, place + DVec3::new(1.0, 0.3 * i as f64 - 0.6, 0.1), DVec3::Z)
    };
    (0..count).map(pose).collect()
}

fn camera() -> Pinhole {
    Pinhole::from_horizontal_fov(45, 29, 90.0)
}

/// Power of all waves of a field at a pose.
fn all_power(field: &ArrayField, pose: &Rigid3) -> f64 {
    let receiver = field.receiver::<f64>(pose);
    let waves = [&field.sources, &field.points].map(|cloud| cloud.waves(&receiver, 0.0));
    waves.iter().flatten().map(|w| w.1.power).sum()
}

fn fields() -> Vec<ArrayField> {
    let plain = |sensor| field(sensor, 7, 700, camera());
    let framed = |sensor| ArrayField { half_space: false, ..plain(sensor) };
    vec![
        plain(beam([8, 6], true)),
        plain(beam([16, 16], false)),
        plain(beam([1, 3], true)),
        framed(beam([8, 8], true)),
        field(beam([8, 8], true), 3, 0, camera()),
        field(beam([8, 8], true), 0, 0, camera()),
        plain(capon([8, 8], 0.1)),
        framed(capon([7, 5], 1.0)),
        plain(capon([1, 3], 0.1)),
        plain(capon([16, 16], 0.1)),
        field(capon([8, 8], 0.1), 0, 0, camera()),
        // Lone waves, with the least loading that there are kernels for.
        field(capon([2, 1], 0.0002), 2, 0, camera()),
        field(capon([8, 8], 0.0064), 2, 0, camera()),
        field(capon([16, 16], 0.0256), 2, 0, camera()),
        plain(SensorSettings::Lobes { width_deg: 3.0 }),
        framed(SensorSettings::Lobes { width_deg: 2.0 }),
        field(SensorSettings::Lobes { width_deg: 2.0 }, 65, 0, Pinhole::from_horizontal_fov(60, 33, 140.0)),
    ]
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn observations_are_those_of_the_processor() {
    let poses = poses(5);
    for field in fields().into_iter().map(Arc::new) {
        // Batches of two, two and one.
        let Some(context) = context(&OPTIONS) else { return };
        let mut gpu = GpuObserver::in_batches(context, Arc::clone(&field), 2).unwrap();
        let found = gpu.observe(&poses).unwrap();
        let expected = CpuObserver::new(Arc::clone(&field)).observe(&poses).unwrap();
        assert_eq!(found.len(), expected.len());
        let (mut worst, mut seen) = (0.0_f64, 0.0_f64);
        for ((found, expected), pose) in found.iter().zip(&expected).zip(&poses) {
            let all = all_power(&field, pose);
            for (a, b) in found.pixels().iter().zip(expected.pixels()) {
                let (a, b) = (f64::from(*a), f64::from(*b));
                let tolerance = match field.sensor {
                    SensorSettings::Beam { .. } => OF_BEAMS[0] * b + OF_BEAMS[1] * all,
                    SensorSettings::Lobes { .. } => {
                        OF_LOBES[0] * b + OF_LOBES[1] * field.most_power.unwrap().min(all) * field.sensor.peak()
                    }
                    SensorSettings::Capon { .. } => of_capon(&field.sensor) * b,
                };
                assert!((a - b).abs() <= tolerance, "{:?}: {a:e} {b:e}, tolerance {tolerance:e}", field.sensor);
                worst = worst.max((a - b).abs() / tolerance.max(f64::MIN_POSITIVE));
                seen = seen.max(b);
            }
        }
        assert_eq!(seen > 0.0, !field.sources.is_empty(), "{:?}", field.sensor);
        println!("{:?}: {worst:.3} of the tolerance", field.sensor);
    }
}

#[test]
fn a_loading_that_needs_double_precision_is_refused() {
    for (elements, least) in [([8, 8], 0.0064), ([16, 16], 0.0256)] {
        let error = Shape::of(&capon(elements, 0.99 * least)).unwrap_err().to_string();
        assert!(error.contains("mvdr") && error.contains(&format!("{least} at least")), "{error}");
        assert!(!forms(&capon(elements, 0.99 * least)) && forms(&capon(elements, least)));
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn capon_sees_nothing_where_no_wave_arrives() {
    // The only source stands where the second receiver does, before the first.
    let mut field = field(capon([4, 3], 0.1), 1, 0, camera());
    field.sources.position[0] = poses(2)[1].translation.as_vec3().to_array();
    let Some(gpu) = context(&OPTIONS) else { return };
    let seen = GpuObserver::in_batches(gpu, Arc::new(field.clone()), 2).unwrap().observe(&poses(2)).unwrap();
    assert!(seen[0].pixels().iter().all(|p| *p > 0.0) && seen[1].pixels().iter().all(|p| *p == 0.0));
    let views = views(&field, 2, false);
    let before = field.clone();
    let Some(gpu) = context(&OPTIONS) else { return };
    let residual = GpuStepper::new(gpu, RULE, &field, 1).unwrap().take(&mut field, &[&views[1]]).unwrap();
    assert!(field == before && residual == 0.0, "nothing is learnt: {residual}");
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn bytes_do_not_depend_on_the_batch_or_on_the_run() {
    let poses = poses(5);
    for field in fields().into_iter().map(Arc::new) {
        let observe = |most: usize| {
            let context = context(&OPTIONS)?;
            Some(GpuObserver::in_batches(context, Arc::clone(&field), most).unwrap().observe(&poses).unwrap())
        };
        let Some(first) = observe(1) else { return };
        assert!(observe(4).unwrap() == first && observe(5).unwrap() == first, "{:?}", field.sensor);
    }
}

/// Difference of a step's correction of a log gain, as a share of the largest: sums as those of observations, taken twice.
const OF_A_STEP: f32 = 1e-4;
/// The same after some steps, nepers: what steps get wrong they take off again.
const OF_STEPS: f32 = 2e-3;

const RULE: Rule = Rule { rate: 0.5, damping: 0.3, clip: 3.0, visibility: 0.5, floor: 1e-13 };

/// Views of a field whose emitters are stronger or weaker than those of `field`, the second half of their power being background if there is one.
fn views(field: &ArrayField, count: usize, has_background: bool) -> Vec<View> {
    let mut truth = field.clone();
    let mut rng = Rng::keyed(9, 0, 0);
    truth.sources.gain.iter_mut().chain(&mut truth.points.gain).for_each(|g| *g += rng.normal() as f32);
    let sensor = field.sensor.build(&field.camera);
    let view = |pose: Rigid3| {
        let seen = truth.observe(&sensor, &pose);
        let log = seen.pixels().iter().map(|s| (s + RULE.floor).ln()).collect();
        let background = has_background.then(|| seen.pixels().iter().map(|s| 0.5 * s).collect());
        View { receiver: field.receiver(&pose), pose, background, log }
    };
    poses(count).into_iter().map(view).collect()
}

/// Log gains and corrections.
fn learnt(field: &ArrayField) -> Vec<f32> {
    let of = |c: &Cloud<f32>| [&c.gain[..], &c.seen_from.concat()].concat();
    [&field.sources, &field.points].into_iter().flat_map(of).collect()
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn steps_are_those_of_the_processor() {
    for (i, field) in fields().into_iter().enumerate() {
        let views = views(&field, 12, i % 2 == 1);
        let all: Vec<&View> = views.iter().collect();
        let mut cpu = CpuStepper { rule: RULE, sensor: field.sensor.build(&field.camera) };
        let Some(context) = context(&OPTIONS) else { return };
        // Twelve steps are three submissions.
        let mut gpu = GpuStepper::new(context, RULE, &field, 5).unwrap();
        let of_capon = of_capon(&field.sensor) as f32;
        for (steps, tolerance) in [(1, OF_A_STEP + of_capon), (12, OF_STEPS)] {
            let (mut on_cpu, mut on_gpu) = (field.clone(), field.clone());
            let expected = cpu.take(&mut on_cpu, &all[..steps]).unwrap();
            let found = gpu.take(&mut on_gpu, &all[..steps]).unwrap();
            let error = (found.sqrt() - expected.sqrt()).abs();
            let allowed = 5e-4 * expected.sqrt() + of_capon;
            assert!(error <= allowed, "{:?}: residual {found} {expected}", field.sensor);
            let [before, on_cpu, other] = [&field, &on_cpu, &on_gpu].map(learnt);
            let largest = on_cpu.iter().zip(&before).fold(0.0_f32, |m, (a, b)| m.max((a - b).abs()));
            assert_eq!(largest > 0.01, !before.is_empty(), "{:?}: a step does something", field.sensor);
            let scale = if steps == 1 { largest } else { 1.0 };
            let worst = on_cpu.iter().zip(&other).fold(0.0_f32, |m, (a, b)| {
                assert!(b.is_finite());
                m.max((a - b).abs())
            });
            println!("{:?}, {steps} steps: {worst:e} nepers of {largest:e}", field.sensor);
            assert!(worst <= tolerance * scale, "{:?}, {steps} steps: {worst:e} of {largest:e}", field.sensor);
            let mut again = field.clone();
            gpu.take(&mut again, &all[..steps]).unwrap();
            assert!(again == on_gpu, "the same bytes each time");
        }
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_field_that_is_learnt_online_is_the_processors() {
    let poses = online::poses(12);
    let range = DbRange { min_db: -60.0, max_db: 10.0 };
    for settings in [online::BEAM, online::CAPON, online::LOBES] {
        let spectra = online::observed(settings, &poses);
        let learn = |on_gpu: bool| {
            let config = ArrayConfig { point_spacing_m: 1.0, ..ArrayConfig::default() };
            let mut trainer = ArrayTrainer::new(config, settings, online::camera(), range, 3);
            if on_gpu {
                trainer.stepper = Box::new(GpuStepper::new(context(&OPTIONS)?, trainer.rule(), &trainer.field, 8).unwrap());
            }
            for (pose, spectrum) in poses.iter().zip(&spectra) {
                let surface: Vec<[f32; 3]> = (0..20).map(|i| [10.0, 0.8 * i as f32 - 8.0, 0.3 * i as f32 - 3.0]).collect();
                trainer.receive(&trainer.observe(pose, spectrum), &surface).unwrap();
                trainer.train().unwrap();
            }
            Some(trainer.into_field())
        };
        let Some(on_gpu) = learn(true) else { return };
        let on_cpu = learn(false).unwrap();
        assert!(!on_cpu.sources.is_empty() && on_gpu.sources.len() == on_cpu.sources.len());
        let [ours, theirs] = [on_gpu, on_cpu].map(|field| CpuObserver::new(Arc::new(field)).observe(&poses).unwrap());
        for (ours, theirs) in ours.iter().zip(&theirs) {
            let squares = ours.pixels().iter().zip(theirs.pixels()).map(|(a, b)| (range.scalar(*a) - range.scalar(*b)).powi(2));
            let rms_db = (squares.sum::<f32>() / ours.pixels().len() as f32).sqrt() * 70.0;
            assert!(rms_db < 0.05, "{settings:?}: {rms_db} dB");
        }
    }
}
