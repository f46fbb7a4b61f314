//! The pattern of an antenna element: built in, or sampled in a file.

mod elements;
mod file;
mod grid;
mod kept;
mod read;
mod read_elements;
mod sampled;
mod table;

pub use elements::{ElementGrid, ElementResponses, Elements};
pub use file::PatternFile;
use file::{FileSettings, PhaseReference};
pub use sampled::{Sampled, SampledPattern};

use crate::{Error, Result};
use glam::DVec3;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::{MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;
use std::path::Path;

/// An antenna element's pattern, in its own frame (boresight +x, zenith +z).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum AntennaPattern {
    /// Isotropic: C_θ = 1.
    #[default]
    Iso,
    /// Short dipole along z: √1.5·|sinθ|.
    Dipole,
    /// 3GPP TR 38.901, Table 7.3-1.
    Tr38901,
    /// Gain over angles that a file is to say, which is not read yet.
    File(PatternFile),
    /// Gain over angles.
    Sampled(Sampled),
    /// Complex responses over angles, each element's own; of receivers alone.
    Elements(Elements),
}

/// An antenna element's pattern, in its own frame (boresight +x, zenith +z). Beside these names `{ file = "PATTERN.csv" }`: gain over angles, or of a
/// receiver each element's complex response, with `outside_db`, `normalize` and `phases` (docs/radio-model.md, Patterns from files).
#[derive(JsonSchema)]
#[serde(rename_all = "lowercase")]
#[allow(dead_code)]
enum BuiltIn {
    /// Isotropic: C_θ = 1.
    Iso,
    /// Short dipole along z: √1.5·|sinθ|.
    Dipole,
    /// 3GPP TR 38.901, Table 7.3-1.
    Tr38901,
}

const NAMES: [&str; 3] = ["iso", "dipole", "tr38901"];

impl AntennaPattern {
    /// Amplitude towards the unit direction `local` of the antenna frame: the square root of the gain, of elements that differ of their mean gain. Of a
    /// file that has not been read: not a number.
    pub fn amplitude(self, local: DVec3) -> f64 {
        match self {
            Self::Iso => 1.0,
            Self::Dipole => 1.5f64.sqrt() * local.x.hypot(local.y),
            Self::Tr38901 => {
                let zenith_deg = local.z.clamp(-1.0, 1.0).acos().to_degrees();
                let azimuth_deg = local.y.atan2(local.x).to_degrees();
                let vertical = (12.0 * ((zenith_deg - 90.0) / 65.0).powi(2)).min(30.0);
                let horizontal = (12.0 * (azimuth_deg / 65.0).powi(2)).min(30.0);
                let gain_dbi = 8.0 - (vertical + horizontal).min(30.0);
                10f64.powf(gain_dbi / 20.0)
            }
            Self::File(_) => f64::NAN,
            Self::Sampled(pattern) => 10f64.powf(pattern.gain_db(local) / 20.0),
            Self::Elements(elements) => elements.gain(local).sqrt(),
        }
    }

    /// Responses of elements that differ.
    pub fn elements(self) -> Option<Elements> {
        match self {
            Self::Elements(elements) => Some(elements),
            _ => None,
        }
    }

    /// Whether it sends to one side more than to another about the vertical axis.
    pub fn has_boresight(self) -> bool {
        !matches!(self, Self::Iso | Self::Dipole)
    }

    /// The same with its file read, where it is of one; paths are relative to `folder`. `array` are the places of a receiver's elements, whose
    /// responses a file may have one by one; without it such a file is refused.
    ///
    /// # Errors
    /// A file that cannot be read or is no pattern; `place` names the key.
    pub fn read(self, folder: &Path, place: &str, array: Option<ElementGrid>) -> Result<Self> {
        match self {
            Self::File(file) => read::read(file, folder, place, array),
            known => Ok(known),
        }
    }

    /// Refuses a pattern whose file nobody has read.
    ///
    /// # Errors
    /// That; `place` names the key.
    pub(super) fn check_read(self, place: &str) -> Result<()> {
        match self {
            Self::File(file) => Err(Error::invalid(
                place,
                format!(
                    "{} is a file, and pattern files are read of scene files, `corf paths --config` and spectra.json",
                    file.name()
                ),
                "name a built-in pattern (iso, dipole, tr38901)",
            )),
            _ => Ok(()),
        }
    }
}

impl Serialize for AntennaPattern {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Iso => NAMES[0].serialize(serializer),
            Self::Dipole => NAMES[1].serialize(serializer),
            Self::Tr38901 => NAMES[2].serialize(serializer),
            Self::File(file) => file.serialize(serializer),
            Self::Sampled(pattern) => pattern.serialize(serializer),
            Self::Elements(elements) => elements.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for AntennaPattern {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrTable;

        impl<'de> Visitor<'de> for NameOrTable {
            type Value = AntennaPattern;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("iso, dipole, tr38901, or { file = \"PATTERN.csv\" }")
            }

            fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<AntennaPattern, E> {
                match name {
                    "iso" => Ok(AntennaPattern::Iso),
                    "dipole" => Ok(AntennaPattern::Dipole),
                    "tr38901" => Ok(AntennaPattern::Tr38901),
                    other => Err(E::unknown_variant(other, &NAMES)),
                }
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<AntennaPattern, A::Error> {
                let table = Table::deserialize(MapAccessDeserializer::new(map))?;
                table.pattern().map_err(serde::de::Error::custom)
            }
        }

        deserializer.deserialize_any(NameOrTable)
    }
}

/// What is written of a file's pattern: its name and settings, and in records what was read of it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    file: String,
    #[serde(default)]
    outside_db: Option<f64>,
    #[serde(default)]
    normalize: bool,
    #[serde(default)]
    phases: Option<PhaseReference>,
    #[serde(default)]
    read: Option<SampledPattern>,
    #[serde(default)]
    read_elements: Option<ElementResponses>,
}

impl Table {
    fn pattern(self) -> Result<AntennaPattern> {
        let Self { file, outside_db, normalize, phases, read, read_elements } = self;
        let file = PatternFile::of(file, FileSettings { outside_db, normalize, phases });
        match (read, read_elements) {
            (None, None) => Ok(AntennaPattern::File(file)),
            (Some(read), None) => Ok(AntennaPattern::Sampled(Sampled::of(file, read)?)),
            (None, Some(read)) => Ok(AntennaPattern::Elements(Elements::of(file, read)?)),
            (Some(_), Some(_)) => Err(Error::invalid(file.name(), "read as a gain and as responses", "leave one of them out")),
        }
    }
}

impl JsonSchema for AntennaPattern {
    fn schema_name() -> Cow<'static, str> {
        "AntennaPattern".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        BuiltIn::json_schema(generator)
    }
}

#[cfg(test)]
mod element_tests;
#[cfg(test)]
mod tests;
