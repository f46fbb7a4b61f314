//! The frame of a capture: which way is up, and how long its unit of length is.

use super::Shot;
use super::options::Up;
use crate::{Error, Result, Rigid3, Similarity3, bounds};
use glam::DVec3;

/// The change from a capture's frame to a world that is z-up and in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WorldFromCapture {
    /// The whole change, as the data set keeps it and as poses that come later are changed.
    pub similarity: Similarity3,
    /// Direction in the capture's frame that became +z; none where the frame was kept.
    pub up: Option<[f64; 3]>,
}

/// Least length of a mean of unit vectors that still points somewhere.
const LEAST_MEAN: f64 = 0.1;

impl WorldFromCapture {
    /// The change that a user asks for; the least rotation that brings the direction to +z.
    ///
    /// # Errors
    /// A direction without length, cameras that do not agree on one, or a scale that is none.
    pub fn new(up: Option<Up>, metres_per_unit: f64, shots: &[Shot]) -> Result<Self> {
        bounds::number("--scale", metres_per_unit, &(1e-6..=1e6), "metres a unit of the capture")?;
        let direction = match up {
            None => return Ok(Self { similarity: Similarity3::with_up(None, metres_per_unit), up: None }),
            Some(Up::Direction(up)) => DVec3::from(up),
            Some(Up::Cameras) => {
                // OpenCV cameras have y down.
                -shots.iter().map(|s| s.world_from_camera.rotation.y_axis).sum::<DVec3>() / shots.len().max(1) as f64
            }
        };
        if !(direction.is_finite() && direction.length() >= LEAST_MEAN) {
            let what = match up {
                Some(Up::Cameras) => format!("the cameras' upward axes cancel out (their mean is {direction})"),
                _ => format!("{direction} is no direction"),
            };
            return Err(Error::invalid("--up", what, "give a direction in the capture's frame, e.g. --up=0,-1,0 for y down"));
        }
        let unit = direction.normalize();
        Ok(Self { similarity: Similarity3::with_up(Some(unit), metres_per_unit), up: Some(unit.to_array()) })
    }

    /// A point of the capture in the world, metres.
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.similarity.transform_point(point)
    }

    /// A pose of the capture in the world.
    ///
    /// # Errors
    /// A position that is not finite, or a thousand kilometres away.
    pub fn pose(&self, world_from_camera: &Rigid3, place: &str) -> Result<Rigid3> {
        let pose = self.similarity.pose(world_from_camera);
        bounds::position(place, pose.translation)?;
        Ok(pose)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_becomes_z_and_lengths_are_scaled() {
        for up in [[0.0, -1.0, 0.0], [0.3, 2.0, -0.4], [0.0, 0.0, -5.0], [0.0, 0.0, 1.0]] {
            let world = WorldFromCapture::new(Some(Up::Direction(up)), 0.5, &[]).unwrap();
            let unit = DVec3::from(up).normalize();
            assert!((world.point(unit) - 0.5 * DVec3::Z).length() < 1e-12, "{up:?}");
            assert!((world.similarity.rotation.determinant() - 1.0).abs() < 1e-12);
        }
        let kept = WorldFromCapture::new(None, 2.0, &[]).unwrap();
        assert_eq!((kept.point(DVec3::X), kept.up), (2.0 * DVec3::X, None));
        for (up, scale) in
            [([0.0; 3], 1.0), ([f64::NAN, 0.0, 1.0], 1.0), ([0.0, 0.0, 1.0], 0.0), ([0.0, 0.0, 1.0], f64::INFINITY)]
        {
            assert!(WorldFromCapture::new(Some(Up::Direction(up)), scale, &[]).is_err(), "{up:?} {scale}");
        }
    }
}
