//! Reading a dataset.

use super::checks::{check_spectrum, own_file};
use super::conventions::Conventions;
use super::file::DatasetFile;
use super::fixed_array::{self, FIXED_ARRAY_SCHEMA, FixedArray};
use super::header::{DATASET_SCHEMA, DatasetHeader, Imported, MeanAndRange, from_json, read_trajectory};
use super::{foreign, layout};
use crate::keyframe::{DbRange, Light, Modalities, Radio};
use crate::trajectory::TrajectoryPose;
use crate::words::counted;
use crate::{Error, Finding, Keyframe, Pinhole, Raster, Result, Similarity3, bounds, far, io};
use std::path::{Path, PathBuf};

/// A finished dataset on disk. Keyframes are read one at a time.
#[derive(Clone, Debug)]
pub struct Dataset {
    dir: PathBuf,
    file: DatasetFile,
    hash: String,
    fixed_array: Option<FixedArray>,
}

impl Dataset {
    /// Opens a dataset's folder: `dataset.json` and `trajectory.json` are read and checked, images when they are asked for.
    ///
    /// # Errors
    /// The folder holds no finished dataset, one of another version, or a pose that is none.
    pub fn open(dir: impl AsRef<Path>) -> Result<Self> {
        let dataset = Self::open_any(dir)?;
        if dataset.fixed_array.is_some() {
            return Err(Error::invalid(
                dataset.dir.display().to_string(),
                "its array stands still and its transmitter moves: there are no cameras and no poses of a platform, which are needed here",
                "such data sets are for `corf reconstruct` and `corf bench` with nearest, inverse-distance or nerf2, `corf evaluate`, `corf dataset \
                 validate` and `corf dataset export --to nerf2`",
            ));
        }
        Ok(dataset)
    }

    /// The same for whoever knows both kinds of data sets: [`Self::fixed_array`] tells which it is.
    ///
    /// # Errors
    /// Those of [`Self::open`], but for a data set of the second kind.
    pub fn open_any(dir: impl AsRef<Path>) -> Result<Self> {
        let dir = dir.as_ref();
        let path = dir.join(layout::DATASET_JSON);
        if !path.exists() {
            let (what, help) = if dir.join(layout::PARTIAL_JSON).exists() {
                ("its generation was not finished", "go on with `corf dataset generate ... --resume`".to_owned())
            } else {
                ("there is no dataset.json in it", foreign::advice(dir))
            };
            return Err(Error::invalid(dir.display().to_string(), what, help));
        }
        let text = io::read_text(own_file(dir, layout::DATASET_JSON)?)?;
        let hash = io::sha256_hex(text.as_bytes());
        // The schema first: a file of another version should say so, not complain about its keys.
        let value: serde_json::Value = from_json(&text, &path)?;
        let schema = value.get("schema").and_then(|s| s.as_str()).unwrap_or("(none)");
        if schema == FIXED_ARRAY_SCHEMA {
            let (file, array) = fixed_array::open(dir, &text)?;
            return Ok(Self { dir: dir.to_path_buf(), file, hash, fixed_array: Some(array) });
        }
        if schema != DATASET_SCHEMA {
            return Err(Error::invalid(
                path.display().to_string(),
                format!("schema is \"{schema}\""),
                format!("this version reads \"{DATASET_SCHEMA}\"; generate the dataset again"),
            ));
        }
        let mut file: DatasetFile = from_json(&text, &path)?;
        let trajectory = dir.join(layout::TRAJECTORY_JSON);
        file.header.poses = read_trajectory(&own_file(dir, layout::TRAJECTORY_JSON)?)?;
        if file.header.poses.len() != file.keyframes {
            return Err(Error::invalid(
                trajectory.display().to_string(),
                format!("has {} where dataset.json says {}", counted(file.header.poses.len(), "keyframe"), file.keyframes),
                "the files do not belong together; restore the original or generate the dataset again",
            ));
        }
        let all = file.split.train.iter().chain(&file.split.test).chain(&file.split.held_out_segment);
        if let Some(i) = all.copied().find(|i| *i >= file.keyframes) {
            return Err(Error::invalid(
                path.display().to_string(),
                format!("the split names keyframe {i} of {}", file.keyframes),
                "indices count from 0; restore the original or generate the dataset again",
            ));
        }
        let has = file.header.modalities;
        if file.db_range.is_some() != has.radio || !(has.light || has.radio) {
            let what = "db_range and header.modalities do not agree on whether there are spectra, or there is nothing at all";
            return Err(Error::invalid(path.display().to_string(), what, "restore the original or import the capture again"));
        }
        let key = |name: &str| format!("{}, key `{name}`", path.display());
        if let Some(range) = &file.db_range {
            bounds::db_range(&key("db_range"), range)?;
        }
        for (name, camera) in [("optical_camera", &file.header.light_camera), ("rf_camera", &file.header.radio_camera)] {
            bounds::pinhole(&key(&format!("header.{name}")), camera)?;
        }
        if let Some(frequency_hz) = file.header.frequency_hz {
            bounds::number(&key("header.frequency_hz"), frequency_hz, &bounds::FREQUENCY_HZ, "Hz")?;
        }
        Ok(Self { dir: dir.to_path_buf(), file, hash, fixed_array: None })
    }

