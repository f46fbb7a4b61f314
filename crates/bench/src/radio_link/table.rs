//! Points in a text file: a table of numbers, whose columns a line of names may say.
//!
//! Separators are commas, semicolons, tabs or blanks, as the first line has them; fields may be quoted as RFC 4180 has it; empty lines and
//! those that begin with `#` are left out. Without names a line is x, y, z in metres. With them the columns called x, y and z are taken, in
//! whatever order, in the units that their names or a line below say, and all others are skipped.

use corf_scene::Error;
use corf_scene::words::counted;
use glam::DVec3;

/// What a text file holds.
#[derive(Debug, Default)]
pub(super) struct Table {
    /// World positions, metres.
    pub points: Vec<DVec3>,
    /// What was skipped or changed, in words.
    pub notes: Vec<String>,
}

/// A line with something in it, or several where a quoted field goes on.
struct Line<'t> {
    /// Counted from 1.
    number: usize,
    text: &'t str,
    is_comment: bool,
}

/// What parts the fields of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Separator {
    One(char),
    /// Any number of blanks and tabs.
    Blanks,
}

/// A column's meaning by its name.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Column {
    /// Coordinate 0, 1 or 2, and metres a unit where the name says them.
    Axis(usize, Option<f64>),
    /// An angle or a height on the earth, or metres of a map.
    Geographic,
    Other,
}

const AXES: [&str; 3] = ["x", "y", "z"];

/// Lengths by their names, metres.
const UNITS: [(&[&str], f64); 8] = [
    (&["m", "metre", "metres", "meter", "meters"], 1.0),
    (&["mm", "millimetre", "millimetres", "millimeter", "millimeters"], 1e-3),
    (&["cm", "centimetre", "centimetres", "centimeter", "centimeters"], 1e-2),
    (&["dm", "decimetre", "decimetres", "decimeter", "decimeters"], 1e-1),
    (&["km", "kilometre", "kilometres", "kilometer", "kilometers"], 1e3),
    (&["ft", "foot", "feet"], 0.3048),
    (&["in", "inch", "inches"], 0.0254),
    (&["yd", "yard", "yards"], 0.9144),
];

/// Words that a coordinate's name may have about it.
const ABOUT: [&str; 17] = [
    "pos",
    "position",
    "coord",
    "coordinate",
    "coordinates",
    "loc",
    "location",
    "point",
    "rx",
    "receiver",
    "ue",
    "user",
    "world",
    "axis",
    "value",
    "local",
    "scene",
];

/// Words of places on the earth.
const GEOGRAPHIC: [&str; 17] = [
    "lat",
    "latitude",
    "lon",
    "long",
    "lng",
    "longitude",
    "alt",
    "altitude",
    "elev",
    "elevation",
    "easting",
    "northing",
    "east",
    "north",
    "utm",
    "wgs84",
    "geo",
];

