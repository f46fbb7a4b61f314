//! The two inner tests, ray against eight boxes and ray against four triangles, in plain Rust and in AVX2.
//!
//! Both forms round every operation separately (no fused multiply-add) in the same order, so they agree bit for bit: which processor
//! rendered an image cannot be told from the image.

use super::Ray;
use glam::Vec3;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Triangles of a leaf.
pub(super) const PACKET: usize = 4;
/// The bit of a child reference that says "a packet of triangles"; the rest is the index.
pub(super) const LEAF: u32 = 1 << 31;

/// The slab test's far distance is scaled by this: four roundings (subtraction, reciprocal, product, and the stored bound), after Ize 2013.
const FAR_SLACK: f32 = 1.0 + 4.0 * f32::EPSILON;
/// Direction components smaller than this are replaced by it in reciprocals: no infinities, no NaN (0 · ∞) in the slab test.
const SMALLEST_COMPONENT: f32 = 1e-20;

/// Eight child boxes, structure of arrays.
#[derive(Clone, Debug)]
#[repr(C, align(32))]
pub(super) struct Node {
    /// min x, min y, min z, max x, max y, max z of each child; an absent child is an inverted box, which no ray enters.
    pub bounds: [[f32; WIDTH]; 6],
    /// Node index, or [`LEAF`] | packet index.
    pub children: [u32; WIDTH],
}

impl Node {
    pub const EMPTY: Self = Self {
        bounds: [
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
        ],
        children: [0; WIDTH],
    };

    /// Fills one child in, its box grown by `padding`.
    pub fn set(&mut self, slot: usize, min: Vec3, max: Vec3, padding: f32, reference: u32) {
        for axis in 0..3 {
            self.bounds[axis][slot] = min[axis] - padding;
            self.bounds[axis + 3][slot] = max[axis] + padding;
        }
        self.children[slot] = reference;
    }
}

/// Four triangles, structure of arrays: `corners[corner][axis][lane]`. Absent lanes are NaN and never hit.
#[derive(Clone, Debug)]
#[repr(C, align(16))]
pub(super) struct Packet {
    pub corners: [[[f32; PACKET]; 3]; 3],
    /// Scene indices; `u32::MAX` in absent lanes.
    pub triangles: [u32; PACKET],
}

impl Packet {
    pub const EMPTY: Self = Self { corners: [[[f32::NAN; PACKET]; 3]; 3], triangles: [u32::MAX; PACKET] };

    pub fn set(&mut self, lane: usize, corners: [Vec3; 3], triangle: u32) {
        for (corner, p) in corners.iter().enumerate() {
            for axis in 0..3 {
                self.corners[corner][axis][lane] = p[axis];
            }
        }
        self.triangles[lane] = triangle;
    }
}

/// Per-ray constants of both tests.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prepared {
    pub origin: [f32; 3],
    pub reciprocal: [f32; 3],
    /// `reciprocal`, a few roundings larger.
    pub far_reciprocal: [f32; 3],
    /// Rows of [`Node::bounds`] a ray of this direction meets first, then last, along x, y, z.
    pub near: [usize; 3],
    pub far: [usize; 3],
    pub t_min: f32,
    /// Axes permuted so that the third is the direction's largest (Woop et al. 2013).
    pub axes: [usize; 3],
    /// Shear and scale that turn the direction into +z.
    pub shear: [f32; 3],
}

impl Prepared {
    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let d = ray.direction.to_array();
        let a = d.map(f32::abs);
        let kz = if a[0] > a[1] && a[0] > a[2] {
            0
        } else if a[1] > a[2] {
            1
        } else {
            2
        };
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if d[kz] < 0.0 {
            (kx, ky) = (ky, kx);
        }
        let reciprocal = d.map(|c| 1.0 / if c.abs() < SMALLEST_COMPONENT { SMALLEST_COMPONENT.copysign(c) } else { c });
        let negative = d.map(|c| usize::from(c.is_sign_negative()));
        Self {
            origin: ray.origin.to_array(),
            reciprocal,
            far_reciprocal: reciprocal.map(|r| r * FAR_SLACK),
            near: [3 * negative[0], 1 + 3 * negative[1], 2 + 3 * negative[2]],
            far: [3 - 3 * negative[0], 4 - 3 * negative[1], 5 - 3 * negative[2]],
            t_min: ray.t_min,
            axes: [kx, ky, kz],
            shear: [d[kx] / d[kz], d[ky] / d[kz], 1.0 / d[kz]],
        }
    }
}

/// Entry distances of eight boxes, in one cache line wherever the stack lies.
#[repr(C, align(32))]
pub(super) struct Entries(pub [f32; WIDTH]);

