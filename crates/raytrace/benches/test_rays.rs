//! Rays to time with, the same in every bench.

use corf_raytrace::{Bvh, Hit, Ray};
use corf_scene::{Pinhole, Rigid3, Rng, Scene};
use glam::{DVec3, Vec3};

const WIDTH: usize = 384;
const HEIGHT: usize = 216;

/// Camera rays, bounce rays (cosine-distributed from where those hit) and shadow segments (from there to points under the ceiling), in
/// the order a renderer would shoot them.
pub fn rays(scene: &Scene, bvh: &Bvh) -> [Vec<Ray>; 3] {
    let Some(bounds) = scene.bounds() else { return Default::default() };
    let size = bounds.max - bounds.min;
    let eye = bounds.min + size * Vec3::new(0.3, 0.3, 0.45);
    let target = bounds.min + size * Vec3::new(0.75, 0.8, 0.35);
    let camera = Pinhole::from_horizontal_fov(WIDTH, HEIGHT, 90.0);
    let pose = Rigid3::looking_at(eye.as_dvec3(), target.as_dvec3(), DVec3::Z);
    let mut rng = Rng::keyed(1, 2, 3);
    let [mut primary, mut bounce, mut shadow] = [Vec::new(), Vec::new(), Vec::new()];
    for i in 0..WIDTH * HEIGHT {
        let direction = pose.transform_vector(camera.pixel_direction(i % WIDTH, i / WIDTH)).as_vec3();
        let ray = Ray::new(eye, direction);
        primary.push(ray);
        let Some(Hit { t, triangle, .. }) = bvh.intersect(&ray) else { continue };
        let [a, b, c] = scene.corners(triangle as usize);
        let n = (b - a).cross(c - a).normalize_or_zero();
        let n = if n.dot(direction) > 0.0 { -n } else { n };
        let p = eye + direction * t + n * 1e-4;
        let (z, phi) = (1.0 - 2.0 * rng.uniform(), std::f32::consts::TAU * rng.uniform());
        let s = (1.0 - z * z).sqrt();
        bounce.push(Ray::new(p, (n + Vec3::new(s * phi.cos(), s * phi.sin(), z) * 0.9999).normalize()));
        let light = bounds.min + size * Vec3::new(0.1 + 0.8 * rng.uniform(), 0.1 + 0.8 * rng.uniform(), 0.98);
        shadow.push(Ray::segment(p, light));
    }
    [primary, bounce, shadow]
}
