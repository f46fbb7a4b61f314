//! Sheets that lie on one another: how much of them, and how many slabs a radio wave passes there.
//!
//! Triangles of one object, material and plane are one face, and one slab, however often it is covered. Faces of different objects or materials
//! are a slab each. Both hold whichever diagonals the triangles are cut along.
//!
//! Two closed bodies that touch (a shelf and its side, a rib and its radiator) share a place and no sheet: there their faces look into one another,
//! where no light comes, and each is the slab of its own body. They are no overlap.

use super::parts::parts;
use crate::Scene;
use glam::{DVec2, DVec3, I64Vec3};
use std::collections::{BTreeMap, HashMap};

/// Tolerance in position for triangles of one plane: their corners are at most this far from it, metres.
const SAME_PLANE_M: f64 = 5e-6;
/// Tolerance in direction for triangles of one plane, as 1 − cos of the angle between their normals (1e-3 rad). The radio tracer joins
/// triangles to faces by the same tolerances.
const SAME_NORMAL: f64 = 5e-7;
/// Cell size of the hash grid over the components of unit normals; a normal near a cell's border is entered in both cells.
const NORMAL_CELL: f64 = 4e-3;
/// Cell size of the hash grid over the planes' offsets from the origin, metres.
const OFFSET_CELL_M: f64 = 1e-2;
/// Less of a face than this share is rounding.
const SHARE: f64 = 1e-3;
/// Two faces are copies of one another where they share all but this of the larger one.
const COPY_SHARE: f64 = 0.01;

/// Faces that lie on one another.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// Indices into the scene's objects, ascending; the same for a face that is covered twice.
    pub objects: [u32; 2],
    /// Area that is covered twice, m².
    pub area_m2: f64,
    /// Whether both are of one object and one material, which a radio wave passes as one slab; otherwise each is one.
    pub one_slab: bool,
}

/// One triangle in its plane.
struct Flat {
    normal: DVec3,
    offset_m: f64,
    corners: [DVec3; 3],
    area_m2: f64,
    object: u32,
    material: u32,
    /// Whether its own normal is the reverse of `normal`.
    turned: bool,
    /// Whether it is of a body's surface.
    of_body: bool,
}

impl Flat {
    /// Whether the two are where one body touches another, or itself.
    fn touches(&self, other: &Self) -> bool {
        self.of_body && other.of_body && self.turned != other.turned
    }
}

/// Faces that are covered twice by their own triangles, and faces of different objects or materials that are copies of one another (a crate
/// that stands on a floor is none, nor are bodies that touch), by objects. Indices of the scene must be in range.
pub fn overlaps(scene: &Scene) -> Vec<Overlap> {
    let mut of_body = vec![false; scene.triangles.len()];
    for part in parts(scene) {
        part.of_bodies(scene).iter().for_each(|t| of_body[*t as usize] = true);
    }
    let flats: Vec<Flat> = (0..scene.triangles.len()).filter_map(|i| flat(scene, i, of_body[i])).collect();
    let mut cells: HashMap<(I64Vec3, i64), Vec<u32>> = HashMap::new();
    for (i, flat) in flats.iter().enumerate() {
        for cell in cells_of(flat) {
            cells.entry(cell).or_default().push(i as u32);
        }
    }
    // By pair of faces, a face being an object, a material and the cell of its plane: the area of both that is shared.
    let mut shared: BTreeMap<[Face; 2], f64> = BTreeMap::new();
    for (cell, members) in &mut cells {
        let along = |i: &u32| flats[*i as usize].corners.map(|p| p.dot(sweep_axis(cell.0)));
        let reach = |i: &u32| along(i).into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        members.sort_by(|a, b| reach(a).0.total_cmp(&reach(b).0).then(a.cmp(b)));
        let mut open: Vec<(f64, u32)> = Vec::new();
        for &i in members.iter() {
            let (from, to) = reach(&i);
            open.retain(|(end, _)| *end > from);
            for &(_, j) in &open {
                let (a, b) = (&flats[i as usize], &flats[j as usize]);
                // Of the cells that hold both the first counts them.
                let first =
                    cells_of(a).into_iter().filter(|cell| cells_of(b).contains(cell)).min_by_key(|c| (c.0.to_array(), c.1));
                if first == Some(*cell) && !a.touches(b) && in_one_plane(a, b) {
                    let area_m2 = common_area_m2(a, b);
                    if area_m2 > SHARE * a.area_m2.min(b.area_m2) {
                        let mut pair = [face(a), face(b)];
                        pair.sort_unstable();
                        *shared.entry(pair).or_default() += area_m2;
                    }
                }
            }
            open.push((to, i));
        }
    }
    let mut areas: HashMap<Face, f64> = HashMap::new();
    flats.iter().for_each(|flat| *areas.entry(face(flat)).or_default() += flat.area_m2);
    let mut found: BTreeMap<([u32; 2], bool), f64> = BTreeMap::new();
    for ([a, b], area_m2) in shared {
        let one_slab = (a.object, a.material) == (b.object, b.material);
        let copies = area_m2 >= (1.0 - COPY_SHARE) * areas[&a].max(areas[&b]);
        if one_slab && area_m2 > SHARE * areas[&a] || copies {
            *found.entry(([a.object, b.object], one_slab)).or_default() += area_m2;
        }
    }
    found.into_iter().map(|((objects, one_slab), area_m2)| Overlap { objects, area_m2, one_slab }).collect()
}

