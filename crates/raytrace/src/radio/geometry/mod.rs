//! The scene as the image method sees it: f64 triangles gathered into planar faces of one object and one material.

pub(in crate::radio) mod face;
mod faces;
pub(in crate::radio) mod planar;

use super::Slab;
use crate::bvh::{Bvh, Ray};
use corf_scene::solids::Solids;
use corf_scene::{Error, Result, Scene};
use face::Face;
use glam::{DVec3, Vec3};
use std::ops::ControlFlow;

/// A crossing this close to a segment's end belongs to the end itself, metres.
pub(super) const END_CLEARANCE_M: f64 = 1e-9;
/// Hits this close are at one place: a joint of panels or an edge between faces, metres.
const SAME_CROSSING_M: f64 = 1e-9;
/// Distance from a point where faces meet at which its surroundings are probed, metres.
pub(super) const BESIDE_M: f64 = 1e-6;
/// Number of directions in which they are probed.
const BESIDE: usize = 8;
/// Surfaces that come this near touch, metres: gaps of λ/250 at 60 GHz let nothing through, and float32 has steps of 8 µm at 100 m.
pub(super) const TOUCHING_M: f64 = 2e-5;
/// A ray beside one that meets an edge, metres from it: the same whichever way it runs, and along no axis or diagonal.
pub(super) const BESIDE_RAY_M: DVec3 = DVec3::new(3.7e-7, 5.3e-7, 7.6e-7);
/// Two bounces this close, metres, are where two faces meet; rounding puts them on either side.
const MEETING_M: f64 = 1e-12;
/// Up to this many triangles all of them are tried; the list is exact and needs no bounding boxes.
const BRUTE_FORCE_TRIANGLES: usize = 64;

/// A straight segment's crossing of a face.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    /// Distance from the segment's start, metres.
    pub distance_m: f64,
    /// Index into [`Geometry::faces`].
    pub face: u32,
}

/// The intersection of a ray with the first surface on its way.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceHit {
    /// Index into [`Geometry::faces`].
    pub face: u32,
    /// Distance along the ray, metres.
    pub distance_m: f64,
    /// Exactly on the face's plane, off which single precision left it.
    pub point: DVec3,
    /// The face's, on the ray's side.
    pub normal: DVec3,
    /// 0 where that is the face's own normal, 1 where it is the reverse.
    pub side: usize,
}

/// The intersection of a ray with a triangle.
struct TriangleHit {
    distance_m: f64,
    face: u32,
}

/// Search for the triangles that block a segment: all in turn, or through the bounding volume hierarchy.
enum Occluders<'a> {
    Brute,
    Bvh(&'a Bvh),
}

/// Triangles, faces and slabs of one scene at one frequency.
pub struct Geometry<'a> {
    /// Planar faces.
    pub faces: Vec<Face>,
    /// Radio materials by the scene's material index; `None` for one no triangle uses.
    pub slabs: Vec<Option<Slab>>,
    corners: Vec<[DVec3; 3]>,
    face_of_triangle: Vec<u32>,
    /// Whether an object closes around a volume and faces outward, by object.
    bodies: Vec<bool>,
    occluders: Occluders<'a>,
}

impl<'a> Geometry<'a> {
    /// Gathers the scene's triangles into faces; with `bvh` absent every triangle is tried against every segment.
    ///
    /// # Errors
    /// A material without radio properties, or one outside its validity range.
    pub fn new(scene: &Scene, bvh: Option<&'a Bvh>, frequency_hz: f64) -> Result<Self> {
        let missing = scene.materials_without_radio();
        if !missing.is_empty() {
            return Err(Error::invalid(
                format!("scene `{}`", scene.name),
                format!("no radio properties for the material(s) {}", missing.join(", ")),
                "give each one in the scene's TOML under [radio_materials.\"name\"] or in the glTF material's extras.corf_radio",
            ));
        }
        let mut used = vec![false; scene.materials.len()];
        scene.triangles.iter().for_each(|t| used[t.material as usize] = true);
        let mut slabs = Vec::with_capacity(used.len());
        for (material, used) in scene.materials.iter().zip(&used) {
            slabs.push(match &material.radio {
                Some(radio) if *used => Some(Slab::from_radio(radio, frequency_hz)?),
                _ => None,
            });
        }
        let corners: Vec<[DVec3; 3]> = (0..scene.triangles.len()).map(|i| scene.corners_f64(i)).collect();
        let (faces, face_of_triangle) = faces::gather(scene, &corners);
        let occluders = match bvh {
            Some(bvh) if corners.len() > BRUTE_FORCE_TRIANGLES => Occluders::Bvh(bvh),
            _ => Occluders::Brute,
        };
        let solids = Solids::of(scene);
        let bodies = (0..scene.objects.len() as u32).map(|object| solids.is_body(object)).collect();
        Ok(Self { faces, slabs, corners, face_of_triangle, bodies, occluders })
    }

