//! `corf scene new`: a stub scene file for a mesh.

use super::{Verdict, show};
use crate::files::separation::{Reads, keep_apart};
use crate::note;
use crate::scenes::stub::{self, Source, Stub};
use crate::terminal::progress::Stage;
use crate::terminal::shell;
use anyhow::{Context, Result};
use clap::Args;
use corf_scene::config::UpAxis;
use corf_scene::import::{self, ImportOptions};
use corf_scene::{Error, io, radio_check};
use std::path::{Component, Path, PathBuf};

/// `corf scene new`.
#[derive(Args)]
pub struct New {
    /// The mesh (.glb, .gltf, .obj), in metres.
    mesh: PathBuf,
    /// The scene file to write (default: beside the mesh, its name with .toml). A small data set's file (NAME-tiny.toml) and a preview
    /// (NAME-preview.png) are written beside it.
    #[arg(long, value_name = "FILE.toml")]
    out: Option<PathBuf>,
    /// Height of the sensor above the floor, metres (default 1.5, less in a low room).
    #[arg(long, value_name = "METRES")]
    height: Option<f64>,
    /// The mesh's up axis (default: y for glTF, z for OBJ).
    #[arg(long, value_enum)]
    up: Option<Up>,
}

/// An up axis on the command line.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Up {
    /// +y.
    Y,
    /// +z.
    Z,
}

/// Heights of sensors, metres.
const HEIGHTS_M: std::ops::RangeInclusive<f64> = 0.2..=20.0;

impl New {
    /// Runs the command.
    ///
    /// # Errors
    /// A mesh that cannot be read or has no room for a platform, files that are there already.
    pub fn run(self, json: bool) -> Result<Verdict> {
        if let Some(height_m) = self.height.filter(|height_m| !HEIGHTS_M.contains(height_m)) {
            let help = format!("give metres above the floor, {} to {}", HEIGHTS_M.start(), HEIGHTS_M.end());
            return Err(Error::invalid("--height", format!("{height_m} m"), help).into());
        }
        let out = self.out.clone().unwrap_or_else(|| self.mesh.with_extension("toml"));
        let is_toml = out.extension().is_some_and(|e| e == "toml");
        let stem = out.file_stem().and_then(|stem| stem.to_str()).filter(|stem| is_toml && !stem.is_empty());
        let Some(stem) = stem else {
            return Err(Error::invalid(out.display().to_string(), "it is no name of a scene file", "give --out FILE.toml").into());
        };
        keep_apart("--out", &out, &[Reads::File(&self.mesh)])?;
        let [dataset, preview] = ["-tiny.toml", "-preview.png"].map(|ending| out.with_file_name(format!("{stem}{ending}")));
        for path in [&out, &dataset, &preview] {
            if path.symlink_metadata().is_ok() {
                return Err(Error::invalid(
                    path.display().to_string(),
                    "it is there already",
                    "choose another --out, or remove it",
                )
                .into());
            }
        }
        let up = self.up.map(|up| if matches!(up, Up::Y) { UpAxis::Y } else { UpAxis::Z });
        let options = ImportOptions { up, ..ImportOptions::default() };
        let (scene, report) = Stage::of("the scene's mesh", || import::load_with_report(&self.mesh, &options))?;
        for finding in
            report.findings(&self.mesh).iter().chain(&radio_check::body_findings(&scene)).chain(&radio_check::far_finding(&scene))
        {
            note!("{finding}");
        }
        let file = path_from(out.parent().unwrap_or(Path::new("")), &self.mesh)?;
        let name = format!("{stem}.toml");
        let source = Source { mesh: &self.mesh, file: &file, up, toml: &name, height_m: self.height };
        let stub = stub::make(&scene, &source)?;
        // The scene file last: where it is, all is.
        io::write_atomic(&preview, &stub.preview)?;
        io::write_atomic(&dataset, stub.dataset.as_bytes())?;
        io::write_atomic(&out, stub.scene.as_bytes())?;
        stub.notes.iter().for_each(|words| note!("note: {words}"));
        let value = serde_json::json!({
            "scene": out, "dataset": dataset, "preview": preview, "waypoints": stub.waypoints, "loop_m": stub.length_m,
            "clearance_m": stub.clearance_m, "transmitter_m": stub.transmitter_m.to_array(), "to_be_filled_in": stub.unknown, "notes": stub.notes,
        });
        show(json, &value, &said(&stub, [&out, &dataset, &preview]))?;
        Ok(Verdict::Done)
    }
}

/// What was written, and what to do next.
fn said(stub: &Stub, [scene, dataset, preview]: [&Path; 3]) -> String {
    format!(
        "{}: {} materials to be filled in, a guessed transmitter at {:.2}, a loop of {:.1} m by {} waypoints, {:.2} m from everything\n\
         {}: look at it, then correct what is marked as a guess\n\
         next: corf scene validate {}\n      corf dataset generate {} --out {}",
        scene.display(),
        stub.unknown.len(),
        stub.transmitter_m,
        stub.length_m,
        stub.waypoints,
        stub.clearance_m,
        preview.display(),
        shell::word(&scene.display().to_string()),
        shell::word(&dataset.display().to_string()),
        shell::word(&format!("data/{}", dataset.file_stem().unwrap_or_default().display())),
    )
}

/// The path of a file seen from a folder, with forward slashes.
fn path_from(folder: &Path, file: &Path) -> Result<String> {
    let absolute = |path: &Path| {
        let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
        std::fs::canonicalize(path).with_context(|| format!("cannot find {}", path.display()))
    };
    let (folder, file) = (absolute(folder)?, absolute(file)?);
    let (from, to): (Vec<Component<'_>>, Vec<Component<'_>>) = (folder.components().collect(), file.components().collect());
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    // Another drive has no way there but its own name.
    let path: PathBuf = match common {
        0 => file.clone(),
        _ => from[common..].iter().map(|_| Component::ParentDir).chain(to[common..].iter().copied()).collect(),
    };
    let text = path.to_str().with_context(|| format!("{} is no UTF-8, and cannot be named in a scene file", path.display()))?;
    Ok(text.replace('\\', "/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_is_named_from_the_scene_files_folder() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("scenes");
        std::fs::create_dir(&inner).unwrap();
        let mesh = folder.path().join("room.obj");
        std::fs::write(&mesh, "").unwrap();
        assert_eq!(path_from(folder.path(), &mesh).unwrap(), "room.obj");
        assert_eq!(path_from(&inner, &mesh).unwrap(), "../room.obj");
        assert!(path_from(&folder.path().join("none"), &mesh).unwrap_err().to_string().contains("none"));
    }
}
