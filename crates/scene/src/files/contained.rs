//! Files that a file names: kept to the folder of the file that names them, and to regular files.
//!
//! A model or a data set comes from elsewhere as often as not. What it names is read, so it must not name what its sender could not
//! have put beside it: no absolute path, no way up out of the folder, no symbolic link that leads out, and nothing that is no regular
//! file (a pipe would be waited for, a device read without end).

use crate::{Error, Result};
use std::path::{Component, Path, PathBuf};

/// Policy for file references: where the files named by another file may lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reach {
    /// Regular files in its own folder and below.
    #[default]
    Folder,
    /// Regular files anywhere, as shared textures need it.
    Anywhere,
}

/// The path of `name`, as a file in `folder` gives it; `place` says in messages where it is named, `help` what to do about a name
/// that leads out. A file that does not exist has a path as well: reading it says so.
///
/// # Errors
/// A name that leads out of the folder (where `reach` keeps it in), or that is no regular file.
pub fn resolve(folder: &Path, name: &Path, reach: Reach, place: &str, help: &str) -> Result<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let path = folder.join(name);
    let leads_out = |how: &str| Err(Error::invalid(place, format!("names \"{}\", {how}", name.display()), help));
    if reach == Reach::Folder {
        let mut depth = 0i64;
        for component in name.components() {
            match component {
                Component::Normal(_) => depth += 1,
                Component::CurDir => {}
                Component::ParentDir => depth -= 1,
                Component::RootDir | Component::Prefix(_) => return leads_out("which is absolute"),
            }
            if depth < 0 {
                return leads_out("which leads out of its folder");
            }
        }
    }
    let real = match path.canonicalize() {
        Ok(real) => real,
        // Whoever reads it says what is missing.
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(path),
        Err(e) => return Err(Error::io("read", &path)(e)),
    };
    if reach == Reach::Folder && !real.starts_with(folder.canonicalize().map_err(Error::io("read", folder))?) {
        return leads_out("which is a symbolic link that leads out of its folder");
    }
    check_regular(&path, place)?;
    Ok(path)
}

/// Checks that a path leads to a regular file.
///
/// # Errors
/// It does not exist, or it is a folder, pipe, socket or device.
pub fn check_regular(path: &Path, place: &str) -> Result<()> {
    let kind = std::fs::metadata(path).map_err(Error::io("read", path))?.file_type();
    if kind.is_file() {
        return Ok(());
    }
    let what = if kind.is_dir() { "is a folder" } else { "is a pipe, socket or device" };
    let name = path.display().to_string();
    let what = if name == place { what.to_owned() } else { format!("{name} {what}") };
    Err(Error::invalid(place, what, "give a regular file"))
}

/// Help text of the error about a mesh file or material library that names a file outside its folder.
pub const MESH_HELP: &str = "copy the file into the mesh's folder and name it there; where files outside are meant, say `allow_outside = true` \
                             under [scene] of the scene file, or --allow-outside for a bare mesh";

/// Help text of the error about a data set that names a file outside its folder.
pub const DATASET_HELP: &str = "a data set holds its own files: copy the file in, or generate the data set again";

/// A URI's path with `%20` and its like decoded; anything malformed stays as it is.
pub fn percent_decoded(uri: &str) -> PathBuf {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let hex = (bytes[i] == b'%').then(|| bytes.get(i + 1..i + 3)).flatten().filter(|h| h.iter().all(u8::is_ascii_hexdigit));
        let value = hex.and_then(|h| std::str::from_utf8(h).ok()).and_then(|h| u8::from_str_radix(h, 16).ok());
        out.push(value.unwrap_or(bytes[i]));
        i += if value.is_some() { 3 } else { 1 };
    }
    PathBuf::from(String::from_utf8_lossy(&out).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolved(folder: &Path, name: &str, reach: Reach) -> std::result::Result<PathBuf, String> {
        resolve(folder, Path::new(name), reach, "m.gltf: images[0]", MESH_HELP).map_err(|e| e.to_string())
    }

    #[test]
    fn names_stay_in_the_folder_unless_allowed_out() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("model");
        std::fs::create_dir_all(folder.join("textures")).unwrap();
        std::fs::write(dir.path().join("secret.png"), "x").unwrap();
        std::fs::write(folder.join("a.png"), "x").unwrap();
        std::fs::write(folder.join("textures/b.png"), "x").unwrap();
        for name in ["a.png", "textures/b.png", "./a.png", "textures/../a.png"] {
            assert_eq!(resolved(&folder, name, Reach::Folder).unwrap(), folder.join(name));
        }
        let absolute = folder.join("a.png").display().to_string();
        for (name, why) in [
            ("../secret.png", "leads out"),
            ("textures/../../secret.png", "leads out"),
            ("../model/a.png", "leads out"),
            (absolute.as_str(), "absolute"),
            ("textures", "folder"),
            ("", "folder"),
        ] {
            let message = resolved(&folder, name, Reach::Folder).unwrap_err();
            assert!(message.contains(why) && message.contains("images[0]"), "{name}: {message}");
        }
        assert_eq!(resolved(&folder, "gone.png", Reach::Folder).unwrap(), folder.join("gone.png"));
        assert!(resolved(&folder, "../secret.png", Reach::Anywhere).is_ok());
        assert!(resolved(&folder, &absolute, Reach::Anywhere).is_ok());
        assert!(resolved(&folder, "../model", Reach::Anywhere).unwrap_err().contains("a folder"));
    }

    #[cfg(unix)]
    #[test]
    fn links_that_lead_out_and_what_is_no_file_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("model");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(dir.path().join("secret.png"), "x").unwrap();
        std::fs::write(folder.join("a.png"), "x").unwrap();
        std::os::unix::fs::symlink("../secret.png", folder.join("out.png")).unwrap();
        std::os::unix::fs::symlink("a.png", folder.join("in.png")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", folder.join("zero.png")).unwrap();
        assert!(resolved(&folder, "in.png", Reach::Folder).is_ok());
        assert!(resolved(&folder, "out.png", Reach::Folder).unwrap_err().contains("symbolic link"));
        assert!(resolved(&folder, "out.png", Reach::Anywhere).is_ok());
        assert!(resolved(&folder, "zero.png", Reach::Folder).unwrap_err().contains("symbolic link"));
        assert!(resolved(&folder, "zero.png", Reach::Anywhere).unwrap_err().contains("device"));
    }

    #[test]
    fn percent_escapes_are_decoded_and_others_kept() {
        for (uri, path) in [("my%20file.bin", "my file.bin"), ("%2e%2E/x", "../x"), ("50%", "50%"), ("%zz%+1", "%zz%+1")] {
            assert_eq!(percent_decoded(uri), PathBuf::from(path));
        }
    }
}
