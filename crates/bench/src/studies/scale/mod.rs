//! How cost grows: time and memory along one axis at a time, point by point, each with its own record.
//!
//! ```text
//! OUT/points/AXIS-VALUE.json    one measurement; a point that is there is not measured again
//! OUT/scale.json                all points, and the exponents fitted to them
//! OUT/scale.md                  the same as tables
//! OUT/AXIS.svg                  time and memory over the axis, both logarithmic
//! ```

mod chart;
mod sequence;
mod steps;
mod table;
mod trace;
mod walk;

pub use sequence::SequenceSettings;
pub use steps::StepSettings;
pub use table::{Fitted, fitted, markdown};
pub use trace::{TraceSettings, Tracing, subdivided};

use crate::device::Backend;
use crate::files::json::{read_json, write_json, write_numbers};
use crate::note;
use crate::record::provenance::Provenance;
use anyhow::{Context, Result, ensure};
use corf_scene::io::write_atomic;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Version of a point's record.
pub const SCHEMA: &str = "corf-scale/1";

/// Quantity that is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// A coupled training step against the Gaussians of the field.
    Gaussians,
    /// A coupled training step against the pixels of the optical image.
    Pixels,
    /// A keyframe's light and its spectrum against the triangles of the scene.
    Triangles,
    /// Spectra against the positions at which they are received.
    Receivers,
    /// A whole online reconstruction against its keyframes.
    Keyframes,
}

impl Axis {
    /// All of them, in the order of the tables.
    pub const ALL: [Self; 5] = [Self::Gaussians, Self::Pixels, Self::Triangles, Self::Receivers, Self::Keyframes];

    /// Name in files and options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gaussians => "gaussians",
            Self::Pixels => "pixels",
            Self::Triangles => "triangles",
            Self::Receivers => "receivers",
            Self::Keyframes => "keyframes",
        }
    }
}

/// One measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScalePoint {
    /// [`SCHEMA`].
    pub schema: String,
    /// Quantity that is varied.
    pub axis: Axis,
    /// Its value.
    pub value: u64,
    /// All that was held fixed.
    pub settings: Value,
    /// Device, as far as one takes part.
    pub device: String,
    /// Findings by key; [`table::quantities`] says what they are.
    pub measured: BTreeMap<String, f64>,
    /// Source and machine.
    pub provenance: Provenance,
}

/// A finding, by its key.
pub type Measured = BTreeMap<String, f64>;

/// All points of an axis that are asked for.
pub enum ScaleWork {
    /// Steps for each number of Gaussians.
    Gaussians(Vec<usize>, StepSettings),
    /// Steps for each size of the optical image.
    Pixels(Vec<[usize; 2]>, StepSettings),
    /// Keyframes traced in the scene, its triangles cut in four so many times.
    Triangles(Vec<u32>, Box<Tracing>),
    /// Spectra at so many positions.
    Receivers(Vec<usize>, Box<Tracing>),
    /// A sequence that is measured at these lengths.
    Keyframes(Vec<usize>, SequenceSettings),
}

/// Folder of points.
pub struct Points<'a> {
    /// The folder.
    pub out: &'a Path,
    /// Device of the axes that need one.
    pub backend: &'a Backend,
}

