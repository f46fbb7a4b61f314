//! Shading data of a ray's hit: position, normals and the material's values there.

use super::bsdf::{Bsdf, fresnel_pane};
use super::texture::{Encoding, sample};
use crate::bvh::{Hit, Ray};
use corf_scene::Scene;
use corf_scene::model::{AlphaMode, LightMaterial, Texture, TextureRef};
use glam::{Mat3, Vec2, Vec3, Vec4};

/// Rays that leave a surface start this share of `1 + |position|` away from it: some hundred roundings of a position.
const OFFSET: f32 = 1e-5;

/// Shading normals are at least this visible from where the ray came.
const MIN_VISIBLE_COS: f32 = 0.01;

/// Ways in which a triangle may let light through: holes of its alpha channel, and thin glass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cover {
    /// Whether its alpha channel may leave holes, or cover a part of the light.
    pub alpha: bool,
    /// Whether it is thin glass, which lets part of the light through in a straight line.
    pub pane: bool,
}

impl Cover {
    /// Stops everything.
    pub const OPAQUE: Self = Self { alpha: false, pane: false };
}

/// Per triangle: [`Cover`].
pub(super) fn covers(scene: &Scene) -> Vec<Cover> {
    let colors_vary = scene.colors.iter().any(|c| c[3] < 1.0);
    let of_material: Vec<Cover> = scene
        .materials
        .iter()
        .map(|m| {
            let light = &m.light;
            let varies = || colors_vary || light.base_color_texture.as_ref().is_some_and(|t| is_translucent(scene, t));
            let alpha = match light.alpha_mode {
                AlphaMode::Opaque => false,
                AlphaMode::Mask { cutoff } => varies() || light.alpha < cutoff,
                AlphaMode::Blend => varies() || light.alpha < 1.0,
            };
            Cover { alpha, pane: light.transmission > 0.0 }
        })
        .collect();
    scene.triangles.iter().map(|t| of_material[t.material as usize]).collect()
}

fn is_translucent(scene: &Scene, texture: &TextureRef) -> bool {
    scene.textures[texture.texture as usize].texels.pixels().iter().any(|texel| texel[3] < 255)
}

/// The material at a hit and its frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    /// World position, interpolated from the corners (more accurate than `origin + t·direction`).
    pub position: Vec3,
    /// Geometric normal on the side the ray came from.
    pub geometric_normal: Vec3,
    /// Shading normal, on the same side.
    pub normal: Vec3,
    pub base_color: Vec3,
    pub metallic: f32,
    pub roughness: f32,
    pub transmission: f32,
    pub ior: f32,
    /// The share of the surface that is there ([`AlphaMode::Blend`]); all else is of that share.
    pub coverage: f32,
    /// Radiance emitted towards the ray's origin.
    pub emitted: Vec3,
}

/// Interaction of a ray with a surface, as chosen by Russian roulette.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    /// Passes a hole of the alpha channel: the surface is not there.
    Absent,
    /// Passes straight through a pane.
    Passes,
    /// Is mirrored by a pane.
    Mirrored,
    /// Hits the base of a pane that is not wholly transparent.
    MeetsBase,
    /// Hits a surface that is no pane.
    Meets,
}

/// Texture coordinate at barycentric weights of a triangle; zero where the mesh has none.
fn uv_at(scene: &Scene, triangle: u32, u: f32, v: f32) -> Vec2 {
    let [a, b, c] =
        scene.triangles[triangle as usize].vertices.map(|i| scene.uvs.get(i as usize).map_or(Vec2::ZERO, |t| Vec2::from(*t)));
    a * (1.0 - u - v) + b * u + c * v
}

/// Vertex colour at barycentric weights of a triangle; white where the scene has none.
fn color_at(scene: &Scene, triangle: u32, u: f32, v: f32) -> Vec4 {
    if scene.colors.is_empty() {
        return Vec4::ONE;
    }
    let [a, b, c] = scene.triangles[triangle as usize].vertices.map(|i| Vec4::from(scene.colors[i as usize]));
    a * (1.0 - u - v) + b * u + c * v
}

fn rgb(textures: &[Texture], texture: &Option<TextureRef>, uv: Vec2, encoding: Encoding) -> Vec3 {
    texture.as_ref().map_or(Vec3::ONE, |t| Vec3::from_slice(&sample(textures, t, uv, encoding)[..3]))
}

/// Emitted radiance of a material at a texture coordinate.
fn emitted_at(scene: &Scene, material: &LightMaterial, uv: Vec2) -> Vec3 {
    Vec3::from(material.emissive) * rgb(&scene.textures, &material.emissive_texture, uv, Encoding::Srgb)
}

