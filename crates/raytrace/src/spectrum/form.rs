//! A spectrum of any kind from a receiver's arrivals.

use super::mvdr::Mvdr;
use super::snapshots::Aperture;
use super::{Bartlett, Grid, mpc};
use crate::radio::{Arrival, PlanarArray};
use corf_scene::config::{Elements, RearHalfSpace, ReceiverConfig, SpectrumConfig, SpectrumKind};
use corf_scene::model::{ARRAY_FROM_CAMERA, world_from_array};
use corf_scene::{Raster, Rigid3};
use glam::DVec3;
use rayon::prelude::*;

/// Kind of an angular power spectrum, and the array that forms it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpectrumSettings {
    /// The kind.
    pub kind: SpectrumKind,
    /// The elements, in the platform's array frame; `mpc` needs none.
    pub array: PlanarArray,
    /// Responses of the elements, where each has its own; beams are steered by the phases of their places all the same.
    pub elements: Option<Elements>,
    /// Treatment of arrivals from behind the array; without effect on `mpc`, which knows every arrival's direction.
    pub rear: RearHalfSpace,
    /// Standard deviation of an `mpc` lobe, degrees per axis.
    pub lobe_width_deg: f64,
    /// B of the coherent kinds: delays are told apart to 1/B, Hz.
    pub bandwidth_hz: f64,
    /// Diagonal loading of `mvdr`, in units of the covariance's mean eigenvalue.
    pub loading: f64,
    /// Seed of the phases that arrivals without one are given in the coherent kinds.
    pub seed: u64,
}

impl SpectrumSettings {
    /// The settings that a dataset's `[rf]` and its scene's `[receiver]` ask for.
    pub fn new(radio: &SpectrumConfig, receiver: &ReceiverConfig, seed: u64) -> Self {
        Self {
            kind: radio.spectrum,
            array: PlanarArray::from(receiver),
            elements: receiver.pattern.elements(),
            rear: receiver.rear,
            lobe_width_deg: radio.lobe_width_deg,
            bandwidth_hz: radio.bandwidth_hz,
            loading: radio.mvdr_loading,
            seed,
        }
    }

    /// The spectrum at every pixel of a grid, linear; the array shares its frame with the camera, boresight along the optical axis.
    ///
    /// `port_pairs` are the arrivals of every pair of antenna ports ([`super::port_pairs()`]); diffuse power belongs into any one of them.
    pub fn form(&self, port_pairs: &[Vec<Arrival>], grid: impl Into<Grid>, world_from_camera: &Rigid3) -> Raster<f32> {
        let grid: Grid = grid.into();
        let array_from_camera = ARRAY_FROM_CAMERA.rotation;
        let aperture = Aperture {
            array: self.array,
            world_from_array: world_from_array(world_from_camera),
            rear: self.rear,
            elements: self.elements,
        };
        let evaluate = |power: &(dyn Fn(DVec3) -> f64 + Sync)| {
            let at = |u: DVec3| if self.rear == RearHalfSpace::Gated && u.x <= 0.0 { 0.0 } else { power(u) };
            let pixels = grid.directions().into_par_iter().map(|d| at(array_from_camera * d) as f32).collect();
            Raster::from_vec(grid.width(), grid.height(), pixels)
        };
        match self.kind {
            SpectrumKind::Mpc => mpc(&port_pairs.concat(), grid, world_from_camera, self.lobe_width_deg),
            SpectrumKind::Bartlett => {
                let bartlett = Bartlett::noncoherent(&aperture, &port_pairs.concat());
                evaluate(&|u| bartlett.power(u))
            }
            SpectrumKind::BartlettCoherent => {
                let bartlett = Bartlett::coherent(&aperture, port_pairs, self.bandwidth_hz, self.seed);
                evaluate(&|u| bartlett.power(u))
            }
            SpectrumKind::Mvdr => {
                let mvdr = Mvdr::new(self.array, aperture.covariance(port_pairs, self.bandwidth_hz, self.seed), self.loading);
                evaluate(&|u| mvdr.power(u))
            }
        }
    }
}
