//! The diffuse field: one scattering bounce, with a mirror or slabs before it and one more behind it.
//!
//! The power that a surface element sends to the receiver is (λ/4π)² S²Γ² f_s cosθ_i dA / (r₁² r₂²). What lights the surface, shadows
//! and mirror images included, is found once per transmitter on world-fixed patches, when a receiver first sees them. At a receiver the integral runs over solid angle,
//! dA = r₂² dΩ / cosθ_s, on a lattice of directions: near surfaces are resolved as finely as far ones, every direction sees exactly what
//! is visible along it, and nothing is random. A point of a patch that a shadow's edge crosses asks for its own shadow rays.

mod illumination;
mod patches;

use super::antenna::{phi_hat, theta_hat};
use super::field::{self, Field};
use super::scattering;
use super::{Arrival, MAX_DEPTH, RadioTracer, SPEED_OF_LIGHT, lattice};
use corf_scene::{Error, Pinhole, Result, Rigid3, Rng};
use glam::{DMat3, DVec2, DVec3};
use illumination::{Illumination, Incident};
use patches::Patches;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Clearance of a gathering ray from the face it leaves, metres.
const CLEARANCE_M: f64 = 5e-5;
/// Surfaces are not seen at angles flatter than this: cosθ_s, 0.6°. dΩ/cosθ_s has an integrable pole there that no lattice samples well.
const MIN_COS_SCATTER: f64 = 0.01;
/// A continued ray that keeps less than this share of power is dropped (−30 dB).
const MIN_THROUGHPUT: f64 = 1e-3;
/// How much sparser [`DiffuseField::gather_for_view`] samples what is out of view.
pub const OUTSIDE_SPARSITY: usize = 16;
/// Margin of a view, degrees: beyond it a 1° lobe has fallen by 80 dB.
const VIEW_MARGIN_DEG: f64 = 6.1;
/// Directions a task gathers.
const DIRECTIONS_PER_TASK: usize = 1024;

/// How the diffuse field is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DiffuseSettings {
    /// Side of the world-fixed patches on which lighting is found, metres. Smaller objects than a quarter of it may lose their shadow.
    pub patch_size_m: f64,
    /// Directions over the whole sphere in which a receiver gathers; 120 000 are 0.59° apart.
    pub directions: usize,
    /// Interactions after the scattering (a mirror or a slab between the surface and the receiver): 0 or 1.
    pub after: usize,
    /// Faces that fill less of the transmitter's view than this do not mirror it onto surfaces, steradians.
    pub min_mirror_sr: f64,
    /// Shifts the patches and turns the lattice; results of different phases differ by the sampling error alone.
    pub phase: u64,
}

impl Default for DiffuseSettings {
    fn default() -> Self {
        Self { patch_size_m: 0.25, directions: 120_000, after: 1, min_mirror_sr: 0.03, phase: 0 }
    }
}

impl DiffuseSettings {
    /// Checks ranges.
    ///
    /// # Errors
    /// The first setting out of range, by name.
    pub fn validate(&self) -> Result<()> {
        let fault = |key: &str, what: String, help: &str| Err(Error::invalid(format!("diffuse settings, `{key}`"), what, help));
        if !(self.patch_size_m.is_finite() && self.patch_size_m >= 0.01) {
            return fault("patch_size_m", format!("{}", self.patch_size_m), "give at least 0.01 m; 0.25 suits a lobby");
        }
        if !(100..=50_000_000).contains(&self.directions) {
            return fault("directions", format!("{}", self.directions), "give 100 to 50 000 000; 120 000 suits a 1 degree lobe");
        }
        if self.after > 1 {
            return fault("after", format!("{}", self.after), "0 or 1");
        }
        if !(self.min_mirror_sr.is_finite() && self.min_mirror_sr >= 0.0) {
            return fault("min_mirror_sr", format!("{}", self.min_mirror_sr), "give a solid angle of at least 0");
        }
        Ok(())
    }
}

/// A share of the diffuse power, by how it came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contribution {
    /// |a|², linear, relative to 1 W transmitted.
    pub power: f64,
    /// Delay, seconds.
    pub delay_s: f64,
    /// The scene object that scattered it.
    pub object: u32,
    /// Whether a mirror stands between the transmitter and the scattering surface.
    pub mirrored_before: bool,
    /// Interactions between the scattering surface and the receiver.
    pub after: usize,
}

