//! Multipath components.

use crate::radio::Complex;
use crate::radio::SPEED_OF_LIGHT;
use crate::radio::field::antenna::{Angles, Antenna, AntennaArray, phi_hat, theta_hat};
use glam::DVec3;

/// Paths whose corners all lie this close are one, metres: it bounces where two faces meet.
pub(in crate::radio) const SAME_PATH_M: f64 = 1e-9;

/// The kind of interaction at a vertex of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InteractionKind {
    /// Specular reflection, `S`.
    Specular,
    /// Straight transmission through a slab, `R` (Sionna's refraction).
    Refraction,
    /// Diffraction at an edge, `X`.
    Diffraction,
}

impl InteractionKind {
    /// The letter used in path types.
    pub fn letter(self) -> char {
        match self {
            Self::Specular => 'S',
            Self::Refraction => 'R',
            Self::Diffraction => 'X',
        }
    }

    /// Sionna's interaction flag.
    pub fn flag(self) -> u32 {
        match self {
            Self::Specular => 1,
            Self::Refraction => 4,
            Self::Diffraction => 8,
        }
    }
}

/// One vertex of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interaction {
    /// Kind of the interaction.
    pub kind: InteractionKind,
    /// Index into the scene's objects.
    pub object: u32,
    /// Position, world frame, metres.
    pub vertex: DVec3,
}

/// A multipath component.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Interactions in TX → RX order; none for the line of sight.
    pub interactions: Vec<Interaction>,
    /// Unfolded length, metres.
    pub length_m: f64,
    /// Delay, seconds.
    pub delay_s: f64,
    /// Passband coefficient between the first ports of the two antennas, without the propagation phase e^{−j2πfτ}.
    pub a: Complex,
    /// The channel itself, antennas aside: `transfer[i][j]` takes the field component j (0 θ̂, 1 φ̂ of the departure, world frame) of the
    /// transmitter to component i (θ̂, φ̂ of the arrival) at the receiver: λ/(4πL) × Fresnel, without the propagation phase.
    pub transfer: [[Complex; 2]; 2],
    /// Unit direction from the receiver towards the last interaction, world frame.
    pub arrival: DVec3,
    /// Unit direction along which the path leaves the transmitter, world frame.
    pub departure: DVec3,
}

impl Path {
    /// Interaction letters in TX → RX order; empty for the line of sight.
    pub fn types(&self) -> String {
        self.interactions.iter().map(|i| i.kind.letter()).collect()
    }

    /// Whether both leave and arrive alike and do the same at the same places; what happens at one place may come in another order.
    pub(in crate::radio) fn coincides(&self, other: &Self) -> bool {
        let near = |a: DVec3, b: DVec3| a.distance(b) <= SAME_PATH_M;
        let as_often = |what: &Interaction| {
            let count =
                |path: &Self| path.interactions.iter().filter(|i| i.kind == what.kind && near(i.vertex, what.vertex)).count();
            count(self) == count(other)
        };
        self.interactions.len() == other.interactions.len()
            && near(self.departure, other.departure)
            && near(self.arrival, other.arrival)
            && self.interactions.iter().all(as_often)
    }

    /// Whether all of its numbers are numbers.
    pub(in crate::radio) fn is_finite(&self) -> bool {
        let complex = self.transfer.iter().flatten().chain([&self.a]);
        self.length_m.is_finite()
            && self.delay_s.is_finite()
            && self.arrival.is_finite()
            && self.departure.is_finite()
            && self.interactions.iter().all(|i| i.vertex.is_finite())
            && complex.into_iter().all(|c| c.re.is_finite() && c.im.is_finite())
    }

    /// |a|², linear, relative to 1 W transmitted; the first ports' when an antenna has two.
    pub fn power(&self) -> f64 {
        self.a.norm_squared()
    }

    /// Power received for 1 W transmitted: transmit ports share it and send independent signals, what receive ports get adds. With one
    /// port each |a|².
    pub fn received(&self, tx: &Antenna, rx: &Antenna) -> f64 {
        let pairs = (0..rx.ports()).flat_map(|r| (0..tx.ports()).map(move |t| (t, r)));
        pairs.map(|(t, r)| self.coefficient(tx, t, rx, r).norm_squared()).sum::<f64>() / tx.ports() as f64
    }

    /// The coefficient between a port of one antenna and a port of another, without the propagation phase: C_RXᵀ·transfer·C_TX.
    pub fn coefficient(&self, tx: &Antenna, tx_port: usize, rx: &Antenna, rx_port: usize) -> Complex {
        let components = |antenna: &Antenna, port: usize, direction: DVec3| {
            let c = antenna.port_field(port, direction);
            [c.dot(theta_hat(direction)), c.dot(phi_hat(direction))]
        };
        let (t, r) = (components(tx, tx_port, self.departure), components(rx, rx_port, self.arrival));
        let row = |i: usize| (self.transfer[i][0] * t[0] + self.transfer[i][1] * t[1]) * r[i];
        row(0) + row(1)
    }

    /// The channel matrix of this path between two arrays, without the propagation phase: row r·columns + t, r a port of `rx`, t one of
    /// `tx`, numbered as [`AntennaArray`] does. The path is a plane wave across both arrays (far field, as Sionna's synthetic arrays):
    /// h = v_r(u_arrival)·a·v_t(u_departure), v_m(u) = exp(j2π p_m·u).
    pub fn array_response(&self, tx: &AntennaArray, rx: &AntennaArray) -> Vec<Complex> {
        let (steer_tx, steer_rx) = (tx.steering(self.departure), rx.steering(self.arrival));
        let mut h = Vec::with_capacity(tx.ports() * rx.ports());
        for rx_port in 0..rx.element.ports() {
            let a: Vec<Complex> =
                (0..tx.element.ports()).map(|port| self.coefficient(&tx.element, port, &rx.element, rx_port)).collect();
            for v_r in &steer_rx {
                h.extend(a.iter().flat_map(|a| steer_tx.iter().map(move |v_t| *v_r * *a * *v_t)));
            }
        }
        h
    }

    /// Doppler shift of the path, Hz, where the transmitter moves with `v_tx` and the receiver with `v_rx` (m/s, world) and nothing else moves:
    /// f_D = f/c·(k̂_0·v_tx − k̂_n·v_rx), with k̂_0 the direction of propagation at departure and k̂_n that at arrival. It is −f·dτ/dt: positive
    /// where the path becomes shorter. The sign is that of Sionna RT's `doppler`.
    pub fn doppler_hz(&self, frequency_hz: f64, v_tx: DVec3, v_rx: DVec3) -> f64 {
        // `arrival` points against propagation.
        frequency_hz / SPEED_OF_LIGHT * (self.departure.dot(v_tx) + self.arrival.dot(v_rx))
    }

    /// Angle of arrival: from the receiver towards the last interaction.
    pub fn aoa(&self) -> Angles {
        Angles::of(self.arrival)
    }

    /// Angle of departure: along propagation.
    pub fn aod(&self) -> Angles {
        Angles::of(self.departure)
    }
}
