//! Spectra in the forms in which they are published, as linear power.
//!
//! | file | value of a pixel |
//! |---|---|
//! | EXR, `.npy` | linear power, or decibels |
//! | grey PNG, 8 or 16 bit | level in decibels between the stated ends; black is no power |
//! | Jet PNG | the level whose colour is nearest in the Jet that all of them together are painted in ([`jet`](super::jet)) |

use super::jet::{Choice, Jet, Measured};
use crate::io::{self, Stored};
use crate::keyframe::DbRange;
use crate::{Error, Raster, Result, bounds};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Endings of files that are read.
pub(super) const ENDINGS: &[&str] = &["exr", "npy", "png"];

/// Excess of a spectrum over the stated range that is rounding, dB.
const TOLERANCE_DB: f64 = 1e-5;

/// Unit of the values in EXR and `.npy` spectra.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RadioValues {
    /// Linear power.
    #[default]
    Linear,
    /// Decibels of power: 10·log10.
    Db,
}

/// How files hold their values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Encoding {
    /// Numbers.
    NpyNumbers,
    /// Grey levels.
    Grey,
    /// Colours of a Jet.
    Jet(Jet),
}

/// What is known of a set of spectra when all of them have been looked at.
#[derive(Clone, Debug)]
pub(super) struct Survey {
    /// How all of them hold their values.
    pub encoding: Encoding,
    /// Columns and rows of all of them.
    pub size: (usize, usize),
    /// How they were read, and what that does not hold.
    pub notes: Vec<String>,
}

/// What is to be known of spectra to read them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading<'a> {
    /// Unit of the values of files that are no pictures.
    pub values: RadioValues,
    /// Levels of black and white, of blue and red, or the range of the data set.
    pub range: Option<&'a DbRange>,
    /// Width of the range below the strongest value where none is stated, dB.
    pub dynamic_range_db: f64,
}

/// One file, looked at.
struct Seen {
    size: (usize, usize),
    /// Largest value as linear power; pictures are within their range.
    peak: f32,
    kind: Kind,
}

enum Kind {
    NpyNumbers(Stored),
    Grey,
    Colours(Box<Measured>),
}

impl Kind {
    fn name(&self) -> &'static str {
        match self {
            Self::NpyNumbers(_) => "numbers",
            Self::Grey => "a grey picture",
            Self::Colours(_) => "a picture in Jet",
        }
    }
}

