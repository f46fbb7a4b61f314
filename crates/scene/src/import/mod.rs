//! Meshes from files: glTF 2.0 (`.glb`, `.gltf`) and Wavefront OBJ into one [`Scene`] in the world frame (z up, metres).
//!
//! glTF is y-up by its standard: a point `(x, y, z)` of the file becomes `(x, −z, y)` of the world, a turn by +90° about x.

mod builder;
mod gltf;
mod gltf_accessor;
mod gltf_material;
mod limits;
mod obj;
mod polygon;

use crate::config::UpAxis;
use crate::{Error, Result, Scene, io};
use std::path::Path;

/// What an import left out or made up.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImportReport {
    /// Triangles without area, which were dropped.
    pub degenerate_triangles: usize,
    /// Primitives of points or lines, which were skipped.
    pub skipped_primitives: usize,
    /// Vertices whose missing or zero normals were computed from their triangle.
    pub computed_normals: usize,
    /// Features of the file that the scene model cannot hold, in words.
    pub notes: Vec<String>,
}

/// Reads a mesh file by its extension (`.glb`, `.gltf`, `.obj`); an OBJ is taken as z-up.
///
/// # Errors
/// The file or one it refers to cannot be read, is cut short or inconsistent, or has a number that is not finite; the message says
/// where in the file.
pub fn load(path: impl AsRef<Path>) -> Result<Scene> {
    load_with_report(path, None).map(|(scene, _)| scene)
}

/// As [`load`], with the up axis of an OBJ file.
///
/// # Errors
/// As [`load`], or `up = "z"` for a glTF file, whose standard says y.
pub fn load_with_up(path: impl AsRef<Path>, up: Option<UpAxis>) -> Result<Scene> {
    load_with_report(path, up).map(|(scene, _)| scene)
}

/// As [`load_with_up`], with what was left out.
///
/// # Errors
/// As [`load_with_up`].
pub fn load_with_report(path: impl AsRef<Path>, up: Option<UpAxis>) -> Result<(Scene, ImportReport)> {
    let path = path.as_ref();
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let (scene, report) = match extension.as_str() {
        "glb" | "gltf" if up == Some(UpAxis::Z) => Err(Error::invalid(
            path.display().to_string(),
            "up = \"z\" for a glTF file, which is y-up by its standard",
            "leave `up` out; export with y up, as every glTF exporter does by default",
        )),
        "glb" | "gltf" => gltf::load(&io::read(path)?, path),
        "obj" => obj::load(path, up.unwrap_or(UpAxis::Z)),
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
    gltf::load(bytes, Path::new(name)).map(|(scene, _)| scene)
}

/// The file's stem, as a scene's name.
fn scene_name(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests;
