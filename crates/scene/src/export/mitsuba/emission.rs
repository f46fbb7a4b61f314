//! Mesh attributes that emission and textures need: vertex colours, texture coordinates, coverage.

use super::texture::Textures;
use crate::Scene;
use crate::model::{AlphaMode, LightMaterial, TextureRef, Wrap};
use glam::Affine2;

/// Whether a triangle of a material has a vertex that is not white.
pub(super) fn is_colored(scene: &Scene, material: u32) -> bool {
    let white = |i: &u32| scene.colors[*i as usize][..3] == [1.0; 3];
    !scene.colors.is_empty() && scene.triangles.iter().any(|t| t.material == material && !t.vertices.iter().all(white))
}

/// Mitsuba samples a textured emitter by its texture, and needs mesh coordinates that are the texture's own: there the mesh's coordinates
/// are taken through the emission's transform, and other textures look through its inverse.
pub(super) struct EmissionMap {
    /// Texture-coordinate transform of the emissive texture.
    pub uv_from_uv: Affine2,
}

impl EmissionMap {
    pub(super) fn of(scene: &Scene, material: u32) -> Self {
        let m = &scene.materials[material as usize].light;
        let transform = m.emissive_texture.filter(|_| m.emissive.iter().any(|e| *e > 0.0)).map(|t| t.uv_from_uv);
        let invertible = |t: &Affine2| t.matrix2.determinant().abs() > 1e-12;
        Self { uv_from_uv: transform.filter(invertible).unwrap_or(Affine2::IDENTITY) }
    }

    /// `uv_from_mesh` of another texture of the material.
    pub(super) fn other(&self, reference: &TextureRef) -> Affine2 {
        if self.uv_from_uv == Affine2::IDENTITY { reference.uv_from_uv } else { through(reference, self.uv_from_uv.inverse()) }
    }
}

/// Whether a textured emission repeats beyond its image.
pub(super) fn repeats(textures: &Textures<'_>, reference: &TextureRef) -> bool {
    textures.get(Some(reference)).is_some_and(|t| t.wrap == [Wrap::Repeat; 2])
}

/// Factor on an emitting surface's radiance: its uniform coverage (alpha), which Mitsuba's emitter does not take from the `mask`.
pub(super) fn emission_share(m: &LightMaterial) -> f32 {
    match m.alpha_mode {
        AlphaMode::Opaque => 1.0,
        AlphaMode::Mask { cutoff } => f32::from(m.alpha >= cutoff),
        AlphaMode::Blend => m.alpha.clamp(0.0, 1.0),
    }
}

/// `uv_from_mesh` of a texture whose mesh coordinates are those of another.
pub(super) fn through(reference: &TextureRef, uv_from_mesh_inverse: Affine2) -> Affine2 {
    reference.uv_from_uv * uv_from_mesh_inverse
}
