//! Connected parts of objects: whether they close, what they lack, how thick they are.

use super::solids::{closed, volume_m3};
use crate::Scene;
use glam::DVec3;
use std::collections::{BTreeMap, HashMap};

/// Corners that differ by less are one, metres.
const WELD_M: f64 = 2e-6;
/// A surface whose oriented areas cancel to less than this share of their sum turns its faces towards one another: 0 closed, 0.2 a box
/// without a lid, 0.33 three sides of a channel, 0.64 half a pipe, 0.71 a corner, 1 a plane.
const BODY_BALANCE: f64 = 0.5;
/// Bodies of less surface hardly matter to anything, m²: stems, knobs.
const SMALLEST_BODY_M2: f64 = 0.1;
/// A rim this close to another surface is closed by it, metres.
const RESTING_M: f64 = 0.01;
/// Rim edges that are looked at.
const RIM_SAMPLES: usize = 64;
/// Plates are allowed this share below the thickness of their slabs: float32 coordinates.
const THICKNESS_ROUNDING: f64 = 1e-3;

/// Triangles of one object that hang together by their corners.
pub struct ConnectedPart {
    /// Index into the scene's objects.
    pub object: u32,
    /// Indices into the scene's triangles.
    pub triangles: Vec<u32>,
    /// Ends of the edges that only one triangle has.
    pub rim: Vec<[DVec3; 2]>,
    /// Area of all triangles, m².
    pub area_m2: f64,
    /// |Σ n·dA| / Σ dA.
    balance: f64,
}

/// All parts of a scene, in the order of their first triangles.
pub fn parts(scene: &Scene) -> Vec<ConnectedPart> {
    let key = |p: DVec3| (p / WELD_M).round().to_array().map(|x| x as i64);
    let mut corner_ids: HashMap<(u32, [i64; 3]), usize> = HashMap::new();
    let mut parents: Vec<usize> = Vec::new();
    let mut corners: Vec<[usize; 3]> = Vec::with_capacity(scene.triangles.len());
    for (i, triangle) in scene.triangles.iter().enumerate() {
        let ids = scene.corners_f64(i).map(|p| {
            *corner_ids.entry((triangle.object, key(p))).or_insert_with(|| {
                parents.push(parents.len());
                parents.len() - 1
            })
        });
        for id in [ids[1], ids[2]] {
            let (a, b) = (root(&mut parents, ids[0]), root(&mut parents, id));
            parents[a.max(b)] = a.min(b);
        }
        corners.push(ids);
    }
    let mut order: HashMap<usize, usize> = HashMap::new();
    let mut members: Vec<Vec<u32>> = Vec::new();
    for (i, ids) in corners.iter().enumerate() {
        let part = *order.entry(root(&mut parents, ids[0])).or_insert_with(|| {
            members.push(Vec::new());
            members.len() - 1
        });
        members[part].push(i as u32);
    }
    members.into_iter().map(|triangles| part(scene, &corners, triangles)).collect()
}

fn root(parents: &mut [usize], mut id: usize) -> usize {
    while parents[id] != id {
        parents[id] = parents[parents[id]];
        id = parents[id];
    }
    id
}

fn part(scene: &Scene, corners: &[[usize; 3]], triangles: Vec<u32>) -> ConnectedPart {
    let mut edges: HashMap<[usize; 2], (usize, [DVec3; 2])> = HashMap::new();
    let (mut area, mut oriented) = (0.0, DVec3::ZERO);
    for &t in &triangles {
        let (ids, places) = (corners[t as usize], scene.corners_f64(t as usize));
        for k in 0..3 {
            let (a, b) = (k, (k + 1) % 3);
            let edge = [ids[a].min(ids[b]), ids[a].max(ids[b])];
            edges.entry(edge).or_insert((0, [places[a], places[b]])).0 += 1;
        }
        let normal = 0.5 * (places[1] - places[0]).cross(places[2] - places[0]);
        area += normal.length();
        oriented += normal;
    }
    let mut rim: Vec<([usize; 2], [DVec3; 2])> =
        edges.into_iter().filter(|(_, (count, _))| *count == 1).map(|(ids, (_, places))| (ids, places)).collect();
    rim.sort_by_key(|(ids, _)| *ids);
    ConnectedPart {
        object: scene.triangles[triangles[0] as usize].object,
        triangles,
        rim: rim.into_iter().map(|(_, places)| places).collect(),
        area_m2: area,
        balance: if area > 0.0 { oriented.length() / area } else { 1.0 },
    }
}

