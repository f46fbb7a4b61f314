//! Initial parameters of new Gaussians (paper Eqs. (16)–(18)).

use crate::{
    Gaussians,
    config::ReconstructionConfig,
    depth::{PixelDepth, Reliability},
    device::{Planes, View},
    gaussians::{SH_C0, logit},
};
use corf_scene::{Pinhole, Raster};
use glam::DVec3;
use rayon::prelude::*;

/// The expected distance to the nearest neighbour among pixels drawn with probability `p`, `s' = 1/(2√p)` (Eq. (17)), pixels, clamped
/// to `[scale_clamp[0], scale_clamp[1]·width]`: a probability near zero would otherwise give a Gaussian larger than the image.
pub fn pixel_distance(p: f32, width: usize, scale_clamp: [f32; 2]) -> f32 {
    let largest = (scale_clamp[1] * width as f32).max(scale_clamp[0]);
    (0.5 / p.max(1e-12).sqrt()).clamp(scale_clamp[0], largest)
}

/// The value of an image at the continuous position `(u, v)` (pixel centres at +0.5), bilinear; `None` outside the outermost pixels' area.
pub fn bilinear(image: &Planes, u: f64, v: f64) -> Option<Vec<f32>> {
    let (w, h) = (image.width as f64, image.height as f64);
    if !(u >= 0.0 && v >= 0.0 && u < w && v < h) {
        return None;
    }
    let (x, y) = ((u - 0.5).clamp(0.0, w - 1.0), (v - 0.5).clamp(0.0, h - 1.0));
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(image.width - 1), (y0 + 1).min(image.height - 1));
    let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let at = |x: usize, y: usize, c: usize| image.pixels[(y * image.width + x) * image.channels + c];
    let blend = |c: usize| {
        let top = at(x0, y0, c) * (1.0 - fx) + at(x1, y0, c) * fx;
        let bottom = at(x0, y1, c) * (1.0 - fx) + at(x1, y1, c) * fx;
        top * (1.0 - fy) + bottom * fy
    };
    Some((0..image.channels).map(blend).collect())
}

/// The images and cameras new Gaussians are initialised from.
#[derive(Clone, Copy, Debug)]
pub struct SpawnSource<'a> {
    /// Optical view: pose and intrinsics.
    pub view: View,
    /// The optical image, sRGB-encoded `[0, 1]`.
    pub light: &'a Planes,
    /// `P_t` of Eq. (13), from which the scale follows (a constant under uniform sampling).
    pub probability: &'a Raster<f32>,
    /// Intrinsics of the synchronised RF image; the pose is the view's.
    pub radio_camera: Pinhole,
    /// The RF image.
    pub radio: &'a Planes,
    /// The RF colour of directions the RF image does not see.
    pub radio_floor: [f32; 3],
}

/// New Gaussians at the given pixels and depths: back-projected means (Eq. (16)), isotropic scale `z·s'/f` (Eq. (18)), identity rotation,
/// both opacities by reliability, optical colour of the pixel, RF colour of the RF image in the same direction.
pub fn spawn(source: &SpawnSource<'_>, samples: &[PixelDepth], config: &ReconstructionConfig) -> Gaussians {
    /// Samples per unit of parallel work.
    const CHUNK: usize = 1024;
    let parts: Vec<Gaussians> = samples.par_chunks(CHUNK).map(|some| spawn_some(source, some, config)).collect();
    let mut new = config.empty_field();
    for part in parts {
        new.position.extend(part.position);
        new.rotation.extend(part.rotation);
        new.log_scale.extend(part.log_scale);
        for (all, part) in [(&mut new.light, part.light), (&mut new.radio, part.radio)] {
            all.opacity_logit.extend(part.opacity_logit);
            all.sh.extend(part.sh);
        }
    }
    new
}

fn spawn_some(source: &SpawnSource<'_>, samples: &[PixelDepth], config: &ReconstructionConfig) -> Gaussians {
    let mut new = config.empty_field();
    let camera = &source.view.camera;
    let focal_px = (camera.fx * camera.fy).sqrt();
    for s in samples {
        let z = 1.0 / f64::from(s.inverse_depth);
        let ray = camera.unproject(s.x as f64 + 0.5, s.y as f64 + 0.5);
        // Eq. (16): μ = Π⁻¹(u, z, P_t).
        let mean = source.view.world_from_camera.transform_point(ray * z);
        new.position.push(mean.as_vec3().to_array());
        new.rotation.push([1.0, 0.0, 0.0, 0.0]);
        // Eqs. (17), (18): s = z s' / f.
        let distance_px = pixel_distance(source.probability[(s.x, s.y)], camera.width, config.scale_clamp);
        new.log_scale.push([(z * f64::from(distance_px) / focal_px).ln() as f32; 3]);
        let opacity = match s.reliability {
            Reliability::Accurate => config.initial_opacity[0],
            Reliability::Prior => config.initial_opacity[1],
            Reliability::Triangulated => config.initial_opacity[2],
        };
        let pixel = (s.y * source.light.width + s.x) * 3;
        push_appearance(&mut new.light, opacity, &source.light.pixels[pixel..pixel + 3]);
        let radio = radio_color(source, ray);
        push_appearance(&mut new.radio, opacity, &radio);
    }
    new
}

