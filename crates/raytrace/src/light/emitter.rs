//! Emitters: every emissive triangle and punctual light, and which of them a point should ask.
//!
//! The scene's box is cut into cells; each cell holds a cumulative distribution over all emitters, proportional to power × cosine
//! ÷ distance², times an estimate of how much of the emitter the cell sees. A shading point draws one emitter from its cell's
//! distribution (O(log n), stratified in the random number) and the density of any choice is known exactly, as MIS needs.

use super::luminance;
use super::surface::{Cover, emission, offset};
use super::texture::{Encoding, mean};
use super::triangle::{patch_index, patches, polygon_vector, spherical_triangle};
use crate::bvh::{Bvh, Hit, Ray};
use corf_scene::model::{PunctualKind, PunctualLight};
use corf_scene::{Rng, Scene};
use glam::{UVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Emitting triangles are divided into patches with edges of at most this length, metres: of a street seen through a window, each cell
/// asks the patches it sees.
const PATCH_EDGE_M: f32 = 2.0;
const MAX_PARTS: u32 = 16;
/// Wished edge of a cell, metres.
const CELL_M: f32 = 0.75;
/// Cells × emitters held at most (4 bytes each); cells grow until it fits.
const MAX_ENTRIES: usize = 4_000_000;
/// Visibility rays per cell and emitter, and over the whole table at most.
const VISIBILITY_RAYS: usize = 12;
const MAX_VISIBILITY_RAYS: usize = 6_000_000;
/// Emitters with less than this share of a cell's weight are not tested for visibility: they are rarely asked as it is.
const WORTH_A_LOOK: f32 = 1e-3;
/// An emitter that no visibility ray saw keeps this share of its weight: unseen by a dozen rays is not invisible.
const UNSEEN_SHARE: f32 = 0.04;
/// The stage of [`Rng::keyed`] of the visibility estimate.
const STAGE_VISIBILITY: u64 = 0xce11;

#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    /// A triangle or a patch of one; `weights` are the corners' barycentric coordinates in the whole.
    Patch {
        corners: [Vec3; 3],
        weights: [Vec2; 3],
        normal: Vec3,
        area: f32,
        double_sided: bool,
        triangle: u32,
    },
    Punctual(PunctualLight),
}

/// An emitting patch, or a light without extent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Emitter {
    pub kind: Kind,
    /// Mean radiance (triangle), intensity (point, spot) or irradiance (directional), luminance.
    pub luminance: f32,
    /// Likewise, in colour.
    pub power: Vec3,
}

/// Light arriving from a sampled point of an emitter.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightSample {
    /// Vector from the shading point to the light, not normalised: the light is at `t = 1`.
    pub to_light: Vec3,
    /// Radiance over the density (area lights), or irradiance over the choice's probability (punctual), before visibility.
    pub weight: Vec3,
    /// Density per steradian; infinite for punctual lights, which no reflection can hit.
    pub pdf: f32,
}

/// All emitters of a scene, with the cells.
#[derive(Debug)]
pub(super) struct Emitters {
    /// Patches, then lights without extent.
    pub list: Vec<Emitter>,
    /// Where in `list` the lights without extent begin.
    pub first_punctual: usize,
    /// Per triangle of the scene: its first patch, or `u32::MAX`, and into how many parts its edges are divided.
    pub of_triangle: Vec<(u32, u32)>,
    pub grid_min: Vec3,
    pub cells_per_metre: Vec3,
    pub cells: UVec3,
    /// `cells × list.len()` cumulative probabilities, the last of every cell 1.
    pub cumulative: Vec<f32>,
    /// `cells × list.len()`: the share of each emitter that the cell's visibility rays saw, in 255ths; 0 where none were spent.
    pub seen: Vec<u8>,
    /// Per cell, where the search for a random number in each of [`BUCKETS`] equal intervals begins, and where the last one ends.
    pub guides: Vec<[u32; BUCKETS + 1]>,
}

