//! Binary PLY: positions and triangles, nothing else.

use glam::Vec3;

/// A mesh of shared vertices as little-endian binary PLY: `float x y z`, `list uchar int vertex_indices`.
pub(super) fn encode(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face \
         {}\nproperty list uchar int vertex_indices\nend_header\n",
        positions.len(),
        triangles.len()
    )
    .into_bytes();
    bytes.reserve(positions.len() * 12 + triangles.len() * 13);
    for value in positions.iter().flat_map(|p| p.to_array()) {
        bytes.extend(value.to_le_bytes());
    }
    for triangle in triangles {
        bytes.push(3);
        for index in triangle {
            bytes.extend(index.to_le_bytes());
        }
    }
    bytes
}
