//! `corf dataset import`: a capture that others' programs made becomes a data set.

use super::super::spectrum::Kind;
use super::super::{Verdict, show};
use crate::files::separation::{Reads, is_same, keep_apart};
use crate::note;
use crate::run::claim_fresh;
use crate::terminal::interrupt;
use crate::terminal::messages;
use crate::terminal::progress::Progress;
use anyhow::Result;
use clap::{Args, ValueEnum};
use corf_scene::capture::{
    self, ArrayOptions, CaptureOptions, Format, Offset, RadioCamera, RadioValues, SensorOptions, Spacing, SplitRule, Up,
};
use corf_scene::config::{AntennaPattern, RearHalfSpace, SpectrumKind};
use corf_scene::dataset::{Dataset, Quantity, import_fixed_array};
use corf_scene::keyframe::DbRange;
use corf_scene::words::counted;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Mutex;

/// `corf dataset import`.
#[derive(Args)]
pub struct Import {
    /// Folder of the capture.
    source: PathBuf,
    /// Layout of the capture.
    #[arg(long, value_enum)]
    from: Layout,
    /// Output folder: a new data set.
    #[arg(long)]
    out: PathBuf,
    /// Name of the data set (default: that of the capture's folder).
    #[arg(long)]
    name: Option<String>,
    /// Folder of the images, where it is not the layout's own (images/): it holds them as the capture names them, folders included, or without the
    /// first folders of their names.
    #[arg(long, value_name = "DIR", conflicts_with = "no_images")]
    images: Option<PathBuf>,
    /// Leave the images out: radio alone.
    #[arg(long)]
    no_images: bool,
    /// Folder of spectra, one for every image by file stem: EXR or .npy of linear power, grey PNG of 8 or 16 bits, or Jet PNG.
    #[arg(long = "rf", value_name = "DIR")]
    radio: Option<PathBuf>,
    /// Camera of the spectra, which stands where the images' does and is turned as it: its full horizontal field of view in degrees (square pixels,
    /// axis in the middle), or FX,FY,CX,CY in pixels. rf-3dgs has one; elsewhere it must be given.
    #[arg(long = "rf-camera", value_name = "HFOV|FX,FY,CX,CY", allow_hyphen_values = true)]
    radio_camera: Option<Numbers>,
    /// Levels of the darkest and the brightest value of spectra that are pictures, dB; of others, the range that the data set is to have.
    #[arg(long = "rf-db", value_name = "MIN,MAX", allow_hyphen_values = true)]
    radio_db: Option<Numbers>,
    /// Unit of the values in EXR and .npy spectra (default: linear).
    #[arg(long = "rf-values", value_enum, value_name = "RF_VALUES")]
    radio_values: Option<Values>,
    /// Physical quantity of the spectra (default: unknown); of an unknown one no metrics of beams are computed.
    #[arg(long = "rf-quantity", value_enum, value_name = "RF_QUANTITY")]
    radio_quantity: Option<SpectrumQuantity>,
    /// Kind of the spectra: mpc (a lobe for each path), or beams of an array. Methods that know their array, such as corf-array, need it.
    #[arg(long = "rf-kind", value_enum, value_name = "RF_KIND")]
    radio_kind: Option<Kind>,
    /// Elements of the array that beams are of, ROWSxCOLUMNS, e.g. 8x8: columns along the camera's x axis, rows along its y axis.
    #[arg(long = "rf-array", value_name = "ROWSxCOLS")]
    radio_array: Option<Elements>,
    /// Distance of neighbouring elements, wavelengths: one number, or BETWEEN_COLUMNS,BETWEEN_ROWS.
    #[arg(long = "rf-spacing", value_name = "S|Y,Z")]
    radio_spacing: Option<Numbers>,
    /// Pattern of an element (default: iso).
    #[arg(long = "rf-pattern", value_enum, value_name = "RF_PATTERN")]
    radio_pattern: Option<Pattern>,
    /// What became of arrivals from behind the array (default: gated).
    #[arg(long = "rf-rear", value_enum, value_name = "RF_REAR")]
    radio_rear: Option<Rear>,
    /// Standard deviation of an mpc lobe along each axis, degrees.
    #[arg(long = "rf-lobe-width-deg", value_name = "DEG")]
    radio_lobe_width_deg: Option<f64>,
    /// Diagonal loading of mvdr spectra, in units of the covariance's mean eigenvalue.
    #[arg(long = "rf-loading", value_name = "LOADING")]
    radio_loading: Option<f64>,
    /// Carrier, Hz.
    #[arg(long)]
    frequency_hz: Option<f64>,
    /// Width of the range below the strongest value, dB, where --rf-db does not state one (default: 70).
    #[arg(long)]
    dynamic_range_db: Option<f64>,
    /// Folder of depth maps, one for every image by file stem and of its size: z-depth as EXR, .npy or 16-bit PNG.
    #[arg(long, value_name = "DIR")]
    depth: Option<PathBuf>,
    /// Unit of the depth maps, of whatever kind: m, cm, mm, um, or its size in metres. Without it floats (EXR, .npy) are metres, steps of a PNG are
    /// millimetres, and a .npy or EXR of whole numbers is refused.
    #[arg(long, value_name = "UNIT|M")]
    depth_unit: Option<LengthUnit>,
    /// Folder of masks, by file stem (or `NAME.jpg.png` for `NAME.jpg`) and of the images' size, for as many images as have one: pixels that
    /// are black or transparent are neither learnt from nor compared. Without it, the masks that the capture names.
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
    /// Direction of the capture's frame that is up, X,Y,Z, or `cameras`: the mean upward axis of all cameras. The world is turned so that it is +z.
    #[arg(long, value_name = "X,Y,Z|cameras")]
    up: Option<UpArgument>,
    /// Metres that a unit of length of the capture counts.
    #[arg(long, value_name = "M", default_value_t = 1.0)]
    scale: f64,
    /// What is taken off all positions, X,Y,Z in metres along the data set's axes (behind --up and --scale), or `auto`: the middle of the cameras in
    /// whole 100 m. For captures in coordinates of a map, which single precision holds to centimetres; the data set keeps it as imported.offset_m.
    /// Cameras beyond 1e6 m are moved by `auto` without being asked to.
    #[arg(long, value_name = "X,Y,Z|auto", allow_hyphen_values = true)]
    offset: Option<OffsetArgument>,
    /// Keyframes that are held out: N for every N-th, or a file with their stems (or their indices from 0), one a line. Default: what the capture
    /// lists, or every 8th.
    #[arg(long, value_name = "N|FILE")]
    split: Option<String>,
    /// Let all pixels count, also those that a mask of the capture leaves out, and transparent ones.
    #[arg(long)]
    ignore_masks: bool,
}

