//! Photons from the transmitter: every chain of mirrors, slabs and scattering surfaces, kept where they arrive.
//!
//! A photon carries its polarised field; its power is ‖E‖² in units of 1/N of the transmitter's sphere. Where it meets a surface it leaves
//! what is scattered there in the cache and goes on mirrored, straight through, and scattered into one drawn direction, weak ones by
//! Russian roulette. What the sources of [`Illumination`] light already is not left again. Photons come in two kinds: light that was never
//! scattered wants other departures, and other numbers, than light that was.

use super::cache::{Deposit, RadianceCache};
use super::emission::Emission;
use super::illumination::{CLEARANCE_M, Illumination};
use super::patches::Patches;
use crate::radio::field::antenna::{phi_hat, theta_hat};
use crate::radio::field::scattering;
use crate::radio::field::{self, ElectricField};
use crate::radio::geometry::SurfaceHit;
use corf_scene::Rng;
use glam::{DMat3, DVec3};

/// Photons a task traces.
pub const PHOTONS_PER_TASK: usize = 2048;
/// Photons of less power take part in roulette.
const ROULETTE_POWER: f64 = 3e-3;

/// The kind of interaction of a photon with a surface.
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
    field: ElectricField,
    length_m: f64,
    interactions: usize,
    /// Mirrors so far.
    mirrors: usize,
    /// Whether it was scattered.
    scattered: bool,
    /// Whether the sources light what it meets next.
    covered: bool,
}

/// The part of the indirect light that photons carry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhotonKind {
    /// Light that only mirrors and slabs passed on.
    Unscattered,
    /// Light that was scattered before.
    Scattered,
    /// Both.
    All,
}

/// One pass of photon tracing.
pub struct PhotonPass {
    /// Part of the light that the photons carry.
    pub kind: PhotonKind,
    /// Directions in which they leave the transmitter.
    pub emission: Emission,
    /// Stage of their random numbers.
    pub stage: u64,
}

/// Deposits of the photons traced so far.
#[derive(Default)]
pub struct Trail {
    stack: Vec<Photon>,
    /// Deposits in the order of the photons.
    pub deposits: Vec<Deposit>,
}

/// Photon tracer of a transmitter: all that its photons share.
pub struct Photons<'p, 't, 'a> {
    /// The sources, and the tables of the slabs.
    pub illumination: &'p Illumination<'t, 'a>,
    /// Patches on which deposits fall.
    pub patches: &'p Patches,
    /// Number of photons.
    pub count: usize,
    /// Key of the random numbers.
    pub seed: u64,
    /// Rotation of the lattice of uniform departures.
    pub world_from_lattice: DMat3,
    /// The one chain to follow, up to and with its last scattering; otherwise all chains that the sources do not light.
    pub only: Option<&'p [Event]>,
}

