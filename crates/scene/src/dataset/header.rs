//! Metadata of a dataset: `dataset.json` and `trajectory.json`.

use crate::config::{DatasetConfig, ReceiverConfig, SceneConfig, SpectrumKind, SplitConfig, TransmitterConfig};
use crate::keyframe::{DbRange, Modalities};
use crate::model::Permittivity;
use crate::mounting::{Mount, Surfaces};
use crate::radio_spec::RadioSpec;
use crate::trajectory::TrajectoryPose;
use crate::{Equirectangular, Error, Pinhole, Result, Rigid3, Scene, Similarity3, bounds, fingerprint, io};
use glam::DVec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The version of the layout this crate writes and reads.
pub const DATASET_SCHEMA: &str = "corf-dataset/2";
/// The version of `trajectory.json`.
const TRAJECTORY_SCHEMA: &str = "corf-trajectory/1";

/// Metadata of a dataset that is known before its first keyframe is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DatasetHeader {
    /// Name, e.g. `lobby-mini`.
    pub name: String,
    /// Seed of everything drawn at random.
    pub seed: u64,
    /// Whether there are images, and whether there are spectra; nothing is written where there are both.
    #[serde(default, skip_serializing_if = "Modalities::are_both")]
    pub modalities: Modalities,
    /// Camera of `optical/`; without light that of `rf/`.
    #[serde(rename = "optical_camera")]
    pub light_camera: Pinhole,
    /// Camera of `rf/`; without radio a nominal one that took nothing.
    #[serde(rename = "rf_camera")]
    pub radio_camera: Pinhole,
    /// Image of `rf/sphere`, where it is written.
    pub sphere: Option<Equirectangular>,
    /// Exposure the images were developed with, EV, if known.
    pub exposure_ev: Option<f64>,
    /// The filter that took noise out of the images, with its version, where one did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub denoiser: Option<String>,
    /// The adapter of the GPU that traced light, where one did; the processor gives other bytes, and so does another adapter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_adapter: Option<String>,
    /// Carrier, Hz, if known.
    pub frequency_hz: Option<f64>,
    /// The fixed transmitter, if known.
    pub transmitter: Option<TransmitterConfig>,
    /// The platform's array, if known.
    pub receiver: Option<ReceiverConfig>,
    /// Antennas that are on a surface, and the side of it from which they were traced: the transmitter (no index), and keyframes by theirs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub on_surfaces: Vec<OnSurface>,
    /// Kind of the angular spectra, if known.
    pub spectrum: Option<SpectrumKind>,
    /// Physical quantity of a spectrum's values.
    pub quantity: Quantity,
    /// Width of the one dB range below the dataset's peak, dB.
    pub dynamic_range_db: f64,
    /// The range that the images of `rf-tutorial/` are clipped to, in data sets of earlier versions that have them.
    pub tutorial_range: Option<DbRange>,
    /// Radio materials in use.
    pub materials: Vec<MaterialRecord>,
    /// Standard errors from the sampling of the diffuse field, where they were measured.
    pub sampling_error: Option<SamplingError>,
    /// Training and test keyframes.
    pub split: SplitConfig,
    /// Training and test keyframes that were stated one by one; they take the place of the rule in `split`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stated_split: Option<StatedSplit>,
    /// Names by surface index.
    pub objects: Vec<String>,
    /// SHA-256 of the mesh file.
    pub scene_sha256: Option<String>,
    /// [`crate::fingerprint::of_scene`] of a scene whose mesh file names others (materials, buffers, textures): the mesh file's own hash
    /// does not say that those are the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene_content_sha256: Option<String>,
    /// The resolved dataset configuration it was generated from.
    pub config: Option<DatasetConfig>,
    /// The resolved scene configuration it was generated from.
    pub scene: Option<SceneConfig>,
    /// Source of a capture that was imported.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imported: Option<Imported>,
    /// The data set whose light this one has, where it traced none of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_from: Option<LightFrom>,
    /// The trajectory (written to `trajectory.json`).
    #[serde(skip)]
    pub poses: Vec<TrajectoryPose>,
}

