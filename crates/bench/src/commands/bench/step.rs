//! `corf bench step`: milliseconds of a coupled training step, stage by stage, beside the floor.

use super::super::{Verdict, show};
use crate::device::{Backend, DeviceChoice};
use crate::record::provenance::Provenance;
use crate::studies::workload::{self, Rig};
use crate::terminal::interrupt;
use anyhow::{Context, Result, ensure};
use clap::Args;
#[cfg(feature = "gpu")]
use corf::device::gpu::{GpuDevice, GpuOptions};
use corf::{Antialias, CpuDevice, Device, Gaussians, RasterConfig, device::TrainingView, files::ply};
#[cfg(feature = "gpu")]
use corf_gpu::AdapterOptions;
use corf_scene::bounds;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::PathBuf;
#[cfg(feature = "gpu")]
use std::time::Instant;

/// `corf bench step`.
#[derive(Args)]
pub struct Step {
    /// Gaussians as a coupled PLY file; with --table one file per size it needs, others are drawn. May be repeated.
    #[arg(long)]
    ply: Vec<PathBuf>,
    /// Cameras as JSON: width, height, fx, fy, cx, cy, camera_from_world (4×4 by rows). Default: sixteen around a room.
    #[arg(long, conflicts_with = "table")]
    cameras: Option<PathBuf>,
    /// Gaussians to draw where no file is given.
    #[arg(long, default_value_t = 200_000)]
    gaussians: usize,
    /// Optical image, pixels.
    #[arg(long, value_parser = size, default_value = "640x480", conflicts_with = "cameras")]
    size: [usize; 2],
    /// RF image, pixels (default: as the optical one).
    #[arg(long = "rf", value_parser = size, value_name = "RF")]
    radio: Option<[usize; 2]>,
    /// Measure the six workloads that are published instead.
    #[arg(long)]
    table: bool,
    /// Steps timed, in each of --repeats runs.
    #[arg(long, default_value_t = 160)]
    steps: usize,
    /// Runs; the median is what counts.
    #[arg(long, default_value_t = 5)]
    repeats: usize,
    /// Pixel filter; the peers measure with it off.
    #[arg(long, value_enum, default_value_t = Filter::Off)]
    antialias: Filter,
    /// GPU: a tile and a batch such as 8x8/32, or 8x8/32/apart for two images of one camera blended one after the other, or
    /// 8x8/32/portable without subgroup operations, or 8x8/32/by4 with four threads for each pixel's list. Several are compared.
    #[arg(long = "variant", value_parser = variant)]
    variants: Vec<Variant>,
    /// GPU: frames of novel views to draw per variant, both images and depth (0: none).
    #[arg(long, default_value_t = 0)]
    frames: usize,
    /// Memory bandwidth for the floor, GB/s (default: measured on an H200).
    #[arg(long, default_value_t = 4200.0)]
    bandwidth_gb_s: f64,
    /// Arithmetic for the floor, TFLOP/s (default: measured on an H200).
    #[arg(long, default_value_t = 64.0)]
    tflops: f64,
    /// Device that takes the steps: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Filter {
    On,
    Off,
}

/// More steps, repeats or frames are more likely a mistake.
const MAX_REPETITIONS: usize = 1_000_000;
/// Memory of the images of all cameras with their targets, gradients and pyramids, bytes for a pixel of one of them.
const BYTES_A_PIXEL: f64 = 1000.0;
/// Memory of a Gaussian with its gradient and moments, bytes.
const BYTES_A_GAUSSIAN: f64 = 1000.0;

/// `640x480`.
pub(in crate::commands) fn size(text: &str) -> Result<[usize; 2], String> {
    let parse = |t: &str| t.parse::<usize>().ok().filter(|n| (1..=16384).contains(n));
    match text.split_once('x').map(|(w, h)| (parse(w), parse(h))) {
        Some((Some(w), Some(h))) => Ok([w, h]),
        _ => Err(format!("{text} is no size in pixels such as 640x480")),
    }
}

/// Variant of the GPU device's work, which is compared with others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
struct Variant {
    /// Pixels across and down a tile, where that is not left to the frame.
    tile: Option<[usize; 2]>,
    batch: u32,
    fused: bool,
    subgroups: bool,
    /// Threads that share a pixel's list, where that is not left to the frame.
    segments: Option<u32>,
}

