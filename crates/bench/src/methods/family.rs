//! What the file of a method says of it: its names, how it is made and opened, its settings, and what it can do.

use super::interface::{Method, Predictor};
use crate::device::Backend;
use anyhow::Result;
use corf::RasterConfig;
use corf_scene::dataset::Dataset;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;
use std::path::Path;

/// Methods of one implementation.
pub struct Family {
    /// The methods, in the order in which lists show them.
    pub variants: &'static [Variant],
    /// Keys that a variant's name decides: a record must not say one thing and do another, so a caller may not set them.
    pub decided: &'static [&'static str],
    /// Makes the method of that name with these settings, [`settings`](super::registry::settings) of the caller's.
    pub create: fn(&str, toml::Table, &Backend) -> Result<Box<dyn Method>>,
    /// How a finished run becomes a predictor again.
    pub open: Open,
    /// Schema of the resolved configuration.
    pub schema: fn() -> schemars::Schema,
    /// Tables that resolved configurations have and users do not write: their keys stand at the top level of settings.
    pub inlined: &'static [&'static str],
    /// The rasteriser's settings in a resolved configuration; none where no Gaussians are kept that a rasteriser could draw.
    pub raster: Option<fn(&Value) -> Result<RasterConfig>>,
    /// What the family can do besides.
    pub can: Abilities,
}

/// A method of a family.
pub struct Variant {
    /// Its name for `--method`, plans and records.
    pub id: &'static str,
    /// A line for `--help` and for documents.
    pub help: &'static str,
    /// Its settings where they differ from the family's, as TOML: a caller's own go over them, but for those that the name decides.
    pub preset: &'static str,
}

/// How a finished run becomes a predictor again.
pub enum Open {
    /// From the files that it saved.
    Saved(fn(&SavedRun<'_>) -> Result<Box<dyn Predictor>>),
    /// By reconstructing again: for a lookup, which is its data set.
    Again,
}

/// A run folder that is opened.
pub struct SavedRun<'a> {
    /// The folder.
    pub folder: &'a Path,
    /// Its resolved configuration.
    pub config: &'a Value,
    /// The data set that it was made from.
    pub dataset: &'a Dataset,
    /// What renders its field.
    pub backend: &'a Backend,
}

/// What a family can do that others cannot.
#[derive(Clone, Copy, Debug, Default)]
pub struct Abilities {
    /// Keyframes are taken one by one, and the record says what each took. Its runs hold all that they need, so that a later version may resolve
    /// their configuration otherwise.
    pub online: bool,
    /// A live folder can be followed.
    pub follows: bool,
    /// Gaussians of another program can be begun with (`initial_gaussians`).
    pub begins_with_gaussians: bool,
    /// Radio is emitters seen through an array, and no splats that other programs could draw.
    pub emitters: bool,
    /// The processor does the work, whatever the device.
    pub on_processor: bool,
    /// Training keyframes are looked up, and nothing is learnt from them.
    pub looks_up: bool,
    /// Data sets are taken whose array stands still and whose transmitter moves.
    pub fixed_array: bool,
}

/// Settings over a configuration's defaults, table by table: part of an inner table leaves the rest of it as it is in those defaults.
///
/// # Errors
/// A key that does not exist, or a value of the wrong kind.
pub(super) fn over_defaults<T: Serialize + DeserializeOwned + Default>(settings: toml::Table) -> Result<T> {
    let mut table = toml::Table::try_from(T::default())?;
    merge(&mut table, settings);
    Ok(table.try_into()?)
}

/// Puts `from` over `into`, table by table.
pub fn merge(into: &mut toml::Table, from: toml::Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(old)), toml::Value::Table(new)) => merge(old, new),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}
