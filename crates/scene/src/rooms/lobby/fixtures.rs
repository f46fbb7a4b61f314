//! Fixtures of the lobby's shell: lights, vents, screens, signs, cladding, radiators.

use super::architecture::{EAST, HEIGHT, INNER, LIFT_HEIGHT, LIFTS, NICHE, NORTH, NORTH_DOOR, WEST};
use crate::builder::fittings::{
    air_vent, clock, exit_sign, lamp_face, light_panel, notice_board, painting, radiator, screen, smoke_detector, switch_plate,
};
use crate::builder::materials::Mat;
use crate::builder::mesh_builder::{BuiltObject, LocalFrame};
use crate::builder::shapes::{block, cuboid, picture, rounded_box, v};
use crate::builder::shapes_round::{cylinder, disc, lathe, rod, sphere};
use crate::draw::text_layout;
use glam::DVec2;

/// Lower corners in plan of the 1.2 × 0.6 m ceiling panels, on the ceiling's 0.6 m grid.
const PANELS: [[f64; 2]; 14] = [
    [1.2, 2.4],
    [4.2, 2.4],
    [7.2, 2.4],
    [10.8, 2.4],
    [1.2, 6.0],
    [4.2, 6.0],
    [7.2, 6.0],
    [10.8, 6.0],
    [1.2, 9.6],
    [5.4, 9.6],
    [1.2, 11.4],
    [5.4, 11.4],
    [1.2, 13.2],
    [5.4, 13.2],
];

/// Positions of the round downlights in plan, metres.
const DOWNLIGHTS: [[f64; 2]; 10] = [
    [0.9, 0.9],
    [0.9, 4.5],
    [0.9, 8.1],
    [9.3, 8.3],
    [11.1, 8.3],
    [12.9, 8.3],
    [13.5, 4.5],
    [13.2, 0.9],
    [7.7, 12.3],
    [4.5, 14.3],
];

/// Pendants: plan position, and the height of the shade's rim.
const PENDANTS: [[f64; 3]; 5] = [[11.25, 4.1, 2.3], [11.25, 5.3, 2.3], [11.25, 6.5, 2.3], [3.7, 11.3, 2.15], [4.7, 11.3, 2.15]];

/// Suspended linear lights along x, 2.4 m long: centre in plan. They light the ceiling and the floor.
const LINEAR: [[f64; 2]; 6] = [[3.6, 4.4], [9.2, 3.6], [12.2, 4.9], [9.9, 6.9], [4.2, 12.5], [3.6, 8.6]];

/// Height of their lower face, metres.
const LINEAR_HEIGHT: f64 = 2.86;

/// Lights, ceiling fittings, wall fittings.
pub fn objects() -> Vec<BuiltObject> {
    let mut all = Vec::new();
    lights(&mut all);
    ceiling_fittings(&mut all);
    all.extend(cladding());
    screens_and_signs(&mut all);
    radiators(&mut all);
    all
}

fn lights(all: &mut Vec<BuiltObject>) {
    for (i, [x, y]) in PANELS.into_iter().enumerate() {
        all.push(light_panel(&format!("Light panel {}", i + 1), x, y, [1.2, 0.6], HEIGHT));
    }
    for (i, [x, y]) in DOWNLIGHTS.into_iter().enumerate() {
        let ring = [
            [0.075, HEIGHT - 0.012],
            [0.095, HEIGHT - 0.012],
            [0.1, HEIGHT - 0.004],
            [0.1, HEIGHT - 0.001],
            [0.075, HEIGHT - 0.001],
            [0.075, HEIGHT - 0.012],
        ];
        let o = BuiltObject::new(format!("Downlight {}", i + 1)).with(Mat::WhiteMetal, lathe(&ring, 16).shifted(x, y, 0.0));
        all.push(o.with(Mat::Downlight, lamp_face(x, y, HEIGHT - 0.006, 0.075, 8)));
    }
    for (i, [x, y]) in LINEAR.into_iter().enumerate() {
        let (l, w, z, h) = (1.2, 0.055, LINEAR_HEIGHT, 0.07);
        let mut o = BuiltObject::new(format!("Suspended light {}", i + 1));
        o.add(Mat::DarkMetal, cuboid(v(x - l, y - w, z), v(x + l, y + w, z + h)));
        o.add(
            Mat::UpLight,
            picture(v(x - l + 0.01, y - w + 0.01, z + h + 0.001), v(2.0 * l - 0.02, 0.0, 0.0), v(0.0, 2.0 * w - 0.02, 0.0)),
        );
        o.add(
            Mat::UpLight,
            picture(v(x - l + 0.01, y + w - 0.01, z - 0.001), v(2.0 * l - 0.02, 0.0, 0.0), v(0.0, 0.02 - 2.0 * w, 0.0)),
        );
        for end in [-1.05, 1.05] {
            o.add(Mat::Chrome, rod(v(x + end, y, z + h + 0.002), v(x + end, y, HEIGHT - 0.001), 0.003, 6));
        }
        all.push(o);
    }
    for (i, [x, y, z]) in PENDANTS.into_iter().enumerate() {
        let shade = [[0.15, 0.0], [0.154, 0.002], [0.142, 0.06], [0.1, 0.13], [0.04, 0.175], [0.02, 0.2], [0.0, 0.2]];
        let inner = [[0.0, 0.17], [0.038, 0.168], [0.096, 0.125], [0.138, 0.058], [0.15, 0.0]];
        let mut o = BuiltObject::new(format!("Pendant lamp {}", i + 1));
        o.add(Mat::DarkMetal, lathe(&shade, 28).shifted(x, y, z));
        // The inside is the same profile run the other way: its normals point to the axis.
        o.add(Mat::Brass, lathe(&inner, 28).shifted(x, y, z));
        o.add(Mat::PendantGlow, lamp_face(x, y, z + 0.045, 0.105, 10));
        o.add(Mat::BlackPlastic, rod(v(x, y, z + 0.2), v(x, y, HEIGHT - 0.025), 0.004, 8));
        o.add(Mat::DarkMetal, cylinder(0.05, HEIGHT - 0.025, HEIGHT - 0.001, 20).shifted(x, y, 0.0));
        all.push(o);
    }
}

