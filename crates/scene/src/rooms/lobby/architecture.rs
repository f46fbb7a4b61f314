//! The shell: floors, walls with their openings, glazing, ceiling, pillars, steps.

use crate::builder::fittings::door;
use crate::builder::materials::Mat;
use crate::builder::mesh_builder::{BuiltObject, LocalFrame};
use crate::builder::shapes::{cuboid, frame_bars, picture, sheet, v};
use crate::builder::shapes_round::{cylinder, lathe, rod, tube};
use crate::builder::wall::{SKIRTING_DEPTH, Wall};
use glam::DVec3;

/// Clear height, metres.
pub const HEIGHT: f64 = 3.5;
/// Depth of the stud space behind the west lining, metres.
const LINING: f64 = 0.08;

const fn wall(x: f64, y: f64, inward: DVec3, length: f64) -> Wall {
    Wall { origin: DVec3::new(x, y, 0.0), inward, length, height: HEIGHT }
}

/// x = 0 (the lining's face), local x = world y.
pub const WEST: Wall = wall(LINING, 0.0, DVec3::X, 15.0);
/// y = 0, local x = 14 − world x.
pub const SOUTH: Wall = wall(14.0, 0.0, DVec3::Y, 14.0);
/// x = 14, local x = 9 − world y.
pub const EAST: Wall = wall(14.0, 9.0, DVec3::NEG_X, 9.0);
/// y = 9 from x = 8.5 to 14, local x = world x − 8.5.
pub const NICHE: Wall = wall(8.5, 9.0, DVec3::NEG_Y, 5.5);
/// x = 8.5 from y = 9 to 15, local x = 15 − world y.
pub const INNER: Wall = wall(8.5, 15.0, DVec3::NEG_X, 6.0);
/// y = 15 from x = 0 to 8.5, local x = world x.
pub const NORTH: Wall = wall(0.0, 15.0, DVec3::NEG_Y, 8.5);

/// Lift doors on the west wall, `[from, to]` along it.
pub const LIFTS: [[f64; 2]; 2] = [[10.0, 11.1], [11.9, 13.0]];
/// Clear height of the lift doors.
pub const LIFT_HEIGHT: f64 = 2.2;
/// The entrance along the south wall, and its height.
pub const ENTRANCE: [f64; 3] = [2.5, 4.7, 2.6];
/// The window band along the south wall: from, to, sill, head.
pub const WINDOW: [f64; 4] = [5.5, 13.5, 0.25, 3.05];
/// The door on the north wall: from, to, head.
pub const NORTH_DOOR: [f64; 3] = [5.7, 6.7, 2.15];
/// The door from the landing on the east wall: from, to, sill, head.
pub const EAST_DOOR: [f64; 4] = [7.55, 8.5, 0.45, 2.5];

/// A print that is part of a wall: the sheet is cut out of the plaster and keeps its radio slab, so that only light sees it.
pub struct Print {
    wall: Wall,
    name: &'static str,
    material: Mat,
    /// Left, bottom, right, top on the wall.
    area: [f64; 4],
    frame: Option<Mat>,
}

/// Width and height of a poster, metres.
const POSTER: [f64; 2] = [0.84, 1.2];

/// Every print in the room.
fn prints() -> Vec<Print> {
    let poster = |wall, name, material, x: f64, y: f64, frame| Print {
        wall,
        name,
        material,
        area: [x, y, x + POSTER[0], y + POSTER[1]],
        frame,
    };
    vec![
        poster(WEST, "Poster expo", Mat::PosterExpo, 0.95, 0.95, Some(Mat::DarkMetal)),
        poster(WEST, "Poster waves", Mat::PosterWaves, 2.35, 0.95, None),
        poster(WEST, "Poster hills", Mat::PosterHills, 3.75, 0.95, Some(Mat::Oak)),
        poster(NICHE, "Poster chart", Mat::PosterChart, 0.75, 1.0, Some(Mat::DarkMetal)),
        poster(NICHE, "Poster map", Mat::PosterMap, 1.9, 1.0, None),
        poster(NORTH, "Poster grid", Mat::PosterGrid, 7.25, 1.0, Some(Mat::WhiteWood)),
    ]
}

