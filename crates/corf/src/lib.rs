//! CORF-GS: real-time reconstruction of a radiance field and a wireless radiance field from keyframes, with Gaussians that share
//! geometry between light and radio and keep their own opacity and colour.
//!
//! `Reconstructor::push(K_t)` is the paper's update operator U; a [`device::Device`] does the arithmetic.

pub mod array_field;
pub mod config;
pub mod depth;
pub mod device;
mod error;
pub mod expansion;
pub mod field;
pub mod files;
pub mod gaussians;
pub mod idle;
pub mod image_networks;
pub mod images;
pub mod keyframe;
pub mod loss;
pub mod numeric;
pub mod optimizer;
pub mod reconstructor;
#[cfg(test)]
#[path = "../../../tests/shared.rs"]
mod reference_data;
mod simd;
pub mod stage;
#[cfg(test)]
#[path = "../../../tests/synthetic.rs"]
mod synthetic;
pub mod target;

pub use config::{Coupling, ReconstructionConfig, Sampling};
pub use device::{Device, cpu::CpuDevice};
pub use error::{Error, Result};
pub use field::{Field, FieldMeta, FieldRendering};
pub use gaussians::{Appearance, Gaussians};
pub use idle::IdleKey;
pub use numeric::Real;
pub use optimizer::{Antialias, AppearanceRates, OptimizerConfig, RasterConfig};
pub use reconstructor::{Checkpoint, KeyframeReport, KeyframeTiming, LatencySummary, Percentiles, Reconstructor};
pub use target::RfTarget;
