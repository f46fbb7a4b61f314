//! Punctual lights, masks, normal maps, textured emitters and panes.

use super::*;
use corf_scene::model::{AlphaMode, Filter, PunctualKind, PunctualLight, Texture, TextureRef, Wrap};
use glam::Affine2;

const ALBEDO: f32 = 0.6;

fn texture(scene: &mut Scene, width: usize, height: usize, texel: impl FnMut(usize, usize) -> [u8; 4]) -> Option<TextureRef> {
    let texels = Raster::from_fn(width, height, texel);
    scene.textures.push(Texture { name: "test".into(), texels, wrap: [Wrap::Clamp; 2], filter: Filter::Linear });
    Some(TextureRef { texture: scene.textures.len() as u32 - 1, uv_from_uv: Affine2::IDENTITY })
}

/// A floor around the origin, seen through a very narrow lens from the side.
fn floor_under(scene: &mut Scene, floor: u32) -> (Pinhole, Rigid3) {
    quad(scene, Vec3::new(-2.0, -2.0, 0.0), Vec3::X * 4.0, Vec3::Y * 4.0, floor);
    view(2, 2, 0.005, DVec3::new(-1.0, -1.0, 0.5), DVec3::ZERO)
}

fn direct() -> LightSettings {
    LightSettings { samples_per_pixel: 4, max_bounces: 1, ..LightSettings::default() }
}

#[test]
fn punctual_lights_shine_as_their_units_say() {
    let point = PunctualLight {
        kind: PunctualKind::Point,
        position: Vec3::new(0.6, 0.0, 0.8),
        direction: Vec3::NEG_Z,
        intensity: [7.0; 3],
        range_m: None,
    };
    let to_floor = Vec3::new(-0.6, 0.0, -0.8);
    let spot = |outer_rad: f32| PunctualLight {
        kind: PunctualKind::Spot { inner_rad: outer_rad - 0.1, outer_rad },
        direction: Vec3::NEG_Z,
        ..point
    };
    let half = (0.5f32 * (0.5f32.cos() + 0.6f32.cos())).acos();
    let aimed = to_floor.normalize() * half.cos() + Vec3::Y * half.sin();
    for (light, expected) in [
        // E = I·cosθ/d² with d = 1 m, cosθ = 0.8.
        (point, 7.0 * 0.8),
        // (1 − (d/range)⁴) of it.
        (PunctualLight { range_m: Some(2.0), ..point }, 7.0 * 0.8 * (1.0 - 1.0 / 16.0)),
        (PunctualLight { range_m: Some(0.9), ..point }, 0.0),
        // The floor point is atan(0.75) = 0.644 rad off the axis.
        (spot(0.6), 0.0),
        (spot(0.9), 7.0 * 0.8),
        // Halfway in cosine between the cones the falloff is ½².
        (
            PunctualLight { kind: PunctualKind::Spot { inner_rad: 0.5, outer_rad: 0.6 }, direction: aimed, ..point },
            7.0 * 0.8 * 0.25,
        ),
        (PunctualLight { kind: PunctualKind::Directional, direction: to_floor, ..point }, 7.0 * 0.8),
    ] {
        let mut scene = Scene::default();
        let floor = diffuse(&mut scene, ALBEDO);
        let camera = floor_under(&mut scene, floor);
        scene.lights.push(light);
        let (mean, _) = statistics(&render(&scene, &camera, &direct()));
        let exact = expected * ALBEDO / std::f32::consts::PI;
        // The lens sees a spot of a tenth of a millimetre.
        assert!((mean as f32 - exact).abs() < 2e-3 * exact.max(0.01), "{:?}: {mean}, exactly {exact}", light.kind);
    }
}