/// Reads a table; `place` names the file.
///
/// # Errors
/// A line that does not fit, by its number; names that do not say which columns are x, y and z; decimal commas; no point at all.
pub(super) fn read(text: &str, place: &str) -> Result<Table, Error> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let (mut lines, mut separator) = (lines(text, place)?.into_iter().peekable(), None);
    // The line by which spreadsheets are told.
    if let Some(Line { text, .. }) = lines.peek()
        && let Some(said) = text.strip_prefix("sep=")
        && let (Some(one), None) = (said.chars().next(), said.chars().nth(1))
    {
        separator = Some(Separator::One(one));
        lines.next();
    }
    let (mut table, mut columns, mut comments): (Table, Option<Columns>, Vec<Line<'_>>) = (Table::default(), None, Vec::new());
    let mut may_be_units = false;
    for line in lines {
        if line.is_comment {
            comments.push(line);
            continue;
        }
        let at = format!("{place}:{}", line.number);
        let separator = *separator.get_or_insert_with(|| Separator::of(line.text));
        let mut fields = separator.fields(line.text, &at)?;
        // Spreadsheets end lines with empty fields; in a table with names these may be empty columns.
        let width = columns.as_ref().map_or(3, |c: &Columns| c.names.len());
        while fields.len() > width && fields.last().is_some_and(String::is_empty) {
            fields.pop();
        }
        if fields.iter().all(String::is_empty) {
            continue;
        }
        if table.points.is_empty() && columns.is_none() {
            table.notes.extend(comments.iter().filter_map(|comment| units_of_comment(comment, place)));
            match fields.iter().filter(|f| number(f).is_some()).count() {
                0 if !fields.iter().any(|f| has_decimal_comma(f)) => {
                    columns = Some(Columns::of(&fields, &at)?);
                    may_be_units = true;
                    continue;
                }
                all if all == fields.len() => columns = commented(&comments, separator, fields.len(), place)?,
                _ => {}
            }
        }
        let units = std::mem::take(&mut may_be_units);
        match &mut columns {
            Some(columns) if units && !fields.iter().any(|f| number(f).is_some() || has_decimal_comma(f)) => {
                columns.take_units(&fields, &at)?;
            }
            Some(columns) => table.points.push(columns.point(&fields, line.text, &at)?),
            None => table.points.push(plain(&fields, line.text, &at)?),
        }
    }
    if table.points.is_empty() {
        let help = "give three numbers x, y, z a line, in metres, or a line of names and numbers below it";
        return Err(Error::invalid(place, "there is no point in it", help));
    }
    table.notes.extend(columns.into_iter().flat_map(|columns| columns.notes(place)));
    Ok(table)
}

/// Lines with something in them; a quoted field may go on in the next.
fn lines<'t>(text: &'t str, place: &str) -> Result<Vec<Line<'t>>, Error> {
    // Where a line with an open quotation mark begins, and its number.
    let (mut all, mut open): (Vec<Line<'t>>, Option<(usize, usize)>) = (Vec::new(), None);
    let (mut number, mut from) = (0, 0);
    while from < text.len() {
        let rest = &text[from..];
        let length = rest.find(['\n', '\r']).unwrap_or(rest.len());
        number += 1;
        let end = from + length;
        let (begin, first) = open.unwrap_or((from, number));
        let is_comment = open.is_none() && rest[..length].trim_start().starts_with('#');
        let turns = !is_comment && rest[..length].matches('"').count() % 2 == 1;
        open = (open.is_some() != turns).then_some((begin, first));
        let line = &text[begin..end];
        if open.is_none() && !line.trim().is_empty() {
            all.push(Line { number: first, text: line, is_comment });
        }
        from = end + if rest[length..].starts_with("\r\n") { 2 } else { 1 };
    }
    match open {
        None => Ok(all),
        Some((_, first)) => {
            Err(Error::invalid(format!("{place}:{first}"), "a quotation mark is not closed", "close it, or leave it out"))
        }
    }
}

impl Separator {
    /// That of a line, by what stands outside of its quotation marks.
    fn of(line: &str) -> Self {
        let outside: String = line.split('"').step_by(2).collect();
        match outside.trim() {
            line if line.contains(';') => Self::One(';'),
            line if line.matches('\t').count() >= 2 && !decimal_tokens(line) => Self::One('\t'),
            line if line.contains(',') && !decimal_commas(line) => Self::One(','),
            _ => Self::Blanks,
        }
    }

