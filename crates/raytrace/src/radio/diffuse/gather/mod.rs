//! Final gathering: rays from the receiver along every direction of its lattice, mirrored and straight through slabs, to surfaces that
//! scatter.
//!
//! A ray carries what the receiver's ports make of a field that comes in along it: the antenna's own field vector taken backwards
//! through every mirror and slab, which by reciprocity is the forward way's transpose. What a surface scatters along the ray is then
//! received as |c·E|².

mod light_hits;

#[cfg(doc)]
use super::DiffuseSettings;
use super::illumination::{Incident, MAX_PORTS};
use super::image_receivers::{ImageReceivers, MirrorSequence};
use super::mis::{density, mis_weight};
use super::sampling::Sampling;
use super::small::{Seen, SmallPoint};
use super::{Contribution, DiffuseField};
use crate::radio::antenna::{Antenna, phi_hat, theta_hat};
use crate::radio::field::{self, Field};
use crate::radio::fresnel::SlabResponse;
use crate::radio::geometry::SurfaceHit;
use crate::radio::{Complex, MAX_DEPTH, SPEED_OF_LIGHT, lattice, scattering};
use glam::DVec3;

/// Clearance of a gathering ray from the face it leaves, metres.
const CLEARANCE_M: f64 = 5e-5;
/// Surfaces are not seen at angles flatter than this: cosθ_s, 0.6°. dΩ/cosθ_s has an integrable pole there that no lattice samples well. Not
/// so where the transmitter's own rays fall more densely: their share takes the pole away.
const MIN_COS_SCATTER: f64 = 0.01;
/// A ray that keeps less than this share of power (−60 dB) ends.
const MIN_THROUGHPUT: f64 = 1e-6;
/// Threshold of Russian roulette: a ray that keeps less than this share of power goes on with that much less probability, and counts for
/// more.
const ROULETTE_THROUGHPUT: f64 = 0.01;
/// Threshold of Russian roulette with [`DiffuseSettings::even_arrivals`], whose readers average over many arrivals.
const EVEN_ROULETTE_THROUGHPUT: f64 = 0.02;
/// Threshold of Russian roulette before the scattering of a surface is evaluated, with [`DiffuseSettings::even_arrivals`]: a ray that keeps
/// less than this share of power evaluates with that much less probability, for tracing is the lesser part of the cost.
const EVEN_LOOK_THROUGHPUT: f64 = 0.1;
/// Cosine of the scattering angle, cosθ_s, below which that probability rises by 1/cosθ_s: otherwise the 1/cosθ_s of the integrand and that
/// of the probability together would make heavy arrivals.
const EVEN_LOOK_COS: f64 = 0.4;
/// Step of the low-discrepancy sequence from which a direction's Russian roulette is drawn.
const ROULETTE_STEP: f64 = lattice::R2.x;

/// Tracer of a receiver's gathering rays along one direction at a time: final gathering of the scattered power.
pub(super) struct GatherTracer<'f, 't, 'a> {
    field: &'f DiffuseField<'t, 'a>,
    antenna: Antenna,
    rx: DVec3,
    lattice: Lattice<'f>,
    /// Most interactions between a scattering surface and the receiver.
    deepest: usize,
    /// Share of power below which chance decides whether a ray goes on.
    roulette_throughput: f64,
    stack: Vec<Ray>,
    /// Largest share of power that went on behind the surface seen first, in the last direction traced.
    beyond: f64,
}

/// The directions of a receiver that one of them belongs to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice<'s> {
    /// Number and refinement of the directions.
    pub sampling: Sampling,
    /// Whether what it meets is shared with the transmitter's own rays.
    pub shared: bool,
    /// Small faces, which are sampled over their area and not by directions.
    pub small: Option<&'s Seen>,
    /// Mirrors in which what is seen is shared with the transmitter's own rays as well.
    pub views: Option<&'s ImageReceivers>,
}

impl Lattice<'_> {
    /// A lattice that is the only sampling technique, but for the transmitter's own rays where `shared`.
    pub fn new(count: usize, refined: bool, shared: bool) -> Self {
        Self { sampling: Sampling { count, refined }, shared, small: None, views: None }
    }

    fn is_small(&self, face: u32) -> bool {
        self.small.is_some_and(|seen| seen.holds(face))
    }
}

