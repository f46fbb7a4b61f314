//! The text of OBJ files as the parser takes it.
//!
//! The parser knows plain files: one statement a line, every corner of a mesh with the same attributes, every number there. What other
//! programs write is brought to that here, and what cannot be is refused with its line: byte order marks, Latin-1 and UTF-16, lone carriage returns,
//! lines continued with `\`, comments behind statements, colours and weights of vertices, indices that count backwards, corners with and
//! without texture coordinates or normals side by side, materials of libraries that are not there.

use super::notes::Notes;
use crate::{Error, Result};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::str::FromStr;

/// Kinds of unknown statements that are reported one by one.
const MAX_UNKNOWN: usize = 8;
/// No index: the corner has none.
const NONE: u32 = u32::MAX;

/// A file's text: UTF-8 with or without a mark, UTF-16 with one, else Latin-1.
pub(super) fn decode(bytes: &[u8]) -> String {
    let wide = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        String::from_utf16_lossy(&bytes.as_chunks().0.iter().map(|b| unit(*b)).collect::<Vec<u16>>())
    };
    match bytes {
        [0xff, 0xfe, rest @ ..] => wide(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => wide(rest, u16::from_be_bytes),
        [0xef, 0xbb, 0xbf, rest @ ..] | rest => {
            std::str::from_utf8(rest).map_or_else(|_| rest.iter().map(|b| char::from(*b)).collect(), str::to_string)
        }
    }
}

/// Statements with the number of the line they begin on; `\` at a line's end continues it, but for a comment. Empty lines and comments
/// are left out.
pub(super) fn statements(text: &str) -> Vec<(usize, String)> {
    let mut all: Vec<(usize, String)> = Vec::new();
    let mut open = false;
    for (i, line) in text.replace("\r\n", "\n").split(['\n', '\r']).enumerate() {
        let trimmed = line.trim();
        let continued = trimmed.strip_suffix('\\').filter(|_| !trimmed.starts_with('#'));
        let part = continued.unwrap_or(trimmed);
        match all.last_mut().filter(|_| open) {
            Some((_, statement)) => {
                statement.push(' ');
                statement.push_str(part);
            }
            None => all.push((i + 1, part.to_string())),
        }
        open = continued.is_some();
    }
    all.retain(|(_, s)| !s.trim().is_empty() && !s.trim_start().starts_with('#'));
    all
}

/// A statement's keyword and what stands behind it.
pub(super) fn split(statement: &str) -> (&str, &str) {
    let statement = statement.trim();
    statement.split_once(char::is_whitespace).map_or((statement, ""), |(word, rest)| (word, rest.trim()))
}

/// The part of a line before a `#` comment. Names may hold a `#`, so this is for numbers alone.
pub(super) fn without_comment(text: &str) -> &str {
    text.split_once('#').map_or(text, |(before, _)| before)
}

/// Numbers up to a comment.
///
/// # Errors
/// A word that is no finite float32.
pub(super) fn numbers(text: &str, place: &str) -> Result<Vec<f32>> {
    without_comment(text).split_whitespace().map(|word| number(word, place)).collect()
}

/// A word as a finite number.
fn number<T: FromStr + Copy + Into<f64>>(word: &str, place: &str) -> Result<T> {
    let finite = word.parse::<T>().ok().filter(|v| (*v).into().is_finite());
    finite.ok_or_else(|| {
        Error::invalid(place, format!("`{word}` is no finite number"), "repair this line, or export the model again")
    })
}

/// The numbers of a vertex whose place loses `origin`, in doubles.
fn moved(text: &str, origin: [f64; 3], place: &str) -> Result<Vec<f32>> {
    let words = without_comment(text).split_whitespace();
    let mut numbers: Vec<f64> = words.map(|word| number(word, place)).collect::<Result<_>>()?;
    // A weight divides the place, and is then done with.
    if let [x, y, z, w] = numbers.as_mut_slice() {
        (*x, *y, *z, *w) = (*x / *w, *y / *w, *z / *w, 1.0);
    }
    numbers.iter_mut().zip(origin).for_each(|(v, origin)| *v -= origin);
    Ok(numbers.into_iter().map(|v| v as f32).collect())
}

