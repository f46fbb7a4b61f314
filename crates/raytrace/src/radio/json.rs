//! Paths as JSON with Sionna's field names and interaction flags.

use super::Path;
use corf_scene::Scene;
use glam::DVec3;
use serde_json::{Value, json};

/// The paths of one transmitter–receiver pair.
///
/// Per path: `types` (letters, TX → RX), `interactions` (flags: specular 1, diffuse 2, refraction 4, diffraction 8), `objects`, `vertices`
/// (metres), `a` (`[re, im]`, between the first ports), `tau` (s), `length_m`, `theta_r`, `phi_r`, `theta_t`, `phi_t` (radians; θ zenith, φ azimuth).
pub fn paths_to_json(scene: &Scene, frequency_hz: f64, tx: DVec3, rx: DVec3, paths: &[Path]) -> Value {
    let name = |object: u32| scene.objects.get(object as usize).map_or("", |o| o.name.as_str());
    let list: Vec<Value> = paths
        .iter()
        .map(|path| {
            let (aoa, aod) = (path.aoa(), path.aod());
            json!({
                "types": path.types(),
                "interactions": path.interactions.iter().map(|i| i.kind.flag()).collect::<Vec<_>>(),
                "objects": path.interactions.iter().map(|i| name(i.object)).collect::<Vec<_>>(),
                "vertices": path.interactions.iter().map(|i| i.vertex.to_array()).collect::<Vec<_>>(),
                "a": [path.a.re, path.a.im],
                "tau": path.delay_s,
                "length_m": path.length_m,
                "theta_r": aoa.theta, "phi_r": aoa.phi,
                "theta_t": aod.theta, "phi_t": aod.phi,
            })
        })
        .collect();
    json!({
        "schema": "corf-paths/1",
        "scene": scene.name,
        "frequency_hz": frequency_hz,
        "tx": tx.to_array(),
        "rx": rx.to_array(),
        "paths": list,
    })
}
