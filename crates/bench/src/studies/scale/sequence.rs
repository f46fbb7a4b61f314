//! Whole online reconstructions: against keyframes.

use super::{Measured, memory, walk};
use crate::device::Backend;
use crate::record::provenance::reset_peak_memory;
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::Result;
use corf::{OptimizerConfig, RasterConfig, ReconstructionConfig, Reconstructor};
use corf_scene::{Keyframe, Pinhole};
use rayon::prelude::*;
use serde::Serialize;
use std::time::Instant;

/// Keyframes drawn at a time, while the clock stands still. A keyframe of 1600×900 takes 16 MB; and once in so many nothing is prepared ahead.
const DRAWN_AT_ONCE: usize = 32;

/// A walk through the drawn room ([`walk`]), reconstructed with the default constants.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SequenceSettings {
    /// Optical image, pixels.
    #[serde(rename = "optical")]
    pub light: [usize; 2],
    /// RF image, pixels.
    #[serde(rename = "rf")]
    pub radio: [usize; 2],
    /// Training steps for each keyframe.
    pub iterations_per_keyframe: usize,
    /// Device memory for keyframes, MB.
    pub keyframe_memory_mb: u64,
}

impl SequenceSettings {
    /// Reconstructs a walk of as many keyframes as the largest count says; `tell` is given the findings at every count. The clock runs from
    /// the first keyframe in memory until the last has been optimised with, and stands still while keyframes are drawn.
    ///
    /// # Errors
    /// The device's; sizes that cannot be reconstructed; an interrupt; an error of `tell`.
    pub fn measure(
        &self,
        backend: &Backend,
        counts: &[usize],
        report: &mut dyn FnMut(usize, Measured) -> Result<()>,
    ) -> Result<()> {
        let Some(&last) = counts.last() else { return Ok(()) };
        reset_peak_memory();
        let config =
            ReconstructionConfig { iterations_per_keyframe: self.iterations_per_keyframe, ..ReconstructionConfig::default() };
        let raster = RasterConfig { keyframe_memory_mb: self.keyframe_memory_mb, ..RasterConfig::default() };
        let camera = |[width, height]: [usize; 2]| Pinhole::from_horizontal_fov(width, height, walk::FIELD_OF_VIEW_DEG);
        let (light, radio) = (camera(self.light), camera(self.radio));
        let device = backend.make(OptimizerConfig::default(), raster, &config.empty_field())?;
        let mut run = Run {
            reconstructor: Reconstructor::new(device, config, light, radio, walk::DB_RANGE, 1)?,
            seconds: 0.0,
            device_bytes: None,
        };
        let mut progress = Progress::start("keyframes", last, "keyframes");
        let (mut taken, mut before) = (0, (0, 0.0));
        while taken < last {
            let next = counts.iter().copied().find(|n| *n > taken).unwrap_or(last);
            let drawn: Vec<Keyframe> = (taken..next.min(taken + DRAWN_AT_ONCE))
                .into_par_iter()
                .map(|i| {
                    interrupt::check()?;
                    Ok(walk::keyframe(i, &light, &radio))
                })
                .collect::<Result<_>>()?;
            taken += drawn.len();
            run.take(drawn)?;
            progress.set(taken, last);
            if counts.contains(&taken) {
                let recent_s = (run.seconds - before.1) / (taken - before.0) as f64;
                before = (taken, run.seconds);
                let found = [
                    ("total_s", run.seconds),
                    ("per_keyframe_ms", 1e3 * run.seconds / taken as f64),
                    ("recent_keyframe_ms", 1e3 * recent_s),
                    ("gaussians", run.reconstructor.gaussian_count() as f64),
                ];
                report(taken, found.map(|(key, v)| (key.to_owned(), v)).into_iter().chain(memory(run.device_bytes)).collect())?;
            }
        }
        progress.finish();
        Ok(())
    }
}

/// A reconstruction under way, with its clock.
struct Run {
    reconstructor: Reconstructor,
    seconds: f64,
    /// Most memory of the device so far.
    device_bytes: Option<u64>,
}

impl Run {
    /// Takes keyframes, as an online reconstruction does, until nothing waits.
    fn take(&mut self, keyframes: Vec<Keyframe>) -> Result<()> {
        let start = Instant::now();
        for keyframe in keyframes {
            self.reconstructor.receive(keyframe)?;
            while self.reconstructor.waiting() >= self.reconstructor.worth_receiving() {
                self.process()?;
            }
        }
        while self.reconstructor.waiting() > 0 {
            self.process()?;
        }
        self.seconds += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn process(&mut self) -> Result<()> {
        interrupt::check()?;
        self.reconstructor.process()?;
        self.device_bytes = self.device_bytes.max(self.reconstructor.device_memory_bytes());
        Ok(())
    }
}
