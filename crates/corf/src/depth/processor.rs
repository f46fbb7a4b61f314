//! Matching on the processor, a pixel a task.

use super::{
    held::HeldView,
    matcher::{Found, Matcher, Start},
    matching::match_pixel,
    triangulate::sweep_pixel,
    view::{GreyView, Neighbour},
};
use crate::{Result, config::DepthConfig};
use rayon::prelude::*;

/// Matches on the processor.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProcessorMatcher;

impl Matcher for ProcessorMatcher {
    fn hold(&self, _view: &GreyView) -> Result<Option<HeldView>> {
        Ok(None)
    }

    fn guided(
        &self,
        reference: &GreyView,
        neighbours: &[Neighbour<'_>],
        starts: &[Start],
        range: f64,
        config: &DepthConfig,
    ) -> Result<Found<Option<f32>>> {
        let found = starts.par_iter().map(|start| match_pixel(reference, neighbours, start, range, config));
        Ok(Found::here(found.collect()))
    }

    fn sweep(
        &self,
        reference: &GreyView,
        neighbours: &[Neighbour<'_>],
        pixels: &[(usize, usize)],
        config: &DepthConfig,
    ) -> Result<Found<Option<f32>>> {
        let found = pixels.par_iter().map(|&(x, y)| sweep_pixel(reference, neighbours, x, y, config));
        Ok(Found::here(found.collect()))
    }
}
