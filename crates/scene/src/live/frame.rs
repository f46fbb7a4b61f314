//! One keyframe of a live folder: read, checked, and known by what it was read from.

use super::description::LiveDescription;
use super::{DEPTH, IMAGES, POSES, SPECTRA};
use crate::contained::{self, Reach};
use crate::io::{self, Map};
use crate::transform::ROUNDED;
use crate::{Error, Light, Pinhole, Radio, Raster, Result, Rigid3, bounds};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Excess of a spectrum over the stated range that is rounding, dB.
const TOLERANCE_DB: f64 = 1e-5;
/// Most bytes of a pose file.
const MAX_POSE_BYTES: u64 = 1 << 16;
/// Most bytes of any other file of a keyframe.
const MAX_FILE_BYTES: u64 = 1 << 30;

/// A keyframe as its files describe it.
#[derive(Clone, Debug)]
pub struct LiveFrame {
    /// Its number: rising along the trajectory, with or without gaps.
    pub number: u64,
    /// Time, seconds, if its pose file says one.
    pub time_s: Option<f64>,
    /// Pose (OpenCV camera axes).
    pub world_from_camera: Rigid3,
    /// Distance of the rotation that was written to the nearest one, which was taken; none of a rotation to six decimals or more.
    pub rounded: Option<f64>,
    /// Its image; pixels that are not wholly opaque do not count. Depth is 0 where there is none.
    pub light: Light,
    /// Its spectrum.
    pub radio: Radio,
    /// SHA-256 of every file it was read from, by its path below the live folder.
    pub sources: BTreeMap<String, String>,
}

/// A pose file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseFile {
    world_from_camera: [[f64; 4]; 4],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time_s: Option<f64>,
}

/// The number that a pose file's name states: digits and `.json`.
pub fn number_of(file_name: &str) -> Option<u64> {
    let stem = file_name.strip_suffix(".json")?;
    stem.bytes().all(|b| b.is_ascii_digit()).then(|| stem.parse().ok()).flatten()
}

/// The text of a pose file.
///
/// # Errors
/// A pose or a time that is not finite.
pub fn pose_text(world_from_camera: &Rigid3, time_s: Option<f64>) -> Result<String> {
    let rows = world_from_camera.to_rows();
    Rigid3::from_rows(&rows, "pose")?;
    serde_json::to_string(&PoseFile { world_from_camera: rows, time_s: time_s.filter(|t| t.is_finite()) })
        .map(|text| text + "\n")
        .map_err(|e| Error::invalid("pose", format!("cannot be written: {e}"), "report this as a defect"))
}

