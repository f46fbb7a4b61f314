//! From a binary tree to nodes of eight children: which binary nodes become nodes, which become leaves and which vanish is chosen for
//! the least expected cost of a ray.
//!
//! The choice is exact for the given binary tree: dynamic programming over (node, number of slots), after section 4.2 of Ylitie, Karras
//! and Laine, *Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs*, HPG 2017.

use super::kernel::{PACKET, WIDTH};
use obvhs::bvh2::Bvh2;

/// Cost of testing a ray against the eight boxes of a node, in any unit.
const NODE_COST: f32 = 1.0;
/// Cost of testing a ray against a packet of triangles, in the same unit.
const PACKET_COST: f32 = 1.0;

/// Plan of the collapse: which nodes of the binary tree become wide nodes, which become leaves and which vanish.
pub(super) struct Plan<'a> {
    binary: &'a Bvh2,
    /// Triangles under each node.
    counts: Vec<u32>,
    /// Area of the triangles under each node, square metres.
    areas: Vec<f32>,
    /// Least cost of a node's triangles as a forest of at most 1, 2, … 7 wide nodes and leaves.
    costs: Vec<[f32; WIDTH - 1]>,
    /// Optimal split of those slots: how many the first child gets of 2, 3, … 8; 0 where one slot less is as good. The eighth entry is the
    /// split among the children of a wide node; the first is 1 for a leaf and 0 for a wide node.
    shares: Vec<[u8; WIDTH]>,
}

impl<'a> Plan<'a> {
    /// `area` gives that of a primitive of the binary tree, by its number, in square metres.
    pub fn new(binary: &'a Bvh2, area: impl Fn(u32) -> f32) -> Self {
        let n = binary.nodes.len();
        let mut plan = Self {
            binary,
            counts: vec![0; n],
            areas: vec![0.0; n],
            costs: vec![[0.0; WIDTH - 1]; n],
            shares: vec![[0; WIDTH]; n],
        };
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
            plan.choose(i as usize, &area);
        }
        plan
    }

    fn choose(&mut self, i: usize, triangle_area: &impl Fn(u32) -> f32) {
        let node = &self.binary.nodes[i];
        let area = node.aabb().half_area();
        if node.is_leaf() {
            let primitives = node.first_index as usize..(node.first_index + node.prim_count) as usize;
            self.areas[i] = self.binary.primitive_indices[primitives].iter().map(|p| triangle_area(*p)).sum();
            self.counts[i] = node.prim_count;
            self.costs[i] = [area * PACKET_COST; WIDTH - 1];
            self.shares[i][0] = 1;
            return;
        }
        let (a, b) = (node.first_index as usize, node.first_index as usize + 1);
        self.counts[i] = self.counts[a] + self.counts[b];
        self.areas[i] = self.areas[a] + self.areas[b];
        let (left, right) = (self.costs[a], self.costs[b]);
        // Areas of very large boxes overflow; a comparison with what is no number leaves the first share, which is always possible.
        let best = |slots: usize| {
            let cost = |k: usize| left[k - 1] + right[slots - k - 1];
            let k = (2..slots).fold(1, |m, k| if cost(k) < cost(m) { k } else { m });
            (cost(k), k as u8)
        };
        let (inner, share) = best(WIDTH);
        let inner = inner + area * NODE_COST;
        let leaf = area * PACKET_COST;
        let is_leaf = self.counts[i] as usize <= PACKET && leaf <= inner;
        let (costs, shares) = (&mut self.costs[i], &mut self.shares[i]);
        costs[0] = if is_leaf { leaf } else { inner };
        shares[0] = u8::from(is_leaf);
        shares[WIDTH - 1] = share;
        for slots in 2..WIDTH {
            let (cost, share) = best(slots);
            let fewer = costs[slots - 2];
            (costs[slots - 1], shares[slots - 1]) = if cost < fewer { (cost, share) } else { (fewer, 0) };
        }
    }

    /// Whether a binary node that is a child of a wide node is a leaf.
    pub fn is_leaf(&self, node: u32) -> bool {
        self.shares[node as usize][0] == 1
    }

    /// Estimated worth of visiting a child early in a search for any hit: the share of the rays through its box that its triangles stop,
    /// were they spread evenly (their area over the box's half area), over the number of tests on the way, which grows as the logarithm of
    /// the number of triangles.
    pub fn promise(&self, node: u32) -> f32 {
        let i = node as usize;
        // A box without area holds triangles without area: 0 / 0.
        let density = self.areas[i] / self.binary.nodes[i].aabb().half_area().max(f32::MIN_POSITIVE);
        density / (1 + self.counts[i].ilog2()) as f32
    }

    /// The binary nodes that are the children of a wide node, eight at most.
    pub fn children(&self, node: u32) -> Vec<u32> {
        if self.is_leaf(node) {
            return vec![node];
        }
        let mut children = Vec::with_capacity(WIDTH);
        let first = self.binary.nodes[node as usize].first_index;
        let share = self.shares[node as usize][WIDTH - 1];
        self.forest(first, usize::from(share), &mut children);
        self.forest(first + 1, WIDTH - usize::from(share), &mut children);
        children
    }

    fn forest(&self, node: u32, mut slots: usize, children: &mut Vec<u32>) {
        let shares = &self.shares[node as usize];
        while slots > 1 && shares[slots - 1] == 0 {
            slots -= 1;
        }
        if slots == 1 {
            children.push(node);
            return;
        }
        let (first, share) = (self.binary.nodes[node as usize].first_index, usize::from(shares[slots - 1]));
        self.forest(first, share, children);
        self.forest(first + 1, slots - share, children);
    }
}
