//! The tracer: a scene made ready once, a transmitter's candidates, and the paths to a receiver.

use super::RadioSettings;
use super::diffraction::{Wedge, Wedges};
use super::geometry::Geometry;
use crate::bvh::Bvh;
use crate::radio::candidates::candidate_filter::CandidateFilter;
use crate::radio::candidates::chain::Chain;
use crate::radio::candidates::chains;
use crate::radio::geometry::face::Face;
use crate::radio::paths::edges::{self, EdgeChains};
use crate::radio::paths::path::{Path, SAME_PATH_M};
use crate::radio::paths::ray_path::Propagator;
use corf_scene::{Error, Result, Scene, near_field};
use glam::DVec3;
use rayon::prelude::*;

/// A point this close to a triangle is on the surface, metres: what it sees would be a matter of rounding.
const ON_SURFACE_M: f64 = 1e-6;
/// Closer than this to a surface, metres, an end of scattered power is refused: rays keep half of it clear of what they leave.
const NEAR_SURFACE_M: f64 = 1e-4;
/// Chains a task of [`Transmitter::paths`] tries.
const CHAINS_PER_TASK: usize = 32;

/// Traces one scene at one carrier.
pub struct RadioTracer<'a> {
    pub(super) geometry: Geometry<'a>,
    pub(super) settings: RadioSettings,
    wedges: Wedges,
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

    /// A tracer that tries every triangle against every segment, without a bounding volume hierarchy: right by construction, for small
    /// scenes.
    ///
    /// # Errors
    /// Those of [`RadioTracer::new`].
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

    /// Number and total length, metres, of the open edges of sheets that do not diffract though other edges do.
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

    /// Propagator of fields along routes through this scene.
    pub(super) fn propagator(&self) -> Propagator<'_, 'a> {
        Propagator { geometry: &self.geometry, settings: &self.settings }
    }

    /// Number of objects of the scene.
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
        let filter = CandidateFilter::new(&self.geometry, &chains);
        let edge_chains = EdgeChains::from_point(&self.propagator(), &self.wedges, tx);
        Ok(Transmitter { tracer: self, tx, chains, filter, edge_chains })
    }

    /// Refuses an end of links with scattered power that is not finite or closer to a surface than its rays start from it.
    ///
    /// # Errors
    /// Such a position, with its coordinates and the fault.
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
    /// Such a position, with its coordinates and the fault.
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
    filter: CandidateFilter,
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
        let propagator = self.tracer.propagator();
        let direct = propagator.trace(self.tx, rx, &Chain::line_of_sight(self.tx));
        paths.extend(direct.filter(|path| self.tracer.settings.line_of_sight || !path.interactions.is_empty()));
        let passing = self.filter.passing(&self.tracer.geometry, rx);
        let traced: Vec<Vec<Path>> = passing
            .par_chunks(CHAINS_PER_TASK)
            .map(|chunk| chunk.iter().filter_map(|&chain| propagator.trace(self.tx, rx, &self.chains[chain as usize])).collect())
            .collect();
        paths.extend(traced.into_iter().flatten());
        paths.extend(edges::paths(&propagator, &self.tracer.wedges, self.tx, &self.edge_chains, rx));
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
