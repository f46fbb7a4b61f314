//! The diffuse field: every chain of mirrors, slabs and scattering surfaces with at least one scattering in it.
//!
//! The power that a surface element sends to the receiver is (λ/4π)² S²Γ² f_s cosθ_i dA / (r₁² r₂²). Surfaces are lit in two ways. What
//! comes from the transmitter and its larger mirror images, straight or through slabs, is evaluated exactly at every point that is
//! looked at. Everything else (smaller mirrors, several of them, any scattering before) is brought by photons to world-fixed patches,
//! once for all receivers, and patches with few of them are weighed against their surroundings; where within a patch they fell is kept as
//! well. At a receiver the integral runs over solid angle, dA = r₂² dΩ / cosθ_s, on a lattice of directions, finer where neighbouring
//! directions disagree: near surfaces are resolved as finely as far ones, every direction sees exactly what is visible along it, mirrored
//! and through slabs as well, up to the budget of interactions. The transmitter's own rays help with lit surfaces that the receiver sees
//! edge-on.
//!
//! Antennas with two ports: a receiver's ports add their powers; a transmitter's share its power, so that the result is their mean.

mod check;
mod gather;
mod light;
mod settings;
#[cfg(test)]
mod tests;

use super::lattice::Directions;
use super::{Antenna, Arrival, RadioTracer};
pub use check::Scattered;
use corf_scene::{Error, Result, Rng, bounds};
pub use gather::WorldExtent;
use gather::image_receivers::{self, ImageReceivers, MirrorSequence, StrongMirrors};
use gather::light_hits::{self, LightHits};
use gather::refine::Gathering;
use gather::small_faces::SmallFaces;
use gather::{DepthLayer, GatherTracer, Lattice};
use glam::{DMat3, DVec2, DVec3};
use light::cache::RadianceCache;
use light::illumination::Illumination;
use light::patches::Patches;
pub(crate) use light::photons::Event;
use light::photons::Photons;
use rayon::prelude::*;
use settings::SamplingPolicy;
pub use settings::{DiffuseSettings, NO_MIRRORS_SR};

/// Memory per direction, with the hits of the transmitter's ray along it and of the receiver's, bytes.
const DIRECTION_BYTES: f64 = 200.0;
/// Directions that a task looks along; few, for refinement makes some of them sixty-four, and the last task keeps all others waiting.
const DIRECTIONS_PER_TASK: usize = 128;

/// Arrivals that are numbers.
fn finite(rx: DVec3, arrivals: Vec<Arrival>) -> Result<Vec<Arrival>> {
    let is_finite = |a: &Arrival| a.power.is_finite() && a.delay_s.is_finite() && a.direction.is_finite();
    if arrivals.iter().all(is_finite) { Ok(arrivals) } else { Err(not_finite(rx)) }
}

fn not_finite(rx: DVec3) -> Error {
    Error::invalid(
        format!("receiver at {rx}"),
        "the scattered power is not a finite number",
        "a size, distance or material of the scene is beyond what can be computed: check its unit",
    )
}

/// A share of the diffuse power, by how it came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contribution {
    /// |a|², linear, relative to 1 W transmitted.
    pub power: f64,
    /// Delay, seconds.
    pub delay_s: f64,
    /// The scene object that scattered it last.
    pub object: u32,
    /// Whether one mirror stands between the transmitter and the scattering surface, and nothing else was involved but slabs.
    pub mirrored_before: bool,
    /// Whether photons brought it: by small or several mirrors, or scattered before.
    pub indirect: bool,
    /// Interactions between the scattering surface and the receiver.
    pub after: usize,
}

/// A transmitter's diffuse field.
pub struct DiffuseField<'t, 'a> {
    tracer: &'t RadioTracer<'a>,
    illumination: Illumination<'t, 'a>,
    patches: Patches,
    cache: Option<RadianceCache>,
    /// Hits of the transmitter's rays, as many as a receiver has directions; without them a receiver's directions are the only sampling
    /// technique.
    light_hits: Option<LightHits>,
    /// Faces that are sampled over their area, with [`DiffuseSettings::even_arrivals`].
    small: Option<SmallFaces>,
    /// Shift of the patches and sample points.
    phase: DVec2,
    /// First number of the low-discrepancy sequence for Russian roulette, in [0, 1).
    luck: f64,
    settings: DiffuseSettings,
    policy: SamplingPolicy,
    directions: Directions,
    /// Directions outside of an extent, sparser.
    outside: Directions,
    /// Mirrors, and the directions that look for more of them, with [`DiffuseSettings::even_arrivals`].
    mirrors: Option<(StrongMirrors, Directions)>,
}

