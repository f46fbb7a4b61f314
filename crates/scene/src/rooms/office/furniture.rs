//! Desks, tables and machines of an office. Loose pieces stand on z = 0, centred on their footprint; whoever uses a desk sits towards +y.

use crate::builder::decor::monitor;
use crate::builder::furniture::office_chair;
use crate::builder::materials::Mat;
use crate::builder::mesh_builder::BuiltObject;
use crate::builder::shapes::{block, cuboid, frame_bars, printed_box, rounded_box, v};
use crate::builder::shapes_round::{cylinder, lathe, rod, tube};

/// A mug, its foot at the origin.
fn mug(o: &mut BuiltObject, material: Mat, x: f64, y: f64, z: f64) {
    let wall = [[0.0, 0.0], [0.036, 0.0], [0.04, 0.004], [0.04, 0.095], [0.036, 0.095], [0.036, 0.008], [0.0, 0.008]];
    o.add(material, lathe(&wall, 16).shifted(x, y, z));
    let handle = [v(0.038, 0.0, 0.075), v(0.065, 0.0, 0.07), v(0.065, 0.0, 0.03), v(0.038, 0.0, 0.025)];
    o.add(material, tube(&handle, 0.005, 6).shifted(x, y, z));
}

/// A desk of 1.6 × 0.8 m with a monitor or two, a pedestal and what lies on it; `variant` tells neighbours apart.
pub fn desk(variant: usize) -> BuiltObject {
    let mut o = BuiltObject::new("");
    let top = [Mat::Shelf, Mat::Laminate][variant / 4 % 2];
    o.add(top, rounded_box(v(-0.795, -0.395, 0.713), v(0.795, 0.395, 0.74), 0.004, 1, 1));
    for x in [-0.72, 0.72] {
        o.add(Mat::GreyMetal, block(x, 0.0, 0.0, [0.06, 0.7, 0.03]));
        o.add(Mat::GreyMetal, block(x, 0.0, 0.03, [0.05, 0.09, 0.653]));
        o.add(Mat::GreyMetal, block(x, 0.0, 0.683, [0.05, 0.6, 0.03]));
    }
    o.add(Mat::DarkMetal, cuboid(v(-0.6, -0.36, 0.6), v(0.6, -0.26, 0.612)));
    o.add(Mat::GreyMetal, block(0.48, -0.06, 0.0, [0.4, 0.55, 0.58]));
    for z in [0.12, 0.31, 0.5] {
        o.add(Mat::Chrome, rod(v(0.42, 0.222, z), v(0.54, 0.222, z), 0.006, 8));
    }
    let faces = [Mat::ScreenCode, Mat::ScreenDesk];
    let places: &[f64] = if variant % 3 == 1 { &[-0.3, 0.3] } else { &[-0.05] };
    for (k, x) in places.iter().enumerate() {
        let mut screen = monitor(faces[(variant + k) % 2]);
        if k > 0 {
            screen.parts.retain(|(m, _)| *m != Mat::Keyboard);
        }
        screen = screen.copy("", 0.0, *x, -0.18, 0.0);
        screen.parts.into_iter().for_each(|(m, mesh)| {
            o.add(m, mesh);
        });
    }
    let lay = variant as f64;
    o.add(
        Mat::Paper,
        block(0.0, 0.0, 0.74, [0.21, 0.297, 0.01 + 0.006 * (variant % 4) as f64]).turned(9.0 * lay - 20.0, 0.58, 0.12, 0.0),
    );
    let cover = [Mat::BluePlastic, Mat::ClothRust, Mat::GreenPlastic, Mat::ClothMustard][variant % 4];
    o.add(cover, block(0.0, 0.0, 0.74, [0.24, 0.17, 0.022]).turned(13.0 * lay, -0.6, 0.15, 0.0));
    mug(&mut o, [Mat::WhitePlastic, Mat::Clay, Mat::BluePlastic][variant % 3], -0.48 + 0.04 * lay, -0.1, 0.74);
    o
}

