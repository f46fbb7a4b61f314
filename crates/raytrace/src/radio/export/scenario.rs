//! A scenario folder as DeepMIMO 4 loads it: path matrices, the scene as a lossless mesh, materials and parameters.
//!
//! ```text
//! params.json                    `version`, `rt_params`, `txrx_sets`, `materials`, `scene`
//! power_t000_tx000_r001.npz      and the other ten matrices of [`deepmimo_arrays`]: transmitter `tx000` of set 0 to the receivers of set 1
//! objects.json vertices.npz      objects, their key in the two below, one of them the ground, `terrain`; all vertices, float32, world metres
//! faces.npz materials.npz        by object: vertices of its triangles, and the material of each, as numbers of `materials` in params.json
//! ```
//!
//! The format is that of DeepMIMO 4.0.5 (<https://deepmimo.net>), found by what its `load`, `Scene.from_data`, `MaterialList.from_dict` and
//! `compute_channels` ask for. Matrices are of single elements with their first ports; DeepMIMO forms arrays by itself, of isotropic elements,
//! whose patterns multiply ours. Velocities are no part of the format: a loaded data set is given them.

use super::PathSet;
use super::deepmimo::deepmimo_arrays;
use crate::radio::RadioSettings;
use corf_scene::npz::{Array, Values, encode_npz};
use corf_scene::radio_spec::PatternName;
use corf_scene::{Error, Result, Scene};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Version of DeepMIMO whose format this is.
const DEEPMIMO: &str = "4.0.5";
/// Number of the set of transmitters.
const TX_SET: usize = 0;
/// Number of the set of receivers.
const RX_SET: usize = 1;

/// The files of a scenario: path below its folder, bytes.
///
/// # Errors
/// No path at all, which DeepMIMO cannot load; a material without radio properties, or whose permittivity is not known at the carrier.
pub fn deepmimo_scenario(set: &PathSet<'_>, scene: &Scene, settings: &RadioSettings) -> Result<Vec<(String, Vec<u8>)>> {
    if set.max_paths() == 0 {
        let what = "no path reaches any receiver, and DeepMIMO loads no scenario without paths";
        return Err(Error::invalid(
            "DeepMIMO scenario",
            what,
            "give receivers that the transmitter reaches, or a larger --depth",
        ));
    }
    let mut files = Vec::new();
    for tx in 0..set.transmitters.len() {
        for array in deepmimo_arrays(set, tx) {
            let name = format!("{}_t{TX_SET:03}_tx{tx:03}_r{RX_SET:03}.npz", array.name);
            files.push((name, encode_npz(&[array])?));
        }
    }
    let (materials, of_material) = materials(scene, set.frequency_hz)?;
    let objects = objects(scene, &of_material);
    let triangles: usize = objects.iter().map(|object| object.materials.len()).sum();
    let json = |value: &Value| {
        serde_json::to_vec_pretty(value).map_err(|e| Error::invalid("JSON", e.to_string(), "report this as a defect"))
    };
    // DeepMIMO takes an object's id for its place in the list.
    let described = |(id, object): (usize, &Object)| json!({ "name": object.name, "label": object.label, "id": id, "mesh_key": id.to_string() });
    let described: Vec<Value> = objects.iter().enumerate().map(described).collect();
    let params = json!({
        "version": DEEPMIMO,
        "rt_params": rt_params(settings),
        "txrx_sets": txrx_sets(set),
        "materials": materials,
        "scene": {
            "num_scenes": 1,
            "n_objects": objects.len(),
            "n_vertices": scene.positions.len(),
            "n_faces": triangles,
            "n_triangular_faces": triangles,
            "representation": "mesh",
        },
    });
    let vertices = scene.positions.iter().flat_map(|p| p.to_array()).collect();
    let by_object = |array: &dyn Fn(&str, &Object) -> Array| -> Result<Vec<u8>> {
        let arrays: Vec<Array> = objects.iter().enumerate().map(|(id, object)| array(&id.to_string(), object)).collect();
        encode_npz(&arrays)
    };
    files.push((
        "vertices.npz".into(),
        encode_npz(&[Array::new("vertices", &[scene.positions.len(), 3], Values::F32(vertices))])?,
    ));
    files.push((
        "faces.npz".into(),
        by_object(&|key, object| Array::new(key, &[object.materials.len(), 3], Values::U32(object.vertices.clone())))?,
    ));
    files.push((
        "materials.npz".into(),
        by_object(&|key, object| Array::new(key, &[object.materials.len()], Values::U32(object.materials.clone())))?,
    ));
    files.push(("objects.json".into(), json(&Value::Array(described))?));
    // Last: without it there is no scenario.
    files.push(("params.json".into(), json(&params)?));
    Ok(files)
}

