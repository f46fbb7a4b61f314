//! RF images by the recipe of published sets, to be compared with them and not to be measured on.
//!
//! 1. Every path's amplitude |a| (not its power) is added to an equirectangular grid of 3 pixels per degree in the array's frame, spread by
//!    a Gaussian of 3 pixels whose 9×9 weights sum to 1.
//! 2. 10·log10 of the sums: half the decibels of the power.
//! 3. Clipped to the range found at a few probed positions, coloured by Jet, 8 bit.
//! 4. The colours, not the values, are resampled bilinearly at the camera's pixels.
//!
//! The `tests` of this module measure the errors of this recipe.

use crate::radio::Arrival;
use corf_scene::keyframe::DbRange;
use corf_scene::model::{ARRAY_FROM_CAMERA, world_from_array};
use corf_scene::{Equirectangular, Pinhole, Raster, Rigid3};

/// 3 pixels per degree.
const SPHERE: Equirectangular = Equirectangular { width: 1080, height: 540 };
/// Standard deviation of a path's blob, pixels.
const SIGMA_PIXELS: f64 = 3.0;
/// Pixels of a blob to each side of its middle.
const REACH: isize = 4;

/// The amplitude sums of step 1.
#[derive(Clone, Debug)]
pub struct TutorialSphere {
    sums: Raster<f32>,
}

impl TutorialSphere {
    /// Sums of the arrivals at a camera's pose. They depend on how finely diffuse power is split into arrivals: amplitudes do not add up to
    /// the same whole.
    pub fn new(arrivals: &[Arrival], world_from_camera: &Rigid3) -> Self {
        let array_from_world = world_from_array(world_from_camera).transpose();
        let kernel = kernel();
        let mut sums = vec![0f64; SPHERE.width * SPHERE.height];
        let (width, height) = (SPHERE.width as isize, SPHERE.height as isize);
        for arrival in arrivals.iter().filter(|a| a.power > 0.0) {
            let at = SPHERE.project(array_from_world * arrival.direction);
            let (x, y) = (at.x as isize, at.y as isize);
            let amplitude = arrival.power.sqrt();
            for (i, weight) in kernel.iter().enumerate() {
                let side = 2 * REACH + 1;
                let (column, row) = (x + i as isize % side - REACH, y + i as isize / side - REACH);
                let (column, row) = (column.rem_euclid(width), row.clamp(0, height - 1));
                sums[(row * width + column) as usize] += amplitude * weight;
            }
        }
        Self { sums: Raster::from_vec(SPHERE.width, SPHERE.height, sums.into_iter().map(|v| v as f32).collect()) }
    }

    /// The range of step 3 from a few probes; `None` where they receive nothing.
    pub fn range(probes: &[Self]) -> Option<DbRange> {
        let db = |sum: f32| 10.0 * f64::from(sum).log10();
        let filled = || probes.iter().flat_map(|p| p.sums.pixels()).copied().filter(|v| *v > 0.0);
        let (min, max) = filled().fold((f32::INFINITY, 0f32), |(min, max), v| (min.min(v), max.max(v)));
        (max > min).then(|| DbRange { min_db: db(min), max_db: db(max) })
    }

    /// The image of steps 2 to 4.
    pub fn image(&self, range: &DbRange, camera: &Pinhole) -> Raster<[u8; 3]> {
        let colours = range.jet_image(&self.sums);
        Raster::from_fn(camera.width, camera.height, |x, y| {
            let [r, g, b] = bilinear(camera, x, y, |i| colours.pixels()[i].map(f32::from));
            [r, g, b].map(|v| (v + 0.5) as u8)
        })
    }

    /// Image of the scalar values, resampled bilinearly before any colouring: a correct step 4, for comparison.
    #[cfg(test)]
    fn scalar(&self, range: &DbRange, camera: &Pinhole) -> Raster<f32> {
        Raster::from_fn(camera.width, camera.height, |x, y| bilinear(camera, x, y, |i| [range.scalar(self.sums.pixels()[i])])[0])
    }
}

/// The weights of one blob, by rows; they sum to 1.
fn kernel() -> Vec<f64> {
    let weight = |dx: isize, dy: isize| (-0.5 * (dx * dx + dy * dy) as f64 / (SIGMA_PIXELS * SIGMA_PIXELS)).exp();
    let all: Vec<f64> = (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| weight(dx, dy))).collect();
    let sum: f64 = all.iter().sum();
    all.into_iter().map(|w| w / sum).collect()
}

