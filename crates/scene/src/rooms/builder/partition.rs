//! Stud walls inside a building: two boards on steel studs, with openings and prints.

use super::materials::Mat;
use super::mesh_builder::{BuiltObject, LocalFrame, Mesh};
use super::shapes::{cuboid, v};
use super::wall::{SKIRTING_DEPTH, Wall};
use glam::{DVec2, DVec3};

/// Thickness of a partition, metres.
pub const THICKNESS: f64 = 0.1;
/// Distance between studs, metres.
const STUD_SPACING: f64 = 0.6;

/// A face of a partition: the front looks towards −y or +x, the back the other way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Towards −y or +x.
    Front,
    /// Towards +y or −x.
    Back,
}

/// A print that is part of a board: it keeps the board's slab, so that only light sees it.
struct Print {
    side: Side,
    material: Mat,
    area: [f64; 4],
}

/// A wall between rooms, parallel to an axis of the plan. All that is "along" it is a world coordinate: x where it runs along x, else y.
pub struct Partition {
    name: &'static str,
    front: Wall,
    start: f64,
    faces: [Mat; 2],
    openings: Vec<[f64; 4]>,
    prints: Vec<Print>,
}

impl Partition {
    /// A wall whose middle stands at `y`.
    pub fn along_x(name: &'static str, y: f64, [x0, x1]: [f64; 2], height: f64) -> Self {
        let origin = v(x0, y - 0.5 * THICKNESS, 0.0);
        Self::new(name, Wall { origin, inward: DVec3::NEG_Y, length: x1 - x0, height }, x0)
    }

    /// A wall whose middle stands at `x`.
    pub fn along_y(name: &'static str, x: f64, [y0, y1]: [f64; 2], height: f64) -> Self {
        let origin = v(x + 0.5 * THICKNESS, y0, 0.0);
        Self::new(name, Wall { origin, inward: DVec3::X, length: y1 - y0, height }, y0)
    }

    fn new(name: &'static str, front: Wall, start: f64) -> Self {
        Self { name, front, start, faces: [Mat::Plaster; 2], openings: Vec::new(), prints: Vec::new() }
    }

    /// The paint of the front and of the back.
    pub fn painted(self, front: Mat, back: Mat) -> Self {
        Self { faces: [front, back], ..self }
    }

    /// An opening: from, sill, to, head.
    pub fn opening(mut self, area: [f64; 4]) -> Self {
        self.openings.push(area);
        self
    }

    /// A print of `size` whose lower corner with the smaller coordinate lies at `along`, `up`.
    pub fn print(mut self, side: Side, material: Mat, along: f64, up: f64, size: [f64; 2]) -> Self {
        self.prints.push(Print { side, material, area: [along, up, along + size[0], up + size[1]] });
        self
    }

    /// The frame of one face with its origin `along` the wall and `up` from the floor; local x to the right seen from that side.
    pub fn frame(&self, side: Side, along: f64, up: f64) -> LocalFrame {
        match side {
            Side::Front => self.front.frame(along - self.start, up),
            Side::Back => self.back().frame(self.start + self.front.length - along, up),
        }
    }

    /// An object made in wall coordinates, on one face.
    pub fn hang(&self, object: BuiltObject, side: Side, along: f64, up: f64) -> BuiltObject {
        object.placed(&self.frame(side, along, up))
    }

    fn back(&self) -> Wall {
        let right = self.front.frame(self.front.length, 0.0).translation;
        Wall { origin: right - self.front.inward * THICKNESS, inward: -self.front.inward, ..self.front }
    }

