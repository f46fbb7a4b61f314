//! Antennas on surfaces: on which side of it one stands, and where it is traced.
//!
//! What an antenna exactly on a surface sees is a matter of rounding. It is mounted on one side of it, and what it hears there is the limit from that
//! side: it is traced [`OFFSET_M`] off the surface.

use super::solids::Solids;
use crate::{Error, Result, Scene};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Nearer than this to a triangle, metres, a point is on it: what the tracers take for touching.
const TOUCH_M: f64 = 2e-5;
/// Distance from the surface at which a mounted antenna is traced, metres: λ/45 at 60 GHz, and just more than scattered power needs.
pub const OFFSET_M: f64 = 1.1e-4;
/// Surfaces whose normals are this close are one.
const SAME_PLANE: f64 = 1e-6;
/// An antenna that looks along a surface, to a degree, says nothing of its side.
const ALONG: f64 = 0.0175;
/// No corner has more sides that matter.
const MAX_PLANES: usize = 4;

/// An antenna on a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mount {
    /// Where it was stated to be, world, metres.
    pub stated_m: [f64; 3],
    /// Name of the object whose surface that is.
    pub object: String,
    /// Unit direction off the surface, towards the side on which it is.
    pub side: [f64; 3],
    /// What said which side that is.
    pub by: Reason,
    /// Where it is traced, world, metres.
    pub position_m: [f64; 3],
}

/// What says on which side of a surface an antenna is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// The other side is inside of a body.
    FreeSide,
    /// Its boresight looks to that side.
    Boresight,
    /// The other side is outside of the scene.
    InsideScene,
    /// Nothing else did: the surface faces that side.
    Front,
}

impl Reason {
    fn words(self) -> &'static str {
        match self {
            Self::FreeSide => "the other side is inside of a body",
            Self::Boresight => "its boresight looks there",
            Self::InsideScene => "the other side is outside of the scene",
            Self::Front => "the surface faces there",
        }
    }
}

impl Mount {
    /// Where it is traced, world, metres.
    pub fn position(&self) -> DVec3 {
        DVec3::from_array(self.position_m)
    }

    /// In words, for whose antenna it is.
    pub fn words(&self, whose: &str) -> String {
        let [x, y, z] = self.side;
        format!(
            "{whose} is on the surface of \"{}\", on the side ({x:.2}, {y:.2}, {z:.2}) ({}): traced {} mm off it",
            self.object,
            self.by.words(),
            1e3 * OFFSET_M
        )
    }
}

/// The surfaces of a scene that antennas may be on.
#[derive(Clone, Debug)]
pub struct Surfaces<'s> {
    scene: &'s Scene,
    solids: Solids,
    /// Box around the scene.
    bounds: [DVec3; 2],
}

/// One side for each plane at a point, and what chose them.
struct Sides {
    left: Vec<Vec<f64>>,
    by: Option<Reason>,
}

impl Sides {
    /// Keeps those that pass, if any do; what told them apart first is why.
    fn narrow(&mut self, by: Reason, passes: impl Fn(&[f64]) -> bool) {
        let passing: Vec<Vec<f64>> = self.left.iter().filter(|signs| passes(signs)).cloned().collect();
        if !passing.is_empty() && passing.len() < self.left.len() {
            self.left = passing;
            self.by.get_or_insert(by);
        }
    }
}

impl<'s> Surfaces<'s> {
    /// Of a scene.
    pub fn of(scene: &'s Scene) -> Self {
        let bounds = scene.bounds().map_or([DVec3::NEG_INFINITY, DVec3::INFINITY], |b| [b.min.as_dvec3(), b.max.as_dvec3()]);
        Self { scene, solids: Solids::of(scene), bounds }
    }

