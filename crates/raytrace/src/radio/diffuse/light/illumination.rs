//! Direct illumination of a point: by the transmitter itself and its mirror images, straight through slabs where they let power pass.

use crate::radio::field::tables::SlabTable;
use crate::radio::field::{self, ElectricField};
use crate::radio::geometry::Geometry;
use crate::radio::{RadioTracer, lattice};
use glam::DVec3;

/// Rays that find out how large every face is in the transmitter's view.
const MIRROR_RAYS: usize = 40_000;
/// Slabs that pass less than this share of power at normal incidence are opaque to the diffuse field (−30 dB).
const OPAQUE_POWER: f64 = 1e-3;
/// Distance from the ends of a shadow ray within which nothing is looked for, metres: float32 resolves 1e-6 at 10 m.
pub const CLEARANCE_M: f64 = 5e-5;

/// The transmitter, or its image in a face.
#[derive(Clone, Copy, Debug)]
pub struct IlluminationSource {
    /// Position of the transmitter or of its image, world frame, metres.
    pub image: DVec3,
    /// The mirror; `None` for the transmitter itself.
    pub mirror: Option<u32>,
}

impl IlluminationSource {
    /// The transmitter itself.
    pub fn transmitter(tx: DVec3) -> Self {
        Self { image: tx, mirror: None }
    }
}

/// Whether and how a source lights a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lighting {
    /// Something opaque is in between, or the mirror does not reach there.
    Dark,
    /// The way is free.
    Free,
    /// Slabs that let power pass are in between; more of them than interactions allow make it dark after all.
    ThroughSlabs,
}

/// Ports of an antenna, at most.
pub const MAX_PORTS: usize = 2;

/// The field that a source sends to a point.
#[derive(Clone, Copy, Debug)]
pub struct Incident {
    /// Unit direction of propagation at the point.
    pub direction: DVec3,
    /// Field of every port of the transmitter, without spreading and phase.
    pub fields: [ElectricField; MAX_PORTS],
    /// Unfolded distance from the transmitter, metres.
    pub distance_m: f64,
}

/// The sources of one transmitter.
pub struct Illumination<'t, 'a> {
    pub tracer: &'t RadioTracer<'a>,
    /// One per scene material.
    pub tables: Vec<Option<SlabTable>>,
    pub tx: DVec3,
    /// The transmitter first, then its images.
    pub sources: Vec<IlluminationSource>,
    /// Whether a face's image of the transmitter is among the sources, by face.
    mirrors: Vec<bool>,
}

impl<'t, 'a> Illumination<'t, 'a> {
    /// Finds the faces that take at least `min_mirror_sr` of the transmitter's view.
    pub fn new(tracer: &'t RadioTracer<'a>, tx: DVec3, min_mirror_sr: f64) -> Self {
        let geometry = &tracer.geometry;
        let tables = geometry.slabs.iter().map(|slab| slab.as_ref().map(SlabTable::new)).collect();
        let mut sources = Vec::new();
        if tracer.settings.max_interactions >= 1 {
            sources.push(IlluminationSource::transmitter(tx));
        }
        // One interaction before the scattering and the scattering itself.
        if tracer.settings.reflection && tracer.settings.max_interactions >= 2 && min_mirror_sr < 4.0 * std::f64::consts::PI {
            let mut seen = vec![0usize; geometry.faces.len()];
            for i in 0..MIRROR_RAYS {
                if let Some((_, triangle)) = geometry.closest(tx, lattice::fibonacci(i, MIRROR_RAYS), 0.0) {
                    seen[geometry.face_of_triangle(triangle) as usize] += 1;
                }
            }
            let enough = (min_mirror_sr * MIRROR_RAYS as f64 / (4.0 * std::f64::consts::PI)).max(1.0);
            for (face, count) in seen.into_iter().enumerate() {
                if count as f64 >= enough {
                    sources.push(IlluminationSource { image: geometry.faces[face].mirror(tx), mirror: Some(face as u32) });
                }
            }
        }
        let mut mirrors = vec![false; geometry.faces.len()];
        sources.iter().filter_map(|s: &IlluminationSource| s.mirror).for_each(|face| mirrors[face as usize] = true);
        Self { tracer, tables, tx, sources, mirrors }
    }

