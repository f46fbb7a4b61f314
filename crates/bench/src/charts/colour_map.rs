//! Colour maps: the colour of a level in `[0, 1]`.

use super::Colour;
use clap::ValueEnum;
use corf_scene::Raster;
use corf_scene::color::{jet, quantize8, srgb_from_linear};

/// The colour map of levels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ColourMap {
    /// Dark plum over red to light yellow: equal steps of a level are equal steps of lightness, in print and to every eye.
    #[default]
    Perceptual,
    /// Jet, in which the literature shows spectra: its yellow and cyan look like edges where none are.
    Jet,
}

impl ColourMap {
    /// The colour of a level; what lies beyond an end has its colour.
    pub fn colour(self, level: f64) -> Colour {
        match self {
            Self::Perceptual => perceptual(level),
            Self::Jet => jet(level as f32).map(quantize8),
        }
    }

    /// A picture of levels.
    pub fn picture(self, levels: &Raster<f32>) -> Raster<Colour> {
        levels.map(|&level| self.colour(f64::from(level)))
    }
}

/// A path through Oklab's cylinder: lightness rises evenly, the hue goes once round from violet over red to yellow, and the chroma swells as far as
/// sRGB reaches.
fn perceptual(level: f64) -> Colour {
    let t = level.clamp(0.0, 1.0);
    let (lightness, hue_deg) = (0.18 + 0.76 * t, 285.0 + 180.0 * t);
    let chroma = 0.09 + 0.085 * (std::f64::consts::PI * t).sin();
    oklch(lightness, chroma, hue_deg)
}

/// A colour of Oklab (Ottosson 2020, "A perceptual color space for image processing") by lightness, chroma and hue.
fn oklch(lightness: f64, chroma: f64, hue_deg: f64) -> Colour {
    let (sin, cos) = hue_deg.to_radians().sin_cos();
    let (a, b) = (chroma * cos, chroma * sin);
    let cone = |along_a: f64, along_b: f64| (lightness + along_a * a + along_b * b).powi(3);
    let (l, m, s) = (
        cone(0.396_337_777_4, 0.215_803_757_3),
        cone(-0.105_561_345_8, -0.063_854_172_8),
        cone(-0.089_484_177_5, -1.291_485_548),
    );
    let linear = [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701 * s,
    ];
    linear.map(|v| quantize8(srgb_from_linear(v.clamp(0.0, 1.0) as f32)))
}

/// Blue (too low) – white – red (too high), `t` in `[−1, 1]`.
pub fn diverging(t: f32) -> Colour {
    let t = t.clamp(-1.0, 1.0);
    let end = if t < 0.0 { [0.13, 0.30, 0.75] } else { [0.78, 0.12, 0.14] };
    end.map(|e: f32| quantize8(1.0 + t.abs() * (e - 1.0)))
}

/// Black – violet – orange – white, `t` in `[0, 1]`.
pub fn heat(t: f32) -> Colour {
    let t = t.clamp(0.0, 1.0);
    [
        quantize8(1.8 * t),
        quantize8(1.6 * t * t),
        quantize8(if t < 0.4 { 1.4 * t } else { 0.56 - 0.93 * (t - 0.4) + 1.7 * (t - 0.4).powi(2) }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::color::linear_from_srgb;

    /// CIE lightness L* of an sRGB colour.
    fn lightness(colour: Colour) -> f64 {
        let [r, g, b] = colour.map(|v| f64::from(linear_from_srgb(f32::from(v) / 255.0)));
        let y = 0.2126 * r + 0.7152 * g + 0.0722 * b;
        if y > 0.008_856 { 116.0 * y.cbrt() - 16.0 } else { 903.3 * y }
    }

    #[test]
    fn lightness_rises_evenly_and_that_of_jet_does_not() {
        let steps = |map: ColourMap| -> Vec<f64> {
            let of = |i: i32| lightness(map.colour(f64::from(i) / 32.0));
            (1..=32).map(|i| of(i) - of(i - 1)).collect()
        };
        let even = steps(ColourMap::Perceptual);
        let mean = even.iter().sum::<f64>() / 32.0;
        assert!(mean > 2.5, "nearly the whole range of lightness is used: {mean}");
        // Oklab's lightness is not CIE's, and colours have 8 bits.
        assert!(even.iter().all(|step| (0.5 * mean..1.5 * mean).contains(step)), "{even:?}");
        assert!(steps(ColourMap::Jet).iter().any(|step| *step < 0.0));
    }

    #[test]
    fn levels_beyond_an_end_have_its_colour() {
        for map in [ColourMap::Perceptual, ColourMap::Jet] {
            assert_eq!((map.colour(-1.0), map.colour(2.0)), (map.colour(0.0), map.colour(1.0)));
            let picture = map.picture(&Raster::from_vec(2, 1, vec![0.0, 1.0]));
            assert_eq!(picture.pixels(), [map.colour(0.0), map.colour(1.0)]);
        }
        assert_eq!(ColourMap::Jet.colour(1.0), jet(1.0).map(quantize8));
        assert_eq!((diverging(0.0), diverging(-2.0), heat(0.0)), ([255; 3], diverging(-1.0), [0; 3]));
    }
}