/// A transmitter's diffuse field.
pub struct DiffuseField<'t, 'a> {
    tracer: &'t RadioTracer<'a>,
    illumination: Illumination<'t, 'a>,
    patches: Patches,
    settings: DiffuseSettings,
    world_from_lattice: DMat3,
}

/// A mirror or slab on the way from the receiver to a scattering surface.
#[derive(Clone, Copy)]
struct Hop {
    face: u32,
    mirrored: bool,
    /// Unit direction of the gathering ray beyond it.
    beyond: DVec3,
}

impl<'t, 'a> DiffuseField<'t, 'a> {
    /// Finds the transmitter's mirrors and lays out the patches. What lights a patch is found when the first receiver sees it, so that
    /// the first of many [`DiffuseField::gather`]s cost the most.
    ///
    /// # Errors
    /// A position that is not finite, or settings out of range.
    pub fn new(tracer: &'t RadioTracer<'a>, tx: DVec3, settings: &DiffuseSettings) -> Result<Self> {
        settings.validate()?;
        if !tx.is_finite() {
            return Err(Error::invalid("transmitter", format!("position is {tx}"), "give three finite coordinates in metres"));
        }
        let mut rng = Rng::keyed(settings.phase, 0x0d1f_f05e, 0);
        let (phase, world_from_lattice) = if settings.phase == 0 {
            (DVec2::ZERO, DMat3::IDENTITY)
        } else {
            let axis = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize_or(DVec3::Z);
            let turn = DMat3::from_axis_angle(axis, std::f64::consts::TAU * rng.uniform_f64());
            (DVec2::new(rng.uniform_f64(), rng.uniform_f64()), turn)
        };
        let illumination = Illumination::new(tracer, tx, settings.min_mirror_sr);
        let patches = Patches::new(&tracer.geometry, settings.patch_size_m, phase);
        Ok(Self { tracer, illumination, patches, settings: *settings, world_from_lattice })
    }

    /// Number of surface patches.
    pub fn patch_count(&self) -> usize {
        self.patches.len()
    }

    /// Number of sources: the transmitter and the mirrors that show it.
    pub fn source_count(&self) -> usize {
        self.illumination.sources.len()
    }

    /// The diffuse arrivals at a receiver, one per direction that receives anything, in the order of the lattice; delays are means
    /// weighted by power, objects those that the receiver sees.
    ///
    /// # Errors
    /// A position that is not finite.
    pub fn gather(&self, rx: DVec3) -> Result<Vec<Arrival>> {
        check_receiver(rx)?;
        Ok(self.arrivals(rx, self.settings.directions, |_| true))
    }

    /// As [`DiffuseField::gather`] for one view: all directions inside the camera's frame and a margin around it, and outside of it a
    /// lattice [`OUTSIDE_SPARSITY`] times sparser, which keeps the total power and what side lobes see of it.
    ///
    /// # Errors
    /// A position that is not finite.
    pub fn gather_for_view(&self, camera: &Pinhole, world_from_camera: &Rigid3) -> Result<Vec<Arrival>> {
        let rx = world_from_camera.translation;
        check_receiver(rx)?;
        let camera_from_world = world_from_camera.rotation.transpose();
        let margin = VIEW_MARGIN_DEG.to_radians();
        let inside = |direction: DVec3| {
            let d = camera_from_world * direction;
            let (across, down) = (d.x.atan2(d.z), d.y.atan2(d.x.hypot(d.z)));
            let left = (-camera.cx / camera.fx).atan() - margin;
            let right = ((camera.width as f64 - camera.cx) / camera.fx).atan() + margin;
            // Rows are highest above the optical axis, where their elevation is that of the frame's edge.
            let top = (-camera.cy / camera.fy).atan() - margin;
            let bottom = ((camera.height as f64 - camera.cy) / camera.fy).atan() + margin;
            (left..right).contains(&across) && (top..bottom).contains(&down)
        };
        let mut arrivals = self.arrivals(rx, self.settings.directions, inside);
        arrivals.extend(self.arrivals(rx, self.settings.directions.div_ceil(OUTSIDE_SPARSITY), |d| !inside(d)));
        Ok(arrivals)
    }

