//! Where the time of light on a GPU goes: by the wall, and on the device itself where it takes timestamps.

use super::super::Spent;
use corf_gpu::Context;
use corf_scene::Result;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Passes that are timed before their stamps are read.
const PASSES: u32 = 2048;

/// Sums of times.
pub(super) struct Clock {
    spent: Mutex<Vec<Spent>>,
    stamps: Option<Stamps>,
}

/// A pair of timestamps for each pass.
struct Stamps {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
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
        let stamps = || -> Result<Stamps> {
            let queries = context.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("passes"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * PASSES,
            });
            let resolved = context.buffer("timestamps", u64::from(2 * PASSES) * 8, wgpu::BufferUsages::QUERY_RESOLVE)?;
            Ok(Stamps { queries, resolved, passes: Mutex::default() })
        };
        Ok(Self { spent: Mutex::default(), stamps: context.timestamps.then(stamps).transpose()? })
    }

    /// Adds seconds to a stage's.
    pub fn add(&self, what: &'static str, seconds: f64) {
        let mut spent = locked(&self.spent);
        match spent.iter_mut().find(|s| s.what == what) {
            Some(of) => (of.seconds, of.times) = (of.seconds + seconds, of.times + 1),
            None => spent.push(Spent { what, seconds, times: 1 }),
        }
    }

    /// Does something and adds the time that it takes, by the wall.
    pub fn wall<T>(&self, what: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let done = work();
        self.add(what, start.elapsed().as_secs_f64());
        done
    }

    /// The timestamps of a pass that does something; none where there is no room.
    pub fn stamp(&self, what: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let Stamps { queries, passes, .. } = self.stamps.as_ref()?;
        let mut passes = locked(passes);
        let first = 2 * passes.len() as u32;
        (first < 2 * PASSES).then(|| {
            passes.push(what);
            wgpu::ComputePassTimestampWrites {
                query_set: queries,
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
        let Some(Stamps { queries, resolved, passes }) = &self.stamps else { return Ok(()) };
        let passes = std::mem::take(&mut *locked(passes));
        if passes.is_empty() {
            return Ok(());
        }
        let count = 2 * passes.len() as u32;
        let mut encoder = context.encoder();
        encoder.resolve_query_set(queries, 0..count, resolved, 0);
        context.submit(encoder);
        let stamps = context.read::<u64>("timestamps", &[(resolved, count as usize)])?.remove(0);
        let period = f64::from(context.queue.get_timestamp_period()) * 1e-9;
        for (what, pair) in passes.into_iter().zip(stamps.chunks_exact(2)) {
            self.add(what, pair[1].saturating_sub(pair[0]) as f64 * period);
        }
        Ok(())
    }

    /// The sums so far.
    pub fn spent(&self) -> Vec<Spent> {
        locked(&self.spent).clone()
    }
}

/// So many passes are worth a wait for their timestamps.
pub(super) const WORTH_READING: usize = PASSES as usize / 4;