/// Distances and barycentric weights of four triangle tests.
#[repr(C, align(16))]
pub(super) struct PacketHits {
    pub t: [f32; PACKET],
    pub u: [f32; PACKET],
    pub v: [f32; PACKET],
}

/// The pair of tests. Methods return a bit mask of the lanes that hit.
///
/// # Safety
/// A method may be called only where the processor has the features that the implementing type is named after.
pub(super) trait Kernel {
    /// Per-ray constants in the form the tests want.
    type State: Copy;
    /// The kernel's state of a ray, from the plain constants.
    unsafe fn state(ray: &Prepared) -> Self::State;
    /// Children whose boxes the ray enters before `t_max`; `near` gets the entry distances.
    unsafe fn boxes(node: &Node, ray: &Prepared, state: &Self::State, t_max: f32, near: &mut Entries) -> u32;
    /// Triangles hit in `(t_min, t_max)`.
    unsafe fn triangles(packet: &Packet, ray: &Prepared, state: &Self::State, t_max: f32, hits: &mut PacketHits) -> u32;
}

/// Plain Rust; the compiler vectorises what the target's baseline offers.
pub(super) struct Portable;

/// `maxps`/`minps`: the second operand if either is NaN.
#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

impl Kernel for Portable {
    type State = ();

    #[inline(always)]
    unsafe fn state(_: &Prepared) {}

    #[inline(always)]
    unsafe fn boxes(node: &Node, ray: &Prepared, _: &(), t_max: f32, near: &mut Entries) -> u32 {
        let mut far = [t_max; WIDTH];
        let near = &mut near.0;
        *near = [ray.t_min; WIDTH];
        for axis in 0..3 {
            let (front, back) = (&node.bounds[ray.near[axis]], &node.bounds[ray.far[axis]]);
            for i in 0..WIDTH {
                near[i] = max((front[i] - ray.origin[axis]) * ray.reciprocal[axis], near[i]);
                far[i] = min((back[i] - ray.origin[axis]) * ray.far_reciprocal[axis], far[i]);
            }
        }
        let mut mask = 0;
        for i in 0..WIDTH {
            mask |= u32::from(near[i] <= far[i]) << i;
        }
        mask
    }

