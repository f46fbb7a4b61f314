//! NeRF² on a GPU against the processor.

#![allow(clippy::unwrap_used)]

use super::tests::{TRANSMITTER_M, rays, tiny};
use super::*;
use corf_gpu::testing::{OPTIONS, context};
use corf_scene::{Pinhole, Rigid3};

/// Points of a chunk: six rays of eight samples, so that 40 rays make seven chunks, the last of four.
const POINTS: usize = 48;

fn on_gpu(config: &Nerf2Config, parameters: &[f32], points: usize) -> Option<Nerf2GpuTrainer> {
    Some(Nerf2GpuTrainer::in_chunks(context(&OPTIONS)?, config, TRANSMITTER_M, parameters, points).unwrap())
}

fn parameters(config: &Nerf2Config) -> Vec<f32> {
    Nerf2Model::new(config).network.initial::<f32>(4).iter().map(|v| 2.0 * v).collect()
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn loss_and_gradient_are_those_of_the_processor() {
    // The second has the published encoding and ray, whose sines have arguments of thousands.
    let far = Nerf2Config { frequencies: 10, far_m: 20.0, skip: 3, ..tiny() }.corrected();
    for (config, tolerance) in [(tiny(), 2e-5), (far, 2e-3)] {
        let parameters = parameters(&config);
        let Some(mut gpu) = on_gpu(&config, &parameters, POINTS) else { return };
        let batch = rays(1).batch(&config, 0);
        let wide: Vec<f64> = parameters.iter().map(|v| f64::from(*v)).collect();
        let (loss, gradient) = Nerf2CpuTrainer::new(&config, TRANSMITTER_M, wide).unwrap().gradient(&batch).unwrap();
        gpu.step(&batch, 1e-3).unwrap();
        let found = gpu.gradient().unwrap();
        let difference = (gpu.loss().unwrap() / loss - 1.0).abs();
        assert!(difference < tolerance, "loss {difference:e}");
        let largest = gradient.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
        let error = found.iter().zip(&gradient).fold(0.0, |m: f64, (a, b)| {
            assert!(a.is_finite());
            m.max((f64::from(*a) - b).abs())
        });
        assert!(error < tolerance * largest, "gradient {:e}", error / largest);
    }
}

fn train(trainer: &mut dyn Nerf2Trainer, config: &Nerf2Config, steps: std::ops::Range<u64>) {
    let rays = rays(3);
    for step in steps {
        trainer.step(&rays.batch(config, step), config.schedule().at(step)).unwrap();
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn training_ends_where_the_processors_does_and_goes_on_from_its_state() {
    let config = Nerf2Config { iterations: 30, ..tiny() }.corrected();
    let parameters = Nerf2Model::new(&config).network.initial(2);
    // All rays at once: an adapter in software takes its time over every dispatch.
    let points = config.rays * config.samples;
    let Some(mut gpu) = on_gpu(&config, &parameters, points) else { return };
    let mut cpu = Nerf2CpuTrainer::new(&config, TRANSMITTER_M, parameters.clone()).unwrap();
    train(&mut cpu, &config, 0..30);
    train(&mut gpu, &config, 0..15);
    let state = gpu.state().unwrap();
    train(&mut gpu, &config, 15..30);
    let (a, b) = (gpu.loss().unwrap(), cpu.loss().unwrap());
    // Steps amplify rounding; the error they end with is hardly changed by it.
    assert!((a / b - 1.0).abs() < 0.1, "{a} {b}");
    let mut resumed = on_gpu(&config, &parameters, points).unwrap();
    resumed.restore(&state).unwrap();
    train(&mut resumed, &config, 15..30);
    assert!(resumed.state().unwrap() == gpu.state().unwrap(), "the same bytes");
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn spectra_are_those_of_the_processor() {
    let config = tiny();
    let parameters = parameters(&config);
    let Some(mut gpu) = on_gpu(&config, &parameters, POINTS) else { return };
    let mut cpu = Nerf2CpuTrainer::new(&config, TRANSMITTER_M, parameters.clone()).unwrap();
    let field = TrainedNerf2 { config, transmitter_m: TRANSMITTER_M, parameters };
    // More rays than a step has, no multiple of a chunk's.
    let camera = super::Sight::from(Pinhole::from_horizontal_fov(13, 7, 90.0));
    let pose = Rigid3 { translation: [0.3, 0.0, 1.0].into(), ..Rigid3::IDENTITY };
    let [a, b] = [field.render(&mut gpu, &camera, &pose).unwrap(), field.render(&mut cpu, &camera, &pose).unwrap()];
    let largest = b.pixels().iter().fold(0.0f32, |m, v| m.max(*v));
    assert!(a.pixels().iter().zip(b.pixels()).all(|(a, b)| (a - b).abs() < 1e-4 * largest) && largest > 0.0);
}
