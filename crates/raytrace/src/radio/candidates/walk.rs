//! Rays that look for chains of mirrors: through mirrors and slabs from surface to surface.

use crate::bvh::Bvh;
use crate::radio::candidates::chain::{Chain, repeats};
use crate::radio::geometry::{Geometry, blocked};
use crate::radio::{
    MAX_INTERACTIONS, RadioSettings, Slab,
    field::{self, fresnel},
    lattice,
};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashSet;
use std::hash::Hash;

/// A wall that lets less than this share of power through at normal incidence ends a ray.
const TRANSPARENT_POWER: f64 = 1e-9;
/// Rays a task of a lattice follows.
const RAYS_PER_TASK: usize = 2048;
/// Clearance of a ray from the face it leaves, metres.
const CLEARANCE_M: f64 = 1e-4;

/// Result that rays look for: a chain, or a wedge reached by a chain.
pub trait SearchResult: Copy + Send {
    /// Sorting key, equal for equal results only.
    type Key: Ord + Hash + Send;
    /// Sorting key of this result.
    fn key(&self) -> Self::Key;
}

impl SearchResult for Chain {
    type Key = (u8, [u32; MAX_INTERACTIONS]);

    fn key(&self) -> Self::Key {
        self.sort_key()
    }
}

impl SearchResult for (u32, Chain) {
    type Key = (u32, <Chain as SearchResult>::Key);

    fn key(&self) -> Self::Key {
        (self.0, self.1.key())
    }
}

/// Sorted, without repeats; of equal keys all are alike.
pub fn distinct<T: SearchResult>(found: &mut Vec<T>) {
    found.par_sort_unstable_by_key(SearchResult::key);
    found.dedup_by_key(|f| f.key());
}

/// Set of the results that the rays of a task have found: they meet the same ones again and again.
pub struct SearchResults<T: SearchResult> {
    found: Vec<T>,
    keys: HashSet<T::Key>,
}

impl<T: SearchResult> Default for SearchResults<T> {
    fn default() -> Self {
        Self { found: Vec::new(), keys: HashSet::new() }
    }
}

impl<T: SearchResult> Extend<T> for SearchResults<T> {
    fn extend<I: IntoIterator<Item = T>>(&mut self, found: I) {
        self.found.extend(found.into_iter().filter(|finding| self.keys.insert(finding.key())));
    }
}

impl<T: SearchResult> SearchResults<T> {
    /// Number of results.
    pub fn len(&self) -> usize {
        self.found.len()
    }

    /// List of the results, in the order in which they were found.
    pub fn into_vec(self) -> Vec<T> {
        self.found
    }
}

/// A chain with the transmitter's images before each of its faces.
pub struct ChainImages<'c> {
    chain: &'c Chain,
    images: [DVec3; MAX_INTERACTIONS],
}

impl<'c> ChainImages<'c> {
    /// The images of a transmitter in the faces of a chain.
    pub fn new(geometry: &Geometry<'_>, tx: DVec3, chain: &'c Chain) -> Self {
        Self { chain, images: chain.images(geometry, tx) }
    }
}

/// A ray between two surfaces.
pub struct Leg {
    origin: DVec3,
    direction: DVec3,
    /// The faces bounced off before.
    chain: Chain,
    /// Mirrors and slabs before.
    interactions: usize,
}

/// Rays that are reflected and, where that is enabled, go straight through at every hit.
pub struct Walk<'w, 'a> {
    geometry: &'w Geometry<'a>,
    settings: &'w RadioSettings,
    /// Whether a material lets a ray through, by material.
    transparent: Vec<bool>,
    /// A tree of what does not.
    opaque: Option<Bvh>,
}

impl<'w, 'a> Walk<'w, 'a> {
    pub fn new(geometry: &'w Geometry<'a>, settings: &'w RadioSettings) -> Self {
        let passes = |slab: &Slab| fresnel::slab_response(slab, 1.0).t_te.norm_squared() > TRANSPARENT_POWER;
        let transparent = geometry.slabs.iter().map(|slab| settings.transmission && slab.as_ref().is_some_and(passes)).collect();
        Self { geometry, settings, transparent, opaque: None }
    }

    /// The same with a tree of its own of what blocks rays, for many of them: the answers stay what they are.
    pub fn with_opaque_tree(self) -> Self {
        let opaque = self.geometry.tree_of(|face| !self.transparent[self.geometry.faces[face as usize].material as usize]);
        Self { opaque, ..self }
    }