/// The shell's objects.
pub fn objects() -> Vec<BuiltObject> {
    let mut all = vec![
        BuiltObject::new("Floor of the hall").with(Mat::FloorTiles, sheet(v(0.0, 0.0, 0.0), v(14.0, 0.0, 0.0), v(0.0, 9.0, 0.0))),
        BuiltObject::new("Floor of the north arm")
            .with(Mat::FloorBoards, sheet(v(0.0, 9.0, 0.0), v(8.5, 0.0, 0.0), v(0.0, 6.0, 0.0)).grain_turned()),
        BuiltObject::new("Threshold strip").with(Mat::Brass, cuboid(v(LINING, 8.97, 0.0), v(8.5, 9.03, 0.004))),
        BuiltObject::new("Ceiling of the hall")
            .with(Mat::Ceiling, sheet(v(0.0, 9.0, HEIGHT), v(14.0, 0.0, 0.0), v(0.0, -9.0, 0.0))),
        BuiltObject::new("Ceiling of the north arm")
            .with(Mat::Ceiling, sheet(v(0.0, 15.0, HEIGHT), v(8.5, 0.0, 0.0), v(0.0, -6.0, 0.0))),
    ];
    walls(&mut all);
    all.push(glazing());
    all.push(entrance_frame());
    all.push(entrance_leaves());
    doors(&mut all);
    pillars(&mut all);
    all.push(steps());
    all.push(railing());
    all.push(street());
    all
}

fn walls(all: &mut Vec<BuiltObject>) {
    let prints = prints();
    let holes = |name: &str, extra: &[[f64; 4]]| -> Vec<[f64; 4]> {
        let own = prints.iter().filter(|p| name == wall_name(&p.wall)).map(|p| p.area);
        own.chain(extra.iter().copied()).collect()
    };
    let lifts = LIFTS.map(|l| [l[0], 0.0, l[1], LIFT_HEIGHT]);
    let north_door = [NORTH_DOOR[0], 0.0, NORTH_DOOR[1], NORTH_DOOR[2]];
    let openings = [[ENTRANCE[0], 0.0, ENTRANCE[1], ENTRANCE[2]], WINDOW_HOLE];
    all.push(WEST.with_holes("West lining", Mat::Plaster, &holes("west", &lifts)));
    all.push(SOUTH.with_holes("South wall", Mat::Concrete, &openings));
    all.push(EAST.with_holes("East wall", Mat::PlasterTeal, &[[EAST_DOOR[0], EAST_DOOR[2], EAST_DOOR[1], EAST_DOOR[3]]]));
    all.push(NICHE.with_holes("Niche wall", Mat::PlasterSand, &holes("niche", &[])));
    all.push(INNER.with_holes("Inner concrete wall", Mat::Concrete, &[]));
    all.push(NORTH.with_holes("North wall", Mat::PlasterTeal, &holes("north", &[north_door])));
    for p in prints {
        let [x0, y0, x1, y1] = p.area;
        let (w, h) = (x1 - x0, y1 - y0);
        let mut object = BuiltObject::new(p.name).with(p.material, picture(DVec3::ZERO, v(w, 0.0, 0.0), v(0.0, h, 0.0)));
        if let Some(bar) = p.frame {
            object.add(bar, frame_bars(w, h, 0.025, 0.0, 0.022));
        }
        all.push(p.wall.hang(object, x0, y0));
    }
    // Behind the west lining: concrete, and the steel studs that light never sees.
    let behind = sheet(v(0.0, 0.0, 0.0), v(0.0, 15.0, 0.0), v(0.0, 0.0, HEIGHT));
    all.push(BuiltObject::new("Concrete behind the west lining").with(Mat::ConcreteBacking, behind));
    let mut studs = BuiltObject::new("Steel studs behind the west lining");
    for i in 0..25 {
        let y = 0.3 + 0.6 * f64::from(i);
        if !LIFTS.iter().any(|l| l[0] - 0.05 < y && y < l[1] + 0.05) {
            studs.add(Mat::Stud, cuboid(v(0.015, y - 0.025, 0.0), v(0.065, y + 0.025, HEIGHT - 0.01)));
        }
    }
    all.push(studs);
    let mut skirting = BuiltObject::new("Skirting");
    WEST.skirting(&mut skirting, &[[0.0, LIFTS[0][0] - 0.1], [LIFTS[0][1] + 0.1, LIFTS[1][0] - 0.1], [LIFTS[1][1] + 0.1, 15.0]]);
    SOUTH.skirting(&mut skirting, &[[2.15, ENTRANCE[0] - 0.06], [ENTRANCE[1] + 0.06, 13.92 - SKIRTING_DEPTH]]);
    NICHE.skirting(&mut skirting, &[[0.0, 5.5]]);
    INNER.skirting(&mut skirting, &[[0.0, 6.0]]);
    NORTH.skirting(
        &mut skirting,
        &[[LINING + SKIRTING_DEPTH, NORTH_DOOR[0] - 0.08], [NORTH_DOOR[1] + 0.08, 8.5 - SKIRTING_DEPTH]],
    );
    all.push(skirting);
}