    /// The fields of a line, without quotation marks and the blanks around them.
    fn fields(self, line: &str, at: &str) -> Result<Vec<String>, Error> {
        let is_separator = |c: char| match self {
            Self::One(one) => c == one,
            Self::Blanks => c.is_whitespace(),
        };
        let (mut fields, mut rest) = (Vec::new(), line.trim_start_matches([' ', '\u{a0}']));
        loop {
            if let Some(quoted) = rest.strip_prefix('"') {
                let (field, behind) = unquoted(quoted)
                    .ok_or_else(|| Error::invalid(at, "a quotation mark is not closed", "close it, or leave it out"))?;
                let behind = behind.trim_start_matches([' ', '\u{a0}']);
                if behind.chars().next().is_some_and(|c| !is_separator(c)) && self != Self::Blanks {
                    let what = format!("`{}` stands behind a closing quotation mark", behind.trim());
                    return Err(Error::invalid(at, what, "quote a whole field, and write a quotation mark in it twice"));
                }
                fields.push(field.trim().to_string());
                rest = behind;
            } else {
                let end = rest.find(is_separator).unwrap_or(rest.len());
                fields.push(rest[..end].trim().to_string());
                rest = &rest[end..];
            }
            if self == Self::Blanks {
                rest = rest.trim_start();
                if rest.is_empty() {
                    return Ok(fields.into_iter().filter(|f| !f.is_empty()).collect());
                }
                continue;
            }
            let mut behind = rest.chars();
            if behind.next().is_none() {
                return Ok(fields);
            }
            rest = behind.as_str().trim_start_matches([' ', '\u{a0}']);
        }
    }
}

/// The text up to the closing quotation mark, two of which are one within, and what stands behind it.
fn unquoted(text: &str) -> Option<(String, &str)> {
    let (mut field, mut rest) = (String::new(), text);
    loop {
        let (before, behind) = rest.split_once('"')?;
        field.push_str(before);
        match behind.strip_prefix('"') {
            Some(more) => {
                field.push('"');
                rest = more;
            }
            None => return Some((field, behind)),
        }
    }
}

fn number(field: &str) -> Option<f64> {
    field.parse().ok()
}

/// Whether a word is a number with a comma before its decimals.
fn has_decimal_comma(word: &str) -> bool {
    let word = word.trim().trim_matches('"');
    word.split_once(',').is_some_and(|(whole, decimals)| {
        let digits = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
        digits(whole.trim_start_matches(['-', '+'])) && digits(decimals.split(['e', 'E']).next().unwrap_or_default())
    })
}

/// Whether a line's words, parted by anything but commas, are three at least and have decimal commas.
fn decimal_commas(line: &str) -> bool {
    let words: Vec<&str> = line.split([';', ' ', '\t']).filter(|w| !w.trim().is_empty()).collect();
    words.len() >= 3
        && words.iter().any(|w| has_decimal_comma(w))
        && words.iter().all(|w| number(w).is_some() || has_decimal_comma(w))
}

/// Whether some field between tabs holds blanks within: then tabs are blanks as any.
fn decimal_tokens(line: &str) -> bool {
    line.split('\t').any(|field| field.split_whitespace().count() > 1 && field.split_whitespace().all(|w| number(w).is_some()))
}

/// Three numbers in the order x, y, z, metres.
fn plain(fields: &[String], line: &str, at: &str) -> Result<DVec3, Error> {
    if let [x, y, z] = fields
        && let (Some(x), Some(y), Some(z)) = (number(x), number(y), number(z))
    {
        return Ok(DVec3::new(x, y, z));
    }
    Err(misfit(
        fields,
        line,
        at,
        "is not x, y, z",
        "give three numbers a line, in metres, or the names of the columns in a first line: name,x,y,z",
    ))
}

/// The error of a line that is no point.
fn misfit(fields: &[String], line: &str, at: &str, how: &str, help: &str) -> Error {
    match fields.iter().find(|f| has_decimal_comma(f)).map(String::as_str) {
        Some(word) => decimal_comma(word, at),
        None if decimal_commas(line) => decimal_comma(line.trim(), at),
        None => Error::invalid(at, format!("`{}` {how}", line.trim()), help),
    }
}

fn decimal_comma(word: &str, at: &str) -> Error {
    Error::invalid(at, format!("`{word}` has decimal commas, which are not read"), "write decimal points: 1.5")
}

/// Named columns.
struct Columns {
    names: Vec<String>,
    /// Which of them are x, y and z.
    of_axis: [usize; 3],
    /// Metres a unit, where something said them.
    units: [Option<f64>; 3],
}

