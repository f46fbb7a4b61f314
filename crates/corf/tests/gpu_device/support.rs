//! Fields, views and devices that the tests share, and how two devices are compared.

use corf::{
    CpuDevice, Gaussians, OptimizerConfig, RasterConfig,
    device::{
        InverseDepth, Planes, RenderRequest, Rendering, Step, TrainingView, View, ViewId,
        gpu::{GpuDevice, GpuOptions},
    },
    gaussians::logit,
};
use corf_scene::{Pinhole, Raster, Rigid3, Rng};
use glam::DVec3;

pub const OPTIONS: GpuOptions = GpuOptions {
    adapter: corf_gpu::testing::OPTIONS,
    tile: None,
    batch: 16,
    segments: None,
    fused: true,
    least_room: 16,
    keyframe_bytes: u64::MAX,
};

/// Rendered values: a few hundred f32 roundings of numbers near 1, in exp2 and division of some ulp.
const IMAGE_TOLERANCE: f32 = 2e-5;
/// Largest share of pixels that may differ by up to 1/255: where a weight lies within rounding of 1/255, or a pixel's end within rounding
/// of T = 1e-4, one device draws a Gaussian and the other does not.
pub const THRESHOLD_SHARE: f64 = 1e-3;
const THRESHOLD_STEP: f32 = 1.0 / 255.0 + IMAGE_TOLERANCE;
/// Gradients relative to the largest of their class, in the norm over Gaussians: the pixels of [`THRESHOLD_SHARE`] are in them.
const GRADIENT_TOLERANCE: f64 = 1e-3;

/// Tiles differ in size between the devices: an ellipse between two rows of pixel centres is within one's tile and in neither of the
/// other's. It is drawn nowhere, but counts as visible.
const UNDRAWN_SHARE: f64 = 0.03;

pub fn open(options: &GpuOptions, optimizer: OptimizerConfig, raster: RasterConfig, g: &Gaussians) -> Option<GpuDevice> {
    corf_gpu::testing::context(&options.adapter)?;
    Some(GpuDevice::new(options, optimizer, raster, g).unwrap())
}

/// Both devices holding the same Gaussians.
pub fn pair(optimizer: OptimizerConfig, raster: RasterConfig, g: &Gaussians) -> Option<(CpuDevice, GpuDevice)> {
    let gpu = open(&OPTIONS, optimizer, raster, g)?;
    Some((CpuDevice::new(optimizer, raster, g).unwrap(), gpu))
}

/// Gaussians on the walls of a room around the origin, some wide, some thin, some behind any camera.
pub fn room(seed: u64, n: usize, radio_channels: usize, degrees: [usize; 2]) -> Gaussians {
    let mut rng = Rng::keyed(seed, 0, 0);
    let mut g = Gaussians::empty(radio_channels, degrees[0]);
    g.radio.sh_degree = degrees[1];
    let half = [4.0_f32, 3.0, 1.5];
    for _ in 0..n {
        let mut p = [0, 1, 2].map(|k| (rng.uniform() * 2.0 - 1.0) * half[k]);
        let axis = rng.below(3);
        p[axis] = half[axis].copysign(p[axis]);
        g.position.push(p);
        g.rotation.push([0; 4].map(|_| rng.normal() as f32));
        g.log_scale.push([0; 3].map(|_| -3.5 + 2.5 * rng.uniform()));
        for a in [&mut g.light, &mut g.radio] {
            a.opacity_logit.push(logit(0.02 + 0.9 * rng.uniform()));
            let stride = a.stride();
            a.sh.extend((0..stride).map(|i| (rng.uniform() - 0.5) * if i < a.channels { 1.6 } else { 0.2 }));
        }
    }
    g
}

pub fn cameras() -> (Pinhole, Pinhole) {
    // Neither a multiple of a tile, and principal points off the middle.
    let light = Pinhole { width: 149, height: 83, fx: 80.0, fy: 82.0, cx: 72.2, cy: 44.7 };
    (light, Pinhole { width: 53, height: 41, fx: 25.0, fy: 26.0, cx: 27.1, cy: 19.2 })
}

pub fn pose(k: usize) -> Rigid3 {
    let angle = 0.7 * k as f64;
    let eye = DVec3::new(0.5 * angle.cos(), 0.4 * angle.sin(), 0.1);
    Rigid3::looking_at(eye, eye + DVec3::new(angle.cos(), angle.sin(), -0.1), DVec3::Z)
}

pub fn noise(rng: &mut Rng, camera: &Pinhole, channels: usize) -> Planes {
    let pixels = (0..camera.width * camera.height * channels).map(|_| rng.uniform()).collect();
    Planes { width: camera.width, height: camera.height, channels, pixels }
}

/// Noise of 8 bits, as images are.
pub fn image(rng: &mut Rng, camera: &Pinhole) -> Planes {
    let mut image = noise(rng, camera, 3);
    image.pixels.iter_mut().for_each(|v| *v = f32::from((*v * 255.0) as u8) / 255.0);
    image
}

