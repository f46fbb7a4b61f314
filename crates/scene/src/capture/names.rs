//! Names of files: their order along a capture, and stems by which files of several folders belong together.

use crate::contained::{self, Reach};
use crate::{Error, Result};
use std::cmp::Ordering;
use std::collections::BTreeMap;
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

/// The name without its ending, folders included: `left/00017.png` is `left/00017`. What begins with a digit is no ending but part of a number, as in
/// the names that are times: `1305031102.175304`.
pub(super) fn stem(name: &str) -> &str {
    let begin = name.rfind('/').map_or(0, |i| i + 1);
    let is_ending = |dot: &usize| name[begin + dot + 1..].starts_with(|c: char| c.is_ascii_alphabetic());
    // A dot at the beginning of a file's name begins no ending.
    name[begin..].rfind('.').filter(|dot| *dot > 0).filter(is_ending).map_or(name, |dot| &name[..begin + dot])
}

/// The last part of a stem: `left/00017` is `00017`.
pub(super) fn last(stem: &str) -> &str {
    stem.rsplit('/').next().unwrap_or(stem)
}

/// What a name may be below a folder that was given by itself: the name as it stands, then without its first folders, one more each time. What leads
/// elsewhere (a root, a drive, `..`) is left out.
pub(super) fn tails(name: &str) -> impl Iterator<Item = &str> {
    let starts = std::iter::once(0).chain(name.match_indices('/').map(|(i, _)| i + 1));
    let stays = |part: &str| !matches!(part, "" | "." | "..") && !part.contains(':');
    starts.map(|start| &name[start..]).filter(move |tail| tail.split('/').all(stays))
}

/// Two names that mean one file, and the file; `found` are the files of the names.
pub(super) fn shared_file<'a>(found: impl Iterator<Item = (&'a str, &'a Path)>) -> Option<([&'a str; 2], &'a Path)> {
    let mut names: BTreeMap<PathBuf, &str> = BTreeMap::new();
    found.into_iter().find_map(|(name, path)| {
        // Links and detours lead to the same file; one that is not there is known by its path.
        let real = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        names.insert(real, name).map(|other| ([other, name], path))
    })
}

/// Of every tail of some names, one or two names that have it.
type Owners<'a> = BTreeMap<String, (&'a str, Option<&'a str>)>;

/// The owners of all tails of names that are written as `key` has them.
fn owners<'a>(names: &[&'a str], key: impl Fn(&str) -> String) -> Owners<'a> {
    let mut owners = Owners::new();
    for name in names {
        for tail in tails(&key(name)) {
            match owners.get_mut(tail) {
                Some((_, second)) => *second = second.or(Some(name)),
                None => drop(owners.insert(tail.to_owned(), (name, None))),
            }
        }
    }
    owners
}

