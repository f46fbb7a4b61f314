//! Photon guiding: scattered photons are sent to surfaces whose estimates would have the largest relative error.
//!
//! Photons left to themselves crowd where the indirect light is bright, and much of that is outshone by what comes straight from the
//! transmitter. What a reader sees is a surface's whole light B = B_direct + B_indirect; its relative variance is that of the indirect
//! part, B_indirect²/(n B²) for n photons, and even where n ∝ (B_indirect/B)²: a photon is worth W = B_indirect/B² per power. A pilot of
//! few photons finds B_indirect; W is kept by place and direction of departure, so that a scattered photon can choose among several drawn
//! directions in proportion to it. That changes the photons' numbers and powers, not what they bring on average.

use super::cache::RadianceCache;
use super::illumination::Illumination;
use super::patches::Patches;
use super::surface_records::Surroundings;
use crate::radio::{field, lattice, scattering};
use corf_scene::Rng;
use corf_scene::model::ScatteringPattern;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;

/// Side of the cells of departure, metres.
const CELL_M: f64 = 1.0;
/// Bins along the side of the sphere's octahedral map: 12° wide.
const BINS: usize = 16;
/// Surfaces fainter than this share of the mean are not looked at closely.
const FAINT: f64 = 0.1;
/// Worth is kept within this factor of its mean, upwards and downwards.
const MOST: f64 = 16.0;
/// Legs of the mean worth that every bin starts with: one alone says little.
const PRIOR_LEGS: f32 = 1.0;
/// Directions drawn for a scattered photon, of which it takes one.
const CANDIDATES: usize = 8;
/// Steps of their lattice: 1/g, 1/g² and 1/g³ of the root g of x⁴ = x + 1.
const LATTICE: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];

/// A way from one surface to the next.
#[derive(Clone, Copy, Debug)]
pub struct Leg {
    /// Start, world frame, metres.
    pub from: DVec3,
    /// Unit direction.
    pub direction: DVec3,
    /// Slot at its end: [`super::surface_records::SurfaceRecords::slot`].
    pub slot: u32,
}

/// Record of a pilot pass with few photons.
pub struct Pilot {
    /// By slot: power left there, as the photons carry it.
    pub power: Vec<f64>,
    /// Ways that photons went or could have gone.
    pub legs: Vec<Leg>,
}

/// The worth of a photon by where it leaves and in which direction, relative to the mean.
pub struct Guide {
    /// First entry of a cell in `worth`.
    cells: HashMap<[i32; 3], usize>,
    worth: Vec<f32>,
}

impl Guide {
    /// Learns from a pilot; `None` where it found nothing. Photons of the pilot stand for `photon_weight` steradians each. Also how much
    /// a unit of power disturbs what a reader sees of every slot, up to a factor.
    pub fn learn(
        illumination: &Illumination<'_, '_>,
        patches: &Patches,
        cache: &RadianceCache,
        pilot: &Pilot,
        photon_weight: f64,
    ) -> Option<(Self, Vec<f64>)> {
        let around = cache.slots().surroundings(&pilot.power);
        let Slots { worth, disturbance } = of_slots(&around, &direct_power(illumination, patches, cache), photon_weight)?;
        let mut cells = HashMap::new();
        let mut sums: Vec<[f32; 2]> = Vec::new();
        for leg in &pilot.legs {
            let next = cells.len() * BINS * BINS;
            let first = *cells.entry(cell(leg.from)).or_insert(next);
            sums.resize(cells.len() * BINS * BINS, [PRIOR_LEGS, PRIOR_LEGS]);
            let [sum, count] = &mut sums[first + lattice::octahedral(leg.direction, BINS)];
            *sum += worth[leg.slot as usize] as f32;
            *count += 1.0;
        }
        Some((Self { cells, worth: sums.into_iter().map(|[sum, count]| sum / count).collect() }, disturbance))
    }

    /// Learned worth of the photons that leave a place, by direction.
    pub fn leaving(&self, from: DVec3) -> Departures<'_> {
        Departures(self.cells.get(&cell(from)).map(|&first| &self.worth[first..first + BINS * BINS]))
    }
}

/// The worth of photons by the direction in which they leave a place; all alike where nothing is known.
pub struct Departures<'g>(Option<&'g [f32]>);

impl Departures<'_> {
    /// Worth of a photon along a unit direction, relative to the mean.
    pub fn worth(&self, direction: DVec3) -> f64 {
        self.0.map_or(1.0, |worth| f64::from(worth[lattice::octahedral(direction, BINS)]))
    }
}

fn cell(point: DVec3) -> [i32; 3] {
    (point / CELL_M).floor().as_ivec3().to_array()
}