/// Key of a face: object, material and the hash-grid cell of its plane (normal, offset).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Face {
    object: u32,
    material: u32,
    plane: ([i64; 3], i64),
}

fn face(flat: &Flat) -> Face {
    let cell = (flat.normal / NORMAL_CELL).round().as_i64vec3().to_array();
    Face { object: flat.object, material: flat.material, plane: (cell, (flat.offset_m / OFFSET_CELL_M).round() as i64) }
}

/// A triangle with its plane, whose normal points the same way for both windings; `None` without area.
fn flat(scene: &Scene, index: usize, of_body: bool) -> Option<Flat> {
    let (corners, triangle) = (scene.corners_f64(index), &scene.triangles[index]);
    let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let normal = cross.try_normalize()?;
    let largest = normal.abs().max_position();
    let turned = normal[largest] < 0.0;
    let normal = if turned { -normal } else { normal };
    let offset_m = normal.dot(corners[0]);
    let (object, material) = (triangle.object, triangle.material);
    Some(Flat { normal, offset_m, corners, area_m2: 0.5 * cross.length(), object, material, turned, of_body })
}

/// The cells in which triangles of the same plane meet: those of its normal and offset, and those next to a border that is near.
fn cells_of(flat: &Flat) -> Vec<(I64Vec3, i64)> {
    let near = |x: f64| {
        let (low, high) = ((x - 0.3).round() as i64, (x + 0.3).round() as i64);
        if low == high { vec![low] } else { vec![low, high] }
    };
    let [x, y, z] = (flat.normal / NORMAL_CELL).to_array().map(near);
    let offsets = near(flat.offset_m / OFFSET_CELL_M);
    let mut cells = Vec::new();
    for &x in &x {
        for &y in &y {
            for &z in &z {
                cells.extend(offsets.iter().map(|offset| (I64Vec3::new(x, y, z), *offset)));
            }
        }
    }
    cells
}

/// An axis that lies about in the planes of a cell.
fn sweep_axis(normal: I64Vec3) -> DVec3 {
    normal.as_dvec3().try_normalize().unwrap_or(DVec3::Z).any_orthonormal_vector()
}

fn in_one_plane(a: &Flat, b: &Flat) -> bool {
    a.normal.dot(b.normal) > 1.0 - SAME_NORMAL && b.corners.iter().all(|p| (a.normal.dot(*p) - a.offset_m).abs() < SAME_PLANE_M)
}

