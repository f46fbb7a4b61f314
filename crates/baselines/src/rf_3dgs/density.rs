//! Adaptive density control of stock 3D Gaussian splatting (Kerbl et al. 2023, Section 5): Gaussians that the loss pulls about on the screen are
//! cloned where they are small and split where they are large; faint and oversized ones are pruned; opacities are reset now and then.
//!
//! All of it is decided here from what a device reports; docs/design/016-density-control.md says where published programs differ.

use crate::stage;
use corf::{
    Error, Result,
    device::{Duplicate, Modality, Outline, ScreenGradient},
    gaussians::sigmoid,
};
use corf_scene::Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of adaptive density control; the published values are the defaults.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DensityConfig {
    /// Gaussians are first cloned, split and pruned after more steps than this (500).
    pub from: usize,
    /// They no longer are from this step on (15 000).
    pub until: usize,
    /// They are after every so many steps (100).
    pub every: usize,
    /// Mean norm of the positional gradient on the screen, in device coordinates, from which a Gaussian is cloned or split (2e-4).
    pub gradient: f32,
    /// Largest standard deviation of a Gaussian that is cloned rather than split, as a fraction of the scene's extent (0.01).
    pub clone_fraction: f32,
    /// Gaussians that replace one that is split (2).
    pub split_into: usize,
    /// Divisor of a split Gaussian's standard deviations (1.6).
    pub split_shrink: f32,
    /// Opacity below which a Gaussian is pruned (0.005).
    pub prune_opacity: f32,
    /// Standard deviation above which a Gaussian is pruned once opacities have been reset, as a fraction of the scene's extent (0.1).
    pub prune_fraction: f32,
    /// Opacities are reset after every so many steps (3000).
    pub reset_every: usize,
    /// Largest opacity after a reset (0.01).
    pub reset_opacity: f32,
}

impl Default for DensityConfig {
    fn default() -> Self {
        Self {
            from: 500,
            until: 15_000,
            every: 100,
            gradient: 2e-4,
            clone_fraction: 0.01,
            split_into: 2,
            split_shrink: 1.6,
            prune_opacity: 0.005,
            prune_fraction: 0.1,
            reset_every: 3000,
            reset_opacity: 0.01,
        }
    }
}

impl DensityConfig {
    /// # Errors
    /// [`Error::Invalid`] naming the key.
    pub fn validate(&self) -> Result<()> {
        let positive = |x: f32| (1e-12..=1e6).contains(&x);
        let probability = |x: f32| x > 0.0 && x < 1.0;
        let checks = [
            ("every", self.every > 0, "at least 1 (100)"),
            ("gradient", positive(self.gradient), "positive (2e-4)"),
            ("clone_fraction", positive(self.clone_fraction), "positive (0.01)"),
            ("split_into", (1..=16).contains(&self.split_into), "1 to 16 (2)"),
            ("split_shrink", (1.0..=100.0).contains(&self.split_shrink), "1 to 100 (1.6)"),
            ("prune_opacity", probability(self.prune_opacity), "strictly between 0 and 1 (0.005)"),
            ("prune_fraction", positive(self.prune_fraction), "positive (0.1)"),
            ("reset_every", self.reset_every > 0, "at least 1 (3000)"),
            ("reset_opacity", probability(self.reset_opacity), "strictly between 0 and 1 (0.01)"),
        ];
        match checks.iter().find(|c| !c.1) {
            None => Ok(()),
            Some((key, _, range)) => {
                let place = format!("offline reconstruction config, key `density.{key}`");
                Err(Error::invalid(place, "the value is out of range", format!("give {range}")))
            }
        }
    }

    /// Whether step `step` (from 1) adds to the positional gradients on the screen.
    pub fn watches(&self, step: usize) -> bool {
        step < self.until
    }

    /// Whether Gaussians are cloned, split and pruned after a step.
    pub fn is_due(&self, step: usize) -> bool {
        self.watches(step) && step > self.from && step.is_multiple_of(self.every)
    }

    /// Whether opacities are reset after a step.
    pub fn resets(&self, step: usize) -> bool {
        self.watches(step) && step.is_multiple_of(self.reset_every)
    }

    /// Steps from `step` on up to and with the next one after which anything of this may be due.
    pub fn steps_to_event(&self, step: usize) -> usize {
        let to = |every: usize| every - step % every;
        to(self.every).min(to(self.reset_every))
    }
}

/// Changes to a field: copies to be made first, then the Gaussians held before to be kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DensityChange {
    /// Copies: clones and parts.
    pub copies: Vec<Duplicate>,
    /// One flag per Gaussian held before.
    pub keep: Vec<bool>,
    /// Number of Gaussians that were cloned, split and pruned.
    pub counts: DensityCounts,
}

/// Numbers of Gaussians that density control has cloned, split and pruned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DensityCounts {
    /// Copied in place.
    pub cloned: usize,
    /// Replaced by parts.
    pub split: usize,
    /// Removed for faintness or size.
    pub pruned: usize,
}

