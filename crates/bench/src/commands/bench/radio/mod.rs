//! `corf bench radio`: what the radio half of a dataset costs, stage by stage, and how large its sampling error is.
//!
//! Times are those of this run: seconds that passed, and seconds of processor time over all threads where the system tells them, which
//! other programs disturb far less. Errors come from replicas ([`errors`]).

mod errors;

use super::super::spectrum::Kind;
use super::super::{Verdict, show};
use crate::radio_link::{PathArgs, ScatteringArgs, path_args_over};
use crate::scenes::in_use;
use crate::terminal::interrupt;
use crate::terminal::messages;
use crate::terminal::progress::Progress;
use anyhow::{Result, bail, ensure};
use clap::Args;
use corf_raytrace::bvh::Bvh;
use corf_raytrace::radio::{Arrival, DiffuseField, DiffuseSettings, Path, RadioTracer};
use corf_raytrace::sensor::{Extent, SensorPlan, element_at, geometry_warnings, noncoherent};
use corf_raytrace::spectrum;
use corf_scene::Rigid3;
use corf_scene::config::{DatasetConfig, ReceiverConfig, SpectrumKind};
use corf_scene::trajectory;
use corf_scene::words::counted;
use cpu_time::ProcessTime;
use errors::{Errors, Study};
use rayon::prelude::*;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// `corf bench radio`: the flags of tracing go over the dataset's own settings, which are the defaults here.
#[derive(Args)]
pub struct Radio {
    /// Dataset file (TOML).
    config: PathBuf,
    /// Positions along the trajectory; without it all keyframes of the dataset.
    #[arg(long)]
    positions: Option<usize>,
    #[command(flatten)]
    paths: PathArgs,
    #[command(flatten)]
    scattering: ScatteringArgs,
    /// Smallest mirror that is evaluated exactly, steradians.
    #[arg(long)]
    mirror_sr: Option<f64>,
    /// Interactions behind the last scattering, at most; 0 looks at the scattering surfaces themselves alone.
    #[arg(long)]
    after: Option<usize>,
    /// Spectra of this kind instead of the dataset's. Errors of coherent kinds are those of `bartlett`, their mean over phases.
    #[arg(long, conflicts_with = "powers")]
    spectrum: Option<Kind>,
    /// Received powers alone, as a link budget or a coverage map asks for them: all around alike, nothing refined, no spectra.
    #[arg(long)]
    powers: bool,
    /// Independent samplings that the error is taken from; fewer than 2 leave it out.
    #[arg(long, default_value_t = 4)]
    replicas: u64,
    /// Positions at which it is taken.
    #[arg(long, default_value_t = 3)]
    error_positions: usize,
    /// Also take as many samplings of so many directions that cut no outliers, to see what is biased.
    #[arg(long, conflicts_with = "powers")]
    reference_directions: Option<usize>,
}

/// Time of one stage.
#[derive(Clone, Copy, Default, Serialize)]
struct Spent {
    wall_s: f64,
    /// Over all threads.
    cpu_s: Option<f64>,
}

/// Seconds by stage, positions summed up.
#[derive(Clone, Copy, Default, Serialize)]
struct Stages {
    hierarchy: Spent,
    transmitter_chains: Spent,
    /// Layout of the patches, mirrors, photons and their tables.
    photons: Spent,
    specular: Spent,
    /// The patches' lighting included.
    gather: Spent,
    spectrum: Spent,
    total: Spent,
}

/// The whole answer.
#[derive(Serialize)]
struct Answer {
    schema: &'static str,
    config: String,
    threads: usize,
    triangles: usize,
    positions: usize,
    depth: usize,
    transmission: bool,
    diffraction: bool,
    transmitter_m: [f64; 3],
    /// This and what follows of the diffuse field is absent where the dataset has none.
    after: Option<usize>,
    powers: bool,
    /// Kind of the spectra.
    spectrum: SpectrumKind,
    directions: Option<usize>,
    photons: Option<usize>,
    patch_size_m: Option<f64>,
    sources: Option<usize>,
    patches: Option<usize>,
    photon_tables_mb: Option<f64>,
    seconds: Stages,
    /// 10 log10 of the mean over positions, relative to 1 W transmitted; absent without any power.
    mean_specular_db: Option<f64>,
    mean_diffuse_db: Option<f64>,
    standard_error: Option<Errors>,
}

