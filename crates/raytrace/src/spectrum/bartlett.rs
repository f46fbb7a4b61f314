//! The noncoherent Bartlett spectrum of a planar array.

use super::pixel_directions;
use crate::radio::{Arrival, Complex, PlanarArray};
pub use corf_scene::config::RearHalfSpace;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Pinhole, Raster, Rigid3};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// The noncoherent Bartlett spectrum P(u) = Σ_i |a_i|²·|w(u)ᴴv(u_i)|² / N², v_m(u) = exp(j2π p_m·u), w = v.
///
/// On a uniform grid of elements |wᴴv|² is a sum over element lags (l_y, l_z), so the arrivals condense into (2C−1)×(2R−1) lag
/// covariances, whose number does not depend on theirs; nothing is approximated.
#[derive(Clone, Debug)]
pub struct Bartlett {
    array: PlanarArray,
    /// Lags l_y ∈ (−C, C) × l_z ∈ (−R, R), weighted by the number of element pairs; the half with l_y ≥ 0 is kept.
    lags: Vec<Complex>,
}

/// Arrivals a task condenses; fixed, so that sums come out the same for any thread count.
const ARRIVALS_PER_TASK: usize = 2048;

impl Bartlett {
    /// Condenses the arrivals for an array with orientation `world_from_array` (boresight +x, columns along +y, rows down −z).
    pub fn new(arrivals: &[Arrival], array: PlanarArray, world_from_array: DMat3, rear: RearHalfSpace) -> Self {
        let array_from_world = world_from_array.transpose();
        let (columns, rows) = (array.columns, array.rows);
        let width = 2 * rows - 1;
        let partial: Vec<Vec<Complex>> = arrivals
            .par_chunks(ARRIVALS_PER_TASK)
            .map(|chunk| {
                let mut sums = vec![Complex::ZERO; columns * width];
                for arrival in chunk {
                    let u = array_from_world * arrival.direction;
                    if rear == RearHalfSpace::Gated && u.x <= 0.0 {
                        continue;
                    }
                    let [y, z] = array.phase_steps(u);
                    // Σ p·e^{−j(l_y·y + l_z·z)}
                    let step_z = Complex::new(z.cos(), -z.sin());
                    let start_z = Complex::new(0.0, z * (rows as f64 - 1.0)).exp();
                    for ly in 0..columns {
                        let mut term = Complex::new(0.0, -(ly as f64) * y).exp() * start_z * arrival.power;
                        for sum in &mut sums[ly * width..(ly + 1) * width] {
                            *sum = *sum + term;
                            term = term * step_z;
                        }
                    }
                }
                sums
            })
            .collect();
        let mut lags = vec![Complex::ZERO; columns * width];
        for sums in &partial {
            lags.iter_mut().zip(sums).for_each(|(lag, sum)| *lag = *lag + *sum);
        }
        let elements2 = ((columns * rows) as f64).powi(2);
        for (i, lag) in lags.iter_mut().enumerate() {
            let (ly, lz) = (i / width, (i % width) as f64 - (rows as f64 - 1.0));
            // Element pairs at this lag; lags with l_y > 0 stand for their conjugates as well.
            let pairs = (columns - ly) as f64 * (rows as f64 - lz.abs()) * if ly > 0 { 2.0 } else { 1.0 };
            *lag = *lag * (pairs / elements2);
        }
        Self { array, lags }
    }

    /// Beam output towards a unit direction of the array frame, linear power: an arrival exactly there gives its |a|².
    pub fn power(&self, direction: DVec3) -> f64 {
        let (columns, rows) = (self.array.columns, self.array.rows);
        let width = 2 * rows - 1;
        let [y, z] = self.array.phase_steps(direction);
        let step_z = Complex::new(z.cos(), z.sin());
        let start_z = Complex::new(0.0, -z * (rows as f64 - 1.0)).exp();
        let mut sum = 0.0;
        for ly in 0..columns {
            let mut term = Complex::new(0.0, ly as f64 * y).exp() * start_z;
            for lag in &self.lags[ly * width..(ly + 1) * width] {
                // The real part of lag·e^{+j(l_y·y + l_z·z)}.
                sum += lag.re * term.re - lag.im * term.im;
                term = term * step_z;
            }
        }
        sum.max(0.0)
    }