/// The data set whose light another one has: images, depths and surfaces are its files, byte for byte.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightFrom {
    /// Its name.
    pub dataset: String,
    /// SHA-256 of its `dataset.json`, which holds that of every file.
    pub dataset_hash: String,
    /// The program that traced the light, with its version.
    pub generator: String,
}

/// Training and test keyframes by index, ascending.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedSplit {
    /// Those that train.
    pub train: Vec<usize>,
    /// Those that are held out.
    pub test: Vec<usize>,
}

/// Source of an imported capture, and what was done to it on the way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Imported {
    /// Layout that was read, e.g. `colmap`.
    pub format: String,
    /// Name of every keyframe's file in the capture, in the order of the keyframes.
    pub names: Vec<String>,
    /// Direction in the capture's frame that became +z; `None` where the frame was kept.
    pub up: Option<[f64; 3]>,
    /// Metres that one unit of length of the capture was taken for.
    pub metres_per_unit: f64,
    /// What was taken off all positions behind turn and scale, metres along the data set's axes; `None` where they were kept. A point of the data
    /// set and this make `metres_per_unit · R · x` of the capture's point x, where R brings `up` to +z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset_m: Option<[f64; 3]>,
    /// The whole change from the capture's frame to the world, as it was applied; none in data sets of earlier versions, and where the
    /// capture's frame is the world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_from_capture: Option<Similarity3>,
    /// The decibel range that was stated with the spectra.
    pub db_range: Option<DbRange>,
    /// What was stated of the sensor of the spectra beside [`DatasetHeader::spectrum`] and [`DatasetHeader::receiver`]; none where nothing was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<StatedSensor>,
    /// Changes and assumptions, in words.
    pub notes: Vec<String>,
    /// SHA-256 of every file that was read, by its path below the folder it was given with.
    pub sources: BTreeMap<String, String>,
}

/// A sensor that whoever recorded the spectra states: nothing in their files says it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedSensor {
    /// Flags and keys of the capture that state it, the kind of the spectra and their array included.
    pub stated_by: Vec<String>,
    /// Standard deviation of an `mpc` lobe along each axis, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lobe_width_deg: Option<f64>,
    /// Diagonal loading of `mvdr` in units of the covariance's mean eigenvalue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mvdr_loading: Option<f64>,
}

impl Imported {
    /// The change from the capture's frame to the world that was applied; of data sets of earlier versions, which did not move a capture, that of
    /// [`Self::up`] and [`Self::metres_per_unit`].
    pub fn similarity(&self) -> Similarity3 {
        self.world_from_capture.unwrap_or_else(|| Similarity3::with_up(self.up.map(DVec3::from), self.metres_per_unit))
    }
}

/// A radio material as the tracer used it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialRecord {
    /// Name in the mesh file.
    pub name: String,
    /// Source of its permittivity.
    pub source: String,
    /// Real relative permittivity at the carrier.
    pub relative_permittivity: f64,
    /// Conductivity at the carrier, S/m.
    pub conductivity_s_per_m: f64,
    /// The material's specification as configured, thickness and scattering included.
    pub spec: RadioSpec,
}

impl MaterialRecord {
    /// Every material that a triangle uses and that has radio properties, in the scene's order.
    fn all(scene: &Scene, frequency_hz: f64) -> Result<Vec<Self>> {
        let used: std::collections::BTreeSet<u32> = scene.triangles.iter().map(|t| t.material).collect();
        let in_use = scene.materials.iter().enumerate().filter(|(i, _)| used.contains(&(*i as u32)));
        in_use
            .filter_map(|(_, material)| Some((material, material.radio.as_ref()?)))
            .map(|(material, radio)| {
                let (relative_permittivity, imaginary) = radio.complex_permittivity(frequency_hz)?;
                let source = match &radio.permittivity {
                    Permittivity::Itu(name) => crate::itu::source(name, frequency_hz)?,
                    Permittivity::Constant { .. } => "constants given with the scene, at its carrier".into(),
                };
                Ok(Self {
                    name: material.name.clone(),
                    source,
                    relative_permittivity,
                    conductivity_s_per_m: imaginary
                        * std::f64::consts::TAU
                        * frequency_hz
                        * crate::itu::VACUUM_PERMITTIVITY_F_PER_M,
                    spec: RadioSpec::from(radio),
                })
            })
            .collect()
    }
}

