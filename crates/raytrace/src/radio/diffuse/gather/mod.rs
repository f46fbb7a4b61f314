//! Final gathering: what a receiver collects from the surfaces around it.

mod bins;
mod connect;
mod extent;
mod fireflies;
pub(super) mod image_receivers;
mod light_hit_tree;
pub(super) mod light_hits;
mod mis;
mod ray;
pub(super) mod refine;
mod sampling;
mod shade;
pub(super) mod small_faces;

pub use extent::WorldExtent;
pub(super) use ray::{DepthLayer, GatherTracer, Lattice};
