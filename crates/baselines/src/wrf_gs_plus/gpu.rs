//! WRF-GS+ on a GPU: the network runs over all Gaussians before and behind the rasteriser, and everything stays on the device.
//!
//! Where there are more Gaussians than the activations of which are held at once, they go through the network in chunks, and their forward pass is
//! taken again before their backward pass.

use super::trainer::{DeformedStep, NETWORK_ADAM, WrfGsPlusTrainer};
use super::{WrfGsPlusConfig, WrfGsPlusModel};
use crate::mlp::Trained;
use crate::mlp::gpu::{ENCODING, GpuNetwork, vectors};
use corf::device::gpu::deformed::{ADAM, Buffers, DeformationPass, SLOTS};
use corf::device::gpu::{GpuDevice, GpuOptions};
use corf::device::{DenseStep, Device, Planes, RenderRequest, StepReport, View};
use corf::{Error, OptimizerConfig, Result};
use corf_gpu::{AdapterOptions, Bound, Context, GROUP_NUMBER, Kernel, SIN_COS, UNIFORM_STRIDE, record};

/// Most Gaussians of a chunk: with the published network their activations and gradients take 5.2 GB.
const MOST_ROWS: usize = 1 << 18;

/// Trains and renders on a GPU, in f32. The same seed gives the same bytes on the same adapter and driver.
pub struct WrfGsPlusGpuTrainer {
    deforming: Deforming,
    /// Last, for what is made of it to be dropped before.
    device: GpuDevice,
}

/// The network with the kernels around it.
struct Deforming {
    config: WrfGsPlusConfig,
    optimizer: OptimizerConfig,
    model: WrfGsPlusModel,
    network: GpuNetwork,
    encode: Kernel,
    deform: Kernel,
    pull_back: Kernel,
    bound: Option<BoundDeforming>,
    most_rows: usize,
    /// The steps, or the receiver of a picture, that are at hand.
    steps: Vec<DeformedStep>,
    receiver_m: [f32; 3],
    /// Steps of the network before these.
    before: u64,
}

/// The kernels bound to their buffers; valid until the Gaussians held change.
struct BoundDeforming {
    encode: Bound,
    deform: Bound,
    pull_back: Bound,
    constants: wgpu::Buffer,
    gaussians: usize,
    chunks: usize,
}

record! {
    /// Constants of a step for the Gaussians of one chunk.
    struct Chunk {
        /// Position, metres.
        receiver: [f32; 4],
        /// The first Gaussian.
        first: u32,
        /// Of the network's inputs.
        rows: u32,
        /// In all.
        gaussians: u32,
        move_positions: u32,
        position_frequencies: u32,
        receiver_frequencies: u32,
        /// Vectors of an encoded position, and of an encoded receiver.
        position_stride: u32,
        receiver_stride: u32,
        /// Of dense Adam.
        position_rate: f32,
        rotation_rate: f32,
        log_scale_rate: f32,
        opacity_rate: f32,
        signal_rate: f32,
        beta1: f32,
        beta2: f32,
        epsilon: f32,
    }
}

impl WrfGsPlusGpuTrainer {
    /// No Gaussians yet, and a network with these parameters.
    ///
    /// # Errors
    /// A configuration out of range, parameters of another network, no adapter or one without memory.
    pub fn new(adapter: &AdapterOptions, config: &WrfGsPlusConfig, parameters: &[f32]) -> Result<Self> {
        Self::in_chunks(&GpuOptions::on(*adapter), config, parameters, MOST_ROWS)
    }

