//! Projection of the visible Gaussians to ellipses with opacity and colour, and the tiles that each ellipse reaches.

use super::{
    geometry::{Grid, Scene, ellipse_of, shape_of, to_camera},
    store::{Core, Harmonics, LIGHT_OPACITY, LOG_SCALE, POSITION, ROTATION, Store},
};
use crate::gaussians::harmonics;
use crate::simd::{Isa, Kernel, Lanes};
use rayon::prelude::*;

/// Gaussians per unit of parallel work; fixed, so that results do not depend on the number of threads.
pub(crate) const CHUNK: usize = 256;
/// Tiles are this many pixels wide and high. Rows a Gaussian does not reach are skipped, so a tall tile wastes no more than a short one
/// and needs fewer lists; a wide one would.
pub(crate) const TILE_WIDTH: usize = 8;
pub(crate) const TILE_HEIGHT: usize = 16;
/// τ = ln(255·o·ρ) bounds σ; the margin covers the rounding of our logarithm and of σ itself.
const TAU_MARGIN: f32 = 1e-3;
/// Widest σ at which opacity 1 still gives 1/255: sqrt(2 ln 255) standard deviations.
const MAX_DEVIATIONS: f32 = 3.33;

/// One Gaussian in one image: 64 bytes, one cache line.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(crate) struct Splat {
    /// Mean, pixels.
    pub u: f32,
    pub v: f32,
    /// −½ log₂e Q_xx, −log₂e Q_xy, −½ log₂e Q_yy: exp(−σ) = 2^(…).
    pub power_xx: f32,
    pub power_xy: f32,
    pub power_yy: f32,
    /// o·ρ.
    pub opacity: f32,
    /// 1/z, 1/m.
    pub inverse_z: f32,
    /// Colour, clamped at 0.
    pub color: [f32; 3],
    /// Half extent in y where the weight falls to 1/255, pixels.
    pub half_height: f32,
    /// log₂(1/255 / oρ): where the exponent is below this, the weight is below 1/255 and not drawn.
    pub least_power: f32,
    pub padding: [f32; 4],
}

/// The tiles a chunk's Gaussians reach in one image.
#[derive(Default)]
pub(crate) struct TileList {
    /// End of each visible Gaussian's run in `tiles`.
    pub end: Vec<u32>,
    /// Tile numbers, row-major.
    pub tiles: Vec<u32>,
}

impl TileList {
    /// The run of a visible Gaussian.
    #[inline(always)]
    pub fn run(&self, local: usize) -> std::ops::Range<usize> {
        let start = if local == 0 { 0 } else { self.end[local - 1] as usize };
        start..self.end[local] as usize
    }
}

/// The visible Gaussians of one chunk.
#[derive(Default)]
pub(crate) struct VisibleChunk {
    /// Their numbers, ascending.
    pub ids: Vec<u32>,
    /// z, metres.
    pub depth: Vec<f32>,
    pub tiles: [TileList; 2],
}

/// The visible Gaussians of a scene; `splats[grid][chunk·CHUNK + local]` belongs to `chunks[chunk].ids[local]`.
#[derive(Default)]
pub(crate) struct Projection {
    pub chunks: Vec<VisibleChunk>,
    pub splats: [Vec<Splat>; 2],
}

impl Projection {
    /// Projects all Gaussians; memory of the previous step is used again.
    pub fn run(&mut self, isa: Isa, store: &Store, scene: &Scene, near_m: f32) {
        let chunks = store.len().div_ceil(CHUNK);
        self.chunks.resize_with(chunks, VisibleChunk::default);
        for splats in &mut self.splats {
            splats.resize(chunks * CHUNK, Splat::default());
        }
        let [light, radio] = &mut self.splats;
        self.chunks.par_iter_mut().zip(light.par_chunks_mut(CHUNK)).zip(radio.par_chunks_mut(CHUNK)).enumerate().for_each(
            |(chunk, ((visible, light), radio))| {
                isa.dispatch(ProjectChunk { store, scene, near_m, first: chunk * CHUNK, visible, splats: [light, radio] });
            },
        );
    }

    /// Number of visible Gaussians: those that reach a tile of any image.
    pub fn visible(&self) -> usize {
        self.chunks.iter().map(|c| c.ids.len()).sum()
    }

