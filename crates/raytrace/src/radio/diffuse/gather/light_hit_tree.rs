//! Bounding volume hierarchy over the hits of the transmitter's rays: finds those among thousands that a mirror shows, for thousands of
//! mirrors.

use super::image_receivers::ImageReceiver;
use super::sampling::DirectionSampling;
use crate::radio::diffuse::light::illumination::Lighting;
use crate::radio::geometry::Geometry;
use glam::{DVec3, Vec3};

/// Largest number of hits in a leaf.
const LEAF: usize = 16;
/// Margin within which hits near a view's outline count as inside it, metres: the rounding of single precision.
const NEAR_M: f32 = 1e-3;

/// A point that the transmitter lights, straight or through slabs.
#[derive(Clone, Copy, Debug)]
pub struct LightHit {
    /// On the face's plane.
    pub point: DVec3,
    /// Face that was hit.
    pub face: u32,
    /// Visibility of the transmitter from there.
    pub lighting: Lighting,
    /// The transmitter's height above the face over its distance³, 1/m², of the sign of the side that it lights.
    pub density_per_m2: f64,
}

/// A point where a ray fell, in single precision.
#[derive(Clone, Copy)]
struct PackedHit {
    number: u32,
    point: Vec3,
    normal: Vec3,
    offset_m: f32,
    area_m2: f32,
    density_per_m2: f32,
}

/// A sphere around a run of places.
struct Node {
    centre: Vec3,
    radius_m: f32,
    first: u32,
    end: u32,
    /// The node behind all that lies within this one, in the order of the list.
    next: u32,
}

/// The tree: nodes before what lies within them.
pub struct LightHitTree {
    places: Vec<PackedHit>,
    nodes: Vec<Node>,
}

impl LightHitTree {
    /// The tree over hits on the faces of a geometry.
    pub fn new(geometry: &Geometry<'_>, light_hits: &[LightHit]) -> Self {
        let place = |(number, hit): (usize, &LightHit)| {
            let plane = &geometry.faces[hit.face as usize];
            PackedHit {
                number: number as u32,
                point: hit.point.as_vec3(),
                normal: plane.normal.as_vec3(),
                offset_m: plane.offset_m as f32,
                area_m2: plane.area_m2 as f32,
                density_per_m2: hit.density_per_m2 as f32,
            }
        };
        let mut this = Self { places: light_hits.iter().enumerate().map(place).collect(), nodes: Vec::new() };
        this.split(0, light_hits.len());
        this
    }

    /// Adds the nodes of a run, cut in halves along its longest side.
    fn split(&mut self, first: usize, end: usize) {
        let places = &mut self.places[first..end];
        if places.is_empty() {
            return;
        }
        let (low, high) =
            places.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p.point), high.max(p.point)));
        let centre = 0.5 * (low + high);
        let radius_m = places.iter().map(|p| p.point.distance(centre)).fold(0.0, f32::max);
        let node = self.nodes.len();
        self.nodes.push(Node { centre, radius_m, first: first as u32, end: end as u32, next: 0 });
        if end - first > LEAF {
            let axis = (high - low).max_position();
            let middle = (end - first) / 2;
            places.select_nth_unstable_by(middle, |a, b| a.point[axis].total_cmp(&b.point[axis]).then(a.number.cmp(&b.number)));
            self.split(first, first + middle);
            self.split(first + middle, end);
        }
        self.nodes[node].next = self.nodes.len() as u32;
    }

    /// Reports the numbers of those that a view may show and that the transmitter's rays meet more densely than the receiver's directions: of
    /// others they have no share.
    pub fn shown(&self, view: &ImageReceiver, sampling: DirectionSampling, mut report: impl FnMut(usize)) {
        let from = view.vantage.image.as_vec3();
        let denser = |place: &PackedHit| {
            let height_m = place.normal.dot(from) - place.offset_m;
            let distance2 = place.point.distance_squared(from);
            let own_per_m2 = f64::from(height_m / (distance2 * distance2.sqrt()));
            let [area_m2, transmitters_per_m2] = [place.area_m2, place.density_per_m2].map(f64::from);
            // A little less, for single precision.
            view.vantage.density_ratio(sampling, area_m2, own_per_m2, transmitters_per_m2) > 0.99
        };
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if view.within(node.centre) < -node.radius_m - NEAR_M {
                at = node.next as usize;
                continue;
            }
            if node.next as usize == at + 1 {
                let places = &self.places[node.first as usize..node.end as usize];
                let shown = places.iter().filter(|place| view.within(place.point) >= -NEAR_M && denser(place));
                shown.for_each(|place| report(place.number as usize));
            }
            at += 1;
        }
    }
}
