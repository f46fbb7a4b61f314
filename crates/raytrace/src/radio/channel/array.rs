//! The channel between two planar arrays.
//!
//! Synthetic arrays: one path set between the centres, and a phase for every element's place, v_m(u) = e^{+j2πp_m·u} with p in wavelengths
//! at the carrier and u the direction in which the path leaves or from which it arrives. Right where the array is small against the
//! path's distances; it is what Sionna RT does by default.

use super::super::{AntennaArray, Arrival, Complex, Path};
use super::{ChannelRay, random_phase_rad};
use std::f64::consts::TAU;

/// A matrix between the ports of two arrays: one row a receive port, one column a transmit port.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelMatrix {
    /// Receive ports.
    pub rows: usize,
    /// Transmit ports.
    pub columns: usize,
    /// Row-major.
    pub values: Vec<Complex>,
}

impl ChannelMatrix {
    fn zero(rx: &AntennaArray, tx: &AntennaArray) -> Self {
        let (rows, columns) = (rx.ports(), tx.ports());
        Self { rows, columns, values: vec![Complex::ZERO; rows * columns] }
    }

    /// The entry of a receive and a transmit port.
    pub fn at(&self, row: usize, column: usize) -> Complex {
        self.values[row * self.columns + column]
    }

    /// ‖H‖²_F.
    pub fn norm_squared(&self) -> f64 {
        self.values.iter().map(|v| v.norm_squared()).sum()
    }
}

/// The link between two antenna arrays: its multipath, and the arrays at both ends.
///
/// Diffuse arrivals know from where they come, not to where they left, nor how their polarisation was turned: they get the receive
/// array's steering vector and an independent phase for every transmit port and receive polarisation, their power shared equally by the
/// polarisations. To the transmit array they are spatially white.
#[derive(Clone, Copy, Debug)]
pub struct ArrayLink<'l> {
    /// Resolved paths between the centres.
    pub paths: &'l [Path],
    /// Scattered power.
    pub diffuse: &'l [Arrival],
    /// Transmit array.
    pub tx: &'l AntennaArray,
    /// Receive array.
    pub rx: &'l AntennaArray,
    /// Seed of the phases of diffuse arrivals.
    pub seed: u64,
}

impl ArrayLink<'_> {
    /// The channel matrix at `frequency_hz`, the sum of [`Path::array_response`]·e^{−j2πfτ} over the paths; the elements' places are in
    /// wavelengths of the carrier and stay there.
    pub fn matrix(&self, frequency_hz: f64) -> ChannelMatrix {
        let mut sum = ChannelMatrix::zero(self.rx, self.tx);
        for path in self.paths {
            let turn = carried(frequency_hz, path.delay_s);
            sum.values.iter_mut().zip(path.array_response(self.tx, self.rx)).for_each(|(s, v)| *s = *s + v * turn);
        }
        let columns = sum.columns;
        for (i, arrival) in self.diffuse.iter().enumerate() {
            let v_rx = self.rx.steering(arrival.direction);
            for (rx_port, column) in (0..self.rx.element.ports()).flat_map(|r| (0..columns).map(move |column| (r, column))) {
                let gain = self.diffuse_gain(i, rx_port, column, frequency_hz);
                for (m, v_m) in v_rx.iter().enumerate() {
                    let at = (rx_port * v_rx.len() + m) * columns + column;
                    sum.values[at] = sum.values[at] + gain * *v_m;
                }
            }
        }
        sum
    }

    /// Rays between a receive and a transmit port: their sum is the ports' entry of [`Self::matrix`] at the carrier.
    pub fn rays(&self, row: usize, column: usize, carrier_hz: f64) -> Vec<ChannelRay> {
        let place = |array: &AntennaArray, port: usize| {
            let elements = array.ports() / array.element.ports();
            (port / elements, port % elements)
        };
        let ((rx_port, m), (tx_port, n)) = (place(self.rx, row), place(self.tx, column));
        let paths = self.paths.iter().map(|path| {
            let a = path.coefficient(&self.tx.element, tx_port, &self.rx.element, rx_port);
            let response = self.rx.steering(path.arrival)[m] * a * self.tx.steering(path.departure)[n];
            ChannelRay { gain: response * carried(carrier_hz, path.delay_s), delay_s: path.delay_s }
        });
        let diffuse = self.diffuse.iter().enumerate().map(|(i, arrival)| ChannelRay {
            gain: self.diffuse_gain(i, rx_port, column, carrier_hz) * self.rx.steering(arrival.direction)[m],
            delay_s: arrival.delay_s,
        });
        paths.chain(diffuse).collect()
    }

    /// Complex gain of a diffuse arrival from a transmit port to a receive polarisation.
    fn diffuse_gain(&self, index: usize, rx_port: usize, column: usize, frequency_hz: f64) -> Complex {
        let arrival = &self.diffuse[index];
        let link = (rx_port * self.tx.ports() + column) as u64;
        let phase = match arrival.phase_rad {
            Some(known) => Complex::new(0.0, known).exp(),
            None => {
                let drawn = random_phase_rad(self.seed, index as u64, link);
                Complex::new(0.0, drawn - TAU * (frequency_hz * arrival.delay_s).fract()).exp()
            }
        };
        phase * (arrival.power / self.rx.element.ports() as f64).sqrt()
    }
}

