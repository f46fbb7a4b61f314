//! The baselines that CORF-GS is compared with, as published: RF-3DGS ([`rf_3dgs`]), NeRF² ([`nerf2`]) and WRF-GS+ ([`wrf_gs_plus`]), and the
//! networks of the latter two ([`mlp`]). Splatting is that of [`corf::device`]; nothing in `corf` knows of them.
//!
//! ```no_run
//! use corf::CpuDevice;
//! use corf_baselines::rf_3dgs::{Rf3dgsConfig, Rf3dgsReconstructor};
//! use corf_scene::dataset::Dataset;
//!
//! let dataset = Dataset::open("data/mini")?; // of `corf dataset generate` or `corf dataset import`
//! let config = Rf3dgsConfig::default();
//! let device = CpuDevice::new(config.optimizer(), config.raster(), &config.empty_field())?;
//! let (light, radio, range) = (dataset.light_camera(), dataset.radio_camera(), dataset.db_range().ok_or("no spectra")?);
//! let mut reconstructor = Rf3dgsReconstructor::new(Box::new(device), config, light, radio, range, 1)?;
//! for index in 0..dataset.len() {
//!     reconstructor.receive(dataset.keyframe(index)?)?;
//! }
//! reconstructor.begin()?;
//! while reconstructor.train(100)?.is_some() {}
//! let field = reconstructor.field()?;
//! # Ok::<_, Box<dyn std::error::Error>>(())
//! ```

pub mod mlp;
pub mod nerf2;
pub mod rf_3dgs;
mod stage;
#[cfg(test)]
#[path = "../../../tests/synthetic.rs"]
mod synthetic;
pub mod wrf_gs_plus;
