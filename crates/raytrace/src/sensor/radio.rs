//! The RF half of a keyframe: what a platform's array receives at a pose.

use crate::radio::{
    Antenna, AntennaArray, Arrival, DiffuseField, DiffuseSettings, Path as RadioPath, PlanarArray, Polarization, RadioSettings,
    RadioTracer, Search, Transmitter, diffuse, json,
};
use crate::spectrum::{self, Grid, SpectrumSettings};
use corf_scene::config::{
    DatasetConfig, RearHalfSpace, ReceiverConfig, SceneConfig, SpectrumConfig, SpectrumKind, TransmitterConfig,
};
use corf_scene::dataset::SamplingError;
use corf_scene::model::world_from_array;
use corf_scene::mounting::Surfaces;
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::words::{counted, verb};
use corf_scene::{Equirectangular, Finding, Pinhole, Raster, Result, Rigid3, Scene, Severity, near_field, radio_check};
use glam::DMat3;
use std::collections::BTreeMap;

/// Carrier and antennas of a scene; everything else as by default. The receive element stands in the world's own axes: what turns with
/// the platform is asked for where the platform is.
pub fn radio_settings(scene: &SceneConfig) -> RadioSettings {
    RadioSettings {
        frequency_hz: scene.radio.frequency_hz,
        tx_antenna: Antenna::from(&scene.transmitter),
        rx_antenna: Antenna::element_of(&scene.receiver, DMat3::IDENTITY),
        ..RadioSettings::default()
    }
}

/// Tracing settings for a platform's sensor: [`radio_settings`] with an isotropic receive element of both polarisations. The orientation of
/// the real element is known at a pose alone, so no path is dropped because it does not couple into the element.
pub fn sensor_settings(scene: &SceneConfig) -> RadioSettings {
    let any_polarization = Antenna { polarization: Polarization::VH, ..Antenna::default() };
    RadioSettings { rx_antenna: any_polarization, ..radio_settings(scene) }
}

/// Warnings of bodies that are open where transmission (if there is any) needs closed ones, and of a scene too far from the origin.
pub fn geometry_warnings(scene: &Scene, transmission: bool) -> Vec<Finding> {
    let bodies = if transmission { radio_check::body_findings(scene) } else { Vec::new() };
    let findings = bodies.into_iter().chain(radio_check::far_finding(scene));
    findings.filter(|f| f.severity == Severity::Warning).collect()
}

/// A note that open edges of sheets do not diffract, where edges do and there are some.
pub fn open_edges_note(tracer: &RadioTracer<'_>) -> Option<Finding> {
    let (count, length_m) = tracer.open_edges_left_out();
    (count > 0).then(|| {
        let does = verb(count, "does", "do");
        let what = format!("{} of sheets, {length_m:.1} m in all, {does} not diffract", counted(count, "open edge"));
        let help = "trace them with --edge-diffraction (edge_diffraction = true), or close the bodies that they belong to";
        Finding::new(Severity::Note, "diffraction", what, help)
    })
}

/// One element of a platform's array at a pose.
pub fn element_at(receiver: &ReceiverConfig, world_from_camera: &Rigid3) -> Antenna {
    Antenna::element_of(receiver, world_from_array(world_from_camera))
}

/// Angular resolution of an array's spectrum, degrees: a third of the 12.8° of eight elements. Finer structure of the field is only
/// averaged.
const ARRAY_RESOLUTION_DEG: f64 = 4.0;

/// Sampling settings of the diffuse field for a dataset: the angular resolution follows from the kind of its spectra.
pub fn diffuse_settings(radio: &SpectrumConfig) -> DiffuseSettings {
    let is_array = radio.spectrum != SpectrumKind::Mpc;
    DiffuseSettings {
        resolution_deg: if is_array { ARRAY_RESOLUTION_DEG } else { radio.lobe_width_deg.min(90.0) },
        even_arrivals: is_array,
        patch_size_m: radio.patch_size_m,
        directions: radio.directions,
        photons: radio.photons,
        ..DiffuseSettings::default()
    }
}

