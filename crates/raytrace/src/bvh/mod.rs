//! A bounding volume hierarchy over a scene's triangles: closest hits, occlusion, and conservative candidates for f64 tests.
//!
//! The tree is built by `obvhs` (PLOC with reinsertion, a binary tree) and collapsed here, for the least expected cost of a ray, into
//! nodes of eight children and leaves of up to four triangles, which suit 8- and 4-wide vector units. The children of a node are in
//! the order in which a ray that ends at any hit should look at them. Traversal uses AVX2 where the processor has it and plain loops
//! elsewhere; the two do the same operations in the same order and return the same bits.
//!
//! **Watertight.** The triangle test is that of Woop, Benthin and Wald (*Watertight Ray/Triangle Intersection*, JCGT 2013): two
//! triangles that share an edge evaluate it with exactly opposite signs, so no ray slips between them. The slab test is padded
//! (Ize, *Robust BVH Ray Traversal*, JCGT 2013) so that rounding never culls a box whose triangle would be hit.
//!
//! ```
//! use corf_raytrace::{Bvh, Ray};
//! use corf_scene::{Scene, model::Triangle};
//! use glam::Vec3;
//!
//! let scene = Scene {
//!     positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
//!     triangles: vec![Triangle { vertices: [0, 1, 2], material: 0, object: 0 }],
//!     ..Scene::default()
//! };
//! let bvh = Bvh::build(&scene);
//! let hit = bvh.intersect(&Ray::new(Vec3::new(0.25, 0.25, 2.0), Vec3::NEG_Z)).unwrap();
//! assert_eq!((hit.t, hit.triangle), (2.0, 0));
//! ```

#[cfg(feature = "gpu")]
pub(crate) mod binary;
mod build;
mod collapse;
mod kernel;
mod traverse;

#[cfg(test)]
mod tests;

use corf_scene::Scene;
use glam::{DVec3, Vec3};
use std::ops::ControlFlow;

/// A ray: points `origin + t·direction` with `t_min < t < t_max`. The direction need not be of unit length; `t` counts in its length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin, metres.
    pub origin: Vec3,
    /// Direction of any length but zero.
    pub direction: Vec3,
    /// Hits at or before this are ignored.
    pub t_min: f32,
    /// Hits at or after this are ignored.
    pub t_max: f32,
}

impl Ray {
    /// The whole half-line: `0 < t < ∞`.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// The open segment between two points: `direction = to − from`, `0 < t < 1`.
    pub fn segment(from: Vec3, to: Vec3) -> Self {
        Self { origin: from, direction: to - from, t_min: 0.0, t_max: 1.0 }
    }
}

/// The intersection of a ray with a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Along the ray, in units of its direction's length.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex; the first has `1 − u − v`.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
    /// Index into [`Scene::triangles`].
    pub triangle: u32,
}

/// The hierarchy. It keeps its own copy of the triangles' corners; hits refer to the scene's triangles by index.
#[derive(Clone, Debug)]
pub struct Bvh {
    nodes: Vec<kernel::Node>,
    packets: Vec<kernel::Packet>,
    kernel: traverse::Choice,
}

impl Bvh {
    /// Builds the hierarchy (0.1 s or so per 100 000 triangles on one core; the result does not depend on the thread count).
    ///
    /// Triangles with a corner that is not finite can never be hit and are left out.
    pub fn build(scene: &Scene) -> Self {
        build::build((0..scene.triangles.len()).map(|i| scene.corners(i)))
    }

    /// A hierarchy of triangles alone; hits refer to them by their number.
    pub(crate) fn of_triangles(triangles: impl ExactSizeIterator<Item = [Vec3; 3]>) -> Self {
        build::build(triangles)
    }

    /// The closest hit in `(t_min, t_max)`.
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.intersect_where(ray, |_| true)
    }

    /// The closest hit in `(t_min, t_max)` among those that `accept` (cut-out texels, say, are refused).
    ///
    /// `accept` is asked about hits in no particular order, about each triangle at most once, and not about all that lie behind the
    /// closest.
    pub fn intersect_where(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        self.closest(ray, accept)
    }

    /// Whether anything lies in `(t_min, t_max)`.
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.occluded_where(ray, |_| true)
    }

    /// Whether anything that `accept`s lies in `(t_min, t_max)`; asked about each triangle at most once, in no particular order.
    pub fn occluded_where(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> bool {
        self.any(ray, accept)
    }

    /// Calls `visit` with every triangle that the segment `origin + t·direction`, `0 ≤ t ≤ t_max`, could touch: those in leaves
    /// whose padded boxes it meets. The padding is far above f32 rounding, so an exact test of the visited triangles in f64 misses
    /// nothing. The order is arbitrary but fixed, no triangle comes twice, and `ControlFlow::Break` ends the visit.
    pub fn visit_candidates(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_max: f64,
        visit: impl FnMut(u32) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.candidates(origin, direction, t_max, visit)
    }

    /// Calls `visit` with every triangle in leaves whose padded boxes meet the box between two corners, each once.
    pub fn visit_box(&self, min: DVec3, max: DVec3, visit: impl FnMut(u32)) {
        self.in_box(min.as_vec3(), max.as_vec3(), visit);
    }
}
