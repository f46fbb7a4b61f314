//! Which records may stand in one table: those of one data set, one split (or its folds) and one protocol, each of its own row and seed, and in
//! a row those of one method with one configuration. What the harness wrote keeps to this by itself; a folder that was put
//! together by hand may not.

use crate::device::Backend;
use crate::files::json::read_text;
use crate::methods;
use crate::methods::corf_gs::GeometryConfig;
use crate::note;
use crate::record::{Outcome, PREDICTIONS, Record};
use anyhow::{Context, Result, bail, ensure};
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// File of a results folder that says which of its records' data sets count as one, and why.
pub const JOINED: &str = "joined.toml";

/// `joined.toml`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joined {
    /// Data sets that count as one.
    #[serde(default)]
    dataset: Vec<JoinedDatasets>,
}

/// Data sets that count as one for these records.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct JoinedDatasets {
    /// Their hashes.
    hashes: Vec<String>,
    /// Why they do.
    reason: String,
}

impl Joined {
    /// What a results folder says; nothing where it has no such file. What it joins is said on standard error.
    ///
    /// # Errors
    /// A file that is not of this form, or that gives no reason.
    pub fn of(folder: &Path) -> Result<Self> {
        let path = folder.join(JOINED);
        if !path.exists() {
            return Ok(Self::default());
        }
        let joined: Self = toml::from_str(&read_text(&path)?).with_context(|| format!("in {}", path.display()))?;
        for datasets in &joined.dataset {
            let JoinedDatasets { hashes, reason } = datasets;
            ensure!(
                hashes.len() > 1 && !reason.trim().is_empty(),
                "{}: a [[dataset]] needs two hashes or more, and the reason why they count as one",
                path.display()
            );
            let short: Vec<String> = hashes.iter().map(|hash| format!("{hash:.12}")).collect();
            note!("{}: the data sets {} count as one: {reason}", path.display(), short.join(", "));
        }
        Ok(joined)
    }

    /// The hash that stands for a data set.
    fn stands_for<'a>(&'a self, hash: &'a str) -> &'a str {
        let joined = self.dataset.iter().find(|joined| joined.hashes.iter().any(|h| h == hash));
        joined.and_then(|joined| joined.hashes.first()).map_or(hash, String::as_str)
    }
}

const SEPARATE: &str = "records of different ones cannot be compared: keep them in folders of their own";

/// Checks that records may stand in one table; `place` tells where the record of an index is.
///
/// # Errors
/// Two records that may not, both by their places, with what differs.
pub fn check(records: &[Record], place: &dyn Fn(usize) -> String, joined: &Joined) -> Result<()> {
    let mut cells: BTreeMap<(&str, u64, Option<usize>), usize> = BTreeMap::new();
    let mut rows: BTreeMap<&str, usize> = BTreeMap::new();
    let Some(first) = records.first() else { return Ok(()) };
    let mut weights: BTreeMap<&str, usize> = BTreeMap::new();
    // Of every fold the first finished cell, and what it was evaluated on.
    let mut first_done: BTreeMap<Option<usize>, (usize, Vec<usize>)> = BTreeMap::new();
    for (at, record) in records.iter().enumerate() {
        let fold = record.split.fold().map_or(String::new(), |fold| format!(", fold {fold}"));
        let name = || format!("{:?}, seed {}{fold}", record.row, record.seed);
        let differ = |from: usize, what: &str, a: &dyn std::fmt::Display, b: &dyn std::fmt::Display, help: &str| {
            format!("{}: {} is of the {what} {b}, {} of {a}\n  help: {help}", place(at), name(), place(from))
        };
        let hashes = [first, record].map(|record| joined.stands_for(&record.dataset_hash));
        if hashes[0] != hashes[1] {
            let [a, b] = [first, record].map(|r| format!("{} (hash {:.12})", r.dataset, r.dataset_hash));
            bail!(differ(0, "data set", &a, &b, SEPARATE));
        }
        let [of_first, split] = [first, record].map(|r| r.split.of_all_folds());
        ensure!(of_first == split, differ(0, "split", &of_first, &split, SEPARATE));
        ensure!(first.protocol == record.protocol, differ(0, "protocol", &first.protocol, &record.protocol, SEPARATE));
        for (backbone, sha256) in &record.lpips_weights {
            let other = *weights.entry(backbone).or_insert(at);
            if records[other].lpips_weights.get(backbone) != Some(sha256) {
                let [a, b] = [other, at].map(|i| format!("{backbone} {:.12}", records[i].lpips_weights[backbone]));
                bail!(differ(other, "LPIPS weights", &a, &b, SEPARATE));
            }
        }
        if let Some(other) = cells.insert((record.row.as_str(), record.seed, record.split.fold()), at) {
            let same = serde_json::to_value(&records[other])? == serde_json::to_value(record)?;
            let how = if same { "the same record twice" } else { "two records of one cell that differ" };
            bail!("{} is in {} and in {}: {how}\n  help: a cell counts once: keep one of them", name(), place(other), place(at));
        }
        let from = *rows.entry(&record.row).or_insert(at);
        let one = &records[from];
        ensure!(one.method == record.method, differ(from, "method", &one.method, &record.method, ANOTHER_ROW));
        if let Some(key) = other_setting(one, record) {
            let (at, from) = (place(at), place(from));
            bail!("{at}: {} has another configuration than {from}: {key}\n  help: {ANOTHER_ROW}", name());
        }
        if let Outcome::Done(numbers) = &record.outcome {
            let indices = || numbers.frames.iter().map(|frame| frame.index).collect::<Vec<_>>();
            match first_done.get(&record.split.fold()) {
                None => drop(first_done.insert(record.split.fold(), (at, indices()))),
                Some((from, held_out)) => ensure!(
                    numbers.frames.len() == held_out.len() && indices() == *held_out,
                    "{}: {} was evaluated on other keyframes than the record in {}\n  help: {SEPARATE}",
                    place(at),
                    name(),
                    place(*from)
                ),
            }
        }
    }
    Ok(())
}

