//! Flags of commands that ask a finished run.

use crate::device::{Backend, DeviceChoice};
use crate::metrics::input::Verify;
use crate::run::open::{self, OpenRun};
use anyhow::Result;
use clap::Args;
use std::path::{Path, PathBuf};

/// How a run is opened.
#[derive(Args)]
pub struct OpenFlags {
    /// Dataset folder, if it has moved since.
    #[arg(long)]
    pub dataset: Option<PathBuf>,
    #[command(flatten)]
    verify: Verify,
    /// Device that renders the field: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

impl OpenFlags {
    /// Opens a run folder, and says what renders its field.
    ///
    /// # Errors
    /// Those of [`open::open`]; no such device.
    pub fn open(&self, run: &Path) -> Result<(OpenRun, Backend)> {
        let backend = self.device.resolve()?;
        Ok((open::open(run, self.dataset.as_deref(), self.verify, &backend)?, backend))
    }
}
