//! From the tiles' records to parameter gradients, and sparse Adam, in one visit to each visible Gaussian.

use super::{
    blend::{COLOR, FIRST, INVERSE_Z, MOMENTS, OPACITY, Record},
    geometry::{
        EllipseGradient, Scene, ShapeGradient, ellipse_backward, ellipse_of, mean_backward, shape_backward, shape_of, to_camera,
    },
    project::{CHUNK, Projection, VisibleChunk, direction_of, gather3, gather4},
    store::{Core, LIGHT_OPACITY, LOG_SCALE, POSITION, RADIO_OPACITY, ROTATION, Store},
};
use crate::simd::{Isa, Kernel, Lanes};
use crate::{
    OptimizerConfig,
    device::{DenseStep, ScreenGradient},
    gaussians::harmonics,
};
use rayon::prelude::*;

/// Use of the gradients.
pub(crate) enum Mode<'a> {
    /// One step of Adam; geometry only if `geometry`. A dense one steps the Gaussians that are not visible as well.
    Adam { config: &'a OptimizerConfig, geometry: bool, dense: Option<&'a DenseStep> },
    /// Written over the parameters, of a copy of the store mostly; gradients on the screen may be summed as well.
    Write { screen: bool },
}

/// Per chunk, a modality's harmonics and its moments.
struct HarmonicsPart<'a> {
    value: &'a mut [f32],
    moment1: &'a mut [f32],
    moment2: &'a mut [f32],
    channels: usize,
    degree: usize,
}

/// One chunk of the store.
struct Part<'a> {
    value: &'a mut [Core],
    moment1: &'a mut [Core],
    moment2: &'a mut [Core],
    position_rate: &'a mut [f32],
    /// Empty where no positional gradients on the screen are summed.
    screen: &'a mut [ScreenGradient],
    harmonics: [HarmonicsPart<'a>; 2],
}

/// Everything a step of the visible Gaussians needs.
pub(crate) struct Update<'a> {
    pub isa: Isa,
    pub scene: &'a Scene,
    pub projection: &'a Projection,
    /// Per image: the records in tile order, and where each (Gaussian, tile) pair of each chunk landed in them.
    pub records: [&'a [Record]; 2],
    pub places: [&'a [Vec<u32>]; 2],
    pub mode: Mode<'a>,
}

impl Update<'_> {
    /// Updates (or overwrites by gradients) every visible Gaussian of the store.
    pub fn run(&self, store: &mut Store) {
        let coefficients = [store.harmonics[0].coefficients(), store.harmonics[1].coefficients()];
        let [light, radio] = &mut store.harmonics;
        let mut parts = Vec::with_capacity(self.projection.chunks.len());
        let mut cores = store
            .value
            .chunks_mut(CHUNK)
            .zip(store.moment1.chunks_mut(CHUNK))
            .zip(store.moment2.chunks_mut(CHUNK))
            .zip(store.position_rate.chunks_mut(CHUNK));
        let mut sh = [light, radio].map(|h| {
            let n = CHUNK * (h.degree + 1) * (h.degree + 1) * h.channels;
            let (channels, degree) = (h.channels, h.degree);
            h.value
                .chunks_mut(n)
                .zip(h.moment1.chunks_mut(n))
                .zip(h.moment2.chunks_mut(n))
                .map(move |((value, moment1), moment2)| HarmonicsPart { value, moment1, moment2, channels, degree })
        });
        let summed = match self.mode {
            Mode::Adam { dense, .. } => dense.is_some_and(|d| d.screen_gradients),
            Mode::Write { screen } => screen,
        };
        let sums = if summed { store.screen.len() } else { 0 };
        let mut screen = store.screen[..sums].chunks_mut(CHUNK);
        while let (Some((((value, moment1), moment2), position_rate)), Some(light), Some(radio)) =
            (cores.next(), sh[0].next(), sh[1].next())
        {
            let screen = screen.next().unwrap_or_default();
            parts.push(Part { value, moment1, moment2, position_rate, screen, harmonics: [light, radio] });
        }
        let constants = match &self.mode {
            Mode::Adam { config, dense, .. } => Constants::new(config, coefficients, *dense),
            Mode::Write { .. } => Constants::default(),
        };
        parts.into_par_iter().enumerate().for_each(|(chunk, part)| {
            self.isa.dispatch(UpdateChunk { update: self, chunk, constants: &constants, part });
        });
    }
}

