//! Emission of pairs, share by share; ordering of tile lists against the standard library's sort, at odd lengths.

#![allow(clippy::unwrap_used)]

use super::*;
use crate::{
    Antialias, Gaussians, OptimizerConfig,
    device::{
        cpu::geometry::{Grid, Pose},
        gpu::{
            params::Uniforms,
            shaders::{COUNTER_OF_PAIRS, HarmonicsShape, MOST_CHUNKS, SLOTS},
            store::Store,
        },
    },
};
use corf_gpu::GROUP_NUMBER;
use corf_gpu::testing::{OPTIONS, context};
use corf_scene::{Pinhole, Rigid3, Rng};
use std::collections::BTreeMap;

/// Constants of the kernels under test; the order of the lists depends on none of them.
fn fixed() -> Fixed {
    let harmonics = [HarmonicsShape { channels: 3, degree: 0 }; 2];
    Fixed { antialias: Antialias::On, harmonics, tile: [8, 8], batch: 16, shuffles: false }
}

/// Numbers below `n` in no order.
fn shuffled(rng: &mut Rng, n: usize) -> Vec<u32> {
    let mut numbers: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        numbers.swap(i, rng.below(i + 1));
    }
    numbers
}

/// Orders lists of these lengths, filled with depths below `range` and pairs in no order, and checks every place. Lists of more
/// than `most` chunks are ordered by one workgroup.
fn check(context: &Context, lengths: &[usize], range: u32, most: u32) {
    let total: usize = lengths.iter().sum();
    let mut rng = Rng::keyed(total as u64, u64::from(range), 0);
    let numbers = shuffled(&mut rng, total);
    let entries: Vec<[u32; 2]> = numbers.iter().map(|n| [(rng.uniform_f64() * f64::from(range)) as u32, *n]).collect();
    let (mut lists, mut chunks) = (vec![], vec![]);
    let mut first = 0;
    for (list, length) in lengths.iter().enumerate() {
        lists.extend([first as u32, *length as u32, 0, 0]);
        first += length;
        // As `allot` has it.
        let parts = length.div_ceil(CHUNK as usize);
        if (2..=most as usize).contains(&parts) {
            chunks.extend((0..parts).flat_map(|part| [list as u32, part as u32]));
        }
    }
    const CHUNKS: usize = 13;
    let mut state = [0; STATE_WORDS];
    state[CHUNKS] = chunks.len() as u32 / 2;
    let groups = lengths.len() as u32 + state[CHUNKS];
    chunks.extend([u32::MAX; 2]);
    // Whose splat pair n is, of either image, and whose that is: Gaussians are numbered as pairs were, from the back.
    let places = shuffled(&mut rng, total);
    let owner = |n: u32| places[n as usize] + n % 2 * total as u32;
    let number = |n: u32| total as u32 - 1 - n;
    let pairs: Vec<u32> = (0..total as u32).flat_map(|n| [0, 0, owner(n), 0]).collect();
    let mut gaussian_of = vec![0; total];
    (0..total as u32).for_each(|n| gaussian_of[places[n as usize] as usize] = number(n));
    let filled = |label: &str, words: &[u32]| {
        let buffer = context.storage(label, 4 * words.len() as u64).unwrap();
        context.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        buffer
    };
    let (list_buffer, pair_buffer) = (filled("lists", &lists), filled("pairs", &pairs));
    let (entry_buffer, state_buffer) = (filled("entries", entries.as_flattened()), filled("state", &state));
    let (chunk_buffer, number_buffer) = (filled("chunks", &chunks), filled("visible", &gaussian_of));
    let mut params: Params = bytemuck::Zeroable::zeroed();
    params.tile_total = lengths.len() as u32;
    params.visible_capacity = total as u32;
    let uniform = context.buffer("params", params::SIZE, wgpu::BufferUsages::UNIFORM).unwrap();
    context.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&params));
    let bound = |source: String, buffers: &[&wgpu::Buffer]| {
        let source = source.replace(&format!("MOST_CHUNKS = {MOST_CHUNKS}u"), &format!("MOST_CHUNKS = {most}u"));
        Kernel::new(context, "order lists", &source).unwrap().bind(context, params::SIZE, buffers).unwrap()
    };
    let buffers = [&uniform, &list_buffer, &pair_buffer, &entry_buffer, &state_buffer, &chunk_buffer, &number_buffer];
    let order = bound(fixed().order(), &buffers);
    let merge = bound(fixed().merge(), &[&state_buffer, &list_buffer, &chunk_buffer, &pair_buffer, &entry_buffer]);
    let mut encoder = context.encoder();
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        // More workgroups than there is work for, as where a frame has no long list.
        order.run(&mut pass, 0, groups + 1);
        merge.run(&mut pass, 0, groups + 1);
    }
    context.submit(encoder);
    let out = context.read::<u32>("test", &[(&entry_buffer, 2 * total)]).unwrap();
    let mut first = 0;
    for (list, length) in lengths.iter().enumerate() {
        let mut expected = entries[first..first + length].to_vec();
        expected.sort_unstable_by_key(|[depth, n]| (*depth, number(*n)));
        let found = out[0][2 * first..2 * (first + length)].chunks_exact(2);
        assert!(found.zip(&expected).all(|(f, e)| f == [owner(e[1]), e[1]]), "list {list} of {length}, depths below {range}");
        first += length;
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn lists_of_any_length_come_out_in_order_of_depth_and_then_of_number() {
    let Some(context) = context(&OPTIONS) else { return };
    let lengths = [0, 1, 2, 3, 0, 7, 8, 31, 33, 64, 65, 127, 255, 257, 511, 1023, 1024, 1025, 2047, 2048, 2049, 3000, 5001];
    check(&context, &lengths, u32::MAX, MOST_CHUNKS);
    // Depths that are often equal.
    check(&context, &lengths, 5, MOST_CHUNKS);
    check(&context, &lengths, u32::MAX, 3);
}

/// Chunks joined all at once, and by a single workgroup. A much longer list is for a real GPU: Mesa's llvmpipe ends every loop after 65536
/// turns.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn lists_of_many_chunks() {
    let Some(context) = context(&OPTIONS) else { return };
    check(&context, &[40_001, 1, CHUNK as usize * MOST_CHUNKS as usize, 5, 1025], u32::MAX, MOST_CHUNKS);
    check(&context, &[30_001, 5], u32::MAX, 100);
}

