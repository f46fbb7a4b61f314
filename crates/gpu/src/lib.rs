//! The way to a GPU (Vulkan, Metal, DirectX 12) for whoever computes there: which adapter, a device with errors that say what happened, kernels in
//! WGSL, memory that grows, numbers back. What is computed is its users' affair.
//!
#![cfg_attr(feature = "gpu", doc = "```no_run")]
#![cfg_attr(not(feature = "gpu"), doc = "```ignore")]
//! use corf_gpu::{AdapterOptions, Context, Kernel};
//!
//! let context = Context::open(&AdapterOptions::default())?;
//! let source = "@group(0) @binding(0) var<storage, read_write> numbers: array<f32>;
//! @compute @workgroup_size(1)
//! fn main(@builtin(workgroup_id) id: vec3<u32>) { numbers[id.x] = 2.0 * numbers[id.x]; }";
//! let kernel = Kernel::new(&context, "double", source)?;
//! let numbers = context.storage("numbers", 12)?;
//! context.fill(&numbers, 0, &[1.0_f32, 2.0, 3.0]);
//! let bound = kernel.bind(&context, 0, &[&numbers])?;
//! let mut encoder = context.encoder();
//! bound.run(&mut encoder.begin_compute_pass(&Default::default()), 0, 3);
//! context.submit(encoder);
//! assert_eq!(context.read::<f32>("doubling", &[(&numbers, 3)])?, [[2.0, 4.0, 6.0]]);
//! # Ok::<_, corf_scene::Error>(())
//! ```

#![cfg(feature = "gpu")]

mod adapter;
mod context;
mod kernel;
mod memory;
mod record;
mod report;
mod scratch;
pub mod testing;
mod timestamps;

pub use adapter::{AdapterOptions, MATRIX_THREADS, adapter_name, adapter_names, multiplies_in_half};
pub use context::{Context, Reading, STORAGE_BUFFERS};
pub use kernel::{ARGS_STRIDE, Bound, GROUP_NUMBER, Kernel, ROW, SIN_COS, UNIFORM_STRIDE};
pub use memory::{peak_memory_bytes, reset_peak_memory};
pub use record::Wgsl;
pub use report::{AdapterReport, adapter_reports};
pub use scratch::Scratch;
pub use timestamps::Timestamps;
