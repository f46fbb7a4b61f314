//! Alpha as coverage, masks by the whole product of alphas, vertex colours.

use super::*;
use corf_scene::model::{AlphaMode, Filter, PunctualKind, PunctualLight, Texture, TextureRef, Wrap};
use glam::Affine2;

/// A matt sheet without a specular lobe.
fn sheet(color: [f32; 3], alpha: f32, alpha_mode: AlphaMode) -> LightMaterial {
    LightMaterial { base_color: color, alpha, alpha_mode, ior: 1.0, ..LightMaterial::default() }
}

fn one_texel(scene: &mut Scene, texel: [u8; 4]) -> Option<TextureRef> {
    scene.textures.push(Texture {
        name: "texel".into(),
        texels: Raster::filled(1, 1, texel),
        wrap: [Wrap::Clamp; 2],
        filter: Filter::Linear,
    });
    Some(TextureRef { texture: scene.textures.len() as u32 - 1, uv_from_uv: Affine2::IDENTITY })
}

/// A sheet across the view at z = 1, seen from above against a background of radiance 1.
fn above(light: LightMaterial) -> (Scene, (Pinhole, Rigid3)) {
    let mut scene = Scene::default();
    let sheet = material(&mut scene, light);
    quad(&mut scene, Vec3::new(-1.0, -1.0, 1.0), Vec3::X * 2.0, Vec3::Y * 2.0, sheet);
    (scene, view(2, 2, 10.0, DVec3::new(0.01, 0.02, 3.0), DVec3::new(0.01, 0.02, 0.0)))
}

fn against_background(max_bounces: u32) -> LightSettings {
    LightSettings { samples_per_pixel: 4096, max_bounces, background: [1.0; 3], ..LightSettings::default() }
}

#[test]
fn a_sheet_of_alpha_shows_alpha_of_itself_over_what_is_behind() {
    // Over: α·surface + (1 − α)·behind. Black and clear against 1; a surface that emits 3.
    for (emissive, alpha, expected) in [(0.0, 0.2, 0.8), (0.0, 0.75, 0.25), (3.0, 0.25, 0.75 + 0.25 * 3.0)] {
        let (scene, camera) = above(LightMaterial { emissive: [emissive; 3], ..sheet([0.0; 3], alpha, AlphaMode::Blend) });
        let (mean, _) = statistics(&render(&scene, &camera, &against_background(0)));
        // 16 384 stratified choices between there and not.
        assert!((mean - expected).abs() < 2e-3, "alpha {alpha}, emissive {emissive}: {mean}, exactly {expected}");
    }
}

#[test]
fn blending_neither_makes_nor_loses_light() {
    // A white sheet in a uniform glow is as bright as the glow whatever part of it is there, from camera, bounce and shadow rays.
    for alpha in [0.1, 0.5, 0.9, 1.0] {
        let (mut scene, camera) = above(sheet([1.0; 3], alpha, AlphaMode::Blend));
        let second = material(&mut scene, sheet([1.0; 3], 1.0 - 0.5 * alpha, AlphaMode::Blend));
        quad(&mut scene, Vec3::new(-1.0, -1.0, 0.5), Vec3::X * 2.0, Vec3::Y * 2.0, second);
        let settings = LightSettings { roulette_after: 64, ..against_background(64) };
        let (mean, error) = statistics(&render(&scene, &camera, &settings));
        assert!((mean - 1.0).abs() < 5.0 * error + 1e-3, "alpha {alpha}: {mean} ± {error}");
    }
}

#[test]
fn a_shadow_ray_is_weakened_by_what_is_there_and_not_tinted() {
    // Texture, factor and vertices share in alpha: 0.5 · 204/255 · 0.75 = 0.3.
    for (factor, texel, vertex, passed) in
        [(0.2, None, None, 0.8), (0.5, Some(204), None, 0.6), (0.5, Some(204), Some(0.75), 0.7), (1.0, Some(0), None, 1.0)]
    {
        let mut scene = Scene::default();
        let floor = diffuse(&mut scene, 0.6);
        quad(&mut scene, Vec3::new(-2.0, -2.0, 0.0), Vec3::X * 4.0, Vec3::Y * 4.0, floor);
        scene.lights.push(PunctualLight {
            kind: PunctualKind::Directional,
            position: Vec3::ZERO,
            direction: Vec3::NEG_Z,
            intensity: [2.0; 3],
            range_m: None,
        });
        let camera = view(2, 2, 0.005, DVec3::new(-1.5, -1.5, 0.5), DVec3::ZERO);
        let settings = LightSettings { samples_per_pixel: 4, max_bounces: 1, ..LightSettings::default() };
        let bare = render(&scene, &camera, &settings).radiance[(0, 0)];
        let mut light = sheet([0.9, 0.0, 0.1], factor, AlphaMode::Blend);
        light.base_color_texture = texel.and_then(|a| one_texel(&mut scene, [255, 255, 255, a]));
        let sheet = material(&mut scene, light);
        quad(&mut scene, Vec3::new(-1.0, -1.0, 1.0), Vec3::X * 2.0, Vec3::Y * 2.0, sheet);
        if let Some(a) = vertex {
            scene.colors = vec![[1.0; 4]; 4];
            scene.colors.extend([[1.0, 1.0, 1.0, a]; 4]);
        }
        let frame = render(&scene, &camera, &settings);
        for c in 0..3 {
            let (got, expected) = (frame.radiance[(0, 0)][c], passed * bare[c]);
            assert!((got - expected).abs() < 1e-5, "{factor} {texel:?} {vertex:?}: {got}, exactly {expected}");
        }
    }
}