/// `8x8/32`, `8x8/32/apart`, `8x8/32/portable`.
fn variant(text: &str) -> Result<Variant, String> {
    let wrong = || format!("{text} is no tile and batch such as 8x8/32, 8x8/32/apart or 8x8/32/portable");
    let mut parts = text.split('/');
    let tile = size(parts.next().unwrap_or_default()).map_err(|_| wrong())?;
    let batch = parts.next().and_then(|b| b.parse().ok()).ok_or_else(wrong)?;
    let mut variant = Variant { tile: Some(tile), batch, fused: true, subgroups: true, segments: None };
    for part in parts {
        match part {
            "apart" => variant.fused = false,
            "portable" => variant.subgroups = false,
            "by1" => variant.segments = Some(1),
            "by2" => variant.segments = Some(2),
            "by4" => variant.segments = Some(4),
            _ => return Err(wrong()),
        }
    }
    Ok(variant)
}

/// Workloads of `--table`: Gaussians, optical and RF image.
const TABLE: [(usize, [usize; 2], [usize; 2]); 6] = [
    (200_000, [640, 480], [640, 480]),
    (200_000, [160, 120], [160, 120]),
    (200_000, [1280, 720], [1280, 720]),
    (1_000_000, [640, 480], [640, 480]),
    (200_000, [1600, 900], [300, 200]),
    (1_000_000, [1600, 900], [300, 200]),
];

/// One stage of a step.
#[derive(Clone, Debug, Serialize)]
struct Stage {
    name: &'static str,
    /// Mean over steps; on a GPU by its own timestamps.
    ms: f64,
    /// The stage's bytes at full bandwidth or its operations at full rate, whichever takes longer.
    floor_ms: Option<f64>,
}

/// One workload, measured.
#[derive(Clone, Debug, Serialize)]
struct Measured {
    device: String,
    gaussians: usize,
    gaussians_from: String,
    #[serde(rename = "optical")]
    light: [usize; 2],
    #[serde(rename = "rf")]
    radio: [usize; 2],
    /// Gaussians that reach a tile, in the last step.
    visible: usize,
    /// (Gaussian, tile) pairs of both images, most of any step.
    pairs: Option<usize>,
    /// Wall clock of a step: median, least and greatest of the runs.
    step_ms: f64,
    step_ms_range: [f64; 2],
    stages: Vec<Stage>,
    /// Variant that the GPU device was told to run.
    variant: Option<Variant>,
    /// Memory that the device holds after its steps, bytes.
    allocated_bytes: Option<u64>,
    /// Novel views a second: images left on the device, images brought back.
    frames_per_s: Option<[f64; 2]>,
}

/// All that a run of the command found.
#[derive(Serialize)]
struct Report {
    provenance: Provenance,
    steps: usize,
    repeats: usize,
    antialias: String,
    bandwidth_gb_s: f64,
    tflops: f64,
    workloads: Vec<Measured>,
}

impl Step {
    /// Refuses sizes that would take more time or memory than there is.
    fn check_sizes(&self) -> Result<()> {
        for (key, value) in [("--steps", self.steps), ("--repeats", self.repeats), ("--frames", self.frames)] {
            bounds::count(key, value, MAX_REPETITIONS, "of them")?;
        }
        for (key, value) in [("--bandwidth-gb-s", self.bandwidth_gb_s), ("--tflops", self.tflops)] {
            bounds::number(key, value, &(1e-6..=1e9), "of the device")?;
        }
        let pixels = |[width, height]: [usize; 2]| (width * height) as f64;
        let images = BYTES_A_PIXEL * (pixels(self.size) + pixels(self.radio.unwrap_or(self.size)));
        bounds::memory("--size", "the cameras' images", images, "give fewer pixels")?;
        let gaussians = BYTES_A_GAUSSIAN * self.gaussians as f64;
        Ok(bounds::memory("--gaussians", &format!("{} Gaussians", self.gaussians), gaussians, "give fewer")?)
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Files that cannot be read, a device without memory for the workload, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        ensure!(self.steps > 0 && self.repeats > 0, "--steps and --repeats: give at least 1");
        self.check_sizes()?;
        let backend = self.device.resolve()?;
        let files = self.ply.iter().map(|p| Ok((p.display().to_string(), ply::read_coupled(p)?))).collect::<Result<Vec<_>>>()?;
        let mut workloads = vec![];
        if self.table {
            for (n, light, radio) in TABLE {
                let file = files.iter().find(|(_, g)| g.len() == n);
                workloads.extend(self.measure(&backend, file, n, &workload::rig(light, radio))?);
            }
        } else {
            let rig = match &self.cameras {
                Some(path) => workload::read_rig(path, self.radio)?,
                None => workload::rig(self.size, self.radio.unwrap_or(self.size)),
            };
            workloads.extend(self.measure(&backend, files.first(), self.gaussians, &rig)?);
        }
        let text = text(&workloads);
        let report = Report {
            provenance: Provenance::here(),
            steps: self.steps,
            repeats: self.repeats,
            antialias: format!("{:?}", self.antialias).to_lowercase(),
            bandwidth_gb_s: self.bandwidth_gb_s,
            tflops: self.tflops,
            workloads,
        };
        show(json, &report, &text)?;
        Ok(Verdict::Done)
    }

