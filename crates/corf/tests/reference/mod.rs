//! The f64 oracle: a plain renderer and loss, one pixel and one Gaussian after the other, written from the equations and sharing no
//! line with the devices.

use corf::{Antialias, Gaussians, device::Planes};
use corf_scene::{Pinhole, Raster, Rigid3};
use glam::{DMat3, DQuat, DVec3};

/// Coupled Gaussians in f64, each parameter class one flat run.
#[derive(Clone)]
pub struct Field {
    /// Position, quaternion, ln scale, optical opacity, RF opacity, optical harmonics, RF harmonics.
    pub classes: [Vec<f64>; 7],
    pub channels: [usize; 2],
    pub coefficients: [usize; 2],
    /// Displacement of each projected mean, pixels; zero but for gradients with respect to it.
    pub shift: Vec<[f64; 2]>,
}

pub const CLASS_NAMES: [&str; 7] = ["position", "rotation", "log scale", "optical opacity", "RF opacity", "optical sh", "RF sh"];

fn flat<const N: usize>(v: &[[f32; N]]) -> Vec<f64> {
    v.iter().flatten().map(|v| f64::from(*v)).collect()
}

fn wide(v: &[f32]) -> Vec<f64> {
    v.iter().map(|v| f64::from(*v)).collect()
}

impl Field {
    pub fn new(g: &Gaussians) -> Self {
        Self {
            classes: [
                flat(&g.position),
                flat(&g.rotation),
                flat(&g.log_scale),
                wide(&g.light.opacity_logit),
                wide(&g.radio.opacity_logit),
                wide(&g.light.sh),
                wide(&g.radio.sh),
            ],
            channels: [g.light.channels, g.radio.channels],
            coefficients: [g.light.coefficients(), g.radio.coefficients()],
            shift: vec![[0.0; 2]; g.len()],
        }
    }

    pub fn len(&self) -> usize {
        self.classes[3].len()
    }
}

pub struct Image {
    pub width: usize,
    pub height: usize,
    pub channels: usize,
    /// `[pixel][channel]`.
    pub color: Vec<f64>,
    pub inverse_depth: Vec<f64>,
    pub transmittance: Vec<f64>,
    /// Closest any weight came to the threshold of 1/255, any transmittance to the end of its pixel at 1e-4, any colour to its clamp.
    pub margin: f64,
    /// The antialias factor of each Gaussian.
    pub rho: Vec<f64>,
}

/// Real spherical harmonics from the normalised associated Legendre definition, by m < 0, 0, > 0, up to degree 3.
fn harmonics(d: DVec3) -> [f64; 16] {
    use std::f64::consts::PI;
    let (x, y, z) = (d.x, d.y, d.z);
    let k = |n: f64, d: f64| (n / (d * PI)).sqrt();
    [
        k(1.0, 4.0),
        -k(3.0, 4.0) * y,
        k(3.0, 4.0) * z,
        -k(3.0, 4.0) * x,
        k(15.0, 4.0) * x * y,
        -k(15.0, 4.0) * y * z,
        k(5.0, 16.0) * (3.0 * z * z - d.length_squared()),
        -k(15.0, 4.0) * x * z,
        k(15.0, 16.0) * (x * x - y * y),
        -k(35.0, 32.0) * y * (3.0 * x * x - y * y),
        k(105.0, 4.0) * x * y * z,
        -k(21.0, 32.0) * y * (5.0 * z * z - d.length_squared()),
        k(7.0, 16.0) * z * (5.0 * z * z - 3.0 * d.length_squared()),
        -k(21.0, 32.0) * x * (5.0 * z * z - d.length_squared()),
        k(105.0, 16.0) * z * (x * x - y * y),
        -k(35.0, 32.0) * x * (x * x - 3.0 * y * y),
    ]
}

