//! Truths about beams: plane waves, two paths by hand, orthogonality, ties.

use super::*;
use corf_raytrace::radio::{Complex, PlanarArray};
use corf_scene::keyframe::DbRange;

const LIMIT_DB: f64 = 70.0;

fn camera() -> Pinhole {
    Pinhole::from_horizontal_fov(300, 200, 90.0)
}

/// Direction of beam (p, q) in the array's frame.
fn direction(p: usize, q: usize) -> DVec3 {
    let (y, z) = (sine(p), sine(q));
    DVec3::new((1.0 - y * y - z * z).sqrt(), y, z)
}

/// A spectrum (1/sr) of plane waves of the given powers, each in the pixel that holds its direction (array frame).
fn waves(camera: &Pinhole, waves: &[(DVec3, f64)]) -> Raster<f64> {
    let mut spectrum = Raster::filled(camera.width, camera.height, 0.0);
    for &(u, power) in waves {
        let at = camera.project(ARRAY_FROM_CAMERA.inverse().transform_vector(u)).unwrap();
        let (x, y) = (at.x as usize, at.y as usize);
        spectrum[(x, y)] += power / camera.pixel_solid_angle_sr(x, y);
    }
    spectrum
}

fn strongest(powers: &[f64]) -> usize {
    (0..powers.len()).max_by(|a, b| powers[*a].total_cmp(&powers[*b])).unwrap()
}

#[test]
fn the_gain_is_that_of_the_arrays_steering_vectors() {
    let array = PlanarArray::default();
    for (p, q) in [(0, 0), (3, 4), (7, 2)] {
        for u in [DVec3::X, DVec3::new(0.8, -0.36, 0.48), DVec3::new(0.6, 0.0, -0.8)] {
            // w_pq is the steering vector of the beam's sines, real direction or not: only y and z matter to a planar array.
            let w = array.steering(DVec3::new(0.0, sine(p), sine(q)));
            let sum = w.iter().zip(array.steering(u)).fold(Complex::new(0.0, 0.0), |s, (w, v)| s + Complex::new(w.re, -w.im) * v);
            let expected = sum.norm_squared() / (ELEMENTS * ELEMENTS) as f64;
            let gain = axis_gain(u.y - sine(p)) * axis_gain(u.z - sine(q));
            assert!((gain - expected).abs() < 1e-12, "beam {p}, {q} towards {u}: {gain}, {expected}");
        }
    }
}

#[test]
fn beams_are_orthogonal_and_together_hold_a_waves_power() {
    for d in 0..SIDE {
        assert!((axis_gain(sine(d) - sine(0)) - f64::from(u8::from(d == 0))).abs() < 1e-12);
    }
    // Parseval: the outputs of a whole orthonormal set of beams add up to the input, whatever the direction.
    let camera = camera();
    let powers = integrated(&camera, &waves(&camera, &[(DVec3::new(0.9, 0.21, -0.1).normalize(), 3e-7)]));
    assert!((powers.iter().sum::<f64>() / 3e-7 - 1.0).abs() < 1e-9);
}

#[test]
fn a_plane_wave_from_a_beams_direction_picks_that_beam() {
    let camera = camera();
    let codebook = Codebook::of(camera, Quantity::PowerPerSteradian).unwrap();
    for (p, q) in [(3, 3), (1, 4), (5, 2), (6, 5)] {
        let powers = codebook.powers(&waves(&camera, &[(direction(p, q), 1e-7)]));
        assert_eq!(strongest(&powers), p * SIDE + q);
        // The pixel's centre is off the direction by up to a quarter of a degree: 0.01 dB of an eight-element beam.
        assert!((powers[p * SIDE + q] / 1e-7 - 1.0).abs() < 5e-3, "{}", powers[p * SIDE + q]);
    }
}

#[test]
fn beam_power_is_sampled_where_a_beam_points_into_the_image() {
    let camera = camera();
    let codebook = Codebook::of(camera, Quantity::BeamPower).unwrap();
    let Codebook::Sampled(places) = &codebook else { panic!("beams are sampled") };
    // 90° by 67°: |u_y| up to 5/8 and |u_z| up to 3/8 lie within, as the doc page counts.
    assert_eq!(places.len(), 24);
    // A Bartlett spectrum of one wave reads, at every beam, the beam's gain towards the wave.
    let from = direction(5, 3);
    let spectrum = Raster::from_fn(camera.width, camera.height, |x, y| {
        let u = ARRAY_FROM_CAMERA.transform_vector(camera.pixel_direction(x, y));
        2e-8 * axis_gain(u.y - from.y) * axis_gain(u.z - from.z)
    });
    let powers = codebook.powers(&spectrum);
    let best = strongest(&powers);
    let at = camera.project(ARRAY_FROM_CAMERA.inverse().transform_vector(from)).unwrap();
    assert_eq!(places[best], SampledBeam { number: 5 * SIDE + 3, at: [at.x, at.y] });
    assert_eq!(codebook.number(best), 5 * SIDE + 3);
    for (i, power) in powers.iter().enumerate() {
        assert!((power / 2e-8 - f64::from(u8::from(i == best))).abs() < 2e-3, "beam {i}: {power}");
    }
    assert!(Codebook::of(camera, Quantity::CaponPower).is_none());
    assert!(Codebook::of(Pinhole::from_horizontal_fov(8, 8, 5.0), Quantity::BeamPower).is_none(), "no beam points there");
}

