//! Lobes that are narrow beside the pixels: means over pixels instead of values at their centres.
//!
//! A lobe of a third of a pixel falls between the centres: their sum is up to 5 dB off its power, by where it stands. Here each lobe is
//! integrated over the part of each pixel that it reaches, so that Σ P·dΩ over the pixels is its power at any size of the image.

use super::Grid;
use super::lobe::{Extent, Lobe, angle_of_chord2};
use crate::radio::Arrival;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Pinhole, Raster, Rigid3};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Nodes and weights of Gauss and Legendre's rule of four points on [0, 1].
const NODES: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];
/// Widest cell to which the rule is applied, in standard deviations of the lobe: four points leave less than 2e-4 of it.
const CELL_SIGMAS: f64 = 2.5;
/// Widest cell around the axis of the sphere, radians.
const CELL_AZIMUTH: f64 = FRAC_PI_4;

/// An arrival as a row needs it.
struct Splat {
    direction: DVec3,
    /// Peak of the lobe times the arrival's power, 1/sr.
    peak: f64,
    columns: (f64, f64),
    rows: (f64, f64),
}

/// A rectangle of the image, pixels: columns and rows.
#[derive(Clone, Copy)]
struct Part {
    columns: (f64, f64),
    rows: (f64, f64),
}

/// The mean over every pixel's solid angle of the arrivals' lobes, 1/sr.
pub(super) fn pixel_means(arrivals: &[Arrival], grid: &Grid, world_from_camera: &Rigid3, lobe: &Lobe) -> Raster<f32> {
    let (width, height) = (grid.width(), grid.height());
    let strongest = arrivals.iter().fold(0.0, |m: f64, a| m.max(a.power));
    let camera_from_world = world_from_camera.rotation.transpose();
    let splats: Vec<Splat> = arrivals
        .par_iter()
        .filter(|a| a.power > 0.0)
        .filter_map(|a| {
            let direction = camera_from_world * a.direction;
            let radius = angle_of_chord2(lobe.cutoff_chord2(a.power, strongest));
            let (columns, rows) = match grid {
                Grid::Pinhole(camera) => {
                    let extent = Extent::pinhole(camera, direction, radius)?;
                    (within(extent.columns, width)?, extent.rows)
                }
                Grid::Sphere(sphere) => {
                    let (columns, rows) = Extent::sphere(sphere, direction, radius);
                    (columns.unwrap_or((0.0, width as f64)), rows)
                }
            };
            Some(Splat { direction, peak: a.power * lobe.peak, columns, rows: within(rows, height)? })
        })
        .collect();
    let row = |y: usize| {
        let mut sums = vec![0.0; width];
        for splat in &splats {
            let Some(rows) = overlap(splat.rows, y as i64) else { continue };
            for column in splat.columns.0.floor() as i64..=splat.columns.1.floor() as i64 {
                let Some(columns) = overlap(splat.columns, column) else { continue };
                sums[column.rem_euclid(width as i64) as usize] += integral(grid, lobe, splat, Part { columns, rows });
            }
        }
        sums.iter().enumerate().map(|(x, sum)| (sum / grid.pixel_solid_angle_sr(x, y)) as f32).collect::<Vec<f32>>()
    };
    let rows: Vec<Vec<f32>> = (0..height).into_par_iter().map(row).collect();
    Raster::from_vec(width, height, rows.concat())
}

/// An interval cut to an image's side; `None` outside of it.
fn within((low, high): (f64, f64), side: usize) -> Option<(f64, f64)> {
    let cut = (low.max(0.0), high.min(side as f64));
    (cut.0 < cut.1).then_some(cut)
}

/// The part of an interval that lies in one pixel.
fn overlap((low, high): (f64, f64), pixel: i64) -> Option<(f64, f64)> {
    let cut = (low.max(pixel as f64), high.min((pixel + 1) as f64));
    (cut.0 < cut.1).then_some(cut)
}

/// ∫ lobe dΩ over a part of a pixel.
fn integral(grid: &Grid, lobe: &Lobe, splat: &Splat, part: Part) -> f64 {
    let cells = cells(grid, lobe.sigma, part);
    let half_kappa = 0.5 * lobe.kappa;
    let mut sum = 0.0;
    for (v, weight_v) in points(part.rows, cells.1) {
        for (u, weight_u) in points(part.columns, cells.0) {
            let (direction, steradians) = measure(grid, u, v);
            let value = (-half_kappa * direction.distance_squared(splat.direction)).exp();
            sum += weight_u * weight_v * steradians * value;
        }
    }
    splat.peak * sum
}

/// The points of the rule on so many equal cells of an interval, with their weights.
fn points((low, high): (f64, f64), cells: usize) -> impl Iterator<Item = (f64, f64)> {
    let step = (high - low) / cells as f64;
    (0..cells).flat_map(move |i| NODES.map(|(at, weight)| (low + step * (i as f64 + at), step * weight)))
}

