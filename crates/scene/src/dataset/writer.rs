//! Writing a dataset keyframe by keyframe, so that an interrupted run can go on where it stopped.

use super::checks::check_spectrum;
use super::conventions;
use super::darkness::{self, Sight};
use super::export::{self, ColoredPoint, Modality};
use super::file::{DatasetFile, FileRecord, RadioFrames};
use super::header::{DATASET_SCHEMA, DatasetHeader, MeanAndRange, SplitLists};
use super::header::{from_json, generator, to_json, trajectory_json};
use super::{Dataset, identity, layout, leftovers, shared_light};
use crate::finding::Finding;
use crate::keyframe::{DbRange, Light, Radio};
use crate::trajectory::TrajectoryPose;
use crate::words::counted;
use crate::{Error, Raster, Result, Rigid3, io};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// All that a dataset keeps of a keyframe beside its pose: what was seen and received, and what a configuration asks to be kept with it.
#[derive(Clone, Debug)]
pub struct KeyframeContent {
    /// What the camera saw, of infinite depth where nothing was hit (0 is written); none in a data set without light.
    pub light: Option<Light>,
    /// What the array received; none in a data set without radio.
    pub radio: Option<Radio>,
    /// What is kept besides.
    pub extras: Extras,
}

/// What may be kept of a keyframe beside what a reconstruction is given.
#[derive(Clone, Debug, Default)]
pub struct Extras {
    /// Linear radiance.
    pub linear: Option<Raster<[f32; 3]>>,
    /// Mean reflectance of what each pixel sees first.
    pub albedo: Option<Raster<[f32; 3]>>,
    /// Mean shading normal of what each pixel sees first, world frame.
    pub normals: Option<Raster<[f32; 3]>>,
    /// Spectrum over the whole sphere, in the unit of the RF camera's: linear, finite, at least 0.
    pub sphere: Option<Raster<f32>>,
    /// Share of the arriving power from directions inside the RF frame, in `[0, 1]`.
    pub share_in_frame: Option<f64>,
    /// Propagation paths, one JSON object a line.
    pub paths_jsonl: Option<String>,
}

impl Extras {
    /// The float images of three channels that are to be kept, with their names.
    fn float_images(&self) -> impl Iterator<Item = (&'static str, &Raster<[f32; 3]>)> {
        let all = [(layout::LINEAR, &self.linear), (layout::ALBEDO, &self.albedo), (layout::NORMALS, &self.normals)];
        all.into_iter().filter_map(|(name, image)| Some((name, image.as_ref()?)))
    }
}

/// A depth for a 16-bit image: whole millimetres, 0 where there is none or where it is too far to be written.
pub(crate) fn millimetres(depth_m: f32) -> u16 {
    let millimetres = (1e3 * depth_m).round();
    if millimetres <= f32::from(u16::MAX) { millimetres as u16 } else { 0 }
}

/// Makes the bytes of a file.
type Encode<'a> = Box<dyn Fn() -> Result<Vec<u8>> + Send + Sync + 'a>;
/// Excess over a stated range that is rounding: a float32 power at its upper end is off by less.
pub(super) const STATED_RANGE_TOLERANCE_DB: f64 = 1e-5;

/// Record of a finished keyframe, kept until the dataset is complete.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameRecord {
    peak: f32,
    share_in_frame: Option<f64>,
    /// Whether its image is black, and its depth empty.
    black: bool,
    empty: bool,
    files: BTreeMap<String, FileRecord>,
    /// What a dataset that grows learns with the keyframe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    appended: Option<Appended>,
}

/// A keyframe of a dataset that grows, beside its content.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Appended {
    name: String,
    sources: BTreeMap<String, String>,
    time_s: f64,
    world_from_camera: [[f64; 4]; 4],
}

/// The header of a dataset in the making.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Partial {
    schema: String,
    generator: String,
    header_sha256: String,
    header: DatasetHeader,
}

/// Writes a dataset. Keyframes may come in any order and from several threads; [`DatasetWriter::finish`] makes it a whole.
#[derive(Debug)]
pub struct DatasetWriter {
    dir: PathBuf,
    header: DatasetHeader,
    finished: bool,
    /// Whether keyframes are appended, and the records of them stay until [`forget_progress`].
    grows: bool,
    /// The data set whose files are the light of every keyframe.
    light_of: Option<Dataset>,
}

