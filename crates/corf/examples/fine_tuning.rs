//! Fine-tuning by several ways from one field, with the processor time of each.
#![allow(clippy::print_stdout)]

use corf::device::cpu::{experiment::Sampler, gauss_newton::{GaussNewton, GaussNewtonConfig, Objective}};
use corf::{CpuDevice, OptimizerConfig, RasterConfig, ReconstructionConfig, Reconstructor};
use corf::reconstructor::schedule::{Schedule, StageWeights};
use corf::{Device, FieldMeta};
use corf_scene::{Keyframe, Raster, color, dataset::Dataset};
use std::ops::ControlFlow;

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

/// Processor time of all threads, seconds.
fn processor_s() -> f64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    let of_main: f64 = text.split(' ').next().and_then(|t| t.parse().ok()).unwrap_or(0.0);
    let mut sum = 0.0;
    for task in std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten() {
        let text = std::fs::read_to_string(task.path().join("schedstat")).unwrap_or_default();
        sum += text.split(' ').next().and_then(|t| t.parse::<f64>().ok()).unwrap_or(0.0);
    }
    let _ = of_main;
    sum * 1e-9
}

fn psnr(square: f64, n: usize) -> f64 {
    -10.0 * (square / n as f64).log10()
}

fn quantised(v: f32) -> f64 {
    f64::from(color::quantize8(v)) / 255.0
}

/// Means over keyframes: light, RF in dB, RF as Jet.
fn evaluate(device: &mut dyn Device, meta: &FieldMeta, keyframes: &[Keyframe]) -> Fallible<[f64; 3]> {
    let mut sum = [0.0; 3];
    let each = std::env::var_os("EACH").is_some();
    for truth in keyframes {
        let seen = meta.render(device, truth.world_from_camera)?;
        let image = &truth.light.as_ref().ok_or("no light")?.image;
        let square: f64 = seen.image.pixels().iter().flatten().zip(image.pixels().iter().flatten())
            .map(|(a, b)| (quantised(*a) - f64::from(*b) / 255.0).powi(2)).sum();
        sum[0] += psnr(square, 3 * image.pixels().len());
        if each {
            print!(" {}:{:.2}", truth.index, psnr(square, 3 * image.pixels().len()));
        }
        let spectrum: &Raster<f32> = &truth.radio.as_ref().ok_or("no radio")?.spectrum;
        let scalar = spectrum.map(|s| meta.db_range.scalar(*s));
        let n = scalar.pixels().len();
        let square: f64 = seen.scalar.pixels().iter().zip(scalar.pixels()).map(|(a, b)| (quantised(*a) - quantised(*b)).powi(2)).sum();
        sum[1] += psnr(square, n);
        if each {
            print!("/{:.2}", psnr(square, n));
        }
        let square: f64 = seen.radio.pixels.chunks_exact(3).zip(scalar.pixels())
            .flat_map(|(a, b)| { let b = color::jet(*b); (0..3).map(move |c| (quantised(a[c]) - quantised(b[c])).powi(2)) }).sum();
        sum[2] += psnr(square, 3 * n);
    }
    Ok(sum.map(|s| s / keyframes.len() as f64))
}

/// key=value words.
struct Options(std::collections::BTreeMap<String, String>);
impl Options {
    fn get(&self, key: &str, default: f64) -> f64 {
        self.0.get(key).map_or(default, |v| v.parse().expect(key))
    }
}

struct Task<'a> {
    meta: FieldMeta,
    config: ReconstructionConfig,
    weights: StageWeights,
    held_out: &'a [Keyframe],
    train: &'a [Keyframe],
    label: String,
}

