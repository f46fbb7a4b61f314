//! `corf bench array`: how many poses a second a radio field of `corf-array` is observed at, beside the least time its operations and bytes take,
//! and how long its training steps are.

use super::super::{Verdict, show};
use super::step::size;
use crate::device::{Backend, DeviceChoice};
use crate::methods::corf_array::{observer, on_device};
use crate::record::provenance::Provenance;
use crate::terminal::interrupt;
use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use corf::array_field::anchors::Anchors;
use corf::array_field::cloud::Cloud;
use corf::array_field::{ArrayConfig, ArrayField, ArrayTrainer, Observer, SensorSettings};
use corf_scene::keyframe::DbRange;
use corf_scene::{Pinhole, Rigid3, Rng, bounds};
use glam::DVec3;
use serde::Serialize;
use std::fmt::Write as _;
use std::sync::Arc;
use std::time::Instant;

/// `corf bench array`.
#[derive(Args)]
pub struct Array {
    /// Kinds of spectra; all when not given.
    #[arg(long, value_enum)]
    kind: Vec<Kind>,
    /// Virtual sources (as many as corf-array has after 40 keyframes of lobby-mini; 500 after the 147 of lobby147).
    #[arg(long, default_value_t = 100)]
    sources: usize,
    /// Surface points, under bartlett and mvdr (4000 after lobby-mini, 40000 after lobby147); lobes are over splats, and have none.
    #[arg(long, default_value_t = 4000)]
    points: usize,
    /// Anchors (30 after lobby-mini, 130 after lobby147).
    #[arg(long, default_value_t = 30)]
    anchors: usize,
    /// Spectra, pixels.
    #[arg(long, value_parser = size, default_value = "96x64")]
    size: [usize; 2],
    /// Poses that are asked for at once.
    #[arg(long, default_value_t = 640)]
    poses: usize,
    /// Steps that are taken at once to time one, beside the 20 of a keyframe.
    #[arg(long, default_value_t = 220)]
    steps: usize,
    /// Time that each figure is measured for, seconds.
    #[arg(long, default_value_t = 2.0)]
    seconds: f64,
    /// Memory bandwidth for the floor, GB/s (default: an H100 SXM's).
    #[arg(long, default_value_t = 3350.0)]
    bandwidth_gb_s: f64,
    /// Arithmetic for the floor, TFLOP/s (default: an H100 SXM's).
    #[arg(long, default_value_t = 66.9)]
    tflops: f64,
    /// Device that observes: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

/// Kinds of spectra.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    /// An 8×8 array.
    Bartlett,
    /// Capon's beamformer on an 8×8 array, with a loading of 0.1.
    Mvdr,
    /// Lobes of 1°.
    Mpc,
}

/// More of anything is more likely a mistake.
const MOST: usize = 10_000_000;

/// One kind, measured.
#[derive(Serialize)]
struct Measured {
    kind: Kind,
    emitters: usize,
    /// Poses a second where all are asked for at once, and where the next is asked for when the last is there.
    poses_per_s: f64,
    poses_per_s_one_by_one: f64,
    /// Time of a pose at full bandwidth or at the full rate of operations, whichever is longer.
    floor_us: f64,
    megaflop: f64,
    kilobytes: f64,
    /// Largest difference to the processor's observation, dB, over pixels within 30 dB of its peak; of a few poses.
    largest_difference_db: f64,
    /// A training step, and a keyframe's steps with all around them, milliseconds.
    step_ms: f64,
    keyframe_ms: f64,
}

#[derive(Serialize)]
struct Report {
    provenance: Provenance,
    device: String,
    size: [usize; 2],
    measured: Vec<Measured>,
}

