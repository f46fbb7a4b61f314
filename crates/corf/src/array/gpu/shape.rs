//! What the kernels are written for: a sensor, as constants of WGSL and as the sizes that follow from it.

use super::super::SensorSettings;
use super::super::cloud::NEAREST_M;
use super::super::lobes::{REACH, WIDEST};
use super::super::stepper::MOST_GAIN;
use crate::nn::gpu::ENCODING;
use crate::{Error, Result};

/// Emitters or pixels that one part of a table sums over.
pub(super) const CHUNK: usize = 256;
/// Pixels along a side of the tiles that lobes are looked for in.
pub(super) const TILE: usize = 8;
/// Exponent beyond which a power would be none in f32; the greatest power of a wave is far below.
const MOST_EXPONENT: f32 = 80.0;
/// Fewest threads that collect: one for each harmonic axis of a batch of 32 directions.
const FEWEST_THREADS: usize = 64;

/// A sum over a workgroup.
const REDUCE: &str = include_str!("shaders/reduce.wgsl");

/// A sensor as kernels know it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// Beams of an array of so many columns and rows.
    Beam { columns: usize, rows: usize },
    /// A lobe for each wave.
    Lobes,
}

impl Shape {
    /// # Errors
    /// A sensor that there are no kernels for.
    pub fn of(sensor: &SensorSettings) -> Result<Self> {
        match *sensor {
            SensorSettings::Beam { elements: [columns, rows], .. } => Ok(Self::Beam { columns, rows }),
            SensorSettings::Lobes { .. } => Ok(Self::Lobes),
            SensorSettings::Capon { .. } => Err(Error::invalid(
                "the radio field",
                "a GPU forms no Capon (mvdr) spectra",
                "train and observe it on the processor",
            )),
        }
    }

    /// Vectors of a table: a row for each cosine and sine of the columns' lags, two lags of the rows a vector.
    pub fn entries(self) -> usize {
        match self {
            Self::Beam { columns, rows } => 2 * columns * rows.div_ceil(2),
            Self::Lobes => 0,
        }
    }

    fn head(self) -> String {
        let lobes = self == Self::Lobes;
        let mut out = format!(
            "const TAU = {:?};\nconst NEAREST_M = {NEAREST_M:?};\nconst REACH = {REACH:?};\nconst WIDEST = {WIDEST:?};\n\
             const MOST_EXPONENT = {MOST_EXPONENT:?};\nconst LOBES = {lobes};\nconst CHUNK = {CHUNK}u;\n",
            std::f64::consts::TAU
        );
        if let Self::Beam { columns, rows } = self {
            let (quads, entries) = (rows.div_ceil(2), self.entries());
            let threads = entries.next_multiple_of(32).max(FEWEST_THREADS);
            out += &format!(
                "const COLUMNS = {columns}u;\nconst ROWS = {rows}u;\nconst QUADS = {quads}u;\nconst ENTRIES = {entries}u;\n\
                 const THREADS = {threads}u;\n"
            );
        }
        out + include_str!("shaders/head.wgsl") + ENCODING
    }

    pub fn waves(self) -> String {
        self.head() + include_str!("shaders/waves.wgsl")
    }

    /// Parts of the tables of all receivers' waves.
    pub fn collect_waves(self) -> String {
        let source = include_str!("shaders/collect.wgsl")
            .replace("DECLARE", "var sum = vec4(0.0);")
            .replace("ADD", "sum += y * z;")
            .replace("STORE", "parts[group * ENTRIES + t] = sum;");
        self.head() + include_str!("shaders/collect_waves.wgsl") + &source
    }

    pub fn sum_waves(self) -> String {
        self.sum("job.receivers", "job.emitters")
    }

    fn sum(self, tables: &str, directions: &str) -> String {
        self.head() + &include_str!("shaders/sum.wgsl").replace("TABLES", tables).replace("DIRECTIONS", directions)
    }

    /// Evaluation of tables, of which a workgroup looks at `held`; harmonics are written out, as an array in a loop may end up in memory.
    fn value(self, held: usize) -> String {
        let Self::Beam { rows, .. } = self else { return String::new() };
        let quads = rows.div_ceil(2);
        let harmonics: String = (0..quads)
            .map(|q| format!("let z{q} = vec4(h, turned(h, turn_z));\n    h = turned(z{q}.zw, turn_z);\n    "))
            .collect();
        let row = |first: &str| (0..quads).map(|q| format!("dot(held[{first} + {q}u], z{q})")).collect::<Vec<_>>().join(" + ");
        let source = include_str!("shaders/value.wgsl")
            .replace("HARMONICS\n", &harmonics)
            .replace("EVEN", &row("even"))
            .replace("ODD", &row("odd"));
        format!("const HELD = {held}u;\n{source}")
    }

    /// The observation at every pixel.
    pub fn observe(self) -> String {
        match self {
            Self::Beam { .. } => self.head() + &self.value(1) + include_str!("shaders/observe_beam.wgsl"),
            Self::Lobes => self.head() + include_str!("shaders/lobe.wgsl") + include_str!("shaders/observe_lobes.wgsl"),
        }
    }

    /// Parts of the two tables of the derivatives by pixels.
    pub fn collect_pixels(self) -> String {
        let source = include_str!("shaders/collect.wgsl")
            .replace("DECLARE", "var pull = vec4(0.0);\n    var own = vec4(0.0);")
            .replace("ADD", "pull += y.x * z;\n            own += y.y * z;")
            .replace("STORE", "parts[group * ENTRIES + t] = pull;\n        parts[(chunks + group) * ENTRIES + t] = own;");
        self.head() + include_str!("shaders/collect_pixels.wgsl") + &source
    }

    pub fn sum_pixels(self) -> String {
        self.sum("2u", "job.pixels")
    }

    pub fn residual(self) -> String {
        self.head() + include_str!("shaders/residual.wgsl")
    }

    /// What pulls at each wave.
    pub fn pull(self) -> String {
        match self {
            Self::Beam { .. } => self.head() + &self.value(2) + include_str!("shaders/pull_beam.wgsl"),
            Self::Lobes => self.head() + REDUCE + include_str!("shaders/lobe.wgsl") + include_str!("shaders/pull_lobes.wgsl"),
        }
    }

    pub fn account(self) -> String {
        self.head() + REDUCE + include_str!("shaders/account.wgsl")
    }

    pub fn update(self) -> String {
        self.head() + &format!("const MOST_GAIN = {MOST_GAIN:?};\n") + REDUCE + include_str!("shaders/update.wgsl")
    }
}
