//! Receiving ahead, checkpoints, and devices that fail, on the CPU device.

use super::*;
use crate::{
    CpuDevice, Gaussians, OptimizerConfig, RasterConfig, Sampling,
    config::{DepthConfig, DepthPriorKind},
    device::{DeviceState, Outline, PackedView, Packer, RenderRequest, Rendering, Survey, SurveyRequest, TrainingView, ViewId},
    synthetic::{self, DB_RANGE},
};
use corf_scene::{
    Raster,
    dataset::stem,
    npz::{Array, Values},
};
use std::path::Path;

const COUNT: usize = 6;

fn cameras() -> (Pinhole, Pinhole) {
    (Pinhole::from_horizontal_fov(64, 48, 90.0), Pinhole::from_horizontal_fov(48, 32, 90.0))
}

/// Every second one with a mask.
fn keyframes() -> Vec<Keyframe> {
    let (light, radio) = cameras();
    let one = |i: usize| {
        let plain = synthetic::keyframe(2 * i, synthetic::pose(i as f64 * 1.5), &light, &radio, true);
        let mask = Raster::from_fn(light.width, light.height, |x, y| x > 9 * i || y < 8);
        synthetic::seen(&plain, |light| light.mask = (i % 2 == 1).then_some(mask))
    };
    (0..COUNT).map(one).collect()
}

fn config() -> ReconstructionConfig {
    // Two levels are passed through within these few steps.
    ReconstructionConfig { iterations_per_keyframe: 9, visits_per_level: 2, ..Default::default() }
}

fn cpu(config: &ReconstructionConfig) -> Box<dyn Device> {
    Box::new(CpuDevice::new(OptimizerConfig::default(), RasterConfig::default(), &config.empty_field()).unwrap())
}

fn fresh(device: Box<dyn Device>, config: &ReconstructionConfig) -> Reconstructor {
    let (light, radio) = cameras();
    Reconstructor::new(device, config.clone(), light, radio, DB_RANGE, 3).unwrap()
}

fn finish(r: &mut Reconstructor) -> Gaussians {
    r.finish(&mut |_, _| ControlFlow::Continue(())).unwrap();
    r.field().unwrap().gaussians
}

/// The CPU device behind a seam that offers nothing ahead, or everything, or fails after some calls to train.
struct Wrapped {
    inner: Box<dyn Device>,
    eager: bool,
    trainings_left: usize,
}

impl Device for Wrapped {
    fn name(&self) -> String {
        "wrapped".into()
    }
    fn upload(&mut self, view: &TrainingView, levels: u32) -> Result<ViewId> {
        self.inner.upload(view, levels)
    }
    fn packer(&self) -> Option<Packer> {
        if self.eager { self.inner.packer() } else { None }
    }
    fn upload_packed(&mut self, view: PackedView) -> Result<ViewId> {
        self.inner.upload_packed(view)
    }
    fn matcher(&self) -> Result<Option<std::sync::Arc<dyn crate::depth::Matcher>>> {
        self.inner.matcher()
    }
    fn trains_on_the_host(&self) -> bool {
        !self.eager
    }
    fn len(&self) -> usize {
        self.inner.len()
    }
    fn append(&mut self, new: &Gaussians) -> Result<()> {
        self.inner.append(new)
    }
    fn retain(&mut self, keep: &[bool]) -> Result<()> {
        self.inner.retain(keep)
    }
    fn reset_radio(&mut self, radio: &crate::Appearance) -> Result<()> {
        self.inner.reset_radio(radio)
    }
    fn set_position_rate_m(&mut self, rate_m: f32) {
        self.inner.set_position_rate_m(rate_m);
    }
    fn render(&mut self, request: &RenderRequest) -> Result<Rendering> {
        self.inner.render(request)
    }
    fn survey(&mut self, request: &SurveyRequest<'_>) -> Result<Survey> {
        self.inner.survey(request)
    }
    fn train(&mut self, steps: &[Step]) -> Result<StepReport> {
        if self.trainings_left == 0 {
            return Err(Error::invalid("wrapped, training", "the device was lost", "resume on another"));
        }
        self.trainings_left -= 1;
        self.inner.train(steps)
    }
    fn gaussians(&mut self) -> Result<Gaussians> {
        self.inner.gaussians()
    }
    fn outlines(&mut self) -> Result<Vec<Outline>> {
        if self.eager { self.inner.outlines() } else { Ok(Outline::of(&self.inner.gaussians()?)) }
    }
    fn state(&mut self) -> Result<DeviceState> {
        self.inner.state()
    }
    fn restore(&mut self, state: &DeviceState) -> Result<()> {
        self.inner.restore(state)
    }
}

fn wrapped(config: &ReconstructionConfig, eager: bool, trainings_left: usize) -> Box<dyn Device> {
    Box::new(Wrapped { inner: cpu(config), eager, trainings_left })
}