/// The window band as a hole: left, bottom, right, top.
const WINDOW_HOLE: [f64; 4] = [WINDOW[0], WINDOW[2], WINDOW[1], WINDOW[3]];

fn wall_name(wall: &Wall) -> &'static str {
    if wall.origin == WEST.origin {
        "west"
    } else if wall.origin == NICHE.origin {
        "niche"
    } else {
        "north"
    }
}

/// Window panes, mullions, transom, sill. Each pane is one sheet: for radio it is one slab of the glass's thickness.
fn glazing() -> BuiltObject {
    let mut o = BuiltObject::new("Window wall");
    let (w, h) = (WINDOW[1] - WINDOW[0], WINDOW[3] - WINDOW[2]);
    let (bays, bar) = (5, 0.06);
    o.add(Mat::DarkMetal, frame_bars(w, h, 0.07, -0.06, 0.05));
    let transom = 0.72 * h;
    for i in 0..bays {
        let (x0, x1) = (w * f64::from(i) / f64::from(bays), w * f64::from(i + 1) / f64::from(bays));
        let (left, right) = (x0 + if i > 0 { 0.5 * bar } else { 0.0 }, x1 - if i + 1 < bays { 0.5 * bar } else { 0.0 });
        if i > 0 {
            o.add(Mat::DarkMetal, cuboid(v(x0 - 0.5 * bar, 0.0, -0.06), v(x0 + 0.5 * bar, h, 0.05)));
        }
        o.add(Mat::DarkMetal, cuboid(v(left, transom - 0.025, -0.05), v(right, transom + 0.025, 0.04)));
        for (low, high) in [(0.0, transom - 0.025), (transom + 0.025, h)] {
            o.add(Mat::Glass, sheet(v(left, low, -0.01), v(right - left, 0.0, 0.0), v(0.0, high - low, 0.0)));
        }
    }
    o.add(Mat::MarbleWhite, cuboid(v(-0.07, -0.1, 0.0), v(w + 0.07, -0.07, 0.16)));
    SOUTH.hang(o, WINDOW[0], WINDOW[2])
}

fn entrance_frame() -> BuiltObject {
    let (w, h) = (ENTRANCE[1] - ENTRANCE[0], ENTRANCE[2]);
    let bar = 0.06;
    let mut o = BuiltObject::new("Entrance frame");
    o.add(Mat::DarkMetal, cuboid(v(-bar, 0.0, -0.05), v(0.0, h + bar, 0.05)));
    o.add(Mat::DarkMetal, cuboid(v(w, 0.0, -0.05), v(w + bar, h + bar, 0.05)));
    o.add(Mat::DarkMetal, cuboid(v(0.0, h, -0.05), v(w, h + bar, 0.05)));
    o.add(Mat::DarkMetal, cuboid(v(0.0, 2.14, -0.04), v(w, 2.2, 0.04)));
    o.add(Mat::DoorGlass, sheet(v(0.0, 2.2, 0.0), v(w, 0.0, 0.0), v(0.0, h - 2.2, 0.0)));
    SOUTH.hang(o, ENTRANCE[0], 0.0)
}

/// Two glass leaves with a metal rail at the foot, a head rail and pull handles.
fn entrance_leaves() -> BuiltObject {
    let half = 0.5 * (ENTRANCE[1] - ENTRANCE[0]);
    let mut o = BuiltObject::new("Glass double door");
    for side in [0.0, 1.0] {
        let (x0, x1) = (side * half + 0.006, (side + 1.0) * half - 0.006);
        o.add(Mat::Brushed, cuboid(v(x0, 0.01, -0.022), v(x1, 0.12, 0.022)));
        o.add(Mat::Brushed, cuboid(v(x0, 2.08, -0.022), v(x1, 2.135, 0.022)));
        o.add(Mat::DoorGlass, sheet(v(x0, 0.12, 0.0), v(x1 - x0, 0.0, 0.0), v(0.0, 1.96, 0.0)));
        let x = if side == 0.0 { x1 - 0.09 } else { x0 + 0.09 };
        let pull = [v(x, 0.85, 0.004), v(x, 0.85, 0.06), v(x, 0.87, 0.07), v(x, 1.53, 0.07), v(x, 1.55, 0.06), v(x, 1.55, 0.004)];
        o.add(Mat::Chrome, tube(&pull, 0.015, 12));
    }
    SOUTH.hang(o, ENTRANCE[0], 0.0)
}

