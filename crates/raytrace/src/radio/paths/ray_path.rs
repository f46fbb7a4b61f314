//! One way through the scene: where it turns, whether it is open, and what it does to the field.

use crate::radio::candidates::chain::Chain;
use crate::radio::diffraction::{EdgeFace, EdgeRay, Wedge, diffract};
use crate::radio::field::antenna::{phi_hat, theta_hat};
use crate::radio::field::fresnel::{self, SlabResponse};
use crate::radio::field::{self, ElectricField};
use crate::radio::geometry::{BESIDE_M, Crossing, Geometry};
use crate::radio::paths::path::{Interaction, InteractionKind, Path};
use crate::radio::{Complex, MAX_INTERACTIONS, RadioSettings, SPEED_OF_LIGHT};
use glam::DVec3;

/// Distance from a wedge, metres, at which it is tested whether its edge stands in the open or is flush with another surface.
const EDGE_CLEARANCE_M: f64 = 1e-3;

/// Sides on which a wave beside one that bounces in a corner is looked for.
const SIDES: usize = 360;

/// A vertex at which a path changes direction.
#[derive(Clone, Copy, Debug)]
pub(in crate::radio) enum PathEvent<'w> {
    /// Bounces off a face.
    Mirror(u32),
    /// Diffracts at an edge, lit on `wedge.faces[lit]`.
    Edge { wedge: &'w Wedge, lit: usize },
}

impl PathEvent<'_> {
    /// The faces the turn lies on.
    fn faces(&self) -> [Option<u32>; 2] {
        match self {
            Self::Mirror(face) => [Some(*face), None],
            Self::Edge { wedge, .. } => wedge.faces.map(Some),
        }
    }
}

/// Turns and the points where they happen, TX → RX.
#[derive(Clone, Copy, Debug)]
pub(in crate::radio) struct RayPath<'r> {
    pub tx: DVec3,
    pub rx: DVec3,
    pub turns: &'r [PathEvent<'r>],
    pub corners: &'r [DVec3],
}

impl RayPath<'_> {
    /// Leg `i`: from, to, and the faces its ends lie on.
    pub(in crate::radio) fn leg(&self, i: usize) -> (DVec3, DVec3, [Option<u32>; 4]) {
        let from = if i == 0 { self.tx } else { self.corners[i - 1] };
        let to = self.corners.get(i).copied().unwrap_or(self.rx);
        let before = if i == 0 { [None; 2] } else { self.turns[i - 1].faces() };
        let after = self.turns.get(i).map_or([None; 2], PathEvent::faces);
        (from, to, [before[0], before[1], after[0], after[1]])
    }
}

/// Carries a field along routes through a scene.
#[derive(Clone, Copy)]
pub(in crate::radio) struct Propagator<'p, 'a> {
    pub geometry: &'p Geometry<'a>,
    pub settings: &'p RadioSettings,
}

impl Propagator<'_, '_> {
    /// The one path that bounces off a chain of faces, if there is one.
    pub(in crate::radio) fn trace(&self, tx: DVec3, rx: DVec3, chain: &Chain) -> Option<Path> {
        let faces = chain.faces();
        let vertices = self.specular_vertices(tx, rx, chain)?;
        let mut turns = [PathEvent::Mirror(u32::MAX); MAX_INTERACTIONS];
        turns.iter_mut().zip(faces).for_each(|(turn, face)| *turn = PathEvent::Mirror(*face));
        self.follow(&RayPath { tx, rx, turns: &turns[..faces.len()], corners: &vertices[..faces.len()] })
    }

    /// The path along a route, slabs crossed on the way included; `None` when something blocks it.
    pub(in crate::radio) fn follow(&self, route: &RayPath<'_>) -> Option<Path> {
        // Visibility, leg by leg; transmissions share the budget of interactions.
        let turns = route.turns.len();
        let mut budget = if self.settings.transmission { self.settings.max_interactions - turns } else { 0 };
        let mut crossed: [Vec<Crossing>; MAX_INTERACTIONS + 1] = Default::default();
        for i in 0..=turns {
            let (from, to, skip) = route.leg(i);
            crossed[i] = self.geometry.crossings(from, to, skip, budget)?;
            budget -= crossed[i].len();
        }
        if !self.edges_are_open(route, &crossed) || !self.mirrors_are_foremost(route) {
            return None;
        }
        self.pass_joints(route, &mut crossed, budget)?;
        self.assemble(route, &crossed)
    }

