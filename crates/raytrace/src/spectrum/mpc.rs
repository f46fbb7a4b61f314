//! The multipath-component spectrum: each arrival splatted at its angle with a narrow lobe.

use super::Grid;
use super::lobe::{Extent, Lobe, angle_of_chord2};
use super::narrow::pixel_means;
use crate::radio::Arrival;
use corf_scene::{Equirectangular, Pinhole, Raster, Rigid3};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Rows a task fills.
const ROWS_PER_TASK: usize = 4;

/// An arrival as a task needs it.
struct Splat {
    direction: Vec3,
    /// Peak of the lobe times the arrival's power, 1/sr.
    peak: f32,
    /// Squared chord beyond which nothing is added.
    cutoff_chord2: f32,
    pixels: Footprint,
}

/// The pixels that a lobe touches: a band of rows, and in it one run of columns or, across the seam of the sphere, two.
struct Footprint {
    rows: (u32, u32),
    columns: [Option<(u32, u32)>; 2],
}

/// Adds a lobe to a run of pixels. Every processor's version does the same operations and gives the same bits.
fn add_run(sums: &mut [f64], directions: [&[f32]; 3], splat: &Splat, half_kappa: f32) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return unsafe { add_run_avx2(sums, directions, splat, half_kappa) };
    }
    add_run_portable(sums, directions, splat, half_kappa);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn add_run_avx2(sums: &mut [f64], directions: [&[f32]; 3], splat: &Splat, half_kappa: f32) {
    add_run_portable(sums, directions, splat, half_kappa);
}

/// One loop without branches: vector code, four or eight pixels at a time.
#[inline(always)]
fn add_run_portable(sums: &mut [f64], [xs, ys, zs]: [&[f32]; 3], splat: &Splat, half_kappa: f32) {
    for (sum, ((x, y), z)) in sums.iter_mut().zip(xs.iter().zip(ys).zip(zs)) {
        let (dx, dy, dz) = (x - splat.direction.x, y - splat.direction.y, z - splat.direction.z);
        let chord2 = dx * dx + dy * dy + dz * dz;
        let value = splat.peak * exp_of_negative(-half_kappa * chord2);
        *sum += f64::from(if chord2 < splat.cutoff_chord2 { value } else { 0.0 });
    }
}

/// e^x for −80 ≤ x ≤ 0 within 3e-7, relative, in operations that vectorise: 2^t = 2^round(t) · 2^(t − round(t)), the latter by its series.
#[inline(always)]
fn exp_of_negative(x: f32) -> f32 {
    // Adding 1.5·2²³ rounds to the nearest integer and leaves it in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    const SERIES: [f32; 7] =
        [1.0, std::f32::consts::LN_2, 0.240_226_5, 0.055_504_11, 0.009_618_129, 0.001_333_355_8, 0.000_154_035_3];
    let t = (x * std::f32::consts::LOG2_E).max(-120.0);
    let shifted = t + ROUND;
    let f = t - (shifted - ROUND);
    let mut series = SERIES[6];
    for c in SERIES[..6].iter().rev() {
        series = series * f + c;
    }
    let exponent = (shifted.to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32);
    series * f32::from_bits(((exponent + 127) << 23) as u32)
}

/// Power per steradian (1/sr, relative to 1 W transmitted) at every pixel of a pinhole camera or of the whole sphere.
///
/// The lobe is the Gaussian of the sphere (von Mises–Fisher, κ = 1/σ²) of standard deviation `lobe_width_deg` per axis, whose integral
/// over solid angle is exactly 1. Values are those at the pixels' centres, or, where lobes are too narrow for these to sum up to the power
/// (under 0.6 of a pixel of the camera, or one row of the sphere), means over the pixels. Deterministic for any thread count.
pub fn mpc(arrivals: &[Arrival], grid: impl Into<Grid>, world_from_camera: &Rigid3, lobe_width_deg: f64) -> Raster<f32> {
    let grid: Grid = grid.into();
    let lobe = Lobe::new(lobe_width_deg);
    if lobe.is_resolved_by(&grid) {
        at_centres(arrivals, &grid, world_from_camera, &lobe)
    } else {
        pixel_means(arrivals, &grid, world_from_camera, &lobe)
    }
}

