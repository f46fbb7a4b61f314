//! Antenna patterns and the planar array.
//!
//! θ is the zenith angle from +z, φ = atan2(y, x); θ̂ = (cosθcosφ, cosθsinφ, −sinθ).

use crate::radio::Complex;
pub use corf_scene::config::{AntennaPattern, Polarization};
use corf_scene::config::{Elements, ReceiverConfig, TransmitterConfig};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Amplitude of an element's pattern towards the unit direction `local` of the antenna frame (boresight +x, zenith +z): 1 everywhere for
/// `Iso`, √1.5·|sinθ| for a short `Dipole` along z, and for `Tr38901` the element of 3GPP TR 38.901 table 7.3-1 (65° half-power beam
/// widths, 8 dBi, 30 dB floor); of a sampled pattern what its file says.
pub fn amplitude(pattern: AntennaPattern, local: DVec3) -> f64 {
    pattern.amplitude(local)
}

/// An antenna in the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Antenna {
    /// Element pattern.
    pub pattern: AntennaPattern,
    /// Polarisation in the antenna's own frame.
    pub polarization: Polarization,
    /// Rotation; identity has boresight along world +x and z up.
    pub world_from_antenna: DMat3,
    /// The beam of an array of such elements; `None` for one element.
    pub beam: Option<Beam>,
}

impl Default for Antenna {
    fn default() -> Self {
        Self { pattern: AntennaPattern::Iso, polarization: Polarization::V, world_from_antenna: DMat3::IDENTITY, beam: None }
    }
}

impl From<&TransmitterConfig> for Antenna {
    /// Pattern, polarisation, orientation and, of several elements, the beam.
    fn from(c: &TransmitterConfig) -> Self {
        let array = PlanarArray { rows: c.rows, columns: c.cols, spacing_wavelengths: c.spacing_wavelengths };
        Self {
            pattern: c.pattern,
            polarization: c.polarization,
            world_from_antenna: c.orientation.world_from_array(),
            beam: (array.elements() > 1).then(|| Beam { array, towards: c.beam.unwrap_or_default().direction() }),
        }
    }
}

impl Antenna {
    /// An element of a platform's array whose frame is turned by `world_from_array`.
    pub fn element_of(receiver: &ReceiverConfig, world_from_array: DMat3) -> Self {
        Self { pattern: receiver.pattern, polarization: receiver.polarization, world_from_antenna: world_from_array, beam: None }
    }

    /// The real field vector C(u) (world frame, perpendicular to `direction`) that a port radiates towards the unit `direction`,
    /// which is as well what it picks up from there.
    pub fn port_field(&self, port: usize, direction: DVec3) -> DVec3 {
        let local = self.world_from_antenna.transpose() * direction;
        let axis = match self.polarization {
            // Exact, where the cosine of a right angle is not.
            Polarization::V => theta_hat(local),
            Polarization::H => phi_hat(local),
            _ => {
                let (sin, cos) = self.polarization.slants_rad()[port].sin_cos();
                theta_hat(local) * cos + phi_hat(local) * sin
            }
        };
        let factor = self.beam.map_or(1.0, |beam| beam.factor(local));
        self.world_from_antenna * (axis * (amplitude(self.pattern, local) * factor))
    }

    /// [`Antenna::port_field`] of the first port.
    pub fn field(&self, direction: DVec3) -> DVec3 {
        self.port_field(0, direction)
    }

    /// Number of ports.
    pub fn ports(&self) -> usize {
        self.polarization.slants_rad().len()
    }
}

/// θ̂ at a unit direction; at the poles φ is taken as 0.
pub fn theta_hat(direction: DVec3) -> DVec3 {
    let sin = (direction.x * direction.x + direction.y * direction.y).sqrt();
    if sin == 0.0 {
        return DVec3::new(direction.z.signum(), 0.0, 0.0);
    }
    DVec3::new(direction.z * direction.x / sin, direction.z * direction.y / sin, -sin)
}

/// φ̂ = k × θ̂ at a unit direction.
pub fn phi_hat(direction: DVec3) -> DVec3 {
    direction.cross(theta_hat(direction))
}

