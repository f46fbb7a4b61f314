//! OBJ and MTL files as other programs write them.

use super::{ImportOptions, ImportReport, load_with_report, load_with_up};
use crate::config::UpAxis;
use crate::model::{AlphaMode, Wrap};
use crate::{Raster, Scene, io};
use glam::{Vec2, Vec3};
use std::path::Path;

const SQUARE: &str = "v 0 0 0\nv 2 0 0\nv 2 3 0\nv 0 3 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3 4/4\n";

fn read(folder: &Path, obj: impl AsRef<[u8]>, mtl: impl AsRef<[u8]>) -> Result<(Scene, ImportReport), String> {
    std::fs::write(folder.join("room.mtl"), mtl).unwrap();
    let path = folder.join("room.obj");
    std::fs::write(&path, obj).unwrap();
    load_with_report(&path, &ImportOptions::default()).map_err(|e| e.to_string())
}

/// A scene of files that must be read, and everything its import has to say.
fn scene(obj: impl AsRef<[u8]>, mtl: impl AsRef<[u8]>) -> (Scene, String) {
    let dir = tempfile::tempdir().unwrap();
    let (scene, report) = read(dir.path(), obj, mtl).unwrap();
    (scene, [report.notes, report.unread].concat().join("\n"))
}

/// Files that must be refused with these words.
fn refused(obj: impl AsRef<[u8]>, mtl: impl AsRef<[u8]>, words: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    let message = read(dir.path(), obj, mtl).map(|_| ()).unwrap_err();
    assert!(words.iter().all(|w| message.contains(w)), "{words:?}: {message}");
}

fn square(head: &str) -> String {
    format!("mtllib room.mtl\n{head}{SQUARE}")
}

#[test]
fn an_offset_is_taken_off_vertices_in_doubles() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("room.obj");
    let face = "vn 0 0 1\nf 1//1 2//1 3//1\n";
    // Not numbers of single precision, whose steps are 1/32 m there; one with a weight, one with a colour.
    let vertices =
        "v 446520.0078125 85230.00390625 12.5\nv 893044.015625 170460.0078125 25 2\nv 446520.0078125 85233.00390625 12.5 1 0 0\n";
    std::fs::write(&path, format!("{vertices}{face}")).unwrap();
    let read = |up, offset_m| {
        load_with_report(&path, &ImportOptions { up, offset_m: Some(offset_m), ..ImportOptions::default() }).unwrap()
    };
    let offset = [446_520.007_812_5, 85_230.003_906_25, 12.5];
    let (scene, report) = read(None, offset);
    assert_eq!(scene.corners(0), [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 3.0, 0.0)]);
    assert_eq!(scene.colors[2], [1.0, 0.0, 0.0, 1.0]);
    assert!(report.notes.is_empty(), "{report:?}");
    // World (x, -z, y) where y is up.
    let (scene, _) = read(Some(UpAxis::Y), [offset[0], -offset[2], offset[1]]);
    assert_eq!(scene.corners(0), [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 0.0, 3.0)]);
}

#[test]
fn obj_with_its_materials_either_way_up() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("room.obj");
    let text = square("o floor\n");
    let (s, _) = read(dir.path(), &text, "newmtl red\nKd 0.8 0.1 0.2\nKe 1 2 3\nNs 98\nNi 1.4\nd 0.25\n").unwrap();
    assert_eq!((s.triangles.len(), s.objects[0].name.as_str()), (2, "floor"));
    assert_eq!(s.bounds().unwrap().max, Vec3::new(2.0, 3.0, 0.0));
    assert!(s.normals.iter().all(|n| (*n - Vec3::Z).length() < 1e-6));
    assert_eq!((s.uvs[0], s.colors.len()), ([0.0, 1.0], 0));
    let m = &s.materials[0].light;
    assert_eq!((m.base_color, m.emissive, m.transmission, m.ior), ([0.8, 0.1, 0.2], [1.0, 2.0, 3.0], 0.0, 1.4));
    assert_eq!((m.alpha, m.alpha_mode), (0.25, AlphaMode::Blend));
    // Ns 98: α² = 0.02, roughness = 0.02^{1/4}.
    assert!((m.roughness - 0.02_f32.powf(0.25)).abs() < 1e-6);
    let s = load_with_up(&path, Some(UpAxis::Y)).unwrap();
    assert_eq!(s.bounds().unwrap().max, Vec3::new(2.0, 0.0, 3.0));
    assert!(load_with_up(dir.path().join("room.fbx"), None).is_err());
}

