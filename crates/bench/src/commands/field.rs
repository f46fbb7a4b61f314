//! `corf field`: a reconstructed field for other programs.

use super::{Verdict, show};
use crate::files::ending::{check_file, ending};
use crate::files::separation::{Reads, keep_apart};
use crate::methods::abilities;
use crate::note;
use crate::run::RunInfo;
use crate::run::open;
use anyhow::{Context, Result, bail, ensure};
use clap::{Args, Subcommand, ValueEnum};
use corf::device::Modality;
use corf::files::export::{Frame, SpzClamped, encode_splat, encode_spz, turned};
use corf::files::ply::{self, SingleModality};
use corf::{Appearance, Field, RadioTarget};
use corf_scene::Error;
use corf_scene::io::write_atomic;
use corf_scene::keyframe::DbRange;
use corf_scene::words::counted;
use serde_json::json;
use std::path::PathBuf;

/// Write a reconstructed field for other programs.
#[derive(Subcommand)]
pub enum FieldCommand {
    /// Write one modality's Gaussians in a format that splat viewers and other trainers read.
    Export(Export),
}

impl FieldCommand {
    /// Runs the command.
    ///
    /// # Errors
    /// Those of the sub-command.
    pub fn run(self, json: bool) -> Result<Verdict> {
        match self {
            Self::Export(c) => c.run(json),
        }
    }
}

/// `corf field export`.
#[derive(Args)]
pub struct Export {
    /// Run folder of `corf reconstruct`.
    run: PathBuf,
    /// Format.
    #[arg(long, value_enum)]
    to: Form,
    /// Modality: opacity and colour in light, or at 60 GHz.
    #[arg(long, value_enum, default_value_t = Half::Light)]
    field: Half,
    /// Output file.
    #[arg(long)]
    out: PathBuf,
    /// Pad spherical harmonics with zeros up to this degree, in a PLY: RF-3DGS and viewers of fixed size want 3, which is 45 columns `f_rest_*`.
    #[arg(long, value_name = "DEGREE", value_parser = clap::value_parser!(u8).range(0..=3))]
    pad_sh: Option<u8>,
}

/// Format of an exported field.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Form {
    /// PLY of the reference implementation (INRIA), in the world frame: z up, metres.
    Ply,
    /// .splat: 32 bytes a Gaussian, y down. Colour without harmonics, 8 bits; no compensation for the pixel's extent.
    Splat,
    /// .spz, version 3: quantised and gzipped, y up (RUB).
    Spz,
    /// PLY of the reference implementation with y down, which `splat-transform` turns into an upright .sog.
    SogReadyPly,
}

/// Half of a coupled field.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Half {
    /// Light.
    #[value(name = "optical")]
    Light,
    /// 60 GHz.
    #[value(name = "rf")]
    Radio,
}

impl Form {
    /// Endings by which other programs know what a file of Gaussians is.
    const ENDINGS: [&str; 4] = ["ply", "splat", "spz", "sog"];

    fn ending(self) -> &'static str {
        match self {
            Self::Ply | Self::SogReadyPly => "ply",
            Self::Splat => "splat",
            Self::Spz => "spz",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Splat => "splat",
            Self::Spz => "spz",
            Self::SogReadyPly => "sog-ready-ply",
        }
    }

    fn frame(self) -> Frame {
        match self {
            Self::Ply => Frame::World,
            Self::Splat | Self::SogReadyPly => Frame::YDown,
            Self::Spz => Frame::YUp,
        }
    }
}

