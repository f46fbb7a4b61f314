//! `corf bench density`: a plan on thinner and thinner training keyframes.

use super::super::{Verdict, show};
use super::Cells;
use crate::comparison::density;
use crate::experiment::plan::Plan;
use crate::files::separation::{Reads, keep_apart};
use crate::metrics::lpips::LpipsOption;
use crate::run::claim_output;
use anyhow::Result;
use clap::Args;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// `corf bench density`.
#[derive(Args)]
pub struct Density {
    /// Plan file (TOML) with a learned row and a lookup (nearest, inverse-distance) at least.
    plan: PathBuf,
    /// Thinnings, with commas between: of so many neighbouring keyframes one trains, as far from the held-out ones, which stay the same, as that allows.
    #[arg(long, value_delimiter = ',', value_name = "N,N", default_value = "1,2,4,8")]
    spacing: Vec<NonZeroUsize>,
    /// Metrics, with commas between, by the keys of `corf bench table --help` (default: psnr_rf_scalar and psnr_opt, as far as the data set has both).
    #[arg(long, value_delimiter = ',', value_name = "KEY,KEY")]
    metric: Vec<String>,
    #[command(flatten)]
    cells: Cells,
    #[command(flatten)]
    lpips: LpipsOption,
}

impl Density {
    /// Runs the command.
    ///
    /// # Errors
    /// Bad plans, unreadable datasets, an occupied folder, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let mut plan = Plan::load(&self.plan)?;
        plan.make_absolute()?;
        keep_apart("--out", &self.cells.out, &[Reads::Folder(&plan.dataset)])?;
        let backend = self.cells.device.resolve()?;
        let networks = self.lpips.read(&backend)?;
        let input = self.cells.verify.open_any(&plan.dataset)?.with_networks(&networks)?;
        let density = density::Density::new(plan, &self.spacing, &self.metric, &input.dataset)?;
        let _held = claim_output(&self.cells.out, self.cells.resume)?;
        let (results, text, records) = density.run(&input, &self.cells.out, &backend)?;
        show(json, &results, text.trim_end())?;
        Ok(Verdict::of(&records))
    }
}
