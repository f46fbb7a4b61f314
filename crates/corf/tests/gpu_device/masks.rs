//! Pixels that do not count.

use crate::support::{OPTIONS, bits, compare_gradients, metric_rates, one_camera, open, room, step, training_view};
use corf::{
    Antialias, CpuDevice, Device, OptimizerConfig, RasterConfig,
    device::{Step, TrainingView, gpu::GpuOptions},
};
use corf_scene::Raster;

/// A view of which a block at the border and scattered pixels do not count.
fn masked(view: TrainingView) -> TrainingView {
    let (w, h) = (view.light_camera.width, view.light_camera.height);
    let mask = Raster::from_fn(w, h, |x, y| (x < 90 || y > 50) && (5 * x + 3 * y) % 101 != 0);
    TrainingView { mask: Some(mask), ..view }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn gradients_agree_where_pixels_do_not_count() {
    for (radio_channels, antialias) in [(3, Antialias::On), (1, Antialias::Detached)] {
        let raster = RasterConfig { antialias, ..RasterConfig::default() };
        let g = room(16, 2500, radio_channels, [1, 2]);
        let options = GpuOptions { tile: Some([8, 8]), ..OPTIONS };
        let Some(mut gpu) = open(&options, OptimizerConfig::default(), raster, &g) else { return };
        let mut cpu = CpuDevice::new(OptimizerConfig::default(), raster, &g).unwrap();
        // Of bytes, of floats, and with both images of one camera, which are drawn at once.
        let views = [training_view(0, radio_channels, true), training_view(1, radio_channels, false), one_camera(radio_channels)];
        for view in views.map(masked) {
            let id = gpu.upload(&view, 3).unwrap();
            assert_eq!(cpu.upload(&view, 3).unwrap(), id);
            let light = Step { radio_weight: 0.0, ..step(id.0, 0) };
            let radio = Step { light_weight: 0.0, depth_weight: 0.0, ..step(id.0, 0) };
            for s in [step(id.0, 0), step(id.0, 1), step(id.0, 2), light, radio] {
                compare_gradients(&mut cpu, &mut gpu, &s);
            }
        }
    }
}

/// Keyframes with and without masks take turns in a batch, and leave the device in between.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn masks_travel_with_their_keyframes() {
    let g = room(17, 400, 3, [0, 0]);
    let views: Vec<TrainingView> =
        (0..6).map(|k| training_view(k, 3, k != 4)).enumerate().map(|(k, v)| if k % 2 == 0 { masked(v) } else { v }).collect();
    let steps: Vec<Step> = (0..30).map(|i| step((7 * i * i + i) % 6, (i % 3) as u32)).collect();
    let run = |keyframe_bytes: u64, batch: usize| {
        let options = GpuOptions { keyframe_bytes, tile: Some([8, 8]), ..OPTIONS };
        let mut d = open(&options, metric_rates(), RasterConfig::default(), &g)?;
        let pack = d.packer().unwrap();
        views.iter().for_each(|view| assert!(d.upload_packed(pack(view, 3).unwrap()).is_ok()));
        steps.chunks(batch).for_each(|some| assert!(d.train(some).is_ok()));
        Some((bits(&d.gaussians().unwrap()), d.keyframe_bytes()))
    };
    let Some((whole, [all, _])) = run(u64::MAX, 30) else { return };
    assert!(run(u64::MAX, 1).unwrap().0 == whole, "one by one");
    let (bounded, [_, came]) = run(all / 2, 30).unwrap();
    assert!(bounded == whole && came > 0, "half of them in main memory");
}
