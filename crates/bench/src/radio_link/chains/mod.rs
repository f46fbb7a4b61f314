//! Chains of points from another program, such as one of the image method, held against the paths of this one.
//!
//! A chain is the places at which a path turns between a transmitter and a receiver. Where a ray goes straight on, through a slab, it does not turn: such
//! points may be listed or not.

mod reason;

use anyhow::Result;
use corf_raytrace::radio::{InteractionKind, Path};
use corf_scene::{Error, bounds, io};
use glam::DVec3;
use reason::Reasons;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The version of the file that is read.
const SCHEMA: &str = "corf-chains/1";

/// Chains of links in a scene.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chains {
    /// [`SCHEMA`].
    pub schema: String,
    /// Scene file, relative to this file.
    #[serde(default)]
    pub scene: Option<PathBuf>,
    /// Links, whose chains are all that the other program has.
    pub links: Vec<ChainsOfLink>,
}

/// Chains between two points.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChainsOfLink {
    /// Transmitter, world, metres.
    pub tx: [f64; 3],
    /// Receiver, world, metres.
    pub rx: [f64; 3],
    /// Turning points of each chain in the order from transmitter to receiver, without these two; none for the line of sight.
    pub chains: Vec<Vec<[f64; 3]>>,
}

impl Chains {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read or is of another form, points that are no places in a scene, a file without a chain.
    pub fn read(path: &std::path::Path) -> Result<Self> {
        let place = path.display().to_string();
        let text = io::read_text(path)?;
        let help = "docs/validation.md has the form: schema, scene, and links with tx, rx and chains of points";
        let form = |e: serde_json::Error| {
            Error::invalid(format!("{place}:{}:{}", e.line(), e.column()), format!("not as expected: {e}"), help)
        };
        // The schema first: a file of another kind should say so, not complain about its keys.
        let value: serde_json::Value = serde_json::from_str(&text).map_err(form)?;
        let schema = value.get("schema").and_then(|s| s.as_str()).unwrap_or("(none)");
        if schema != SCHEMA {
            return Err(
                Error::invalid(place, format!("schema is \"{schema}\""), format!("this command reads \"{SCHEMA}\"")).into()
            );
        }
        let chains: Self = serde_json::from_str(&text).map_err(form)?;
        for (l, link) in chains.links.iter().enumerate() {
            let points = link.chains.iter().flatten().chain([&link.tx, &link.rx]);
            for point in points {
                bounds::position(&format!("{place}: link {l}"), DVec3::from_array(*point))?;
            }
        }
        let count: usize = chains.links.iter().map(|link| link.chains.len()).sum();
        if count == 0 {
            return Err(Error::invalid(place, "it has no chain", help).into());
        }
        bounds::count(&place, count, bounds::MAX_LINKS, "chains")?;
        Ok(chains)
    }
}

/// Distances that decide.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Tolerances {
    /// Turning points no further apart than this are the same, metres.
    pub found_m: f64,
    /// A path whose turning points are all within this of a chain's is that chain, displaced, metres.
    pub displaced_m: f64,
}

/// What became of a link's chains.
#[derive(Clone, Debug, Serialize)]
pub struct LinkOutcome {
    /// Transmitter, world, metres.
    pub tx: [f64; 3],
    /// Receiver, world, metres.
    pub rx: [f64; 3],
    /// Chains that a path has.
    pub found: usize,
    /// Largest distance of a turning point among these, metres.
    pub worst_m: f64,
    /// Chains that repeat an earlier one.
    pub repeated: usize,
    /// Chains that a path has elsewhere.
    pub displaced: Vec<Displaced>,
    /// Chains that no path has.
    pub missing: Vec<Missing>,
    /// Paths that no chain has, by their types.
    pub only_here: Vec<String>,
}

/// A chain and the path nearest to it.
#[derive(Clone, Debug, Serialize)]
pub struct Displaced {
    /// Index of the chain in its link.
    pub chain: usize,
    /// Largest distance of a turning point, metres.
    pub by_m: f64,
    /// Turning points of the path.
    pub path: Vec<[f64; 3]>,
}

/// A chain that no path has.
#[derive(Clone, Debug, Serialize)]
pub struct Missing {
    /// Index of the chain in its link.
    pub chain: usize,
    /// Why there is no such path, as far as the scene says.
    pub why: String,
}

