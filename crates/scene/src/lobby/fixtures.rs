//! What is fixed to the shell: lights, vents, screens, signs, cladding, radiators.

use super::architecture::{HEIGHT, LIFT_HEIGHT, LIFTS, NORTH_DOOR, Wall};
use super::materials::Mat;
use super::mesh_builder::{Frame, Mesh, Object};
use super::shapes::{block, cuboid, frame_bars, picture, printed_box, rounded_box, v};
use super::shapes_round::{cylinder, disc, lathe, rod, sphere, tube};
use super::textures::text_layout;
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

/// Where the round downlights sit, plan.
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

/// A horizontal regular polygon facing down: the fewest triangles that look round enough to be a lamp.
fn lamp_face(x: f64, y: f64, z: f64, radius: f64, corners: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let at = |k: usize| super::trig::on_circle(-(k as f64) / corners as f64);
    for k in 1..corners - 1 {
        let ids = [0, k, k + 1].map(|i| {
            let (cx, sy) = at(i);
            mesh.vertex(v(x + radius * cx, y + radius * sy, z), v(0.0, 0.0, -1.0), DVec2::new(cx, sy))
        });
        mesh.triangle(ids[0], ids[1], ids[2]);
    }
    mesh
}

/// Lights, ceiling fittings, wall fittings.
pub fn objects() -> Vec<Object> {
    let mut all = Vec::new();
    lights(&mut all);
    ceiling_fittings(&mut all);
    all.extend(cladding());
    screens_and_signs(&mut all);
    radiators(&mut all);
    all
}

fn lights(all: &mut Vec<Object>) {
    for (i, [x, y]) in PANELS.into_iter().enumerate() {
        let (w, h, z) = (1.2, 0.6, HEIGHT - 0.03);
        let mut o = Object::new(format!("Light panel {}", i + 1));
        o.add(Mat::WhiteMetal, cuboid(v(x, y, z + 0.004), v(x + w, y + h, HEIGHT - 0.002)));
        o.add(Mat::WhiteMetal, frame_bars(w - 0.05, h - 0.05, 0.025, 0.0, 0.03).shifted(x + 0.025, y + 0.025, z - 0.01));
        o.add(Mat::LightPanel, picture(v(x + 0.025, y + h - 0.025, z), v(w - 0.05, 0.0, 0.0), v(0.0, 0.05 - h, 0.0)));
        all.push(o);
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
        let o = Object::new(format!("Downlight {}", i + 1)).with(Mat::WhiteMetal, lathe(&ring, 16).shifted(x, y, 0.0));
        all.push(o.with(Mat::Downlight, lamp_face(x, y, HEIGHT - 0.006, 0.075, 8)));
    }
    for (i, [x, y]) in LINEAR.into_iter().enumerate() {
        let (l, w, z, h) = (1.2, 0.055, LINEAR_HEIGHT, 0.07);
        let mut o = Object::new(format!("Suspended light {}", i + 1));
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
        let mut o = Object::new(format!("Pendant lamp {}", i + 1));
        o.add(Mat::DarkMetal, lathe(&shade, 28).shifted(x, y, z));
        // The inside is the same profile run the other way: its normals point to the axis.
        o.add(Mat::Brass, lathe(&inner, 28).shifted(x, y, z));
        o.add(Mat::PendantGlow, lamp_face(x, y, z + 0.045, 0.105, 10));
        o.add(Mat::BlackPlastic, rod(v(x, y, z + 0.2), v(x, y, HEIGHT - 0.025), 0.004, 8));
        o.add(Mat::DarkMetal, cylinder(0.05, HEIGHT - 0.025, HEIGHT - 0.001, 20).shifted(x, y, 0.0));
        all.push(o);
    }
}

