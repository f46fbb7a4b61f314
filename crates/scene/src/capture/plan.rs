//! All that is decided about an import before its first pixel is written.

use super::frame::WorldFromCapture;
use super::lens::{self, Lens};
use super::names::Folder;
use super::options::{CaptureOptions, Format, Offset, RadioCamera};
use super::sensor::{Sensor, SensorOptions};
use super::spectra::{self, Encoding};
use super::{Capture, Shot, colmap, left_out, names, nerfstudio, plain, rf_3dgs, split};
use crate::dataset::{ColoredPoint, DatasetHeader, Imported, Quantity};
use crate::io::{self, Stored};
use crate::keyframe::Modalities;
use crate::trajectory::TrajectoryPose;
use crate::words::{counted, verb};
use crate::{Error, Pinhole, Result, bounds};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A capture in the world's frame, with all that belongs to each shot.
pub(super) struct Plan {
    pub shots: Vec<Shot>,
    pub points: Vec<ColoredPoint>,
    pub spectra: Option<Vec<PathBuf>>,
    pub encoding: Option<Encoding>,
    pub depths: Option<Vec<PathBuf>>,
    /// A mask for each shot that has one.
    pub masks: Vec<Option<PathBuf>>,
    pub header: DatasetHeader,
}

/// Spectra of all shots.
struct Radio {
    folder: PathBuf,
    files: Vec<PathBuf>,
    encoding: Encoding,
    camera: Pinhole,
}

/// Endings of depth maps.
const DEPTHS: &[&str] = &["exr", "npy", "png"];
/// Endings of masks.
const MASKS: &[&str] = &["png"];
/// Shorter side of the nominal camera of spectra where there are none, pixels.
const NOMINAL_PX: usize = 64;

/// Reads a layout.
fn capture(options: &CaptureOptions) -> Result<Capture> {
    let source = &options.source;
    let place = source.display().to_string();
    if !source.exists() {
        return Err(Error::invalid(place, "there is no such folder", "give the folder of a capture"));
    }
    let images = options.images.clone().unwrap_or_else(|| source.join("images"));
    let wanted = !options.without_images;
    let mut capture = match options.format {
        Format::Colmap => colmap::read(source, &images, wanted),
        Format::Nerfstudio => nerfstudio::read(source, options.images.as_deref(), wanted),
        Format::Rf3dgs => rf_3dgs::read(source, &images, wanted, options.split.is_none()),
        Format::CorfFolder => plain::read(source, &images, wanted),
        Format::Nerf2 => Err(Error::invalid(
            &place,
            "a NeRF\u{b2} set is no capture: its receiver stands still and its transmitter moves. It becomes a data set of another kind",
            "call dataset::import_fixed_array, as `corf dataset import --from nerf2` does",
        )),
    }?;
    if let Some(pair) = capture.shots.windows(2).find(|w| w[0].name == w[1].name) {
        return Err(Error::invalid(
            place,
            format!("two images are called {}", pair[0].name),
            "take one of them out of the capture",
        ));
    }
    bounds::count(&place, capture.shots.len(), bounds::MAX_KEYFRAMES, "images")?;
    if let Some(path) = capture.shots.iter().filter_map(|s| s.image.as_ref()).find(|p| !p.is_file()) {
        let help = "restore it, give the folder of the images with --images, take it out of the capture, or say --no-images";
        return Err(Error::invalid(path.display().to_string(), "the image is missing", help));
    }
    capture.notes.extend(left_out::note(&images, &capture.shots));
    one_shot_a_file(&place, "picture", &capture.shots, |shot| shot.image.as_deref())?;
    one_shot_a_file(&place, "depth map", &capture.shots, |shot| shot.depth.as_deref())?;
    Ok(capture)
}

/// Refuses a file that two shots mean: no two places look alike. (A mask may be that of all.)
fn one_shot_a_file(place: &str, what: &str, shots: &[Shot], file: impl Fn(&Shot) -> Option<&Path>) -> Result<()> {
    let files = shots.iter().filter_map(|shot| Some((shot.name.as_str(), file(shot)?)));
    let Some(([a, b], path)) = names::shared_file(files) else { return Ok(()) };
    let what = format!("images {a} and {b} both mean the {what} {}", path.display());
    let help = "give a folder that holds the files as the capture names them, folders included, or take one of the two out";
    Err(Error::invalid(place, what, help))
}