#[test]
fn a_mask_holds_the_whole_product_of_alphas_against_its_cutoff() {
    let mask = AlphaMode::Mask { cutoff: 0.5 };
    for (factor, texel, vertex, there) in [
        (0.4, None, None, false),
        (0.6, None, None, true),
        (0.6, Some(255), None, true),
        (0.6, Some(200), None, false),
        (1.0, Some(128), None, true),
        (1.0, Some(126), None, false),
        (1.0, None, Some(0.4), false),
    ] {
        let (mut scene, camera) = above(sheet([0.0; 3], factor, mask));
        scene.materials[0].light.base_color_texture = texel.and_then(|a| one_texel(&mut scene, [255, 255, 255, a]));
        scene.colors = vertex.map_or(Vec::new(), |a| vec![[1.0, 1.0, 1.0, a]; 4]);
        let frame = render(&scene, &camera, &LightSettings { samples_per_pixel: 4, ..against_background(1) });
        let expected = if there { 0.0 } else { 1.0 };
        assert!((statistics(&frame).0 - expected).abs() < 1e-3, "{factor} {texel:?} {vertex:?}");
        assert_eq!(frame.depth_m[(0, 0)].is_finite(), there, "{factor} {texel:?} {vertex:?}");
    }
}

#[test]
fn depth_and_surface_are_those_of_what_is_at_least_half_there() {
    for (alpha, there) in [(0.2, false), (0.49, false), (0.5, true), (0.8, true)] {
        let (scene, camera) = above(sheet([0.5; 3], alpha, AlphaMode::Blend));
        let frame = render(&scene, &camera, &LightSettings { samples_per_pixel: 1, ..LightSettings::default() });
        assert_eq!(frame.surface[(0, 0)] == 0, there, "{alpha}");
        assert_eq!((frame.depth_m[(0, 0)] - 2.0).abs() < 1e-5, there, "{alpha}");
    }
}

#[test]
fn vertex_colours_multiply_the_base_colour_and_are_interpolated() {
    let (mut scene, _) = above(sheet([1.0, 0.5, 0.25], 1.0, AlphaMode::Opaque));
    // Red grows along x, green along y, blue is as it was; corners (−1, −1), (1, −1), (1, 1), (−1, 1).
    scene.colors = vec![[0.0, 0.0, 1.0, 1.0], [1.0, 0.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 1.0, 1.0]];
    for (x, y) in [(0.3f64, -0.4f64), (-0.7, 0.2), (0.9, 0.8)] {
        let camera = view(1, 1, 0.01, DVec3::new(x, y, 3.0), DVec3::new(x, y, 0.0));
        let frame = render(&scene, &camera, &LightSettings { samples_per_pixel: 1, ..LightSettings::default() });
        let expected = [0.5 * (x + 1.0), 0.25 * (y + 1.0), 0.25];
        for c in 0..3 {
            let got = f64::from(frame.albedo[(0, 0)][c]);
            assert!((got - expected[c]).abs() < 1e-3, "({x}, {y}) channel {c}: {got}, exactly {}", expected[c]);
        }
    }
}

#[test]
fn both_estimators_agree_through_blended_sheets_and_emitters() {
    let mut scene = Scene::default();
    let wall = diffuse(&mut scene, 0.6);
    let light = material(
        &mut scene,
        LightMaterial { emissive: [12.0; 3], double_sided: false, ..sheet([0.2; 3], 0.6, AlphaMode::Blend) },
    );
    let smoked = material(&mut scene, sheet([0.0; 3], 0.4, AlphaMode::Blend));
    // Glass of which a part is there: what is there transmits, the rest is a hole.
    let pane = material(
        &mut scene,
        LightMaterial { transmission: 0.85, ior: 1.5, roughness: 0.0, ..sheet([0.5, 0.9, 0.8], 0.7, AlphaMode::Blend) },
    );
    room(&mut scene, Vec3::ZERO, Vec3::new(3.0, 3.0, 2.5), wall);
    quad(&mut scene, Vec3::new(0.6, 0.6, 2.45), Vec3::Y * 1.8, Vec3::X * 1.8, light);
    quad(&mut scene, Vec3::new(0.3, 0.3, 2.1), Vec3::X * 2.4, Vec3::Y * 2.4, pane);
    quad(&mut scene, Vec3::new(0.7, 0.7, 1.2), Vec3::X * 1.6, Vec3::Y * 1.6, smoked);
    let camera = view(12, 9, 75.0, DVec3::new(0.3, 0.4, 1.4), DVec3::new(2.2, 2.0, 0.8));
    agree(&scene, &camera, 6);
}
