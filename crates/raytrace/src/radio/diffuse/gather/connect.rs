//! Contributions of the transmitter's ray hits to a receiver, straight and in mirrors: one of the two techniques of the multiple importance
//! sampling in [`super::light_hits`].

use super::image_receivers::{ImageReceiver, MirrorSequence, VirtualReceiver};
use super::light_hit_tree::LightHit;
use super::mis::{density, mis_weight};
use super::ray::{CLEARANCE_M, GatherTracer, Ray, RussianRoulette};
use crate::radio::diffuse::Contribution;
use crate::radio::diffuse::light::illumination::{IlluminationSource, Lighting};
use crate::radio::geometry::SurfaceHit;
use crate::radio::{SPEED_OF_LIGHT, field};
use glam::DVec3;

/// A ray that should meet a point meets it this closely, metres: single precision, and surfaces seen edge-on.
const SAME_POINT_M: f64 = 2e-3;

/// Scattering of a source's field by a surface point straight to the receiver.
pub(in crate::radio::diffuse) struct Sent {
    towards_rx: DVec3,
    /// S²Γ² f_s, as the receiver's ports take it.
    share: f64,
    cos_incidence: f64,
    /// Distance from the source, metres.
    source_m: f64,
    /// Distance to the receiver, metres.
    distance_m: f64,
}

impl Sent {
    /// |a|² of a square metre that is like this point: (λ/4π)² S²Γ² f_s cosθ_i / (r₁² r₂²).
    pub fn per_m2(&self, wavelength_m: f64) -> f64 {
        let spreading = wavelength_m / (4.0 * std::f64::consts::PI * self.source_m * self.distance_m);
        spreading * spreading * self.share * self.cos_incidence
    }
}