fn ceiling_fittings(all: &mut Vec<BuiltObject>) {
    for (i, [x, y]) in [[3.0, 4.2], [9.0, 4.2], [12.6, 7.2], [3.6, 12.6]].into_iter().enumerate() {
        all.push(air_vent(&format!("Air vent {}", i + 1), x, y, HEIGHT));
    }
    let mut detectors = BuiltObject::new("Smoke detectors");
    for [x, y] in [[6.3, 4.5], [12.3, 5.1], [3.3, 11.1]] {
        detectors.add(Mat::WhitePlastic, smoke_detector(x, y, HEIGHT));
    }
    all.push(detectors);
    let mut camera = BuiltObject::new("Ceiling camera");
    camera.add(Mat::WhitePlastic, cylinder(0.07, HEIGHT - 0.05, HEIGHT - 0.001, 24).shifted(7.2, 8.4, 0.0));
    camera.add(Mat::BlackPlastic, sphere(v(7.2, 8.4, HEIGHT - 0.055), 0.055, 24));
    all.push(camera);
}

/// Oak slats on felt by the west lining; walnut panels on the east wall with the brass name.
fn cladding() -> Vec<BuiltObject> {
    let mut slats = BuiltObject::new("Oak slat wall");
    let (x0, x1) = (5.4, 8.9);
    slats.add(Mat::Felt, cuboid(v(x0, 0.1, 0.0), v(x1, 3.4, 0.012)));
    let count = 54;
    for i in 0..count {
        let x = x0 + (x1 - x0) * (f64::from(i) + 0.15) / f64::from(count);
        let slat = cuboid(v(x, 0.1, 0.012), v(x + 0.042, 3.4, 0.045)).grain_turned();
        slats.add(Mat::Oak, slat.grain_shifted(0.37 * f64::from(i), 0.29 * f64::from(i % 11)));
    }
    let mut panels = BuiltObject::new("Walnut panel wall");
    panels.add(Mat::Felt, cuboid(v(0.05, 0.05, 0.0), v(6.55, 3.42, 0.01)));
    for i in 0..6 {
        for (k, (low, high)) in [(0.06, 1.13), (1.14, 2.26), (2.27, 3.41)].into_iter().enumerate() {
            let x = 0.06 + 1.08 * f64::from(i);
            let panel = rounded_box(v(x, low, 0.01), v(x + 1.07, high, 0.03), 0.003, 1, 1);
            panels.add(Mat::Walnut, panel.grain_turned().grain_shifted(0.31 * f64::from(i), 0.17 * k as f64));
        }
    }
    vec![WEST.hang(slats, 0.0, 0.0), EAST.hang(panels, 0.0, 0.0), EAST.hang(letters("HALL 60"), 2.0, 2.05)]
}

