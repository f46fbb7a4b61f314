//! `corf bench network`: how fast the networks of the baselines NeRF² and WRF-GS+ are, beside the device's peak.

use super::super::{Verdict, show};
#[cfg(feature = "gpu")]
use crate::device::network_options;
use crate::device::{Backend, DeviceChoice};
use crate::methods;
use crate::record::provenance::Provenance;
use crate::studies::workload;
use crate::terminal::interrupt;
use anyhow::Result;
use clap::Args;
use corf_baselines::nerf2::{Nerf2Config, Nerf2CpuTrainer, Nerf2Model, Nerf2Trainer, TrainingRays};
use corf_baselines::rf_3dgs::DensityConfig;
use corf_baselines::wrf_gs_plus::{self, WrfGsPlusConfig, WrfGsPlusReconstructor};
use corf_scene::keyframe::DbRange;
use corf_scene::{Keyframe, Pinhole, Radio, Raster, Rigid3, bounds};
use serde::Serialize;
use std::fmt::Write as _;
use std::time::Instant;

/// `corf bench network`.
#[derive(Args)]
pub struct Network {
    /// Rows of the matrix products.
    #[arg(long, default_value_t = 524_288)]
    rows: usize,
    /// Width of the layer whose products are measured.
    #[arg(long, default_value_t = 256)]
    width: usize,
    /// Rays of a NeRF² step (64 samples each); 0 measures none.
    #[arg(long, default_value_t = 8192)]
    rays: usize,
    /// Gaussians of a WRF-GS+ step (one 300x200 spectrum); 0 measures none.
    #[arg(long, default_value_t = 200_000)]
    gaussians: usize,
    /// Steps timed, after one that warms up.
    #[arg(long, default_value_t = 10)]
    steps: usize,
    /// Peak of the device in f32, TFLOP/s (default: an H100 SXM's 66.9).
    #[arg(long, default_value_t = 66.9)]
    tflops: f64,
    /// Device it runs on: auto, cpu, gpu, or gpu:N for the N-th adapter. Products alone are measured on a GPU only.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

/// WRF-GS+ steps between two looks for an interrupt.
const SUBMITTED: usize = 20;

/// How the name of what was measured ends.
fn precision(half: bool) -> &'static str {
    if half { ", f16" } else { "" }
}

/// One thing measured.
#[derive(Serialize)]
struct Measured {
    name: String,
    ms: f64,
    tflops: f64,
    share_of_peak: f64,
}

/// All that a run of the command found.
#[derive(Serialize)]
struct Report {
    provenance: Provenance,
    device: String,
    rows: usize,
    width: usize,
    rays: usize,
    gaussians: usize,
    peak_tflops: f64,
    measured: Vec<Measured>,
}

