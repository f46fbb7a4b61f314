//! Description of a live capture: all that its keyframes share.

use crate::config::{ReceiverConfig, SpectrumKind, TransmitterConfig};
use crate::dataset::{Dataset, DatasetHeader, Imported, Quantity, StatedSensor};
use crate::keyframe::{DbRange, Modalities};
use crate::{Error, Pinhole, Result, bounds, io};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The version of the live folder that this crate writes and reads.
pub const LIVE_SCHEMA: &str = "corf-live/1";
/// File of the description, in the live folder.
pub const DESCRIPTION: &str = "capture.toml";

/// `capture.toml` of a live folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LiveDescription {
    /// [`LIVE_SCHEMA`].
    pub schema: String,
    /// Name of the capture, e.g. `hall-3`.
    pub name: String,
    /// Number of keyframes to come, if known: it is shown, and missing ones are reported.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keyframes: Option<usize>,
    /// Physical quantity of a spectrum's values. Default `unknown`.
    #[serde(default = "unknown")]
    pub quantity: Quantity,
    /// Kind of the angular spectra, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spectrum: Option<SpectrumKind>,
    /// Standard deviation of an `mpc` lobe along each axis, degrees, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lobe_width_deg: Option<f64>,
    /// Diagonal loading of `mvdr` in units of the covariance's mean eigenvalue, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mvdr_loading: Option<f64>,
    /// Carrier, Hz, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Whether files in `depth/` belong to keyframes; each keyframe may have one. Default false: none is looked at.
    #[serde(default)]
    pub depth: bool,
    /// Metres that a unit of those files counts. Default: floats are metres, steps of a 16-bit PNG millimetres, and other whole numbers are refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_unit_m: Option<f64>,
    /// Smallest and largest corner of the space in which the platform moves, metres; a keyframe outside is refused. Default: anywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds_m: Option<[[f64; 3]; 2]>,
    /// Camera of the images.
    #[serde(rename = "optical_camera")]
    pub light_camera: Pinhole,
    /// Camera of the spectra, at the position and with the axes of the optical one.
    #[serde(rename = "rf_camera")]
    pub radio_camera: Pinhole,
    /// The one decibel range of all spectra. Its upper end must hold the strongest value to come.
    pub db_range: DbRange,
    /// The fixed transmitter, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transmitter: Option<TransmitterConfig>,
    /// The platform's array, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub receiver: Option<ReceiverConfig>,
}

fn unknown() -> Quantity {
    Quantity::Unknown
}

impl LiveDescription {
    /// Reads and checks `capture.toml` of a folder.
    ///
    /// # Errors
    /// A file that cannot be read, is of another version, or describes no cameras and no range.
    pub fn read(dir: &Path) -> Result<Self> {
        let path = dir.join(DESCRIPTION);
        let place = path.display().to_string();
        let help = "docs/live.md lists its keys";
        let text = io::read_config_text(&path)?;
        let table: toml::Table = text.parse().map_err(|e| Error::invalid(&place, format!("is no TOML: {e}"), help))?;
        // The schema first: a file of another version should say so, not complain about its keys.
        let schema = table.get("schema").and_then(|s| s.as_str()).unwrap_or("(none)");
        if schema != LIVE_SCHEMA {
            let what = format!("schema is \"{schema}\"");
            return Err(Error::invalid(place, what, format!("this version reads schema = \"{LIVE_SCHEMA}\"")));
        }
        let description: Self = toml::from_str(&text).map_err(|e| Error::invalid(&place, e.to_string(), help))?;
        description.check(&place)?;
        Ok(description)
    }