/// The values at the pixels' centres.
pub(super) fn at_centres(arrivals: &[Arrival], grid: &Grid, world_from_camera: &Rigid3, lobe: &Lobe) -> Raster<f32> {
    let (width, height) = (grid.width(), grid.height());
    let strongest = arrivals.iter().fold(0.0, |m: f64, a| m.max(a.power));
    let camera_from_world = world_from_camera.rotation.transpose();
    let splats: Vec<Splat> = arrivals
        .par_iter()
        .filter(|a| a.power > 0.0)
        .filter_map(|a| {
            let direction = camera_from_world * a.direction;
            let cutoff_chord2 = lobe.cutoff_chord2(a.power, strongest);
            let radius = angle_of_chord2(cutoff_chord2);
            let pixels = match grid {
                Grid::Pinhole(camera) => pinhole_footprint(camera, direction, radius)?,
                Grid::Sphere(sphere) => sphere_footprint(sphere, direction, radius),
            };
            Some(Splat {
                direction: direction.as_vec3(),
                peak: (a.power * lobe.peak) as f32,
                cutoff_chord2: cutoff_chord2 as f32,
                pixels,
            })
        })
        .collect();
    let directions = grid.directions();
    let [xs, ys, zs] = [0, 1, 2].map(|axis| directions.iter().map(|d| d[axis] as f32).collect::<Vec<f32>>());
    let half_kappa = (0.5 * lobe.kappa) as f32;
    let mut pixels = vec![0f32; width * height];
    pixels.par_chunks_mut(width * ROWS_PER_TASK).enumerate().for_each(|(task, band)| {
        let first_row = (task * ROWS_PER_TASK) as u32;
        let last_row = first_row + (band.len() / width) as u32 - 1;
        // Sums in f64: thousands of faint arrivals beside a strong one.
        let mut sums = vec![0f64; band.len()];
        for splat in splats.iter().filter(|s| s.pixels.rows.0 <= last_row && s.pixels.rows.1 >= first_row) {
            for row in splat.pixels.rows.0.max(first_row)..=splat.pixels.rows.1.min(last_row) {
                let base = row as usize * width;
                let offset = (row - first_row) as usize * width;
                for &(first, last) in splat.pixels.columns.iter().flatten() {
                    let (first, last) = (first as usize, last as usize);
                    let at = base + first..=base + last;
                    let run = [&xs[at.clone()], &ys[at.clone()], &zs[at]];
                    add_run(&mut sums[offset + first..=offset + last], run, splat, half_kappa);
                }
            }
        }
        band.iter_mut().zip(sums).for_each(|(pixel, sum)| *pixel = sum as f32);
    });
    Raster::from_vec(width, height, pixels)
}

/// The pixels whose centres a cone of half angle `radius` around a direction of the camera frame may touch; `None` outside the frame.
fn pinhole_footprint(camera: &Pinhole, direction: DVec3, radius: f64) -> Option<Footprint> {
    let extent = Extent::pinhole(camera, direction, radius)?;
    let within = |(low, high): (f64, f64), count: usize| {
        let (low, high, last) = (low - 0.5, high - 0.5, count as f64 - 1.0);
        (high >= 0.0 && low <= last).then(|| (low.max(0.0).floor() as u32, high.min(last).ceil() as u32))
    };
    let (columns, rows) = (within(extent.columns, camera.width)?, within(extent.rows, camera.height)?);
    Some(Footprint { rows, columns: [Some(columns), None] })
}

