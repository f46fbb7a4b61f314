//! CORF-GS: real-time reconstruction of a radiance field and a wireless radiance field from keyframes, with Gaussians that share
//! geometry between light and radio and keep their own opacity and colour.
//!
//! `Reconstructor::push(K_t)` is the paper's update operator U; a [`device::Device`] does the arithmetic.

pub mod device;
mod error;
pub mod gaussians;
pub mod optimizer;

pub use device::Device;
pub use error::{Error, Result};
pub use gaussians::{Appearance, Gaussians};
pub use optimizer::{Antialias, AppearanceRates, OptimizerConfig, RasterConfig};
