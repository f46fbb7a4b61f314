//! Networks on a GPU: the passes of [`Network`] as WGSL kernels over all rows of a batch at once.
//!
//! Products of large matrices are f32, or of f16 numbers where the context was opened for its adapter's matrix units
//! ([`AdapterOptions::half`](corf_gpu::AdapterOptions)).
//!
//! Arrays are rows of vectors of four numbers; widths are filled up to multiples of four with zeros, which stay zero. Every dispatch and its
//! bindings are made once, for a fixed number of rows.

mod gemm;
mod layout;
mod measure;
mod plan;
#[cfg(test)]
mod tests;

use super::network::{Activation, LayerInput, Network};
use super::{Adam, Trained};
use corf::{Error, Result};
use corf_gpu::{Bound, Context, Kernel, MATRIX_THREADS, UNIFORM_STRIDE, record};
use gemm::{Product, Tile};
use layout::Layout;
use std::collections::HashMap;

pub use measure::{ProductTime, measure_products};

/// WGSL of the frequency encoding, which needs [`corf_gpu::SIN_COS`].
pub(crate) const ENCODING: &str = include_str!("shaders/encoding.wgsl");
// What an adapter is asked for is what the largest tile needs.
const _: () = assert!(Tile::HALF_WIDE.threads() == MATRIX_THREADS);
/// Numbers of a vector.
pub(crate) const LANES: usize = 4;

/// The number that shaders know an activation by.
fn activation_number(activation: Activation) -> u32 {
    match activation {
        Activation::Identity => 0,
        Activation::Relu => 1,
        Activation::LeakyRelu => 2,
        Activation::Sigmoid => 3,
    }
}

/// A kernel bound to its buffers and constants.
pub(crate) struct Dispatch {
    pub bound: Bound,
    pub constants: u32,
    pub groups: u32,
}

impl Dispatch {
    pub fn run(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.bound.run(pass, self.constants, self.groups);
    }
}

/// Kernels of products, each compiled once.
#[derive(Default)]
struct Products(HashMap<(Product, Tile), Kernel>);

impl Products {
    fn get(&mut self, context: &Context, product: Product, tile: Tile) -> Result<&Kernel> {
        use std::collections::hash_map::Entry;
        match self.0.entry((product, tile)) {
            Entry::Occupied(found) => Ok(found.into_mut()),
            Entry::Vacant(place) => Ok(place.insert(Kernel::new(context, product.name(), &gemm::source(product, tile))?)),
        }
    }
}

/// A network with its parameters, optimiser and working memory on a GPU.
pub(crate) struct GpuNetwork {
    network: Network,
    layout: Layout,
    kernels: plan::Kernels,
    rows: usize,
    /// Rows that there is memory for.
    capacity: usize,
    /// Inputs of the network, to be written by others: `rows` rows of vectors, filled up with zeros.
    pub inputs: Vec<wgpu::Buffer>,
    /// Outputs of every layer.
    values: Vec<wgpu::Buffer>,
    /// Gradients in every layer's outputs before its activation; those of heads are to be written by others.
    gradients: Vec<wgpu::Buffer>,
    parameters: wgpu::Buffer,
    moments: [wgpu::Buffer; 2],
    gradient: wgpu::Buffer,
    /// A word that is 0; where another writes anything else, [`Self::adam`] does nothing.
    pub gate: wgpu::Buffer,
    adam: Dispatch,
    adam_constants: wgpu::Buffer,
    forward: Vec<Dispatch>,
    backward: Vec<Dispatch>,
    optimizer: Adam,
    steps: u64,
}

record! {
    /// Constants of `adam.wgsl`.
    struct AdamConstants {
        count: u32,
        /// Over 1 − β₁ᵗ.
        rate: f32,
        /// 1/√(1 − β₂ᵗ).
        root: f32,
        beta1: f32,
        beta2: f32,
        /// 1 − β₁, 1 − β₂.
        gain1: f32,
        gain2: f32,
        epsilon: f32,
        decay: f32,
        padding: u32,
        more_padding: [u32; 2],
    }
}

/// Vectors of a row of so many numbers.
pub(crate) fn vectors(width: usize) -> usize {
    width.div_ceil(LANES)
}