/// An object as DeepMIMO has it.
struct Object {
    name: String,
    label: &'static str,
    /// Three a triangle, into the scene's positions.
    vertices: Vec<u32>,
    /// One a triangle, into the materials that are written.
    materials: Vec<u32>,
}

/// DeepMIMO's label of the ground, which exactly one object has to have: what happens within a millimetre of its highest point's height
/// happens to it, and Doppler shifts are worked out with one alone.
const TERRAIN: &str = "terrain";
/// Its label of all else.
const OBJECTS: &str = "objects";

/// The objects that have triangles, in their order, the ground among them: the floor, or the part of an object that is one, behind all others.
fn objects(scene: &Scene, of_material: &BTreeMap<u32, u32>) -> Vec<Object> {
    let ground = ground(scene);
    // By object, those that are floor and those that are not.
    let mut parts: BTreeMap<u32, [Vec<usize>; 2]> = BTreeMap::new();
    for (i, triangle) in scene.triangles.iter().enumerate() {
        let is_ground = ground == level(scene, i).map(|level| (triangle.object, level)) && ground.is_some();
        parts.entry(triangle.object).or_default()[usize::from(is_ground)].push(i);
    }
    let object = |name: String, label: &'static str, triangles: &[usize]| Object {
        name,
        label,
        vertices: triangles.iter().flat_map(|i| scene.triangles[*i].vertices).collect(),
        materials: triangles.iter().map(|i| of_material[&scene.triangles[*i].material]).collect(),
    };
    let name = |index: u32| scene.objects[index as usize].name.clone();
    let (mut objects, mut cut_off) = (Vec::new(), None);
    for (index, [others, of_ground]) in &parts {
        match (others.is_empty(), of_ground.is_empty()) {
            (true, _) => objects.push(object(name(*index), TERRAIN, of_ground)),
            (false, true) => objects.push(object(name(*index), OBJECTS, others)),
            (false, false) => {
                objects.push(object(name(*index), OBJECTS, others));
                cut_off = Some(object(format!("{} (ground)", name(*index)), TERRAIN, of_ground));
            }
        }
    }
    objects.extend(cut_off);
    if ground.is_none() {
        // Nothing is level: the object that reaches up least.
        let top =
            |object: &Object| object.vertices.iter().map(|v| scene.positions[*v as usize].z).fold(f32::NEG_INFINITY, f32::max);
        if let Some(lowest) = objects.iter_mut().min_by(|a, b| top(a).total_cmp(&top(b))) {
            lowest.label = TERRAIN;
        }
    }
    objects
}

/// The height of a level triangle, in whole millimetres.
fn level(scene: &Scene, triangle: usize) -> Option<i64> {
    let [a, b, c] = scene.corners_f64(triangle).map(|p| p.z);
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    (high - low < 0.5e-3).then(|| (low * 1e3).round() as i64)
}

/// Least share of the largest level surface that ground has.
const GROUND_SHARE: f64 = 0.5;

/// The ground as an object and its height in millimetres: of the level surfaces that are not much smaller than the largest the lowest.
fn ground(scene: &Scene) -> Option<(u32, i64)> {
    let mut areas: BTreeMap<(i64, u32), f64> = BTreeMap::new();
    for (i, triangle) in scene.triangles.iter().enumerate() {
        if let Some(level) = level(scene, i) {
            let [a, b, c] = scene.corners_f64(i);
            *areas.entry((level, triangle.object)).or_default() += 0.5 * (b - a).cross(c - a).length();
        }
    }
    let largest = areas.values().copied().fold(0.0, f64::max);
    areas.into_iter().find(|(_, area)| *area > 0.0 && *area >= GROUND_SHARE * largest).map(|((level, object), _)| (object, level))
}

