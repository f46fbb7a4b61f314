use super::materials::Mat;
use super::*;
use crate::config::SceneConfig;
use crate::{Scene, import, trajectory};
use glam::{DVec2, DVec3};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

fn committed(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../scenes").join(name)
}

fn loaded() -> Scene {
    import::load(committed("lobby.glb")).unwrap()
}

/// What lies beyond the glass is no part of the room.
const OUTSIDE: &str = "Outdoor";

#[test]
fn the_committed_file_is_what_the_builder_writes_again_on_one_thread() {
    let file = std::fs::read(committed("lobby.glb")).unwrap();
    // The file was written on every core the builder's machine had.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(pool.install(build) == file, "scenes/lobby.glb is stale: rebuild it with `corf scene build lobby`");
}

#[test]
fn the_file_is_small_and_rich() {
    // Small enough to clone with the source.
    assert!(std::fs::metadata(committed("lobby.glb")).unwrap().len() < 12_000_000);
    let scene = loaded();
    assert!(scene.triangles.len() >= 20_000, "{}", scene.triangles.len());
    let names: BTreeSet<&str> = scene.objects.iter().map(|o| o.name.as_str()).collect();
    assert!(names.len() >= 60 && names.len() == scene.objects.len(), "{} names of {} objects", names.len(), scene.objects.len());
    assert!(names.iter().all(|n| !n.is_empty()));
    // Light sampling looks at every emissive triangle.
    let emissive = scene.triangles.iter().filter(|t| scene.materials[t.material as usize].optical.emissive != [0.0; 3]).count();
    assert!((30..400).contains(&emissive), "{emissive}");
}

#[test]
fn every_material_has_a_radio_slab_valid_at_60_ghz() {
    let scene = loaded();
    assert!(scene.materials_without_radio().is_empty());
    let mut ids = BTreeSet::new();
    for m in &scene.materials {
        let radio = m.radio.as_ref().unwrap();
        ids.insert(radio.id.clone());
        let (real, loss) = radio.complex_permittivity(60e9).unwrap();
        assert!(real >= 1.0 && loss > 0.0 && radio.thickness_m > 0.0, "{}", m.name);
        assert!(m.optical.base_color.iter().all(|c| (0.0..=1.0).contains(c)), "{}", m.name);
    }
    for id in [
        "concrete",
        "plasterboard",
        "glass",
        "wood",
        "marble",
        "metal",
        "leather",
        "cloth",
        "plastic",
        "ceiling_board",
        "chipboard",
        "floorboard",
    ] {
        assert!(ids.contains(id), "{id} is missing");
    }
}

#[test]
fn the_room_is_14_by_15_by_3_and_a_half_metres_and_l_shaped() {
    let scene = loaded();
    let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
    for (i, t) in scene.triangles.iter().enumerate() {
        if scene.objects[t.object as usize].name.starts_with(OUTSIDE) {
            continue;
        }
        for p in scene.corners_f64(i) {
            low = low.min(p);
            high = high.max(p);
            // Door leaves and mullions stand in their wall's opening, at most 6 cm behind its face.
            assert!(
                p.x < 8.57 || p.y < 9.07,
                "{:?} reaches into the cut-out corner at {p}",
                scene.objects[t.object as usize].name
            );
        }
    }
    // Frames in openings reach 6 cm behind the wall's face.
    const REVEAL_M: f64 = 0.061;
    assert!(low.z.abs() < 1e-9 && high.z == 3.5, "{low} {high}");
    assert!(
        low.abs().max_element() < REVEAL_M && (high - DVec3::new(14.0, 15.0, 3.5)).abs().max_element() < REVEAL_M,
        "{low} {high}"
    );
}

#[test]
fn normals_are_unit_and_agree_with_the_winding() {
    for object in objects() {
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

/// Materials of which single sheets are made.
fn is_sheet(mat: Mat) -> bool {
    use Mat::*;
    matches!(
        mat,
        FloorTiles | FloorBoards | Ceiling | Plaster | PlasterTeal | PlasterSand | Concrete | ConcreteBacking | MarbleGreen | Glass | DoorGlass
            | Leaf | LeafPale | Street | LightPanel | UpLight | Downlight | PendantGlow | LampShade | ScreenWelcome | ScreenSchedule | ScreenDesk | LiftSign
            | Exit | ClockFace | PosterExpo | PosterWaves | PosterChart | PosterMap | PosterGrid | PosterHills
            // Trim laid on a closed body: pillar rings, labels, the belt, the pendants' two-sided shades.
            | Brushed | WhiteMetal | WhitePlastic | BlackPlastic | ClothRust | DarkMetal | Brass
    )
}

/// A connected body: signed volume, directed edges cancelled against their opposites, materials, a point of it.
type Body = (f64, BTreeMap<(usize, usize), i32>, BTreeSet<Mat>, DVec3);

#[test]
fn closed_things_are_closed_and_wound_outwards() {
    let key = |p: DVec3| [p.x, p.y, p.z].map(|v| (v * 1e6).round() as i64);
    let (mut closed, mut open) = (0, 0);
    for object in objects() {
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
    assert!(closed > 1000 && open > 500, "{closed} closed, {open} open");
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

#[test]
fn the_platform_keeps_40_cm_from_everything_up_to_2_m() {
    const CLEARANCE_M: f64 = 0.4;
    // Above the rugs and thresholds it rolls over, below the head of whoever pushes it.
    const BAND_M: [f64; 2] = [0.05, 2.0];
    let config = SceneConfig::load(committed("lobby.toml")).unwrap();
    let scene = loaded();
    let poses = trajectory::generate(config.trajectory.as_ref().unwrap(), 500).unwrap();
    let mut worst = (f64::INFINITY, String::new());
    for i in 0..scene.triangles.len() {
        let corners = scene.corners_f64(i);
        for pose in &poses {
            let d = plan_distance(pose.world_from_camera.translation.truncate(), corners, BAND_M[0], BAND_M[1]);
            if d < worst.0 {
                let name = &scene.objects[scene.triangles[i].object as usize].name;
                worst = (d, format!("{name} at pose {}, {}", pose.index, pose.world_from_camera.translation));
            }
        }
    }
    assert!(worst.0 >= CLEARANCE_M, "{:.3} m from {}", worst.0, worst.1);
    // Both arms are visited, and the transmitter stands where it should.
    assert!(
        poses.iter().any(|p| p.world_from_camera.translation.y > 12.5)
            && poses.iter().any(|p| p.world_from_camera.translation.x > 9.5)
    );
    assert_eq!(config.transmitter.position_m, [12.4, 4.5, 2.0]);
}