#[test]
fn two_paths_lose_by_hand() {
    // The stronger path in beam a, one 6 dB weaker in beam b: a prediction that knows the weaker alone loses 6 dB.
    let camera = camera();
    let codebook = Codebook::of(camera, Quantity::PowerPerSteradian).unwrap();
    let (a, b) = (direction(2, 3), direction(5, 4));
    let observed = codebook.powers(&waves(&camera, &[(a, 4e-8), (b, 1e-8)]));
    let predicted = codebook.powers(&waves(&camera, &[(b, 9e-6)]));
    let m = compare(&predicted, &observed, LIMIT_DB);
    assert!((m.codebook_loss_db - 10.0 * 4f64.log10()).abs() < 0.03, "{m:?}");
    assert_eq!((m.beam_top1, m.beam_top3), (0.0, 0.0));
    // SNR = 64 · 0.1 W · G / noise, of both.
    let snr = |gain: f64| 64.0 * 0.1 * gain / super::super::rate::noise_w();
    let rate = |gain: f64| (1.0 + snr(gain)).log2();
    assert!((m.rate_loss_bps_hz - (rate(4e-8) - rate(1e-8))).abs() < 0.01, "{m:?}");
    assert!((m.rate_loss_percent - 100.0 * (1.0 - rate(1e-8) / rate(4e-8))).abs() < 0.1, "{m:?}");
    // Both paths, in the wrong order: the best beam is the second of three.
    let m = compare(&codebook.powers(&waves(&camera, &[(a, 1e-8), (b, 2e-8)])), &observed, LIMIT_DB);
    assert_eq!((m.beam_top1, m.beam_top3), (0.0, 1.0));
    // The observation itself loses nothing.
    let m = compare(&observed, &observed, LIMIT_DB);
    assert_eq!(
        m,
        BeamMetrics { codebook_loss_db: 0.0, beam_top1: 1.0, beam_top3: 1.0, rate_loss_bps_hz: 0.0, rate_loss_percent: 0.0 }
    );
}

#[test]
fn scale_does_not_matter_to_the_choice_and_order_does() {
    let observed = [1.0, 5.0, 2.0, 4.0];
    assert_eq!(compare(&[0.1, 0.5, 0.2, 0.4], &observed, LIMIT_DB).codebook_loss_db, 0.0);
    let m = compare(&[9.0, 1.0, 3.0, 2.0], &observed, LIMIT_DB);
    assert!((m.codebook_loss_db - 10.0 * 5f64.log10()).abs() < 1e-12 && m.beam_top3 == 0.0);
}

#[test]
fn the_best_beam_and_the_chosen_one_are_named() {
    let observed = [1.0, 5.0, 2.0, 5.0];
    assert_eq!(
        best_and_chosen(&observed, &observed)[0],
        best_and_chosen(&observed, &observed)[1],
        "of two best ones the chosen one"
    );
    assert_eq!(best_and_chosen(&[0.0, 1.0, 2.0, 9.0], &observed), [3, 3]);
    assert_eq!(best_and_chosen(&[9.0, 1.0, 2.0, 3.0], &observed), [1, 0], "of two best ones the first");
    assert_eq!(best_and_chosen(&[0.0; 4], &[3.0, 1.0, 2.0, 0.5]), [0, 3], "a prediction that knows nothing has the worst");
    let camera = camera();
    assert_eq!(Codebook::of(camera, Quantity::PowerPerSteradian).unwrap().number(41), 41);
}

#[test]
fn ties_are_settled_against_the_prediction_and_losses_are_bounded() {
    let observed = [3.0, 1.0, 2.0, 0.0];
    let nothing = compare(&[0.0; 4], &observed, LIMIT_DB);
    assert_eq!((nothing.codebook_loss_db, nothing.beam_top1, nothing.beam_top3), (LIMIT_DB, 0.0, 0.0));
    assert_eq!(nothing.rate_loss_percent, 100.0);
    let tied = compare(&[7.0, 7.0, 0.0, 0.0], &observed, LIMIT_DB);
    assert!((tied.codebook_loss_db - 10.0 * 3f64.log10()).abs() < 1e-12 && tied.beam_top1 == 0.0 && tied.beam_top3 == 1.0);
    let silent = compare(&[1.0, 2.0, 0.0, 0.0], &[0.0; 4], LIMIT_DB);
    assert_eq!((silent.codebook_loss_db, silent.beam_top1, silent.rate_loss_percent), (0.0, 1.0, 0.0));
}

#[test]
fn interpolation_is_exact_on_planes_and_constant_beyond_the_edge() {
    let plane = Raster::from_fn(5, 4, |x, y| 2.0 * (x as f64 + 0.5) - 3.0 * (y as f64 + 0.5));
    assert!((interpolated(&plane, [2.3, 1.9]) - (4.6 - 5.7)).abs() < 1e-12);
    assert_eq!(interpolated(&plane, [0.0, 0.0]), plane[(0, 0)]);
    assert_eq!(interpolated(&plane, [5.0, 4.0]), plane[(4, 3)]);
    // What a scalar image on a range keeps of a power is a power again.
    let range = DbRange { min_db: -100.0, max_db: -30.0 };
    assert!((super::super::radio::linear(range.scalar(1e-6), &range) / 1e-6 - 1.0).abs() < 1e-5);
    assert_eq!(super::super::radio::linear(0.0, &range), 0.0);
}
