//! `corf bench scale`: how time and memory grow with Gaussians, pixels, triangles, receivers and keyframes.

use super::super::{Verdict, show};
use crate::device::DeviceChoice;
use crate::run::claim_output;
use crate::studies::scale::{self, Axis, Points, ScaleWork, SequenceSettings, StepSettings, TraceSettings, Tracing};
use anyhow::{Context, Result, ensure};
use clap::Args;
use corf_scene::bounds;
use std::path::PathBuf;

/// `corf bench scale`.
#[derive(Args)]
pub struct Scale {
    /// Output folder: points/, scale.json, scale.md and a plot of each axis.
    #[arg(long)]
    out: PathBuf,
    /// Go on with a folder that holds points; those that are there are not measured again. Tables and plots are of all of them.
    #[arg(long)]
    resume: bool,
    /// Axes to measure, with commas between (default: all).
    #[arg(long, value_enum, value_delimiter = ',', value_name = "AXIS,AXIS")]
    axis: Vec<Axis>,
    /// Small sizes and few samples, for a processor: minutes, and figures that say nothing about large ones.
    #[arg(long)]
    quick: bool,
    /// Gaussians of the steps.
    #[arg(long, value_delimiter = ',', value_name = "N,N")]
    gaussians: Vec<usize>,
    /// Optical images of the steps, pixels.
    #[arg(long, value_delimiter = ',', value_name = "WxH,WxH", value_parser = super::step::size)]
    pixels: Vec<[usize; 2]>,
    /// How often the triangles of the scene are cut into four.
    #[arg(long, value_delimiter = ',', value_name = "N,N")]
    subdivisions: Vec<u32>,
    /// Positions at which spectra are received.
    #[arg(long, value_delimiter = ',', value_name = "N,N")]
    receivers: Vec<usize>,
    /// Lengths of the sequence; the longest is reconstructed once and measured at each.
    #[arg(long, value_delimiter = ',', value_name = "N,N")]
    keyframes: Vec<usize>,
    /// Optical image where it is held fixed, pixels.
    #[arg(long, value_parser = super::step::size)]
    size: Option<[usize; 2]>,
    /// RF image of steps and sequence, pixels.
    #[arg(long = "rf", value_parser = super::step::size, value_name = "RF")]
    radio: Option<[usize; 2]>,
    /// Dataset file (TOML) whose scene is traced (default: lobby147, which the program has in it).
    #[arg(long)]
    config: Option<PathBuf>,
    /// Device memory for keyframes, MB: those beyond it wait in main memory.
    #[arg(long, default_value_t = corf::RasterConfig::default().keyframe_memory_mb)]
    keyframe_memory_mb: u64,
    /// Device that takes the steps and reconstructs: auto, cpu, gpu, or gpu:N for the N-th adapter. Tracing runs on the processor.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

/// More keyframes, receivers or Gaussians are more likely a mistake.
const MAX_KEYFRAMES: usize = 100_000;
const MAX_RECEIVERS: usize = 100_000;
const MAX_GAUSSIANS: usize = 100_000_000;
const MAX_SUBDIVISIONS: u32 = 6;
/// Memory of the images of all cameras of a step with their targets, gradients and pyramids, bytes for a pixel of one of them.
const BYTES_A_PIXEL: f64 = 1000.0;

/// What is measured unless other sizes are asked for.
struct Defaults {
    gaussians: &'static [usize],
    pixels: &'static [[usize; 2]],
    subdivisions: &'static [u32],
    receivers: &'static [usize],
    keyframes: &'static [usize],
    light: [usize; 2],
    radio: [usize; 2],
    /// Gaussians of the axis of pixels.
    held: usize,
    steps: usize,
    repeats: usize,
    iterations_per_keyframe: usize,
    poses: usize,
}

const FULL: Defaults = Defaults {
    gaussians: &[50_000, 100_000, 200_000, 400_000, 800_000, 1_600_000, 3_200_000],
    pixels: &[[240, 135], [480, 270], [960, 540], [1440, 810], [1920, 1080]],
    subdivisions: &[0, 1, 2],
    receivers: &[8, 16, 32, 64, 128],
    keyframes: &[128, 256, 512, 1024],
    light: [1600, 900],
    radio: [300, 200],
    held: 400_000,
    steps: 160,
    repeats: 5,
    iterations_per_keyframe: 75,
    poses: 3,
};

const QUICK: Defaults = Defaults {
    gaussians: &[2_000, 8_000, 32_000],
    pixels: &[[80, 45], [160, 90], [320, 180]],
    subdivisions: &[0, 1],
    receivers: &[2, 4, 8],
    keyframes: &[8, 16, 32],
    light: [160, 90],
    radio: [48, 32],
    held: 8_000,
    steps: 16,
    repeats: 3,
    iterations_per_keyframe: 15,
    poses: 1,
};

/// The list that was asked for, or the default one, in order.
fn sizes<T: Clone + Ord>(asked: &[T], default: &[T]) -> Vec<T> {
    let mut list = if asked.is_empty() { default } else { asked }.to_vec();
    list.sort();
    list.dedup();
    list
}

impl Scale {
    /// Runs the command.
    ///
    /// # Errors
    /// Sizes out of range, a folder that is occupied or holds points of other settings, what a measurement meets, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let axes = if self.axis.is_empty() { Axis::ALL.to_vec() } else { sizes(&self.axis, &[]) };
        self.check(&axes)?;
        let backend = self.device.resolve()?;
        let work = axes.iter().map(|axis| self.work(*axis)).collect::<Result<Vec<_>>>()?;
        let _held = claim_output(&self.out, self.resume)?;
        let folder = self.out.join("points");
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let points = Points { out: &self.out, backend: &backend };
        // Whatever ends the work, what was measured is shown.
        let measured = work.iter().try_for_each(|work| points.measure(work));
        let (all, text) = scale::write_results(&self.out)?;
        measured?;
        show(json, &serde_json::json!({ "points": all, "exponents": scale::fitted(&all) }), text.trim_end())?;
        Ok(Verdict::Done)
    }