impl Array {
    /// Runs the command.
    ///
    /// # Errors
    /// Sizes out of range, a device without memory, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        for (key, value) in [("--sources", self.sources), ("--points", self.points), ("--anchors", self.anchors)] {
            bounds::count(key, value, MOST, "of them")?;
        }
        bounds::count("--poses", self.poses, 1_000_000, "of them")?;
        bounds::count("--steps", self.steps, 100_000, "of them")?;
        ensure!(self.steps > OF_A_KEYFRAME, "--steps {}: give more than the {OF_A_KEYFRAME} of a keyframe", self.steps);
        bounds::number("--seconds", self.seconds, &(1e-3..=1e4), "of time")?;
        for (key, value) in [("--bandwidth-gb-s", self.bandwidth_gb_s), ("--tflops", self.tflops)] {
            bounds::number(key, value, &(1e-6..=1e9), "of the device")?;
        }
        ensure!(self.sources > 0 && self.anchors > 0 && self.poses > 0, "--sources, --anchors and --poses: give at least 1");
        let bytes = 4.0 * (self.sources + self.points) as f64 * (5 + self.anchors) as f64;
        bounds::memory("--points", "the field", 3.0 * bytes, "give fewer points or anchors")?;
        let images = 4.0 * self.poses as f64 * (self.size[0] * self.size[1]) as f64;
        bounds::memory("--poses", "their spectra", 3.0 * images, "give fewer poses or pixels")?;
        let backend = self.device.resolve()?;
        let kinds = if self.kind.is_empty() { &[Kind::Bartlett, Kind::Mvdr, Kind::Mpc][..] } else { &self.kind };
        let mut text = format!("{}, {}x{}", backend.name(), self.size[0], self.size[1]);
        let mut measured = vec![];
        for kind in kinds {
            let field = Arc::new(self.field(*kind));
            let m = self.measure(*kind, &field, &backend)?;
            let name = format!("{kind:?}, {} emitters", m.emitters);
            let _ = write!(
                text,
                "\n  {name:<28} {:>10.0} poses/s at once, {:>8.0} one by one; floor {:.2} µs ({:.2} MFLOP, {:.0} kB); {:.1e} dB off the \
                 processor; a step {:.3} ms, a keyframe's {OF_A_KEYFRAME} {:.2} ms",
                m.poses_per_s,
                m.poses_per_s_one_by_one,
                m.floor_us,
                m.megaflop,
                m.kilobytes,
                m.largest_difference_db,
                m.step_ms,
                m.keyframe_ms
            );
            measured.push(m);
        }
        let report = Report { provenance: Provenance::here(), device: backend.name(), size: self.size, measured };
        show(json, &report, &text)?;
        Ok(Verdict::Done)
    }

    fn measure(&self, kind: Kind, field: &Arc<ArrayField>, backend: &Backend) -> Result<Measured> {
        let mut observer = observer(backend, field)?;
        let poses: Vec<Rigid3> = (0..self.poses).map(pose).collect();
        // A fifth of the time at least for each of five runs, of which the median counts.
        let mut rate = |at_once: usize| -> Result<f64> {
            observer.observe(&poses[..at_once.min(2)])?;
            let mut rates = vec![];
            for _ in 0..RUNS {
                let (start, mut done) = (Instant::now(), 0);
                'run: loop {
                    for some in poses.chunks(at_once) {
                        interrupt::check()?;
                        observer.observe(some)?;
                        done += some.len();
                        if start.elapsed().as_secs_f64() >= self.seconds / RUNS as f64 {
                            break 'run;
                        }
                    }
                }
                rates.push(done as f64 / start.elapsed().as_secs_f64());
            }
            rates.sort_by(f64::total_cmp);
            Ok(rates[RUNS / 2])
        };
        let (poses_per_s, poses_per_s_one_by_one) = (rate(self.poses)?, rate(1)?);
        let work = field.work_of(&poses[0]);
        let floor_s = (work.operations / (1e12 * self.tflops)).max(work.bytes / (1e9 * self.bandwidth_gb_s));
        let largest_difference_db = difference_db(field, observer.as_mut(), &poses[..poses.len().min(4)])?;
        let keyframe_ms = self.training_ms(field, backend, OF_A_KEYFRAME)?;
        // More steps may have taken less time where a machine is busy with something else.
        let more_ms = (self.training_ms(field, backend, self.steps)? - keyframe_ms).max(0.0);
        let step_ms = more_ms / (self.steps - OF_A_KEYFRAME) as f64;
        Ok(Measured {
            kind,
            emitters: field.sources.len() + field.points.len(),
            poses_per_s,
            poses_per_s_one_by_one,
            floor_us: 1e6 * floor_s,
            megaflop: 1e-6 * work.operations,
            kilobytes: 1e-3 * work.bytes,
            largest_difference_db,
            step_ms,
            keyframe_ms,
        })
    }

    /// Time of so many steps at once of a field whose keyframes are its own observations, each somewhat stronger.
    fn training_ms(&self, field: &Arc<ArrayField>, backend: &Backend, steps: usize) -> Result<f64> {
        let config = ArrayConfig { iterations_per_keyframe: steps, ..ArrayConfig::default() };
        let range = DbRange { min_db: -130.0, max_db: -60.0 };
        let mut trainer = on_device(ArrayTrainer::new(config, field.sensor, field.camera, range, 1), backend)?;
        let (sources, points, anchors) = (field.sources.clone(), field.points.clone(), field.anchors.clone());
        trainer.restore(ArrayField { sources, points, anchors, ..trainer.field.clone() }, 0)?;
        let poses: Vec<Rigid3> = (0..KEYFRAMES).map(|k| pose(1000 / KEYFRAMES * k)).collect();
        let spectra = observer(backend, field)?.observe(&poses)?;
        for (pose, spectrum) in poses.iter().zip(&spectra) {
            trainer.replay(&trainer.observe(pose, &spectrum.map(|s| 1.2 * s)));
        }
        trainer.train()?;
        let mut times = vec![];
        let start = Instant::now();
        while times.len() < RUNS || start.elapsed().as_secs_f64() < self.seconds {
            interrupt::check()?;
            let run = Instant::now();
            trainer.train()?;
            times.push(1e3 * run.elapsed().as_secs_f64());
        }
        times.sort_by(f64::total_cmp);
        Ok(times[times.len() / 2])
    }

    /// Emitters all over a hall, and anchors along it.
    fn field(&self, kind: Kind) -> ArrayField {
        let along = |i: usize| DVec3::new(4.0 + 12.0 * i as f64 / self.anchors as f64, 8.0, 1.5);
        let (elements, spacing_wavelengths, gated) = ([8, 8], [0.5, 0.5], true);
        let (sensor, points) = match kind {
            Kind::Bartlett => (SensorSettings::Beam { elements, spacing_wavelengths, gated }, self.points),
            Kind::Mvdr => (SensorSettings::Capon { elements, spacing_wavelengths, gated, loading: 0.1 }, self.points),
            Kind::Mpc => (SensorSettings::Lobes { width_deg: 1.0 }, 0),
        };
        ArrayField {
            sensor,
            pattern: corf_scene::config::AntennaPattern::Iso,
            camera: Pinhole::from_horizontal_fov(self.size[0], self.size[1], 90.0),
            half_space: true,
            over_splats: kind == Kind::Mpc,
            most_power: None,
            extent_m: 0.06,
            anchors: Anchors { positions_m: (0..self.anchors).map(along).collect(), width_m: 0.5 },
            sources: cloud(self.sources, self.anchors, 1),
            points: cloud(points, self.anchors, 2),
        }
    }
}

