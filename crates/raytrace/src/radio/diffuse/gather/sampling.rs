//! Density of a receiver's directions.

/// Directions along a cell's side, at most, where neighbouring directions disagree.
pub const MOST_ALONG_SIDE: usize = 8;
/// Directions to one where a lattice that is refined sees something bright edge-on and meets it often enough.
pub const REFINED: f64 = (MOST_ALONG_SIDE * MOST_ALONG_SIDE) as f64;

/// The directions of a receiver that one of them belongs to.
#[derive(Clone, Copy, Debug)]
pub struct DirectionSampling {
    /// Over the whole sphere.
    pub count: usize,
    /// Whether more are added where these disagree, some [`REFINED`] to one at the outlines of bright things.
    pub refined: bool,
}

impl DirectionSampling {
    /// Directions to a steradian.
    pub fn per_sr(self) -> f64 {
        self.count as f64 / (4.0 * std::f64::consts::PI)
    }
}
