//! Rays per second on one core: camera rays (coherent), bounce rays (cosine-distributed from first hits) and shadow rays (towards
//! random points under the ceiling).
//!
//! `cargo bench -p corf-raytrace --bench rays`; Mrays/s are printed as Melem/s. `scenes/lobby.glb` is timed too where it exists.

#![allow(clippy::print_stdout, clippy::print_stderr)]

mod test_room;

use corf_raytrace::{Bvh, Hit, Ray};
use corf_scene::{Pinhole, Rigid3, Rng, Scene};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec3, Vec3};
use std::hint::black_box;

const WIDTH: usize = 384;
const HEIGHT: usize = 216;

/// Rays of the three kinds, in the order a renderer would shoot them.
fn rays(scene: &Scene, bvh: &Bvh) -> [Vec<Ray>; 3] {
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

fn bench_scene(c: &mut Criterion, name: &str, scene: &Scene) {
    let bvh = Bvh::build(scene);
    let [primary, bounce, shadow] = rays(scene, &bvh);
    let mut group = c.benchmark_group(format!("{name}, {} triangles", scene.triangles.len()));
    group.sample_size(10).measurement_time(std::time::Duration::from_secs(3)).warm_up_time(std::time::Duration::from_secs(1));
    for (kind, rays) in [("camera", &primary), ("bounce", &bounce)] {
        group.throughput(Throughput::Elements(rays.len() as u64));
        group.bench_function(kind, |b| b.iter(|| rays.iter().filter(|r| bvh.intersect(black_box(r)).is_some()).count()));
    }
    group.throughput(Throughput::Elements(shadow.len() as u64));
    group.bench_function("shadow", |b| b.iter(|| shadow.iter().filter(|r| bvh.occluded(black_box(r))).count()));
    group.bench_function("build", |b| b.iter(|| Bvh::build(black_box(scene))));
    group.finish();
}

fn all(c: &mut Criterion) {
    bench_scene(c, "test room", &test_room::test_room());
    let lobby = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/lobby.glb");
    if lobby.exists() {
        match corf_scene::import::load(&lobby) {
            Ok(scene) => bench_scene(c, "lobby", &scene),
            Err(error) => eprintln!("the lobby is left out: {error}"),
        }
    }
}

criterion_group!(benches, all);
criterion_main!(benches);
