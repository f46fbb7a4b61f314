//! The methods by name. A family of methods is one entry, in the file of its implementation; dispatch, `--help`,
//! `corf config --explain` and the documents' tables follow from the list of entries.

use super::family::{Abilities, Family, Open, SavedRun, Variant, merge};
use super::interface::{Method, Predictor, TrainingSet};
use crate::device::Backend;
use crate::split::Split;
use anyhow::{Context, Result, bail, ensure};
use clap::builder::{PossibleValue, PossibleValuesParser};
use corf::{IdleKey, RasterConfig};
use corf_scene::words::nearest;
use serde_json::Value;

/// Every family: a new one is a file of its own and a line here.
const FAMILIES: &[&Family] = &[
    &super::corf_gs::FAMILY,
    &super::corf_array::FAMILY,
    &super::rf_3dgs::FAMILY,
    &super::nerf2::FAMILY,
    &super::wrf_gs_plus::FAMILY,
    &super::lookup::NEAREST,
    &super::lookup::INVERSE_DISTANCE,
];

/// All methods, in the order of lists.
pub fn all() -> impl Iterator<Item = &'static Variant> {
    FAMILIES.iter().flat_map(|family| family.variants)
}

/// The names that `--method` takes, with their lines for `--help`.
pub fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(all().map(|method| PossibleValue::new(method.id).help(method.help)))
}

/// The family and the variant of a name.
///
/// # Errors
/// An unknown name.
pub fn find(id: &str) -> Result<(&'static Family, &'static Variant)> {
    let of = |family: &&'static Family| family.variants.iter().find(|v| v.id == id).map(|variant| (*family, variant));
    let unknown = || {
        let known: Vec<&str> = all().map(|method| method.id).collect();
        let meant = nearest(id, known.iter().copied()).map_or(String::new(), |near| format!("did you mean {near}? "));
        format!("unknown method \"{id}\"\n  help: {meant}the methods are {}", known.join(", "))
    };
    FAMILIES.iter().find_map(of).with_context(unknown)
}

/// What the method of a name can do; nothing where a record's name is none of this version.
pub fn abilities(id: &str) -> Abilities {
    find(id).map(|(family, _)| family.can).unwrap_or_default()
}

/// The names of the methods that can do something, for messages: `corf-gs, corf-gs-paper`.
pub fn that(can: impl Fn(&Abilities) -> bool) -> String {
    let able = FAMILIES.iter().filter(|family| can(&family.can)).flat_map(|family| family.variants);
    able.map(|method| method.id).collect::<Vec<_>>().join(", ")
}

/// A caller's settings over the preset of a method.
///
/// # Errors
/// An unknown name, or a key that the name decides.
pub fn settings(id: &str, overrides: &toml::Table) -> Result<toml::Table> {
    let (family, variant) = find(id)?;
    let mut table: toml::Table = variant.preset.parse().with_context(|| format!("the preset of {id}"))?;
    if let Some(key) = family.decided.iter().find(|key| overrides.contains_key(**key)) {
        let ids: Vec<&str> = family.variants.iter().map(|v| v.id).collect();
        let choose = if ids.len() > 1 { format!(", and choose among {}", ids.join(", ")) } else { String::new() };
        bail!("{id}: the key {key} is set by the method's name\n  help: leave the key out{choose}");
    }
    merge(&mut table, overrides.clone());
    Ok(table)
}

/// Makes a method; `overrides` are keys of its settings, `backend` is where it runs if it needs a device.
///
/// # Errors
/// An unknown name, a key that does not exist, that the name decides or that has no effect, or a value out of range.
pub fn create(id: &str, overrides: &toml::Table, backend: &Backend) -> Result<Box<dyn Method>> {
    for given in dotted(overrides) {
        if let Some(Retired { why, help, .. }) = RETIRED.iter().find(|retired| retired.key == given) {
            bail!("{id}: the key {given} has no effect: {why}\n  help: {help}");
        }
    }
    let method = create_again(id, overrides, backend)?;
    check_given(method.as_ref(), overrides, None)?;
    Ok(method)
}

/// Makes the method of a run or of a record again, whose overrides an earlier version may have taken although some had no effect.
///
/// # Errors
/// Those of [`create`] but for keys without effect.
pub fn create_again(id: &str, overrides: &toml::Table, backend: &Backend) -> Result<Box<dyn Method>> {
    let (family, _) = find(id)?;
    let mut settings = settings(id, overrides)?;
    RETIRED.iter().for_each(|retired| retired.leave_out_of(&mut settings));
    (family.create)(id, settings, backend).with_context(|| format!("in the configuration of {id}"))
}

/// Refuses keys that a caller gave and that have no effect beside the rest, so that two rows that differ in one cannot seem to be two; defaults
/// and presets are not given. With `training`, keys that have none on this data set as well.
///
/// # Errors
/// The first such key, with why and what to do; a data set that the method does not take.
pub fn check_given(method: &dyn Method, overrides: &toml::Table, training: Option<&TrainingSet<'_>>) -> Result<()> {
    let idle = method.idle_keys(training)?;
    for given in dotted(overrides) {
        if let Some(IdleKey { why, help, .. }) = idle.iter().find(|key| key.is(&given)) {
            bail!("{}: the key {given} has no effect: {why}\n  help: {help}", method.id());
        }
    }
    Ok(())
}