/// Most harmonics of one Gaussian in one modality: three channels of sixteen.
const MAX_STRIDE: usize = 3 * harmonics::MAX_COEFFICIENTS;

/// Constants of a step's update, from the configuration, per modality.
struct Constants {
    /// Rates along one Gaussian's harmonics.
    harmonic_rates: [[f32; MAX_STRIDE]; 2],
    /// Coefficients of a channel that have a gradient.
    learnt: usize,
}

impl Default for Constants {
    fn default() -> Self {
        Self { harmonic_rates: [[0.0; MAX_STRIDE]; 2], learnt: harmonics::MAX_COEFFICIENTS }
    }
}

impl Constants {
    fn new(config: &OptimizerConfig, coefficients: [usize; 2], dense: Option<&DenseStep>) -> Self {
        let mut out = Self::default();
        out.learnt = dense.map_or(out.learnt, DenseStep::coefficients);
        for (g, r) in [&config.light, &config.radio].into_iter().enumerate() {
            out.harmonic_rates[g] = [r.sh_dc / r.sh_rest_divisor; MAX_STRIDE];
            out.harmonic_rates[g].iter_mut().step_by(coefficients[g]).for_each(|rate| *rate = r.sh_dc);
        }
        out
    }
}

struct UpdateChunk<'a, 'b> {
    update: &'a Update<'a>,
    chunk: usize,
    constants: &'a Constants,
    part: Part<'b>,
}

impl Kernel for UpdateChunk<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let visible = &self.update.projection.chunks[self.chunk];
        let first = self.chunk * CHUNK;
        let mut at = 0;
        while at < visible.ids.len() {
            let lanes = L::WIDTH.min(visible.ids.len() - at);
            let mut ids = [visible.ids[at] - first as u32; 16];
            for lane in 0..lanes {
                ids[lane] = visible.ids[at + lane] - first as u32;
            }
            self.group::<L>(visible, at, &ids, lanes);
            at += lanes;
        }
        if matches!(self.update.mode, Mode::Adam { dense: Some(_), .. }) {
            let mut seen = visible.ids.iter().map(|id| *id as usize - first).peekable();
            for id in 0..self.part.value.len() {
                if seen.next_if_eq(&id).is_none() {
                    self.momentum::<L>(id);
                }
            }
        }
    }
}

