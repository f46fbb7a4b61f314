//! The seam of matching: what is asked of images and poses, and nothing that is decided. Which pixels are matched, with which neighbours, around
//! which depths, and what becomes of those that find none stands above it ([`matching`](mod@super::matching), [`triangulate`](mod@super::triangulate)).

use super::held::HeldView;
use super::view::{GreyView, Neighbour};
use crate::{Result, config::DepthConfig};
use glam::Vec2;

/// Start of one pixel's search along its epipolar lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Column of the pixel, from 0 at the left.
    pub x: usize,
    /// Row of the pixel, from 0 at the top.
    pub y: usize,
    /// Inverse depth, 1/m, positive.
    pub guess: f32,
    /// Its change per pixel along columns and rows, 1/m.
    pub slope: Vec2,
}

/// What was found, and the time that a device of its own spent on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Found<T> {
    /// Of each question its answer, or those that there are, as the function says.
    pub depths: Vec<T>,
    /// Seconds of the device, 0 where that is the processor or keeps no time.
    pub device_s: f64,
}

impl<T> Found<T> {
    /// What the processor found.
    pub fn here(depths: Vec<T>) -> Self {
        Self { depths, device_s: 0.0 }
    }
}

/// Compares patches of a view with its neighbours. Answers depend on the arguments alone; those of two matchers differ by rounding, and where a score
/// lies within rounding of a threshold or of another score one may find what the other does not.
pub trait Matcher: Send + Sync {
    /// Copies a view to where it is matched, if there is room: it is matched in any case.
    ///
    /// # Errors
    /// The device's.
    fn hold(&self, view: &GreyView) -> Result<Option<HeldView>>;

    /// The matched inverse depth, 1/m, of each start within `range` (relative to its guess) in the full images; `None` where the gate refuses it.
    ///
    /// # Errors
    /// The device's.
    fn guided(
        &self,
        reference: &GreyView,
        neighbours: &[Neighbour<'_>],
        starts: &[Start],
        range: f64,
        config: &DepthConfig,
    ) -> Result<Found<Option<f32>>>;

    /// The unique best inverse depth, 1/m, of each pixel (column, row) of the coarse image that leads back to it; `None` where there is none.
    ///
    /// # Errors
    /// The device's.
    fn sweep(
        &self,
        reference: &GreyView,
        neighbours: &[Neighbour<'_>],
        pixels: &[(usize, usize)],
        config: &DepthConfig,
    ) -> Result<Found<Option<f32>>>;
}