    /// Whether every mirror of a route is the foremost piece of its sheet, and no two in a row are pieces of one: pieces of one plane
    /// reflect as one sheet, however they lie over one another.
    fn mirrors_are_foremost(&self, route: &RayPath<'_>) -> bool {
        let mirror = |i: usize| match route.turns.get(i) {
            Some(PathEvent::Mirror(face)) => Some(*face),
            _ => None,
        };
        (0..route.turns.len()).filter_map(|i| mirror(i).map(|face| (i, face))).all(|(i, face)| {
            let again = mirror(i + 1).is_some_and(|next| self.geometry.is_of_sheet(next, route.corners[i + 1], face));
            // Both legs are on the mirror's side; one may be of no length.
            let ends = [route.leg(i).0, route.leg(i + 1).1];
            let off_m = ends.map(|end| self.geometry.faces[face as usize].distance(end).abs());
            let before = ends[usize::from(off_m[1] > off_m[0])];
            !again && !self.geometry.is_behind_its_sheet(face, route.corners[i], before)
        })
    }

    /// Whether the legs to points just off the route's wedges cross the same faces: an edge that is flush with another surface is none.
    fn edges_are_open(&self, route: &RayPath<'_>, crossed: &[Vec<Crossing>; MAX_INTERACTIONS + 1]) -> bool {
        route.turns.iter().enumerate().all(|(i, turn)| {
            let PathEvent::Edge { wedge, .. } = turn else { return true };
            let off = wedge.outward() * EDGE_CLEARANCE_M;
            [i, i + 1].into_iter().all(|leg| {
                let (from, to, skip) = route.leg(leg);
                let (from, to) = if leg == i { (from, to + off) } else { (from + off, to) };
                let again = self.geometry.crossings(from, to, skip, crossed[leg].len());
                again.is_some_and(|again| again.iter().map(|c| c.face).eq(crossed[leg].iter().map(|c| c.face)))
            })
        })
    }

    /// The image method: reflection points from the receiver back to the transmitter, each on its face.
    pub(in crate::radio) fn specular_vertices(&self, tx: DVec3, rx: DVec3, chain: &Chain) -> Option<[DVec3; MAX_INTERACTIONS]> {
        let faces = chain.faces();
        let mut vertices = [DVec3::ZERO; MAX_INTERACTIONS];
        let Some((&last, _)) = faces.split_last() else { return Some(vertices) };
        // Most candidates end here, at the last face, before the other images are needed.
        vertices[faces.len() - 1] = self.geometry.bounce(last, rx, chain.image)?;
        let images = chain.images(self.geometry, tx);
        for i in (0..faces.len() - 1).rev() {
            vertices[i] = self.geometry.bounce(faces[i], vertices[i + 1], images[i + 1])?;
        }
        let mut first = 0;
        for at_one in vertices[..faces.len()].chunk_by(|a, b| a == b) {
            let next = first + at_one.len();
            if at_one.len() > 1 && !self.bounces_beside(&faces[first..next], at_one[0], at_one[0] - images[first]) {
                return None;
            }
            first = next;
        }
        Some(vertices)
    }

    /// Whether a wave beside one that bounces off several faces where they meet bounces off them as well, in this order: in a corner, not around
    /// an edge that sticks out. Beside the point the faces are cones, so that of all waves on one side of it one speaks for the others.
    fn bounces_beside(&self, faces: &[u32], at: DVec3, incoming: DVec3) -> bool {
        let (u, v) = incoming.normalize().any_orthonormal_pair();
        let bounces = |aside: DVec3| {
            let (mut from, mut direction) = (aside, incoming);
            faces.iter().enumerate().all(|(i, face)| {
                let face = &self.geometry.faces[*face as usize];
                let ahead = -face.normal.dot(from) / face.normal.dot(direction);
                from += direction * ahead;
                direction = field::mirrored(direction, face.normal);
                (i == 0 || ahead > 0.0) && face.contains(at + from)
            })
        };
        (0..SIDES).any(|i| {
            let angle = std::f64::consts::TAU * (i as f64 + 0.3) / SIDES as f64;
            bounces((u * angle.cos() + v * angle.sin()) * BESIDE_M)
        })
    }