impl Photons<'_, '_, '_> {
    /// Follows photon `i` and all it splits into.
    pub fn follow(&self, i: usize, pass: &PhotonPass, cache: &RadianceCache, trail: &mut Trail) {
        let settings = &self.illumination.tracer.settings;
        let mut rng = Rng::keyed(self.seed, pass.stage, i as u64);
        let (direction, solid_angle_sr) = pass.emission.photon(i);
        // The ports of a transmitter share its power: every photon belongs to one of them.
        let ports = self.illumination.ports();
        let port = if matches!(pass.emission, Emission::Even { .. }) { i % ports } else { rng.below(ports) };
        let share = solid_angle_sr * self.count as f64 / (4.0 * std::f64::consts::PI);
        let field = ElectricField::real(settings.tx_antenna.port_field(port, direction)).scaled(share.sqrt());
        let origin = self.illumination.tx;
        trail.stack.push(Photon {
            origin,
            direction,
            field,
            length_m: 0.0,
            interactions: 0,
            mirrors: 0,
            scattered: false,
            covered: true,
        });
        while let Some(photon) = trail.stack.pop() {
            self.meet(&photon, pass, cache, &mut rng, trail);
        }
    }

    /// One photon meets the next surface.
    fn meet(&self, photon: &Photon, pass: &PhotonPass, cache: &RadianceCache, rng: &mut Rng, trail: &mut Trail) {
        let settings = &self.illumination.tracer.settings;
        let geometry = self.illumination.geometry();
        let (k, e) = (photon.direction, &photon.field);
        let Some(SurfaceHit { face, distance_m, point, normal, side }) = geometry.intersect(photon.origin, k, CLEARANCE_M) else {
            return;
        };
        let slab = geometry.slab(face);
        let table = self.illumination.table(face);
        let cos_incidence = field::cos_incidence(k, normal);
        let interactions = photon.interactions + 1;
        let length_m = photon.length_m + distance_m;
        let s2 = slab.scattering.coefficient * slab.scattering.coefficient;
        let (co, cross) = ((1.0 - slab.scattering.xpd).sqrt(), slab.scattering.xpd.sqrt());
        let entry = table.scattering(cos_incidence);
        // K_x on the (θ̂, φ̂) components; ‖scattered‖² = S²Γ²‖E‖².
        let amplitude = (s2 * field::reflectivity(e, k, normal, f64::from(entry.te), f64::from(entry.tm))).sqrt();
        let (e_theta, e_phi) = (e.along(theta_hat(k)) * amplitude, e.along(phi_hat(k)) * amplitude);
        let (out_theta, out_phi) = (e_theta * co - e_phi * cross, e_theta * cross + e_phi * co);
        let wanted = self.only.map_or(!photon.covered, |chain| chain.len() == interactions)
            && (pass.kind == PhotonKind::All || photon.scattered == (pass.kind == PhotonKind::Scattered));
        if wanted && s2 > 0.0 {
            let (slot, subcell) = cache.slots().place(self.patches.at(face, point), side);
            let inverse = f64::from(entry.inverse_normalisation);
            let coherency = [
                out_theta.norm_squared(),
                out_phi.norm_squared(),
                out_theta.re * out_phi.re + out_theta.im * out_phi.im,
                out_theta.im * out_phi.re - out_theta.re * out_phi.im,
            ];
            trail.deposits.push(Deposit {
                slot,
                subcell,
                left: (settings.max_interactions - interactions) as u32,
                coherency: coherency.map(|c| (c * inverse) as f32),
                normal: normal.as_vec3(),
                specular: field::mirrored(k, normal).as_vec3(),
                back: (-k).as_vec3(),
                length_m: length_m as f32,
                scattered: photon.scattered,
            });
        }
        // Whatever comes next has to be scattered once more.
        if interactions + 1 > settings.max_interactions {
            return;
        }
        let next = match self.only.map(|chain| chain[interactions - 1..].split_first()) {
            None => None,
            Some(Some((event, [_, ..]))) => Some(*event),
            Some(_) => return,
        };
        let goes = |event: Event| next.is_none_or(|n| n == event);
        let drawn = if s2 > 0.0 && goes(Event::Scattered) && pass.kind != PhotonKind::Unscattered {
            let uniform = [rng.uniform_f64(), rng.uniform_f64(), rng.uniform_f64()];
            scattering::sample(slab.scattering.pattern, k, normal, uniform)
        } else {
            None
        };
        let mut go_on = |direction: DVec3, field: ElectricField, mirrors: usize, scattered: bool, covered: bool| {
            let kept = (field.norm_squared() / ROULETTE_POWER).min(1.0);
            if kept < 1.0 && rng.uniform_f64() >= kept {
                return;
            }
            let field = if kept < 1.0 { field.scaled(1.0 / kept.sqrt()) } else { field };
            trail.stack.push(Photon { origin: point, direction, field, length_m, interactions, mirrors, scattered, covered });
        };
        if settings.reflection && goes(Event::Specular) {
            let covered = photon.covered && photon.mirrors == 0 && self.illumination.is_mirror(face);
            let reflected = field::reflect(e, k, normal, &table.response(cos_incidence), slab.specular_amplitude());
            let direction = field::mirrored(k, normal);
            go_on(direction, reflected, photon.mirrors + 1, photon.scattered, covered);
        }
        if settings.transmission && goes(Event::Transmitted) {
            let through = field::transmit(e, k, normal, &table.response(cos_incidence));
            go_on(k, through, photon.mirrors, photon.scattered, photon.covered);
        }
        if let Some((direction, weight)) = drawn {
            let scale = (weight * f64::from(entry.inverse_normalisation)).sqrt();
            let (theta, phi) = (theta_hat(direction), phi_hat(direction));
            go_on(direction, ElectricField::of_components(out_theta * scale, theta, out_phi * scale, phi), 0, true, false);
        }
    }
}
