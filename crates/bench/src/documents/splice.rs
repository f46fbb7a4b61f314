//! Tables from records, the help of every command and the keys of configuration files, written into documents between markers.
//!
//! ```text
//! <!-- corf docs: table results/FOLDER KEY,KEY -->    the table of a folder of records, with these columns
//! <!-- corf docs: table results/FOLDER KEY,KEY rows A; B -->  the same with these rows alone, without its note
//! <!-- corf docs: paper results/FOLDER I -->          a table of the paper (I to IV) with a folder's records beside it
//! <!-- corf docs: methods -->                         every method and what it is
//! <!-- corf docs: columns -->                         every metric: heading, key, definition
//! <!-- corf docs: help -->                            the help of every command
//! <!-- corf docs: keys scene -->                      the keys of a scene file, a data-set file (`keys dataset`), the settings of `corf paths` and
//!                                                     `corf coverage` (`keys paths`), a sweep (`keys sweep`)
//! <!-- corf docs: end -->
//! ```

use crate::comparison::suite;
use crate::comparison::sweep::Sweep;
use crate::documents::schema;
use crate::methods::registry;
use crate::metrics::COLUMNS;
use crate::radio_link::LinkConfig;
use crate::table;
use crate::table::paper;
use anyhow::{Context, Result, bail, ensure};
use corf_scene::config::{DatasetConfig, SceneConfig};
use std::path::Path;

const BEGIN: &str = "<!-- corf docs: ";
const END: &str = "<!-- corf docs: end -->";

/// A document whose marked places are written anew. Folders of records are relative to `folder`, the document's own; `help` is the text of all
/// commands.
///
/// # Errors
/// A marker that is not understood or has no end, by its line; records that cannot be read; a column that does not exist.
pub fn spliced(text: &str, folder: &Path, help: &str) -> Result<String> {
    let mut out = String::with_capacity(text.len());
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        out.push_str(line);
        out.push('\n');
        let Some(order) = line.strip_prefix(BEGIN).and_then(|rest| rest.strip_suffix(" -->")) else { continue };
        let place = || format!("line {}: {line}", number + 1);
        ensure!(order != "end", "{}\n  help: an end without a beginning", place());
        out.push('\n');
        out.push_str(content(order, folder, help).with_context(place)?.trim_end());
        out.push_str("\n\n");
        if !lines.any(|(_, line)| line == END) {
            bail!("{}\n  help: end the marked place with {END}", place());
        }
        out.push_str(END);
        out.push('\n');
    }
    Ok(out)
}

fn content(order: &str, folder: &Path, help: &str) -> Result<String> {
    let (order, labels) = order.split_once(" rows ").map_or((order, None), |(order, labels)| (order, Some(labels)));
    let words: Vec<&str> = order.split_whitespace().collect();
    match words[..] {
        ["help"] => Ok(help.to_owned()),
        ["keys", "scene"] => Ok(schema::tables::<SceneConfig>("Scene file")),
        ["keys", "dataset"] => Ok(schema::tables::<DatasetConfig>("Data-set file")),
        ["keys", "paths"] => Ok(schema::tables::<LinkConfig>("Settings of links")),
        ["keys", "sweep"] => Ok(schema::tables::<Sweep>("Sweep file")),
        ["methods"] => Ok(methods()),
        ["columns"] => Ok(columns()),
        ["table", records] => table_of(&folder.join(records), &[], labels),
        ["table", records, keys] => table_of(&folder.join(records), &keys.split(',').collect::<Vec<_>>(), labels),
        ["paper", records, number] => paper_table(&folder.join(records), number),
        _ => bail!(
            "neither `table FOLDER`, `table FOLDER KEY,KEY`, `paper FOLDER I`, `methods`, `columns`, `help`, `keys scene`, `keys dataset`, `keys paths` nor `keys sweep`"
        ),
    }
}