    /// The boards: one closed body, cut along the edges of openings and prints.
    pub fn boards(&self) -> BuiltObject {
        let (left, right) = (self.start, self.start + self.front.length);
        let areas: Vec<[f64; 4]> = self.openings.iter().copied().chain(self.prints.iter().map(|p| p.area)).collect();
        let lines = |low: f64, high: f64, a: usize| -> Vec<f64> {
            let mut all: Vec<f64> = [low, high].into_iter().chain(areas.iter().flat_map(|h| [h[a], h[a + 2]])).collect();
            all.sort_by(f64::total_cmp);
            all.dedup_by(|x, y| (*x - *y).abs() < 1e-9);
            all
        };
        let (xs, ys) = (lines(left, right, 0), lines(0.0, self.front.height, 1));
        let holds = |a: &[f64; 4], x: f64, y: f64| a[0] < x && x < a[2] && a[1] < y && y < a[3];
        let middle = |i: usize, j: usize| (0.5 * (xs[i] + xs[i + 1]), 0.5 * (ys[j] + ys[j + 1]));
        // Cells beyond the wall's edges wrap to huge indices and are open.
        let solid = |i: usize, j: usize| {
            i < xs.len() - 1 && j < ys.len() - 1 && {
                let (x, y) = middle(i, j);
                !self.openings.iter().any(|a| holds(a, x, y))
            }
        };
        let mut object = BuiltObject::new(self.name);
        for i in 0..xs.len() - 1 {
            for j in 0..ys.len() - 1 {
                if !solid(i, j) {
                    continue;
                }
                let (x, y) = middle(i, j);
                let (low, w, h) = (v(xs[i], ys[j], 0.0), v(xs[i + 1] - xs[i], 0.0, 0.0), v(0.0, ys[j + 1] - ys[j], 0.0));
                let depth = v(0.0, 0.0, THICKNESS);
                for (side, origin, along) in [(Side::Front, low, w), (Side::Back, low + w - depth, -w)] {
                    let print = self.prints.iter().find(|p| p.side == side && holds(&p.area, x, y));
                    let mut face = Mesh::default();
                    face.quad(origin, along, h, DVec2::new(origin.x, -origin.y));
                    if let Some(Print { area: [x0, y0, x1, y1], .. }) = print {
                        for (p, uv) in face.positions.iter().zip(&mut face.uvs_m) {
                            let u = (p.x - x0) / (x1 - x0);
                            *uv = DVec2::new(if side == Side::Front { u } else { 1.0 - u }, (y1 - p.y) / (y1 - y0));
                        }
                    }
                    object.add(print.map_or(self.faces[side as usize], |p| p.material), face);
                }
                let mut rim = Mesh::default();
                for (open, origin, along_u, along_v) in [
                    (!solid(i.wrapping_sub(1), j), low - depth, depth, h),
                    (!solid(i + 1, j), low + w, -depth, h),
                    (!solid(i, j.wrapping_sub(1)), low - depth, w, depth),
                    (!solid(i, j + 1), low + h, w, -depth),
                ] {
                    if open {
                        rim.quad(origin, along_u, along_v, DVec2::ZERO);
                    }
                }
                object.add(self.faces[0], rim);
            }
        }
        self.front.hang(object, -self.start, 0.0)
    }

    /// The steel studs between the boards, which light never sees; none where there is an opening.
    pub fn studs(&self, object: &mut BuiltObject) {
        let (half, from, to) = (0.025, 0.02 - THICKNESS, -0.02);
        for k in 0..(self.front.length / STUD_SPACING) as u32 {
            let x = 0.1 + STUD_SPACING * f64::from(k);
            let at = self.start + x;
            if !self.openings.iter().any(|a| a[0] - 0.06 < at && at < a[2] + 0.06) {
                let stud = cuboid(v(x - half, 0.002, from), v(x + half, self.front.height - 0.002, to));
                object.add(Mat::Stud, stud.placed(&self.front.frame(0.0, 0.0)));
            }
        }
    }

    /// Footprints of the wall on the floor, in plan: `[x0, y0, x1, y1]` for each stretch between the openings that reach the floor.
    pub fn footings(&self) -> Vec<[f64; 4]> {
        self.stretches().into_iter().map(|[from, to]| self.plan(from, to)).collect()
    }

    /// Footprint of the wall at the ceiling, in plan: `[x0, y0, x1, y1]`.
    pub fn head(&self) -> [f64; 4] {
        self.plan(self.start, self.start + self.front.length)
    }

    fn plan(&self, from: f64, to: f64) -> [f64; 4] {
        let frame = self.front.frame(-self.start, 0.0);
        let (a, b) = (frame.point(v(from, 0.0, 0.0)), frame.point(v(to, 0.0, -THICKNESS)));
        let (low, high) = (a.min(b), a.max(b));
        [low.x, low.y, high.x, high.y]
    }

    /// The stretches along the wall between the openings that reach the floor.
    fn stretches(&self) -> Vec<[f64; 2]> {
        let mut doors: Vec<[f64; 2]> = self.openings.iter().filter(|a| a[1] < 0.1).map(|a| [a[0], a[2]]).collect();
        doors.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let ends = doors.iter().map(|d| d[0]).chain([self.start + self.front.length]);
        let starts = [self.start].into_iter().chain(doors.iter().map(|d| d[1]));
        starts.zip(ends).map(|(from, to)| [from, to]).collect()
    }

    /// Skirting boards on both faces between the openings that reach the floor, in a building of this size in plan: an end within it meets
    /// another partition, and stops at the face of that one's board.
    pub fn skirting(&self, object: &mut BuiltObject, size: [f64; 2]) {
        let (left, right) = (self.start, self.start + self.front.length);
        let across = size[usize::from(self.front.inward.x != 0.0)];
        let stop = |at: f64, towards: f64| {
            let meets = (at == left || at == right) && at > 0.0 && at < across;
            if meets { at + towards * SKIRTING_DEPTH } else { at }
        };
        for [from, to] in self.stretches() {
            let (from, to) = (stop(from, 1.0), stop(to, -1.0));
            self.front.skirting(object, &[[from - left, to - left]]);
            self.back().skirting(object, &[[right - to, right - from]]);
        }
    }
}
