//! Paths: a candidate's bounces on the geometry, and the field along them.

pub(in crate::radio) mod edges;
pub(in crate::radio) mod joints;
pub(in crate::radio) mod path;
pub(in crate::radio) mod ray_path;
