//! CORF-GS: real-time reconstruction of a radiance field and a wireless radiance field from keyframes, with Gaussians that share
//! geometry between light and radio and keep their own opacity and colour.
//!
//! `Reconstructor::push(K_t)` is the paper's update operator U; a [`device::Device`] does the arithmetic.

pub mod array;
mod checksum;
pub mod config;
pub mod depth;
pub mod device;
mod error;
pub mod expansion;
pub mod export;
pub mod field;
pub mod gaussians;
pub mod initial;
mod keyframe;
pub mod loss;
pub mod lpips;
mod matrix;
pub mod nerf2;
mod network;
pub mod nn;
pub mod offline;
pub mod optimizer;
pub mod ply;
mod real;
pub mod reconstructor;
#[cfg(test)]
#[path = "../../../tests/shared.rs"]
mod reference_data;
pub mod schedule;
pub mod sensor;
mod sh;
pub mod stage;
mod state_file;
#[cfg(test)]
mod synthetic;
pub mod target;
pub mod wrf_gs_plus;

pub use config::{Coupling, ReconstructionConfig, Sampling};
pub use device::{Device, cpu::CpuDevice};
pub use error::{Error, Result};
pub use field::{Field, FieldMeta, Prediction};
pub use gaussians::{Appearance, Gaussians};
pub use offline::{OfflineCheckpoint, OfflineConfig, OfflineReconstructor};
pub use optimizer::{Antialias, AppearanceRates, OptimizerConfig, RasterConfig};
pub use real::Real;
pub use reconstructor::{Checkpoint, KeyframeReport, KeyframeTiming, LatencySummary, Percentiles, Reconstructor};
pub use target::RfTarget;
