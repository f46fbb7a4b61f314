//! A radio field of emitters that is rendered as the sensor of a data set would observe it.

use super::anchors::Anchors;
use super::cloud::{Cloud, Receiver};
use super::sensor::{ArraySensor, SensorSettings};
use super::wave::Wave;
use crate::files::tensors::{self, Kind, Tensors};
use crate::{Real, Result};
use corf_scene::config::AntennaPattern;
use corf_scene::{Pinhole, Raster, Rigid3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Virtual sources and points on surfaces, and who sees them from where.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrayField {
    /// The sensor.
    pub sensor: SensorSettings,
    /// Pattern of the sensor's elements.
    pub pattern: AntennaPattern,
    /// Pixels of an observation.
    pub camera: Pinhole,
    /// Whether emitters outside the frame count.
    pub half_space: bool,
    /// Whether emitters add to a picture of the surfaces that is made elsewhere, instead of being all there is.
    pub over_splats: bool,
    /// Greatest power of a wave, linear, where it is known. Away from the places that an emitter has been seen from, nothing else bounds it.
    pub most_power: Option<f64>,
    /// Standard deviation of a surface point's extent per axis, metres.
    pub extent_m: f64,
    /// Places of the receiver between which visibility is interpolated.
    pub anchors: Anchors,
    /// Points anywhere, also behind walls.
    pub sources: Cloud<f32>,
    /// Points on surfaces.
    pub points: Cloud<f32>,
}

impl ArrayField {
    /// The receiver of a pose.
    pub(super) fn receiver<T: Real>(&self, world_from_camera: &Rigid3) -> Receiver<T> {
        let weights = self.anchors.weights(world_from_camera.translation);
        let most = self.most_power.unwrap_or(f64::INFINITY);
        let receiver =
            Receiver::new(world_from_camera, &weights, self.sensor.is_gated()).of_power_up_to(most).of_elements(self.pattern);
        if self.half_space { receiver } else { receiver.within(&self.camera) }
    }

    /// The observation at a pose, linear, in double precision.
    pub fn observe(&self, sensor: &ArraySensor<f64>, world_from_camera: &Rigid3) -> Raster<f32> {
        let receiver = self.receiver::<f64>(world_from_camera);
        let mut waves: Vec<Wave<f64>> = vec![];
        for (cloud, extent_m) in [(&self.sources, 0.0), (&self.points, self.extent_m)] {
            waves.extend(cloud.waves(&receiver, extent_m * extent_m).into_iter().map(|w| w.1));
        }
        let pixels = sensor.observe(&waves).into_iter().map(|p| p.max(0.0) as f32).collect();
        Raster::from_vec(self.camera.width, self.camera.height, pixels)
    }
}

/// Header of a field on disk: all but the numbers of emitters.
#[derive(Serialize, Deserialize)]
struct Header {
    sensor: SensorSettings,
    #[serde(default, skip_serializing_if = "is_isotropic")]
    pattern: AntennaPattern,
    camera: Pinhole,
    half_space: bool,
    #[serde(default)]
    over_splats: bool,
    most_power: Option<f64>,
    extent_m: f64,
    anchors: Anchors,
    sources: usize,
    points: usize,
}

/// Fields of isotropic elements are written as ever.
fn is_isotropic(pattern: &AntennaPattern) -> bool {
    *pattern == AntennaPattern::Iso
}

const KIND: Kind =
    Kind { name: "radio field", format: "corf-array/2", help: "make it again with the command that made it", finite: true };

impl ArrayField {
    /// Writes it whole or not at all.
    ///
    /// # Errors
    /// Numbers that are not finite, a file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let header = Header {
            sensor: self.sensor,
            pattern: self.pattern,
            camera: self.camera,
            half_space: self.half_space,
            over_splats: self.over_splats,
            most_power: self.most_power,
            extent_m: self.extent_m,
            anchors: self.anchors.clone(),
            sources: self.sources.len(),
            points: self.points.len(),
        };
        let clouds = [self.sources.tensors("sources"), self.points.tensors("points")];
        tensors::write(path, &KIND, &header, clouds.into_iter().flatten().collect())
    }

    /// Reads what [`Self::write`] wrote.
    ///
    /// # Errors
    /// A file that is missing, damaged or of another version.
    pub fn read(path: &Path) -> Result<Self> {
        let (file, header) = Tensors::read_kind::<Header>(path, &KIND)?;
        header.sensor.check(&header.camera)?;
        let Header { sensor, pattern, camera, half_space, over_splats, most_power, extent_m, anchors, sources, points } = header;
        let read = |of, count| Cloud::read(&file, of, count, anchors.positions_m.len());
        let (sources, points) = (read("sources", sources)?, read("points", points)?);
        Ok(Self { sensor, pattern, camera, half_space, over_splats, most_power, extent_m, anchors, sources, points })
    }
}