fn ceiling_fittings(all: &mut Vec<Object>) {
    for (i, [x, y]) in [[3.0, 4.2], [9.0, 4.2], [12.6, 7.2], [3.6, 12.6]].into_iter().enumerate() {
        let mut o = Object::new(format!("Air vent {}", i + 1));
        o.add(Mat::WhiteMetal, frame_bars(0.54, 0.54, 0.03, HEIGHT - 0.016, HEIGHT - 0.001).shifted(x + 0.03, y + 0.03, 0.0));
        for k in 0..9 {
            let slat = cuboid(v(-0.27, -0.022, -0.002), v(0.27, 0.022, 0.002)).placed(&Frame::tilt(32.0));
            o.add(Mat::WhiteMetal, slat.shifted(x + 0.3, y + 0.06 + 0.06 * f64::from(k), HEIGHT - 0.017));
        }
        all.push(o);
    }
    let mut detectors = Object::new("Smoke detectors");
    for [x, y] in [[6.3, 4.5], [12.3, 5.1], [3.3, 11.1]] {
        let body =
            [[0.0, HEIGHT - 0.05], [0.03, HEIGHT - 0.048], [0.05, HEIGHT - 0.03], [0.055, HEIGHT - 0.001], [0.0, HEIGHT - 0.001]];
        detectors.add(Mat::WhitePlastic, lathe(&body, 24).shifted(x, y, 0.0));
    }
    all.push(detectors);
    let mut camera = Object::new("Ceiling camera");
    camera.add(Mat::WhitePlastic, cylinder(0.07, HEIGHT - 0.05, HEIGHT - 0.001, 24).shifted(7.2, 8.4, 0.0));
    camera.add(Mat::BlackPlastic, sphere(v(7.2, 8.4, HEIGHT - 0.055), 0.055, 24));
    all.push(camera);
}

/// Oak slats on felt by the west lining; walnut panels on the east wall with the brass name.
fn cladding() -> Vec<Object> {
    let mut slats = Object::new("Oak slat wall");
    let (x0, x1) = (5.4, 8.9);
    slats.add(Mat::Felt, cuboid(v(x0, 0.1, 0.0), v(x1, 3.4, 0.012)));
    let count = 54;
    for i in 0..count {
        let x = x0 + (x1 - x0) * (f64::from(i) + 0.15) / f64::from(count);
        let slat = cuboid(v(x, 0.1, 0.012), v(x + 0.042, 3.4, 0.045)).grain_turned();
        slats.add(Mat::Oak, slat.grain_shifted(0.37 * f64::from(i), 0.29 * f64::from(i % 11)));
    }
    let mut panels = Object::new("Walnut panel wall");
    panels.add(Mat::Felt, cuboid(v(0.05, 0.05, 0.0), v(6.55, 3.42, 0.01)));
    for i in 0..6 {
        for (k, (low, high)) in [(0.06, 1.13), (1.14, 2.26), (2.27, 3.41)].into_iter().enumerate() {
            let x = 0.06 + 1.08 * f64::from(i);
            let panel = rounded_box(v(x, low, 0.01), v(x + 1.07, high, 0.03), 0.003, 1, 1);
            panels.add(Mat::Walnut, panel.grain_turned().grain_shifted(0.31 * f64::from(i), 0.17 * k as f64));
        }
    }
    vec![Wall::WEST.hang(slats, 0.0, 0.0), Wall::EAST.hang(panels, 0.0, 0.0), Wall::EAST.hang(letters("HALL 60"), 2.0, 2.05)]
}

