//! From one primitive's arrays to the scene's flat list of triangles.

use super::ImportReport;
use crate::model::{Scene, Triangle};
use crate::words::counted;
use crate::{Error, Result, far};
use glam::{DMat3, DMat4, DVec3, Vec3};

/// A triangle whose double area is below this share of its longest edge squared is a line as far as float32 can tell.
const DEGENERATE: f64 = 1e-7;

/// Indexed triangles in the file's frame.
pub(super) struct Primitive {
    pub positions: Vec<[f32; 3]>,
    /// One a position, or empty.
    pub normals: Vec<[f32; 3]>,
    /// One a position, or empty.
    pub uvs: Vec<[f32; 2]>,
    /// Linear RGBA, one a position, or empty.
    pub colors: Vec<[f32; 4]>,
    pub triangles: Vec<[u32; 3]>,
    pub material: u32,
    pub object: u32,
}

/// Appends a primitive, mapped into the world by `world_from_primitive` (any affine map; a mirror turns the winding back).
pub(super) fn append(
    scene: &mut Scene,
    report: &mut ImportReport,
    p: &Primitive,
    world_from_primitive: &DMat4,
    place: &str,
) -> Result<()> {
    check(p, place)?;
    check_size(scene.triangles.len(), p.triangles.len(), 1, place)?;
    let linear = DMat3::from_mat4(*world_from_primitive);
    let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
    let normal_map = normal_map(&linear);
    let world: Vec<Vec3> =
        p.positions.iter().map(|v| world_from_primitive.transform_point3(Vec3::from_array(*v).as_dvec3()).as_vec3()).collect();
    if let Some(i) = world.iter().position(|v| !v.is_finite()) {
        return Err(Error::invalid(
            place,
            format!("vertex {i} leaves float32 under its node's transform"),
            "scale the model to metres",
        ));
    }
    note_coarse(report, p, &linear, &world, place);
    // The scene has colours for all of its vertices or for none: white is what those without have.
    if !p.colors.is_empty() && scene.colors.is_empty() {
        scene.colors = vec![[1.0; 4]; scene.positions.len()];
    }
    let colored = !scene.colors.is_empty() || !p.colors.is_empty();
    let unit = |v: DVec3| v.try_normalize().map(|n| n.as_vec3());
    let normals: Vec<Option<Vec3>> = if p.normals.is_empty() {
        vec![None; world.len()]
    } else {
        p.normals.iter().map(|n| unit(normal_map * Vec3::from_array(*n).as_dvec3())).collect()
    };
    // Where every vertex has a normal, vertices stay shared; a vertex without one is split per triangle and shaded flat.
    let mut index_of: Vec<Option<u32>> = vec![None; world.len()];
    for triangle in &p.triangles {
        let [a, b, c] = if sign < 0.0 { [triangle[0], triangle[2], triangle[1]] } else { *triangle };
        let corners = [a, b, c].map(|v| world[v as usize].as_dvec3());
        let (e1, e2, e3) = (corners[1] - corners[0], corners[2] - corners[0], corners[2] - corners[1]);
        let cross = e1.cross(e2);
        let longest2 = e1.length_squared().max(e2.length_squared()).max(e3.length_squared());
        let Some(face) = (cross.length() > DEGENERATE * longest2).then(|| unit(cross)).flatten() else {
            report.degenerate_triangles += 1;
            continue;
        };
        let mut vertices = [0; 3];
        for (slot, v) in vertices.iter_mut().zip([a, b, c]) {
            let v = v as usize;
            *slot = match index_of[v] {
                Some(index) => index,
                None => {
                    let index = u32::try_from(scene.positions.len())
                        .map_err(|_| Error::invalid(place, "the scene has more than 2^32 vertices", "simplify the model"))?;
                    scene.positions.push(world[v]);
                    scene.normals.push(normals[v].unwrap_or(face));
                    scene.uvs.push(p.uvs.get(v).copied().unwrap_or([0.0; 2]));
                    if colored {
                        scene.colors.push(p.colors.get(v).copied().unwrap_or([1.0; 4]));
                    }
                    if normals[v].is_some() {
                        index_of[v] = Some(index);
                    } else {
                        report.computed_normals += 1;
                    }
                    index
                }
            };
        }
        scene.triangles.push(Triangle { vertices, material: p.material, object: p.object });
    }
    Ok(())
}

