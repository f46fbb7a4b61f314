//! Gaussians as PLY files that other splatting tools read, and back.
//!
//! Binary little endian, one `vertex` element of `float` properties, in the column order of the reference 3DGS implementation: `x y z nx ny nz`,
//! `f_dc_*`, `f_rest_*` (channel-major: all higher coefficients of the first channel, then of the next), `opacity` (logit), `scale_*` (ln metres),
//! `rot_*` (w, x, y, z). `optical.ply` and `rf.ply` hold one modality each, in the same row order; `coupled.ply` is the optical file with the extra
//! columns `rf_opacity`, `rf_f_dc_*`, `rf_f_rest_*`, none of which begins like a standard one, so tools that match prefixes still read it.
//!
//! Colour is `max(0, 0.5 + Σ sh·Y)`, world frame, metres, z up.

use crate::{Appearance, Error, Gaussians, Result};
use corf_scene::io::write_atomic;
use std::{collections::HashMap, path::Path};

/// Geometry and one appearance, as one modality's PLY holds them.
#[derive(Clone, Debug, PartialEq)]
pub struct SingleModality {
    /// Means, metres.
    pub position: Vec<[f32; 3]>,
    /// Quaternions (w, x, y, z).
    pub rotation: Vec<[f32; 4]>,
    /// ln of the standard deviations, metres.
    pub log_scale: Vec<[f32; 3]>,
    /// Opacity and colour.
    pub appearance: Appearance,
}

/// Writes geometry and optical appearance (`optical.ply`).
///
/// # Errors
/// When the file cannot be written; nothing is left behind under its name then.
pub fn write_optical(path: &Path, gaussians: &Gaussians) -> Result<()> {
    write(path, gaussians, &[("", &gaussians.optical)])
}

/// Writes geometry and RF appearance (`rf.ply`); a scalar field has the one channel `f_dc_0`.
///
/// # Errors
/// Those of [`write_optical`].
pub fn write_rf(path: &Path, gaussians: &Gaussians) -> Result<()> {
    write(path, gaussians, &[("", &gaussians.rf)])
}

/// Writes geometry and both appearances (`coupled.ply`).
///
/// # Errors
/// Those of [`write_optical`].
pub fn write_coupled(path: &Path, gaussians: &Gaussians) -> Result<()> {
    write(path, gaussians, &[("", &gaussians.optical), ("rf_", &gaussians.rf)])
}

/// Reads a file of one modality; further columns are ignored, so a coupled file gives its optical half.
///
/// # Errors
/// A file that cannot be read, is no binary little-endian PLY, lacks a column, or is truncated; the message says where.
pub fn read_single(path: &Path) -> Result<SingleModality> {
    let table = Table::read(path)?;
    let (position, rotation, log_scale) = table.geometry()?;
    Ok(SingleModality { position, rotation, log_scale, appearance: table.appearance("")? })
}

/// Reads a coupled file.
///
/// # Errors
/// Those of [`read_single`]; also a file without the RF columns.
pub fn read_coupled(path: &Path) -> Result<Gaussians> {
    let table = Table::read(path)?;
    let (position, rotation, log_scale) = table.geometry()?;
    let optical = table.appearance("")?;
    if optical.channels != 3 {
        let what = format!("the optical colour has {} channel(s)", optical.channels);
        return Err(table.invalid(what, "a coupled file has three: f_dc_0, f_dc_1, f_dc_2"));
    }
    Ok(Gaussians { position, rotation, log_scale, optical, rf: table.appearance("rf_")? })
}

/// The columns of an appearance before and after the opacity's place.
fn color_columns(prefix: &str, appearance: &Appearance) -> Vec<String> {
    let dc = (0..appearance.channels).map(|i| format!("{prefix}f_dc_{i}"));
    let rest = (0..appearance.stride() - appearance.channels).map(|i| format!("{prefix}f_rest_{i}"));
    dc.chain(rest).collect()
}

fn push_color(row: &mut Vec<f32>, appearance: &Appearance, i: usize) {
    let (channels, coefficients) = (appearance.channels, appearance.coefficients());
    let sh = &appearance.sh[i * appearance.stride()..(i + 1) * appearance.stride()];
    row.extend_from_slice(&sh[..channels]);
    for c in 0..channels {
        row.extend((1..coefficients).map(|k| sh[k * channels + c]));
    }
}