impl UpdateChunk<'_, '_> {
    /// One lane group: the visible Gaussians `at .. at + lanes` of the chunk.
    #[inline(always)]
    fn group<L: Lanes>(&mut self, visible: &VisibleChunk, at: usize, ids: &[u32; 16], lanes: usize) {
        let update = self.update;
        let scene = update.scene;
        let zero = L::splat(0.0);
        let mean = gather3::<L>(self.part.value, ids, POSITION);
        let p = to_camera(&scene.pose, mean);
        let s = shape_of(&scene.pose, gather4::<L>(self.part.value, ids, ROTATION), gather3(self.part.value, ids, LOG_SCALE));
        let mut d_shape = ShapeGradient::zero();
        let mut d_logit = [[0.0_f32; 16]; 2];
        let mut d_direction = [[0.0_f32; 16]; 3];
        let mut seen = [[false; 16]; 2];
        for (g, grid) in scene.grids.iter().enumerate() {
            let Some(grid) = grid else { continue };
            // Records of each lane's Gaussian, summed in tile order, then one array per quantity.
            let mut sums = [[0.0_f32; 16]; 12];
            for lane in 0..lanes {
                let mut sum: Record = [0.0; 12];
                let run = visible.tiles[g].run(at + lane);
                seen[g][lane] = !run.is_empty();
                for place in &update.places[g][self.chunk][run] {
                    let record = &update.records[g][*place as usize];
                    for k in 0..12 {
                        sum[k] += record[k];
                    }
                }
                for k in 0..12 {
                    sums[k][lane] = sum[k];
                }
            }
            let e = ellipse_of(grid, p, &s);
            let opacity =
                L::splat(1.0) / (L::splat(1.0) + (-super::project::gather::<L>(self.part.value, ids, LIGHT_OPACITY + g)).exp());
            let d_opacity = L::load(&sums[OPACITY]);
            (d_opacity * e.rho * opacity * (L::splat(1.0) - opacity)).store(&mut d_logit[g]);
            let gradient = EllipseGradient {
                moments: [L::load(&sums[MOMENTS]), L::load(&sums[MOMENTS + 1]), L::load(&sums[MOMENTS + 2])],
                first: [L::load(&sums[FIRST]), L::load(&sums[FIRST + 1])],
                inverse_z: L::load(&sums[INVERSE_Z]),
                rho: d_opacity * opacity,
            };
            // Of an image in which a Gaussian is not seen nothing is said, whatever numbers its ellipse there has.
            let sees = L::load(&seen[g].map(|seen| f32::from(u8::from(seen)))).gt(zero);
            d_shape.add_where(sees, &ellipse_backward(grid, &s, &e, &gradient));
            if !self.part.screen.is_empty() {
                let [du, dv] = mean_backward(&e, &gradient);
                let (du, dv) = (du * L::splat(0.5 * grid.width as f32), dv * L::splat(0.5 * grid.height as f32));
                let mut norms = [0.0_f32; 16];
                (du * du + dv * dv).sqrt().store(&mut norms);
                for lane in (0..lanes).filter(|lane| seen[g][*lane]) {
                    let sum = &mut self.part.screen[ids[lane] as usize];
                    (sum.norm_sum, sum.steps) = (sum.norm_sum + norms[lane], sum.steps + 1);
                }
            }
            for lane in 0..lanes {
                if !seen[g][lane] {
                    continue;
                }
                let id = ids[lane] as usize;
                let splat = &update.projection.splats[g][self.chunk * CHUNK + at + lane];
                let mut d_color = [0.0; 3];
                for c in 0..3 {
                    // The clamp at 0 passes no gradient.
                    d_color[c] = if splat.color[c] > 0.0 { sums[COLOR + c][lane] } else { 0.0 };
                }
                let d = direction_of(&self.part.value[id], &scene.pose.eye);
                let d_mean = self.harmonics::<L>(g, id, d, d_color);
                for k in 0..3 {
                    d_direction[k][lane] += d_mean[k];
                }
            }
        }
        let (d_rotation, d_log_scale) = shape_backward(&scene.pose, &s, &d_shape);
        let mut gradient = [[0.0_f32; 16]; 12];
        for k in 0..3 {
            // dL/dμ = Wᵀ dL/dp, and the way through the viewing direction.
            let w =
                [L::splat(scene.pose.rotation[0][k]), L::splat(scene.pose.rotation[1][k]), L::splat(scene.pose.rotation[2][k])];
            (super::geometry::dot(w, d_shape.p) + L::load(&d_direction[k])).store(&mut gradient[POSITION + k]);
            d_log_scale[k].store(&mut gradient[LOG_SCALE + k]);
        }
        for k in 0..4 {
            d_rotation[k].store(&mut gradient[ROTATION + k]);
        }
        gradient[LIGHT_OPACITY] = d_logit[0];
        gradient[RADIO_OPACITY] = d_logit[1];
        for lane in 0..lanes {
            let mut one: Core = [0.0; 12];
            for k in 0..12 {
                one[k] = gradient[k][lane];
            }
            self.core::<L>(ids[lane] as usize, &one, [seen[0][lane], seen[1][lane]]);
        }
    }

