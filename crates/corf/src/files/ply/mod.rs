//! Gaussians as PLY files that other splatting tools read, and back.
//!
//! Binary little endian, one `vertex` element of `float` properties, in the column order of the reference 3DGS implementation: `x y z nx ny nz`,
//! `f_dc_*`, `f_rest_*` (channel-major: all higher coefficients of the first channel, then of the next), `opacity` (logit), `scale_*` (ln metres),
//! `rot_*` (w, x, y, z). `optical.ply` and `rf.ply` hold one modality each, in the same row order; `coupled.ply` is the optical file with the extra
//! columns `rf_opacity`, `rf_f_dc_*`, `rf_f_rest_*`, none of which begins like a standard one, so tools that match prefixes still read it.
//!
//! Files of other programs are read in all forms that PLY has (`table.rs`). A column that changes what a Gaussian is has its effect or is refused
//! (`foreign.rs`); of others it is said that they were not read.
//!
//! Comments in the header say how they are to be drawn ([`Notes`]). Colour is `max(0, 0.5 + Σ sh·Y)`, world frame, metres, z up.

mod foreign;
mod notes;
mod table;

pub use notes::Notes;

use crate::{Appearance, Error, Gaussians, Result, device::Modality};
use corf_scene::io::write_atomic;
use std::path::Path;
use table::Table;

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

impl SingleModality {
    /// One half of coupled Gaussians.
    pub fn of(gaussians: Gaussians, modality: Modality) -> Self {
        let Gaussians { position, rotation, log_scale, light, radio } = gaussians;
        let appearance = match modality {
            Modality::Light => light,
            Modality::Radio => radio,
        };
        Self { position, rotation, log_scale, appearance }
    }
}

/// One modality of a file that another program may have written, and the filter that its header names.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignField {
    /// The Gaussians.
    pub gaussians: SingleModality,
    /// Whether they were trained with a filter that compensates opacity; `None` where the header does not say.
    pub antialiased: Option<bool>,
    /// Whether scales and opacities were those before a 3D filter (Mip-Splatting's column `filter_3D`), which was applied.
    pub filter_3d: bool,
    /// Direction that the header says is up, where it says so.
    pub up: Option<[f32; 3]>,
    /// Columns that were not read.
    pub unread: Vec<String>,
}

/// Writes geometry and optical appearance (`optical.ply`).
///
/// # Errors
/// When the file cannot be written; nothing is left behind under its name then.
pub fn write_light(path: &Path, gaussians: &Gaussians, notes: &Notes) -> Result<()> {
    let comments = notes.comments(&gaussians.light, false);
    write(path, Rows::of(gaussians), &[("", &gaussians.light)], &comments)
}

/// Writes geometry and RF appearance (`rf.ply`); a scalar field has the one channel `f_dc_0`.
///
/// # Errors
/// Those of [`write_light`].
pub fn write_radio(path: &Path, gaussians: &Gaussians, notes: &Notes) -> Result<()> {
    write(path, Rows::of(gaussians), &[("", &gaussians.radio)], &notes.comments(&gaussians.radio, true))
}

/// Writes geometry and both appearances (`coupled.ply`).
///
/// # Errors
/// Those of [`write_light`].
pub fn write_coupled(path: &Path, gaussians: &Gaussians, notes: &Notes) -> Result<()> {
    let mut comments = notes.comments(&gaussians.light, false);
    comments.push(format!("SH degree of rf_f_dc: {}", gaussians.radio.sh_degree));
    comments.extend(notes.radio("rf_"));
    write(path, Rows::of(gaussians), &[("", &gaussians.light), ("rf_", &gaussians.radio)], &comments)
}

/// Writes one modality.
///
/// # Errors
/// Those of [`write_light`].
pub fn write_single(path: &Path, field: &SingleModality, modality: Modality, notes: &Notes) -> Result<()> {
    let rows = Rows { position: &field.position, rotation: &field.rotation, log_scale: &field.log_scale };
    write(path, rows, &[("", &field.appearance)], &notes.comments(&field.appearance, modality == Modality::Radio))
}

/// Reads a file of one modality; further columns are ignored, so a coupled file gives its optical half.
///
/// # Errors
/// A file that cannot be read, is no PLY, lacks a column, is truncated, or has columns that make its Gaussians something else; the message says where.
pub fn read_single(path: &Path) -> Result<SingleModality> {
    single(&Table::read(path)?)
}