/// Renders modality `g` (0 optical, 1 RF). `rho` holds the antialias factors constant if given.
pub fn render(
    field: &Field,
    g: usize,
    world_from_camera: &Rigid3,
    camera: &Pinhole,
    background: [f64; 3],
    antialias: Antialias,
    near: f64,
    rho: Option<&[f64]>,
) -> Image {
    let camera_from_world = world_from_camera.inverse();
    let w = camera_from_world.rotation;
    let h = f64::from(antialias.dilation());
    let (channels, coefficients) = (field.channels[g], field.coefficients[g]);
    struct Splat {
        z: f64,
        u: f64,
        v: f64,
        q: [f64; 3],
        opacity: f64,
        color: [f64; 3],
    }
    let mut splats = Vec::new();
    let mut margin = f64::INFINITY;
    let mut rhos = vec![1.0; field.len()];
    for i in 0..field.len() {
        let mean = DVec3::from_slice(&field.classes[0][3 * i..]);
        let p = camera_from_world.transform_point(mean);
        if p.z <= near {
            continue;
        }
        let q = &field.classes[1][4 * i..4 * i + 4];
        let rotation = DMat3::from_quat(DQuat::from_xyzw(q[1], q[2], q[3], q[0]).normalize());
        let s = &field.classes[2][3 * i..3 * i + 3];
        let m = w * rotation * DMat3::from_diagonal(DVec3::new(s[0].exp(), s[1].exp(), s[2].exp()));
        let covariance = m * m.transpose();
        let clamp =
            |value: f64, size: usize, f: f64, c: f64| value.clamp((-0.15 * size as f64 - c) / f, (1.15 * size as f64 - c) / f);
        let x = clamp(p.x / p.z, camera.width, camera.fx, camera.cx);
        let y = clamp(p.y / p.z, camera.height, camera.fy, camera.cy);
        let j0 = DVec3::new(camera.fx / p.z, 0.0, -camera.fx * x / p.z);
        let j1 = DVec3::new(0.0, camera.fy / p.z, -camera.fy * y / p.z);
        let (a, b, c) = (j0.dot(covariance * j0), j0.dot(covariance * j1), j1.dot(covariance * j1));
        let (det0, det1) = (a * c - b * b, (a + h) * (c + h) - b * b);
        rhos[i] = match (antialias, rho) {
            (Antialias::Off, _) => 1.0,
            (_, Some(fixed)) => fixed[i],
            _ => (det0 / det1).max(2.5e-5).sqrt(),
        };
        let logit = field.classes[3 + g][i];
        let y = harmonics((mean - world_from_camera.translation).normalize());
        let mut color = [0.0; 3];
        for ch in 0..channels {
            let sum: f64 = (0..coefficients).map(|k| y[k] * field.classes[5 + g][(i * coefficients + k) * channels + ch]).sum();
            margin = margin.min((0.5 + sum).abs());
            color[ch] = (0.5 + sum).max(0.0);
        }
        splats.push(Splat {
            z: p.z,
            u: camera.fx * p.x / p.z + camera.cx + field.shift[i][0],
            v: camera.fy * p.y / p.z + camera.cy + field.shift[i][1],
            q: [(c + h) / det1, -b / det1, (a + h) / det1],
            opacity: rhos[i] / (1.0 + (-logit).exp()),
            color,
        });
    }
    splats.sort_by(|a, b| a.z.total_cmp(&b.z));
    let mut out = Image {
        width: camera.width,
        height: camera.height,
        channels,
        color: vec![],
        inverse_depth: vec![],
        transmittance: vec![],
        margin,
        rho: rhos,
    };
    for py in 0..camera.height {
        for px in 0..camera.width {
            let (mut t, mut depth, mut color) = (1.0, 0.0, [0.0; 3]);
            for s in &splats {
                let (dx, dy) = (s.u - (px as f64 + 0.5), s.v - (py as f64 + 0.5));
                let sigma = 0.5 * (s.q[0] * dx * dx + 2.0 * s.q[1] * dx * dy + s.q[2] * dy * dy);
                let alpha = (s.opacity * (-sigma).exp()).min(0.999);
                out.margin = out.margin.min((alpha - 1.0 / 255.0).abs());
                if alpha < 1.0 / 255.0 {
                    continue;
                }
                for ch in 0..channels {
                    color[ch] += t * alpha * s.color[ch];
                }
                depth += t * alpha / s.z;
                t *= 1.0 - alpha;
                out.margin = out.margin.min((t - 1e-4).abs());
                if t < 1e-4 {
                    break;
                }
            }
            for ch in 0..channels {
                out.color.push(color[ch] + t * background[ch]);
            }
            out.inverse_depth.push(depth);
            out.transmittance.push(t);
        }
    }
    out
}

/// 0.8·L1 + 0.2·(1 − SSIM), SSIM with an 11×11 Gaussian window of σ = 1.5 and zero padding, straight from the definition.
pub fn image_loss(image: &Image, target: &Planes) -> f64 {
    let (w, h, n) = (image.width as i64, image.height as i64, image.channels);
    let g: Vec<f64> = (-5..=5).map(|i| (-f64::from(i * i) / 4.5).exp()).collect();
    let norm: f64 = g.iter().sum();
    let (mut l1, mut ssim) = (0.0, 0.0);
    for c in 0..n {
        let at = |x: i64, y: i64| (y * w + x) as usize * n + c;
        let value = |i: usize| (image.color[i], f64::from(target.pixels[i]));
        // Rows first, then columns, of x, y, x², y², xy.
        let mut rows = vec![[0.0; 5]; (w * h) as usize];
        for y in 0..h {
            for x in 0..w {
                for d in (-5..=5_i64).filter(|d| (0..w).contains(&(x + d))) {
                    let (a, b) = value(at(x + d, y));
                    let k = g[(d + 5) as usize] / norm;
                    for (sum, v) in rows[(y * w + x) as usize].iter_mut().zip([a, b, a * a, b * b, a * b]) {
                        *sum += k * v;
                    }
                }
            }
        }
        for y in 0..h {
            for x in 0..w {
                let mut m = [0.0; 5];
                for d in (-5..=5_i64).filter(|d| (0..h).contains(&(y + d))) {
                    for (sum, v) in m.iter_mut().zip(rows[((y + d) * w + x) as usize]) {
                        *sum += g[(d + 5) as usize] / norm * v;
                    }
                }
                let [mx, my, xx, yy, xy] = m;
                ssim += (2.0 * mx * my + 1e-4) * (2.0 * (xy - mx * my) + 9e-4)
                    / ((mx * mx + my * my + 1e-4) * (xx - mx * mx + yy - my * my + 9e-4));
                let (a, b) = value(at(x, y));
                l1 += (a - b).abs();
            }
        }
    }
    let count = (w * h) as f64 * n as f64;
    0.8 * l1 / count + 0.2 * (1.0 - ssim / count)
}

/// Mean of confidence·|I − target|.
pub fn depth_loss(image: &Image, value: &Raster<f32>, confidence: &Raster<f32>) -> f64 {
    let pairs = value.pixels().iter().zip(confidence.pixels()).zip(&image.inverse_depth);
    pairs.map(|((v, c), i)| f64::from(*c) * (i - f64::from(*v)).abs()).sum::<f64>() / image.inverse_depth.len() as f64
}
