#![allow(clippy::unwrap_used)]

use super::*;
use crate::synthetic;
use corf::device::Planes;
use corf::{
    CpuDevice,
    device::{RenderRequest, View},
    loss::psnr_8bit,
};
use corf_scene::Raster;

fn cameras() -> (Pinhole, Pinhole) {
    (Pinhole::from_horizontal_fov(96, 72, 80.0), Pinhole::from_horizontal_fov(48, 36, 80.0))
}

fn keyframe(i: usize) -> Keyframe {
    let (light, radio) = cameras();
    synthetic::keyframe(i, synthetic::pose(i as f64), &light, &radio, true)
}

/// A short run in which every kind of event comes: three density changes, two resets, all degrees.
fn config() -> Rf3dgsConfig {
    Rf3dgsConfig {
        light_steps: 130,
        radio_steps: 40,
        degree_interval: 30,
        rates: Rf3dgsRates { position_steps: 130, ..Rf3dgsRates::default() },
        // The cameras are within a metre: what is a hundredth of a room's extent is more of theirs.
        density: DensityConfig {
            from: 20,
            until: 110,
            every: 30,
            reset_every: 45,
            reset_opacity: 0.2,
            clone_fraction: 0.08,
            prune_fraction: 0.8,
            ..DensityConfig::default()
        },
        ..Rf3dgsConfig::default()
    }
}

fn received(config: &Rf3dgsConfig, seed: u64) -> Rf3dgsReconstructor {
    received_from(config, seed, keyframe)
}

fn received_from(config: &Rf3dgsConfig, seed: u64, of: impl Fn(usize) -> Keyframe) -> Rf3dgsReconstructor {
    let device = CpuDevice::new(config.optimizer(), config.raster(), &config.empty_field()).unwrap();
    let (light, radio) = cameras();
    let mut r = Rf3dgsReconstructor::new(Box::new(device), config.clone(), light, radio, synthetic::DB_RANGE, seed).unwrap();
    (0..8).filter(|i| *i != 4).for_each(|i| r.receive(of(i)).unwrap());
    r
}

fn run(config: &Rf3dgsConfig, seed: u64, portion: usize) -> Rf3dgsReconstructor {
    finished(received(config, seed), portion)
}

fn finished(mut r: Rf3dgsReconstructor, portion: usize) -> Rf3dgsReconstructor {
    r.begin().unwrap();
    while r.train(portion).unwrap().is_some() {}
    assert!(r.is_done());
    r
}

/// PSNR of light and of the Jet image at the pose that was held out.
fn quality(r: &mut Rf3dgsReconstructor) -> [f64; 2] {
    let truth = keyframe(4);
    let meta = r.meta;
    let seen = meta.render(r.device.as_mut(), truth.world_from_camera).unwrap();
    let planes = |pixels: Vec<f32>| Planes { width: seen.image.width(), height: seen.image.height(), channels: 3, pixels };
    let image = planes(seen.image.pixels().as_flattened().to_vec());
    let target = planes(synthetic::light(&truth).image.pixels().as_flattened().iter().map(|v| f32::from(*v) / 255.0).collect());
    let jet = meta.radio_target.encode(synthetic::spectrum(&truth), &meta.db_range);
    [psnr_8bit(&image, &target), psnr_8bit(&seen.radio, &jet)]
}

#[test]
fn what_is_under_a_mask_changes_no_byte_of_a_field() {
    let config = Rf3dgsConfig { light_steps: 40, radio_steps: 5, ..config() };
    let mask = |k: &Keyframe| Raster::from_fn(96, 72, |x, y| !(5 * k.index..5 * k.index + 30).contains(&x) || y < 20);
    let masked = |i: usize| synthetic::seen(&keyframe(i), |light| light.mask = Some(mask(&keyframe(i))));
    let painted = |i: usize| {
        let (k, mut rng) = (masked(i), corf_scene::Rng::keyed(3, i as u64, 0));
        let mut at = |x: usize, y: usize| {
            if mask(&k)[(x, y)] { synthetic::light(&k).image[(x, y)] } else { [255 * rng.below(2) as u8; 3] }
        };
        let image = Raster::from_fn(96, 72, &mut at);
        synthetic::seen(&k, |light| light.image = image)
    };
    let field = |of: &dyn Fn(usize) -> Keyframe| finished(received_from(&config, 1, of), 1000).field().unwrap();
    let clean = field(&masked);
    assert!(field(&painted) == clean && field(&keyframe) != clean);
}

