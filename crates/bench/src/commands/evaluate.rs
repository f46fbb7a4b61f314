//! `corf evaluate`: a run's field, or another program's predictions, against the held-out keyframes.

use super::{Verdict, show};
use crate::charts::ColourMap;
use crate::device::{Backend, DeviceChoice};
use crate::files::output::FreshFolder;
use crate::files::separation::{Reads, keep_apart};
use crate::metrics::input::Verify;
use crate::metrics::lpips::LpipsOption;
use crate::note;
use crate::record::prediction_folder::{PredictionFolder, PredictionWriter, stated_of};
use crate::record::{METRICS, Numbers, Outcome, Record};
use crate::report::along::Figures;
use crate::run::claim_shared;
use crate::run::evaluation;
use crate::run::harness;
use crate::run::open;
use crate::run::picture::Picture;
use crate::split::{Protocol, Split};
use crate::table;
use crate::terminal;
use crate::terminal::progress::Stage;
use anyhow::{Context, Result, ensure};
use clap::Args;
use corf_scene::dataset::Dataset;
use std::path::{Path, PathBuf};

/// `corf evaluate`.
#[derive(Args)]
pub struct Evaluate {
    /// Run folder of `corf reconstruct`.
    #[arg(conflicts_with = "predictions")]
    run: Option<PathBuf>,
    /// Instead of a run, a folder of predictions that any program wrote: images/*.png, and linear/*.exr or *.npy, scalar/*.png or jet/*.png, one
    /// file for every held-out keyframe (docs/METHODOLOGY.md has the layout).
    #[arg(long, value_name = "DIR", requires = "dataset")]
    predictions: Option<PathBuf>,
    /// Dataset folder: of a run if it has moved since, of predictions always.
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// Protocol of the predictions: the keyframes they were not trained with (default: what their predictions.json states, otherwise test).
    #[arg(long, value_name = "PROTOCOL", conflicts_with = "run")]
    protocol: Option<Protocol>,
    /// Also write the run's predictions of the held-out keyframes into this folder, as --predictions reads them.
    #[arg(long, value_name = "DIR", conflicts_with = "predictions")]
    write_predictions: Option<PathBuf>,
    /// Columns of the printed table, with commas between: keys, short, radio, all …; --help lists them.
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "KEY,KEY",
        default_value = "short",
        allow_hyphen_values = true,
        long_help = table::help_of_keys()
    )]
    columns: Vec<String>,
    /// Draw a held-out keyframe into this file (.svg): observed, predicted and the error of image and spectrum, with axes in degrees, peaks and a
    /// colour bar for each scale.
    #[arg(long, value_name = "FILE.svg")]
    figure: Option<PathBuf>,
    /// Index of that keyframe, from 0 (default: the held-out one that receives the most).
    #[arg(long, value_name = "K", requires = "figure")]
    figure_keyframe: Option<usize>,
    /// Colours of spectra in the figure.
    #[arg(long, value_enum, default_value_t, requires = "figure")]
    colours: ColourMap,
    #[command(flatten)]
    verify: Verify,
    /// Device that renders the field of a run, and that LPIPS is computed on: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
    #[command(flatten)]
    lpips: LpipsOption,
}

