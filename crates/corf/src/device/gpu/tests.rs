//! Tests of faults that cannot be provoked from outside: adapters that bind little, that run out of memory, that go away.

#![allow(clippy::unwrap_used)]

use super::*;
use crate::device::{DenseStep, Planes, View};
use corf_scene::{Pinhole, Rigid3, Rng};
use testing::OPTIONS;

const CAMERA: Pinhole = Pinhole { width: 40, height: 24, fx: 20.0, fy: 20.0, cx: 20.0, cy: 12.0 };

/// A cloud in front of a camera at the origin.
fn cloud(n: usize) -> Gaussians {
    let mut rng = Rng::keyed(1, 0, 0);
    let mut g = Gaussians::empty(3, 1);
    for _ in 0..n {
        g.position.push([rng.uniform() - 0.5, rng.uniform() - 0.5, 2.0 + rng.uniform()]);
        g.rotation.push([1.0, 0.0, 0.0, 0.0]);
        g.log_scale.push([-2.0; 3]);
        for a in [&mut g.light, &mut g.radio] {
            a.opacity_logit.push(0.0);
            let stride = a.stride();
            a.sh.extend((0..stride).map(|_| 0.2 * rng.normal() as f32));
        }
    }
    g
}

/// A device with one view of gray, or nothing where there is no adapter.
fn device(n: usize) -> Option<GpuDevice> {
    device_on(&OPTIONS, n)
}

fn device_on(options: &GpuOptions, n: usize) -> Option<GpuDevice> {
    corf_gpu::testing::context(&options.adapter)?;
    let mut device = GpuDevice::new(options, OptimizerConfig::default(), RasterConfig::default(), &cloud(n)).unwrap();
    let gray =
        Planes { width: CAMERA.width, height: CAMERA.height, channels: 3, pixels: vec![0.5; 3 * CAMERA.width * CAMERA.height] };
    let view = TrainingView {
        world_from_camera: Rigid3::IDENTITY,
        light_camera: CAMERA,
        light: gray.clone(),
        radio_camera: CAMERA,
        radio: gray,
        inverse_depth: None,
        mask: None,
    };
    device.upload(&view, 1).unwrap();
    Some(device)
}

fn step() -> Step {
    Step {
        view: ViewId(0),
        levels: [0; 2],
        light_weight: 1.0,
        radio_weight: 1.0,
        depth_weight: 0.0,
        train_geometry: true,
        light_background: [0.0; 3],
        radio_background: [0.0; 3],
    }
}

fn request() -> RenderRequest {
    let view = View { camera: CAMERA, world_from_camera: Rigid3::IDENTITY };
    RenderRequest { light: Some((view, [0.0; 3])), radio: None, main_contributor: false }
}

/// There is hardly any room at first, so that steps are submitted again.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_step_is_timed_once_also_where_it_is_submitted_again() {
    let options = GpuOptions { adapter: AdapterOptions { timestamps: true, ..OPTIONS.adapter }, ..OPTIONS };
    let Some(mut device) = device_on(&options, 2000) else { return };
    let spectrum_alone = Step { light_weight: 0.0, ..step() };
    device.train(&[step(), spectrum_alone, step(), spectrum_alone, step()]).unwrap();
    let times = device.take_training_times().unwrap();
    assert_eq!(times.is_some(), device.context.timestamps);
    let Some(times) = times else { return };
    assert!(times.repeated > 0 && times.batches == 1, "{times:?}");
    let counts: Vec<_> = times.frames.iter().map(|f| (f.light, f.radio, f.steps)).collect();
    assert_eq!(counts, [([0, 0], [40, 24], 2), ([40, 24], [40, 24], 3)]);
    for frame in &times.frames {
        let names: Vec<&str> = frame.kernels.iter().map(|k| k.0.as_str()).collect();
        assert_eq!(names, STAGES);
        assert!(frame.kernels.iter().all(|k| k.1 >= 0.0) && frame.kernels.iter().any(|k| k.1 > 0.0), "{frame:?}");
    }
    assert!(times.table().contains("40x24 + 40x24") && times.table().contains("0x0 + 40x24"), "{}", times.table());
    assert!(device.take_training_times().unwrap().unwrap().frames.is_empty(), "they are said once");
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn what_an_adapter_does_not_bind_is_named_and_the_device_works_on() {
    let Some(mut device) = device(2000) else { return };
    let before = device.gaussians().unwrap();
    let limit = device.context.limits.max_storage_buffer_binding_size;
    std::sync::Arc::get_mut(&mut device.context).unwrap().limits.max_storage_buffer_binding_size = 64 << 10;
    let text = device.train(&[step()]).unwrap_err().to_string();
    assert!(text.contains("binds at most") && text.contains("--device cpu"), "{text}");
    assert!(device.gaussians().unwrap() == before, "a step without memory changes nothing");
    std::sync::Arc::get_mut(&mut device.context).unwrap().limits.max_storage_buffer_binding_size = limit;
    device.train(&[step()]).unwrap();
    assert!(device.gaussians().unwrap() != before);
}

