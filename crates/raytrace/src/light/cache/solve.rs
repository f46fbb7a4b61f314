//! Light between diffuse surfaces, solved on a coarse lattice: every point follows some walks once, and what they carry is passed on
//! until nothing changes.

use super::super::bsdf::sample_cosine;
use super::super::sampler::Sampler;
use super::super::{LightTracer, RayCounts};
use super::charts::Charts;
use super::direct::{self, DirectSettings};
use super::field::{Field, Point, Received, Tile, TileKey};
use super::site::Site;
use super::{CacheSettings, FIRST_WALK_PAIR, STAGE_SOLVE};
use crate::bvh::Ray;
use corf_scene::Rng;
use glam::{Mat3, UVec2, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Sites that stand for the surroundings of a point of the coarse lattice.
const PARTS: u32 = 6;
/// Tiles that a thread takes at once: the largest charts come first, and would all be one thread's.
const AT_ONCE: usize = 16;
/// The solution stands when no pass moves its mean by more than this share.
const CONVERGED: f32 = 2e-4;
/// Tangential parts of received light divide by the elevation's cosine, no less than this.
const LEAST_COS: f32 = 0.1;

/// Transport from the end of a random walk to the lattice point where it began: the point at the end, and the throughput between them.
#[derive(Clone, Copy)]
pub(super) struct Link {
    /// Number of the point in the coarse lattice; `u32::MAX` where the walk found no diffuse surface.
    pub point: u32,
    /// Times the weight with which the beginning receives it.
    pub throughput: [f32; 3],
}

/// A point of the coarse lattice; by default one inside of a sealed body.
#[derive(Clone, Default)]
pub(super) struct Node {
    pub direct: Point,
    /// Light its walks met on the way, mean.
    pub met: Received,
    pub links: Vec<Link>,
}

/// Direct and indirect light at every point of a coarse lattice. `tell(done, all)` is told of the progress.
pub(super) fn solve(
    tracer: &LightTracer<'_>,
    charts: &Charts,
    spacing_m: f32,
    settings: &CacheSettings,
    report: &(dyn Fn(usize, usize) -> bool + Sync),
) -> Option<Field> {
    let mut field = Field::new(charts, spacing_m);
    let keys: Vec<_> = (0..field.len()).map(|i| field.key_of(charts, i)).collect();
    let mut first = Vec::with_capacity(keys.len());
    let mut total = 0u32;
    for key in &keys {
        first.push(total);
        total += key.points.element_product();
    }
    let direct =
        DirectSettings { seed: settings.seed, rays: settings.coarse_rays, spacing_m, parts: Some(PARTS), punctual: true };
    let done = AtomicUsize::new(0);
    let all = 2 * keys.len();
    let stopped = AtomicBool::new(false);
    let step = || {
        let now = 1 + done.fetch_add(1, Ordering::Relaxed);
        if now.is_multiple_of(256) && !report(now, all) {
            stopped.store(true, Ordering::Relaxed);
        }
        !stopped.load(Ordering::Relaxed)
    };
    let lit_directly = |key: &TileKey| match charts.is_sealed(key.chart, key.side) {
        true => Tile::dark(key.points),
        false => direct::fill(tracer, charts, key, &direct),
    };
    let tiles: Vec<Option<Tile>> = keys.par_iter().with_max_len(AT_ONCE).map(|key| step().then(|| lit_directly(key))).collect();
    let tiles: Vec<Tile> = tiles.into_iter().collect::<Option<_>>()?;
    for (number, tile) in tiles.into_iter().enumerate() {
        field.replace(number, tile);
    }
    let nodes: Vec<Option<Vec<Node>>> = keys
        .par_iter()
        .with_max_len(AT_ONCE)
        .enumerate()
        .map(|(number, key)| {
            step().then(|| {
                if charts.is_sealed(key.chart, key.side) {
                    return vec![Node::default(); key.points.element_product() as usize];
                }
                let directs = field.tile(number).map_or(&[][..], |tile| &tile.values);
                (0u32..)
                    .zip(directs)
                    .map(|(k, &direct)| {
                        let at = UVec2::new(k % key.points.x, k / key.points.x);
                        let (met, links) = walks(tracer, charts, &field, &first, key, at, first[number] + k, settings);
                        Node { direct, met, links }
                    })
                    .collect()
            })
        })
        .collect();
    let nodes: Vec<Node> = nodes.into_iter().collect::<Option<Vec<_>>>()?.into_iter().flatten().collect();
    pass_on(charts, &mut field, &nodes, settings);
    Some(field)
}

/// Passes light on between the points of the coarse lattice, tile by tile, and puts all of it into the field.
pub(super) fn pass_on(charts: &Charts, field: &mut Field, nodes: &[Node], settings: &CacheSettings) {
    let keys: Vec<TileKey> = (0..field.len()).map(|i| field.key_of(charts, i)).collect();
    let normals: Vec<Vec3> = keys
        .iter()
        .flat_map(|key| std::iter::repeat_n(charts.normal(key.chart, key.side), key.points.element_product() as usize))
        .collect();
    let passed_on = iterate(nodes, &normals, settings.max_passes);
    let totals: Vec<Point> = nodes
        .par_iter()
        .enumerate()
        .map(|(point, node)| total_at(node, normals[point], point as u32, &passed_on, settings))
        .collect();
    let mut rest = &totals[..];
    for (number, key) in keys.iter().enumerate() {
        let (values, others) = rest.split_at(key.points.element_product() as usize);
        field.replace(number, Tile { values: values.to_vec(), rough: 0 });
        rest = others;
    }
}

/// The direction of walk `k` of a point whose surface has a normal, and the sampler of the rest of it.
fn begin(normal: Vec3, point: u32, k: u32, settings: &CacheSettings) -> (Vec3, Sampler) {
    let mut sampler = Sampler::new(settings.seed, STAGE_SOLVE, u64::from(point));
    sampler.start(k);
    let (x, y) = normal.any_orthonormal_pair();
    (Mat3::from_cols(x, y, normal) * sample_cosine(sampler.pair(0)), sampler)
}

fn walks(
    tracer: &LightTracer<'_>,
    charts: &Charts,
    field: &Field,
    first: &[u32],
    key: &TileKey,
    at: UVec2,
    point: u32,
    settings: &CacheSettings,
) -> (Received, Vec<Link>) {
    let mut rng = Rng::keyed(settings.seed, STAGE_SOLVE, u64::from(point));
    let sites = Site::around(tracer, charts, key, at, field.spacing_m(), PARTS, &mut rng);
    let open: f32 = sites.iter().map(|(_, open)| open).sum();
    let normal = charts.normal(key.chart, key.side);
    let mut met = Received::default();
    if sites.is_empty() {
        return (met, Vec::new());
    }
    let mut counts = RayCounts::default();
    let links = (0..settings.coarse_walks)
        .map(|k| {
            let (site, own) = &sites[k as usize % sites.len()];
            let (direction, sampler) = begin(normal, point, k, settings);
            let start = Ray::new(site.start, direction);
            let walk = tracer.walk(start, 0.0, &sampler, FIRST_WALK_PAIR, settings.background.into(), &mut counts);
            // Sites count by how open they lie.
            let weight = site.bsdf.received(direction.dot(normal)) * own * sites.len() as f32 / open;
            met.add_scaled(&Received::from(spread(normal, direction), walk.light * weight), 1.0 / settings.coarse_walks as f32);
            let [number, _] = sampler.pair(1);
            walk.end.map_or(Link { point: u32::MAX, throughput: [0.0; 3] }, |end| {
                let (chart, side, at) = charts.locate(&end.surface, end.hit.triangle);
                let (tile, k) = field.pick(&charts.list[chart as usize], chart, side, at, number);
                Link { point: first[tile] + k, throughput: (end.throughput * weight).to_array() }
            })
        })
        .collect();
    (met, links)
}

/// The vector that stands for light out of a cosine-distributed direction: 1 along the normal, and so long across it that a mean over
/// directions is `∫ l dω / π`.
pub(super) fn spread(normal: Vec3, direction: Vec3) -> Vec3 {
    let cos = direction.dot(normal);
    normal + (direction - normal * cos) / cos.max(LEAST_COS)
}

/// Light received by every point along its normal after any number of diffuse reflections: the transport over all links is iterated until
/// the mean converges, `max_passes` times at most.
fn iterate(nodes: &[Node], normals: &[Vec3], max_passes: u32) -> Vec<Vec3> {
    let direct: Vec<Vec3> = nodes.iter().zip(normals).map(|(node, n)| node.direct.received.at(*n)).collect();
    let met: Vec<Vec3> = nodes.iter().zip(normals).map(|(node, n)| node.met.at(*n)).collect();
    let mut now = met.clone();
    let mut last = f64::MAX;
    for _ in 0..max_passes {
        let next: Vec<Vec3> = nodes
            .par_iter()
            .zip(&met)
            .map(|(node, met)| {
                let mut sum = Vec3::ZERO;
                for link in node.links.iter().filter(|l| l.point != u32::MAX) {
                    let there = link.point as usize;
                    sum += Vec3::from(link.throughput) * (direct[there] + now[there]);
                }
                *met + sum / node.links.len().max(1) as f32
            })
            .collect();
        now = next;
        let sum: f64 = now.iter().map(|v| f64::from(v.element_sum())).sum();
        if (sum - last).abs() <= f64::from(CONVERGED) * sum {
            break;
        }
        last = sum;
    }
    (0..nodes.len()).map(|i| direct[i] + now[i]).collect()
}

/// All light at a point, from what its walks' ends receive.
fn total_at(node: &Node, normal: Vec3, point: u32, received: &[Vec3], settings: &CacheSettings) -> Point {
    let mut sum = node.direct.received;
    sum.add_scaled(&node.met, 1.0);
    for (k, link) in node.links.iter().enumerate().filter(|(_, l)| l.point != u32::MAX) {
        let (direction, _) = begin(normal, point, k as u32, settings);
        let light = Vec3::from(link.throughput) * received[link.point as usize];
        sum.add_scaled(&Received::from(spread(normal, direction), light), 1.0 / settings.coarse_walks as f32);
    }
    Point { received: sum, weight: node.direct.weight }
}