impl<'t, 'a> DiffuseField<'t, 'a> {
    /// Finds the transmitter's mirrors, follows its rays, lays out the patches and traces the photons.
    ///
    /// # Errors
    /// A position that is not finite or within 0.1 mm of a surface, or settings out of range.
    pub fn new(tracer: &'t RadioTracer<'a>, tx: DVec3, settings: &DiffuseSettings) -> Result<Self> {
        Self::of_chains(tracer, tx, settings, None)
    }

    /// The diffuse field of a single chain of events from the transmitter to its last scattering, all of it brought by photons; otherwise
    /// [`DiffuseField::new`].
    pub(crate) fn of_chain(tracer: &'t RadioTracer<'a>, tx: DVec3, settings: &DiffuseSettings, chain: &[Event]) -> Result<Self> {
        Self::of_chains(tracer, tx, settings, Some(chain))
    }

    fn of_chains(tracer: &'t RadioTracer<'a>, tx: DVec3, settings: &DiffuseSettings, only: Option<&[Event]>) -> Result<Self> {
        settings.validate()?;
        tracer.check_in_the_open("transmitter", tx)?;
        let directions_bytes = DIRECTION_BYTES * settings.directions as f64;
        bounds::memory("directions", &format!("{} of them", settings.directions), directions_bytes, "give fewer directions")?;
        let mut rng = Rng::keyed(settings.phase, 0x0d1f_f05e, 0);
        let (phase, world_from_lattice, luck) = if settings.phase == 0 {
            (DVec2::ZERO, DMat3::IDENTITY, 0.5)
        } else {
            let axis = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize_or(DVec3::Z);
            let turn = DMat3::from_axis_angle(axis, std::f64::consts::TAU * rng.uniform_f64());
            (DVec2::new(rng.uniform_f64(), rng.uniform_f64()), turn, rng.uniform_f64())
        };
        let patches = Patches::new(&tracer.geometry, settings.patch_size_m, phase)?;
        let policy = settings.policy();
        let [directions, outside] = [1, policy.outside_sparsity].map(|sparser| {
            let directions = Directions::new(settings.directions.div_ceil(sparser), world_from_lattice);
            if policy.is_even { directions.jittered(settings.phase) } else { directions }
        });
        let mut illumination = Illumination::new(tracer, tx, settings.min_mirror_sr);
        let light_hits = if only.is_some() {
            illumination.sources.clear();
            None
        } else {
            Some(light_hits::trace(&illumination, &directions))
        };
        let photons = Photons {
            illumination: &illumination,
            patches: &patches,
            count: settings.photons,
            seed: settings.phase,
            world_from_lattice,
            only,
        };
        let cache = photons.trace(settings.patch_size_m);
        let small = policy.is_even.then(|| SmallFaces::new(&tracer.geometry));
        let mirrors = (policy.is_even && settings.after > 0)
            .then(|| (StrongMirrors::new(&tracer.geometry, &illumination), image_receivers::pilots(settings.directions)));
        Ok(Self {
            tracer,
            illumination,
            patches,
            cache,
            light_hits,
            small,
            phase,
            luck,
            settings: *settings,
            policy,
            directions,
            outside,
            mirrors,
        })
    }

    /// Megabytes of the tables that the photons filled.
    pub fn cache_megabytes(&self) -> f64 {
        self.cache.as_ref().map_or(0.0, RadianceCache::megabytes)
    }

