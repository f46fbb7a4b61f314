//! Multipath components and the tracer that finds them.

use super::antenna::{Angles, Antenna, AntennaArray, phi_hat, theta_hat};
use super::chains::{self, Chain};
use super::diffraction::{self, EdgeChains, Wedge, Wedges};
use super::geometry::{Face, Geometry};
use super::screen::Screen;
use super::{Complex, RadioSettings};
use crate::bvh::Bvh;
use corf_scene::{Error, Result, Scene, near_field};
use glam::DVec3;
use rayon::prelude::*;

/// A point this close to a triangle is on the surface, metres: what it sees would be a matter of rounding.
const ON_SURFACE_M: f64 = 1e-6;
/// Closer than this to a surface, metres, an end of scattered power is refused: rays keep half of it clear of what they leave.
const NEAR_SURFACE_M: f64 = 1e-4;
/// Paths whose corners all lie this close are one, metres: it bounces where two faces meet.
const SAME_PATH_M: f64 = 1e-9;
/// Chains a task of [`Transmitter::paths`] tries.
const CHAINS_PER_TASK: usize = 32;

/// What happens at a vertex of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InteractionKind {
    /// Specular reflection, `S`.
    Specular,
    /// Straight transmission through a slab, `R` (Sionna's refraction).
    Refraction,
    /// Diffraction at an edge, `X`.
    Diffraction,
}

impl InteractionKind {
    /// The letter used in path types.
    pub fn letter(self) -> char {
        match self {
            Self::Specular => 'S',
            Self::Refraction => 'R',
            Self::Diffraction => 'X',
        }
    }

    /// Sionna's interaction flag.
    pub fn flag(self) -> u32 {
        match self {
            Self::Specular => 1,
            Self::Refraction => 4,
            Self::Diffraction => 8,
        }
    }
}

/// One vertex of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interaction {
    /// What happens there.
    pub kind: InteractionKind,
    /// Index into the scene's objects.
    pub object: u32,
    /// Where, world frame, metres.
    pub vertex: DVec3,
}

/// A multipath component.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Interactions in TX → RX order; none for the line of sight.
    pub interactions: Vec<Interaction>,
    /// Unfolded length, metres.
    pub length_m: f64,
    /// Delay, seconds.
    pub delay_s: f64,
    /// Passband coefficient between the first ports of the two antennas, without the propagation phase e^{−j2πfτ}.
    pub a: Complex,
    /// The channel itself, antennas aside: `transfer[i][j]` takes the field component j (0 θ̂, 1 φ̂ of the departure, world frame) of the
    /// transmitter to component i (θ̂, φ̂ of the arrival) at the receiver: λ/(4πL) × Fresnel, without the propagation phase.
    pub transfer: [[Complex; 2]; 2],
    /// Unit direction from the receiver towards the last interaction, world frame.
    pub arrival: DVec3,
    /// Unit direction along which the path leaves the transmitter, world frame.
    pub departure: DVec3,
}

impl Path {
    /// Interaction letters in TX → RX order; empty for the line of sight.
    pub fn types(&self) -> String {
        self.interactions.iter().map(|i| i.kind.letter()).collect()
    }

    /// Whether both leave and arrive alike and do the same at the same places; what happens at one place may come in another order.
    fn coincides(&self, other: &Self) -> bool {
        let near = |a: DVec3, b: DVec3| a.distance(b) <= SAME_PATH_M;
        let as_often = |what: &Interaction| {
            let count =
                |path: &Self| path.interactions.iter().filter(|i| i.kind == what.kind && near(i.vertex, what.vertex)).count();
            count(self) == count(other)
        };
        self.interactions.len() == other.interactions.len()
            && near(self.departure, other.departure)
            && near(self.arrival, other.arrival)
            && self.interactions.iter().all(as_often)
    }

    /// Whether all of its numbers are numbers.
    fn is_finite(&self) -> bool {
        let complex = self.transfer.iter().flatten().chain([&self.a]);
        self.length_m.is_finite()
            && self.delay_s.is_finite()
            && self.arrival.is_finite()
            && self.departure.is_finite()
            && self.interactions.iter().all(|i| i.vertex.is_finite())
            && complex.into_iter().all(|c| c.re.is_finite() && c.im.is_finite())
    }

    /// |a|², linear, relative to 1 W transmitted; the first ports' when an antenna has two.
    pub fn power(&self) -> f64 {
        self.a.norm_squared()
    }

    /// Power received for 1 W transmitted: transmit ports share it and send independent signals, what receive ports get adds. With one
    /// port each |a|².
    pub fn received(&self, tx: &Antenna, rx: &Antenna) -> f64 {
        let pairs = (0..rx.ports()).flat_map(|r| (0..tx.ports()).map(move |t| (t, r)));
        pairs.map(|(t, r)| self.coefficient(tx, t, rx, r).norm_squared()).sum::<f64>() / tx.ports() as f64
    }

