//! Candidate chains for specular paths: sequences of faces to bounce off, for the exact image method to check.

use crate::radio::candidates::beams::{self, ImageBeam};
use crate::radio::candidates::chain::{Chain, repeats};
use crate::radio::candidates::walk::{ChainImages, Leg, SearchResults, Walk, distinct};
use crate::radio::geometry::Geometry;
use crate::radio::{RadioSettings, Search};
use glam::DVec3;
use rayon::prelude::*;

/// Chains a task continues.
const CHAINS_PER_TASK: usize = 128;
/// Ray density on a face that the transmitter lights directly, for chains to continue from there: rays per square metre as a share of the
/// lattice's rays; least and most of a face, all of them in one pass.
const FROM_FIRST: Density = Density { per_m2: 0.05, least: 16, most: 1024, first_pass: 1024 };
/// Ray density on the last face of a chain of several, likewise.
const FROM_LATER: Density = Density { per_m2: 0.00625, least: 4, most: 128, first_pass: 8 };
/// Most rays that continue all chains of one length together, in multiples of the lattice's; every chain has at least one.
const CONTINUING_RAYS: usize = 64;
/// Least area of a face that chains are continued from or looked for at, m²: smaller mirrors are left to the lattice.
const SMALL_FACE_M2: f64 = 1e-4;
/// Direct search for faces lit by way of one large face.
const BY_ONE: Large = Large { least_m2: 0.1, points: 8, most_pairs: 200_000_000 };
/// Direct search for faces lit by way of several large faces.
const BY_SEVERAL: Large = Large { least_m2: 3.0, points: 1, most_pairs: 20_000_000 };

/// Direct search for the next faces of chains: the faces that chains must consist of, and the sampling of the faces looked for.
struct Large {
    /// Every face of the chain has at least this area, m².
    least_m2: f64,
    /// Points of the face looked for, of which one has to be lit.
    points: usize,
    /// Most chains times faces to look at; those of the largest faces come first.
    most_pairs: usize,
}

/// Density of the rays that continue from the last faces of chains.
struct Density {
    per_m2: f64,
    least: usize,
    most: usize,
    /// Rays in the first pass over a face. Every further pass doubles them, between those before; one that finds nothing new where light
    /// falls is the last.
    first_pass: usize,
}

impl Density {
    /// Number of rays that continue each chain; `rays` are the lattice's.
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

    /// The chains that light can run through from points spread over the last face of each, in lists: a lattice from the transmitter
    /// puts too few rays on small and narrow faces to see all that they mirror.
    fn continued(&self, walk: &Walk<'_, '_>, tx: DVec3, chains: &[Chain], rays: usize) -> Vec<Vec<Chain>> {
        let counts = self.counts(walk.geometry(), chains, rays);
        chains
            .par_chunks(CHAINS_PER_TASK)
            .zip(counts.par_chunks(CHAINS_PER_TASK))
            .map(|(chunk, counts)| {
                let (mut found, mut legs) = (SearchResults::default(), Vec::new());
                for (chain, &count) in chunk.iter().zip(counts) {
                    let Some(&last) = chain.faces().last() else { continue };
                    let points = walk.geometry().faces[last as usize].spread(count);
                    self.go_on(walk, &ChainImages::new(walk.geometry(), tx, chain), &points, &mut legs, &mut found);
                }
                found.into_vec()
            })
            .collect()
    }

    /// Sends rays on from points of the last face on a way, pass after pass.
    fn go_on(
        &self,
        walk: &Walk<'_, '_>,
        way: &ChainImages<'_>,
        points: &[DVec3],
        legs: &mut Vec<Leg>,
        found: &mut SearchResults<Chain>,
    ) {
        let (count, step) = (points.len(), golden_step(points.len()));
        let (mut tried, mut pass) = (0, self.first_pass);
        while tried < count {
            let (before, mut lit) = (found.len(), false);
            for point in (tried..pass.min(count)).map(|i| points[i * step % count]) {
                if walk.lights(way, point) {
                    lit = true;
                    walk.go_on(way, point, legs, |chain, triangle| found.extend(walk.mirrored(chain, triangle)));
                }
            }
            if lit && found.len() == before {
                break;
            }
            (tried, pass) = (pass, 2 * pass);
        }
    }
}

/// Every chain worth trying from a transmitter, the line of sight aside, without repeats.
pub fn candidates(geometry: &Geometry<'_>, tx: DVec3, settings: &RadioSettings) -> Vec<Chain> {
    all(geometry, tx, settings, usize::MAX).unwrap_or_else(|| by_rays(geometry, tx, settings, settings.search.rays()))
}