/// Settings of the radio half of a keyframe: all that a configuration asks of the tracer, in one place for everyone who traces it.
#[derive(Clone, Copy, Debug)]
pub struct SensorPlan {
    /// The transmitter that is on.
    pub transmitter: TransmitterConfig,
    /// The platform's array.
    pub receiver: ReceiverConfig,
    /// Settings of the path tracer.
    pub tracing: RadioSettings,
    /// Sampling of the diffuse field; `None` where it is left out.
    pub sampling: Option<DiffuseSettings>,
    /// Settings of the angular power spectra.
    pub spectrum: SpectrumSettings,
}

impl SensorPlan {
    /// The plan of a dataset.
    ///
    /// # Errors
    /// The dataset names a transmitter that the scene does not have.
    pub fn of(config: &DatasetConfig, scene: &SceneConfig) -> Result<Self> {
        Ok(Self::from_parts(&config.radio, config.seed, config.transmitter_of(scene)?, scene))
    }

    /// The plan of an `[rf]` section with a seed and one of the scene's transmitters.
    pub fn from_parts(radio: &SpectrumConfig, seed: u64, transmitter: &TransmitterConfig, scene: &SceneConfig) -> Self {
        Self {
            transmitter: *transmitter,
            receiver: scene.receiver,
            tracing: RadioSettings {
                max_interactions: radio.max_interactions,
                search: Search::Auto { rays: radio.rays },
                transmission: radio.transmission,
                diffraction: radio.diffraction,
                edge_diffraction: radio.edge_diffraction,
                tx_antenna: Antenna::from(transmitter),
                ..sensor_settings(scene)
            },
            sampling: radio.diffuse.then(|| diffuse_settings(radio)),
            spectrum: SpectrumSettings::new(radio, &scene.receiver, seed),
        }
    }
}

/// A platform's array in a scene with one transmitter.
pub struct RadioSensor<'a> {
    scene: &'a Scene,
    tracer: &'a RadioTracer<'a>,
    transmitter: Transmitter<'a, 'a>,
    diffuse: Option<DiffuseField<'a, 'a>>,
    plan: SensorPlan,
    surfaces: Surfaces<'a>,
}

/// Multipath received at a pose: resolved paths and diffuse arrivals.
pub struct Received {
    /// Resolved paths, antennas at the platform's attitude.
    pub paths: Vec<RadioPath>,
    /// Diffuse arrivals, all ports together.
    pub diffuse: Vec<Arrival>,
    /// Arrivals of every pair of antenna ports; the diffuse ones are in the first.
    pub port_pairs: Vec<Vec<Arrival>>,
}

/// Part of the sphere around a receiver that is sampled at full density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Extent {
    /// A camera's frame and a margin; the rest sixteen times sparser.
    View(Pinhole),
    /// The half-space in front of the array's plane, and a margin; the rest four times sparser.
    Front,
    /// The whole sphere.
    Sphere,
}

impl Extent {
    /// The extent that spectra of these kinds need on a grid: lobes only the directions of the grid; an array's side lobes all directions,
    /// the rear half-space aside where the array does not receive from there.
    pub fn needed(kinds: &[SpectrumKind], grid: Grid, rear: RearHalfSpace) -> Self {
        let lobes = kinds.iter().filter(|kind| **kind == SpectrumKind::Mpc).count();
        match grid {
            Grid::Pinhole(camera) if lobes == kinds.len() => Self::View(camera),
            _ if lobes == 0 && rear == RearHalfSpace::Gated => Self::Front,
            _ => Self::Sphere,
        }
    }

    /// The extent that all outputs of a dataset's keyframe need together.
    pub fn of_keyframe(radio: &SpectrumConfig, receiver: &ReceiverConfig) -> Self {
        let widest = match radio.sphere {
            Some([width, height]) => Grid::Sphere(Equirectangular { width, height }),
            None => Grid::Pinhole(Pinhole::from_horizontal_fov(radio.width, radio.height, radio.horizontal_fov_deg)),
        };
        Self::needed(&[radio.spectrum], widest, receiver.rear)
    }

