//! Checks shared by the tests of all scenes built in code.

use super::materials::Mat;
use super::mesh_builder::BuiltObject;
use crate::info::validate_scene;
use crate::trajectory::TrajectoryPose;
use crate::{Scene, Severity};
use glam::{DVec2, DVec3};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// A file of the repository's scenes.
pub fn committed(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../scenes").join(name)
}

/// The file was written on every core its builder's machine had; on one thread the bytes are the same.
pub fn assert_committed(name: &str, build: fn() -> Vec<u8>) {
    let file = std::fs::read(committed(&format!("{name}.glb"))).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(pool.install(build) == file, "scenes/{name}.glb is stale: rebuild it with `corf scene build {name}`");
}

/// Every material has a radio slab that is valid at 60 GHz, and a base colour within bounds. The slabs' identifiers.
pub fn assert_radio(scene: &Scene) -> BTreeSet<String> {
    assert!(scene.materials_without_radio().is_empty());
    let mut ids = BTreeSet::new();
    for m in &scene.materials {
        let radio = m.radio.as_ref().unwrap();
        ids.insert(radio.id.clone());
        let (real, loss) = radio.complex_permittivity(60e9).unwrap();
        assert!(real >= 1.0 && loss > 0.0 && radio.thickness_m > 0.0, "{}", m.name);
        assert!(m.light.base_color.iter().all(|c| (0.0..=1.0).contains(c)), "{}", m.name);
    }
    ids
}

/// At least 20 000 triangles, every object named once, and a number of emissive triangles that light sampling can look at one by one.
pub fn assert_rich(scene: &Scene) {
    assert!(scene.triangles.len() >= 20_000, "{}", scene.triangles.len());
    let names: BTreeSet<&str> = scene.objects.iter().map(|o| o.name.as_str()).collect();
    assert!(names.len() >= 60 && names.len() == scene.objects.len(), "{} names of {} objects", names.len(), scene.objects.len());
    assert!(names.iter().all(|n| !n.is_empty()));
    let emissive = scene.triangles.iter().filter(|t| scene.materials[t.material as usize].light.emissive != [0.0; 3]).count();
    assert!((30..400).contains(&emissive), "{emissive}");
}

/// Normals are unit vectors on their triangles' outer side, and no triangle is degenerate.
pub fn assert_normals(objects: &[BuiltObject]) {
    for object in objects {
        for (mat, mesh) in &object.parts {
            for n in &mesh.normals {
                assert!((n.length() - 1.0).abs() < 1e-9, "{} {mat:?}", object.name);
            }
            for t in &mesh.triangles {
                let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
                let face = (b - a).cross(c - a);
                assert!(face.length() > 0.0, "{} {mat:?} has a degenerate triangle", object.name);
                for i in t {
                    assert!(face.dot(mesh.normals[*i as usize]) > 0.0, "{} {mat:?} at {a}", object.name);
                }
            }
        }
    }
}

/// A connected body: signed volume, directed edges cancelled against their opposites, materials, a point of it.
type Body = (f64, BTreeMap<(usize, usize), i32>, BTreeSet<Mat>, DVec3);