    /// Per Gaussian of `n`, whether it reaches a tile of the optical and of the RF image.
    pub fn seen(&self, n: usize) -> Vec<[bool; 2]> {
        let mut out = vec![[false; 2]; n];
        for chunk in &self.chunks {
            for (local, id) in chunk.ids.iter().enumerate() {
                out[*id as usize] = [0, 1].map(|g| !chunk.tiles[g].run(local).is_empty());
            }
        }
        out
    }
}

struct ProjectChunk<'a> {
    store: &'a Store,
    scene: &'a Scene,
    near_m: f32,
    first: usize,
    visible: &'a mut VisibleChunk,
    splats: [&'a mut [Splat]; 2],
}

/// Half extent in pixels per (standard deviation / z): |row of J| ≤ f/z · sqrt(1 + x̂²) with |x̂| at most the larger limit.
#[inline(always)]
fn reach(f: f32, limits: [f32; 2]) -> f32 {
    let x = limits[0].abs().max(limits[1].abs());
    MAX_DEVIATIONS * f * (1.0 + x * x).sqrt()
}

/// Component `k` of `WIDTH` Gaussians.
#[inline(always)]
pub(crate) fn gather<L: Lanes>(values: &[Core], ids: &[u32; 16], k: usize) -> L {
    let mut out = [0.0_f32; 16];
    for lane in 0..L::WIDTH {
        out[lane] = values[ids[lane] as usize][k];
    }
    L::load(&out)
}

#[inline(always)]
pub(crate) fn gather3<L: Lanes>(values: &[Core], ids: &[u32; 16], k: usize) -> [L; 3] {
    [gather(values, ids, k), gather(values, ids, k + 1), gather(values, ids, k + 2)]
}

#[inline(always)]
pub(crate) fn gather4<L: Lanes>(values: &[Core], ids: &[u32; 16], k: usize) -> [L; 4] {
    [gather(values, ids, k), gather(values, ids, k + 1), gather(values, ids, k + 2), gather(values, ids, k + 3)]
}

/// `N` numbers of each lane, each as an array.
#[inline(always)]
fn spill<L: Lanes, const N: usize>(lanes: [L; N]) -> [[f32; 16]; N] {
    let mut out = [[0.0; 16]; N];
    for k in 0..N {
        lanes[k].store(&mut out[k]);
    }
    out
}

impl Kernel for ProjectChunk<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        self.visible.ids.clear();
        self.visible.depth.clear();
        for list in &mut self.visible.tiles {
            list.end.clear();
            list.tiles.clear();
        }
        let mut candidates = [0_u32; CHUNK + 16];
        let count = self.cull::<L>(&mut candidates);
        let mut at = 0;
        while at < count {
            let lanes = L::WIDTH.min(count - at);
            let mut ids = [candidates[at]; 16];
            ids[..lanes].copy_from_slice(&candidates[at..at + lanes]);
            self.project::<L>(&ids, lanes);
            at += lanes;
        }
    }
}

