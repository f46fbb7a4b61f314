//! Walls in plan, and frames to hang things on them.

use super::materials::Mat;
use super::mesh_builder::{BuiltObject, LocalFrame};
use super::shapes::{cuboid, sheet_with_holes, v};
use glam::DVec3;

/// Depth of a skirting board, metres: where two meet in a corner one ends at the face of the other.
pub const SKIRTING_DEPTH: f64 = 0.014;

/// A wall in plan: local x runs to the right as seen from the room, local y up, local z into the room.
#[derive(Clone, Copy, Debug)]
pub struct Wall {
    /// Its left end on the floor, as seen from the room.
    pub origin: DVec3,
    /// Unit vector into the room.
    pub inward: DVec3,
    /// Metres.
    pub length: f64,
    /// Metres.
    pub height: f64,
}

impl Wall {
    /// The frame with its origin `along` the wall and `up` from the floor.
    pub fn frame(&self, along: f64, up: f64) -> LocalFrame {
        let turned = LocalFrame::on_wall(self.inward, self.origin);
        LocalFrame { translation: turned.point(v(along, up, 0.0)), ..turned }
    }

    /// An object made in wall coordinates, at this place.
    pub fn hang(&self, object: BuiltObject, along: f64, up: f64) -> BuiltObject {
        object.placed(&self.frame(along, up))
    }

    /// The wall's sheet with openings, as an object.
    pub fn with_holes(&self, name: &str, material: Mat, holes: &[[f64; 4]]) -> BuiltObject {
        self.hang(BuiltObject::new(name).with(material, sheet_with_holes(self.length, self.height, holes)), 0.0, 0.0)
    }

    /// Skirting boards over the given stretches.
    pub fn skirting(&self, object: &mut BuiltObject, stretches: &[[f64; 2]]) {
        for s in stretches {
            object.add(Mat::WhiteWood, cuboid(v(s[0], 0.0, 0.0), v(s[1], 0.09, SKIRTING_DEPTH)).placed(&self.frame(0.0, 0.0)));
        }
    }
}
