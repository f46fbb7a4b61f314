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

mod bins;
mod cache;
mod emission;
mod exposure;
mod extent;
mod gather;
mod guide;
mod illumination;
mod image_receivers;
mod light_hit_tree;
mod light_hits;
mod mis;
mod nodes;
mod outliers;
mod patches;
mod photons;
mod pilot;
mod quadrature;
mod refine;
mod sampling;
mod small;
mod smooth;
mod subcells;
mod surface_records;
#[cfg(test)]
mod tests;
mod trace;

use super::lattice::Directions;
use super::{Antenna, Arrival, MAX_DEPTH, RadioTracer};
use cache::RadianceCache;
use corf_scene::{Error, Pinhole, Result, Rigid3, Rng, bounds};
use gather::{GatherTracer, Lattice, Layer};
use glam::{DMat3, DVec2, DVec3};
use illumination::Illumination;
use image_receivers::{ImageReceivers, StrongMirrors};
use light_hits::LightHits;
use patches::Patches;
pub(crate) use photons::Event;
use photons::Photons;
pub use quadrature::Scattered;
use rayon::prelude::*;
use refine::Gathering;
use serde::{Deserialize, Serialize};
use small::SmallFaces;

/// Factor by which [`DiffuseField::gather_for_view`] samples directions out of view more sparsely.
pub const OUTSIDE_SPARSITY: usize = 16;
/// Factor instead of [`OUTSIDE_SPARSITY`] with [`DiffuseSettings::even_arrivals`], whose readers have fewer directions.
pub const EVEN_OUTSIDE_SPARSITY: usize = 4;
/// More than the whole sphere: no mirror is evaluated exactly.
pub const NO_MIRRORS_SR: f64 = 13.0;
/// More photons are a mistake.
const MAX_PHOTONS: usize = 100_000_000;
/// Memory per direction, with the hits of the transmitter's ray along it and of the receiver's, bytes.
const DIRECTION_BYTES: f64 = 200.0;
/// Directions along the side of a cell in which a strong mirror stands, with [`DiffuseSettings::even_arrivals`].
const MIRROR_SIDE: usize = 2;
/// Directions that a task looks along; few, for refinement makes some of them sixty-four, and the last task keeps all others waiting.
const DIRECTIONS_PER_TASK: usize = 128;

/// Sampling of the diffuse field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DiffuseSettings {
    /// Side of the world-fixed patches on which photons are gathered, metres: indirect light is resolved as finely as this.
    pub patch_size_m: f64,
    /// Directions over the whole sphere in which a receiver gathers, and rays of the transmitter that help it; 120 000 are 0.59° apart.
    pub directions: usize,
    /// Most interactions after the last scattering (mirrors and slabs between the surface and the receiver), within the tracer's depth.
    pub after: usize,
    /// Share of the directions that look on behind the first surface, mirrored and straight through; each then counts for more.
    pub look_on: f64,
    /// Faces that fill less of the transmitter's view than this mirror it onto surfaces by photons, not exactly, steradians. In the
    /// lobby the seven that fill 0.3 sr and more cost as much as all else and do not change the sampling error; by default there are none.
    pub min_mirror_sr: f64,
    /// Photons that bring all indirect light; 0 leaves it out.
    pub photons: usize,
    /// Angular resolution of the arrivals' reader, degrees: where neighbouring directions differ by more than some per cent of the power
    /// within it, a receiver samples more finely. 0 leaves it at the lattice.
    pub resolution_deg: f64,
    /// Whether heavy single arrivals are avoided: small faces are sampled over their area, strong mirrors get more directions, all
    /// directions are jittered in their cells, and outliers are clamped. For readers whose lobes hold many arrivals, where the few heavy
    /// ones make the error.
    pub even_arrivals: bool,
    /// Firefly clamp, with `even_arrivals`: an arrival of more than this share of all others within the resolution around it, and of more
    /// than any one of them, is cut to the larger of the two; the power cut goes to all arrivals. Less error for some bias, and less of
    /// both with more directions; 0 cuts nothing.
    pub outlier_share: f64,
    /// Shifts the patches, turns the lattices and draws other photons; results of different phases differ by the sampling error alone.
    pub phase: u64,
}