    /// Gathers the diffuse arrivals of a receiver at a pose, sampled finely over this extent.
    ///
    /// # Errors
    /// A position that is not finite.
    pub fn gather(&self, field: &DiffuseField<'_, '_>, pose: &Rigid3, element: &Antenna) -> Result<Vec<Arrival>> {
        let extent = match *self {
            Self::View(camera) => diffuse::WorldExtent::View { camera, world_from_camera: *pose },
            Self::Front => diffuse::WorldExtent::Front { boresight: world_from_array(pose).x_axis },
            Self::Sphere => diffuse::WorldExtent::Sphere,
        };
        field.gather(pose.translation, element, &extent)
    }
}

impl<'a> RadioSensor<'a> {
    /// Finds what does not depend on the receiver; `tracer` is one with the plan's settings.
    ///
    /// # Errors
    /// A transmitter that cannot be traced, or settings out of range.
    pub fn new(plan: &SensorPlan, scene: &'a Scene, tracer: &'a RadioTracer<'a>) -> Result<Self> {
        let surfaces = Surfaces::of(scene);
        let stated = plan.transmitter.position();
        let tx = surfaces.mount("transmitter", stated, plan.transmitter.facing())?.map_or(stated, |mount| mount.position());
        Ok(Self {
            scene,
            tracer,
            transmitter: tracer.transmitter(tx)?,
            diffuse: plan.sampling.map(|sampling| DiffuseField::new(tracer, tx, &sampling)).transpose()?,
            plan: *plan,
            surfaces,
        })
    }

    /// Where the array is traced at a pose: off the surface that it is on, if it is.
    fn mounted(&self, pose: &Rigid3) -> Result<Rigid3> {
        let facing = world_from_array(pose).x_axis;
        let mount = self.surfaces.mount("receiver", pose.translation, Some(facing))?;
        Ok(mount.map_or(*pose, |mount| Rigid3 { translation: mount.position(), ..*pose }))
    }

    /// Settings of the sensor's spectra.
    pub fn settings(&self) -> &SpectrumSettings {
        &self.plan.spectrum
    }

    /// Everything that arrives at a pose.
    ///
    /// # Errors
    /// A receiver at the transmitter.
    pub fn receive(&self, world_from_camera: &Rigid3, extent: Extent) -> Result<Received> {
        self.receive_from(self.diffuse.as_ref(), world_from_camera, extent)
    }

    /// The least distance between an element of the platform's array at a pose and one of the transmitter's, metres; exact under 2λ.
    fn distance_m(&self, pose: &Rigid3) -> f64 {
        let settings = self.tracer.settings();
        let platform =
            AntennaArray { element: element_at(&self.plan.receiver, pose), grid: PlanarArray::from(&self.plan.receiver) };
        let transmitter = AntennaArray::single(settings.tx_antenna);
        let doubtful_m = near_field::doubtful_under_m(settings.frequency_hz);
        let tx = (&transmitter, self.transmitter.position());
        platform.distance_m(pose.translation, tx, settings.wavelength_m(), doubtful_m)
    }

