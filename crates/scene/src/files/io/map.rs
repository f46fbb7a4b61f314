//! Maps of one number a pixel, as networks, sensors and other tools leave them.

use super::{decode_exr, decode_image, floats, read, wrong_channels};
use crate::npz::{self, Scalar};
use crate::{Error, Raster, Result, bounds};
use exr::prelude::{Compression, FlatSamples};
use image::DynamicImage;
use std::ops::RangeInclusive;
use std::path::Path;

/// Metres that a step of a picture of depth counts where nothing says otherwise: millimetres.
pub const PICTURE_DEPTH_UNIT_M: f64 = 1e-3;
/// Metres that a unit of a depth map may count.
pub const DEPTH_UNIT_M: RangeInclusive<f64> = 1e-9..=1e3;
/// Step between the numbers of half precision next to zero: 2⁻²⁴. What is under half of it is zero there.
pub const HALF_STEP: f64 = 1.0 / (1 << 24) as f64;
/// Steps of half precision that a power has at least if its level is to be right to 0.14 dB.
const HALF_STEPS: f64 = 16.0;

/// How a file holds the numbers of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stored {
    /// Single or double precision.
    Float,
    /// Half precision: eleven bits, 6·10⁻⁸ to 65 504.
    Half,
    /// A lossy compression of numbers in half precision (B44, DWAA, DWAB), which does not say how far it is off.
    Lossy,
    /// Whole numbers: what one counts stands outside of the file.
    Whole,
    /// Steps of a 16-bit picture, which are whole numbers too.
    Picture,
}

/// One number a pixel, as it is in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// The numbers.
    pub values: Raster<f32>,
    /// How the file holds them.
    pub stored: Stored,
}

/// What a map is of: it decides which channel of an EXR is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapOf {
    /// Depths: channel `Z`, or `Y`, or the only one.
    Depth,
    /// Powers: channel `Y`, or the only one.
    Power,
}

impl MapOf {
    /// Channels of an EXR that may hold it beside others, the first before the second.
    fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Depth => &["Z", "Y"],
            Self::Power => &["Y"],
        }
    }
}

/// Reads a map of one number a pixel, as it is in the file: an EXR's channel (see [`MapOf`]); a 16-bit grey PNG; or a `.npy` of floats or
/// whole numbers in C order with two axes (rows, columns) or a third of length 1 at either end. The file's extension says which.
///
/// # Errors
/// Another extension; a file that cannot be read, is damaged, larger than [`super::MAX_PIXELS`], or holds more than one number a pixel.
pub fn read_map(path: impl AsRef<Path>, of: MapOf) -> Result<Map> {
    decode_map(&read(path.as_ref())?, path, of)
}

/// The map in a file's bytes, as [`read_map`] reads it; `path` says by its extension what they are, and names them in messages.
///
/// # Errors
/// Those of [`read_map`], but for the reading.
pub fn decode_map(bytes: &[u8], path: impl AsRef<Path>, of: MapOf) -> Result<Map> {
    let path = path.as_ref();
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("exr") => exr(bytes, path, of),
        Some("npy") => npy(bytes, path),
        Some("png") => png(bytes, path),
        _ => Err(Error::invalid(path.display().to_string(), "not named as a map is", "give an .exr, .npy or .png file")),
    }
}

impl Map {
    /// The map as z-depth in metres, 0 where there is none: sensors write what they did not see as 0, NaN or infinity. `unit_m` is how many metres a
    /// unit counts; without it that is one where the file has floats, and [`PICTURE_DEPTH_UNIT_M`] in a picture. `place` names the file, `flag` what
    /// gives the unit.
    ///
    /// # Errors
    /// Whole numbers without a unit, which are millimetres as often as not; a depth that is negative, or that no room has ([`bounds::room_depth`]).
    pub fn into_depth_m(self, unit_m: Option<f64>, place: &str, flag: &str) -> Result<Raster<f32>> {
        let unit_m = match (unit_m, self.stored) {
            (Some(unit), _) => unit,
            (None, Stored::Picture) => PICTURE_DEPTH_UNIT_M,
            (None, Stored::Whole) => {
                let help = format!("give the metres that a step counts with {flag}, or save metres as float32");
                return Err(Error::invalid(place, "holds whole numbers, which do not say what they count", help));
            }
            (None, Stored::Float | Stored::Half | Stored::Lossy) => 1.0,
        };
        let depth = self.values.map(|&d| if d.is_finite() { (f64::from(d) * unit_m) as f32 } else { 0.0 });
        if let Some(i) = depth.pixels().iter().position(|d| *d < 0.0) {
            let what = format!("pixel ({}, {}) is {} m", i % depth.width(), i / depth.width(), depth.pixels()[i]);
            return Err(Error::invalid(place, what, "depths are metres along the optical axis, at least 0"));
        }
        let help = format!("give the metres that a unit of the file counts with {flag}, and 0 where nothing was measured");
        bounds::room_depth(place, depth.pixels().iter().copied(), &help)?;
        Ok(depth)
    }

