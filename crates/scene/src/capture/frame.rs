//! The frame of a capture: which way is up, and how long its unit of length is.

use super::Shot;
use super::options::{Offset, Up};
use crate::{Error, Result, Rigid3, Similarity3, bounds};
use glam::DVec3;

/// The change from a capture's frame to a world that is z-up, in metres and near its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WorldFromCapture {
    /// The whole change, as the data set keeps it and as poses that come later are changed.
    pub similarity: Similarity3,
    /// Direction in the capture's frame that became +z; none where the frame was kept.
    pub up: Option<[f64; 3]>,
    /// Whether the origin was chosen, by whoever imports or for cameras that would stand too far from it.
    moved: bool,
}

/// The largest offset, metres along an axis: a hundred radii of the Earth, where doubles still hold a ten-thousandth of a millimetre.
const LARGEST_OFFSET_M: f64 = 1e9;

/// Least length of a mean of unit vectors that still points somewhere.
const LEAST_MEAN: f64 = 0.1;

impl WorldFromCapture {
    /// The change that a user asks for; the least rotation that brings the direction to +z. Cameras that would stand where no coordinate may be
    /// ([`bounds::MAX_COORDINATE_M`]) are brought to the origin, for what could not be kept cannot be meant to be.
    ///
    /// # Errors
    /// A direction without length, cameras that do not agree on one, a scale or an offset that is none.
    pub fn new(up: Option<Up>, metres_per_unit: f64, offset: Option<Offset>, shots: &[Shot]) -> Result<Self> {
        let turned = Self::without_offset(up, metres_per_unit, shots)?;
        let positions = || shots.iter().map(|s| turned.point(s.world_from_camera.translation));
        let too_far = || positions().any(|p| p.abs().max_element() > bounds::MAX_COORDINATE_M);
        let offset_m = match offset {
            Some(Offset::Point(point)) => {
                point
                    .iter()
                    .try_for_each(|v| bounds::number("--offset", *v, &(-LARGEST_OFFSET_M..=LARGEST_OFFSET_M), "metres"))?;
                DVec3::from(point)
            }
            None if !too_far() => DVec3::ZERO,
            Some(Offset::Cameras) | None => {
                let (low, high) =
                    positions().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
                let middle = 0.5 * (low + high);
                let steps = (middle / Offset::STEP_M).trunc() * Offset::STEP_M;
                // No -0 in files.
                if steps.is_finite() { steps + DVec3::ZERO } else { DVec3::ZERO }
            }
        };
        let similarity = Similarity3 { translation: DVec3::ZERO - offset_m, ..turned.similarity };
        Ok(Self { similarity, moved: offset.is_some() || too_far(), ..turned })
    }

    /// What is taken off all positions behind turn and scale, metres along the world's axes.
    pub fn offset_m(&self) -> DVec3 {
        DVec3::ZERO - self.similarity.translation
    }

    fn without_offset(up: Option<Up>, metres_per_unit: f64, shots: &[Shot]) -> Result<Self> {
        bounds::number("--scale", metres_per_unit, &(1e-6..=1e6), "metres a unit of the capture")?;
        let direction = match up {
            None => return Ok(Self { similarity: Similarity3::with_up(None, metres_per_unit), up: None, moved: false }),
            Some(Up::Direction(up)) => DVec3::from(up),
            Some(Up::Cameras) => {
                // OpenCV cameras have y down.
                -shots.iter().map(|s| s.world_from_camera.rotation.y_axis).sum::<DVec3>() / shots.len().max(1) as f64
            }
        };
        // Of a direction that somebody states the length says nothing, however long or short it is.
        let largest = direction.abs().max_element();
        let unit = (direction / largest).normalize();
        let points = unit.is_finite() && (!matches!(up, Some(Up::Cameras)) || direction.length() >= LEAST_MEAN);
        if !points {
            let what = match up {
                Some(Up::Cameras) => format!("the cameras' upward axes cancel out (their mean is {direction})"),
                _ => {
                    let [x, y, z] = direction.to_array();
                    format!("[{x:?}, {y:?}, {z:?}] is no direction")
                }
            };
            return Err(Error::invalid("--up", what, "give a direction in the capture's frame, e.g. --up=0,-1,0 for y down"));
        }
        Ok(Self { similarity: Similarity3::with_up(Some(unit), metres_per_unit), up: Some(unit.to_array()), moved: false })
    }

