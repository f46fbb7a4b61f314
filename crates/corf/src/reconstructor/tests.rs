//! The policy above a device that only records what it is told: nothing here depends on how pictures are made.

use super::*;
use crate::{
    Appearance, Gaussians, RadioTarget, ReconstructionConfig, Sampling,
    config::{DepthConfig, DepthPriorKind},
    device::{Layer, Planes, RenderRequest, Rendering, TrainingView, ViewId},
    gaussians::sigmoid,
    synthetic::{self, light, spectrum},
};
use corf_scene::{Light, Raster};
use std::sync::{Arc, Mutex};

/// Log of the calls to a recording device, and the answer that it renders.
#[derive(Default)]
struct Log {
    steps: Vec<Step>,
    views: Vec<TrainingView>,
    resets: Vec<Appearance>,
    position_rate_m: f32,
    /// Values that a render returns: coverage and inverse depth everywhere, and the main contributor.
    coverage: f32,
    inverse_depth: f32,
    main: u32,
}

#[derive(Clone)]
struct Recorder {
    log: Arc<Mutex<Log>>,
    field: Gaussians,
}

impl Device for Recorder {
    fn name(&self) -> String {
        "recorder".into()
    }
    fn upload(&mut self, view: &TrainingView, _levels: u32) -> Result<ViewId> {
        let mut log = self.log.lock().unwrap();
        log.views.push(view.clone());
        Ok(ViewId(log.views.len() - 1))
    }
    fn len(&self) -> usize {
        self.field.len()
    }
    fn append(&mut self, new: &Gaussians) -> Result<()> {
        if self.field.is_empty() {
            self.field = new.clone();
            return Ok(());
        }
        self.field.position.extend(&new.position);
        self.field.rotation.extend(&new.rotation);
        self.field.log_scale.extend(&new.log_scale);
        for (a, b) in [(&mut self.field.light, &new.light), (&mut self.field.radio, &new.radio)] {
            a.opacity_logit.extend(&b.opacity_logit);
            a.sh.extend(&b.sh);
        }
        Ok(())
    }
    fn retain(&mut self, keep: &[bool]) -> Result<()> {
        fn filter<T: Clone>(values: &mut Vec<T>, keep: &[bool], stride: usize) {
            *values = values.chunks(stride).zip(keep).filter(|c| *c.1).flat_map(|c| c.0.to_vec()).collect();
        }
        assert_eq!(keep.len(), self.field.len());
        filter(&mut self.field.position, keep, 1);
        filter(&mut self.field.rotation, keep, 1);
        filter(&mut self.field.log_scale, keep, 1);
        for a in [&mut self.field.light, &mut self.field.radio] {
            let stride = a.stride();
            filter(&mut a.opacity_logit, keep, 1);
            filter(&mut a.sh, keep, stride);
        }
        Ok(())
    }
    fn reset_radio(&mut self, radio: &Appearance) -> Result<()> {
        self.field.radio = radio.clone();
        self.log.lock().unwrap().resets.push(radio.clone());
        Ok(())
    }
    fn set_position_rate_m(&mut self, rate_m: f32) {
        self.log.lock().unwrap().position_rate_m = rate_m;
    }
    fn render(&mut self, request: &RenderRequest) -> Result<Rendering> {
        let log = self.log.lock().unwrap();
        let layer = |camera: Pinhole, channels: usize, background: [f32; 3]| Layer {
            color: Planes {
                width: camera.width,
                height: camera.height,
                channels,
                pixels: (0..camera.width * camera.height * channels).map(|i| background[i % channels]).collect(),
            },
            inverse_depth: Raster::filled(camera.width, camera.height, log.coverage * log.inverse_depth),
            transmittance: Raster::filled(camera.width, camera.height, 1.0 - log.coverage),
        };
        Ok(Rendering {
            light: request.light.map(|(v, b)| layer(v.camera, 3, b)),
            radio: request.radio.map(|(v, b)| layer(v.camera, self.field.radio.channels, b)),
            main_contributor: request.light.map(|(v, _)| Raster::filled(v.camera.width, v.camera.height, log.main)),
        })
    }
    fn train(&mut self, steps: &[Step]) -> Result<StepReport> {
        self.log.lock().unwrap().steps.extend(steps);
        // Something an optimiser might do to the opacity, so that stages can be told apart.
        self.field.light.opacity_logit.iter_mut().for_each(|o| *o += 0.01);
        Ok(StepReport { light_loss: 0.5, radio_loss: 0.25, depth_loss: 0.125, visible: self.field.len() })
    }
    fn gaussians(&mut self) -> Result<Gaussians> {
        Ok(self.field.clone())
    }
}

