//! Final gathering: rays from the receiver along every direction of its lattice, mirrored and straight through slabs, to surfaces that
//! scatter.
//!
//! A ray carries what the receiver's ports make of a field that comes in along it: the antenna's own field vector taken backwards
//! through every mirror and slab, which by reciprocity is the forward way's transpose. What a surface scatters along the ray is then
//! received as |c·E|².

use super::image_receivers::{ImageReceivers, MirrorSequence};
use super::sampling::DirectionSampling;
use super::small_faces::{Seen, SmallPoint};
#[cfg(doc)]
use crate::radio::diffuse::DiffuseSettings;
use crate::radio::diffuse::light::illumination::MAX_PORTS;
use crate::radio::diffuse::{Contribution, DiffuseField};
use crate::radio::field::antenna::Antenna;
use crate::radio::field::fresnel::SlabResponse;
use crate::radio::field::{self, ElectricField};
use crate::radio::geometry::SurfaceHit;
use crate::radio::{MAX_INTERACTIONS, lattice};
use glam::DVec3;

/// Clearance of a gathering ray from the face it leaves, metres.
pub(super) const CLEARANCE_M: f64 = 5e-5;
/// A ray that keeps less than this share of power (−60 dB) ends.
const MIN_THROUGHPUT: f64 = 1e-6;
/// Cosine of the scattering angle, cosθ_s, below which that probability rises by 1/cosθ_s: otherwise the 1/cosθ_s of the integrand and that
/// of the probability together would make heavy arrivals.
const SHADE_COS: f64 = 0.4;
/// Step of the low-discrepancy sequence from which a direction's Russian roulette is drawn.
const ROULETTE_STEP: f64 = lattice::R2.x;

/// Tracer of a receiver's gathering rays along one direction at a time: final gathering of the scattered power.
pub struct GatherTracer<'f, 't, 'a> {
    pub(super) field: &'f DiffuseField<'t, 'a>,
    pub(super) antenna: Antenna,
    pub(super) rx: DVec3,
    pub(super) lattice: Lattice<'f>,
    /// Most interactions between a scattering surface and the receiver.
    pub(super) deepest: usize,
    stack: Vec<Ray>,
    /// Largest share of power that went on behind the surface seen first, in the last direction traced.
    beyond: f64,
}

/// The directions of a receiver that one of them belongs to.
#[derive(Clone, Copy, Debug)]
pub struct Lattice<'s> {
    /// Number and refinement of the directions.
    pub sampling: DirectionSampling,
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
        Self { sampling: DirectionSampling { count, refined }, shared, small: None, views: None }
    }

    pub(super) fn is_small(&self, face: u32) -> bool {
        self.small.is_some_and(|seen| seen.holds(face))
    }
}

/// Depth layer of the surfaces whose scattering is gathered along a direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthLayer {
    /// Scattering of the surface seen first.
    Front,
    /// Scattering of surfaces behind the first, seen mirrored and through slabs.
    Beyond,
    /// Both.
    All,
}

/// A ray on its way from the receiver.
#[derive(Clone, Copy)]
pub(super) struct Ray {
    pub(super) origin: DVec3,
    pub(super) direction: DVec3,
    /// The receiver's port vectors, taken backwards to here.
    pub(super) ports: [ElectricField; MAX_PORTS],
    pub(super) length_m: f64,
    pub(super) hops: usize,
    /// Mirrors on its way.
    pub(super) way: MirrorSequence,
    /// 1 over the probability of having come this far.
    pub(super) weight: f64,
}

impl Ray {
    /// Power gain of the receiver's ports along the ray, with the losses on its way so far.
    pub(super) fn power(&self) -> f64 {
        self.ports.iter().map(ElectricField::norm_squared).sum()
    }
}

/// Russian roulette of the rays of one direction.
pub(super) struct RussianRoulette {
    /// Power of the ray that left the receiver, to which that of a ray is compared.
    pub(super) whole: f64,
    /// Random number in [0, 1) from which decisions are drawn.
    pub(super) sequence: f64,
}

impl RussianRoulette {
    /// The `index`th of a sequence that begins at `first` ∈ [0, 1).
    fn new(whole: f64, first: f64, index: usize) -> Self {
        Self { whole, sequence: (first + index as f64 * ROULETTE_STEP).fract() }
    }

