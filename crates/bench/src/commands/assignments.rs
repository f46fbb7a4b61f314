//! `--set KEY=VALUE`: keys of a configuration on the command line.

use crate::methods;
use anyhow::Result;
use clap::Args;
use corf_scene::config::DatasetConfig;
use std::path::Path;

/// Keys of a data set's configuration, changed on the command line.
#[derive(Args)]
pub struct DatasetKeys {
    /// One key of the configuration, `key=value` in TOML notation, e.g. optical.effort=4; may be repeated and wins over the file.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
}

impl DatasetKeys {
    /// The configuration of a file with these keys changed.
    ///
    /// # Errors
    /// As [`DatasetConfig::load_with`]; a line that is not `KEY=VALUE`.
    pub fn load(&self, path: &Path) -> Result<DatasetConfig> {
        let overrides = table(&self.overrides)?;
        Ok(DatasetConfig::load_with(path, |file| methods::merge(file, overrides))?)
    }
}

/// The table that `--set` lines say together; a later line wins.
///
/// # Errors
/// A line is not `KEY=VALUE`.
pub fn table(lines: &[String]) -> Result<toml::Table> {
    let mut table = toml::Table::new();
    for line in lines {
        methods::merge(&mut table, assignment(line)?);
    }
    Ok(table)
}

/// `KEY=VALUE` of `--set`: TOML, or a word without quotes, which is a string.
fn assignment(line: &str) -> Result<toml::Table> {
    let refused = |error: toml::de::Error| {
        anyhow::Error::new(error).context(format!(
            "--set {line} is not KEY=VALUE\n  help: e.g. --set iterations_per_keyframe=50 or --set rf_target=db"
        ))
    };
    line.parse().or_else(|error| match line.split_once('=') {
        Some((key, word)) if !word.trim().is_empty() && !word.contains(['"', '\'', '[', '{', '=', '#']) => {
            format!("{key} = {}", toml::Value::String(word.trim().to_owned())).parse().map_err(refused)
        }
        _ => Err(refused(error)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_need_no_quotes_and_numbers_stay_numbers() {
        let is = |line: &str, toml: &str| assert_eq!(assignment(line).unwrap(), toml.parse().unwrap(), "{line}");
        is("depth.prior=none", "depth.prior = \"none\"");
        is("depth.prior=none", "depth.prior = \"none\"");
        is("depth.folder=../my maps/a-1", "depth.folder = \"../my maps/a-1\"");
        is("depth.folder = C:\\maps", r"depth.folder = 'C:\maps'");
        is("sh=[1, 2]", "sh = [1, 2]");
        is("rate=1e-3", "rate = 1e-3");
        for line in ["depth.prior", "depth.prior=", "sh=[1", "a b=none", "text=\"half", "=none"] {
            let refusal = format!("{:#}", assignment(line).unwrap_err());
            assert!(refusal.contains("KEY=VALUE") && refusal.contains("help"), "{line}: {refusal}");
        }
    }
}
