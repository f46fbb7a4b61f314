//! One camera path.

use super::sampler::Sampler;
use super::surface::{Cover, Fate, Surface, coverage, pane_transmittance};
use super::{LightSettings, LightTracer, RayCounts};
use crate::bvh::{Hit, Ray};
use glam::Vec3;

/// Pairs of the sampler: the place on the film, then a block per vertex.
pub(super) const FILM: u32 = 0;
pub(super) const FIRST_VERTEX: u32 = 1;
pub(super) const PAIRS_PER_VERTEX: u32 = 4;
pub(super) const PAIR_CHOICES: u32 = 0;
pub(super) const PAIR_LIGHT: u32 = 1;
pub(super) const PAIR_DIRECTION: u32 = 2;
pub(super) const PAIR_FATE: u32 = 3;
/// Panes and vertices of a path at most: a bound for rays caught between mirrors of glass.
pub(super) const MAX_EVENTS: u32 = 64;
/// No path survives roulette with more than this probability.
pub(super) const MAX_SURVIVAL: f32 = 0.95;

/// A ray whose direction was drawn with a lower density (1/sr) stands for a wide cone: what it meets is looked up coarsely.
pub(super) const WIDE_RAY_PDF: f32 = 10.0;

/// Contribution of one camera path to its pixel.
#[derive(Clone, Copy, Default)]
pub(super) struct PathSample {
    /// Radiance straight from an emitter or the background.
    pub emitted: Vec3,
    /// Radiance scattered at least once.
    pub scattered: Vec3,
    /// Reflectance and normal of what was seen first.
    pub albedo: Vec3,
    pub normal: Vec3,
}

/// w = p² / (p² + q²); an infinite p means the other technique cannot make this path.
pub(super) fn power_heuristic(p: f32, q: f32) -> f32 {
    if p.is_infinite() {
        return 1.0;
    }
    let ratio = q / p;
    1.0 / (1.0 + ratio * ratio)
}

