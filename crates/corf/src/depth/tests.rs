//! Depth against exact depth, on images the test renders itself.

use super::*;
use crate::{
    config::{DepthConfig, PriorPreset},
    depth::prior::SimulatedPrior,
    synthetic::{self, light},
};
use corf_scene::{Keyframe, Light, Pinhole, Raster};

const SEED: u64 = 5;

fn sequence(camera: &Pinhole, count: usize, textured: bool) -> Vec<Keyframe> {
    let radio = Pinhole::from_horizontal_fov(8, 8, 90.0);
    (0..count).map(|i| synthetic::keyframe(i, synthetic::pose(i as f64 * 1.5), camera, &radio, textured)).collect()
}

fn grey(keyframes: &[Keyframe], camera: &Pinhole) -> Vec<GreyView> {
    keyframes.iter().map(|k| GreyView::of(k.index, k.world_from_camera, light(k), *camera)).collect()
}

fn truth(k: &Keyframe) -> &Raster<f32> {
    light(k).depth_m.as_ref().unwrap()
}

/// Relative depth errors |z/z* − 1|, sorted.
fn errors(found: impl Iterator<Item = (usize, usize, f32)>, truth: &Raster<f32>) -> Vec<f32> {
    let mut e: Vec<f32> = found.map(|(x, y, w)| (1.0 / w / truth[(x, y)] - 1.0).abs()).collect();
    e.sort_unstable_by(f32::total_cmp);
    e
}

fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len() as f32
}

struct Setup {
    camera: Pinhole,
    keyframes: Vec<Keyframe>,
    views: Vec<GreyView>,
}

fn setup(width: usize, height: usize, textured: bool) -> Setup {
    let camera = Pinhole::from_horizontal_fov(width, height, 90.0);
    let keyframes = sequence(&camera, 6, textured);
    let views = grey(&keyframes, &camera);
    Setup { camera, keyframes, views }
}

fn neighbours<'a>(s: &'a Setup) -> (&'a GreyView, Vec<Neighbour<'a>>) {
    let (reference, others) = s.views.split_last().unwrap();
    (reference, select_neighbours(reference, others, 4.0, 6))
}

#[test]
fn a_warp_is_the_projection_of_the_point_and_its_derivative() {
    let s = setup(192, 108, true);
    let (a, b) = (&s.views[0], &s.views[3]);
    let n = Neighbour::new(a, b);
    let (u, v, w) = (120.3f32, 40.7f32, 0.22f32);
    let exact = |u: f64, v: f64| {
        let p = a.world_from_camera.transform_point(s.camera.unproject(u, v) / f64::from(w));
        s.camera.project(b.world_from_camera.inverse().transform_point(p)).unwrap()
    };
    let warp = n.warp(&s.camera, &s.camera, u, v, w).unwrap();
    let c = exact(f64::from(u), f64::from(v));
    // f32 pixels around 100: 1e-4.
    assert!((warp.center.as_dvec2() - c).length() < 1e-4);
    let du = (exact(f64::from(u) + 0.5, f64::from(v)) - exact(f64::from(u) - 0.5, f64::from(v))) / 1.0;
    assert!((warp.jacobian.x_axis.as_dvec2() - du).length() < 1e-3, "{:?} {du}", warp.jacobian);
}

#[test]
fn triangulated_corners_lie_on_the_surfaces() {
    for (width, height) in [(192, 108), (640, 360)] {
        let s = setup(width, height, true);
        let (reference, near) = neighbours(&s);
        assert!(near.len() >= 4);
        let corners = triangulate(&ProcessorMatcher, reference, &near, &DepthConfig::default()).unwrap().depths;
        let e = errors(corners.iter().map(|c| (c.x, c.y, c.inverse_depth)), truth(&s.keyframes[5]));
        let outliers = e.iter().filter(|&&e| e > 0.1).count() as f32 / e.len() as f32;
        eprintln!(
            "{width}: {} corners, median {:.4}, 90 % {:.4}, outliers {outliers:.3}",
            e.len(),
            e[e.len() / 2],
            e[e.len() * 9 / 10]
        );
        assert!(e.len() > 150, "{width}: {} corners", e.len());
        // A tenth of a pixel of the 0.25–1.2 m baselines at 4 m is about 0.3 %.
        assert!(e[e.len() / 2] < 0.01, "{width}: median {}", e[e.len() / 2]);
        assert!(outliers < 0.1, "{width}: {outliers} of the corners are off by 10 %");
    }
}

