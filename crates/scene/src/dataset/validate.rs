//! Replays the rules of the tools that read a dataset, and its own.

use super::beam_width::{self, Widths};
use super::checks::own_file;
use super::darkness::{self, Sight};
use super::export::Modality as Modalities;
use super::writer::STATED_RANGE_TOLERANCE_DB;
use super::{Dataset, fixed_array, layout};
use crate::finding::Finding;
use crate::{Error, Pinhole, Result, Rigid3, io};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Text files keep f64 round trips; this is far above their rounding and far below any real offset (metres, matrix elements).
const POSE_TOLERANCE: f64 = 1e-6;

/// Further changed files that a message names.
const NAMED: usize = 5;

/// Checks a dataset's folder: SHA-256 of every file, every keyframe, the dB range, and what COLMAP, transforms.json, RF-3DGS and Brush
/// readers rely on. An empty list means that all is well.
///
/// # Errors
/// Only where nothing can be said about the folder, because it is no readable dataset at all.
pub fn validate(dir: impl AsRef<Path>) -> Result<Vec<Finding>> {
    let dataset = Dataset::open_any(dir)?;
    // Nothing is read of a data set that names what is not its own.
    let foreign = dataset.file().files.keys().filter_map(|name| own_file(dataset.dir(), name).err());
    let foreign: Vec<Finding> = foreign.map(of_error).collect();
    if !foreign.is_empty() {
        return Ok(foreign);
    }
    let mut findings = check_files(&dataset)?;
    if dataset.fixed_array().is_some() {
        findings.extend(fixed_array::check(dataset.dir(), dataset.len(), dataset.conventions()));
        return Ok(findings);
    }
    let of_frames: Vec<(Vec<Finding>, Option<Seen>)> =
        (0..dataset.len()).into_par_iter().map(|i| check_keyframe(&dataset, i)).collect();
    let sights: Vec<Sight> = of_frames.iter().filter_map(|(_, seen)| Some(seen.as_ref()?.sight)).collect();
    let widths: Vec<Widths> = of_frames.iter().filter_map(|(_, seen)| seen.as_ref()?.widths).collect();
    findings.extend(of_frames.into_iter().flat_map(|(of_frame, _)| of_frame));
    findings.extend(darkness::findings(&dataset.dir().display().to_string(), &sights, dataset.header().imported.is_some()));
    findings.extend(beam_width::findings(&dataset.dir().display().to_string(), dataset.header(), &widths));
    findings.extend(dataset.far_finding());
    let file = dataset.file();
    if file.conventions != super::conventions::of(&file.header, file.db_range.as_ref()) {
        let place = dataset.dir().join(layout::DATASET_JSON).display().to_string();
        findings.push(Finding::error(
            place,
            "its conventions are not those of its header",
            "restore it, or generate the dataset again",
        ));
    }
    for Modalities { root, camera } in Modalities::all(&file.header) {
        let modality = Modality { dataset: &dataset, root: dataset.dir().join(root), camera };
        for check in [Modality::colmap, Modality::transforms, Modality::split, Modality::suffixes, Modality::nerfbaselines] {
            if let Err(e) = check(&modality, &mut findings) {
                findings.push(of_error(e));
            }
        }
    }
    Ok(findings)
}

fn of_error(e: Error) -> Finding {
    match e {
        Error::Invalid { place, what, help } => Finding::error(place, what, help),
        other => Finding::error("", other.to_string(), "restore the file, or generate the dataset again"),
    }
}

/// All files below `dir`, relative, with forward slashes, sorted.
fn files_below(dir: &Path) -> Result<Vec<String>> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(folder) = folders.pop() {
        let here = dir.join(&folder);
        for entry in std::fs::read_dir(&here).map_err(Error::io("read", &here))? {
            let entry = entry.map_err(Error::io("read", &here))?;
            let relative = folder.join(entry.file_name());
            if entry.file_type().map_err(Error::io("read", entry.path()))?.is_dir() {
                folders.push(relative);
            } else if entry.file_name() != crate::lock::FILE_NAME {
                found.push(relative.iter().map(|c| c.to_string_lossy()).collect::<Vec<_>>().join("/"));
            }
        }
    }
    found.sort();
    Ok(found)
}