impl Columns {
    /// Of a line of names.
    fn of(names: &[String], at: &str) -> Result<Self, Error> {
        let (mut of_axis, mut units) = ([None; 3], [None; 3]);
        let mut geographic = Vec::new();
        for (i, name) in names.iter().enumerate() {
            match meaning(name) {
                Column::Axis(axis, unit) => {
                    if let Some(other) = of_axis[axis].replace(i) {
                        let what = format!(
                            "columns {} and {} are both {}: `{}` and `{name}`",
                            other + 1,
                            i + 1,
                            AXES[axis],
                            names[other]
                        );
                        return Err(Error::invalid(at, what, "name one x, one y and one z"));
                    }
                    units[axis] = unit;
                }
                Column::Geographic => geographic.push(name.as_str()),
                Column::Other => {}
            }
        }
        if let [Some(x), Some(y), Some(z)] = of_axis {
            return Ok(Self { names: names.to_vec(), of_axis: [x, y, z], units });
        }
        let missing: Vec<&str> =
            AXES.into_iter().zip(of_axis).filter(|(_, column)| column.is_none()).map(|(axis, _)| axis).collect();
        let help = "name the columns x_m, y_m and z_m, or x, y and z: world metres of the scene (x_cm and the like are converted); begin a comment with #, or leave names out";
        let what = match geographic.as_slice() {
            [] => format!("`{}` names no column {}", names.join(", "), missing.join(", ")),
            named => format!("`{}` are places on a map or the earth, and no x, y, z in metres of the scene", named.join(", ")),
        };
        Err(Error::invalid(at, what, help))
    }

    /// Takes the units of a line below the names.
    fn take_units(&mut self, fields: &[String], at: &str) -> Result<(), Error> {
        for axis in 0..3 {
            let word = fields.get(self.of_axis[axis]).map_or("", String::as_str);
            if word.is_empty() {
                continue;
            }
            let name = word.trim_matches(|c: char| !c.is_alphanumeric()).to_lowercase();
            let Some(unit) = length(&name) else {
                let what = format!("`{word}`, below {}, is neither a number nor a unit of length", AXES[axis]);
                return Err(Error::invalid(at, what, "give numbers, or a unit: m, cm, mm, km, ft, in"));
            };
            if self.units[axis].is_some_and(|said| said != unit) {
                let what =
                    format!("the unit of {} is `{word}` here and another in `{}`", AXES[axis], self.names[self.of_axis[axis]]);
                return Err(Error::invalid(at, what, "say one of them"));
            }
            self.units[axis] = Some(unit);
        }
        Ok(())
    }

    fn point(&self, fields: &[String], line: &str, at: &str) -> Result<DVec3, Error> {
        let misfit = |how: &str| {
            misfit(fields, line, at, how, "give a number for every x, y and z, and as many fields a line as there are names")
        };
        if fields.len() > self.names.len() {
            return Err(misfit(&format!(
                "has {}, and {}",
                counted(fields.len(), "field"),
                counted(self.names.len(), "named column")
            )));
        }
        let mut point = [0.0; 3];
        for axis in 0..3 {
            let column = self.of_axis[axis];
            let value = fields.get(column).and_then(|field| number(field));
            let value = value.ok_or_else(|| misfit(&format!("has no number in column {}, {}", column + 1, AXES[axis])))?;
            // Metres stay the numbers that they are.
            point[axis] = value * self.units[axis].unwrap_or(1.0);
        }
        Ok(DVec3::from_array(point))
    }

    fn notes(self, place: &str) -> Vec<String> {
        let mut notes = Vec::new();
        let is_read = |column: &usize| self.of_axis.contains(column);
        let skipped: Vec<String> = (0..self.names.len())
            .filter(|column| !is_read(column))
            .map(|column| match self.names[column].as_str() {
                "" => format!("column {}", column + 1),
                name => name.to_string(),
            })
            .collect();
        if !skipped.is_empty() {
            notes.push(format!("{place}: not read: {}", skipped.join(", ")));
        }
        if self.units.iter().flatten().any(|unit| *unit != 1.0) {
            let said = |axis: usize| format!("{} by {}", AXES[axis], self.units[axis].unwrap_or(1.0));
            notes.push(format!("{place}: converted to metres: {}", [0, 1, 2].map(said).join(", ")));
        }
        notes
    }
}

