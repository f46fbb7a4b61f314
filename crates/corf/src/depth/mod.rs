//! Depth for new Gaussians: a dense prior, its robust alignment to triangulated depths, and guided multi-view matching.
//!
//! Poses are known, so matching is a search along epipolar lines with zero-mean normalised cross-correlation (ZNCC). Everything
//! works in inverse z-depth (1/m). Neighbours are training keyframes only; the caller passes no others.

pub mod align;
pub mod correct;
pub mod dense;
pub mod folder;
pub mod held;
pub mod matcher;
pub mod matching;
pub mod patch;
pub mod prior;
pub mod processor;
pub mod quality;
pub mod triangulate;
pub mod view;

pub use align::{AlignedPrior, align};
pub use correct::Correction;
pub use dense::Dense;
pub(crate) use dense::fill;
pub use held::HeldView;
pub use matcher::{Found, Matcher, Start};
pub use matching::{match_guided, match_wide};
pub use patch::{GreyImage, Patch};
pub use prior::DepthPrior;
pub use processor::ProcessorMatcher;
pub use quality::{DepthErrors, DepthQuality, DepthTally};
pub use triangulate::{SparseDepth, triangulate};
pub use view::{GreyView, Neighbour, select_neighbours};

/// Reliability class of a depth, by its source; the initial opacity follows from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reliability {
    /// An accurate multi-view match.
    Accurate,
    /// The aligned prior alone.
    Prior,
    /// A triangulated corner.
    Triangulated,
}

/// The depth of one optical pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelDepth {
    /// Column of the pixel, from 0 at the left.
    pub x: usize,
    /// Row of the pixel, from 0 at the top.
    pub y: usize,
    /// 1/z, 1/m.
    pub inverse_depth: f32,
    /// Its reliability class, by its source.
    pub reliability: Reliability,
}

#[cfg(test)]
mod tests;