/// Raised letters: every stroke of the stroke alphabet as a flat brass bar with rounded joints.
fn letters(text: &str) -> BuiltObject {
    let mut o = BuiltObject::new("Brass name");
    let (strokes, _) = text_layout(text);
    let (cap, pen, z0, z1) = (0.42, 0.032, 0.045, 0.065);
    // Bars and joints run into one another: each is a hair thicker than the one before, so that no two end in one plane.
    let mut pieces = 0;
    let mut thickness = || {
        pieces += 1;
        (z0 - 4e-5 * f64::from(pieces), z1 + 4e-5 * f64::from(pieces))
    };
    let mut joints: Vec<DVec2> = Vec::new();
    for stroke in strokes {
        let points: Vec<DVec2> = stroke.iter().map(|p| DVec2::new(f64::from(p[0]), f64::from(p[1])) * cap).collect();
        for pair in points.windows(2) {
            let (d, (low, high)) = (pair[1] - pair[0], thickness());
            let bar = cuboid(v(0.0, -pen, low), v(d.length(), pen, high));
            o.add(Mat::Brass, bar.placed(&LocalFrame::along(d, pair[0])));
        }
        for p in points {
            // Strokes that end where others do share the joint.
            if joints.iter().any(|joint| joint.distance(p) < 1e-9) {
                continue;
            }
            joints.push(p);
            let (low, high) = thickness();
            o.add(Mat::Brass, cylinder(pen, low, high, 14).shifted(p.x, p.y, 0.0));
        }
    }
    for x in [0.1, 1.2, 2.3] {
        o.add(Mat::Brass, rod(v(x, 0.2, 0.0305), v(x, 0.2, 0.045), 0.01, 10));
    }
    o
}

fn screens_and_signs(all: &mut Vec<BuiltObject>) {
    all.push(WEST.hang(screen("Screen welcome", Mat::ScreenWelcome, 1.6, 0.9, 0.07), 7.15, 1.75));
    all.push(INNER.hang(screen("Screen schedule", Mat::ScreenSchedule, 1.28, 0.72, 0.05), 3.0, 1.85));
    for (i, (x, w)) in [(0.35, 1.6), (4.05, 1.6)].into_iter().enumerate() {
        all.push(INNER.hang(notice_board(&format!("Notice board {}", i + 1), w, 0.8), x, 1.25));
    }
    all.push(NICHE.hang(painting(), 3.05, 1.25));
    all.push(NORTH.hang(clock(), 5.1, 2.55));
    all.push(NORTH.hang(exit_sign("Exit sign"), 0.5 * (NORTH_DOOR[0] + NORTH_DOOR[1]), NORTH_DOOR[2] + 0.3));
    for (i, lift) in LIFTS.into_iter().enumerate() {
        let mut o = BuiltObject::new(format!("Lift indicator {}", i + 1));
        o.add(Mat::BlackPlastic, cuboid(v(-0.16, -0.08, 0.0), v(0.16, 0.08, 0.02)));
        o.add(Mat::LiftSign, picture(v(-0.15, -0.075, 0.0205), v(0.3, 0.0, 0.0), v(0.0, 0.15, 0.0)));
        all.push(WEST.hang(o, 0.5 * (lift[0] + lift[1]), LIFT_HEIGHT + 0.25));
    }
    let mut call = BuiltObject::new("Lift call panel");
    call.add(Mat::Brushed, rounded_box(v(-0.06, -0.16, 0.0), v(0.06, 0.16, 0.012), 0.004, 2, 1));
    for y in [-0.06, 0.06] {
        call.add(Mat::Chrome, disc(0.026, 0.012, 0.02, 24).shifted(0.0, y, 0.0));
    }
    all.push(WEST.hang(call, 11.5, 1.1));
    let mut switches = BuiltObject::new("Switches and sockets");
    for (wall, x, y) in
        [(NORTH, 5.4, 1.1), (EAST, 7.2, 1.15), (NICHE, 0.3, 0.3), (NICHE, 4.7, 0.3), (INNER, 2.1, 0.3), (WEST, 5.15, 0.3)]
    {
        switches.add(Mat::WhitePlastic, switch_plate().placed(&wall.frame(x, y)));
    }
    all.push(switches);
}

/// Flat panel radiators under the window's ends and in the north arm.
fn radiators(all: &mut Vec<BuiltObject>) {
    let places = [(INNER, 2.1, 1.8), (NORTH, 0.35, 1.0)];
    for (i, (wall, x, length)) in places.into_iter().enumerate() {
        all.push(wall.hang(radiator(&format!("Radiator {}", i + 1), length), x, 0.0));
    }
    let mut convector = BuiltObject::new("Floor convector");
    let (x0, x1) = (0.7, 8.3);
    convector.add(Mat::Brushed, block(0.5 * (x0 + x1), 0.3, 0.0, [x1 - x0, 0.2, 0.006]));
    for k in 0..110 {
        let x = x0 + 0.04 + (x1 - x0 - 0.08) * f64::from(k) / 109.0;
        convector.add(Mat::DarkMetal, cuboid(v(x - 0.006, 0.215, 0.006), v(x + 0.006, 0.385, 0.011)));
    }
    all.push(convector);
}
