//! WGSL of tiled matrix products: what a layer's forward pass and its two gradients are made of.
//!
//! A workgroup computes one tile of the result. It walks along the inner dimension in steps of [`Tile::inner`]: while one step's two panels
//! are multiplied out of workgroup memory, the next is on its way into registers. Panels lie in workgroup memory with the inner index
//! slowest in f32 and fastest in f16, as what multiplies them reads them ([`single`], [`half`]); a panel whose array has it the other way round
//! is transposed in 4 × 4 blocks on its way. Arrays, biases, activations and sums are f32 in both.
//!
//! The sums run along the inner dimension in order. Weight gradients, whose inner dimension is the rows of a batch, are cut into parts of
//! [`ROWS_A_PART`] rows with a result each, which `reduce.wgsl` adds up in order: no atomics, the same bytes each time.

mod half;
mod single;

use corf_gpu::record;
use std::fmt::Write;

/// Rows of a batch that one part of a weight gradient sums over.
pub(super) const ROWS_A_PART: u32 = 1024;

/// One of a layer's three products.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Product {
    /// Y = activation(X·Wᵀ + b).
    Forward,
    /// dX = dZ·W, times the slope of the activation that made X.
    DataGradient,
    /// dW = dZᵀ·X, and db, the sums of dZ over rows.
    WeightGradient,
}

impl Product {
    pub const ALL: [Self; 3] = [Self::Forward, Self::DataGradient, Self::WeightGradient];

    pub fn name(self) -> &'static str {
        match self {
            Self::Forward => "forward",
            Self::DataGradient => "data gradient",
            Self::WeightGradient => "weight gradient",
        }
    }
}

/// What the numbers of both panels are while they are multiplied; sums are f32.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Arithmetic {
    Single,
    /// f16, by the adapter's matrix units.
    Half,
}

/// Size of the tile that one workgroup computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Tile {
    pub rows: u32,
    pub columns: u32,
    /// Rows and columns of one thread, multiples of four, or of one subgroup in half precision, multiples of 16.
    each: [u32; 2],
    arithmetic: Arithmetic,
}

impl Tile {
    /// 256 threads with 8 × 8 numbers each: 64 multiplications for 16 numbers read from workgroup memory.
    pub const WIDE: Self = Self { rows: 128, columns: 128, each: [8, 8], arithmetic: Arithmetic::Single };
    /// 256 threads with 4 × 4 numbers each, for small matrices.
    pub const MEDIUM: Self = Self { rows: 64, columns: 64, each: [4, 4], arithmetic: Arithmetic::Single };
    /// 64 threads with 4 rows each, for a layer with few outputs.
    pub const THIN_COLUMNS: Self = Self { rows: 256, columns: 4, each: [4, 4], arithmetic: Arithmetic::Single };
    /// 64 threads with 4 columns each, for the weight gradient of a layer with few outputs.
    pub const THIN_ROWS: Self = Self { rows: 4, columns: 256, each: [4, 4], arithmetic: Arithmetic::Single };
    /// Sixteen subgroups with 2 × 2 matrices each: sums in few registers leave room for more threads, and these hide the time that memory takes.
    pub const HALF_WIDE: Self = Self { rows: 128, columns: 128, each: [32, 32], arithmetic: Arithmetic::Half };
    /// Four subgroups with 2 × 2 matrices each.
    pub const HALF_MEDIUM: Self = Self { rows: 64, columns: 64, each: [32, 32], arithmetic: Arithmetic::Half };

    /// The tiles for large matrices.
    pub fn large(arithmetic: Arithmetic) -> [Self; 2] {
        match arithmetic {
            Arithmetic::Single => [Self::WIDE, Self::MEDIUM],
            Arithmetic::Half => [Self::HALF_WIDE, Self::HALF_MEDIUM],
        }
    }

    /// The tile that suits a result of this size. Results of few rows or columns are f32 always: what a layer with few outputs costs is reading
    /// its inputs.
    pub fn of(product: Product, rows: u32, columns: u32, arithmetic: Arithmetic) -> Self {
        let [wide, medium] = Self::large(arithmetic);
        match (product, rows, columns) {
            (Product::WeightGradient, ..=8, _) => Self::THIN_ROWS,
            (Product::Forward | Product::DataGradient, _, ..=8) => Self::THIN_COLUMNS,
            (_, ..=64, _) | (_, _, ..=64) => medium,
            _ => wide,
        }
    }

    /// Length of a step along the inner dimension.
    fn inner(self) -> u32 {
        match self.arithmetic {
            Arithmetic::Single => 16,
            Arithmetic::Half => 32,
        }
    }

    /// Whether a product's gradients are scaled on their way into this tile, by a buffer that is bound behind the others.
    pub fn scales(self, product: Product) -> bool {
        self.arithmetic == Arithmetic::Half && half::scaled(product)
    }

    pub const fn threads(self) -> u32 {
        let pieces = self.rows / self.each[0] * (self.columns / self.each[1]);
        match self.arithmetic {
            Arithmetic::Single => pieces,
            Arithmetic::Half => half::SUBGROUP * pieces,
        }
    }

