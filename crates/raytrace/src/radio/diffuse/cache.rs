//! What the surfaces send out after all but the simplest lighting: outgoing power per patch, side, direction and polarisation.
//!
//! A photon that arrives at a surface leaves there its scattered power in all directions at once: F·f_s at every node of the patch's
//! hemisphere times the coherency of the scattered field. Scattering leaves the field's (θ̂, φ̂) components the same in every direction,
//! so that interpolating the four numbers between directions and between patches is meaningful. Photons are kept apart by the number
//! of interactions that their chain leaves to the way towards the receiver.

use super::guide::Surroundings;
use super::illumination::{CLEARANCE_M, Illumination};
use super::nodes::{self, Lobes, Nodes};
use super::patches::Patches;
use super::smooth::smooth;
use crate::radio::geometry::Geometry;
use corf_scene::model::ScatteringPattern;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Patches with less of a face on them than this share of a full one are pooled with their neighbours of the same object and
/// material that look the same way, insides of bodies apart from their outsides: a curved thing's facets are far smaller than what its
/// lighting varies over.
const POOLED_SHARE: f64 = 0.25;
/// Surfaces closer together than this leave no way for light between them, metres.
const CONTACT_M: f64 = 5e-3;
/// Numbers of a coherency matrix: ⟨|E_θ|²⟩, ⟨|E_φ|²⟩, Re⟨E_θE_φ*⟩, Im⟨E_θE_φ*⟩.
const COMPONENTS: usize = 4;
/// Photons that only mirrors and slabs sent on are spread as evenly as the lattice they started from: their number varies less than by
/// chance, in variance by some such factor at ten to a patch.
const EVENNESS: f32 = 0.25;
/// Sums of all photons of a level: power, power × length, power² as far as it is by chance.
const MEANS: usize = 3;
/// Patches along the side of a block, and blocks along that of a region, over which light is compared.
const BLOCK: usize = 4;
/// Slots a task fills.
const SLOTS_PER_TASK: usize = 256;

/// A share of a photon's power scattered at a surface.
#[derive(Clone, Copy, Debug)]
pub struct Deposit {
    /// Where: [`RadianceCache::slot`].
    pub slot: u32,
    /// Interactions that may still follow.
    pub left: u32,
    /// Scattered coherency over F·f_s, watts.
    pub coherency: [f32; COMPONENTS],
    /// Unit normal of the facet, on the photon's side.
    pub normal: Vec3,
    /// Unit mirrored direction of the photon.
    pub specular: Vec3,
    /// Unit direction back to where the photon came from.
    pub back: Vec3,
    /// Unfolded length so far, metres.
    pub length_m: f32,
    /// Whether it was scattered before, into a random direction.
    pub scattered: bool,
}

/// One side of a patch, or of a pool of small ones.
#[derive(Clone, Copy, Debug)]
struct Slot {
    /// Two tangents and the normal on this side.
    frame: [Vec3; 3],
    area_m2: f32,
    material: u32,
    /// Whether all of it is covered, so that no light is expected.
    sealed: bool,
}

impl Slot {
    fn local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.frame[0]), v.dot(self.frame[1]), v.dot(self.frame[2]))
    }
}

/// What a patch sends out towards one direction.
#[derive(Clone, Copy, Debug)]
pub struct Outgoing {
    /// Coherency of the scattered field per patch area, f_s included, W/(m²·sr).
    pub coherency: [f64; COMPONENTS],
    /// Mean unfolded length from the transmitter, metres.
    pub length_m: f64,
}

/// Outgoing power of all patches.
///
/// Memory: 16 bytes per node and level of every lit slot; a slot has 81 nodes for α = 5, 169 for α = 10, and there is a level per
/// interaction that may follow (two at depth 3).
pub struct RadianceCache {
    slots: Vec<Slot>,
    /// By patch: the slots of its two sides, that of the face's normal first.
    of_patch: Vec<[u32; 2]>,
    /// By scene material.
    nodes: Vec<Option<(Nodes, ScatteringPattern)>>,
    levels: usize,
    /// By slot: coherencies by level and node, then [`MEANS`] by level; nothing where no photon came.
    values: Vec<Option<Box<[f32]>>>,
    /// Slots by block, blocks by region.
    regions: Vec<Vec<Vec<u32>>>,
}

/// Where a slot's surroundings are kept: on a face's side, or among the pools of small facets that look the same way.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
enum Place {
    Grid { face: u32, side: usize, cell: [usize; 2] },
    Pool { object: u32, material: u32, side: usize, facing: [i32; 3], cell: [i32; 3] },
}

impl Place {
    /// The place of the block that holds it.
    fn coarser(self) -> Self {
        match self {
            Self::Grid { face, side, cell } => Self::Grid { face, side, cell: cell.map(|c| c / BLOCK) },
            Self::Pool { object, material, side, facing, cell } => {
                Self::Pool { object, material, side, facing, cell: cell.map(|c| c.div_euclid(BLOCK as i32)) }
            }
        }
    }
}

