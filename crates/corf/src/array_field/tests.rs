//! The sensors against their definitions, gradients against finite differences, and a field learnt from what planted sources send.

#![allow(clippy::unwrap_used)]

use super::births::{Sighting, meeting};
use super::cloud::{Cloud, Receiver};
use super::peaks::rays;
use super::wave::Wave;
use super::{ArrayConfig, ArrayField, ArraySensor, ArrayTrainer, SensorSettings};
use corf_scene::config::AntennaPattern;
use corf_scene::keyframe::DbRange;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Pinhole, Raster, Rigid3, Rng};
use glam::DVec3;
use std::f64::consts::TAU;

pub(super) const BEAM: SensorSettings = SensorSettings::Beam { elements: [8, 6], spacing_wavelengths: [0.5, 0.6], gated: true };
pub(super) const CAPON: SensorSettings = capon([8, 6], 0.1);
pub(super) const LOBES: SensorSettings = SensorSettings::Lobes { width_deg: 3.0 };

const fn capon(elements: [usize; 2], loading: f64) -> SensorSettings {
    SensorSettings::Capon { elements, spacing_wavelengths: [0.5, 0.6], gated: true, loading }
}

pub(super) fn camera() -> Pinhole {
    Pinhole::from_horizontal_fov(48, 32, 90.0)
}

fn directions(count: u64) -> impl Iterator<Item = DVec3> {
    (0..count).map(|i| {
        let mut rng = Rng::keyed(1, 2, i);
        DVec3::new(1.0 + rng.uniform_f64(), rng.normal(), rng.normal()).normalize()
    })
}

fn waves(count: u64) -> Vec<Wave<f64>> {
    let wave = |(i, u): (usize, DVec3)| Wave { direction: u.to_array(), power: 0.5 + i as f64, spread2: 1e-4 * i as f64 };
    directions(count).enumerate().map(wave).collect()
}

#[test]
fn a_beams_power_is_that_of_its_steering_vectors() {
    let (camera, waves) = (camera(), waves(7));
    let power = BEAM.build::<f64>(&camera).observe(&waves);
    for pixel in [0, 77, 48 * 16 + 24, 48 * 32 - 1] {
        let u = ARRAY_FROM_CAMERA.rotation * camera.pixel_direction(pixel % 48, pixel / 48);
        let gain = |from: &[f64; 3]| {
            let (mut re, mut im) = (0.0, 0.0);
            for (column, row) in (0..8).flat_map(|c| (0..6).map(move |r| (c, r))) {
                let phase = TAU * (0.5 * f64::from(column) * (from[1] - u.y) + 0.6 * f64::from(row) * (from[2] - u.z));
                (re, im) = (re + phase.cos(), im + phase.sin());
            }
            (re * re + im * im) / (48.0 * 48.0)
        };
        let expected: f64 = waves.iter().map(|w| w.power * gain(&w.direction)).sum();
        assert!((power[pixel] / expected - 1.0).abs() < 1e-11, "{pixel}: {} {expected}", power[pixel]);
    }
}

#[test]
fn a_lobes_integral_is_its_power_wherever_it_stands_and_however_wide_it_is() {
    let camera = Pinhole::from_horizontal_fov(96, 64, 100.0);
    let sensor = LOBES.build::<f64>(&camera);
    for (direction, spread2) in [(DVec3::X, 0.0), (DVec3::new(1.0, 0.5, -0.3).normalize(), 2e-3)] {
        let image = sensor.observe(&[Wave { direction: direction.to_array(), power: 3.0, spread2 }]);
        let sum: f64 = image.iter().enumerate().map(|(i, v)| v * camera.pixel_solid_angle_sr(i % 96, i / 96)).sum();
        assert!((sum / 3.0 - 1.0).abs() < 2e-3, "{direction}: {sum}");
    }
}

/// Σ of the logarithms of an observation's pixels, some more than others, and its derivatives by pixel.
fn loss(power: &[f64]) -> (f64, Vec<f64>) {
    let weight = |i: usize| 1.0 + (i % 7) as f64;
    let sum = power.iter().enumerate().map(|(i, p)| weight(i) * (p + 0.1).ln()).sum();
    (sum, power.iter().enumerate().map(|(i, p)| weight(i) / (p + 0.1)).collect())
}

