//! Points as tables, with the exponent that is fitted to each quantity: the slope of its logarithm over the axis's.

use super::{Axis, ScalePoint};
use crate::files::escape;
use serde::Serialize;
use std::fmt::Write;

/// A quantity of an axis.
pub struct Measure {
    /// Key in records.
    pub key: &'static str,
    /// Heading of its column.
    pub heading: &'static str,
    digits: usize,
    /// Whether its growth is of interest: an exponent is fitted, and time is drawn.
    pub grows: bool,
}

const fn quantity(key: &'static str, heading: &'static str, digits: usize, grows: bool) -> Measure {
    Measure { key, heading, digits, grows }
}

const STEP: &[Measure] = &[
    quantity("step_ms", "step, ms", 3, true),
    quantity("step_least_ms", "least, ms", 3, false),
    quantity("step_greatest_ms", "greatest, ms", 3, false),
    quantity("visible", "visible Gaussians", 0, false),
    DEVICE,
    PROCESS,
];
const DEVICE: Measure = quantity("device_mb", "device memory, MB", 0, true);
const PROCESS: Measure = quantity("process_mb", "peak of the process, MB", 0, true);

const TRIANGLES: &[Measure] = &[
    quantity("light_s", "light, s a keyframe", 3, true),
    quantity("radio_s", "radio, s a keyframe", 3, true),
    quantity("hierarchy_s", "hierarchy, s once", 3, true),
    quantity("light_once_s", "light, s once", 3, true),
    quantity("radio_once_s", "radio, s once", 3, true),
    PROCESS,
];
const RECEIVERS: &[Measure] = &[
    quantity("total_s", "all, s", 3, true),
    quantity("radio_once_s", "once for the scene, s", 3, false),
    quantity("receivers_s", "receivers, s", 3, true),
    quantity("per_receiver_ms", "all ÷ receivers, ms", 1, false),
    PROCESS,
];
const KEYFRAMES: &[Measure] = &[
    quantity("total_s", "reconstruction, s", 2, true),
    quantity("per_keyframe_ms", "ms a keyframe", 1, false),
    quantity("recent_keyframe_ms", "… since the row above", 1, false),
    quantity("gaussians", "Gaussians", 0, true),
    DEVICE,
    PROCESS,
];

/// The quantities of an axis, in the order of its table.
pub fn quantities(axis: Axis) -> &'static [Measure] {
    match axis {
        Axis::Gaussians | Axis::Pixels => STEP,
        Axis::Triangles => TRIANGLES,
        Axis::Receivers => RECEIVERS,
        Axis::Keyframes => KEYFRAMES,
    }
}

/// Exponent fitted to a quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fitted {
    /// Axis.
    pub axis: Axis,
    /// Key of the quantity.
    pub key: &'static str,
    /// Slope of its logarithm over the axis's, by least squares.
    pub exponent: f64,
    /// The same between the last two points alone: where the growth goes.
    pub last: f64,
    /// Points that it is fitted to.
    pub points: usize,
}

/// Slope of log y over log x by least squares; `None` for fewer than two x.
fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let logs = || points.iter().map(|(x, y)| (x.ln(), y.ln()));
    let (mx, my) = logs().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (xx, xy) = logs().fold((0.0, 0.0), |(a, b), (x, y)| (a + (x - mx).powi(2), b + (x - mx) * (y - my)));
    (points.len() > 1 && xx > 0.0).then(|| xy / xx)
}

/// The exponents of all axes: of quantities that grow, and have two positive values at least.
pub fn fitted(points: &[ScalePoint]) -> Vec<Fitted> {
    let one = |axis: Axis, q: &Measure| {
        let own: Vec<(f64, f64)> = values(points, axis, q.key).collect();
        let exponent = slope(&own)?;
        Some(Fitted { axis, key: q.key, exponent, last: slope(&own[own.len() - 2..])?, points: own.len() })
    };
    let all = Axis::ALL.into_iter().flat_map(|axis| quantities(axis).iter().filter(|q| q.grows).map(move |q| (axis, q)));
    all.filter_map(|(axis, q)| one(axis, q)).collect()
}

/// Positive values of a quantity over an axis.
pub fn values<'p>(points: &'p [ScalePoint], axis: Axis, key: &'p str) -> impl Iterator<Item = (f64, f64)> + 'p {
    let own = points.iter().filter(move |p| p.axis == axis);
    own.filter_map(move |p| Some((p.value as f64, *p.measured.get(key)?))).filter(|(_, y)| *y > 0.0)
}

fn title(axis: Axis) -> &'static str {
    match axis {
        Axis::Gaussians => "A training step against Gaussians",
        Axis::Pixels => "A training step against pixels of the optical image",
        Axis::Triangles => "Tracing a keyframe against triangles",
        Axis::Receivers => "Tracing spectra against receivers",
        Axis::Keyframes => "An online reconstruction against keyframes",
    }
}

/// All points as Markdown: a table for each axis, exponents in the last two rows.
pub fn markdown(points: &[ScalePoint]) -> String {
    let fitted = fitted(points);
    let mut out = "# How cost grows\n".to_owned();
    for axis in Axis::ALL {
        let own: Vec<&ScalePoint> = points.iter().filter(|p| p.axis == axis).collect();
        let Some(first) = own.first() else { continue };
        let shown: Vec<&Measure> =
            quantities(axis).iter().filter(|q| own.iter().any(|p| p.measured.contains_key(q.key))).collect();
        let _ = write!(out, "\n## {}\n\n| {} |", title(axis), axis.name());
        shown.iter().for_each(|q| out.push_str(&format!(" {} |", q.heading)));
        let _ = writeln!(out, "\n|---:|{}", "---:|".repeat(shown.len()));
        for p in &own {
            let _ = write!(out, "| {} |", p.value);
            for q in &shown {
                let cell = p.measured.get(q.key).map_or("–".to_owned(), |v| format!("{v:.*}", q.digits));
                let _ = write!(out, " {cell} |");
            }
            out.push('\n');
        }
        for (name, of) in [("exponent", (|f| f.exponent) as fn(&Fitted) -> f64), ("of the last two", |f| f.last)] {
            let _ = write!(out, "| *{name}* |");
            for q in &shown {
                let found = fitted.iter().find(|f| f.axis == axis && f.key == q.key);
                let _ = write!(out, " {} |", found.map_or("–".to_owned(), |f| format!("*{:.2}*", of(f))));
            }
            out.push('\n');
        }
        let fixed = escape::markdown(&first.settings.to_string());
        let _ = write!(out, "\n![{}]({}.svg)\n\nHeld fixed: {}. ", title(axis), axis.name(), fixed);
        out.push_str(&made_with(&own));
    }
    out
}

/// Devices, machines and commits of an axis's points, each once.
fn made_with(points: &[&ScalePoint]) -> String {
    let each = |of: &dyn Fn(&ScalePoint) -> String| {
        let mut found: Vec<String> = points.iter().map(|p| of(p)).collect();
        found.sort();
        found.dedup();
        escape::markdown(&found.join("; "))
    };
    format!(
        "Device: {}. Machine: {}, {} threads. Commit: {}.\n",
        each(&|p| p.device.clone()),
        each(&|p| p.provenance.processor.clone()),
        each(&|p| p.provenance.threads.to_string()),
        each(&|p| format!("{:.12}{}", p.provenance.commit, if p.provenance.dirty { ", changed" } else { "" })),
    )
}