impl ProjectChunk<'_> {
    /// A cheap, generous test against the near plane and the borders of the images; the exact one is in [`emit_tiles`].
    #[inline(always)]
    fn cull<L: Lanes>(&self, out: &mut [u32; CHUNK + 16]) -> usize {
        let values = &self.store.value;
        let last = (self.first + CHUNK).min(values.len());
        let mut count = 0;
        let mut at = self.first;
        while at < last {
            let lanes = L::WIDTH.min(last - at);
            let mut ids = [at as u32; 16];
            for lane in 0..lanes {
                ids[lane] = (at + lane) as u32;
            }
            let p = to_camera(&self.scene.pose, gather3::<L>(values, &ids, POSITION));
            let [a, b, c] = gather3::<L>(values, &ids, LOG_SCALE);
            let largest = a.max(b).max(c).exp();
            let inverse_z = L::splat(1.0) / p[2];
            let (x, y) = (p[0] * inverse_z, p[1] * inverse_z);
            let in_front = L::select(p[2].gt(L::splat(self.near_m)), L::splat(1.0), L::splat(0.0));
            let mut keep = L::splat(0.0);
            for grid in self.scene.grids.iter().flatten() {
                let size = largest * inverse_z;
                let border = L::splat(MAX_DEVIATIONS * grid.antialias.dilation().sqrt());
                let rx = L::splat(reach(grid.fx, grid.x_limits)).mul_add(size, border);
                let ry = L::splat(reach(grid.fy, grid.y_limits)).mul_add(size, border);
                let u = L::splat(grid.fx).mul_add(x, L::splat(grid.cx));
                let v = L::splat(grid.fy).mul_add(y, L::splat(grid.cy));
                let zero = L::splat(0.0);
                let inside = L::and(
                    L::and((u + rx).gt(zero), L::splat(grid.width as f32).gt(u - rx)),
                    L::and((v + ry).gt(zero), L::splat(grid.height as f32).gt(v - ry)),
                );
                keep = L::select(inside, in_front, keep);
            }
            let mut flags = [0.0_f32; 16];
            keep.store(&mut flags);
            for lane in 0..lanes {
                out[count] = ids[lane];
                count += usize::from(flags[lane] > 0.0);
            }
            at += lanes;
        }
        count
    }

    #[inline(always)]
    fn project<L: Lanes>(&mut self, ids: &[u32; 16], lanes: usize) {
        let values = &self.store.value;
        let p = to_camera(&self.scene.pose, gather3::<L>(values, ids, POSITION));
        let s = shape_of(&self.scene.pose, gather4::<L>(values, ids, ROTATION), gather3(values, ids, LOG_SCALE));
        let one = L::splat(1.0);
        let mut images = [[[0.0_f32; 16]; 13]; 2];
        for (g, grid) in self.scene.grids.iter().enumerate() {
            let Some(grid) = grid else { continue };
            let e = ellipse_of(grid, p, &s);
            let inverse = one / e.determinant;
            let (qa, qb, qc) = (e.syy * inverse, -(e.bare[1] * inverse), e.sxx * inverse);
            let opacity = e.rho / (one + (-gather::<L>(values, ids, LIGHT_OPACITY + g)).exp());
            // Bound of σ: o ρ exp(−σ) ≥ 1/255.
            let tau = (opacity * L::splat(255.0)).max(L::splat(1e-30)).ln() + L::splat(TAU_MARGIN);
            let width = (L::splat(2.0) * tau * e.sxx).max(L::splat(0.0)).sqrt();
            let height = (L::splat(2.0) * tau * e.syy).max(L::splat(0.0)).sqrt();
            let valid = L::and(e.determinant.gt(L::splat(0.0)), tau.gt(L::splat(0.0)));
            let tau = L::select(valid, tau, L::splat(-1.0));
            images[g] = spill([e.u, e.v, qa, qb, qc, opacity, e.inverse_z, tau, width, height, p[2], one, inverse]);
        }
        for lane in 0..lanes {
            let id = ids[lane];
            let local = self.visible.ids.len();
            let mut seen = false;
            let mut depth = 0.0;
            for (g, grid) in self.scene.grids.iter().enumerate() {
                let list = &mut self.visible.tiles[g];
                let before = list.tiles.len();
                if let Some(grid) = grid {
                    let i = &images[g];
                    let [u, v, qa, qb, qc] = [i[0][lane], i[1][lane], i[2][lane], i[3][lane], i[4][lane]];
                    let conic = [qa, qb, qc, i[12][lane]];
                    depth = i[10][lane];
                    if emit_tiles(grid, [u, v], conic, i[7][lane], [i[8][lane], i[9][lane]], &mut list.tiles) {
                        const LOG2E: f32 = std::f32::consts::LOG2_E;
                        let harmonics = &self.store.harmonics[g];
                        let core = &values[id as usize];
                        self.splats[g][local] = Splat {
                            u,
                            v,
                            power_xx: -0.5 * LOG2E * qa,
                            power_xy: -LOG2E * qb,
                            power_yy: -0.5 * LOG2E * qc,
                            opacity: i[5][lane],
                            inverse_z: i[6][lane],
                            color: color(harmonics, id as usize, direction_of(core, &self.scene.pose.eye).0),
                            half_height: i[9][lane],
                            least_power: -LOG2E * (i[7][lane] - TAU_MARGIN),
                            padding: [0.0; 4],
                        };
                    }
                }
                seen |= list.tiles.len() > before;
            }
            if seen {
                self.visible.ids.push(id);
                self.visible.depth.push(depth);
                for list in &mut self.visible.tiles {
                    list.end.push(list.tiles.len() as u32);
                }
            }
        }
    }
}

/// The unit vector from the camera to a Gaussian, world axes, and 1 / distance.
#[inline(always)]
pub(crate) fn direction_of(core: &Core, eye: &[f32; 3]) -> ([f32; 3], f32) {
    let d = [core[0] - eye[0], core[1] - eye[1], core[2] - eye[2]];
    let inverse = 1.0 / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt().max(1e-12);
    ([d[0] * inverse, d[1] * inverse, d[2] * inverse], inverse)
}