/// Intervals of a cell's guide: with the end, one cache line.
const BUCKETS: usize = 15;

impl Emitters {
    /// Gathers the emitters and fills the cells.
    pub fn new(scene: &Scene, bvh: &Bvh, covers: &[Cover]) -> Self {
        let mut of_triangle = vec![(u32::MAX, 0); scene.triangles.len()];
        let mut list = Vec::new();
        let radiance: Vec<Vec3> = scene
            .materials
            .iter()
            .map(|m| {
                let texture = m.light.emissive_texture.as_ref().map_or([1.0; 3], |t| mean(&scene.textures, t, Encoding::Srgb));
                Vec3::from(m.light.emissive) * Vec3::from(texture)
            })
            .collect();
        for (i, t) in scene.triangles.iter().enumerate() {
            let power = radiance[t.material as usize];
            let luminance = luminance(power);
            let corners = scene.corners(i);
            let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let area = 0.5 * cross.length();
            if luminance > 0.0 && area > 0.0 && area.is_finite() {
                let longest = (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(0.0, f32::max);
                let parts = ((longest / PATCH_EDGE_M).ceil() as u32).clamp(1, MAX_PARTS);
                of_triangle[i] = (list.len() as u32, parts);
                for weights in patches(parts) {
                    let kind = Kind::Patch {
                        corners: weights.map(|w| corners[0] * (1.0 - w.x - w.y) + corners[1] * w.x + corners[2] * w.y),
                        weights,
                        normal: cross.normalize(),
                        area: area / (parts * parts) as f32,
                        double_sided: scene.materials[t.material as usize].light.double_sided,
                        triangle: i as u32,
                    };
                    list.push(Emitter { kind, luminance, power });
                }
            }
        }
        let first_punctual = list.len();
        for light in &scene.lights {
            let power = Vec3::from(light.intensity);
            let luminance = luminance(power);
            if luminance > 0.0 {
                list.push(Emitter { kind: Kind::Punctual(*light), luminance, power });
            }
        }
        let mut emitters = Self {
            list,
            first_punctual,
            of_triangle,
            grid_min: Vec3::ZERO,
            cells_per_metre: Vec3::ONE,
            cells: UVec3::ONE,
            cumulative: Vec::new(),
            seen: Vec::new(),
            guides: Vec::new(),
        };
        emitters.fill_cells(scene, bvh, covers);
        emitters
    }

    /// Whether there is anything to sample.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    fn fill_cells(&mut self, scene: &Scene, bvh: &Bvh, covers: &[Cover]) {
        let (Some(bounds), n) = (scene.bounds(), self.list.len()) else { return };
        if n == 0 {
            return;
        }
        let size = (bounds.max - bounds.min).max(Vec3::splat(1e-3));
        let mut edge = CELL_M;
        loop {
            self.cells = (size / edge).ceil().clamp(Vec3::ONE, Vec3::splat(1024.0)).as_uvec3();
            if self.cells.as_u64vec3().element_product() * n as u64 <= MAX_ENTRIES as u64 || self.cells == UVec3::ONE {
                break;
            }
            edge *= 1.26;
        }
        self.grid_min = bounds.min;
        self.cells_per_metre = self.cells.as_vec3() / size;
        let count = self.cells.element_product() as usize;
        let rays = VISIBILITY_RAYS.min(MAX_VISIBILITY_RAYS / (count * n).max(1));
        let blocks = |triangle: u32| covers[triangle as usize] == Cover::OPAQUE;
        let mut cumulative = vec![0.0f32; count * n];
        let mut seen_shares = vec![0u8; count * n];
        cumulative.par_chunks_mut(n).zip(seen_shares.par_chunks_mut(n)).enumerate().for_each(|(cell, (row, shares))| {
            let index = UVec3::new(
                cell as u32 % self.cells.x,
                cell as u32 / self.cells.x % self.cells.y,
                cell as u32 / (self.cells.x * self.cells.y),
            );
            let cell_size = size / self.cells.as_vec3();
            let low = self.grid_min + index.as_vec3() * cell_size;
            let mut rng = Rng::keyed(0, STAGE_VISIBILITY, cell as u64);
            let weights: Vec<f32> = self.list.iter().map(|emitter| emitter.importance(low, low + cell_size)).collect();
            let worth_a_look = WORTH_A_LOOK * weights.iter().sum::<f32>();
            let mut total = 0.0f64;
            for (((emitter, mut weight), slot), share) in self.list.iter().zip(weights).zip(row.iter_mut()).zip(shares) {
                if weight > worth_a_look && rays > 0 {
                    let seen = (0..rays).filter(|_| emitter.sees(bvh, &blocks, low, cell_size, &mut rng)).count();
                    weight *= UNSEEN_SHARE + (1.0 - UNSEEN_SHARE) * seen as f32 / rays as f32;
                    *share = (255 * seen / rays) as u8;
                }
                total += f64::from(weight);
                *slot = total as f32;
            }
            if total > 0.0 {
                row.iter_mut().for_each(|c| *c = (f64::from(*c) / total) as f32);
            }
            // The last emitter of positive weight ends at exactly 1, and so do those after it.
            let last = row.last().copied().unwrap_or(0.0);
            row.iter_mut().filter(|c| **c >= last).for_each(|c| *c = if total > 0.0 { 1.0 } else { 0.0 });
        });
        self.guides = cumulative
            .par_chunks(n)
            .map(|row| {
                std::array::from_fn(|k| {
                    if k == BUCKETS { n as u32 } else { row.partition_point(|c| *c <= k as f32 / BUCKETS as f32) as u32 }
                })
            })
            .collect();
        self.cumulative = cumulative;
        self.seen = seen_shares;
    }

