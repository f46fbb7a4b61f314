//! `corf scene`: build the lobby, describe, check and export scenes.

use super::{Verdict, show};
use anyhow::Result;
use clap::{Args, Subcommand, ValueEnum};
use corf_scene::config::SceneConfig;
use corf_scene::export::sionna;
use corf_scene::info::{SceneInfo, validate_scene};
use corf_scene::{Finding, Scene as Model, Severity, import, lobby};
use std::path::{Path, PathBuf};

/// Frequency a mesh file without a scene file is checked at, Hz.
const DEFAULT_FREQUENCY_HZ: f64 = 60e9;

/// Build, describe, check or export a scene.
#[derive(Subcommand)]
pub enum Scene {
    /// Build a scene in code.
    #[command(subcommand)]
    Build(Build),
    /// Describe a scene: what it holds, which materials lack radio properties.
    Info(File),
    /// Check a scene; exit 1 when something in it cannot be traced.
    Validate(File),
    /// Write a scene for another simulator.
    Export(Export),
}

/// `corf scene export`.
#[derive(Args)]
pub struct Export {
    /// Scene file (.toml).
    file: PathBuf,
    /// Whose format.
    #[arg(long, value_enum)]
    to: Format,
    /// Folder to write into; files of the same name are replaced.
    #[arg(long)]
    out: PathBuf,
    /// Evenly spaced poses of the trajectory to write beside the scene.
    #[arg(long, default_value_t = 0)]
    poses: usize,
}

/// Formats a scene can be written in.
#[derive(Clone, Copy, ValueEnum)]
enum Format {
    /// Sionna RT: scene.xml, a PLY for every object and material, radio.json.
    Sionna,
}

/// Scenes built in code.
#[derive(Subcommand)]
pub enum Build {
    /// The lobby: the same bytes each time.
    Lobby {
        /// Where to write it.
        #[arg(long, default_value = "scenes/lobby.glb")]
        out: PathBuf,
    },
}

/// A scene on disk.
#[derive(Args)]
pub struct File {
    /// A mesh (.glb, .gltf, .obj), or a scene file (.toml) that names one and maps its radio materials.
    file: PathBuf,
}

/// A scene, the frequency to check it at, and what its import left out or changed.
fn load(path: &Path) -> Result<(Model, f64, Vec<Finding>)> {
    let is_config = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let config = if is_config { Some(SceneConfig::load(path)?) } else { None };
    let mesh = config.as_ref().map_or(path.to_path_buf(), SceneConfig::mesh_path);
    let (mut scene, report) = import::load_with_report(&mesh, config.as_ref().and_then(|c| c.scene.up))?;
    if let Some(config) = &config {
        config.apply_radio_materials(&mut scene)?;
    }
    let place = mesh.display().to_string();
    let mut left_out = Vec::new();
    for (count, what) in [
        (report.degenerate_triangles, "triangles without area were dropped"),
        (report.skipped_primitives, "primitives of points or lines were skipped"),
        (report.computed_normals, "vertices without a normal were given their triangle's"),
    ] {
        if count > 0 {
            left_out.push(Finding::new(Severity::Note, &place, format!("{count} {what}"), ""));
        }
    }
    left_out.extend(report.notes.into_iter().map(|note| Finding::new(Severity::Warning, &place, note, "")));
    let frequency_hz = config.map_or(DEFAULT_FREQUENCY_HZ, |c| c.radio.frequency_hz);
    Ok((scene, frequency_hz, left_out))
}

impl Scene {
    /// Runs the sub-command.
    ///
    /// # Errors
    /// A scene that cannot be read or written.
    pub fn run(self, json: bool) -> Result<Verdict> {
        match self {
            Self::Build(Build::Lobby { out }) => {
                lobby::write(&out)?;
                let bytes = std::fs::metadata(&out)?.len();
                show(json, &serde_json::json!({ "file": out, "bytes": bytes }), &format!("{}: {bytes} bytes", out.display()))?;
                Ok(Verdict::Done)
            }
            Self::Info(File { file }) => {
                let (scene, _, left_out) = load(&file)?;
                let info = SceneInfo::of(&scene);
                let notes: Vec<String> = left_out.iter().map(ToString::to_string).collect();
                show(json, &serde_json::json!({ "scene": info, "import": left_out }), &format!("{info}{}", notes.join("\n")))?;
                Ok(Verdict::Done)
            }
            Self::Validate(File { file }) => {
                let (scene, frequency_hz, mut findings) = load(&file)?;
                findings.extend(validate_scene(&scene, frequency_hz));
                super::findings(json, &findings)
            }
            Self::Export(Export { file, to: Format::Sionna, out, poses }) => {
                let config = SceneConfig::load(&file)?;
                let summary = sionna::write(&config.load_scene()?, &config, poses, &out)?;
                let text = format!(
                    "{}: {} shapes, {} materials, {} triangles, {} vertices, {} poses",
                    out.display(),
                    summary.shapes,
                    summary.materials,
                    summary.triangles,
                    summary.vertices,
                    summary.poses
                );
                show(json, &summary, &text)?;
                Ok(Verdict::Done)
            }
        }
    }
}
