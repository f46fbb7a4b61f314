//! Which faces a specular path may bounce off, in order: candidates for the exact image method.

use super::beams::{self, Beam};
use super::diffraction::Wedges;
use super::geometry::Geometry;
use super::{MAX_DEPTH, RadioSettings, Search, Slab, field, fresnel, lattice};
use glam::DVec3;
use rayon::prelude::*;

/// A wall that lets less than this share of power through at normal incidence ends a lattice ray.
const TRANSPARENT_POWER: f64 = 1e-9;
/// Rays a task of the lattice search handles.
const RAYS_PER_TASK: usize = 2048;
/// Chains a task continues.
const CHAINS_PER_TASK: usize = 128;
/// Rays that go on from a square metre of a face that the transmitter lights straight, in shares of the lattice's; least and most …
const FROM_FIRST: Density = Density { per_m2: 0.05, least: 8, most: 1024 };
/// … and from the last face of a chain of several, …
const FROM_LATER: Density = Density { per_m2: 0.0125, least: 8, most: 256 };
/// … as long as all chains of a length together take no more than this many times the lattice's; none have less than one.
const CONTINUING_RAYS: usize = 64;
/// Smaller faces are neither continued from nor looked for, m²: what they mirror is left to the lattice.
const SMALL_FACE_M2: f64 = 1e-4;
/// Every face lit by way of a face at least this large is looked for, m².
const LARGE_FACE_M2: f64 = 0.1;
/// … at this many points of it …
const POINTS_PER_FACE: usize = 8;
/// … by way of the largest ones, with no more pairs than this to look at.
const LARGE_FACE_PAIRS: usize = 200_000_000;
/// Clearance of a lattice ray from the face it leaves, metres.
const CLEARANCE_M: f64 = 1e-4;

/// How many rays go on from the last faces of chains.
struct Density {
    per_m2: f64,
    least: usize,
    most: usize,
}

