//! Lines and columns of a pattern's file: names, units of angles, numbers.

use crate::{Error, Result};

/// A passive antenna radiates no more than it is fed; this much more is rounding and the grid's coarseness.
pub(super) const MOST_MEAN_GAIN: f64 = 1.05;
/// Angles this close are one, degrees.
const SAME_DEG: f64 = 1e-6;

/// What to do about more power than an antenna is fed.
pub(super) const TOO_MUCH: &str =
    "give gains in dBi, or shift them so that the mean is 1 with normalize = true (directivity, without losses)";

/// A file's lines under its line of names.
pub(super) struct Table<'t> {
    /// The file, for messages.
    pub name: &'t str,
    /// Lower case.
    pub names: Vec<String>,
    /// Number of the line, and its values.
    pub rows: Vec<(usize, Vec<&'t str>)>,
}

impl<'t> Table<'t> {
    pub fn of(text: &'t str, name: &'t str) -> Result<Self> {
        let mut lines =
            text.trim_start_matches('\u{feff}').lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#'));
        let Some((_, head)) = lines.next() else { return Err(Error::invalid(name, "it is empty", HELP)) };
        let names: Vec<String> = head.split(',').map(|n| n.trim().trim_matches('"').to_ascii_lowercase()).collect();
        let mut rows: Vec<(usize, Vec<&str>)> = vec![];
        for (i, line) in lines {
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            if cells.len() != names.len() {
                let what = format!("{} values under {} names", cells.len(), names.len());
                return Err(Error::invalid(format!("{name}:{}", i + 1), what, HELP));
            }
            rows.push((i + 1, cells));
        }
        Ok(Self { name, names, rows })
    }

    pub fn fail(&self, what: impl Into<String>) -> Error {
        Error::invalid(self.name, what, HELP)
    }

    /// A line as messages name it.
    pub fn line(&self, line: usize) -> String {
        format!("{}:{line}", self.name)
    }

    pub fn number(&self, line: usize, cell: &str) -> Result<f64> {
        let value = cell.parse::<f64>().ok().filter(|v| v.is_finite());
        value.ok_or_else(|| Error::invalid(self.line(line), format!("\"{cell}\" is no finite number"), HELP))
    }

    /// Refuses columns whose unit cannot be meant: a pattern of no more than a few degrees, or angles beyond a turn of radians.
    pub fn check_units(&self, columns: &[(usize, Angle)]) -> Result<()> {
        for unit in ["degrees", "radians"] {
            let of_unit = || columns.iter().filter(|(_, angle)| (angle.degrees == 1.0) == (unit == "degrees"));
            if of_unit().next().is_none() || self.rows.is_empty() {
                continue;
            }
            let mut most = 0f64;
            for (line, cells) in &self.rows {
                for (column, _) in of_unit() {
                    most = most.max(self.number(*line, cells[*column])?.abs());
                }
            }
            let (wrong, other, ending) = match unit {
                "degrees" => (most > 0.0 && most <= A_TURN_RAD, "radians", "_rad"),
                _ => (most > A_TURN_RAD, "degrees", "_deg"),
            };
            if wrong {
                let what = format!("its angles in {unit} reach {most:.4} at most: they look like {other}");
                return Err(Error::invalid(self.name, what, format!("name the columns by their unit, with the ending {ending}")));
            }
        }
        Ok(())
    }
}

/// A turn and a little, radians.
const A_TURN_RAD: f64 = 6.3;

/// Unit and zero of an angle.
#[derive(Clone, Copy)]
pub(super) struct Angle {
    pub degrees: f64,
    /// From the zenith down.
    pub zenith: bool,
}

impl Angle {
    pub fn of(self, value: f64) -> f64 {
        let degrees = value * self.degrees;
        if self.zenith { 90.0 - degrees } else { degrees }
    }
}

/// What a file of a pattern is.
pub(super) const HELP: &str = "a line of names, then a line a direction: tilt_deg (or tilt_rad, elevation_deg, theta_deg from the zenith), pan_deg (or pan_rad, azimuth_deg, \
                    phi_deg) and gain_db (or gain_dbi, snr_norm); or two cuts: cut (horizontal or vertical), angle_deg, gain_db; \
                    or, of a receiver, a line a direction and element: tilt, pan, element, re and im (or gain_db and phase_deg)";

/// An angle as a whole number, so that what is one is one.
pub(super) fn key(angle_deg: f64) -> i64 {
    (angle_deg / SAME_DEG).round() as i64
}

pub(super) fn angle(key: i64) -> f64 {
    key as f64 * SAME_DEG
}

/// The columns of tilts and of pans.
pub(super) fn angles(names: &[String], fail: &dyn Fn(String) -> Error) -> Result<[(usize, Angle); 2]> {
    let find = |kinds: &[(&str, bool)]| {
        let named = |(i, n): (usize, &String)| {
            kinds.iter().find_map(|(kind, zenith)| {
                let degrees = match n.strip_prefix(kind)? {
                    "_deg" => 1.0,
                    "_rad" => 180.0 / std::f64::consts::PI,
                    _ => return None,
                };
                Some((i, Angle { degrees, zenith: *zenith }))
            })
        };
        names.iter().enumerate().find_map(named)
    };
    let tilt = find(&[("tilt", false), ("elevation", false), ("theta", true)])
        .ok_or_else(|| fail("it has no column of tilts".into()))?;
    let pan =
        find(&[("pan", false), ("azimuth", false), ("phi", false)]).ok_or_else(|| fail("it has no column of pans".into()))?;
    Ok([tilt, pan])
}

/// The column of gains in decibels.
pub(super) fn level(names: &[String]) -> Option<usize> {
    names.iter().position(|n| ["gain_db", "gain_dbi", "snr_norm", "snr_db", "level_db"].contains(&n.as_str()))
}