    /// The arrivals of those of `count` lattice directions that are `wanted`.
    fn arrivals(&self, rx: DVec3, count: usize, wanted: impl Fn(DVec3) -> bool + Sync) -> Vec<Arrival> {
        let per_task: Vec<Vec<Arrival>> = (0..count.div_ceil(DIRECTIONS_PER_TASK))
            .into_par_iter()
            .map(|task| {
                let mut arrivals = Vec::new();
                for i in task * DIRECTIONS_PER_TASK..((task + 1) * DIRECTIONS_PER_TASK).min(count) {
                    let direction = self.direction(i, count);
                    if !wanted(direction) {
                        continue;
                    }
                    let (mut power, mut weighted_delay) = (0.0, 0.0);
                    let seen = self.look(rx, direction, count, &mut |c| {
                        power += c.power;
                        weighted_delay += c.power * c.delay_s;
                    });
                    if let Some(object) = seen.filter(|_| power > 0.0) {
                        arrivals.push(Arrival { direction, power, delay_s: weighted_delay / power, object, phase_rad: None });
                    }
                }
                arrivals
            })
            .collect();
        per_task.into_iter().flatten().collect()
    }

    /// Every contribution on its own with the direction it arrives from, in the order of the lattice: for studies and checks.
    ///
    /// # Errors
    /// A position that is not finite.
    pub fn contributions(&self, rx: DVec3) -> Result<Vec<(DVec3, Contribution)>> {
        check_receiver(rx)?;
        let count = self.settings.directions;
        let per_task: Vec<Vec<(DVec3, Contribution)>> = (0..count.div_ceil(DIRECTIONS_PER_TASK))
            .into_par_iter()
            .map(|task| {
                let mut found = Vec::new();
                for i in task * DIRECTIONS_PER_TASK..((task + 1) * DIRECTIONS_PER_TASK).min(count) {
                    let direction = self.direction(i, count);
                    self.look(rx, direction, count, &mut |c| found.push((direction, c)));
                }
                found
            })
            .collect();
        Ok(per_task.into_iter().flatten().collect())
    }

    fn direction(&self, i: usize, count: usize) -> DVec3 {
        self.world_from_lattice * lattice::fibonacci(i, count)
    }

    /// Follows one of `count` directions from the receiver and reports what is scattered back along it; returns the object seen.
    fn look(&self, rx: DVec3, direction: DVec3, count: usize, report: &mut impl FnMut(Contribution)) -> Option<u32> {
        let geometry = &self.tracer.geometry;
        let solid_angle_sr = 4.0 * std::f64::consts::PI / count as f64;
        let deepest = self.settings.after.min(self.tracer.settings.max_depth.saturating_sub(1)).min(MAX_DEPTH);
        let hit = |origin: DVec3, direction: DVec3| -> Option<(u32, DVec3, f64)> {
            let (t, triangle) = geometry.closest(origin, direction, CLEARANCE_M)?;
            let face = geometry.face_of_triangle(triangle);
            let point = origin + direction * t;
            // Exactly onto the plane, off which single precision left it.
            let plane = &geometry.faces[face as usize];
            Some((face, point - plane.normal * plane.distance(point), t))
        };
        let (face, point, t) = hit(rx, direction)?;
        self.scattered(direction, solid_angle_sr, &[], direction, face, point, t, report);
        if deepest >= 1 {
            let plane = &geometry.faces[face as usize];
            let response = self.illumination.table(face).response(field::cos_incidence(direction, plane.normal));
            let mirror =
                geometry.slab(face).specular_amplitude().powi(2) * response.r_te.norm_squared().max(response.r_tm.norm_squared());
            let slab = response.t_te.norm_squared().max(response.t_tm.norm_squared());
            for (on, mirrored, kept) in
                [(self.tracer.settings.reflection, true, mirror), (self.tracer.settings.transmission, false, slab)]
            {
                if !on || kept < MIN_THROUGHPUT {
                    continue;
                }
                let beyond = if mirrored { field::mirrored(direction, plane.normal) } else { direction };
                if let Some((next_face, next_point, next_t)) = hit(point, beyond) {
                    let hops = [Hop { face, mirrored, beyond }];
                    self.scattered(direction, solid_angle_sr, &hops, beyond, next_face, next_point, t + next_t, report);
                }
            }
        }
        Some(geometry.faces[face as usize].object)
    }

