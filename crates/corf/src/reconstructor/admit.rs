//! Admission of keyframes to a sequence: checks of order, and of the keyframe itself.

use super::Reconstructor;
use crate::{Error, Result};
use corf_scene::Keyframe;

impl Reconstructor {
    /// Checks a keyframe and counts it as the latest of the sequence.
    pub(super) fn admit(&mut self, keyframe: &Keyframe) -> Result<()> {
        self.check(keyframe)?;
        if let Some((_, last)) = self.last_pose
            && self.baselines_m.len() < self.config.scale_baselines
        {
            self.baselines_m.push((keyframe.world_from_camera.translation - last.translation).length());
        }
        self.modalities = Some(keyframe.modalities());
        self.last_pose = Some((keyframe.index, keyframe.world_from_camera));
        self.keyframes_received += 1;
        Ok(())
    }

    /// Refuses a keyframe that does not belong to the sequence.
    fn check(&self, keyframe: &Keyframe) -> Result<()> {
        let place = || format!("keyframe {}", keyframe.index);
        if self.finished {
            return Err(Error::invalid(place(), "the sequence has ended", "push every keyframe before Reconstructor::finish"));
        }
        crate::keyframe::check(keyframe, &self.meta)?;
        let has = keyframe.modalities();
        if self.modalities.is_some_and(|before| before != has) {
            let what = "it has an image or a spectrum that those before it lack, or lacks one that they have";
            return Err(Error::invalid(place(), what, "keyframes of a sequence all have light, or none has, and so with radio"));
        }
        if !has.radio && self.config.radio_weight > 0.0 {
            let what = format!("it has no spectrum, and rf_weight is {}", self.config.radio_weight);
            return Err(Error::invalid(place(), what, "reconstruct light alone with rf_weight = 0"));
        }
        if let Some((last, _)) = self.last_pose.filter(|l| l.0 >= keyframe.index) {
            let what = format!("it arrived after keyframe {last}");
            return Err(Error::invalid(place(), what, "push keyframes once each, in trajectory order"));
        }
        self.ahead.preparer().check(keyframe)
    }
}
