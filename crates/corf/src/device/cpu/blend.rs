//! Alpha blending of one tile, front to back, and its gradient.
//!
//! Images live tile by tile: `[tile][channel][AREA]`. A tile is one unit of parallel work and owns its part of every buffer, so nothing
//! is shared and nothing is atomic. The gradient walks front to back like the forward pass and recomputes the same weights bit by
//! bit; what lies behind Gaussian i follows from the finished image.

use super::project::{Splat, TILE_HEIGHT, TILE_WIDTH};
use crate::simd::{Kernel, Lanes};

/// Pixels per tile.
pub(crate) const AREA: usize = TILE_WIDTH * TILE_HEIGHT;
/// A pixel ends when less than this remains.
const MIN_TRANSMITTANCE: f32 = 1e-4;
/// No Gaussian hides more than this.
const MAX_ALPHA: f32 = 0.999;
/// Number of Gaussians blended between two checks for early termination of the tile's pixels.
const BATCH: usize = 16;

/// Groups of lanes in a tile, at most (eight lanes a group).
const GROUPS: usize = AREA / 8;

/// Pixel centres within a tile's first group of lanes, columns and rows; every further group lies `WIDTH / TILE_WIDTH` rows below the last.
static PIXEL_X: [f32; 16] = {
    let mut out = [0.0; 16];
    let mut i = 0;
    while i < 16 {
        out[i] = (i % TILE_WIDTH) as f32 + 0.5;
        i += 1;
    }
    out
};
static PIXEL_Y: [f32; 16] = {
    let mut out = [0.0; 16];
    let mut i = 0;
    while i < 16 {
        out[i] = (i / TILE_WIDTH) as f32 + 0.5;
        i += 1;
    }
    out
};

/// A tile of an image with the list of Gaussians that reach it, near to far.
#[derive(Clone, Copy)]
pub(crate) struct Tile<'a> {
    /// Corner, pixels.
    pub x: usize,
    pub y: usize,
    /// Size of the image.
    pub width: usize,
    pub height: usize,
    pub list: &'a [u32],
    pub splats: &'a [Splat],
}

impl Tile<'_> {
    /// 1 inside the image, 0 beyond its border: such pixels have ended before they begin.
    #[inline(always)]
    fn initial_transmittance<L: Lanes>(&self) -> [L; GROUPS] {
        let mut out = [0.0; AREA];
        for (i, t) in out.iter_mut().enumerate() {
            if self.x + i % TILE_WIDTH < self.width && self.y + i / TILE_WIDTH < self.height {
                *t = 1.0;
            }
        }
        grouped(&out)
    }

    /// The groups of lanes whose rows the splat reaches.
    #[inline(always)]
    fn groups<L: Lanes>(&self, s: &Splat) -> std::ops::Range<usize> {
        let v = s.v - self.y as f32;
        // Row r is reached if |v − (r + ½)| ≤ half_height.
        let first = (v - s.half_height - 0.5).ceil().max(0.0) as usize;
        let end = ((v + s.half_height + 0.5).floor().max(0.0) as usize).min(TILE_HEIGHT);
        (first * TILE_WIDTH / L::WIDTH)..(end * TILE_WIDTH).div_ceil(L::WIDTH)
    }
}

/// A tile's numbers, group by group.
#[inline(always)]
fn grouped<L: Lanes>(pixels: &[f32; AREA]) -> [L; GROUPS] {
    let mut out = [L::splat(0.0); GROUPS];
    for (out, pixels) in out.iter_mut().zip(pixels.chunks_exact(L::WIDTH)) {
        *out = L::load(pixels);
    }
    out
}

/// Whether a pixel is left that has not ended.
#[inline(always)]
fn any_open<L: Lanes>(t: &[L; GROUPS]) -> bool {
    let still = L::splat(MIN_TRANSMITTANCE);
    t.iter().take(AREA / L::WIDTH).any(|t| L::any(t.ge(still)))
}