/// Raised letters: every stroke of the stroke alphabet as a flat brass bar with rounded joints.
fn letters(text: &str) -> Object {
    let mut o = Object::new("Brass name");
    let (strokes, _) = text_layout(text);
    let (cap, pen, z0, z1) = (0.42, 0.032, 0.045, 0.065);
    for stroke in strokes {
        let points: Vec<DVec2> = stroke.iter().map(|p| DVec2::new(f64::from(p[0]), f64::from(p[1])) * cap).collect();
        for pair in points.windows(2) {
            let d = pair[1] - pair[0];
            let bar = cuboid(v(0.0, -pen, z0), v(d.length(), pen, z1));
            o.add(Mat::Brass, bar.placed(&Frame::along(d, pair[0])));
        }
        for p in points {
            o.add(Mat::Brass, cylinder(pen, z0, z1 + 0.0004, 14).shifted(p.x, p.y, 0.0));
        }
    }
    for x in [0.1, 1.2, 2.3] {
        o.add(Mat::Brass, rod(v(x, 0.2, 0.0305), v(x, 0.2, 0.045), 0.01, 10));
    }
    o
}

/// A screen: black housing, lit front.
fn screen(name: &str, face: Mat, width: f64, height: f64, depth: f64) -> Object {
    let (w, h) = (0.5 * width, 0.5 * height);
    Object::new(name)
        .with(Mat::BlackPlastic, rounded_box(v(-w - 0.014, -h - 0.014, 0.0), v(w + 0.014, h + 0.014, depth), 0.006, 2, 1))
        .with(face, picture(v(-w, -h, depth + 0.001), v(width, 0.0, 0.0), v(0.0, height, 0.0)))
}

fn screens_and_signs(all: &mut Vec<Object>) {
    all.push(Wall::WEST.hang(screen("Screen welcome", Mat::ScreenWelcome, 1.6, 0.9, 0.07), 7.15, 1.75));
    all.push(Wall::INNER.hang(screen("Screen schedule", Mat::ScreenSchedule, 1.28, 0.72, 0.05), 3.0, 1.85));
    for (i, (x, w)) in [(0.35, 1.6), (4.05, 1.6)].into_iter().enumerate() {
        let h = 0.8;
        let mut o = Object::new(format!("Notice board {}", i + 1));
        o.add(Mat::Cork, printed_box(v(0.0, 0.0, 0.004), v(w, h, 0.016)));
        o.add(Mat::Oak, frame_bars(w, h, 0.03, 0.0, 0.024));
        all.push(Wall::INNER.hang(o, x, 1.25));
    }
    let mut painting = Object::new("Painting");
    painting.add(Mat::Painting, printed_box(v(0.0, 0.0, 0.006), v(1.35, 0.9, 0.03)));
    painting.add(Mat::Walnut, frame_bars(1.35, 0.9, 0.02, 0.0, 0.04));
    all.push(Wall::NICHE.hang(painting, 3.05, 1.25));
    let mut clock = Object::new("Clock");
    // The lathe's axis is the wall's normal: local z.
    clock.add(
        Mat::DarkMetal,
        lathe(&[[0.0, 0.0], [0.2, 0.0], [0.205, 0.01], [0.205, 0.045], [0.19, 0.045], [0.19, 0.03], [0.0, 0.03]], 48),
    );
    let mut face = lamp_face(0.0, 0.0, 0.032, 0.188, 40).placed(&Frame::tilt(180.0)).shifted(0.0, 0.0, 0.064);
    for (p, uv) in face.positions.iter().zip(&mut face.uvs_m) {
        *uv = DVec2::new(0.5 + 0.5 * p.x / 0.19, 0.5 - 0.5 * p.y / 0.19);
    }
    clock.add(Mat::ClockFace, face);
    all.push(Wall::NORTH.hang(clock, 5.1, 2.55));
    let mut exit = Object::new("Exit sign");
    exit.add(Mat::WhitePlastic, rounded_box(v(-0.21, -0.105, 0.0), v(0.21, 0.105, 0.05), 0.01, 2, 1));
    exit.add(Mat::Exit, picture(v(-0.2, -0.1, 0.051), v(0.4, 0.0, 0.0), v(0.0, 0.2, 0.0)));
    all.push(Wall::NORTH.hang(exit, 0.5 * (NORTH_DOOR[0] + NORTH_DOOR[1]), NORTH_DOOR[2] + 0.3));
    for (i, lift) in LIFTS.into_iter().enumerate() {
        let mut o = Object::new(format!("Lift indicator {}", i + 1));
        o.add(Mat::BlackPlastic, cuboid(v(-0.16, -0.08, 0.0), v(0.16, 0.08, 0.02)));
        o.add(Mat::LiftSign, picture(v(-0.15, -0.075, 0.0205), v(0.3, 0.0, 0.0), v(0.0, 0.15, 0.0)));
        all.push(Wall::WEST.hang(o, 0.5 * (lift[0] + lift[1]), LIFT_HEIGHT + 0.25));
    }
    let mut call = Object::new("Lift call panel");
    call.add(Mat::Brushed, rounded_box(v(-0.06, -0.16, 0.0), v(0.06, 0.16, 0.012), 0.004, 2, 1));
    for y in [-0.06, 0.06] {
        call.add(Mat::Chrome, disc(0.026, 0.012, 0.02, 24).shifted(0.0, y, 0.0));
    }
    all.push(Wall::WEST.hang(call, 11.5, 1.1));
    let mut switches = Object::new("Switches and sockets");
    for (wall, x, y) in [
        (Wall::NORTH, 5.4, 1.1),
        (Wall::EAST, 7.2, 1.15),
        (Wall::NICHE, 0.3, 0.3),
        (Wall::NICHE, 4.7, 0.3),
        (Wall::INNER, 2.1, 0.3),
        (Wall::WEST, 5.15, 0.3),
    ] {
        let plate = cuboid(v(-0.042, -0.042, 0.0), v(0.042, 0.042, 0.009));
        switches.add(Mat::WhitePlastic, plate.placed(&wall.frame(x, y)));
        switches.add(Mat::WhitePlastic, cuboid(v(-0.028, -0.028, 0.009), v(0.028, 0.028, 0.013)).placed(&wall.frame(x, y)));
    }
    all.push(switches);
}

