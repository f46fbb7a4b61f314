//! Where the transmitter's rays fell, as a tree: which of thousands of points a mirror shows is asked for thousands of mirrors.

use super::gather::Lattice;
use super::landings::Landing;
use super::views::View;
use crate::radio::geometry::Geometry;
use glam::Vec3;

/// Places of a leaf.
const LEAF: usize = 16;
/// Places this near a view's outline count as within it: single precision, metres.
const NEAR_M: f32 = 1e-3;

/// A point where a ray fell, in single precision.
#[derive(Clone, Copy)]
struct Place {
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
pub struct Places {
    places: Vec<Place>,
    nodes: Vec<Node>,
}

impl Places {
    /// Of what fell on surfaces of a geometry.
    pub fn new(geometry: &Geometry<'_>, landings: &[Landing]) -> Self {
        let place = |(number, landing): (usize, &Landing)| {
            let plane = &geometry.faces[landing.face as usize];
            Place {
                number: number as u32,
                point: landing.point.as_vec3(),
                normal: plane.normal.as_vec3(),
                offset_m: plane.offset_m as f32,
                area_m2: plane.area_m2 as f32,
                density_per_m2: landing.density_per_m2 as f32,
            }
        };
        let mut this = Self { places: landings.iter().enumerate().map(place).collect(), nodes: Vec::new() };
        this.split(0, landings.len());
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
    pub fn shown(&self, view: &View, lattice: &Lattice<'_>, mut report: impl FnMut(usize)) {
        let from = view.vantage.image.as_vec3();
        let denser = |place: &Place| {
            let height_m = place.normal.dot(from) - place.offset_m;
            let distance2 = place.point.distance_squared(from);
            let own_per_m2 = f64::from(height_m / (distance2 * distance2.sqrt()));
            let [area_m2, transmitters_per_m2] = [place.area_m2, place.density_per_m2].map(f64::from);
            // A little less, for single precision.
            view.vantage.density_ratio(lattice, area_m2, own_per_m2, transmitters_per_m2) > 0.99
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