/// Pairs of blocks, as they are counted, and what is said of them all: never fewer than there are.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn more_pairs_than_a_word_counts_are_the_most_that_it_holds() {
    let Some(context) = context(&OPTIONS) else { return };
    let source = format!(
        "@group(0) @binding(0) var<storage, read_write> state: array<atomic<u32>>;\n\
         @group(0) @binding(1) var<storage, read> counts: array<u32>;\n\
         @group(0) @binding(2) var<storage, read_write> said: array<u32>;\n{GROUP_NUMBER}{SLOTS}{COUNTER_OF_PAIRS}\n\
         @compute @workgroup_size(256)\nfn main(@builtin(local_invocation_index) thread: u32) {{\n\
             if (thread < arrayLength(&counts)) {{ _ = take_pairs(counts[thread]); }}\n\
             storageBarrier();\n\
             if (thread == 0u) {{ said[0] = all_pairs(); said[1] = all_pairs(); }}\n}}\n"
    );
    let kernel = Kernel::new(&context, "counter of pairs", &source).unwrap();
    let most = u64::from(u32::MAX);
    for counts in [
        vec![0_u32; 4],
        vec![1 << 31, (1 << 31) - 1, 0, 0],
        vec![1 << 31, 1 << 31, 0, 0],
        vec![u32::MAX, 1, 0, 0],
        vec![u32::MAX, u32::MAX, u32::MAX, 3],
        // Twice around, to a number for which there would be room.
        vec![1 << 25; 256],
        vec![(1 << 24) - 1; 256],
    ] {
        let truth: u64 = counts.iter().map(|c| u64::from(*c)).sum();
        let filled = |words: &[u32]| {
            let buffer = context.storage("test", 4 * words.len() as u64).unwrap();
            context.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
            buffer
        };
        let (state, counted, said) = (filled(&[0; STATE_WORDS]), filled(&counts), filled(&[7; 4]));
        let bound = kernel.bind(&context, 0, &[&state, &counted, &said]).unwrap();
        let mut encoder = context.encoder();
        bound.run(&mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()), 0, 1);
        context.submit(encoder);
        let read = context.read::<u32>("test", &[(&said, 2)]).unwrap();
        assert_eq!(u64::from(read[0][0]), truth.min(most), "{counts:?}");
        assert_eq!(read[0][1], 0, "the next frame counts from nothing");
        // Such a frame asks for what no adapter binds, and is refused by name.
        let mut state = [0_u32; STATE_WORDS];
        (state[FAILED], state[NEEDED]) = (1, read[0][0]);
        let most = BufferCapacity { pairs: 1 << 22, visible: 1 << 20 };
        let asked = BufferCapacity::asked(&state, most);
        assert!(asked.pairs as u64 >= truth.min(u64::from(u32::MAX)), "{asked:?}");
    }
}

