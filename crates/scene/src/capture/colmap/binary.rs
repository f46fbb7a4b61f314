//! COLMAP's binary files: little-endian, without padding.

use super::rigs::{Frame, Kind, Rig, Sensor};
use super::{Camera, Image, MODELS, Pose, READ, Sparse};
use crate::dataset::ColoredPoint;
use crate::{Error, Result, io};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Reads `cameras.bin`, `images.bin` and, where it is there, `points3D.bin`.
pub(super) fn read(folder: &Path) -> Result<Sparse> {
    let points = folder.join("points3D.bin");
    Ok(Sparse {
        cameras: cameras(&folder.join("cameras.bin"))?,
        images: images(&folder.join("images.bin"))?,
        points: if points.is_file() { self::points(&points)? } else { Vec::new() },
    })
}

/// Bytes of a file that have not been read.
struct Bytes<'a> {
    path: &'a Path,
    rest: &'a [u8],
}

impl Bytes<'_> {
    fn fault(&self, what: impl Into<String>) -> Error {
        Error::invalid(
            self.path.display().to_string(),
            what,
            "the file is damaged, cut short or of another program: export the model again",
        )
    }

    fn take(&mut self, count: usize) -> Result<&[u8]> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else { return Err(self.fault("it is cut short")) };
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn u64(&mut self) -> Result<u64> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn f64(&mut self) -> Result<f64> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    fn f64s<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    fn pose(&mut self) -> Result<Pose> {
        Ok(Pose { quaternion: self.f64s()?, translation: self.f64s()? })
    }

    fn sensor(&mut self) -> Result<Sensor> {
        let kind = match self.u32()? {
            0 => Kind::Camera,
            1 => Kind::Imu,
            other => return Err(self.fault(format!("there is no kind of sensor {}", other as i32))),
        };
        Ok(Sensor { kind, id: self.u32()? })
    }

    /// A number of 32 bits of records, of which each takes at least so many bytes.
    fn short_count(&mut self, least_bytes: usize) -> Result<usize> {
        let count = self.u32()?;
        match usize::try_from(count) {
            Ok(n) if n.checked_mul(least_bytes).is_some_and(|bytes| bytes <= self.rest.len()) => Ok(n),
            _ => Err(self.fault(format!("it declares {count} records, which its bytes cannot hold"))),
        }
    }

    /// A number of records, of which each takes at least so many bytes.
    fn count(&mut self, least_bytes: usize) -> Result<usize> {
        let count = self.u64()?;
        match usize::try_from(count) {
            Ok(n) if n.checked_mul(least_bytes).is_some_and(|bytes| bytes <= self.rest.len()) => Ok(n),
            _ => Err(self.fault(format!("it declares {count} records, which its bytes cannot hold"))),
        }
    }

    /// Nothing may follow.
    fn end(&self) -> Result<()> {
        if self.rest.is_empty() { Ok(()) } else { Err(self.fault(format!("{} bytes follow its records", self.rest.len()))) }
    }
}

fn cameras(path: &Path) -> Result<BTreeMap<u32, Camera>> {
    let bytes = io::read(path)?;
    let mut bytes = Bytes { path, rest: &bytes };
    let mut cameras = BTreeMap::new();
    for _ in 0..bytes.count(24)? {
        let (id, number, width, height) = (bytes.u32()?, bytes.u32()?, bytes.u64()?, bytes.u64()?);
        let Some(model) = MODELS.get(number as usize).copied() else {
            return Err(Error::invalid(
                format!("{}: camera {id}", path.display()),
                format!("there is no camera model {number}"),
                format!("these are read: {READ}"),
            ));
        };
        let parameters = (0..model.parameters).map(|_| bytes.f64()).collect::<Result<_>>()?;
        if cameras.insert(id, Camera { model, width, height, parameters }).is_some() {
            return Err(bytes.fault(format!("there are two cameras {id}")));
        }
    }
    bytes.end()?;
    Ok(cameras)
}

fn images(path: &Path) -> Result<Vec<Image>> {
    let bytes = io::read(path)?;
    let mut bytes = Bytes { path, rest: &bytes };
    let count = bytes.count(73)?;
    let mut images = Vec::with_capacity(count);
    let mut ids = BTreeSet::new();
    for _ in 0..count {
        let id = bytes.u32()?;
        if !ids.insert(id) {
            return Err(bytes.fault(format!("there are two images {id}")));
        }
        let camera_from_world = bytes.pose()?;
        let camera = bytes.u32()?;
        let Some(length) = bytes.rest.iter().position(|b| *b == 0) else { return Err(bytes.fault("a name does not end")) };
        let name = std::str::from_utf8(bytes.take(length)?).map(str::to_owned);
        let name = name.map_err(|e| bytes.fault(format!("the name of an image is no UTF-8: {e}")))?;
        bytes.take(1)?;
        // Two coordinates and the number of a point each.
        let observed = bytes.count(24)?;
        bytes.take(24 * observed)?;
        images.push(Image { id, camera_from_world, camera, name });
    }
    bytes.end()?;
    Ok(images)
}

fn points(path: &Path) -> Result<Vec<ColoredPoint>> {
    let bytes = io::read(path)?;
    let mut bytes = Bytes { path, rest: &bytes };
    let count = bytes.count(51)?;
    let mut points = Vec::with_capacity(count);
    for _ in 0..count {
        let _id = bytes.u64()?;
        let position = DVec3::from(bytes.f64s()?);
        let color = bytes.array()?;
        let _error = bytes.f64()?;
        let track = bytes.count(8)?;
        bytes.take(8 * track)?;
        if !position.is_finite() {
            return Err(bytes.fault("a point is not finite"));
        }
        points.push(ColoredPoint { position, color });
    }
    bytes.end()?;
    Ok(points)
}

/// `rigs.bin`.
pub(super) fn rigs(path: &Path) -> Result<Vec<Rig>> {
    let bytes = io::read(path)?;
    let mut bytes = Bytes { path, rest: &bytes };
    let count = bytes.count(8)?;
    let mut rigs = Vec::with_capacity(count);
    for _ in 0..count {
        let id = bytes.u32()?;
        let sensors = bytes.short_count(8)?;
        let reference = if sensors > 0 { Some(bytes.sensor()?) } else { None };
        let mut others = Vec::new();
        for _ in 1..sensors {
            let sensor = bytes.sensor()?;
            let pose = match bytes.array::<1>()? {
                [0] => None,
                [1] => Some(bytes.pose()?),
                [other] => return Err(bytes.fault(format!("whether {sensor} has a pose is {other}, not 0 or 1"))),
            };
            others.push((sensor, pose));
        }
        rigs.push(Rig { id, reference, others });
    }
    bytes.end()?;
    Ok(rigs)
}

/// `frames.bin`.
pub(super) fn frames(path: &Path) -> Result<Vec<Frame>> {
    let bytes = io::read(path)?;
    let mut bytes = Bytes { path, rest: &bytes };
    let count = bytes.count(68)?;
    let mut frames = Vec::with_capacity(count);
    for _ in 0..count {
        let (id, rig, rig_from_world) = (bytes.u32()?, bytes.u32()?, bytes.pose()?);
        let data = (0..bytes.short_count(16)?).map(|_| Ok((bytes.sensor()?, bytes.u64()?))).collect::<Result<_>>()?;
        frames.push(Frame { id, rig, rig_from_world, data });
    }
    bytes.end()?;
    Ok(frames)
}
