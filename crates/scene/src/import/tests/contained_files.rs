//! Files that meshes name stay in the mesh's folder, unless they are allowed out.

use super::*;
use crate::contained::Reach;
use std::path::Path;

fn read(path: &Path, reach: Reach) -> Result<Scene, String> {
    load_with_report(path, &ImportOptions { reach, ..ImportOptions::default() }).map(|(s, _)| s).map_err(|e| e.to_string())
}

#[test]
fn buffers_and_images_outside_of_the_folder_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("model");
    std::fs::create_dir(&folder).unwrap();
    let (json, bin) = parts();
    std::fs::write(dir.path().join("outside.bin"), &bin).unwrap();
    std::fs::write(dir.path().join("outside.png"), io::encode_png(&Raster::filled(1, 1, [9, 9, 9])).unwrap()).unwrap();
    std::fs::write(folder.join("inside.bin"), &bin).unwrap();
    let path = folder.join("room.gltf");
    let absolute = dir.path().join("outside.bin").display().to_string();
    for (buffer, image, word) in [
        ("../outside.bin", None, "buffers[0]"),
        ("%2e%2e/outside.bin", None, "buffers[0]"),
        ("%2E%2E%2Foutside.bin", None, "buffers[0]"),
        (absolute.as_str(), None, "buffers[0]"),
        ("inside.bin", Some("../outside.png"), "images[0]"),
        ("inside.bin", Some("../model/../outside.png"), "images[0]"),
    ] {
        let mut json = json.clone();
        json["buffers"][0]["uri"] = json!(buffer);
        if let Some(image) = image {
            json["images"][0] = json!({ "uri": image });
        }
        std::fs::write(&path, json.to_string()).unwrap();
        let message = read(&path, Reach::Folder).unwrap_err();
        assert!(message.contains(word) && message.contains("allow_outside") && message.contains("room.gltf"), "{message}");
        read(&path, Reach::Anywhere).unwrap();
    }
}

#[test]
fn material_libraries_and_their_textures_outside_of_the_folder_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("model");
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(dir.path().join("outside.png"), io::encode_png(&Raster::filled(1, 1, [9, 9, 9])).unwrap()).unwrap();
    let mtl = "newmtl red\nKd 0.8 0.1 0.2\n";
    std::fs::write(dir.path().join("outside.mtl"), mtl).unwrap();
    let path = folder.join("room.obj");
    let obj = |library: &str| format!("mtllib {library}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl red\nf 1/1 2/1 3/1\n");
    std::fs::write(&path, obj("../outside.mtl")).unwrap();
    let message = read(&path, Reach::Folder).unwrap_err();
    assert!(message.contains("mtllib") && message.contains("allow_outside"), "{message}");
    read(&path, Reach::Anywhere).unwrap();
    std::fs::write(&path, obj("room.mtl")).unwrap();
    for name in ["../outside.png", "..\\outside.png"] {
        std::fs::write(folder.join("room.mtl"), format!("{mtl}map_Kd {name}\n")).unwrap();
        let message = read(&path, Reach::Folder).unwrap_err();
        assert!(message.contains("map_Kd") && message.contains("allow_outside"), "{message}");
        assert_eq!(read(&path, Reach::Anywhere).unwrap().textures.len(), 1);
    }
}

#[cfg(unix)]
#[test]
fn links_out_pipes_and_devices_are_refused_and_not_waited_for() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("model");
    std::fs::create_dir(&folder).unwrap();
    let (mut json, bin) = parts();
    std::fs::write(dir.path().join("outside.bin"), &bin).unwrap();
    std::os::unix::fs::symlink("../outside.bin", folder.join("link.bin")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", folder.join("zero.bin")).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(folder.join("pipe.bin")).status().unwrap().success());
    assert!(std::process::Command::new("mkfifo").arg(folder.join("pipe.gltf")).status().unwrap().success());
    let path = folder.join("room.gltf");
    for (name, reach, word) in [
        ("link.bin", Reach::Folder, "symbolic link"),
        ("zero.bin", Reach::Folder, "symbolic link"),
        ("zero.bin", Reach::Anywhere, "device"),
        ("pipe.bin", Reach::Folder, "pipe"),
        ("pipe.bin", Reach::Anywhere, "pipe"),
        ("", Reach::Folder, "folder"),
    ] {
        json["buffers"][0]["uri"] = json!(name);
        std::fs::write(&path, json.to_string()).unwrap();
        let message = read(&path, reach).unwrap_err();
        assert!(message.contains(word) && message.contains("buffers[0]"), "{name}: {message}");
    }
    json["buffers"][0]["uri"] = json!("link.bin");
    std::fs::write(&path, json.to_string()).unwrap();
    read(&path, Reach::Anywhere).unwrap();
    assert!(read(&folder.join("pipe.gltf"), Reach::Folder).unwrap_err().contains("pipe"));
}
