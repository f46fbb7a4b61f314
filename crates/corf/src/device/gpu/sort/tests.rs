//! The sort against the standard library's, at odd sizes, with and without subgroups, on poisoned memory.

#![allow(clippy::unwrap_used)]

use super::*;
use crate::device::gpu::{GpuOptions, testing};
use corf_scene::Rng;

struct Case {
    keys: Vec<u32>,
    passes: u32,
    flags: u32,
}

/// Sorts on the device: keys, values (places of the keys).
fn sort(context: &Context, case: &Case) -> (Vec<u32>, Vec<u32>) {
    let sort = RadixSort::new(context).unwrap();
    let n = case.keys.len();
    let stride = (n as u32).div_ceil(sort.block).max(1);
    let storage = |label: &str, words: usize| context.storage(label, 4 * words as u64).unwrap();
    let keys = [storage("a", n), storage("b", n)];
    let values = [storage("c", n), storage("d", n)];
    let (histogram, totals, state) = (storage("h", (DIGITS * stride) as usize), storage("t", 256), storage("s", 8));
    let uniform = context.buffer("u", 4 * 256, wgpu::BufferUsages::UNIFORM).unwrap();
    context.queue.write_buffer(&keys[0], 0, bytemuck::cast_slice(&case.keys));
    context.queue.write_buffer(&state, 0, bytemuck::cast_slice(&[n as u32]));
    let mut encoder = context.encoder();
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        for p in 0..case.passes {
            let flags = if p == 0 { IMPLICIT_VALUES | case.flags } else { 0 };
            let constants = SortPass { shift: 8 * p, count_slot: 0, stride, flags };
            context.queue.write_buffer(&uniform, u64::from(p) * 256, bytemuck::bytes_of(&constants));
            let (from, to) = ((p % 2) as usize, ((p + 1) % 2) as usize);
            let buffers = PassBuffers {
                uniform: &uniform,
                state: &state,
                keys: &keys[from],
                values: &values[from],
                sorted_keys: &keys[to],
                sorted_values: &values[to],
                histogram: &histogram,
                totals: &totals,
            };
            let bound = sort.bind(context, &buffers).unwrap();
            bound.count(&mut pass, p * 256, Groups::Direct(stride));
            bound.scatter(&mut pass, p * 256, Groups::Direct(stride));
        }
    }
    context.submit(encoder);
    let last = (case.passes % 2) as usize;
    let mut out = context.read("test", &[(&keys[last], n), (&values[last], n)]).unwrap();
    let values = out.pop().unwrap();
    (out.pop().unwrap(), values)
}

fn expected(case: &Case) -> (Vec<u32>, Vec<u32>) {
    let bits = 8 * case.passes;
    let digit = |k: u32| if bits == 32 { k } else { k & ((1 << bits) - 1) };
    let skip = case.flags & SKIP_SENTINELS != 0;
    let mut order: Vec<u32> = (0..case.keys.len() as u32).filter(|i| !(skip && case.keys[*i as usize] == u32::MAX)).collect();
    order.sort_by_key(|i| digit(case.keys[*i as usize]));
    (order.iter().map(|i| case.keys[*i as usize]).collect(), order)
}

fn check(context: &Context, n: usize, passes: u32, range: u32, sentinels: bool) {
    let mut rng = Rng::keyed(n as u64, 0, 0);
    let key = |rng: &mut Rng| {
        let drawn = (rng.uniform_f64() * f64::from(range)) as u32;
        if sentinels && rng.uniform() < 0.6 { u32::MAX } else { drawn }
    };
    let keys = (0..n).map(|_| key(&mut rng)).collect();
    let case = Case { keys, passes, flags: if sentinels && passes == 1 { SKIP_SENTINELS } else { 0 } };
    let (keys, values) = sort(context, &case);
    let (true_keys, true_values) = expected(&case);
    let m = true_keys.len();
    assert!(keys[..m] == true_keys, "keys of {n}, {passes} passes, range {range}");
    assert!(values[..m] == true_values, "values of {n}, {passes} passes, range {range}: not stable");
}

#[test]
fn keys_come_out_in_order_and_equal_ones_stay_in_theirs() {
    for subgroups in [true, false] {
        let Some(context) = testing::context(&GpuOptions { subgroups, ..testing::OPTIONS }) else { return };
        for n in [1, 2, 31, 32, 33, 255, 256, 257, 511, 513, 2047, 2048, 2049, 4097, 100_003] {
            check(&context, n, 4, u32::MAX, false);
            check(&context, n, 2, 300, false);
            check(&context, n, 1, 7, true);
        }
    }
}

#[test]
fn millions_of_keys() {
    let Some(context) = testing::context(&testing::OPTIONS) else { return };
    check(&context, 3_000_001, 4, u32::MAX, false);
    check(&context, 2_500_000, 2, 5000, false);
}

/// 64 Mi keys need 1.1 GiB and an adapter that binds 256 MiB: run with `--ignored` on a GPU.
#[test]
#[ignore = "needs a GPU with 2 GiB"]
fn sixty_four_million_keys() {
    let Some(context) = testing::context(&testing::OPTIONS) else { return };
    check(&context, 64 << 20, 4, u32::MAX, false);
}
