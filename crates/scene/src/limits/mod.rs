//! The bounds within which numbers, coordinates and distances are accepted.

pub mod bounds;
pub mod far;
pub mod near_field;
