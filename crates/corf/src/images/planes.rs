//! An image of any number of channels.

/// A `height × width × channels` f32 image, row-major, channels innermost.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Channels.
    pub channels: usize,
    /// `pixels[(y·width + x)·channels + c]`.
    pub pixels: Vec<f32>,
}