    /// The coefficient between a port of one antenna and a port of another, without the propagation phase: C_RXᵀ·transfer·C_TX.
    pub fn coefficient(&self, tx: &Antenna, tx_port: usize, rx: &Antenna, rx_port: usize) -> Complex {
        let components = |antenna: &Antenna, port: usize, direction: DVec3| {
            let c = antenna.port_field(port, direction);
            [c.dot(theta_hat(direction)), c.dot(phi_hat(direction))]
        };
        let (t, r) = (components(tx, tx_port, self.departure), components(rx, rx_port, self.arrival));
        let row = |i: usize| (self.transfer[i][0] * t[0] + self.transfer[i][1] * t[1]) * r[i];
        row(0) + row(1)
    }

    /// The channel matrix of this path between two arrays, without the propagation phase: row r·columns + t, r a port of `rx`, t one of
    /// `tx`, numbered as [`AntennaArray`] does. The path is a plane wave across both arrays (far field, as Sionna's synthetic arrays):
    /// h = v_r(u_arrival)·a·v_t(u_departure), v_m(u) = exp(j2π p_m·u).
    pub fn array_response(&self, tx: &AntennaArray, rx: &AntennaArray) -> Vec<Complex> {
        let (steer_tx, steer_rx) = (tx.steering(self.departure), rx.steering(self.arrival));
        let mut h = Vec::with_capacity(tx.ports() * rx.ports());
        for rx_port in 0..rx.element.ports() {
            let a: Vec<Complex> =
                (0..tx.element.ports()).map(|port| self.coefficient(&tx.element, port, &rx.element, rx_port)).collect();
            for v_r in &steer_rx {
                h.extend(a.iter().flat_map(|a| steer_tx.iter().map(move |v_t| *v_r * *a * *v_t)));
            }
        }
        h
    }

    /// Angle of arrival: from the receiver towards the last interaction.
    pub fn aoa(&self) -> Angles {
        Angles::of(self.arrival)
    }

    /// Angle of departure: along propagation.
    pub fn aod(&self) -> Angles {
        Angles::of(self.departure)
    }
}

/// Traces one scene at one carrier.
pub struct RadioTracer<'a> {
    pub(super) geometry: Geometry<'a>,
    pub(super) settings: RadioSettings,
    pub(super) wedges: Wedges,
    /// Names, for messages.
    objects: Vec<String>,
}

impl<'a> RadioTracer<'a> {
    /// Prepares a scene; every material in use must have radio properties.
    ///
    /// # Errors
    /// Materials without radio properties (all are named), a material outside its validity range, settings out of range.
    pub fn new(scene: &Scene, bvh: &'a Bvh, settings: RadioSettings) -> Result<Self> {
        Self::over(scene, Some(bvh), settings)
    }

    /// As [`RadioTracer::new`], but every triangle is tried against every segment: right by construction, for small scenes.
    ///
    /// # Errors
    /// As [`RadioTracer::new`].
    pub fn without_bvh(scene: &Scene, settings: RadioSettings) -> Result<Self> {
        Self::over(scene, None, settings)
    }

    fn over(scene: &Scene, bvh: Option<&'a Bvh>, settings: RadioSettings) -> Result<Self> {
        settings.validate()?;
        let geometry = Geometry::new(scene, bvh, settings.frequency_hz)?;
        let wedges = if settings.diffraction { Wedges::new(&geometry, settings.edge_diffraction) } else { Wedges::default() };
        let objects = scene.objects.iter().map(|o| o.name.clone()).collect();
        Ok(Self { geometry, settings, wedges, objects })
    }

    /// The edges that diffract; none unless diffraction is on.
    pub fn wedges(&self) -> &[Wedge] {
        &self.wedges.wedges
    }

    /// How many open edges of sheets there are that do not diffract though other edges do, and their length in all, metres.
    pub fn open_edges_left_out(&self) -> (usize, f64) {
        self.wedges.left_out
    }

    /// The settings in use.
    pub fn settings(&self) -> &RadioSettings {
        &self.settings
    }

