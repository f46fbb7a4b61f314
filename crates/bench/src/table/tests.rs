//! What tables say and how text stays text in them.

use super::columns::SHORT;
use super::*;
use crate::metrics::{COLUMNS, FrameMetrics, LightMetrics, RADIO};
use crate::record::provenance::Provenance;
use crate::record::{NOT_STATED, Outcome, PROTOCOL, SCHEMA};
use std::collections::BTreeMap;

fn record(row: &str, seed: u64, psnr_rf: f64) -> Record {
    let mut means: BTreeMap<String, f64> =
        COLUMNS.iter().filter(|c| c.backbone().is_none()).map(|c| (c.key.to_owned(), 1.0)).collect();
    means.extend(["psnr_rf_jet", "psnr_rf_scalar"].map(|key| (key.to_owned(), psnr_rf)));
    let numbers = Numbers {
        seconds: Some(2.0),
        gaussians: Some(10),
        peak_memory_bytes: None,
        peak_device_memory_bytes: None,
        means,
        peak_error_median_p90_deg: None,
        frames: vec![],
        curve: vec![],
        latency: None,
        depth: None,
        stages: vec![],
    };
    Record {
        schema: SCHEMA.to_owned(),
        protocol: PROTOCOL.to_owned(),
        split: Protocol::TEST,
        row: row.to_owned(),
        method: "corf-gs".to_owned(),
        config: serde_json::Value::Null,
        dataset: "d".to_owned(),
        dataset_hash: "h".to_owned(),
        dataset_verified: true,
        seed,
        cell: None,
        provenance: Provenance::here(),
        lpips_weights: BTreeMap::new(),
        lpips_device: None,
        device: "cpu (2 threads)".to_owned(),
        uses_ground_truth_depth: row == "full",
        depth_imported: false,
        uses_scene: false,
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
    let table = markdown(&rows(&records), &short_columns());
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
    let tex = latex(&rows, &short_columns());
    assert!(tex.contains(r"=50\% \{a\}\_b \& \textbackslash{}x \#1 \textasciitilde{}\textasciicircum{} \textless{}b"), "{tex}");
    let lines = tex.lines().filter(|l| !l.starts_with(' ') && !l.starts_with('%') && !l.starts_with('\\'));
    assert_eq!(lines.count(), 0, "an error's line end must not leave the comment: {tex}");
    let csv = csv(&records);
    assert_eq!(csv.lines().count(), 4, "{csv}");
    assert!(csv.contains("\"'=50% {a}_b"), "{csv}");
    let markdown = markdown(&rows, &short_columns());
    let columns = |line: &str| line.replace(r"\|", "").matches('|').count();
    let table: Vec<usize> = markdown.lines().filter(|l| l.starts_with('|')).map(columns).collect();
    assert!(table.len() == 4 && table.iter().all(|n| *n == table[0]), "{markdown}");
    assert!(markdown.contains(r"&lt;b&gt;\`c\`&lt;/b&gt;"), "{markdown}");
}

#[test]
fn unchecked_datasets_are_told() {
    let mut records = [record("full", 1, 18.0), record("fast", 1, 17.0)];
    assert!(!markdown(&rows(&records), &short_columns()).contains("SHA-256"));
    records[1].dataset_verified = false;
    assert!(markdown(&rows(&records), &short_columns()).contains("recorded SHA-256: fast."));
}

#[test]
fn images_that_a_mask_covers_are_counted_under_the_table() {
    let mut records = [record("full", 1, 18.0), record("radio alone", 1, 17.0)];
    assert!(!markdown(&rows(&records), &short_columns()).contains("mask"));
    let light = LightMetrics { psnr_opt: 30.0, ssim_opt: 0.9 };
    let frame = |index: usize, masked_out: bool| {
        let light = (!masked_out).then_some(light);
        FrameMetrics { index, masked_out, light, spectrum: None, lpips: BTreeMap::new() }
    };
    let frames = vec![frame(0, false), frame(8, true), frame(16, true)];
    records[0].outcome = Outcome::Done(Box::new(Numbers::of(frames, Some(2.0), Some(10), None, vec![], None)));
    let table = markdown(&rows(&records), &short_columns());
    assert!(table.contains("for a mask covers all of their pixels: 2."), "{table}");
    // The record is whole although two of its frames have no metrics; one that lacks them for no reason is not.
    let path = tempfile::tempdir().unwrap();
    let path = path.path().join("metrics.json");
    records[0].write(&path).unwrap();
    let Outcome::Done(numbers) = &mut records[0].outcome else { panic!() };
    assert!(numbers.means["psnr_opt"] == 30.0 && numbers.masked_out() == 2);
    assert!(matches!(Record::read(&path).unwrap().outcome, Outcome::Done(read) if read.frames == numbers.frames));
    numbers.frames[1].masked_out = false;
    records[0].write(&path).unwrap();
    assert!(format!("{:#}", Record::read(&path).unwrap_err()).contains("keyframe 8 has no metrics"));
}

#[test]
fn depth_is_said_to_be_the_ray_tracers_or_a_captures() {
    let mut records = [record("full", 1, 18.0), record("measured", 1, 17.0), record("none", 1, 16.0)];
    (records[1].uses_ground_truth_depth, records[1].depth_imported) = (true, true);
    let rows = rows(&records);
    let note = note(&rows.iter().collect::<Vec<_>>(), &short_columns());
    let sentences: Vec<&str> = note.split(". ").filter(|s| s.contains("used by")).collect();
    assert_eq!(sentences.len(), 2, "{note}");
    assert!(sentences[0].contains("ray tracer's depth") && sentences[0].ends_with("used by: full"), "{note}");
    assert!(sentences[1].contains("imported capture") && sentences[1].contains("used by: measured"), "{note}");
}

#[test]
fn oracles_are_said_under_the_table_and_other_tables_stay_as_they_are() {
    let mut records = [record("full", 1, 18.0), record("true images (oracle)", 1, 19.0)];
    let texts = |records: &[Record]| (markdown(&rows(records), &short_columns()), csv(records));
    let (table, list) = texts(&records);
    assert!(!table.contains("true scene") && !list.contains("uses_scene"));
    records[1].uses_scene = true;
    let (table, list) = texts(&records);
    assert!(table.contains("The true scene (mirror images of the transmitter) used by: true images (oracle)."), "{table}");
    let lines: Vec<&str> = list.lines().collect();
    assert!(lines[0].ends_with(",uses_ground_truth_depth,uses_scene,error"), "{list}");
    assert!(lines[1].ends_with(",true,false,") && lines[2].ends_with(",false,true,"), "{list}");
    // Records of before know nothing of it.
    let old = serde_json::to_value(&records[0]).unwrap();
    assert!(old.get("uses_scene").is_none() && !serde_json::from_value::<Record>(old).unwrap().uses_scene);
}

#[test]
fn rows_of_another_data_set_than_most_are_named_with_it() {
    let mut records = [record("field", 1, 17.0), record("full", 1, 18.0), record("full", 2, 18.0), record("other", 1, 17.0)];
    assert!(!markdown(&rows(&records), &short_columns()).contains("Of data set"));
    (records[0].dataset, records[0].dataset_hash) = ("radio".to_owned(), "0123456789abcdef".to_owned());
    let table = markdown(&rows(&records), &short_columns());
    assert!(table.contains(" Of data set radio (hash 0123456789ab), not d (hash h): field."), "{table}");
    // A seed of a row counts as well.
    records[2].dataset_hash = "fedcba9876543210".to_owned();
    let table = markdown(&rows(&records), &short_columns());
    assert!(table.contains(" Of data set d (hash fedcba987654), not d (hash h): full."), "{table}");
}

#[test]
fn caveats_name_all_rows_or_their_exceptions_and_labels_may_contain_commas() {
    let note_of = |labels: &[(&str, bool)]| {
        let mut records: Vec<Record> = labels.iter().map(|(label, _)| record(label, 1, 18.0)).collect();
        records.iter_mut().zip(labels).for_each(|(r, (_, verified))| r.dataset_verified = *verified);
        let rows = rows(&records);
        note(&rows.iter().collect::<Vec<_>>(), &short_columns())
    };
    for (labels, said) in [
        (&[("a, one", false), ("b", false)][..], "SHA-256: all rows."),
        (&[("a, one", false), ("b", false), ("c, two", true)], "SHA-256: all rows but c, two."),
        (&[("a, one", false), ("b", false), ("c", true), ("d", true)], "SHA-256: a, one; b."),
        (&[("a; one", false), ("b", true)], "SHA-256: \"a; one\"."),
        (&[("a, one", false)], "SHA-256: a, one."),
    ] {
        let note = note_of(labels);
        assert!(note.contains(said), "{note}");
    }
}

#[test]
fn a_failed_cell_stays_in_every_table() {
    let mut failed = record("frozen", 2, 0.0);
    failed.outcome = Outcome::Failed { error: "out of memory".to_owned() };
    let records = [record("full", 1, 18.0), failed];
    assert!(markdown(&rows(&records), &short_columns()).contains("out of memory"));
    assert!(latex(&rows(&records), &short_columns()).contains("frozen"));
    let csv = csv(&records);
    let columns: Vec<usize> = csv.lines().map(|l| l.matches(',').count()).collect();
    assert!(columns.iter().all(|&n| n == columns[0]), "{csv}");
}

#[test]
fn columns_are_named_by_key_or_group_and_shown_once() {
    let keys = |words: &[&str]| columns(words).unwrap().metrics.iter().map(|c| c.key).collect::<Vec<_>>();
    assert_eq!(keys(&[]), SHORT);
    assert_eq!(keys(&["rmse_db_30", "radio"]), keys(&["radio"]));
    assert_eq!(keys(&["short", "radio"]).len(), SHORT.len() + RADIO.len() - 2, "rmse_db_30 and codebook_loss_db are in both");
    assert_eq!(keys(&["all"]).len(), COLUMNS.len());
    let error = columns(&["psnr_rf"]).unwrap_err().to_string();
    assert!(error.contains("psnr_rf") && error.contains("psnr_rf_jet") && error.contains("radio"), "{error}");
}

#[test]
fn what_a_record_lacks_is_a_dash_and_no_column_of_the_csv() {
    let mut old = record("full", 1, 18.0);
    let Outcome::Done(numbers) = &mut old.outcome else { unreachable!() };
    numbers.means.retain(|key, _| !key.starts_with("codebook"));
    let records = [old];
    let table = markdown(&rows(&records), &columns(&["psnr_opt", "codebook_loss_db"]).unwrap());
    assert!(table.contains("| full | 1.00 | – | – | 10 | 2.0 |"), "{table}");
    // A column that a reader may not know is defined below the table.
    assert!(table.contains(r"max\_b P\_b"), "{table}");
    assert!(!csv(&records).contains("codebook") && csv(&records).contains("beam_top1"));
}

#[test]
fn what_is_only_stated_is_marked_in_every_notation() {
    let mut outsider = record("theirs", 1, 19.0);
    outsider.method = PREDICTIONS.to_owned();
    let mut silent = record("silent", 1, 19.0);
    silent.method = PREDICTIONS.to_owned();
    let Outcome::Done(numbers) = &mut silent.outcome else { unreachable!() };
    (numbers.seconds, numbers.gaussians) = (None, None);
    let records = [record("ours", 1, 18.0), outsider, silent];
    let (rows, short) = (rows(&records), short_columns());
    let table = markdown(&rows, &short);
    assert!(table.contains("| 10 † | 2.0 † |") && table.contains("| – | – |") && table.contains("| 10 | 2.0 |"), "{table}");
    assert!(table.contains("scored here: theirs; silent (†"), "{table}");
    assert!(latex(&rows, &short).contains(r"& $10^{\dagger}$ & $2.0^{\dagger}$") && plain(&rows, &short, None).contains("2.0 †"));
    assert!(siunitx(&rows, &short).contains(r"& 10 {${}^{\dagger}$} & 2.0 {${}^{\dagger}$}"), "{}", siunitx(&rows, &short));
    assert!(latex(&rows, &short).contains("& -- & --") && siunitx(&rows, &short).contains("& {--} & {--}"));
    assert!(csv(&records).lines().nth(3).unwrap().contains(",done,,,"), "{}", csv(&records));
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
fn rows_with_lpips_of_spectra_alone_and_rows_with_fewer_seeds_are_named() {
    let spectra = |seed: u64| {
        let mut record = with_lpips("spectra", seed, &["vgg"]);
        if let Outcome::Done(numbers) = &mut record.outcome {
            numbers.means.retain(|key, _| !(key.starts_with("lpips") && key.ends_with("_opt")));
        }
        record
    };
    let records = [spectra(1), spectra(2), with_lpips("both", 1, &["vgg"])];
    let text = markdown(&rows(&records), &columns(&["lpips"]).unwrap());
    assert!(text.contains("over 2 seeds, 1 of both."), "{text}");
    assert!(text.contains("LPIPS computed of some images or with some networks alone: spectra."), "{text}");
    assert!(!text.contains("LPIPS not computed"), "{text}");
}

#[test]
fn lpips_has_columns_where_it_is_asked_for_and_tells_whose_is_missing() {
    let records = [
        with_lpips("full", 1, &["vgg", "squeeze"]),
        with_lpips("full", 2, &["vgg"]),
        with_lpips("half", 1, &["vgg"]),
        record("half", 2, 18.0),
    ];
    let rows = rows(&records);
    let asked = columns(&["psnr_opt", "lpips"]).unwrap();
    for text in [markdown(&rows, &asked), latex(&rows, &asked), plain(&rows, &asked, None)] {
        assert!(text.contains("LPIPS not computed, for no weights were given") && text.contains("folder): half."), "{text}");
    }
    let table = markdown(&rows, &asked);
    assert!(table.contains("| LPIPS-VGG [-1,1] opt ↓ | LPIPS-VGG [-1,1] rf (Jet) ↓ | LPIPS-VGG [0,1] opt ↓ |"), "{table}");
    assert!(table.lines().any(|l| l.starts_with("| full |") && l.contains("| 0.250 ‡ |")), "{table}");
    assert!(table.lines().any(|l| l.starts_with("| half |") && l.contains("| – | – | – | – |")), "{table}");
    let unasked = markdown(&rows, &columns(&["psnr_opt"]).unwrap());
    assert!(!unasked.contains("LPIPS"), "{unasked}");
    // CSV has what any record has.
    let csv = csv(&records);
    assert!(csv.contains("lpips_vgg_01_rf_jet") && csv.contains("lpips_squeeze_opt") && !csv.contains("alex"), "{csv}");
}

#[test]
fn cells_of_different_devices_have_rows_of_their_own_and_the_note_says_which_ran_where() {
    let on = |row: &str, seed, device: &str| Record { device: device.to_owned(), ..record(row, seed, 18.0 + seed as f64) };
    let lookup = |device: &str| Record { method: "nearest".to_owned(), ..on("nearest", 1, device) };
    // A lookup runs on the processor, whatever the others run on; half precision is no other device.
    for records in [
        vec![on("full", 1, "gpu (A)"), on("full", 2, "gpu (A)"), lookup("cpu (2 threads)")],
        vec![on("full", 1, "gpu (A)"), on("f16", 1, "gpu (A), f16 products")],
        vec![on("full", 1, "gpu (A)"), Record { method: PREDICTIONS.to_owned(), ..on("theirs", 1, NOT_STATED) }],
    ] {
        let (table, csv) = (markdown(&rows(&records), &short_columns()), csv(&records));
        assert!(!table.contains(" ran on ") && !table.contains("Ran on") && !csv.contains("device"), "{table}{csv}");
    }
    let mut records =
        vec![on("full", 1, "gpu (A)"), on("full", 2, "cpu (2 threads)"), on("full", 3, "gpu (A)"), lookup("cpu (2 threads)")];
    let table = markdown(&rows(&records), &short_columns());
    let lines: Vec<&str> = table.lines().skip(2).take(3).map(|line| line.split(" | ").next().unwrap()).collect();
    assert_eq!(lines, ["| full, on gpu (A)", "| full, on cpu (2 threads)", "| nearest"]);
    assert!(table.contains("over 2 seeds, 1 of full, on cpu (2 threads); nearest"), "{table}");
    assert!(table.contains("Ran on gpu (A): full") && table.contains("Ran on cpu (2 threads): full"), "{table}");
    let list = csv(&records);
    assert!(list.lines().next().unwrap().ends_with(",device,error") && list.contains(",\"gpu (A)\","), "{list}");
    // A cell that failed has nothing that could be mixed with others.
    records[1].outcome = Outcome::Failed { error: "out of memory".to_owned() };
    let table = markdown(&rows(&records), &short_columns());
    assert!(table.contains("| full (failed cells) |") && !table.contains("Ran on"), "{table}");
    // Lookups as well, where cells of one label ran apart.
    let apart = [lookup("cpu (2 threads)"), Record { seed: 2, ..lookup("gpu (A)") }];
    let (table, list) = (markdown(&rows(&apart), &short_columns()), csv(&apart));
    assert!(table.contains("Ran on gpu (A): nearest, on gpu (A).") && list.contains(",device,"), "{table}{list}");
    // Two makes of processor are two devices.
    let mut records = [on("full", 1, "cpu (2 threads)"), on("full", 2, "cpu (2 threads)")];
    records[1].provenance.processor = "another make".to_owned();
    let table = markdown(&rows(&records), &short_columns());
    assert!(table.contains("| full, on cpu (2 threads), another make |"), "{table}");
    // What was evaluated by an older protocol says so.
    records.iter_mut().for_each(|record| record.protocol = "corf-heldout/1".to_owned());
    let table = markdown(&rows(&records), &short_columns());
    assert!(table.contains("Metrics are those of corf-heldout/1; this version's are corf-heldout/2."), "{table}");
}

#[test]
fn every_column_can_be_chosen_or_left_out() {
    let records = [record("ours", 1, 18.0), record("ours", 2, 18.4), record("other", 1, 17.0), record("other", 2, 17.2)];
    let rows = rows(&records);
    let headings = |words: &[&str]| {
        let table = markdown(&rows, &columns(words).unwrap());
        table.lines().next().unwrap().trim_matches(['|', ' ']).split(" | ").map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(headings(&["psnr_opt", "seeds", "time"]), ["method", "PSNR opt ↑", "seeds", "time, s"]);
    assert_eq!(headings(&["psnr_opt", "-gaussians"]), ["method", "PSNR opt ↑", "Δ PSNR opt to first row", "time, s"]);
    assert_eq!(headings(&["psnr_rf_jet", "delta", "-psnr_rf_jet", "psnr_opt"])[1..], ["PSNR opt ↑", "Δ PSNR opt to first row"]);
    let all = headings(&[]);
    assert_eq!(headings(&["-time"]), all[..all.len() - 1]);
    // Every notation has what was asked for, and what it usually has where nothing was.
    let asked = columns(&["psnr_opt", "delta", "seeds"]).unwrap();
    assert!(
        latex(&rows, &asked).contains(r"$\Delta$")
            && latex(&rows, &asked).contains("Seeds")
            && !latex(&rows, &asked).contains("Gaussians")
    );
    assert!(plain(&rows, &asked, None).lines().next().unwrap().ends_with("seeds"));
    assert!(!latex(&rows, &short_columns()).contains("Delta") && latex(&rows, &short_columns()).contains("Gaussians"));
    let error = columns(&["psnr_op"]).unwrap_err().to_string();
    assert!(error.contains("did you mean psnr_opt?"), "{error}");
    // The beginning of a key is known, an empty word is named as such, and a table has a metric.
    for (words, said) in [
        (&["psnr"][..], "did you mean psnr_opt?"),
        (&["psnr_opt", "", "time"], "word 2 is empty"),
        (&[" "], "word 1 is empty"),
        (&["psnr_opt", "-"], "word 2 is empty"),
        (&["-short"], "no metric is left"),
        (&["psnr_opt", "-all", "time"], "no metric is left"),
    ] {
        let error = columns(words).unwrap_err().to_string();
        assert!(error.contains(said) && error.contains("help: "), "{words:?}: {error}");
    }
}

#[test]
fn two_seeds_show_their_mean_and_say_that_they_are_too_few() {
    let three = (1..=3).map(|seed| record("three", seed, 18.0 + 0.1 * seed as f64));
    let two = [record("two", 1, 17.0), record("two", 2, 30.0)];
    let records: Vec<Record> = three.chain(two).collect();
    let mixed = rows(&records);
    let asked = columns(&["psnr_rf_jet", "delta", "seeds"]).unwrap();
    let table = markdown(&mixed, &asked);
    assert!(table.contains("| three | 18.20 ± 0.25 | – | 3 |"), "{table}");
    // With Student's t it would be 23.50 ± 82.59; so would the difference, which is of the seeds that both have.
    assert!(table.contains("| two | 23.50 ‡ | 5.35 ‡ | 2 |"), "{table}");
    assert!(table.contains("over 3 seeds, 2 of two. ") && table.contains(TOO_FEW_NOTE), "{table}");
    let tex = latex(&mixed, &asked);
    assert!(tex.contains(r"two & $23.50^{\ddagger}$ & $5.35^{\ddagger}$ & $2$") && tex.contains(TOO_FEW_NOTE), "{tex}");
    // In what LaTeX sets, not in a comment alone; nothing is the best beside a mean of two.
    for (tex, marks) in [(tex, true), (siunitx(&mixed, &asked), true), (latex(&rows(&records[..3]), &asked), false)] {
        let set = tex.lines().map(|line| line.split('%').next().unwrap()).collect::<Vec<_>>().join("\n");
        let line = r"  \multicolumn{4}{l}{\footnotesize $^{\ddagger}$ Mean of two seeds: too few for a confidence interval.} \\";
        assert_eq!(set.contains(line), marks, "{set}");
        assert!(!set.contains("bfseries ") && !set.contains("mathbf"), "{set}");
    }
    assert!(plain(&mixed, &asked, None).contains(TOO_FEW_NOTE));
    // Where all have two there is no interval at all, and where none has, nothing is said of it.
    let pairs = rows(&records[3..]);
    let table = markdown(&pairs, &asked);
    assert!(table.contains("Mean over 2 seeds. ‡ Mean of two seeds") && !table.contains('±'), "{table}");
    assert!(!markdown(&rows(&records[..3]), &asked).contains('‡'));
}

#[test]
fn latex_is_plain_booktabs_with_the_best_in_bold_and_siunitx_aligns_its_numbers() {
    let records: Vec<Record> = (1..=3)
        .flat_map(|seed| [record("ours", seed, 18.0 + 0.1 * seed as f64), record("other", seed, 8.0 + seed as f64)])
        .collect();
    let rows = rows(&records);
    let asked = columns(&["psnr_rf_jet", "delta", "time"]).unwrap();
    let tex = latex(&rows, &asked);
    assert!(tex.starts_with("\\begin{tabular}{lrrr}\n  \\toprule\n  Method & PSNR$"), "{tex}");
    assert!(!tex.contains('|') && !tex.contains("\\hline"), "{tex}");
    assert!(tex.contains(r"ours & $\mathbf{18.20 \pm 0.25}$ & -- & ") && tex.contains(r"other & $10.00 \pm 2.48$ & "), "{tex}");
    // 1.1 − 3 and so on: −8.2 ± 2.24, which excludes zero.
    assert!(tex.contains(r"& $\mathbf{-8.20 \pm 2.24}$ &"), "{tex}");
    let tex = siunitx(&rows, &asked);
    assert!(tex.contains("{lS[table-format=2.2(3)]S[table-format=-1.2(3)]S[table-format="), "{tex}");
    assert!(
        tex.contains(r" & {PSNR$_\mathrm{rf}^\uparrow$} & {$\Delta$ ")
            && tex.contains(r"ours & \bfseries 18.20 \pm 0.25 & {--} & "),
        "{tex}"
    );
    assert!(
        tex.contains(r"other & 10.00 \pm 2.48 & \bfseries -8.20 \pm 2.24 & ") && tex.contains("% \\usepackage{booktabs,siunitx"),
        "{tex}"
    );
}

#[test]
fn a_table_for_a_terminal_is_no_wider_than_it() {
    let records: Vec<Record> =
        (1..=3).flat_map(|seed| [record("CORF-GS", seed, 18.0), record("w/o joint (frozen geometry)", seed, 17.0)]).collect();
    let rows = rows(&records);
    let asked = columns(&["short", "radio"]).unwrap();
    let whole = plain(&rows, &asked, None);
    assert!(whole.lines().map(|line| line.chars().count()).max() > Some(400));
    for width in [60, 80, 120] {
        let narrow = plain(&rows, &asked, Some(width));
        let widest = narrow.lines().map(|line| line.chars().count()).max();
        assert!(widest <= Some(width), "{width}: {widest:?}\n{narrow}");
        // Every column is there once, and every block says whose it is.
        let blocks = narrow.lines().filter(|line| line.starts_with("method ")).count();
        assert_eq!(narrow.lines().filter(|line| line.starts_with("CORF-GS ")).count(), blocks);
        asked.metrics.iter().for_each(|c| assert!(narrow.contains(c.heading), "{}", c.key));
        let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let note = whole.lines().last().unwrap();
        assert!(words(&narrow).ends_with(&words(note)), "{narrow}");
    }
    // A column that is wider than the terminal is not cut.
    assert!(plain(&rows, &asked, Some(10)).contains("w/o joint (frozen geometry)"));
}