fn cameras() -> (Pinhole, Pinhole) {
    (Pinhole::from_horizontal_fov(96, 64, 90.0), Pinhole::from_horizontal_fov(48, 32, 90.0))
}

fn keyframes(count: usize) -> Vec<Keyframe> {
    let (light, radio) = cameras();
    (0..count).map(|i| synthetic::keyframe(i, synthetic::pose(i as f64 * 1.5), &light, &radio, true)).collect()
}

fn reconstructor(config: ReconstructionConfig, seed: u64) -> (Reconstructor, Arc<Mutex<Log>>) {
    let log = Arc::new(Mutex::new(Log { main: u32::MAX, inverse_depth: 0.2, ..Log::default() }));
    let device = Recorder { log: log.clone(), field: config.empty_field() };
    let (light, radio) = cameras();
    (Reconstructor::new(Box::new(device), config, light, radio, synthetic::DB_RANGE, seed).unwrap(), log)
}

fn run(config: ReconstructionConfig, seed: u64, keyframes: &[Keyframe]) -> (Reconstructor, Arc<Mutex<Log>>, Vec<KeyframeReport>) {
    let (mut r, log) = reconstructor(config, seed);
    let mut reports: Vec<KeyframeReport> = keyframes.iter().map(|k| r.push(k).unwrap()).collect();
    reports.push(r.finish(&mut |_, _| std::ops::ControlFlow::Continue(())).unwrap());
    (r, log, reports)
}

/// Steps look at no more levels of the spectrum than it is to have: how many an image has says nothing of it.
#[test]
fn the_size_check_heeds_the_levels_of_the_spectrum() {
    let make = |levels: u32, of_radio: Option<u32>, radio: [usize; 2]| {
        let config = ReconstructionConfig { pyramid_levels: levels, radio_pyramid_levels: of_radio, ..Default::default() };
        let device = Recorder { log: Arc::default(), field: config.empty_field() };
        let light = Pinhole::from_horizontal_fov(33, 19, 90.0);
        let radio = Pinhole::from_horizontal_fov(radio[0], radio[1], 90.0);
        Reconstructor::new(Box::new(device), config, light, radio, synthetic::DB_RANGE, 1).map(|_| ()).map_err(|e| e.to_string())
    };
    assert_eq!(make(2, Some(1), [17, 9]), Ok(()));
    assert_eq!(make(1, None, [8, 8]), Ok(()));
    assert_eq!(make(2, Some(2), [16, 16]), Ok(()));
    for (levels, of_radio, radio, key, words) in [
        (2, None, [17, 9], "`pyramid_levels`", "level 1 of the 17x9 RF image"),
        (2, Some(2), [17, 9], "`rf_pyramid_levels`", "level 1 of the 17x9 RF image"),
        (2, Some(1), [17, 7], "`rf_pyramid_levels`", "level 0 of the 17x7 RF image"),
        (3, Some(1), [17, 9], "`pyramid_levels`", "level 2 of the 33x19 optical image"),
    ] {
        let error = make(levels, of_radio, radio).unwrap_err();
        assert!(error.contains(key) && error.contains(words), "{error}");
    }
}