/// Materials in use at the carrier under DeepMIMO's names, and the number of each of the scene's among them. Those alike share a number, for
/// DeepMIMO strikes out what comes twice.
fn materials(scene: &Scene, frequency_hz: f64) -> Result<(Map<String, Value>, BTreeMap<u32, u32>)> {
    let used: std::collections::BTreeSet<u32> = scene.triangles.iter().map(|t| t.material).collect();
    let (mut list, mut numbers) = (Vec::new(), BTreeMap::new());
    for index in used {
        let material = &scene.materials[index as usize];
        let Some(radio) = &material.radio else {
            let help = "give it a table [radio_materials.NAME] in the scene file";
            return Err(Error::invalid(format!("material {}", material.name), "has no radio properties", help));
        };
        let (relative_permittivity, imaginary) = radio.complex_permittivity(frequency_hz)?;
        let spec = corf_scene::radio_spec::RadioSpec::from(radio);
        // Λ weighs the lobe around the specular direction: alone it has all.
        let (model, lambda) = match spec.scattering_pattern {
            _ if spec.scattering_coefficient == 0.0 => ("none", None),
            PatternName::Lambertian => ("lambertian", None),
            PatternName::Directive => ("directive", Some(1.0)),
            PatternName::Backscatter => ("directive", spec.lambda),
        };
        let value = json!({
            "name": material.name,
            "permittivity": relative_permittivity,
            "conductivity": imaginary * std::f64::consts::TAU * frequency_hz * corf_scene::itu::VACUUM_PERMITTIVITY_F_PER_M,
            "scattering_model": model,
            "scattering_coefficient": spec.scattering_coefficient,
            "cross_polarization_coefficient": spec.xpd,
            "alpha_r": spec.alpha_r.unwrap_or(4),
            "alpha_i": spec.alpha_i.unwrap_or(4),
            "lambda_param": lambda.unwrap_or(0.5),
            "thickness": spec.thickness_m,
        });
        let number = list.iter().position(|other| *other == value).unwrap_or_else(|| {
            list.push(value);
            list.len() - 1
        });
        numbers.insert(index, number as u32);
    }
    let numbered = list.into_iter().enumerate().map(|(id, mut value)| {
        value["id"] = json!(id);
        (format!("material_{id}"), value)
    });
    Ok((numbered.collect(), numbers))
}

/// `rt_params`: what was traced.
fn rt_params(settings: &RadioSettings) -> Value {
    let up_to = |on: bool| if on { settings.max_interactions } else { 0 };
    json!({
        "raytracer_name": "corf",
        "raytracer_version": env!("CARGO_PKG_VERSION"),
        "frequency": settings.frequency_hz,
        "max_path_depth": settings.max_interactions,
        "max_reflections": up_to(settings.reflection),
        "max_diffractions": usize::from(settings.diffraction),
        "max_scattering": 0,
        "max_transmissions": up_to(settings.transmission),
        "diffuse_reflections": 0,
        "diffuse_diffractions": 0,
        "diffuse_transmissions": 0,
        "diffuse_final_interaction_only": false,
        "diffuse_random_phases": false,
        "terrain_reflection": false,
        "terrain_diffraction": false,
        "terrain_scattering": false,
        "num_rays": settings.search.rays(),
        "ray_casting_method": "uniform",
        "synthetic_array": true,
        "ray_casting_range_az": 360.0,
        "ray_casting_range_el": 180.0,
        "gps_bbox": [0, 0, 0, 0],
        "raw_params": {},
    })
}

