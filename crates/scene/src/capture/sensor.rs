//! The sensor of a capture's spectra, as whoever recorded them states it: nothing in the files says it.

use super::json::read as json;
use crate::config::{AntennaPattern, RearHalfSpace, ReceiverConfig, SpectrumKind};
use crate::dataset::{Quantity, StatedSensor};
use crate::{Error, Result, bounds};
use serde::Deserialize;
use std::path::Path;

/// File of the plain layout that states a sensor.
pub(super) const FILE: &str = "spectra.json";

/// What is stated of a sensor; what is not is `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorOptions {
    /// Kind of the spectra.
    pub spectrum: Option<SpectrumKind>,
    /// The array behind spectra of beams, and the pattern of its elements.
    pub receiver: ArrayOptions,
    /// Standard deviation of an `mpc` lobe along each axis, degrees.
    pub lobe_width_deg: Option<f64>,
    /// Diagonal loading of `mvdr` in units of the covariance's mean eigenvalue.
    pub mvdr_loading: Option<f64>,
    /// Physical quantity of the spectra.
    pub quantity: Option<Quantity>,
    /// Carrier, Hz.
    pub frequency_hz: Option<f64>,
}

/// What is stated of an array.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArrayOptions {
    /// Elements along the camera's vertical axis.
    pub rows: Option<usize>,
    /// Elements along the camera's horizontal axis.
    pub cols: Option<usize>,
    /// Wavelengths between columns, then between rows.
    pub spacing_wavelengths: Option<Spacing>,
    /// Pattern of an element; isotropic if nobody says.
    pub pattern: Option<AntennaPattern>,
    /// What becomes of arrivals from behind; left out if nobody says.
    pub rear: Option<RearHalfSpace>,
}

/// Distances of neighbouring elements, wavelengths.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Spacing {
    /// In both directions.
    Both(f64),
    /// Between columns, then between rows.
    Each([f64; 2]),
}

impl Spacing {
    fn pair(self) -> [f64; 2] {
        match self {
            Self::Both(s) => [s, s],
            Self::Each(pair) => pair,
        }
    }
}

/// A statement by its key in files and its flag on the command line.
type Statement = (&'static str, &'static str, bool);

