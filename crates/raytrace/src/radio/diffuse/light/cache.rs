//! Radiance cache of indirect light: scattered power per patch, side, direction and polarisation, for all chains but those that are
//! evaluated exactly at every point (straight from the transmitter and its larger mirror images).
//!
//! A photon that arrives at a surface leaves there its scattered power in all directions at once: F·f_s at every node of the patch's
//! hemisphere times the coherency of the scattered field. Scattering leaves the field's (θ̂, φ̂) components the same in every direction,
//! so that interpolating the four numbers between directions and between patches is meaningful. Photons are kept apart by the number
//! of interactions that their chain leaves to the way towards the receiver.

use super::illumination::Illumination;
use super::nodes::{self, LobeBuffer, Nodes};
use super::patches::{GRAINS, Patches};
use super::shrinkage::smooth;
use super::subcells::{self, SubcellRange};
use super::surface_records::SurfaceRecords;
use crate::radio::geometry::Geometry;
use corf_scene::model::ScatteringPattern;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Numbers of a coherency matrix: ⟨|E_θ|²⟩, ⟨|E_φ|²⟩, Re⟨E_θE_φ*⟩, Im⟨E_θE_φ*⟩.
const COMPONENTS: usize = 4;
/// Photons that only mirrors and slabs sent on are spread as evenly as the lattice they started from: their number varies less than by
/// chance, in variance by some such factor at ten to a patch.
const EVENNESS: f32 = 0.25;
/// Sums of all photons of a level: power, power × length, power² as far as it is by chance.
const MEANS: usize = 3;
/// Number of slots that a task fills.
const SLOTS_PER_TASK: usize = 256;

/// A share of a photon's power scattered at a surface.
#[derive(Clone, Copy, Debug)]
pub struct Deposit {
    /// Slot that it falls on: [`SurfaceRecords::place`].
    pub slot: u32,
    /// Subcell of the slot that it falls on.
    pub subcell: u32,
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

/// Radiance of a patch in one direction.
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
/// interaction that may follow (two at depth 3). 4 bytes per subcell beside them.
pub struct RadianceCache {
    slots: SurfaceRecords,
    /// Nodes and scattering pattern by scene material.
    nodes: Vec<Option<(Nodes, ScatteringPattern)>>,
    levels: usize,
    /// Coherencies of a slot by level and node, then [`MEANS`] by level; nothing where no photon came.
    values: Vec<Option<Box<[f32]>>>,
    /// Photon power of a slot by subcell, and once they are finished the subcells' weights; nothing where all are 1.
    subcells: Vec<Option<Box<[f32]>>>,
}

impl RadianceCache {
    /// An empty cache for chains that leave `0..levels` interactions to the way towards the receiver.
    pub fn new(illumination: &Illumination<'_, '_>, patches: &Patches, patch_m: f64, levels: usize) -> Self {
        let geometry = illumination.geometry();
        let nodes = geometry
            .slabs
            .iter()
            .map(|slab| slab.as_ref().map(|slab| (Nodes::new(slab.scattering.pattern), slab.scattering.pattern)));
        let slots = SurfaceRecords::new(geometry, patches, patch_m);
        let (values, subcells) = (vec![None; slots.len()], vec![None; slots.len()]);
        Self { nodes: nodes.collect(), slots, levels, values, subcells }
    }

    /// The slots.
    pub fn slots(&self) -> &SurfaceRecords {
        &self.slots
    }

    /// A slot's table and nodes, where photons came.
    fn lit(&self, slot: u32) -> Option<(&[f32], &Nodes, ScatteringPattern)> {
        let (nodes, pattern) = self.nodes[self.slots.get(slot).material as usize].as_ref()?;
        Some((self.values[slot as usize].as_deref()?, nodes, *pattern))
    }

    /// Sums of a slot's photons, those included that leave more interactions than none: power, power × length, power² by chance.
    fn means(&self, slot: u32) -> Option<[f32; MEANS]> {
        let (table, nodes, _) = self.lit(slot)?;
        let (means, _) = table[self.levels * nodes.len() * COMPONENTS..].as_chunks();
        means.first().copied()
    }

    /// Megabytes of tables.
    pub fn megabytes(&self) -> f64 {
        let numbers = self.values.iter().chain(&self.subcells).flatten().map(|numbers| numbers.len()).sum::<usize>();
        (numbers * size_of::<f32>()) as f64 / 1e6
    }

    /// The power that all photons scatter, in photons of unit power; of Lambertian surfaces only.
    #[cfg(test)]
    pub fn scattered_power(&self) -> f64 {
        self.values.iter().flatten().map(|table| f64::from(table[table.len() - MEANS * self.levels])).sum()
    }

