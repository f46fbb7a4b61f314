//! The arrays of Sionna RT's `Paths` object with synthetic arrays, under its names and in its shapes.

use super::PathSet;
use corf_scene::npz::{Array, Values};
use serde_json::{Value, json};

/// Index that stands for no object (Sionna's `INVALID_SHAPE`).
const INVALID_OBJECT: u32 = u32::MAX;
/// Delay that stands for no path, seconds.
const INVALID_DELAY: f64 = -1.0;

/// The arrays; slots beyond a link's paths are not `valid` and hold what Sionna leaves there.
///
/// | name | shape | |
/// |---|---|---|
/// | `a_real`, `a_imag` | rx, rx antennas, tx, tx antennas, paths | coefficients without the propagation phase |
/// | `tau` | rx, tx, paths | seconds; −1 where invalid |
/// | `theta_t`, `phi_t`, `theta_r`, `phi_r` | rx, tx, paths | radians, zenith and azimuth |
/// | `valid` | rx, tx, paths | |
/// | `interactions` | depth, rx, tx, paths | 0 none, 1 specular, 2 diffuse, 4 refraction, 8 diffraction |
/// | `objects` | depth, rx, tx, paths | index into `object_names`; 2³²−1 none |
/// | `vertices` | depth, rx, tx, paths, 3 | world metres |
/// | `doppler` | rx, tx, paths | Hz, 0 for those that do not exist; where velocities are given |
/// | `sources`, `targets` | tx, 3 and rx, 3 | world metres |
/// | `frequency`, `object_names` | scalar, objects | Hz |
pub fn sionna_arrays(set: &PathSet<'_>) -> Vec<Array> {
    let (n_rx, n_tx, n) = (set.receivers.len(), set.transmitters.len(), set.max_paths());
    let (rx_ports, tx_ports, depth) = (set.rx_array.ports(), set.tx_arrays[0].ports(), set.max_interactions());
    let slots = n_rx * n_tx * n;
    let mut a = vec![[0.0; 2]; slots * rx_ports * tx_ports];
    let mut tau = vec![INVALID_DELAY; slots];
    let mut angles = [(); 4].map(|()| vec![0.0; slots]);
    let mut valid = vec![false; slots];
    let mut doppler = vec![0.0; slots];
    let mut interactions = vec![0; depth * slots];
    let mut objects = vec![INVALID_OBJECT; depth * slots];
    let mut vertices = vec![0.0; depth * slots * 3];
    for rx in 0..n_rx {
        for tx in 0..n_tx {
            for (i, path) in set.paths(rx, tx).iter().enumerate() {
                let slot = (rx * n_tx + tx) * n + i;
                for (pair, h) in path.array_response(&set.tx_arrays[tx], &set.rx_array).into_iter().enumerate() {
                    let (r, t) = (pair / tx_ports, pair % tx_ports);
                    a[(((rx * rx_ports + r) * n_tx + tx) * tx_ports + t) * n + i] = [h.re, h.im];
                }
                let (aod, aoa) = (path.aod(), path.aoa());
                angles.iter_mut().zip([aod.theta, aod.phi, aoa.theta, aoa.phi]).for_each(|(list, angle)| list[slot] = angle);
                (tau[slot], valid[slot]) = (path.delay_s, true);
                if let Some([v_tx, v_rx]) = set.velocities {
                    doppler[slot] = path.doppler_hz(set.frequency_hz, v_tx, v_rx);
                }
                for (d, interaction) in path.interactions.iter().enumerate() {
                    let at = d * slots + slot;
                    (interactions[at], objects[at]) = (interaction.kind.flag(), interaction.object);
                    vertices[3 * at..3 * at + 3].copy_from_slice(&interaction.vertex.to_array());
                }
            }
        }
    }
    let per_antenna = [n_rx, rx_ports, n_tx, tx_ports, n];
    let per_slot = [n_rx, n_tx, n];
    let per_depth = [depth, n_rx, n_tx, n];
    let flat = |points: &[glam::DVec3]| Values::F64(points.iter().flat_map(|p| p.to_array()).collect());
    let [theta_t, phi_t, theta_r, phi_r] = angles;
    let names: Vec<String> = set.object_names.iter().map(|n| (*n).to_owned()).collect();
    let mut arrays = vec![
        Array::new("a_real", &per_antenna, Values::F64(a.iter().map(|a| a[0]).collect())),
        Array::new("a_imag", &per_antenna, Values::F64(a.iter().map(|a| a[1]).collect())),
        Array::new("tau", &per_slot, Values::F64(tau)),
        Array::new("theta_t", &per_slot, Values::F64(theta_t)),
        Array::new("phi_t", &per_slot, Values::F64(phi_t)),
        Array::new("theta_r", &per_slot, Values::F64(theta_r)),
        Array::new("phi_r", &per_slot, Values::F64(phi_r)),
        Array::new("valid", &per_slot, Values::Bool(valid)),
        Array::new("interactions", &per_depth, Values::U32(interactions)),
        Array::new("objects", &per_depth, Values::U32(objects)),
        Array::new("vertices", &[depth, n_rx, n_tx, n, 3], Values::F64(vertices)),
        Array::new("sources", &[n_tx, 3], flat(&set.transmitters)),
        Array::new("targets", &[n_rx, 3], flat(&set.receivers)),
        Array::new("frequency", &[], Values::F64(vec![set.frequency_hz])),
        Array::new("object_names", &[names.len()], Values::Text(names)),
    ];
    if set.velocities.is_some() {
        arrays.push(Array::new("doppler", &per_slot, Values::F64(doppler)));
    }
    arrays
}

/// [`sionna_arrays`] as nested JSON lists; `a` is the pair of the real and the imaginary array, as Sionna returns it.
pub fn sionna_json(set: &PathSet<'_>) -> Value {
    let mut object = serde_json::Map::new();
    object.insert("schema".into(), json!("corf-sionna-paths/1"));
    let mut parts = Vec::new();
    for array in sionna_arrays(set) {
        let value = nested(&array.shape, &mut values(&array.values).into_iter());
        match array.name.as_str() {
            "a_real" | "a_imag" => parts.push(value),
            name => {
                object.insert(name.to_owned(), value);
            }
        }
    }
    object.insert("a".into(), Value::Array(parts));
    Value::Object(object)
}

fn values(values: &Values) -> Vec<Value> {
    match values {
        Values::U8(v) => v.iter().map(|x| json!(x)).collect(),
        Values::F32(v) => v.iter().map(|x| json!(x)).collect(),
        Values::F64(v) => v.iter().map(|x| json!(x)).collect(),
        Values::Complex(v) => v.iter().map(|x| json!(x)).collect(),
        Values::U32(v) => v.iter().map(|x| json!(x)).collect(),
        Values::Bool(v) => v.iter().map(|x| json!(x)).collect(),
        Values::Text(v) => v.iter().map(|x| json!(x)).collect(),
    }
}

/// A row-major list as lists of lists.
fn nested(shape: &[usize], values: &mut impl Iterator<Item = Value>) -> Value {
    match shape {
        [] => values.next().unwrap_or(Value::Null),
        [n, rest @ ..] => Value::Array((0..*n).map(|_| nested(rest, values)).collect()),
    }
}
