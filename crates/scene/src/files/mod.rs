//! Files: whole or not at all, within bounds, kept to their folder, one run an output folder.

pub mod contained;
pub(crate) mod guard;
pub mod io;
pub mod lock;
pub mod npz;
