//! glTF 2.0: the node tree, meshes and lights.

mod accessor;
mod document;
mod material;
mod node;
mod primitive;
mod skin;
mod texture;
mod unread;

use super::builder::{append, check_size};
use super::notes::Notes;
use super::{ImportOptions, ImportReport, UpAxis, scene_name};
use crate::model::{LightMaterial, Material, Object, PunctualKind, PunctualLight, Scene};
use crate::{Error, Result};
use document::Source;
use glam::{DMat4, DVec3, DVec4};
use std::path::Path;

/// World (z up) from glTF (y up): `(x, y, z) → (x, −z, y)`.
const WORLD_FROM_GLTF: DMat4 = DMat4::from_cols(
    DVec4::new(1.0, 0.0, 0.0, 0.0),
    DVec4::new(0.0, 0.0, 1.0, 0.0),
    DVec4::new(0.0, -1.0, 0.0, 0.0),
    DVec4::new(0.0, 0.0, 0.0, 1.0),
);

/// Reads a `.glb` or `.gltf` file's bytes; `path` resolves and names what it refers to.
pub(super) fn load(bytes: &[u8], path: &Path, options: &ImportOptions) -> Result<(Scene, ImportReport)> {
    let source = Source::read(bytes, path, options.reach)?;
    let document = &source.document;
    let mut notes = Notes::default();
    let mut textures = texture::Textures::new(&source);
    let mut scene = Scene { name: scene_name(path), ..Scene::default() };
    for material in document.materials() {
        scene.materials.push(material::convert(&material, &mut textures, &mut notes)?);
    }
    scene.textures = textures.decode()?;

    let parents = node::parents(document);
    let roots: Vec<gltf::Node<'_>> = match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => scene.nodes().collect(),
        None => document.nodes().filter(|node| parents[node.index()].is_none()).collect(),
    };
    let world_from_file = match options.up {
        // The standard knows no other axis; files that were exported without turning say so in the scene file.
        Some(UpAxis::Z) => DMat4::IDENTITY,
        Some(UpAxis::Y) | None => WORLD_FROM_GLTF,
    };
    let world_from_file = match options.offset_m {
        Some(offset_m) => DMat4::from_translation(-DVec3::from(offset_m)) * world_from_file,
        None => world_from_file,
    };
    let seen = vec![false; document.nodes().len()];
    let offset = options.offset_m.is_some();
    let skins = skin::Skins::new(&source, world_from_file, offset, parents, &roots);
    let mut reader = Reader { source: &source, scene, report: ImportReport::default(), notes, seen, skins, offset };
    // Depth first, in the file's order: object numbers follow the order a person sees in the file.
    let mut stack: Vec<Visit<'_>> = roots.into_iter().rev().map(|n| (n, world_from_file, true)).collect();
    while let Some((node, world_from_parent, shown)) = stack.pop() {
        let (world_from_node, shown) = reader.node(&node, &world_from_parent, shown)?;
        let children: Vec<gltf::Node<'_>> = node.children().collect();
        stack.extend(children.into_iter().rev().map(|n| (n, world_from_node, shown)));
    }
    let Reader { scene, mut report, mut notes, seen, .. } = reader;
    if scene.triangles.is_empty() {
        return Err(Error::invalid(&source.name, "there is no triangle in it", "give a file with triangle meshes"));
    }
    unread::note(&source, &seen, &mut notes);
    notes.finish(&mut report);
    Ok((scene, report))
}

/// A node, `world_from_parent`, and whether all above it are visible.
type Visit<'a> = (gltf::Node<'a>, DMat4, bool);

struct Reader<'a> {
    source: &'a Source<'a>,
    scene: Scene,
    report: ImportReport,
    notes: Notes,
    /// Per node, whether it has been visited.
    seen: Vec<bool>,
    skins: skin::Skins<'a>,
    /// Whether a point far away becomes the origin, so that translations are wanted to their last digit.
    offset: bool,
}