    /// The description of a finished data set, for whoever plays it back.
    ///
    /// # Errors
    /// A data set without images or without spectra.
    pub fn of(dataset: &Dataset, depth: bool) -> Result<Self> {
        let header = dataset.header();
        let (true, Some(db_range)) = (header.modalities.light, dataset.db_range()) else {
            let what = "it has no images or no spectra, and a keyframe of a live folder has both";
            return Err(Error::invalid(dataset.dir().display().to_string(), what, "play a data set of light and radio"));
        };
        Ok(Self {
            schema: LIVE_SCHEMA.to_owned(),
            name: header.name.clone(),
            keyframes: Some(dataset.len()),
            quantity: header.quantity,
            spectrum: header.spectrum,
            lobe_width_deg: header.lobe_width_deg().filter(|_| header.spectrum == Some(SpectrumKind::Mpc)),
            mvdr_loading: header.mvdr_loading().filter(|_| header.spectrum == Some(SpectrumKind::Mvdr)),
            frequency_hz: header.frequency_hz,
            depth,
            depth_unit_m: None,
            bounds_m: None,
            light_camera: dataset.light_camera(),
            radio_camera: dataset.radio_camera(),
            db_range,
            transmitter: header.transmitter,
            receiver: header.receiver,
        })
    }

    /// Its text as TOML.
    ///
    /// # Errors
    /// A number that TOML does not have.
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self)
            .map_err(|e| Error::invalid(DESCRIPTION, format!("cannot be written: {e}"), "report this as a defect"))
    }

    fn check(&self, place: &str) -> Result<()> {
        for (name, camera) in [("optical_camera", &self.light_camera), ("rf_camera", &self.radio_camera)] {
            let key = format!("{place}, key `{name}`");
            bounds::pinhole(&key, camera)?;
            bounds::in_pixels(&key, camera)?;
        }
        bounds::db_range(&format!("{place}, key `db_range`"), &self.db_range)?;
        if let Some(unit) = self.depth_unit_m {
            bounds::number(&format!("{place}, key `depth_unit_m`"), unit, &io::DEPTH_UNIT_M, "metres a unit")?;
        }
        if let Some(width) = self.lobe_width_deg {
            bounds::number(&format!("{place}, key `lobe_width_deg`"), width, &(1e-3..=90.0), "degrees")?;
        }
        if let Some(loading) = self.mvdr_loading {
            bounds::number(&format!("{place}, key `mvdr_loading`"), loading, &(1e-9..=1.0), "mean eigenvalues")?;
        }
        if let Some(frequency) = self.frequency_hz {
            bounds::number(&format!("{place}, key `frequency_hz`"), frequency, &bounds::FREQUENCY_HZ, "Hz")?;
        }
        if let Some(keyframes) = self.keyframes {
            bounds::count(&format!("{place}, key `keyframes`"), keyframes, bounds::MAX_KEYFRAMES, "keyframes")?;
        }
        if let Some([low, high]) = self.bounds_m {
            let (low, high) = (DVec3::from(low), DVec3::from(high));
            if !(low.is_finite() && high.is_finite() && low.cmplt(high).all()) {
                let what = format!("bounds_m from {low} to {high} hold nothing");
                return Err(Error::invalid(
                    place,
                    what,
                    "give [[x, y, z], [x, y, z]]: the smallest and the largest corner, metres",
                ));
            }
        }
        if let Some([low, high]) = self.bounds_m {
            bounds::position(&format!("{place}, key `bounds_m`"), DVec3::from(low))?;
            bounds::position(&format!("{place}, key `bounds_m`"), DVec3::from(high))?;
        }
        if let Some(transmitter) = &self.transmitter {
            transmitter.validate(&format!("{place}, key `transmitter`"))?;
        }
        if let Some(receiver) = &self.receiver {
            receiver.validate(&format!("{place}, key `receiver`"))?;
        }
        Ok(())
    }

    /// The header of the data set that the keyframes make, without any yet: test keyframes are those whose index can be divided by eight.
    pub fn header(&self) -> DatasetHeader {
        let notes = vec!["keyframes were taken as they landed in a live folder, numbered in that order".to_owned()];
        let (lobe_width_deg, mvdr_loading) = (self.lobe_width_deg, self.mvdr_loading);
        // Bytes of data sets of descriptions without the two keys are those of earlier versions.
        let sensor = (lobe_width_deg.is_some() || mvdr_loading.is_some()).then(|| StatedSensor {
            stated_by: vec![DESCRIPTION.to_owned()],
            lobe_width_deg,
            mvdr_loading,
        });
        let imported = Imported {
            offset_m: None,
            format: LIVE_SCHEMA.to_owned(),
            names: Vec::new(),
            up: None,
            metres_per_unit: 1.0,
            world_from_capture: None,
            db_range: Some(self.db_range),
            sensor,
            notes,
            sources: BTreeMap::new(),
        };
        let cameras = [self.light_camera, self.radio_camera];
        let levels = (self.quantity, self.db_range.max_db - self.db_range.min_db);
        DatasetHeader {
            frequency_hz: self.frequency_hz,
            transmitter: self.transmitter,
            receiver: self.receiver,
            spectrum: self.spectrum,
            ..DatasetHeader::of_capture(self.name.clone(), Modalities::BOTH, cameras, levels, imported)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "schema = \"corf-live/1\"\nname = \"hall\"\nbounds_m = [[0, 0, 0], [9, 9, 3]]\n\
        [optical_camera]\nwidth = 64\nheight = 48\nfx = 32.0\nfy = 32.0\ncx = 32.0\ncy = 24.0\n\
        [rf_camera]\nwidth = 32\nheight = 24\nfx = 16.0\nfy = 16.0\ncx = 16.0\ncy = 12.0\n\
        [db_range]\nmin_db = -110.0\nmax_db = -40.0\n[transmitter]\nposition_m = [1.0, 2.0, 3.0]\n";

    fn read(text: &str) -> Result<LiveDescription> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join(DESCRIPTION), text).unwrap();
        LiveDescription::read(dir.path())
    }

    #[test]
    fn a_description_is_read_and_written_alike() {
        let description = read(TEXT).unwrap();
        assert_eq!((description.keyframes, description.depth, description.quantity), (None, false, Quantity::Unknown));
        assert_eq!(read(&description.to_toml().unwrap()).unwrap(), description);
        let header = description.header();
        assert_eq!((header.dynamic_range_db, header.transmitter.unwrap().position_m), (70.0, [1.0, 2.0, 3.0]));
    }

    #[test]
    fn what_describes_nothing_is_refused_and_named() {
        for (from, to, word) in [
            ("corf-live/1", "corf-live/9", "corf-live/9"),
            ("width = 64", "width = 0", "optical_camera"),
            ("fx = 32.0", "fx = 1e300", "optical_camera"),
            ("fy = 16.0", "fy = 1e-300", "rf_camera"),
            ("cx = 16.0", "cx = 1e300", "rf_camera"),
            ("min_db = -110.0", "min_db = -1e300", "db_range"),
            ("max_db = -40.0", "max_db = 1e300", "db_range"),
            ("name = \"hall\"", "name = \"hall\"\ndepth_unit_m = 0", "depth_unit_m"),
            ("name = \"hall\"", "name = \"hall\"\nfrequency_hz = -1", "frequency_hz"),
            ("name = \"hall\"", "name = \"hall\"\nkeyframes = 1000000000", "keyframes"),
            ("[9, 9, 3]", "[1e300, 9, 3]", "bounds_m"),
            ("position_m = [1.0, 2.0, 3.0]", "position_m = [1.0, 2.0, 3.0]\nspacing_wavelengths = 1e300", "transmitter"),
            ("fx = 16.0", "fx = nan", "rf_camera"),
            ("max_db = -40.0", "max_db = -140.0", "db_range"),
            ("[9, 9, 3]", "[9, 0, 3]", "bounds_m"),
            ("[1.0, 2.0, 3.0]", "[1.0, inf, 3.0]", "transmitter"),
            ("name = \"hall\"", "nome = \"hall\"", "nome"),
        ] {
            assert!(TEXT.contains(from));
            let error = read(&TEXT.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains("help"), "{to}: {error}");
        }
    }
}