    /// The spectrum of an array that shares its frame with a camera (boresight along the optical axis), at every pixel's centre.
    pub fn image(arrivals: &[Arrival], camera: &Pinhole, world_from_camera: &Rigid3, rear: RearHalfSpace) -> Raster<f32> {
        let array_from_camera = ARRAY_FROM_CAMERA.rotation;
        let world_from_array = world_from_camera.rotation * array_from_camera.transpose();
        let bartlett = Self::new(arrivals, PlanarArray::default(), world_from_array, rear);
        let pixels = pixel_directions(camera).into_par_iter().map(|d| bartlett.power(array_from_camera * d) as f32).collect();
        Raster::from_vec(camera.width, camera.height, pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some_arrivals(count: u64) -> Vec<Arrival> {
        (0..count)
            .map(|i| {
                let mut rng = corf_scene::Rng::keyed(11, 0, i);
                let direction = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
                Arrival { direction, power: 10f64.powf(-6.0 - 4.0 * rng.uniform_f64()), delay_s: 0.0, object: 0, phase_rad: None }
            })
            .collect()
    }

    #[test]
    fn lags_equal_the_sum_over_steering_vectors() {
        let arrivals = some_arrivals(5000);
        let array = PlanarArray::default();
        let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_y(-0.3);
        let bartlett = Bartlett::new(&arrivals, array, turn, RearHalfSpace::Aliased);
        for u in [DVec3::X, DVec3::new(0.5, 0.6, -0.3).normalize(), DVec3::new(0.1, -0.9, 0.4).normalize()] {
            let w = array.steering(u);
            let expected: f64 = arrivals
                .iter()
                .map(|a| {
                    let v = array.steering(turn.transpose() * a.direction);
                    let sum = w.iter().zip(&v).fold(Complex::ZERO, |s, (w, v)| s + Complex::new(w.re, -w.im) * *v);
                    a.power * sum.norm_squared() / 64f64.powi(2)
                })
                .sum();
            assert!((bartlett.power(u) / expected - 1.0).abs() < 1e-9, "{u}");
        }
    }

    #[test]
    fn one_path_gives_its_power_a_known_beam_width_and_nothing_behind() {
        let at = |direction| Arrival { direction, power: 2e-9, delay_s: 0.0, object: 0, phase_rad: None };
        let bartlett = Bartlett::new(&[at(DVec3::X)], PlanarArray::default(), DMat3::IDENTITY, RearHalfSpace::Gated);
        assert!((bartlett.power(DVec3::X) / 2e-9 - 1.0).abs() < 1e-12);
        // Eight half-wavelength elements: half power 6.40° off boresight (12.8° across).
        let off = 6.40f64.to_radians();
        let half = bartlett.power(DVec3::new(off.cos(), off.sin(), 0.0)) / 2e-9;
        assert!((half - 0.5).abs() < 2e-3, "{half}");
        let behind = Bartlett::new(&[at(-DVec3::X)], PlanarArray::default(), DMat3::IDENTITY, RearHalfSpace::Gated);
        assert_eq!(behind.power(DVec3::X), 0.0);
        let aliased = Bartlett::new(&[at(-DVec3::X)], PlanarArray::default(), DMat3::IDENTITY, RearHalfSpace::Aliased);
        assert!((aliased.power(DVec3::X) / 2e-9 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_image_peaks_at_the_pixel_of_the_path() {
        let camera = Pinhole::from_horizontal_fov(96, 64, 90.0);
        let pose = Rigid3::looking_at(DVec3::new(1.0, 2.0, 1.6), DVec3::new(4.0, 3.0, 1.5), DVec3::Z);
        let direction = DVec3::new(3.0, 2.0, 0.4).normalize();
        let arrivals = [Arrival { direction, power: 1.0, delay_s: 0.0, object: 0, phase_rad: None }];
        let image = Bartlett::image(&arrivals, &camera, &pose, RearHalfSpace::Gated);
        let peak = (0..96 * 64).max_by(|&a, &b| image.pixels()[a].total_cmp(&image.pixels()[b])).unwrap();
        let seen = camera.project(pose.rotation.transpose() * direction).unwrap();
        assert_eq!((peak % 96, peak / 96), (seen.x as usize, seen.y as usize));
    }
}
