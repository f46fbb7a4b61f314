//! Path sets as arrays under the names other tools know.

mod deepmimo;
mod qd;
mod scenario;
mod sionna;

pub use deepmimo::deepmimo_arrays;
pub use qd::{QdForm, qd_scenario};
pub use scenario::deepmimo_scenario;
pub use sionna::{sionna_arrays, sionna_json};

use super::{AntennaArray, Path};
use glam::DVec3;

/// The paths of one transmitter to one receiver.
#[derive(Clone, Debug)]
pub struct Link {
    /// Transmitter, world metres.
    pub tx: DVec3,
    /// Receiver, world metres.
    pub rx: DVec3,
    /// Paths between them.
    pub paths: Vec<Path>,
}

/// Every transmitter with every receiver, and the arrays at both ends.
#[derive(Clone, Debug)]
pub struct PathSet<'s> {
    /// Transmitters, world metres.
    pub transmitters: Vec<DVec3>,
    /// Receivers, world metres.
    pub receivers: Vec<DVec3>,
    /// Receiver by receiver, in each of them transmitter by transmitter.
    pub links: Vec<Link>,
    /// Carrier, Hz.
    pub frequency_hz: f64,
    /// The array of every transmitter. [`sionna_arrays`] has one shape for all: theirs have as many ports as each other there.
    pub tx_arrays: Vec<AntennaArray>,
    /// Receive array.
    pub rx_array: AntennaArray,
    /// Names of the scene's objects, by index.
    pub object_names: Vec<&'s str>,
    /// Velocities of all transmitters and of all receivers, m/s, where Doppler shifts are wanted.
    pub velocities: Option<[DVec3; 2]>,
}

impl PathSet<'_> {
    /// The paths of a receiver and a transmitter.
    pub fn paths(&self, rx: usize, tx: usize) -> &[Path] {
        &self.links[rx * self.transmitters.len() + tx].paths
    }

    /// The most paths of any link.
    pub fn max_paths(&self) -> usize {
        self.links.iter().map(|l| l.paths.len()).max().unwrap_or(0)
    }

    /// The most interactions of any path.
    pub fn max_interactions(&self) -> usize {
        self.links.iter().flat_map(|l| &l.paths).map(|p| p.interactions.len()).max().unwrap_or(0)
    }
}
