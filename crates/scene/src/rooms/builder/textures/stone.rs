//! Floor tiles, marble, concrete, terrazzo, plaster, ceiling boards.

use super::noise::{cells, fbm, lattice, value, vein};
use crate::draw::{Canvas, hex, mix, scale, smoothstep};

/// Tiles along one edge of the floor texture (2.4 m).
const TILES: f32 = 4.0;
/// Half a joint, in tiles (4 mm of 600 mm).
const HALF_JOINT: f32 = 0.0035;

/// Distance to the nearest joint in tiles, and the tile's indices.
fn tile(u: f32, v: f32) -> (f32, i64, i64) {
    let (x, y) = (u * TILES, v * TILES);
    let edge = |t: f32| (t - t.floor()).min(1.0 - (t - t.floor()));
    (edge(x).min(edge(y)), x.floor() as i64, y.floor() as i64)
}

/// Honed limestone-coloured tiles, 4 × 4: each its own shade and its own piece of the vein field.
pub fn floor_tiles() -> Canvas {
    Canvas::shaded(1024, 1024, |u, v| {
        let (edge, i, j) = tile(u, v);
        let shade = 0.94 + 0.1 * lattice(i, j, 11);
        let (su, sv) = (u + 0.37 * lattice(i, j, 12), v + 0.41 * lattice(i, j, 13));
        let cloud = fbm(su, sv, 9, 9, 5, 14);
        let base = mix(hex(0xb9b2a5), hex(0xd6d0c4), 0.5 + 0.5 * cloud);
        let lines = vein(su, sv, 5, 0.05, 15) * 0.55 + vein(su, sv, 9, 0.03, 19) * 0.3;
        let grain = 0.03 * (lattice((u * 1024.0) as i64, (v * 1024.0) as i64, 16) - 0.5);
        let stone = scale(mix(base, hex(0x8d8374), lines), shade + grain);
        mix(stone, hex(0x6f6a62), 1.0 - smoothstep(HALF_JOINT * 0.7, HALF_JOINT * 1.5, edge))
    })
}

/// The joints between them, pressed in, with a bevel.
pub fn floor_tiles_normal() -> Canvas {
    Canvas::normals(512, 512, 1.2, |u, v| smoothstep(0.0, 3.0 * HALF_JOINT, tile(u, v).0))
}

/// White marble with grey veins.
pub fn marble_white() -> Canvas {
    Canvas::shaded(768, 768, |u, v| {
        let cloud = fbm(u, v, 3, 3, 5, 21);
        let base = mix(hex(0xd3d3d1), hex(0xefeeea), 0.6 + 0.5 * cloud);
        let wide = vein(u, v, 2, 0.16, 22);
        let fine = vein(u, v, 4, 0.05, 27);
        mix(mix(base, hex(0x8e9296), wide * wide * 0.75), hex(0x6d6a62), fine * 0.5)
    })
}

/// Dark green marble with pale veins.
pub fn marble_green() -> Canvas {
    Canvas::shaded(512, 512, |u, v| {
        let cloud = fbm(u, v, 4, 4, 5, 31);
        let base = mix(hex(0x14332b), hex(0x2f5a4c), 0.5 + 0.6 * cloud);
        let veins = vein(u, v, 3, 0.09, 32) * 0.6 + vein(u, v, 6, 0.04, 37) * 0.45;
        mix(base, hex(0xb9cbbd), veins)
    })
}