    /// The slab of a face. Faces exist only for triangles, whose materials were all resolved.
    pub fn slab(&self, face: u32) -> &Slab {
        match &self.slabs[self.faces[face as usize].material as usize] {
            Some(slab) => slab,
            None => unreachable!("a face's material is used by its triangles"),
        }
    }

    /// The face of a triangle.
    pub fn face_of_triangle(&self, triangle: u32) -> u32 {
        self.face_of_triangle[triangle as usize]
    }

    /// Exact corners of a triangle.
    pub fn corners(&self, triangle: u32) -> &[DVec3; 3] {
        &self.corners[triangle as usize]
    }

    /// Whether something stands on or against a surface at a point of it: looking along `normal`, the unit normal of the side in
    /// question, one sees a face within `contact_m`, or a closed body from its inside.
    pub fn covered(&self, point: DVec3, normal: DVec3, contact_m: f64, clearance_m: f64) -> bool {
        self.closest(point, normal, clearance_m).is_some_and(|(distance_m, triangle)| {
            let [a, b, c] = self.corners[triangle as usize];
            let inside = (b - a).cross(c - a).dot(normal) > 0.0;
            let object = self.faces[self.face_of_triangle[triangle as usize] as usize].object;
            distance_m < contact_m || (inside && self.bodies[object as usize])
        })
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.corners.len()
    }

    /// Whether a point of one face belongs to the sheet of another: both are parallel, and the point is as near to the other's plane as
    /// surfaces touch.
    pub(super) fn is_of_sheet(&self, face: u32, point: DVec3, sheet: u32) -> bool {
        let plane = &self.faces[sheet as usize];
        face == sheet || (plane.is_parallel(&self.faces[face as usize]) && plane.distance(point).abs() <= TOUCHING_M)
    }

    /// Whether a point of a face belongs to one of some sheets.
    fn is_of_one(&self, face: u32, point: DVec3, sheets: &[Option<u32>]) -> bool {
        sheets.iter().flatten().any(|sheet| self.is_of_sheet(face, point, *sheet))
    }

    /// Whether another piece of a face's sheet is the mirror at a point of the face for waves on the side of `before`, since it lies ahead.
    pub(super) fn is_behind_its_sheet(&self, face: u32, at: DVec3, before: DVec3) -> bool {
        let plane = &self.faces[face as usize];
        let side = plane.normal * plane.distance(before).signum();
        let mut behind = false;
        self.visit_triangles_near(at, TOUCHING_M, |triangle| {
            let other = self.face_of_triangle[triangle];
            let piece = &self.faces[other as usize];
            if behind || other == face || !plane.is_parallel(piece) {
                return;
            }
            let ahead_m = -piece.distance(at) / piece.normal.dot(side);
            // Of two in one place rounding never leaves out both: what bounces off either is one path.
            let rounding_m = if other < face { 0.0 } else { MEETING_M };
            behind = ahead_m > rounding_m && ahead_m <= TOUCHING_M && piece.contains(at + side * ahead_m);
        });
        behind
    }

