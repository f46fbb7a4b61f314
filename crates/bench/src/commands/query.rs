//! `corf query`: what a radio field says of many places in a few numbers each.

use super::open_flags::OpenFlags;
use super::{Verdict, print, show};
use crate::files::ending::{check_file, ending};
use crate::files::separation::{Reads, keep_apart};
use crate::methods::interface::{NO_RADIO, Predictor};
use crate::metrics::aggregates::{Aggregates, Aggregator};
use crate::metrics::rate::{TARGET_RATE_BPS_HZ, TRANSMIT_POWER_DBM, budget_of};
use crate::note;
use crate::render::poses::{PoseFile, PoseFrame};
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::{Context, Result, ensure};
use clap::Args;
use corf_scene::dataset::Dataset;
use corf_scene::io::write_atomic;
use corf_scene::npz::{Array, Values, encode_npz};
use corf_scene::words::counted;
use corf_scene::{Error, Raster, Rigid3};
use glam::DVec3;
use rayon::prelude::*;
use serde_json::json;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Instant;

/// Groups of spectra that wait to be summed up, at most.
const WAITING: usize = 2;
/// Rates that can be asked for, bit/s/Hz, and powers that are sent, dBm.
const RATES_BPS_HZ: std::ops::RangeInclusive<f64> = 0.0..=100.0;
const POWERS_DBM: std::ops::RangeInclusive<f64> = -100.0..=100.0;

/// `corf query`.
#[derive(Args)]
pub struct Query {
    /// Run folder of `corf reconstruct`.
    run: PathBuf,
    /// Poses: a .csv with columns x_m, y_m, z_m and yaw_deg (pitch_deg, roll_deg) or qw, qx, qy, qz; a trajectory in TUM's layout (.txt, .tum: timestamp
    /// tx ty tz qx qy qz qw); or JSON as `corf render` takes it. Camera axes are OpenCV's, the frame is the dataset's world (or --poses-in).
    #[arg(long)]
    poses: PathBuf,
    /// Frame that --poses is in, where the run's dataset was imported and turned, scaled or moved.
    #[arg(long, value_enum)]
    poses_in: Option<PoseFrame>,
    /// Output file, .csv or .npz; without it, CSV on standard output.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Rate below which a place is in outage, bit/s/Hz.
    #[arg(long, value_name = "BPS_HZ", default_value_t = TARGET_RATE_BPS_HZ, allow_hyphen_values = true)]
    target_rate: f64,
    /// Transmit power behind rssi_dbm, rates and outage, dBm; noise is that of the tables.
    #[arg(long, value_name = "DBM", default_value_t = TRANSMIT_POWER_DBM, allow_hyphen_values = true)]
    tx_power: f64,
    /// Answer outside of the room as well, where nothing was ever seen.
    #[arg(long)]
    anywhere: bool,
    #[command(flatten)]
    opened: OpenFlags,
}

/// The form of the answer's file.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Csv,
    Npz,
}

