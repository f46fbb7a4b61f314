#![allow(clippy::unwrap_used)]

use super::*;
use crate::synthetic;
use corf::{loss::psnr_8bit, target::RadioTarget};
use corf_scene::{Keyframe, Pinhole, Raster, Rng};

/// A network and budget that train in a second or two.
pub(super) fn small() -> WrfGsPlusConfig {
    WrfGsPlusConfig {
        iterations: 120,
        random_points: 1500,
        random_extent: 4.0,
        layers: 3,
        width: 24,
        skip: 1,
        position_frequencies: 4,
        receiver_frequencies: 3,
        receiver_width: 12,
        receiver_features: 10,
        density: crate::rf_3dgs::DensityConfig {
            from: 20,
            until: 110,
            every: 30,
            reset_every: 45,
            reset_opacity: 0.05,
            clone_fraction: 0.2,
            prune_fraction: 2.0,
            ..Default::default()
        },
        rates: WrfGsPlusRates { position_steps: 120, ..WrfGsPlusRates::default() },
        ..WrfGsPlusConfig::default()
    }
}

pub(super) fn keyframe(i: usize) -> Keyframe {
    let camera = |w, h| Pinhole::from_horizontal_fov(w, h, 80.0);
    synthetic::keyframe(i, synthetic::pose(1.5 * i as f64), &camera(4, 3), &camera(48, 36), false)
}

pub(super) fn received(trainer: Box<dyn WrfGsPlusTrainer>, config: &WrfGsPlusConfig, seed: u64) -> WrfGsPlusReconstructor {
    let first = keyframe(0);
    let camera = |w, h| Pinhole::from_horizontal_fov(w, h, 80.0);
    let image = &synthetic::light(&first).image;
    let (light, radio) = (camera(image.width(), image.height()), camera(48, 36));
    let mut r = WrfGsPlusReconstructor::new(trainer, config.clone(), light, radio, synthetic::DB_RANGE, seed).unwrap();
    (0..8).filter(|i| *i != 4).for_each(|i| r.receive(&keyframe(i)).unwrap());
    r
}

pub(super) fn on_cpu(config: &WrfGsPlusConfig, seed: u64) -> WrfGsPlusReconstructor {
    let parameters = WrfGsPlusModel::new(config).network.initial(seed);
    received(Box::new(WrfGsPlusCpuTrainer::new(config, parameters).unwrap()), config, seed)
}

fn run(config: &WrfGsPlusConfig, seed: u64, portion: usize) -> WrfGsPlusReconstructor {
    let mut r = on_cpu(config, seed);
    r.begin().unwrap();
    while r.train(portion).unwrap().is_some() {}
    assert!(r.is_done());
    r
}

/// PSNR of the RF image at the pose that was held out.
fn quality(r: &mut WrfGsPlusReconstructor) -> f64 {
    let truth = keyframe(4);
    let seen = r.render(&truth.world_from_camera).unwrap();
    psnr_8bit(&seen, &r.meta.radio_target.encode(synthetic::spectrum(&truth), &r.meta.db_range))
}

/// PSNR of the mean of the training images at that pose.
fn quality_of_mean(r: &WrfGsPlusReconstructor) -> f64 {
    let image = |i| r.meta.radio_target.encode(synthetic::spectrum(&keyframe(i)), &r.meta.db_range);
    let mut mean = image(0);
    mean.pixels.fill(0.0);
    for i in (0..8).filter(|i| *i != 4) {
        mean.pixels.iter_mut().zip(image(i).pixels).for_each(|(m, v)| *m += v / 7.0);
    }
    psnr_8bit(&mean, &image(4))
}

fn random_shapes(n: usize, channels: usize) -> Vec<Shape<f64>> {
    let mut rng = Rng::keyed(8, 0, 0);
    let mut some = |size: f64| std::array::from_fn(|_| size * rng.normal());
    let one = |_| {
        let mut shape = Shape { position: some(1.0), rotation: [0.0; 4], log_scale: some(0.3), dc: some(0.3) };
        shape.rotation[..3].copy_from_slice(&some(1.0));
        shape.rotation[3] = some(1.0)[0];
        shape.dc[channels..].fill(0.0);
        shape
    };
    (0..n).map(one).collect()
}

fn flat(s: &Shape<f64>) -> [f64; 13] {
    let mut out = [0.0; 13];
    out[..3].copy_from_slice(&s.position);
    out[3..7].copy_from_slice(&s.rotation);
    out[7..10].copy_from_slice(&s.log_scale);
    out[10..].copy_from_slice(&s.dc);
    out
}

fn shape(v: &[f64; 13]) -> Shape<f64> {
    let at = |k: usize| [v[k], v[k + 1], v[k + 2]];
    Shape { position: at(0), rotation: [v[3], v[4], v[5], v[6]], log_scale: at(7), dc: at(10) }
}