/// An antenna of a data set that is on a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OnSurface {
    /// Index of the keyframe; none of the transmitter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keyframe: Option<usize>,
    /// Its surface and side.
    pub mount: Mount,
}

impl OnSurface {
    /// Those of a transmitter and of the platform's poses.
    fn all(scene: &Scene, transmitter: &TransmitterConfig, poses: &[TrajectoryPose]) -> Result<Vec<Self>> {
        let surfaces = Surfaces::of(scene);
        let tx = surfaces.mount("transmitter", transmitter.position(), transmitter.facing())?;
        let mut all: Vec<Self> = tx.into_iter().map(|mount| Self { keyframe: None, mount }).collect();
        for TrajectoryPose { index, world_from_camera: pose, .. } in poses {
            let whose = format!("keyframe {index}");
            let mount = surfaces.mount(&whose, pose.translation, Some(pose.transform_vector(DVec3::Z)))?;
            all.extend(mount.map(|mount| Self { keyframe: Some(*index), mount }));
        }
        Ok(all)
    }

    /// In words.
    pub fn words(&self) -> String {
        self.mount.words(&self.keyframe.map_or("the transmitter".to_owned(), |index| format!("keyframe {index}")))
    }
}

/// Standard errors of the diffuse field's sampling.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SamplingError {
    /// Keyframes at which two independent samplings were compared.
    pub keyframes: usize,
    /// Standard error of the total received power, dB.
    pub total_db: f64,
    /// Root mean square over the pixels within 30 dB of a spectrum's peak, dB.
    pub pixels_db: f64,
}

/// Physical quantity of a spectrum's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Linear received power per steradian, relative to 1 W transmitted (1/sr).
    PowerPerSteradian,
    /// Linear output power of a beam steered at the pixel, relative to 1 W transmitted.
    BeamPower,
    /// Capon's estimate of the linear power from the pixel's direction, relative to 1 W transmitted.
    CaponPower,
    /// Linear power in a unit that is not known.
    Unknown,
}

impl Quantity {
    /// The quantity that a kind of spectrum gives.
    pub fn of(kind: SpectrumKind) -> Self {
        match kind {
            SpectrumKind::Mpc => Self::PowerPerSteradian,
            SpectrumKind::Bartlett | SpectrumKind::BartlettCoherent => Self::BeamPower,
            SpectrumKind::Mvdr => Self::CaponPower,
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::PowerPerSteradian => "1/sr",
            Self::BeamPower | Self::CaponPower => "1",
            Self::Unknown => "unknown",
        }
    }
}

impl DatasetHeader {
    /// The header of a capture without its poses: what a scene alone could say is left out.
    pub(crate) fn of_capture(
        name: String,
        modalities: Modalities,
        [light_camera, radio_camera]: [Pinhole; 2],
        (quantity, dynamic_range_db): (Quantity, f64),
        imported: Imported,
    ) -> Self {
        Self {
            name,
            seed: 0,
            modalities,
            light_camera,
            radio_camera,
            sphere: None,
            exposure_ev: None,
            denoiser: None,
            light_adapter: None,
            frequency_hz: None,
            transmitter: None,
            receiver: None,
            on_surfaces: Vec::new(),
            spectrum: None,
            quantity,
            dynamic_range_db,
            tutorial_range: None,
            materials: Vec::new(),
            sampling_error: None,
            split: SplitConfig::default(),
            stated_split: None,
            objects: Vec::new(),
            scene_sha256: None,
            scene_content_sha256: None,
            config: None,
            scene: None,
            imported: Some(imported),
            light_from: None,
            poses: Vec::new(),
        }
    }