/// Settles a method for a data set; whether it takes it, and whether all that its caller gave has an effect there: before anything is begun.
///
/// # Errors
/// Those of [`Method::settle`], [`Method::check_files`] and [`check_given`].
pub fn check_data_set(method: &mut dyn Method, overrides: &toml::Table, training: &TrainingSet<'_>) -> Result<()> {
    let (dataset, _) = training.to_check_against();
    method.settle(dataset)?;
    method.check_files(training)?;
    check_given(method, overrides, Some(training))
}

/// The keys of a table with those of the tables in it: `depth.prior`.
fn dotted(table: &toml::Table) -> Vec<String> {
    let mut keys = Vec::new();
    for (key, value) in table {
        match value {
            toml::Value::Table(inner) => keys.extend(dotted(inner).into_iter().map(|rest| format!("{key}.{rest}"))),
            _ => keys.push(key.clone()),
        }
    }
    keys
}

/// A key that configurations of earlier versions have, and that none of them was changed by.
struct Retired {
    key: &'static str,
    why: &'static str,
    help: &'static str,
}

const RETIRED: &[Retired] = &[
    Retired { key: "optimizer.position_rate_m", why: BY_BASELINES, help: POSITION_RATE },
    Retired { key: "light.optimizer.position_rate_m", why: BY_BASELINES, help: POSITION_RATE },
    Retired { key: "optimizer.position_rate_floor", why: NO_FLOOR, help: POSITION_DECAY },
    Retired { key: "light.optimizer.position_rate_floor", why: NO_FLOOR, help: POSITION_DECAY },
];
const BY_BASELINES: &str = "the reconstructor sets this rate from the cameras' baselines";
const POSITION_RATE: &str = "give position_rate, the rate where the mean baseline is 0.1";
const NO_FLOOR: &str = "rates of positions fall without a floor; the published one is met after 115 000 visits of a Gaussian";
const POSITION_DECAY: &str = "leave it out; position_decay says how fast they fall";

impl Retired {
    fn leave_out_of(&self, settings: &mut toml::Table) {
        let mut names: Vec<&str> = self.key.split('.').collect();
        let last = names.pop().unwrap_or_default();
        let table = names.iter().try_fold(settings, |table, name| table.get_mut(*name)?.as_table_mut());
        table.map(|table| table.remove(last));
    }
}

/// A resolved configuration without the keys of earlier versions that changed nothing: two that differ in them alone are one.
pub fn without_retired(config: &Value) -> Value {
    let mut config = config.clone();
    for Retired { key, .. } in RETIRED {
        if let Some((table, last)) = format!("/{}", key.replace('.', "/")).rsplit_once('/') {
            config.pointer_mut(table).and_then(Value::as_object_mut).map(|table| table.remove(last));
        }
    }
    config
}

/// Opens a finished run of a method, which was made again from its overrides and seed.
///
/// # Errors
/// A configuration that this version resolves differently, damaged files.
pub fn open(run: &SavedRun<'_>, method: &dyn Method, seed: u64, split: &Split) -> Result<Box<dyn Predictor>> {
    let (family, _) = find(method.id())?;
    let config = &without_retired(run.config);
    ensure!(
        family.can.online || method.config() == *config,
        "{}: this version resolves the run's configuration differently\n  help: reconstruct again",
        run.folder.display()
    );
    match family.open {
        Open::Saved(load) => load(&SavedRun { config, ..*run }),
        Open::Again => method.reconstruct(&TrainingSet::new(run.dataset, split), seed, &mut |_| Ok(())),
    }
}

/// The rasteriser's settings in a method's resolved configuration; none where it has no Gaussians that a rasteriser could draw.
///
/// # Errors
/// An unknown name, a configuration of another version.
pub fn raster_of(id: &str, config: &Value) -> Result<Option<RasterConfig>> {
    find(id)?.0.raster.map(|raster| raster(&without_retired(config))).transpose()
}

