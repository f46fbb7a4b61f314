//! The WGSL of each kernel, put together from its parts, with what is fixed for a device written in as constants.

mod loss;

use super::params::{self, LOSS_BLOCK, MASK_GROUP};
use crate::{Antialias, Appearance};
use corf_gpu::GROUP_NUMBER;
use std::fmt::Write;

/// Visible Gaussians per workgroup of the update of appearances.
const EACH: u32 = 8;
/// Pairs that one workgroup emits: blocks of Gaussians with more are cut into shares, so that no workgroup has much more to do than others.
pub(crate) const SHARE: u32 = 1024;
/// Words from one tile's counter to the next: additions to one line of memory wait for each other, also to different words of it. With the
/// counters of 600 tiles side by side an H200 emits 126 000 pairs in 0.031 ms, so far apart in 0.020.
pub(crate) const COUNTER: u32 = 16;
/// Threads of a workgroup of the backward pass, at least: two subgroups, whose buckets share what a workgroup costs.
const BACKWARD_THREADS: u32 = 64;
/// Threads that order a list, or a chunk of a longer one, and how many entries each holds at most while these are sorted in workgroup memory.
const ORDER_THREADS: u32 = 128;
const ENTRIES_A_THREAD: u32 = 2;
/// Entries of a chunk, and threads of a workgroup that joins it with others.
pub(crate) const CHUNK: u32 = ORDER_THREADS * ENTRIES_A_THREAD;
/// Lists of more chunks are ordered by one workgroup each.
pub(crate) const MOST_CHUNKS: u32 = 512;

/// The slots of the state.
pub const SLOTS: &str = include_str!("shaders/slots.wgsl");
const GEOMETRY: &str = include_str!("shaders/geometry.wgsl");
const HARMONICS: &str = include_str!("shaders/harmonics.wgsl");
const SPANS: &str = include_str!("shaders/spans.wgsl");
const SPLAT: &str = include_str!("shaders/splat.wgsl");
const TILE_SOURCE: &str = include_str!("shaders/tile.wgsl");
const SCAN: &str = include_str!("shaders/scan.wgsl");
const ARGS: &str = include_str!("shaders/args.wgsl");
/// The counter of pairs, of an array `state` of atomics.
pub(crate) const COUNTER_OF_PAIRS: &str = include_str!("shaders/counter.wgsl");
const LISTS: &str = include_str!("shaders/lists.wgsl");
const DRAWN: &str = include_str!("shaders/drawn.wgsl");
const RECORD_SUM: &str = include_str!("shaders/record_sum.wgsl");
/// Adam of four numbers.
pub const ADAM: &str = include_str!("shaders/adam.wgsl");
const MARK: &str = include_str!("shaders/mark.wgsl");
const LOSS: &str = include_str!("shaders/loss.wgsl");

/// Compile-time constants shared by the kernels of one device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fixed {
    pub antialias: Antialias,
    /// Optical, RF.
    pub harmonics: [HarmonicsShape; 2],
    /// Pixels across and down a tile.
    pub tile: [u32; 2],
    /// Splats of a bucket: what the backward pass takes at once.
    pub batch: u32,
    /// Whether a bucket's lanes are of one subgroup, on every workgroup.
    pub shuffles: bool,
}

/// Channels and degree of one modality's colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct HarmonicsShape {
    pub channels: usize,
    pub degree: usize,
}

impl HarmonicsShape {
    pub fn of(a: &Appearance) -> Self {
        Self { channels: a.channels, degree: a.sh_degree }
    }

    pub fn coefficients(self) -> usize {
        (self.degree + 1) * (self.degree + 1)
    }

    /// Numbers of a Gaussian, `[channel][coefficient]`.
    pub fn numbers(self) -> usize {
        self.coefficients() * self.channels
    }

    /// Size of a Gaussian's harmonics on the device in 32-bit words: padded to a multiple of four.
    pub fn words(self) -> usize {
        self.numbers().next_multiple_of(4)
    }
}

const LANES: [&str; 4] = ["x", "y", "z", "w"];

