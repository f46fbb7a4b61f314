//! The live folder: keyframes that land one by one while somebody reconstructs from them.
//!
//! ```text
//! DIR/capture.toml        what is the same for all keyframes: cameras, dB range; lands first
//! DIR/images/NAME.png     (or .jpg, .jpeg)
//! DIR/spectra/NAME.exr    (or .npy) linear power
//! DIR/depth/NAME.exr      (or .npy) z-depth in metres, where there is one
//! DIR/poses/NAME.json     lands last and makes the keyframe complete
//! DIR/end                 no keyframe follows
//! ```
//!
//! NAME is a number, a counter or a time stamp: numbers rise along the trajectory. Every file is written under another name (one that does not
//! end as these do, or begins with a point) and renamed.

mod description;
mod frame;

pub use description::{DESCRIPTION, LIVE_SCHEMA, LiveDescription};
pub use frame::{LiveFrame, number_of, pose_text};

/// Folder of the pose files, which make keyframes complete.
pub const POSES: &str = "poses";
/// Folder of the images.
pub const IMAGES: &str = "images";
/// Folder of the spectra.
pub const SPECTRA: &str = "spectra";
/// Folder of the depth maps.
pub const DEPTH: &str = "depth";
/// File that says that no keyframe follows.
pub const END: &str = "end";