impl Plan {
    /// Reads a capture and finds, and hashes, all that belongs to it.
    ///
    /// # Errors
    /// Those of [`super::import()`].
    pub fn of(options: &CaptureOptions) -> Result<Self> {
        options.check()?;
        let Capture { mut shots, points, lists, spectra, sensor, files, mut notes } = capture(options)?;
        let light = shots.iter().all(|s| s.image.is_some());
        let radio = radio(options, spectra, &shots, &mut notes)?;
        let sensor = stated_sensor(options, sensor, radio.is_some(), &mut notes)?;
        let (light_camera, radio_camera) = match (light, &radio) {
            (true, _) => {
                let camera = light_camera(&shots, &mut notes)?;
                (camera, radio.as_ref().map_or_else(|| nominal(&camera), |r| r.camera))
            }
            (false, Some(radio)) => (radio.camera, radio.camera),
            (false, None) => {
                let what = "neither images nor spectra are to be imported";
                return Err(Error::invalid(options.source.display().to_string(), what, "give spectra with --rf DIR, or images"));
            }
        };
        let depths = depths(options, &shots, light, &mut notes)?;
        let masks = masks(options, &shots, light, &mut notes)?;
        transparency(options, &shots, &mut notes)?;
        let sources = sources(options, &files, &shots, radio.as_ref(), depths.as_deref(), &masks)?;
        let (split, stated_split) = split::of(options.split.as_ref(), lists.as_ref(), &shots)?;
        let times = times(&shots, &mut notes);
        let world = WorldFromCapture::new(options.up, options.metres_per_unit, options.offset, &shots)?;
        for shot in &mut shots {
            shot.world_from_camera = world.pose(&shot.world_from_camera, &format!("image {}", shot.name))?;
        }
        if options.up.is_none() {
            notes.push("the capture's frame was taken to be z-up (--up says otherwise)".into());
        }
        if options.metres_per_unit == 1.0 {
            notes.push("the capture's unit of length was taken for a metre (--scale says otherwise)".into());
        }
        let offset_m = (world.offset_m() != DVec3::ZERO).then(|| world.offset_m().to_array());
        if let Some([x, y, z]) = offset_m {
            let why = match options.offset {
                Some(Offset::Point(_)) => "as asked for",
                Some(Offset::Cameras) => "the middle of the cameras in steps of 100 m",
                None => "for coordinates beyond 1e6 m cannot be kept (--offset says otherwise)",
            };
            notes.push(format!(
                "({x}, {y}, {z}) m was taken off all positions: {why}; add it to come back to the capture's frame"
            ));
        }
        let imported = Imported {
            offset_m,
            format: options.format.name().into(),
            names: shots.iter().map(|s| s.name.clone()).collect(),
            up: world.up,
            metres_per_unit: options.metres_per_unit,
            world_from_capture: Some(world.similarity),
            db_range: options.radio_db.filter(|_| radio.is_some()),
            sensor: sensor.1.stated,
            notes,
            sources,
        };
        let modalities = Modalities { light, radio: radio.is_some() };
        let quantity = sensor.0.quantity.unwrap_or(Quantity::Unknown);
        let levels = (quantity, options.radio_db.map_or(options.reading().dynamic_range_db, |r| r.max_db - r.min_db));
        let header = DatasetHeader {
            frequency_hz: sensor.0.frequency_hz,
            receiver: sensor.1.receiver,
            spectrum: sensor.1.spectrum,
            split,
            stated_split,
            poses: poses(&shots, times.as_deref()),
            ..DatasetHeader::of_capture(name(options), modalities, [light_camera, radio_camera], levels, imported)
        };
        let points = points.iter().map(|p| ColoredPoint { position: world.point(p.position), ..*p }).collect();
        let (spectra, encoding) = radio.map_or((None, None), |r| (Some(r.files), Some(r.encoding)));
        Ok(Self { shots, points, spectra, encoding, depths, masks, header })
    }
}

/// The data set's name: that which was given, or the folder's.
fn name(options: &CaptureOptions) -> String {
    let folder = || Some(options.source.canonicalize().ok()?.file_name()?.to_string_lossy().into_owned());
    options.name.clone().or_else(folder).unwrap_or_else(|| "capture".into())
}

/// What only some shots have, and is therefore left out, in words; nothing where all or none have it.
fn of_some(what: &str, count: usize, shots: usize) -> Option<String> {
    let some = (1..shots).contains(&count);
    some.then(|| format!("{what} of {count} of {} was left out: the others have none", counted(shots, "image")))
}

