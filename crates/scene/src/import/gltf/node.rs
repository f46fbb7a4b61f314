//! Nodes: their transforms, whether they are visible, and their instances.

use super::super::notes::Notes;
use super::accessor;
use super::document::Source;
use crate::{Error, Result};
use glam::{DMat4, DQuat, DVec3, Mat4};
use serde_json::Value;
use std::rc::Rc;

/// A rotation whose squared length is this near to 1 is unit to float32, and is taken as it is.
const UNIT: f64 = 1e-6;
/// One that is farther from 1 than this was not rounded but is wrong, and a note says so. Quantised ones are coarse.
const WRONG: f64 = 1e-3;
const WRONG_QUANTISED: f64 = 0.05;

/// A node's name and number, for messages.
pub(super) fn describe(node: &gltf::Node<'_>) -> String {
    format!("nodes[{}]{}", node.index(), node.name().map(|n| format!(" \"{n}\"")).unwrap_or_default())
}

/// Every node's parent: the first that lists it. That there is one at most is checked where the scene comes by the node.
pub(super) fn parents(document: &gltf::Document) -> Rc<[Option<usize>]> {
    let mut parents = vec![None; document.nodes().len()];
    for node in document.nodes() {
        for child in node.children() {
            parents[child.index()].get_or_insert(node.index());
        }
    }
    parents.into()
}

/// Whether a node is shown (`KHR_node_visibility`); its descendants go with it.
pub(super) fn is_visible(node: &gltf::Node<'_>, place: &str) -> Result<bool> {
    match node.extension_value("KHR_node_visibility").and_then(|e| e.get("visible")) {
        None => Ok(true),
        Some(Value::Bool(visible)) => Ok(*visible),
        Some(other) => {
            Err(Error::invalid(place, format!("KHR_node_visibility: visible is {other}"), "it is true or false; export again"))
        }
    }
}

/// `parent_from_node`. A rotation that is no unit quaternion turns, and must not scale: it is normalised, with a note.
pub(super) fn parent_from_node(node: &gltf::Node<'_>, place: &str, notes: &mut Notes) -> Result<DMat4> {
    let transform = node.transform();
    let as_given = |t: gltf::scene::Transform| Mat4::from_cols_array_2d(&t.matrix()).as_dmat4();
    match transform {
        gltf::scene::Transform::Matrix { matrix } => {
            let last_row = [matrix[0][3], matrix[1][3], matrix[2][3], matrix[3][3]];
            if last_row != [0.0, 0.0, 0.0, 1.0] {
                return Err(Error::invalid(
                    place,
                    format!("the last row of its matrix is {last_row:?}"),
                    "a node's matrix is affine, its last row (4th, 8th, 12th, 16th number) 0 0 0 1; export the model again",
                ));
            }
            Ok(as_given(transform))
        }
        gltf::scene::Transform::Decomposed { translation, rotation, scale } => {
            let unit = unit_rotation(rotation, WRONG, place, &describe(node), notes)?;
            Ok(match unit {
                None => as_given(gltf::scene::Transform::Decomposed { translation, rotation, scale }),
                Some(rotation) => trs(translation, rotation, scale),
            })
        }
    }
}

/// Gives a node's transform the translation that the file writes, in double precision: the parser rounds it to single.
pub(super) fn translate_in_doubles(parent_from_node: &mut DMat4, raw_node: &Value) {
    let numbers = |key: &str| raw_node.get(key)?.as_array()?.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>();
    let translation = numbers("matrix").and_then(|m| m.get(12..15).map(<[f64]>::to_vec)).or_else(|| numbers("translation"));
    if let Some(&[x, y, z]) = translation.as_deref() {
        parent_from_node.w_axis = DVec3::new(x, y, z).extend(1.0);
    }
}

fn trs(translation: [f32; 3], rotation: DQuat, scale: [f32; 3]) -> DMat4 {
    let of = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    DMat4::from_scale_rotation_translation(of(scale), rotation, of(translation))
}

