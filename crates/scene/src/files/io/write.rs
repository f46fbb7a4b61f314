//! Writing: a file is whole and on the disk before it has its name, and a process that is killed leaves none behind for ever.
//!
//! On Linux the bytes go into a file without a name, which is gone with the process. Where the system or the file system has none, and where
//! a file of that name is to be replaced, there is a temporary name for a while: `.corf-*.tmp`, locked by its process. One that nobody
//! locks is what a killed process left, and goes with the next write into its folder.

use crate::lock::FolderLock;
use crate::{Error, Result};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Prefix and suffix of the names of temporary files.
const TEMPORARY: [&str; 2] = [".corf-", ".tmp"];
/// Attempts at a temporary file that nobody takes for abandoned before it is locked.
const ATTEMPTS: usize = 16;

/// Whether a file's name is one that [`write_atomic`] gives while it writes.
pub fn is_temporary(name: &OsStr) -> bool {
    name.to_str().is_some_and(|n| n.starts_with(TEMPORARY[0]) && n.ends_with(TEMPORARY[1]))
}

/// Removes the temporary files that a process which was killed while it wrote left below `dir`, which this process must hold the lock of;
/// links are not followed.
///
/// # Errors
/// A folder that cannot be read, or a file that cannot be removed.
pub fn remove_temporary_files(dir: &Path) -> Result<()> {
    for entry in std::fs::read_dir(dir).map_err(Error::io("read", dir))? {
        let entry = entry.map_err(Error::io("read", dir))?;
        let kind = entry.file_type().map_err(Error::io("read", entry.path()))?;
        let ours = is_temporary(&entry.file_name());
        if kind.is_dir() && ours {
            std::fs::remove_dir_all(entry.path()).map_err(Error::io("remove", entry.path()))?;
        } else if kind.is_dir() {
            remove_temporary_files(&entry.path())?;
        } else if kind.is_file() && ours {
            std::fs::remove_file(entry.path()).map_err(Error::io("remove", entry.path()))?;
        }
    }
    Ok(())
}

/// Writes `bytes` to `path` (its folder is created): a reader sees the old file or the whole new one, never a part, even after a power
/// failure, for the bytes are on the disk before the file has its name.
///
/// # Errors
/// The folder or the file cannot be written.
pub fn write_atomic(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    let path = path.as_ref();
    let dir = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    // A pipe or a device in the place of the file would be gone, and whoever reads from it would wait.
    if std::fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
        let what = "is a pipe, socket or device, which a file would replace";
        return Err(Error::invalid(path.display().to_string(), what, "name a file"));
    }
    std::fs::create_dir_all(dir).map_err(Error::io("create", dir))?;
    remove_abandoned_once(dir);
    let written = match unnamed::write(dir, path, bytes) {
        Some(written) => written.map_err(Error::io("write", path)),
        None => write_named(dir, path, bytes),
    };
    written?;
    sync_folder(dir);
    Ok(())
}

/// Writes by way of a temporary name.
fn write_named(dir: &Path, path: &Path, bytes: &[u8]) -> Result<()> {
    for _ in 0..ATTEMPTS {
        let mut file = temporary().tempfile_in(dir).map_err(Error::io("create a file in", dir))?;
        // A file system without locks has none to be told apart by, and nothing is removed there.
        let locked_by_another = matches!(file.as_file().try_lock(), Err(TryLockError::WouldBlock));
        if locked_by_another || !file.path().exists() {
            // Between its making and its lock somebody else took it for abandoned.
            continue;
        }
        file.write_all(bytes).and_then(|()| file.as_file().sync_all()).map_err(Error::io("write", path))?;
        file.persist(path).map_err(|e| Error::io("write", path)(e.error))?;
        return Ok(());
    }
    let what = "temporary files vanish as soon as they are made";
    Err(Error::invalid(dir.display().to_string(), what, "find out what removes files there, or choose another folder"))
}

/// Names of temporary files, and what is published follows the umask like any other file.
fn temporary() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY[0]).suffix(TEMPORARY[1]);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder
}