/// 64 Mi entries need 1.6 GiB and an adapter that binds 1 GiB: run with `--ignored` on a GPU.
#[test]
#[ignore = "needs a GPU with 2 GiB"]
fn sixty_four_million_entries() {
    let Some(context) = context(&OPTIONS) else { return };
    let mut lengths = vec![1 << 20, 100_003];
    let mut left = (64 << 20) - lengths.iter().sum::<usize>();
    let mut rng = Rng::keyed(64, 0, 0);
    while left > 0 {
        lengths.push(rng.below(2000).min(left));
        left -= lengths[lengths.len() - 1];
    }
    check(&context, &lengths, u32::MAX, MOST_CHUNKS);
}

/// Gaussians before a camera at the origin: of the first block some fill any image, nobody sees the third, the rest reach a few tiles.
fn of_all_sizes(n: usize) -> Gaussians {
    let mut rng = Rng::keyed(3, 0, 0);
    let mut g = Gaussians::empty(3, 0);
    for i in 0..n {
        let z = if i / BLOCK == 2 { -1.0 } else { 2.0 + rng.uniform() };
        g.position.push([2.0 * (rng.uniform() - 0.5), rng.uniform() - 0.5, z]);
        g.rotation.push([0; 4].map(|_| rng.normal() as f32));
        g.log_scale.push(if i < BLOCK && i % 20 == 7 { [3.0; 3] } else { [0; 3].map(|_| -6.0 + 4.0 * rng.uniform()) });
        for a in [&mut g.light, &mut g.radio] {
            a.opacity_logit.push(6.0 * (rng.uniform() - 0.5));
            a.sh.extend([0.1; 3]);
        }
    }
    g
}

/// Tiles of a Gaussian's pairs in each image, as counted.
type Counts = [u32; 2];

/// Buffers after projection and emission of the pairs.
struct Emitted {
    params: Params,
    counts: Vec<Counts>,
    state: Vec<u32>,
    blocks: Vec<[u32; 4]>,
    shares: Vec<[u32; 2]>,
    gaussian_of: Vec<u32>,
    drawn: Vec<Drawn>,
    sizes: Vec<u32>,
    pairs: Vec<u32>,
    /// Heads and tails.
    records: [Vec<u32>; 2],
}

/// Row of `shaders/drawn.wgsl`: first pair, pairs in each image, rows in each, determinants.
type Drawn = [u32; 7];

