//! `corf demo`: the small lobby end to end.

use super::{Verdict, show};
use crate::device::DeviceChoice;
use crate::generate::Options;
use crate::input::Input;
use crate::metrics::lpips::LpipsNetworks;
use crate::plan::Plan;
use crate::record::Outcome;
use crate::run::claim_output;
use crate::{generate, interrupt, suite};
use anyhow::{Context, Result};
use clap::Args;
use corf_scene::config::DatasetConfig;
use corf_scene::io::write_atomic;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The files the demo writes into its own `scene` folder before it starts: the ones of this repository.
const LOBBY_GLB: &[u8] = include_bytes!("../../../../scenes/lobby.glb");
const SCENE_TOML: &str = include_str!("../../../../scenes/lobby.toml");
const DATASET_TOML: &str = include_str!("../../../../scenes/lobby-mini.toml");
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
    /// Where reconstructions run: auto, cpu, gpu, or gpu:N for the N-th adapter.
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
        std::fs::create_dir_all(&scene).with_context(|| format!("cannot create {}", scene.display()))?;
        build_scene(&scene)?;
        interrupt::check()?;
        let config = DatasetConfig::load(scene.join("lobby-mini.toml"))?;
        let dataset = generate::generate(&config, &self.out.join("dataset"), Options { resume: true, strict: false })?.dataset;
        let input = Input::of(dataset, true)?;
        let plan = Plan::parse(PLAN_TOML)?;
        let written = suite::run(&plan, &input, &self.out, &backend, &LpipsNetworks::default())?;
        let text = format!(
            "\n{}\ntable:  {}\nreport: {}\nall of it in {:.0} s",
            written.text(),
            written.table.display(),
            written.report.display(),
            start.elapsed().as_secs_f64()
        );
        show(json, &written.records, &text)?;
        let failed = written.records.iter().any(|r| matches!(r.outcome, Outcome::Failed { .. }));
        Ok(if failed { Verdict::CheckFailed } else { Verdict::Done })
    }
}

fn build_scene(folder: &Path) -> Result<()> {
    write_atomic(folder.join("lobby.glb"), LOBBY_GLB)?;
    write_atomic(folder.join("lobby.toml"), SCENE_TOML.as_bytes())?;
    Ok(write_atomic(folder.join("lobby-mini.toml"), DATASET_TOML.as_bytes())?)
}
