//! Tests of the kinds of spectra: the properties they must share, and those in which they must differ.

use super::*;
use crate::radio::{Antenna, Complex, Path, PlanarArray, Polarization};
use corf_scene::config::{ElementGrid, Elements, SpectrumKind};
use corf_scene::{Equirectangular, Rng};
use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

const FREQUENCY_HZ: f64 = 60e9;
const C: f64 = crate::radio::SPEED_OF_LIGHT;
/// Pixels of 1°.
const SPHERE: Equirectangular = Equirectangular { width: 360, height: 180 };
/// Pixels are float32.
const F32: f64 = 1e-6;

fn settings(kind: SpectrumKind) -> SpectrumSettings {
    SpectrumSettings {
        kind,
        array: PlanarArray::default(),
        elements: None,
        rear: RearHalfSpace::Gated,
        lobe_width_deg: 1.0,
        bandwidth_hz: 1e9,
        loading: 1e-3,
        seed: 1,
    }
}

/// A pose whose array frame is the world's.
fn ahead() -> Rigid3 {
    Rigid3::looking_at(DVec3::ZERO, DVec3::X, DVec3::Z)
}

fn at(azimuth_deg: f64, elevation_deg: f64) -> DVec3 {
    let (a, e) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    DVec3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin())
}

fn resolved(direction: DVec3, power: f64, delay_s: f64, phase_rad: f64) -> Arrival {
    Arrival { direction, power, delay_s, object: 0, phase_rad: Some(phase_rad) }
}

/// The spectrum that an array in the world's axes has towards one direction.
fn value(settings: &SpectrumSettings, port_pairs: &[Vec<Arrival>], direction: DVec3) -> f64 {
    let image = settings.form(port_pairs, &SPHERE, &ahead());
    let p = SPHERE.project(direction);
    f64::from(image[(p.x as usize, p.y as usize)])
}

/// The centre of the sphere's pixel that holds a direction.
fn centre(azimuth_deg: f64, elevation_deg: f64) -> DVec3 {
    let p = SPHERE.project(at(azimuth_deg, elevation_deg));
    SPHERE.pixel_direction(p.x as usize, p.y as usize)
}

#[test]
fn a_lone_path_reads_as_its_power_in_every_beam_kind() {
    let u = centre(20.0, -10.0);
    let port_pairs = [vec![resolved(u, 3e-9, 30e-9, 1.0)]];
    for (kind, expected) in [
        (SpectrumKind::Bartlett, 3e-9),
        (SpectrumKind::BartlettCoherent, 3e-9),
        // The loading adds its share of one element.
        (SpectrumKind::Mvdr, 3e-9 * (1.0 + 1e-3 / 64.0)),
    ] {
        let found = value(&settings(kind), &port_pairs, u);
        assert!((found / expected - 1.0).abs() < F32, "{kind:?}: {found}");
    }
}

#[test]
fn a_capon_beam_falls_off_as_the_loading_lets_it() {
    // R = p·v₀v₀ᴴ + δI, so vᴴR⁻¹v = (N − p|vᴴv₀|²/(δ + pN)) / δ (Sherman and Morrison).
    let (array, u0, p) = (PlanarArray::default(), centre(5.0, 5.0), 2e-8);
    let s = settings(SpectrumKind::Mvdr);
    let delta = s.loading * p;
    let port_pairs = [vec![resolved(u0, p, 10e-9, 0.0)]];
    for u in [centre(6.0, 5.0), centre(15.0, 0.0), centre(-40.0, 20.0)] {
        let product = array
            .steering(u)
            .iter()
            .zip(array.steering(u0))
            .fold(Complex::ZERO, |sum, (v, w)| sum + Complex::new(v.re, -v.im) * w);
        let expected = delta / (64.0 - p * product.norm_squared() / (delta + p * 64.0));
        let found = value(&s, &port_pairs, u);
        assert!((found / expected - 1.0).abs() < 1e-5, "{u}: {found} {expected}");
    }
}

