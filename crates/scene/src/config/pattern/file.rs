//! Files of antenna patterns, as configurations name them.

use super::kept;
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};
use std::sync::Mutex;

/// A pattern's file and how it is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatternFile {
    /// Relative to the file that names it. Kept as long as the process runs, once.
    file: &'static str,
    settings: FileSettings,
}

/// How a pattern's file is read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct FileSettings {
    /// Gain beyond the file's grid, in the file's decibels.
    pub outside_db: Option<f64>,
    /// Whether its gains are shifted to a mean of 1 over the sphere.
    pub normalize: bool,
    /// What phases are counted from, where the file has some.
    pub phases: Option<PhaseReference>,
}

/// What the phases of an array's elements are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum PhaseReference {
    /// One point for all, the array's centre: they hold the phases of the elements' places.
    Array,
    /// Each element's own place.
    Element,
}

// What is not finite is refused before it is compared.
impl Eq for PatternFile {}

impl std::hash::Hash for PatternFile {
    fn hash<H: std::hash::Hasher>(&self, state: &mut H) {
        self.file.hash(state);
    }
}

static NAMES: Mutex<Vec<&'static String>> = Mutex::new(Vec::new());

impl PatternFile {
    pub(super) fn of(file: String, settings: FileSettings) -> Self {
        Self { file: kept::once(&NAMES, file).as_str(), settings }
    }

    /// Its name, as it was given.
    pub fn name(&self) -> &'static str {
        self.file
    }

    /// Gain beyond the file's grid, in the file's decibels.
    pub(super) fn outside_db(&self) -> Option<f64> {
        self.settings.outside_db
    }

    /// What its phases are counted from, where that is stated.
    pub(super) fn phases(&self) -> Option<PhaseReference> {
        self.settings.phases
    }

    pub(super) fn entries<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        map.serialize_entry("file", self.file)?;
        if let Some(outside_db) = self.settings.outside_db {
            map.serialize_entry("outside_db", &outside_db)?;
        }
        if self.settings.normalize {
            map.serialize_entry("normalize", &true)?;
        }
        if let Some(phases) = self.settings.phases {
            map.serialize_entry("phases", &phases)?;
        }
        Ok(())
    }

    /// Whether its gains are shifted to a mean of 1 over the sphere.
    pub(super) fn is_normalized(&self) -> bool {
        self.settings.normalize
    }
}

impl Serialize for PatternFile {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        self.entries(&mut map)?;
        map.end()
    }
}