/// `txrx_sets`: all transmitters in one set, all receivers in another.
fn txrx_sets(set: &PathSet<'_>) -> Value {
    let (n_tx, n_rx) = (set.transmitters.len(), set.receivers.len());
    let active_tx = (0..n_tx).filter(|tx| (0..n_rx).any(|rx| !set.paths(rx, *tx).is_empty())).count();
    let active_rx = (0..n_rx).filter(|rx| (0..n_tx).any(|tx| !set.paths(*rx, tx).is_empty())).count();
    let entry = |name: &str, id: usize, points: usize, active: usize| {
        json!({
            "name": name,
            "id_orig": id,
            "id": id,
            "is_tx": id == TX_SET,
            "is_rx": id == RX_SET,
            "num_points": points,
            "num_active_points": active,
            "num_ant": 1,
            "dual_pol": false,
            "ant_rel_positions": [[0, 0, 0]],
            "array_orientation": [0, 0, 0],
            "grid_spacing": null,
        })
    };
    json!({
        "txrx_set_0": entry("transmitters", TX_SET, n_tx, active_tx),
        "txrx_set_1": entry("receivers", RX_SET, n_rx, active_rx),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::model::{Object as SceneObject, Triangle};
    use glam::Vec3;

    /// Rectangles by object: corners (x, y, z) of three corners in order, the fourth follows.
    fn scene(rectangles: &[(u32, [[f32; 3]; 3])]) -> Scene {
        let mut scene = Scene::default();
        for (object, [a, b, c]) in rectangles {
            while scene.objects.len() <= *object as usize {
                scene.objects.push(SceneObject { name: format!("o{}", scene.objects.len()) });
            }
            let first = scene.positions.len() as u32;
            let [a, b, c] = [*a, *b, *c].map(Vec3::from);
            scene.positions.extend([a, b, c, a + c - b]);
            let triangle = |t: [u32; 3]| Triangle { vertices: t.map(|v| first + v), material: 0, object: *object };
            scene.triangles.extend([[0, 1, 2], [0, 2, 3]].map(triangle));
        }
        scene
    }

    /// Name, label and number of triangles of every object.
    fn labels(rectangles: &[(u32, [[f32; 3]; 3])]) -> Vec<(String, &'static str, usize)> {
        let scene = scene(rectangles);
        objects(&scene, &BTreeMap::from([(0, 0)])).into_iter().map(|o| (o.name, o.label, o.materials.len())).collect()
    }

    fn level_at(z: f32, side: f32) -> [[f32; 3]; 3] {
        [[0.0, 0.0, z], [side, 0.0, z], [side, side, z]]
    }

    const WALL: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 0.0, 3.0]];

    #[test]
    fn exactly_one_object_is_the_ground() {
        let named =
            |list: &[(&str, &'static str, usize)]| list.iter().map(|(n, l, t)| (n.to_string(), *l, *t)).collect::<Vec<_>>();
        // A floor of its own; the ceiling is as large, and a pit's bottom small.
        let floor = [(0, level_at(3.0, 4.0)), (1, WALL), (2, level_at(0.0, 4.0)), (3, level_at(-2.0, 1.0))];
        let expected = [("o0", OBJECTS, 2), ("o1", OBJECTS, 2), ("o2", TERRAIN, 2), ("o3", OBJECTS, 2)];
        assert_eq!(labels(&floor), named(&expected));
        // A room in one piece is parted from its floor; an object without triangles leaves no hole in the numbers.
        let room = [(1, level_at(0.0, 4.0)), (1, WALL), (1, level_at(3.0, 4.0)), (3, WALL)];
        let expected = [("o1", OBJECTS, 4), ("o3", OBJECTS, 2), ("o1 (ground)", TERRAIN, 2)];
        assert_eq!(labels(&room), named(&expected));
        // Walls alone: the lower one.
        let low = [[0.0, 5.0, 0.0], [4.0, 5.0, 0.0], [4.0, 5.0, 1.0]];
        assert_eq!(labels(&[(0, WALL), (1, low)]), named(&[("o0", OBJECTS, 2), ("o1", TERRAIN, 2)]));
        assert_eq!(labels(&[(0, WALL)]), named(&[("o0", TERRAIN, 2)]));
    }
}