/// Emitted radiance of a triangle at barycentric weights, times the share of it that is there.
pub(super) fn emission(scene: &Scene, cover: Cover, triangle: u32, u: f32, v: f32) -> Vec3 {
    let material = &scene.materials[scene.triangles[triangle as usize].material as usize].light;
    let emitted = emitted_at(scene, material, uv_at(scene, triangle, u, v));
    if cover.alpha { emitted * coverage(scene, triangle, u, v) } else { emitted }
}

/// The share of a surface that is there at barycentric weights: 0 or 1 but where alpha blends.
pub(super) fn coverage(scene: &Scene, triangle: u32, u: f32, v: f32) -> f32 {
    let material = &scene.materials[scene.triangles[triangle as usize].material as usize].light;
    let alpha = || {
        let texel = material
            .base_color_texture
            .as_ref()
            .map_or(1.0, |t| sample(&scene.textures, t, uv_at(scene, triangle, u, v), Encoding::Srgb)[3]);
        material.alpha * texel * color_at(scene, triangle, u, v).w
    };
    match material.alpha_mode {
        AlphaMode::Opaque => 1.0,
        AlphaMode::Mask { cutoff } => f32::from(alpha() >= cutoff),
        AlphaMode::Blend => alpha().clamp(0.0, 1.0),
    }
}

/// Share of straight light that passes a pane, per channel.
pub(super) fn pane_transmittance(scene: &Scene, hit: &Hit, direction: Vec3) -> Vec3 {
    let material = &scene.materials[scene.triangles[hit.triangle as usize].material as usize].light;
    let [a, b, c] = scene.corners(hit.triangle as usize);
    let cos = (b - a).cross(c - a).normalize_or_zero().dot(direction.normalize()).abs();
    let tint = Vec3::from(material.base_color)
        * color_at(scene, hit.triangle, hit.u, hit.v).truncate()
        * rgb(&scene.textures, &material.base_color_texture, uv_at(scene, hit.triangle, hit.u, hit.v), Encoding::Srgb);
    tint * (material.transmission * (1.0 - super::bsdf::fresnel_pane(cos, material.ior)))
}

impl Surface {
    /// Looks a hit up. With `coarse` textures, colour comes from them and normal maps are left out.
    pub fn at(scene: &Scene, cover: Cover, ray: &Ray, hit: &Hit, coarse: Option<&[Texture]>) -> Self {
        let triangle = &scene.triangles[hit.triangle as usize];
        let material = &scene.materials[triangle.material as usize].light;
        let [a, b, c] = triangle.vertices.map(|i| scene.positions[i as usize]);
        let (u, v, w) = (hit.u, hit.v, 1.0 - hit.u - hit.v);
        let facing = (b - a).cross(c - a).normalize_or(Vec3::Z);
        let from_front = facing.dot(ray.direction) < 0.0;
        let side = if from_front { 1.0 } else { -1.0 };
        let uv = uv_at(scene, hit.triangle, u, v);
        let texel = rgb(coarse.unwrap_or(&scene.textures), &material.base_color_texture, uv, Encoding::Srgb);
        let color = color_at(scene, hit.triangle, u, v).truncate();
        let base_color = (Vec3::from(material.base_color) * color * texel).clamp(Vec3::ZERO, Vec3::ONE);
        let data = rgb(&scene.textures, &material.metallic_roughness_texture, uv, Encoding::Linear);
        Self {
            position: a * w + b * u + c * v,
            geometric_normal: facing * side,
            normal: shading_normal(scene, hit, material, coarse.is_none(), uv, facing, ray.direction, side),
            base_color,
            metallic: (material.metallic * data.z).clamp(0.0, 1.0),
            roughness: (material.roughness * data.y).clamp(0.0, 1.0),
            transmission: material.transmission.clamp(0.0, 1.0),
            ior: material.ior.max(1.0),
            coverage: if cover.alpha { coverage(scene, hit.triangle, u, v) } else { 1.0 },
            emitted: if from_front || material.double_sided { emitted_at(scene, material, uv) } else { Vec3::ZERO },
        }
    }

    /// Draws what becomes of a ray here by a uniform number: of a blended surface a share is there, and panes pass light, mirror it, or
    /// show their base.
    pub fn fate(&self, ray: &Ray, u: f32) -> Fate {
        if u >= self.coverage {
            return Fate::Absent;
        }
        // What is left of the number decides the rest.
        let u = u / self.coverage;
        if self.transmission <= 0.0 {
            return Fate::Meets;
        }
        let reflectance = fresnel_pane(self.geometric_normal.dot(ray.direction).abs(), self.ior);
        let through = (1.0 - reflectance) * self.transmission;
        match u {
            u if u < through => Fate::Passes,
            u if u < through + reflectance => Fate::Mirrored,
            _ => Fate::MeetsBase,
        }
    }

