//! The few photons that go ahead: they find out where indirect light falls, and what the others are worth.

use super::cache::{Deposit, RadianceCache};
use super::emission::Emission;
use super::guide::{Guide, Leg, Pilot};
use super::illumination::CLEARANCE_M;
use super::photons::{PHOTONS_PER_TASK, PhotonKind, PhotonPass, Photons, Trail};
use crate::radio::scattering;
use corf_scene::Rng;
use corf_scene::model::ScatteringPattern;
use glam::DVec3;
use rayon::prelude::*;

/// Number of photons per pilot photon.
const PILOT_SHARE: usize = 16;
/// Largest number of pilot photons: the records of one take some 700 bytes.
const MOST_PILOTS: usize = 250_000;
/// Directions that the pilot looks along from every place where a photon arrives, besides those that photons take.
const PILOT_LOOKS: usize = 4;
/// Stage of their random numbers.
const PILOT_STAGE: u64 = 0x9407_0a5f;

impl Photons<'_, '_, '_> {
    /// Sends a pilot ahead and learns from it: what photons are worth, and how much those of a direction disturb that were not scattered.
    pub fn guide(&self, cache: &RadianceCache) -> Option<(Guide, Vec<(DVec3, f64)>)> {
        let count = (self.count / PILOT_SHARE).min(MOST_PILOTS);
        if self.only.is_some() || count == 0 {
            return None;
        }
        let emission = Emission::Even { count, world_from_lattice: self.world_from_lattice };
        let pass = PhotonPass { kind: PhotonKind::All, emission, guide: None, stage: PILOT_STAGE };
        let trails: Vec<(Trail, Vec<usize>)> = (0..count.div_ceil(PHOTONS_PER_TASK))
            .into_par_iter()
            .map(|task| {
                let mut trail = Trail::of_pilot();
                let until = (task * PHOTONS_PER_TASK..((task + 1) * PHOTONS_PER_TASK).min(count)).map(|i| {
                    self.follow(i, &pass, cache, &mut trail);
                    trail.deposits.len()
                });
                let until = until.collect();
                (trail, until)
            })
            .collect();
        let power = |d: &Deposit| f64::from(d.coherency[0] + d.coherency[1]);
        let legs = trails.iter().flat_map(|(trail, _)| &trail.legs).map(Vec::len).sum();
        let mut pilot = Pilot { power: vec![0.0; cache.slots().len()], legs: Vec::with_capacity(legs) };
        for (trail, _) in &trails {
            trail.deposits.iter().for_each(|d| pilot.power[d.slot as usize] += power(d));
            pilot.legs.extend(trail.legs.iter().flatten());
        }
        let photon_sr = 4.0 * std::f64::consts::PI / self.count as f64;
        let (guide, disturbance) = Guide::learn(self.illumination, self.patches, cache, &pilot, photon_sr)?;
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
        Some((guide, disturbances))
    }

    /// Looks from a place into a few directions above its surface.
    pub fn look_around(&self, point: DVec3, normal: DVec3, cache: &RadianceCache, rng: &mut Rng, legs: &mut Vec<Leg>) {
        let geometry = self.illumination.geometry();
        for _ in 0..PILOT_LOOKS {
            let uniform = [rng.uniform_f64(), rng.uniform_f64(), 0.0];
            let drawn = scattering::sample(ScatteringPattern::Lambertian, -normal, normal, uniform);
            let Some((direction, _)) = drawn else { continue };
            let Some(met) = geometry.intersect(point, direction, CLEARANCE_M) else { continue };
            let slot = cache.slots().slot(self.patches.at(met.face, met.point).0, met.side);
            legs.push(Leg { from: point, direction, slot });
        }
    }
}
