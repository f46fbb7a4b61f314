//! The scene's surface cut into flat charts: connected coplanar triangles of one material share a plane and its coordinates.

use super::super::LightTracer;
use super::super::surface::Surface;
use super::sealed::sealed;
use corf_scene::Scene;
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// Triangles of a chart have normals within this of each other (cosine of 0.25°).
const COPLANAR_COS: f32 = 0.999_990_5;
/// Largest distance of a chart's corners from its plane, as a share of `1 + the largest absolute coordinate`.
const COPLANAR_OFFSET: f32 = 2e-5;
/// Corners closer than this, metres, are one when triangles are joined.
const WELD_M: f32 = 1e-5;
/// Charts of at most so many triangles are searched one by one for the point nearest to another.
pub(super) const FEW_TRIANGLES: usize = 16;

/// A flat piece of surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chart {
    /// World position of coordinates (0, 0), metres.
    pub origin: Vec3,
    /// Unit vectors along the two coordinates.
    pub axes: [Vec3; 2],
    /// Unit normal of the front.
    pub normal: Vec3,
    /// Extent along the two coordinates, metres: every point of the chart is within `0..size`.
    pub size: Vec2,
    /// Whether its back is the inside of a sealed body.
    sealed: bool,
    /// Range of [`Charts::members`].
    first: u32,
    count: u32,
}

impl Chart {
    /// Coordinates of a world position, metres.
    pub fn coordinates(&self, position: Vec3) -> Vec2 {
        let p = position - self.origin;
        Vec2::new(p.dot(self.axes[0]), p.dot(self.axes[1]))
    }

    /// World position of coordinates.
    pub fn position(&self, coordinates: Vec2) -> Vec3 {
        self.origin + self.axes[0] * coordinates.x + self.axes[1] * coordinates.y
    }
}

/// All charts of a scene.
#[derive(Debug)]
pub(super) struct Charts {
    pub list: Vec<Chart>,
    /// Per triangle of the scene: its chart.
    pub of_triangle: Vec<u32>,
    /// Triangles, chart by chart.
    members: Vec<u32>,
}

impl Charts {
    /// Cuts a scene up; large triangles gather their neighbours first.
    pub fn new(tracer: &LightTracer<'_>) -> Self {
        let scene = tracer.scene;
        let n = scene.triangles.len();
        let corners: Vec<[Vec3; 3]> = (0..n).map(|i| scene.corners(i)).collect();
        let cross = |i: usize| (corners[i][1] - corners[i][0]).cross(corners[i][2] - corners[i][0]);
        let numbers = weld(&corners);
        let sealed = sealed(tracer, &corners, &numbers);
        let edge = |a: u32, b: u32| (a.min(b), a.max(b));
        let edges: Vec<[(u32, u32); 3]> = numbers.iter().map(|&[a, b, c]| [edge(a, b), edge(b, c), edge(c, a)]).collect();
        let mut beside: HashMap<(u32, u32), Vec<u32>> = HashMap::with_capacity(2 * n);
        for (i, of) in edges.iter().enumerate() {
            for edge in of {
                beside.entry(*edge).or_default().push(i as u32);
            }
        }
        let mut order: Vec<u32> = (0..n as u32).collect();
        let area: Vec<f32> = (0..n).map(|i| cross(i).length()).map(|a| if a.is_finite() { a } else { 0.0 }).collect();
        order.sort_by(|a, b| area[*b as usize].total_cmp(&area[*a as usize]).then(a.cmp(b)));

        let mut charts = Self { list: Vec::new(), of_triangle: vec![u32::MAX; n], members: Vec::with_capacity(n) };
        for seed in order {
            if charts.of_triangle[seed as usize] != u32::MAX {
                continue;
            }
            let chart = charts.list.len() as u32;
            let first = charts.members.len();
            let normal = cross(seed as usize).normalize_or(Vec3::Z);
            let anchor = corners[seed as usize][0];
            let reach = anchor.abs().max_element();
            charts.of_triangle[seed as usize] = chart;
            charts.members.push(seed);
            let mut next = first;
            while next < charts.members.len() {
                let at = charts.members[next] as usize;
                next += 1;
                for neighbour in edges[at].iter().flat_map(|edge| &beside[edge]) {
                    let j = *neighbour as usize;
                    let flat = || {
                        let own = cross(j).normalize_or_zero();
                        own.dot(normal) > COPLANAR_COS
                            && corners[j].iter().all(|c| (*c - anchor).dot(normal).abs() < COPLANAR_OFFSET * (1.0 + reach))
                    };
                    if charts.of_triangle[j] == u32::MAX
                        && scene.triangles[j].material == scene.triangles[seed as usize].material
                        && flat()
                    {
                        charts.of_triangle[j] = chart;
                        charts.members.push(*neighbour);
                    }
                }
            }
            let members = &charts.members[first..];
            // Along the longest edge that bounds the chart: of a rectangle a side, not the diagonal.
            let inside =
                |edge: &(u32, u32)| beside[edge].iter().filter(|t| charts.of_triangle[**t as usize] == chart).count() > 1;
            let mut longest = (-1.0f32, Vec3::ZERO);
            for &t in members {
                for k in 0..3 {
                    let along = corners[t as usize][(k + 1) % 3] - corners[t as usize][k];
                    let length = if inside(&edges[t as usize][k]) { 0.0 } else { along.length() };
                    if length > longest.0 {
                        longest = (length, along);
                    }
                }
            }
            let flat = longest.1 - normal * normal.dot(longest.1);
            let x = flat.try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
            let y = normal.cross(x);
            let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
            for c in members.iter().flat_map(|t| corners[*t as usize]) {
                let at = Vec2::new((c - anchor).dot(x), (c - anchor).dot(y));
                (low, high) = (low.min(at), high.max(at));
            }
            let finite = low.is_finite() && high.is_finite();
            charts.list.push(Chart {
                origin: if finite { anchor + x * low.x + y * low.y } else { Vec3::ZERO },
                axes: [x, y],
                normal,
                size: if finite { high - low } else { Vec2::ZERO },
                sealed: members.iter().all(|t| sealed[*t as usize]),
                first: first as u32,
                count: members.len() as u32,
            });
        }
        charts
    }

