//! Gauss–Newton with preconditioned conjugate gradients over some keyframes, without a matrix.

use super::{
    CpuDevice,
    blend::{AREA, Record, Tile},
    geometry::{Grid, Scene, ellipse_of, shape_of, to_camera},
    project::{CHUNK, Projection, TILE_HEIGHT, TILE_WIDTH, direction_of, gather},
    render::{Frame, tile_at},
    step::Backwards,
    store::{CORE, LIGHT_OPACITY, LOG_SCALE, POSITION, ROTATION, Store},
    tiles::tile_count,
    update::Mode,
};
use crate::gaussians::harmonics;
use crate::simd::{Kernel, Lanes, dual::Dual};
use crate::{OptimizerConfig, Result, device::Step, loss::fused::stride_of};
use corf_scene::Rng;
use rayon::prelude::*;

/// What is minimised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Objective {
    /// Mean square.
    Square,
    /// L1, held to a parabola below δ.
    Huber(f32),
    /// L1 and SSIM as Adam has them, with a curvature above theirs: L1's of `δ`.
    Image(f32),
}

/// Constants of a Gauss–Newton step.
#[derive(Clone, Copy, Debug)]
pub struct GaussNewtonConfig {
    pub objective: Objective,
    /// Conjugate-gradient iterations.
    pub iterations: usize,
    /// Decay of the preconditioner's mean between steps.
    pub memory: f32,
    /// Hutchinson probes a view and step.
    pub probes: usize,
    /// Largest change of a parameter, in Adam's rates.
    pub trust: f32,
    /// Least curvature, as a share of the mean curvature in Adam's rates.
    pub floor: f32,
    /// Whether λ follows the gain ratio.
    pub adapt: bool,
}

/// The state between steps.
pub struct GaussNewton {
    pub config: GaussNewtonConfig,
    pub lambda: f32,
    /// Mean diagonal of JᵀDJ per view.
    diagonal: Vec<f32>,
    weight: f32,
    probes_drawn: u64,
    pub accepted: usize,
    pub rejected: usize,
    pub ratio: f64,
}

impl GaussNewton {
    pub fn new(config: GaussNewtonConfig, lambda: f32) -> Self {
        Self { config, lambda, diagonal: vec![], weight: 0.0, probes_drawn: 0, accepted: 0, rejected: 0, ratio: 0.0 }
    }
}

/// A view where the field was linearised.
struct Pass {
    scene: Scene,
    step: Step,
    frame: Frame,
    /// Per image, tile-major: second derivative of the loss by a pixel.
    curvature: [Vec<f32>; 2],
    tile_weights: [Vec<f32>; 2],
}

#[derive(Clone, Copy, Default)]
struct Tangent {
    u: f32,
    v: f32,
    power: [f32; 3],
    opacity: f32,
    color: [f32; 3],
}

/// Tangents of the splats of a chunk along a direction.
struct Push<'a> {
    store: &'a Store,
    direction: &'a [f32],
    scene: &'a Scene,
    projection: &'a Projection,
    chunk: usize,
    out: [&'a mut [Tangent]; 2],
}

