//! Fittings of a room's shell: doors, lights, vents, screens, signs, radiators. Things for a wall are made in the wall's coordinates
//! (x to the right, y up, z into the room); things for a ceiling hang below the height they are given.

use super::materials::Mat;
use super::mesh_builder::{BuiltObject, LocalFrame, Mesh};
use super::shapes::{cuboid, frame_bars, picture, printed_box, rounded_box, v};
use super::shapes_round::{lathe, rod, tube};
use super::trig;
use glam::DVec2;

/// A closed wooden leaf in a frame, with a lever handle.
pub fn door(name: &str, width: f64, height: f64) -> BuiltObject {
    let mut o = BuiltObject::new(name);
    o.add(Mat::DoorWood, cuboid(v(0.0, 0.0, -0.03), v(width, height, 0.01)).grain_turned());
    for (x0, x1, top) in [(-0.07, 0.0, height + 0.07), (width, width + 0.07, height + 0.07)] {
        o.add(Mat::GreyMetal, cuboid(v(x0, 0.0, -0.04), v(x1, top, 0.03)));
    }
    o.add(Mat::GreyMetal, cuboid(v(0.0, height, -0.04), v(width, height + 0.07, 0.03)));
    o.add(Mat::Brushed, cuboid(v(0.0, 0.02, 0.01), v(width, 0.22, 0.013)));
    o.add(Mat::Chrome, cuboid(v(width - 0.1, 0.93, 0.01), v(width - 0.06, 1.15, 0.016)));
    o.add(
        Mat::Chrome,
        tube(
            &[
                v(width - 0.08, 1.06, 0.016),
                v(width - 0.08, 1.06, 0.06),
                v(width - 0.1, 1.06, 0.068),
                v(width - 0.21, 1.06, 0.068),
            ],
            0.01,
            12,
        ),
    );
    o
}

/// A horizontal regular polygon facing down: the fewest triangles that look round enough to be a lamp.
pub fn lamp_face(x: f64, y: f64, z: f64, radius: f64, corners: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let at = |k: usize| trig::on_circle(-(k as f64) / corners as f64);
    for k in 1..corners - 1 {
        let ids = [0, k, k + 1].map(|i| {
            let (cx, sy) = at(i);
            mesh.vertex(v(x + radius * cx, y + radius * sy, z), v(0.0, 0.0, -1.0), DVec2::new(cx, sy))
        });
        mesh.triangle(ids[0], ids[1], ids[2]);
    }
    mesh
}

/// A lit ceiling panel of `size` with its lower corner in plan at `x, y`: a white housing, a bezel below it, a face that shines down.
pub fn light_panel(name: &str, x: f64, y: f64, size: [f64; 2], ceiling: f64) -> BuiltObject {
    let ([w, h], z) = (size, ceiling - 0.03);
    let mut o = BuiltObject::new(name);
    o.add(Mat::WhiteMetal, cuboid(v(x, y, z + 0.004), v(x + w, y + h, ceiling - 0.002)));
    o.add(Mat::WhiteMetal, frame_bars(w - 0.05, h - 0.05, 0.025, 0.0, 0.014).shifted(x + 0.025, y + 0.025, z - 0.01));
    o.add(Mat::LightPanel, picture(v(x + 0.025, y + h - 0.025, z), v(w - 0.05, 0.0, 0.0), v(0.0, 0.05 - h, 0.0)));
    o
}

/// A vent of tilted slats in a frame of 0.6 m, lower corner in plan at `x, y`.
pub fn air_vent(name: &str, x: f64, y: f64, ceiling: f64) -> BuiltObject {
    let mut o = BuiltObject::new(name);
    o.add(Mat::WhiteMetal, frame_bars(0.54, 0.54, 0.03, ceiling - 0.016, ceiling - 0.001).shifted(x + 0.03, y + 0.03, 0.0));
    for k in 0..9 {
        let slat = cuboid(v(-0.27, -0.022, -0.002), v(0.27, 0.022, 0.002)).placed(&LocalFrame::tilt(32.0));
        o.add(Mat::WhiteMetal, slat.shifted(x + 0.3, y + 0.06 + 0.06 * f64::from(k), ceiling - 0.017));
    }
    o
}

/// The body of a smoke detector, its axis at `x, y`.
pub fn smoke_detector(x: f64, y: f64, ceiling: f64) -> Mesh {
    let body = [
        [0.0, ceiling - 0.05],
        [0.03, ceiling - 0.048],
        [0.05, ceiling - 0.03],
        [0.055, ceiling - 0.001],
        [0.0, ceiling - 0.001],
    ];
    lathe(&body, 24).shifted(x, y, 0.0)
}

