//! Surfaces that meet where a wave bounces: a wall that stands on the floor a path bounces off, exactly there.
//!
//! No leg of such a path crosses the wall: both end where it begins. Every path beside it does. So the legs before and after a bounce lie on
//! one side of every other face that touches the point, or that face is in the way: it is passed as a slab, or blocks.

use crate::radio::MAX_INTERACTIONS;
use crate::radio::geometry::face::Face;
use crate::radio::geometry::{BESIDE_RAY_M, Crossing, END_CLEARANCE_M, Geometry, TOUCHING_M};
use crate::radio::paths::ray_path::{PathEvent, Propagator, RayPath};
use glam::DVec3;

/// Largest distance from a bounce at which another face is looked for, metres: enough to be clear of a gap between surfaces that touch.
const MOST_BESIDE_M: f64 = 1e-3;

/// The bounces of a path that fall on one point: several in a corner.
struct Bounce<'b> {
    at: DVec3,
    /// Unit directions from the point back to where the wave comes from and on to where it goes.
    legs: [DVec3; 2],
    /// Far ends of these legs.
    ends: [DVec3; 2],
    /// The faces bounced off.
    mirrors: &'b [PathEvent<'b>],
    /// Faces that the legs' far ends lie on: a leg comes from their plane and does not cross it.
    beyond: [Option<u32>; 4],
}

impl Bounce<'_> {
    /// The faces bounced off.
    fn faces(&self) -> impl Iterator<Item = u32> + '_ {
        self.mirrors.iter().filter_map(|turn| match turn {
            PathEvent::Mirror(face) => Some(*face),
            PathEvent::Edge { .. } => None,
        })
    }

    /// The point of a face's plane between the legs, hard by the bounce, and where a path beside this one comes through the plane there; `None`
    /// where both legs lie on one side of it.
    fn between(&self, geometry: &Geometry<'_>, face: &Face) -> Option<[DVec3; 2]> {
        let heights = self.ends.map(|end| face.distance(end));
        if heights[0] * heights[1] >= 0.0 || heights.iter().any(|h| h.abs() <= END_CLEARANCE_M) {
            return None;
        }
        let [back, on] = self.legs;
        let across = [back, on].map(|leg| leg.dot(face.normal).abs());
        // Its heights above the plane cancel.
        let middle = (back * across[1] + on * across[0]).try_normalize()?;
        let rise = self.faces().map(|mirror| geometry.faces[mirror as usize].normal.dot(middle).abs()).fold(1.0, f64::min);
        let here = self.at + middle * (TOUCHING_M / rise.max(TOUCHING_M / MOST_BESIDE_M));
        let onwards = on - back;
        let onto_plane = |p: DVec3| p - onwards * (face.distance(p) / onwards.dot(face.normal));
        Some([onto_plane(here), onto_plane(here + BESIDE_RAY_M)])
    }

    /// Whether a path beside this one bounces as well; of several bounces at one point that is known.
    fn goes_on_beside(&self, geometry: &Geometry<'_>) -> bool {
        let [PathEvent::Mirror(face)] = self.mirrors else { return true };
        let mirror = &geometry.faces[*face as usize];
        mirror.contains(self.at + BESIDE_RAY_M - mirror.normal * mirror.normal.dot(BESIDE_RAY_M))
    }
}

impl Propagator<'_, '_> {
    /// Adds the faces that a route passes where it bounces to those it crosses on the way there; `None` once there are more than `budget`.
    pub(in crate::radio) fn pass_joints(
        &self,
        route: &RayPath<'_>,
        crossed: &mut [Vec<Crossing>; MAX_INTERACTIONS + 1],
        mut budget: usize,
    ) -> Option<()> {
        let mut first = 0;
        while first < route.turns.len() {
            let at = route.corners[first];
            let same = route.corners[first..].iter().take_while(|corner| corner.distance(at) <= TOUCHING_M).count();
            let next = first + same;
            let mirrors = &route.turns[first..next];
            // What stands on an edge that diffracts is looked for beside it.
            if mirrors.iter().all(|turn| matches!(turn, PathEvent::Mirror(_))) {
                let (from, _, before) = route.leg(first);
                let (_, to, after) = route.leg(next);
                let ends = [from, to];
                let legs = ends.map(|end| (end - at).normalize_or_zero());
                let beyond = [before[0], before[1], after[2], after[3]];
                let bounce = Bounce { at, legs, ends, mirrors, beyond };
                let passed = self.geometry.passed(&bounce, &crossed[first..=next])?;
                budget = budget.checked_sub(passed.len())?;
                let distance_m = from.distance(at);
                crossed[first].extend(passed.into_iter().map(|face| Crossing { distance_m, face }));
            }
            first = next;
        }
        Some(())
    }
}

impl Geometry<'_> {
    /// The faces that touch a bounce and have its legs on either side, one of every sheet; `crossed` are those that the legs cross anyway.
    /// `None` where the bounce is off the very end of its mirror and what it touches leaves no room for one beside it.
    fn passed(&self, bounce: &Bounce<'_>, crossed: &[Vec<Crossing>]) -> Option<Vec<u32>> {
        let (mut passed, mut touched): (Vec<u32>, bool) = (Vec::new(), false);
        let level = |face: &Face, other: u32| face.shares_plane(&self.faces[other as usize]);
        self.visit_triangles_near(bounce.at, TOUCHING_M, |triangle| {
            let number = self.face_of_triangle(triangle as u32);
            let face = &self.faces[number as usize];
            if face.distance(bounce.at).abs() > TOUCHING_M || passed.contains(&number) {
                return;
            }
            let Some([here, beside]) = bounce.between(self, face) else { return };
            let of_the_path = bounce.faces().chain(bounce.beyond.into_iter().flatten());
            let crossed_anyway = crossed.iter().flatten().map(|crossing| crossing.face);
            let stands_here = [here, beside].map(|point| face.contains(point));
            if stands_here == [false; 2] || of_the_path.chain(crossed_anyway).any(|other| level(face, other)) {
                return;
            }
            touched = true;
            if !stands_here[1] {
                return;
            }
            match passed.iter_mut().find(|known| self.is_one_sheet(**known, number, beside)) {
                Some(known) => *known = (*known).min(number),
                None => passed.push(number),
            }
        });
        passed.sort_unstable();
        (!touched || bounce.goes_on_beside(self)).then_some(passed)
    }
}