/// Compares a link's chains with its paths, each of which is the match of one chain at most.
pub fn compare(link: &ChainsOfLink, paths: &[Path], tolerances: Tolerances, reasons: &Reasons<'_>) -> LinkOutcome {
    let ends = [link.tx, link.rx].map(DVec3::from_array);
    let chains: Vec<Vec<DVec3>> = link
        .chains
        .iter()
        .map(|chain| turns(ends, &chain.iter().map(|p| DVec3::from_array(*p)).collect::<Vec<_>>(), tolerances.found_m))
        .collect();
    let ours: Vec<Vec<DVec3>> = paths.iter().map(turning_points).collect();
    let repeats = |i: usize| (0..i).any(|k| distance(&chains[k], &chains[i]).is_some_and(|d| d <= tolerances.found_m));
    let repeated: Vec<bool> = (0..chains.len()).map(repeats).collect();
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (c, chain) in chains.iter().enumerate().filter(|(c, _)| !repeated[*c]) {
        let near = ours.iter().enumerate().filter_map(|(p, path)| Some((distance(chain, path)?, c, p)));
        pairs.extend(near.filter(|pair| pair.0 <= tolerances.displaced_m.max(tolerances.found_m)));
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut of_chain, mut taken) = (vec![None; chains.len()], vec![false; ours.len()]);
    for (by_m, c, p) in pairs {
        if of_chain[c].is_none() && !taken[p] {
            (of_chain[c], taken[p]) = (Some((by_m, p)), true);
        }
    }
    let mut outcome = LinkOutcome {
        tx: link.tx,
        rx: link.rx,
        found: 0,
        worst_m: 0.0,
        repeated: repeated.iter().filter(|r| **r).count(),
        displaced: vec![],
        missing: vec![],
        only_here: vec![],
    };
    for (chain, matched) in of_chain.iter().enumerate().filter(|(c, _)| !repeated[*c]) {
        match *matched {
            Some((by_m, _)) if by_m <= tolerances.found_m => {
                outcome.found += 1;
                outcome.worst_m = outcome.worst_m.max(by_m);
            }
            Some((by_m, p)) => {
                let path = ours[p].iter().map(|v| v.to_array()).collect();
                outcome.displaced.push(Displaced { chain, by_m, path });
            }
            None => outcome.missing.push(Missing { chain, why: reasons.of(ends, &chains[chain]) }),
        }
    }
    let types = |(path, _): (&Path, _)| if path.interactions.is_empty() { "line of sight".to_owned() } else { path.types() };
    outcome.only_here = paths.iter().zip(&taken).filter(|(_, taken)| !**taken).map(types).collect();
    outcome
}

/// Where a path turns.
fn turning_points(path: &Path) -> Vec<DVec3> {
    path.interactions.iter().filter(|i| i.kind != InteractionKind::Refraction).map(|i| i.vertex).collect()
}

/// A chain without the points at which it goes straight on.
fn turns([from, to]: [DVec3; 2], chain: &[DVec3], tolerance_m: f64) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = Vec::new();
    for (i, point) in chain.iter().enumerate() {
        let (before, after) = (kept.last().copied().unwrap_or(from), chain.get(i + 1).copied().unwrap_or(to));
        let way = after - before;
        let t = ((*point - before).dot(way) / way.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        if point.distance(before + way * t) > tolerance_m {
            kept.push(*point);
        }
    }
    kept
}

/// Largest distance between points of two chains of one length.
fn distance(a: &[DVec3], b: &[DVec3]) -> Option<f64> {
    (a.len() == b.len()).then(|| a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max))
}

pub use reason::Reasons as WhyMissing;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_at_which_a_ray_goes_straight_on_are_no_turns() {
        let ends = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0)];
        let (wall, slab) = (DVec3::new(2.0, 2.0, 0.0), DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(turns(ends, &[slab, wall], 1e-3), [wall]);
        assert_eq!(turns(ends, &[DVec3::new(1.0, 0.0, 0.0), DVec3::new(3.0, 0.0, 0.0)], 1e-3), [DVec3::ZERO; 0]);
        // A flat bounce is a turn as long as it is off the straight way by more than the tolerance.
        assert_eq!(turns(ends, &[DVec3::new(2.0, 2e-3, 0.0)], 1e-3).len(), 1);
        assert_eq!(distance(&[wall], &[slab]), Some(2f64.sqrt()));
        assert_eq!(distance(&[wall], &[]), None);
    }
}
