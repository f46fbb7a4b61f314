//! Seating and tables. Every piece stands on z = 0 with its front towards −y, centred on its footprint.

use super::materials::Mat;
use super::mesh_builder::{BuiltObject, LocalFrame};
use super::shapes::{block, cuboid, cushion, rounded_box, v};
use super::shapes_round::{cylinder, disc, lathe, rod, tube};
use super::trig;

/// A sofa or armchair of `seats` seats.
pub fn sofa(seats: usize, cover: Mat, pillow: Mat) -> BuiltObject {
    let (seat_w, depth, arm) = (0.66, 0.86, 0.17);
    let width = seat_w * seats as f64 + 2.0 * arm;
    let (hw, hd) = (0.5 * width, 0.5 * depth);
    let mut o = BuiltObject::new("");
    for x in [-hw + 0.12, hw - 0.12] {
        for y in [-hd + 0.1, hd - 0.1] {
            o.add(Mat::DarkMetal, lathe(&[[0.0, 0.0], [0.014, 0.0], [0.022, 0.13], [0.0, 0.13]], 12).shifted(x, y, 0.0));
        }
    }
    o.add(cover, rounded_box(v(-hw + 0.02, -hd + 0.03, 0.13), v(hw - 0.02, hd - 0.02, 0.28), 0.03, 1, 1));
    for side in [-1.0, 1.0] {
        let x = side * (hw - 0.5 * arm);
        o.add(cover, rounded_box(v(x - 0.5 * arm, -hd, 0.14), v(x + 0.5 * arm, hd - 0.04, 0.6), 0.06, 2, 1));
    }
    o.add(cover, rounded_box(v(-hw + 0.03, hd - 0.2, 0.142), v(hw - 0.03, hd, 0.8), 0.07, 2, 1));
    for i in 0..seats {
        let x = (i as f64 + 0.5) * seat_w - 0.5 * seat_w * seats as f64;
        let half = 0.5 * seat_w - 0.006;
        o.add(cover, cushion(v(x - half, -hd + 0.02, 0.275), v(x + half, hd - 0.2, 0.43), 0.05, 0.025));
        // A back cushion is a lying one, stood up and leant back.
        let back = cushion(v(-half, -0.21, -0.075), v(half, 0.21, 0.075), 0.05, 0.03).placed(&LocalFrame::tilt(76.0));
        o.add(cover, back.shifted(x, hd - 0.27, 0.63));
    }
    for (i, side) in [-1.0, 1.0].into_iter().enumerate().take(seats.min(2)) {
        let lean = cushion(v(-0.2, -0.2, -0.05), v(0.2, 0.2, 0.05), 0.045, 0.05).placed(&LocalFrame::tilt(68.0));
        o.add(
            pillow,
            lean.turned(
                side * 14.0,
                side * (0.5 * seat_w * seats as f64 - 0.26) * if seats == 1 { 0.0 } else { 1.0 },
                hd - 0.4,
                0.61 + 0.01 * i as f64,
            ),
        );
    }
    o
}

/// A low table: a slab of stone or wood on two crossed steel frames, with a book and a bowl.
pub fn coffee_table(length: f64, width: f64, top: Mat) -> BuiltObject {
    let mut o = BuiltObject::new("");
    let (hl, hw) = (0.5 * length, 0.5 * width);
    o.add(top, rounded_box(v(-hl, -hw, 0.38), v(hl, hw, 0.41), 0.008, 1, 1));
    for x in [-hl + 0.12, hl - 0.12] {
        let (y, r) = (hw - 0.06, 0.012);
        o.add(Mat::Brass, tube(&[v(x, -y, r), v(x, y, r)], r, 12));
        o.add(Mat::Brass, rod(v(x, -y, 0.0), v(x, -y, 0.38), r, 12));
        o.add(Mat::Brass, rod(v(x, y, 0.0), v(x, y, 0.38), r, 12));
    }
    for (k, (x, y, turn)) in [(0.2, 0.05, 12.0), (0.21, 0.06, -8.0)].into_iter().enumerate() {
        let z = 0.41 + 0.028 * k as f64;
        o.add([Mat::Books, Mat::BluePlastic][k], block(0.0, 0.0, z, [0.3, 0.22, 0.028]).turned(turn, x * length * 0.8, y, 0.0));
    }
    let bowl =
        [[0.0, 0.0], [0.05, 0.0], [0.1, 0.03], [0.13, 0.075], [0.122, 0.075], [0.094, 0.036], [0.046, 0.008], [0.0, 0.008]];
    o.add(Mat::Clay, lathe(&bowl, 24).shifted(-0.25 * length, 0.0, 0.41));
    o
}