#[test]
fn two_stages_learn_light_and_radio_and_end_in_the_same_bytes_however_they_are_divided() {
    let config = config();
    let mut whole = received(&config, 1);
    whole.begin().unwrap();
    let before = whole.points().len();
    let at_first = quality(&mut whole);
    whole.train(130).unwrap();
    begin_radio(whole.device.as_mut(), config.radio_moments).unwrap();
    whole.radio_begun = true;
    let at_the_seam = quality(&mut whole);
    whole.train(1000).unwrap();
    let at_last = quality(&mut whole);
    let counts = whole.density_counts();
    assert!(counts.cloned > 10 && counts.split > 10, "{counts:?}");
    assert!(before > 100 && whole.gaussian_count() != before, "{before} points");
    // Light is learnt in the first stage and stays; radio is learnt in the second, from grey.
    assert!(at_the_seam[0] > at_first[0] + 2.0 && at_last[0] == at_the_seam[0], "{at_first:?}, {at_the_seam:?}, {at_last:?}");
    assert!(at_last[1] > at_the_seam[1] + 0.2, "{at_the_seam:?}, {at_last:?}");
    let field = whole.field().unwrap();
    assert!(run(&config, 1, 7).field().unwrap() == field, "portions change nothing");
    assert!(run(&config, 2, 1000).field().unwrap() != field, "the seed does");
    let times = whole.times();
    assert!(times.points_s > 0.0 && times.light_s > 0.0 && times.radio_s > 0.0);
}

#[test]
fn a_restored_reconstruction_goes_on_to_the_same_bytes_from_anywhere() {
    let config = config();
    let truth = run(&config, 3, 1000).field().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    // Before any step, between two changes (with gradients summed so far), at the seam of the stages, and within the second.
    for steps in [0, 37, 75, 130, 141] {
        let mut first = received(&config, 3);
        first.begin().unwrap();
        while first.steps_done() < steps {
            first.train((steps - first.steps_done()).min(20)).unwrap();
        }
        first.checkpoint("tag").unwrap().write(&path).unwrap();
        let points = first.points().to_vec();
        drop(first);
        let checkpoint = Rf3dgsCheckpoint::read(&path).unwrap();
        assert_eq!((checkpoint.tag(), checkpoint.steps()), ("tag", steps));
        let mut second = received(&config, 3);
        second.restore(&checkpoint).unwrap();
        while second.train(50).unwrap().is_some() {}
        assert!(second.field().unwrap() == truth, "from step {steps}");
        assert!(second.points() == points);
        assert!(received(&config, 4).restore(&checkpoint).is_err(), "another seed");
        assert!(second.restore(&checkpoint).is_err(), "it has begun");
    }
    let mut damaged = std::fs::read(&path).unwrap();
    damaged[300] ^= 1;
    std::fs::write(&path, damaged).unwrap();
    assert!(Rf3dgsCheckpoint::read(&path).unwrap_err().to_string().contains("no checkpoint of this version"));
}

#[test]
fn the_radio_stage_begins_grey_with_lights_opacity_and_leaves_geometry_and_light_alone() {
    for (radio_moments, radio_background) in
        [(RadioMoments::Restored, RadioBackground::Black), (RadioMoments::Zero, RadioBackground::Floor)]
    {
        let config = Rf3dgsConfig { radio_moments, radio_background, ..config() };
        let mut r = received(&config, 1);
        r.begin().unwrap();
        r.train(130).unwrap();
        assert_eq!(r.steps_done(), 130);
        let light = r.device.state().unwrap();
        begin_radio(r.device.as_mut(), radio_moments).unwrap();
        r.radio_begun = true;
        let state = r.device.state().unwrap();
        assert!(state.gaussians.light == light.gaussians.light && state.gaussians.position == light.gaussians.position);
        assert_eq!(state.gaussians.radio.opacity_logit, light.gaussians.light.opacity_logit);
        assert!(state.gaussians.radio.sh.iter().all(|v| *v == 0.0));
        for (now, then) in state.moments.iter().zip(&light.moments) {
            assert!(then.light.sh.iter().any(|v| *v != 0.0));
            match radio_moments {
                RadioMoments::Restored => assert!(now.radio == then.light),
                RadioMoments::Zero => assert!(now.radio.sh.iter().chain(&now.radio.opacity_logit).all(|v| *v == 0.0)),
            }
        }
        while r.train(100).unwrap().is_some() {}
        let end = r.field().unwrap();
        assert!(end.gaussians.light == light.gaussians.light && end.gaussians.rotation == light.gaussians.rotation);
        assert!(end.gaussians.position == light.gaussians.position && end.gaussians.log_scale == light.gaussians.log_scale);
        assert!(end.gaussians.radio.opacity_logit != light.gaussians.light.opacity_logit, "opacity is learnt");
        // All bands from the start.
        assert!((0..48).all(|k| end.gaussians.radio.sh.chunks_exact(48).any(|sh| sh[k] != 0.0)));
        assert_eq!(end.meta.radio_background, Some(config.radio_background_color()));
    }
}

