//! `corf coverage`: what transmitters reach on a plane: EXR, picture, numbers.

use super::{Verdict, show};
use crate::files::json::write_json;
use crate::note;
use crate::radio_link::coverage_picture::CoveragePicture;
use crate::radio_link::{LinkArgs, LinkSetup, PointArg};
use crate::run::claim_fresh;
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::Result;
use clap::Args;
use corf_raytrace::radio::DiffuseSettings;
use corf_raytrace::radio::coverage::{CoveragePlane, coverage, strongest};
use corf_scene::words::{counted, verb};
use corf_scene::{Error, Finding, Raster, Severity, io, near_field};
use glam::DVec3;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Directions of the diffuse field at a cell: its total alone needs far fewer than a spectrum.
const DIFFUSE_DIRECTIONS: usize = 10_000;

/// `corf coverage`.
#[derive(Args)]
pub struct Coverage {
    /// Scene file (.toml).
    scene: PathBuf,
    /// Height of a horizontal plane over the whole scene, metres (default: the trajectory's).
    #[arg(long, value_name = "Z", allow_hyphen_values = true, conflicts_with = "plane")]
    height: Option<f64>,
    /// Another rectangle: a corner and the ends of the two sides that meet there.
    #[arg(long, num_args = 3, value_names = ["CORNER", "END_U", "END_V"], allow_hyphen_values = true)]
    plane: Option<Vec<PointArg>>,
    /// Side of a cell, metres.
    #[arg(long, value_name = "METRES", default_value_t = 0.25, allow_hyphen_values = true)]
    cell: f64,
    /// Transmitter, world metres; may be repeated: the scene's own there. Without it where that is, or those of --transmitter.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    tx: Vec<PointArg>,
    #[command(flatten)]
    link: LinkArgs,
    /// Folder for coverage.exr (path gain, linear), coverage.png (dBm) and coverage.json: of several transmitters the strongest in each
    /// cell, beside coverage_tx0.exr, coverage_tx1.exr … of each, and association.exr, the number of the strongest.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Coverage {
    /// Runs the command.
    ///
    /// # Errors
    /// A scene that cannot be read or traced, a plane outside of it, a transmitter inside of a body.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let mut setup = LinkSetup::load(&self.scene, &self.link, None, None)?;
        setup.place_transmitter(self.tx.iter().map(|p| p.0))?;
        setup.check_single_elements()?;
        let plane = self.plane_of(&setup)?;
        setup.mount(&mut [])?;
        setup.transmitters.iter().try_for_each(|tx| setup.check_transmitter(tx.position))?;
        // Whatever can be refused is refused before the work.
        let out = claim_fresh(&self.out)?;
        let sampling = setup.diffuse_settings(DIFFUSE_DIRECTIONS);
        let maps = maps(&setup, &plane, &sampling)?;
        let (gain, association) = strongest(&maps);
        if gain.pixels().iter().all(|g| g.is_nan()) {
            let what =
                format!("no cell has a value: the centres of all {} lie inside of bodies or on surfaces", gain.pixels().len());
            return Err(Error::invalid("coverage plane", what, "give another --height, or smaller cells with --cell").into());
        }
        if gain.pixels().iter().any(|g| g.is_infinite()) {
            let help = "the scene's powers are beyond single precision: check its sizes and units";
            return Err(Error::invalid("coverage plane", "the gain of a cell is infinite", help).into());
        }
        let near = Near::count(&setup, &plane);
        if near.doubtful > 0 {
            let what = format!(
                "{} {} within 2 wavelengths of a transmitter, where the far-field law is inexact",
                counted(near.doubtful, "cell"),
                verb(near.doubtful, "is", "are")
            );
            note!("{}", Finding::new(Severity::Warning, "coverage plane", what, "leave these cells out of statistics"));
        }
        let picture = CoveragePicture::new(&gain, &plane, setup.link.tx_power_dbm);
        let mut report =
            self.report(&setup, &plane, &gain, picture.range_dbm(), setup.link.diffuse.then_some(sampling.directions));
        if near.excluded + near.doubtful > 0 {
            report["cells_too_near_a_transmitter"] = json!({ "excluded": near.excluded, "doubtful": near.doubtful, "where": "excluded: the centre is within a wavelength over 2 pi of a transmitter, no value of that one; doubtful: within 2 wavelengths" });
        }
        let positions: Vec<DVec3> = setup.transmitters.iter().map(|tx| tx.position).collect();
        let exr = |name: &str, map: &Raster<f32>| -> Result<()> {
            Ok(io::write_atomic(out.path().join(name), &io::encode_exr_f32(map, "Y")?)?)
        };
        if let [tx] = positions.as_slice() {
            report["tx"] = json!(tx.to_array());
        } else {
            exr("association.exr", &association)?;
            let mut all = Vec::new();
            for (number, (tx, map)) in positions.iter().zip(&maps).enumerate() {
                let file = format!("coverage_tx{number}.exr");
                exr(&file, map)?;
                let cells = association.pixels().iter().filter(|of| **of == number as f32).count();
                let rssi_dbm = rssi_dbm(map, setup.link.tx_power_dbm);
                all.push(json!({ "position": tx.to_array(), "file": file, "cells_strongest": cells, "rssi_dbm": rssi_dbm }));
            }
            report["transmitters"] = json!(all);
            report["association"] = json!(
                "association.exr, channel Y: the number of the strongest transmitter, counted from 0; -1 where none reaches the cell, NaN as in coverage.exr"
            );
        }
        exr("coverage.exr", &gain)?;
        io::write_atomic(out.path().join("coverage.png"), &picture.draw(&setup.scene, &positions))?;
        write_json(&out.path().join("coverage.json"), &report)?;
        out.finish()?;
        let rssi = &report["rssi_dbm"];
        let received = match rssi["median"].as_f64() {
            Some(median) => format!("median {median} dBm, 5 % below {} dBm, 5 % above {} dBm", rssi["p5"], rssi["p95"]),
            None => "no path reaches any cell".into(),
        };
        let whose = if positions.len() == 1 { String::new() } else { format!(" of the strongest of {}", positions.len()) };
        let too_near = match near.excluded {
            0 => String::new(),
            n => format!(", or too near a transmitter ({n})"),
        };
        let text = format!(
            "{} x {} cells of {} m, {} of them inside bodies or on surfaces{too_near}\nRSSI{whose} at {} dBm: {received}\n{}",
            plane.columns,
            plane.rows,
            plane.cell_m,
            report["cells_without_value"],
            setup.link.tx_power_dbm,
            self.out.join("coverage.png").display(),
        );
        show(json, &report, &text)?;
        Ok(Verdict::Done)
    }

    fn plane_of(&self, setup: &LinkSetup) -> Result<CoveragePlane> {
        if let Some([corner, end_u, end_v]) = self.plane.as_deref() {
            return Ok(CoveragePlane::new(corner.0, end_u.0, end_v.0, self.cell)?);
        }
        let of_trajectory = || setup.config.trajectory.as_ref().map(|t| t.height_m);
        let Some(height_m) = self.height.or_else(of_trajectory) else {
            let help = "give --height Z in metres, e.g. --height 1.6";
            return Err(Error::invalid("coverage plane", "no height, and the scene has no trajectory", help).into());
        };
        Ok(CoveragePlane::horizontal(&setup.scene, height_m, self.cell)?)
    }

    /// `coverage.json`.
    fn report(
        &self,
        setup: &LinkSetup,
        plane: &CoveragePlane,
        gain: &Raster<f32>,
        range_dbm: [f64; 2],
        diffuse_directions: Option<usize>,
    ) -> Value {
        json!({
            "schema": "corf-coverage/1",
            "scene": setup.scene.name,
            "frequency_hz": setup.config.radio.frequency_hz,
            "tx_power_dbm": setup.link.tx_power_dbm,
            "quantity": "coverage.exr, channel Y: noncoherent path gain, the sum of |a|^2 over all paths of the strongest transmitter (transmit ports share the power, powers of receive ports add), linear, relative to 1 W transmitted; NaN where a closed body parts the cell's centre from the transmitter, and on surfaces",
            "picture": "coverage.png: received power, dBm; what lies outside of the range has the colour of its end",
            "range_dbm": range_dbm,
            "plane": {
                "frame": "world, metres, z up; the centre of (column, row) is corner + along_u*(column + 0.5)*cell_m + along_v*(rows - 0.5 - row)*cell_m: row 0 has the largest v",
                "corner": plane.corner.to_array(),
                "along_u": plane.along_u.to_array(),
                "along_v": plane.along_v.to_array(),
                "cell_m": plane.cell_m,
                "columns": plane.columns,
                "rows": plane.rows,
            },
            "cells_without_value": gain.pixels().iter().filter(|g| g.is_nan()).count(),
            "cells_not_reached": gain.pixels().iter().filter(|g| **g == 0.0).count(),
            "rssi_dbm": rssi_dbm(gain, setup.link.tx_power_dbm),
            "diffuse_directions": diffuse_directions,
            "settings": setup.link,
        })
    }
}