/// Every body whose materials are none of which sheets are made is closed and wound outwards. How many are closed, and how many open.
pub fn assert_closed(objects: &[BuiltObject], is_sheet: impl Fn(Mat) -> bool) -> (usize, usize) {
    let key = |p: DVec3| [p.x, p.y, p.z].map(|v| (v * 1e6).round() as i64);
    let (mut closed, mut open) = (0, 0);
    for object in objects {
        // Corners welded over the whole object: a book's paper top closes its cloth.
        let mut ids: BTreeMap<[i64; 3], usize> = BTreeMap::new();
        let mut triangles = Vec::new();
        for (mat, mesh) in &object.parts {
            for t in &mesh.triangles {
                let corners = t.map(|i| mesh.positions[i as usize]);
                let welded = corners.map(|p| {
                    let next = ids.len();
                    *ids.entry(key(p)).or_insert(next)
                });
                triangles.push((*mat, corners, welded));
            }
        }
        let mut parent: Vec<usize> = (0..ids.len()).collect();
        fn root(parent: &mut [usize], mut i: usize) -> usize {
            while parent[i] != i {
                parent[i] = parent[parent[i]];
                i = parent[i];
            }
            i
        }
        for (_, _, w) in &triangles {
            for k in 1..3 {
                let (a, b) = (root(&mut parent, w[0]), root(&mut parent, w[k]));
                parent[a] = b;
            }
        }
        let mut bodies: BTreeMap<usize, Body> = BTreeMap::new();
        for (mat, c, w) in &triangles {
            let body = bodies.entry(root(&mut parent, w[0])).or_insert_with(|| (0.0, BTreeMap::new(), BTreeSet::new(), c[0]));
            let [a, b, d] = c.map(|p| p - body.3);
            body.0 += a.dot(b.cross(d)) / 6.0;
            body.2.insert(*mat);
            for k in 0..3 {
                let (i, j) = (w[k], w[(k + 1) % 3]);
                *body.1.entry((i.min(j), i.max(j))).or_default() += if i < j { 1 } else { -1 };
            }
        }
        for (volume, edges, mats, _) in bodies.values() {
            if edges.values().all(|n| *n == 0) {
                closed += 1;
                assert!(*volume > 0.0, "{} {mats:?} is inside out", object.name);
            } else {
                open += 1;
                assert!(mats.iter().any(|m| is_sheet(*m)), "{} {mats:?} should be closed", object.name);
            }
        }
    }
    (closed, open)
}

/// A validation of the scene warns of nothing.
pub fn assert_sound(scene: &Scene) {
    let findings = validate_scene(scene, 60e9);
    let warnings: Vec<String> = findings.iter().filter(|f| f.severity != Severity::Note).map(ToString::to_string).collect();
    assert!(warnings.is_empty(), "{warnings:?}");
}

/// Distance in plan from `p` to the part of a triangle between two heights; infinite where there is none.
fn plan_distance(p: DVec2, corners: [DVec3; 3], low: f64, high: f64) -> f64 {
    let mut polygon: Vec<DVec3> = corners.to_vec();
    for (sign, level) in [(1.0, low), (-1.0, high)] {
        let inside = |q: &DVec3| sign * (q.z - level) >= 0.0;
        let mut clipped = Vec::new();
        for i in 0..polygon.len() {
            let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            if inside(&a) {
                clipped.push(a);
            }
            if inside(&a) != inside(&b) {
                clipped.push(a + (b - a) * ((level - a.z) / (b.z - a.z)));
            }
        }
        polygon = clipped;
    }
    let n = polygon.len();
    let (mut nearest, mut left, mut right) = (f64::INFINITY, false, false);
    for i in 0..n {
        let (a, b) = (polygon[i].truncate(), polygon[(i + 1) % n].truncate());
        let d = b - a;
        let t = if d.length_squared() > 0.0 { ((p - a).dot(d) / d.length_squared()).clamp(0.0, 1.0) } else { 0.0 };
        nearest = nearest.min(p.distance(a + d * t));
        let side = d.perp_dot(p - a);
        left |= side > 1e-12;
        right |= side < -1e-12;
    }
    if n > 2 && left != right { 0.0 } else { nearest }
}

/// The platform keeps `clearance_m` from everything, from above the rugs and thresholds it rolls over to the head of whoever pushes it.
pub fn assert_clearance(scene: &Scene, poses: &[TrajectoryPose], clearance_m: f64) {
    const BAND_M: [f64; 2] = [0.05, 2.0];
    let mut worst = (f64::INFINITY, String::new());
    for i in 0..scene.triangles.len() {
        let corners = scene.corners_f64(i);
        for pose in poses {
            let d = plan_distance(pose.world_from_camera.translation.truncate(), corners, BAND_M[0], BAND_M[1]);
            if d < worst.0 {
                let name = &scene.objects[scene.triangles[i].object as usize].name;
                worst = (d, format!("{name} at pose {}, {}", pose.index, pose.world_from_camera.translation));
            }
        }
    }
    assert!(worst.0 >= clearance_m, "{:.3} m from {}", worst.0, worst.1);
}
