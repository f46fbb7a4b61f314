//! One run an output folder: the second of two is refused. The lock is the operating system's and ends with the process that holds it,
//! however that ends.

use crate::{Error, Result};
use std::fs::{File, TryLockError};
use std::path::Path;

/// The file that is locked where folders themselves cannot be; elsewhere there is none.
pub const FILE_NAME: &str = ".corf-lock";

/// A folder that no other run writes into while this value lives.
#[derive(Debug)]
#[must_use = "the folder is free again once this is dropped"]
pub struct FolderLock {
    _held: Option<File>,
}

impl FolderLock {
    /// Takes the lock of a folder that exists. A file system that has no locks gives one that keeps nobody out.
    ///
    /// # Errors
    /// Another run holds it.
    pub fn acquire(folder: &Path) -> Result<Self> {
        let Ok(file) = open(folder) else { return Ok(Self { _held: None }) };
        match file.try_lock() {
            Ok(()) => Ok(Self { _held: Some(file) }),
            Err(TryLockError::WouldBlock) => Err(Error::invalid(
                folder.display().to_string(),
                "another run is writing into this folder",
                "wait for it or end it, or choose another folder with --out",
            )),
            Err(TryLockError::Error(_)) => Ok(Self { _held: None }),
        }
    }
}

/// What is locked: the folder itself, which leaves nothing in it.
#[cfg(unix)]
fn open(folder: &Path) -> std::io::Result<File> {
    File::open(folder)
}

/// What is locked: a file, where folders cannot be.
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
        #[cfg(unix)]
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "nothing is left in it");
    }
}
