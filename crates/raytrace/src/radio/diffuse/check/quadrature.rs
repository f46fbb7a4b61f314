//! Light scattered once, straight or by way of one mirror before, by quadrature over the surfaces themselves: no lattice, no chance.
//!
//! (λ/4π)² ∫ S²Γ² f_s cosθ_i dA / (r₁² r₂²) over all that source and receiver see. Triangles are cut into quarters, the cells with the
//! largest estimated errors first; at the outlines of shadows, where no rule converges, cells become small instead.

use crate::radio::diffuse::DiffuseField;
#[cfg(doc)]
use crate::radio::diffuse::DiffuseSettings;
use crate::radio::diffuse::gather::{GatherTracer, Lattice};
use crate::radio::diffuse::light::illumination::{IlluminationSource, Lighting};
use corf_scene::Result;
use glam::DVec3;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Relative error of an object's power, estimated, at which integration stops: of light straight from the transmitter.
const STRAIGHT: f64 = 2e-5;
/// Relative error of the power by way of one mirror; many of these make a sum.
const OF_MIRROR: f64 = 5e-4;
/// Largest number of cells, at which integration stops in any case.
const MOST_CELLS: usize = 400_000;
/// Longest side of a cell to begin with, metres.
const LONGEST_SIDE_M: f64 = 0.25;
/// Fewest quarterings of a triangle to begin with, so that light on a part of it only is not missed.
const LEAST_QUARTERINGS: usize = 3;
/// Radon's rule of degree 5 on a triangle: the centroid, and two orbits of barycentric coordinates (t, t, 1 − 2t).
const CENTRE_WEIGHT: f64 = 0.225;
const NEAR_CORNERS: (f64, f64) = (0.101_286_507_323_456_33, 0.125_939_180_544_827_15);
const NEAR_SIDES: (f64, f64) = (0.470_142_064_105_115_1, 0.132_394_152_788_506_2);
/// The rule of degree 2 on the centroid and the first orbit: the difference is the estimate of the error.
const COARSE: (f64, f64) = (0.484_122_918_275_927_1, 0.171_959_027_241_357_6);

/// A piece of a triangle.
struct DirectionCell {
    corners: [DVec3; 3],
    face: u32,
    power: f64,
    error: f64,
}

impl PartialEq for DirectionCell {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for DirectionCell {}

impl PartialOrd for DirectionCell {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for DirectionCell {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error.total_cmp(&other.error)
    }
}

impl DirectionCell {
    fn new([a, b, c]: [DVec3; 3], face: u32, density: &impl Fn(DVec3, u32) -> f64) -> Self {
        let area_m2 = 0.5 * (b - a).cross(c - a).length();
        let orbit = |t: f64| {
            let at = |p: DVec3, q: DVec3, r: DVec3| density((p + q) * t + r * (1.0 - 2.0 * t), face);
            at(a, b, c) + at(b, c, a) + at(c, a, b)
        };
        let centre = density((a + b + c) / 3.0, face);
        let (corners, sides) = (orbit(NEAR_CORNERS.0), orbit(NEAR_SIDES.0));
        let fine = CENTRE_WEIGHT * centre + NEAR_CORNERS.1 * corners + NEAR_SIDES.1 * sides;
        let coarse = COARSE.0 * centre + COARSE.1 * corners;
        Self { corners: [a, b, c], face, power: area_m2 * fine, error: area_m2 * (fine - coarse).abs() }
    }
}

/// The four similar parts of a triangle.
fn quarters([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
    let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| (p + q) * 0.5);
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
}

/// A triangle's parts to begin with.
fn pieces(corners: [DVec3; 3]) -> Vec<[DVec3; 3]> {
    let [a, b, c] = corners;
    let longest_m = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let times = ((longest_m / LONGEST_SIDE_M).log2().ceil().max(0.0) as usize).max(LEAST_QUARTERINGS);
    (0..times).fold(vec![corners], |parts, _| parts.into_iter().flat_map(quarters).collect())
}

/// Scattered power at a receiver by quadrature, by scene object: |a|², linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Scattered {
    /// Straight from the transmitter to the surface: `D` with no slab between them, `RD`, `RRD`, … with as many as the index.
    pub straight: Vec<Vec<f64>>,
    /// Power by way of one of the mirrors that the field knows (see [`DiffuseSettings::min_mirror_sr`]), no slab anywhere: `SD`.
    pub mirrored: Vec<f64>,
}

