//! The GPU device: what holds of every device, and images, losses, gradients, steps, bookkeeping against the CPU device, on memory poisoned with NaN. Needs an adapter, a
//! software one will do; without any the tests say so and pass, unless `CORF_REQUIRE_GPU=1`.

#![allow(clippy::unwrap_used, clippy::print_stdout, clippy::print_stderr)]

mod masks;
mod needles;
#[macro_use]
#[path = "../suite/mod.rs"]
mod suite;
mod support;

use corf::{
    Antialias, CpuDevice, Device, Gaussians, OptimizerConfig, RasterConfig, Result,
    device::{
        Planes, RenderRequest, Step, StepReport, TrainingView, View, ViewId,
        gpu::{GpuDevice, GpuOptions},
    },
    gaussians::logit,
};
use corf_gpu::AdapterOptions;
use corf_scene::{Pinhole, Rigid3, Rng};
use suite::{Opened, Tested};
use support::{
    OPTIONS, THRESHOLD_SHARE, bits, both, cameras, classes, compare_gradients, compare_renderings, image, metric_rates, noise,
    norm, one_camera, open, pair, pose, room, step, training_view,
};

impl Tested for GpuDevice {
    fn gradients_of(&mut self, step: &Step) -> Result<(StepReport, Gaussians)> {
        self.gradients(step)
    }
}

fn on_gpu(optimizer: OptimizerConfig, raster: RasterConfig, g: &Gaussians) -> Result<Opened> {
    Ok(Box::new(GpuDevice::new(&OPTIONS, optimizer, raster, g)?))
}

suite_on!(on_gpu, cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1"));

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn pictures_agree() {
    for (radio_channels, degrees, antialias) in
        [(3, [1, 3], Antialias::On), (1, [2, 0], Antialias::Off), (3, [0, 2], Antialias::Detached), (1, [3, 1], Antialias::On)]
    {
        let raster = RasterConfig { antialias, ..RasterConfig::default() };
        let g = room(1, 3000, radio_channels, degrees);
        let Some((mut cpu, mut gpu)) = pair(OptimizerConfig::default(), raster, &g) else { return };
        for k in 0..3 {
            let (a, b) = (cpu.render(&both(k)).unwrap(), gpu.render(&both(k)).unwrap());
            compare_renderings(&a, &b);
            for layer in [&a.light, &a.radio].into_iter().flatten() {
                let t = layer.transmittance.pixels();
                assert!(t.iter().any(|t| *t < 0.2) && t.iter().any(|t| *t > 0.5));
            }
            let (a, b) = (a.main_contributor.unwrap(), b.main_contributor.unwrap());
            let differ = a.pixels().iter().zip(b.pixels()).filter(|(a, b)| a != b).count();
            // Two weights within rounding of each other.
            assert!(differ as f64 <= THRESHOLD_SHARE * a.pixels().len() as f64, "{differ} main contributors differ");
        }
    }
}

/// There is hardly any room at first, so that a batch is drawn again.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn spectra_of_many_poses_are_those_of_each_alone() {
    for channels in [1, 3] {
        let g = room(5, 3000, channels, [1, 1]);
        let Some(mut streams) = open(&OPTIONS, OptimizerConfig::default(), RasterConfig::default(), &g) else { return };
        let Some(mut renders) = open(&OPTIONS, OptimizerConfig::default(), RasterConfig::default(), &g) else { return };
        let ((_, camera), background) = (cameras(), [0.1, 0.2, 0.3]);
        let poses: Vec<Rigid3> = (0..7).map(pose).collect();
        let mut together = Vec::new();
        let mut take = |images: Vec<Planes>| {
            together.extend(images);
            Ok(())
        };
        streams.render_radio(&camera, &poses, background, &mut take).unwrap();
        assert_eq!(together.len(), poses.len());
        for (image, world_from_camera) in together.iter().zip(poses.iter().copied()) {
            let radio = Some((View { camera, world_from_camera }, background));
            let alone = renders.render(&RenderRequest { radio, ..RenderRequest::default() }).unwrap();
            assert!(alone.radio.unwrap().color == *image, "{channels} channels");
        }
        // Who has seen enough ends it, and the device works on.
        let mut seen = 0;
        let mut enough = |_| {
            seen += 1;
            Err(corf::Error::Stopped)
        };
        assert!(matches!(streams.render_radio(&camera, &poses, background, &mut enough), Err(corf::Error::Stopped)));
        assert_eq!(seen, 1);
        streams.render_radio(&camera, &[], background, &mut |_| unreachable!("there is no image")).unwrap();
        streams
            .render_radio(&camera, &poses[..1], background, &mut |images| {
                assert!(images[0] == together[0]);
                Ok(())
            })
            .unwrap();
    }
}

