//! Paths as the ports of two antennas see them.

use crate::radio::{Antenna, Arrival, Path};
use std::f64::consts::TAU;

/// The arrivals of every pair of ports, receiver's port by receiver's port: `port_pairs[rx_port·N_tx + tx_port]`.
///
/// Ports of the transmitter share the 1 W between them and send independent signals, ports of the receiver are listened to apart, so that
/// powers add over the looks. With one port each there is one look, of |a|².
pub fn port_pairs(paths: &[Path], tx: &Antenna, rx: &Antenna, frequency_hz: f64) -> Vec<Vec<Arrival>> {
    let share = 1.0 / tx.ports() as f64;
    let ports = (0..rx.ports()).flat_map(|r| (0..tx.ports()).map(move |t| (t, r)));
    ports
        .map(|(t, r)| {
            let arrival = |path: &Path| {
                let a = path.coefficient(tx, t, rx, r);
                let phase_rad = a.im.atan2(a.re) - TAU * (frequency_hz * path.delay_s).fract();
                Arrival { power: share * a.norm_squared(), phase_rad: Some(phase_rad), ..Arrival::from_path(path, frequency_hz) }
            };
            paths.iter().map(arrival).collect()
        })
        .collect()
}