    /// 4 × 4 blocks of a step's two panels.
    fn blocks(self) -> [u32; 2] {
        [self.rows * self.inner() / 16, self.columns * self.inner() / 16]
    }

    /// Tiles that cover a result.
    pub fn count(self, rows: u32, columns: u32) -> u32 {
        rows.div_ceil(self.rows) * columns.div_ceil(self.columns)
    }
}

record! {
    /// One product, as the shader's uniform has it. Places and strides count vectors of four numbers; rows and columns are the result's.
    pub(super) struct Shape {
        pub rows: u32,
        pub columns: u32,
        pub inner: u32,
        /// Length of a part of the inner dimension; all of it but in weight gradients.
        pub part: u32,
        pub a_first: u32,
        pub a_stride: u32,
        pub b_first: u32,
        pub b_stride: u32,
        pub c_stride: u32,
        /// From one part's result to the next.
        pub c_part: u32,
        /// Of the biases, or of the values whose activation's slope is taken.
        pub extra_first: u32,
        pub extra_stride: u32,
        /// Number of the activation, as [`super::activation_number`] has it.
        pub activation: u32,
        /// 1: the result is added to what is there.
        pub accumulate: u32,
        /// 1: this is the last of the products that are added up, after which the activation (or its slope) is applied.
        pub finish: u32,
        pub padding: u32,
    }
}

impl Shape {
    /// Parts of the inner dimension.
    pub fn parts(&self) -> u32 {
        self.inner.div_ceil(self.part)
    }
}

/// Functions that fetch a panel, and keep it in workgroup memory, in 4 × 4 blocks, each four vectors along the array's fast index. `kept` is what
/// becomes of a vector as it is kept.
fn fetch(out: &mut String, tile: Tile, panel: char, extent: u32, bound: &str, along_inner: bool, kept: &str) {
    let (blocks, steps) = (extent / 4, tile.inner() / 4);
    // Threads beside each other read beside each other, and write to different banks.
    let (outer, inner) = match (along_inner, tile.arithmetic) {
        (true, _) => (format!("block / {steps}u"), format!("block % {steps}u")),
        (false, Arithmetic::Single) => (format!("block % {blocks}u"), format!("block / {blocks}u")),
        (false, Arithmetic::Half) => (format!("block % 8u + block / {}u * 8u", 8 * steps), format!("block / 8u % {steps}u")),
    };
    let _ = writeln!(
        out,
        "fn {panel}_outer(block: u32) -> u32 {{ return {outer}; }}\n\
         fn {panel}_inner(block: u32) -> u32 {{ return {inner}; }}\n\
         fn {panel}_vector(row: u32, column: u32, inside: bool) -> vec4<f32> {{\n\
         \x20   let at = shape.{panel}_first + row * shape.{panel}_stride + column;\n\
         \x20   return select(vec4(0.0), {panel}[select(0u, at, inside)], inside);\n}}\n\
         fn fetch_{panel}(block: u32, first: u32, k: u32, end: u32) -> mat4x4<f32> {{\n\
         \x20   let o = first + 4u * {panel}_outer(block);\n\
         \x20   let i = k + 4u * {panel}_inner(block);"
    );
    let vector = |n: u32| {
        if along_inner {
            format!("{panel}_vector(o + {n}u, i / 4u, o + {n}u < {bound} && i < end)")
        } else {
            format!("{panel}_vector(i + {n}u, o / 4u, o < {bound} && i + {n}u < end)")
        }
    };
    let vectors: Vec<String> = (0..4).map(vector).collect();
    let (slow, fast) = match tile.arithmetic {
        Arithmetic::Single => ("inner", "outer"),
        Arithmetic::Half => ("outer", "inner"),
    };
    let turned = if along_inner == (fast == "inner") { "fetched" } else { "transpose(fetched)" };
    let _ = writeln!(
        out,
        "    return mat4x4({});\n}}\n\
         fn keep_{panel}(block: u32, fetched: mat4x4<f32>) {{\n\
         \x20   let m = {turned};\n\
         \x20   let at = 4u * {panel}_{slow}(block) * {panel}_STRIDE + {panel}_{fast}(block);",
        vectors.join(", ")
    );
    for n in 0..4 {
        let value = kept.replace('$', &format!("m[{n}]"));
        let _ = writeln!(out, "    {panel}_panel[at + {n}u * {panel}_STRIDE] = {value};");
    }
    out.push_str("}\n");
}

/// Function that finishes a vector of the result and writes it.
fn epilogue(product: Product) -> &'static str {
    match product {
        Product::Forward => include_str!("../shaders/finish_forward.wgsl"),
        Product::DataGradient => include_str!("../shaders/finish_data_gradient.wgsl"),
        Product::WeightGradient => include_str!("../shaders/finish_weight_gradient.wgsl"),
    }
}