/// Layout of a capture.
#[derive(Clone, Copy, ValueEnum)]
enum Layout {
    /// COLMAP model (text or binary, in sparse/0) and images/.
    Colmap,
    /// transforms.json.
    Nerfstudio,
    /// COLMAP model, spectra in spectrum/ (or in images/, where there is none), train_index.txt and test_index.txt.
    #[value(name = "rf-3dgs")]
    Rf3dgs,
    /// NeRF²: gateway_info.yml, tx_pos.csv, spectrum/, train_index.txt and test_index.txt. Its array stands still and its transmitter moves: a data
    /// set of the second kind, kept as it is.
    Nerf2,
    /// trajectory.json, camera.json and images/: for captures of no program (docs/import.md).
    CorfFolder,
}

/// Unit of spectra that are no pictures.
#[derive(Clone, Copy, ValueEnum)]
enum Values {
    /// Linear power.
    Linear,
    /// Decibels: 10·log10 of power.
    Db,
}

/// Physical quantity of spectra.
#[derive(Clone, Copy, ValueEnum)]
enum SpectrumQuantity {
    /// Power in a unit that is not known.
    Unknown,
    /// Received power per steradian for 1 W transmitted.
    PowerPerSteradian,
    /// Output power of a beam steered at the pixel for 1 W transmitted.
    BeamPower,
    /// Capon's estimate of the power from the pixel's direction for 1 W transmitted.
    CaponPower,
}

/// Pattern of an element.
#[derive(Clone, Copy, ValueEnum)]
enum Pattern {
    /// Isotropic.
    Iso,
    /// A short dipole along the camera's y axis.
    Dipole,
    /// 3GPP TR 38.901, Table 7.3-1.
    Tr38901,
}

