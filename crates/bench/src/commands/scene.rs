//! `corf scene`: build the lobby and the office, describe, check and export scenes.

use super::export_light::{self, LightViews};
use super::scene_new::New;
use super::{Verdict, show};
use crate::files::ending::{check_file, ending};
use crate::note;
use crate::run::{claim_fresh, claim_shared};
use crate::scenes::in_use;
use crate::terminal::messages;
use anyhow::{Context, Result};
use clap::{Args, Subcommand, ValueEnum};
use corf_scene::config::{SceneConfig, read_toml};
use corf_scene::contained::Reach;
use corf_scene::export::sionna;
use corf_scene::import::ImportOptions;
use corf_scene::info::{SceneInfo, validate_scene};
use corf_scene::words::counted;
use corf_scene::{Error, Finding, Scene as Model, Severity, import, lobby, office, radio_check};
use std::path::{Path, PathBuf};

/// Frequency a mesh file without a scene file is checked at, Hz.
const DEFAULT_FREQUENCY_HZ: f64 = 60e9;

/// Begin, build, describe, check or export a scene.
#[derive(Subcommand)]
pub enum Scene {
    /// Write a stub scene file for a mesh: materials by their names, a loop through the free space, a transmitter, a preview.
    New(New),
    /// Build a scene in code.
    #[command(subcommand)]
    Build(Build),
    /// Describe a scene: what it holds, which materials lack radio properties.
    Info(File),
    /// Check a scene; exit 1 when something in it cannot be traced.
    Validate(Validate),
    /// Write a scene for another simulator.
    Export(Export),
}

/// `corf scene export`.
#[derive(Args)]
pub struct Export {
    /// Scene file (.toml); for Mitsuba a mesh (.glb, .gltf, .obj) will do.
    file: PathBuf,
    /// Whose format.
    #[arg(long, value_enum)]
    to: Format,
    /// Folder to write into; Sionna RT's may hold files already, those of the same name are replaced.
    #[arg(long)]
    out: PathBuf,
    /// Poses to write beside the scene: how many, evenly spaced along the trajectory; for Mitsuba also a dataset's configuration (.toml) or a
    /// pose file (.json) as `corf render` takes it.
    #[arg(long, default_value = "0")]
    poses: String,
    #[command(flatten)]
    views: LightViews,
}

/// Formats a scene can be written in.
#[derive(Clone, Copy, ValueEnum)]
enum Format {
    /// Sionna RT: scene.xml, a PLY for every object and material, radio.json.
    Sionna,
    /// Mitsuba 3, light: scene.xml with a sensor for every pose, a PLY for every object and material, textures.
    Mitsuba,
}

/// Scenes built in code.
#[derive(Subcommand)]
pub enum Build {
    /// The lobby: the same bytes each time.
    Lobby {
        /// Output file.
        #[arg(long, default_value = "scenes/lobby.glb")]
        out: PathBuf,
    },
    /// The office floor: the same bytes each time.
    Office {
        /// Output file.
        #[arg(long, default_value = "scenes/office.glb")]
        out: PathBuf,
    },
}

impl Build {
    /// Writes the scene, and says where.
    fn write(self) -> Result<PathBuf> {
        let (Self::Lobby { out } | Self::Office { out }) = &self;
        check_file("--out", out)?;
        if ending(out).is_none_or(|ending| ending != "glb") {
            let help = "give --out NAME.glb";
            return Err(Error::invalid(format!("--out {}", out.display()), "a scene is written as binary glTF", help).into());
        }
        match self {
            Self::Lobby { out } => Ok(lobby::write(&out).map(|()| out)?),
            Self::Office { out } => Ok(office::write(&out).map(|()| out)?),
        }
    }
}

/// `corf scene validate`.
#[derive(Args)]
pub struct Validate {
    #[command(flatten)]
    file: File,
    /// Fail on warnings as well.
    #[arg(long)]
    strict: bool,
}

/// A scene on disk.
#[derive(Args)]
pub struct File {
    /// A mesh (.glb, .gltf, .obj), or a scene file (.toml) that names one and maps its radio materials.
    file: PathBuf,
    /// Let a mesh name files outside of its folder (shared textures); a scene file says so itself, `allow_outside` under [scene].
    #[allow(rustdoc::broken_intra_doc_links)]
    #[arg(long)]
    allow_outside: bool,
}

impl File {
    /// Options of the mesh's import, by a scene file or without one.
    fn options(&self, config: Option<&SceneConfig>) -> ImportOptions {
        let mut options = config.map(SceneConfig::import_options).unwrap_or_default();
        if self.allow_outside {
            options.reach = Reach::Anywhere;
        }
        options
    }
}

/// Says which frame a scene is written in, where that is not its mesh file's or lies far out.
fn print_frame(scene: &Model, config: Option<&SceneConfig>) {
    messages::findings(radio_check::far_finding(scene));
    if let Some([x, y, z]) = config.and_then(|config| config.scene.offset_m) {
        note!("positions are in the scene file's frame: ({x}, {y}, {z}) m was taken off those of its mesh (offset_m)");
    }
}

