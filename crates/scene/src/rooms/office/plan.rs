//! The floor plan: outer walls, partitions, and the openings in both. Openings are given as from, sill, to, head, in world coordinates.

use crate::builder::materials::Mat;
use crate::builder::partition::{Partition, Side};
use crate::builder::wall::Wall;
use glam::DVec3;

/// Clear height, metres.
pub const HEIGHT: f64 = 2.8;
/// Size in plan, metres.
pub const SIZE: [f64; 2] = [18.0, 12.0];

const fn wall(x: f64, y: f64, inward: DVec3, length: f64) -> Wall {
    Wall { origin: DVec3::new(x, y, 0.0), inward, length, height: HEIGHT }
}

/// x = 0, local x = world y.
pub const WEST: Wall = wall(0.0, 0.0, DVec3::X, SIZE[1]);
/// y = 0, local x = 18 − world x.
pub const SOUTH: Wall = wall(SIZE[0], 0.0, DVec3::Y, SIZE[0]);
/// x = 18, local x = 12 − world y.
pub const EAST: Wall = wall(SIZE[0], SIZE[1], DVec3::NEG_X, SIZE[1]);
/// y = 12, local x = world x.
pub const NORTH: Wall = wall(0.0, SIZE[1], DVec3::NEG_Y, SIZE[0]);

/// Windows of the south wall: the open office's, the glazed door at the corridor's end, the glazed office's.
pub const SOUTH_WINDOWS: [[f64; 4]; 4] =
    [[0.6, 0.85, 5.1, 2.4], [5.7, 0.85, 10.2, 2.4], [11.3, 0.0, 12.7, 2.3], [13.8, 0.85, 17.2, 2.4]];
/// Windows of the north wall: the meeting room's, the closed office's, the kitchen's.
pub const NORTH_WINDOWS: [[f64; 4]; 3] = [[3.9, 0.85, 7.5, 2.4], [8.9, 0.85, 12.3, 2.4], [13.8, 0.85, 17.2, 2.4]];

/// The door of the open office.
pub const OFFICE_DOOR: [f64; 4] = [1.0, 0.0, 2.05, 2.1];
/// The pane between the open office and the corridor.
pub const OFFICE_PANE: [f64; 4] = [3.2, 0.0, 6.2, 2.4];
/// The opening between the open office and the corridor's southern leg.
pub const OFFICE_OPENING: [f64; 4] = [0.6, 0.0, 2.2, 2.3];
/// The print nook's opening.
pub const NOOK: [f64; 4] = [0.5, 0.0, 2.7, 2.3];
/// The meeting room's front of glass, its door included.
pub const MEETING: [f64; 4] = [3.6, 0.0, 7.8, 2.4];
/// The closed office's door, and the pane beside it.
pub const CLOSED_DOOR: [f64; 4] = [9.3, 0.0, 10.2, 2.1];
/// The narrow pane beside it.
pub const CLOSED_PANE: [f64; 4] = [10.4, 0.0, 10.9, 2.1];
/// The kitchen's opening.
pub const KITCHEN: [f64; 4] = [5.3, 0.0, 7.2, 2.3];
/// The south-east office's pane.
pub const GLAZED_PANE: [f64; 4] = [0.5, 0.0, 2.3, 2.3];
/// The south-east office's door.
pub const GLAZED_DOOR: [f64; 4] = [2.5, 0.0, 3.4, 2.1];

/// Every partition.
pub struct Partitions {
    /// Between the open office (front) and the corridor.
    pub office: Partition,
    /// Between the corridor's southern leg (front) and the open office.
    pub leg: Partition,
    /// Between the eastern rooms (front) and the corridor's southern leg.
    pub east: Partition,
    /// Between the corridor (front) and the northern rooms.
    pub north: Partition,
    /// Between the meeting room (front) and the print nook.
    pub nook: Partition,
    /// Between the closed office (front) and the meeting room.
    pub meeting: Partition,
    /// Between the south-east office (front) and the kitchen.
    pub kitchen: Partition,
}

/// Width and height of a poster, metres.
const POSTER: [f64; 2] = [0.7, 1.0];

impl Partitions {
    /// The office's partitions with their openings, paint and posters.
    pub fn new() -> Self {
        let white = Mat::Plaster;
        let along_x = |name, y, ends| Partition::along_x(name, y, ends, HEIGHT);
        let along_y = |name, x, ends| Partition::along_y(name, x, ends, HEIGHT);
        Self {
            office: along_x("Wall of the open office", 5.5, [0.0, 10.95])
                .opening(OFFICE_DOOR)
                .opening(OFFICE_PANE)
                .print(Side::Back, Mat::PosterChart, 7.6, 0.95, POSTER)
                .print(Side::Back, Mat::PosterGrid, 8.7, 0.95, POSTER),
            leg: along_y("Wall of the corridor's southern leg", 11.0, [0.0, 5.55])
                .painted(white, Mat::PlasterGreen)
                .opening(OFFICE_OPENING)
                .print(Side::Front, Mat::PosterWaves, 3.7, 0.95, POSTER),
            east: along_y("Wall of the eastern rooms", 13.0, [0.0, 12.0])
                .painted(Mat::PlasterSand, white)
                .opening(GLAZED_PANE)
                .opening(GLAZED_DOOR)
                .opening(KITCHEN)
                .print(Side::Back, Mat::PosterHills, 4.05, 0.95, POSTER),
            north: along_x("Wall of the northern rooms", 7.5, [0.0, 12.95])
                .opening(NOOK)
                .opening(MEETING)
                .opening(CLOSED_DOOR)
                .opening(CLOSED_PANE)
                .print(Side::Front, Mat::PosterMap, 11.6, 0.95, POSTER),
            nook: along_y("Wall of the print nook", 3.2, [7.55, 12.0]).painted(Mat::PlasterTeal, white),
            meeting: along_y("Wall of the meeting room", 8.2, [7.55, 12.0]),
            kitchen: along_x("Wall of the kitchen", 4.0, [13.05, 18.0]).print(Side::Back, Mat::PosterExpo, 14.2, 0.95, POSTER),
        }
    }

    /// All of them.
    pub fn all(&self) -> [&Partition; 7] {
        [&self.office, &self.leg, &self.east, &self.north, &self.nook, &self.meeting, &self.kitchen]
    }
}
