//! `corf dataset export`: a data set's keyframes for programs that read neither EXR nor COLMAP.

use super::{Verdict, show};
use crate::input::{Input, Verify};
use crate::interrupt;
use crate::progress::Progress;
use crate::run::claim_fresh;
use anyhow::Result;
use clap::{Args, ValueEnum};
use corf_scene::dataset::{keyframe_npz, stem};
use corf_scene::io::write_atomic;
use std::path::PathBuf;

/// `corf dataset export`.
#[derive(Args)]
pub struct Export {
    /// Dataset folder.
    folder: PathBuf,
    /// Form of the keyframes.
    #[arg(long, value_enum)]
    to: Form,
    /// Output folder.
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    verify: Verify,
}

/// Form of exported keyframes.
#[derive(Clone, Copy, ValueEnum)]
enum Form {
    /// One NumPy archive a keyframe, 00001.npz and so on, with images, spectrum, depth, pose, intrinsics and all conventions (docs/dataset-format.md).
    Numpy,
}

impl Export {
    /// Runs the command.
    ///
    /// # Errors
    /// A data set that cannot be read, an occupied output folder, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let Form::Numpy = self.to;
        let Input { dataset, .. } = self.verify.open(&self.folder)?;
        let _held = claim_fresh(&self.out)?;
        let mut progress = Progress::start(format!("export of {}", dataset.header().name), dataset.len(), "keyframes");
        for index in 0..dataset.len() {
            interrupt::check()?;
            write_atomic(self.out.join(format!("{}.npz", stem(index))), &keyframe_npz(&dataset, index)?)?;
            progress.set(index + 1, dataset.len());
        }
        progress.finish();
        let text = format!("{} keyframes in {}", dataset.len(), self.out.display());
        show(json, &serde_json::json!({ "keyframes": dataset.len(), "out": self.out }), &text)?;
        Ok(Verdict::Done)
    }
}
