//! Pilot photons: a few that go ahead of all others and find in which directions of departure unscattered light makes noise that matters.
//!
//! Photons left to themselves crowd where the indirect light is bright, and much of that is outshone by what comes straight from the
//! transmitter. What a reader sees is a surface's whole light B = B_direct + B_indirect, so that a photon of power p disturbs it by p/B of
//! itself. The pilot finds B_indirect, and by direction of departure the squared disturbance (p/B)² that [`Emission::learn`] makes small.

use super::cache::{Deposit, RadianceCache};
use super::emission::Emission;
use super::illumination::Illumination;
use super::patches::Patches;
use super::photons::{PHOTONS_PER_TASK, PhotonKind, PhotonPass, Photons, Trail};
use super::surface_records::Surroundings;
use crate::radio::field;
use glam::DVec3;
use rayon::prelude::*;

/// Number of photons per pilot photon.
const PILOT_SHARE: usize = 16;
/// Largest number of pilot photons, whose deposits are all kept.
const MOST_PILOTS: usize = 250_000;
/// Surfaces fainter than this share of the mean count as this bright.
const FAINT: f64 = 0.1;
/// Stage of the pilot photons' random numbers.
const PILOT_STAGE: u64 = 0x9407_0a5f;

impl Photons<'_, '_, '_> {
    /// Pairs of a direction in which a pilot photon left the transmitter and the sum of its squared disturbances, up to a factor, as
    /// unscattered light; `None` where a single chain is followed, or where the pilot found nothing.
    pub fn disturbances(&self, cache: &RadianceCache) -> Option<Vec<(DVec3, f64)>> {
        let count = (self.count / PILOT_SHARE).min(MOST_PILOTS);
        if self.only.is_some() || count == 0 {
            return None;
        }
        let emission = Emission::Even { count, world_from_lattice: self.world_from_lattice };
        let pass = PhotonPass { kind: PhotonKind::All, emission, stage: PILOT_STAGE };
        let trails: Vec<(Trail, Vec<usize>)> = (0..count.div_ceil(PHOTONS_PER_TASK))
            .into_par_iter()
            .map(|task| {
                let mut trail = Trail::default();
                let until = (task * PHOTONS_PER_TASK..((task + 1) * PHOTONS_PER_TASK).min(count)).map(|i| {
                    self.follow(i, &pass, cache, &mut trail);
                    trail.deposits.len()
                });
                let until = until.collect();
                (trail, until)
            })
            .collect();
        let power = |d: &Deposit| f64::from(d.coherency[0] + d.coherency[1]);
        let mut indirect = vec![0.0; cache.slots().len()];
        trails.iter().flat_map(|(trail, _)| &trail.deposits).for_each(|d| indirect[d.slot as usize] += power(d));
        let around = cache.slots().surroundings(&indirect);
        let photon_sr = 4.0 * std::f64::consts::PI / self.count as f64;
        let disturbance = disturbance(&around, &direct_power(self.illumination, self.patches, cache), photon_sr)?;
        let mut disturbances = Vec::with_capacity(count);
        for (trail, until) in &trails {
            let mut from = 0;
            for &until in until {
                let unscattered = trail.deposits[from..until].iter().filter(|d| !d.scattered);
                let square = unscattered.map(|d| (power(d) * disturbance[d.slot as usize]).powi(2)).sum();
                disturbances.push((pass.emission.photon(disturbances.len()).0, square));
                from = until;
            }
        }
        Some(disturbances)
    }
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

/// 1/B of every slot from the photons in its surroundings, which stand for `photon_sr` steradians each, and its direct light, m²/W;
/// `None` without photons.
fn disturbance(around: &[Surroundings], direct: &[f64], photon_sr: f64) -> Option<Vec<f64>> {
    let area_m2: f64 = around.iter().map(|s| s.own_m2).sum();
    let photons: f64 = around.iter().map(|s| s.own_power).sum();
    if photons <= 0.0 {
        return None;
    }
    let mean_direct = around.iter().zip(direct).map(|(s, d)| s.own_m2 * d).sum::<f64>() / area_m2;
    let floor = FAINT * (photons * photon_sr / area_m2 + mean_direct);
    let of_slot = |(s, direct): (&Surroundings, &f64)| {
        let indirect = s.power * photon_sr / s.area_m2.max(f64::MIN_POSITIVE);
        1.0 / (indirect + direct + floor)
    };
    Some(around.iter().zip(direct).map(of_slot).collect())
}
