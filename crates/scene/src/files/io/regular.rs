//! Files that are read whole: regular ones alone, and no more of them than memory holds.
//!
//! A pipe would be waited for and a device read without end. Whatever a user names by a flag, a key or another file is opened here, so that it is
//! refused at once.

use crate::{Error, Result, bounds, contained};
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

/// Most bytes of a file of settings (TOML): those that people write have a few thousand.
pub const MAX_CONFIG_BYTES: u64 = 1 << 24;

/// Opens a regular file to be read.
///
/// # Errors
/// The file is not there or cannot be read, or it is a folder, pipe, socket or device; the message names it.
pub fn open(path: impl AsRef<Path>) -> Result<File> {
    let path = path.as_ref();
    open_as(path, &path.display().to_string())
}

/// Opens a regular file that `place` names in messages, whatever takes its place meanwhile: no pipe is waited for.
fn open_as(path: &Path, place: &str) -> Result<File> {
    // Before it is opened, for some devices do something when they are.
    contained::check_regular(path, place)?;
    let mut options = File::options();
    options.read(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK);
    let file = options.open(path).map_err(Error::io("read", path))?;
    if !file.metadata().map_err(Error::io("read", path))?.is_file() {
        return Err(Error::invalid(place, format!("{} is no regular file any more", path.display()), "give a regular file"));
    }
    Ok(file)
}

/// Reads a whole file of at most `most_bytes` that `place` names in messages.
///
/// # Errors
/// Those of [`open`]; a file that is larger.
pub fn read_at_most(path: impl AsRef<Path>, place: &str, most_bytes: u64) -> Result<Vec<u8>> {
    let path = path.as_ref();
    let bytes = up_to(path, open_as(path, place)?, most_bytes.saturating_add(1))?;
    if bytes.len() as u64 > most_bytes {
        let what = format!("{} is larger than {most_bytes} bytes", path.display());
        return Err(Error::invalid(place, what, "no such file is; give the right one"));
    }
    Ok(bytes)
}

/// Reads a whole file.
///
/// # Errors
/// Those of [`open`]; a file that is larger than the memory there is.
pub fn read(path: impl AsRef<Path>) -> Result<Vec<u8>> {
    let path = path.as_ref();
    let file = open(path)?;
    let length = file.metadata().map_err(Error::io("read", path))?.len();
    bounds::memory(&path.display().to_string(), "the file", length as f64, "give a smaller file")?;
    up_to(path, file, length)
}

/// Reads a whole text file.
///
/// # Errors
/// Those of [`read`]; a file that is no UTF-8.
pub fn read_text(path: impl AsRef<Path>) -> Result<String> {
    text(path.as_ref(), read(path.as_ref())?)
}

/// Reads a text file of settings.
///
/// # Errors
/// Those of [`read_text`]; a file of more than [`MAX_CONFIG_BYTES`].
pub fn read_config_text(path: impl AsRef<Path>) -> Result<String> {
    let path = path.as_ref();
    let file = open(path)?;
    let length = file.metadata().map_err(Error::io("read", path))?.len();
    if length > MAX_CONFIG_BYTES {
        let what = format!("has {length} bytes, where settings have at most {MAX_CONFIG_BYTES}");
        return Err(Error::invalid(path.display().to_string(), what, "give a file of settings (TOML)"));
    }
    text(path, up_to(path, file, length)?)
}

/// The first `most_bytes` of a file; one that grows while it is read ends there.
fn up_to(path: &Path, file: File, most_bytes: u64) -> Result<Vec<u8>> {
    let length = file.metadata().map_err(Error::io("read", path))?.len().min(most_bytes);
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    file.take(most_bytes).read_to_end(&mut bytes).map_err(Error::io("read", path))?;
    Ok(bytes)
}

/// The text of a file, without the byte order mark that some programs put in front.
fn text(path: &Path, mut bytes: Vec<u8>) -> Result<String> {
    if bytes.starts_with("\u{feff}".as_bytes()) {
        bytes.drain(.."\u{feff}".len());
    }
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        Error::invalid(
            path.display().to_string(),
            format!("is no UTF-8 text (from byte {at})"),
            "give a text file, saved as UTF-8",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regular_files_are_read_whole_and_others_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        std::fs::write(&path, "x = 1\n").unwrap();
        assert_eq!((read(&path).unwrap(), read_text(&path).unwrap().as_str()), (b"x = 1\n".to_vec(), "x = 1\n"));
        assert_eq!(read_config_text(&path).unwrap(), "x = 1\n");
        std::fs::write(&path, b"ok \xff").unwrap();
        assert!(read_text(&path).unwrap_err().to_string().contains("from byte 3"));
        assert!(read(dir.path()).unwrap_err().to_string().contains("a folder"));
        assert!(
            matches!(read(dir.path().join("gone")), Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound)
        );
        // A file with a hole: no byte of it is on the disk.
        let sparse = |bytes: u64| File::create(&path).unwrap().set_len(bytes).unwrap();
        sparse(MAX_CONFIG_BYTES + 1);
        assert!(read_config_text(&path).unwrap_err().to_string().contains("16777217 bytes"));
        sparse(1 << 42);
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains("a.toml: the file would take 4398.0 GB"), "{message}");
    }

    #[test]
    fn a_bound_holds_for_regular_files_and_nothing_else_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        std::fs::write(&path, "four").unwrap();
        let text = |path: &Path, most| read_at_most(path, "a", most).map_err(|e| e.to_string());
        assert_eq!(text(&path, 4).unwrap(), b"four");
        assert!(text(&path, 3).unwrap_err().contains("larger than 3 bytes"));
        assert!(text(dir.path(), 4).unwrap_err().contains("a folder"));
        assert!(text(&dir.path().join("gone"), 4).unwrap_err().contains("cannot read"));
        #[cfg(unix)]
        {
            let pipe = dir.path().join("pipe");
            assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
            assert!(text(&pipe, 4).unwrap_err().contains("pipe"));
            assert!(text(Path::new("/dev/zero"), 4).unwrap_err().contains("device"));
            let ring = dir.path().join("ring");
            std::os::unix::fs::symlink("ring", &ring).unwrap();
            assert!(text(&ring, 4).unwrap_err().contains("cannot read"));
        }
    }

    #[cfg(unix)]
    #[test]
    fn pipes_sockets_and_devices_are_refused_without_waiting() {
        let dir = tempfile::tempdir().unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(dir.path().join("socket")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", dir.path().join("zero")).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(dir.path().join("pipe")).status().unwrap().success());
        for name in ["socket", "zero", "pipe"] {
            let path = dir.path().join(name);
            for message in [read(&path).unwrap_err(), read_text(&path).unwrap_err(), read_config_text(&path).unwrap_err()] {
                let message = message.to_string();
                assert!(message.contains(name) && message.contains("pipe, socket or device"), "{message}");
            }
        }
    }
}