#[test]
fn the_coherent_beam_is_the_sum_over_elements_of_true_path_lengths() {
    // Every element at its own place in the world, every path a plane wave of its own length to it; one tap.
    let array = PlanarArray { rows: 5, columns: 3, spacing_wavelengths: [0.5, 0.6] };
    let wavelength_m = C / FREQUENCY_HZ;
    let world_from_array = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_y(-0.2);
    let pose = Rigid3 { rotation: world_from_array * ahead().rotation, translation: DVec3::new(1.0, 2.0, 3.0) };
    let paths: Vec<(DVec3, f64, f64)> = (0..20)
        .map(|i| {
            let mut rng = Rng::keyed(21, 0, i);
            let u = world_from_array * DVec3::new(1.0, rng.normal(), 0.5 * rng.normal()).normalize();
            (u, 1e-4 * rng.uniform_f64(), 10.0 + 0.01 * rng.uniform_f64())
        })
        .collect();
    let arrivals: Vec<Arrival> =
        paths.iter().map(|&(u, a, l)| resolved(u, a * a, l / C, -TAU * (FREQUENCY_HZ * (l / C)).fract())).collect();
    let h: Vec<Complex> = array
        .positions()
        .iter()
        .map(|p| {
            let place = world_from_array * *p * wavelength_m;
            paths.iter().fold(Complex::ZERO, |sum, &(u, a, l)| {
                let metres = l - place.dot(u);
                sum + Complex::new(0.0, -TAU * (FREQUENCY_HZ * (metres / C)).fract()).exp() * a
            })
        })
        .collect();
    let s = SpectrumSettings { array, bandwidth_hz: 1e8, ..settings(SpectrumKind::BartlettCoherent) };
    let camera = Pinhole::from_horizontal_fov(9, 7, 90.0);
    let image = s.form(&[arrivals], &camera, &pose);
    let peak = image.pixels().iter().fold(0f32, |m, v| m.max(*v));
    for (i, d) in Grid::from(&camera).directions().into_iter().enumerate() {
        let w = array.steering(corf_scene::model::ARRAY_FROM_CAMERA.rotation * d);
        let sum = w.iter().zip(&h).fold(Complex::ZERO, |s, (w, h)| s + Complex::new(w.re, -w.im) * *h);
        let expected = sum.norm_squared() / 15f64.powi(2);
        assert!(
            (f64::from(image.pixels()[i]) - expected).abs() < 1e-5 * f64::from(peak),
            "{i}: {} {expected}",
            image.pixels()[i]
        );
    }
}

#[test]
fn paths_cancel_within_a_tap_and_only_there() {
    let u = centre(0.0, 0.0);
    let port_pairs = [vec![resolved(u, 1e-9, 20.0e-9, 0.0), resolved(u, 1e-9, 20.4e-9, PI)]];
    let coherent =
        |bandwidth_hz: f64| value(&SpectrumSettings { bandwidth_hz, ..settings(SpectrumKind::BartlettCoherent) }, &port_pairs, u);
    assert!(coherent(1e9) < 1e-20, "{}", coherent(1e9));
    assert!((coherent(10e9) / 2e-9 - 1.0).abs() < F32);
    // Looks are listened to apart: nothing cancels between them.
    let apart = [vec![port_pairs[0][0]], vec![port_pairs[0][1]]];
    assert!((value(&settings(SpectrumKind::BartlettCoherent), &apart, u) / 2e-9 - 1.0).abs() < F32);
}