/// Times of the shots where each has one and they rise.
fn times(shots: &[Shot], notes: &mut Vec<String>) -> Option<Vec<f64>> {
    let stated: Vec<f64> = shots.iter().filter_map(|s| s.time_s).collect();
    notes.extend(of_some("the time", stated.len(), shots.len()));
    let of_all = Some(stated).filter(|t| t.len() == shots.len())?;
    if !of_all.is_sorted() {
        notes.push("times were left out: they do not rise in the order of the images' names".into());
        return None;
    }
    Some(of_all)
}

/// Poses in order, at these times or numbered.
fn poses(shots: &[Shot], times: Option<&[f64]>) -> Vec<TrajectoryPose> {
    let pose = |(index, shot): (usize, &Shot)| TrajectoryPose {
        index,
        time_s: times.map_or(index as f64, |t| t[index]),
        world_from_camera: shot.world_from_camera,
    };
    shots.iter().enumerate().map(pose).collect()
}

/// The one camera of all images.
fn light_camera(shots: &[Shot], notes: &mut Vec<String>) -> Result<Pinhole> {
    let lenses: Vec<(&str, Lens)> = shots.iter().map(|s| (s.name.as_str(), s.lens)).collect();
    let (camera, changed) = lens::common_pinhole(&lenses)?;
    if changed {
        notes.push(format!(
            "images were resampled (bilinearly) to one pinhole without distortion, the widest without blank pixels: {}x{} pixels, fx {:.3}, fy {:.3}",
            camera.width, camera.height, camera.fx, camera.fy
        ));
    }
    Ok(camera)
}

/// A camera for spectra that nobody took: the images' view in few pixels.
fn nominal(light: &Pinhole) -> Pinhole {
    let shorter = light.width.min(light.height);
    if shorter <= NOMINAL_PX {
        return *light;
    }
    let reduced = |side: usize| (side * NOMINAL_PX).div_ceil(shorter);
    rf_3dgs::resized(light, reduced(light.width), reduced(light.height))
}

/// The spectra, where there are any, and their camera.
fn radio(options: &CaptureOptions, own: Option<PathBuf>, shots: &[Shot], notes: &mut Vec<String>) -> Result<Option<Radio>> {
    let Some(folder) = options.radio.clone().or(own) else {
        return match options.given_of_radio() {
            None => Ok(None),
            Some(flag) => Err(Error::invalid(
                flag,
                "there are no spectra that it could be of",
                "give their folder with --rf, or leave it out",
            )),
        };
    };
    let names: Vec<&str> = shots.iter().map(|s| s.name.as_str()).collect();
    let list = Folder::list(&folder, spectra::ENDINGS, "--rf")?;
    let files = list.of(&names, "spectrum")?;
    if list.len() > files.len() {
        let strange = list.len() - files.len();
        notes.push(belong_to_none(strange, "spectrum"));
    }
    let survey = options.reading().survey(&files)?;
    let (width, height) = survey.size;
    let camera = match (options.radio_camera, options.format) {
        (Some(camera), _) => camera.of(width, height)?,
        // There the model's camera is that of the spectra.
        (None, Format::Rf3dgs) => rf_3dgs::camera_of_spectra(shots, width, height)?,
        (None, _) => {
            let help = "say which way its pixels look: --rf-camera HFOV (degrees), or --rf-camera FX,FY,CX,CY (pixels)";
            return Err(Error::invalid(
                files[0].display().to_string(),
                "nothing says which field of view the spectra have",
                help,
            ));
        }
    };
    Lens::plain(camera).check("--rf-camera")?;
    if matches!(options.radio_camera, Some(RadioCamera::Intrinsics(_))) {
        bounds::in_pixels("--rf-camera", &camera)?;
    }
    if options.radio_values.is_some() && !matches!(survey.encoding, Encoding::NpyNumbers) {
        let what = "the spectra are pictures, whose values are levels in dB between the two of --rf-db";
        return Err(Error::invalid("--rf-values", what, "leave it out, or give the values themselves (EXR, .npy)"));
    }
    notes.extend(survey.notes);
    Ok(Some(Radio { folder, files, encoding: survey.encoding, camera }))
}

/// All that flags and the capture state of the sensor of its spectra, and the sensor that they make.
fn stated_sensor(
    options: &CaptureOptions,
    own: Option<SensorOptions>,
    radio: bool,
    notes: &mut Vec<String>,
) -> Result<(SensorOptions, Sensor)> {
    let own = match own {
        Some(_) if !radio => {
            notes.push("what the capture states of its spectra was left out: none are imported".into());
            SensorOptions::default()
        }
        own => own.unwrap_or_default(),
    };
    let stated = options.sensor.before(own, notes);
    let sensor = stated.sensor(&options.sensor, notes)?;
    Ok((stated, sensor))
}

