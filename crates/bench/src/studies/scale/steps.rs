//! Training steps: against Gaussians, and against pixels.

use super::{Axis, Measured, memory};
use crate::device::Backend;
use crate::record::provenance::reset_peak_memory;
use crate::studies::workload;
use anyhow::Result;
use corf::RasterConfig;
use serde::Serialize;
use serde_json::Value;

/// A workload of [`crate::studies::workload`], and how it is timed.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct StepSettings {
    /// Gaussians in the room.
    pub gaussians: usize,
    /// Optical image, pixels.
    #[serde(rename = "optical")]
    pub light: [usize; 2],
    /// RF image, pixels.
    #[serde(rename = "rf")]
    pub radio: [usize; 2],
    /// Steps of a run.
    pub steps: usize,
    /// Runs, of which the median counts.
    pub repeats: usize,
}

impl StepSettings {
    /// What is held fixed along an axis, for its records.
    pub fn beside(&self, axis: Axis) -> Value {
        let mut value = serde_json::json!(self);
        if let Some(map) = value.as_object_mut() {
            map.remove(if axis == Axis::Pixels { "optical" } else { "gaussians" });
        }
        value
    }

    /// Times the steps on a fresh device.
    ///
    /// # Errors
    /// The device's; an interrupt.
    pub fn measure(&self, backend: &Backend) -> Result<Measured> {
        reset_peak_memory();
        let rig = workload::rig(self.light, self.radio);
        let gaussians = workload::room(self.gaussians, 1);
        let mut device = backend.make(workload::optimizer(), RasterConfig::default(), &gaussians)?;
        drop(gaussians);
        for view in rig.views(3) {
            device.upload(&view, 1)?;
        }
        let timed = workload::time_steps(device.as_mut(), &rig, self.steps, self.repeats)?;
        let found = [
            ("step_ms", timed.median_ms),
            ("step_least_ms", timed.range_ms[0]),
            ("step_greatest_ms", timed.range_ms[1]),
            ("visible", timed.visible as f64),
        ];
        Ok(found.map(|(key, v)| (key.to_owned(), v)).into_iter().chain(memory(device.memory_bytes())).collect())
    }
}
