//! A scene in memory: world-space triangles with optical and radio materials. Every importer makes one; both tracers read it.

pub mod fingerprint;
pub mod info;
pub mod mounting;
pub mod overlaps;
pub(crate) mod parts;
pub mod solids;

use crate::{Raster, Rigid3};
use glam::{Affine2, DVec3, Vec3};

/// A scene: one flat list of world-space triangles (z up, metres) with materials, textures and lights.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// A name for messages: the file stem, as a rule.
    pub name: String,
    /// Named things (a sofa, a wall); a triangle's surface id is an index into this list.
    pub objects: Vec<Object>,
    /// Materials, optical and radio.
    pub materials: Vec<Material>,
    /// Decoded textures.
    pub textures: Vec<Texture>,
    /// Vertices: world positions, metres.
    pub positions: Vec<Vec3>,
    /// Per vertex: unit shading normal.
    pub normals: Vec<Vec3>,
    /// Per vertex: texture coordinates (glTF convention, v down).
    pub uvs: Vec<[f32; 2]>,
    /// Per vertex: linear RGBA that multiplies base colour and alpha, interpolated over the triangle. Empty where no mesh has any, else
    /// one a vertex.
    pub colors: Vec<[f32; 4]>,
    /// Triangles.
    pub triangles: Vec<Triangle>,
    /// Point, spot and directional lights (`KHR_lights_punctual`); emissive triangles are found through their materials.
    pub lights: Vec<PunctualLight>,
}

/// One triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangle {
    /// Indices of its vertices, counter-clockwise seen from the outside.
    pub vertices: [u32; 3],
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Index into [`Scene::objects`].
    pub object: u32,
}

/// A named part of the scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Object {
    /// The node's name in the file.
    pub name: String,
}

/// An optical material and, where the file or the TOML gives one, its radio properties.
#[derive(Clone, Debug)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Optical properties (visible light).
    pub light: LightMaterial,
    /// Radio properties at 60 GHz; tracing radio over a material that is `None` is an error.
    pub radio: Option<RadioMaterial>,
}

/// glTF metallic-roughness (the model of glTF 2.0, appendix B), linear colour.
#[derive(Clone, Debug)]
pub struct LightMaterial {
    /// Linear base colour factor.
    pub base_color: [f32; 3],
    /// Base colour texture (sRGB).
    pub base_color_texture: Option<TextureRef>,
    /// Alpha factor: the alpha of a place is this times the base colour texture's alpha times the vertices'.
    pub alpha: f32,
    /// Interpretation of alpha for light.
    pub alpha_mode: AlphaMode,
    /// 0 dielectric … 1 metal.
    pub metallic: f32,
    /// Perceptual roughness, `alpha = roughness²`.
    pub roughness: f32,
    /// G = roughness, B = metallic (linear).
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent-space normals (linear).
    pub normal_texture: Option<TextureRef>,
    /// Scale of the normal texture's x and y.
    pub normal_scale: f32,
    /// Linear emitted radiance (factor × `KHR_materials_emissive_strength`), W/(m²·sr) up to exposure.
    pub emissive: [f32; 3],
    /// Emissive texture (sRGB).
    pub emissive_texture: Option<TextureRef>,
    /// `KHR_materials_transmission`: 0 opaque … 1 thin glass.
    pub transmission: f32,
    /// `KHR_materials_ior`.
    pub ior: f32,
    /// Seen from both sides.
    pub double_sided: bool,
}

impl Default for LightMaterial {
    fn default() -> Self {
        Self {
            base_color: [0.8; 3],
            base_color_texture: None,
            alpha: 1.0,
            alpha_mode: AlphaMode::Opaque,
            metallic: 0.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emissive: [0.0; 3],
            emissive_texture: None,
            transmission: 0.0,
            ior: 1.5,
            double_sided: true,
        }
    }
}

/// Alpha mode of a material (glTF 2.0 §3.9.4): the interpretation of alpha for light. Radio meets the whole surface in every mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored: the surface covers all that is behind it.
    Opaque,
    /// Alpha test: the surface has a hole wherever alpha is below the cutoff.
    Mask {
        /// The smallest alpha that covers.
        cutoff: f32,
    },
    /// Alpha is coverage: that share of the surface is there, and through the rest what is behind is seen unchanged.
    Blend,
}