impl Fixed {
    fn head(&self) -> String {
        let antialias = match self.antialias {
            Antialias::Off => 0,
            Antialias::On => 1,
            Antialias::Detached => 2,
        };
        let ([width, height], batch) = (self.tile, self.batch);
        let degree = self.harmonics[0].degree.max(self.harmonics[1].degree);
        format!(
            "const TILE_WIDTH = {width}u;\nconst TILE_HEIGHT = {height}u;\nconst AREA = {}u;\nconst DILATION = {:?};\n\
             const ANTIALIAS_OFF = 0u;\nconst ANTIALIAS_ON = 1u;\nconst ANTIALIAS = {antialias}u;\nconst DEGREE = {degree}u;\n\
             const SCAN = 256u;\nconst SHARE = {SHARE}u;\nconst EACH = {EACH}u;\nconst BUCKET = {batch}u;\nconst BUCKETS_A_GROUP = {}u;\n\
             const COUNTER = {COUNTER}u;\nconst CHUNK = {CHUNK}u;\nconst MOST_CHUNKS = {MOST_CHUNKS}u;\n{GROUP_NUMBER}{SLOTS}{}",
            width * height,
            self.antialias.dilation(),
            self.backward_threads() / self.batch,
            params::declarations(),
        )
    }

    /// Functions of the higher of both degrees.
    fn bases(&self) -> usize {
        self.harmonics[0].coefficients().max(self.harmonics[1].coefficients())
    }

    /// max(0, 0.5 + Σ_k sh_k Y_k(d)) of modality `g`, written out.
    fn color(&self, g: usize) -> String {
        let shape = self.harmonics[g];
        let (k, quads) = (shape.coefficients(), shape.words() / 4);
        let mut out = format!(
            "fn color_{g}(i: u32, d: vec3<f32>) -> vec3<f32> {{\n    let y = basis_of(d);\n    let at = i * {quads}u;\n    var c = vec3(0.0);\n"
        );
        for c in 0..shape.channels {
            let _ = writeln!(out, "    c.{} = 0.5;", LANES[c]);
        }
        for quad in 0..quads {
            let _ = writeln!(out, "    let a{quad} = sh_{g}[at + {quad}u];");
            for lane in 0..4.min(shape.numbers() - 4 * quad) {
                let n = 4 * quad + lane;
                let _ = writeln!(out, "    c.{} = fma(a{quad}.{}, y[{}], c.{0});", LANES[n / k], LANES[lane], n % k);
            }
        }
        out + "    return max(c, vec3(0.0));\n}\n"
    }

    fn backward_threads(&self) -> u32 {
        self.batch.max(BACKWARD_THREADS)
    }

    /// Numbers of a pixel's state that are kept for a bucket: in the heads of checkpoints, and in their tails.
    pub fn checkpoint_numbers(both: bool) -> [u32; 2] {
        if both { [5, 4] } else { [3, 2] }
    }

    /// All of them.
    pub fn state_numbers(both: bool) -> u32 {
        Self::checkpoint_numbers(both).iter().sum()
    }

    /// Sizes of modality `g`'s harmonics as constants, their names ending in `end`.
    fn sizes(&self, g: usize, end: &str) -> String {
        let shape = self.harmonics[g];
        let sizes =
            [("IMAGE", g), ("COEFFICIENTS", shape.coefficients()), ("NUMBERS", shape.numbers()), ("QUADS", shape.words() / 4)];
        sizes.iter().map(|(name, n)| format!("const {name}{end} = {n}u;\n")).collect()
    }

    /// One step of the harmonics of modality `g`, or its gradient instead.
    fn step_harmonics(&self, g: usize, use_of: Gradients) -> String {
        let constants = self.sizes(g, &format!("_{g}"));
        let store = match use_of {
            Gradients::Written | Gradients::Noted => "gradient_GRID[at] = w.gradient;".to_owned(),
            Gradients::Sparse | Gradients::Dense => {
                let gradient = if use_of == Gradients::Dense {
                    "learnt(w.gradient, 4u * quad, COEFFICIENTS_GRID, IMAGE_GRID)"
                } else {
                    "w.gradient"
                };
                format!(
                    "sh_GRID[at] = old - w.rates * adam({gradient}, &m, &v);\nmoments_GRID[first] = m;\n\
                     moments_GRID[first + QUADS_GRID] = v;"
                )
            }
        };
        let source = include_str!("shaders/step_harmonics.wgsl").replace("STORE", &store);
        constants + &source.replace("_GRID", &format!("_{g}"))
    }

    /// Constants of the blends.
    fn blend_head(&self, both: bool) -> String {
        let area = self.tile[0] * self.tile[1];
        let [head, tail] = Self::checkpoint_numbers(both);
        format!(
            "const BOTH = {both};\nconst HEAD_NUMBERS = {head}u;\nconst TAIL_NUMBERS = {tail}u;\nconst RADIO_AREA = {}u;\n\
             {LISTS}{SPLAT}{TILE_SOURCE}",
            if both { area } else { 1 },
        )
    }

