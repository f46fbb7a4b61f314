//! Density control on the device: positional gradients on the screen, copies of Gaussians, opacity resets.

use super::{
    GpuDevice,
    store::{CORE, Store},
};
use crate::{
    Result,
    device::{Duplicate, Modality, ScreenGradient},
    gaussians::logit,
};
use corf_gpu::Context;

/// Words of a mark (`shaders/mark.wgsl`).
const MARK: usize = 3;
/// Place of light's opacity among a Gaussian's geometry and opacities; that of 60 GHz is behind it.
const LIGHT_OPACITY: usize = 10;
/// Number of a dense step that there is none of.
const NOBODY: u32 = u32::MAX;

impl GpuDevice {
    /// Makes room for a mark of each Gaussian, empty ones where none are held.
    pub(super) fn prepare_marks(&mut self) -> Result<()> {
        if self.marked != Some(self.store.len()) {
            self.write_screen_gradients(&vec![ScreenGradient::default(); self.store.len()])?;
        }
        Ok(())
    }

    pub(super) fn read_screen_gradients(&mut self) -> Result<Vec<ScreenGradient>> {
        let n = self.store.len();
        if self.marked != Some(n) {
            return Ok(vec![ScreenGradient::default(); n]);
        }
        let read = self.context.read::<u32>("reading screen-space gradients back", &[(&self.marks.buffer, n * MARK)])?;
        let mark = |word: &[u32]| ScreenGradient { norm_sum: f32::from_bits(word[0]), steps: word[1] };
        Ok(read[0].chunks_exact(MARK).map(mark).collect())
    }

    pub(super) fn write_screen_gradients(&mut self, gradients: &[ScreenGradient]) -> Result<()> {
        ScreenGradient::check_all(gradients, self.store.len())?;
        self.marks.reserve(&self.context, gradients.len().max(1), 4 * MARK)?;
        let words: Vec<u32> = gradients.iter().flat_map(|g| [g.norm_sum.to_bits(), g.steps, NOBODY]).collect();
        self.context.fill(&self.marks.buffer, 0, &words);
        self.marked = Some(gradients.len());
        Ok(self.context.check("screen-space gradients")?)
    }
}

impl Store {
    /// Geometry and opacities of all Gaussians.
    fn read_cores(&self, context: &Context, doing: &'static str) -> Result<Vec<f32>> {
        Ok(context.read::<f32>(doing, &[(&self.core.value.buffer, self.len() * CORE)])?.pop().unwrap_or_default())
    }

    /// Adds copies behind those held, with fresh optimiser state.
    pub fn duplicate(&mut self, context: &Context, duplicates: &[Duplicate]) -> Result<()> {
        Duplicate::check_all(duplicates, self.len())?;
        if duplicates.is_empty() {
            return Ok(());
        }
        // What has to be computed of a copy are twelve numbers, here as on the processor; its harmonics are copied where they are.
        let held = self.read_cores(context, "copying Gaussians")?;
        let rows = held.as_chunks::<CORE>().0;
        let cores: Vec<f32> = duplicates.iter().flat_map(|d| d.core(&rows[d.source as usize])).collect();
        let sources: Vec<u32> = duplicates.iter().map(|d| d.source).collect();
        self.extend(context, &cores, |store, first| store.copy_harmonics(context, &sources, first))
    }

    /// Lowers a modality's opacities above `most` to it, and clears the moments of all of them.
    pub fn cap_opacity(&mut self, context: &Context, modality: Modality, most: f32) -> Result<()> {
        let doing = "resetting opacities";
        let (c, numbers, most, at) = (&self.core, self.len() * CORE, logit(most), LIGHT_OPACITY + modality.index());
        let sources = [(&c.value.buffer, numbers), (&c.moment1.buffer, numbers), (&c.moment2.buffer, numbers)];
        let mut read = context.read::<f32>(doing, &sources)?;
        for (k, (rows, values)) in [&c.value, &c.moment1, &c.moment2].into_iter().zip(&mut read).enumerate() {
            for row in values.chunks_exact_mut(CORE) {
                row[at] = if k == 0 { row[at].min(most) } else { 0.0 };
            }
            context.fill(&rows.buffer, 0, values);
        }
        Ok(context.check(doing)?)
    }
}
