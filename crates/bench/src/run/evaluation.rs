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

/// The held-out keyframes, read one by one; an interrupt ends them with its error.
fn held_out<'a>(dataset: &'a Dataset, split: &'a Split) -> impl Iterator<Item = Result<Keyframe>> + 'a {
    split.held_out.iter().map(|&index| {
        interrupt::check()?;
        dataset.keyframe(index).with_context(|| format!("while reading held-out keyframe {index}"))
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
    for truth in held_out(&input.dataset, split) {
        let truth = truth?;
        let prediction = predictor.render(&truth.world_from_camera)?.within(truth.modalities());
        frames.push(evaluator.compare(prediction.halves(), &truth));
        look(&truth, &prediction)?;
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
    for truth in held_out(dataset, split) {
        let truth = truth?;
        let predicted = folder.read(truth.index, dataset, &mut tally)?;
        frames.push(evaluator.compare(predicted.halves(), &truth));
        look(&truth, predicted.halves())?;
    }
    Ok((frames, folder.warnings(&tally, dataset.db_range().as_ref())))
}
