//! Training steps: loss, backward, update; many to a submission.

use super::{
    GpuDevice,
    capacity::BufferCapacity,
    frame::{Extent, FAILED, Leaves, NEEDED, STATE_WORDS, STEPS, VISIBLE},
    params::{GridParams, Params, Uniforms},
    shaders::{Fixed, HarmonicsShape},
    store::CORE,
    training::{Destination, Planned},
};
use crate::{
    Error, Gaussians, OptimizerConfig, Result,
    device::{DenseStep, Step, StepReport, cpu::pyramid::check_levels},
};
use corf_gpu::{Context, Reading, Timestamps};
use std::{collections::BTreeMap, time::Instant};

/// Names of a step's kernels, in order.
pub const STAGES: [&str; 11] =
    ["project", "emit", "allot", "place", "order", "forward", "similarity", "gradient", "backward", "appearance", "geometry"];

/// Steps, or frames, recorded into one submission.
pub(crate) const STEPS_PER_SUBMISSION: usize = 32;
/// Steps on no more pixels than this have the smaller tiles; one of images apart, one of images that share their pairs. On a reconstructed
/// field, images apart, 94 000 pixels take 0.52 ms instead of 0.58, 375 000 take 0.74 instead of 0.69, 1.5 million 1.59 instead of 1.30;
/// together, on a drawn one, 0.6 million take 0.44 instead of 0.46, 1.8 million 0.77 instead of 0.78, 2.9 million 1.07 instead of 1.04.
const FEW_PIXELS: [u32; 2] = [1 << 17, 1 << 21];
/// Steps of the first submission; each that follows has twice as many.
const FIRST_STEPS: usize = 4;

/// Time spent on the device, by its own timestamps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GpuStageTimes {
    /// Steps measured.
    pub steps: usize,
    /// Seconds of each of [`STAGES`], summed over steps.
    pub seconds: [f64; STAGES.len()],
}

/// Counts of the last step, from which its work is estimated.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counts {
    pub visible: usize,
    /// (Gaussian, tile) pairs of the largest frame of the call.
    pub pairs: usize,
    pub pixels: usize,
    /// Bytes of the images' targets, inverse depths left out.
    pub target_bytes: usize,
    pub tiles: usize,
    pub fused: bool,
    pub shape: usize,
}

/// Steps on their way.
pub(crate) struct Batch {
    pub(super) steps: Vec<Planned>,
    extent: Extent,
    /// The constants of the last one.
    last: Params,
    room: BufferCapacity,
    pub(super) done: usize,
}

impl Batch {
    /// What to try after the step that comes next found no room in all that was `held`: more; or, where there can be no more, the usual, larger
    /// tiles for this step's small images, which make fewer pairs.
    fn ask(&mut self, state: &[u32], held: BufferCapacity, context: &Context, shapes: &[Fixed]) {
        let most = self.extent.most(context, &shapes[0]);
        self.room = BufferCapacity::asked(state, most);
        if self.room.pairs <= most.pairs {
            return;
        }
        // The number asked for is the most of all frames; a later one, which drew what had not been trained, may have had more than this step.
        if held.pairs >= most.pairs {
            let of_last = self.done + 1 == self.steps.len();
            let Some(step) = self.steps.get_mut(self.done).filter(|s| s.params.shape != 0) else { return };
            step.params.set_tiles(0, shapes[0].tile);
            self.extent.include(&step.params, shapes);
            if of_last {
                self.last = step.params;
            }
        }
        self.room.pairs = self.extent.most(context, &shapes[0]).pairs;
    }
}