#[test]
fn capon_resolves_two_paths_that_a_beam_merges() {
    // 8° apart under a beam of 12.8°, in different taps.
    let (a, b) = (centre(-4.0, 0.0), centre(4.0, 0.0));
    let port_pairs = [vec![resolved(a, 1e-9, 20e-9, 0.3), resolved(b, 1e-9, 23e-9, 2.0)]];
    let between = |kind| {
        let s = settings(kind);
        value(&s, &port_pairs, centre(0.0, 0.0)) / value(&s, &port_pairs, a).min(value(&s, &port_pairs, b))
    };
    // One hill for the beam, a valley of more than 10 dB for Capon's.
    assert!(between(SpectrumKind::Bartlett) > 1.0, "{}", between(SpectrumKind::Bartlett));
    assert!(between(SpectrumKind::BartlettCoherent) > 1.0);
    assert!(between(SpectrumKind::Mvdr) < 0.1, "{}", between(SpectrumKind::Mvdr));
    let peak = value(&settings(SpectrumKind::Mvdr), &port_pairs, a);
    assert!((10.0 * (peak / 1e-9).log10()).abs() < 0.1, "{peak}");
}

/// Standard errors that a mean over drawn phases may be away from its expectation; 12 comparisons: one in 10 000 runs, were it drawn anew.
const STANDARD_ERRORS: f64 = 4.5;

#[test]
fn drawn_phases_have_the_noncoherent_spectrum_as_their_mean() {
    let diffuse: Vec<Arrival> = (0..600)
        .map(|i| {
            let mut rng = Rng::keyed(31, 0, i);
            let direction = DVec3::new(1.5, rng.normal(), rng.normal()).normalize();
            Arrival {
                direction,
                power: 1e-12 * rng.uniform_f64(),
                delay_s: 60e-9 * rng.uniform_f64(),
                object: 0,
                phase_rad: None,
            }
        })
        .collect();
    let camera = Pinhole::from_horizontal_fov(4, 3, 80.0);
    let expected = settings(SpectrumKind::Bartlett).form(std::slice::from_ref(&diffuse), &camera, &ahead());
    const SEEDS: u64 = 300;
    let (mut sum, mut sum2) = ([0f64; 12], [0f64; 12]);
    for seed in 0..SEEDS {
        let image = SpectrumSettings { seed, ..settings(SpectrumKind::BartlettCoherent) }.form(
            std::slice::from_ref(&diffuse),
            &camera,
            &ahead(),
        );
        for (i, v) in image.pixels().iter().enumerate() {
            sum[i] += f64::from(*v);
            sum2[i] += f64::from(*v).powi(2);
        }
    }
    for i in 0..12 {
        let mean = sum[i] / SEEDS as f64;
        let standard_error = ((sum2[i] / SEEDS as f64 - mean * mean) / SEEDS as f64).sqrt();
        let away = (mean - f64::from(expected.pixels()[i])).abs() / standard_error;
        assert!(away < STANDARD_ERRORS, "pixel {i}: {mean} is {away:.1} standard errors from {}", expected.pixels()[i]);
        // Speckle: the spread of one draw is not small.
        assert!(standard_error * (SEEDS as f64).sqrt() > 0.05 * mean);
    }
}

#[test]
fn a_drawn_phase_belongs_to_the_arrival_and_not_to_its_place_in_the_list() {
    let mut diffuse: Vec<Arrival> = (0..3000)
        .map(|i| {
            let mut rng = Rng::keyed(32, 0, i);
            let direction = DVec3::new(1.5, rng.normal(), rng.normal()).normalize();
            Arrival { direction, power: 1e-12, delay_s: 5e-9, object: 0, phase_rad: None }
        })
        .collect();
    let camera = Pinhole::from_horizontal_fov(8, 6, 80.0);
    let s = settings(SpectrumKind::BartlettCoherent);
    let one = s.form(std::slice::from_ref(&diffuse), &camera, &ahead());
    diffuse.reverse();
    let other = s.form(std::slice::from_ref(&diffuse), &camera, &ahead());
    let peak = one.pixels().iter().fold(0f32, |m, v| m.max(*v));
    assert!(one.pixels().iter().zip(other.pixels()).all(|(a, b)| (a - b).abs() < 1e-5 * peak));
    let third = SpectrumSettings { seed: 2, ..s }.form(&[diffuse], &camera, &ahead());
    assert!(one.pixels().iter().zip(third.pixels()).any(|(a, b)| (a - b).abs() > 0.1 * peak));
}

