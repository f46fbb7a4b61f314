//! Scenes as other simulators read them.

mod ply;
pub mod sionna;
