//! The WGSL of each kernel, put together from its parts, with what is fixed for a device written in as constants.

use crate::{Antialias, Appearance};
use std::fmt::Write;

/// Side of a block of the loss kernels, pixels.
pub(crate) const LOSS_BLOCK: u32 = 16;

const GROUPS: &str = include_str!("shaders/groups.wgsl");
const PARAMS: &str = include_str!("shaders/params.wgsl");
const GEOMETRY: &str = include_str!("shaders/geometry.wgsl");
const HARMONICS: &str = include_str!("shaders/harmonics.wgsl");
const SPANS: &str = include_str!("shaders/spans.wgsl");
const SPLAT: &str = include_str!("shaders/splat.wgsl");
const TILE_SOURCE: &str = include_str!("shaders/tile.wgsl");
const SCAN: &str = include_str!("shaders/scan.wgsl");
const ARGS: &str = include_str!("shaders/args.wgsl");
const FUSED: &str = include_str!("shaders/fused.wgsl");
const LOSS: &str = include_str!("shaders/loss.wgsl");

/// What the kernels of one device have in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fixed {
    pub antialias: Antialias,
    /// Optical, RF.
    pub harmonics: [HarmonicsShape; 2],
    /// Keys per workgroup of the sort.
    pub sort_block: u32,
    /// Pixels across and down a tile.
    pub tile: [u32; 2],
    /// Splats that the backward pass takes at once.
    pub batch: u32,
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

    /// The same in 32-bit words on the device: padded to words of four.
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
        let [width, height] = self.tile;
        let degree = self.harmonics[0].degree.max(self.harmonics[1].degree);
        format!(
            "const TILE_WIDTH = {width}u;\nconst TILE_HEIGHT = {height}u;\nconst AREA = {}u;\nconst DILATION = {:?};\n\
             const ANTIALIAS_OFF = 0u;\nconst ANTIALIAS_ON = 1u;\nconst ANTIALIAS = {antialias}u;\nconst DEGREE = {degree}u;\n\
             const SCAN = 256u;\nconst SORT_BLOCK = {}u;\n{GROUPS}{PARAMS}",
            width * height,
            self.antialias.dilation(),
            self.sort_block,
        )
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

    /// One step of the harmonics of modality `g`, written out; returns Σ_k w_k ∂Y_k/∂d with w_k = Σ_c dL/dc sh_c,k.
    fn step_harmonics(&self, g: usize) -> String {
        let shape = self.harmonics[g];
        let (k, quads) = (shape.coefficients(), shape.words() / 4);
        let mut out = format!(
            "fn step_sh_word_{g}(at: u32, old: vec4<f32>, g: vec4<f32>, rates: vec4<f32>) {{
    if (WRITE_GRADIENTS) {{
        sh_{g}_m[at] = g;
        return;
    }}
    var m = sh_{g}_m[at];
    var v = sh_{g}_v[at];
    let step = adam(g, &m, &v);
    sh_{g}[at] = old - rates * step;
    sh_{g}_m[at] = m;
    sh_{g}_v[at] = v;
}}
fn step_sh_{g}(i: u32, y: array<f32, 16>, d: vec3<f32>, d_color: vec3<f32>) -> vec3<f32> {{
    let at = i * {quads}u;
    let dc = params.rates[{g}].sh_dc;
    let rest = params.rates[{g}].sh_rest;
    var w: array<f32, 16>;
"
        );
        let mut weights = vec![vec![]; k];
        for quad in 0..quads {
            let (mut gradient, mut rates) = (vec![], vec![]);
            for (lane, name) in LANES.iter().enumerate() {
                let n = 4 * quad + lane;
                if n < shape.numbers() {
                    let channel = LANES[n / k];
                    gradient.push(format!("d_color.{channel} * y[{}]", n % k));
                    rates.push(if n % k == 0 { "dc" } else { "rest" });
                    weights[n % k].push(format!("d_color.{channel} * a{quad}.{name}"));
                } else {
                    gradient.push("0.0".into());
                    rates.push("0.0");
                }
            }
            let _ = writeln!(out, "    let a{quad} = sh_{g}[at + {quad}u];");
            let _ = writeln!(
                out,
                "    step_sh_word_{g}(at + {quad}u, a{quad}, vec4({}), vec4({}));",
                gradient.join(", "),
                rates.join(", ")
            );
        }
        for (k, terms) in weights.iter().enumerate() {
            let _ = writeln!(out, "    w[{k}] = {};", terms.join(" + "));
        }
        let _ = writeln!(out, "    return direction_gradient(d, w, {}u);\n}}", shape.degree);
        out
    }

    pub fn project(&self) -> String {
        let (a, b) = (self.color(0), self.color(1));
        self.head() + GEOMETRY + HARMONICS + SPANS + SPLAT + include_str!("shaders/project.wgsl") + &a + &b
    }

    pub fn plan(&self) -> String {
        self.head() + SCAN + ARGS + include_str!("shaders/plan.wgsl")
    }

    pub fn count(&self) -> String {
        self.head() + SCAN + include_str!("shaders/count.wgsl")
    }

    pub fn sum(&self) -> String {
        self.head() + SCAN + ARGS + include_str!("shaders/sum.wgsl")
    }

    pub fn emit(&self) -> String {
        self.head() + SPANS + SPLAT + include_str!("shaders/emit.wgsl")
    }

    pub fn ranges(&self) -> String {
        self.head() + include_str!("shaders/ranges.wgsl")
    }

    /// A batch of the forward pass is one splat a thread.
    pub fn forward(&self, main_contributor: bool) -> String {
        let constants = format!("const BATCH = AREA;\nconst MAIN_CONTRIBUTOR = {main_contributor};\n");
        self.head() + &constants + SPLAT + TILE_SOURCE + include_str!("shaders/forward.wgsl")
    }

    /// Both modalities of one grid at once.
    pub fn forward_fused(&self) -> String {
        self.head() + "const BATCH = AREA;\n" + SPLAT + TILE_SOURCE + FUSED + include_str!("shaders/forward_fused.wgsl")
    }

    pub fn similarity(&self) -> String {
        self.head() + LOSS + include_str!("shaders/similarity.wgsl")
    }

    pub fn gradient(&self) -> String {
        self.head() + LOSS + include_str!("shaders/gradient.wgsl")
    }

    pub fn backward(&self) -> String {
        let constants = format!("const BATCH = {}u;\n", self.batch);
        self.head() + &constants + SPLAT + TILE_SOURCE + include_str!("shaders/backward.wgsl")
    }

    /// Both modalities of one grid at once.
    pub fn backward_fused(&self) -> String {
        let constants = format!("const BATCH = {}u;\n", self.batch);
        self.head() + &constants + SPLAT + TILE_SOURCE + FUSED + include_str!("shaders/backward_fused.wgsl")
    }

    /// The update, or (`write_gradients`) the same with gradients written in place of the first moments.
    pub fn update(&self, write_gradients: bool) -> String {
        let constants = format!("const WRITE_GRADIENTS = {write_gradients};\n");
        let (a, b) = (self.step_harmonics(0), self.step_harmonics(1));
        self.head() + &constants + GEOMETRY + HARMONICS + SPLAT + include_str!("shaders/update.wgsl") + &a + &b
    }
}

/// Gathering rows of a buffer.
pub(crate) fn gather() -> String {
    format!("{GROUPS}{}", include_str!("shaders/gather.wgsl"))
}
