//! Exposed area of a patch's sides: furniture stands on the floor and panels cover a wall, and light that falls on the rest of a patch does
//! not belong to the covered part.

use super::illumination::CLEARANCE_M;
use super::patches::Patches;
use crate::radio::geometry::Geometry;
use glam::DVec3;
use rayon::prelude::*;

/// Surfaces closer together than this leave no way for light between them, metres.
const CONTACT_M: f64 = 5e-3;

/// Exposed part of one side of a patch.
#[derive(Clone, Copy, Debug, Default)]
pub struct Exposed {
    /// Exposed area, m²; a side that is covered all over keeps the patch's.
    pub area_m2: f64,
    /// Whether all of it is covered.
    pub sealed: bool,
    /// The subcells that make up the area, a bit each; none where the face meets no subcell's centre.
    pub subcells: u32,
}

/// Exposed parts of both sides of every patch, that of the face's normal first.
pub fn exposed(geometry: &Geometry<'_>, patches: &Patches) -> Vec<[Exposed; 2]> {
    let per_face: Vec<Vec<(usize, [Exposed; 2])>> = geometry
        .faces
        .par_iter()
        .enumerate()
        .map(|(index, face)| {
            let sides = |(patch, _)| {
                let subcells: Vec<(usize, DVec3)> = patches.subcells(face, index as u32, patch).collect();
                let bits = |open: &dyn Fn(DVec3) -> bool| {
                    subcells.iter().filter(|(_, point)| open(*point)).fold(0u32, |bits, (subcell, _)| bits | 1 << subcell)
                };
                let area_m2 = patches.areas_m2()[patch];
                let side = |sign: f64| {
                    let open = bits(&|p| !geometry.covered(p, face.normal * sign, CONTACT_M, CLEARANCE_M));
                    if open == 0 {
                        // Nothing arrives, but for what passes through what covers it.
                        Exposed { area_m2, sealed: !subcells.is_empty(), subcells: bits(&|_| true) }
                    } else {
                        let share = f64::from(open.count_ones()) / subcells.len() as f64;
                        Exposed { area_m2: area_m2 * share, sealed: false, subcells: open }
                    }
                };
                (patch, [1.0, -1.0].map(side))
            };
            patches.of_face(index as u32).map(sides).collect()
        })
        .collect();
    let mut all = vec![[Exposed::default(); 2]; patches.len()];
    per_face.into_iter().flatten().for_each(|(patch, sides)| all[patch] = sides);
    all
}
