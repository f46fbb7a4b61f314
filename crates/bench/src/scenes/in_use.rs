//! A scene read for use: whatever its mesh's import left out or changed is said, on standard error, whichever command uses it.

use crate::terminal::messages;
use crate::terminal::progress::Stage;
use corf_scene::config::SceneConfig;
use corf_scene::{Finding, Result, Scene};

/// Reads a scene file's mesh, with its materials' radio properties.
///
/// # Errors
/// Those of [`SceneConfig::load_scene`].
pub fn load(config: &SceneConfig) -> Result<Scene> {
    let (scene, left_out) = Stage::of("the scene's mesh", || config.load_scene())?;
    report_left_out(&left_out);
    Ok(scene)
}

/// Says what an import left out or changed; a scene that is read several times is told of once.
pub fn report_left_out(findings: &[Finding]) {
    messages::once(findings);
}