/// Depth maps of all shots: those that were asked for, or the capture's own.
fn depths(options: &CaptureOptions, shots: &[Shot], light: bool, notes: &mut Vec<String>) -> Result<Option<Vec<PathBuf>>> {
    let names: Vec<&str> = shots.iter().map(|s| s.name.as_str()).collect();
    let found = match &options.depth {
        Some(folder) if light => Some(Folder::list(folder, DEPTHS, "--depth")?.of(&names, "depth map")?),
        Some(folder) => {
            let what = "depth maps are of images, and none are imported";
            return Err(Error::invalid(folder.display().to_string(), what, "leave --depth out"));
        }
        None if light => {
            notes.extend(of_some("depth", shots.iter().filter(|s| s.depth.is_some()).count(), shots.len()));
            shots.iter().map(|s| s.depth.clone()).collect()
        }
        None => None,
    };
    if found.is_none() && options.depth_unit_m.is_some() {
        let help = "give their folder with --depth, or leave it out";
        return Err(Error::invalid("--depth-unit", "there are no depth maps that it could be of", help));
    }
    if let Some(files) = &found {
        // What is wrong with one is known before anything is written.
        let look = |path: &PathBuf| {
            let map = io::read_map(path, io::MapOf::Depth)?;
            let stored = map.stored;
            map.into_depth_m(options.depth_unit_m, &path.display().to_string(), "--depth-unit").map(|_| stored)
        };
        // All, so that of several faults the first file's is told whichever is found first.
        let stored: Vec<Stored> = files.par_iter().map(look).collect::<Vec<_>>().into_iter().collect::<Result<_>>()?;
        for (kind, words) in [Stored::Half, Stored::Lossy].into_iter().filter_map(|kind| Some((kind, kind.words()?))) {
            let count = stored.iter().filter(|s| **s == kind).count();
            if count > 0 {
                notes.push(format!("{count} of {} depth maps are stored in {words}", files.len()));
            }
        }
        notes.push(match options.depth_unit_m {
            Some(unit) => format!("depth was taken for z-depth (along the optical axis), {unit} m a unit; --scale does not change it"),
            None => "depth was taken for z-depth (along the optical axis) in metres, in a PNG in millimetres (--depth-unit says otherwise), as measured; \
                     --scale does not change it"
                .into(),
        });
    }
    Ok(found)
}

/// The masks of all shots, where they have one: those that were asked for, or the capture's own.
fn masks(options: &CaptureOptions, shots: &[Shot], light: bool, notes: &mut Vec<String>) -> Result<Vec<Option<PathBuf>>> {
    let names: Vec<&str> = shots.iter().map(|s| s.name.as_str()).collect();
    let found: Vec<Option<PathBuf>> = match &options.masks {
        Some(folder) if options.ignore_masks => {
            let what = "masks are given and to be ignored";
            return Err(Error::invalid(folder.display().to_string(), what, "leave out --masks or --ignore-masks"));
        }
        Some(folder) if !light => {
            let what = "masks are of images, and none are imported";
            return Err(Error::invalid(folder.display().to_string(), what, "leave --masks out"));
        }
        Some(folder) => {
            let list = Folder::list(folder, MASKS, "--masks")?;
            let found = list.of_some(&names, "mask")?;
            let strange = list.len() - found.iter().flatten().count();
            if strange > 0 {
                notes.push(belong_to_none(strange, "mask"));
            }
            found
        }
        None => shots.iter().map(|s| s.mask.clone().filter(|_| light)).collect(),
    };
    let count = found.iter().flatten().count();
    if count == 0 {
        return Ok(found);
    }
    if options.ignore_masks {
        notes.push("masks were left out: all pixels count".into());
        return Ok(vec![None; shots.len()]);
    }
    notes.push(format!(
        "{count} of {} {} masks: pixels where they are black, or transparent, are neither learnt from nor compared",
        counted(shots.len(), "image"),
        verb(count, "has", "have")
    ));
    Ok(found)
}

/// A note of files that are there beside those of the images.
fn belong_to_none(count: usize, thing: &str) -> String {
    let (belong, were) = (verb(count, "belongs", "belong"), verb(count, "was", "were"));
    format!("{} {belong} to no image and {were} left out", counted(count, thing))
}

