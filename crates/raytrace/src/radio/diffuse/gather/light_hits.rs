//! Hits of the transmitter's own rays: the second sampling technique for surfaces lit straight from the transmitter, beside a receiver's
//! directions.
//!
//! A receiver's directions meet a surface with p_r = N_r cosθ_s / (4π r₂²) points per area. Of one that it sees edge-on they meet next to
//! nothing, and what they meet counts for 1/cosθ_s: where that surface is brightly lit, all error of the received power is made there. Rays
//! that leave the transmitter evenly meet it with p_t = N_t cosθ_i / (4π r₁²), as densely as it is lit. Every point is shared between the
//! two by p_t/p_r alone (multiple importance sampling, Veach and Guibas 1995), so that both together count it once and neither has a pole.

use super::light_hit_tree::{LightHit, LightHitTree};
use super::mis::density;
use crate::radio::diffuse::in_tasks;
use crate::radio::diffuse::light::illumination::{CLEARANCE_M, Illumination, IlluminationSource, Lighting};
use crate::radio::geometry::SurfaceHit;
use crate::radio::lattice::Directions;

/// All hits of a transmitter's rays.
pub struct LightHits {
    /// List of the hits, near ones together.
    pub all: Vec<LightHit>,
    /// Bounding volume hierarchy over their positions.
    pub tree: LightHitTree,
}

/// Follows rays that leave the transmitter evenly, along the directions of a receiver, through slabs as far as interactions allow, to all that
/// scatters.
pub fn trace(illumination: &Illumination<'_, '_>, directions: &Directions) -> LightHits {
    let all = all(illumination, directions);
    let tree = LightHitTree::new(illumination.geometry(), &all);
    LightHits { all, tree }
}

fn all(illumination: &Illumination<'_, '_>, directions: &Directions) -> Vec<LightHit> {
    let Some(slabs) = illumination.slab_budget(IlluminationSource::transmitter(illumination.tx), 0) else { return Vec::new() };
    let geometry = illumination.geometry();
    in_tasks(directions.along(), |numbers| {
        let mut light_hits = Vec::new();
        for direction in numbers.iter().map(|&number| directions.of(number as usize)) {
            let mut origin = illumination.tx;
            for crossed in 0..=slabs {
                let Some(SurfaceHit { face, point, .. }) = geometry.intersect(origin, direction, CLEARANCE_M) else { break };
                let lighting = if crossed == 0 { Lighting::Free } else { Lighting::ThroughSlabs };
                if geometry.slab(face).scattering.coefficient > 0.0 {
                    let density_per_m2 = density(&geometry.faces[face as usize], illumination.tx, point);
                    light_hits.push(LightHit { point, face, lighting, density_per_m2 });
                }
                if illumination.is_opaque(face) {
                    break;
                }
                origin = point;
            }
        }
        light_hits
    })
}
