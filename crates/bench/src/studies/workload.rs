//! Training steps to measure: Gaussians on the surfaces of a furnished room, sixteen cameras around it, noise as targets.
//!
//! The room and the cameras are those of the peer measurements on which the figures to beat were taken; a file of Gaussians and one of
//! cameras may take their places, so that a peer and this program are given the same ones.

use crate::terminal::interrupt;
use anyhow::{Context, Result, ensure};
use corf::{
    AppearanceRates, Device, Gaussians, OptimizerConfig,
    device::{Planes, RenderRequest, Step, TrainingView, View, ViewId},
};
use corf_scene::{Pinhole, Rigid3, Rng};
use glam::DVec3;
use serde::Deserialize;
use std::path::Path;
use std::time::Instant;

/// Size of the room, metres.
pub const ROOM_M: [f64; 3] = [14.0, 15.0, 3.2];
/// Corners of what stands in it, metres.
pub const FURNITURE_M: [[[f64; 3]; 2]; 6] = [
    [[2.0, 3.0, 0.0], [3.5, 4.0, 0.8]],
    [[9.0, 2.0, 0.0], [12.0, 2.8, 1.1]],
    [[6.5, 7.0, 0.0], [7.1, 7.6, 3.2]],
    [[2.0, 10.0, 0.0], [4.0, 11.0, 0.5]],
    [[10.0, 11.0, 0.0], [11.5, 13.0, 0.75]],
    [[5.0, 12.0, 0.0], [5.6, 12.6, 3.2]],
];
/// Thickness of a Gaussian on its surface, metres.
const THICKNESS_M: f32 = 0.003;
/// Cameras around the room.
pub const CAMERAS: usize = 16;
/// All rates: small enough that the scene stays what it is while it is measured, as in the peer's script.
const RATE: f32 = 1e-4;

/// `n` Gaussians spread evenly over the surfaces: a spacing of 0.6 of their distance, opacities around 0.7, harmonics of degree 3.
pub fn room(n: usize, seed: u64) -> Gaussians {
    let mut faces = vec![];
    let mut add = |low: [f64; 3], high: [f64; 3]| {
        for axis in 0..3 {
            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
            let area = (high[a] - low[a]) * (high[b] - low[b]);
            faces.extend([low[axis], high[axis]].map(|at| (axis, at, low, high, area)));
        }
    };
    add([0.0; 3], ROOM_M);
    FURNITURE_M.iter().for_each(|[low, high]| add(*low, *high));
    let total: f64 = faces.iter().map(|f| f.4).sum();
    let spacing = (total / n as f64).sqrt();
    let mut rng = Rng::keyed(seed, 0, 0);
    let mut g = Gaussians::empty(3, 3);
    for _ in 0..n {
        let mut pick = rng.uniform_f64() * total;
        let face = faces.iter().find(|f| {
            pick -= f.4;
            pick <= 0.0
        });
        let (axis, at, low, high, _) = face.copied().unwrap_or(faces[0]);
        let mut p = [0, 1, 2].map(|k| (low[k] + rng.uniform_f64() * (high[k] - low[k])) as f32);
        p[axis] = at as f32;
        g.position.push(p);
        let mut s = [0; 3].map(|_| ((spacing * 0.6).ln() + 0.5 * rng.normal()) as f32);
        s[axis] = THICKNESS_M.ln();
        g.log_scale.push(s);
        g.rotation.push([1.0, 0.05 * rng.normal() as f32, 0.05 * rng.normal() as f32, 0.05 * rng.normal() as f32]);
        for a in [&mut g.light, &mut g.radio] {
            a.opacity_logit.push((1.0 + 1.5 * rng.normal()) as f32);
            let stride = a.stride();
            a.sh.extend((0..stride).map(|i| rng.normal() as f32 * if i < a.channels { 0.3 } else { 0.03 }));
        }
    }
    g
}

/// Poses and intrinsics of a measurement.
pub struct Rig {
    /// Camera poses, `world_from_camera`.
    pub world_from_camera: Vec<Rigid3>,
    /// Intrinsics of the optical images.
    pub light: Pinhole,
    /// Intrinsics of the RF images.
    pub radio: Pinhole,
}

/// On an ellipse around the middle of the room, looking along it; `turn` is a share of the way around.
fn pose(turn: f64) -> Rigid3 {
    let a = std::f64::consts::TAU * turn;
    let eye = DVec3::new(7.0 + 4.5 * a.cos(), 7.5 + 5.0 * a.sin(), 1.5);
    Rigid3::looking_at(eye, eye + DVec3::new(-a.sin(), a.cos(), 0.0), DVec3::Z)
}

/// Cameras around the room, 90° wide.
pub fn rig(light: [usize; 2], radio: [usize; 2]) -> Rig {
    let camera = |[w, h]: [usize; 2]| Pinhole::from_horizontal_fov(w, h, 90.0);
    Rig {
        world_from_camera: (0..CAMERAS).map(|i| pose(i as f64 / CAMERAS as f64)).collect(),
        light: camera(light),
        radio: camera(radio),
    }
}

/// A camera file: one set of intrinsics, poses as 4×4 `camera_from_world` matrices by rows.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    camera_from_world: Vec<[[f64; 4]; 4]>,
}

