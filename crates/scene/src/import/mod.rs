//! Meshes from files: glTF 2.0 (`.glb`, `.gltf`) and Wavefront OBJ into one [`Scene`] in the world frame (z up, metres).
//!
//! glTF is y-up by its standard: a point `(x, y, z)` of the file becomes `(x, −z, y)` of the world, a turn by +90° about x.

mod builder;
mod gltf;
mod limits;
mod mtl_text;
mod notes;
mod obj;
mod obj_material;
mod obj_text;
mod polygon;

use crate::contained::{self, Reach};
use crate::{Error, Finding, Result, Scene, Severity, io};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The axis of a mesh file that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum UpAxis {
    /// +y: world (x, −z, y).
    Y,
    /// +z: world (x, y, z).
    Z,
}

/// Options of a mesh file's import.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// The file's up axis: without one y for glTF, as its standard says, and z for an OBJ.
    pub up: Option<UpAxis>,
    /// Point of the world that becomes the origin, metres: it is taken off every position, in doubles.
    pub offset_m: Option<[f64; 3]>,
    /// Files that the mesh file may name: buffers, textures, material libraries.
    pub reach: Reach,
}

/// Report of what an import left out or made up.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImportReport {
    /// Triangles without area, which were dropped.
    pub degenerate_triangles: usize,
    /// Primitives of points or lines, which were skipped.
    pub skipped_primitives: usize,
    /// Vertices whose missing or zero normals were computed from their triangle.
    pub computed_normals: usize,
    /// Features of the file that the scene model cannot hold and that change what is seen or heard, in words.
    pub notes: Vec<String>,
    /// Content of the file that was not read, in words.
    pub unread: Vec<String>,
}

impl ImportReport {
    /// The report as findings about a mesh file, one a kind.
    pub fn findings(&self, mesh: &Path) -> Vec<Finding> {
        let place = mesh.display().to_string();
        let counted = [
            (self.degenerate_triangles, "triangles without area were dropped"),
            (self.skipped_primitives, "primitives of points or lines were skipped"),
            (self.computed_normals, "vertices without a normal were given their triangle's"),
        ];
        let counted = counted.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        let notes = counted.chain(self.unread.iter().cloned()).map(|what| (Severity::Note, what));
        let warnings = self.notes.iter().cloned().map(|what| (Severity::Warning, what));
        notes.chain(warnings).map(|(severity, what)| Finding::new(severity, &place, what, "")).collect()
    }
}

/// Reads a mesh file by its extension (`.glb`, `.gltf`, `.obj`); a glTF is taken as y-up, an OBJ as z-up.
///
/// # Errors
/// The file or one it refers to cannot be read, is cut short or inconsistent, or has a number that is not finite; the message says
/// where in the file.
pub fn load(path: impl AsRef<Path>) -> Result<Scene> {
    load_with_up(path, None)
}

/// Reads a mesh as [`load`] does, given the file's up axis.
///
/// # Errors
/// As [`load`].
pub fn load_with_up(path: impl AsRef<Path>, up: Option<UpAxis>) -> Result<Scene> {
    load_with_report(path, &ImportOptions { up, ..ImportOptions::default() }).map(|(scene, _)| scene)
}

/// Reads a mesh as [`load`] does, given all options, and reports what was left out.
///
/// # Errors
/// As [`load`].
pub fn load_with_report(path: impl AsRef<Path>, options: &ImportOptions) -> Result<(Scene, ImportReport)> {
    let path = path.as_ref();
    contained::check_regular(path, &path.display().to_string())?;
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let (scene, report) = match extension.as_str() {
        "glb" | "gltf" => gltf::load(&io::read(path)?, path, options),
        "obj" => obj::load(path, options),
        _ => Err(Error::invalid(
            path.display().to_string(),
            format!("\".{extension}\" is no mesh format this reads"),
            "give a .glb, .gltf or .obj file",
        )),
    }?;
    limits::check(&scene, path)?;
    Ok((scene, report))
}

/// The scene in a GLB (or glTF with embedded data) held in memory; `name` stands for the file in messages.
///
/// # Errors
/// As [`load`].
pub fn from_glb(bytes: &[u8], name: &str) -> Result<Scene> {
    gltf::load(bytes, Path::new(name), &ImportOptions::default()).map(|(scene, _)| scene)
}

/// The file's stem, as a scene's name.
fn scene_name(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod obj_tests;
#[cfg(test)]
mod tests;
