//! What the kernels are written for: a sensor, as constants of WGSL and as the sizes that follow from it.

use super::super::SensorSettings;
use super::super::cloud::NEAREST_M;
use super::super::lobes::{REACH, WIDEST};
use super::super::stepper::MOST_GAIN;
use super::job::declarations;
use crate::{Error, Result};
use corf_gpu::{GROUP_NUMBER, SIN_COS};

/// Emitters or pixels that one part of a table sums over.
pub(super) const CHUNK: usize = 256;
/// Tables of pixels: of what pulls, and of what a power accounts for.
pub(super) const TABLES: usize = 2;
/// Pixels along a side of the tiles that lobes are looked for in.
pub(super) const TILE: usize = 8;
/// Exponent beyond which a power would be none in f32; the greatest power of a wave is far below.
const MOST_EXPONENT: f32 = 80.0;
/// Fewest threads that collect: one for each harmonic axis of a batch of 32 directions.
const FEWEST_THREADS: usize = 64;

/// A sum over a workgroup.
const REDUCE: &str = include_str!("shaders/reduce.wgsl");

/// Most elements of Capon's array over its diagonal loading, which bounds the condition of a covariance: forms of its inverse cancel to as little,
/// and f32 then leaves a pixel of a lone wave, the worst there is, within 2e-3 (0.01 dB). Tests hold it there at this bound.
const MOST_CONDITION: f64 = 1e4;

/// A sensor as kernels know it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    /// Beams of an array of so many columns and rows.
    Beam { columns: usize, rows: usize },
    /// Capon's beamformer on such an array, with a diagonal loading.
    Capon { columns: usize, rows: usize, loading: f64 },
    /// A lobe for each wave.
    Lobes,
}

impl Shape {
    /// # Errors
    /// A sensor whose observations need double precision.
    pub fn of(sensor: &SensorSettings) -> Result<Self> {
        match *sensor {
            SensorSettings::Beam { elements: [columns, rows], .. } => Ok(Self::Beam { columns, rows }),
            SensorSettings::Lobes { .. } => Ok(Self::Lobes),
            SensorSettings::Capon { elements: [columns, rows], loading, .. } => {
                let least = (columns * rows) as f64 / MOST_CONDITION;
                if loading >= least {
                    return Ok(Self::Capon { columns, rows, loading });
                }
                let what = format!("Capon (mvdr) spectra of {columns} x {rows} elements with a diagonal loading of {loading}");
                let help = format!("train and observe it on the processor; on a GPU, in f32, the loading is {least} at least");
                Err(Error::invalid("the radio field", what, help))
            }
        }
    }

    /// Vectors of a table: a row for each cosine and sine of the columns' lags, two lags of the rows a vector.
    pub fn entries(self) -> usize {
        match self {
            Self::Beam { columns, rows } | Self::Capon { columns, rows, .. } => 2 * columns * rows.div_ceil(2),
            Self::Lobes => 0,
        }
    }

    /// Entries of a matrix of an array's elements where there are such matrices: of Capon's.
    pub fn squared(self) -> usize {
        match self {
            Self::Capon { columns, rows, .. } => (columns * rows).pow(2),
            Self::Beam { .. } | Self::Lobes => 0,
        }
    }

    pub fn is_capon(self) -> bool {
        matches!(self, Self::Capon { .. })
    }

    fn head(self) -> String {
        let lobes = self == Self::Lobes;
        let mut out = format!(
            "const TAU = {:?};\nconst NEAREST_M = {NEAREST_M:?};\nconst REACH = {REACH:?};\nconst WIDEST = {WIDEST:?};\n\
             const MOST_EXPONENT = {MOST_EXPONENT:?};\nconst LOBES = {lobes};\nconst CHUNK = {CHUNK}u;\n",
            std::f64::consts::TAU
        );
        if let Self::Beam { columns, rows } | Self::Capon { columns, rows, .. } = self {
            let (quads, entries) = (rows.div_ceil(2), self.entries());
            let threads = entries.next_multiple_of(32).max(FEWEST_THREADS);
            out += &format!(
                "const COLUMNS = {columns}u;\nconst ROWS = {rows}u;\nconst QUADS = {quads}u;\nconst ENTRIES = {entries}u;\n\
                 const THREADS = {threads}u;\n"
            );
        }
        if let Self::Capon { columns, rows, loading } = self {
            let (stride, size) = (4 * rows.div_ceil(2), columns * rows);
            out += &format!("const STRIDE = {stride}u;\nconst SIZE = {size}u;\nconst LOADING = {loading:?};\n");
            out += include_str!("shaders/per.wgsl");
        }
        out + GROUP_NUMBER + SIN_COS + &declarations() + include_str!("shaders/head.wgsl")
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
        self.head()
            + &include_str!("shaders/sum.wgsl")
                .replace("TABLES", tables)
                .replace("DIRECTIONS", directions)
                .replace("WEIGHT", self.capon_or("1.0", "weight(entry)"))
    }

