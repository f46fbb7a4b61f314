//! Light that arrives straight from emitters, worked out tile by tile.
//!
//! Each patch of an emitter is integrated by itself. Without obstacles its light is known in closed form; shadow rays only find out how
//! much of it is missing (a control variate: the closed form times a share β, plus the mean of what each ray found beyond that). The
//! share is what a few rays from the tile saw, the rays go where that is uncertain, and the sum is unbiased for any share.

use super::super::LightTracer;
use super::charts::Charts;
use super::field::{Point, Received, Tile, TileKey};
use super::site::{OPENNESS_RAYS, SEEN, Site, plastic};
use crate::bvh::Ray;
use corf_scene::Rng;
use glam::{UVec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Stages of [`Rng::keyed`].
const STAGE_PILOT: u64 = 0xd1_0001;
const STAGE_DIRECT: u64 = 0xd1_0002;
/// Tiles of at least so many points look at their emitters before the points do.
const PILOT_POINTS: usize = 16;
const PILOT_RAYS: u32 = 6;
/// Emitters below this share of the tile's light are neither looked at nor integrated in closed form.
const WORTH_A_LOOK: f32 = 2e-3;
/// Least weight of an emitter in a tile, as a share of the most it could send there: a tile's probes may all lie in its shade.
const LEAST_WORTH: f32 = 0.02;
/// Variance of visibility that is suspected where every pilot ray agreed.
const SUSPICION: f32 = 0.02;

/// A point that this share of its shadow rays reaches lies open.
const LIT_ENOUGH: f32 = 0.3;

/// Settings for filling a tile with direct light.
#[derive(Clone, Copy, Debug)]
pub(super) struct DirectSettings {
    pub seed: u64,
    /// Shadow rays a point.
    pub rays: u32,
    /// Distance of the lattice's points, metres.
    pub spacing_m: f32,
    /// A point's value is the mean of so many sites spread over its surroundings; otherwise that of the point itself.
    pub parts: Option<u32>,
    /// Lights without extent too; otherwise they are left to whoever looks.
    pub punctual: bool,
}

/// A patch, as a tile sees it.
struct Candidate {
    emitter: usize,
    /// Probability of asking it, cumulated.
    cumulative: f32,
    probability: f32,
    /// Share of its unshadowed light that is counted in closed form.
    beta: f32,
}

/// A tile's direct light; points in crevices have little weight.
pub(super) fn fill(tracer: &LightTracer<'_>, charts: &Charts, key: &TileKey, settings: &DirectSettings) -> Tile {
    let points = key.points;
    let stage = STAGE_DIRECT ^ u64::from(settings.spacing_m.to_bits()) << 32;
    let mut rngs: Vec<Rng> =
        (0..points.element_product()).map(|k| Rng::keyed(settings.seed ^ key.number, stage, u64::from(k))).collect();
    // What stands for each point, and how open it lies where that was asked.
    let sites: Vec<Vec<(Site, Option<f32>)>> = rngs
        .iter_mut()
        .enumerate()
        .map(|(k, rng)| {
            let point = UVec2::new(k as u32 % points.x, k as u32 / points.x);
            match settings.parts {
                None => Site::of(tracer, charts, key, point, settings.spacing_m).map(|site| (site, None)).into_iter().collect(),
                Some(parts) => {
                    let around = Site::around(tracer, charts, key, point, settings.spacing_m, parts, rng);
                    around.into_iter().map(|(site, open)| (site, Some(open))).collect()
                }
            }
        })
        .collect();
    // Buried sites say nothing about what lights the others.
    let is_open = |open: &Option<f32>| open.is_none_or(|open| open >= SEEN);
    let mut there: Vec<&Site> = sites.iter().flatten().filter(|(_, open)| is_open(open)).map(|(site, _)| site).collect();
    if there.is_empty() {
        there = sites.iter().flatten().map(|(site, _)| site).collect();
    }
    let candidates = candidates(tracer, &there, key, settings);
    let value = |(sites, rng): (&Vec<(Site, Option<f32>)>, &mut Rng)| {
        let rays = settings.rays.div_ceil(sites.len().max(1) as u32);
        Point::mean(sites.iter().map(|(site, open)| {
            let (received, lit) = at(tracer, site, &candidates, settings, rays, rng);
            let weight = match open {
                Some(open) => *open,
                None if lit >= LIT_ENOUGH => 1.0,
                None => site.openness(tracer, settings.spacing_m, OPENNESS_RAYS),
            };
            Point { received, weight }
        }))
    };
    let values = sites.iter().zip(&mut rngs).map(value).collect();
    Tile { values, rough: 0 }
}

/// The patches that may light a tile, with how often and how to ask them.
fn candidates(tracer: &LightTracer<'_>, sites: &[&Site], key: &TileKey, settings: &DirectSettings) -> Vec<Candidate> {
    let emitters = &tracer.emitters;
    let n = sites.len();
    if n == 0 {
        return Vec::new();
    }
    let probes = if n <= 2 {
        (0..n).collect()
    } else if n < 36 {
        vec![0, n / 2]
    } else {
        vec![0, n / 4, n / 2, 3 * n / 4, n - 1]
    };
    let (low, high) = sites.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), s| (l.min(s.position), h.max(s.position)));
    let worth: Vec<f32> = (0..emitters.len())
        .map(|i| {
            if emitters.is_punctual(i) {
                return 0.0;
            }
            let brightness = super::super::luminance(emitters.radiance(i));
            let seen: f32 = probes
                .iter()
                .map(|k| emitters.solid_angle_vector(i, sites[*k].position, sites[*k].normal).dot(sites[*k].normal).max(0.0))
                .sum();
            brightness * seen / probes.len() as f32 + LEAST_WORTH * emitters.importance_in(i, low, high)
        })
        .collect();
    let total: f32 = worth.iter().sum();
    let mut rng = Rng::keyed(settings.seed ^ key.number, STAGE_PILOT, u64::from(settings.spacing_m.to_bits()));
    let mut list = Vec::new();
    let mut sum = 0.0f64;
    for (emitter, worth) in worth.into_iter().enumerate().filter(|(_, w)| *w > 0.0) {
        let (mut beta, mut variance) = (0.0, 0.25);
        if worth > WORTH_A_LOOK * total {
            let centre = sites[n / 2].position;
            let prior = emitters.seen_from(centre, emitter);
            let (mut seen, mut asked) = (prior, 1.0);
            beta = prior;
            if n >= PILOT_POINTS {
                let mut visible = 0;
                for _ in 0..PILOT_RAYS {
                    let site = sites[rng.below(n)];
                    let u = [rng.uniform(), rng.uniform()];
                    let on_light = emitters.patch_toward(tracer.scene, &tracer.covers, emitter, site.position, u);
                    let passes = |to: Vec3| tracer.transmittance(&Ray::segment(site.start, to)).max_element() > 0.5;
                    visible += u32::from(on_light.is_some_and(|p| passes(p.position)));
                }
                beta = visible as f32 / PILOT_RAYS as f32;
                seen += visible as f32;
                asked += PILOT_RAYS as f32;
            }
            let share = seen / asked;
            variance = share * (1.0 - share) + SUSPICION;
        }
        let probability = worth * variance.sqrt();
        sum += f64::from(probability);
        list.push(Candidate { emitter, cumulative: sum as f32, probability, beta });
    }
    for c in &mut list {
        c.cumulative = (f64::from(c.cumulative) / sum) as f32;
        c.probability = (f64::from(c.probability) / sum) as f32;
    }
    list
}