/// e^{−j2πfτ}.
fn carried(frequency_hz: f64, delay_s: f64) -> Complex {
    Complex::new(0.0, -TAU * (frequency_hz * delay_s).fract()).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::{Antenna, PlanarArray, Polarization, RadioSettings, RadioTracer, SPEED_OF_LIGHT};
    use corf_scene::Scene;
    use glam::{DMat3, DVec3};

    /// Rounding of 2πfτ at 60 GHz over metres.
    const ROUNDING: f64 = 1e-9;
    const F: f64 = 60e9;

    fn array(rows: usize, columns: usize, yaw_deg: f64) -> AntennaArray {
        AntennaArray {
            element: Antenna { world_from_antenna: DMat3::from_rotation_z(yaw_deg.to_radians()), ..Antenna::default() },
            grid: PlanarArray { rows, columns, ..PlanarArray::default() },
        }
    }

    fn between(paths: &[Path], diffuse: &[Arrival], tx: &AntennaArray, rx: &AntennaArray, seed: u64) -> ChannelMatrix {
        ArrayLink { paths, diffuse, tx, rx, seed }.matrix(F)
    }

    fn free_space(tx: DVec3, rx: DVec3) -> Vec<Path> {
        let scene = Scene { name: "empty".into(), ..Scene::default() };
        RadioTracer::without_bvh(&scene, RadioSettings::default()).unwrap().paths(tx, rx).unwrap()
    }

    #[test]
    fn elements_see_the_path_as_spheres_do_from_far_away() {
        // The exact channel of every element pair is λ/(4πd)·e^{−j2πd/λ} of its own distance. At 5 km the wave front's curvature over
        // an aperture of 2 cm bends the phase by π·D²/(λd) = 5e-5 rad.
        let (tx_at, rx_at) = (DVec3::new(-4000.0, 1000.0, 300.0), DVec3::new(900.0, 40.0, -60.0));
        let (tx, rx) = (array(2, 3, -20.0), array(4, 4, 170.0));
        let h = between(&free_space(tx_at, rx_at), &[], &tx, &rx, 0);
        let wavelength_m = SPEED_OF_LIGHT / F;
        let place = |a: &AntennaArray, centre: DVec3, i: usize| {
            centre + a.element.world_from_antenna * a.grid.positions()[i] * wavelength_m
        };
        let exact = |m: usize, n: usize| {
            let d = place(&rx, rx_at, m).distance(place(&tx, tx_at, n));
            Complex::new(0.0, -TAU * (d / wavelength_m).fract()).exp() * (wavelength_m / (4.0 * std::f64::consts::PI * d))
        };
        for m in 0..16 {
            for n in 0..6 {
                let error = (h.at(m, n) - exact(m, n)).norm() / h.at(m, n).norm();
                assert!(error < 3e-4, "{m} {n}: {error}");
            }
        }
    }

    #[test]
    fn phase_advances_by_half_a_wavelength_times_the_direction_cosine() {
        let paths = free_space(DVec3::new(3.0, 4.0, 0.0), DVec3::ZERO);
        let h = between(&paths, &[], &array(1, 1, 0.0), &array(8, 8, 0.0), 0);
        // Columns run along +y, rows down −z; u = (0.6, 0.8, 0): π·0.8 a column, nothing a row.
        for column in 0..7 {
            let step = h.at((column + 1) * 8, 0) / h.at(column * 8, 0);
            assert!((step - Complex::new(0.0, std::f64::consts::PI * 0.8).exp()).norm() < ROUNDING);
            assert!((h.at(column * 8 + 1, 0) - h.at(column * 8, 0)).norm() < ROUNDING * h.at(0, 0).norm());
        }
    }

    #[test]
    fn one_path_has_rank_one_and_the_power_of_all_pairs() {
        let paths = free_space(DVec3::new(3.0, 1.0, 0.5), DVec3::ZERO);
        let (tx, rx) = (array(2, 4, 200.0), array(3, 2, 10.0));
        let h = between(&paths, &[], &tx, &rx, 0);
        assert!((h.norm_squared() / (48.0 * paths[0].power()) - 1.0).abs() < ROUNDING);
        for m in 1..h.rows {
            for n in 1..h.columns {
                let minor = h.at(0, 0) * h.at(m, n) - h.at(0, n) * h.at(m, 0);
                assert!(minor.norm() < ROUNDING * h.at(0, 0).norm_squared());
            }
        }
    }

    #[test]
    fn aligned_polarisations_do_not_mix_in_free_space() {
        let dual = |yaw: f64| {
            let mut a = array(1, 1, yaw);
            a.element.polarization = Polarization::VH;
            a
        };
        let paths = free_space(DVec3::new(5.0, 0.0, 0.0), DVec3::ZERO);
        let h = between(&paths, &[], &dual(180.0), &dual(0.0), 0);
        assert_eq!((h.rows, h.columns), (2, 2));
        assert!(h.at(0, 1).norm() < 1e-12 * h.at(0, 0).norm() && h.at(1, 0).norm() < 1e-12 * h.at(0, 0).norm());
        assert!((h.at(1, 1).norm() / h.at(0, 0).norm() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn rays_between_two_ports_are_their_entry_of_the_matrix() {
        let paths = free_space(DVec3::new(3.0, 1.0, 0.5), DVec3::ZERO);
        let scattered = |direction: DVec3| Arrival { direction, power: 1e-8, delay_s: 2.2e-8, object: 0, phase_rad: None };
        let diffuse = [scattered(DVec3::Y), scattered(DVec3::NEG_X)];
        let (tx, mut rx) = (array(1, 2, 200.0), array(2, 1, 10.0));
        rx.element.polarization = Polarization::VH;
        let link = ArrayLink { paths: &paths, diffuse: &diffuse, tx: &tx, rx: &rx, seed: 3 };
        let h = link.matrix(F);
        for (row, column) in (0..4).flat_map(|row| [(row, 0), (row, 1)]) {
            let rays = link.rays(row, column, F);
            let sum = rays.iter().fold(Complex::ZERO, |sum, ray| sum + ray.gain);
            assert!((sum - h.at(row, column)).norm() < ROUNDING * 1e-4, "{row} {column}");
            assert_eq!(rays.iter().map(|ray| ray.delay_s).collect::<Vec<_>>(), [paths[0].delay_s, 2.2e-8, 2.2e-8]);
        }
    }

    #[test]
    fn diffuse_power_fills_the_matrix_and_is_white_at_the_transmitter() {
        let diffuse: Vec<Arrival> = (0..40)
            .map(|i| {
                let mut rng = corf_scene::Rng::keyed(9, 0, i);
                let direction = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
                Arrival { direction, power: 0.5 + rng.uniform_f64(), delay_s: 1e-8, object: 0, phase_rad: None }
            })
            .collect();
        let total: f64 = diffuse.iter().map(|a| a.power).sum();
        let (tx, rx) = (array(1, 2, 0.0), array(2, 2, 0.0));
        let n = 3000;
        let (mut power, mut correlation) = (0.0, Complex::ZERO);
        for seed in 0..n {
            let h = between(&[], &diffuse, &tx, &rx, seed);
            power += h.norm_squared() / n as f64;
            let conjugate = Complex::new(h.at(0, 1).re, -h.at(0, 1).im);
            correlation = correlation + h.at(0, 0) * conjugate * (1.0 / n as f64);
        }
        // 8 entries, each exponential of mean `total`, 4 of a column correlated: relative error under 2/√n = 3.7 %.
        assert!((power / (8.0 * total) - 1.0).abs() < 0.08, "{}", power / (8.0 * total));
        assert!(correlation.norm() / total < 0.1, "{}", correlation.norm() / total);
    }
}