/// A texture as a material uses it.
#[derive(Clone, Copy, Debug)]
pub struct TextureRef {
    /// Index into [`Scene::textures`].
    pub texture: u32,
    /// `KHR_texture_transform`: texture coordinates → texture coordinates.
    pub uv_from_uv: Affine2,
}

/// A decoded image with its sampler.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Name for messages.
    pub name: String,
    /// 8-bit RGBA as stored (sRGB or linear according to its use).
    pub texels: Raster<[u8; 4]>,
    /// Wrap modes along u and v: the mapping of texture coordinates outside `[0, 1)`.
    pub wrap: [Wrap; 2],
    /// Interpolation between texel centres.
    pub filter: Filter,
}

/// A glTF sampler's magnification filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// Bilinear interpolation of four texels (the default).
    #[default]
    Linear,
    /// The texel that the coordinate falls into.
    Nearest,
}

/// A glTF sampler's wrap mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// Repeat (the default).
    Repeat,
    /// Mirrored repeat.
    Mirror,
    /// Clamp to edge.
    Clamp,
}

/// `KHR_lights_punctual`, in world space.
#[derive(Clone, Copy, Debug)]
pub struct PunctualLight {
    /// Kind of light (point, spot or directional) with its own parameters.
    pub kind: PunctualKind,
    /// Position, metres (unused by a directional light).
    pub position: Vec3,
    /// Unit direction the light shines along (unused by a point light).
    pub direction: Vec3,
    /// Linear colour × intensity (candela for point and spot, lux for directional).
    pub intensity: [f32; 3],
    /// Distance at which the light is cut off, metres.
    pub range_m: Option<f32>,
}

/// The three kinds of punctual light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PunctualKind {
    /// All directions.
    Point,
    /// A cone: half angles in radians.
    Spot {
        /// Full intensity inside.
        inner_rad: f32,
        /// Nothing outside.
        outer_rad: f32,
    },
    /// Parallel light.
    Directional,
}

/// Radio material of a surface: a slab of a uniform dielectric with an effective-roughness scattering lobe.
#[derive(Clone, Debug, PartialEq)]
pub struct RadioMaterial {
    /// Identifier, e.g. `concrete` (ITU-R P.2040-3 name) or the user's own.
    pub id: String,
    /// Electrical properties.
    pub permittivity: Permittivity,
    /// Slab thickness, metres. There is no default.
    pub thickness_m: f64,
    /// Diffuse scattering.
    pub scattering: Scattering,
}

/// Source of a slab's complex relative permittivity.
#[derive(Clone, Debug, PartialEq)]
pub enum Permittivity {
    /// A row of the ITU-R P.2040-3 table by name, e.g. `concrete`, evaluated at the carrier (an error outside its validity range).
    Itu(String),
    /// Given at the carrier frequency.
    Constant {
        /// Real relative permittivity.
        relative_permittivity: f64,
        /// Conductivity, S/m.
        conductivity_s_per_m: f64,
    },
}

/// Effective-roughness scattering (Degli-Esposti 2007).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scattering {
    /// Scattering coefficient S in `[0, 1]`: S² of the reflected power is diffuse.
    pub coefficient: f64,
    /// Cross-polarisation K_x in `[0, 1]`: the share of scattered power in the orthogonal polarisation.
    pub xpd: f64,
    /// Shape of the lobe.
    pub pattern: ScatteringPattern,
}

/// The lobe of diffuse scattering.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ScatteringPattern {
    /// cosθ_s / π.
    #[default]
    Lambertian,
    /// A lobe around the specular direction.
    Directive {
        /// Exponent α_r, 1 to [`MAX_LOBE_EXPONENT`].
        alpha_r: u32,
    },
    /// A lobe around the specular direction and one back towards where the wave came from:
    /// Λ((1 + cosψ_r)/2)^α_r + (1 − Λ)((1 + cosψ_i)/2)^α_i, normalised over the hemisphere (Degli-Esposti et al. 2007).
    Backscatter {
        /// Exponent α_r of the lobe around the specular direction, 1 to [`MAX_LOBE_EXPONENT`].
        alpha_r: u32,
        /// Exponent α_i of the lobe around the direction of arrival, 1 to [`MAX_LOBE_EXPONENT`].
        alpha_i: u32,
        /// Λ in `[0, 1]`: weight of the lobe around the specular direction.
        lambda: f64,
    },
}

