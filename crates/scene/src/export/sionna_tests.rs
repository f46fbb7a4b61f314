use super::*;
use crate::config::from_toml;
use crate::model::{Material, Object, Scattering, ScatteringPattern, Triangle};

/// A square of two objects and two materials whose vertices are not shared: every triangle brings its own three.
fn scene() -> Scene {
    let material = |name: &str, permittivity, pattern| Material {
        name: name.into(),
        light: Default::default(),
        radio: Some(RadioMaterial {
            id: name.to_lowercase(),
            permittivity,
            thickness_m: 0.008,
            scattering: Scattering { coefficient: 0.1, xpd: 0.25, pattern },
        }),
    };
    let corners = [[0.0, 0.0, 0.1], [1.0, 0.0, 0.1], [1.0, 1.0, 0.1], [-0.0, 0.0, 0.1], [1.0, 1.0, 0.1], [0.0, 1.0, 0.1]];
    let positions: Vec<Vec3> = corners.iter().chain(&corners).map(|p| Vec3::from_array(*p)).collect();
    let triangle =
        |first: u32, material: u32, object: u32| Triangle { vertices: [first, first + 1, first + 2], material, object };
    Scene {
        name: "square".into(),
        objects: vec![Object { name: "Pane <left> & right".into() }, Object { name: "Sheet".into() }],
        materials: vec![
            material("Window glass", Permittivity::Itu("glass".into()), ScatteringPattern::Directive { alpha_r: 10 }),
            material(
                "itu_wall",
                Permittivity::Constant { relative_permittivity: 2.5, conductivity_s_per_m: 0.125 },
                ScatteringPattern::Lambertian,
            ),
        ],
        normals: vec![Vec3::Z; positions.len()],
        uvs: vec![[0.0; 2]; positions.len()],
        positions,
        triangles: vec![triangle(0, 0, 0), triangle(3, 0, 0), triangle(6, 1, 1), triangle(9, 0, 1)],
        ..Scene::default()
    }
}

fn config() -> SceneConfig {
    let text = "[scene]\nfile = 'x.glb'\n[transmitter]\nposition_m = [1.5, 2.5, 2.0]\norientation = { yaw_deg = 180, pitch_deg = 30 }\n\
                pattern = 'dipole'\npolarization = 'cross'\n[trajectory]\nwaypoints_m = [[0, 0], [4, 0], [4, 3]]\n";
    from_toml(text, "t.toml").unwrap()
}

/// Reads binary PLY as its header describes it: positions and triangles.
fn read_ply(path: &Path) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let bytes = io::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"), "{header}");
    let count = |what: &str| -> usize {
        let line = header.lines().find(|l| l.starts_with(&format!("element {what} "))).unwrap();
        line.rsplit(' ').next().unwrap().parse().unwrap()
    };
    let (vertices, faces) = (count("vertex"), count("face"));
    let word = |at: usize| <[u8; 4]>::try_from(&bytes[at..at + 4]).unwrap();
    let positions = (0..vertices).map(|i| [0, 4, 8].map(|o| f32::from_le_bytes(word(end + 12 * i + o)))).collect();
    let first = end + 12 * vertices;
    let triangles = (0..faces)
        .map(|i| {
            assert_eq!(bytes[first + 13 * i], 3);
            [1, 5, 9].map(|o| u32::from_le_bytes(word(first + 13 * i + o)))
        })
        .collect();
    assert_eq!(bytes.len(), first + 13 * faces);
    (positions, triangles)
}

/// The value of an attribute in an XML line.
fn attribute<'a>(line: &'a str, name: &str) -> Option<&'a str> {
    line.split_once(&format!(" {name}=\""))?.1.split_once('"').map(|(value, _)| value)
}

#[test]
fn geometry_comes_back_corner_by_corner() {
    let (scene, folder) = (scene(), tempfile::tempdir().unwrap());
    let summary = write(&scene, &config(), 0, folder.path()).unwrap();
    assert_eq!((summary.shapes, summary.triangles), (3, 4));
    let file: RadioFile = serde_json::from_slice(&io::read(folder.path().join("radio.json")).unwrap()).unwrap();
    let mut corners: Vec<[[f32; 3]; 3]> = Vec::new();
    for shape in &file.shapes {
        let (positions, triangles) = read_ply(&folder.path().join(&shape.file));
        assert_eq!(triangles.len(), shape.triangles);
        corners.extend(triangles.iter().map(|t| t.map(|v| positions[v as usize])));
    }
    let ours: Vec<[[f32; 3]; 3]> = [0, 1, 3, 2].map(|i| scene.corners(i).map(|c| c.to_array())).to_vec();
    assert_eq!(corners, ours, "triangles keep their corners and their order within an object and material");
    // The pane's two triangles have four corners between them, one of which is written with a negative zero.
    assert_eq!(read_ply(&folder.path().join(&file.shapes[0].file)).0.len(), 4);
}

