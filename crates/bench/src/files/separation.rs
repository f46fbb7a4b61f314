//! Outputs are kept apart from inputs: what is read is neither written over nor added to, however its path is spelt.

use anyhow::Result;
use corf_scene::Error;
use std::path::{Component, Path, PathBuf};

/// Something that a command reads.
#[derive(Clone, Copy, Debug)]
pub enum Reads<'a> {
    /// A file.
    File(&'a Path),
    /// A run, data set or capture: everything in a folder.
    Folder(&'a Path),
}

/// Most entries of a folder that is read among which one file is looked for by its other names.
const MOST_ENTRIES: usize = 1_000_000;

/// Refuses an output, a file or a folder that need not exist, which is something that is read or lies in it; `flag` says in the message where it
/// was given. Paths are the same where they lead to the same place: links, `..`, other names of one file, and other spellings where the file
/// system knows them.
///
/// # Errors
/// It is, or lies there; no working directory.
pub fn keep_apart(flag: &str, output: &Path, reads: &[Reads<'_>]) -> Result<()> {
    let places = places(output)?;
    for reads in reads {
        match reads {
            Reads::File(file) => {
                if places.iter().any(|place| is_same(place, file)) {
                    let what = format!("{} is {}, which is read", output.display(), file.display());
                    return Err(Error::invalid(flag, what, "name another file").into());
                }
            }
            Reads::Folder(folder) => {
                let lies_in = |place: &PathBuf| place.ancestors().any(|above| is_same(above, folder));
                if places.iter().any(lies_in) || is_linked_from(output, folder) {
                    let what = format!("{} lies in {}, which is read", output.display(), folder.display());
                    return Err(Error::invalid(flag, what, "choose a place outside of it, where nothing of it is touched").into());
                }
            }
        }
    }
    Ok(())
}

/// Where a path leads, and where its last name stands: two places where that name is a link.
fn places(path: &Path) -> Result<[PathBuf; 2]> {
    let absolute = std::path::absolute(path)?;
    let own = match (absolute.parent(), absolute.file_name()) {
        (Some(parent), Some(name)) => resolved(parent).join(name),
        _ => resolved(&absolute),
    };
    Ok([resolved(&absolute), own])
}

/// An absolute path with links followed as far as there is something, and `..` taken off behind.
fn resolved(absolute: &Path) -> PathBuf {
    let mut real = PathBuf::new();
    for component in absolute.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir => {
                real.pop();
            }
            part => {
                real.push(part);
                if let Ok(there) = real.canonicalize() {
                    real = there;
                }
            }
        }
    }
    real
}

/// Whether two paths lead to one file or folder.
pub fn is_same(a: &Path, b: &Path) -> bool {
    let by_identity = matches!((identity(a), identity(b)), (Some(a), Some(b)) if a == b);
    let place = |path: &Path| std::path::absolute(path).ok().map(|path| resolved(&path));
    by_identity || place(a).is_some_and(|a| place(b) == Some(a))
}

/// Device and number of what a path leads to.
#[cfg(unix)]
fn identity(path: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    path.metadata().ok().map(|m| (m.dev(), m.ino()))
}

#[cfg(not(unix))]
fn identity(_: &Path) -> Option<(u64, u64)> {
    None
}

/// Whether an existing file has another name in a folder, or below it.
#[cfg(unix)]
fn is_linked_from(file: &Path, folder: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    if !file.metadata().is_ok_and(|m| m.is_file() && m.nlink() > 1) {
        return false;
    }
    let (mut open, mut seen) = (vec![folder.to_path_buf()], 0);
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            seen += 1;
            match entry.file_type() {
                Ok(kind) if kind.is_dir() && seen < MOST_ENTRIES => open.push(entry.path()),
                Ok(kind) if kind.is_file() && is_same(file, &entry.path()) => return true,
                _ => {}
            }
        }
    }
    false
}

#[cfg(not(unix))]
fn is_linked_from(_: &Path, _: &Path) -> bool {
    let _ = MOST_ENTRIES;
    false
}