#[test]
fn gradients_by_powers_are_those_of_finite_differences() {
    const STEP: f64 = 1e-4;
    for settings in [BEAM, LOBES, CAPON, capon([8, 6], 1e-3), capon([5, 3], 1.0), capon([1, 7], 0.1)] {
        let (sensor, waves) = (settings.build::<f64>(&camera()), waves(5));
        let (_, by_pixel) = loss(&sensor.observe(&waves));
        let twice: Vec<f64> = by_pixel.iter().map(|d| 2.0 * d).collect();
        for (i, by_power) in sensor.pull_powers(&waves, [&by_pixel, &twice]).into_iter().enumerate() {
            let at = |h: f64| {
                let mut changed = waves.clone();
                changed[i].power += h;
                loss(&sensor.observe(&changed)).0
            };
            let expected = (at(STEP) - at(-STEP)) / (2.0 * STEP);
            assert!(
                (by_power[0] / expected - 1.0).abs() < 1e-6 && (by_power[1] / by_power[0] - 2.0).abs() < 1e-12,
                "{settings:?} {i}: {by_power:?} {expected}"
            );
        }
    }
}

pub(super) fn poses(count: u64) -> Vec<Rigid3> {
    (0..count)
        .map(|i| {
            let place = DVec3::new(0.3 * i as f64, 0.1 * (i as f64).sin(), 1.5);
            Rigid3::looking_at(place, place + DVec3::new(4.0, 1.0 + 0.3 * (i as f64).cos(), 0.1), DVec3::Z)
        })
        .collect()
}

#[test]
fn elements_with_a_pattern_receive_what_it_lets_them() {
    let cloud = Cloud {
        position: vec![[5.0, 1.0, 2.0], [7.0, -1.0, 1.0], [3.0, 2.0, 0.5]],
        gain: vec![1.0, 2.0, 0.5],
        seen_from: vec![],
    };
    let plain = Receiver::<f64>::new(&poses(1)[0], &[], false);
    let iso = cloud.waves(&plain, 0.0);
    let patterned = cloud.waves(&plain.clone().of_elements(AntennaPattern::Tr38901), 0.0);
    assert_eq!(iso.len(), 3);
    for ((_, a), (_, b)) in iso.iter().zip(&patterned) {
        let gain = AntennaPattern::Tr38901.amplitude(DVec3::from_array(a.direction)).powi(2);
        assert!((b.power / (a.power * gain) - 1.0).abs() < 1e-12 && (gain - 1.0).abs() > 1e-3, "{gain}");
    }
}

#[test]
fn gradients_by_emitters_are_those_of_finite_differences() {
    let sensor = BEAM.build::<f64>(&camera());
    let cloud = Cloud {
        position: vec![[5.0, 1.0, 2.0], [7.0, -1.0, 1.0], [3.0, 2.0, 0.5]],
        gain: vec![1.0, 2.0, 0.5],
        seen_from: vec![vec![0.2, -0.1, 0.3], vec![0.0, 0.5, -0.4]],
    };
    let receiver = Receiver::new(&poses(1)[0], &[(0, 0.75), (1, 0.25)], true);
    let value = |cloud: &Cloud<f64>| {
        let waves: Vec<_> = cloud.waves(&receiver, 0.0).into_iter().map(|w| w.1).collect();
        loss(&sensor.observe(&waves)).0
    };
    let seen = cloud.waves(&receiver, 0.0);
    assert_eq!(seen.iter().map(|w| w.0).collect::<Vec<_>>(), [0, 1, 2]);
    let waves: Vec<_> = seen.iter().map(|w| w.1).collect();
    let by_pixel = loss(&sensor.observe(&waves)).1;
    let by_power = sensor.pull_powers(&waves, [&by_pixel, &by_pixel]);
    let difference = |change: &dyn Fn(&mut Cloud<f64>, f64)| {
        const STEP: f64 = 1e-6;
        let at = |h: f64| {
            let mut moved = cloud.clone();
            change(&mut moved, h);
            value(&moved)
        };
        (at(STEP) - at(-STEP)) / (2.0 * STEP)
    };
    for i in 0..3 {
        let by_gain = by_power[i][0] * waves[i].power;
        let expected = difference(&|c, h| c.gain[i] += h);
        assert!((by_gain - expected).abs() < 1e-5 * expected.abs().max(1.0), "{i}: {by_gain} {expected}");
        let from = difference(&|c, h| c.seen_from[0][i] += h);
        assert!((0.75 * by_gain - from).abs() < 1e-5 * expected.abs().max(1.0), "{i}: {by_gain} {from}");
    }
}

