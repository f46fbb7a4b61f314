//! Data sets of the second kind: an array that stands still while the transmitter moves, in the layout in which NeRF² was published.
//!
//! ```text
//! dataset.json               kind, frames, what a grey level means, split, SHA-256 of every file
//! nerf2/gateway_info.yml     nerf2/tx_pos.csv     nerf2/train_index.txt     nerf2/test_index.txt
//! nerf2/spectrum/00001.png   …                    nerf2/export.json, where the set came with one
//! ```
//! The files are kept byte for byte, and go out byte for byte: nothing is relabelled. Keyframe k is line k of `tx_pos.csv` below its heading, and
//! `spectrum/` counts from 1.

use super::checks::own_file;
use super::conventions::Conventions;
use super::file::{DatasetFile, FileRecord, RadioFrames};
use super::header::{DATASET_SCHEMA, DatasetHeader, Imported, Quantity, SplitLists, StatedSplit, from_json, generator, to_json};
use super::layout::{DATASET_JSON, stem};
use crate::finding::Finding;
use crate::keyframe::{DbRange, Modalities};
use crate::trajectory::TrajectoryPose;
use crate::{Error, Pinhole, Raster, Result, Rigid3, bounds, io};
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Version of `dataset.json` of this kind.
pub const FIXED_ARRAY_SCHEMA: &str = "corf-fixed-array/1";
/// What `kind` says.
const KIND: &str = "fixed array, moving transmitter";
/// Folder of the files as they were published.
pub(super) const FOLDER: &str = "nerf2";
const GATEWAY: &str = "gateway_info.yml";
const PLACES: &str = "tx_pos.csv";
const LISTS: [&str; 2] = ["train_index.txt", "test_index.txt"];
const SPECTRA: &str = "spectrum";
/// What a traced set says of itself (`corf dataset export --to nerf2`).
const STATEMENT: &str = "export.json";
/// Columns and rows of a spectrum: azimuth and elevation, a degree each.
const SIZE: (usize, usize) = (360, 90);
/// A quaternion's length may be off 1 by so much.
const ROUNDED: f64 = 1e-3;
/// The range of levels as [`DbRange`] knows one: in memory a level l of 0 to 1 is the power 10^(l/10), so that its place in the range is l. No file
/// and no metric in decibels has it.
pub(super) const LEVELS: DbRange = DbRange { min_db: 0.0, max_db: 1.0 };

/// The array, and the pixels of its spectra.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedArray {
    /// Where it stands, metres in the room's frame.
    pub position_m: [f64; 3],
    /// Rotation from its own frame to the room's: quaternion x, y, z, w.
    pub orientation_xyzw: [f64; 4],
    /// Columns of a spectrum: azimuth 1 to 360 degrees from the array's x to its y.
    pub azimuths: usize,
    /// Rows: elevation 1 to 90 degrees above the array's x–y plane, the lowest at the top.
    pub elevations: usize,
}

impl FixedArray {
    /// The directions of a spectrum's pixels in the room's frame, unit vectors.
    pub fn directions(&self) -> Raster<DVec3> {
        let [x, y, z, w] = self.orientation_xyzw;
        let room_from_array = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        Raster::from_fn(self.azimuths, self.elevations, |column, row| {
            let [azimuth, elevation] = [column, row].map(|i| (i as f64 + 1.0).to_radians());
            room_from_array * DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
        })
    }
}

/// `dataset.json`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    schema: String,
    kind: String,
    generator: String,
    name: String,
    keyframes: usize,
    conventions: Conventions,
    array: FixedArray,
    split: SplitLists,
    files: BTreeMap<String, FileRecord>,
}

/// What the published files say.
struct Published {
    array: FixedArray,
    transmitters_m: Vec<DVec3>,
    split: SplitLists,
}

/// What an import found.
#[derive(Debug)]
pub struct ImportedArray {
    /// Keyframes.
    pub keyframes: usize,
    /// What has to be said.
    pub notes: Vec<String>,
}