/// Checkpoints take most of a step's memory: 144 bytes a pair here, 80 of them in their heads; records take 64, half of them in their heads.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn checkpoints_may_be_larger_than_what_an_adapter_binds_at_once() {
    let Some(mut free) = device(2000) else { return };
    free.train(&[step(); 2]).unwrap();
    let (room, needed) = (free.memory.room.pairs, free.pairs());
    assert!(room > needed + needed / 20, "{room} of {needed}");
    // Heads alone fit; they do without the room to spare. Adapters' limits are no multiples of anything.
    for most in [100 * room, 80 * (needed + needed / 50) + 79] {
        let mut limited = device(2000).unwrap();
        std::sync::Arc::get_mut(&mut limited.context).unwrap().limits.max_storage_buffer_binding_size = most as u64;
        limited.train(&[step(); 2]).unwrap();
        let m = &limited.memory;
        let sizes = [&m.checkpoint_heads, &m.checkpoint_tails, &m.record_heads, &m.record_tails].map(|part| part.buffer.size());
        assert!(sizes.iter().all(|size| *size <= most as u64) && sizes[0] + sizes[1] > most as u64, "{sizes:?} of {most}");
        assert!(m.room.pairs >= needed && m.room.pairs <= room, "{} of {room}", m.room.pairs);
        assert!(limited.state().unwrap() == free.state().unwrap());
        // Pictures may have had room for more pairs than steps can.
        limited.memory.room.pairs = most / 32;
        limited.train(&[step()]).unwrap();
    }
}

