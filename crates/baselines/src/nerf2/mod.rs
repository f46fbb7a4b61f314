//! NeRF² (Zhao et al. 2023), the implicit baseline: one network says for every point how it attenuates a wave and turns its phase, and what it
//! sends into a direction; a pixel of the spectrum is the magnitude of the complex sum along its ray.
//!
//! [`Nerf2Model`] is the network, [`rendering`] the sum and its gradient, [`TrainingRays`] what it is trained on, and a [`Nerf2Trainer`] does the
//! arithmetic: [`Nerf2CpuTrainer`], or `Nerf2GpuTrainer` with the feature `gpu`. Positions are in metres in the world frame, as in the published code.

mod config;
mod cpu;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(all(test, feature = "gpu"))]
mod gpu_tests;
mod model;
mod rays;
pub mod rendering;
#[cfg(test)]
mod tests;
mod trainer;

pub use config::{Nerf2Config, PUBLISHED_RAYS_M};
pub use cpu::Nerf2CpuTrainer;
#[cfg(feature = "gpu")]
pub use gpu::Nerf2GpuTrainer;
pub use model::Nerf2Model;
pub use rays::{Batch, PixelRay, Sight, TrainingRays};
pub use trainer::{Nerf2Trainer, TrainedNerf2};