/// Four desks back to back with a screen of cloth between them and a chair each, along x. Desks come in two halves so that every piece of
/// furniture keeps its own name.
pub fn cluster(name: &str, first: usize, cloth: Mat, yaw: f64, x: f64, y: f64) -> Vec<BuiltObject> {
    let mut all = Vec::new();
    for k in 0..4 {
        let (column, turned) = (if k % 2 == 0 { -0.8 } else { 0.8 }, k >= 2);
        let (turn, side) = if turned { (180.0, -1.0) } else { (0.0, 1.0) };
        all.push(desk(first + k).copy(format!("{name}, desk {}", k + 1), turn, column, side * 0.42, 0.0));
        let lean = [8.0, -25.0, 12.0, 40.0][(k + first / 4) % 4];
        let away = [0.0, 0.05, 0.02, -0.03][k];
        let cover = [Mat::ClothGrey, Mat::ClothTeal][(k + first / 4) % 2];
        all.push(office_chair(cover).copy(format!("{name}, chair {}", k + 1), turn + lean, column, side * (1.12 + away), 0.0));
    }
    let panel = rounded_box(v(-1.58, -0.016, 0.62), v(1.58, 0.016, 1.12), 0.008, 1, 1);
    let mut divider = BuiltObject::new(format!("{name}, divider")).with(cloth, panel);
    for x in [-1.2, 0.0, 1.2] {
        divider.add(Mat::DarkMetal, cylinder(0.014, 0.0, 0.62, 12).shifted(x, 0.0, 0.0));
    }
    all.push(divider);
    all.into_iter().map(|o| o.copy(o.name.clone(), yaw, x, y, 0.0)).collect()
}

/// A meeting table of 2.6 × 1.1 m on two plinths, with a conference telephone and papers. Long side along x.
pub fn meeting_table() -> BuiltObject {
    let mut o =
        BuiltObject::new("Meeting table").with(Mat::Walnut, rounded_box(v(-1.3, -0.55, 0.71), v(1.3, 0.55, 0.74), 0.01, 2, 1));
    for x in [-0.75, 0.75] {
        o.add(Mat::DarkMetal, block(x, 0.0, 0.0, [0.5, 0.6, 0.02]));
        o.add(Mat::DarkMetal, block(x, 0.0, 0.02, [0.14, 0.3, 0.69]));
    }
    let phone = [[0.0, 0.0], [0.12, 0.0], [0.13, 0.01], [0.09, 0.035], [0.05, 0.05], [0.0, 0.05]];
    o.add(Mat::BlackPlastic, lathe(&phone, 24).shifted(0.0, 0.0, 0.74));
    for (x, y, turn) in [(-0.7, -0.3, 6.0), (0.1, 0.32, -12.0), (0.85, -0.28, 20.0)] {
        o.add(Mat::Paper, block(0.0, 0.0, 0.74, [0.297, 0.21, 0.012]).turned(turn, x, y, 0.0));
    }
    mug(&mut o, Mat::WhitePlastic, -0.3, -0.35, 0.74);
    mug(&mut o, Mat::Clay, 0.5, 0.3, 0.74);
    o
}

/// A whiteboard 1 m high in an aluminium frame with a tray of pens, lower left corner at the origin. For a wall.
pub fn whiteboard(name: &str, width: f64) -> BuiltObject {
    let mut o = BuiltObject::new(name).with(Mat::Whiteboard, printed_box(v(0.0, 0.0, 0.006), v(width, 1.0, 0.018)));
    o.add(Mat::Brushed, frame_bars(width, 1.0, 0.02, 0.0, 0.026));
    o.add(Mat::Brushed, cuboid(v(0.3, -0.035, 0.026), v(width - 0.3, -0.02, 0.09)));
    for (k, pen) in [Mat::BluePlastic, Mat::RedMetal, Mat::GreenPlastic].into_iter().enumerate() {
        let x = 0.4 + 0.18 * k as f64;
        o.add(pen, rod(v(x, -0.011, 0.06), v(x + 0.13, -0.011, 0.06), 0.009, 8));
    }
    o
}

