//! Gaussians of light that another program trained, as the beginning of a coupled field.

use crate::{Appearance, Gaussians, device::Planes, expansion::spawn::bilinear, files::ply::SingleModality, gaussians::SH_C0};
use corf_scene::{Pinhole, Rigid3};
use glam::DVec3;
use rayon::prelude::*;

/// A training keyframe's RF image and where it was taken.
#[derive(Clone, Debug)]
pub struct RadioView {
    /// Pose of the RF camera (OpenCV axes), metres.
    pub world_from_camera: Rigid3,
    /// The RF image in the channels of the field to be.
    pub radio: Planes,
}

/// Number of Gaussians whose centre lies in the image of one of the poses at least.
pub fn in_view(field: &SingleModality, camera: &Pinhole, poses: &[Rigid3]) -> usize {
    let inverse: Vec<Rigid3> = poses.iter().map(Rigid3::inverse).collect();
    let seen = |p: &[f32; 3]| inverse.iter().any(|pose| pixel(p, camera, pose).is_some());
    field.position.par_iter().filter(|p| seen(p)).count()
}

/// The field with RF attributes as Gaussians are born with: the opacity that light has, and the colour of an RF image in the direction of the
/// Gaussian, that of the nearest view whose RF image it lies in; `floor` where there is none. Channels and degrees are those of `none`: harmonics of
/// light beyond its degree are left out, those that `field` has not are zero.
pub fn coupled(
    field: &SingleModality,
    none: Gaussians,
    views: &[RadioView],
    radio_camera: &Pinhole,
    floor: [f32; 3],
) -> Gaussians {
    let mut out = none;
    let n = field.position.len();
    out.position.clone_from(&field.position);
    out.rotation.clone_from(&field.rotation);
    out.log_scale.clone_from(&field.log_scale);
    for a in [&mut out.light, &mut out.radio] {
        a.opacity_logit.clone_from(&field.appearance.opacity_logit);
        a.sh = vec![0.0; n * a.stride()];
    }
    let (stride, theirs) = (out.light.stride(), field.appearance.stride());
    let common = stride.min(theirs);
    for (to, from) in out.light.sh.chunks_exact_mut(stride).zip(field.appearance.sh.chunks_exact(theirs)) {
        to[..common].copy_from_slice(&from[..common]);
    }
    color_by_views(&mut out.radio, &field.position, views, radio_camera, floor);
    out
}

/// Gives Gaussians at these positions the RF colour of the nearest view whose RF image they lie in, from all sides alike; `floor` where there is none.
pub fn color_by_views(
    radio: &mut Appearance,
    position: &[[f32; 3]],
    views: &[RadioView],
    radio_camera: &Pinhole,
    floor: [f32; 3],
) {
    let (stride, channels) = (radio.stride(), radio.channels);
    radio.sh = vec![0.0; position.len() * stride];
    let inverse: Vec<Rigid3> = views.iter().map(|v| v.world_from_camera.inverse()).collect();
    radio.sh.par_chunks_exact_mut(stride).zip(position).for_each(|(sh, position)| {
        let color = nearest_color(position, views, &inverse, radio_camera).unwrap_or_else(|| floor[..channels].to_vec());
        for (value, color) in sh.iter_mut().zip(color) {
            *value = (color - 0.5) / SH_C0;
        }
    });
}

/// The RF colour of a point in the nearest view whose RF image it lies in; the first of several as near.
fn nearest_color(position: &[f32; 3], views: &[RadioView], inverse: &[Rigid3], camera: &Pinhole) -> Option<Vec<f32>> {
    let mut best: Option<(f64, usize, [f64; 2])> = None;
    for (i, pose) in inverse.iter().enumerate() {
        let Some((at, distance2)) = pixel(position, camera, pose) else { continue };
        if best.is_none_or(|b| distance2 < b.0) {
            best = Some((distance2, i, at));
        }
    }
    let (_, i, [u, v]) = best?;
    bilinear(&views[i].radio, u, v)
}

/// Where a point lies in an image, pixels, and its squared distance, m²; `None` behind the camera and outside of the image.
fn pixel(position: &[f32; 3], camera: &Pinhole, camera_from_world: &Rigid3) -> Option<([f64; 2], f64)> {
    let local = camera_from_world.transform_point(DVec3::from_array(position.map(f64::from)));
    let at = camera.project(local)?;
    let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < camera.width as f64 && at.y < camera.height as f64;
    inside.then(|| ([at.x, at.y], local.length_squared()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RadioTarget, ReconstructionConfig};

    fn camera() -> Pinhole {
        Pinhole::from_horizontal_fov(16, 16, 90.0)
    }

    /// A view at x = `x` that looks along world z, of one RF level.
    fn view(x: f64, level: f32) -> RadioView {
        let world_from_camera = Rigid3 { rotation: glam::DMat3::IDENTITY, translation: DVec3::new(x, 0.0, 0.0) };
        RadioView { world_from_camera, radio: Planes { width: 16, height: 16, channels: 1, pixels: vec![level; 256] } }
    }

    #[test]
    fn radio_begins_with_the_nearest_view_and_light_with_what_it_has() {
        let mut appearance = Appearance::empty(3, 2);
        appearance.opacity_logit = vec![1.0, 2.0, 3.0];
        appearance.sh = (0..81).map(|v| v as f32).collect();
        let field = SingleModality {
            position: vec![[0.0, 0.0, 2.0], [4.0, 0.0, 3.0], [0.0, 0.0, -5.0]],
            rotation: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            log_scale: vec![[-1.0; 3]; 3],
            appearance,
        };
        let views = [view(0.0, 0.25), view(4.0, 0.75)];
        let poses: Vec<Rigid3> = views.iter().map(|v| v.world_from_camera).collect();
        assert_eq!(in_view(&field, &camera(), &poses), 2, "one is behind both cameras");
        let config =
            ReconstructionConfig { radio_target: RadioTarget::Db, light_sh_degree: 1, radio_sh_degree: 1, ..Default::default() };
        let out = coupled(&field, config.empty_field(), &views, &camera(), [0.0; 3]);
        assert_eq!((out.light.sh.len(), out.radio.sh.len()), (3 * 12, 3 * 4));
        assert_eq!(out.light.sh[12..24], (27..39).map(|v| v as f32).collect::<Vec<_>>(), "bands 0 and 1 of the second");
        assert_eq!(out.radio.opacity_logit, [1.0, 2.0, 3.0]);
        let level = |i: usize| 0.5 + SH_C0 * out.radio.sh[4 * i];
        for (i, expected) in [0.25, 0.75, 0.0].into_iter().enumerate() {
            assert!((level(i) - expected).abs() < 1e-6, "{i}: {}", level(i));
        }
        assert!(out.radio.sh.chunks_exact(4).all(|sh| sh[1..] == [0.0; 3]));
        let wide = ReconstructionConfig { light_sh_degree: 3, ..config };
        let out = coupled(&field, wide.empty_field(), &[], &camera(), [0.0; 3]);
        assert_eq!(out.light.sh[26..48], [vec![26.0], vec![0.0; 21]].concat());
    }
}
