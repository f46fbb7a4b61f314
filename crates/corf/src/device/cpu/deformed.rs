//! Steps of Gaussians that something else makes of those held: the rasteriser's gradient in them, and dense Adam with a gradient that is given.

pub use super::store::{CORE, Core};
use super::{
    CpuDevice,
    store::{LIGHT_OPACITY, LOG_SCALE, POSITION, RADIO_OPACITY, ROTATION},
    update::{Mode, adam},
};
use crate::simd::{Kernel, Lanes};
use crate::{
    OptimizerConfig, Result,
    device::{DenseStep, RenderRequest, Rendering, ScreenGradient, StepReport},
};
use rayon::prelude::*;

/// Geometry with opacities, and RF harmonics, of all Gaussians, one behind the other; or a gradient in these.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// Position (3), quaternion (4), ln scale (3), opacity logits (light, 60 GHz).
    pub core: Vec<Core>,
    /// `[gaussian][channel][coefficient]`.
    pub radio: Vec<f32>,
}

/// Numbers that a thread steps at once, at least.
const RUN: usize = 1 << 14;

impl CpuDevice {
    /// The Gaussians held.
    pub fn rows(&self) -> Rows {
        Rows { core: self.store.value.clone(), radio: self.store.harmonics[1].value.clone() }
    }

    /// Has `rows` stand in the place of the Gaussians held, while `work` is done with them; what it leaves of them is returned.
    fn with<T>(&mut self, mut rows: Rows, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<(T, Rows)> {
        assert_eq!(rows.core.len(), self.store.len(), "one for each Gaussian");
        assert_eq!(rows.radio.len(), self.store.harmonics[1].value.len(), "RF harmonics of each Gaussian");
        let mut swap = |device: &mut Self| {
            std::mem::swap(&mut device.store.value, &mut rows.core);
            std::mem::swap(&mut device.store.harmonics[1].value, &mut rows.radio);
        };
        swap(self);
        let done = work(self);
        swap(self);
        Ok((done?, rows))
    }

    /// The gradient of an RF step's loss in `rows`, zero where they are not seen; adds to the gradients on the screen if the step does.
    pub fn gradients_in(&mut self, dense: &DenseStep, rows: Rows) -> Result<(StepReport, Rows)> {
        dense.check()?;
        self.with(rows, |device| {
            let scene = device.scene_of_step(&dense.step)?;
            if dense.screen_gradients {
                device.store.screen.resize(device.store.len(), ScreenGradient::default());
            }
            let report = device.differentiate(&dense.step, &scene);
            device.update_store(&scene, Mode::Write { screen: dense.screen_gradients });
            let seen = device.frame.projection.seen(device.store.len());
            let h = &mut device.store.harmonics[1];
            let stride = h.stride();
            for (i, _) in seen.iter().enumerate().filter(|(_, seen)| !seen[1]) {
                device.store.value[i] = [0.0; CORE];
                h.value[i * stride..(i + 1) * stride].fill(0.0);
            }
            Ok(report)
        })
    }

    /// Renders `rows`.
    pub fn render_rows(&mut self, request: &RenderRequest, rows: Rows) -> Result<Rendering> {
        self.with(rows, |device| device.render_request(request)).map(|(rendering, _)| rendering)
    }

    /// Takes a dense step of the Gaussians held with a gradient in all of them.
    pub fn step_rows(&mut self, dense: &DenseStep, gradient: &Rows) {
        let config = dense.constants(&self.optimizer);
        let mut rates = [0.0; CORE];
        rates[POSITION..ROTATION].fill(config.position_rate_m);
        rates[ROTATION..LOG_SCALE].fill(config.rotation_rate);
        rates[LOG_SCALE..LIGHT_OPACITY].fill(config.log_scale_rate);
        rates[RADIO_OPACITY] = config.radio.opacity;
        let (isa, store) = (self.isa, &mut self.store);
        let core = [&mut store.value, &mut store.moment1, &mut store.moment2].map(|a| a.as_flattened_mut());
        let h = &mut store.harmonics[1];
        let harmonic_rates = vec![config.radio.sh_dc; h.stride()];
        let harmonics = [&mut h.value[..], &mut h.moment1, &mut h.moment2];
        for (rates, gradient, [value, m, v]) in
            [(&rates[..], gradient.core.as_flattened(), core), (&harmonic_rates, &gradient.radio, harmonics)]
        {
            let run = (RUN / rates.len()).max(1) * rates.len();
            let parts = value.par_chunks_mut(run).zip(m.par_chunks_mut(run)).zip(v.par_chunks_mut(run));
            parts.zip(gradient.par_chunks(run)).for_each(|(((value, m), v), gradient)| {
                isa.dispatch(AdamOfRows { config: &config, rates, gradient, state: [value, m, v] });
            });
        }
    }
}

/// Adam over rows that have the same rates.
struct AdamOfRows<'a> {
    config: &'a OptimizerConfig,
    rates: &'a [f32],
    gradient: &'a [f32],
    state: [&'a mut [f32]; 3],
}

impl Kernel for AdamOfRows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let words = self.rates.len();
        let [value, m, v] = self.state;
        for (k, gradient) in self.gradient.chunks_exact(words).enumerate() {
            let row = k * words..(k + 1) * words;
            adam::<L>(self.config, self.rates, gradient, [&mut value[row.clone()], &mut m[row.clone()], &mut v[row]]);
        }
    }
}
