//! Sensors of a platform, a camera and an antenna array: the one place where a pose becomes a keyframe.

mod light;
mod radio;

pub use light::{Denoise, LightDevice, LightSensor};
pub use radio::{
    Extent, Outputs, RadioFrame, RadioSensor, Received, SensorPlan, diffuse_settings, element_at, geometry_warnings, noncoherent,
    open_edges_note, radio_settings, sensor_settings,
};

use corf_scene::dataset::{Extras, KeyframeContent};
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Light, Radio, Result};

/// A camera and an array that travel together.
pub struct Platform<'p, 'a> {
    /// The camera, which may be seeing other poses meanwhile.
    pub camera: &'p LightSensor<'a>,
    /// The array.
    pub array: RadioSensor<'a>,
    /// Radio outputs of every pose.
    pub outputs: Outputs,
}

impl Platform<'_, '_> {
    /// Everything that a dataset keeps of a pose. Light and radio are traced side by side: where one of them leaves a core idle, the other goes on.
    ///
    /// # Errors
    /// A receiver at the transmitter; light that is not a finite number.
    pub fn keyframe(&self, pose: &TrajectoryPose) -> Result<KeyframeContent> {
        let (light, radio) = rayon::join(|| self.camera.see(pose), || self.hear(pose));
        Ok(joined(light?, radio?))
    }

    /// What the array hears at a pose.
    ///
    /// # Errors
    /// A receiver at the transmitter.
    pub fn hear(&self, pose: &TrajectoryPose) -> Result<RadioFrame> {
        self.array.keyframe(&pose.world_from_camera, &self.outputs)
    }
}

/// Everything that a dataset keeps of a pose, of what was seen and heard there.
pub fn joined((light, floats): (Light, Extras), radio: RadioFrame) -> KeyframeContent {
    let KeyframeContent { radio, extras, .. } = heard(radio);
    let Extras { sphere, share_in_frame, paths_jsonl, .. } = extras;
    KeyframeContent { light: Some(light), radio, extras: Extras { sphere, share_in_frame, paths_jsonl, ..floats } }
}

/// What a dataset keeps of what was heard at a pose, where it has its light from another one.
pub fn heard(radio: RadioFrame) -> KeyframeContent {
    let RadioFrame { spectrum, sphere, share_in_frame, paths_jsonl } = radio;
    let extras = Extras { sphere, share_in_frame: Some(share_in_frame), paths_jsonl, ..Extras::default() };
    KeyframeContent { light: None, radio: Some(Radio { spectrum }), extras }
}
