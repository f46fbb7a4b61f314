//! An output folder that is filled out of sight and shows what it holds once that is whole.
//!
//! ```text
//! OUT/.corf-unfinished/    where files are written
//! OUT/.corf-finishing/     the same while they move up into OUT, and `.names`, the list of what moves
//! ```
//!
//! A process that ends, however it ends, thus leaves nothing in the folder that could be taken for a result. The next that claims it (the
//! folder's lock says that nobody else does) removes what is left, so that the same command works again.

use crate::terminal::interrupt;
use crate::terminal::messages::UNFINISHED;
use anyhow::{Context, Result, bail};
use corf_scene::io::{is_temporary, read, remove_abandoned, sync_folder, write_atomic};
use corf_scene::lock::{self, FolderLock};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Folder in an output folder from which they move up.
const FINISHING: &str = ".corf-finishing";
/// File in [`FINISHING`] that lists what moves: a JSON array of names.
const NAMES: &str = ".names";

/// Whether a name in an output folder is one of work that did not end, or of a lock: none of a result.
pub fn is_leftover(name: &OsStr) -> bool {
    name == lock::FILE_NAME || name == UNFINISHED || name == FINISHING || is_temporary(name)
}

/// Whether something is in a folder that a process is writing, or was when it ended.
pub fn has_unfinished(folder: &Path) -> bool {
    [UNFINISHED, FINISHING].iter().any(|name| folder.join(name).symlink_metadata().is_ok())
}

/// Whether a process ended while its result moved up into this folder: what is there of it is no result.
pub fn was_finishing(folder: &Path) -> bool {
    folder.join(FINISHING).join(NAMES).exists()
}

/// Removes what a process that did not end well has left in a folder, whose lock the caller holds.
///
/// # Errors
/// Something that cannot be read or removed.
pub fn clear_leftovers(folder: &Path) -> Result<()> {
    let unfinished = folder.join(UNFINISHED);
    let finishing = folder.join(FINISHING);
    if was_finishing(folder) {
        let list = finishing.join(NAMES);
        let names: Vec<String> =
            serde_json::from_slice(&read(&list)?).with_context(|| format!("{} is damaged: remove it", list.display()))?;
        // Names alone, so that nothing outside of the folder is meant.
        let is_name = |name: &&String| Path::new(name.as_str()).file_name() == Some(OsStr::new(name.as_str()));
        for name in names.iter().filter(is_name).filter(|name| !finishing.join(name).exists()) {
            remove(&folder.join(name))?;
        }
    }
    remove(&finishing)?;
    remove(&unfinished)?;
    remove_abandoned(folder);
    Ok(())
}

/// Removes a file or a folder with all in it, where there is one.
fn remove(path: &Path) -> Result<()> {
    let Ok(metadata) = path.symlink_metadata() else { return Ok(()) };
    let removed = if metadata.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
    removed.with_context(|| format!("cannot remove {}", path.display()))
}

/// A new or empty folder that is being filled: nothing of it is seen before [`FreshFolder::finish`], and without that nothing stays.
#[derive(Debug)]
#[must_use = "without `finish` nothing is kept"]
pub struct FreshFolder {
    out: PathBuf,
    work: PathBuf,
    _held: FolderLock,
}

impl FreshFolder {
    /// Begins to fill a folder that is locked and empty.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn begin(out: &Path, held: FolderLock) -> Result<Self> {
        let work = out.join(UNFINISHED);
        let fresh = Self { out: out.to_path_buf(), work, _held: held };
        std::fs::create_dir(&fresh.work).with_context(|| format!("cannot create {}", fresh.work.display()))?;
        Ok(fresh)
    }

    /// Where to write.
    pub fn path(&self) -> &Path {
        &self.work
    }

    /// Shows what was written: folders first, so that a file that tells of them comes after them.
    ///
    /// # Errors
    /// Something of one of the names has appeared meanwhile; it cannot be renamed; an interrupt that came before.
    pub fn finish(self) -> Result<()> {
        let context = || format!("cannot finish {}", self.out.display());
        let mut found: Vec<(bool, String)> = Vec::new();
        for entry in std::fs::read_dir(&self.work).with_context(context)? {
            let entry = entry.with_context(context)?;
            let is_file = !entry.file_type().with_context(context)?.is_dir();
            let Ok(name) = entry.file_name().into_string() else { bail!("{}: a name is no UTF-8", self.work.display()) };
            if self.out.join(&name).symlink_metadata().is_ok() {
                bail!(
                    "{} has appeared while the folder was filled\n  help: choose a folder that nobody else writes into",
                    self.out.join(&name).display()
                );
            }
            found.push((is_file, name));
        }
        found.sort();
        let names: Vec<String> = found.into_iter().map(|(_, name)| name).collect();
        write_atomic(self.work.join(NAMES), &serde_json::to_vec(&names)?)?;
        interrupt::settle()?;
        let finishing = self.out.join(FINISHING);
        std::fs::rename(&self.work, &finishing).with_context(context)?;
        for name in &names {
            std::fs::rename(finishing.join(name), self.out.join(name)).with_context(context)?;
        }
        sync_folder(&self.out);
        remove(&finishing.join(NAMES))?;
        remove(&finishing)
    }
}