/// Groups slots by block, and these by region, in the order of their places.
fn regions(places: &[Place], slots: &[Slot]) -> Vec<Vec<Vec<u32>>> {
    let mut order: Vec<(Place, Place, u32)> = (places.iter().zip(slots).enumerate())
        .filter(|(_, (_, slot))| !slot.sealed && slot.area_m2 > 0.0)
        .map(|(i, (place, _))| (place.coarser().coarser(), place.coarser(), i as u32))
        .collect();
    order.sort_unstable();
    let blocks = order.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
    let mut regions: Vec<(Place, Vec<Vec<u32>>)> = Vec::new();
    for block in blocks {
        let slots = block.iter().map(|b| b.2).collect();
        match regions.last_mut().filter(|(place, _)| *place == block[0].0) {
            Some((_, blocks)) => blocks.push(slots),
            None => regions.push((block[0].0, vec![slots])),
        }
    }
    regions.into_iter().map(|(_, blocks)| blocks).collect()
}

impl RadianceCache {
    /// An empty cache for chains that leave `0..levels` interactions to the way towards the receiver.
    pub fn new(illumination: &Illumination<'_, '_>, patches: &Patches, patch_m: f64, levels: usize) -> Self {
        let geometry = illumination.geometry();
        let nodes = geometry
            .slabs
            .iter()
            .map(|slab| slab.as_ref().map(|slab| (Nodes::new(slab.scattering.pattern), slab.scattering.pattern)));
        let mut slots = Vec::new();
        let mut of_patch = vec![[0; 2]; patches.len()];
        let mut places = Vec::new();
        let mut pools: HashMap<Place, u32> = HashMap::new();
        let exposed = exposed_areas(geometry, patches);
        for (index, face) in geometry.faces.iter().enumerate() {
            let [u, v] = patches.axes(index as u32);
            for (patch, centre) in patches.of_face(index as u32) {
                for (side, sign) in [(0, 1.0), (1, -1.0)] {
                    let (area_m2, sealed) = exposed[patch][side];
                    let normal = face.normal * sign;
                    let slot = Slot {
                        frame: [u.as_vec3(), (v * sign).as_vec3(), normal.as_vec3()],
                        area_m2: 0.0,
                        material: face.material,
                        sealed: true,
                    };
                    let mut fresh = |place: Place| {
                        places.push(place);
                        slots.push(slot);
                        slots.len() as u32 - 1
                    };
                    let number = if patches.areas_m2()[patch] < POOLED_SHARE * patch_m * patch_m {
                        let cell = (centre / patch_m).floor().as_ivec3().to_array();
                        // Some 20° apart.
                        let facing = (normal * 1.5).round().as_ivec3().to_array();
                        let (object, material) = (face.object, face.material);
                        let place = Place::Pool { object, material, side, facing, cell };
                        *pools.entry(place).or_insert_with(|| fresh(place))
                    } else {
                        fresh(Place::Grid { face: index as u32, side, cell: patches.cell_of(index as u32, patch) })
                    };
                    slots[number as usize].sealed &= sealed;
                    slots[number as usize].area_m2 += area_m2 as f32;
                    of_patch[patch][side] = number;
                }
            }
        }
        let values = vec![None; slots.len()];
        Self { nodes: nodes.collect(), regions: regions(&places, &slots), slots, of_patch, levels, values }
    }

    /// The slot of a patch's side.
    pub fn slot(&self, patch: usize, side: usize) -> u32 {
        self.of_patch[patch][side]
    }

    /// Number of slots.
    pub fn slot_count(&self) -> usize {
        self.slots.len()
    }

    /// Area of a slot, m².
    pub fn area_m2(&self, slot: u32) -> f64 {
        f64::from(self.slots[slot as usize].area_m2)
    }

    /// Area and power of every slot and of the block it lies in, from the slots' powers; nothing where no light is expected.
    pub fn surroundings(&self, power: &[f64]) -> Vec<Surroundings> {
        let mut around = vec![Surroundings::default(); self.slots.len()];
        for block in self.regions.iter().flatten() {
            let sum = |of: &dyn Fn(u32) -> f64| block.iter().map(|&slot| of(slot)).sum::<f64>();
            let (area_m2, all) = (sum(&|slot| self.area_m2(slot)), sum(&|slot| power[slot as usize]));
            for &slot in block {
                let (own_m2, own_power) = (self.area_m2(slot), power[slot as usize]);
                around[slot as usize] = Surroundings { own_m2, own_power, area_m2, power: all };
            }
        }
        around
    }