/// A view of noise; every third has a target in light that is of no 8-bit image.
pub fn training_view(k: usize, radio_channels: usize, depth: bool) -> TrainingView {
    let mut rng = Rng::keyed(77, k as u64, 0);
    let (light_camera, radio_camera) = cameras();
    // Half-precision floats, as the GPU device keeps them: it is compared with the same targets.
    let inverse_depth = depth.then(|| InverseDepth {
        value: Raster::from_fn(light_camera.width, light_camera.height, |_, _| (40 + rng.below(12)) as f32 / 64.0),
        confidence: Raster::from_fn(light_camera.width, light_camera.height, |x, _| if x % 3 == 0 { 0.0 } else { 0.75 }),
    });
    TrainingView {
        world_from_camera: pose(k),
        light: if k % 3 == 1 { noise(&mut rng, &light_camera, 3) } else { image(&mut rng, &light_camera) },
        light_camera,
        radio: noise(&mut rng, &radio_camera, radio_channels),
        radio_camera,
        inverse_depth,
        mask: None,
    }
}

pub fn step(view: usize, level: u32) -> Step {
    Step {
        view: ViewId(view),
        levels: [level; 2],
        light_weight: 1.0,
        radio_weight: 0.3,
        depth_weight: 0.5,
        train_geometry: true,
        light_background: [0.3, 0.6, 0.1],
        radio_background: [0.0, 0.1, 0.5],
    }
}

pub fn both(k: usize) -> RenderRequest {
    let (light, radio) = cameras();
    let view = |camera| View { camera, world_from_camera: pose(k) };
    RenderRequest {
        light: Some((view(light), [0.9, 0.2, 0.4])),
        radio: Some((view(radio), [0.1, 0.3, 0.6])),
        main_contributor: true,
    }
}

/// Compares value by value and returns the share beyond rounding; none may be beyond a threshold's step.
fn compare(what: &str, a: &[f32], b: &[f32]) {
    assert_eq!(a.len(), b.len(), "{what}");
    let mut beyond = 0;
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        let error = (a - b).abs();
        assert!(error <= THRESHOLD_STEP, "{what}, {i}: {a} against {b}");
        beyond += usize::from(error > IMAGE_TOLERANCE);
    }
    assert!(beyond as f64 <= THRESHOLD_SHARE * a.len() as f64, "{what}: {beyond} of {} beyond rounding", a.len());
}

pub fn compare_renderings(a: &Rendering, b: &Rendering) {
    for (what, a, b) in [("optical", &a.light, &b.light), ("rf", &a.radio, &b.radio)] {
        assert_eq!(a.is_some(), b.is_some());
        let (Some(a), Some(b)) = (a, b) else { continue };
        assert_eq!((a.color.width, a.color.height, a.color.channels), (b.color.width, b.color.height, b.color.channels));
        compare(&format!("{what} colour"), &a.color.pixels, &b.color.pixels);
        compare(&format!("{what} inverse depth"), a.inverse_depth.pixels(), b.inverse_depth.pixels());
        compare(&format!("{what} transmittance"), a.transmittance.pixels(), b.transmittance.pixels());
    }
}

pub fn classes(g: &Gaussians) -> [Vec<f32>; 7] {
    [
        g.position.as_flattened().to_vec(),
        g.rotation.as_flattened().to_vec(),
        g.log_scale.as_flattened().to_vec(),
        g.light.opacity_logit.clone(),
        g.radio.opacity_logit.clone(),
        g.light.sh.clone(),
        g.radio.sh.clone(),
    ]
}

pub fn norm(v: impl Iterator<Item = f64>) -> f64 {
    v.map(|v| v * v).sum::<f64>().sqrt()
}

/// Gradients of a step on both devices.
pub fn compare_gradients(cpu: &mut CpuDevice, gpu: &mut GpuDevice, s: &Step) {
    let (a_report, a) = cpu.gradients(s).unwrap();
    let (b_report, b) = gpu.gradients(s).unwrap();
    for (a, b) in [
        (a_report.light_loss, b_report.light_loss),
        (a_report.radio_loss, b_report.radio_loss),
        (a_report.depth_loss, b_report.depth_loss),
    ] {
        assert!((a - b).abs() < 1e-5, "loss {a} against {b}");
    }
    let (a_seen, b_seen) = (a_report.visible, b_report.visible);
    assert!(a_seen.abs_diff(b_seen) as f64 <= UNDRAWN_SHARE * a_seen as f64, "{a_seen} visible against {b_seen}");
    for (class, (a, b)) in classes(&a).iter().zip(classes(&b)).enumerate() {
        let size = norm(a.iter().map(|v| f64::from(*v)));
        let error = norm(a.iter().zip(&b).map(|(a, b)| f64::from(a - b)));
        assert!(error <= GRADIENT_TOLERANCE * size, "class {class} of {s:?}: {error:.2e} of {size:.2e}");
    }
}

/// A training view whose images have one camera.
pub fn one_camera(radio_channels: usize) -> TrainingView {
    let view = training_view(0, radio_channels, true);
    let mut rng = Rng::keyed(78, 0, 0);
    TrainingView { radio_camera: view.light_camera, radio: noise(&mut rng, &view.light_camera, radio_channels), ..view }
}

/// The walls as seen by rates in metres.
pub fn metric_rates() -> OptimizerConfig {
    OptimizerConfig { position_rate_m: 1e-3, ..OptimizerConfig::default() }
}

pub fn bits(g: &Gaussians) -> Vec<u32> {
    classes(g).iter().flatten().map(|v| v.to_bits()).collect()
}
