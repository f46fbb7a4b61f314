//! What work costs as it grows, measured.

pub mod scale;
pub mod workload;
