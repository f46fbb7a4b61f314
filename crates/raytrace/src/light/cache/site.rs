//! Sites of lattice points: their position on a chart, and the reflection of the surface there.

use super::super::LightTracer;
use super::super::bsdf::Bsdf;
use super::super::surface::{Surface, offset};
use super::charts::{Charts, FEW_TRIANGLES};
use super::field::TileKey;
use crate::bvh::{Hit, Ray};
use corf_scene::Rng;
use glam::{DVec3, Mat3, UVec2, Vec2, Vec3};

/// Lattice points are kept this share of their spacing off the edges of their surface. Light rises out of a corner about as the square
/// root of the distance; from a value taken a tenth of a cell in, linear interpolation has the cell's mean right.
const INSET: f32 = 0.11;

/// Rays that look around a point.
pub(super) const OPENNESS_RAYS: u32 = 12;
const FEW_OPENNESS_RAYS: u32 = 4;
/// Sites at least this open are seen by others; where there are none among the first, so many more are tried.
pub(super) const SEEN: f32 = 0.1;
const MORE_PARTS: u32 = 12;
/// Up to this share of the view may bury a point without making it doubtful (a corner of a room has two thirds of it), and from this on
/// it is not believed.
const OPEN: f32 = 0.6;
const BURIED: f32 = 0.9;

/// A lattice point on its surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Site {
    /// On the surface, metres.
    pub position: Vec3,
    /// Just off it, on the side of `normal`: where rays start.
    pub start: Vec3,
    /// Unit geometric normal on the site's side.
    pub normal: Vec3,
    /// World directions of a frame whose third axis is `normal`.
    pub world_from_local: Mat3,
    /// The reflection there; only what does not depend on the viewer is used.
    pub bsdf: Bsdf,
}

impl Site {
    /// The site of a tile's point; `None` where its chart has no surface nearby.
    pub fn of(tracer: &LightTracer<'_>, charts: &Charts, key: &TileKey, point: UVec2, spacing_m: f32) -> Option<Self> {
        let chart = &charts.list[key.chart as usize];
        let nominal = chart.position(key.lattice.coordinates(chart, key.first + point));
        Self::near(tracer, charts, key, nominal, spacing_m, INSET * spacing_m, f32::INFINITY)
    }

    /// Sites spread over the surroundings that a lattice point stands for, half a cell each way, with how far each is to be believed; the
    /// site of the point itself where its surroundings hold no surface.
    pub fn around(
        tracer: &LightTracer<'_>,
        charts: &Charts,
        key: &TileKey,
        point: UVec2,
        spacing_m: f32,
        count: u32,
        rng: &mut Rng,
    ) -> Vec<(Self, f32)> {
        let chart = &charts.list[key.chart as usize];
        let centre = key.lattice.coordinates(chart, key.first + point);
        let start = [rng.uniform(), rng.uniform()];
        let at = |k: u32| {
            let [x, y] = plastic(k, start);
            let at = centre + (Vec2::new(x, y) - 0.5) * key.lattice.pitch;
            // Beyond the edge it comes back, so that what lies along an edge counts in full.
            let at = at.abs().min(2.0 * chart.size - at);
            Self::near(tracer, charts, key, chart.position(at), spacing_m, 1e-3 * spacing_m, 1e-2 * spacing_m)
        };
        let with_openness = |site: Self| (site, site.openness(tracer, spacing_m, OPENNESS_RAYS));
        let mut sites: Vec<(Self, f32)> = (0..count).filter_map(at).map(with_openness).collect();
        if sites.iter().all(|(_, open)| *open < SEEN) {
            // Of what is mostly buried the rest is all that anybody sees: the lit rim of a lamp's housing.
            let hidden = |site: &Self| site.openness(tracer, spacing_m, FEW_OPENNESS_RAYS) < SEEN;
            let more = (count..count + MORE_PARTS).filter_map(at).filter(|site| !hidden(site));
            sites.extend(more.map(with_openness).filter(|(_, open)| *open >= SEEN));
        }
        if sites.is_empty() {
            sites.extend(Self::of(tracer, charts, key, point, spacing_m).map(with_openness));
        }
        sites
    }