    fn cell(&self, point: Vec3) -> usize {
        let at = ((point - self.grid_min) * self.cells_per_metre).max(Vec3::ZERO).as_uvec3().min(self.cells - 1);
        (at.x + self.cells.x * (at.y + self.cells.y * at.z)) as usize
    }

    fn row(&self, cell: usize) -> &[f32] {
        &self.cumulative[cell * self.list.len()..(cell + 1) * self.list.len()]
    }

    /// The emitter whose interval of a cell's distribution holds `choice`, or the list's length if there is none.
    fn find(&self, cell: usize, choice: f32) -> usize {
        let bucket = ((choice * BUCKETS as f32) as usize).min(BUCKETS - 1);
        let row = self.row(cell);
        // Rounding may put a choice at a bucket's very edge on the wrong side: widen by one at the end.
        let (first, last) = (self.guides[cell][bucket] as usize, (self.guides[cell][bucket + 1] as usize + 1).min(row.len()));
        first + row[first..last].partition_point(|c| *c <= choice)
    }

    fn probability(row: &[f32], i: usize) -> f32 {
        row[i] - if i == 0 { 0.0 } else { row[i - 1] }
    }

    /// Draws an emitter and a point on it for a shading point; `None` where none is worth asking.
    pub fn sample(&self, scene: &Scene, covers: &[Cover], point: Vec3, choice: f32, u: [f32; 2]) -> Option<LightSample> {
        if self.list.is_empty() {
            return None;
        }
        let cell = self.cell(point);
        let row = self.row(cell);
        let i = self.find(cell, choice);
        if i >= row.len() {
            return None;
        }
        let probability = Self::probability(row, i);
        match &self.list[i].kind {
            Kind::Patch { .. } => {
                let on_light = self.patch_point(scene, covers, i, point, u)?;
                let pdf = probability / on_light.solid_angle;
                Some(LightSample { to_light: on_light.position - point, weight: on_light.radiance / pdf, pdf })
            }
            Kind::Punctual(light) => {
                let (to_light, irradiance) = punctual(light, point)?;
                Some(LightSample { to_light, weight: irradiance / probability, pdf: f32::INFINITY })
            }
        }
    }