/// Lists in which pixels end early, drawn by one, two and four threads a pixel.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn threads_that_share_a_pixel_draw_what_one_draws() {
    let mut g = room(9, 3000, 3, [1, 1]);
    for i in 0..g.len() {
        g.light.opacity_logit[i] = if g.position[i][0] > 0.0 { 6.0 } else { -4.0 };
    }
    let mut cpu = CpuDevice::new(OptimizerConfig::default(), RasterConfig::default(), &g).unwrap();
    let (camera, _) = cameras();
    let view = View { camera, world_from_camera: pose(1) };
    let request =
        RenderRequest { light: Some((view, [0.9, 0.2, 0.4])), radio: Some((view, [0.1, 0.3, 0.6])), main_contributor: false };
    let expected = cpu.render(&request).unwrap();
    let ended = expected.light.as_ref().unwrap().transmittance.pixels().iter().filter(|t| **t < 1e-4).count();
    assert!(ended > 100, "{ended} pixels end");
    for (segments, batch) in [(1, 8), (2, 32), (4, 8)] {
        let options = GpuOptions { segments: Some(segments), batch, ..OPTIONS };
        let Some(mut gpu) = open(&options, OptimizerConfig::default(), RasterConfig::default(), &g) else { return };
        compare_renderings(&expected, &gpu.render(&request).unwrap());
    }
}

