//! Removing Monte Carlo noise: an edge-avoiding à-trous filter steered by geometry and variance.
//!
//! After Dammertz et al. (*Edge-Avoiding À-Trous Wavelet Transform*, HPG 2010) with the variance-guided luminance stop of Schied et
//! al. (*Spatiotemporal Variance-Guided Filtering*, HPG 2017), in space only. Emission seen directly is taken out and scattered light
//! is divided by the albedo first, so texture never passes through the filter.

use super::{LightFrame, MIN_ALBEDO, luminance};
use corf_scene::{Pinhole, Raster};
use glam::Vec3;
use rayon::prelude::*;

/// How strongly to smooth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DenoiseSettings {
    /// Passes; pass k reaches 2·2ᵏ pixels.
    pub passes: u32,
    /// Luminance may differ by this many standard errors before a neighbour is refused.
    pub luminance_sigmas: f32,
    /// Exponent on the cosine between normals.
    pub normal_power: f32,
    /// Distance from the pixel's tangent plane, in pixel footprints, at which a neighbour's weight is 1/e.
    pub plane_footprints: f32,
}

impl Default for DenoiseSettings {
    fn default() -> Self {
        Self { passes: 3, luminance_sigmas: 3.0, normal_power: 64.0, plane_footprints: 1.5 }
    }
}

/// Weights of the B3 spline, the à-trous scaling function, by distance.
const SPLINE: [f32; 3] = [3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0];
/// Standard errors below this share of the luminance are treated as this: a few samples can agree by luck.
const MIN_RELATIVE_ERROR: f32 = 0.01;

/// What the filter knows about a pixel beside its light.
#[derive(Clone, Copy)]
struct Guide {
    /// World position of the centre's hit; not finite where nothing was hit.
    position: Vec3,
    /// Unit normal, or zero.
    normal: Vec3,
    /// 1 / metres: inverse width of the plane stop.
    per_plane_metre: f32,
}

/// A pixel's light on its way through the passes: demodulated colour and the variance of its luminance.
#[derive(Clone, Copy)]
struct Light {
    color: Vec3,
    variance: f32,
}

/// The frame's radiance with Monte Carlo noise smoothed away: texture, emitters and geometric edges stay as they are.
///
/// Pixels are independent within a pass, so the result does not depend on the number of threads.
pub fn denoise(frame: &LightFrame, settings: &DenoiseSettings) -> Raster<[f32; 3]> {
    let (width, height) = (frame.radiance.width(), frame.radiance.height());
    let guides = guides(frame, settings);
    let mut light: Vec<Light> = (0..width * height)
        .map(|i| {
            let scattered = Vec3::from(frame.radiance.pixels()[i]) - Vec3::from(frame.emitted.pixels()[i]);
            let color = scattered / Vec3::from(frame.albedo.pixels()[i]).max(Vec3::splat(MIN_ALBEDO));
            // One sample a pixel has no spread to go by: every neighbour of the same surface is welcome.
            Light { color, variance: frame.variance.pixels()[i].min(1e12) }
        })
        .collect();
    light = (0..width * height)
        .into_par_iter()
        .map(|i| despeckle((i % width) as isize, (i / width) as isize, &light, width, height))
        .collect();
    for pass in 0..settings.passes {
        let step = 1isize << pass;
        light = (0..width * height)
            .into_par_iter()
            .map(|i| filter((i % width) as isize, (i / width) as isize, step, &light, &guides, width, height, settings))
            .collect();
    }
    let data = (0..width * height)
        .map(|i| {
            let albedo = Vec3::from(frame.albedo.pixels()[i]).max(Vec3::splat(MIN_ALBEDO));
            (light[i].color * albedo + Vec3::from(frame.emitted.pixels()[i])).max(Vec3::ZERO).to_array()
        })
        .collect();
    Raster::from_vec(width, height, data)
}

