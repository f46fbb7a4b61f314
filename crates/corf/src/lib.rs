//! CORF-GS: real-time reconstruction of a radiance field and a wireless radiance field from keyframes, with Gaussians that share
//! geometry between light and radio and keep their own opacity and colour.
//!
//! `Reconstructor::push(K_t)` is the paper's update operator U; a [`device::Device`] does the arithmetic.
//!
//! ```no_run
//! use corf::{CpuDevice, OptimizerConfig, RasterConfig, ReconstructionConfig, Reconstructor};
//! use corf_scene::dataset::Dataset;
//!
//! let dataset = Dataset::open("data/mini")?; // of `corf dataset generate` or `corf dataset import`
//! let config = ReconstructionConfig::default();
//! let device = CpuDevice::new(OptimizerConfig::default(), RasterConfig::default(), &config.empty_field())?;
//! let (light, radio, range) = (dataset.light_camera(), dataset.radio_camera(), dataset.db_range().ok_or("no spectra")?);
//! let mut reconstructor = Reconstructor::new(Box::new(device), config, light, radio, range, 1)?;
//! for index in 0..dataset.len() {
//!     reconstructor.push(&dataset.keyframe(index)?)?;
//! }
//! let seen = reconstructor.render(dataset.keyframe(0)?.world_from_camera)?; // image and spectrum at any pose
//! # Ok::<_, Box<dyn std::error::Error>>(())
//! ```

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
pub use reconstructor::{
    Checkpoint, KeyframeReport, KeyframeTiming, LatencySummary, Percentiles, RadioOnGeometry, Reconstructor,
};
pub use target::RadioTarget;
