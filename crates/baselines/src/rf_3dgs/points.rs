//! The first Gaussians of an offline reconstruction: sparse points with colours. Published methods take them from structure from motion; here
//! poses are known, so corners are triangulated with the neighbouring keyframes. The ray tracer's depth is not read.

use super::nearest::mean_squared_distance_to_3;
use crate::stage;
use corf::{
    Error, Gaussians, Result,
    config::DepthConfig,
    depth::{self, GreyView},
    gaussians::{SH_C0, logit},
};
use corf_scene::dataset::FixedArray;
use corf_scene::words::counted;
use corf_scene::{Light, Pinhole, Raster, Rigid3, Rng, io::write_atomic};
use glam::{DQuat, DVec3};
use std::path::Path;

/// A point with its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// World frame, metres.
    pub position: [f32; 3],
    /// 8-bit sRGB.
    pub color: [u8; 3],
}

/// Fewer points than this are no beginning.
pub const LEAST_POINTS: usize = 16;
/// Squared distances between points are not taken below this, as published, m².
const LEAST_SQUARED_M: f32 = 1e-7;

/// The scene's extent, which rates and sizes are fractions of: 1.1 times the largest distance of a camera from the mean of all, metres.
pub fn extent_m(poses: &[Rigid3]) -> f64 {
    let centre = centre(poses);
    1.1 * poses.iter().map(|p| (p.translation - centre).length()).fold(0.0, f64::max)
}

fn centre(poses: &[Rigid3]) -> DVec3 {
    poses.iter().map(|p| p.translation).sum::<DVec3>() / poses.len().max(1) as f64
}

/// A keyframe as points are made from it.
pub struct PointView {
    grey: GreyView,
    image: Raster<[u8; 3]>,
}

impl PointView {
    /// Of a training keyframe: its index, its pose and what its camera saw.
    pub fn new(index: usize, world_from_camera: Rigid3, light: Light, camera: Pinhole) -> Self {
        Self { grey: GreyView::of(index, world_from_camera, &light, camera), image: light.image }
    }
}

/// Corners of every view, triangulated on the processor with its neighbours among all of them, before or after it, in the views' order.
///
/// # Errors
/// None of the processor's.
pub fn triangulated(views: &[PointView]) -> Result<Vec<Point>> {
    let config = DepthConfig::default();
    let mut typical_depth_m = (config.near_m * config.far_m).sqrt();
    let mut out = Vec::new();
    for view in views {
        let reference = &view.grey;
        let others = views.iter().map(|v| &v.grey).filter(|v| v.index != reference.index);
        let neighbours = depth::select_neighbours(reference, others, typical_depth_m, config.neighbours);
        let corners = depth::triangulate(&depth::ProcessorMatcher, reference, &neighbours, &config)?.depths;
        let mut inverse: Vec<f32> = corners.iter().map(|c| c.inverse_depth).collect();
        inverse.sort_unstable_by(f32::total_cmp);
        if let Some(median) = inverse.get(inverse.len() / 2) {
            typical_depth_m = 1.0 / f64::from(*median);
        }
        out.extend(corners.iter().map(|corner| {
            let ray = reference.fine_camera.unproject(corner.x as f64 + 0.5, corner.y as f64 + 0.5);
            let p = reference.world_from_camera.transform_point(ray / f64::from(corner.inverse_depth));
            Point { position: p.as_vec3().to_array(), color: view.image[(corner.x, corner.y)] }
        }));
    }
    Ok(out)
}

/// Grey points, uniform in the cube of `half_side_m` around the cameras' mean.
pub fn random(poses: &[Rigid3], count: usize, half_side_m: f64, seed: u64) -> Vec<Point> {
    let centre = centre(poses);
    let point = |i: usize| {
        let mut rng = Rng::keyed(seed, stage::INITIAL_POINTS, i as u64);
        let offset = DVec3::from_array([0; 3].map(|_| half_side_m * (2.0 * rng.uniform_f64() - 1.0)));
        Point { position: (centre + offset).as_vec3().to_array(), color: [128; 3] }
    };
    (0..count).map(point).collect()
}

