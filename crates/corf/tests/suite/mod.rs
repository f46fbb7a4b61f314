//! What holds of every device, tested on each: blending, clamps, the optimiser, bookkeeping, bad input.

use corf::{
    Antialias, AppearanceRates, Device, Gaussians, OptimizerConfig, RasterConfig, Result,
    device::{InverseDepth, Planes, RenderRequest, Step, StepReport, TrainingView, View, ViewId},
    gaussians::{SH_C0, logit},
    loss::psnr_8bit,
};
use corf_scene::{Pinhole, Raster, Rigid3, Rng};
use glam::DVec3;

/// A device whose gradients can be read.
pub trait Tested: Device {
    /// Losses and gradients of a step that is not taken.
    fn gradients_of(&mut self, step: &Step) -> Result<(StepReport, Gaussians)>;
}

pub type Opened = Box<dyn Tested>;
/// Opens a device that holds these Gaussians.
pub type Make = fn(OptimizerConfig, RasterConfig, &Gaussians) -> Result<Opened>;

/// Each of the suite's tests as a test of the device that `$make` opens.
macro_rules! suite_on {
    ($make:path, $attribute:meta) => {
        suite_on! { @each $make, $attribute,
            nothing_shows_the_background_alone
            a_wide_gaussian_blends_its_colour_over_the_background_by_its_opacity
            the_nearer_gaussian_hides_the_farther_whatever_their_order
            antialiasing_keeps_the_light_of_a_gaussian_thinner_than_a_pixel
            one_image_is_learnt
            frozen_geometry_and_unweighted_modalities_stay_as_they_are_with_their_moments
            the_first_step_of_adam_is_its_closed_form
            clamps_pass_no_gradient
            retained_gaussians_keep_their_optimiser_state_and_appended_ones_start_fresh
            resetting_radio_replaces_it_and_leaves_the_rest
            hopeless_gaussians_do_no_harm
            a_mask_that_leaves_nothing_out_changes_no_byte
            bad_input_is_named
        }
    };
    (@each $make:path, $attribute:meta, $($name:ident)*) => {
        $(
            #[test]
            #[$attribute]
            fn $name() {
                suite::$name($make);
            }
        )*
    };
}

fn camera() -> Pinhole {
    Pinhole { width: 37, height: 29, fx: 30.0, fy: 30.0, cx: 18.5, cy: 14.5 }
}

fn view() -> View {
    View { camera: camera(), world_from_camera: Rigid3::IDENTITY }
}

pub fn light(background: [f32; 3]) -> RenderRequest {
    RenderRequest { light: Some((view(), background)), radio: None, main_contributor: true }
}

/// Round Gaussians of given position, deviation (m), opacity and colour, alike in both modalities.
fn field(list: &[([f32; 3], f32, f32, [f32; 3])]) -> Gaussians {
    let mut g = Gaussians::empty(3, 0);
    for (position, deviation, opacity, color) in list {
        g.position.push(*position);
        g.rotation.push([1.0, 0.0, 0.0, 0.0]);
        g.log_scale.push([deviation.ln(); 3]);
        for a in [&mut g.light, &mut g.radio] {
            a.opacity_logit.push(logit(*opacity));
            a.sh.extend(color.map(|c| (c - 0.5) / SH_C0));
        }
    }
    g
}

fn plain(make: Make, gaussians: &Gaussians) -> Opened {
    make(OptimizerConfig::default(), RasterConfig::default(), gaussians).unwrap()
}

fn pixel(image: &Planes, x: usize, y: usize) -> [f32; 3] {
    let i = (y * image.width + x) * 3;
    [image.pixels[i], image.pixels[i + 1], image.pixels[i + 2]]
}

/// f32 arithmetic on numbers near 1.
const ROUNDING: f32 = 2e-6;