    #[inline(always)]
    unsafe fn triangles(packet: &Packet, ray: &Prepared, _: &(), t_max: f32, hits: &mut PacketHits) -> u32 {
        let [kx, ky, kz] = ray.axes;
        let [sx, sy, sz] = ray.shear;
        let (mut x, mut y, mut z) = ([[0.0f32; PACKET]; 3], [[0.0f32; PACKET]; 3], [[0.0f32; PACKET]; 3]);
        for corner in 0..3 {
            let p = &packet.corners[corner];
            for i in 0..PACKET {
                let along = p[kz][i] - ray.origin[kz];
                x[corner][i] = (p[kx][i] - ray.origin[kx]) - sx * along;
                y[corner][i] = (p[ky][i] - ray.origin[ky]) - sy * along;
                z[corner][i] = sz * along;
            }
        }
        let mut mask = 0;
        for i in 0..PACKET {
            // Scaled barycentric coordinates; a shared edge gives exactly opposite values in its two triangles.
            let e0 = x[2][i] * y[1][i] - y[2][i] * x[1][i];
            let e1 = x[0][i] * y[2][i] - y[0][i] * x[2][i];
            let e2 = x[1][i] * y[0][i] - y[1][i] * x[0][i];
            let determinant = (e0 + e1) + e2;
            let inside = (e0 >= 0.0 && e1 >= 0.0 && e2 >= 0.0) || (e0 <= 0.0 && e1 <= 0.0 && e2 <= 0.0);
            let reciprocal = 1.0 / determinant;
            let t = ((e0 * z[0][i] + e1 * z[1][i]) + e2 * z[2][i]) * reciprocal;
            hits.t[i] = t;
            hits.u[i] = e1 * reciprocal;
            hits.v[i] = e2 * reciprocal;
            // A determinant of 0 makes t NaN or infinite, which is out of range.
            mask |= u32::from(inside && t > ray.t_min && t < t_max) << i;
        }
        mask
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::*;
    use std::arch::x86_64::*;

    /// 256-bit vectors for boxes, 128-bit for triangles.
    pub struct Avx2;

    #[derive(Clone, Copy)]
    pub struct State {
        origin: [__m256; 3],
        reciprocal: [__m256; 3],
        far_reciprocal: [__m256; 3],
    }

    impl Kernel for Avx2 {
        type State = State;

        #[inline(always)]
        unsafe fn state(ray: &Prepared) -> State {
            // SAFETY: the caller has AVX2 (trait contract).
            unsafe {
                State {
                    origin: ray.origin.map(|v| _mm256_set1_ps(v)),
                    reciprocal: ray.reciprocal.map(|v| _mm256_set1_ps(v)),
                    far_reciprocal: ray.far_reciprocal.map(|v| _mm256_set1_ps(v)),
                }
            }
        }

        #[inline(always)]
        unsafe fn boxes(node: &Node, ray: &Prepared, state: &State, t_max: f32, near: &mut Entries) -> u32 {
            // SAFETY: the caller has AVX2; rows are 8 floats, and loads and stores are unaligned.
            unsafe {
                let mut front = _mm256_set1_ps(ray.t_min);
                let mut back = _mm256_set1_ps(t_max);
                for axis in 0..3 {
                    let (o, r, s) = (state.origin[axis], state.reciprocal[axis], state.far_reciprocal[axis]);
                    let n = _mm256_loadu_ps(node.bounds.get_unchecked(ray.near[axis]).as_ptr());
                    let f = _mm256_loadu_ps(node.bounds.get_unchecked(ray.far[axis]).as_ptr());
                    front = _mm256_max_ps(_mm256_mul_ps(_mm256_sub_ps(n, o), r), front);
                    back = _mm256_min_ps(_mm256_mul_ps(_mm256_sub_ps(f, o), s), back);
                }
                _mm256_storeu_ps(near.0.as_mut_ptr(), front);
                _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(front, back)) as u32
            }
        }

        #[inline(always)]
        unsafe fn triangles(packet: &Packet, ray: &Prepared, _: &State, t_max: f32, hits: &mut PacketHits) -> u32 {
            // SAFETY: the caller has AVX2, hence SSE; rows are 4 floats, and loads and stores are unaligned.
            unsafe {
                let [kx, ky, kz] = ray.axes;
                let o = ray.axes.map(|k| _mm_set1_ps(*ray.origin.get_unchecked(k)));
                let s = ray.shear.map(|v| _mm_set1_ps(v));
                let corner = |p: &[[f32; PACKET]; 3]| {
                    let along = _mm_sub_ps(_mm_loadu_ps(p.get_unchecked(kz).as_ptr()), o[2]);
                    let x = _mm_sub_ps(_mm_loadu_ps(p.get_unchecked(kx).as_ptr()), o[0]);
                    let y = _mm_sub_ps(_mm_loadu_ps(p.get_unchecked(ky).as_ptr()), o[1]);
                    (_mm_sub_ps(x, _mm_mul_ps(s[0], along)), _mm_sub_ps(y, _mm_mul_ps(s[1], along)), _mm_mul_ps(s[2], along))
                };
                let (ax, ay, az) = corner(&packet.corners[0]);
                let (bx, by, bz) = corner(&packet.corners[1]);
                let (cx, cy, cz) = corner(&packet.corners[2]);
                let e0 = _mm_sub_ps(_mm_mul_ps(cx, by), _mm_mul_ps(cy, bx));
                let e1 = _mm_sub_ps(_mm_mul_ps(ax, cy), _mm_mul_ps(ay, cx));
                let e2 = _mm_sub_ps(_mm_mul_ps(bx, ay), _mm_mul_ps(by, ax));
                let zero = _mm_setzero_ps();
                let positive = _mm_and_ps(_mm_and_ps(_mm_cmpge_ps(e0, zero), _mm_cmpge_ps(e1, zero)), _mm_cmpge_ps(e2, zero));
                let negative = _mm_and_ps(_mm_and_ps(_mm_cmple_ps(e0, zero), _mm_cmple_ps(e1, zero)), _mm_cmple_ps(e2, zero));
                let inside = _mm_or_ps(positive, negative);
                if _mm_movemask_ps(inside) == 0 {
                    return 0;
                }
                let reciprocal = _mm_div_ps(_mm_set1_ps(1.0), _mm_add_ps(_mm_add_ps(e0, e1), e2));
                let weighted = _mm_add_ps(_mm_add_ps(_mm_mul_ps(e0, az), _mm_mul_ps(e1, bz)), _mm_mul_ps(e2, cz));
                let t = _mm_mul_ps(weighted, reciprocal);
                let within = _mm_and_ps(_mm_cmpgt_ps(t, _mm_set1_ps(ray.t_min)), _mm_cmplt_ps(t, _mm_set1_ps(t_max)));
                _mm_storeu_ps(hits.t.as_mut_ptr(), t);
                _mm_storeu_ps(hits.u.as_mut_ptr(), _mm_mul_ps(e1, reciprocal));
                _mm_storeu_ps(hits.v.as_mut_ptr(), _mm_mul_ps(e2, reciprocal));
                _mm_movemask_ps(_mm_and_ps(inside, within)) as u32
            }
        }
    }
}
