//! Pictures along poses: where from, and as a video.

pub mod poses;
pub mod video;