    /// Every face that the open segment `from → to` crosses, in order, the sheets of `skip` aside, on which its ends lie; `None` once there
    /// are more than `limit`.
    pub fn crossings<const N: usize>(
        &self,
        from: DVec3,
        to: DVec3,
        skip: [Option<u32>; N],
        limit: usize,
    ) -> Option<Vec<Crossing>> {
        let length = from.distance(to);
        if length <= 2.0 * END_CLEARANCE_M {
            return Some(Vec::new());
        }
        let direction = (to - from) / length;
        // Hits in order of their coming, and at how many places there are some: never more than crossings.
        let (mut hits, mut places): (Vec<TriangleHit>, usize) = (Vec::new(), 0);
        let mut visit = |triangle: usize| {
            let face = self.face_of_triangle[triangle];
            if skip.contains(&Some(face)) {
                return ControlFlow::Continue(());
            }
            let Some(t) = line_meets_triangle(from, direction, &self.corners[triangle]) else { return ControlFlow::Continue(()) };
            if t <= END_CLEARANCE_M || t >= length - END_CLEARANCE_M || self.is_of_one(face, from + direction * t, &skip) {
                return ControlFlow::Continue(());
            }
            places += usize::from(!hits.iter().any(|hit| hit.face == face || (hit.distance_m - t).abs() < SAME_CROSSING_M));
            hits.push(TriangleHit { distance_m: t, face });
            if places > limit { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        match self.occluders {
            Occluders::Brute => {
                for triangle in 0..self.corners.len() {
                    if visit(triangle).is_break() {
                        break;
                    }
                }
            }
            Occluders::Bvh(bvh) => {
                // Whether it broke off shows in the number of places.
                let _ = bvh.visit_candidates(from, direction, length, |triangle| visit(triangle as usize));
            }
        }
        if places > limit {
            return None;
        }
        let found = self.sheets(from, direction, length, hits, skip);
        (found.len() <= limit).then_some(found)
    }

    /// The sheets that a ray goes through, in order, from all its hits.
    fn sheets<const N: usize>(
        &self,
        from: DVec3,
        direction: DVec3,
        length_m: f64,
        mut hits: Vec<TriangleHit>,
        skip: [Option<u32>; N],
    ) -> Vec<Crossing> {
        // Faces, not visiting order, break ties: the answer does not depend on the search structure.
        hits.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.face.cmp(&b.face)));
        let mut found: Vec<Crossing> = Vec::new();
        for at_one in hits.chunk_by(|a, b| b.distance_m - a.distance_m < SAME_CROSSING_M) {
            let distance_m = at_one[0].distance_m;
            let beside = self.hits_beside(from, direction, distance_m, &skip);
            let first = &self.faces[at_one[0].face as usize];
            let level = at_one.iter().chain(&beside).all(|hit| first.is_parallel(&self.faces[hit.face as usize]));
            // At an edge or a corner rounding may miss one of the surfaces that meet: a ray beside says how many there are to go through.
            let at_end = distance_m.min(length_m - distance_m) < TOUCHING_M;
            for hit in if at_end || (level && !beside.is_empty()) { at_one } else { &beside } {
                let same = |c: &&mut Crossing| {
                    c.face == hit.face
                        || ((c.distance_m - hit.distance_m).abs() < SAME_CROSSING_M
                            && self.is_one_sheet(c.face, hit.face, from + direction * hit.distance_m))
                };
                match found.iter_mut().find(same) {
                    Some(known) => known.face = known.face.min(hit.face),
                    None => found.push(Crossing { distance_m: hit.distance_m, face: hit.face }),
                }
            }
        }
        found
    }

    /// Hits near a hit's distance of the parallel ray beside it, by [`BESIDE_RAY_M`], the sheets of `skip` aside: other triangles than the ray's own
    /// only at an edge.
    fn hits_beside(&self, from: DVec3, direction: DVec3, distance_m: f64, skip: &[Option<u32>]) -> Vec<TriangleHit> {
        let mut hits = Vec::new();
        self.visit_triangles_near(from + direction * distance_m, TOUCHING_M, |triangle| {
            let face = self.face_of_triangle[triangle];
            let meets = line_meets_triangle(from + BESIDE_RAY_M, direction, &self.corners[triangle]);
            let of_end = |t: f64| self.is_of_one(face, from + BESIDE_RAY_M + direction * t, skip);
            if meets.is_some_and(|t| (t - distance_m).abs() < TOUCHING_M && !of_end(t)) {
                hits.push(TriangleHit { distance_m, face });
            }
        });
        hits.sort_by_key(|hit| hit.face);
        hits
    }