/// Spectra of three sources, one of them far behind the others, at these poses.
pub(super) fn observed(settings: SensorSettings, poses: &[Rigid3]) -> Vec<Raster<f32>> {
    let cloud = Cloud {
        position: vec![[9.0, 1.0, 2.0], [6.0, 4.0, 1.0], [30.0, 9.0, -2.0]],
        gain: vec![2.0, 1.0, 4.0],
        seen_from: vec![],
    };
    let sensor = settings.build::<f64>(&camera());
    let observe = |pose: &Rigid3| {
        let waves: Vec<_> = cloud.waves(&Receiver::new(pose, &[], true), 0.0).into_iter().map(|w| w.1).collect();
        Raster::from_vec(48, 32, sensor.observe(&waves).iter().map(|p| *p as f32).collect())
    };
    poses.iter().map(observe).collect()
}

#[test]
fn rays_of_planted_sources_meet_where_they_are() {
    let poses = poses(8);
    for settings in [BEAM, CAPON] {
        let sensor = settings.build::<f32>(&camera());
        let sightings: Vec<Sighting> = poses
            .iter()
            .zip(observed(settings, &poses))
            .map(|(pose, spectrum)| Sighting::new(pose, &rays(&sensor, &camera(), spectrum.pixels(), 20.0), AntennaPattern::Iso))
            .collect();
        let (latest, others) = sightings.split_last().unwrap();
        let found: Vec<_> = (0..latest.rays.len()).map(|ray| meeting(latest, ray, others, 0.02)).collect();
        for place in [DVec3::new(9.0, 1.0, 2.0), DVec3::new(6.0, 4.0, 1.0)] {
            let near = found.iter().find(|m| m.place_m.distance(place) < 0.25 * place.distance(latest.place_m));
            assert!(near.is_some_and(|m| m.votes > 4.0), "{settings:?} {place}: {found:?}");
        }
    }
}

#[test]
fn a_field_is_learnt_online_and_its_bytes_do_not_depend_on_threads() {
    let all = poses(12);
    let folder = tempfile::tempdir().unwrap();
    let range = DbRange { min_db: -60.0, max_db: 10.0 };
    // Peaks narrower than a pixel are harder to meet.
    for (settings, share) in [(BEAM, 0.6), (LOBES, 0.6), (CAPON, 0.8)] {
        let spectra = observed(settings, &all);
        let held = 7;
        let learn = || {
            let config = ArrayConfig { point_spacing_m: 1.0, ..ArrayConfig::default() };
            let mut trainer = ArrayTrainer::new(config, settings, camera(), range, 3);
            for k in (0..all.len()).filter(|k| *k != held) {
                let surface: Vec<[f32; 3]> = (0..200)
                    .map(|i| {
                        let mut rng = Rng::keyed(4, k as u64, i);
                        [10.0, 16.0 * rng.uniform() - 8.0, 8.0 * rng.uniform() - 3.0]
                    })
                    .collect();
                let observed = trainer.observe(&all[k], &spectra[k]);
                trainer.receive(&observed, &surface).unwrap();
                trainer.train().unwrap();
            }
            trainer.into_field()
        };
        let field = learn();
        let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(learn);
        assert_eq!(field, single);
        assert!(!field.sources.is_empty(), "{settings:?}");
        let path = folder.path().join("field");
        field.write(&path).unwrap();
        assert_eq!(ArrayField::read(&path).unwrap(), field);
        let predicted = field.observe(&settings.build(&camera()), &all[held]);
        let error = |other: &Raster<f32>| {
            let squares =
                other.pixels().iter().zip(spectra[held].pixels()).map(|(a, b)| (range.scalar(*a) - range.scalar(*b)).powi(2));
            (squares.sum::<f32>() / (48.0 * 32.0)).sqrt()
        };
        let (ours, nearest) = (error(&predicted), error(&spectra[held - 1]));
        assert!(ours < share * nearest, "{settings:?}: {ours} against {nearest} of the nearest");
    }
}

