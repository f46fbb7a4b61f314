//! Planar faces: the mirrors of the image method.

use crate::radio::geometry::planar::{PlanarBounds, PlanarIndex};
use glam::{DVec2, DVec3};

/// Largest deviation of the normals of two faces of one plane: 1 − cos of 4e-5 rad.
const SAME_PLANE_NORMAL: f64 = 1e-9;
/// Largest distance between the planes of two faces that count as one plane, metres.
const SAME_PLANE_M: f64 = 1e-6;
/// Largest deviation of two triangles' normals within one face: 1 − cos of the angle between them, 1e-3 rad.
pub(in crate::radio) const COPLANAR_NORMAL: f64 = 5e-7;
/// Rounding of a point that the image method finds, metres.
const BOUNCE_ROUNDING_M: f64 = 1e-12;

/// A planar patch: every triangle of one plane, object and material.
#[derive(Clone, Debug)]
pub struct Face {
    /// Unit normal of the plane n·x = `offset_m`.
    pub normal: DVec3,
    /// Plane offset, metres.
    pub offset_m: f64,
    /// Index into [`Geometry::slabs`](super::Geometry::slabs) (and the scene's materials).
    pub material: u32,
    /// Index into the scene's objects.
    pub object: u32,
    /// Total area, m².
    pub area_m2: f64,
    pub(in crate::radio) index: PlanarIndex,
}

impl Face {
    /// Signed distance of a point from the plane, metres.
    pub fn distance(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset_m
    }

    /// The mirror image of a point.
    pub fn mirror(&self, point: DVec3) -> DVec3 {
        point - self.normal * (2.0 * self.distance(point))
    }

    /// Whether both lie in one plane, to rounding.
    pub fn shares_plane(&self, other: &Self) -> bool {
        let cos = self.normal.dot(other.normal);
        cos.abs() > 1.0 - SAME_PLANE_NORMAL && (self.offset_m - other.offset_m * cos.signum()).abs() < SAME_PLANE_M
    }

    /// Whether both lie in parallel planes, as triangles of one plane do.
    pub(in crate::radio) fn is_parallel(&self, other: &Self) -> bool {
        self.normal.dot(other.normal).abs() >= 1.0 - COPLANAR_NORMAL
    }

    /// Corners of a parallelogram of the plane that holds the face.
    pub fn hull(&self) -> [DVec3; 4] {
        self.index.hull(self.normal, self.offset_m)
    }

    /// The box of the face's triangles on two axes.
    pub fn bounds(&self) -> PlanarBounds {
        self.index.bounds()
    }

    /// `count` points spread evenly over the face; a single one lies in its middle, where that is a part of it.
    pub fn spread(&self, count: usize) -> Vec<DVec3> {
        let centroid = (count == 1).then(|| self.index.centroid(self.normal, self.offset_m));
        match centroid.filter(|&p| self.contains(p)) {
            Some(middle) => vec![middle],
            None => self.index.spread(self.normal, self.offset_m, count),
        }
    }

    /// The point of the face at a `share` ∈ [0, 1) of its area and a `place` ∈ [0, 1)² there: evenly spread where both are.
    pub fn point(&self, share: f64, place: DVec2) -> DVec3 {
        self.index.point(self.normal, self.offset_m, share, place)
    }

    /// Whether a point of the plane lies on one of the triangles (edges belong to the face).
    pub fn contains(&self, point: DVec3) -> bool {
        self.index.contains(point, 0.0)
    }

    /// Whether a bounce at a point is on the face, to rounding: a bounce in a corner lies on both faces, of whose edges it may be off by
    /// its last digits.
    pub(in crate::radio) fn reflects_at(&self, point: DVec3) -> bool {
        self.index.contains(point, BOUNCE_ROUNDING_M)
    }
}