fn doors(all: &mut Vec<BuiltObject>) {
    all.push(NORTH.hang(door("Door north", NORTH_DOOR[1] - NORTH_DOOR[0], NORTH_DOOR[2]), NORTH_DOOR[0], 0.0));
    let landing = door("Door east", EAST_DOOR[1] - EAST_DOOR[0], EAST_DOOR[3] - EAST_DOOR[2]);
    all.push(EAST.hang(landing, EAST_DOOR[0], EAST_DOOR[2]));
    for (i, lift) in LIFTS.into_iter().enumerate() {
        let (w, h) = (lift[1] - lift[0], LIFT_HEIGHT);
        let mut o = BuiltObject::new(format!("Lift door {}", i + 1));
        let half = 0.5 * w;
        o.add(Mat::Brushed, cuboid(v(0.0, 0.0, -0.06), v(half - 0.003, h, -0.03)).grain_turned());
        o.add(Mat::Brushed, cuboid(v(half + 0.003, 0.0, -0.06), v(w, h, -0.03)).grain_turned());
        for (x0, x1) in [(-0.1, 0.0), (w, w + 0.1)] {
            o.add(Mat::Brushed, cuboid(v(x0, 0.0, -0.06), v(x1, h + 0.1, 0.02)).grain_turned());
        }
        o.add(Mat::Brushed, cuboid(v(0.0, h, -0.06), v(w, h + 0.1, 0.02)));
        all.push(WEST.hang(o, lift[0], 0.0));
    }
}

/// Round pillars: two in fair-faced concrete, two clad in green marble, with a steel foot ring.
fn pillars(all: &mut Vec<BuiltObject>) {
    let places = [
        ("Concrete pillar west", Mat::Concrete, 3.15, 8.3),
        ("Concrete pillar east", Mat::Concrete, 8.55, 5.1),
        ("Marble pillar south", Mat::MarbleGreen, 3.45, 3.4),
        ("Marble pillar north", Mat::MarbleGreen, 8.0, 9.75),
    ];
    for (name, material, x, y) in places {
        let radius = 0.24;
        let shaft = lathe(&[[radius, 0.0], [radius, 1.2], [radius, 2.4], [radius, HEIGHT]], 40);
        let foot = lathe(
            &[[radius + 0.004, 0.0], [radius + 0.03, 0.0], [radius + 0.03, 0.1], [radius + 0.02, 0.12], [radius + 0.004, 0.12]],
            40,
        );
        let head = lathe(&[[radius + 0.004, HEIGHT - 0.06], [radius + 0.05, HEIGHT - 0.03], [radius + 0.05, HEIGHT - 0.001]], 40);
        let o = BuiltObject::new(name).with(material, shaft).with(Mat::Brushed, foot).with(Mat::WhiteMetal, head);
        all.push(o.placed(&LocalFrame::at(x, y, 0.0)));
    }
}

/// Two steps and a landing before the east door.
fn steps() -> BuiltObject {
    BuiltObject::new("Steps and landing")
        .with(Mat::ConcretePot, cuboid(v(11.9, 0.0, 0.0), v(12.2, 1.7, 0.15)))
        .with(Mat::ConcretePot, cuboid(v(12.2, 0.0, 0.0), v(12.5, 1.7, 0.3)))
        .with(Mat::ConcretePot, cuboid(v(12.5, 0.0, 0.0), v(14.0, 1.7, 0.45)))
        .with(Mat::Brass, cuboid(v(11.895, 0.02, 0.13), v(11.93, 1.68, 0.153)))
        .with(Mat::Brass, cuboid(v(12.195, 0.02, 0.28), v(12.23, 1.68, 0.303)))
}

/// Handrail with balusters along the landing and down the steps.
fn railing() -> BuiltObject {
    let mut o = BuiltObject::new("Railing");
    let y = 1.62;
    let floor = |x: f64| {
        if x < 12.2 {
            0.15
        } else if x < 12.5 {
            0.3
        } else {
            0.45
        }
    };
    let top = |x: f64| if x < 12.5 { 1.4 - 0.5 * (12.5 - x) } else { 1.4 };
    for i in 0..19 {
        let x = 11.97 + 0.11 * f64::from(i);
        o.add(Mat::DarkMetal, rod(v(x, y, floor(x)), v(x, y, top(x) - 0.01), 0.009, 6));
    }
    o.add(Mat::Oak, tube(&[v(11.85, y, top(11.85)), v(12.5, y, top(12.5)), v(13.98, y, 1.4)], 0.024, 16));
    // The newel takes the first baluster in, a little longer at both ends.
    o.add(Mat::DarkMetal, cylinder(0.022, 0.149, top(11.97) - 0.005, 16).shifted(11.97, y - 0.02, 0.0));
    o
}

/// The street picture, a few metres beyond the glass: the daylight.
fn street() -> BuiltObject {
    BuiltObject::new("Outdoor street").with(Mat::Street, picture(v(19.0, -3.5, -1.2), v(-24.0, 0.0, 0.0), v(0.0, 0.0, 8.0)))
}