/// Reads a set in the layout of NeRF² and writes it as a data set into `out`, a folder of its own.
///
/// # Errors
/// A file that is missing, or that does not say what the layout has it say; the file and what is wrong are named.
pub fn import_fixed_array<E: From<Error>>(
    source: &Path,
    out: &Path,
    name: &str,
    on_progress: &dyn Fn(usize, usize) -> std::result::Result<(), E>,
) -> std::result::Result<ImportedArray, E> {
    let Published { array, transmitters_m, split } = read_published(source)?;
    let count = transmitters_m.len();
    let mut names: Vec<String> = [GATEWAY, PLACES].into_iter().chain(LISTS).map(str::to_owned).collect();
    names.extend((0..count).map(spectrum_name));
    names.extend(source.join(STATEMENT).exists().then(|| STATEMENT.to_owned()));
    let mut files = BTreeMap::new();
    for (done, name) in names.iter().enumerate() {
        let bytes = io::read(source.join(name))?;
        if name.ends_with(".png") {
            levels(&source.join(name))?;
        }
        let kept = format!("{FOLDER}/{name}");
        io::write_atomic(out.join(&kept), &bytes)?;
        files.insert(kept, FileRecord::of(&bytes));
        on_progress(done.min(count), count)?;
    }
    let statement = names.iter().any(|name| name == STATEMENT);
    let listed: BTreeSet<usize> = split.train.iter().chain(&split.test).copied().collect();
    let mut notes = Vec::new();
    if listed.len() < count {
        notes.push(format!(
            "{} of {count} spectra are on neither list: they take no part in the published split",
            count - listed.len()
        ));
    }
    let left = left_out(source, &names)?;
    if !left.is_empty() {
        notes.push(format!("not taken, for the layout has no such files: {}", left.join(", ")));
    }
    let file = File {
        schema: FIXED_ARRAY_SCHEMA.to_owned(),
        kind: KIND.to_owned(),
        generator: generator(),
        name: name.to_owned(),
        keyframes: count,
        conventions: conventions(statement),
        array,
        split,
        files,
    };
    io::write_atomic(out.join(DATASET_JSON), to_json(&file)?.as_bytes())?;
    Ok(ImportedArray { keyframes: count, notes })
}

/// Files of the source that are none of the layout's, by name, the first few.
fn left_out(source: &Path, names: &[String]) -> Result<Vec<String>> {
    let mut found = Vec::new();
    for folder in ["", SPECTRA] {
        let here = source.join(folder);
        for entry in std::fs::read_dir(&here).map_err(Error::io("read", &here))? {
            let entry = entry.map_err(Error::io("read", &here))?;
            let file = entry.file_name().to_string_lossy().into_owned();
            let name = if folder.is_empty() { file } else { format!("{folder}/{file}") };
            if name != SPECTRA && !names.contains(&name) {
                found.push(name);
            }
        }
    }
    found.sort();
    Ok(found)
}

fn spectrum_name(index: usize) -> String {
    format!("{SPECTRA}/{}.png", stem(index))
}