    fn defaults(&self) -> &'static Defaults {
        if self.quick { &QUICK } else { &FULL }
    }

    /// Refuses sizes that would take more time or memory than there is, and options of axes that are not measured.
    fn check(&self, axes: &[Axis]) -> Result<()> {
        let given = [
            (Axis::Gaussians, "--gaussians", !self.gaussians.is_empty()),
            (Axis::Pixels, "--pixels", !self.pixels.is_empty()),
            (Axis::Triangles, "--subdivisions", !self.subdivisions.is_empty()),
            (Axis::Receivers, "--receivers", !self.receivers.is_empty()),
            (Axis::Keyframes, "--keyframes", !self.keyframes.is_empty()),
        ];
        for (axis, option, is_given) in given {
            let name = axis.name();
            ensure!(!is_given || axes.contains(&axis), "{option}: {name} are not measured\n  help: add {name} to --axis");
        }
        let lists = [
            ("--gaussians", &self.gaussians, MAX_GAUSSIANS),
            ("--receivers", &self.receivers, MAX_RECEIVERS),
            ("--keyframes", &self.keyframes, MAX_KEYFRAMES),
        ];
        for (option, list, most) in lists {
            for &n in list {
                ensure!(n > 0, "{option}: 0 of them\n  help: give at least 1");
                bounds::count(option, n, most, "of them")?;
            }
        }
        for &times in &self.subdivisions {
            bounds::count("--subdivisions", times as usize, MAX_SUBDIVISIONS as usize, "of them")?;
        }
        let defaults = self.defaults();
        let largest = self.pixels.iter().chain([&self.size.unwrap_or(defaults.light)]).map(|[w, h]| w * h).max();
        let images = BYTES_A_PIXEL * largest.unwrap_or(0) as f64;
        bounds::memory("--pixels, --size", "the cameras' images", images, "give fewer pixels")?;
        corf::RasterConfig { keyframe_memory_mb: self.keyframe_memory_mb, ..corf::RasterConfig::default() }.validate()?;
        Ok(())
    }

    fn work(&self, axis: Axis) -> Result<ScaleWork> {
        let d = self.defaults();
        let (light, radio) = (self.size.unwrap_or(d.light), self.radio.unwrap_or(d.radio));
        let steps = StepSettings { gaussians: d.held, light, radio, steps: d.steps, repeats: d.repeats };
        let tracing = || {
            let settings = TraceSettings { config: self.config.clone(), poses: d.poses, quick: self.quick };
            Tracing::open(&settings).map(Box::new)
        };
        Ok(match axis {
            Axis::Gaussians => ScaleWork::Gaussians(sizes(&self.gaussians, d.gaussians), steps),
            Axis::Pixels => ScaleWork::Pixels(sizes(&self.pixels, d.pixels), steps),
            Axis::Triangles => ScaleWork::Triangles(sizes(&self.subdivisions, d.subdivisions), tracing()?),
            Axis::Receivers => ScaleWork::Receivers(sizes(&self.receivers, d.receivers), tracing()?),
            Axis::Keyframes => {
                let (iterations_per_keyframe, keyframe_memory_mb) = (d.iterations_per_keyframe, self.keyframe_memory_mb);
                let sequence = SequenceSettings { light, radio, iterations_per_keyframe, keyframe_memory_mb };
                ScaleWork::Keyframes(sizes(&self.keyframes, d.keyframes), sequence)
            }
        })
    }
}
