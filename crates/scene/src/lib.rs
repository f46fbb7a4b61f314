//! Model of the scene: geometry, optical and radio materials, cameras, trajectories, the builders of the lobby and the office,
//! glTF/OBJ import and the keyframe dataset on disk.
//!
//! World frame: right-handed, z up, metres. Camera frame: OpenCV axes (x right, y down, z forward).
//! Transforms are named `target_from_source`.

pub mod bounds;
mod builder;
pub mod camera;
pub mod capture;
pub mod color;
pub mod config;
pub mod contained;
pub mod dataset;
pub mod draw;
mod error;
pub mod export;
pub mod far;
pub mod finding;
pub mod fingerprint;
mod guard;
pub mod import;
pub mod info;
pub mod io;
pub mod itu;
pub mod keyframe;
pub mod live;
pub mod lobby;
pub mod lock;
pub mod model;
pub mod near_field;
pub mod npz;
pub mod office;
pub mod overlaps;
pub mod radio_check;
pub mod radio_spec;
pub mod raster;
pub mod rng;
pub mod solids;
pub mod trajectory;
pub mod transform;

pub use camera::{Equirectangular, Pinhole};
pub use error::{Error, Result};
pub use finding::{Finding, Severity};
pub use keyframe::{Keyframe, Light, Radio};
pub use model::Scene;
pub use raster::Raster;
pub use rng::Rng;
pub use transform::{Rigid3, Similarity3};
