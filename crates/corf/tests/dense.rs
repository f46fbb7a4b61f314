//! Dense Adam and density control on the devices there are: steps against Adam as it is written down, bookkeeping of copies, opacity resets and
//! gradients on the screen, one device against the other, and bytes that do not depend on the number of threads.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use corf::{
    Antialias, CpuDevice, Device, Gaussians, OptimizerConfig, RasterConfig,
    device::{DenseStep, DeviceState, Duplicate, Modality, Planes, ScreenGradient, Step, TrainingView, ViewId},
    gaussians::{logit, sigmoid},
};
use corf_scene::{Pinhole, Rigid3, Rng};
use glam::DVec3;

/// Stock's constants but for the rates, which differ here from each other, so that none can stand in for another.
fn optimizer() -> OptimizerConfig {
    let mut config =
        OptimizerConfig { log_scale_rate: 0.005, rotation_rate: 0.001, beta1: 0.9, beta2: 0.999, ..Default::default() };
    (config.light.sh_dc, config.light.sh_rest_divisor, config.light.opacity) = (2.5e-3, 20.0, 0.05);
    (config.radio.sh_dc, config.radio.sh_rest_divisor, config.radio.opacity) = (2e-3, 10.0, 0.03);
    config
}

const POSITION_RATE_M: f32 = 2e-3;

trait Trained: Device {
    fn gradient(&mut self, step: &Step) -> Gaussians;
}

impl Trained for CpuDevice {
    fn gradient(&mut self, step: &Step) -> Gaussians {
        self.gradients(step).unwrap().1
    }
}

#[cfg(feature = "gpu")]
impl Trained for corf::device::gpu::GpuDevice {
    fn gradient(&mut self, step: &Step) -> Gaussians {
        self.gradients(step).unwrap().1
    }
}

/// Every device there is, holding `g` and two views.
fn devices(g: &Gaussians) -> Vec<Box<dyn Trained>> {
    let raster = RasterConfig { antialias: Antialias::Off, near_m: 0.2, ..RasterConfig::default() };
    let mut out: Vec<Box<dyn Trained>> = vec![Box::new(CpuDevice::new(optimizer(), raster, g).unwrap())];
    #[cfg(feature = "gpu")]
    {
        use corf::device::gpu::{GpuDevice, GpuOptions};
        let options = GpuOptions { least_room: 16, ..GpuOptions::on(corf_gpu::testing::OPTIONS) };
        if corf_gpu::adapter_name(&options.adapter).is_some() {
            out.push(Box::new(GpuDevice::new(&options, optimizer(), raster, g).unwrap()));
        } else {
            assert!(std::env::var_os("CORF_REQUIRE_GPU").is_none_or(|v| v != "1"), "no adapter");
            println!("skipped on the GPU: no adapter");
        }
    }
    for device in &mut out {
        (0..2).for_each(|k| assert_eq!(device.upload(&view(k), 1).unwrap(), ViewId(k)));
    }
    out
}

/// Gaussians all around the cameras, half of them behind either.
fn cloud(n: usize) -> Gaussians {
    let mut rng = Rng::keyed(5, 0, 0);
    let mut g = Gaussians::empty(3, 2);
    for _ in 0..n {
        let p = [0; 3].map(|_| rng.normal());
        let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt() / (2.0 + rng.uniform_f64());
        g.position.push(p.map(|v| (v / length) as f32));
        g.rotation.push([0; 4].map(|_| rng.normal() as f32));
        g.log_scale.push([0; 3].map(|_| -2.5 + rng.uniform()));
        for a in [&mut g.light, &mut g.radio] {
            a.opacity_logit.push(logit(0.1 + 0.8 * rng.uniform()));
            let stride = a.stride();
            a.sh.extend((0..stride).map(|_| (rng.uniform() - 0.5) * 0.3));
        }
    }
    g
}