    /// Ray parameter from which a ray goes on behind this hit, in units of its direction's length.
    pub fn beyond(&self, hit: &Hit) -> f32 {
        hit.t + offset(self.position)
    }

    /// A ray mirrored at the geometric surface.
    pub fn mirrored(&self, ray: &Ray) -> Ray {
        let n = self.geometric_normal;
        let direction = ray.direction - n * (2.0 * n.dot(ray.direction));
        Ray::new(self.leave(direction), direction)
    }

    /// `shading_from_world` and the reflection towards where the ray came from; what meets a pane's base meets nothing else.
    pub fn reflection(&self, ray: &Ray, fate: Fate) -> (Mat3, Bsdf) {
        let (t, b) = self.normal.any_orthonormal_pair();
        let to_local = Mat3::from_cols(t, b, self.normal).transpose();
        let v = to_local * -ray.direction;
        let bsdf = if fate == Fate::MeetsBase {
            Bsdf::new(self.base_color, 0.0, 1.0, 1.0, v)
        } else {
            Bsdf::new(self.base_color, self.metallic, self.roughness, self.ior, v)
        };
        (to_local, bsdf)
    }

    /// A point off the surface on the side of `direction`, from which a ray does not hit it again.
    pub fn leave(&self, direction: Vec3) -> Vec3 {
        let side = if self.geometric_normal.dot(direction) < 0.0 { -1.0 } else { 1.0 };
        self.position + self.geometric_normal * (side * offset(self.position))
    }
}

/// Distance from a surface at which rays that leave it start, metres; it grows with the coordinates as their rounding does.
pub(super) fn offset(position: Vec3) -> f32 {
    OFFSET * (1.0 + position.abs().max_element())
}

/// Interpolated and normal-mapped normal on the ray's side, bent towards the viewer where it would face away.
fn shading_normal(
    scene: &Scene,
    hit: &Hit,
    material: &LightMaterial,
    mapped: bool,
    uv: Vec2,
    facing: Vec3,
    direction: Vec3,
    side: f32,
) -> Vec3 {
    let vertices = scene.triangles[hit.triangle as usize].vertices.map(|i| i as usize);
    let (u, v, w) = (hit.u, hit.v, 1.0 - hit.u - hit.v);
    let mut n = match (scene.normals.get(vertices[0]), scene.normals.get(vertices[1]), scene.normals.get(vertices[2])) {
        (Some(a), Some(b), Some(c)) => (*a * w + *b * u + *c * v).normalize_or(facing),
        _ => facing,
    };
    if n.dot(facing) < 0.0 {
        n = -n;
    }
    if let Some(map) = material.normal_texture.as_ref().filter(|_| mapped) {
        let texel = sample(&scene.textures, map, uv, Encoding::Linear);
        if let Some((t, b)) = tangents(scene, hit.triangle, map, n) {
            let s = material.normal_scale;
            let m = Vec3::new((2.0 * texel[0] - 1.0) * s, (2.0 * texel[1] - 1.0) * s, 2.0 * texel[2] - 1.0);
            n = (t * m.x + b * m.y + n * m.z).normalize_or(n);
        }
    }
    let n = n * side;
    // A normal that faces away from the viewer would reflect from below: bend it until it is just seen.
    let seen = -n.dot(direction);
    if seen >= MIN_VISIBLE_COS { n } else { (n + direction * (seen - MIN_VISIBLE_COS)).normalize_or(facing * side) }
}

/// Tangent and bitangent of a triangle's texture coordinates, orthogonal to `n`. glTF: +x along increasing u, +y along decreasing v
/// (green up, v down).
fn tangents(scene: &Scene, triangle: u32, map: &TextureRef, n: Vec3) -> Option<(Vec3, Vec3)> {
    let vertices = scene.triangles[triangle as usize].vertices.map(|i| i as usize);
    let uv = |k: usize| scene.uvs.get(vertices[k]).map(|t| map.uv_from_uv.transform_point2(Vec2::from(*t)));
    let (uv0, uv1, uv2) = (uv(0)?, uv(1)?, uv(2)?);
    let [p0, p1, p2] = scene.corners(triangle as usize);
    let (d1, d2, e1, e2) = (uv1 - uv0, uv2 - uv0, p1 - p0, p2 - p0);
    let determinant = d1.perp_dot(d2);
    if determinant.abs() < 1e-20 {
        return None;
    }
    let along_u = (e1 * d2.y - e2 * d1.y) / determinant;
    let along_v = (e2 * d1.x - e1 * d2.x) / determinant;
    let t = (along_u - n * n.dot(along_u)).try_normalize()?;
    let handed = if n.cross(t).dot(along_v) < 0.0 { 1.0 } else { -1.0 };
    Some((t, n.cross(t) * handed))
}