/// Reads a camera file; the RF images see the same field of view in `rf` pixels, or in as many as the optical ones.
///
/// # Errors
/// A file that cannot be read, has no pose, or a matrix that is no rigid transform.
pub fn read_rig(path: &Path, radio: Option<[usize; 2]>) -> Result<Rig> {
    let file: CameraFile = crate::files::json::read_json(path)
        .context("a camera file holds width, height, fx, fy, cx, cy and a list camera_from_world of 4x4 matrices by rows")?;
    ensure!(!file.camera_from_world.is_empty(), "{} names no pose", path.display());
    let light = Pinhole { width: file.width, height: file.height, fx: file.fx, fy: file.fy, cx: file.cx, cy: file.cy };
    let [w, h] = radio.unwrap_or([light.width, light.height]);
    let (sx, sy) = (w as f64 / light.width as f64, h as f64 / light.height as f64);
    let radio = Pinhole { width: w, height: h, fx: light.fx * sx, fy: light.fy * sx, cx: light.cx * sx, cy: light.cy * sy };
    let pose =
        |(i, rows): (usize, &[[f64; 4]; 4])| Ok(Rigid3::from_rows(rows, &format!("{}: pose {i}", path.display()))?.inverse());
    let world_from_camera = file.camera_from_world.iter().enumerate().map(pose).collect::<Result<_>>()?;
    Ok(Rig { world_from_camera, light, radio })
}

impl Rig {
    /// A training view of noise at every pose: of 8 bits in light, as images are.
    pub fn views(&self, radio_channels: usize) -> impl Iterator<Item = TrainingView> + '_ {
        let noise = |i: usize, camera: &Pinhole, channels: usize, of: fn(f32) -> f32| {
            let mut rng = Rng::keyed(1, i as u64, channels as u64);
            let pixels = (0..camera.width * camera.height * channels).map(|_| of(rng.uniform())).collect();
            Planes { width: camera.width, height: camera.height, channels, pixels }
        };
        let image = |value: f32| f32::from((value * 255.0) as u8) / 255.0;
        self.world_from_camera.iter().enumerate().map(move |(i, pose)| TrainingView {
            world_from_camera: *pose,
            light: noise(i, &self.light, 3, image),
            light_camera: self.light,
            radio: noise(i, &self.radio, radio_channels, |value| value),
            radio_camera: self.radio,
            inverse_depth: None,
            mask: None,
        })
    }

    /// `count` coupled steps, pose after pose.
    pub fn steps(&self, count: usize) -> Vec<Step> {
        let step = |i: usize| Step {
            view: ViewId(i % self.world_from_camera.len()),
            levels: [0; 2],
            light_weight: 1.0,
            radio_weight: 0.1,
            depth_weight: 0.0,
            train_geometry: true,
            light_background: [0.0; 3],
            radio_background: [0.0; 3],
        };
        (0..count).map(step).collect()
    }
}

impl Rig {
    /// `count` requests for both images, once around the room in poses of which few are the rig's.
    pub fn novel_views(&self, count: usize) -> Vec<RenderRequest> {
        let request = |i: usize| {
            let world_from_camera = pose((i as f64 + 0.5) / count as f64);
            let view = |camera| View { camera, world_from_camera };
            RenderRequest {
                light: Some((view(self.light), [0.0; 3])),
                radio: Some((view(self.radio), [0.0; 3])),
                main_contributor: false,
            }
        };
        (0..count).map(request).collect()
    }
}

/// Wall clock of a training step.
pub struct StepTime {
    /// Median of the runs, milliseconds.
    pub median_ms: f64,
    /// Least and greatest of them.
    pub range_ms: [f64; 2],
    /// Gaussians that reach a tile, in the last step.
    pub visible: usize,
}

/// Times whole runs of steps on the rig's views, which the device has, after some that warm it up.
///
/// # Errors
/// The device's; an interrupt.
pub fn time_steps(device: &mut dyn Device, rig: &Rig, steps: usize, repeats: usize) -> Result<StepTime> {
    ensure!(steps > 0 && repeats > 0, "steps and runs to time: give at least 1");
    let steps = rig.steps(steps);
    let mut visible = device.train(&steps[..steps.len().min(CAMERAS)])?.visible;
    let mut ms = vec![];
    for _ in 0..repeats {
        interrupt::check()?;
        let start = Instant::now();
        visible = device.train(&steps)?.visible;
        ms.push(start.elapsed().as_secs_f64() * 1e3 / steps.len() as f64);
    }
    ms.sort_by(f64::total_cmp);
    Ok(StepTime { median_ms: ms[ms.len() / 2], range_ms: [ms[0], ms[ms.len() - 1]], visible })
}

/// The optimiser of a measurement: every rate alike, and so small that the scene stays what it is.
pub fn optimizer() -> OptimizerConfig {
    let rates = AppearanceRates { sh_dc: RATE, sh_rest_divisor: 1.0, opacity: RATE };
    OptimizerConfig {
        position_rate_m: RATE,
        log_scale_rate: RATE,
        rotation_rate: RATE,
        light: rates,
        radio: rates,
        ..OptimizerConfig::default()
    }
}