/// One splat on its way down a tile, group by group. A group holds whole rows, so that dx is the same in all of them and
/// −σ log₂e = (yy·dy + xy·dx)·dy + xx·dx² costs two multiplications a group.
struct Walk<L> {
    /// mean − pixel, of the group at hand.
    dx: L,
    dy: L,
    rows: L,
    /// xx·dx² and xy·dx.
    constant: L,
    linear: L,
    quadratic: L,
    cutoff: L,
    opacity: L,
}

impl<L: Lanes> Walk<L> {
    /// Before the first group.
    #[inline(always)]
    fn new(tile: &Tile<'_>, s: &Splat, first: usize) -> Self {
        let rows = (L::WIDTH / TILE_WIDTH) as f32;
        let dx = L::splat(s.u - tile.x as f32) - L::load(&PIXEL_X);
        let dy = L::splat(s.v - tile.y as f32 - (first as f32 - 1.0) * rows) - L::load(&PIXEL_Y);
        let linear = L::splat(s.power_xy) * dx;
        Self {
            dx,
            dy,
            rows: L::splat(rows),
            constant: L::splat(s.power_xx) * dx * dx,
            linear,
            quadratic: L::splat(s.power_yy),
            cutoff: L::splat(s.least_power),
            opacity: L::splat(s.opacity),
        }
    }

    /// The exponent on the next group's pixels, and which of them it reaches with a blending weight that is drawn.
    #[inline(always)]
    fn next(&mut self) -> (L, L::Mask) {
        self.dy = self.dy - self.rows;
        let power = self.quadratic.mul_add(self.dy, self.linear).mul_add(self.dy, self.constant);
        (power, power.ge(self.cutoff))
    }

    /// o·ρ·exp(−σ) of pixels that are reached; elsewhere it means nothing.
    #[inline(always)]
    fn alpha(&self, power: L) -> L {
        // σ ≥ 0, whatever rounding made of a conic that is nearly singular.
        self.opacity * power.min(L::splat(0.0)).exp2_in_range()
    }
}

/// Blends a tile: colour with background, inverse depth, transmittance.
pub(crate) struct Forward<'a, const C: usize, const DEPTH: bool> {
    pub tile: Tile<'a>,
    pub background: [f32; 3],
    /// C·AREA.
    pub color: &'a mut [f32],
    /// AREA; left alone unless DEPTH.
    pub inverse_depth: &'a mut [f32],
    /// AREA.
    pub transmittance: &'a mut [f32],
}

impl<const C: usize, const DEPTH: bool> Kernel for Forward<'_, C, DEPTH> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (zero, most, still) = (L::splat(0.0), L::splat(MAX_ALPHA), L::splat(MIN_TRANSMITTANCE));
        let mut t = self.tile.initial_transmittance::<L>();
        let mut color = [[zero; GROUPS]; C];
        let mut depth = [zero; GROUPS];
        for batch in self.tile.list.chunks(BATCH) {
            for &name in batch {
                let s = &self.tile.splats[name as usize];
                let groups = self.tile.groups::<L>(s);
                let mut walk = Walk::<L>::new(&self.tile, s, groups.start);
                for group in groups {
                    let (power, reached) = walk.next();
                    let before = t[group];
                    let drawn = L::and(reached, before.ge(still));
                    if !L::any(drawn) {
                        continue;
                    }
                    let alpha = L::select(drawn, walk.alpha(power).min(most), zero);
                    let weight = alpha * before;
                    t[group] = before - weight;
                    for c in 0..C {
                        color[c][group] = weight.mul_add(L::splat(s.color[c]), color[c][group]);
                    }
                    if DEPTH {
                        depth[group] = weight.mul_add(L::splat(s.inverse_z), depth[group]);
                    }
                }
            }
            if !any_open(&t) {
                break;
            }
        }
        for group in 0..AREA / L::WIDTH {
            let at = group * L::WIDTH;
            for c in 0..C {
                let behind = t[group] * L::splat(self.background[c]);
                (color[c][group] + behind).store(&mut self.color[c * AREA + at..]);
            }
            if DEPTH {
                depth[group].store(&mut self.inverse_depth[at..]);
            }
            t[group].store(&mut self.transmittance[at..]);
        }
    }
}

