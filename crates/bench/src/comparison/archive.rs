//! A comparison as one file, from which its tables and report are written again byte for byte.
//!
//! ```text
//! NAME/plan.toml              the plan; its dataset by name alone
//! NAME/cells/*.json           a record a cell
//! NAME/predictions/*/         the pictures of the report
//! NAME/joined.toml            which data sets count as one, where that was said
//! NAME/table.md|csv|tex  report.html  beam.svg  rate.svg  outage.svg
//! NAME/segment/               the same with the contiguous segment held out, where the plan asks for it
//! NAME/environment.json       data set, programs and machines of the records
//! NAME/SHA256SUMS             of all other files, as sha256sum writes them
//! ```
//!
//! A tar file without owners and times: the same comparison gives the same bytes. Models are not in it, nor are the viewer's pages.

use crate::comparison::suite;
use crate::experiment::cells::CELLS;
use crate::experiment::plan::{Plan, slug};
use crate::record::Record;
use crate::record::comparability::JOINED;
use crate::record::provenance::Provenance;
use crate::report::along;
use anyhow::{Context, Result, bail, ensure};
use corf_scene::dataset::Dataset;
use corf_scene::io::{read, sha256_hex, write_atomic};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// Version of the layout.
const SCHEMA: &str = "corf-comparison/1";
const ENVIRONMENT: &str = "environment.json";
const SUMS: &str = "SHA256SUMS";
const PREDICTIONS: &str = "predictions";
const HELP: &str = "it is damaged, or no archive of `corf bench publish`: get it again";

/// Files of an archive: path below its folder with forward slashes, bytes.
pub type Files = BTreeMap<String, Vec<u8>>;

/// `environment.json`.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Environment {
    schema: String,
    /// Name of the comparison.
    name: String,
    /// Program that wrote tables and report.
    written_by: String,
    /// Name of the data set.
    dataset: String,
    /// Hash of the data set that the report shows.
    dataset_hash: String,
    /// SHA-256 of the networks of LPIPS, by backbone.
    lpips_weights: BTreeMap<String, String>,
    /// Devices that methods ran on.
    devices: BTreeSet<String>,
    /// Programs and machines that made the records, in the order in which they are first met.
    made_with: Vec<Provenance>,
}

/// Names of what is written from the records.
fn results() -> impl Iterator<Item = &'static str> {
    ["table.md", "table.csv", "table.tex", "report.html"].into_iter().chain(along::FILES)
}

/// The parts of a plan, as folders below the comparison's: itself, and the segment's where there is one.
fn part_folders(plan: &Plan) -> Vec<&'static str> {
    if plan.segment { vec!["", suite::SEGMENT] } else { vec![""] }
}

fn below(folder: &str, name: &str) -> String {
    if folder.is_empty() { name.to_owned() } else { format!("{folder}/{name}") }
}

/// All files below a folder, by path below it.
fn files_below(folder: &Path, place: &str, found: &mut Files) -> Result<()> {
    if !folder.is_dir() {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))? {
        let path = entry?.path();
        let Some(name) = path.file_name().and_then(|n| n.to_str()) else { bail!("{}: its name is no UTF-8", path.display()) };
        let place = below(place, name);
        if path.is_dir() {
            files_below(&path, &place, found)?;
        } else {
            found.insert(place, read(&path)?);
        }
    }
    Ok(())
}

fn environment(plan: &Plan, dataset: &Dataset, records: &[Record]) -> Environment {
    let here = Provenance::here();
    let mut made_with: Vec<Provenance> = Vec::new();
    for record in records {
        if !made_with.contains(&record.provenance) {
            made_with.push(record.provenance.clone());
        }
    }
    Environment {
        schema: SCHEMA.to_owned(),
        name: plan.name.clone(),
        written_by: format!("corf {}, commit {}{}", here.version, here.commit, if here.dirty { " (changed)" } else { "" }),
        dataset: dataset.header().name.clone(),
        dataset_hash: dataset.hash().to_owned(),
        lpips_weights: records.iter().flat_map(|record| record.lpips_weights.clone()).collect(),
        devices: records.iter().map(|record| record.device.clone()).collect(),
        made_with,
    }
}

/// Writes tables, figures and report of a comparison's parts from what is in `folder`; the answer is all records.
fn write_results(folder: &Path, dataset: &Dataset) -> Result<Vec<Record>> {
    let mut all = Vec::new();
    for part in part_folders(&suite::load_plan(folder)?) {
        let out = folder.join(part);
        let (plan, records) = suite::load(&out)?;
        ensure!(
            records.iter().any(|record| record.dataset_hash == dataset.hash()),
            "{} has the hash {:.12}, and the records are of {:.12}\n  help: give the data set that they were made with",
            dataset.dir().display(),
            dataset.hash(),
            records.first().map_or("", |record| record.dataset_hash.as_str())
        );
        all.extend(suite::write_results(&plan, dataset, records, &out)?.records);
    }
    Ok(all)
}