#[test]
fn holes_of_a_mask_let_light_depth_and_sight_through() {
    let mut scene = Scene::default();
    let floor = diffuse(&mut scene, ALBEDO);
    let camera = floor_under(&mut scene, floor);
    scene.lights.push(PunctualLight {
        kind: PunctualKind::Directional,
        position: Vec3::ZERO,
        direction: Vec3::NEG_Z,
        intensity: [1.0; 3],
        range_m: None,
    });
    let lit = statistics(&render(&scene, &camera, &direct())).0;
    for (hole, expected) in [(true, lit), (false, 0.0)] {
        let mut scene = scene.clone();
        // Left half of the screen opaque or not, the right half the other way round; the floor point is under the left half.
        let texture = texture(&mut scene, 64, 1, |x, _| [255, 255, 255, if (x < 32) == hole { 0 } else { 255 }]);
        let light = LightMaterial {
            base_color_texture: texture,
            alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
            ..LightMaterial::default()
        };
        let screen = material(&mut scene, light);
        quad(&mut scene, Vec3::new(-0.4, -0.5, 1.0), Vec3::X, Vec3::Y, screen);
        let mean = statistics(&render(&scene, &camera, &direct())).0;
        assert!((mean - expected).abs() < 1e-6, "hole {hole}: {mean} {expected}");
        let above = view(1, 1, 1.0, DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO);
        let depth = render(&scene, &above, &direct()).depth_m[(0, 0)];
        assert!((depth - if hole { 3.0 } else { 2.0 }).abs() < 1e-5, "hole {hole}: depth {depth}");
    }
}

#[test]
fn normal_maps_tilt_towards_growing_u_and_falling_v() {
    // Directional light from direction d: irradiance is n·d with the mapped normal; texture coordinates grow along x and y.
    let d = Vec3::new(0.36, 0.48, 0.8);
    for (texel, normal) in [
        ([128u8, 128, 255], Vec3::Z),
        ([204, 128, 230], Vec3::new(0.6, 0.0, 0.8)),
        // Green is up in the image, which is falling v, here −y.
        ([128, 204, 230], Vec3::new(0.0, -0.6, 0.8)),
    ] {
        let mut scene = Scene::default();
        let normal_texture = texture(&mut scene, 1, 1, |_, _| [texel[0], texel[1], texel[2], 255]);
        let light = LightMaterial { base_color: [ALBEDO; 3], ior: 1.0, normal_texture, ..LightMaterial::default() };
        let floor = material(&mut scene, light);
        floor_under(&mut scene, floor);
        let camera = view(2, 2, 0.005, DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO);
        scene.lights.push(PunctualLight {
            kind: PunctualKind::Directional,
            position: Vec3::ZERO,
            direction: -d,
            intensity: [1.0; 3],
            range_m: None,
        });
        let (mean, _) = statistics(&render(&scene, &camera, &direct()));
        let exact = normal.dot(d) * ALBEDO / std::f32::consts::PI;
        // Eight-bit normals are 0.004 coarse.
        assert!((mean as f32 - exact).abs() < 0.012 * exact, "{texel:?}: {mean}, exactly {exact}");
    }
}

#[test]
fn both_estimators_agree_through_panes_masks_and_textured_emitters() {
    let mut scene = Scene::default();
    let wall = diffuse(&mut scene, 0.6);
    let stripes = texture(&mut scene, 8, 1, |x, _| if x < 2 { [255, 200, 80, 255] } else { [20, 20, 60, 255] });
    let light = material(
        &mut scene,
        LightMaterial {
            ior: 1.0,
            emissive: [12.0; 3],
            emissive_texture: stripes,
            double_sided: false,
            ..LightMaterial::default()
        },
    );
    let pane = material(
        &mut scene,
        LightMaterial { base_color: [0.7, 0.9, 0.8], transmission: 0.85, roughness: 0.0, ..LightMaterial::default() },
    );
    let leaves = texture(&mut scene, 16, 16, |x, y| [90, 160, 60, if (x / 4 + y / 4) % 2 == 0 { 255 } else { 0 }]);
    let mask = material(
        &mut scene,
        LightMaterial { base_color_texture: leaves, alpha_mode: AlphaMode::Mask { cutoff: 0.5 }, ..LightMaterial::default() },
    );
    room(&mut scene, Vec3::ZERO, Vec3::new(3.0, 3.0, 2.5), wall);
    quad(&mut scene, Vec3::new(0.6, 0.6, 2.45), Vec3::Y * 1.8, Vec3::X * 1.8, light);
    quad(&mut scene, Vec3::new(0.3, 0.3, 2.1), Vec3::X * 2.4, Vec3::Y * 2.4, pane);
    quad(&mut scene, Vec3::new(0.7, 0.7, 1.2), Vec3::X * 1.6, Vec3::Y * 1.6, mask);
    let camera = view(12, 9, 75.0, DVec3::new(0.3, 0.4, 1.4), DVec3::new(2.2, 2.0, 0.8));
    agree(&scene, &camera, 6);
}