fn view(k: usize) -> TrainingView {
    let mut rng = Rng::keyed(6, k as u64, 0);
    let forward = DVec3::new([1.0, -1.0][k], 0.2, 0.1);
    let (light_camera, radio_camera) = (Pinhole::from_horizontal_fov(43, 31, 80.0), Pinhole::from_horizontal_fov(24, 17, 90.0));
    let mut noise = |camera: &Pinhole| Planes {
        width: camera.width,
        height: camera.height,
        channels: 3,
        pixels: (0..3 * camera.width * camera.height).map(|_| rng.uniform()).collect(),
    };
    TrainingView {
        world_from_camera: Rigid3::looking_at(DVec3::ZERO, forward, DVec3::Z),
        light: noise(&light_camera),
        radio: noise(&radio_camera),
        light_camera,
        radio_camera,
        inverse_depth: None,
        mask: None,
    }
}

fn step(k: usize, weights: [f32; 2], train_geometry: bool) -> Step {
    Step {
        view: ViewId(k),
        levels: [0; 2],
        light_weight: weights[0],
        radio_weight: weights[1],
        depth_weight: 0.0,
        train_geometry,
        light_background: [0.0; 3],
        radio_background: [0.0, 0.0, 0.5],
    }
}

fn dense(k: usize, number: u32) -> DenseStep {
    let step = step(k, [1.0, 0.0], true);
    DenseStep { step, number, position_rate_m: POSITION_RATE_M, degree: 1, screen_gradients: true }
}

