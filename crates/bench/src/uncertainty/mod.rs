//! How far predicted decibels may be off: a standard deviation for every pixel of a predicted spectrum, from what the prediction and the training
//! keyframes around it look like, at the cost of one rendering a training keyframe.
//!
//! ```text
//! signs.rs        what is looked at around a pixel: five numbers
//! fit.rs          the weights of the signs that make held-out errors most likely
//! calibration.rs  the file that holds them: fitted on held-out keyframes, applied to any run of the method
//! coverage.rs     how often errors lie within the intervals that are claimed, and how wide these are
//! next.rs         the poses of a way that are worth measuring
//! ```

mod calibration;
mod coverage;
mod fit;
mod next;
mod signs;

pub use calibration::{Calibration, Examples};
pub use coverage::{Coverage, FrameCoverage, Judged};
pub use next::{Worth, next};
pub use signs::{Known, Signs, TrainingKeyframes};

/// Share of errors that intervals are to hold.
pub const NOMINAL: f64 = 0.9;
