//! `corf diffuse`: what surfaces scatter towards receivers, and which of them.

use super::{Verdict, print};
use crate::note;
use crate::radio_link::{InteractionArgs, PointArg, ScatteringArgs};
use crate::run::claim_shared;
use crate::scenes::in_use;
use crate::terminal::interrupt;
use crate::terminal::messages;
use crate::terminal::progress::{Progress, Stage};
use anyhow::Result;
use clap::Args;
use corf_raytrace::bvh::Bvh;
use corf_raytrace::radio::diffuse::{Contribution, NO_MIRRORS_SR};
use corf_raytrace::radio::{DiffuseField, DiffuseSettings, RadioSettings, RadioTracer, Solids};
use corf_raytrace::sensor::{geometry_warnings, radio_settings};
use corf_scene::config::SceneConfig;
use corf_scene::mounting::Surfaces;
use corf_scene::npz::{Array, Values};
use corf_scene::{Scene, bounds, io, near_field};
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// `corf diffuse`.
#[derive(Args)]
pub struct Diffuse {
    /// Scene file (.toml).
    scene: PathBuf,
    /// Transmitter, world metres `x,y,z`; without it the scene's own.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    tx: Option<PointArg>,
    /// Receiver, world metres `x,y,z`; any number of times.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, required = true)]
    rx: Vec<PointArg>,
    #[command(flatten)]
    interactions: InteractionArgs,
    #[command(flatten)]
    scattering: ScatteringArgs,
    /// Mirrors that fill this much of the transmitter's view light surfaces by their exact image, steradians; by default none.
    #[arg(long, default_value_t = NO_MIRRORS_SR)]
    mirror_sr: f64,
    /// Independent samplings; two or more give a standard error.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    replicas: u64,
    /// Leave out specular reflection.
    #[arg(long)]
    no_reflection: bool,
    /// Folder for the arrivals, one `RRRRR-SS.npy` for each receiver and sampling: float64 rows of direction x, y, z (world, from the
    /// receiver), power (linear, relative to 1 W transmitted), mean delay (s) and the number of interactions behind the scattering.
    #[arg(long, value_name = "DIR")]
    arrivals: Option<PathBuf>,
}

/// Power by the object that scattered it, and by the number of interactions behind it.
#[derive(Clone, Default)]
struct Sums {
    by_object: BTreeMap<u32, f64>,
    by_hops_after: BTreeMap<usize, f64>,
    /// Power of paths that end with the scattering, by object.
    ending_by_object: BTreeMap<u32, f64>,
}

impl Sums {
    fn of(contributions: &[(DVec3, Contribution)]) -> Self {
        let mut sums = Self::default();
        for (_, c) in contributions {
            *sums.by_object.entry(c.object).or_default() += c.power;
            *sums.by_hops_after.entry(c.after).or_default() += c.power;
            if c.after == 0 {
                *sums.ending_by_object.entry(c.object).or_default() += c.power;
            }
        }
        sums
    }

    fn total(&self) -> f64 {
        self.by_object.values().sum()
    }
}

/// Mean and standard error of the mean over samplings; without a second one there is no error.
fn estimate(values: &[f64]) -> Value {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    json!({ "power": mean, "standard_error": (values.len() > 1).then(|| (variance / n).sqrt()) })
}