impl Reading<'_> {
    /// Looks at all files, so that what is wrong with one is known before anything is written, and what they have in common.
    ///
    /// # Errors
    /// A file that cannot be read, or is of another size or form than the first; a picture without a stated range or in other colours; a value that
    /// is no power; numbers that do not hold the range of the data set.
    pub fn survey(&self, files: &[PathBuf]) -> Result<Survey> {
        let seen: Vec<Seen> =
            files.par_iter().map(|path| self.look(path)).collect::<Vec<_>>().into_iter().collect::<Result<_>>()?;
        let place = |i: usize| files[i].display().to_string();
        let Some(first) = seen.first() else {
            return Err(Error::invalid("spectra", "there is none", "give one for every image"));
        };
        for (i, other) in seen.iter().enumerate() {
            if other.kind.name() != first.kind.name() {
                let what = format!("it is {} and {} is {}", other.kind.name(), place(0), first.kind.name());
                return Err(Error::invalid(place(i), what, "give all spectra in one form"));
            }
            if other.size != first.size {
                let what = format!(
                    "is {}x{} pixels where {} has {}x{}",
                    other.size.0,
                    other.size.1,
                    place(0),
                    first.size.0,
                    first.size.1
                );
                return Err(Error::invalid(place(i), what, "give spectra of one size"));
            }
        }
        let (encoding, notes) = match &first.kind {
            Kind::Grey => (
                Encoding::Grey,
                vec![format!("spectra were read from grey pictures over {}; black is no power", words(self.range))],
            ),
            Kind::NpyNumbers(_) => (Encoding::NpyNumbers, self.of_numbers(&seen, &place(0))?),
            Kind::Colours(_) => {
                let measured = seen.iter().fold(Measured::default(), |sum, one| match &one.kind {
                    Kind::Colours(measured) => sum.and(measured),
                    _ => sum,
                });
                let choice = measured.choice();
                (Encoding::Jet(choice.jet), vec![self.of_jet(&choice)])
            }
        };
        Ok(Survey { encoding, size: first.size, notes })
    }

    fn of_jet(&self, choice: &Choice) -> String {
        let width_db = self.range.map_or(0.0, |r| r.max_db - r.min_db);
        format!("spectra were read from Jet pictures over {}: {}", words(self.range), choice.words(width_db))
    }

    /// What there is to say of numbers; an error where they do not hold the range that the data set is to have.
    fn of_numbers(&self, seen: &[Seen], place: &str) -> Result<Vec<String>> {
        let peak = seen.iter().map(|s| s.peak).fold(0.0, f32::max);
        let min_db = if let Some(range) = self.range {
            let peak_db = 10.0 * f64::from(peak).log10();
            if peak_db > range.max_db + TOLERANCE_DB {
                let what = format!("a spectrum reaches {peak_db:.2} dB, and the stated range ends at {} dB", range.max_db);
                return Err(Error::invalid("--rf-db", what, "state a range that holds the strongest value"));
            }
            if peak > 0.0 && peak_db < range.min_db {
                let what =
                    format!("no spectrum reaches more than {peak_db:.2} dB, and the stated range begins at {} dB", range.min_db);
                return Err(Error::invalid("--rf-db", what, "state a range that holds the values, or leave it out"));
            }
            range.min_db
        } else if peak > 0.0 {
            let max_db = (10.0 * f64::from(peak).log10()).ceil();
            let range = DbRange { min_db: max_db - self.dynamic_range_db, max_db };
            bounds::db_range(&format!("{place} and the others"), &range)?;
            range.min_db
        } else {
            0.0
        };
        let unit = if self.values == RadioValues::Db { "decibels" } else { "linear power" };
        let mut notes = vec![format!("spectra were read as numbers: {unit}")];
        let kept = |s: &Seen| match s.kind {
            Kind::NpyNumbers(stored) => stored,
            _ => Stored::Float,
        };
        for stored in [Stored::Half, Stored::Lossy] {
            let count = seen.iter().filter(|s| kept(s) == stored).count();
            let (Some(floor_db), Some(of_power), Some(of_any)) = (stored.floor_db(), stored.words_of_power(), stored.words())
            else {
                continue;
            };
            match (count, self.values) {
                (0, _) => {}
                (_, RadioValues::Db) => notes.push(format!("{count} of {} spectra are stored in {of_any}", seen.len())),
                (_, RadioValues::Linear) if min_db >= floor_db => {
                    notes.push(format!("{count} of {} spectra are stored in {of_power}", seen.len()));
                }
                (_, RadioValues::Linear) => {
                    let what = format!(
                        "{count} of {} spectra are stored in {of_power}; the data set's range begins at {min_db:.1} dB",
                        seen.len()
                    );
                    let help = "save them as float32 without loss, or as decibels (--rf-values db), or state a range that they hold with --rf-db or \
                                --dynamic-range-db";
                    return Err(Error::invalid(place, what, help));
                }
            }
        }
        Ok(notes)
    }

    fn look(&self, path: &Path) -> Result<Seen> {
        let place = path.display().to_string();
        if !is_picture(path) {
            let (power, stored) = self.numbers(path)?;
            let peak = power.pixels().iter().copied().fold(0.0, f32::max);
            return Ok(Seen { size: (power.width(), power.height()), peak, kind: Kind::NpyNumbers(stored) });
        }
        if self.range.is_none() {
            let help = "say which levels its darkest and brightest values are, e.g. --rf-db=-110,-40";
            return Err(Error::invalid(place, "a picture of a spectrum does not say what its levels are", help));
        }
        let picture = colours(path)?;
        let kind = if is_grey(&picture) {
            Kind::Grey
        } else {
            let help = "give the values themselves (EXR, .npy), or a grey picture of the levels";
            Kind::Colours(Box::new(Measured::of(&picture).map_err(|what| Error::invalid(place, what, help))?))
        };
        Ok(Seen { size: (picture.width(), picture.height()), peak: 0.0, kind })
    }

    /// Linear power of a file of numbers, and how it holds them.
    fn numbers(&self, path: &Path) -> Result<(Raster<f32>, Stored)> {
        let map = io::read_map(path, io::MapOf::Power)?;
        let stored = map.stored;
        let linear = match self.values {
            RadioValues::Linear => map,
            // Whole decibels are decibels.
            RadioValues::Db => {
                io::Map { values: map.values.map(|&db| 10f64.powf(f64::from(db) / 10.0) as f32), stored: Stored::Float }
            }
        };
        let help = "linear power is finite and at least 0; for decibels say --rf-values db";
        Ok((linear.into_power(&path.display().to_string(), help)?, stored))
    }

    /// Reads a spectrum in a form that [`Self::survey`] found.
    ///
    /// # Errors
    /// A file that cannot be read, or that is not what it was when it was looked at.
    pub fn read(&self, path: &Path, encoding: Encoding) -> Result<Raster<f32>> {
        let (Some(range), true) = (self.range, is_picture(path)) else { return Ok(self.numbers(path)?.0) };
        let picture = colours(path)?;
        let power = |scalar: f32| if scalar > 0.0 { range.linear(scalar) as f32 } else { 0.0 };
        match encoding {
            Encoding::Jet(jet) => Ok(picture.map(|&p| power(jet.level(p)))),
            Encoding::Grey if is_grey(&picture) => Ok(picture.map(|p| power(p[0]))),
            Encoding::Grey | Encoding::NpyNumbers => Err(Error::invalid(
                path.display().to_string(),
                "it was changed while it was imported",
                "import the capture again",
            )),
        }
    }
}

