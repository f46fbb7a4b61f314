//! Tests of the whole chain: encoding, networks, the sum along a ray, the error and its gradient, training, files.

#![allow(clippy::unwrap_used)]

use super::*;
use crate::mlp::Trained;
use corf_scene::{Pinhole, Raster, Rigid3};

/// A network that trains in moments.
pub(super) fn tiny() -> Nerf2Config {
    Nerf2Config {
        iterations: 10,
        rays: 40,
        samples: 8,
        layers: 4,
        width: 16,
        skip: 1,
        frequencies: 3,
        far_m: 4.0,
        cosine_steps: 0,
        rate: 5e-3,
        ..Nerf2Config::default()
    }
}

pub(super) const TRANSMITTER_M: [f32; 3] = [1.0, -0.5, 2.0];

/// Two views of a bright spot.
pub(super) fn rays(seed: u64) -> TrainingRays {
    let camera = Pinhole::from_horizontal_fov(8, 6, 90.0);
    let mut rays = TrainingRays::new(camera, seed);
    for x in [0.0, 0.5] {
        let pose = Rigid3 { translation: [x, 0.2, 1.0].into(), ..Rigid3::IDENTITY };
        let spot = |u: usize, v: usize| 0.1 + 0.8 * (-0.3 * ((u as f32 - 3.0).powi(2) + (v as f32 - 2.0).powi(2))).exp();
        rays.push(pose, &Raster::from_fn(8, 6, spot)).unwrap();
    }
    rays
}

#[test]
fn the_gradient_of_the_whole_chain_is_that_of_finite_differences() {
    for config in [tiny(), Nerf2Config { skip: 3, ..tiny() }.corrected()] {
        let batch = rays(1).batch(&config, 0);
        let network = Nerf2Model::new(&config).network;
        // Amplitudes are of the size of the targets, so that errors have both signs and their gradients are felt.
        let parameters: Vec<f64> = network.initial(4).iter().map(|v: &f64| 2.0 * v).collect();
        let trainer = |p: &[f64]| Nerf2CpuTrainer::new(&config, TRANSMITTER_M, p.to_vec()).unwrap();
        let (loss, gradient) = trainer(&parameters).gradient(&batch).unwrap();
        assert!(loss > 0.0 && gradient.iter().filter(|g| **g != 0.0).count() > gradient.len() / 2);
        let largest = gradient.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
        // Central differences; a tenth of the parameters, of every layer.
        const H: f64 = 1e-6;
        for i in (0..parameters.len()).step_by(11) {
            let at = |shift: f64| {
                let mut moved = parameters.clone();
                moved[i] += shift;
                trainer(&moved).gradient(&batch).unwrap().0
            };
            let expected = (at(H) - at(-H)) / (2.0 * H);
            assert!((gradient[i] - expected).abs() < 1e-6 * largest, "{i}: {} {expected}", gradient[i]);
        }
    }
}

/// A trainer after some steps.
fn trained(config: &Nerf2Config, steps: u64) -> Nerf2CpuTrainer {
    let parameters = Nerf2Model::new(config).network.initial(2);
    let mut trainer = Nerf2CpuTrainer::new(config, TRANSMITTER_M, parameters).unwrap();
    go_on(&mut trainer, config, 0..steps);
    trainer
}

fn go_on(trainer: &mut dyn Nerf2Trainer, config: &Nerf2Config, steps: std::ops::Range<u64>) {
    let rays = rays(3);
    for step in steps {
        trainer.step(&rays.batch(config, step), config.schedule().at(step)).unwrap();
    }
}

#[test]
fn training_learns_what_it_is_shown() {
    let config = Nerf2Config { iterations: 300, ..tiny() }.corrected();
    let before = trained(&config, 1).loss().unwrap();
    let after = trained(&config, 300).loss().unwrap();
    // The spot's variance is about 0.05: less than a tenth of it says that the spot was found, not only its mean.
    assert!(before > 0.05 && after < 0.005, "{before} {after}");
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    // Several blocks a step.
    let config = Nerf2Config { rays: 400, ..tiny() };
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| trained(&config, 5).state().unwrap())
    };
    assert!(with(1) == with(3));
}

#[test]
fn a_state_on_disk_goes_on_to_the_same_bytes() {
    let config = tiny();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("state");
    let mut whole = trained(&config, 6);
    let mut half = trained(&config, 3);
    let field = TrainedNerf2 { config, transmitter_m: TRANSMITTER_M, parameters: vec![] };
    field.write_state(&path, "tag", &half.state().unwrap()).unwrap();
    let mut resumed = trained(&config, 0);
    let (tag, state) = TrainedNerf2::read_state(&path).unwrap();
    assert_eq!(tag, "tag");
    resumed.restore(&state).unwrap();
    go_on(&mut resumed, &config, 3..6);
    assert!(resumed.state().unwrap() == whole.state().unwrap());
    assert!(resumed.restore(&Trained::new(vec![0.0; 3])).is_err(), "another network");
}

#[test]
fn a_field_on_disk_predicts_the_same() {
    let config = tiny();
    let mut trainer = trained(&config, 3);
    let field = TrainedNerf2 { config, transmitter_m: TRANSMITTER_M, parameters: trainer.state().unwrap().parameters };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field");
    field.write(&path).unwrap();
    let read = TrainedNerf2::read(&path).unwrap();
    assert_eq!(read, field);
    let mut again = Nerf2CpuTrainer::new(&read.config, read.transmitter_m, read.parameters.clone()).unwrap();
    let camera = Pinhole::from_horizontal_fov(50, 20, 90.0);
    let pose = Rigid3 { translation: [0.3, 0.0, 1.0].into(), ..Rigid3::IDENTITY };
    let image = field.render(&mut trainer, &camera.into(), &pose).unwrap();
    assert_eq!((image.width(), image.height()), (50, 20));
    assert!(image.pixels().iter().all(|v| v.is_finite() && *v >= 0.0));
    assert_eq!(read.render(&mut again, &camera.into(), &pose).unwrap(), image);
}