    /// Place of a surface that a ray met on the charts: index of its chart, the side it was met on (0 the front, 1 the back), and
    /// coordinates.
    pub fn locate(&self, surface: &Surface, triangle: u32) -> (u32, u32, Vec2) {
        let index = self.of_triangle[triangle as usize];
        let chart = &self.list[index as usize];
        let side = u32::from(surface.geometric_normal.dot(chart.normal) < 0.0);
        (index, side, chart.coordinates(surface.position))
    }

    /// Unit normal of a chart on a side: 0 the front, 1 the back.
    pub fn normal(&self, chart: u32, side: u32) -> Vec3 {
        self.list[chart as usize].normal * if side == 0 { 1.0 } else { -1.0 }
    }

    /// Whether a chart's side is the inside of a sealed body: no light is there, and nobody sees it.
    pub fn is_sealed(&self, chart: u32, side: u32) -> bool {
        side == 1 && self.list[chart as usize].sealed
    }

    /// The triangles of a chart.
    pub fn members(&self, chart: u32) -> &[u32] {
        let Chart { first, count, .. } = self.list[chart as usize];
        &self.members[first as usize..(first + count) as usize]
    }

    /// The point of some triangles nearest to a position, kept `inset_m` within its triangle where that has room:
    /// triangle, barycentric weights of its second and third vertex, distance.
    pub fn nearest(scene: &Scene, triangles: &[u32], position: Vec3, inset_m: f32) -> Option<(u32, f32, f32, f32)> {
        let mut best: Option<(u32, Vec3, f32)> = None;
        for &t in triangles {
            let weights = nearest_on(scene.corners(t as usize), position);
            let [a, b, c] = scene.corners(t as usize);
            let distance = (a * weights.x + b * weights.y + c * weights.z).distance(position);
            if best.is_none_or(|(_, _, d)| distance < d) {
                best = Some((t, weights, distance));
            }
        }
        best.map(|(t, weights, distance)| {
            let weights = inset(scene.corners(t as usize), weights, inset_m);
            (t, weights.y, weights.z, distance)
        })
    }
}

/// Numbers of triangles' corners; those that are welded have one.
fn weld(corners: &[[Vec3; 3]]) -> Vec<[u32; 3]> {
    let mut ids: HashMap<[i64; 3], u32> = HashMap::with_capacity(corners.len());
    let mut id = |p: Vec3| {
        let key = p.to_array().map(|c| (f64::from(c) / f64::from(WELD_M)).round() as i64);
        let next = ids.len() as u32;
        *ids.entry(key).or_insert(next)
    };
    corners.iter().map(|c| c.map(&mut id)).collect()
}

/// Barycentric weights of the point of a triangle nearest to a position (Ericson 2004, *Real-Time Collision Detection*, 5.1.5).
fn nearest_on([a, b, c]: [Vec3; 3], p: Vec3) -> Vec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return Vec3::X;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return Vec3::Y;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return Vec3::new(1.0 - t, t, 0.0);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return Vec3::Z;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return Vec3::new(1.0 - t, 0.0, t);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return Vec3::new(0.0, 1.0 - t, t);
    }
    let sum = va + vb + vc;
    if sum > 0.0 { Vec3::new(va, vb, vc) / sum } else { Vec3::splat(1.0 / 3.0) }
}

/// Weights moved inwards until the point is about `inset_m` from every edge, or a fifth of the way to the opposite corner.
fn inset([a, b, c]: [Vec3; 3], weights: Vec3, inset_m: f32) -> Vec3 {
    let double_area = (b - a).cross(c - a).length();
    let least = Vec3::new((c - b).length(), (a - c).length(), (b - a).length()) * (inset_m / double_area.max(1e-20));
    let moved = weights.max(least.min(Vec3::splat(0.2)));
    moved / moved.element_sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn the_nearest_point_of_a_triangle_is_none_of_many_others() {
        let mut rng = Rng::keyed(1, 2, 3);
        let mut draw = || Vec3::new(rng.uniform(), rng.uniform(), rng.uniform());
        for _ in 0..300 {
            let (a, b, c, p) = (draw(), draw(), draw(), 3.0 * draw() - 1.0);
            let w = nearest_on([a, b, c], p);
            assert!(w.min_element() >= 0.0 && (w.element_sum() - 1.0).abs() < 1e-5, "{w}");
            let best = (a * w.x + b * w.y + c * w.z).distance(p);
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let (u, v) = (i as f32 / 40.0, j as f32 / 40.0);
                    assert!((a * (1.0 - u - v) + b * u + c * v).distance(p) > best - 1e-5);
                }
            }
        }
    }

    #[test]
    fn an_inset_point_is_that_far_from_every_edge() {
        let corners = [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.3, 1.5, 0.0)];
        let w = inset(corners, Vec3::X, 0.01);
        let p = corners[0] * w.x + corners[1] * w.y + corners[2] * w.z;
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            assert!((b - a).normalize().cross(p - a).length() > 0.0095, "{k} {p}");
        }
    }
}
