//! The scene that a data set was generated from, read again from its file: what re-traces a data set starts here, and refuses any other scene.

use crate::scenes::in_use;
use crate::terminal::messages;
use anyhow::Result;
use corf_scene::config::{DatasetConfig, SceneConfig};
use corf_scene::dataset::Dataset;
use corf_scene::{Error, Scene, fingerprint, io, radio_check};
use std::path::Path;

/// A data set's scene with both of its configurations.
pub struct SceneBehind {
    /// The data set's configuration.
    pub config: DatasetConfig,
    /// The scene's.
    pub scene_config: SceneConfig,
    /// The scene.
    pub scene: Scene,
}

/// The configurations that a data set records.
///
/// # Errors
/// A data set that was imported.
pub fn recorded(dataset: &Dataset) -> Result<(&DatasetConfig, &SceneConfig)> {
    let header = dataset.header();
    header.config.as_ref().zip(header.scene.as_ref()).ok_or_else(|| {
        let what = "it was imported, and there is no scene behind it that could be traced anew";
        Error::invalid(dataset.dir().display().to_string(), what, "generate a data set from a scene").into()
    })
}

impl SceneBehind {
    /// Reads the scene file that the data set was generated from.
    ///
    /// # Errors
    /// A data set that was imported, a file that cannot be read, another scene than the recorded one.
    pub fn open(dataset: &Dataset, path: &Path) -> Result<Self> {
        let (config, recorded) = recorded(dataset)?;
        let header = dataset.header();
        let scene_config = SceneConfig::load(path)?;
        let scene = in_use::load(&scene_config)?;
        let same_mesh = header.scene_sha256.as_deref() == Some(io::sha256_hex(&io::read(scene_config.mesh_path())?).as_str())
            && header.scene_content_sha256.as_ref().is_none_or(|hash| *hash == fingerprint::of_scene(&scene));
        if serde_json::to_value(&scene_config)? != serde_json::to_value(recorded)? || !same_mesh {
            let what = format!("not the scene that {} was generated from", dataset.dir().display());
            return Err(Error::invalid(path.display().to_string(), what, "give that one, with the mesh as it was").into());
        }
        messages::findings(radio_check::far_finding(&scene));
        Ok(Self { config: config.clone(), scene_config, scene })
    }
}