    /// [`Self::new`] with at most so many Gaussians a chunk.
    pub(super) fn in_chunks(
        options: &GpuOptions,
        config: &WrfGsPlusConfig,
        parameters: &[f32],
        most_rows: usize,
    ) -> Result<Self> {
        config.validate()?;
        let model = WrfGsPlusModel::new(config);
        Trained::new(parameters.to_vec()).check(model.network.parameters())?;
        let device = GpuDevice::new(options, config.optimizer(), config.raster(), &config.empty_field())?;
        let context = device.context();
        let head = GROUP_NUMBER.to_owned() + SLOTS + &Chunk::declaration() + include_str!("shaders/head.wgsl");
        let [encode, deform, pull_back] = Kernel::all(
            context,
            [
                ("encode Gaussians", head.clone() + SIN_COS + ENCODING + include_str!("shaders/encode.wgsl")),
                ("deform Gaussians", head.clone() + include_str!("shaders/deform.wgsl")),
                ("step deformed Gaussians", head + ADAM + include_str!("shaders/pull_back.wgsl")),
            ],
        )?;
        let network = GpuNetwork::new(context, &model.network, parameters, NETWORK_ADAM, 1)?;
        let most_rows = most_rows.min(crate::mlp::gpu::most_rows(context, &model.network)).max(1);
        let deforming = Deforming {
            config: config.clone(),
            optimizer: config.optimizer(),
            model,
            network,
            encode,
            deform,
            pull_back,
            bound: None,
            most_rows,
            steps: vec![],
            receiver_m: [0.0; 3],
            before: 0,
        };
        Ok(Self { deforming, device })
    }
}

impl Deforming {
    /// Constants of one chunk of a step, or of a picture, which has no rates.
    fn chunk(&self, bound: &BoundDeforming, chunk: usize, receiver_m: [f32; 3], rates: &OptimizerConfig) -> Chunk {
        let [x, y, z] = receiver_m;
        Chunk {
            receiver: [x, y, z, 0.0],
            first: (chunk * self.network.rows()) as u32,
            rows: self.network.rows() as u32,
            gaussians: bound.gaussians as u32,
            move_positions: u32::from(self.config.move_positions),
            position_frequencies: self.config.position_frequencies as u32,
            receiver_frequencies: self.config.receiver_frequencies as u32,
            position_stride: vectors(self.model.of_position.width()) as u32,
            receiver_stride: vectors(self.model.of_receiver.width()) as u32,
            position_rate: rates.position_rate_m,
            rotation_rate: rates.rotation_rate,
            log_scale_rate: rates.log_scale_rate,
            opacity_rate: rates.radio.opacity,
            signal_rate: rates.radio.sh_dc,
            beta1: rates.beta1,
            beta2: rates.beta2,
            epsilon: rates.epsilon,
        }
    }

    /// The network's values of one chunk.
    fn chunk_forward(&self, pass: &mut wgpu::ComputePass<'_>, bound: &BoundDeforming, chunk: usize) {
        let stride = vectors(self.model.of_position.width()) + vectors(self.model.of_receiver.width());
        bound.encode.run(pass, offset(chunk), (self.network.rows() * stride).div_ceil(64) as u32);
        self.network.forward(pass);
    }
}

/// Place of a chunk's constants.
fn offset(chunk: usize) -> u32 {
    (UNIFORM_STRIDE * chunk as u64) as u32
}

impl DeformationPass for Deforming {
    fn bind(&mut self, context: &Context, b: &Buffers<'_>) -> Result<()> {
        let chunks = b.gaussians.div_ceil(self.most_rows).max(1);
        self.network.set_rows(context, b.gaussians.div_ceil(chunks).max(1))?;
        let constants = context.buffer("chunks of Gaussians", UNIFORM_STRIDE * chunks as u64, wgpu::BufferUsages::UNIFORM)?;
        let n = &self.network;
        let ([core, core_m, core_v], [radio, radio_moments]) = (b.core, b.radio);
        let [dp, ds, dr, dc] = self.model.heads().map(|h| n.values(h));
        let [gp, gs, gr, gc] = self.model.heads().map(|h| n.head_gradient(h));
        let bind = |kernel: &Kernel, buffers: &[&wgpu::Buffer]| kernel.bind(context, size_of::<Chunk>() as u64, buffers);
        let [core_gradient, radio_gradient] = b.gradients;
        let stepped = [&constants, b.state, core, core_m, core_v, radio, radio_moments, core_gradient, radio_gradient];
        let pull_back = [&stepped[..], &[ds, gp, gs, gr, gc, &n.gate]].concat();
        self.bound = Some(BoundDeforming {
            encode: bind(&self.encode, &[&constants, core, &n.inputs[0], &n.inputs[1]])?,
            deform: bind(&self.deform, &[&constants, core, radio, dp, ds, dr, dc, b.stand_ins[0], b.stand_ins[1]])?,
            pull_back: bind(&self.pull_back, &pull_back)?,
            constants,
            gaussians: b.gaussians,
            chunks,
        });
        Ok(())
    }