impl GpuDevice {
    pub(super) fn plan_step(&self, step: &Step, optimizer: &OptimizerConfig) -> Result<Planned> {
        let place = || format!("training step for view {}", step.view.0);
        let Some(pyramid) = self.keyframe_cache.get(step.view.0) else {
            let what = format!("this device holds {} views", self.keyframe_cache.len());
            return Err(Error::invalid(place(), what, "upload the view to the device that trains on it"));
        };
        let at = step.levels.map(|l| l as usize);
        check_levels(step.levels, pyramid.levels())
            .map_err(|what| Error::invalid(place(), what, "upload the view with more levels, or train on a lower one"))?;
        let weights = [step.light_weight, step.radio_weight];
        if [weights[0], weights[1], step.depth_weight].iter().any(|w| !(w.is_finite() && *w >= 0.0)) {
            let what = format!("loss weights {:?}", [weights[0], weights[1], step.depth_weight]);
            return Err(Error::invalid(place(), what, "give finite weights ≥ 0"));
        }
        let mut grids = pyramid.grids(at).map(Some);
        for (grid, weight) in grids.iter_mut().zip(weights) {
            if weight == 0.0 {
                *grid = None;
            }
        }
        let backgrounds = [step.light_background, step.radio_background];
        let mut params = Params::new(&pyramid.pose, &grids, backgrounds, self.raster.near_m, self.store.len(), optimizer);
        if self.fuse {
            params.fuse();
        }
        let shape = usize::from(self.shapes.len() > 1 && params.pixel_total <= FEW_PIXELS[params.fused as usize]);
        params.set_tiles(shape, self.shapes[shape].tile);
        params.train_geometry = u32::from(step.train_geometry);
        pyramid.target(at, weights, self.store.harmonics.map(|h| h.channels), step.depth_weight, &mut params);
        Ok(Planned { params, view: step.view })
    }

    /// A dense step's constants.
    pub(super) fn plan_dense(&mut self, dense: &DenseStep) -> Result<Planned> {
        let mut one = self.plan_step(&dense.step, &dense.constants(&self.optimizer))?;
        // The last of all numbers is nobody's: what is marked by nobody has it.
        self.dense_steps = (self.dense_steps + 1) % u32::MAX;
        one.params.set_dense(dense, self.dense_steps);
        Ok(one)
    }

    /// Runs steps in order, however often room has to be made, and reports the last.
    pub(super) fn run_steps(&mut self, steps: &[Step]) -> Result<StepReport> {
        self.run(steps, Destination::Sparse)
    }

    fn run(&mut self, steps: &[Step], destination: Destination<'_>) -> Result<StepReport> {
        match self.batch(self.plan(steps)?) {
            Some(batch) => self.complete(batch, destination),
            None => Ok(StepReport::default()),
        }
    }

    fn plan(&self, steps: &[Step]) -> Result<Vec<Planned>> {
        steps.iter().map(|s| self.plan_step(s, &self.optimizer)).collect()
    }

    /// Has the device begin with steps; [`GpuDevice::settle`] waits for them.
    pub(super) fn begin_steps(&mut self, steps: &[Step]) -> Result<()> {
        if let Some(mut batch) = self.batch(self.plan(steps)?) {
            let reading = self.launch(&mut batch, Destination::Sparse)?;
            self.begun = Some((batch, reading));
        }
        Ok(())
    }

    /// Waits for steps that were begun, if any were, and reports the last. Where they come to nothing, whoever calls next may not be the one
    /// that began them: the error stays.
    pub(super) fn settle(&mut self) -> Result<Option<StepReport>> {
        if let Some((batch, reading)) = self.begun.take() {
            match self.complete_begun(batch, reading) {
                Ok(report) => return Ok(Some(report)),
                Err(error) => self.failed = Some(error),
            }
        }
        self.failed.as_ref().map_or(Ok(None), |error| Err(error.repeated()))
    }

    fn complete_begun(&mut self, mut batch: Batch, reading: Reading<u32>) -> Result<StepReport> {
        match self.absorb(&mut batch, reading)? {
            Some(report) => Ok(report),
            None => self.complete(batch, Destination::Sparse),
        }
    }

    /// Steps made ready; nothing of none.
    pub(super) fn batch(&self, steps: Vec<Planned>) -> Option<Batch> {
        let n = self.store.len();
        let mut extent = Extent { gaussians: n, training: true, ..Extent::default() };
        steps.iter().for_each(|p| extent.include(&p.params, &self.shapes));
        let last = steps.last().map(|s| s.params)?;
        let room = BufferCapacity::guess(n, self.least_room, extent.most(&self.context, &self.shapes[0]));
        Some(Batch { steps, extent, last, room, done: 0 })
    }