/// Gradients of one Gaussian from one tile: dL/dcolour (3), dL/d(1/z), dL/d(oρ), Σ dL/dσ (dx², dx dy, dy²), Σ dL/dσ (dx, dy).
pub(crate) type Record = [f32; 12];
pub(crate) const COLOR: usize = 0;
pub(crate) const INVERSE_Z: usize = 3;
pub(crate) const OPACITY: usize = 4;
pub(crate) const MOMENTS: usize = 5;
pub(crate) const FIRST: usize = 8;

/// Differentiates a tile.
pub(crate) struct Backward<'a, const C: usize, const DEPTH: bool> {
    pub tile: Tile<'a>,
    /// The finished image with its background, C·AREA.
    pub color: &'a [f32],
    pub inverse_depth: &'a [f32],
    /// dL/dimage, row by row: `[channel][row][stride]`.
    pub color_gradient: &'a [f32],
    /// dL/d(inverse depth), `[row][stride]`; read only if DEPTH.
    pub depth_gradient: &'a [f32],
    pub stride: usize,
    /// One per list entry; all are written.
    pub records: &'a mut [Record],
}

impl<const C: usize, const DEPTH: bool> Backward<'_, C, DEPTH> {
    /// A tile's part of a row-major gradient plane; zero beyond the border.
    #[inline(always)]
    fn tile_of(&self, plane: &[f32]) -> [f32; AREA] {
        let mut out = [0.0; AREA];
        let columns = TILE_WIDTH.min(self.tile.width - self.tile.x);
        for row in 0..TILE_HEIGHT.min(self.tile.height - self.tile.y) {
            let at = (self.tile.y + row) * self.stride + self.tile.x;
            out[row * TILE_WIDTH..row * TILE_WIDTH + columns].copy_from_slice(&plane[at..at + columns]);
        }
        out
    }
}