pub fn nothing_shows_the_background_alone(make: Make) {
    let mut empty = plain(make, &Gaussians::empty(3, 2));
    let behind = field(&[([0.0, 0.0, -2.0], 0.3, 0.9, [1.0, 0.0, 0.0]), ([50.0, 0.0, 2.0], 0.3, 0.9, [1.0, 0.0, 0.0])]);
    for device in [&mut empty, &mut plain(make, &behind)] {
        let out = device.render(&light([0.25, 0.5, 0.75])).unwrap();
        let layer = out.light.unwrap();
        assert!(layer.color.pixels.chunks(3).all(|p| p == [0.25, 0.5, 0.75]));
        assert!(layer.transmittance.pixels().iter().all(|t| *t == 1.0));
        assert!(layer.inverse_depth.pixels().iter().all(|d| *d == 0.0));
        assert!(out.main_contributor.unwrap().pixels().iter().all(|m| *m == u32::MAX));
    }
}

pub fn a_wide_gaussian_blends_its_colour_over_the_background_by_its_opacity(make: Make) {
    // 20 m wide at 2 m: flat over the image. The centre pixel's centre is the mean itself.
    let mut d = plain(make, &field(&[([0.0, 0.0, 2.0], 20.0, 0.6, [0.9, 0.3, 0.1])]));
    let layer = d.render(&light([0.0, 1.0, 0.5])).unwrap().light.unwrap();
    for (c, (front, back)) in [(0.9, 0.0), (0.3, 1.0), (0.1, 0.5)].into_iter().enumerate() {
        assert!((pixel(&layer.color, 18, 14)[c] - (0.6 * front + 0.4 * back)).abs() < ROUNDING * 10.0);
    }
    assert!((layer.transmittance[(18, 14)] - 0.4).abs() < ROUNDING * 10.0);
    assert!((layer.inverse_depth[(18, 14)] - 0.6 / 2.0).abs() < ROUNDING * 10.0);
}

pub fn the_nearer_gaussian_hides_the_farther_whatever_their_order(make: Make) {
    let near = ([0.0, 0.0, 2.0], 5.0, 0.9995, [1.0, 0.0, 0.0]);
    let far = ([0.0, 0.0, 4.0], 5.0, 0.9995, [0.0, 1.0, 0.0]);
    let mut images = vec![];
    for (list, nearest) in [([near, far], 0), ([far, near], 1)] {
        let out = plain(make, &field(&list)).render(&light([0.0; 3])).unwrap();
        let layer = out.light.unwrap();
        assert_eq!(out.main_contributor.unwrap()[(18, 14)], nearest);
        // No Gaussian hides more than 0.999.
        assert!((pixel(&layer.color, 18, 14)[0] - 0.999).abs() < ROUNDING);
        assert!((pixel(&layer.color, 18, 14)[1] - 0.001 * 0.999).abs() < ROUNDING);
        images.push(layer.color);
    }
    assert_eq!(images[0], images[1]);
}

pub fn antialiasing_keeps_the_light_of_a_gaussian_thinner_than_a_pixel(make: Make) {
    // Σ α is opacity · 2π sqrt(det S₂) whatever h: a fourth of the area, a fourth of the light. Averaged over 4×4 places within a pixel
    // (0.1 m), so that the grid's own sampling of a Gaussian of 0.4 px does not count; tails below 1/255 lose some per cent.
    let light = |deviation_px: f32, antialias: Antialias| {
        let raster = RasterConfig { antialias, ..RasterConfig::default() };
        let places = (0..16).map(|i| [(i % 4) as f32 * 0.025, (i / 4) as f32 * 0.025]);
        let sums = places.map(|[x, y]| {
            let g = field(&[([x, y, 3.0], deviation_px * 0.1, 0.9, [1.0; 3])]);
            let mut d = make(OptimizerConfig::default(), raster, &g).unwrap();
            let layer = d.render(&light([0.0; 3])).unwrap().light.unwrap();
            layer.transmittance.pixels().iter().map(|t| 1.0 - t).sum::<f32>()
        });
        sums.sum::<f32>()
    };
    let ratio = light(0.5, Antialias::On) / light(0.25, Antialias::On);
    assert!((ratio - 4.0).abs() < 0.2, "{ratio}");
    let grown = light(0.5, Antialias::Off) / light(0.25, Antialias::Off);
    assert!(grown < 2.0, "without the factor the small one is drawn too bright: {grown}");
}