/// A rotation made unit; `None` where it is already.
fn unit_rotation(rotation: [f32; 4], wrong: f64, place: &str, short: &str, notes: &mut Notes) -> Result<Option<DQuat>> {
    let q = DQuat::from_array(rotation.map(f64::from));
    let length2 = q.length_squared();
    if !length2.is_finite() || length2 < 1e-12 {
        return Err(Error::invalid(
            place,
            format!("its rotation {rotation:?} is no quaternion to turn by"),
            "give a unit quaternion x, y, z, w; 0, 0, 0, 1 turns nothing",
        ));
    }
    if (length2 - 1.0).abs() <= UNIT {
        return Ok(None);
    }
    if (length2 - 1.0).abs() > wrong {
        notes.warn("its rotation is no unit quaternion; it was normalised, so that it turns and does not scale", short);
    }
    Ok(Some(q.normalize()))
}

/// Most instances of one node, and most objects of a scene that has instances.
pub(super) const MAX_INSTANCES: usize = 1_000_000;

/// `node_from_instance` of every instance (`EXT_mesh_gpu_instancing`); `None` for a node without the extension.
pub(super) fn instances(
    node: &gltf::Node<'_>,
    source: &Source<'_>,
    place: &str,
    notes: &mut Notes,
) -> Result<Option<Vec<DMat4>>> {
    let Some(extension) = node.extension_value("EXT_mesh_gpu_instancing") else { return Ok(None) };
    let place = format!("{place}: EXT_mesh_gpu_instancing");
    let Some(attributes) = extension.get("attributes").and_then(Value::as_object) else {
        return Err(Error::invalid(place, "has no attributes", "export the model again"));
    };
    for name in attributes.keys().filter(|n| !matches!(n.as_str(), "TRANSLATION" | "ROTATION" | "SCALE")) {
        notes.note(format!("EXT_mesh_gpu_instancing: attribute {name} is not read"), describe(node));
    }
    let mut count = None;
    for (name, index) in attributes {
        let n = source.accessor(index, &place)?.count();
        if *count.get_or_insert(n) != n {
            return Err(Error::invalid(
                place,
                format!("{name} has {n} values where another attribute has {}", count.unwrap_or(0)),
                "every attribute needs one value an instance; export the model again",
            ));
        }
    }
    let count = count.unwrap_or(0);
    if count > MAX_INSTANCES {
        return Err(Error::invalid(place, format!("{count} instances; {MAX_INSTANCES} are the most"), "simplify the model"));
    }
    let vectors = |name: &str, default: f32| match attributes.get(name) {
        Some(index) => accessor::floats::<3>(&source.accessor(index, &place)?, source, &place),
        None => Ok(vec![[default; 3]; count]),
    };
    let (translations, scales) = (vectors("TRANSLATION", 0.0)?, vectors("SCALE", 1.0)?);
    let (rotations, wrong) = match attributes.get("ROTATION") {
        Some(index) => {
            let accessor = source.accessor(index, &place)?;
            let wrong = if accessor.data_type() == gltf::accessor::DataType::F32 { WRONG } else { WRONG_QUANTISED };
            (accessor::floats::<4>(&accessor, source, &place)?, wrong)
        }
        None => (vec![[0.0, 0.0, 0.0, 1.0]; count], WRONG),
    };
    let short = describe(node);
    let mut all = Vec::with_capacity(count);
    for (i, ((translation, rotation), scale)) in translations.into_iter().zip(rotations).zip(scales).enumerate() {
        let place = format!("{place}: instance {i}");
        let unit = unit_rotation(rotation, wrong, &place, &short, notes)?;
        let unit = unit.unwrap_or_else(|| DQuat::from_array(rotation.map(f64::from)));
        let node_from_instance = trs(translation, unit, scale);
        if !node_from_instance.is_finite() {
            return Err(Error::invalid(place, "its transform is not finite", "repair the instance's translation and scale"));
        }
        all.push(node_from_instance);
    }
    Ok(Some(all))
}
