//! Steps and pictures of Gaussians that another makes of those held: they stand in their place in the rasteriser, which writes the gradient in them.
//! What becomes of the gradient is up to the other as well.

use super::{GpuDevice, frame::Leaves, params::Uniforms, shaders::Gradients, store::CORE, train::Batch, training::Destination};
use crate::{
    Error, Result,
    device::{DenseStep, RenderRequest, Rendering, StepReport},
};
use corf_gpu::{Context, Kernel, Scratch};
use std::collections::BTreeMap;
use std::sync::Arc;

pub use super::shaders::{ADAM, SLOTS};

/// Gaussians in the place of those held, and the gradient in them.
pub(super) struct StandIns {
    core: Scratch,
    radio: Scratch,
    /// In geometry and opacities, optical harmonics (which nothing reads) and RF harmonics.
    gradients: [Scratch; 3],
    /// Whether pictures are made of them.
    shown: bool,
}

/// Buffers that a deformation reads and writes: three vectors of geometry and opacities a Gaussian, and one of RF harmonics, of degree 0.
pub struct Buffers<'a> {
    /// State of the frame; what has failed must change nothing (`FAILED` in [`SLOTS`]).
    pub state: &'a wgpu::Buffer,
    /// Those held: geometry and opacities, with Adam's two moments.
    pub core: [&'a wgpu::Buffer; 3],
    /// Those held: RF harmonics, with Adam's moments, a row's first ones before its second ones.
    pub radio: [&'a wgpu::Buffer; 2],
    /// Those that stand in their place: geometry and opacities, RF harmonics.
    pub stand_ins: [&'a wgpu::Buffer; 2],
    /// The gradient in these, zero where they are not seen.
    pub gradients: [&'a wgpu::Buffer; 2],
    /// Number of Gaussians.
    pub gaussians: usize,
}

/// Makes stand-ins, and steps what they are made of by their gradient.
pub trait DeformationPass {
    /// Binds the buffers of the steps, or the picture, to come.
    fn bind(&mut self, context: &Context, buffers: &Buffers<'_>) -> Result<()>;

    /// Writes the constants of one of these steps, by its place among them; it is submitted before the next one's are written.
    fn prepare(&mut self, context: &Context, step: usize);

    /// Clears what a step adds to.
    fn clear(&self, encoder: &mut wgpu::CommandEncoder);

    /// Makes the stand-ins.
    fn forward(&self, pass: &mut wgpu::ComputePass<'_>);

    /// Takes the step.
    fn backward(&self, pass: &mut wgpu::ComputePass<'_>);
}

impl StandIns {
    fn new(context: &Context) -> Result<Self> {
        let scratch = |label| Scratch::new(context, label);
        let gradients = [scratch("gradient of geometry")?, scratch("gradient of light")?, scratch("gradient of RF")?];
        Ok(Self { core: scratch("stand-in geometry")?, radio: scratch("stand-in RF")?, gradients, shown: false })
    }
}

impl GpuDevice {
    /// The context that other work on this device shares.
    pub fn context(&self) -> &Arc<Context> {
        &self.context
    }

    /// What pictures are made of.
    pub(super) fn values(&self) -> [&wgpu::Buffer; 3] {
        let [_, light, _] = self.store.values();
        match &self.stand_ins {
            Some(s) if s.shown => [&s.core.buffer, light, &s.radio.buffer],
            _ => self.store.values(),
        }
    }

    /// Makes room for stand-ins.
    fn reserve_stand_ins(&mut self) -> Result<()> {
        let (n, h) = (self.store.len().max(1), self.store.harmonics);
        if h[1].words() != 4 || h[1].degree != 0 {
            let what = format!("RF harmonics of degree {}", h[1].degree);
            return Err(Error::invalid(self.context.info.name.clone(), what, "deformed Gaussians are of degree 0"));
        }
        let context = self.context.clone();
        let s = match &mut self.stand_ins {
            Some(s) => s,
            None => self.stand_ins.insert(StandIns::new(&context)?),
        };
        let [core, light, radio] = &mut s.gradients;
        for (scratch, words) in
            [(&mut s.core, CORE), (&mut s.radio, 4), (core, CORE), (light, h[0].words()), (radio, h[1].words())]
        {
            scratch.reserve(&context, n, 4 * words)?;
        }
        Ok(())
    }

    fn bind_deformation(&self, s: &StandIns, deformation: &mut dyn DeformationPass) -> Result<()> {
        let (c, sh) = (&self.store.core, &self.store.sh[1]);
        let buffers = Buffers {
            state: &self.memory.state,
            core: [&c.value.buffer, &c.moment1.buffer, &c.moment2.buffer],
            radio: [&sh.value.buffer, &sh.moments.buffer],
            stand_ins: [&s.core.buffer, &s.radio.buffer],
            gradients: [&s.gradients[0].buffer, &s.gradients[2].buffer],
            gaussians: self.store.len(),
        };
        deformation.bind(&self.context, &buffers)
    }

    /// Takes steps of deformed Gaussians in order, however often room has to be made, and reports the last.
    pub fn train_deformed(&mut self, steps: &[DenseStep], deformation: &mut dyn DeformationPass) -> Result<StepReport> {
        self.ready()?;
        steps.iter().try_for_each(DenseStep::check)?;
        if self.training.noted.is_none() {
            let source = self.shapes[0].update_geometry(Gradients::Noted);
            self.training.noted = Some(Kernel::new(&self.context, "noted gradients of geometry", &source)?);
        }
        self.prepare_marks()?;
        self.reserve_stand_ins()?;
        let planned = steps.iter().map(|dense| self.plan_dense(dense)).collect::<Result<_>>()?;
        let Some(mut batch) = self.batch(planned) else { return Ok(StepReport::default()) };
        loop {
            self.make_room(&mut batch)?;
            let stand_ins = self.stand_ins.take();
            let submitted = stand_ins.as_ref().map_or(Ok(()), |s| self.submit_deformed(&batch, s, deformation));
            self.stand_ins = stand_ins;
            submitted?;
            let reading = self.begin_report(&batch)?;
            if let Some(report) = self.absorb(&mut batch, reading)? {
                return Ok(report);
            }
        }
    }

    /// Records and submits what is left of a batch, a step at a time: constants of a deformation are one step's.
    fn submit_deformed(&mut self, batch: &Batch, s: &StandIns, deformation: &mut dyn DeformationPass) -> Result<()> {
        let steps = &batch.steps[batch.done..];
        self.keyframe_cache.announce(steps.iter().map(|s| s.view.0));
        let (context, m, n) = (&self.context, &self.memory, self.store.len());
        let uniforms = Uniforms::new(context, steps.iter().map(|s| &s.params))?;
        m.reset(context, n);
        let values = [&s.core.buffer, self.store.values()[1], &s.radio.buffer];
        let forward = self.forward.bind(context, &uniforms.buffer, values, m, Leaves::Checkpoints)?;
        let gradients = s.gradients.each_ref().map(|g| &g.buffer);
        let training = self.bind_training(&uniforms.buffer, values, Destination::Noted(gradients))?;
        let mut losses = BTreeMap::new();
        self.bind_deformation(s, deformation)?;
        for (k, step) in steps.iter().enumerate() {
            self.keyframe_cache.bring(context, &[step.view.0])?;
            self.bind_losses(&uniforms.buffer, std::slice::from_ref(step), &mut losses)?;
            deformation.prepare(context, batch.done + k);
            let mut encoder = context.encoder();
            // Only what is seen is written.
            gradients.iter().for_each(|g| encoder.clear_buffer(g, 0, None));
            deformation.clear(&mut encoder);
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                deformation.forward(&mut pass);
                forward.record(&mut pass, &step.params, uniforms.offset(k), n, m, &mut |_| {});
                training.record(&mut pass, step, losses.get(&step.view.0), uniforms.offset(k), m, &mut |_| {});
                deformation.backward(&mut pass);
            }
            context.submit(encoder);
        }
        Ok(context.check("training deformed Gaussians")?)
    }

    /// Renders deformed Gaussians.
    pub fn render_deformed(&mut self, request: &RenderRequest, deformation: &mut dyn DeformationPass) -> Result<Rendering> {
        self.ready()?;
        self.reserve_stand_ins()?;
        let Some(s) = &self.stand_ins else { return Ok(Rendering::default()) };
        self.bind_deformation(s, deformation)?;
        deformation.prepare(&self.context, 0);
        let mut encoder = self.context.encoder();
        deformation.forward(&mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()));
        self.context.submit(encoder);
        self.show_stand_ins(true);
        let rendering = self.render_request(request);
        self.show_stand_ins(false);
        rendering
    }

    fn show_stand_ins(&mut self, shown: bool) {
        if let Some(s) = &mut self.stand_ins {
            s.shown = shown;
        }
    }
}