impl Default for DiffuseSettings {
    fn default() -> Self {
        Self {
            patch_size_m: 0.16,
            directions: 120_000,
            after: MAX_DEPTH,
            look_on: 1.0,
            min_mirror_sr: NO_MIRRORS_SR,
            photons: 200_000,
            resolution_deg: 1.0,
            even_arrivals: false,
            outlier_share: 0.1,
            phase: 0,
        }
    }
}

impl DiffuseSettings {
    /// Checks ranges.
    ///
    /// # Errors
    /// The first setting out of range, by name.
    pub fn validate(&self) -> Result<()> {
        let fault = |key: &str, what: String, help: &str| Err(Error::invalid(format!("diffuse settings, `{key}`"), what, help));
        if !(0.02..=1e3).contains(&self.patch_size_m) {
            return fault("patch_size_m", format!("{:?}", self.patch_size_m), "give 0.02 m to 1000 m; 0.16 suits a lobby");
        }
        if !(100..=50_000_000).contains(&self.directions) {
            return fault("directions", format!("{}", self.directions), "give 100 to 50 000 000; 120 000 suits a 1 degree lobe");
        }
        if !(self.look_on > 0.0 && self.look_on <= 1.0) {
            return fault("look_on", format!("{}", self.look_on), "a share above 0, up to 1");
        }
        if self.photons > MAX_PHOTONS {
            return fault("photons", format!("{}", self.photons), "give at most 100 000 000; a million suits a lobby");
        }
        if !(self.resolution_deg.is_finite() && (0.0..=90.0).contains(&self.resolution_deg)) {
            return fault(
                "resolution_deg",
                format!("{}", self.resolution_deg),
                "give 0 to 90 degrees; the width of a spectrum's lobe suits",
            );
        }
        if !(self.outlier_share.is_finite() && self.outlier_share >= 0.0) {
            return fault(
                "outlier_share",
                format!("{}", self.outlier_share),
                "give a share of at least 0; 0.1 suits an array of 8 by 8",
            );
        }
        if !(self.min_mirror_sr.is_finite() && self.min_mirror_sr >= 0.0) {
            return fault("min_mirror_sr", format!("{}", self.min_mirror_sr), "give a solid angle of at least 0");
        }
        Ok(())
    }
}

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
    directions: Directions,
    /// Directions out of view: [`OUTSIDE_SPARSITY`] times fewer, or [`EVEN_OUTSIDE_SPARSITY`] times.
    outside: Directions,
    /// With [`DiffuseSettings::even_arrivals`]: mirrors, and the directions that look for more of them.
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
        let outside_sparsity = if settings.even_arrivals { EVEN_OUTSIDE_SPARSITY } else { OUTSIDE_SPARSITY };
        let [directions, outside] = [1, outside_sparsity].map(|sparser| {
            let directions = Directions::new(settings.directions.div_ceil(sparser), world_from_lattice);
            if settings.even_arrivals { directions.jittered(settings.phase) } else { directions }
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
        let small = settings.even_arrivals.then(|| SmallFaces::new(&tracer.geometry));
        let mirrors = (settings.even_arrivals && settings.after > 0)
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
            directions,
            outside,
            mirrors,
        })
    }

    /// Megabytes of the tables that the photons filled.
    pub fn cache_megabytes(&self) -> f64 {
        self.cache.as_ref().map_or(0.0, RadianceCache::megabytes)
    }

    /// Number of surface patches.
    pub fn patch_count(&self) -> usize {
        self.patches.len()
    }

    /// Number of sources: the transmitter and the mirrors that show it.
    pub fn source_count(&self) -> usize {
        self.illumination.sources.len()
    }

    /// The diffuse arrivals at the tracer's receive antenna, one per direction that receives anything, near ones together, then
    /// those of the transmitter's own rays; delays are means weighted by power, objects those that the receiver sees.
    ///
    /// # Errors
    /// A position that is not finite, or within 0.1 mm of a surface.
    pub fn gather(&self, rx: DVec3) -> Result<Vec<Arrival>> {
        self.gather_with(rx, &self.tracer.settings.rx_antenna)
    }

    /// The arrivals of [`DiffuseField::gather`] at an antenna of its own, which may turn from one position to the next.
    ///
    /// # Errors
    /// Those of [`DiffuseField::gather`].
    pub fn gather_with(&self, rx: DVec3, antenna: &Antenna) -> Result<Vec<Arrival>> {
        self.tracer.check_in_the_open("receiver", rx)?;
        finite(rx, self.gathering(rx, antenna, |_| true).arrivals(|_| true))
    }

    /// The arrivals of [`DiffuseField::gather`] for one view: all directions inside the camera's frame and a margin around it, and outside
    /// of it a lattice [`OUTSIDE_SPARSITY`] times sparser, which keeps the total power. An array's side lobes want more:
    /// [`DiffuseField::gather_in_front_with`].
    ///
    /// # Errors
    /// A position that is not finite, or within 0.1 mm of a surface.
    pub fn gather_for_view(&self, camera: &Pinhole, world_from_camera: &Rigid3) -> Result<Vec<Arrival>> {
        self.gather_for_view_with(camera, world_from_camera, &self.tracer.settings.rx_antenna)
    }

    /// The arrivals of [`DiffuseField::gather_for_view`] at an antenna of its own.
    ///
    /// # Errors
    /// Those of [`DiffuseField::gather_for_view`].
    pub fn gather_for_view_with(&self, camera: &Pinhole, world_from_camera: &Rigid3, antenna: &Antenna) -> Result<Vec<Arrival>> {
        self.gather_within(world_from_camera.translation, antenna, extent::view(camera, world_from_camera))
    }

    /// The arrivals of [`DiffuseField::gather_with`] for an array without response behind its plane: all directions before the plane and a
    /// margin, and behind a sparser lattice, which keeps the total power. `boresight` is the array's, a unit vector.
    ///
    /// # Errors
    /// A position that is not finite, or within 0.1 mm of a surface.
    pub fn gather_in_front_with(&self, rx: DVec3, boresight: DVec3, antenna: &Antenna) -> Result<Vec<Arrival>> {
        self.gather_within(rx, antenna, extent::front(boresight))
    }

    fn gather_within(&self, rx: DVec3, antenna: &Antenna, inside: impl Fn(DVec3) -> bool + Sync) -> Result<Vec<Arrival>> {
        self.tracer.check_in_the_open("receiver", rx)?;
        let view = self.gathering(rx, antenna, &inside);
        let mut arrivals = view.arrivals(&inside);
        // What lies outside counts for the total power alone.
        let outside =
            Gathering { directions: &self.outside, resolution_deg: 0.0, shared: false, small: None, views: None, ..view };
        arrivals.extend(outside.arrivals(|d| !inside(d)));
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
        let mirror_side = if self.settings.even_arrivals { MIRROR_SIDE } else { 1 };
        let lattice = Lattice::new(self.directions.count(), true, true);
        let views = self.mirrors.as_ref().map(|(strong, pilots)| {
            let look = GatherTracer::new(self, rx, antenna, lattice);
            let mirrors_along = |direction: DVec3, kept: f64, report: &mut dyn FnMut(image_receivers::MirrorSequence)| {
                look.mirrors_along(direction, kept, report)
            };
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
            mirror_side,
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
                look.along(number, direction, Layer::All, &mut |c| found.push((direction, c)));
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