    /// Density per steradian with which [`Emitters::sample`] at `point` picks the direction of a hit at `distance`, seen under cosine
    /// `cos` (absolute).
    pub fn pdf(&self, point: Vec3, hit: &Hit, distance: f32, cos: f32) -> f32 {
        let (first, parts) = self.of_triangle[hit.triangle as usize];
        if first == u32::MAX {
            return 0.0;
        }
        let i = first as usize + patch_index(parts, hit.u, hit.v);
        let Kind::Patch { area, .. } = self.list[i].kind else { return 0.0 };
        Self::probability(self.row(self.cell(point)), i) * distance * distance / (area * cos).max(1e-20)
    }
}

/// A point of an emitting patch.
#[derive(Clone, Copy, Debug)]
pub(super) struct PatchPoint {
    /// Position just off the patch, on the side of the shading point.
    pub position: Vec3,
    /// Radiance towards the shading point, times the share of the surface that is there.
    pub radiance: Vec3,
    /// Area of the patch × cosine ÷ distance² as seen by who asked: a solid angle if the point stands for the whole patch.
    pub solid_angle: f32,
}

impl Emitters {
    /// Number of emitters: patches first, then punctual lights.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether an emitter has no extent.
    pub fn is_punctual(&self, i: usize) -> bool {
        i >= self.first_punctual
    }

    /// Whether any emitter has no extent.
    pub fn has_punctual(&self) -> bool {
        self.first_punctual < self.list.len()
    }

    /// The emitters without extent.
    pub fn punctual(&self) -> std::ops::Range<usize> {
        self.first_punctual..self.list.len()
    }

    /// Mean radiance of a patch.
    pub fn radiance(&self, i: usize) -> Vec3 {
        self.list[i].power
    }

    /// The share of an emitter that visibility rays from the surroundings of a point saw.
    pub fn seen_from(&self, point: Vec3, i: usize) -> f32 {
        f32::from(self.seen[self.cell(point) * self.list.len() + i]) / 255.0
    }

    /// Bound on the contribution of an emitter to the points of a box, shadows and the receiver's cosine left out: zero only if no point of
    /// the box can see its shining side.
    pub fn importance_in(&self, i: usize, low: Vec3, high: Vec3) -> f32 {
        self.list[i].importance(low, high)
    }

    /// Vector to a punctual light and the irradiance it sends at normal incidence; `None` for patches and out of its cone or range.
    pub fn punctual_at(&self, i: usize, point: Vec3) -> Option<(Vec3, Vec3)> {
        match &self.list[i].kind {
            Kind::Punctual(light) => punctual(light, point),
            Kind::Patch { .. } => None,
        }
    }

    /// `∫ l dω` over the part of a patch above a plane through `point` with normal `n`, unshadowed: times the radiance and a surface
    /// normal it is that surface's irradiance (Arvo 1994, *The Irradiance Jacobian*; Lambert's formula). Zero for punctual lights and
    /// behind one-sided patches.
    pub fn solid_angle_vector(&self, i: usize, point: Vec3, n: Vec3) -> Vec3 {
        let Kind::Patch { corners, normal, double_sided, .. } = &self.list[i].kind else { return Vec3::ZERO };
        let height = normal.dot(point - corners[0]);
        if height.abs() < 1e-6 || height < 0.0 && !double_sided {
            return Vec3::ZERO;
        }
        let vector = polygon_vector(corners.map(|c| c - point), n);
        // Counter-clockwise seen from the front, the sum points away from the patch.
        if height > 0.0 { -vector } else { vector }
    }

