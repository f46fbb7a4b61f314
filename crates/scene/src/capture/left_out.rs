//! Pictures of a capture that no pose belongs to.

use super::Shot;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Endings of pictures, in small letters.
const PICTURES: [&str; 7] = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "webp"];

/// A note of the pictures in the folder `images`, and in those below it, that no shot has; without that folder, of those beside the shots' images.
pub(super) fn note(images: &Path, shots: &[Shot]) -> Option<String> {
    let real = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    let of_shots = shots.iter().flat_map(|s| [&s.image, &s.depth, &s.mask]).flatten();
    let known: BTreeSet<PathBuf> = of_shots.map(real).collect();
    let within = |shot: &Shot| shot.image.as_ref().is_some_and(|path| path.starts_with(images));
    if shots.iter().all(|shot| shot.image.is_none()) {
        return None;
    }
    let mut left_out = Vec::new();
    if shots.iter().all(within) {
        let mut folders = vec![images.to_path_buf()];
        while let Some(folder) = folders.pop() {
            pictures(&folder, &mut left_out, Some(&mut folders));
        }
    } else {
        let folders: BTreeSet<&Path> = shots.iter().filter_map(|s| s.image.as_ref()?.parent()).collect();
        folders.into_iter().for_each(|folder| pictures(folder, &mut left_out, None));
    }
    left_out.retain(|path| !known.contains(&real(path)));
    left_out.sort();
    let first = left_out.first()?;
    // Notes are kept in the data set, whose hash is not to depend on where the capture lies.
    let first = first.strip_prefix(images).ok().or(first.file_name().map(Path::new))?.display();
    Some(match left_out.len() {
        1 => format!("the picture {first} has no pose and was left out"),
        count => format!("{count} pictures have no pose and were left out, as {first}"),
    })
}

/// The pictures of a folder, and its folders. What cannot be read holds none.
fn pictures(folder: &Path, found: &mut Vec<PathBuf>, mut folders: Option<&mut Vec<PathBuf>>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        // A link to a folder might lead back here.
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            if let Some(folders) = folders.as_deref_mut() {
                folders.push(path);
            }
            continue;
        }
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        if ending.is_some_and(|e| PICTURES.contains(&e.as_str())) && path.is_file() {
            found.push(path);
        }
    }
}
