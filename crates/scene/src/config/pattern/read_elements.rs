//! Reads files of an array's elements: complex responses, each element's own, over a grid of angles.

use super::elements::{ElementGrid, ElementResponses, Elements, MAX_RESPONSES};
use super::file::{PatternFile, PhaseReference};
use super::grid::direction;
use super::table::{MOST_MEAN_GAIN, TOO_MUCH, Table, angle, angles, key, level};
use crate::words::counted;
use crate::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

/// Below this the elements agree on the phases of no direction, and nothing between samples can be told.
const LEAST_AGREEMENT: f64 = 0.3;
/// Another reading of the phases is meant where under it elements agree on more than half, and by so much more.
const CLEARLY: f64 = 1.5;

/// Reads a table with a column `element`.
///
/// # Errors
/// Directions or elements that stand there twice or are missing, other elements than the array's, phases that do not fit its places, more power than
/// an element is fed.
pub(super) fn read(table: &Table<'_>, file: PatternFile, sha256: String, array: ElementGrid) -> Result<Elements> {
    let name = table.name;
    let samples = samples(table, array.count())?;
    let mut responses = of_grid(&samples, name, array)?;
    responses.sha256 = sha256;
    responses.check(name)?;
    responses.grid().check_outside(file.outside_db(), name)?;
    take_off_places(&mut responses, file.phases().unwrap_or(PhaseReference::Array), name)?;
    let means = responses.mean_gains(file.outside_db());
    let (most, worst) = means.iter().copied().zip(0..).fold((0.0, 0), |most, one| if one.0 > most.0 { one } else { most });
    if most == 0.0 {
        return Err(Error::invalid(name, "no element responds to anything", "give responses, 1 being an isotropic element's"));
    }
    if file.is_normalized() {
        let mean = means.iter().sum::<f64>() / means.len() as f64;
        responses.shift_db = -10.0 * mean.log10();
        responses.mean_gains = means.iter().map(|one| one / mean).collect();
    } else if most > MOST_MEAN_GAIN {
        let what = format!("the mean gain of element {worst} over the sphere is {most:.3}: it would radiate more than it is fed");
        return Err(Error::invalid(name, what, TOO_MUCH));
    } else {
        responses.mean_gains = means;
    }
    Elements::of(file, responses)
}

/// How a column pair becomes a complex number.
enum Form {
    Parts { re: usize, im: usize },
    Polar { level: usize, phase: usize, radians: f64 },
}

/// Responses by tilt and pan (keys), and element.
type Samples = BTreeMap<(i64, i64), BTreeMap<usize, [f64; 2]>>;