    /// Calls `visit` with the triangles whose boxes come within `reach_m` of a point, and maybe others.
    pub(super) fn visit_triangles_near(&self, point: DVec3, reach_m: f64, visit: impl FnMut(usize)) {
        self.visit_triangles_in_box(point - reach_m, point + reach_m, visit);
    }

    /// Calls `visit` with the triangles whose boxes meet the one between two corners, and maybe others.
    pub(super) fn visit_triangles_in_box(&self, min: DVec3, max: DVec3, mut visit: impl FnMut(usize)) {
        match self.occluders {
            Occluders::Brute => (0..self.corners.len()).for_each(visit),
            Occluders::Bvh(bvh) => bvh.visit_box(min, max, |triangle| visit(triangle as usize)),
        }
    }

    /// Whether a ray that meets two faces at one point goes through one sheet there: panels in one plane, of one thing or side by side.
    pub(super) fn is_one_sheet(&self, first: u32, second: u32, at: DVec3) -> bool {
        let (a, b) = (&self.faces[first as usize], &self.faces[second as usize]);
        if !a.is_parallel(b) {
            return false;
        }
        if a.object == b.object && a.material == b.material {
            return true;
        }
        // Side by side no point beside the joint is on both.
        let (u, v) = a.normal.any_orthonormal_pair();
        (0..BESIDE).all(|i| {
            let angle = std::f64::consts::TAU * (i as f64 + 0.3) / BESIDE as f64;
            let beside = at + (u * angle.cos() + v * angle.sin()) * BESIDE_M;
            !(a.contains(beside) && b.contains(beside))
        })
    }

    /// The first triangle along a ray beyond `clearance_m`: (distance, triangle).
    pub fn closest(&self, origin: DVec3, direction: DVec3, clearance_m: f64) -> Option<(f64, u32)> {
        match self.occluders {
            Occluders::Brute => {
                let mut best: Option<(f64, u32)> = None;
                for (i, corners) in self.corners.iter().enumerate() {
                    if let Some(t) = line_meets_triangle(origin, direction, corners)
                        && t > clearance_m
                        && best.is_none_or(|b| t < b.0)
                    {
                        best = Some((t, i as u32));
                    }
                }
                best
            }
            Occluders::Bvh(bvh) => {
                let ray = Ray {
                    origin: origin.as_vec3(),
                    direction: direction.as_vec3(),
                    t_min: clearance_m as f32,
                    t_max: f32::INFINITY,
                };
                bvh.intersect(&ray).map(|hit| (f64::from(hit.t), hit.triangle))
            }
        }
    }

    /// The first surface along a ray of unit direction, beyond `clearance_m`.
    pub fn intersect(&self, origin: DVec3, direction: DVec3, clearance_m: f64) -> Option<SurfaceHit> {
        let (distance_m, triangle) = self.closest(origin, direction, clearance_m)?;
        let face = self.face_of_triangle(triangle);
        let plane = &self.faces[face as usize];
        let reached = origin + direction * distance_m;
        let side = usize::from(plane.normal.dot(direction) > 0.0);
        Some(SurfaceHit {
            face,
            distance_m,
            point: reached - plane.normal * plane.distance(reached),
            normal: if side == 0 { plane.normal } else { -plane.normal },
            side,
        })
    }

    /// Asks `blocks` about the faces between two points pulled in by `clearance_m`, in any order, some more than once, until it says
    /// yes; returns whether it did (single precision is enough for power).
    pub fn occluded(&self, from: DVec3, to: DVec3, clearance_m: f64, mut blocks: impl FnMut(u32) -> bool) -> bool {
        match self.occluders {
            Occluders::Brute => {
                let length = from.distance(to);
                let direction = (to - from) / length;
                length > 2.0 * clearance_m
                    && self.corners.iter().zip(&self.face_of_triangle).any(|(corners, face)| {
                        line_meets_triangle(from, direction, corners).is_some_and(|t| t > clearance_m && t < length - clearance_m)
                            && blocks(*face)
                    })
            }
            Occluders::Bvh(bvh) => pulled_in(from, to, clearance_m)
                .is_some_and(|ray| bvh.occluded_where(&ray, |hit| blocks(self.face_of_triangle[hit.triangle as usize]))),
        }
    }