#[test]
fn the_mean_over_the_sphere_is_that_of_the_elements_coupling() {
    // (1/4π)∫ v(u)ᴴRv(u) dΩ = Σ_ij R_ij sinc(2|p_i − p_j|): plane waves from everywhere are correlated between two elements as sin(kd)/(kd).
    let array = PlanarArray { rows: 4, columns: 3, spacing_wavelengths: [0.5, 0.4] };
    let arrivals: Vec<Arrival> = (0..40)
        .map(|i| {
            let mut rng = Rng::keyed(41, 0, i);
            let u = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
            resolved(u, rng.uniform_f64(), 10e-9 * rng.uniform_f64(), TAU * rng.uniform_f64())
        })
        .collect();
    let sphere = Equirectangular { width: 120, height: 60 };
    let s = SpectrumSettings { array, rear: RearHalfSpace::Aliased, ..settings(SpectrumKind::Bartlett) };
    let image = s.form(std::slice::from_ref(&arrivals), &sphere, &ahead());
    let mean: f64 =
        (0..120 * 60).map(|i| f64::from(image.pixels()[i]) * sphere.pixel_solid_angle_sr(i / 120)).sum::<f64>() / (4.0 * PI);
    let positions = array.positions();
    let mut expected = 0.0;
    for arrival in &arrivals {
        let v = array.steering(arrival.direction);
        for i in 0..12 {
            for j in 0..12 {
                let kd = TAU * positions[i].distance(positions[j]);
                let coupling = if kd > 0.0 { kd.sin() / kd } else { 1.0 };
                expected += arrival.power * coupling * (v[i] * Complex::new(v[j].re, -v[j].im)).re / 144.0;
            }
        }
    }
    // A midpoint rule of 3° on a pattern of 25° features.
    assert!((mean / expected - 1.0).abs() < 2e-3, "{mean} {expected}");
}

#[test]
fn the_sphere_and_a_camera_agree_where_they_look_the_same_way() {
    let arrivals: Vec<Arrival> = (0..60)
        .map(|i| {
            let mut rng = Rng::keyed(51, 0, i);
            let u = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
            resolved(u, rng.uniform_f64(), 30e-9 * rng.uniform_f64(), TAU * rng.uniform_f64())
        })
        .collect();
    let sphere = Equirectangular { width: 5, height: 3 };
    let pixel = Pinhole::from_horizontal_fov(1, 1, 1.0);
    for kind in [SpectrumKind::Mpc, SpectrumKind::Bartlett, SpectrumKind::BartlettCoherent, SpectrumKind::Mvdr] {
        // As wide as a pixel of the sphere, which shows values at centres then.
        let s = SpectrumSettings { lobe_width_deg: 62.0, ..settings(kind) };
        // Straight ahead both grids have a pixel.
        let (a, b) = (
            s.form(std::slice::from_ref(&arrivals), &sphere, &ahead())[(2, 1)],
            s.form(std::slice::from_ref(&arrivals), &pixel, &ahead())[(0, 0)],
        );
        assert!((a / b - 1.0).abs() < 1e-5, "{kind:?}: {a} {b}");
    }
    // Behind a gated array there is nothing; behind a bare one there is what lies before it.
    let beam = |rear| {
        SpectrumSettings { rear, ..settings(SpectrumKind::Bartlett) }.form(std::slice::from_ref(&arrivals), &sphere, &ahead())
    };
    assert_eq!(beam(RearHalfSpace::Gated)[(0, 1)], 0.0);
    assert!(beam(RearHalfSpace::Aliased)[(0, 1)] > 0.0);
}