/// A screen: black housing, lit front.
pub fn screen(name: &str, face: Mat, width: f64, height: f64, depth: f64) -> BuiltObject {
    let (w, h) = (0.5 * width, 0.5 * height);
    BuiltObject::new(name)
        .with(Mat::BlackPlastic, rounded_box(v(-w - 0.014, -h - 0.014, 0.0), v(w + 0.014, h + 0.014, depth), 0.006, 2, 1))
        .with(face, picture(v(-w, -h, depth + 0.001), v(width, 0.0, 0.0), v(0.0, height, 0.0)))
}

/// A cork board with notices in an oak frame, lower left corner at the origin.
pub fn notice_board(name: &str, width: f64, height: f64) -> BuiltObject {
    let mut o = BuiltObject::new(name);
    o.add(Mat::Cork, printed_box(v(0.0, 0.0, 0.004), v(width, height, 0.016)));
    o.add(Mat::Oak, frame_bars(width, height, 0.03, 0.0, 0.024));
    o
}

/// A painting on canvas in a walnut frame, 1.35 × 0.9 m, lower left corner at the origin.
pub fn painting() -> BuiltObject {
    let mut o = BuiltObject::new("Painting");
    o.add(Mat::Painting, printed_box(v(0.0, 0.0, 0.006), v(1.35, 0.9, 0.03)));
    o.add(Mat::Walnut, frame_bars(1.35, 0.9, 0.02, 0.0, 0.04));
    o
}

/// A round clock, 0.41 m across, its middle at the origin.
pub fn clock() -> BuiltObject {
    let mut o = BuiltObject::new("Clock");
    // The lathe's axis is the wall's normal: local z.
    o.add(
        Mat::DarkMetal,
        lathe(&[[0.0, 0.0], [0.2, 0.0], [0.205, 0.01], [0.205, 0.045], [0.19, 0.045], [0.19, 0.03], [0.0, 0.03]], 48),
    );
    let mut face = lamp_face(0.0, 0.0, 0.032, 0.188, 40).placed(&LocalFrame::tilt(180.0)).shifted(0.0, 0.0, 0.064);
    for (p, uv) in face.positions.iter().zip(&mut face.uvs_m) {
        *uv = DVec2::new(0.5 + 0.5 * p.x / 0.19, 0.5 - 0.5 * p.y / 0.19);
    }
    o.add(Mat::ClockFace, face);
    o
}

/// A lit exit sign, 0.42 × 0.21 m, its middle at the origin.
pub fn exit_sign(name: &str) -> BuiltObject {
    let mut o = BuiltObject::new(name);
    o.add(Mat::WhitePlastic, rounded_box(v(-0.21, -0.105, 0.0), v(0.21, 0.105, 0.05), 0.01, 2, 1));
    o.add(Mat::Exit, picture(v(-0.2, -0.1, 0.051), v(0.4, 0.0, 0.0), v(0.0, 0.2, 0.0)));
    o
}

/// The plate of a switch or a socket with its rocker, its middle at the origin.
pub fn switch_plate() -> Mesh {
    let mut plate = cuboid(v(-0.042, -0.042, 0.0), v(0.042, 0.042, 0.009));
    plate.append(&cuboid(v(-0.028, -0.028, 0.009), v(0.028, 0.028, 0.013)));
    plate
}

/// A flat panel radiator with its valve, from the origin to `length`.
pub fn radiator(name: &str, length: f64) -> BuiltObject {
    let mut o = BuiltObject::new(name);
    o.add(Mat::WhiteMetal, rounded_box(v(0.0, 0.15, 0.03), v(length, 0.7, 0.09), 0.008, 2, 1));
    let ribs = (length / 0.06) as usize;
    for k in 0..ribs {
        let rx = 0.03 + (length - 0.06) * (k as f64 + 0.5) / ribs as f64;
        o.add(Mat::WhiteMetal, cuboid(v(rx - 0.02, 0.18, 0.09), v(rx + 0.02, 0.67, 0.1)));
    }
    o.add(Mat::Chrome, tube(&[v(length + 0.03, 0.0, 0.06), v(length + 0.03, 0.2, 0.06), v(length - 0.01, 0.2, 0.06)], 0.011, 10));
    o.add(Mat::WhitePlastic, rod(v(length + 0.03, 0.2, 0.06), v(length + 0.03, 0.2, 0.12), 0.022, 16));
    o
}