    /// Megabytes of tables.
    pub fn megabytes(&self) -> f64 {
        self.values.iter().flatten().map(|v| v.len() * size_of::<f32>()).sum::<usize>() as f64 / 1e6
    }

    /// The power that all photons scatter, in photons of unit power; of Lambertian surfaces only.
    #[cfg(test)]
    pub fn scattered_power(&self) -> f64 {
        self.values.iter().flatten().map(|table| f64::from(table[table.len() - MEANS * self.levels])).sum()
    }

    /// Adds batches of deposits, each sorted by slot; the batches' order, not the threads', decides the order of the sums.
    pub fn add(&mut self, batches: &[Vec<Deposit>]) {
        let Self { slots, nodes, levels, values, .. } = self;
        let (slots, nodes, levels) = (&*slots, &*nodes, *levels);
        values.par_chunks_mut(SLOTS_PER_TASK).enumerate().for_each(|(task, values)| {
            let first = (task * SLOTS_PER_TASK) as u32;
            let end = first + values.len() as u32;
            let mut lobes = Lobes::default();
            for batch in batches {
                let from = batch.partition_point(|d| d.slot < first);
                for deposit in batch[from..].iter().take_while(|d| d.slot < end) {
                    let slot = &slots[deposit.slot as usize];
                    let Some((nodes, pattern)) = &nodes[slot.material as usize] else { continue };
                    let table = values[(deposit.slot - first) as usize]
                        .get_or_insert_with(|| vec![0.0; levels * (nodes.len() * COMPONENTS + MEANS)].into_boxed_slice());
                    let [normal, specular, back] = [deposit.normal, deposit.specular, deposit.back].map(|v| slot.local(v));
                    let level = deposit.left as usize;
                    let base = level * nodes.len() * COMPONENTS;
                    let rows = &mut table[base..base + nodes.len() * COMPONENTS];
                    Left { nodes, pattern: *pattern, normal, specular, back, coherency: &deposit.coherency }
                        .add(rows, &mut lobes);
                    let power = deposit.coherency[0] + deposit.coherency[1];
                    let means = levels * nodes.len() * COMPONENTS + MEANS * level;
                    table[means] += power;
                    table[means + 1] += power * deposit.length_m;
                    table[means + 2] += power * power * if deposit.scattered { 1.0 } else { EVENNESS };
                }
            }
        });
    }

    /// Turns sums into totals: what may be read with `j` interactions behind includes all that leaves more than `j`. Then weighs every
    /// patch's photons against its surroundings'.
    pub fn finish(&mut self, photon_weight: f64) {
        let (nodes, slots, levels) = (&self.nodes, &self.slots, self.levels);
        self.values.par_iter_mut().zip(slots).for_each(|(table, slot)| {
            let (Some(table), Some((nodes, _))) = (table, &nodes[slot.material as usize]) else { return };
            let width = nodes.len() * COMPONENTS;
            for v in &mut table[..levels * width] {
                *v *= photon_weight as f32;
            }
            let mut before = Vec::new();
            table[..levels * width].chunks_exact_mut(width).for_each(|rows| nodes.sharpen(rows, &mut before));
            for (first, width) in [(0, width), (levels * width, MEANS)] {
                for level in (0..levels - 1).rev() {
                    let (lower, upper) = table[first + level * width..first + (level + 2) * width].split_at_mut(width);
                    lower.iter_mut().zip(upper).for_each(|(l, u)| *l += *u);
                }
            }
        });
        self.smooth();
    }

    /// See [`smooth`].
    fn smooth(&mut self) {
        let Self { nodes, slots, levels, values, regions, .. } = self;
        let smoothed: Vec<Vec<(u32, Box<[f32]>)>> = regions
            .par_iter()
            .map(|region| {
                let mut members = region.iter().flatten().map(|&slot| slot as usize);
                let Some(lit) = members.find(|&slot| values[slot].is_some()) else { return Vec::new() };
                let Some((nodes, _)) = &nodes[slots[lit].material as usize] else { return Vec::new() };
                let power = *levels * nodes.len() * COMPONENTS;
                let none = vec![0f32; power + MEANS * *levels];
                let mut blocks: Vec<Vec<(f64, Vec<f32>)>> = region
                    .iter()
                    .map(|block| {
                        let table = |slot: u32| values[slot as usize].as_deref().map_or_else(|| none.clone(), <[f32]>::to_vec);
                        block.iter().map(|&slot| (f64::from(slots[slot as usize].area_m2), table(slot))).collect()
                    })
                    .collect();
                smooth(&mut blocks, power, power + 2);
                let tables = region.iter().flatten().zip(blocks.into_iter().flatten());
                tables.filter(|(_, (_, t))| t[power] > 0.0).map(|(&slot, (_, t))| (slot, t.into_boxed_slice())).collect()
            })
            .collect();
        for (slot, table) in smoothed.into_iter().flatten() {
            values[slot as usize] = Some(table);
        }
    }