#[test]
fn what_cannot_be_read_is_named_with_its_line() {
    let text = square("");
    refused(text.replace("v 2 0 0", "v nan 0 0"), "", &["room.obj:3", "`nan`"]);
    refused(text.replace("v 2 0 0", "v 2 0"), "", &["room.obj:3", "a vertex of 2 numbers"]);
    refused(text.replace("v 2 0 0", "v 2 0 0 0"), "", &["room.obj:3", "weight"]);
    refused(text.replace("vt 1 0", "vt"), "", &["room.obj:7", "a texture coordinate of 0"]);
    refused(text.replace("4/4", "9/4"), "", &["room.obj:11", "vertex 9, and there are 4"]);
    refused(text.replace("4/4", "4/9"), "", &["room.obj:11", "texture coordinate 9, and there are 4"]);
    refused(text.replace("4/4", "0/4"), "", &["room.obj:11", "vertex 0, which is no index"]);
    refused(text.replace("4/4", "-5/4"), "", &["room.obj:11", "vertex -5, and there are 4 so far"]);
    refused(text.replace("4/4", "99999999999999999999/4"), "", &["room.obj:11", "no index"]);
    refused(text.replace("4/4", "4294967296/4"), "", &["room.obj:11", "there are 4"]);
    refused(text.replace("4/4", "4/4/4/4"), "", &["room.obj:11", "no corner"]);
    refused(text.replace("4/4", "/4"), "", &["room.obj:11", "no corner"]);
    refused(text.replace("f 1/1 2/2 3/3 4/4", "f 1/1 3/3 2/2 4/4"), "", &["room.obj:11", "crosses itself"]);
    refused("v 0 0 0\nv 1 0 0\nl 1 2\np 1\n", "", &["no triangle"]);
    for (mtl, words) in [
        ("newmtl red\nKd .1 .2", ["room.mtl:2", "`Kd` with 2 numbers"]),
        ("newmtl red\nKd", ["room.mtl:2", "`Kd` with 0 numbers"]),
        ("newmtl red\n\nKd a b c", ["room.mtl:3", "`a` is no finite number"]),
        ("newmtl red\nNs", ["room.mtl:2", "without its number"]),
        ("newmtl red\nd 1e99", ["room.mtl:2", "`1e99`"]),
        ("newmtl", ["room.mtl:1", "without a name"]),
        ("newmtl red\nillum -1", ["room.mtl:2", "illum -1"]),
        ("newmtl red\nmap_Kd -clamp on", ["room.mtl:2", "names no file"]),
        ("newmtl red\nmap_Kd gone.png", ["room.mtl:2: material \"red\"", "gone.png"]),
        ("newmtl red\nmap_Kd room.obj", ["room.mtl:2: material \"red\"", "room.obj"]),
    ] {
        refused(&text, mtl, &words);
    }
}

#[test]
fn marks_line_ends_continuations_and_comments_change_nothing() {
    let (plain, said) = scene(square(""), "newmtl red\nKd 0.8 0.1 0.2\n");
    assert_eq!(said, "");
    let obj = square("");
    let mark = |text: &str| [b"\xef\xbb\xbf".as_slice(), text.as_bytes()].concat();
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(obj.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    let latin = [b"# gr\xfcn\n".as_slice(), obj.as_bytes()].concat();
    let files: [Vec<u8>; 9] = [
        mark(&obj),
        obj.replace('\n', "\r\n").into_bytes(),
        obj.replace('\n', "\r").into_bytes(),
        obj.replace("2/2 3/3", "\\\n 2/2 \\  \n\t3/3").into_bytes(),
        obj.replace("v 2 3 0", "v 2 3 0 # far corner").replace("4/4", "4/4#last").into_bytes(),
        obj.replace("vt 0 0", "# a folder C:\\rooms\\\nvt 0 0 0").into_bytes(),
        obj.replace("1/1 2/2 3/3 4/4", "-4/-4 -3/-3 -2/-2 -1/-1").replace("usemtl ", "usemtl\t").into_bytes(),
        wide,
        latin,
    ];
    for file in files {
        let (s, said) = scene(&file, mark("newmtl red\r\nKd 0.8 \\\r\n 0.1 0.2 # dark\r\n"));
        let same = (s.positions == plain.positions, s.uvs == plain.uvs, s.triangles == plain.triangles);
        assert_eq!(same, (true, true, true), "{}", String::from_utf8_lossy(&file));
        assert_eq!((s.materials[0].light.base_color, said.as_str()), ([0.8, 0.1, 0.2], ""));
    }
}

#[test]
fn corners_with_and_without_normals_and_texture_coordinates_stand_side_by_side() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvn 0 0 -1\nvt 0.25 0.5\no a\nf 1//1 2//1 3//1\nf 2/1 4/1 3/1\nf 2 4 3/1/1\n";
    let (s, _) = scene(text, "");
    assert_eq!((s.triangles.len(), s.objects.len()), (3, 1));
    let normals = |t: usize| s.triangles[t].vertices.map(|v| s.normals[v as usize]);
    let uvs = |t: usize| s.triangles[t].vertices.map(|v| s.uvs[v as usize]);
    // What the file says stays; the others have their triangle's normal and the first texel.
    assert_eq!((normals(0), uvs(0)), ([-Vec3::Z; 3], [[0.0; 2]; 3]));
    assert_eq!((normals(1), uvs(1)), ([Vec3::Z; 3], [[0.25, 0.5]; 3]));
    assert_eq!((normals(2), uvs(2)), ([Vec3::Z, Vec3::Z, -Vec3::Z], [[0.0; 2], [0.0; 2], [0.25, 0.5]]));
    // Indices of an attribute that the file does not have at all mean nothing; vertices may stand behind their face.
    let (s, _) = scene("f 1/1/1 2/2/1 3/3/1\nv 0 0 0\nv 1 0 0\nv 0 1 0\n", "");
    assert_eq!((s.triangles.len(), s.normals[0]), (1, Vec3::Z));
}

