//! The shell: floors, the suspended ceiling, outer walls with their windows, partitions, and the street outside.

use super::doors::glazing;
use super::plan::{EAST, HEIGHT, NORTH, NORTH_WINDOWS, Partitions, SIZE, SOUTH, SOUTH_WINDOWS, WEST};
use crate::builder::materials::Mat;
use crate::builder::mesh_builder::{Frame, Object};
use crate::builder::shapes::{cuboid, picture, sheet, v};
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

/// The shell's objects.
pub fn objects(walls: &Partitions) -> Vec<Object> {
    // An outer wall is one sheet: its windows stand about it, not in a partition's depth.
    let about_the_sheet = Frame::at(0.0, 0.0, 0.04);
    let mut all = Vec::new();
    for (name, covering, [x0, y0, x1, y1]) in FLOORS {
        let floor = sheet(v(x0, y0, 0.0), v(x1 - x0, 0.0, 0.0), v(0.0, y1 - y0, 0.0));
        all.push(Object::new(name).with(covering, floor));
    }
    // From the north-west corner, so that the boards' grid starts there.
    let ceiling = sheet(v(0.0, SIZE[1], HEIGHT), v(SIZE[0], 0.0, 0.0), v(0.0, -SIZE[1], 0.0));
    all.push(Object::new("Suspended ceiling").with(Mat::Ceiling, ceiling));
    let south = SOUTH_WINDOWS.map(|[x0, z0, x1, z1]| [SIZE[0] - x1, z0, SIZE[0] - x0, z1]);
    all.push(SOUTH.with_holes("South wall", Mat::PaintedConcrete, &south));
    all.push(NORTH.with_holes("North wall", Mat::PaintedConcrete, &NORTH_WINDOWS));
    all.push(WEST.with_holes("West wall", Mat::PaintedConcrete, &[]));
    all.push(EAST.with_holes("East wall", Mat::PaintedConcrete, &[]));
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
    let (mut studs, mut skirting) = (Object::new("Steel studs in the partitions"), Object::new("Skirting"));
    for wall in walls.all() {
        all.push(wall.boards());
        wall.studs(&mut studs);
        wall.skirting(&mut skirting);
    }
    all.extend([studs, skirting]);
    street(&mut all);
    all
}

/// The street pictures a few metres beyond the glass: the daylight.
fn street(all: &mut Vec<Object>) {
    let (across, up) = (26.0, v(0.0, 0.0, 9.0));
    for (name, corner, along) in [
        ("Outdoor street south", v(22.0, -4.0, -1.6), DVec3::NEG_X),
        ("Outdoor street north", v(-4.0, SIZE[1] + 4.0, -1.6), DVec3::X),
    ] {
        all.push(Object::new(name).with(Mat::Street, picture(corner, along * across, up)));
    }
}