/// A copier on a paper cabinet, 0.62 × 0.66 × 1.15 m, its front towards −y.
pub fn copier() -> BuiltObject {
    let mut o =
        BuiltObject::new("Copier").with(Mat::WhitePlastic, rounded_box(v(-0.31, -0.33, 0.04), v(0.31, 0.33, 0.86), 0.015, 2, 1));
    o.add(Mat::DarkMetal, block(0.0, 0.0, 0.0, [0.54, 0.56, 0.04]));
    o.add(Mat::BlackPlastic, rounded_box(v(-0.31, -0.3, 0.94), v(0.31, 0.32, 1.02), 0.012, 2, 1));
    o.add(Mat::WhitePlastic, cuboid(v(-0.31, -0.28, 0.86), v(-0.2, 0.3, 0.94)));
    o.add(Mat::WhitePlastic, cuboid(v(-0.1, 0.1, 0.86), v(0.31, 0.3, 0.94)));
    o.add(Mat::WhitePlastic, rounded_box(v(-0.28, -0.2, 1.02), v(0.3, 0.3, 1.12), 0.02, 2, 1));
    for z in [0.1, 0.28, 0.46, 0.64] {
        o.add(Mat::GreyMetal, cuboid(v(-0.29, -0.336, z), v(0.29, -0.331, z + 0.16)));
        o.add(Mat::BlackPlastic, cuboid(v(-0.08, -0.345, z + 0.12), v(0.08, -0.336, z + 0.14)));
    }
    o.add(Mat::BluePlastic, rounded_box(v(0.08, -0.4, 0.97), v(0.3, -0.31, 1.0), 0.008, 1, 1));
    o
}

/// A steel cabinet with a pair of doors, 1 × 0.45 × 1.95 m, its front towards −y, its back at y = 0.
pub fn cupboard(body: Mat) -> BuiltObject {
    let mut o = BuiltObject::new("").with(body, cuboid(v(-0.5, -0.45, 0.02), v(0.5, -0.002, 1.95)));
    o.add(Mat::DarkMetal, cuboid(v(-0.48, -0.43, 0.0), v(0.48, -0.02, 0.02)));
    o.add(Mat::DarkMetal, cuboid(v(-0.002, -0.453, 0.03), v(0.002, -0.45, 1.94)));
    for x in [-0.05, 0.05] {
        o.add(Mat::Chrome, rod(v(x, -0.47, 0.95), v(x, -0.47, 1.15), 0.007, 8));
        for z in [0.97, 1.13] {
            o.add(Mat::Chrome, rod(v(x, -0.47, z), v(x, -0.45, z), 0.005, 6));
        }
    }
    o
}

/// A stack of paper boxes, 0.45 × 0.32 m.
pub fn paper_boxes() -> BuiltObject {
    let mut o = BuiltObject::new("Paper boxes");
    for (k, turn) in [4.0, -7.0, 2.0].into_iter().enumerate() {
        let z = 0.241 * k as f64;
        o.add(Mat::Laminate, block(0.0, 0.0, z, [0.45, 0.32, 0.15]).turned(turn, 0.0, 0.0, 0.0));
        o.add(Mat::BluePlastic, block(0.0, 0.0, z + 0.15, [0.46, 0.33, 0.09]).turned(turn, 0.0, 0.0, 0.0));
    }
    o
}

/// A cable tray along x below the ceiling at z = 0: two side rails, rungs, cables and hangers.
pub fn cable_tray(length: f64) -> BuiltObject {
    let (z, half) = (-0.22, 0.1);
    let mut o = BuiltObject::new("");
    for y in [-half, half] {
        o.add(Mat::Stud, cuboid(v(0.0, y - 0.003, z), v(length, y + 0.003, z + 0.06)));
    }
    for k in 0..(length / 0.3) as u32 {
        let x = 0.1 + 0.3 * f64::from(k);
        o.add(Mat::Stud, cuboid(v(x, -half + 0.003, z + 0.004), v(x + 0.03, half - 0.003, z + 0.01)));
        if k % 5 == 2 {
            for y in [-half - 0.006, half + 0.006] {
                o.add(Mat::Chrome, rod(v(x, y, z + 0.002), v(x, y, -0.001), 0.003, 6));
            }
        }
    }
    for (k, cable) in [Mat::BluePlastic, Mat::BlackPlastic, Mat::BluePlastic, Mat::WhitePlastic].into_iter().enumerate() {
        let y = -0.06 + 0.035 * k as f64;
        o.add(cable, rod(v(0.02, y, z + 0.022), v(length - 0.02, y, z + 0.022), 0.011, 8));
    }
    o
}