impl Dataset {
    /// Checks every file that the dataset records against its SHA-256.
    ///
    /// # Errors
    /// The files that are missing or others than the recorded ones, by name.
    pub fn verify(&self) -> Result<()> {
        let changed = changed_files(self);
        let Some(first) = changed.first() else { return Ok(()) };
        let others: String = changed.iter().skip(1).take(NAMED).map(|f| format!("\n    {}: {}", f.place, f.what)).collect();
        let more = changed.len().saturating_sub(1 + NAMED);
        let more = if more > 0 { format!("\n    and {more} more") } else { String::new() };
        Err(Error::invalid(
            first.place.as_str(),
            format!("{}{others}{more}", first.what),
            "restore the original files or generate the dataset again; `corf dataset validate` lists all that is wrong",
        ))
    }
}

/// Every listed file that is not the one that was recorded, by name.
fn changed_files(dataset: &Dataset) -> Vec<Finding> {
    let listed = &dataset.file().files;
    let mut findings: Vec<Finding> = listed
        .par_iter()
        .filter_map(|(name, record)| {
            let place = dataset.dir().join(name).display().to_string();
            // A pipe would be waited for, and a link may lead to anybody's file.
            let path = match own_file(dataset.dir(), name) {
                Ok(path) => path,
                Err(e) => return Some(of_error(e)),
            };
            match std::fs::read(&path) {
                Err(e) => {
                    Some(Finding::error(place, format!("cannot be read: {e}"), "restore it, or generate the dataset again"))
                }
                Ok(bytes) if io::sha256_hex(&bytes) != record.sha256 => {
                    Some(Finding::error(place, "its SHA-256 is not the recorded one", "restore the original file"))
                }
                Ok(_) => None,
            }
        })
        .collect();
    findings.sort_by(|a, b| a.place.cmp(&b.place));
    findings
}

/// Sizes and hashes; files nobody listed.
fn check_files(dataset: &Dataset) -> Result<Vec<Finding>> {
    let listed = &dataset.file().files;
    let mut findings = changed_files(dataset);
    for name in files_below(dataset.dir())? {
        if name != layout::DATASET_JSON && !listed.contains_key(&name) {
            let temporary = name.rsplit('/').next().is_some_and(|n| io::is_temporary(n.as_ref()));
            let help = if temporary {
                "a process was killed while it wrote: `corf dataset generate ... --resume` removes it"
            } else if name.ends_with(".ply") {
                "move it out: Brush starts from the last .ply anywhere in the folder"
            } else {
                "move it out of the dataset"
            };
            findings.push(Finding::error(dataset.dir().join(&name).display().to_string(), "is not part of the dataset", help));
        }
    }
    Ok(findings)
}

/// What a keyframe shows, for findings about all of them.
struct Seen {
    sight: Sight,
    /// Widths of the strongest lobe, where there is a spectrum.
    widths: Option<Widths>,
}