/// Positions at a time: where one leaves a core idle, another goes on.
const AT_ONCE: usize = 8;

/// Runs a stage and adds its time.
fn timed<T>(spent: &mut Spent, stage: impl FnOnce() -> T) -> T {
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let result = stage();
    spent.wall_s += start.elapsed().as_secs_f64();
    spent.cpu_s = cpu_seconds().zip(cpu).map(|(now, before)| spent.cpu_s.unwrap_or(0.0) + now - before);
    result
}

/// Processor time of this process over all threads, seconds, where the system tells it.
fn cpu_seconds() -> Option<f64> {
    ProcessTime::try_now().ok().map(|time| time.as_duration().as_secs_f64())
}

impl Radio {
    /// Runs the command.
    ///
    /// # Errors
    /// A configuration or scene that cannot be read or traced.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let mut config = DatasetConfig::load(&self.config)?;
        config.radio.spectrum = self.spectrum.map_or(config.radio.spectrum, SpectrumKind::from);
        path_args_over!(self.paths, config.radio);
        config.validate()?;
        let scene_config = config.load_scene_config()?;
        let Some(way) = scene_config.trajectory.as_ref() else {
            bail!("{}: no [trajectory]\n  help: positions are taken along it", scene_config.source.display());
        };
        let poses = trajectory::generate_between(way, self.positions.unwrap_or(config.keyframes), config.way)?;
        let scene = in_use::load(&scene_config)?;
        scene_config.check_radio(&scene)?;
        scene_config.check_placement(&scene)?;
        messages::findings(geometry_warnings(&scene, config.radio.transmission));
        let mut seconds = Stages::default();
        let bvh = timed(&mut seconds.hierarchy, || Bvh::build(&scene));
        let plan = SensorPlan::of(&config, &scene_config)?;
        let tx = plan.transmitter.position();
        let sampling = self.sampling(&plan)?;
        let tracer = timed(&mut seconds.hierarchy, || RadioTracer::new(&scene, &bvh, plan.tracing))?;
        let transmitter = timed(&mut seconds.transmitter_chains, || tracer.transmitter(tx))?;
        let field = timed(&mut seconds.photons, || sampling.map(|s| DiffuseField::new(&tracer, tx, &s)).transpose())?;
        let form = plan.spectrum;
        let camera = config.radio_camera();
        let extent = if self.powers { Extent::Sphere } else { Extent::of_keyframe(&config.radio, &plan.receiver) };
        let platform = Platform { config: &config, receiver: &plan.receiver, tracer: &tracer, extent };
        let (mut specular_power, mut diffuse_power) = (0.0, 0.0);
        let mut progress = Progress::start("bench radio", poses.len(), "positions");
        for (i, batch) in poses.chunks(AT_ONCE).enumerate() {
            interrupt::check()?;
            let poses_of = || batch.par_iter().map(|pose| &pose.world_from_camera);
            let paths = timed(&mut seconds.specular, || {
                poses_of().map(|pose| transmitter.paths(pose.translation)).collect::<corf_scene::Result<Vec<_>>>()
            })?;
            let diffuse = timed(&mut seconds.gather, || {
                let gather = |pose| field.as_ref().map_or_else(|| Ok(Vec::new()), |field| platform.gather(field, pose));
                poses_of().map(gather).collect::<corf_scene::Result<Vec<_>>>()
            })?;
            let mut port_pairs: Vec<_> =
                batch.iter().zip(&paths).map(|(pose, p)| platform.port_pairs(p, &pose.world_from_camera)).collect();
            for (port_pairs, diffuse) in port_pairs.iter_mut().zip(diffuse) {
                specular_power += power(port_pairs.iter().flatten()) / poses.len() as f64;
                diffuse_power += power(&diffuse) / poses.len() as f64;
                port_pairs[0].extend(diffuse);
            }
            if !self.powers {
                timed(&mut seconds.spectrum, || {
                    poses_of()
                        .zip(&port_pairs)
                        .for_each(|(pose, port_pairs)| drop(std::hint::black_box(form.form(port_pairs, &camera, pose))));
                });
            }
            progress.set(i * AT_ONCE + batch.len(), poses.len());
        }
        progress.finish();
        seconds.total = seconds.sum();
        let standard_error = match (self.replicas, &sampling) {
            // What is not sampled has no error of sampling.
            (0 | 1, _) | (_, None) => None,
            (replicas, Some(sampling)) => {
                let form = noncoherent(&form);
                let form = (!self.powers).then_some(&form);
                let study = Study {
                    platform: &platform,
                    transmitter: &transmitter,
                    form,
                    poses: &poses,
                    replicas,
                    count: self.error_positions,
                    reference: self.reference_directions,
                };
                Some(study.errors(sampling)?)
            }
        };
        let answer = Answer {
            schema: "corf-bench-radio/1",
            config: self.config.display().to_string(),
            threads: rayon::current_num_threads(),
            triangles: scene.triangles.len(),
            positions: poses.len(),
            depth: plan.tracing.max_interactions,
            transmission: plan.tracing.transmission,
            diffraction: plan.tracing.diffraction,
            transmitter_m: plan.transmitter.position_m,
            after: sampling.map(|s| s.after.min(plan.tracing.max_interactions.saturating_sub(1))),
            powers: self.powers,
            spectrum: form.kind,
            directions: sampling.map(|s| s.directions),
            photons: sampling.map(|s| s.photons),
            patch_size_m: sampling.map(|s| s.patch_size_m),
            sources: field.as_ref().map(DiffuseField::source_count),
            patches: field.as_ref().map(DiffuseField::patch_count),
            photon_tables_mb: field.as_ref().map(DiffuseField::cache_megabytes),
            seconds,
            mean_specular_db: decibels(specular_power),
            mean_diffuse_db: decibels(diffuse_power),
            standard_error,
        };
        show(json, &answer, &answer.text())?;
        Ok(Verdict::Done)
    }

    /// The dataset's sampling of the diffuse field with what was asked for instead; `None` where the dataset has none.
    fn sampling(&self, plan: &SensorPlan) -> Result<Option<DiffuseSettings>> {
        let Some(mut sampling) = plan.sampling else {
            let help = "set `diffuse = true` in the dataset's [rf], or leave it out";
            self.scattering.check_unused(false, help)?;
            let asked = [
                ("--mirror-sr", self.mirror_sr.is_some()),
                ("--after", self.after.is_some()),
                ("--reference-directions", self.reference_directions.is_some()),
            ];
            if let Some((option, _)) = asked.iter().find(|(_, given)| *given) {
                bail!("{option}: no scattered power is traced that it could sample\n  help: {help}");
            }
            return Ok(None);
        };
        self.scattering.over(&mut sampling.directions, &mut sampling.photons, &mut sampling.patch_size_m);
        sampling.min_mirror_sr = self.mirror_sr.unwrap_or(sampling.min_mirror_sr);
        sampling.after = self.after.unwrap_or(sampling.after);
        if self.powers {
            sampling.resolution_deg = 0.0;
        }
        if let Some(directions) = self.reference_directions {
            ensure!(
                self.replicas >= 2,
                "--reference-directions: {} replicas show no error\n  help: give --replicas 2 or more",
                self.replicas
            );
            DiffuseSettings { directions, ..sampling }.validate()?;
        }
        Ok(Some(sampling))
    }
}

