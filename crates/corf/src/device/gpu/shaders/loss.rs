//! The unrolled parts of the loss kernels: every tap a constant, everything of a thread in registers.

use super::super::params::LOSS_BLOCK;
use std::fmt::Write;

/// Taps to each side of the window's centre.
pub(super) const RADIUS: u32 = 5;
const ROWS: u32 = LOSS_BLOCK[1];
/// Neighbours of a row that a thread blurs.
const NEIGHBOURS: u32 = 8;

/// Adds value `k` to those of `outputs` sums that see it: sum `o` is `{sum}{o}`, its window values `o` to `o + 2·RADIUS`.
fn spread(out: &mut String, sum: &str, value: &str, k: u32, outputs: u32) {
    for o in (k.saturating_sub(2 * RADIUS)..=k).take_while(|o| *o < outputs) {
        let distance = (k - o).abs_diff(RADIUS);
        let _ = match k - o {
            0 => writeln!(out, "var {sum}{o} = W{distance} * {value};"),
            _ => writeln!(out, "{sum}{o} = fma(W{distance}, {value}, {sum}{o});"),
        };
    }
}

/// Blurs a thread's column: `load` declares what is loaded of row `k`, `values` what is blurred of it; into workgroup memory.
fn down(load: impl Fn(u32) -> String, values: &[impl Fn(u32) -> String]) -> String {
    let taps = ROWS + 2 * RADIUS;
    let mut out: String = (0..taps).map(|k| format!("let row{k} = row_of(b, thread, {k});\n{}", load(k))).collect();
    for (n, value) in values.iter().enumerate() {
        for k in 0..taps {
            let _ = writeln!(out, "let v{n}_{k} = {};", value(k));
            spread(&mut out, &format!("s{n}_"), &format!("v{n}_{k}"), k, ROWS);
        }
        for o in 0..ROWS {
            let _ = writeln!(out, "shared_rows[{}u * PITCH + thread] = s{n}_{o};", n as u32 * ROWS + o);
        }
    }
    out
}

/// Blurs eight neighbours of a row of each of `quantities`: `m{n}_{o}`.
fn across(quantities: u32) -> String {
    let mut out = String::new();
    for n in 0..quantities {
        let _ = writeln!(out, "let at{n} = {}u * PITCH + from_row;", n * ROWS);
        for k in 0..NEIGHBOURS + 2 * RADIUS {
            let _ = writeln!(out, "let h{n}_{k} = shared_rows[at{n} + {k}u];");
            spread(&mut out, &format!("m{n}_"), &format!("h{n}_{k}"), k, NEIGHBOURS);
        }
    }
    out
}

/// Three numbers of each of the eight neighbours back into workgroup memory.
fn keep(number: impl Fn(u32, u32) -> String) -> String {
    let mut out = String::new();
    for n in 0..3 {
        for o in 0..NEIGHBOURS {
            let _ = writeln!(out, "shared_rows[{}u * PITCH + from_row + {o}u] = {};", n * ROWS, number(n, o));
        }
    }
    out
}

/// WGSL expression that reads back the number `n` that [`keep`] stored for row `o` of a thread's column.
fn kept(n: u32, o: u32) -> String {
    format!("shared_rows[{}u * PITCH + from_column]", n * ROWS + o)
}

pub(super) fn similarity(source: &str) -> String {
    let load = |k: u32| {
        format!(
            "let x{k} = select(0.0, image[source + row{k}.at], row{k}.inside);\n\
             let y{k} = select(0.0, target_value(grid, plane + row{k}.at), row{k}.inside);\n"
        )
    };
    let products: [fn(u32) -> String; 5] = [
        |k| format!("x{k}"),
        |k| format!("x{k} * x{k}"),
        |k| format!("x{k} * y{k}"),
        |k| format!("y{k}"),
        |k| format!("y{k} * y{k}"),
    ];
    let differences: Vec<String> = (RADIUS..RADIUS + ROWS).map(|k| format!("abs(x{k} - y{k})")).collect();
    let mut blurred = across(5);
    for o in 0..NEIGHBOURS {
        let _ = writeln!(blurred, "let d{o} = similarity(m0_{o}, m1_{o}, m2_{o}, m3_{o}, m4_{o});");
        let _ = writeln!(blurred, "if (eighth < EIGHTHS && free.y > 0 && free.x > {o}) {{ sums.x += d{o}.w; }}");
    }
    let mut store = String::new();
    for o in 0..ROWS {
        let k = o + RADIUS;
        let _ = writeln!(store, "let row{k} = row_of(b, thread, {k});\nif (row{k}.inside) {{");
        for n in 0..3 {
            let _ = writeln!(store, "derivatives[to + {n}u * params.pixel_total + row{k}.at] = {};", kept(n, o));
        }
        store += "}\n";
    }
    source
        .replace("DOWN\n", &down(load, &products))
        .replace("DIFFERENCES", &differences.join(" + "))
        .replace("ACROSS\n", &blurred)
        .replace("KEEP\n", &keep(|n, o| format!("d{o}.{}", ["x", "y", "z"][n as usize])))
        .replace("STORE\n", &store)
}

pub(super) fn gradient(source: &str) -> String {
    let load = |k: u32| {
        let one = |n: u32| {
            format!("let d{n}_{k} = select(0.0, derivatives[source + {n}u * params.pixel_total + row{k}.at], row{k}.inside);\n")
        };
        [one(0), one(1), one(2)].concat()
    };
    let loaded: [fn(u32) -> String; 3] = [|k| format!("d0_{k}"), |k| format!("d1_{k}"), |k| format!("d2_{k}")];
    let mut store = String::new();
    for o in 0..ROWS {
        let k = o + RADIUS;
        let _ = writeln!(
            store,
            "let row{k} = row_of(b, thread, {k});\nlet x{k} = image[to + row{k}.at];\nlet y{k} = target_value(grid, plane + row{k}.at);"
        );
    }
    for o in 0..ROWS {
        let k = o + RADIUS;
        let _ = writeln!(
            store,
            "if (row{k}.inside) {{\nlet s = {} + 2.0 * x{k} * {} + y{k} * {};\n\
             gradient[to + row{k}.at] = grid.scale * ((1.0 - params.ssim_weight) * sign(x{k} - y{k}) - params.ssim_weight * s);\n}}",
            kept(0, o),
            kept(1, o),
            kept(2, o),
        );
    }
    source
        .replace("DOWN\n", &down(load, &loaded))
        .replace("ACROSS\n", &across(3))
        .replace("KEEP\n", &keep(|n, o| format!("m{n}_{o}")))
        .replace("STORE\n", &store)
}
