//! `corf dataset export`: a data set's keyframes in the layouts of other programs.

use super::super::{Verdict, show};
use crate::files::separation::{Reads, keep_apart};
use crate::metrics::input::{Input, Verify};
use crate::note;
use crate::radio_link::PointArg;
use crate::run::claim_fresh;
use crate::scenes::nerf2_set::{Gateway, Nerf2Set};
use crate::terminal::interrupt;
use crate::terminal::messages;
use crate::terminal::progress::Progress;
use anyhow::Result;
use clap::{Args, ValueEnum};
use corf_scene::Error;
use corf_scene::dataset::{Dataset, keyframe_npz, stem};
use corf_scene::export::nerfstudio::Nerfstudio;
use corf_scene::export::rf_3dgs::Rf3dgsExport;
use corf_scene::export::{File, FolderExport};
use corf_scene::io::{read, write_atomic};
use corf_scene::words::counted;
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
    /// Of nerf2: the scene file that the data set was generated from.
    #[arg(long, value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
    /// Of nerf2: where the array stands, world metres; without it where the scene's transmitter stood.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    gateway: Option<PointArg>,
    /// Of nerf2: a point on the array's boresight, world metres; without it the array stands in the transmitter's attitude.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    gateway_towards: Option<PointArg>,
    #[command(flatten)]
    verify: Verify,
}

/// Form of exported keyframes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Form {
    /// One NumPy archive a keyframe, 00001.npz and so on, with images, spectrum, depth, pose, intrinsics and all conventions
    /// (docs/dataset-format.md).
    Numpy,
    /// Images, 16-bit depth and a point cloud under a transforms.json that names all of them, for nerfstudio.
    Nerfstudio,
    /// Images and Jet spectra over one COLMAP model, for RF-3DGS; spectra are resampled to the frame of the images where they show more.
    #[value(name = "rf-3dgs")]
    Rf3dgsExport,
    /// Spectra at an array that stands still, by places of the transmitter, for NeRF² and WRF-GS: a set that was imported from that layout byte for
    /// byte; of another one traced anew in the data set's scene with its
    /// settings, the transmitter where the platform was.
    Nerf2,
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
        let of_nerf2 = [
            ("--scene", self.scene.is_some()),
            ("--gateway", self.gateway.is_some()),
            ("--gateway-towards", self.gateway_towards.is_some()),
        ];
        if let Some((flag, _)) = of_nerf2.iter().find(|(_, given)| *given && self.to != Form::Nerf2) {
            return Err(Error::invalid(*flag, "nothing is traced in this form", "leave it out, or say --to nerf2").into());
        }
        keep_apart("--out", &self.out, &[Reads::Folder(&self.folder)])?;
        let Input { dataset, .. } = self.verify.open_any(&self.folder)?;
        if dataset.fixed_array().is_some() && self.to != Form::Nerf2 {
            let what = "its array stands still and its transmitter moves, which this form cannot say";
            return Err(Error::invalid(self.folder.display().to_string(), what, "export it --to nerf2").into());
        }
        let export: Box<dyn FolderExport> = match self.to {
            Form::Numpy => Box::new(Archives(&dataset)),
            Form::Nerfstudio => Box::new(Nerfstudio::new(&dataset)?),
            Form::Rf3dgsExport => Box::new(Rf3dgsExport::new(&dataset)?),
            Form::Nerf2 => return self.nerf2(&dataset, json),
        };
        let folder = claim_fresh(&self.out)?;
        if let Some([x, y, z]) = dataset.header().offset_m() {
            note!(
                "positions are in the data set's frame: ({x}, {y}, {z}) m was taken off the original ones, and is to be added to come back to them"
            );
        }
        if self.to == Form::Rf3dgsExport && dataset.has_masks() {
            note!("masks are not written, for RF-3DGS knows none: all pixels of the images will count there");
        }
        let mut progress = Progress::start(format!("export of {}", dataset.header().name), dataset.len(), "keyframes");
        let put = |files: Vec<File>| -> Result<()> {
            files.into_iter().try_for_each(|(name, bytes)| Ok(write_atomic(folder.path().join(name), &bytes)?))
        };
        for index in 0..dataset.len() {
            interrupt::check()?;
            put(export.keyframe(index)?)?;
            progress.set(index + 1, dataset.len());
        }
        put(export.whole())?;
        folder.finish()?;
        progress.finish();
        messages::findings(export.findings());
        self.report(&dataset, json)
    }

    /// Traces and writes a set in NeRF²'s layout.
    fn nerf2(&self, dataset: &Dataset, json: bool) -> Result<Verdict> {
        if dataset.fixed_array().is_some() {
            return self.as_published(dataset, json);
        }
        let gateway = Gateway { position: self.gateway.map(|p| p.0), towards: self.gateway_towards.map(|p| p.0) };
        let set = Nerf2Set::new(dataset, self.scene.as_deref(), gateway)?;
        let folder = claim_fresh(&self.out)?;
        for (name, bytes) in set.trace()? {
            write_atomic(folder.path().join(name), &bytes)?;
        }
        folder.finish()?;
        self.report(dataset, json)
    }

    /// Writes the files of a set that was imported from this layout, byte for byte.
    fn as_published(&self, dataset: &Dataset, json: bool) -> Result<Verdict> {
        let given = [
            ("--scene", self.scene.is_some()),
            ("--gateway", self.gateway.is_some()),
            ("--gateway-towards", self.gateway_towards.is_some()),
        ];
        if let Some((flag, _)) = given.iter().find(|(_, given)| *given) {
            let what = "nothing is traced: the set goes out as it came in";
            return Err(Error::invalid(*flag, what, "leave it out").into());
        }
        let folder = claim_fresh(&self.out)?;
        for (name, _, _) in dataset.listed_files() {
            interrupt::check()?;
            let inside = name.strip_prefix("nerf2/").unwrap_or(name);
            write_atomic(folder.path().join(inside), &read(dataset.own_file(name)?)?)?;
        }
        folder.finish()?;
        self.report(dataset, json)
    }

    fn report(&self, dataset: &Dataset, json: bool) -> Result<Verdict> {
        let text = format!("{} in {}", counted(dataset.len(), "keyframe"), self.out.display());
        show(json, &serde_json::json!({ "keyframes": dataset.len(), "out": self.out }), &text)?;
        Ok(Verdict::Done)
    }
}
