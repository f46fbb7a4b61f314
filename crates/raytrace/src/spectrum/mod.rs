//! Angular power spectra, evaluated at each pixel's own direction of a pinhole camera.
//!
//! `mpc` splats every arrival with a narrow lobe and gives power per steradian; `bartlett` is what an 8 × 8 array measures by
//! noncoherent beamforming. Both are linear power relative to 1 W transmitted; decibels and Jet are views of it.

mod bartlett;
mod mpc;

pub use bartlett::{Bartlett, RearHalfSpace};
pub use mpc::mpc;

use crate::radio::Arrival;
use corf_scene::{Pinhole, Rigid3};

/// The share of the arriving power whose direction falls inside the camera's frame, in `[0, 1]`; 0 without any power.
pub fn share_in_frame(arrivals: &[Arrival], camera: &Pinhole, world_from_camera: &Rigid3) -> f64 {
    let camera_from_world = world_from_camera.rotation.transpose();
    let (mut inside, mut total) = (0.0, 0.0);
    for arrival in arrivals {
        total += arrival.power;
        let seen = camera.project(camera_from_world * arrival.direction);
        if seen.is_some_and(|p| p.x >= 0.0 && p.y >= 0.0 && p.x < camera.width as f64 && p.y < camera.height as f64) {
            inside += arrival.power;
        }
    }
    if total > 0.0 { inside / total } else { 0.0 }
}

/// The direction of every pixel's centre, camera frame, row-major.
fn pixel_directions(camera: &Pinhole) -> Vec<glam::DVec3> {
    (0..camera.width * camera.height).map(|i| camera.pixel_direction(i % camera.width, i / camera.width)).collect()
}