impl Evaluate {
    /// Runs the command; writes `metrics.json` and the figures along the way into the folder that was evaluated.
    ///
    /// # Errors
    /// A run, predictions or a dataset that cannot be read.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let columns = table::columns(&self.columns)?;
        let mut picture = Picture::plan(self.figure.as_deref(), self.figure_keyframe, self.colours)?;
        let (folder, (record, dataset), predictions) = match (&self.predictions, &self.run) {
            (Some(folder), _) => (folder, self.of_predictions(folder, &mut picture)?, None),
            (None, Some(run)) => {
                let (record, dataset, predictions) = self.of_run(run, &mut picture)?;
                (run, (record, dataset), predictions)
            }
            (None, None) => anyhow::bail!("nothing to evaluate\n  help: name a run folder, or predictions with --predictions"),
        };
        let _held = claim_shared(folder)?;
        let records = [record];
        let figures = Figures::of(&records, &dataset)?;
        records[0].write(&folder.join(METRICS))?;
        figures.iter().try_for_each(|figures| figures.write(folder))?;
        picture.as_ref().map_or(Ok(()), Picture::write)?;
        // Last, so that the command works again until all of it is done.
        predictions.map_or(Ok(()), FreshFolder::finish)?;
        show(json, &records[0], &table::plain(&table::rows(&records), &columns, terminal::width()))?;
        Ok(Verdict::Done)
    }

    fn of_predictions(&self, folder: &Path, picture: &mut Option<Picture>) -> Result<(Record, Dataset)> {
        let dataset = self.dataset.as_deref().context("predictions are of a dataset\n  help: name it with --dataset")?;
        ensure!(
            self.device == DeviceChoice::Auto || self.lpips.is_asked_for(),
            "--device: of predictions it says where LPIPS is computed, which is not asked for\n  help: leave it out, or give --lpips as well"
        );
        let backend = if self.lpips.is_asked_for() { self.device.resolve()? } else { Backend::Cpu };
        let networks = self.lpips.read(&backend)?;
        let input = self.verify.open_any(dataset)?.with_networks(&networks)?;
        let protocol = match self.protocol {
            Some(protocol) => protocol,
            None => PredictionFolder::stated(folder)?.protocol.unwrap_or_default(),
        };
        let split = Split::of(&input.dataset, protocol)?;
        let predictions = PredictionFolder::open(folder, &input.dataset, &split)?;
        if let Some(picture) = picture {
            picture.choose(&predictions.name(), &input.dataset, &split)?;
        }
        let evaluate = || {
            evaluation::evaluate_folder(&predictions, &input, &split, |truth, halves| {
                picture.as_mut().map_or(Ok(()), |picture| picture.look(truth, halves))
            })
        };
        let (frames, warnings) = Stage::of("evaluation on the held-out keyframes", evaluate)?;
        warnings.iter().for_each(|warning| note!("{warning}"));
        let seed = predictions.statement().seed.unwrap_or(0);
        let record = harness::folder_record(&predictions.name(), &predictions, &input, protocol, seed, frames);
        Ok((record, input.dataset))
    }

    fn of_run(&self, folder: &Path, picture: &mut Option<Picture>) -> Result<(Record, Dataset, Option<FreshFolder>)> {
        let backend = self.device.resolve()?;
        let networks = self.lpips.read(&backend)?;
        let mut run = open::open_any(folder, self.dataset.as_deref(), self.verify, &backend)?;
        if let Some(out) = &self.write_predictions {
            keep_apart("--write-predictions", out, &[Reads::Folder(folder), Reads::Folder(run.input.dataset.dir())])?;
        }
        ensure!(
            self.write_predictions.is_none() || run.input.dataset.fixed_array().is_none(),
            "--write-predictions: {} holds grey levels and no powers, which predictions in linear/ would be\n  help: leave it out",
            run.input.dataset.dir().display()
        );
        run.input = run.input.with_networks(&networks)?;
        let _held = claim_shared(folder)?;
        let dataset = &run.input.dataset;
        let writer = self.write_predictions.as_deref().map(|dir| PredictionWriter::create(dir, dataset)).transpose()?;
        if let Some(picture) = picture {
            picture.choose(&run.info.method, dataset, &run.split)?;
        }
        let stage = Stage::start("evaluation on the held-out keyframes");
        let frames = evaluation::evaluate(run.predictor.as_mut(), &run.input, &run.split, |truth, prediction| {
            picture.as_mut().map_or(Ok(()), |picture| picture.look(truth, prediction.halves()))?;
            writer.as_ref().map_or(Ok(()), |writer| writer.write(truth.index, prediction))
        })?;
        drop(stage);
        let info = &run.info;
        let predictions = writer.map(|writer| writer.finish(&stated_of(info, run.method.as_ref(), dataset))).transpose()?;
        let numbers =
            Numbers::of(frames, Some(info.seconds), info.gaussians, info.peak_memory_bytes, info.curve.clone(), info.latency)
                .with_device_memory(info.peak_device_memory_bytes)
                .with_depth(info.depth);
        let outcome = Outcome::Done(Box::new(numbers));
        let mut record = harness::record(&info.method, run.method.as_ref(), &run.input, info.protocol, info.seed, outcome);
        // The record is the run's, whoever evaluates it.
        record.provenance = info.provenance.clone();
        record.config = info.config.clone();
        record.device = info.device.clone();
        record.dataset_verified &= info.dataset_verified;
        Ok((record, run.input.dataset, predictions))
    }
}