/// Pixels that a cone touches in an image of the sphere, whose columns wrap around.
fn sphere_footprint(sphere: &Equirectangular, direction: DVec3, radius: f64) -> Footprint {
    let (columns, rows) = Extent::sphere(sphere, direction, radius);
    let last = |count: usize| count as i64 - 1;
    // Pixel centres are at +0.5: this rounds outwards.
    let range = |(low, high): (f64, f64)| ((low - 0.5).floor() as i64, (high - 0.5).ceil() as i64);
    let (top, bottom) = range(rows);
    let rows = (top.clamp(0, last(sphere.height)) as u32, bottom.clamp(0, last(sphere.height)) as u32);
    let all = [Some((0, sphere.width as u32 - 1)), None];
    let Some(columns) = columns else { return Footprint { rows, columns: all } };
    let (left, right) = range(columns);
    let width = sphere.width as i64;
    let run = |a: i64, b: i64| Some((a as u32, b as u32));
    let columns = if right - left + 1 >= width {
        all
    } else if left < 0 {
        [run(left + width, width - 1), run(0, right)]
    } else if right >= width {
        [run(left, width - 1), run(0, right - width)]
    } else {
        [run(left, right), None]
    };
    Footprint { rows, columns }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_the_exponential() {
        for i in 0..80_000 {
            let x = -1e-3 * i as f32;
            let expected = f64::from(x).exp();
            assert!((f64::from(exp_of_negative(x)) / expected - 1.0).abs() < 5e-6, "{x}");
        }
    }

    /// The pixel sum over a lobe of 1.7 pixels' standard deviation approximates its integral this well.
    const QUADRATURE_TOLERANCE: f64 = 2e-3;

    /// The midpoint rule over rings of 0.5° around a pole is off by (0.5° / 2°)² / 24 for a lobe of 2°.
    const POLAR_QUADRATURE_TOLERANCE: f64 = 3e-3;

    fn arrival(direction: DVec3, power: f64) -> Arrival {
        Arrival { direction: direction.normalize(), power, delay_s: 0.0, object: 0, phase_rad: None }
    }

    #[test]
    fn the_solid_angle_integral_is_the_power() {
        let camera = Pinhole::from_horizontal_fov(192, 128, 90.0);
        for direction in [DVec3::Z, DVec3::new(0.6, -0.2, 1.0)] {
            let s = mpc(&[arrival(direction, 3e-9)], &camera, &Rigid3::IDENTITY, 1.0);
            let sum: f64 = (0..192 * 128).map(|i| f64::from(s.pixels()[i]) * camera.pixel_solid_angle_sr(i % 192, i / 192)).sum();
            assert!((sum / 3e-9 - 1.0).abs() < QUADRATURE_TOLERANCE, "{sum}");
        }
    }

    #[test]
    fn pruning_loses_nothing_inside_the_cutoff() {
        let camera = Pinhole::from_horizontal_fov(48, 32, 90.0);
        let mut rng = corf_scene::Rng::keyed(3, 0, 0);
        for _ in 0..200 {
            let d = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
            let s = mpc(&[arrival(d, 1.0)], &camera, &Rigid3::IDENTITY, 4.0);
            let kappa = 1.0 / 4f64.to_radians().powi(2);
            for (i, u) in Grid::from(&camera).directions().into_iter().enumerate() {
                let exponent = kappa * (1.0 - u.dot(d));
                if exponent < 18.0 {
                    let expected = kappa / std::f64::consts::TAU * (-exponent).exp();
                    assert!((f64::from(s.pixels()[i]) / expected - 1.0).abs() < 2e-3, "{d} pixel {i}");
                }
            }
        }
    }

    #[test]
    fn the_sphere_holds_all_power_wherever_it_comes_from() {
        let sphere = Equirectangular { width: 720, height: 360 };
        let mut rng = corf_scene::Rng::keyed(4, 0, 0);
        let mut directions: Vec<DVec3> = (0..12).map(|_| DVec3::new(rng.normal(), rng.normal(), rng.normal())).collect();
        // Both poles, beside one, the seam.
        directions.extend([DVec3::Y, DVec3::NEG_Y, DVec3::new(0.02, -1.0, 0.01), DVec3::NEG_Z, DVec3::new(0.001, 0.3, -1.0)]);
        for direction in directions {
            let s = mpc(&[arrival(direction, 3e-9)], &sphere, &Rigid3::IDENTITY, 2.0);
            let sum: f64 = (0..720 * 360).map(|i| f64::from(s.pixels()[i]) * sphere.pixel_solid_angle_sr(i / 720)).sum();
            assert!((sum / 3e-9 - 1.0).abs() < POLAR_QUADRATURE_TOLERANCE, "{direction}: {sum}");
        }
    }

    #[test]
    fn both_projections_show_the_same_spectrum() {
        // A camera of one narrow pixel looks where a pixel of the sphere is.
        let sphere = Equirectangular { width: 72, height: 60 };
        let arrivals: Vec<Arrival> = (0..200)
            .map(|i| {
                let mut rng = corf_scene::Rng::keyed(6, 0, i);
                arrival(DVec3::new(rng.normal(), rng.normal(), rng.normal()), rng.uniform_f64())
            })
            .collect();
        let pose = Rigid3::looking_at(DVec3::ZERO, DVec3::new(0.4, -1.0, 0.2), DVec3::Z);
        let whole = mpc(&arrivals, &sphere, &pose, 3.0);
        let pixel = Pinhole::from_horizontal_fov(1, 1, 2.0);
        for (x, y) in [(0, 0), (71, 59), (36, 18), (10, 7), (55, 30)] {
            let direction = pose.rotation * Grid::from(&sphere).directions()[y * 72 + x];
            let up = if direction.z.abs() > 0.9 { DVec3::X } else { DVec3::Z };
            let view = Rigid3::looking_at(DVec3::ZERO, direction, up);
            let single = mpc(&arrivals, &pixel, &view, 3.0)[(0, 0)];
            assert!((single / whole[(x, y)] - 1.0).abs() < 1e-4, "({x}, {y}): {single} {}", whole[(x, y)]);
        }
    }

    #[test]
    fn the_peak_is_at_the_arrival_and_turns_with_the_camera() {
        let camera = Pinhole::from_horizontal_fov(96, 64, 90.0);
        let pose = Rigid3::looking_at(DVec3::new(1.0, 2.0, 1.6), DVec3::new(4.0, 3.0, 1.5), DVec3::Z);
        let towards = DVec3::new(3.0, 2.0, 0.4).normalize();
        let s = mpc(&[arrival(towards, 1.0)], &camera, &pose, 1.0);
        let peak = (0..96 * 64).max_by(|&a, &b| s.pixels()[a].total_cmp(&s.pixels()[b])).unwrap();
        let seen = camera.project(pose.rotation.transpose() * towards).unwrap();
        assert_eq!((peak % 96, peak / 96), (seen.x as usize, seen.y as usize));
    }
}
