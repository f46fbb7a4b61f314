//! Distortion against formulas, and images that come back from it.

use super::*;

fn pinhole() -> Pinhole {
    Pinhole { width: 64, height: 48, fx: 50.0, fy: 52.0, cx: 31.0, cy: 25.0 }
}

#[test]
fn distortion_is_the_published_formula() {
    let lens = Lens { pinhole: pinhole(), radial: [-0.2, 0.05, 0.01], tangential: [0.003, -0.002] };
    let (x, y): (f64, f64) = (0.3, -0.4);
    // r² = 0.25, written out term by term.
    let radial = 1.0 - 0.2 * 0.25 + 0.05 * 0.0625 + 0.01 * 0.015625;
    let expected_x = x * radial + 2.0 * 0.003 * (x * y) - 0.002 * (0.25 + 2.0 * 0.09);
    let expected_y = y * radial + 0.003 * (0.25 + 2.0 * 0.16) + 2.0 * -0.002 * (x * y);
    let at = lens.project(x, y);
    assert!((at - DVec2::new(50.0 * expected_x + 31.0, 52.0 * expected_y + 25.0)).length() < 1e-12, "{at}");
}

#[test]
fn a_distorted_picture_of_a_known_scene_comes_back_straight() {
    // The scene's brightness is linear in x/z and y/z, so bilinear sampling has only rounding errors and what the lens curves in a pixel.
    let shade = |x: f64, y: f64| [(120.0 + 100.0 * x), (120.0 + 100.0 * y), 60.0];
    for radial in [[-0.15, 0.03, 0.0], [0.12, 0.0, 0.0]] {
        let lens = Lens { pinhole: pinhole(), radial, tangential: [0.001, 0.002] };
        // The distorted picture: every pixel's ray by Newton-free fixed-point inversion of the formula.
        let picture = Raster::from_fn(64, 48, |u, v| {
            let target = DVec2::new(u as f64 + 0.5, v as f64 + 0.5);
            let mut ray = DVec2::new((target.x - 31.0) / 50.0, (target.y - 25.0) / 52.0);
            for _ in 0..100 {
                let miss = target - lens.project(ray.x, ray.y);
                ray += miss / DVec2::new(50.0, 52.0);
            }
            shade(ray.x, ray.y).map(|v| v.round() as u8)
        });
        let (target, changed) = common_pinhole(&[("a", lens)]).unwrap();
        assert!(changed && target.width == 64 && target.height == 48);
        // Barrel distortion shows more than its own focal length would, pincushion less.
        assert_eq!(target.fx > 50.0, radial[0] > 0.0, "{}", target.fx);
        assert!((target.fx / target.fy - 50.0 / 52.0).abs() < 1e-12);
        let straight = lens.resample(&picture, &target);
        for y in 0..48 {
            for x in 0..64 {
                let ray = target.unproject(x as f64 + 0.5, y as f64 + 0.5);
                let expected = shade(ray.x, ray.y);
                for c in 0..3 {
                    let got = f64::from(straight[(x, y)][c]);
                    // Two roundings, and the curvature of the lens over a pixel.
                    assert!((got - expected[c]).abs() <= 1.2, "({x}, {y}) {got} {expected:?}");
                }
            }
        }
    }
}

#[test]
fn cameras_without_distortion_are_left_alone_and_others_share_a_view() {
    let plain = Lens::plain(pinhole());
    assert_eq!(common_pinhole(&[("a", plain), ("b", plain)]).unwrap(), (pinhole(), false));
    let image = Raster::from_fn(64, 48, |x, y| [x as u8, y as u8, 7]);
    assert_eq!(plain.resample(&image, &pinhole()), image);
    // A camera of a narrower view narrows that of all.
    let narrow = Lens::plain(Pinhole { fx: 60.0, fy: 62.4, ..pinhole() });
    let (target, changed) = common_pinhole(&[("a", plain), ("b", narrow)]).unwrap();
    assert!(changed && (target.fx - 60.0).abs() < 1e-5, "{}", target.fx);
    let depth = Raster::from_fn(64, 48, |x, _| if x < 32 { 1.0 } else { 5.0 });
    assert!(plain.resample_nearest(&depth, &target).pixels().iter().all(|d| *d == 1.0 || *d == 5.0), "depths are not mixed");
    let wide = Lens::plain(Pinhole { width: 65, ..pinhole() });
    let message = common_pinhole(&[("a", plain), ("b.png", wide)]).unwrap_err().to_string();
    assert!(message.contains("b.png") && message.contains("65x48"), "{message}");
}

#[test]
fn a_lens_that_folds_the_image_is_not_stretched_over_it() {
    // r (1 - 0.9 r²) turns back at r = 0.61; the corners would be at 0.8.
    let lens = Lens { pinhole: pinhole(), radial: [-0.9, 0.0, 0.0], tangential: [0.0; 2] };
    let (target, _) = common_pinhole(&[("a", lens)]).unwrap();
    let corner = target.unproject(0.5, 0.5).truncate().length();
    assert!(corner < (1.0f64 / 2.7).sqrt() + 1e-9, "{corner}");
    let absurd = Lens { radial: [-100.0, 0.0, 0.0], ..lens };
    assert!(common_pinhole(&[("a", absurd)]).unwrap_err().to_string().contains("image_undistorter"));
    assert!(Lens { radial: [f64::NAN; 3], ..lens }.check("camera 1").is_err());
}
