//! Tests of skinned meshes: joints alone put them where they stand.

use super::gltf_features::{File, lines};
use super::*;

const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// World corners of the skinned triangle, worked out by hand. Joint A: 90° about z after −1 along x, then (11, 2, 3). Joint B: twice the
/// size, then (1, 2, 8). The corners (0, 0, 0), (1, 0, 0), (0, 1, 0) hang on A, on both, and on B: (11, 1, 3), (7, 2, 5.5), (1, 4, 8) in the file.
const POSED: [Vec3; 3] = [Vec3::new(11.0, -3.0, 1.0), Vec3::new(7.0, -5.5, 2.0), Vec3::new(1.0, -8.0, 4.0)];

/// Weights per corner of the joints A and B.
const WEIGHTS: [[f32; 2]; 3] = [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]];

/// Encodings of weights: component type, and how far they may be off.
const ENCODINGS: [(u32, f32); 3] = [(5126, 1e-5), (5123, 1e-3), (5121, 3e-2)];

impl File {
    /// The plain file with the nodes of two joints (3 and 4) below the room.
    fn with_joints() -> Self {
        let mut f = Self::new();
        let nodes = f.json["nodes"].as_array_mut().unwrap();
        nodes.push(json!({ "name": "A", "translation": [10.0, 0.0, 0.0], "rotation": [0.0, 0.0, HALF, HALF] }));
        nodes.push(json!({ "name": "B", "translation": [0.0, 0.0, 5.0], "scale": [2.0, 2.0, 2.0] }));
        f.json["nodes"][0]["children"] = json!([1, 2, 3, 4]);
        f.json["nodes"][1]["skin"] = json!(0);
        let mut matrices = [0.0; 32];
        (0..4).for_each(|i| (matrices[5 * i], matrices[16 + 5 * i]) = (1.0, 1.0));
        matrices[12] = -1.0;
        let matrices = f.floats("MAT4", 2, &matrices);
        f.json["skins"] = json!([{ "joints": [3, 4], "inverseBindMatrices": matrices }]);
        f
    }

    /// Four values a corner, of an encoding.
    fn fours(&mut self, component: u32, values: [[f32; 4]; 3]) -> usize {
        let all = values.into_iter().flatten();
        let (bytes, normalized): (Vec<u8>, bool) = match component {
            5126 => (all.flat_map(f32::to_le_bytes).collect(), false),
            5123 => (all.flat_map(|v| ((v * 65535.0).round() as u16).to_le_bytes()).collect(), true),
            _ => (all.map(|v| (v * 255.0).round() as u8).collect(), true),
        };
        self.accessor(component, "VEC4", 3, normalized, 0, &bytes)
    }

    fn joints(&mut self, component: u32, joints: [u8; 4]) -> usize {
        let all = [joints; 3].into_iter().flatten();
        let bytes: Vec<u8> =
            if component == 5121 { all.collect() } else { all.flat_map(|j| u16::from(j).to_le_bytes()).collect() };
        self.accessor(component, "VEC4", 3, false, 0, &bytes)
    }

    fn attribute(&mut self, name: &str, accessor: usize) {
        self.primitive()["attributes"][name] = json!(accessor);
    }

    /// Both joints in one set of influences.
    fn skinned() -> Self {
        let mut f = Self::with_joints();
        let joints = f.joints(5121, [0, 1, 0, 0]);
        let weights = f.fours(5126, WEIGHTS.map(|[a, b]| [a, b, 0.0, 0.0]));
        f.attribute("JOINTS_0", joints);
        f.attribute("WEIGHTS_0", weights);
        f
    }
}

fn posed(f: &File, within: f32) {
    let (scene, report) = f.read();
    assert!(report.notes.is_empty() && report.unread.is_empty(), "{report:?}");
    for (found, expected) in scene.corners(0).into_iter().zip(POSED) {
        assert!(found.distance(expected) <= within, "{:?}", scene.corners(0));
    }
}

