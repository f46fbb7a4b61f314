//! Skinned meshes in the pose in which their joints stand (glTF 2.0 §3.7.3.3): joints alone move them, not their own node.

use super::super::builder::{self, Primitive};
use super::super::notes::Notes;
use super::document::Source;
use super::{accessor, node};
use crate::{Error, Result};
use glam::{DMat3, DMat4, DVec3};
use gltf::Semantic;
use std::collections::HashMap;
use std::rc::Rc;

/// A sum of weights this far from 1 was not rounded but is wrong, and a note says so: four of 8 bits round to within 2/255.
const WRONG_SUM: f64 = 0.01;
/// Largest deviation of an inverse bind matrix's last row from 0 0 0 1 that is rounding.
const AFFINE: f64 = 1e-3;

/// `world_from_bind` of the joints of every skin that has been asked for.
pub(super) struct Skins<'a> {
    source: &'a Source<'a>,
    world_from_file: DMat4,
    /// Whether a point far away becomes the origin, so that translations are wanted to their last digit.
    offset: bool,
    /// Per node, its parent.
    parents: Rc<[Option<usize>]>,
    /// Per node, whether it stands in the scene on its own.
    is_root: Vec<bool>,
    /// Per node, once known: its transform, and whether it is in the scene.
    world_from_node: Vec<Option<(DMat4, bool)>>,
    by_skin: HashMap<usize, Rc<[DMat4]>>,
}