const ANOTHER_ROW: &str = "a row is one method with one configuration: give one of them another label, or leave it out";

/// What predictions of all seeds have in common: their statement and their hash are those of one.
const OF_PREDICTIONS: [&str; 3] = ["images", "spectra", "jet"];

/// A setting in which two records of one method differ, with both values. What one of them lacks, for it is of a version that did
/// not have it yet, is as it is by itself in this one.
fn other_setting(one: &Record, other: &Record) -> Option<String> {
    let [mine, others] = [one, other].map(|record| {
        let mut config = methods::without_retired(&record.config);
        if let Some(geometry) = config.get_mut("geometry").and_then(Value::as_object_mut) {
            // Each seed may have one of its own.
            GeometryConfig::OF_A_RUN.iter().for_each(|key| drop(geometry.remove(*key)));
        }
        config
    });
    if mine == others {
        return None;
    }
    if one.method == PREDICTIONS {
        return OF_PREDICTIONS.iter().find_map(|key| difference(&one.config[key], &other.config[key], &Value::Null, key));
    }
    for (record, with) in [(one, other), (other, one)] {
        if is_empty(&record.config) {
            return Some(format!("config is empty for seed {} and is not for seed {}", record.seed, with.seed));
        }
    }
    let own = methods::create(&one.method, &toml::Table::new(), &Backend::Cpu).map_or(Value::Null, |method| method.config());
    difference(&mine, &others, &own, "")
}

/// Whether there are no settings at all, as no version has written of a method that has some.
fn is_empty(config: &Value) -> bool {
    config.as_object().is_none_or(serde_json::Map::is_empty)
}

