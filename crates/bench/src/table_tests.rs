//! What tables say of records, in every notation.

use super::*;
use crate::provenance::Provenance;
use std::collections::BTreeMap;

fn record(row: &str, seed: u64, psnr_rf: f64) -> Record {
    let always = COLUMNS.iter().filter(|c| c.backbone().is_none());
    let mut means: BTreeMap<String, f64> = always.map(|c| (c.key.to_owned(), 1.0)).collect();
    means.insert("psnr_rf_jet".to_owned(), psnr_rf);
    let numbers = Numbers {
        seconds: 2.0,
        gaussians: Some(10),
        peak_memory_bytes: None,
        means,
        peak_error_median_p90_deg: [0.0, 0.0],
        frames: vec![],
        curve: vec![],
        latency: None,
        depth: None,
    };
    Record {
        schema: String::new(),
        protocol: String::new(),
        split: Protocol::Test,
        row: row.to_owned(),
        method: "corf-gs".to_owned(),
        config: serde_json::Value::Null,
        dataset: "d".to_owned(),
        dataset_hash: "h".to_owned(),
        dataset_verified: true,
        seed,
        provenance: Provenance::here(),
        lpips_weights: BTreeMap::new(),
        device: String::new(),
        uses_ground_truth_depth: row == "full",
        clock: String::new(),
        outcome: Outcome::Done(Box::new(numbers)),
    }
}

#[test]
fn differences_are_paired_by_seed_and_bold_only_when_they_exclude_zero() {
    // The seeds spread by 4 dB, the paired difference is steady at −1: pairing is what finds it.
    let mut records = vec![record("full", 1, 18.0), record("full", 2, 20.0), record("full", 3, 22.0)];
    records.extend([record("frozen", 1, 17.0), record("frozen", 2, 18.9), record("frozen", 3, 21.1)]);
    records.extend([record("noisy", 1, 17.0), record("noisy", 2, 21.0), record("noisy", 3, 22.1)]);
    let table = markdown(&rows(&records));
    assert!(table.contains("**-1.00 ± 0.25**"), "{table}");
    assert!(!table.lines().find(|l| l.contains("noisy")).unwrap().contains("**"), "{table}");
    assert!(table.contains("used by: full."), "{table}");
}

#[test]
fn what_is_text_stays_text_in_every_notation() {
    let label = "=50% {a}_b & \\x #1 ~^ <b>`c`</b>";
    let mut failed = record(label, 2, 0.0);
    failed.outcome = Outcome::Failed { error: "line one\nline | two\u{1b}[2J".to_owned() };
    let records = [record("full", 1, 18.0), record(label, 1, 17.0), failed];
    let rows = rows(&records);
    let tex = latex(&rows);
    assert!(tex.contains(r"=50\% \{a\}\_b \& \textbackslash{}x \#1 \textasciitilde{}\textasciicircum{} \textless{}b"), "{tex}");
    let lines = tex.lines().filter(|l| !l.starts_with(' ') && !l.starts_with('%') && !l.starts_with('\\'));
    assert_eq!(lines.count(), 0, "an error's line end must not leave the comment: {tex}");
    let csv = csv(&records);
    assert_eq!(csv.lines().count(), 4, "{csv}");
    assert!(csv.contains("\"'=50% {a}_b"), "{csv}");
    let markdown = markdown(&rows);
    let columns = |line: &str| line.replace(r"\|", "").matches('|').count();
    let table: Vec<usize> = markdown.lines().filter(|l| l.starts_with('|')).map(columns).collect();
    assert!(table.len() == 4 && table.iter().all(|n| *n == table[0]), "{markdown}");
    assert!(markdown.contains(r"&lt;b&gt;\`c\`&lt;/b&gt;"), "{markdown}");
}

#[test]
fn unchecked_datasets_are_told() {
    let mut records = [record("full", 1, 18.0), record("fast", 1, 17.0)];
    assert!(!markdown(&rows(&records)).contains("SHA-256"));
    records[1].dataset_verified = false;
    assert!(markdown(&rows(&records)).contains("recorded SHA-256: fast."));
}