    /// The header of a dataset about to be generated; `exposure_ev` is the metered exposure, used where the configuration gives none.
    ///
    /// # Errors
    /// The scene file has no `[trajectory]`, or the mesh file cannot be read for its hash.
    pub fn from_configs(config: &DatasetConfig, scene_config: &SceneConfig, scene: &Scene, exposure_ev: f64) -> Result<Self> {
        let mesh_path = scene_config.mesh_path();
        let mesh = io::read(&mesh_path)?;
        let stands_alone = fingerprint::stands_alone(&mesh_path, &mesh);
        let (transmitter, poses) = (*config.transmitter_of(scene_config)?, config.poses(scene_config)?);
        Ok(Self {
            on_surfaces: OnSurface::all(scene, &transmitter, &poses)?,
            name: config.name.clone(),
            seed: config.seed,
            modalities: Modalities::BOTH,
            light_camera: config.light_camera(),
            radio_camera: config.radio_camera(),
            sphere: config.radio.sphere.map(|[width, height]| Equirectangular { width, height }),
            exposure_ev: Some(config.light.exposure_ev.unwrap_or(exposure_ev)),
            denoiser: None,
            light_adapter: None,
            frequency_hz: Some(scene_config.radio.frequency_hz),
            transmitter: Some(transmitter),
            receiver: Some(scene_config.receiver),
            spectrum: Some(config.radio.spectrum),
            quantity: Quantity::of(config.radio.spectrum),
            dynamic_range_db: config.radio.dynamic_range_db,
            tutorial_range: None,
            materials: MaterialRecord::all(scene, scene_config.radio.frequency_hz)?,
            sampling_error: None,
            split: config.split,
            stated_split: None,
            objects: scene.objects.iter().map(|o| o.name.clone()).collect(),
            scene_sha256: Some(io::sha256_hex(&mesh)),
            scene_content_sha256: (!stands_alone).then(|| fingerprint::of_scene(scene)),
            config: Some(config.clone()),
            scene: Some(scene_config.clone()),
            imported: None,
            light_from: None,
            poses,
        })
    }

    /// Standard deviation of an `mpc` lobe along each axis, degrees, if it is known.
    pub fn lobe_width_deg(&self) -> Option<f64> {
        let of_config = self.config.as_ref().map(|config| config.radio.lobe_width_deg);
        of_config.or_else(|| self.imported.as_ref()?.sensor.as_ref()?.lobe_width_deg)
    }

    /// Diagonal loading of `mvdr` spectra in units of the covariance's mean eigenvalue, if it is known.
    pub fn mvdr_loading(&self) -> Option<f64> {
        let of_config = self.config.as_ref().map(|config| config.radio.mvdr_loading);
        of_config.or_else(|| self.imported.as_ref()?.sensor.as_ref()?.mvdr_loading)
    }

    /// What was taken off all positions of the capture or of the scene's mesh, metres along the data set's axes; `None` where they were kept.
    pub fn offset_m(&self) -> Option<[f64; 3]> {
        let of_scene = || self.scene.as_ref()?.scene.offset_m;
        self.imported.as_ref().map_or_else(of_scene, |imported| imported.offset_m)
    }

    /// SHA-256 over header and trajectory as written: two headers with the same hash make the same dataset.
    ///
    /// # Errors
    /// A pose that is not finite.
    pub fn hash(&self) -> Result<String> {
        let text = to_json(self)? + &trajectory_json(&self.poses)?;
        Ok(io::sha256_hex(text.as_bytes()))
    }
}

/// Keyframe indices of the splits, from 0.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SplitLists {
    pub train: Vec<usize>,
    pub test: Vec<usize>,
    /// Contiguous segment of the second split.
    pub held_out_segment: Vec<usize>,
}

impl SplitLists {
    /// The lists of a data set of `count` keyframes.
    pub(super) fn of(header: &DatasetHeader, count: usize) -> Self {
        let split = &header.split;
        let (train, test) = match &header.stated_split {
            Some(stated) => (stated.train.clone(), stated.test.clone()),
            None => (split.train(count), split.test(count)),
        };
        Self { train, test, held_out_segment: split.held_out(count).collect() }
    }
}

/// Mean and range of several numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeanAndRange {
    /// Arithmetic mean.
    pub mean: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

impl MeanAndRange {
    /// `None` of no numbers.
    pub(super) fn of(values: impl Iterator<Item = f64> + Clone) -> Option<Self> {
        let count = values.clone().count();
        (count > 0).then(|| Self {
            mean: values.clone().sum::<f64>() / count as f64,
            min: values.clone().fold(f64::INFINITY, f64::min),
            max: values.fold(f64::NEG_INFINITY, f64::max),
        })
    }
}

