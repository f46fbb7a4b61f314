//! Beam tracing: sequences of faces that light can run through. The beam that a mirror reflects meets, in part, the next face.

use crate::radio::candidates::chain::{Chain, repeats};
use crate::radio::geometry::Geometry;
use crate::radio::geometry::face::Face;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Beams are widened by this, metres: rounding loses no chain.
const MARGIN_M: f64 = 1e-6;
/// Most work for all sequences together, in faces held against a beam: some seconds of two cores.
const MOST_WORK: usize = 500_000_000;
/// Cost of a chain itself, in faces held against a beam: every receiver tries it.
const CHAIN_WORK: usize = 100;
/// Number of first faces from whose sequences the cost of all is estimated.
const SAMPLED: usize = 32;

/// Beam of an image source through its mirror, as a convex region of space: inside is where every n·x > offset.
pub struct ImageBeam {
    planes: Vec<(DVec3, f64)>,
}

impl ImageBeam {
    /// The beam from `image` through a parallelogram: a pyramid, cut off by the mirror.
    fn new(image: DVec3, mirror: &[DVec3; 4]) -> Self {
        let centre = (mirror[0] + mirror[2]) * 0.5;
        let towards = |normal: DVec3, point: DVec3, inside: DVec3| {
            let normal = normal.normalize_or_zero();
            let normal = if normal.dot(inside - point) < 0.0 { -normal } else { normal };
            (normal, normal.dot(point) - MARGIN_M)
        };
        let front = towards((mirror[1] - mirror[0]).cross(mirror[3] - mirror[0]), centre, centre + (centre - image));
        let side = |i: usize| towards((mirror[i] - image).cross(mirror[(i + 1) % 4] - image), image, centre);
        Self { planes: vec![front, side(0), side(1), side(2), side(3)] }
    }

    /// The beam from the image source behind the last face of a chain through all of its faces; all of space for an empty chain.
    pub fn of_chain(geometry: &Geometry<'_>, tx: DVec3, chain: &Chain) -> Self {
        let plane = |face: u32| &geometry.faces[face as usize];
        let Some((&first, others)) = chain.faces().split_first() else { return Self { planes: Vec::new() } };
        let mut image = plane(first).mirror(tx);
        let mut beam = Self::new(image, &plane(first).hull());
        for &face in others {
            image = plane(face).mirror(image);
            beam = beam.reflected(plane(face), image, &plane(face).hull());
        }
        beam
    }

    /// The part of this beam that a further mirror reflects: `image` is the image source behind that mirror.
    fn reflected(&self, face: &Face, image: DVec3, mirror: &[DVec3; 4]) -> Self {
        let mut next = Self::new(image, mirror);
        next.planes.extend(self.planes.iter().map(|(normal, offset)| {
            let along = 2.0 * normal.dot(face.normal);
            (*normal - face.normal * along, offset - along * face.offset_m)
        }));
        next
    }

    /// Whether some of a parallelogram may lie in the beam: no plane has all of it outside.
    pub fn meets(&self, hull: &[DVec3; 4]) -> bool {
        self.planes.iter().all(|(normal, offset)| hull.iter().any(|p| normal.dot(*p) > *offset))
    }
}

/// All sequences of up to `max_interactions` of the `allowed` faces that light from `tx` can run through, as far as beams tell; `None` where
/// that would be too much work, or more than `wanted` are found.
pub fn chains(geometry: &Geometry<'_>, tx: DVec3, allowed: &[u32], max_interactions: usize, wanted: usize) -> Option<Vec<Chain>> {
    let most = MOST_WORK.min(wanted.saturating_mul(CHAIN_WORK + allowed.len()));
    let search = Search {
        geometry,
        max_interactions,
        direct: Chain::line_of_sight(tx),
        hulls: allowed.iter().map(|&face| (face, geometry.faces[face as usize].hull())).collect(),
    };
    let step = allowed.len() / SAMPLED;
    if step > 1 {
        let work = AtomicUsize::new(0);
        let sample: Vec<usize> = (0..allowed.len()).step_by(step).collect();
        sample.par_iter().try_for_each(|&first| search.by(first, &work, most / step).map(drop))?;
    }
    let work = AtomicUsize::new(0);
    let found: Option<Vec<Vec<Chain>>> = (0..allowed.len()).into_par_iter().map(|first| search.by(first, &work, most)).collect();
    let found: Vec<Chain> = found?.into_iter().flatten().collect();
    (found.len() <= wanted).then_some(found)
}

struct Search<'s, 'a> {
    geometry: &'s Geometry<'a>,
    max_interactions: usize,
    direct: Chain,
    hulls: Vec<(u32, [DVec3; 4])>,
}

impl Search<'_, '_> {
    /// The chains that begin with one face; `None` once all threads' `work` is more than `most`. Whether it comes to that does not depend on
    /// who is first.
    fn by(&self, first: usize, work: &AtomicUsize, most: usize) -> Option<Vec<Chain>> {
        let (face, hull) = &self.hulls[first];
        let mut chains = Vec::new();
        if self.geometry.faces[*face as usize].distance(self.direct.image) == 0.0 {
            return Some(chains);
        }
        let chain = self.direct.pushed(*face, self.geometry);
        let mut stack = vec![(chain, ImageBeam::new(chain.image, hull))];
        while let Some((chain, beam)) = stack.pop() {
            chains.push(chain);
            let ends = chain.faces().len() == self.max_interactions;
            let cost = CHAIN_WORK + if ends { 0 } else { self.hulls.len() };
            if work.fetch_add(cost, Ordering::Relaxed) + cost > most {
                return None;
            }
            if ends {
                continue;
            }
            for (face, hull) in &self.hulls {
                let plane = &self.geometry.faces[*face as usize];
                if plane.distance(chain.image) != 0.0 && beam.meets(hull) && !repeats(self.geometry, &chain, *face) {
                    let next = chain.pushed(*face, self.geometry);
                    stack.push((next, beam.reflected(plane, next.image, hull)));
                }
            }
        }
        Some(chains)
    }
}
