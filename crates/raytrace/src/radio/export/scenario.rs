//! A scenario folder as DeepMIMO 4 loads it: path matrices, the scene as a lossless mesh, materials and parameters.
//!
//! ```text
//! params.json                    `version`, `rt_params`, `txrx_sets`, `materials`, `scene`
//! power_t000_tx000_r001.npz      and the other ten matrices of [`deepmimo_arrays`]: transmitter `tx000` of set 0 to the receivers of set 1
//! objects.json vertices.npz      names of objects, their key in the two below; all vertices, float32, world metres
//! faces.npz materials.npz        by object: vertices of its triangles, and the material of each, as numbers of `materials` in params.json
//! ```
//!
//! The format is that of DeepMIMO 4.0.5 (<https://deepmimo.net>), found by what its `load`, `Scene.from_data`, `MaterialList.from_dict` and
//! `compute_channels` ask for. Matrices are of single elements with their first ports; DeepMIMO forms arrays by itself, of isotropic elements,
//! whose patterns multiply ours.

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
    let meshes = meshes(scene, &of_material);
    let triangles: usize = meshes.values().map(|mesh| mesh.materials.len()).sum();
    let json = |value: &Value| {
        serde_json::to_vec_pretty(value).map_err(|e| Error::invalid("JSON", e.to_string(), "report this as a defect"))
    };
    let objects: Vec<Value> = meshes
        .keys()
        .map(|&o| json!({ "name": scene.objects[o].name, "label": "objects", "id": o, "mesh_key": o.to_string() }))
        .collect();
    let objects = Value::Array(objects);
    let params = json!({
        "version": DEEPMIMO,
        "rt_params": rt_params(settings),
        "txrx_sets": txrx_sets(set),
        "materials": materials,
        "scene": {
            "num_scenes": 1,
            "n_objects": meshes.len(),
            "n_vertices": scene.positions.len(),
            "n_faces": triangles,
            "n_triangular_faces": triangles,
            "representation": "mesh",
        },
    });
    let vertices = scene.positions.iter().flat_map(|p| p.to_array()).collect();
    let by_object = |array: &dyn Fn(&str, Mesh) -> Array| -> Result<Vec<u8>> {
        let arrays: Vec<Array> = meshes.iter().map(|(o, mesh)| array(&o.to_string(), mesh.clone())).collect();
        encode_npz(&arrays)
    };
    files.push((
        "vertices.npz".into(),
        encode_npz(&[Array::new("vertices", &[scene.positions.len(), 3], Values::F32(vertices))])?,
    ));
    files.push((
        "faces.npz".into(),
        by_object(&|key, mesh| Array::new(key, &[mesh.materials.len(), 3], Values::U32(mesh.vertices)))?,
    ));
    files.push((
        "materials.npz".into(),
        by_object(&|key, mesh| Array::new(key, &[mesh.materials.len()], Values::U32(mesh.materials)))?,
    ));
    files.push(("objects.json".into(), json(&objects)?));
    // Last: without it there is no scenario.
    files.push(("params.json".into(), json(&params)?));
    Ok(files)
}

/// An object's triangles.
#[derive(Clone, Default)]
struct Mesh {
    /// Three a triangle, into the scene's positions.
    vertices: Vec<u32>,
    /// One a triangle, into the materials that are written.
    materials: Vec<u32>,
}

/// Objects that have triangles, by index.
fn meshes(scene: &Scene, of_material: &BTreeMap<u32, u32>) -> BTreeMap<usize, Mesh> {
    let mut meshes: BTreeMap<usize, Mesh> = BTreeMap::new();
    for triangle in &scene.triangles {
        let mesh = meshes.entry(triangle.object as usize).or_default();
        mesh.vertices.extend(triangle.vertices);
        mesh.materials.push(of_material[&triangle.material]);
    }
    meshes
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
    let up_to = |on: bool| if on { settings.max_depth } else { 0 };
    json!({
        "raytracer_name": "corf",
        "raytracer_version": env!("CARGO_PKG_VERSION"),
        "frequency": settings.frequency_hz,
        "max_path_depth": settings.max_depth,
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
