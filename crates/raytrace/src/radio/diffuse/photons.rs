//! Photons from the transmitter: every chain of mirrors, slabs and scattering surfaces, kept where they arrive.
//!
//! A photon carries its polarised field; its power is ‖E‖² and each stands for 4π/N steradians of the transmitter's sphere. Where it
//! meets a surface it leaves what is scattered there in the cache and goes on mirrored, straight through, and scattered into one drawn
//! direction, weak ones by roulette. What the sources of [`Illumination`] light already is not left again.

use super::cache::{Deposit, RadianceCache};
use super::illumination::{CLEARANCE_M, Illumination};
use super::patches::Patches;
use crate::radio::antenna::{phi_hat, theta_hat};
use crate::radio::field::{self, Field};
use crate::radio::{lattice, scattering};
use corf_scene::Rng;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Photons a task traces.
const PHOTONS_PER_TASK: usize = 2048;
/// Tasks between two fillings of the cache: a quarter of a million photons leave some 100 MB of deposits.
const TASKS_PER_ROUND: usize = 128;
/// Stage of the random numbers.
const STAGE: u64 = 0x9407_0a5e;
/// Photons below this power take part in roulette.
const ROULETTE_POWER: f64 = 3e-3;

/// What happens to a wave at a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// Mirrored.
    Specular,
    /// Straight through.
    Transmitted,
    /// Scattered.
    Scattered,
}

/// A photon on its way.
#[derive(Clone, Copy)]
struct Photon {
    origin: DVec3,
    direction: DVec3,
    field: Field,
    length_m: f64,
    interactions: usize,
    /// Mirrors so far.
    mirrors: usize,
    /// Whether it was scattered.
    scattered: bool,
    /// Whether the sources light what it meets next.
    covered: bool,
}

/// What all photons of a transmitter have in common.
pub struct Photons<'p, 't, 'a> {
    /// The sources, and the tables of the slabs.
    pub illumination: &'p Illumination<'t, 'a>,
    /// Where deposits go.
    pub patches: &'p Patches,
    /// How many are traced.
    pub count: usize,
    /// Key of the random numbers.
    pub seed: u64,
    /// Turns the lattice of departures.
    pub world_from_lattice: DMat3,
    /// The one chain to follow, up to and with its last scattering; otherwise all chains that the sources do not light.
    pub only: Option<&'p [Event]>,
}

