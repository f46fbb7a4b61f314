//! `corf check`: compare with references.

mod paths;

use super::{Verdict, show};
use anyhow::Result;
use clap::Subcommand;
use corf_raytrace::sionna;
use std::path::PathBuf;

/// Compare with references.
#[derive(Subcommand)]
pub enum Check {
    /// Trace the scene in a reference file made with sionna-rt and compare path by path; exit 1 on a difference.
    Sionna {
        /// Reference files (JSON, schema corf-sionna-ref/1 or corf-sionna-diffuse-ref/1).
        #[arg(required = true)]
        references: Vec<PathBuf>,
    },
    /// Look for chains of points of another program, such as one of the image method, among the paths of a scene; exit 1 where one is missing or displaced.
    Paths(paths::Paths),
}

impl Check {
    /// Runs the sub-command.
    ///
    /// # Errors
    /// A reference that cannot be read.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let references = match self {
            Self::Sionna { references } => references,
            Self::Paths(paths) => return paths.run(json),
        };
        let reports = references.iter().map(|path| Ok(sionna::check(path)?)).collect::<Result<Vec<_>>>()?;
        let text: Vec<String> = reports.iter().map(ToString::to_string).collect();
        show(json, &reports, &text.join("\n"))?;
        Ok(if reports.iter().all(|r| r.passed) { Verdict::Done } else { Verdict::CheckFailed })
    }
}