    /// The map as linear power.
    ///
    /// # Errors
    /// Whole numbers, which are levels of a picture or counts of something; a number that is not finite or negative.
    pub fn into_power(self, place: &str, help: &str) -> Result<Raster<f32>> {
        if matches!(self.stored, Stored::Whole | Stored::Picture) {
            let what = "holds whole numbers, which are levels or counts and no linear power";
            return Err(Error::invalid(place, what, "save the power itself as float32"));
        }
        match self.values.pixels().iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            None => Ok(self.values),
            Some(i) => {
                let at = (i % self.values.width(), i / self.values.width());
                Err(Error::invalid(place, format!("pixel {at:?} is {}", self.values.pixels()[i]), help))
            }
        }
    }
}

impl Stored {
    /// Lowest level to which linear power is held so that it is right to 0.14 dB, dB; none where all of single precision is there.
    pub fn floor_db(self) -> Option<f64> {
        matches!(self, Self::Half | Self::Lossy).then(|| 10.0 * (HALF_STEPS * HALF_STEP).log10())
    }

    /// What it does not hold of linear power, in words; nothing where there is nothing to say.
    pub fn words_of_power(self) -> Option<String> {
        let (floor, zero) = (self.floor_db()?, 10.0 * (0.5 * HALF_STEP).log10());
        let what = match self {
            Self::Lossy => {
                "a lossy compression of half precision (B44, DWAA or DWAB), which does not say how far it is off; half precision alone is such that"
            }
            _ => "half precision, eleven bits:",
        };
        Some(format!("{what} levels are right to 0.14 dB down to {floor:.1} dB, and under {zero:.1} dB there is only zero"))
    }

    /// What it does not hold of numbers of any other kind, in words; nothing where there is nothing to say.
    pub fn words(self) -> Option<&'static str> {
        match self {
            Self::Half => Some("half precision: eleven bits, so that a number is right to a 2048th of itself"),
            Self::Lossy => Some(
                "a lossy compression of half precision (B44, DWAA or DWAB): a number is right to a 2048th of itself at best, and the file does not say how \
                 far it is off",
            ),
            Self::Float | Self::Whole | Self::Picture => None,
        }
    }
}

/// Whether DWA cuts a channel: by the last part of its name (the technical introduction to OpenEXR, section on DWAA and DWAB). Others are kept as
/// they are.
fn cut_by_dwa(channel: &str) -> bool {
    let last = channel.rsplit('.').next().unwrap_or(channel).to_ascii_uppercase();
    matches!(last.as_str(), "R" | "G" | "B" | "Y" | "RY" | "BY")
}

fn exr(bytes: &[u8], path: &Path, of: MapOf) -> Result<Map> {
    let (compression, (width, height, channels)) = decode_exr(bytes, path)?;
    let named = |name: &&str| channels.iter().find(|(n, _)| n == name);
    let only = || channels.first().filter(|_| channels.len() == 1);
    let Some((name, samples)) = of.channels().iter().find_map(named).or_else(only) else {
        let wanted = format!("a channel {}, or a single one", of.channels().join(" or "));
        return Err(wrong_channels(path, &channels, &wanted));
    };
    let stored = match (samples, compression) {
        (FlatSamples::U32(_), _) => Stored::Whole,
        (_, Compression::DWAA(_) | Compression::DWAB(_)) if cut_by_dwa(name) => Stored::Lossy,
        (FlatSamples::F16(_), Compression::B44 | Compression::B44A) => Stored::Lossy,
        (FlatSamples::F16(_), _) => Stored::Half,
        (FlatSamples::F32(_), _) => Stored::Float,
    };
    Ok(Map { values: Raster::from_vec(width, height, floats(samples)), stored })
}

