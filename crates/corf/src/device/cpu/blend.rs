//! Alpha blending of one tile, front to back, and its gradient.
//!
//! Images live tile by tile: `[tile][channel][AREA]`. A tile is one unit of parallel work and owns its part of every buffer, so nothing
//! is shared and nothing is atomic. The gradient walks front to back like the forward pass and recomputes the same weights bit by
//! bit; what lies behind Gaussian i follows from the finished image.

use super::{
    project::{MIN_ALPHA, Splat, TILE_HEIGHT, TILE_WIDTH},
    simd::{Kernel, Lanes},
};

/// Pixels per tile.
pub(crate) const AREA: usize = TILE_WIDTH * TILE_HEIGHT;
/// A pixel ends when less than this remains.
const MIN_TRANSMITTANCE: f32 = 1e-4;
/// No Gaussian hides more than this.
const MAX_ALPHA: f32 = 0.999;
/// How many Gaussians are blended between two looks at whether all pixels have ended.
const BATCH: usize = 16;

/// Pixel centres within a tile.
static PIXEL_X: [f32; AREA] = {
    let mut out = [0.0; AREA];
    let mut i = 0;
    while i < AREA {
        out[i] = (i % TILE_WIDTH) as f32 + 0.5;
        i += 1;
    }
    out
};
static PIXEL_Y: [f32; AREA] = {
    let mut out = [0.0; AREA];
    let mut i = 0;
    while i < AREA {
        out[i] = (i / TILE_WIDTH) as f32 + 0.5;
        i += 1;
    }
    out
};

/// Where a tile lies, and which Gaussians reach it, near to far.
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
    fn initial_transmittance(&self) -> [f32; AREA] {
        let mut out = [0.0; AREA];
        for (i, t) in out.iter_mut().enumerate() {
            if self.x + i % TILE_WIDTH < self.width && self.y + i / TILE_WIDTH < self.height {
                *t = 1.0;
            }
        }
        out
    }

    /// The groups of `width` pixels whose rows the splat reaches.
    #[inline(always)]
    fn groups(&self, s: &Splat, width: usize) -> std::ops::Range<usize> {
        let v = s.v - self.y as f32;
        // Row r is reached if |v − (r + ½)| ≤ half_height.
        let first = (v - s.half_height - 0.5).ceil().max(0.0) as usize;
        let end = ((v + s.half_height + 0.5).floor().max(0.0) as usize).min(TILE_HEIGHT);
        (first * TILE_WIDTH / width)..(end * TILE_WIDTH).div_ceil(width)
    }
}

/// exp(−σ) over one group of pixels.
#[inline(always)]
fn weight<L: Lanes>(power: [L; 3], dx: L, dy: L) -> L {
    (dx * (power[0] * dx + power[1] * dy) + power[2] * dy * dy).min(L::splat(0.0)).exp2()
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
        let w = L::WIDTH;
        let mut t = self.tile.initial_transmittance();
        let mut color = [[0.0_f32; AREA]; C];
        let mut depth = [0.0_f32; AREA];
        let (least, still) = (L::splat(MIN_ALPHA), L::splat(MIN_TRANSMITTANCE));
        for batch in self.tile.list.chunks(BATCH) {
            for &name in batch {
                let s = &self.tile.splats[name as usize];
                let power = [L::splat(s.power_xx), L::splat(s.power_xy), L::splat(s.power_yy)];
                let u = L::splat(s.u - self.tile.x as f32);
                let v = L::splat(s.v - self.tile.y as f32);
                let opacity = L::splat(s.opacity);
                for group in self.tile.groups(s, w) {
                    let at = group * w;
                    let (dx, dy) = (u - L::load(&PIXEL_X[at..at + w]), v - L::load(&PIXEL_Y[at..at + w]));
                    let alpha = (opacity * weight(power, dx, dy)).min(L::splat(MAX_ALPHA));
                    let before = L::load(&t[at..at + w]);
                    let drawn = L::and(alpha.ge(least), before.ge(still));
                    if !L::any(drawn) {
                        continue;
                    }
                    let alpha = L::select(drawn, alpha, L::splat(0.0));
                    let weight = alpha * before;
                    (before - weight).store(&mut t[at..at + w]);
                    for c in 0..C {
                        let sum = &mut color[c][at..at + w];
                        weight.mul_add(L::splat(s.color[c]), L::load(sum)).store(sum);
                    }
                    if DEPTH {
                        let sum = &mut depth[at..at + w];
                        weight.mul_add(L::splat(s.inverse_z), L::load(sum)).store(sum);
                    }
                }
            }
            let mut open = false;
            for at in (0..AREA).step_by(w) {
                open |= L::any(L::load(&t[at..at + w]).ge(still));
            }
            if !open {
                break;
            }
        }
        for c in 0..C {
            for i in 0..AREA {
                self.color[c * AREA + i] = color[c][i] + t[i] * self.background[c];
            }
        }
        if DEPTH {
            self.inverse_depth.copy_from_slice(&depth);
        }
        self.transmittance.copy_from_slice(&t);
    }
}

