//! The header and the numbers of a PLY file: text or binary in either byte order, elements and columns in any order and of all eight types.

use crate::{Appearance, Error, Result};
use std::collections::HashMap;
use std::path::Path;

/// The numbers of a PLY's vertex element.
#[derive(Debug)]
pub(super) struct Table {
    place: String,
    comments: Vec<String>,
    rows: usize,
    /// Names and types of the columns, in the file's order; lists are none.
    columns: Vec<(String, Scalar)>,
    index: HashMap<String, usize>,
    values: Vec<f32>,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    /// By either of its names.
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// The older of its names.
    fn name(self) -> &'static str {
        match self {
            Self::I8 => "char",
            Self::U8 => "uchar",
            Self::I16 => "short",
            Self::U16 => "ushort",
            Self::I32 => "int",
            Self::U32 => "uint",
            Self::F32 => "float",
            Self::F64 => "double",
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// The number in as many bytes as the type has.
    fn value(self, bytes: &[u8], order: Order) -> f64 {
        // Little-endian, at the front.
        let mut b = [0; 8];
        let of = &mut b[..self.bytes()];
        of.copy_from_slice(bytes);
        if order == Order::Big {
            of.reverse();
        }
        let four = [b[0], b[1], b[2], b[3]];
        match self {
            Self::I8 => f64::from(b[0] as i8),
            Self::U8 => f64::from(b[0]),
            Self::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Self::I32 => f64::from(i32::from_le_bytes(four)),
            Self::U32 => f64::from(u32::from_le_bytes(four)),
            Self::F32 => f64::from(f32::from_le_bytes(four)),
            Self::F64 => f64::from_le_bytes(b),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    Little,
    Big,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Text,
    Binary(Order),
}

/// A column of an element.
#[derive(Debug)]
enum Property {
    Scalar(Scalar),
    /// Types of the length and of the items.
    List(Scalar, Scalar),
}

#[derive(Debug)]
struct Element {
    name: String,
    rows: usize,
    properties: Vec<(String, Property)>,
}

impl Element {
    /// Bytes of a row, where all rows have as many.
    fn row_bytes(&self) -> Option<usize> {
        let bytes = |(_, property): &(String, Property)| match property {
            Property::Scalar(scalar) => Some(scalar.bytes()),
            Property::List(..) => None,
        };
        self.properties.iter().map(bytes).sum()
    }
}

/// What a file says before its numbers.
struct Header {
    format: Format,
    comments: Vec<String>,
    elements: Vec<Element>,
    /// Bytes and lines that it takes.
    bytes: usize,
    lines: usize,
}

const HELP: &str = "give a PLY of Gaussians, as corf and 3DGS write them";
const TRUNCATED: &str = "the file is truncated: write or copy it again";
const DISAGREE: &str = "the header and the data disagree: write or copy the file again";

impl Header {
    fn read(bytes: &[u8], place: &str) -> Result<Self> {
        let invalid = |what: String| Error::invalid(place, what, HELP);
        let (mut format, mut comments, mut elements) = (None, vec![], Vec::<Element>::new());
        let mut at = 0;
        for number in 1.. {
            let Some(length) = bytes[at..].iter().position(|b| *b == b'\n') else {
                return Err(invalid("no PLY header ends in this file".into()));
            };
            let line = &bytes[at..at + length];
            at += length + 1;
            // Some programs end lines as Windows does.
            let line = line.trim_ascii_end();
            if number == 1 && line != b"ply" {
                return Err(invalid("the first line is not `ply`".into()));
            }
            let line = std::str::from_utf8(line).map_err(|_| invalid("the PLY header is not text".into()))?;
            let fault = |what: String| invalid(format!("header line {number}: {what}"));
            let cannot = || fault(format!("cannot use `{line}`"));
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["ply"] if number == 1 => {}
                ["end_header"] => {
                    let format = format.ok_or_else(|| invalid("the header does not state its format".into()))?;
                    return Ok(Self { format, comments, elements, bytes: at, lines: number });
                }
                ["comment", words @ ..] => comments.push(words.join(" ")),
                ["obj_info", ..] | [] => {}
                ["format", ..] if format.is_some() => return Err(fault("a second format".into())),
                ["format", name, version] => {
                    if *version != "1.0" {
                        return Err(fault(format!("the version is {version}, and 1.0 is the only one")));
                    }
                    format = Some(match *name {
                        "ascii" => Format::Text,
                        "binary_little_endian" => Format::Binary(Order::Little),
                        "binary_big_endian" => Format::Binary(Order::Big),
                        other => return Err(fault(format!("the format is {other}"))),
                    });
                }
                ["element", name, count] => {
                    if elements.iter().any(|e| e.name == *name) {
                        return Err(fault(format!("a second `element {name}`")));
                    }
                    let rows = count.parse().map_err(|_| fault(format!("{count} is no count")))?;
                    elements.push(Element { name: (*name).to_owned(), rows, properties: vec![] });
                }
                ["property", kind @ .., name] => {
                    let scalar = |name: &str| Scalar::named(name).ok_or_else(|| fault(format!("there is no type `{name}`")));
                    let property = match kind {
                        ["list", length, item] => Property::List(scalar(length)?, scalar(item)?),
                        [one] => Property::Scalar(scalar(one)?),
                        _ => return Err(cannot()),
                    };
                    if matches!(property, Property::List(length, _) if length.is_float()) {
                        return Err(fault("the length of a list is a whole number".into()));
                    }
                    let element = elements.last_mut().ok_or_else(|| fault("a property of no element".into()))?;
                    if element.properties.iter().any(|(other, _)| other == name) {
                        return Err(fault(format!("a second property `{name}`")));
                    }
                    element.properties.push(((*name).to_owned(), property));
                }
                _ => return Err(cannot()),
            }
        }
        Err(invalid("no PLY header ends in this file".into()))
    }
}

/// Numbers in binary, one after the other.
struct Binary<'a> {
    rest: &'a [u8],
    all: usize,
    order: Order,
    place: &'a str,
}

impl<'a> Binary<'a> {
    fn ends(&self, element: &Element, row: usize, needed: &str) -> Error {
        let Element { name, rows, .. } = element;
        let what = format!("the file ends after {name} {row} of {rows} ({} of {needed} bytes)", self.all);
        Error::invalid(self.place, what, TRUNCATED)
    }