/// Decides on every Gaussian after step `step` of a scene of this extent, by its opacity in the modality that is trained. Copies are judged as their
/// sources are, and none is made that would be pruned at once.
pub fn decide(
    config: &DensityConfig,
    gradients: &[ScreenGradient],
    outlines: &[Outline],
    modality: Modality,
    extent_m: f32,
    step: usize,
    seed: u64,
) -> DensityChange {
    let mut change = DensityChange { keep: Vec::with_capacity(outlines.len()), ..DensityChange::default() };
    let bounded = step > config.reset_every;
    let stays = |outline: &Outline, deviation_m: f32| {
        sigmoid(outline.opacity_logit[modality.index()]) >= config.prune_opacity
            && !(bounded && deviation_m > config.prune_fraction * extent_m)
    };
    for (i, (gradient, outline)) in gradients.iter().zip(outlines).enumerate() {
        let deviation_m = outline.largest_log_scale.exp();
        let pulled = gradient.mean() >= config.gradient;
        let is_large = deviation_m > config.clone_fraction * extent_m;
        let source = i as u32;
        if pulled && is_large {
            change.keep.push(false);
            change.counts.split += 1;
            if stays(outline, deviation_m / config.split_shrink) {
                let mut rng = Rng::keyed(seed, stage::keyed(stage::SPLITS, step), i as u64);
                change.copies.extend((0..config.split_into).map(|_| Duplicate {
                    source,
                    offset: [0; 3].map(|_| rng.normal() as f32),
                    shrink: config.split_shrink,
                }));
            } else {
                change.counts.pruned += config.split_into;
            }
            continue;
        }
        let stays = stays(outline, deviation_m);
        change.keep.push(stays);
        change.counts.pruned += usize::from(!stays);
        if pulled && stays {
            change.copies.push(Duplicate { source, offset: [0.0; 3], shrink: 1.0 });
            change.counts.cloned += 1;
        }
    }
    change
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf::gaussians::logit;

    const EXTENT_M: f32 = 10.0;

    fn outline(deviation_m: f32, opacity: f32) -> Outline {
        Outline { position: [0.0; 3], largest_log_scale: deviation_m.ln(), opacity_logit: [logit(opacity), logit(0.9)] }
    }

    #[test]
    fn small_ones_are_cloned_large_ones_split_and_faint_or_huge_ones_pruned() {
        let config = DensityConfig::default();
        let pulled = ScreenGradient { norm_sum: 9e-4, steps: 3 };
        let calm = ScreenGradient { norm_sum: 5.9e-4, steps: 3 };
        let cases = [
            (pulled, outline(0.05, 0.5)),                    // cloned
            (pulled, outline(0.2, 0.5)),                     // split: more than 1 % of the extent
            (calm, outline(0.05, 0.5)),                      // left alone
            (calm, outline(0.2, 0.5)),                       // left alone
            (calm, outline(0.05, 0.004)),                    // faint
            (pulled, outline(0.05, 0.004)),                  // cloned copies would be faint too
            (calm, outline(1.2, 0.5)),                       // huge: pruned once opacities have been reset
            (pulled, outline(1.2, 0.5)),                     // its parts are 0.75 m: they stay
            (pulled, outline(2.0, 0.5)),                     // its parts are huge as well
            (ScreenGradient::default(), outline(0.05, 0.5)), // never seen
        ];
        let (gradients, outlines): (Vec<_>, Vec<_>) = cases.into_iter().unzip();
        let late = decide(&config, &gradients, &outlines, Modality::Light, EXTENT_M, 3100, 1);
        assert_eq!(late.keep, [true, false, true, true, false, false, false, false, false, true]);
        let sources: Vec<u32> = late.copies.iter().map(|c| c.source).collect();
        assert_eq!(sources, [0, 1, 1, 7, 7]);
        assert_eq!(late.counts, DensityCounts { cloned: 1, split: 3, pruned: 5 });
        assert_eq!((late.copies[0].offset, late.copies[0].shrink), ([0.0; 3], 1.0));
        assert!(late.copies[1..].iter().all(|c| c.shrink == 1.6 && c.offset.iter().all(|o| *o != 0.0)));
        assert_ne!(late.copies[1].offset, late.copies[2].offset);
        let early = decide(&config, &gradients, &outlines, Modality::Light, EXTENT_M, 600, 1);
        assert_eq!(early.keep, [true, false, true, true, false, false, true, false, false, true]);
        assert_eq!(early.copies.len(), 7, "nothing is too large before the first reset");
        assert_ne!(early.copies[1].offset, late.copies[1].offset, "each time its own");
        assert_eq!(decide(&config, &gradients, &outlines, Modality::Light, EXTENT_M, 600, 1), early);
    }

    #[test]
    fn offsets_of_parts_are_standard_normal() {
        let n = 4000;
        let gradients = vec![ScreenGradient { norm_sum: 1.0, steps: 1 }; n];
        let change =
            decide(&DensityConfig::default(), &gradients, &vec![outline(0.3, 0.5); n], Modality::Light, EXTENT_M, 600, 3);
        let all: Vec<f64> = change.copies.iter().flat_map(|c| c.offset).map(f64::from).collect();
        assert_eq!(all.len(), 6 * n);
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let variance = all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64;
        // Five standard errors of 24 000 draws: 0.032, and 0.046 of the variance.
        assert!(mean.abs() < 0.033 && (variance - 1.0).abs() < 0.047, "{mean} {variance}");
    }

    #[test]
    fn what_is_due_after_which_step_is_as_published() {
        let config = DensityConfig::default();
        let due: Vec<usize> = (1..40_000).filter(|s| config.is_due(*s)).collect();
        assert_eq!((due[0], due[due.len() - 1], due.len()), (600, 14_900, 144));
        let resets: Vec<usize> = (1..40_000).filter(|s| config.resets(*s)).collect();
        assert_eq!(resets, [3000, 6000, 9000, 12_000]);
        assert!(config.watches(1) && config.watches(14_999) && !config.watches(15_000));
        for step in [0, 1, 99, 100, 2999, 3000, 14_950] {
            let next = step + config.steps_to_event(step);
            assert!(!(step + 1..next).any(|s| config.is_due(s) || config.resets(s)) && next > step && next <= step + 100);
        }
    }
}