/// What a file of this kind holds, as a data set in memory with its array.
pub(super) fn open(dir: &Path, text: &str) -> Result<(DatasetFile, FixedArray)> {
    let path = dir.join(DATASET_JSON);
    let file: File = from_json(text, &path)?;
    for name in file.files.keys() {
        own_file(dir, name)?;
    }
    let Published { array, transmitters_m, split } = read_published(&dir.join(FOLDER))?;
    if (array, transmitters_m.len(), &split) != (file.array, file.keyframes, &file.split) || file.kind != KIND {
        let what = format!("its kind, array, split or number of keyframes are not those of the files in {FOLDER}/");
        return Err(Error::invalid(path.display().to_string(), what, "restore the original, or import the set again"));
    }
    let nominal =
        Pinhole { width: array.azimuths, height: array.elevations, fx: f64::NAN, fy: f64::NAN, cx: f64::NAN, cy: f64::NAN };
    let imported = Imported {
        format: FOLDER.to_owned(),
        names: (0..file.keyframes).map(spectrum_name).collect(),
        up: None,
        metres_per_unit: 1.0,
        offset_m: None,
        world_from_capture: None,
        db_range: None,
        sensor: None,
        notes: Vec::new(),
        sources: BTreeMap::new(),
    };
    let mut header = DatasetHeader::of_capture(
        file.name,
        Modalities { light: false, radio: true },
        [nominal; 2],
        (Quantity::Unknown, LEVELS.max_db - LEVELS.min_db),
        imported,
    );
    header.stated_split = Some(StatedSplit { train: split.train.clone(), test: split.test.clone() });
    header.poses = transmitters_m
        .iter()
        .enumerate()
        .map(|(index, place)| TrajectoryPose {
            index,
            time_s: 0.0,
            world_from_camera: Rigid3 { rotation: DMat3::IDENTITY, translation: *place },
        })
        .collect();
    let none = vec![None; file.keyframes];
    let dataset = DatasetFile {
        schema: DATASET_SCHEMA.to_owned(),
        generator: file.generator,
        keyframes: file.keyframes,
        conventions: file.conventions,
        db_range: Some(LEVELS),
        peak_db: None,
        radio_frames: RadioFrames { peak_db: none.clone(), share_in_frame: none, share_in_frame_summary: None },
        split,
        header,
        files: file.files,
    };
    Ok((dataset, array))
}

/// The spectrum of a keyframe as it stands in memory: see [`LEVELS`].
pub(super) fn spectrum(dir: &Path, index: usize) -> Result<Raster<f32>> {
    let path = own_file(dir, &format!("{FOLDER}/{}", spectrum_name(index)))?;
    Ok(levels(&path)?.map(|level| LEVELS.linear(f32::from(*level) / 255.0) as f32))
}

/// Findings about the files beyond their hashes.
pub(super) fn check(dir: &Path, count: usize, own: &Conventions) -> Vec<Finding> {
    let finding = |e: Error| match e {
        Error::Invalid { place, what, help } => Finding::error(place, what, help),
        other => Finding::error("", other.to_string(), "restore the file, or import the set again"),
    };
    let spectra = (0..count).filter_map(|index| spectrum(dir, index).err().map(finding));
    let statement = dir.join(FOLDER).join(STATEMENT).exists();
    let changed = (*own != conventions(statement)).then(|| {
        let place = dir.join(DATASET_JSON).display().to_string();
        Finding::error(place, "its conventions are not those of its kind", "restore it, or import the set again")
    });
    spectra.chain(changed).collect()
}

/// Levels of a grey picture of 8 bits.
fn levels(path: &Path) -> Result<Raster<u8>> {
    let place = path.display().to_string();
    let picture = io::read_png16(path)?;
    if (picture.width(), picture.height()) != SIZE {
        let what = format!("is {}x{} pixels", picture.width(), picture.height());
        return Err(Error::invalid(
            place,
            what,
            "a spectrum of this layout is 360x90: a column a degree of azimuth, a row a degree of elevation",
        ));
    }
    if picture.pixels().iter().any(|[r, g, b]| r != g || g != b || r % 257 != 0) {
        let what = "is no grey picture of 8 bits";
        return Err(Error::invalid(place, what, "a level is a grey value from 0 to 255: write the spectrum as 8-bit grey PNG"));
    }
    Ok(picture.map(|[grey, ..]| (grey / 257) as u8))
}