    /// A tree of the triangles whose faces `blocks`, for [`blocked`]; none where there is no tree of all.
    pub(super) fn tree_of(&self, blocks: impl Fn(u32) -> bool) -> Option<Bvh> {
        let Occluders::Bvh(_) = self.occluders else { return None };
        let of_face = self.corners.iter().zip(&self.face_of_triangle).filter(|(_, face)| blocks(**face));
        let triangles: Vec<[Vec3; 3]> = of_face.map(|(corners, _)| corners.map(|p| p.as_vec3())).collect();
        Some(Bvh::of_triangles(triangles.into_iter()))
    }
}

/// Whether a tree of triangles blocks the segment between two points pulled in by `clearance_m`.
pub(super) fn blocked(tree: &Bvh, from: DVec3, to: DVec3, clearance_m: f64) -> bool {
    pulled_in(from, to, clearance_m).is_some_and(|ray| tree.occluded(&ray))
}

/// The segment between two points pulled in by `clearance_m`, if something is left of it.
fn pulled_in(from: DVec3, to: DVec3, clearance_m: f64) -> Option<Ray> {
    let length = from.distance(to);
    (length > 2.0 * clearance_m).then(|| Ray {
        origin: from.as_vec3(),
        direction: ((to - from) / length).as_vec3(),
        t_min: clearance_m as f32,
        t_max: (length - clearance_m) as f32,
    })
}

/// Intersection of a line with a triangle, as a signed distance along the unit `direction`.
///
/// The edge functions of a shared edge are exact negatives of one another in the two triangles, so that no line slips through a mesh.
fn line_meets_triangle(origin: DVec3, direction: DVec3, corners: &[DVec3; 3]) -> Option<f64> {
    let [a, b, c] = corners.map(|p| p - origin);
    let (u, v, w) = (direction.dot(c.cross(b)), direction.dot(a.cross(c)), direction.dot(b.cross(a)));
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return None;
    }
    let determinant = u + v + w;
    if determinant == 0.0 {
        return None;
    }
    let normal = (b - a).cross(c - a);
    Some(a.dot(normal) / direction.dot(normal))
}

impl Geometry<'_> {
    /// Specular point of the image method: the intersection of the face with the line from `target` to an `image` behind the face.
    pub(super) fn bounce(&self, face: u32, target: DVec3, image: DVec3) -> Option<DVec3> {
        let face = &self.faces[face as usize];
        let (here, behind) = (face.distance(target), face.distance(image));
        // A target on the face is the bounce before, where two faces meet.
        if behind == 0.0 || (here * behind > 0.0 && here.abs() > MEETING_M) {
            return None;
        }
        let point = if here.abs() > MEETING_M { target + (image - target) * (here / (here - behind)) } else { target };
        face.reflects_at(point).then_some(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_a_shared_edge_meets_one_of_the_two_triangles() {
        let mut rng = corf_scene::Rng::keyed(5, 0, 0);
        let mut point = || DVec3::new(rng.uniform_f64(), rng.uniform_f64(), rng.uniform_f64()) * 7.0 - 3.0;
        for _ in 0..20_000 {
            let (a, b, c, d) = (point(), point(), point(), point());
            let target = a.lerp(b, 0.37);
            let origin = point();
            let direction = (target - origin).normalize();
            // Seen along the ray the two triangles lie on either side of their edge, so that aiming at it cannot miss both.
            let opposite = direction.dot((b - a).cross(c - a)) * direction.dot((b - a).cross(d - a)) < 0.0;
            if opposite {
                let hits = [[a, b, c], [b, a, d]].iter().filter(|t| line_meets_triangle(origin, direction, t).is_some()).count();
                assert!(hits >= 1, "leak at {target}");
            }
        }
    }
}