impl GatherTracer<'_, '_, '_> {
    /// Contribution of a hit of the transmitter's rays that the receiver sees straight, times its weight in multiple importance sampling,
    /// with the direction of arrival; `None` where that is not `wanted`, nothing is received, or the weight is zero.
    pub fn landed(&self, hit: &LightHit, wanted: impl Fn(DVec3) -> bool) -> Option<(DVec3, Contribution)> {
        let &LightHit { point, face, lighting, density_per_m2 } = hit;
        let share = mis_weight(self.density_ratio(&self.straight(), face, point, density_per_m2));
        if share == 0.0 {
            return None;
        }
        let Sent { towards_rx, share: sent, source_m, distance_m, .. } =
            self.sent(self.transmitter(), point, face, lighting, wanted)?;
        let power = self.spread(self.lattice.sampling.count) * share * sent / (distance_m * distance_m);
        let contribution = self.once_scattered(power, source_m + distance_m, face, 0);
        (power > 0.0).then_some((-towards_rx, contribution))
    }

    /// Scattering by a point that a source lights straight to the receiver; `None` where that is not in a `wanted` direction or something
    /// blocks it.
    pub fn sent(
        &self,
        source: IlluminationSource,
        point: DVec3,
        face: u32,
        lighting: Lighting,
        wanted: impl Fn(DVec3) -> bool,
    ) -> Option<Sent> {
        let (geometry, illumination) = (&self.field.tracer.geometry, &self.field.illumination);
        let distance_m = point.distance(self.rx);
        let towards_rx = (self.rx - point) / distance_m;
        if !wanted(-towards_rx) || geometry.occluded(point, self.rx, CLEARANCE_M, |f| f != face) {
            return None;
        }
        let plane = &geometry.faces[face as usize];
        let normal = if plane.distance(self.rx) > 0.0 { plane.normal } else { -plane.normal };
        let incident = illumination.incident(source, lighting, point, face, 0)?;
        let received = self.received(&self.port_fields(-towards_rx), towards_rx);
        Some(Sent {
            towards_rx,
            share: self.reemitted(&incident, face, normal, towards_rx, &received[..self.ports()]),
            cos_incidence: field::cos_incidence(incident.direction, normal),
            source_m: incident.distance_m,
            distance_m,
        })
    }

    /// Contribution of the `index`th hit of the transmitter's rays in one view of the receiver, straight or by way of mirrors, times its
    /// weight in multiple importance sampling; with the direction of arrival and the object seen first there. Hits that can bring less
    /// power than `faint` take part in Russian roulette.
    pub fn landed_by(
        &self,
        view: &ImageReceiver,
        index: usize,
        hit: &LightHit,
        faint: f64,
        wanted: impl Fn(DVec3) -> bool,
    ) -> Option<(DVec3, u32, Contribution)> {
        let &LightHit { point, face, lighting, density_per_m2 } = hit;
        let geometry = &self.field.tracer.geometry;
        if !wanted(view.towards(geometry, point)) || (view.way == MirrorSequence::STRAIGHT && self.lattice.is_small(face)) {
            return None;
        }
        let share = mis_weight(self.density_ratio(&view.vantage, face, point, density_per_m2));
        if share == 0.0 {
            return None;
        }
        let share = share * self.spread(self.lattice.sampling.count);
        let most = share * self.most_sent(view, hit);
        let kept = if most < faint { most / faint } else { 1.0 };
        let mut luck = self.luck(1.0, index);
        if !luck.allows(kept) {
            return None;
        }
        let direction = view.direction(geometry, self.rx, point)?;
        let ray = Ray { weight: 1.0 / kept, ..self.outwards(direction) };
        let there = |met: &SurfaceHit| met.face == face && met.point.distance_squared(point) < SAME_POINT_M * SAME_POINT_M;
        let (ray, met, object) =
            self.walk(ray, view.way.mirrors(), &mut RussianRoulette { whole: ray.power(), ..luck }, there)?;
        let incident = self.field.illumination.incident(self.transmitter(), lighting, point, face, ray.hops)?;
        let towards_rx = -ray.direction;
        let received = self.received(&ray.ports, towards_rx);
        let sent = self.reemitted(&incident, face, met.normal, towards_rx, &received[..self.ports()]);
        let distance_m = ray.length_m + met.distance_m;
        let power = share * ray.weight * sent / (distance_m * distance_m);
        let contribution = self.once_scattered(power, incident.distance_m + distance_m, face, ray.hops);
        (power > 0.0).then_some((direction, object, contribution))
    }

    /// S² f_s / r₂² of a point that the transmitter lights, 1/m²: what it would send by way of a view if nothing on the way took any of it.
    fn most_sent(&self, view: &ImageReceiver, hit: &LightHit) -> f64 {
        let plane = &self.field.tracer.geometry.faces[hit.face as usize];
        let to_image = view.vantage.image - hit.point;
        let normal = if plane.distance(view.vantage.image) > 0.0 { plane.normal } else { -plane.normal };
        let incidence = (hit.point - self.field.illumination.tx).normalize_or_zero();
        let distance2 = to_image.length_squared();
        self.lobe(hit.face, normal, incidence, to_image / distance2.sqrt()) / distance2
    }

    /// A contribution of light that the transmitter sent straight to a face, scattered there.
    fn once_scattered(&self, power: f64, length_m: f64, face: u32, after: usize) -> Contribution {
        Contribution {
            power,
            delay_s: length_m / SPEED_OF_LIGHT,
            object: self.field.tracer.geometry.faces[face as usize].object,
            mirrored_before: false,
            indirect: false,
            after,
        }
    }

    /// [`VirtualReceiver::density_ratio`] at a point.
    pub fn density_ratio(&self, vantage: &VirtualReceiver, face: u32, point: DVec3, transmitters_per_m2: f64) -> f64 {
        let plane = &self.field.tracer.geometry.faces[face as usize];
        let own_per_m2 = density(plane, vantage.image, point);
        vantage.density_ratio(self.lattice.sampling, plane.area_m2, own_per_m2, transmitters_per_m2)
    }

    /// Viewpoint of a ray whose hits are shared with the transmitter's own rays (multiple importance sampling); `None` where they are not.
    /// Without views, only straight rays that crossed no slab are shared.
    pub(super) fn shared(&self, ray: &Ray) -> Option<VirtualReceiver> {
        if !self.lattice.shared || self.field.light_hits.is_none() {
            return None;
        }
        match self.lattice.views {
            Some(views) => views.by(&ray.way).map(|view| view.vantage),
            None => (ray.hops == 0).then(|| self.straight()),
        }
    }

    /// The viewpoint of the receiver itself.
    fn straight(&self) -> VirtualReceiver {
        VirtualReceiver { image: self.rx, directions: f64::INFINITY }
    }

    fn transmitter(&self) -> IlluminationSource {
        IlluminationSource::transmitter(self.field.illumination.tx)
    }

    /// Reports every way that a ray along a direction goes on mirrored, as long as it keeps so much of its power.
    pub fn mirrors_along(&self, direction: DVec3, kept: f64, mut report: impl FnMut(MirrorSequence)) {
        let mut ray = self.outwards(direction);
        let mut luck = self.luck(ray.power(), 0);
        while ray.hops < self.deepest.min(MirrorSequence::MOST) {
            let Some(met) = self.field.tracer.geometry.intersect(ray.origin, ray.direction, CLEARANCE_M) else { return };
            let Some(behind) = self.behind(&ray, &met, &self.response(&ray, &met), true, &mut luck) else { return };
            if behind.power() < kept * luck.whole {
                return;
            }
            report(behind.way);
            ray = behind;
        }
    }
}
