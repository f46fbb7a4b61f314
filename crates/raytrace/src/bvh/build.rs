//! Construction of the eight-wide bounding volume hierarchy from triangles.

use super::Bvh;
use super::collapse::Plan;
use super::kernel::{LEAF, Node, Packet};
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
    let (binary, padding) = binary(&triangles, &finite);
    let mut collapse = Collapse {
        binary: &binary,
        plan: Plan::new(&binary, |slot| {
            let [a, b, c] = triangles[finite[slot as usize] as usize];
            0.5 * (b - a).cross(c - a).length()
        }),
        triangles: &triangles,
        original: &finite,
        padding,
        nodes: Vec::new(),
        packets: Vec::new(),
    };
    collapse.run();
    Bvh { nodes: collapse.nodes, packets: collapse.packets, kernel }
}

/// The binary tree over some of the triangles, and by how much its boxes grow on every side.
pub(super) fn binary(triangles: &[[Vec3; 3]], chosen: &[u32]) -> (Bvh2, f32) {
    let boxes: Vec<Aabb> = chosen.iter().map(|&i| Aabb::from_points(&triangles[i as usize].map(Vec3A::from))).collect();
    let extent = boxes.iter().fold(0.0f32, |m, b| m.max(b.min.abs().max_element()).max(b.max.abs().max_element()));

    let preset = BvhBuildParams::slow_build();
    let mut binary = PlocBuilder::with_capacity(boxes.len()).build(
        preset.ploc_search_distance,
        &boxes,
        (0..boxes.len() as u32).collect(),
        preset.sort_precision,
        preset.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut binary, preset.reinsertion_batch_ratio, None);
    (binary, BOX_PADDING * extent)
}

struct Collapse<'a> {
    binary: &'a Bvh2,
    plan: Plan<'a>,
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
            let mut children = self.plan.children(binary);
            // Likely and cheap hits first: rays that end at any hit look at the children in this order.
            children.sort_by(|a, b| self.plan.promise(*b).total_cmp(&self.plan.promise(*a)));
            for (slot, child) in children.into_iter().enumerate() {
                let bounds = *self.binary.nodes[child as usize].aabb();
                let reference = if self.plan.is_leaf(child) {
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

    /// The packet of all triangles under a binary node that has at most [`PACKET`](super::kernel::PACKET).
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