    fn measure(&self, backend: &Backend, file: Option<&(String, Gaussians)>, n: usize, rig: &Rig) -> Result<Vec<Measured>> {
        interrupt::check()?;
        let drawn;
        let (from, gaussians) = match file {
            Some((name, g)) => (name.clone(), g),
            None => {
                drawn = workload::room(n, 1);
                ("a room, drawn".to_owned(), &drawn)
            }
        };
        let antialias = match self.antialias {
            Filter::On => Antialias::On,
            Filter::Off => Antialias::Off,
        };
        let raster = RasterConfig { antialias, ..RasterConfig::default() };
        let fresh = || Run {
            steps: self.steps,
            repeats: self.repeats,
            measured: Measured {
                device: backend.name(),
                gaussians: gaussians.len(),
                gaussians_from: from.clone(),
                light: [rig.light.width, rig.light.height],
                radio: [rig.radio.width, rig.radio.height],
                visible: 0,
                pairs: None,
                step_ms: 0.0,
                step_ms_range: [0.0; 2],
                stages: vec![],
                variant: None,
                allocated_bytes: None,
                frames_per_s: None,
            },
        };
        let views: Vec<TrainingView> = rig.views(3).collect();
        match backend {
            Backend::Cpu => {
                let mut run = fresh();
                run.on_cpu(raster, gaussians, rig, &views)?;
                Ok(vec![run.measured])
            }
            #[cfg(feature = "gpu")]
            Backend::Gpu { .. } => {
                let standard = GpuOptions::default();
                let usual = Variant {
                    tile: standard.tile.map(|tile| tile.map(|v| v as usize)),
                    batch: standard.batch,
                    fused: standard.fused,
                    subgroups: true,
                    segments: standard.segments,
                };
                let variants = if self.variants.is_empty() { vec![usual] } else { self.variants.clone() };
                let measure = |variant: &Variant| {
                    let mut run = fresh();
                    run.measured.variant = Some(*variant);
                    run.on_gpu(raster, gaussians, rig, &views, self, *variant)?;
                    crate::note!("{}", text(std::slice::from_ref(&run.measured)).trim_end());
                    Ok(run.measured)
                };
                variants.iter().map(measure).collect()
            }
        }
    }
}

/// One measurement in the making.
struct Run {
    steps: usize,
    repeats: usize,
    measured: Measured,
}

impl Run {
    /// Uploads the views and times whole runs of steps, after one that warms up.
    fn time(&mut self, device: &mut dyn Device, rig: &Rig, views: &[TrainingView]) -> Result<()> {
        for view in views {
            device.upload(view, 1).context("while uploading the views")?;
        }
        let timed = workload::time_steps(device, rig, self.steps, self.repeats)?;
        (self.measured.step_ms, self.measured.step_ms_range, self.measured.visible) =
            (timed.median_ms, timed.range_ms, timed.visible);
        Ok(())
    }

