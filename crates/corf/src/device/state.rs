//! State that is read back from a device: the outlines of its Gaussians, or Gaussians with their optimiser state.

use crate::{Error, Gaussians, Result};

/// Outline of a Gaussian: the parameters that pruning depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    /// Mean, metres, world frame.
    pub position: [f32; 3],
    /// ln of the largest standard deviation in metres.
    pub largest_log_scale: f32,
    /// Opacity logits in light and at 60 GHz.
    pub opacity_logit: [f32; 2],
}

impl Outline {
    /// Those of some Gaussians, in order.
    pub fn of(gaussians: &Gaussians) -> Vec<Self> {
        (0..gaussians.len())
            .map(|i| Self {
                position: gaussians.position[i],
                largest_log_scale: gaussians.log_scale[i].iter().fold(f32::MIN, |m, &s| m.max(s)),
                opacity_logit: [gaussians.light.opacity_logit[i], gaussians.radio.opacity_logit[i]],
            })
            .collect()
    }
}

/// Gaussians with the state of their optimiser: all that training depends on beside the views.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceState {
    /// The Gaussians.
    pub gaussians: Gaussians,
    /// Adam's first and second moments, in the Gaussians' shape.
    pub moments: [Gaussians; 2],
    /// Decay factor of each Gaussian's position learning rate, in `(0, 1]`; N.
    pub position_rate: Vec<f32>,
}

impl DeviceState {
    /// Refuses a state with parts missing, or for another device.
    pub(crate) fn check(&self, held: [(usize, usize); 2], already: usize) -> Result<()> {
        if already != 0 {
            let what = format!("the device holds {already} Gaussians");
            return Err(Error::invalid("restored state", what, "restore to a fresh device"));
        }
        for part in [&self.gaussians, &self.moments[0], &self.moments[1]] {
            part.check_appendable(held)?;
            if part.len() != self.gaussians.len() || self.position_rate.len() != self.gaussians.len() {
                let what =
                    format!("{} Gaussians, {} moments, {} rates", self.gaussians.len(), part.len(), self.position_rate.len());
                return Err(Error::invalid("restored state", what, "give one of each per Gaussian"));
            }
        }
        Ok(())
    }
}
