//! Wood: grain runs along u.

use super::noise::{fbm, lattice, value};
use crate::builder::trig;
use crate::draw::{Canvas, Rgb, hex, mix, scale, smoothstep};

/// Growth rings cut lengthwise with a wandering centre: brightness in `[0, 1]`, fine pores included.
fn grain(u: f32, v: f32, rings: f32, seed: u64) -> f32 {
    let wander = 0.1 * fbm(u, v, 2, 3, 4, seed) + 0.02 * fbm(u, v, 6, 40, 2, seed + 9);
    let ring = trig::sin(f64::from((v + wander) * rings * std::f32::consts::TAU)) as f32;
    let pores = fbm(u, v, 10, 220, 2, seed + 20);
    (0.5 + 0.28 * ring + 0.26 * pores + 0.18 * fbm(u, v, 3, 14, 3, seed + 30)).clamp(0.0, 1.0)
}

fn board(dark: Rgb, light: Rgb, rings: f32, seed: u64) -> Canvas {
    Canvas::shaded(768, 768, |u, v| mix(dark, light, grain(u, v, rings, seed)))
}

/// Pale oak veneer.
pub fn oak() -> Canvas {
    board(hex(0xa97f52), hex(0xd3ad7c), 7.0, 101)
}

/// Walnut veneer.
pub fn walnut() -> Canvas {
    board(hex(0x4a2f1f), hex(0x7f573a), 6.0, 141)
}

/// Normals of the pores.
pub fn wood_normal() -> Canvas {
    Canvas::normals(384, 384, 0.7, |u, v| fbm(u, v, 8, 110, 2, 121))
}

/// Planks along one edge of the floor texture (1.6 m).
const PLANKS: i64 = 8;

/// Oak planks 0.2 m wide and 0.8 m long, staggered, each its own cut.
pub fn floor_boards() -> Canvas {
    Canvas::shaded(1024, 1024, |u, v| {
        let row = (v * PLANKS as f32).floor();
        let shift = 0.5 * lattice(row as i64, 3, 161);
        let along = (u + shift).fract() * 2.0;
        let id = along.floor() as i64;
        let across = v * PLANKS as f32 - row;
        let (pu, pv) = (u + lattice(id, row as i64, 162), v + lattice(id, row as i64, 163));
        let tone = 0.86 + 0.24 * lattice(id, row as i64, 164);
        let wood = scale(mix(hex(0x9a7248), hex(0xc9a06c), grain(pu.fract(), pv.fract(), 9.0, 165)), tone);
        let gap = across.min(1.0 - across) * 0.2;
        let butt = (along - along.floor()).min(1.0 - (along - along.floor())) * 0.8;
        let joint = 1.0 - smoothstep(0.0006, 0.0028, gap.min(butt));
        let wear = 1.0 + 0.03 * (value(u * 5.0, v * 5.0, 5, 5, 166) - 0.5);
        mix(scale(wood, wear), hex(0x3c2a1a), 0.75 * joint)
    })
}
