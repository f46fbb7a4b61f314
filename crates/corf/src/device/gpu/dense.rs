//! Steps of dense Adam: kernels of their own for the update, and one more for the Gaussians that a step does not see.

use super::{
    GpuDevice,
    shaders::{Fixed, Gradients},
};
use crate::{
    Result,
    device::{DenseStep, StepReport},
};
use corf_gpu::{Context, Kernel};

/// The update of a dense step.
pub(super) struct DenseUpdate {
    /// Appearance, geometry.
    pub update: [Kernel; 2],
    /// Of steps that render light, and RF: the Gaussians that are not seen.
    pub momentum: [Kernel; 2],
}

impl DenseUpdate {
    fn new(context: &Context, fixed: &Fixed) -> Result<Self> {
        let [appearance, geometry, light, radio] = Kernel::all(
            context,
            [
                ("dense update appearance", fixed.update_appearance(Gradients::Dense)),
                ("dense update geometry", fixed.update_geometry(Gradients::Dense)),
                ("momentum in light", fixed.momentum(0)),
                ("momentum in RF", fixed.momentum(1)),
            ],
        )?;
        Ok(Self { update: [appearance, geometry], momentum: [light, radio] })
    }
}

impl GpuDevice {
    /// Runs dense steps as [`Self::run_steps`] does others; the first time makes their kernels.
    pub(super) fn run_dense_steps(&mut self, steps: &[DenseStep]) -> Result<StepReport> {
        steps.iter().try_for_each(DenseStep::check)?;
        if self.training.dense.is_none() {
            self.training.dense = Some(DenseUpdate::new(&self.context, &self.shapes[0])?);
        }
        self.prepare_marks()?;
        let planned = steps.iter().map(|dense| self.plan_dense(dense)).collect::<Result<_>>()?;
        match self.batch(planned) {
            Some(batch) => self.complete_dense(batch),
            None => Ok(StepReport::default()),
        }
    }
}