fn read_published(source: &Path) -> Result<Published> {
    let text = |name: &str| -> Result<String> {
        let path = source.join(name);
        if !path.is_file() {
            let help = format!(
                "the layout of NeRF\u{b2} has {GATEWAY}, {PLACES}, {}, {} and {SPECTRA}/00001.png, …",
                LISTS[0], LISTS[1]
            );
            return Err(Error::invalid(path.display().to_string(), "there is no such file", help));
        }
        io::read_text(path)
    };
    let place = |name: &str| source.join(name).display().to_string();
    let array = gateway(&text(GATEWAY)?, &place(GATEWAY))?;
    let transmitters_m = places(&text(PLACES)?, &place(PLACES))?;
    let count = transmitters_m.len();
    for index in 0..count {
        let path = source.join(spectrum_name(index));
        if !path.is_file() {
            let what = format!("there is no spectrum of line {} of {PLACES}", index + 1);
            return Err(Error::invalid(path.display().to_string(), what, "give one for every place of the transmitter"));
        }
    }
    let [train, test] = LISTS.map(|name| text(name).and_then(|text| list(&text, &place(name), count)));
    let (train, test) = (train?, test?);
    if let Some(both) = test.iter().find(|i| train.binary_search(i).is_ok()) {
        let what = format!("{} is on both lists", stem(*both));
        return Err(Error::invalid(place(LISTS[1]), what, "a spectrum is trained with or held out"));
    }
    Ok(Published { array, transmitters_m, split: SplitLists { train, test, held_out_segment: Vec::new() } })
}

/// The one gateway of a `gateway_info.yml`: `position` and `orientation`, lists in brackets.
fn gateway(text: &str, place: &str) -> Result<FixedArray> {
    let help = "give one gateway with `position: [x, y, z]` in metres and `orientation: [x, y, z, w]`, a quaternion";
    let fail = |what: String| Error::invalid(place, what, help);
    let numbers = |key: &str, count: usize| -> Result<Vec<f64>> {
        let lines: Vec<&str> = text
            .lines()
            .map(|line| line.split('#').next().unwrap_or_default().trim())
            .filter_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix(':'))
            .collect();
        let [line] = lines[..] else { return Err(fail(format!("{key} is there {} times", lines.len()))) };
        let inner = line.trim().strip_prefix('[').and_then(|l| l.strip_suffix(']'));
        let inner = inner.ok_or_else(|| fail(format!("{key} is no list in brackets on its line")))?;
        let list: Option<Vec<f64>> = inner.split(',').map(|v| v.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        list.filter(|list| list.len() == count).ok_or_else(|| fail(format!("{key} is no list of {count} numbers")))
    };
    let (p, q) = (numbers("position", 3)?, numbers("orientation", 4)?);
    let orientation_xyzw = [q[0], q[1], q[2], q[3]];
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    if (length - 1.0).abs() > ROUNDED {
        return Err(fail(format!("orientation has the length {length:.4}, and a quaternion of a rotation has 1")));
    }
    let position_m = [p[0], p[1], p[2]];
    bounds::position(place, DVec3::from(position_m))?;
    Ok(FixedArray { position_m, orientation_xyzw, azimuths: SIZE.0, elevations: SIZE.1 })
}

fn places(text: &str, place: &str) -> Result<Vec<DVec3>> {
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let heading = lines.next().map(|(_, line)| line.split(',').map(str::trim).collect::<Vec<_>>());
    if heading.as_deref() != Some(&["x", "y", "z"]) {
        return Err(Error::invalid(place, "its first line is not x,y,z", "give the heading x,y,z and a line a spectrum, metres"));
    }
    let mut places = Vec::new();
    for (number, line) in lines {
        let values: Option<Vec<f64>> = line.split(',').map(|v| v.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let here = format!("{place}:{}", number + 1);
        match values.as_deref() {
            Some(&[x, y, z]) => {
                bounds::position(&here, DVec3::new(x, y, z))?;
                places.push(DVec3::new(x, y, z));
            }
            _ => return Err(Error::invalid(here, format!("\"{line}\" is no x,y,z"), "give three numbers, metres")),
        }
    }
    if places.is_empty() {
        return Err(Error::invalid(place, "it has no places", "give a line a spectrum"));
    }
    bounds::count(place, places.len(), bounds::MAX_KEYFRAMES, "places")?;
    Ok(places)
}

/// Indices from 0, ascending, of a list of stems from 1.
fn list(text: &str, place: &str, count: usize) -> Result<Vec<usize>> {
    let mut indices = BTreeSet::new();
    for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let here = || format!("{place}:{}", number + 1);
        let stem = line.trim().trim_end_matches(".png");
        let index = stem.parse::<usize>().ok().filter(|n| (1..=count).contains(n)).map(|n| n - 1).ok_or_else(|| {
            Error::invalid(here(), format!("\"{stem}\" is none of 00001 to {count:05}"), "name spectra by their numbers, from 1")
        })?;
        if !indices.insert(index) {
            return Err(Error::invalid(here(), format!("{stem} is listed twice"), "list a spectrum once"));
        }
    }
    Ok(indices.into_iter().collect())
}

