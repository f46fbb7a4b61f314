//! A WRF-GS+ reconstruction kept on disk while it runs: all that it depends on beside the keyframes.
//!
//! The arrays behind the header are, for the Gaussians and Adam's two moments, position, rotation, ln scale, opacity and colour at 60 GHz; the
//! network's parameters and two moments; sums of the gradients on the screen, and the numbers of steps in them (whole numbers, exact in f32 up to
//! 2²⁴, which no sum between two changes comes to).

use super::field::{ARRAYS, arrays, gaussians, sizes};
use super::{Model, WrfGsPlusConfig, WrfGsPlusReconstructor};
use crate::mlp::Trained;
use crate::rf_3dgs::DensityCounts;
use corf::device::{DeviceState, ScreenGradient};
use corf::files::numbers;
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
        let norms: Vec<f32> = self.screen.iter().map(|g| g.norm_sum).collect();
        let steps: Vec<f32> = self.screen.iter().map(|g| g.steps as f32).collect();
        let state = &self.device;
        let mut all = vec![];
        for part in [&state.gaussians, &state.moments[0], &state.moments[1]] {
            all.extend(arrays(part));
        }
        let [first, second] = &self.network.moments;
        all.extend([&self.network.parameters[..], first, second, &norms, &steps]);
        numbers::write(path, &self.header, &all)
    }

    /// Reads one back.
    ///
    /// # Errors
    /// A file that is missing, damaged, or no checkpoint.
    pub fn read(path: &Path) -> Result<Self> {
        let (header, all) = numbers::read(path, |h: &Header| {
            h.config.validate()?;
            let network = Model::new(&h.config).network.parameters();
            let n = h.gaussians;
            Ok([&sizes(&h.config, n).repeat(3)[..], &[network, network, network, n, n]].concat())
        })?;
        let (of_gaussians, others) = all.split_at(3 * ARRAYS);
        let mut parts = of_gaussians.chunks_exact(ARRAYS).map(|a| gaussians(&header.config, a));
        let mut next = || parts.next().unwrap_or_else(|| header.config.empty_field());
        let (held, moments) = (next(), [next(), next()]);
        let [parameters, first, second, norms, steps] = others else { unreachable!("five were read") };
        let screen = norms.iter().zip(steps).map(|(n, s)| ScreenGradient { norm_sum: *n, steps: *s as u32 }).collect();
        let moments_of_network = [first.clone(), second.clone()];
        let network = Trained { parameters: parameters.clone(), moments: moments_of_network, steps: header.steps as u64 };
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