/// Light at a site, and the share of its shadow rays that arrived.
fn at(
    tracer: &LightTracer<'_>,
    site: &Site,
    candidates: &[Candidate],
    settings: &DirectSettings,
    rays: u32,
    rng: &mut Rng,
) -> (Received, f32) {
    let emitters = &tracer.emitters;
    let mut sum = Received::default();
    let mut lit = 0.0;
    for c in candidates.iter().filter(|c| c.beta > 0.0) {
        let vector = emitters.solid_angle_vector(c.emitter, site.position, site.normal);
        sum.add_scaled(&Received::from(vector, emitters.radiance(c.emitter)), c.beta * FRAC_1_PI);
    }
    // Systematic sampling: each patch is asked as often as its probability says, to within one, at well-spread points.
    let n = rays.max(1);
    let start = rng.uniform();
    let shift = [rng.uniform(), rng.uniform()];
    let (mut next, mut within) = (0usize, 0u32);
    for j in 0..n {
        let at = (j as f32 + start) / n as f32;
        while next + 1 < candidates.len() && at >= candidates[next].cumulative {
            (next, within) = (next + 1, 0);
        }
        let Some(c) = candidates.get(next) else { break };
        let u = plastic(within, [shift[0] + 0.381_966 * next as f32, shift[1] + 0.723_6 * next as f32]);
        within += 1;
        let Some(p) = emitters.patch_toward(tracer.scene, &tracer.covers, c.emitter, site.position, u) else { continue };
        let direction = (p.position - site.position).normalize();
        let cos = direction.dot(site.normal);
        if cos <= 0.0 {
            continue;
        }
        let passed = tracer.transmittance(&Ray::segment(site.start, p.position));
        lit += f32::from(passed != Vec3::ZERO) / n as f32;
        let found = p.radiance * passed * site.bsdf.received(cos) - emitters.radiance(c.emitter) * c.beta;
        sum.add_scaled(&Received::from(direction, found), p.solid_angle * FRAC_1_PI / (c.probability * n as f32));
    }
    if settings.punctual {
        for (direction, irradiance) in emitters.punctual().filter_map(|i| emitters.punctual_at(i, site.position)) {
            let (to, direction) = (site.position + direction, direction.normalize());
            let cos = direction.dot(site.normal);
            if cos > 0.0 {
                let passed = tracer.transmittance(&Ray::segment(site.start, to));
                let weight = site.bsdf.received(cos) * FRAC_1_PI;
                sum.add_scaled(&Received::from(direction, irradiance * passed), weight);
            }
        }
    }
    (sum, lit)
}
