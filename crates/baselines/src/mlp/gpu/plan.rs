//! The dispatches of a network's forward and backward pass.

use super::super::network::{Activation, LayerInput, Network};
use super::gemm::{Arithmetic, Product, ROWS_A_PART, Shape, Tile};
use super::layout::Layout;
use super::{Dispatch, LANES, Products, activation_number, vectors};
use corf::Result;
use corf_gpu::{Bound, Context, Kernel, UNIFORM_STRIDE, record};

/// Buffers that a network's passes read and write.
pub(super) struct Buffers<'a> {
    pub inputs: &'a [wgpu::Buffer],
    pub values: &'a [wgpu::Buffer],
    pub gradients: &'a [wgpu::Buffer],
    pub parameters: &'a wgpu::Buffer,
    pub gradient: &'a wgpu::Buffer,
}

impl<'a> Buffers<'a> {
    fn of(&self, source: LayerInput) -> &'a wgpu::Buffer {
        match source {
            LayerInput::Input(i) => &self.inputs[i],
            LayerInput::Layer(l) => &self.values[l],
        }
    }
}

record! {
    /// Constants of `reduce.wgsl`.
    struct Sum {
        rows: u32,
        columns: u32,
        parts: u32,
        part_stride: u32,
        weights_first: u32,
        weights_stride: u32,
        /// 0: the biases have had their turn.
        with_bias: u32,
        bias_first: u32,
    }
}

/// Parts in which the largest number of a head's gradient is looked for.
const GROUPS: usize = 64;

/// What products in half precision need beside their own kernels: the scale of gradients ([`super::gemm`], `half.rs`).
pub(super) struct Scaling {
    largest: Kernel,
    scale: Kernel,
    /// The scale and its inverse.
    pub value: wgpu::Buffer,
}

impl Scaling {
    pub fn new(context: &Context) -> Result<Self> {
        let head = include_str!("shaders/largest_of_group.wgsl");
        let largest = format!("const GROUPS = {GROUPS}u;\n{head}{}", include_str!("shaders/largest.wgsl"));
        let [largest, scale] = Kernel::all(
            context,
            [("largest gradient", largest), ("scale of gradients", head.to_owned() + include_str!("shaders/scale.wgsl"))],
        )?;
        Ok(Self { largest, scale, value: context.storage("scale of gradients", 16)? })
    }
}

/// Compiled kernels of a network's passes, whatever the number of rows.
pub(super) struct Kernels {
    products: Products,
    reduce: Kernel,
    /// There where products are in half precision.
    scaling: Option<Scaling>,
}

impl Kernels {
    /// For the arithmetic that the context was opened for.
    pub fn new(context: &Context) -> Result<Self> {
        let reduce =
            Kernel::new(context, "sum of weight gradients", &(Sum::declaration() + include_str!("shaders/reduce.wgsl")))?;
        let scaling = context.matrix_units.then(|| Scaling::new(context)).transpose()?;
        Ok(Self { products: Products::default(), reduce, scaling })
    }

    fn arithmetic(&self) -> Arithmetic {
        if self.scaling.is_some() { Arithmetic::Half } else { Arithmetic::Single }
    }
}

/// Collects dispatches and the constants of each.
struct Planner<'a> {
    context: &'a Context,
    kernels: &'a mut Kernels,
    constants: wgpu::Buffer,
    used: u64,
}

impl Planner<'_> {
    /// Writes constants behind those before; says where.
    fn constants(&mut self, bytes: &[u8]) -> u32 {
        let at = self.used;
        self.context.queue.write_buffer(&self.constants, at, bytes);
        self.used += UNIFORM_STRIDE;
        at as u32
    }

    /// One product; `buffers` are A, B, the extra one and C.
    fn product(&mut self, product: Product, shape: &Shape, buffers: [&wgpu::Buffer; 4]) -> Result<Dispatch> {
        let tile = Tile::of(product, shape.rows, shape.columns, self.kernels.arithmetic());
        let constants = self.constants(bytemuck::bytes_of(shape));
        let kernel = self.kernels.products.get(self.context, product, tile)?;
        let scale = self.kernels.scaling.as_ref().filter(|_| tile.scales(product)).map(|s| &s.value);
        let bound = bind_product(self.context, kernel, &self.constants, buffers, scale)?;
        Ok(Dispatch { bound, constants, groups: tile.count(shape.rows, shape.columns) * shape.parts() })
    }
}

