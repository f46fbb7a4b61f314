//! Rendering a camera's view from the light cache: camera paths are traced through mirrors, panes and highlights up to the first diffuse
//! surface, and more of them in pixels where they disagree (adaptive sampling).

use super::super::bsdf::Bsdf;
use super::super::develop::develop_value;
use super::super::path::{
    FILM, FIRST_VERTEX, MAX_EVENTS, PAIR_CHOICES, PAIR_DIRECTION, PAIR_FATE, PAIR_LIGHT, PAIRS_PER_VERTEX, WIDE_RAY_PDF,
};
use super::super::sampler::Sampler;
use super::super::surface::{Fate, Surface};
use super::super::{LightFrame, Pixel, RayCounts, camera_ray, in_rows, luminance};
use super::LightCache;
use crate::bvh::Ray;
use corf_scene::{Pinhole, Raster, Rigid3};
use glam::{Mat3, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Sampling of a camera's view rendered from the light cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewSettings {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Camera paths of every pixel; a power of two.
    pub samples_per_pixel: u32,
    /// Camera paths of a pixel whose paths disagree, at most; a power of two.
    pub most_samples: u32,
    /// Standard error of a developed pixel that is sought, as a share of white.
    pub error: f32,
    /// Exposure of the picture to be developed, EV: what that error is judged by.
    pub exposure_ev: f32,
}

impl Default for ViewSettings {
    fn default() -> Self {
        Self { seed: 0, samples_per_pixel: 4, most_samples: 64, error: 0.014, exposure_ev: 0.0 }
    }
}

/// A highlight is followed with this many times its share of the light as probability, at most 1.
const HIGHLIGHT_EFFORT: f32 = 4.0;
/// Least probability with which a highlight is followed, if it is followed at all.
const LEAST_EFFORT: f32 = 0.05;
/// Width of the cone a drawn direction of density p stands for: this over √p, radians.
const CONE: f32 = 0.5;
/// Largest number of punctual lights (without extent) that are all sampled; of more, one is drawn.
const FEW_PUNCTUAL: usize = 4;

/// Contribution of one camera path to its pixel.
#[derive(Clone, Copy, Default)]
struct Seen {
    radiance: Vec3,
    /// Whether the path saw an emitter or the background directly.
    lamp: bool,
    albedo: Vec3,
    normal: Vec3,
}

/// A pixel's running sums.
#[derive(Clone, Copy, Default)]
struct Sums {
    n: u32,
    radiance: Vec3,
    lamp: Vec3,
    lamps: u32,
    albedo: Vec3,
    normal: Vec3,
    /// Welford's mean and squares of the developed luminance.
    mean: f32,
    squares: f32,
}

impl Sums {
    fn add(&mut self, seen: &Seen, gain: f32) {
        self.n += 1;
        self.radiance += seen.radiance;
        if seen.lamp {
            self.lamp += seen.radiance;
            self.lamps += 1;
        }
        self.albedo += seen.albedo;
        self.normal += seen.normal;
        let value = develop_value(luminance(seen.radiance) * gain);
        let step = value - self.mean;
        self.mean += step / self.n as f32;
        self.squares += step * (value - self.mean);
    }

    /// Variance of one path's developed luminance.
    fn variance(&self) -> f32 {
        if self.n > 1 { self.squares / (self.n - 1) as f32 } else { 0.0 }
    }
}

