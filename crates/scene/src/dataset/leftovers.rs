//! Removal of the progress records and temporary files that the generation of a dataset leaves in its folder.

use super::layout;
use crate::{Error, Result, io};
use std::collections::BTreeSet;
use std::io::ErrorKind;
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

/// Removes a data set in the making, of whose keyframes these are the files, and folders that are empty then: nothing can go on with it.
pub(super) fn discard<'f>(dir: &Path, files: impl Iterator<Item = &'f str>) -> Result<()> {
    let mut folders = BTreeSet::new();
    for file in files.chain([layout::TRAJECTORY_JSON]) {
        let path = dir.join(file);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(Error::io("remove", &path)(error)),
            _ => {}
        }
        folders.extend(path.ancestors().skip(1).take_while(|folder| *folder != dir).map(Path::to_path_buf));
    }
    forget_progress(dir)?;
    // What is within comes last in order. A folder in which something else is stays.
    folders.iter().rev().for_each(|folder| drop(std::fs::remove_dir(folder)));
    Ok(())
}

/// Removes files that a killed process had begun to write: they have no name of their own yet.
pub(super) fn remove_temporary(dir: &Path) -> Result<()> {
    io::remove_temporary_files(dir)
}