/// Has emission find the counts changed, as if by another compiler: blocks, shares and what follows from them, laid out anew.
fn recount(context: &Context, m: &Memory, n: usize, edit: impl Fn(usize, Counts) -> Counts) {
    let blocks = n.div_ceil(BLOCK);
    let read = context.read::<u32>(
        "test",
        &[(&m.state, STATE_WORDS), (&m.blocks.buffer, 4 * blocks), (&m.gaussian_of.buffer, n), (&m.drawn.buffer, 7 * n)],
    );
    let [mut state, mut of_blocks, numbers, mut drawn]: [Vec<u32>; 4] = read.unwrap().try_into().unwrap();
    let (mut begin, mut shares) = (0, vec![]);
    for (block, own) in of_blocks.chunks_exact_mut(4).enumerate() {
        own[3] = begin;
        for place in (own[2] as usize..).take(own[0] as usize) {
            let counts = edit(numbers[place] as usize, [drawn[7 * place + 1], drawn[7 * place + 2]]);
            drawn[7 * place..7 * place + 3].copy_from_slice(&[begin, counts[0], counts[1]]);
            begin += counts[0] + counts[1];
        }
        own[1] = begin - own[3];
        shares.extend((0..own[1].div_ceil(SHARE)).map(|s| [block as u32, s]));
    }
    (state[PAIRS], state[SHARES]) = (begin, shares.len() as u32);
    let write =
        |buffer: &wgpu::Buffer, at: u64, words: &[u32]| context.queue.write_buffer(buffer, at, bytemuck::cast_slice(words));
    write(&m.state, 0, &state);
    write(&m.blocks.buffer, 0, &of_blocks);
    write(&m.drawn.buffer, 0, &drawn);
    write(&m.shares.buffer, 0, shares.as_flattened());
    write(&m.args, 16 * ARGS_SHARES, &[shares.len() as u32, 1, 1]);
}

/// Projects and emits, with room for `room` pairs; between them, counts are changed by `edit`, if it is given.
fn emitted(
    context: &Context,
    g: &Gaussians,
    images: [bool; 2],
    fused: bool,
    room: usize,
    edit: Option<fn(usize, Counts) -> Counts>,
) -> Emitted {
    let mut store = Store::new(context, g).unwrap();
    store.append(context, g).unwrap();
    let fixed = Fixed { harmonics: store.harmonics, ..fixed() };
    let cameras = [if fused { [400, 240] } else { [96, 70] }, [400, 240]].map(|[w, h]| Pinhole::from_horizontal_fov(w, h, 70.0));
    let grids = [0, 1].map(|k| images[k].then(|| Grid::new(&cameras[k], fixed.antialias)));
    let optimizer = OptimizerConfig::default();
    let mut params = Params::new(&Pose::new(&Rigid3::IDENTITY), &grids, [[0.0; 3]; 2], 0.1, g.len(), &optimizer);
    if fused {
        params.fuse();
    }
    params.set_tiles(0, fixed.tile);
    let mut extent = Extent { gaussians: g.len(), ..Extent::default() };
    extent.include(&params, &[fixed]);
    let mut m = Memory::new(context).unwrap();
    m.reserve(context, &fixed, &extent, BufferCapacity { pairs: room, visible: g.len() }).unwrap();
    params.set_room(m.room);
    let uniforms = Uniforms::new(context, std::iter::once(&params)).unwrap();
    m.reset(context, g.len());
    let forward = Forward::new(context, &[fixed], None).unwrap();
    let bound = forward.bind(context, &uniforms.buffer, store.values(), &m, Leaves::Images).unwrap();
    let run = |kernels: &dyn Fn(&mut wgpu::ComputePass<'_>)| {
        let mut encoder = context.encoder();
        kernels(&mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()));
        context.submit(encoder);
    };
    let blocks = g.len().div_ceil(BLOCK);
    run(&|pass| bound.tiled[0].project.run(pass, 0, blocks as u32));
    if let Some(edit) = edit {
        recount(context, &m, g.len(), edit);
    }
    run(&|pass| bound.tiled[0].emit.run_indirect(pass, 0, &m.args, ARGS_SHARES));
    let record_tail = if fused { 8 } else { 4 };
    let read = |sources: &[(&wgpu::Buffer, usize)]| context.read::<u32>("test", sources).unwrap();
    let state = read(&[(&m.state, STATE_WORDS)]).remove(0);
    let visible = state[VISIBLE] as usize;
    let mut left = read(&[
        (&m.blocks.buffer, 4 * blocks),
        (&m.shares.buffer, 2 * state[SHARES] as usize),
        (&m.gaussian_of.buffer, visible),
        (&m.drawn.buffer, 7 * visible),
        (&m.tile_sizes.buffer, COUNTER as usize * params.tile_total as usize),
        (&m.pairs.buffer, 4 * room),
        (&m.record_heads.buffer, 8 * room),
        (&m.record_tails.buffer, record_tail * room),
    ])
    .into_iter();
    let mut next = || left.next().unwrap();
    let (of_blocks, shares, gaussian_of, drawn) = (next(), next(), next(), next());
    let drawn: Vec<Drawn> = drawn.as_chunks().0.to_vec();
    let mut counts = vec![[0; 2]; g.len()];
    for (i, d) in gaussian_of.iter().zip(&drawn) {
        counts[*i as usize] = [d[1], d[2]];
    }
    let sizes = next().iter().step_by(COUNTER as usize).copied().collect();
    let (pairs, records) = (next(), [next(), next()]);
    let (blocks, shares) = (of_blocks.as_chunks().0.to_vec(), shares.as_chunks().0.to_vec());
    Emitted { params, counts, state, blocks, shares, gaussian_of, drawn, sizes, pairs, records }
}

