//! Encoding of spectra as training targets of the RF field, and decoding of predictions back to spectra.

use crate::{device::Planes, images::jet};
use corf_scene::{Raster, color, keyframe::DbRange};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The picture an angular power spectrum is turned into before it is learnt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RadioTarget {
    /// Three channels: the Jet colour of the scalar dB level (as the paper).
    Jet,
    /// One channel: the scalar dB level in `[0, 1]`.
    Db,
}

impl RadioTarget {
    /// Channels of the RF field, C_rf.
    pub fn channels(self) -> usize {
        match self {
            Self::Jet => 3,
            Self::Db => 1,
        }
    }

    /// The colour of a direction without power: what lies behind the RF field. Only the first C_rf channels count.
    pub fn floor_color(self) -> [f32; 3] {
        match self {
            Self::Jet => color::jet(0.0),
            Self::Db => [0.0; 3],
        }
    }

    /// The training image of a spectrum in linear power, whose unit is that of `range`.
    pub fn encode(self, spectrum: &Raster<f32>, range: &DbRange) -> Planes {
        let scalar = spectrum.pixels().iter().map(|&s| range.scalar(s));
        let pixels = match self {
            Self::Jet => scalar.flat_map(color::jet).collect(),
            Self::Db => scalar.collect(),
        };
        Planes { width: spectrum.width(), height: spectrum.height(), channels: self.channels(), pixels }
    }

    /// The training image of a spectrum without any power.
    pub fn no_power(self, width: usize, height: usize) -> Planes {
        let floor = &self.floor_color()[..self.channels()];
        Planes { width, height, channels: self.channels(), pixels: floor.repeat(width * height) }
    }

    /// The scalar dB level in `[0, 1]` of a rendered image; an off-curve Jet colour is read as the nearest one on the curve.
    pub fn scalar(self, rendered: &Planes) -> Raster<f32> {
        let pixels = match self {
            Self::Jet => jet::levels(&rendered.pixels),
            Self::Db => rendered.pixels.iter().map(|s| s.clamp(0.0, 1.0)).collect(),
        };
        Raster::from_vec(rendered.width, rendered.height, pixels)
    }
}

/// Linear power, in the unit of the spectra that `range` is of, of scalar dB levels; a scalar of 0, the floor, is no power at all.
pub fn linear_from_scalar(scalar: &Raster<f32>, range: &DbRange) -> Raster<f32> {
    scalar.map(|&s| if s <= 0.0 { 0.0 } else { range.linear(s) as f32 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Jet is pure blue from 0.11 to 0.125: no colour tells these scalars apart. Elsewhere f32 rounding is all.
    const JET_PLATEAU: f32 = 0.0151;
    const SCALAR_TOLERANCE: f32 = 2e-6;

    #[test]
    fn a_spectrum_survives_encoding_and_decoding_in_both_targets() {
        let range = DbRange { min_db: -120.0, max_db: -60.0 };
        let spectrum = Raster::from_fn(13, 5, |x, y| 10f32.powf(-12.0 + 0.09 * (x * 5 + y) as f32));
        for target in [RadioTarget::Jet, RadioTarget::Db] {
            let image = target.encode(&spectrum, &range);
            assert_eq!(image.pixels.len(), 13 * 5 * target.channels());
            let scalar = target.scalar(&image);
            let back = linear_from_scalar(&scalar, &range);
            for (&linear, (&s, &b)) in spectrum.pixels().iter().zip(scalar.pixels().iter().zip(back.pixels())) {
                let exact = range.scalar(linear);
                if target == RadioTarget::Jet && (0.11..=0.125).contains(&exact) {
                    assert!((s - exact).abs() < JET_PLATEAU, "{s} {exact}");
                    continue;
                }
                assert!((s - exact).abs() < SCALAR_TOLERANCE, "{target:?} {s} {exact}");
                assert!(exact < 1e-3 || (b / linear - 1.0).abs() < 1e-3, "{b} {linear}");
            }
        }
    }

    #[test]
    fn no_power_is_the_floor_in_both_targets() {
        let range = DbRange { min_db: -120.0, max_db: -60.0 };
        let silence = Raster::filled(2, 2, 0.0);
        for target in [RadioTarget::Jet, RadioTarget::Db] {
            let image = target.encode(&silence, &range);
            assert_eq!(&image.pixels[..target.channels()], &target.floor_color()[..target.channels()]);
            assert_eq!(image, target.no_power(2, 2));
            assert_eq!(linear_from_scalar(&target.scalar(&image), &range), silence);
        }
    }
}