    /// Goes on until a batch of dense steps is through.
    pub(super) fn complete_dense(&mut self, batch: Batch) -> Result<StepReport> {
        self.complete(batch, Destination::Dense)
    }

    /// Goes on until a batch is through.
    pub(super) fn complete(&mut self, mut batch: Batch, destination: Destination<'_>) -> Result<StepReport> {
        loop {
            let reading = self.launch(&mut batch, destination)?;
            if let Some(report) = self.absorb(&mut batch, reading)? {
                return Ok(report);
            }
        }
    }

    /// Submits what is left of a batch.
    fn launch(&mut self, batch: &mut Batch, destination: Destination<'_>) -> Result<Reading<u32>> {
        self.make_room(batch)?;
        let begin = Instant::now();
        self.submit(&batch.steps[batch.done..], destination)?;
        self.clock.host.recording_s += begin.elapsed().as_secs_f64();
        self.begin_report(batch)
    }

    /// Makes the room that a batch asks for.
    pub(super) fn make_room(&mut self, batch: &mut Batch) -> Result<()> {
        self.memory.reserve(&self.context, &self.shapes[0], &batch.extent, batch.room)?;
        let held = self.memory.room;
        batch.steps.iter_mut().for_each(|p| p.params.set_room(held));
        Ok(())
    }

    /// Has the device say how far a batch came that was submitted.
    pub(super) fn begin_report(&self, batch: &Batch) -> Result<Reading<u32>> {
        let losses = 12 * batch.last.blocks_total as usize;
        Ok(self
            .context
            .begin_reading("training", &[(&self.memory.state, STATE_WORDS), (&self.memory.block_losses.buffer, losses)])?)
    }

    /// Waits for what was submitted of a batch; nothing to report where steps are left for lack of room.
    pub(super) fn absorb(&mut self, batch: &mut Batch, reading: Reading<u32>) -> Result<Option<StepReport>> {
        let begin = Instant::now();
        let read = reading.finish(&self.context)?;
        self.clock.host.waiting_s += begin.elapsed().as_secs_f64();
        let (state, last) = (&read[0], &batch.last);
        self.clock.settle(&self.context, state[STEPS] as usize)?;
        batch.done += state[STEPS] as usize;
        if state[FAILED] != 0 {
            batch.ask(state, self.memory.room, &self.context, &self.shapes);
            self.clock.host.repeated += 1;
            return Ok(None);
        }
        if batch.done < batch.steps.len() {
            return Err(Error::invalid("gpu, training", "a step neither ran nor failed", "this is a defect of the driver"));
        }
        let host = &mut self.clock.host;
        host.batches += 1;
        host.visible += u64::from(state[VISIBLE]);
        host.pairs += u64::from(state[NEEDED]);
        self.last = Counts {
            visible: state[VISIBLE] as usize,
            pairs: state[NEEDED] as usize,
            pixels: last.pixel_total as usize,
            target_bytes: last.grids.iter().map(GridParams::target_bytes).sum(),
            tiles: last.tile_total as usize,
            fused: last.fused == 1,
            shape: last.shape as usize,
        };
        Ok(Some(report_of(last, state[VISIBLE] as usize, &read[1], self.optimizer.ssim_weight)))
    }