/// Flat panel radiators under the window's ends and in the north arm.
fn radiators(all: &mut Vec<Object>) {
    let places = [(Wall::INNER, 2.1, 1.8), (Wall::NORTH, 0.35, 1.0)];
    for (i, (wall, x, length)) in places.into_iter().enumerate() {
        let mut o = Object::new(format!("Radiator {}", i + 1));
        o.add(Mat::WhiteMetal, rounded_box(v(0.0, 0.15, 0.03), v(length, 0.7, 0.09), 0.008, 2, 1));
        let ribs = (length / 0.06) as usize;
        for k in 0..ribs {
            let rx = 0.03 + (length - 0.06) * (k as f64 + 0.5) / ribs as f64;
            o.add(Mat::WhiteMetal, cuboid(v(rx - 0.02, 0.18, 0.09), v(rx + 0.02, 0.67, 0.1)));
        }
        o.add(
            Mat::Chrome,
            tube(&[v(length + 0.03, 0.0, 0.06), v(length + 0.03, 0.2, 0.06), v(length - 0.01, 0.2, 0.06)], 0.011, 10),
        );
        o.add(Mat::WhitePlastic, rod(v(length + 0.03, 0.2, 0.06), v(length + 0.03, 0.2, 0.12), 0.022, 16));
        all.push(wall.hang(o, x, 0.0));
    }
    let mut convector = Object::new("Floor convector");
    let (x0, x1) = (0.7, 8.3);
    convector.add(Mat::Brushed, block(0.5 * (x0 + x1), 0.3, 0.0, [x1 - x0, 0.2, 0.006]));
    for k in 0..110 {
        let x = x0 + 0.04 + (x1 - x0 - 0.08) * f64::from(k) / 109.0;
        convector.add(Mat::DarkMetal, cuboid(v(x - 0.006, 0.215, 0.006), v(x + 0.006, 0.385, 0.011)));
    }
    all.push(convector);
}