    /// The array of a data set whose array stands still and whose transmitter moves; none of one of the first kind. There a pose is the
    /// transmitter's place, without a turn, and a spectrum's value has a place in [`Self::db_range`] that is its grey level, and no decibels.
    pub fn fixed_array(&self) -> Option<&FixedArray> {
        self.fixed_array.as_ref()
    }

    /// The folder.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// The dataset's metadata.
    pub fn header(&self) -> &DatasetHeader {
        &self.file.header
    }

    /// The change from a capture's frame to this world that an import applied; none where nothing was imported.
    pub fn world_from_capture(&self) -> Option<Similarity3> {
        self.file.header.imported.as_ref().map(Imported::similarity)
    }

    /// Whether a file with this SHA-256 is one of the capture that was imported, and not one of the data set's own.
    pub fn is_of_capture(&self, sha256: &str) -> bool {
        let imported = self.file.header.imported.iter().flat_map(|imported| imported.sources.values());
        imported.into_iter().any(|hash| hash == sha256) && !self.is_own(sha256)
    }

    /// Whether a file with this SHA-256 is one of the data set's own.
    pub fn is_own(&self, sha256: &str) -> bool {
        self.file.files.values().any(|record| record.sha256 == sha256)
    }

    /// The program that wrote it, with its version.
    pub fn generator(&self) -> &str {
        &self.file.generator
    }

    /// Number of keyframes.
    pub fn len(&self) -> usize {
        self.file.keyframes
    }

    /// Whether there is no keyframe.
    pub fn is_empty(&self) -> bool {
        self.file.keyframes == 0
    }

    /// The one dB range of the dataset's spectra; none without radio.
    pub fn db_range(&self) -> Option<DbRange> {
        self.file.db_range
    }

    /// Whether there are images, and whether there are spectra.
    pub fn modalities(&self) -> Modalities {
        self.file.header.modalities
    }

    /// Whether any keyframe has a mask.
    pub fn has_masks(&self) -> bool {
        (0..self.len()).any(|i| self.file.files.contains_key(&layout::mask(i)))
    }

    /// Whether every keyframe comes with depth.
    pub fn has_depth(&self) -> bool {
        (0..self.len()).all(|i| self.file.files.contains_key(&layout::depth(i)))
    }

    /// The camera of the optical images; without light that of the spectra.
    pub fn light_camera(&self) -> Pinhole {
        self.file.header.light_camera
    }

    /// The camera of the spectra; without radio a nominal one.
    pub fn radio_camera(&self) -> Pinhole {
        self.file.header.radio_camera
    }

    /// All poses, in order.
    pub fn poses(&self) -> &[TrajectoryPose] {
        &self.file.header.poses
    }

    /// A warning where keyframes were taken so far from the origin that single precision does not hold their places.
    pub fn far_finding(&self) -> Option<Finding> {
        let largest_m = far::largest_m(self.poses().iter().map(|p| p.world_from_camera.translation));
        let help = match &self.file.header.imported {
            Some(_) => "import the capture again with --offset auto",
            None => "give the scene file an offset_m under [scene] and generate the data set again",
        };
        far::finding(&self.dir.display().to_string(), "its keyframes were taken", largest_m, help)
    }