pub fn training_view(radio_channels: usize, seed: u64) -> TrainingView {
    let mut rng = Rng::keyed(seed, 0, 0);
    let radio_camera = Pinhole { width: 21, height: 13, fx: 15.0, fy: 15.0, cx: 10.0, cy: 7.0 };
    let mut smooth = |camera: &Pinhole, channels: usize| {
        let phase: Vec<f32> = (0..3 * channels).map(|_| rng.uniform() * 6.0).collect();
        let mut pixels = vec![];
        for y in 0..camera.height {
            for x in 0..camera.width {
                for c in 0..channels {
                    let (a, b) = (x as f32 / camera.width as f32, y as f32 / camera.height as f32);
                    pixels.push(0.5 + 0.2 * (7.0 * a + phase[3 * c]).sin() + 0.2 * (9.0 * b + phase[3 * c + 1] + 4.0 * a).cos());
                }
            }
        }
        Planes { width: camera.width, height: camera.height, channels, pixels }
    };
    TrainingView {
        world_from_camera: Rigid3::looking_at(DVec3::new(0.1, 0.0, 0.0), DVec3::new(0.0, 0.1, 3.0), DVec3::new(0.0, -1.0, 0.0)),
        light: smooth(&camera(), 3),
        light_camera: camera(),
        radio: smooth(&radio_camera, radio_channels),
        radio_camera,
        inverse_depth: Some(InverseDepth {
            value: Raster::filled(37, 29, 0.35),
            confidence: Raster::from_fn(37, 29, |x, _| if x % 3 == 0 { 0.0 } else { 0.8 }),
        }),
        mask: None,
    }
}

/// A wall of Gaussians 3 m away, wider than the image; numbers beyond a chunk of any plausible size.
pub fn wall(n: usize, radio_channels: usize, degree: usize) -> Gaussians {
    let mut rng = Rng::keyed(9, 0, 0);
    let mut g = Gaussians::empty(radio_channels, degree);
    for _ in 0..n {
        g.position.push([(rng.uniform() - 0.5) * 6.0, (rng.uniform() - 0.5) * 5.0, 2.8 + 0.4 * rng.uniform()]);
        g.rotation.push([0; 4].map(|_| rng.normal() as f32));
        g.log_scale.push([0; 3].map(|_| 0.08_f32.ln() + 0.5 * rng.uniform()));
        for a in [&mut g.light, &mut g.radio] {
            a.opacity_logit.push(logit(0.3));
            a.sh.extend((0..a.stride()).map(|_| (rng.uniform() - 0.5) * 0.1));
        }
    }
    g
}

pub fn step(level: u32) -> Step {
    Step {
        view: ViewId(0),
        levels: [level; 2],
        light_weight: 1.0,
        radio_weight: 0.1,
        depth_weight: 0.01,
        train_geometry: true,
        light_background: [0.3, 0.6, 0.1],
        radio_background: [0.0, 0.0, 0.5],
    }
}

pub fn metric_rates() -> OptimizerConfig {
    OptimizerConfig { position_rate_m: 1e-3, ..OptimizerConfig::default() }
}

pub fn one_image_is_learnt(make: Make) {
    let target = training_view(1, 4);
    let mut d = make(metric_rates(), RasterConfig::default(), &wall(900, 1, 0)).unwrap();
    d.upload(&target, 1).unwrap();
    let quality = |d: &mut Opened| {
        let request = RenderRequest {
            light: Some((
                View { camera: target.light_camera, world_from_camera: target.world_from_camera },
                step(0).light_background,
            )),
            radio: Some((
                View { camera: target.radio_camera, world_from_camera: target.world_from_camera },
                step(0).radio_background,
            )),
            main_contributor: false,
        };
        let out = d.render(&request).unwrap();
        [psnr_8bit(&out.light.unwrap().color, &target.light), psnr_8bit(&out.radio.unwrap().color, &target.radio)]
    };
    let before = quality(&mut d);
    let mut losses = vec![];
    for _ in 0..8 {
        let r = d.train(&[step(0); 60]).unwrap();
        losses.push(r.light_loss + 0.1 * r.radio_loss);
    }
    let after = quality(&mut d);
    // Adam with a fixed rate wanders by some per cent of the loss near the end.
    assert!(losses.windows(2).all(|w| w[1] < w[0] * 1.1), "{losses:?}");
    assert!(losses[7] < 0.5 * losses[0], "{losses:?}");
    assert!(before[0] < 25.0 && after[0] > 30.0, "optical {before:?} -> {after:?} dB");
    assert!(before[1] < 25.0 && after[1] > 30.0, "RF {before:?} -> {after:?} dB");
}

