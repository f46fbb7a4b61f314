//! `corf demo`: the small lobby end to end.

use super::{Verdict, show};
use crate::comparison::suite;
use crate::device::DeviceChoice;
use crate::experiment::plan::Plan;
use crate::metrics::input::Input;
use crate::record::Outcome;
use crate::run::{KeptModel, claim_output};
use crate::scenes::generate;
use crate::scenes::generate::GenerateOptions;
use crate::scenes::lobby;
use crate::terminal::interrupt;
use anyhow::Result;
use clap::Args;
use corf_scene::config::DatasetConfig;
use std::path::PathBuf;
use std::time::Instant;

const PLAN_TOML: &str = include_str!("../../../../scenes/demo.toml");

/// `corf demo`.
#[derive(Args)]
pub struct Demo {
    /// Output folder.
    #[arg(long, default_value = "corf-demo")]
    out: PathBuf,
    /// Go on in a folder that an earlier demo has begun.
    #[arg(long)]
    resume: bool,
    /// Device that traces light and reconstructs: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

impl Demo {
    /// Unpacks the lobby, traces its keyframes, reconstructs with every method, prints the table and the report's path.
    ///
    /// # Errors
    /// An occupied or unwritable output folder, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let start = Instant::now();
        let backend = self.device.resolve()?;
        let _held = claim_output(&self.out, self.resume)?;
        let scene = self.out.join("scene");
        lobby::unpack(&scene)?;
        interrupt::check()?;
        let config = DatasetConfig::load(scene.join(lobby::MINI))?;
        let options = GenerateOptions { resume: true, light: backend.clone(), ..GenerateOptions::default() };
        let dataset = generate::generate(&config, &self.out.join("dataset"), options)?.dataset;
        let input = Input::of(dataset, true)?;
        let plan = Plan::parse(PLAN_TOML)?;
        let written = suite::run(&plan, &input, &self.out, &backend)?;
        let page = |model: KeptModel| model.has_page().then(|| format!("viewer: {}\n", model.page.display()));
        let view: String = KeptModel::all(&self.out).into_iter().filter_map(page).collect();
        let text = format!(
            "\n{}\ntable:  {}\n{}\n{view}all of it in {:.0} s",
            written.text(),
            written.table.display(),
            written.place(),
            start.elapsed().as_secs_f64()
        );
        show(json, &written.records, &text)?;
        let failed = written.records.iter().any(|r| matches!(r.outcome, Outcome::Failed { .. }));
        Ok(if failed { Verdict::CheckFailed } else { Verdict::Done })
    }
}