/// Treatment of the rear half-space.
#[derive(Clone, Copy, ValueEnum)]
enum Rear {
    /// Something shields it.
    Gated,
    /// It appears mirrored in front.
    Aliased,
}

/// Elements of an array.
#[derive(Clone, Copy)]
struct Elements {
    rows: usize,
    cols: usize,
}

impl FromStr for Elements {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides =
            text.split_once(['x', 'X']).and_then(|(rows, cols)| Some((rows.trim().parse().ok()?, cols.trim().parse().ok()?)));
        sides.map(|(rows, cols)| Self { rows, cols }).ok_or_else(|| "give ROWSxCOLUMNS, e.g. 8x8".to_owned())
    }
}

/// Numbers with commas between.
#[derive(Clone)]
struct Numbers(Vec<f64>);

impl FromStr for Numbers {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |part: &str| match part.trim().parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(format!("\"{part}\" is no finite number")),
        };
        text.split(',').map(number).collect::<Result<_, _>>().map(Self)
    }
}

/// A unit of length, metres.
#[derive(Clone, Copy)]
struct LengthUnit(f64);

impl FromStr for LengthUnit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6)];
        let metres = named
            .iter()
            .find(|(name, _)| name.eq_ignore_ascii_case(text))
            .map_or_else(|| text.parse().ok(), |(_, metres)| Some(*metres));
        metres
            .filter(|m| corf_scene::io::DEPTH_UNIT_M.contains(m))
            .map(Self)
            .ok_or_else(|| "give m, cm, mm, um, or metres from 1e-9 to 1000: 0.0002 where 5000 steps are a metre".to_owned())
    }
}

#[derive(Clone)]
struct UpArgument(Up);

impl FromStr for UpArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.eq_ignore_ascii_case("cameras") {
            return Ok(Self(Up::Cameras));
        }
        match text.parse::<Numbers>()?.0.as_slice() {
            &[x, y, z] => Ok(Self(Up::Direction([x, y, z]))),
            _ => Err("give three numbers, e.g. --up=0,-1,0 for y down, or `cameras`".to_owned()),
        }
    }
}

#[derive(Clone)]
struct OffsetArgument(Offset);

impl FromStr for OffsetArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.eq_ignore_ascii_case("auto") {
            return Ok(Self(Offset::Cameras));
        }
        match text.parse::<Numbers>()?.0.as_slice() {
            &[x, y, z] => Ok(Self(Offset::Point([x, y, z]))),
            _ => Err("give three numbers in metres, e.g. --offset 446000,5412000,0, or `auto`".to_owned()),
        }
    }
}