/// Depth layer of the surfaces whose scattering is gathered along a direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layer {
    /// Scattering of the surface seen first.
    Front,
    /// Scattering of surfaces behind the first, seen mirrored and through slabs.
    Beyond,
    /// Both.
    All,
}

/// A ray on its way from the receiver.
#[derive(Clone, Copy)]
struct Ray {
    origin: DVec3,
    direction: DVec3,
    /// The receiver's port vectors, taken backwards to here.
    ports: [Field; MAX_PORTS],
    length_m: f64,
    hops: usize,
    /// Mirrors on its way.
    way: MirrorSequence,
    /// 1 over the probability of having come this far.
    weight: f64,
}

impl Ray {
    /// Power gain of the receiver's ports along the ray, with the losses on its way so far.
    fn power(&self) -> f64 {
        self.ports.iter().map(Field::norm_squared).sum()
    }
}

/// Russian roulette of the rays of one direction.
struct RussianRoulette {
    /// Power of the ray that left the receiver, to which that of a ray is compared.
    whole: f64,
    /// Random number in [0, 1) from which decisions are drawn.
    sequence: f64,
}

impl RussianRoulette {
    /// The `index`th of a sequence that begins at `first` ∈ [0, 1).
    fn new(whole: f64, first: f64, index: usize) -> Self {
        Self { whole, sequence: (first + index as f64 * ROULETTE_STEP).fract() }
    }

    /// Decides for an event with a probability, independent of the decisions before: the random number is rescaled to [0, 1) for the next
    /// one.
    fn allows(&mut self, probability: f64) -> bool {
        if probability >= 1.0 {
            return true;
        }
        let happens = self.sequence < probability;
        self.sequence = if happens { self.sequence / probability } else { (self.sequence - probability) / (1.0 - probability) };
        happens
    }
}

impl<'f, 't, 'a> GatherTracer<'f, 't, 'a> {
    pub(super) fn new(field: &'f DiffuseField<'t, 'a>, rx: DVec3, antenna: &Antenna, lattice: Lattice<'f>) -> Self {
        let deepest = field.settings.after.min(field.tracer.settings.max_depth.saturating_sub(1)).min(MAX_DEPTH);
        let roulette_throughput = if field.settings.even_arrivals { EVEN_ROULETTE_THROUGHPUT } else { ROULETTE_THROUGHPUT };
        Self { field, antenna: *antenna, rx, lattice, deepest, roulette_throughput, stack: Vec::new(), beyond: 0.0 }
    }

    /// Follows direction `index` of the lattice and reports what is scattered back along it; returns the object seen first.
    pub(super) fn along(
        &mut self,
        index: usize,
        direction: DVec3,
        layer: Layer,
        report: &mut impl FnMut(Contribution),
    ) -> Option<u32> {
        let geometry = &self.field.tracer.geometry;
        let ray = self.outwards(direction);
        let mut luck = self.luck(ray.power(), index);
        let mut seen = None;
        self.beyond = 0.0;
        self.stack.clear();
        self.stack.push(ray);
        while let Some(ray) = self.stack.pop() {
            if ray.hops > 0 {
                self.beyond = self.beyond.max(ray.power() / luck.whole);
            }
            let Some(met) = geometry.intersect(ray.origin, ray.direction, CLEARANCE_M) else { continue };
            if ray.hops == 0 {
                seen = Some(geometry.faces[met.face as usize].object);
            }
            if (ray.hops > 0 || layer != Layer::Beyond)
                && !(ray.way == MirrorSequence::STRAIGHT && self.lattice.is_small(met.face))
                && let Some(ray) = self.looking(&ray, &met, &mut luck)
            {
                self.scattered(&ray, &met, None, report);
            }
            if ray.hops < self.deepest && layer != Layer::Front {
                let response = self.response(&ray, &met);
                for mirrored in [true, false] {
                    self.stack.extend(self.behind(&ray, &met, &response, mirrored, &mut luck));
                }
            }
        }
        seen
    }