/// Classes of parameters, each one flat run, with the number of parameters of a Gaussian.
fn classes(g: &Gaussians) -> [(&'static str, &[f32]); 7] {
    [
        ("position", g.position.as_flattened()),
        ("rotation", g.rotation.as_flattened()),
        ("log scale", g.log_scale.as_flattened()),
        ("optical opacity", &g.light.opacity_logit),
        ("RF opacity", &g.radio.opacity_logit),
        ("optical sh", &g.light.sh),
        ("RF sh", &g.radio.sh),
    ]
}

/// Learning rate and learnt bands of parameter `i` of a class; `None` where the step does not touch it.
fn rate(class: usize, i: usize, dense: &DenseStep) -> Option<f64> {
    let (config, step) = (optimizer(), &dense.step);
    let (g, rates) = if class == 3 || class == 5 { (0, config.light) } else { (1, config.radio) };
    let rendered = [step.light_weight > 0.0, step.radio_weight > 0.0][g];
    let rate = match class {
        0..=2 if !step.train_geometry => return None,
        0 => dense.position_rate_m,
        1 => config.rotation_rate,
        2 => config.log_scale_rate,
        _ if !rendered => return None,
        3 | 4 => rates.opacity,
        _ => match i / 3 % 9 {
            0 => rates.sh_dc,
            k if k >= (dense.degree + 1).pow(2) => return None,
            _ => rates.sh_dc / rates.sh_rest_divisor,
        },
    };
    Some(f64::from(rate))
}

/// Adam as it is written down (Kingma and Ba 2015, Algorithm 1), in f64: value, first and second moment after a gradient.
fn adam(value: f64, m: f64, v: f64, gradient: f64, rate: f64, t: u32) -> [f64; 3] {
    let (b1, b2) = (f64::from(optimizer().beta1), f64::from(optimizer().beta2));
    let (m, v) = (b1 * m + (1.0 - b1) * gradient, b2 * v + (1.0 - b2) * gradient * gradient);
    let (m_hat, v_hat) = (m / (1.0 - b1.powi(t as i32)), v / (1.0 - b2.powi(t as i32)));
    [value - rate * m_hat / (v_hat.sqrt() + f64::from(optimizer().epsilon)), m, v]
}

/// A step in units of its rate, and moments in units of themselves: a dozen f32 roundings, and a square root and a division of a few ulp.
const STEP_TOLERANCE: f64 = 1e-5;

fn assert_adam(name: &str, dense: &DenseStep, before: &DeviceState, gradient: &Gaussians, after: &DeviceState) {
    let parts = |s: &'_ DeviceState| [s.gaussians.clone(), s.moments[0].clone(), s.moments[1].clone()];
    let (before, after) = (parts(before), parts(after));
    let gradient = classes(gradient);
    for class in 0..7 {
        let old: Vec<&[f32]> = before.iter().map(|g| classes(g)[class].1).collect();
        let new: Vec<&[f32]> = after.iter().map(|g| classes(g)[class].1).collect();
        for i in 0..old[0].len() {
            let place = format!("{name}, step {}: {} {i}", dense.number, gradient[class].0);
            let Some(rate) = rate(class, i, dense) else {
                assert!((0..3).all(|k| old[k][i] == new[k][i]), "{place} is not to be touched");
                continue;
            };
            let [old, new] = [&old, &new].map(|part| [0, 1, 2].map(|k| f64::from(part[k][i])));
            let [value, m, v] = adam(old[0], old[1], old[2], f64::from(gradient[class].1[i]), rate, dense.number);
            let rounding = 1.3e-7 * old[0].abs();
            assert!((new[0] - value).abs() <= STEP_TOLERANCE * 4.0 * rate + rounding, "{place}: {} against {value}", new[0]);
            // Of what is added up: a moment may be a small difference.
            let g = f64::from(gradient[class].1[i]);
            for (new, expected, terms) in [(new[1], m, old[1].abs() + g.abs()), (new[2], v, v)] {
                assert!((new - expected).abs() <= STEP_TOLERANCE * terms + 1e-25, "{place}: moment {new:e}, {expected:e}");
            }
        }
    }
}

#[test]
fn a_dense_step_is_adam_with_bias_correction_of_seen_and_unseen_alike() {
    for mut device in devices(&cloud(700)) {
        let name = device.name();
        for number in 1..=6 {
            // The views look away from each other: what one sees coasts while the other is trained on.
            let dense = dense(number as usize % 2, number);
            let (before, gradient) = (device.state().unwrap(), device.gradient(&dense.step));
            device.train_dense(&[dense]).unwrap();
            let after = device.state().unwrap();
            assert_adam(&name, &dense, &before, &gradient, &after);
            let coasting =
                |i: &usize| gradient.position[*i] == [0.0; 3] && after.gaussians.position[*i] != before.gaussians.position[*i];
            let count = (0..device.len()).filter(coasting).count();
            assert_eq!(count > 40, number > 1, "{name}: {count} Gaussians coast in step {number}");
            assert!(after.position_rate.iter().all(|r| *r == 1.0));
        }
    }
}

#[test]
fn a_frozen_geometry_stays_and_radio_alone_is_learnt() {
    for mut device in devices(&cloud(300)) {
        for number in 1..=3 {
            let dense =
                DenseStep { step: step(0, [0.0, 1.0], false), degree: 2, screen_gradients: false, ..dense(0, number + 30_000) };
            let (before, gradient) = (device.state().unwrap(), device.gradient(&dense.step));
            device.train_dense(&[dense]).unwrap();
            assert_adam(&device.name(), &dense, &before, &gradient, &device.state().unwrap());
        }
        assert!(device.screen_gradients().unwrap().iter().all(|g| *g == ScreenGradient::default()));
        for bad in [[0.0, 0.0], [1.0, 1.0]] {
            let text = device.train_dense(&[DenseStep { step: step(0, bad, true), ..dense(0, 1) }]).unwrap_err().to_string();
            assert!(text.contains("train one"), "{text}");
        }
        assert!(device.train_dense(&[DenseStep { number: 0, ..dense(0, 1) }]).is_err());
    }
}

#[test]
fn screen_gradients_are_summed_over_visits_and_forgotten_with_the_gaussians() {
    let g = cloud(400);
    for mut device in devices(&g) {
        // One step at a time, or all in one call.
        let visits = [0, 1, 0, 0];
        let steps: Vec<DenseStep> = visits.iter().enumerate().map(|(k, view)| dense(*view, k as u32 + 1)).collect();
        let start = device.state().unwrap();
        for one in &steps[..2] {
            device.train_dense(std::slice::from_ref(one)).unwrap();
        }
        let half = device.screen_gradients().unwrap();
        let middle = device.state().unwrap();
        device.train_dense(&steps[2..]).unwrap();
        let end = device.screen_gradients().unwrap();
        assert!(end.iter().all(|g| [0, 1, 3, 4].contains(&g.steps) && (g.steps > 0 || g.norm_sum == 0.0)));
        assert!(end.iter().filter(|g| g.steps == 3 && g.norm_sum > 0.0).count() > 20);
        // A device that is given what another had goes on to the same bytes.
        let restart = |device: &mut Box<dyn Trained>, state: &DeviceState| {
            device.retain(&vec![false; 400]).unwrap();
            device.restore(state).unwrap();
        };
        let finished = device.state().unwrap();
        restart(&mut device, &middle);
        assert!(device.screen_gradients().unwrap().iter().all(|g| *g == ScreenGradient::default()), "restoring forgets");
        device.set_screen_gradients(&half).unwrap();
        device.train_dense(&steps[2..]).unwrap();
        assert!(device.screen_gradients().unwrap() == end && device.state().unwrap() == finished);
        restart(&mut device, &start);
        device.train_dense(&steps).unwrap();
        assert!(device.screen_gradients().unwrap() == end && device.state().unwrap() == finished);
        let mut keep = vec![true; 400];
        keep[7] = false;
        device.retain(&keep).unwrap();
        assert!(device.screen_gradients().unwrap().iter().all(|g| *g == ScreenGradient::default()), "removing forgets");
        assert!(device.set_screen_gradients(&half).is_err(), "one is missing now");
    }
}

#[test]
fn copies_have_their_sources_colours_and_no_moments() {
    let n = 300;
    for mut device in devices(&cloud(n)) {
        device.train_dense(&[dense(0, 1), dense(1, 2)]).unwrap();
        let before = device.state().unwrap();
        assert!(before.moments[1].light.sh.iter().any(|v| *v != 0.0));
        let duplicates = [
            Duplicate { source: 17, offset: [0.0; 3], shrink: 1.0 },
            Duplicate { source: 250, offset: [0.5, -1.0, 0.25], shrink: 1.6 },
            Duplicate { source: 17, offset: [1.0, 0.0, 0.0], shrink: 1.6 },
        ];
        device.duplicate(&duplicates).unwrap();
        let after = device.state().unwrap();
        assert_eq!(after.gaussians.len(), n + 3);
        for (k, d) in duplicates.iter().enumerate() {
            let (i, from) = (n + k, d.source as usize);
            let (old, new) = (&before.gaussians, &after.gaussians);
            assert_eq!((new.rotation[i], new.light.opacity_logit[i]), (old.rotation[from], old.light.opacity_logit[from]));
            for (old, new) in [(&old.light, &new.light), (&old.radio, &new.radio)] {
                let s = old.stride();
                assert_eq!(new.sh[i * s..(i + 1) * s], old.sh[from * s..(from + 1) * s]);
            }
            for axis in 0..3 {
                let ratio = (old.log_scale[from][axis] - new.log_scale[i][axis]).exp();
                assert!((ratio - d.shrink).abs() < 1e-5, "{ratio}");
            }
        }
        assert_eq!(after.gaussians.position[n], before.gaussians.position[17]);
        let moved =
            (0..3).map(|k| (after.gaussians.position[n + 2][k] - before.gaussians.position[17][k]).powi(2)).sum::<f32>().sqrt();
        assert!((moved - before.gaussians.log_scale[17][0].exp()).abs() < 1e-5, "one standard deviation along the first axis");
        for moments in &after.moments {
            for (_, values) in classes(moments) {
                let per = values.len() / (n + 3);
                assert!(values[n * per..].iter().all(|v| *v == 0.0));
            }
        }
        // Those held are as they were.
        let mut keep = vec![true; n + 3];
        keep[n..].fill(false);
        device.retain(&keep).unwrap();
        assert!(device.state().unwrap() == before);
        let text = device.duplicate(&[Duplicate { source: n as u32, offset: [0.0; 3], shrink: 1.0 }]).unwrap_err().to_string();
        assert!(text.contains("Gaussian 300 of 300"), "{text}");
        assert_eq!(device.len(), n);
        device.duplicate(&[]).unwrap();
        device.train_dense(&[dense(0, 3)]).unwrap();
    }
}

#[test]
fn an_opacity_reset_caps_light_alone_and_forgets_its_moments() {
    for mut device in devices(&cloud(200)) {
        device.train_dense(&[dense(0, 1), dense(1, 2)]).unwrap();
        let before = device.state().unwrap();
        device.cap_opacity(Modality::Light, 0.3).unwrap();
        let mut after = device.state().unwrap();
        for (new, old) in after.gaussians.light.opacity_logit.iter().zip(&before.gaussians.light.opacity_logit) {
            assert!((sigmoid(*new) - sigmoid(*old).min(0.3)).abs() < 1e-6 && (*old > logit(0.3) || new == old));
        }
        assert!(before.gaussians.light.opacity_logit.iter().any(|l| *l > logit(0.3)));
        for k in 0..2 {
            assert!(after.moments[k].light.opacity_logit.iter().all(|m| *m == 0.0));
            after.moments[k].light.opacity_logit.clone_from(&before.moments[k].light.opacity_logit);
        }
        after.gaussians.light.opacity_logit.clone_from(&before.gaussians.light.opacity_logit);
        assert!(after == before, "all else is as it was");
    }
}

#[test]
fn the_bytes_of_dense_steps_do_not_depend_on_the_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut device = CpuDevice::new(optimizer(), RasterConfig::default(), &cloud(2000)).unwrap();
            (0..2).for_each(|k| assert_eq!(device.upload(&view(k), 1).unwrap(), ViewId(k)));
            let steps: Vec<DenseStep> = (1..20).map(|t| dense(t % 2, t as u32)).collect();
            device.train_dense(&steps).unwrap();
            (device.state().unwrap(), device.screen_gradients().unwrap())
        })
    };
    assert!(run(1) == run(3));
}

