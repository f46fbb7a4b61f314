//! World-fixed surface patches, on which indirect light is kept.

use crate::radio::geometry::Geometry;
use crate::radio::geometry::face::Face;
use corf_scene::{Error, Result, bounds};
use glam::{DVec2, DVec3};

/// Subcells along a patch's side: where within a patch light falls is known this finely.
const GRAIN_SIDE: usize = 5;
/// Subcells of a patch.
pub const GRAINS: usize = GRAIN_SIDE * GRAIN_SIDE;

/// A face's grid of square patches, in an orthonormal frame of its plane.
struct PatchGrid {
    origin: DVec3,
    along: [DVec3; 2],
    patch_m: DVec2,
    counts: [usize; 2],
    first: usize,
}

/// The patches around a point of a face with their weights in bilinear interpolation; the last ones may repeat or weigh nothing.
#[derive(Clone, Copy, Debug)]
pub struct Around {
    /// Patches, as indices below [`Patches::len`].
    pub patches: [u32; 4],
    /// Their weights; the sum is 1.
    pub weights: [f32; 4],
}

/// All patches of a scene.
pub struct Patches {
    grids: Vec<PatchGrid>,
    /// The face's area in every patch, m².
    areas_m2: Vec<f64>,
}

/// Memory of a patch in all tables together while they are made, bytes; those of lit patches come on top.
const PATCH_BYTES: f64 = 600.0;

/// Refuses more patches than fit the memory or can be numbered.
fn check_count(patches: f64, patch_m: f64) -> Result<()> {
    let (place, help) = ("patch_size_m", "give larger patches; if the model is in centimetres or millimetres, give it in metres");
    let what = format!("cutting the scene's surfaces into {patches:.3e} patches of {patch_m} m");
    if patches > f64::from(u32::MAX / 2) {
        return Err(Error::invalid(place, format!("{what} would take {:.1} GB", PATCH_BYTES * patches / 1e9), help));
    }
    bounds::memory(place, &what, PATCH_BYTES * patches, help)
}

impl Patches {
    /// Cuts every face into patches of at most `patch_m`; `phase` ∈ [0, 1)² shifts the grids.
    ///
    /// # Errors
    /// More patches than fit the memory.
    pub fn new(geometry: &Geometry<'_>, patch_m: f64, phase: DVec2) -> Result<Self> {
        let mut triangles_of_face: Vec<Vec<[DVec3; 3]>> = vec![Vec::new(); geometry.faces.len()];
        for t in 0..geometry.triangle_count() as u32 {
            triangles_of_face[geometry.face_of_triangle(t) as usize].push(*geometry.corners(t));
        }
        let faces = || geometry.faces.iter().zip(&triangles_of_face);
        let mut grids: Vec<PatchGrid> =
            faces().map(|(face, triangles)| PatchGrid::new(face.normal, triangles, patch_m, phase)).collect();
        check_count(grids.iter().map(|grid| grid.counts[0] as f64 * grid.counts[1] as f64).sum(), patch_m)?;
        let mut areas_m2 = Vec::new();
        for ((_, triangles), grid) in faces().zip(&mut grids) {
            grid.first = areas_m2.len();
            areas_m2.extend(grid.areas_m2(triangles));
        }
        Ok(Self { grids, areas_m2 })
    }

    /// The face's area in each patch, m².
    pub fn areas_m2(&self) -> &[f64] {
        &self.areas_m2
    }