pub fn frozen_geometry_and_unweighted_modalities_stay_as_they_are_with_their_moments(make: Make) {
    let start = wall(600, 3, 1);
    let fresh = || {
        let mut d = make(metric_rates(), RasterConfig::default(), &start).unwrap();
        d.upload(&training_view(3, 4), 1).unwrap();
        d
    };
    let frozen = Step { train_geometry: false, light_weight: 0.0, depth_weight: 0.0, ..step(0) };
    let mut d = fresh();
    d.train(&[frozen; 5]).unwrap();
    let g = d.gaussians().unwrap();
    assert_eq!(
        (&g.position, &g.rotation, &g.log_scale, &g.light),
        (&start.position, &start.rotation, &start.log_scale, &start.light)
    );
    assert_ne!(g.radio, start.radio);
    // Its moments have not moved either: an optical step with geometry ends where one from the start ends.
    let light_only = Step { radio_weight: 0.0, ..step(0) };
    d.train(&[light_only]).unwrap();
    let mut other = fresh();
    other.train(&[light_only]).unwrap();
    let (a, b) = (d.gaussians().unwrap(), other.gaussians().unwrap());
    assert_eq!((&a.position, &a.rotation, &a.log_scale, &a.light), (&b.position, &b.rotation, &b.log_scale, &b.light));
    assert_ne!(b.position, start.position);
    assert_eq!(b.radio, start.radio);
}

pub fn the_first_step_of_adam_is_its_closed_form(make: Make) {
    // Without bias correction m = (1−β₁) g and v = (1−β₂) g², so a step is rate · (1−β₁)/sqrt(1−β₂) = 5·rate against the gradient's sign.
    let start = wall(300, 1, 1);
    let config = OptimizerConfig { radio: AppearanceRates::default(), ..metric_rates() };
    let mut d = make(config, RasterConfig::default(), &start).unwrap();
    d.upload(&training_view(1, 4), 1).unwrap();
    let (_, gradient) = d.gradients_of(&step(0)).unwrap();
    assert_eq!(d.gaussians().unwrap(), start, "gradients() takes no step");
    d.train(&[step(0)]).unwrap();
    let after = d.gaussians().unwrap();
    let moved = |name: &str, before: f32, after: f32, gradient: f32, rate: f32| {
        if gradient != 0.0 {
            let expected = -5.0 * rate * gradient.signum();
            // Differences of f32 numbers near 3.
            assert!((after - before - expected).abs() < 1e-3 * rate + 5e-7, "{name}: {} expected {expected}", after - before);
        }
    };
    let mut seen = 0;
    for i in 0..start.len() {
        seen += usize::from(gradient.position[i] != [0.0; 3]);
        for k in 0..3 {
            moved("position", start.position[i][k], after.position[i][k], gradient.position[i][k], 1e-3);
            moved("log scale", start.log_scale[i][k], after.log_scale[i][k], gradient.log_scale[i][k], 0.01);
        }
        moved("rotation", start.rotation[i][0], after.rotation[i][0], gradient.rotation[i][0], 0.002);
        moved("opacity", start.radio.opacity_logit[i], after.radio.opacity_logit[i], gradient.radio.opacity_logit[i], 0.1);
        for (k, (b, a)) in start.light.sh[i * 12..i * 12 + 12].iter().zip(&after.light.sh[i * 12..]).enumerate() {
            let rate = if k < 3 { 5e-3 } else { 5e-3 / 20.0 };
            moved("optical sh", *b, *a, gradient.light.sh[i * 12 + k], rate);
        }
    }
    assert!(seen > 100, "{seen} Gaussians have gradients");
}