impl Network {
    /// Runs the command.
    ///
    /// # Errors
    /// Sizes out of range, a device without memory, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        bounds::count("--steps", self.steps, 100_000, "of them")?;
        bounds::count("--rows", self.rows, 1 << 22, "of them")?;
        bounds::count("--width", self.width, 4096, "of them")?;
        bounds::count("--gaussians", self.gaussians, 20_000_000, "of them")?;
        bounds::number("--tflops", self.tflops, &(1e-6..=1e9), "of the device")?;
        let backend = self.device.resolve()?;
        let mut measured = vec![];
        // In half precision as well, where the device has it.
        for half in [false, true].into_iter().filter(|half| !half || backend.multiplies_in_half(true)) {
            measured.extend(self.products(&backend, half)?);
            if self.rays > 0 && self.steps > 0 {
                measured.push(self.step(&backend, half)?);
            }
            if self.gaussians > 0 && self.steps > 0 {
                measured.push(self.deformed_step(&backend, half)?);
            }
        }
        let mut text = format!("{} (peak {} TFLOP/s)", backend.name(), self.tflops);
        for m in &measured {
            let share = 100.0 * m.share_of_peak;
            let _ = write!(text, "\n  {:<44} {:>10.3} ms {:>8.3} TFLOP/s {share:>6.1} %", m.name, m.ms, m.tflops);
        }
        let report = Report {
            provenance: Provenance::here(),
            device: backend.name(),
            rows: self.rows,
            width: self.width,
            rays: self.rays,
            gaussians: self.gaussians,
            peak_tflops: self.tflops,
            measured,
        };
        show(json, &report, &text)?;
        Ok(Verdict::Done)
    }

    fn measured(&self, name: String, seconds: f64, operations: f64) -> Measured {
        let tflops = operations / seconds / 1e12;
        Measured { name, ms: 1e3 * seconds, tflops, share_of_peak: tflops / self.tflops }
    }

    /// The three products of a layer, by tile.
    fn products(&self, backend: &Backend, half: bool) -> Result<Vec<Measured>> {
        match backend {
            Backend::Cpu => {
                let _ = half;
                Ok(vec![])
            }
            #[cfg(feature = "gpu")]
            Backend::Gpu { number, .. } => {
                anyhow::ensure!(self.rows > 0 && self.width > 0, "--rows and --width: give at least 1");
                let times = corf_baselines::mlp::gpu::measure_products(&network_options(*number, half), self.rows, self.width)?;
                let line = |t: corf_baselines::mlp::gpu::ProductTime| {
                    let [down, across] = t.tile;
                    let name = format!("{}, {}x{}, tiles {down}x{across}{}", t.name, self.rows, self.width, precision(half));
                    self.measured(name, t.seconds, t.operations)
                };
                Ok(times.into_iter().map(line).collect())
            }
        }
    }

    /// A whole training step of NeRF² as published, with as many rays as asked for.
    fn step(&self, backend: &Backend, half: bool) -> Result<Measured> {
        let config = Nerf2Config { rays: self.rays, half_precision: half, ..Nerf2Config::default() };
        config.validate()?;
        let network = Nerf2Model::new(&config).network;
        let mut rays = TrainingRays::new(Pinhole::from_horizontal_fov(300, 200, 90.0), 1);
        rays.push(Rigid3::IDENTITY, &Raster::from_fn(300, 200, |x, y| ((x + y) % 50) as f32 / 50.0))?;
        let mut trainer: Box<dyn Nerf2Trainer> = match backend {
            Backend::Cpu => Box::new(Nerf2CpuTrainer::new(&config, [0.0; 3], network.initial(1))?),
            #[cfg(feature = "gpu")]
            Backend::Gpu { number, .. } => {
                let options = network_options(*number, half);
                Box::new(corf_baselines::nerf2::Nerf2GpuTrainer::new(&options, &config, [0.0; 3], &network.initial::<f32>(1))?)
            }
        };
        let mut run = |steps: std::ops::Range<usize>| -> Result<f64> {
            let start = Instant::now();
            for step in steps {
                interrupt::check()?;
                trainer.step(&rays.batch(&config, step as u64), config.rate)?;
            }
            // Waits for the last one.
            trainer.loss()?;
            Ok(start.elapsed().as_secs_f64())
        };
        run(0..1)?;
        let seconds = run(1..1 + self.steps)? / self.steps as f64;
        let operations = (self.rays * config.samples) as f64 * network.operations();
        Ok(self.measured(
            format!("NeRF² step, {} rays of {} samples{}", self.rays, config.samples, precision(half)),
            seconds,
            operations,
        ))
    }

    /// A whole training step of WRF-GS+ as published, with as many Gaussians as asked for: deformation, a spectrum, both ways, both optimisers. The
    /// operations counted are the network's.
    fn deformed_step(&self, backend: &Backend, half: bool) -> Result<Measured> {
        // Nothing is cloned, split, pruned or reset, but what decides it is summed up.
        let density = DensityConfig { from: usize::MAX, until: usize::MAX, reset_every: usize::MAX, ..DensityConfig::default() };
        let config = WrfGsPlusConfig {
            random_points: self.gaussians,
            iterations: self.steps + 1,
            half_precision: half,
            density,
            ..WrfGsPlusConfig::default()
        };
        config.validate()?;
        let network = wrf_gs_plus::WrfGsPlusModel::new(&config).network;
        let rig = workload::rig([1, 1], [300, 200]);
        let range = DbRange { min_db: -120.0, max_db: -60.0 };
        let trainer = methods::wrf_gs_plus::trainer(backend, &config, network.initial(1))?;
        let mut reconstructor = WrfGsPlusReconstructor::new(trainer, config, rig.light, rig.radio, range, 1)?;
        for (index, pose) in rig.world_from_camera.iter().enumerate() {
            reconstructor.receive(&Keyframe {
                index,
                time_s: 0.0,
                world_from_camera: *pose,
                light: None,
                radio: Some(Radio {
                    spectrum: Raster::from_fn(300, 200, |x, y| 10_f32.powf(-12.0 + 0.1 * ((x + y + index) % 50) as f32)),
                }),
            })?;
        }
        reconstructor.begin()?;
        reconstructor.train(1)?;
        let start = Instant::now();
        while reconstructor.train(SUBMITTED)?.is_some() {
            interrupt::check()?;
        }
        let seconds = start.elapsed().as_secs_f64() / self.steps as f64;
        let operations = self.gaussians as f64 * network.operations();
        Ok(self.measured(format!("WRF-GS+ step, {} Gaussians, 300x200{}", self.gaussians, precision(half)), seconds, operations))
    }
}