    /// The mount of an antenna at a position, `None` off all surfaces. `facing` is its boresight, of an antenna that has one; a side in a body is
    /// never chosen, then it decides, then which side is within the scene, then which way the surface faces.
    ///
    /// # Errors
    /// Both sides are in bodies, or more surfaces meet there than a corner has.
    pub fn mount(&self, whose: &str, position: DVec3, facing: Option<DVec3>) -> Result<Option<Mount>> {
        let touching: Vec<usize> =
            (0..self.scene.triangles.len()).into_par_iter().filter(|i| self.distance_m(*i, position) <= TOUCH_M).collect();
        let Some(first) = touching.first() else { return Ok(None) };
        let object = &self.scene.objects[self.scene.triangles[*first].object as usize].name;
        let refuse = |what: String, help: &str| Err(Error::invalid(format!("{whose} at {position}"), what, help));
        let mut planes: Vec<DVec3> = Vec::new();
        for normal in touching.iter().map(|i| self.normal(*i)) {
            if !planes.iter().any(|n| n.dot(normal).abs() > 1.0 - SAME_PLANE) {
                planes.push(normal);
            }
        }
        if planes.len() > MAX_PLANES {
            let what = format!("{} surfaces of \"{object}\" and others meet there", planes.len());
            return refuse(what, "move it off the corner by a millimetre");
        }
        // Off every surface by the same distance, which of skew ones is further than along each normal.
        let off = |signs: &[f64]| planes.iter().zip(signs).fold(DVec3::ZERO, |sum, (n, sign)| sum + *n * *sign * OFFSET_M);
        let every = (0..1usize << planes.len())
            .map(|bits| (0..planes.len()).map(|k| if bits >> k & 1 == 0 { 1.0 } else { -1.0 }).collect::<Vec<f64>>());
        let all = every.len();
        let free: Vec<Vec<f64>> = every.filter(|signs| !self.solids.in_body(position + off(signs))).collect();
        if free.is_empty() {
            return refuse(
                format!("it lies on the surface of \"{object}\", and every side of it is inside of a closed object"),
                "move it to where there is air; if the object is a room, let its faces look into the room (turn their winding)",
            );
        }
        let by = (free.len() < all).then_some(Reason::FreeSide).filter(|_| free.len() == 1);
        let mut sides = Sides { left: free, by };
        if let Some(facing) = facing {
            let looks = |signs: &[f64]| {
                let mut cosines = planes.iter().zip(signs).map(|(n, sign)| n.dot(facing) * sign);
                cosines.all(|cosine| cosine > -ALONG)
            };
            sides.narrow(Reason::Boresight, looks);
        }
        let [min, max] = self.bounds;
        let inside = |signs: &[f64]| {
            let p = position + off(signs);
            p.cmpge(min).all() && p.cmple(max).all()
        };
        sides.narrow(Reason::InsideScene, inside);
        // The sides of planes that are free on both come in the order of their fronts.
        let (signs, by) =
            (&sides.left[0], if sides.left.len() > 1 { Reason::Front } else { sides.by.unwrap_or(Reason::FreeSide) });
        let moved = off(signs);
        Ok(Some(Mount {
            stated_m: position.to_array(),
            object: object.clone(),
            side: moved.normalize_or_zero().to_array(),
            by,
            position_m: (position + moved).to_array(),
        }))
    }