pub fn clamps_pass_no_gradient(make: Make) {
    // Red is clamped at 0; the weight is capped at 0.999 over the whole image, so neither opacity nor shape can change it.
    let mut g = field(&[([0.0, 0.0, 3.0], 200.0, 0.99999, [-0.4, 0.3, 0.6])]);
    g.light.opacity_logit[0] = 12.0;
    let mut d = plain(make, &g);
    let view = TrainingView { inverse_depth: None, ..training_view(3, 4) };
    d.upload(&view, 1).unwrap();
    let (_, gradient) = d.gradients_of(&Step { radio_weight: 0.0, depth_weight: 0.0, ..step(0) }).unwrap();
    assert_eq!(gradient.light.sh[0], 0.0);
    assert!(gradient.light.sh[1] != 0.0 && gradient.light.sh[2] != 0.0);
    assert_eq!(gradient.light.opacity_logit, [0.0]);
    assert_eq!((gradient.position[0], gradient.log_scale[0]), ([0.0; 3], [0.0; 3]));
    // Below the cap the same Gaussian's opacity matters.
    g.light.opacity_logit[0] = 2.0;
    let mut d = plain(make, &g);
    d.upload(&view, 1).unwrap();
    let (_, gradient) = d.gradients_of(&step(0)).unwrap();
    assert_ne!(gradient.light.opacity_logit, [0.0]);
}

pub fn retained_gaussians_keep_their_optimiser_state_and_appended_ones_start_fresh(make: Make) {
    let both = wall(600, 3, 1);
    let keep: Vec<bool> = (0..600).map(|i| i % 3 != 1).collect();
    let mut d = make(metric_rates(), RasterConfig::default(), &both).unwrap();
    d.upload(&training_view(3, 4), 1).unwrap();
    d.train(&[step(0); 3]).unwrap();
    let before = d.gaussians().unwrap();
    d.retain(&keep).unwrap();
    let kept: Vec<usize> = (0..600).filter(|i| keep[*i]).collect();
    let after = d.gaussians().unwrap();
    assert_eq!(after.len(), 400);
    let stride = before.radio.stride();
    for (new, old) in kept.iter().enumerate() {
        assert_eq!(after.position[new], before.position[*old]);
        assert_eq!(after.radio.sh[new * stride..(new + 1) * stride], before.radio.sh[old * stride..(old + 1) * stride]);
    }
    // Keeping all is the same as not being asked.
    let mut same = make(metric_rates(), RasterConfig::default(), &both).unwrap();
    same.upload(&training_view(3, 4), 1).unwrap();
    same.train(&[step(0); 3]).unwrap();
    same.retain(&[true; 600]).unwrap();
    same.train(&[step(0)]).unwrap();
    let mut reference = make(metric_rates(), RasterConfig::default(), &both).unwrap();
    reference.upload(&training_view(3, 4), 1).unwrap();
    reference.train(&[step(0); 4]).unwrap();
    assert_eq!(same.gaussians().unwrap(), reference.gaussians().unwrap());

    // One Gaussian far from the others: after retain drops those before it, its next step is still its own fourth, not a first.
    let lone = field(&[([-0.9, -0.5, 3.0], 0.1, 0.5, [0.2; 3]), ([0.9, 0.5, 3.0], 0.1, 0.5, [0.8; 3])]);
    let run = |prune: bool, fresh: bool| {
        let mut d = make(metric_rates(), RasterConfig::default(), &lone).unwrap();
        let mut view = training_view(3, 4);
        view.inverse_depth = None;
        d.upload(&view, 1).unwrap();
        d.train(&[step(0); 3]).unwrap();
        if prune {
            d.retain(&[false, true]).unwrap();
        }
        if fresh {
            let g = d.gaussians().unwrap();
            d.retain(&[false]).unwrap();
            d.append(&g).unwrap();
        }
        let before = d.gaussians().unwrap().log_scale.last().unwrap()[0];
        d.train(&[step(0)]).unwrap();
        d.gaussians().unwrap().log_scale.last().unwrap()[0] - before
    };
    // L1's sign is all the other Gaussian could change, and SSIM windows of the two do not meet.
    assert!((run(true, false) - run(false, false)).abs() < 1e-6);
    assert!((run(true, true).abs() - 5.0 * 0.01).abs() < 1e-5, "{}", run(true, true));
    assert!((run(true, false).abs() - 5.0 * 0.01).abs() > 1e-3);
}

