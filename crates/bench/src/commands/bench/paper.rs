//! `corf bench paper`: the paper's tables from our records.

use super::super::{Verdict, show};
use crate::comparison::suite;
use crate::files::separation::{Reads, is_same, keep_apart};
use crate::run::claim_shared;
use crate::table::paper;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;

/// `corf bench paper`.
#[derive(Args)]
pub struct Paper {
    /// Folder of `corf bench run`, `corf demo` or `corf bench pack`.
    folder: PathBuf,
    /// Output folder: paper.md, paper.tex, paper.csv, paper.svg. Without it the folder itself.
    #[arg(long)]
    out: Option<PathBuf>,
}

impl Paper {
    /// Writes the tables and the figure.
    ///
    /// # Errors
    /// Records that are missing or damaged, or a folder that cannot be written.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let records = suite::records(&self.folder)?;
        // Beside the records they have their place; what lies deeper is of the comparison's cells.
        if let Some(out) = self.out.as_deref().filter(|out| !is_same(out, &self.folder)) {
            keep_apart("--out", out, &[Reads::Folder(&self.folder)])?;
        }
        let out = self.out.unwrap_or(self.folder);
        let _held = claim_shared(&out)?;
        let written = paper::write(&records, &out)?;
        let text: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
        show(json, &serde_json::json!({ "records": records.len(), "files": written }), &text.join("\n"))?;
        Ok(Verdict::of(&records))
    }
}
