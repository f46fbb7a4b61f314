//! A reconstruction kept on disk while it runs: all that it depends on beside the keyframes, which are replayed when it goes on.
//!
//! ```text
//! corf-checkpoint/3\n   length of the header (u64)   header (JSON)   numbers (f32 and u32)   checksum (u64)
//! ```
//! All little-endian. The numbers are, for the Gaussians and Adam's two moments, position, rotation, ln scale, opacity and harmonics in
//! light, opacity and harmonics at 60 GHz; then the position rates and the keyframe at which each Gaussian was born.

use super::{Past, Reconstructor};
use crate::{
    Appearance, Error, FieldMeta, Gaussians, ReconstructionConfig, Result, checksum::checksum, depth::AlignedPrior,
    device::DeviceState, schedule::ScheduleState,
};
use corf_scene::{Keyframe, io};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::Path;

const MAGIC: &[u8] = b"corf-checkpoint/3\n";

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
        let header = serde_json::to_vec(&self.header).map_err(|e| Error::Io {
            action: "write",
            path: path.to_owned(),
            source: e.into(),
        })?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend((header.len() as u64).to_le_bytes());
        bytes.extend(&header);
        let mut put = |numbers: &[f32]| {
            bytes.reserve(4 * numbers.len());
            numbers.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        };
        for g in [&self.device.gaussians, &self.device.moments[0], &self.device.moments[1]] {
            parts(g).into_iter().for_each(&mut put);
        }
        put(&self.device.position_rate);
        bytes.extend(self.born.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(checksum(&bytes).to_le_bytes());
        Ok(io::write_atomic(path, &bytes)?)
    }

    /// Reads one back.
    ///
    /// # Errors
    /// A file that is missing, damaged, or no checkpoint.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = io::read(path)?;
        Self::decode(&bytes).ok_or_else(|| {
            let help = "remove the file and start the reconstruction anew";
            Error::invalid(path.display().to_string(), "this is no checkpoint of this version, or a damaged one", help)
        })
    }

    fn decode(bytes: &[u8]) -> Option<Self> {
        let (content, sum) = bytes.split_at_checked(bytes.len().checked_sub(8)?)?;
        if checksum(content).to_le_bytes() != sum {
            return None;
        }
        let rest = content.strip_prefix(MAGIC)?;
        let (length, rest) = rest.split_at_checked(8)?;
        let (header, numbers) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(length.try_into().ok()?)).ok()?)?;
        let header: Header = serde_json::from_slice(header).ok()?;
        let n = header.gaussians;
        let mut words = Words(numbers);
        let empty = header.config.empty_field();
        let gaussians = words.gaussians(n, &empty)?;
        let moments = [words.gaussians(n, &empty)?, words.gaussians(n, &empty)?];
        let position_rate = words.take(n)?;
        let born = words.take(n)?.into_iter().map(f32::to_bits).collect();
        words.0.is_empty().then_some(Self { header, device: DeviceState { gaussians, moments, position_rate }, born })
    }
}

/// The arrays of some Gaussians, in the file's order.
fn parts(g: &Gaussians) -> [&[f32]; 7] {
    [
        g.position.as_flattened(),
        g.rotation.as_flattened(),
        g.log_scale.as_flattened(),
        &g.optical.opacity_logit,
        &g.optical.sh,
        &g.rf.opacity_logit,
        &g.rf.sh,
    ]
}

/// Numbers still to be read.
struct Words<'a>(&'a [u8]);

impl Words<'_> {
    fn take(&mut self, count: usize) -> Option<Vec<f32>> {
        let (now, later) = self.0.split_at_checked(count.checked_mul(4)?)?;
        self.0 = later;
        Some(now.as_chunks().0.iter().map(|word| f32::from_le_bytes(*word)).collect())
    }

    fn gaussians(&mut self, n: usize, like: &Gaussians) -> Option<Gaussians> {
        fn grouped<const K: usize>(flat: &[f32]) -> Vec<[f32; K]> {
            flat.as_chunks().0.to_vec()
        }
        let position = grouped(&self.take(n.checked_mul(3)?)?);
        let rotation = grouped(&self.take(n.checked_mul(4)?)?);
        let log_scale = grouped(&self.take(n.checked_mul(3)?)?);
        let mut appearance = |like: &Appearance| {
            let opacity_logit = self.take(n)?;
            let sh = self.take(n.checked_mul(like.stride())?)?;
            Some(Appearance { channels: like.channels, sh_degree: like.sh_degree, opacity_logit, sh })
        };
        Some(Gaussians { position, rotation, log_scale, optical: appearance(&like.optical)?, rf: appearance(&like.rf)? })
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
        let view = self.ahead.preparer().view(&keyframe);
        self.ahead.with_past(|p| p.meet(&view));
        let mono = self.ahead.preparer().mono(&keyframe)?;
        let aligned =
            mono.as_ref().zip(past.alignment).map(|(m, [scale, offset])| AlignedPrior::new(m, scale, offset, &self.config.depth));
        let corrected = |a: AlignedPrior| match &past.correction {
            Some(correction) => correction.apply(&a, &self.config.depth),
            None => a,
        };
        let aligned = aligned.map(corrected);
        let target = self.ahead.preparer().training_view(&keyframe, aligned.as_ref());
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
