//! Optical-guided expansion: where new Gaussians are needed, what they start as, and which old ones make room.

pub mod initial;
pub mod prune;
pub mod spawn;
