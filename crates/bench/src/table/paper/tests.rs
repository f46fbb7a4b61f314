//! Rows find their records, what was not run stays, and every figure of the paper is as it prints it.

use super::*;
use crate::device::Backend;
use crate::methods;
use crate::record::{Numbers, Outcome};
use crate::split::Protocol;
use std::collections::BTreeMap;

fn record(row: &str, method: &str, overrides: &str, seed: u64, psnr_rf: f64) -> Record {
    let config = methods::create(method, &overrides.parse().unwrap(), &Backend::Cpu).unwrap().config();
    record_of(row, method, config, seed, psnr_rf)
}

fn record_of(row: &str, method: &str, config: serde_json::Value, seed: u64, psnr_rf: f64) -> Record {
    let means = BTreeMap::from([("psnr_rf_jet".to_owned(), psnr_rf), ("psnr_opt".to_owned(), 30.0)]);
    let numbers = Numbers { means, ..Numbers::of(vec![], Some(9.0 + seed as f64), Some(10), None, vec![], None) };
    Record {
        schema: String::new(),
        protocol: crate::record::PROTOCOL.to_owned(),
        split: Protocol::TEST,
        row: row.to_owned(),
        method: method.to_owned(),
        config,
        dataset: "d_1".to_owned(),
        dataset_hash: "0123456789abcdef".to_owned(),
        dataset_verified: true,
        seed,
        cell: None,
        provenance: crate::record::provenance::Provenance::here(),
        lpips_weights: Default::default(),
        lpips_device: None,
        device: "gpu | x".to_owned(),
        uses_ground_truth_depth: true,
        depth_imported: false,
        uses_scene: false,
        clock: String::new(),
        outcome: Outcome::Done(Box::new(numbers)),
    }
}

fn records() -> Vec<Record> {
    let steps =
        |light: u64, radio: u64| serde_json::json!({ "optical_steps": light, "rf_steps": radio, "rates": { "sh_dc": 1 } });
    let mut records = vec![
        record("λ = 0.3", "corf-gs", "rf_weight = 0.3", 1, 20.0),
        record("scalar", "corf-gs", "rf_target = \"db\"", 1, 29.0),
        record("oracle", "corf-gs", "depth.prior = \"exact\"", 1, 28.0),
        record("longer", "corf-gs", "iterations_per_keyframe = 100", 1, 25.0),
        record("fine", "corf-gs", "fine_tune_epochs = 75", 1, 26.0),
        record("theirs", "corf-gs-paper", "", 1, 23.0),
        record_of("two stages", "rf-3dgs", steps(30_000, 10_000), 1, 22.0),
        record_of("two stages, short", "rf-3dgs", steps(15_000, 10_000), 1, 21.0),
    ];
    for (seed, joint, frozen) in [(1, 24.0, 22.5), (2, 26.0, 24.7), (3, 25.0, 23.6)] {
        records.push(record("joint", "corf-gs", "", seed, joint));
        records.push(record("frozen", "corf-gs-frozen", "", seed, frozen));
    }
    let mut failed = record("uniform", "corf-gs-uniform", "", 1, 0.0);
    failed.outcome = Outcome::Failed { error: "out of memory".to_owned() };
    records.push(failed);
    records
}

#[test]
fn rows_are_found_by_method_and_budget_and_the_methods_own_settings_come_first() {
    let records = records();
    let rows = table::rows(&records);
    let tables = tables(&rows);
    let labels = |table: usize| tables[table].lines.iter().map(|l| (l.name.as_str(), l.label())).collect::<Vec<_>>();
    assert_eq!(
        labels(0),
        [
            ("NeRF²", None),
            ("WRF-GS+", None),
            ("RF-3DGS", Some("two stages")),
            ("CORF-GS", Some("joint")),
            ("CORF-GS, the paper's constants", Some("theirs"))
        ]
    );
    assert_eq!(
        labels(3).iter().map(|l| l.1).collect::<Vec<_>>(),
        [Some("uniform"), Some("frozen"), None, Some("joint"), Some("theirs")]
    );
    let of = |table: usize, name: &str| tables[table].lines.iter().find(|l| l.name == name).unwrap();
    assert_eq!(of(1, "RF-3DGS, 15 000 + 10 000").label(), Some("two stages, short"));
    assert_eq!(of(1, "CORF-GS, 100 a keyframe").label(), Some("longer"));
    assert_eq!(of(2, "CORF-GS, fine-tuned 75").label(), Some("fine"));
    assert_eq!(of(3, "w/o optical-guided expansion").cell(Figure::PsnrRadio), Ours::Failed);
    assert_eq!(of(3, "w/o joint (RF-tuned geometry)").cell(Figure::PsnrRadio), Ours::NotRun);
    assert_eq!(of(0, "CORF-GS").cell(Figure::LpipsRadio), Ours::NotComputed);
    // Paired by seed: −1.5, −1.3, −1.4.
    let difference = of(3, "w/o joint (frozen geometry)").difference.unwrap();
    assert!((difference.mean + 1.4).abs() < 1e-9 && difference.half_width_95.unwrap() < 0.26, "{difference:?}");
}