/// The configurations that take different ways through an expansion: a prior, none, none that aligns, none drawn by structure, steps
/// between its look at the field and what it adds, all steps there.
fn ways() -> [ReconstructionConfig; 6] {
    let no_prior = DepthConfig { prior: DepthPriorKind::None, ..Default::default() };
    // So few corners that the prior is aligned to the rendered field.
    let few_corners = DepthConfig { corners: 8, ..Default::default() };
    [
        config(),
        ReconstructionConfig { depth: no_prior, ..config() },
        ReconstructionConfig { depth: few_corners, ..config() },
        ReconstructionConfig { sampling: Sampling::Uniform, ..config() },
        ReconstructionConfig { overlapped_iterations: 4, ..config() },
        ReconstructionConfig { overlapped_iterations: 9, ..config() },
    ]
}

/// A folder prior of the frames' depths, relative and with a hole.
fn maps_of(frames: &[Keyframe], folder: &Path) -> DepthConfig {
    for frame in frames {
        let depth = synthetic::light(frame).depth_m.as_ref().unwrap();
        let mut inverse = depth.map(|z| 2.0 / z + 0.1);
        (20..30).flat_map(|y| (10..25).map(move |x| (x, y))).for_each(|at| inverse[at] = f32::NAN);
        let map = Array::new("x", &[depth.height(), depth.width()], Values::F32(inverse.into_vec())).to_npy();
        std::fs::write(folder.join(format!("{}.npy", stem(frame.index))), map).unwrap();
    }
    DepthConfig { prior: DepthPriorKind::Folder, folder: Some(folder.to_owned()), ..Default::default() }
}

#[test]
fn what_is_prepared_ahead_changes_nothing() {
    let frames = keyframes();
    for config in ways() {
        let mut pushed = fresh(cpu(&config), &config);
        frames.iter().for_each(|k| assert!(pushed.push(k).is_ok()));
        let truth = finish(&mut pushed);
        let timings = pushed.timings();
        assert!(truth.len() > 100, "{}", truth.len());
        assert_eq!(timings.iter().map(|t| t.index).collect::<Vec<_>>(), [0, 2, 4, 6, 8, 10]);
        assert!(timings.iter().all(|t| t.train_s + t.late_s > 0.0 && t.expand_s > 0.0 && t.wait_s >= 0.0));
        for (eager, ahead) in [(false, 1), (true, 2), (true, COUNT)] {
            let mut r = fresh(wrapped(&config, eager, usize::MAX), &config);
            for k in &frames {
                r.receive(k.clone()).unwrap();
                while r.waiting() > ahead {
                    r.process().unwrap().unwrap();
                }
            }
            assert!(finish(&mut r) == truth, "eager {eager}, {ahead} ahead, {:?}", config.depth.prior);
        }
        // Whoever asks first whether a keyframe is ready gets the same, and is told that none is where none waits.
        for eager in [false, true] {
            let mut r = fresh(wrapped(&config, eager, usize::MAX), &config);
            assert!(!r.is_ready());
            for k in &frames {
                r.receive(k.clone()).unwrap();
            }
            while r.waiting() > 0 {
                while !r.is_ready() {
                    std::thread::yield_now();
                }
                r.process().unwrap().unwrap();
            }
            assert!(!r.is_ready() && finish(&mut r) == truth, "eager {eager}, asked first");
        }
    }
}

#[test]
fn a_checkpoint_goes_on_to_the_same_bytes_from_every_keyframe() {
    let frames = keyframes();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let [plain, _, few_corners, _, four_joining, nine_joining] = ways();
    let maps = ReconstructionConfig { depth: maps_of(&frames, folder.path()), ..config() };
    for (coupling, way) in [
        (Coupling::Joint, &plain),
        (Coupling::Frozen, &plain),
        (Coupling::Joint, &few_corners),
        (Coupling::Frozen, &four_joining),
        (Coupling::Joint, &nine_joining),
        (Coupling::Joint, &maps),
    ] {
        let config = ReconstructionConfig { coupling, ..way.clone() };
        let mut straight = fresh(cpu(&config), &config);
        frames.iter().for_each(|k| assert!(straight.push(k).is_ok()));
        let mut truth = vec![finish(&mut straight)];
        straight.fine_tune(1, &mut |_, _| ControlFlow::Continue(())).unwrap();
        truth.push(straight.field().unwrap().gaussians);
        for stop in 1..=COUNT {
            let mut first = fresh(cpu(&config), &config);
            let mut given = frames.iter().cloned();
            while first.keyframes_expanded() < stop {
                // One is always received ahead, and lost.
                given.next().into_iter().for_each(|k| first.receive(k).unwrap());
                if first.waiting() > 1 || given.len() == 0 {
                    first.process().unwrap();
                }
            }
            first.checkpoint("a tag").unwrap().write(&path).unwrap();
            drop(first);
            let checkpoint = Checkpoint::read(&path).unwrap();
            assert_eq!((checkpoint.tag(), checkpoint.keyframes().len()), ("a tag", stop));
            let mut second = fresh(cpu(&config), &config);
            second.restore(&checkpoint).unwrap();
            assert!(second.receive(frames[stop - 1].clone()).is_err(), "the replay comes first");
            assert!(second.replay(frames[COUNT - 1].clone()).is_err() || stop == COUNT && COUNT == 1, "in order");
            frames[..stop].iter().for_each(|k| second.replay(k.clone()).unwrap());
            frames[stop..].iter().for_each(|k| assert!(second.push(k).is_ok()));
            assert!(finish(&mut second) == truth[0], "{coupling:?}, after {stop} keyframes");
            second.fine_tune(1, &mut |_, _| ControlFlow::Continue(())).unwrap();
            assert!(second.field().unwrap().gaussians == truth[1], "{coupling:?}, fine-tuned, after {stop} keyframes");
        }
    }
}