/// The receiver of every position.
struct Platform<'a> {
    config: &'a DatasetConfig,
    receiver: &'a ReceiverConfig,
    tracer: &'a RadioTracer<'a>,
    /// Extent that is gathered finely.
    extent: Extent,
}

impl Platform<'_> {
    /// The resolved arrivals of every pair of antenna ports, the element at the platform's attitude.
    fn port_pairs(&self, paths: &[Path], pose: &Rigid3) -> Vec<Vec<Arrival>> {
        let settings = self.tracer.settings();
        spectrum::port_pairs(paths, &settings.tx_antenna, &element_at(self.receiver, pose), settings.frequency_hz)
    }

    /// Diffuse arrivals at a pose.
    fn gather(&self, field: &DiffuseField<'_, '_>, pose: &Rigid3) -> corf_scene::Result<Vec<Arrival>> {
        self.extent.gather(field, pose, &element_at(self.receiver, pose))
    }
}

/// Decibels of a power relative to that transmitted; none of none.
fn decibels(power: f64) -> Option<f64> {
    (power > 0.0).then(|| 10.0 * power.log10())
}

/// Power of all arrivals, relative to 1 W transmitted.
fn power<'a>(arrivals: impl IntoIterator<Item = &'a Arrival>) -> f64 {
    arrivals.into_iter().map(|a| a.power).sum()
}