impl LightCache<'_> {
    /// Renders the view of a camera. `frame_key` makes frames independent of each other; the same scene, settings and key give the same
    /// bytes on any number of threads and whatever was rendered before.
    pub fn render(&self, camera: &Pinhole, world_from_camera: &Rigid3, settings: &ViewSettings, frame_key: u64) -> LightFrame {
        let (width, height) = (camera.width, camera.height);
        let gain = settings.exposure_ev.exp2();
        let base = settings.samples_per_pixel.max(1);
        let view = View { cache: self, camera, world_from_camera, settings, frame_key, gain };
        let (first, counts) = in_rows(width, height, |x, y, counts| view.more(Sums::default(), x, y, base, counts));
        let (pixels, more) = in_rows(width, height, |x, y, counts| {
            let sums = view.more(first[(x, y)], x, y, view.wanted(&first, x, y), counts);
            let share = 1.0 / sums.n.max(1) as f32;
            let (depth_m, surface) = self.tracer.centre(camera, world_from_camera, x, y, counts);
            Pixel {
                radiance: sums.radiance * share,
                lamp: (sums.lamp * share).extend(sums.lamps as f32 * share),
                albedo: sums.albedo * share,
                normal: sums.normal * share,
                depth_m,
                surface,
            }
        });
        LightFrame::of(camera, world_from_camera, &pixels, counts.and(&more))
    }

    /// Follows a camera ray whose pixel spans `pixel_rad` radians.
    fn follow(&self, camera_ray: Ray, pixel_rad: f32, sampler: &Sampler, counts: &mut RayCounts) -> Seen {
        let tracer = self.tracer;
        let mut out = Seen::default();
        let mut ray = camera_ray;
        let mut throughput = Vec3::ONE;
        let mut straight = true;
        // Density of the last direction where its vertex asked emitters too; and whether what the ray meets is looked up coarsely.
        let (mut pdf, mut wide) = (None, false);
        // Width of the ray's cone at its origin, metres, and how it grows.
        let (mut width_m, mut cone_rad) = (0.0f32, pixel_rad);
        for event in 0..MAX_EVENTS {
            if event == 0 {
                counts.camera += 1;
            } else {
                counts.bounce += 1;
            }
            let Some(hit) = tracer.closest_where(&ray, 0.0, |_| true) else {
                out.add(throughput * Vec3::from(self.settings.background));
                if straight {
                    (out.lamp, out.albedo) = (true, Vec3::ONE);
                }
                return out;
            };
            let surface = Surface::at(tracer.scene, tracer.cover(&hit), &ray, &hit, wide.then_some(&tracer.coarse));
            let dimension = FIRST_VERTEX + PAIRS_PER_VERTEX * event;
            let [number, roulette] = sampler.pair(dimension + PAIR_FATE);
            let fate = surface.fate(&ray, number);
            if surface.emitted != Vec3::ZERO && fate != Fate::Absent {
                out.add(throughput * surface.emitted * tracer.chance_weight(&surface, &ray, &hit, pdf));
                out.lamp |= straight;
            }
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
                    width_m += cone_rad * hit.t;
                    ray = surface.mirrored(&ray);
                    pdf = None;
                    continue;
                }
                Fate::MeetsBase | Fate::Meets => {}
            }
            width_m += cone_rad * hit.t;
            let (to_local, bsdf) = surface.reflection(&ray, fate);
            if straight {
                out.albedo = bsdf.albedo * throughput;
                out.normal = surface.normal;
                straight = false;
            }
            // Met by a wide ray, a weak highlight is as good as diffuse; a very wide one is read off the received light in any case.
            let folded = wide && bsdf.is_nearly_diffuse();
            let wide_highlight = if folded { None } else { bsdf.wide_highlight() };
            let base = throughput * if folded { bsdf.albedo } else { bsdf.diffuse_toward_viewer() };
            if base != Vec3::ZERO {
                let (received, has_punctual) = self.received(&surface, hit.triangle, width_m);
                out.add(base * received.at(surface.normal));
                if let Some((axis, albedo)) = wide_highlight {
                    let world = to_local.transpose() * axis;
                    out.add(throughput * albedo * received.at(world) / axis.z);
                }
                if !has_punctual {
                    let [_, choice] = sampler.pair(dimension + PAIR_CHOICES);
                    let light = self.punctual(&surface, &to_local, &bsdf, wide_highlight.is_some(), choice, counts);
                    out.add(throughput * light);
                }
            }
            let keep = (HIGHLIGHT_EFFORT * bsdf.specular_share() * luminance(throughput)).clamp(LEAST_EFFORT, 1.0);
            if folded || wide_highlight.is_some() || bsdf.specular_share() <= 0.0 || roulette >= keep {
                return out;
            }
            throughput /= keep;
            let asks = tracer.asks_emitters(&bsdf);
            if asks {
                let [choice, _] = sampler.pair(dimension + PAIR_CHOICES);
                let u = sampler.pair(dimension + PAIR_LIGHT);
                out.add(throughput * tracer.highlight(&surface, &to_local, &bsdf, choice, u, counts));
            }
            let Some(next) = bsdf.sample_specular(sampler.pair(dimension + PAIR_DIRECTION)) else { return out };
            let direction = (to_local.transpose() * next.l).normalize();
            if surface.geometric_normal.dot(direction) <= 0.0 {
                return out;
            }
            throughput *= next.weight;
            pdf = asks.then_some(next.pdf);
            wide |= next.pdf < WIDE_RAY_PDF;
            cone_rad = cone_rad.max(CONE / next.pdf.sqrt());
            ray = Ray::new(surface.leave(direction), direction);
        }
        out
    }

    /// Radiance reflected from punctual lights, the surface's highlight included where no path follows it: by one shadow ray for each
    /// light; of many lights, one is drawn by its unshadowed share.
    fn punctual(
        &self,
        surface: &Surface,
        to_local: &Mat3,
        bsdf: &Bsdf,
        with_highlight: bool,
        u: f32,
        counts: &mut RayCounts,
    ) -> Vec3 {
        let emitters = &self.tracer.emitters;
        let arriving = |i: usize| {
            let (to_light, irradiance) = emitters.punctual_at(i, surface.position)?;
            let direction = to_light.normalize();
            let local = *to_local * direction;
            let above = local.z > 0.0 && direction.dot(surface.geometric_normal) > 0.0;
            let diffuse = bsdf.diffuse_toward_viewer() * (local.z * bsdf.received(local.z) * FRAC_1_PI);
            let value = if with_highlight { diffuse + bsdf.evaluate_specular(local).0 } else { diffuse };
            above.then(|| (to_light, irradiance * value))
        };
        let mut passed = |to_light: Vec3, light: Vec3| {
            counts.shadow += 1;
            light * self.tracer.transmittance(&Ray::segment(surface.leave(to_light), surface.position + to_light))
        };
        if emitters.punctual().len() <= FEW_PUNCTUAL {
            return emitters.punctual().filter_map(arriving).map(|(to, light)| passed(to, light)).sum();
        }
        let total: f32 = emitters.punctual().filter_map(arriving).map(|(_, light)| luminance(light)).sum();
        let mut left = u * total;
        for (to, light) in emitters.punctual().filter_map(arriving) {
            let share = luminance(light);
            if left < share {
                return passed(to, light) * (total / share);
            }
            left -= share;
        }
        Vec3::ZERO
    }
}