fn main() -> Fallible<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, seed, variants @ ..] = &arguments[..] else { return Err("DATA SEED VARIANT...".into()) };
    let seed: u64 = seed.parse()?;
    let dataset = Dataset::open(folder)?;
    let config = ReconstructionConfig::default();
    let device = CpuDevice::new(OptimizerConfig::default(), RasterConfig::default(), &config.empty_field())?;
    let range = dataset.db_range().ok_or("give a data set with spectra")?;
    let (light, radio) = (dataset.light_camera(), dataset.radio_camera());
    let mut reconstructor = Reconstructor::new(Box::new(device), config.clone(), light, radio, range, seed)?;
    let (mut held_out, mut train) = (vec![], vec![]);
    let begin = processor_s();
    for index in 0..dataset.len() {
        match index % 8 {
            0 => {}
            4 => held_out.push(dataset.keyframe(index)?),
            _ => {
                let keyframe = dataset.keyframe(index)?;
                train.push(keyframe.clone());
                reconstructor.push(&keyframe)?;
            }
        }
    }
    reconstructor.finish(&mut |_, _| ControlFlow::Continue(()))?;
    println!("online: {:.1} s of processor, {} Gaussians", processor_s() - begin, reconstructor.gaussian_count());
    let (device, schedule, config, meta) = reconstructor.experiment();
    let weights = StageWeights { light: 1.0, radio: config.radio_weight, depth: true, geometry: true };
    let config = ReconstructionConfig { finest_share: Some(1.0), ..config.clone() };
    let meta = *meta;
    let e = evaluate(device, &meta, &held_out)?;
    let t = evaluate(device, &meta, &train[..6])?;
    println!("before: light {:.3} rf_db {:.3} rf_jet {:.3} | train {:.3} {:.3} {:.3}", e[0], e[1], e[2], t[0], t[1], t[2]);
    let device = device.as_cpu().ok_or("the processor")?;
    let (snapshot, fresh, rates) = (device.x_snapshot(), schedule.clone(), *device.x_optimizer());
    for variant in variants {
        let mut words = variant.split(',');
        let kind = words.next().unwrap_or_default();
        let options = Options(words.filter_map(|w| w.split_once('=')).map(|(a, b)| (a.to_owned(), b.to_owned())).collect());
        device.x_restore(&snapshot);
        *device.x_optimizer() = rates;
        device.take_stage_times();
        let mut schedule: Schedule = fresh.clone();
        let task = Task { meta, config: config.clone(), weights, held_out: &held_out, train: &train[..6], label: variant.clone() };
        match kind {
            "lm" => lm(device, &mut schedule, &task, &options, seed)?,
            "adam" => adam(device, &mut schedule, &task, &options, rates, seed)?,
            other => return Err(format!("{other}?").into()),
        }
        if options.get("times", 0.0) > 0.0 {
            println!("{:?}", device.take_stage_times());
        }
    }
    Ok(())
}

fn report(task: &Task<'_>, at: usize, spent: f64, device: &mut CpuDevice) -> Fallible<()> {
    let e = evaluate(device, &task.meta, task.held_out)?;
    let t = evaluate(device, &task.meta, task.train)?;
    println!("{:40} {at:4} {spent:7.2} s  light {:.3} rf_db {:.3} rf_jet {:.3} | train {:.3} {:.3} {:.3}", task.label, e[0], e[1], e[2], t[0], t[1], t[2]);
    Ok(())
}

