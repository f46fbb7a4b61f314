//! What an observation of a radio field costs at least: operations and bytes, to hold measured times against.

use super::{ArrayField, SensorSettings, lobes::REACH};
use corf_scene::Rigid3;

/// Operations, and bytes between memory and processor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Floating-point operations.
    pub operations: f64,
    /// Bytes that are read or written.
    pub bytes: f64,
}

/// Operations of a pixel of a lobe: chord and exponential.
const OF_A_LOBES_PIXEL: f64 = 28.0;

impl ArrayField {
    /// The least work of an observation at a pose. An array costs two operations an entry of its table for each wave and each pixel, Capon's
    /// beamformer the inverse of a real matrix on top, and a lobe its pixels; an emitter is read with its gain and the corrections of the anchors
    /// that are near, a pixel's direction is read and its power written.
    pub fn work_of(&self, pose: &Rigid3) -> Work {
        let receiver = self.receiver::<f64>(pose);
        let seen = [&self.sources, &self.points].map(|cloud| cloud.waves(&receiver, 0.0).len() as f64);
        let waves = seen[0] + seen[1];
        let emitters = (self.sources.len() + self.points.len()) as f64;
        let pixels = (self.camera.width * self.camera.height) as f64;
        let operations = match self.sensor {
            SensorSettings::Beam { elements: [columns, rows], .. } => 8.0 * (columns * rows) as f64 * (waves + pixels),
            SensorSettings::Capon { elements: [columns, rows], .. } => {
                let n = (columns * rows) as f64;
                8.0 * n * (waves + pixels) + 2.0 * n.powi(3)
            }
            SensorSettings::Lobes { width_deg } => {
                let radius = [self.camera.fx, self.camera.fy].map(|f| REACH * width_deg.to_radians() * f);
                OF_A_LOBES_PIXEL * waves * (std::f64::consts::PI * radius[0] * radius[1]).min(pixels)
            }
        };
        let bytes = emitters * (20.0 + 4.0 * receiver.weights().len() as f64) + 12.0 * pixels;
        Work { operations, bytes }
    }
}