/// Zenith and azimuth of a unit direction, radians.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Angles {
    /// Zenith from +z.
    pub theta: f64,
    /// Azimuth atan2(y, x).
    pub phi: f64,
}

impl Angles {
    /// The angles of a unit direction, accurate at the poles as well.
    pub fn of(direction: DVec3) -> Self {
        Self { theta: direction.x.hypot(direction.y).atan2(direction.z), phi: direction.y.atan2(direction.x) }
    }
}

/// A planar array in its local y–z plane, boresight +x; columns run along +y, rows down −z; element `i = column·rows + row`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanarArray {
    /// Rows (along −z).
    pub rows: usize,
    /// Columns (along +y).
    pub columns: usize,
    /// Element spacing, wavelengths: between columns (along y), between rows (along z).
    pub spacing_wavelengths: [f64; 2],
}

impl Default for PlanarArray {
    /// The 8 × 8 half-wavelength array.
    fn default() -> Self {
        Self { rows: 8, columns: 8, spacing_wavelengths: [0.5, 0.5] }
    }
}

impl From<&ReceiverConfig> for PlanarArray {
    fn from(c: &ReceiverConfig) -> Self {
        Self { rows: c.rows, columns: c.cols, spacing_wavelengths: c.spacing_wavelengths }
    }
}

impl PlanarArray {
    /// Number of elements.
    pub fn elements(&self) -> usize {
        self.rows * self.columns
    }

    /// The phase steps between neighbouring columns and between neighbouring rows (upwards) for a unit direction of the array frame,
    /// radians.
    pub fn phase_steps(&self, direction: DVec3) -> [f64; 2] {
        let [across, down] = self.spacing_wavelengths;
        [std::f64::consts::TAU * across * direction.y, std::f64::consts::TAU * down * direction.z]
    }

    /// Element positions in wavelengths, array frame, in element order.
    pub fn positions(&self) -> Vec<DVec3> {
        let [across, down] = self.spacing_wavelengths;
        let centred = |i: usize, n: usize, spacing: f64| (i as f64 - 0.5 * (n as f64 - 1.0)) * spacing;
        (0..self.elements())
            .map(|i| DVec3::new(0.0, centred(i / self.rows, self.columns, across), -centred(i % self.rows, self.rows, down)))
            .collect()
    }

    /// The steering vector v_m(u) = exp(j2π p_m·u) of a unit direction in the array frame.
    pub fn steering(&self, direction: DVec3) -> Vec<Complex> {
        self.positions().iter().map(|p| Complex::new(0.0, std::f64::consts::TAU * p.dot(direction)).exp()).collect()
    }
}

/// An array in the world: a grid of equal elements that turns with its elements.
///
/// Its ports are numbered port by port of the element: `index = element_port·N + grid element`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AntennaArray {
    /// The element; its `world_from_antenna` turns the grid as well.
    pub element: Antenna,
    /// Positions of the elements.
    pub grid: PlanarArray,
}

impl AntennaArray {
    /// One element at the array's position.
    pub fn single(element: Antenna) -> Self {
        Self { element, grid: PlanarArray { rows: 1, columns: 1, spacing_wavelengths: [0.0, 0.0] } }
    }

    /// World positions of the grid's elements, metres, for the array's own one and the wavelength.
    fn elements_at(&self, position: DVec3, wavelength_m: f64) -> Vec<DVec3> {
        let world = |p: DVec3| position + self.element.world_from_antenna * (p * wavelength_m);
        self.grid.positions().into_iter().map(world).collect()
    }

    /// The least distance between an element of this array and one of another, metres: exact where it is under `exact_under_m`, and no less
    /// than that otherwise. A beam's elements are part of its element and count as well.
    pub fn distance_m(&self, position: DVec3, (other, at): (&Self, DVec3), wavelength_m: f64, exact_under_m: f64) -> f64 {
        let spread = |array: &Self| match array.element.beam {
            Some(beam) => Self { grid: beam.array, ..*array },
            None => *array,
        };
        let (a, b) = (spread(self), spread(other));
        let radius_m = |array: &Self| {
            let [across, down] = array.grid.spacing_wavelengths;
            let half = |n: usize, spacing: f64| 0.5 * n.saturating_sub(1) as f64 * spacing * wavelength_m;
            half(array.grid.columns, across).hypot(half(array.grid.rows, down))
        };
        let least_m = position.distance(at) - radius_m(&a) - radius_m(&b);
        if least_m >= exact_under_m {
            return least_m;
        }
        let theirs = b.elements_at(at, wavelength_m);
        let to_theirs = |p: DVec3| theirs.iter().map(|q| p.distance(*q)).fold(f64::INFINITY, f64::min);
        a.elements_at(position, wavelength_m).into_par_iter().map(to_theirs).reduce(|| f64::INFINITY, f64::min)
    }