#[test]
fn gradients_in_gaussians_and_network_are_those_of_finite_differences() {
    // Central differences: their error is O(h²) plus rounding over h.
    const H: f64 = 1e-6;
    let close = |found: f64, expected: f64| (found - expected).abs() < 1e-6 * (1.0 + expected.abs());
    for (move_positions, radio_target) in [(false, RadioTarget::Jet), (true, RadioTarget::Db)] {
        let config = WrfGsPlusConfig { move_positions, radio_target, ..small() };
        let parameters = WrfGsPlusModel::new(&config).network.initial(3);
        let mut deformation = Deformation::<f64>::new(&config, parameters);
        let (base, receiver) = (random_shapes(7, radio_target.channels()), [0.4, -1.2, 1.5]);
        // Σ weight · (value − 0.2)² over all numbers of the deformed Gaussians, so that the gradient is nowhere constant.
        let weight = |k: usize| 0.3 + (k % 5) as f64;
        let loss = |shapes: &[Shape<f64>]| -> f64 {
            shapes.iter().flat_map(flat).enumerate().map(|(k, v)| weight(k) * (v - 0.2) * (v - 0.2)).sum()
        };
        let deformed = deformation.apply(&base, receiver);
        let shapes: Vec<Shape<f64>> = deformed.iter().map(|d| d.0).collect();
        let rule = deformation.rule;
        let pairs: Vec<_> = (0..base.len())
            .map(|i| {
                let values = flat(&shapes[i]);
                let gradient = std::array::from_fn(|k| 2.0 * weight(13 * i + k) * (values[k] - 0.2));
                rule.backward(&base[i], &deformed[i].1, &shape(&gradient))
            })
            .collect();
        // What the network reads is detached: offsets stay while a Gaussian is moved.
        for i in 0..base.len() {
            for k in 0..10 + radio_target.channels() {
                let mut moved = shapes.clone();
                let mut at = |step: f64| {
                    let mut values = flat(&base[i]);
                    values[k] += step;
                    moved[i] = rule.apply(&shape(&values), &deformed[i].1);
                    loss(&moved)
                };
                let expected = (at(H) - at(-H)) / (2.0 * H);
                let found = flat(&pairs[i].0)[k];
                assert!(close(found, expected), "Gaussian {i}, number {k}: {found} {expected}");
            }
        }
        let offsets: Vec<_> = pairs.iter().map(|p| p.1).collect();
        let gradient = deformation.gradient(&base, receiver, &offsets);
        let mut largest: f64 = 0.0;
        for p in 0..gradient.len() {
            let kept = deformation.trained.parameters[p];
            let mut at = |step: f64| {
                deformation.trained.parameters[p] = kept + step;
                loss(&deformation.apply(&base, receiver).iter().map(|d| d.0).collect::<Vec<_>>())
            };
            let expected = (at(H) - at(-H)) / (2.0 * H);
            deformation.trained.parameters[p] = kept;
            assert!(close(gradient[p], expected), "parameter {p}: {} {expected}", gradient[p]);
            largest = largest.max(expected.abs());
        }
        assert!(largest > 0.1);
        // As published, the displacement is predicted and nothing learns it.
        let WrfGsPlusModel { network, position: crate::mlp::LayerInput::Layer(head), .. } = &deformation.model else {
            unreachable!()
        };
        let of_head = &gradient[network.layers()[*head].weights()];
        assert_eq!(of_head.iter().any(|g| *g != 0.0), move_positions);
    }
}

#[test]
fn a_field_beats_the_mean_spectrum_and_looks_different_to_other_receivers() {
    for (radio_target, iterations) in [(RadioTarget::Jet, 400), (RadioTarget::Db, 200)] {
        let mut config = WrfGsPlusConfig { radio_target, iterations, random_points: 3000, random_extent: 3.0, ..small() };
        (config.density.reset_every, config.density.until) = (10_000, iterations / 2);
        (config.rates.sh_dc, config.rates.opacity) = (0.02, 0.05);
        let mut r = on_cpu(&config, 1);
        r.begin().unwrap();
        while r.train(50).unwrap().is_some() {}
        // Two decibels more than what any field without a place would say; 3.4 and 3.8 are what is seen.
        let (at_last, mean) = (quality(&mut r), quality_of_mean(&r));
        assert!(at_last > mean + 2.0, "{at_last}, mean {mean}");
        let counts = r.density_counts();
        assert!(counts.cloned > 100 && counts.split > 100, "{counts:?}");
        // What two receivers see of one Gaussian: only the network knows the difference.
        let field = r.field().unwrap();
        let deformation = Deformation::new(&config, field.parameters);
        let base = [Shape { rotation: [1.0, 0.0, 0.0, 0.0], ..Shape::default() }];
        let [a, b] = [0, 7].map(|i| {
            let receiver = keyframe(i).world_from_camera.translation.as_vec3().to_array();
            deformation.apply(&base, receiver)[0].1
        });
        let largest = (0..radio_target.channels()).map(|c| (a.signal[c] - b.signal[c]).abs()).fold(0.0, f32::max);
        assert!(largest > 1e-3, "{a:?} {b:?}");
    }
}

