//! Scenes as other simulators read them.

pub mod mitsuba;
mod ply;
pub mod sionna;
