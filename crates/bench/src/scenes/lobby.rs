//! The lobby of this repository, kept in the program: its mesh, its scene file, and two of its data sets.

use anyhow::{Context, Result};
use corf_scene::io::write_atomic;
use std::path::Path;

/// Name of the small data set's file.
pub const MINI: &str = "lobby-mini.toml";
/// Name of the file of the data set at the published size.
pub const FULL: &str = "lobby147.toml";

/// The files, as they are in `scenes/`.
const FILES: [(&str, &[u8]); 4] = [
    ("lobby.glb", include_bytes!("../../../../scenes/lobby.glb")),
    ("lobby.toml", include_bytes!("../../../../scenes/lobby.toml")),
    (MINI, include_bytes!("../../../../scenes/lobby-mini.toml")),
    (FULL, include_bytes!("../../../../scenes/lobby147.toml")),
];

/// Writes them into a folder, which is made if need be.
///
/// # Errors
/// A folder that cannot be made or written.
pub fn unpack(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    for (name, bytes) in FILES {
        write_atomic(folder.join(name), bytes)?;
    }
    Ok(())
}