/// Fair-faced concrete, 2.4 m: formwork panels 1.2 m wide, tie holes, pores and stains.
pub fn concrete() -> Canvas {
    let mut canvas = Canvas::shaded(1024, 1024, |u, v| {
        let panel = lattice((u * 2.0) as i64, (v * 2.0) as i64, 41);
        let stain = fbm(u, v, 3, 2, 5, 42) * 0.09 + fbm(u, v, 24, 10, 3, 43) * 0.045;
        let grain = 0.045 * (lattice((u * 1024.0) as i64, (v * 1024.0) as i64, 44) - 0.5);
        let seam = |t: f32| {
            let d = (t * 2.0 - (t * 2.0).round()).abs();
            1.0 - smoothstep(0.001, 0.004, d)
        };
        let k = 0.93 + 0.1 * panel + stain + grain - 0.22 * seam(u).max(seam(v));
        scale(hex(0xb9b7b2), k)
    });
    for j in 0..4 {
        for i in 0..4 {
            let (x, y) = ((i as f32 + 0.5) * 256.0, (j as f32 + 0.5) * 256.0);
            canvas.disc(x, y, 8.0, hex(0x9a9893));
            canvas.disc(x + 0.8, y + 1.0, 6.4, hex(0x58564f));
        }
    }
    for k in 0..420 {
        let at = |s| lattice(k, 0, s) * 1024.0;
        canvas.disc(at(45), at(46), 0.5 + 1.6 * lattice(k, 1, 47), hex(0x7b7973));
    }
    canvas
}

/// Terrazzo: chips of four colours in a pale ground.
pub fn terrazzo() -> Canvas {
    Canvas::shaded(512, 512, |u, v| {
        let ground = scale(hex(0xd9d4ca), 0.97 + 0.05 * fbm(u, v, 16, 16, 3, 51));
        let chips = [hex(0x6f7f86), hex(0xb4794f), hex(0x3d4446), hex(0xf2efe8), hex(0x9a8f80)];
        let mut colour = ground;
        for (n, seed, size) in [(34, 52, 0.28), (15, 56, 0.3)] {
            let (near, next, pick) = cells(u, v, n, seed);
            let inside = smoothstep(0.06, 0.1, next - near) * (1.0 - smoothstep(size, size + 0.05, near));
            if pick > 0.35 {
                colour = mix(colour, chips[(pick * 97.0) as usize % chips.len()], inside);
            }
        }
        colour
    })
}

/// Roller-painted plaster: nearly flat.
pub fn plaster() -> Canvas {
    Canvas::shaded(512, 512, |u, v| {
        let k = 1.0 + 0.022 * fbm(u, v, 60, 60, 3, 61) + 0.018 * fbm(u, v, 3, 3, 3, 64);
        scale(hex(0xf0eee9), k)
    })
}

/// Mineral-fibre boards, 2 × 2 of 0.6 m, white rails between them, round and slit perforations.
pub fn ceiling() -> Canvas {
    let mut canvas = Canvas::shaded(512, 512, |u, v| {
        let board = lattice((u * 2.0) as i64, (v * 2.0) as i64, 71);
        scale(hex(0xe9e8e3), 0.965 + 0.03 * board + 0.025 * fbm(u, v, 48, 48, 2, 72))
    });
    for k in 0..2600 {
        let (x, y) = (lattice(k, 0, 73) * 512.0, lattice(k, 1, 73) * 512.0);
        let edge = |t: f32| (t % 256.0).min(256.0 - t % 256.0);
        if edge(x) > 12.0 && edge(y) > 12.0 {
            let r = 0.55 + 0.9 * value(x * 0.1, y * 0.1, 51, 51, 74);
            canvas.disc(x, y, r, hex(0xb4b2ac));
        }
    }
    for i in 0..3 {
        let t = i as f32 * 256.0;
        for (w, colour) in [(7.5, hex(0xbdbcb8)), (5.0, hex(0xf7f7f5))] {
            canvas.rect(t - w, 0.0, t + w, 512.0, colour);
            canvas.rect(0.0, t - w, 512.0, t + w, colour);
        }
    }
    canvas
}

/// Potting soil.
pub fn soil() -> Canvas {
    Canvas::shaded(128, 128, |u, v| {
        let (near, _, pick) = cells(u, v, 18, 81);
        scale(mix(hex(0x2c2118), hex(0x5a4632), pick), 1.15 - 0.6 * near)
    })
}
