//! Endings of the names of outputs: of a file they say what is written, of a folder they would say something that is not so.

use anyhow::{Result, ensure};
use corf_scene::Error;
use std::path::Path;

/// Endings by which people, and programs, know files for what they are.
const OF_FILES: [&str; 27] = [
    "bin", "csv", "exr", "gif", "glb", "gltf", "gz", "html", "jpg", "json", "jsonl", "md", "mp4", "npy", "npz", "obj", "parquet",
    "ply", "png", "sog", "splat", "spz", "svg", "tar", "tex", "toml", "zip",
];

/// The ending of a path's name, in small letters; of a name that is nothing else (`.csv`) that.
pub fn ending(path: &Path) -> Option<String> {
    path.file_name()?.to_str()?.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase())
}

/// Refuses the name of an output file that is an ending alone: a name was left out before it.
///
/// # Errors
/// Such a name; `flag` gives it.
pub fn check_file(flag: &str, path: &Path) -> Result<()> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    if let Some(ending) = name.strip_prefix('.').filter(|ending| OF_FILES.contains(&ending.to_ascii_lowercase().as_str())) {
        let place = format!("{flag} {}", path.display());
        return Err(Error::invalid(place, "it is an ending without a name", format!("give {flag} NAME.{ending}")).into());
    }
    Ok(())
}

/// Refuses the name of a folder to be made that is a file's: somebody awaits a file.
///
/// # Errors
/// Such a name of which there is no folder yet.
pub fn check_folder(path: &Path) -> Result<()> {
    let of_file = ending(path).filter(|ending| OF_FILES.contains(&ending.as_str()) && !path.is_dir());
    ensure!(
        of_file.is_none(),
        "{}: what is written is a folder, and its name is that of a file\n  help: name a folder with --out, without the ending .{}",
        path.display(),
        of_file.unwrap_or_default()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_told_from_its_ending() {
        let of = |path: &str| ending(Path::new(path));
        assert_eq!([of("a/links.CSV"), of(".npz"), of("a.b/links")], [Some("csv".to_owned()), Some("npz".to_owned()), None]);
        for (path, is_refused) in [(".csv", true), ("a/.JSON", true), ("a.csv", false), (".hidden", false), ("a/b", false)] {
            assert_eq!(check_file("--out", Path::new(path)).is_err(), is_refused, "{path}");
        }
        let said = check_file("--out", Path::new("x/.csv")).unwrap_err().to_string();
        assert!(said.contains("--out x/.csv") && said.contains("NAME.csv"), "{said}");
    }

    #[test]
    fn a_folder_has_no_files_name_unless_it_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let there = folder.path().join("maps.png");
        std::fs::create_dir(&there).unwrap();
        for (path, is_refused) in [(there, false), ("maps.svg".into(), true), (".csv".into(), true), ("run-1.5".into(), false)] {
            assert_eq!(check_folder(&path).is_err(), is_refused, "{}", path.display());
        }
    }
}