    /// Findings to report before poses are traced: a note of open edges that do not diffract, and a warning where the platform's array is
    /// within 2λ of the transmitter's.
    ///
    /// # Errors
    /// The first pose at which it is within λ/2π.
    pub fn check<'p>(&self, poses: impl IntoIterator<Item = &'p Rigid3>) -> Result<Vec<Finding>> {
        let frequency_hz = self.tracer.settings().frequency_hz;
        let mut doubtful = Vec::new();
        for pose in poses {
            let distance_m = self.distance_m(&self.mounted(pose)?);
            near_field::check(&format!("receiver at {}", pose.translation), distance_m, frequency_hz)?;
            doubtful.extend((distance_m < near_field::doubtful_under_m(frequency_hz)).then_some(distance_m));
        }
        let doubtful = (!doubtful.is_empty()).then(|| near_field::doubtful("receiver", &doubtful, frequency_hz));
        Ok(open_edges_note(self.tracer).into_iter().chain(doubtful).collect())
    }

    fn receive_from(&self, diffuse: Option<&DiffuseField<'_, '_>>, pose: &Rigid3, extent: Extent) -> Result<Received> {
        let pose = &self.mounted(pose)?;
        let settings = self.tracer.settings();
        let element = element_at(&self.plan.receiver, pose);
        let mut paths = self.transmitter.paths(pose.translation)?;
        for path in &mut paths {
            path.a = path.coefficient(&settings.tx_antenna, 0, &element, 0);
        }
        let mut port_pairs = spectrum::port_pairs(&paths, &settings.tx_antenna, &element, settings.frequency_hz);
        let diffuse = diffuse.map(|field| extent.gather(field, pose, &element)).transpose()?.unwrap_or_default();
        port_pairs[0].extend(&diffuse);
        Ok(Received { paths, diffuse, port_pairs })
    }

    /// Every path at a pose as one JSON object a line, and in the last line the diffuse power, in total and by the object seen.
    pub fn json_lines(&self, received: &Received, world_from_camera: &Rigid3) -> String {
        let (tx, rx) = (self.transmitter.position(), world_from_camera.translation);
        let all = json::paths_to_json(self.scene, self.tracer.settings().frequency_hz, tx, rx, &received.paths);
        let list = all["paths"].as_array().map(Vec::as_slice).unwrap_or_default();
        let lines: String = list.iter().map(|p| format!("{p}\n")).collect();
        let mut by_object: BTreeMap<&str, f64> = BTreeMap::new();
        for arrival in &received.diffuse {
            let name = self.scene.objects.get(arrival.object as usize).map_or("", |o| o.name.as_str());
            *by_object.entry(name).or_default() += arrival.power;
        }
        let power: f64 = received.diffuse.iter().map(|a| a.power).sum();
        let delay_s: f64 = received.diffuse.iter().map(|a| a.power * a.delay_s).sum();
        let mean_delay_s = (power > 0.0).then(|| delay_s / power);
        let summary = serde_json::json!({
            "diffuse": { "power": power, "mean_delay_s": mean_delay_s, "arrivals": received.diffuse.len(), "power_by_object": by_object }
        });
        lines + &format!("{summary}\n")
    }

    /// Sampling error of the diffuse field: the difference of two independent samplings at a few poses; `None` without a diffuse field.
    ///
    /// # Errors
    /// A receiver at the transmitter.
    pub fn sampling_error(&self, camera: &Pinhole, poses: &[TrajectoryPose]) -> Result<Option<SamplingError>> {
        let (Some(field), Some(sampling)) = (&self.diffuse, self.plan.sampling) else { return Ok(None) };
        let other = DiffuseField::new(self.tracer, self.transmitter.position(), &DiffuseSettings { phase: 1, ..sampling })?;
        let noncoherent = noncoherent(self.settings());
        let (mut totals, mut pixels) = (MeanSquare::default(), MeanSquare::default());
        let probes = probes(poses);
        let extent = Extent::needed(&[noncoherent.kind], Grid::Pinhole(*camera), self.plan.receiver.rear);
        for pose in &probes {
            let seen = |field| -> Result<(f64, Raster<f32>)> {
                let received = self.receive_from(Some(field), &pose.world_from_camera, extent)?;
                let power = received.port_pairs.iter().flatten().map(|a| a.power).sum();
                Ok((power, noncoherent.form(&received.port_pairs, camera, &pose.world_from_camera)))
            };
            let ((power_a, a), (power_b, b)) = (seen(field)?, seen(&other)?);
            totals.add(difference_db(power_a, power_b));
            let peak = a.pixels().iter().copied().fold(0f32, f32::max);
            let strong = a.pixels().iter().zip(b.pixels()).filter(|(a, b)| **a > 0.0 && **a >= STRONG * peak && **b > 0.0);
            strong.for_each(|(a, b)| pixels.add(10.0 * f64::from(a / b).log10()));
        }
        // Each difference is of two samplings.
        let standard_error = |squares: &MeanSquare| squares.root() / std::f64::consts::SQRT_2;
        Ok(Some(SamplingError { keyframes: probes.len(), total_db: standard_error(&totals), pixels_db: standard_error(&pixels) }))
    }

    /// Radio data of a dataset at a pose.
    ///
    /// # Errors
    /// A receiver at the transmitter.
    pub fn keyframe(&self, pose: &Rigid3, outputs: &Outputs) -> Result<RadioFrame> {
        let received = self.receive(pose, outputs.extent)?;
        let form = |grid: Grid| self.settings().form(&received.port_pairs, grid, pose);
        let all = received.port_pairs.concat();
        Ok(RadioFrame {
            spectrum: form(Grid::Pinhole(outputs.camera)),
            sphere: outputs.sphere.map(|sphere| form(Grid::Sphere(sphere))),
            share_in_frame: spectrum::share_in_frame(&all, &outputs.camera, pose),
            paths_jsonl: outputs.paths.then(|| self.json_lines(&received, pose)),
        })
    }
}