/// The names that the last comment before the numbers says, if it says those of all their columns, as NumPy's `savetxt` writes them.
fn commented(comments: &[Line<'_>], separator: Separator, count: usize, place: &str) -> Result<Option<Columns>, Error> {
    let Some(comment) = comments.last() else { return Ok(None) };
    let at = format!("{place}:{}", comment.number);
    let text = comment.text.trim().trim_start_matches('#');
    let by_separator = separator.fields(text, &at).unwrap_or_default();
    let by_anything = text.split([',', ';', ' ', '\t']).filter(|f| !f.is_empty()).map(str::to_string).collect();
    for names in [by_separator, by_anything] {
        let known = names.iter().filter(|name| meaning(name) != Column::Other).count();
        if names.len() == count && known >= 2 {
            return Columns::of(&names, &at).map(Some);
        }
    }
    // Words that name no columns one by one may still say that numbers are not x, y, z.
    let words: Vec<String> = text.split(|c: char| !c.is_alphanumeric()).map(str::to_lowercase).collect();
    let axes: Vec<&str> = words.iter().map(String::as_str).filter(|word| AXES.contains(word)).collect();
    let named = |names: &[&str]| words.iter().any(|word| names.contains(&word.as_str()));
    let turned = axes.len() == 3 && axes != AXES && AXES.iter().all(|axis| axes.contains(axis));
    if turned || (named(&["lat", "latitude"]) && named(&["lon", "lng", "long", "longitude"])) {
        let what = format!("`#{text}` speaks of other columns than x, y, z");
        return Err(Error::invalid(at, what, "name the columns in a line without #, as many names as there are numbers"));
    }
    Ok(None)
}

/// A word about a comment that speaks of another unit than metres.
fn units_of_comment(comment: &Line<'_>, place: &str) -> Option<String> {
    let mut words = comment.text.split(|c: char| !c.is_alphanumeric()).map(str::to_lowercase);
    // Of these words the one that is a preposition says nothing.
    let unit = words.find(|word| word != "in" && length(word).is_some_and(|unit| unit != 1.0))?;
    Some(format!("{place}:{}: the comment speaks of {unit}; numbers are taken as metres", comment.number))
}

/// Metres of a unit of length, by its name in small letters.
fn length(name: &str) -> Option<f64> {
    UNITS.into_iter().find(|(names, _)| names.contains(&name)).map(|(_, metres)| metres)
}

/// What a column's name says: an axis, with words about it and a unit, or none.
fn meaning(name: &str) -> Column {
    let name = name.trim().trim_start_matches('#').to_lowercase();
    let words: Vec<&str> = name.split(|c: char| !c.is_alphanumeric()).filter(|w| !w.is_empty()).collect();
    if words.iter().any(|word| GEOGRAPHIC.contains(word)) {
        return Column::Geographic;
    }
    let (mut axis, mut unit) = (None, None);
    for (i, &word) in words.iter().enumerate() {
        // As in "x in m"; alone behind a name it is an inch.
        if word == "in" && i + 1 < words.len() {
            continue;
        }
        let found = AXES.into_iter().position(|a| {
            let about = word.strip_prefix(a).or_else(|| word.strip_suffix(a));
            about.is_some_and(|about| about.is_empty() || (about.len() > 2 && ABOUT.contains(&about)))
        });
        match (found, length(word)) {
            (Some(found), _) if axis.is_none() => axis = Some(found),
            (None, Some(metres)) if unit.is_none() && axis.is_some() => unit = Some(metres),
            (None, _) if ABOUT.contains(&word) => {}
            _ => return Column::Other,
        }
    }
    axis.map_or(Column::Other, |axis| Column::Axis(axis, unit))
}

#[cfg(test)]
mod tests;
