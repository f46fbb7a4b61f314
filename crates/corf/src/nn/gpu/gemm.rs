//! WGSL of tiled f32 matrix products: what a layer's forward pass and its two gradients are made of.
//!
//! A workgroup computes one tile of the result. It walks along the inner dimension in steps of [`INNER`]: while one step's two panels are
//! multiplied out of workgroup memory, the next is on its way into registers. A thread holds a fragment of the tile in named vectors and
//! multiplies it up from as many vectors of either panel; what is written out here a compiler need not unroll. Panels lie in workgroup
//! memory with the inner index slowest, so a panel whose array has it fastest is transposed in 4 × 4 blocks on its way.
//!
//! The sums run along the inner dimension in order. Weight gradients, whose inner dimension is the rows of a batch, are cut into parts of
//! [`ROWS_A_PART`] rows with a result each, which `reduce.wgsl` adds up in order: no atomics, the same bytes each time.
//!
//! Products in half precision by cooperative matrices would be further variants of [`source`], chosen in [`Tile::of`].

use std::fmt::Write;

/// Length of a step along the inner dimension.
const INNER: u32 = 16;
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

/// Size of the tile that one workgroup computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Tile {
    pub rows: u32,
    pub columns: u32,
    /// Rows and columns of one thread, multiples of four.
    each: [u32; 2],
}

impl Tile {
    /// 256 threads with 8 × 8 numbers each: 64 multiplications for 16 numbers read from workgroup memory.
    pub const WIDE: Self = Self { rows: 128, columns: 128, each: [8, 8] };
    /// 256 threads with 4 × 4 numbers each, for small matrices.
    pub const MEDIUM: Self = Self { rows: 64, columns: 64, each: [4, 4] };
    /// 64 threads with 4 rows each, for a layer with few outputs.
    pub const THIN_COLUMNS: Self = Self { rows: 256, columns: 4, each: [4, 4] };
    /// 64 threads with 4 columns each, for the weight gradient of a layer with few outputs.
    pub const THIN_ROWS: Self = Self { rows: 4, columns: 256, each: [4, 4] };

    /// The tile that suits a result of this size.
    pub fn of(product: Product, rows: u32, columns: u32) -> Self {
        match (product, rows, columns) {
            (Product::WeightGradient, ..=8, _) => Self::THIN_ROWS,
            (Product::Forward | Product::DataGradient, _, ..=8) => Self::THIN_COLUMNS,
            (_, ..=64, _) | (_, _, ..=64) => Self::MEDIUM,
            _ => Self::WIDE,
        }
    }

    pub fn threads(self) -> u32 {
        self.rows / self.each[0] * (self.columns / self.each[1])
    }

    /// Tiles that cover a result.
    pub fn count(self, rows: u32, columns: u32) -> u32 {
        rows.div_ceil(self.rows) * columns.div_ceil(self.columns)
    }
}

/// One product, as the shader's uniform has it. Places and strides count vectors of four numbers; rows and columns are the result's.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
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

impl Shape {
    /// Parts of the inner dimension.
    pub fn parts(&self) -> u32 {
        self.inner.div_ceil(self.part)
    }
}

/// Functions that fetch a panel and keep it in workgroup memory, in 4 × 4 blocks, each four vectors along the array's fast index.
fn fetch(out: &mut String, panel: char, extent: u32, bound: &str, along_inner: bool) {
    let (blocks, steps) = (extent / 4, INNER / 4);
    let (outer, inner) = if along_inner {
        (format!("block / {steps}u"), format!("block % {steps}u"))
    } else {
        (format!("block % {blocks}u"), format!("block / {blocks}u"))
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
    let block = format!("mat4x4({})", vectors.join(", "));
    let block = if along_inner { format!("transpose({block})") } else { block };
    let _ = writeln!(
        out,
        "    return {block};\n}}\n\
         fn keep_{panel}(block: u32, m: mat4x4<f32>) {{\n\
         \x20   let at = 4u * {panel}_inner(block) * {panel}_STRIDE + {panel}_outer(block);"
    );
    for n in 0..4 {
        let _ = writeln!(out, "    {panel}_panel[at + {n}u * {panel}_STRIDE] = m[{n}];");
    }
    out.push_str("}\n");
}

/// Function that finishes a vector of the result and writes it.
fn epilogue(product: Product) -> &'static str {
    match product {
        Product::Forward => include_str!("shaders/finish_forward.wgsl"),
        Product::DataGradient => include_str!("shaders/finish_data_gradient.wgsl"),
        Product::WeightGradient => include_str!("shaders/finish_weight_gradient.wgsl"),
    }
}