#[test]
fn ports_share_the_field_and_the_power() {
    let path = Path {
        interactions: vec![],
        length_m: 3.0,
        delay_s: 3.0 / C,
        a: Complex::ZERO,
        transfer: [[Complex::new(1e-4, 2e-4), Complex::new(-3e-5, 0.0)], [Complex::new(0.0, 5e-5), Complex::new(2e-4, -1e-4)]],
        arrival: at(30.0, 10.0),
        departure: at(-140.0, -5.0),
    };
    let total = |tx: Polarization, rx: Polarization| -> f64 {
        let antenna = |polarization| Antenna { polarization, ..Antenna::default() };
        let all = port_pairs(std::slice::from_ref(&path), &antenna(tx), &antenna(rx), FREQUENCY_HZ);
        assert_eq!(all.len(), tx.slants_rad().len() * rx.slants_rad().len());
        all.concat().iter().map(|a| a.power).sum()
    };
    use Polarization::{Cross, H, V, VH};
    // Two orthogonal ports hear the whole field, however they are turned; two that send share the watt.
    let heard = total(V, V) + total(V, H);
    assert!((total(V, VH) / heard - 1.0).abs() < 1e-12 && (total(V, Cross) / heard - 1.0).abs() < 1e-12);
    let sent = 0.5 * (total(V, V) + total(H, V));
    assert!((total(VH, V) / sent - 1.0).abs() < 1e-12 && (total(Cross, V) / sent - 1.0).abs() < 1e-12);
    let mut one = path.clone();
    one.a = path.coefficient(&Antenna::default(), 0, &Antenna::default(), 0);
    let arrival = port_pairs(std::slice::from_ref(&one), &Antenna::default(), &Antenna::default(), FREQUENCY_HZ)[0][0];
    assert_eq!(arrival, Arrival::from_path(&one, FREQUENCY_HZ));
}

#[test]
fn the_share_in_frame_counts_power() {
    let camera = Pinhole::from_horizontal_fov(30, 20, 90.0);
    let arrivals = [
        resolved(at(10.0, 5.0), 3.0, 0.0, 0.0),
        resolved(at(50.0, 0.0), 1.0, 0.0, 0.0),
        resolved(at(180.0, 0.0), 1.0, 0.0, 0.0),
        resolved(at(0.0, 60.0), 1.0, 0.0, 0.0),
    ];
    assert_eq!(share_in_frame(&arrivals, &camera, &ahead()), 0.5);
    assert_eq!(share_in_frame(&[], &camera, &ahead()), 0.0);
}

/// Responses of elements by number and direction, as a file of five degrees has them, counted from each element's own place.
fn elements(array: PlanarArray, response: impl Fn(usize, DVec3) -> Complex) -> Elements {
    let mut text = "elevation_deg,azimuth_deg,element,re,im\n".to_owned();
    for (elevation, azimuth) in (-90..=90).step_by(5).flat_map(|e| (-180..180).step_by(5).map(move |a| (e, a))) {
        let u = at(f64::from(azimuth), f64::from(elevation));
        for m in 0..array.elements() {
            let Complex { re, im } = response(m, u);
            text += &format!("{elevation},{azimuth},{m},{re},{im}\n");
        }
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("e.csv"), text).unwrap();
    let config = "pattern = { file = \"e.csv\", phases = \"element\" }";
    let receiver: corf_scene::config::ReceiverConfig = corf_scene::config::from_toml(config, "t.toml").unwrap();
    let PlanarArray { rows, columns, spacing_wavelengths } = array;
    let grid = ElementGrid { rows, cols: columns, spacing_wavelengths };
    receiver.pattern.read(folder.path(), "receiver.pattern", Some(grid)).unwrap().elements().unwrap()
}

/// A 3×2 array whose elements differ in amplitude and phase, also by direction.
fn uneven() -> (PlanarArray, Elements) {
    let array = PlanarArray { rows: 3, columns: 2, spacing_wavelengths: [0.5, 0.6] };
    let response = |m: usize, u: DVec3| {
        let m = m as f64;
        Complex::new(0.0, 0.4 * m + 0.3 * m * u.y).exp() * (0.3 + 0.1 * m + 0.1 * u.z)
    };
    (array, elements(array, response))
}

