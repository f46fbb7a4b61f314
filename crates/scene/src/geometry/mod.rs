//! Cameras and rigid transforms.

pub mod camera;
pub mod transform;
