//! glTF 2.0: the node tree, primitives and lights.

use super::builder::{Primitive, append};
use super::gltf_material::{self, Textures};
use super::{ImportReport, gltf_accessor, scene_name};
use crate::model::{Object, PunctualKind, PunctualLight, Scene};
use crate::{Error, Result};
use glam::{DMat4, DVec3, DVec4, Mat4};
use gltf::mesh::Mode;
use std::path::Path;

/// World (z up) from glTF (y up): `(x, y, z) → (x, −z, y)`.
const WORLD_FROM_GLTF: DMat4 = DMat4::from_cols(
    DVec4::new(1.0, 0.0, 0.0, 0.0),
    DVec4::new(0.0, 0.0, 1.0, 0.0),
    DVec4::new(0.0, -1.0, 0.0, 0.0),
    DVec4::new(0.0, 0.0, 0.0, 1.0),
);

/// Reads a `.glb` or `.gltf` file's bytes; `path` resolves and names what it refers to.
pub(super) fn load(bytes: &[u8], path: &Path) -> Result<(Scene, ImportReport)> {
    let file = path.display().to_string();
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice_without_validation(bytes).map_err(|e| {
        Error::invalid(
            &file,
            format!("not readable as glTF: {e}"),
            "the file is damaged, cut short or no glTF 2.0; export the model again",
        )
    })?;
    check(document.as_json(), &file)?;
    let buffers = buffers(&document, blob, path)?;
    let mut report = ImportReport::default();
    let mut textures = Textures::new(&document, &buffers, path);
    let mut scene = Scene { name: scene_name(path), ..Scene::default() };
    for material in document.materials() {
        scene.materials.push(gltf_material::convert(&material, &mut textures, &mut report)?);
    }
    scene.textures = textures.decode()?;

    let roots: Vec<gltf::Node<'_>> = match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => scene.nodes().collect(),
        None => document.nodes().collect(),
    };
    let mut reader = Reader { file, buffers: &buffers, scene, report, seen: vec![false; document.nodes().count()] };
    // Depth first, in the file's order: object numbers follow the order a person sees in the file.
    let mut stack: Vec<(gltf::Node<'_>, DMat4)> = roots.into_iter().rev().map(|n| (n, WORLD_FROM_GLTF)).collect();
    while let Some((node, world_from_parent)) = stack.pop() {
        let world_from_node = world_from_parent * Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
        reader.node(&node, &world_from_node)?;
        let children: Vec<gltf::Node<'_>> = node.children().collect();
        stack.extend(children.into_iter().rev().map(|n| (n, world_from_node)));
    }
    if reader.scene.triangles.is_empty() {
        return Err(Error::invalid(reader.file, "there is no triangle in it", "give a file with triangle meshes"));
    }
    Ok((reader.scene, reader.report))
}

/// What the format's own rules say: every reference leads somewhere, every enumeration is known.
fn check(root: &gltf::json::Root, file: &str) -> Result<()> {
    use gltf::json::validation::{Error as Fault, Validate};
    let broken = |what: String| Err(Error::invalid(file, format!("not readable as glTF: {what}"), "export the model again"));
    // The validator looks accessors up before it has checked that they exist, so this comes first.
    for (i, mesh) in root.meshes.iter().enumerate() {
        for (k, p) in mesh.primitives.iter().enumerate() {
            if let Some(a) = p.attributes.values().chain(&p.indices).find(|a| a.value() >= root.accessors.len()) {
                return broken(format!("meshes[{i}].primitives[{k}] uses accessor {} of {}", a.value(), root.accessors.len()));
            }
        }
    }
    let mut faults = Vec::new();
    root.validate(root, gltf::json::Path::new, &mut |path, fault| faults.push((path().to_string(), fault)));
    // Positions without bounds are against the rules and harmless: nothing here reads the bounds.
    faults.retain(|(path, fault)| !(matches!(fault, Fault::Missing) && (path.ends_with(".min") || path.ends_with(".max"))));
    match faults.first() {
        None => Ok(()),
        Some((path, Fault::Unsupported)) => {
            let names = root.extensions_required.join(", ");
            Err(Error::invalid(
                file,
                format!("{path}: requires an extension this does not read (it lists {names})"),
                "export it without compression and other required extensions (no Draco, meshopt or KTX2)",
            ))
        }
        Some((path, fault)) => broken(format!("{path}: {fault} ({} faults in all)", faults.len())),
    }
}

/// The bytes of every buffer, at least as many as each declares.
fn buffers(document: &gltf::Document, mut blob: Option<Vec<u8>>, path: &Path) -> Result<Vec<Vec<u8>>> {
    document
        .buffers()
        .map(|buffer| {
            let place = format!("{}: buffers[{}]", path.display(), buffer.index());
            let bytes = match buffer.source() {
                gltf::buffer::Source::Bin => blob.take().ok_or_else(|| {
                    Error::invalid(&place, "the file has no binary chunk for it", "the file is cut short; export it again")
                })?,
                gltf::buffer::Source::Uri(uri) => gltf_material::read_uri(uri, path, &place)?,
            };
            if bytes.len() < buffer.length() {
                return Err(Error::invalid(
                    place,
                    format!("has {} bytes where the file declares {}", bytes.len(), buffer.length()),
                    "the file is damaged or cut short; export the model again",
                ));
            }
            Ok(bytes)
        })
        .collect()
}