/// A folder for what another program is to write, beside where its result will have its name: on that file system, gone when this is dropped,
/// and taken for abandoned once this process is.
#[derive(Debug)]
pub struct ScratchFolder {
    folder: tempfile::TempDir,
    _held: FolderLock,
}

impl ScratchFolder {
    /// Makes one in `dir`.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn beside(dir: &Path) -> Result<Self> {
        remove_abandoned_once(dir);
        let mut builder = tempfile::Builder::new();
        builder.prefix(TEMPORARY[0]).suffix(TEMPORARY[1]);
        let folder = builder.tempdir_in(dir).map_err(Error::io("create a folder in", dir))?;
        let held = FolderLock::acquire(folder.path())?;
        Ok(Self { folder, _held: held })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Folders that this process has rid of what others abandoned.
static TIDIED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// [`remove_abandoned`] the first time that this process writes into a folder: a look for each of thousands of files would cost more than
/// they do.
fn remove_abandoned_once(dir: &Path) {
    let is_first = TIDIED.lock().is_ok_and(|mut tidied| tidied.insert(dir.to_path_buf()));
    if is_first {
        remove_abandoned(dir);
    }
}

/// Removes temporary files and folders in `dir` that no process holds the lock of. What cannot be removed, or told, stays: it is in nobody's way.
pub fn remove_abandoned(dir: &Path) {
    for entry in std::fs::read_dir(dir).into_iter().flatten().flatten() {
        if !is_temporary(&entry.file_name()) {
            continue;
        }
        let (path, Ok(kind)) = (entry.path(), entry.file_type()) else { continue };
        if kind.is_file() {
            let Ok(file) = File::options().read(true).write(true).open(&path) else { continue };
            if file.try_lock().is_ok() {
                let _ = std::fs::remove_file(&path);
            }
        } else if kind.is_dir() && FolderLock::is_free(&path) {
            let _ = std::fs::remove_dir_all(&path);
        }
    }
}

/// Brings a folder's names onto the disk. Not every file system can; the file is there all the same.
pub fn sync_folder(dir: &Path) {
    #[cfg(unix)]
    let _ = File::open(dir).and_then(|folder| folder.sync_all());
    #[cfg(not(unix))]
    let _ = dir;
}

/// Files without a name, which the system forgets with the process that has them open.
#[cfg(target_os = "linux")]
mod unnamed {
    use std::ffi::CString;
    use std::fs::File;
    use std::io::{Error, ErrorKind, Result, Write};
    use std::os::fd::AsRawFd;
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::fs::OpenOptionsExt;
    use std::path::Path;

    /// Writes a file in `dir` that has its name when it is whole; none where the file system cannot, with nothing done.
    pub fn write(dir: &Path, path: &Path, bytes: &[u8]) -> Option<Result<()>> {
        let mut file = File::options().write(true).mode(0o666).custom_flags(libc::O_TMPFILE).open(dir).ok()?;
        if let Err(error) = file.write_all(bytes).and_then(|()| file.sync_all()) {
            return Some(Err(error));
        }
        match link(&file, path) {
            Ok(()) => Some(Ok(())),
            // A link replaces nothing, a renaming does.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => replace(&file, dir, path),
            Err(_) => None,
        }
    }

    /// Puts the file in the place of another.
    fn replace(file: &File, dir: &Path, path: &Path) -> Option<Result<()>> {
        // First its lock, so that nobody takes its temporary name for abandoned.
        let _ = file.try_lock();
        let named = super::temporary().make_in(dir, |name| link(file, name)).ok()?;
        Some(named.persist(path).map_err(|e| e.error))
    }

    /// Gives the file a name that is not taken.
    fn link(file: &File, name: &Path) -> Result<()> {
        let from = CString::new(format!("/proc/self/fd/{}", file.as_raw_fd()))?;
        let to = CString::new(name.as_os_str().as_bytes())?;
        // SAFETY: both point to strings that end with a zero and outlive the call, which keeps neither.
        let answer = unsafe { libc::linkat(libc::AT_FDCWD, from.as_ptr(), libc::AT_FDCWD, to.as_ptr(), libc::AT_SYMLINK_FOLLOW) };
        if answer == 0 { Ok(()) } else { Err(Error::last_os_error()) }
    }
}

#[cfg(not(target_os = "linux"))]
mod unnamed {
    use std::path::Path;

