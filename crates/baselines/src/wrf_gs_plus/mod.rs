//! WRF-GS+ (Wen et al. 2025), the baseline of deformable Gaussians: 3D Gaussian splatting of the spectra alone, of Gaussians that a network
//! deforms for each receiver. What varies is the receiver's position or, where the array stands still as in the paper, the transmitter's.
//!
//! [`WrfGsPlusModel`] is the network, [`Rule`] says what its predictions do to a Gaussian, a [`WrfGsPlusTrainer`] does the arithmetic ([`WrfGsPlusCpuTrainer`], or
//! `WrfGsPlusGpuTrainer` with the feature `gpu`; [`FixedArrayTrainer`] where the array stands still), and a [`WrfGsPlusReconstructor`] decides: views, rates, density control. Gaussians are of degree 0 and live
//! in the RF half of a [`Device`](corf::Device); light is not used.

mod checkpoint;
mod config;
mod cpu;
mod deformation;
mod field;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(all(test, feature = "gpu"))]
mod gpu_tests;
mod model;
mod reconstructor;
mod rule;
mod sphere;
#[cfg(test)]
mod tests;
mod trainer;

pub use checkpoint::WrfGsPlusCheckpoint;
pub use config::{WrfGsPlusConfig, WrfGsPlusRates};
pub use cpu::WrfGsPlusCpuTrainer;
pub use deformation::Deformation;
pub use field::WrfGsPlusField;
#[cfg(feature = "gpu")]
pub use gpu::WrfGsPlusGpuTrainer;
pub use model::WrfGsPlusModel;
pub use reconstructor::WrfGsPlusReconstructor;
pub use rule::{Offsets, Rule, Shape};
pub use sphere::FixedArrayTrainer;
pub use trainer::{DeformedStep, WrfGsPlusTrainer};