impl DiffuseField<'_, '_> {
    /// Power that every object scatters straight to a receiver, with a relative error of some 1e-4 (1e-3 by way of mirrors): the quantity
    /// that [`DiffuseField::contributions`] estimate from their lattice, photons aside. For checks: it integrates over every triangle.
    ///
    /// # Errors
    /// A position that is not finite, or within 0.1 mm of a surface.
    pub fn by_quadrature(&self, rx: DVec3) -> Result<Scattered> {
        self.tracer.check_in_the_open("receiver", rx)?;
        let mut scattered = Scattered { straight: Vec::new(), mirrored: vec![0.0; self.tracer.objects()] };
        for &source in &self.illumination.sources {
            if source.mirror.is_none() {
                let slabs = self.illumination.slab_budget(source, 0).map_or(0..0, |most| 0..most + 1);
                scattered.straight = slabs.map(|slabs| self.scattered_from(source, slabs, rx)).collect();
            } else {
                let of_mirror = self.scattered_from(source, 0, rx);
                scattered.mirrored.iter_mut().zip(of_mirror).for_each(|(sum, power)| *sum += power);
            }
        }
        Ok(scattered)
    }

    /// Scattered power at a receiver by object, of light from a source through a number of slabs.
    fn scattered_from(&self, source: IlluminationSource, slabs: usize, rx: DVec3) -> Vec<f64> {
        let geometry = &self.tracer.geometry;
        let lattice = Lattice::new(self.directions.count(), false, false);
        let look = GatherTracer::new(self, rx, &self.tracer.settings.rx_antenna, lattice);
        let wavelength_m = self.tracer.settings.wavelength_m();
        let density = |point: DVec3, face: u32| {
            let lighting = self.illumination.lighting(source, point, face);
            let crossed = || geometry.crossings(self.illumination.tx, point, [Some(face)], slabs).map(|crossed| crossed.len());
            let meant = match lighting {
                Lighting::Dark => false,
                Lighting::Free => slabs == 0,
                Lighting::ThroughSlabs => slabs > 0 && crossed() == Some(slabs),
            };
            let sent = meant.then(|| look.sent(source, point, face, lighting, |_| true)).flatten();
            sent.map_or(0.0, |sent| sent.per_m2(wavelength_m))
        };
        let relative = if source.mirror.is_none() { STRAIGHT } else { OF_MIRROR };
        // Both have to be on one side of what scatters.
        let scatters = |face: u32| {
            let plane = &geometry.faces[face as usize];
            geometry.slab(face).scattering.coefficient > 0.0 && plane.distance(rx) * plane.distance(source.image) > 0.0
        };
        let mut of_object: Vec<Vec<u32>> = vec![Vec::new(); self.tracer.objects()];
        for triangle in 0..geometry.triangle_count() as u32 {
            let face = geometry.face_of_triangle(triangle);
            if scatters(face) {
                of_object[geometry.faces[face as usize].object as usize].push(triangle);
            }
        }
        let power = |triangles: &Vec<u32>| {
            let parts = triangles.iter().flat_map(|&triangle| {
                let face = geometry.face_of_triangle(triangle);
                pieces(*geometry.corners(triangle)).into_iter().map(move |corners| (corners, face))
            });
            refined(parts.map(|(corners, face)| DirectionCell::new(corners, face, &density)).collect(), relative, &density)
        };
        of_object.par_iter().map(power).collect()
    }
}

/// The power of all cells, cut up until their errors, which are as often too high as too low, add up to little.
fn refined(mut cells: BinaryHeap<DirectionCell>, relative: f64, density: &impl Fn(DVec3, u32) -> f64) -> f64 {
    let mut power: f64 = cells.iter().map(|cell| cell.power).sum();
    let mut squared_error: f64 = cells.iter().map(|cell| cell.error * cell.error).sum();
    while squared_error > (relative * power).powi(2)
        && cells.len() < MOST_CELLS
        && let Some(cell) = cells.pop()
    {
        power -= cell.power;
        squared_error -= cell.error * cell.error;
        for part in quarters(cell.corners) {
            let part = DirectionCell::new(part, cell.face, density);
            power += part.power;
            squared_error += part.error * part.error;
            cells.push(part);
        }
    }
    cells.iter().map(|cell| cell.power).sum()
}
