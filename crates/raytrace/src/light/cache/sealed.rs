//! Insides of bodies that no light gets into. They are dark whatever the scene, so that no lattice has to find it out.

use super::super::LightTracer;
use super::super::surface::Cover;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// A box along the axes, metres.
#[derive(Clone, Copy)]
struct Extent {
    low: Vec3,
    high: Vec3,
}

impl Extent {
    const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    fn with(self, point: Vec3) -> Self {
        Self { low: self.low.min(point), high: self.high.max(point) }
    }

    fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }
}

/// Per triangle of a scene, whose corners have numbers of their own: whether behind it lies the inside of a sealed body. Triangles that meet in
/// pairs along edges make a body; it is sealed if it is closed, stops all light, has its fronts outside, and no emitter in its bounding box.
pub(super) fn sealed(tracer: &LightTracer<'_>, triangles: &[[Vec3; 3]], numbers: &[[u32; 3]]) -> Vec<bool> {
    // Each edge with the triangles along it, and whether they run along it from its lower number to its higher. What follows does not depend on
    // the order of edges.
    let mut along: HashMap<[u32; 2], Vec<(u32, bool)>> = HashMap::with_capacity(2 * numbers.len());
    for (triangle, of) in (0u32..).zip(numbers) {
        for k in 0..3 {
            let (a, b) = (of[k], of[(k + 1) % 3]);
            if a == b {
                continue;
            }
            along.entry([a.min(b), a.max(b)]).or_default().push((triangle, a < b));
        }
    }
    let mut bodies = Bodies::new(numbers.len());
    for of in along.values() {
        if let [(a, forward), (b, backward)] = of[..]
            && forward != backward
        {
            bodies.join(a, b);
        }
    }
    let body: Vec<usize> = (0..numbers.len() as u32).map(|triangle| bodies.of(triangle) as usize).collect();

    let mut is_sealed = vec![true; numbers.len()];
    let mut volumes = vec![0.0f64; numbers.len()];
    let mut extents = vec![Extent::EMPTY; numbers.len()];
    let mut shines = vec![false; numbers.len()];
    for (triangle, corners) in triangles.iter().enumerate() {
        let own = body[triangle];
        let [a, b, c] = corners.map(DVec3::from);
        volumes[own] += a.dot(b.cross(c));
        extents[own] = corners.iter().fold(extents[own], |extent, corner| extent.with(*corner));
        let material = tracer.scene.triangles[triangle].material as usize;
        shines[own] |= tracer.scene.materials[material].light.emissive != [0.0; 3];
        is_sealed[own] &= tracer.covers[triangle] == Cover::OPAQUE && corners.iter().all(|corner| corner.is_finite());
    }
    // Closed: along every edge as many of the body's triangles run one way as the other.
    for of in along.values() {
        let mut ways: Vec<(usize, i32)> =
            of.iter().map(|&(triangle, forward)| (body[triangle as usize], if forward { 1 } else { -1 })).collect();
        ways.sort_unstable();
        for own in ways.chunk_by(|a, b| a.0 == b.0) {
            is_sealed[own[0].0] &= own.iter().map(|(_, way)| way).sum::<i32>() == 0;
        }
    }
    let emitters: Vec<Extent> = (0..numbers.len())
        .filter(|own| shines[*own])
        .map(|own| extents[own])
        .chain(tracer.scene.lights.iter().map(|light| Extent::EMPTY.with(light.position)))
        .collect();
    is_sealed.par_iter_mut().enumerate().for_each(|(own, is_sealed)| {
        *is_sealed = *is_sealed && volumes[own] > 0.0 && !emitters.iter().any(|emitter| emitter.meets(&extents[own]));
    });
    body.into_iter().map(|own| is_sealed[own]).collect()
}

/// Triangles joined to bodies, each with the number of one of its triangles.
struct Bodies {
    parents: Vec<u32>,
}

impl Bodies {
    fn new(count: usize) -> Self {
        Self { parents: (0..count as u32).collect() }
    }

    fn of(&mut self, mut triangle: u32) -> u32 {
        while self.parents[triangle as usize] != triangle {
            let above = self.parents[self.parents[triangle as usize] as usize];
            self.parents[triangle as usize] = above;
            triangle = above;
        }
        triangle
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.of(a), self.of(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::super::charts::Charts;
    use super::*;
    use crate::bvh::Bvh;
    use corf_scene::Scene;
    use corf_scene::model::{LightMaterial, Material, Object, Triangle};

    /// Adds a box, its fronts outside or inside; without its lid if wanted.
    fn add_box(scene: &mut Scene, low: Vec3, size: f32, outward: bool, has_lid: bool, light: LightMaterial) {
        let material = scene.materials.len() as u32;
        scene.materials.push(Material { name: format!("m{material}"), light, radio: None });
        scene.objects.push(Object { name: format!("box {material}") });
        let first = scene.positions.len() as u32;
        for k in 0..8u32 {
            scene.positions.push(low + size * Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32));
            scene.normals.push(Vec3::Z);
            scene.uvs.push([0.0; 2]);
        }
        let faces: [[u32; 4]; 6] = [[4, 5, 7, 6], [0, 2, 3, 1], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for [a, b, c, d] in &faces[usize::from(!has_lid)..] {
            for [a, b, c] in [[a, b, c], [a, c, d]] {
                let turned = if outward { [a, b, c] } else { [a, c, b] };
                let vertices = turned.map(|v| first + v);
                scene.triangles.push(Triangle { vertices, material, object: material });
            }
        }
    }

    /// Of each box, whether its backs are dark.
    fn dark(scene: &Scene) -> Vec<bool> {
        let bvh = Bvh::build(scene);
        let charts = Charts::new(&LightTracer::new(scene, &bvh));
        let mut dark = vec![None; scene.objects.len()];
        for (triangle, chart) in charts.of_triangle.iter().enumerate() {
            let own = charts.is_sealed(*chart, 1);
            assert!(!charts.is_sealed(*chart, 0), "fronts are never dark");
            let object = scene.triangles[triangle].object as usize;
            assert_eq!(*dark[object].get_or_insert(own), own, "all of a body or none");
        }
        dark.into_iter().flatten().collect()
    }

    #[test]
    fn a_closed_opaque_box_without_a_lamp_is_dark_inside_and_no_other() {
        let plain = LightMaterial::default();
        let mut scene = Scene::default();
        let mut put = |low: [f32; 3], size: f32, outward: bool, has_lid: bool, light: &LightMaterial| {
            add_box(&mut scene, Vec3::from(low), size, outward, has_lid, light.clone());
        };
        put([0.0, 0.0, 0.0], 1.0, true, true, &plain);
        // Along an edge of it.
        put([1.0, 1.0, 0.0], 1.0, true, true, &plain);
        put([10.0, 0.0, 0.0], 1.0, false, true, &plain);
        put([20.0, 0.0, 0.0], 1.0, true, false, &plain);
        put([30.0, 0.0, 0.0], 1.0, true, true, &LightMaterial { transmission: 0.5, ..plain.clone() });
        put([40.0, 0.0, 0.0], 1.0, true, true, &LightMaterial { emissive: [1.0; 3], ..plain.clone() });
        // A room whose walls face outwards, and what is in it: a lamp, and a cupboard.
        put([50.0, 0.0, 0.0], 5.0, true, true, &plain);
        put([51.0, 1.0, 1.0], 0.1, true, true, &LightMaterial { emissive: [1.0; 3], ..plain.clone() });
        put([53.0, 1.0, 1.0], 1.0, true, true, &plain);
        assert_eq!(dark(&scene), [true, true, false, false, false, false, false, false, true]);
    }
}
