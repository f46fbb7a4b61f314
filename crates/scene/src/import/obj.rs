//! Wavefront OBJ with MTL.

use super::builder::{Primitive, append};
use super::{ImportOptions, ImportReport, polygon, scene_name};
use crate::config::UpAxis;
use crate::contained::{self, Reach};
use crate::model::{Filter, Material, Object, OpticalMaterial, Scene, Texture, TextureRef, Wrap};
use crate::{Error, Result, io};
use glam::{Affine2, DMat4};
use std::collections::BTreeMap;
use std::path::Path;

/// Reads an OBJ file and the MTL files and textures it names.
pub(super) fn load(path: &Path, import: &ImportOptions) -> Result<(Scene, ImportReport)> {
    let file = path.display().to_string();
    let options = tobj::LoadOptions { triangulate: false, single_index: true, ignore_points: true, ignore_lines: true };
    let bytes = io::read(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let refused = std::cell::RefCell::new(None);
    let library =
        |name: &Path| match contained::resolve(folder, name, import.reach, &format!("{file}: mtllib"), contained::MESH_HELP) {
            Ok(path) => tobj::load_mtl(path),
            Err(error) => {
                refused.replace(Some(error));
                Err(tobj::LoadError::OpenFileFailed)
            }
        };
    let (models, materials) = tobj::load_obj_buf(&mut bytes.as_slice(), &options, library).map_err(|e| {
        Error::invalid(&file, format!("not readable as OBJ: {e}"), "the file is damaged or cut short; export it again")
    })?;
    if let Some(error) = refused.take() {
        return Err(error);
    }
    let materials = materials.map_err(|e| {
        Error::invalid(
            &file,
            format!("its mtllib cannot be read: {e}"),
            "put the .mtl file beside the .obj, or remove the mtllib line",
        )
    })?;

    let mut scene = Scene { name: scene_name(path), ..Scene::default() };
    let mut report = ImportReport::default();
    let mut textures = BTreeMap::new();
    for material in &materials {
        let place = format!("{file}: material \"{}\"", material.name);
        let optical = optical(material, folder, import.reach, &mut scene.textures, &mut textures, &place)?;
        scene.materials.push(Material { name: material.name.clone(), optical, radio: None });
    }
    let world_from_file = match import.up.unwrap_or(UpAxis::Z) {
        UpAxis::Y => DMat4::from_rotation_x(std::f64::consts::FRAC_PI_2),
        UpAxis::Z => DMat4::IDENTITY,
    };
    // A quarter turn has entries of 0 and ±1: rounding makes them exact.
    let world_from_file = DMat4::from_cols_array(&world_from_file.to_cols_array().map(f64::round));
    for (i, model) in models.iter().enumerate() {
        let place = format!("{file}: object {i} \"{}\"", model.name);
        let mesh = &model.mesh;
        let known = scene.objects.iter().position(|o| o.name == model.name);
        let object = known.unwrap_or_else(|| {
            scene.objects.push(Object { name: model.name.clone() });
            scene.objects.len() - 1
        }) as u32;
        let material = match mesh.material_id {
            Some(id) if id < materials.len() => id as u32,
            _ => without_material(&mut scene),
        };
        let positions: Vec<[f32; 3]> = mesh.positions.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect();
        let triangles = polygon::triangles(&mesh.indices, &mesh.face_arities, &positions, &place)?;
        let data = Primitive {
            positions,
            normals: mesh.normals.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect(),
            // OBJ counts v from the bottom.
            uvs: mesh.texcoords.chunks_exact(2).map(|v| [v[0], 1.0 - v[1]]).collect(),
            colors: Vec::new(),
            triangles,
            material,
            object,
        };
        append(&mut scene, &mut report, &data, &world_from_file, &place)?;
    }
    if scene.triangles.is_empty() {
        return Err(Error::invalid(file, "there is no triangle in it", "give a file with faces"));
    }
    Ok((scene, report))
}

fn without_material(scene: &mut Scene) -> u32 {
    const NAME: &str = "(no material)";
    let known = scene.materials.iter().position(|m| m.name == NAME);
    known.unwrap_or_else(|| {
        scene.materials.push(Material { name: NAME.into(), optical: OpticalMaterial::default(), radio: None });
        scene.materials.len() - 1
    }) as u32
}

/// MTL in terms of metallic-roughness: Kd (taken as linear) is the base colour, Ns a Blinn–Phong exponent, Ke emission, 1 − d
/// transmission, Ni the index of refraction.
fn optical(
    material: &tobj::Material,
    folder: &Path,
    reach: Reach,
    textures: &mut Vec<Texture>,
    known: &mut BTreeMap<String, u32>,
    place: &str,
) -> Result<OpticalMaterial> {
    let base_color_texture = match &material.diffuse_texture {
        None => None,
        Some(name) => {
            let texture = match known.get(name) {
                Some(texture) => *texture,
                None => {
                    let path = Path::new(&name.replace('\\', "/")).to_path_buf();
                    let path = contained::resolve(folder, &path, reach, &format!("{place}: map_Kd"), contained::MESH_HELP)?;
                    let bytes = std::fs::read(&path).map_err(|e| {
                        Error::invalid(
                            place,
                            format!("cannot read map_Kd {}: {e}", path.display()),
                            "put the texture where the .mtl says",
                        )
                    })?;
                    let texels = io::decode_rgba(&bytes, &path)?;
                    textures.push(Texture { name: name.clone(), texels, wrap: [Wrap::Repeat; 2], filter: Filter::Linear });
                    known.insert(name.clone(), textures.len() as u32 - 1);
                    textures.len() as u32 - 1
                }
            };
            Some(TextureRef { texture, uv_from_uv: Affine2::IDENTITY })
        }
    };
    let default = OpticalMaterial::default();
    let optical = OpticalMaterial {
        // A textured material's Kd multiplies the texture; many exporters leave it black and mean the texture alone.
        base_color: match material.diffuse {
            Some(kd) if base_color_texture.is_some() && kd == [0.0; 3] => [1.0; 3],
            Some(kd) => kd,
            None if base_color_texture.is_some() => [1.0; 3],
            None => default.base_color,
        },
        base_color_texture,
        // Blinn–Phong exponent n ↔ microfacet width α: α² = 2/(n + 2); roughness = √α.
        roughness: material.shininess.map_or(default.roughness, |n| (2.0 / (n.max(0.0) + 2.0)).sqrt().sqrt()),
        emissive: material.emissive.unwrap_or([0.0; 3]),
        transmission: 1.0 - material.dissolve.unwrap_or(1.0).clamp(0.0, 1.0),
        ior: material.optical_density.filter(|n| *n >= 1.0).unwrap_or(default.ior),
        ..default
    };
    let numbers = [optical.roughness, optical.transmission, optical.ior];
    if numbers.iter().chain(&optical.base_color).chain(&optical.emissive).any(|v| !v.is_finite()) {
        return Err(Error::invalid(place, "a value is not finite", "repair the .mtl file"));
    }
    Ok(optical)
}