    /// Training keyframes of the interleaved split.
    pub fn train_indices(&self) -> &[usize] {
        &self.file.split.train
    }

    /// Test keyframes of the interleaved split.
    pub fn test_indices(&self) -> &[usize] {
        &self.file.split.test
    }

    /// The contiguous segment of the second split: all other keyframes train.
    pub fn held_out_segment(&self) -> &[usize] {
        &self.file.split.held_out_segment
    }

    /// The dataset's conventions (frames, units, encodings), in words.
    pub fn conventions(&self) -> &Conventions {
        &self.file.conventions
    }

    /// Per keyframe: of the power that arrived, the share from directions inside the RF frame.
    pub fn share_in_frame(&self) -> &[Option<f64>] {
        &self.file.radio_frames.share_in_frame
    }

    /// Mean, smallest and largest of [`Dataset::share_in_frame`].
    pub fn share_in_frame_summary(&self) -> Option<MeanAndRange> {
        self.file.radio_frames.share_in_frame_summary
    }

    /// SHA-256 of `dataset.json`, which holds that of every other file.
    pub fn hash(&self) -> &str {
        &self.hash
    }

    pub(super) fn file(&self) -> &DatasetFile {
        &self.file
    }

    /// Reads keyframe `index`: what the camera saw and what the array received, as far as the dataset has them.
    ///
    /// # Errors
    /// An index outside the dataset; a file that is missing, cut short, of the wrong size, or with values that are no measurements.
    /// The message names file and keyframe.
    pub fn keyframe(&self, index: usize) -> Result<Keyframe> {
        let light = || self.modalities().light.then(|| self.light_of(index)).transpose();
        self.keyframe_with(index, light)
    }

    /// The same without what the camera saw, which is not read.
    ///
    /// # Errors
    /// Those of [`Self::keyframe`].
    pub fn heard(&self, index: usize) -> Result<Keyframe> {
        self.keyframe_with(index, || Ok(None))
    }

    fn keyframe_with(&self, index: usize, light: impl FnOnce() -> Result<Option<Light>>) -> Result<Keyframe> {
        let Some(pose) = self.poses().get(index) else {
            return Err(Error::invalid(
                format!("{}: keyframe {index}", self.dir.display()),
                format!("the dataset has {}", counted(self.len(), "keyframe")),
                "indices count from 0",
            ));
        };
        let radio = self.modalities().radio.then(|| self.radio_of(index)).transpose()?;
        let light = light()?;
        Ok(Keyframe { index, time_s: pose.time_s, world_from_camera: pose.world_from_camera, light, radio })
    }

    fn radio_of(&self, index: usize) -> Result<Radio> {
        if self.fixed_array.is_some() {
            return Ok(Radio { spectrum: fixed_array::spectrum(&self.dir, index)? });
        }
        let name = layout::spectrum(index);
        let spectrum = self.sized(index, &name, &self.radio_camera(), own_file(&self.dir, &name).and_then(io::read_exr_f32))?;
        check_spectrum(&spectrum, &format!("{}: keyframe {index}", self.dir.join(&name).display()))?;
        Ok(Radio { spectrum })
    }

    pub(super) fn light_of(&self, index: usize) -> Result<Light> {
        let has = |path: &str| self.file.files.contains_key(path);
        let (o, name) = (self.light_camera(), layout::image(index));
        let image = self.sized(index, &name, &o, own_file(&self.dir, &name).and_then(io::read_png))?;
        let (depth, surface) = (layout::depth(index), layout::surface(index));
        let depth_m = has(&depth)
            .then(|| self.sized(index, &depth, &o, own_file(&self.dir, &depth).and_then(io::read_exr_f32)))
            .transpose()?;
        // What a sensor measured may be in another unit than was thought; what was traced is in metres.
        if let (Some(depth_m), Some(_)) = (&depth_m, &self.header().imported) {
            let place = format!("{}: keyframe {index}", self.dir.join(&depth).display());
            let help = "import the capture again and say the unit of its depth with --depth-unit";
            bounds::room_depth(&place, depth_m.pixels().iter().copied(), help)?;
        }
        let surface = has(&surface)
            .then(|| self.sized(index, &surface, &o, own_file(&self.dir, &surface).and_then(io::read_exr_u32)))
            .transpose()?;
        Ok(Light { image, depth_m, surface, mask: self.mask_of(index)? })
    }