#[test]
fn the_xml_says_what_the_scene_says() {
    let folder = tempfile::tempdir().unwrap();
    write(&scene(), &config(), 3, folder.path()).unwrap();
    let xml = io::read_text(folder.path().join("scene.xml")).unwrap();
    let file: RadioFile = serde_json::from_slice(&io::read(folder.path().join("radio.json")).unwrap()).unwrap();
    let ids: Vec<&str> =
        xml.lines().filter(|l| l.contains("<bsdf type=\"radio-material\"")).filter_map(|l| attribute(l, "id")).collect();
    assert_eq!(ids, file.materials.keys().map(String::as_str).collect::<Vec<_>>());
    assert!(ids.iter().all(|id| id.starts_with("m_")), "an id that starts with itu_ would be replaced: {ids:?}");
    let values: Vec<(&str, f64)> = xml
        .lines()
        .filter(|l| l.trim_start().starts_with("<float"))
        .filter_map(|l| Some((attribute(l, "name")?, attribute(l, "value")?.parse().ok()?)))
        .collect();
    let (relative, conductivity) = itu::properties("glass", 60e9).unwrap();
    let glass = [
        ("relative_permittivity", relative),
        ("conductivity", conductivity),
        ("thickness", 0.008),
        ("scattering_coefficient", 0.1),
        ("xpd_coefficient", 0.25),
    ];
    assert_eq!(values[..5], glass);
    assert_eq!(values[5..7], [("relative_permittivity", 2.5), ("conductivity", 0.125)]);
    for shape in &file.shapes {
        assert!(xml.contains(&format!("id=\"{}\"", shape.id)) && xml.contains(&format!("value=\"{}\"", shape.file)));
        assert!(xml.contains(&format!("<ref id=\"{}\" name=\"bsdf\"/>", shape.material)));
        assert!(folder.path().join(&shape.file).is_file());
    }
    assert_eq!(file.shapes[0].object, "Pane <left> & right");
    assert!(!xml.contains('&'), "names reach the XML as plain ids");
    assert_eq!((file.transmitter.pattern.as_str(), file.transmitter.polarization.as_str()), ("dipole", "cross"));
    let [yaw, pitch, roll] = file.transmitter.orientation_rad.unwrap();
    assert_eq!((yaw, pitch, roll), (std::f64::consts::PI, 30f64.to_radians(), 0.0));
    let lobe = &file.materials[ids[0]];
    assert_eq!((lobe.scattering_pattern, lobe.alpha_r), (PatternName::Directive, Some(10)));
    assert_eq!(file.poses.len(), 3);
    for pose in &file.poses {
        // Boresight along the camera's axis, and the array upright: the way is level.
        assert!((pose.world_from_array[2][2] - 1.0).abs() < 1e-12 && pose.world_from_array[2][0].abs() < 1e-12);
    }
}

#[test]
fn the_same_scene_gives_the_same_bytes() {
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    for folder in [&one, &two] {
        write(&scene(), &config(), 5, folder.path()).unwrap();
    }
    let file: RadioFile = serde_json::from_slice(&io::read(one.path().join("radio.json")).unwrap()).unwrap();
    for name in file.shapes.iter().map(|s| s.file.as_str()).chain(["scene.xml", "radio.json"]) {
        assert_eq!(io::read(one.path().join(name)).unwrap(), io::read(two.path().join(name)).unwrap(), "{name}");
    }
}

#[test]
fn what_cannot_be_traced_is_not_exported() {
    let folder = tempfile::tempdir().unwrap();
    let mut bare = scene();
    bare.materials[1].radio = None;
    let message = write(&bare, &config(), 0, folder.path()).unwrap_err().to_string();
    assert!(message.contains("itu_wall"), "{message}");
    let mut parked = config();
    parked.trajectory = None;
    assert!(write(&scene(), &parked, 5, folder.path()).unwrap_err().to_string().contains("[trajectory]"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing half-written");
}
