//! Which faces a specular path may bounce off, in order: candidates for the exact image method.

use super::diffraction::Wedges;
use super::geometry::Geometry;
use super::{MAX_DEPTH, RadioSettings, Search, field, fresnel, lattice};
use glam::DVec3;
use rayon::prelude::*;

/// With no more chains than this, all of them are tried.
const EXHAUSTIVE_CHAINS: usize = 400_000;
/// A wall that lets less than this share of power through at normal incidence ends a lattice ray.
const TRANSPARENT_POWER: f64 = 1e-9;
/// Rays a task of the lattice search handles.
const RAYS_PER_TASK: usize = 2048;
/// Clearance of a lattice ray from the face it leaves, metres.
const CLEARANCE_M: f64 = 1e-4;

/// The faces of a specular path in TX → RX order, with the transmitter's image behind the last one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain {
    faces: [u32; MAX_DEPTH],
    length: u8,
    /// The transmitter mirrored in every face in turn.
    pub image: DVec3,
}

impl Chain {
    /// The faces, TX → RX.
    pub fn faces(&self) -> &[u32] {
        &self.faces[..self.length as usize]
    }

    /// The line of sight: no face at all.
    pub fn line_of_sight(tx: DVec3) -> Self {
        Self { faces: [u32::MAX; MAX_DEPTH], length: 0, image: tx }
    }

    fn pushed(&self, face: u32, geometry: &Geometry<'_>) -> Self {
        let mut next = *self;
        next.faces[self.length as usize] = face;
        next.length += 1;
        next.image = geometry.faces[face as usize].mirror(self.image);
        next
    }

    fn key(&self) -> (u8, [u32; MAX_DEPTH]) {
        (self.length, self.faces)
    }
}

/// Every chain worth trying from a transmitter, the line of sight aside, sorted and without repeats.
pub fn candidates(geometry: &Geometry<'_>, tx: DVec3, settings: &RadioSettings) -> Vec<Chain> {
    if !settings.reflection || settings.max_depth == 0 {
        return Vec::new();
    }
    let allowed: Vec<u32> = (0..geometry.faces.len() as u32)
        .filter(|&f| geometry.faces[f as usize].area_m2 >= settings.min_face_area_m2.max(f64::MIN_POSITIVE))
        .collect();
    let count = (1..=settings.max_depth as u32).fold(0usize, |n, depth| n.saturating_add(allowed.len().saturating_pow(depth)));
    match settings.search {
        Search::Exhaustive => exhaustive(geometry, tx, &allowed, settings.max_depth),
        Search::Auto { .. } if count <= EXHAUSTIVE_CHAINS => exhaustive(geometry, tx, &allowed, settings.max_depth),
        Search::Auto { rays } | Search::Lattice { rays } => {
            let mut chains = exhaustive(geometry, tx, &allowed, 1);
            chains.extend(from_lattice(geometry, tx, settings, rays));
            chains.sort_by_key(Chain::key);
            chains.dedup_by_key(|c| c.key());
            chains
        }
    }
}

/// All sequences of distinct neighbours up to `max_depth`: the oracle.
fn exhaustive(geometry: &Geometry<'_>, tx: DVec3, allowed: &[u32], max_depth: usize) -> Vec<Chain> {
    let mut chains = Vec::new();
    let mut frontier = vec![Chain::line_of_sight(tx)];
    for _ in 0..max_depth {
        let mut next = Vec::with_capacity(frontier.len() * allowed.len());
        for chain in &frontier {
            for &face in allowed {
                let f = &geometry.faces[face as usize];
                // A plane cannot be bounced off twice in a row, nor by a source in it.
                if chain.faces().last() != Some(&face) && f.distance(chain.image) != 0.0 {
                    next.push(chain.pushed(face, geometry));
                }
            }
        }
        chains.extend_from_slice(&next);
        frontier = next;
    }
    chains
}

/// The chains that a lattice of rays from the transmitter runs through, reflected and, when enabled, transmitted at every hit.
fn from_lattice(geometry: &Geometry<'_>, tx: DVec3, settings: &RadioSettings, rays: usize) -> Vec<Chain> {
    let mut found = walk_lattice(geometry, tx, settings, rays, |found, chain, triangle| {
        let face = geometry.face_of_triangle(triangle);
        if reflects(geometry, settings, chain, face) {
            found.push(chain.pushed(face, geometry));
        }
    });
    found.sort_by_key(Chain::key);
    found.dedup_by_key(|c| c.key());
    found
}

/// The wedges that a lattice of rays from a point comes by, each with the chain it bounced off before, sorted and without repeats.
pub fn wedges_from_lattice(
    geometry: &Geometry<'_>,
    wedges: &Wedges,
    from: DVec3,
    settings: &RadioSettings,
    rays: usize,
) -> Vec<(u32, Chain)> {
    let key = |(wedge, chain): &(u32, Chain)| (*wedge, chain.key());
    let mut found = walk_lattice(geometry, from, settings, rays, |found, chain, triangle| {
        found.extend(wedges.of_triangle(triangle).map(|wedge| (wedge, *chain)));
    });
    found.sort_by_key(key);
    found.dedup_by_key(|f| key(f));
    found
}

fn reflects(geometry: &Geometry<'_>, settings: &RadioSettings, chain: &Chain, face: u32) -> bool {
    geometry.faces[face as usize].area_m2 >= settings.min_face_area_m2 && chain.faces().last() != Some(&face)
}

/// Shoots the lattice; `visit` gets every hit, with the chain of faces bounced off before, and adds to the findings of its task.
fn walk_lattice<T: Send>(
    geometry: &Geometry<'_>,
    from: DVec3,
    settings: &RadioSettings,
    rays: usize,
    visit: impl Fn(&mut Vec<T>, &Chain, u32) + Sync,
) -> Vec<T> {
    let transparent: Vec<bool> = geometry
        .slabs
        .iter()
        .map(|slab| {
            settings.transmission
                && slab.as_ref().is_some_and(|slab| fresnel::slab_response(slab, 1.0).t_te.norm_squared() > TRANSPARENT_POWER)
        })
        .collect();
    let tasks = rays.div_ceil(RAYS_PER_TASK);
    let per_task: Vec<Vec<T>> = (0..tasks)
        .into_par_iter()
        .map(|task| {
            let mut found = Vec::new();
            let mut stack: Vec<(DVec3, DVec3, Chain, usize)> = Vec::new();
            for i in task * RAYS_PER_TASK..((task + 1) * RAYS_PER_TASK).min(rays) {
                stack.push((from, lattice::fibonacci(i, rays), Chain::line_of_sight(from), 0));
                while let Some((origin, direction, chain, interactions)) = stack.pop() {
                    let Some((t, triangle)) = geometry.closest(origin, direction, CLEARANCE_M) else { continue };
                    let face_index = geometry.face_of_triangle(triangle);
                    let face = &geometry.faces[face_index as usize];
                    let point = origin + direction * t;
                    visit(&mut found, &chain, triangle);
                    if interactions + 1 >= settings.max_depth {
                        continue;
                    }
                    if transparent[face.material as usize] {
                        stack.push((point, direction, chain, interactions + 1));
                    }
                    if settings.reflection && reflects(geometry, settings, &chain, face_index) {
                        let next = chain.pushed(face_index, geometry);
                        stack.push((point, field::mirrored(direction, face.normal), next, interactions + 1));
                    }
                }
            }
            found
        })
        .collect();
    per_task.into_iter().flatten().collect()
}