/// Removes the records of a dataset's making, which one that grew keeps when it is finished: until then it can grow on.
///
/// # Errors
/// They cannot be removed.
pub fn forget_progress(dir: &Path) -> Result<()> {
    leftovers::forget_progress(dir)
}

/// What a keyframe of a dataset that grows was written as; it is read before the dataset is finished.
///
/// # Errors
/// A file that cannot be read.
pub fn grown_frame(dir: &Path, index: usize) -> Result<KeyframeContent> {
    let depth = dir.join(layout::depth(index));
    let mask = dir.join(layout::mask(index));
    Ok(KeyframeContent {
        light: Some(Light {
            image: io::read_png(dir.join(layout::image(index)))?,
            depth_m: depth.exists().then(|| io::read_exr_f32(&depth)).transpose()?,
            surface: None,
            mask: mask.exists().then(|| io::read_mask(&mask)).transpose()?,
        }),
        radio: Some(Radio { spectrum: io::read_exr_f32(dir.join(layout::spectrum(index)))? }),
        extras: Extras::default(),
    })
}

impl DatasetWriter {
    /// Starts a dataset in `dir`, or goes on with the same one there if `resume`.
    ///
    /// # Errors
    /// The folder is not empty and `resume` is false, or what is there was made from another header or by another version; or it
    /// cannot be written.
    pub fn create(dir: impl AsRef<Path>, header: &DatasetHeader, resume: bool) -> Result<Self> {
        let dir = dir.as_ref();
        if header.poses.is_empty() {
            return Err(Error::invalid(dir.display().to_string(), "a dataset without keyframes", "give at least one pose"));
        }
        std::fs::create_dir_all(dir).map_err(Error::io("create", dir))?;
        if resume {
            leftovers::remove_temporary(dir)?;
        }
        let mut entries = std::fs::read_dir(dir).map_err(Error::io("read", dir))?;
        let occupied = entries.next().transpose().map_err(Error::io("read", dir))?.is_some();
        let mut writer = Self { dir: dir.to_path_buf(), header: header.clone(), finished: false, grows: false, light_of: None };
        if occupied && !resume {
            return Err(Error::invalid(
                dir.display().to_string(),
                "the folder is not empty",
                "give a new folder, or --resume to go on with the same dataset",
            ));
        }
        let sha = header.hash()?;
        let finished = dir.join(layout::DATASET_JSON);
        let partial = dir.join(layout::PARTIAL_JSON);
        let previous = if finished.exists() {
            let file: DatasetFile = from_json(&io::read_text(&finished)?, &finished)?;
            let header =
                DatasetHeader { poses: super::header::read_trajectory(&dir.join(layout::TRAJECTORY_JSON))?, ..file.header };
            writer.finished = true;
            let sha = header.hash()?;
            Some((file.generator, sha, header))
        } else if partial.exists() {
            let file: Partial = from_json(&io::read_text(&partial)?, &partial)?;
            Some((file.generator, file.header_sha256, file.header))
        } else {
            None
        };
        match previous {
            Some((by, there, its)) if there != sha || by != generator() => return Err(identity::another(dir, &by, &its, header)),
            None if occupied => {
                return Err(Error::invalid(
                    dir.display().to_string(),
                    "the folder is not empty and holds no dataset to resume",
                    "give a new folder",
                ));
            }
            _ => {}
        }
        if !writer.finished {
            // First what --resume knows the folder by.
            let file =
                Partial { schema: DATASET_SCHEMA.into(), generator: generator(), header_sha256: sha, header: header.clone() };
            io::write_atomic(partial, to_json(&file)?.as_bytes())?;
            io::write_atomic(dir.join(layout::TRAJECTORY_JSON), trajectory_json(&header.poses)?.as_bytes())?;
        }
        Ok(writer)
    }

    /// Gives every keyframe the light of `source`, whose header [took it](DatasetHeader::take_light_of): frames are written without any.
    #[must_use]
    pub fn with_light_of(self, source: Dataset) -> Self {
        Self { light_of: Some(source), ..self }
    }

