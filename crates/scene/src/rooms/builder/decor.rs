//! Plants, books, lamps and the small things people leave in a room.

use super::materials::Mat;
use super::mesh_builder::{BuiltObject, LocalFrame, Mesh};
use super::shapes::{block, cuboid, picture, printed_box, rounded_box, v};
use super::shapes_round::{cylinder, disc, lathe, leaf, rod, sphere, tube};
use super::trig;
use crate::Rng;
use glam::{DVec2, DVec3};

/// The random-number stage of small variations.
const STAGE_DECOR: u64 = 0xdec0;

/// A round planter with soil.
fn pot(material: Mat, radius: f64, height: f64) -> BuiltObject {
    let r = radius;
    let profile = [
        [0.0, 0.0],
        [0.72 * r, 0.0],
        [0.78 * r, 0.02],
        [r, height - 0.02],
        [r, height],
        [0.92 * r, height],
        [0.88 * r, height - 0.07],
        [0.0, height - 0.07],
    ];
    BuiltObject::new("").with(material, lathe(&profile, 28)).with(Mat::Soil, disc(0.87 * r, height - 0.06, height - 0.05, 20))
}

/// A plant of arching leaves from one crown (a fern, a dracaena): `count` leaves of about `length` metres.
pub fn crown_plant(
    name: &str,
    seed: u64,
    pot_material: Mat,
    leaf_material: Mat,
    stem: f64,
    length: f64,
    count: usize,
) -> BuiltObject {
    let mut o = pot(pot_material, 0.23, 0.42);
    o.name = name.to_owned();
    let crown = v(0.0, 0.0, 0.36 + stem);
    if stem > 0.0 {
        let bend = [v(0.0, 0.0, 0.35), v(0.02, 0.01, 0.35 + 0.5 * stem), crown];
        o.add(Mat::Walnut, tube(&bend, 0.022, 10));
    }
    for k in 0..count {
        let mut rng = Rng::keyed(seed, STAGE_DECOR, k as u64);
        // The golden angle spreads the leaves; later ones stand steeper.
        let (c, s) = trig::on_circle(0.381_966 * k as f64 + 0.04 * rng.uniform_f64());
        let rise = 0.25 + 1.5 * (k as f64 / count as f64) + 0.3 * rng.uniform_f64();
        let size = length * (0.75 + 0.4 * rng.uniform_f64());
        let droop = 0.45 + 0.35 * rng.uniform_f64();
        let root = crown + v(0.015 * c, 0.015 * s, -0.04 + 0.05 * rng.uniform_f64());
        o.add(leaf_material, leaf(root, v(c, s, rise), size, 0.1 * size + 0.02, droop, 4));
    }
    o
}

/// A small tree: a stem, thin branches, many broad leaves (a ficus).
pub fn tree(name: &str, seed: u64, pot_material: Mat, height: f64, leaves: usize) -> BuiltObject {
    let mut o = pot(pot_material, 0.27, 0.5);
    o.name = name.to_owned();
    o.add(Mat::Walnut, tube(&[v(0.0, 0.0, 0.42), v(0.03, 0.0, 0.5 * height), v(0.0, 0.02, 0.82 * height)], 0.02, 10));
    for k in 0..leaves {
        let mut rng = Rng::keyed(seed, STAGE_DECOR, k as u64);
        let (c, s) = trig::on_circle(rng.uniform_f64());
        let up = rng.uniform_f64();
        let z = height * (0.48 + 0.48 * up);
        let reach = 0.34 * (1.0 - (2.0 * up - 0.9).powi(2)).max(0.15) * (0.45 + 0.55 * rng.uniform_f64());
        let tip = v(reach * c, reach * s, z);
        if k % 5 == 0 {
            o.add(Mat::Walnut, rod(v(0.0, 0.0, z - 0.12 - 0.3 * reach), tip, 0.005, 5));
        }
        let (dc, ds) = trig::on_circle(rng.uniform_f64());
        let direction = v(c + 0.7 * dc, s + 0.7 * ds, 0.5 * rng.uniform_f64() - 0.1);
        o.add(Mat::Leaf, leaf(tip, direction, 0.17 + 0.06 * rng.uniform_f64(), 0.085, 0.35, 2));
    }
    o
}