impl Emitted {
    /// Pairs of each block as counted.
    fn of_blocks(&self) -> impl Iterator<Item = u32> + '_ {
        self.counts.chunks(BLOCK).map(|some| some.as_flattened().iter().sum())
    }

    /// Every share once; blocks one behind another, in whatever order, each with its visible Gaussians in order and these with their pairs.
    fn check_blocks(&self) {
        let mut shares = self.shares.clone();
        shares.sort_unstable();
        let pairs_of: Vec<u32> = self.of_blocks().collect();
        let expected = (0_u32..).zip(&pairs_of).flat_map(|(b, pairs)| (0..pairs.div_ceil(SHARE)).map(move |s| [b, s]));
        assert!(shares.into_iter().eq(expected));
        let mut blocks: Vec<(usize, [u32; 4])> = self.blocks.iter().copied().enumerate().collect();
        for (what, first) in [(0, 2), (1, 3)] {
            blocks.sort_unstable_by_key(|(_, b)| (b[first], b[what]));
            let mut end = 0;
            for (block, own) in &blocks {
                assert_eq!(own[first], end, "block {block} lies behind the one before");
                end += own[what];
            }
            assert_eq!(end, self.state[[VISIBLE, PAIRS][what]]);
        }
        for (block, [visible, pairs, place, begin]) in blocks {
            let first = block * BLOCK;
            let ours = first..self.counts.len().min(first + BLOCK);
            let seen: Vec<u32> = ours.filter(|i| self.counts[*i] != [0; 2]).map(|i| i as u32).collect();
            let places = place as usize..(place + visible) as usize;
            assert_eq!(self.gaussian_of[places.clone()], seen);
            let mut at = begin;
            for d in &self.drawn[places] {
                assert_eq!(d[0], at);
                at += d[1] + d[2];
            }
            assert_eq!((at - begin, pairs), (pairs, pairs_of[block]));
        }
    }

    /// The tiles of each Gaussian and image; every one of them once, row by row, and every place of a tile once.
    fn tiles(&self, visible_capacity: u32) -> BTreeMap<(u32, usize), Vec<u32>> {
        assert_eq!(self.state[FAILED], 0, "{} pairs", self.state[NEEDED]);
        let total = self.params.tile_total;
        let mut found = BTreeMap::new();
        let mut taken: Vec<Vec<u32>> = vec![vec![]; total as usize];
        for (place, i) in self.gaussian_of.iter().enumerate() {
            let mut at = self.drawn[place][0] as usize;
            for (g, count) in self.counts[*i as usize].iter().enumerate() {
                let some = &self.pairs[4 * at..4 * (at + *count as usize)];
                let drawn: Vec<&[u32]> = some.chunks_exact(4).take_while(|p| p[0] < total).collect();
                for pair in &drawn {
                    assert_eq!(pair[2], g as u32 * visible_capacity + place as u32, "Gaussian {i}");
                    taken[pair[0] as usize].push(pair[1]);
                }
                let tiles: Vec<u32> = drawn.iter().map(|p| p[0]).collect();
                assert!(tiles.is_sorted_by(|a, b| a < b), "Gaussian {i}: {tiles:?}");
                self.check_rest(at + drawn.len(), at + *count as usize);
                found.insert((*i, g), tiles);
                at += *count as usize;
            }
        }
        for (tile, mut places) in taken.into_iter().enumerate() {
            places.sort_unstable();
            assert!(places.iter().copied().eq(0..self.sizes[tile]), "tile {tile}: {places:?}");
        }
        found
    }

    /// Pairs that were counted and not found have no tile, and records of nothing.
    fn check_rest(&self, begin: usize, end: usize) {
        assert!((begin..end).all(|at| self.pairs[4 * at] == self.params.tile_total));
        for part in &self.records {
            let words = part.len() / (self.pairs.len() / 4);
            assert!(part[words * begin..words * end].iter().all(|w| *w == 0));
        }
    }
}

