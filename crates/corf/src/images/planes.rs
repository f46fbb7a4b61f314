//! An image of any number of channels.

/// A `height × width × channels` f32 image, row-major, channels innermost.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    /// Pixels in a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Numbers of a pixel.
    pub channels: usize,
    /// `pixels[(y·width + x)·channels + c]`.
    pub pixels: Vec<f32>,
}