/// The RF image's colour along a camera-frame ray, the floor where the RF image does not reach.
fn radio_color(source: &SpawnSource<'_>, ray: DVec3) -> Vec<f32> {
    source
        .radio_camera
        .project(ray)
        .and_then(|p| bilinear(source.radio, p.x, p.y))
        .unwrap_or_else(|| source.radio_floor[..source.radio.channels].to_vec())
}

/// One Gaussian whose colour is the same from every side.
fn push_appearance(appearance: &mut crate::Appearance, opacity: f32, color: &[f32]) {
    appearance.opacity_logit.push(logit(opacity));
    appearance.sh.extend(color.iter().map(|c| (c - 0.5) / SH_C0));
    appearance.sh.extend(std::iter::repeat_n(0.0, (appearance.coefficients() - 1) * appearance.channels));
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rigid3;

    #[test]
    fn the_pixel_distance_is_the_papers_and_clamped() {
        assert_eq!(pixel_distance(0.25, 200, [0.5, 0.1]), 1.0);
        assert_eq!(pixel_distance(1.0, 200, [0.5, 0.1]), 0.5);
        assert_eq!(pixel_distance(0.0, 200, [0.5, 0.1]), 20.0);
    }

    #[test]
    fn a_new_gaussian_reprojects_to_its_pixel_and_looks_like_it_in_both_modalities() {
        let camera = Pinhole::from_horizontal_fov(64, 48, 90.0);
        // The RF image is narrower: its left and right thirds are outside.
        let radio_camera = Pinhole::from_horizontal_fov(30, 24, 40.0);
        let pose = Rigid3::looking_at(DVec3::new(1.0, 2.0, 1.5), DVec3::new(4.0, 3.0, 1.0), DVec3::Z);
        let light =
            Planes { width: 64, height: 48, channels: 3, pixels: (0..64 * 48 * 3).map(|i| (i % 97) as f32 / 97.0).collect() };
        // Linear in u, so bilinear interpolation is exact.
        let radio = Planes { width: 30, height: 24, channels: 1, pixels: (0..30 * 24).map(|i| (i % 30) as f32 / 30.0).collect() };
        let probability = Raster::filled(64, 48, 0.25);
        let config = ReconstructionConfig { radio_target: crate::RadioTarget::Db, ..Default::default() };
        let source = SpawnSource {
            view: View { camera, world_from_camera: pose },
            light: &light,
            probability: &probability,
            radio_camera,
            radio: &radio,
            radio_floor: [0.0; 3],
        };
        let samples: Vec<PixelDepth> = [(3, 5, 0.5), (31, 20, 0.2), (36, 28, 0.1)]
            .iter()
            .map(|&(x, y, inverse_depth)| PixelDepth { x, y, inverse_depth, reliability: Reliability::Accurate })
            .collect();
        let new = spawn(&source, &samples, &config);
        assert_eq!((new.len(), new.radio.sh.len()), (3, 3 * 16));
        for (i, s) in samples.iter().enumerate() {
            let p = pose.inverse().transform_point(glam::Vec3::from(new.position[i]).as_dvec3());
            let u = camera.project(p).unwrap();
            // Positions are f32 metres: 1e-4 px is 1e-5 m here.
            assert!((u.x - s.x as f64 - 0.5).abs() < 1e-4 && (u.y - s.y as f64 - 0.5).abs() < 1e-4);
            let scale = f64::from(new.log_scale[i][0]).exp();
            assert!((scale * camera.fx / p.z - 1.0).abs() < 1e-5, "one pixel at P = 1/4");
            let red = 0.5 + SH_C0 * new.light.sh[i * new.light.stride()];
            assert!((red - light.pixels[(s.y * 64 + s.x) * 3]).abs() < 1e-6);
            let radio_value = 0.5 + SH_C0 * new.radio.sh[i * 16];
            let position = radio_camera.project(camera.unproject(s.x as f64 + 0.5, s.y as f64 + 0.5)).unwrap();
            let expected = if position.x < 0.0 { 0.0 } else { (position.x - 0.5) as f32 / 30.0 };
            assert!((radio_value - expected).abs() < 1e-5, "{radio_value} {expected}");
        }
    }
}
