//! NeRF² on a GPU.
//!
//! Rays are taken in chunks, so that the activations of a chunk's points, which the backward pass needs, have a bounded size; a step is one
//! submission of all its chunks. The next one is prepared while it runs.

use super::trainer::{Nerf2Trainer, check_rays};
use super::{Batch, Nerf2Config, Nerf2Model, PixelRay};
use crate::mlp::gpu::{ENCODING, GpuNetwork, LANES, most_rows, vectors};
use crate::mlp::{Adam, Trained};
use corf::{Error, Result};
use corf_gpu::{AdapterOptions, Bound, Context, Kernel, SIN_COS, UNIFORM_STRIDE, record};

/// Most points of a chunk: with the published network their activations and gradients take 1.5 GB.
const POINTS_A_CHUNK: usize = 1 << 16;
/// Most memory for these, bytes.
const MOST_MEMORY: usize = 2 << 30;
/// Numbers of a ray on the GPU: origin and target, direction and the gradient's scale, transmitter and nothing.
const RAY: usize = 12;

/// Trains and evaluates on a GPU, in f32. The same seed gives the same bytes on the same adapter and driver.
pub struct Nerf2GpuTrainer {
    config: Nerf2Config,
    transmitter_m: [f32; 3],
    network: GpuNetwork,
    points: Bound,
    sums: Bound,
    rays: wgpu::Buffer,
    distances: wgpu::Buffer,
    amplitudes: wgpu::Buffer,
    rays_a_chunk: usize,
    chunks: usize,
    /// Targets of the last step.
    targets: Vec<f32>,
    /// Last, for what is made of it to be dropped before.
    context: Context,
}

record! {
    /// Constants of `points.wgsl` and `sums.wgsl`, of one chunk.
    struct Chunk {
        first_ray: u32,
        rays: u32,
        samples: u32,
        frequencies: u32,
        /// Vectors of an encoded position, and of an encoded direction and transmitter.
        position_stride: u32,
        outside_stride: u32,
        /// 0.025 over the end of the ray, or 0.
        last_loss: f32,
        padding: u32,
    }
}

impl Nerf2GpuTrainer {
    /// A network with these parameters; `transmitter_m` is in the world frame.
    ///
    /// # Errors
    /// A configuration out of range, parameters of another network, no adapter or one without memory.
    pub fn new(options: &AdapterOptions, config: &Nerf2Config, transmitter_m: [f32; 3], parameters: &[f32]) -> Result<Self> {
        config.validate()?;
        let context = Context::open(options)?;
        let model = Nerf2Model::new(config);
        let (inputs, layers) = (model.network.inputs().iter().copied(), model.network.layers().iter().map(|l| l.outputs));
        // Inputs once, layers with their gradients.
        let bytes: usize = inputs.chain(layers.clone()).chain(layers).map(|width| 4 * LANES * vectors(width)).sum();
        let points = POINTS_A_CHUNK.min(most_rows(&context, &model.network)).min(MOST_MEMORY / bytes);
        Self::in_chunks(context, config, transmitter_m, parameters, points)
    }

    /// [`Self::new`] with so many points a chunk, or those of one ray.
    pub(super) fn in_chunks(
        context: Context,
        config: &Nerf2Config,
        transmitter_m: [f32; 3],
        parameters: &[f32],
        points: usize,
    ) -> Result<Self> {
        let model = Nerf2Model::new(config);
        Trained::new(parameters.to_vec()).check(model.network.parameters())?;
        let rays_a_chunk = (points / config.samples).clamp(1, config.rays);
        let chunks = config.rays.div_ceil(rays_a_chunk);
        let rays = rays_a_chunk * chunks;
        let network = GpuNetwork::new(
            &context,
            &model.network,
            parameters,
            Adam::with_decay(config.weight_decay),
            rays_a_chunk * config.samples,
        )?;
        let ray_buffer = context.storage("rays", (4 * RAY * rays) as u64)?;
        let distances = context.storage("distances", (4 * config.samples * rays) as u64)?;
        let amplitudes = context.storage("amplitudes", (4 * rays) as u64)?;
        let constants = context.buffer("chunks", UNIFORM_STRIDE * chunks as u64, wgpu::BufferUsages::UNIFORM)?;
        for chunk in 0..chunks {
            let width = model.encoding.width();
            let end = if config.last_sample { (super::rendering::FREE_SPACE_M / f64::from(config.far_m)) as f32 } else { 0.0 };
            let values = Chunk {
                first_ray: (chunk * rays_a_chunk) as u32,
                rays: rays_a_chunk as u32,
                samples: config.samples as u32,
                frequencies: config.frequencies as u32,
                position_stride: vectors(width) as u32,
                outside_stride: vectors(2 * width) as u32,
                last_loss: end,
                padding: 0,
            };
            context.queue.write_buffer(&constants, UNIFORM_STRIDE * chunk as u64, bytemuck::bytes_of(&values));
        }
        let head = Chunk::declaration() + include_str!("shaders/chunk.wgsl") + SIN_COS + ENCODING;
        let [points, sums] = Kernel::all(
            &context,
            [
                ("points of rays", head.clone() + include_str!("shaders/points.wgsl")),
                ("sums along rays", head + include_str!("shaders/sums.wgsl")),
            ],
        )?;
        let uniform = size_of::<Chunk>() as u64;
        let [position, outside] = [&network.inputs[0], &network.inputs[1]];
        let points = points.bind(&context, uniform, &[&constants, &ray_buffer, &distances, position, outside])?;
        let heads = [model.attenuation, model.signal];
        let ([a, s], [da, ds]) = (heads.map(|h| network.values(h)), heads.map(|h| network.head_gradient(h)));
        let sums = sums.bind(&context, uniform, &[&constants, &ray_buffer, &distances, a, s, da, ds, &amplitudes])?;
        Ok(Self {
            config: *config,
            transmitter_m,
            points,
            sums,
            rays: ray_buffer,
            distances,
            amplitudes,
            rays_a_chunk,
            chunks,
            targets: vec![],
            network,
            context,
        })
    }