/// An OBJ file that the parser can take, and what it cannot hold.
#[derive(Debug)]
pub(super) struct ObjText {
    /// The text; its one `mtllib` stands for all materials there are.
    pub text: String,
    /// Lines and names of the material libraries it asked for; a line may name several, or one with spaces.
    pub libraries: Vec<(usize, String)>,
    /// Materials that faces use, each with the line that first asks for it, by first use.
    pub materials: Vec<(String, usize)>,
    /// Those of them with faces whose vertices have colours; `None` stands for faces without material.
    pub colored: BTreeSet<Option<String>>,
    /// The line of every face in the text.
    pub face_lines: Vec<usize>,
    /// Points, lines and faces of fewer than three corners, which were left out.
    pub skipped: usize,
}

enum Statement {
    Group(String),
    Material(usize, Option<String>),
    Face { line: usize, start: usize, count: usize },
}

/// State of the OBJ reader: the attributes and statements read so far.
#[derive(Default)]
struct Reader {
    positions: Vec<[f32; 3]>,
    colors: Vec<Option<[f32; 3]>>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    corners: Vec<[u32; 3]>,
    statements: Vec<Statement>,
    libraries: Vec<(usize, String)>,
    skipped: usize,
}

/// Reads an OBJ file's bytes; `file` names it in messages, `origin` is the point of the file that becomes its origin.
///
/// # Errors
/// A vertex or face that cannot be read, an index that leads nowhere; the message names the line.
pub(super) fn mend(bytes: &[u8], file: &str, origin: Option<[f64; 3]>, notes: &mut Notes) -> Result<ObjText> {
    let mut reader = Reader::default();
    let mut unknown = BTreeSet::new();
    for (line, statement) in statements(&decode(bytes)) {
        let (keyword, rest) = split(&statement);
        let place = || format!("{file}:{line}");
        match keyword {
            "v" => match origin {
                Some(origin) => reader.vertex(&moved(rest, origin, &place())?, &place())?,
                None => reader.vertex(&numbers(rest, &place())?, &place())?,
            },
            "vt" => match *numbers(rest, &place())? {
                [u] => reader.uvs.push([u, 0.0]),
                [u, v] | [u, v, _] => reader.uvs.push([u, v]),
                ref other => return Err(count(&place(), "a texture coordinate", other.len(), "1 to 3")),
            },
            "vn" => match *numbers(rest, &place())? {
                [x, y, z] => reader.normals.push([x, y, z]),
                ref other => return Err(count(&place(), "a normal", other.len(), "3")),
            },
            "f" | "fo" => reader.face(rest, line, &place())?,
            "l" | "p" => reader.skipped += 1,
            "o" | "g" => reader.statements.push(Statement::Group(rest.to_string())),
            "usemtl" => reader.statements.push(Statement::Material(line, (!rest.is_empty()).then(|| rest.to_string()))),
            "mtllib" if !rest.is_empty() => reader.libraries.push((line, rest.to_string())),
            // Smoothing, levels of detail and the like change no geometry here.
            "s" | "mg" | "lod" | "bevel" | "c_interp" | "d_interp" | "mtllib" | "end" => {}
            "surf" | "curv" | "curv2" | "bsp" | "bzp" | "cdc" | "cdp" | "res" => {
                notes.warn("free-form curves and surfaces are not read; export them as meshes", place())
            }
            "cstype" | "deg" | "bmat" | "step" | "parm" | "trim" | "hole" | "scrv" | "sp" | "con" | "vp" | "stech" | "ctech" => {}
            "call" => {
                notes.warn("`call` is not carried out: what is in the other file stands nowhere; put all into one file", place())
            }
            "csh" => notes.warn("`csh` is not carried out: files run no commands", place()),
            "shadow_obj" | "trace_obj" => {
                notes.warn(format!("`{keyword}` is not read: shadows and reflections are of the object itself"), place());
            }
            "usemap" | "maplib" => notes.warn(format!("`{keyword}` is not read: textures are those of the materials"), place()),
            other => {
                let other: String = other.chars().take(40).collect();
                if unknown.contains(&other) || unknown.len() < MAX_UNKNOWN {
                    notes.warn(format!("`{other}` is no statement that is read"), place());
                    unknown.insert(other);
                } else {
                    notes.warn("further statements are of kinds that are not read", place());
                }
            }
        }
    }
    reader.finish(file, notes)
}