#[test]
fn a_failed_cell_stays_in_every_table() {
    let mut failed = record("frozen", 2, 0.0);
    failed.outcome = Outcome::Failed { error: "out of memory".to_owned() };
    let records = [record("full", 1, 18.0), failed];
    assert!(markdown(&rows(&records)).contains("out of memory"));
    assert!(latex(&rows(&records)).contains("frozen"));
    let csv = csv(&records);
    let columns: Vec<usize> = csv.lines().map(|l| l.matches(',').count()).collect();
    assert!(columns.iter().all(|&n| n == columns[0]), "{csv}");
}

/// A record with LPIPS by these backbones.
fn with_lpips(row: &str, seed: u64, backbones: &[&str]) -> Record {
    let mut record = record(row, seed, 18.0);
    if let Outcome::Done(numbers) = &mut record.outcome {
        let computed = COLUMNS.iter().filter(|c| c.backbone().is_some_and(|b| backbones.contains(&b)));
        numbers.means.extend(computed.map(|c| (c.key.to_owned(), 0.25)));
    }
    record
}

#[test]
fn lpips_has_columns_where_it_was_computed() {
    let none = [record("full", 1, 18.0)];
    for text in [markdown(&rows(&none)), latex(&rows(&none)), plain(&rows(&none)), csv(&none)] {
        assert!(!text.to_lowercase().contains("lpips"), "{text}");
    }
    // The first backbone in the short table, all in the CSV.
    let some = [with_lpips("full", 1, &["alex", "squeeze"]), with_lpips("fast", 1, &["alex", "squeeze"])];
    let table = markdown(&rows(&some));
    assert!(table.contains("| LPIPS-Alex [-1,1] opt ↓ | LPIPS-Alex [-1,1] rf (Jet) ↓ | LPIPS-Alex [0,1] opt ↓ |"), "{table}");
    assert!(
        table.contains("| 0.250 | 0.250 | 0.250 | 0.250 |") && !table.contains("Squeeze") && !table.contains("VGG"),
        "{table}"
    );
    assert!(!table.contains("not computed"), "{table}");
    assert!(latex(&rows(&some)).contains(r"LPIPS$_\mathrm{rf}^\downarrow$ (Alex, $[0,1]$)"));
    let csv = csv(&some);
    assert!(csv.contains("lpips_alex_01_rf_jet") && csv.contains("lpips_squeeze_opt") && !csv.contains("vgg"), "{csv}");
    assert!(csv.lines().all(|l| l.matches(',').count() == csv.lines().next().unwrap().matches(',').count()), "{csv}");
}

#[test]
fn rows_without_lpips_are_named_where_a_table_has_it() {
    // One seed of two lacks it: its mean would be of another set of seeds than the rest of the row.
    let records = [
        with_lpips("full", 1, &["vgg"]),
        with_lpips("full", 2, &["vgg"]),
        with_lpips("half", 1, &["vgg"]),
        record("half", 2, 18.0),
    ];
    let rows = rows(&records);
    for text in [markdown(&rows), latex(&rows), plain(&rows)] {
        assert!(text.contains("LPIPS not computed, for no weights were given") && text.contains("folder): half."), "{text}");
    }
    let table = markdown(&rows);
    assert!(table.lines().any(|l| l.starts_with("| half |") && l.contains("| – | – | – | – |")), "{table}");
    let asked = markdown_of(&super::rows(&records[3..]), &["psnr_opt", "lpips_vgg_01_rf_jet"]).unwrap();
    assert!(asked.contains("| LPIPS-VGG [0,1] rf (Jet) ↓ |") && asked.contains("LPIPS not computed"), "{asked}");
    let unasked = markdown_of(&rows, &["psnr_opt"]).unwrap();
    assert!(!unasked.contains("LPIPS"), "{unasked}");
}
