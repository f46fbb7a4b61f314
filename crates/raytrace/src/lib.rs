//! Simulation of a camera and a radio receiver by ray tracing: a bounding volume hierarchy over the scene's triangles, light (RGB, depth),
//! 60 GHz multipath components and angular power spectra.
//!
//! World frame: z up, metres. Nothing in this crate knows how a field is reconstructed; it hands over images, spectra and depth.

pub mod bvh;
pub mod light;
pub mod radio;
pub mod sensor;
pub mod sionna;
pub mod spectrum;

pub use bvh::{Bvh, Hit, Ray};
pub use light::{CacheSettings, LightCache, LightFrame, LightSettings, LightTracer, ViewSettings, develop, develop_frame};
