//! Interface of what forms a finished field's observations, on either device.

use super::{ArrayField, ArraySensor};
use crate::Result;
use corf_scene::{Raster, Rigid3};
use std::sync::Arc;

/// Holds a field and forms its observations.
pub trait Observer {
    /// Observations at poses (`world_from_camera`), linear power over the pixels of the field's camera.
    ///
    /// # Errors
    /// The device's.
    fn observe(&mut self, poses: &[Rigid3]) -> Result<Vec<Raster<f32>>>;
}

/// Forms observations on the processor, in double precision.
pub struct CpuObserver {
    field: Arc<ArrayField>,
    sensor: ArraySensor<f64>,
}

impl CpuObserver {
    /// Of a field.
    pub fn new(field: Arc<ArrayField>) -> Self {
        Self { sensor: field.sensor.build(&field.camera), field }
    }
}

impl Observer for CpuObserver {
    fn observe(&mut self, poses: &[Rigid3]) -> Result<Vec<Raster<f32>>> {
        Ok(poses.iter().map(|pose| self.field.observe(&self.sensor, pose)).collect())
    }
}