fn write(path: &Path, g: &Gaussians, appearances: &[(&str, &Appearance)]) -> Result<()> {
    let (standard, extra) = appearances.split_at(1);
    let mut columns: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).to_vec();
    columns.extend(standard.iter().flat_map(|(prefix, a)| color_columns(prefix, a)));
    columns.push("opacity".into());
    columns.extend((0..3).map(|i| format!("scale_{i}")));
    columns.extend((0..4).map(|i| format!("rot_{i}")));
    for (prefix, a) in extra {
        columns.push(format!("{prefix}opacity"));
        columns.extend(color_columns(prefix, a));
    }
    let mut out = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", g.len());
    columns.iter().for_each(|c| out.push_str(&format!("property float {c}\n")));
    out.push_str("end_header\n");
    let mut out = out.into_bytes();
    out.reserve(4 * columns.len() * g.len());
    let mut row: Vec<f32> = Vec::with_capacity(columns.len());
    for i in 0..g.len() {
        row.clear();
        row.extend(g.position[i]);
        row.extend([0.0; 3]);
        standard.iter().for_each(|(_, a)| push_color(&mut row, a, i));
        row.push(appearances[0].1.opacity_logit[i]);
        row.extend(g.log_scale[i]);
        row.extend(g.rotation[i]);
        for (_, a) in extra {
            row.push(a.opacity_logit[i]);
            push_color(&mut row, a, i);
        }
        if let Some(column) = row.iter().position(|v| !v.is_finite()) {
            let what = format!("Gaussian {i} has {} = {}: the reconstruction has diverged", columns[column], row[column]);
            return Err(Error::invalid(path.display().to_string(), what, "set smaller learning rates or weights"));
        }
        row.iter().for_each(|v| out.extend(v.to_le_bytes()));
    }
    Ok(write_atomic(path, &out)?)
}

/// The float columns of a PLY's vertex element.
struct Table {
    place: String,
    rows: usize,
    columns: HashMap<String, usize>,
    width: usize,
    values: Vec<f32>,
}

