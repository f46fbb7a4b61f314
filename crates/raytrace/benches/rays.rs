//! Rays per second on one core: camera rays (coherent), bounce rays (cosine-distributed from first hits) and shadow rays (towards
//! random points under the ceiling).
//!
//! `cargo bench -p corf-raytrace --bench rays`; Mrays/s are printed as Melem/s. `scenes/lobby.glb` is timed too where it exists.

#![allow(clippy::print_stdout, clippy::print_stderr)]

mod test_rays;
mod test_room;

use corf_raytrace::Bvh;
use corf_scene::Scene;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;

fn bench_scene(c: &mut Criterion, name: &str, scene: &Scene) {
    let bvh = Bvh::build(scene);
    let [primary, bounce, shadow] = test_rays::rays(scene, &bvh);
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
