//! Simulation of a camera and a radio receiver by ray tracing: a bounding volume hierarchy over the scene's triangles, light (RGB, depth),
//! 60 GHz multipath components and angular power spectra.
//!
//! World frame: z up, metres. Nothing in this crate knows how a field is reconstructed; it hands over images, spectra and depth.
//!
//! ```
//! use corf_raytrace::Bvh;
//! use corf_raytrace::radio::{RadioSettings, RadioTracer};
//! use corf_scene::config::SceneConfig;
//!
//! let config = SceneConfig::load("../../scenes/room.toml")?; // from this crate's folder
//! let (scene, _findings) = config.load_scene()?;
//! let bvh = Bvh::build(&scene);
//! let settings = RadioSettings { frequency_hz: 60e9, max_interactions: 2, ..RadioSettings::default() };
//! let paths = RadioTracer::new(&scene, &bvh, settings)?.paths(config.transmitter.position(), glam::DVec3::new(1.2, 1.4, 1.5))?;
//! let sight = paths.iter().find(|path| path.interactions.is_empty()).expect("nothing stands between them");
//! let friis = (settings.wavelength_m() / (4.0 * std::f64::consts::PI * sight.length_m)).powi(2);
//! assert!((sight.power() / friis - 1.0).abs() < 1e-9);
//! assert!(paths.iter().any(|path| path.types() == "S"), "walls mirror the transmitter"); // S: one specular reflection
//! # Ok::<_, corf_scene::Error>(())
//! ```

pub mod bvh;
pub mod light;
pub mod radio;
pub mod sensor;
pub mod sionna;
pub mod spectrum;

pub use bvh::{Bvh, Hit, Ray};
pub use light::{CacheSettings, LightCache, LightFrame, LightSettings, LightTracer, ViewSettings, develop, develop_frame};