impl Table {
    fn read(path: &Path) -> Result<Self> {
        let place = path.display().to_string();
        let bytes = std::fs::read(path).map_err(|source| Error::Io { action: "read", path: path.to_path_buf(), source })?;
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
        for (number, line) in lines {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["comment", ..] | ["obj_info", ..] | [] => {}
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
        Ok(Self { place, rows, columns, width, values })
    }

    fn invalid(&self, what: String, help: &str) -> Error {
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
    fn geometry(&self) -> Result<(Vec<[f32; 3]>, Vec<[f32; 4]>, Vec<[f32; 3]>)> {
        Ok((
            self.rows(["x", "y", "z"])?,
            self.rows(["rot_0", "rot_1", "rot_2", "rot_3"])?,
            self.rows(["scale_0", "scale_1", "scale_2"])?,
        ))
    }

    fn appearance(&self, prefix: &str) -> Result<Appearance> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    fn random(n: usize, rf_channels: usize, optical_degree: usize, rf_degree: usize) -> Gaussians {
        let mut rng = Rng::keyed(1, 2, 3);
        let mut g = Gaussians::empty(rf_channels, optical_degree);
        g.rf = Appearance::empty(rf_channels, rf_degree);
        let mut draw = |n: usize| (0..n).map(|_| rng.uniform() - 0.5).collect::<Vec<f32>>();
        for _ in 0..n {
            let d = draw(10);
            g.position.push([d[0], d[1], d[2]]);
            g.rotation.push([d[3], d[4], d[5], d[6]]);
            g.log_scale.push([d[7], d[8], d[9]]);
            for a in [&mut g.optical, &mut g.rf] {
                a.opacity_logit.extend(draw(1));
                a.sh.extend(draw(a.stride()));
            }
        }
        g
    }

    #[test]
    fn coupled_files_round_trip_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        for (rf_channels, optical_degree, rf_degree) in [(3, 3, 3), (1, 2, 3), (1, 0, 0), (3, 0, 1)] {
            let g = random(17, rf_channels, optical_degree, rf_degree);
            let path = folder.path().join("coupled.ply");
            write_coupled(&path, &g).unwrap();
            assert_eq!(read_coupled(&path).unwrap(), g);
            let optical = read_single(&path).unwrap();
            assert_eq!((optical.position, optical.appearance), (g.position.clone(), g.optical.clone()));
            write_rf(&path, &g).unwrap();
            assert_eq!(read_single(&path).unwrap().appearance, g.rf);
            let error = read_coupled(&path).unwrap_err().to_string();
            assert!(error.contains("channel") || error.contains("rf_f_dc_0"), "{error}");
        }
        let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
        assert_eq!(left.len(), 1, "no temporary file is left");
    }

    #[test]
    fn the_columns_are_those_of_the_reference_implementation_and_channel_major() {
        let folder = tempfile::tempdir().unwrap();
        let g = random(2, 1, 1, 0);
        let path = folder.path().join("optical.ply");
        write_optical(&path, &g).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        let names: Vec<&str> = header.lines().filter_map(|l| l.strip_prefix("property float ")).collect();
        let expected = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 f_rest_6 f_rest_7 f_rest_8 \
                        opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
        assert_eq!(names, expected.split_whitespace().collect::<Vec<_>>());
        assert_eq!(bytes.len() - end, 2 * names.len() * 4);
        let value = |i: usize, name: &str| {
            let at = end + 4 * (i * names.len() + names.iter().position(|n| *n == name).unwrap());
            f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
        };
        // Second coefficient of the green channel of Gaussian 1: channel-major slot 3.
        assert_eq!(value(1, "f_rest_3"), g.optical.sh[g.optical.stride() + 3 + 1]);
        assert_eq!(value(1, "rot_0"), g.rotation[1][0]);
        assert_eq!(value(0, "opacity"), g.optical.opacity_logit[0]);
    }

    #[test]
    fn extra_columns_do_not_begin_like_standard_ones() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("coupled.ply");
        write_coupled(&path, &random(1, 3, 1, 1)).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let header = String::from_utf8_lossy(&bytes);
        let extra = header.lines().filter_map(|l| l.strip_prefix("property float ")).skip_while(|n| *n != "rot_3").skip(1);
        let mut count = 0;
        for name in extra {
            assert!(!["rot", "scale_", "f_rest_", "f_dc_", "red"].iter().any(|p| name.starts_with(p)), "{name}");
            count += 1;
        }
        assert_eq!(count, 1 + 12);
    }

    #[test]
    fn damaged_files_are_refused_with_what_and_where() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("coupled.ply");
        write_coupled(&path, &random(5, 1, 1, 1)).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let refused = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            read_coupled(&path).unwrap_err().to_string()
        };
        let error = refused(&whole[..whole.len() - 3]);
        assert!(error.contains("vertex 4 of 5") && error.contains("truncated") && error.contains("coupled.ply"), "{error}");
        assert!(refused(b"PK\x03\x04").contains("no PLY header"));
        assert!(refused(b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n").contains("ascii"));
        assert!(refused(b"ply\nelement vertex 0\nproperty float x\nend_header\n").contains("does not state its format"));
        assert!(refused(&[&whole[..], b"1234"].concat()).contains("header and the data disagree"));
        let doubled = |line: &str| {
            let at = whole.windows(line.len()).position(|w| w == line.as_bytes()).unwrap();
            refused(&[&whole[..at], line.as_bytes(), &whole[at..]].concat())
        };
        let error = doubled("property float y\n");
        assert!(error.contains("header line 6: a second property `y`"), "{error}");
        assert!(doubled("element vertex 5\n").contains("a second `element vertex`"));
        let text = String::from_utf8_lossy(&whole[..200]).replace("property float y", "property float q");
        let renamed = [text.as_bytes(), &whole[200..]].concat();
        assert!(refused(&renamed).contains("`y`"));
        let mut nan = whole.clone();
        let end = whole.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        nan[end..end + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(refused(&nan).contains("vertex 0, column `x`"));
        assert!(matches!(read_coupled(&folder.path().join("missing.ply")), Err(Error::Io { .. })));
    }
}