/// Endings of the files that scenes consist of.
const OF_SCENES: [&str; 9] = ["toml", "glb", "gltf", "bin", "obj", "mtl", "png", "jpg", "jpeg"];

/// Refuses an output file that is there already and is named as a part of a scene: a mesh names its buffers, libraries and textures, and one of
/// those is not what was meant.
///
/// # Errors
/// It is.
pub fn keep_from_scene(flag: &str, output: &Path) -> Result<()> {
    let [place, own] = places(output)?;
    let of_scene = |path: &Path| {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        path.exists() && OF_SCENES.contains(&ending.as_str())
    };
    if of_scene(&place) || of_scene(&own) {
        let what = format!("{} is there, and is named as a part of a scene", output.display());
        return Err(Error::invalid(flag, what, "name another file").into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn refused(output: &Path, reads: Reads<'_>) -> bool {
        match keep_apart("--out", output, &[reads]) {
            Ok(()) => false,
            Err(error) => {
                let text = error.to_string();
                assert!(text.starts_with("--out: ") && text.contains("which is read") && text.contains("help"), "{text}");
                true
            }
        }
    }

    #[test]
    fn what_is_read_and_what_lies_in_it_is_no_output_however_it_is_spelt() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir_all(at("run/models")).unwrap();
        fs::create_dir_all(at("run-2")).unwrap();
        fs::write(at("run/a.ply"), "x").unwrap();
        fs::write(at("b.ply"), "x").unwrap();
        let run = at("run");
        for inside in [
            "run",
            "run/",
            "run/a.ply",
            "run/new.ply",
            "run/new/deep/er.ply",
            "run-2/../run/new.ply",
            "./run/models/../new.ply",
            "no/../run/x",
        ] {
            assert!(refused(&at(inside), Reads::Folder(&run)), "{inside}");
        }
        for outside in ["b.ply", "run-2", "run-2/a.ply", "run/../new.ply", "run.ply", "", "no/run"] {
            assert!(!refused(&at(outside), Reads::Folder(&run)), "{outside}");
        }
        assert!(refused(&at("run-2/../b.ply"), Reads::File(&at("b.ply"))));
        assert!(!refused(&at("c.ply"), Reads::File(&at("b.ply"))));
        // What is read may be named in a roundabout way as well, or not be there.
        assert!(refused(&at("run/x"), Reads::Folder(&at("run-2/../run"))));
        assert!(refused(&at("gone/x"), Reads::Folder(&at("gone"))) && !refused(&at("gone-2"), Reads::Folder(&at("gone"))));
    }

    #[cfg(unix)]
    #[test]
    fn links_of_either_kind_lead_where_they_lead() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir_all(at("run/models")).unwrap();
        fs::write(at("run/models/a.ply"), "x").unwrap();
        symlink("run", at("link")).unwrap();
        symlink("run/models/a.ply", at("soft.ply")).unwrap();
        fs::hard_link(at("run/models/a.ply"), at("hard.ply")).unwrap();
        fs::write(at("other.ply"), "x").unwrap();
        symlink("../other.ply", at("run/out.ply")).unwrap();
        let run = at("run");
        for inside in ["link", "link/new.ply", "link/../run/new.ply", "soft.ply", "hard.ply", "run/out.ply"] {
            assert!(refused(&at(inside), Reads::Folder(&run)), "{inside}");
        }
        assert!(refused(&at("run/new.ply"), Reads::Folder(&at("link"))));
        for name in ["soft.ply", "hard.ply", "link/models/a.ply"] {
            assert!(refused(&at(name), Reads::File(&at("run/models/a.ply"))), "{name}");
        }
        assert!(!refused(&at("other.ply"), Reads::Folder(&run)));
    }

    #[test]
    fn a_part_of_a_scene_is_not_written_over() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["room.GLB", "wall.png", "links.json"] {
            fs::write(dir.path().join(name), "x").unwrap();
        }
        for (name, is_refused) in [("room.GLB", true), ("wall.png", true), ("links.json", false), ("new.png", false)] {
            assert_eq!(keep_from_scene("--out", &dir.path().join(name)).is_err(), is_refused, "{name}");
        }
    }
}
