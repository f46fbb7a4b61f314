//! Training steps. The field goes to the GPU before the steps of a keyframe and comes back after them, as emitters are born in between.

use super::super::stepper::{Residuals, Rule, Stepper, View};
use super::super::{ArrayField, ArrayTrainer};
use super::backward::{Backward, BackwardKernels};
use super::emitters::Emitters;
use super::forward::{Forward, Kernels, Room};
use super::job::{Job, Receivers};
use super::pixels::Pixels;
use super::shape::{Shape, TABLES};
use crate::Result;
use corf_gpu::{AdapterOptions, Context};

/// Steps that are submitted at once, with the spectra of their keyframes.
const STEPS_AT_ONCE: usize = 32;

/// Takes steps on a GPU, in f32. The same steps give the same bytes on the same adapter and driver.
pub(in crate::array) struct GpuStepper {
    rule: Rule,
    forward: Kernels,
    backward: BackwardKernels,
    pixels: Pixels,
    steps_at_once: usize,
    /// Last, for what is made of it to be dropped before.
    context: Context,
}

impl ArrayTrainer {
    /// The same, which takes its steps on a GPU.
    ///
    /// # Errors
    /// No adapter, or one without memory.
    pub fn on_gpu(mut self, options: &AdapterOptions) -> Result<Self> {
        self.stepper = Box::new(GpuStepper::new(Context::open(options)?, self.rule(), &self.field, STEPS_AT_ONCE)?);
        Ok(self)
    }
}

impl GpuStepper {
    /// Of fields with the sensor and camera of this one.
    pub fn new(context: Context, rule: Rule, field: &ArrayField, steps_at_once: usize) -> Result<Self> {
        let shape = Shape::of(&field.sensor)?;
        Ok(Self {
            rule,
            forward: Kernels::new(&context, shape)?,
            backward: BackwardKernels::new(&context, shape)?,
            pixels: Pixels::new(&context, field)?,
            steps_at_once,
            context,
        })
    }

    /// Sends steps with their receivers and targets, and takes them.
    fn submit(&self, field: &ArrayField, forward: &Forward, backward: &Backward, views: &[&View], planes: usize) {
        let mut receivers = Receivers::default();
        let Rule { rate, damping, clip, visibility: share, floor } = self.rule;
        let mut jobs = vec![];
        for (k, view) in views.iter().enumerate() {
            receivers.push(&view.receiver);
            let has_background = u32::from(planes > 1);
            jobs.push(Job { has_background, rate, damping, clip, share, floor, ..Job::new(field, k, 1) });
            let at = (4 * k * planes * self.pixels.count) as u64;
            self.context.fill(&backward.targets, at, &view.log);
            if let Some(background) = &view.background {
                self.context.fill(&backward.targets, at + 4 * self.pixels.count as u64, background);
            }
        }
        forward.send(&self.context, &receivers, &jobs);
        let mut encoder = self.context.encoder();
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            for job in 0..jobs.len() {
                forward.run(&mut pass, job, 1);
                backward.run(&mut pass, job);
            }
        }
        self.context.submit(encoder);
    }
}

impl Stepper for GpuStepper {
    fn take(&mut self, field: &mut ArrayField, views: &[&View]) -> Result<f32> {
        let Some(last) = views.last() else { return Ok(0.0) };
        let count = field.sources.len() + field.points.len();
        if count == 0 {
            return Ok(Residuals::of(last, vec![0.0; self.pixels.count], &self.rule).mean_square);
        }
        // All keyframes of a field have a background or none has.
        let planes = if last.background.is_some() { 2 } else { 1 };
        let emitters = Emitters::new(&self.context, field)?;
        // No more at once than an adapter binds the targets of; a step's own may be too many.
        let bindable =
            usize::try_from(self.context.largest_buffer()).unwrap_or(usize::MAX) / (4 * planes * self.pixels.count).max(1);
        let held = views.len().min(self.steps_at_once).min(bindable.max(1));
        let room = Room { batch: 1, held, tables: TABLES, directions: self.pixels.count };
        let forward = Forward::new(&self.context, &self.forward, &emitters, &self.pixels, room)?;
        let backward = Backward::new(&self.context, &self.backward, &forward, &emitters, &self.pixels, [held, planes])?;
        for views in views.chunks(held) {
            self.submit(field, &forward, &backward, views, planes);
        }
        let sizes =
            [(&emitters.gains, count), (&emitters.seen_from, count * emitters.anchors), (&backward.residuals, self.pixels.count)];
        let read = self.context.read::<f32>("training a radio field", &sizes)?;
        let [gains, seen_from, residuals] = read.as_slice() else { unreachable!("three were read") };
        let own = field.sources.len();
        field.sources.gain.copy_from_slice(&gains[..own]);
        field.points.gain.copy_from_slice(&gains[own..]);
        for (k, row) in seen_from.chunks_exact(count).enumerate() {
            field.sources.seen_from[k].copy_from_slice(&row[..own]);
            field.points.seen_from[k].copy_from_slice(&row[own..]);
        }
        Ok(residuals.iter().map(|r| r * r).sum::<f32>() / residuals.len() as f32)
    }
}
