//! Scenes as other simulators read them, and data sets as other programs of reconstruction do.

mod file;
pub mod mitsuba;
pub mod nerfstudio;
mod ply;
pub mod rf_3dgs;
pub mod sionna;

pub use file::{File, FolderExport};