/// A column: its name, and a value a pose, none where there is none.
struct Column(&'static str, Vec<Option<f64>>);

impl Query {
    /// Runs the command.
    ///
    /// # Errors
    /// A run that cannot be read or has no radio; poses that are none, or outside of the room; an output of another ending.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let form = self.form()?;
        for (flag, value, range) in [("--target-rate", self.target_rate, RATES_BPS_HZ), ("--tx-power", self.tx_power, POWERS_DBM)]
        {
            let help = format!("give {} to {}", range.start(), range.end());
            ensure!(range.contains(&value), "{flag} {value}: the value is out of range\n  help: {help}");
        }
        let file = PoseFile::read(&self.poses)?;
        let (mut run, _) = self.opened.open(&self.run)?;
        let dataset = &run.input.dataset;
        if let Some(out) = &self.out {
            keep_apart("--out", out, &[Reads::Folder(&self.run), Reads::Folder(dataset.dir()), Reads::File(&self.poses)])?;
        }
        let range = dataset.db_range().context(NO_RADIO)?;
        let (poses, frame) = file.in_world_of(dataset, self.poses_in)?;
        if !self.anywhere {
            let room = room(run.predictor.as_ref(), dataset);
            check_inside(&self.poses.display().to_string(), &poses, &room, "--anywhere answers nevertheless")?;
        }
        let aggregator = Aggregator::new(dataset.radio_camera(), range, dataset.header().quantity, self.tx_power);
        let begin = Instant::now();
        let all = aggregates(run.predictor.as_mut(), &aggregator, &poses)?;
        let seconds = begin.elapsed().as_secs_f64();
        let columns = self.columns(&poses, &all);
        let empty = aggregator.left_empty();
        empty.iter().for_each(|(column, why)| note!("{column} is empty: {why}"));
        let outage = columns.iter().find(|c| c.0 == "outage").map(|c| c.1.iter().flatten().copied().collect::<Vec<_>>());
        let share = outage.filter(|o| !o.is_empty()).map(|o| o.iter().sum::<f64>() / o.len() as f64);
        let mut summary = json!({
            "run": self.run,
            "method": run.info.method,
            "poses": poses.len(),
            "poses_in": frame,
            "seconds": seconds,
            "target_rate_bps_hz": self.target_rate,
            "tx_power_dbm": self.tx_power,
            "outage_share": share,
            "left_empty": empty.iter().map(|(column, why)| json!({ "column": column, "why": why })).collect::<Vec<_>>(),
            "out": self.out,
        });
        let text = match (&self.out, form) {
            (None, _) if json => {
                let values = columns.iter().map(|Column(name, values)| ((*name).to_owned(), json!(values)));
                summary["columns"] = values.collect::<serde_json::Map<_, _>>().into();
                String::new()
            }
            (None, _) => return print(csv(&columns).trim_end()).map(|()| Verdict::Done),
            (Some(out), form) => {
                let bytes = match form {
                    Form::Csv => csv(&columns).into_bytes(),
                    Form::Npz => encode_npz(&columns.iter().map(Column::array).collect::<Vec<_>>())?,
                };
                write_atomic(out, &bytes)?;
                let mut text = format!(
                    "{} in {seconds:.2} s ({:.0} a second), in {}",
                    counted(poses.len(), "pose"),
                    poses.len() as f64 / seconds.max(1e-9),
                    out.display()
                );
                if let Some(share) = share {
                    text += &format!(
                        "\nin outage: {:.1} % of them, below {} bit/s/Hz with {}",
                        100.0 * share,
                        self.target_rate,
                        budget_of(self.tx_power)
                    );
                }
                text
            }
        };
        show(json, &summary, &text)?;
        Ok(Verdict::Done)
    }

    fn form(&self) -> Result<Form> {
        let Some(out) = &self.out else { return Ok(Form::Csv) };
        check_file("--out", out)?;
        match ending(out).as_deref() {
            Some("csv") => Ok(Form::Csv),
            Some("npz") => Ok(Form::Npz),
            _ => {
                let what = "aggregates are written as CSV or as NPZ";
                Err(Error::invalid(format!("--out {}", out.display()), what, "give --out FILE.csv or --out FILE.npz").into())
            }
        }
    }

    /// All columns in their order.
    fn columns(&self, poses: &[Rigid3], all: &[Aggregates]) -> Vec<Column> {
        let of = |name, value: &dyn Fn(&Aggregates) -> Option<f64>| Column(name, all.iter().map(value).collect());
        let at = |name, value: &dyn Fn(&Rigid3) -> f64| Column(name, poses.iter().map(|pose| Some(value(pose))).collect());
        vec![
            Column("index", (0..poses.len()).map(|i| Some(i as f64)).collect()),
            at("x_m", &|pose| pose.translation.x),
            at("y_m", &|pose| pose.translation.y),
            at("z_m", &|pose| pose.translation.z),
            of("path_gain_db", &|a| a.path_gain_db),
            of("rssi_dbm", &|a| a.rssi_dbm),
            of("peak_azimuth_deg", &|a| Some(a.peak?.azimuth_deg)),
            of("peak_elevation_deg", &|a| Some(a.peak?.elevation_deg)),
            of("peak_db", &|a| Some(a.peak?.db)),
            of("best_beam", &|a| Some(a.beam?.number as f64)),
            of("best_beam_gain_db", &|a| Some(a.beam?.gain_db)),
            of("azimuth_spread_deg", &|a| a.azimuth_spread_deg),
            of("zenith_spread_deg", &|a| a.zenith_spread_deg),
            of("rate_bps_hz", &|a| a.rate_bps_hz),
            of("outage", &|a| Some(f64::from(u8::from(a.rate_bps_hz? < self.target_rate)))),
        ]
    }
}

