//! Doors and glass in the openings: metal linings, leaves of wood and of glass, framed panes. All are made in the coordinates of the
//! opening: origin at its lower left corner on the front face, z out of it, the wall's depth towards −z.

use super::plan::{
    CLOSED_DOOR, CLOSED_PANE, GLAZED_DOOR, GLAZED_PANE, KITCHEN, MEETING, NOOK, OFFICE_DOOR, OFFICE_OPENING, OFFICE_PANE,
    Partitions,
};
use crate::builder::materials::Mat;
use crate::builder::mesh_builder::{BuiltObject, LocalFrame, Mesh};
use crate::builder::partition::{Partition, Side, THICKNESS};
use crate::builder::shapes::{cuboid, frame_bars, sheet, v};
use crate::builder::shapes_round::{rod, tube};

/// Width of a lining's bars, metres.
const LINING: f64 = 0.045;
/// Width of a glazing's bars, metres.
const BAR: f64 = 0.05;
/// Middle of a partition's depth.
const MIDDLE: f64 = -0.5 * THICKNESS;
/// Width of the meeting room's door.
const MEETING_DOOR: f64 = 1.0;

/// Three bars that line an opening without a sill, a little proud of both faces.
fn lining(width: f64, height: f64) -> Mesh {
    let (z0, z1) = (-THICKNESS - 0.012, 0.012);
    let mut mesh = cuboid(v(0.0, 0.0, z0), v(LINING, height, z1));
    mesh.append(&cuboid(v(width - LINING, 0.0, z0), v(width, height, z1)));
    mesh.append(&cuboid(v(LINING, height - LINING, z0), v(width - LINING, height, z1)));
    mesh
}

/// Framed panes side by side that fill an opening: bars about the middle of the depth, a single sheet a pane.
pub fn glazing(width: f64, height: f64, bays: u32, bar: Mat, glass: Mat) -> BuiltObject {
    let (z0, z1) = (MIDDLE - 0.03, MIDDLE + 0.03);
    let (w, h) = (width - 2.0 * BAR, height - 2.0 * BAR);
    let mut o = BuiltObject::new("").with(bar, frame_bars(w, h, BAR, z0, z1).shifted(BAR, BAR, 0.0));
    let pane = (w - BAR * f64::from(bays - 1)) / f64::from(bays);
    for i in 0..bays {
        let x = BAR + (pane + BAR) * f64::from(i);
        if i > 0 {
            o.add(bar, cuboid(v(x - BAR, BAR, z0), v(x, height - BAR, z1)));
        }
        o.add(glass, sheet(v(x, BAR, MIDDLE), v(pane, 0.0, 0.0), v(0.0, h, 0.0)));
    }
    o
}

/// Two rows of frosted squares across a glazing, at the height of the eyes of those who would walk into it.
fn film(width: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let (size, pitch) = (0.06, 0.12);
    for row in [0.95, 1.5] {
        for i in 0..((width - 2.0 * BAR - 0.1) / pitch) as u32 {
            let x = BAR + 0.05 + pitch * f64::from(i);
            mesh.append(&sheet(v(x, row, MIDDLE + 0.002), v(size, 0.0, 0.0), v(0.0, size, 0.0)));
        }
    }
    mesh
}

/// Hinge and opening angle of the wooden or glass leaf of a door.
struct Swing {
    /// Clear width and height of the lining.
    size: [f64; 2],
    /// Whether the hinge is on the right.
    right: bool,
    /// Degrees; positive into the back, negative out of the front.
    open_deg: f64,
}

impl Swing {
    /// The frame of a leaf that is made from its hinge along x, about z = 0.
    fn frame(&self) -> LocalFrame {
        let (degrees, x) = if self.right { (180.0 - self.open_deg, LINING + self.size[0]) } else { (self.open_deg, LINING) };
        LocalFrame::swing(degrees, x, MIDDLE)
    }

    /// Width of the leaf with its gaps.
    fn width(&self) -> f64 {
        self.size[0] - 0.004
    }

    /// A leaf of wood with a lever and a kick plate on both faces.
    fn wooden(&self) -> BuiltObject {
        let (w, h, t) = (self.width(), self.size[1] - 0.004, 0.02);
        let mut o = BuiltObject::new("").with(Mat::DoorWood, cuboid(v(0.004, 0.008, -t), v(w, h, t)).grain_turned());
        for side in [-1.0, 1.0] {
            let (low, high) = if side > 0.0 { (t, t + 0.003) } else { (-t - 0.003, -t) };
            o.add(Mat::Brushed, cuboid(v(0.02, 0.03, low), v(w - 0.02, 0.23, high)));
            o.add(Mat::Chrome, cuboid(v(w - 0.09, 0.93, low), v(w - 0.05, 1.15, high)));
            let (x, y, z) = (w - 0.07, 1.06, side * (t + 0.003));
            let lever =
                [v(x, y, z), v(x, y, z + side * 0.045), v(x - 0.02, y, z + side * 0.052), v(x - 0.13, y, z + side * 0.052)];
            o.add(Mat::Chrome, tube(&lever, 0.01, 10));
        }
        o.placed(&self.frame())
    }

