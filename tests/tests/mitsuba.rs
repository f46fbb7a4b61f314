//! Scenes exported for Mitsuba 3: what a reader of XML, PLY and PNG finds in the folder.

use crate::common::{corf_ok, corf_refuses, root, text, tiny_config};
use corf_scene::config::SceneConfig;
use corf_scene::trajectory;
use glam::{DMat3, DVec3};
use roxmltree::{Document, Node};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Poses are printed with all their digits.
const POSE_ROUNDING: f64 = 1e-12;

/// A PLY by its own header: vertices by property name, and triangles.
struct Ply {
    vertices: Vec<BTreeMap<String, f32>>,
    triangles: Vec<[u32; 3]>,
}

fn read_ply(path: &Path) -> Ply {
    let bytes = fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let mut lines = header.lines();
    assert_eq!(lines.next(), Some("ply"));
    assert_eq!(lines.next(), Some("format binary_little_endian 1.0"));
    let (mut counts, mut names) = (BTreeMap::new(), Vec::new());
    for line in lines {
        match line.split(' ').collect::<Vec<_>>()[..] {
            ["element", element, count] => drop(counts.insert(element.to_string(), count.parse::<usize>().unwrap())),
            ["property", "float", name] => names.push(name.to_string()),
            ["property", "list", "uchar", "int", "vertex_indices"] | ["end_header"] => {}
            _ => panic!("{line}"),
        }
    }
    let (vertices, faces) = bytes[end..].split_at(counts["vertex"] * names.len() * 4);
    assert_eq!(faces.len(), counts["face"] * 13, "{}", path.display());
    let number = |b: &[u8]| <[u8; 4]>::try_from(b).unwrap();
    let vertex = |row: &[u8]| names.iter().cloned().zip(row.chunks_exact(4).map(|b| f32::from_le_bytes(number(b)))).collect();
    let triangle = |face: &[u8]| {
        assert_eq!(face[0], 3);
        [1, 5, 9].map(|at| u32::from_le_bytes(number(&face[at..at + 4])))
    };
    Ply {
        vertices: vertices.chunks_exact(4 * names.len()).map(vertex).collect(),
        triangles: faces.chunks_exact(13).map(triangle).collect(),
    }
}

/// The property `name` of an element: its value, or the element itself where it has content.
fn property<'a, 'd>(of: Node<'a, 'd>, name: &str) -> Option<Node<'a, 'd>> {
    of.children().find(|n| n.attribute("name") == Some(name))
}

fn value<'a>(of: Node<'a, '_>, name: &str) -> &'a str {
    property(of, name).unwrap_or_else(|| panic!("no {name}")).attribute("value").unwrap()
}

fn elements<'a, 'd>(of: Node<'a, 'd>, tag: &'a str) -> impl Iterator<Item = Node<'a, 'd>> {
    of.descendants().filter(move |n| n.has_tag_name(tag))
}

fn of_type<'a, 'd>(of: Node<'a, 'd>, tag: &'a str, kind: &'a str) -> impl Iterator<Item = Node<'a, 'd>> {
    elements(of, tag).filter(move |n| n.attribute("type") == Some(kind))
}