/// Heads of one image's records take 32 bytes a pair, of both images' checkpoints 40 on tiles of 8x8; small tiles make more pairs.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_step_that_has_no_room_with_small_tiles_takes_larger_ones() {
    let mut wide = cloud(300);
    wide.log_scale.fill([-0.7; 3]);
    let of = |tile| {
        let mut device = device_on(&GpuOptions { tile, batch: 32, ..OPTIONS }, 0)?;
        device.append(&wide).unwrap();
        Some(device)
    };
    let limit = |device: &mut GpuDevice, bytes: u64| {
        std::sync::Arc::get_mut(&mut device.context).unwrap().limits.max_storage_buffer_binding_size = bytes;
    };
    let radio = Step { light_weight: 0.0, ..step() };
    let dense = DenseStep { step: radio, number: 1, position_rate_m: 1e-3, degree: 0, screen_gradients: true };
    let sparse = |device: &mut GpuDevice, step: Step, portion: usize| {
        [step; 3].chunks(portion).try_for_each(|some| device.train(some).map(drop))
    };
    type Way<'a> = &'a dyn Fn(&mut GpuDevice, usize) -> Result<()>;
    let ways: [(Way<'_>, u64); 3] = [
        (&|device, portion| sparse(device, radio, portion), 32),
        (&|device, portion| sparse(device, step(), portion), 40),
        (&|device, portion| [dense; 3].chunks(portion).try_for_each(|some| device.train_dense(some).map(drop)), 32),
    ];
    for (train, bytes) in ways {
        let (Some(mut small), Some(mut large)) = (of(None), of(Some([8, 8]))) else { return };
        train(&mut small, 3).unwrap();
        train(&mut large, 3).unwrap();
        let (many, few) = (32 * small.pairs() as u64, bytes * large.pairs() as u64);
        assert!(small.last.shape == 1 && many > few + few / 50, "{many} and {few}");
        // Together or one by one.
        for portion in [3, 1] {
            let mut limited = of(None).unwrap();
            limit(&mut limited, few + few / 100);
            train(&mut limited, portion).unwrap();
            assert!(limited.last.shape == 0 && limited.state().unwrap() == large.state().unwrap());
            // What does not fit with those tiles either is refused.
            limit(&mut limited, few - few / 10);
            let text = train(&mut limited, portion).unwrap_err().to_string();
            assert!(text.contains("binds at most"), "{text}");
        }
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn rows_are_the_same_gathered_in_pieces_or_at_once() {
    let (Some(mut whole), Some(mut pieces)) = (device(1500), device(1500)) else { return };
    let keep: Vec<bool> = (0..1500).map(|i| i % 7 != 3 && i > 20).collect();
    for (device, most) in [(&mut whole, u64::MAX), (&mut pieces, 32 << 10)] {
        device.train(&[step(); 3]).unwrap();
        let limits = &mut std::sync::Arc::get_mut(&mut device.context).unwrap().limits;
        limits.max_storage_buffer_binding_size = limits.max_storage_buffer_binding_size.min(most);
        device.retain(&keep).unwrap();
    }
    let (whole, pieces) = (whole.state().unwrap(), pieces.state().unwrap());
    assert!(whole == pieces && whole.position_rate.len() == keep.iter().filter(|k| **k).count());
    assert!(whole.moments.iter().all(|m| m.light.sh.iter().chain(&m.radio.sh).any(|v| *v != 0.0)));
}

/// The numbers of Gaussians for which the adapter binds every array: moments of harmonics take most, twice twelve words a Gaussian.
fn limit_to(device: &mut GpuDevice, gaussians: u64) {
    std::sync::Arc::get_mut(&mut device.context).unwrap().limits.max_storage_buffer_binding_size = 96 * gaussians + 20;
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn growth_takes_the_room_that_there_is_and_no_more() {
    let (Some(mut device), Some(mut free)) = (device(1000), device(1000)) else { return };
    device.train(&[step(); 2]).unwrap();
    free.train(&[step(); 2]).unwrap();
    // Half as much again would be 1500.
    limit_to(&mut device, 1100);
    for _ in 0..2 {
        device.append(&cloud(50)).unwrap();
        free.append(&cloud(50)).unwrap();
    }
    device.duplicate(&[]).unwrap();
    assert!(device.state().unwrap() == free.state().unwrap());
    let text = device.append(&cloud(1)).unwrap_err().to_string();
    assert!(text.contains("binds at most") && text.contains("ask for less at once"), "{text}");
    assert_eq!(device.len(), 1100);
    assert!(device.state().unwrap() == free.state().unwrap(), "what is refused changes nothing");
    // Gone on with from a checkpoint, which takes exactly what it has.
    let state = free.state().unwrap();
    let mut none = GpuDevice::new(&OPTIONS, OptimizerConfig::default(), RasterConfig::default(), &cloud(0)).unwrap();
    limit_to(&mut none, 1200);
    none.restore(&state).unwrap();
    let copies: Vec<Duplicate> = (0..100).map(|source| Duplicate { source, offset: [0.0; 3], shrink: 1.0 }).collect();
    none.duplicate(&copies).unwrap();
    assert_eq!(none.len(), 1200);
    assert!(none.append(&cloud(1)).is_err() && none.len() == 1200);
    // The room given back is room.
    none.retain(&(0..1200).map(|i| i < 1150).collect::<Vec<_>>()).unwrap();
    none.append(&cloud(50)).unwrap();
    assert_eq!(none.gaussians().unwrap().len(), 1200);
}

/// Memory for half as much again may not be there where memory for what is needed is.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn growth_does_with_what_memory_there_is() {
    let Some(mut device) = device(1000) else { return };
    let before = device.gaussians().unwrap();
    let allow = |device: &GpuDevice, gaussians: u64| {
        device.context.limit_allocations(96 * gaussians);
    };
    allow(&device, 1200);
    device.append(&cloud(100)).unwrap();
    assert_eq!(device.len(), 1100);
    let text = device.append(&cloud(200)).unwrap_err().to_string();
    assert!(text.contains("out of memory"), "{text}");
    allow(&device, u64::MAX / 96);
    let after = device.gaussians().unwrap();
    assert!(after.len() == 1100 && after.position[..1000] == before.position[..]);
    // An error from before is not taken for want of memory.
    device.context.pretend_out_of_memory();
    assert!(device.append(&cloud(600)).is_err() && device.len() == 1100);
}

/// What is guessed at first is no reason to refuse what fits.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_guess_of_what_a_frame_needs_is_within_what_an_adapter_binds() {
    let Some(mut free) = device(300) else { return };
    free.train(&[step()]).unwrap();
    let needed = free.pairs() as u64;
    // A step keeps up to 80 bytes a pair in one array; a guess for so many Gaussians that nobody sees would be for as many pairs.
    let mut far = cloud(20_000);
    far.position.iter_mut().for_each(|p| p[2] = -5.0);
    let mut limited = device(300).unwrap();
    limited.append(&far).unwrap();
    let most = (80 * (needed + needed / 8)).max(96 * 20_300 + 20);
    std::sync::Arc::get_mut(&mut limited.context).unwrap().limits.max_storage_buffer_binding_size = most;
    limited.least_room = 1 << 16;
    limited.train(&[step()]).unwrap();
    limited.render(&request()).unwrap();
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_device_out_of_memory_says_so_and_works_on() {
    let Some(mut device) = device(100) else { return };
    device.context.pretend_out_of_memory();
    let text = device.train(&[step()]).unwrap_err().to_string();
    assert!(text.contains("out of memory") && text.contains("--device cpu"), "{text}");
    device.train(&[step()]).unwrap();
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_lost_device_says_so_whatever_is_asked_of_it() {
    let Some(mut device) = device(100) else { return };
    device.train(&[step()]).unwrap();
    device.context.device.destroy();
    let lost = |text: String| assert!(text.contains("the device was lost") && text.contains("--resume"), "{text}");
    lost(device.train(&[step()]).unwrap_err().to_string());
    lost(device.render(&request()).unwrap_err().to_string());
    lost(device.gaussians().unwrap_err().to_string());
    lost(device.append(&cloud(3)).unwrap_err().to_string());
    lost(device.retain(&[false; 100]).unwrap_err().to_string());
    lost(device.reset_radio(&cloud(100).radio).unwrap_err().to_string());
    lost(device.outlines().unwrap_err().to_string());
    lost(device.state().unwrap_err().to_string());
    assert_eq!(device.len(), 100, "what an error says is not done is not done");
}

/// A field that cannot be read back is no empty field, and the device that could not holds it still.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn gaussians_that_cannot_be_read_back_are_an_error() {
    let Some(mut device) = device(100) else { return };
    let before = device.gaussians().unwrap();
    device.context.pretend_out_of_memory();
    let text = device.gaussians().unwrap_err().to_string();
    assert!(text.contains("reading Gaussians back") && text.contains("out of memory") && text.contains("--device cpu"), "{text}");
    assert!(device.gaussians().unwrap() == before && before.len() == 100);
}

/// Steps that were begun and came to nothing are nothing that a later call can go on from, whoever asks first.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn steps_that_were_begun_in_vain_are_told_to_everybody() {
    let Some(mut device) = device(100) else { return };
    device.begin_training(&[step(); 3]).unwrap();
    device.context.pretend_out_of_memory();
    let text = device.gaussians().unwrap_err().to_string();
    assert!(text.contains("training") && text.contains("out of memory"), "{text}");
    for again in [device.end_training().map(|_| ()), device.train(&[step()]).map(|_| ()), device.render(&request()).map(|_| ())] {
        assert_eq!(again.unwrap_err().to_string(), text);
    }
}
