//! Paths that diffract once: image chains from both ends meet at an edge.
//!
//! Reflections before the edge are those of chains from the transmitter, reflections after it those of chains from the receiver; the
//! point on the edge is where the way between the two images is stationary, in closed form.

use crate::radio::candidates::chain::Chain;
use crate::radio::candidates::chains;
use crate::radio::candidates::walk::Walk;
use crate::radio::diffraction::{Wedge, Wedges, keller_point};
use crate::radio::geometry::{Geometry, TOUCHING_M};
use crate::radio::paths::path::Path;
use crate::radio::paths::ray_path::{PathEvent, Propagator, RayPath};
use crate::radio::{MAX_INTERACTIONS, RadioSettings, Search};
use glam::DVec3;
use rayon::prelude::*;
use std::borrow::Cow;
use std::f64::consts::{PI, TAU};

/// An image closer than this to the plane of a face is neither in front of it nor behind, metres.
const EDGE_ON_M: f64 = 1e-5;
/// Largest number of combinations of chains and wedges that are all tried.
const MOST_COMBINATIONS: usize = 50_000_000;

/// Chains of faces by which an endpoint reaches edges.
pub enum EdgeChains {
    /// No diffraction.
    Off,
    /// One list of chains for every wedge.
    All(Vec<Chain>),
    /// (wedge, chain), sorted; the direct way to every wedge is left out.
    Found(Vec<(u32, Chain)>),
}

impl EdgeChains {
    /// The chains from a transmitter or a receiver.
    pub fn from_point(propagator: &Propagator<'_, '_>, wedges: &Wedges, point: DVec3) -> Self {
        let (settings, count) = (propagator.settings, wedges.wedges.len());
        if settings.max_interactions == 0 || count == 0 {
            return Self::Off;
        }
        let before = RadioSettings { max_interactions: settings.max_interactions - 1, ..*settings };
        let few = |chains: &Vec<Chain>| {
            settings.search == Search::Exhaustive || combinations(chains, &before, count) <= MOST_COMBINATIONS
        };
        match chains::all(propagator.geometry, point, &before, MOST_COMBINATIONS / count).filter(few) {
            Some(chains) => Self::All(std::iter::once(Chain::line_of_sight(point)).chain(chains).collect()),
            None => {
                let rays = settings.search.rays();
                Self::Found(wedges_from_lattice(propagator.geometry, wedges, point, settings, rays))
            }
        }
    }

    /// The chains to a wedge, the direct way included.
    fn to_wedge(&self, wedge: u32, point: DVec3) -> Cow<'_, [Chain]> {
        match self {
            Self::Off => Cow::Borrowed(&[]),
            Self::All(chains) => Cow::Borrowed(chains),
            Self::Found(found) => {
                let first = found.partition_point(|(w, _)| *w < wedge);
                let ways = found[first..].iter().take_while(|(w, _)| *w == wedge).map(|(_, chain)| *chain);
                let reflected = ways.filter(|chain| !chain.faces().is_empty());
                Cow::Owned(std::iter::once(Chain::line_of_sight(point)).chain(reflected).collect())
            }
        }
    }
}

/// Number of pairs of chains before an edge and after it to try, if the other endpoint has as many chains: wedges × Σ n_i·n_j, i + j faces
/// together within the depth.
fn combinations(chains: &[Chain], before: &RadioSettings, wedges: usize) -> usize {
    let mut counts = [0usize; MAX_INTERACTIONS + 1];
    counts[0] = 1;
    chains.iter().for_each(|chain| counts[chain.faces().len()] += 1);
    let pairs = (0..=before.max_interactions).flat_map(|i| (0..=before.max_interactions - i).map(move |j| (i, j)));
    pairs.fold(0usize, |sum, (i, j)| sum.saturating_add(counts[i].saturating_mul(counts[j]))).saturating_mul(wedges)
}

/// An image of an endpoint as an edge sees it.
struct Image<'c> {
    chain: &'c Chain,
    /// Distance along the edge from its origin, metres.
    u: f64,
    /// Distance from the edge's line, metres.
    rho: f64,
    /// Index of the wedge's face that it lights: the first that it is in front of.
    lit: usize,
}