#[test]
fn a_sensor_is_built_as_it_is_called() {
    assert!(matches!(BEAM.build::<f32>(&camera()), ArraySensor::Beam(_)) && BEAM.is_gated());
    assert!(matches!(LOBES.build::<f32>(&camera()), ArraySensor::Lobes(_)) && !LOBES.is_gated());
    assert!(matches!(CAPON.build::<f32>(&camera()), ArraySensor::Capon(_)) && CAPON.is_gated());
    assert!(CAPON.check(&camera()).is_ok() && capon([8, 8], 1e-10).check(&camera()).is_err());
    assert!(capon([8, 8], f64::NAN).check(&camera()).is_err() && capon([17, 8], 0.1).check(&camera()).is_err());
}

#[test]
fn a_field_that_is_gone_on_with_is_the_one_that_was_not_interrupted() {
    let all = poses(8);
    let range = DbRange { min_db: -60.0, max_db: 10.0 };
    for settings in [BEAM, LOBES, CAPON] {
        let spectra = observed(settings, &all);
        let surface: Vec<[f32; 3]> = directions(80).map(|u| (8.0 * u).as_vec3().to_array()).collect();
        let fresh = || ArrayTrainer::new(ArrayConfig::default(), settings, camera(), range, 3);
        let take = |trainer: &mut ArrayTrainer, k: usize| {
            trainer.receive(&trainer.observe(&all[k], &spectra[k]), &surface[..10 * k]).unwrap();
            trainer.train().unwrap();
        };
        let (mut whole, mut second) = (fresh(), fresh());
        (0..5).for_each(|k| take(&mut whole, k));
        second.restore(whole.field.clone(), 5).unwrap();
        (0..5).for_each(|k| second.replay(&second.observe(&all[k], &spectra[k])));
        for k in 5..8 {
            take(&mut whole, k);
            take(&mut second, k);
        }
        assert_eq!(whole.field, second.field, "{settings:?}");
        let other = ArrayConfig { half_space: false, ..ArrayConfig::default() };
        let mut other = ArrayTrainer::new(other, settings, camera(), range, 3);
        assert!(other.restore(whole.into_field(), 8).is_err());
    }
}

/// A smooth picture of surfaces, from 1e-6 to 1e-5.
fn surfaces() -> Vec<f32> {
    (0..48 * 32).map(|i| 1e-6 * (1.0 + 9.0 * (i % 48) as f32 / 47.0)).collect()
}

#[test]
fn lobes_are_peeled_off_and_what_they_hide_is_filled_in() {
    let sensor = LOBES.build::<f32>(&camera());
    let planted: Vec<Wave<f32>> = [(0.0, 0.1, 1e-4), (0.4, -0.2, 1e-5), (-0.5, 0.3, 3e-6)]
        .map(|(left, up, power)| Wave {
            direction: DVec3::new(1.0, left, up).normalize().as_vec3().to_array(),
            power,
            spread2: 0.0,
        })
        .to_vec();
    let below = surfaces();
    let pixels = sensor.observe(&planted).iter().zip(&below).map(|(lobes, below)| lobes + below).collect();
    let spectrum = Raster::from_vec(48, 32, pixels);
    let peeled = super::peel::peel(&sensor, &camera(), &spectrum, 3.0, 1e-9);
    assert_eq!(peeled.rays.len(), planted.len(), "{:?}", peeled.rays);
    for (ray, wave) in peeled.rays.iter().zip(&planted) {
        let off = super::wave::dot(ray.direction, wave.direction).min(1.0).acos().to_degrees();
        assert!(off < 0.4 && (ray.power / wave.power - 1.0).abs() < 0.1, "{ray:?} {wave:?}: {off} degrees");
    }
    for (i, (left, below)) in peeled.remainder.pixels().iter().zip(&below).enumerate() {
        assert!((left / below).log10().abs() < 0.2, "pixel {i}: {left} {below}");
    }
    // Nothing stands out of a smooth picture.
    let smooth = Raster::from_vec(48, 32, below);
    let peeled = super::peel::peel(&sensor, &camera(), &smooth, 3.0, 1e-9);
    assert!(peeled.rays.is_empty() && peeled.remainder == smooth);
}