#[test]
fn joints_of_every_encoding_put_a_mesh_where_they_stand() {
    for joint_component in [5121, 5123] {
        for (component, within) in ENCODINGS {
            let mut f = File::with_joints();
            let joints = f.joints(joint_component, [1, 7, 0, 9]);
            // Joints that weigh nothing may be any.
            let weights = f.fours(component, WEIGHTS.map(|[a, b]| [b, 0.0, a, 0.0]));
            f.attribute("JOINTS_0", joints);
            f.attribute("WEIGHTS_0", weights);
            posed(&f, within);
        }
    }
}

#[test]
fn a_second_set_of_influences_counts_as_the_first() {
    let mut f = File::with_joints();
    for (set, joint) in [(0, 0), (1, 1)] {
        let joints = f.joints(5121, [joint; 4]);
        let weights = f.fours(5126, WEIGHTS.map(|w| [0.25 * w[usize::from(joint)]; 4]));
        f.attribute(&format!("JOINTS_{set}"), joints);
        f.attribute(&format!("WEIGHTS_{set}"), weights);
    }
    posed(&f, 1e-5);
}

#[test]
fn the_node_of_a_skinned_mesh_does_not_move_it_and_its_joints_parents_do() {
    let mut f = File::skinned();
    for transform in [json!({ "translation": [0.0, 500.0, 0.0] }), json!({ "scale": [-3.0, 1.0, 1.0] })] {
        for (key, value) in transform.as_object().unwrap() {
            f.json["nodes"][1][key] = value.clone();
        }
        posed(&f, 1e-5);
    }
    f.json["nodes"][0]["translation"] = json!([1.0, 2.0, 13.0]);
    let moved = f.read().0.corners(0);
    assert!(moved.into_iter().zip(POSED).all(|(found, posed)| found.distance(posed - Vec3::Y * 10.0) < 1e-5), "{moved:?}");
    // Whichever way the file is up.
    let up = ImportOptions { up: Some(UpAxis::Z), ..ImportOptions::default() };
    let as_it_stands = f.read_by(&up).unwrap().0.corners(0)[2];
    assert!(as_it_stands.distance(Vec3::new(1.0, 4.0, 18.0)) < 1e-5, "{as_it_stands}");
}

#[test]
fn a_skin_without_inverse_bind_matrices_has_none_to_apply() {
    let mut f = File::skinned();
    f.json["skins"][0].as_object_mut().unwrap().remove("inverseBindMatrices");
    // Joint A: 90° about z, then (11, 2, 3).
    let corner = f.read().0.corners(0)[0];
    assert!(corner.distance(Vec3::new(11.0, -3.0, 2.0)) < 1e-5, "{corner}");
}

#[test]
fn morphs_come_before_joints_and_mirrors_keep_the_front_in_front() {
    let mut f = File::skinned();
    let normals = f.floats("VEC3", 3, &[0.0, 0.0, 1.0].repeat(3));
    f.attribute("NORMAL", normals);
    let target = f.floats("VEC3", 3, &[0.0, 2.0, 0.0].repeat(3));
    f.primitive()["targets"] = json!([{ "POSITION": target }]);
    f.json["meshes"][0]["weights"] = json!([0.5]);
    // (0, 0, 0) + (0, 1, 0), under A: (−1, 1, 0) turned, (−1, −1, 0), and moved.
    let corner = f.read().0.corners(0)[0];
    assert!(corner.distance(Vec3::new(10.0, -3.0, 1.0)) < 1e-5, "{corner}");
    for scale in [[2.0, 2.0, 2.0], [-2.0, 2.0, 2.0]] {
        for joint in [3, 4] {
            f.json["nodes"][joint]["scale"] = json!(scale);
        }
        let scene = f.read().0;
        let [a, b, c] = scene.corners(0);
        let front = (b - a).cross(c - a).normalize();
        assert!(front.dot(scene.normals[scene.triangles[0].vertices[0] as usize]) > 0.7, "{scale:?}: {front}");
    }
}

