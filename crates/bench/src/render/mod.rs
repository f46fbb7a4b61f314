//! Pictures along poses: where from, and as a video.

mod pose_text;
pub mod poses;
pub mod video;