/// A round table on a trumpet foot; 0.74 m for a café, 1.06 m for a bar.
pub fn round_table(radius: f64, height: f64, top: Mat) -> BuiltObject {
    let foot = [
        [0.0, 0.0],
        [0.26, 0.0],
        [0.26, 0.012],
        [0.12, 0.03],
        [0.05, 0.09],
        [0.032, 0.2],
        [0.032, height - 0.04],
        [0.09, height - 0.025],
        [0.0, height - 0.025],
    ];
    BuiltObject::new("").with(top, disc(radius, height - 0.025, height, 36)).with(Mat::Brushed, lathe(&foot, 24))
}

/// A bar stool: round cushion, four splayed legs, a foot ring.
pub fn stool(cover: Mat) -> BuiltObject {
    let mut o =
        BuiltObject::new("").with(cover, disc(0.18, 0.68, 0.76, 24)).with(Mat::DarkMetal, cylinder(0.15, 0.665, 0.68, 24));
    for k in 0..4 {
        let (x, y) = trig::on_circle(0.125 + 0.25 * f64::from(k));
        o.add(Mat::DarkMetal, rod(v(0.22 * x, 0.22 * y, 0.002), v(0.12 * x, 0.12 * y, 0.665), 0.011, 10));
    }
    let ring: Vec<_> =
        (0..=20).map(|k| trig::on_circle(f64::from(k) / 20.0)).map(|(x, y)| v(0.178 * x, 0.178 * y, 0.28)).collect();
    o.add(Mat::Brass, tube(&ring, 0.008, 6));
    o
}

/// A chair with a shell seat and back, and four wooden legs.
pub fn chair(cover: Mat) -> BuiltObject {
    let mut o = BuiltObject::new("");
    for (x, y) in [(-0.2, -0.2), (0.2, -0.2), (-0.2, 0.2), (0.2, 0.2)] {
        o.add(Mat::Oak, rod(v(x, y, 0.002), v(0.82 * x, 0.82 * y, 0.43), 0.014, 12));
    }
    o.add(cover, cushion(v(-0.23, -0.23, 0.43), v(0.23, 0.23, 0.48), 0.02, 0.012));
    let bend = |p: glam::DVec3| v(p.x, p.y - 0.9 * p.x * p.x + 0.12 * (p.z - 0.48), p.z);
    o.add(cover, rounded_box(v(-0.21, 0.2, 0.56), v(0.21, 0.235, 0.84), 0.016, 1, 5).deformed(bend));
    for x in [-0.12, 0.12] {
        o.add(Mat::Oak, rod(v(x, 0.18, 0.44), v(x, 0.216, 0.62), 0.011, 10));
    }
    o
}

/// A swivel chair on five castors.
pub fn office_chair(cover: Mat) -> BuiltObject {
    let mut o = BuiltObject::new("").with(Mat::Chrome, cylinder(0.028, 0.09, 0.44, 16));
    for k in 0..5 {
        let (x, y) = trig::on_circle(0.2 * f64::from(k) + 0.05);
        o.add(Mat::DarkMetal, rod(v(0.02 * x, 0.02 * y, 0.1), v(0.29 * x, 0.29 * y, 0.075), 0.02, 10));
        o.add(
            Mat::BlackPlastic,
            rod(
                v(0.29 * x - 0.025 * y, 0.29 * y + 0.025 * x, 0.03),
                v(0.29 * x + 0.025 * y, 0.29 * y - 0.025 * x, 0.03),
                0.03,
                14,
            ),
        );
    }
    o.add(cover, cushion(v(-0.25, -0.25, 0.44), v(0.25, 0.25, 0.52), 0.035, 0.015));
    o.add(Mat::DarkMetal, rod(v(0.0, 0.2, 0.45), v(0.0, 0.29, 0.7), 0.016, 10));
    let bend = |p: glam::DVec3| v(p.x, p.y - 0.7 * p.x * p.x, p.z);
    o.add(cover, rounded_box(v(-0.22, 0.26, 0.6), v(0.22, 0.31, 1.06), 0.024, 1, 5).deformed(bend));
    for x in [-0.27, 0.27] {
        let arm = [v(x, 0.12, 0.46), v(x, 0.14, 0.66), v(x, 0.12, 0.69), v(x, -0.12, 0.69)];
        o.add(Mat::BlackPlastic, tube(&arm, 0.017, 10));
    }
    o
}