    pub fn geometry(&self) -> &Geometry<'a> {
        &self.tracer.geometry
    }

    pub fn table(&self, face: u32) -> &SlabTable {
        match &self.tables[self.geometry().faces[face as usize].material as usize] {
            Some(table) => table,
            None => unreachable!("a face's material is used by its triangles"),
        }
    }

    /// Interactions a source's legs may still spend on slabs, after its mirror, the scattering itself and `after` more behind it.
    pub fn slab_budget(&self, source: IlluminationSource, after: usize) -> Option<usize> {
        let spent = 1 + after + usize::from(source.mirror.is_some());
        let left = self.tracer.settings.max_interactions.checked_sub(spent)?;
        Some(if self.tracer.settings.transmission { left } else { 0 })
    }

    /// Visibility of a source from a point of a face.
    pub fn lighting(&self, source: IlluminationSource, point: DVec3, face: u32) -> Lighting {
        let Some(slab_budget) = self.slab_budget(source, 0) else { return Lighting::Dark };
        let leg = |from: DVec3, to: DVec3, skip: [Option<u32>; 2]| -> Lighting {
            let mut slabs = false;
            let blocked = self.geometry().occluded(from, to, CLEARANCE_M, |f| {
                let between = !skip.contains(&Some(f));
                slabs |= between;
                between && (slab_budget == 0 || self.is_opaque(f))
            });
            match (blocked, slabs) {
                (true, _) => Lighting::Dark,
                (false, true) => Lighting::ThroughSlabs,
                (false, false) => Lighting::Free,
            }
        };
        let Some(mirror) = source.mirror else { return leg(self.tx, point, [Some(face), None]) };
        if mirror == face {
            return Lighting::Dark;
        }
        let Some(at) = self.tracer.geometry.bounce(mirror, point, source.image) else { return Lighting::Dark };
        match leg(at, point, [Some(mirror), Some(face)]) {
            Lighting::Dark => Lighting::Dark,
            beyond => match leg(self.tx, at, [Some(mirror), None]) {
                Lighting::Free => beyond,
                before => before,
            },
        }
    }

    /// Whether the diffuse field takes a face for opaque.
    pub fn is_opaque(&self, face: u32) -> bool {
        self.table(face).transmitted_power < OPAQUE_POWER
    }

    /// Ports of the transmit antenna.
    pub fn ports(&self) -> usize {
        self.tracer.settings.tx_antenna.ports().min(MAX_PORTS)
    }

    /// Whether the sources hold the transmitter's image in a face.
    pub fn is_mirror(&self, face: u32) -> bool {
        self.mirrors[face as usize]
    }

    /// The fields that the transmitter's ports send along a direction.
    fn emitted(&self, direction: DVec3) -> [ElectricField; MAX_PORTS] {
        let antenna = &self.tracer.settings.tx_antenna;
        let mut fields = [ElectricField::default(); MAX_PORTS];
        for (port, field) in fields.iter_mut().enumerate().take(self.ports()) {
            *field = ElectricField::real(antenna.port_field(port, direction));
        }
        fields
    }

    /// The field of a source at a point it lights, slabs included; `after` interactions follow the scattering.
    pub fn incident(
        &self,
        source: IlluminationSource,
        lighting: Lighting,
        point: DVec3,
        face: u32,
        after: usize,
    ) -> Option<Incident> {
        let budget = self.slab_budget(source, after)?;
        if lighting == Lighting::Dark || (lighting == Lighting::ThroughSlabs && budget == 0) {
            return None;
        }
        let distance_m = source.image.distance(point);
        if distance_m == 0.0 {
            return None;
        }
        let direction = (point - source.image) / distance_m;
        let ports = self.ports();
        let mut left = budget;
        let mut through =
            |fields: &mut [ElectricField], from: DVec3, to: DVec3, skip: [Option<u32>; 2], direction: DVec3| -> Option<()> {
                if lighting == Lighting::ThroughSlabs {
                    let crossed = self.geometry().crossings(from, to, skip, left)?;
                    left -= crossed.len();
                    for field in fields {
                        *field = crossed.iter().fold(*field, |e, c| self.pass(&e, c.face, direction));
                    }
                }
                Some(())
            };
        let Some(mirror) = source.mirror else {
            let mut fields = self.emitted(direction);
            through(&mut fields[..ports], self.tx, point, [Some(face), None], direction)?;
            return Some(Incident { direction, fields, distance_m });
        };
        let plane = &self.geometry().faces[mirror as usize];
        let departure = field::mirrored(direction, plane.normal);
        let mut fields = self.emitted(departure);
        // Where the way is free the point of reflection is not needed.
        let at = if lighting == Lighting::Free { point } else { self.tracer.geometry.bounce(mirror, point, source.image)? };
        through(&mut fields[..ports], self.tx, at, [Some(mirror), None], departure)?;
        for field in &mut fields[..ports] {
            *field = self.bounce_field(field, mirror, departure);
        }
        through(&mut fields[..ports], at, point, [Some(mirror), Some(face)], direction)?;
        Some(Incident { direction, fields, distance_m })
    }

    /// The field behind a slab.
    pub fn pass(&self, e: &ElectricField, face: u32, direction: DVec3) -> ElectricField {
        let normal = self.geometry().faces[face as usize].normal;
        field::transmit(e, direction, normal, &self.table(face).response(field::cos_incidence(direction, normal)))
    }

    /// The specularly reflected field.
    pub fn bounce_field(&self, e: &ElectricField, face: u32, direction: DVec3) -> ElectricField {
        let normal = self.geometry().faces[face as usize].normal;
        let response = self.table(face).response(field::cos_incidence(direction, normal));
        field::reflect(e, direction, normal, &response, self.geometry().slab(face).specular_amplitude())
    }
}