impl Drop for FreshFolder {
    fn drop(&mut self) {
        // After an error or an interrupt; the lock, which is dropped later, removes the folder itself if it was made for this.
        if let Err(error) = clear_leftovers(&self.out) {
            crate::note!("{error:#}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn begin(out: &Path) -> FreshFolder {
        let held = FolderLock::make(out).unwrap();
        clear_leftovers(out).unwrap();
        FreshFolder::begin(out, held).unwrap()
    }

    fn names(out: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(out).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.retain(|name| name != lock::FILE_NAME);
        names.sort();
        names
    }

    #[test]
    fn nothing_is_seen_before_the_end_and_nothing_stays_without_one() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let fresh = begin(&out);
        write_atomic(fresh.path().join("images/1.png"), b"x").unwrap();
        write_atomic(fresh.path().join("list.json"), b"[]").unwrap();
        assert_eq!(names(&out), [UNFINISHED]);
        drop(fresh);
        assert!(!out.exists(), "it was made for this, and is gone with it");
        let fresh = begin(&out);
        write_atomic(fresh.path().join("images/1.png"), b"x").unwrap();
        write_atomic(fresh.path().join("list.json"), b"[]").unwrap();
        fresh.finish().unwrap();
        assert_eq!(names(&out), ["images", "list.json"]);
        assert_eq!(std::fs::read(out.join("images/1.png")).unwrap(), b"x");
    }

    #[test]
    fn what_a_killed_process_left_goes_and_what_is_not_its_own_stays() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path();
        // Killed while it wrote.
        write_atomic(out.join(UNFINISHED).join("a.json"), b"half").unwrap();
        std::fs::write(out.join(".corf-abcdef.tmp"), "half").unwrap();
        std::fs::write(out.join("notes.txt"), "mine").unwrap();
        clear_leftovers(out).unwrap();
        assert_eq!(names(out), ["notes.txt"]);
        // Killed while its files moved up: two had, one had not.
        for (place, name) in [(out.to_path_buf(), "a"), (out.join("images"), "1"), (out.join(FINISHING), "b")] {
            write_atomic(place.join(name), b"whole").unwrap();
        }
        write_atomic(out.join(FINISHING).join(NAMES), br#"["images","a","b","../outside",".."]"#).unwrap();
        assert!(was_finishing(out));
        clear_leftovers(out).unwrap();
        assert_eq!(names(out), ["notes.txt"]);
        // Killed when all had: nothing is left to do.
        write_atomic(out.join("a"), b"whole").unwrap();
        std::fs::create_dir(out.join(FINISHING)).unwrap();
        clear_leftovers(out).unwrap();
        assert_eq!(names(out), ["a", "notes.txt"]);
    }

    #[test]
    fn nothing_of_work_that_did_not_end_occupies_a_folder() {
        let dir = tempfile::tempdir().unwrap();
        for name in [UNFINISHED, FINISHING] {
            std::fs::create_dir(dir.path().join(name)).unwrap();
            assert!(is_leftover(OsStr::new(name)), "{name}");
            crate::run::claim_fresh(dir.path()).unwrap().finish().unwrap();
            assert!(names(dir.path()).is_empty(), "{name}");
        }
        assert!(!is_leftover(OsStr::new("finishing")));
    }

    #[test]
    fn nothing_is_written_over_what_came_meanwhile() {
        let dir = tempfile::tempdir().unwrap();
        let fresh = begin(dir.path());
        write_atomic(fresh.path().join("a.json"), b"ours").unwrap();
        std::fs::write(dir.path().join("a.json"), "another's").unwrap();
        let error = fresh.finish().unwrap_err().to_string();
        assert!(error.contains("has appeared"), "{error}");
        assert_eq!(names(dir.path()), ["a.json"]);
        assert_eq!(std::fs::read(dir.path().join("a.json")).unwrap(), b"another's");
    }
}
