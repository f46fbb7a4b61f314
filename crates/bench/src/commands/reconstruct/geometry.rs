//! `--geometry RUN`: what there is to say of a finished run whose light and geometry are kept.

use crate::device::Backend;
use crate::methods::corf_gs::{GeometryConfig, StartOpacity};
use crate::methods::registry;
use crate::run::open::{raster_of, read_info};
use anyhow::{Result, ensure};
use std::path::Path;

/// The table `geometry` of the overrides, over whose keys those go that were `given`.
///
/// # Errors
/// A folder without a finished run, or one whose method keeps no Gaussians that radio could be splatted with; a key that the run decides.
pub fn table(run: &Path, given: Option<&toml::Value>) -> Result<toml::Table> {
    let info = read_info(run)?;
    let keeps = raster_of(run, &info)?.filter(|_| registry::has_radio_colours(&info.method));
    ensure!(
        keeps.is_some(),
        "--geometry {}: {} keeps no Gaussians on which radio could be learnt\n  help: name a run of corf-gs",
        run.display(),
        info.method
    );
    let of = registry::create_again(&info.method, &info.overrides, &Backend::Cpu)?;
    let config = GeometryConfig {
        run: std::path::absolute(run)?,
        gaussians_sha256: GeometryConfig::hash_of(run)?,
        uses_ground_truth_depth: of.uses_ground_truth_depth(),
        method: info.method,
        dataset: info.dataset,
        dataset_hash: info.dataset_hash,
        protocol: info.protocol,
        raster: keeps.unwrap_or_default(),
        seconds: info.seconds,
        epochs: GeometryConfig::usual_epochs(),
        opacity: StartOpacity::default(),
        rate_at_end: GeometryConfig::usual_rate_at_end(),
    };
    let mut table = toml::Table::try_from(config)?;
    for (key, value) in given.and_then(toml::Value::as_table).into_iter().flatten() {
        let is_own = ["epochs", "opacity", "rate_at_end"].contains(&key.as_str());
        ensure!(is_own || !table.contains_key(key), "key geometry.{key}: --geometry says it\n  help: leave it out");
        table.insert(key.clone(), value.clone());
    }
    Ok(table)
}