fn npy(bytes: &[u8], path: &Path) -> Result<Map> {
    let place = path.display().to_string();
    let npz::NpyNumbers { shape, values, stored } = npz::decode_npy(bytes, &place)?;
    let (height, width) = match *shape.as_slice() {
        [height, width] | [height, width, 1] | [1, height, width] => (height, width),
        _ => return Err(Error::invalid(place, format!("its shape is {shape:?}"), "save an array of shape (rows, columns)")),
    };
    if values.is_empty() {
        return Err(Error::invalid(place, format!("its shape is {shape:?}: a map without pixels"), "save it again"));
    }
    let stored = match stored {
        Scalar::Whole => Stored::Whole,
        Scalar::Float(2) => Stored::Half,
        Scalar::Float(_) => Stored::Float,
    };
    Ok(Map { values: Raster::from_vec(width, height, values.into_iter().map(|v| v as f32).collect()), stored })
}

fn png(bytes: &[u8], path: &Path) -> Result<Map> {
    match decode_image(bytes, path, |image| image)? {
        DynamicImage::ImageLuma16(grey) => {
            let (width, height) = (grey.width() as usize, grey.height() as usize);
            let values = Raster::from_vec(width, height, grey.into_raw().into_iter().map(f32::from).collect());
            Ok(Map { values, stored: Stored::Picture })
        }
        other => Err(Error::invalid(
            path.display().to_string(),
            format!("its pixels are {:?}, not 16-bit grey", other.color()),
            "save one number a pixel as 16-bit grey, or as .npy or .exr",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::{encode_exr_f32, encode_exr_u32, encode_png, encode_png16, write_atomic};
    use crate::npz::{Array, Values};

    #[test]
    fn every_kind_of_file_gives_the_same_map() {
        let dir = tempfile::tempdir().unwrap();
        let map = Raster::from_fn(5, 3, |x, y| (100 * y + x) as f32);
        let write = |name: &str, bytes: Vec<u8>| {
            let path = dir.path().join(name);
            write_atomic(&path, &bytes).unwrap();
            path
        };
        let npy = |shape: &[usize]| Array::new("x", shape, Values::F32(map.pixels().to_vec())).to_npy();
        let whole = Values::U32(map.pixels().iter().map(|v| *v as u32).collect());
        for (path, stored) in [
            (write("z.exr", encode_exr_f32(&map, "Z").unwrap()), Stored::Float),
            (write("v.exr", encode_exr_f32(&map, "V").unwrap()), Stored::Float),
            (write("n.EXR", encode_exr_u32(&map.map(|v| *v as u32)).unwrap()), Stored::Whole),
            (write("two.npy", npy(&[3, 5])), Stored::Float),
            (write("last.npy", npy(&[3, 5, 1])), Stored::Float),
            (write("first.npy", npy(&[1, 3, 5])), Stored::Float),
            (write("whole.npy", Array::new("x", &[3, 5], whole).to_npy()), Stored::Whole),
            (write("grey.png", encode_png16(&map.map(|v| *v as u16)).unwrap()), Stored::Picture),
        ] {
            assert_eq!(read_map(&path, MapOf::Power).unwrap(), Map { values: map.clone(), stored }, "{}", path.display());
        }
        let rgb = write("rgb.png", encode_png(&Raster::filled(5, 3, [0; 3])).unwrap());
        for (path, word) in [
            (write("one.npy", npy(&[15])), "[15]"),
            (write("none.npy", Array::new("x", &[0, 4], Values::F32(vec![])).to_npy()), "without pixels"),
            (rgb, "16-bit grey"),
            (write("a.tiff", vec![]), ".exr"),
            (dir.path().join("absent.exr"), "absent.exr"),
        ] {
            let error = read_map(&path, MapOf::Depth).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }

    #[test]
    fn a_channel_is_taken_by_what_the_map_is_of_and_a_picture_as_a_whole() {
        use exr::prelude::*;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.exr");
        let write = |names: &[&str], moved: i32| {
            let channel = |(i, name): (usize, &&str)| AnyChannel::new(*name, FlatSamples::F32(vec![i as f32 + 1.0; 6]));
            let channels = AnyChannels::sort(names.iter().enumerate().map(channel).collect());
            let attributes = LayerAttributes::default().with_position(Vec2(moved, 0));
            let layer = Layer::new((3, 2), attributes, Encoding::default(), channels);
            let display = IntegerBounds::from_dimensions((3, 2));
            Image::new(ImageAttributes::new(display), layer).write().to_file(&path).unwrap();
        };
        let read = |of| read_map(&path, of).map(|map| map.values.pixels()[0]).map_err(|e| e.to_string());
        write(&["Y", "Z"], 0);
        assert_eq!((read(MapOf::Power), read(MapOf::Depth)), (Ok(1.0), Ok(2.0)));
        write(&["B", "G", "R", "Z"], 0);
        assert_eq!(read(MapOf::Depth), Ok(4.0));
        assert!(read(MapOf::Power).unwrap_err().contains("a channel Y, or a single one"));
        write(&["Z"], 0);
        assert_eq!(read(MapOf::Power), Ok(1.0), "a single one");
        write(&["Y"], 1);
        assert!(read(MapOf::Power).unwrap_err().contains("display window"));
    }

    #[test]
    fn half_precision_and_lossy_compression_are_told() {
        use exr::prelude::*;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.exr");
        let write = |name: &str, half: bool, compression: Compression| {
            let values = [1e-12f32, 1e-6, 0.5, 4.0];
            let samples = match half {
                true => FlatSamples::F16(values.iter().map(|v| half::f16::from_f32(*v)).collect()),
                false => FlatSamples::F32(values.to_vec()),
            };
            let encoding = Encoding { compression, ..Encoding::default() };
            let channels = AnyChannels::sort([AnyChannel::new(name, samples)].into_iter().collect());
            Image::from_layer(Layer::new((2, 2), LayerAttributes::default(), encoding, channels)).write().to_file(&path).unwrap();
            read_map(&path, MapOf::Power).unwrap()
        };
        let map = write("Y", true, Compression::ZIP16);
        assert_eq!((map.stored, map.values.pixels()[0]), (Stored::Half, 0.0), "1e-12 is nothing in half precision");
        assert!(map.stored.words_of_power().unwrap().contains("down to -60.2 dB, and under -75.3 dB there is only zero"));
        assert_eq!(write("Y", false, Compression::PIZ).stored, Stored::Float);
        // B44 packs blocks of half precision, and leaves single precision as it is.
        assert_eq!(
            (write("Y", true, Compression::B44).stored, write("Y", false, Compression::B44).stored),
            (Stored::Lossy, Stored::Float)
        );
        // Which channels are cut is a matter of their names: those of light are.
        assert!(["Y", "left.R", "by"].iter().all(|c| cut_by_dwa(c)) && ["Z", "depth.Z", "V", "A"].iter().all(|c| !cut_by_dwa(c)));
    }

    #[test]
    fn depths_are_metres_or_whole_numbers_of_a_stated_unit() {
        let map = |value: f32, stored| Map { values: Raster::filled(2, 2, value), stored };
        let metres =
            |map: Map, unit| map.into_depth_m(unit, "d", "--depth-unit").map(|d| d.pixels()[0]).map_err(|e| e.to_string());
        assert_eq!(metres(map(4.0, Stored::Float), None), Ok(4.0));
        assert_eq!(metres(map(4000.0, Stored::Picture), None), Ok(4.0));
        assert_eq!(metres(map(20_000.0, Stored::Picture), Some(1.0 / 5000.0)), Ok(4.0));
        for stored in [Stored::Whole, Stored::Picture, Stored::Float, Stored::Half] {
            assert_eq!(metres(map(4000.0, stored), Some(1e-3)), Ok(4.0), "a unit that is given holds for every file");
        }
        assert_eq!(metres(map(f32::INFINITY, Stored::Float), None), Ok(0.0));
        for (map, unit, word) in [
            (map(4000.0, Stored::Whole), None, "--depth-unit"),
            (map(4.0, Stored::Whole), None, "--depth-unit"),
            (map(4000.0, Stored::Float), None, "4000"),
            (map(4.0, Stored::Picture), None, "0.004"),
            (map(400.0, Stored::Float), None, "no room"),
            (map(-1.0, Stored::Float), None, "at least 0"),
        ] {
            let message = metres(map, unit).unwrap_err();
            assert!(message.contains(word), "{message}");
        }
        assert!(map(3.0, Stored::Whole).into_power("s", "").unwrap_err().to_string().contains("whole numbers"));
        assert!(map(-3.0, Stored::Float).into_power("s", "finite").unwrap_err().to_string().contains("pixel (0, 0) is -3"));
    }
}