/// max(0, 0.5 + Σ_k sh_k Y_k(d)) per channel.
#[inline(always)]
fn color(h: &Harmonics, id: usize, d: [f32; 3]) -> [f32; 3] {
    match h.degree {
        0 => color_of::<1>(h, id, d),
        1 => color_of::<4>(h, id, d),
        2 => color_of::<9>(h, id, d),
        _ => color_of::<16>(h, id, d),
    }
}

#[inline(always)]
fn color_of<const K: usize>(h: &Harmonics, id: usize, d: [f32; 3]) -> [f32; 3] {
    let y = harmonics::basis_of::<K>(d);
    let mut out = [0.0; 3];
    let sh = &h.value[id * K * h.channels..(id + 1) * K * h.channels];
    for (channel, sh) in sh.chunks_exact(K).enumerate() {
        let mut part = [0.0_f32; 4];
        for k in 0..K {
            part[k % 4] += sh[k] * y[k];
        }
        out[channel] = (0.5 + ((part[0] + part[1]) + (part[2] + part[3]))).max(0.0);
    }
    out
}

/// Appends the tiles in which some point has σ ≤ τ, row by row; false if there is none. `q` is Q's xx, xy, yy and its determinant, which these would
/// not give of a thin ellipse.
#[inline(always)]
fn emit_tiles(grid: &Grid, [u, v]: [f32; 2], q: [f32; 4], tau: f32, [width, height]: [f32; 2], out: &mut Vec<u32>) -> bool {
    /// Farther than this from the image nothing is drawn; keeps conversions to integers exact.
    const FAR: f32 = 1e6;
    // Written so that NaN leaves.
    if !(tau > 0.0 && u.abs() < FAR && v.abs() < FAR && width < FAR && height < FAR) {
        return false;
    }
    let (columns, rows) = (grid.width.div_ceil(TILE_WIDTH) as i32, grid.height.div_ceil(TILE_HEIGHT) as i32);
    let before = out.len();
    let (y0, y1) = span(v - height, v + height, TILE_HEIGHT, rows);
    let (x0, x1) = span(u - width, u + width, TILE_WIDTH, columns);
    if y0 == y1 && x0 >= x1 {
        // Most splats of a small image: the box says all.
        if x0 == x1 {
            out.push((y0 * columns + x0) as u32);
        }
        return out.len() > before;
    }
    let [qa, qb, qc, determinant] = q;
    let (slope, inverse_a) = (-qb / qa, 1.0 / qa);
    // Height, relative to the mean, at which the ellipse reaches farthest to the right; to the left it is the opposite.
    let rightmost = -qb / qc * width;
    for ty in y0..=y1 {
        // The ellipse between the first and the last pixel row of the tiles is convex: it meets a tile if its extent in x does.
        let low = (ty as f32 * TILE_HEIGHT as f32 + 0.5 - v).max(-height);
        let high = (ty as f32 * TILE_HEIGHT as f32 + (TILE_HEIGHT as f32 - 0.5) - v).min(height);
        let (right_at, left_at) = (rightmost.max(low).min(high), (-rightmost).max(low).min(high));
        // At height y the border lies at x = −(b/a) y ± sqrt(2τ a − det y²) / a.
        let right = slope * right_at + (2.0 * tau * qa - determinant * right_at * right_at).max(0.0).sqrt() * inverse_a;
        let left = slope * left_at - (2.0 * tau * qa - determinant * left_at * left_at).max(0.0).sqrt() * inverse_a;
        let (x0, x1) = span(u + left, u + right, TILE_WIDTH, columns);
        for tx in x0..=x1 {
            out.push((ty * columns + tx) as u32);
        }
    }
    out.len() > before
}

/// First and last of `count` tiles with a pixel centre in `[low, high]`; the centres of tile t span `[t·size + ½, (t+1)·size − ½]`.
#[inline(always)]
fn span(low: f32, high: f32, size: usize, count: i32) -> (i32, i32) {
    let inverse = 1.0 / size as f32;
    let first = ((low + 0.5) * inverse).ceil() as i32 - 1;
    let last = ((high - 0.5) * inverse).floor() as i32;
    (first.max(0), last.min(count - 1))
}