    /// Adds batches of deposits, each sorted by slot; the batches' order, not the threads', decides the order of the sums.
    pub fn add(&mut self, batches: &[Vec<Deposit>]) {
        let Self { slots, nodes, levels, values, subcells } = self;
        let (slots, nodes, levels) = (&*slots, &*nodes, *levels);
        let chunks = values.par_chunks_mut(SLOTS_PER_TASK).zip(subcells.par_chunks_mut(SLOTS_PER_TASK));
        chunks.enumerate().for_each(|(task, (values, subcells))| {
            let first = (task * SLOTS_PER_TASK) as u32;
            let end = first + values.len() as u32;
            let mut lobes = LobeBuffer::default();
            for batch in batches {
                let from = batch.partition_point(|d| d.slot < first);
                for deposit in batch[from..].iter().take_while(|d| d.slot < end) {
                    let slot = slots.get(deposit.slot);
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
                    let count = slots.subcell_count(deposit.slot);
                    subcells[(deposit.slot - first) as usize].get_or_insert_with(|| vec![0.0; count].into_boxed_slice())
                        [deposit.subcell as usize] += power;
                }
            }
        });
    }

    /// Turns the sums by level into cumulative ones: level `j` then holds all deposits that leave room for `j` interactions or more. Then
    /// smooths every patch's photons with its surroundings', and its subcells against each other.
    pub fn finish(&mut self, geometry: &Geometry<'_>, patches: &Patches, photon_weight: f64) {
        let (nodes, slots, levels) = (&self.nodes, &self.slots, self.levels);
        self.values.par_iter_mut().zip(slots.all()).for_each(|(table, slot)| {
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
        // Smoothing gives patches photons of their neighbours; how large a typical one is stays.
        let spreads = self.spreads();
        self.smooth();
        self.weigh_subcells(geometry, patches, &spreads);
    }

    /// Σp²/Σp of all photons, by slot.
    fn spreads(&self) -> Vec<f64> {
        let spread = |[power, _, squares]: [f32; MEANS]| f64::from(squares / power.max(f32::MIN_POSITIVE));
        (0..self.slots.len() as u32).map(|slot| self.means(slot).map_or(0.0, spread)).collect()
    }

    /// Turns the photons' power by subcell into weights: see [`subcells::weights`].
    fn weigh_subcells(&mut self, geometry: &Geometry<'_>, patches: &Patches, spreads: &[f64]) {
        let this = &*self;
        let per_face: Vec<Vec<(SubcellRange, [f32; GRAINS])>> = (geometry.faces.par_iter().enumerate())
            .map(|(index, face)| {
                let all = patches.of_face(index as u32).flat_map(|(patch, centre)| [0, 1].map(|side| (patch, centre, side)));
                all.filter(|(patch, _, side)| this.subcells[this.slots.slot(*patch, *side) as usize].is_some())
                    .map(|(patch, centre, side)| {
                        let home = this.slots.homes(patch)[side];
                        let mut powers = [0.0; GRAINS];
                        let mut expect = |subcell: usize, part: Option<usize>, at: DVec3| {
                            powers[subcell] =
                                this.mean_irradiance(patches, index as u32, at, part, side) * home.subcell_m2(subcell);
                        };
                        if home.is_subcell() {
                            expect(0, None, centre);
                        } else {
                            patches
                                .subcells(face, index as u32, patch)
                                .for_each(|(subcell, at)| expect(subcell, Some(subcell), at));
                        }
                        (home, powers)
                    })
                    .collect()
            })
            .collect();
        let mut expected: Vec<Vec<f32>> = this.subcells.iter().map(|g| vec![0.0; g.as_ref().map_or(0, |g| g.len())]).collect();
        for (home, powers) in per_face.iter().flatten() {
            expected[home.slot as usize][home.range()].copy_from_slice(&powers[..home.range().len()]);
        }
        let weights: Vec<Option<Box<[f32]>>> = (0..this.slots.len() as u32)
            .into_par_iter()
            .map(|slot| {
                let [power, ..] = this.means(slot)?;
                let i = slot as usize;
                subcells::weights(&expected[i], this.subcells[i].as_ref()?, f64::from(power), spreads[i])
            })
            .collect();
        self.subcells = weights;
    }

    /// The mean of [`Self::irradiance`] over one of a patch's subcells, or over all of it, around its centre: in a dark patch beside bright ones
    /// the centre alone says next to nothing of it.
    fn mean_irradiance(&self, patches: &Patches, face: u32, centre: DVec3, subcell: Option<usize>, side: usize) -> f32 {
        let all = patches.means(face, centre, subcell).map(|at| self.irradiance(patches, face, at, side));
        let (sum, count) = all.fold((0.0, 0u8), |(sum, count), one| (sum + one, count + 1));
        sum / f32::from(count)
    }

    /// Photons' power per area around a point of a face's side, as [`Self::outgoing`] interpolates it: what light that is even within
    /// patches leaves there.
    fn irradiance(&self, patches: &Patches, face: u32, point: DVec3, side: usize) -> f32 {
        let around = patches.around(face, point);
        let (mut all, mut area_m2) = (0.0, 0.0);
        for (&patch, weight) in around.patches.iter().zip(around.weights) {
            let slot = self.slots.slot(patch as usize, side);
            area_m2 += weight * self.slots.get(slot).area_m2;
            all += self.means(slot).map_or(0.0, |[power, ..]| weight * power);
        }
        if area_m2 > 0.0 { all / area_m2 } else { 0.0 }
    }

    /// See [`smooth`].
    fn smooth(&mut self) {
        let Self { nodes, slots, levels, values, .. } = self;
        // Tables are moved out and back: they are most of all memory.
        type Region<'s> = (&'s [Vec<u32>], Vec<Option<Box<[f32]>>>);
        let mut regions: Vec<Region<'_>> = slots
            .regions()
            .iter()
            .map(|region| (region.as_slice(), region.iter().flatten().map(|&slot| values[slot as usize].take()).collect()))
            .collect();
        regions.par_iter_mut().for_each(|(region, tables)| {
            let Some(lit) = tables.iter().position(Option::is_some) else { return };
            let material = region.iter().flatten().nth(lit).map(|&slot| slots.get(slot).material as usize);
            let Some((nodes, _)) = material.and_then(|material| nodes[material].as_ref()) else { return };
            let power = *levels * nodes.len() * COMPONENTS;
            let mut next = tables.drain(..).map(|table| table.map_or_else(|| vec![0f32; power + MEANS * *levels], Vec::from));
            let block = |block: &Vec<u32>| block.iter().map(|&slot| slots.area_m2(slot)).zip(&mut next).collect();
            let mut blocks: Vec<Vec<(f64, Vec<f32>)>> = region.iter().map(block).collect();
            drop(next);
            smooth(&mut blocks, power, power + 2);
            tables.extend(blocks.into_iter().flatten().map(|(_, t)| (t[power] > 0.0).then(|| t.into_boxed_slice())));
        });
        for (region, tables) in regions {
            region.iter().flatten().zip(tables).for_each(|(&slot, table)| values[slot as usize] = table);
        }
    }

    /// Radiance of a face's side at a point towards a unit direction, from chains that leave room for `after` interactions on the way to
    /// the receiver; `None` where no photon came.
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
            let number = self.slots.slot(patch as usize, side);
            let slot = self.slots.get(number);
            area += weight * slot.area_m2;
            let Some((table, nodes, pattern)) = self.lit(number) else { continue };
            let width = nodes.len() * COMPONENTS;
            let local = slot.local(towards);
            cos_scatter = local.z.max(0.0);
            shape = pattern;
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
        let (slot, subcell) = self.slots.place(patches.at(face, point), side);
        let weight = self.subcells[slot as usize].as_ref().map_or(1.0, |weights| weights[subcell as usize]);
        let scale = nodes::readout(shape, f64::from(cos_scatter)) * f64::from(weight / area);
        Some(Outgoing { coherency: sum.map(|c| f64::from(c) * scale), length_m: f64::from(moment / power) })
    }
}

/// A photon's deposit at a surface, in the frame of the surface's nodes.
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
    fn add(&self, rows: &mut [f32], lobes: &mut LobeBuffer) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { self.add_avx2(rows, lobes) };
        }
        self.add_portable(rows, lobes);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn add_avx2(&self, rows: &mut [f32], lobes: &mut LobeBuffer) {
        self.add_portable(rows, lobes);
    }

    #[inline(always)]
    fn add_portable(&self, rows: &mut [f32], lobes: &mut LobeBuffer) {
        self.nodes.lobe(self.pattern, self.normal, self.specular, self.back, lobes);
        let (rows, _) = rows.as_chunks_mut::<COMPONENTS>();
        for (row, f) in rows.iter_mut().zip(&lobes.values) {
            for (sum, c) in row.iter_mut().zip(self.coherency) {
                *sum += f * c;
            }
        }
    }
}