/// A product's kernel with its buffers; with that of the scale, where the tile scales the product's gradients.
pub(super) fn bind_product(
    context: &Context,
    kernel: &Kernel,
    constants: &wgpu::Buffer,
    [a, b, extra, c]: [&wgpu::Buffer; 4],
    scale: Option<&wgpu::Buffer>,
) -> Result<Bound> {
    let buffers: Vec<_> = [constants, a, b, extra, c].into_iter().chain(scale).collect();
    Ok(kernel.bind(context, size_of::<Shape>() as u64, &buffers)?)
}

/// Numbers of a row, filled up to whole vectors.
fn filled(width: usize) -> u32 {
    (LANES * vectors(width)) as u32
}

/// The dispatches of both passes over `rows` rows.
pub(super) fn dispatches(
    context: &Context,
    network: &Network,
    layout: &Layout,
    rows: usize,
    buffers: &Buffers<'_>,
    kernels: &mut Kernels,
) -> Result<(Vec<Dispatch>, Vec<Dispatch>)> {
    let edges: usize = network.layers().iter().map(|l| l.sources.len()).sum();
    // A forward product, a data gradient, a weight gradient and its sum for each edge; the largest gradient of each head and of all.
    let most = 4 * edges + network.layers().len() + 1;
    let constants = context.buffer("network constants", UNIFORM_STRIDE * most as u64, wgpu::BufferUsages::UNIFORM)?;
    let mut planner = Planner { context, kernels, constants, used: 0 };
    let forward = forward(&mut planner, network, layout, rows, buffers)?;
    let mut all_backward = scale(&mut planner, network, rows, buffers)?;
    all_backward.extend(backward(&mut planner, network, layout, rows, buffers)?);
    context.check("planning a network")?;
    Ok((forward, all_backward))
}

/// The scale of gradients from those of the heads; nothing in single precision.
fn scale(p: &mut Planner<'_>, network: &Network, rows: usize, buffers: &Buffers<'_>) -> Result<Vec<Dispatch>> {
    if p.kernels.scaling.is_none() {
        return Ok(vec![]);
    }
    let heads: Vec<usize> = (0..network.layers().len()).filter(|l| network.is_head(*l)).collect();
    let parts = p.context.storage("parts of the largest gradient", (4 * GROUPS * heads.len()) as u64)?;
    let mut constants = vec![];
    for (k, head) in heads.iter().enumerate() {
        let vectors = rows * vectors(network.layers()[*head].outputs);
        constants.push(p.constants(bytemuck::bytes_of(&[vectors as u32, (k * GROUPS) as u32, 0, 0])));
    }
    let count = p.constants(bytemuck::bytes_of(&[(GROUPS * heads.len()) as u32, 0, 0, 0]));
    let Some(scaling) = &p.kernels.scaling else { return Ok(vec![]) };
    let mut out = vec![];
    for (head, constants) in heads.iter().zip(constants) {
        let bound = scaling.largest.bind(p.context, 16, &[&p.constants, &buffers.gradients[*head], &parts])?;
        out.push(Dispatch { bound, constants, groups: GROUPS as u32 });
    }
    let bound = scaling.scale.bind(p.context, 16, &[&p.constants, &parts, &scaling.value])?;
    out.push(Dispatch { bound, constants: count, groups: 1 });
    Ok(out)
}

fn forward(p: &mut Planner<'_>, network: &Network, layout: &Layout, rows: usize, buffers: &Buffers<'_>) -> Result<Vec<Dispatch>> {
    let mut out = vec![];
    for ((layer, place), value) in network.layers().iter().zip(&layout.layers).zip(buffers.values) {
        for (k, source) in layer.sources.iter().enumerate() {
            let width = network.width(*source);
            let shape = Shape {
                rows: rows as u32,
                columns: filled(layer.outputs),
                inner: filled(width),
                part: filled(width),
                a_stride: vectors(width) as u32,
                b_first: (place.weights + place.columns[k]) as u32,
                b_stride: place.stride as u32,
                c_stride: vectors(layer.outputs) as u32,
                extra_first: place.bias as u32,
                activation: activation_number(layer.activation),
                accumulate: u32::from(k > 0),
                finish: u32::from(k + 1 == layer.sources.len()),
                ..Shape::default()
            };
            let x = buffers.of(*source);
            out.push(p.product(Product::Forward, &shape, [x, buffers.parameters, buffers.parameters, value])?);
        }
    }
    Ok(out)
}