impl Points<'_> {
    /// Measures the points of one axis that are missing.
    ///
    /// # Errors
    /// A point that is there and was measured otherwise, sizes that do not fit, what the measurement itself meets, an interrupt.
    pub fn measure(&self, work: &ScaleWork) -> Result<()> {
        match work {
            ScaleWork::Gaussians(counts, settings) => {
                let one = |n: usize| StepSettings { gaussians: n, ..*settings };
                counts.iter().try_for_each(|&n| self.step(Axis::Gaussians, n, settings.beside(Axis::Gaussians), one(n)))
            }
            ScaleWork::Pixels(sizes, settings) => sizes.iter().try_for_each(|&size| {
                let one = StepSettings { light: size, ..*settings };
                self.step(Axis::Pixels, size[0] * size[1], settings.beside(Axis::Pixels), one)
            }),
            ScaleWork::Triangles(times, tracing) => times.iter().try_for_each(|&times| {
                let value = tracing.triangles(times);
                self.point(Axis::Triangles, value, &tracing.settings(), "cpu", || tracing.measure_triangles(times))
            }),
            ScaleWork::Receivers(counts, tracing) => {
                let settings = tracing.settings();
                let missing = self.missing(Axis::Receivers, counts, &settings, "cpu")?;
                tracing.measure_receivers(&missing, &mut |n, measured| self.write(Axis::Receivers, n, &settings, "cpu", measured))
            }
            ScaleWork::Keyframes(counts, sequence) => {
                let (settings, device) = (serde_json::to_value(sequence)?, self.backend.name());
                let missing = self.missing(Axis::Keyframes, counts, &settings, &device)?;
                sequence.measure(self.backend, &missing, &mut |n, measured| {
                    self.write(Axis::Keyframes, n, &settings, &device, measured)
                })
            }
        }
    }

    fn step(&self, axis: Axis, value: usize, settings: Value, one: StepSettings) -> Result<()> {
        self.point(axis, value, &settings, &self.backend.name(), || one.measure(self.backend))
    }

    fn point(
        &self,
        axis: Axis,
        value: usize,
        settings: &Value,
        device: &str,
        measure: impl FnOnce() -> Result<Measured>,
    ) -> Result<()> {
        if self.missing(axis, &[value], settings, device)?.is_empty() {
            return Ok(());
        }
        let measured = measure().with_context(|| format!("at {value} {}", axis.name()))?;
        self.write(axis, value, settings, device, measured)
    }

    fn path(&self, axis: Axis, value: usize) -> PathBuf {
        self.out.join("points").join(format!("{}-{value}.json", axis.name()))
    }

    /// The values of which there is no point yet, in order.
    fn missing(&self, axis: Axis, values: &[usize], settings: &Value, device: &str) -> Result<Vec<usize>> {
        let mut missing = vec![];
        for &value in values {
            let path = self.path(axis, value);
            if !path.exists() {
                missing.push(value);
                continue;
            }
            let point = read_point(&path)?;
            let help = "choose another --out, or the same options and device";
            ensure!(
                point.settings == *settings,
                "{} was measured with {}, and this is with {settings}\n  help: {help}",
                path.display(),
                point.settings
            );
            ensure!(
                point.device == device,
                "{} was measured on {}, and this is {device}\n  help: {help}",
                path.display(),
                point.device
            );
            note!("{} {}: there already", value, axis.name());
        }
        missing.sort_unstable();
        missing.dedup();
        Ok(missing)
    }

    fn write(&self, axis: Axis, value: usize, settings: &Value, device: &str, measured: Measured) -> Result<()> {
        let text: Vec<String> = measured.iter().map(|(key, found)| format!("{key} {found:.4}")).collect();
        note!("{value} {}: {}", axis.name(), text.join(", "));
        let (settings, device, value) = (settings.clone(), device.to_owned(), value as u64);
        let point =
            ScalePoint { schema: SCHEMA.to_owned(), axis, value, settings, device, measured, provenance: Provenance::here() };
        write_numbers(&self.path(axis, value as usize), &point)
    }
}

fn read_point(path: &Path) -> Result<ScalePoint> {
    let point: ScalePoint = read_json(path)?;
    ensure!(point.schema == SCHEMA, "{}: schema {} and not {SCHEMA}\n  help: measure it again", path.display(), point.schema);
    let sound = point.value > 0 && point.measured.values().all(|v| v.is_finite() && *v >= 0.0);
    ensure!(sound, "{}: a value that nothing measures\n  help: delete it and measure it again with --resume", path.display());
    Ok(point)
}

/// All points of a folder, by axis and value.
///
/// # Errors
/// A folder that cannot be read, or a record that is damaged.
pub fn read(out: &Path) -> Result<Vec<ScalePoint>> {
    let folder = out.join("points");
    let entries = std::fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut points = vec![];
    for entry in entries {
        let path = entry.with_context(|| format!("cannot read {}", folder.display()))?.path();
        if path.extension().is_some_and(|e| e == "json") {
            points.push(read_point(&path)?);
        }
    }
    points.sort_by_key(|p| (p.axis, p.value));
    Ok(points)
}

/// Writes tables and plots of all points of a folder; returns the points and the tables.
///
/// # Errors
/// Those of [`read`]; a folder that cannot be written.
pub fn write_results(out: &Path) -> Result<(Vec<ScalePoint>, String)> {
    let points = read(out)?;
    let text = markdown(&points);
    write_json(&out.join("scale.json"), &serde_json::json!({ "points": points, "exponents": fitted(&points) }))?;
    write_atomic(out.join("scale.md"), text.as_bytes())?;
    for axis in Axis::ALL {
        let own: Vec<&ScalePoint> = points.iter().filter(|p| p.axis == axis).collect();
        if !own.is_empty() {
            write_atomic(out.join(format!("{}.svg", axis.name())), chart::svg(axis, &own)?.as_bytes())?;
        }
    }
    Ok((points, text))
}

/// Memory of this process and of the device, as findings.
fn memory(device_bytes: Option<u64>) -> impl Iterator<Item = (String, f64)> {
    let process = crate::record::provenance::peak_memory_bytes();
    let megabytes = |(key, bytes): (&str, Option<u64>)| Some((key.to_owned(), bytes? as f64 / 1e6));
    [("device_mb", device_bytes), ("process_mb", process)].into_iter().filter_map(megabytes)
}

#[cfg(test)]
mod tests;
