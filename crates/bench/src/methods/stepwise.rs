//! Reconstructions that work in steps: portions that follow the clock, progress, checkpoints, interrupts.

use crate::methods::interface::{Advance, Checkpoints, FieldReader, Predictor, PredictorReader};
use crate::note;
use anyhow::{Context, Result};
use corf::Field;
use corf_scene::words::counted;
use std::cell::RefCell;
use std::path::Path;
use std::time::{Duration, Instant};

/// Steps between two reports of progress take about this long: short enough to be interrupted, long enough not to cost anything.
const PORTION: Duration = Duration::from_millis(300);
/// Most steps between two reports.
const MOST_STEPS: usize = 200;

/// A reconstruction that has received its keyframes.
pub trait Stepwise {
    /// Begins it.
    ///
    /// # Errors
    /// Its own.
    fn begin(&mut self) -> corf::Result<()>;

    /// Goes on from a checkpoint's file instead, whose tag it checks.
    ///
    /// # Errors
    /// A file that is damaged or of something else; its own.
    fn resume(&mut self, path: &Path, checkpoints: &Checkpoints) -> Result<()>;

    /// Writes a checkpoint with a tag.
    ///
    /// # Errors
    /// Its own; a file that cannot be written.
    fn keep(&mut self, path: &Path, tag: &str) -> corf::Result<()>;

    /// Takes the next steps, `most` at most.
    ///
    /// # Errors
    /// Its own.
    fn train(&mut self, most: usize) -> corf::Result<()>;

    /// Steps taken so far.
    fn steps_done(&self) -> usize;

    /// Number of Gaussians held.
    fn gaussian_count(&mut self) -> usize;

    /// The field as it stands, where a rasteriser could draw it.
    fn field(&mut self) -> Option<Field> {
        None
    }

    /// What predicts as the work stands, of methods that say so ([`crate::methods::interface::Method::predicts_at_work`]).
    ///
    /// # Errors
    /// The device's.
    fn predictor(&mut self) -> Result<Option<Box<dyn Predictor>>> {
        Ok(None)
    }
}

/// Takes all `total` steps, or those that are left; returns how many came from a checkpoint.
///
/// # Errors
/// The reconstruction's, and whatever `advance` answers (an interrupt), behind a checkpoint of what was done.
pub fn run(
    reconstruction: &mut dyn Stepwise,
    total: usize,
    checkpoints: Option<&Checkpoints>,
    advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
) -> Result<usize> {
    let mut checkpointer = Checkpointer { checkpoints, kept: None, at: Instant::now() };
    let resumed = checkpointer.begin(reconstruction)?;
    let mut portion = 1;
    while reconstruction.steps_done() < total {
        let start = Instant::now();
        let most = checkpointer.steps_to_checkpoint(reconstruction.steps_done()).min(portion);
        reconstruction.train(most).map_err(|e| checkpointer.explain(e.into()))?;
        portion = next_portion(most, start.elapsed());
        let done = reconstruction.steps_done();
        if checkpointer.is_due(done) && done < total {
            checkpointer.keep(reconstruction)?;
        }
        let gaussians = Some(reconstruction.gaussian_count());
        let held = RefCell::new(&mut *reconstruction);
        let read = || held.borrow_mut().field();
        let make = || held.borrow_mut().predictor();
        let (field, predictor) = (Some(FieldReader::new(&read)), Some(PredictorReader::new(&make)));
        advance(Advance { gaussians, resumed_steps: resumed, field, predictor, ..Advance::of(done, total) }).inspect_err(
            |_| {
                // An interrupt: what could not be kept is done again.
                if checkpointer.kept != Some(done) {
                    report_unless_kept(checkpointer.keep(reconstruction));
                }
            },
        )?;
    }
    Ok(resumed)
}

/// Says what kept the state from being kept at an interrupt, which itself goes on.
pub fn report_unless_kept(kept: Result<()>) {
    if let Err(error) = kept {
        note!("the state at the interrupt is not kept: {error:#}");
    }
}

