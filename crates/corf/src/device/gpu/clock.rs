//! Where the time of training steps goes: on the device by its own timestamps, on the host by the wall.

use super::{
    GpuDevice,
    params::Params,
    train::{GpuStageTimes, STAGES},
};
use crate::{
    Result,
    device::{FrameTimes, TrainingTimes},
};
use corf_gpu::{Context, Reading, Timestamps};
use std::collections::BTreeMap;

/// Pixels of both images of a frame.
type Size = [[u32; 2]; 2];

/// Timestamps of one submission, on their way.
struct Stamped {
    stamps: Reading<u64>,
    /// Of each of its steps.
    sizes: Vec<Size>,
    /// Whether the submission before is of the same batch.
    follows: bool,
}

/// The times of a device so far.
#[derive(Default)]
pub(super) struct Clock {
    pending: Vec<Stamped>,
    frames: BTreeMap<Size, GpuStageTimes>,
    /// The last timestamp that was read.
    last: u64,
    /// What the host counts; `frames` and `starved_s` come from the timestamps.
    pub host: TrainingTimes,
}

impl Clock {
    /// Takes a submission's timestamps in; they are read once the batch has ended.
    pub fn expect<'a>(&mut self, stamps: Reading<u64>, steps: impl Iterator<Item = &'a Params>, follows: bool) {
        let sizes = steps.map(|p| [p.grids[0].size, p.grids[1].size]).collect();
        self.pending.push(Stamped { stamps, sizes, follows });
    }

    /// Reads what is on its way, of which the first `taken` steps found room; those behind did nothing.
    pub fn settle(&mut self, context: &Context, taken: usize) -> Result<()> {
        let mut left = taken;
        for Stamped { stamps, sizes, follows } in std::mem::take(&mut self.pending) {
            let Some(stamps) = stamps.finish(context)?.pop() else { continue };
            if let (true, Some(first)) = (follows, stamps.first()) {
                self.host.starved_s += Timestamps::seconds(context, self.last, *first);
            }
            self.last = stamps.last().copied().unwrap_or(self.last);
            for (step, size) in stamps.chunks_exact(STAGES.len() + 1).zip(sizes).take(left) {
                left -= 1;
                let times = self.frames.entry(size).or_default();
                times.steps += 1;
                for (sum, pair) in times.seconds.iter_mut().zip(step.windows(2)) {
                    *sum += Timestamps::seconds(context, pair[0], pair[1]);
                }
            }
        }
        Ok(())
    }

    /// The kernels' times over all sizes, and forgets them.
    pub fn take_stages(&mut self) -> GpuStageTimes {
        let mut all = GpuStageTimes::default();
        for times in std::mem::take(self).frames.into_values() {
            all.steps += times.steps;
            all.seconds.iter_mut().zip(times.seconds).for_each(|(sum, s)| *sum += s);
        }
        all
    }

    fn take(&mut self) -> TrainingTimes {
        let Self { frames, host, .. } = std::mem::take(self);
        let named = |seconds: [f64; STAGES.len()]| STAGES.iter().map(|s| (*s).to_owned()).zip(seconds).collect();
        let of_size = |([light, radio], times): (Size, GpuStageTimes)| FrameTimes {
            light,
            radio,
            steps: times.steps,
            kernels: named(times.seconds),
        };
        TrainingTimes { frames: frames.into_iter().map(of_size).collect(), ..host }
    }
}

impl GpuDevice {
    /// Whether the stages of the steps that follow are timed, which costs them a little; the device must have been made with
    /// [`corf_gpu::AdapterOptions::timestamps`].
    pub fn time_stages(&mut self, on: bool) {
        self.timing = on && self.context.timestamps;
    }

    /// Time on the device since it was made or this was last called; nothing unless it was made with
    /// [`corf_gpu::AdapterOptions::timestamps`] and the adapter has them.
    pub fn take_stage_times(&mut self) -> Option<GpuStageTimes> {
        self.context.timestamps.then(|| self.clock.take_stages())
    }

    pub(super) fn take_times(&mut self) -> Option<TrainingTimes> {
        self.timing.then(|| self.clock.take())
    }
}