    /// The patches of a face, with their centres.
    pub fn of_face(&self, face: u32) -> impl Iterator<Item = (usize, DVec3)> + '_ {
        let grid = &self.grids[face as usize];
        (0..grid.counts[0] * grid.counts[1]).map(|cell| (grid.first + cell, grid.centre(cell)))
    }

    /// The centres of a patch's [`GRAINS`] with their numbers, of those that lie on the face.
    pub fn subcells<'f>(&'f self, face: &'f Face, number: u32, patch: usize) -> impl Iterator<Item = (usize, DVec3)> + 'f {
        let grid = &self.grids[number as usize];
        let centre = grid.centre(patch - grid.first);
        (0..GRAINS)
            .map(move |i| {
                let at = DVec2::new((i % GRAIN_SIDE) as f64 + 0.5, (i / GRAIN_SIDE) as f64 + 0.5) / GRAIN_SIDE as f64 - 0.5;
                (i, centre + grid.along[0] * (at.x * grid.patch_m.x) + grid.along[1] * (at.y * grid.patch_m.y))
            })
            .filter(|(_, point)| face.contains(*point))
    }

    /// Points at which what [`Self::around`] interpolates has its mean over one of a patch's subcells, or over all of it: interpolation
    /// bends at a patch's centre, so that whatever lies across that has a point in each half. `centre` is the subcell's, or the patch's.
    pub fn means(&self, face: u32, centre: DVec3, subcell: Option<usize>) -> impl Iterator<Item = DVec3> {
        let grid = &self.grids[face as usize];
        let half = |place: usize| if place == GRAIN_SIDE / 2 { 0.25 / GRAIN_SIDE as f64 } else { 0.0 };
        let [x, y] = subcell.map_or([0.25; 2], |subcell| [half(subcell % GRAIN_SIDE), half(subcell / GRAIN_SIDE)]);
        let [across, up] = [grid.along[0] * (x * grid.patch_m.x), grid.along[1] * (y * grid.patch_m.y)];
        let signs = |share: f64| [-1.0, 1.0].into_iter().take(if share == 0.0 { 1 } else { 2 });
        signs(x).flat_map(move |i| signs(y).map(move |j| centre + across * i + up * j))
    }

    /// Column and row of one of a face's patches.
    pub fn cell_of(&self, face: u32, patch: usize) -> [usize; 2] {
        let grid = &self.grids[face as usize];
        [(patch - grid.first) % grid.counts[0], (patch - grid.first) / grid.counts[0]]
    }

    /// The frame of a face's grid: two axes of its plane.
    pub fn axes(&self, face: u32) -> [DVec3; 2] {
        self.grids[face as usize].along
    }

    /// The patch that a point of a face lies on, and the number of its subcell.
    pub fn at(&self, face: u32, point: DVec3) -> (usize, usize) {
        let grid = &self.grids[face as usize];
        let (cell, subcell) = grid.cell(point);
        (grid.first + cell, subcell)
    }

    /// The patches whose centres surround a point of a face.
    pub fn around(&self, face: u32, point: DVec3) -> Around {
        self.grids[face as usize].around(point)
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.areas_m2.len()
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

    /// A patch's area is that of the triangles clipped to it.
    fn areas_m2(&self, triangles: &[[DVec3; 3]]) -> Vec<f64> {
        let mut areas = vec![0.0; self.counts[0] * self.counts[1]];
        for triangle in triangles {
            let corners =
                triangle.map(|p| DVec2::new((p - self.origin).dot(self.along[0]), (p - self.origin).dot(self.along[1])));
            let low = corners[0].min(corners[1]).min(corners[2]) / self.patch_m;
            let high = corners[0].max(corners[1]).max(corners[2]) / self.patch_m;
            let range = |low: f64, high: f64, count: usize| (low as usize).min(count - 1)..=(high as usize).min(count - 1);
            for y in range(low.y, high.y, self.counts[1]) {
                for x in range(low.x, high.x, self.counts[0]) {
                    let corner = DVec2::new(x as f64, y as f64) * self.patch_m;
                    areas[y * self.counts[0] + x] += clipped_area(&corners, corner, corner + self.patch_m);
                }
            }
        }
        areas
    }

    fn centre(&self, cell: usize) -> DVec3 {
        let at = DVec2::new((cell % self.counts[0]) as f64 + 0.5, (cell / self.counts[0]) as f64 + 0.5) * self.patch_m;
        self.origin + self.along[0] * at.x + self.along[1] * at.y
    }

    fn around(&self, point: DVec3) -> Around {
        if self.counts == [1, 1] {
            return Around { patches: [self.first as u32; 4], weights: [1.0, 0.0, 0.0, 0.0] };
        }
        let p = point - self.origin;
        // Cell below the point and the share of the one above, along an axis.
        let along = |i: usize, size: f64| -> ([usize; 2], f32) {
            let at = (p.dot(self.along[i]) / size - 0.5).max(0.0);
            let below = (at as usize).min(self.counts[i] - 1);
            ([below, (below + 1).min(self.counts[i] - 1)], (at - below as f64).min(1.0) as f32)
        };
        let ((x, s), (y, t)) = (along(0, self.patch_m.x), along(1, self.patch_m.y));
        let patch = |x: usize, y: usize| (self.first + y * self.counts[0] + x) as u32;
        Around {
            patches: [patch(x[0], y[0]), patch(x[1], y[0]), patch(x[0], y[1]), patch(x[1], y[1])],
            weights: [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t],
        }
    }

    /// The cell of a point, and the subcell in it.
    fn cell(&self, point: DVec3) -> (usize, usize) {
        let p = point - self.origin;
        let index = |i: usize, size: f64| {
            let at = (p.dot(self.along[i]) / size).max(0.0);
            let cell = (at as usize).min(self.counts[i] - 1);
            (cell, (((at - cell as f64) * GRAIN_SIDE as f64) as usize).min(GRAIN_SIDE - 1))
        };
        let ((x, s), (y, t)) = (index(0, self.patch_m.x), index(1, self.patch_m.y));
        (y * self.counts[0] + x, t * GRAIN_SIDE + s)
    }
}