impl SensorOptions {
    /// Reads `spectra.json` of a plain capture.
    ///
    /// # Errors
    /// A file that cannot be read or has other keys.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let mut read: Self = json(
            path,
            "it may have spectrum, receiver (rows, cols, spacing_wavelengths, pattern, rear), lobe_width_deg, mvdr_loading, quantity and frequency_hz",
        )?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let place = format!("{}: receiver.pattern", path.display());
        read.receiver.pattern = read.receiver.pattern.map(|pattern| pattern.read(folder, &place, None)).transpose()?;
        Ok(read)
    }

    fn statements(&self) -> [Statement; 10] {
        let array = &self.receiver;
        [
            ("spectrum", "--rf-kind", self.spectrum.is_some()),
            ("receiver.rows", "--rf-array", array.rows.is_some()),
            ("receiver.cols", "--rf-array", array.cols.is_some()),
            ("receiver.spacing_wavelengths", "--rf-spacing", array.spacing_wavelengths.is_some()),
            ("receiver.pattern", "--rf-pattern", array.pattern.is_some()),
            ("receiver.rear", "--rf-rear", array.rear.is_some()),
            ("lobe_width_deg", "--rf-lobe-width-deg", self.lobe_width_deg.is_some()),
            ("mvdr_loading", "--rf-loading", self.mvdr_loading.is_some()),
            ("quantity", "--rf-quantity", self.quantity.is_some()),
            ("frequency_hz", "--frequency-hz", self.frequency_hz.is_some()),
        ]
    }

    /// Flag of a statement that flags make of it.
    pub(super) fn given(&self) -> Option<&'static str> {
        self.statements().into_iter().find_map(|(_, flag, given)| given.then_some(flag))
    }

    /// These statements of flags before those of a file; notes name what flags replace.
    pub(super) fn before(self, file: Self, notes: &mut Vec<String>) -> Self {
        for ((key, flag, given), (_, _, also)) in self.statements().into_iter().zip(file.statements()) {
            if given && also {
                notes.push(format!("{flag} takes the place of {FILE}'s {key}"));
            }
        }
        let (a, b) = (self.receiver, file.receiver);
        Self {
            spectrum: self.spectrum.or(file.spectrum),
            receiver: ArrayOptions {
                rows: a.rows.or(b.rows),
                cols: a.cols.or(b.cols),
                spacing_wavelengths: a.spacing_wavelengths.or(b.spacing_wavelengths),
                pattern: a.pattern.or(b.pattern),
                rear: a.rear.or(b.rear),
            },
            lobe_width_deg: self.lobe_width_deg.or(file.lobe_width_deg),
            mvdr_loading: self.mvdr_loading.or(file.mvdr_loading),
            quantity: self.quantity.or(file.quantity),
            frequency_hz: self.frequency_hz.or(file.frequency_hz),
        }
    }

    /// The sensor that these statements make, with notes of what was assumed; `flags` are those among them that the command line made.
    ///
    /// # Errors
    /// Statements that leave open what a reader of the spectra must know, contradict each other, or would change nothing.
    pub(super) fn sensor(&self, flags: &Self, notes: &mut Vec<String>) -> Result<Sensor> {
        let refuse = |flag: &str, what: String, help: &str| Err(Error::invalid(flag, what, help));
        if let Some(frequency_hz) = self.frequency_hz {
            bounds::number("--frequency-hz", frequency_hz, &bounds::FREQUENCY_HZ, "Hz; for 60 GHz write 60e9")?;
        }
        let of_sensor: Vec<Statement> = self.statements()[..8].iter().copied().filter(|s| s.2).collect();
        let Some(kind) = self.spectrum else {
            return match of_sensor.first() {
                None => Ok(Sensor::default()),
                Some((key, flag, _)) => {
                    let what =
                        format!("{flag} (key `{key}`) says of which sensor the spectra are, and nothing says of which kind");
                    refuse("--rf-kind", what, "say --rf-kind mpc, bartlett, bartlett-coherent or mvdr")
                }
            };
        };
        if let Some(quantity) = self.quantity.filter(|q| *q != Quantity::Unknown && *q != Quantity::of(kind)) {
            let what = format!("{} spectra are no values in {quantity:?}", kind.name());
            return refuse(
                "--rf-quantity",
                what,
                "mpc is power per steradian, bartlett beam power, mvdr Capon power; or leave it out",
            );
        }
        let of_array = [SpectrumKind::Bartlett, SpectrumKind::BartlettCoherent, SpectrumKind::Mvdr].contains(&kind);
        for (key, flag, _) in &of_sensor {
            let idle = match *key {
                "receiver.rows" | "receiver.cols" | "receiver.spacing_wavelengths" | "receiver.rear" => !of_array,
                "lobe_width_deg" => kind != SpectrumKind::Mpc,
                "mvdr_loading" => kind != SpectrumKind::Mvdr,
                _ => false,
            };
            if idle {
                return refuse(flag, format!("{} spectra have nothing of the kind", kind.name()), "leave it out");
            }
        }
        if let Some(width) = self.lobe_width_deg {
            bounds::number("--rf-lobe-width-deg", width, &(1e-3..=90.0), "degrees of standard deviation along an axis")?;
        }
        if let Some(loading) = self.mvdr_loading {
            bounds::number("--rf-loading", loading, &(1e-9..=1.0), "the covariance's mean eigenvalues, e.g. 0.1")?;
        }
        let receiver = match (of_array, self.receiver.pattern) {
            (true, _) => Some(self.array(kind, notes)?),
            // Of lobes an element is all there is of an array.
            (false, Some(pattern)) => Some(ReceiverConfig { rows: 1, cols: 1, pattern, ..ReceiverConfig::default() }),
            (false, None) => None,
        };
        let by_flag = flags.statements();
        let said = |(key, flag, _): &Statement| {
            let by = by_flag.iter().any(|(k, _, given)| k == key && *given);
            if by { (*flag).to_owned() } else { format!("{FILE}: {key}") }
        };
        let mut stated_by: Vec<String> = of_sensor.iter().map(said).collect();
        stated_by.dedup();
        let (lobe_width_deg, mvdr_loading) = (self.lobe_width_deg, self.mvdr_loading);
        Ok(Sensor { spectrum: Some(kind), receiver, stated: Some(StatedSensor { stated_by, lobe_width_deg, mvdr_loading }) })
    }

    fn array(&self, kind: SpectrumKind, notes: &mut Vec<String>) -> Result<ReceiverConfig> {
        let array = &self.receiver;
        let open = |flag: &str, of: &str, help: &str| {
            Error::invalid(flag, format!("{} spectra are of an array, and nothing says {of}", kind.name()), help)
        };
        let elements = array.rows.zip(array.cols);
        let (rows, cols) =
            elements.ok_or_else(|| open("--rf-array", "how many elements it has", "say --rf-array ROWSxCOLS, e.g. 8x8"))?;
        let spacing = array.spacing_wavelengths.ok_or_else(|| {
            open(
                "--rf-spacing",
                "how far they are apart",
                "say --rf-spacing in wavelengths, e.g. 0.5, or BETWEEN_COLUMNS,BETWEEN_ROWS",
            )
        })?;
        if array.pattern.is_none() {
            notes.push("the array's elements were taken to be isotropic (--rf-pattern says otherwise)".into());
        }
        if array.rear.is_none() {
            notes.push("arrivals from behind the array were taken to be shielded (--rf-rear says otherwise)".into());
        }
        let receiver = ReceiverConfig {
            rows,
            cols,
            spacing_wavelengths: spacing.pair(),
            pattern: array.pattern.unwrap_or_default(),
            rear: array.rear.unwrap_or_default(),
            ..ReceiverConfig::default()
        };
        receiver.validate("the receiver (--rf-array, --rf-spacing)")?;
        Ok(receiver)
    }
}