/// The area of a triangle that another of its plane covers, m²: the first cut by the three sides of the second.
fn common_area_m2(a: &Flat, b: &Flat) -> f64 {
    let (u, v) = a.normal.any_orthonormal_pair();
    let lay = |p: DVec3| DVec2::new((p - a.corners[0]).dot(u), (p - a.corners[0]).dot(v));
    let cutter = b.corners.map(lay);
    let turn = (cutter[1] - cutter[0]).perp_dot(cutter[2] - cutter[0]).signum();
    let mut polygon: Vec<DVec2> = a.corners.map(lay).to_vec();
    for i in 0..3 {
        let (from, side) = (cutter[i], cutter[(i + 1) % 3] - cutter[i]);
        let height = |p: DVec2| side.perp_dot(p - from) * turn;
        let mut kept = Vec::with_capacity(polygon.len() + 1);
        for (k, &p) in polygon.iter().enumerate() {
            let q = polygon[(k + 1) % polygon.len()];
            let (at_p, at_q) = (height(p), height(q));
            if at_p >= 0.0 {
                kept.push(p);
            }
            if at_p * at_q < 0.0 {
                kept.push(p + (q - p) * (at_p / (at_p - at_q)));
            }
        }
        polygon = kept;
    }
    let doubled: f64 = (0..polygon.len()).map(|k| polygon[k].perp_dot(polygon[(k + 1) % polygon.len()])).sum();
    0.5 * doubled.abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Object, Triangle};
    use glam::Vec3;

    /// Object, material, the ranges of x and of y, the height, and whether it is cut along the other diagonal.
    type Sheet = (u32, u32, [f32; 2], [f32; 2], f32, bool);

    fn sheets(all: &[Sheet]) -> Scene {
        let mut scene = Scene::default();
        for (object, material, x, y, z, other) in all {
            while scene.objects.len() <= *object as usize {
                scene.objects.push(Object { name: format!("o{}", scene.objects.len()) });
            }
            let first = scene.positions.len() as u32;
            let corners = [[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]];
            scene.positions.extend(corners.map(|[x, y]| Vec3::new(x, y, *z)));
            let cut = if *other { [[0, 1, 3], [1, 2, 3]] } else { [[0, 1, 2], [0, 2, 3]] };
            let triangle = |t: [u32; 3]| Triangle { vertices: t.map(|v| first + v), material: *material, object: *object };
            scene.triangles.extend(cut.map(triangle));
        }
        scene
    }

    #[test]
    fn copies_are_found_whichever_way_they_are_cut() {
        let (x, y) = ([0.0, 2.0], [1.0, 4.0]);
        for cut in [false, true] {
            // Within one primitive, of another material, of another object.
            for (object, material, one_slab) in [(0, 0, true), (0, 1, false), (1, 0, false)] {
                let scene = sheets(&[(0, 0, x, y, 1.0, false), (object, material, x, y, 1.0, cut)]);
                let [found] = &overlaps(&scene)[..] else { panic!("{cut} {object} {material}") };
                assert_eq!((found.objects, found.one_slab), ([0, object], one_slab));
                assert!((found.area_m2 - 6.0).abs() < 1e-6, "{}", found.area_m2);
            }
        }
        // Laid of tiles, against one.
        let tiles = sheets(&[(0, 0, [0.0, 1.0], y, 1.0, false), (0, 0, [1.0, 2.0], y, 1.0, true), (1, 0, x, y, 1.0, false)]);
        assert!(overlaps(&tiles).iter().any(|o| o.objects == [0, 1] && (o.area_m2 - 6.0).abs() < 1e-6));
    }

    #[test]
    fn what_stands_on_a_floor_or_beside_another_is_no_copy() {
        let floor = (0, 0, [0.0, 9.0], [0.0, 9.0], 0.0, false);
        assert!(overlaps(&sheets(&[floor, (1, 0, [1.0, 2.0], [1.0, 2.0], 0.0, false)])).is_empty());
        assert!(overlaps(&sheets(&[floor, (0, 0, [9.0, 12.0], [0.0, 9.0], 0.0, true)])).is_empty());
        assert!(overlaps(&sheets(&[floor, (0, 0, [0.0, 9.0], [0.0, 9.0], 1e-4, true)])).is_empty());
        // A rug of the floor's own object and material is a second cover of a part of one slab.
        let found = overlaps(&sheets(&[floor, (0, 0, [1.0, 3.0], [1.0, 2.0], 0.0, false)]));
        assert!(found.len() == 1 && found[0].one_slab && (found[0].area_m2 - 2.0).abs() < 1e-6, "{found:?}");
    }

    /// Adds a closed box of an object, its faces outwards.
    fn add_box(scene: &mut Scene, object: u32, material: u32, min: Vec3, max: Vec3) {
        while scene.objects.len() <= object as usize {
            scene.objects.push(Object { name: format!("o{}", scene.objects.len()) });
        }
        let first = scene.positions.len() as u32;
        let corner = |i: usize| Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), max, min);
        scene.positions.extend((0..8).map(corner));
        for q in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            let triangle = |t: [u32; 3]| Triangle { vertices: t.map(|v| first + v), material, object };
            scene.triangles.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]].map(triangle));
        }
    }

    #[test]
    fn bodies_that_touch_are_no_copies_and_flush_or_doubled_ones_are() {
        let of = |object: u32, material: u32, min: Vec3, max: Vec3| {
            let mut scene = Scene::default();
            add_box(&mut scene, 0, 0, Vec3::ZERO, Vec3::ONE);
            add_box(&mut scene, object, material, min, max);
            overlaps(&scene).iter().map(|o| o.area_m2).sum::<f64>()
        };
        // Beside it and as large, of whatever object and material; then smaller, on top.
        for (object, material) in [(0, 0), (0, 1), (1, 0)] {
            assert_eq!(of(object, material, Vec3::X, Vec3::new(2.0, 1.0, 1.0)), 0.0, "{object} {material}");
        }
        assert_eq!(of(0, 0, Vec3::new(0.2, 0.2, 1.0), Vec3::new(0.7, 0.7, 1.5)), 0.0);
        // Halfway through it with four faces flush, a band half as wide as the box: both of the same object's faces are seen from outside.
        let flush = of(0, 0, Vec3::new(0.5, 0.0, 0.0), Vec3::new(1.5, 1.0, 1.0));
        assert!((flush - 2.0).abs() < 1e-6, "{flush}");
        let copy = of(1, 0, Vec3::ZERO, Vec3::ONE);
        assert!((copy - 6.0).abs() < 1e-6, "{copy}");
        // A sheet between a body and the open is no body: it lies on the body's face whichever way it looks.
        for turned in [false, true] {
            let mut scene = Scene::default();
            add_box(&mut scene, 0, 0, Vec3::ZERO, Vec3::ONE);
            let first = scene.positions.len() as u32;
            scene.positions.extend([Vec3::Z, Vec3::new(1.0, 0.0, 1.0), Vec3::ONE, Vec3::new(0.0, 1.0, 1.0)]);
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                let [b, c] = if turned { [c, b] } else { [b, c] };
                scene.objects.resize(2, Object { name: "sheet".into() });
                scene.triangles.push(Triangle { vertices: [first + a, first + b, first + c], material: 1, object: 1 });
            }
            assert_eq!(overlaps(&scene).len(), 1, "{turned}");
        }
    }
}
