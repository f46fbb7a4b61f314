//! From observations to a step: residuals, what pulls at each wave, and the step that follows from it.

use super::capon::{Adjoint, BoundAdjoint};
use super::emitters::Emitters;
use super::forward::Forward;
use super::job::Job;
use super::pixels::Pixels;
use super::shape::{CHUNK, Shape, TABLES};
use crate::Result;
use corf_gpu::{Bound, Context, Kernel, UNIFORM_STRIDE};

/// Compiled kernels of the way back.
pub(super) struct BackwardKernels {
    shape: Shape,
    residual: Kernel,
    /// Parts of the pixels' tables and their sums, of beams.
    tables: Option<[Kernel; 2]>,
    adjoint: Option<Adjoint>,
    pull: Kernel,
    account: Kernel,
    update: Kernel,
}

impl BackwardKernels {
    pub fn new(context: &Context, shape: Shape) -> Result<Self> {
        let sources = [
            ("residuals of spectra", shape.residual()),
            ("pull at waves", shape.pull()),
            ("account for pixels", shape.account()),
            ("step emitters", shape.update()),
        ];
        let [residual, pull, account, update] = Kernel::all(context, sources)?;
        let tables = match shape {
            Shape::Beam { .. } | Shape::Capon { .. } => {
                let sources = [("collect pixels", shape.collect_pixels()), ("sum tables of pixels", shape.sum_pixels())];
                Some(Kernel::all(context, sources)?)
            }
            Shape::Lobes => None,
        };
        Ok(Self { shape, residual, tables, adjoint: Adjoint::new(context, shape)?, pull, account, update })
    }
}

/// Working memory of a step, and kernels bound to it.
pub(super) struct Backward {
    /// Of each step: logarithms, and behind them the background where there is one.
    pub targets: wgpu::Buffer,
    /// Residuals of the last step.
    pub residuals: wgpu::Buffer,
    residual: Bound,
    tables: Option<[Bound; 2]>,
    adjoint: Option<BoundAdjoint>,
    pull: Bound,
    account: Bound,
    update: Bound,
    shape: Shape,
    emitters: usize,
    pixels: usize,
}

impl Backward {
    /// Room for `held` steps with `planes` numbers of each pixel.
    pub fn new(
        context: &Context,
        kernels: &BackwardKernels,
        forward: &Forward,
        emitters: &Emitters,
        pixels: &Pixels,
        [held, planes]: [usize; 2],
    ) -> Result<Self> {
        let count = emitters.count as u64;
        let targets = context.storage("targets", (4 * held * planes * pixels.count) as u64)?;
        let residuals = context.storage("residuals", 4 * pixels.count as u64)?;
        let by_pixel = context.storage("derivatives by pixels", 8 * pixels.count as u64)?;
        let pulls = context.storage("pulls at waves", 8 * count)?;
        let accounts = context.storage("accounts", 8 * count.div_ceil(64))?;
        let Forward { jobs, receivers, anchors, waves, lobes, parts, tables, totals, observed, .. } = forward;
        let bind = |kernel: &Kernel, buffers: &[&wgpu::Buffer]| kernel.bind(context, size_of::<Job>() as u64, buffers);
        let pull = match kernels.shape {
            Shape::Beam { .. } => bind(&kernels.pull, &[jobs, waves, tables, &pulls])?,
            Shape::Capon { .. } => bind(&kernels.pull, &[jobs, waves, tables, &pulls, totals])?,
            Shape::Lobes => bind(&kernels.pull, &[jobs, &pixels.looks, &pixels.tiles, waves, lobes, &by_pixel, &pulls])?,
        };
        let of_tables = match &kernels.tables {
            Some([collect, sum]) => {
                Some([bind(collect, &[jobs, &pixels.looks, &by_pixel, parts])?, bind(sum, &[jobs, parts, tables])?])
            }
            None => None,
        };
        let adjoint = match &kernels.adjoint {
            Some(adjoint) => Some(adjoint.bind(context, kernels.shape, &forward.jobs, [&forward.tables, &forward.matrices])?),
            None => None,
        };
        let of_residuals = [jobs, observed, &targets, &by_pixel, &residuals, totals];
        let bound = if kernels.shape.is_capon() { 6 } else { 5 };
        Ok(Self {
            residual: bind(&kernels.residual, &of_residuals[..bound])?,
            tables: of_tables,
            adjoint,
            pull,
            account: bind(&kernels.account, &[jobs, waves, &pulls, &accounts])?,
            update: bind(
                &kernels.update,
                &[jobs, receivers, anchors, waves, &pulls, &accounts, &emitters.gains, &emitters.seen_from],
            )?,
            targets,
            residuals,
            shape: kernels.shape,
            emitters: emitters.count,
            pixels: pixels.count,
        })
    }

    /// The step of a job whose observation is there.
    pub fn run(&self, pass: &mut wgpu::ComputePass<'_>, job: usize) {
        let at = (UNIFORM_STRIDE * job as u64) as u32;
        let groups = self.emitters.div_ceil(64) as u32;
        self.residual.run(pass, at, self.pixels.div_ceil(64) as u32);
        if let Some([collect, sum]) = &self.tables {
            collect.run(pass, at, self.pixels.div_ceil(CHUNK) as u32);
            sum.run(pass, at, (TABLES * self.shape.entries()).div_ceil(64) as u32);
        }
        if let Some(adjoint) = &self.adjoint {
            adjoint.run(pass, at, self.shape);
        }
        // A workgroup a wave where lobes are looked for, a thread elsewhere.
        self.pull.run(pass, at, if self.shape == Shape::Lobes { self.emitters as u32 } else { groups });
        self.account.run(pass, at, groups);
        self.update.run(pass, at, groups);
    }
}