impl Column {
    /// Its values, NaN where there is none.
    fn array(&self) -> Array {
        let values = self.1.iter().map(|value| value.unwrap_or(f64::NAN)).collect();
        Array::new(self.0, &[self.1.len()], Values::F64(values))
    }
}

/// A line of names, then a line a pose; fields without a value are empty.
fn csv(columns: &[Column]) -> String {
    let line = |fields: Vec<String>| fields.join(",") + "\n";
    let mut text = line(columns.iter().map(|column| column.0.to_owned()).collect());
    for row in 0..columns.first().map_or(0, |column| column.1.len()) {
        // The shortest digits that are read back as the same number.
        text += &line(columns.iter().map(|column| column.1[row].map_or(String::new(), |v| v.to_string())).collect());
    }
    text
}

/// The box of the room: all keyframes, and what the field knows of it; of a field that has no places, as much again around the keyframes.
pub(super) fn room(predictor: &dyn Predictor, dataset: &Dataset) -> [DVec3; 2] {
    let places = || dataset.poses().iter().map(|pose| pose.world_from_camera.translation);
    let (least, most) = (places().fold(DVec3::INFINITY, DVec3::min), places().fold(DVec3::NEG_INFINITY, DVec3::max));
    match predictor.room_m() {
        Some([low, high]) => [least.min(low), most.max(high)],
        None => {
            let around = DVec3::splat((most - least).max_element());
            [least - around, most + around]
        }
    }
}

/// Refuses poses outside of the room; `help` says what else can be done.
pub(super) fn check_inside(place: &str, poses: &[Rigid3], [least, most]: &[DVec3; 2], help: &str) -> Result<()> {
    let is_outside = |pose: &Rigid3| pose.translation.cmplt(*least).any() || pose.translation.cmpgt(*most).any();
    let Some(first) = poses.iter().position(is_outside) else { return Ok(()) };
    let others = poses.iter().filter(|pose| is_outside(pose)).count() - 1;
    let more = if others > 0 { format!(", and {} besides", counted(others, "other")) } else { String::new() };
    let at = poses[first].translation;
    let what = format!(
        "({:.2}, {:.2}, {:.2}) m is outside of the room{more}: what the field knows lies between ({:.2}, {:.2}, {:.2}) and ({:.2}, {:.2}, {:.2}) m",
        at.x, at.y, at.z, least.x, least.y, least.z, most.x, most.y, most.z
    );
    let help =
        format!("positions are metres in the data set's world (--poses-in capture for those of an imported capture); {help}");
    Err(Error::invalid(format!("{place}: pose {first}"), what, help).into())
}

/// The aggregates at poses, in their order: spectra of some are formed while those before them are summed up.
fn aggregates(predictor: &mut dyn Predictor, aggregator: &Aggregator, poses: &[Rigid3]) -> Result<Vec<Aggregates>> {
    let mut progress = Progress::start("asking the field", poses.len(), "poses");
    let all = std::thread::scope(|scope| -> Result<Vec<Aggregates>> {
        let (sender, spectra) = sync_channel(WAITING);
        let summing = scope.spawn(move || summed_up(aggregator, &spectra));
        let mut done = 0;
        let formed = predictor.spectra(poses, &mut |some| {
            interrupt::check()?;
            done += some.len();
            sender.send(some).context("nobody sums the spectra up")?;
            progress.set(done, poses.len());
            Ok(())
        });
        drop(sender);
        // Whoever sums up and is gone before the last spectrum has said why.
        let all = summing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        formed.map(|()| all)
    })?;
    progress.finish();
    Ok(all)
}

