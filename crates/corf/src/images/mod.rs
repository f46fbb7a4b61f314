//! Images of several channels, and where one has detail.

pub(crate) mod jet;
pub(crate) mod laplacian_of_gaussian;
mod planes;

pub use planes::Planes;
