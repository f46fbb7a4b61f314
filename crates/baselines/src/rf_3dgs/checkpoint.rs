//! An offline reconstruction kept on disk while it runs: all that it depends on beside the keyframes. Beside the device's state the file holds the
//! positional gradients on the screen (`screen_gradients`: the bits of a sum and a number of steps) and the points it began with (`points`: the bits
//! of a place, and a colour).

use super::{DensityCounts, Rf3dgsReconstructor, Rf3dgsTimes, SparsePoint};
use crate::rf_3dgs::Rf3dgsConfig;
use corf::{
    Error, FieldMeta, Result,
    device::{DeviceState, ScreenGradient},
    files::{
        state,
        tensors::{self, Kind, Tensor, Tensors},
    },
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Metadata of a checkpoint, beside the arrays of its Gaussians and points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    tag: String,
    seed: u64,
    config: Rf3dgsConfig,
    meta: FieldMeta,
    keyframes: usize,
    steps: usize,
    #[serde(rename = "rf_begun")]
    radio_begun: bool,
    counts: [usize; 3],
    times: Rf3dgsTimes,
    gaussians: usize,
    points: usize,
}

const KIND: Kind = Kind {
    name: "checkpoint",
    format: "corf-offline-checkpoint/2",
    help: "remove the file and start the reconstruction anew",
    finite: false,
};

/// The state of an [`Rf3dgsReconstructor`] between two steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Rf3dgsCheckpoint {
    header: Header,
    device: DeviceState,
    /// Two words a Gaussian.
    gradients: Vec<u32>,
    /// Four words a point.
    points: Vec<u32>,
}

impl Rf3dgsCheckpoint {
    /// Steps of both stages that it holds.
    pub fn steps(&self) -> usize {
        self.header.steps
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
        all.push(Tensor::words("screen_gradients", &[self.header.gaussians, 2], &self.gradients[..]));
        all.push(Tensor::words("points", &[self.header.points, 4], &self.points[..]));
        tensors::write(path, &KIND, &self.header, all)
    }

    /// Reads one back.
    ///
    /// # Errors
    /// A file that is missing, damaged, or no checkpoint.
    pub fn read(path: &Path) -> Result<Self> {
        let (file, header) = Tensors::read_kind::<Header>(path, &KIND)?;
        let device = state::read(&file, header.gaussians, &header.config.empty_field())?;
        let gradients = file.words("screen_gradients", &[header.gaussians, 2])?;
        let points = file.words("points", &[header.points, 4])?;
        Ok(Self { header, device, gradients, points })
    }
}

impl Rf3dgsReconstructor {
    /// The state between two steps; `tag` is handed back by [`Rf3dgsCheckpoint::tag`].
    ///
    /// # Errors
    /// Before the beginning; the device's errors.
    pub fn checkpoint(&mut self, tag: &str) -> Result<Rf3dgsCheckpoint> {
        if self.schedule.is_none() {
            let help = "take checkpoints after Rf3dgsReconstructor::begin";
            return Err(Error::invalid("checkpoint", "the reconstruction has not begun", help));
        }
        let device = self.device.state()?;
        let gradients = self.device.screen_gradients()?.iter().flat_map(|g| [g.norm_sum.to_bits(), g.steps]).collect();
        let point = |point: &SparsePoint| {
            let ([x, y, z], [r, g, b]) = (point.position.map(f32::to_bits), point.color);
            [x, y, z, u32::from_le_bytes([r, g, b, 0])]
        };
        let points = self.points.iter().flat_map(point).collect();
        let header = Header {
            tag: tag.to_owned(),
            seed: self.seed,
            config: self.config.clone(),
            meta: self.meta,
            keyframes: self.poses.len(),
            steps: self.done,
            radio_begun: self.radio_begun,
            counts: [self.counts.cloned, self.counts.split, self.counts.pruned],
            times: self.times,
            gaussians: device.gaussians.len(),
            points: self.points.len(),
        };
        Ok(Rf3dgsCheckpoint { header, device, gradients, points })
    }

    /// Makes a reconstruction that has received its keyframes go on where a checkpoint was taken, in place of [`Self::begin`]. What follows is
    /// what would have followed without the interruption.
    ///
    /// # Errors
    /// A reconstruction that has begun; another seed, configuration, number of keyframes or other cameras; the device's errors.
    pub fn restore(&mut self, checkpoint: &Rf3dgsCheckpoint) -> Result<()> {
        let h = &checkpoint.header;
        if (h.seed, &h.config, &h.meta, h.keyframes) != (self.seed, &self.config, &self.meta, self.poses.len())
            || h.steps > self.config.total_steps()
        {
            let what = "it is of another seed, configuration, or of other keyframes";
            return Err(Error::invalid("checkpoint", what, "resume with the command that was interrupted, or start anew"));
        }
        self.settle()?;
        self.views = vec![];
        self.device.restore(&checkpoint.device)?;
        let gradient = |w: &[u32; 2]| ScreenGradient { norm_sum: f32::from_bits(w[0]), steps: w[1] };
        let gradients: Vec<ScreenGradient> = checkpoint.gradients.as_chunks().0.iter().map(gradient).collect();
        self.device.set_screen_gradients(&gradients)?;
        let point = |&[x, y, z, color]: &[u32; 4]| {
            let [r, g, b, _] = color.to_le_bytes();
            SparsePoint { position: [x, y, z].map(f32::from_bits), color: [r, g, b] }
        };
        self.points = checkpoint.points.as_chunks().0.iter().map(point).collect();
        let [cloned, split, pruned] = h.counts;
        self.counts = DensityCounts { cloned, split, pruned };
        (self.done, self.radio_begun, self.times) = (h.steps, h.radio_begun, h.times);
        Ok(())
    }
}