#[test]
fn every_keyframe_is_expanded_once_and_gets_its_iterations() {
    let frames = keyframes(5);
    let (mut r, log, reports) = run(ReconstructionConfig::default(), 1, &frames);
    let expanded: Vec<usize> = reports.iter().map(|r| r.keyframes_expanded).collect();
    assert_eq!(expanded, [0, 0, 3, 1, 1, 0], "the first three wait for each other");
    let log = log.lock().unwrap();
    assert_eq!(log.steps.len(), 5 * 75);
    assert_eq!(log.views.len(), 5);
    assert!(log.views.iter().all(|v| v.inverse_depth.is_some()), "the aligned prior is uploaded");
    let spawned: usize = reports.iter().map(|r| r.spawned).sum();
    let gone: usize = reports.iter().map(|r| r.replaced + r.pruned).sum();
    assert_eq!(r.gaussian_count(), spawned - gone);
    assert_eq!(r.born.len(), r.gaussian_count());
    assert!(spawned > 500, "{spawned}");
    assert!(reports[3].accurate_share > 0.2 && reports[2].ground_truth_depth_used && reports[2].prior_aligned);
    // Steps of the published method: joint, λ = 0.1, every background its own, radio on its floor.
    assert!(log.steps.iter().all(|s| s.light_weight == 1.0 && s.radio_weight == 0.1 && s.train_geometry));
    assert!(log.steps.iter().all(|s| s.radio_background == RadioTarget::Jet.floor_color()));
    // The world scale is that of the first baselines: 0.36 m on this walk.
    let field = r.field().unwrap().gaussians;
    let mean = (1..5)
        .map(|i| (frames[i].world_from_camera.translation - frames[i - 1].world_from_camera.translation).length())
        .sum::<f64>()
        / 4.0;
    assert!((f64::from(log.position_rate_m) / (5e-5 * mean / 0.1) - 1.0).abs() < 1e-5);
    // New Gaussians lie in the room: exact depth is to be had from the prior to 10 % and from matching better.
    let inside = field.position.iter().filter(|p| p[0].abs() < 4.5 && p[1].abs() < 3.5 && p[2] > -0.5 && p[2] < 3.3).count();
    assert!(inside as f32 > 0.95 * field.len() as f32);
}

#[test]
fn two_stage_couplings_take_as_many_radio_steps_on_a_geometry_that_light_made() {
    let frames = keyframes(4);
    for (coupling, geometry) in [(Coupling::Frozen, false), (Coupling::RadioTuned, true)] {
        let config = ReconstructionConfig { coupling, radio_target: RadioTarget::Db, ..Default::default() };
        let (mut r, log) = reconstructor(config, 1);
        frames.iter().for_each(|k| assert!(r.push(k).is_ok()));
        let before = r.field().unwrap().gaussians;
        let mut progress = Vec::new();
        r.finish(&mut |done, total| {
            progress.push((done, total));
            std::ops::ControlFlow::Continue(())
        })
        .unwrap();
        assert_eq!(progress.last(), Some(&(300, 300)));
        let log = log.lock().unwrap();
        let (first, second) = log.steps.split_at(300);
        assert!(first.iter().all(|s| s.radio_weight == 0.0 && s.light_weight == 1.0 && s.train_geometry));
        assert_eq!(second.len(), 300);
        assert!(second.iter().all(|s| s.light_weight == 0.0 && s.radio_weight > 0.0 && s.depth_weight == 0.0));
        assert!(second.iter().all(|s| s.train_geometry == geometry));
        assert_eq!(second[0].levels, [2; 2], "the second stage begins coarse");
        assert_eq!(log.resets.len(), 1);
        assert_eq!(log.resets[0].sh, before.radio.sh, "colours as sampled from the spectra");
        assert_eq!(log.resets[0].opacity_logit, before.light.opacity_logit, "the opacity light has learnt");
    }
}

#[test]
fn uniform_sampling_draws_a_tenth_of_the_pixels_and_more_than_structure_does() {
    let frames = keyframes(3);
    let uniform = ReconstructionConfig { sampling: Sampling::Uniform, ..Default::default() };
    let (_, _, reports) = run(uniform, 1, &frames);
    let expected = 3.0 * 96.0 * 64.0 * 0.1;
    // Binomial, five standard deviations.
    assert!((reports[2].sampled as f64 - expected).abs() < 5.0 * (expected * 0.9f64).sqrt(), "{}", reports[2].sampled);
}

