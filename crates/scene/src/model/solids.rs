//! Detection of closed bodies among the objects, and of the bodies that contain a point.
//!
//! A radio wave meets every triangle as a slab of its own; a body is two of them with air between. A mesh is a body where its surface closes
//! around a volume and faces outward. What faces inward is a room seen from inside; what has an open edge has no inside.

use crate::{Error, Result, Scene};
use glam::DVec3;
use std::collections::HashMap;

/// Corners that differ by less are one, metres: what float32 makes of a corner 10 m away from two sides.
const WELD_M: f64 = 2e-6;
/// Triangle corners further out of an object's box than this cannot lie inside of it, metres.
const BOX_MARGIN_M: f64 = 1e-9;

/// The closed, outward bodies among a scene's objects.
#[derive(Clone, Debug)]
pub struct Solids {
    bodies: Vec<Body>,
}

/// One closed object.
#[derive(Clone, Debug)]
struct Body {
    object: u32,
    min: DVec3,
    max: DVec3,
    triangles: Vec<[DVec3; 3]>,
    /// It spans the whole scene.
    hull: bool,
}

impl Solids {
    /// Finds the objects that close around a volume and face outward; indices of the scene must be in range.
    pub fn of(scene: &Scene) -> Self {
        let mut by_object: Vec<Vec<[DVec3; 3]>> = vec![Vec::new(); scene.objects.len()];
        for (i, triangle) in scene.triangles.iter().enumerate() {
            by_object[triangle.object as usize].push(scene.corners_f64(i));
        }
        let (scene_min, scene_max) = bounds(by_object.iter().flatten());
        let mut bodies = Vec::new();
        for (object, triangles) in by_object.into_iter().enumerate() {
            if triangles.is_empty() || !closed(&triangles) || volume_m3(&triangles) <= 0.0 {
                continue;
            }
            let (min, max) = bounds(&triangles);
            let hull = (min - scene_min).abs().max_element().max((max - scene_max).abs().max_element()) < 1e-3;
            bodies.push(Body { object: object as u32, min, max, triangles, hull });
        }
        Self { bodies }
    }

    /// The object a point lies in, if any; the first of them by the scene's order.
    pub fn containing(&self, point: DVec3) -> Option<u32> {
        self.bodies.iter().find(|body| body.contains(point)).map(|body| body.object)
    }

    /// Whether a point lies in an object that closes around a volume, faces outward and is not the room that everything stands in.
    pub fn in_body(&self, point: DVec3) -> bool {
        self.bodies.iter().any(|body| !body.hull && body.contains(point))
    }

    /// Whether an object closes around a volume, faces outward and is not the room that everything stands in.
    pub fn is_body(&self, object: u32) -> bool {
        self.bodies.iter().any(|body| body.object == object && !body.hull)
    }

    /// The object that parts two points by holding one of them and not the other, or holds both and is no room: an object as large as
    /// the scene with both of them in it is the room they are in.
    pub fn parting(&self, a: DVec3, b: DVec3) -> Option<Parting> {
        self.bodies.iter().find_map(|body| {
            let (holds_a, holds_b) = (body.contains(a), body.contains(b));
            let room = body.hull && holds_a && holds_b;
            (!room && (holds_a || holds_b)).then_some(Parting {
                object: body.object,
                holds_first: holds_a,
                holds_second: holds_b,
            })
        })
    }

    /// Refuses a link one end of which lies in a body: what it would hear there no model of slabs says.
    ///
    /// # Errors
    /// The object, and which end lies in it.
    pub fn check_link(&self, scene: &Scene, tx: DVec3, rx: DVec3) -> Result<()> {
        let Some(parting) = self.parting(tx, rx) else { return Ok(()) };
        let (end, at) = if parting.holds_first { ("transmitter", tx) } else { ("receiver", rx) };
        let name = scene.objects.get(parting.object as usize).map_or("", |o| o.name.as_str());
        Err(Error::invalid(
            format!("{end} at {at}"),
            format!("it lies inside the closed object \"{name}\" of {}", scene.name),
            "move it out; if the object is a room, let its faces look into the room (turn their winding)",
        ))
    }

    /// Number of closed, outward objects.
    pub fn len(&self) -> usize {
        self.bodies.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }
}

/// An object and which of two points are in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parting {
    /// Index into the scene's objects.
    pub object: u32,
    /// Whether it holds the first point.
    pub holds_first: bool,
    /// Whether it holds the second point.
    pub holds_second: bool,
}

impl Body {
    /// Winding number above ½: the signed solid angle of all triangles, over 4π.
    fn contains(&self, point: DVec3) -> bool {
        if point.cmplt(self.min - BOX_MARGIN_M).any() || point.cmpgt(self.max + BOX_MARGIN_M).any() {
            return false;
        }
        let sum: f64 = self.triangles.iter().map(|t| solid_angle_sr(t, point)).sum();
        sum > 2.0 * std::f64::consts::PI
    }
}

/// The signed solid angle of a triangle, positive seen from behind: tan(Ω/2) = a·(b×c) / (abc + (a·b)c + (b·c)a + (c·a)b)
/// (Van Oosterom and Strackee 1983).
fn solid_angle_sr(corners: &[DVec3; 3], from: DVec3) -> f64 {
    let [a, b, c] = corners.map(|p| p - from);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * a.dot(b.cross(c)).atan2(denominator)
}