fn samples(table: &Table<'_>, count: usize) -> Result<Samples> {
    let (names, fail) = (&table.names, |what: String| table.fail(what));
    let [tilt, pan] = angles(names, &fail)?;
    let at = |wanted: &str| names.iter().position(|n| n == wanted);
    let element = at("element").ok_or_else(|| fail("it has no column element".into()))?;
    let phase = [("phase_deg", PI / 180.0), ("phase_rad", 1.0)].into_iter().find_map(|(n, unit)| Some((at(n)?, unit)));
    let (form, used) = match (at("re").zip(at("im")), level(names).zip(phase)) {
        (Some((re, im)), None) => (Form::Parts { re, im }, [re, im]),
        (None, Some((level, (phase, radians)))) => (Form::Polar { level, phase, radians }, [level, phase]),
        _ => return Err(fail("it needs the columns re and im, or gain_db and phase_deg (or phase_rad), of its elements".into())),
    };
    if let Some((_, other)) = names.iter().enumerate().find(|(i, _)| ![tilt.0, pan.0, element, used[0], used[1]].contains(i)) {
        return Err(fail(format!("column \"{other}\" is not known")));
    }
    table.check_units(&[tilt, pan])?;
    if table.rows.len() > MAX_RESPONSES {
        let what = format!("{} responses are more than {MAX_RESPONSES}", table.rows.len());
        return Err(Error::invalid(table.name, what, "give them on a coarser grid: two degrees are enough for 8x8 elements"));
    }
    let mut samples = Samples::new();
    for (line, cells) in &table.rows {
        let number = |column: usize| table.number(*line, cells[column]);
        let numbered = cells[element].parse::<usize>().ok().filter(|m| *m < count);
        let Some(m) = numbered else {
            let what = format!("element \"{}\", and the array has {}", cells[element], counted(count, "element"));
            let help = format!(
                "number them from 0 to {}: column·rows + row, columns to the left (+y) and rows down (−z) as seen along boresight",
                count - 1
            );
            return Err(Error::invalid(table.line(*line), what, help));
        };
        let value = match form {
            Form::Parts { re, im } => [number(re)?, number(im)?],
            Form::Polar { level, phase, radians } => {
                let (level_db, phase_rad) = (number(level)?, number(phase)? * radians);
                if !(-300.0..=100.0).contains(&level_db) {
                    let what = format!("a gain of {level_db} dB");
                    return Err(Error::invalid(table.line(*line), what, "gains are decibels, from -300 to 100"));
                }
                let (sin, cos) = phase_rad.sin_cos();
                [cos, sin].map(|part| part * 10f64.powf(level_db / 20.0))
            }
        };
        let (tilt_deg, pan_deg) = (tilt.1.of(number(tilt.0)?), pan.1.of(number(pan.0)?));
        if samples.entry((key(tilt_deg), key(pan_deg))).or_default().insert(m, value).is_some() {
            let what = format!("element {m} at tilt {tilt_deg:.4} and pan {pan_deg:.4} degrees stands there twice");
            return Err(Error::invalid(table.line(*line), what, "give each direction of an element once"));
        }
    }
    Ok(samples)
}

/// A grid without holes: phases are not filled in.
fn of_grid(samples: &Samples, name: &str, array: ElementGrid) -> Result<ElementResponses> {
    let count = array.count();
    let found: BTreeSet<usize> = samples.values().flat_map(|of| of.keys().copied()).collect();
    let lacking: Vec<String> = (0..count).filter(|m| !found.contains(m)).map(|m| m.to_string()).collect();
    if !lacking.is_empty() {
        let few = lacking.iter().take(5).cloned().collect::<Vec<_>>().join(", ");
        let more = if lacking.len() > 5 { format!(" and {} more", lacking.len() - 5) } else { String::new() };
        let what = format!("it has {} of the array's {count} elements: {few}{more} missing", found.len());
        return Err(Error::invalid(
            name,
            what,
            "give the responses of all elements of rows x cols, or the rows and cols of this array",
        ));
    }
    let [tilts, pans] = [0, 1].map(|k| {
        let keys: BTreeSet<i64> = samples.keys().map(|at| if k == 0 { at.0 } else { at.1 }).collect();
        keys.into_iter().collect::<Vec<_>>()
    });
    let all = tilts.len() * pans.len() * count;
    if all > MAX_RESPONSES.max(2 * samples.len() * count) {
        let what = format!("{} directions of {} tilts and {} pans: it is no grid", samples.len(), tilts.len(), pans.len());
        return Err(Error::invalid(name, what, "give every pair of tilt and pan"));
    }
    let (mut responses, mut holes, mut first) = (Vec::with_capacity(all), 0, String::new());
    for tilt in &tilts {
        for pan in &pans {
            let of = samples.get(&(*tilt, *pan));
            for m in 0..count {
                match of.and_then(|of| of.get(&m)) {
                    Some(value) => responses.push(value.map(|v| v as f32)),
                    None => {
                        if holes == 0 {
                            first = format!("element {m} at tilt {:.4} and pan {:.4} degrees", angle(*tilt), angle(*pan));
                        }
                        holes += 1;
                    }
                }
            }
        }
    }
    if holes > 0 {
        let what =
            format!("{holes} of {all} responses over {} tilts and {} pans are missing, first {first}", tilts.len(), pans.len());
        return Err(Error::invalid(name, what, "give every element at every pair of tilt and pan: phases are not filled in"));
    }
    Ok(ElementResponses {
        sha256: String::new(),
        array,
        tilt_deg: tilts.into_iter().map(angle).collect(),
        pan_deg: pans.into_iter().map(angle).collect(),
        responses,
        shift_db: 0.0,
        mean_gains: vec![0.0; count],
    })
}