impl Stages {
    fn named(&self) -> [(&'static str, Spent); 6] {
        [
            ("hierarchy and faces", self.hierarchy),
            ("transmitter chains", self.transmitter_chains),
            ("patches and photons", self.photons),
            ("specular paths", self.specular),
            ("gathering", self.gather),
            ("spectra", self.spectrum),
        ]
    }

    fn sum(&self) -> Spent {
        let ran = self.named().into_iter().filter(|(_, s)| s.wall_s > 0.0);
        ran.fold(Spent { wall_s: 0.0, cpu_s: Some(0.0) }, |sum, (_, s)| Spent {
            wall_s: sum.wall_s + s.wall_s,
            cpu_s: sum.cpu_s.zip(s.cpu_s).map(|(a, b)| a + b),
        })
    }
}

impl Answer {
    fn text(&self) -> String {
        let mut lines = vec![
            format!(
                "{}: {}, depth {}, {}, {}, {}",
                self.config,
                counted(self.positions, "position"),
                self.depth,
                if self.powers { "powers" } else { self.spectrum.name() },
                counted(self.triangles, "triangle"),
                counted(self.threads, "thread")
            ),
            self.sampling_text(),
            format!("{:<22} {:>9} {:>9}", "stage", "wall s", "cpu s"),
        ];
        for (name, spent) in self.seconds.named().into_iter().chain([("all", self.seconds.total)]) {
            let cpu = spent.cpu_s.map_or("-".into(), |s| format!("{s:.2}"));
            lines.push(format!("{name:<22} {:>9.2} {cpu:>9}", spent.wall_s));
        }
        let [specular, diffuse] =
            [self.mean_specular_db, self.mean_diffuse_db].map(|db| db.map_or("none".to_owned(), |db| format!("{db:.2} dB")));
        lines.push(format!("mean power: specular {specular}, diffuse {diffuse} relative to 1 W transmitted"));
        lines.extend(self.standard_error.iter().flat_map(Errors::text));
        lines.join("\n")
    }

    fn sampling_text(&self) -> String {
        let (Some(directions), Some(photons), Some(patches), Some(patch_size_m), Some(megabytes), Some(sources)) =
            (self.directions, self.photons, self.patches, self.patch_size_m, self.photon_tables_mb, self.sources)
        else {
            return "no diffuse field, as the dataset says".to_owned();
        };
        format!(
            "{directions} directions, {photons} photons on {patches} patches of {patch_size_m} m ({megabytes:.0} MB), {sources} exact sources"
        )
    }
}