    /// Looks at a point of a small face, the `index`th, as [`Self::along`] along a direction.
    pub(super) fn at(&self, index: usize, point: &SmallPoint, report: &mut impl FnMut(Contribution)) -> Option<u32> {
        let ray = self.outwards(point.direction);
        let (ray, met, object) = self.walk(ray, &[], &mut self.luck(ray.power(), index), |met| met.face == point.face)?;
        self.scattered(&ray, &met, Some(point.share_sr), report);
        Some(object)
    }

    /// Follows a ray that leaves the receiver by way of `mirrors`, and through what else it meets, to the surface that `is_end`: how it gets
    /// there, what it meets there, and the object it met first.
    fn walk(
        &self,
        mut ray: Ray,
        mirrors: &[u32],
        luck: &mut RussianRoulette,
        is_end: impl Fn(&SurfaceHit) -> bool,
    ) -> Option<(Ray, SurfaceHit, u32)> {
        let geometry = &self.field.tracer.geometry;
        let mut object = None;
        loop {
            let met = geometry.intersect(ray.origin, ray.direction, CLEARANCE_M)?;
            let object = *object.get_or_insert(geometry.faces[met.face as usize].object);
            let next = mirrors.get(ray.way.count());
            if next.is_none() && is_end(&met) {
                return Some((ray, met, object));
            }
            if ray.hops == self.deepest {
                return None;
            }
            ray = self.behind(&ray, &met, &self.response(&ray, &met), next == Some(&met.face), luck)?;
        }
    }

    /// The largest share of power that went on behind the surface seen first, along the last direction.
    pub(super) fn beyond(&self) -> f64 {
        self.beyond
    }

    fn luck(&self, whole: f64, index: usize) -> RussianRoulette {
        RussianRoulette::new(whole, self.field.luck, index)
    }

    /// A ray that leaves the receiver.
    fn outwards(&self, direction: DVec3) -> Ray {
        let ports = self.port_fields(direction);
        Ray { origin: self.rx, direction, ports, length_m: 0.0, hops: 0, way: MirrorSequence::STRAIGHT, weight: 1.0 }
    }

    /// Reflection and transmission coefficients of a surface at the angle at which a ray met it.
    fn response(&self, ray: &Ray, met: &SurfaceHit) -> SlabResponse {
        self.field.illumination.table(met.face).response(field::cos_incidence(ray.direction, met.normal))
    }

    /// A ray behind a surface, `mirrored` there or straight through: nothing where too little of its power is left, or by chance where
    /// little is.
    fn behind(
        &self,
        ray: &Ray,
        met: &SurfaceHit,
        response: &SlabResponse,
        mirrored: bool,
        luck: &mut RussianRoulette,
    ) -> Option<Ray> {
        let settings = &self.field.tracer.settings;
        if !(if mirrored { settings.reflection } else { settings.transmission }) {
            return None;
        }
        let amplitude = self.field.tracer.geometry.slab(met.face).specular_amplitude();
        let ports = ray.ports.map(|c| {
            if mirrored {
                field::reflect(&c, ray.direction, met.normal, response, amplitude)
            } else {
                field::transmit(&c, ray.direction, met.normal, response)
            }
        });
        let behind = Ray {
            origin: met.point,
            direction: if mirrored { field::mirrored(ray.direction, met.normal) } else { ray.direction },
            ports,
            length_m: ray.length_m + met.distance_m,
            hops: ray.hops + 1,
            way: if mirrored { ray.way.by(met.face) } else { ray.way },
            weight: ray.weight,
        };
        let share = behind.power() / luck.whole;
        if share.is_nan() || share * ray.weight < MIN_THROUGHPUT {
            return None;
        }
        let density = if ray.hops == 0 { self.field.settings.look_on } else { 1.0 };
        let kept = (share * ray.weight * density / self.roulette_throughput).min(1.0) * density;
        if !luck.allows(kept) {
            return None;
        }
        Some(Ray { weight: ray.weight / kept, ..behind })
    }

    /// The ray as it looks at what it met: by chance, where arrivals are to be even and little of its power is left.
    fn looking(&self, ray: &Ray, met: &SurfaceHit, luck: &mut RussianRoulette) -> Option<Ray> {
        if ray.hops == 0 || !self.field.settings.even_arrivals {
            return Some(*ray);
        }
        let flat = (EVEN_LOOK_COS / field::cos_incidence(ray.direction, met.normal)).max(1.0);
        let kept = (ray.power() / luck.whole * ray.weight * flat / EVEN_LOOK_THROUGHPUT).min(1.0);
        luck.allows(kept).then(|| Ray { weight: ray.weight / kept, ..*ray })
    }