    /// What the face's side sends towards a unit direction, when `after` interactions follow; `None` where no photon came.
    pub fn outgoing(
        &self,
        patches: &Patches,
        face: u32,
        point: DVec3,
        side: usize,
        towards: DVec3,
        after: usize,
    ) -> Option<Outgoing> {
        if after >= self.levels {
            return None;
        }
        let around = patches.around(face, point);
        let towards = towards.as_vec3();
        let (mut sum, mut area, mut power, mut moment) = ([0.0f32; COMPONENTS], 0.0f32, 0.0f32, 0.0f32);
        let mut cos_scatter = 0.0;
        let mut shape = ScatteringPattern::Lambertian;
        for (&patch, weight) in around.patches.iter().zip(around.weights) {
            if weight == 0.0 {
                continue;
            }
            let number = self.of_patch[patch as usize][side] as usize;
            let slot = &self.slots[number];
            area += weight * slot.area_m2;
            let (Some(table), Some((nodes, pattern))) = (&self.values[number], &self.nodes[slot.material as usize]) else {
                continue;
            };
            let width = nodes.len() * COMPONENTS;
            let local = slot.local(towards);
            cos_scatter = local.z.max(0.0);
            shape = *pattern;
            let (at, node_weights) = nodes.around(local);
            let (rows, _) = table[after * width..(after + 1) * width].as_chunks::<COMPONENTS>();
            for (&i, node_weight) in at.iter().zip(node_weights) {
                for (sum, c) in sum.iter_mut().zip(&rows[i]) {
                    *sum += weight * node_weight * c;
                }
            }
            let means = self.levels * width + MEANS * after;
            power += weight * table[means];
            moment += weight * table[means + 1];
        }
        if power == 0.0 || area == 0.0 {
            return None;
        }
        let scale = nodes::readout(shape, f64::from(cos_scatter)) / f64::from(area);
        Some(Outgoing { coherency: sum.map(|c| f64::from(c) * scale), length_m: f64::from(moment / power) })
    }
}

/// What a photon leaves at a surface, in the frame of its nodes.
struct Left<'a> {
    nodes: &'a Nodes,
    pattern: ScatteringPattern,
    normal: Vec3,
    specular: Vec3,
    back: Vec3,
    coherency: &'a [f32; COMPONENTS],
}

impl Left<'_> {
    /// Adds it at every node. Every processor's version does the same operations and gives the same bits.
    fn add(&self, rows: &mut [f32], lobes: &mut Lobes) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { self.add_avx2(rows, lobes) };
        }
        self.add_portable(rows, lobes);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn add_avx2(&self, rows: &mut [f32], lobes: &mut Lobes) {
        self.add_portable(rows, lobes);
    }

    #[inline(always)]
    fn add_portable(&self, rows: &mut [f32], lobes: &mut Lobes) {
        self.nodes.lobe(self.pattern, self.normal, self.specular, self.back, lobes);
        let (rows, _) = rows.as_chunks_mut::<COMPONENTS>();
        for (row, f) in rows.iter_mut().zip(&lobes.values) {
            for (sum, c) in row.iter_mut().zip(self.coherency) {
                *sum += f * c;
            }
        }
    }
}

/// Area of a patch's two sides, m², and whether they are covered all over.
type Exposed = [(f64, bool); 2];

/// Area of both sides of every patch, m², less what is covered: furniture stands on the floor, panels cover a wall, and no light that
/// falls on the rest of the patch belongs to it. A side that is covered all over is told, and keeps its area.
fn exposed_areas(geometry: &Geometry<'_>, patches: &Patches) -> Vec<Exposed> {
    let per_face: Vec<Vec<(usize, Exposed)>> = geometry
        .faces
        .par_iter()
        .enumerate()
        .map(|(index, face)| {
            patches
                .of_face(index as u32)
                .map(|(patch, _)| {
                    let points: Vec<DVec3> = patches.points(face, index as u32, patch).collect();
                    let open = |sign: f64| {
                        let normal = face.normal * sign;
                        let open = points.iter().filter(|p| !geometry.covered(**p, normal, CONTACT_M, CLEARANCE_M)).count();
                        let area_m2 = patches.areas_m2()[patch];
                        // Where nothing is open nothing arrives, but for what passes through what covers it.
                        if open == 0 {
                            (area_m2, !points.is_empty())
                        } else {
                            (area_m2 * open as f64 / points.len() as f64, false)
                        }
                    };
                    (patch, [1.0, -1.0].map(open))
                })
                .collect()
        })
        .collect();
    let mut areas = vec![[(0.0, false); 2]; patches.len()];
    per_face.into_iter().flatten().for_each(|(patch, sides)| areas[patch] = sides);
    areas
}
