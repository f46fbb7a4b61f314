//! Model of the scene: geometry, optical and radio materials, cameras, trajectories, the builders of the lobby and the office,
//! glTF/OBJ import and the keyframe dataset on disk.
//!
//! World frame: right-handed, z up, metres. Camera frame: OpenCV axes (x right, y down, z forward).
//! Transforms are named `target_from_source`.
//!
//! ```
//! use corf_scene::{config::SceneConfig, trajectory};
//!
//! let config = SceneConfig::load("../../scenes/room.toml")?; // from this crate's folder
//! let (scene, _findings) = config.load_scene()?;
//! assert!(scene.materials_without_radio().is_empty());
//! let room = scene.bounds().expect("the scene has triangles");
//! for pose in trajectory::generate(config.trajectory.as_ref().expect("the file has a trajectory"), 4)? {
//!     let camera = pose.world_from_camera.translation.as_vec3();
//!     assert!(camera.cmpge(room.min).all() && camera.cmple(room.max).all(), "{camera} m is outside of the room");
//! }
//! # Ok::<_, corf_scene::Error>(())
//! ```

pub mod capture;
pub mod color;
pub mod config;
pub mod dataset;
mod error;
pub mod export;
pub mod files;
pub mod finding;
pub mod geometry;
pub mod import;
pub mod keyframe;
pub mod limits;
pub mod live;
pub mod materials;
pub mod model;
pub mod raster;
pub mod rng;
pub mod rooms;
pub mod trajectory;
pub mod words;

pub use camera::{Equirectangular, Pinhole};
pub use error::{Error, Result};
pub(crate) use files::guard;
pub use files::{contained, io, lock, npz};
pub use finding::{Finding, Severity};
pub use geometry::{camera, transform};
pub use keyframe::{Keyframe, Light, Radio};
pub use limits::{bounds, far, near_field};
pub use materials::{itu, radio_check, radio_spec};
pub use model::Scene;
pub(crate) use model::parts;
pub use model::{fingerprint, info, mounting, overlaps, solids};
pub use raster::Raster;
pub use rng::Rng;
pub(crate) use rooms::builder;
pub use rooms::{draw, lobby, office};
pub use transform::{Rigid3, Similarity3};
