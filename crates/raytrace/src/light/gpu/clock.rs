//! Where the time of light on a GPU goes: by the wall, and on the device itself where it takes timestamps.

use super::super::Stages;
use corf_gpu::{Context, Timestamps};
use corf_scene::Result;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Passes that are timed before their stamps are read.
const PASSES: u32 = 2048;

/// Sums of times.
pub(super) struct Clock {
    pub stages: Stages,
    stamps: Option<Stamps>,
}

/// A pair of timestamps for each pass.
struct Stamps {
    timestamps: Timestamps,
    /// What the passes since the last reading did.
    passes: Mutex<Vec<&'static str>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Clock {
    /// # Errors
    /// No memory for timestamps.
    pub fn new(context: &Context) -> Result<Self> {
        let stamps = || Ok(Stamps { timestamps: Timestamps::new(context, 2 * PASSES)?, passes: Mutex::default() });
        Ok(Self { stages: Stages::default(), stamps: context.timestamps.then(stamps).transpose()? })
    }

    /// The timestamps of a pass that does something; none where there is no room.
    pub fn stamp(&self, what: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let Stamps { timestamps, passes } = self.stamps.as_ref()?;
        let mut passes = locked(passes);
        let first = 2 * passes.len() as u32;
        (first < 2 * PASSES).then(|| {
            passes.push(what);
            wgpu::ComputePassTimestampWrites {
                query_set: timestamps.queries(),
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            }
        })
    }

    /// Number of passes whose timestamps are yet to be read.
    pub fn passes(&self) -> usize {
        self.stamps.as_ref().map_or(0, |stamps| locked(&stamps.passes).len())
    }

    /// Reads the timestamps that were taken. All that were handed out are of passes that were submitted.
    ///
    /// # Errors
    /// The device's.
    pub fn collect(&self, context: &Context) -> Result<()> {
        let Some(Stamps { timestamps, passes }) = &self.stamps else { return Ok(()) };
        let passes = std::mem::take(&mut *locked(passes));
        if passes.is_empty() {
            return Ok(());
        }
        let count = 2 * passes.len() as u32;
        let mut encoder = context.encoder();
        timestamps.resolve(&mut encoder, count);
        context.submit(encoder);
        let stamps = timestamps.read(context, count)?;
        for (what, pair) in passes.into_iter().zip(stamps.chunks_exact(2)) {
            self.stages.add(what, Timestamps::seconds(context, pair[0], pair[1]));
        }
        Ok(())
    }
}

/// So many passes are worth a wait for their timestamps.
pub(super) const WORTH_READING: usize = PASSES as usize / 4;
