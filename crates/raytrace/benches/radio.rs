//! 60 GHz: receiver positions per second, stage by stage, in the lobby (or, without it, nothing but a note).
//!
//! `cargo bench -p corf-raytrace --bench radio`; elements are receiver positions. Transmitter-side work, shared by all of them, is timed
//! on its own.

#![allow(clippy::print_stdout, clippy::print_stderr)]

use corf_raytrace::Bvh;
use corf_raytrace::radio::{Arrival, DiffuseField, DiffuseSettings, RadioSettings, RadioTracer, WorldExtent};
use corf_raytrace::spectrum::{self, SpectrumSettings};
use corf_scene::config::{DatasetConfig, SpectrumKind};
use corf_scene::trajectory;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use std::path::Path;

fn radio(c: &mut Criterion) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/lobby-mini.toml");
    let Ok(config) = DatasetConfig::load(&file) else { return println!("no {}: nothing to time", file.display()) };
    let loaded = config.load_scene_config().and_then(|s| s.load_scene().map(|(scene, _)| (s, scene)));
    let (scene_config, scene) = match loaded {
        Ok(loaded) => loaded,
        Err(error) => return println!("nothing to time: {error}"),
    };
    let Some(loop_config) = &scene_config.trajectory else { return println!("no trajectory: nothing to time") };
    let Ok(poses) = trajectory::generate(loop_config, 8) else { return println!("the trajectory is not valid") };
    let bvh = Bvh::build(&scene);
    let Ok(tracer) = RadioTracer::new(&scene, &bvh, RadioSettings::default()) else { return println!("no radio materials") };
    let tx = scene_config.transmitter.position();
    let (Ok(transmitter), Ok(field)) = (tracer.transmitter(tx), DiffuseField::new(&tracer, tx, &DiffuseSettings::default()))
    else {
        return println!("the transmitter is not valid");
    };
    let camera = config.radio_camera();

    let mut group = c.benchmark_group("radio");
    group.sample_size(10);
    group.bench_function("transmitter: candidate chains", |b| b.iter(|| black_box(tracer.transmitter(black_box(tx)))));
    group.throughput(Throughput::Elements(poses.len() as u64));
    group.bench_function("specular and transmitted paths, depth 3", |b| {
        b.iter(|| poses.iter().for_each(|p| drop(black_box(transmitter.paths(p.world_from_camera.translation)))));
    });
    group.bench_function("diffuse field for one view (patches warm)", |b| {
        b.iter(|| {
            poses.iter().for_each(|p| {
                drop(black_box(field.gather(
                    p.world_from_camera.translation,
                    field.antenna(),
                    &WorldExtent::View { camera, world_from_camera: p.world_from_camera },
                )))
            })
        });
    });
    let arrivals: Vec<Vec<Arrival>> = poses
        .iter()
        .map(|p| {
            field
                .gather(
                    p.world_from_camera.translation,
                    field.antenna(),
                    &WorldExtent::View { camera, world_from_camera: p.world_from_camera },
                )
                .unwrap_or_default()
        })
        .collect();
    group.bench_function("mpc spectrum", |b| {
        b.iter(|| {
            poses.iter().zip(&arrivals).for_each(|(p, a)| drop(black_box(spectrum::mpc(a, &camera, &p.world_from_camera, 1.0))));
        });
    });
    let beams = [
        ("bartlett", SpectrumKind::Bartlett),
        ("bartlett-coherent", SpectrumKind::BartlettCoherent),
        ("mvdr", SpectrumKind::Mvdr),
    ];
    let port_pairs: Vec<Vec<Vec<Arrival>>> = arrivals.into_iter().map(|a| vec![a]).collect();
    for (name, kind) in beams {
        let settings = SpectrumSettings { kind, ..SpectrumSettings::new(&config.radio, &scene_config.receiver, config.seed) };
        group.bench_function(format!("{name} spectrum"), |b| {
            b.iter(|| {
                poses.iter().zip(&port_pairs).for_each(|(p, l)| drop(black_box(settings.form(l, &camera, &p.world_from_camera))));
            });
        });
    }
    group.finish();
}

criterion_group!(benches, radio);
criterion_main!(benches);