fn count(place: &str, what: &str, found: usize, wanted: &str) -> Error {
    Error::invalid(
        place,
        format!("{what} of {found} numbers"),
        format!("it has {wanted}; repair this line, or export the model again"),
    )
}

impl Reader {
    /// Place, with a weight to divide by, or with a colour, whose opacity is left out.
    fn vertex(&mut self, numbers: &[f32], place: &str) -> Result<()> {
        let (position, color) = match *numbers {
            [x, y, z] => ([x, y, z], None),
            [x, y, z, w] => ([x / w, y / w, z / w], None),
            [x, y, z, r, g, b] | [x, y, z, r, g, b, _] => ([x, y, z], Some([r, g, b])),
            _ => return Err(count(place, "a vertex", numbers.len(), "3, with a weight 4, with a colour 6")),
        };
        if position.iter().any(|v| !v.is_finite()) {
            return Err(Error::invalid(place, "a vertex whose weight takes it out of float32", "repair this line"));
        }
        if color.is_some_and(|c| c.iter().any(|v| !(0.0..=255.0).contains(v))) {
            return Err(Error::invalid(place, format!("{color:?} is no colour"), "colours are from 0 to 1, or from 0 to 255"));
        }
        self.positions.push(position);
        self.colors.push(color);
        Ok(())
    }

    fn face(&mut self, rest: &str, line: usize, place: &str) -> Result<()> {
        let start = self.corners.len();
        for corner in without_comment(rest).split_whitespace() {
            let mut indices = [NONE; 3];
            let mut parts = corner.split('/');
            let there = [self.positions.len(), self.uvs.len(), self.normals.len()];
            for (index, (what, there)) in indices.iter_mut().zip(ATTRIBUTES.into_iter().zip(there)) {
                match parts.next() {
                    None | Some("") => {}
                    Some(word) => *index = resolve(word, what, there, place)?,
                }
            }
            if indices[0] == NONE || parts.next().is_some() {
                return Err(Error::invalid(
                    place,
                    format!("`{corner}` is no corner of a face"),
                    "a corner is v, v/vt, v//vn or v/vt/vn; repair this line, or export the model again",
                ));
            }
            self.corners.push(indices);
        }
        let count = self.corners.len() - start;
        if count < 3 {
            self.corners.truncate(start);
            self.skipped += 1;
        } else {
            self.statements.push(Statement::Face { line, start, count });
        }
        Ok(())
    }