fn guides(frame: &LightFrame, settings: &DenoiseSettings) -> Vec<Guide> {
    let (camera, width): (&Pinhole, usize) = (&frame.camera, frame.radiance.width());
    frame
        .depth_m
        .pixels()
        .iter()
        .enumerate()
        .map(|(i, &depth)| {
            let toward = camera.unproject((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let position = frame.world_from_camera.transform_point(toward * f64::from(depth)).as_vec3();
            let footprint = depth / camera.fx as f32;
            Guide {
                position,
                normal: Vec3::from(frame.normal.pixels()[i]).normalize_or_zero(),
                per_plane_metre: 1.0 / (settings.plane_footprints * footprint).max(1e-9),
            }
        })
        .collect()
}

/// Standard errors above this share of the luminance make a pixel doubtful.
const DOUBTFUL_RELATIVE_ERROR: f32 = 0.05;

/// A doubtful pixel brighter or darker than all its neighbours is brought to the nearest of them: a rare bright path would otherwise
/// survive where geometry isolates a pixel, as along edges.
fn despeckle(x: isize, y: isize, light: &[Light], width: usize, height: usize) -> Light {
    let here = light[y as usize * width + x as usize];
    let value = luminance(here.color);
    if here.variance.sqrt() <= DOUBTFUL_RELATIVE_ERROR * value {
        return here;
    }
    let (mut low, mut high) = (f32::INFINITY, 0.0f32);
    for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
        let (qx, qy) = (x + dx, y + dy);
        if (dx, dy) != (0, 0) && (0..width as isize).contains(&qx) && (0..height as isize).contains(&qy) {
            let neighbour = luminance(light[qy as usize * width + qx as usize].color);
            low = low.min(neighbour);
            high = high.max(neighbour);
        }
    }
    let target = if low <= high { value.clamp(low, high) } else { value };
    let scale = if value > 0.0 { target / value } else { 1.0 };
    Light { color: here.color * scale, variance: here.variance * scale * scale }
}

/// One pixel of one pass.
fn filter(
    x: isize,
    y: isize,
    step: isize,
    light: &[Light],
    guides: &[Guide],
    width: usize,
    height: usize,
    settings: &DenoiseSettings,
) -> Light {
    let at = |x: isize, y: isize| {
        ((0..width as isize).contains(&x) && (0..height as isize).contains(&y)).then(|| y as usize * width + x as usize)
    };
    let centre = y as usize * width + x as usize;
    let (here, guide) = (light[centre], guides[centre]);
    let here_luminance = luminance(here.color);
    // The variance estimate is itself noisy: smooth it over 3 × 3 pixels.
    let (mut variance, mut total) = (0.0, 0.0);
    for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
        if let Some(q) = at(x + dx, y + dy) {
            let w = [0.5, 0.25][dx.unsigned_abs()] * [0.5, 0.25][dy.unsigned_abs()];
            variance += w * light[q].variance;
            total += w;
        }
    }
    let error = (variance / total).sqrt().max(MIN_RELATIVE_ERROR * here_luminance).max(1e-6);
    let per_luminance = 1.0 / (settings.luminance_sigmas * error);

    let (mut color, mut spread, mut weights) = (Vec3::ZERO, 0.0, 0.0);
    for dy in -2..=2isize {
        for dx in -2..=2isize {
            let Some(q) = at(x + dx * step, y + dy * step) else { continue };
            let mut w = SPLINE[dx.unsigned_abs()] * SPLINE[dy.unsigned_abs()];
            if q != centre {
                w *= geometric_weight(&guide, &guides[q], settings);
                if w <= 0.0 {
                    continue;
                }
                w *= (-(luminance(light[q].color) - here_luminance).abs() * per_luminance).exp();
            }
            color += light[q].color * w;
            spread += light[q].variance * w * w;
            weights += w;
        }
    }
    Light { color: color / weights, variance: spread / (weights * weights) }
}