    /// The bytes of all rows, which have as many each.
    fn whole(&mut self, element: &Element, row_bytes: usize) -> Result<&'a [u8]> {
        let needed = element.rows.checked_mul(row_bytes).ok_or_else(|| {
            Error::invalid(self.place, format!("{} rows of `{}` are too many", element.rows, element.name), DISAGREE)
        })?;
        let Some((taken, rest)) = self.rest.split_at_checked(needed) else {
            let whole = self.rest.len().checked_div(row_bytes).unwrap_or(0);
            let needed = (self.all - self.rest.len()).saturating_add(needed);
            return Err(self.ends(element, whole, &needed.to_string()));
        };
        self.rest = rest;
        Ok(taken)
    }

    /// One row of an element with lists; `put` gets its single numbers in their order.
    fn row(&mut self, element: &Element, row: usize, mut put: impl FnMut(f64)) -> Result<()> {
        let order = self.order;
        for (_, property) in &element.properties {
            let mut take = |bytes: usize| -> Result<&'a [u8]> {
                let Some((taken, rest)) = self.rest.split_at_checked(bytes) else {
                    return Err(self.ends(element, row, "more"));
                };
                self.rest = rest;
                Ok(taken)
            };
            match property {
                Property::Scalar(scalar) => put(scalar.value(take(scalar.bytes())?, order)),
                Property::List(length, item) => {
                    let count = length.value(take(length.bytes())?, order);
                    // What a negative length or one beyond the file asks for is not there.
                    let bytes = if count < 0.0 { usize::MAX } else { (count as usize).saturating_mul(item.bytes()) };
                    take(bytes)?;
                }
            }
        }
        Ok(())
    }
}

impl Table {
    pub fn read(path: &Path) -> Result<Self> {
        let place = path.display().to_string();
        let bytes = corf_scene::io::read(path)?;
        Self::of(&bytes, place)
    }

    fn of(bytes: &[u8], place: String) -> Result<Self> {
        let Header { format, comments, elements, bytes: header_bytes, lines } = Header::read(bytes, &place)?;
        let vertex = elements.iter().find(|e| e.name == "vertex");
        let vertex = vertex.ok_or_else(|| Error::invalid(place.as_str(), "the header has no `element vertex`", HELP))?;
        if vertex.properties.iter().any(|(name, _)| name.starts_with("packed_")) {
            let help = "write it as an ordinary PLY first, e.g. `splat-transform file.compressed.ply file.ply`";
            return Err(Error::invalid(place, "it is a compressed PLY (columns `packed_*`), which is not read", help));
        }
        let columns: Vec<(String, Scalar)> =
            vertex.properties.iter().filter_map(|(name, property)| Some((name.clone(), single(property)?))).collect();
        let index = columns.iter().enumerate().map(|(i, (name, _))| (name.clone(), i)).collect();
        let (rows, body) = (vertex.rows, &bytes[header_bytes..]);
        let values = match format {
            Format::Binary(order) => from_binary(body, order, &elements, &place)?,
            Format::Text => from_text(body, lines, &elements, &place)?,
        };
        Ok(Self { place, comments, rows, columns, index, values })
    }

