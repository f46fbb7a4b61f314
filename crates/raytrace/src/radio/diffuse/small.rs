//! Small faces, sampled over their area.
//!
//! A lattice of N directions meets a face of area A at distance d some m = N A cosθ/(4πd²) times. Where that is far less than once (facets
//! of a chair, a plank seen edge-on) the direction that meets it by chance counts for 1/m of what the face sends, and one of thousands of
//! such faces makes a pixel. What a receiver sees of them straight or through slabs is therefore sampled over the faces instead of over directions:
//! points in equal shares of Σ A/d², ∫dΩ/cosθ_s = ∫dA/d², so that none counts for more than a direction that meets a surface squarely.

use crate::radio::geometry::Geometry;
use crate::radio::lattice::R2;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// Faces that more directions than this may meet are left to the directions.
const MET: f64 = 8.0;
/// Points to a direction of the lattice, at equal A/d².
const POINTS_PER_DIRECTION: f64 = 2.0;

/// The faces of a scene that scatter.
pub struct SmallFaces {
    faces: Vec<Outline>,
    /// Faces of the scene, those that scatter nothing included.
    count: usize,
}

/// A face, and a sphere around it.
struct Outline {
    face: u32,
    centre: DVec3,
    radius_m: f64,
    area_m2: f64,
    triangles: Vec<[DVec3; 3]>,
}

/// A point of a small face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmallPoint {
    /// What it lies on.
    pub face: u32,
    /// From the receiver, a unit vector.
    pub direction: DVec3,
    /// ∫dA/d² that it stands for, steradians.
    pub share_sr: f64,
}

/// The small faces as one receiver sees them.
#[derive(Debug)]
pub struct Seen {
    /// By face: whether points stand for it.
    small: Vec<bool>,
    /// Whether anything hides them is not asked.
    pub points: Vec<SmallPoint>,
}

impl Seen {
    /// Whether points stand for what a face sends straight or through slabs.
    pub fn holds(&self, face: u32) -> bool {
        self.small[face as usize]
    }
}

impl SmallFaces {
    /// All faces that scatter: which are small is the receiver's to say.
    pub fn new(geometry: &Geometry<'_>) -> Self {
        let mut triangles: Vec<Vec<[DVec3; 3]>> = vec![Vec::new(); geometry.faces.len()];
        for triangle in 0..geometry.triangle_count() as u32 {
            triangles[geometry.face_of_triangle(triangle) as usize].push(*geometry.corners(triangle));
        }
        let of_faces = triangles.into_iter().enumerate().map(|(face, triangles)| (face as u32, triangles));
        let scattering = of_faces.filter(|(face, _)| geometry.slab(*face).scattering.coefficient > 0.0);
        Self { faces: scattering.map(|(face, triangles)| Outline::new(face, triangles)).collect(), count: geometry.faces.len() }
    }

    /// What a receiver with so many directions over the sphere sees; `phase` ∈ [0, 1)² shifts the points.
    pub fn seen_from(&self, geometry: &Geometry<'_>, rx: DVec3, directions: usize, phase: DVec2) -> Seen {
        let per_sr = directions as f64 / (4.0 * PI);
        let mut seen = Seen { small: vec![false; self.count], points: Vec::new() };
        // One point to each `share_sr` along the faces, one after the other.
        let share_sr = 1.0 / (POINTS_PER_DIRECTION * per_sr);
        let (mut ahead_sr, mut number) = (phase.x * share_sr, 0u32);
        for outline in &self.faces {
            let middle_m = rx.distance(outline.centre);
            let nearest_m = middle_m - outline.radius_m;
            if nearest_m <= 0.0 {
                continue;
            }
            let most_cos = (geometry.faces[outline.face as usize].distance(rx).abs() / nearest_m).min(1.0);
            if per_sr * outline.area_m2 * most_cos / (nearest_m * nearest_m) >= MET {
                continue;
            }
            seen.small[outline.face as usize] = true;
            let size_sr = outline.area_m2 / (middle_m * middle_m);
            while ahead_sr < size_sr {
                let point = outline.at(ahead_sr / size_sr, (phase + R2 * f64::from(number)).fract());
                let distance2 = point.distance_squared(rx);
                seen.points.push(SmallPoint {
                    face: outline.face,
                    direction: (point - rx) / distance2.sqrt(),
                    // Shares are equal at the distance of the middle.
                    share_sr: share_sr * middle_m * middle_m / distance2,
                });
                number += 1;
                ahead_sr += share_sr;
            }
            ahead_sr -= size_sr;
        }
        seen
    }
}

impl Outline {
    fn new(face: u32, triangles: Vec<[DVec3; 3]>) -> Self {
        let corners = || triangles.iter().flatten();
        let (low, high) = corners().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), c| (low.min(*c), high.max(*c)));
        let centre = 0.5 * (low + high);
        let radius_m = corners().map(|c| c.distance(centre)).fold(0.0, f64::max);
        Self { face, centre, radius_m, area_m2: triangles.iter().map(area_m2).sum(), triangles }
    }

    /// The point of the triangle that a share of the area, ∈ [0, 1), lies in, at a place ∈ [0, 1)² of it.
    fn at(&self, share: f64, place: DVec2) -> DVec3 {
        let mut left_m2 = share * self.area_m2;
        let within = self.triangles.iter().find(|triangle| {
            left_m2 -= area_m2(triangle);
            left_m2 < 0.0
        });
        let [a, b, c] = *within.unwrap_or(&self.triangles[self.triangles.len() - 1]);
        // The square, folded into the triangle.
        let DVec2 { x, y } = if place.x + place.y > 1.0 { 1.0 - place } else { place };
        a + (b - a) * x + (c - a) * y
    }
}

fn area_m2([a, b, c]: &[DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn points_of_a_face_stand_for_all_of_its_area_over_distance_squared() {
        let mut rng = Rng::keyed(11, 0, 0);
        let mut corner = || DVec3::new(rng.uniform_f64(), rng.uniform_f64(), rng.uniform_f64());
        let triangles: Vec<[DVec3; 3]> = (0..5).map(|_| [corner(), corner(), corner()]).collect();
        let outline = Outline::new(0, triangles.clone());
        assert!(triangles.iter().flatten().all(|c| c.distance(outline.centre) <= outline.radius_m));
        // The mean of any function over the points is its mean over the area: here the position.
        let n = 20_000;
        let points = (0..n).map(|i| outline.at((f64::from(i) + 0.5) / f64::from(n), (R2 * f64::from(i)).fract()));
        let mean = points.sum::<DVec3>() / f64::from(n);
        let centroid = triangles.iter().map(|t| (t[0] + t[1] + t[2]) / 3.0 * area_m2(t)).sum::<DVec3>() / outline.area_m2;
        assert!(mean.distance(centroid) < 2e-3, "{mean} {centroid}");
    }
}