/// Who wrote a dataset.
pub(super) fn generator() -> String {
    format!("corf {}", env!("CARGO_PKG_VERSION"))
}

#[derive(Serialize)]
struct PoseOut {
    index: usize,
    file: String,
    time_s: f64,
    world_from_camera: [[f64; 4]; 4],
}

#[derive(Serialize)]
struct TrajectoryOut {
    schema: &'static str,
    frame: &'static str,
    keyframes: Vec<PoseOut>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseIn {
    index: usize,
    #[serde(rename = "file")]
    _file: Option<String>,
    time_s: Option<f64>,
    world_from_camera: [[Option<f64>; 4]; 4],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TrajectoryIn {
    schema: String,
    #[serde(rename = "frame")]
    _frame: Option<String>,
    keyframes: Vec<PoseIn>,
}

/// Pretty JSON with a final newline.
pub(super) fn to_json<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string_pretty(value)
        .map(|s| s + "\n")
        .map_err(|e| Error::invalid("JSON", format!("cannot be written: {e}"), "report this as a defect"))
}

/// Parses JSON; `path` names it in messages.
pub(super) fn from_json<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T> {
    serde_json::from_str(text).map_err(|e| {
        Error::invalid(
            format!("{}:{}:{}", path.display(), e.line(), e.column()),
            format!("not as expected: {e}"),
            "the file is damaged or from another version; generate the dataset again",
        )
    })
}

/// `trajectory.json` of these poses.
pub(super) fn trajectory_json(poses: &[TrajectoryPose]) -> Result<String> {
    for p in poses {
        // JSON has no NaN: what cannot be read back is not written.
        Rigid3::from_rows(&p.world_from_camera.to_rows(), &format!("keyframe {}", p.index))?;
    }
    to_json(&TrajectoryOut {
        schema: TRAJECTORY_SCHEMA,
        frame: "world_from_camera: 4x4 by rows, OpenCV camera axes, metres, z-up world; time in seconds",
        keyframes: poses
            .iter()
            .map(|p| PoseOut {
                index: p.index,
                file: super::layout::stem(p.index),
                time_s: p.time_s,
                world_from_camera: p.world_from_camera.to_rows(),
            })
            .collect(),
    })
}

/// Reads `trajectory.json`; numbers that are not finite (some writers put `NaN` into JSON) are named with their keyframe.
pub(super) fn read_trajectory(path: &Path) -> Result<Vec<TrajectoryPose>> {
    let text = io::read_text(path)?;
    let repaired = if text.contains("NaN") || text.contains("Infinity") {
        ["-Infinity", "Infinity", "-NaN", "NaN"].iter().fold(text, |t, word| t.replace(word, "null"))
    } else {
        text
    };
    let trajectory: TrajectoryIn = from_json(&repaired, path)?;
    if trajectory.schema != TRAJECTORY_SCHEMA {
        return Err(Error::invalid(
            path.display().to_string(),
            format!("schema is \"{}\"", trajectory.schema),
            format!("this version reads \"{TRAJECTORY_SCHEMA}\""),
        ));
    }
    let mut poses = Vec::with_capacity(trajectory.keyframes.len());
    for (i, k) in trajectory.keyframes.iter().enumerate() {
        let place = format!("{}: keyframe {i}", path.display());
        if k.index != i {
            return Err(Error::invalid(place, format!("its index is {}", k.index), "indices count 0, 1, 2 ... without gaps"));
        }
        let rows = k.world_from_camera.map(|row| row.map(|v| v.unwrap_or(f64::NAN)));
        let world_from_camera = Rigid3::from_rows(&rows, &place)?;
        let Some(time_s) = k.time_s.filter(|t| t.is_finite()) else {
            return Err(Error::invalid(place, "time_s is not a finite number", "give seconds"));
        };
        bounds::position(&place, world_from_camera.translation)?;
        poses.push(TrajectoryPose { index: i, time_s, world_from_camera });
    }
    Ok(poses)
}