    /// Number of ports: the element's times the grid's elements.
    pub fn ports(&self) -> usize {
        self.element.ports() * self.grid.elements()
    }

    /// The steering vector of the grid for a unit direction in the world frame; of elements with a response each, times what each responds over the
    /// root of their mean gain, which [`Antenna::port_field`] has.
    pub fn steering(&self, direction: DVec3) -> Vec<Complex> {
        let local = self.element.world_from_antenna.transpose() * direction;
        let mut v = self.grid.steering(local);
        if let Some(elements) = self.element.pattern.elements().filter(|elements| elements.array.count() == v.len()) {
            over_mean_gain(elements, local, |m, response| v[m] = v[m] * response);
        }
        v
    }
}

/// Hands on what every element of an array responds towards a unit direction of its frame over the root of their mean gain, so that the mean of the
/// squares is 1; 0 where none responds.
pub(crate) fn over_mean_gain(elements: Elements, local: DVec3, mut each: impl FnMut(usize, Complex)) {
    let gain = elements.gain(local);
    let scale = if gain > 0.0 { 1.0 / gain.sqrt() } else { 0.0 };
    elements.each(local, |m, [re, im]| each(m, Complex::new(re * scale, im * scale)));
}

/// All elements of an array fed with equal amplitudes, and with phases that make them add up towards one direction. The 1 W is shared
/// between the elements, whose coupling is neglected.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beam {
    /// The elements.
    pub array: PlanarArray,
    /// Unit, antenna frame.
    pub towards: DVec3,
}

impl Beam {
    /// Σ_m exp(j2π p_m·(u − u₀)) / √M towards the unit direction u of the antenna frame; real, because the elements lie symmetrically
    /// about their centre. Its square is M towards u₀.
    pub fn factor(&self, local: DVec3) -> f64 {
        let (here, steered) = (self.array.phase_steps(local), self.array.phase_steps(self.towards));
        dirichlet(self.array.columns, here[0] - steered[0]) * dirichlet(self.array.rows, here[1] - steered[1])
            / (self.array.elements() as f64).sqrt()
    }
}

