//! A ray's way through mirrors, panes and highlights to the first surface whose diffuse light is known.

use super::super::bsdf::Bsdf;
use super::super::path::{MAX_EVENTS, PAIR_CHOICES, PAIR_DIRECTION, PAIR_FATE, PAIR_LIGHT, PAIRS_PER_VERTEX, power_heuristic};
use super::super::sampler::Sampler;
use super::super::surface::{Fate, Surface};
use super::super::{LightTracer, RayCounts};
use crate::bvh::{Hit, Ray};
use glam::{Mat3, Vec3};

/// Highlights of at least this `roughness²` are looked for by asking emitters too; narrower ones by chance alone, which finds all but lights without
/// extent.
const ROUGH_ALPHA: f32 = 0.02;
/// Walks of indirect light change from highlight to highlight at most so often.
const MAX_HIGHLIGHTS: u32 = 6;

/// End of a random walk: a diffuse surface, and the throughput up to there.
#[derive(Clone, Copy, Debug)]
pub(super) struct WalkEnd {
    pub hit: Hit,
    pub surface: Surface,
    /// Share of the surface's received light that arrives where the walk began.
    pub throughput: Vec3,
}

/// Outcome of a random walk.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Walk {
    /// Light met on the way: emitters seen in mirrors and highlights, and the background.
    pub light: Vec3,
    pub end: Option<WalkEnd>,
    /// Whether the first surface met hides the point where the walk began ([`LightTracer::buries`]).
    pub buried: bool,
}

impl LightTracer<'_> {
    /// Light of emitters in a surface's highlight, by asking one of them; weighted against finding it by chance.
    pub(super) fn highlight(
        &self,
        surface: &Surface,
        to_local: &Mat3,
        bsdf: &Bsdf,
        choice: f32,
        u: [f32; 2],
        counts: &mut RayCounts,
    ) -> Vec3 {
        let Some(light) = self.emitters.sample(self.scene, &self.covers, surface.position, choice, u) else { return Vec3::ZERO };
        let direction = light.to_light.normalize();
        let (value, pdf) = bsdf.evaluate_specular(*to_local * direction);
        let weight = value * light.weight * power_heuristic(light.pdf, pdf);
        if weight == Vec3::ZERO || surface.geometric_normal.dot(direction) <= 0.0 {
            return Vec3::ZERO;
        }
        counts.shadow += 1;
        weight * self.transmittance(&Ray::segment(surface.leave(direction), surface.position + light.to_light))
    }

    /// Whether a highlight is looked for by asking emitters.
    pub(super) fn asks_emitters(&self, bsdf: &Bsdf) -> bool {
        bsdf.alpha() >= ROUGH_ALPHA && !self.emitters.is_empty() || self.emitters.has_punctual()
    }

    /// Weight of an emitter met by chance at a hit, when the ray's direction was drawn with density `pdf` from a vertex that asked
    /// emitters too (`None`: it did not).
    pub(super) fn chance_weight(&self, surface: &Surface, ray: &Ray, hit: &Hit, pdf: Option<f32>) -> f32 {
        pdf.map_or(1.0, |pdf| {
            let cos = surface.geometric_normal.dot(ray.direction).abs();
            power_heuristic(pdf, self.emitters.pdf(ray.origin, hit, hit.t, cos))
        })
    }

    /// Follows a ray that left a diffuse surface. Emitters met before anything but panes are not counted: they are direct light.
    /// `near_m` is what [`Walk::buried`] takes for near.
    pub(super) fn walk(
        &self,
        start: Ray,
        near_m: f32,
        sampler: &Sampler,
        first_pair: u32,
        background: Vec3,
        counts: &mut RayCounts,
    ) -> Walk {
        let mut out = Walk::default();
        let mut ray = start;
        let mut throughput = Vec3::ONE;
        let mut highlights = 0;
        let mut is_direct = true;
        let mut pdf = None;
        for event in 0..MAX_EVENTS {
            counts.bounce += 1;
            let Some(hit) = self.closest_where(&ray, 0.0, |_| true) else {
                out.light += throughput * background;
                return out;
            };
            let surface = Surface::at(self.scene, self.cover(&hit), &ray, &hit, Some(&self.coarse));
            if surface.emitted != Vec3::ZERO && !is_direct {
                let weight = self.chance_weight(&surface, &ray, &hit, pdf) * surface.coverage;
                out.light += throughput * surface.emitted * weight;
            }
            let dimension = first_pair + PAIRS_PER_VERTEX * event;
            let [number, lobe] = sampler.pair(dimension + PAIR_FATE);
            let fate = surface.fate(&ray, number);
            match fate {
                Fate::Absent => {
                    ray.t_min = surface.beyond(&hit);
                    continue;
                }
                Fate::Passes => {
                    throughput *= surface.base_color;
                    ray.t_min = surface.beyond(&hit);
                    continue;
                }
                Fate::Mirrored => {
                    ray = surface.mirrored(&ray);
                    (is_direct, pdf) = (false, None);
                    continue;
                }
                Fate::MeetsBase | Fate::Meets => {}
            }
            if is_direct {
                out.buried = self.buries(&ray, &hit, near_m);
            }
            let (to_local, bsdf) = surface.reflection(&ray, fate);
            let share = bsdf.specular_share();
            let folded = bsdf.is_nearly_diffuse();
            let specular = if folded {
                0.0
            } else if share >= 1.0 {
                1.0
            } else {
                share.clamp(0.0, 0.9)
            };
            if lobe >= specular {
                let reflected = if folded { bsdf.albedo } else { bsdf.diffuse_toward_viewer() };
                let throughput = throughput * reflected / (1.0 - specular);
                out.end = (throughput != Vec3::ZERO).then_some(WalkEnd { hit, surface, throughput });
                return out;
            }
            if highlights >= MAX_HIGHLIGHTS {
                return out;
            }
            highlights += 1;
            throughput /= specular;
            let [choice, _] = sampler.pair(dimension + PAIR_CHOICES);
            let asks = self.asks_emitters(&bsdf);
            if asks {
                let u = sampler.pair(dimension + PAIR_LIGHT);
                out.light += throughput * self.highlight(&surface, &to_local, &bsdf, choice, u, counts);
            }
            let Some(next) = bsdf.sample_specular(sampler.pair(dimension + PAIR_DIRECTION)) else { return out };
            let direction = (to_local.transpose() * next.l).normalize();
            if surface.geometric_normal.dot(direction) <= 0.0 {
                return out;
            }
            throughput *= next.weight;
            (is_direct, pdf) = (false, asks.then_some(next.pdf));
            ray = Ray::new(surface.leave(direction), direction);
        }
        out
    }
}