impl<const C: usize, const DEPTH: bool> Kernel for Backward<'_, C, DEPTH> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let plane = self.stride * self.tile.height;
        let mut g_color = [[L::splat(0.0); GROUPS]; C];
        // g·(what is composited from here on, background included): per pixel, one number.
        let mut behind = [0.0_f32; AREA];
        for c in 0..C {
            let g = self.tile_of(&self.color_gradient[c * plane..(c + 1) * plane]);
            for i in 0..AREA {
                behind[i] += g[i] * self.color[c * AREA + i];
            }
            g_color[c] = grouped(&g);
        }
        let mut g_depth = [L::splat(0.0); GROUPS];
        if DEPTH {
            let g = self.tile_of(self.depth_gradient);
            for i in 0..AREA {
                behind[i] += g[i] * self.inverse_depth[i];
            }
            g_depth = grouped(&g);
        }
        let mut behind = grouped::<L>(&behind);
        let mut t = self.tile.initial_transmittance::<L>();
        let (still, zero, one) = (L::splat(MIN_TRANSMITTANCE), L::splat(0.0), L::splat(1.0));
        let most = L::splat(MAX_ALPHA);
        let mut done = 0;
        for batch in self.tile.list.chunks(BATCH) {
            for &name in batch {
                let s = &self.tile.splats[name as usize];
                let groups = self.tile.groups::<L>(s);
                let mut walk = Walk::<L>::new(&self.tile, s, groups.start);
                let mut d_color = [zero; C];
                let mut d_inverse_z = zero;
                // Σ dL/dσ (1, dy, dy²); dx is the same in every group.
                let (mut sum, mut sum_y, mut sum_yy) = (zero, zero, zero);
                for group in groups {
                    let (power, reached) = walk.next();
                    let before = t[group];
                    let drawn = L::and(reached, before.ge(still));
                    if !L::any(drawn) {
                        continue;
                    }
                    let free = walk.alpha(power);
                    let alpha = L::select(drawn, free.min(most), zero);
                    let weight = alpha * before;
                    t[group] = before - weight;
                    let mut shade = zero;
                    for c in 0..C {
                        let g = g_color[c][group];
                        shade = g.mul_add(L::splat(s.color[c]), shade);
                        d_color[c] = weight.mul_add(g, d_color[c]);
                    }
                    if DEPTH {
                        let g = g_depth[group];
                        shade = g.mul_add(L::splat(s.inverse_z), shade);
                        d_inverse_z = weight.mul_add(g, d_inverse_z);
                    }
                    // dL/dα = T c·g − R·g / (1 − α), with R behind this Gaussian.
                    let lit = weight * shade;
                    let rest = behind[group] - lit;
                    behind[group] = rest;
                    // dL/dσ = −α dL/dα where the cap does not hold it.
                    let d_sigma = L::select(most.gt(free), alpha * rest / (one - alpha) - lit, zero);
                    sum = sum + d_sigma;
                    let g_y = d_sigma * walk.dy;
                    sum_y = sum_y + g_y;
                    sum_yy = g_y.mul_add(walk.dy, sum_yy);
                }
                let [r, g, b] = if C == 3 { [d_color[0], d_color[C / 2], d_color[C - 1]] } else { [d_color[0], zero, zero] };
                let record = &mut self.records[done];
                let sum_x = sum * walk.dx;
                record[..4].copy_from_slice(&L::sum4([r, g, b, d_inverse_z]));
                record[4..8].copy_from_slice(&L::sum4([sum, sum_x * walk.dx, sum_y * walk.dx, sum_yy]));
                record[8..].copy_from_slice(&L::sum4([sum_x, sum_y, zero, zero]));
                // α = oρ·G: Σ G dL/dα = −Σ dL/dσ / (oρ).
                record[OPACITY] = -record[OPACITY] / s.opacity;
                done += 1;
            }
            if !any_open(&t) {
                break;
            }
        }
        self.records[done..].fill([0.0; 12]);
    }
}

/// Finds, per pixel, the list entry of the largest blending weight α·T.
pub(crate) struct MainContributor<'a> {
    pub tile: Tile<'a>,
    /// AREA names as in the tile's list; `u32::MAX` where nothing is drawn.
    pub out: &'a mut [u32],
}

impl Kernel for MainContributor<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (zero, still) = (L::splat(0.0), L::splat(MIN_TRANSMITTANCE));
        let mut t = self.tile.initial_transmittance::<L>();
        let mut best = [zero; GROUPS];
        // Names travel through lanes as the bits of an f32; they are only selected, never computed with.
        let mut names = [L::splat(f32::from_bits(u32::MAX)); GROUPS];
        for &name in self.tile.list {
            let s = &self.tile.splats[name as usize];
            let groups = self.tile.groups::<L>(s);
            let mut walk = Walk::<L>::new(&self.tile, s, groups.start);
            for group in groups {
                let (power, reached) = walk.next();
                let before = t[group];
                let drawn = L::and(reached, before.ge(still));
                let weight = L::select(drawn, walk.alpha(power).min(L::splat(MAX_ALPHA)), zero) * before;
                t[group] = before - weight;
                let more = weight.gt(best[group]);
                best[group] = L::select(more, weight, best[group]);
                names[group] = L::select(more, L::splat(f32::from_bits(name)), names[group]);
            }
        }
        let mut bits = [0.0_f32; AREA];
        for (bits, names) in bits.chunks_exact_mut(L::WIDTH).zip(names) {
            names.store(bits);
        }
        for (out, name) in self.out.iter_mut().zip(bits) {
            *out = name.to_bits();
        }
    }
}
