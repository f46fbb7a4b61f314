//! The dataset that numbers come from, and whether it is known to be the one that was generated.

use crate::metrics::lpips::LpipsNetworks;
use crate::terminal::messages;
use crate::terminal::progress::Stage;
use anyhow::Result;
use clap::Args;
use corf_scene::dataset::Dataset;
use std::path::Path;
use std::sync::Arc;

/// Whether a dataset's files are checked before they are read.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct Verify {
    /// Do not check the dataset's files against their recorded SHA-256 first; the record then says that they were not.
    #[arg(long)]
    no_verify: bool,
}

impl Verify {
    /// Files that were checked already are not checked again.
    pub const DONE: Self = Self { no_verify: true };

    /// Whether to check.
    pub fn wanted(self) -> bool {
        !self.no_verify
    }

    /// Opens a dataset of either kind, checked if wanted: see [`Dataset::fixed_array`].
    ///
    /// # Errors
    /// Those of [`Self::open`], but for the kind.
    pub fn open_any(self, folder: &Path) -> Result<Input> {
        Input::of(Dataset::open_any(folder)?, self.wanted())
    }

    /// Opens a dataset, checked if wanted.
    ///
    /// # Errors
    /// No finished dataset; a file that is missing or another than the recorded one, by name.
    pub fn open(self, folder: &Path) -> Result<Input> {
        Input::of(Dataset::open(folder)?, self.wanted())
    }
}

/// A dataset, whether its files were checked, and the networks that its images are compared with.
#[derive(Clone, Debug)]
pub struct Input {
    /// The dataset.
    pub dataset: Dataset,
    /// Whether every file is the recorded one.
    pub verified: bool,
    /// Networks of LPIPS; none where it is not computed.
    pub networks: Arc<LpipsNetworks>,
}

impl Input {
    /// A dataset, its files checked first if `verify`.
    ///
    /// # Errors
    /// A file that is missing or another than the recorded one, by name.
    pub fn of(dataset: Dataset, verify: bool) -> Result<Self> {
        if verify {
            Stage::of("hashes of the dataset's files", || dataset.verify())?;
        }
        messages::findings(dataset.far_finding());
        Ok(Self { dataset, verified: verify, networks: Arc::default() })
    }

    /// The same with networks of LPIPS.
    ///
    /// # Errors
    /// Images that are too small for one of them.
    pub fn with_networks(self, networks: &Arc<LpipsNetworks>) -> Result<Self> {
        networks.check(&self.dataset)?;
        Ok(Self { networks: networks.clone(), ..self })
    }
}
