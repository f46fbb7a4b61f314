//! Timing of the matrix products.

use super::gemm::{self, Arithmetic, Product, Tile};
use super::{Dispatch, plan, vectors};
use corf::Result;
use corf_gpu::{AdapterOptions, Context, Kernel, UNIFORM_STRIDE};
use std::time::Instant;

/// Time of one matrix product.
#[derive(Clone, Debug, PartialEq)]
pub struct ProductTime {
    /// Name of the product.
    pub name: &'static str,
    /// Rows and columns of the tile that a workgroup computes.
    pub tile: [u32; 2],
    /// Floating-point operations.
    pub operations: f64,
    /// Wall clock of one, the least of several runs, seconds.
    pub seconds: f64,
}

/// Dispatches of one run, and runs of which the fastest counts.
const DISPATCHES: u32 = 8;
const RUNS: usize = 5;

/// Times the three products of a square layer of `width` on `rows` rows, with each tile for large matrices; in half precision where the options ask
/// for it and the adapter has it.
///
/// # Errors
/// No adapter, or one without memory for it.
pub fn measure_products(options: &AdapterOptions, rows: usize, width: usize) -> Result<Vec<ProductTime>> {
    let context = Context::open(options)?;
    let array = |label, rows: usize| context.storage(label, (16 * rows * vectors(width)) as u64);
    let numbers: Vec<f32> = (0..4 * vectors(width)).map(|i| (i % 13) as f32 / 13.0 - 0.4).collect();
    let fill = |buffer: &wgpu::Buffer, rows: usize| {
        // A few megabytes at once.
        let piece = numbers.repeat((1 << 20) / numbers.len().max(1) + 1);
        let all = rows * numbers.len();
        for first in (0..all).step_by(piece.len()) {
            context.fill(buffer, 4 * first as u64, &piece[..piece.len().min(all - first)]);
        }
    };
    let [x, other, weights] = [array("left", rows)?, array("right", rows)?, array("weights", 4 * vectors(width))?];
    fill(&x, rows);
    fill(&other, rows);
    fill(&weights, 4 * vectors(width));
    let arithmetic = if context.matrix_units { Arithmetic::Half } else { Arithmetic::Single };
    let scale = context.storage("scale of gradients", 16)?;
    context.fill(&scale, 0, &[1.0_f32; 4]);
    let mut times = vec![];
    for product in Product::ALL {
        for tile in Tile::large(arithmetic) {
            let shape = plan::alone(product, rows, width);
            let constants = context.buffer("constants", UNIFORM_STRIDE, wgpu::BufferUsages::UNIFORM)?;
            context.queue.write_buffer(&constants, 0, bytemuck::bytes_of(&shape));
            let result = match product {
                Product::WeightGradient => context.storage("result", 16 * u64::from(shape.parts()) * u64::from(shape.c_part))?,
                Product::Forward | Product::DataGradient => array("result", rows)?,
            };
            let kernel = Kernel::new(&context, product.name(), &gemm::source(product, tile))?;
            let buffers = match product {
                Product::Forward => [&x, &weights, &weights, &result],
                Product::DataGradient => [&x, &weights, &other, &result],
                Product::WeightGradient => [&x, &other, &other, &result],
            };
            let bound = plan::bind_product(&context, &kernel, &constants, buffers, tile.scales(product).then_some(&scale))?;
            let groups = tile.count(shape.rows, shape.columns) * shape.parts();
            let dispatch = Dispatch { bound, constants: 0, groups };
            let run = || -> Result<f64> {
                let mut encoder = context.encoder();
                {
                    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                    (0..DISPATCHES).for_each(|_| dispatch.run(&mut pass));
                }
                let start = Instant::now();
                context.submit(encoder);
                context.wait("measuring products")?;
                Ok(start.elapsed().as_secs_f64() / f64::from(DISPATCHES))
            };
            let mut seconds = run()?;
            for _ in 0..RUNS {
                seconds = run()?.min(seconds);
            }
            let tile = [tile.rows, tile.columns];
            let operations = plan::operations(&shape);
            times.push(ProductTime { name: product.name(), tile, operations, seconds });
        }
    }
    Ok(times)
}