#[test]
fn skins_that_say_nothing_or_nonsense_are_refused() {
    let change = |change: &dyn Fn(&mut File), words: &[&str]| {
        let mut f = File::skinned();
        change(&mut f);
        f.refused(words);
    };
    let without = |name: &'static str| {
        move |f: &mut File| {
            f.primitive()["attributes"].as_object_mut().unwrap().remove(name);
        }
    };
    change(&without("JOINTS_0"), &["primitives[0]", "JOINTS_0"]);
    change(&without("WEIGHTS_0"), &["primitives[0]", "WEIGHTS_0"]);
    let neither = |f: &mut File| {
        without("JOINTS_0")(f);
        without("WEIGHTS_0")(f);
    };
    change(&neither, &["primitives[0]", "neither JOINTS_0 nor WEIGHTS_0"]);
    for (values, word) in [
        ([[0.0; 4]; 3], "vertex 0 hangs on no joint"),
        ([[-0.5, 1.5, 0.0, 0.0]; 3], "-0.5"),
        ([[f32::NAN; 4]; 3], "NaN"),
        ([[0.5, 0.0, 0.0, f32::INFINITY]; 3], "inf"),
    ] {
        let set = |f: &mut File| {
            let weights = f.fours(5126, values);
            f.attribute("WEIGHTS_0", weights);
        };
        change(&set, &["primitives[0]", word]);
    }
    let far = |f: &mut File| {
        let joints = f.joints(5123, [0, 2, 0, 0]);
        f.attribute("JOINTS_0", joints);
    };
    change(&far, &["vertex 1 asks for joint 2 of 2"]);
    let of_floats = |f: &mut File| {
        let joints = f.fours(5126, [[0.0; 4]; 3]);
        f.attribute("JOINTS_0", joints);
    };
    change(&of_floats, &["joints are no four unsigned integers"]);
    let plain_integers = |f: &mut File| {
        let weights = f.joints(5121, [1, 0, 0, 0]);
        f.attribute("WEIGHTS_0", weights);
    };
    change(&plain_integers, &["normalised"]);
    let few = |f: &mut File| {
        let matrix = f.floats("MAT4", 1, &[0.0; 16]);
        f.json["skins"][0]["inverseBindMatrices"] = json!(matrix);
    };
    change(&few, &["1 inverse bind matrices for 2 joints"]);
    let projective = |f: &mut File| {
        let matrices = f.floats("MAT4", 2, &[0.0; 32]);
        f.json["skins"][0]["inverseBindMatrices"] = json!(matrices);
    };
    change(&projective, &["inverse bind matrix 0 is not affine"]);
    let instances = |f: &mut File| {
        let places = f.floats("VEC3", 2, &[0.0; 6]);
        f.json["nodes"][1]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": places } } });
    };
    change(&instances, &["EXT_mesh_gpu_instancing", "skin"]);
    let circle = |f: &mut File| {
        f.json["nodes"][3]["children"] = json!([5]);
        f.json["nodes"].as_array_mut().unwrap().push(json!({ "children": [3] }));
        f.json["nodes"][0]["children"] = json!([1, 2, 4]);
    };
    change(&circle, &["is its own ancestor"]);
}

#[test]
fn joints_outside_of_the_scene_and_weights_that_do_not_add_up_are_told() {
    let mut f = File::skinned();
    f.json["nodes"][0]["children"] = json!([1, 2, 4]);
    let (scene, report) = f.read();
    // Without the room's (1, 2, 3).
    assert!(scene.corners(0)[0].distance(Vec3::new(10.0, 0.0, -1.0)) < 1e-5, "{:?}", scene.corners(0));
    assert!(lines(&report, "no scene that is read").iter().any(|l| l.starts_with("skins[0]: ")), "{report:?}");
    let mut f = File::skinned();
    let weights = f.fours(5126, WEIGHTS.map(|[a, b]| [3.0 * a, 3.0 * b, 0.0, 0.0]));
    f.attribute("WEIGHTS_0", weights);
    let (scene, report) = f.read();
    assert!(scene.corners(0).into_iter().zip(POSED).all(|(found, posed)| found.distance(posed) < 1e-5));
    assert_eq!((lines(&report, "do not add up to 1").len(), report.notes.len()), (1, 1), "{report:?}");
}

#[test]
fn a_file_without_scenes_shows_its_whole_tree() {
    let mut f = File::new();
    f.json.as_object_mut().unwrap().remove("scenes");
    f.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(f.read().0.corners(0), scene().corners(0));
}
