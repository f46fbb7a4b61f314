//! `corf config`: what can be configured.

use super::{Verdict, show};
use crate::comparison::sweep::Sweep;
use crate::device::Backend;
use crate::documents::explain::{Key, keys, plain};
use crate::experiment::plan::Plan;
use crate::methods;
use crate::radio_link::LinkConfig;
use anyhow::Result;
use clap::Args;
use corf_scene::config::{DatasetConfig, SceneConfig};
use corf_scene::words::nearest;
use schemars::{JsonSchema, schema_for};
use serde_json::Value;

/// `corf config`.
#[derive(Args)]
pub struct Config {
    /// Every key of: scene (scene files), dataset (configurations of `corf dataset generate`), paths or coverage (their --config), plan (of `corf
    /// bench run`), sweep (of `corf bench sweep`), or a method (what --set, --config and a plan's `config` take), with type, default, unit and
    /// meaning.
    #[arg(long, value_name = "scene|dataset|paths|coverage|plan|sweep|METHOD")]
    explain: String,
    /// Only keys that contain this.
    #[arg(long, value_name = "WORD")]
    key: Option<String>,
}

impl Config {
    /// Runs the command.
    ///
    /// # Errors
    /// Neither a kind of file nor a method, or no key with that word.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let mut list = match of_file(&self.explain) {
            Some(list) => list,
            None => of_method(&self.explain)?,
        };
        if let Some(word) = &self.key {
            let all: Vec<String> = list.iter().map(|key| key.key.clone()).collect();
            list.retain(|key| key.key.contains(word));
            let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
            let words: Vec<String> = all.iter().map(|key| last(key)).chain(all.iter().cloned()).collect();
            let meant = nearest(word, words.iter().map(String::as_str));
            let meant = meant.map_or(String::new(), |near| format!("did you mean {near}? "));
            anyhow::ensure!(
                !list.is_empty(),
                "{} has no key with \"{word}\"\n  help: {meant}leave --key out to see all",
                self.explain
            );
        }
        show(json, &list, &plain(&list))?;
        Ok(Verdict::Done)
    }
}

/// Kinds of files that are no methods' settings.
const FILES: [&str; 6] = ["scene", "dataset", "paths", "coverage", "plan", "sweep"];

/// The keys of a kind of file; none where the name is none of [`FILES`].
fn of_file(name: &str) -> Option<Vec<Key>> {
    Some(match name {
        "scene" => of_type::<SceneConfig>(),
        "dataset" => of_type::<DatasetConfig>(),
        "paths" | "coverage" => of_type::<LinkConfig>(),
        "plan" => of_type::<Plan>(),
        "sweep" => of_type::<Sweep>(),
        _ => return None,
    })
}

pub(super) fn of_type<T: JsonSchema>() -> Vec<Key> {
    keys(&schema_for!(T).to_value(), &Value::Null)
}

/// The keys of a method with the values that its name gives them.
///
/// # Errors
/// A name that is no method's.
pub(super) fn of_method(id: &str) -> Result<Vec<Key>> {
    let method = methods::create(id, &toml::Table::new(), &Backend::Cpu).map_err(|e| match nearest(id, FILES) {
        Some(near) => anyhow::anyhow!("nothing is called {id}\n  help: did you mean {near}?"),
        None => anyhow::anyhow!("{e:#}; of files {} can be explained as well", FILES.join(", ")),
    })?;
    let values = method.config();
    let (family, _) = methods::find(id)?;
    let mut list = keys(&(family.schema)().to_value(), &values);
    for table in family.inlined {
        list.retain(|key| key.key != *table);
        for key in &mut list {
            if let Some(rest) = key.key.strip_prefix(table).and_then(|rest| rest.strip_prefix('.')) {
                let outer = table.rsplit_once('.').map_or(String::new(), |(outer, _)| format!("{outer}."));
                key.key = format!("{outer}{rest}");
            }
        }
    }
    // What the name decides cannot be set, even to the value that it has.
    list.retain(|key| !family.decided.contains(&key.key.as_str()));
    for key in &mut list {
        // All of a method's keys have defaults.
        key.required = false;
    }
    Ok(list)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::corf_gs::{GeometryConfig, StartOpacity};
    use serde_json::json;

    /// The value at a dotted key.
    fn at<'v>(value: &'v Value, key: &str) -> &'v Value {
        key.split('.').fold(value, |v, part| &v[part])
    }

    #[test]
    fn every_key_of_every_method_is_explained_with_its_value() {
        for id in methods::registry::all().map(|method| method.id) {
            let list = of_method(id).unwrap();
            assert!(!list.is_empty(), "{id}");
            let method = methods::create(id, &toml::Table::new(), &Backend::Cpu).unwrap();
            for key in &list {
                assert!(!key.meaning.is_empty(), "{id}: {} has no meaning", key.key);
                let Some(default) = key.default.as_ref().filter(|_| key.kind != "table") else { continue };
                let tables = ["", "reconstruction.", "radio.", "light.reconstruction."];
                let stripped = key.key.strip_prefix("light.").unwrap_or(&key.key);
                // Of a run on another's geometry, whose keys stand where there is one.
                let on_geometry = json!({
                    "epochs": GeometryConfig::usual_epochs(),
                    "opacity": StartOpacity::default(),
                    "rate_at_end": GeometryConfig::usual_rate_at_end(),
                });
                let is_of_geometry = stripped.strip_prefix("geometry.").is_some_and(|k| at(&on_geometry, k) == default);
                let holds = is_of_geometry
                    || tables.iter().any(|t| {
                        [key.key.as_str(), stripped].iter().any(|k| at(&method.config(), &format!("{t}{k}")) == default)
                    });
                assert!(holds, "{id}: {} is not {default}", key.key);
            }
        }
        // A preset's values are its own.
        let of = |id: &str, key: &str| of_method(id).unwrap().into_iter().find(|k| k.key == key).and_then(|k| k.default);
        assert_eq!(
            (of("corf-gs", "iterations_per_keyframe"), of("corf-gs-fast", "iterations_per_keyframe")),
            (Some(json!(75)), Some(json!(40)))
        );
        assert!(of_method("nothing").is_err());
        // Keys that the name decides are no keys to set; all others are there.
        let has = |id: &str, key: &str| of_method(id).unwrap().iter().any(|k| k.key == key);
        for (id, decided, free) in [("corf-gs", "coupling", "rf_target"), ("rf-3dgs", "rf_background", "density")] {
            assert!(!has(id, decided) && has(id, free), "{id}");
        }
    }

    #[test]
    fn every_key_of_every_file_is_explained() {
        for list in FILES.map(|name| of_file(name).unwrap()) {
            let unexplained: Vec<&str> = list.iter().filter(|k| k.meaning.is_empty()).map(|k| k.key.as_str()).collect();
            assert!(unexplained.is_empty() && list.len() > 5, "{unexplained:?}");
        }
    }
}