impl LiveFrame {
    /// Reads the keyframe whose pose file is `poses/STEM.json` of the live folder.
    ///
    /// # Errors
    /// A file that is missing, there twice, cut short or unreadable; of another size than the description says; with a pose that is no rigid
    /// transform or outside of the bounds; with a value that is no power or no depth, or a power above the stated range.
    pub fn read(dir: &Path, stem: &str, description: &LiveDescription) -> Result<Self> {
        let mut files = Files { dir, stem, sources: BTreeMap::new() };
        let number = number_of(&format!("{stem}.json"))
            .ok_or_else(|| Error::invalid(stem, "its name is no number", "name keyframes by a counter or a time stamp"))?;
        let Loaded { name, bytes, .. } =
            files.take(POSES, &["json"], MAX_POSE_BYTES)?.ok_or_else(|| files.missing(POSES, "json"))?;
        let help = "give {\"world_from_camera\": 4x4 by rows, \"time_s\": seconds}, written under another name and renamed";
        let pose: PoseFile =
            serde_json::from_slice(&bytes).map_err(|e| Error::invalid(&name, format!("is no pose: {e}"), help))?;
        let (world_from_camera, rounded) = Rigid3::nearest(&pose.world_from_camera, &name)?;
        let rounded = (rounded > ROUNDED).then_some(rounded);
        bounds::position(&name, world_from_camera.translation)?;
        if let Some([low, high]) = description.bounds_m {
            let at = world_from_camera.translation;
            if at.cmplt(DVec3::from(low)).any() || at.cmpgt(DVec3::from(high)).any() {
                let what = format!("the camera stands at {at} m, outside of bounds_m");
                return Err(Error::invalid(name, what, "check the unit (metres) and the frame of the poses"));
            }
        }

        let Loaded { path, name, bytes } =
            files.take(IMAGES, &["png", "jpg", "jpeg"], MAX_FILE_BYTES)?.ok_or_else(|| files.missing(IMAGES, "png"))?;
        let (image, mask) = io::decode_rgb_and_opacity(&bytes, path)?;
        sized(&name, &image, &description.light_camera)?;
        if mask.as_ref().is_some_and(|opaque| !opaque.pixels().contains(&true)) {
            let what = "none of its pixels is opaque, so that none counts";
            return Err(Error::invalid(name, what, "write images without an alpha channel, or opaque where a pixel counts"));
        }

        let Loaded { path, name, bytes } =
            files.take(SPECTRA, &["exr", "npy"], MAX_FILE_BYTES)?.ok_or_else(|| files.missing(SPECTRA, "exr"))?;
        let map = io::decode_map(&bytes, path, io::MapOf::Power)?;
        sized(&name, &map.values, &description.radio_camera)?;
        let spectrum = power(map, &name, description)?;

        let depth_m = match description.depth {
            true => {
                let depth = files.take(DEPTH, &["exr", "npy", "png"], MAX_FILE_BYTES)?;
                depth.map(|loaded| read_depth(&loaded, description)).transpose()?
            }
            false => None,
        };
        let time_s = pose.time_s.filter(|t| t.is_finite());
        let light = Light { image, depth_m, surface: None, mask };
        Ok(Self { number, time_s, world_from_camera, rounded, light, radio: Radio { spectrum }, sources: files.sources })
    }
}

/// A file of a keyframe.
struct Loaded {
    path: PathBuf,
    /// Its path below the live folder.
    name: String,
    bytes: Vec<u8>,
}

/// The files of a keyframe.
struct Files<'a> {
    dir: &'a Path,
    stem: &'a str,
    sources: BTreeMap<String, String>,
}

impl Files<'_> {
    /// The keyframe's one file in a folder, and its name; none where it has none.
    fn one(&self, folder: &str, endings: &[&str]) -> Result<Option<(PathBuf, String)>> {
        let names = endings.iter().map(|ending| format!("{folder}/{}.{ending}", self.stem));
        let there: Vec<String> = names.filter(|name| self.dir.join(name).symlink_metadata().is_ok()).collect();
        match there.as_slice() {
            [] => Ok(None),
            [name] => {
                let help = "files of a keyframe are regular files in the live folder";
                let path = contained::resolve(self.dir, Path::new(name), Reach::Folder, name, help)?;
                Ok(Some((path, name.clone())))
            }
            [a, b, ..] => Err(Error::invalid(a, format!("{b} is there as well"), "give one of them")),
        }
    }

    /// The same with what is in it, which is read once: its hash among the sources is of what is used, whoever replaces the file.
    fn take(&mut self, folder: &str, endings: &[&str], most_bytes: u64) -> Result<Option<Loaded>> {
        let Some((path, name)) = self.one(folder, endings)? else { return Ok(None) };
        let bytes = io::read_at_most(&path, &name, most_bytes)?;
        self.sources.insert(name.clone(), io::sha256_hex(&bytes));
        Ok(Some(Loaded { path, name, bytes }))
    }

    fn missing(&self, folder: &str, ending: &str) -> Error {
        let what = "is not there, though the pose is";
        Error::invalid(format!("{folder}/{}.{ending}", self.stem), what, "the pose file lands last: write the others before it")
    }
}

fn sized<T>(name: &str, raster: &Raster<T>, camera: &Pinhole) -> Result<()> {
    if (raster.width(), raster.height()) == (camera.width, camera.height) {
        return Ok(());
    }
    let what =
        format!("is {}x{} pixels where the camera has {}x{}", raster.width(), raster.height(), camera.width, camera.height);
    Err(Error::invalid(name, what, "all keyframes have the cameras of capture.toml"))
}

