//! The header and the numbers of a PLY file.

use crate::{Appearance, Error, Result};
use std::{collections::HashMap, path::Path};

/// The float columns of a PLY's vertex element.
pub(super) struct Table {
    place: String,
    comments: Vec<String>,
    rows: usize,
    columns: HashMap<String, usize>,
    width: usize,
    values: Vec<f32>,
}

impl Table {
    pub fn read(path: &Path) -> Result<Self> {
        let place = path.display().to_string();
        let bytes = corf_scene::io::read(path)?;
        let help = "give a binary little-endian PLY of Gaussians, as corf and 3DGS write them";
        let invalid = |what: String| Error::invalid(place.clone(), what, help);
        let end = b"end_header\n";
        let at =
            bytes.windows(end.len()).position(|w| w == end).ok_or_else(|| invalid("no PLY header ends in this file".into()))?;
        let header = std::str::from_utf8(&bytes[..at]).map_err(|_| invalid("the PLY header is not text".into()))?;
        let mut lines = header.lines().map(str::trim_end).enumerate();
        if lines.next().map(|l| l.1) != Some("ply") {
            return Err(invalid("the first line is not `ply`".into()));
        }
        let (mut rows, mut columns, mut in_vertex, mut formatted, mut alone) = (None, HashMap::new(), false, false, true);
        let mut comments = vec![];
        for (number, line) in lines {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["comment", words @ ..] => comments.push(words.join(" ")),
                ["obj_info", ..] | [] => {}
                ["format", "binary_little_endian", _] => formatted = true,
                ["format", other, ..] => return Err(invalid(format!("header line {}: the format is {other}", number + 1))),
                ["element", "vertex", _] if rows.is_some() => {
                    return Err(invalid(format!("header line {}: a second `element vertex`", number + 1)));
                }
                ["element", "vertex", count] => {
                    let count = count.parse().map_err(|_| invalid(format!("header line {}: {count} is no count", number + 1)))?;
                    (rows, in_vertex) = (Some(count), true);
                }
                // The vertices come first in the body, so elements after them can be left alone.
                ["element", ..] if rows.is_some() => (in_vertex, alone) = (false, false),
                ["property", "float" | "float32", name] if in_vertex => {
                    let next = columns.len();
                    if columns.insert((*name).to_string(), next).is_some() {
                        return Err(invalid(format!("header line {}: a second property `{name}`", number + 1)));
                    }
                }
                ["property", ..] if !in_vertex && rows.is_some() => {}
                _ => return Err(invalid(format!("header line {}: cannot use `{line}`", number + 1))),
            }
        }
        if !formatted {
            return Err(invalid("the header does not state its format".into()));
        }
        let rows: usize = rows.ok_or_else(|| invalid("the header has no `element vertex`".into()))?;
        let width = columns.len();
        let body = &bytes[at + end.len()..];
        let needed = rows.checked_mul(width * 4).ok_or_else(|| invalid(format!("{rows} vertices are too many")))?;
        if body.len() < needed {
            let whole = if width > 0 { body.len() / (width * 4) } else { 0 };
            return Err(Error::invalid(
                place,
                format!("the file ends after vertex {whole} of {rows} ({} of {needed} bytes)", body.len()),
                "the file is truncated: write or copy it again",
            ));
        }
        if alone && body.len() > needed {
            return Err(Error::invalid(
                place,
                format!("{} bytes of data where {rows} vertices of {width} columns take {needed}", body.len()),
                "the header and the data disagree: write or copy the file again",
            ));
        }
        let values = body[..needed].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        Ok(Self { place, comments, rows, columns, width, values })
    }

    /// What the header's comments say, word by word.
    pub fn comments(&self) -> impl Iterator<Item = &str> {
        self.comments.iter().map(String::as_str)
    }

    pub fn invalid(&self, what: String, help: &str) -> Error {
        Error::invalid(self.place.clone(), what, help)
    }

    fn column(&self, name: &str) -> Result<usize> {
        self.columns
            .get(name)
            .copied()
            .ok_or_else(|| self.invalid(format!("there is no column `{name}`"), "give a PLY of Gaussians with this column"))
    }

    /// Rows of some columns; every number must be finite.
    fn rows<const N: usize>(&self, names: [&str; N]) -> Result<Vec<[f32; N]>> {
        let mut at = [0; N];
        for (a, name) in at.iter_mut().zip(names) {
            *a = self.column(name)?;
        }
        (0..self.rows)
            .map(|r| {
                let row = at.map(|a| self.values[r * self.width + a]);
                match row.iter().position(|v| !v.is_finite()) {
                    None => Ok(row),
                    Some(bad) => Err(self
                        .invalid(format!("vertex {r}, column `{}` is {}", names[bad], row[bad]), "every number must be finite")),
                }
            })
            .collect()
    }

    #[allow(clippy::type_complexity)]
    pub fn geometry(&self) -> Result<(Vec<[f32; 3]>, Vec<[f32; 4]>, Vec<[f32; 3]>)> {
        Ok((
            self.rows(["x", "y", "z"])?,
            self.rows(["rot_0", "rot_1", "rot_2", "rot_3"])?,
            self.rows(["scale_0", "scale_1", "scale_2"])?,
        ))
    }

    pub fn appearance(&self, prefix: &str) -> Result<Appearance> {
        let count = |stem: &str| (0..).take_while(|i| self.columns.contains_key(&format!("{prefix}{stem}_{i}"))).count();
        let (channels, rest) = (count("f_dc"), count("f_rest"));
        if channels == 0 {
            self.column(&format!("{prefix}f_dc_0"))?;
        }
        let sh_degree = (0..=3).find(|d| ((d + 1) * (d + 1) - 1) * channels == rest).ok_or_else(|| {
            let what = format!("{rest} columns `{prefix}f_rest_*` fit no spherical-harmonic degree with {channels} channel(s)");
            self.invalid(what, "degrees 0 to 3 have 0, 3, 8 or 15 of them per channel")
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
