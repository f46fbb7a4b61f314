//! Which samples are dropped and which Gaussians make room.

use crate::{
    config::ReconstructionConfig,
    depth::{PixelDepth, Reliability},
    device::{Layer, Outline, View},
    gaussians::sigmoid,
};
use corf_scene::Raster;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Whether a sample lies in front of (or on) what is rendered already. The rendered inverse depth `Σ α T / z` is divided by the coverage
/// `1 − T_N` first; where the coverage is below `behind_coverage` nothing is known and the sample stays.
pub fn is_not_behind(sample: &PixelDepth, rendered: &Layer, config: &ReconstructionConfig) -> bool {
    let at = (sample.x, sample.y);
    let coverage = 1.0 - rendered.transmittance[at];
    if coverage < config.behind_coverage {
        return true;
    }
    let rendered_inverse_depth = rendered.inverse_depth[at] / coverage;
    sample.inverse_depth * (1.0 + config.behind_tolerance) >= rendered_inverse_depth
}

/// The Gaussians that give way to new ones: `true` where a Gaussian is the main contributor at `replace_at_samples` accurate samples or more.
pub fn replaced(
    count: usize,
    main_contributor: &Raster<u32>,
    samples: &[PixelDepth],
    config: &ReconstructionConfig,
) -> Vec<bool> {
    let mut hits = vec![0usize; count];
    for s in samples.iter().filter(|s| s.reliability != Reliability::Prior) {
        if let Some(h) = hits.get_mut(main_contributor[(s.x, s.y)] as usize) {
            *h += 1;
        }
    }
    hits.into_iter().map(|h| h >= config.replace_at_samples).collect()
}

/// The Gaussians to prune: old ones whose opacity (the maximum over the modalities in use) is at most `prune_opacity`, and those in front of
/// the view whose largest standard deviation is more than `prune_image_fraction` of the image there.
///
/// `born[i]` is the count of keyframes expanded before Gaussian i's, `now` that before the present one.
pub fn pruned(
    field: &[Outline],
    born: &[u32],
    now: u32,
    both_modalities: bool,
    view: &View,
    config: &ReconstructionConfig,
) -> Vec<bool> {
    let camera_from_world = view.world_from_camera.inverse();
    let extent_px = view.camera.width.max(view.camera.height) as f64;
    let focal_px = (view.camera.fx * view.camera.fy).sqrt();
    field
        .par_iter()
        .zip(born)
        .map(|(gaussian, &born)| {
            let [optical, rf] = gaussian.opacity_logit.map(sigmoid);
            let opacity = if both_modalities { optical.max(rf) } else { optical };
            let old = now.saturating_sub(born) as usize >= config.prune_age_keyframes;
            if old && opacity <= config.prune_opacity {
                return true;
            }
            let p: DVec3 = camera_from_world.transform_point(Vec3::from(gaussian.position).as_dvec3());
            let in_frame = view
                .camera
                .project(p)
                .is_some_and(|u| u.x >= 0.0 && u.y >= 0.0 && u.x < view.camera.width as f64 && u.y < view.camera.height as f64);
            let sigma_m = f64::from(gaussian.largest_log_scale).exp();
            in_frame && sigma_m * focal_px / p.z.max(1e-3) > f64::from(config.prune_image_fraction) * extent_px
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Gaussians, device::Planes, gaussians::logit};
    use corf_scene::{Pinhole, Rigid3};

    fn sample(x: usize, inverse_depth: f32, reliability: Reliability) -> PixelDepth {
        PixelDepth { x, y: 0, inverse_depth, reliability }
    }

    #[test]
    fn samples_behind_an_opaque_surface_are_dropped_and_those_behind_a_thin_one_stay() {
        let config = ReconstructionConfig::default();
        let layer = |coverage: f32| Layer {
            color: Planes { width: 1, height: 1, channels: 3, pixels: vec![0.0; 3] },
            inverse_depth: Raster::filled(1, 1, 0.5 * coverage),
            transmittance: Raster::filled(1, 1, 1.0 - coverage),
        };
        // The surface is at 2 m in both; only its coverage differs.
        assert!(!is_not_behind(&sample(0, 0.25, Reliability::Prior), &layer(0.95), &config));
        assert!(is_not_behind(&sample(0, 0.25, Reliability::Prior), &layer(0.5), &config));
        assert!(is_not_behind(&sample(0, 0.48, Reliability::Prior), &layer(0.95), &config));
    }

    #[test]
    fn only_accurate_samples_replace_their_main_contributor() {
        let config = ReconstructionConfig { replace_at_samples: 2, ..Default::default() };
        let main = Raster::from_vec(4, 1, vec![0, 0, 1, u32::MAX]);
        let accurate = [sample(0, 0.5, Reliability::Accurate), sample(1, 0.5, Reliability::Triangulated)];
        assert_eq!(replaced(2, &main, &accurate, &config), [true, false]);
        let mixed =
            [sample(0, 0.5, Reliability::Prior), sample(1, 0.5, Reliability::Accurate), sample(3, 0.5, Reliability::Accurate)];
        assert_eq!(replaced(2, &main, &mixed, &config), [false, false]);
    }

    #[test]
    fn pruning_asks_both_modalities_the_age_and_the_size() {
        let config = ReconstructionConfig::default();
        let mut field = Gaussians::empty(1, 0);
        for (optical, rf, sigma_m) in [(0.01, 0.01, 0.1), (0.01, 0.9, 0.1), (0.9, 0.9, 3.0), (0.01, 0.01, 0.1)] {
            field.position.push([0.0, 0.0, 2.0]);
            field.rotation.push([1.0, 0.0, 0.0, 0.0]);
            field.log_scale.push([f32::ln(sigma_m), -3.0, -3.0]);
            field.optical.opacity_logit.push(logit(optical));
            field.optical.sh.extend([0.0; 3]);
            field.rf.opacity_logit.push(logit(rf));
            field.rf.sh.push(0.0);
        }
        let view = View { camera: Pinhole::from_horizontal_fov(64, 48, 90.0), world_from_camera: Rigid3::IDENTITY };
        let field = Outline::of(&field);
        assert_eq!(pruned(&field, &[0, 0, 9, 9], 10, true, &view, &config), [true, false, true, false]);
        assert_eq!(pruned(&field, &[0, 0, 9, 9], 10, false, &view, &config), [true, true, true, false]);
    }
}