    /// A point of the capture in the world, metres.
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.similarity.transform_point(point)
    }

    /// A pose of the capture in the world.
    ///
    /// # Errors
    /// A position that is not finite, or a thousand kilometres from the origin.
    pub fn pose(&self, world_from_camera: &Rigid3, place: &str) -> Result<Rigid3> {
        let pose = self.similarity.pose(world_from_camera);
        if let Err(error) = bounds::position(place, pose.translation) {
            return Err(match error {
                Error::Invalid { place, what, .. } if pose.translation.is_finite() => {
                    let help = if self.moved {
                        "coordinates are in metres, at most 1e6 from the origin that --offset makes: check --scale and this camera's position, and take \
                         the camera out of the capture if it is no other's neighbour"
                    } else {
                        "coordinates are in metres, at most 1e6 from the origin: check --scale, or move the origin with --offset auto"
                    };
                    Error::invalid(place, what, help)
                }
                other => other,
            });
        }
        Ok(pose)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    #[test]
    fn up_becomes_z_and_lengths_are_scaled() {
        for up in [[0.0, -1.0, 0.0], [0.3, 2.0, -0.4], [0.0, 0.0, -5.0], [0.0, 0.0, 1.0]] {
            let world = WorldFromCapture::new(Some(Up::Direction(up)), 0.5, None, &[]).unwrap();
            let unit = DVec3::from(up).normalize();
            assert!((world.point(unit) - 0.5 * DVec3::Z).length() < 1e-12, "{up:?}");
            assert!((world.similarity.rotation.determinant() - 1.0).abs() < 1e-12);
        }
        let kept = WorldFromCapture::new(None, 2.0, None, &[]).unwrap();
        assert_eq!((kept.point(DVec3::X), kept.up), (2.0 * DVec3::X, None));
        // However long it is.
        for length in [1e300, 1e-300, 0.05] {
            let long = WorldFromCapture::new(Some(Up::Direction([0.0, -length, length])), 1.0, None, &[]).unwrap();
            assert!((long.point(DVec3::new(0.0, -1.0, 1.0).normalize()) - DVec3::Z).length() < 1e-12, "{length}");
        }
        for (up, scale) in
            [([0.0; 3], 1.0), ([f64::NAN, 0.0, 1.0], 1.0), ([0.0, 0.0, 1.0], 0.0), ([0.0, 0.0, 1.0], f64::INFINITY)]
        {
            assert!(WorldFromCapture::new(Some(Up::Direction(up)), scale, None, &[]).is_err(), "{up:?} {scale}");
        }
    }

    fn shot(position: DVec3) -> Shot {
        let lens = super::super::Lens::plain(crate::Pinhole::from_horizontal_fov(4, 4, 90.0));
        let world_from_camera = Rigid3 { rotation: DMat3::IDENTITY, translation: position };
        Shot { name: "a".into(), image: None, lens, world_from_camera, depth: None, mask: None, time_s: None }
    }

    #[test]
    fn an_offset_is_taken_off_in_doubles_behind_turn_and_scale() {
        // y down, millimetres: (x, y, z) becomes (x, z, -y) in metres.
        let at = DVec3::new(446_522_125.0, -18_500.0, 85_232_000.25);
        let shots = [shot(at), shot(at + DVec3::X)];
        let up = Some(Up::Direction([0.0, -1.0, 0.0]));
        let new = |offset| WorldFromCapture::new(up, 1e-3, offset, &shots).unwrap();
        let kept = new(None);
        assert_eq!(kept.offset_m(), DVec3::ZERO);
        let world = kept.point(at);
        for (offset, expected) in [
            (Offset::Point([446_000.5, 85_000.0, -3.0]), DVec3::new(446_000.5, 85_000.0, -3.0)),
            (Offset::Cameras, (world / 100.0).round() * 100.0),
        ] {
            let moved = new(Some(offset));
            assert_eq!(moved.offset_m(), expected);
            assert!((moved.point(at) + moved.offset_m() - world).length() < 1e-9);
            assert!((moved.pose(&shots[0].world_from_camera, "a").unwrap().translation - moved.point(at)).length() == 0.0);
        }
        // A room stays where it is, and what can stand nowhere is moved by itself.
        assert_eq!(
            WorldFromCapture::new(None, 1.0, Some(Offset::Cameras), &[shot(DVec3::splat(-3.0))]).unwrap().offset_m(),
            DVec3::ZERO
        );
        for x in [60.0, -99.0] {
            let room = [shot(DVec3::new(x - 4.0, x, 1.5)), shot(DVec3::new(x + 4.0, x, 1.5))];
            assert_eq!(WorldFromCapture::new(None, 1.0, Some(Offset::Cameras), &room).unwrap().offset_m(), DVec3::ZERO, "{x}");
        }
        // A camera by itself far away is not told to do what was done.
        let outlier = [shot(DVec3::ZERO), shot(DVec3::splat(1e9))];
        let reported = |offset| {
            let world = WorldFromCapture::new(None, 1.0, offset, &outlier).unwrap();
            world.pose(&outlier[1].world_from_camera, "a").unwrap_err().to_string()
        };
        for offset in [None, Some(Offset::Cameras), Some(Offset::Point([1.0; 3]))] {
            assert!(
                !reported(offset).contains("--offset auto") && reported(offset).contains("out of the capture"),
                "{}",
                reported(offset)
            );
        }
        let far = [shot(DVec3::new(500_002.0, 4_400_002.0, 121.5))];
        assert_eq!(WorldFromCapture::new(None, 1.0, None, &far).unwrap().offset_m(), DVec3::new(500_000.0, 4_400_000.0, 100.0));
        let point = |v| WorldFromCapture::new(None, 1.0, Some(Offset::Point([v, 0.0, 0.0])), &far);
        assert!(point(f64::NAN).is_err() && point(1e10).is_err());
        // One that was asked for is not mended.
        assert!(point(0.0).unwrap().pose(&far[0].world_from_camera, "a").is_err());
    }
}
