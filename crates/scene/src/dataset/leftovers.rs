//! Removal of the progress records and temporary files that the generation of a dataset leaves in its folder.

use super::layout;
use crate::{Error, Result, io};
use std::path::Path;

/// Removes what recorded the making of a dataset that is now whole.
pub(super) fn forget_progress(dir: &Path) -> Result<()> {
    let progress = dir.join(layout::PROGRESS_DIR);
    if progress.exists() {
        std::fs::remove_dir_all(&progress).map_err(Error::io("remove", &progress))?;
    }
    let partial = dir.join(layout::PARTIAL_JSON);
    if partial.exists() {
        std::fs::remove_file(&partial).map_err(Error::io("remove", &partial))?;
    }
    Ok(())
}

/// Removes files that a killed process had begun to write: they have no name of their own yet.
pub(super) fn remove_temporary(dir: &Path) -> Result<()> {
    io::remove_temporary_files(dir)
}