#[test]
fn a_row_that_failed_gives_way_to_one_with_other_settings() {
    let mut records = records();
    records.push(record("uniform, fewer", "corf-gs-uniform", "uniform_probability = 0.03", 1, 20.0));
    let rows = table::rows(&records);
    let tables = tables(&rows);
    let line = tables[3].lines.iter().find(|l| l.name == "w/o optical-guided expansion").unwrap();
    assert_eq!(line.label(), Some("uniform, fewer"));
    let md = markdown(&tables, &notations::head(&records));
    assert!(md.contains("\"uniform, fewer\" has settings that are not those of corf-gs-uniform"), "{md}");
    assert!(md.contains("stand behind \"uniform, fewer\": uniform (failed)."), "{md}");
}

#[test]
fn every_row_of_the_paper_stands_in_every_notation_with_both_figures() {
    let records = records();
    let rows = table::rows(&records);
    let tables = tables(&rows);
    let head = notations::head(&records);
    let (md, tex, csv) = (markdown(&tables, &head), latex(&tables, &head), csv(&tables));
    for table in TABLES {
        for row in table.rows {
            assert!(md.contains(&format!("| {} |", row.name)), "{}", row.name);
            assert!(csv.contains(&format!(",\"{}\",", row.name)), "{}", row.name);
        }
    }
    assert!(md.contains("| NeRF² | – | not run | 12.17 | not run | 0.594 |"), "{md}");
    assert!(
        md.contains("| w/o joint (frozen geometry) | frozen | 30.00 ± 0.00 | 37.23 |") && md.contains("| -1.40 ± 0.25 | -1.41 |"),
        "{md}"
    );
    assert!(
        md.contains("only the shape can be compared") && md.contains(r"d\_1 (hash 0123456789ab)") && md.contains(r"gpu \| x"),
        "{md}"
    );
    assert!(md.contains("FAILED: uniform, seed 1: out of memory"), "{md}");
    assert!(md.contains("stand behind \"joint\": λ = 0.3") && !md.contains("scalar") && !md.contains("oracle"), "{md}");
    let cells = |line: &&str| line.replace(r"\|", "").matches('|').count();
    for part in md.split("\n## ").skip(1).take(4) {
        let counts: Vec<usize> = part.lines().filter(|l| l.starts_with('|')).map(|l| cells(&l)).collect();
        assert!(counts.len() > 5 && counts.iter().all(|n| *n == counts[0]), "{part}");
    }
    assert!(tex.contains(r"NeRF$^2$ & not run & $12.17$") && tex.contains(r"$25.00 \pm 2.48$ & $18.52$"), "{tex}");
    assert!(!tex.contains('–') && tex.matches(r"\begin{tabular}").count() == 4);
    assert!(csv.contains("I,\"RF-3DGS\",rf-3dgs,\"two stages\",psnr_rf,done,22.000000,,1,16.92\n"), "{csv}");
    assert!(csv.contains("I,\"NeRF²\",nerf2,\"\",seconds,not run,,,,14941\n"), "{csv}");
    assert!(csv.lines().all(|l| l.split(',').count() >= 10));
}

#[test]
fn a_folder_without_any_of_its_rows_still_has_the_papers_tables_and_figure() {
    let records = [record("nearest", "nearest", "", 1, 18.0)];
    let folder = tempfile::tempdir().unwrap();
    let written = write(&records, folder.path()).unwrap();
    assert_eq!(written.len(), FILES.len());
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!(read("paper.csv").lines().filter(|l| l.contains(",not run,,,,")).count(), 4 * 4 + 13 * 3 + 5 * 7 + 4 * 7);
    assert!(read("paper.svg").contains("CORF-GS (ours not run)"));
}

#[test]
fn the_figure_has_a_point_for_every_time_of_the_paper_and_of_ours() {
    let records = records();
    let rows = table::rows(&records);
    let tables = tables(&rows);
    let svg = chart::svg(&tables).unwrap();
    // The paper's: three baselines, CORF-GS with and without fine-tuning, three ablations; ours: two of RF-3DGS, joint, its constants, longer,
    // fine, frozen. Seven more in the legend.
    assert_eq!(svg.matches("<circle").count(), (3 + 5 + 3) + 7 + 7, "{svg}");
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
}

#[test]
fn the_papers_figures_agree_with_each_other() {
    // What the paper prints twice is the same twice; rows are as long as their heads.
    let mut seen: Vec<(PaperMethod, &[u64], Figure, f64)> = Vec::new();
    for table in TABLES {
        for row in table.rows {
            assert_eq!(row.values.len(), table.figures.len(), "{}", row.name);
            assert_eq!(row.budget.len(), row.family.budget().len(), "{}", row.name);
            for (figure, value) in table.figures.iter().zip(row.values) {
                let before = seen.iter().find(|s| (s.0, s.1, s.2) == (row.family, row.budget, *figure));
                assert!(before.is_none_or(|s| s.3 == *value), "{} {figure:?}", row.name);
                seen.push((row.family, row.budget, *figure, *value));
            }
        }
    }
    assert!(seen.contains(&(USUAL.0, USUAL.1, Figure::PsnrRadio, USUAL_PSNR_RADIO)));
}
