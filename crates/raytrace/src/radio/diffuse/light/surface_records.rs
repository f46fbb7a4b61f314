//! Surface records of the radiance cache: a slot for either side of every patch, or of a pool of patches with little of a face on them.

use super::coverage::{Exposed, exposed};
use super::patches::Patches;
use super::subcells::SubcellRange;
use crate::radio::geometry::Geometry;
use glam::Vec3;
use std::collections::HashMap;

/// Patches with less of a face on them than this share of a full one are pooled with their neighbours of the same object and
/// material that look the same way, insides of bodies apart from their outsides: a curved thing's facets are far smaller than what its
/// lighting varies over.
const POOLED_SHARE: f64 = 0.25;
/// Patches along the side of a block, and blocks along that of a region, over which light is compared.
const BLOCK: usize = 4;

/// One side of a patch, or of a pool of small ones.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceRecord {
    /// Two tangents and the normal on this side.
    frame: [Vec3; 3],
    /// Open area, m².
    pub area_m2: f32,
    /// Index into the scene's materials.
    pub material: u32,
    /// Whether all of it is covered, so that no light is expected.
    sealed: bool,
}

impl SurfaceRecord {
    /// A direction in the slot's frame.
    pub fn local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.frame[0]), v.dot(self.frame[1]), v.dot(self.frame[2]))
    }
}

/// Every place where light is kept.
pub struct SurfaceRecords {
    slots: Vec<SurfaceRecord>,
    /// Subcell ranges of a patch's two sides, that of the face's normal first, by patch.
    of_patch: Vec<[SubcellRange; 2]>,
    /// Number of subcells, by slot.
    subcell_counts: Vec<u32>,
    /// Slots by block, blocks by region.
    regions: Vec<Vec<Vec<u32>>>,
}

/// Cell of the grid in which a slot's surroundings are found: on a face's side, or among the pools of small facets of like orientation.
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

/// A slot's area and photons, and those of the block it lies in.
#[derive(Clone, Copy, Debug, Default)]
pub struct Surroundings {
    /// Area of the slot itself, m².
    pub own_m2: f64,
    /// Power of the slot's photons, as they carry it.
    pub own_power: f64,
    /// Area of the block, m².
    pub area_m2: f64,
    /// Power of the block's photons.
    pub power: f64,
}

/// Groups slots by block, and these by region, in the order of their places.
fn regions(places: &[Place], slots: &[SurfaceRecord]) -> Vec<Vec<Vec<u32>>> {
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

impl SurfaceRecords {
    /// The slots of all patches, both sides.
    pub fn new(geometry: &Geometry<'_>, patches: &Patches, patch_m: f64) -> Self {
        let mut slots = Vec::new();
        let mut of_patch = Vec::with_capacity(patches.len());
        let mut subcell_counts: Vec<u32> = Vec::new();
        let mut places = Vec::new();
        let mut pools: HashMap<Place, u32> = HashMap::new();
        let exposed = exposed(geometry, patches);
        for (index, face) in geometry.faces.iter().enumerate() {
            let [u, v] = patches.axes(index as u32);
            for (patch, centre) in patches.of_face(index as u32) {
                of_patch.push([(0, 1.0), (1, -1.0)].map(|(side, sign)| {
                    let Exposed { area_m2, sealed, subcells } = exposed[patch][side];
                    let normal = face.normal * sign;
                    let slot = SurfaceRecord {
                        frame: [u.as_vec3(), (v * sign).as_vec3(), normal.as_vec3()],
                        area_m2: 0.0,
                        material: face.material,
                        sealed: true,
                    };
                    let mut fresh = |place: Place| {
                        places.push(place);
                        slots.push(slot);
                        subcell_counts.push(0);
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
                    let taken = &mut subcell_counts[number as usize];
                    let (home, count) = SubcellRange::new(number, *taken, area_m2, subcells, patch_m);
                    *taken += count;
                    home
                }));
            }
        }
        Self { regions: regions(&places, &slots), slots, of_patch, subcell_counts }
    }

    /// The slot of this number.
    pub fn get(&self, slot: u32) -> &SurfaceRecord {
        &self.slots[slot as usize]
    }

    /// All slots.
    pub fn all(&self) -> &[SurfaceRecord] {
        &self.slots
    }

    /// Slots by block, blocks by region: 4×4 neighbours each; without those where no light is expected.
    pub fn regions(&self) -> &[Vec<Vec<u32>>] {
        &self.regions
    }

    /// Number of a slot's subcells.
    pub fn subcell_count(&self, slot: u32) -> usize {
        self.subcell_counts[slot as usize] as usize
    }

    /// The homes of a patch's two sides.
    pub fn homes(&self, patch: usize) -> &[SubcellRange; 2] {
        &self.of_patch[patch]
    }

    /// The slot of a patch's side.
    pub fn slot(&self, patch: usize, side: usize) -> u32 {
        self.of_patch[patch][side].slot
    }

    /// The slot of a patch's side, and the number there of one of the patch's subcells.
    pub fn place(&self, (patch, subcell): (usize, usize), side: usize) -> (u32, u32) {
        let home = &self.of_patch[patch][side];
        (home.slot, home.subcell(subcell))
    }

    /// Number of slots.
    pub fn len(&self) -> usize {
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
}