struct Reader<'a> {
    file: String,
    buffers: &'a [Vec<u8>],
    scene: Scene,
    report: ImportReport,
    seen: Vec<bool>,
}

impl Reader<'_> {
    fn node(&mut self, node: &gltf::Node<'_>, world_from_node: &DMat4) -> Result<()> {
        let place =
            format!("{}: nodes[{}]{}", self.file, node.index(), node.name().map(|n| format!(" \"{n}\"")).unwrap_or_default());
        if std::mem::replace(&mut self.seen[node.index()], true) {
            return Err(Error::invalid(
                place,
                "has two parents or is its own ancestor",
                "a node tree is a tree; export the model again",
            ));
        }
        if !world_from_node.is_finite() {
            return Err(Error::invalid(place, "its transform is not finite", "repair the node's matrix"));
        }
        if node.skin().is_some() {
            self.report.notes.push(format!("{place}: its skin is not applied; the mesh is taken in its bind pose"));
        }
        if let Some(light) = node.light() {
            self.scene.lights.push(punctual(&light, world_from_node));
        }
        let Some(mesh) = node.mesh() else { return Ok(()) };
        let name = node.name().or(mesh.name()).map_or_else(|| format!("node {}", node.index()), str::to_string);
        let object = self.scene.objects.len() as u32;
        self.scene.objects.push(Object { name });
        for primitive in mesh.primitives() {
            let place = format!("{place}: meshes[{}].primitives[{}]", mesh.index(), primitive.index());
            self.primitive(&primitive, object, world_from_node, &place)?;
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &gltf::Primitive<'_>, object: u32, world_from_node: &DMat4, place: &str) -> Result<()> {
        if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
            self.report.skipped_primitives += 1;
            return Ok(());
        }
        if primitive.extension_value("KHR_draco_mesh_compression").is_some() {
            return Err(Error::invalid(place, "is compressed with Draco", "export without compression"));
        }
        let material = match primitive.material().index() {
            Some(i) => i as u32,
            None => self.default_material(),
        };
        use gltf::Semantic;
        let Some(positions) = primitive.get(&Semantic::Positions) else {
            return Err(Error::invalid(place, "has no POSITION attribute", "export the model again"));
        };
        let positions = gltf_accessor::floats::<3>(&positions, self.buffers, place)?;
        let normals = match primitive.get(&Semantic::Normals) {
            Some(accessor) => gltf_accessor::floats::<3>(&accessor, self.buffers, place)?,
            None => Vec::new(),
        };
        let uvs = match primitive.get(&Semantic::TexCoords(gltf_material::tex_coord_set(&primitive.material()))) {
            Some(accessor) => gltf_accessor::floats::<2>(&accessor, self.buffers, place)?,
            None => Vec::new(),
        };
        let indices = match primitive.indices() {
            Some(accessor) => gltf_accessor::indices(&accessor, self.buffers, place)?,
            None => (0..positions.len() as u32).collect(),
        };
        let triangles = triangles(primitive.mode(), &indices, place)?;
        let data = Primitive { positions, normals, uvs, triangles, material, object };
        append(&mut self.scene, &mut self.report, &data, world_from_node, place)
    }

    /// The material of primitives that name none (glTF 2.0 §3.7.2.1).
    fn default_material(&mut self) -> u32 {
        const NAME: &str = "(no material)";
        let known = self.scene.materials.iter().position(|m| m.name == NAME);
        known.unwrap_or_else(|| {
            let optical =
                crate::model::OpticalMaterial { base_color: [1.0; 3], metallic: 1.0, double_sided: false, ..Default::default() };
            self.scene.materials.push(crate::model::Material { name: NAME.into(), optical, radio: None });
            self.scene.materials.len() - 1
        }) as u32
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

fn punctual(light: &gltf::khr_lights_punctual::Light<'_>, world_from_node: &DMat4) -> PunctualLight {
    use gltf::khr_lights_punctual::Kind;
    PunctualLight {
        kind: match light.kind() {
            Kind::Point => PunctualKind::Point,
            Kind::Directional => PunctualKind::Directional,
            Kind::Spot { inner_cone_angle, outer_cone_angle } => {
                PunctualKind::Spot { inner_rad: inner_cone_angle, outer_rad: outer_cone_angle }
            }
        },
        position: world_from_node.transform_point3(DVec3::ZERO).as_vec3(),
        // Lights shine along their node's −z.
        direction: world_from_node.transform_vector3(-DVec3::Z).try_normalize().unwrap_or(-DVec3::Z).as_vec3(),
        intensity: light.color().map(|c| c * light.intensity()),
        range_m: light.range(),
    }
}
