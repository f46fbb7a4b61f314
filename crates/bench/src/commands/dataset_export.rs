//! `corf dataset export`: a data set's keyframes in the layouts of other programs.

use super::{Verdict, show};
use crate::input::{Input, Verify};
use crate::interrupt;
use crate::progress::Progress;
use crate::run::claim_fresh;
use crate::say;
use anyhow::Result;
use clap::{Args, ValueEnum};
use corf_scene::dataset::{Dataset, keyframe_npz, stem};
use corf_scene::export::nerfstudio::Nerfstudio;
use corf_scene::export::rf_3dgs::Rf3dgs;
use corf_scene::export::{File, FolderExport};
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
    /// Images, 16-bit depth and a point cloud under a transforms.json that names all of them, for nerfstudio.
    Nerfstudio,
    /// Images and Jet spectra over one COLMAP model, for RF-3DGS; spectra are resampled to the frame of the images where they show more.
    #[value(name = "rf-3dgs")]
    Rf3dgs,
}

/// NumPy's archives, which stand each for itself.
struct Archives<'d>(&'d Dataset);

impl FolderExport for Archives<'_> {
    fn keyframe(&self, index: usize) -> corf_scene::Result<Vec<File>> {
        Ok(vec![(format!("{}.npz", stem(index)), keyframe_npz(self.0, index)?)])
    }

    fn whole(&self) -> Vec<File> {
        Vec::new()
    }
}

impl Export {
    /// Runs the command.
    ///
    /// # Errors
    /// A data set that cannot be read or lacks what the form needs, an occupied output folder, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let Input { dataset, .. } = self.verify.open(&self.folder)?;
        let export: Box<dyn FolderExport> = match self.to {
            Form::Numpy => Box::new(Archives(&dataset)),
            Form::Nerfstudio => Box::new(Nerfstudio::new(&dataset)?),
            Form::Rf3dgs => Box::new(Rf3dgs::new(&dataset)?),
        };
        let _held = claim_fresh(&self.out)?;
        let mut progress = Progress::start(format!("export of {}", dataset.header().name), dataset.len(), "keyframes");
        let put = |files: Vec<File>| -> Result<()> {
            files.into_iter().try_for_each(|(name, bytes)| Ok(write_atomic(self.out.join(name), &bytes)?))
        };
        for index in 0..dataset.len() {
            interrupt::check()?;
            put(export.keyframe(index)?)?;
            progress.set(index + 1, dataset.len());
        }
        put(export.whole())?;
        progress.finish();
        say::findings(export.findings());
        let text = format!("{} keyframes in {}", dataset.len(), self.out.display());
        show(json, &serde_json::json!({ "keyframes": dataset.len(), "out": self.out }), &text)?;
        Ok(Verdict::Done)
    }
}