#[test]
fn lines_points_and_short_faces_are_counted_and_curves_and_unknown_words_reported() {
    let dir = tempfile::tempdir().unwrap();
    let text = square("l 1 2\np 1\nf 1 1\nf\ns 1\nsurf 0 1 0 1 1\nsurf 0 1 0 1 2\nwobble\n");
    let (s, report) = read(dir.path(), text.replace("l 1 2", "v 0 0 1\nl 1 1"), "newmtl red\n").unwrap();
    assert_eq!((s.triangles.len(), report.skipped_primitives), (2, 4));
    let [curves, unknown] = &report.notes[..] else { panic!("{report:?}") };
    assert!(curves.contains("and 1 more") && curves.contains("curves") && report.unread.is_empty(), "{report:?}");
    assert!(unknown.contains("room.obj:10") && unknown.contains("wobble"), "{report:?}");
}

#[test]
fn materials_without_a_library_keep_their_names() {
    let text = square("").replace("room.mtl", "gone.mtl").replace("red", "concrete wall") + "usemtl\nf 1 2 3\nusemtl tile\n";
    let (s, said) = scene(&text, "");
    let names: Vec<&str> = s.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["concrete wall", "(no material)"]);
    assert_eq!(s.triangles.iter().map(|t| t.material).collect::<Vec<_>>(), [0, 0, 1]);
    assert!(said.contains("room.obj:1: mtllib: there is no gone.mtl"), "{said}");
    assert!(said.contains("room.obj:10: no library defines material \"concrete wall\""), "{said}");
    // Several libraries in one line, one of them absent; another with a space in its name and other capitals.
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("my lib.MTL"), "newmtl red\nKd 1 0 0\n").unwrap();
    for line in ["mtllib room.mtl gone.mtl\nmtllib my lib.mtl", "mtllib \"my lib.mtl\""] {
        let (s, _) = read(dir.path(), square("").replace("mtllib room.mtl", line), "newmtl other\n").unwrap();
        let red = s.materials.iter().find(|m| m.name == "red").unwrap();
        assert_eq!(red.light.base_color, [1.0, 0.0, 0.0], "{line}");
    }
    refused(square("").replace("room.mtl", "../room.mtl"), "", &["room.obj:1", "leads out"]);
}

