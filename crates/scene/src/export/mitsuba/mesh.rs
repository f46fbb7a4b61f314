//! Meshes: binary PLY with normals, texture coordinates and colours, and the emitters on them.

use super::emission::{EmissionMap, emission_share, is_colored, repeats};
use super::light::{luminance, sampling_weight};
use super::material;
use super::texture::{Textures, Use};
use super::xml::Xml;
use super::{Files, slug};
use crate::{Result, Scene};
use glam::{Affine2, Vec2, Vec3};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Half of what lies between the two sheets of a surface that emits on both sides, metres.
const HALF_GAP_M: f32 = 5e-5;
/// Emitting triangles beyond this number are not told apart by their texture coordinates.
const MAX_UNFOLDED: usize = 2048;

/// Indices of the materials that triangles have, in order.
pub(super) fn used_materials(scene: &Scene) -> BTreeSet<u32> {
    scene.triangles.iter().map(|t| t.material).collect()
}

/// Number of shapes and emitters written.
pub(super) struct Written {
    pub shapes: usize,
    pub emitters: usize,
}

/// A vertex as it is written.
#[derive(Clone, Copy)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    uv: Vec2,
    color: [f32; 3],
}

/// Triangles of one shape.
struct Mesh {
    vertices: Vec<Vertex>,
    triangles: Vec<[u32; 3]>,
    colored: bool,
}

/// Writes every shape: `meshes/*.ply` into `files`, the rest into `xml`.
///
/// # Errors
/// A texture that cannot be encoded.
pub(super) fn write(
    scene: &Scene,
    textures: &mut Textures<'_>,
    files: &mut Files,
    xml: &mut Xml,
    approximated: &mut BTreeSet<String>,
) -> Result<Written> {
    let mut by_key: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    for (i, triangle) in scene.triangles.iter().enumerate() {
        by_key.entry((triangle.object, triangle.material)).or_default().push(i);
    }
    let colored: Vec<bool> = (0..scene.materials.len() as u32).map(|m| is_colored(scene, m)).collect();
    let mut written = Written { shapes: 0, emitters: 0 };
    for ((object, index), members) in by_key {
        let m = &scene.materials[index as usize].light;
        let share = emission_share(m);
        let radiance = m.emissive.map(|e| e * share);
        let emits = luminance(radiance) > 0.0;
        let texture = m.emissive_texture.filter(|t| emits && textures.get(Some(t)).is_some());
        let map = EmissionMap::of(scene, index);
        let whole = Mesh::of(scene, &members, &map, colored[index as usize], m.base_color);
        let mut meshes = match texture {
            Some(reference) => {
                let (meshes, inside) = whole.unfolded(repeats(textures, &reference));
                if !inside {
                    let name = &scene.materials[index as usize].name;
                    approximated
                        .insert(format!("material \"{name}\": its emission's texture is seen more than once on a triangle"));
                }
                meshes
            }
            None => vec![whole],
        };
        if emits && m.double_sided {
            meshes = meshes.into_iter().flat_map(|mesh| mesh.sheets()).collect();
        }
        for mesh in meshes {
            let id = format!("o_{}_{}", written.shapes, slug(&scene.objects[object as usize].name));
            let name = format!("meshes/{id}.ply");
            xml.open("shape", &[("type", "ply"), ("id", &id)]);
            xml.value("string", "filename", &name);
            xml.empty("ref", &[("id", &material::id(scene, index)), ("name", "bsdf")]);
            if emits {
                xml.open("emitter", &[("type", "area")]);
                match texture {
                    Some(r) => textures.write(xml, "radiance", r.texture, Affine2::IDENTITY, Use::Emission(radiance))?,
                    None => xml.rgb("radiance", radiance),
                }
                sampling_weight(xml, std::f32::consts::PI * mesh.area() * luminance(radiance));
                xml.close();
                written.emitters += 1;
            }
            xml.close();
            files.push((name, mesh.encode()));
            written.shapes += 1;
        }
    }
    Ok(written)
}

impl Mesh {
    /// The triangles `members`, their normals on the side that their corners' order says is the front.
    fn of(scene: &Scene, members: &[usize], map: &EmissionMap, colored: bool, base_color: [f32; 3]) -> Self {
        let mut mesh = Self { vertices: Vec::new(), triangles: Vec::with_capacity(members.len()), colored };
        let mut index_of: HashMap<(u32, bool), u32> = HashMap::new();
        for &i in members {
            let [a, b, c] = scene.corners(i);
            let facing = (b - a).cross(c - a).normalize_or(Vec3::Z);
            mesh.triangles.push(scene.triangles[i].vertices.map(|v| {
                let normal = scene.normals.get(v as usize).copied().filter(|n| n.length_squared() > 0.0).unwrap_or(facing);
                let turned = normal.dot(facing) < 0.0;
                *index_of.entry((v, turned)).or_insert_with(|| {
                    let uv = scene.uvs.get(v as usize).map_or(Vec2::ZERO, |t| Vec2::from(*t));
                    let of_vertex = scene.colors.get(v as usize).map_or([1.0; 3], |c| [c[0], c[1], c[2]]);
                    mesh.vertices.push(Vertex {
                        position: scene.positions[v as usize],
                        normal: if turned { -normal } else { normal },
                        uv: map.uv_from_uv.transform_point2(uv),
                        color: std::array::from_fn(|c| (of_vertex[c] * base_color[c]).clamp(0.0, 1.0)),
                    });
                    mesh.vertices.len() as u32 - 1
                })
            }));
        }
        mesh
    }