impl<'a> Skins<'a> {
    /// Of a file whose scene has these roots.
    pub(super) fn new(
        source: &'a Source<'a>,
        world_from_file: DMat4,
        offset: bool,
        parents: Rc<[Option<usize>]>,
        roots: &[gltf::Node<'_>],
    ) -> Self {
        let mut is_root = vec![false; parents.len()];
        roots.iter().for_each(|root| is_root[root.index()] = true);
        let world_from_node = vec![None; parents.len()];
        Self { source, world_from_file, offset, parents, is_root, world_from_node, by_skin: HashMap::new() }
    }

    /// `world_from_bind` of every joint: where it stands, after its inverse bind matrix.
    ///
    /// # Errors
    /// Matrices that are too few, not finite or not affine; joints in a circle.
    pub(super) fn joints(&mut self, skin: &gltf::Skin<'_>, place: &str, notes: &mut Notes) -> Result<Rc<[DMat4]>> {
        if let Some(known) = self.by_skin.get(&skin.index()) {
            return Ok(Rc::clone(known));
        }
        let short = format!("skins[{}]{}", skin.index(), skin.name().map(|n| format!(" \"{n}\"")).unwrap_or_default());
        let place = format!("{place}: {short}");
        let joints: Vec<gltf::Node<'_>> = skin.joints().collect();
        let joint_from_bind = match skin.inverse_bind_matrices() {
            None => vec![DMat4::IDENTITY; joints.len()],
            Some(accessor) => self.inverse_bind_matrices(&accessor, joints.len(), &place)?,
        };
        let mut world_from_bind = Vec::with_capacity(joints.len());
        for (joint, joint_from_bind) in joints.iter().zip(joint_from_bind) {
            let (world_from_joint, in_scene) = self.world_from_node(joint.index())?;
            if !in_scene {
                notes.warn("joints of it are in no scene that is read; they are taken where their nodes put them", &short);
            }
            world_from_bind.push(world_from_joint * joint_from_bind);
        }
        let world_from_bind: Rc<[DMat4]> = world_from_bind.into();
        self.by_skin.insert(skin.index(), Rc::clone(&world_from_bind));
        Ok(world_from_bind)
    }

    fn inverse_bind_matrices(&self, accessor: &gltf::Accessor<'_>, joints: usize, place: &str) -> Result<Vec<DMat4>> {
        let matrices = accessor::floats::<16>(accessor, self.source, place)?;
        if matrices.len() < joints {
            return Err(Error::invalid(
                place,
                format!("has {} inverse bind matrices for {joints} joints", matrices.len()),
                "every joint needs one; export the model again",
            ));
        }
        let matrix = |(i, numbers): (usize, &[f32; 16])| {
            let mut matrix = DMat4::from_cols_array(&numbers.map(f64::from));
            let last = matrix.row(3) - glam::DVec4::W;
            if !matrix.is_finite() || last.abs().max_element() > AFFINE {
                return Err(Error::invalid(
                    place,
                    format!("inverse bind matrix {i} is not affine: {numbers:?}"),
                    "its last row (4th, 8th, 12th, 16th number) is 0 0 0 1; export the model again",
                ));
            }
            (matrix.x_axis.w, matrix.y_axis.w, matrix.z_axis.w, matrix.w_axis.w) = (0.0, 0.0, 0.0, 1.0);
            Ok(matrix)
        };
        matrices.iter().take(joints).enumerate().map(matrix).collect()
    }

    /// A node's transform, and whether it is in the scene.
    fn world_from_node(&mut self, index: usize) -> Result<(DMat4, bool)> {
        // Up to the first whose transform is known, and down again.
        let (mut way, mut at) = (vec![index], index);
        while self.world_from_node[at].is_none()
            && !self.is_root[at]
            && let Some(parent) = self.parents[at]
        {
            if way.len() > self.parents.len() {
                let what = format!("nodes[{index}] is its own ancestor");
                return Err(Error::invalid(&self.source.name, what, "a node tree is a tree; export the model again"));
            }
            way.push(parent);
            at = parent;
        }
        let mut world = (self.world_from_file, self.is_root[at]);
        for (i, node) in way.into_iter().rev().map(|i| (i, self.source.document.nodes().nth(i))) {
            if let Some(known) = self.world_from_node[i] {
                world = known;
                continue;
            }
            let Some(node) = node else { continue };
            let place = format!("{}: {}", self.source.name, node::describe(&node));
            // What is to be said of a node's transform is said where the scene comes by it.
            let mut parent_from_node = node::parent_from_node(&node, &place, &mut Notes::default())?;
            if self.offset {
                node::translate_in_doubles(&mut parent_from_node, &self.source.raw["nodes"][node.index()]);
            }
            world.0 *= parent_from_node;
            if !world.0.is_finite() {
                return Err(Error::invalid(place, "its transform is not finite", "repair the node's matrix"));
            }
            self.world_from_node[i] = Some(world);
        }
        Ok(world)
    }
}

/// Takes a primitive from its bind pose into the world: every vertex by the mean of its joints' `world_from_bind`, by its weights.
///
/// # Errors
/// Joints or weights that are missing, of another number than the vertices, or lead nowhere; vertices of triangles without any weight.
pub(super) fn pose(
    data: &mut Primitive,
    primitive: &gltf::Primitive<'_>,
    world_from_bind: &[DMat4],
    source: &Source<'_>,
    notes: &mut Notes,
    place: &str,
) -> Result<()> {
    let count = data.positions.len();
    let mut blends = vec![(DMat4::ZERO, 0.0); count];
    let sets = sets(primitive, place)?;
    for set in 0..sets {
        let (Some(joints), Some(weights)) = (primitive.get(&Semantic::Joints(set)), primitive.get(&Semantic::Weights(set)))
        else {
            let what = format!("has a skin, and not both of JOINTS_{set} and WEIGHTS_{set}");
            return Err(Error::invalid(place, what, "export the model again, or without its skin"));
        };
        let joints = accessor::joints(&joints, source, place)?;
        let weights = accessor::weights(&weights, source, place)?;
        for (name, there) in [("JOINTS", joints.len()), ("WEIGHTS", weights.len())] {
            if there != count {
                let what = format!("{name}_{set} has {there} values for {count} positions");
                return Err(Error::invalid(place, what, "every attribute needs one value a vertex; export the model again"));
            }
        }
        for (vertex, (blend, (joints, weights))) in blends.iter_mut().zip(joints.iter().zip(&weights)).enumerate() {
            for (&joint, &weight) in joints.iter().zip(weights) {
                if !(weight.is_finite() && weight >= 0.0) {
                    let what = format!("WEIGHTS_{set} of vertex {vertex} has {weight}");
                    return Err(Error::invalid(place, what, "weights are from 0 to 1; export the model again"));
                }
                if weight == 0.0 {
                    continue;
                }
                let Some(world_from_bind) = world_from_bind.get(joint as usize) else {
                    let what = format!("vertex {vertex} asks for joint {joint} of {}", world_from_bind.len());
                    return Err(Error::invalid(place, what, "joints count from 0 within the skin; export the model again"));
                };
                blend.0 += *world_from_bind * f64::from(weight);
                blend.1 += f64::from(weight);
            }
        }
    }
    if let Some(vertex) = data.triangles.iter().flatten().find(|v| blends.get(**v as usize).is_some_and(|b| b.1 == 0.0)) {
        let what = format!("vertex {vertex} hangs on no joint: its weights are all 0");
        return Err(Error::invalid(place, what, "give every vertex of a skinned mesh a joint; export the model again"));
    }
    if blends.iter().any(|(_, sum)| *sum > 0.0 && (sum - 1.0).abs() > WRONG_SUM) {
        let short = place.rsplit_once(": ").map_or(place, |(_, end)| end);
        notes.warn("weights of joints do not add up to 1; they were scaled so that they do", short);
    }
    let mut mirrors = vec![false; count];
    for (i, (blend, sum)) in blends.into_iter().enumerate().filter(|(_, (_, sum))| *sum > 0.0) {
        let world_from_vertex = blend * sum.recip();
        let linear = DMat3::from_mat4(world_from_vertex);
        mirrors[i] = linear.determinant() < 0.0;
        let of = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        data.positions[i] = world_from_vertex.transform_point3(of(data.positions[i])).as_vec3().to_array();
        if let Some(normal) = data.normals.get_mut(i) {
            *normal = (builder::normal_map(&linear) * of(*normal)).normalize_or_zero().as_vec3().to_array();
        }
    }
    // A mirror turns the winding back, as it does under a node's transform.
    for triangle in &mut data.triangles {
        if triangle.iter().filter(|v| mirrors.get(**v as usize) == Some(&true)).count() >= 2 {
            triangle.swap(1, 2);
        }
    }
    Ok(())
}

/// Number of sets of joints and weights; they are numbered from 0.
fn sets(primitive: &gltf::Primitive<'_>, place: &str) -> Result<u32> {
    let mut all: Vec<u32> = Vec::new();
    for (semantic, _) in primitive.attributes() {
        if let Semantic::Joints(set) | Semantic::Weights(set) = semantic {
            all.push(set);
        }
    }
    all.sort_unstable();
    all.dedup();
    if all.is_empty() {
        let what = "its node has a skin, and it has neither JOINTS_0 nor WEIGHTS_0";
        return Err(Error::invalid(place, what, "export the model again, or without its skin"));
    }
    if all.iter().zip(0..).any(|(set, number)| *set != number) {
        let what = format!("its sets of joints and weights are numbered {all:?}");
        return Err(Error::invalid(place, what, "sets count from 0; export the model again"));
    }
    Ok(all.len() as u32)
}