    /// Starts a dataset whose keyframes are not known yet, or goes on with one that was begun so with the same header, finished or not, behind
    /// its last keyframe that is whole: [`Self::poses`] and [`Self::names`] say which there are, and [`Self::append`] adds each as it comes.
    ///
    /// # Errors
    /// A record that is damaged, or a folder that cannot be read or written.
    pub fn growing(dir: impl AsRef<Path>, header: DatasetHeader) -> Result<Self> {
        let dir = dir.as_ref();
        std::fs::create_dir_all(dir).map_err(Error::io("create", dir))?;
        leftovers::remove_temporary(dir)?;
        let whole = dir.join(layout::DATASET_JSON);
        if whole.exists() {
            // It tells of fewer keyframes than there may be in the end.
            std::fs::remove_file(&whole).map_err(Error::io("remove", &whole))?;
        }
        let mut writer = Self { dir: dir.to_path_buf(), header, finished: false, grows: true, light_of: None };
        while dir.join(layout::progress(writer.len())).exists() {
            let index = writer.len();
            let record = writer.record(index)?;
            let Some(appended) = record.appended.clone().filter(|_| writer.present(&record)) else { break };
            let place = dir.join(layout::progress(index)).display().to_string();
            let world_from_camera = Rigid3::from_rows(&appended.world_from_camera, &place)?;
            writer.header.poses.push(TrajectoryPose { index, time_s: appended.time_s, world_from_camera });
            writer.name_last(appended);
        }
        Ok(writer)
    }

    /// Keyframes so far, or to be.
    pub fn poses(&self) -> &[TrajectoryPose] {
        &self.header.poses
    }

    /// Names of the keyframes in the capture; none in a data set that was not imported.
    pub fn names(&self) -> &[String] {
        self.header.imported.as_ref().map_or(&[], |imported| &imported.names)
    }

    fn name_last(&mut self, appended: Appended) {
        if let Some(imported) = &mut self.header.imported {
            imported.names.push(appended.name);
            imported.sources.extend(appended.sources);
        }
    }

    /// Adds the next keyframe of a dataset that grows: its name in the capture, the hashes of the files it was read from, its pose and its content.
    ///
    /// # Errors
    /// A pose of another index than the next one; those of [`Self::write_frame`].
    pub fn append(
        &mut self,
        name: String,
        sources: BTreeMap<String, String>,
        pose: TrajectoryPose,
        frame: &KeyframeContent,
    ) -> Result<()> {
        if pose.index != self.len() {
            let what = format!("it is to follow {}", counted(self.len(), "keyframe"));
            return Err(Error::invalid(format!("keyframe {}", pose.index), what, "append keyframes in order"));
        }
        self.header.poses.push(pose);
        let world_from_camera = pose.world_from_camera.to_rows();
        let appended = Appended { name, sources, time_s: pose.time_s, world_from_camera };
        if let Err(error) = self.write(pose.index, frame, Some(appended.clone())) {
            self.header.poses.pop();
            return Err(error);
        }
        self.name_last(appended);
        Ok(())
    }

    /// Number of keyframes the dataset will have.
    pub fn len(&self) -> usize {
        self.header.poses.len()
    }

    /// Whether there is none, as in a dataset that has begun to grow.
    pub fn is_empty(&self) -> bool {
        self.header.poses.is_empty()
    }

    /// Whether keyframe `index` is on disk, whole.
    pub fn is_complete(&self, index: usize) -> bool {
        self.finished || self.record(index).is_ok_and(|r| self.present(&r))
    }

    fn record(&self, index: usize) -> Result<FrameRecord> {
        let path = self.dir.join(layout::progress(index));
        from_json(&io::read_text(&path)?, &path)
    }

    /// Findings about keyframes that show nothing (a black image, a depth map without a surface), before [`DatasetWriter::finish`].
    ///
    /// # Errors
    /// A keyframe that is not there.
    pub fn dark_findings(&self) -> Result<Vec<Finding>> {
        let sight = |i: usize| self.record(i).map(|FrameRecord { black, empty, .. }| Sight { black, empty });
        let sights: Vec<Sight> = (0..self.len()).map(sight).collect::<Result<_>>()?;
        Ok(darkness::findings(&self.dir.display().to_string(), &sights, self.header.imported.is_some()))
    }

    fn present(&self, record: &FrameRecord) -> bool {
        record.files.iter().all(|(path, f)| std::fs::metadata(self.dir.join(path)).is_ok_and(|m| m.len() == f.bytes))
    }

