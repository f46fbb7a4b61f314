//! The methods by name.

pub mod corf_array;
pub mod corf_gs;
pub mod field;
mod initial;
pub mod interface;
pub mod lookup;
pub mod nerf2;
pub mod rf_3dgs;
pub mod stepwise;
pub mod wrf_gs_plus;

use crate::device::Backend;
use crate::methods::interface::Method;
use anyhow::{Result, bail};
use clap::builder::{PossibleValue, PossibleValuesParser};
use serde::{Serialize, de::DeserializeOwned};

/// All methods that `--method` and plans accept, with a line for `--help`.
pub const METHODS: &[(&str, &str)] = &[
    ("corf-gs", "coupled optimisation, optical-guided expansion: the paper's method at its best"),
    ("corf-gs-paper", "corf-gs with the paper's constants"),
    ("corf-gs-fast", "corf-gs with 40 iterations a keyframe instead of 75, overlapped with the next keyframe's expansion"),
    ("corf-gs-uniform", "ablation: every pixel spawns with probability 0.1 instead of optical-guided expansion"),
    ("corf-gs-frozen", "ablation: two stages, optical geometry frozen in the RF stage"),
    ("corf-gs-rf-tuned", "ablation: two stages, geometry refined by RF in the second"),
    ("corf-array", "beyond the paper: light as in corf-gs, radio as emitters seen through the receiver's own array"),
    ("rf-3dgs", "baseline RF-3DGS: offline 3D Gaussian splatting, then RF on its frozen geometry, as published"),
    ("rf-3dgs-corrected", "rf-3dgs with a fresh optimiser in the RF stage and the background of a direction without power"),
    ("nerf2", "baseline: NeRF² as published, an implicit field of the spectrum alone; for a GPU"),
    ("nerf2-corrected", "baseline: NeRF² with its schedule, its sampling and its last sample corrected"),
    ("wrf-gs-plus", "baseline: WRF-GS+ as published, Gaussians of the spectrum alone that a network deforms; for a GPU"),
    ("wrf-gs-plus-corrected", "wrf-gs-plus with the predicted displacements used"),
    ("nearest", "the nearest training keyframe, as it was observed"),
    ("inverse-distance", "training keyframes blended by inverse distance"),
];

/// The names that `--method` takes, with their lines for `--help`.
pub fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(METHODS.iter().map(|&(id, line)| PossibleValue::new(id).help(line)))
}

/// Makes a method; `overrides` are TOML keys of its configuration, `backend` is where it runs if it needs a device.
///
/// # Errors
/// An unknown name, or an override that is no key of the method's configuration.
pub fn create(id: &str, overrides: &toml::Table, backend: &Backend) -> Result<Box<dyn Method>> {
    match id {
        "corf-gs" | "corf-gs-paper" | "corf-gs-fast" | "corf-gs-uniform" | "corf-gs-frozen" | "corf-gs-rf-tuned" => {
            Ok(Box::new(corf_gs::CorfGs::new(id, overrides, backend)?))
        }
        "corf-array" => Ok(Box::new(corf_array::CorfArray::new(overrides, backend)?)),
        "rf-3dgs" | "rf-3dgs-corrected" => Ok(Box::new(rf_3dgs::Rf3dgs::new(id, overrides, backend)?)),
        "nerf2" | "nerf2-corrected" => Ok(Box::new(nerf2::Nerf2::new(id, overrides, backend)?)),
        "wrf-gs-plus" | "wrf-gs-plus-corrected" => Ok(Box::new(wrf_gs_plus::WrfGsPlus::new(id, overrides, backend)?)),
        "nearest" | "inverse-distance" => Ok(Box::new(lookup::Lookup::new(id, overrides)?)),
        _ => {
            let known: Vec<&str> = METHODS.iter().map(|m| m.0).collect();
            bail!("unknown method \"{id}\"\n  help: the methods are {}", known.join(", "))
        }
    }
}

/// Overrides over a configuration's defaults, table by table: part of an inner table leaves the rest of it as it is in those defaults.
///
/// # Errors
/// A key that does not exist, or a value of the wrong kind.
fn over_defaults<T: Serialize + DeserializeOwned + Default>(overrides: toml::Table) -> Result<T> {
    let mut table = toml::Table::try_from(T::default())?;
    merge(&mut table, overrides);
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
