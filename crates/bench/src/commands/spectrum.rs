//! `corf spectrum`: angular spectra at one pose, as numbers and as pictures.

use super::{Verdict, show};
use crate::charts::{self, ColourMap};
use crate::files::json::write_json;
use crate::note;
use crate::radio_link::{PathArgs, PointArg, ScatteringArgs, path_args_over};
use crate::run::claim_fresh;
use crate::scenes::in_use;
use crate::terminal::messages;
use crate::terminal::progress::Stage;
use anyhow::{Result, bail, ensure};
use clap::{Args, ValueEnum};
use corf_raytrace::bvh::Bvh;
use corf_raytrace::radio::{RadioTracer, Solids};
use corf_raytrace::sensor::{Extent, RadioSensor, SensorPlan, geometry_warnings};
use corf_raytrace::spectrum::{Grid, SpectrumSettings, share_in_frame};
use corf_scene::config::{SceneConfig, SpectrumConfig, SpectrumKind, TransmitterConfig};
use corf_scene::dataset::{EQUIRECTANGULAR_AXES, Quantity};
use corf_scene::keyframe::DbRange;
use corf_scene::mounting::Surfaces;
use corf_scene::words::counted;
use corf_scene::{Equirectangular, Error, Pinhole, Raster, Rigid3, Scene, bounds, io};
use glam::DVec3;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Memory of a spectrum while it is formed and written, bytes a pixel.
const BYTES_A_PIXEL: f64 = 120.0;

/// `corf spectrum`.
#[derive(Args)]
pub struct Spectrum {
    /// Scene file (.toml).
    scene: PathBuf,
    /// Receiver, world metres `x,y,z`.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    rx: PointArg,
    /// Point to look at, world metres `x,y,z`; without it the transmitter, where there is one.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    towards: Option<PointArg>,
    /// Output folder: for every kind KIND.exr (linear), KIND-db.exr, KIND-jet.png and KIND.svg (a figure with axes, colour bar and peaks), and
    /// spectrum.json.
    #[arg(long)]
    out: PathBuf,
    /// Kinds of spectra; several may be given.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "mpc")]
    kind: Vec<Kind>,
    /// Directions: a pinhole camera's pixels, or the whole sphere (equirectangular).
    #[arg(long, value_enum, default_value = "pinhole")]
    grid: GridKind,
    /// Pixels `WIDTHxHEIGHT`; without it 300x200, or 720x360 of the sphere.
    #[arg(long, value_parser = size)]
    size: Option<(usize, usize)>,
    /// Full horizontal field of view of the pinhole camera, degrees (default: 90).
    #[arg(long, allow_hyphen_values = true)]
    fov_deg: Option<f64>,
    /// One of the scene's `[transmitters]`, instead of its `[transmitter]`; may be repeated: the files of each then go into OUT/tx0, OUT/tx1 … in
    /// this order, all at one pose, for which --towards is needed.
    #[arg(long, value_name = "NAME")]
    transmitter: Vec<String>,
    #[command(flatten)]
    paths: PathArgs,
    /// Leave out diffuse scattering.
    #[arg(long)]
    no_diffuse: bool,
    #[command(flatten)]
    scattering: ScatteringArgs,
    /// Standard deviation of an mpc lobe, degrees per axis (default: 1).
    #[arg(long, allow_hyphen_values = true)]
    lobe_deg: Option<f64>,
    /// Bandwidth of the coherent kinds, Hz: delays are told apart to its inverse.
    #[arg(long, default_value_t = 1e9, allow_hyphen_values = true)]
    bandwidth: f64,
    /// Diagonal loading of mvdr, in mean eigenvalues of the covariance: the less, the narrower its peaks (default: 0.1).
    #[arg(long, allow_hyphen_values = true)]
    loading: Option<f64>,
    /// Width of the pictures' range under each spectrum's peak, dB.
    #[arg(long, default_value_t = 70.0, allow_hyphen_values = true)]
    range_db: f64,
    /// Colours of the figures.
    #[arg(long, value_enum, default_value_t)]
    colours: ColourMap,
    /// Seed of the phases that diffuse power is given in the coherent kinds.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// [`SpectrumKind`] on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Kind {
    /// Each path a lobe.
    Mpc,
    /// The array's beamformer, noncoherent over paths.
    Bartlett,
    /// The same, coherent within a delay tap.
    BartlettCoherent,
    /// Minimum variance (Capon).
    Mvdr,
}

