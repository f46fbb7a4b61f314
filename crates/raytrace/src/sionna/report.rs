//! Report of a reference check: quantities, their tolerances and faults.

use serde::Serialize;
use std::fmt;

/// The outcome of a check of one reference file.
#[derive(Clone, Debug, Serialize)]
pub struct CheckReport {
    /// Scene name.
    pub scene: String,
    /// Whether every comparison passed.
    pub passed: bool,
    /// One line per configuration and receiver.
    pub comparisons: Vec<Comparison>,
}

/// One configuration at one receiver.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Comparison {
    /// Configuration and receiver.
    pub name: String,
    /// Paths found on both sides.
    pub matched: usize,
    /// Reference paths not found here: types and objects.
    pub missing: Vec<String>,
    /// Paths found here that the reference does not have.
    pub extra: Vec<String>,
    /// Largest |Δa| / |a_f64|.
    pub max_relative_a: f64,
    /// Largest difference in unfolded length, metres.
    pub max_length_m: f64,
    /// Largest difference in an angle, radians.
    pub max_angle_rad: f64,
    /// Largest distance between vertices, metres.
    pub max_vertex_m: f64,
    /// Σ|a|² here over Σ|a_f64|² there, dB.
    pub power_difference_db: f64,
    /// Further numbers of diffuse checks: name, found, expected, tolerance.
    pub quantities: Vec<ComparedQuantity>,
    /// Comparisons that could not be made, and why.
    pub notes: Vec<String>,
    /// Quantities outside their tolerance; empty is a pass.
    pub faults: Vec<String>,
}

/// A number against its reference.
#[derive(Clone, Debug, Serialize)]
pub struct ComparedQuantity {
    /// Name of the quantity.
    pub name: String,
    /// Found here.
    pub found: f64,
    /// The reference's.
    pub expected: f64,
    /// The largest difference allowed.
    pub tolerance: f64,
}

impl CheckReport {
    /// Gathers comparisons; a report without any does not pass.
    pub fn new(scene: &str, comparisons: Vec<Comparison>) -> Self {
        let passed = !comparisons.is_empty() && comparisons.iter().all(|c| c.faults.is_empty());
        Self { scene: scene.to_string(), passed, comparisons }
    }
}

impl fmt::Display for CheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {}", self.scene, if self.passed { "pass" } else { "FAIL" })?;
        writeln!(
            f,
            "  {:<34} {:>5} {:>7} {:>5} {:>9} {:>9} {:>9} {:>9} {:>10}",
            "configuration, receiver", "paths", "missing", "extra", "|da|/|a|", "dL m", "angle rad", "vertex m", "power dB"
        )?;
        for c in &self.comparisons {
            writeln!(
                f,
                "  {:<34} {:>5} {:>7} {:>5} {:>9.1e} {:>9.1e} {:>9.1e} {:>9.1e} {:>10.1e}",
                c.name,
                c.matched,
                c.missing.len(),
                c.extra.len(),
                c.max_relative_a,
                c.max_length_m,
                c.max_angle_rad,
                c.max_vertex_m,
                c.power_difference_db
            )?;
            for q in &c.quantities {
                writeln!(
                    f,
                    "    {:<48} {:>13.6e} {:>13.6e}  off {:>8.1e} of {:>8.1e}",
                    q.name,
                    q.found,
                    q.expected,
                    (q.found - q.expected).abs(),
                    q.tolerance
                )?;
            }
            for note in &c.notes {
                writeln!(f, "    note: {note}")?;
            }
            for fault in &c.faults {
                writeln!(f, "    fault: {fault}")?;
            }
        }
        Ok(())
    }
}