#[test]
fn without_a_prior_depths_come_from_matching_alone() {
    let depth = DepthConfig { prior: DepthPriorKind::None, ..Default::default() };
    let blind = |k: &Keyframe| synthetic::seen(k, |light| (light.depth_m, light.surface) = (None, None));
    let frames: Vec<Keyframe> = keyframes(4).iter().map(blind).collect();
    let (_, log, reports) = run(ReconstructionConfig { depth, ..Default::default() }, 1, &frames);
    assert!(reports.iter().all(|r| !r.ground_truth_depth_used && !r.prior_aligned));
    assert!(reports[2].spawned > 150 && reports[2].accurate_share == 1.0, "{:?}", reports[2]);
    assert!(log.lock().unwrap().views.iter().all(|v| v.inverse_depth.is_none()));
    // The simulated prior cannot do that.
    let (mut r, _) = reconstructor(ReconstructionConfig::default(), 1);
    let error = r.push(&frames[0]).unwrap_err().to_string();
    assert!(error.contains("keyframe 0") && error.contains("no depth"), "{error}");
}

/// A picture that something white with black dots has walked through, and the mask that says where.
fn with_a_passer_by(k: &Keyframe) -> Keyframe {
    let left = 20 + 8 * k.index;
    let (white, black) = ([255; 3], [0; 3]);
    synthetic::seen(k, |light| {
        let (w, h) = (light.image.width(), light.image.height());
        let mask = Raster::from_fn(w, h, |x, y| !((left..left + 30).contains(&x) && y > 10));
        light.image = Raster::from_fn(w, h, |x, y| match mask[(x, y)] {
            true => light.image[(x, y)],
            false => [white, black][usize::from((x - left) % 4 < 2 && y % 4 < 2)],
        });
        light.mask = Some(mask);
    })
}

#[test]
fn nothing_is_born_where_pixels_do_not_count_and_no_depth_is_learnt_there() {
    let frames: Vec<Keyframe> = keyframes(5).iter().map(with_a_passer_by).collect();
    for (sampling, prior) in [
        (Sampling::Log, DepthPriorKind::Simulated),
        (Sampling::Uniform, DepthPriorKind::Simulated),
        (Sampling::Log, DepthPriorKind::Exact),
        (Sampling::Log, DepthPriorKind::None),
    ] {
        let depth = DepthConfig { prior, ..Default::default() };
        let (mut r, log, _) = run(ReconstructionConfig { sampling, depth, ..Default::default() }, 1, &frames);
        let field = r.field().unwrap().gaussians;
        assert!(field.len() > 150, "{sampling:?}, {prior:?}: {}", field.len());
        for (p, born) in field.position.iter().zip(&r.born) {
            let k = &frames[*born as usize];
            let seen = k.world_from_camera.inverse().transform_point(glam::Vec3::from(*p).as_dvec3());
            let at = cameras().0.project(seen).unwrap();
            let pixel = (at.x as usize, at.y as usize);
            assert!(light(k).mask.as_ref().unwrap()[pixel], "{sampling:?}, {prior:?}: {pixel:?} of keyframe {born}");
        }
        for (view, k) in log.lock().unwrap().views.iter().zip(&frames) {
            assert_eq!(view.mask, light(k).mask);
            assert_eq!(view.inverse_depth.is_some(), prior != DepthPriorKind::None);
            let mask = light(k).mask.as_ref().unwrap().pixels();
            let confident = view.inverse_depth.iter().flat_map(|d| d.confidence.pixels().iter().zip(mask));
            assert!(confident.clone().all(|(confidence, counts)| *counts || *confidence == 0.0));
            assert!(prior == DepthPriorKind::None || confident.filter(|c| *c.0 > 0.0).count() > 1000);
        }
    }
}