    /// Scattering of a surface towards the receiver along a direction of the lattice, or from a sample point that stands for `share_sr` of
    /// ∫dΩ/cosθ_s.
    fn scattered(&self, ray: &Ray, met: &SurfaceHit, share_sr: Option<f64>, report: &mut impl FnMut(Contribution)) {
        let (field, illumination) = (self.field, &self.field.illumination);
        let geometry = &field.tracer.geometry;
        if geometry.slab(met.face).scattering.coefficient == 0.0 {
            return;
        }
        let towards_rx = -ray.direction;
        let cos_scatter = met.normal.dot(towards_rx);
        let received = self.received(&ray.ports, towards_rx);
        let received = &received[..self.ports()];
        let per_area = self.spread(self.lattice.sampling.count) * ray.weight;
        let scale = match share_sr {
            Some(share_sr) => self.spreading() * share_sr * ray.weight,
            None => per_area / cos_scatter.max(MIN_COS_SCATTER),
        };
        let object = geometry.faces[met.face as usize].object;
        let contribution = |power: f64, length_m: f64, mirrored_before: bool, indirect: bool| Contribution {
            power,
            delay_s: (length_m + ray.length_m + met.distance_m) / SPEED_OF_LIGHT,
            object,
            mirrored_before,
            indirect,
            after: ray.hops,
        };
        if let Some(cache) = &field.cache
            && let Some(out) = cache.outgoing(&field.patches, met.face, met.point, met.side, towards_rx, ray.hops)
        {
            let power = scale * received.iter().map(|r| coherent_power(*r, &out.coherency)).sum::<f64>();
            if power > 0.0 {
                report(contribution(power, out.length_m, false, true));
            }
        }
        for &source in &illumination.sources {
            // Sources behind the face light its other side.
            if (source.image - met.point).dot(met.normal) <= 0.0 {
                continue;
            }
            // What the transmitter's own rays find is theirs.
            let mut scale = scale;
            if let Some(vantage) = self.shared(ray).filter(|_| share_sr.is_none() && source.mirror.is_none()) {
                let per_m2 = density(&geometry.faces[met.face as usize], source.image, met.point);
                let density_ratio = self.density_ratio(&vantage, met.face, met.point, per_m2);
                let own_share = 1.0 - mis_weight(density_ratio);
                if own_share == 0.0 {
                    continue;
                }
                let least_cos = if density_ratio > 1.0 { f64::MIN_POSITIVE } else { MIN_COS_SCATTER };
                scale = per_area * own_share / cos_scatter.max(least_cos);
            }
            let lighting = illumination.lighting(source, met.point, met.face);
            let Some(incident) = illumination.incident(source, lighting, met.point, met.face, ray.hops) else { continue };
            let source_m = incident.distance_m;
            let cos_incidence = field::cos_incidence(incident.direction, met.normal);
            let power = scale * self.reemitted(&incident, met.face, met.normal, towards_rx, received) * cos_incidence
                / (source_m * source_m);
            if power > 0.0 {
                report(contribution(power, source_m, source.mirror.is_some(), false));
            }
        }
    }

    /// Ports of the receive antenna.
    fn ports(&self) -> usize {
        self.antenna.ports().min(MAX_PORTS)
    }

    /// The antenna's own field vectors along a direction that it looks in.
    fn port_fields(&self, direction: DVec3) -> [Field; MAX_PORTS] {
        let mut fields = [Field::default(); MAX_PORTS];
        for (port, field) in fields.iter_mut().enumerate().take(self.ports()) {
            *field = Field::real(self.antenna.port_field(port, direction));
        }
        fields
    }

    /// Response of each port to unit fields along θ̂ and along φ̂ that leave a point towards the receiver.
    fn received(&self, ports: &[Field; MAX_PORTS], towards_rx: DVec3) -> [(Complex, Complex); MAX_PORTS] {
        let (theta_out, phi_out) = (theta_hat(towards_rx), phi_hat(towards_rx));
        ports.map(|c| (c.along(theta_out), c.along(phi_out)))
    }

