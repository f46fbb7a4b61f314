//! An experiment: a plan, its cells, and how they are run here or on a cluster.

pub(crate) mod cell_clock;
pub mod cells;
pub mod cluster;
pub mod plan;