#[test]
fn elements_that_are_alike_form_the_spectrum_of_such_elements() {
    let array = PlanarArray { rows: 3, columns: 2, spacing_wavelengths: [0.5, 0.6] };
    // A constant that all share is in the arrivals' powers, not in the beams.
    let alike = elements(array, |_, _| Complex::new(0.6, -0.5));
    let port_pairs = [vec![resolved(at(20.0, 5.0), 3e-9, 20e-9, 1.0), resolved(at(-40.0, 12.0), 1e-9, 33e-9, 0.3)]];
    for kind in [SpectrumKind::Mpc, SpectrumKind::Bartlett, SpectrumKind::BartlettCoherent, SpectrumKind::Mvdr] {
        let plain = SpectrumSettings { array, ..settings(kind) };
        let own = SpectrumSettings { elements: Some(alike), ..plain };
        for (azimuth, elevation) in [(20.0, 5.0), (0.0, 0.0), (-60.0, 30.0)] {
            let [a, b] = [plain, own].map(|s| value(&s, &port_pairs, centre(azimuth, elevation)));
            // Lobes are too narrow to be seen from everywhere.
            assert!((a - b).abs() <= 1e-5 * b && (b > 0.0 || azimuth != 20.0), "{kind:?}: {a:e} {b:e}");
        }
    }
}

#[test]
fn a_beam_of_elements_that_differ_is_the_sum_of_what_each_receives() {
    let (array, uneven) = uneven();
    // On the file's grid, where nothing is interpolated; the power that arrives has the mean gain.
    let (from, p) = (at(20.0, -10.0), 2e-9);
    let mut responses = vec![Complex::ZERO; 6];
    uneven.each(from, |m, [re, im]| responses[m] = Complex::new(re, im));
    let port_pairs = [vec![resolved(from, p * uneven.gain(from), 30e-9, 0.7)]];
    for kind in [SpectrumKind::Bartlett, SpectrumKind::BartlettCoherent] {
        let s = SpectrumSettings { array, elements: Some(uneven), ..settings(kind) };
        for u in [centre(20.0, -10.0), centre(0.0, 0.0), centre(-50.0, 25.0)] {
            let received = array.steering(from).into_iter().zip(&responses).map(|(v, f)| v * *f);
            let beam = array.steering(u).into_iter().zip(received);
            let sum = beam.fold(Complex::ZERO, |sum, (w, x)| sum + Complex::new(w.re, -w.im) * x);
            let (expected, found) = (p * sum.norm_squared() / 36.0, value(&s, &port_pairs, u));
            assert!((found / expected - 1.0).abs() < 1e-5, "{kind:?} {u}: {found:e} {expected:e}");
        }
    }
    // A dead element of six leaves (5/6)² of a beam that points at the wave.
    let dead = elements(array, |m, _| if m == 4 { Complex::ZERO } else { Complex::ONE });
    let at_beam = centre(10.0, 5.0);
    let s = SpectrumSettings { array, elements: Some(dead), ..settings(SpectrumKind::Bartlett) };
    let found = value(&s, &[vec![resolved(at_beam, p * dead.gain(at_beam), 30e-9, 0.0)]], at_beam);
    assert!((found / (p * 25.0 / 36.0) - 1.0).abs() < 1e-5, "{found:e}");
}

#[test]
fn a_channel_has_what_each_element_responds() {
    let (grid, uneven) = uneven();
    let element = Antenna { pattern: corf_scene::config::AntennaPattern::Elements(uneven), ..Antenna::default() };
    let array = crate::radio::AntennaArray { element, grid };
    let u = at(-15.0, 35.0);
    // Port field and steering vector together are the responses at the elements' places.
    let amplitude = element.port_field(0, u).length();
    let (steered, plain) = (array.steering(u), grid.steering(u));
    uneven.each(u, |m, [re, im]| {
        let expected = plain[m] * Complex::new(re, im);
        assert!((steered[m] * amplitude - expected).norm() < 1e-12, "{m}");
    });
    // One element of them has the mean gain and no phase.
    let single = crate::radio::AntennaArray::single(element);
    assert!((single.steering(u)[0] - Complex::ONE).norm() < 1e-15);
}