    /// A step without a gradient, of a Gaussian that is not visible, in the modalities that are rendered.
    #[inline(always)]
    fn momentum<L: Lanes>(&mut self, id: usize) {
        let Mode::Adam { config, .. } = &self.update.mode else { return };
        let rendered = [0, 1].map(|g| self.update.scene.grids[g].is_some());
        self.core::<L>(id, &[0.0; 12], rendered);
        for g in (0..2).filter(|g| rendered[*g]) {
            let h = &mut self.part.harmonics[g];
            let stride = (h.degree + 1) * (h.degree + 1) * h.channels;
            let run = id * stride..(id + 1) * stride;
            let state = [&mut h.value[run.clone()], &mut h.moment1[run.clone()], &mut h.moment2[run]];
            adam::<L>(config, &self.constants.harmonic_rates[g], &[0.0; MAX_STRIDE][..stride], state);
        }
    }

    /// Geometry and opacities of one Gaussian.
    #[inline(always)]
    fn core<L: Lanes>(&mut self, id: usize, gradient: &Core, seen: [bool; 2]) {
        let Mode::Adam { config, geometry, .. } = &self.update.mode else {
            self.part.value[id] = *gradient;
            return;
        };
        let rate = &mut self.part.position_rate[id];
        let mut rates = [0.0_f32; 16];
        if *geometry {
            rates[POSITION..ROTATION].fill(config.position_rate_m * *rate);
            rates[ROTATION..LOG_SCALE].fill(config.rotation_rate);
            rates[LOG_SCALE..LIGHT_OPACITY].fill(config.log_scale_rate);
            *rate *= 1.0 - config.position_decay;
        }
        rates[LIGHT_OPACITY] = config.light.opacity;
        rates[RADIO_OPACITY] = config.radio.opacity;
        let (value, m, v) = (&mut self.part.value[id], &mut self.part.moment1[id], &mut self.part.moment2[id]);
        let mut state = [*value, *m, *v];
        let [new_value, new_m, new_v] = &mut state;
        adam::<L>(config, &rates, gradient, [new_value, new_m, new_v]);
        // Only what this step trains and sees is written back.
        let first = if *geometry { POSITION } else { LIGHT_OPACITY };
        for k in (first..LIGHT_OPACITY).chain((0..2).filter(|g| seen[*g]).map(|g| LIGHT_OPACITY + g)) {
            (value[k], m[k], v[k]) = (state[0][k], state[1][k], state[2][k]);
        }
    }

    /// Harmonics of one Gaussian in one modality; returns what the viewing direction adds to dL/dμ.
    #[inline(always)]
    fn harmonics<L: Lanes>(&mut self, g: usize, id: usize, d: ([f32; 3], f32), d_color: [f32; 3]) -> [f32; 3] {
        let h = &self.part.harmonics[g];
        match (h.degree, h.channels) {
            (0, 1) => self.harmonics_of::<L, 1, 1>(g, id, d, d_color),
            (1, 1) => self.harmonics_of::<L, 4, 1>(g, id, d, d_color),
            (2, 1) => self.harmonics_of::<L, 9, 1>(g, id, d, d_color),
            (_, 1) => self.harmonics_of::<L, 16, 1>(g, id, d, d_color),
            (0, _) => self.harmonics_of::<L, 1, 3>(g, id, d, d_color),
            (1, _) => self.harmonics_of::<L, 4, 3>(g, id, d, d_color),
            (2, _) => self.harmonics_of::<L, 9, 3>(g, id, d, d_color),
            _ => self.harmonics_of::<L, 16, 3>(g, id, d, d_color),
        }
    }

