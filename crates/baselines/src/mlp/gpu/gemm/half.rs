//! Panels multiplied in f16 by the adapter's matrix units, through cooperative matrices of 16 × 16 numbers with sums in f32.
//!
//! Arrays stay f32: numbers are rounded to f16 on their way into workgroup memory, and a subgroup's matrices go through workgroup memory once
//! more at the end, so that [`super::source`]'s biases, activations and slopes see f32. f16 has 5 bits of exponent, and gradients of a mean over
//! thousands of rays lie below its smallest number; therefore the gradient's panel is multiplied by a power of two that brings the largest
//! gradient of the network's heads to 256 (`scale.wgsl`; loss scaling, Micikevicius et al., ICLR 2018), and the result by its inverse.

use super::{Product, Tile};
use std::fmt::Write;

/// Threads of a subgroup: the kernels are written for adapters whose subgroups have this size always.
pub(super) const SUBGROUP: u32 = 32;
/// Rows and columns of a cooperative matrix.
const SIDE: u32 = 16;
/// Vectors of a matrix of sums.
const STAGED: u32 = SIDE * SIDE / 4;
/// Vectors between a panel's rows beyond what they need: 16 bytes, so that rows are aligned to them and lie in different banks.
pub(super) const PAD: u32 = 2;
/// What the language is asked for.
pub(super) const ENABLED: &str = "enable f16;\nenable wgpu_cooperative_matrix;\n";

/// Whether the left panel holds gradients, which are scaled.
pub(super) fn scaled(product: Product) -> bool {
    product != Product::Forward
}

/// What becomes of a vector `$` of either panel. Scaled gradients end at the largest number of f16.
pub(super) fn kept(product: Product) -> [&'static str; 2] {
    let plain = "vec4<f16>($)";
    [if scaled(product) { "vec4<f16>(clamp(scale[0].x * $, vec4(-65504.0), vec4(65504.0)))" } else { plain }, plain]
}

/// Matrices of one subgroup, down and across.
fn matrices(tile: Tile) -> [u32; 2] {
    tile.each.map(|extent| extent / SIDE)
}

/// Beginning of the entry point, up to the accumulators.
pub(super) fn begin(out: &mut String, product: Product, tile: Tile) {
    let subgroups = tile.threads() / SUBGROUP;
    if scaled(product) {
        out.push_str(
            "// The scale of gradients, and its inverse.\n@group(0) @binding(5) var<storage, read> scale: array<vec4<f32>>;\n",
        );
    }
    let _ = write!(
        out,
        "var<workgroup> staged: array<vec4<f32>, {}>;\n\
         @compute @workgroup_size({})\n\
         fn main(\n    @builtin(workgroup_id) id: vec3<u32>,\n    @builtin(local_invocation_index) t: u32,\n    @builtin(subgroup_id) group: u32,\n\
         \x20   @builtin(subgroup_invocation_id) lane: u32,\n) {{\n{}",
        subgroups * STAGED,
        tile.threads(),
        include_str!("../shaders/place_of_tile.wgsl"),
    );
    let across = tile.columns / tile.each[1];
    let [down_each, across_each] = tile.each;
    let _ = writeln!(
        out,
        "    let down = {down_each}u * (group / {across}u);\n    let across = {across_each}u * (group % {across}u);\n    let stage = {STAGED}u * group;"
    );
    let [down, across] = matrices(tile);
    for r in 0..down {
        for h in 0..across {
            let _ = writeln!(out, "    var c{r}_{h}: coop_mat16x16<f32, C>;");
        }
    }
}

/// One step's panels into the accumulators. Strides count vectors, as the panels do.
pub(super) fn multiply(out: &mut String, tile: Tile) {
    let [down, across] = matrices(tile);
    for k in (0..tile.inner()).step_by(SIDE as usize) {
        out.push_str("        {\n");
        for r in 0..down {
            let place = format!("(down + {}u) * a_STRIDE + {}u", SIDE * r, k / 4);
            let _ = writeln!(out, "            let a{r} = coopLoadT<coop_mat16x16<f16, A>>(&a_panel[{place}], a_STRIDE);");
        }
        for h in 0..across {
            let place = format!("(across + {}u) * b_STRIDE + {}u", SIDE * h, k / 4);
            let _ = writeln!(out, "            let b{h} = coopLoad<coop_mat16x16<f16, B>>(&b_panel[{place}], b_STRIDE);");
        }
        for r in 0..down {
            for h in 0..across {
                let _ = writeln!(out, "            c{r}_{h} = coopMultiplyAdd(a{r}, b{h}, c{r}_{h});");
            }
        }
        out.push_str("        }\n");
    }
}

/// The accumulators into the result, one matrix of each subgroup at a time.
pub(super) fn finish(out: &mut String, product: Product, tile: Tile) {
    let [down, across] = matrices(tile);
    // Vectors of a staged row.
    let stride = SIDE / 4;
    let inverse = if scaled(product) { "scale[0].y * " } else { "" };
    for r in 0..down {
        for h in 0..across {
            let _ = write!(
                out,
                "    workgroupBarrier();\n    coopStoreT(c{r}_{h}, &staged[stage], {stride}u);\n    workgroupBarrier();\n\
                 \x20   for (var v = lane; v < {STAGED}u; v += {SUBGROUP}u) {{\n\
                 \x20       finish(part, row + down + {}u + v / {stride}u, column + across + {}u + 4u * (v % {stride}u), {inverse}staged[stage + v]);\n    }}\n",
                SIDE * r,
                SIDE * h,
            );
        }
    }
}