    /// What a surface point scatters towards the receiver: `direction` leaves the receiver, `last` arrives at the point.
    fn scattered(
        &self,
        direction: DVec3,
        solid_angle_sr: f64,
        hops: &[Hop],
        last: DVec3,
        face: u32,
        point: DVec3,
        distance_m: f64,
        report: &mut impl FnMut(Contribution),
    ) {
        let geometry = &self.tracer.geometry;
        let slab = geometry.slab(face);
        let s = slab.scattering.coefficient;
        if s == 0.0 {
            return;
        }
        let sources = self.patches.sources_at(&self.illumination, face, point);
        if sources.is_empty() {
            return;
        }
        let plane = &geometry.faces[face as usize];
        let towards_rx = -last;
        // The normal on the receiver's side.
        let normal = if plane.normal.dot(towards_rx) >= 0.0 { plane.normal } else { -plane.normal };
        let cos_scatter = normal.dot(towards_rx);
        let (theta_out, phi_out) = (theta_hat(towards_rx), phi_hat(towards_rx));
        // What the receiver makes of a unit field along θ̂ and along φ̂ that leaves the point.
        let received = |axis: DVec3| {
            let mut e = Field::real(axis);
            for hop in hops.iter().rev() {
                e = if hop.mirrored {
                    self.illumination.bounce_field(&e, hop.face, -hop.beyond)
                } else {
                    self.illumination.pass(&e, hop.face, -hop.beyond)
                };
            }
            e.along(self.tracer.settings.rx_antenna.field(direction))
        };
        let (from_theta, from_phi) = (received(theta_out), received(phi_out));
        let wavelength_m = self.tracer.settings.wavelength_m();
        let scale =
            (wavelength_m / (4.0 * std::f64::consts::PI)).powi(2) * s * s * solid_angle_sr / cos_scatter.max(MIN_COS_SCATTER);
        let (co, cross) = ((1.0 - slab.scattering.xpd).sqrt(), slab.scattering.xpd.sqrt());
        let table = self.illumination.table(face);
        for patch_source in sources {
            let source = self.illumination.sources[patch_source.source as usize];
            // Sources behind the face light its other side.
            if (source.image - point).dot(normal) <= 0.0 {
                continue;
            }
            let lighting = patch_source.lighting.unwrap_or_else(|| self.illumination.lighting(source, point, face));
            let Some(incident) = self.illumination.incident(source, lighting, point, face, hops.len()) else { continue };
            let Incident { direction: k, field: e, distance_m: source_m } = incident;
            let cos_incidence = field::cos_incidence(k, normal);
            let gamma2 = field::reflectivity(&e, k, normal, &table.response(cos_incidence));
            let cos_specular = towards_rx.dot(field::mirrored(k, normal));
            let lobe = scattering::lobe(slab.scattering.pattern, table.normalisation(cos_incidence), cos_scatter, cos_specular);
            // K_x: [[√(1−K), −√K], [√K, √(1−K)]] on the (θ̂, φ̂) components.
            let (e_theta, e_phi) = (e.along(theta_hat(k)), e.along(phi_hat(k)));
            let (out_theta, out_phi) = (e_theta * co - e_phi * cross, e_theta * cross + e_phi * co);
            let polarisation = (from_theta * out_theta + from_phi * out_phi).norm_squared();
            let power = scale * gamma2 * lobe * cos_incidence * polarisation / (source_m * source_m);
            if power > 0.0 {
                report(Contribution {
                    power,
                    delay_s: (source_m + distance_m) / SPEED_OF_LIGHT,
                    object: plane.object,
                    mirrored_before: source.mirror.is_some(),
                    after: hops.len(),
                });
            }
        }
    }
}

fn check_receiver(rx: DVec3) -> Result<()> {
    if rx.is_finite() {
        return Ok(());
    }
    Err(Error::invalid("receiver", format!("position is {rx}"), "give three finite coordinates in metres"))
}
