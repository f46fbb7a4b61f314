//! Wavefront OBJ with MTL.

use super::builder::{Primitive, append, check_size};
use super::notes::Notes;
use super::obj_material::{self, Entry, Textures};
use super::obj_text::{self, Mesh, Obj};
use super::{ImportOptions, ImportReport, UpAxis, polygon, scene_name};
use crate::model::{LightMaterial, Material, Object, Scene};
use crate::{Error, Result, io};
use glam::DMat4;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;

/// The material of faces that ask for none.
const NO_MATERIAL: &str = "(no material)";

/// Reads an OBJ file and the MTL files and textures it names.
pub(super) fn load(path: &Path, import: &ImportOptions) -> Result<(Scene, ImportReport)> {
    let file = path.display().to_string();
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut notes = Notes::default();
    let up = import.up.unwrap_or(UpAxis::Z);
    // World from file turns (x, y, z) to (x, -z, y) where y is up.
    let origin = import.offset_m.map(|[x, y, z]| if up == UpAxis::Y { [x, z, -y] } else { [x, y, z] });
    let obj = obj_text::read(&io::read(path)?, &file, origin, &mut notes)?;
    let mut scene = Scene { name: scene_name(path), ..Scene::default() };
    let mut report = ImportReport { skipped_primitives: obj.skipped, ..ImportReport::default() };
    let libraries = libraries(&obj, folder, import, &file, &mut notes)?;
    scene.materials = materials(&obj, &libraries, &mut Textures::new(folder, import), &mut scene.textures, &file, &mut notes)?;

    let world_from_file = match up {
        UpAxis::Y => DMat4::from_rotation_x(std::f64::consts::FRAC_PI_2),
        UpAxis::Z => DMat4::IDENTITY,
    };
    // A quarter turn has entries of 0 and ±1: rounding makes them exact.
    let world_from_file = DMat4::from_cols_array(&world_from_file.to_cols_array().map(f64::round));
    // Of several materials of one name the last counts.
    let materials: HashMap<_, _> = scene.materials.iter().enumerate().map(|(i, m)| (m.name.clone(), i as u32)).collect();
    let mut objects = HashMap::new();
    for (i, mesh) in obj.meshes.into_iter().enumerate() {
        let place = format!("{file}: object {i} \"{}\"", mesh.name);
        let triangles =
            polygon::triangles(&mesh.corners, &mesh.arities, &mesh.positions, |face| format!("{file}:{}", mesh.lines[face]))?;
        check_size(scene.triangles.len(), triangles.len(), 1, &place)?;
        let material = match mesh.material.as_ref().and_then(|name| materials.get(name)) {
            Some(material) => *material,
            None => without_material(&mut scene, obj.colored.contains(&None)),
        };
        let object = *objects.entry(mesh.name).or_insert_with_key(|name| {
            scene.objects.push(Object { name: name.clone() });
            scene.objects.len() as u32 - 1
        });
        let Mesh { positions, normals, uvs, colors, .. } = mesh;
        let data = Primitive { positions, normals, uvs, colors, triangles, material, object };
        append(&mut scene, &mut report, &data, &world_from_file, &place)?;
    }
    if scene.triangles.is_empty() {
        return Err(Error::invalid(file, "there is no triangle in it", "give a file with faces"));
    }
    notes.finish(&mut report);
    Ok((scene, report))
}

/// The materials of all libraries that are there. One line may name several, or one with spaces in its name.
fn libraries(obj: &Obj, folder: &Path, import: &ImportOptions, file: &str, notes: &mut Notes) -> Result<Vec<Entry>> {
    let (mut all, mut read) = (Vec::new(), BTreeSet::new());
    for (line, names) in &obj.libraries {
        let place = format!("{file}:{line}: mtllib");
        let mut library = |name: &str, notes: &mut Notes| -> Result<bool> {
            if read.contains(name) {
                return Ok(true);
            }
            let entries = obj_material::library(folder, name, import, &place, notes)?;
            let there = entries.is_some();
            all.extend(entries.into_iter().flatten());
            if there {
                read.insert(name.to_string());
            }
            Ok(there)
        };
        if library(names, notes)? {
            continue;
        }
        let apart: Vec<&str> = names.split_whitespace().collect();
        // A name with spaces that is not there, or several names of which some are not.
        let several = apart.len() > 1 && apart.iter().all(|name| name.to_ascii_lowercase().ends_with(".mtl"));
        for name in if several { apart } else { vec![names.as_str()] } {
            if !library(name, notes)? {
                notes.warn(format!("there is no {name}: materials that only it defines are a default grey"), &place);
            }
        }
    }
    Ok(all)
}

/// All materials: those of the libraries in their order, then those that faces use and no library defines, whose names a scene file can map.
fn materials(
    obj: &Obj,
    libraries: &[Entry],
    textures: &mut Textures<'_>,
    scene_textures: &mut Vec<crate::model::Texture>,
    file: &str,
    notes: &mut Notes,
) -> Result<Vec<Material>> {
    let used: BTreeSet<&str> = obj.materials.iter().map(|(name, _)| name.as_str()).collect();
    let mut all = Vec::with_capacity(libraries.len());
    for entry in libraries {
        let name = entry.material.name.clone();
        let colored = obj.colored.contains(&Some(name.clone()));
        let light = if used.contains(name.as_str()) {
            obj_material::light(entry, colored, textures, notes)?
        } else {
            // What no face uses needs no textures.
            obj_material::light(&entry.without_maps(), colored, textures, &mut Notes::default())?
        };
        all.push(Material { name, light, radio: None });
    }
    let defined: BTreeSet<&str> = libraries.iter().map(|e| e.material.name.as_str()).collect();
    for (name, line) in obj.materials.iter().filter(|(name, _)| !defined.contains(name.as_str())) {
        notes.warn(format!("no library defines material \"{name}\": it is a default grey"), format!("{file}:{line}"));
        all.push(Material { name: name.clone(), light: plain(obj.colored.contains(&Some(name.clone()))), radio: None });
    }
    scene_textures.append(&mut textures.all);
    Ok(all)
}

/// A default grey, or white where the vertices have colours.
fn plain(colored: bool) -> LightMaterial {
    let default = LightMaterial::default();
    LightMaterial { base_color: if colored { [1.0; 3] } else { default.base_color }, ..default }
}

fn without_material(scene: &mut Scene, colored: bool) -> u32 {
    let known = scene.materials.iter().position(|m| m.name == NO_MATERIAL);
    known.unwrap_or_else(|| {
        scene.materials.push(Material { name: NO_MATERIAL.into(), light: plain(colored), radio: None });
        scene.materials.len() - 1
    }) as u32
}
