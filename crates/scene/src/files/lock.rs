//! One run an output folder: the second of two is refused. The lock is the operating system's and ends with the process that holds it,
//! however that ends.

use crate::{Error, Result};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

/// The file that is locked where folders themselves cannot be; elsewhere there is none.
pub const FILE_NAME: &str = ".corf-lock";

/// A folder that no other run writes into while this value lives.
#[derive(Debug)]
#[must_use = "the folder is free again once this is dropped"]
pub struct FolderLock {
    held: Option<File>,
    /// A folder that goes again where nothing was written into it.
    made: Option<PathBuf>,
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        if let Some(folder) = &self.made {
            // Refused where there is something in it, which is as it should be.
            let _ = std::fs::remove_dir(folder);
        }
    }
}

impl FolderLock {
    /// Takes the lock of a folder that exists. A file system that has no locks gives one that keeps nobody out.
    ///
    /// # Errors
    /// Another run holds it.
    pub fn acquire(folder: &Path) -> Result<Self> {
        let free = |held| Self { held, made: None };
        let Ok(file) = open(folder) else { return Ok(free(None)) };
        match file.try_lock() {
            Ok(()) => Ok(free(Some(file))),
            Err(TryLockError::WouldBlock) => Err(Error::invalid(
                folder.display().to_string(),
                "another run is writing into this folder",
                "wait for it or end it, or choose another folder with --out",
            )),
            Err(TryLockError::Error(_)) => Ok(free(None)),
        }
    }

    /// Whether a folder exists that nobody holds the lock of; false where there are no locks to ask.
    pub fn is_free(folder: &Path) -> bool {
        open(folder).is_ok_and(|file| file.try_lock().is_ok())
    }

    /// Whether it keeps others out: a file system without locks gives one that does not.
    pub fn keeps_others_out(&self) -> bool {
        self.held.is_some()
    }

    /// Creates the folder where it does not exist, then locks it as [`FolderLock::acquire`] does. A folder that this call created is
    /// removed again when the lock is dropped while it is empty, as after a run that ended in an error.
    ///
    /// # Errors
    /// Those of [`FolderLock::acquire`], and where the folder cannot be made.
    pub fn make(folder: &Path) -> Result<Self> {
        let made = !folder.exists();
        std::fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
        let mut lock = Self::acquire(folder)?;
        lock.made = made.then(|| folder.to_path_buf());
        Ok(lock)
    }
}

/// Opens the file that carries the lock: the folder itself, so that no lock file is left in it.
#[cfg(unix)]
fn open(folder: &Path) -> std::io::Result<File> {
    File::open(folder)
}

/// Opens the file that carries the lock: a lock file in the folder, on systems that cannot lock folders.
#[cfg(not(unix))]
fn open(folder: &Path) -> std::io::Result<File> {
    File::options().create(true).truncate(false).write(true).open(folder.join(FILE_NAME))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_of_two_is_refused_until_the_first_is_gone() {
        let dir = tempfile::tempdir().unwrap();
        let first = FolderLock::acquire(dir.path()).unwrap();
        let message = FolderLock::acquire(dir.path()).unwrap_err().to_string();
        assert!(message.contains("another run is writing"), "{message}");
        drop(first);
        drop(FolderLock::acquire(dir.path()).unwrap());
        // A folder that was made goes again while it is empty.
        let made = dir.path().join("made");
        drop(FolderLock::make(&made).unwrap());
        assert!(!made.exists());
        let held = FolderLock::make(&made).unwrap();
        std::fs::write(made.join("result"), "x").unwrap();
        drop(held);
        assert!(made.join("result").exists());
        std::fs::remove_dir_all(&made).unwrap();
        #[cfg(unix)]
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "nothing is left in it");
    }
}