/// Outputs computed at every pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outputs {
    /// Part of the sphere from which arrivals are gathered finely.
    pub extent: Extent,
    /// Camera of the spectra.
    pub camera: Pinhole,
    /// Image of the whole sphere, if it is wanted.
    pub sphere: Option<Equirectangular>,
    /// Whether paths are wanted.
    pub paths: bool,
}

/// The RF half of a keyframe.
pub struct RadioFrame {
    /// Spectrum of the RF camera.
    pub spectrum: Raster<f32>,
    /// Spectrum over the whole sphere.
    pub sphere: Option<Raster<f32>>,
    /// Share of the arriving power inside the frame.
    pub share_in_frame: f64,
    /// Paths, one JSON object a line.
    pub paths_jsonl: Option<String>,
}

/// Powers that much smaller than that transmitted, −300 dB, are as good as none: where nothing arrives samplings agree.
const NOTHING: f64 = 1e-30;

/// Ratio of two powers, a/b, dB; finite also where one of them is zero.
fn difference_db(a: f64, b: f64) -> f64 {
    10.0 * ((a + NOTHING) / (b + NOTHING)).log10()
}

/// Pixels within 30 dB of their spectrum's peak count.
const STRONG: f32 = 1e-3;

/// The first keyframe and the middle one.
fn probes(poses: &[TrajectoryPose]) -> Vec<&TrajectoryPose> {
    let mut indices = vec![0, poses.len() / 2];
    indices.dedup();
    indices.into_iter().filter_map(|i| poses.get(i)).collect()
}

/// Settings of a noncoherent spectrum for measuring the sampling error: a coherent one would compare random phases with other random
/// phases.
pub fn noncoherent(settings: &SpectrumSettings) -> SpectrumSettings {
    use SpectrumKind::{Bartlett, Mpc};
    SpectrumSettings { kind: if settings.kind == Mpc { Mpc } else { Bartlett }, ..*settings }
}

#[derive(Default)]
struct MeanSquare {
    sum: f64,
    count: usize,
}

impl MeanSquare {
    fn add(&mut self, value: f64) {
        self.sum += value * value;
        self.count += 1;
    }

    fn root(&self) -> f64 {
        (self.sum / self.count.max(1) as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_where_nothing_arrives_differ_by_a_number() {
        assert_eq!(difference_db(0.0, 0.0), 0.0);
        assert!((difference_db(1e-8, 2e-8) + 10.0 * 2f64.log10()).abs() < 1e-9);
        assert!((difference_db(1e-8, 0.0) - 220.0).abs() < 1e-6);
    }

    #[test]
    fn only_what_no_spectrum_shows_is_gathered_sparsely() {
        use RearHalfSpace::{Aliased, Gated};
        use SpectrumKind::{Bartlett, Mpc, Mvdr};
        let camera = Pinhole::from_horizontal_fov(96, 64, 90.0);
        let [frame, sphere] = [Grid::Pinhole(camera), Grid::Sphere(Equirectangular { width: 64, height: 32 })];
        for rear in [Gated, Aliased] {
            assert_eq!(Extent::needed(&[Mpc], frame, rear), Extent::View(camera));
            assert_eq!(Extent::needed(&[Mpc], sphere, rear), Extent::Sphere);
            assert_eq!(Extent::needed(&[Mpc, Bartlett], frame, rear), Extent::Sphere);
        }
        for grid in [frame, sphere] {
            assert_eq!(Extent::needed(&[Bartlett, Mvdr], grid, Gated), Extent::Front);
            assert_eq!(Extent::needed(&[Bartlett, Mvdr], grid, Aliased), Extent::Sphere);
        }
    }
}
