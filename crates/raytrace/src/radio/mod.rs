//! 60 GHz: materials, paths, the diffuse field.
//!
//! A specular path is read as candidates → geometry → field: which faces a wave may bounce off (`candidates`), where it does and what is in its
//! way (`geometry`), what that makes of its amplitude (`field`). `paths` puts the three together, `tracer` keeps what serves many receivers.
//!
//! Conventions: world z up; θ zenith, φ = atan2(y, x); the angle of arrival points from the receiver towards the last interaction;
//! time convention e^{+jωt}; `a` carries no propagation phase.

mod candidates;
pub mod channel;
pub mod coverage;
mod diffraction;
pub mod diffuse;
pub mod export;
mod field;
mod geometry;
pub mod json;
pub mod lattice;
mod paths;
mod tracer;

pub use corf_scene::solids::{Parting, Solids};
pub use diffraction::{DiffractionModel, Wedge, transition};
pub use diffuse::{DiffuseField, DiffuseSettings, WorldExtent};
pub(crate) use field::antenna::over_mean_gain;
pub use field::antenna::{Angles, Antenna, AntennaArray, AntennaPattern, Beam, PlanarArray, Polarization};
pub use field::complex::Complex;
pub use field::materials::Slab;
pub use field::{antenna, fresnel, materials, scattering};
pub use geometry::Geometry;
pub use geometry::face::Face;
pub use paths::path::{Interaction, InteractionKind, Path};
pub use tracer::{RadioTracer, Transmitter};

use corf_scene::config::SpectrumConfig;
use corf_scene::{Error, Result, bounds};
use glam::DVec3;
use serde::{Deserialize, Serialize};

pub use corf_scene::near_field::SPEED_OF_LIGHT;

/// The largest number of interactions the tracer supports.
pub const MAX_INTERACTIONS: usize = 5;

/// Method of finding candidate chains of faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Search {
    /// All chains where there are few enough, a lattice of this many rays otherwise.
    Auto {
        /// Rays shot from the transmitter.
        rays: usize,
    },
    /// All chains: cost grows as faces^depth.
    Exhaustive,
    /// All single faces, and longer chains from a lattice of rays.
    Lattice {
        /// Rays shot from the transmitter.
        rays: usize,
    },
}

impl Search {
    /// Rays of the lattice, where one is shot.
    fn rays(self) -> usize {
        match self {
            Self::Auto { rays } | Self::Lattice { rays } => rays,
            Self::Exhaustive => 0,
        }
    }
}

/// Settings of the radio path tracer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RadioSettings {
    /// Carrier, Hz.
    pub frequency_hz: f64,
    /// Interactions per path, reflections, transmissions and scatterings together; at most [`MAX_INTERACTIONS`].
    #[serde(alias = "max_depth", alias = "max_reflections")]
    pub max_interactions: usize,
    /// Keep the line of sight. Off, what comes straight through slabs stays, as in Sionna RT: that is transmission's.
    pub line_of_sight: bool,
    /// Trace specular reflections.
    pub reflection: bool,
    /// Let rays pass straight through slabs; every crossing counts as an interaction. Off: everything is opaque.
    pub transmission: bool,
    /// Trace paths that diffract once at an edge between faces, reflected and transmitted before and after as the other switches say.
    pub diffraction: bool,
    /// Diffraction at open edges of single sheets as well.
    pub edge_diffraction: bool,
    /// Diffraction into the region that the edge does not shadow as well, where the total field needs it to be continuous.
    pub diffraction_lit_region: bool,
    /// Model of the faces' reflections in the diffraction coefficient.
    pub diffraction_model: DiffractionModel,
    /// Method of finding candidate chains.
    pub search: Search,
    /// Faces smaller than this do not reflect specularly, m². The tessellation of a curved object yields flashes from facets far
    /// smaller than the first Fresnel zone (0.04 m² half way along 5 m at 60 GHz), where the image method has no meaning; 0 keeps all.
    pub min_face_area_m2: f64,
    /// Paths of less power ([`Path::received`]) than this are dropped, dB relative to 1 W transmitted.
    pub min_gain_db: f64,
    /// Transmit antenna.
    pub tx_antenna: Antenna,
    /// Receive element; one path set serves every view at a position, so it does not turn with the platform.
    pub rx_antenna: Antenna,
}

impl Default for RadioSettings {
    fn default() -> Self {
        Self {
            frequency_hz: 60e9,
            max_interactions: SpectrumConfig::default().max_interactions,
            line_of_sight: true,
            reflection: true,
            transmission: true,
            diffraction: false,
            edge_diffraction: false,
            diffraction_lit_region: true,
            diffraction_model: DiffractionModel::default(),
            search: Search::Auto { rays: SpectrumConfig::default().rays },
            min_face_area_m2: 0.0,
            min_gain_db: -300.0,
            tx_antenna: Antenna::default(),
            rx_antenna: Antenna::default(),
        }
    }
}

impl RadioSettings {
    /// Free-space wavelength, metres.
    pub fn wavelength_m(&self) -> f64 {
        SPEED_OF_LIGHT / self.frequency_hz
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// The first setting out of range, by name.
    pub fn validate(&self) -> Result<()> {
        let fault = |key: &str, what: String, help: &str| Err(Error::invalid(format!("radio settings, `{key}`"), what, help));
        if !bounds::FREQUENCY_HZ.contains(&self.frequency_hz) {
            return fault("frequency_hz", format!("{:?}", self.frequency_hz), "give the carrier in Hz, 1e6 to 1e13, e.g. 60e9");
        }
        if self.search.rays() > bounds::MAX_RAYS {
            return fault("rays", format!("{}", self.search.rays()), "give at most 100 000 000");
        }
        if self.max_interactions > MAX_INTERACTIONS {
            return fault("max_interactions", format!("{}", self.max_interactions), "at most 5 interactions are supported");
        }
        if self.min_gain_db.is_nan() {
            return fault("min_gain_db", "it is no number".into(), "give decibels, e.g. -200");
        }
        if !(self.min_face_area_m2.is_finite() && self.min_face_area_m2 >= 0.0) {
            return fault("min_face_area_m2", format!("{}", self.min_face_area_m2), "give an area of at least 0");
        }
        Ok(())
    }
}

/// Power arriving at a receiver from one direction: a specular path or a piece of the diffuse field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Unit, world frame, from the receiver towards the last interaction.
    pub direction: DVec3,
    /// |a|², linear, relative to 1 W transmitted.
    pub power: f64,
    /// Delay, seconds.
    pub delay_s: f64,
    /// The scene object of the last interaction; `u32::MAX` for the line of sight.
    pub object: u32,
    /// The phase of the coefficient, propagation included, radians; `None` for power scattered without a definite phase.
    pub phase_rad: Option<f64>,
}

impl Arrival {
    /// A path as the first ports of both antennas see it.
    pub fn from_path(path: &Path, frequency_hz: f64) -> Self {
        let object = path.interactions.last().map_or(u32::MAX, |i| i.object);
        let phase_rad = path.a.im.atan2(path.a.re) - std::f64::consts::TAU * (frequency_hz * path.delay_s).fract();
        Self { direction: path.arrival, power: path.power(), delay_s: path.delay_s, object, phase_rad: Some(phase_rad) }
    }
}