/// Σ exp(j·x·(i − (n−1)/2)) over i = 0..n: sin(n·x/2) / sin(x/2).
fn dirichlet(n: usize, x: f64) -> f64 {
    /// Under this sine the quotient's limit is more exact than the quotient.
    const LIMIT: f64 = 1e-9;
    let (count, half) = (n as f64, 0.5 * x);
    if half.sin().abs() < LIMIT { count * (count * half).cos() / half.cos() } else { (count * half).sin() / half.sin() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_are_as_far_apart_as_their_nearest_elements() {
        let array = |rows: usize, columns: usize| AntennaArray {
            element: Antenna::default(),
            grid: PlanarArray { rows, columns, spacing_wavelengths: [0.5, 0.5] },
        };
        let (eight, one) = (array(8, 8), array(1, 1));
        // 8 columns 2.5 mm apart reach 8.75 mm to the side: an element 10 mm to the side is 1.25 mm from the last ones, 1.25 mm up or down.
        let distance = |at: DVec3| eight.distance_m(DVec3::ZERO, (&one, at), 5e-3, 1e-2);
        assert!((distance(DVec3::new(0.0, 10e-3, 0.0)) - 1.25e-3 * 2f64.sqrt()).abs() < 1e-12);
        assert!((one.distance_m(DVec3::ZERO, (&one, DVec3::X), 5e-3, 1e-2) - 1.0).abs() < 1e-12);
        // Turned by a quarter about z its columns lie along x.
        let turned = AntennaArray {
            element: Antenna {
                world_from_antenna: glam::DMat3::from_rotation_z(std::f64::consts::FRAC_PI_2),
                ..Antenna::default()
            },
            ..eight
        };
        let beside = turned.distance_m(DVec3::ZERO, (&one, DVec3::new(0.0, 10e-3, 1.25e-3)), 5e-3, 2e-2);
        assert!((beside - 10e-3f64.hypot(1.25e-3)).abs() < 1e-12, "{beside}");
        // Where no element can be near, the bound does.
        assert!(distance(DVec3::new(0.0, 1.0, 0.0)) > 0.98);
        let beam = Beam { array: eight.grid, towards: DVec3::X };
        let beamed = AntennaArray::single(Antenna { beam: Some(beam), ..Antenna::default() });
        let to_beam = one.distance_m(DVec3::new(0.0, 10e-3, 0.0), (&beamed, DVec3::ZERO), 5e-3, 1e-2);
        assert!((to_beam - 1.25e-3 * 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_beam_is_the_sum_over_its_elements() {
        let array = PlanarArray { rows: 3, columns: 4, spacing_wavelengths: [0.5, 0.7] };
        let towards = DVec3::new(0.8, 0.3, -0.4).normalize();
        let beam = Beam { array, towards };
        for u in [towards, DVec3::X, DVec3::new(-0.2, 0.9, 0.1).normalize(), DVec3::Z] {
            let sum = array
                .steering(u)
                .iter()
                .zip(array.steering(towards))
                .fold(Complex::ZERO, |s, (v, w)| s + *v * Complex::new(w.re, -w.im));
            assert!((sum * (1.0 / 12f64.sqrt()) - Complex::real(beam.factor(u))).norm() < 1e-12, "{u}");
        }
        assert!((beam.factor(towards).powi(2) - 12.0).abs() < 1e-9);
        let antenna = Antenna { beam: Some(beam), ..Antenna::default() };
        assert!((antenna.field(towards).length_squared() - 12.0).abs() < 1e-9);
    }

    #[test]
    fn patterns_radiate_their_stated_power() {
        // Mean gain over the sphere by a midpoint rule in (z, φ): 1 for iso and dipole; 38.901's 8 dBi
        // include 1.8 dB of losses (TR 37.842 table 5.4.4.2.1-1), so its mean is 10^-0.18 = 0.66.
        let mean = |pattern: AntennaPattern| {
            let (nz, np) = (400, 400);
            let mut sum = 0.0;
            for i in 0..nz {
                let z = -1.0 + (i as f64 + 0.5) * 2.0 / nz as f64;
                let r = (1.0f64 - z * z).sqrt();
                for j in 0..np {
                    let phi = (j as f64 + 0.5) * std::f64::consts::TAU / np as f64;
                    sum += amplitude(pattern, DVec3::new(r * phi.cos(), r * phi.sin(), z)).powi(2);
                }
            }
            sum / (nz * np) as f64
        };
        assert!((mean(AntennaPattern::Iso) - 1.0).abs() < 1e-12);
        assert!((mean(AntennaPattern::Dipole) - 1.0).abs() < 1e-4);
        assert!((mean(AntennaPattern::Tr38901) - 10f64.powf(-0.18)).abs() < 0.01, "{}", mean(AntennaPattern::Tr38901));
        assert!((20.0 * amplitude(AntennaPattern::Tr38901, DVec3::X).log10() - 8.0).abs() < 1e-9);
    }

    #[test]
    fn the_basis_is_right_handed_and_its_theta_is_that_of_the_opposite_direction() {
        for k in [DVec3::new(0.3, -0.5, 0.8).normalize(), DVec3::X, DVec3::new(1e-9, 0.0, 1.0).normalize()] {
            assert!((theta_hat(k).cross(phi_hat(k)) - k).length() < 1e-12);
            assert!((theta_hat(k) - theta_hat(-k)).length() < 1e-12);
        }
    }

    #[test]
    fn elements_run_column_first_from_the_corner() {
        let p = PlanarArray::default().positions();
        assert_eq!(p[0], DVec3::new(0.0, -1.75, 1.75));
        assert_eq!(p[1], DVec3::new(0.0, -1.75, 1.25));
        assert_eq!(p[8], DVec3::new(0.0, -1.25, 1.75));
    }
}