    /// The tracer's receive element, for receivers that have none of their own.
    pub fn antenna(&self) -> &'t Antenna {
        &self.tracer.settings.rx_antenna
    }

    /// Number of surface patches.
    pub fn patch_count(&self) -> usize {
        self.patches.len()
    }

    /// Number of sources: the transmitter and the mirrors that show it.
    pub fn source_count(&self) -> usize {
        self.illumination.sources.len()
    }

    /// The diffuse arrivals at a receiver, one per direction that receives anything, near ones together, then those of the transmitter's own
    /// rays; delays are means weighted by power, objects those that the receiver sees. Directions outside of `extent` are sparser
    /// and not refined, which keeps the total power. `antenna` may turn from one position to the next.
    ///
    /// # Errors
    /// A position that is not finite, or within 0.1 mm of a surface.
    pub fn gather(&self, rx: DVec3, antenna: &Antenna, extent: &WorldExtent) -> Result<Vec<Arrival>> {
        self.tracer.check_in_the_open("receiver", rx)?;
        let inside = extent.inside();
        let gathering = self.gathering(rx, antenna, &inside);
        let mut arrivals = gathering.arrivals(&inside);
        if !matches!(extent, WorldExtent::Sphere) {
            // What lies outside counts for the total power alone.
            let outside = Gathering {
                directions: &self.outside,
                resolution_deg: 0.0,
                shared: false,
                small: None,
                views: None,
                ..gathering
            };
            arrivals.extend(outside.arrivals(|d| !inside(d)));
        }
        finite(rx, arrivals)
    }

    fn gathering<'g>(
        &'g self,
        rx: DVec3,
        antenna: &'g Antenna,
        wanted: impl Fn(DVec3) -> bool + Sync,
    ) -> Gathering<'g, 'g, 't, 'a> {
        let resolution_deg = self.settings.resolution_deg;
        let seen = |small: &SmallFaces| small.seen_from(&self.tracer.geometry, rx, self.directions.count(), self.phase);
        let small = self.small.as_ref().map(seen);
        let lattice = Lattice::new(self.directions.count(), true, true);
        let views = self.mirrors.as_ref().map(|(strong, pilots)| {
            let look = GatherTracer::new(self, rx, antenna, lattice);
            let mirrors_along =
                |direction: DVec3, kept: f64, report: &mut dyn FnMut(MirrorSequence)| look.mirrors_along(direction, kept, report);
            ImageReceivers::new(&self.tracer.geometry, rx, strong, pilots, lattice.sampling, &wanted, mirrors_along)
        });
        Gathering {
            field: self,
            rx,
            antenna,
            directions: &self.directions,
            resolution_deg,
            shared: true,
            small,
            views,
            mirror_side: self.policy.mirror_side,
        }
    }

    /// Every contribution on its own with the direction it arrives from, near ones together, then those of the transmitter's own
    /// rays: for studies and checks.
    ///
    /// # Errors
    /// A position that is not finite, or within 0.1 mm of a surface.
    pub fn contributions(&self, rx: DVec3) -> Result<Vec<(DVec3, Contribution)>> {
        self.tracer.check_in_the_open("receiver", rx)?;
        let antenna = &self.tracer.settings.rx_antenna;
        let lattice = Lattice::new(self.directions.count(), false, true);
        let mut all = in_tasks(self.directions.along(), |numbers| {
            let mut look = GatherTracer::new(self, rx, antenna, lattice);
            let mut found = Vec::new();
            for number in numbers.iter().map(|&number| number as usize) {
                let direction = self.directions.of(number);
                look.along(number, direction, DepthLayer::All, &mut |c| found.push((direction, c)));
            }
            found
        });
        all.extend(self.landed(rx, antenna, lattice, |_| true));
        match all.iter().all(|(_, c)| c.power.is_finite() && c.delay_s.is_finite()) {
            true => Ok(all),
            false => Err(not_finite(rx)),
        }
    }

    /// Contributions of the transmitter's ray hits in a receiver's `wanted` directions.
    fn landed(
        &self,
        rx: DVec3,
        antenna: &Antenna,
        lattice: Lattice<'_>,
        wanted: impl Fn(DVec3) -> bool + Sync,
    ) -> Vec<(DVec3, Contribution)> {
        let light_hits = self.light_hits.as_ref().filter(|_| lattice.shared).map_or(&[][..], |light_hits| &light_hits.all);
        in_tasks(light_hits, |light_hits| {
            let look = GatherTracer::new(self, rx, antenna, lattice);
            light_hits.iter().filter_map(|hit| look.landed(hit, &wanted)).collect()
        })
    }
}

/// Runs over directions, or what was found along them, in tasks and joins their results in order.
fn in_tasks<D: Sync, T: Send>(all: &[D], task: impl Fn(&[D]) -> Vec<T> + Sync + Send) -> Vec<T> {
    let per_task: Vec<Vec<T>> = all.par_chunks(DIRECTIONS_PER_TASK).map(task).collect();
    per_task.into_iter().flatten().collect()
}
