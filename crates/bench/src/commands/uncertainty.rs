//! `corf uncertainty`: how far predicted decibels may be off, and where to measure next.

use super::open_flags::OpenFlags;
use super::query::{check_inside, room};
use super::{Verdict, show};
use crate::charts::{self, ColourMap, Sensors};
use crate::device::Backend;
use crate::files::ending::check_file;
use crate::files::json::write_numbers;
use crate::files::separation::{Reads, keep_apart};
use crate::methods::interface::Predictor;
use crate::metrics::input::Verify;
use crate::render::poses::{PoseFile, PoseFrame};
use crate::run::open::{self, OpenRun};
use crate::split::{Holdout, Split};
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use crate::uncertainty::{Calibration, Coverage, Examples, Judged, NOMINAL, TrainingKeyframes, Worth, next};
use anyhow::{Context, Result, ensure};
use clap::{Args, Subcommand};
use corf_scene::words::counted;
use corf_scene::{Raster, Rigid3, io};
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// How far predicted decibels may be off, and where to measure next (docs/uncertainty.md).
#[derive(Subcommand)]
pub enum Uncertainty {
    /// Fit what the errors of a method look like on the held-out keyframes of a run that was made with --protocol validation, into a file.
    Fit(Fit),
    /// Hold the intervals of a calibration against the held-out keyframes of another run: how many errors lie within them, and how wide they are.
    Check(Check),
    /// The poses of a way that are worth measuring next, the best first.
    Next(Next),
}

/// A run, and what it is read with.
#[derive(Args)]
struct Of {
    /// Run folder of `corf reconstruct`.
    run: PathBuf,
    #[command(flatten)]
    opened: OpenFlags,
}

/// `corf uncertainty fit`.
#[derive(Args)]
pub struct Fit {
    #[command(flatten)]
    of: Of,
    /// File of the calibration (.json).
    #[arg(long, value_name = "FILE.json")]
    out: PathBuf,
    /// Runs of other seeds of the same method, data set and protocol: the spread of their predictions is calibrated as well, to be compared with.
    #[arg(long, value_name = "RUN,RUN", value_delimiter = ',')]
    ensemble: Vec<PathBuf>,
}

/// `corf uncertainty check`.
#[derive(Args)]
pub struct Check {
    #[command(flatten)]
    of: Of,
    /// File of `corf uncertainty fit`.
    #[arg(long, value_name = "FILE.json")]
    calibration: PathBuf,
    /// Runs of other seeds, as many as the calibration was fitted with: the intervals of their spread stand beside.
    #[arg(long, value_name = "RUN,RUN", value_delimiter = ',')]
    ensemble: Vec<PathBuf>,
    /// Write the numbers, of every keyframe, into this file.
    #[arg(long, value_name = "FILE.json")]
    out: Option<PathBuf>,
    /// Draw a held-out keyframe into this file: predicted, standard deviation and absolute error, with axes in degrees.
    #[arg(long, value_name = "FILE.svg")]
    figure: Option<PathBuf>,
    /// Index of that keyframe, from 0 (default: the one in the middle of the held-out ones).
    #[arg(long, value_name = "K", requires = "figure")]
    figure_keyframe: Option<usize>,
    /// Colours of spectra in the figure.
    #[arg(long, value_enum, default_value_t, requires = "figure")]
    colours: ColourMap,
}

/// `corf uncertainty next`.
#[derive(Args)]
pub struct Next {
    #[command(flatten)]
    of: Of,
    /// File of `corf uncertainty fit`.
    #[arg(long, value_name = "FILE.json")]
    calibration: PathBuf,
    /// The way: poses that could be measured, in the forms that `corf render --poses` takes.
    #[arg(long, value_name = "FILE")]
    poses: PathBuf,
    /// Frame that --poses is in, as for `corf render`.
    #[arg(long, value_enum)]
    poses_in: Option<PoseFrame>,
    /// Number of poses that are wanted.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
    count: u64,
}