    /// Decides for an event with a probability, independent of the decisions before: the random number is rescaled to [0, 1) for the next
    /// one.
    pub(super) fn allows(&mut self, probability: f64) -> bool {
        if probability >= 1.0 {
            return true;
        }
        let happens = self.sequence < probability;
        self.sequence = if happens { self.sequence / probability } else { (self.sequence - probability) / (1.0 - probability) };
        happens
    }
}

impl<'f, 't, 'a> GatherTracer<'f, 't, 'a> {
    pub fn new(field: &'f DiffuseField<'t, 'a>, rx: DVec3, antenna: &Antenna, lattice: Lattice<'f>) -> Self {
        let deepest = field.settings.after.min(field.tracer.settings.max_interactions.saturating_sub(1)).min(MAX_INTERACTIONS);
        Self { field, antenna: *antenna, rx, lattice, deepest, stack: Vec::new(), beyond: 0.0 }
    }

    /// Follows direction `index` of the lattice and reports what is scattered back along it; returns the object seen first.
    pub fn along(
        &mut self,
        index: usize,
        direction: DVec3,
        layer: DepthLayer,
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
            if (ray.hops > 0 || layer != DepthLayer::Beyond)
                && !(ray.way == MirrorSequence::STRAIGHT && self.lattice.is_small(met.face))
                && let Some(ray) = self.looking(&ray, &met, &mut luck)
            {
                self.scattered(&ray, &met, None, report);
            }
            if ray.hops < self.deepest && layer != DepthLayer::Front {
                let response = self.response(&ray, &met);
                for mirrored in [true, false] {
                    self.stack.extend(self.behind(&ray, &met, &response, mirrored, &mut luck));
                }
            }
        }
        seen
    }

    /// Looks at a point of a small face, the `index`th, as [`Self::along`] along a direction.
    pub fn at(&self, index: usize, point: &SmallPoint, report: &mut impl FnMut(Contribution)) -> Option<u32> {
        let ray = self.outwards(point.direction);
        let (ray, met, object) = self.walk(ray, &[], &mut self.luck(ray.power(), index), |met| met.face == point.face)?;
        self.scattered(&ray, &met, Some(point.share_sr), report);
        Some(object)
    }

    /// Follows a ray that leaves the receiver by way of `mirrors`, and through what else it meets, to the surface that `is_end`: how it gets
    /// there, what it meets there, and the object it met first.
    pub(super) fn walk(
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
    pub fn beyond(&self) -> f64 {
        self.beyond
    }

    pub(super) fn luck(&self, whole: f64, index: usize) -> RussianRoulette {
        RussianRoulette::new(whole, self.field.luck, index)
    }

    /// A ray that leaves the receiver.
    pub(super) fn outwards(&self, direction: DVec3) -> Ray {
        let ports = self.port_fields(direction);
        Ray { origin: self.rx, direction, ports, length_m: 0.0, hops: 0, way: MirrorSequence::STRAIGHT, weight: 1.0 }
    }

    /// Reflection and transmission coefficients of a surface at the angle at which a ray met it.
    pub(super) fn response(&self, ray: &Ray, met: &SurfaceHit) -> SlabResponse {
        self.field.illumination.table(met.face).response(field::cos_incidence(ray.direction, met.normal))
    }

    /// A ray behind a surface, `mirrored` there or straight through: nothing where too little of its power is left, or by chance where
    /// little is.
    pub(super) fn behind(
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
        let kept = (share * ray.weight / self.field.policy.roulette_throughput).min(1.0);
        if !luck.allows(kept) {
            return None;
        }
        Some(Ray { weight: ray.weight / kept, ..behind })
    }

    /// The ray as it looks at what it met: by chance, where arrivals are to be even and little of its power is left.
    fn looking(&self, ray: &Ray, met: &SurfaceHit, luck: &mut RussianRoulette) -> Option<Ray> {
        let threshold = self.field.policy.shade_throughput;
        if ray.hops == 0 || threshold == 0.0 {
            return Some(*ray);
        }
        let flat = (SHADE_COS / field::cos_incidence(ray.direction, met.normal)).max(1.0);
        let kept = (ray.power() / luck.whole * ray.weight * flat / threshold).min(1.0);
        luck.allows(kept).then(|| Ray { weight: ray.weight / kept, ..*ray })
    }
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
