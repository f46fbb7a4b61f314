//! Leather, woven cloth, rugs, brushed metal and leaves: fine structure meant to be multiplied by a material's colour.

use super::noise::{cells, fbm, lattice};
use crate::builder::trig;
use crate::draw::{Canvas, Rgb, hex, mix, scale, smoothstep};

fn wave(x: f32) -> f32 {
    trig::sin(f64::from(x * std::f32::consts::TAU)) as f32
}

/// Grained leather, near white.
pub fn leather() -> Canvas {
    Canvas::shaded(512, 512, |u, v| {
        let (near, next, pick) = cells(u, v, 60, 201);
        let crease = smoothstep(0.0, 0.25, next - near);
        let patina = 1.0 + 0.1 * fbm(u, v, 3, 3, 4, 205);
        scale(hex(0xf0ece8), patina * (0.74 + 0.22 * crease + 0.06 * pick))
    })
}

/// Its grain as normals.
pub fn leather_normal() -> Canvas {
    Canvas::normals(384, 384, 1.4, |u, v| {
        let (near, next, _) = cells(u, v, 60, 201);
        smoothstep(0.0, 0.3, next - near)
    })
}

/// Threads along one edge of the weave texture.
const THREADS: f32 = 64.0;

/// Height and direction of a plain weave: over-under threads.
fn thread(u: f32, v: f32) -> (f32, bool, i64) {
    let (x, y) = (u * THREADS, v * THREADS);
    let (i, j) = (x.floor() as i64, y.floor() as i64);
    let over = (i + j).rem_euclid(2) == 0;
    let across = |t: f32| 1.0 - (2.0 * (t - t.floor()) - 1.0).powi(2);
    let (width, length) = if over { (across(y), across(x)) } else { (across(x), across(y)) };
    (width.max(0.0) * (0.45 + 0.55 * length), over, if over { j } else { i })
}

/// Plain-woven upholstery, near white, with mélange threads.
pub fn weave() -> Canvas {
    Canvas::shaded(512, 512, |u, v| {
        let (height, over, id) = thread(u, v);
        let tone = lattice(id, i64::from(over), 211);
        let fleck = lattice((u * THREADS) as i64, (v * THREADS) as i64, 212);
        scale(hex(0xf2f0ec), 0.52 + 0.34 * height + 0.12 * tone + 0.1 * (fleck - 0.5))
    })
}

/// The weave as normals.
pub fn weave_normal() -> Canvas {
    Canvas::normals(256, 256, 1.3, |u, v| thread(u, v).0)
}

/// A rug: border stripes and a field of nested diamonds, with pile noise. Fills its object once.
pub fn rug() -> Canvas {
    let (cream, blue, teal, rust, ochre): (Rgb, Rgb, Rgb, Rgb, Rgb) =
        (hex(0xd9cfba), hex(0x24415c), hex(0x3f7377), hex(0xa6492f), hex(0xc99a3f));
    Canvas::shaded(896, 672, |u, v| {
        let edge = (u.min(1.0 - u) * 4.0).min(v.min(1.0 - v) * 3.0);
        let (x, y) = (u * 8.0, v * 6.0);
        let d = (x - x.floor() - 0.5).abs() + (y - y.floor() - 0.5).abs();
        let odd = (x.floor() as i64 + y.floor() as i64).rem_euclid(2) == 0;
        let field = match (d * 10.0) as i32 {
            0 => ochre,
            1 => {
                if odd {
                    rust
                } else {
                    blue
                }
            }
            2 => cream,
            3 => {
                if odd {
                    teal
                } else {
                    rust
                }
            }
            4 => cream,
            _ => blue,
        };
        let colour = match (edge * 40.0) as i32 {
            0..=2 => blue,
            3 => cream,
            4..=6 => {
                if ((u + v) * 60.0).fract() < 0.5 {
                    rust
                } else {
                    ochre
                }
            }
            7 => cream,
            8 => blue,
            _ => field,
        };
        let pile = 0.83 + 0.1 * (0.5 + 0.5 * wave(v * 168.0)) + 0.09 * lattice((u * 896.0) as i64, (v * 672.0) as i64, 221);
        scale(colour, pile * (1.0 + 0.06 * fbm(u, v, 4, 3, 4, 222)))
    })
}

/// A ribbed entrance mat.
pub fn entrance_mat() -> Canvas {
    Canvas::shaded(256, 256, |u, v| {
        let rib = 0.5 + 0.5 * wave(u * 16.0);
        let fuzz = lattice((u * 256.0) as i64, (v * 256.0) as i64, 231);
        mix(hex(0x26282b), hex(0x5b5e62), 0.65 * rib + 0.35 * fuzz)
    })
}

/// Brushed metal: streaks along u.
pub fn brushed() -> Canvas {
    Canvas::shaded(512, 512, |u, v| {
        let streak = fbm(u, v, 3, 256, 1, 241) * 0.6 + fbm(u, v, 8, 128, 2, 243) * 0.4;
        scale(hex(0xd4d4d3), 0.95 + 0.1 * streak)
    })
}

/// A leaf: rib, side veins, mottling. v = 1 at the stalk.
pub fn leaf() -> Canvas {
    Canvas::shaded(128, 256, |u, v| {
        let side = (u - 0.5).abs();
        let rib = 1.0 - smoothstep(0.008, 0.03, side);
        let veins = smoothstep(0.8, 1.0, wave((v + side * 0.55) * 14.0)) * 0.5;
        let base = mix(hex(0x2f5d27), hex(0x5a8f3d), 0.5 + 0.5 * fbm(u, v, 4, 8, 4, 251) + 0.3 * (1.0 - v));
        mix(base, hex(0x9dbd74), rib.max(veins * (1.0 - 1.2 * side)))
    })
}