/// The table of a folder's records; of some rows alone, by their labels between semicolons, without the note, which is of the whole table.
fn table_of(folder: &Path, keys: &[&str], labels: Option<&str>) -> Result<String> {
    let records = suite::records(folder)?;
    let (mut rows, columns) = (table::rows(&records), table::columns(keys)?);
    let Some(labels) = labels else { return Ok(table::markdown(&rows, &columns)) };
    let labels: Vec<&str> = labels.split(';').map(str::trim).collect();
    for label in &labels {
        ensure!(rows.iter().any(|row| row.label == *label), "{} has no row \"{label}\"", folder.display());
    }
    rows.retain(|row| labels.contains(&row.label.as_ref()));
    rows.sort_by_key(|row| labels.iter().position(|label| row.label == *label));
    let text = table::markdown(&rows, &columns);
    Ok(text.split_once("\n\n").map_or(text.as_str(), |(table, _)| table).to_owned())
}

/// A table of the paper beside a folder's records.
fn paper_table(folder: &Path, number: &str) -> Result<String> {
    let records = suite::records(folder)?;
    let rows = table::rows(&records);
    let tables = paper::tables(&rows);
    let wanted = tables.iter().find(|t| t.table.number == number);
    Ok(paper::markdown_of(wanted.with_context(|| format!("the paper has no table {number}\n  help: I, II, III or IV"))?))
}

/// Every method that `--method` takes, with its line of help.
fn methods() -> String {
    let rows = registry::all().map(|method| format!("| `{}` | {} |\n", method.id, method.help.replace('|', "\\|")));
    format!("| name | what it is |\n|---|---|\n{}", rows.collect::<String>())
}

/// Every metric with its key and its definition.
fn columns() -> String {
    let mut out = String::from("| column | key | definition |\n|---|---|---|\n");
    for c in COLUMNS {
        out.push_str(&format!("| {} | `{}` | {} |\n", c.heading, c.key, c.definition().replace('|', "\\|")));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marked_places_are_written_anew_and_the_rest_is_left() {
        let text = "before\n<!-- corf docs: help -->\nold\n<!-- corf docs: end -->\nafter\n";
        let new = spliced(text, Path::new("."), "the help\n").unwrap();
        assert_eq!(new, "before\n<!-- corf docs: help -->\n\nthe help\n\n<!-- corf docs: end -->\nafter\n");
        assert_eq!(spliced(&new, Path::new("."), "the help\n").unwrap(), new);
    }

    #[test]
    fn a_table_of_the_paper_has_its_figures_and_ours() {
        let text = "<!-- corf docs: paper ../../results/2026-11-27-lobby147 IV -->\n<!-- corf docs: end -->\n";
        let new = spliced(text, Path::new("."), "").unwrap();
        let frozen = new.lines().find(|l| l.starts_with("| w/o joint (frozen geometry)")).unwrap();
        assert!(frozen.contains("| 24.03 ± 0.14 | 17.11 |") && frozen.contains("| -1.68 ± 0.30 | -1.41 |"), "{frozen}");
        assert!(new.contains("over 5 seeds") && !new.contains("(30, 10)"), "{new}");
    }

    #[test]
    fn markers_that_mean_nothing_are_refused_with_their_line() {
        for (text, said) in [
            ("a\n<!-- corf docs: help -->\n", "end the marked place"),
            ("<!-- corf docs: end -->\n", "without a beginning"),
            ("<!-- corf docs: tables x -->\n<!-- corf docs: end -->\n", "neither `table FOLDER`"),
            ("<!-- corf docs: paper ../../results/2026-11-27-lobby147 V -->\n<!-- corf docs: end -->\n", "no table V"),
            ("<!-- corf docs: table nowhere -->\n<!-- corf docs: end -->\n", "nowhere"),
        ] {
            let error = format!("{:#}", spliced(text, Path::new("."), "").unwrap_err());
            assert!(error.contains(said) && error.contains("line "), "{error}");
        }
    }
}