/// A planter box with a row of upright leaves (sansevieria). Along x.
pub fn planter(name: &str, seed: u64, length: f64) -> BuiltObject {
    let (h, d) = (0.5 * length, 0.19);
    let mut o = BuiltObject::new(name).with(Mat::ConcretePot, rounded_box(v(-h, -d, 0.0), v(h, d, 0.5), 0.02, 2, 1));
    o.add(Mat::Soil, cuboid(v(-h + 0.03, -d + 0.03, 0.5), v(h - 0.03, d - 0.03, 0.505)));
    for k in 0..(length * 40.0) as u64 {
        let mut rng = Rng::keyed(seed, STAGE_DECOR, k);
        let x = (2.0 * rng.uniform_f64() - 1.0) * (h - 0.09);
        let y = (2.0 * rng.uniform_f64() - 1.0) * (d - 0.08);
        let (c, s) = trig::on_circle(rng.uniform_f64());
        let lean = 0.18 * rng.uniform_f64();
        let material = if k % 3 == 0 { Mat::LeafPale } else { Mat::Leaf };
        o.add(material, leaf(v(x, y, 0.5), v(lean * c + 0.01, lean * s, 1.0), 0.3 + 0.32 * rng.uniform_f64(), 0.06, 0.02, 3));
    }
    o
}

/// A row of books on a board along x from `from` to `to`; spines towards −y, at `y`.
fn books(o: &mut BuiltObject, seed: u64, from: f64, to: f64, y: f64, z: f64) {
    let mut x = from;
    for k in 0.. {
        let mut rng = Rng::keyed(seed, STAGE_DECOR, k);
        let (w, h, d) = (0.02 + 0.03 * rng.uniform_f64(), 0.2 + 0.1 * rng.uniform_f64(), 0.17 + 0.05 * rng.uniform_f64());
        if x + w > to {
            break;
        }
        if rng.uniform() < 0.07 {
            // A gap, as on shelves in use.
            x += 0.09;
            continue;
        }
        // One column of the atlas on the spine, its plain foot on the boards.
        let column = rng.below(super::textures::SPINES) as f64 / super::textures::SPINES as f64;
        let width = 1.0 / super::textures::SPINES as f64;
        let mut book = block(x + 0.5 * w, y + 0.5 * d, z, [w, d, h]);
        for (i, uv) in book.uvs_m.iter_mut().enumerate() {
            let corner = [[0.05, 0.99], [0.95, 0.99], [0.95, 0.01], [0.05, 0.01]][i % 4];
            let on_spine = i / 4 == 3;
            *uv = if on_spine {
                DVec2::new(column + corner[0] * width, corner[1])
            } else {
                DVec2::new(column + 0.5 * width, 0.96 + 0.03 * corner[1])
            };
        }
        // The top shows paper.
        let top = Mesh { triangles: book.triangles.drain(8..10).collect(), ..book.clone() };
        o.add(Mat::Books, book);
        o.add(Mat::Paper, top);
        x += w + 0.001;
    }
}

/// A bookcase along x, open towards −y, its back at y = 0.
pub fn bookcase(name: &str, seed: u64, length: f64, height: f64) -> BuiltObject {
    let (d, t) = (0.32, 0.025);
    let mut o = BuiltObject::new(name);
    o.add(Mat::Shelf, cuboid(v(0.0, -0.012, 0.0), v(length, 0.0, height)));
    let bays = (length / 0.95).round().max(1.0) as usize;
    for i in 0..=bays {
        let x = (length - t) * i as f64 / bays as f64;
        o.add(Mat::Shelf, cuboid(v(x, -d, 0.0), v(x + t, -0.012, height)).grain_turned());
    }
    let rows = (height / 0.37) as usize;
    for i in 0..bays {
        let (x0, x1) = ((length - t) * i as f64 / bays as f64 + t, (length - t) * (i + 1) as f64 / bays as f64);
        for k in 0..=rows {
            let z = (height - t) * k as f64 / rows as f64;
            o.add(Mat::Shelf, cuboid(v(x0, -d, z), v(x1, -0.012, z + t)));
            if k < rows {
                let key = seed + 100 * i as u64 + k as u64;
                let mut rng = Rng::keyed(key, STAGE_DECOR, 999);
                let end = x0 + (x1 - x0) * (0.62 + 0.38 * rng.uniform_f64());
                books(&mut o, key, x0 + 0.01, end - 0.01, -d + 0.035, z + t);
                if x1 - end > 0.2 {
                    let vase = [[0.0, 0.0], [0.05, 0.0], [0.075, 0.06], [0.06, 0.14], [0.03, 0.18], [0.04, 0.21], [0.0, 0.2]];
                    let material = [Mat::Clay, Mat::ConcretePot, Mat::Brass][rng.below(3)];
                    o.add(material, lathe(&vase, 16).shifted(0.5 * (x1 + end), -0.17, z + t));
                }
            }
        }
    }
    o
}

