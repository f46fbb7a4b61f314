//! Predictions of the held-out keyframes beside what was observed.

use crate::methods::interface::Predictor;
use crate::metrics::input::Input;
use crate::metrics::{Evaluator, FrameMetrics, Halves, Prediction};
use crate::record::prediction_folder::{PredictionFolder, Tally};
use crate::split::Split;
use crate::terminal::interrupt;
use anyhow::{Context, Result};
use corf_scene::Keyframe;
use corf_scene::dataset::Dataset;
use rayon::prelude::*;

/// Memory for keyframes that are compared at once, bytes, and what a pixel of one takes: images, and in double precision what SSIM sums up.
const AT_ONCE_BYTES: usize = 2 << 30;
const PIXEL_BYTES: usize = 128;

/// The held-out keyframes, as many at a time as there are threads to compare them and memory to hold them; an interrupt ends them with its error.
fn held_out<'a>(dataset: &'a Dataset, split: &'a Split) -> impl Iterator<Item = Result<Vec<Keyframe>>> + 'a {
    let pixels = dataset.light_camera().width * dataset.light_camera().height;
    let at_once = (AT_ONCE_BYTES / PIXEL_BYTES / pixels.max(1)).clamp(1, rayon::current_num_threads());
    split.held_out.chunks(at_once).map(|some| {
        interrupt::check()?;
        let read = |&index: &usize| dataset.keyframe(index).with_context(|| format!("while reading held-out keyframe {index}"));
        some.par_iter().map(read).collect()
    })
}

/// Evaluates a predictor on the held-out keyframes; `look` sees every prediction beside its truth.
///
/// # Errors
/// Unreadable keyframes, images too small for a network, or a predictor that answers with an error.
pub fn evaluate(
    predictor: &mut dyn Predictor,
    input: &Input,
    split: &Split,
    mut look: impl FnMut(&Keyframe, &Prediction) -> Result<()>,
) -> Result<Vec<FrameMetrics>> {
    split.check_held_out()?;
    let evaluator = Evaluator::of(input);
    let mut frames = Vec::new();
    for truths in held_out(&input.dataset, split) {
        let truths = truths?;
        let mut predict = |truth: &Keyframe| -> Result<Prediction> {
            interrupt::check()?;
            Ok(predictor.render(&truth.world_from_camera)?.within(truth.modalities()))
        };
        let predictions = truths.iter().map(&mut predict).collect::<Result<Vec<_>>>()?;
        let pairs: Vec<_> = predictions.iter().map(Prediction::halves).zip(&truths).collect();
        frames.extend(evaluator.compare_all(&pairs)?);
        truths.iter().zip(&predictions).try_for_each(|(truth, prediction)| look(truth, prediction))?;
    }
    Ok(frames)
}

/// Scores another program's predictions of the held-out keyframes; `look` sees every one beside its truth. Returns the metrics and what has to
/// be said of the files.
///
/// # Errors
/// Unreadable keyframes or predictions.
pub fn evaluate_folder(
    folder: &PredictionFolder,
    input: &Input,
    split: &Split,
    mut look: impl FnMut(&Keyframe, Halves<'_>) -> Result<()>,
) -> Result<(Vec<FrameMetrics>, Vec<String>)> {
    split.check_held_out()?;
    let (dataset, evaluator) = (&input.dataset, Evaluator::of(input));
    let (mut frames, mut tally) = (Vec::new(), Tally::default());
    for truths in held_out(dataset, split) {
        let truths = truths?;
        let mut predicted = |truth: &Keyframe| folder.read(truth.index, dataset, &mut tally);
        let predictions = truths.iter().map(&mut predicted).collect::<Result<Vec<_>>>()?;
        let pairs: Vec<_> = predictions.iter().map(|predicted| predicted.halves()).zip(&truths).collect();
        frames.extend(evaluator.compare_all(&pairs)?);
        truths.iter().zip(&predictions).try_for_each(|(truth, predicted)| look(truth, predicted.halves()))?;
    }
    Ok((frames, folder.warnings(&tally, dataset.db_range().as_ref())))
}