/// How much two pixels lie on one smooth surface, 0 to 1.
fn geometric_weight(a: &Guide, b: &Guide, settings: &DenoiseSettings) -> f32 {
    if !a.position.is_finite() || !b.position.is_finite() {
        return if a.position.is_finite() == b.position.is_finite() { 1.0 } else { 0.0 };
    }
    let cos = a.normal.dot(b.normal).max(0.0);
    let plane = a.normal.dot(b.position - a.position).abs();
    cos.powf(settings.normal_power) * (-plane * a.per_plane_metre).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::RayCounts;
    use corf_scene::{Rigid3, Rng};
    use glam::DVec3;

    /// A wall seen head-on, left half dark and right half bright in albedo, with noise of known variance on its irradiance.
    fn noisy_wall(sigma: f32, corner: bool) -> LightFrame {
        let camera = Pinhole::from_horizontal_fov(64, 48, 60.0);
        let mut rng = Rng::keyed(4, 4, 4);
        let albedo = Raster::from_fn(64, 48, |x, _| if x % 8 < 4 { [0.1; 3] } else { [0.9; 3] });
        let radiance = Raster::from_fn(64, 48, |x, y| {
            let irradiance = if corner && x >= 32 { 3.0 } else { 1.0 };
            [albedo[(x, y)][0] * (irradiance + sigma * rng.normal() as f32); 3]
        });
        let normal = Raster::from_fn(64, 48, |x, _| if corner && x >= 32 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, -1.0] });
        LightFrame {
            camera,
            world_from_camera: Rigid3 { rotation: glam::DMat3::IDENTITY, translation: DVec3::ZERO },
            radiance,
            depth_m: Raster::filled(64, 48, 2.0),
            surface: Raster::filled(64, 48, 0),
            albedo,
            normal,
            emitted: Raster::filled(64, 48, [0.0; 3]),
            variance: Raster::filled(64, 48, sigma * sigma),
            rays: RayCounts::default(),
        }
    }

    fn rms(a: &Raster<[f32; 3]>, expected: impl Fn(usize, usize) -> f32) -> f32 {
        let (w, h) = (a.width(), a.height());
        let sum: f32 = (0..w * h).map(|i| (a.pixels()[i][0] - expected(i % w, i / w)).powi(2)).sum();
        (sum / (w * h) as f32).sqrt()
    }

    #[test]
    fn noise_falls_several_times_and_texture_stays() {
        let frame = noisy_wall(0.2, false);
        let truth = |x: usize, y: usize| frame.albedo[(x, y)][0];
        let (before, after) = (rms(&frame.radiance, truth), rms(&denoise(&frame, &DenoiseSettings::default()), truth));
        assert!(after < 0.2 * before, "{before} → {after}");
    }

    #[test]
    fn light_does_not_cross_an_edge_of_geometry() {
        let frame = noisy_wall(0.5, true);
        let truth = |x: usize, y: usize| frame.albedo[(x, y)][0] * if x >= 32 { 3.0 } else { 1.0 };
        let after = denoise(&frame, &DenoiseSettings::default());
        for y in 8..40 {
            for x in [30, 31, 32, 33] {
                assert!((after[(x, y)][0] / truth(x, y) - 1.0).abs() < 0.5, "{x} {y}: {} {}", after[(x, y)][0], truth(x, y));
            }
        }
        assert!(rms(&after, truth) < 0.3 * rms(&frame.radiance, truth));
    }

    #[test]
    fn a_frame_without_noise_is_returned() {
        let mut frame = noisy_wall(0.0, true);
        frame.emitted = Raster::from_fn(64, 48, |x, y| [(x + y) as f32; 3]);
        frame.radiance = Raster::from_fn(64, 48, |x, y| [frame.radiance[(x, y)][0] + (x + y) as f32; 3]);
        let after = denoise(&frame, &DenoiseSettings::default());
        for (a, b) in after.pixels().iter().zip(frame.radiance.pixels()) {
            assert!((a[0] - b[0]).abs() < 1e-4 * (1.0 + b[0]), "{a:?} {b:?}");
        }
    }
}
