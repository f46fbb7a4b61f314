//! From triangles to the eight-wide tree.

use super::Bvh;
use super::kernel::{LEAF, Node, PACKET, Packet, WIDTH};
use super::traverse::Choice;
use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;

/// Boxes grow on every side by this share of the largest absolute coordinate: some ten roundings of a position in f32, so that a ray
/// that grazes a box, as far as its own rounded coordinates tell, still enters it. At 15 m it is 18 µm.
const BOX_PADDING: f32 = 1.2e-6;

/// Builds the tree over triangles given by their corners; the order numbers them.
pub(super) fn build(triangles: impl Iterator<Item = [Vec3; 3]>) -> Bvh {
    let triangles: Vec<[Vec3; 3]> = triangles.collect();
    let finite: Vec<u32> = (0..triangles.len() as u32).filter(|&i| triangles[i as usize].iter().all(|p| p.is_finite())).collect();
    let kernel = Choice::detect();
    if finite.is_empty() {
        return Bvh { nodes: Vec::new(), packets: Vec::new(), kernel };
    }
    let boxes: Vec<Aabb> = finite.iter().map(|&i| Aabb::from_points(&triangles[i as usize].map(Vec3A::from))).collect();
    let extent = boxes.iter().fold(0.0f32, |m, b| m.max(b.min.abs().max_element()).max(b.max.abs().max_element()));

    let preset = BvhBuildParams::medium_build();
    let mut binary = PlocBuilder::with_capacity(boxes.len()).build(
        preset.ploc_search_distance,
        &boxes,
        (0..boxes.len() as u32).collect(),
        preset.sort_precision,
        preset.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut binary, preset.reinsertion_batch_ratio, None);

    let counts = triangle_counts(&binary);
    let mut collapse = Collapse {
        binary: &binary,
        counts,
        triangles: &triangles,
        original: &finite,
        padding: BOX_PADDING * extent,
        nodes: Vec::new(),
        packets: Vec::new(),
    };
    collapse.run();
    Bvh { nodes: collapse.nodes, packets: collapse.packets, kernel }
}

/// Number of triangles under every node of the binary tree.
fn triangle_counts(binary: &Bvh2) -> Vec<u32> {
    let mut counts = vec![0; binary.nodes.len()];
    // Reinsertion moves nodes about, so children are not always behind their parents: walk in pre-order, then sum backwards.
    let mut order = vec![0u32];
    let mut next = 0;
    while next < order.len() {
        let node = &binary.nodes[order[next] as usize];
        if !node.is_leaf() {
            order.extend([node.first_index, node.first_index + 1]);
        }
        next += 1;
    }
    for &i in order.iter().rev() {
        let node = &binary.nodes[i as usize];
        counts[i as usize] = if node.is_leaf() {
            node.prim_count
        } else {
            counts[node.first_index as usize] + counts[node.first_index as usize + 1]
        };
    }
    counts
}

struct Collapse<'a> {
    binary: &'a Bvh2,
    counts: Vec<u32>,
    triangles: &'a [[Vec3; 3]],
    original: &'a [u32],
    padding: f32,
    nodes: Vec<Node>,
    packets: Vec<Packet>,
}

impl Collapse<'_> {
    /// Breadth first, so that the top of the tree lies together in memory.
    fn run(&mut self) {
        self.nodes.push(Node::EMPTY);
        let mut queue = std::collections::VecDeque::from([(0u32, 0usize)]);
        while let Some((binary, wide)) = queue.pop_front() {
            for (slot, child) in self.children(binary).into_iter().enumerate() {
                let bounds = *self.binary.nodes[child as usize].aabb();
                let reference = if self.counts[child as usize] as usize <= PACKET {
                    self.packets.push(self.packet(child));
                    LEAF | (self.packets.len() - 1) as u32
                } else {
                    self.nodes.push(Node::EMPTY);
                    queue.push_back((child, self.nodes.len() - 1));
                    (self.nodes.len() - 1) as u32
                };
                self.nodes[wide].set(slot, bounds.min.into(), bounds.max.into(), self.padding, reference);
            }
        }
    }

    /// Up to eight descendants of a binary node: the one of the largest surface is opened until there is no room.
    fn children(&self, root: u32) -> Vec<u32> {
        let mut children = vec![root];
        while children.len() < WIDTH {
            let largest = children
                .iter()
                .enumerate()
                .filter(|(_, c)| self.counts[**c as usize] as usize > PACKET)
                .max_by(|a, b| {
                    let area = |c: u32| self.binary.nodes[c as usize].aabb().half_area();
                    area(*a.1).total_cmp(&area(*b.1))
                })
                .map(|(slot, _)| slot);
            let Some(slot) = largest else { break };
            let first = self.binary.nodes[children[slot] as usize].first_index;
            children[slot] = first;
            children.push(first + 1);
        }
        children
    }

    /// The packet of all triangles under a binary node that has at most [`PACKET`].
    fn packet(&self, root: u32) -> Packet {
        let mut packet = Packet::EMPTY;
        let mut lane = 0;
        let mut stack = vec![root];
        while let Some(i) = stack.pop() {
            let node = &self.binary.nodes[i as usize];
            if node.is_leaf() {
                for slot in node.first_index..node.first_index + node.prim_count {
                    let triangle = self.original[self.binary.primitive_indices[slot as usize] as usize];
                    packet.set(lane, self.triangles[triangle as usize], triangle);
                    lane += 1;
                }
            } else {
                stack.extend([node.first_index + 1, node.first_index]);
            }
        }
        packet
    }
}