/// The results that stand in two places and are not the same in both.
fn differing(folder: &Path, there: impl Fn(&str) -> Option<Vec<u8>>) -> Result<Vec<String>> {
    let mut found = Vec::new();
    for part in part_folders(&suite::load_plan(folder)?) {
        for name in results() {
            let place = below(part, name);
            let path = folder.join(&place);
            let here = path.exists().then(|| read(&path)).transpose()?;
            if here != there(&place) {
                found.push(place);
            }
        }
    }
    Ok(found)
}

/// The archive of a finished comparison; `dataset` is that of its plan.
///
/// # Errors
/// A cell without a record; tables that are not those of the records; what cannot be read.
pub fn publish(folder: &Path, dataset: &Dataset) -> Result<Vec<u8>> {
    let mut plan = suite::load_plan(folder)?;
    // Where it lay on this machine tells nobody anything.
    plan.dataset = PathBuf::from(&dataset.header().name);
    let staged = tempfile::tempdir().context("cannot make a temporary folder")?;
    for part in suite::parts(&plan, staged.path()) {
        part.write_plan()?;
    }
    for part in part_folders(&plan) {
        let (from, to) = (folder.join(part), staged.path().join(part));
        let (own, _) = suite::load(&from)?;
        for cell in own.cells() {
            let name = below(CELLS, &format!("{}.json", cell.stem()));
            write_atomic(to.join(&name), &read(from.join(&name))?)?;
        }
        let mut pictures = Files::new();
        files_below(&from.join(PREDICTIONS), PREDICTIONS, &mut pictures)?;
        pictures.iter().try_for_each(|(name, bytes)| write_atomic(to.join(name), bytes))?;
        if from.join(JOINED).exists() {
            write_atomic(to.join(JOINED), &read(from.join(JOINED))?)?;
        }
    }
    let records = write_results(staged.path(), dataset)?;
    // The report alone may differ: it has no links to models there.
    let tables = |name: &str| read(folder.join(name)).ok();
    let stale: Vec<String> =
        differing(staged.path(), tables)?.into_iter().filter(|name| !name.ends_with("report.html")).collect();
    ensure!(
        stale.is_empty(),
        "{} of {} are not what this version writes from the records\n  help: write them again with `corf bench report {}`, look at them, and publish then",
        stale.join(", "),
        folder.display(),
        folder.display()
    );
    let mut files = Files::new();
    files_below(staged.path(), "", &mut files)?;
    let environment = serde_json::to_vec_pretty(&environment(&plan, dataset, &records))?;
    files.insert(ENVIRONMENT.to_owned(), environment);
    files.insert(SUMS.to_owned(), sums(&files).into_bytes());
    // A name of signs alone names no folder.
    let name = Some(slug(&plan.name)).filter(|name| !name.is_empty());
    packed(name.as_deref().unwrap_or("comparison"), &files)
}

/// As `sha256sum` writes them.
fn sums(files: &Files) -> String {
    files.iter().map(|(name, bytes)| format!("{}  {name}\n", sha256_hex(bytes))).collect()
}

/// A tar file of a folder of this name.
fn packed(name: &str, files: &Files) -> Result<Vec<u8>> {
    let mut archive = tar::Builder::new(Vec::new());
    for (path, bytes) in files {
        let mut header = tar::Header::new_gnu();
        header.set_size(bytes.len() as u64);
        header.set_mode(0o644);
        header.set_mtime(0);
        archive.append_data(&mut header, format!("{name}/{path}"), bytes.as_slice())?;
    }
    Ok(archive.into_inner()?)
}

/// The files of an archive, each checked against its SHA-256.
///
/// # Errors
/// What is no archive of [`publish`], or was changed.
pub fn unpacked(path: &Path) -> Result<Files> {
    let place = path.display();
    let file = corf_scene::io::open(path)?;
    let mut files = Files::new();
    for entry in tar::Archive::new(std::io::BufReader::new(file)).entries().with_context(|| format!("cannot read {place}"))? {
        let mut entry = entry.with_context(|| format!("{place} is no whole tar file\n  help: {HELP}"))?;
        if entry.header().entry_type().is_dir() {
            continue;
        }
        let name = entry.path().with_context(|| format!("{place}: a name in it cannot be read"))?.into_owned();
        ensure!(entry.header().entry_type().is_file(), "{place}: {} is no regular file\n  help: {HELP}", name.display());
        // The first part is the folder; nothing leads out of it.
        let parts: Option<Vec<&str>> =
            name.components().map(|c| if let Component::Normal(n) = c { n.to_str() } else { None }).collect();
        let Some([_, below @ ..]) = parts.as_deref().filter(|parts| parts.len() > 1) else {
            bail!("{place}: {} is no name of a file in a folder\n  help: {HELP}", name.display());
        };
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).with_context(|| format!("{place}: {} is cut short\n  help: {HELP}", name.display()))?;
        ensure!(files.insert(below.join("/"), bytes).is_none(), "{place} has {} twice\n  help: {HELP}", name.display());
    }
    let listed = files.remove(SUMS).with_context(|| format!("{place} has no {SUMS}\n  help: {HELP}"))?;
    let (listed, expected) = (String::from_utf8_lossy(&listed).into_owned(), sums(&files));
    if listed != expected {
        let other = expected
            .lines()
            .find(|line| !listed.lines().any(|l| l == *line))
            .or_else(|| listed.lines().find(|l| !expected.contains(l)));
        let name = other.and_then(|line| line.split_once("  ")).map_or(SUMS, |(_, name)| name);
        bail!("{place}: {name} is another than {SUMS} says\n  help: {HELP}");
    }
    Ok(files)
}

