//! Devices of rows: cells that ran on different ones have rows of their own, and the note says which ran where.

use super::Row;
use crate::methods::abilities;
use crate::record::{NOT_STATED, Outcome, PREDICTIONS, Record};

/// What a device's name has behind it where a network multiplies in half precision, which is a setting and no other device.
const PRECISION: &str = ", f16 products";
/// Beginning of the processor's name as a device.
const PROCESSOR: &str = "cpu";

/// Where a cell ran: its device, of the processor with its make.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    device: String,
    processor: Option<String>,
}

impl Place {
    /// Where a record's cell ran. The machine that scored another program's predictions is not where they were made.
    pub fn of(record: &Record) -> Self {
        let on_processor = record.device.starts_with(PROCESSOR) && record.method != PREDICTIONS;
        Self { device: record.device.clone(), processor: on_processor.then(|| record.provenance.processor.clone()) }
    }

    /// Whether it is told from others in a table: not where a lookup ran on the processor, and not what nobody knows.
    fn is_reported(&self, method: &str) -> bool {
        self.device != NOT_STATED && !(abilities(method).on_processor && self.device.starts_with(PROCESSOR))
    }

    /// The name by which rows are compared, with the processor's make where devices differ by nothing else.
    fn name(&self, with_processor: bool) -> String {
        let mut name = self.device.strip_suffix(PRECISION).unwrap_or(&self.device).to_owned();
        if let Some(processor) = self.processor.as_ref().filter(|_| with_processor) {
            name += &format!(", {processor}");
        }
        name
    }
}

/// Whether the names of some places need the processor's make to differ.
fn need_processor<'p>(places: impl Iterator<Item = &'p Place>) -> bool {
    let mut makes: Vec<(&str, &Option<String>)> = places.map(|place| (place.device.as_str(), &place.processor)).collect();
    makes.sort();
    makes.dedup();
    makes.windows(2).any(|pair| pair[0].0 == pair[1].0)
}

/// Puts the device behind the label of every row that is not the only one of its cells' label.
pub(super) fn distinguish(rows: &mut [Row<'_>]) {
    for at in 0..rows.len() {
        let of_label = || rows.iter().filter(|row| row.cells_of == rows[at].cells_of);
        if of_label().count() > 1
            && let Some(place) = &rows[at].place
        {
            let with_processor = need_processor(of_label().filter_map(|row| row.place.as_ref()));
            let precision = if place.device.ends_with(PRECISION) { PRECISION } else { "" };
            rows[at].label = format!("{}, on {}{precision}", rows[at].cells_of, place.name(with_processor)).into();
        }
    }
}

/// The rows by the device that they ran on, in order of appearance; none where all ran on one, which then goes without saying.
pub(super) fn groups<'r, 'a>(rows: &[&'r Row<'a>]) -> Vec<(String, Vec<&'r Row<'a>>)> {
    let placed: Vec<(&Place, &'r Row<'a>)> = rows.iter().filter_map(|row| Some((row.place.as_ref()?, *row))).collect();
    let with_processor = need_processor(placed.iter().map(|(place, _)| *place));
    let mut groups: Vec<(String, Vec<&Row<'_>>)> = Vec::new();
    let mut reported: Vec<String> = Vec::new();
    for (place, row) in placed {
        let name = place.name(with_processor);
        if place.is_reported(row.method) && !reported.contains(&name) {
            reported.push(name.clone());
        }
        match groups.iter_mut().find(|group| group.0 == name) {
            Some(group) => group.1.push(row),
            None => groups.push((name, vec![row])),
        }
    }
    let apart = rows.iter().enumerate().any(|(at, row)| rows[..at].iter().any(|other| other.cells_of == row.cells_of));
    if reported.len() > 1 || apart { groups } else { Vec::new() }
}

/// Whether finished cells of these records ran on devices that a table tells apart.
pub(super) fn differ(records: &[Record]) -> bool {
    let finished = || records.iter().filter(|record| matches!(record.outcome, Outcome::Done(_)));
    let mut cells: Vec<(&str, Place)> = finished().map(|record| (record.row.as_str(), Place::of(record))).collect();
    cells.sort();
    cells.dedup();
    if cells.windows(2).any(|pair| pair[0].0 == pair[1].0) {
        return true;
    }
    let reported =
        finished().map(|record| (Place::of(record), record)).filter(|(place, record)| place.is_reported(&record.method));
    let mut names: Vec<(String, Option<String>)> = reported.map(|(place, _)| (place.name(false), place.processor)).collect();
    names.sort();
    names.dedup();
    names.len() > 1
}
