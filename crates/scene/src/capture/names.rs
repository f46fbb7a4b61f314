//! Names of files: their order along a capture, and stems by which files of several folders belong together.

use crate::{Error, Result};
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The order of file names in which numbers count by their value: `f2.png` comes before `f10.png`. Names that are padded are in plain order.
pub(super) fn natural(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    while !left.is_empty() && !right.is_empty() {
        let (x, y) = (digits(left), digits(right));
        let order = if x.is_empty() || y.is_empty() {
            let (c, d) = (left.chars().next(), right.chars().next());
            left = &left[c.map_or(0, char::len_utf8)..];
            right = &right[d.map_or(0, char::len_utf8)..];
            c.cmp(&d)
        } else {
            (left, right) = (&left[x.len()..], &right[y.len()..]);
            let (x, y) = (x.trim_start_matches('0'), y.trim_start_matches('0'));
            x.len().cmp(&y.len()).then_with(|| x.cmp(y))
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    left.len().cmp(&right.len()).then_with(|| a.cmp(b))
}

fn digits(text: &str) -> &str {
    &text[..text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len())]
}

/// The name without its ending, folders included: `left/00017.png` is `left/00017`.
pub(super) fn stem(name: &str) -> &str {
    let begin = name.rfind('/').map_or(0, |i| i + 1);
    // A dot at the beginning of a file's name begins no ending.
    name[begin..].rfind('.').filter(|i| *i > 0).map_or(name, |i| &name[..begin + i])
}

/// The last part of a stem: `left/00017` is `00017`.
pub(super) fn last(stem: &str) -> &str {
    stem.rsplit('/').next().unwrap_or(stem)
}

/// Whether the last parts of all stems differ, so that they tell the names apart.
fn differ_in_last(names: &[&str]) -> bool {
    names.iter().map(|n| last(stem(n))).collect::<BTreeSet<_>>().len() == names.len()
}

/// The files of a folder that have one of some endings, by stem.
pub(super) struct Folder {
    dir: PathBuf,
    by_stem: BTreeMap<String, PathBuf>,
    endings: &'static [&'static str],
}

