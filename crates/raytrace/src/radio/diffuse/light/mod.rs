//! Light at the surfaces: what the transmitter and its mirror images send there, and what photons bring and leave in a cache.

pub(super) mod cache;
mod coverage;
mod emission;
pub(super) mod illumination;
mod nodes;
pub(super) mod patches;
pub(super) mod photons;
mod pilot;
mod shrinkage;
mod subcells;
mod surface_records;
mod trace;