#[test]
fn materials_say_what_they_say_in_all_their_spellings() {
    let of = |statements: &str| {
        let (s, said) = scene(square(""), format!("newmtl red\n{statements}\nnewmtl unused\nmap_Kd gone.png\n"));
        (s.materials[0].light.clone(), said)
    };
    assert_eq!(of("Kd 0.5").0.base_color, [0.5; 3]);
    assert_eq!(of("kd .1 .2 .3 1.0").0.base_color, [0.1, 0.2, 0.3]);
    assert_eq!(of("Ke 7").0.emissive, [7.0; 3]);
    let coverage = |statements: &str| {
        let (m, said) = of(statements);
        (m.alpha, m.alpha_mode, said.contains("contradict"))
    };
    assert_eq!(coverage("Tr 0.75"), (0.25, AlphaMode::Blend, false));
    assert_eq!(coverage("d 0.25\nTr 0.75"), (0.25, AlphaMode::Blend, false));
    assert_eq!(coverage("d 0.25\nTr 0.25"), (0.25, AlphaMode::Blend, true));
    assert_eq!(coverage("d -halo 0.5"), (0.5, AlphaMode::Blend, false));
    assert_eq!(coverage("d 1\nTr 0"), (1.0, AlphaMode::Opaque, false));
    assert_eq!(coverage("Tr 0"), (1.0, AlphaMode::Opaque, false));
    // A mirror of 0.9; a surface that mirrors 0.3 and scatters 0.6; a highlight alone is no mirror.
    let mirror = |statements: &str| {
        let (m, _) = of(statements);
        (m.base_color, m.metallic, m.roughness)
    };
    assert_eq!(mirror("Kd 0 0 0\nKs .9 .9 .9\nillum 3"), ([0.9; 3], 1.0, 0.0));
    let ([half, ..], metallic, roughness) = mirror("Kd .6 .6 .6\nKs .3 .3 .3\nillum 8\nNs 98");
    assert!((half - 0.9).abs() < 1e-6 && (metallic - 1.0 / 3.0).abs() < 1e-6 && (roughness - 0.376_06).abs() < 1e-4);
    assert_eq!(mirror("Kd .6 .6 .6\nKs .3 .3 .3\nillum 2"), ([0.6; 3], 0.0, 1.0));
    assert_eq!(mirror("Kd .6 .6 .6\nPm 1\nPr 0.25"), ([0.6; 3], 1.0, 0.25));
    assert!(of("illum 7\nKd 1 1 1").1.contains("opaque"));
    let (m, said) =
        of("Kd 2 -1 0.5\nmap_Bump b.png\nmap_bump -bm 2 b.png\nTf 1 1 1\nTf .5 1 1\nKs spectral file.rfl\nKa 1 1 1\nfoo");
    assert_eq!(m.base_color, [1.0, 0.0, 0.5]);
    for words in
        ["`Kd` is taken to the range", "`map_Bump` is not read", "room.mtl:6: `Tf` is not read", "`Ks spectral`", "`foo`"]
    {
        assert!(said.contains(words), "{words}: {said}");
    }
}

/// A folder with a red image, and coverage of one row of holes above one that is whole.
fn images() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    io::write_png(dir.path().join("red tex.png"), &Raster::filled(2, 2, [200, 40, 40])).unwrap();
    io::write_png(dir.path().join("holes.png"), &Raster::from_fn(1, 2, |_, y| [255 * y as u8; 3])).unwrap();
    dir
}

#[test]
fn maps_take_their_options_and_their_names_with_spaces() {
    let dir = images();
    let of = |statement: &str| {
        let (s, report) = read(dir.path(), square(""), format!("newmtl red\nKd 1 1 1\n{statement}\n")).unwrap();
        let reference = s.materials[0].light.base_color_texture.unwrap();
        (s.textures[0].wrap[0], reference.uv_from_uv, report.notes.join("\n"))
    };
    // File coordinates (u, v) → (2u + 0.25, 3v − 0.5), with v turned round.
    for statement in [
        "map_Kd -s 2 3 1 -o 0.25 -0.5 red tex.png",
        "map_kd -blendu off -o 0.25 -0.5 0 -s 2 3 \"red tex.png\"",
        "map_Kd -bm 0.5 red tex.png -s 2 3 1 -o 0.25 -0.5",
    ] {
        let (wrap, map, said) = of(statement);
        let (u, v) = (0.3, 0.2);
        let mapped = map.transform_point2(Vec2::new(u, 1.0 - v));
        assert!((mapped - Vec2::new(2.0 * u + 0.25, 1.0 - (3.0 * v - 0.5))).length() < 1e-6, "{statement}: {mapped}");
        assert_eq!((wrap, said.as_str()), (Wrap::Repeat, ""));
    }
    assert_eq!(of("map_Kd red tex.png").1, glam::Affine2::IDENTITY);
    assert_eq!(of("map_Kd -clamp on RED TEX.PNG").0, Wrap::Clamp);
    for option in ["-mm 0.1 2", "-t 0.5", "-type sphere", "-cc on"] {
        let said = of(&format!("map_Kd {option} red tex.png")).2;
        let name = option.split(' ').next().unwrap();
        assert!(said.contains(&format!("`{name}`")) && said.contains("room.mtl:3"), "{said}");
    }
    assert_eq!(of("map_Kd -mm 0 1 -t 0 0 0 -cc off red tex.png").2, "");
    // Emission: black and absent factors mean the texture alone.
    for (ke, expected) in [("", [1.0; 3]), ("Ke 0 0 0\n", [1.0; 3]), ("Ke 3 2 1\n", [3.0, 2.0, 1.0])] {
        let (s, _) = read(dir.path(), square(""), format!("newmtl red\n{ke}map_Ke red tex.png\n")).unwrap();
        let m = &s.materials[0].light;
        assert_eq!((m.emissive, m.emissive_texture.is_some()), (expected, true), "{ke}");
        assert_eq!(s.textures[0].texels[(0, 0)], [200, 40, 40, 255]);
    }
}

