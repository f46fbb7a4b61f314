//! World-fixed surface patches and which sources light them.

use super::illumination::{Illumination, Lighting};
use crate::radio::geometry::Geometry;
use glam::{DVec2, DVec3};
use std::sync::OnceLock;

/// Probes of a patch, in units of its sides: a shadow's edge must pass between all of them to be missed. Corners and centre come first;
/// they alone are asked about mirror images, which are 10 dB and more fainter than the transmitter.
const PROBES: [(f64, f64); 9] =
    [(0.01, 0.01), (0.99, 0.01), (0.99, 0.99), (0.01, 0.99), (0.5, 0.5), (0.5, 0.01), (0.99, 0.5), (0.5, 0.99), (0.01, 0.5)];
/// How many of them mirror images are asked at.
const MIRROR_PROBES: usize = 5;

/// A source as a patch sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PatchSource {
    /// Index into the illumination's sources.
    pub source: u32,
    /// `Some` when all of the patch agrees; `None` where a shadow's edge crosses it and every point has to ask for itself.
    pub lighting: Option<Lighting>,
}

/// A face's grid of square patches, in an orthonormal frame of its plane.
struct PatchGrid {
    origin: DVec3,
    along: [DVec3; 2],
    patch_m: DVec2,
    counts: [usize; 2],
    first: usize,
}

/// All patches of a scene with the sources that light each of them, found when a patch is first asked for.
pub struct Patches {
    grids: Vec<PatchGrid>,
    /// Sources by patch. A patch's content does not depend on who asks first.
    sources: Vec<OnceLock<Box<[PatchSource]>>>,
}

impl Patches {
    /// Cuts every face into patches of at most `patch_m`; `phase` ∈ [0, 1)² shifts the grids.
    pub fn new(geometry: &Geometry<'_>, patch_m: f64, phase: DVec2) -> Self {
        let mut triangles_of_face: Vec<Vec<[DVec3; 3]>> = vec![Vec::new(); geometry.faces.len()];
        for t in 0..geometry.triangle_count() as u32 {
            triangles_of_face[geometry.face_of_triangle(t) as usize].push(*geometry.corners(t));
        }
        let mut count = 0;
        let mut grids = Vec::with_capacity(geometry.faces.len());
        for (face, triangles) in geometry.faces.iter().zip(&triangles_of_face) {
            let mut grid = PatchGrid::new(face.normal, triangles, patch_m, phase);
            grid.first = count;
            count += grid.counts[0] * grid.counts[1];
            grids.push(grid);
        }
        Self { grids, sources: (0..count).map(|_| OnceLock::new()).collect() }
    }

    /// The sources of the patch that a point of a face lies on.
    pub fn sources_at(&self, illumination: &Illumination<'_, '_>, face: u32, point: DVec3) -> &[PatchSource] {
        let grid = &self.grids[face as usize];
        let cell = grid.cell(point);
        self.sources[grid.first + cell].get_or_init(|| grid.probe(illumination, face, cell))
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.sources.len()
    }
}

impl PatchGrid {
    fn new(normal: DVec3, triangles: &[[DVec3; 3]], patch_m: f64, phase: DVec2) -> Self {
        // Along the longest edge, so that a strip is cut across.
        let edges = triangles.iter().flat_map(|t| [t[1] - t[0], t[2] - t[1], t[0] - t[2]]);
        let longest = edges.fold(DVec3::ZERO, |best, e| if e.length_squared() > best.length_squared() { e } else { best });
        let u = (longest - normal * longest.dot(normal)).normalize_or(normal.any_orthonormal_vector());
        let v = normal.cross(u);
        let anchor = triangles[0][0];
        let (mut min, mut max) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for p in triangles.iter().flatten() {
            let q = DVec2::new((*p - anchor).dot(u), (*p - anchor).dot(v));
            (min, max) = (min.min(q), max.max(q));
        }
        let extent = (max - min).max(DVec2::splat(1e-6));
        // A face smaller than a patch is one patch; larger ones are shifted by the phase and gain a row and a column for it.
        let count = |extent: f64| if extent <= patch_m { 1 } else { (extent / patch_m).ceil() as usize + 1 };
        let counts = [count(extent.x), count(extent.y)];
        let size = |extent: f64, count: usize| if count == 1 { extent } else { extent / (count - 1) as f64 };
        let patch_m = DVec2::new(size(extent.x, counts[0]), size(extent.y, counts[1]));
        let shift = DVec2::new(
            if counts[0] == 1 { 0.0 } else { phase.x * patch_m.x },
            if counts[1] == 1 { 0.0 } else { phase.y * patch_m.y },
        );
        let corner = min - shift;
        Self { origin: anchor + u * corner.x + v * corner.y, along: [u, v], patch_m, counts, first: 0 }
    }

    fn cell(&self, point: DVec3) -> usize {
        let p = point - self.origin;
        let index = |i: usize, size: f64| ((p.dot(self.along[i]) / size) as usize).min(self.counts[i] - 1);
        index(1, self.patch_m.y) * self.counts[0] + index(0, self.patch_m.x)
    }

    /// Asks for the lighting at the probes of one patch. Probes beyond the face's outline are as good as any: where they disagree the
    /// patch is left open and its points are asked one by one.
    fn probe(&self, illumination: &Illumination<'_, '_>, face: u32, cell: usize) -> Box<[PatchSource]> {
        let at = DVec2::new((cell % self.counts[0]) as f64, (cell / self.counts[0]) as f64);
        let points = PROBES.map(|p| {
            let q = (at + DVec2::from(p)) * self.patch_m;
            self.origin + self.along[0] * q.x + self.along[1] * q.y
        });
        let mut lit = Vec::new();
        for (index, source) in illumination.sources.iter().enumerate() {
            let probes = if source.mirror.is_some() { &points[..MIRROR_PROBES] } else { &points };
            let first = illumination.lighting(*source, probes[0], face);
            let mut agree = true;
            for point in &probes[1..] {
                agree &= illumination.lighting(*source, *point, face) == first;
                if !agree {
                    break;
                }
            }
            if !agree || first != Lighting::Dark {
                lit.push(PatchSource { source: index as u32, lighting: agree.then_some(first) });
            }
        }
        lit.into_boxed_slice()
    }
}
