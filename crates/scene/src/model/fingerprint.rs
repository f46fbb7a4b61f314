//! Whether two scenes in memory are the same.

use crate::model::Texture;
use crate::{Raster, Scene, io};
use std::path::Path;

/// SHA-256 over everything a scene holds: two scenes of one fingerprint look the same to light and radio.
pub fn of_scene(scene: &Scene) -> String {
    let without_texels = |t: &Texture| Texture { texels: Raster::filled(0, 0, [0; 4]), ..t.clone() };
    // What is small, and whatever else a scene comes to hold, goes by its notation; the long lists go by their bytes.
    let small = Scene {
        textures: scene.textures.iter().map(without_texels).collect(),
        positions: vec![],
        normals: vec![],
        uvs: vec![],
        triangles: vec![],
        ..scene.clone()
    };
    let mut bytes = format!("{small:?}").into_bytes();
    let mut floats = |list: &mut dyn Iterator<Item = f32>| list.for_each(|v| bytes.extend(v.to_bits().to_le_bytes()));
    floats(&mut scene.positions.iter().chain(&scene.normals).flat_map(|v| v.to_array()));
    floats(&mut scene.uvs.iter().flatten().copied());
    for t in &scene.triangles {
        let [a, b, c] = t.vertices;
        [a, b, c, t.material, t.object].iter().for_each(|i| bytes.extend(i.to_le_bytes()));
    }
    for texture in &scene.textures {
        let texels = &texture.texels;
        [texels.width(), texels.height()].iter().for_each(|n| bytes.extend((*n as u64).to_le_bytes()));
        bytes.extend(texels.pixels().as_flattened());
    }
    io::sha256_hex(&bytes)
}

/// Whether a mesh file holds all that its scene is made of: an OBJ has its materials elsewhere, and a glTF may have its buffers and images
/// elsewhere. What cannot be read as glTF is taken not to.
pub fn stands_alone(path: &Path, bytes: &[u8]) -> bool {
    let is_gltf = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"));
    if !is_gltf {
        return false;
    }
    let Ok(file) = gltf::Gltf::from_slice_without_validation(bytes) else { return false };
    let inside = |uri: &str| uri.starts_with("data:");
    let buffers = file.document.buffers().all(|b| match b.source() {
        gltf::buffer::Source::Bin => true,
        gltf::buffer::Source::Uri(uri) => inside(uri),
    });
    buffers
        && file.document.images().all(|i| match i.source() {
            gltf::image::Source::View { .. } => true,
            gltf::image::Source::Uri { uri, .. } => inside(uri),
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lobby_stands_alone_and_every_change_shows() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/lobby.glb");
        let bytes = io::read(&path).unwrap();
        assert!(stands_alone(&path, &bytes));
        assert!(!stands_alone(Path::new("a.obj"), b"o a\n"));
        let outside = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"a.bin"}]}"#;
        assert!(!stands_alone(Path::new("a.gltf"), outside));
        let inside =
            br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"data:application/octet-stream;base64,AAAA"}]}"#;
        assert!(stands_alone(Path::new("a.gltf"), inside));
        let scene = crate::import::load(&path).unwrap();
        let print = of_scene(&scene);
        let changed = |change: &dyn Fn(&mut Scene)| {
            let mut other = scene.clone();
            change(&mut other);
            of_scene(&other) != print
        };
        assert!(!changed(&|_| ()));
        assert!(changed(&|s| s.positions[7].z += 1e-6));
        assert!(changed(&|s| s.triangles[3].material += 1));
        assert!(changed(&|s| s.materials[0].light.roughness += 1e-6));
        assert!(changed(&|s| s.textures[0].texels[(1, 1)][0] ^= 1));
        assert!(changed(&|s| s.textures[0].wrap[0] = crate::model::Wrap::Clamp));
    }
}
