//! The shell: floors, the suspended ceiling, outer walls with their windows, partitions, and the street outside.

use super::doors::glazing;
use super::plan::{EAST, HEIGHT, NORTH, NORTH_WINDOWS, Partitions, SIZE, SOUTH, SOUTH_WINDOWS, WEST};
use crate::builder::materials::Mat;
use crate::builder::mesh_builder::{BuiltObject, LocalFrame};
use crate::builder::partition::Partition;
use crate::builder::shapes::{cuboid, picture, sheet_with_holes, v};
use crate::builder::wall::Wall;
use glam::DVec3;

/// Floors: name, covering, and `[x0, y0, x1, y1]`. They meet under the partitions' middles and in the openings.
const FLOORS: [(&str, Mat, [f64; 4]); 8] = [
    ("Floor of the open office", Mat::CarpetTiles, [0.0, 0.0, 11.0, 5.5]),
    ("Floor of the corridor", Mat::Vinyl, [0.0, 5.5, 11.0, 7.5]),
    ("Floor of the corridor's southern leg", Mat::Vinyl, [11.0, 0.0, 13.0, 7.5]),
    ("Floor of the print nook", Mat::Vinyl, [0.0, 7.5, 3.2, 12.0]),
    ("Floor of the meeting room", Mat::CarpetTilesWarm, [3.2, 7.5, 8.2, 12.0]),
    ("Floor of the closed office", Mat::CarpetTiles, [8.2, 7.5, 13.0, 12.0]),
    ("Floor of the kitchen", Mat::FloorBoards, [13.0, 4.0, 18.0, 12.0]),
    ("Floor of the glazed office", Mat::CarpetTilesWarm, [13.0, 0.0, 18.0, 4.0]),
];

/// The part of a rectangle in plan that lies within another, in that one's own coordinates.
fn within(part: [f64; 4], [x0, y0, x1, y1]: [f64; 4]) -> Option<[f64; 4]> {
    let [a, b, c, d] = [part[0].max(x0), part[1].max(y0), part[2].min(x1), part[3].min(y1)];
    (a < c && b < d).then_some([a - x0, b - y0, c - x0, d - y0])
}

/// Openings of an outer wall where partitions abut it, so that it leaves out the area inside them.
fn slots(wall: &Wall, heads: &[[f64; 4]]) -> Vec<[f64; 4]> {
    let right = DVec3::Z.cross(wall.inward);
    let of = |[x0, y0, x1, y1]: [f64; 4]| {
        let corners = [v(x0, y0, 0.0), v(x1, y1, 0.0)].map(|p| p - wall.origin);
        let [a, b] = corners.map(|p| p.dot(right));
        let depth = corners.map(|p| p.dot(wall.inward)).into_iter().fold(f64::INFINITY, f64::min);
        (depth < 1e-9).then_some([a.min(b), 0.0, a.max(b), HEIGHT])
    };
    heads.iter().copied().filter_map(of).collect()
}

/// The shell's objects. Floors, ceiling and outer walls leave out where partitions stand: a sheet that went on inside of a closed body would
/// be dark there, and so, to a light cache, a hand's breadth beside it.
pub fn objects(walls: &Partitions) -> Vec<BuiltObject> {
    // An outer wall is one sheet: its windows stand about it, not in a partition's depth.
    let about_the_sheet = LocalFrame::at(0.0, 0.0, 0.04);
    let mut all = Vec::new();
    let footings: Vec<[f64; 4]> = walls.all().into_iter().flat_map(Partition::footings).collect();
    for (name, covering, room) in FLOORS {
        let holes: Vec<[f64; 4]> = footings.iter().filter_map(|f| within(*f, room)).collect();
        let floor = sheet_with_holes(room[2] - room[0], room[3] - room[1], &holes).shifted(room[0], room[1], 0.0);
        all.push(BuiltObject::new(name).with(covering, floor));
    }
    let heads: Vec<[f64; 4]> = walls.all().into_iter().map(Partition::head).collect();
    // Turned over about its northern edge, from where the boards' grid starts.
    let holes: Vec<[f64; 4]> = heads.iter().map(|[x0, y0, x1, y1]| [*x0, SIZE[1] - y1, *x1, SIZE[1] - y0]).collect();
    let ceiling = sheet_with_holes(SIZE[0], SIZE[1], &holes).placed(&LocalFrame::tilt(180.0)).shifted(0.0, SIZE[1], HEIGHT);
    all.push(BuiltObject::new("Suspended ceiling").with(Mat::Ceiling, ceiling));
    let south = SOUTH_WINDOWS.map(|[x0, z0, x1, z1]| [SIZE[0] - x1, z0, SIZE[0] - x0, z1]);
    for (name, wall, windows) in [
        ("South wall", SOUTH, south.as_slice()),
        ("North wall", NORTH, &NORTH_WINDOWS),
        ("West wall", WEST, &[]),
        ("East wall", EAST, &[]),
    ] {
        let holes = [windows, &slots(&wall, &heads)].concat();
        all.push(wall.with_holes(name, Mat::PaintedConcrete, &holes));
    }
    for (side, wall, windows) in [("south", SOUTH, south.as_slice()), ("north", NORTH, &NORTH_WINDOWS)] {
        for (i, [x0, z0, x1, z1]) in windows.iter().copied().enumerate() {
            let (w, h) = (x1 - x0, z1 - z0);
            let mut window = glazing(w, h, (w / 1.15).round() as u32, Mat::WhiteMetal, Mat::Glass).placed(&about_the_sheet);
            window.name = format!("Window {side} {}", i + 1);
            if z0 > 0.0 {
                window.add(Mat::Laminate, cuboid(v(-0.05, -0.03, 0.0), v(w + 0.05, 0.0, 0.18)));
            }
            all.push(wall.hang(window, x0, z0));
        }
    }
    let (mut studs, mut skirting) = (BuiltObject::new("Steel studs in the partitions"), BuiltObject::new("Skirting"));
    for wall in walls.all() {
        all.push(wall.boards());
        wall.studs(&mut studs);
        wall.skirting(&mut skirting, SIZE);
    }
    all.extend([studs, skirting]);
    street(&mut all);
    all
}

/// The street pictures a few metres beyond the glass: the daylight.
fn street(all: &mut Vec<BuiltObject>) {
    let (across, up) = (26.0, v(0.0, 0.0, 9.0));
    for (name, corner, along) in [
        ("Outdoor street south", v(22.0, -4.0, -1.6), DVec3::NEG_X),
        ("Outdoor street north", v(-4.0, SIZE[1] + 4.0, -1.6), DVec3::X),
    ] {
        all.push(BuiltObject::new(name).with(Mat::Street, picture(corner, along * across, up)));
    }
}