impl Folder {
    /// Lists a folder and those below it; `flag` is what it was given with.
    ///
    /// # Errors
    /// A folder that cannot be read, that has no such file, or two of one stem.
    pub fn list(dir: &Path, endings: &'static [&'static str], flag: &str) -> Result<Self> {
        let mut by_stem = BTreeMap::new();
        let mut folders = vec![PathBuf::new()];
        if !dir.is_dir() {
            return Err(Error::invalid(
                dir.display().to_string(),
                "there is no such folder",
                format!("give a folder with {flag}"),
            ));
        }
        while let Some(below) = folders.pop() {
            let here = dir.join(&below);
            for entry in std::fs::read_dir(&here).map_err(Error::io("read", &here))? {
                let entry = entry.map_err(Error::io("read", &here))?;
                let relative = below.join(entry.file_name());
                let kind = entry.file_type().map_err(Error::io("read", entry.path()))?;
                if kind.is_dir() {
                    folders.push(relative);
                    continue;
                }
                let ending = relative.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
                let (true, Some(true)) = (kind.is_file(), ending.map(|e| endings.contains(&e.as_str()))) else { continue };
                let Some(name) = relative.to_str() else { continue };
                let name = name.replace('\\', "/");
                if let Some(other) = by_stem.insert(stem(&name).to_owned(), dir.join(&relative)) {
                    let what = format!("{} and {} have one stem", other.display(), dir.join(&relative).display());
                    return Err(Error::invalid(dir.display().to_string(), what, "keep one file a stem"));
                }
            }
        }
        if by_stem.is_empty() {
            let help = format!("give a folder with one file for every image with {flag}");
            return Err(Error::invalid(
                dir.display().to_string(),
                format!("has no file that ends in {}", endings.join(", ")),
                help,
            ));
        }
        Ok(Self { dir: dir.to_path_buf(), by_stem, endings })
    }

    /// The file of every name, by its whole stem, or by the last part of it where all of those differ.
    ///
    /// # Errors
    /// A name without a file.
    pub fn of(&self, names: &[&str], what: &str) -> Result<Vec<PathBuf>> {
        let whole: Option<Vec<PathBuf>> = names.iter().map(|n| self.by_stem.get(stem(n)).cloned()).collect();
        if let Some(found) = whole {
            return Ok(found);
        }
        let by_last = differ_in_last(names);
        let by = |name: &str| if by_last { last(stem(name)).to_owned() } else { stem(name).to_owned() };
        let find = |name: &&str| {
            let stem = by(name);
            self.by_stem.get(&stem).cloned().ok_or_else(|| {
                Error::invalid(
                    self.dir.display().to_string(),
                    format!("image {name} has no {what}: there is no {stem}.{{{}}}", self.endings.join(",")),
                    "files belong together by their stems: rename them, add the missing one, or take the image out of the capture",
                )
            })
        };
        names.iter().map(find).collect()
    }

    /// The file of every name that has one, as [`Self::of`] finds it, by the whole name with one more ending (`a.jpg.png` for `a.jpg`), or by the stem with
    /// `_WHAT` behind it (`a_mask.png`).
    ///
    /// # Errors
    /// No name has a file.
    pub fn of_some(&self, names: &[&str], what: &str) -> Result<Vec<Option<PathBuf>>> {
        let by_last = differ_in_last(names);
        let find = |name: &&str| {
            let by_parts = if by_last { [last(stem(name)), last(name)] } else { [stem(name), name] };
            let keys = [stem(name), name].into_iter().chain(by_parts);
            keys.flat_map(|key| [key.to_owned(), format!("{key}_{what}")]).find_map(|key| self.by_stem.get(&key).cloned())
        };
        let found: Vec<Option<PathBuf>> = names.iter().map(find).collect();
        if found.iter().all(Option::is_none) {
            return Err(Error::invalid(
                self.dir.display().to_string(),
                format!("no image has a {what} here"),
                "files belong together by their stems: rename them",
            ));
        }
        Ok(found)
    }

    /// Number of files.
    pub fn len(&self) -> usize {
        self.by_stem.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_only_some_have_are_found_by_stem_and_by_whole_name() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b.png", "c.jpg.png", "d_mask.png", "strange.png"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        let folder = Folder::list(dir.path(), &["png"], "--masks").unwrap();
        let found = folder.of_some(&["left/a.jpg", "left/b.jpg", "left/c.jpg", "left/d.jpg"], "mask").unwrap();
        let path = |name: &str| Some(dir.path().join(name));
        assert_eq!(found, [None, path("b.png"), path("c.jpg.png"), path("d_mask.png")]);
        let nothing = folder.of_some(&["x.jpg"], "mask").unwrap_err().to_string();
        assert!(nothing.contains("no image has a mask here"), "{nothing}");
    }

    #[test]
    fn numbers_in_names_count_by_their_value() {
        let mut names = ["f10.png", "f2.png", "f1.png", "a/f3.png", "f002b.png", "f", "f2.jpg"];
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(names, ["a/f3.png", "f", "f1.png", "f2.jpg", "f2.png", "f002b.png", "f10.png"]);
        assert_eq!(natural("é1", "é1"), Ordering::Equal);
        assert_eq!(natural("01", "1"), Ordering::Less, "equal values are told apart by their texts");
    }

    #[test]
    fn stems_keep_folders_and_lose_one_ending() {
        assert_eq!(
            (stem("left/00017.png"), stem("a.b/c"), stem("x.tar.gz"), stem(".hidden")),
            ("left/00017", "a.b/c", "x.tar", ".hidden")
        );
        assert_eq!(last("left/00017"), "00017");
    }

    #[test]
    fn files_are_found_by_stem_and_a_missing_one_is_named() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("left")).unwrap();
        for name in ["a.exr", "b.png", "left/c.npy", "readme.txt"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        let folder = Folder::list(dir.path(), &["exr", "png", "npy"], "--rf").unwrap();
        assert_eq!(folder.len(), 3);
        assert_eq!(
            folder.of(&["left/c.jpg", "a.jpg"], "spectrum").unwrap(),
            [dir.path().join("left/c.npy"), dir.path().join("a.exr")]
        );
        assert_eq!(folder.of(&["cam/b.jpg"], "spectrum").unwrap(), [dir.path().join("b.png")]);
        let message = folder.of(&["a.jpg", "d.jpg"], "spectrum").unwrap_err().to_string();
        assert!(message.contains("image d.jpg has no spectrum") && message.contains("d.{exr,png,npy}"), "{message}");
        std::fs::write(dir.path().join("a.png"), "").unwrap();
        assert!(Folder::list(dir.path(), &["exr", "png"], "--rf").err().unwrap().to_string().contains("one stem"));
        assert!(Folder::list(&dir.path().join("none"), &["exr"], "--rf").err().unwrap().to_string().contains("--rf"));
    }
}