/// A sign that stands still before each camera would match wherever it is; masked, no depth comes of it on either side.
#[test]
fn what_does_not_count_is_neither_corner_nor_match() {
    let s = setup(192, 108, true);
    let mut rng = corf_scene::Rng::keyed(4, 0, 0);
    let sign = Raster::from_fn(60, 50, |_, _| [(255.0 * rng.uniform()) as u8; 3]);
    let is_sign = |x: usize, y: usize| (70..130).contains(&x) && (30..80).contains(&y);
    let views = |mask: bool| -> Vec<GreyView> {
        let painted = |k: &Keyframe| {
            let image =
                Raster::from_fn(192, 108, |x, y| if is_sign(x, y) { sign[(x - 70, y - 30)] } else { light(k).image[(x, y)] });
            let mask = mask.then(|| Raster::from_fn(192, 108, |x, y| !is_sign(x, y)));
            let seen = Light { image, mask, ..light(k).clone() };
            GreyView::of(k.index, k.world_from_camera, &seen, s.camera)
        };
        s.keyframes.iter().map(painted).collect()
    };
    let config = DepthConfig::default();
    let found = |views: &[GreyView]| {
        let (reference, others) = views.split_last().unwrap();
        let near = select_neighbours(reference, others, 4.0, 6);
        let pixels: Vec<(usize, usize)> = (0..108).step_by(2).flat_map(|y| (0..192).step_by(3).map(move |x| (x, y))).collect();
        let matched =
            match_wide(&ProcessorMatcher, reference, &near, &pixels, &config).unwrap().depths.into_iter().map(|d| (d.x, d.y));
        (triangulate(&ProcessorMatcher, reference, &near, &config).unwrap().depths, matched.collect::<Vec<_>>())
    };
    let (corners, matched) = found(&views(true));
    let near_sign = |x: usize, y: usize| (67..133).contains(&x) && (27..83).contains(&y);
    assert!(corners.len() > 80 && matched.len() > 200, "{} {}", corners.len(), matched.len());
    assert!(!corners.iter().any(|c| near_sign(c.x, c.y)) && !matched.iter().any(|m| near_sign(m.0, m.1)));
    let e = errors(corners.iter().map(|c| (c.x, c.y, c.inverse_depth)), truth(&s.keyframes[5]));
    assert!(e[e.len() * 9 / 10] < 0.1, "{e:?}");
    // Without masks the sign takes part.
    let (corners, matched) = found(&views(false));
    let inside = corners.iter().filter(|c| near_sign(c.x, c.y)).count() + matched.iter().filter(|m| near_sign(m.0, m.1)).count();
    assert!(inside > 0);
}

#[test]
fn blank_walls_triangulate_nothing_and_match_nothing() {
    let s = setup(192, 108, false);
    let (reference, near) = neighbours(&s);
    let config = DepthConfig::default();
    let exact = truth(&s.keyframes[5]).map(|z| 1.0 / z);
    let dense = |map| Dense::new(map, (192, 108));
    let prior = AlignedPrior { confidence: dense(exact.map(|_| 1.0)), inverse_depth: dense(exact), scale: 1.0, offset: 0.0 };
    // Pixels whose patch lies within one surface: no texture, no match, whatever the gate says.
    let surface = light(&s.keyframes[5]).surface.as_ref().unwrap();
    let flat: Vec<(usize, usize)> = (8..100)
        .flat_map(|y| (8..184).map(move |x| (x, y)))
        .filter(|&(x, y)| (y - 5..=y + 5).all(|v| (x - 5..=x + 5).all(|u| surface[(u, v)] == surface[(x, y)])))
        .collect();
    assert!(flat.len() > 1000);
    let found = match_guided(&ProcessorMatcher, reference, &near, &prior, &flat, config.match_range, &config).unwrap().depths;
    assert!(found.iter().all(|d| d.reliability == Reliability::Prior));
    let corners = triangulate(&ProcessorMatcher, reference, &near, &config).unwrap().depths;
    let e = errors(corners.iter().map(|c| (c.x, c.y, c.inverse_depth)), truth(&s.keyframes[5]));
    // The block's silhouette and the room's edges remain; what is found there must still be right.
    assert!(e.iter().filter(|&&e| e > 0.1).count() as f32 <= 0.2 * e.len() as f32 + 1.0, "{e:?}");
}