/// Adam with n epochs: rates fall from `from` to `to` of theirs; `share` and `rshare` of the tiles; `half` of the epochs at half resolution.
fn adam(device: &mut CpuDevice, schedule: &mut Schedule, task: &Task<'_>, o: &Options, rates: OptimizerConfig, seed: u64) -> Fallible<()> {
    let n = o.get("n", 75.0) as usize;
    let (from, to) = (o.get("from", 1.0), o.get("to", 1.0));
    let share = [o.get("share", 1.0) as f32, o.get("rshare", o.get("share", 1.0)) as f32];
    let mut sampler = Sampler::new(share, o.get("unbiased", 1.0) > 0.0, o.get("uniform", 0.2) as f32, seed);
    let coarse = (o.get("half", 0.0) * n as f64) as usize;
    let shape = o.get("shape", 0.0);
    let b1 = o.get("b1", f64::from(rates.beta1)) as f32;
    let b2 = o.get("b2", f64::from(rates.beta2)) as f32;
    let mut spent = 0.0;
    for epoch in 0..n {
        let begin = processor_s();
        let steps = schedule.epoch(task.weights, &task.config);
        let count = steps.len();
        for (k, step) in steps.iter().enumerate() {
            let t = (epoch * count + k) as f64 / (n * count) as f64;
            // 0: geometric, 1: linear, 2: half a cosine.
            let s = match shape as usize {
                0 => from * (to / from).powf(t),
                1 => from + (to - from) * t,
                _ => to + (from - to) * 0.5 * (1.0 + (std::f64::consts::PI * t).cos()),
            } as f32;
            let c = device.x_optimizer();
            *c = rates;
            c.beta1 = b1;
            c.beta2 = b2;
            c.position_rate_m *= s;
            c.log_scale_rate *= s;
            c.rotation_rate *= s;
            for a in [&mut c.light, &mut c.radio] {
                a.sh_dc *= s;
                a.opacity *= s;
            }
            let mut step = *step;
            if epoch < coarse {
                step.levels = [1, if o.get("halfradio", 0.0) > 0.0 { 1 } else { 0 }];
            }
            if share == [1.0; 2] {
                device.train(&[step])?;
            } else {
                device.x_sampled(&mut sampler, &step)?;
            }
        }
        spent += processor_s() - begin;
        let done = epoch + 1;
        let every = o.get("every", 0.0) as usize;
        if done == n || [5, 10, 20, 40, 75].contains(&done) || (every > 0 && done % every == 0) {
            report(task, done, spent, device)?;
        }
    }
    Ok(())
}

/// Levenberg–Marquardt: n passes over all keyframes in batches of `batch`.
fn lm(device: &mut CpuDevice, schedule: &mut Schedule, task: &Task<'_>, o: &Options, seed: u64) -> Fallible<()> {
    let objective = match o.get("objective", 0.0) as usize {
        0 => Objective::Square,
        1 => Objective::Huber(o.get("delta", 0.01) as f32),
        _ => Objective::Image(o.get("delta", 0.01) as f32),
    };
    let config = GaussNewtonConfig {
        objective,
        iterations: o.get("cg", 6.0) as usize,
        memory: o.get("memory", 0.7) as f32,
        probes: o.get("probes", 1.0) as usize,
        trust: o.get("trust", 20.0) as f32,
        floor: o.get("floor", 0.01) as f32,
        adapt: o.get("adapt", 1.0) > 0.0,
    };
    let mut state = GaussNewton::new(config, o.get("lambda", 0.1) as f32);
    let share = o.get("share", 1.0) as f32;
    let unbiased = o.get("unbiased", 1.0) > 0.0;
    let mut sampler = Sampler::new([share; 2], unbiased, o.get("uniform", 0.2) as f32, seed);
    let n = o.get("n", 5.0) as usize;
    let batch = o.get("batch", 8.0) as usize;
    // Adam's epochs before, at rates that fall.
    let mut spent = 0.0;
    let (mut queue, mut done) = (vec![], 0);
    let first = schedule.epoch(task.weights, &task.config);
    let a = device.x_adjoint(&first[0], 1)?;
    println!("adjoint: {:.6e} {:.6e}, off by {:.1e}", a[0], a[1], (a[0] / a[1] - 1.0).abs());
    while done < n {
        let begin = processor_s();
        while queue.len() < batch {
            queue.extend(schedule.epoch(task.weights, &task.config));
        }
        let mut steps: Vec<_> = queue.drain(..batch).collect();
        for step in &mut steps {
            step.depth_weight = 0.0;
        }
        let weights = if share < 1.0 { device.x_tile_weights(&mut sampler, &steps)? } else { vec![] };
        let [before, after] = device.x_gauss_newton(&mut state, &steps, &weights)?;
        spent += processor_s() - begin;
        done += 1;
        if o.get("verbose", 0.0) > 0.0 {
            println!("  {done}: {before:.6} to {after:.6}, ratio {:.2}, lambda {:.1e}", state.ratio, state.lambda);
        }
        let every = o.get("every", 0.0) as usize;
        if done == n || (every > 0 && done % every == 0) {
            report(task, done, spent, device)?;
        }
    }
    println!("  {} accepted, {} rejected, lambda {:.1e}", state.accepted, state.rejected, state.lambda);
    Ok(())
}
