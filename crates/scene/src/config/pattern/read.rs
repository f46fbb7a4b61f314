//! Reads files of antenna patterns: tables of gain over tilt and pan, and pairs of cuts.

use super::file::PatternFile;
use super::sampled::{Sampled, SampledPattern};
use super::table::{Angle, HELP, MOST_MEAN_GAIN, TOO_MUCH, Table, angle, angles, key, level};
use super::{AntennaPattern, ElementGrid};
use crate::{Error, Result, io};
use std::collections::BTreeMap;
use std::path::Path;

/// Share of a grid's samples that a file may lack.
const MOST_HOLES: f64 = 0.01;
/// Two cuts together lose at most this much under the peak, dB (3GPP TR 38.901, Table 7.3-1).
const CUTS_FLOOR_DB: f64 = 30.0;

/// Reads it; `array` are the places of a receiver's elements.
///
/// # Errors
/// A file that cannot be read or is of another form, a part of the sphere of which nothing is said, more power than an antenna is fed; `place`
/// names the key.
pub(super) fn read(file: PatternFile, folder: &Path, place: &str, array: Option<ElementGrid>) -> Result<AntennaPattern> {
    let path = folder.join(file.name());
    let name = path.display().to_string();
    if let Some(outside_db) = file.outside_db().filter(|v| !(-300.0..=100.0).contains(v)) {
        return Err(Error::invalid(format!("{place}.outside_db"), format!("{outside_db} dB"), "give decibels, from -300 to 100"));
    }
    let text = io::read_text(&path)?;
    let (table, sha256) = (Table::of(&text, &name)?, io::sha256_hex(text.as_bytes()));
    if table.names.iter().any(|n| n == "element") {
        let Some(array) = array else {
            let what = "has the responses of an array's elements one by one, which are read of a scene's [receiver] and of `corf paths --config` alone";
            return Err(Error::invalid(name, what, "give a pattern that all elements share: gain over tilt and pan"));
        };
        return Ok(AntennaPattern::Elements(super::read_elements::read(&table, file, sha256, array)?));
    }
    if file.phases().is_some() {
        let help = "leave it out: phases are counted from somewhere in files with a column element alone";
        return Err(Error::invalid(format!("{place}.phases"), format!("{name} has gains alone"), help));
    }
    let mut pattern = parse(&table)?;
    pattern.sha256 = sha256;
    pattern.check(&name)?;
    pattern.grid().check_outside(file.outside_db(), &name)?;
    let mean = Sampled::mean_gain(&pattern, file.outside_db());
    if file.is_normalized() {
        (pattern.shift_db, pattern.mean_gain) = (-10.0 * mean.log10(), 1.0);
    } else if mean > MOST_MEAN_GAIN {
        let what = format!("its mean gain over the sphere is {mean:.3}: it would radiate more than it is fed");
        return Err(Error::invalid(name, what, TOO_MUCH));
    } else {
        pattern.mean_gain = mean;
    }
    Ok(AntennaPattern::Sampled(Sampled::of(file, pattern)?))
}

/// Columns of a table of gains.
struct Columns {
    tilt: (usize, Angle),
    pan: (usize, Angle),
    level: usize,
}

/// Reads a table of gains.
fn parse(table: &Table<'_>) -> Result<SampledPattern> {
    let (names, name) = (&table.names, table.name);
    let fail = |what: String| table.fail(what);
    if let Some(phase) = names.iter().find(|n| n.contains("phase") || n.as_str() == "re" || n.as_str() == "im") {
        let what = format!("column {phase}: phases of a pattern that all elements share are not supported");
        let help = "give gains alone, or, of a receiver, each element's response with a column element";
        return Err(Error::invalid(name, what, help));
    }
    if names.iter().any(|n| n == "cut") {
        let at =
            |wanted: &str| names.iter().position(|n| n == wanted).ok_or_else(|| fail(format!("cuts without a column {wanted}")));
        let (cut, angle, level) = (at("cut")?, at("angle_deg")?, at("gain_db")?);
        table.check_units(&[(angle, Angle { degrees: 1.0, zenith: false })])?;
        let mut cuts: [BTreeMap<i64, f64>; 2] = Default::default();
        for (line, cells) in &table.rows {
            let which = match cells[cut].to_ascii_lowercase().as_str() {
                "vertical" | "v" => 0,
                "horizontal" | "h" => 1,
                other => return Err(Error::invalid(table.line(*line), format!("\"{other}\" is no cut"), HELP)),
            };
            let (angle, level) = (table.number(*line, cells[angle])?, table.number(*line, cells[level])?);
            put(&mut cuts[which], angle, level, &table.line(*line))?;
        }
        return of_cuts(&cuts).ok_or_else(|| fail("it does not have both cuts, with two angles each".into()));
    }
    let columns = columns(names, &fail)?;
    table.check_units(&[columns.tilt, columns.pan])?;
    let mut grid: BTreeMap<i64, BTreeMap<i64, f64>> = BTreeMap::new();
    for (line, cells) in &table.rows {
        let tilt = columns.tilt.1.of(table.number(*line, cells[columns.tilt.0])?);
        let pan = columns.pan.1.of(table.number(*line, cells[columns.pan.0])?);
        let row = grid.entry(key(tilt)).or_default();
        put(row, pan, table.number(*line, cells[columns.level])?, &table.line(*line))?;
    }
    of_grid(&grid).map_err(fail)
}