    /// The gradient of the last step.
    #[cfg(test)]
    pub(super) fn gradient(&self) -> Result<Vec<f32>> {
        self.network.gradient(&self.context)
    }

    /// The adapter's name.
    pub fn adapter(&self) -> &str {
        &self.context.info.name
    }

    /// Waits until everything that was submitted is done.
    ///
    /// # Errors
    /// The device's.
    pub fn wait(&self) -> Result<()> {
        Ok(self.context.wait("training")?)
    }

    /// From rays to their amplitudes, for one chunk.
    fn forward(&self, pass: &mut wgpu::ComputePass<'_>, chunk: usize) {
        let at = (UNIFORM_STRIDE * chunk as u64) as u32;
        let rows = self.network.rows() as u32;
        let vectors_a_point = self.network.inputs.iter().map(|b| b.size() / 16 / u64::from(rows)).sum::<u64>() as u32;
        self.points.run(pass, at, (rows * vectors_a_point).div_ceil(64));
        self.network.forward(pass);
        self.sums.run(pass, at, (self.rays_a_chunk as u32).div_ceil(32));
    }

    /// Sends rays with their targets; `scale` goes before the gradient of each one's squared error. What is left of the last chunk has no weight.
    fn send(&self, rays: &[PixelRay], targets: &[f32], distances: &[f32], scale: f32) {
        let mut numbers = Vec::with_capacity(RAY * self.rays_a_chunk * self.chunks);
        for (ray, target) in rays.iter().zip(targets) {
            let ([ox, oy, oz], [dx, dy, dz]) = (ray.origin_m, ray.direction);
            let [tx, ty, tz] = ray.transmitter_m.unwrap_or(self.transmitter_m);
            numbers.extend([ox, oy, oz, *target, dx, dy, dz, scale, tx, ty, tz, 0.0]);
        }
        let whole = rays.len().next_multiple_of(self.rays_a_chunk);
        numbers.resize(RAY * whole, 0.0);
        let mut lengths = distances.to_vec();
        lengths.resize(self.config.samples * whole, 1.0);
        self.context.fill(&self.rays, 0, &numbers);
        self.context.fill(&self.distances, 0, &lengths);
    }
}

impl Nerf2Trainer for Nerf2GpuTrainer {
    fn step(&mut self, batch: &Batch, rate: f64) -> Result<()> {
        let count = batch.rays.len();
        check_rays(count, batch.distances.len(), self.config.samples)?;
        check_rays(count, batch.targets.len(), 1)?;
        if count > self.config.rays {
            let what = format!("{count} rays where there is room for {}", self.config.rays);
            return Err(Error::invalid("rays", what, "give as many as the configuration says"));
        }
        let mut encoder = self.context.encoder();
        self.network.clear_gradient(&mut encoder);
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            for chunk in 0..count.div_ceil(self.rays_a_chunk) {
                self.forward(&mut pass, chunk);
                self.network.backward(&mut pass);
            }
            self.network.adam(&mut pass);
        }
        // No more than one step is under way: what it would say is heard, and memory for what is sent does not pile up.
        self.wait()?;
        self.send(&batch.rays, &batch.targets, &batch.distances, 2.0 / count as f32);
        self.network.begin_step(&self.context, rate);
        self.context.submit(encoder);
        self.targets.clone_from(&batch.targets);
        Ok(self.context.check("training")?)
    }

    fn loss(&mut self) -> Result<f64> {
        let read = self.context.read::<f32>("reading amplitudes back", &[(&self.amplitudes, self.targets.len())])?;
        let squares = read[0].iter().zip(&self.targets).map(|(a, t)| f64::from(a - t).powi(2));
        Ok(squares.sum::<f64>() / self.targets.len().max(1) as f64)
    }

    fn amplitudes(&mut self, rays: &[PixelRay], distances: &[f32]) -> Result<Vec<f32>> {
        let samples = self.config.samples;
        check_rays(rays.len(), distances.len(), samples)?;
        let at_once = self.rays_a_chunk * self.chunks;
        let mut out = Vec::with_capacity(rays.len());
        for (rays, distances) in rays.chunks(at_once).zip(distances.chunks(at_once * samples)) {
            self.send(rays, &vec![0.0; rays.len()], distances, 0.0);
            let mut encoder = self.context.encoder();
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                (0..rays.len().div_ceil(self.rays_a_chunk)).for_each(|chunk| self.forward(&mut pass, chunk));
            }
            self.context.submit(encoder);
            out.extend(self.context.read::<f32>("reading amplitudes back", &[(&self.amplitudes, rays.len())])?.concat());
        }
        // What was there belonged to the last step.
        self.targets.clear();
        Ok(out)
    }

    fn state(&mut self) -> Result<Trained<f32>> {
        self.network.state(&self.context)
    }

    fn restore(&mut self, state: &Trained<f32>) -> Result<()> {
        self.wait()?;
        let parameters = Nerf2Model::new(&self.config).network.parameters();
        state.check(parameters)?;
        self.network.restore(&self.context, state)
    }
}
