//! Charts: one canvas, one kind of axes, and what is drawn over them. Every figure is made of these.
//!
//! ```text
//! svg.rs         shapes, text and embedded pictures in pixels
//! scale.rs       axes, linear, logarithmic and of angles: places and ticks
//! plot.rs        a frame between two axes: lines, points, intervals, bars, a picture, a legend, a colour bar
//! panels.rs      pictures of directions side by side, with axes in degrees, colour bars and peaks
//! keyframe.rs    a spectrum, a prediction, or a keyframe beside its prediction, in such panels
//! quality.rs     quality over time
//! latency.rs     what a live run's keyframes waited for
//! colour_map.rs  colours of levels and of errors
//! errors.rs      errors of predicted pictures
//! embed.rs       pictures as data URIs
//! ```
//!
//! A figure is an [`Svg`]; [`Plot::new`] lays axes into a part of it, and as many of them as there are panels.

mod colour_map;
mod embed;
mod errors;
mod keyframe;
mod latency;
mod panels;
mod plot;
mod quality;
mod scale;
mod svg;

pub use colour_map::{ColourMap, diverging, heat};
pub use embed::{picture_uri, png_uri};
pub use errors::{ERROR_DB, ERROR_LIGHT, image_error, spectrum_error};
pub use keyframe::{Sensors, keyframe, prediction, spectrum, uncertainty};
pub use latency::{KeyframeLatency, latency};
pub use plot::{AxesFrame, Corner, LegendMark, Plot};
pub use quality::quality;
pub use scale::{Scale, extent};
pub use svg::{Anchor, Colour, Stroke, Svg, text_width, without_size};

/// Text and axes.
pub const INK: Colour = [27, 35, 48];
/// What stands back behind the rest: ticks, explanations.
pub const DIM: Colour = [93, 106, 124];
/// Lines of a grid.
pub const GRID: Colour = [228, 232, 237];
/// The ground.
pub const WHITE: Colour = [255; 3];

/// Colours of rows, in the plan's order.
pub const PALETTE: [Colour; 14] = [
    [10, 90, 208],
    [232, 89, 12],
    [43, 138, 62],
    [194, 37, 92],
    [103, 65, 217],
    [90, 100, 115],
    [12, 133, 153],
    [150, 110, 20],
    [224, 49, 170],
    [116, 184, 22],
    [77, 171, 247],
    [134, 46, 20],
    [250, 176, 5],
    [20, 20, 20],
];