impl Kernel for Push<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let values = &self.store.value;
        let along: &[[f32; CORE]] = self.direction[..values.len() * CORE].as_chunks().0;
        let visible = &self.projection.chunks[self.chunk];
        let pose = &self.scene.pose;
        let mut first_of_harmonics = values.len() * CORE;
        let offsets = [0, 1].map(|g| {
            let at = first_of_harmonics;
            first_of_harmonics += self.store.harmonics[g].value.len();
            at
        });
        let mut at = 0;
        while at < visible.ids.len() {
            let lanes = L::WIDTH.min(visible.ids.len() - at);
            let mut ids = [visible.ids[at]; 16];
            ids[..lanes].copy_from_slice(&visible.ids[at..at + lanes]);
            let p = to_camera(pose, [both::<L>(values, along, &ids, POSITION), both::<L>(values, along, &ids, POSITION + 1), both::<L>(values, along, &ids, POSITION + 2)]);
            let s = shape_of(
                pose,
                [both::<L>(values, along, &ids, ROTATION), both::<L>(values, along, &ids, ROTATION + 1), both::<L>(values, along, &ids, ROTATION + 2), both::<L>(values, along, &ids, ROTATION + 3)],
                [both::<L>(values, along, &ids, LOG_SCALE), both::<L>(values, along, &ids, LOG_SCALE + 1), both::<L>(values, along, &ids, LOG_SCALE + 2)],
            );
            let one = Dual::<L>::splat(1.0);
            for (g, grid) in self.scene.grids.iter().enumerate() {
                let Some(grid) = grid else { continue };
                let e = ellipse_of(grid, p, &s);
                let inverse = one / e.determinant;
                let (qa, qb, qc) = (e.syy * inverse, -(e.bare[1] * inverse), e.sxx * inverse);
                let opacity = e.rho / (one + (-both::<L>(values, along, &ids, LIGHT_OPACITY + g)).exp());
                let mut rows = [[0.0_f32; 16]; 6];
                for (row, from) in rows.iter_mut().zip([e.u, e.v, qa, qb, qc, opacity]) {
                    from.store(row);
                }
                let h = &self.store.harmonics[g];
                let stride = h.stride();
                for lane in (0..lanes).filter(|lane| !visible.tiles[g].run(at + lane).is_empty()) {
                    const LOG2E: f32 = std::f32::consts::LOG2_E;
                    let id = ids[lane] as usize;
                    let run = id * stride..(id + 1) * stride;
                    let sh = &h.value[run.clone()];
                    let d_sh = &self.direction[offsets[g]..][run];
                    let mean = [along[id][0], along[id][1], along[id][2]];
                    let towards = direction_of(&values[id], &pose.eye);
                    let mut color = match h.degree {
                        0 => colors::<1>(sh, d_sh, towards, mean),
                        1 => colors::<4>(sh, d_sh, towards, mean),
                        2 => colors::<9>(sh, d_sh, towards, mean),
                        _ => colors::<16>(sh, d_sh, towards, mean),
                    };
                    let splat = &self.projection.splats[g][self.chunk * CHUNK + at + lane];
                    for (c, clamped) in color.iter_mut().zip(splat.color) {
                        *c = if clamped > 0.0 { *c } else { 0.0 };
                    }
                    self.out[g][at + lane] = Tangent {
                        u: rows[0][lane],
                        v: rows[1][lane],
                        power: [-0.5 * LOG2E * rows[2][lane], -LOG2E * rows[3][lane], -0.5 * LOG2E * rows[4][lane]],
                        opacity: rows[5][lane],
                        color,
                    };
                }
            }
            at += lanes;
        }
    }
}

#[inline(always)]
fn both<L: Lanes>(values: &[[f32; CORE]], along: &[[f32; CORE]], ids: &[u32; 16], k: usize) -> Dual<L> {
    Dual { value: gather::<L>(values, ids, k), tangent: gather::<L>(along, ids, k) }
}

#[inline(always)]
fn colors<const K: usize>(sh: &[f32], d_sh: &[f32], (d, inverse): ([f32; 3], f32), mean: [f32; 3]) -> [f32; 3] {
    let y = harmonics::basis_of::<K>(d);
    let along = mean[0] * d[0] + mean[1] * d[1] + mean[2] * d[2];
    let turn = [0, 1, 2].map(|k| (mean[k] - along * d[k]) * inverse);
    let mut out = [0.0; 3];
    for (c, (sh, d_sh)) in sh.chunks_exact(K).zip(d_sh.chunks_exact(K)).enumerate() {
        let mut weights = [0.0; harmonics::MAX_COEFFICIENTS];
        for k in 0..K {
            out[c] += d_sh[k] * y[k];
            weights[k] = sh[k];
        }
        if K > 1 {
            let g = harmonics::direction_gradient::<K>(d, &weights);
            out[c] += g[0] * turn[0] + g[1] * turn[1] + g[2] * turn[2];
        }
    }
    out
}

const MIN_TRANSMITTANCE: f32 = 1e-4;
const MAX_ALPHA: f32 = 0.999;
const GROUPS: usize = AREA / 8;

/// Derivative of a tile's colours along a direction.
struct BlendTangent<'a, const C: usize> {
    tile: Tile<'a>,
    tangents: &'a [Tangent],
    background: [f32; 3],
    out: &'a mut [f32],
}

