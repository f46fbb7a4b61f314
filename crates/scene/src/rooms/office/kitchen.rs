//! The kitchen: a counter with cupboards above it, a refrigerator, machines. Along x, backs at y = 0, fronts towards −y.

use crate::builder::materials::Mat;
use crate::builder::mesh_builder::BuiltObject;
use crate::builder::shapes::{cuboid, rounded_box, v};
use crate::builder::shapes_round::{lathe, rod, tube};

/// Width of a cupboard, metres.
const UNIT: f64 = 0.6;

/// A bar handle along x on a front at `y`.
fn handle(o: &mut BuiltObject, x: f64, y: f64, z: f64) {
    o.add(Mat::Brushed, rod(v(x - 0.09, y - 0.025, z), v(x + 0.09, y - 0.025, z), 0.006, 8));
    for end in [-0.07, 0.07] {
        o.add(Mat::Brushed, rod(v(x + end, y - 0.025, z), v(x + end, y, z), 0.004, 6));
    }
}

/// The counter of `units` cupboards from x = 0, with a sink, tiles above it and wall cupboards over those.
pub fn counter(units: u32) -> BuiltObject {
    let length = UNIT * f64::from(units);
    let mut o = BuiltObject::new("Kitchen counter");
    o.add(Mat::DarkMetal, cuboid(v(0.02, -0.54, 0.0), v(length - 0.02, -0.02, 0.1)));
    o.add(Mat::Laminate, cuboid(v(0.0, -0.58, 0.1), v(length, -0.002, 0.86)));
    o.add(Mat::Oak, rounded_box(v(-0.01, -0.62, 0.86), v(length + 0.01, -0.002, 0.9), 0.006, 1, 1));
    o.add(Mat::Backsplash, cuboid(v(0.0, -0.012, 0.9), v(length, -0.002, 1.45)));
    o.add(Mat::PlasterGreen, cuboid(v(0.0, -0.36, 1.45), v(length, -0.002, 2.15)));
    for i in 0..units {
        let (x0, x1) = (UNIT * f64::from(i) + 0.003, UNIT * f64::from(i + 1) - 0.003);
        let middle = 0.5 * (x0 + x1);
        for (z0, z1) in if i % 3 == 1 { vec![(0.11, 0.36), (0.366, 0.61), (0.616, 0.85)] } else { vec![(0.11, 0.85)] } {
            o.add(Mat::WhiteWood, cuboid(v(x0, -0.6, z0), v(x1, -0.58, z1)));
            handle(&mut o, middle, -0.6, z1 - 0.05);
        }
        o.add(Mat::WhiteWood, cuboid(v(x0, -0.378, 1.453), v(x1, -0.36, 2.147)));
        handle(&mut o, middle, -0.378, 1.5);
    }
    // A flat rim of steel with a dark basin, and the tap behind it.
    let sink = UNIT * 2.5;
    o.add(Mat::Brushed, cuboid(v(sink - 0.27, -0.54, 0.9), v(sink + 0.27, -0.12, 0.906)));
    o.add(Mat::DarkMetal, cuboid(v(sink - 0.22, -0.5, 0.906), v(sink + 0.22, -0.17, 0.908)));
    let tap = [
        v(sink, -0.09, 0.9),
        v(sink, -0.09, 1.12),
        v(sink, -0.12, 1.17),
        v(sink, -0.2, 1.19),
        v(sink, -0.27, 1.16),
        v(sink, -0.28, 1.12),
    ];
    o.add(Mat::Chrome, tube(&tap, 0.012, 10));
    machines(&mut o, length);
    o
}

/// A coffee machine, a microwave oven, cups and a bowl on the worktop.
fn machines(o: &mut BuiltObject, length: f64) {
    let (x, z) = (0.4, 0.9);
    o.add(Mat::BlackPlastic, rounded_box(v(x - 0.15, -0.28, z), v(x + 0.15, -0.06, z + 0.4), 0.015, 2, 1));
    o.add(Mat::BlackPlastic, cuboid(v(x - 0.15, -0.46, z), v(x + 0.15, -0.28, z + 0.06)));
    o.add(Mat::Brushed, rounded_box(v(x - 0.15, -0.46, z + 0.28), v(x + 0.15, -0.28, z + 0.4), 0.012, 2, 1));
    for spout in [-0.03, 0.03] {
        o.add(Mat::Chrome, rod(v(x + spout, -0.4, z + 0.22), v(x + spout, -0.4, z + 0.28), 0.009, 8));
    }
    let x = length - 0.45;
    o.add(Mat::Brushed, rounded_box(v(x - 0.25, -0.42, z), v(x + 0.25, -0.06, z + 0.29), 0.01, 1, 1));
    o.add(Mat::BlackPlastic, cuboid(v(x - 0.23, -0.426, z + 0.03), v(x + 0.1, -0.42, z + 0.26)));
    o.add(Mat::Chrome, rod(v(x + 0.13, -0.44, z + 0.05), v(x + 0.13, -0.44, z + 0.24), 0.007, 8));
    let cup = [[0.0, 0.0], [0.03, 0.0], [0.042, 0.08], [0.038, 0.08], [0.026, 0.006], [0.0, 0.006]];
    for (k, material) in [Mat::WhitePlastic, Mat::Clay, Mat::BluePlastic, Mat::WhitePlastic].into_iter().enumerate() {
        o.add(material, lathe(&cup, 16).shifted(0.72 + 0.12 * k as f64, -0.2 - 0.05 * (k % 2) as f64, z));
    }
    let bowl = [[0.0, 0.0], [0.07, 0.0], [0.16, 0.07], [0.152, 0.07], [0.066, 0.008], [0.0, 0.008]];
    o.add(Mat::Oak, lathe(&bowl, 24).shifted(2.1, -0.3, z));
}

/// A refrigerator, 0.6 × 0.64 × 1.85 m, from x = 0.
pub fn refrigerator() -> BuiltObject {
    let mut o = BuiltObject::new("Refrigerator").with(Mat::GreyMetal, cuboid(v(0.0, -0.58, 0.02), v(0.6, -0.01, 1.85)));
    o.add(Mat::DarkMetal, cuboid(v(0.03, -0.55, 0.0), v(0.57, -0.04, 0.02)));
    for (z0, z1) in [(0.03, 0.68), (0.69, 1.845)] {
        o.add(Mat::Brushed, rounded_box(v(0.002, -0.64, z0), v(0.598, -0.58, z1), 0.01, 2, 1).grain_turned());
    }
    for (z0, z1) in [(0.4, 0.62), (0.8, 1.3)] {
        o.add(Mat::Chrome, rod(v(0.07, -0.67, z0), v(0.07, -0.67, z1), 0.009, 10));
        for z in [z0 + 0.03, z1 - 0.03] {
            o.add(Mat::Chrome, rod(v(0.07, -0.67, z), v(0.07, -0.64, z), 0.006, 6));
        }
    }
    o
}