/// Cells whose centres lie near a transmitter.
struct Near {
    /// Within λ/2π: without a value of that transmitter.
    excluded: usize,
    /// Within 2λ.
    doubtful: usize,
}

impl Near {
    fn count(setup: &LinkSetup, plane: &CoveragePlane) -> Self {
        let frequency_hz = setup.config.radio.frequency_hz;
        let [refused_m, doubtful_m] = [near_field::refused_under_m(frequency_hz), near_field::doubtful_under_m(frequency_hz)];
        let mut count = Self { excluded: 0, doubtful: 0 };
        for i in 0..plane.columns * plane.rows {
            let centre = plane.centre(i % plane.columns, i / plane.columns);
            let distance_m = setup.transmitters.iter().map(|tx| tx.position.distance(centre)).fold(f64::INFINITY, f64::min);
            count.excluded += usize::from(distance_m < refused_m);
            count.doubtful += usize::from((refused_m..doubtful_m).contains(&distance_m));
        }
        count
    }
}

/// The path gain of every transmitter.
fn maps(setup: &LinkSetup, plane: &CoveragePlane, diffuse: &DiffuseSettings) -> Result<Vec<Raster<f32>>> {
    let total = setup.transmitters.len() * plane.rows;
    let mut progress = Progress::start("coverage", total, "rows");
    let mut maps = Vec::with_capacity(setup.transmitters.len());
    setup.each_transmitter(diffuse, |number, transmitter, field| {
        maps.push(coverage(transmitter, field, setup.solids(), plane, |rows| {
            progress.set(number * plane.rows + rows, total);
            interrupt::check()
        })?);
        Ok(())
    })?;
    progress.finish();
    Ok(maps)
}

/// Quantiles over the cells that are reached.
fn rssi_dbm(gain: &Raster<f32>, tx_power_dbm: f64) -> Value {
    let mut reached: Vec<f64> = gain.pixels().iter().filter(|g| **g > 0.0).map(|g| f64::from(*g)).collect();
    reached.sort_by(f64::total_cmp);
    let dbm = |gain: f64| ((10.0 * gain.log10() + tx_power_dbm) * 100.0).round() / 100.0;
    let quantile = |q: f64| {
        let i = (q * reached.len() as f64) as usize;
        reached.get(i.min(reached.len().saturating_sub(1))).map(|g| dbm(*g))
    };
    json!({ "min": quantile(0.0), "p5": quantile(0.05), "median": quantile(0.5), "p95": quantile(0.95), "max": quantile(1.0) })
}