/// Rows of a batch for which an adapter binds what each layer takes.
pub(crate) fn most_rows(context: &Context, network: &Network) -> usize {
    let widths = network.inputs().iter().copied().chain(network.layers().iter().map(|l| l.outputs));
    let bytes = 4 * LANES * vectors(widths.max().unwrap_or(1)).max(1);
    usize::try_from(context.largest_buffer()).unwrap_or(usize::MAX) / bytes
}

impl GpuNetwork {
    /// A network over `rows` rows, with parameters in the order of [`Network`].
    ///
    /// # Errors
    /// An adapter without memory; layers that this is not written for: a sigmoid of a width that has to be filled up in the middle of a network,
    /// or a head with an activation.
    pub fn new(context: &Context, network: &Network, parameters: &[f32], optimizer: Adam, rows: usize) -> Result<Self> {
        check(network)?;
        let layout = Layout::new(network);
        let array = |label: &str| context.storage(label, (16 * layout.len()) as u64);
        let (stored, gradient) = (array("network parameters")?, array("network gradient")?);
        let moments = [array("first moments")?, array("second moments")?];
        let gate = context.storage("gate of a step", 16)?;
        context.fill(&gate, 0, &[0_u32; 4]);
        let adam_kernel =
            Kernel::new(context, "network adam", &(AdamConstants::declaration() + include_str!("shaders/adam.wgsl")))?;
        let adam_constants = context.buffer("adam constants", UNIFORM_STRIDE, wgpu::BufferUsages::UNIFORM)?;
        let buffers = [&adam_constants, &gradient, &stored, &moments[0], &moments[1], &gate];
        let bound = adam_kernel.bind(context, size_of::<AdamConstants>() as u64, &buffers)?;
        let adam = Dispatch { bound, constants: 0, groups: layout.len().div_ceil(64) as u32 };
        let mut made = Self {
            network: network.clone(),
            kernels: plan::Kernels::new(context)?,
            rows: 0,
            capacity: 0,
            inputs: vec![],
            values: vec![],
            gradients: vec![],
            parameters: stored,
            moments,
            gradient,
            gate,
            adam,
            adam_constants,
            forward: vec![],
            backward: vec![],
            optimizer,
            steps: 0,
            layout,
        };
        made.set_rows(context, rows)?;
        made.restore(context, &Trained::new(parameters.to_vec()))?;
        Ok(made)
    }

    /// Makes batches of another number of rows. Inputs, and everything bound to them, to values and to heads, are others afterwards.
    ///
    /// # Errors
    /// An adapter without memory.
    pub fn set_rows(&mut self, context: &Context, rows: usize) -> Result<()> {
        if rows == self.rows {
            return Ok(());
        }
        if rows > self.capacity {
            // The old memory goes before the new comes; an eighth more than is asked for, so that growth by and by does not ask each time, as far as
            // an adapter binds that much.
            (self.rows, self.capacity) = (0, 0);
            for old in [&mut self.inputs, &mut self.values, &mut self.gradients] {
                old.drain(..).for_each(|buffer| buffer.destroy());
            }
            let more = if self.forward.is_empty() { 0 } else { rows / 8 };
            let capacity = (rows + more).min(most_rows(context, &self.network)).max(rows);
            let rows_of = |label: &str, width: usize| -> Result<wgpu::Buffer> {
                Ok(context.storage(label, (16 * capacity * vectors(width)) as u64)?)
            };
            let widths = || self.network.layers().iter().map(|l| l.outputs);
            self.inputs = self.network.inputs().iter().map(|w| rows_of("network inputs", *w)).collect::<Result<_>>()?;
            self.values = widths().map(|w| rows_of("layer outputs", w)).collect::<Result<_>>()?;
            self.gradients = widths().map(|w| rows_of("layer gradients", w)).collect::<Result<_>>()?;
            self.capacity = capacity;
        }
        let buffers = plan::Buffers {
            inputs: &self.inputs,
            values: &self.values,
            gradients: &self.gradients,
            parameters: &self.parameters,
            gradient: &self.gradient,
        };
        (self.forward, self.backward) =
            plan::dispatches(context, &self.network, &self.layout, rows, &buffers, &mut self.kernels)?;
        self.rows = rows;
        Ok(())
    }