impl Seen {
    fn add(&mut self, radiance: Vec3) {
        if radiance.is_finite() {
            self.radiance += radiance;
        }
    }
}

/// A frame being rendered.
struct View<'a> {
    cache: &'a LightCache<'a>,
    camera: &'a Pinhole,
    world_from_camera: &'a Rigid3,
    settings: &'a ViewSettings,
    frame_key: u64,
    gain: f32,
}

impl View<'_> {
    /// Follows more paths of a pixel until it has `wanted`.
    fn more(&self, mut sums: Sums, x: usize, y: usize, wanted: u32, counts: &mut RayCounts) -> Sums {
        let mut sampler = Sampler::new(self.settings.seed, self.frame_key, (y * self.camera.width + x) as u64);
        let pixel_rad = (1.0 / self.camera.fx) as f32;
        while sums.n < wanted {
            sampler.start(sums.n);
            let ray = camera_ray(self.camera, self.world_from_camera, x, y, sampler.pair(FILM));
            let seen = self.cache.follow(ray, pixel_rad, &sampler, counts);
            sums.add(&seen, self.gain);
        }
        sums
    }

    /// Paths that a pixel wants, by how much its own and its neighbours' disagree.
    fn wanted(&self, sums: &Raster<Sums>, x: usize, y: usize) -> u32 {
        let (width, height) = (sums.width(), sums.height());
        let (mut total, mut count) = (0.0, 0.0);
        for j in y.saturating_sub(1)..(y + 2).min(height) {
            for i in x.saturating_sub(1)..(x + 2).min(width) {
                total += sums[(i, j)].variance();
                count += 1.0;
            }
        }
        let variance = sums[(x, y)].variance().max(total / count);
        let needed = variance / (self.settings.error * self.settings.error);
        let base = self.settings.samples_per_pixel.max(1);
        let mut n = base;
        while (n as f32) < needed && n < self.settings.most_samples {
            n *= 2;
        }
        n
    }
}