const LINKS: &str = "put the file itself there";

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
                if !ending.is_some_and(|e| endings.contains(&e.as_str())) {
                    continue;
                }
                if kind.is_symlink() {
                    // As an image of a capture may: it leads to a file of this folder, or nothing is read.
                    let path = contained::resolve(dir, &relative, Reach::Folder, &dir.display().to_string(), LINKS)?;
                    contained::check_regular(&path, &path.display().to_string())?;
                } else if !kind.is_file() {
                    continue;
                }
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

    /// The file of a name that is written as `own` here: by the whole of it, then without its first folders, as few as can be, where no other name
    /// could mean the file.
    fn file(&self, own: &str, owners: &Owners<'_>) -> Result<Option<PathBuf>> {
        let Some((tail, path)) = tails(own).find_map(|tail| Some((tail, self.by_stem.get(tail)?))) else { return Ok(None) };
        match owners.get(tail) {
            // Whoever has the whole name owns the file; of a shorter one there may be several owners.
            Some(&(a, Some(b))) if tail.len() < own.len() => Err(self.shared([a, b], path)),
            _ => Ok(Some(path.clone())),
        }
    }

    fn shared(&self, [a, b]: [&str; 2], path: &Path) -> Error {
        let what = format!("images {a} and {b} would both mean {}", path.display());
        Error::invalid(self.dir.display().to_string(), what, "keep the folders of the images' names, or rename the files")
    }

    /// Refuses a file that two names mean.
    fn check_own<'a>(&self, names: &[&'a str], found: impl Iterator<Item = Option<&'a Path>>) -> Result<()> {
        let found = names.iter().zip(found).filter_map(|(name, path)| Some((*name, path?)));
        shared_file(found).map_or(Ok(()), |(pair, path)| Err(self.shared(pair, path)))
    }

    /// The file of every name, by its whole stem, or by the stem without its first folders, as few as can be.
    ///
    /// # Errors
    /// A name without a file, or a file that two names mean.
    pub fn of(&self, names: &[&str], what: &str) -> Result<Vec<PathBuf>> {
        let owners = owners(names, |name| stem(name).to_owned());
        let find = |name: &&str| {
            self.file(stem(name), &owners)?.ok_or_else(|| {
                Error::invalid(
                    self.dir.display().to_string(),
                    format!("image {name} has no {what}: there is no {}.{{{}}}", last(stem(name)), self.endings.join(",")),
                    "files belong together by their stems: rename them, add the missing one, or take the image out of the capture",
                )
            })
        };
        let found: Vec<PathBuf> = names.iter().map(find).collect::<Result<_>>()?;
        self.check_own(names, found.iter().map(|p| Some(p.as_path())))?;
        Ok(found)
    }

    /// The file of every name that has one, as [`Self::of`] finds it, by the whole name with one more ending (`a.jpg.png` for `a.jpg`), or by the
    /// stem with `_WHAT` behind it (`a_mask.png`).
    ///
    /// # Errors
    /// No name has a file, or a file that two names mean.
    pub fn of_some(&self, names: &[&str], what: &str) -> Result<Vec<Option<PathBuf>>> {
        // The name with its ending comes first: where two images have one stem, it tells them apart.
        let keys: [&dyn Fn(&str) -> String; 4] =
            [&|name| name.to_owned(), &|name| format!("{name}_{what}"), &|name| stem(name).to_owned(), &|name| {
                format!("{}_{what}", stem(name))
            }];
        let keys = keys.map(|key| (key, owners(names, key)));
        let find = |name: &&str| -> Result<Option<PathBuf>> {
            for (key, owners) in &keys {
                if let Some(path) = self.file(&key(name), owners)? {
                    return Ok(Some(path));
                }
            }
            Ok(None)
        };
        let found: Vec<Option<PathBuf>> = names.iter().map(find).collect::<Result<_>>()?;
        if found.iter().all(Option::is_none) {
            return Err(Error::invalid(
                self.dir.display().to_string(),
                format!("no image has a {what} here"),
                "files belong together by their stems: rename them",
            ));
        }
        self.check_own(names, found.iter().map(Option::as_deref))?;
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
    fn a_file_belongs_to_one_name() {
        let dir = tempfile::tempdir().unwrap();
        let folder = |files: &[&str]| {
            let root = dir.path().join(files.join("+").replace('/', "_"));
            for file in files {
                std::fs::create_dir_all(root.join(file).parent().unwrap()).unwrap();
                std::fs::write(root.join(file), "").unwrap();
            }
            (Folder::list(&root, &["png", "exr"], "--rf").unwrap(), root)
        };
        let two = ["cam0/1.png", "cam1/1.png"];
        // Flat: one file for both.
        let (flat, _) = folder(&["1.exr"]);
        let message = flat.of(&two, "spectrum").unwrap_err().to_string();
        assert!(message.contains("cam0/1.png and cam1/1.png would both mean") && message.contains("1.exr"), "{message}");
        assert!(flat.of_some(&two, "mask").is_err());
        // As many folders as the files keep.
        let (deep, root) = folder(&["cam0/1.exr", "cam1/1.exr"]);
        let names = ["photos/cam0/1.jpg", "photos/cam1/1.jpg"];
        assert_eq!(deep.of(&names, "spectrum").unwrap(), ["cam0/1.exr", "cam1/1.exr"].map(|f| root.join(f)));
        assert_eq!(deep.of(&two, "spectrum").unwrap(), ["cam0/1.exr", "cam1/1.exr"].map(|f| root.join(f)));
        // Half of them flat: nothing says whose it is.
        let (half, _) = folder(&["cam0/1.png", "1.png"]);
        assert!(half.of(&two, "spectrum").is_err() && half.of_some(&two, "mask").is_err());
        // Images of one stem share no spectrum, and have masks of their own by their whole names.
        let (one, _) = folder(&["a.exr", "b.exr"]);
        assert!(one.of(&["a.jpg", "a.png"], "spectrum").is_err() && one.of_some(&["a.jpg", "a.png", "b.png"], "mask").is_err());
        let (own, root) = folder(&["a.jpg.png", "a.png.png"]);
        let masks = ["a.jpg.png", "a.png.png"].map(|f| Some(root.join(f)));
        assert_eq!(own.of_some(&["a.jpg", "a.png"], "mask").unwrap(), masks);
    }

    #[test]
    fn names_that_are_times_have_files_of_their_own() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["5.25.exr", "5.5.exr", "5.exr"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        let folder = Folder::list(dir.path(), &["exr"], "--rf").unwrap();
        let path = |name: &str| dir.path().join(name);
        assert_eq!(folder.of(&["5.25", "5.5.jpg"], "spectrum").unwrap(), [path("5.25.exr"), path("5.5.exr")]);
        assert!(folder.of(&["5.75"], "spectrum").is_err(), "5.exr is not its file");
    }

    #[cfg(unix)]
    #[test]
    fn links_within_the_folder_are_files_and_others_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let (inside, outside) = (dir.path().join("in"), dir.path().join("b.png"));
        std::fs::create_dir(&inside).unwrap();
        std::fs::write(inside.join("a.png"), "").unwrap();
        std::fs::write(&outside, "").unwrap();
        let list = || Folder::list(&inside, &["png"], "--masks").map(|folder| folder.len()).map_err(|e| e.to_string());
        std::os::unix::fs::symlink("a.png", inside.join("c.png")).unwrap();
        assert_eq!(list(), Ok(2));
        std::os::unix::fs::symlink(&outside, inside.join("b.png")).unwrap();
        assert!(list().unwrap_err().contains("symbolic link that leads out"));
        std::fs::remove_file(inside.join("b.png")).unwrap();
        std::os::unix::fs::symlink("gone.png", inside.join("b.png")).unwrap();
        assert!(list().is_err());
    }

    #[test]
    fn tails_drop_folders_and_lead_nowhere_else() {
        let of = |name: &'static str| tails(name).collect::<Vec<_>>();
        assert_eq!(of("a/b/c.png"), ["a/b/c.png", "b/c.png", "c.png"]);
        assert_eq!(of("c.png"), ["c.png"]);
        assert_eq!(of("/photos/c.png"), ["photos/c.png", "c.png"]);
        assert_eq!(of("../../x/c.png"), ["x/c.png", "c.png"]);
        assert_eq!(of("C:/x/c.png"), ["x/c.png", "c.png"]);
        assert_eq!(of("x/../c.png"), ["c.png"]);
        assert!(of("").is_empty() && of("..").is_empty());
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
        assert_eq!(
            (stem("1305031102.175304"), stem("rgb/1305031102.175304.png")),
            ("1305031102.175304", "rgb/1305031102.175304")
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