/// Area of a triangle inside a rectangle (Sutherland–Hodgman).
fn clipped_area(triangle: &[DVec2; 3], low: DVec2, high: DVec2) -> f64 {
    let mut polygon: Vec<DVec2> = triangle.to_vec();
    for axis in 0..2 {
        for (bound, sign) in [(low[axis], 1.0), (high[axis], -1.0)] {
            let inside = |p: DVec2| (p[axis] - bound) * sign;
            let mut next = Vec::with_capacity(polygon.len() + 1);
            for (i, &b) in polygon.iter().enumerate() {
                let a = polygon[(i + polygon.len() - 1) % polygon.len()];
                let (da, db) = (inside(a), inside(b));
                if (da >= 0.0) != (db >= 0.0) {
                    next.push(a + (b - a) * (da / (da - db)));
                }
                if db >= 0.0 {
                    next.push(b);
                }
            }
            polygon = next;
        }
    }
    let doubled: f64 =
        polygon.iter().enumerate().map(|(i, &b)| polygon[(i + polygon.len() - 1) % polygon.len()].perp_dot(b)).sum();
    0.5 * doubled.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_what_is_interpolated_over_a_grain_or_a_patch_is_found_at_few_points() {
        let corners = [DVec3::ZERO, DVec3::new(1.0, 0.0, 0.0), DVec3::new(1.0, 0.7, 0.0), DVec3::new(0.0, 0.7, 0.0)];
        let grid = PatchGrid::new(
            DVec3::Z,
            &[[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]],
            0.2,
            DVec2::splat(0.3),
        );
        let patches = Patches { areas_m2: vec![0.0; grid.counts[0] * grid.counts[1]], grids: vec![grid] };
        let mut rng = corf_scene::Rng::keyed(9, 0, 0);
        // Bright beside dark: nearly all that a dark patch's middle subcell shows comes from its neighbours.
        let values: Vec<f64> = (0..patches.len()).map(|_| 10f64.powf(6.0 * rng.uniform_f64())).collect();
        let value = |at: DVec3| {
            let around = patches.around(0, at);
            around
                .patches
                .iter()
                .zip(around.weights)
                .map(|(&patch, weight)| values[patch as usize] * f64::from(weight))
                .sum::<f64>()
        };
        let grid = &patches.grids[0];
        for (patch, centre) in patches.of_face(0) {
            for subcell in (0..GRAINS).map(Some).chain([None]) {
                let place = |i: usize| ((i as f64 + 0.5) / GRAIN_SIDE as f64 - 0.5) * grid.patch_m;
                let side = if subcell.is_some() { 1.0 / GRAIN_SIDE as f64 } else { 1.0 };
                let [x, y] = subcell.map_or([0.0; 2], |g| [place(g % GRAIN_SIDE).x, place(g / GRAIN_SIDE).y]);
                let middle = centre + grid.along[0] * x + grid.along[1] * y;
                const FINE: usize = 40;
                let off = |i: usize| ((i as f64 + 0.5) / FINE as f64 - 0.5) * side * grid.patch_m;
                let fine = (0..FINE * FINE).map(|i| middle + grid.along[0] * off(i % FINE).x + grid.along[1] * off(i / FINE).y);
                let wanted = fine.map(value).sum::<f64>() / (FINE * FINE) as f64;
                let points: Vec<DVec3> = patches.means(0, middle, subcell).collect();
                let found = points.iter().copied().map(value).sum::<f64>() / points.len() as f64;
                assert!((found / wanted - 1.0).abs() < 2e-3, "patch {patch}, subcell {subcell:?}: {found} {wanted}");
            }
        }
    }

    #[test]
    fn the_areas_of_a_triangle_in_all_cells_sum_to_its_own() {
        let mut rng = corf_scene::Rng::keyed(4, 0, 0);
        for _ in 0..200 {
            let triangle = [0; 3].map(|_| DVec2::new(rng.uniform_f64(), rng.uniform_f64()) * 4.0);
            let whole = 0.5 * (triangle[1] - triangle[0]).perp_dot(triangle[2] - triangle[0]).abs();
            let mut sum = 0.0;
            for y in 0..4 {
                for x in 0..4 {
                    let low = DVec2::new(f64::from(x), f64::from(y));
                    sum += clipped_area(&triangle, low, low + 1.0);
                }
            }
            assert!((sum - whole).abs() < 1e-12, "{sum} {whole}");
        }
    }
}