/// Sums over Gaussians of what differs by rounding, and by pixels at a threshold (a weight within rounding of 1/255).
#[cfg(feature = "gpu")]
const BETWEEN_DEVICES: f64 = 2e-3;
/// A device's tiles decide which Gaussians between two rows of pixel centres count as visible without being drawn.
#[cfg(feature = "gpu")]
const UNDRAWN_SHARE: f64 = 0.03;

#[cfg(feature = "gpu")]
#[test]
fn devices_agree_on_screen_gradients() {
    let n = 3000;
    let mut found = vec![];
    for mut device in devices(&cloud(n)) {
        device.train_dense(&[dense(0, 1)]).unwrap();
        found.push(device.screen_gradients().unwrap());
    }
    let [cpu, gpu] = &found[..] else { return };
    let norm = |of: &dyn Fn(usize) -> f32| (0..n).map(|i| f64::from(of(i)).powi(2)).sum::<f64>().sqrt();
    let (apart, all) = (norm(&|i| cpu[i].norm_sum - gpu[i].norm_sum), norm(&|i| cpu[i].norm_sum));
    assert!(all > 0.0 && apart <= BETWEEN_DEVICES * all, "{apart:.2e} of {all:.2e}");
    let seen = cpu.iter().filter(|g| g.steps == 1).count();
    let differ = cpu.iter().zip(gpu).filter(|(a, b)| a.steps != b.steps).count();
    assert!(seen > 200 && differ as f64 <= UNDRAWN_SHARE * seen as f64, "{differ} of {seen}");
}
