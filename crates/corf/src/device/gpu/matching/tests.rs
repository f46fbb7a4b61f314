//! Matching on an adapter against the processor's. Where a score lies within rounding of a threshold or of another score, one finds what the other does
//! not: such pixels are counted, and bounded.

#![allow(clippy::unwrap_used, clippy::print_stderr)]

use super::*;
use crate::{
    config::{MatchedOn, PriorPreset},
    depth::{
        AlignedPrior, PixelDepth, ProcessorMatcher, Reliability, SparseDepth, align, match_guided, match_wide,
        prior::SimulatedPrior, select_neighbours, triangulate as find_corners,
    },
    device::gpu::{GpuDevice, testing::OPTIONS},
    synthetic::{self, light},
};
use corf_scene::{Keyframe, Light, Pinhole, Raster};

/// Relative difference of inverse depths within which two devices agree: a parabola through scores that differ by rounding, 1e-5 of a correlation.
const TOLERANCE: f32 = 1e-3;
/// Largest share of pixels that one device matches and the other does not, or that they put to depths further apart.
const DIFFERING: f64 = 0.003;

struct Setup {
    keyframes: Vec<Keyframe>,
    views: Vec<GreyView>,
    config: DepthConfig,
}

impl Setup {
    fn radio() -> Pinhole {
        Pinhole::from_horizontal_fov(48, 32, 90.0)
    }

    /// A walk of which every camera sees `mask` of its image, if given.
    fn new(width: usize, height: usize, mask: Option<&Raster<bool>>) -> Self {
        let camera = Pinhole::from_horizontal_fov(width, height, 90.0);
        let keyframes: Vec<Keyframe> =
            (0..6).map(|i| synthetic::keyframe(i, synthetic::pose(i as f64 * 1.5), &camera, &Self::radio(), true)).collect();
        let view = |k: &Keyframe| {
            let seen = Light { mask: mask.cloned(), ..light(k).clone() };
            GreyView::of(k.index, k.world_from_camera, &seen, camera)
        };
        Self { views: keyframes.iter().map(view).collect(), keyframes, config: DepthConfig::default() }
    }

    fn neighbours(&self) -> (&GreyView, Vec<Neighbour<'_>>) {
        let (reference, others) = self.views.split_last().unwrap();
        (reference, select_neighbours(reference, others, 4.0, 6))
    }

    fn prior(&self) -> AlignedPrior {
        let (reference, near) = self.neighbours();
        let mono = SimulatedPrior::new(PriorPreset::Default, 5).estimate(reference.index, light(&self.keyframes[5])).unwrap();
        let corners = find_corners(&ProcessorMatcher, reference, &near, &self.config).unwrap().depths;
        align(&mono, &corners, &self.config).unwrap()
    }

    /// Pixels all over the image, its borders included.
    fn pixels(&self, count: usize) -> Vec<(usize, usize)> {
        let (width, height) = (self.views[0].fine.width(), self.views[0].fine.height());
        (0..count).map(|i| ((i * 37) % width, (i * 53) % height)).collect()
    }
}

/// A matcher that may keep so many bytes of views.
fn matcher(bytes: u64) -> Option<GpuMatcher> {
    corf_gpu::testing::context(&OPTIONS.adapter)?;
    Some(GpuMatcher::new(&OPTIONS.adapter, Budget::new(bytes)).unwrap())
}

/// Compares answers pixel by pixel.
fn compare(what: &str, ours: &[Option<f32>], theirs: &[Option<f32>], least_found: usize) {
    assert_eq!(ours.len(), theirs.len());
    let differ = |(a, b): &(&Option<f32>, &Option<f32>)| match (a, b) {
        (Some(a), Some(b)) => (a / b - 1.0).abs() > TOLERANCE,
        (None, None) => false,
        _ => true,
    };
    let found = theirs.iter().flatten().count();
    let differing = ours.iter().zip(theirs).filter(differ).count();
    let moved = |(a, b): (&Option<f32>, &Option<f32>)| Some(((*a)? / (*b)? - 1.0).abs());
    let mut moves: Vec<f32> = ours.iter().zip(theirs).filter_map(moved).collect();
    moves.sort_unstable_by(f32::total_cmp);
    eprintln!("{what}: {differing} of {} differ, {found} found, median {:e}", ours.len(), moves[moves.len() / 2]);
    assert!(found >= least_found, "{what}: {found} found");
    assert!(differing as f64 <= DIFFERING * ours.len() as f64, "{what}: {differing} of {} differ", ours.len());
}