/// The reception desk, 3.8 m long: wooden front with a leather inlay, marble counter and side, work top behind. Front towards −y.
pub fn reception_desk() -> BuiltObject {
    let (hl, d) = (1.9, 0.7);
    let mut o = BuiltObject::new("Reception desk");
    o.add(Mat::Laminate, cuboid(v(-hl + 0.06, -0.28, 0.06), v(hl - 0.06, -0.25, 1.06)));
    o.add(Mat::DarkMetal, cuboid(v(-hl + 0.1, -0.27, 0.0), v(hl - 0.1, 0.2, 0.06)));
    // The front: oak planks that stand proud, with an inlay of leather cushions between two rows.
    for i in 0..19 {
        let x0 = -hl + 0.06 + (2.0 * hl - 0.12) * f64::from(i) / 19.0;
        let x1 = -hl + 0.06 + (2.0 * hl - 0.12) * f64::from(i + 1) / 19.0 - 0.006;
        for (low, high) in [(0.08, 0.36), (0.8, 1.05)] {
            let plank = cuboid(v(x0, -0.31, low), v(x1, -0.28, high))
                .grain_turned()
                .grain_shifted(0.13 * f64::from(i * i % 7), 0.21 * f64::from(i));
            o.add(Mat::Oak, plank);
        }
    }
    for i in 0..8 {
        let w = (2.0 * hl - 0.12) / 8.0;
        let x0 = -hl + 0.06 + w * f64::from(i);
        let pad = cushion(v(-0.5 * w + 0.003, -0.21, -0.02), v(0.5 * w - 0.003, 0.21, 0.02), 0.018, 0.018)
            .placed(&LocalFrame::tilt(90.0));
        o.add(Mat::LeatherTan, pad.shifted(x0 + 0.5 * w, -0.3, 0.58));
    }
    o.add(Mat::MarbleWhite, rounded_box(v(-hl, -0.4, 1.06), v(hl, 0.02, 1.1), 0.012, 1, 1));
    for side in [-1.0, 1.0] {
        let x = side * (hl - 0.03);
        o.add(Mat::MarbleWhite, cuboid(v(x - 0.03, -0.34, 0.0), v(x + 0.03, 0.5 * d + 0.1, 1.06)));
    }
    o.add(Mat::Oak, cuboid(v(-hl + 0.06, -0.25, 0.71), v(hl - 0.06, 0.5 * d + 0.08, 0.74)));
    for x in [-1.2, 0.0, 1.2] {
        o.add(Mat::GreyMetal, block(x, 0.12, 0.08, [0.42, 0.5, 0.62]));
        for k in 0..3 {
            let z = 0.15 + 0.2 * f64::from(k);
            o.add(Mat::Chrome, rod(v(x - 0.07, 0.385, z), v(x + 0.07, 0.385, z), 0.008, 8));
        }
    }
    o
}

/// A bench without back: upholstered top on a sled of flat steel.
pub fn bench(length: f64, cover: Mat) -> BuiltObject {
    let h = 0.5 * length;
    let mut o = BuiltObject::new("").with(cover, cushion(v(-h, -0.22, 0.36), v(h, 0.22, 0.46), 0.04, 0.01));
    o.add(Mat::Oak, cuboid(v(-h + 0.02, -0.2, 0.33), v(h - 0.02, 0.2, 0.36)));
    for x in [-h + 0.2, h - 0.2] {
        o.add(Mat::DarkMetal, cuboid(v(x - 0.025, -0.2, 0.0), v(x + 0.025, 0.2, 0.012)));
        for y in [-0.2, 0.188] {
            o.add(Mat::DarkMetal, cuboid(v(x - 0.025, y, 0.012), v(x + 0.025, y + 0.012, 0.33)));
        }
    }
    o
}
