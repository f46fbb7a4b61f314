//! What the page has to know before it draws anything.

use super::points;
use super::splats::{self, FieldLayout};
use super::subject::{Role, Run, Subject, Work};
use crate::charts::{ERROR_DB, ERROR_LIGHT, heat};
use crate::methods::registry;
use crate::run::RunInfo;
use anyhow::Result;
use corf::FieldMeta;
use corf_scene::Pinhole;
use corf_scene::color::{jet, quantize8};
use corf_scene::dataset::Quantity;
use corf_scene::keyframe::{DbRange, Modalities};
use corf_scene::words::counted;
use serde::Serialize;

/// Colours of a ramp.
const STEPS: usize = 256;

/// The scene document.
#[derive(Serialize)]
pub(super) struct SceneDocument {
    /// What is looked at, in a word.
    pub title: String,
    /// The data set, and how large everything is.
    subtitle: String,
    /// More of it.
    about: String,
    /// Whether it is a run.
    run: bool,
    /// Of a reconstruction at work, the halves of its field, which comes and grows.
    growing: Option<Halves>,
    modalities: Modalities,
    #[serde(rename = "optical_camera")]
    light_camera: Pinhole,
    #[serde(rename = "rf_camera")]
    radio_camera: Pinhole,
    db_range: DbRange,
    /// What a level of a spectrum is, in words and as a unit.
    pub unit: &'static str,
    unit_short: &'static str,
    /// Position, metres.
    transmitter: Option<[f64; 3]>,
    keyframes: Vec<KeyframeEntry>,
    /// Index of the keyframe that the page opens on.
    opening: usize,
    field: Option<FieldLayout>,
    points: PointCounts,
    ramps: Ramps,
    /// Error of full colour: dB of a spectrum, share of an image's full scale.
    error_db: f32,
    error_share: f32,
    /// Why a half cannot be drawn, where one cannot.
    missing: String,
    /// What has to be said under the list of keyframes.
    notes: Vec<String>,
}

/// Halves of a field that can be drawn.
#[derive(Serialize)]
struct Halves {
    #[serde(rename = "optical")]
    light: bool,
    #[serde(rename = "rf")]
    radio: bool,
}

#[derive(Serialize)]
struct KeyframeEntry {
    /// `world_from_camera`, the upper three rows.
    pose: [[f64; 4]; 3],
    role: Role,
}

/// Numbers of points of the sparse models.
#[derive(Serialize)]
struct PointCounts {
    #[serde(rename = "optical")]
    light: usize,
    #[serde(rename = "rf")]
    radio: usize,
}

/// Colours from 0 to 1 in even steps.
#[derive(Serialize)]
struct Ramps {
    jet: Vec<[u8; 3]>,
    heat: Vec<[u8; 3]>,
}

fn ramp(colour: impl Fn(f32) -> [u8; 3]) -> Vec<[u8; 3]> {
    (0..STEPS).map(|i| colour(i as f32 / (STEPS - 1) as f32)).collect()
}

/// A quantity in words, and as a unit.
fn unit(quantity: Quantity) -> (&'static str, &'static str) {
    match quantity {
        Quantity::PowerPerSteradian => {
            ("decibels of received power per steradian of solid angle, for 1 W sent", "dB per steradian")
        }
        Quantity::BeamPower => ("decibels of the power that a beam pointed there puts out, for 1 W sent", "dB"),
        Quantity::CaponPower => ("decibels of the power from there as Capon's method estimates it, for 1 W sent", "dB"),
        Quantity::Unknown => ("decibels of power in a unit that the data set does not state", "dB"),
    }
}
/// Layout of a run's Gaussians.
pub(super) fn field_layout(run: &Run) -> Option<FieldLayout> {
    run.field.as_ref().map(|(field, raster)| splats::layout(field, raster, registry::has_radio_colours(&run.info.method)))
}