    /// Steps taken, or begun.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Rows of a batch.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Outputs of a layer.
    pub fn values(&self, layer: LayerInput) -> &wgpu::Buffer {
        &self.values[number(layer)]
    }

    /// Place for the gradient in a head's outputs, filled up with zeros.
    pub fn head_gradient(&self, head: LayerInput) -> &wgpu::Buffer {
        &self.gradients[number(head)]
    }

    /// Sets the gradient in the parameters to zero.
    pub fn clear_gradient(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.clear_buffer(&self.gradient, 0, None);
    }

    /// Values of all layers from the inputs.
    pub fn forward(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.forward.iter().for_each(|d| d.run(pass));
    }

    /// Adds the gradient in all parameters, from those in the heads' outputs.
    pub fn backward(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.backward.iter().for_each(|d| d.run(pass));
    }

    /// Takes a step with the gradient; [`Self::begin_step`] says how long it is. Nothing where [`Self::gate`] is not 0.
    pub fn adam(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.adam.run(pass);
    }

    /// Sets the constants of the next step, before it is submitted.
    pub fn begin_step(&mut self, context: &Context, rate: f64) {
        self.begin_step_number(context, self.steps + 1, rate);
    }

    /// Sets the constants of step `number`, from 1: one that was begun in vain is begun again.
    pub fn begin_step_number(&mut self, context: &Context, number: u64, rate: f64) {
        self.steps = number;
        let Adam { beta1, beta2, epsilon, weight_decay } = self.optimizer;
        let [rate, root] = self.optimizer.factors(self.steps, rate).map(|v| v as f32);
        let [gain1, gain2] = self.optimizer.gains();
        let constants = AdamConstants {
            count: self.layout.len() as u32,
            rate,
            root,
            beta1: beta1 as f32,
            beta2: beta2 as f32,
            gain1: gain1 as f32,
            gain2: gain2 as f32,
            epsilon: epsilon as f32,
            decay: weight_decay as f32,
            padding: 0,
            more_padding: [0; 2],
        };
        context.queue.write_buffer(&self.adam_constants, 0, bytemuck::bytes_of(&constants));
    }

    /// Parameters and optimiser.
    pub fn state(&self, context: &Context) -> Result<Trained<f32>> {
        let count = LANES * self.layout.len();
        let [first, second] = &self.moments;
        let read =
            context.read::<f32>("reading the network back", &[(&self.parameters, count), (first, count), (second, count)])?;
        let mut arrays = read.iter().map(|a| self.layout.packed(a));
        let mut next = || arrays.next().unwrap_or_default();
        Ok(Trained { parameters: next(), moments: [next(), next()], steps: self.steps })
    }

    /// The gradient that is added up, in the order of [`Network`].
    #[cfg(test)]
    pub fn gradient(&self, context: &Context) -> Result<Vec<f32>> {
        let read = context.read::<f32>("reading the gradient back", &[(&self.gradient, LANES * self.layout.len())])?;
        Ok(self.layout.packed(&read[0]))
    }

    /// Holds a state of this network.
    pub fn restore(&mut self, context: &Context, state: &Trained<f32>) -> Result<()> {
        let [first, second] = &self.moments;
        let [m, v] = &state.moments;
        for (buffer, array) in [(&self.parameters, &state.parameters), (first, m), (second, v)] {
            context.fill(buffer, 0, &self.layout.padded(array));
        }
        self.steps = state.steps;
        Ok(context.check("holding a network")?)
    }
}

fn number(layer: LayerInput) -> usize {
    match layer {
        LayerInput::Layer(l) => l,
        LayerInput::Input(_) => panic!("an input is no layer"),
    }
}

/// Refuses what the kernels are not written for.
fn check(network: &Network) -> Result<()> {
    for (l, layer) in network.layers().iter().enumerate() {
        let inside = !network.is_head(l);
        let filled_up = layer.activation == Activation::Sigmoid && !layer.outputs.is_multiple_of(LANES);
        if (inside && filled_up) || (!inside && layer.activation != Activation::Identity) {
            let what = format!("layer {l} with {} outputs and {:?}", layer.outputs, layer.activation);
            return Err(Error::invalid(
                "gpu network",
                what,
                "use widths that are multiples of 4 and heads without an activation",
            ));
        }
    }
    Ok(())
}