/// The picture around the passer-by is taken for what is behind it, so that no outline of it draws Gaussians.
#[test]
fn a_target_continues_under_its_mask_and_is_the_image_elsewhere() {
    let k = with_a_passer_by(&keyframes(1)[0]);
    let light = light(&k);
    let of_mask = |mask| crate::keyframe::light(&Light { mask, ..light.clone() });
    let (plain, target) = (of_mask(None), crate::keyframe::light(light));
    let mask = light.mask.as_ref().unwrap();
    for (i, (a, b)) in target.pixels.chunks(3).zip(plain.pixels.chunks(3)).enumerate() {
        assert!(!mask.pixels()[i] || a == b);
    }
    // In the passer-by's lower left corner: the pixel beside it.
    assert_eq!(target.pixels[(63 * 96 + 20) * 3..][..3], plain.pixels[(63 * 96 + 19) * 3..][..3]);
    assert_eq!(of_mask(Some(mask.map(|_| true))), plain);
    assert_eq!(of_mask(Some(mask.map(|_| false))), plain, "of nothing nothing is known");
}

#[test]
fn a_gaussian_that_new_ones_stand_on_gives_way() {
    let frames = keyframes(4);
    let (mut r, log) = reconstructor(ReconstructionConfig::default(), 1);
    frames[..3].iter().for_each(|k| assert!(r.push(k).is_ok()));
    log.lock().unwrap().main = 7;
    let before = r.field().unwrap().gaussians;
    let report = r.push(&frames[3]).unwrap();
    assert_eq!(report.replaced, 1);
    let after = r.field().unwrap().gaussians;
    assert!(before.position.contains(&before.position[7]) && !after.position.contains(&before.position[7]));
}

#[test]
fn a_keyframe_joins_after_the_last_steps_of_the_one_before() {
    let frames = keyframes(5);
    for late in [8, 20] {
        let config = ReconstructionConfig { iterations_per_keyframe: 20, overlapped_iterations: late, ..Default::default() };
        let (mut r, log) = reconstructor(config, 1);
        for (k, frame) in frames.iter().enumerate() {
            let before = log.lock().unwrap().steps.len();
            let report = r.push(frame).unwrap();
            let log = log.lock().unwrap();
            let steps = &log.steps[before..];
            assert_eq!(report.steps, steps.len());
            match report.keyframes_expanded {
                0 => assert_eq!(report.steps, 0, "the first ones are collected"),
                1 => {
                    assert_eq!(report.steps, 20);
                    assert!(steps[..late].iter().all(|s| s.view.0 < k) && report.light_loss > 0.0);
                    assert_eq!(steps[late..].iter().any(|s| s.view.0 == k), late < 20);
                }
                first => assert_eq!(report.steps, 20 * first - late, "the last of them waits for a keyframe"),
            }
        }
        assert_eq!(r.timings().iter().filter(|t| t.late_s > 0.0).count(), 4, "the last one's have not ended");
        let report = r.finish(&mut |_, _| std::ops::ControlFlow::Continue(())).unwrap();
        assert_eq!((report.steps, log.lock().unwrap().steps.len()), (late, 20 * frames.len()));
        assert!(log.lock().unwrap().steps[20 * 5 - late..].iter().any(|s| s.view.0 == 4));
        assert_eq!(r.timings().iter().filter(|t| t.late_s > 0.0).count(), 5);
    }
}

#[test]
fn new_gaussians_are_born_with_the_same_opacity_in_both_modalities() {
    let (mut r, _, _) = run(ReconstructionConfig { iterations_per_keyframe: 1, ..Default::default() }, 1, &keyframes(3));
    let radio = r.field().unwrap().gaussians.radio.opacity_logit;
    let born: std::collections::BTreeSet<u32> = radio.iter().map(|&o| (sigmoid(o) * 1000.0).round() as u32).collect();
    assert!(born.is_subset(&[70, 20, 200].into()), "{born:?}");
    assert!(born.contains(&70) && born.contains(&20));
}

#[test]
fn the_same_seed_gives_the_same_bytes_with_any_number_of_threads() {
    let frames = keyframes(4);
    let with = |threads, seed| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| run(ReconstructionConfig::default(), seed, &frames).0.field().unwrap().gaussians)
    };
    let one = with(1, 7);
    assert_eq!(one, with(3, 7));
    assert_ne!(one, with(1, 8));
}