    /// Evaluation of tables, of which a workgroup looks at `held`; harmonics are written out, as an array in a loop may end up in memory.
    fn value(self, held: usize) -> String {
        let (Self::Beam { rows, .. } | Self::Capon { rows, .. }) = self else { return String::new() };
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
            Self::Beam { .. } | Self::Capon { .. } => {
                let seen = self.capon_or("totals[receiver] / value(0u, phases[i])", "value(0u, phases[i])");
                let source = include_str!("shaders/observe_beam.wgsl").replace("SEEN", seen);
                self.head() + &self.value(1) + &source + &self.totals(4, "read")
            }
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
        self.sum(&format!("{TABLES}u"), "job.pixels")
    }

    pub fn residual(self) -> String {
        // With Capon's spectra times the total: ∂P/∂p_j = P²·(what pulls at a wave of the power 1)/total².
        let response = self.capon_or("(observed[i] * per(observed[i], totals[0]))", "1.0");
        self.head() + &include_str!("shaders/residual.wgsl").replace("RESPONSE", response) + &self.totals(5, "read")
    }

    /// What pulls at each wave.
    pub fn pull(self) -> String {
        match self {
            Self::Beam { .. } | Self::Capon { .. } => {
                let power = self.capon_or("per(max(wave.w, 0.0), totals[0])", "max(wave.w, 0.0)");
                let source = include_str!("shaders/pull_beam.wgsl").replace("POWER", power);
                self.head() + &self.value(TABLES) + &source + &self.totals(4, "read")
            }
            Self::Lobes => self.head() + REDUCE + include_str!("shaders/lobe.wgsl") + include_str!("shaders/pull_lobes.wgsl"),
        }
    }

    pub fn account(self) -> String {
        self.head() + REDUCE + include_str!("shaders/account.wgsl")
    }

    pub fn update(self) -> String {
        self.head() + &format!("const MOST_GAIN = {MOST_GAIN:?};\n") + REDUCE + include_str!("shaders/update.wgsl")
    }

    fn capon_or<'a>(self, capon: &'a str, other: &'a str) -> &'a str {
        if self.is_capon() { capon } else { other }
    }

    /// The binding of the receivers' powers of all waves, behind all others.
    fn totals(self, binding: usize, access: &str) -> String {
        if !self.is_capon() {
            return String::new();
        }
        format!("@group(0) @binding({binding}) var<storage, {access}> totals: array<f32>;\n")
    }

    /// Covariances of waves of the power 1 in all, loaded, and the power of all.
    pub fn covariance(self) -> String {
        let store = "let total = tables[first];
            if (i % (SIZE * SIZE) == 0u) { totals[list] = total; }
            matrices[i] = per(entry, total) + select(0.0, LOADING, m == n);";
        self.matrix("job.receivers", store) + &self.totals(3, "read_write")
    }

    pub fn matrices_of_pixels(self) -> String {
        self.matrix(&format!("{TABLES}u"), "matrices[i] = entry;")
    }

    fn matrix(self, lists: &str, store: &str) -> String {
        self.head() + &include_str!("shaders/matrix.wgsl").replace("LISTS", lists).replace("STORE", store)
    }

    /// Inverses of matrices, which lie in a workgroup's own memory, of so many bytes, where they have room there.
    pub fn invert(self, room: usize) -> String {
        const WITHIN: &str =
            "for (var e = t; e < SIZE * SIZE; e += SWEEPERS) { held[e] = matrices[first + e]; }\n    workgroupBarrier();";
        // The row that is swept is there as well.
        let fits = 4 * (self.squared() + self.squared().isqrt()) <= room;
        let (take, at, declare) = if fits {
            (WITHIN, "held[", "var<workgroup> held: array<f32, SIZE * SIZE>;\n")
        } else {
            ("", "matrices[first + ", "")
        };
        self.head() + declare + &include_str!("shaders/invert.wgsl").replace("TAKE", take).replace("AT[", at)
    }

    /// Products that [`Self::matrices_of_pixels`] stand in.
    pub fn around(self) -> String {
        self.head() + &include_str!("shaders/around.wgsl").replace("LISTS", &format!("{TABLES}u"))
    }

    pub fn form_of_inverses(self) -> String {
        self.form("job.receivers", "")
    }

    /// The trace goes to the cosine of no lag, which is 1 for every wave.
    pub fn form_of_pulls(self) -> String {
        self.form(&format!("{TABLES}u"), "if (i % (4u * ENTRIES) == 0u) { total += LOADING * trace(first); }")
    }

    fn form(self, lists: &str, add: &str) -> String {
        self.head() + &include_str!("shaders/form.wgsl").replace("LISTS", lists).replace("ADD", add)
    }
}