    /// The slab's coefficients for a ray on a face.
    fn response(&self, face: u32, direction: DVec3) -> SlabResponse {
        let cos_incidence = field::cos_incidence(direction, self.geometry.faces[face as usize].normal);
        fresnel::slab_response(self.geometry.slab(face), cos_incidence)
    }

    /// Carries the field along the route.
    fn assemble(&self, route: &RayPath<'_>, crossed: &[Vec<Crossing>; MAX_INTERACTIONS + 1]) -> Option<Path> {
        let RayPath { tx, rx, turns, corners } = *route;
        let mut interactions = Vec::new();
        let length_m: f64 = (0..=turns.len()).map(|i| route.leg(i)).map(|(from, to, _)| from.distance(to)).sum();
        // 1/L, but 1/√(s s′(s + s′)) for a path with an edge.
        let mut spreading_per_m = 1.0 / length_m;
        let departure = (corners.first().copied().unwrap_or(rx) - tx).normalize();
        let (mut travelled_m, mut direction) = (0.0, departure);
        let mut e = [ElectricField::real(theta_hat(departure)), ElectricField::real(phi_hat(departure))];
        for i in 0..=turns.len() {
            let (from, to, _) = route.leg(i);
            let leg_m = from.distance(to);
            // A leg of no length (a bounce exactly in a corner) has the direction the mirror gives it.
            if leg_m > 0.0 {
                direction = (to - from) / leg_m;
            }
            for crossing in &crossed[i] {
                let face = &self.geometry.faces[crossing.face as usize];
                let response = self.response(crossing.face, direction);
                e = e.map(|e| field::transmit(&e, direction, face.normal, &response));
                let vertex = from + direction * crossing.distance_m;
                interactions.push(Interaction { kind: InteractionKind::Refraction, object: face.object, vertex });
            }
            travelled_m += leg_m;
            match turns.get(i) {
                None => {}
                Some(PathEvent::Mirror(index)) => {
                    let face = &self.geometry.faces[*index as usize];
                    let amplitude = self.geometry.slab(*index).specular_amplitude();
                    let response = self.response(*index, direction);
                    e = e.map(|e| field::reflect(&e, direction, face.normal, &response, amplitude));
                    direction = field::mirrored(direction, face.normal);
                    interactions.push(Interaction { kind: InteractionKind::Specular, object: face.object, vertex: to });
                }
                Some(PathEvent::Edge { wedge, lit }) => {
                    let (source_m, target_m) = (travelled_m, length_m - travelled_m);
                    spreading_per_m = 1.0 / (source_m * target_m * length_m).sqrt();
                    let ray = EdgeRay {
                        // The other face's view of the same edge runs the other way.
                        edge: if *lit == 0 { wedge.edge } else { -wedge.edge },
                        exterior_angle_rad: wedge.exterior_angle_rad,
                        incident: direction,
                        diffracted: (route.leg(i + 1).1 - to).normalize(),
                        source_m,
                        target_m,
                    };
                    let faces =
                        [*lit, 1 - lit].map(|i| EdgeFace { slab: self.geometry.slab(wedge.faces[i]), normal: wedge.normals[i] });
                    let (wavelength_m, model) = (self.settings.wavelength_m(), self.settings.diffraction_model);
                    e = e.map(|e| diffract(&e, &ray, &faces, wavelength_m, model));
                    interactions.push(Interaction { kind: InteractionKind::Diffraction, object: wedge.object, vertex: to });
                }
            }
        }
        let arrival = (corners.last().copied().unwrap_or(tx) - rx).normalize();
        // a = λ/(4πL)·C_RX·E
        let spreading = self.settings.wavelength_m() / (4.0 * std::f64::consts::PI) * spreading_per_m;
        let transfer = [theta_hat(arrival), phi_hat(arrival)].map(|axis| e.map(|e| e.along(axis) * spreading));
        let mut path =
            Path { interactions, length_m, delay_s: length_m / SPEED_OF_LIGHT, a: Complex::ZERO, transfer, arrival, departure };
        let [tx, rx] = [&self.settings.tx_antenna, &self.settings.rx_antenna];
        path.a = path.coefficient(tx, 0, rx, 0);
        (path.received(tx, rx) >= 10f64.powf(self.settings.min_gain_db / 10.0)).then_some(path)
    }
}
