//! `corf scene`: build the lobby, describe and check scenes.

use super::{Verdict, show};
use anyhow::Result;
use clap::{Args, Subcommand};
use corf_scene::config::SceneConfig;
use corf_scene::info::{SceneInfo, validate_scene};
use corf_scene::{Scene as Model, import, lobby};
use std::path::{Path, PathBuf};

/// Frequency a mesh file without a scene file is checked at, Hz.
const DEFAULT_FREQUENCY_HZ: f64 = 60e9;

/// Build, describe or check a scene.
#[derive(Subcommand)]
pub enum Scene {
    /// Build a scene in code.
    #[command(subcommand)]
    Build(Build),
    /// Describe a scene: what it holds, which materials lack radio properties.
    Info(File),
    /// Check a scene; exit 1 when something in it cannot be traced.
    Validate(File),
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

fn load(path: &Path) -> Result<(Model, f64)> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
        let config = SceneConfig::load(path)?;
        return Ok((config.load_scene()?, config.radio.frequency_hz));
    }
    Ok((import::load(path)?, DEFAULT_FREQUENCY_HZ))
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
                let (scene, _) = load(&file)?;
                let info = SceneInfo::of(&scene);
                show(json, &info, &info.to_string())?;
                Ok(Verdict::Done)
            }
            Self::Validate(File { file }) => {
                let (scene, frequency_hz) = load(&file)?;
                super::findings(json, &validate_scene(&scene, frequency_hz))
            }
        }
    }
}
