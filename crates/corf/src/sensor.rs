//! From the radio field over directions to the spectrum a receiver reports: two steps, kept apart.
//!
//! A device renders the field over the pixels of [`RfSensor::field_camera`]; [`RfSensor::observe`] then forms the spectrum on the
//! pixels of the RF image. The paper's sensor is the identity; an array whose beams gather the whole front half-space renders
//! wider than its image and mixes directions, in these two functions and nowhere else.

use crate::device::Planes;
use corf_scene::Pinhole;
use serde::{Deserialize, Serialize};

/// Measurement model of a receiver: the mapping from the RF field to its angular power spectrum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum RfSensor {
    /// The spectrum is the field on a pinhole image (the paper).
    #[default]
    Identity,
}

impl RfSensor {
    /// The directions over which the field is rendered, for a spectrum on the pixels of `rf_camera`.
    pub fn field_camera(self, rf_camera: &Pinhole) -> Pinhole {
        match self {
            Self::Identity => *rf_camera,
        }
    }

    /// The spectrum image formed from the field over [`Self::field_camera`].
    pub fn observe(self, field: Planes) -> Planes {
        match self {
            Self::Identity => field,
        }
    }
}