/// What a tile says about one of its Gaussians: dL/dcolour (3), dL/d(1/z), dL/d(oρ), Σ dL/dσ (dx², dx dy, dy²), Σ dL/dσ (dx, dy).
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
        let w = L::WIDTH;
        let mut t = self.tile.initial_transmittance();
        let plane = self.stride * self.tile.height;
        let mut g_color = [[0.0_f32; AREA]; C];
        // g·(what is composited from here on, background included): per pixel, one number.
        let mut behind = [0.0_f32; AREA];
        for c in 0..C {
            g_color[c] = self.tile_of(&self.color_gradient[c * plane..(c + 1) * plane]);
            for i in 0..AREA {
                behind[i] += g_color[c][i] * self.color[c * AREA + i];
            }
        }
        let mut g_depth = [0.0_f32; AREA];
        if DEPTH {
            g_depth = self.tile_of(self.depth_gradient);
            for i in 0..AREA {
                behind[i] += g_depth[i] * self.inverse_depth[i];
            }
        }
        let (least, still, zero, one) = (L::splat(MIN_ALPHA), L::splat(MIN_TRANSMITTANCE), L::splat(0.0), L::splat(1.0));
        let most = L::splat(MAX_ALPHA);
        let mut done = 0;
        for batch in self.tile.list.chunks(BATCH) {
            for &name in batch {
                let s = &self.tile.splats[name as usize];
                let power = [L::splat(s.power_xx), L::splat(s.power_xy), L::splat(s.power_yy)];
                let u = L::splat(s.u - self.tile.x as f32);
                let v = L::splat(s.v - self.tile.y as f32);
                let opacity = L::splat(s.opacity);
                let mut d_color = [zero; C];
                let mut d_inverse_z = zero;
                let mut sum = zero;
                let (mut sum_x, mut sum_y) = (zero, zero);
                let (mut sum_xx, mut sum_xy, mut sum_yy) = (zero, zero, zero);
                for group in self.tile.groups(s, w) {
                    let at = group * w;
                    let (dx, dy) = (u - L::load(&PIXEL_X[at..at + w]), v - L::load(&PIXEL_Y[at..at + w]));
                    let free = opacity * weight(power, dx, dy);
                    let alpha = free.min(most);
                    let before = L::load(&t[at..at + w]);
                    let drawn = L::and(alpha.ge(least), before.ge(still));
                    if !L::any(drawn) {
                        continue;
                    }
                    let alpha = L::select(drawn, alpha, zero);
                    let weight = alpha * before;
                    (before - weight).store(&mut t[at..at + w]);
                    let mut shade = zero;
                    for c in 0..C {
                        let g = L::load(&g_color[c][at..at + w]);
                        shade = g.mul_add(L::splat(s.color[c]), shade);
                        d_color[c] = weight.mul_add(g, d_color[c]);
                    }
                    if DEPTH {
                        let g = L::load(&g_depth[at..at + w]);
                        shade = g.mul_add(L::splat(s.inverse_z), shade);
                        d_inverse_z = weight.mul_add(g, d_inverse_z);
                    }
                    // dL/dα = T c·g − R·g / (1 − α), with R behind this Gaussian.
                    let rest = L::load(&behind[at..at + w]) - weight * shade;
                    rest.store(&mut behind[at..at + w]);
                    let d_alpha = before * shade - rest / (one - alpha);
                    // dL/dσ = −α dL/dα where the cap does not hold it.
                    let d_sigma = L::select(most.gt(free), -(alpha * d_alpha), zero);
                    sum = sum + d_sigma;
                    let (gx, gy) = (d_sigma * dx, d_sigma * dy);
                    sum_x = sum_x + gx;
                    sum_y = sum_y + gy;
                    sum_xx = gx.mul_add(dx, sum_xx);
                    sum_xy = gx.mul_add(dy, sum_xy);
                    sum_yy = gy.mul_add(dy, sum_yy);
                }
                let [r, g, b] = if C == 3 { [d_color[0], d_color[C / 2], d_color[C - 1]] } else { [d_color[0], zero, zero] };
                let record = &mut self.records[done];
                record[..4].copy_from_slice(&L::sum4([r, g, b, d_inverse_z]));
                record[4..8].copy_from_slice(&L::sum4([sum, sum_xx, sum_xy, sum_yy]));
                record[8..].copy_from_slice(&L::sum4([sum_x, sum_y, zero, zero]));
                // α = oρ·G: Σ G dL/dα = −Σ dL/dσ / (oρ).
                record[OPACITY] = -record[OPACITY] / s.opacity;
                done += 1;
            }
            let mut open = false;
            for at in (0..AREA).step_by(w) {
                open |= L::any(L::load(&t[at..at + w]).ge(still));
            }
            if !open {
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
        let w = L::WIDTH;
        let mut t = self.tile.initial_transmittance();
        let mut best = [0.0_f32; AREA];
        // Names travel through lanes as the bits of an f32; they are only selected, never computed with.
        let mut names = [f32::from_bits(u32::MAX); AREA];
        let (least, still) = (L::splat(MIN_ALPHA), L::splat(MIN_TRANSMITTANCE));
        for &name in self.tile.list {
            let s = &self.tile.splats[name as usize];
            let power = [L::splat(s.power_xx), L::splat(s.power_xy), L::splat(s.power_yy)];
            let u = L::splat(s.u - self.tile.x as f32);
            let v = L::splat(s.v - self.tile.y as f32);
            for group in self.tile.groups(s, w) {
                let at = group * w;
                let (dx, dy) = (u - L::load(&PIXEL_X[at..at + w]), v - L::load(&PIXEL_Y[at..at + w]));
                let alpha = (L::splat(s.opacity) * weight(power, dx, dy)).min(L::splat(MAX_ALPHA));
                let before = L::load(&t[at..at + w]);
                let drawn = L::and(alpha.ge(least), before.ge(still));
                let weight = L::select(drawn, alpha, L::splat(0.0)) * before;
                (before - weight).store(&mut t[at..at + w]);
                let largest = L::load(&best[at..at + w]);
                let more = weight.gt(largest);
                L::select(more, weight, largest).store(&mut best[at..at + w]);
                L::select(more, L::splat(f32::from_bits(name)), L::load(&names[at..at + w])).store(&mut names[at..at + w]);
            }
        }
        for (out, name) in self.out.iter_mut().zip(names) {
            *out = name.to_bits();
        }
    }
}
