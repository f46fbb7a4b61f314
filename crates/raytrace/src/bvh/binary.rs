//! The tree as a GPU walks it: two boxes a node, small leaves, a known depth.

use super::build;
use glam::Vec3;
use obvhs::bvh2::Bvh2;

/// Triangles of a leaf at most.
const MOST: u32 = 4;
/// The bit of a child reference that says "triangles": first of them in [`BinaryTree::order`] times 8, plus their number less
/// one.
pub(crate) const LEAF: u32 = 1 << 31;

/// A node: boxes and references of its two children.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BinaryNode {
    pub low: [Vec3; 2],
    pub high: [Vec3; 2],
    /// Node index, or [`LEAF`].
    pub children: [u32; 2],
}

/// A binary tree over triangles.
#[derive(Clone, Debug)]
pub(crate) struct BinaryTree {
    /// The root first.
    pub nodes: Vec<BinaryNode>,
    /// Triangles in the order of the leaves; `u32::MAX` is a triangle that is never hit.
    pub order: Vec<u32>,
    /// Nodes on the longest way from the root to a leaf: as many children wait at most.
    pub depth: u32,
}

impl BinaryTree {
    /// Builds the tree; triangles with a corner that is not finite are left out.
    pub fn build(triangles: &[[Vec3; 3]]) -> Self {
        let finite: Vec<u32> =
            (0..triangles.len() as u32).filter(|&i| triangles[i as usize].iter().all(|p| p.is_finite())).collect();
        let mut flat = Flat {
            tree: Self { nodes: Vec::new(), order: vec![u32::MAX], depth: 1 },
            padding: 0.0,
            costs: Vec::new(),
            chosen: &finite,
        };
        let nothing = BinaryNode { low: [Vec3::ZERO; 2], high: [Vec3::ZERO; 2], children: [LEAF; 2] };
        flat.tree.nodes.push(nothing);
        if finite.is_empty() {
            return flat.tree;
        }
        let (binary, padding) = build::binary(triangles, &finite);
        flat.padding = padding;
        flat.costs = costs(&binary);
        if flat.costs[0].1 {
            // The root is a leaf: its node has it and nothing.
            let (low, high) = flat.bounds(&binary, 0);
            let leaf = flat.leaf(&binary, 0);
            flat.tree.nodes[0] = BinaryNode { low: [low; 2], high: [high; 2], children: [leaf, LEAF] };
        } else {
            flat.flatten(&binary);
        }
        flat.tree
    }
}

/// Per node: triangles under it, whether it becomes a leaf, and the expected cost of a ray in it, a node's step and a triangle's
/// test alike.
fn costs(binary: &Bvh2) -> Vec<(u32, bool, f32)> {
    let mut costs = vec![(0, true, 0.0); binary.nodes.len()];
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
        let area = node.aabb().half_area();
        costs[i as usize] = if node.is_leaf() {
            (node.prim_count, true, area * node.prim_count as f32)
        } else {
            let (a, b) = (costs[node.first_index as usize], costs[node.first_index as usize + 1]);
            let count = a.0 + b.0;
            let (leaf, inner) = (area * count as f32, area + a.2 + b.2);
            let is_leaf = count <= MOST && leaf <= inner;
            (count, is_leaf, if is_leaf { leaf } else { inner })
        };
    }
    costs
}

struct Flat<'a> {
    tree: BinaryTree,
    padding: f32,
    costs: Vec<(u32, bool, f32)>,
    chosen: &'a [u32],
}

impl Flat<'_> {
    fn bounds(&self, binary: &Bvh2, node: u32) -> (Vec3, Vec3) {
        let aabb = binary.nodes[node as usize].aabb();
        (Vec3::from(aabb.min) - self.padding, Vec3::from(aabb.max) + self.padding)
    }

    fn leaf(&mut self, binary: &Bvh2, root: u32) -> u32 {
        let first = self.tree.order.len() as u32;
        let mut stack = vec![root];
        while let Some(i) = stack.pop() {
            let node = &binary.nodes[i as usize];
            if node.is_leaf() {
                let slots = node.first_index as usize..(node.first_index + node.prim_count) as usize;
                self.tree.order.extend(binary.primitive_indices[slots].iter().map(|p| self.chosen[*p as usize]));
            } else {
                stack.extend([node.first_index + 1, node.first_index]);
            }
        }
        LEAF | first << 3 | (self.tree.order.len() as u32 - first - 1)
    }

    /// Breadth first, so that the top of the tree lies together in memory.
    fn flatten(&mut self, binary: &Bvh2) {
        let mut queue = std::collections::VecDeque::from([(0u32, 0usize, 1u32)]);
        while let Some((root, at, depth)) = queue.pop_front() {
            self.tree.depth = self.tree.depth.max(depth);
            let first = binary.nodes[root as usize].first_index;
            for k in 0..2 {
                let child = first + k as u32;
                let reference = if self.costs[child as usize].1 {
                    self.leaf(binary, child)
                } else {
                    self.tree.nodes.push(self.tree.nodes[0]);
                    let next = self.tree.nodes.len() - 1;
                    queue.push_back((child, next, depth + 1));
                    next as u32
                };
                let (low, high) = self.bounds(binary, child);
                let node = &mut self.tree.nodes[at];
                (node.low[k], node.high[k], node.children[k]) = (low, high, reference);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn every_triangle_is_in_one_leaf_and_every_box_holds_what_is_under_it() {
        for count in [0usize, 1, 2, 3, 5, 300] {
            let mut rng = Rng::keyed(5, 6, count as u64);
            let mut draw = || Vec3::new(rng.uniform(), rng.uniform(), rng.uniform());
            let mut triangles: Vec<[Vec3; 3]> = (0..count)
                .map(|_| {
                    let p = 9.0 * draw();
                    [p, p + draw(), p + draw()]
                })
                .collect();
            triangles.push([Vec3::NAN; 3]);
            let tree = BinaryTree::build(&triangles);
            let mut seen = vec![0; count];
            let mut stack = vec![(0u32, Vec3::NEG_INFINITY, Vec3::INFINITY, 0)];
            while let Some((at, low, high, depth)) = stack.pop() {
                if at & LEAF == 0 {
                    assert!(depth < tree.depth);
                    let node = &tree.nodes[at as usize];
                    for k in 0..2 {
                        stack.push((node.children[k], node.low[k], node.high[k], depth + 1));
                    }
                    continue;
                }
                let first = ((at & !LEAF) >> 3) as usize;
                for &triangle in tree.order[first..=first + (at & 7) as usize].iter().filter(|t| **t != u32::MAX) {
                    seen[triangle as usize] += 1;
                    for corner in triangles[triangle as usize] {
                        assert!(corner.cmpge(low).all() && corner.cmple(high).all());
                    }
                }
            }
            assert!(seen.iter().all(|n| *n == 1), "{count}: {seen:?}");
        }
    }
}