    /// What the header's comments say, word by word.
    pub fn comments(&self) -> impl Iterator<Item = &str> {
        self.comments.iter().map(String::as_str)
    }

    /// Names of the columns, in the file's order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(|(name, _)| name.as_str())
    }

    /// Whether there is a column of this name.
    pub fn has(&self, name: &str) -> bool {
        self.index.contains_key(name)
    }

    pub fn invalid(&self, what: String, help: &str) -> Error {
        Error::invalid(self.place.clone(), what, help)
    }

    fn column(&self, name: &str) -> Result<usize> {
        let Some(at) = self.index.get(name).copied() else {
            return Err(self.invalid(format!("there is no column `{name}`"), "give a PLY of Gaussians with this column"));
        };
        let scalar = self.columns[at].1;
        if !scalar.is_float() {
            let what = format!("the column `{name}` is of {}: whole numbers mean something else in every program", scalar.name());
            return Err(self.invalid(what, "write it with float or double columns"));
        }
        Ok(at)
    }

    /// Rows of some columns; every number must be finite.
    pub fn rows<const N: usize>(&self, names: [&str; N]) -> Result<Vec<[f32; N]>> {
        let mut at = [0; N];
        for (a, name) in at.iter_mut().zip(names) {
            *a = self.column(name)?;
        }
        (0..self.rows)
            .map(|r| {
                let row = at.map(|a| self.values[r * self.columns.len() + a]);
                match row.iter().position(|v| !v.is_finite()) {
                    None => Ok(row),
                    Some(bad) => Err(self.invalid(
                        format!("vertex {r}, column `{}` is {}", names[bad], row[bad]),
                        "every number must be finite, in single precision",
                    )),
                }
            })
            .collect()
    }

    #[allow(clippy::type_complexity)]
    pub fn geometry(&self) -> Result<(Vec<[f32; 3]>, Vec<[f32; 4]>, Vec<[f32; 3]>)> {
        if self.has("scale_1") && !self.has("scale_2") {
            let what = "it has two scales, scale_0 and scale_1: flat Gaussians, as 2DGS trains them";
            return Err(self.invalid(what.into(), "give Gaussians with three scales: flat ones are drawn in another way"));
        }
        for (stem, count) in [("scale_", 3), ("rot_", 4)] {
            if self.has(&format!("{stem}{count}")) {
                let what = format!("there is a column `{stem}{count}`: more than the {count} of a Gaussian in space");
                return Err(self.invalid(what, "give Gaussians of a scene that stands still"));
            }
        }
        Ok((
            self.rows(["x", "y", "z"])?,
            self.rows(["rot_0", "rot_1", "rot_2", "rot_3"])?,
            self.rows(["scale_0", "scale_1", "scale_2"])?,
        ))
    }

    pub fn appearance(&self, prefix: &str) -> Result<Appearance> {
        let count = |stem: &str| (0..).take_while(|i| self.has(&format!("{prefix}{stem}_{i}"))).count();
        let (channels, rest) = (count("f_dc"), count("f_rest"));
        if channels == 0 {
            self.column(&format!("{prefix}f_dc_0"))?;
        }
        for (stem, count) in [("f_dc", channels), ("f_rest", rest)] {
            let begin = format!("{prefix}{stem}_");
            let numbered = self.names().filter(|name| name.strip_prefix(&begin).is_some_and(|n| n.parse::<u32>().is_ok()));
            if numbered.count() != count {
                let what = format!("columns `{begin}*` leave out `{begin}{count}` and go on behind it");
                return Err(self.invalid(what, "write the file again with all of them"));
            }
        }
        let sh_degree = (0..=3).find(|d| ((d + 1) * (d + 1) - 1) * channels == rest).ok_or_else(|| {
            let what = match (4..=8).find(|d| ((d + 1) * (d + 1) - 1) * channels == rest) {
                Some(degree) => format!("its harmonics are of degree {degree} ({rest} columns `{prefix}f_rest_*`)"),
                None => format!("{rest} columns `{prefix}f_rest_*` fit no spherical-harmonic degree with {channels} channel(s)"),
            };
            self.invalid(what, "degrees 0 to 3 are read, which have 0, 3, 8 or 15 of them per channel")
        })?;
        let mut appearance = Appearance::empty(channels, sh_degree);
        appearance.opacity_logit = self.rows([&format!("{prefix}opacity")])?.into_iter().map(|[o]| o).collect();
        let coefficients = appearance.coefficients();
        let mut sh = vec![0.0; self.rows * appearance.stride()];
        for k in 0..coefficients {
            for c in 0..channels {
                let name = match k {
                    0 => format!("{prefix}f_dc_{c}"),
                    _ => format!("{prefix}f_rest_{}", c * (coefficients - 1) + k - 1),
                };
                for (i, [v]) in self.rows([&name])?.into_iter().enumerate() {
                    sh[i * appearance.stride() + k * channels + c] = v;
                }
            }
        }
        appearance.sh = sh;
        Ok(appearance)
    }
}

