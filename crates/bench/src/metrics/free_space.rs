//! The link that there would be if nothing but free space lay between transmitter and platform: what blockage is measured against.

use corf_raytrace::radio::Antenna;
use corf_raytrace::sensor::element_at;
use corf_scene::Rigid3;
use corf_scene::config::ReceiverConfig;
use corf_scene::dataset::DatasetHeader;
use corf_scene::near_field::SPEED_OF_LIGHT;
use glam::DVec3;
use std::f64::consts::TAU;

/// The transmitter, and the element of the platform's array, of a data set that knows them.
#[derive(Clone, Copy, Debug)]
pub struct FreeSpaceLink {
    transmitter: Antenna,
    position_m: DVec3,
    receiver: ReceiverConfig,
    wavelength_m: f64,
}

impl FreeSpaceLink {
    /// Of a data set; `None` where its header does not say all of it, as that of a capture.
    pub fn of(header: &DatasetHeader) -> Option<Self> {
        let (transmitter, receiver) = header.transmitter.as_ref().zip(header.receiver)?;
        Some(Self {
            transmitter: Antenna::from(transmitter),
            position_m: transmitter.position(),
            receiver,
            wavelength_m: SPEED_OF_LIGHT / header.frequency_hz?,
        })
    }

    /// Gain relative to 1 W transmitted of a beam of the platform's array steered at the transmitter: Friis' `(λ / 4πd)²` times both elements'
    /// gains towards each other, polarisations included, summed over their ports. `None` at the transmitter itself.
    pub fn gain(&self, world_from_camera: &Rigid3) -> Option<f64> {
        let way = world_from_camera.translation - self.position_m;
        let distance_m = way.length();
        if distance_m < self.wavelength_m {
            return None;
        }
        let (departure, element) = (way / distance_m, element_at(&self.receiver, world_from_camera));
        let coupled =
            |rx: usize, tx: usize| element.port_field(rx, -departure).dot(self.transmitter.port_field(tx, departure)).powi(2);
        let ports = (0..element.ports()).flat_map(|rx| (0..self.transmitter.ports()).map(move |tx| (rx, tx)));
        let elements: f64 = ports.map(|(rx, tx)| coupled(rx, tx)).sum();
        Some(elements * (self.wavelength_m / (2.0 * TAU * distance_m)).powi(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_raytrace::radio::{AntennaPattern, Polarization};

    /// A transmitter at the origin whose boresight is +x.
    fn link() -> FreeSpaceLink {
        FreeSpaceLink {
            transmitter: Antenna::default(),
            position_m: DVec3::ZERO,
            receiver: ReceiverConfig::default(),
            wavelength_m: 0.005,
        }
    }

    fn at(position: DVec3) -> Rigid3 {
        Rigid3::looking_at(position, position + DVec3::new(0.3, -1.0, 0.0), DVec3::Z)
    }

    #[test]
    fn free_space_loses_what_friis_says_whichever_way_the_platform_looks() {
        let gain = link().gain(&at(DVec3::new(10.0, 0.0, 0.0))).unwrap();
        // 20·log10(4π · 10 m / 5 mm) = 88.0 dB.
        assert!((10.0 * gain.log10() + 88.0).abs() < 0.01, "{gain}");
        let twice = link().gain(&at(DVec3::new(0.0, 20.0, 0.0))).unwrap();
        assert!((gain / twice - 4.0).abs() < 1e-12);
        assert!(link().gain(&at(DVec3::ZERO)).is_none());
    }

    #[test]
    fn patterns_and_polarisations_count() {
        let plain = link().gain(&at(DVec3::new(10.0, 0.0, 0.0))).unwrap();
        let mut directive = link();
        directive.transmitter.pattern = AntennaPattern::Tr38901;
        // 8 dBi at boresight.
        let gain = directive.gain(&at(DVec3::new(10.0, 0.0, 0.0))).unwrap();
        assert!((10.0 * (gain / plain).log10() - 8.0).abs() < 1e-9);
        let mut crossed = link();
        crossed.receiver.polarization = Polarization::H;
        assert!(crossed.gain(&at(DVec3::new(10.0, 0.0, 0.0))).unwrap() < 1e-20 * plain);
        crossed.receiver.polarization = Polarization::VH;
        assert!((crossed.gain(&at(DVec3::new(10.0, 0.0, 0.0))).unwrap() / plain - 1.0).abs() < 1e-12, "one port takes all of it");
    }
}
