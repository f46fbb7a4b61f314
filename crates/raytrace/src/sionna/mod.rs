//! The reference check: trace the scene of a reference file made with sionna-rt and compare, path by path.
//!
//! Two schemas are read: `corf-sionna-ref/1` (specular and transmitted paths, with a float64 column that this tracer must meet to
//! rounding) and `corf-sionna-diffuse-ref/1` (diffuse power per object and a Bartlett map).

mod diffuse;
mod paths;
mod reference;
mod report;

pub use reference::{DiffuseReference, Reference, ReferenceObject, SpecularReference};
pub use report::{CheckReport, Comparison};

use corf_scene::Result;
use std::path::Path;

/// Reads a reference file, traces its scene and compares.
///
/// # Errors
/// A file that cannot be read, is no reference file, or asks for what the tracer does not do. A difference is not an error: see
/// [`CheckReport::passed`].
pub fn check(path: &Path) -> Result<CheckReport> {
    match Reference::load(path)? {
        Reference::Specular(reference) => paths::check(&reference),
        Reference::Diffuse(reference) => diffuse::check(&reference),
    }
}

/// Compares a diffuse reference already in memory.
///
/// # Errors
/// Those of [`check`].
pub fn check_diffuse(reference: &DiffuseReference) -> Result<CheckReport> {
    diffuse::check(reference)
}

/// Compares a specular reference already in memory.
///
/// # Errors
/// Those of [`check`].
pub fn check_specular(reference: &SpecularReference) -> Result<CheckReport> {
    reference.validate(&reference.scene)?;
    paths::check(reference)
}