#[test]
fn bad_keyframes_are_refused_with_their_index_and_leave_the_field_alone() {
    let frames = keyframes(4);
    let (mut r, _) = reconstructor(ReconstructionConfig::default(), 1);
    frames[..3].iter().for_each(|k| assert!(r.push(k).is_ok()));
    let before = r.field().unwrap().gaussians;
    let mut refused = |k: &Keyframe, word: &str| {
        let error = r.push(k).unwrap_err().to_string();
        assert!(error.contains(&format!("keyframe {}", k.index)) && error.contains(word), "{error}");
    };
    refused(&frames[1], "order");
    let mut nan = frames[3].clone();
    nan.world_from_camera.translation.x = f64::NAN;
    refused(&nan, "pose");
    refused(&synthetic::with_spectrum(&frames[3], Raster::filled(4, 4, 0.0)), "spectrum");
    let mut bad = spectrum(&frames[3]).clone();
    bad[(5, 2)] = f32::NAN;
    refused(&synthetic::with_spectrum(&frames[3], bad), "row 2, column 5");
    let dark = Keyframe { light: None, ..frames[3].clone() };
    refused(&dark, "those before it");
    refused(&Keyframe { radio: None, ..frames[3].clone() }, "those before it");
    refused(&Keyframe { radio: None, ..dark }, "neither light nor radio");
    assert_eq!(r.field().unwrap().gaussians, before);
    r.push(&frames[3]).unwrap();
    assert!(r.fine_tune(1, &mut |_, _| std::ops::ControlFlow::Continue(())).is_err(), "fine-tuning comes after the end");
    r.finish(&mut |_, _| std::ops::ControlFlow::Continue(())).unwrap();
    assert!(r.push(&keyframes(5)[4]).is_err());
}

/// A time takes the place of a number of steps: whole batches while it lasts, and one where expansion has already taken it.
#[test]
fn a_keyframe_with_a_time_takes_steps_while_it_lasts() {
    let config = |ms| ReconstructionConfig { keyframe_budget_ms: Some(ms), ..Default::default() };
    let (mut r, log, reports) = run(config(1.0), 1, &keyframes(4));
    let steps: Vec<usize> = r.timings().iter().map(|t| t.steps.unwrap()).collect();
    assert!(steps.len() == 4 && steps.iter().all(|n| *n >= 5 && n % 5 == 0), "{steps:?}");
    assert_eq!(steps.iter().sum::<usize>(), log.lock().unwrap().steps.len());
    assert_eq!(reports.iter().map(|r| r.steps).sum::<usize>(), steps.iter().sum::<usize>());
    let (longer, ..) = run(config(200.0), 1, &keyframes(4));
    for (timing, short) in longer.timings().iter().zip(&steps) {
        assert!(timing.expand_s + timing.train_s > 0.1 && timing.steps.unwrap() > *short, "{timing:?}");
    }
    assert!(run(ReconstructionConfig::default(), 1, &keyframes(2)).0.timings().iter().all(|t| t.steps.is_none()));

    r.finish(&mut |_, _| std::ops::ControlFlow::Continue(())).unwrap();
    let before = log.lock().unwrap().steps.len();
    let mut told = 0;
    let time = std::time::Duration::from_millis(20);
    let epochs = r
        .fine_tune_for(time, &mut |_| {
            told += 1;
            std::ops::ControlFlow::Continue(())
        })
        .unwrap();
    assert!(epochs > 1 && epochs == told);
    assert_eq!(log.lock().unwrap().steps.len() - before, 4 * epochs, "an epoch is every keyframe once");
    let stopped = r.fine_tune_for(time, &mut |_| std::ops::ControlFlow::Break(()));
    assert!(matches!(stopped, Err(Error::Stopped)));

    let settings = ReconstructionConfig { overlapped_iterations: 3, ..config(10.0) };
    let idle = settings.idle_keys();
    assert!(["iterations_per_keyframe", "overlapped_iterations"].iter().all(|key| idle.iter().any(|k| k.key == *key)));
    assert!(config(0.5).validate().is_err() && config(f64::NAN).validate().is_err());
}