/// Bilinear interpolation between the sphere's pixels in the direction of camera pixel `(x, y)`; `value` gives a pixel's value by index.
fn bilinear<const N: usize>(camera: &Pinhole, x: usize, y: usize, value: impl Fn(usize) -> [f32; N]) -> [f32; N] {
    let at = SPHERE.project(ARRAY_FROM_CAMERA.rotation * camera.pixel_direction(x, y));
    let (u, v) = (at.x - 0.5, at.y - 0.5);
    let mut sum = [0f32; N];
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let weight = (if dx == 0 { 1.0 - u.rem_euclid(1.0) } else { u.rem_euclid(1.0) })
            * (if dy == 0 { 1.0 - v.rem_euclid(1.0) } else { v.rem_euclid(1.0) });
        let column = (u.floor() as isize + dx).rem_euclid(SPHERE.width as isize) as usize;
        let row = (v.floor() as isize + dy).clamp(0, SPHERE.height as isize - 1) as usize;
        sum.iter_mut().zip(value(row * SPHERE.width + column)).for_each(|(s, v)| *s += weight as f32 * v);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::mpc;
    use corf_scene::color::{jet, quantize8, scalar_from_jet};
    use glam::DVec3;

    /// The 8-bit colour of a scalar in `[0, 1]`.
    fn colour(scalar: f32) -> [u8; 3] {
        jet(scalar).map(quantize8)
    }

    fn camera() -> Pinhole {
        Pinhole::from_horizontal_fov(96, 64, 90.0)
    }

    fn pose() -> Rigid3 {
        Rigid3::looking_at(DVec3::ZERO, DVec3::X, DVec3::Z)
    }

    /// The direction of a pixel's centre, world frame.
    fn through(x: usize, y: usize) -> DVec3 {
        pose().rotation * camera().pixel_direction(x, y)
    }

    fn arrival(direction: DVec3, power: f64) -> Arrival {
        Arrival { direction, power, delay_s: 0.0, object: 0, phase_rad: None }
    }

    fn db_at(sphere: &TutorialSphere, direction: DVec3) -> f64 {
        let p = SPHERE.project(direction);
        10.0 * f64::from(sphere.sums[(p.x as usize, p.y as usize)]).log10()
    }

    #[test]
    fn decibels_are_halved() {
        // Two paths 40 dB apart: 40 dB in the spectrum, 20 dB here.
        let (a, b) = (through(20, 30), through(70, 30));
        let arrivals = [arrival(a, 1e-8), arrival(b, 1e-12)];
        let ours = mpc(&arrivals, &camera(), &pose(), 1.0);
        let difference = 10.0 * f64::from(ours[(20, 30)] / ours[(70, 30)]).log10();
        assert!((difference - 40.0).abs() < 0.01, "{difference}");
        let sphere = TutorialSphere::new(&arrivals, &pose());
        let theirs = db_at(&sphere, a) - db_at(&sphere, b);
        assert!((theirs - 20.0).abs() < 0.01, "{theirs}");
    }

    #[test]
    fn the_sum_depends_on_how_diffuse_power_is_split() {
        // The same power as 100 arrivals instead of one: the spectrum stays, this rises by 5·log10(100) = 10 dB.
        let direction = through(48, 32);
        let (one, many) = (vec![arrival(direction, 1e-9)], vec![arrival(direction, 1e-11); 100]);
        let spectrum = |arrivals: &[Arrival]| mpc(arrivals, &camera(), &pose(), 1.0)[(48, 32)];
        assert!((spectrum(&many) / spectrum(&one) - 1.0).abs() < 1e-4);
        let tutorial = |arrivals: &[Arrival]| db_at(&TutorialSphere::new(arrivals, &pose()), direction);
        assert!((tutorial(&many) - tutorial(&one) - 10.0).abs() < 0.01);
    }

    #[test]
    fn peaks_above_the_probes_are_clipped_into_one_image() {
        let at = through(48, 32);
        let range = TutorialSphere::range(&[TutorialSphere::new(&[arrival(at, 1e-9), arrival(through(10, 10), 1e-13)], &pose())])
            .unwrap();
        let image = |power: f64| TutorialSphere::new(&[arrival(at, power)], &pose()).image(&range, &camera());
        // 12 and 18 dB more power are the same pixel, the colour of scalar 1; the dataset's own range never clips.
        assert_eq!(image(16e-9)[(48, 32)], colour(1.0));
        assert_eq!(image(16e-9)[(48, 32)], image(64e-9)[(48, 32)]);
        let clipped = |power: f64| image(power).pixels().iter().filter(|c| **c == colour(1.0)).count();
        assert!(clipped(64e-9) > clipped(1e-9) + 4, "{} {}", clipped(64e-9), clipped(1e-9));
        let peak = mpc(&[arrival(at, 64e-9)], &camera(), &pose(), 1.0)[(48, 32)];
        let own = DbRange { max_db: (10.0 * f64::from(peak).log10()).ceil(), min_db: -100.0 };
        assert!(own.scalar(peak) < 1.0 && own.scalar(peak / 4.0) < own.scalar(peak));
    }

    #[test]
    fn colours_mixed_in_resampling_belong_to_no_value() {
        let arrivals: Vec<Arrival> = (0..400)
            .map(|i| {
                let mut rng = corf_scene::Rng::keyed(61, 0, i);
                arrival(DVec3::new(1.0, rng.normal(), 0.5 * rng.normal()).normalize(), 10f64.powf(-8.0 - 5.0 * rng.uniform_f64()))
            })
            .collect();
        let sphere = TutorialSphere::new(&arrivals, &pose());
        let range = TutorialSphere::range(std::slice::from_ref(&sphere)).unwrap();
        let (image, scalar) = (sphere.image(&range, &camera()), sphere.scalar(&range, &camera()));
        let mut far = 0;
        let mut worst = 0f32;
        for (colour, truth) in image.pixels().iter().zip(scalar.pixels()) {
            let error = (scalar_from_jet(colour.map(|v| f32::from(v) / 255.0)) - truth).abs();
            worst = worst.max(error);
            far += usize::from(error > 0.05);
        }
        // Where a blob's edge meets the empty ground, red over blue reads as anything: more than a tenth of the range.
        assert!(worst > 0.1, "{worst}");
        assert!(far > 60, "{far}");
        // Resampled before colouring, 8 bits of Jet give every value back within 2 %.
        let exact = scalar.map(|s| colour(*s));
        let lost =
            exact.pixels().iter().zip(scalar.pixels()).map(|(c, s)| (scalar_from_jet(c.map(|v| f32::from(v) / 255.0)) - s).abs());
        assert!(lost.fold(0f32, f32::max) < 0.02);
    }
}
