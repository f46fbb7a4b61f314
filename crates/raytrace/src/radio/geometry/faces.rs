//! Gathering triangles into planar faces, in a time that grows with their number.

use crate::radio::geometry::face::{COPLANAR_NORMAL, Face};
use crate::radio::geometry::planar::PlanarIndex;
use corf_scene::Scene;
use glam::{DVec3, IVec3};
use rustc_hash::FxHashMap;
use std::collections::HashMap;

/// Triangles belong to one face when their corners lie this close to its plane, metres (float32 corners at 10 m are off by 1e-6).
const COPLANAR_DISTANCE_M: f64 = 5e-6;
/// The angle of [`COPLANAR_NORMAL`], rounded up: normals of one face differ by no more per component.
const COPLANAR_RAD: f64 = 1.001e-3;
/// Side of a cell of normals.
const NORMAL_CELL: f64 = 4e-3;
/// Bins along a cell's direction over the diameter of a part.
const BINS: f64 = 200.0;

/// A plane being gathered.
struct Group {
    normal: DVec3,
    offset_m: f64,
    area_m2: f64,
    triangles: Vec<u32>,
    material: u32,
    object: u32,
}

/// Planes filed under keys; what a key finds are candidates.
#[derive(Default)]
struct Planes {
    /// The entry filed last under a key, plus 1.
    last: FxHashMap<Key, u32>,
    /// (group, the entry before under the same key plus 1).
    entries: Vec<(u32, u32)>,
}

impl Planes {
    fn file(&mut self, key: Key, group: u32) {
        let last = self.last.entry(key).or_default();
        self.entries.push((group, *last));
        *last = self.entries.len() as u32;
    }

    fn under(&self, key: Key) -> impl Iterator<Item = u32> + '_ {
        let mut next = self.last.get(&key).copied().unwrap_or(0);
        std::iter::from_fn(move || {
            let (group, before) = *self.entries.get(next.checked_sub(1)? as usize)?;
            next = before;
            Some(group)
        })
    }
}

/// Search key of planes within a part: the part, the cell of the plane's normal, and one of the bins along the cell's own direction that
/// the plane reaches within the part.
type Key = (u32, IVec3, i64);

/// An area to eleven binary digits: the halves of a rectangle are the same size.
fn size(area: f64) -> u32 {
    (area as f32).to_bits() >> 12
}

/// One object's triangles of one material.
struct Part {
    number: u32,
    centre: DVec3,
    radius_m: f64,
}

impl Part {
    fn bin(&self, along_m: f64) -> i64 {
        (along_m * BINS / (2.0 * self.radius_m).max(COPLANAR_DISTANCE_M)).floor() as i64
    }

    /// The keys under which a plane is filed.
    fn keys_of_plane(&self, normal: DVec3, point: DVec3) -> impl Iterator<Item = Key> + '_ {
        let cell = (normal / NORMAL_CELL).round().as_ivec3();
        let direction = cell.as_dvec3() * NORMAL_CELL;
        // Points of the plane within the part differ along the cell's direction d by no more than |d − n|·2r.
        let reach_m = (direction - normal).length() * 2.0 * self.radius_m + COPLANAR_DISTANCE_M * 2.0;
        let at = direction.dot(point - self.centre);
        (self.bin(at - reach_m)..=self.bin(at + reach_m)).map(move |bin| (self.number, cell, bin))
    }

    /// The keys under which planes that a triangle may lie in are filed: those of every cell near its normal, of either sign.
    fn keys_of_triangle(&self, normal: DVec3, corner: DVec3) -> Vec<Key> {
        let mut keys = Vec::new();
        for normal in [normal, -normal] {
            let low = ((normal - COPLANAR_RAD) / NORMAL_CELL).round().as_ivec3();
            let high = ((normal + COPLANAR_RAD) / NORMAL_CELL).round().as_ivec3();
            for x in low.x..=high.x {
                for y in low.y..=high.y {
                    for z in low.z..=high.z {
                        let cell = IVec3::new(x, y, z);
                        let along_m = (cell.as_dvec3() * NORMAL_CELL).dot(corner - self.centre);
                        keys.push((self.number, cell, self.bin(along_m)));
                    }
                }
            }
        }
        keys
    }
}