/// Keyframes that are trained with, and steps of each.
const KEYFRAMES: usize = 10;
const OF_A_KEYFRAME: usize = 20;
/// Runs of which the median counts, at least.
const RUNS: usize = 5;
/// Range under a spectrum's peak in which differences count, dB.
const RANGE_DB: f64 = 30.0;

fn cloud(count: usize, anchors: usize, seed: u64) -> Cloud<f32> {
    let mut rng = Rng::keyed(seed, 0, 0);
    Cloud {
        position: (0..count).map(|_| [20.0, 16.0, 4.0].map(|side| side * rng.uniform())).collect(),
        gain: (0..count).map(|_| -20.0 + 4.0 * rng.uniform()).collect(),
        seen_from: (0..anchors).map(|_| (0..count).map(|_| rng.uniform() - 0.5).collect()).collect(),
    }
}

fn pose(k: usize) -> Rigid3 {
    let place = DVec3::new(4.0 + 12.0 * (k % 1000) as f64 / 1000.0, 8.0, 1.5);
    Rigid3::looking_at(place, place + DVec3::new(1.0, 0.3, 0.0), DVec3::Z)
}

/// Largest difference of observations to the processor's.
fn difference_db(field: &Arc<ArrayField>, observer: &mut dyn Observer, poses: &[Rigid3]) -> Result<f64> {
    let exact = corf::array_field::CpuObserver::new(Arc::clone(field)).observe(poses)?;
    let mut largest = 0.0_f64;
    for (ours, exact) in observer.observe(poses)?.iter().zip(&exact) {
        let peak = exact.pixels().iter().copied().fold(0.0, f32::max);
        let least = f64::from(peak) * 10f64.powf(-0.1 * RANGE_DB);
        for (a, b) in ours.pixels().iter().zip(exact.pixels()).map(|(a, b)| (f64::from(*a), f64::from(*b))) {
            if b > least {
                largest = largest.max((10.0 * (a / b).log10()).abs());
            }
        }
    }
    Ok(largest)
}
