//! Needles and discs: ellipses whose determinant is lost in the rounding of their entries, were it the difference of these entries' products.

use crate::support::{compare_gradients, metric_rates, norm, pair, room, step, training_view};
use corf::{
    Antialias, Device, OptimizerConfig, RasterConfig,
    device::{Layer, RenderRequest, View},
};
use corf_scene::{Pinhole, Rigid3};
use glam::DVec3;

/// Least agreement of two devices in a picture, dB of peak signal to noise.
const LEAST_PSNR_DB: f64 = 60.0;

fn psnr_db(a: &[f32], b: &[f32]) -> f64 {
    let error = norm(a.iter().zip(b).map(|(a, b)| f64::from(a - b))) / (a.len() as f64).sqrt();
    -20.0 * error.max(1e-10).log10()
}

fn compare(what: &str, a: &Layer, b: &Layer) {
    for (part, a, b) in [
        ("colour", &a.color.pixels[..], &b.color.pixels[..]),
        ("transmittance", a.transmittance.pixels(), b.transmittance.pixels()),
    ] {
        let found = psnr_db(a, b);
        assert!(found >= LEAST_PSNR_DB, "{what}, {part}: {found:.1} dB");
    }
}

/// Axes of `long` and `short`, ln metres: needles, and discs where two are long.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn needles_and_discs_are_the_same_on_both_devices() {
    let camera = Pinhole::from_horizontal_fov(96, 54, 90.0);
    for (long, short, discs) in
        [(1.0, -9.0, false), (0.0, -7.0, false), (-1.0, -7.0, false), (2.0, -9.0, false), (1.0, -9.0, true)]
    {
        for antialias in [Antialias::On, Antialias::Off] {
            let mut g = room(21, 400, 3, [1, 1]);
            g.log_scale.iter_mut().for_each(|s| *s = [long, if discs { long } else { short }, short]);
            let raster = RasterConfig { antialias, ..RasterConfig::default() };
            let Some((mut cpu, mut gpu)) = pair(OptimizerConfig::default(), raster, &g) else { return };
            let mut drawn = 0;
            for k in 0..6 {
                let eye = DVec3::new(1.5 * f64::from(k) - 3.5, 0.4 * f64::from(k) - 1.0, 0.1);
                let angle = 0.9 * f64::from(k);
                let world_from_camera = Rigid3::looking_at(eye, eye + DVec3::new(angle.cos(), angle.sin(), -0.1), DVec3::Z);
                let view = View { camera, world_from_camera };
                let request = RenderRequest {
                    light: Some((view, [0.0; 3])),
                    radio: Some((view, [0.0, 0.0, 0.5])),
                    main_contributor: false,
                };
                let (a, b) = (cpu.render(&request).unwrap(), gpu.render(&request).unwrap());
                let what = format!("e^{long} by e^{short} m, {antialias:?}, pose {k}");
                for (a, b) in [(&a.light, &b.light), (&a.radio, &b.radio)] {
                    compare(&what, a.as_ref().unwrap(), b.as_ref().unwrap());
                }
                drawn += a.light.unwrap().transmittance.pixels().iter().filter(|t| **t < 0.99).count();
            }
            assert!(drawn > 1000, "e^{long} by e^{short} m: {drawn} pixels show any");
        }
    }
}

/// Twenty times as long as wide. What a pixel says of a needle's place along itself is a difference of large numbers in either device, and of much
/// longer ones nothing of it is left to compare; what their opacity says, `gradients.rs` holds against doubles.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn gradients_of_needles_agree() {
    for antialias in [Antialias::On, Antialias::Detached] {
        let mut g = room(22, 1200, 3, [1, 1]);
        g.log_scale.iter_mut().for_each(|s| *s = [-1.5, -4.5, -4.5]);
        let raster = RasterConfig { antialias, ..RasterConfig::default() };
        let Some((mut cpu, mut gpu)) = pair(metric_rates(), raster, &g) else { return };
        let view = training_view(0, 3, true);
        cpu.upload(&view, 1).unwrap();
        gpu.upload(&view, 1).unwrap();
        compare_gradients(&mut cpu, &mut gpu, &step(0, 0));
    }
}