/// AbsRel of the aligned prior per preset: depth.md's targets (0.040, 0.065, 0.095), with room for the small number of frames here.
#[test]
fn the_simulated_prior_errs_as_much_as_it_should_after_alignment() {
    let s = setup(192, 108, true);
    for (preset, low, high) in
        [(PriorPreset::Mild, 0.02, 0.06), (PriorPreset::Default, 0.035, 0.09), (PriorPreset::Hard, 0.05, 0.13)]
    {
        let config = DepthConfig::default();
        let mut sum = 0.0;
        let runs = 8;
        for seed in 0..runs {
            let prior = SimulatedPrior::new(preset, seed);
            let k = &s.keyframes[5];
            let mono = prior.estimate(k.index, light(k)).unwrap();
            let exact = truth(k);
            // Anchors with a tenth of outliers, as real triangulation has.
            let anchors: Vec<SparseDepth> = (0..400)
                .map(|i| {
                    let (x, y) = ((i * 37) % 192, (i * 53) % 108);
                    let factor = if i % 10 == 0 { 1.6 } else { 1.0 };
                    SparseDepth { x, y, inverse_depth: factor / exact[(x, y)] }
                })
                .collect();
            let aligned = align(&mono, &anchors, &config).unwrap();
            let all = (0..192 * 108).map(|i| (i % 192, i / 192, aligned.inverse_depth.at(i % 192, i / 192)));
            sum += mean(&errors(all, exact));
        }
        let absrel = sum / runs as f32;
        eprintln!("{preset:?}: AbsRel {absrel:.4}");
        assert!(absrel > low && absrel < high, "{preset:?}: AbsRel {absrel}");
    }
}

/// Images larger than the network's are seen at the network's size; what comes of it errs as much, and an edge stays an edge.
#[test]
fn a_large_image_gets_its_prior_at_the_networks_size() {
    let (w, h) = (1000, 777);
    let k = setup(96, 64, true).keyframes.remove(2);
    // A slanted wall with a box before it, between columns 400 and 600.
    let exact = Raster::from_fn(w, h, |x, y| {
        let wall = 1.0 / (0.2 + 0.1 * x as f32 / w as f32 + 0.05 * y as f32 / h as f32);
        if (400..600).contains(&x) { 0.5 * wall } else { wall }
    });
    let k = synthetic::seen(&k, |light| (light.depth_m, light.surface) = (Some(exact), None));
    let exact = truth(&k);
    let anchors: Vec<SparseDepth> = (0..400)
        .map(|i| ((i * 37) % w, (i * 53) % h))
        .map(|(x, y)| SparseDepth { x, y, inverse_depth: 1.0 / exact[(x, y)] })
        .collect();
    let mono = SimulatedPrior::new(PriorPreset::Mild, SEED).estimate(k.index, light(&k)).unwrap();
    assert_eq!((mono.grid().width(), mono.grid().height()), (667, 518));
    let aligned = align(&mono, &anchors, &DepthConfig::default()).unwrap();
    let all = (0..w * h).map(|i| (i % w, i / w, aligned.inverse_depth.at(i % w, i / w)));
    let absrel = mean(&errors(all, exact));
    assert!(absrel > 0.002 && absrel < 0.06, "AbsRel {absrel}");
    // The wall is believed; the box's sides, which the blur of 1.5 cells smears over some 8 pixels, are not.
    let confidence = aligned.confidence.to_pixels_unless_zero();
    let believed = |x: usize| (0..h).filter(|&y| confidence[(x, y)] > 0.0).count() as f32 / h as f32;
    for x in [50, 300, 385, 415, 500, 585, 615, 900] {
        assert!(believed(x) > 0.99, "column {x}: {}", believed(x));
    }
    for x in [400, 600] {
        assert!(believed(x) < 0.01, "column {x}: {}", believed(x));
    }
}

/// Confidences do not depend on the grid's resolution, but for what interpolation smooths.
#[test]
fn a_slope_is_one_per_image_pixel_whatever_the_cells() {
    let (w, h) = (96, 64);
    let map = |cells: usize| {
        let at = |i: usize| (i as f32 + 0.5) * cells as f32 - 0.5;
        // Sinusoids some 40 pixels long, steep enough to cost confidence and nowhere an edge.
        Dense::new(Raster::from_fn(w / cells, h / cells, |x, y| (at(x) * 0.15).sin() + (at(y) * 0.12).cos()), (w, h))
    };
    let [fine, coarse] = [1, 2].map(|cells| AlignedPrior::new(&map(cells), 0.1, 1.0, &DepthConfig::default()).confidence);
    let mut least = 1.0_f32;
    for (x, y) in (8..h - 8).flat_map(|y| (8..w - 8).map(move |x| (x, y))) {
        let (a, b) = (fine.at(x, y), coarse.at(x, y));
        least = least.min(a);
        // 3 % of the slope for Sobel's wider stencil, and as much for the median absolute deviation on other samples.
        assert!((a - b).abs() < 0.04, "({x}, {y}): {a} and {b}");
    }
    assert!(least < 0.9, "{least}");
}

