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

/// A sphere around a face.
struct Outline {
    face: u32,
    centre: DVec3,
    radius_m: f64,
}

/// A point of a small face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmallPoint {
    /// Face that it lies on.
    pub face: u32,
    /// Unit vector from the receiver.
    pub direction: DVec3,
    /// ∫dA/d² that it stands for, steradians.
    pub share_sr: f64,
}

/// The small faces as one receiver sees them.
#[derive(Debug)]
pub struct Seen {
    /// Whether points stand for a face, by face.
    small: Vec<bool>,
    /// Sample points on the small faces; their visibility from the receiver is not tested.
    pub points: Vec<SmallPoint>,
}

impl Seen {
    /// Whether points stand for what a face sends straight or through slabs.
    pub fn holds(&self, face: u32) -> bool {
        self.small[face as usize]
    }
}

impl SmallFaces {
    /// Collects all faces that scatter; the receiver's position decides which of them are small.
    pub fn new(geometry: &Geometry<'_>) -> Self {
        let mut corners: Vec<Vec<DVec3>> = vec![Vec::new(); geometry.faces.len()];
        for triangle in 0..geometry.triangle_count() as u32 {
            corners[geometry.face_of_triangle(triangle) as usize].extend(geometry.corners(triangle));
        }
        let of_faces = corners.iter().enumerate().map(|(face, corners)| (face as u32, corners));
        let scattering = of_faces.filter(|(face, _)| geometry.slab(*face).scattering.coefficient > 0.0);
        Self { faces: scattering.map(|(face, corners)| Outline::new(face, corners)).collect(), count: geometry.faces.len() }
    }

    /// Sample points of the small faces for a receiver with so many directions over the sphere; `phase` ∈ [0, 1)² shifts the points.
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
            let face = &geometry.faces[outline.face as usize];
            let most_cos = (face.distance(rx).abs() / nearest_m).min(1.0);
            if per_sr * face.area_m2 * most_cos / (nearest_m * nearest_m) >= MET {
                continue;
            }
            seen.small[outline.face as usize] = true;
            let size_sr = face.area_m2 / (middle_m * middle_m);
            while ahead_sr < size_sr {
                let point = face.point(ahead_sr / size_sr, (phase + R2 * f64::from(number)).fract());
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
    fn new(face: u32, corners: &[DVec3]) -> Self {
        let (low, high) =
            corners.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), c| (low.min(*c), high.max(*c)));
        let centre = 0.5 * (low + high);
        Self { face, centre, radius_m: corners.iter().map(|c| c.distance(centre)).fold(0.0, f64::max) }
    }
}
