//! OBJ files: statements to meshes.
//!
//! Files are read as other programs write them, and what cannot be read is refused with its line: byte order marks, Latin-1 and UTF-16, lone carriage
//! returns, lines continued with `\`, comments behind statements, colours and weights of vertices, indices that count backwards, corners with and
//! without texture coordinates or normals side by side, materials of libraries that are not there.

use super::notes::Notes;
use crate::{Error, Result};
use std::collections::{BTreeSet, HashMap};
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

/// What an OBJ file holds.
#[derive(Debug, Default)]
pub(super) struct Obj {
    /// One a group and material, in the file's order; none is without faces.
    pub meshes: Vec<Mesh>,
    /// Lines and names of the material libraries it asked for; a line may name several, or one with spaces.
    pub libraries: Vec<(usize, String)>,
    /// Materials that faces use, each with the line that first asks for it, by first use.
    pub materials: Vec<(String, usize)>,
    /// Those of them with faces whose vertices have colours; `None` stands for faces without material.
    pub colored: BTreeSet<Option<String>>,
    /// Points, lines and faces of fewer than three corners, which were left out.
    pub skipped: usize,
}

/// Faces of one group and material. Corners that agree in all attributes share a vertex.
#[derive(Debug, Default)]
pub(super) struct Mesh {
    pub name: String,
    pub material: Option<String>,
    /// Metres, one a vertex, as are the others; those are empty where the whole file has none.
    pub positions: Vec<[f32; 3]>,
    /// Zero: none.
    pub normals: Vec<[f32; 3]>,
    /// v counts from the top.
    pub uvs: Vec<[f32; 2]>,
    /// Linear RGBA.
    pub colors: Vec<[f32; 4]>,
    /// Vertices of the faces' corners, face by face.
    pub corners: Vec<u32>,
    /// Number of corners of every face.
    pub arities: Vec<u32>,
    /// Line of every face in the file.
    pub lines: Vec<usize>,
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
pub(super) fn read(bytes: &[u8], file: &str, origin: Option<[f64; 3]>, notes: &mut Notes) -> Result<Obj> {
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

    /// The meshes, once all is known: which attributes there are, and how large colours grow.
    fn finish(mut self, file: &str, notes: &mut Notes) -> Result<Obj> {
        let largest = self.colors.iter().flatten().flatten().fold(0.0_f32, |m, c| m.max(*c));
        if largest > 1.0 {
            notes.warn("colours of vertices go beyond 1 and are taken as of 255", file);
        }
        let white = if largest > 1.0 { 255.0 } else { 1.0 };
        let any_color = self.colors.iter().any(Option::is_some);
        let there = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let mut out = Obj { libraries: self.libraries, skipped: self.skipped, ..Obj::default() };
        let mut used = BTreeSet::new();
        let (mut name, mut material, mut asked) = (UNNAMED.to_string(), None, 0);
        // Whether the next face begins a mesh, and the vertices of the mesh so far.
        let (mut begins, mut vertex_of) = (true, HashMap::new());
        for statement in self.statements {
            let (line, start, count) = match statement {
                Statement::Group(group) => {
                    name = if group.is_empty() { UNNAMED.to_string() } else { group };
                    begins = true;
                    continue;
                }
                Statement::Material(line, asked_for) => {
                    begins |= asked_for != material;
                    (material, asked) = (asked_for, line);
                    continue;
                }
                Statement::Face { line, start, count } => (line, start, count),
            };
            if std::mem::take(&mut begins) {
                out.meshes.push(Mesh { name: name.clone(), material: material.clone(), ..Mesh::default() });
                vertex_of.clear();
                if let Some(material) = material.as_ref().filter(|m| used.insert((*m).clone())) {
                    out.materials.push((material.clone(), asked));
                }
            }
            let Some(mesh) = out.meshes.last_mut() else { continue };
            let corners = &mut self.corners[start..start + count];
            for (k, (what, there)) in ATTRIBUTES.into_iter().zip(there).enumerate() {
                // Where a file has none of an attribute, indices of it mean nothing.
                if there == 0 && k > 0 {
                    corners.iter_mut().for_each(|c| c[k] = NONE);
                } else if let Some(index) = corners.iter().map(|c| c[k]).find(|i| *i != NONE && *i as usize >= there) {
                    let place = format!("{file}:{line}");
                    return Err(nowhere(&place, what, u64::from(index) + 1, &format!("and there are {there}")));
                }
            }
            if any_color && !out.colored.contains(&material) && corners.iter().any(|c| self.colors[c[0] as usize].is_some()) {
                out.colored.insert(material.clone());
            }
            for corner in &*corners {
                let next = mesh.positions.len() as u32;
                mesh.corners.push(*vertex_of.entry(*corner).or_insert(next));
                if mesh.corners.last() != Some(&next) {
                    continue;
                }
                let [v, vt, vn] = corner.map(|i| i as usize);
                mesh.positions.push(self.positions[v]);
                if any_color {
                    let [r, g, b] = self.colors[v].map_or([1.0; 3], |c| c.map(|v| v / white));
                    mesh.colors.push([r, g, b, 1.0]);
                }
                if there[1] > 0 {
                    // OBJ counts v from the bottom.
                    mesh.uvs.push(self.uvs.get(vt).map_or([0.0; 2], |[u, v]| [*u, 1.0 - v]));
                }
                if there[2] > 0 {
                    mesh.normals.push(self.normals.get(vn).copied().unwrap_or_default());
                }
            }
            mesh.arities.push(count as u32);
            mesh.lines.push(line);
        }
        Ok(out)
    }
}

/// Names of the vertex attributes that a face corner's indices refer to, in their order.
const ATTRIBUTES: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// The group of faces before any, and of those whose group has no name.
const UNNAMED: &str = "unnamed_object";

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