impl Density {
    /// By chain; `rays` are the lattice's.
    fn counts(&self, geometry: &Geometry<'_>, chains: &[Chain], rays: usize) -> Vec<usize> {
        let area_m2 = |chain: &Chain| chain.faces().last().map_or(0.0, |&last| geometry.faces[last as usize].area_m2);
        let count = |chain: &Chain| ((area_m2(chain) * self.per_m2 * rays as f64) as usize).clamp(self.least, self.most);
        let mut counts: Vec<usize> = chains.iter().map(count).collect();
        let share = (CONTINUING_RAYS * rays) as f64 / counts.iter().sum::<usize>().max(1) as f64;
        if share < 1.0 {
            counts.iter_mut().for_each(|n| *n = ((*n as f64 * share) as usize).max(1));
        }
        counts
    }
}

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

    /// With one more face.
    pub fn pushed(&self, face: u32, geometry: &Geometry<'_>) -> Self {
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

/// Every chain worth trying from a transmitter, the line of sight aside, without repeats.
pub fn candidates(geometry: &Geometry<'_>, tx: DVec3, settings: &RadioSettings) -> Vec<Chain> {
    all(geometry, tx, settings, usize::MAX).unwrap_or_else(|| by_rays(geometry, tx, settings, settings.search.rays()))
}

/// The same where every chain that light can run through is among them; `None` where a lattice is asked for, or there are too many: more
/// than `wanted`, unless an exhaustive search is.
pub fn all(geometry: &Geometry<'_>, tx: DVec3, settings: &RadioSettings, wanted: usize) -> Option<Vec<Chain>> {
    if !settings.reflection || settings.max_depth == 0 {
        return Some(Vec::new());
    }
    let allowed = mirrors(geometry, settings);
    match settings.search {
        Search::Exhaustive => Some(exhaustive(geometry, tx, &allowed, settings.max_depth)),
        Search::Auto { .. } => beams::chains(geometry, tx, &allowed, settings.max_depth, wanted),
        Search::Lattice { .. } => None,
    }
}

/// The faces large enough to be asked for.
fn mirrors(geometry: &Geometry<'_>, settings: &RadioSettings) -> Vec<u32> {
    let least_m2 = settings.min_face_area_m2.max(f64::MIN_POSITIVE);
    (0..geometry.faces.len() as u32).filter(|&f| geometry.faces[f as usize].area_m2 >= least_m2).collect()
}

/// The chains that rays run through, and faces lit by way of large ones.
fn by_rays(geometry: &Geometry<'_>, tx: DVec3, settings: &RadioSettings, rays: usize) -> Vec<Chain> {
    let allowed = &mirrors(geometry, settings);
    let mut chains = exhaustive(geometry, tx, allowed, 1);
    chains.extend(from_lattice(geometry, tx, settings, rays));
    if settings.max_depth >= 2 {
        chains.extend(by_large_faces(geometry, tx, settings, allowed));
    }
    distinct(&mut chains);
    for length in 1..settings.max_depth {
        let goes_on = |c: &&Chain| c.faces().len() == length && narrows(geometry, c);
        let found: Vec<Chain> = chains.iter().filter(goes_on).copied().collect();
        let density = if length == 1 { FROM_FIRST } else { FROM_LATER };
        chains.extend(continued(geometry, tx, settings, &found, &density.counts(geometry, &found, rays)));
        distinct(&mut chains);
    }
    chains
}

/// All sequences up to `max_depth` of faces in different planes, one to the next: the oracle.
fn exhaustive(geometry: &Geometry<'_>, tx: DVec3, allowed: &[u32], max_depth: usize) -> Vec<Chain> {
    let mut chains = Vec::new();
    let mut frontier = vec![Chain::line_of_sight(tx)];
    for _ in 0..max_depth {
        let mut next = Vec::with_capacity(frontier.len() * allowed.len());
        for chain in &frontier {
            for &face in allowed {
                let f = &geometry.faces[face as usize];
                // A source in a plane does not bounce off it.
                if f.distance(chain.image) != 0.0 && !repeats(geometry, chain, face) {
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
    let walk = Walk::new(geometry, settings);
    walk.lattice(tx, rays, distinct, |found, chain, triangle| found.extend(walk.mirrored(chain, triangle)))
}

/// Whether the last face of a chain is its smallest, and not too small: what is lit by way of a smaller one before is a part of the last
/// that points spread over all of it may miss, and is seen by the rays that went on from the smaller one.
fn narrows(geometry: &Geometry<'_>, chain: &Chain) -> bool {
    let area = |&face: &u32| geometry.faces[face as usize].area_m2;
    chain
        .faces()
        .last()
        .is_some_and(|last| area(last) >= SMALL_FACE_M2 && chain.faces().iter().all(|face| area(face) >= area(last)))
}

fn distinct(chains: &mut Vec<Chain>) {
    chains.sort_by_key(Chain::key);
    chains.dedup_by_key(|c| c.key());
}

/// The chains that light can run through from so many points spread over the last face of each chain: a lattice from the transmitter
/// puts too few rays on small and narrow faces to see all that they mirror.
fn continued(geometry: &Geometry<'_>, tx: DVec3, settings: &RadioSettings, chains: &[Chain], counts: &[usize]) -> Vec<Chain> {
    let walk = Walk::new(geometry, settings);
    let found: Vec<Vec<Chain>> = chains
        .par_chunks(CHAINS_PER_TASK)
        .zip(counts.par_chunks(CHAINS_PER_TASK))
        .map(|(chunk, counts)| {
            let mut found = Vec::new();
            for (chain, &count) in chunk.iter().zip(counts) {
                let Some(&last) = chain.faces().last() else { continue };
                for point in geometry.faces[last as usize].spread(count) {
                    let Some(direction) = (point - chain.image).try_normalize() else { continue };
                    if is_lit(geometry, tx, chain, point, &walk.transparent) {
                        let leg = Leg { origin: point, direction, chain: *chain, interactions: chain.faces().len() };
                        walk.follow(leg, &mut |chain, triangle| found.extend(walk.mirrored(chain, triangle)));
                    }
                }
            }
            distinct(&mut found);
            found
        })
        .collect();
    found.into_iter().flatten().collect()
}

/// The chains of two faces of which the first is large, and the second is lit by way of it at one of a few points.
fn by_large_faces(geometry: &Geometry<'_>, tx: DVec3, settings: &RadioSettings, allowed: &[u32]) -> Vec<Chain> {
    let transparent = transparent(geometry, settings);
    let area = |face: u32| geometry.faces[face as usize].area_m2;
    let hulls: Vec<(u32, [DVec3; 4])> = allowed
        .iter()
        .filter(|&&face| area(face) >= SMALL_FACE_M2)
        .map(|&face| (face, geometry.faces[face as usize].hull()))
        .collect();
    let mut large: Vec<&(u32, [DVec3; 4])> = hulls
        .iter()
        .filter(|(face, _)| area(*face) >= LARGE_FACE_M2 && geometry.faces[*face as usize].distance(tx) != 0.0)
        .collect();
    large.sort_by(|a, b| area(b.0).total_cmp(&area(a.0)).then(a.0.cmp(&b.0)));
    large.truncate(LARGE_FACE_PAIRS / hulls.len().max(1));
    let found: Vec<Vec<Chain>> = large
        .par_iter()
        .map(|(first, hull)| {
            let chain = Chain::line_of_sight(tx).pushed(*first, geometry);
            let beam = Beam::new(chain.image, hull);
            let in_beam = hulls.iter().filter(|(second, hull)| beam.meets(hull) && !repeats(geometry, &chain, *second));
            let lit = in_beam.map(|(second, _)| chain.pushed(*second, geometry)).filter(|chain| {
                let points = chain.faces().last().map(|&last| geometry.faces[last as usize].spread(POINTS_PER_FACE));
                points.into_iter().flatten().any(|point| is_lit(geometry, tx, chain, point, &transparent))
            });
            lit.collect()
        })
        .collect();
    found.into_iter().flatten().collect()
}

/// Whether a ray from the transmitter reaches a point of a chain's last face by way of the chain.
fn is_lit(geometry: &Geometry<'_>, tx: DVec3, chain: &Chain, point: DVec3, transparent: &[bool]) -> bool {
    let faces = chain.faces();
    let mut images = [tx; MAX_DEPTH];
    for i in 1..faces.len() {
        images[i] = geometry.faces[faces[i - 1] as usize].mirror(images[i - 1]);
    }
    let mut to = point;
    for i in (0..faces.len()).rev() {
        let from = if i == 0 {
            tx
        } else {
            let face = &geometry.faces[faces[i - 1] as usize];
            let (here, behind) = (face.distance(to), face.distance(images[i]));
            if here * behind >= 0.0 {
                return false;
            }
            let bounce = to + (images[i] - to) * (here / (here - behind));
            if !face.contains(bounce) {
                return false;
            }
            bounce
        };
        let opaque = |face: u32| !transparent[geometry.faces[face as usize].material as usize];
        if geometry.occluded(from, to, CLEARANCE_M, opaque) {
            return false;
        }
        to = from;
    }
    true
}

/// Which materials let a lattice ray through.
fn transparent(geometry: &Geometry<'_>, settings: &RadioSettings) -> Vec<bool> {
    let passes = |slab: &Slab| fresnel::slab_response(slab, 1.0).t_te.norm_squared() > TRANSPARENT_POWER;
    geometry.slabs.iter().map(|slab| settings.transmission && slab.as_ref().is_some_and(passes)).collect()
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
    let distinct = |found: &mut Vec<(u32, Chain)>| {
        found.sort_by_key(key);
        found.dedup_by_key(|f| key(f));
    };
    Walk::new(geometry, settings).lattice(from, rays, distinct, |found, chain, triangle| {
        found.extend(wedges.of_triangle(triangle).map(|wedge| (wedge, *chain)));
    })
}

/// Whether a face lies in the plane of the last bounce: nothing bounces off a plane twice in a row.
pub fn repeats(geometry: &Geometry<'_>, chain: &Chain, face: u32) -> bool {
    let Some(&last) = chain.faces().last() else { return false };
    last == face || geometry.faces[last as usize].shares_plane(&geometry.faces[face as usize])
}

/// A ray between two surfaces.
struct Leg {
    origin: DVec3,
    direction: DVec3,
    /// The faces bounced off before.
    chain: Chain,
    /// Mirrors and slabs before.
    interactions: usize,
}

/// Rays that are reflected and, where that is enabled, go straight through at every hit.
struct Walk<'w, 'a> {
    geometry: &'w Geometry<'a>,
    settings: &'w RadioSettings,
    /// By material: whether it lets a ray through.
    transparent: Vec<bool>,
}

impl<'w, 'a> Walk<'w, 'a> {
    fn new(geometry: &'w Geometry<'a>, settings: &'w RadioSettings) -> Self {
        Self { geometry, settings, transparent: transparent(geometry, settings) }
    }

    /// A chain with the reflection off what it meets, where there is one.
    fn mirrored(&self, chain: &Chain, triangle: u32) -> Option<Chain> {
        let face = self.geometry.face_of_triangle(triangle);
        let reflects =
            self.geometry.faces[face as usize].area_m2 >= self.settings.min_face_area_m2 && !repeats(self.geometry, chain, face);
        reflects.then(|| chain.pushed(face, self.geometry))
    }

    /// Follows a ray up to the greatest number of interactions; `visit` gets every hit, with the chain of faces bounced off before.
    fn follow(&self, first: Leg, visit: &mut impl FnMut(&Chain, u32)) {
        let mut legs = vec![first];
        while let Some(Leg { origin, direction, chain, interactions }) = legs.pop() {
            let Some((t, triangle)) = self.geometry.closest(origin, direction, CLEARANCE_M) else { continue };
            visit(&chain, triangle);
            let interactions = interactions + 1;
            if interactions >= self.settings.max_depth {
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

    /// Follows a lattice of rays; `visit` gets every hit as in [`Self::follow`] and adds to the findings, which are made `distinct`.
    fn lattice<T: Send>(
        &self,
        from: DVec3,
        rays: usize,
        distinct: impl Fn(&mut Vec<T>) + Sync,
        visit: impl Fn(&mut Vec<T>, &Chain, u32) + Sync,
    ) -> Vec<T> {
        let per_task: Vec<Vec<T>> = (0..rays.div_ceil(RAYS_PER_TASK))
            .into_par_iter()
            .map(|task| {
                let mut found = Vec::new();
                for i in task * RAYS_PER_TASK..((task + 1) * RAYS_PER_TASK).min(rays) {
                    let direction = lattice::fibonacci(i, rays);
                    let leg = Leg { origin: from, direction, chain: Chain::line_of_sight(from), interactions: 0 };
                    self.follow(leg, &mut |chain, triangle| visit(&mut found, chain, triangle));
                }
                distinct(&mut found);
                found
            })
            .collect();
        let mut found = per_task.into_iter().flatten().collect();
        distinct(&mut found);
        found
    }
}
