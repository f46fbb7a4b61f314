//! Where the transmitter's own rays fall: the other half of what a receiver sees lit straight from the transmitter.
//!
//! A receiver's directions meet a surface with p_r = N_r cosθ_s / (4π r₂²) points per area. Of one that it sees edge-on they meet next to
//! nothing, and what they meet counts for 1/cosθ_s: where that surface is brightly lit, all error of the received power is made there. Rays
//! that leave the transmitter evenly meet it with p_t = N_t cosθ_i / (4π r₁²), as densely as it is lit. Every point is shared between the
//! two by p_t/p_r alone (multiple importance sampling, Veach and Guibas 1995), so that both together count it once and neither has a pole.

use super::illumination::{CLEARANCE_M, Illumination, Lighting, Source};
use super::in_tasks;
use super::places::Places;
use crate::radio::geometry::{Face, Meeting};
use crate::radio::lattice::Directions;
use glam::DVec3;

/// A point that the transmitter lights, straight or through slabs.
#[derive(Clone, Copy, Debug)]
pub struct Landing {
    /// On the face's plane.
    pub point: DVec3,
    /// What was met.
    pub face: u32,
    /// How it is lit.
    pub lighting: Lighting,
    /// The transmitter's height above the face over its distance³, 1/m², of the sign of the side that it lights.
    pub density_per_m2: f64,
}

/// All of a transmitter's.
pub struct Landings {
    /// Near ones together.
    pub all: Vec<Landing>,
    /// Where they are.
    pub places: Places,
}

/// Follows rays that leave the transmitter evenly, along the directions of a receiver, through slabs as far as interactions allow, to all that scatters.
pub fn trace(illumination: &Illumination<'_, '_>, directions: &Directions) -> Landings {
    let all = all(illumination, directions);
    let places = Places::new(illumination.geometry(), &all);
    Landings { all, places }
}

fn all(illumination: &Illumination<'_, '_>, directions: &Directions) -> Vec<Landing> {
    let Some(slabs) = illumination.slab_budget(Source::transmitter(illumination.tx), 0) else { return Vec::new() };
    let geometry = illumination.geometry();
    in_tasks(directions.along(), |numbers| {
        let mut landings = Vec::new();
        for direction in numbers.iter().map(|&number| directions.of(number as usize)) {
            let mut origin = illumination.tx;
            for crossed in 0..=slabs {
                let Some(Meeting { face, point, .. }) = geometry.meet(origin, direction, CLEARANCE_M) else { break };
                let lighting = if crossed == 0 { Lighting::Free } else { Lighting::ThroughSlabs };
                if geometry.slab(face).scattering.coefficient > 0.0 {
                    let density_per_m2 = density(&geometry.faces[face as usize], illumination.tx, point);
                    landings.push(Landing { point, face, lighting, density_per_m2 });
                }
                if illumination.is_opaque(face) {
                    break;
                }
                origin = point;
            }
        }
        landings
    })
}

/// cosθ/r² of a point of a face seen from elsewhere, 1/m², with the sign of the side that is seen.
pub fn density(plane: &Face, from: DVec3, point: DVec3) -> f64 {
    let distance2 = from.distance_squared(point);
    plane.distance(from) / (distance2 * distance2.sqrt())
}

/// The transmitter's share of a point that its rays meet `density_ratio` = p_t/p_r times as densely as the receiver's; the receiver's is
/// what is missing to 1. None up to equal densities: most points are the receiver's alone, and need no shadow rays.
pub fn share(density_ratio: f64) -> f64 {
    let more = (density_ratio - 1.0).max(0.0);
    if more.is_finite() { more * more / (1.0 + more * more) } else { 1.0 }
}