    /// (λ/4π)², m².
    fn spreading(&self) -> f64 {
        (self.field.tracer.settings.wavelength_m() / (4.0 * std::f64::consts::PI)).powi(2)
    }

    /// (λ/4π)² times the solid angle that each of `count` rays over the sphere stands for.
    fn spread(&self, count: usize) -> f64 {
        self.spreading() * 4.0 * std::f64::consts::PI / count as f64
    }

    /// S²Γ² f_s of what a source sends, as the ports receive it: the mean over the transmitter's ports, without distances and projections.
    fn reemitted(
        &self,
        incident: &Incident,
        face: u32,
        normal: DVec3,
        towards_rx: DVec3,
        received: &[(Complex, Complex)],
    ) -> f64 {
        let illumination = &self.field.illumination;
        let scattering = &self.field.tracer.geometry.slab(face).scattering;
        let (co, cross) = ((1.0 - scattering.xpd).sqrt(), scattering.xpd.sqrt());
        let &Incident { direction: k, ref fields, .. } = incident;
        let entry = illumination.table(face).scattering(field::cos_incidence(k, normal));
        let (theta_in, phi_in) = (theta_hat(k), phi_hat(k));
        let mut power = 0.0;
        for e in &fields[..illumination.ports()] {
            let gamma2 = field::reflectivity(e, k, normal, f64::from(entry.te), f64::from(entry.tm));
            // K_x: [[√(1−K), −√K], [√K, √(1−K)]] on the (θ̂, φ̂) components.
            let (e_theta, e_phi) = (e.along(theta_in), e.along(phi_in));
            let (out_theta, out_phi) = (e_theta * co - e_phi * cross, e_theta * cross + e_phi * co);
            power += gamma2 * received.iter().map(|(t, p)| (*t * out_theta + *p * out_phi).norm_squared()).sum::<f64>();
        }
        power * self.lobe(face, normal, k, towards_rx) / illumination.ports() as f64
    }

    /// S² f_s of what comes in along `k`.
    fn lobe(&self, face: u32, normal: DVec3, k: DVec3, towards_rx: DVec3) -> f64 {
        let scattering = &self.field.tracer.geometry.slab(face).scattering;
        let entry = self.field.illumination.table(face).scattering(field::cos_incidence(k, normal));
        let cos_specular = towards_rx.dot(field::mirrored(k, normal));
        let lobe = scattering::lobe(scattering.pattern, normal.dot(towards_rx), cos_specular, -towards_rx.dot(k));
        lobe * f64::from(entry.inverse_normalisation) * scattering.coefficient * scattering.coefficient
    }
}

/// E|r_θ·E_θ + r_φ·E_φ|² of a field with the coherency [⟨|E_θ|²⟩, ⟨|E_φ|²⟩, Re⟨E_θE_φ*⟩, Im⟨E_θE_φ*⟩].
fn coherent_power((theta, phi): (Complex, Complex), coherency: &[f64; 4]) -> f64 {
    let (re, im) = (theta.re * phi.re + theta.im * phi.im, theta.im * phi.re - theta.re * phi.im);
    let cross = 2.0 * (re * coherency[2] - im * coherency[3]);
    (theta.norm_squared() * coherency[0] + phi.norm_squared() * coherency[1] + cross).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_chance_decides_next_does_not_depend_on_what_it_decided_before() {
        const COUNT: usize = 40_000;
        for [first, second] in [[0.3, 0.5], [0.43, 0.56], [0.9, 0.1], [0.02, 0.4]] {
            let mut times = [[0usize; 2]; 2];
            for index in 0..COUNT {
                let mut luck = RussianRoulette::new(1.0, 0.5, index);
                let before = luck.allows(first);
                times[usize::from(before)][usize::from(luck.allows(second))] += 1;
            }
            for (before, [no, yes]) in [1.0 - first, first].into_iter().zip(times) {
                for (times, expected) in [(no, 1.0 - second), (yes, second)] {
                    let share = times as f64 / COUNT as f64;
                    // A lattice is more even than chance, whose standard error is 0.0025 at most.
                    assert!((share - before * expected).abs() < 2e-3, "{first} {second}: {share}, {}", before * expected);
                }
            }
        }
    }
}
