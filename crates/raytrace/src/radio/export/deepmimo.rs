//! Path sets as DeepMIMO's matrices (version 4: `power`, `phase`, `delay`, `aoa_az` … per user and path).

use super::super::{InteractionKind, Path};
use super::PathSet;
use corf_scene::npz::{Array, Values};
use std::f64::consts::TAU;

/// DeepMIMO's code of an interaction; a path's `inter` has them as decimal digits, the first one foremost, 0 for the line of sight.
fn code(kind: InteractionKind) -> u32 {
    match kind.flag() {
        2 => 3,
        8 => 2,
        same => same,
    }
}

/// The matrices of one transmitter (index `tx` of the set) and all receivers ("users"), float32 as DeepMIMO stores them; `NaN` where a
/// user has fewer paths. The line of sight comes first, where DeepMIMO looks for it, then paths by falling power.
///
/// | name | shape | unit |
/// |---|---|---|
/// | `power` | users, paths | dBW received for 1 W: 20·log10 of the coefficient |
/// | `phase` | users, paths | degrees, of the coefficient *with* its propagation phase at the carrier |
/// | `delay` | users, paths | seconds |
/// | `aoa_az`, `aod_az` | users, paths | degrees, azimuth from +x |
/// | `aoa_el`, `aod_el` | users, paths | degrees, *zenith* from +z (what DeepMIMO's array responses take) |
/// | `inter` | users, paths | digits: 1 reflection, 2 diffraction, 3 scattering, 4 transmission |
/// | `inter_pos` | users, paths, interactions, 3 | world metres |
/// | `rx_pos`, `tx_pos` | users, 3 and 1, 3 | world metres |
pub fn deepmimo_arrays(set: &PathSet<'_>, tx: usize) -> Vec<Array> {
    let (users, n, depth) = (set.receivers.len(), set.max_paths(), set.max_interactions());
    let columns: [fn(&Path, f64) -> f64; 8] = [
        |p, _| 10.0 * p.power().log10(),
        |p, f| wrapped_deg(p.a.im.atan2(p.a.re) - TAU * (f * p.delay_s).fract()),
        |p, _| p.delay_s,
        |p, _| p.aoa().phi.to_degrees(),
        |p, _| p.aoa().theta.to_degrees(),
        |p, _| p.aod().phi.to_degrees(),
        |p, _| p.aod().theta.to_degrees(),
        |p, _| f64::from(p.interactions.iter().fold(0, |digits, i| 10 * digits + code(i.kind))),
    ];
    let mut matrices = [(); 8].map(|()| vec![f32::NAN; users * n]);
    let mut vertices = vec![f32::NAN; users * n * depth * 3];
    for user in 0..users {
        let mut paths: Vec<&Path> = set.paths(user, tx).iter().collect();
        paths.sort_by(|a, b| {
            let behind = |p: &Path| !p.interactions.is_empty();
            behind(a).cmp(&behind(b)).then(b.power().total_cmp(&a.power()))
        });
        for (i, path) in paths.iter().enumerate() {
            let slot = user * n + i;
            for (matrix, value) in matrices.iter_mut().zip(columns) {
                matrix[slot] = value(path, set.frequency_hz) as f32;
            }
            for (d, interaction) in path.interactions.iter().enumerate() {
                let at = 3 * (slot * depth + d);
                vertices[at..at + 3].copy_from_slice(&interaction.vertex.as_vec3().to_array());
            }
        }
    }
    let names = ["power", "phase", "delay", "aoa_az", "aoa_el", "aod_az", "aod_el", "inter"];
    let mut arrays: Vec<Array> =
        names.iter().zip(matrices).map(|(name, values)| Array::new(name, &[users, n], Values::F32(values))).collect();
    let flat = |points: &[glam::DVec3]| Values::F32(points.iter().flat_map(|p| p.as_vec3().to_array()).collect());
    arrays.push(Array::new("inter_pos", &[users, n, depth, 3], Values::F32(vertices)));
    arrays.push(Array::new("rx_pos", &[users, 3], flat(&set.receivers)));
    arrays.push(Array::new("tx_pos", &[1, 3], flat(&set.transmitters[tx..=tx])));
    arrays
}

/// An angle in (−180, 180], degrees.
fn wrapped_deg(radians: f64) -> f64 {
    let turns = radians / TAU;
    360.0 * (turns - (turns - 0.5).ceil())
}

#[cfg(test)]
mod tests {
    use super::wrapped_deg;

    #[test]
    fn phases_wrap_to_half_a_turn() {
        for (radians, degrees) in [
            (0.0, 0.0),
            (std::f64::consts::PI, 180.0),
            (-std::f64::consts::PI, 180.0),
            (7.0 * std::f64::consts::FRAC_PI_2, -90.0),
        ] {
            assert!((wrapped_deg(radians) - degrees).abs() < 1e-9, "{radians} {}", wrapped_deg(radians));
        }
    }
}