/// The kernel of a product with a tile.
pub(super) fn source(product: Product, tile: Tile) -> String {
    let Tile { rows, columns, each: [down, across] } = tile;
    let threads = tile.threads();
    let (a_blocks, b_blocks) = (rows * INNER / 16, columns * INNER / 16);
    let rounds = (a_blocks + b_blocks).div_ceil(threads);
    let sums = product == Product::WeightGradient;
    assert!(!sums || a_blocks <= threads, "a thread sums one block of the left panel");
    let (groups_down, groups_across) = (down / 4, across / 4);
    let mut out = format!(
        "const ROWS = {rows}u;\nconst COLUMNS = {columns}u;\nconst INNER = {INNER}u;\n\
         const A_BLOCKS = {a_blocks}u;\nconst BLOCKS = {}u;\nconst a_STRIDE = {}u;\nconst b_STRIDE = {}u;\n{}{}\
         var<workgroup> a_panel: array<vec4<f32>, {}>;\nvar<workgroup> b_panel: array<vec4<f32>, {}>;\n",
        a_blocks + b_blocks,
        // A vector more than there is: columns of a block then lie in different banks.
        rows / 4 + 1,
        columns / 4 + 1,
        include_str!("shaders/product.wgsl"),
        include_str!("shaders/activation.wgsl"),
        INNER * (rows / 4 + 1),
        INNER * (columns / 4 + 1),
    );
    fetch(&mut out, 'a', rows, "shape.rows", product != Product::WeightGradient);
    fetch(&mut out, 'b', columns, "shape.columns", product == Product::Forward);
    out.push_str(epilogue(product));
    let across_threads = columns / across;
    let _ = write!(
        out,
        "\nfn fetch(block: u32, row: u32, column: u32, k: u32, end: u32) -> mat4x4<f32> {{\n\
         \x20   if (block < A_BLOCKS) {{ return fetch_a(block, row, k, end); }}\n\
         \x20   return fetch_b(block - A_BLOCKS, column, k, end);\n}}\n\
         fn keep(block: u32, m: mat4x4<f32>) {{\n\
         \x20   if (block < A_BLOCKS) {{ keep_a(block, m); }} else {{ keep_b(block - A_BLOCKS, m); }}\n}}\n\n\
         @compute @workgroup_size({threads})\n\
         fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {{\n{}",
        include_str!("shaders/place_of_tile.wgsl"),
    );
    let _ = writeln!(out, "    let down = t / {across_threads}u;\n    let across = t % {across_threads}u;");
    for r in 0..down {
        for h in 0..groups_across {
            let _ = writeln!(out, "    var c{r}_{h} = vec4(0.0);");
        }
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
    out.push_str("        }\n        for (var i = 0u; i < INNER; i++) {\n");
    for g in 0..groups_down {
        let from = rows / 4 / groups_down * g;
        let _ = writeln!(out, "            let a{g} = a_panel[i * a_STRIDE + {from}u + down];");
    }
    for h in 0..groups_across {
        let from = columns / 4 / groups_across * h;
        let _ = writeln!(out, "            let b{h} = b_panel[i * b_STRIDE + {from}u + across];");
    }
    for r in 0..down {
        for h in 0..groups_across {
            let (g, lane) = (r / 4, ['x', 'y', 'z', 'w'][(r % 4) as usize]);
            let _ = writeln!(out, "            c{r}_{h} = fma(vec4(a{g}.{lane}), b{h}, c{r}_{h});");
        }
    }
    out.push_str("        }\n        if (k >= end) { break; }\n    }\n");
    for r in 0..down {
        for h in 0..groups_across {
            let (y, x) = (rows / groups_down * (r / 4) + r % 4, columns / groups_across * h);
            let _ = writeln!(out, "    finish(part, row + 4u * down + {y}u, column + 4u * across + {x}u, c{r}_{h});");
        }
    }
    if sums {
        out.push_str(include_str!("shaders/sum_rows.wgsl"));
    }
    out + "}\n"
}
