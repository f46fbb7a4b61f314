//! Keyframe after keyframe through light and radio, with checkpoints on the way.

use crate::methods::corf_gs::Checkpointer;
use crate::methods::interface::{Advance, FieldReader, Predictor, PredictorReader, StageTime, TrainingSet, shown};
use crate::methods::stepwise::report_unless_kept;
use anyhow::{Context, Result};
use corf::array_field::{ArrayField, ArrayTrainer, Image, Observed};
use corf::{Field, KeyframeTiming, Reconstructor};
use corf_scene::{Keyframe, Radio};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

/// Light and radio, keyframe after keyframe.
pub(super) struct Online<'a> {
    pub light: Reconstructor,
    pub radio: ArrayTrainer,
    pub training: &'a TrainingSet<'a>,
    /// True images that are seen from each training keyframe, of an oracle.
    pub images: Option<Vec<Vec<Image>>>,
    pub checkpointer: Checkpointer,
    /// Keyframes that light has received and radio has not.
    pub ahead: VecDeque<Observed>,
    /// Time that radio took, by keyframe of this session.
    pub radio_s: Vec<f64>,
    pub advance: &'a mut dyn FnMut(Advance<'_>) -> Result<()>,
    /// What predicts by both fields.
    pub predict: &'a dyn Fn(Field, ArrayField) -> Box<dyn Predictor>,
}

impl Online<'_> {
    /// Takes every training keyframe, from the checkpoint on if there is one, and says what there is to say at the end.
    pub fn run(mut self) -> Result<(Reconstructor, ArrayTrainer)> {
        for k in self.resume()?..self.training.len() {
            let before = self.training.loading_time();
            let keyframe = self.training.keyframe(k)?;
            self.light.discount_wait(self.training.loading_time() - before);
            let (keyframe, observed) = self.observe(k, keyframe)?;
            self.ahead.push_back(observed);
            self.light.receive(keyframe)?;
            while self.light.waiting() >= self.light.worth_receiving() {
                self.process()?;
            }
        }
        while self.light.waiting() > 0 {
            self.process()?;
        }
        self.light.finish(&mut |_, _| ControlFlow::Continue(()))?;
        self.report()?;
        self.forget(None);
        Ok((self.light, self.radio))
    }

    /// Training keyframe `k` for light, whose spectrum is what splats are to show, and for radio.
    fn observe(&self, k: usize, mut keyframe: Keyframe) -> Result<(Keyframe, Observed)> {
        let Keyframe { index, world_from_camera, radio, .. } = &mut keyframe;
        let Radio { spectrum } = radio.as_mut().with_context(|| format!("keyframe {index} has no spectrum"))?;
        let mut observed = self.radio.observe(world_from_camera, spectrum);
        observed.images = self.images.as_ref().map(|images| images[k].clone());
        if let Some(peeled) = &observed.peeled {
            spectrum.clone_from(&peeled.remainder);
        }
        Ok((keyframe, observed))
    }

    /// Restores the checkpoint, if there is one, and replays its keyframes; returns their number.
    fn resume(&mut self) -> Result<usize> {
        let Some(checkpoint) = self.checkpointer.read()? else { return Ok(0) };
        self.light.restore(&checkpoint)?;
        let count = checkpoint.keyframes().len();
        let path = self.radio_file(count).context("a checkpoint was read, and there is no place for one")?;
        self.radio.restore(ArrayField::read(&path)?, count)?;
        for k in 0..count {
            let (keyframe, observed) = self.observe(k, self.training.keyframe(k)?)?;
            self.light.replay(keyframe)?;
            self.radio.replay(&observed);
        }
        self.checkpointer.resumed(count);
        Ok(count)
    }

    /// One keyframe in light and then in radio, and its checkpoint if it is due.
    fn process(&mut self) -> Result<()> {
        if self.light.process().map_err(|e| self.checkpointer.explain(e.into()))?.is_none() {
            return Ok(());
        }
        let Some(observed) = self.ahead.pop_front() else { return Ok(()) };
        let start = Instant::now();
        // Where surfaces are splatted nobody looks at points of theirs, and a field is read back from the device.
        let surface = if self.radio.field.over_splats { Vec::new() } else { self.light.field()?.gaussians.position };
        self.radio.receive(&observed, &surface)?;
        self.radio.train()?;
        self.radio_s.push(start.elapsed().as_secs_f64());
        let done = self.light.keyframes_expanded();
        if self.checkpointer.is_due(done, false) {
            self.keep(done)?;
        }
        let (gaussians, total) = (Some(self.light.gaussian_count()), self.training.len());
        let light = RefCell::new(&mut self.light);
        let read = || shown(light.borrow_mut().field());
        let make = || -> Result<Option<Box<dyn Predictor>>> {
            let field = light.borrow_mut().field()?;
            Ok((!field.gaussians.is_empty()).then(|| (self.predict)(field, self.radio.field.clone())))
        };
        let (field, predictor) = (Some(FieldReader::new(&read)), Some(PredictorReader::new(&make)));
        (self.advance)(Advance { gaussians, field, predictor, ..Advance::of(done, total) }).inspect_err(|_| {
            // An interrupt: what could not be kept is done again.
            if self.checkpointer.kept() != Some(done) {
                report_unless_kept(self.keep(done));
            }
        })
    }

    /// Keeps both: radio's file is named by its keyframes, so that one of another time is never taken for it.
    fn keep(&mut self, done: usize) -> Result<()> {
        let Some(path) = self.radio_file(done) else { return Ok(()) };
        self.radio.field.write(&path).context("while keeping a checkpoint")?;
        self.checkpointer.keep(&mut self.light)?;
        self.forget(Some(done));
        Ok(())
    }

    /// Radio's file of a checkpoint of so many keyframes, where checkpoints are kept.
    fn radio_file(&self, done: usize) -> Option<PathBuf> {
        let path = self.checkpointer.path()?;
        Some(path.with_file_name(format!("{}-{done}", Self::stem(path)?)))
    }

    fn stem(path: &std::path::Path) -> Option<String> {
        Some(format!("{}-array", path.file_name()?.to_str()?))
    }

    /// Removes radio's files of other checkpoints than one; what cannot be removed is no harm.
    fn forget(&self, but: Option<usize>) {
        let Some((path, stem)) = self.checkpointer.path().and_then(|p| Some((p, Self::stem(p)?))) else { return };
        let keep = but.and_then(|done| self.radio_file(done));
        for entry in path.parent().and_then(|p| p.read_dir().ok()).into_iter().flatten().flatten() {
            let ours = entry.file_name().to_str().and_then(|n| n.strip_prefix(&stem)?.strip_prefix('-')?.parse::<usize>().ok());
            if ours.is_some() && Some(entry.path()) != keep {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }

    fn report(&mut self) -> Result<()> {
        // Radio is the end of a keyframe, and is waited for by those behind it, which light's own clock has counted.
        let timings: Vec<KeyframeTiming> = self.light.timings().to_vec();
        let total = self.training.len();
        let last = Advance { gaussians: Some(self.light.gaussian_count()), ..Advance::of(total, total) };
        for (timing, radio_s) in timings.iter().zip(&self.radio_s) {
            let keyframe = KeyframeTiming { train_s: timing.train_s + radio_s, ..*timing };
            (self.advance)(Advance { keyframe: Some(&keyframe), ..last })?;
        }
        let stages = [StageTime { name: "radio".to_owned(), seconds: self.radio_s.iter().sum() }];
        (self.advance)(Advance { depth: self.light.depth_quality(), stages: &stages, ..last })
    }
}