fn backward(
    p: &mut Planner<'_>,
    network: &Network,
    layout: &Layout,
    rows: usize,
    buffers: &Buffers<'_>,
) -> Result<Vec<Dispatch>> {
    let parts = (rows as u32).div_ceil(ROWS_A_PART);
    let most = network.layers().iter().flat_map(|l| l.sources.iter().map(|s| part_vectors(l.outputs, network.width(*s)))).max();
    let partial = p.context.storage("parts of weight gradients", 16 * u64::from(parts) * most.unwrap_or(0) as u64)?;
    let readers = |l: usize| network.layers().iter().filter(|other| other.sources.contains(&LayerInput::Layer(l))).count();
    let mut left: Vec<usize> = (0..network.layers().len()).map(readers).collect();
    let all = left.clone();
    let mut out = vec![];
    for (l, layer) in network.layers().iter().enumerate().rev() {
        let (place, dz) = (&layout.layers[l], &buffers.gradients[l]);
        for (k, source) in layer.sources.iter().enumerate() {
            let (width, x) = (network.width(*source), buffers.of(*source));
            let shape = Shape {
                rows: filled(layer.outputs),
                columns: filled(width),
                inner: rows as u32,
                part: ROWS_A_PART,
                a_stride: vectors(layer.outputs) as u32,
                b_stride: vectors(width) as u32,
                c_stride: vectors(width) as u32,
                c_part: part_vectors(layer.outputs, width) as u32,
                ..Shape::default()
            };
            out.push(p.product(Product::WeightGradient, &shape, [dz, x, x, &partial])?);
            let sum = Sum {
                rows: shape.rows,
                columns: shape.c_stride,
                parts,
                part_stride: shape.c_part,
                weights_first: (place.weights + place.columns[k]) as u32,
                weights_stride: place.stride as u32,
                with_bias: u32::from(k == 0),
                bias_first: place.bias as u32,
            };
            let constants = p.constants(bytemuck::bytes_of(&sum));
            let bound = p.kernels.reduce.bind(p.context, size_of::<Sum>() as u64, &[&p.constants, &partial, buffers.gradient])?;
            out.push(Dispatch { bound, constants, groups: shape.c_part.div_ceil(64) });
            let LayerInput::Layer(from) = *source else { continue };
            let shape = Shape {
                rows: rows as u32,
                columns: filled(width),
                inner: filled(layer.outputs),
                part: filled(layer.outputs),
                a_stride: vectors(layer.outputs) as u32,
                b_first: (place.weights + place.columns[k]) as u32,
                b_stride: place.stride as u32,
                c_stride: vectors(width) as u32,
                extra_stride: vectors(width) as u32,
                activation: activation_number(network.layers()[from].activation),
                // The first of those that read a layer writes, the others add, the last one goes on through the activation.
                accumulate: u32::from(left[from] < all[from]),
                finish: u32::from(left[from] == 1),
                ..Shape::default()
            };
            left[from] -= 1;
            out.push(p.product(Product::DataGradient, &shape, [dz, buffers.parameters, x, &buffers.gradients[from]])?);
        }
    }
    Ok(out)
}

/// Vectors of one part of a weight gradient, with the biases behind.
fn part_vectors(outputs: usize, inputs: usize) -> usize {
    LANES * vectors(outputs) * vectors(inputs) + vectors(outputs)
}

/// The operations of a product of this shape, two for each multiplication.
pub(super) fn operations(shape: &Shape) -> f64 {
    2.0 * f64::from(shape.rows) * f64::from(shape.columns) * f64::from(shape.inner)
}

/// A product of square weights of this width with `rows` rows, alone.
pub(super) fn alone(product: Product, rows: usize, width: usize) -> Shape {
    let (stride, width) = (vectors(width) as u32, filled(width));
    let plain = Shape {
        rows: rows as u32,
        columns: width,
        inner: width,
        part: width,
        a_stride: stride,
        b_stride: stride,
        c_stride: stride,
        extra_stride: stride,
        activation: activation_number(Activation::Relu),
        finish: 1,
        ..Shape::default()
    };
    match product {
        Product::Forward | Product::DataGradient => plain,
        Product::WeightGradient => {
            let c_part = part_vectors(width as usize, width as usize) as u32;
            Shape { rows: width, inner: rows as u32, part: ROWS_A_PART, c_part, ..plain }
        }
    }
}