/// A floor lamp: marble foot, brass rod, cloth drum that glows, closed above and below by the cloth's diffusers.
pub fn floor_lamp() -> BuiltObject {
    let mut o =
        BuiltObject::new("").with(Mat::MarbleWhite, disc(0.15, 0.0, 0.04, 32)).with(Mat::Brass, cylinder(0.011, 0.04, 1.42, 12));
    o.add(Mat::LampShade, lathe(&[[0.0, 1.3], [0.2, 1.3], [0.17, 1.58], [0.0, 1.58]], 20));
    o.add(Mat::Brass, rod(v(-0.185, 0.0, 1.42), v(0.185, 0.0, 1.42), 0.005, 6));
    o
}

/// A waste bin with a swing lid.
pub fn bin(body: Mat) -> BuiltObject {
    let profile = [[0.0, 0.0], [0.15, 0.0], [0.16, 0.01], [0.17, 0.6], [0.17, 0.62], [0.15, 0.64], [0.11, 0.7], [0.0, 0.72]];
    BuiltObject::new("")
        .with(body, lathe(&profile, 28))
        .with(Mat::BlackPlastic, lathe(&[[0.172, 0.56], [0.176, 0.565], [0.176, 0.6], [0.172, 0.605]], 28))
}

/// An extinguisher on its bracket: stands on local z = 0, the wall behind at +y.
pub fn extinguisher() -> BuiltObject {
    let body = [[0.0, 0.0], [0.07, 0.0], [0.078, 0.015], [0.078, 0.4], [0.06, 0.45], [0.025, 0.475], [0.022, 0.5], [0.0, 0.5]];
    let mut o =
        BuiltObject::new("").with(Mat::RedMetal, lathe(&body, 20)).with(Mat::BlackPlastic, cylinder(0.024, 0.5, 0.54, 16));
    o.add(Mat::BlackPlastic, cuboid(v(-0.012, -0.11, 0.53), v(0.012, 0.03, 0.548)));
    o.add(Mat::BlackPlastic, cuboid(v(-0.012, -0.12, 0.56), v(0.012, 0.02, 0.578)));
    o.add(
        Mat::BlackPlastic,
        tube(&[v(0.03, 0.0, 0.52), v(0.1, -0.02, 0.48), v(0.11, -0.03, 0.35), v(0.1, -0.03, 0.15)], 0.012, 10),
    );
    o.add(Mat::WhitePlastic, lathe(&[[0.0785, 0.16], [0.0795, 0.165], [0.0795, 0.3], [0.0785, 0.305]], 20));
    o
}

/// A water cooler with a bottle.
pub fn water_cooler() -> BuiltObject {
    let mut o = BuiltObject::new("").with(Mat::WhitePlastic, rounded_box(v(-0.16, -0.16, 0.0), v(0.16, 0.16, 0.98), 0.025, 2, 1));
    o.add(Mat::GreyMetal, cuboid(v(-0.11, -0.19, 0.62), v(0.11, -0.16, 0.66)));
    for (x, tap) in [(-0.05, Mat::BluePlastic), (0.05, Mat::RedMetal)] {
        o.add(tap, rod(v(x, -0.16, 0.82), v(x, -0.2, 0.82), 0.015, 12));
    }
    let bottle = [
        [0.0, 0.98],
        [0.05, 0.98],
        [0.055, 1.03],
        [0.13, 1.1],
        [0.135, 1.14],
        [0.13, 1.2],
        [0.135, 1.26],
        [0.13, 1.34],
        [0.1, 1.38],
        [0.0, 1.385],
    ];
    o.add(Mat::Water, lathe(&bottle, 24));
    o
}