/// Depths at pixels, those of them that have one of a kind.
fn at(pixels: &[(usize, usize)], depths: &[PixelDepth], kind: Reliability) -> Vec<Option<f32>> {
    let find = |&(x, y): &(usize, usize)| depths.iter().find(|d| (d.x, d.y) == (x, y) && d.reliability == kind);
    pixels.iter().map(|p| find(p).map(|d| d.inverse_depth)).collect()
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn guided_matches_are_the_processors() {
    let Some(gpu) = matcher(u64::MAX) else { return };
    for (width, height, count, candidates) in [(193, 107, 3000, 16), (640, 360, 1500, 16), (193, 107, 500, 37)] {
        let mut s = Setup::new(width, height, None);
        s.config.match_candidates = candidates;
        let prior = s.prior();
        let (reference, near) = s.neighbours();
        let pixels = s.pixels(count);
        let [ours, theirs] = [&gpu as &dyn Matcher, &ProcessorMatcher]
            .map(|m| match_guided(m, reference, &near, &prior, &pixels, s.config.match_range, &s.config).unwrap().depths);
        for (kind, least) in [(Reliability::Accurate, count / 5), (Reliability::Prior, count / 50)] {
            let [a, b] = [&ours, &theirs].map(|depths| at(&pixels, depths, kind));
            compare(&format!("{width}, {candidates} candidates, {kind:?}"), &a, &b, least);
        }
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn corners_and_matches_without_a_prior_are_the_processors() {
    let Some(gpu) = matcher(u64::MAX) else { return };
    for (width, height) in [(192, 108), (641, 361)] {
        let s = Setup::new(width, height, None);
        let (reference, near) = s.neighbours();
        let [ours, theirs] =
            [&gpu as &dyn Matcher, &ProcessorMatcher].map(|m| find_corners(m, reference, &near, &s.config).unwrap().depths);
        let mut places: Vec<(usize, usize)> = ours.iter().chain(&theirs).map(|c| (c.x, c.y)).collect();
        places.sort_unstable();
        places.dedup();
        let of = |corners: &[SparseDepth]| -> Vec<Option<f32>> {
            places.iter().map(|p| corners.iter().find(|c| (c.x, c.y) == *p).map(|c| c.inverse_depth)).collect()
        };
        compare(&format!("{width}, corners"), &of(&ours), &of(&theirs), 150);
        let pixels = s.pixels(1500);
        let [ours, theirs] = [&gpu as &dyn Matcher, &ProcessorMatcher]
            .map(|m| match_wide(m, reference, &near, &pixels, &s.config).unwrap().depths);
        let [a, b] = [&ours, &theirs].map(|depths| at(&pixels, depths, Reliability::Accurate));
        compare(&format!("{width}, wide"), &a, &b, 200);
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn what_does_not_count_is_matched_on_neither() {
    let Some(gpu) = matcher(u64::MAX) else { return };
    let mask = Raster::from_fn(192, 108, |x, y| !((70..130).contains(&x) && (30..80).contains(&y)) && (x * y) % 997 != 1);
    let s = Setup::new(192, 108, Some(&mask));
    let (reference, near) = s.neighbours();
    let pixels = s.pixels(3000);
    let [ours, theirs] =
        [&gpu as &dyn Matcher, &ProcessorMatcher].map(|m| match_wide(m, reference, &near, &pixels, &s.config).unwrap().depths);
    assert!(ours.iter().all(|d| !((67..133).contains(&d.x) && (27..83).contains(&d.y))));
    let [a, b] = [&ours, &theirs].map(|depths| at(&pixels, depths, Reliability::Accurate));
    compare("masked", &a, &b, 150);
}

/// The same bytes each time, whether views are kept or sent with the question, by all of a question's pixels or by some.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn answers_have_the_same_bytes_wherever_views_are_kept() {
    let (Some(roomy), Some(tight)) = (matcher(u64::MAX), matcher(400_000)) else { return };
    let mask = Raster::from_fn(192, 108, |x, y| (x + y) % 61 != 0);
    for mask in [None, Some(&mask)] {
        let mut s = Setup::new(192, 108, mask);
        let pixels = s.pixels(1500);
        let bits = |found: Vec<Option<f32>>| -> Vec<Option<u32>> { found.into_iter().map(|w| w.map(f32::to_bits)).collect() };
        let start = |&(x, y): &(usize, usize)| Start { x, y, guess: 0.25, slope: glam::Vec2::new(1e-4, -2e-4) };
        let starts: Vec<Start> = pixels.iter().map(start).collect();
        let ask = |s: &Setup, gpu: &GpuMatcher, starts: &[Start]| {
            let (reference, near) = s.neighbours();
            let coarse: Vec<(usize, usize)> = starts.iter().map(|s| (s.x, s.y)).collect();
            let guided = gpu.guided(reference, &near, starts, 0.3, &s.config).unwrap().depths;
            (bits(guided), bits(gpu.sweep(reference, &near, &coarse, &s.config).unwrap().depths))
        };
        let first = ask(&s, &roomy, &starts);
        assert!(first.0.iter().flatten().count() > 50 && first.1.iter().flatten().count() > 50);
        assert!(first == ask(&s, &roomy, &starts), "once more");
        assert!(first.0[700..] == ask(&s, &roomy, &starts[700..]).0, "some of them");
        for (gpu, least) in [(&roomy, 6), (&tight, 1)] {
            for view in &mut s.views {
                view.held = None;
                view.held = gpu.hold(view).unwrap();
            }
            let held = s.views.iter().filter(|v| v.held.is_some()).count();
            assert!(held >= least && (held == 6) == (least == 6), "{held} views are kept");
            assert!(first == ask(&s, gpu, &starts), "{held} views are kept");
        }
        // Views of another matcher are sent.
        assert!(first == ask(&s, &roomy, &starts));
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn nothing_is_found_without_neighbours_or_pixels() {
    let Some(gpu) = matcher(u64::MAX) else { return };
    let s = Setup::new(96, 64, None);
    let (reference, near) = s.neighbours();
    let start = Start { x: 50, y: 30, guess: 0.25, slope: glam::Vec2::ZERO };
    assert_eq!(gpu.guided(reference, &[], &[start], 0.2, &s.config).unwrap().depths, [None]);
    assert_eq!(gpu.guided(reference, &near, &[], 0.2, &s.config).unwrap().depths, []);
    // Beyond the images.
    assert_eq!(gpu.sweep(reference, &near, &[(96, 64), (2, 30), (400, 3)], &s.config).unwrap().depths, [None; 3]);
}

/// Born Gaussians of whole keyframes, matched on the device and on the processor beside the same device.
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_field_is_born_alike() {
    use crate::{OptimizerConfig, RasterConfig, ReconstructionConfig, Reconstructor};
    /// Difference of born Gaussians and of accurate ones, as a share: pixels that differ, and what follows from them in later keyframes.
    const BORN: f64 = 0.01;
    if corf_gpu::testing::context(&OPTIONS.adapter).is_none() {
        return;
    }
    let s = Setup::new(192, 108, None);
    for prior in [crate::config::DepthPriorKind::Simulated, crate::config::DepthPriorKind::None] {
        let run = |on: MatchedOn| {
            let mut config = ReconstructionConfig { iterations_per_keyframe: 2, ..ReconstructionConfig::default() };
            (config.depth.prior, config.depth.matched_on) = (prior, on);
            let device =
                GpuDevice::new(&OPTIONS, OptimizerConfig::default(), RasterConfig::default(), &config.empty_field()).unwrap();
            let (camera, radio) = (s.views[0].fine_camera, Setup::radio());
            let mut reconstructor = Reconstructor::new(Box::new(device), config, camera, radio, synthetic::DB_RANGE, 3).unwrap();
            let reports: Vec<_> = s.keyframes.iter().map(|k| reconstructor.push(k).unwrap()).collect();
            let spawned: usize = reports.iter().map(|r| r.spawned).sum();
            let accurate: f64 = reports.iter().map(|r| r.accurate_share * r.spawned as f64).sum();
            let timed = reconstructor.timings().iter().all(|t| t.match_s > 0.0);
            assert!(timed, "{:?}", reconstructor.timings());
            (spawned as f64, accurate, reconstructor.field().unwrap().gaussians)
        };
        let (ours, again, theirs) = (run(MatchedOn::Device), run(MatchedOn::Device), run(MatchedOn::Processor));
        assert!(ours.2 == again.2, "the same bytes each time");
        eprintln!("{prior:?}: {} and {} born, {} and {} accurate", ours.0, theirs.0, ours.1, theirs.1);
        assert!(theirs.0 > 500.0 && theirs.1 > 300.0, "{} {}", theirs.0, theirs.1);
        assert!((ours.0 / theirs.0 - 1.0).abs() < BORN && (ours.1 / theirs.1 - 1.0).abs() < BORN);
    }
}