    /// Records and submits steps.
    fn submit(&mut self, steps: &[Planned], destination: Destination<'_>) -> Result<()> {
        self.keyframe_cache.announce(steps.iter().map(|s| s.view.0));
        let context = &self.context;
        let uniforms = Uniforms::new(context, steps.iter().map(|s| &s.params))?;
        let uniform = &uniforms.buffer;
        let (n, m) = (self.store.len(), &self.memory);
        m.reset(context, n);
        let forward = self.forward.bind(context, uniform, self.store.values(), m, Leaves::Checkpoints)?;
        let training = self.bind_training(uniform, self.store.values(), destination)?;
        let mut losses = BTreeMap::new();
        // The device begins with the first few while more are recorded, and their keyframes come.
        let (mut done, mut many) = (0, FIRST_STEPS);
        while done < steps.len() {
            let some = &steps[done..steps.len().min(done + many)];
            let views: Vec<usize> = some.iter().map(|s| s.view.0).collect();
            let some = &some[..self.keyframe_cache.bring(context, &views)?];
            self.bind_losses(uniform, some, &mut losses)?;
            let stamps = (some.len() * (STAGES.len() + 1)) as u32;
            let clock = self.timing.then(|| Timestamps::new(context, stamps)).transpose()?;
            let mut encoder = context.encoder();
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                let mut stamped = 0;
                let mut mark = |pass: &mut wgpu::ComputePass<'_>| {
                    if let Some(clock) = &clock {
                        pass.write_timestamp(clock.queries(), stamped);
                        stamped += 1;
                    }
                };
                for (k, step) in some.iter().enumerate() {
                    let offset = uniforms.offset(done + k);
                    mark(&mut pass);
                    forward.record(&mut pass, &step.params, offset, n, m, &mut mark);
                    training.record(&mut pass, step, losses.get(&step.view.0), offset, m, &mut mark);
                    if let Some(momentum) = &training.momentum {
                        let g = usize::from(step.params.grids[1].size[0] > 0);
                        let words = n * (CORE + self.store.harmonics[g].words()) / 4;
                        momentum[g].run(&mut pass, offset, words.div_ceil(256) as u32);
                    }
                    mark(&mut pass);
                }
            }
            if let Some(clock) = &clock {
                clock.resolve(&mut encoder, stamps);
            }
            context.submit(encoder);
            if let Some(clock) = clock {
                self.clock.expect(clock.begin_reading(context, stamps)?, some.iter().map(|s| &s.params), done > 0);
                self.clock.host.submissions += 1;
            }
            done += some.len();
            many = (2 * many).min(STEPS_PER_SUBMISSION);
        }
        Ok(context.check("training")?)
    }

    /// The gradient of a step's loss with respect to every parameter, in the shape of the parameters, without taking the step.
    ///
    /// # Errors
    /// Those of [`Device::train`](crate::Device::train).
    pub fn gradients(&mut self, step: &Step) -> Result<(StepReport, Gaussians)> {
        self.ready()?;
        let [light, radio] = self.store.harmonics.map(HarmonicsShape::words);
        let sizes = [CORE, light, radio].map(|words| (4 * words * self.store.len()) as u64);
        let mut gradients = vec![];
        let mut encoder = self.context.encoder();
        for size in sizes {
            let buffer = self.context.storage("gradients", size)?;
            encoder.clear_buffer(&buffer, 0, None);
            gradients.push(buffer);
        }
        self.context.submit(encoder);
        let buffers = [&gradients[0], &gradients[1], &gradients[2]];
        let report = self.run(std::slice::from_ref(step), Destination::Written(buffers))?;
        Ok((report, self.store.read(&self.context, buffers)?))
    }
}

/// Losses from the sums of S, |x − y| and confidence·|I − target| over the three channels of each block.
fn report_of(p: &Params, visible: usize, blocks: &[u32], ssim_weight: f32) -> StepReport {
    let mut sums = [[0.0_f64; 3]; 2];
    for (channel, words) in blocks.chunks_exact(4).enumerate() {
        let g = usize::from(p.grids[1].size[0] > 0 && channel / 3 >= p.grids[1].first_block as usize);
        for (sum, word) in sums[g].iter_mut().zip(words) {
            *sum += f64::from(f32::from_bits(*word));
        }
    }
    let gamma = f64::from(ssim_weight);
    let loss = |g: usize| {
        let grid = &p.grids[g];
        let values = f64::from(grid.size[0]) * f64::from(grid.size[1]) * f64::from(grid.channels);
        if values == 0.0 {
            return 0.0;
        }
        let [similarity, difference, _] = sums[g];
        ((1.0 - gamma) * difference / values + gamma * (1.0 - similarity / values)) as f32
    };
    let light_pixels = f64::from(p.grids[0].size[0]) * f64::from(p.grids[0].size[1]);
    let depth_loss = if p.grids[0].depth_scale > 0.0 { (sums[0][2] / light_pixels) as f32 } else { 0.0 };
    StepReport { light_loss: loss(0), radio_loss: loss(1), depth_loss, visible }
}