/// Points of any colour, normal around an array and mirrored to above it: what lies below is not in its spectrum.
pub fn above(array: &FixedArray, count: usize, spread_m: f64, seed: u64) -> Vec<Point> {
    let [x, y, z, w] = array.orientation_xyzw;
    let room_from_array = DQuat::from_xyzw(x, y, z, w).normalize();
    let point = |i: usize| {
        let mut rng = Rng::keyed(seed, stage::INITIAL_POINTS, i as u64);
        let [x, y, z] = [0; 3].map(|_| spread_m * rng.normal());
        let position = DVec3::from(array.position_m) + room_from_array * DVec3::new(x, y, z.abs());
        Point { position: position.as_vec3().to_array(), color: [0; 3].map(|_| (256.0 * rng.uniform_f64()) as u8) }
    };
    (0..count).map(point).collect()
}

/// The Gaussians that points become, of the channels and degrees of `none`: round, as wide as the mean (by squares) distance to the three nearest
/// others, of the point's colour in light and grey in RF.
///
/// # Errors
/// Fewer than [`LEAST_POINTS`].
pub fn gaussians(points: &[Point], none: Gaussians, initial_opacity: f32) -> Result<Gaussians> {
    if points.len() < LEAST_POINTS {
        let what = format!("only {} could be triangulated", counted(points.len(), "corner"));
        let help = "set initial_points = \"random\", or give overlapping images with structure";
        return Err(Error::invalid("the first Gaussians", what, help));
    }
    let mut out = none;
    out.position = points.iter().map(|p| p.position).collect();
    out.rotation = vec![[1.0, 0.0, 0.0, 0.0]; points.len()];
    let squared = mean_squared_distance_to_3(&out.position);
    out.log_scale = squared.iter().map(|d| [0.5 * d.max(LEAST_SQUARED_M).ln(); 3]).collect();
    for a in [&mut out.light, &mut out.radio] {
        a.opacity_logit = vec![logit(initial_opacity); points.len()];
        a.sh = vec![0.0; points.len() * a.stride()];
    }
    let stride = out.light.stride();
    for (sh, point) in out.light.sh.chunks_exact_mut(stride).zip(points) {
        for (value, color) in sh.iter_mut().zip(point.color) {
            *value = (f32::from(color) / 255.0 - 0.5) / SH_C0;
        }
    }
    Ok(out)
}