    /// The text, once all is known: which attributes there are, and how large colours grow.
    fn finish(self, file: &str, notes: &mut Notes) -> Result<ObjText> {
        let (uvs, normals) = (self.uvs.len() as u32, self.normals.len() as u32);
        // An attribute that some corners lack has one more value, which means none: texture coordinate (0, 0) with v down, no normal.
        let lacks = |k: usize| self.corners.iter().any(|c| c[k] == NONE);
        let (lacking_uv, lacking_normal) = (uvs > 0 && lacks(1), normals > 0 && lacks(2));
        let largest = self.colors.iter().flatten().flatten().fold(0.0_f32, |m, c| m.max(*c));
        if largest > 1.0 {
            notes.warn("colours of vertices go beyond 1 and are taken as of 255", file);
        }
        let white = if largest > 1.0 { 255.0 } else { 1.0 };
        let any_color = self.colors.iter().any(Option::is_some);
        let mut text = String::from("mtllib all\n");
        // Writing to a String cannot fail.
        for ([x, y, z], color) in self.positions.iter().zip(&self.colors) {
            let _ = match (any_color, color.map_or([1.0; 3], |c| c.map(|v| v / white))) {
                (true, [r, g, b]) => writeln!(text, "v {x} {y} {z} {r} {g} {b}"),
                (false, _) => writeln!(text, "v {x} {y} {z}"),
            };
        }
        for [u, v] in self.uvs.iter().chain(lacking_uv.then_some(&[0.0, 1.0])) {
            let _ = writeln!(text, "vt {u} {v}");
        }
        for [x, y, z] in self.normals.iter().chain(lacking_normal.then_some(&[0.0; 3])) {
            let _ = writeln!(text, "vn {x} {y} {z}");
        }
        let mut out = ObjText {
            text,
            libraries: self.libraries,
            skipped: self.skipped,
            materials: Vec::new(),
            colored: BTreeSet::new(),
            face_lines: Vec::new(),
        };
        let mut used = BTreeSet::new();
        // The material of the faces that follow, the line that asked for it, and whether one of its faces has been seen, plain or coloured.
        let (mut material, mut asked, mut seen) = (None, 0, [false; 2]);
        for statement in self.statements {
            match statement {
                Statement::Group(name) => out.text.push_str(&format!("o {name}\n")),
                Statement::Material(line, name) => {
                    // An empty name takes faces back to none; the parser would refuse it, and knows no material of this one.
                    out.text.push_str(&format!("usemtl {}\n", name.as_deref().unwrap_or(NO_MATERIAL)));
                    (material, asked, seen) = (name, line, [false; 2]);
                }
                Statement::Face { line, start, count } => {
                    let corners = &self.corners[start..start + count];
                    let there = [self.positions.len(), self.uvs.len(), self.normals.len()];
                    for (k, (what, there)) in ATTRIBUTES.into_iter().zip(there).enumerate() {
                        // Where a file has none of an attribute, indices of it mean nothing.
                        let bad =
                            corners.iter().map(|c| c[k]).find(|i| *i != NONE && *i as usize >= there && (k == 0 || there > 0));
                        if let Some(index) = bad {
                            return Err(nowhere(
                                &format!("{file}:{line}"),
                                what,
                                u64::from(index) + 1,
                                &format!("and there are {there}"),
                            ));
                        }
                    }
                    if !std::mem::replace(&mut seen[0], true)
                        && let Some(name) = &material
                        && used.insert(name.clone())
                    {
                        out.materials.push((name.clone(), asked));
                    }
                    if any_color && !seen[1] && corners.iter().any(|c| self.colors[c[0] as usize].is_some()) {
                        seen[1] = true;
                        out.colored.insert(material.clone());
                    }
                    out.face_lines.push(line);
                    out.text.push('f');
                    let or_last = |index: u32, last: u32| if index == NONE { last + 1 } else { index + 1 };
                    for [v, vt, vn] in corners {
                        let _ = write!(out.text, " {}/", v + 1);
                        if uvs > 0 {
                            let _ = write!(out.text, "{}", or_last(*vt, uvs));
                        }
                        if normals > 0 {
                            let _ = write!(out.text, "/{}", or_last(*vn, normals));
                        }
                    }
                    out.text.push('\n');
                }
            }
        }
        Ok(out)
    }
}

/// Names of the vertex attributes that a face corner's indices refer to, in their order.
const ATTRIBUTES: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// The material of faces that ask for none.
pub(super) const NO_MATERIAL: &str = "(no material)";

/// A corner's index, counted from 0; one that counts backwards is from the `there` values so far, others may lead to later ones.
fn resolve(word: &str, what: &str, there: usize, place: &str) -> Result<u32> {
    let Ok(index) = word.parse::<i64>() else { return Err(nowhere(place, what, word, "which is no index")) };
    let resolved = if index > 0 { index - 1 } else { (there as i64).saturating_add(index) };
    match u32::try_from(resolved) {
        _ if index == 0 => Err(nowhere(place, what, word, "which is no index")),
        Ok(resolved) if resolved != NONE => Ok(resolved),
        _ => Err(nowhere(place, what, word, &format!("and there are {there} so far"))),
    }
}

fn nowhere(place: &str, what: &str, index: impl std::fmt::Display, how: &str) -> Error {
    Error::invalid(
        place,
        format!("a corner asks for {what} {index}, {how}"),
        "indices count from 1, or backwards from -1; repair this line, or export the model again",
    )
}