impl Import {
    /// Imports a set whose array stands still, as it is.
    fn fixed_array(self, json: bool) -> Result<Verdict> {
        let given = [
            ("--images", self.images.is_some()),
            ("--no-images", self.no_images),
            ("--rf", self.radio.is_some()),
            ("--rf-camera", self.radio_camera.is_some()),
            ("--rf-db", self.radio_db.is_some()),
            ("--rf-values", self.radio_values.is_some()),
            ("--rf-quantity", self.radio_quantity.is_some()),
            ("--frequency-hz", self.frequency_hz.is_some()),
            ("--dynamic-range-db", self.dynamic_range_db.is_some()),
            ("--depth", self.depth.is_some()),
            ("--depth-unit", self.depth_unit.is_some()),
            ("--masks", self.masks.is_some()),
            ("--up", self.up.is_some()),
            ("--scale", self.scale != 1.0),
            ("--offset", self.offset.is_some()),
            ("--split", self.split.is_some()),
            ("--ignore-masks", self.ignore_masks),
            ("--rf-kind", self.radio_kind.is_some()),
            ("--rf-array", self.radio_array.is_some()),
            ("--rf-spacing", self.radio_spacing.is_some()),
            ("--rf-pattern", self.radio_pattern.is_some()),
            ("--rf-rear", self.radio_rear.is_some()),
            ("--rf-lobe-width-deg", self.radio_lobe_width_deg.is_some()),
            ("--rf-loading", self.radio_loading.is_some()),
        ];
        if let Some((flag, _)) = given.iter().find(|(_, given)| *given) {
            anyhow::bail!(
                "{flag}: a set in the layout nerf2 is kept as it was published, frames, levels and lists\n  help: leave it out"
            );
        }
        keep_apart("--out", &self.out, &[Reads::Folder(&self.source)])?;
        let name = match &self.name {
            Some(name) => name.clone(),
            None => {
                let whole = std::path::absolute(&self.source)?;
                whole.file_name().map_or_else(|| "nerf2".to_owned(), |name| name.to_string_lossy().into_owned())
            }
        };
        let folder = claim_fresh(&self.out)?;
        let progress = Mutex::new(Progress::start(format!("import of {}", self.source.display()), 1, "spectra"));
        let on_progress = |done: usize, all: usize| -> Result<()> {
            if let Ok(mut progress) = progress.lock() {
                progress.set(done, all);
            }
            interrupt::check()
        };
        let imported = import_fixed_array(&self.source, folder.path(), &name, &on_progress);
        if let Ok(progress) = progress.into_inner() {
            progress.finish();
        }
        let report = imported?;
        let dataset = Dataset::open_any(folder.path())?;
        folder.finish()?;
        report.notes.iter().for_each(|line| note!("{line}"));
        let text = format!(
            "{}: {} places of the transmitter, spectra of grey levels at an array that stands still, hash {}",
            self.out.display(),
            report.keyframes,
            dataset.hash()
        );
        let about = serde_json::json!({
            "name": name,
            "keyframes": report.keyframes,
            "array": dataset.fixed_array(),
            "conventions": dataset.conventions(),
            "hash": dataset.hash(),
        });
        show(json, &about, &text)?;
        Ok(Verdict::Done)
    }

    fn options(&self) -> Result<CaptureOptions> {
        let format = match self.from {
            Layout::Colmap => Format::Colmap,
            Layout::Nerfstudio => Format::Nerfstudio,
            Layout::Rf3dgs => Format::Rf3dgs,
            Layout::Nerf2 => Format::Nerf2,
            Layout::CorfFolder => Format::CorfFolder,
        };
        let radio_camera = match self.radio_camera.as_ref().map(|n| n.0.as_slice()) {
            None => None,
            Some(&[hfov]) => Some(RadioCamera::HorizontalFovDeg(hfov)),
            Some(&[fx, fy, cx, cy]) => Some(RadioCamera::Intrinsics([fx, fy, cx, cy])),
            Some(_) => anyhow::bail!("--rf-camera takes one number or four\n  help: HFOV in degrees, or FX,FY,CX,CY in pixels"),
        };
        let radio_db = match self.radio_db.as_ref().map(|n| n.0.as_slice()) {
            None => None,
            Some(&[min_db, max_db]) if min_db < max_db => Some(DbRange { min_db, max_db }),
            Some(_) => anyhow::bail!("--rf-db takes two rising numbers\n  help: MIN,MAX in decibels, e.g. --rf-db=-110,-40"),
        };
        let split = self.split.as_ref().map(|text| match text.parse() {
            Ok(every) => SplitRule::Every(every),
            Err(_) => SplitRule::Listed(PathBuf::from(text)),
        });
        Ok(CaptureOptions {
            name: self.name.clone(),
            images: self.images.clone(),
            without_images: self.no_images,
            radio: self.radio.clone(),
            radio_camera,
            radio_db,
            radio_values: self.radio_values.map(|values| match values {
                Values::Linear => RadioValues::Linear,
                Values::Db => RadioValues::Db,
            }),
            sensor: self.sensor()?,
            dynamic_range_db: self.dynamic_range_db,
            depth: self.depth.clone(),
            masks: self.masks.clone(),
            depth_unit_m: self.depth_unit.map(|unit| unit.0),
            up: self.up.as_ref().map(|u| u.0),
            metres_per_unit: self.scale,
            offset: self.offset.as_ref().map(|o| o.0),
            split,
            ignore_masks: self.ignore_masks,
            ..CaptureOptions::new(format, &self.source)
        })
    }