/// Power per area that the sources have every slot scatter, W/m².
fn direct_power(illumination: &Illumination<'_, '_>, patches: &Patches, cache: &RadianceCache) -> Vec<f64> {
    let geometry = illumination.geometry();
    let lit: Vec<Vec<(u32, f64)>> = (0..geometry.faces.len() as u32)
        .into_par_iter()
        .map(|index| {
            let face = &geometry.faces[index as usize];
            let slab = geometry.slab(index);
            let table = illumination.table(index);
            let s2 = slab.scattering.coefficient * slab.scattering.coefficient;
            let mut lit = Vec::new();
            for (patch, centre) in patches.of_face(index) {
                for &source in &illumination.sources {
                    let lighting = illumination.lighting(source, centre, index);
                    let Some(incident) = illumination.incident(source, lighting, centre, index, 0) else { continue };
                    let side = usize::from(face.normal.dot(incident.direction) > 0.0);
                    let normal = if side == 0 { face.normal } else { -face.normal };
                    let cos = field::cos_incidence(incident.direction, normal);
                    let entry = table.scattering(cos);
                    let ports = illumination.ports();
                    let reflected: f64 = incident.fields[..ports]
                        .iter()
                        .map(|e| field::reflectivity(e, incident.direction, normal, f64::from(entry.te), f64::from(entry.tm)))
                        .sum();
                    let power = s2 * reflected * cos / (incident.distance_m * incident.distance_m * ports as f64);
                    lit.push((cache.slots().slot(patch, side), power * patches.areas_m2()[patch]));
                }
            }
            lit
        })
        .collect();
    let mut power = vec![0.0; cache.slots().len()];
    for (slot, p) in lit.into_iter().flatten() {
        power[slot as usize] += p;
    }
    (0..).zip(power).map(|(slot, power)| power / cache.slots().area_m2(slot).max(f64::MIN_POSITIVE)).collect()
}

/// Quantities of every slot that follow from its scattered power per area, B.
struct Slots {
    /// W, relative to its mean over photons.
    worth: Vec<f64>,
    /// 1/B, m²/W.
    disturbance: Vec<f64>,
}

/// Worth and disturbance of every slot from its surroundings and direct light; `None` without photons.
fn of_slots(around: &[Surroundings], direct: &[f64], photon_weight: f64) -> Option<Slots> {
    let area_m2: f64 = around.iter().map(|s| s.own_m2).sum();
    let photons: f64 = around.iter().map(|s| s.own_power).sum();
    if photons <= 0.0 {
        return None;
    }
    let mean_direct = around.iter().zip(direct).map(|(s, d)| s.own_m2 * d).sum::<f64>() / area_m2;
    let floor = FAINT * (photons * photon_weight / area_m2 + mean_direct);
    let (worth, disturbance): (Vec<f64>, Vec<f64>) = around
        .iter()
        .zip(direct)
        .map(|(s, direct)| {
            let indirect = s.power * photon_weight / s.area_m2.max(f64::MIN_POSITIVE);
            let disturbance = 1.0 / (indirect + direct + floor);
            (indirect * disturbance * disturbance, disturbance)
        })
        .unzip();
    let mean = around.iter().zip(&worth).map(|(s, w)| s.own_power * w).sum::<f64>() / photons;
    let worth = worth.into_iter().map(|w| (w / mean).clamp(1.0 / MOST, MOST)).collect();
    (mean > 0.0).then_some(Slots { worth, disturbance })
}

/// A scattered photon's way.
pub struct Drawn {
    /// Unit direction.
    pub direction: DVec3,
    /// F·f_s over the density with which it was drawn.
    pub weight: f64,
    /// Worth of the direction by the guide.
    pub worth: f64,
}

/// Draws the direction of a scattered photon: one of a few that are spread over the lobe, in proportion to their worth (resampled
/// importance sampling, Talbot et al. 2005: the mean of all weights over the chosen one's share of them keeps the expectation).
pub fn draw(
    pattern: ScatteringPattern,
    k: DVec3,
    normal: DVec3,
    worth: impl Fn(DVec3) -> f64,
    guided: bool,
    rng: &mut Rng,
) -> Option<Drawn> {
    let count = if guided { CANDIDATES } else { 1 };
    let turn = [rng.uniform_f64(), rng.uniform_f64(), rng.uniform_f64()];
    let mut candidates = [const { None }; CANDIDATES];
    let mut sum = 0.0;
    for (i, candidate) in candidates.iter_mut().enumerate().take(count) {
        // A lattice turned at random (Cranley–Patterson): every one of them is uniform, all together are even.
        let shifted = [0, 1, 2].map(|axis| (turn[axis] + i as f64 * LATTICE[axis]).fract());
        *candidate = scattering::sample(pattern, k, normal, shifted).map(|(direction, weight)| {
            let worth = worth(direction);
            sum += weight * worth;
            Drawn { direction, weight, worth }
        });
    }
    let mut left = if guided { rng.uniform_f64() * sum } else { 0.0 };
    let chosen = candidates.into_iter().flatten().find(|c| {
        left -= c.weight * c.worth;
        left <= 0.0
    })?;
    Some(Drawn { weight: sum / (count as f64 * chosen.worth), ..chosen })
}
