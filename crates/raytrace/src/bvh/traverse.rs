//! Walks through the tree: closest hit, any hit, all candidates.

use super::kernel::{Entries, Kernel, LEAF, Node, PACKET, PacketHits, Portable, Prepared, WIDTH};
use super::{Bvh, Hit, Ray};
use glam::{DVec3, Vec3};
use std::mem::MaybeUninit;
use std::ops::ControlFlow;

/// The traversal kernel that this processor runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Choice {
    /// Plain Rust.
    Portable,
    /// AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Choice {
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Self::Avx2;
        }
        Self::Portable
    }
}

/// Entries held without allocating: 36 levels of eight children.
const INLINE_STACK: usize = 256;

/// Pending children with their entry distances. Trees of any depth are walked: what does not fit inline spills.
struct Stack {
    inline: [MaybeUninit<u64>; INLINE_STACK],
    len: usize,
    spill: Vec<u64>,
}

impl Stack {
    #[inline(always)]
    fn new() -> Self {
        Self { inline: [const { MaybeUninit::uninit() }; INLINE_STACK], len: 0, spill: Vec::new() }
    }

    #[inline(always)]
    fn push(&mut self, entry: u64) {
        if self.len < INLINE_STACK {
            self.inline[self.len].write(entry);
            self.len += 1;
        } else {
            self.spill.push(entry);
        }
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<u64> {
        if self.len == INLINE_STACK
            && let Some(entry) = self.spill.pop()
        {
            return Some(entry);
        }
        self.len = self.len.checked_sub(1)?;
        // SAFETY: `push` wrote every entry below the former `len`.
        Some(unsafe { self.inline[self.len].assume_init() })
    }
}

impl Bvh {
    pub(super) fn closest(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        match self.kernel {
            // SAFETY: the portable kernel needs no features.
            Choice::Portable => unsafe { self.walk::<Portable, false>(ray, accept) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Choice::detect` found AVX2.
            Choice::Avx2 => unsafe { self.closest_avx2(ray, accept) },
        }
    }

    pub(super) fn any(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> bool {
        match self.kernel {
            // SAFETY: the portable kernel needs no features.
            Choice::Portable => unsafe { self.walk::<Portable, true>(ray, accept).is_some() },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Choice::detect` found AVX2.
            Choice::Avx2 => unsafe { self.any_avx2(ray, accept) },
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    unsafe fn closest_avx2(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        // SAFETY: this function has AVX2.
        unsafe { self.walk::<super::kernel::Avx2, false>(ray, accept) }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    unsafe fn any_avx2(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> bool {
        // SAFETY: this function has AVX2.
        unsafe { self.walk::<super::kernel::Avx2, true>(ray, accept).is_some() }
    }

    /// The closest accepted hit or, with `ANY`, the first accepted hit that is found.
    ///
    /// # Safety
    /// The processor has what kernel `K` needs.
    #[inline(always)]
    unsafe fn walk<K: Kernel, const ANY: bool>(&self, ray: &Ray, mut accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        // What is no number lets a ray into the boxes of absent children as well, and so into the root again and again.
        if self.nodes.is_empty() || !(ray.origin.is_finite() && ray.direction.is_finite()) {
            return None;
        }
        let prepared = Prepared::new(ray);
        // SAFETY: the caller promised that the processor has what the kernel needs.
        let state = unsafe { K::state(&prepared) };
        let mut best: Option<Hit> = None;
        let mut t_max = ray.t_max;
        let mut stack = Stack::new();
        let mut near = Entries([0.0; WIDTH]);
        let mut hits = PacketHits { t: [0.0; PACKET], u: [0.0; PACKET], v: [0.0; PACKET] };
        let mut current = 0u32;
        loop {
            if current & LEAF == 0 {
                // SAFETY: `build` wrote every reference, to a node that exists, and absent children are never entered.
                let node = unsafe { self.nodes.get_unchecked(current as usize) };
                // SAFETY: the caller promised that the processor has what the kernel needs.
                let mut mask = unsafe { K::boxes(node, &prepared, &state, t_max, &mut near) };
                if mask != 0 {
                    let first = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    if mask == 0 {
                        current = node.children[first];
                        continue;
                    }
                    if ANY {
                        while mask != 0 {
                            let slot = 31 - mask.leading_zeros();
                            mask &= !(1 << slot);
                            stack.push(u64::from(node.children[(slot & 7) as usize]));
                        }
                        current = node.children[first];
                        continue;
                    }
                    current = push_sorted(node, &near, first, mask, &mut stack);
                    continue;
                }
            } else {
                // SAFETY: `build` wrote every reference, to a packet that exists, and absent children are never entered.
                let packet = unsafe { self.packets.get_unchecked((current & !LEAF) as usize) };
                // SAFETY: the caller promised that the processor has what the kernel needs.
                let mut mask = unsafe { K::triangles(packet, &prepared, &state, t_max, &mut hits) };
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize & (PACKET - 1);
                    mask &= mask - 1;
                    if hits.t[lane] < t_max {
                        let hit = Hit { t: hits.t[lane], u: hits.u[lane], v: hits.v[lane], triangle: packet.triangles[lane] };
                        if accept(&hit) {
                            if ANY {
                                return Some(hit);
                            }
                            t_max = hit.t;
                            best = Some(hit);
                        }
                    }
                }
            }
            loop {
                let Some(entry) = stack.pop() else { return best };
                if ANY || f32::from_bits((entry >> 32) as u32) < t_max {
                    current = entry as u32;
                    break;
                }
            }
        }
    }

    pub(super) fn candidates(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_max: f64,
        mut visit: impl FnMut(u32) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        // As in `walk`.
        if self.nodes.is_empty() || !(origin.is_finite() && direction.is_finite()) {
            return ControlFlow::Continue(());
        }
        let segment = Segment::new(origin, direction, t_max);
        let mut stack = Stack::new();
        let mut current = 0u32;
        loop {
            if current & LEAF == 0 {
                let node = &self.nodes[current as usize];
                let mut mask = self.segment_boxes(node, &segment);
                while mask != 0 {
                    let slot = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    stack.push(u64::from(node.children[slot & 7]));
                }
            } else {
                let packet = &self.packets[(current & !LEAF) as usize];
                for triangle in packet.triangles {
                    if triangle != u32::MAX {
                        visit(triangle)?;
                    }
                }
            }
            match stack.pop() {
                Some(entry) => current = entry as u32,
                None => return ControlFlow::Continue(()),
            }
        }
    }

    pub(super) fn in_box(&self, min: Vec3, max: Vec3, mut visit: impl FnMut(u32)) {
        if self.nodes.is_empty() {
            return;
        }
        let mut stack = vec![0u32];
        while let Some(current) = stack.pop() {
            if current & LEAF > 0 {
                let packet = &self.packets[(current & !LEAF) as usize];
                packet.triangles.into_iter().filter(|triangle| *triangle != u32::MAX).for_each(&mut visit);
                continue;
            }
            let node = &self.nodes[current as usize];
            let meets = |slot: &usize| {
                (0..3).all(|axis| node.bounds[axis][*slot] <= max[axis] && node.bounds[axis + 3][*slot] >= min[axis])
            };
            stack.extend((0..WIDTH).filter(meets).map(|slot| node.children[slot]));
        }
    }

    #[inline]
    fn segment_boxes(&self, node: &Node, segment: &Segment) -> u32 {
        match self.kernel {
            Choice::Portable => segment.boxes(node),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Choice::detect` found AVX2.
            Choice::Avx2 => unsafe { segment.boxes_avx2(node) },
        }
    }
}

/// Pushes the hit children of a node, farthest first, and returns the nearest. Ties keep the order of the children.
#[inline(always)]
fn push_sorted(node: &Node, near: &Entries, first: usize, mut rest: u32, stack: &mut Stack) -> u32 {
    // Positive floats are in the order of their bits.
    let entry = |slot: usize| u64::from(near.0[slot & 7].to_bits()) << 32 | u64::from(node.children[slot & 7]);
    let order = |a: &mut u64, b: &mut u64| (*a, *b) = ((*a).min(*b), (*a).max(*b));
    let mut a = entry(first);
    let mut b = entry(rest.trailing_zeros() as usize);
    rest &= rest - 1;
    order(&mut a, &mut b);
    if rest == 0 {
        stack.push(b);
        return a as u32;
    }
    let mut c = entry(rest.trailing_zeros() as usize);
    rest &= rest - 1;
    if rest == 0 {
        order(&mut b, &mut c);
        order(&mut a, &mut b);
        stack.push(c);
        stack.push(b);
        return a as u32;
    }
    let mut d = entry(rest.trailing_zeros() as usize);
    rest &= rest - 1;
    order(&mut c, &mut d);
    order(&mut a, &mut c);
    order(&mut b, &mut d);
    order(&mut b, &mut c);
    if rest == 0 {
        stack.push(d);
        stack.push(c);
        stack.push(b);
        return a as u32;
    }
    let mut sorted = [a, b, c, d, 0, 0, 0, 0];
    let mut count = 4;
    while rest != 0 {
        let new = entry(rest.trailing_zeros() as usize);
        rest &= rest - 1;
        let mut at = count;
        while at > 0 && sorted[at - 1] > new {
            sorted[at] = sorted[at - 1];
            at -= 1;
        }
        sorted[at] = new;
        count += 1;
    }
    for entry in sorted[1..count].iter().rev() {
        stack.push(*entry);
    }
    sorted[0] as u32
}

/// A segment in f64 against the f32 boxes.
struct Segment {
    origin: [f64; 3],
    reciprocal: [f64; 3],
    near: [usize; 3],
    far: [usize; 3],
    t_max: f64,
}

/// Slack of the f64 slab test: four roundings, as in f32. The boxes' own padding is a billion times larger.
const SEGMENT_SLACK: f64 = 1.0 + 4.0 * f64::EPSILON;

impl Segment {
    fn new(origin: DVec3, direction: DVec3, t_max: f64) -> Self {
        let d = direction.to_array();
        let negative = d.map(|c| usize::from(c.is_sign_negative()));
        Self {
            origin: origin.to_array(),
            // Finite reciprocals: no 0 · ∞ for a ray within a slab's plane.
            reciprocal: d.map(|c| 1.0 / if c.abs() < 1e-100 { 1e-100f64.copysign(c) } else { c }),
            near: [3 * negative[0], 1 + 3 * negative[1], 2 + 3 * negative[2]],
            far: [3 - 3 * negative[0], 4 - 3 * negative[1], 5 - 3 * negative[2]],
            t_max,
        }
    }

    #[inline(always)]
    fn boxes(&self, node: &Node) -> u32 {
        let (mut near, mut far) = ([0.0f64; WIDTH], [self.t_max; WIDTH]);
        for axis in 0..3 {
            let (front, back) = (&node.bounds[self.near[axis]], &node.bounds[self.far[axis]]);
            for i in 0..WIDTH {
                let n = (f64::from(front[i]) - self.origin[axis]) * self.reciprocal[axis];
                let f = (f64::from(back[i]) - self.origin[axis]) * self.reciprocal[axis] * SEGMENT_SLACK;
                near[i] = if n > near[i] { n } else { near[i] };
                far[i] = if f < far[i] { f } else { far[i] };
            }
        }
        let mut mask = 0;
        for i in 0..WIDTH {
            mask |= u32::from(near[i] <= far[i]) << i;
        }
        mask
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    unsafe fn boxes_avx2(&self, node: &Node) -> u32 {
        self.boxes(node)
    }
}
