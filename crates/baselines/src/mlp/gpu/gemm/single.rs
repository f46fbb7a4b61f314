//! Panels multiplied in f32: a thread holds a fragment of the tile in named vectors and multiplies it up from as many vectors of either panel. What
//! is written out here a compiler need not unroll.

use super::Tile;
use std::fmt::Write;

/// Beginning of the entry point, up to the accumulators.
pub(super) fn begin(out: &mut String, tile: Tile) {
    let Tile { columns, each: [down, across], .. } = tile;
    let _ = write!(
        out,
        "@compute @workgroup_size({})\n\
         fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {{\n{}",
        tile.threads(),
        include_str!("../shaders/place_of_tile.wgsl"),
    );
    let across_threads = columns / across;
    let _ = writeln!(out, "    let down = t / {across_threads}u;\n    let across = t % {across_threads}u;");
    for r in 0..down {
        for h in 0..across / 4 {
            let _ = writeln!(out, "    var c{r}_{h} = vec4(0.0);");
        }
    }
}

/// One step's panels into the accumulators.
pub(super) fn multiply(out: &mut String, tile: Tile) {
    let Tile { rows, columns, each: [down, across], .. } = tile;
    let (groups_down, groups_across) = (down / 4, across / 4);
    out.push_str("        for (var i = 0u; i < INNER; i++) {\n");
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
    out.push_str("        }\n");
}

/// The accumulators into the result.
pub(super) fn finish(out: &mut String, tile: Tile) {
    let Tile { rows, columns, each: [down, across], .. } = tile;
    let (groups_down, groups_across) = (down / 4, across / 4);
    for r in 0..down {
        for h in 0..groups_across {
            let (y, x) = (rows / groups_down * (r / 4) + r % 4, columns / groups_across * h);
            let _ = writeln!(out, "    finish(part, row + 4u * down + {y}u, column + 4u * across + {x}u, c{r}_{h});");
        }
    }
}