pub fn resetting_radio_replaces_it_and_leaves_the_rest(make: Make) {
    let start = wall(200, 3, 1);
    let mut d = make(metric_rates(), RasterConfig::default(), &start).unwrap();
    d.upload(&training_view(3, 4), 1).unwrap();
    d.train(&[step(0); 3]).unwrap();
    let before = d.gaussians().unwrap();
    d.reset_radio(&start.radio).unwrap();
    let after = d.gaussians().unwrap();
    assert_eq!(after.radio, start.radio);
    assert_eq!((after.position, after.light), (before.position, before.light));
}

pub fn hopeless_gaussians_do_no_harm(make: Make) {
    // Not a number, infinite, enormous, degenerate: none of it may reach a pixel as NaN, nor stop the others.
    let mut g = field(&[([0.0, 0.0, 2.0], 0.3, 0.8, [0.9, 0.1, 0.1]); 6]);
    g.position[1] = [f32::NAN, 0.0, 2.0];
    g.log_scale[2] = [f32::INFINITY; 3];
    g.log_scale[3] = [80.0; 3];
    g.rotation[4] = [0.0; 4];
    g.log_scale[5] = [-80.0; 3];
    let mut d = plain(make, &g);
    d.upload(&TrainingView { world_from_camera: Rigid3::IDENTITY, ..training_view(3, 4) }, 1).unwrap();
    let report = d.train(&[step(0); 3]).unwrap();
    assert!(report.light_loss.is_finite() && report.radio_loss.is_finite());
    let layer = d.render(&light([0.0; 3])).unwrap().light.unwrap();
    assert!(layer.color.pixels.iter().all(|v| v.is_finite()));
    assert!(d.gaussians().unwrap().position[0].iter().all(|v| v.is_finite()));
}

pub fn a_mask_that_leaves_nothing_out_changes_no_byte(make: Make) {
    let g = wall(300, 3, 1);
    let trained = |mask: Option<Raster<bool>>| {
        let mut d = plain(make, &g);
        d.upload(&TrainingView { mask, ..training_view(3, 4) }, 2).unwrap();
        d.train(&[step(0), step(1), step(0)]).unwrap();
        d.gaussians().unwrap()
    };
    let plain = trained(None);
    assert!(plain == trained(Some(Raster::filled(37, 29, true))));
    assert!(plain != trained(Some(Raster::from_fn(37, 29, |x, _| x > 5))));
}

pub fn bad_input_is_named(make: Make) {
    let message = |e: corf::Error| e.to_string();
    let bad = OptimizerConfig { beta1: 1.0, ..OptimizerConfig::default() };
    let e = make(bad, RasterConfig::default(), &Gaussians::empty(3, 0)).err().unwrap();
    assert!(message(e).contains("optimizer.beta1"));
    let mut d = plain(make, &wall(10, 3, 1));
    assert!(message(d.append(&wall(10, 1, 1)).unwrap_err()).contains("rf"));
    assert!(message(d.upload(&training_view(1, 4), 1).unwrap_err()).contains("rf"));
    assert!(message(d.upload(&training_view(3, 4), 9).unwrap_err()).contains("level"));
    let mut broken = training_view(3, 4);
    broken.light.pixels[(2 * 37 + 5) * 3] = f32::NAN;
    assert!(message(d.upload(&broken, 1).unwrap_err()).contains("(5, 2)"));
    let narrow = TrainingView { mask: Some(Raster::filled(36, 29, true)), ..training_view(3, 4) };
    assert!(message(d.upload(&narrow, 1).unwrap_err()).contains("mask: 36x29 pixels"));
    assert!(message(d.train(&[step(0)]).unwrap_err()).contains("view 0"));
    d.upload(&training_view(3, 4), 1).unwrap();
    assert!(message(d.train(&[step(1)]).unwrap_err()).contains("level 1"));
}
