use super::*;
use crate::Raster;
use crate::model::{AlphaMode, Filter, LightMaterial, Material, Object, Texture, TextureRef, Triangle, Wrap};
use glam::{Affine2, DVec3, Vec2, Vec3};

/// A square of one material; its front is up.
fn square(light: LightMaterial, textures: Vec<Texture>) -> Scene {
    let positions = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.5)).to_vec();
    Scene {
        name: "square".into(),
        objects: vec![Object { name: "a <square> & more".into() }],
        materials: vec![Material { name: "paint \"x\"".into(), light, radio: None }],
        textures,
        normals: vec![Vec3::Z; 4],
        uvs: positions.iter().map(|p: &Vec3| [p.x, 1.0 - p.y]).collect(),
        positions,
        triangles: [[0, 1, 2], [0, 2, 3]].map(|vertices| Triangle { vertices, material: 0, object: 0 }).to_vec(),
        ..Scene::default()
    }
}

fn texture(alpha: [u8; 2]) -> Texture {
    let texels = Raster::from_fn(2, 1, |x, _| [200, 100, 50, alpha[x]]);
    Texture { name: "two/texels".into(), texels, wrap: [Wrap::Repeat; 2], filter: Filter::Linear }
}

fn reference() -> Option<TextureRef> {
    Some(TextureRef { texture: 0, uv_from_uv: Affine2::IDENTITY })
}

fn exported(scene: &Scene) -> (tempfile::TempDir, MitsubaSummary, String) {
    let folder = tempfile::tempdir().unwrap();
    let summary = write(scene, None, folder.path()).unwrap();
    let xml = std::fs::read_to_string(folder.path().join("scene.xml")).unwrap();
    (folder, summary, xml)
}

/// The vertices of an exported PLY: numbers of 4 bytes behind the header, `columns` of them each.
fn vertices(folder: &Path, index: usize, columns: usize) -> Vec<Vec<f32>> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder.join("meshes")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    let bytes = std::fs::read(&files[index]).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let count: usize = header.split("element vertex ").nth(1).unwrap().lines().next().unwrap().parse().unwrap();
    assert_eq!(header.matches("property float").count(), columns, "{header}");
    let values: Vec<f32> = bytes[end..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    values.chunks_exact(columns).take(count).map(<[f32]>::to_vec).collect()
}

#[test]
fn what_emits_on_both_sides_is_two_sheets_that_look_away_from_each_other() {
    let lamp = |double_sided| LightMaterial { emissive: [2.0, 1.0, 0.5], double_sided, ..LightMaterial::default() };
    let (folder, summary, xml) = exported(&square(lamp(false), vec![]));
    assert_eq!((summary.shapes, summary.emitters, xml.matches("type=\"area\"").count()), (1, 1, 1));
    assert!(vertices(folder.path(), 0, 8).iter().all(|v| v[2] == 0.5));
    let (folder, summary, _) = exported(&square(lamp(true), vec![]));
    assert_eq!((summary.shapes, summary.emitters), (2, 2));
    for (index, side) in [(0, 1.0), (1, -1.0)] {
        for v in vertices(folder.path(), index, 8) {
            assert!((v[2] - 0.5) * side > 0.0 && (v[2] - 0.5).abs() < 1e-3 && v[5] == side, "{v:?}");
        }
    }
}

#[test]
fn an_emitter_meets_every_place_of_its_texture_once() {
    let mut scene = square(
        LightMaterial { emissive: [4.0; 3], emissive_texture: reference(), double_sided: false, ..LightMaterial::default() },
        vec![texture([255; 2])],
    );
    let (_, summary, xml) = exported(&scene);
    assert_eq!(summary.shapes, 1, "two halves of one picture share no place");
    assert!(xml.contains(".exr") && summary.approximated.is_empty(), "{:?}", summary.approximated);
    // A second square with the same picture, one repetition further.
    for k in 0..4 {
        scene.positions.push(scene.positions[k] + Vec3::new(3.0, 0.0, 0.0));
        scene.normals.push(Vec3::Z);
        scene.uvs.push([scene.uvs[k][0] + 1.0, scene.uvs[k][1]]);
    }
    scene.triangles.extend([[4, 5, 6], [4, 6, 7]].map(|vertices| Triangle { vertices, material: 0, object: 0 }));
    let (folder, summary, _) = exported(&scene);
    assert_eq!(summary.shapes, 2);
    for index in 0..2 {
        assert!(vertices(folder.path(), index, 8).iter().all(|v| (0.0..=1.0).contains(&v[6]) && (0.0..=1.0).contains(&v[7])));
    }
    // Seen one and a half times on one triangle: said, not hidden.
    scene.uvs.iter_mut().for_each(|uv| uv[0] *= 1.5);
    assert!(!exported(&scene).1.approximated.is_empty());
}

#[test]
fn factors_are_in_the_textures_and_what_has_none_keeps_its_bytes() {
    let paint = |base_color| LightMaterial { base_color, base_color_texture: reference(), ..LightMaterial::default() };
    for (factor, deep) in [([1.0; 3], false), ([0.5, 0.5, 0.25], true)] {
        let (folder, summary, _) = exported(&square(paint(factor), vec![texture([255; 2])]));
        assert_eq!(summary.textures, 1);
        let file = std::fs::read_dir(folder.path().join("textures")).unwrap().next().unwrap().unwrap().path();
        let image = image::open(file).unwrap();
        if deep {
            let pixel = image.to_rgb16().get_pixel(0, 0).0.map(|v| f32::from(v) / 65535.0);
            for (c, byte) in [200.0f32, 100.0, 50.0].into_iter().enumerate() {
                let expected = crate::color::linear_from_srgb(byte / 255.0) * factor[c];
                assert!((crate::color::linear_from_srgb(pixel[c]) - expected).abs() < 1e-5, "{c}");
            }
        } else {
            assert_eq!(image.as_rgb8().unwrap().get_pixel(0, 0).0, [200, 100, 50]);
        }
    }
}