fn conventions(statement: bool) -> Conventions {
    let grey = match statement {
        true => "8-bit level; what it stands for is said in nerf2/export.json, under grey, unit and db_range",
        false => "8-bit level of the beamformed spectrum as it was published; its unit and scale are not stated",
    };
    let topics: [(&str, &[(&str, &str)]); 2] = [
        (
            "frames",
            &[
                ("room", "as published: metres; tx_pos.csv and the gateway's position are in it"),
                (
                    "array",
                    "the gateway's own frame; orientation in gateway_info.yml is the quaternion x, y, z, w that turns it into the room's",
                ),
                ("pose", "of the transmitter: a place without an attitude; the array stands still"),
            ],
        ),
        (
            "spectrum",
            &[
                ("columns", "azimuth 1 to 360 degrees from the array's x to its y, a degree a column"),
                ("rows", "elevation 1 to 90 degrees above the array's x-y plane, a degree a row, the lowest at the top"),
                ("directions", "of arrival at the array"),
                ("value", grey),
            ],
        ),
    ];
    let owned = |answers: &[(&str, &str)]| answers.iter().map(|(q, a)| ((*q).to_owned(), (*a).to_owned())).collect();
    topics.iter().map(|(topic, answers)| ((*topic).to_owned(), owned(answers))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Dataset, validate};

    const YML: &str =
        "dataset_name: s\ngateway1:\n  position: [1.0, 2.0, 0.5]\n  orientation: [0.0, 0.0, 0.70710678, 0.70710678] # z\n";

    /// A made set of six places.
    fn made(dir: &Path) {
        std::fs::create_dir_all(dir.join(SPECTRA)).unwrap();
        let put = |name: &str, text: &str| std::fs::write(dir.join(name), text).unwrap();
        put(GATEWAY, YML);
        put(PLACES, "x,y,z\n0.10,0,1\n0.2,0.0,1\n0.3,0,1\n0.4,0,1\n0.5,0,1\n0.6,0,1\n");
        put(LISTS[0], "00003\n00001\n00006\n");
        put(LISTS[1], "00002\n00005");
        for i in 0..6 {
            let png = io::encode_png8(&Raster::from_fn(360, 90, |x, y| ((x + 3 * y + 40 * i) % 256) as u8)).unwrap();
            std::fs::write(dir.join(spectrum_name(i)), png).unwrap();
        }
    }

    #[test]
    fn a_published_set_is_kept_byte_for_byte_and_means_what_it_says() {
        let folder = tempfile::tempdir().unwrap();
        let (source, out) = (folder.path().join("s"), folder.path().join("d"));
        made(&source);
        std::fs::write(source.join("README"), "x").unwrap();
        let report = import_fixed_array(&source, &out, "made", &|_, _| Ok::<(), Error>(())).unwrap();
        assert!(report.keyframes == 6 && report.notes.len() == 2 && report.notes[1].contains("README"), "{:?}", report.notes);
        for name in [GATEWAY, PLACES, LISTS[0], LISTS[1], "spectrum/00004.png"] {
            assert_eq!(std::fs::read(source.join(name)).unwrap(), std::fs::read(out.join(FOLDER).join(name)).unwrap(), "{name}");
        }
        let error = Dataset::open(&out).unwrap_err().to_string();
        assert!(error.contains("stands still") && error.contains("help"), "{error}");
        let dataset = Dataset::open_any(&out).unwrap();
        assert_eq!((dataset.train_indices(), dataset.test_indices()), (&[0, 2, 5][..], &[1, 4][..]));
        assert!(validate(&out).unwrap().is_empty());
        // A level comes back as it was.
        let keyframe = dataset.keyframe(3).unwrap();
        let spectrum = &keyframe.radio.unwrap().spectrum;
        for (x, y) in [(0, 0), (17, 80), (359, 89)] {
            let level = (255.0 * LEVELS.scalar(spectrum[(x, y)])).round() as usize;
            assert_eq!(level, (x + 3 * y + 120) % 256);
        }
        // The array is turned by a quarter about z: its x is the room's y.
        let directions = dataset.fixed_array().unwrap().directions();
        assert!(directions[(359, 0)].angle_between(DVec3::Y) < 1.001f64.to_radians());
        assert!(directions[(12, 89)].angle_between(DVec3::Z) < 1e-6);
        // What was changed is found.
        std::fs::write(out.join("nerf2/spectrum/00004.png"), b"no picture").unwrap();
        assert!(!validate(&out).unwrap().is_empty());
        std::fs::write(out.join("nerf2/test_index.txt"), "00002\n").unwrap();
        assert!(Dataset::open_any(&out).unwrap_err().to_string().contains("not those of the files"));
    }

    #[test]
    fn what_is_no_such_set_is_told_where_and_why() {
        let changes: [(&str, &str, &str); 9] = [
            (GATEWAY, "gateway1:\n  position: [1, 2]\n", "position is no list of 3"),
            (GATEWAY, "g:\n  position: [1, 2, 3]\n  orientation: [0, 0, 0, 2]\n", "length 2.0000"),
            (GATEWAY, "a:\n  position: [1, 2, 3]\nb:\n  position: [1, 2, 3]\n", "there 2 times"),
            (PLACES, "1,2,3\n", "first line is not x,y,z"),
            (PLACES, "x,y,z\n1,2\n", "is no x,y,z"),
            (PLACES, "x,y,z\n1,2,nan\n", "is no x,y,z"),
            (LISTS[0], "00001\n00007\n", "none of 00001 to 00006"),
            (LISTS[0], "00001\n00001\n", "listed twice"),
            (LISTS[1], "00001\n", "on both lists"),
        ];
        for (name, text, said) in changes {
            let folder = tempfile::tempdir().unwrap();
            let source = folder.path().join("s");
            made(&source);
            std::fs::write(source.join(name), text).unwrap();
            let error =
                import_fixed_array(&source, &folder.path().join("d"), "m", &|_, _| Ok::<(), Error>(())).unwrap_err().to_string();
            assert!(error.contains(said) && error.contains(name), "{name}: {error}");
        }
        for (bytes, said) in [
            (io::encode_png8(&Raster::filled(10, 10, 0)).unwrap(), "10x10"),
            (io::encode_png(&Raster::filled(360, 90, [1, 2, 3])).unwrap(), "no grey picture"),
        ] {
            let folder = tempfile::tempdir().unwrap();
            let source = folder.path().join("s");
            made(&source);
            std::fs::write(source.join(spectrum_name(2)), bytes).unwrap();
            let error =
                import_fixed_array(&source, &folder.path().join("d"), "m", &|_, _| Ok::<(), Error>(())).unwrap_err().to_string();
            assert!(error.contains(said) && error.contains("00003.png"), "{error}");
        }
        let folder = tempfile::tempdir().unwrap();
        made(&folder.path().join("s"));
        std::fs::remove_file(folder.path().join("s/spectrum/00006.png")).unwrap();
        let error =
            import_fixed_array(&folder.path().join("s"), &folder.path().join("d"), "m", &|_, _| Ok::<(), Error>(())).unwrap_err();
        assert!(error.to_string().contains("line 6"), "{error}");
    }
}