    /// What is said of the sensor of the spectra.
    fn sensor(&self) -> Result<SensorOptions> {
        let spacing_wavelengths = match self.radio_spacing.as_ref().map(|n| n.0.as_slice()) {
            None => None,
            Some(&[both]) => Some(Spacing::Both(both)),
            Some(&[y, z]) => Some(Spacing::Each([y, z])),
            Some(_) => anyhow::bail!(
                "--rf-spacing takes one number or two\n  help: wavelengths between neighbours, or between columns and between rows"
            ),
        };
        Ok(SensorOptions {
            spectrum: self.radio_kind.map(SpectrumKind::from),
            receiver: ArrayOptions {
                rows: self.radio_array.map(|array| array.rows),
                cols: self.radio_array.map(|array| array.cols),
                spacing_wavelengths,
                pattern: self.radio_pattern.map(|pattern| match pattern {
                    Pattern::Iso => AntennaPattern::Iso,
                    Pattern::Dipole => AntennaPattern::Dipole,
                    Pattern::Tr38901 => AntennaPattern::Tr38901,
                }),
                rear: self.radio_rear.map(|rear| match rear {
                    Rear::Gated => RearHalfSpace::Gated,
                    Rear::Aliased => RearHalfSpace::Aliased,
                }),
            },
            lobe_width_deg: self.radio_lobe_width_deg,
            mvdr_loading: self.radio_loading,
            quantity: self.radio_quantity.map(|quantity| match quantity {
                SpectrumQuantity::Unknown => Quantity::Unknown,
                SpectrumQuantity::PowerPerSteradian => Quantity::PowerPerSteradian,
                SpectrumQuantity::BeamPower => Quantity::BeamPower,
                SpectrumQuantity::CaponPower => Quantity::CaponPower,
            }),
            frequency_hz: self.frequency_hz,
        })
    }

    /// Runs the command.
    ///
    /// # Errors
    /// A capture that cannot be read or leaves something open, an occupied output folder, an interrupt; nothing is left then.
    pub fn run(self, json: bool) -> Result<Verdict> {
        if matches!(self.from, Layout::Nerf2) {
            return self.fixed_array(json);
        }
        let options = self.options()?;
        // A new folder beside a capture's own is no fault; one that is the capture, or lies among its files, is.
        let own = ["images", "sparse", "depth", "masks"]
            .map(|name| self.source.join(name))
            .into_iter()
            .filter(|folder| folder.is_dir());
        let given = [&self.images, &self.radio, &self.depth, &self.masks].into_iter().flatten().cloned();
        let folders: Vec<_> = own.chain(given).filter(|folder| !is_same(folder, &self.source)).collect();
        let mut reads = vec![Reads::File(&self.source)];
        reads.extend(folders.iter().map(|folder| Reads::Folder(folder)));
        keep_apart("--out", &self.out, &reads)?;
        let folder = claim_fresh(&self.out)?;
        let progress = Mutex::new(Progress::start(format!("import of {}", self.source.display()), 1, "keyframes"));
        let on_progress = |done: usize, all: usize| -> Result<()> {
            if let Ok(mut progress) = progress.lock() {
                progress.set(done, all);
            }
            interrupt::check()
        };
        let imported = capture::import(&options, folder.path(), &on_progress);
        if let Ok(progress) = progress.into_inner() {
            progress.finish();
        }
        let report = imported?;
        let dataset = Dataset::open(folder.path())?;
        folder.finish()?;
        report.notes.iter().for_each(|line| note!("{line}"));
        messages::findings(report.findings);
        messages::findings(dataset.far_finding());
        let mut text = format!("{}: {}", self.out.display(), counted(dataset.len(), "keyframe"));
        text += if dataset.modalities().light { ", images" } else { ", no images" };
        text += if dataset.has_depth() {
            " with depth"
        } else {
            ", no depth (reconstruct with --set depth.prior=none or maps of your own)"
        };
        text += if dataset.has_masks() { ", masks" } else { "" };
        text += &match dataset.db_range() {
            Some(range) => format!(", spectra from {} to {} dB", range.min_db, range.max_db),
            None => ", no spectra".to_owned(),
        };
        show(json, dataset.header(), &format!("{text}, hash {}", dataset.hash()))?;
        Ok(Verdict::Done)
    }
}