impl LightTracer<'_> {
    /// The closest hit whose cover is `wanted` and of whose surface more than `least` is there.
    pub(super) fn closest_where(&self, ray: &Ray, least: f32, wanted: impl Fn(Cover) -> bool) -> Option<Hit> {
        if self.all_opaque {
            return self.bvh.intersect(ray);
        }
        self.bvh.intersect_where(ray, |hit| {
            let cover = self.cover(hit);
            wanted(cover) && (!cover.alpha || coverage(self.scene, hit.triangle, hit.u, hit.v) > least)
        })
    }

    pub(super) fn cover(&self, hit: &Hit) -> Cover {
        self.covers[hit.triangle as usize]
    }

    /// Share of light, per channel, that passes along a shadow ray.
    pub(super) fn transmittance(&self, ray: &Ray) -> Vec3 {
        if self.all_opaque {
            return if self.bvh.occluded(ray) { Vec3::ZERO } else { Vec3::ONE };
        }
        let mut share = Vec3::ONE;
        let blocked = self.bvh.occluded_where(ray, |hit| {
            let cover = self.cover(hit);
            if cover == Cover::OPAQUE {
                return true;
            }
            let there = if cover.alpha { coverage(self.scene, hit.triangle, hit.u, hit.v) } else { 1.0 };
            let through = if cover.pane { pane_transmittance(self.scene, hit, ray.direction) } else { Vec3::ZERO };
            if there >= 1.0 && !cover.pane {
                return true;
            }
            share *= if there >= 1.0 { through } else { Vec3::splat(1.0 - there) + through * there };
            false
        });
        if blocked { Vec3::ZERO } else { share }
    }

    /// Follows a camera ray.
    pub(super) fn trace(
        &self,
        camera_ray: Ray,
        sampler: &Sampler,
        settings: &LightSettings,
        counts: &mut RayCounts,
    ) -> PathSample {
        let mut out = PathSample::default();
        let mut ray = camera_ray;
        let mut throughput = Vec3::ONE;
        // Until the first surface that is no pane.
        let mut straight = true;
        let mut scattered = 0;
        // Density of the last scattering direction; infinite after the camera and mirrors, where emitters cannot be sampled.
        let mut pdf = f32::INFINITY;
        for event in 0..MAX_EVENTS {
            if event == 0 {
                counts.camera += 1;
            } else {
                counts.bounce += 1;
            }
            let Some(hit) = self.closest_where(&ray, 0.0, |_| true) else {
                // The background is uniform and only ever found by chance: full weight.
                out.add(throughput * Vec3::from(settings.background), straight);
                if straight {
                    out.albedo = Vec3::ONE;
                }
                return out;
            };
            let surface = Surface::at(self.scene, self.cover(&hit), &ray, &hit, None);
            if surface.emitted != Vec3::ZERO {
                let weight = if pdf.is_infinite() || !settings.next_event_estimation {
                    1.0
                } else {
                    // `ray.origin` is the last vertex even behind panes: straight passage moves t_min only.
                    let cos = surface.geometric_normal.dot(ray.direction).abs();
                    power_heuristic(pdf, self.emitters.pdf(ray.origin, &hit, hit.t, cos))
                };
                out.add(throughput * surface.emitted * (weight * surface.coverage), straight);
            }
            let dimension = FIRST_VERTEX + PAIRS_PER_VERTEX * event;
            let [number, roulette] = sampler.pair(dimension + PAIR_FATE);
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
                    if straight {
                        (out.albedo, out.normal) = (Vec3::ONE, surface.geometric_normal);
                    }
                    straight = false;
                    if scattered >= settings.max_bounces {
                        return out;
                    }
                    scattered += 1;
                    ray = surface.mirrored(&ray);
                    pdf = f32::INFINITY;
                    continue;
                }
                Fate::MeetsBase | Fate::Meets => {}
            }
            let (to_local, bsdf) = surface.reflection(&ray, fate);
            if straight {
                out.albedo = bsdf.albedo * throughput;
                out.normal = surface.normal;
                straight = false;
            }
            if scattered >= settings.max_bounces {
                return out;
            }
            scattered += 1;
            let [choice, lobe] = sampler.pair(dimension + PAIR_CHOICES);
            if settings.next_event_estimation && !self.emitters.is_empty() {
                let light = self.emitters.sample(
                    self.scene,
                    &self.covers,
                    surface.position,
                    choice,
                    sampler.pair(dimension + PAIR_LIGHT),
                );
                if let Some(light) = light {
                    let direction = light.to_light.normalize();
                    let (value, bsdf_pdf) = bsdf.evaluate(to_local * direction);
                    let weight = throughput * value * light.weight * power_heuristic(light.pdf, bsdf_pdf);
                    if weight != Vec3::ZERO && surface.geometric_normal.dot(direction) > 0.0 {
                        let from = surface.leave(direction);
                        counts.shadow += 1;
                        let passed = self.transmittance(&Ray::segment(from, surface.position + light.to_light));
                        out.add(weight * passed, false);
                    }
                }
            }
            let Some(next) = bsdf.sample(lobe, sampler.pair(dimension + PAIR_DIRECTION)) else { return out };
            let direction = (to_local.transpose() * next.l).normalize();
            if surface.geometric_normal.dot(direction) <= 0.0 {
                return out;
            }
            throughput *= next.weight;
            pdf = next.pdf;
            if scattered > settings.roulette_after {
                let survival = throughput.max_element().min(MAX_SURVIVAL);
                if roulette >= survival {
                    return out;
                }
                throughput /= survival;
            }
            ray = Ray::new(surface.leave(direction), direction);
        }
        out
    }
}

impl PathSample {
    fn add(&mut self, radiance: Vec3, straight: bool) {
        if !radiance.is_finite() {
            return;
        }
        if straight {
            self.emitted += radiance;
        } else {
            self.scattered += radiance;
        }
    }
}
