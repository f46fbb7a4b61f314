//! Filter of the chains that could end at a receiver: it tests the last bounce of all chains at once.
//!
//! Among some hundred thousand chains only a few hundred have the line from the receiver to the transmitter's image cross their last face;
//! all others fail this one test. Chains are kept by their last face, as the image's height above it and its coordinates along the two axes
//! on which the face's triangles are laid out, so that the test is a few operations on numbers that are adjacent in memory. It lets pass
//! points within a hair of the face's bounds; the exact image method decides.

use crate::radio::candidates::chain::Chain;
use crate::radio::geometry::Geometry;
use crate::radio::geometry::face::Face;
use crate::radio::geometry::planar::PlanarBounds;
use glam::DVec3;
use rayon::prelude::*;

/// Rounding of a point on a face, metres, generously.
const MARGIN_M: f64 = 1e-6;
/// Chains of a group, at most.
const GROUP: usize = 4096;
/// Groups a task screens, at least.
const GROUPS_PER_TASK: usize = 32;
/// Chains tested together.
const BLOCK: usize = 64;

/// Chains with one last face.
struct Group {
    face: u32,
    /// Heights of the image sources above the face, metres.
    heights_m: Vec<f64>,
    /// Coordinates of the image sources along the face's two axes, metres.
    across_m: [Vec<f64>; 2],
    /// Indices of the chains that the image sources belong to.
    chains: Vec<u32>,
}

/// Chains by their last face.
pub struct CandidateFilter {
    groups: Vec<Group>,
}

impl CandidateFilter {
    /// A filter of all chains, none of them empty.
    pub fn new(geometry: &Geometry<'_>, chains: &[Chain]) -> Self {
        let mut order: Vec<(u32, u32)> = (0..).zip(chains).filter_map(|(i, chain)| Some((*chain.faces().last()?, i))).collect();
        order.par_sort_unstable();
        let of_faces: Vec<&[(u32, u32)]> = order.chunk_by(|a, b| a.0 == b.0).flat_map(|of_face| of_face.chunks(GROUP)).collect();
        let groups = of_faces
            .into_par_iter()
            .map(|group| {
                let face = group[0].0;
                let plane = &geometry.faces[face as usize];
                let bounds = plane.bounds();
                let images = group.iter().map(|(_, chain)| chains[*chain as usize].image);
                let at: Vec<[f64; 2]> = images.clone().map(|image| bounds.project(image)).collect();
                Group {
                    face,
                    heights_m: images.map(|image| plane.distance(image)).collect(),
                    across_m: [0, 1].map(|axis| at.iter().map(|p| p[axis]).collect()),
                    chains: group.iter().map(|(_, chain)| *chain).collect(),
                }
            })
            .collect();
        Self { groups }
    }

    /// The numbers of the chains whose last bounce towards a receiver lies within the bounds of its face, in their order.
    pub fn passing(&self, geometry: &Geometry<'_>, rx: DVec3) -> Vec<u32> {
        let groups = self.groups.par_iter().with_min_len(GROUPS_PER_TASK);
        let mut passing: Vec<u32> = groups
            .fold(Vec::new, |mut passing, group| {
                group.pass(&geometry.faces[group.face as usize], rx, &mut passing);
                passing
            })
            .reduce(Vec::new, |mut all, some| {
                all.extend(some);
                all
            });
        passing.sort_unstable();
        passing
    }
}

impl Group {
    /// Adds the chains that pass for a receiver; `plane` is the group's face.
    fn pass(&self, plane: &Face, rx: DVec3, passing: &mut Vec<u32>) {
        let height_m = plane.distance(rx);
        // A receiver on the face is beyond a test of sides.
        if height_m.abs() <= MARGIN_M {
            passing.extend_from_slice(&self.chains);
            return;
        }
        let bounds = plane.bounds();
        let rx = bounds.project(rx);
        let PlanarBounds { min, max, .. } = bounds;
        let (low, high) = ([0, 1].map(|axis| min[axis] - MARGIN_M), [0, 1].map(|axis| max[axis] + MARGIN_M));
        let [across, along] = &self.across_m;
        let blocks = self.heights_m.chunks(BLOCK).zip(across.chunks(BLOCK)).zip(along.chunks(BLOCK));
        for (((heights_m, across), along), chains) in blocks.zip(self.chains.chunks(BLOCK)) {
            let mut inside = [false; BLOCK];
            for (inside, ((image_m, x), y)) in inside.iter_mut().zip(heights_m.iter().zip(across).zip(along)) {
                let share = height_m / (height_m - image_m);
                let (x, y) = (rx[0] + (x - rx[0]) * share, rx[1] + (y - rx[1]) * share);
                *inside = (height_m * image_m <= 0.0) & (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]);
            }
            passing.extend(chains.iter().zip(inside).filter(|(_, inside)| *inside).map(|(chain, _)| *chain));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::{RadioSettings, RadioTracer};
    use corf_scene::Rng;
    use corf_scene::model::{LightMaterial, Material, Object, Permittivity, RadioMaterial, Scattering, Scene, Triangle};
    use glam::Vec3;

    #[test]
    fn what_is_screened_out_has_no_path() {
        let mut rng = Rng::keyed(8, 0, 0);
        let mut point =
            |scale: f32| Vec3::new(rng.uniform_f64() as f32, rng.uniform_f64() as f32, rng.uniform_f64() as f32) * scale;
        let radio = RadioMaterial {
            id: "metal".into(),
            permittivity: Permittivity::Itu("metal".into()),
            thickness_m: 0.01,
            scattering: Scattering::default(),
        };
        let mut scene = Scene {
            materials: vec![Material { name: "metal".into(), light: LightMaterial::default(), radio: Some(radio) }],
            ..Scene::default()
        };
        for i in 0..40 {
            scene.objects.push(Object { name: format!("facet {i}") });
            let corner = point(4.0);
            scene.positions.extend([corner, corner + point(2.0), corner + point(2.0) - Vec3::splat(1.0)]);
            scene.triangles.push(Triangle { vertices: [0, 1, 2].map(|k| 3 * i + k), material: 0, object: i });
        }
        let tracer = RadioTracer::without_bvh(&scene, RadioSettings { max_interactions: 2, ..RadioSettings::default() }).unwrap();
        let geometry = tracer.geometry();
        let tx = point(4.0).as_dvec3();
        let sight = Chain::line_of_sight(tx);
        let singles: Vec<Chain> = (0..geometry.faces.len() as u32).map(|f| sight.pushed(f, geometry)).collect();
        let pairs = singles.iter().flat_map(|c| (0..geometry.faces.len() as u32).map(|f| c.pushed(f, geometry)));
        let chains: Vec<Chain> = singles.iter().copied().chain(pairs).collect();
        let screen = CandidateFilter::new(geometry, &chains);
        let (mut ends, mut passed) = (0, 0);
        for _ in 0..50 {
            let rx = point(4.0).as_dvec3();
            let passing = screen.passing(geometry, rx);
            passed += passing.len();
            for (i, chain) in (0..).zip(&chains) {
                let last = chain.faces()[chain.faces().len() - 1];
                if tracer.geometry.bounce(last, rx, chain.image).is_some() {
                    ends += 1;
                    assert!(passing.binary_search(&i).is_ok(), "{i}");
                }
            }
        }
        // A facet fills half of its bounds, and some have none of a chain's.
        assert!(ends > 1000 && passed < 4 * ends, "{ends} of {passed}");
    }
}