/// The first path at which two values differ; what one of them lacks is as in `own`, where that has it.
fn difference(a: &Value, b: &Value, own: &Value, path: &str) -> Option<String> {
    if let (Value::Object(one), Value::Object(other)) = (a, b) {
        if one.is_empty() != other.is_empty() {
            return Some(format!("{path} is empty in one of them"));
        }
        let keys = one.keys().chain(other.keys().filter(|key| !one.contains_key(*key)));
        return keys.into_iter().find_map(|key| {
            let own = &own[key];
            let dot = if path.is_empty() { "" } else { "." };
            difference(one.get(key).unwrap_or(own), other.get(key).unwrap_or(own), own, &format!("{path}{dot}{key}"))
        });
    }
    let short = |value: &Value| {
        let text = value.to_string();
        format!("{text:.60}")
    };
    (a != b).then(|| format!("{path} is {} and {}", short(b), short(a)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::tests::done;
    use crate::split::Protocol;
    use serde_json::json;

    fn check_all(records: &[Record], joined: &Joined) -> Result<()> {
        check(records, &|at| format!("line {}", at + 1), joined)
    }

    /// Two seeds of a row, the second changed.
    fn changed(change: impl Fn(&mut Record)) -> String {
        let mut records = [done("a", 1), done("b", 1), done("a", 2)];
        check_all(&records, &Joined::default()).unwrap();
        change(&mut records[2]);
        check_all(&records, &Joined::default()).unwrap_err().to_string()
    }

    #[test]
    fn what_may_not_stand_in_one_table_is_named_with_both_places() {
        type Case = (&'static str, &'static dyn Fn(&mut Record), &'static str);
        let all: [Case; 9] = [
            ("twice", &|r| *r = done("a", 1), "\"a\", seed 1 is in line 1 and in line 3: the same record twice"),
            ("changed", &|r| (r.seed, r.device) = (1, "x".into()), "line 1 and in line 3: two records of one cell that differ"),
            (
                "data set",
                &|r| r.dataset_hash = "0123456789abcdef".into(),
                "line 3: \"a\", seed 2 is of the data set d (hash 0123456789ab)",
            ),
            ("split", &|r| r.split = Protocol::SEGMENT, "is of the split segment, line 1 of test"),
            (
                "protocol",
                &|r| r.protocol = "corf-heldout/1".into(),
                "is of the protocol corf-heldout/1, line 1 of corf-heldout/2",
            ),
            ("method", &|r| r.method = "corf-array".into(), "is of the method corf-array, line 1 of corf-gs"),
            ("config", &|r| r.config = json!({"fine_tune_epochs": 3}), "than line 1: fine_tune_epochs is 3 and 0"),
            ("weights", &|r| drop(r.lpips_weights.insert("vgg".into(), "f".repeat(64))), "LPIPS weights vgg ffffffffffff"),
            (
                "frames",
                &|r| {
                    if let Outcome::Done(n) = &mut r.outcome {
                        n.frames.truncate(1)
                    }
                },
                "was evaluated on other keyframes",
            ),
        ];
        for (name, change, said) in all {
            let error = changed(change);
            assert!(error.contains(said) && error.contains("help: "), "{name}: {error}");
        }
    }

    #[test]
    fn a_setting_that_an_older_version_had_not_yet_is_the_methods_own() {
        let mut records = [done("a", 1), done("a", 2)];
        let own = methods::create("corf-gs", &toml::Table::new(), &Backend::Cpu).unwrap().config();
        (records[0].config, records[1].config) = (own.clone(), own);
        let optimizer = records[0].config["optimizer"].as_object_mut().unwrap();
        assert!(optimizer.remove("beta1").is_some());
        check_all(&records, &Joined::default()).unwrap();
        // Nothing at all is no older version's.
        for empty in ["", "/optimizer"] {
            let mut records = records.clone();
            *records[1].config.pointer_mut(empty).unwrap() = json!({});
            let error = check_all(&records, &Joined::default()).unwrap_err().to_string();
            assert!(error.contains("another configuration") && error.contains("is empty"), "{error}");
        }
        records[1].config["optimizer"]["beta1"] = json!(0.25);
        let error = check_all(&records, &Joined::default()).unwrap_err().to_string();
        assert!(error.contains("optimizer.beta1 is 0.25 and "), "{error}");
    }

    #[test]
    fn predictions_of_seeds_have_hashes_of_their_own() {
        let mut records = [done("theirs", 1), done("theirs", 2)];
        for (record, hash) in records.iter_mut().zip(["1", "2"]) {
            record.method = PREDICTIONS.to_owned();
            record.config = json!({"content_sha256": hash, "images": true, "stated": {"seed": hash}});
        }
        check_all(&records, &Joined::default()).unwrap();
        records[1].config["images"] = json!(false);
        assert!(check_all(&records, &Joined::default()).unwrap_err().to_string().contains("another configuration"));
    }

    #[test]
    fn data_sets_count_as_one_where_a_file_says_so_with_its_reason() {
        let folder = tempfile::tempdir().unwrap();
        let write = |text: &str| std::fs::write(folder.path().join(JOINED), text).unwrap();
        let mut records = [done("a", 1), done("b", 1)];
        records[1].dataset_hash = "other".to_owned();
        let hash = &records[0].dataset_hash;
        write(&format!("[[dataset]]\nhashes = [\"{hash}\", \"other\"]\nreason = \"the same spectra\"\n"));
        let joined = Joined::of(folder.path()).unwrap();
        check_all(&records, &joined).unwrap();
        records[1].dataset_hash = "a third".to_owned();
        assert!(check_all(&records, &joined).is_err());
        for bad in ["[[dataset]]\nhashes = ['a', 'b']\nreason = ' '", "[[dataset]]\nhashes = ['a']\nreason = 'x'", "dataset = 3"]
        {
            write(bad);
            assert!(format!("{:#}", Joined::of(folder.path()).unwrap_err()).contains(JOINED));
        }
    }
}