    fn on_cpu(&mut self, raster: RasterConfig, gaussians: &Gaussians, rig: &Rig, views: &[TrainingView]) -> Result<()> {
        let mut device = CpuDevice::new(workload::optimizer(), raster, gaussians)?;
        self.time(&mut device, rig, views)?;
        let t = device.take_stage_times();
        let stages = [
            ("project", t.project_s),
            ("sort", t.sort_s),
            ("forward", t.forward_s),
            ("loss", t.loss_s),
            ("backward", t.backward_s),
            ("update", t.update_s),
        ];
        let stage = |(name, s): (&'static str, f64)| Stage { name, ms: s * 1e3 / t.steps as f64, floor_ms: None };
        self.measured.stages = stages.map(stage).to_vec();
        Ok(())
    }

    #[cfg(feature = "gpu")]
    fn on_gpu(
        &mut self,
        raster: RasterConfig,
        gaussians: &Gaussians,
        rig: &Rig,
        views: &[TrainingView],
        wanted: &Step,
        variant: Variant,
    ) -> Result<()> {
        let options = GpuOptions {
            adapter: AdapterOptions {
                number: wanted.device.adapter(),
                software: true,
                subgroups: variant.subgroups,
                timestamps: true,
                ..AdapterOptions::default()
            },
            tile: variant.tile.map(|tile| tile.map(|v| v as u32)),
            batch: variant.batch,
            segments: variant.segments,
            fused: variant.fused,
            ..GpuOptions::default()
        };
        let (bytes_per_ms, operations_per_ms) = (wanted.bandwidth_gb_s * 1e6, wanted.tflops * 1e9);
        // The wall clock runs over steps without timestamps, the kernels' times come from others with them.
        let mut device = GpuDevice::new(&options, workload::optimizer(), raster, gaussians)?;
        device.time_stages(false);
        self.measured.device = device.adapter();
        self.time(&mut device, rig, views)?;
        self.measured.pairs = Some(device.pairs());
        self.measured.allocated_bytes = device.memory_bytes();
        let work = device.work();
        if wanted.frames > 0 {
            self.measured.frames_per_s = Some(frames_per_s(&mut device, rig, wanted.frames)?);
        }
        device.time_stages(true);
        device.train(&rig.steps(self.steps))?;
        let Some(t) = device.take_stage_times() else { return Ok(()) };
        for (k, w) in work.iter().enumerate() {
            let floor = (w.bytes / bytes_per_ms).max(w.operations / operations_per_ms);
            self.measured.stages.push(Stage { name: w.name, ms: t.seconds[k] * 1e3 / t.steps as f64, floor_ms: Some(floor) });
        }
        Ok(())
    }
}

/// Draws novel views, half-way between the cameras of the rig; frames a second on the device and with the images brought back.
#[cfg(feature = "gpu")]
fn frames_per_s(device: &mut GpuDevice, rig: &Rig, frames: usize) -> Result<[f64; 2]> {
    let requests = rig.novel_views(frames);
    // Once before, all of them: a view that needs more room than those before it would have everything drawn again.
    device.draw(&requests)?;
    let start = Instant::now();
    device.draw(&requests)?;
    let on_device = frames as f64 / start.elapsed().as_secs_f64();
    // Bringing back is the slower part by far: fewer will do.
    let few = &requests[..frames.div_ceil(16)];
    let start = Instant::now();
    for request in few {
        device.render(request)?;
    }
    Ok([on_device, few.len() as f64 / start.elapsed().as_secs_f64()])
}

/// A table of workloads, each with its stages.
fn text(workloads: &[Measured]) -> String {
    let mut out = String::new();
    for m in workloads {
        let [ow, oh] = m.light;
        let [rw, rh] = m.radio;
        let _ = writeln!(
            out,
            "{} Gaussians ({}), {ow}x{oh} + {rw}x{rh} on {}: {:.3} ms a step (runs {:.3} to {:.3}), {} visible{}",
            m.gaussians,
            m.gaussians_from,
            m.device,
            m.step_ms,
            m.step_ms_range[0],
            m.step_ms_range[1],
            m.visible,
            m.pairs.map_or(String::new(), |p| format!(", {p} pairs")),
        );
        if let Some(Variant { tile, batch, fused, subgroups, segments }) = m.variant {
            let flags = [(fused, "/apart"), (subgroups, "/portable")].map(|(usual, flag)| if usual { "" } else { flag }).concat();
            let by = segments.map_or_else(String::new, |n| format!("/by{n}"));
            let tile = tile.map_or_else(|| "tiles by frame".to_owned(), |[width, height]| format!("{width}x{height}"));
            let _ = write!(out, "  {tile}/{batch}{flags}{by}");
            if let Some(bytes) = m.allocated_bytes {
                let _ = write!(out, ", {} MB on the device", bytes / 1_000_000);
            }
            if let Some([drawn, brought]) = m.frames_per_s {
                let _ = write!(out, ", novel views: {drawn:.0} frames/s drawn, {brought:.1} brought back");
            }
            out.push('\n');
        }
        let row = |out: &mut String, name: &str, cells: &[String]| {
            let _ = writeln!(out, "  {name:6}{}", cells.iter().map(|c| format!("{c:>11}")).collect::<String>());
        };
        let total: f64 = m.stages.iter().map(|s| s.ms).sum();
        row(&mut out, "", &m.stages.iter().map(|s| s.name.to_owned()).chain(["all".to_owned()]).collect::<Vec<_>>());
        row(&mut out, "ms", &m.stages.iter().map(|s| s.ms).chain([total]).map(|v| format!("{v:.3}")).collect::<Vec<_>>());
        let floors: Option<Vec<f64>> = m.stages.iter().map(|s| s.floor_ms).collect();
        if let Some(floors) = floors.filter(|f| !f.is_empty()) {
            let total: f64 = floors.iter().sum();
            row(&mut out, "floor", &floors.iter().chain([&total]).map(|v| format!("{v:.3}")).collect::<Vec<_>>());
        }
    }
    out
}