/// Writes points as a binary PLY of `x y z red green blue`, which other splatting programs begin with.
///
/// # Errors
/// When the file cannot be written.
pub fn write_ply(path: &Path, points: &[Point]) -> Result<()> {
    let mut out = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", points.len());
    ["x", "y", "z"].iter().for_each(|name| out.push_str(&format!("property float {name}\n")));
    ["red", "green", "blue"].iter().for_each(|name| out.push_str(&format!("property uchar {name}\n")));
    out.push_str("end_header\n");
    let mut out = out.into_bytes();
    for point in points {
        point.position.iter().for_each(|v| out.extend(v.to_le_bytes()));
        out.extend(point.color);
    }
    Ok(write_atomic(path, &out)?)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::{rf_3dgs::Rf3dgsConfig, synthetic};

    #[test]
    fn the_extent_is_a_tenth_more_than_the_farthest_camera() {
        let at = |x: f64, y: f64| Rigid3 { translation: DVec3::new(x, y, 0.0), ..Rigid3::IDENTITY };
        assert!((extent_m(&[at(0.0, 0.0), at(4.0, 0.0), at(2.0, 3.0)]) - 1.1 * 5.0f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn points_become_round_gaussians_of_their_colour() {
        let points: Vec<Point> = (0..27)
            .map(|i| Point { position: [i % 3, i / 3 % 3, i / 9].map(|v| 0.5 * v as f32), color: [255, 128, 0] })
            .collect();
        let config = Rf3dgsConfig::default();
        let g = gaussians(&points, config.empty_field(), config.initial_opacity).unwrap();
        // Three neighbours of a corner of the grid are half a metre away.
        assert!(g.log_scale.iter().all(|s| (s[0] - 0.5f32.ln()).abs() < 1e-6 && s[0] == s[1] && s[1] == s[2]));
        let shown = |c: usize| 0.5 + SH_C0 * g.light.sh[c];
        assert!((shown(0) - 1.0).abs() < 1e-6 && (shown(2)).abs() < 1e-6);
        assert!(g.radio.sh.iter().all(|v| *v == 0.0) && g.light.sh[3..48].iter().all(|v| *v == 0.0));
        let error = gaussians(&points[..5], config.empty_field(), config.initial_opacity).unwrap_err().to_string();
        assert!(error.contains("5 corners") && error.contains("random"), "{error}");
    }

    #[test]
    fn random_points_fill_the_cube_and_depend_on_the_seed() {
        let poses = [Rigid3 { translation: DVec3::new(10.0, -5.0, 1.0), ..Rigid3::IDENTITY }];
        let points = random(&poses, 5000, 2.0, 1);
        for (k, c) in [10.0, -5.0, 1.0].into_iter().enumerate() {
            let of = |pick: fn(f32, f32) -> f32| points.iter().map(|p| p.position[k] - c).reduce(pick).unwrap();
            assert!((-2.0..-1.99).contains(&of(f32::min)) && (1.99..=2.0).contains(&of(f32::max)));
        }
        assert!(random(&poses, 10, 2.0, 2)[..10] != points[..10] && random(&poses, 10, 2.0, 1)[..] == points[..10]);
    }

    #[test]
    fn triangulated_points_lie_on_what_was_seen() {
        let (camera, radio) = (Pinhole::from_horizontal_fov(160, 120, 80.0), Pinhole::from_horizontal_fov(12, 8, 80.0));
        let keyframes: Vec<_> =
            (0..6).map(|i| synthetic::keyframe(i, synthetic::pose(i as f64), &camera, &radio, true)).collect();
        let views: Vec<PointView> =
            keyframes.iter().map(|k| PointView::new(k.index, k.world_from_camera, synthetic::light(k).clone(), camera)).collect();
        let points = triangulated(&views).unwrap();
        assert!(points.len() > 100, "{} points", points.len());
        // Against the depth that the synthetic keyframes carry, which nothing above has looked at.
        let mut errors: Vec<f64> = points
            .iter()
            .map(|p| {
                keyframes
                    .iter()
                    .filter_map(|k| {
                        let seen = k.world_from_camera.inverse().transform_point(glam::Vec3::from(p.position).as_dvec3());
                        let u = camera.project(seen)?;
                        let depth = synthetic::light(k).depth_m.as_ref()?;
                        let inside = u.x >= 0.0 && u.y >= 0.0 && u.x < depth.width() as f64 && u.y < depth.height() as f64;
                        inside.then(|| (seen.z / f64::from(depth[(u.x as usize, u.y as usize)]) - 1.0).abs())
                    })
                    .fold(f64::INFINITY, f64::min)
            })
            .collect();
        errors.sort_by(f64::total_cmp);
        // Half a per cent in the median is what a sweep of 64 inverse depths with refinement gives on these images.
        assert!(errors[errors.len() / 2] < 0.01, "median error {}", errors[errors.len() / 2]);
    }

    #[test]
    fn the_file_has_the_columns_that_others_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        write_ply(&path, &[Point { position: [1.0, -2.0, 0.5], color: [1, 2, 255] }]).unwrap();
        let bytes = std::fs::read(path).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        assert!(String::from_utf8_lossy(&bytes[..end]).contains("element vertex 1\nproperty float x\n"));
        assert_eq!(
            bytes[end..],
            [&1.0f32.to_le_bytes()[..], &(-2.0f32).to_le_bytes(), &0.5f32.to_le_bytes(), &[1, 2, 255]].concat()
        );
    }
}
