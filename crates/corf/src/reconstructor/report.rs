//! Report on a processed keyframe.

use super::expand::Expansion;
use crate::device::StepReport;

/// Changes to the field by one pushed keyframe.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct KeyframeReport {
    /// Index along the trajectory of the pushed keyframe.
    pub index: usize,
    /// Keyframes expanded by this push: 0 while the first ones are collected, several when they are complete, then 1.
    pub keyframes_expanded: usize,
    /// Pixels drawn.
    pub sampled: usize,
    /// Gaussians added.
    pub spawned: usize,
    /// Gaussians that gave way to accurate new samples.
    pub replaced: usize,
    /// Gaussians pruned for opacity or size.
    pub pruned: usize,
    /// Gaussians afterwards.
    pub gaussians: usize,
    /// Share of the added Gaussians whose depth is an accurate match or a triangulated corner.
    pub accurate_share: f64,
    /// Triangulated corners.
    pub triangulated: usize,
    /// Whether the dense prior could be aligned (false also where there is no prior).
    pub prior_aligned: bool,
    /// Optimisation steps run.
    pub steps: usize,
    /// Unweighted optical loss of the last step; 0 where that trained the spectrum alone.
    #[serde(rename = "optical_loss")]
    pub light_loss: f32,
    /// Unweighted RF loss of the last step.
    #[serde(rename = "rf_loss")]
    pub radio_loss: f32,
    /// Unweighted depth loss of the last step, 1/m.
    pub depth_loss: f32,
    /// Whether ground-truth depth was consumed (by the simulated prior).
    pub ground_truth_depth_used: bool,
}

impl KeyframeReport {
    pub(super) fn set_losses(&mut self, last: &StepReport) {
        (self.light_loss, self.radio_loss, self.depth_loss) = (last.light_loss, last.radio_loss, last.depth_loss);
    }

    pub(super) fn set_expansion(&mut self, e: &Expansion) {
        (self.sampled, self.spawned, self.replaced, self.pruned) = (e.sampled, e.spawned, e.replaced, e.pruned);
        (self.triangulated, self.prior_aligned) = (e.triangulated, e.prior_aligned);
        self.accurate_share = if e.spawned > 0 { e.accurate as f64 / e.spawned as f64 } else { 0.0 };
    }

    /// Adds what a later keyframe changed.
    pub(super) fn absorb(&mut self, later: &Self) {
        let spawned = self.spawned + later.spawned;
        let accurate = self.accurate_share * self.spawned as f64 + later.accurate_share * later.spawned as f64;
        *self = Self {
            index: self.index,
            keyframes_expanded: self.keyframes_expanded + later.keyframes_expanded,
            sampled: self.sampled + later.sampled,
            spawned,
            replaced: self.replaced + later.replaced,
            pruned: self.pruned + later.pruned,
            triangulated: self.triangulated + later.triangulated,
            steps: self.steps + later.steps,
            accurate_share: if spawned > 0 { accurate / spawned as f64 } else { 0.0 },
            ..*later
        };
    }
}