impl From<Kind> for SpectrumKind {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Mpc => Self::Mpc,
            Kind::Bartlett => Self::Bartlett,
            Kind::BartlettCoherent => Self::BartlettCoherent,
            Kind::Mvdr => Self::Mvdr,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum GridKind {
    Pinhole,
    Sphere,
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let wrong = || format!("\"{text}\" is not WIDTHxHEIGHT with 1 to 16384 pixels a side");
    let (width, height) = text.split_once('x').ok_or_else(wrong)?;
    let side = |t: &str| t.parse::<usize>().ok().filter(|n| (1..=16_384).contains(n)).ok_or_else(wrong);
    Ok((side(width)?, side(height)?))
}

/// The spectra of one transmitter before they are written.
struct Formed {
    summary: Value,
    images: Vec<(SpectrumKind, Raster<f32>)>,
    /// In words.
    line: String,
}

/// What a figure says under its title: where, from whom, and what arrives.
fn caption(rx: DVec3, transmitter: &TransmitterConfig, line: &str) -> String {
    let point = |p: DVec3| format!("({:.2}, {:.2}, {:.2}) m", p.x, p.y, p.z);
    format!("At {}, from a transmitter at {}: {line}", point(rx), point(transmitter.position())).replace('-', "−")
}

impl Spectrum {
    /// Runs the command.
    ///
    /// # Errors
    /// A scene that cannot be read or traced, settings out of range, an occupied output folder.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let radio = self.radio()?;
        let config = SceneConfig::load(&self.scene)?;
        let named = |name: &str| config.transmitter_named(Some(name), "--transmitter");
        let transmitters: Vec<&TransmitterConfig> = match self.transmitter.as_slice() {
            [] => vec![config.transmitter_named(None, "--transmitter")?],
            names => names.iter().map(|name| named(name)).collect::<corf_scene::Result<_>>()?,
        };
        let scene = in_use::load(&config)?;
        config.check_radio(&scene)?;
        let rx = self.rx.0;
        let towards = match (self.towards, transmitters.as_slice()) {
            (Some(point), _) => point.0,
            (None, [one]) => one.position(),
            _ => bail!("--transmitter: spectra of several are of one pose\n  help: say with --towards X,Y,Z where it looks"),
        };
        ensure!(rx.distance(towards) > 0.0, "--towards: it is where the receiver is\n  help: give another point to look at");
        let up = if (towards - rx).normalize().cross(DVec3::Z).length() > 1e-6 { DVec3::Z } else { DVec3::X };
        let pose = Rigid3::looking_at(rx, towards, up);
        let (solids, surfaces) = (Solids::of(&scene), Surfaces::of(&scene));
        let mounted = |whose: &str, at: DVec3, facing: Option<DVec3>| -> Result<DVec3> {
            let mount = surfaces.mount(whose, at, facing)?;
            mount.iter().for_each(|mount| note!("{}", mount.words(&format!("the {whose}"))));
            Ok(mount.map_or(at, |mount| mount.position()))
        };
        let rx_off = mounted("receiver", rx, Some(towards - rx))?;
        for tx in &transmitters {
            solids.check_link(&scene, mounted("transmitter", tx.position(), tx.facing())?, rx_off)?;
        }
        let grid = self.grid_of(&radio);
        messages::findings(geometry_warnings(&scene, radio.transmission));