    pub fn project(&self) -> String {
        let (a, b) = (self.color(0), self.color(1));
        let parts = GEOMETRY.to_owned() + HARMONICS + SPANS + DRAWN + SPLAT + SCAN + ARGS + COUNTER_OF_PAIRS;
        self.head() + &parts + include_str!("shaders/project.wgsl") + &a + &b
    }

    pub fn emit(&self) -> String {
        self.head() + SPANS + DRAWN + SPLAT + include_str!("shaders/emit.wgsl")
    }

    pub fn allot(&self) -> String {
        self.head() + LISTS + SCAN + ARGS + include_str!("shaders/allot.wgsl")
    }

    pub fn place(&self) -> String {
        self.head() + LISTS + include_str!("shaders/place.wgsl")
    }

    pub fn order(&self) -> String {
        let each = |text: &str| (0..ENTRIES_A_THREAD).map(|k| text.replace('$', &k.to_string())).collect::<String>();
        // A loop over an array would leave it to the compiler whether entries wait in registers.
        let look = each(
            "let i$ = $u * THREADS + thread;\nvar mine$: vec2<u32>;\nvar to$: u32;\nif (i$ < count) {\nmine$ = held[i$];\n\
             if (first) { to$ = ranked(i$, count, mine$); } else { to$ = merged(i$, width, count, mine$); }\n}\n",
        );
        let moved = each("if (i$ < count) { held[to$] = mine$; }\n");
        let source = include_str!("shaders/order.wgsl").replace("LOOK\n", &look).replace("MOVE\n", &moved);
        self.head() + LISTS + &format!("const THREADS = {ORDER_THREADS}u;\n") + &source
    }

    pub fn merge(&self) -> String {
        self.head() + LISTS + include_str!("shaders/merge.wgsl")
    }

    /// Workgroup memory of a blend of both modalities in which so many threads share a pixel's list, without a few words.
    pub fn split_bytes(&self, segments: u32) -> u32 {
        let (numbers, splat) = (Self::state_numbers(true) + 1, 16);
        4 * segments * (numbers * self.tile[0] * self.tile[1] + splat * self.batch)
    }

    /// Both modalities of one grid at once, or one of each tile.
    pub fn forward(&self, kind: Blend) -> String {
        let Blend { both, main_contributor: name, checkpoints: keep, segments } = kind;
        let constants = format!("const MAIN_CONTRIBUTOR = {name};\nconst KEEP = {keep};\n");
        let blend = concat!(include_str!("shaders/blend.wgsl"), include_str!("shaders/forward_bindings.wgsl"));
        let head = self.head() + &constants + &self.blend_head(both) + blend;
        if segments == 1 {
            return head + include_str!("shaders/forward.wgsl");
        }
        let batch = segments * self.batch;
        let sizes = format!("const SEGMENTS = {segments}u;\nconst RADIO_BATCH = {}u;\n", if both { batch } else { 1 });
        head + &sizes + include_str!("shaders/forward_split.wgsl")
    }

    pub fn backward(&self, both: bool) -> String {
        let pass =
            if self.shuffles { include_str!("shaders/pass_subgroup.wgsl") } else { include_str!("shaders/pass_portable.wgsl") };
        let threads = self.backward_threads();
        let pixels = threads / self.batch * self.tile[0] * self.tile[1];
        let constants = format!(
            "const BACKWARD_THREADS = {threads}u;\nconst PIXELS = {pixels}u;\nconst RADIO_PIXELS = {}u;\n",
            if both { pixels } else { 1 }
        );
        self.head() + &constants + &self.blend_head(both) + include_str!("shaders/backward.wgsl") + pass
    }

    fn loss_head(&self) -> String {
        let [width, height] = LOSS_BLOCK;
        let sizes = format!(
            "const BLOCK_WIDTH = {width}u;\nconst BLOCK_HEIGHT = {height}u;\nconst THREADS = {}u;\n",
            (width + 2 * loss::RADIUS).next_multiple_of(32)
        );
        self.head() + &sizes + LOSS
    }

    pub fn similarity(&self) -> String {
        self.loss_head() + &loss::similarity(include_str!("shaders/similarity.wgsl"))
    }

    pub fn gradient(&self) -> String {
        self.loss_head() + &loss::gradient(include_str!("shaders/gradient.wgsl"))
    }

    /// Gives pixels of the optical image that do not count the target's value.
    pub fn take_target(&self) -> String {
        self.left_out("target_value(grid, c * pixels + i)")
    }

    /// Gives them no gradient.
    pub fn clear_gradient(&self) -> String {
        self.left_out("0.0")
    }

    fn left_out(&self, value: &str) -> String {
        let source = include_str!("shaders/left_out.wgsl").replace("VALUE", value);
        self.loss_head() + &source.replace("PIXELS", &format!("{MASK_GROUP}u"))
    }

