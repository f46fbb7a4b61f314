//! `--set KEY=VALUE`: keys of a configuration on the command line.

use super::config::of_type;
use crate::documents::explain::Key;
use crate::methods;
use anyhow::{Result, bail};
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
        check_tables(&overrides, &of_type::<DatasetConfig>())?;
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

/// Refuses a single value for what is a table among these keys of a configuration.
///
/// # Errors
/// The first such key, with the keys of its table.
pub fn check_tables(given: &toml::Table, keys: &[Key]) -> Result<()> {
    fn walk(given: &toml::Table, above: &str, keys: &[Key]) -> Result<()> {
        for (key, value) in given {
            let name = format!("{above}{key}");
            if let Some(inner) = value.as_table() {
                walk(inner, &format!("{name}."), keys)?;
            } else if keys.iter().any(|known| known.key == name && known.kind == "table") {
                let of_table = |known: &&Key| known.key.strip_prefix(&name).is_some_and(|rest| rest.starts_with('.'));
                let last = |known: &Key| known.key[name.len() + 1..].to_owned();
                let within: Vec<String> = keys.iter().filter(of_table).map(last).filter(|key| !key.contains('.')).collect();
                bail!(
                    "--set {name}={value}: {name} is a table, and has no value of its own\n  help: set a key of it, as {name}.{}=VALUE; its keys: {}",
                    within.first().map_or("KEY", String::as_str),
                    within.join(", ")
                );
            }
        }
        Ok(())
    }
    walk(given, "", keys)
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
    fn a_table_is_given_no_value_and_its_keys_are_named() {
        let keys = of_type::<DatasetConfig>();
        let said = |line: &str| check_tables(&table(&[line.to_owned()]).unwrap(), &keys).err().map(|error| error.to_string());
        let refusal = said("optical=4").unwrap();
        assert!(refusal.contains("optical is a table") && refusal.contains("help: ") && refusal.contains("effort"), "{refusal}");
        assert!(said("optical.max_bounces=4").is_none() && said("keyframes=3").is_none() && said("no_key=3").is_none());
        let online = crate::commands::config::of_method("corf-gs").unwrap();
        let refusal = check_tables(&table(&["optimizer=none".to_owned()]).unwrap(), &online).unwrap_err().to_string();
        assert!(refusal.contains("optimizer is a table"), "{refusal}");
    }

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
