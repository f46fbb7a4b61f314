//! The antennas of a scene file: `[transmitter]`, `[transmitters.NAME]` and `[receiver]`.

use super::pattern::{AntennaPattern, ElementGrid};
use crate::{Error, Result, bounds};
use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[transmitter]`: an antenna, or a planar array that points a beam; 1 W altogether.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TransmitterConfig {
    /// World position, metres.
    pub position_m: [f64; 3],
    /// Attitude: where its +x (boresight) and +z point.
    #[serde(default)]
    pub orientation: Orientation,
    /// Element pattern.
    #[serde(default)]
    pub pattern: AntennaPattern,
    /// Polarisation.
    #[serde(default)]
    pub polarization: Polarization,
    /// Elements along array z. Default 1.
    #[serde(default = "one")]
    pub rows: usize,
    /// Elements along array y. Default 1.
    #[serde(default = "one")]
    pub cols: usize,
    /// Element spacing in wavelengths, `0.5` or `[between columns, between rows]`. Default 0.5.
    #[serde(default = "half", with = "spacing")]
    #[schemars(with = "[f64; 2]")]
    pub spacing_wavelengths: [f64; 2],
    /// Direction of the beam of an array of several elements. Default: boresight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beam: Option<BeamConfig>,
}

/// `transmitter.beam`: a direction in the array's own frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BeamConfig {
    /// Azimuth from boresight towards array +y (left), degrees.
    pub azimuth_deg: f64,
    /// Elevation from the array's x–y plane towards +z (up), degrees.
    pub elevation_deg: f64,
}

impl BeamConfig {
    /// Unit direction, array frame.
    pub fn direction(&self) -> DVec3 {
        let (azimuth, elevation) = (self.azimuth_deg.to_radians(), self.elevation_deg.to_radians());
        DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
    }
}

/// `[receiver]`: a planar array in its own y–z plane, boresight +x, which is the platform camera's optical axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ReceiverConfig {
    /// Elements along array z. Default 8.
    pub rows: usize,
    /// Elements along array y. Default 8.
    pub cols: usize,
    /// Element spacing in wavelengths, `0.5` or `[between columns, between rows]`. Default 0.5.
    #[serde(with = "spacing")]
    #[schemars(with = "[f64; 2]")]
    pub spacing_wavelengths: [f64; 2],
    /// Element pattern, or the file of each element's own complex response.
    pub pattern: AntennaPattern,
    /// Polarisation.
    pub polarization: Polarization,
    /// Treatment of power from behind the array's plane. Default `gated`.
    pub rear: RearHalfSpace,
}

/// Treatment of the rear half-space by a planar array, which cannot tell front from back by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum RearHalfSpace {
    /// Arrivals from behind the array's plane are left out: the platform's body shields it.
    #[default]
    Gated,
    /// They alias to the front, as they do for bare isotropic elements.
    Aliased,
}

impl Default for ReceiverConfig {
    fn default() -> Self {
        Self {
            rows: 8,
            cols: 8,
            spacing_wavelengths: half(),
            pattern: AntennaPattern::Iso,
            polarization: Polarization::V,
            rear: RearHalfSpace::Gated,
        }
    }
}

/// The polarisation of an antenna element: one port, or two that share a place.
///
/// A port of slant ζ radiates F_θ = √G·cosζ, F_φ = √G·sinζ of the element's gain G (3GPP TR 38.901 §7.3.2, model 2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
pub enum Polarization {
    /// One port along θ̂.
    #[default]
    V,
    /// One port along φ̂.
    H,
    /// Two ports, along θ̂ and along φ̂.
    VH,
    /// Two ports, slanted by −45° and +45°.
    #[serde(rename = "cross")]
    Cross,
}

impl Polarization {
    /// The slant angle of every port from θ̂ towards φ̂, radians.
    pub fn slants_rad(self) -> &'static [f64] {
        use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
        match self {
            Self::V => &[0.0],
            Self::H => &[FRAC_PI_2],
            Self::VH => &[0.0, FRAC_PI_2],
            Self::Cross => &[-FRAC_PI_4, FRAC_PI_4],
        }
    }
}

/// Intrinsic yaw, pitch, roll, degrees: `world_from_array = R_z(yaw)·R_y(pitch)·R_x(roll)`, so a positive pitch lowers the boresight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Orientation {
    /// Counter-clockwise about world z, degrees; 0 looks along +x, 180 along −x (west).
    pub yaw_deg: f64,
    /// About the turned y axis, degrees; positive looks down.
    pub pitch_deg: f64,
    /// About the boresight, degrees.
    pub roll_deg: f64,
}

impl Orientation {
    /// `rotation_world_from_array` (array frame: boresight +x, zenith +z).
    pub fn world_from_array(&self) -> DMat3 {
        DMat3::from_rotation_z(self.yaw_deg.to_radians())
            * DMat3::from_rotation_y(self.pitch_deg.to_radians())
            * DMat3::from_rotation_x(self.roll_deg.to_radians())
    }
}

impl Orientation {
    /// Checks every angle; `place` names the table in messages.
    ///
    /// # Errors
    /// The first angle that is not finite or more than a hundred turns.
    pub fn validate(&self, place: &str) -> Result<()> {
        [("yaw_deg", self.yaw_deg), ("pitch_deg", self.pitch_deg), ("roll_deg", self.roll_deg)]
            .into_iter()
            .try_for_each(|(key, angle)| bounds::number(&format!("{place}.{key}"), angle, &bounds::ANGLE_DEG, "degrees"))
    }
}

impl TransmitterConfig {
    /// World position, metres.
    pub fn position(&self) -> DVec3 {
        DVec3::from_array(self.position_m)
    }

    /// World direction of its boresight, or of its beam, where it has one: an isotropic element and a dipole send to all sides.
    pub fn facing(&self) -> Option<DVec3> {
        let has_one = self.rows * self.cols > 1 || self.pattern.has_boresight();
        has_one.then(|| self.orientation.world_from_array() * DVec3::X)
    }

    pub(crate) fn validate(&self, place: &str) -> Result<()> {
        bounds::position(&format!("{place}.position_m"), self.position())?;
        self.orientation.validate(&format!("{place}.orientation"))?;
        check_elements(self.rows, self.cols, self.spacing_wavelengths, place)?;
        self.pattern.check_read(&format!("{place}.pattern"))?;
        if self.pattern.elements().is_some() {
            let help = "give a pattern that all elements share: gain over tilt and pan";
            return Err(Error::invalid(format!("{place}.pattern"), "elements one by one are a receiver's alone", help));
        }
        let Some(beam) = self.beam else { return Ok(()) };
        if self.rows * self.cols == 1 {
            return Err(Error::invalid(
                format!("{place}.beam"),
                "one element points no beam",
                "give rows and cols, or remove beam",
            ));
        }
        if !(beam.azimuth_deg.abs() <= 180.0 && beam.elevation_deg.abs() <= 90.0) {
            return Err(Error::invalid(
                format!("{place}.beam"),
                format!("azimuth {} and elevation {} degrees are no direction", beam.azimuth_deg, beam.elevation_deg),
                "give -180 to 180 and -90 to 90 degrees from the array's boresight",
            ));
        }
        Ok(())
    }
}

impl ReceiverConfig {
    /// The places of its elements.
    pub fn elements(&self) -> ElementGrid {
        ElementGrid { rows: self.rows, cols: self.cols, spacing_wavelengths: self.spacing_wavelengths }
    }

    pub(crate) fn validate(&self, place: &str) -> Result<()> {
        self.check_elements(place)?;
        let place = format!("{place}.pattern");
        self.pattern.check_read(&place)?;
        self.pattern.elements().map_or(Ok(()), |elements| elements.check_array(&self.elements(), &place))
    }

    /// Checks the grid of elements; `place` names the table.
    ///
    /// # Errors
    /// No elements, too many, or a spacing that is none.
    pub(super) fn check_elements(&self, place: &str) -> Result<()> {
        check_elements(self.rows, self.cols, self.spacing_wavelengths, place)
    }
}

/// No array has more elements: beyond it, its covariance alone fills gigabytes.
const MAX_ELEMENTS: usize = 4096;

fn check_elements(rows: usize, cols: usize, spacing: [f64; 2], place: &str) -> Result<()> {
    let fail = |key: &str, what: String, help: &str| Err(Error::invalid(format!("{place}{key}"), what, help));
    if rows == 0 || cols == 0 {
        return fail("", format!("{rows}x{cols} elements are no array"), "give rows >= 1 and cols >= 1");
    }
    if rows.saturating_mul(cols) > MAX_ELEMENTS {
        return fail("", format!("{rows}x{cols} elements"), "give at most 4096 altogether");
    }
    let place = format!("{place}.spacing_wavelengths");
    spacing.iter().try_for_each(|s| bounds::number(&place, *s, &bounds::SPACING_WAVELENGTHS, "wavelengths, e.g. 0.5"))
}

fn one() -> usize {
    1
}

fn half() -> [f64; 2] {
    [0.5, 0.5]
}

/// `0.5`, or `[between columns, between rows]`.
mod spacing {
    use serde::de::{Error, SeqAccess, Visitor};
    use serde::{Deserializer, Serialize, Serializer};
    use std::fmt;

    pub(super) fn serialize<S: Serializer>(spacing: &[f64; 2], serializer: S) -> Result<S::Ok, S::Error> {
        if spacing[0] == spacing[1] { spacing[0].serialize(serializer) } else { spacing.serialize(serializer) }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 2], D::Error> {
        deserializer.deserialize_any(Spacing)
    }

    struct Spacing;

    impl<'de> Visitor<'de> for Spacing {
        type Value = [f64; 2];

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a spacing in wavelengths, or [between columns, between rows]")
        }

        fn visit_f64<E: Error>(self, v: f64) -> Result<Self::Value, E> {
            Ok([v, v])
        }

        fn visit_i64<E: Error>(self, v: i64) -> Result<Self::Value, E> {
            self.visit_f64(v as f64)
        }

        fn visit_u64<E: Error>(self, v: u64) -> Result<Self::Value, E> {
            self.visit_f64(v as f64)
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
            let mut next = |i: usize| seq.next_element::<f64>()?.ok_or_else(|| A::Error::invalid_length(i, &Spacing));
            let pair = [next(0)?, next(1)?];
            if seq.next_element::<f64>()?.is_some() {
                return Err(A::Error::invalid_length(3, &Spacing));
            }
            Ok(pair)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::from_toml;

    #[test]
    fn yaw_180_faces_west() {
        let o = Orientation { yaw_deg: 180.0, ..Default::default() };
        assert!((o.world_from_array() * DVec3::X + DVec3::X).length() < 1e-12);
        let down = Orientation { pitch_deg: 30.0, ..Default::default() };
        assert!(((down.world_from_array() * DVec3::X).z + 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_spacing_is_one_number_or_two() {
        let spacing = |text: &str| from_toml::<ReceiverConfig>(&format!("spacing_wavelengths = {text}"), "t.toml");
        assert_eq!(spacing("0.5").unwrap().spacing_wavelengths, [0.5, 0.5]);
        assert_eq!(spacing("1").unwrap().spacing_wavelengths, [1.0, 1.0]);
        let two = spacing("[0.5, 0.7]").unwrap();
        assert_eq!(two.spacing_wavelengths, [0.5, 0.7]);
        assert_eq!(from_toml::<ReceiverConfig>(&toml::to_string(&two).unwrap(), "t.toml").unwrap(), two);
        for bad in ["[0.5]", "[1, 2, 3]", "\"half\""] {
            let message = spacing(bad).unwrap_err().to_string();
            assert!(message.contains("t.toml:1:") && message.contains("[between columns, between rows]"), "{message}");
        }
    }

    #[test]
    fn antennas_that_are_none_are_placed() {
        let tx = |text: &str| {
            let c: TransmitterConfig = from_toml(&format!("position_m = [0, 0, 2]\n{text}"), "t.toml").unwrap();
            c.validate("t.toml: transmitter").map_err(|e| e.to_string())
        };
        tx("rows = 4\ncols = 8\nbeam = { azimuth_deg = -30, elevation_deg = 10 }").unwrap();
        for (text, expected) in [
            ("rows = 0", "transmitter: 0x1 elements"),
            ("rows = 100\ncols = 100", "at most 4096"),
            ("spacing_wavelengths = [0.5, -1]", "transmitter.spacing_wavelengths"),
            ("beam = { azimuth_deg = 3 }", "transmitter.beam: one element"),
            ("cols = 2\nbeam = { elevation_deg = 100 }", "transmitter.beam: azimuth 0 and elevation 100"),
        ] {
            let message = tx(text).unwrap_err();
            assert!(message.contains(expected), "{message}");
        }
        let message = from_toml::<ReceiverConfig>("rear = \"gatted\"", "t.toml").unwrap_err().to_string();
        assert!(message.contains("did you mean `gated`"), "{message}");
    }

    #[test]
    fn a_beam_points_left_and_up() {
        let direction = BeamConfig { azimuth_deg: 90.0, elevation_deg: 0.0 }.direction();
        assert!((direction - DVec3::Y).length() < 1e-12);
        assert!(BeamConfig { azimuth_deg: 0.0, elevation_deg: 30.0 }.direction().z > 0.49);
    }
}