#[test]
fn the_lobby_is_exported_whole_with_its_views() {
    let folder = tempfile::tempdir().unwrap();
    let (config, out) = (tiny_config(folder.path(), 4), folder.path().join("out"));
    let said = corf_ok(&[
        "--json",
        "scene",
        "export",
        "scenes/lobby.toml",
        "--to",
        "mitsuba",
        "--out",
        text(&out),
        "--poses",
        text(&config),
        "--fov",
        "70",
    ]);
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    let xml = fs::read_to_string(out.join("scene.xml")).unwrap();
    let document = Document::parse(&xml).unwrap();
    let scene = document.root_element();

    // Every id once, every reference to one; every file that is named is there, and no other.
    let ids: Vec<&str> = scene.descendants().filter_map(|n| n.attribute("id")).filter(|id| !id.is_empty()).collect();
    let defined: BTreeSet<&str> =
        scene.descendants().filter(|n| !n.has_tag_name("ref")).filter_map(|n| n.attribute("id")).collect();
    assert!(elements(scene, "ref").all(|n| defined.contains(n.attribute("id").unwrap())));
    assert_eq!(ids.len() - elements(scene, "ref").count(), defined.len());
    let named: BTreeSet<&str> = elements(scene, "string")
        .filter(|n| n.attribute("name") == Some("filename"))
        .filter_map(|n| n.attribute("value"))
        .collect();
    let there = |sub: &'static str| {
        fs::read_dir(out.join(sub)).unwrap().map(move |e| format!("{sub}/{}", e.unwrap().file_name().to_str().unwrap()))
    };
    assert_eq!(there("meshes").chain(there("textures")).collect::<BTreeSet<_>>(), named.iter().map(|n| n.to_string()).collect());

    // Geometry: all triangles, unit normals on the side the corners say.
    let mut triangles = 0;
    for shape in elements(scene, "shape") {
        let ply = read_ply(&out.join(value(shape, "filename")));
        triangles += ply.triangles.len();
        for triangle in &ply.triangles {
            let [a, b, c] = triangle.map(|i| &ply.vertices[i as usize]);
            let place = |v: &BTreeMap<String, f32>| DVec3::new(v["x"].into(), v["y"].into(), v["z"].into());
            let facing = (place(b) - place(a)).cross(place(c) - place(a));
            for v in [a, b, c] {
                let normal = DVec3::new(v["nx"].into(), v["ny"].into(), v["nz"].into());
                assert!(
                    (normal.length() - 1.0).abs() < 1e-3 && normal.dot(facing) >= -1e-6 * facing.length(),
                    "{}",
                    value(shape, "filename")
                );
                assert!(v["u"].is_finite() && v["v"].is_finite());
            }
        }
    }
    // Those of the shades that shine on both sides are there twice.
    let info: serde_json::Value = serde_json::from_str(&corf_ok(&["scene", "info", "scenes/lobby.toml", "--json"])).unwrap();
    let in_scene = info["scene"]["triangles"].as_u64().unwrap() as usize;
    assert!(triangles > in_scene && triangles < in_scene + in_scene / 20, "{triangles} of {in_scene}");
    assert_eq!(said["shapes"].as_u64().unwrap() as usize, elements(scene, "shape").count());

    // Materials: the window is a pane, the floor has its normal map, lamps have radiance, nothing is told twice.
    let bsdf = |id: &str| elements(scene, "bsdf").find(|n| n.attribute("id").is_some_and(|i| i.ends_with(id))).unwrap();
    assert_eq!(bsdf("Window_glass").attribute("type"), Some("thindielectric"));
    assert_eq!(value(bsdf("Window_glass"), "specular_transmittance"), "0.95 0.98 0.97");
    let floor = of_type(bsdf("Floor_tiles"), "bsdf", "normalmap").next().unwrap();
    let map = property(floor, "normalmap").unwrap();
    assert_eq!(value(map, "raw"), "true");
    let brass = of_type(bsdf("Brass"), "bsdf", "principled").next().unwrap();
    assert_eq!((value(brass, "metallic"), value(brass, "roughness")), ("1", "0.24"));
    assert_eq!(of_type(scene, "emitter", "area").count(), said["emitters"].as_u64().unwrap() as usize);
    let png = image::open(out.join(value(map, "filename"))).unwrap();
    assert!(png.width() > 1 && png.height() > 1);

    // Views: size, field of view, and the trajectory's poses back again.
    let way = SceneConfig::load(root().join("scenes/lobby.toml")).unwrap().trajectory.unwrap();
    let poses = trajectory::generate(&way, 4).unwrap();
    let sensors: Vec<Node<'_, '_>> = of_type(scene, "sensor", "perspective").collect();
    assert_eq!(sensors.len(), poses.len());
    for (sensor, pose) in sensors.iter().zip(poses) {
        let world_from_camera = pose.world_from_camera.to_rows();
        let film = of_type(*sensor, "film", "hdrfilm").next().unwrap();
        assert_eq!((value(film, "width"), value(film, "height"), value(*sensor, "fov_axis")), ("96", "54", "x"));
        assert!((value(*sensor, "fov").parse::<f64>().unwrap() - 70.0).abs() < 1e-9);
        let matrix = elements(*sensor, "matrix").next().unwrap().attribute("value").unwrap();
        let m: Vec<f64> = matrix.split(' ').map(|w| w.parse().unwrap()).collect();
        for row in 0..4 {
            for (column, turned) in [-1.0, -1.0, 1.0, 1.0].into_iter().enumerate() {
                let ours = world_from_camera[row][column];
                assert!((m[4 * row + column] * turned - ours).abs() < POSE_ROUNDING, "row {row}, column {column}");
            }
        }
        // x left, y up, z forward is right-handed as well: no mirror image.
        let rotation = DMat3::from_cols_array(&[m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]]);
        assert!((rotation.determinant() - 1.0).abs() < 1e-9);
    }
}

