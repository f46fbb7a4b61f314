//! `corf dataset`: generate, import, export, publish, play and check keyframe datasets.

mod export;
mod import;
mod play;
mod publish;

use self::export::Export;
use self::import::Import;
use self::play::Play;
use self::publish::Publish;
use super::assignments::DatasetKeys;
use super::{Verdict, print, show};
use crate::device::{Backend, DeviceChoice};
use crate::files::separation::{Reads, keep_apart};
use crate::radio_link::PointArg;
use crate::scenes::generate::{self, GenerateOptions, Generated, OtherRadio};
use anyhow::Result;
use clap::{Args, Subcommand};
use corf_scene::Severity;
use corf_scene::dataset::{self, Dataset, LightFrom};
use corf_scene::words::counted;
use std::path::PathBuf;

/// Generate, import, export, publish, play or check a keyframe dataset.
#[derive(Subcommand)]
pub enum DatasetCommand {
    /// Trace a scene in light and at 60 GHz at every pose of its trajectory.
    Generate(Generate),
    /// Import a capture: images, spectra and poses that other programs recorded or made. What its files leave open is asked for by the flag that says
    /// it; a failed import leaves nothing.
    Import(Box<Import>),
    /// Write keyframes for programs that read neither EXR nor COLMAP.
    Export(Export),
    /// Write a dataset as data sets are published: Parquet shards with a Hugging Face card, Croissant metadata with hashes, licence, citation, contact
    /// sheet.
    Publish(Box<Publish>),
    /// Play a dataset back into a live folder, keyframe after keyframe, for `corf reconstruct --follow`.
    Play(Play),
    /// Check a dataset: hashes, sizes, poses, and the rules of the tools that read it; exit 1 when one is broken.
    Validate {
        /// Dataset folder.
        folder: PathBuf,
        /// Fail on warnings as well.
        #[arg(long)]
        strict: bool,
    },
}

/// `corf dataset generate`.
#[derive(Args)]
pub struct Generate {
    /// Dataset configuration (TOML), e.g. scenes/lobby-mini.toml.
    config: PathBuf,
    /// Output folder.
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    keys: DatasetKeys,
    /// Number of keyframes, instead of the configuration's.
    #[arg(long)]
    keyframes: Option<usize>,
    /// Seed, instead of the configuration's.
    #[arg(long)]
    seed: Option<u64>,
    /// Go on with a folder that holds finished keyframes of the same configuration.
    #[arg(long)]
    resume: bool,
    /// Place of the transmitter, world metres, instead of the scene file's; its antenna and the way that it faces stay.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    tx: Option<PointArg>,
    /// Carrier, hertz, instead of the scene file's.
    #[arg(long, value_name = "HZ", allow_hyphen_values = true)]
    frequency: Option<f64>,
    /// Do not trace light: take images, depths and surfaces from this data set of the same mesh, poses and `[optical]`, whose files are linked (copied
    /// where they cannot be) with their hashes checked. For another transmitter, carrier or `[rf]`; whatever else differs is refused.
    #[arg(long, value_name = "DATASET", conflicts_with = "device")]
    light_from: Option<PathBuf>,
    /// Device that traces light: auto, cpu, gpu, or gpu:N for the N-th adapter. Radio is traced by the processor meanwhile.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
    /// Refuse a transmitter or a trajectory outside of the scene, and exit with 1 where images are black or depth is empty.
    #[arg(long)]
    strict: bool,
}

impl DatasetCommand {
    /// Runs the sub-command.
    ///
    /// # Errors
    /// Bad configuration or scene, an occupied output folder, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        match self {
            Self::Generate(c) => c.run(json),
            Self::Import(c) => c.run(json),
            Self::Export(c) => c.run(json),
            Self::Publish(c) => c.run(json),
            Self::Play(c) => c.run(json),
            Self::Validate { folder, strict } => {
                let findings = dataset::validate(&folder)?;
                if !json {
                    print(&summary(&Dataset::open_any(&folder)?))?;
                }
                let warned = findings.iter().any(|f| f.severity == Severity::Warning);
                match super::findings(json, &findings)? {
                    Verdict::Done if strict && warned => Ok(Verdict::CheckFailed),
                    verdict => Ok(verdict),
                }
            }
        }
    }
}

/// Summary of a dataset's content, in a line or two.
fn summary(dataset: &Dataset) -> String {
    let header = dataset.header();
    if let Some(array) = dataset.fixed_array() {
        let [x, y, z] = array.position_m;
        return format!(
            "{}: {} places of the transmitter, spectra of {}x{} grey levels at an array that stands at ({x}, {y}, {z}) m",
            header.name,
            dataset.len(),
            array.azimuths,
            array.elevations
        );
    }
    let spectra = match (header.modalities.radio, header.spectrum) {
        (false, _) => "no spectra".to_owned(),
        (true, None) => "imported spectra".to_owned(),
        (true, Some(kind)) => format!("{} spectra", kind.name()),
    };
    let images = if header.modalities.light { "" } else { ", no images" };
    let masks = if dataset.has_masks() { ", masks" } else { "" };
    let mut text = format!("{}: {}, {spectra}{images}{masks}", header.name, counted(dataset.len(), "keyframe"));
    if let Some(share) = dataset.share_in_frame_summary() {
        let [mean, min, max] = [share.mean, share.min, share.max].map(|s| 100.0 * s);
        text += &format!("\nof the arriving power {mean:.1} % falls into the RF frame ({min:.1} to {max:.1} % a keyframe)");
    }
    if let Some(error) = header.sampling_error {
        text += &format!(
            "\nstandard error of the diffuse sampling: {:.4} dB of the total, {:.3} dB of the pixels within 30 dB of the peak",
            error.total_db, error.pixels_db
        );
    }
    text
}

impl Generate {
    fn run(self, json: bool) -> Result<Verdict> {
        let mut config = self.keys.load(&self.config)?;
        if let Some(keyframes) = self.keyframes {
            config.keyframes = keyframes;
            // A segment chosen for another length means nothing here; the default follows the length.
            config.split.held_out_segment = None;
        }
        config.seed = self.seed.unwrap_or(config.seed);
        config.validate()?;
        let light_from = self.light_from.as_deref().map(Dataset::open).transpose()?;
        if let Some(folder) = &self.light_from {
            keep_apart("--out", &self.out, &[Reads::Folder(folder)])?;
        }
        let options = GenerateOptions {
            resume: self.resume,
            strict: self.strict,
            light: if light_from.is_some() { Backend::Cpu } else { self.device.resolve()? },
            light_from,
            other_radio: OtherRadio { transmitter_m: self.tx.map(|point| point.0), frequency_hz: self.frequency },
        };
        let Generated { dataset: made, findings } = generate::generate(&config, &self.out, options)?;
        let spectra =
            made.db_range().map(|r| format!(", spectra from {:.0} to {:.0} dB", r.min_db, r.max_db)).unwrap_or_default();
        let mut text = format!("{}: {}{spectra}, hash {}", self.out.display(), counted(made.len(), "keyframe"), made.hash());
        if let Some(LightFrom { dataset, dataset_hash, .. }) = &made.header().light_from {
            text += &format!("\nits light is that of {dataset}, hash {dataset_hash}");
        }
        show(json, made.header(), &text)?;
        let failed = self.strict && findings.iter().any(|f| f.severity == Severity::Warning);
        Ok(if failed { Verdict::CheckFailed } else { Verdict::Done })
    }
}