impl Photons<'_, '_, '_> {
    /// Traces them all; `None` where no chain could leave anything.
    pub fn trace(&self, patch_m: f64) -> Option<RadianceCache> {
        let settings = &self.illumination.tracer.settings;
        if self.count == 0 || settings.max_depth < 2 {
            return None;
        }
        // A deposit is at least a second interaction.
        let mut cache = RadianceCache::new(self.illumination, self.patches, patch_m, settings.max_depth - 1);
        let tasks = self.count.div_ceil(PHOTONS_PER_TASK);
        for first in (0..tasks).step_by(TASKS_PER_ROUND) {
            let batches: Vec<Vec<Deposit>> = (first..(first + TASKS_PER_ROUND).min(tasks))
                .into_par_iter()
                .map(|task| {
                    let mut deposits = Vec::new();
                    let mut stack = Vec::new();
                    for i in task * PHOTONS_PER_TASK..((task + 1) * PHOTONS_PER_TASK).min(self.count) {
                        self.follow(i, &cache, &mut stack, &mut deposits);
                    }
                    deposits.sort_by_key(|d| d.slot);
                    deposits
                })
                .collect();
            cache.add(&batches);
        }
        cache.finish(4.0 * std::f64::consts::PI / self.count as f64);
        Some(cache)
    }

    /// Follows photon `i` and all it splits into.
    fn follow(&self, i: usize, cache: &RadianceCache, stack: &mut Vec<Photon>, deposits: &mut Vec<Deposit>) {
        let settings = &self.illumination.tracer.settings;
        let direction = self.world_from_lattice * lattice::fibonacci(i, self.count);
        // The ports of a transmitter share its power: every photon belongs to one of them.
        let field = Field::real(settings.tx_antenna.port_field(i % self.illumination.ports(), direction));
        let origin = self.illumination.tx;
        let mut rng = Rng::keyed(self.seed, STAGE, i as u64);
        stack.push(Photon {
            origin,
            direction,
            field,
            length_m: 0.0,
            interactions: 0,
            mirrors: 0,
            scattered: false,
            covered: true,
        });
        while let Some(photon) = stack.pop() {
            self.meet(&photon, cache, &mut rng, stack, deposits);
        }
    }

    /// One photon meets the next surface.
    fn meet(&self, photon: &Photon, cache: &RadianceCache, rng: &mut Rng, stack: &mut Vec<Photon>, deposits: &mut Vec<Deposit>) {
        let settings = &self.illumination.tracer.settings;
        let geometry = self.illumination.geometry();
        let (k, e) = (photon.direction, &photon.field);
        let Some((t, triangle)) = geometry.closest(photon.origin, k, CLEARANCE_M) else { return };
        let face = geometry.face_of_triangle(triangle);
        let plane = &geometry.faces[face as usize];
        let reached = photon.origin + k * t;
        let point = reached - plane.normal * plane.distance(reached);
        let side = usize::from(plane.normal.dot(k) > 0.0);
        let normal = if side == 0 { plane.normal } else { -plane.normal };
        let slab = geometry.slab(face);
        let table = self.illumination.table(face);
        let cos_incidence = field::cos_incidence(k, normal);
        let interactions = photon.interactions + 1;
        let length_m = photon.length_m + t;
        let s2 = slab.scattering.coefficient * slab.scattering.coefficient;
        let (co, cross) = ((1.0 - slab.scattering.xpd).sqrt(), slab.scattering.xpd.sqrt());
        let entry = table.scattering(cos_incidence);
        // K_x on the (θ̂, φ̂) components; ‖scattered‖² = S²Γ²‖E‖².
        let amplitude = (s2 * field::reflectivity(e, k, normal, f64::from(entry.te), f64::from(entry.tm))).sqrt();
        let (e_theta, e_phi) = (e.along(theta_hat(k)) * amplitude, e.along(phi_hat(k)) * amplitude);
        let (out_theta, out_phi) = (e_theta * co - e_phi * cross, e_theta * cross + e_phi * co);
        let wanted = self.only.map_or(!photon.covered, |chain| chain.len() == interactions);
        if wanted && s2 > 0.0 {
            let inverse = f64::from(entry.inverse_normalisation);
            let coherency = [
                out_theta.norm_squared(),
                out_phi.norm_squared(),
                out_theta.re * out_phi.re + out_theta.im * out_phi.im,
                out_theta.im * out_phi.re - out_theta.re * out_phi.im,
            ];
            deposits.push(Deposit {
                slot: cache.slot(self.patches.at(face, point), side),
                left: (settings.max_depth - interactions) as u32,
                coherency: coherency.map(|c| (c * inverse) as f32),
                normal: normal.as_vec3(),
                specular: field::mirrored(k, normal).as_vec3(),
                back: (-k).as_vec3(),
                length_m: length_m as f32,
                scattered: photon.scattered,
            });
        }
        // Whatever comes next has to be scattered once more.
        if interactions + 1 > settings.max_depth {
            return;
        }
        let uniform = [rng.uniform_f64(), rng.uniform_f64(), rng.uniform_f64()];
        let next = match self.only.map(|chain| chain[interactions - 1..].split_first()) {
            None => None,
            Some(Some((event, [_, ..]))) => Some(*event),
            Some(_) => return,
        };
        let goes = |event: Event| next.is_none_or(|n| n == event);
        let mut go_on = |direction: DVec3, field: Field, mirrors: usize, scattered: bool, covered: bool| {
            let power = field.norm_squared();
            let kept = (power / ROULETTE_POWER).min(1.0);
            if kept < 1.0 && rng.uniform_f64() >= kept {
                return;
            }
            let field = if kept < 1.0 { field.scaled(1.0 / kept.sqrt()) } else { field };
            stack.push(Photon { origin: point, direction, field, length_m, interactions, mirrors, scattered, covered });
        };
        if settings.reflection && goes(Event::Specular) {
            let covered = photon.covered && photon.mirrors == 0 && self.illumination.is_mirror(face);
            let reflected = field::reflect(e, k, normal, &table.response(cos_incidence), slab.specular_amplitude());
            go_on(field::mirrored(k, normal), reflected, photon.mirrors + 1, photon.scattered, covered);
        }
        if settings.transmission && goes(Event::Transmitted) {
            let through = field::transmit(e, k, normal, &table.response(cos_incidence));
            go_on(k, through, photon.mirrors, photon.scattered, photon.covered);
        }
        if s2 > 0.0
            && goes(Event::Scattered)
            && let Some((direction, weight)) = scattering::sample(slab.scattering.pattern, k, normal, uniform)
        {
            let scale = (weight * f64::from(entry.inverse_normalisation)).sqrt();
            let (theta, phi) = (theta_hat(direction), phi_hat(direction));
            go_on(direction, Field::of_components(out_theta * scale, theta, out_phi * scale, phi), 0, true, false);
        }
    }
}
