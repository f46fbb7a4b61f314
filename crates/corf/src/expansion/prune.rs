//! Removal of Gaussians: pruning of old ones, and replacement by accurate new samples.

use crate::{
    config::ReconstructionConfig,
    depth::{PixelDepth, Reliability},
    device::{PruneDecision, Shown},
};

/// The Gaussians that give way to new ones: `true` where a Gaussian is the main contributor at `replace_at_samples` accurate samples or more.
pub fn replaced<'a>(
    count: usize,
    samples: impl Iterator<Item = (&'a PixelDepth, &'a Shown)>,
    config: &ReconstructionConfig,
) -> Vec<bool> {
    let mut hits = vec![0usize; count];
    for (_, shown) in samples.filter(|(s, _)| s.reliability != Reliability::Prior) {
        if let Some(h) = hits.get_mut(shown.main_contributor as usize) {
            *h += 1;
        }
    }
    hits.into_iter().map(|h| h >= config.replace_at_samples).collect()
}

/// The Gaussians to prune: old ones that are faint, and those that are oversized.
///
/// `born[i]` is the count of keyframes expanded before Gaussian i's, `now` that before the present one.
pub fn pruned(judged: &[PruneDecision], born: &[u32], now: u32, config: &ReconstructionConfig) -> Vec<bool> {
    let old = |born: u32| now.saturating_sub(born) as usize >= config.prune_age_keyframes;
    judged.iter().zip(born).map(|(j, &born)| j.oversized || j.faint && old(born)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Gaussians,
        device::{Outline, PruneRule, View, judge},
        gaussians::logit,
    };
    use corf_scene::{Pinhole, Rigid3};

    fn shown(inverse_depth: f32, transmittance: f32, main_contributor: u32) -> Shown {
        Shown { structure: 0.0, inverse_depth, transmittance, main_contributor }
    }

    fn sample(x: usize, inverse_depth: f32, reliability: Reliability) -> PixelDepth {
        PixelDepth { x, y: 0, inverse_depth, reliability }
    }

    #[test]
    fn only_accurate_samples_replace_their_main_contributor() {
        let config = ReconstructionConfig { replace_at_samples: 2, ..Default::default() };
        let main = [0, 0, 1, u32::MAX].map(|owner| shown(0.5, 0.0, owner));
        let replaced = |samples: &[PixelDepth]| replaced(2, samples.iter().map(|s| (s, &main[s.x])), &config);
        let accurate = [sample(0, 0.5, Reliability::Accurate), sample(1, 0.5, Reliability::Triangulated)];
        assert_eq!(replaced(&accurate), [true, false]);
        let mixed =
            [sample(0, 0.5, Reliability::Prior), sample(1, 0.5, Reliability::Accurate), sample(3, 0.5, Reliability::Accurate)];
        assert_eq!(replaced(&mixed), [false, false]);
    }

    #[test]
    fn pruning_asks_both_modalities_the_age_and_the_size() {
        let config = ReconstructionConfig::default();
        let mut field = Gaussians::empty(1, 0);
        for (light, radio, sigma_m) in [(0.01, 0.01, 0.1), (0.01, 0.9, 0.1), (0.9, 0.9, 3.0), (0.01, 0.01, 0.1)] {
            field.position.push([0.0, 0.0, 2.0]);
            field.rotation.push([1.0, 0.0, 0.0, 0.0]);
            field.log_scale.push([f32::ln(sigma_m), -3.0, -3.0]);
            field.light.opacity_logit.push(logit(light));
            field.light.sh.extend([0.0; 3]);
            field.radio.opacity_logit.push(logit(radio));
            field.radio.sh.push(0.0);
        }
        let view = View { camera: Pinhole::from_horizontal_fov(64, 48, 90.0), world_from_camera: Rigid3::IDENTITY };
        let judged = |both_modalities: bool| -> Vec<PruneDecision> {
            let rule = PruneRule { opacity: config.prune_opacity, both_modalities, image_fraction: config.prune_image_fraction };
            Outline::of(&field).iter().map(|o| judge(o, &view, &rule)).collect()
        };
        assert_eq!(pruned(&judged(true), &[0, 0, 9, 9], 10, &config), [true, false, true, false]);
        assert_eq!(pruned(&judged(false), &[0, 0, 9, 9], 10, &config), [true, true, true, false]);
    }
}