/// Declarations and functions that do not depend on how panels are multiplied: bindings, panels, their way into workgroup memory, the result's end.
fn head(out: &mut String, product: Product, tile: Tile) {
    let Tile { rows, columns, arithmetic, .. } = tile;
    let inner = tile.inner();
    let [a_blocks, b_blocks] = tile.blocks();
    // Vectors of a block lie in different banks.
    let (number, room, [a_stride, b_stride], [a_len, b_len]) = match arithmetic {
        Arithmetic::Single => {
            let strides = [rows / 4 + 1, columns / 4 + 1];
            ("f32", "", strides, strides.map(|stride| inner * stride))
        }
        Arithmetic::Half => {
            let stride = inner / 4 + half::PAD;
            ("f16", half::ENABLED, [stride; 2], [rows * stride, columns * stride])
        }
    };
    let _ = write!(
        out,
        "{room}const ROWS = {rows}u;\nconst COLUMNS = {columns}u;\nconst INNER = {inner}u;\n\
         const A_BLOCKS = {a_blocks}u;\nconst BLOCKS = {}u;\nconst a_STRIDE = {a_stride}u;\nconst b_STRIDE = {b_stride}u;\n{}{}{}\
         var<workgroup> a_panel: array<vec4<{number}>, {}>;\nvar<workgroup> b_panel: array<vec4<{number}>, {}>;\n",
        a_blocks + b_blocks,
        Shape::declaration(),
        include_str!("../shaders/product.wgsl"),
        include_str!("../shaders/activation.wgsl"),
        a_len,
        b_len,
    );
    if product == Product::WeightGradient {
        let _ = writeln!(out, "var<workgroup> row_sums: array<vec4<f32>, {}>;", rows / 4 * inner / 4);
    }
    let [a_kept, b_kept] = match arithmetic {
        Arithmetic::Single => ["$"; 2],
        Arithmetic::Half => half::kept(product),
    };
    fetch(out, tile, 'a', rows, "shape.rows", product != Product::WeightGradient, a_kept);
    fetch(out, tile, 'b', columns, "shape.columns", product == Product::Forward, b_kept);
    out.push_str(epilogue(product));
    out.push_str(
        "\nfn fetch(block: u32, row: u32, column: u32, k: u32, end: u32) -> mat4x4<f32> {\n\
         \x20   if (block < A_BLOCKS) { return fetch_a(block, row, k, end); }\n\
         \x20   return fetch_b(block - A_BLOCKS, column, k, end);\n}\n\
         fn keep(block: u32, m: mat4x4<f32>) {\n\
         \x20   if (block < A_BLOCKS) { keep_a(block, m); } else { keep_b(block - A_BLOCKS, m); }\n}\n\n",
    );
}

/// The kernel of a product with a tile.
pub(super) fn source(product: Product, tile: Tile) -> String {
    let threads = tile.threads();
    let [a_blocks, b_blocks] = tile.blocks();
    let rounds = (a_blocks + b_blocks).div_ceil(threads);
    let sums = product == Product::WeightGradient;
    assert!(!sums || a_blocks <= threads, "a thread sums one block of the left panel");
    let mut out = String::new();
    head(&mut out, product, tile);
    match tile.arithmetic {
        Arithmetic::Single => single::begin(&mut out, tile),
        Arithmetic::Half => half::begin(&mut out, product, tile),
    }
    if sums {
        out.push_str("    var sums = vec4(0.0);\n");
    }
    // Only the last round may have fewer blocks than threads.
    let block = |round: u32| format!("t + {}u", round * threads);
    let whole = |round: u32| (round + 1) * threads <= a_blocks + b_blocks;
    let guarded = |round: u32, text: String| {
        if whole(round) { text } else { format!("if ({} < BLOCKS) {{ {text} }}", block(round)) }
    };
    for round in 0..rounds {
        let text = format!("next{round} = fetch({}, row, column, first, end);", block(round));
        let _ = writeln!(out, "    var next{round} = mat4x4<f32>();\n    {}", guarded(round, text));
    }
    out.push_str("    var k = first;\n    loop {\n        workgroupBarrier();\n");
    for round in 0..rounds {
        let _ = writeln!(out, "        {}", guarded(round, format!("keep({}, next{round});", block(round))));
    }
    if sums {
        out.push_str("        sums += (next0[0] + next0[1]) + (next0[2] + next0[3]);\n");
    }
    out.push_str("        workgroupBarrier();\n        k += INNER;\n        if (k < end) {\n");
    for round in 0..rounds {
        let text = format!("next{round} = fetch({}, row, column, k, end);", block(round));
        let _ = writeln!(out, "            {}", guarded(round, text));
    }
    out.push_str("        }\n");
    match tile.arithmetic {
        Arithmetic::Single => single::multiply(&mut out, tile),
        Arithmetic::Half => half::multiply(&mut out, tile),
    }
    out.push_str("        if (k >= end) { break; }\n    }\n");
    match tile.arithmetic {
        Arithmetic::Single => single::finish(&mut out, tile),
        Arithmetic::Half => half::finish(&mut out, product, tile),
    }
    if sums {
        out.push_str(include_str!("../shaders/sum_rows.wgsl"));
    }
    out + "}\n"
}