impl<const C: usize> Kernel for BlendTangent<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let tile = &self.tile;
        let (zero, most, still) = (L::splat(0.0), L::splat(MAX_ALPHA), L::splat(MIN_TRANSMITTANCE));
        let mut inside = [0.0_f32; AREA];
        let (mut xs, mut ys) = ([0.0_f32; AREA], [0.0_f32; AREA]);
        for i in 0..AREA {
            let (x, y) = (i % TILE_WIDTH, i / TILE_WIDTH);
            inside[i] = if tile.x + x < tile.width && tile.y + y < tile.height { 1.0 } else { 0.0 };
            (xs[i], ys[i]) = (x as f32 + 0.5, y as f32 + 0.5);
        }
        let mut t = [zero; GROUPS];
        for (t, inside) in t.iter_mut().zip(inside.chunks_exact(L::WIDTH)) {
            *t = L::load(inside);
        }
        let mut dt = [zero; GROUPS];
        let mut color = [[zero; GROUPS]; C];
        for (k, &name) in tile.list.iter().enumerate() {
            let s = &tile.splats[name as usize];
            let d = &self.tangents[name as usize];
            let v = s.v - tile.y as f32;
            let first = (v - s.half_height - 0.5).ceil().max(0.0) as usize;
            let end = ((v + s.half_height + 0.5).floor().max(0.0) as usize).min(TILE_HEIGHT);
            let (xx, xy, yy) = (L::splat(s.power_xx), L::splat(s.power_xy), L::splat(s.power_yy));
            let (du, dv) = (L::splat(d.u), L::splat(d.v));
            let relative = L::splat(d.opacity / s.opacity);
            for group in (first * TILE_WIDTH / L::WIDTH)..(end * TILE_WIDTH).div_ceil(L::WIDTH) {
                let before = t[group];
                let dx = L::splat(s.u - tile.x as f32) - L::load(&xs[group * L::WIDTH..]);
                let dy = L::splat(v) - L::load(&ys[group * L::WIDTH..]);
                let power = yy.mul_add(dy, xy * dx).mul_add(dy, xx * dx * dx);
                let drawn = L::and(power.ge(L::splat(s.least_power)), before.ge(still));
                if !L::any(drawn) {
                    continue;
                }
                let free = L::splat(s.opacity) * power.min(zero).exp2_in_range();
                let alpha = L::select(drawn, free.min(most), zero);
                let two = L::splat(2.0);
                let d_power = L::splat(d.power[0]) * dx * dx
                    + L::splat(d.power[1]) * dx * dy
                    + L::splat(d.power[2]) * dy * dy
                    + (two * xx * dx + xy * dy) * du
                    + (two * yy * dy + xy * dx) * dv;
                let rate = d_power.mul_add(L::splat(std::f32::consts::LN_2), relative);
                let d_alpha = L::select(most.gt(free), alpha * rate, zero);
                let weight = alpha * before;
                let d_weight = d_alpha * before + alpha * dt[group];
                t[group] = before - weight;
                dt[group] = dt[group] - d_weight;
                for c in 0..C {
                    color[c][group] =
                        d_weight.mul_add(L::splat(s.color[c]), weight.mul_add(L::splat(d.color[c]), color[c][group]));
                }
            }
            if k % 16 == 15 && !t.iter().take(AREA / L::WIDTH).any(|t| L::any(t.ge(still))) {
                break;
            }
        }
        for c in 0..C {
            for group in 0..AREA / L::WIDTH {
                let behind = dt[group] * L::splat(self.background[c]);
                (color[c][group] + behind).store(&mut self.out[c * AREA + group * L::WIDTH..]);
            }
        }
    }
}

/// Calls `work(row-major place, tile-major place)` for each pixel and channel.
fn each_pixel(grid: &Grid, channels: usize, mut work: impl FnMut(usize, usize, usize)) {
    let stride = stride_of(grid.width);
    let columns = grid.width.div_ceil(TILE_WIDTH);
    for tile in 0..tile_count(grid) {
        let (x, y) = (tile % columns * TILE_WIDTH, tile / columns * TILE_HEIGHT);
        let n = TILE_WIDTH.min(grid.width - x);
        for c in 0..channels {
            for row in 0..TILE_HEIGHT.min(grid.height - y) {
                let to = (tile * channels + c) * AREA + row * TILE_WIDTH;
                let from = (c * grid.height + y + row) * stride + x;
                for i in 0..n {
                    work(from + i, to + i, tile);
                }
            }
        }
    }
}

