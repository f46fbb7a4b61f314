//! Polygons of more than three corners, cut into triangles.

use crate::{Error, Result};
use glam::{DVec2, DVec3};

/// Areas this close, relative: rounding of single precision.
const SAME_AREA: f64 = 1e-4;

/// The triangles of faces of any number of corners: `arities` says how many each has; points and lines are left out. Convex faces become fans
/// around their first corner, others are cut by their ears. `place` says where a face of a number stands.
pub(super) fn triangles(
    corners: &[u32],
    arities: &[u32],
    positions: &[[f32; 3]],
    place: impl Fn(usize) -> String,
) -> Result<Vec<[u32; 3]>> {
    let (mut rest, mut all) = (corners, Vec::with_capacity(arities.len()));
    for (number, arity) in arities.iter().enumerate() {
        let (face, behind) = rest.split_at(*arity as usize);
        rest = behind;
        match face {
            [] | [_] | [_, _] => {}
            [a, b, c] => all.push([*a, *b, *c]),
            face => {
                let cut = polygon(&face.iter().map(|i| position(positions, *i)).collect::<Vec<_>>()).ok_or_else(|| {
                    let at = position(positions, face[0]);
                    let what = format!("a face of {} corners from {at} on crosses itself", face.len());
                    Error::invalid(place(number), what, "cut its faces into triangles when exporting")
                })?;
                all.extend(cut.into_iter().map(|t| t.map(|i| face[i as usize])));
            }
        }
    }
    Ok(all)
}

fn position(positions: &[[f32; 3]], i: u32) -> DVec3 {
    positions.get(i as usize).map_or(DVec3::NAN, |p| DVec3::from(p.map(f64::from)))
}

/// The triangles of one polygon, as it turns; `None` where they do not cover what it encloses.
fn polygon(corners: &[DVec3]) -> Option<Vec<[u32; 3]>> {
    let count = corners.len() as u32;
    let fan = || (1..count - 1).map(|i| [0, i, i + 1]).collect();
    // Twice the area, along the normal: right for corners that are nearly in one plane (Newell).
    let area: DVec3 =
        (0..corners.len()).map(|i| (corners[i] - corners[0]).cross(corners[(i + 1) % corners.len()] - corners[0])).sum();
    // Halves that turn against each other take each other away; corners on one line have no area to begin with.
    let halves = || (1..corners.len() - 1).map(|i| (corners[i] - corners[0]).cross(corners[i + 1] - corners[0]).length());
    let longest2 = corners.iter().map(|c| c.distance_squared(corners[0])).fold(0.0, f64::max);
    if area.length() <= 1e-6 * halves().sum::<f64>() && halves().any(|h| h > 1e-6 * longest2) {
        return None;
    }
    let Some(normal) = area.try_normalize() else { return Some(fan()) };
    let (u, v) = normal.any_orthonormal_pair();
    let flat: Vec<DVec2> = corners.iter().map(|p| DVec2::new((*p - corners[0]).dot(u), (*p - corners[0]).dot(v))).collect();
    let doubled = |[a, b, c]: [u32; 3]| {
        let [a, b, c] = [a, b, c].map(|i| flat[i as usize]);
        (b - a).perp_dot(c - a)
    };
    let slack = -1e-6 * area.length();
    if (0..count).all(|i| doubled([i, (i + 1) % count, (i + 2) % count]) >= slack)
        && (1..count - 1).all(|i| doubled([0, i, i + 1]) >= slack)
    {
        return Some(fan());
    }
    let mut indices: Vec<u32> = Vec::new();
    earcut::Earcut::new().earcut(flat.iter().map(|p| p.to_array()), &[], &mut indices);
    let turned = |t: [u32; 3]| if doubled(t) < 0.0 { [t[0], t[2], t[1]] } else { t };
    let cut: Vec<[u32; 3]> = indices.as_chunks().0.iter().copied().map(turned).collect();
    let covered: f64 = cut.iter().map(|t| doubled(*t)).sum();
    ((covered / area.length() - 1.0).abs() < SAME_AREA).then_some(cut)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(corners: &[[f32; 3]]) -> Result<Vec<[u32; 3]>> {
        let face: Vec<u32> = (0..corners.len() as u32).collect();
        triangles(&face, &[corners.len() as u32], corners, |n| format!("test:{n}"))
    }

    fn doubled(corners: &[[f32; 3]], t: [u32; 3]) -> DVec3 {
        let [a, b, c] = t.map(|i| position(corners, i));
        (b - a).cross(c - a)
    }

    #[test]
    fn a_wall_keeps_its_doorway_wherever_its_outline_begins() {
        let outline = [
            [0.0, -3.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, -1.0, 2.0],
            [0.0, 1.0, 2.0],
            [0.0, 1.0, 0.0],
            [0.0, 3.0, 0.0],
            [0.0, 3.0, 3.0],
            [0.0, -3.0, 3.0],
        ];
        for first in 0..8 {
            for reversed in [false, true] {
                let mut wall = outline;
                wall.rotate_left(first);
                if reversed {
                    wall.reverse();
                }
                let found = cut(&wall).unwrap();
                let area: DVec3 = found.iter().map(|t| 0.5 * doubled(&wall, *t)).sum();
                let whole: f64 = found.iter().map(|t| 0.5 * doubled(&wall, *t).length()).sum();
                // They turn as the outline does, and lie side by side.
                let side = if reversed { -14.0 } else { 14.0 };
                assert!((area.x - side).abs() < 1e-6 && (whole - 14.0).abs() < 1e-6, "{first}: {area} {whole}");
            }
        }
    }

    #[test]
    fn convex_faces_are_fans_and_faces_that_cross_themselves_are_refused() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(cut(&square).unwrap(), [[0, 1, 2], [0, 2, 3]]);
        let star: Vec<[f32; 3]> =
            (0..5).map(|i| (i as f32 * 0.8 * std::f32::consts::PI).sin_cos()).map(|(y, x)| [x, y, 0.0]).collect();
        assert!(cut(&star).unwrap_err().to_string().contains("crosses itself"));
        let bow_tie = [[0.0, 0.0, 0.0], [2.0, 3.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        assert!(cut(&bow_tie).unwrap_err().to_string().contains("crosses itself"));
        let line: Vec<[f32; 3]> = [0.0, 1.0, 3.0, 2.0].map(|x| [x, 2.0 * x, 0.0]).to_vec();
        assert_eq!(cut(&line).unwrap().len(), 2);
        // Two triangles, a line and a quadrilateral.
        let corners = [0, 1, 2, 0, 2, 0, 1, 2, 3];
        assert_eq!(triangles(&corners, &[3, 2, 4], &square, |_| "test".into()).unwrap(), [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
    }
}