/// A vending machine, 0.9 × 0.75 × 1.85 m, front towards −y.
pub fn vending_machine() -> BuiltObject {
    let mut o = BuiltObject::new("Vending machine").with(Mat::DarkMetal, cuboid(v(-0.45, -0.35, 0.05), v(0.45, 0.38, 1.85)));
    let front = printed_box(v(-0.45, -0.9, 0.0), v(0.45, 0.9, 0.02)).placed(&LocalFrame::tilt(90.0));
    o.add(Mat::Vending, front.shifted(0.0, -0.35, 0.95));
    for x in [-0.38, 0.38] {
        for y in [-0.3, 0.3] {
            o.add(Mat::BlackPlastic, cylinder(0.03, 0.0, 0.05, 16).shifted(x, y, 0.0));
        }
    }
    o
}

/// An umbrella stand with three umbrellas.
pub fn umbrella_stand() -> BuiltObject {
    let wall = [[0.0, 0.0], [0.13, 0.0], [0.14, 0.02], [0.14, 0.5], [0.13, 0.5], [0.13, 0.03], [0.0, 0.03]];
    let mut o = BuiltObject::new("Umbrella stand").with(Mat::Brushed, lathe(&wall, 24));
    for (k, cloth) in [Mat::ClothRust, Mat::BlackPlastic, Mat::ClothTeal].into_iter().enumerate() {
        let (c, s) = trig::on_circle(k as f64 / 3.0 + 0.1);
        let (foot, head) = (v(0.04 * c, 0.04 * s, 0.03), v(0.11 * c, 0.11 * s, 0.72));
        let axis = (head - foot).normalize();
        o.add(cloth, tube(&[foot + axis * 0.06, foot + axis * 0.3, foot + axis * 0.6], 0.027, 12));
        o.add(Mat::Chrome, rod(foot, head, 0.006, 8));
        let side = v(-s, c, 0.0) * 0.035;
        let hook: Vec<DVec3> = (0..=8)
            .map(|i| {
                let (hc, hs) = trig::on_circle(0.5 - f64::from(i) / 16.0);
                head + side * (1.0 + hc) + axis * (0.035 * hs)
            })
            .collect();
        o.add(Mat::Walnut, tube(&hook, 0.011, 10));
    }
    o
}

/// Posts joined by a sagging belt, in the order of `at`.
pub fn stanchions(at: &[[f64; 2]]) -> BuiltObject {
    let mut o = BuiltObject::new("Stanchions");
    for [x, y] in at {
        let post = [
            [0.0, 0.0],
            [0.16, 0.0],
            [0.16, 0.012],
            [0.05, 0.03],
            [0.024, 0.05],
            [0.024, 0.93],
            [0.03, 0.94],
            [0.03, 0.98],
            [0.0, 0.985],
        ];
        o.add(Mat::Chrome, lathe(&post, 20).shifted(*x, *y, 0.0));
    }
    for pair in at.windows(2) {
        let (a, b) = (DVec2::from(pair[0]), DVec2::from(pair[1]));
        let (d, side) = ((b - a).normalize(), (b - a).normalize().perp() * 0.002);
        let steps = 8;
        for k in 0..steps {
            let sag = |t: f64| 0.93 - 0.1 * 4.0 * t * (1.0 - t);
            let (t0, t1) = (f64::from(k) / f64::from(steps), f64::from(k + 1) / f64::from(steps));
            let end = |t: f64, s: f64| (a + d * (0.024 + t * ((b - a).length() - 0.048)) + side * s).extend(sag(t));
            // The belt's two faces, 4 mm apart; its edges are too thin to matter to either light or radio.
            let mut belt = Mesh::default();
            for s in [1.0, -1.0] {
                let (p, q) = if s > 0.0 { (end(t1, s), end(t0, s)) } else { (end(t0, s), end(t1, s)) };
                belt.quad(p - v(0.0, 0.0, 0.045), q - p, v(0.0, 0.0, 0.045), DVec2::ZERO);
            }
            o.add(Mat::ClothRust, belt);
        }
    }
    o
}