/// The single numbers of all vertices, row by row. Every element has to be there, and nothing behind the last.
fn from_binary(body: &[u8], order: Order, elements: &[Element], place: &str) -> Result<Vec<f32>> {
    let mut data = Binary { rest: body, all: body.len(), order, place };
    let mut values = vec![];
    for element in elements {
        let wanted = element.name == "vertex";
        let Some(row_bytes) = element.row_bytes() else {
            for row in 0..element.rows {
                data.row(element, row, |v| {
                    if wanted {
                        values.push(v as f32)
                    }
                })?;
            }
            continue;
        };
        let bytes = data.whole(element, row_bytes)?;
        if wanted && row_bytes > 0 {
            let scalars: Vec<Scalar> = element.properties.iter().filter_map(|(_, p)| single(p)).collect();
            values.reserve_exact(scalars.len() * element.rows);
            for mut row in bytes.chunks_exact(row_bytes) {
                for scalar in &scalars {
                    let (number, rest) = row.split_at(scalar.bytes());
                    values.push(scalar.value(number, order) as f32);
                    row = rest;
                }
            }
        }
    }
    if !data.rest.is_empty() {
        let needed = body.len() - data.rest.len();
        let what = format!("{} bytes of data where the header's elements take {needed}", body.len());
        return Err(Error::invalid(place, what, DISAGREE));
    }
    Ok(values)
}

fn single(property: &Property) -> Option<Scalar> {
    match property {
        Property::Scalar(scalar) => Some(*scalar),
        Property::List(..) => None,
    }
}

/// As [`from_binary`], of text: a line a row. `header_lines` are those before the first.
fn from_text(body: &[u8], header_lines: usize, elements: &[Element], place: &str) -> Result<Vec<f32>> {
    let body =
        std::str::from_utf8(body).map_err(|_| Error::invalid(place, "the data is not text, as its format says", DISAGREE))?;
    let mut lines = body.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let mut values = vec![];
    for element in elements.iter().filter(|e| !e.properties.is_empty()) {
        for row in 0..element.rows {
            let Some((i, line)) = lines.next() else {
                let Element { name, rows, .. } = element;
                return Err(Error::invalid(place, format!("the file ends after {name} {row} of {rows}"), TRUNCATED));
            };
            let fault = |what: String| Error::invalid(format!("{place}:{}", header_lines + i + 1), what, DISAGREE);
            let mut words = line.split_whitespace();
            let mut number = || {
                let word =
                    words.next().ok_or_else(|| fault(format!("the line has too few numbers for a row of `{}`", element.name)))?;
                word.parse::<f64>().map_err(|_| fault(format!("`{word}` is no number")))
            };
            for (_, property) in &element.properties {
                let value = number()?;
                match property {
                    Property::Scalar(_) if element.name == "vertex" => values.push(value as f32),
                    Property::Scalar(_) => {}
                    Property::List(..) => {
                        if !(value >= 0.0 && value.fract() == 0.0) {
                            return Err(fault(format!("{value} is no length of a list")));
                        }
                        let mut left = value;
                        while left > 0.0 {
                            number()?;
                            left -= 1.0;
                        }
                    }
                }
            }
            if let Some(more) = words.next() {
                return Err(fault(format!("`{more}` follows on the last number of a row of `{}`", element.name)));
            }
        }
    }
    match lines.next() {
        None => Ok(values),
        Some((i, _)) => {
            let what = "data follows on the last row of the header's elements";
            Err(Error::invalid(format!("{place}:{}", header_lines + i + 1), what, DISAGREE))
        }
    }
}
