//! The methods that are compared: their interface, a file or folder each, and the list of them by name.

pub mod corf_array;
pub mod corf_gs;
pub mod family;
pub mod field;
mod initial;
pub mod interface;
pub mod lookup;
pub mod nerf2;
pub mod registry;
pub mod rf_3dgs;
pub mod stepwise;
pub mod wrf_gs_plus;

pub use family::merge;
pub use lookup::distance_m;
pub use registry::{abilities, create, find, names, without_retired};