impl ConnectedPart {
    /// Its triangles that close around a volume and face outward: all of them, or all of one material, where sheets of another hang on to them.
    pub fn of_bodies(&self, scene: &Scene) -> Vec<u32> {
        let is_body = |triangles: &[u32]| {
            let corners: Vec<[DVec3; 3]> = triangles.iter().map(|t| scene.corners_f64(*t as usize)).collect();
            closed(&corners) && volume_m3(&corners) > 0.0
        };
        if is_body(&self.triangles) {
            return self.triangles.clone();
        }
        let mut by_material: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        self.triangles.iter().for_each(|&t| by_material.entry(scene.triangles[t as usize].material).or_default().push(t));
        by_material.into_values().filter(|triangles| is_body(triangles)).flatten().collect()
    }

    /// A point of the rim of a hole that nothing else closes, where the part is a body rather than a sheet.
    pub fn hole(&self, scene: &Scene) -> Option<DVec3> {
        if self.rim.is_empty() || self.balance >= BODY_BALANCE || self.area_m2 < SMALLEST_BODY_M2 {
            return None;
        }
        let step = self.rim.len().div_ceil(RIM_SAMPLES);
        self.rim.iter().step_by(step).map(|[a, b]| a.midpoint(*b)).find(|p| !self.rests(scene, *p))
    }

    /// The thickness of a closed plate whose two slabs are thicker than itself, metres, and the material of its largest face.
    pub fn thinner_than_its_slabs(&self, scene: &Scene) -> Option<(f64, u32)> {
        let normal = |t: u32| {
            let [a, b, c] = scene.corners_f64(t as usize);
            (b - a).cross(c - a)
        };
        let largest =
            self.triangles.iter().copied().max_by(|a, b| normal(*a).length().total_cmp(&normal(*b).length()).then(b.cmp(a)))?;
        let material = scene.triangles[largest as usize].material;
        let slab_m = scene.materials[material as usize].radio.as_ref()?.thickness_m;
        let axis = normal(largest).try_normalize()?;
        if !self.rim.is_empty() {
            return None;
        }
        let along = self.triangles.iter().flat_map(|t| scene.corners_f64(*t as usize)).map(|p| p.dot(axis));
        let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        let thickness_m = high - low;
        // A film without thickness is a doubled sheet, which is said elsewhere.
        (thickness_m > WELD_M && thickness_m < 2.0 * slab_m * (1.0 - THICKNESS_ROUNDING)).then_some((thickness_m, material))
    }

    /// Whether a point lies on the surface of something else.
    fn rests(&self, scene: &Scene, point: DVec3) -> bool {
        // The part's triangles are in ascending order.
        let other = |i: &usize| self.triangles.binary_search(&(*i as u32)).is_err();
        (0..scene.triangles.len()).filter(other).any(|i| distance_to_triangle(point, &scene.corners_f64(i)) < RESTING_M)
    }
}

/// Distance of a point from a triangle, metres.
fn distance_to_triangle(p: DVec3, corners: &[DVec3; 3]) -> f64 {
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let mut inside = true;
    let mut nearest = f64::INFINITY;
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        let edge = b - a;
        inside &= edge.cross(p - a).dot(normal) >= 0.0;
        let t = ((p - a).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        nearest = nearest.min(p.distance(a + edge * t));
    }
    match normal.try_normalize() {
        Some(n) if inside => (p - corners[0]).dot(n).abs(),
        _ => nearest,
    }
}
