//! `corf paths` as a table: a row a link, CSV or NPZ by the ending of the file.

use super::{Paths, Traced};
use crate::files::ending::ending;
use crate::radio_link::LinkSetup;
use corf_raytrace::radio::channel::LinkStatistics;
use corf_scene::Error;
use corf_scene::npz::{Array, Values, encode_npz};
use serde_json::Value;
use std::path::Path;

/// The form of a table's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Csv,
    Npz,
}

impl Form {
    /// The form that a file's ending says, if it is one of a table.
    pub(super) fn of(path: &Path) -> Option<Self> {
        let ending = ending(path)?;
        [("csv", Self::Csv), ("npz", Self::Npz)].into_iter().find(|(name, _)| *name == ending).map(|(_, form)| form)
    }

    /// The form of `--format table`: CSV on standard output.
    ///
    /// # Errors
    /// A file of another ending.
    pub(super) fn of_output(out: Option<&Path>) -> Result<Self, Error> {
        let Some(path) = out else { return Ok(Self::Csv) };
        let help = "give --out FILE.csv or --out FILE.npz, or another --format";
        Self::of(path).ok_or_else(|| Error::invalid(path.display().to_string(), "a table is written as CSV or as NPZ", help))
    }
}

/// The statistics that are looked for first.
const FIRST: [&str; 5] = ["path_gain_db", "rssi_dbm", "path_gain_coherent_db", "line_of_sight", "k_factor_db"];

/// A column: its name and a value for each link, `None` where there is none.
struct Column {
    name: String,
    values: Vec<Option<f64>>,
}

impl Paths {
    /// The bytes of the table: receivers in their order, and for each the transmitters in theirs.
    pub(super) fn table(&self, setup: &LinkSetup, traced: &Traced<'_>, form: Form) -> anyhow::Result<Vec<u8>> {
        let columns = columns(setup, traced)?;
        Ok(match form {
            Form::Csv => csv(&columns).into_bytes(),
            Form::Npz => encode_npz(&columns.iter().map(Column::array).collect::<Vec<_>>())?,
        })
    }
}

impl Column {
    /// Its values, NaN where there is none.
    fn array(&self) -> Array {
        let values = self.values.iter().map(|value| value.unwrap_or(f64::NAN)).collect();
        Array::new(&self.name, &[self.values.len()], Values::F64(values))
    }
}

/// Positions, the number of paths, and all of [`LinkStatistics`] under its own names.
fn columns(setup: &LinkSetup, traced: &Traced<'_>) -> anyhow::Result<Vec<Column>> {
    let set = &traced.set;
    let mut columns: Vec<Column> = Vec::new();
    let mut add = |name: &str, value: Option<f64>| match columns.iter_mut().find(|column| column.name == name) {
        Some(column) => column.values.push(value),
        None => columns.push(Column { name: name.to_owned(), values: vec![value] }),
    };
    for ((link, diffuse), tx) in set.links.iter().zip(&traced.diffuse).zip(set.tx_arrays.iter().cycle()) {
        for (end, at) in [("tx", link.tx), ("rx", link.rx)] {
            for (axis, metres) in ["x", "y", "z"].into_iter().zip(at.to_array()) {
                add(&format!("{end}_{axis}_m"), Some(metres));
            }
        }
        add("paths", Some(link.paths.len() as f64));
        let elements = [&tx.element, &setup.rx_array.element];
        let (power_dbm, seed) = (setup.link.tx_power_dbm, setup.link.seed);
        let statistics = LinkStatistics::of(&link.paths, diffuse, elements, set.frequency_hz, power_dbm, seed);
        let Value::Object(statistics) = serde_json::to_value(statistics)? else { unreachable!("a record is an object") };
        let of = |name: &str| statistics.get(name).and_then(|value| value.as_bool().map(f64::from).or(value.as_f64()));
        FIRST.iter().for_each(|name| add(name, of(name)));
        statistics.keys().filter(|name| !FIRST.contains(&name.as_str())).for_each(|name| add(name, of(name)));
    }
    Ok(columns)
}

/// A line of names, then a line a link; fields without a value are empty.
fn csv(columns: &[Column]) -> String {
    let line = |fields: Vec<String>| fields.join(",") + "\n";
    let mut text = line(columns.iter().map(|column| column.name.clone()).collect());
    for row in 0..columns.first().map_or(0, |column| column.values.len()) {
        // The shortest digits that are read back as the same number.
        text += &line(columns.iter().map(|column| column.values[row].map_or(String::new(), |v| v.to_string())).collect());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_says_the_form_and_what_is_not_there_is_empty() {
        assert_eq!(Form::of(Path::new("a.b/links.CSV")), Some(Form::Csv));
        assert_eq!(Form::of(Path::new("links.npz")), Some(Form::Npz));
        assert_eq!([Path::new("links"), Path::new("links.json")].map(Form::of), [None; 2]);
        assert!(Form::of_output(Some(Path::new("links.txt"))).unwrap_err().to_string().contains(".csv"));
        assert_eq!(Form::of_output(None).unwrap(), Form::Csv);
        let columns = [("a", vec![Some(0.1), None]), ("b", vec![Some(-70.0), Some(1e-9)])]
            .map(|(name, values)| Column { name: name.into(), values });
        assert_eq!(csv(&columns), "a,b\n0.1,-70\n,0.000000001\n");
    }
}
