//! Indirect light at lattice points, gathered from the coarse solution.

use super::super::RayCounts;
use super::super::bsdf::sample_cosine;
use super::super::sampler::Sampler;
use super::field::{Point, Received, Tile, TileKey};
use super::site::{Site, openness};
use super::solve::spread;
use super::{FIRST_WALK_PAIR, LightCache, STAGE_GATHER};
use crate::bvh::Ray;
use glam::UVec2;

impl LightCache<'_> {
    /// A tile of indirect light.
    pub(super) fn gather_tile(&self, spacing_m: f32, key: &TileKey) -> Tile {
        let points = key.points;
        let values = (0..points.element_product())
            .map(|k| {
                let at = UVec2::new(k % points.x, k / points.x);
                Site::of(self.tracer, &self.charts, key, at, spacing_m)
                    .map_or(Point::default(), |site| self.gather(&site, spacing_m, key.number << 8 | u64::from(k)))
            })
            .collect();
        Tile { values, rough: 0 }
    }

    fn gather(&self, site: &Site, spacing_m: f32, point: u64) -> Point {
        let n = self.settings.gather_walks.max(1);
        let mut sampler = Sampler::new(self.settings.seed, STAGE_GATHER ^ u64::from(spacing_m.to_bits()) << 16, point);
        let mut sum = Received::default();
        let mut counts = RayCounts::default();
        let mut buried = 0;
        for k in 0..n {
            sampler.start(k);
            let direction = site.world_from_local * sample_cosine(sampler.pair(0));
            let start = Ray::new(site.start, direction);
            let walk =
                self.tracer.walk(start, spacing_m, &sampler, FIRST_WALK_PAIR, self.settings.background.into(), &mut counts);
            let mut light = walk.light;
            if let Some(end) = walk.end {
                let (received, _) = self.received(&end.surface, end.hit.triangle, f32::INFINITY);
                light += end.throughput * received.at(end.surface.normal);
            }
            buried += u32::from(walk.buried);
            let weight = site.bsdf.received(direction.dot(site.normal)) / n as f32;
            sum.add_scaled(&Received::from(spread(site.normal, direction), light), weight);
        }
        Point { received: sum, weight: openness(buried as f32 / n as f32) }
    }
}
