//! World-fixed surface patches and which sources light them.

use super::illumination::{Illumination, Lighting};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Probes per patch and axis, on its border and inside: a shadow's edge must pass between all of them to be missed.
const PROBES_PER_AXIS: usize = 4;
/// Patches smaller than this are probed at their corners and centre only, metres.
const SMALL_PATCH_M: f64 = 0.1;

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

/// All patches of a scene with the sources that light each of them.
pub struct Patches {
    grids: Vec<PatchGrid>,
    /// Sources of patch `i`: `sources[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    sources: Vec<PatchSource>,
}

impl Patches {
    /// Cuts every face into patches of at most `patch_m` and probes which sources light them; `phase` ∈ [0, 1)² shifts the grids.
    pub fn new(illumination: &Illumination<'_, '_>, patch_m: f64, phase: DVec2) -> Self {
        let geometry = illumination.geometry();
        let mut triangles_of_face: Vec<Vec<u32>> = vec![Vec::new(); geometry.faces.len()];
        for t in 0..geometry.triangle_count() as u32 {
            triangles_of_face[geometry.face_of_triangle(t) as usize].push(t);
        }
        let mut grids = Vec::with_capacity(geometry.faces.len());
        let mut owners: Vec<(u32, u32)> = Vec::new(); // (face, cell within it)
        for (face, triangles) in triangles_of_face.iter().enumerate() {
            let mut grid = PatchGrid::new(
                geometry.faces[face].normal,
                triangles.iter().map(|&t| *geometry.corners(t)).collect::<Vec<_>>().as_slice(),
                patch_m,
                phase,
            );
            grid.first = owners.len();
            owners.extend((0..grid.counts[0] * grid.counts[1]).map(|cell| (face as u32, cell as u32)));
            grids.push(grid);
        }
        let per_patch: Vec<Vec<PatchSource>> =
            owners.par_iter().map(|&(face, cell)| grids[face as usize].probe(illumination, face, cell as usize)).collect();
        let mut starts = Vec::with_capacity(per_patch.len() + 1);
        let mut sources = Vec::new();
        starts.push(0);
        for list in per_patch {
            sources.extend(list);
            starts.push(sources.len() as u32);
        }
        Self { grids, starts, sources }
    }

    /// The sources of the patch that a point of a face lies on.
    pub fn sources_at(&self, face: u32, point: DVec3) -> &[PatchSource] {
        let grid = &self.grids[face as usize];
        let patch = grid.first + grid.cell(point);
        &self.sources[self.starts[patch] as usize..self.starts[patch + 1] as usize]
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }
}

impl PatchGrid {
    fn new(normal: DVec3, triangles: &[[DVec3; 3]], patch_m: f64, phase: DVec2) -> Self {
        // Along the longest edge of the first triangle (the largest of its face comes first nowhere in particular; any edge will do).
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
    fn probe(&self, illumination: &Illumination<'_, '_>, face: u32, cell: usize) -> Vec<PatchSource> {
        let at = DVec2::new((cell % self.counts[0]) as f64, (cell / self.counts[0]) as f64);
        let mut probes: [DVec2; PROBES_PER_AXIS * PROBES_PER_AXIS] = [DVec2::ZERO; PROBES_PER_AXIS * PROBES_PER_AXIS];
        let count = if self.patch_m.max_element() < SMALL_PATCH_M {
            for (i, p) in [(0.02, 0.02), (0.98, 0.02), (0.98, 0.98), (0.02, 0.98), (0.5, 0.5)].into_iter().enumerate() {
                probes[i] = DVec2::new(p.0, p.1);
            }
            5
        } else {
            let step = 0.98 / (PROBES_PER_AXIS - 1) as f64;
            for (i, probe) in probes.iter_mut().enumerate() {
                *probe = DVec2::new((i % PROBES_PER_AXIS) as f64, (i / PROBES_PER_AXIS) as f64) * step + 0.01;
            }
            probes.len()
        };
        let points: Vec<DVec3> = probes[..count]
            .iter()
            .map(|p| {
                let q = (at + *p) * self.patch_m;
                self.origin + self.along[0] * q.x + self.along[1] * q.y
            })
            .collect();
        let mut lit = Vec::new();
        for (index, source) in illumination.sources.iter().enumerate() {
            let first = illumination.lighting(*source, points[0], face);
            let mut agree = true;
            let mut any = first != Lighting::Dark;
            for point in &points[1..] {
                let lighting = illumination.lighting(*source, *point, face);
                agree &= lighting == first;
                any |= lighting != Lighting::Dark;
                if any && !agree {
                    break;
                }
            }
            if any {
                lit.push(PatchSource { source: index as u32, lighting: agree.then_some(first) });
            }
        }
        lit
    }
}