fn missing(subject: &Subject, field: Option<&FieldLayout>) -> String {
    let has = subject.dataset.modalities();
    if !has.light || !has.radio {
        let half = if has.light { "no spectra" } else { "no images" };
        return format!("The data set has {half}.");
    }
    match (&subject.run, &subject.work, field) {
        (Some(run), _, None) => {
            format!(
                "{} has no Gaussians that could be drawn from everywhere: see its predictions at the keyframes.",
                run.info.method
            )
        }
        (Some(Run { info: RunInfo { method, .. }, .. }), _, _) | (_, Some(Work { method, .. }), _)
            if !registry::has_radio_colours(method) =>
        {
            format!(
                "Radio in {method} is no colour of Gaussians, and its spectra cannot be drawn from everywhere: see them at the keyframes."
            )
        }
        _ => "The data set has no points to draw.".to_owned(),
    }
}

/// What is looked at, in a word, in a line, and in more words.
struct Names {
    title: String,
    subtitle: String,
    about: String,
}

impl Names {
    fn of(subject: &Subject, points: &PointCounts) -> Self {
        let (dataset, name) = (&subject.dataset, &subject.dataset.header().name);
        let mut parts = vec![name.clone(), counted(dataset.len(), "keyframe")];
        // No path: a page may be sent elsewhere.
        let mut about = format!("data set {name}, hash {}", dataset.hash());
        let title = match (&subject.run, &subject.work) {
            (Some(Run { info, .. }), _) => {
                parts.extend(info.gaussians.map(|n| counted(n, "Gaussian")));
                let protocol = info.protocol.name();
                about = format!("seed {}, {protocol} protocol, {:.1} s on {}; {about}", info.seed, info.seconds, info.device);
                info.method.clone()
            }
            (None, Some(work)) => {
                about = format!("seed {}, {} protocol; {about}", work.seed, work.split.protocol.name());
                work.method.clone()
            }
            (None, None) => {
                parts.extend((points.light > 0).then(|| counted(points.light, "point")));
                "data set".to_owned()
            }
        };
        Self { title, subtitle: parts.join(" · "), about }
    }
}

impl SceneDocument {
    /// The scene document of a subject.
    ///
    /// # Errors
    /// Points of a data set that cannot be read.
    pub(super) fn of(subject: &Subject) -> Result<Self> {
        let (dataset, header) = (&subject.dataset, subject.dataset.header());
        let field = subject.run.as_ref().and_then(field_layout);
        let count = |modality| Ok::<_, anyhow::Error>(points::read(dataset, modality)?.len() / 16);
        // A run is looked at by what it made.
        let points = match (&subject.run, &subject.work) {
            (None, None) => PointCounts { light: count("optical")?, radio: count("rf")? },
            _ => PointCounts { light: 0, radio: 0 },
        };
        let Names { title, subtitle, about } = Names::of(subject, &points);
        let mut notes = Vec::new();
        let missing = missing(subject, field.as_ref());
        let method = subject.run.as_ref().map(|run| &run.info.method).or(subject.work.as_ref().map(|work| &work.method));
        let radio_colours = method.is_none_or(|method| registry::has_radio_colours(method));
        if !radio_colours {
            notes.push(missing.clone());
        }
        let has = dataset.modalities();
        let (unit, unit_short) = unit(header.quantity);
        let keyframe = |(index, pose): (usize, &corf_scene::trajectory::TrajectoryPose)| {
            let [a, b, c, _] = pose.world_from_camera.to_rows();
            KeyframeEntry { pose: [a, b, c], role: subject.role(index) }
        };
        Ok(Self {
            title,
            subtitle,
            about,
            run: subject.run.is_some(),
            growing: subject.work.is_some().then_some(Halves { light: has.light, radio: has.radio && radio_colours }),
            modalities: has,
            light_camera: dataset.light_camera(),
            radio_camera: dataset.radio_camera(),
            db_range: dataset.db_range().unwrap_or(FieldMeta::RANGE_WITHOUT_RADIO),
            unit,
            unit_short,
            transmitter: header.transmitter.map(|t| t.position_m),
            keyframes: dataset.poses().iter().enumerate().map(keyframe).collect(),
            opening: subject.opening,
            field,
            points,
            ramps: Ramps { jet: ramp(|t| jet(t).map(quantize8)), heat: ramp(heat) },
            error_db: ERROR_DB,
            error_share: ERROR_LIGHT,
            missing,
            notes,
        })
    }
}