impl Export {
    /// Runs the command.
    ///
    /// # Errors
    /// A folder that is no run of Gaussians, a modality that was not trained, a degree below the field's, a file that cannot be written.
    pub fn run(self, json: bool) -> Result<Verdict> {
        check_file("--out", &self.out)?;
        let (wanted, given) = (self.to.ending(), ending(&self.out));
        if let Some(other) = given.filter(|given| given != wanted && Form::ENDINGS.contains(&given.as_str())) {
            let help = format!("give --out NAME.{wanted}, or another --to");
            return Err(Error::invalid(
                format!("--out {}", self.out.display()),
                format!("--to {} writes no .{other}", self.to.name()),
                help,
            )
            .into());
        }
        let info = open::read_info(&self.run)?;
        keep_apart("--out", &self.out, &[Reads::Folder(&self.run), Reads::Folder(&info.dataset)])?;
        let (field, antialias) = self.read(&info)?;
        let offset_m = info.dataset_offset_m;
        let mut notes = ply::Notes { offset_m, ..field.meta.notes(antialias) };
        let meta = field.meta;
        let modality = match self.field {
            Half::Light => Modality::Light,
            Half::Radio => Modality::Radio,
        };
        let mut said = vec![];
        if let Some([x, y, z]) = offset_m {
            said.push(format!(
                "positions are in the data set's frame: ({x}, {y}, {z}) m of the z-up world was taken off the original ones"
            ));
        }
        let mut gaussians = SingleModality::of(field.gaussians, modality);
        if gaussians.appearance.channels == 1 {
            gaussians = gaussians.in_three_channels();
            said.push("its one channel, a level between 0 and 1, is written as grey".to_owned());
        }
        if self.field == Half::Radio {
            let DbRange { min_db, max_db } = meta.db_range;
            let encoding = if meta.radio_target == RadioTarget::Jet { "Jet colours" } else { "levels" };
            let background = &meta.radio_background_color()[..meta.radio_target.channels()];
            said.push(format!(
                "colours are {encoding} of {min_db} to {max_db} dB, to be drawn over the background {background:?}"
            ));
        }
        let degree = gaussians.appearance.sh_degree;
        if let Some(wanted) = self.pad_sh {
            let ply = matches!(self.to, Form::Ply | Form::SogReadyPly);
            ensure!(ply, "--pad-sh pads a PLY\n  help: leave it out with --to {}", self.to.name());
            ensure!(
                usize::from(wanted) >= degree,
                "--pad-sh {wanted} is below the field's own degree {degree}\n  help: give {degree} to 3, or leave it out"
            );
            gaussians = gaussians.padded(wanted.into());
        }
        let frame = self.to.frame();
        let gaussians = turned(&gaussians, frame);
        notes.up = frame.up();
        match self.to {
            Form::Ply | Form::SogReadyPly => ply::write_single(&self.out, &gaussians, modality, &notes)?,
            Form::Splat => {
                write_atomic(&self.out, &encode_splat(&gaussians))?;
                said.extend(lost_in_splat(degree, notes.is_antialiased()));
            }
            Form::Spz => {
                let (bytes, clamped) = encode_spz(&gaussians, notes.is_antialiased())
                    .with_context(|| format!("{} is not written", self.out.display()))?;
                write_atomic(&self.out, &bytes)?;
                said.extend(lost_in_spz(clamped, &gaussians.appearance));
            }
        }
        if matches!(self.to, Form::Spz | Form::SogReadyPly) {
            said.push(ONE_MODALITY.to_owned());
        }
        let columns = frame.file_from_world().transpose().to_cols_array_2d();
        let count = gaussians.position.len();
        let axes = match frame {
            Frame::World => "the world's frame, z up, metres".to_owned(),
            Frame::YDown => "turned so that y is down: (x, y, z) of the world is (x, -z, y), metres".to_owned(),
            Frame::YUp => "turned so that y is up: (x, y, z) of the world is (x, z, -y), metres".to_owned(),
        };
        let sh_degree = if self.to == Form::Splat { 0 } else { gaussians.appearance.sh_degree };
        let text = format!("{} of harmonic degree {sh_degree} in {}\n{axes}", counted(count, "Gaussian"), self.out.display());
        said.iter().for_each(|word| note!("{word}"));
        let value = json!({
            "out": self.out, "format": self.to.name(), "gaussians": count, "sh_degree": sh_degree,
            "file_from_world": columns, "antialiased": notes.is_antialiased(), "offset_m": offset_m, "notes": said,
        });
        show(json, &value, &text)?;
        Ok(Verdict::Done)
    }

    /// The field, the filter that it was trained with, and what its data set took off positions, metres.
    fn read(&self, info: &RunInfo) -> Result<(Field, corf::Antialias)> {
        let place = self.run.display();
        let Some(raster) = open::raster_of(&self.run, info)? else {
            bail!(
                "{place}: {} keeps no Gaussians that other programs could read\n  help: export a run of corf-gs or rf-3dgs",
                info.method
            );
        };
        if self.field == Half::Radio && abilities(&info.method).emitters {
            bail!(
                "{place}: radio of corf-array is emitters seen through an array, no splats\n  help: export --field optical, or a run of corf-gs"
            );
        }
        let field = Field::read(&self.run)?;
        let trained = match self.field {
            Half::Light => field.meta.modalities.light,
            Half::Radio => field.meta.modalities.radio,
        };
        ensure!(trained, "{place} was trained without this modality\n  help: export the other one with --field");
        Ok((field, raster.antialias))
    }
}

/// What a viewer of .splat cannot know.
fn lost_in_splat(degree: usize, antialiased: bool) -> Vec<String> {
    let mut said = vec![];
    if degree > 0 {
        let bands = if degree == 1 { "band 1 is".to_owned() } else { format!("bands 1 to {degree} are") };
        said.push(format!("the format has no harmonics: {bands} left out, colour is the mean over all directions"));
    }
    if antialiased {
        said.push(
            "the field was trained with opacity compensated for the pixel's extent, which the format cannot say: viewers draw thin Gaussians too \
             strong and the picture some dB off; .spz and PLY say it"
                .to_owned(),
        );
    }
    said
}

/// What goes lost where another program makes these formats of a run's coupled.ply.
const ONE_MODALITY: &str = "one modality alone: .spz, .sog and compressed.ply hold no further columns, so that of a run's coupled.ply, too, they \
                            would keep light and lose radio; export --field rf into a file of its own";

/// What `.spz` could not hold of a field.
fn lost_in_spz(clamped: SpzClamped, appearance: &Appearance) -> Option<String> {
    let SpzClamped { colors, scales, harmonics } = clamped;
    (clamped != SpzClamped::default()).then(|| {
        let higher = || appearance.sh.chunks_exact(appearance.stride()).flat_map(|sh| &sh[appearance.channels..]);
        let largest = higher().fold(0.0_f32, |most, v| most.max(v.abs()));
        format!(
            "beyond the format's range, and set to its end: {colors} colours, {scales} scales, {harmonics} of {} higher coefficients (f_rest, beyond \
             ±1; the largest is {largest:.2})",
            higher().count()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_spz_cannot_hold_is_said_with_its_size() {
        let mut appearance = Appearance::empty(3, 1);
        appearance.sh = vec![9.0, 0.0, 0.0, 0.5, -1.75, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.5];
        let said = lost_in_spz(SpzClamped { colors: 1, scales: 0, harmonics: 2 }, &appearance).unwrap();
        assert!(
            said.contains("1 colours, 0 scales, 2 of 9 higher coefficients") && said.contains("the largest is 1.75"),
            "{said}"
        );
        assert_eq!(lost_in_spz(SpzClamped::default(), &appearance), None);
    }
}