/// The unit direction of an image position, camera frame, and the solid angle of a square pixel there, steradians.
fn measure(grid: &Grid, u: f64, v: f64) -> (DVec3, f64) {
    match grid {
        Grid::Pinhole(camera) => {
            let p = camera.unproject(u, v);
            let length = p.length();
            (p / length, 1.0 / (camera.fx * camera.fy * length.powi(3)))
        }
        Grid::Sphere(sphere) => {
            let (width, height) = (sphere.width as f64, sphere.height as f64);
            let (sin_az, cos_az) = (PI - TAU * u / width).sin_cos();
            let (sin_el, cos_el) = (FRAC_PI_2 - PI * v / height).sin_cos();
            let direction = DVec3::new(cos_el * cos_az, cos_el * sin_az, sin_el);
            (ARRAY_FROM_CAMERA.rotation.transpose() * direction, cos_el * TAU / width * PI / height)
        }
    }
}

/// Into how many columns and rows a part is divided, so that no cell is wider than the rule integrates a lobe over.
fn cells(grid: &Grid, sigma: f64, part: Part) -> (usize, usize) {
    let (columns, rows) = (part.columns.1 - part.columns.0, part.rows.1 - part.rows.0);
    let count = |angle: f64| (angle / (CELL_SIGMAS * sigma)).ceil().max(1.0) as usize;
    match grid {
        Grid::Pinhole(camera) => {
            let (x, y) = nearest_to_axis(camera, part);
            // An image position moves the direction by √(1+y²)/(1+x²+y²) along x, at most by either of these.
            let along = |x: f64, y: f64| (1.0 / (1.0 + y * y).sqrt()).min(0.5 / x.max(f64::MIN_POSITIVE));
            (count(columns / camera.fx * along(x, y)), count(rows / camera.fy * along(y, x)))
        }
        Grid::Sphere(sphere) => {
            let row_rad = PI / sphere.height as f64;
            let azimuth = columns * TAU / sphere.width as f64;
            let elevation = |v: f64| FRAC_PI_2 - row_rad * v;
            let (top, bottom) = (elevation(part.rows.0), elevation(part.rows.1));
            let widest = if top * bottom <= 0.0 { 1.0 } else { top.abs().min(bottom.abs()).cos() };
            (count(azimuth * widest).max((azimuth / CELL_AZIMUTH).ceil() as usize), count(rows * row_rad))
        }
    }
}

/// |x| and |y| on the plane z = 1 of the point of a part nearest to the camera's axis.
fn nearest_to_axis(camera: &Pinhole, part: Part) -> (f64, f64) {
    let near = |(low, high): (f64, f64), centre: f64, focal: f64| (centre.clamp(low, high) - centre).abs() / focal;
    (near(part.columns, camera.cx, camera.fx), near(part.rows, camera.cy, camera.fy))
}

#[cfg(test)]
mod tests {
    use super::super::mpc;
    use super::*;
    use corf_scene::{Equirectangular, Rng};

    /// Tolerance of a sum over the pixels against the arrival's power, dB: that which users are promised.
    const TOLERANCE_DB: f64 = 0.2;
    /// Error of the mean of a lobe over pixels, dB: its tail beyond the cut-off of 80 dB, and the quadrature rule's error.
    const INTEGRATED_DB: f64 = 0.01;

    fn total_db(direction: DVec3, grid: Grid, lobe_deg: f64) -> f64 {
        let arrival = Arrival { direction: direction.normalize(), power: 3e-9, delay_s: 0.0, object: 0, phase_rad: None };
        let image = mpc(&[arrival], grid, &Rigid3::IDENTITY, lobe_deg);
        let width = grid.width();
        let sum: f64 = (0..width * grid.height())
            .map(|i| f64::from(image.pixels()[i]) * grid.pixel_solid_angle_sr(i % width, i / width))
            .sum();
        10.0 * (sum / 3e-9).log10()
    }

    #[test]
    fn the_sum_over_a_cameras_pixels_is_the_power_at_every_size_and_place_between_them() {
        let mut worst_at_centres = 0.0f64;
        for (width, height, fov_deg) in [
            (1, 1, 90.0),
            (2, 2, 60.0),
            (4, 3, 90.0),
            (8, 6, 90.0),
            (16, 12, 120.0),
            (32, 24, 90.0),
            (48, 32, 90.0),
            (96, 64, 90.0),
            (64, 48, 160.0),
        ] {
            let camera = Pinhole::from_horizontal_fov(width, height, fov_deg);
            for lobe_deg in [0.01, 0.1, 0.5, 1.0] {
                let resolved = Lobe::new(lobe_deg).is_resolved_by(&Grid::from(&camera));
                for i in 0..12 {
                    let mut rng = Rng::keyed(71, width as u64, i);
                    // Far enough from the frame's edge for all of the lobe to lie in it: 7 degrees.
                    let direction = loop {
                        let mut place = |side: usize| rng.uniform_f64() * side as f64;
                        let (u, v) = (place(width), place(height));
                        let p = camera.unproject(u, v).normalize();
                        let edges = [(0.0, v), (width as f64, v), (u, 0.0), (u, height as f64)];
                        if edges.iter().all(|(u, v)| p.angle_between(camera.unproject(*u, *v)) > 8f64.to_radians()) {
                            break p;
                        }
                    };
                    let error = total_db(direction, Grid::from(&camera), lobe_deg).abs();
                    let allowed = if resolved { 0.02 } else { INTEGRATED_DB };
                    assert!(error < allowed, "{width}x{height} {lobe_deg}°, {direction}: {error} dB");
                    if resolved {
                        worst_at_centres = worst_at_centres.max(error);
                    }
                }
            }
        }
        assert!(worst_at_centres < TOLERANCE_DB);
    }