/// All diffracted paths between two points.
pub fn paths(propagator: &Propagator<'_, '_>, wedges: &Wedges, tx: DVec3, from_tx: &EdgeChains, rx: DVec3) -> Vec<Path> {
    let from_rx = match from_tx {
        EdgeChains::Off => return Vec::new(),
        _ => EdgeChains::from_point(propagator, wedges, rx),
    };
    let found: Vec<Vec<Path>> = wedges
        .wedges
        .par_iter()
        .enumerate()
        .map(|(number, wedge)| {
            let (before, after) = (from_tx.to_wedge(number as u32, tx), from_rx.to_wedge(number as u32, rx));
            let sources = images(propagator.geometry, wedge, &before);
            let targets = images(propagator.geometry, wedge, &after);
            let mut paths = Vec::new();
            for source in &sources {
                for target in &targets {
                    if source.chain.faces().len() + target.chain.faces().len() < propagator.settings.max_interactions {
                        paths.extend(at_edge(propagator, tx, rx, wedge, source, target));
                    }
                }
            }
            paths
        })
        .collect();
    found.into_iter().flatten().collect()
}

/// The chains whose image may light the edge.
fn images<'c>(geometry: &Geometry<'_>, wedge: &Wedge, chains: &'c [Chain]) -> Vec<Image<'c>> {
    let ends = wedge.ends();
    chains
        .iter()
        .filter_map(|chain| {
            let from_edge = chain.image - wedge.origin;
            let lit = wedge.normals.iter().position(|n| n.dot(from_edge) > EDGE_ON_M)?;
            if let Some(&last) = chain.faces().last() {
                let mirror = &geometry.faces[last as usize];
                let side = mirror.distance(chain.image).signum();
                // Some of the edge is in front of the last mirror, as the image is behind it, and not of its sheet.
                if ends.iter().all(|end| mirror.distance(*end) * side > -TOUCHING_M) {
                    return None;
                }
            }
            let u = from_edge.dot(wedge.edge);
            let rho = (from_edge - wedge.edge * u).length();
            (rho > 0.0).then_some(Image { chain, u, rho, lit })
        })
        .collect()
}

/// The path by way of one edge and two chains, if there is one.
fn at_edge(
    propagator: &Propagator<'_, '_>,
    tx: DVec3,
    rx: DVec3,
    wedge: &Wedge,
    source: &Image<'_>,
    target: &Image<'_>,
) -> Option<Path> {
    let u = keller_point([source.u, source.rho], [target.u, target.rho]);
    if !wedge.contains(u) || (!propagator.settings.diffraction_lit_region && !shadowed(wedge, source, target)) {
        return None;
    }
    let point = wedge.point(u);
    let (before, after) = (source.chain.faces(), target.chain.faces());
    let to_edge = propagator.specular_vertices(tx, point, source.chain)?;
    let from_edge = propagator.specular_vertices(rx, point, target.chain)?;
    let mut turns = [PathEvent::Edge { wedge, lit: source.lit }; MAX_INTERACTIONS];
    let mut corners = [point; MAX_INTERACTIONS];
    for (i, face) in before.iter().enumerate() {
        (turns[i], corners[i]) = (PathEvent::Mirror(*face), to_edge[i]);
    }
    for (i, face) in after.iter().enumerate() {
        // The receiver's chain runs towards the edge, the path away from it.
        let at = before.len() + after.len() - i;
        (turns[at], corners[at]) = (PathEvent::Mirror(*face), from_edge[i]);
    }
    let count = before.len() + 1 + after.len();
    propagator.follow(&RayPath { tx, rx, turns: &turns[..count], corners: &corners[..count] })
}

/// Whether the edge hides the source from the receiver: φ − φ′ > π.
fn shadowed(wedge: &Wedge, source: &Image<'_>, target: &Image<'_>) -> bool {
    let (normal, edge) = (wedge.normals[source.lit], if source.lit == 0 { wedge.edge } else { -wedge.edge });
    let into_face = normal.cross(edge);
    let azimuth = |image: &Image<'_>| {
        let v = image.chain.image - wedge.origin;
        v.dot(normal).atan2(v.dot(into_face)).rem_euclid(TAU)
    };
    azimuth(target) - azimuth(source) > PI
}

/// The wedges that a lattice of rays from a point comes by, each with the chain it bounced off before, sorted and without repeats.
fn wedges_from_lattice(
    geometry: &Geometry<'_>,
    wedges: &Wedges,
    from: DVec3,
    settings: &RadioSettings,
    rays: usize,
) -> Vec<(u32, Chain)> {
    Walk::new(geometry, settings).lattice(from, rays, |found, chain, triangle| {
        found.extend(wedges.of_triangle(triangle).map(|wedge| (wedge, *chain)));
    })
}