    /// Point of a patch as seen from `point`: drawn uniformly over the solid angle of patches that are near, and by
    /// [`Emitters::patch_point`] for all others. Drawn over the area, the few nearest square centimetres would bring most of the light and
    /// hardly ever be met.
    pub fn patch_toward(&self, scene: &Scene, covers: &[Cover], i: usize, point: Vec3, u: [f32; 2]) -> Option<PatchPoint> {
        let Kind::Patch { corners, weights, normal, area, double_sided, triangle } = &self.list[i].kind else { return None };
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        if centre.distance_squared(point) > NEAR * area {
            return self.patch_point(scene, covers, i, point, u);
        }
        let height = normal.dot(point - corners[0]);
        if height.abs() < 1e-6 || height < 0.0 && !double_sided {
            return None;
        }
        let (direction, solid_angle) = spherical_triangle(corners.map(|c| c - point), u)?;
        let on_light = point - direction * (height / normal.dot(direction));
        // Barycentric in the patch, then in the whole triangle.
        let (e1, e2, p) = (corners[1] - corners[0], corners[2] - corners[0], on_light - corners[0]);
        let (d11, d12, d22) = (e1.length_squared(), e1.dot(e2), e2.length_squared());
        let determinant = (d11 * d22 - d12 * d12).max(1e-30);
        let b1 = ((d22 * p.dot(e1) - d12 * p.dot(e2)) / determinant).clamp(0.0, 1.0);
        let b2 = ((d11 * p.dot(e2) - d12 * p.dot(e1)) / determinant).clamp(0.0, 1.0 - b1);
        let at = weights[0] * (1.0 - b1 - b2) + weights[1] * b1 + weights[2] * b2;
        let on_light = corners[0] + e1 * b1 + e2 * b2;
        Some(PatchPoint {
            position: on_light + *normal * (offset(on_light) * height.signum()),
            radiance: emission(scene, covers[*triangle as usize], *triangle, at.x, at.y),
            solid_angle,
        })
    }

    /// A point of a patch for uniform numbers, as seen from `point`; `None` where the patch does not shine there.
    pub fn patch_point(&self, scene: &Scene, covers: &[Cover], i: usize, point: Vec3, u: [f32; 2]) -> Option<PatchPoint> {
        let Kind::Patch { corners, weights, normal, area, double_sided, triangle } = &self.list[i].kind else { return None };
        let root = u[0].sqrt();
        let (b1, b2) = (u[1] * root, 1.0 - root);
        let on_light = corners[0] * (1.0 - b1 - b2) + corners[1] * b1 + corners[2] * b2;
        let away = point - on_light;
        let distance2 = away.length_squared();
        let cos = normal.dot(away) / distance2.sqrt();
        let cos = if *double_sided { cos.abs() } else { cos };
        if cos <= 1e-6 || distance2 < 1e-10 {
            return None;
        }
        let at = weights[0] * (1.0 - b1 - b2) + weights[1] * b1 + weights[2] * b2;
        Some(PatchPoint {
            // Lifted off the light so that the light does not shadow itself.
            position: on_light + *normal * (offset(on_light) * normal.dot(away).signum()),
            radiance: emission(scene, covers[*triangle as usize], *triangle, at.x, at.y),
            solid_angle: area * cos / distance2,
        })
    }
}

/// Patches whose centre is no farther than the root of this times their area are near.
const NEAR: f32 = 4.0;