    #[test]
    fn the_sum_over_the_spheres_pixels_is_the_power_at_poles_and_seam_too() {
        let mut directions =
            vec![DVec3::Y, DVec3::NEG_Y, DVec3::new(0.01, -1.0, 0.004), DVec3::NEG_Z, DVec3::new(1e-4, 0.3, -1.0)];
        directions.extend((0..10).map(|i| {
            let mut rng = Rng::keyed(72, 0, i);
            DVec3::new(rng.normal(), rng.normal(), rng.normal())
        }));
        for (width, height) in [(1, 1), (5, 3), (36, 18), (72, 36), (180, 90), (360, 180), (64, 200)] {
            let grid = Grid::Sphere(Equirectangular { width, height });
            for lobe_deg in [0.05, 1.0, 3.0] {
                let allowed = if Lobe::new(lobe_deg).is_resolved_by(&grid) { TOLERANCE_DB } else { INTEGRATED_DB };
                for direction in &directions {
                    let error = total_db(*direction, grid, lobe_deg).abs();
                    assert!(error < allowed, "{width}x{height} {lobe_deg}°, {direction}: {error} dB");
                }
            }
        }
    }

    #[test]
    fn just_under_the_threshold_centres_would_still_do_and_well_under_it_they_would_not() {
        // The threshold is where it has to be: at it the values at the centres are right, at half of it they are not.
        let camera = Pinhole::from_horizontal_fov(96, 64, 90.0);
        let worst = |pixels: f64| {
            let lobe = Lobe::new((pixels / camera.fx).to_degrees());
            let at = |i: usize| {
                let direction = camera.unproject(40.0 + 0.125 * (i % 8) as f64, 30.0 + 0.125 * (i / 8) as f64).normalize();
                let arrival = Arrival { direction, power: 1.0, delay_s: 0.0, object: 0, phase_rad: None };
                let image = super::super::mpc::at_centres(&[arrival], &Grid::from(&camera), &Rigid3::IDENTITY, &lobe);
                let sum: f64 =
                    (0..96 * 64).map(|i| f64::from(image.pixels()[i]) * camera.pixel_solid_angle_sr(i % 96, i / 96)).sum();
                (10.0 * sum.log10()).abs()
            };
            (0..64).map(at).fold(0.0, f64::max)
        };
        let (lobby_mini, at, half) = (worst(1f64.to_radians() * camera.fx), worst(0.6), worst(0.3));
        assert!(lobby_mini < 1e-3 && at < 0.02 && half > 2.0, "{lobby_mini} {at} {half} dB");
    }

    #[test]
    fn a_mean_over_a_pixel_is_the_mean_of_finer_pixels() {
        let (coarse, fine) = (Pinhole::from_horizontal_fov(24, 16, 90.0), Pinhole::from_horizontal_fov(240, 160, 90.0));
        let arrivals: Vec<Arrival> = (0..50)
            .map(|i| {
                let mut rng = Rng::keyed(73, 0, i);
                let direction = DVec3::new(rng.normal(), 0.5 * rng.normal(), 1.0).normalize();
                Arrival { direction, power: rng.uniform_f64(), delay_s: 0.0, object: 0, phase_rad: None }
            })
            .collect();
        let means = mpc(&arrivals, &coarse, &Rigid3::IDENTITY, 1.0);
        let values = mpc(&arrivals, &fine, &Rigid3::IDENTITY, 1.0);
        let peak = means.pixels().iter().copied().fold(0f32, f32::max);
        for y in 0..16 {
            for x in 0..24 {
                let (mut sum, mut steradians) = (0.0, 0.0);
                for i in 0..100 {
                    let (u, v) = (10 * x + i % 10, 10 * y + i / 10);
                    let solid_angle_sr = fine.pixel_solid_angle_sr(u, v);
                    sum += f64::from(values[(u, v)]) * solid_angle_sr;
                    steradians += solid_angle_sr;
                }
                let difference = (f64::from(means[(x, y)]) - sum / steradians).abs();
                assert!(difference < 5e-3 * f64::from(peak), "({x}, {y}): {difference} of {peak}");
            }
        }
    }
}
