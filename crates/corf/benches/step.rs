//! One coupled training step on the CPU, whole and stage by stage: `cargo bench -p corf --bench step`.
//!
//! The scene is a room of 14 × 15 × 3.5 m whose surfaces are covered with 15 000 Gaussians, seen from the middle with a horizontal field
//! of view of 90°: 4 171 of them reach a tile, and a tile's list holds 97 on average (not all reach each of its pixels). Images are those of
//! lobby-mini: 192×108 in light, 96×64 at 60 GHz.

#![allow(clippy::print_stdout, clippy::print_stderr)]

use corf::{
    CpuDevice, Device, Gaussians, OptimizerConfig, RasterConfig,
    device::{Planes, Step, TrainingView, ViewId},
};
use corf_scene::{Pinhole, Rigid3, Rng};
use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;

const GAUSSIANS: usize = 15_000;
/// Standard deviation of a Gaussian, metres, before its random factor of 2.
const SIZE_M: f32 = 0.13;
const LEVELS: u32 = 3;

fn room(radio_channels: usize, degree: usize) -> Gaussians {
    let mut rng = Rng::keyed(5, 0, 0);
    let mut g = Gaussians::empty(radio_channels, degree);
    let half = [7.0_f32, 7.5, 1.75];
    // Walls, floor and ceiling in proportion to their areas.
    let area = [half[1] * half[2], half[0] * half[2], half[0] * half[1]];
    for _ in 0..GAUSSIANS {
        let pick = rng.uniform() * (area[0] + area[1] + area[2]);
        let axis = usize::from(pick > area[0]) + usize::from(pick > area[0] + area[1]);
        let mut p = [0, 1, 2].map(|k| (rng.uniform() * 2.0 - 1.0) * half[k]);
        p[axis] = half[axis].copysign(p[axis]) + 0.02 * rng.normal() as f32;
        g.position.push(p);
        g.rotation.push([0; 4].map(|_| rng.normal() as f32));
        g.log_scale.push([0; 3].map(|_| (SIZE_M * 2.0_f32.powf(rng.uniform() * 2.0 - 1.0)).ln()));
    }
    for a in [&mut g.light, &mut g.radio] {
        a.opacity_logit = (0..GAUSSIANS).map(|_| rng.uniform() * 4.0 - 3.5).collect();
        a.sh = (0..GAUSSIANS * a.stride())
            .map(|i| (rng.uniform() - 0.5) * if i % a.stride() < a.channels { 1.0 } else { 0.05 })
            .collect();
    }
    g
}

fn noise(camera: &Pinhole, channels: usize) -> Planes {
    let mut rng = Rng::keyed(5, 1, channels as u64);
    let pixels = (0..camera.width * camera.height * channels).map(|_| rng.uniform()).collect();
    Planes { width: camera.width, height: camera.height, channels, pixels }
}

fn device(radio_channels: usize, degree: usize) -> CpuDevice {
    // Rates of zero: every step sees the same scene.
    let mut optimizer =
        OptimizerConfig { position_rate_m: 0.0, log_scale_rate: 0.0, rotation_rate: 0.0, ..OptimizerConfig::default() };
    for a in [&mut optimizer.light, &mut optimizer.radio] {
        (a.sh_dc, a.opacity) = (0.0, 0.0);
    }
    let mut device = CpuDevice::new(optimizer, RasterConfig::default(), &room(radio_channels, degree)).expect("a valid field");
    let (light_camera, radio_camera) = (Pinhole::from_horizontal_fov(192, 108, 90.0), Pinhole::from_horizontal_fov(96, 64, 90.0));
    let view = TrainingView {
        world_from_camera: Rigid3::looking_at(DVec3::new(-1.0, 0.5, 0.0), DVec3::new(5.0, 3.0, -0.2), DVec3::Z),
        light: noise(&light_camera, 3),
        light_camera,
        radio: noise(&radio_camera, radio_channels),
        radio_camera,
        inverse_depth: None,
        mask: None,
    };
    device.upload(&view, LEVELS).expect("a valid view");
    device
}

fn step(level: u32) -> Step {
    Step {
        view: ViewId(0),
        levels: [level; 2],
        light_weight: 1.0,
        radio_weight: 0.1,
        depth_weight: 0.0,
        train_geometry: true,
        light_background: [0.5; 3],
        radio_background: [0.0, 0.0, 0.5],
    }
}

/// Prints milliseconds per stage of the fastest of 200 steps, the one that other work on the machine disturbed least.
fn table() {
    println!("level  harmonics  project   sort  forward   loss  backward  update  total ms");
    for (level, degree) in [(0, 3), (1, 3), (2, 3), (0, 1)] {
        let mut device = device(3, degree);
        let mut best = device.take_stage_times();
        for run in 0..200 {
            device.train(&[step(level)]).expect("a step");
            let times = device.take_stage_times();
            if run == 0 || times.total_s() < best.total_s() {
                best = times;
            }
        }
        let ms = [best.project_s, best.sort_s, best.forward_s, best.loss_s, best.backward_s, best.update_s, best.total_s()]
            .map(|s| s * 1e3 / best.steps as f64);
        let [a, b, c, d, e, f, g] = ms;
        println!("{level:5}  {degree:9}  {a:7.3}  {b:5.3}  {c:7.3}  {d:5.3}  {e:8.3}  {f:6.3}  {g:8.3}");
    }
    let mut device = device(3, 3);
    let report = device.train(&[step(0)]).expect("a step");
    println!(
        "{}: {GAUSSIANS} Gaussians, {} visible, {:.1} per list of an optical tile",
        device.name(),
        report.visible,
        device.overdraw()[0]
    );
}

fn bench(c: &mut Criterion) {
    table();
    for level in 0..LEVELS {
        let mut device = device(3, 3);
        c.bench_function(&format!("coupled step, level {level}"), |b| b.iter(|| device.train(&[step(level)])));
    }
}

criterion_group! { name = benches; config = Criterion::default().sample_size(20); targets = bench }
criterion_main!(benches);
