//! A mesh's primitives: attributes, indices, and morph targets at their default weights.

use super::super::builder::Primitive;
use super::super::notes::Notes;
use super::document::Source;
use super::{accessor, material};
use crate::{Error, Result};
use gltf::Semantic;
use gltf::mesh::Mode;
use serde_json::Value;

/// Whether a primitive has a surface; points and lines have none.
pub(super) fn is_surface(primitive: &gltf::Primitive<'_>) -> bool {
    !matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip)
}

/// Reads a primitive in its mesh's frame. `weights` are those of the morph targets, `material` the scene's number of its material;
/// the object is whoever uses the mesh.
pub(super) fn read(
    mesh: &gltf::Mesh<'_>,
    primitive: &gltf::Primitive<'_>,
    weights: &[f32],
    material: u32,
    source: &Source<'_>,
    notes: &mut Notes,
    place: &str,
) -> Result<Primitive> {
    let uv_set = material::tex_coord_set(&primitive.material());
    let of = |semantic: &Semantic| primitive.get(semantic);
    let Some(positions) = of(&Semantic::Positions) else {
        return Err(Error::invalid(place, "has no POSITION attribute", "export the model again"));
    };
    let (normals, uvs, colors) = (of(&Semantic::Normals), of(&Semantic::TexCoords(uv_set)), of(&Semantic::Colors(0)));
    let indices = primitive.indices();
    let used = [Some(&positions), normals.as_ref(), uvs.as_ref(), colors.as_ref(), indices.as_ref()];
    if primitive.extension_value("KHR_draco_mesh_compression").is_some() && !used.into_iter().flatten().all(accessor::has_data) {
        return Err(Error::invalid(
            place,
            "is compressed by KHR_draco_mesh_compression, and the file has no plain data for it",
            "export without Draco compression, or decompress the file (e.g. `gltf-transform copy in.glb out.glb`)",
        ));
    }
    let mut data = Primitive {
        positions: accessor::floats::<3>(&positions, source, place)?,
        normals: normals.map_or(Ok(Vec::new()), |a| accessor::floats::<3>(&a, source, place))?,
        uvs: uvs.map_or(Ok(Vec::new()), |a| accessor::floats::<2>(&a, source, place))?,
        colors: colors.map_or(Ok(Vec::new()), |a| accessor::colors(&a, source, place))?,
        triangles: Vec::new(),
        material,
        object: 0,
    };
    morph(&mut data, mesh, primitive, weights, uv_set, source, place)?;
    data.colors.iter_mut().flatten().filter(|c| c.is_finite()).for_each(|c| *c = c.clamp(0.0, 1.0));
    let indices = match indices {
        Some(accessor) => accessor::indices(&accessor, source, place)?,
        None => (0..data.positions.len() as u32).collect(),
    };
    data.triangles = triangles(primitive.mode(), &indices, place)?;
    unread(primitive, uv_set, notes, place);
    Ok(data)
}

/// Adds the morph targets' displacements at their weights.
fn morph(
    data: &mut Primitive,
    mesh: &gltf::Mesh<'_>,
    primitive: &gltf::Primitive<'_>,
    weights: &[f32],
    uv_set: u32,
    source: &Source<'_>,
    place: &str,
) -> Result<()> {
    let targets = source.raw["meshes"][mesh.index()]["primitives"][primitive.index()]["targets"].as_array();
    let targets = targets.map_or(&[][..], Vec::as_slice);
    if !weights.is_empty() && weights.len() != targets.len() {
        return Err(Error::invalid(
            place,
            format!("has {} morph targets, and the mesh or its node has {} weights", targets.len(), weights.len()),
            "every target needs one weight; export the model again",
        ));
    }
    for (k, (target, &weight)) in targets.iter().zip(weights).enumerate() {
        let place = format!("{place}: targets[{k}]");
        if !weight.is_finite() {
            return Err(Error::invalid(place, "its weight is not finite", "repair the mesh's or the node's weights"));
        }
        if weight == 0.0 {
            continue;
        }
        let get = |name: &str| match target.get(name) {
            None | Some(Value::Null) => Ok(None),
            Some(index) => source.accessor(index, &place).map(Some),
        };
        if let Some(a) = get("POSITION")? {
            add(&mut data.positions, &accessor::floats::<3>(&a, source, &place)?, weight, &place)?;
        }
        if let Some(a) = get("NORMAL")?.filter(|_| !data.normals.is_empty()) {
            add(&mut data.normals, &accessor::floats::<3>(&a, source, &place)?, weight, &place)?;
        }
        if let Some(a) = get(&format!("TEXCOORD_{uv_set}"))?.filter(|_| !data.uvs.is_empty()) {
            add(&mut data.uvs, &accessor::floats::<2>(&a, source, &place)?, weight, &place)?;
        }
        if let Some(a) = get("COLOR_0")?.filter(|_| !data.colors.is_empty()) {
            let differences = match a.dimensions() {
                gltf::accessor::Dimensions::Vec3 => {
                    accessor::floats::<3>(&a, source, &place)?.into_iter().map(|[r, g, b]| [r, g, b, 0.0]).collect()
                }
                _ => accessor::floats::<4>(&a, source, &place)?,
            };
            add(&mut data.colors, &differences, weight, &place)?;
        }
    }
    Ok(())
}

fn add<const N: usize>(values: &mut [[f32; N]], differences: &[[f32; N]], weight: f32, place: &str) -> Result<()> {
    if differences.len() != values.len() {
        return Err(Error::invalid(
            place,
            format!("has {} displacements for {} vertices", differences.len(), values.len()),
            "a target needs one value a vertex; export the model again",
        ));
    }
    for (value, difference) in values.iter_mut().flatten().zip(differences.iter().flatten()) {
        *value += weight * difference;
    }
    Ok(())
}

/// Notes the attributes that are not read.
fn unread(primitive: &gltf::Primitive<'_>, uv_set: u32, notes: &mut Notes, place: &str) {
    let short = place.rsplit_once(": ").map_or(place, |(_, end)| end);
    for (semantic, _) in primitive.attributes() {
        match semantic {
            Semantic::Tangents => {
                notes.note("TANGENT is not read: tangents are those of the texture coordinates", short);
            }
            Semantic::TexCoords(set) if set != uv_set => {
                notes.note(format!("TEXCOORD_{set} is not read: the textures are drawn with TEXCOORD_{uv_set}"), short);
            }
            Semantic::Colors(set) if set > 0 => {
                notes.note(format!("COLOR_{set} is not read: only COLOR_0 is a colour to glTF"), short);
            }
            Semantic::Extras(name) => notes.note(format!("the file's own attribute _{name} is not read"), short),
            _ => {}
        }
    }
}

/// Lists, strips and fans as triangles (glTF 2.0 §3.7.2.1).
fn triangles(mode: Mode, indices: &[u32], place: &str) -> Result<Vec<[u32; 3]>> {
    if indices.len() < 3 || (mode == Mode::Triangles && !indices.len().is_multiple_of(3)) {
        return Err(Error::invalid(
            place,
            format!("{} indices make no whole triangles", indices.len()),
            "the file is damaged; export the model again",
        ));
    }
    Ok(match mode {
        // Every second triangle of a strip is wound the other way.
        Mode::TriangleStrip => indices
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .collect(),
        Mode::TriangleFan => indices[1..].windows(2).map(|w| [indices[0], w[0], w[1]]).collect(),
        _ => indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    })
}