/// Vector to a punctual light and the irradiance it sends at normal incidence (`KHR_lights_punctual`).
fn punctual(light: &PunctualLight, point: Vec3) -> Option<(Vec3, Vec3)> {
    /// A directional light's shadow rays reach this far, metres.
    const FAR_M: f32 = 1e4;
    let intensity = Vec3::from(light.intensity);
    if light.kind == PunctualKind::Directional {
        return Some((-light.direction * FAR_M, intensity));
    }
    let to_light = light.position - point;
    let distance2 = to_light.length_squared().max(1e-6);
    let mut falloff = 1.0 / distance2;
    if let Some(range) = light.range_m {
        // The extension's recommended window: (1 − (d/range)⁴) clamped.
        falloff *= (1.0 - (distance2 / (range * range)).powi(2)).clamp(0.0, 1.0);
    }
    if let PunctualKind::Spot { inner_rad, outer_rad } = light.kind {
        let scale = 1.0 / (inner_rad.cos() - outer_rad.cos()).max(1e-3);
        let cos = -light.direction.dot(to_light) / distance2.sqrt();
        falloff *= ((cos - outer_rad.cos()) * scale).clamp(0.0, 1.0).powi(2);
    }
    (falloff > 0.0).then_some((to_light, intensity * falloff))
}

impl Emitter {
    /// Expected unshadowed irradiance in a cell up to a common factor; zero only if no point of the cell can see the emitting side.
    fn importance(&self, low: Vec3, high: Vec3) -> f32 {
        let centre = 0.5 * (low + high);
        let radius2 = 0.25 * (high - low).length_squared();
        match &self.kind {
            Kind::Patch { corners, normal, area, double_sided, .. } => {
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                let extent = high - centre;
                // Largest height of a point of the (slightly grown) cell above the emitter's plane.
                let height = normal.dot(centre - corners[0]);
                let reach = normal.abs().dot(extent) + 1e-3 * (1.0 + extent.max_element());
                let (above, below) = (height + reach, reach - height);
                if above <= 0.0 && !double_sided {
                    return 0.0;
                }
                let distance2 = (centre - middle).length_squared().max(0.25 * radius2 + 0.1 * area);
                let best = if *double_sided { above.max(below) } else { above };
                // Cosine of the mean, no less than a tenth of the most favourable one: the bound stays positive over the cell.
                let cos = if *double_sided { height.abs() } else { height.max(0.0) } / distance2.sqrt();
                let most = (best / distance2.sqrt()).min(1.0);
                self.luminance * area * cos.clamp(0.1 * most, 1.0) / distance2
            }
            Kind::Punctual(light) => match light.kind {
                PunctualKind::Directional => self.luminance,
                PunctualKind::Point | PunctualKind::Spot { .. } => {
                    let distance2 = (centre - light.position).length_squared();
                    if light.range_m.is_some_and(|r| distance2.sqrt() - radius2.sqrt() > r) {
                        return 0.0;
                    }
                    let mut weight = self.luminance / distance2.max(radius2);
                    if let PunctualKind::Spot { outer_rad, .. } = light.kind {
                        let cos = light.direction.dot((centre - light.position).normalize_or_zero());
                        let spread = (radius2 / distance2.max(1e-9)).sqrt().min(1.0).asin();
                        if cos.clamp(-1.0, 1.0).acos() > outer_rad + spread && distance2 > radius2 {
                            weight *= 0.01;
                        }
                    }
                    weight
                }
            },
        }
    }

    /// One visibility ray between random points of the cell and the emitter.
    fn sees(&self, bvh: &Bvh, blocks: &impl Fn(u32) -> bool, low: Vec3, size: Vec3, rng: &mut Rng) -> bool {
        let from = low + size * Vec3::new(rng.uniform(), rng.uniform(), rng.uniform());
        let root = rng.uniform().sqrt();
        let (b1, b2) = (rng.uniform() * root, 1.0 - root);
        let to = match &self.kind {
            Kind::Patch { corners, normal, .. } => {
                let p = corners[0] * (1.0 - b1 - b2) + corners[1] * b1 + corners[2] * b2;
                p + *normal * (offset(p) * normal.dot(from - p).signum())
            }
            Kind::Punctual(light) if light.kind == PunctualKind::Directional => from - light.direction * 1e4,
            Kind::Punctual(light) => light.position,
        };
        !bvh.occluded_where(&Ray::segment(from, to), |h| blocks(h.triangle))
    }
}