/// A run with what its predictions are judged by.
struct Field {
    run: OpenRun,
    backend: Backend,
    surroundings: TrainingKeyframes,
}

/// Levels of a predicted spectrum, in `[0, 1]`.
fn levels(predictor: &mut dyn Predictor, pose: &Rigid3) -> Result<Raster<f32>> {
    interrupt::check()?;
    let prediction = predictor.render(pose)?;
    ensure!(
        prediction.is_finite(),
        "a pixel of a prediction is not a finite number\n  help: the field has diverged; reconstruct it with smaller rates"
    );
    Ok(prediction.radio.context("the method predicts no spectra")?.scalar)
}

impl Of {
    fn open(&self) -> Result<Field> {
        let (mut run, backend) = self.opened.open(&self.run)?;
        let train = run.split.train.clone();
        let mut progress = Progress::start("training keyframes", train.len(), "keyframes");
        let mut done = 0;
        let surroundings = TrainingKeyframes::of(&run.input.dataset, &train, |pose| {
            done += 1;
            progress.set(done, train.len());
            levels(run.predictor.as_mut(), pose)
        })?;
        progress.finish();
        Ok(Field { run, backend, surroundings })
    }

    fn keep_apart(&self, flag: &str, out: Option<&Path>, run: &OpenRun) -> Result<()> {
        out.map_or(Ok(()), |out| keep_apart(flag, out, &[Reads::Folder(&self.run), Reads::Folder(run.input.dataset.dir())]))
    }
}

/// The predictors of an ensemble beside a run: of the same method, data set and protocol.
fn ensemble(runs: &[PathBuf], beside: &Field, dataset: Option<&Path>) -> Result<Vec<OpenRun>> {
    let own = &beside.run.info;
    let one = |folder: &PathBuf| {
        let run = open::open(folder, dataset.or(Some(beside.run.input.dataset.dir())), Verify::DONE, &beside.backend)?;
        let same = (&run.info.method, &run.info.config, run.info.protocol) == (&own.method, &own.config, own.protocol);
        ensure!(
            same && run.info.seed != own.seed,
            "--ensemble: {} is not of the same method, settings and protocol with another seed\n  help: leave it out",
            folder.display()
        );
        Ok(run)
    };
    runs.iter().map(one).collect()
}

impl Field {
    /// Signs and errors of every held-out keyframe; `look` sees each with its prediction.
    fn examples(
        &mut self,
        others: &mut [OpenRun],
        mut look: impl FnMut(&Examples, &Raster<f32>, &Raster<f32>),
    ) -> Result<Vec<Examples>> {
        self.run.split.check_held_out()?;
        let (dataset, held_out) = (&self.run.input.dataset, &self.run.split.held_out);
        let mut out = Vec::with_capacity(held_out.len());
        let mut progress = Progress::start("held-out keyframes", held_out.len(), "keyframes");
        for (i, &index) in held_out.iter().enumerate() {
            let keyframe = dataset.keyframe(index).with_context(|| format!("while reading held-out keyframe {index}"))?;
            let (pose, radio) = (keyframe.world_from_camera, keyframe.radio.context("a held-out keyframe has no spectrum")?);
            let predicted = levels(self.run.predictor.as_mut(), &pose)?;
            let mut all = vec![self.surroundings.decibels(&predicted)];
            for other in others.iter_mut() {
                all.push(self.surroundings.decibels(&levels(other.predictor.as_mut(), &pose)?));
            }
            let examples = Examples {
                index,
                signs: self.surroundings.signs(&pose, &predicted)?,
                errors_db: self.surroundings.errors(&predicted, &radio.spectrum),
                spread_db: (all.len() > 1).then(|| spread(&all)),
            };
            look(&examples, &predicted, &radio.spectrum);
            out.push(examples);
            progress.set(i + 1, held_out.len());
        }
        progress.finish();
        Ok(out)
    }
}