/// Words of the state that only kernels read.
const PAIRS: usize = 2;
const SHARES: usize = 12;

/// Images and whether they are blended at once: light and radio apart, one of them alone, both.
const FRAMES: [([bool; 2], bool); 4] =
    [([true, true], false), ([true, false], false), ([false, true], false), ([true, true], true)];

/// Room enough for what [`of_all_sizes`] reaches.
const ROOM: usize = 80_000;

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn shares_of_blocks_emit_every_pair_once() {
    let Some(context) = context(&OPTIONS) else { return };
    // A block and a part, blocks of which the third has no pairs, none at all.
    for n in [4 * BLOCK + 77, 300, 1] {
        let g = of_all_sizes(n);
        for (images, fused) in FRAMES {
            let all = emitted(&context, &g, images, fused, ROOM, None);
            all.check_blocks();
            let tiles = all.tiles(n as u32);
            assert!(tiles.iter().all(|((i, g), tiles)| tiles.len() == all.counts[*i as usize][*g] as usize));
            assert!(n < BLOCK || all.of_blocks().any(|pairs| pairs > 16 * SHARE) || !images[1], "shares are cut");
        }
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn pairs_that_were_counted_and_are_not_found_have_no_tile() {
    let Some(context) = context(&OPTIONS) else { return };
    let g = of_all_sizes(1400);
    // Too many, too few; the large ones among them.
    let edit = |i: usize, counts: Counts| match i % 5 {
        0 => counts.map(|c| if c > 0 { c + 1 + i as u32 % 3 } else { 0 }),
        1 => counts,
        _ => counts.map(|c| if c > 1 { c - 1 } else { c }),
    };
    for (images, fused) in FRAMES {
        let right = emitted(&context, &g, images, fused, ROOM, None).tiles(1400);
        let wrong = emitted(&context, &g, images, fused, ROOM, Some(edit));
        wrong.check_blocks();
        for ((i, image), tiles) in wrong.tiles(1400) {
            let expected = &right[&(i, image)];
            let count = expected.len().min(wrong.counts[i as usize][image] as usize);
            assert_eq!(tiles, expected[..count], "Gaussian {i}, image {image}");
        }
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_frame_without_room_emits_nothing() {
    let Some(context) = context(&OPTIONS) else { return };
    let all = emitted(&context, &of_all_sizes(300), [true; 2], true, 4000, None);
    let state = |slots: [usize; 4]| slots.map(|slot| all.state[slot]);
    assert_eq!(state([FAILED, VISIBLE, PAIRS, SHARES]), [1, 0, 0, 0]);
    assert!(all.state[NEEDED] > 4000 && all.state[NEEDED] == all.blocks.iter().map(|b| b[1]).sum::<u32>());
    let untouched = |words: &[u32]| words.iter().all(|w| Some(*w) == OPTIONS.poison);
    let buffers = [&all.pairs, &all.records[0], &all.records[1]];
    assert!(buffers.into_iter().all(|words| untouched(words)), "memory of pairs is as it was");
    assert!(all.sizes.iter().all(|s| *s == 0));
}