/// Every chain that light can run through; `None` where the search is by a lattice of rays, or where there are more than `wanted` chains
/// and the search is not exhaustive.
pub fn all(geometry: &Geometry<'_>, tx: DVec3, settings: &RadioSettings, wanted: usize) -> Option<Vec<Chain>> {
    if !settings.reflection || settings.max_interactions == 0 {
        return Some(Vec::new());
    }
    let allowed = mirrors(geometry, settings);
    match settings.search {
        Search::Exhaustive => Some(exhaustive(geometry, tx, &allowed, settings.max_interactions)),
        Search::Auto { .. } => beams::chains(geometry, tx, &allowed, settings.max_interactions, wanted),
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
    let walk = Walk::new(geometry, settings).with_opaque_tree();
    let mut chains = exhaustive(geometry, tx, allowed, 1);
    chains.extend(walk.lattice(tx, rays, |found, chain, triangle| found.extend(walk.mirrored(chain, triangle))));
    distinct(&mut chains);
    for length in 1..settings.max_interactions {
        let (large, density) = if length == 1 { (BY_ONE, FROM_FIRST) } else { (BY_SEVERAL, FROM_LATER) };
        let of_length = |c: &&Chain| c.faces().len() == length;
        let all: Vec<Chain> = chains.iter().filter(of_length).copied().collect();
        let narrowing: Vec<Chain> = all.iter().filter(|c| narrows(geometry, c)).copied().collect();
        let mut found = large.lit(&walk, tx, all, allowed);
        found.extend(density.continued(&walk, tx, &narrowing, rays));
        // Millions: room is made once.
        chains.reserve_exact(found.iter().map(Vec::len).sum());
        found.iter().for_each(|found| chains.extend_from_slice(found));
        distinct(&mut chains);
    }
    chains
}

/// All sequences up to `max_interactions` of faces in different planes, one to the next: the oracle.
fn exhaustive(geometry: &Geometry<'_>, tx: DVec3, allowed: &[u32], max_interactions: usize) -> Vec<Chain> {
    let mut chains = Vec::new();
    let mut frontier = vec![Chain::line_of_sight(tx)];
    for _ in 0..max_interactions {
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

/// Whether the last face of a chain is its smallest, and not too small: what is lit by way of a smaller one before is a part of the last
/// that points spread over all of it may miss, and is seen by the rays that went on from the smaller one.
fn narrows(geometry: &Geometry<'_>, chain: &Chain) -> bool {
    let area = |&face: &u32| geometry.faces[face as usize].area_m2;
    chain
        .faces()
        .last()
        .is_some_and(|last| area(last) >= SMALL_FACE_M2 && chain.faces().iter().all(|face| area(face) >= area(last)))
}

/// A step through 0..`count`, round and round, that leaves none out and goes everywhere soon: the nearest to the golden section without a
/// common divisor.
fn golden_step(count: usize) -> usize {
    let divisor = |mut a: usize, mut b: usize| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let golden = (0.618 * count as f64) as usize;
    (golden.max(1)..).find(|&step| divisor(count, step) == 1).unwrap_or(1)
}

impl Large {
    /// The chains of `before` with one more of the `allowed` faces, that is lit by way of them: a list for each.
    fn lit(&self, walk: &Walk<'_, '_>, tx: DVec3, mut before: Vec<Chain>, allowed: &[u32]) -> Vec<Vec<Chain>> {
        struct Facet {
            face: u32,
            hull: [DVec3; 4],
            points: Vec<DVec3>,
        }
        let geometry = walk.geometry();
        let area_m2 = |face: u32| geometry.faces[face as usize].area_m2;
        let facet = |&face: &u32| {
            let plane = &geometry.faces[face as usize];
            Facet { face, hull: plane.hull(), points: plane.spread(self.points) }
        };
        let smallest_m2 = |chain: &Chain| chain.faces().iter().fold(f64::INFINITY, |least, &face| least.min(area_m2(face)));
        before.retain(|chain| smallest_m2(chain) >= self.least_m2);
        before.sort_by(|a, b| smallest_m2(b).total_cmp(&smallest_m2(a)));
        if before.is_empty() {
            return Vec::new();
        }
        let facets: Vec<Facet> = allowed.par_iter().filter(|&&face| area_m2(face) >= SMALL_FACE_M2).map(facet).collect();
        before.truncate(self.most_pairs / facets.len().max(1));
        before
            .par_iter()
            .map(|chain| {
                let beam = ImageBeam::of_chain(geometry, tx, chain);
                let in_beam = facets.iter().filter(|facet| beam.meets(&facet.hull) && !repeats(geometry, chain, facet.face));
                let lit = in_beam.filter_map(|facet| {
                    let next = chain.pushed(facet.face, geometry);
                    let way = ChainImages::new(geometry, tx, &next);
                    facet.points.iter().any(|&point| walk.lights(&way, point)).then_some(next)
                });
                lit.collect()
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_steps_leave_nothing_out() {
        for count in 1..300 {
            let step = golden_step(count);
            let mut visited: Vec<usize> = (0..count).map(|i| i * step % count).collect();
            visited.sort_unstable();
            assert!(visited.into_iter().eq(0..count), "{count}");
        }
    }
}