#[test]
fn map_d_is_coverage_beside_the_colour() {
    let dir = images();
    let transparent = Raster::from_fn(1, 2, |_, y| [9, 9, 9, if y == 0 { 0 } else { 255 }]);
    image::save_buffer(dir.path().join("alpha.png"), transparent.pixels().as_flattened(), 1, 2, image::ColorType::Rgba8).unwrap();
    for (maps, colors) in [
        ("map_d holes.png", [255; 3]),
        ("map_d alpha.png", [255; 3]),
        ("map_d -imfchan m alpha.png", [255; 3]),
        ("map_d -imfchan r holes.png", [255; 3]),
        ("map_Kd red tex.png\nmap_d holes.png", [200, 40, 40]),
    ] {
        let (s, report) = read(dir.path(), square(""), format!("newmtl red\nKd .8 .05 .05\nd 0.5\n{maps}\n")).unwrap();
        let m = &s.materials[0].light;
        assert_eq!((m.alpha, m.alpha_mode, m.base_color), (0.5, AlphaMode::Blend, [0.8, 0.05, 0.05]));
        assert_eq!((s.textures.len(), m.base_color_texture.unwrap().texture, report.notes.len()), (1, 0, 0), "{report:?}");
        let texels = &s.textures[0].texels;
        let [r, g, b] = colors;
        let last = texels.height() - 1;
        assert_eq!((texels[(0, 0)], texels[(0, last)]), ([r, g, b, 0], [r, g, b, 255]), "{maps}");
    }
    // The image's luminance where that is asked for, whatever its alpha.
    let (s, _) = read(dir.path(), square(""), "newmtl red\nmap_d -imfchan l alpha.png\n").unwrap();
    assert_eq!(s.textures[0].texels[(0, 0)], [255, 255, 255, 9]);
}

#[test]
fn vertices_have_colours_and_those_without_are_white() {
    let colors = |obj: &str, mtl: &str| {
        let (s, said) = scene(obj, mtl);
        assert_eq!(s.colors.len(), s.positions.len());
        let by_place = |p: Vec3| s.positions.iter().position(|q| *q == p).map(|i| s.colors[i]);
        (by_place(Vec3::ZERO), by_place(Vec3::X), by_place(Vec3::Y), s.materials[0].light.base_color, said)
    };
    let text = "mtllib room.mtl\nusemtl red\nv 0 0 0 1 0.5 0.25\nv 1 0 0 0 0 1 0.5\nv 0 1 0\nf 1 2 3\n";
    let (a, b, c, base, said) = colors(text, "newmtl red\nKd 0.5 0.5 0.5\n");
    assert_eq!((a, b, c), (Some([1.0, 0.5, 0.25, 1.0]), Some([0.0, 0.0, 1.0, 1.0]), Some([1.0; 4])));
    assert_eq!((base, said.as_str()), ([0.5; 3], ""));
    // Without a factor, or with a black one, the vertices' colour is the colour; so it is where no library says anything.
    for mtl in ["newmtl red\n", "newmtl red\nKd 0 0 0\n", ""] {
        assert_eq!(colors(text, mtl).3, [1.0; 3], "{mtl}");
    }
    let (a, .., said) = colors(&text.replace("1 0.5 0.25", "255 102 51"), "");
    assert_eq!(a, Some([1.0, 0.4, 0.2, 1.0]));
    assert!(said.contains("taken as of 255"), "{said}");
    refused(text.replace("0.25", "-0.25"), "", &["room.obj:3", "no colour"]);
    refused(text.replace("0.25", "256"), "", &["room.obj:3", "no colour"]);
    // A weight divides.
    let (s, _) = scene("v 0 0 0\nv 4 0 0 2\nv 0 1 0\nf 1 2 3\n", "");
    assert_eq!((s.bounds().unwrap().max.x, s.colors.len()), (2.0, 0));
}
