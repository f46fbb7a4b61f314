//! Capon's spectra against their definition and what follows from it, at every loading that data sets may have.

#![allow(clippy::unwrap_used)]

use super::super::peaks::rays;
use super::super::tests::{CAPON, camera};
use super::super::wave::dot;
use super::super::{SensorSettings, Wave};
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Pinhole, Rng};
use glam::DVec3;

const LOADINGS: [f64; 5] = [1.0, 0.1, 1e-3, 1e-6, 1e-9];

fn capon(elements: [usize; 2], loading: f64) -> SensorSettings {
    SensorSettings::Capon { elements, spacing_wavelengths: [0.5, 0.6], gated: true, loading }
}

fn wave(direction: DVec3, power: f64) -> Wave<f64> {
    Wave { direction: direction.normalize().to_array(), power, spread2: 0.0 }
}

/// Waves of the powers that a room's have, from all over the half-space.
fn waves(count: u64) -> Vec<Wave<f64>> {
    (0..count)
        .map(|i| {
            let mut rng = Rng::keyed(5, 1, i);
            wave(DVec3::new(0.1 + rng.uniform_f64(), rng.normal(), rng.normal()), 1e-9 * 10f64.powf(-4.0 * rng.uniform_f64()))
        })
        .collect()
}

/// The direction of a pixel in the array's frame.
fn towards(camera: &Pinhole, x: usize, y: usize) -> DVec3 {
    ARRAY_FROM_CAMERA.rotation * camera.pixel_direction(x, y)
}

#[test]
fn a_lone_wave_is_seen_with_its_power_and_a_share_of_the_loading() {
    let camera = camera();
    for (elements, loading) in LOADINGS.iter().flat_map(|l| [([8, 6], *l), ([1, 1], *l), ([7, 16], *l)]) {
        let seen = capon(elements, loading).build::<f64>(&camera).observe(&[wave(towards(&camera, 30, 12), 3e-8)]);
        let settings = capon(elements, loading);
        let ratio = seen[12 * 48 + 30] / 3e-8;
        assert!((ratio / settings.peak() - 1.0).abs() < 1e-10 + 2e-13 / loading, "{settings:?}: {ratio}");
        let bound = 3e-8 * loading / (elements[0] * elements[1]) as f64;
        assert!(seen.iter().all(|p| *p > 0.99 * bound), "nothing is below the share of the loading: {settings:?}");
    }
}

#[test]
fn what_waves_account_for_adds_up_to_the_spectrum_at_every_loading() {
    let camera = Pinhole::from_horizontal_fov(24, 16, 90.0);
    let waves = waves(40);
    for loading in LOADINGS {
        let sensor = capon([8, 8], loading).build::<f64>(&camera);
        let seen = sensor.observe(&waves);
        for pixel in [0, 100, 200, 383] {
            let mut one = vec![0.0; seen.len()];
            one[pixel] = 1.0;
            let parts: Vec<f64> =
                sensor.pull_powers(&waves, [&one, &one]).iter().zip(&waves).map(|(pull, wave)| wave.power * pull[0]).collect();
            let sum: f64 = parts.iter().sum();
            assert!((sum / seen[pixel] - 1.0).abs() < 1e-12 / loading + 1e-10, "{loading}, pixel {pixel}: {sum} {}", seen[pixel]);
            assert!(parts.iter().all(|part| *part > -1e-3 * seen[pixel]), "{loading}, pixel {pixel}: {parts:?}");
        }
    }
}

#[test]
fn two_waves_nearer_than_the_beam_is_wide_are_told_apart() {
    let camera = Pinhole::from_horizontal_fov(96, 64, 90.0);
    // Six pixels of 1.2°; the beam is 13° wide.
    let sent = [(44, 30), (50, 30)].map(|(x, y)| wave(towards(&camera, x, y), 1e-8));
    let dip = |settings: SensorSettings| {
        let seen = settings.build::<f64>(&camera).observe(&sent);
        seen[30 * 96 + 47] / seen[30 * 96 + 44]
    };
    let beam = SensorSettings::Beam { elements: [8, 8], spacing_wavelengths: [0.5, 0.5], gated: true };
    let capon = SensorSettings::Capon { elements: [8, 8], spacing_wavelengths: [0.5, 0.5], gated: true, loading: 0.1 };
    assert!(dip(beam) > 1.0 && dip(capon) < 0.3, "{} {}", dip(beam), dip(capon));
}

#[test]
fn rays_are_found_between_pixels_with_their_powers() {
    let camera = Pinhole::from_horizontal_fov(96, 64, 90.0);
    let between = |x: f64, y: f64| ARRAY_FROM_CAMERA.rotation * camera.unproject(x, y).normalize();
    let sent = [(30.9, 20.4, 1e-8), (60.2, 45.8, 2e-9), (80.5, 10.1, 5e-10)].map(|(x, y, power)| (between(x, y), power));
    let settings = capon([8, 8], 0.1);
    let spectrum = settings.build::<f64>(&camera).observe(&sent.map(|(u, power)| wave(u, power)));
    let spectrum: Vec<f32> = spectrum.iter().map(|p| *p as f32).collect();
    let found = rays(&settings.build(&camera), &camera, &spectrum, 25.0);
    assert_eq!(found.len(), 3, "{found:?}");
    for (ray, (direction, power)) in found.iter().zip(&sent) {
        let off = dot(ray.direction.map(f64::from), direction.to_array()).min(1.0).acos().to_degrees();
        // A sixth of a pixel.
        assert!(off < 0.2 && (f64::from(ray.power) / power - 1.0).abs() < 0.2, "{ray:?} {power}: {off} degrees");
    }
    assert!(rays(&settings.build(&camera), &camera, &vec![0.0; 96 * 64], 25.0).is_empty());
    // A pixel alone among pixels of no power says what it says.
    let mut alone = vec![0.0; 96 * 64];
    alone[30 * 96 + 40] = 1e-8;
    let found = rays(&settings.build(&camera), &camera, &alone, 25.0);
    assert!(found.len() == 1 && (found[0].power / 1e-8 * settings.peak() as f32 - 1.0).abs() < 1e-5, "{found:?}");
}

#[test]
fn without_power_there_is_nothing_and_no_number_is_none() {
    let camera = camera();
    let sensor = CAPON.build::<f32>(&camera);
    let dark = Wave { direction: [1.0, 0.0, 0.0], power: 0.0, spread2: 0.0 };
    let ones = vec![1.0; 48 * 32];
    for waves in [vec![], vec![dark; 3]] {
        assert_eq!(sensor.observe(&waves), vec![0.0; 48 * 32]);
        assert_eq!(sensor.pull_powers(&waves, [&ones, &ones]), vec![[0.0; 2]; waves.len()]);
    }
    // The faintest power that single precision knows.
    let faint = Wave { power: f32::MIN_POSITIVE, ..dark };
    let pull = sensor.pull_powers(&[faint], [&ones, &ones]);
    assert!(pull[0][0].is_finite() && pull[0][0] > 0.0 && sensor.observe(&[faint, dark]).iter().all(|p| p.is_finite()));
}