    fn update_head(&self, use_of: Gradients) -> String {
        let written = matches!(use_of, Gradients::Written | Gradients::Noted);
        let constants = format!("const WRITE_GRADIENTS = {written};\n");
        self.head() + &constants + GEOMETRY + RECORD_SUM + ADAM
    }

    /// Words of four of the basis and its slopes, written out: an array in a loop may end up in memory.
    fn keep_basis(&self) -> String {
        let bases = self.bases();
        let four = |quad: usize, of: &str, axis: &str| -> String {
            let one = |c: usize| if c < bases { format!("{of}[{c}]{axis}") } else { "0.0".to_owned() };
            (4 * quad..4 * quad + 4).map(one).collect::<Vec<_>>().join(", ")
        };
        let mut out = String::new();
        for quad in 0..bases.div_ceil(4) {
            let _ = writeln!(out, "basis[quad + {quad}u] = vec4({});", four(quad, "y", ""));
            for (a, axis) in [".x", ".y", ".z"].into_iter().enumerate() {
                let _ = writeln!(out, "slopes[3u * (quad + {quad}u) + {a}u] = vec4({});", four(quad, "slope", axis));
            }
        }
        out
    }

    /// The update of the harmonics, or the same with gradients written to two more buffers instead.
    pub fn update_appearance(&self, use_of: Gradients) -> String {
        let (a, b) = (self.step_harmonics(0, use_of), self.step_harmonics(1, use_of));
        let binding =
            |g: usize| format!("@group(0) @binding({}) var<storage, read_write> gradient_{g}: array<vec4<f32>>;\n", 14 + g);
        let gradients = match use_of {
            Gradients::Written | Gradients::Noted => binding(0) + &binding(1),
            Gradients::Dense => LEARNT.to_owned(),
            Gradients::Sparse => String::new(),
        };
        let source = include_str!("shaders/update_appearance.wgsl")
            .replace("GRADIENTS\n", &gradients)
            .replace("BASIS\n", &self.keep_basis());
        self.update_head(use_of) + HARMONICS + DRAWN + SPLAT + &source + &a + &b
    }

    /// A kernel of a survey.
    pub fn survey(&self, kernel: &str) -> String {
        self.head() + include_str!("shaders/survey.wgsl") + kernel
    }

    /// The update of geometry and opacities, or the same with gradients written in place of the first moments.
    pub fn update_geometry(&self, use_of: Gradients) -> String {
        let (marks, note) = match use_of {
            Gradients::Dense | Gradients::Noted => {
                let marks = MARK.to_owned() + include_str!("shaders/note.wgsl");
                (marks, "if (any(seen)) { note(i, p, s, seen.y, sum_0.first + sum_1.first); }\n")
            }
            Gradients::Sparse | Gradients::Written => (String::new(), ""),
        };
        let source = include_str!("shaders/update_geometry.wgsl").replace("MARKS\n", &marks).replace("    NOTE\n", note);
        self.update_head(use_of) + &source
    }

    /// The rest of a dense step that renders modality `g` alone.
    pub fn momentum(&self, g: usize) -> String {
        self.head() + &self.sizes(g, "") + ADAM + MARK + include_str!("shaders/momentum.wgsl")
    }
}

/// Use of the gradients of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Gradients {
    /// A step of Adam of the Gaussians it sees.
    Sparse,
    /// The same as part of a dense step: bands that are not learnt yet have none, and what is seen is marked.
    Dense,
    /// They are written instead.
    Written,
    /// They are written, and what is seen is marked.
    Noted,
}

/// The gradient of numbers `n` to n + 3 of an image's harmonics, as far as their bands are learnt.
const LEARNT: &str = "\
fn learnt(gradient: vec4<f32>, n: u32, coefficients: u32, image: u32) -> vec4<f32> {
    let k = (vec4(n) + vec4(0u, 1u, 2u, 3u)) % vec4(coefficients);
    return select(vec4(0.0), gradient, k < vec4(params.rates[image].learnt));
}
";

/// Variant of the blend kernel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Blend {
    /// Both modalities of one grid at once.
    pub both: bool,
    /// Also name the Gaussian of the largest weight; by one thread a pixel.
    pub main_contributor: bool,
    /// Keep what the backward pass begins with.
    pub checkpoints: bool,
    /// Threads that share a pixel's list.
    pub segments: u32,
}

/// Gathering rows of a buffer.
pub(crate) fn gather() -> String {
    format!("{GROUP_NUMBER}{SLOTS}{}", include_str!("shaders/gather.wgsl"))
}
