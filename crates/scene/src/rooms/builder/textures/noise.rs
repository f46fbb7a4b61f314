//! Noise that repeats over a texture: values depend on integer lattice points and a seed alone.

use crate::Rng;

/// The random-number stage of textures.
const STAGE_LATTICE: u64 = 0x10bb;

/// Uniform in `[0, 1)` at a lattice point.
pub fn lattice(x: i64, y: i64, seed: u64) -> f32 {
    Rng::keyed(seed, STAGE_LATTICE, ((x as u64) << 32) ^ (y as u64 & 0xffff_ffff)).uniform()
}

/// Value noise in `[0, 1]`, smooth, of period `(px, py)` in its own units.
pub fn value(x: f32, y: f32, px: i64, py: i64, seed: u64) -> f32 {
    let (ix, iy) = (x.floor(), y.floor());
    let fade = |t: f32| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (fx, fy) = (fade(x - ix), fade(y - iy));
    let (x0, y0) = ((ix as i64).rem_euclid(px), (iy as i64).rem_euclid(py));
    let (x1, y1) = ((x0 + 1) % px, (y0 + 1) % py);
    let between = |a: f32, b: f32| a + (b - a) * fx;
    let low = between(lattice(x0, y0, seed), lattice(x1, y0, seed));
    let high = between(lattice(x0, y1, seed), lattice(x1, y1, seed));
    low + (high - low) * fy
}

/// A sum of octaves in about `[−1, 1]`; `u, v` in `[0, 1]` cover `cells_u × cells_v` cells of the first octave and repeat there.
pub fn fbm(u: f32, v: f32, cells_u: i64, cells_v: i64, octaves: u32, seed: u64) -> f32 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    for o in 0..octaves {
        let (pu, pv) = (cells_u << o, cells_v << o);
        sum += weight * (2.0 * value(u * pu as f32, v * pv as f32, pu, pv, seed + u64::from(o)) - 1.0);
        total += weight;
        weight *= 0.5;
    }
    sum / total * 1.6
}

/// Vein strength in `[0, 1]`: 1 on the zero lines of a noise field, falling off over `width`.
pub fn vein(u: f32, v: f32, cells: i64, width: f32, seed: u64) -> f32 {
    let warp = 0.12 * fbm(u, v, cells, cells, 4, seed + 100);
    let n = fbm(u + warp, v + 0.7 * warp, cells, cells, 4, seed);
    (1.0 - n.abs() / width).max(0.0)
}

/// The nearest and second nearest feature distances (in cells) and the nearest cell's random value, on a jittered grid that repeats.
pub fn cells(u: f32, v: f32, n: i64, seed: u64) -> (f32, f32, f32) {
    let (x, y) = (u * n as f32, v * n as f32);
    let (ix, iy) = (x.floor() as i64, y.floor() as i64);
    let mut best = (f32::MAX, f32::MAX, 0.0);
    for dy in -1..=1 {
        for dx in -1..=1 {
            let (cx, cy) = (ix + dx, iy + dy);
            let (wx, wy) = (cx.rem_euclid(n), cy.rem_euclid(n));
            let px = cx as f32 + 0.1 + 0.8 * lattice(wx, wy, seed);
            let py = cy as f32 + 0.1 + 0.8 * lattice(wx, wy, seed + 1);
            let d = ((px - x) * (px - x) + (py - y) * (py - y)).sqrt();
            if d < best.0 {
                best = (d, best.0, lattice(wx, wy, seed + 2));
            } else if d < best.1 {
                best.1 = d;
            }
        }
    }
    best
}