/// Groups triangles by object, material and plane; larger triangles first, so that they define the planes, and of those as large to
/// float32's rounding the first. Returns the faces and the face of every triangle.
pub fn gather(scene: &Scene, corners: &[[DVec3; 3]]) -> (Vec<Face>, Vec<u32>) {
    let crosses: Vec<DVec3> = corners.iter().map(|c| (c[1] - c[0]).cross(c[2] - c[0])).collect();
    let doubled_areas: Vec<f64> = crosses.iter().map(|c| c.length()).collect();
    let mut order: Vec<u32> = (0..corners.len() as u32).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(size(doubled_areas[i as usize])), i));
    let parts = parts(scene, corners);
    let mut groups: Vec<Group> = Vec::new();
    let mut planes = Planes::default();
    for i in order {
        let (triangle, corner) = (&scene.triangles[i as usize], &corners[i as usize]);
        let doubled = doubled_areas[i as usize];
        let normal = if doubled > 0.0 { crosses[i as usize] / doubled } else { DVec3::Z };
        let part = &parts[&(triangle.object, triangle.material)];
        let in_plane = |group: &Group| {
            group.normal.dot(normal).abs() > 1.0 - COPLANAR_NORMAL
                && corner.iter().all(|p| (group.normal.dot(*p) - group.offset_m).abs() < COPLANAR_DISTANCE_M)
        };
        let keys = part.keys_of_triangle(normal, corner[0]);
        let candidates = keys.iter().flat_map(|key| planes.under(*key));
        let home = candidates.filter(|&g| in_plane(&groups[g as usize])).min().unwrap_or_else(|| {
            let number = groups.len() as u32;
            part.keys_of_plane(normal, corner[0]).for_each(|key| planes.file(key, number));
            let offset_m = normal.dot(corner[0]);
            let (material, object) = (triangle.material, triangle.object);
            groups.push(Group { normal, offset_m, area_m2: 0.0, triangles: Vec::new(), material, object });
            number
        });
        groups[home as usize].area_m2 += 0.5 * doubled;
        groups[home as usize].triangles.push(i);
    }
    let mut face_of_triangle = vec![0; corners.len()];
    let mut faces = Vec::with_capacity(groups.len());
    for (face, group) in groups.into_iter().enumerate() {
        group.triangles.iter().for_each(|&t| face_of_triangle[t as usize] = face as u32);
        faces.push(Face {
            normal: group.normal,
            offset_m: group.offset_m,
            material: group.material,
            object: group.object,
            area_m2: group.area_m2,
            index: PlanarIndex::new(group.normal, group.triangles.iter().map(|&t| corners[t as usize])),
        });
    }
    (faces, face_of_triangle)
}