/// A floor with a picture and holes, a pane, and a lamp.
fn small_scene(folder: &Path) -> std::path::PathBuf {
    let picture =
        image::RgbaImage::from_fn(4, 2, |x, y| image::Rgba([60 * x as u8, 100 * y as u8, 7, if x < 2 { 255 } else { 0 }]));
    picture.save(folder.join("leaf.png")).unwrap();
    let obj = "mtllib s.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
        o floor\nusemtl leaf\nv 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nf 1/1 2/2 3/3 4/4\n\
        o lamp\nusemtl lamp\nv 0 0 2\nv 0 2 2\nv 2 2 2\nv 2 0 2\nf 5 6 7 8\n";
    fs::write(folder.join("s.obj"), obj).unwrap();
    fs::write(
        folder.join("s.mtl"),
        "newmtl leaf\nKd 1 1 1\nmap_Kd leaf.png\nmap_d -imfchan m leaf.png\nnewmtl lamp\nKd 0.5 0.5 0.5\nKe 3 2 1\n",
    )
    .unwrap();
    folder.join("s.obj")
}

#[test]
fn a_mesh_alone_is_exported_and_again_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let scene = small_scene(folder.path());
    let poses = folder.path().join("poses.json");
    fs::write(&poses, "[[[1,0,0,1],[0,-1,0,1],[0,0,-1,1.8],[0,0,0,1]]]").unwrap();
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    for out in [&a, &b] {
        corf_ok(&[
            "scene",
            "export",
            text(&scene),
            "--to",
            "mitsuba",
            "--out",
            text(out),
            "--poses",
            text(&poses),
            "--width",
            "40",
            "--height",
            "30",
            "--fov",
            "60",
        ]);
    }
    let mut files: Vec<_> =
        ["meshes", "textures"].iter().flat_map(|d| fs::read_dir(a.join(d)).unwrap().map(|e| e.unwrap().path())).collect();
    files.push(a.join("scene.xml"));
    for file in &files {
        assert!(fs::read(file).unwrap() == fs::read(b.join(file.strip_prefix(&a).unwrap())).unwrap(), "{}", file.display());
    }
    let xml = fs::read_to_string(a.join("scene.xml")).unwrap();
    let document = Document::parse(&xml).unwrap();
    let scene = document.root_element();
    let lamp = of_type(scene, "emitter", "area").next().unwrap();
    assert_eq!(value(lamp, "radiance"), "3 2 1");
    let sensor = of_type(scene, "sensor", "perspective").next().unwrap();
    assert!((value(sensor, "fov").parse::<f64>().unwrap() - 60.0).abs() < 1e-9);
    // Without poses there is no camera.
    let bare = folder.path().join("bare");
    corf_ok(&["scene", "export", "scenes/lobby.glb", "--to", "mitsuba", "--out", text(&bare)]);
    assert!(!fs::read_to_string(bare.join("scene.xml")).unwrap().contains("<sensor"));
}

#[test]
fn what_cannot_be_exported_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let scene = small_scene(folder.path());
    let out = folder.path().join("out");
    let refuses = |more: &[&str], words: &[&str]| {
        let call = [&["scene", "export", text(&scene), "--to", "mitsuba", "--out", text(&out)], more].concat();
        corf_refuses(&call, words);
        assert!(!out.exists(), "nothing half-written: {more:?}");
    };
    refuses(&["--poses", "3"], &["trajectory", "help"]);
    refuses(&["--poses", "nowhere.toml"], &["nowhere.toml"]);
    let wrong = folder.path().join("wrong.json");
    fs::write(&wrong, "[[[1,0,0,1],[0,2,0,1],[0,0,1,1],[0,0,0,1]]]").unwrap();
    refuses(&["--poses", text(&wrong)], &["pose 0"]);
    let sound = folder.path().join("sound.json");
    fs::write(&sound, "[[[1,0,0,1],[0,1,0,1],[0,0,1,1],[0,0,0,1]]]").unwrap();
    refuses(&["--poses", text(&sound), "--fov", "180"], &["180", "help"]);
    refuses(&["--poses", text(&sound), "--width", "0"], &["0x900", "help"]);
    let occupied = folder.path().join("occupied");
    fs::create_dir(&occupied).unwrap();
    fs::write(occupied.join("precious"), "x").unwrap();
    corf_refuses(&["scene", "export", text(&scene), "--to", "mitsuba", "--out", text(&occupied)], &["not empty", "--out"]);
    assert_eq!(fs::read_dir(&occupied).unwrap().count(), 1);
    let lobby = root().join("scenes/lobby.toml");
    corf_refuses(&["scene", "export", text(&lobby), "--to", "sionna", "--out", text(&out), "--fov", "60"], &["--fov", "help"]);
    corf_refuses(&["scene", "export", text(&lobby), "--to", "sionna", "--out", text(&out), "--poses", "x.json"], &["x.json"]);
    assert!(!out.exists());
}
