//! Ordering of tile lists against the standard library's sort, at odd lengths.

#![allow(clippy::unwrap_used)]

use super::*;
use crate::{
    Antialias,
    device::gpu::{shaders::HarmonicsShape, testing},
};
use corf_scene::Rng;

/// What is ordered here does not depend on what is not ordered by.
fn fixed() -> Fixed {
    let harmonics = [HarmonicsShape { channels: 3, degree: 0 }; 2];
    Fixed { antialias: Antialias::On, harmonics, tile: [8, 8], batch: 16, segments: 1, shuffles: false }
}

/// Orders lists of these lengths, filled with depths below `range` and pairs' numbers in no order, and checks every place.
fn check(context: &Context, lengths: &[usize], range: u32) {
    let total: usize = lengths.iter().sum();
    let mut rng = Rng::keyed(total as u64, u64::from(range), 0);
    let mut numbers: Vec<u32> = (0..total as u32).collect();
    for i in (1..total).rev() {
        numbers.swap(i, rng.below(i + 1));
    }
    let entries: Vec<[u32; 2]> = numbers.iter().map(|n| [(rng.uniform_f64() * f64::from(range)) as u32, *n]).collect();
    let mut lists = vec![];
    let mut first = 0;
    for length in lengths {
        lists.extend([first as u32, *length as u32, 0, 0]);
        first += length;
    }
    // Who owns pair n.
    let owner = |n: u32| n.wrapping_mul(2_654_435_761);
    let pairs: Vec<u32> = (0..total as u32).flat_map(|n| [0, 0, owner(n), 0]).collect();
    let filled = |label: &str, words: &[u32]| {
        let buffer = context.storage(label, 4 * words.len() as u64).unwrap();
        context.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        buffer
    };
    let (list_buffer, pair_buffer) = (filled("lists", &lists), filled("pairs", &pairs));
    let entry_buffer = filled("entries", entries.as_flattened());
    let mut params: Params = bytemuck::Zeroable::zeroed();
    params.tile_total = lengths.len() as u32;
    let uniform = context.buffer("params", params::SIZE, wgpu::BufferUsages::UNIFORM).unwrap();
    context.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&params));
    let kernel = Kernel::new(context, "order lists", &fixed().order()).unwrap();
    let bound = kernel.bind(context, params::SIZE, &[&uniform, &list_buffer, &pair_buffer, &entry_buffer]).unwrap();
    let mut encoder = context.encoder();
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        bound.run(&mut pass, 0, lengths.len() as u32);
    }
    context.submit(encoder);
    let out = context.read::<u32>("test", &[(&entry_buffer, 2 * total)]).unwrap();
    let mut first = 0;
    for (list, length) in lengths.iter().enumerate() {
        let mut expected = entries[first..first + length].to_vec();
        expected.sort_unstable();
        let found = out[0][2 * first..2 * (first + length)].chunks_exact(2);
        assert!(found.zip(&expected).all(|(f, e)| f == [owner(e[1]), e[1]]), "list {list} of {length}, depths below {range}");
        first += length;
    }
}

#[test]
fn lists_of_any_length_come_out_in_order_of_depth_and_then_of_number() {
    let Some(context) = testing::context(&testing::OPTIONS) else { return };
    let lengths = [0, 1, 2, 3, 0, 7, 8, 31, 33, 64, 65, 127, 255, 257, 511, 1023, 1024, 1025, 2047, 2048, 2049, 3000, 5001];
    check(&context, &lengths, u32::MAX);
    // Depths that are often equal.
    check(&context, &lengths, 5);
}

/// Forty chunks of what workgroup memory holds. A longer list is for a real GPU: Mesa's llvmpipe ends every loop after 65536 turns.
#[test]
fn a_list_that_memory_does_not_hold() {
    let Some(context) = testing::context(&testing::OPTIONS) else { return };
    check(&context, &[40_001], u32::MAX);
}

/// 64 Mi entries need 1.6 GiB and an adapter that binds 1 GiB: run with `--ignored` on a GPU.
#[test]
#[ignore = "needs a GPU with 2 GiB"]
fn sixty_four_million_entries() {
    let Some(context) = testing::context(&testing::OPTIONS) else { return };
    let mut lengths = vec![1 << 20, 100_003];
    let mut left = (64 << 20) - lengths.iter().sum::<usize>();
    let mut rng = Rng::keyed(64, 0, 0);
    while left > 0 {
        lengths.push(rng.below(2000).min(left));
        left -= lengths[lengths.len() - 1];
    }
    check(&context, &lengths, u32::MAX);
}