/// Standard deviation over predictions, by pixel.
fn spread(all: &[Raster<f32>]) -> Vec<f64> {
    let n = all.len() as f64;
    let pixel = |i: usize| {
        let values = || all.iter().map(|raster| f64::from(raster.pixels()[i]));
        let mean = values().sum::<f64>() / n;
        (values().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()
    };
    (0..all[0].pixels().len()).map(pixel).collect()
}

/// Coverage in words.
fn line(name: &str, c: &Coverage) -> String {
    format!(
        "{name}: {:.1} % of errors within {:.0} % intervals, half a width of {:.2} dB in the mean, interval score {:.2} dB, rank correlation with \
         absolute errors {:.2}",
        100.0 * c.coverage,
        100.0 * NOMINAL,
        c.half_width_db,
        c.score_db,
        c.rank_correlation
    )
}

impl Uncertainty {
    /// Runs the sub-command.
    ///
    /// # Errors
    /// A run, a calibration or poses that cannot be read or do not belong together.
    pub fn run(self, json: bool) -> Result<Verdict> {
        match self {
            Self::Fit(c) => c.run(json),
            Self::Check(c) => c.run(json),
            Self::Next(c) => c.run(json),
        }
    }
}

impl Fit {
    fn run(self, json: bool) -> Result<Verdict> {
        check_file("--out", &self.out)?;
        let protocol = open::read_info(&self.of.run)?.protocol;
        ensure!(
            protocol.holdout != Holdout::Test && protocol.holdout != Holdout::All,
            "{} was made with the protocol \"{}\": intervals that are fitted on the keyframes that judge them say nothing\n  help: fit a run of the same \
             method that was made with --protocol validation",
            self.of.run.display(),
            protocol.name()
        );
        let mut field = self.of.open()?;
        self.of.keep_apart("--out", Some(&self.out), &field.run)?;
        let mut others = ensemble(&self.ensemble, &field, self.of.opened.dataset.as_deref())?;
        let examples = field.examples(&mut others, |_, _, _| ())?;
        let (info, dataset) = (&field.run.info, &field.run.input.dataset);
        let of = [dataset.header().name.as_str(), dataset.hash()];
        let calibration = Calibration::fit(&info.method, of, info.protocol, &examples, others.len() + 1)?;
        calibration.write(&self.out)?;
        let text = format!(
            "{}: fitted on {} of {}; each left out in turn, {:.1} % of errors are within the 90 % intervals ({:.1} % at the worst keyframe)",
            self.out.display(),
            counted(calibration.keyframes, "held-out keyframe"),
            calibration.dataset,
            100.0 * calibration.coverage_left_out,
            100.0 * calibration.least_coverage_left_out
        );
        show(json, &calibration, &text)?;
        Ok(Verdict::Done)
    }
}

impl Check {
    fn run(self, json: bool) -> Result<Verdict> {
        let info = open::read_info(&self.of.run)?;
        let calibration = Calibration::read(&self.calibration, &info.method)?;
        self.out.as_deref().map_or(Ok(()), |out| check_file("--out", out))?;
        if let Some(figure) = &self.figure {
            ensure!(
                figure.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg")),
                "--figure {}: figures are SVG\n  help: give a file that ends in .svg",
                figure.display()
            );
        }
        let of_ensemble = calibration.ensemble.filter(|_| !self.ensemble.is_empty());
        ensure!(
            self.ensemble.is_empty() || of_ensemble.is_some_and(|e| e.runs == self.ensemble.len() + 1),
            "--ensemble: {} runs, and {} was fitted with {}\n  help: fit it with as many",
            self.ensemble.len() + 1,
            self.calibration.display(),
            calibration.ensemble.map_or("none".to_owned(), |e| e.runs.to_string())
        );
        let mut field = self.of.open()?;
        for (flag, out) in [("--out", &self.out), ("--figure", &self.figure)] {
            self.of.keep_apart(flag, out.as_deref(), &field.run)?;
        }
        field.run.split.check_held_out()?;
        let held_out = &field.run.split.held_out;
        if calibration.dataset_hash == info.dataset_hash {
            let fitted = Split::of(&field.run.input.dataset, calibration.protocol)?.held_out;
            let both = held_out.iter().filter(|k| fitted.contains(k)).count();
            ensure!(
                both == 0,
                "{} was fitted on {both} of the {} that this run holds out: of course it fits them\n  help: check a run that was made with --protocol \
                 test",
                self.calibration.display(),
                counted(held_out.len(), "keyframe")
            );
        }
        let shown = self.figure_keyframe.unwrap_or(held_out[held_out.len() / 2]);
        ensure!(
            held_out.contains(&shown),
            "--figure-keyframe {shown}: it is not held out\n  help: held out are {}",
            held_out.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")
        );
        let mut others = ensemble(&self.ensemble, &field, self.of.opened.dataset.as_deref())?;
        let mut figure = None;
        let sensors = Sensors::of(&field.run.input.dataset);
        let title = format!("{}: held-out keyframe {} of {}", info.method, shown + 1, field.run.input.dataset.header().name);
        let examples = field.examples(&mut others, |examples, predicted, _| {
            if self.figure.is_some() && examples.index == shown {
                let raster = |values: Vec<f64>| Raster::from_vec(predicted.width(), predicted.height(), values);
                let deviations = raster(calibration.deviations_db(&examples.signs)).map(|v| *v as f32);
                let errors = raster(examples.errors_db.clone()).map(|v| v.abs() as f32);
                figure = Some(charts::uncertainty(&title, predicted, [&deviations, &errors], &sensors, self.colours));
            }
        })?;
        let own: Vec<Judged<'_>> = examples.iter().map(|e| calibration.judge(e)).collect();
        let nothing = || "no pixel was judged";
        let own = Coverage::of(&own).with_context(nothing)?;
        let mut text = line(&format!("{} on {}", info.method, counted(own.frames.len(), "held-out keyframe")), &own);
        let ensemble = match of_ensemble {
            Some(of) => {
                let judged: Vec<Judged<'_>> = examples.iter().filter_map(|e| of.judge(e)).collect();
                let coverage = Coverage::of(&judged).with_context(nothing)?;
                let _ = write!(text, "\n{}", line(&format!("the spread of {}", counted(of.runs, "run")), &coverage));
                Some(coverage)
            }
            None => None,
        };
        let mut document = json!({ "run": self.of.run, "nominal": NOMINAL, "calibrated": own });
        if let Some(ensemble) = ensemble {
            document["ensemble"] = json!(ensemble);
        }
        if let Some(out) = &self.out {
            write_numbers(out, &document)?;
        }
        if let (Some(svg), Some(file)) = (figure, &self.figure) {
            io::write_atomic(file, svg?.as_bytes())?;
        }
        show(json, &document, &text)?;
        Ok(Verdict::Done)
    }
}

impl Next {
    fn run(self, json: bool) -> Result<Verdict> {
        let info = open::read_info(&self.of.run)?;
        let calibration = Calibration::read(&self.calibration, &info.method)?;
        let file = PoseFile::read(&self.poses)?;
        let mut field = self.of.open()?;
        let (way, _) = file.in_world_of(&field.run.input.dataset, self.poses_in)?;
        let room = room(field.run.predictor.as_ref(), &field.run.input.dataset);
        check_inside(&self.poses.display().to_string(), &way, &room, "leave these poses out")?;
        let predictor = field.run.predictor.as_mut();
        let mut progress = Progress::start("poses of the way", way.len(), "poses");
        let mut done = 0;
        let worth = next(&field.surroundings, &calibration, &way, usize::try_from(self.count)?, |pose| {
            done += 1;
            progress.set(done, way.len());
            levels(predictor, pose)
        })?;
        progress.finish();
        let mut text = "pose  standard deviation, dB  nearest training keyframe, m  gain along the way, dB".to_owned();
        for Worth { pose, deviation_db, nearest_m, gain_db } in &worth {
            let _ = write!(text, "\n{pose:4}  {deviation_db:22.2}  {nearest_m:28.2}  {gain_db:22.3}");
        }
        show(json, &worth, &text)?;
        Ok(Verdict::Done)
    }
}