fn put(row: &mut BTreeMap<i64, f64>, angle_deg: f64, level: f64, place: &str) -> Result<()> {
    match row.insert(key(angle_deg), level) {
        None => Ok(()),
        Some(_) => Err(Error::invalid(
            place,
            format!("the direction at {angle_deg} degrees stands there twice"),
            "give each direction once",
        )),
    }
}

fn columns(names: &[String], fail: &dyn Fn(String) -> Error) -> Result<Columns> {
    let [tilt, pan] = angles(names, fail)?;
    let level = level(names).ok_or_else(|| fail("it has no column of gains in decibels".into()))?;
    match names.iter().enumerate().find(|(i, _)| ![tilt.0, pan.0, level].contains(i)) {
        Some((_, other)) => Err(fail(format!("column \"{other}\" is not known"))),
        None => Ok(Columns { tilt, pan, level }),
    }
}

/// A grid of all tilts and pans; few holes are filled along pan.
fn of_grid(grid: &BTreeMap<i64, BTreeMap<i64, f64>>) -> Result<SampledPattern, String> {
    let pans: Vec<i64> =
        grid.values().flat_map(|row| row.keys().copied()).collect::<std::collections::BTreeSet<_>>().into_iter().collect();
    let (points, all) = (grid.values().map(BTreeMap::len).sum::<usize>(), grid.len() * pans.len());
    let holes = all - points;
    if holes as f64 > MOST_HOLES * all as f64 {
        return Err(format!(
            "{holes} of {all} pairs of its {} tilts and {} pans are missing: it is no grid",
            grid.len(),
            pans.len()
        ));
    }
    let mut gain_db = Vec::with_capacity(all);
    for row in grid.values() {
        for pan in &pans {
            let level = row.get(pan).copied().or_else(|| {
                // On the line between its neighbours, or as the one that there is.
                match (row.range(..pan).next_back(), row.range(pan..).next()) {
                    (Some((p, a)), Some((q, b))) => Some(a + (b - a) * (pan - p) as f64 / (q - p) as f64),
                    (one, other) => one.or(other).map(|(_, level)| *level),
                }
            });
            gain_db.push(level.unwrap_or(f64::NAN));
        }
    }
    let [tilt_deg, pan_deg] =
        [grid.keys().copied().collect::<Vec<_>>(), pans].map(|keys| keys.into_iter().map(angle).collect::<Vec<f64>>());
    Ok(SampledPattern { sha256: String::new(), tilt_deg, pan_deg, gain_db, shift_db: 0.0, mean_gain: 0.0, filled: holes })
}

/// The pattern of a vertical and a horizontal cut: losses under each one's peak add, up to [`CUTS_FLOOR_DB`] in all (3GPP TR 38.901, Table 7.3-1).
fn of_cuts([vertical, horizontal]: &[BTreeMap<i64, f64>; 2]) -> Option<SampledPattern> {
    if vertical.len() < 2 || horizontal.len() < 2 {
        return None;
    }
    let peak = |cut: &BTreeMap<i64, f64>| cut.values().copied().fold(f64::NEG_INFINITY, f64::max);
    let (top, across) = (peak(vertical), peak(horizontal));
    let most = top.max(across);
    let level = |v: &f64, h: &f64| most - ((top - v) + (across - h)).min(CUTS_FLOOR_DB);
    let gain_db = vertical.values().flat_map(|v| horizontal.values().map(move |h| level(v, h))).collect();
    let angles = |cut: &BTreeMap<i64, f64>| cut.keys().map(|k| angle(*k)).collect();
    let (tilt_deg, pan_deg) = (angles(vertical), angles(horizontal));
    Some(SampledPattern { sha256: String::new(), tilt_deg, pan_deg, gain_db, shift_db: 0.0, mean_gain: 0.0, filled: 0 })
}