#[test]
fn published_and_corrected_differ_in_the_radio_stage_alone() {
    let published = config();
    let corrected = Rf3dgsConfig { radio_moments: RadioMoments::Zero, radio_background: RadioBackground::Floor, ..config() };
    let (mut a, mut b) = (run(&published, 1, 1000), run(&corrected, 1, 1000));
    let (fa, fb) = (a.field().unwrap(), b.field().unwrap());
    assert!(fa.gaussians.light == fb.gaussians.light && fa.gaussians.position == fb.gaussians.position);
    assert!(fa.gaussians.radio != fb.gaussians.radio);
    // Where nothing is, one shows black and the other the floor.
    let outside = Rigid3::looking_at(glam::DVec3::new(0.0, 0.0, 500.0), glam::DVec3::new(0.0, 0.0, 900.0), glam::DVec3::Y);
    let view = View { camera: cameras().1, world_from_camera: outside };
    for (r, color) in [(&mut a, [0.0; 3]), (&mut b, corf_scene::color::jet(0.0))] {
        let shown = r.meta.render(r.device.as_mut(), outside).unwrap().radio;
        assert!(shown.pixels.chunks_exact(3).all(|p| p == color));
        let request = RenderRequest { radio: Some((view, [0.3; 3])), ..RenderRequest::default() };
        assert!(r.device.render(&request).unwrap().radio.unwrap().transmittance.pixels().iter().all(|t| *t == 1.0));
    }
}

#[test]
fn random_points_will_do_where_nothing_can_be_triangulated() {
    let config = Rf3dgsConfig {
        initial_points: InitialPoints::Random,
        random_points: 400,
        random_extent: 1.5,
        light_steps: 10,
        radio_steps: 0,
        ..config()
    };
    let mut r = run(&config, 1, 100);
    assert_eq!(r.points().len(), 400);
    assert!(r.field().unwrap().gaussians.radio.sh.iter().all(|v| *v == 0.0));
}

#[test]
fn what_cannot_be_a_beginning_is_refused() {
    let config = config();
    let mut r = received(&config, 1);
    assert!(r.train(1).unwrap_err().to_string().contains("has not begun"));
    assert!(r.checkpoint("").is_err());
    let small = synthetic::seen(&keyframe(4), |light| light.image = Raster::filled(5, 5, [0; 3]));
    assert!(r.receive(small).unwrap_err().to_string().contains("5x5"));
    let broken = synthetic::with_spectrum(&keyframe(4), Raster::filled(48, 36, f32::NAN));
    assert!(r.receive(broken).unwrap_err().to_string().contains("spectrum is NaN"));
    for half in [Keyframe { light: None, ..keyframe(4) }, Keyframe { radio: None, ..keyframe(4) }] {
        assert!(r.receive(half).unwrap_err().to_string().contains("no image or no spectrum"));
    }
    r.begin().unwrap();
    assert!(r.begin().is_err() && r.receive(keyframe(4)).is_err());
    let device = CpuDevice::new(config.optimizer(), config.raster(), &config.empty_field()).unwrap();
    let (light, radio) = cameras();
    let mut alone = Rf3dgsReconstructor::new(Box::new(device), config, light, radio, synthetic::DB_RANGE, 1).unwrap();
    alone.receive(keyframe(0)).unwrap();
    assert!(alone.begin().unwrap_err().to_string().contains("all in one place"));
}
