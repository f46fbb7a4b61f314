//! Time of a query to a radio field that knows its array, at poses of its own: `cargo bench -p corf --bench array`.
//!
//! As many emitters as `corf-array` has after 40 keyframes of lobby-mini (100 sources, 4 000 surface points) and after 147 of the whole loop (500, 40 000),
//! 30 and 130 anchors, looked at over 96×64 and 300×200 pixels as an 8×8 array sees them.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

use corf::array::anchors::Anchors;
use corf::array::cloud::Cloud;
use corf::array::{ArrayField, SensorSettings};
use corf_scene::{Pinhole, Rigid3, Rng};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;

fn cloud(count: usize, anchors: usize, seed: u64) -> Cloud<f32> {
    let mut rng = Rng::keyed(seed, 0, 0);
    Cloud {
        position: (0..count).map(|_| [20.0, 16.0, 4.0].map(|side| side * rng.uniform())).collect(),
        gain: (0..count).map(|_| -20.0 + 4.0 * rng.uniform()).collect(),
        seen_from: (0..anchors).map(|_| (0..count).map(|_| rng.uniform() - 0.5).collect()).collect(),
    }
}

fn field(sources: usize, points: usize, anchors: usize, camera: Pinhole) -> ArrayField {
    let along = |i: usize| DVec3::new(4.0 + 12.0 * i as f64 / anchors as f64, 8.0, 1.5);
    ArrayField {
        sensor: SensorSettings::Beam { elements: [8, 8], spacing_wavelengths: [0.5, 0.5], gated: true },
        camera,
        half_space: true,
        over_splats: false,
        most_power: None,
        extent_m: 0.06,
        anchors: Anchors { positions_m: (0..anchors).map(along).collect(), width_m: 0.5 },
        sources: cloud(sources, anchors, 1),
        points: cloud(points, anchors, 2),
    }
}

fn queries(c: &mut Criterion) {
    let mut group = c.benchmark_group("query");
    group.throughput(Throughput::Elements(1));
    for (name, sources, points, anchors) in [("lobby-mini", 100, 4_000, 30), ("loop", 500, 40_000, 130)] {
        for (width, height) in [(96, 64), (300, 200)] {
            let camera = Pinhole::from_horizontal_fov(width, height, 90.0);
            let field = field(sources, points, anchors, camera);
            let sensor = field.sensor.build::<f64>(&camera);
            let mut k = 0;
            group.bench_function(format!("{name} {width}x{height}"), |b| {
                b.iter(|| {
                    k += 1;
                    let place = DVec3::new(4.0 + 12.0 * f64::from(k % 100) / 100.0, 8.0, 1.5);
                    field.observe(&sensor, &Rigid3::looking_at(place, place + DVec3::new(1.0, 0.3, 0.0), DVec3::Z))
                });
            });
        }
    }
}

criterion_group!(benches, queries);
criterion_main!(benches);