    /// The site nearest to a position, on the side of a tile; `None` where its chart is farther than `reach_m`.
    fn near(
        tracer: &LightTracer<'_>,
        charts: &Charts,
        key: &TileKey,
        nominal: Vec3,
        spacing_m: f32,
        inset_m: f32,
        reach_m: f32,
    ) -> Option<Self> {
        let members = charts.members(key.chart);
        let (triangle, u, v, distance) = if members.len() <= FEW_TRIANGLES {
            Charts::nearest(tracer.scene, members, nominal, inset_m)?
        } else {
            let half = DVec3::splat(f64::from(reach_m.min(1.01 * spacing_m)));
            let mut near = Vec::new();
            tracer.bvh.visit_box(nominal.as_dvec3() - half, nominal.as_dvec3() + half, |t| {
                if charts.of_triangle[t as usize] == key.chart {
                    near.push(t);
                }
            });
            // Found in the order of the tree; the nearest of equals is the first of the scene.
            near.sort_unstable();
            Charts::nearest(tracer.scene, &near, nominal, inset_m)?
        };
        if distance > reach_m {
            return None;
        }
        let [a, b, c] = tracer.scene.corners(triangle as usize);
        let facing = (b - a).cross(c - a).try_normalize()?;
        let normal = if key.side == 0 { facing } else { -facing };
        let hit = Hit { t: 1.0, u, v, triangle };
        let position = a * (1.0 - u - v) + b * u + c * v;
        let seen = Ray::new(position + normal, -normal);
        let surface = Surface::at(tracer.scene, tracer.covers[triangle as usize], &seen, &hit, Some(&tracer.coarse));
        let (x, y) = normal.any_orthonormal_pair();
        Some(Self {
            position: surface.position,
            start: surface.position + normal * offset(surface.position),
            normal,
            world_from_local: Mat3::from_cols(x, y, normal),
            bsdf: Bsdf::new(surface.base_color, surface.metallic, surface.roughness, surface.ior, Vec3::Z),
        })
    }

    /// Confidence that light received at the site represents its surroundings, from 0 (not at all) to 1: little where most of what the site
    /// sees are the backs of closed surfaces or lies nearer than the next lattice point, `spacing_m` away. The light of such a place ends
    /// with it: a gap under furniture, the inside of a wall.
    pub fn openness(&self, tracer: &LightTracer<'_>, spacing_m: f32, rays: u32) -> f32 {
        let mut buried = 0;
        for k in 0..rays {
            let u = [(k as f32 + 0.5) / rays as f32, (k as f32 * 0.618_034).fract()];
            let direction = self.world_from_local * super::super::bsdf::sample_cosine(u);
            let ray = Ray::new(self.start, direction);
            let met = tracer.closest_where(&ray, 0.5, |cover| !cover.pane);
            buried += u32::from(met.is_some_and(|hit| tracer.buries(&ray, &hit, spacing_m)));
        }
        openness(buried as f32 / rays as f32)
    }
}

/// [`Site::openness`] where a share of what is seen buries the site.
pub(super) fn openness(buried: f32) -> f32 {
    ((BURIED - buried) / (BURIED - OPEN)).clamp(0.0, 1.0).powi(2).max(super::DOUBTFUL)
}

impl LightTracer<'_> {
    /// Whether what a ray met hides its origin: the back of a surface that has but one side, or a surface nearer than `near_m`.
    pub(super) fn buries(&self, ray: &Ray, hit: &Hit, near_m: f32) -> bool {
        let [a, b, c] = self.scene.corners(hit.triangle as usize);
        let from_back = (b - a).cross(c - a).dot(ray.direction) > 0.0;
        let material = self.scene.triangles[hit.triangle as usize].material as usize;
        hit.t < near_m || from_back && !self.scene.materials[material].light.double_sided
    }
}

/// Point `k` of the R₂ sequence (Roberts 2018), shifted.
pub(super) fn plastic(k: u32, shift: [f32; 2]) -> [f32; 2] {
    [(shift[0] + k as f32 * 0.754_877_7).fract(), (shift[1] + k as f32 * 0.569_840_3).fract()]
}