    /// Writes keyframe `index`. It counts only once all its files are there.
    ///
    /// # Errors
    /// An index outside the trajectory, an image of the wrong size, a value that is not finite, or a file that cannot be written.
    pub fn write_frame(&self, index: usize, frame: &KeyframeContent) -> Result<()> {
        self.write(index, frame, None)
    }

    fn write(&self, index: usize, frame: &KeyframeContent, appended: Option<Appended>) -> Result<()> {
        let place = format!("keyframe {index}");
        if index >= self.len() {
            return Err(Error::invalid(
                place,
                format!("the dataset has {}", counted(self.len(), "keyframe")),
                "indices count from 0",
            ));
        }
        if self.finished {
            return Ok(());
        }
        self.check(&place, frame)?;
        let unit = self.header.quantity.unit();
        let mut contents: Vec<(String, Encode<'_>)> = Vec::new();
        let KeyframeContent { light, radio, extras } = frame;
        if let Some(light) = light {
            contents.push((layout::image(index), Box::new(|| io::encode_png(&light.image))));
        }
        for (name, image) in extras.float_images() {
            contents.push((layout::float_image(name, index), Box::new(|| io::encode_exr_rgb(image))));
        }
        if let Some(depth) = light.as_ref().and_then(|light| light.depth_m.as_ref()) {
            let seen = || depth.map(|d| if d.is_finite() { *d } else { 0.0 });
            contents.push((layout::depth(index), Box::new(move || io::encode_exr_f32(&seen(), "Z"))));
            if self.header.config.as_ref().is_some_and(|c| c.light.write_depth_png) {
                contents.push((layout::depth_png(index), Box::new(|| io::encode_png16(&depth.map(|d| millimetres(*d))))));
            }
        }
        if let Some(surface) = light.as_ref().and_then(|light| light.surface.as_ref()) {
            contents.push((layout::surface(index), Box::new(|| io::encode_exr_u32(surface))));
        }
        if let Some(mask) = light.as_ref().and_then(|light| light.mask.as_ref()) {
            contents.push((layout::mask(index), Box::new(|| io::encode_mask(mask))));
        }
        if let Some(Radio { spectrum }) = radio {
            contents.push((layout::spectrum(index), Box::new(move || io::encode_exr_f32_in(spectrum, "Y", unit))));
        }
        if let Some(sphere) = &extras.sphere {
            contents.push((layout::sphere(index), Box::new(move || io::encode_exr_f32_in(sphere, "Y", unit))));
        }
        if let Some(paths) = &extras.paths_jsonl {
            contents.push((layout::paths(index), Box::new(|| io::gzip(paths.as_bytes()))));
        }
        let files = contents.into_par_iter().map(|(path, encode)| {
            let bytes = encode()?;
            io::write_atomic(self.dir.join(&path), &bytes)?;
            Ok((path, FileRecord::of(&bytes)))
        });
        let mut files = files.collect::<Result<BTreeMap<_, _>>>()?;
        let mut sight = light.as_ref().map(Sight::of);
        if let Some(source) = &self.light_of {
            for (path, record) in source.light_files(index) {
                shared_light::share(&source.own_file(&path)?, &self.dir.join(&path), &record)?;
                files.insert(path, record);
            }
            sight = Some(Sight::of(&source.light_of(index)?));
        }
        let Sight { black, empty } = sight.unwrap_or_default();
        let record = FrameRecord {
            peak: radio.as_ref().map_or(0.0, |radio| peak(&radio.spectrum)),
            share_in_frame: extras.share_in_frame,
            black,
            empty,
            files,
            appended,
        };
        io::write_atomic(self.dir.join(layout::progress(index)), to_json(&record)?.as_bytes())
    }

    fn check(&self, place: &str, frame: &KeyframeContent) -> Result<()> {
        let (o, r) = (&self.header.light_camera, &self.header.radio_camera);
        let has = self.header.modalities;
        let KeyframeContent { light, radio, extras } = frame;
        let traced_here = has.light && self.light_of.is_none();
        for (name, given, wanted) in [("image", light.is_some(), traced_here), ("spectrum", radio.is_some(), has.radio)] {
            if given != wanted {
                let (what, help) = match wanted {
                    true => ("is missing", "give one for every keyframe"),
                    false => {
                        ("is there, and the data set is one without", "leave it out, or say in the header that there are some")
                    }
                };
                return Err(Error::invalid(format!("{place}: {name}"), what, help));
            }
        }
        let of_light = light.as_ref().map_or_else(Vec::new, |light| {
            vec![
                ("image", Some((light.image.width(), light.image.height()))),
                ("depth_m", light.depth_m.as_ref().map(|d| (d.width(), d.height()))),
                ("surface", light.surface.as_ref().map(|s| (s.width(), s.height()))),
                ("mask", light.mask.as_ref().map(|m| (m.width(), m.height()))),
            ]
        });
        let floats = extras.float_images().map(|(name, image)| (name, Some((image.width(), image.height()))));
        let seen = of_light.into_iter().chain(floats).map(|(n, s)| (n, s, (o.width, o.height)));
        let sphere = self.header.sphere.map_or((0, 0), |s| (s.width, s.height));
        let heard = [
            ("spectrum", radio.as_ref().map(|r| (r.spectrum.width(), r.spectrum.height())), (r.width, r.height)),
            ("sphere", extras.sphere.as_ref().map(|s| (s.width(), s.height())), sphere),
        ];
        for (name, size, expected) in seen.chain(heard) {
            if let Some(size) = size.filter(|s| *s != expected) {
                return Err(Error::invalid(
                    format!("{place}: {name}"),
                    format!("is {}x{} pixels where the camera has {}x{}", size.0, size.1, expected.0, expected.1),
                    "render it with the dataset's own camera",
                ));
            }
        }
        if let Some(Radio { spectrum }) = radio {
            check_spectrum(spectrum, &format!("{place}: spectrum"))?;
        }
        if let Some(sphere) = &extras.sphere {
            check_spectrum(sphere, &format!("{place}: sphere"))?;
        }
        if let Some(share) = extras.share_in_frame.filter(|s| !(0.0..=1.0).contains(s)) {
            return Err(Error::invalid(format!("{place}: share_in_frame"), format!("{share}"), "a share lies in 0 to 1"));
        }
        for (name, image) in extras.float_images() {
            if image.pixels().iter().flatten().any(|v| !v.is_finite()) {
                return Err(Error::invalid(
                    format!("{place}: {name}"),
                    "a value is not finite",
                    "this is a defect of the renderer",
                ));
            }
        }
        let depth_m = light.as_ref().and_then(|light| light.depth_m.as_ref());
        if let Some(i) = depth_m.and_then(|d| d.pixels().iter().position(|v| v.is_nan() || *v < 0.0)) {
            return Err(Error::invalid(
                format!("{place}: depth_m"),
                format!("pixel ({}, {}) is no depth", i % o.width, i / o.width),
                "depths are metres, at least 0",
            ));
        }
        Ok(())
    }

    /// Makes the dataset a whole: the one dB range, RF images, COLMAP and transforms.json files, split lists, and `dataset.json` last. One that
    /// grew can grow on ([`Self::growing`]) until [`forget_progress`].
    ///
    /// # Errors
    /// A keyframe is missing, no keyframe received any power (of what was generated nothing is kept then) or one more than a stated range has, or a
    /// file cannot be read or written.
    pub fn finish(&self) -> Result<()> {
        self.finish_with_points(&[])
    }

    /// The same, where points of the scene are known without depth: they join those that other programs are given to start from.
    ///
    /// # Errors
    /// Those of [`Self::finish`].
    pub fn finish_with_points(&self, known: &[ColoredPoint]) -> Result<()> {
        if self.finished {
            return leftovers::forget_progress(&self.dir);
        }
        let missing: Vec<usize> = (0..self.len()).filter(|i| !self.is_complete(*i)).collect();
        if let Some(first) = missing.first() {
            return Err(Error::invalid(
                self.dir.display().to_string(),
                format!("{} of {} keyframes are not there, the first is {first}", missing.len(), self.len()),
                "generate them with --resume",
            ));
        }
        let records: Vec<FrameRecord> = (0..self.len()).map(|i| self.record(i)).collect::<Result<_>>()?;
        let peak = records.iter().map(|r| r.peak).fold(0.0, f32::max);
        let range = self.range_of(peak).inspect_err(|_| {
            // Whatever is changed now makes another data set. What cannot be removed is no worse than before.
            if peak <= 0.0 && self.header.imported.is_none() {
                let _ = leftovers::discard(&self.dir, records.iter().flat_map(|r| r.files.keys()).map(String::as_str));
            }
        })?;

        let shares = records.iter().map(|r| r.share_in_frame);
        let radio_frames = RadioFrames {
            peak_db: records.iter().map(|r| (r.peak > 0.0).then(|| decibels(r.peak))).collect(),
            share_in_frame_summary: MeanAndRange::of(shares.clone().flatten()),
            share_in_frame: shares.collect(),
        };
        let mut files: BTreeMap<String, FileRecord> = BTreeMap::new();
        for record in records {
            files.extend(record.files);
        }
        let mut put = |path: String, bytes: &[u8]| -> Result<()> {
            io::write_atomic(self.dir.join(&path), bytes)?;
            files.insert(path, FileRecord::of(bytes));
            Ok(())
        };
        let spectra = range.as_ref().map(|(range, _)| range);
        let radio_images: Vec<Raster<[u8; 3]>> = match spectra {
            Some(range) => {
                (0..self.len()).into_par_iter().map(|i| Ok(range.jet_image(&self.spectrum(i)?))).collect::<Result<_>>()?
            }
            None => Vec::new(),
        };
        let encoded: Vec<Vec<u8>> = radio_images.par_iter().map(io::encode_png).collect::<Result<_>>()?;
        for (i, bytes) in encoded.iter().enumerate() {
            put(layout::radio_image(i), bytes)?;
        }
        if let Some(range) = spectra.filter(|_| self.header.config.as_ref().is_some_and(|c| c.radio.write_db)) {
            for i in 0..self.len() {
                put(layout::db(i), &io::encode_exr_f32_in(&range.db_image(&self.spectrum(i)?), "Y", "dB")?)?;
            }
        }
        let split = SplitLists::of(&self.header, self.len());
        let points = export::sample_points(&self.dir, &self.header, &split.train, &radio_images, known)?;
        for modality in Modality::all(&self.header) {
            let points = &points[usize::from(modality.root != "optical")];
            for (name, text) in export::files(&modality, &self.header.poses, &split, points, self.header.offset_m())? {
                put(format!("{}/{name}", modality.root), text.as_bytes())?;
            }
        }
        put(layout::TRAJECTORY_JSON.into(), trajectory_json(&self.header.poses)?.as_bytes())?;
        let file = DatasetFile {
            schema: DATASET_SCHEMA.into(),
            generator: generator(),
            keyframes: self.len(),
            conventions: conventions::of(&self.header, spectra),
            db_range: range.map(|(range, _)| range),
            peak_db: range.map(|(_, peak_db)| peak_db),
            radio_frames,
            split,
            header: self.header.clone(),
            files,
        };
        io::write_atomic(self.dir.join(layout::DATASET_JSON), to_json(&file)?.as_bytes())?;
        if self.grows { Ok(()) } else { leftovers::forget_progress(&self.dir) }
    }

    /// The one dB range of spectra whose largest value is `peak`, and that value in dB; none without radio.
    fn range_of(&self, peak: f32) -> Result<Option<(DbRange, f64)>> {
        if !self.header.modalities.radio {
            return Ok(None);
        }
        let place = self.dir.display().to_string();
        if peak <= 0.0 {
            let help = if self.header.imported.is_some() {
                "check the files of the spectra and the decibel range that was stated with them"
            } else {
                "check the transmitter's position (inside the room, not inside furniture) and the radio materials; nothing was kept"
            };
            return Err(Error::invalid(place, "no keyframe received any power", help));
        }
        let peak_db = decibels(peak);
        if let Some(range) = self.header.imported.as_ref().and_then(|i| i.db_range) {
            if peak_db > range.max_db + STATED_RANGE_TOLERANCE_DB {
                let what = format!("a spectrum reaches {peak_db:.2} dB, and the stated range ends at {} dB", range.max_db);
                return Err(Error::invalid(place, what, "state a range that holds the strongest value"));
            }
            return Ok(Some((range, peak_db)));
        }
        let max_db = peak_db.ceil();
        Ok(Some((DbRange { min_db: max_db - self.header.dynamic_range_db, max_db }, peak_db)))
    }

    fn spectrum(&self, index: usize) -> Result<Raster<f32>> {
        io::read_exr_f32(self.dir.join(layout::spectrum(index)))
    }
}

fn peak(spectrum: &Raster<f32>) -> f32 {
    spectrum.pixels().iter().copied().fold(0.0, f32::max)
}

fn decibels(linear: f32) -> f64 {
    10.0 * f64::from(linear).log10()
}
