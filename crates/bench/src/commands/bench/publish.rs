//! `corf bench publish`: a comparison as one archive.

use super::super::{Verdict, show};
use crate::comparison::{archive, suite};
use crate::files::separation::{Reads, keep_apart};
use crate::metrics::input::Verify;
use anyhow::Result;
use clap::Args;
use corf_scene::Error;
use corf_scene::io::{sha256_hex, write_atomic};
use std::path::PathBuf;

/// `corf bench publish`.
#[derive(Args)]
pub struct Publish {
    /// Folder of `corf bench run`, `corf bench collect` or `corf demo`.
    folder: PathBuf,
    /// Archive to write (.tar).
    #[arg(long, value_name = "FILE.tar")]
    out: PathBuf,
    #[command(flatten)]
    verify: Verify,
}

impl Publish {
    /// Runs the command.
    ///
    /// # Errors
    /// A comparison with a cell missing, or whose tables are not those of its records; an archive that is there.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let place = self.out.display().to_string();
        if !self.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("tar")) {
            return Err(Error::invalid(place, "an archive is a tar file", "give --out FILE.tar").into());
        }
        if self.out.symlink_metadata().is_ok() {
            return Err(Error::invalid(place, "it is there already", "choose another --out, or remove it").into());
        }
        let dataset = suite::load(&self.folder)?.0.dataset;
        keep_apart("--out", &self.out, &[Reads::Folder(&self.folder), Reads::Folder(&dataset)])?;
        let dataset = self.verify.open(&dataset)?.dataset;
        let bytes = archive::publish(&self.folder, &dataset)?;
        write_atomic(&self.out, &bytes)?;
        let sha256 = sha256_hex(&bytes);
        let text = format!("{} ({:.1} MB, SHA-256 {sha256})", self.out.display(), bytes.len() as f64 / 1e6);
        show(json, &serde_json::json!({ "out": self.out, "bytes": bytes.len(), "sha256": sha256 }), &text)?;
        Ok(Verdict::Done)
    }
}
