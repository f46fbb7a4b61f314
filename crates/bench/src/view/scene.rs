//! What the page has to know before it draws anything.

use super::points;
use super::splats::{self, FieldLayout};
use super::subject::{Role, Run, Subject};
use crate::report::colours::{ERROR_DB, ERROR_OPTICAL, heat};
use anyhow::Result;
use corf_scene::Pinhole;
use corf_scene::color::{jet, quantize8};
use corf_scene::dataset::Quantity;
use corf_scene::keyframe::{DbRange, Modalities};
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
    modalities: Modalities,
    optical_camera: Pinhole,
    rf_camera: Pinhole,
    db_range: DbRange,
    /// What a level of a spectrum is, in words and as a unit.
    pub unit: &'static str,
    unit_short: &'static str,
    /// Position, metres.
    transmitter: Option<[f64; 3]>,
    keyframes: Vec<KeyframeEntry>,
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

#[derive(Serialize)]
struct KeyframeEntry {
    /// `world_from_camera`, the upper three rows.
    pose: [[f64; 4]; 3],
    role: Role,
}

/// Numbers of points of the sparse models.
#[derive(Serialize)]
struct PointCounts {
    optical: usize,
    rf: usize,
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

/// Whether the RF colours of a run's Gaussians are its spectra.
fn has_rf_colours(run: &Run) -> bool {
    run.info.method != "corf-array"
}

/// Layout of a run's Gaussians.
pub(super) fn field_layout(run: &Run) -> Option<FieldLayout> {
    run.field.as_ref().map(|(field, raster)| splats::layout(field, raster, has_rf_colours(run)))
}

fn missing(subject: &Subject, field: Option<&FieldLayout>) -> String {
    let has = subject.dataset.modalities();
    if !has.light || !has.radio {
        let half = if has.light { "no spectra" } else { "no images" };
        return format!("The data set has {half}.");
    }
    match (&subject.run, field) {
        (Some(run), Some(_)) if !has_rf_colours(run) => format!(
            "Radio in {} is no colour of Gaussians, and its spectra cannot be drawn from everywhere: see them at the keyframes.",
            run.info.method
        ),
        (Some(run), None) => {
            format!(
                "{} has no Gaussians that could be drawn from everywhere: see its predictions at the keyframes.",
                run.info.method
            )
        }
        _ => "The data set has no points to draw.".to_owned(),
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
        let points = match subject.run {
            Some(_) => PointCounts { optical: 0, rf: 0 },
            None => PointCounts { optical: count("optical")?, rf: count("rf")? },
        };
        let mut parts = vec![header.name.clone(), format!("{} keyframes", dataset.len())];
        // No path: a page may be sent elsewhere.
        let mut about = format!("data set {}, hash {}", header.name, dataset.hash());
        let mut notes = Vec::new();
        let title = match &subject.run {
            Some(run) => {
                parts.extend(run.info.gaussians.map(|n| format!("{n} Gaussians")));
                about = format!(
                    "seed {}, {} protocol, {:.1} s on {}; {about}",
                    run.info.seed,
                    run.info.protocol.name(),
                    run.info.seconds,
                    run.info.device
                );
                run.info.method.clone()
            }
            None => {
                parts.extend((points.optical > 0).then(|| format!("{} points", points.optical)));
                "data set".to_owned()
            }
        };
        let missing = missing(subject, field.as_ref());
        if subject.run.as_ref().is_some_and(|run| !has_rf_colours(run)) {
            notes.push(missing.clone());
        }
        let (unit, unit_short) = unit(header.quantity);
        let keyframe = |(index, pose): (usize, &corf_scene::trajectory::TrajectoryPose)| {
            let [a, b, c, _] = pose.world_from_camera.to_rows();
            KeyframeEntry { pose: [a, b, c], role: subject.role(index) }
        };
        Ok(Self {
            title,
            subtitle: parts.join(" · "),
            about,
            run: subject.run.is_some(),
            modalities: dataset.modalities(),
            optical_camera: dataset.optical_camera(),
            rf_camera: dataset.rf_camera(),
            db_range: dataset.db_range(),
            unit,
            unit_short,
            transmitter: header.transmitter.map(|t| t.position_m),
            keyframes: dataset.poses().iter().enumerate().map(keyframe).collect(),
            field,
            points,
            ramps: Ramps { jet: ramp(|t| jet(t).map(quantize8)), heat: ramp(heat) },
            error_db: ERROR_DB,
            error_share: ERROR_OPTICAL,
            missing,
            notes,
        })
    }
}
