//! Sheets of one plane are one sheet: an edge of a piece beyond which another goes on is none, and the border of all of them together is.

use super::super::geometry::{Geometry, TOUCHING_M};
use super::mesh_edges::{MeshEdge, Sheet};
use glam::DVec3;

/// Room for float32's rounding of the box in which triangles are looked for, over the largest coordinate.
const BOX_ROUNDING: f64 = 1e-6;

/// The parts of an edge, distances from its first end in metres, ascending, beyond which none of its sheets goes on: in the sheet's plane, by
/// triangles of whatever object and material, joined to it or laid over it. What is shorter than surfaces touch is rounding.
///
/// Where a sheet goes on, both halves of its plane are taken at the edge, and no open sector around it is larger than a half space.
pub fn open_parts(geometry: &Geometry<'_>, edge: &MeshEdge) -> Vec<[f64; 2]> {
    let [a, b] = edge.ends;
    let length_m = edge.length_m();
    let along = (b - a) / length_m;
    let mut covered = Vec::new();
    let room = 2.0 * TOUCHING_M + BOX_ROUNDING * a.abs().max(b.abs()).max_element();
    geometry.visit_triangles_in_box(a.min(b) - room, a.max(b) + room, |triangle| {
        let face = &geometry.faces[geometry.face_of_triangle(triangle as u32) as usize];
        for sheet in edge.sheets.iter().filter(|sheet| face.is_parallel(&geometry.faces[sheet.face as usize])) {
            covered.extend(covered_beyond(geometry.corners(triangle as u32), a, along, sheet));
        }
    });
    uncovered(covered, length_m)
}

/// The part of an edge's line, from `origin` `along` it, beyond which a triangle lies in the sheet's plane: between the two sides by which it
/// comes to the edge, or as near to it as surfaces touch.
fn covered_beyond(corners: &[DVec3; 3], origin: DVec3, along: DVec3, sheet: &Sheet) -> Option<[f64; 2]> {
    let normal = along.cross(sheet.into);
    // Along the edge, beyond it, and out of the plane.
    let laid = corners.map(|p| {
        let p = p - origin;
        DVec3::new(p.dot(along), -p.dot(sheet.into), p.dot(normal))
    });
    // The two sides that lead from where surfaces touch to further off: where they cross over, and where they come to the edge or end before.
    let mut sides: Vec<(f64, DVec3)> = Vec::with_capacity(2);
    for i in 0..3 {
        let (p, q) = (laid[i], laid[(i + 1) % 3]);
        if (p.y > TOUCHING_M) != (q.y > TOUCHING_M) {
            let at = |beyond_m: f64| p + (q - p) * ((p.y - beyond_m) / (p.y - q.y)).clamp(0.0, 1.0);
            sides.push((at(TOUCHING_M).x, at(0.0)));
        }
    }
    sides.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [(_, from), (_, to)] = sides[..] else { return None };
    // Sides that meet before the edge are those of a corner that points at it.
    within_touch(from, to).filter(|[low, high]| low < high)
}

/// The part of a straight line between two places, by its distance along the edge, that is no further out of the plane than surfaces touch.
fn within_touch(from: DVec3, to: DVec3) -> Option<[f64; 2]> {
    let (mut low, mut high) = (0.0f64, 1.0f64);
    for sign in [-1.0, 1.0] {
        let [a, b] = [from, to].map(|p| p.z * sign - TOUCHING_M);
        match (a > 0.0, b > 0.0) {
            (true, true) => return None,
            (true, false) => low = low.max(a / (a - b)),
            (false, true) => high = high.min(a / (a - b)),
            (false, false) => {}
        }
    }
    Some([low, high].map(|share| from.x + (to.x - from.x) * share))
}

/// What is left of an edge, without parts that are no longer than surfaces touch.
fn uncovered(mut covered: Vec<[f64; 2]>, length_m: f64) -> Vec<[f64; 2]> {
    covered.sort_by(|x, y| x[0].total_cmp(&y[0]).then(x[1].total_cmp(&y[1])));
    let mut joined: Vec<[f64; 2]> = Vec::new();
    for [from, to] in covered {
        match joined.last_mut() {
            Some(last) if from <= last[1] + TOUCHING_M => last[1] = last[1].max(to),
            _ => joined.push([from, to]),
        }
    }
    let (mut open, mut at) = (Vec::new(), 0.0);
    for [from, to] in
        joined.into_iter().map(|[from, to]| [from.max(0.0), to.min(length_m)]).filter(|[from, to]| to - from > TOUCHING_M)
    {
        if from - at > TOUCHING_M {
            open.push([at, from]);
        }
        at = to;
    }
    if length_m - at > TOUCHING_M || at == 0.0 {
        open.push([at, length_m]);
    }
    open
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_covered_is_taken_out_of_an_edge() {
        let tiny = 0.5 * TOUCHING_M;
        for (covered, open) in [
            (vec![], vec![[0.0, 3.0]]),
            (vec![[-1.0, 4.0]], vec![]),
            (vec![[tiny, 3.0 - tiny]], vec![]),
            (vec![[2.0, 9.0], [-1.0, 1.0]], vec![[1.0, 2.0]]),
            // Triangles beside each other leave no gap, and slivers cover nothing.
            (vec![[1.0, 1.5], [1.5 + tiny, 2.0], [2.5, 2.5 + tiny]], vec![[0.0, 1.0], [2.0, 3.0]]),
            (vec![[-5.0, tiny], [4.0, 5.0]], vec![[0.0, 3.0]]),
        ] {
            assert_eq!(uncovered(covered.clone(), 3.0), open, "{covered:?}");
        }
    }

    /// The edge from (0, 0, 0) to (3, 0, 0) of a sheet on the side of y < 0.
    #[test]
    fn a_triangle_covers_what_it_lies_beyond() {
        let sheet = Sheet { face: 0, triangle: 0, into: -DVec3::Y };
        let beyond = |corners: [[f64; 3]; 3]| covered_beyond(&corners.map(DVec3::from), DVec3::ZERO, DVec3::X, &sheet);
        let near = |found: Option<[f64; 2]>, expected: [f64; 2]| {
            assert!(
                found.is_some_and(|f| (f[0] - expected[0]).abs().max((f[1] - expected[1]).abs()) < 1e-9),
                "{found:?} {expected:?}"
            );
        };
        // On a side, across the edge, from a gap, tilted out of the plane: as far as its planes touch.
        near(beyond([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0]]), [1.0, 2.0]);
        near(beyond([[0.0, -1.0, 0.0], [2.0, -1.0, 0.0], [1.0, 1.0, 0.0]]), [0.5, 1.5]);
        near(beyond([[1.0, 1e-5, 1e-5], [2.0, 1e-5, 1e-5], [1.5, 1.0, 1e-5]]), [1.0, 2.0]);
        near(beyond([[1.0, 0.0, 0.0], [3.0, 0.0, 2.0 * TOUCHING_M], [2.0, 1.0, 0.0]]), [1.0, 2.0]);
        // Before the edge, a corner that touches it or comes from beyond, farther off than surfaces touch.
        for corners in [
            [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, -1.0, 0.0]],
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 1.0, 0.0]],
            [[1.0, 1e-5, 0.0], [0.0, 1.0, 0.0], [2.0, 1.0, 0.0]],
            [[1.0, 3e-5, 0.0], [2.0, 3e-5, 0.0], [2.0, 1.0, 0.0]],
            [[1.0, 0.0, 3e-5], [2.0, 0.0, 3e-5], [2.0, 1.0, 3e-5]],
        ] {
            assert_eq!(beyond(corners), None, "{corners:?}");
        }
    }
}