/// How normals map where points map by `linear`, up to length: by the inverse transpose. The cofactor matrix has no division and keeps a
/// mirror's sign, which is taken out.
pub(super) fn normal_map(linear: &DMat3) -> DMat3 {
    let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(linear.y_axis.cross(linear.z_axis), linear.z_axis.cross(linear.x_axis), linear.x_axis.cross(linear.y_axis))
        * sign
}

/// Notes once that vertices came near the origin whose numbers in the file are far from it: there they are as coarse as single precision is, and no offset
/// brings back what the file does not hold.
fn note_coarse(report: &mut ImportReport, p: &Primitive, linear: &DMat3, world: &[Vec3], place: &str) {
    const WORDS: &str = "no offset brings back";
    let own_m = far::largest_m(p.positions.iter().map(|v| *linear * Vec3::from_array(*v).as_dvec3()));
    let world_m = far::largest_m(world.iter().map(|v| v.as_dvec3()));
    if own_m >= far::FAR_M && world_m < far::FAR_M && !report.notes.iter().any(|note| note.contains(WORDS)) {
        let step_mm = far::step_mm(own_m);
        report.notes.push(format!(
            "{place}: its vertices are single-precision numbers of up to {own_m:.0} m, in steps of {step_mm:.1} mm, which {WORDS}: move the model to the \
             origin in the program that exports it"
        ));
    }
}

/// Most triangles of a scene: with their vertices, hierarchy and tables more fit no ordinary memory.
const MAX_TRIANGLES: usize = 50_000_000;

/// Checks that `times` copies of `more` triangles fit beside those there are, before memory is taken for them.
pub(super) fn check_size(there: usize, more: usize, times: usize, place: &str) -> Result<()> {
    let all = more.checked_mul(times).and_then(|n| n.checked_add(there));
    if all.is_some_and(|n| n <= MAX_TRIANGLES) {
        return Ok(());
    }
    let what = match times {
        1 => format!("its {more} triangles make {} in all", there.saturating_add(more)),
        _ => format!("{times} instances of {more} triangles beside {there} others"),
    };
    Err(Error::invalid(
        place,
        format!("{what}; a scene may have {MAX_TRIANGLES}"),
        "simplify the model, or leave a part of it out",
    ))
}

/// Array lengths, finite numbers, indices in range.
fn check(p: &Primitive, place: &str) -> Result<()> {
    let n = p.positions.len();
    for (what, count) in [("NORMAL", p.normals.len()), ("TEXCOORD", p.uvs.len()), ("COLOR", p.colors.len())] {
        if count != 0 && count != n {
            return Err(Error::invalid(
                place,
                format!("{what} has {} for {}", counted(count, "value"), counted(n, "position")),
                "every attribute needs one value a vertex; export the model again",
            ));
        }
    }
    let finite = |name: &str, bad: Option<usize>| match bad {
        None => Ok(()),
        Some(i) => {
            Err(Error::invalid(place, format!("{name} {i} is not finite"), "repair the model: every coordinate is a number"))
        }
    };
    finite("position", p.positions.iter().position(|v| v.iter().any(|x| !x.is_finite())))?;
    finite("normal", p.normals.iter().position(|v| v.iter().any(|x| !x.is_finite())))?;
    finite("texture coordinate", p.uvs.iter().position(|v| v.iter().any(|x| !x.is_finite())))?;
    finite("colour", p.colors.iter().position(|v| v.iter().any(|x| !x.is_finite())))?;
    if let Some((i, t)) = p.triangles.iter().enumerate().find(|(_, t)| t.iter().any(|v| *v as usize >= n)) {
        return Err(Error::invalid(
            place,
            format!("triangle {i} uses vertices {t:?} of {n}"),
            "indices count from 0 and stay below the number of vertices; export the model again",
        ));
    }
    Ok(())
}
