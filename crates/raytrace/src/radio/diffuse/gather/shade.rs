//! Shading: the scattering of a surface that a gathering ray met, towards the receiver, lit by photons and by the sources.

use super::mis::{density, mis_weight};
use super::ray::{GatherTracer, Ray};
use crate::radio::diffuse::Contribution;
use crate::radio::diffuse::light::illumination::{Incident, MAX_PORTS};
use crate::radio::field::antenna::{phi_hat, theta_hat};
use crate::radio::field::{self, ElectricField};
use crate::radio::geometry::SurfaceHit;
use crate::radio::{Complex, SPEED_OF_LIGHT, field::scattering};
use glam::DVec3;

/// Surfaces are not seen at angles flatter than this: cosθ_s, 0.6°. dΩ/cosθ_s has an integrable pole there that no lattice samples well. Not
/// so where the transmitter's own rays fall more densely: their share takes the pole away.
const MIN_COS_SCATTER: f64 = 0.01;

impl GatherTracer<'_, '_, '_> {
    /// Scattering of a surface towards the receiver along a direction of the lattice, or from a sample point that stands for `share_sr` of
    /// ∫dΩ/cosθ_s.
    pub(super) fn scattered(&self, ray: &Ray, met: &SurfaceHit, share_sr: Option<f64>, report: &mut impl FnMut(Contribution)) {
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
    pub(super) fn ports(&self) -> usize {
        self.antenna.ports().min(MAX_PORTS)
    }

    /// The antenna's own field vectors along a direction that it looks in.
    pub(super) fn port_fields(&self, direction: DVec3) -> [ElectricField; MAX_PORTS] {
        let mut fields = [ElectricField::default(); MAX_PORTS];
        for (port, field) in fields.iter_mut().enumerate().take(self.ports()) {
            *field = ElectricField::real(self.antenna.port_field(port, direction));
        }
        fields
    }

    /// Response of each port to unit fields along θ̂ and along φ̂ that leave a point towards the receiver.
    pub(super) fn received(&self, ports: &[ElectricField; MAX_PORTS], towards_rx: DVec3) -> [(Complex, Complex); MAX_PORTS] {
        let (theta_out, phi_out) = (theta_hat(towards_rx), phi_hat(towards_rx));
        ports.map(|c| (c.along(theta_out), c.along(phi_out)))
    }

    /// (λ/4π)², m².
    fn spreading(&self) -> f64 {
        (self.field.tracer.settings.wavelength_m() / (4.0 * std::f64::consts::PI)).powi(2)
    }

    /// (λ/4π)² times the solid angle that each of `count` rays over the sphere stands for.
    pub(super) fn spread(&self, count: usize) -> f64 {
        self.spreading() * 4.0 * std::f64::consts::PI / count as f64
    }

    /// S²Γ² f_s of what a source sends, as the ports receive it: the mean over the transmitter's ports, without distances and projections.
    pub(super) fn reemitted(
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
    pub(super) fn lobe(&self, face: u32, normal: DVec3, k: DVec3, towards_rx: DVec3) -> f64 {
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