/// Everything wrong with a scene: its file's values, its mesh, its materials, where antennas stand.
fn validate(file: &File) -> Result<Vec<Finding>> {
    let path = file.file.as_path();
    if !is_config(path) {
        let (scene, mut findings) = import(path, &file.options(None))?;
        findings.extend(validate_scene(&scene, DEFAULT_FREQUENCY_HZ));
        return Ok(findings);
    }
    let mut config: SceneConfig = read_toml(path)?;
    config.source = path.to_path_buf();
    let faults = config.faults();
    let sound = faults.is_empty();
    let mut findings: Vec<Finding> = faults.into_iter().map(Finding::from).collect();
    let (mut scene, imported) = import(&config.mesh_path(), &file.options(Some(&config)))?;
    findings.extend(imported);
    let mut failed = Vec::new();
    for name in config.radio_materials.keys() {
        if let Err(error) = config.apply_radio_material(name, &mut scene) {
            let finding = Finding::from(error);
            failed.push(format!("material \"{name}\""));
            if findings.iter().all(|f| f.place != finding.place) {
                findings.push(finding);
            }
        }
    }
    // A material whose entry was refused has nothing else to be told.
    let mut of_scene = validate_scene(&scene, config.radio.frequency_hz);
    of_scene.retain(|f| !failed.iter().any(|material| f.place.ends_with(material)));
    findings.extend(of_scene);
    if sound && !scene.triangles.is_empty() {
        findings.extend(radio_check::placement_findings(&config, &scene));
    }
    Ok(findings)
}

fn is_config(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// A scene, and what its import left out or changed.
fn load(file: &File) -> Result<(Model, Vec<Finding>)> {
    let path = file.file.as_path();
    if !is_config(path) {
        return import(path, &file.options(None));
    }
    let config = SceneConfig::load(path)?;
    let (mut scene, findings) = import(&config.mesh_path(), &file.options(Some(&config)))?;
    config.apply_radio_materials(&mut scene)?;
    Ok((scene, findings))
}

/// A mesh, and what its import left out or changed.
fn import(mesh: &Path, options: &ImportOptions) -> Result<(Model, Vec<Finding>)> {
    let (scene, report) = import::load_with_report(mesh, options)?;
    Ok((scene, report.findings(mesh)))
}

impl Scene {
    /// Runs the sub-command.
    ///
    /// # Errors
    /// A scene that cannot be read or written.
    pub fn run(self, json: bool) -> Result<Verdict> {
        match self {
            Self::New(new) => new.run(json),
            Self::Build(build) => {
                let out = build.write()?;
                let bytes = std::fs::metadata(&out)?.len();
                show(json, &serde_json::json!({ "file": out, "bytes": bytes }), &format!("{}: {bytes} bytes", out.display()))?;
                Ok(Verdict::Done)
            }
            Self::Info(file) => {
                let (scene, mut left_out) = load(&file)?;
                left_out.extend(radio_check::far_finding(&scene));
                let info = SceneInfo::of(&scene);
                let notes: Vec<String> = left_out.iter().map(ToString::to_string).collect();
                show(json, &serde_json::json!({ "scene": info, "import": left_out }), &format!("{info}{}", notes.join("\n")))?;
                Ok(Verdict::Done)
            }
            Self::Validate(Validate { file, strict }) => {
                let findings = validate(&file)?;
                let warned = findings.iter().any(|f| f.severity == Severity::Warning);
                match super::findings(json, &findings)? {
                    Verdict::Done if strict && warned => Ok(Verdict::CheckFailed),
                    verdict => Ok(verdict),
                }
            }
            Self::Export(Export { file, to: Format::Mitsuba, out, poses, views }) => {
                let whole = File { file, allow_outside: false };
                let (scene, left_out) = load(&whole)?;
                in_use::report_left_out(&left_out);
                let config = is_config(&whole.file).then(|| SceneConfig::load(&whole.file)).transpose()?;
                let views = views.resolve(config.as_ref(), &poses)?;
                print_frame(&scene, config.as_ref());
                let folder = claim_fresh(&out)?;
                let summary = export_light::write(&scene, views.as_ref(), folder.path())?;
                folder.finish()?;
                export_light::report(&summary, &out, json)
            }
            Self::Export(Export { file, to: Format::Sionna, out, poses, views }) => {
                views.refuse()?;
                let poses = poses.parse().with_context(|| format!("--poses {poses}: for Sionna RT it is a number"))?;
                let config = SceneConfig::load(&file)?;
                let scene = in_use::load(&config)?;
                let _held = claim_shared(&out)?;
                print_frame(&scene, Some(&config));
                let summary = sionna::write(&scene, &config, poses, &out)?;
                let text = format!(
                    "{}: {}, {}, {}, {}, {}",
                    out.display(),
                    counted(summary.shapes, "shape"),
                    counted(summary.materials, "material"),
                    counted(summary.triangles, "triangle"),
                    counted(summary.vertices, "vertex"),
                    counted(summary.poses, "pose")
                );
                show(json, &summary, &text)?;
                Ok(Verdict::Done)
            }
        }
    }
}