    /// A leaf of glass between a foot rail and a head rail, with an upright pull on both faces.
    fn glazed(&self) -> BuiltObject {
        let (w, h) = (self.width(), self.size[1] - 0.004);
        let mut o = BuiltObject::new("");
        o.add(Mat::Brushed, cuboid(v(0.004, 0.01, -0.02), v(w, 0.11, 0.02)));
        o.add(Mat::Brushed, cuboid(v(0.004, h - 0.06, -0.02), v(w, h, 0.02)));
        o.add(Mat::DoorGlass, sheet(v(0.004, 0.11, 0.0), v(w - 0.004, 0.0, 0.0), v(0.0, h - 0.17, 0.0)));
        for z in [-0.04, 0.04] {
            o.add(Mat::Chrome, rod(v(w - 0.08, 0.85, z), v(w - 0.08, 1.45, z), 0.012, 12));
            for y in [0.9, 1.4] {
                o.add(Mat::Chrome, rod(v(w - 0.08, y, 0.2 * z), v(w - 0.08, y, z), 0.008, 8));
            }
        }
        o.placed(&self.frame())
    }
}

fn size([x0, z0, x1, z1]: [f64; 4]) -> [f64; 2] {
    [x1 - x0, z1 - z0]
}

/// The clear size of a lined opening.
fn clear(opening: [f64; 4]) -> [f64; 2] {
    let [w, h] = size(opening);
    [w - 2.0 * LINING, h - LINING]
}

/// Everything that stands in the partitions' openings.
pub fn place(all: &mut Vec<BuiltObject>, walls: &Partitions) {
    let mut put = |name: &str, object: BuiltObject, wall: &Partition, along: f64| {
        all.push(BuiltObject { name: name.to_owned(), ..wall.hang(object, Side::Front, along, 0.0) });
    };
    for (name, wall, opening) in [
        ("Lining of the open office's door", &walls.office, OFFICE_DOOR),
        ("Lining of the open office's opening", &walls.leg, OFFICE_OPENING),
        ("Lining of the print nook", &walls.north, NOOK),
        ("Lining of the closed office's door", &walls.north, CLOSED_DOOR),
        ("Lining of the kitchen's opening", &walls.east, KITCHEN),
        ("Lining of the glazed office's door", &walls.east, GLAZED_DOOR),
    ] {
        let [w, h] = size(opening);
        put(name, BuiltObject::new("").with(Mat::GreyMetal, lining(w, h)), wall, opening[0]);
    }
    for (name, wall, opening, bays) in [
        ("Pane of the open office", &walls.office, OFFICE_PANE, 3),
        ("Pane of the closed office", &walls.north, CLOSED_PANE, 1),
        ("Pane of the glazed office", &walls.east, GLAZED_PANE, 2),
    ] {
        let [w, h] = size(opening);
        put(name, glazing(w, h, bays, Mat::DarkMetal, Mat::DoorGlass).with(Mat::Film, film(w)), wall, opening[0]);
    }
    let [w, h] = size(MEETING);
    let fixed = w - MEETING_DOOR;
    let front = glazing(fixed, h, 3, Mat::DarkMetal, Mat::DoorGlass).with(Mat::Film, film(fixed));
    put("Glass front of the meeting room", front, &walls.north, MEETING[0]);
    let door = [MEETING[0] + fixed, 0.0, MEETING[2], h];
    put(
        "Lining of the meeting room's door",
        BuiltObject::new("").with(Mat::DarkMetal, lining(MEETING_DOOR, h)),
        &walls.north,
        door[0],
    );
    let open = |opening, right, open_deg| Swing { size: clear(opening), right, open_deg };
    put("Door of the open office", open(OFFICE_DOOR, false, -98.0).wooden(), &walls.office, OFFICE_DOOR[0]);
    put("Door of the closed office", open(CLOSED_DOOR, false, 0.0).wooden(), &walls.north, CLOSED_DOOR[0]);
    put("Door of the glazed office", open(GLAZED_DOOR, true, -35.0).wooden(), &walls.east, GLAZED_DOOR[0]);
    put("Door of the meeting room", open(door, true, 82.0).glazed(), &walls.north, door[0]);
}