/// The aggregates of spectra as they come, all that wait at once.
fn summed_up(aggregator: &Aggregator, spectra: &Receiver<Vec<Raster<f32>>>) -> Result<Vec<Aggregates>> {
    let mut all = Vec::new();
    while let Ok(first) = spectra.recv() {
        let waiting: Vec<Raster<f32>> = first.into_iter().chain(spectra.try_iter().flatten()).collect();
        let before = all.len();
        let some: Vec<Option<Aggregates>> =
            waiting.par_iter().map(|scalar| finite(scalar).then(|| aggregator.of(scalar))).collect();
        all.extend(some.into_iter().map_while(|aggregates| aggregates));
        ensure!(
            all.len() == before + waiting.len(),
            "pose {}: a pixel of the spectrum is not a finite number\n  help: the field has diverged; reconstruct it with smaller rates",
            all.len()
        );
    }
    Ok(all)
}

fn finite(scalar: &Raster<f32>) -> bool {
    scalar.pixels().iter().all(|v| v.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::interface::Take;
    use crate::metrics::Prediction;
    use corf_scene::Pinhole;
    use corf_scene::dataset::Quantity;
    use corf_scene::keyframe::DbRange;
    use glam::DMat3;

    fn at(x: f64) -> Rigid3 {
        Rigid3 { rotation: DMat3::IDENTITY, translation: DVec3::new(x, 0.0, 0.0) }
    }

    #[test]
    fn a_place_outside_is_named_with_the_room() {
        let room = [DVec3::splat(-1.0), DVec3::splat(2.0)];
        check_inside("p.csv", &[at(-1.0), at(2.0)], &room, "").unwrap();
        let said = check_inside("p.csv", &[at(0.0), at(2.5), at(-7.0)], &room, "--anywhere").unwrap_err().to_string();
        for part in ["p.csv: pose 1", "(2.50, 0.00, 0.00) m is outside", "and 1 other besides", "--anywhere"] {
            assert!(said.contains(part), "{part} in {said}");
        }
    }

    const RANGE: DbRange = DbRange { min_db: -120.0, max_db: -40.0 };

    fn camera() -> Pinhole {
        Pinhole::from_horizontal_fov(6, 4, 90.0)
    }

    /// Spectra of the brightness that the place says, so many at a time, and no number at one place.
    struct Bright {
        at_once: usize,
        diverged_at_m: f64,
    }

    impl Predictor for Bright {
        fn render(&mut self, _: &Rigid3) -> Result<Prediction> {
            unreachable!("spectra alone are asked for")
        }

        fn spectra(&mut self, poses: &[Rigid3], take: Take<'_>) -> Result<()> {
            let level = |x: f64| if x == self.diverged_at_m { f32::NAN } else { (x / 100.0) as f32 };
            let spectrum = |pose: &Rigid3| Raster::filled(6, 4, level(pose.translation.x));
            poses.chunks(self.at_once).try_for_each(|some| take(some.iter().map(spectrum).collect()))
        }

        fn save(&self, _: &std::path::Path) -> Result<()> {
            unreachable!("nothing is saved")
        }
    }

    #[test]
    fn answers_are_in_the_order_of_poses_however_spectra_come() {
        let aggregator = Aggregator::new(camera(), RANGE, Quantity::PowerPerSteradian, TRANSMIT_POWER_DBM);
        let poses: Vec<Rigid3> = (1..100).map(|x| at(f64::from(x))).collect();
        let ask = |at_once, diverged_at_m| aggregates(&mut Bright { at_once, diverged_at_m }, &aggregator, &poses);
        let one_by_one = ask(1, -1.0).unwrap();
        assert_eq!(one_by_one.len(), poses.len());
        assert!(one_by_one.windows(2).all(|pair| pair[0].path_gain_db < pair[1].path_gain_db));
        for at_once in [7, 64, 99] {
            assert!(ask(at_once, -1.0).unwrap() == one_by_one, "{at_once}");
        }
        for at_once in [1, 7, 99] {
            let said = ask(at_once, 60.0).unwrap_err().to_string();
            assert!(said.starts_with("pose 59: a pixel of the spectrum is not a finite number"), "{said}");
        }
    }

    #[test]
    fn a_table_has_a_line_a_pose_and_nothing_where_nothing_is() {
        let columns = [Column("a", vec![Some(0.1), None]), Column("b", vec![Some(-70.0), Some(1.0)])];
        assert_eq!(csv(&columns), "a,b\n0.1,-70\n,1\n");
    }
}
