//! The flat written form of a [`RadioMaterial`]: glTF's `extras.corf_radio` and TOML's `[radio_materials."name"]`.

use crate::model::{Permittivity, RadioMaterial, Scattering, ScatteringPattern};
use crate::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A radio material as a person writes it: either `itu`, or `relative_permittivity` with `conductivity_s_per_m`.
///
/// ```toml
/// [radio_materials."Wall paint"]
/// itu = "plasterboard"
/// thickness_m = 0.025
/// scattering_coefficient = 0.4
/// scattering_pattern = "directive"
/// alpha_r = 5
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RadioSpec {
    /// Identifier in reports; without it the ITU name, or else the material's own name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// A name of ITU-R P.2040-3, Table 3.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub itu: Option<String>,
    /// Real relative permittivity at the carrier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relative_permittivity: Option<f64>,
    /// Conductivity at the carrier, S/m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conductivity_s_per_m: Option<f64>,
    /// Slab thickness, metres; there is no default.
    pub thickness_m: f64,
    /// S in `[0, 1]`. Default 0.
    #[serde(default)]
    pub scattering_coefficient: f64,
    /// K_x in `[0, 1]`. Default 0.
    #[serde(default)]
    pub xpd: f64,
    /// `lambertian` (default), `directive` or `backscatter`.
    #[serde(default)]
    pub scattering_pattern: PatternName,
    /// Exponent α_r of the lobe around the specular direction (`directive`, `backscatter`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha_r: Option<u32>,
    /// Exponent α_i of the lobe back towards the source (`backscatter`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha_i: Option<u32>,
    /// Λ in `[0, 1]`: weight of the lobe around the specular direction (`backscatter`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda: Option<f64>,
}

/// The name of a scattering lobe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum PatternName {
    /// cosθ_s / π.
    #[default]
    Lambertian,
    /// Around the specular direction, with `alpha_r`.
    Directive,
    /// Around the specular direction and back towards the source, with `alpha_r`, `alpha_i` and `lambda`.
    Backscatter,
}

impl RadioSpec {
    /// The material this describes; `name` stands in for a missing `id`, `place` says where it was written.
    ///
    /// # Errors
    /// Both or neither of the two ways to give the permittivity, a directive lobe without `alpha_r` (or the reverse), or a
    /// value out of range.
    pub fn to_material(&self, name: &str, place: &str) -> Result<RadioMaterial> {
        let fail = |what: &str, help: &str| Err(Error::invalid(place, what, help));
        let permittivity = match (&self.itu, self.relative_permittivity, self.conductivity_s_per_m) {
            (Some(itu), None, None) => Permittivity::Itu(itu.clone()),
            (None, Some(relative_permittivity), Some(conductivity_s_per_m)) => {
                Permittivity::Constant { relative_permittivity, conductivity_s_per_m }
            }
            (None, None, None) => {
                return fail(
                    "no permittivity is given",
                    "give itu = \"concrete\" (or another name), or relative_permittivity and conductivity_s_per_m",
                );
            }
            (Some(_), _, _) => {
                return fail("itu and relative_permittivity or conductivity_s_per_m are both given", "keep one of the two ways");
            }
            _ => return fail("relative_permittivity and conductivity_s_per_m go together", "give the missing one"),
        };
        let pattern = match (self.scattering_pattern, self.alpha_r, self.alpha_i, self.lambda) {
            (PatternName::Lambertian, None, None, None) => ScatteringPattern::Lambertian,
            (PatternName::Lambertian, ..) => {
                return fail("lobe parameters with a lambertian lobe", "write scattering_pattern = \"directive\", or drop them");
            }
            (PatternName::Directive, Some(alpha_r), None, None) => ScatteringPattern::Directive { alpha_r },
            (PatternName::Directive, None, ..) => return fail("a directive lobe without alpha_r", "add alpha_r, e.g. 5"),
            (PatternName::Directive, ..) => {
                return fail(
                    "alpha_i or lambda with a directive lobe",
                    "write scattering_pattern = \"backscatter\", or drop them",
                );
            }
            (PatternName::Backscatter, Some(alpha_r), Some(alpha_i), Some(lambda)) => {
                ScatteringPattern::Backscatter { alpha_r, alpha_i, lambda }
            }
            (PatternName::Backscatter, ..) => {
                return fail("a backscatter lobe lacks a parameter", "give alpha_r, alpha_i and lambda, e.g. 5, 5 and 0.8");
            }
        };
        let material = RadioMaterial {
            id: self.id.clone().or_else(|| self.itu.clone()).unwrap_or_else(|| name.to_string()),
            permittivity,
            thickness_m: self.thickness_m,
            scattering: Scattering { coefficient: self.scattering_coefficient, xpd: self.xpd, pattern },
        };
        material.validate(place)?;
        Ok(material)
    }
}