    #[inline(always)]
    fn harmonics_of<L: Lanes, const K: usize, const C: usize>(
        &mut self,
        g: usize,
        id: usize,
        d: ([f32; 3], f32),
        d_color: [f32; 3],
    ) -> [f32; 3] {
        let rates = &self.constants.harmonic_rates[g];
        let mode = &self.update.mode;
        let h = &mut self.part.harmonics[g];
        let learnt = self.constants.learnt.min(K);
        let (direction, inverse_distance) = d;
        let y = harmonics::basis_of::<K>(direction);
        // Σ_c dL/dc_c sh_c,k: the weights of ∇Y_k.
        let mut weights = [0.0_f32; harmonics::MAX_COEFFICIENTS];
        let run = id * K * C..(id + 1) * K * C;
        let value = &mut h.value[run.clone()];
        let mut gradient = [0.0_f32; MAX_STRIDE];
        for c in 0..C {
            for k in 0..K {
                weights[k] += d_color[c] * value[c * K + k];
                gradient[c * K + k] = d_color[c] * y[k];
            }
        }
        if learnt < K {
            gradient[..K * C].chunks_exact_mut(K).for_each(|channel| channel[learnt..].fill(0.0));
        }
        match mode {
            Mode::Write { .. } => value.copy_from_slice(&gradient[..K * C]),
            Mode::Adam { config, .. } => {
                let (m, v) = (&mut h.moment1[run.clone()], &mut h.moment2[run]);
                adam::<L>(config, rates, &gradient[..K * C], [value, m, v]);
            }
        }
        if K == 1 {
            return [0.0; 3];
        }
        let gd = harmonics::direction_gradient::<K>(direction, &weights);
        // d = (μ − eye)/|μ − eye|: dL/dμ = (I − d dᵀ) dL/dd / distance.
        let along = gd[0] * direction[0] + gd[1] * direction[1] + gd[2] * direction[2];
        [
            (gd[0] - along * direction[0]) * inverse_distance,
            (gd[1] - along * direction[1]) * inverse_distance,
            (gd[2] - along * direction[2]) * inverse_distance,
        ]
    }
}

/// Adam without bias correction on (value, first moment, second moment), all as long as the gradient; `rates` may be longer.
#[inline(always)]
pub(super) fn adam<L: Lanes>(config: &OptimizerConfig, rates: &[f32], gradient: &[f32], [value, m, v]: [&mut [f32]; 3]) {
    let count = gradient.len();
    let whole = count - count % L::WIDTH;
    for at in (0..whole).step_by(L::WIDTH) {
        adam_lanes::<L>(config, &rates[at..], &gradient[at..], [&mut value[at..], &mut m[at..], &mut v[at..]]);
    }
    if whole < count {
        let rest = whole..count;
        let mut state = [padded(&value[rest.clone()]), padded(&m[rest.clone()]), padded(&v[rest.clone()])];
        let [a, b, c] = &mut state;
        adam_lanes::<L>(config, &padded(&rates[rest.clone()]), &padded(&gradient[rest.clone()]), [a, b, c]);
        for (to, from) in [value, m, v].into_iter().zip(&state) {
            to[rest.clone()].copy_from_slice(&from[..count - whole]);
        }
    }
}

/// Fewer numbers than lanes, filled up with zeros.
#[inline(always)]
fn padded(from: &[f32]) -> [f32; 16] {
    let mut out = [0.0_f32; 16];
    out[..from.len()].copy_from_slice(from);
    out
}

/// One group of lanes of [`adam`].
#[inline(always)]
fn adam_lanes<L: Lanes>(config: &OptimizerConfig, rates: &[f32], gradient: &[f32], [value, m, v]: [&mut [f32]; 3]) {
    let g = L::load(gradient);
    let next_m = L::splat(config.beta1) * L::load(m) + L::splat(1.0 - config.beta1) * g;
    let next_v = L::splat(config.beta2) * L::load(v) + L::splat(1.0 - config.beta2) * g * g;
    let step = L::load(rates) * next_m / (next_v.sqrt() + L::splat(config.epsilon));
    (L::load(value) - step).store(value);
    next_m.store(m);
    next_v.store(v);
}