/// Findings about one keyframe, and what it shows where it can be read.
fn check_keyframe(dataset: &Dataset, index: usize) -> (Vec<Finding>, Option<Seen>) {
    let keyframe = match dataset.keyframe(index) {
        Ok(keyframe) => keyframe,
        Err(e) => return (vec![of_error(e)], None),
    };
    let sight = keyframe.light.as_ref().map(Sight::of).unwrap_or_default();
    let widths = keyframe.radio.as_ref().map(|radio| beam_width::of(&radio.spectrum, &dataset.radio_camera()));
    let seen = Some(Seen { sight, widths });
    let mut findings = Vec::new();
    let mut fail = |name: String, what: &str, help: &str| {
        findings.push(Finding::error(dataset.dir().join(name).display().to_string(), what, help));
    };
    if let (Some(radio), Some(range)) = (&keyframe.radio, dataset.db_range()) {
        let peak = radio.spectrum.pixels().iter().copied().fold(0.0, f32::max);
        if peak > 0.0 && 10.0 * f64::from(peak).log10() > range.max_db + STATED_RANGE_TOLERANCE_DB {
            fail(layout::spectrum(index), "its peak is above the dataset's dB range", "generate the dataset again");
        }
        match io::read_png(dataset.dir().join(layout::radio_image(index))) {
            Err(e) => return (findings.into_iter().chain([of_error(e)]).collect(), seen),
            Ok(image) if image != range.jet_image(&radio.spectrum) => {
                fail(layout::radio_image(index), "is not the Jet image of the spectrum", "generate the dataset again");
            }
            Ok(_) => {}
        }
    }
    let objects = dataset.header().objects.len();
    if let Some(surface) = keyframe.light.as_ref().and_then(|light| light.surface.as_ref())
        && surface.pixels().iter().any(|s| *s != u32::MAX && *s as usize >= objects)
    {
        fail(layout::surface(index), "names an object that dataset.json does not list", "generate the dataset again");
    }
    if let Some(depth) = keyframe.light.as_ref().and_then(|light| light.depth_m.as_ref())
        && depth.pixels().iter().any(|d| d.is_nan() || *d < 0.0)
    {
        fail(layout::depth(index), "has a depth that is negative or no number", "generate the dataset again");
    }
    (findings, seen)
}

/// One modality's folder, as another tool sees it.
struct Modality<'a> {
    dataset: &'a Dataset,
    root: PathBuf,
    camera: Pinhole,
}