/// Number of steps that should take [`PORTION`], after `count` that took `took`; it grows and shrinks by a factor of two at most.
fn next_portion(count: usize, took: Duration) -> usize {
    let wanted = count as f64 * PORTION.as_secs_f64() / took.as_secs_f64().max(1e-6);
    (wanted as usize).clamp((count / 2).max(1), (2 * count).min(MOST_STEPS))
}

/// Keeps checkpoints, if any are wanted.
struct Checkpointer<'a> {
    checkpoints: Option<&'a Checkpoints>,
    /// Steps in the last one.
    kept: Option<usize>,
    /// When it was kept, or the work began.
    at: Instant,
}

impl Checkpointer<'_> {
    /// Begins, or goes on from the checkpoint, if there is one; says how many steps it has behind it.
    fn begin(&mut self, reconstruction: &mut dyn Stepwise) -> Result<usize> {
        let Some((c, path)) = self.checkpoints.and_then(|c| Some((c, c.to_resume()?))) else {
            reconstruction.begin()?;
            return Ok(0);
        };
        reconstruction.resume(path, c)?;
        let steps = reconstruction.steps_done();
        self.kept = Some(steps);
        c.holds(steps, "steps");
        Ok(steps)
    }

    /// Number of steps up to the next at which a checkpoint was asked for.
    fn steps_to_checkpoint(&self, done: usize) -> usize {
        match self.checkpoints.and_then(|c| c.every) {
            None | Some(0) => usize::MAX,
            Some(every) => every - done % every,
        }
    }

    fn is_due(&self, done: usize) -> bool {
        self.checkpoints.is_some_and(|c| c.is_due(done, self.at))
    }

    fn keep(&mut self, reconstruction: &mut dyn Stepwise) -> Result<()> {
        let Some(c) = self.checkpoints.filter(|c| c.are_kept()) else { return Ok(()) };
        reconstruction.keep(&c.path, &c.written_tag()).context("while keeping a checkpoint")?;
        let steps = reconstruction.steps_done();
        (self.kept, self.at) = (Some(steps), Instant::now());
        c.holds(steps, "steps");
        Ok(())
    }

    /// A reconstruction's error with what survives it.
    fn explain(&self, error: anyhow::Error) -> anyhow::Error {
        match (self.checkpoints, self.kept) {
            (Some(c), Some(kept)) => error.context(format!(
                "the last checkpoint, {}, holds {}: --resume goes on from it",
                c.path.display(),
                counted(kept, "step")
            )),
            _ => error,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn portions_follow_the_clock_and_end_at_checkpoints() {
        let ms = Duration::from_millis;
        assert_eq!((next_portion(1, ms(1)), next_portion(100, ms(100)), next_portion(200, ms(1))), (2, 200, 200));
        assert_eq!((next_portion(64, ms(600)), next_portion(64, ms(60_000)), next_portion(1, ms(60_000))), (32, 32, 1));
        let (tag, device) = (String::new(), "cpu (1 thread)".to_owned());
        let checkpoints = Checkpoints { path: "run/checkpoint".into(), every: Some(40), resume: false, tag, device };
        let mut checkpointer = Checkpointer { checkpoints: Some(&checkpoints), kept: None, at: Instant::now() };
        assert_eq!((checkpointer.steps_to_checkpoint(0), checkpointer.steps_to_checkpoint(79)), (40, 1));
        assert!(checkpointer.is_due(80) && !checkpointer.is_due(81));
        let lost = || anyhow::anyhow!("the device was lost");
        assert!(!format!("{:#}", checkpointer.explain(lost())).contains("checkpoint"), "there is none yet");
        checkpointer.kept = Some(80);
        let text = format!("{:#}", checkpointer.explain(lost()));
        assert!(text.contains("run/checkpoint") && text.contains("80 steps") && text.contains("lost"), "{text}");
    }
}