    /// Unit normal of a triangle, to the side from which it is wound counter-clockwise.
    fn normal(&self, triangle: usize) -> DVec3 {
        let [a, b, c] = self.scene.corners_f64(triangle);
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Distance of a point from a triangle's plane where it lies over the triangle or within [`TOUCH_M`] of it; infinite elsewhere.
    fn distance_m(&self, triangle: usize, p: DVec3) -> f64 {
        let [a, b, c] = self.scene.corners_f64(triangle);
        let (min, max) = (a.min(b).min(c) - TOUCH_M, a.max(b).max(c) + TOUCH_M);
        if p.cmplt(min).any() || p.cmpgt(max).any() {
            return f64::INFINITY;
        }
        let normal = (b - a).cross(c - a);
        let length = normal.length();
        if length == 0.0 {
            return f64::INFINITY;
        }
        let n = normal / length;
        let over = [(a, b), (b, c), (c, a)].iter().all(|(from, to)| {
            let edge = *to - *from;
            // How far within the edge's line.
            n.cross(edge).dot(p - *from) >= -TOUCH_M * edge.length()
        });
        if over { (p - a).dot(n).abs() } else { f64::INFINITY }
    }
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

    /// A room of 6 × 5 × 3 m with a pillar in it and a screen, one sheet across.
    fn room(inward: bool) -> Scene {
        let mut scene = Scene::default();
        add_box(&mut scene, "room", Vec3::ZERO, Vec3::new(6.0, 5.0, 3.0), inward);
        add_box(&mut scene, "pillar", Vec3::new(2.0, 2.0, 0.0), Vec3::new(2.5, 2.5, 3.0), false);
        scene.objects.push(Object { name: "screen".into() });
        let first = scene.positions.len() as u32;
        scene.positions.extend([[4.0, 1.0, 1.0], [4.0, 3.0, 1.0], [4.0, 3.0, 2.0]].map(Vec3::from));
        scene.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material: 0, object: 2 });
        scene
    }

    #[test]
    fn antennas_are_on_the_side_where_they_can_be() {
        let east = Some(DVec3::X);
        for inward in [true, false] {
            let scene = room(inward);
            let surfaces = Surfaces::of(&scene);
            for (position, facing, object, side, by) in [
                // Both sides of a ceiling's sheet are air: one is outside of the scene, whichever way the sheet is wound.
                ([1.0, 1.0, 3.0], None, "room", [0.0, 0.0, -1.0], Reason::InsideScene),
                ([1.0, 1.0, 3.0], Some(-DVec3::Z), "room", [0.0, 0.0, -1.0], Reason::Boresight),
                // A boresight along the surface says nothing, and one out of the scene means what it says.
                ([1.0, 1.0, 3.0], east, "room", [0.0, 0.0, -1.0], Reason::InsideScene),
                ([6.0, 1.0, 1.0], east, "room", [1.0, 0.0, 0.0], Reason::Boresight),
                // A pillar is solid, whatever the boresight.
                ([2.5, 2.2, 1.0], None, "pillar", [1.0, 0.0, 0.0], Reason::FreeSide),
                ([2.5, 2.2, 1.0], Some(-DVec3::X), "pillar", [1.0, 0.0, 0.0], Reason::FreeSide),
                // A screen has air on both sides.
                ([4.0, 2.8, 1.5], Some(-DVec3::X), "screen", [-1.0, 0.0, 0.0], Reason::Boresight),
                ([4.0, 2.8, 1.5], None, "screen", [1.0, 0.0, 0.0], Reason::Front),
            ] {
                let mount = surfaces.mount("transmitter", position.into(), facing).unwrap().unwrap();
                assert_eq!((mount.object.as_str(), mount.by), (object, by), "{inward} {position:?} {facing:?}");
                assert!((DVec3::from(mount.side) - DVec3::from(side)).length() < 1e-9, "{mount:?}");
                assert!((mount.position() - (DVec3::from(position) + OFFSET_M * DVec3::from(side))).length() < 1e-9);
                assert!(mount.words("transmitter").contains(object));
            }
            // In a corner of walls and ceiling, off all of them.
            let corner = surfaces.mount("receiver", DVec3::new(0.0, 0.0, 3.0), None).unwrap().unwrap();
            assert!((corner.position() - DVec3::new(OFFSET_M, OFFSET_M, 3.0 - OFFSET_M)).length() < 1e-9, "{corner:?}");
            // Beside the screen's edge, off surfaces, and where float32 has its rounding.
            for (position, on) in [([4.0, 1.5, 1.9], false), ([1.0, 1.0, 2.99], false), ([1.0, 1.0, 3.0 - 1.9e-5], true)] {
                assert_eq!(surfaces.mount("receiver", position.into(), None).unwrap().is_some(), on, "{position:?}");
            }
        }
    }

    #[test]
    fn between_two_bodies_there_is_no_side() {
        let mut scene = room(true);
        add_box(&mut scene, "cabinet", Vec3::new(2.5, 2.0, 0.0), Vec3::new(3.0, 2.5, 3.0), false);
        let message = Surfaces::of(&scene).mount("receiver", DVec3::new(2.5, 2.2, 1.0), None).unwrap_err().to_string();
        assert!(message.contains("receiver at") && message.contains("\"pillar\"") && message.contains("every side"), "{message}");
    }
}