    fn prepare(&mut self, context: &Context, step: usize) {
        let (receiver_m, rates) = match self.steps.get(step) {
            Some(s) => {
                self.network.begin_step_number(context, self.before + step as u64 + 1, s.network_rate);
                (s.receiver_m, s.dense.constants(&self.optimizer))
            }
            None => (self.receiver_m, self.optimizer),
        };
        if let Some(bound) = &self.bound {
            for chunk in 0..bound.chunks {
                let constants = self.chunk(bound, chunk, receiver_m, &rates);
                context.queue.write_buffer(&bound.constants, u64::from(offset(chunk)), bytemuck::bytes_of(&constants));
            }
        }
    }

    fn clear(&self, encoder: &mut wgpu::CommandEncoder) {
        self.network.clear_gradient(encoder);
    }

    fn forward(&self, pass: &mut wgpu::ComputePass<'_>) {
        let Some(bound) = &self.bound else { return };
        for chunk in 0..bound.chunks {
            self.chunk_forward(pass, bound, chunk);
            bound.deform.run(pass, offset(chunk), self.network.rows().div_ceil(64) as u32);
        }
    }

    fn backward(&self, pass: &mut wgpu::ComputePass<'_>) {
        let Some(bound) = &self.bound else { return };
        for chunk in 0..bound.chunks {
            if bound.chunks > 1 {
                // Only the last one's values are still there.
                self.chunk_forward(pass, bound, chunk);
            }
            bound.pull_back.run(pass, offset(chunk), self.network.rows().div_ceil(64) as u32);
            self.network.backward(pass);
        }
        self.network.adam(pass);
    }
}

impl WrfGsPlusTrainer for WrfGsPlusGpuTrainer {
    fn device(&mut self) -> &mut dyn Device {
        &mut self.device
    }

    fn train(&mut self, steps: &[DeformedStep]) -> Result<StepReport> {
        let dense: Vec<DenseStep> = steps.iter().map(|s| s.dense).collect();
        self.deforming.before = self.deforming.network.steps();
        self.deforming.steps = steps.to_vec();
        self.device.train_deformed(&dense, &mut self.deforming)
    }

    fn render(&mut self, view: &View, background: [f32; 3]) -> Result<Planes> {
        self.deforming.steps.clear();
        self.deforming.receiver_m = view.world_from_camera.translation.as_vec3().to_array();
        let request = RenderRequest { radio: Some((*view, background)), ..RenderRequest::default() };
        let rendering = self.device.render_deformed(&request, &mut self.deforming)?;
        let layer = rendering
            .radio
            .ok_or_else(|| Error::invalid(self.device.name(), "the device rendered no RF", "this is a defect of the device"));
        Ok(layer?.color)
    }

    fn network(&mut self) -> Result<Trained<f32>> {
        self.deforming.network.state(self.device.context())
    }

    fn restore_network(&mut self, state: &Trained<f32>) -> Result<()> {
        state.check(self.deforming.model.network.parameters())?;
        self.deforming.network.restore(self.device.context(), state)
    }
}