/// A monitor on its foot with a keyboard before it, for a work top 0.74 m high. The lit side looks at whoever sits there, towards +y.
pub fn monitor(face: Mat) -> BuiltObject {
    let mut o = BuiltObject::new("");
    o.add(Mat::BlackPlastic, rounded_box(v(-0.27, 0.0, 0.86), v(0.27, 0.03, 1.18), 0.008, 2, 1));
    o.add(face, picture(v(0.26, 0.0305, 0.87), v(-0.52, 0.0, 0.0), v(0.0, 0.0, 0.3)));
    o.add(Mat::DarkMetal, cuboid(v(-0.03, -0.012, 0.75), v(0.03, 0.0, 1.0)));
    o.add(Mat::DarkMetal, block(0.0, 0.0, 0.74, [0.24, 0.18, 0.01]));
    o.add(Mat::Keyboard, printed_box(v(-0.22, -0.075, 0.0), v(0.22, 0.075, 0.018)).turned(180.0, 0.0, 0.22, 0.74));
    o
}

/// Two monitors, a keyboard, a telephone, a vase with a small plant and a bell, for the desk's work top and counter. Front towards −y.
pub fn desk_things() -> Vec<BuiltObject> {
    let mut all = Vec::new();
    for (i, x) in [-0.75, 0.6].into_iter().enumerate() {
        all.push(monitor(Mat::ScreenDesk).copy(format!("Monitor {}", i + 1), 0.0, x, -0.02, 0.0));
    }
    let mut phone =
        BuiltObject::new("Telephone").with(Mat::BlackPlastic, rounded_box(v(-0.1, -0.1, 0.74), v(0.1, 0.1, 0.78), 0.015, 2, 1));
    phone.add(
        Mat::BlackPlastic,
        tube(&[v(-0.07, -0.09, 0.79), v(-0.08, -0.04, 0.805), v(-0.08, 0.04, 0.805), v(-0.07, 0.09, 0.79)], 0.02, 12),
    );
    all.push(phone.placed(&LocalFrame::at(0.0, 0.2, 0.0)));
    let mut vase = BuiltObject::new("Vase on the counter");
    vase.add(
        Mat::Clay,
        lathe(&[[0.0, 0.0], [0.05, 0.0], [0.08, 0.08], [0.07, 0.16], [0.035, 0.22], [0.045, 0.26], [0.0, 0.25]], 32)
            .shifted(0.0, 0.0, 1.1),
    );
    for k in 0..16 {
        let mut rng = Rng::keyed(77, STAGE_DECOR, k);
        let (c, s) = trig::on_circle(0.381_966 * k as f64);
        vase.add(Mat::Leaf, leaf(v(0.01 * c, 0.01 * s, 1.34), v(c, s, 1.2 + rng.uniform_f64()), 0.26, 0.045, 0.5, 5));
    }
    all.push(vase.placed(&LocalFrame::at(1.5, -0.2, 0.0)));
    let bell = [
        [0.0, 0.0],
        [0.045, 0.0],
        [0.045, 0.012],
        [0.04, 0.015],
        [0.034, 0.034],
        [0.016, 0.046],
        [0.005, 0.048],
        [0.005, 0.056],
        [0.0, 0.058],
    ];
    all.push(BuiltObject::new("Bell").with(Mat::Brass, lathe(&bell, 28).shifted(-0.2, -0.25, 1.1)));
    all.push(
        BuiltObject::new("Leaflets")
            .with(Mat::BluePlastic, block(-1.4, -0.2, 1.1, [0.21, 0.15, 0.04]))
            .with(Mat::WhitePlastic, block(-1.14, -0.2, 1.1, [0.21, 0.15, 0.03])),
    );
    all
}

/// A globe lamp of glass on a short foot, for side tables.
pub fn table_lamp() -> BuiltObject {
    BuiltObject::new("").with(Mat::Brass, disc(0.07, 0.0, 0.02, 24)).with(Mat::PendantGlow, sphere(v(0.0, 0.0, 0.11), 0.09, 12))
}