    /// The files of image, spectrum and depth of keyframe `index`, where it has them; each is its own, in the dataset's folder and regular.
    ///
    /// # Errors
    /// A file that is no regular file of the dataset.
    pub fn files_of(&self, index: usize) -> Result<[Option<PathBuf>; 3]> {
        let path = |name: String| self.file.files.contains_key(&name).then(|| own_file(&self.dir, &name)).transpose();
        Ok([path(layout::image(index))?, path(layout::spectrum(index))?, path(layout::depth(index))?])
    }

    /// Every file that dataset.json lists, all but itself: path below the folder with forward slashes, bytes, SHA-256; by path.
    pub fn listed_files(&self) -> impl Iterator<Item = (&str, u64, &str)> {
        self.file.files.iter().map(|(path, record)| (path.as_str(), record.bytes, record.sha256.as_str()))
    }

    /// A file of the dataset by its path below the folder: dataset.json or one that it lists.
    ///
    /// # Errors
    /// A file that is no regular file of the dataset.
    pub fn own_file(&self, path: &str) -> Result<PathBuf> {
        own_file(&self.dir, path)
    }

    /// Which pixels of the image of keyframe `index` count; none where all do.
    ///
    /// # Errors
    /// Those of [`Dataset::keyframe`].
    pub fn mask_of(&self, index: usize) -> Result<Option<Raster<bool>>> {
        let name = layout::mask(index);
        if !self.file.files.contains_key(&name) {
            return Ok(None);
        }
        self.sized(index, &name, &self.light_camera(), own_file(&self.dir, &name).and_then(io::read_mask)).map(Some)
    }

    /// The linear radiance of keyframe `index`, where the dataset keeps it.
    ///
    /// # Errors
    /// Those of [`Dataset::keyframe`].
    pub fn linear(&self, index: usize) -> Result<Option<Raster<[f32; 3]>>> {
        self.float_image(index, layout::LINEAR)
    }

    /// A denoiser's guides of keyframe `index`, where the dataset keeps them: the mean reflectance of what each pixel sees first, and its
    /// mean shading normal in the world frame.
    ///
    /// # Errors
    /// Those of [`Dataset::keyframe`].
    pub fn guides(&self, index: usize) -> Result<[Option<Raster<[f32; 3]>>; 2]> {
        Ok([self.float_image(index, layout::ALBEDO)?, self.float_image(index, layout::NORMALS)?])
    }

    fn float_image(&self, index: usize, name: &str) -> Result<Option<Raster<[f32; 3]>>> {
        let name = layout::float_image(name, index);
        if !self.file.files.contains_key(&name) {
            return Ok(None);
        }
        self.sized(index, &name, &self.light_camera(), own_file(&self.dir, &name).and_then(io::read_exr_rgb)).map(Some)
    }

    /// Gives a raster of the camera's size on, and names the keyframe in what went wrong otherwise.
    fn sized<T>(&self, index: usize, name: &str, camera: &Pinhole, raster: Result<Raster<T>>) -> Result<Raster<T>> {
        let place = format!("{}: keyframe {index}", self.dir.join(name).display());
        let raster = raster.map_err(|e| match e {
            Error::Invalid { what, help, .. } => Error::Invalid { place: place.clone(), what, help },
            Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                Error::invalid(place.clone(), "the file is missing", "restore it, or generate the dataset again")
            }
            other => other,
        })?;
        if (raster.width(), raster.height()) != (camera.width, camera.height) {
            return Err(Error::invalid(
                place,
                format!(
                    "is {}x{} pixels where the camera has {}x{}",
                    raster.width(),
                    raster.height(),
                    camera.width,
                    camera.height
                ),
                "the file does not belong to this dataset; restore the original or generate it again",
            ));
        }
        Ok(raster)
    }
}
