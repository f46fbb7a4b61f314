//! All photons of a transmitter, pilots first, and the cache that they fill.

use super::cache::{Deposit, RadianceCache};
use super::emission::Emission;
use super::photons::{PHOTONS_PER_TASK, PhotonKind, PhotonPass, Photons, Trail};
use glam::DVec3;
use rayon::prelude::*;

/// Tasks between two fillings of the cache: a quarter of a million photons leave some 100 MB of deposits.
const TASKS_PER_ROUND: usize = 128;
/// Stage of the photons' random numbers.
const STAGE: u64 = 0x9407_0a5e;
/// Stage of the random numbers of photons that carry scattered light.
const SCATTERED_STAGE: u64 = 0x9407_0a60;
/// Stage of the random numbers for the directions in which photons leave the transmitter.
const EMISSION_STAGE: u64 = 0x9407_0a61;
/// Share of all photons that bring scattered light.
const SCATTERED_SHARE: f64 = 0.3;

impl Photons<'_, '_, '_> {
    /// Traces them all; `None` where no chain could leave anything.
    pub fn trace(&self, patch_m: f64) -> Option<RadianceCache> {
        let settings = &self.illumination.tracer.settings;
        if self.count == 0 || settings.max_interactions < 2 {
            return None;
        }
        // A deposit is at least a second interaction.
        let mut cache = RadianceCache::new(self.illumination, self.patches, patch_m, settings.max_interactions - 1);
        for pass in self.passes(self.disturbances(&cache)) {
            let count = pass.emission.len();
            let tasks = count.div_ceil(PHOTONS_PER_TASK);
            for first in (0..tasks).step_by(TASKS_PER_ROUND) {
                let batches: Vec<Vec<Deposit>> = (first..(first + TASKS_PER_ROUND).min(tasks))
                    .into_par_iter()
                    .map(|task| {
                        let mut trail = Trail::default();
                        for i in task * PHOTONS_PER_TASK..((task + 1) * PHOTONS_PER_TASK).min(count) {
                            self.follow(i, &pass, &cache, &mut trail);
                        }
                        trail.deposits.sort_by_key(|d| d.slot);
                        trail.deposits
                    })
                    .collect();
                cache.add(&batches);
            }
        }
        cache.finish(self.illumination.geometry(), self.patches, 4.0 * std::f64::consts::PI / self.count as f64);
        Some(cache)
    }

    /// All photons at once without a pilot; with one, in two passes.
    fn passes(&self, pilot: Option<Vec<(DVec3, f64)>>) -> Vec<PhotonPass> {
        let even = |count: usize| Emission::Even { count, world_from_lattice: self.world_from_lattice };
        let Some(pilot) = pilot else {
            return vec![PhotonPass { kind: PhotonKind::All, emission: even(self.count), stage: STAGE }];
        };
        let scattered = (self.count as f64 * SCATTERED_SHARE) as usize;
        let unscattered = Emission::learn(self.count - scattered, &pilot, self.seed, EMISSION_STAGE);
        vec![
            PhotonPass { kind: PhotonKind::Unscattered, emission: unscattered, stage: STAGE },
            PhotonPass { kind: PhotonKind::Scattered, emission: even(scattered), stage: SCATTERED_STAGE },
        ]
    }
}