    /// Whether something opaque is between two points.
    fn is_blocked(&self, from: DVec3, to: DVec3) -> bool {
        match &self.opaque {
            Some(tree) => blocked(tree, from, to, CLEARANCE_M),
            None => self
                .geometry
                .occluded(from, to, CLEARANCE_M, |face| !self.transparent[self.geometry.faces[face as usize].material as usize]),
        }
    }

    /// The scene.
    pub fn geometry(&self) -> &'w Geometry<'a> {
        self.geometry
    }

    /// A chain with the reflection off what it meets, where there is one.
    pub fn mirrored(&self, chain: &Chain, triangle: u32) -> Option<Chain> {
        let face = self.geometry.face_of_triangle(triangle);
        let reflects =
            self.geometry.faces[face as usize].area_m2 >= self.settings.min_face_area_m2 && !repeats(self.geometry, chain, face);
        reflects.then(|| chain.pushed(face, self.geometry))
    }

    /// Whether a ray from the transmitter reaches a point of a chain's last face by way of the chain.
    pub fn lights(&self, way: &ChainImages<'_>, point: DVec3) -> bool {
        let geometry = self.geometry;
        let faces = way.chain.faces();
        let mut to = point;
        for i in (0..faces.len()).rev() {
            let from = if i == 0 {
                way.images[0]
            } else {
                let (face, image) = (&geometry.faces[faces[i - 1] as usize], way.images[i]);
                let (here, behind) = (face.distance(to), face.distance(image));
                if here * behind >= 0.0 {
                    return false;
                }
                let bounce = to + (image - to) * (here / (here - behind));
                if !face.contains(bounce) {
                    return false;
                }
                bounce
            };
            if self.is_blocked(from, to) {
                return false;
            }
            to = from;
        }
        true
    }

    /// Follows the ray that came to a point of a chain's last face by way of the chain, up to the greatest number of interactions; `visit`
    /// gets every hit, with the chain of faces bounced off before. `legs` is room, empty before and after.
    pub fn go_on(&self, way: &ChainImages<'_>, point: DVec3, legs: &mut Vec<Leg>, visit: impl FnMut(&Chain, u32)) {
        if let Some(direction) = (point - way.chain.image).try_normalize() {
            legs.push(Leg { origin: point, direction, chain: *way.chain, interactions: way.chain.faces().len() });
            self.follow(legs, visit);
        }
    }

    fn follow(&self, legs: &mut Vec<Leg>, mut visit: impl FnMut(&Chain, u32)) {
        while let Some(Leg { origin, direction, chain, interactions }) = legs.pop() {
            let Some((t, triangle)) = self.geometry.closest(origin, direction, CLEARANCE_M) else { continue };
            visit(&chain, triangle);
            let interactions = interactions + 1;
            if interactions >= self.settings.max_interactions {
                continue;
            }
            let face = &self.geometry.faces[self.geometry.face_of_triangle(triangle) as usize];
            let origin = origin + direction * t;
            if self.transparent[face.material as usize] {
                legs.push(Leg { origin, direction, chain, interactions });
            }
            if self.settings.reflection
                && let Some(chain) = self.mirrored(&chain, triangle)
            {
                legs.push(Leg { origin, direction: field::mirrored(direction, face.normal), chain, interactions });
            }
        }
    }

    /// Follows a lattice of rays as in [`Self::go_on`]; what `visit` adds to the findings comes back sorted and without repeats.
    pub fn lattice<T: SearchResult>(
        &self,
        from: DVec3,
        rays: usize,
        visit: impl Fn(&mut SearchResults<T>, &Chain, u32) + Sync,
    ) -> Vec<T> {
        let per_task: Vec<Vec<T>> = (0..rays.div_ceil(RAYS_PER_TASK))
            .into_par_iter()
            .map(|task| {
                let (mut found, mut legs) = (SearchResults::default(), Vec::new());
                for i in task * RAYS_PER_TASK..((task + 1) * RAYS_PER_TASK).min(rays) {
                    let direction = lattice::fibonacci(i, rays);
                    legs.push(Leg { origin: from, direction, chain: Chain::line_of_sight(from), interactions: 0 });
                    self.follow(&mut legs, |chain, triangle| visit(&mut found, chain, triangle));
                }
                found.into_vec()
            })
            .collect();
        let mut found = per_task.concat();
        distinct(&mut found);
        found
    }
}