/// Reconstructs with a checkpoint after every keyframe, as long as the device lasts.
fn until_it_fails(r: &mut Reconstructor, frames: &[Keyframe], path: &Path) -> Result<()> {
    for k in frames {
        r.push(k)?;
        if r.keyframes_expanded() > 0 {
            r.checkpoint("")?.write(path)?;
        }
    }
    Ok(())
}

#[test]
fn the_last_checkpoint_survives_a_device_that_fails() {
    let (frames, config) = (keyframes(), config());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let mut straight = fresh(cpu(&config), &config);
    frames.iter().for_each(|k| assert!(straight.push(k).is_ok()));
    let mut failing = fresh(wrapped(&config, true, 4), &config);
    let error = until_it_fails(&mut failing, &frames, &path).unwrap_err().to_string();
    assert!(error.contains("the device was lost"), "{error}");
    let checkpoint = Checkpoint::read(&path).unwrap();
    assert_eq!(checkpoint.keyframes(), [0, 2, 4, 6]);
    let mut resumed = fresh(cpu(&config), &config);
    resumed.restore(&checkpoint).unwrap();
    frames[..4].iter().for_each(|k| resumed.replay(k.clone()).unwrap());
    frames[4..].iter().for_each(|k| assert!(resumed.push(k).is_ok()));
    assert!(finish(&mut resumed) == finish(&mut straight));
}

#[test]
fn checkpoints_of_something_else_and_damaged_ones_are_refused() {
    let (frames, config) = (keyframes(), config());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let mut r = fresh(cpu(&config), &config);
    assert!(r.checkpoint("").is_err(), "nothing has happened yet");
    frames[..3].iter().for_each(|k| assert!(r.push(k).is_ok()));
    let checkpoint = r.checkpoint("").unwrap();
    checkpoint.write(&path).unwrap();
    assert!(r.restore(&checkpoint).is_err(), "it has begun");
    let other = ReconstructionConfig { iterations_per_keyframe: 10, ..config.clone() };
    assert!(fresh(cpu(&other), &other).restore(&checkpoint).is_err());
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert!(Checkpoint::read(&path).unwrap_err().to_string().contains("checkpoint"));
    std::fs::write(&path, &bytes[..middle]).unwrap();
    assert!(Checkpoint::read(&path).is_err() && Checkpoint::read(&folder.path().join("none")).is_err());
    r.finish(&mut |_, _| ControlFlow::Continue(())).unwrap();
    assert!(r.checkpoint("").is_err(), "after the end there is nothing to go on with");
}

#[cfg(feature = "gpu")]
#[test]
fn views_that_threads_upload_to_a_gpu_change_nothing() {
    use crate::device::gpu::{GpuDevice, GpuOptions};
    let options = GpuOptions::on(corf_gpu::AdapterOptions { software: true, ..Default::default() });
    if corf_gpu::adapter_name(&options.adapter).is_none() {
        assert!(std::env::var_os("CORF_REQUIRE_GPU").is_none_or(|v| v != "1"), "no adapter");
        println!("skipped: no adapter");
        return;
    }
    let (frames, config) = (keyframes(), ways()[5].clone());
    let gpu = || -> Box<dyn Device> {
        let (optimizer, raster) = (OptimizerConfig::default(), RasterConfig::default());
        Box::new(GpuDevice::new(&options, optimizer, raster, &config.empty_field()).unwrap())
    };
    let run = |device: Box<dyn Device>| {
        let mut r = fresh(device, &config);
        for k in &frames {
            r.receive(k.clone()).unwrap();
            while r.waiting() >= r.worth_receiving() {
                r.process().unwrap().unwrap();
            }
        }
        finish(&mut r)
    };
    let truth = run(gpu());
    assert!(truth.len() > 100, "{}", truth.len());
    // It waits for the steps that the other only begins.
    let background = Wrapped { inner: gpu(), eager: true, trainings_left: usize::MAX };
    assert!(run(Box::new(background)) == truth);
}
