//! Figures along the way: what a user of the predicted spectra gets at every held-out keyframe of the trajectory.
//!
//! ```text
//! beam.svg      whether the predicted best beam is the best one, or among the first three, and what it loses
//! rate.svg      the rate of the chosen beam beside that of the best one
//! outage.svg    where the best beam is in outage and who says so, and the share in outage for any target rate
//! ```
//!
//! Rows are shown by their first finished seed, as everywhere in a report.

mod axis;
mod beam;
mod canvas;
mod outage;
mod rate;

use super::charts::first_cells;
use crate::charts::without_size;
use crate::files::escape;
use crate::metrics::beams::BeamMetrics;
use crate::metrics::outage::LinkRates;
use crate::metrics::rate::{TARGET_RATE_BPS_HZ, budget};
use crate::record::{Numbers, Record};
use anyhow::Result;
use axis::Axis;
use corf_scene::dataset::Dataset;
use corf_scene::io::write_atomic;
use glam::DVec3;
use std::fmt::Write;
use std::path::Path;

/// Names of the files.
pub const FILES: [&str; 3] = ["beam.svg", "rate.svg", "outage.svg"];

/// The held-out keyframes in their order, and what every row makes of them.
struct Way {
    axis: Axis,
    /// Rates of the first row's keyframes, for what does not depend on the row.
    truth: Vec<LinkRates>,
    tracks: Vec<Track>,
}

/// A row along the way.
struct Track {
    label: String,
    /// Its place among the rows, which gives its colour.
    row: usize,
    stops: Vec<(BeamMetrics, LinkRates)>,
}

/// The figures of a comparison.
pub struct Figures {
    /// SVG, in the order of [`FILES`].
    pub svg: [String; 3],
    /// What has to be said of them, as HTML.
    note: String,
}

impl Figures {
    /// The figures of records on a dataset; `None` where no record has rates, as of spectra without beams or of images alone.
    ///
    /// # Errors
    /// Rates that no axis holds.
    pub fn of(records: &[Record], dataset: &Dataset) -> Result<Option<Self>> {
        let positions: Vec<DVec3> = dataset.poses().iter().map(|p| p.world_from_camera.translation).collect();
        let Some(way) = Way::of(&first_cells(records), &positions) else { return Ok(None) };
        let svg = [beam::svg(&way)?, rate::svg(&way)?, outage::svg(&way)?];
        Ok(Some(Self { svg, note: way.note() }))
    }

    /// Writes the files into a folder.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        FILES.iter().zip(&self.svg).try_for_each(|(name, svg)| Ok(write_atomic(folder.join(name), svg.as_bytes())?))
    }

    /// The figures as a part of a page.
    pub(super) fn html(&self) -> String {
        let figure = |svg: &String| format!("<figure>{}</figure>", without_size(svg));
        format!(
            "<div class=\"along\">{}</div><p class=\"note\">{}</p>",
            self.svg.iter().map(figure).collect::<String>(),
            self.note
        )
    }
}

impl Way {
    /// The way of the rows that have rates at the same keyframes as the first that has any.
    fn of(cells: &[(&str, &Numbers)], positions: &[DVec3]) -> Option<Self> {
        let keyframes = |n: &Numbers| n.frames.iter().map(|f| f.index).collect::<Vec<_>>();
        let stops = |n: &Numbers| -> Option<Vec<(BeamMetrics, LinkRates)>> {
            n.frames.iter().map(|f| f.spectrum?.beams.zip(f.spectrum?.link)).collect()
        };
        let mut held_out: Option<Vec<usize>> = None;
        let mut tracks = Vec::new();
        for (row, (label, numbers)) in cells.iter().enumerate() {
            let Some(stops) = stops(numbers).filter(|s| !s.is_empty()) else { continue };
            if *held_out.get_or_insert_with(|| keyframes(numbers)) == keyframes(numbers) {
                tracks.push(Track { label: escape::plain(label), row, stops });
            }
        }
        let axis = Axis::of(&held_out?, positions);
        let truth = tracks.first()?.stops.iter().map(|stop| stop.1).collect();
        Some(Self { axis, truth, tracks })
    }

    /// Places (of the axis) at which the best beam is in outage.
    fn out_of_service(&self) -> impl Iterator<Item = f64> + '_ {
        self.axis.stops.iter().zip(&self.truth).filter(|(_, link)| link.outage().best).map(|(at, _)| *at)
    }

    fn note(&self) -> String {
        let count = self.truth.len();
        let out = self.out_of_service().count();
        let mut note = format!(
            "Held-out keyframes, each row by its first seed. Beams are those of the 8×8 codebook; rates are log2(1 + SNR) with {}. A link is in \
             outage where its rate is below {TARGET_RATE_BPS_HZ} bit/s/Hz. The best beam is in outage at {out} of {count} keyframes",
            budget()
        );
        let blocked: Option<Vec<bool>> = self.truth.iter().map(|link| link.outage().blocked).collect();
        if let Some(blocked) = blocked.filter(|_| out > 0) {
            let blocked = blocked.iter().filter(|b| **b).count();
            let _ = write!(note, ", at {blocked} of them by blockage: in free space the same distance would do");
        }
        note.push_str(". The definitions are in docs/METHODOLOGY.md.");
        escape::html(&note)
    }
}

#[cfg(test)]
mod tests;