/// Looks for images with transparent pixels, which do not count.
///
/// # Errors
/// An image that cannot be read, or of which no pixel counts.
fn transparency(options: &CaptureOptions, shots: &[Shot], notes: &mut Vec<String>) -> Result<()> {
    let partly = |shot: &Shot| -> Result<bool> {
        let Some(path) = &shot.image else { return Ok(false) };
        if !io::may_be_transparent(&io::read(path)?) {
            return Ok(false);
        }
        let Some(opaque) = io::read_png_and_opacity(path)?.1 else { return Ok(false) };
        if !options.ignore_masks && !opaque.pixels().contains(&true) {
            let help = "write the image without an alpha channel, take it out of the capture, or let all pixels count with --ignore-masks";
            return Err(Error::invalid(path.display().to_string(), "none of its pixels is opaque, so that none counts", help));
        }
        Ok(true)
    };
    let partly: Vec<bool> = shots.par_iter().map(partly).collect::<Vec<_>>().into_iter().collect::<Result<_>>()?;
    let count = partly.iter().filter(|partly| **partly).count();
    if count > 0 {
        let all = shots.len();
        notes.push(if options.ignore_masks {
            format!(
                "the transparency of {count} of {} was left out: all pixels count, as the colour below",
                counted(all, "image")
            )
        } else {
            format!(
                "{count} of {} {} transparent pixels: those that are not wholly opaque are neither learnt from nor compared",
                counted(all, "image"),
                verb(count, "has", "have")
            )
        });
    }
    Ok(())
}

/// SHA-256 of all files that are read, by their path below the folder they were given with.
fn sources(
    options: &CaptureOptions,
    files: &[PathBuf],
    shots: &[Shot],
    radio: Option<&Radio>,
    depths: Option<&[PathBuf]>,
    masks: &[Option<PathBuf>],
) -> Result<BTreeMap<String, String>> {
    let given = [&options.images, &options.depth, &options.masks].map(Option::as_deref);
    let roots: Vec<Option<&Path>> =
        [Some(options.source.as_path()), radio.map(|r| r.folder.as_path())].into_iter().chain(given).collect();
    let images = shots.iter().filter_map(|s| s.image.as_ref());
    let radio = radio.iter().flat_map(|r| &r.files);
    let all: Vec<&PathBuf> =
        files.iter().chain(images).chain(radio).chain(depths.into_iter().flatten()).chain(masks.iter().flatten()).collect();
    let label = |path: &Path| {
        let below = roots.iter().flatten().find_map(|root| Some((root, path.strip_prefix(root).ok()?)));
        let name = |p: &Path| p.components().map(|c| c.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/");
        match below {
            Some((root, rest)) if **root == options.source => name(rest),
            // Folders that were named by themselves: by the last part of their names.
            Some((root, rest)) => format!("{}:{}", root.file_name().unwrap_or_default().to_string_lossy(), name(rest)),
            None => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        }
    };
    all.into_par_iter().map(|path| Ok((label(path), io::sha256_hex(&io::read(path)?)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rigid3;

    #[test]
    fn what_only_some_have_is_said() {
        assert_eq!(of_some("depth", 0, 4), None);
        assert_eq!(of_some("depth", 4, 4), None);
        assert_eq!(of_some("depth", 3, 4).unwrap(), "depth of 3 of 4 images was left out: the others have none");
        let lens = Lens::plain(Pinhole::from_horizontal_fov(8, 8, 90.0));
        let shot = |time_s: &Option<f64>| Shot {
            name: "a".into(),
            image: None,
            lens,
            world_from_camera: Rigid3::IDENTITY,
            depth: None,
            mask: None,
            time_s: *time_s,
        };
        let of = |stated: &[Option<f64>]| {
            let (shots, mut notes): (Vec<Shot>, _) = (stated.iter().map(shot).collect(), Vec::new());
            (times(&shots, &mut notes), notes.join(" "))
        };
        assert_eq!(of(&[Some(1.0), Some(2.5)]), (Some(vec![1.0, 2.5]), String::new()));
        assert_eq!(of(&[None, None]), (None, String::new()));
        for (stated, word) in [([Some(1.0), None], "the time of 1 of 2 images"), ([Some(2.0), Some(1.0)], "do not rise")] {
            let (times, notes) = of(&stated);
            assert!(times.is_none() && notes.contains(word), "{notes}");
        }
    }
}
