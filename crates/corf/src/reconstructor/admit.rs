//! Admission of keyframes to a sequence: checks of order, image sizes and poses.

use super::Reconstructor;
use crate::{Error, Result};
use corf_scene::{Keyframe, Pinhole};

impl Reconstructor {
    /// Checks a keyframe and counts it as the latest of the sequence.
    pub(super) fn admit(&mut self, keyframe: &Keyframe) -> Result<()> {
        self.check(keyframe)?;
        if let Some((_, last)) = self.last_pose
            && self.baselines_m.len() < self.config.scale_baselines
        {
            self.baselines_m.push((keyframe.world_from_camera.translation - last.translation).length());
        }
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
        check_size(&place(), "optical image", (keyframe.image.width(), keyframe.image.height()), &self.meta.optical_camera)?;
        check_size(&place(), "spectrum", (keyframe.spectrum.width(), keyframe.spectrum.height()), &self.meta.rf_camera)?;
        if let Some(depth) = &keyframe.depth_m {
            check_size(&place(), "depth", (depth.width(), depth.height()), &self.meta.optical_camera)?;
        }
        if let Some(surface) = &keyframe.surface {
            check_size(&place(), "surface index", (surface.width(), surface.height()), &self.meta.optical_camera)?;
        }
        let pose = &keyframe.world_from_camera;
        if !pose.translation.is_finite() || !pose.rotation.is_finite() {
            return Err(Error::invalid(place(), "the pose is not finite", "remove or repair this keyframe"));
        }
        if let Some(i) = keyframe.spectrum.pixels().iter().position(|s| !s.is_finite() || *s < 0.0) {
            let (w, value) = (keyframe.spectrum.width(), keyframe.spectrum.pixels()[i]);
            let what = format!("the spectrum is {value} at row {}, column {}", i / w, i % w);
            return Err(Error::invalid(place(), what, "linear power per steradian is finite and not negative"));
        }
        if let Some((last, _)) = self.last_pose.filter(|l| l.0 >= keyframe.index) {
            let what = format!("it arrived after keyframe {last}");
            return Err(Error::invalid(place(), what, "push keyframes once each, in trajectory order"));
        }
        self.ahead.preparer().check(keyframe)
    }
}

fn check_size(place: &str, what: &str, got: (usize, usize), camera: &Pinhole) -> Result<()> {
    if got == (camera.width, camera.height) {
        return Ok(());
    }
    Err(Error::invalid(
        place,
        format!("the {what} is {}x{} and the camera says {}x{}", got.0, got.1, camera.width, camera.height),
        "all keyframes of a sequence share the cameras it was opened with",
    ))
}