/// A range in words.
fn words(range: Option<&DbRange>) -> String {
    range.map_or_else(|| "no stated range".into(), |r| format!("{} to {} dB", r.min_db, r.max_db))
}

fn is_picture(path: &Path) -> bool {
    path.extension().and_then(|e| e.to_str()).is_some_and(|e| e.eq_ignore_ascii_case("png"))
}

/// A picture's colours, RGB in `[0, 1]`.
fn colours(path: &Path) -> Result<Raster<[f32; 3]>> {
    Ok(io::read_png16(path)?.map(|p| p.map(|v| f32::from(v) / 65535.0)))
}

fn is_grey(picture: &Raster<[f32; 3]>) -> bool {
    picture.pixels().iter().all(|[r, g, b]| r == g && g == b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color;

    const RANGE: DbRange = DbRange { min_db: -110.0, max_db: -40.0 };

    fn read(path: &Path, values: RadioValues, range: Option<&DbRange>) -> Result<(Raster<f32>, Encoding)> {
        let reading = Reading { values, range, dynamic_range_db: 70.0 };
        let encoding = reading.survey(&[path.to_owned()])?.encoding;
        Ok((reading.read(path, encoding)?, encoding))
    }

    #[test]
    fn pictures_are_levels_of_the_stated_range() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.png");
        let levels = Raster::from_fn(16, 8, |x, y| (x + 16 * y) as f32 / 127.0);
        // 16 bits of grey: as exact as float32 over 70 dB.
        io::write_atomic(&path, &io::encode_png16(&levels.map(|s| (s * 65535.0).round() as u16)).unwrap()).unwrap();
        let (linear, encoding) = read(&path, RadioValues::Linear, Some(&RANGE)).unwrap();
        assert_eq!(encoding, Encoding::Grey);
        let worst = |linear: &Raster<f32>| {
            linear.pixels().iter().zip(levels.pixels()).map(|(l, s)| (RANGE.scalar(*l) - s).abs()).fold(0.0, f32::max)
        };
        assert!(worst(&linear) < 1.0 / 65535.0);
        assert_eq!(linear.pixels()[0], 0.0, "black is no power");
        assert!((10.0 * f64::from(linear.pixels()[127]).log10() + 40.0).abs() < 1e-5, "white is the upper end");
        // Eight bits of grey are a 255th. Jet stands still between 0.11 and 0.125, where its colours tell no more; elsewhere they are as good.
        io::write_png(&path, &levels.map(|s| [color::quantize8(*s); 3])).unwrap();
        assert!(worst(&read(&path, RadioValues::Linear, Some(&RANGE)).unwrap().0) < 0.51 / 255.0);
        io::write_png(&path, &levels.map(|s| color::jet(*s).map(color::quantize8))).unwrap();
        let (linear, encoding) = read(&path, RadioValues::Linear, Some(&RANGE)).unwrap();
        assert_eq!(encoding, Encoding::Jet(Jet::Matplotlib));
        assert!(worst(&linear) < 0.5 * (0.125 - 0.11) + 1.0 / 255.0, "{}", worst(&linear));
        let elsewhere = linear.map(|&l| RANGE.scalar(l));
        let changing = elsewhere.pixels().iter().zip(levels.pixels()).filter(|(_, s)| !(0.1..0.135).contains(*s));
        assert!(changing.map(|(l, s)| (l - s).abs()).fold(0.0, f32::max) < 0.5 / 255.0);
        assert!(read(&path, RadioValues::Linear, None).unwrap_err().to_string().contains("--rf-db"));
        io::write_png(&path, &levels.map(|s| color::viridis(*s).map(color::quantize8))).unwrap();
        assert!(read(&path, RadioValues::Linear, Some(&RANGE)).unwrap_err().to_string().contains("neither grey nor Jet"));
    }

    #[test]
    fn numbers_are_linear_power_or_decibels() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.exr");
        let put = |values: Raster<f32>| io::write_atomic(&path, &io::encode_exr_f32(&values, "Y").unwrap()).unwrap();
        let power = Raster::from_fn(4, 3, |x, y| 1e-9 * (x * y) as f32);
        put(power.clone());
        assert_eq!(read(&path, RadioValues::Linear, None).unwrap(), (power, Encoding::NpyNumbers));
        put(Raster::from_fn(4, 3, |x, _| if x == 0 { f32::NEG_INFINITY } else { -10.0 * x as f32 }));
        let (linear, _) = read(&path, RadioValues::Db, None).unwrap();
        assert_eq!(linear.pixels()[..2], [0.0, 0.1]);
        let message = read(&path, RadioValues::Linear, None).unwrap_err().to_string();
        assert!(message.contains("pixel (0, 0)") && message.contains("--rf-values db"), "{message}");
        put(Raster::filled(4, 3, f32::NAN));
        assert!(read(&path, RadioValues::Db, None).is_err());
    }
    #[test]
    fn all_spectra_are_of_one_form_and_hold_the_range() {
        let dir = tempfile::tempdir().unwrap();
        let put = |name: &str, bytes: Vec<u8>| {
            let path = dir.path().join(name);
            io::write_atomic(&path, &bytes).unwrap();
            path
        };
        let power = Raster::from_fn(4, 3, |x, y| 1e-9 * (1 + x * y) as f32);
        let float = put("a.exr", io::encode_exr_f32(&power, "Y").unwrap());
        let other = put("b.exr", io::encode_exr_f32(&Raster::filled(5, 3, 0.1), "Y").unwrap());
        let grey = put("c.png", io::encode_png(&Raster::filled(4, 3, [7; 3])).unwrap());
        let reading = Reading { values: RadioValues::Linear, range: Some(&RANGE), dynamic_range_db: 70.0 };
        let said = |files: &[&PathBuf], reading: &Reading<'_>| {
            let files: Vec<PathBuf> = files.iter().map(|p| (*p).clone()).collect();
            reading.survey(&files).map(|s| s.notes.join("; ")).unwrap_or_else(|e| e.to_string())
        };
        assert!(said(&[&float, &other], &reading).contains("is 5x3 pixels"));
        assert!(said(&[&float, &grey], &reading).contains("it is a grey picture"));
        // Half precision begins where a range of 70 dB has long not ended.
        let npy = |values: &[f32]| {
            let mut bytes = crate::npz::Array::new("x", &[1, 2], crate::npz::Values::F32(vec![0.0; 2])).to_npy();
            bytes.truncate(bytes.len() - 8);
            let at = bytes.windows(3).position(|w| w == b"<f4").unwrap();
            bytes[at..at + 3].copy_from_slice(b"<f2");
            bytes.extend(values.iter().flat_map(|v| half::f16::from_f32(*v).to_le_bytes()));
            bytes
        };
        let half = put("d.npy", npy(&[1e-5, 1e-9]));
        let wide = said(&[&half], &reading);
        assert!(wide.contains("half precision") && wide.contains("begins at -110.0 dB"), "{wide}");
        let narrow = DbRange { min_db: -60.0, max_db: -20.0 };
        let note = said(&[&half], &Reading { range: Some(&narrow), ..reading });
        assert!(note.starts_with("spectra were read as numbers") && note.contains("-60.2 dB"), "{note}");
        let decibels = put("e.npy", npy(&[-20.0, -90.0]));
        let note = said(&[&decibels], &Reading { values: RadioValues::Db, range: None, ..reading });
        assert!(note.contains("right to a 2048th"), "{note}");
        // Nothing is that strong.
        let strong = put("f.exr", io::encode_exr_f32(&Raster::filled(4, 3, 1e35), "Y").unwrap());
        assert!(said(&[&strong], &Reading { range: None, ..reading }).contains("out of range"));
    }
}