fn power(map: Map, name: &str, description: &LiveDescription) -> Result<Raster<f32>> {
    let min_db = description.db_range.min_db;
    if let (Some(floor_db), Some(words)) = (map.stored.floor_db(), map.stored.words_of_power())
        && min_db < floor_db
    {
        let what = format!("is stored in {words}; db_range begins at {min_db} dB");
        return Err(Error::invalid(name, what, "write float32, or state a range in capture.toml that the file holds"));
    }
    let spectrum = map.into_power(name, "a spectrum is linear power: finite and at least 0")?;
    let peak = spectrum.pixels().iter().copied().fold(0.0_f32, f32::max);
    let (peak_db, max_db) = (10.0 * f64::from(peak).log10(), description.db_range.max_db);
    if peak_db > max_db + TOLERANCE_DB {
        let what = format!("it reaches {peak_db:.2} dB, above the {max_db} dB at which db_range ends");
        return Err(Error::invalid(name, what, "state a range in capture.toml that holds the strongest value"));
    }
    Ok(spectrum)
}

fn read_depth(Loaded { path, name, bytes }: &Loaded, description: &LiveDescription) -> Result<Raster<f32>> {
    let map = io::decode_map(bytes, path, io::MapOf::Depth)?;
    sized(name, &map.values, &description.light_camera)?;
    map.into_depth_m(description.depth_unit_m, name, "`depth_unit_m` in capture.toml")
}

#[cfg(test)]
mod tests {
    use super::super::LIVE_SCHEMA;
    use super::*;
    use crate::dataset::Quantity;
    use crate::keyframe::DbRange;
    use std::fs;

    fn description() -> LiveDescription {
        LiveDescription {
            schema: LIVE_SCHEMA.to_owned(),
            name: "test".to_owned(),
            keyframes: None,
            quantity: Quantity::Unknown,
            spectrum: None,
            lobe_width_deg: None,
            mvdr_loading: None,
            frequency_hz: None,
            depth: true,
            depth_unit_m: None,
            bounds_m: Some([[-1.0; 3], [1.0; 3]]),
            light_camera: Pinhole::from_horizontal_fov(16, 8, 90.0),
            radio_camera: Pinhole::from_horizontal_fov(8, 4, 90.0),
            db_range: DbRange { min_db: -90.0, max_db: -20.0 },
            transmitter: None,
            receiver: None,
        }
    }

    fn write(dir: &Path) {
        let put = |name: &str, bytes: &[u8]| io::write_atomic(dir.join(name), bytes).unwrap();
        put("images/7.png", &io::encode_png(&Raster::filled(16, 8, [1, 2, 3])).unwrap());
        put("spectra/7.exr", &io::encode_exr_f32(&Raster::filled(8, 4, 1e-3), "Y").unwrap());
        put(
            "depth/7.exr",
            &io::encode_exr_f32(&Raster::from_fn(16, 8, |x, _| if x == 0 { f32::NAN } else { 2.0 }), "Z").unwrap(),
        );
        put("poses/7.json", pose_text(&Rigid3::IDENTITY, Some(0.5)).unwrap().as_bytes());
    }