impl Reader<'_> {
    /// Takes a node's mesh and light into the scene; returns `world_from_node` and whether its children are shown.
    fn node(&mut self, node: &gltf::Node<'_>, world_from_parent: &DMat4, shown: bool) -> Result<(DMat4, bool)> {
        let short = node::describe(node);
        let place = format!("{}: {short}", self.source.name);
        if std::mem::replace(&mut self.seen[node.index()], true) {
            return Err(Error::invalid(
                place,
                "has two parents or is its own ancestor",
                "a node tree is a tree; export the model again",
            ));
        }
        let mut parent_from_node = node::parent_from_node(node, &place, &mut self.notes)?;
        if self.offset {
            node::translate_in_doubles(&mut parent_from_node, &self.source.raw["nodes"][node.index()]);
        }
        let world_from_node = *world_from_parent * parent_from_node;
        if !world_from_node.is_finite() {
            return Err(Error::invalid(place, "its transform is not finite", "repair the node's matrix"));
        }
        let shown = shown && node::is_visible(node, &place)?;
        if !shown {
            if node.mesh().is_some() || node.light().is_some() {
                self.notes.note("is left out: KHR_node_visibility says that it or a node above it is not visible", short);
            }
            return Ok((world_from_node, false));
        }
        if let Some(light) = node.light() {
            self.scene.lights.push(punctual(&light, &world_from_node));
        }
        if let Some(mesh) = node.mesh() {
            self.mesh(node, &mesh, &world_from_node, &place)?;
        }
        Ok((world_from_node, true))
    }

    /// Takes a node's mesh, or each of its instances, into the scene as objects.
    fn mesh(&mut self, node: &gltf::Node<'_>, mesh: &gltf::Mesh<'_>, world_from_node: &DMat4, place: &str) -> Result<()> {
        let name = node.name().or(mesh.name()).map_or_else(|| format!("node {}", node.index()), str::to_string);
        let weights = node.weights().or(mesh.weights()).unwrap_or(&[]);
        let joints = node.skin().map(|skin| self.skins.joints(&skin, place, &mut self.notes)).transpose()?;
        let mut primitives = Vec::new();
        for primitive in mesh.primitives() {
            if !primitive::is_surface(&primitive) {
                self.report.skipped_primitives += 1;
                continue;
            }
            let place = format!("{place}: meshes[{}].primitives[{}]", mesh.index(), primitive.index());
            let material = match primitive.material().index() {
                Some(i) => i as u32,
                None => self.default_material(),
            };
            let mut data = primitive::read(mesh, &primitive, weights, material, self.source, &mut self.notes, &place)?;
            if let Some(world_from_bind) = &joints {
                skin::pose(&mut data, &primitive, world_from_bind, self.source, &mut self.notes, &place)?;
            }
            primitives.push((data, place));
        }
        let Some(instances) = node::instances(node, self.source, place, &mut self.notes)? else {
            // Joints have put a skinned mesh where it stands.
            let world_from_mesh = if joints.is_some() { DMat4::IDENTITY } else { *world_from_node };
            return self.object(name, &mut primitives, &world_from_mesh);
        };
        if joints.is_some() {
            let what = "it has a skin and EXT_mesh_gpu_instancing, and nothing says where the instances of a skinned mesh stand";
            return Err(Error::invalid(place, what, "export the instances as nodes, or the mesh without its skin"));
        }
        let triangles = primitives.iter().map(|(p, _)| p.triangles.len()).sum();
        check_size(self.scene.triangles.len(), triangles, instances.len(), place)?;
        let objects = self.scene.objects.len() + instances.len();
        if objects > node::MAX_INSTANCES {
            let what = format!("its instances make {objects} objects; {} are the most", node::MAX_INSTANCES);
            return Err(Error::invalid(place, what, "simplify the model"));
        }
        for (i, node_from_instance) in instances.iter().enumerate() {
            self.object(format!("{name} (instance {i})"), &mut primitives, &(*world_from_node * *node_from_instance))?;
        }
        Ok(())
    }

    fn object(
        &mut self,
        name: String,
        primitives: &mut [(super::builder::Primitive, String)],
        world_from_mesh: &DMat4,
    ) -> Result<()> {
        let object = self.scene.objects.len() as u32;
        self.scene.objects.push(Object { name });
        for (data, place) in primitives {
            data.object = object;
            append(&mut self.scene, &mut self.report, data, world_from_mesh, place)?;
        }
        Ok(())
    }

    /// The material of primitives that name none (glTF 2.0 §3.7.2.1).
    fn default_material(&mut self) -> u32 {
        const NAME: &str = "(no material)";
        let known = self.scene.materials.iter().position(|m| m.name == NAME);
        known.unwrap_or_else(|| {
            let light = LightMaterial { base_color: [1.0; 3], metallic: 1.0, double_sided: false, ..Default::default() };
            self.scene.materials.push(Material { name: NAME.into(), light, radio: None });
            self.scene.materials.len() - 1
        }) as u32
    }
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
