//! `corf evaluate`: a run's field against the held-out keyframes.

use super::{Verdict, show};
use crate::device::DeviceChoice;
use crate::input::Verify;
use crate::methods::open;
use crate::metrics::lpips::LpipsOption;
use crate::record::{Numbers, Outcome};
use crate::run::claim_shared;
use crate::{harness, table};
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;

/// `corf evaluate`.
#[derive(Args)]
pub struct Evaluate {
    /// Run folder of `corf reconstruct`.
    run: PathBuf,
    /// Dataset folder, if it has moved since.
    #[arg(long)]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    verify: Verify,
    /// What renders the field: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
    #[command(flatten)]
    lpips: LpipsOption,
}

impl Evaluate {
    /// Runs the command; writes `metrics.json` into the run folder.
    ///
    /// # Errors
    /// A run or dataset that cannot be read; weights that are not LPIPS's, or images too small for them.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let networks = self.lpips.read()?;
        let mut run = open::open(&self.run, self.dataset.as_deref(), self.verify, &self.device.resolve()?)?;
        let _held = claim_shared(&self.run)?;
        let frames = harness::evaluate(run.predictor.as_mut(), &run.input.dataset, &run.split, &networks, |_, _| Ok(()))?;
        let info = &run.info;
        let numbers = Numbers::of(frames, info.seconds, info.gaussians, info.peak_memory_bytes, info.curve.clone(), info.latency)
            .with_depth(info.depth);
        let outcome = Outcome::Done(Box::new(numbers));
        let mut record =
            harness::record(&info.method, run.method.as_ref(), &run.input, info.protocol, info.seed, &networks, outcome);
        // The record is the run's, whoever evaluates it.
        record.provenance = info.provenance.clone();
        record.config = info.config.clone();
        record.device = info.device.clone();
        record.dataset_verified &= info.dataset_verified;
        record.write(&self.run.join("metrics.json"))?;
        let records = [record];
        show(json, &records[0], &table::plain(&table::rows(&records)))?;
        Ok(Verdict::Done)
    }
}