/// A few Gaussians that fill images, and thin ones that cross them, among small ones: blocks with a few pairs and with thousands.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn gaussians_of_very_different_sizes_agree() {
    let mut g = room(13, 1500, 3, [1, 1]);
    for i in (0..g.len()).step_by(60) {
        g.log_scale[i] = [1.0, [1.0, -3.0][i / 60 % 2], 0.5];
        g.light.opacity_logit[i] = -3.0;
        g.radio.opacity_logit[i] = -2.0;
    }
    let view = TrainingView { radio_camera: cameras().1, radio: training_view(0, 3, true).radio, ..one_camera(3) };
    let mut cpu = CpuDevice::new(OptimizerConfig::default(), RasterConfig::default(), &g).unwrap();
    for (tile, batch) in [([8, 8], 16), ([8, 4], 8), ([16, 16], 32)] {
        let options = GpuOptions { tile: Some(tile), batch, ..OPTIONS };
        let Some(mut gpu) = open(&options, OptimizerConfig::default(), RasterConfig::default(), &g) else { return };
        compare_renderings(&cpu.render(&both(0)).unwrap(), &gpu.render(&both(0)).unwrap());
        for (id, view) in [&view, &one_camera(3)].into_iter().enumerate() {
            assert_eq!(cpu.upload(view, 1).unwrap().0 % 2, gpu.upload(view, 1).unwrap().0);
            compare_gradients(&mut cpu, &mut gpu, &step(id, 0));
        }
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn gradients_agree() {
    for (radio_channels, degrees, antialias, depth) in
        [(3, [1, 3], Antialias::On, true), (1, [2, 0], Antialias::Off, false), (1, [3, 1], Antialias::Detached, true)]
    {
        let raster = RasterConfig { antialias, ..RasterConfig::default() };
        let g = room(2, 2500, radio_channels, degrees);
        // Tiles of half the size count fewer Gaussians that are drawn nowhere: 3.5 % fewer in images of 37×20 and 13×10 pixels.
        let options = GpuOptions { tile: Some([8, 8]), ..OPTIONS };
        let Some(mut gpu) = open(&options, OptimizerConfig::default(), raster, &g) else { return };
        let mut cpu = CpuDevice::new(OptimizerConfig::default(), raster, &g).unwrap();
        for k in 0..2 {
            let view = training_view(k, radio_channels, depth);
            assert_eq!(cpu.upload(&view, 3).unwrap(), gpu.upload(&view, 3).unwrap());
        }
        let alone = [Step { radio_weight: 0.0, ..step(1, 0) }, Step { light_weight: 0.0, depth_weight: 0.0, ..step(1, 0) }];
        for s in [step(0, 0), step(1, 1), step(0, 2)].into_iter().chain(alone) {
            compare_gradients(&mut cpu, &mut gpu, &s);
        }
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn both_images_at_once_give_what_each_gives_alone() {
    for (radio_channels, antialias, tile, batch, segments) in [
        (3, Antialias::On, Some([8, 8]), 8, Some(1)),
        (1, Antialias::Off, Some([8, 4]), 32, Some(2)),
        (3, Antialias::On, Some([8, 8]), 16, Some(4)),
        (3, Antialias::On, Some([8, 8]), 32, None),
        (3, Antialias::On, None, 32, None),
        (3, Antialias::Detached, Some([16, 16]), 32, None),
    ] {
        let raster = RasterConfig { antialias, ..RasterConfig::default() };
        let mut g = room(12, 2500, radio_channels, [1, 1]);
        // Gaussians that one modality draws and the other does not, both ways round.
        for i in 0..g.len() {
            match i % 3 {
                0 => g.radio.opacity_logit[i] = logit(0.002),
                1 => g.light.opacity_logit[i] = logit(0.003),
                _ => {}
            }
        }
        let mut cpu = CpuDevice::new(OptimizerConfig::default(), raster, &g).unwrap();
        for fused in [true, false] {
            let options = GpuOptions { fused, tile, batch, segments, ..OPTIONS };
            let Some(mut gpu) = open(&options, OptimizerConfig::default(), raster, &g) else { return };
            cpu.upload(&one_camera(radio_channels), 2).unwrap();
            gpu.upload(&one_camera(radio_channels), 2).unwrap();
            for levels in [[0, 0], [1, 1], [1, 0]] {
                compare_gradients(&mut cpu, &mut gpu, &Step { levels, ..step(0, 0) });
            }
            // A Gaussian of which a modality sees nothing keeps its appearance there.
            gpu.train(&[step(0, 0); 2]).unwrap();
            let after = gpu.gaussians().unwrap();
            assert!((0..g.len()).step_by(3).all(|i| after.radio.opacity_logit[i] == g.radio.opacity_logit[i]));
            assert!((1..g.len()).step_by(3).all(|i| after.light.opacity_logit[i] == g.light.opacity_logit[i]));
            assert_ne!(after.position, g.position);
        }
    }
}

fn schedule(count: usize) -> Vec<Step> {
    (0..count).map(|i| step(i % 2, (i % 3) as u32)).collect()
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn training_follows_the_cpu_and_ends_at_the_same_losses() {
    let g = room(3, 2000, 3, [1, 2]);
    let Some((mut cpu, mut gpu)) = pair(metric_rates(), RasterConfig::default(), &g) else { return };
    for k in 0..2 {
        cpu.upload(&training_view(k, 3, true), 3).unwrap();
        gpu.upload(&training_view(k, 3, true), 3).unwrap();
    }
    // The first step is rate·(1−β₁)/sqrt(1−β₂) against the gradient's sign, whatever its size: where a gradient is rounding, so is its sign.
    cpu.train(&schedule(1)).unwrap();
    gpu.train(&schedule(1)).unwrap();
    let (a, b) = (classes(&cpu.gaussians().unwrap()), classes(&gpu.gaussians().unwrap()));
    for (class, (a, b)) in a.iter().zip(&b).enumerate() {
        let differ = a.iter().zip(b).filter(|(a, b)| (**a - **b).abs() > 1e-5).count();
        assert!(differ as f64 <= 0.01 * a.len() as f64, "class {class}: {differ} of {} differ after a step", a.len());
    }
    // Later steps amplify such differences (Adam divides by the gradient's size): the losses, not the parameters, stay together. One step's
    // loss moves by a per cent when the last bits of either device change; means over fields are held far closer by the library's own tests.
    const SAME_LOSS: f32 = 0.025;
    let steps = schedule(60);
    let (a, b) = (cpu.train(&steps).unwrap(), gpu.train(&steps).unwrap());
    assert!((a.light_loss - b.light_loss).abs() < SAME_LOSS * a.light_loss, "{a:?} {b:?}");
    assert!((a.radio_loss - b.radio_loss).abs() < SAME_LOSS * a.radio_loss, "{a:?} {b:?}");
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn the_same_bytes_every_time_however_steps_are_batched() {
    let g = room(4, 1500, 1, [1, 1]);
    let run = |batch: usize| {
        let mut d = open(&OPTIONS, metric_rates(), RasterConfig::default(), &g)?;
        for k in 0..2 {
            d.upload(&training_view(k, 1, true), 3).unwrap();
        }
        let mut report = d.train(&[]).unwrap();
        for steps in schedule(40).chunks(batch) {
            report = d.train(steps).unwrap();
        }
        Some((report, bits(&d.gaussians().unwrap())))
    };
    let Some(whole) = run(40) else { return };
    assert!(whole.1 != bits(&g), "the steps change something");
    assert!(run(40).unwrap() == whole, "twice the same steps");
    assert!(run(7).unwrap() == whole, "in several batches");
}

/// Steps that are drawn with tiles of other shapes follow one another in a batch.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn large_and_small_images_take_turns() {
    let mut rng = Rng::keyed(79, 0, 0);
    let g = room(14, 400, 1, [1, 1]);
    let light_camera = Pinhole { width: 451, height: 293, fx: 230.0, fy: 231.0, cx: 226.3, cy: 145.9 };
    assert!(light_camera.width * light_camera.height > 1 << 17);
    let light = noise(&mut rng, &light_camera, 3);
    let view = TrainingView { light_camera, light, ..training_view(0, 1, false) };
    let Some((mut cpu, mut gpu)) = pair(metric_rates(), RasterConfig::default(), &g) else { return };
    assert_eq!(cpu.upload(&view, 2).unwrap(), gpu.upload(&view, 2).unwrap());
    let steps = [0, 1, 0, 1].map(|level| step(0, level));
    for s in &steps[..2] {
        compare_gradients(&mut cpu, &mut gpu, s);
    }
    let mut single = open(&OPTIONS, metric_rates(), RasterConfig::default(), &g).unwrap();
    single.upload(&view, 2).unwrap();
    let (mut last, whole) = (StepReport::default(), gpu.train(&steps).unwrap());
    for s in &steps {
        last = single.train(std::slice::from_ref(s)).unwrap();
    }
    assert!((last, bits(&single.gaussians().unwrap())) == (whole, bits(&gpu.gaussians().unwrap())));
    assert!(bits(&gpu.gaussians().unwrap()) != bits(&g), "the steps change something");
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn without_subgroups_the_same_bytes() {
    let g = room(5, 1500, 3, [1, 1]);
    // Batches of eight lie within any subgroup of eight and more.
    let run = |subgroups: bool| {
        let mut d = open(
            &GpuOptions { adapter: AdapterOptions { subgroups, ..OPTIONS.adapter }, batch: 8, ..OPTIONS },
            metric_rates(),
            RasterConfig::default(),
            &g,
        )?;
        d.upload(&training_view(0, 3, false), 1).unwrap();
        d.train(&[step(0, 0); 5]).unwrap();
        Some(bits(&d.gaussians().unwrap()))
    };
    let Some(with) = run(true) else { return };
    assert!(run(false).unwrap() == with);
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn results_do_not_depend_on_the_memory_for_keyframes() {
    let g = room(15, 400, 3, [0, 0]);
    // Batches of steps over nine keyframes, with and without depths, at levels of each form.
    let steps = |batch: usize, count: usize| -> Vec<Step> {
        let one = |i: usize| step((7 * i * i + 3 * batch + i) % 9, ((i + batch) % 3) as u32);
        (0..count).map(one).collect()
    };
    let run = |keyframe_bytes: u64, packed: bool| {
        let options = GpuOptions { keyframe_bytes, tile: Some([8, 8]), segments: Some(1), ..OPTIONS };
        let mut d = open(&options, metric_rates(), RasterConfig::default(), &g)?;
        let pack = d.packer().unwrap();
        let mut reports = vec![];
        for k in 0..9 {
            let view = training_view(k, 3, k != 4);
            let id = if packed { d.upload_packed(pack(&view, 3).unwrap()) } else { d.upload(&view, 3) };
            assert_eq!(id.unwrap(), ViewId(k));
        }
        for batch in 0..2 {
            reports.push(d.train(&steps(batch, 25)).unwrap());
        }
        d.begin_training(&steps(2, 9)).unwrap();
        reports.push(d.end_training().unwrap().unwrap());
        Some((reports, bits(&d.gaussians().unwrap()), d.keyframe_bytes()))
    };
    let Some((reports, unbounded, [all, came])) = run(u64::MAX, false) else { return };
    assert_eq!(came, 0, "nothing leaves where all is room");
    // Room for none, for four or five of them, for all but one.
    for (most, packed) in [(0, false), (all / 2, true), (all - 1, true)] {
        let (bounded_reports, bounded, [taken, came]) = run(most, packed).unwrap();
        assert_eq!(bounded_reports, reports, "{most} of {all} bytes");
        assert!(bounded == unbounded, "{most} of {all} bytes: other Gaussians");
        assert!(taken <= most.max(all / 8), "{taken} bytes taken of {most}");
        assert!(came > 0, "{most} of {all} bytes: nothing had to leave");
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn steps_that_find_no_room_are_run_again() {
    // 3000 Gaussians of half a metre and more reach over a hundred thousand tiles between them, more than there is room for at first.
    let mut g = room(6, 3000, 3, [0, 0]);
    g.log_scale.iter_mut().for_each(|s| *s = s.map(|v| v + 1.5));
    let Some((mut cpu, mut gpu)) = pair(metric_rates(), RasterConfig::default(), &g) else { return };
    let (light_camera, radio_camera) = (Pinhole::from_horizontal_fov(320, 180, 90.0), Pinhole::from_horizontal_fov(96, 64, 90.0));
    let mut rng = Rng::keyed(1, 2, 3);
    let view = TrainingView {
        light: image(&mut rng, &light_camera),
        light_camera,
        radio: noise(&mut rng, &radio_camera, 3),
        radio_camera,
        ..training_view(0, 3, false)
    };
    cpu.upload(&view, 1).unwrap();
    gpu.upload(&view, 1).unwrap();
    let before = gpu.pair_capacity();
    let (a, b) = (cpu.train(&[step(0, 0); 3]).unwrap(), gpu.train(&[step(0, 0); 3]).unwrap());
    assert!(gpu.pair_capacity() > 2 * before.max(1 << 16), "{} pairs: there was room all along", gpu.pair_capacity());
    assert!((a.light_loss - b.light_loss).abs() < 1e-4 && (a.radio_loss - b.radio_loss).abs() < 1e-4, "{a:?} {b:?}");
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn gaussians_come_go_and_keep_their_moments() {
    let g = room(7, 900, 1, [2, 1]);
    let more = room(8, 333, 1, [2, 1]);
    let Some((mut cpu, mut gpu)) = pair(metric_rates(), RasterConfig::default(), &g) else { return };
    let view = training_view(0, 1, false);
    cpu.upload(&view, 1).unwrap();
    gpu.upload(&view, 1).unwrap();
    assert_eq!(bits(&gpu.gaussians().unwrap()), bits(&g));
    let keep: Vec<bool> = (0..900 + 333).map(|i| i % 7 != 3).collect();
    for d in [&mut cpu as &mut dyn Device, &mut gpu] {
        d.train(&[step(0, 0); 2]).unwrap();
        d.append(&more).unwrap();
        assert_eq!(d.len(), 1233);
    }
    let before = gpu.gaussians().unwrap();
    cpu.retain(&keep).unwrap();
    gpu.retain(&keep).unwrap();
    assert_eq!((cpu.len(), gpu.len()), (1057, 1057));
    let mut kept = (0..1233).filter(|i| keep[*i]);
    let after = gpu.gaussians().unwrap();
    assert!(after.position.iter().all(|p| *p == before.position[kept.next().unwrap()]));
    assert_eq!(after.radio.sh[..4], before.radio.sh[..4]);
    // With its moments in the wrong rows the next steps would go elsewhere.
    let (a, b) = (cpu.train(&[step(0, 0); 3]).unwrap(), gpu.train(&[step(0, 0); 3]).unwrap());
    assert!((a.light_loss - b.light_loss).abs() < 1e-3 * a.light_loss, "{a:?} {b:?}");
    let (a, b) = (classes(&cpu.gaussians().unwrap()), classes(&gpu.gaussians().unwrap()));
    for (class, (a, b)) in a.iter().zip(&b).enumerate() {
        let size = norm(a.iter().map(|v| f64::from(*v)));
        let error = norm(a.iter().zip(b).map(|(a, b)| f64::from(a - b)));
        assert!(error < 1e-2 * size, "class {class}: {error:.1e} of {size:.1e}");
    }
    // A second stage: new RF appearance, no memory of the old one's moments.
    let radio = room(9, 1057, 1, [2, 1]).radio;
    for d in [&mut cpu as &mut dyn Device, &mut gpu] {
        d.reset_radio(&radio).unwrap();
    }
    assert_eq!(gpu.gaussians().unwrap().radio.sh, radio.sh);
    let frozen = Step { train_geometry: false, light_weight: 0.0, depth_weight: 0.0, ..step(0, 0) };
    let geometry = gpu.gaussians().unwrap();
    let (a, b) = (cpu.train(&[frozen; 3]).unwrap(), gpu.train(&[frozen; 3]).unwrap());
    assert!((a.radio_loss - b.radio_loss).abs() < 1e-3 * a.radio_loss, "{a:?} {b:?}");
    let after = gpu.gaussians().unwrap();
    assert_eq!(
        (&after.position, &after.rotation, &after.log_scale, &after.light),
        (&geometry.position, &geometry.rotation, &geometry.log_scale, &geometry.light)
    );
    assert_ne!(after.radio, geometry.radio);
    // Nothing left, and from nothing again.
    gpu.retain(&vec![false; 1057]).unwrap();
    assert!(gpu.is_empty());
    let layer = gpu.render(&both(0)).unwrap().light.unwrap();
    assert!(layer.color.pixels.chunks_exact(3).all(|p| p == [0.9, 0.2, 0.4]));
    gpu.train(&[step(0, 0)]).unwrap();
    gpu.append(&g).unwrap();
    assert_eq!(bits(&gpu.gaussians().unwrap()), bits(&g));
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_device_that_begins_with_nothing_draws_backgrounds_and_trains() {
    let g = room(14, 0, 3, [1, 1]);
    let Some(mut d) = open(&OPTIONS, OptimizerConfig::default(), RasterConfig::default(), &g) else { return };
    for wanted in [both(0), RenderRequest { radio: None, ..both(0) }] {
        let layer = d.render(&wanted).unwrap().light.unwrap();
        assert!(layer.color.pixels.chunks_exact(3).all(|p| p == [0.9, 0.2, 0.4]));
    }
    d.upload(&training_view(0, 3, true), 1).unwrap();
    assert_eq!(d.train(&[step(0, 0); 2]).unwrap().visible, 0);
    d.append(&room(14, 300, 3, [1, 1])).unwrap();
    assert!(d.train(&[step(0, 0)]).unwrap().visible > 50);
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn numbers_that_are_none_hurt_no_other_gaussian() {
    let g = room(10, 600, 3, [1, 1]);
    let mut hurt = g.clone();
    let strange = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30, f32::MIN_POSITIVE];
    for k in 0..60 {
        let value = strange[k % strange.len()];
        match k % 5 {
            0 => hurt.position[k][k % 3] = value,
            1 => hurt.rotation[k] = [value; 4],
            2 => hurt.log_scale[k][k % 3] = value,
            3 => hurt.light.opacity_logit[k] = value,
            _ => hurt.position[k] = [value; 3],
        }
    }
    let Some(mut d) = open(&OPTIONS, metric_rates(), RasterConfig::default(), &hurt) else { return };
    d.upload(&training_view(0, 3, true), 2).unwrap();
    d.train(&[step(0, 0), step(0, 1), step(0, 0)]).unwrap();
    let after = d.gaussians().unwrap();
    let rows = |g: &Gaussians| (60..600).flat_map(|i| g.position[i].into_iter().chain(g.log_scale[i])).collect::<Vec<f32>>();
    let (before, after) = (rows(&g), rows(&after));
    assert!(after.iter().all(|v| v.is_finite()), "a number that is none has spread");
    assert!(before != after);
}

/// A spectrum of few pixels beside an image of many levels: it has those that it has, on both devices.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_spectrum_has_fewer_levels_than_the_image() {
    let g = room(23, 500, 3, [1, 1]);
    let Some((mut cpu, mut gpu)) = pair(metric_rates(), RasterConfig::default(), &g) else { return };
    let radio_camera = Pinhole { width: 13, height: 9, fx: 6.0, fy: 6.5, cx: 6.1, cy: 4.4 };
    let view =
        TrainingView { radio_camera, radio: noise(&mut Rng::keyed(5, 0, 0), &radio_camera, 3), ..training_view(0, 3, true) };
    // 149x83 pixels have seven levels, 13x9 have four.
    cpu.upload(&view, 6).unwrap();
    gpu.upload(&view, 6).unwrap();
    for levels in [[5, 0], [3, 3], [0, 2]] {
        compare_gradients(&mut cpu, &mut gpu, &Step { levels, ..step(0, 0) });
    }
    for d in [&mut cpu as &mut dyn Device, &mut gpu] {
        let error = d.train(&[Step { levels: [5, 4], ..step(0, 0) }]).unwrap_err().to_string();
        assert!(error.contains("level 4 of the RF image's pyramid of 4"), "{error}");
        let error = d.train(&[Step { levels: [6, 0], ..step(0, 0) }]).unwrap_err().to_string();
        assert!(error.contains("level 6 of the optical image's pyramid of 6"), "{error}");
        assert!(d.upload(&view, 8).is_err(), "an image of 83 rows has no level 7");
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn bad_requests_are_refused() {
    let g = room(11, 10, 3, [0, 0]);
    let Some(mut d) = open(&OPTIONS, OptimizerConfig::default(), RasterConfig::default(), &g) else { return };
    assert!(d.train(&[step(0, 0)]).is_err(), "a view that was not uploaded");
    assert!(d.upload(&training_view(0, 1, false), 1).is_err(), "channels of another field");
    d.upload(&training_view(0, 3, false), 2).unwrap();
    assert!(d.train(&[step(0, 2)]).is_err(), "a level that is not there");
    assert!(d.train(&[Step { radio_weight: f32::NAN, ..step(0, 0) }]).is_err());
    assert!(d.render(&RenderRequest { main_contributor: true, ..RenderRequest::default() }).is_err());
    assert!(d.append(&room(1, 3, 1, [0, 0])).is_err(), "other channels");
    assert!(d.train(&[step(0, 0)]).is_ok(), "and the device still works");
}