#[test]
fn portions_and_threads_change_nothing_and_the_seed_and_the_correction_do() {
    let config = WrfGsPlusConfig { iterations: 70, ..small() };
    let field = run(&config, 1, 1000).field().unwrap();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(one.install(|| run(&config, 1, 7).field().unwrap()) == field);
    assert!(run(&config, 2, 1000).field().unwrap() != field);
    let corrected = WrfGsPlusConfig { move_positions: true, ..config };
    assert!(run(&corrected, 1, 1000).field().unwrap().gaussians != field.gaussians);
}

#[test]
fn a_restored_reconstruction_goes_on_to_the_same_bytes_from_anywhere() {
    let config = WrfGsPlusConfig { iterations: 100, ..small() };
    let truth = run(&config, 3, 1000).field().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    // Before any step, between two changes (with gradients summed so far), and behind a reset.
    for steps in [0, 37, 92] {
        let mut first = on_cpu(&config, 3);
        first.begin().unwrap();
        while first.steps_done() < steps {
            first.train((steps - first.steps_done()).min(20)).unwrap();
        }
        first.checkpoint("tag").unwrap().write(&path).unwrap();
        let checkpoint = WrfGsPlusCheckpoint::read(&path).unwrap();
        assert_eq!((checkpoint.tag(), checkpoint.steps()), ("tag", steps));
        let mut second = on_cpu(&config, 3);
        second.restore(&checkpoint).unwrap();
        while second.train(50).unwrap().is_some() {}
        let field = second.field().unwrap();
        assert!(field.parameters == truth.parameters && field.gaussians.radio == truth.gaussians.radio, "from step {steps}");
        assert!(field.gaussians.position == truth.gaussians.position && second.density_counts() != Default::default());
        assert!(on_cpu(&config, 4).restore(&checkpoint).is_err(), "another seed");
        assert!(second.restore(&checkpoint).is_err(), "it has begun");
    }
    let mut damaged = std::fs::read(&path).unwrap();
    damaged[300] ^= 1;
    std::fs::write(&path, damaged).unwrap();
    assert!(WrfGsPlusCheckpoint::read(&path).is_err());
}

#[test]
fn a_field_on_disk_renders_what_it_rendered() {
    let config = WrfGsPlusConfig { iterations: 20, ..small() };
    let mut r = run(&config, 1, 1000);
    let pose = keyframe(4).world_from_camera;
    let (field, seen) = (r.field().unwrap(), r.render(&pose).unwrap());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field");
    field.write(&path).unwrap();
    let read = WrfGsPlusField::read(&path).unwrap();
    assert!(read.parameters == field.parameters && read.gaussians.radio == field.gaussians.radio && read.meta == field.meta);
    let mut trainer = WrfGsPlusCpuTrainer::new(&config, read.parameters.clone()).unwrap();
    read.load(&mut trainer).unwrap();
    assert!(read.render(&mut trainer, &pose).unwrap() == seen);
}

#[test]
fn what_cannot_be_a_beginning_is_refused() {
    let config = small();
    let mut r = on_cpu(&config, 1);
    assert!(r.train(1).unwrap_err().to_string().contains("has not begun"));
    assert!(r.checkpoint("").is_err());
    let broken = synthetic::with_spectrum(&keyframe(4), Raster::filled(48, 36, f32::NAN));
    assert!(r.receive(&broken).unwrap_err().to_string().contains("spectrum is NaN"));
    let deaf = Keyframe { radio: None, ..keyframe(4) };
    assert!(r.receive(&deaf).unwrap_err().to_string().contains("no spectrum"));
    r.begin().unwrap();
    assert!(r.begin().is_err() && r.receive(&keyframe(4)).is_err());
    assert!(WrfGsPlusCpuTrainer::new(&config, vec![0.0; 3]).is_err());
    let of_another = WrfGsPlusConfig { radio_target: RadioTarget::Db, ..config };
    let trainer = WrfGsPlusCpuTrainer::new(&of_another, WrfGsPlusModel::new(&of_another).network.initial(1)).unwrap();
    let camera = Pinhole::from_horizontal_fov(4, 3, 80.0);
    let made = WrfGsPlusReconstructor::new(Box::new(trainer), small(), camera, camera, synthetic::DB_RANGE, 1);
    assert!(made.is_err_and(|e| e.to_string().contains("channels")));
}
