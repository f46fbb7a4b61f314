//! Edges and what they do to a field: which there are, where on one the stationary point lies, and the uniform theory of diffraction.

mod cover;
mod erfcx;
mod mesh_edges;
mod utd;
mod wedges;

pub use utd::{DiffractionModel, transition};
pub(super) use utd::{EdgeFace, EdgeRay, diffract, keller_point};
pub use wedges::{Wedge, Wedges};