        let bytes = BYTES_A_PIXEL * (grid.width() * grid.height()) as f64;
        let what = format!("spectra of {}x{} pixels", grid.width(), grid.height());
        bounds::memory("--size", &what, bytes, "give fewer pixels")?;
        let bvh = Bvh::build(&scene);
        let formed: Vec<Formed> = transmitters
            .iter()
            .map(|transmitter| self.form(transmitter, &radio, &config, &scene, &bvh, &pose, grid))
            .collect::<Result<_>>()?;
        let folder = claim_fresh(&self.out)?;
        let frequency_hz = config.radio.frequency_hz;
        let mut summaries = Vec::new();
        let mut lines = Vec::new();
        for (number, of_one) in formed.into_iter().enumerate() {
            let [shown, out] = [self.out.as_path(), folder.path()]
                .map(|path| if transmitters.len() == 1 { path.to_path_buf() } else { path.join(format!("tx{number}")) });
            let Formed { mut summary, images, line } = of_one;
            let caption = caption(rx, transmitters[number], &line);
            let written: Vec<Value> = images
                .iter()
                .map(|(kind, image)| self.write(&out, kind.name(), Quantity::of(*kind), image, (grid, frequency_hz, &caption)))
                .collect::<Result<_>>()?;
            lines.push(format!("{line}; {} in {}", counted(written.len(), "spectrum"), shown.display()));
            summary["spectra"] = json!(written);
            write_json(&out.join("spectrum.json"), &summary)?;
            summaries.push(summary);
        }
        let summary = match (summaries.len(), summaries.pop()) {
            (1, Some(only)) => only,
            (_, last) => {
                summaries.extend(last);
                let all = json!({ "schema": "corf-spectra/1", "names": self.transmitter, "transmitters": summaries });
                write_json(&folder.path().join("spectrum.json"), &all)?;
                all
            }
        };
        folder.finish()?;
        show(json, &summary, &lines.join("\n"))?;
        Ok(Verdict::Done)
    }

    /// The spectra of one transmitter, and what is to be said of them.
    fn form(
        &self,
        transmitter: &TransmitterConfig,
        radio: &SpectrumConfig,
        config: &SceneConfig,
        scene: &Scene,
        bvh: &Bvh,
        pose: &Rigid3,
        grid: Grid,
    ) -> Result<Formed> {
        let plan = SensorPlan::from_parts(radio, self.seed, transmitter, config);
        let tracer = RadioTracer::new(scene, bvh, plan.tracing)?;
        let sensor = Stage::of("mirrors and photons of the radio field", || RadioSensor::new(&plan, scene, &tracer))?;
        messages::findings(sensor.check([pose])?);
        let kinds: Vec<SpectrumKind> = self.kind.iter().map(|kind| SpectrumKind::from(*kind)).collect();
        let extent = Extent::needed(&kinds, grid, config.receiver.rear);
        let received = Stage::of("what arrives at the receiver", || sensor.receive(pose, extent))?;
        let all = received.port_pairs.concat();
        let power: f64 = all.iter().map(|a| a.power).sum();
        let images = kinds
            .into_iter()
            .map(|kind| (kind, SpectrumSettings { kind, ..*sensor.settings() }.form(&received.port_pairs, grid, pose)))
            .collect();
        let share = match &grid {
            Grid::Pinhole(camera) => share_in_frame(&all, camera, pose),
            Grid::Sphere(_) => 1.0,
        };
        let summary = json!({
            "scene": self.scene,
            "frequency_hz": config.radio.frequency_hz,
            "transmitter": transmitter,
            "receiver": config.receiver,
            "world_from_camera": pose.to_rows(),
            "grid": match grid {
                Grid::Pinhole(camera) => json!({ "pinhole": camera }),
                Grid::Sphere(sphere) => json!({ "equirectangular": sphere, "axes": EQUIRECTANGULAR_AXES }),
            },
            "power_reference": "1 W transmitted",
            "paths": received.paths.len(),
            "diffuse_arrivals": received.diffuse.len(),
            "received_power_db": (power > 0.0).then(|| 10.0 * power.log10()),
            "share_in_frame": share,
            "rf": radio,
            "seed": self.seed,
        });
        let arriving = if power > 0.0 {
            format!("{:.2} dB in all, {:.1} % of it in the frame", 10.0 * power.log10(), 100.0 * share)
        } else {
            "nothing arrives".into()
        };
        let line = format!(
            "{} and {}, {arriving}",
            counted(received.paths.len(), "path"),
            counted(received.diffuse.len(), "diffuse arrival")
        );
        Ok(Formed { summary, images, line })
    }