/// Whether the RF colours of a method's Gaussians are its spectra.
pub fn has_radio_colours(id: &str) -> bool {
    id != "corf-array"
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_name_is_one_method_which_can_be_made() {
        let mut known = BTreeSet::new();
        for variant in all() {
            assert!(known.insert(variant.id) && !variant.help.is_empty(), "{} is there twice, or has no line", variant.id);
            let method = create(variant.id, &toml::Table::new(), &Backend::Cpu).unwrap();
            assert_eq!(method.id(), variant.id);
            let (family, _) = find(variant.id).unwrap();
            assert_eq!(raster_of(variant.id, &method.config()).unwrap().is_some(), family.raster.is_some());
        }
        let error = format!("{:#}", find("corf").err().unwrap());
        assert!(error.contains("unknown method \"corf\"") && error.contains("corf-gs, corf-gs-paper"), "{error}");
        assert!(!abilities("of another version").online && abilities("corf-array").online);
    }

    #[test]
    fn what_a_name_decides_is_not_set_beside_it() {
        for family in FAMILIES {
            for variant in family.variants {
                let config = create(variant.id, &toml::Table::new(), &Backend::Cpu).unwrap().config();
                for key in family.decided {
                    let values = family.inlined.iter().map(|table| &config[*table][*key]).chain([&config[*key]]);
                    let value = values.into_iter().find(|v| !v.is_null()).expect("a decided key is one of the configuration");
                    // Not even to the value that it has.
                    let overrides = toml::Table::try_from(serde_json::json!({ *key: value })).unwrap();
                    let error = format!("{:#}", create(variant.id, &overrides, &Backend::Cpu).err().unwrap());
                    assert!(error.contains(&format!("the key {key} is set by the method's name")), "{error}");
                }
            }
        }
    }

    #[test]
    fn what_has_no_effect_is_refused_where_it_is_given_and_read_where_it_was() {
        let cases = [
            ("corf-gs", "optimizer.position_rate_m = 1.0", "position_rate, the rate"),
            ("corf-gs", "optimizer = { position_rate_floor = 0.5, beta1 = 0.6 }", "position_decay says"),
            ("corf-gs", "second_stage_opacity = \"optical\"", "corf-gs-frozen"),
            ("corf-gs", "uniform_probability = 0.2", "sampling = \"uniform\""),
            ("corf-gs-uniform", "log_sigma_px = 1.0", "sampling = \"log\""),
            ("corf-gs", "depth.folder_kind = \"inverse-relative\"", "depth.prior = \"folder\""),
            ("corf-gs", "depth = { prior = \"folder\", folder = \"maps\", png_scale = 10.0 }", "a metric depth.folder_kind"),
            ("corf-gs", "depth.input_px = 392", "depth-anything"),
            ("corf-gs", "depth.imagenet_normalisation = false", "depth-anything"),
            ("corf-gs-paper", "depth.corrected_range = 0.1", "depth.correction = true"),
            ("corf-array", "light.optimizer.position_rate_m = 1.0", "position_rate, the rate"),
            ("corf-array", "light.optimizer.position_rate_floor = 0.5", "position_decay says"),
            ("corf-gs-frozen", "rf_weight = 0.2", "by itself"),
            ("corf-gs", "depth = { prior = \"exact\", min_zncc = 0.8 }", "other values of depth.prior"),
            ("corf-array", "sources = false\nvotes = 3.0", "sources = true"),
            ("rf-3dgs", "random_points = 50", "initial_points = \"random\""),
            ("rf-3dgs", "initial_gaussians = \"a.ply\"\ndensity.every = 7", "optical stage"),
        ];
        for (id, text, said) in cases {
            let overrides: toml::Table = text.parse().unwrap();
            let error = format!("{:#}", create(id, &overrides, &Backend::Cpu).err().unwrap_or_else(|| panic!("{id}: {text}")));
            assert!(error.contains("has no effect") && error.contains(said) && error.contains("help: "), "{error}");
            // A run or a record of an earlier version may hold it; the configuration that it resolves to is the one without.
            let again = create_again(id, &overrides, &Backend::Cpu).unwrap();
            assert_eq!(without_retired(&again.config()), again.config());
        }
        for (id, text) in [
            ("corf-gs-uniform", "uniform_probability = 0.2"),
            ("corf-gs-frozen", "second_stage_opacity = \"initial\""),
            ("corf-gs", "depth = { prior = \"folder\", folder = \"maps\", folder_kind = \"depth-metric\", png_scale = 10.0 }"),
            ("corf-gs", "depth.prior = \"none\""),
            ("rf-3dgs", "initial_points = \"random\"\nrandom_points = 50"),
        ] {
            create(id, &text.parse().unwrap(), &Backend::Cpu).unwrap();
        }
        let old = serde_json::json!({ "optimizer": { "position_rate_m": 5e-5, "position_rate_floor": 0.1, "beta1": 0.5 }, "reconstruction": 1 });
        assert_eq!(without_retired(&old), serde_json::json!({ "optimizer": { "beta1": 0.5 }, "reconstruction": 1 }));
        // The configuration of a run of an earlier version has them.
        for (id, table) in [("corf-gs", "/optimizer"), ("corf-array", "/light/optimizer")] {
            let mut config = create(id, &toml::Table::new(), &Backend::Cpu).unwrap().config();
            config.pointer_mut(table).unwrap()["position_rate_floor"] = 0.1.into();
            assert!(raster_of(id, &config).unwrap().is_some());
        }
    }

    #[test]
    fn part_of_an_inner_table_leaves_the_rest_of_it() {
        let mut table: toml::Table = "a = 1\nb = { c = 2, d = 3 }".parse().unwrap();
        merge(&mut table, "b.c = 4\ne = 5".parse().unwrap());
        assert_eq!(table, "a = 1\nb = { c = 4, d = 3 }\ne = 5".parse().unwrap());
    }
}