    #[test]
    fn a_keyframe_is_what_its_files_say() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path());
        let frame = LiveFrame::read(dir.path(), "7", &description()).unwrap();
        assert_eq!((frame.number, frame.time_s, frame.sources.len()), (7, Some(0.5), 4));
        assert_eq!((frame.light.image[(3, 3)], frame.radio.spectrum[(1, 1)]), ([1, 2, 3], 1e-3));
        let depth = frame.light.depth_m.unwrap();
        assert_eq!((depth[(0, 0)], depth[(1, 0)]), (0.0, 2.0));
        // Depth that was not announced is not looked at.
        let frame = LiveFrame::read(dir.path(), "7", &LiveDescription { depth: false, ..description() }).unwrap();
        assert!(frame.light.depth_m.is_none() && frame.sources.len() == 3);
    }

    #[test]
    fn transparent_pixels_do_not_count_and_rounded_poses_are_the_nearest() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path());
        let counts = Raster::from_fn(16, 8, |x, _| x > 4);
        let put = |counts: &Raster<bool>| {
            let bytes = io::encode_cut_out(&Raster::filled(16, 8, [1, 2, 3]), counts).unwrap();
            io::write_atomic(dir.path().join("images/7.png"), &bytes).unwrap();
        };
        put(&counts);
        let pose = |c: f64, s: f64| format!("{{\"world_from_camera\": [[{c},-{s},0,0],[{s},{c},0,0],[0,0,1,0],[0,0,0,1]]}}");
        fs::write(dir.path().join("poses/7.json"), pose(0.878, 0.479)).unwrap();
        let frame = LiveFrame::read(dir.path(), "7", &description()).unwrap();
        assert!(frame.light.mask == Some(counts) && frame.rounded.is_some_and(|off| off < 1e-3));
        let identity = frame.world_from_camera.rotation.transpose() * frame.world_from_camera.rotation;
        assert!((identity - glam::DMat3::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 1e-14));
        fs::write(dir.path().join("poses/7.json"), pose(0.88, 0.50)).unwrap();
        assert!(LiveFrame::read(dir.path(), "7", &description()).unwrap_err().to_string().contains("3 decimals"));
        write(dir.path());
        put(&Raster::filled(16, 8, false));
        assert!(LiveFrame::read(dir.path(), "7", &description()).unwrap_err().to_string().contains("opaque"));
    }

    #[test]
    fn what_is_wrong_with_a_keyframe_is_said() {
        let exr = |w: usize, v: f32| io::encode_exr_f32(&Raster::filled(w, 4, v), "Y").unwrap();
        let far = Rigid3 { translation: DVec3::new(0.0, 5.0, 0.0), ..Rigid3::IDENTITY };
        let cases: [(&str, Option<Vec<u8>>, &str); 11] = [
            ("images/7.png", None, "lands last"),
            ("images/7.png", Some(b"\x89PNG cut".to_vec()), "7.png"),
            ("images/7.png", Some(io::encode_png(&Raster::filled(8, 8, [0; 3])).unwrap()), "8x8"),
            ("images/7.jpg", Some(vec![0]), "as well"),
            ("spectra/7.exr", Some(exr(8, f32::NAN)), "NaN"),
            ("spectra/7.exr", Some(exr(8, -1.0)), "linear power"),
            ("spectra/7.exr", Some(exr(8, 0.1)), "-10.00 dB"),
            ("spectra/7.exr", Some(exr(9, 0.001)), "9x4"),
            ("poses/7.json", Some(b"{\"world_from_camera\": [[1,0".to_vec()), "is no pose"),
            ("poses/7.json", Some(pose_text(&far, None).unwrap().into_bytes()), "bounds_m"),
            ("depth/7.exr", Some(io::encode_exr_f32(&Raster::filled(16, 8, -1.0), "Z").unwrap()), "depths are metres"),
        ];
        for (name, bytes, word) in cases {
            let dir = tempfile::tempdir().unwrap();
            write(dir.path());
            match bytes {
                Some(bytes) => fs::write(dir.path().join(name), bytes).unwrap(),
                None => fs::remove_file(dir.path().join(name)).unwrap(),
            }
            let error = LiveFrame::read(dir.path(), "7", &description()).unwrap_err().to_string();
            assert!(error.contains(word), "{name}: {error}");
        }
    }

    #[test]
    fn numbers_are_digits_and_nothing_else() {
        assert_eq!(number_of("00017.json"), Some(17));
        assert_eq!(number_of("1732728372123456789.json"), Some(1_732_728_372_123_456_789));
        for name in [".json", "17", "17.json.tmp", ".17.json", "a.json", "-1.json", "99999999999999999999.json"] {
            assert_eq!(number_of(name), None, "{name}");
        }
    }
}