#[test]
fn alpha_is_a_mask_where_it_means_something() {
    let leaf =
        |alpha_mode, alpha| LightMaterial { alpha_mode, alpha, base_color_texture: reference(), ..LightMaterial::default() };
    let xml = |light, alpha| exported(&square(light, vec![texture(alpha)])).2;
    assert!(!xml(leaf(AlphaMode::Opaque, 0.3), [0, 255]).contains("\"mask\""));
    assert!(xml(leaf(AlphaMode::Blend, 0.25), [255; 2]).contains("<float name=\"opacity\" value=\"0.25\"/>"));
    let (folder, _, xml) = exported(&square(leaf(AlphaMode::Mask { cutoff: 0.5 }, 1.0), vec![texture([0, 255])]));
    assert!(xml.contains("\"mask\"") && xml.contains("nearest") && xml.contains("volpath"));
    let opacity = std::fs::read_dir(folder.path().join("textures"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .find(|p| p.to_string_lossy().contains("opacity"))
        .unwrap();
    let image = image::open(opacity).unwrap().to_luma8();
    let row: Vec<u8> = (0..image.width()).map(|x| image.get_pixel(x, 0).0[0]).collect();
    // Centres at ¼ and ¾ of the (repeating) image: between them alpha crosses a half at ½, and at 0 = 1.
    assert_eq!(row, [0, 0, 0, 0, 255, 255, 255, 255]);
}

#[test]
fn vertex_colours_go_with_the_base_colour() {
    let mut scene = square(LightMaterial { base_color: [0.5, 0.5, 1.0], ..LightMaterial::default() }, vec![]);
    scene.colors = vec![[0.25, 1.0, 0.5, 1.0]; 4];
    let (folder, _, xml) = exported(&scene);
    assert!(xml.contains("mesh_attribute") && xml.contains("vertex_color"));
    assert!(vertices(folder.path(), 0, 11).iter().all(|v| v[8..] == [0.125, 0.5, 0.5]));
}

#[test]
fn normals_are_on_the_side_the_corners_say() {
    let mut scene = square(LightMaterial::default(), vec![]);
    scene.normals = vec![-Vec3::Z; 4];
    let (folder, ..) = exported(&scene);
    assert!(vertices(folder.path(), 0, 8).iter().all(|v| v[5] == 1.0));
}

#[test]
fn a_camera_sees_right_and_down_where_it_did() {
    let eye = DVec3::new(1.0, 2.0, 1.6);
    let pose = Rigid3::looking_at(eye, eye + DVec3::new(0.3, 1.0, -0.2), DVec3::Z);
    let views = Views { camera: Pinhole::from_horizontal_fov(64, 36, 70.0), poses: vec![pose] };
    let folder = tempfile::tempdir().unwrap();
    write(&square(LightMaterial::default(), vec![]), Some(&views), folder.path()).unwrap();
    let xml = std::fs::read_to_string(folder.path().join("scene.xml")).unwrap();
    let words = xml.split("<matrix value=\"").nth(1).unwrap().split('"').next().unwrap();
    let m: Vec<f64> = words.split(' ').map(|w| w.parse().unwrap()).collect();
    // What lies to the right of, below and before our camera is at −x, −y, +z of Mitsuba's.
    let seen = pose.transform_point(DVec3::new(0.7, 0.4, 3.0));
    let mitsuba = |p: DVec3| DVec3::from_array(std::array::from_fn(|c| m[c] * p.x + m[4 + c] * p.y + m[8 + c] * p.z));
    let local = mitsuba(seen - DVec3::new(m[3], m[7], m[11]));
    assert!((local - DVec3::new(-0.7, -0.4, 3.0)).length() < 1e-12, "{local}");
    let wrong = Views { camera: Pinhole { fy: 30.0, ..views.camera }, ..views };
    assert!(write(&square(LightMaterial::default(), vec![]), Some(&wrong), folder.path()).is_err());
}

#[test]
fn other_textures_of_an_emitter_look_through_the_emissions_transform() {
    let scene = {
        let emission = TextureRef { texture: 0, uv_from_uv: Affine2::from_scale(Vec2::splat(0.5)) };
        let light = LightMaterial {
            emissive: [1.0; 3],
            emissive_texture: Some(emission),
            base_color_texture: Some(TextureRef { texture: 0, uv_from_uv: Affine2::from_scale(Vec2::splat(2.0)) }),
            double_sided: false,
            ..LightMaterial::default()
        };
        square(light, vec![texture([255; 2])])
    };
    let (folder, _, xml) = exported(&scene);
    let largest = vertices(folder.path(), 0, 8).iter().map(|v| v[6]).fold(0.0, f32::max);
    assert_eq!(largest, 0.5, "the mesh has the emission's coordinates");
    assert!(xml.contains("4 0 0 0 0 4 0 0"), "base colour: 2 × 2 of them\n{xml}");
}