#[test]
fn the_prior_is_affine_invariant_only_and_repeats_itself_by_seed() {
    let s = setup(96, 64, true);
    let k = &s.keyframes[2];
    let a = SimulatedPrior::new(PriorPreset::Default, 1).estimate(k.index, light(k)).unwrap();
    assert_eq!(a, SimulatedPrior::new(PriorPreset::Default, 1).estimate(k.index, light(k)).unwrap());
    assert_ne!(a, SimulatedPrior::new(PriorPreset::Default, 2).estimate(k.index, light(k)).unwrap());
    // It is not metric: without alignment the depth is far off.
    let e = errors((0..96 * 64).map(|i| (i % 96, i / 96, a.at(i % 96, i / 96).max(0.03))), truth(k));
    assert!(mean(&e) > 0.3);
    let blind = Light::of_image(light(k).image.clone());
    let error = SimulatedPrior::new(PriorPreset::Default, 1).estimate(k.index, &blind).unwrap_err().to_string();
    assert!(error.contains("keyframe 2") && error.contains("none"), "{error}");
}

#[test]
fn guided_matching_sharpens_the_prior_several_times_over() {
    for (width, height) in [(192, 108), (640, 360)] {
        let s = setup(width, height, true);
        let (reference, near) = neighbours(&s);
        let config = DepthConfig::default();
        let k = &s.keyframes[5];
        let mono = SimulatedPrior::new(PriorPreset::Default, SEED).estimate(k.index, light(k)).unwrap();
        let prior = align(&mono, &triangulate(&ProcessorMatcher, reference, &near, &config).unwrap().depths, &config).unwrap();
        let pixels: Vec<(usize, usize)> = (0..2000).map(|i| ((i * 37) % width, (i * 53) % height)).collect();
        let started = std::time::Instant::now();
        let found =
            match_guided(&ProcessorMatcher, reference, &near, &prior, &pixels, config.match_range, &config).unwrap().depths;
        let elapsed_s = started.elapsed().as_secs_f64();
        let accurate: Vec<&PixelDepth> = found.iter().filter(|d| d.reliability == Reliability::Accurate).collect();
        let e = errors(accurate.iter().map(|d| (d.x, d.y, d.inverse_depth)), truth(k));
        let before = errors(accurate.iter().map(|d| (d.x, d.y, prior.inverse_depth.at(d.x, d.y))), truth(k));
        let (median, median_before) = (e[e.len() / 2], before[before.len() / 2]);
        let outliers = e.iter().filter(|&&e| e > 0.1).count() as f32 / e.len() as f32;
        eprintln!(
            "{width}: {} of {} accurate, {} in all, median {median_before:.4} -> {median:.5}, outliers {outliers:.3}, {elapsed_s:.3} s",
            e.len(),
            pixels.len(),
            found.len()
        );
        assert!(e.len() > 600, "{width}: {} accurate", e.len());
        // A tenth of a pixel is 0.7 % of the depth at 192 pixels' width and a third of that at 640.
        assert!(median < if width == 192 { 0.25 } else { 0.12 } * median_before, "{width}: {median_before} -> {median}");
        assert!(outliers < 0.08, "{width}: {outliers}");
    }
}

#[test]
fn without_a_prior_wide_matching_finds_fewer_but_right_depths() {
    let s = setup(192, 108, true);
    let (reference, near) = neighbours(&s);
    let pixels: Vec<(usize, usize)> = (0..2000).map(|i| ((i * 37) % 192, (i * 53) % 108)).collect();
    let found = match_wide(&ProcessorMatcher, reference, &near, &pixels, &DepthConfig::default()).unwrap().depths;
    let e = errors(found.iter().map(|d| (d.x, d.y, d.inverse_depth)), truth(&s.keyframes[5]));
    eprintln!("wide: {} found, median {:.4}", e.len(), e[e.len() / 2]);
    assert!(e.len() > 300, "{}", e.len());
    assert!(e[e.len() / 2] < 0.01 && e[e.len() * 9 / 10] < 0.1, "{} {}", e[e.len() / 2], e[e.len() * 9 / 10]);
}

#[test]
fn neighbours_that_stand_still_or_look_away_are_not_chosen() {
    let s = setup(96, 64, true);
    let reference = &s.views[5];
    let mut still = s.views[5].clone();
    still.index = 7;
    let mut away = s.views[4].clone();
    away.index = 8;
    let turn = glam::DMat3::from_rotation_y(std::f64::consts::PI);
    away.world_from_camera.rotation *= turn;
    let chosen = select_neighbours(reference, [&still, &away, &s.views[4]], 4.0, 6);
    assert_eq!(chosen.iter().map(|n| n.view.index).collect::<Vec<_>>(), [4]);
}