impl Diffuse {
    /// Runs the command.
    ///
    /// # Errors
    /// A scene that cannot be read or traced, settings out of range, files that cannot be written.
    pub fn run(mut self) -> Result<Verdict> {
        let config = SceneConfig::load(&self.scene)?;
        let scene = in_use::load(&config)?;
        config.check_radio(&scene)?;
        let tx = self.tx.map_or(config.transmitter.position(), |p| p.0);
        let bvh = Bvh::build(&scene);
        let mut settings = RadioSettings { reflection: !self.no_reflection, ..radio_settings(&config) };
        self.interactions.over(&mut settings.max_interactions, &mut settings.transmission);
        let mut sampling = DiffuseSettings { min_mirror_sr: self.mirror_sr, ..DiffuseSettings::default() };
        self.scattering.over(&mut sampling.directions, &mut sampling.photons, &mut sampling.patch_size_m);
        let tracer = RadioTracer::new(&scene, &bvh, settings)?;
        let solids = Solids::of(&scene);
        let surfaces = Surfaces::of(&scene);
        let mounted = |whose: &str, at: DVec3, facing: Option<DVec3>| -> Result<DVec3> {
            let mount = surfaces.mount(whose, at, facing)?;
            mount.iter().for_each(|mount| note!("{}", mount.words(&format!("the {whose}"))));
            Ok(mount.map_or(at, |mount| mount.position()))
        };
        let tx = mounted("transmitter", tx, config.transmitter.facing())?;
        for rx in &mut self.rx {
            rx.0 = mounted("receiver", rx.0, None)?;
        }
        for rx in &self.rx {
            tracer.check_receiver(tx, rx.0)?;
            tracer.check_in_the_open("receiver", rx.0)?;
            solids.check_link(&scene, tx, rx.0)?;
        }
        let samplings = (self.rx.len() as u64).saturating_mul(self.replicas);
        bounds::count("--replicas", samplings as usize, bounds::MAX_LINKS, "samplings of receivers")?;
        let near =
            |rx: &PointArg| near_field::finding(&format!("receiver at {}", rx.0), rx.0.distance(tx), config.radio.frequency_hz);
        messages::findings(self.rx.iter().filter_map(near));
        messages::findings(geometry_warnings(&scene, settings.transmission));
        let _held = self.arrivals.as_deref().map(claim_shared).transpose()?;
        let replicas = self.replicas;
        let mut sums = vec![Vec::new(); self.rx.len()];
        let mut progress = Progress::start("diffuse", self.rx.len() * replicas as usize, "receivers");
        for phase in 0..replicas {
            let photons = || DiffuseField::new(&tracer, tx, &DiffuseSettings { phase, ..sampling });
            let field = Stage::of("photons of the radio field", photons)?;
            for (i, rx) in self.rx.iter().enumerate() {
                interrupt::check()?;
                let contributions = field.contributions(rx.0)?;
                if let Some(folder) = &self.arrivals {
                    write_arrivals(&folder.join(format!("{i:05}-{phase:02}.npy")), &contributions)?;
                }
                sums[i].push(Sums::of(&contributions));
                progress.set(phase as usize * self.rx.len() + i + 1, self.rx.len() * replicas as usize);
            }
        }
        progress.finish();
        let receivers: Vec<Value> = self.rx.iter().zip(&sums).map(|(rx, sums)| receiver(&scene, rx.0, sums)).collect();
        let report = json!({
            "schema": "corf-diffuse/1",
            "scene": scene.name,
            "frequency_hz": config.radio.frequency_hz,
            "depth": settings.max_interactions,
            "directions": sampling.directions,
            "replicas": replicas,
            "tx": tx.to_array(),
            "receivers": receivers,
        });
        print(&serde_json::to_string_pretty(&report)?)?;
        Ok(Verdict::Done)
    }
}

/// One receiver's powers: linear, relative to 1 W transmitted.
fn receiver(scene: &Scene, rx: DVec3, samplings: &[Sums]) -> Value {
    let over = |part: &dyn Fn(&Sums) -> f64| estimate(&samplings.iter().map(part).collect::<Vec<f64>>());
    let by_object = |part: fn(&Sums) -> &BTreeMap<u32, f64>| -> BTreeMap<&str, Value> {
        // Objects of one name are one entry.
        let mut names: BTreeMap<&str, BTreeSet<u32>> = BTreeMap::new();
        for &o in samplings.iter().flat_map(|s| part(s).keys()) {
            names.entry(scene.objects.get(o as usize).map_or("", |object| object.name.as_str())).or_default().insert(o);
        }
        let power = |s: &Sums, of: &BTreeSet<u32>| of.iter().filter_map(|o| part(s).get(o)).sum::<f64>();
        names.iter().map(|(name, of)| (*name, over(&|s| power(s, of)))).collect()
    };
    let hops: BTreeMap<usize, Value> = samplings
        .iter()
        .flat_map(|s| s.by_hops_after.keys().copied())
        .map(|h| (h, over(&|s| s.by_hops_after.get(&h).copied().unwrap_or(0.0))))
        .collect();
    json!({
        "rx": rx.to_array(),
        "total": over(&Sums::total),
        "by_interactions_after_the_scattering": hops,
        "by_object": by_object(|s| &s.by_object),
        "ending_with_the_scattering_by_object": by_object(|s| &s.ending_by_object),
    })
}

/// Writes arrivals, one for every direction and number of interactions behind the scattering, as a float64 table.
fn write_arrivals(path: &Path, contributions: &[(DVec3, Contribution)]) -> Result<()> {
    let rows: Vec<[f64; 6]> = contributions
        .chunk_by(|a, b| a.0 == b.0 && a.1.after == b.1.after)
        .map(|of_one| {
            let power: f64 = of_one.iter().map(|(_, c)| c.power).sum();
            let delay_s = of_one.iter().map(|(_, c)| c.power * c.delay_s).sum::<f64>() / power;
            let (direction, first) = &of_one[0];
            [direction.x, direction.y, direction.z, power, delay_s, first.after as f64]
        })
        .collect();
    let table = Array::new("arrivals", &[rows.len(), 6], Values::F64(rows.into_flattened()));
    Ok(io::write_atomic(path, &table.to_npy())?)
}