fn single(table: &Table) -> Result<SingleModality> {
    foreign::check_columns(table)?;
    let (position, rotation, log_scale) = table.geometry()?;
    let mut field = SingleModality { position, rotation, log_scale, appearance: table.appearance("")? };
    foreign::apply_filter(table, &mut field)?;
    Ok(field)
}

/// Reads Gaussians of light that another program trained: the layouts of INRIA's reference implementation, of gsplat and of Mip-Splatting.
///
/// # Errors
/// Those of [`read_single`]; also a file without Gaussians, of other than three colour channels, with a rotation that is none, or with a size that no
/// number holds.
pub fn read_foreign(path: &Path) -> Result<ForeignField> {
    let table = Table::read(path)?;
    let gaussians = single(&table)?;
    if gaussians.position.is_empty() {
        return Err(table.invalid("the file has no Gaussians".into(), "give the PLY of a trained field"));
    }
    if gaussians.appearance.channels != 3 {
        let what = format!("the colour has {} channel(s)", gaussians.appearance.channels);
        return Err(table.invalid(what, "give a field of light, whose colour is f_dc_0, f_dc_1, f_dc_2"));
    }
    let norm2 = |q: &[f32; 4]| q.iter().map(|c| c * c).sum::<f32>();
    if let Some(i) = gaussians.rotation.iter().position(|q| !(norm2(q) > 0.0 && norm2(q).is_finite())) {
        let what = format!("vertex {i}: rot_0 to rot_3 are {:?}, which is no rotation", gaussians.rotation[i]);
        return Err(table.invalid(what, "give quaternions w, x, y, z that are not all zero"));
    }
    if let Some(i) = gaussians.log_scale.iter().position(|s| s.iter().any(|v| v.abs() > LARGEST_LOG_SCALE)) {
        let what = format!("vertex {i}: scale_0 to scale_2 are {:?}", gaussians.log_scale[i]);
        return Err(table.invalid(what, "scales are natural logarithms of metres; give them between -40 and 40"));
    }
    Ok(ForeignField {
        gaussians,
        antialiased: notes::antialiased(table.comments()),
        filter_3d: table.has(foreign::FILTER),
        up: notes::up(table.comments()),
        unread: foreign::unread(&table),
    })
}

/// exp of twice this, a variance, is still a number in single precision, and so is its inverse.
const LARGEST_LOG_SCALE: f32 = 40.0;

/// Reads a coupled file.
///
/// # Errors
/// Those of [`read_single`]; also a file without the RF columns.
pub fn read_coupled(path: &Path) -> Result<Gaussians> {
    let table = Table::read(path)?;
    let (position, rotation, log_scale) = table.geometry()?;
    let light = table.appearance("")?;
    if light.channels != 3 {
        let what = format!("the optical colour has {} channel(s)", light.channels);
        return Err(table.invalid(what, "a coupled file has three: f_dc_0, f_dc_1, f_dc_2"));
    }
    Ok(Gaussians { position, rotation, log_scale, light, radio: table.appearance("rf_")? })
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

/// The geometry that a file's rows begin and end with.
#[derive(Clone, Copy)]
struct Rows<'a> {
    position: &'a [[f32; 3]],
    rotation: &'a [[f32; 4]],
    log_scale: &'a [[f32; 3]],
}

impl<'a> Rows<'a> {
    fn of(gaussians: &'a Gaussians) -> Self {
        Self { position: &gaussians.position, rotation: &gaussians.rotation, log_scale: &gaussians.log_scale }
    }
}

fn write(path: &Path, g: Rows<'_>, appearances: &[(&str, &Appearance)], comments: &[String]) -> Result<()> {
    let count = g.position.len();
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
    let mut out = String::from("ply\nformat binary_little_endian 1.0\n");
    comments.iter().for_each(|c| out.push_str(&format!("comment {c}\n")));
    out.push_str(&format!("element vertex {count}\n"));
    columns.iter().for_each(|c| out.push_str(&format!("property float {c}\n")));
    out.push_str("end_header\n");
    let mut out = out.into_bytes();
    out.reserve(4 * columns.len() * count);
    let mut row: Vec<f32> = Vec::with_capacity(columns.len());
    for i in 0..count {
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

#[cfg(test)]
mod tests;