/// Σ a·(b×c)/6 about the middle of the first triangle: the volume within a closed surface, positive when it faces outward.
pub(super) fn volume_m3(triangles: &[[DVec3; 3]]) -> f64 {
    let origin = triangles[0][0];
    triangles.iter().map(|t| (t[0] - origin).dot((t[1] - origin).cross(t[2] - origin))).sum::<f64>() / 6.0
}

/// Whether every edge is run through as often in one direction as in the other: the surface has no rim and one orientation.
pub(super) fn closed(triangles: &[[DVec3; 3]]) -> bool {
    let key = |p: DVec3| (p / WELD_M).round().to_array().map(|x| x as i64);
    let mut balance: HashMap<[[i64; 3]; 2], i64> = HashMap::new();
    for corners in triangles {
        for i in 0..3 {
            let (from, to) = (key(corners[i]), key(corners[(i + 1) % 3]));
            if from < to {
                *balance.entry([from, to]).or_default() += 1;
            } else if to < from {
                *balance.entry([to, from]).or_default() -= 1;
            }
        }
    }
    balance.values().all(|n| *n == 0)
}

fn bounds<'t>(triangles: impl IntoIterator<Item = &'t [DVec3; 3]>) -> (DVec3, DVec3) {
    let all = triangles.into_iter().flatten();
    all.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Object, Triangle};
    use glam::Vec3;

    /// Adds a box as one object; `inward` turns its faces.
    fn add_box(scene: &mut Scene, name: &str, min: Vec3, max: Vec3, inward: bool) {
        let object = scene.objects.len() as u32;
        scene.objects.push(Object { name: name.into() });
        let first = scene.positions.len() as u32;
        let corner = |i: usize| Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), max, min);
        scene.positions.extend((0..8).map(corner));
        for q in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            for [a, b, c] in [[q[0], q[1], q[2]], [q[0], q[2], q[3]]] {
                let [b, c] = if inward { [c, b] } else { [b, c] };
                scene.triangles.push(Triangle { vertices: [first + a, first + b, first + c], material: 0, object });
            }
        }
    }

    #[test]
    fn points_in_a_pillar_are_in_it_and_points_in_the_room_are_not() {
        for inward in [true, false] {
            let mut scene = Scene::default();
            add_box(&mut scene, "room", Vec3::ZERO, Vec3::new(6.0, 5.0, 3.0), inward);
            add_box(&mut scene, "pillar", Vec3::new(2.0, 2.0, 0.0), Vec3::new(2.5, 2.5, 3.0), false);
            let solids = Solids::of(&scene);
            let (here, there, inside, outside) =
                (DVec3::new(1.0, 1.0, 1.5), DVec3::new(5.0, 4.0, 1.0), DVec3::new(2.2, 2.3, 1.0), DVec3::new(7.0, 1.0, 1.0));
            assert_eq!(solids.parting(here, there), None, "{inward}");
            let pillar = Some(Parting { object: 1, holds_first: true, holds_second: false });
            assert_eq!(solids.parting(inside, there), pillar, "{inward}");
            assert_eq!(solids.containing(outside), None);
            assert_eq!(solids.parting(here, outside).is_some(), !inward);
            let message = solids.check_link(&scene, here, inside).unwrap_err().to_string();
            assert!(message.contains("receiver") && message.contains("\"pillar\""), "{message}");
            assert!(solids.check_link(&scene, here, there).is_ok());
        }
    }

    #[test]
    fn a_box_without_a_lid_has_no_inside() {
        let mut scene = Scene::default();
        add_box(&mut scene, "box", Vec3::ZERO, Vec3::ONE, false);
        assert_eq!(Solids::of(&scene).containing(DVec3::splat(0.5)), Some(0));
        scene.triangles.pop();
        assert!(Solids::of(&scene).is_empty());
    }

    #[test]
    fn overlapping_parts_of_one_object_are_inside_where_they_overlap() {
        let mut scene = Scene::default();
        add_box(&mut scene, "seat", Vec3::ZERO, Vec3::ONE, false);
        add_box(&mut scene, "back", Vec3::splat(0.25), Vec3::splat(1.5), false);
        scene.triangles.iter_mut().for_each(|t| t.object = 0);
        let solids = Solids::of(&scene);
        for (p, inside) in [(0.1, true), (0.5, true), (1.2, true), (1.6, false), (-0.1, false)] {
            assert_eq!(solids.containing(DVec3::splat(p)).is_some(), inside, "{p}");
        }
    }

    #[test]
    fn a_random_point_is_inside_exactly_when_the_box_says_so() {
        let mut scene = Scene::default();
        let (min, max) = (Vec3::new(-1.0, 2.0, 0.5), Vec3::new(0.5, 2.75, 3.0));
        add_box(&mut scene, "box", min, max, false);
        add_box(&mut scene, "far", Vec3::splat(20.0), Vec3::splat(21.0), false);
        let solids = Solids::of(&scene);
        for i in 0..5000 {
            let mut rng = crate::Rng::keyed(3, 0, i);
            let p = DVec3::new(rng.uniform_f64(), rng.uniform_f64(), rng.uniform_f64()) * 4.0 - DVec3::new(2.0, 0.0, 0.0);
            let expected = p.cmpgt(min.as_dvec3()).all() && p.cmplt(max.as_dvec3()).all();
            assert_eq!(solids.containing(p) == Some(0), expected, "{p}");
        }
    }
}
