//! Keyframe after keyframe through a reconstructor, with checkpoints on the way.

use crate::methods::interface::{Advance, Checkpoints, FieldReader, TrainingSet, shown};
use crate::methods::stepwise::report_unless_kept;
use anyhow::{Context, Result};
use corf::{Checkpoint, KeyframeTiming, Reconstructor};
use corf_scene::words::counted;
use std::cell::RefCell;
use std::path::Path;
use std::time::Instant;

/// The online part of a reconstruction.
pub(super) struct Online<'a> {
    pub reconstructor: Reconstructor,
    pub training: &'a TrainingSet<'a>,
    pub checkpointer: Checkpointer,
    /// Units of the whole reconstruction.
    pub total: usize,
    /// Keyframes of which the harness has been told.
    pub reported: usize,
}

impl Online<'_> {
    /// Takes every training keyframe, from the checkpoint on if there is one.
    pub fn run(&mut self, advance: &mut dyn FnMut(Advance<'_>) -> Result<()>) -> Result<()> {
        let first = self.resume()?;
        for k in first..self.training.len() {
            let before = self.training.loading_time();
            let keyframe = self.training.keyframe(k)?;
            self.reconstructor.discount_wait(self.training.loading_time() - before);
            self.reconstructor.receive(keyframe)?;
            while self.reconstructor.waiting() >= self.reconstructor.worth_receiving() {
                self.process(advance)?;
            }
        }
        while self.reconstructor.waiting() > 0 {
            self.process(advance)?;
        }
        Ok(())
    }

    /// Timing of the next keyframe that the harness has not been told of, once its optimisation has ended.
    pub fn next_timing(&mut self) -> Option<KeyframeTiming> {
        let timing = self.reconstructor.timings().get(self.reported).copied();
        self.reported += usize::from(timing.is_some());
        timing
    }

    /// Restores the checkpoint, if there is one, and replays its keyframes; returns their number.
    fn resume(&mut self) -> Result<usize> {
        let Some(checkpoint) = self.checkpointer.read()? else { return Ok(0) };
        self.reconstructor.restore(&checkpoint)?;
        let count = checkpoint.keyframes().len();
        for k in 0..count {
            self.reconstructor.replay(self.training.keyframe(k)?)?;
        }
        self.checkpointer.resumed(count);
        Ok(count)
    }

    /// One keyframe, its checkpoint if it is due, and what the harness has to say.
    fn process(&mut self, advance: &mut dyn FnMut(Advance<'_>) -> Result<()>) -> Result<()> {
        let report = self.reconstructor.process().map_err(|e| self.checkpointer.explain(e.into()))?;
        let Some(report) = report else { return Ok(()) };
        let done = self.reconstructor.keyframes_expanded();
        if self.checkpointer.is_due(done, done == self.training.len() && self.total > done) {
            self.checkpointer.keep(&mut self.reconstructor)?;
        }
        let keyframe = self.next_timing();
        let reconstructor = RefCell::new(&mut self.reconstructor);
        let read = || shown(reconstructor.borrow_mut().field());
        let field = Some(FieldReader::new(&read));
        let gaussians = Some(report.gaussians);
        let begun = Instant::now();
        advance(Advance { gaussians, keyframe: keyframe.as_ref(), field, ..Advance::of(done, self.total) }).inspect_err(
            |_| {
                // An interrupt: what could not be kept is done again.
                if self.checkpointer.kept != Some(done) {
                    report_unless_kept(self.checkpointer.keep(&mut self.reconstructor));
                }
            },
        )?;
        // What is done with the news (an evaluation) is no waiting of keyframes.
        self.reconstructor.discount_wait(begun.elapsed());
        Ok(())
    }
}

/// Keeps checkpoints, if any are wanted.
pub(in crate::methods) struct Checkpointer {
    checkpoints: Option<Checkpoints>,
    /// Keyframes in the last one.
    kept: Option<usize>,
    /// When it was kept, or the work began.
    at: Instant,
}

impl Checkpointer {
    pub fn new(checkpoints: Option<Checkpoints>) -> Self {
        Self { checkpoints, kept: None, at: Instant::now() }
    }

    /// Keyframes in the last one.
    pub fn kept(&self) -> Option<usize> {
        self.kept
    }

    /// Where they are kept, if they are.
    pub fn path(&self) -> Option<&Path> {
        self.checkpoints.as_ref().filter(|c| c.are_kept()).map(|c| c.path.as_path())
    }

    /// Takes note of the checkpoint that was gone on from.
    pub fn resumed(&mut self, count: usize) {
        self.kept = Some(count);
        self.checkpoints.iter().for_each(|c| c.holds(count, "keyframes"));
    }

    /// Whether to keep one now; `last` says that stages without checkpoints follow.
    pub fn is_due(&self, done: usize, last: bool) -> bool {
        let Some(c) = self.checkpoints.as_ref().filter(|c| c.are_kept()) else { return false };
        c.is_due(done, self.at) || last && c.every.is_some()
    }

    /// The checkpoint to go on from.
    pub fn read(&self) -> Result<Option<Checkpoint>> {
        let Some((c, path)) = self.checkpoints.as_ref().and_then(|c| Some((c, c.to_resume()?))) else { return Ok(None) };
        let checkpoint = Checkpoint::read(path)?;
        c.check_tag(checkpoint.tag())?;
        Ok(Some(checkpoint))
    }

    pub fn keep(&mut self, reconstructor: &mut Reconstructor) -> Result<()> {
        let Some(c) = self.checkpoints.as_ref().filter(|c| c.are_kept()) else { return Ok(()) };
        reconstructor.checkpoint(&c.written_tag())?.write(&c.path).context("while keeping a checkpoint")?;
        let count = reconstructor.keyframes_expanded();
        (self.kept, self.at) = (Some(count), Instant::now());
        c.holds(count, "keyframes");
        Ok(())
    }

    /// A reconstruction's error with what survives it.
    pub fn explain(&self, error: anyhow::Error) -> anyhow::Error {
        match (&self.checkpoints, self.kept) {
            (Some(c), Some(kept)) if error.is::<corf::Error>() => {
                let survives = format!(
                    "the last checkpoint, {}, holds {}: --resume goes on from it",
                    c.path.display(),
                    counted(kept, "keyframe")
                );
                error.context(survives)
            }
            _ => error,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_fails_leaves_a_checkpoint_that_is_named() {
        let path = std::path::PathBuf::from("run/checkpoint");
        let device = "cpu (1 thread)".to_owned();
        let checkpoints = Checkpoints { path, every: Some(4), resume: false, tag: String::new(), device };
        let lost = || anyhow::Error::from(corf::Error::invalid("gpu, training", "the device was lost", "use another"));
        let mut checkpointer = Checkpointer { checkpoints: Some(checkpoints), kept: None, at: Instant::now() };
        assert!(checkpointer.is_due(8, false) && !checkpointer.is_due(9, false) && checkpointer.is_due(9, true));
        assert!(!format!("{:#}", checkpointer.explain(lost())).contains("checkpoint"), "there is none yet");
        checkpointer.kept = Some(8);
        let text = format!("{:#}", checkpointer.explain(lost()));
        assert!(
            text.contains("run/checkpoint") && text.contains("8 keyframes") && text.contains("the device was lost"),
            "{text}"
        );
        let interrupt = checkpointer.explain(crate::terminal::interrupt::Interrupted.into());
        assert!(!format!("{interrupt:#}").contains("run/checkpoint"), "an interrupt is no failure");
    }
}