    fn corners(&self, triangle: &[u32; 3]) -> [Vertex; 3] {
        triangle.map(|v| self.vertices[v as usize])
    }

    fn area(&self) -> f32 {
        let area = |t: &[u32; 3]| {
            let [a, b, c] = self.corners(t).map(|v| v.position);
            0.5 * (b - a).cross(c - a).length()
        };
        self.triangles.iter().map(area).sum()
    }

    /// The mesh in parts in which no place of the texture is met twice, within the unit square where `wraps` allows it; and whether all of
    /// every triangle is.
    fn unfolded(self, wraps: bool) -> (Vec<Self>, bool) {
        let mut parts: Vec<(Vec<[Vec2; 3]>, Self)> = Vec::new();
        let apart = self.triangles.len() <= MAX_UNFOLDED;
        let mut inside = apart;
        for triangle in &self.triangles {
            let mut corners = self.corners(triangle);
            let least = corners.iter().fold(Vec2::MAX, |m, v| m.min(v.uv));
            // What begins a rounding below a whole number begins there.
            let shift = if wraps { (least + 1e-4).floor() } else { Vec2::ZERO };
            corners.iter_mut().for_each(|v| v.uv -= shift);
            let uvs = corners.map(|v| v.uv);
            inside &= uvs.iter().all(|uv| uv.cmpge(Vec2::splat(-1e-3)).all() && uv.cmple(Vec2::splat(1.001)).all());
            let free = |taken: &[[Vec2; 3]]| !apart || !taken.iter().any(|t| overlap(t, &uvs));
            let place = match parts.iter().position(|(taken, _)| free(taken)) {
                Some(place) => place,
                None => {
                    parts.push((Vec::new(), Self { vertices: Vec::new(), triangles: Vec::new(), colored: self.colored }));
                    parts.len() - 1
                }
            };
            let (taken, part) = &mut parts[place];
            let first = part.vertices.len() as u32;
            part.vertices.extend(corners);
            part.triangles.push([first, first + 1, first + 2]);
            taken.push(uvs);
        }
        (parts.into_iter().map(|(_, part)| part).collect(), inside)
    }

    /// Two of it back to back, each moved outwards along its normals.
    fn sheets(self) -> [Self; 2] {
        let moved = |side: f32| {
            let turn =
                |v: &Vertex| Vertex { position: v.position + v.normal * (side * HALF_GAP_M), normal: v.normal * side, ..*v };
            let order = |t: &[u32; 3]| if side < 0.0 { [t[0], t[2], t[1]] } else { *t };
            Self {
                vertices: self.vertices.iter().map(turn).collect(),
                triangles: self.triangles.iter().map(order).collect(),
                colored: self.colored,
            }
        };
        [moved(1.0), moved(-1.0)]
    }

    /// Encodes the mesh as little-endian binary PLY: `x y z nx ny nz u v`, `red green blue` (linear) where it has colours,
    /// `list uchar int vertex_indices`.
    fn encode(&self) -> Vec<u8> {
        let mut names = vec!["x", "y", "z", "nx", "ny", "nz", "u", "v"];
        if self.colored {
            names.extend(["red", "green", "blue"]);
        }
        let properties: String = names.iter().map(|name| format!("property float {name}\n")).collect();
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{properties}element face {}\nproperty list uchar int \
             vertex_indices\nend_header\n",
            self.vertices.len(),
            self.triangles.len()
        )
        .into_bytes();
        for v in &self.vertices {
            let color = self.colored.then_some(v.color);
            let values = v.position.to_array().into_iter().chain(v.normal.to_array()).chain(v.uv.to_array());
            for value in values.chain(color.into_iter().flatten()) {
                bytes.extend(value.to_le_bytes());
            }
        }
        for triangle in &self.triangles {
            bytes.push(3);
            triangle.iter().for_each(|index| bytes.extend(index.to_le_bytes()));
        }
        bytes
    }
}

/// Whether two triangles have more than edges in common: no edge of either separates them (separating axes).
fn overlap(a: &[Vec2; 3], b: &[Vec2; 3]) -> bool {
    const TOUCHING: f32 = 1e-5;
    let separated = |first: &[Vec2; 3], second: &[Vec2; 3]| {
        (0..3).any(|k| {
            let edge = first[(k + 1) % 3] - first[k];
            let across = edge.perp().normalize_or_zero();
            let of = |t: &[Vec2; 3]| {
                t.map(|p| across.dot(p - first[k])).into_iter().fold((f32::MAX, f32::MIN), |m, d| (m.0.min(d), m.1.max(d)))
            };
            let ((low_a, high_a), (low_b, high_b)) = (of(first), of(second));
            low_b >= high_a - TOUCHING || low_a >= high_b - TOUCHING
        })
    };
    !separated(a, b) && !separated(b, a)
}