    /// The options as a dataset's `[rf]` would have them.
    fn radio(&self) -> Result<SpectrumConfig> {
        let has = |kind| self.kind.contains(&kind);
        let idle = [
            ("--fov-deg", self.fov_deg.is_some() && self.grid == GridKind::Sphere, "the sphere is seen whole"),
            ("--lobe-deg", self.lobe_deg.is_some() && !has(Kind::Mpc), "it is of mpc"),
            ("--loading", self.loading.is_some() && !has(Kind::Mvdr), "it is of mvdr"),
        ];
        for (flag, is_idle, why) in idle {
            ensure!(!is_idle, "{flag}: it has no effect: {why}\n  help: leave it out");
        }
        // The one that tells most apart says how finely is looked.
        let finest = self.kind.iter().find(|kind| **kind == Kind::Mpc).or(self.kind.first());
        let usual = SpectrumConfig::default();
        let mut radio = SpectrumConfig {
            spectrum: finest.map_or_else(SpectrumKind::default, |kind| SpectrumKind::from(*kind)),
            horizontal_fov_deg: self.fov_deg.unwrap_or(usual.horizontal_fov_deg),
            diffuse: !self.no_diffuse,
            lobe_width_deg: self.lobe_deg.unwrap_or(usual.lobe_width_deg),
            bandwidth_hz: self.bandwidth,
            mvdr_loading: self.loading.unwrap_or(usual.mvdr_loading),
            dynamic_range_db: self.range_db,
            ..usual
        };
        (radio.width, radio.height) = self.size.unwrap_or((radio.width, radio.height));
        path_args_over!(self.paths, radio);
        self.scattering.check_unused(radio.diffuse, "leave --no-diffuse out, or the flag")?;
        self.scattering.over(&mut radio.directions, &mut radio.photons, &mut radio.patch_size_m);
        radio.validate("corf spectrum")?;
        Ok(radio)
    }

    fn grid_of(&self, radio: &SpectrumConfig) -> Grid {
        match (self.grid, self.size.unwrap_or((720, 360))) {
            (GridKind::Pinhole, _) => {
                Grid::Pinhole(Pinhole::from_horizontal_fov(radio.width, radio.height, radio.horizontal_fov_deg))
            }
            (GridKind::Sphere, (width, height)) => Grid::Sphere(Equirectangular { width, height }),
        }
    }

    /// The files of one spectrum and what is to be said about them.
    fn write(
        &self,
        out: &Path,
        name: &str,
        quantity: Quantity,
        image: &Raster<f32>,
        (grid, frequency_hz, caption): (Grid, f64, &str),
    ) -> Result<Value> {
        if let Some(i) = image.pixels().iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            let (x, y) = (i % image.width(), i / image.width());
            let what = format!("pixel ({x}, {y}) is {}", image.pixels()[i]);
            return Err(
                Error::invalid(name, what, "the scene's powers are beyond single precision: check its sizes and units").into()
            );
        }
        let peak = image.pixels().iter().copied().fold(0f32, f32::max);
        let max_db = if peak > 0.0 { (10.0 * f64::from(peak).log10()).ceil() } else { 0.0 };
        let range = DbRange { min_db: max_db - self.range_db, max_db };
        let file = |ending: &str| out.join(format!("{name}{ending}"));
        io::write_atomic(file(".exr"), &io::encode_exr_f32_in(image, "Y", quantity.unit())?)?;
        io::write_atomic(file("-db.exr"), &io::encode_exr_f32_in(&range.db_image(image), "Y", "dB")?)?;
        io::write_png(file("-jet.png"), &range.jet_image(image))?;
        let title = format!("Angular power spectrum ({name}) at {:.4} GHz", frequency_hz / 1e9).replace(".0000 GHz", " GHz");
        let svg = charts::spectrum([&title, caption], image, grid, (&range, quantity), self.colours)?;
        io::write_atomic(file(".svg"), svg.as_bytes())?;
        Ok(json!({
            "kind": name,
            "quantity": quantity,
            "unit": quantity.unit(),
            "peak_db": (peak > 0.0).then(|| 10.0 * f64::from(peak).log10()),
            "picture_range_db": range,
        }))
    }
}