    pub fn write(_: &Path, _: &Path, _: &[u8]) -> Option<std::io::Result<()>> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn new_and_replaced_files_are_whole_and_alone_whatever_way_they_are_written() {
        type Write = fn(&Path, &Path, &[u8]) -> Result<()>;
        let ways: [Write; 2] = [|_, path, bytes| write_atomic(path, bytes), write_named];
        for write in ways {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("a.bin");
            for bytes in [&b"first"[..], b"", b"a second, longer one"] {
                write(dir.path(), &path, bytes).unwrap();
                assert_eq!(std::fs::read(&path).unwrap(), bytes);
                assert_eq!(names(dir.path()), ["a.bin"]);
            }
            let error = write(dir.path(), dir.path(), b"x").unwrap_err().to_string();
            assert!(error.contains("cannot write"), "{error}");
            assert_eq!(names(dir.path()), ["a.bin"]);
        }
    }

    #[cfg(unix)]
    #[test]
    fn files_have_the_rights_of_any_other_file_and_replace_links_rather_than_what_they_lead_to() {
        use std::os::unix::fs::MetadataExt;
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at("plain"), "x").unwrap();
        write_atomic(at("ours"), b"x").unwrap();
        write_named(dir.path(), &at("named"), b"x").unwrap();
        let mode = |name: &str| std::fs::metadata(at(name)).unwrap().mode();
        assert_eq!((mode("ours"), mode("named")), (mode("plain"), mode("plain")));
        std::os::unix::fs::symlink("plain", at("link")).unwrap();
        std::os::unix::fs::symlink("nowhere", at("dangling")).unwrap();
        for link in ["link", "dangling"] {
            write_atomic(at(link), b"new").unwrap();
            assert!(at(link).symlink_metadata().unwrap().is_file());
        }
        assert_eq!(std::fs::read(at("plain")).unwrap(), b"x");
        assert_eq!(names(dir.path()), ["dangling", "link", "named", "ours", "plain"]);
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_file_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let socket = dir.path().join("socket");
        let _listens = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        std::os::unix::fs::symlink(&socket, dir.path().join("link")).unwrap();
        for name in ["socket", "link"] {
            let error = write_atomic(dir.path().join(name), b"x").unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("pipe, socket or device"), "{error}");
        }
        assert!(!std::fs::metadata(&socket).unwrap().is_file());
        assert_eq!(names(dir.path()), ["link", "socket"]);
    }

    #[test]
    fn what_nobody_locks_goes_and_what_somebody_writes_stays() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at(".corf-dead01.tmp"), "half").unwrap();
        std::fs::create_dir(at(".corf-dead02.tmp")).unwrap();
        std::fs::write(at(".corf-dead02.tmp/video.mp4"), "half").unwrap();
        std::fs::write(at("corf.tmp"), "not ours").unwrap();
        let living = temporary().tempfile_in(dir.path()).unwrap();
        living.as_file().try_lock().unwrap();
        let scratch = ScratchFolder::beside(dir.path()).unwrap();
        write_atomic(at("a.bin"), b"x").unwrap();
        for there in [living.path(), scratch.path(), &at("corf.tmp"), &at("a.bin")] {
            assert!(there.exists(), "{}", there.display());
        }
        drop((living, scratch));
        assert_eq!(names(dir.path()), ["a.bin", "corf.tmp"]);
    }

    #[test]
    fn many_write_into_one_folder_at_once() {
        let dir = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for writer in 0..4 {
                let dir = dir.path();
                scope.spawn(move || {
                    for round in 0..20 {
                        remove_abandoned(dir);
                        write_atomic(dir.join("common"), &[writer; 64]).unwrap();
                        write_named(dir, &dir.join(format!("own-{writer}")), &[round; 64]).unwrap();
                    }
                });
            }
        });
        assert_eq!(names(dir.path()), ["common", "own-0", "own-1", "own-2", "own-3"]);
        let common = std::fs::read(dir.path().join("common")).unwrap();
        assert!(common.len() == 64 && common.iter().all(|b| *b == common[0]));
    }
}
