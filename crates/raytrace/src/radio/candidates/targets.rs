//! Receivers that are known in advance: which faces can be the last mirror of a chain towards one of them.
//!
//! Chains of the greatest length are most of all chains, and nearly all of them end nowhere near a given receiver. A chain that goes on from its
//! last face by a bounce off one more face f reaches a receiver only if the receiver's mirror image in f lies in the beam that the chain's last
//! face sends on. The images of all receivers in all faces are points; a tree over them says in a few steps which of them a beam holds.

use crate::radio::candidates::beams::Beam;
use crate::radio::candidates::candidate_filter::MARGIN_M;
use crate::radio::candidates::chain::Chain;
use crate::radio::geometry::Geometry;
use crate::radio::geometry::planar::Bounds;
use glam::DVec3;
use rayon::prelude::*;

/// Images of a leaf of the tree, at most.
const LEAF: usize = 8;

/// A receiver's mirror image in a face.
struct Image {
    at: DVec3,
    face: u32,
    receiver: u32,
}

/// A box of images; those of an inner node are in its two children, the first of which stands right behind it.
struct Node {
    min: DVec3,
    max: DVec3,
    from: u32,
    to: u32,
    /// Index of the second child; 0 for a leaf.
    second: u32,
}

/// Receivers with their mirror images in all faces.
pub struct Targets {
    receivers: Vec<DVec3>,
    images: Vec<Image>,
    nodes: Vec<Node>,
}

impl Targets {
    /// Mirrors receivers, one at least, in the faces that may be the last of a chain.
    pub fn new(geometry: &Geometry<'_>, receivers: &[DVec3], faces: &[u32]) -> Self {
        let mirrored = |&face: &u32| {
            let plane = &geometry.faces[face as usize];
            (0..).zip(receivers).map(move |(receiver, rx)| Image { at: plane.mirror(*rx), face, receiver })
        };
        let mut images: Vec<Image> = faces.par_iter().flat_map_iter(mirrored).collect();
        let mut nodes = Vec::new();
        if !images.is_empty() {
            build(&mut images, 0, &mut nodes);
        }
        Self { receivers: receivers.to_vec(), images, nodes }
    }

    /// The faces by whose mirror one of the receivers may be reached behind a chain of one face at least, ascending.
    pub fn last_faces(&self, geometry: &Geometry<'_>, chain: &Chain) -> Vec<u32> {
        let mut faces = Vec::new();
        let (Some(beam), false) = (Beam::behind(geometry, chain), self.nodes.is_empty()) else { return faces };
        let mut stack = vec![0];
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            if !beam.may_hold(node.min, node.max) {
                continue;
            }
            if node.second > 0 {
                stack.extend([node.second, index + 1]);
                continue;
            }
            let held = self.images[node.from as usize..node.to as usize].iter().filter(|image| beam.holds(image.at));
            faces.extend(held.filter(|image| self.meets_its_face(geometry, chain, image)).map(|image| image.face));
        }
        faces.sort_unstable();
        faces.dedup();
        faces
    }

    /// Whether the straight line from a chain's image source to a receiver's image goes through the bounds of the face that mirrors.
    fn meets_its_face(&self, geometry: &Geometry<'_>, chain: &Chain, image: &Image) -> bool {
        let plane = &geometry.faces[image.face as usize];
        let (behind_m, before_m) = (plane.distance(image.at), plane.distance(chain.image));
        // A receiver on the plane is beyond a test of sides.
        if plane.distance(self.receivers[image.receiver as usize]).abs() <= MARGIN_M {
            return true;
        }
        let bounds = plane.bounds();
        let (from, to) = (bounds.project(image.at), bounds.project(chain.image));
        let share = behind_m / (behind_m - before_m);
        let Bounds { min, max, .. } = bounds;
        behind_m * before_m <= 0.0
            && (0..2).all(|axis| {
                let x = from[axis] + (to[axis] - from[axis]) * share;
                x >= min[axis] - MARGIN_M && x <= max[axis] + MARGIN_M
            })
    }
}

/// Adds the node of some images, the first of which has the number `from`, and all below it.
fn build(images: &mut [Image], from: u32, nodes: &mut Vec<Node>) {
    let (min, max) = images.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), i| (a.min(i.at), b.max(i.at)));
    let index = nodes.len();
    nodes.push(Node { min, max, from, to: from + images.len() as u32, second: 0 });
    if images.len() > LEAF {
        let axis = (max - min).max_position();
        let half = images.len() / 2;
        images.select_nth_unstable_by(half, |a, b| a.at[axis].total_cmp(&b.at[axis]));
        let (low, high) = images.split_at_mut(half);
        build(low, from, nodes);
        nodes[index].second = nodes.len() as u32;
        build(high, from + half as u32, nodes);
    }
}