impl From<&RadioMaterial> for RadioSpec {
    fn from(m: &RadioMaterial) -> Self {
        let (itu, relative_permittivity, conductivity_s_per_m) = match &m.permittivity {
            Permittivity::Itu(name) => (Some(name.clone()), None, None),
            Permittivity::Constant { relative_permittivity, conductivity_s_per_m } => {
                (None, Some(*relative_permittivity), Some(*conductivity_s_per_m))
            }
        };
        let (scattering_pattern, alpha_r, alpha_i, lambda) = match m.scattering.pattern {
            ScatteringPattern::Lambertian => (PatternName::Lambertian, None, None, None),
            ScatteringPattern::Directive { alpha_r } => (PatternName::Directive, Some(alpha_r), None, None),
            ScatteringPattern::Backscatter { alpha_r, alpha_i, lambda } => {
                (PatternName::Backscatter, Some(alpha_r), Some(alpha_i), Some(lambda))
            }
        };
        Self {
            id: Some(m.id.clone()),
            itu,
            relative_permittivity,
            conductivity_s_per_m,
            thickness_m: m.thickness_m,
            scattering_coefficient: m.scattering.coefficient,
            xpd: m.scattering.xpd,
            scattering_pattern,
            alpha_r,
            alpha_i,
            lambda,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(text: &str) -> Result<RadioMaterial> {
        crate::config::from_toml::<RadioSpec>(text, "test.toml")?.to_material("Wall", "test.toml")
    }

    #[test]
    fn the_written_form_round_trips() {
        for text in [
            "itu = 'glass'\nthickness_m = 0.01\nscattering_coefficient = 0.1\nscattering_pattern = 'directive'\nalpha_r = 10\nxpd = 0.2",
            "itu = 'concrete'\nthickness_m = 0.2\nscattering_pattern = 'backscatter'\nalpha_r = 5\nalpha_i = 3\nlambda = 0.75",
            "id = 'leather'\nrelative_permittivity = 1.8\nconductivity_s_per_m = 0.05\nthickness_m = 0.003",
        ] {
            let material = spec(text).unwrap();
            let written = toml::to_string(&RadioSpec::from(&material)).unwrap();
            assert_eq!(spec(&written).unwrap(), material);
        }
    }

    #[test]
    fn a_wrong_spec_says_what_to_do() {
        for (text, expected) in [
            ("itu = 'glas'\nthickness_m = 0.01", "did you mean `glass`"),
            ("itu = 'glass'", "thickness_m"),
            ("itu = 'glass'\nthickness_m = 0", "above 0"),
            ("itu = 'glass'\nthickness_m = 0.01\nrelative_permittivity = 2", "both given"),
            ("relative_permittivity = 2\nthickness_m = 0.01", "go together"),
            ("thickness_m = 0.01", "no permittivity"),
            ("itu = 'glass'\nthickness_m = 0.01\nscattering_pattern = 'directive'", "alpha_r"),
            ("itu = 'glass'\nthickness_m = 0.01\nalpha_r = 3", "directive"),
            ("itu = 'glass'\nthickness_m = 0.01\nscattering_pattern = 'directive'\nalpha_r = 3\nlambda = 0.5", "backscatter"),
            ("itu = 'glass'\nthickness_m = 0.01\nscattering_pattern = 'backscatter'\nalpha_r = 3", "alpha_i"),
            (
                "itu = 'glass'\nthickness_m = 0.01\nscattering_pattern = 'backscatter'\nalpha_r = 3\nalpha_i = 51\nlambda = 1",
                "alpha_i = 51",
            ),
            (
                "itu = 'glass'\nthickness_m = 0.01\nscattering_pattern = 'backscatter'\nalpha_r = 3\nalpha_i = 5\nlambda = 1.5",
                "lambda = 1.5",
            ),
            ("itu = 'glass'\nthickness_m = 0.01\nscattering_coeficient = 0.3", "did you mean `scattering_coefficient`"),
            ("itu = 'glass'\nthickness_m = 0.01\nscattering_coefficient = 1.5", "[0, 1]"),
        ] {
            let message = spec(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{text}\n{message}");
        }
    }
}
