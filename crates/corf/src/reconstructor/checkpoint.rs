//! A reconstruction kept on disk while it runs: all that it depends on beside the keyframes, which are replayed when it goes on. Behind the
//! device's state the file holds the keyframe at which each Gaussian was born.

use super::{Past, Reconstructor};
use crate::{
    Error, FieldMeta, ReconstructionConfig, Result,
    depth::AlignedPrior,
    device::DeviceState,
    files::{
        state,
        tensors::{self, Kind, Tensor, Tensors},
    },
    reconstructor::schedule::ScheduleState,
};
use corf_scene::Keyframe;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::Path;

/// Metadata of a checkpoint, beside the arrays of its Gaussians.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    tag: String,
    seed: u64,
    config: ReconstructionConfig,
    meta: FieldMeta,
    past: Vec<Past>,
    schedule: ScheduleState,
    gaussians: usize,
}

const KIND: Kind = Kind {
    name: "checkpoint",
    format: "corf-checkpoint/4",
    help: "remove the file and start the reconstruction anew",
    finite: false,
};

/// The state of a [`Reconstructor`] between two keyframes.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    header: Header,
    device: DeviceState,
    born: Vec<u32>,
}

impl Checkpoint {
    /// Trajectory indices of the keyframes it holds, in order: those to [replay](Reconstructor::replay).
    pub fn keyframes(&self) -> Vec<usize> {
        self.header.past.iter().map(|p| p.index).collect()
    }

    /// The caller's tag.
    pub fn tag(&self) -> &str {
        &self.header.tag
    }

    /// Writes it whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut all = state::tensors(&self.device);
        all.push(Tensor::words("born", &[self.born.len()], &self.born[..]));
        tensors::write(path, &KIND, &self.header, all)
    }

    /// Reads one back.
    ///
    /// # Errors
    /// A file that is missing, damaged, or no checkpoint.
    pub fn read(path: &Path) -> Result<Self> {
        let (file, header) = Tensors::read_kind::<Header>(path, &KIND)?;
        let device = state::read(&file, header.gaussians, &header.config.empty_field())?;
        let born = file.words("born", &[header.gaussians])?;
        Ok(Self { header, device, born })
    }
}

/// A reconstruction whose keyframes are being replayed.
pub(super) struct Replay {
    left: VecDeque<Past>,
    schedule: ScheduleState,
}

impl Reconstructor {
    /// The state between two keyframes; `tag` is handed back by [`Checkpoint::tag`].
    ///
    /// # Errors
    /// Before the first keyframe has been expanded or after [`Self::finish`]; the device's errors.
    pub fn checkpoint(&mut self, tag: &str) -> Result<Checkpoint> {
        if self.past.is_empty() || self.finished || self.replay.is_some() {
            let help = "take checkpoints between the first expansion and Reconstructor::finish";
            return Err(Error::invalid("checkpoint", "there is no state between two keyframes", help));
        }
        let device = self.device.state()?;
        let header = Header {
            tag: tag.to_owned(),
            seed: self.seed,
            config: self.config.clone(),
            meta: self.meta,
            past: self.past.clone(),
            schedule: self.schedule.state(),
            gaussians: device.gaussians.len(),
        };
        Ok(Checkpoint { header, device, born: self.born.clone() })
    }

    /// Makes a fresh reconstruction go on where a checkpoint was taken; its [keyframes](Checkpoint::keyframes) have to be
    /// [replayed](Self::replay) before others are received. What follows is what would have followed without the interruption.
    ///
    /// # Errors
    /// A reconstruction that has begun; another seed, configuration or other cameras; the device's errors.
    pub fn restore(&mut self, checkpoint: &Checkpoint) -> Result<()> {
        let Header { seed, config, meta, past, schedule, .. } = &checkpoint.header;
        let refuse =
            |what: &str| Error::invalid("checkpoint", what, "resume with the command that was interrupted, or start anew");
        if self.keyframes_received > 0 {
            return Err(refuse("the reconstruction has begun already"));
        }
        if (*seed, config, meta) != (self.seed, &self.config, &self.meta) {
            return Err(refuse("it is of another seed, configuration, or of other cameras"));
        }
        self.device.restore(&checkpoint.device)?;
        self.born.clone_from(&checkpoint.born);
        self.replay = Some(Replay { left: past.iter().cloned().collect(), schedule: schedule.clone() });
        Ok(())
    }

    /// Takes a keyframe that the checkpoint holds once more: as a view to train with and to match with, nothing else.
    ///
    /// # Errors
    /// Those of [`Self::receive`]; a keyframe that is not the next of the checkpoint's; the device's errors.
    pub fn replay(&mut self, keyframe: Keyframe) -> Result<()> {
        let next = self.replay.as_ref().and_then(|r| r.left.front());
        let Some(past) = next.filter(|past| past.index == keyframe.index).cloned() else {
            let what = format!("it comes where keyframe {:?} of the checkpoint is expected", next.map(|p| p.index));
            return Err(Error::invalid(
                format!("keyframe {}", keyframe.index),
                what,
                "replay the checkpoint's keyframes in order",
            ));
        };
        self.admit(&keyframe)?;
        let light = &*self.ahead.preparer().guide(&keyframe)?;
        let view = self.ahead.preparer().view(&keyframe, light)?;
        self.ahead.with_past(|p| p.meet(&view));
        let mono = self.ahead.preparer().mono(&keyframe, light)?;
        let aligned =
            mono.as_ref().zip(past.alignment).map(|(m, [scale, offset])| AlignedPrior::new(m, scale, offset, &self.config.depth));
        let corrected = |a: AlignedPrior| match &past.correction {
            Some(correction) => correction.apply(&a, &self.config.depth),
            None => a,
        };
        let aligned = aligned.map(corrected);
        let target = self.ahead.preparer().training_view(&keyframe, light, aligned.as_ref());
        let view = self.device.upload(&target, self.config.pyramid_levels)?;
        self.schedule.push(view);
        let typical_depth_m = past.typical_depth_m;
        self.past.push(past);
        self.keyframes_expanded += 1;
        if let Some(replay) = &mut self.replay {
            replay.left.pop_front();
            if replay.left.is_empty() {
                self.schedule.restore(&replay.schedule);
                self.ahead.with_past(|p| p.set_typical_depth_m(typical_depth_m));
                self.replay = None;
                self.apply_world_scale();
            }
        }
        Ok(())
    }
}
