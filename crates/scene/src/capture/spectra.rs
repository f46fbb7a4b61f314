//! Spectra in the forms in which they are published, as linear power.
//!
//! | file | value of a pixel |
//! |---|---|
//! | EXR, `.npy` | linear power, or decibels |
//! | grey PNG, 8 or 16 bit | level in decibels between the stated ends; black is no power |
//! | Jet PNG | the level whose Jet colour is nearest; between 0.11 and 0.125 of the range Jet is one colour |

use super::options::RfValues;
use crate::keyframe::DbRange;
use crate::{Error, Raster, Result, color, io};
use std::path::Path;

/// Endings of files that are read.
pub(super) const ENDINGS: &[&str] = &["exr", "npy", "png"];

/// How a file holds its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Numbers.
    Numbers,
    /// Grey levels.
    Grey,
    /// Jet colours.
    Jet,
}

/// Mean distance from the curve of Jet's colours above which a picture is not painted in it, of full scale: eight bits are off by 0.002, other maps by
/// more than 0.2.
const LARGEST_MISS: f32 = 0.05;

/// Middle of the scalars 0.11 to 0.125, for all of which Jet has pure blue.
const ONE_COLOUR_MIDDLE: f32 = 0.1175;

/// Reads a spectrum.
///
/// # Errors
/// A file that cannot be read, a picture without a stated range or in other colours, or a value that is no power.
pub(super) fn read(path: &Path, values: RfValues, range: Option<&DbRange>) -> Result<(Raster<f32>, Encoding)> {
    let is_picture = path.extension().and_then(|e| e.to_str()).is_some_and(|e| e.eq_ignore_ascii_case("png"));
    let place = path.display().to_string();
    if !is_picture {
        let map = io::read_map(path)?;
        let linear = match values {
            RfValues::Linear => map,
            RfValues::Db => map.map(|&db| 10f64.powf(f64::from(db) / 10.0) as f32),
        };
        if let Some(i) = linear.pixels().iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            let what =
                format!("pixel ({}, {}) is {} as linear power", i % linear.width(), i / linear.width(), linear.pixels()[i]);
            return Err(Error::invalid(place, what, "linear power is finite and at least 0; for decibels say --rf-values db"));
        }
        return Ok((linear, Encoding::Numbers));
    }
    let Some(range) = range else {
        let help = "say which levels its darkest and brightest values are, e.g. --rf-db=-110,-40";
        return Err(Error::invalid(place, "a picture of a spectrum does not say what its levels are", help));
    };
    let picture = io::read_png16(path)?.map(|p| p.map(|v| f32::from(v) / 65535.0));
    let power = |scalar: f32| if scalar > 0.0 { range.linear(scalar) as f32 } else { 0.0 };
    if picture.pixels().iter().all(|[r, g, b]| r == g && g == b) {
        return Ok((picture.map(|p| power(p[0])), Encoding::Grey));
    }
    // All of a part of the range has one colour: its middle is off by the least.
    let scalar = picture.map(|&p| if p == [0.0, 0.0, 1.0] { ONE_COLOUR_MIDDLE } else { color::scalar_from_jet(p) });
    let miss = |(p, s): (&[f32; 3], &f32)| color::jet(*s).iter().zip(p).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let mean = picture.pixels().iter().zip(scalar.pixels()).map(miss).sum::<f32>() / scalar.pixels().len() as f32;
    if mean > LARGEST_MISS {
        let what = format!("its colours are neither grey nor Jet ({:.0} % off Jet on average)", 100.0 * mean);
        return Err(Error::invalid(place, what, "give the values themselves (EXR, .npy), or a grey picture of the levels"));
    }
    Ok((scalar.map(|&s| power(s)), Encoding::Jet))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: DbRange = DbRange { min_db: -110.0, max_db: -40.0 };

    #[test]
    fn pictures_are_levels_of_the_stated_range() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.png");
        let levels = Raster::from_fn(16, 8, |x, y| (x + 16 * y) as f32 / 127.0);
        // 16 bits of grey: as exact as float32 over 70 dB.
        io::write_atomic(&path, &io::encode_png16(&levels.map(|s| (s * 65535.0).round() as u16)).unwrap()).unwrap();
        let (linear, encoding) = read(&path, RfValues::Linear, Some(&RANGE)).unwrap();
        assert_eq!(encoding, Encoding::Grey);
        let worst = |linear: &Raster<f32>| {
            linear.pixels().iter().zip(levels.pixels()).map(|(l, s)| (RANGE.scalar(*l) - s).abs()).fold(0.0, f32::max)
        };
        assert!(worst(&linear) < 1.0 / 65535.0);
        assert_eq!(linear.pixels()[0], 0.0, "black is no power");
        assert!((10.0 * f64::from(linear.pixels()[127]).log10() + 40.0).abs() < 1e-5, "white is the upper end");
        // Eight bits of grey are a 255th. Jet stands still between 0.11 and 0.125, where its colours tell no more; elsewhere they are as good.
        io::write_png(&path, &levels.map(|s| [color::quantize8(*s); 3])).unwrap();
        assert!(worst(&read(&path, RfValues::Linear, Some(&RANGE)).unwrap().0) < 0.51 / 255.0);
        io::write_png(&path, &levels.map(|s| color::jet(*s).map(color::quantize8))).unwrap();
        let (linear, encoding) = read(&path, RfValues::Linear, Some(&RANGE)).unwrap();
        assert_eq!(encoding, Encoding::Jet);
        assert!(worst(&linear) < 0.5 * (0.125 - 0.11) + 1.0 / 255.0, "{}", worst(&linear));
        let elsewhere = linear.map(|&l| RANGE.scalar(l));
        let changing = elsewhere.pixels().iter().zip(levels.pixels()).filter(|(_, s)| !(0.1..0.135).contains(*s));
        assert!(changing.map(|(l, s)| (l - s).abs()).fold(0.0, f32::max) < 0.5 / 255.0);
        assert!(read(&path, RfValues::Linear, None).unwrap_err().to_string().contains("--rf-db"));
        io::write_png(&path, &levels.map(|s| color::viridis(*s).map(color::quantize8))).unwrap();
        assert!(read(&path, RfValues::Linear, Some(&RANGE)).unwrap_err().to_string().contains("neither grey nor Jet"));
    }

    #[test]
    fn numbers_are_linear_power_or_decibels() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.exr");
        let put = |values: Raster<f32>| io::write_atomic(&path, &io::encode_exr_f32(&values, "Y").unwrap()).unwrap();
        let power = Raster::from_fn(4, 3, |x, y| 1e-9 * (x * y) as f32);
        put(power.clone());
        assert_eq!(read(&path, RfValues::Linear, None).unwrap(), (power, Encoding::Numbers));
        put(Raster::from_fn(4, 3, |x, _| if x == 0 { f32::NEG_INFINITY } else { -10.0 * x as f32 }));
        let (linear, _) = read(&path, RfValues::Db, None).unwrap();
        assert_eq!(linear.pixels()[..2], [0.0, 0.1]);
        let message = read(&path, RfValues::Linear, None).unwrap_err().to_string();
        assert!(message.contains("pixel (0, 0)") && message.contains("--rf-values db"), "{message}");
        put(Raster::filled(4, 3, f32::NAN));
        assert!(read(&path, RfValues::Db, None).is_err());
    }
}
