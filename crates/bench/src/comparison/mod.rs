//! What an experiment comes to: its tables and report, and constants chosen on validation keyframes.

pub mod archive;
pub mod density;
pub mod suite;
pub mod sweep;
