//! The GPU against the processor, in small.

#![allow(clippy::unwrap_used)]

use super::tests::{keyframe, on_cpu, received, small};
use super::*;
use corf::device::ScreenGradient;
use corf::device::gpu::GpuOptions;
use corf::target::RadioTarget;
use corf_gpu::testing;

/// One shape of tiles, hardly any memory at first.
const OPTIONS: GpuOptions = GpuOptions {
    adapter: testing::OPTIONS,
    tile: Some([8, 8]),
    batch: 16,
    segments: Some(1),
    fused: true,
    least_room: 16,
    keyframe_bytes: u64::MAX,
};

fn on_gpu(config: &WrfGsPlusConfig, options: &GpuOptions, most_rows: usize) -> WrfGsPlusReconstructor {
    let parameters: Vec<f32> = WrfGsPlusModel::new(config).network.initial(1);
    received(Box::new(WrfGsPlusGpuTrainer::in_chunks(options, config, &parameters, most_rows).unwrap()), config, 1)
}

fn largest(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_few_steps_on_both_devices_are_the_same_but_for_rounding() {
    if testing::context(&testing::OPTIONS).is_none() {
        return;
    }
    // Colours, displacements; all at once and in chunks with a short last one; room for all pairs, and too little at first.
    for (radio_target, move_positions, most_rows) in [(RadioTarget::Jet, true, 1 << 18), (RadioTarget::Db, false, 170)] {
        let config = WrfGsPlusConfig { radio_target, move_positions, random_points: 500, ..small() };
        let (mut cpu, mut gpu) = (on_cpu(&config, 1), on_gpu(&config, &OPTIONS, most_rows));
        let pose = keyframe(4).world_from_camera;
        for r in [&mut cpu, &mut gpu] {
            r.begin().unwrap();
        }
        // Rounding of the network's sums and of the blend.
        let [a, b] = [&mut cpu, &mut gpu].map(|r| r.render(&pose).unwrap());
        assert!(largest(&a.pixels, &b.pixels) < 2e-5, "{}", largest(&a.pixels, &b.pixels));
        let [first, second] = [&mut cpu, &mut gpu].map(|r| r.train(1).unwrap().unwrap());
        assert!((first.radio_loss - second.radio_loss).abs() < 1e-5, "{first:?} {second:?}");
        // A first step of Adam is as long as its rate, whatever the gradient's size: moments show the gradients themselves.
        let [a, b] = [&mut cpu, &mut gpu].map(|r| (r.trainer.device().state().unwrap(), r.trainer.network().unwrap()));
        let close = |a: &[f32], b: &[f32], what: &str| {
            let size = a.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
            assert!(size > 0.0 && largest(a, b) < 1e-3 * size, "{what}: {} of {size}", largest(a, b));
        };
        for k in 0..2 {
            let (m, n) = (&a.0.moments[k], &b.0.moments[k]);
            close(m.position.as_flattened(), n.position.as_flattened(), "position");
            close(m.rotation.as_flattened(), n.rotation.as_flattened(), "rotation");
            close(m.log_scale.as_flattened(), n.log_scale.as_flattened(), "scale");
            close(&m.radio.opacity_logit, &n.radio.opacity_logit, "opacity");
            close(&m.radio.sh, &n.radio.sh, "signal");
            close(&a.1.moments[k], &b.1.moments[k], "network");
        }
        let [first, second] = [&mut cpu, &mut gpu].map(|r| r.trainer.device().screen_gradients().unwrap());
        let norms = |g: &[ScreenGradient]| g.iter().map(|g| g.norm_sum).collect::<Vec<_>>();
        close(&norms(&first), &norms(&second), "gradients on the screen");
        // A device's tiles decide which Gaussians between two pixels count as visible; these are not drawn, and have no gradient.
        let undrawn = |(a, b): (&ScreenGradient, &ScreenGradient)| a.steps == b.steps || a.norm_sum.max(b.norm_sum) == 0.0;
        assert!(first.iter().zip(&second).all(undrawn) && first.iter().filter(|g| g.norm_sum > 0.0).count() > 100);
        if radio_target == RadioTarget::Jet {
            continue;
        }
        // What rounding makes of some more steps stays small, a change of density included, after which the network has other rows.
        let [a, b] = [&mut cpu, &mut gpu].map(|r| {
            while r.steps_done() < 32 {
                r.train(32 - r.steps_done()).unwrap();
            }
            (r.render(&pose).unwrap(), r.gaussian_count())
        });
        let difference: f32 =
            a.0.pixels.iter().zip(&b.0.pixels).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.0.pixels.len() as f32;
        assert!(difference < 0.01 && a.1.abs_diff(b.1) < 25, "{difference}, {} and {} Gaussians", a.1, b.1);
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_restored_reconstruction_goes_on_to_the_same_bytes_on_a_gpu_too() {
    if testing::context(&testing::OPTIONS).is_none() {
        return;
    }
    let config = WrfGsPlusConfig { iterations: 40, random_points: 300, ..small() };
    let make = || on_gpu(&config, &OPTIONS, 1 << 18);
    let mut whole = make();
    whole.begin().unwrap();
    whole.train(25).unwrap();
    let checkpoint = whole.checkpoint("").unwrap();
    while whole.train(100).unwrap().is_some() {}
    let mut second = make();
    second.restore(&checkpoint).unwrap();
    while second.train(7).unwrap().is_some() {}
    let (a, b) = (whole.field().unwrap(), second.field().unwrap());
    assert!(
        a.parameters == b.parameters && a.gaussians.radio == b.gaussians.radio && a.gaussians.position == b.gaussians.position
    );
}
