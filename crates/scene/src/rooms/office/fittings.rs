//! Fittings of the office's shell: lights, vents, signs, boards, radiators, switches, the cable trays.

use super::furniture::{cable_tray, whiteboard};
use super::plan::{HEIGHT, NORTH, Partitions, SOUTH, WEST};
use crate::builder::fittings::{
    air_vent, clock, exit_sign, light_panel, notice_board, painting, radiator, screen, smoke_detector, switch_plate,
};
use crate::builder::materials::Mat;
use crate::builder::mesh_builder::BuiltObject;
use crate::builder::partition::Side;
use crate::builder::shapes::{printed_box, v};

/// Lower corners in plan of the rooms' 1.2 × 0.6 m ceiling panels, on the ceiling's 0.6 m grid.
const PANELS: [[f64; 2]; 21] = [
    [1.2, 1.2],
    [4.2, 1.2],
    [6.6, 1.2],
    [9.0, 1.2],
    [1.2, 3.6],
    [4.2, 3.6],
    [6.6, 3.6],
    [9.0, 3.6],
    [4.2, 8.4],
    [6.0, 8.4],
    [4.2, 10.2],
    [6.0, 10.2],
    [1.2, 9.0],
    [1.2, 10.8],
    [9.0, 9.0],
    [10.8, 9.6],
    [14.4, 6.0],
    [15.6, 8.4],
    [14.4, 10.2],
    [14.4, 1.2],
    [16.2, 1.2],
];

/// Lower corners in plan of the corridor's 0.6 × 0.6 m panels.
const CORRIDOR_PANELS: [[f64; 2]; 8] =
    [[1.2, 6.0], [3.6, 6.0], [6.0, 6.0], [8.4, 6.0], [10.8, 6.0], [11.4, 4.2], [11.4, 2.4], [11.4, 0.6]];

/// Lights, vents, and all that hangs on walls.
pub fn place(all: &mut Vec<BuiltObject>, walls: &Partitions) {
    ceiling(all);
    signs(all, walls);
    boards(all, walls);
    for (i, (x, length)) in [(0.9, 1.6), (3.1, 1.6), (6.1, 1.6), (8.2, 1.6), (14.5, 2.0)].into_iter().enumerate() {
        all.push(SOUTH.hang(radiator(&format!("Radiator south {}", i + 1), length), SOUTH.length - x - length, 0.0));
    }
    for (i, (x, length)) in [(4.6, 2.0), (9.6, 2.0), (14.5, 2.0)].into_iter().enumerate() {
        all.push(NORTH.hang(radiator(&format!("Radiator north {}", i + 1), length), x, 0.0));
    }
    let mut switches = BuiltObject::new("Switches and sockets");
    for (wall, side, along, up) in [
        (&walls.office, Side::Front, 2.3, 1.1),
        (&walls.office, Side::Back, 0.8, 1.1),
        (&walls.office, Side::Back, 9.9, 0.3),
        (&walls.north, Side::Front, 3.3, 1.1),
        (&walls.north, Side::Front, 9.1, 1.1),
        (&walls.north, Side::Front, 8.5, 0.3),
        (&walls.east, Side::Back, 3.6, 1.1),
        (&walls.leg, Side::Front, 2.6, 0.3),
        (&walls.leg, Side::Back, 2.5, 1.1),
        (&walls.kitchen, Side::Back, 15.4, 0.3),
    ] {
        switches.add(Mat::WhitePlastic, switch_plate().placed(&wall.frame(side, along, up)));
    }
    all.push(switches);
}

fn ceiling(all: &mut Vec<BuiltObject>) {
    let rooms = PANELS.map(|at| (at, [1.2, 0.6]));
    let corridor = CORRIDOR_PANELS.map(|at| (at, [0.6, 0.6]));
    for (i, ([x, y], size)) in rooms.into_iter().chain(corridor).enumerate() {
        all.push(light_panel(&format!("Light panel {}", i + 1), x, y, size, HEIGHT));
    }
    for (i, [x, y]) in
        [[3.0, 2.4], [8.4, 2.4], [2.4, 6.0], [7.2, 6.0], [11.4, 1.8], [5.4, 9.6], [15.0, 7.2]].into_iter().enumerate()
    {
        all.push(air_vent(&format!("Air vent {}", i + 1), x, y, HEIGHT));
    }
    let mut detectors = BuiltObject::new("Smoke detectors");
    for [x, y] in [[2.7, 3.3], [8.7, 3.3], [5.1, 6.3], [9.9, 6.3], [11.7, 3.3], [5.7, 9.3], [16.5, 7.5]] {
        detectors.add(Mat::WhitePlastic, smoke_detector(x, y, HEIGHT));
    }
    all.push(detectors);
    all.push(cable_tray(9.6).copy("Cable tray of the open office", 0.0, 0.6, 3.0, HEIGHT));
    all.push(cable_tray(3.9).copy("Cable tray of the print nook", 90.0, 2.7, 7.8, HEIGHT));
}

fn signs(all: &mut Vec<BuiltObject>, walls: &Partitions) {
    for (name, face, wall, side, along) in [
        ("Door sign of the print nook", Mat::SignPrint, &walls.north, Side::Front, 3.0),
        ("Door sign of the meeting room", Mat::SignMeeting, &walls.north, Side::Front, 8.02),
        ("Door sign of the closed office", Mat::SignOffice, &walls.north, Side::Front, 9.1),
        ("Door sign of the kitchen", Mat::SignKitchen, &walls.east, Side::Back, 5.05),
    ] {
        let plate = printed_box(v(-0.09, -0.09, 0.0), v(0.09, 0.09, 0.008));
        all.push(wall.hang(BuiltObject::new(name).with(face, plate), side, along, 1.6));
    }
    // Over the glazed door at the southern leg's end, and at the corridor's western end.
    all.push(SOUTH.hang(exit_sign("Exit sign south"), SOUTH.length - 12.0, 2.5));
    all.push(WEST.hang(exit_sign("Exit sign west"), 6.5, 2.3));
    all.push(walls.kitchen.hang(clock(), Side::Back, 16.5, 2.2));
}

fn boards(all: &mut Vec<BuiltObject>, walls: &Partitions) {
    all.push(walls.office.hang(whiteboard("Whiteboard of the open office", 1.5), Side::Front, 9.3, 0.95));
    all.push(walls.nook.hang(whiteboard("Whiteboard of the meeting room", 1.9), Side::Front, 8.6, 0.9));
    all.push(walls.leg.hang(notice_board("Notice board of the open office", 1.2, 0.8), Side::Back, 4.6, 1.2));
    all.push(WEST.hang(notice_board("Notice board of the print nook", 1.6, 0.8), 8.6, 1.25));
    all.push(walls.meeting.hang(screen("Screen of the meeting room", Mat::ScreenWelcome, 1.6, 0.9, 0.06), Side::Back, 9.75, 1.5));
    all.push(walls.kitchen.hang(painting(), Side::Front, 14.6, 1.2));
    all.push(WEST.hang(screen("Screen of the corridor", Mat::ScreenSchedule, 0.96, 0.54, 0.05), 6.5, 1.55));
}