/// Takes the phases of the elements' places off where the file has them, after a check that the phases are what is stated of them.
fn take_off_places(responses: &mut ElementResponses, stated: PhaseReference, name: &str) -> Result<()> {
    let array = responses.array;
    let by_rows = |m: usize| (m % array.cols) * array.rows + m / array.cols;
    // Signs of y and z, whether elements are numbered along rows first, and what it would be.
    let mut readings = vec![("phases = \"element\"", 0.0, 0.0, false)];
    for (rows_first, [right, mirrored, upside, conjugate]) in [
        (
            false,
            [
                "phases = \"array\"",
                "phases = \"array\" with pan counted the other way, or columns numbered from the left",
                "phases = \"array\" with tilt counted downwards, or rows numbered from below",
                "phases = \"array\" under e^{-jωt}: the signs of all phases turned",
            ],
        ),
        (
            true,
            [
                "phases = \"array\" with elements numbered along rows first",
                "phases = \"array\" with elements numbered along rows first, and pan counted the other way",
                "phases = \"array\" with elements numbered along rows first, and tilt counted downwards",
                "phases = \"array\" with elements numbered along rows first, under e^{-jωt}",
            ],
        ),
    ] {
        readings.extend([
            (right, 1.0, 1.0, rows_first),
            (mirrored, -1.0, 1.0, rows_first),
            (upside, 1.0, -1.0, rows_first),
            (conjugate, -1.0, -1.0, rows_first),
        ]);
    }
    let stated_is = usize::from(stated == PhaseReference::Array);
    let agreements: Vec<f64> = readings
        .iter()
        .map(|&(_, y, z, rows_first)| {
            responses.agreement(|m, u| {
                let [along_y, along_z] = array.phases_rad(if rows_first { by_rows(m) } else { m }, u);
                y * along_y + z * along_z
            })
        })
        .collect();
    let own = agreements[stated_is];
    let (best, best_is) =
        agreements.iter().copied().zip(0..).fold((own, stated_is), |best, one| if one.0 > best.0 { one } else { best });
    let share = |agreement: f64| format!("{:.0} %", 100.0 * agreement);
    if best > 0.5 && best > CLEARLY * own {
        let what = format!(
            "read as {}, its elements agree on the phases of a direction by {}; read as {} they agree by {}",
            readings[stated_is].0,
            share(own),
            readings[best_is].0,
            share(best)
        );
        let help = "say what phases are counted from (phases = \"array\" or \"element\"), or turn the file's signs or numbers";
        return Err(Error::invalid(name, what, help));
    }
    if best < LEAST_AGREEMENT {
        let what = format!("its elements agree on the phases of a direction by {} at most, however they are read", share(best));
        let help = "phases are those of a plane wave at each element, counted from the array's centre or from the element; give a finer grid if they turn between samples";
        return Err(Error::invalid(name, what, help));
    }
    if stated == PhaseReference::Array {
        let angles: Vec<_> =
            responses.tilt_deg.iter().flat_map(|t| responses.pan_deg.iter().map(|p| direction(*t, *p))).collect();
        for (of, u) in responses.responses.chunks_exact_mut(array.count()).zip(angles) {
            for (m, value) in of.iter_mut().enumerate() {
                let [y, z] = array.phases_rad(m, u);
                let ([re, im], (sin, cos)) = (value.map(f64::from), (y + z).sin_cos());
                *value = [(re * cos + im * sin) as f32, (im * cos - re * sin) as f32];
            }
        }
    }
    Ok(())
}