impl Modality<'_> {
    fn place(&self, name: &str) -> String {
        self.root.join(name).display().to_string()
    }

    fn names(&self) -> Vec<String> {
        (0..self.dataset.len()).map(|i| format!("{}.png", layout::stem(i))).collect()
    }

    fn same_pose(&self, index: usize, pose: &Rigid3) -> bool {
        let own = self.dataset.poses()[index].world_from_camera.to_rows();
        own.iter().flatten().zip(pose.to_rows().iter().flatten()).all(|(a, b)| (a - b).abs() <= POSE_TOLERANCE)
    }

    /// COLMAP text: one PINHOLE camera; two lines an image, the second `X Y POINT3D_ID` triples, as many as the points' tracks name; at least one
    /// point.
    fn colmap(&self, findings: &mut Vec<Finding>) -> Result<()> {
        let read = |name: &str| io::read_text(self.root.join(name));
        let lines = |text: &str| text.lines().filter(|l| !l.starts_with('#')).map(str::to_string).collect::<Vec<_>>();
        let mut fail = |name: &str, what: String| {
            findings.push(Finding::error(self.place(name), what, "restore it, or generate the dataset again"));
        };
        let cameras = lines(&read("sparse/0/cameras.txt")?);
        let c = &self.camera;
        let expected = [c.width as f64, c.height as f64, c.fx, c.fy, c.cx, c.cy];
        let fields: Vec<&str> = cameras.first().map(|l| l.split_whitespace().collect()).unwrap_or_default();
        let numbers: Vec<f64> = fields.iter().skip(2).filter_map(|f| f.parse().ok()).collect();
        let same = numbers.len() == 6 && numbers.iter().zip(expected).all(|(a, b)| (a - b).abs() <= POSE_TOLERANCE * b.abs());
        if cameras.len() != 1 || fields.len() != 8 || fields[1] != "PINHOLE" || !same {
            fail("sparse/0/cameras.txt", "is not the one PINHOLE camera of dataset.json".into());
        }

        let images = lines(&read("sparse/0/images.txt")?);
        let names = self.names();
        if images.len() != 2 * names.len() {
            fail("sparse/0/images.txt", format!("has {} lines for {} images, two each", images.len(), names.len()));
        }
        let mut observations = 0;
        for (index, pair) in images.chunks(2).take(names.len()).enumerate() {
            let fields: Vec<&str> = pair[0].split_whitespace().collect();
            let v: Vec<f64> = fields.iter().skip(1).take(7).filter_map(|f| f.parse().ok()).collect();
            let id = fields.first().and_then(|f| f.parse::<usize>().ok());
            if fields.len() != 10 || v.len() != 7 || id != Some(index + 1) || fields[8] != fields_id(&cameras) {
                fail("sparse/0/images.txt", format!("image {} is not `ID qw qx qy qz tx ty tz CAMERA NAME`", index + 1));
                continue;
            }
            let observed: Option<Vec<f64>> = pair.get(1).and_then(|l| l.split_whitespace().map(|f| f.parse().ok()).collect());
            let observed = observed.filter(|v| v.len() % 3 == 0 && v.iter().all(|x| x.is_finite()));
            if observed.is_none() {
                fail("sparse/0/images.txt", format!("image {} is not followed by a line of `X Y POINT3D_ID`", index + 1));
            }
            observations += observed.map_or(0, |v| v.len() / 3);
            let q = DQuat::from_xyzw(v[1], v[2], v[3], v[0]);
            let camera_from_world =
                Rigid3 { rotation: DMat3::from_quat(q.normalize()), translation: DVec3::new(v[4], v[5], v[6]) };
            if (q.length() - 1.0).abs() > POSE_TOLERANCE || !self.same_pose(index, &camera_from_world.inverse()) {
                fail("sparse/0/images.txt", format!("image {} has another pose than trajectory.json", index + 1));
            }
            if fields[9] != names[index] || !self.root.join("images").join(fields[9]).exists() {
                fail("sparse/0/images.txt", format!("image {} names {}, which is not its file", index + 1, fields[9]));
            }
        }

        // RF-3DGS raises without this file or without a point.
        let points = lines(&read("sparse/0/points3D.txt")?);
        let tracked: usize = points.iter().map(|l| l.split_whitespace().count().saturating_sub(8) / 2).sum();
        if tracked != observations {
            fail("sparse/0/points3D.txt", format!("its tracks name {tracked} observations and images.txt has {observations}"));
        }
        if points.is_empty() {
            fail("sparse/0/points3D.txt", "has no point".into());
        }
        let is_point = |l: &String| {
            let f: Vec<&str> = l.split_whitespace().collect();
            f.len() >= 8
                && f[1..4].iter().all(|v| v.parse::<f64>().is_ok_and(f64::is_finite))
                && f[4..7].iter().all(|v| v.parse::<u8>().is_ok())
        };
        if let Some(i) = points.iter().position(|l| !is_point(l)) {
            fail("sparse/0/points3D.txt", format!("point {} is not `ID X Y Z R G B ERROR TRACK`", i + 1));
        }
        Ok(())
    }

    /// transforms.json: intrinsics, OpenGL axes, the three lists, nothing that one of its readers rejects.
    fn transforms(&self, findings: &mut Vec<Finding>) -> Result<()> {
        let path = self.root.join("transforms.json");
        let json: serde_json::Value = super::header::from_json(&io::read_text(&path)?, &path)?;
        let mut fail = |what: String, help: &str| findings.push(Finding::error(path.display().to_string(), what, help));
        let c = &self.camera;
        let intrinsics =
            [("fl_x", c.fx), ("fl_y", c.fy), ("cx", c.cx), ("cy", c.cy), ("w", c.width as f64), ("h", c.height as f64)];
        for (key, expected) in intrinsics {
            let value = json[key].as_f64();
            if value.is_none_or(|v| (v - expected).abs() > POSE_TOLERANCE * expected.abs()) {
                fail(format!("{key} is {} instead of {expected}", json[key]), "restore it, or generate the dataset again");
            }
        }
        if json.get("camera_model").is_some() {
            fail("has camera_model".into(), "leave it out: Brush rejects PINHOLE, nerfstudio rejects PERSPECTIVE");
        }
        if json["orientation_override"] != "none" {
            fail("orientation_override is not \"none\"".into(), "the world is z-up already");
        }
        let names: Vec<String> = self.names().iter().map(|n| format!("images/{n}")).collect();
        let frames = json["frames"].as_array().map_or(&[][..], Vec::as_slice);
        if frames.len() != names.len() {
            fail(format!("has {} frames instead of {}", frames.len(), names.len()), "generate the dataset again");
        }
        for (index, (frame, name)) in frames.iter().zip(&names).enumerate() {
            if frame["file_path"] != name.as_str() || !self.root.join(name).exists() {
                fail(format!("frame {index} names {}, which is not its file", frame["file_path"]), "generate the dataset again");
            }
            let rows: Option<[[f64; 4]; 4]> = serde_json::from_value(frame["transform_matrix"].clone()).ok();
            // OpenGL camera axes back to OpenCV: y and z negated.
            let pose = rows
                .map(|rows| [0, 1, 2].map(|r| [rows[r][0], -rows[r][1], -rows[r][2], rows[r][3]]))
                .and_then(|r| Rigid3::from_rows(&[r[0], r[1], r[2], [0.0, 0.0, 0.0, 1.0]], "").ok());
            if pose.is_none_or(|p| !self.same_pose(index, &p)) {
                fail(format!("frame {index} has another pose than trajectory.json"), "generate the dataset again");
            }
        }
        let list = |key: &str| -> Option<BTreeSet<String>> {
            json[key].as_array()?.iter().map(|v| v.as_str().map(str::to_string)).collect()
        };
        let of = |indices: &[usize]| indices.iter().map(|i| names[*i].clone()).collect::<BTreeSet<String>>();
        let (train, test) = (of(self.dataset.train_indices()), of(self.dataset.test_indices()));
        for (key, expected) in [("train_filenames", &train), ("val_filenames", &test), ("test_filenames", &test)] {
            if list(key).as_ref() != Some(expected) {
                fail(
                    format!("{key} is not the split of dataset.json"),
                    "nerfstudio wants all three lists; generate the dataset again",
                );
            }
        }
        Ok(())
    }

    /// The two index files, read by stem.
    fn split(&self, findings: &mut Vec<Finding>) -> Result<()> {
        let lists = [("train_index.txt", self.dataset.train_indices()), ("test_index.txt", self.dataset.test_indices())];
        for (name, expected) in lists {
            let text = io::read_text(self.root.join(name))?;
            let stems: Vec<String> = text.lines().map(|l| l.trim().trim_end_matches(".png").to_string()).collect();
            if stems != expected.iter().map(|i| layout::stem(*i)).collect::<Vec<_>>() {
                findings.push(Finding::error(
                    self.place(name),
                    "is not the split of dataset.json",
                    "restore it, or generate the dataset again",
                ));
            }
        }
        Ok(())
    }

    /// nerfbaselines wants to be told which of the two descriptions it is to read.
    fn nerfbaselines(&self, findings: &mut Vec<Finding>) -> Result<()> {
        let path = self.root.join("nb-info.json");
        // Data sets of earlier versions have none.
        if !path.exists() {
            return Ok(());
        }
        let json: serde_json::Value = super::header::from_json(&io::read_text(&path)?, &path)?;
        if json["loader"] != "colmap" {
            findings.push(Finding::error(
                path.display().to_string(),
                "its loader is not colmap",
                "restore it, or generate the dataset again",
            ));
        }
        Ok(())
    }

    /// Brush finds an image as the smallest path that ends in its name.
    fn suffixes(&self, findings: &mut Vec<Finding>) -> Result<()> {
        let files = files_below(&self.root)?;
        for name in self.names() {
            if let Some(first) = files.iter().find(|f| f.ends_with(&name) && **f != format!("images/{name}")) {
                findings.push(Finding::error(
                    self.place(first),
                    format!("ends in {name}, the name of an image"),
                    "rename it: readers that match images by suffix would take it for the image",
                ));
            }
        }
        Ok(())
    }
}

/// The id of the first camera line.
fn fields_id(cameras: &[String]) -> &str {
    cameras.first().and_then(|l| l.split_whitespace().next()).unwrap_or("")
}