    /// The planar faces, slabs and triangles being traced.
    pub fn geometry(&self) -> &Geometry<'a> {
        &self.geometry
    }

    /// How many objects the scene has.
    pub(super) fn objects(&self) -> usize {
        self.objects.len()
    }

    /// Finds everything about a transmitter that does not depend on the receiver; reuse it for all receivers.
    ///
    /// # Errors
    /// A position that is not finite, or on a surface.
    pub fn transmitter(&self, tx: DVec3) -> Result<Transmitter<'_, 'a>> {
        self.check_position("transmitter", tx)?;
        let chains = chains::candidates(&self.geometry, tx, &self.settings);
        let screen = Screen::new(&self.geometry, &chains);
        let edge_chains = EdgeChains::from_point(self, tx);
        Ok(Transmitter { tracer: self, tx, chains, screen, edge_chains })
    }

    /// Refuses an end of links with scattered power that is not finite or closer to a surface than its rays start from it.
    ///
    /// # Errors
    /// Where it is and what is wrong there.
    pub fn check_in_the_open(&self, whose: &str, position: DVec3) -> Result<()> {
        self.check_clear(whose, position, NEAR_SURFACE_M)
    }

    fn check_position(&self, whose: &str, position: DVec3) -> Result<()> {
        self.check_clear(whose, position, ON_SURFACE_M)
    }

    fn check_clear(&self, whose: &str, position: DVec3, clear_m: f64) -> Result<()> {
        if !position.is_finite() {
            return Err(Error::invalid(whose, format!("position is {position}"), "give three finite coordinates in metres"));
        }
        let near = |face: &&Face| face.distance(position).abs() <= clear_m && face.contains(position);
        let Some(face) = self.geometry.faces.iter().find(near) else { return Ok(()) };
        let (object, distance_m) = (&self.objects[face.object as usize], face.distance(position).abs());
        let (what, help) = if distance_m <= ON_SURFACE_M {
            (
                format!("at {position} it lies on the surface of object `{object}`"),
                "which side it sees is undefined; move it off the surface".into(),
            )
        } else {
            (
                format!("at {position} it lies {:.3} mm from the surface of object `{object}`", 1e3 * distance_m),
                format!("scattered power needs {} mm: move it off the surface", 1e3 * NEAR_SURFACE_M),
            )
        };
        Err(Error::invalid(whose, what, help))
    }

    /// Refuses a receiver that is not finite, on a surface, or within λ/2π of the transmitter ([`near_field`]).
    ///
    /// # Errors
    /// Where it is and what is wrong there.
    pub fn check_receiver(&self, tx: DVec3, rx: DVec3) -> Result<()> {
        self.check_position("receiver", rx)?;
        near_field::check(&format!("receiver at {rx}"), rx.distance(tx), self.settings.frequency_hz)
    }

    /// All paths between two points: [`RadioTracer::transmitter`] and [`Transmitter::paths`] in one.
    ///
    /// # Errors
    /// Positions that are not finite, on a surface, or within λ/2π of one another.
    pub fn paths(&self, tx: DVec3, rx: DVec3) -> Result<Vec<Path>> {
        self.transmitter(tx)?.paths(rx)
    }
}

/// A transmitter with its candidate chains.
pub struct Transmitter<'t, 'a> {
    pub(super) tracer: &'t RadioTracer<'a>,
    tx: DVec3,
    chains: Vec<Chain>,
    screen: Screen,
    edge_chains: EdgeChains,
}

impl<'t, 'a> Transmitter<'t, 'a> {
    /// World position, metres.
    pub fn position(&self) -> DVec3 {
        self.tx
    }

    /// Specular candidates, for reports.
    pub fn candidate_count(&self) -> usize {
        self.chains.len()
    }

    /// All paths to a receiver (world frame, metres), sorted by length.
    ///
    /// # Errors
    /// A receiver that is not finite, on a surface, or within λ/2π of the transmitter.
    pub fn paths(&self, rx: DVec3) -> Result<Vec<Path>> {
        self.tracer.check_receiver(self.tx, rx)?;
        let mut paths: Vec<Path> = Vec::new();
        let direct = self.tracer.trace(self.tx, rx, &Chain::line_of_sight(self.tx));
        paths.extend(direct.filter(|path| self.tracer.settings.line_of_sight || !path.interactions.is_empty()));
        let passing = self.screen.passing(&self.tracer.geometry, rx);
        let traced: Vec<Vec<Path>> = passing
            .par_chunks(CHAINS_PER_TASK)
            .map(|chunk| chunk.iter().filter_map(|&chain| self.tracer.trace(self.tx, rx, &self.chains[chain as usize])).collect())
            .collect();
        paths.extend(traced.into_iter().flatten());
        paths.extend(diffraction::paths(self.tracer, self.tx, &self.edge_chains, rx));
        paths.sort_by(|a, b| a.length_m.total_cmp(&b.length_m));
        // A bounce where two faces meet belongs to both.
        let mut distinct: Vec<Path> = Vec::with_capacity(paths.len());
        for path in paths {
            let as_long = distinct.iter().rev().take_while(|other| path.length_m - other.length_m <= SAME_PATH_M);
            if !as_long.into_iter().any(|other| path.coincides(other)) {
                distinct.push(path);
            }
        }
        if let Some(path) = distinct.iter().find(|path| !path.is_finite()) {
            let what = format!("a path of type \"{}\" has a length or a coefficient that is not a finite number", path.types());
            let help = "a size, distance or material of the scene is beyond what can be computed: check its unit";
            return Err(Error::invalid(format!("receiver at {rx}"), what, help));
        }
        Ok(distinct)
    }
}
