//! Angular power spectra over the pixels of a pinhole camera or over the whole sphere.
//!
//! | kind | value | resolution |
//! |---|---|---|
//! | `mpc` | power per steradian: every arrival splatted with a narrow lobe of unit integral | the lobe's |
//! | `bartlett` | a steered beam's output, noncoherent: the mean over the arrivals' phases | the array's |
//! | `bartlett-coherent` | the same, coherent within a delay tap, with speckle | the array's |
//! | `mvdr` | Capon's estimate from the covariance over delay taps | finer than the array's |
//!
//! All are linear power relative to 1 W transmitted; decibels and Jet are views of it. An arrival from an element's direction u brings the
//! element's own gain along; steering vectors are those of isotropic elements, so that a lone path reads as its |a|² in every beam kind.

mod bartlett;
mod form;
mod grid;
mod hermitian;
mod lags;
mod lobe;
mod mpc;
mod mvdr;
mod narrow;
mod port_pairs;
mod snapshots;
#[cfg(test)]
mod tests;

pub use bartlett::{Bartlett, RearHalfSpace};
pub use form::SpectrumSettings;
pub use grid::Grid;
pub use mpc::mpc;
pub use port_pairs::port_pairs;

use crate::radio::Arrival;
use corf_scene::{Pinhole, Rigid3};

/// The share of the arriving power whose direction falls inside the camera's frame, in `[0, 1]`; 0 without any power.
pub fn share_in_frame(arrivals: &[Arrival], camera: &Pinhole, world_from_camera: &Rigid3) -> f64 {
    let camera_from_world = world_from_camera.rotation.transpose();
    let grid = Grid::from(camera);
    let (mut inside, mut total) = (0.0, 0.0);
    for arrival in arrivals {
        total += arrival.power;
        if grid.contains(camera_from_world * arrival.direction) {
            inside += arrival.power;
        }
    }
    if total > 0.0 { inside / total } else { 0.0 }
}