/// A sensor, as a data set's header keeps it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Sensor {
    pub spectrum: Option<SpectrumKind>,
    pub receiver: Option<ReceiverConfig>,
    pub stated: Option<StatedSensor>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beams() -> SensorOptions {
        let receiver = ArrayOptions {
            rows: Some(4),
            cols: Some(8),
            spacing_wavelengths: Some(Spacing::Each([0.5, 0.7])),
            ..Default::default()
        };
        SensorOptions { spectrum: Some(SpectrumKind::Bartlett), receiver, ..Default::default() }
    }

    #[test]
    fn a_stated_array_is_kept_with_who_stated_it_and_what_was_assumed() {
        let mut notes = vec![];
        let sensor = beams().sensor(&beams(), &mut notes).unwrap();
        let receiver = sensor.receiver.unwrap();
        assert_eq!((receiver.rows, receiver.cols, receiver.spacing_wavelengths), (4, 8, [0.5, 0.7]));
        assert_eq!(sensor.stated.unwrap().stated_by, ["--rf-kind", "--rf-array", "--rf-spacing"]);
        assert!(notes[0].contains("isotropic") && notes[1].contains("behind"), "{notes:?}");
        // Flags come before a file's keys, and that is said.
        let flags = SensorOptions { spectrum: Some(SpectrumKind::BartlettCoherent), ..Default::default() };
        let mut notes = vec![];
        let both = flags.before(beams(), &mut notes);
        assert_eq!(notes, ["--rf-kind takes the place of spectra.json's spectrum"]);
        let stated = both.sensor(&flags, &mut notes).unwrap().stated.unwrap();
        assert_eq!(stated.stated_by[..2], ["--rf-kind", "spectra.json: receiver.rows"]);
        assert_eq!(SensorOptions::default().sensor(&SensorOptions::default(), &mut notes).unwrap(), Sensor::default());
    }

    #[test]
    fn what_leaves_an_array_open_or_would_change_nothing_is_refused_by_its_flag() {
        let said = |options: SensorOptions| options.sensor(&options, &mut vec![]).unwrap_err().to_string();
        let lobes = SensorOptions { spectrum: Some(SpectrumKind::Mpc), ..Default::default() };
        let of = |change: fn(&mut SensorOptions), mut options: SensorOptions| {
            change(&mut options);
            said(options)
        };
        for (message, words) in [
            (of(|o| o.spectrum = None, beams()), ["--rf-kind", "receiver.rows"]),
            (of(|o| o.receiver.rows = None, beams()), ["--rf-array", "how many"]),
            (of(|o| o.receiver.rows = Some(0), beams()), ["--rf-array", "no array"]),
            (of(|o| o.receiver.spacing_wavelengths = None, beams()), ["--rf-spacing", "wavelengths"]),
            (of(|o| o.receiver.spacing_wavelengths = Some(Spacing::Both(-1.0)), beams()), ["spacing_wavelengths", "-1"]),
            (of(|o| o.lobe_width_deg = Some(1.0), beams()), ["--rf-lobe-width-deg", "leave it out"]),
            (of(|o| o.mvdr_loading = Some(0.1), beams()), ["--rf-loading", "leave it out"]),
            (of(|o| o.quantity = Some(Quantity::PowerPerSteradian), beams()), ["--rf-quantity", "beam power"]),
            (of(|o| o.receiver.rear = Some(RearHalfSpace::Gated), lobes), ["--rf-rear", "leave it out"]),
            (of(|o| o.lobe_width_deg = Some(f64::NAN), lobes), ["--rf-lobe-width-deg", "degrees"]),
        ] {
            assert!(words.iter().all(|word| message.contains(word)), "{message}");
        }
    }
}