/// Objects by material, each with the sphere around its box.
fn parts(scene: &Scene, corners: &[[DVec3; 3]]) -> HashMap<(u32, u32), Part> {
    let mut boxes: HashMap<(u32, u32), (DVec3, DVec3)> = HashMap::new();
    for (triangle, corners) in scene.triangles.iter().zip(corners) {
        let (min, max) = boxes.entry((triangle.object, triangle.material)).or_insert((DVec3::INFINITY, DVec3::NEG_INFINITY));
        for p in corners {
            (*min, *max) = (min.min(*p), max.max(*p));
        }
    }
    let mut keys: Vec<(u32, u32)> = boxes.keys().copied().collect();
    keys.sort_unstable();
    let numbered = keys.into_iter().enumerate().map(|(number, key)| {
        let (min, max) = boxes[&key];
        (key, Part { number: number as u32, centre: (min + max) * 0.5, radius_m: 0.5 * (max - min).length() })
    });
    numbered.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;
    use corf_scene::model::{Object, Triangle};
    use glam::Vec3;

    /// Facets of every kind: tilted and axis-aligned grids, parallel planes a hair apart, a sphere, both windings.
    fn mixed() -> Scene {
        let mut scene = Scene { name: "mixed".into(), ..Scene::default() };
        scene.objects = (0..3).map(|i| Object { name: format!("o{i}") }).collect();
        let mut add = |corners: [Vec3; 3], object: u32, material: u32| {
            let first = scene.positions.len() as u32;
            scene.positions.extend(corners);
            scene.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material, object });
        };
        let mut rng = Rng::keyed(3, 1, 4);
        let mut number = move || rng.uniform_f64() as f32;
        for plane in 0..40 {
            let n = Vec3::new(number() - 0.5, number() - 0.5, if plane % 3 == 0 { 30.0 } else { number() - 0.5 }).normalize();
            let (u, v) = n.any_orthonormal_pair();
            let o = Vec3::new(number(), number(), number()) * 8.0;
            for i in 0..12 {
                let at = |a: f32, b: f32| o + u * (a + i as f32 * 0.2) + v * (b + (i % 3) as f32);
                let mut t = [at(0.0, 0.0), at(number(), 0.1), at(0.2, number())];
                if i % 2 == 1 {
                    t.swap(1, 2);
                }
                add(t, plane % 3, (i % 5 == 0) as u32);
            }
        }
        for layer in 0..60 {
            let z = 1.0 + layer as f32 * 2e-5;
            for i in 0..4 {
                let x = i as f32;
                add([Vec3::new(x, 0.0, z), Vec3::new(x + 1.0, 0.0, z), Vec3::new(x, 1.0 + number(), z)], 0, 0);
            }
        }
        for i in 0..600 {
            let (theta, phi) = (0.1 + 2.9 * (i / 30) as f32 / 20.0, 0.209 * (i % 30) as f32);
            let on = |t: f32, p: f32| Vec3::new(t.sin() * p.cos(), t.sin() * p.sin(), t.cos()) * 1.5 + Vec3::splat(4.0);
            add([on(theta, phi), on(theta + 0.14, phi), on(theta, phi + 0.2)], 1, 0);
        }
        scene
    }

    #[test]
    fn the_index_gathers_what_a_scan_of_all_planes_gathers() {
        let scene = mixed();
        let corners: Vec<[DVec3; 3]> = (0..scene.triangles.len()).map(|i| scene.corners_f64(i)).collect();
        let (faces, of_triangle) = gather(&scene, &corners);
        // The definition, by brute force: the first plane of the part, largest triangles first, that all corners lie in.
        let cross = |i: usize| (corners[i][1] - corners[i][0]).cross(corners[i][2] - corners[i][0]);
        let mut order: Vec<usize> = (0..corners.len()).collect();
        order.sort_by_key(|&i| (std::cmp::Reverse(size(cross(i).length())), i));
        let mut planes: Vec<(u32, u32, DVec3, f64)> = Vec::new();
        for i in order {
            let (t, n) = (&scene.triangles[i], cross(i).normalize());
            let home = planes.iter().position(|(object, material, normal, offset)| {
                (*object, *material) == (t.object, t.material)
                    && normal.dot(n).abs() > 1.0 - COPLANAR_NORMAL
                    && corners[i].iter().all(|p| (normal.dot(*p) - offset).abs() < COPLANAR_DISTANCE_M)
            });
            let home = home.unwrap_or_else(|| {
                planes.push((t.object, t.material, n, n.dot(corners[i][0])));
                planes.len() - 1
            });
            assert_eq!(of_triangle[i] as usize, home, "triangle {i}");
        }
        assert_eq!(faces.len(), planes.len());
        // Not trivially so: many triangles share planes, and many planes are alone.
        assert!(faces.len() < corners.len() - 200 && faces.len() > 300, "{} of {}", faces.len(), corners.len());
    }
}