/// What came of writing a comparison's results again.
pub struct Rebuilt {
    /// All records.
    pub records: Vec<Record>,
    /// Results that are other than in the archive.
    pub differing: Vec<String>,
    /// Program that wrote the archive.
    pub written_by: String,
}

/// Puts an archive's files into `folder` and writes tables and report again from its records.
///
/// # Errors
/// Another data set, an archive that lacks something, a folder that cannot be written.
pub fn rebuild(archive: &Path, dataset: &Dataset, folder: &Path) -> Result<Rebuilt> {
    let mut files = unpacked(archive)?;
    let environment =
        files.get(ENVIRONMENT).with_context(|| format!("{} has no {ENVIRONMENT}\n  help: {HELP}", archive.display()))?;
    let environment: Environment =
        serde_json::from_slice(environment).with_context(|| format!("{}: {ENVIRONMENT}\n  help: {HELP}", archive.display()))?;
    ensure!(
        environment.schema == SCHEMA,
        "{} is of the layout {:?}, and this version reads {SCHEMA:?}",
        archive.display(),
        environment.schema
    );
    let is_result = |name: &str| results().any(|result| name == result || name == below(suite::SEGMENT, result));
    let archived: Files =
        files.iter().filter(|(name, _)| is_result(name)).map(|(name, bytes)| (name.clone(), bytes.clone())).collect();
    files.retain(|name, _| !is_result(name));
    for (name, bytes) in &files {
        write_atomic(folder.join(name), bytes)?;
    }
    let records = write_results(folder, dataset)?;
    let differing = differing(folder, |name| archived.get(name).cloned())?;
    // From now on it is a comparison as any, beside its data set.
    let mut plan = suite::load_plan(folder)?;
    plan.dataset = std::path::absolute(dataset.dir())?;
    suite::parts(&plan, folder).iter().try_for_each(|part| part.write_plan())?;
    Ok(Rebuilt { records, differing, written_by: environment.written_by })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files() -> Files {
        let mut files: Files = [("a.txt", "one"), ("b/c.txt", "two")].map(|(n, b)| (n.to_owned(), b.as_bytes().to_vec())).into();
        files.insert(SUMS.into(), sums(&files).into_bytes());
        files
    }

    fn read_back(bytes: &[u8]) -> Result<Files> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.tar");
        std::fs::write(&path, bytes)?;
        unpacked(&path)
    }

    #[test]
    fn what_is_packed_comes_back_and_is_the_same_each_time() {
        let (long, mut files) = (format!("b/{}.json", "x".repeat(150)), files());
        files.remove(SUMS);
        files.insert(long, b"three".to_vec());
        let expected = files.clone();
        files.insert(SUMS.into(), sums(&files).into_bytes());
        let bytes = packed("name", &files).unwrap();
        assert!(bytes == packed("name", &files).unwrap() && read_back(&bytes).unwrap() == expected);
    }

    #[test]
    fn what_was_changed_or_leads_elsewhere_is_refused() {
        let message = |bytes: &[u8]| read_back(bytes).unwrap_err().to_string();
        let bytes = packed("name", &files()).unwrap();
        let at = bytes.windows(3).position(|w| w == b"two").unwrap();
        let mut changed = bytes.clone();
        changed[at] = b'x';
        assert!(message(&changed).contains("b/c.txt is another than SHA256SUMS says"), "{}", message(&changed));
        let mut more = files();
        more.insert("d.txt".into(), b"three".to_vec());
        assert!(message(&packed("name", &more).unwrap()).contains("d.txt"));
        let mut fewer = files();
        fewer.remove("a.txt");
        assert!(message(&packed("name", &fewer).unwrap()).contains("a.txt"));
        assert!(message(&bytes[..at]).contains("help: it is damaged"), "{}", message(&bytes[..at]));
        assert!(message(b"not a tar file at all").contains("help: it is damaged"), "{}", message(b"not a tar file at all"));
        for outside in ["../a.txt", "/a.txt", "a.txt"] {
            let mut header = tar::Header::new_gnu();
            header.as_mut_bytes()[..outside.len()].copy_from_slice(outside.as_bytes());
            header.set_size(0);
            header.set_mode(0o644);
            header.set_cksum();
            let mut archive = tar::Builder::new(Vec::new());
            archive.append(&header, std::io::empty()).unwrap();
            let bytes = archive.into_inner().unwrap();
            assert!(message(&bytes).contains("no name of a file in a folder"), "{outside}: {}", message(&bytes));
        }
    }
}
