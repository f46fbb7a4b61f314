//! Networks that look at images by others' weights: LPIPS (on a GPU as well), Depth-Anything-V2, and what both are made of: maps and layers.

pub mod depth_anything;
mod layer;
pub mod lpips;

pub(crate) use layer::{Layer, Map, MaxPool, Window};
