//! A WRF-GS+ reconstruction kept on disk while it runs: all that it depends on beside the keyframes.
//!
//! Its arrays are, for the Gaussians and Adam's two moments, position, rotation, ln scale, opacity and colour at 60 GHz; the network's parameters and
//! two moments; sums of the gradients on the screen, and the numbers of steps in them.

use super::field::{HELP, gaussians, tensors};
use super::{WrfGsPlusConfig, WrfGsPlusModel, WrfGsPlusReconstructor};
use crate::mlp::Trained;
use crate::rf_3dgs::DensityCounts;
use corf::device::{DeviceState, ScreenGradient};
use corf::files::tensors::{self, Kind, Tensor, Tensors};
use corf::{Error, FieldMeta, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Metadata of a checkpoint, beside its arrays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    tag: String,
    seed: u64,
    config: WrfGsPlusConfig,
    meta: FieldMeta,
    keyframes: usize,
    steps: usize,
    counts: [usize; 3],
    gaussians: usize,
}

const KIND: Kind = Kind { name: "checkpoint", format: "corf-wrf-gs-plus-checkpoint/2", help: HELP, finite: true };

/// Names of the Gaussians and of their moments.
const PARTS: [&str; 3] = ["gaussians", "first_moment", "second_moment"];
/// Names of the network's parameters and of their moments.
const NETWORK: [&str; 3] = ["network.parameters", "network.first_moment", "network.second_moment"];

/// The state of a [`WrfGsPlusReconstructor`] between two steps.
#[derive(Clone, Debug, PartialEq)]
pub struct WrfGsPlusCheckpoint {
    header: Header,
    device: DeviceState,
    network: Trained<f32>,
    screen: Vec<ScreenGradient>,
}

impl WrfGsPlusCheckpoint {
    /// Steps that it holds.
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
    /// A number that is not finite, a file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let (state, network) = (&self.device, &self.network);
        let ([first, second], n) = (&state.moments, self.screen.len());
        let mut all: Vec<Tensor<'_>> =
            PARTS.into_iter().zip([&state.gaussians, first, second]).flat_map(|(of, part)| tensors(of, part)).collect();
        let [first, second] = &network.moments;
        for (name, values) in NETWORK.into_iter().zip([&network.parameters, first, second]) {
            all.push(Tensor::new(name, &[values.len()], &values[..]));
        }
        all.push(Tensor::new("screen.norm_sum", &[n], self.screen.iter().map(|g| g.norm_sum).collect::<Vec<f32>>()));
        all.push(Tensor::words("screen.steps", &[n], self.screen.iter().map(|g| g.steps).collect::<Vec<u32>>()));
        tensors::write(path, &KIND, &self.header, all)
    }

    /// Reads one back.
    ///
    /// # Errors
    /// A file that is missing, damaged, or no checkpoint.
    pub fn read(path: &Path) -> Result<Self> {
        let (file, header) = Tensors::read_kind::<Header>(path, &KIND)?;
        header.config.validate()?;
        let n = header.gaussians;
        let [held, first, second] = PARTS.map(|of| gaussians(&header.config, &file, of, n));
        let (held, moments) = (held?, [first?, second?]);
        let parameters = WrfGsPlusModel::new(&header.config).network.parameters();
        let [own, first, second] = NETWORK.map(|name| file.values(name, &[parameters]));
        let network = Trained { parameters: own?, moments: [first?, second?], steps: header.steps as u64 };
        let sums = file.values("screen.norm_sum", &[n])?.into_iter().zip(file.words("screen.steps", &[n])?);
        let screen = sums.map(|(norm_sum, steps)| ScreenGradient { norm_sum, steps }).collect();
        let device = DeviceState { position_rate: vec![1.0; held.len()], gaussians: held, moments };
        Ok(Self { header, device, network, screen })
    }
}

impl WrfGsPlusReconstructor {
    /// The state between two steps; `tag` is handed back by [`WrfGsPlusCheckpoint::tag`].
    ///
    /// # Errors
    /// Before the beginning; the device's errors.
    pub fn checkpoint(&mut self, tag: &str) -> Result<WrfGsPlusCheckpoint> {
        if !self.has_begun() {
            let help = "take checkpoints after WrfGsPlusReconstructor::begin";
            return Err(Error::invalid("checkpoint", "the reconstruction has not begun", help));
        }
        let device = self.trainer.device();
        let (state, screen) = (device.state()?, device.screen_gradients()?);
        let header = Header {
            tag: tag.to_owned(),
            seed: self.seed,
            config: self.config.clone(),
            meta: self.meta,
            keyframes: self.poses.len(),
            steps: self.done,
            counts: [self.counts.cloned, self.counts.split, self.counts.pruned],
            gaussians: state.gaussians.len(),
        };
        Ok(WrfGsPlusCheckpoint { header, device: state, network: self.trainer.network()?, screen })
    }

    /// Makes a reconstruction that has received its keyframes go on where a checkpoint was taken, in place of [`Self::begin`]. What follows is
    /// what would have followed without the interruption.
    ///
    /// # Errors
    /// A reconstruction that has begun; another seed, configuration, number of keyframes or other cameras; the device's errors.
    pub fn restore(&mut self, checkpoint: &WrfGsPlusCheckpoint) -> Result<()> {
        let h = &checkpoint.header;
        if (h.seed, &h.config, &h.meta, h.keyframes) != (self.seed, &self.config, &self.meta, self.poses.len())
            || h.steps > self.config.iterations
        {
            let what = "it is of another seed, configuration, or of other keyframes";
            return Err(Error::invalid("checkpoint", what, "resume with the command that was interrupted, or start anew"));
        }
        self.settle()?;
        let device = self.trainer.device();
        device.restore(&checkpoint.device)?;
        device.set_screen_gradients(&checkpoint.screen)?;
        self.trainer.restore_network(&checkpoint.network)?;
        let [cloned, split, pruned] = h.counts;
        (self.done, self.counts) = (h.steps, DensityCounts { cloned, split, pruned });
        Ok(())
    }
}