/// The largest exponent of a scattering lobe: its half-power half-width is 14° there, and what is narrower is a mirror in practice.
pub const MAX_LOBE_EXPONENT: u32 = 50;

impl Scattering {
    /// The first property out of range: what it is and what to do about it.
    pub fn out_of_range(&self) -> Option<(String, &'static str)> {
        if !(0.0..=1.0).contains(&self.coefficient) {
            return Some((format!("scattering_coefficient = {}", self.coefficient), "S is an amplitude share in [0, 1]"));
        }
        if !(0.0..=1.0).contains(&self.xpd) {
            return Some((format!("xpd = {}", self.xpd), "K_x is a power share in [0, 1], not dB"));
        }
        let exponents = match self.pattern {
            ScatteringPattern::Lambertian => [None, None],
            ScatteringPattern::Directive { alpha_r } => [Some(("alpha_r", alpha_r)), None],
            ScatteringPattern::Backscatter { alpha_r, alpha_i, .. } => [Some(("alpha_r", alpha_r)), Some(("alpha_i", alpha_i))],
        };
        for (name, alpha) in exponents.into_iter().flatten() {
            if !(1..=MAX_LOBE_EXPONENT).contains(&alpha) {
                return Some((format!("{name} = {alpha}"), "give an integer from 1 to 50"));
            }
        }
        match self.pattern {
            ScatteringPattern::Backscatter { lambda, .. } if !(0.0..=1.0).contains(&lambda) => {
                Some((format!("lambda = {lambda}"), "it is the weight of the specular lobe, in [0, 1]"))
            }
            _ => None,
        }
    }
}

/// One axis-aligned box in world space, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: Vec3,
    /// Largest corner.
    pub max: Vec3,
}

impl Scene {
    /// The three world-space corners of triangle `i`, metres.
    pub fn corners(&self, i: usize) -> [Vec3; 3] {
        self.triangles[i].vertices.map(|v| self.positions[v as usize])
    }

    /// The three corners in f64; positions are float32 in the file, so this is exact.
    pub fn corners_f64(&self, i: usize) -> [DVec3; 3] {
        self.corners(i).map(Vec3::as_dvec3)
    }

    /// The box of all vertices; `None` without any.
    pub fn bounds(&self) -> Option<Bounds> {
        let first = *self.positions.first()?;
        Some(
            self.positions
                .iter()
                .fold(Bounds { min: first, max: first }, |b, p| Bounds { min: b.min.min(*p), max: b.max.max(*p) }),
        )
    }

    /// Names of the materials used by triangles that have no radio properties.
    pub fn materials_without_radio(&self) -> Vec<&str> {
        let mut used = vec![false; self.materials.len()];
        self.triangles.iter().for_each(|t| used[t.material as usize] = true);
        self.materials.iter().zip(used).filter(|(m, used)| *used && m.radio.is_none()).map(|(m, _)| m.name.as_str()).collect()
    }
}

/// The platform's array and camera share one frame up to axes: array x (boresight) is camera z, array y is −camera x, array z is −camera y.
pub const ARRAY_FROM_CAMERA: Rigid3 = Rigid3 {
    rotation: glam::DMat3::from_cols(DVec3::new(0.0, -1.0, 0.0), DVec3::new(0.0, 0.0, -1.0), DVec3::new(1.0, 0.0, 0.0)),
    translation: DVec3::ZERO,
};

/// Rotation `world_from_array` of the platform's antenna array; its first column is the boresight direction in the world.
pub fn world_from_array(world_from_camera: &Rigid3) -> glam::DMat3 {
    world_from_camera.rotation * ARRAY_FROM_CAMERA.rotation.transpose()
}