/// In a capture without light the Jet picture of the spectrum is what growth looks at; its pose, its spectrum and its camera are all that is read.
#[test]
fn without_light_growth_is_guided_by_the_spectrum() {
    let depth = DepthConfig { prior: DepthPriorKind::None, ..Default::default() };
    let (_, radio) = cameras();
    let frames: Vec<Keyframe> =
        (0..4).map(|i| synthetic::keyframe(i, synthetic::pose(i as f64 * 1.5), &radio, &radio, true)).collect();
    let run = |frames: &[Keyframe]| {
        let config = ReconstructionConfig { depth: depth.clone(), ..Default::default() };
        let log = Arc::new(Mutex::new(Log { main: u32::MAX, inverse_depth: 0.2, ..Log::default() }));
        let device = Recorder { log: log.clone(), field: config.empty_field() };
        let mut r = Reconstructor::new(Box::new(device), config, radio, radio, synthetic::DB_RANGE, 1).unwrap();
        frames.iter().for_each(|k| assert!(r.push(k).is_ok()));
        r.finish(&mut |_, _| std::ops::ControlFlow::Continue(())).unwrap();
        let views = log.lock().unwrap().views.clone();
        (r.field().unwrap(), views)
    };
    let dark: Vec<Keyframe> = frames.iter().map(|k| Keyframe { light: None, ..k.clone() }).collect();
    let (field, views) = run(&dark);
    assert_eq!(field.meta.modalities, Modalities { light: false, radio: true });
    let picture = |k: &Keyframe| Light::of_image(synthetic::DB_RANGE.jet_image(spectrum(k)));
    for (view, k) in views.iter().zip(&frames) {
        assert_eq!(view.light, crate::keyframe::light(&picture(k)));
    }
    // As if a camera had seen the picture.
    let shown: Vec<Keyframe> = frames.iter().map(|k| Keyframe { light: Some(picture(k)), ..k.clone() }).collect();
    let (of_shown, _) = run(&shown);
    assert!(field.gaussians.len() > 10 && field.gaussians == of_shown.gaussians, "{}", field.gaussians.len());
    assert_eq!(of_shown.meta.modalities, Modalities::BOTH);
    // The spectrum is then to be of the camera that growth looks through.
    let (mut r, _) = reconstructor(ReconstructionConfig { depth, ..Default::default() }, 1);
    let error = r.push(&dark[0]).unwrap_err().to_string();
    assert!(error.contains("48x32") && error.contains("96x64"), "{error}");
}

/// Without radio no spectrum is trained: whoever asks for it is told, and the target is that of no power.
#[test]
fn without_radio_light_alone_is_trained() {
    let frames: Vec<Keyframe> = keyframes(4).into_iter().map(|k| Keyframe { radio: None, ..k }).collect();
    let (mut r, _) = reconstructor(ReconstructionConfig::default(), 1);
    let error = r.push(&frames[0]).unwrap_err().to_string();
    assert!(error.contains("keyframe 0") && error.contains("rf_weight = 0"), "{error}");
    let config = ReconstructionConfig { radio_weight: 0.0, ..Default::default() };
    let (mut r, log, reports) = run(config, 1, &frames);
    assert!(reports[2].spawned > 150, "{:?}", reports[2]);
    assert_eq!(r.field().unwrap().meta.modalities, Modalities { light: true, radio: false });
    let log = log.lock().unwrap();
    let silence = r.config.radio_target.encode(&Raster::filled(48, 32, 0.0), &synthetic::DB_RANGE);
    assert!(log.views.iter().all(|v| v.radio == silence) && log.steps.iter().all(|s| s.radio_weight == 0.0));
}

#[test]
fn fine_tuning_counts_in_epochs() {
    let frames = keyframes(4);
    let (mut r, log, _) = run(ReconstructionConfig::default(), 1, &frames);
    let before = log.lock().unwrap().steps.len();
    r.fine_tune(3, &mut |_, _| std::ops::ControlFlow::Continue(())).unwrap();
    let log = log.lock().unwrap();
    let tuned = &log.steps[before..];
    assert_eq!(tuned.len(), 3 * 4);
    assert!(tuned.iter().all(|s| s.levels == [0; 2]));
    for epoch in tuned.chunks(4) {
        assert_eq!(epoch.iter().map(|s| s.view.0).collect::<std::collections::BTreeSet<_>>().len(), 4);
    }
}