/// Per parameter, Adam's rate.
fn rates_of(store: &Store, config: &OptimizerConfig) -> Vec<f32> {
    let mut core = [0.0; CORE];
    core[POSITION..ROTATION].fill(config.position_rate_m);
    core[ROTATION..LOG_SCALE].fill(config.rotation_rate);
    core[LOG_SCALE..LIGHT_OPACITY].fill(config.log_scale_rate);
    core[LIGHT_OPACITY] = config.light.opacity;
    core[LIGHT_OPACITY + 1] = config.radio.opacity;
    let mut out = core.repeat(store.len());
    for (h, r) in store.harmonics.iter().zip([&config.light, &config.radio]) {
        let k = h.coefficients();
        let one: Vec<f32> = (0..h.stride()).map(|i| if i % k == 0 { r.sh_dc } else { r.sh_dc / r.sh_rest_divisor }).collect();
        out.extend(one.repeat(store.len()));
    }
    out
}

fn add(store: &mut Store, p: &[f32], sign: f32) {
    let mut at = 0;
    let [a, b] = &mut store.harmonics;
    for part in [store.value.as_flattened_mut(), &mut a.value[..], &mut b.value[..]] {
        let n = part.len();
        for (value, p) in part.iter_mut().zip(&p[at..at + n]) {
            *value += sign * p;
        }
        at += n;
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.chunks(4096).zip(b.chunks(4096)).map(|(a, b)| f64::from(a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>())).sum()
}

impl CpuDevice {
    fn parameters(&self) -> usize {
        self.store.len() * CORE + self.store.harmonics[0].value.len() + self.store.harmonics[1].value.len()
    }

    /// From `self.scratch.records` of the frame at hand to parameters: `into[k] += f(gradient[k])`.
    fn pull(&self, scene: &Scene, scratch: &mut Store, into: &mut [f32], square: bool) {
        scratch.value.copy_from_slice(&self.store.value);
        for g in 0..2 {
            scratch.harmonics[g].value.copy_from_slice(&self.store.harmonics[g].value);
        }
        self.update(scene, Mode::Write { screen: false }).run(scratch);
        let mut first = self.store.len() * CORE;
        let mut offsets = [0; 2];
        for g in 0..2 {
            offsets[g] = first;
            first += self.store.harmonics[g].value.len();
        }
        let gather = |to: &mut [f32], from: &[f32]| {
            for (to, from) in to.iter_mut().zip(from) {
                *to += if square { from * from } else { *from };
            }
        };
        for chunk in &self.frame.projection.chunks {
            for (local, id) in chunk.ids.iter().enumerate() {
                let id = *id as usize;
                gather(&mut into[id * CORE..(id + 1) * CORE], &scratch.value[id]);
                for g in 0..2 {
                    if !chunk.tiles[g].run(local).is_empty() {
                        let h = &scratch.harmonics[g];
                        let n = h.stride();
                        gather(&mut into[offsets[g] + id * n..][..n], &h.value[id * n..(id + 1) * n]);
                    }
                }
            }
        }
    }

    /// Blends backwards what stands in the losses' gradients.
    fn backwards(&mut self, scene: &Scene) {
        let isa = self.isa;
        let channels = self.channels();
        for g in 0..2 {
            let Some(grid) = &scene.grids[g] else { continue };
            let mut records: Vec<Record> = std::mem::take(&mut self.scratch.records[g]);
            let job = Backwards {
                isa,
                grid,
                image: &self.frame.images[g],
                splats: &self.frame.projection.splats[g],
                color_gradient: &self.scratch.losses[g].gradient,
                depth_gradient: &[],
            };
            match channels[g] {
                1 => job.run::<1, false>(&mut records),
                _ => job.run::<3, false>(&mut records),
            }
            self.scratch.records[g] = records;
        }
    }

    /// Forward and loss of the frame at hand; fills gradients and, if asked for, curvatures.
    fn look(&mut self, step: &Step, scene: &Scene, tile_weights: &[Vec<f32>; 2], objective: Objective, curvature: Option<&mut [Vec<f32>; 2]>) -> f64 {
        let isa = self.isa;
        let channels = self.channels();
        self.frame.projection.tile_weights.clone_from(tile_weights);
        self.frame.project(isa, &self.store, scene, self.raster.near_m);
        self.frame.sort(scene);
        self.frame.blend(isa, scene, channels, [step.light_background, step.radio_background], [false; 2]);
        let mut sum = 0.0;
        let mut none = [vec![], vec![]];
        let with_curvature = curvature.is_some();
        let curvature = curvature.unwrap_or(&mut none);
        for g in 0..2 {
            let Some(grid) = &scene.grids[g] else { continue };
            let target = &self.pyramids[step.view.0].levels[step.levels[g] as usize][g].target;
            let weight = [step.light_weight, step.radio_weight][g];
            let (truth, stride) = target.rows();
            let color = &self.frame.images[g].color;
            let n = (grid.width * grid.height * channels[g]) as f32;
            let scale = weight / n;
            let gamma = self.optimizer.ssim_weight;
            let loss = &mut self.scratch.losses[g];
            let is_image = matches!(objective, Objective::Image(_));
            if is_image {
                sum += f64::from(weight) * f64::from(loss.run(isa, color, target, weight, gamma));
            } else {
                loss.gradient.resize(channels[g] * grid.height * stride, 0.0);
            }
            if with_curvature {
                curvature[g].clear();
                curvature[g].resize(color.len(), 0.0);
            }
            let gradient = &mut loss.gradient;
            let weights = &tile_weights[g];
            let mut local = 0.0_f64;
            each_pixel(grid, channels[g], |row, at, tile| {
                let w = if weights.is_empty() { scale } else { scale * weights[tile] };
                let r = color[at] - truth[row];
                let (value, slope, bend) = match objective {
                    Objective::Square => (r * r, 2.0 * r, 2.0),
                    Objective::Huber(delta) if r.abs() < delta => (0.5 * r * r / delta + 0.5 * delta, r / delta, 1.0 / delta),
                    Objective::Huber(_) => (r.abs(), r.signum(), 1.0 / r.abs()),
                    Objective::Image(delta) => (0.0, 0.0, (1.0 - gamma) / r.abs().max(delta) + 2.0 * gamma / (2.0 * target.variance(row) + 9e-4)),
                };
                local += f64::from(w * value);
                if !is_image {
                    gradient[row] = w * slope;
                }
                if with_curvature {
                    curvature[g][at] = w * bend;
                }
            });
            sum += local;
        }
        sum
    }

    fn linearise(&mut self, step: &Step, tile_weights: [Vec<f32>; 2], objective: Objective) -> Result<(Pass, f64)> {
        let scene = self.scene_of_step(step)?;
        let mut curvature = [vec![], vec![]];
        let loss = self.look(step, &scene, &tile_weights, objective, Some(&mut curvature));
        self.backwards(&scene);
        let frame = std::mem::take(&mut self.frame);
        Ok((Pass { scene, step: *step, frame, curvature, tile_weights }, loss))
    }

    /// J p of a pass, tile-major.
    fn push(&self, pass: &Pass, p: &[f32]) -> [Vec<f32>; 2] {
        let isa = self.isa;
        let chunks = pass.frame.projection.chunks.len();
        let mut tangents = [0, 1].map(|_| vec![Tangent::default(); chunks * CHUNK]);
        let [a, b] = &mut tangents;
        a.par_chunks_mut(CHUNK).zip(b.par_chunks_mut(CHUNK)).enumerate().for_each(|(chunk, (a, b))| {
            let projection = &pass.frame.projection;
            isa.dispatch(Push { store: &self.store, direction: p, scene: &pass.scene, projection, chunk, out: [a, b] });
        });
        let channels = self.channels();
        let backgrounds = [pass.step.light_background, pass.step.radio_background];
        [0, 1].map(|g| {
            let Some(grid) = &pass.scene.grids[g] else { return vec![] };
            let image = &pass.frame.images[g];
            let mut out = vec![0.0; image.color.len()];
            let (background, tangents) = (backgrounds[g], &tangents[g][..]);
            out.par_chunks_mut(channels[g] * AREA).enumerate().for_each(|(index, out)| {
                let tile = tile_at(grid, &image.lists, &pass.frame.projection.splats[g], index);
                if channels[g] == 1 {
                    isa.dispatch(BlendTangent::<1> { tile, tangents, background, out });
                } else {
                    isa.dispatch(BlendTangent::<3> { tile, tangents, background, out });
                }
            });
            out
        })
    }

    /// `into += Jᵀ y` of tile-major images, or its square.
    fn pull_images(&mut self, pass: &mut Pass, y: &[Vec<f32>; 2], scratch: &mut Store, into: &mut [f32], square: bool) {
        let channels = self.channels();
        for g in 0..2 {
            let Some(grid) = &pass.scene.grids[g] else { continue };
            let gradient = &mut self.scratch.losses[g].gradient;
            gradient.resize(channels[g] * grid.height * stride_of(grid.width), 0.0);
            each_pixel(grid, channels[g], |row, at, _| gradient[row] = y[g][at]);
        }
        std::mem::swap(&mut self.frame, &mut pass.frame);
        self.backwards(&pass.scene);
        self.pull(&pass.scene, scratch, into, square);
        std::mem::swap(&mut self.frame, &mut pass.frame);
    }

    /// ⟨J p, y⟩ and ⟨p, Jᵀ y⟩ of random p and y.
    pub fn x_adjoint(&mut self, step: &Step, seed: u64) -> Result<[f64; 2]> {
        let mut rng = Rng::keyed(seed, 79, 0);
        let (mut pass, _) = self.linearise(step, Default::default(), Objective::Square)?;
        let rates = rates_of(&self.store, &self.optimizer);
        let p: Vec<f32> = rates.iter().map(|r| r * rng.normal() as f32).collect();
        let jp = self.push(&pass, &p);
        let y = [0, 1].map(|g| jp[g].iter().map(|v| v + 1e-3 * rng.normal() as f32).collect::<Vec<f32>>());
        // Beyond the border there is nothing.
        let mut left = 0.0;
        for g in 0..2 {
            if let Some(grid) = &pass.scene.grids[g] {
                each_pixel(grid, self.channels()[g], |_, at, _| left += f64::from(jp[g][at]) * f64::from(y[g][at]));
            }
        }
        let mut scratch = self.store.clone();
        let mut gradient = vec![0.0; self.parameters()];
        self.pull_images(&mut pass, &y, &mut scratch, &mut gradient, false);
        self.frame = pass.frame;
        Ok([left, dot(&p, &gradient)])
    }

    /// One step of Levenberg and Marquardt over the keyframes of `steps`. Says the loss before and after.
    pub fn x_gauss_newton(&mut self, state: &mut GaussNewton, steps: &[Step], tile_weights: &[[Vec<f32>; 2]]) -> Result<[f64; 2]> {
        let config = state.config;
        let n = self.parameters();
        let mut scratch = self.store.clone();
        let rates = rates_of(&self.store, &self.optimizer);
        let mut gradient = vec![0.0_f32; n];
        let mut fresh = vec![0.0_f32; n];
        let mut passes = Vec::with_capacity(steps.len());
        let mut before = 0.0;
        for (k, step) in steps.iter().enumerate() {
            let weights = tile_weights.get(k).cloned().unwrap_or_default();
            let (mut pass, loss) = self.linearise(step, weights, config.objective)?;
            before += loss;
            std::mem::swap(&mut self.frame, &mut pass.frame);
            self.pull(&pass.scene, &mut scratch, &mut gradient, false);
            std::mem::swap(&mut self.frame, &mut pass.frame);
            for _ in 0..config.probes {
                state.probes_drawn += 1;
                let mut rng = Rng::keyed(5, 78, state.probes_drawn);
                let mut bits = 0_u32;
                let mut left = 0;
                let probe = [0, 1].map(|g| {
                    pass.curvature[g]
                        .iter()
                        .map(|d| {
                            if left == 0 {
                                bits = rng.below(1 << 30) as u32;
                                left = 30;
                            }
                            left -= 1;
                            let sign = if bits >> left & 1 == 1 { 1.0 } else { -1.0 };
                            sign * d.sqrt()
                        })
                        .collect::<Vec<f32>>()
                });
                self.pull_images(&mut pass, &probe, &mut scratch, &mut fresh, true);
            }
            passes.push(pass);
        }
        // The preconditioner: a mean over steps, per view.
        if state.diagonal.len() != n {
            state.diagonal = vec![0.0; n];
            state.weight = 0.0;
        }
        if config.probes > 0 {
            let share = 1.0 / (config.probes * steps.len()) as f32;
            for (mean, fresh) in state.diagonal.iter_mut().zip(&fresh) {
                *mean = config.memory * *mean + (1.0 - config.memory) * fresh * share;
            }
            state.weight = config.memory * state.weight + 1.0 - config.memory;
        }
        let views = steps.len() as f32;
        let correction = views / state.weight.max(1e-12);
        let stiffness = state.diagonal.iter().zip(&rates).map(|(d, r)| f64::from(d * correction * r * r)).sum::<f64>()
            / gradient.iter().filter(|g| **g != 0.0).count().max(1) as f64;
        let floor = config.floor * stiffness as f32;
        let damping: Vec<f32> =
            state.diagonal.iter().zip(&rates).map(|(d, r)| state.lambda * (d * correction + floor / (r * r))).collect();
        let inverse: Vec<f32> = state
            .diagonal
            .iter()
            .zip(&damping)
            .zip(&rates)
            .map(|((d, l), r)| 1.0 / (d * correction + floor / (r * r) + l).max(1e-30))
            .collect();
        // Conjugate gradients on (H + damping) x = −g.
        let mut x = vec![0.0_f32; n];
        let mut hx = vec![0.0_f32; n];
        let mut residual: Vec<f32> = gradient.iter().map(|g| -g).collect();
        let mut z: Vec<f32> = residual.iter().zip(&inverse).map(|(r, m)| r * m).collect();
        let mut p = z.clone();
        let mut rz = dot(&residual, &z);
        let mut product = vec![0.0_f32; n];
        for _ in 0..config.iterations {
            if rz <= 0.0 {
                break;
            }
            product.fill(0.0);
            for pass in &mut passes {
                let mut y = self.push(pass, &p);
                for g in 0..2 {
                    for (y, d) in y[g].iter_mut().zip(&pass.curvature[g]) {
                        *y *= d;
                    }
                }
                self.pull_images(pass, &y, &mut scratch, &mut product, false);
            }
            for ((q, l), p) in product.iter_mut().zip(&damping).zip(&p) {
                *q += l * p;
            }
            let curved = dot(&p, &product);
            if curved <= 0.0 {
                break;
            }
            let alpha = (rz / curved) as f32;
            for i in 0..n {
                x[i] += alpha * p[i];
                hx[i] += alpha * product[i];
                residual[i] -= alpha * product[i];
                z[i] = residual[i] * inverse[i];
            }
            let next = dot(&residual, &z);
            let beta = (next / rz) as f32;
            rz = next;
            for (p, z) in p.iter_mut().zip(&z) {
                *p = z + beta * *p;
            }
        }
        if config.trust > 0.0 {
            for (x, r) in x.iter_mut().zip(&rates) {
                *x = x.clamp(-config.trust * r, config.trust * r);
            }
        }
        let predicted = -dot(&gradient, &x) - 0.5 * dot(&x, &hx);
        add(&mut self.store, &x, 1.0);
        if !config.adapt {
            return Ok([before, f64::NAN]);
        }
        let mut after = 0.0;
        for pass in passes {
            self.frame = pass.frame;
            after += self.look(&pass.step, &pass.scene, &pass.tile_weights, config.objective, None);
        }
        state.ratio = (before - after) / predicted.max(1e-30);
        if after >= before || !after.is_finite() {
            add(&mut self.store, &x, -1.0);
            state.lambda *= 4.0;
            state.rejected += 1;
        } else {
            state.accepted += 1;
            if state.ratio > 0.75 {
                state.lambda = (state.lambda / 2.0).max(1e-6);
            } else if state.ratio < 0.25 {
                state.lambda *= 2.0;
            }
        }
        Ok([before, after])
    }
}
