//! Notes about the parts of a glTF file that are not read.

use super::super::notes::Notes;
use super::document::{READ, Source, WITH_FALLBACK};
use super::node::describe;
use serde_json::Value;

/// The effect of leaving out a glTF extension, in words; `None` for one that changes neither light nor radio.
fn left_out(extension: &str) -> Option<&'static str> {
    Some(match extension {
        "KHR_materials_clearcoat" => "surfaces have no coat",
        "KHR_materials_sheen" => "fabrics have no sheen",
        "KHR_materials_specular" => "reflectance follows from the index of refraction alone",
        "KHR_materials_volume" => "glass is thin, without refraction and attenuation",
        "KHR_materials_iridescence" | "KHR_materials_anisotropy" | "KHR_materials_dispersion" => {
            "reflection is that of the base material"
        }
        "KHR_materials_diffuse_transmission" => "no light is scattered through",
        "KHR_materials_variants" => "the materials are those of the default variant",
        "EXT_lights_image_based" | "EXT_lights_ies" => "this light does not shine",
        "MSFT_lod" => "the finest level is taken",
        "KHR_animation_pointer"
        | "KHR_audio"
        | "KHR_audio_emitter"
        | "KHR_interactivity"
        | "KHR_node_hoverability"
        | "KHR_node_selectability"
        | "KHR_physics_rigid_bodies"
        | "KHR_xmp"
        | "KHR_xmp_json_ld" => return None,
        _ => "the file is drawn as if it were not there",
    })
}

/// Notes every kind of thing in the file that was not read; `seen` says which nodes were.
pub(super) fn note(source: &Source<'_>, seen: &[bool], notes: &mut Notes) {
    let document = &source.document;
    for animation in document.animations() {
        notes.note("animations are not played: everything stands as its node says", format!("animations[{}]", animation.index()));
    }
    for node in document.nodes() {
        if node.camera().is_some() {
            notes.note("cameras of the file are not used: keyframes are taken along [trajectory]", describe(&node));
        }
        if !seen[node.index()] && (node.mesh().is_some() || node.light().is_some()) {
            notes.warn("is in no scene that is read (the file's default scene, else its first)", describe(&node));
        }
    }
    let mut used = vec![false; document.meshes().len()];
    document.nodes().filter_map(|node| node.mesh()).for_each(|mesh| used[mesh.index()] = true);
    for mesh in document.meshes().filter(|mesh| !used[mesh.index()]) {
        notes.note("no node uses it: it stands nowhere", format!("meshes[{}]", mesh.index()));
    }
    for material in document.materials().filter(|m| m.occlusion_texture().is_some()) {
        let place = format!("materials[{}]", material.index().unwrap_or(0));
        notes.note("its occlusion texture is not read: occlusion is traced", place);
    }
    if let Some(members) = source.raw.as_object() {
        for (member, value) in members {
            match value.as_array() {
                Some(list) => list.iter().enumerate().for_each(|(i, v)| {
                    let name = v.get("name").and_then(Value::as_str).map(|n| format!(" \"{n}\"")).unwrap_or_default();
                    extensions(v, &format!("{member}[{i}]{name}"), notes);
                }),
                None if member == "extensions" => named(value, "extensions", notes),
                None if member == "extras" => {}
                None => extensions(value, member, notes),
            }
        }
    }
}

/// Walks through everything below `value`; the JSON reader has bounded how deep that goes.
fn extensions(value: &Value, place: &str, notes: &mut Notes) {
    match value {
        Value::Object(members) => {
            for (member, below) in members {
                match member.as_str() {
                    "extensions" => named(below, place, notes),
                    "extras" => {}
                    _ => extensions(below, place, notes),
                }
            }
        }
        Value::Array(list) => list.iter().for_each(|below| extensions(below, place, notes)),
        _ => {}
    }
}

/// Notes those of an `extensions` object that are not read, and goes on below those that are.
fn named(value: &Value, place: &str, notes: &mut Notes) {
    for (name, below) in value.as_object().into_iter().flatten() {
        if READ.contains(&name.as_str()) {
            extensions(below, place, notes);
        } else if !WITH_FALLBACK.contains(&name.as_str()) {
            match left_out(name) {
                Some(what) => notes.warn(format!("{name} is not read: {what}"), place),
                None => notes.note(format!("{name} is not read"), place),
            }
        }
    }
}
