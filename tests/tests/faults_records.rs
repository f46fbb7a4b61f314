//! Tables from records of other people, and sweeps on a cluster: what may not stand in one table is refused with both places, and
//! what was submitted is what is reported.

use crate::common::*;
use corf_scene::io;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// A finished comparison of two lookups with two seeds each.
fn comparison(folder: &Path) -> PathBuf {
    let (plan, out) = (folder.join("plan.toml"), folder.join("out"));
    let row = |label: &str, method: &str| format!("[[row]]\nlabel = \"{label}\"\nmethod = \"{method}\"\n");
    let rows = row("nearest", "nearest") + &row("blend", "inverse-distance");
    fs::write(&plan, format!("name = \"x\"\ndataset = {:?}\nseeds = [1, 2]\n{rows}", tiny_dataset())).unwrap();
    corf_ok(&["bench", "run", text(&plan), "--out", text(&out), "--device", "cpu"]);
    out
}

fn cell(out: &Path, name: &str) -> PathBuf {
    out.join("cells").join(format!("{name}.json"))
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Writes an archive of these records.
fn archive(folder: &Path, records: &[Value]) {
    fs::create_dir_all(folder).unwrap();
    let lines: String = records.iter().map(|record| format!("{record}\n")).collect();
    fs::write(folder.join("records.jsonl.gz"), io::gzip(lines.as_bytes()).unwrap()).unwrap();
}

#[test]
fn records_that_may_not_stand_in_one_table_are_refused_in_folders_and_archives() {
    let folder = tempfile::tempdir().unwrap();
    let out = comparison(folder.path());
    let packed = folder.path().join("packed");
    corf_ok(&["bench", "pack", text(&out), "--out", text(&packed)]);
    let table = corf_ok(&["bench", "table", text(&packed)]);
    assert_eq!(table, corf_ok(&["bench", "table", text(&out)]));
    let names = ["nearest-seed1", "nearest-seed2", "blend-seed1", "blend-seed2"];
    let sound: Vec<Value> = names.iter().map(|name| json(&cell(&out, name))).collect();
    let loose = folder.path().join("loose");
    let psnr = sound[1]["means"]["psnr_opt"].as_f64().unwrap();
    let changes: Vec<(&str, &str, Value, &[&str])> = vec![
        ("data set", "/dataset_hash", "0".repeat(64).into(), &["data set", "hash 000000000000"]),
        ("split", "/split", "segment".into(), &["split segment"]),
        ("protocol", "/protocol", "corf-heldout/1".into(), &["protocol corf-heldout/1"]),
        ("other protocol", "/protocol", "corf-heldout/77".into(), &["corf-heldout/77", "corf-heldout/2"]),
        ("schema", "/schema", "corf-x/999".into(), &["corf-x/999", "corf-metrics/1"]),
        ("configuration", "/config/metres_per_radian", 3.into(), &["configuration", "metres_per_radian is 3 and 1"]),
        ("method", "/method", "inverse-distance".into(), &["inverse-distance"]),
        ("seed", "/seed", 1.into(), &["seed 1"]),
        ("row", "/row", "blend".into(), &["blend"]),
        ("time", "/seconds", (-1.0).into(), &["seconds is -1", "negative"]),
        ("curve", "/curve/0/seconds", (-0.5).into(), &["curve[0].seconds"]),
        ("mean", "/means/psnr_opt", (psnr + 0.01).into(), &["means.psnr_opt"]),
        ("no mean", "/means/psnr_opt", Value::Null, &["means.psnr_opt is null"]),
        ("no settings", "/config", Value::Object(serde_json::Map::new()), &["config is empty"]),
        ("no name", "/row", " ".into(), &["row is empty"]),
        ("progress", "/curve/0/progress", 7.into(), &["curve[0].progress is 7"]),
        ("frame", "/frames/0/ssim_opt", 0.123.into(), &["means.ssim_opt"]),
        ("frames", "/frames/0/index", sound[1]["frames"][1]["index"].clone(), &["is there twice"]),
        ("other frames", "/frames/0/index", 4000.into(), &["other keyframes"]),
        ("no frames", "/frames", Value::Array(Vec::new()), &["frames is empty"]),
    ];
    for (name, pointer, to, words) in changes {
        let mut records = sound.clone();
        *records[1].pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = to;
        archive(&loose, &records);
        corf_refuses(&["bench", "table", text(&loose)], &[&["records.jsonl.gz", "help: "][..], words].concat());
        corf_refuses(&["bench", "paper", text(&loose)], words);
        assert!(!loose.join("paper.md").exists(), "{name}");
        // A cell of its own is held against its name and the plan before.
        let path = cell(&out, names[1]);
        fs::write(&path, records[1].to_string()).unwrap();
        for command in [&["table"][..], &["report"], &["pack", "--out", text(&folder.path().join("never"))]] {
            corf_refuses(&[&["bench", command[0], text(&out)][..], &command[1..]].concat(), &["nearest-seed2.json"]);
        }
        assert!(!folder.path().join("never").exists(), "{name}");
        fs::write(&path, sound[1].to_string()).unwrap();
    }
    // Twice the same, and two of one cell.
    archive(&loose, &[&sound[..], &sound[2..3]].concat());
    corf_refuses(&["bench", "table", text(&loose)], &["\"blend\", seed 1", "line 3", "line 5", "the same record twice"]);
    let mut other = sound[2].clone();
    other["seconds"] = 5.into();
    archive(&loose, &[&sound[..], &[other]].concat());
    corf_refuses(&["bench", "table", text(&loose)], &["line 3", "line 5", "that differ"]);
    // Two cells under each other's names.
    fs::write(cell(&out, names[0]), sound[1].to_string()).unwrap();
    fs::write(cell(&out, names[1]), sound[0].to_string()).unwrap();
    corf_refuses(&["bench", "table", text(&out)], &["nearest-seed1.json", "seed 2"]);
    corf_refuses(&["bench", "run", text(&folder.path().join("plan.toml")), "--out", text(&out), "--resume"], &["seed1.json"]);
    fs::write(cell(&out, names[0]), sound[0].to_string()).unwrap();
    fs::write(cell(&out, names[1]), sound[1].to_string()).unwrap();
    assert_eq!(table, corf_ok(&["bench", "table", text(&out)]));
    // A record that is not there, and one that nobody asks for.
    fs::rename(cell(&out, names[1]), cell(&out, "stray")).unwrap();
    corf_refuses(
        &["bench", "table", text(&out)],
        &["nearest-seed2.json is missing", "\"nearest\", seed 2", "help: ", "--resume"],
    );
    fs::copy(cell(&out, "stray"), cell(&out, names[1])).unwrap();
    let tabled = corf(&["bench", "table", text(&out)]);
    assert!(
        tabled.status.success() && String::from_utf8_lossy(&tabled.stderr).contains("stray.json is of no cell"),
        "{tabled:?}"
    );
    fs::remove_file(cell(&out, "stray")).unwrap();
    // An archive beside cells may be another comparison's.
    archive(&out, &sound);
    corf_refuses(&["bench", "table", text(&out)], &["records.jsonl.gz and in cells/"]);
}

#[test]
fn archives_are_read_whole_or_not_at_all_and_bombs_end_with_a_message() {
    let folder = tempfile::tempdir().unwrap();
    let out = comparison(folder.path());
    let packed = folder.path().join("packed");
    corf_ok(&["bench", "pack", text(&out), "--out", text(&packed)]);
    let table = corf_ok(&["bench", "table", text(&packed)]);
    let path = packed.join("records.jsonl.gz");
    let whole = fs::read(&path).unwrap();
    let lines = io::read_gzip_text(&path).unwrap();
    // A member a line, and one that ends within a line.
    let members: Vec<Vec<u8>> = lines.split_inclusive('\n').map(|line| io::gzip(line.as_bytes()).unwrap()).collect();
    fs::write(&path, members.concat()).unwrap();
    assert_eq!(corf_ok(&["bench", "table", text(&packed)]), table);
    let (one, two) = lines.split_at(lines.len() / 3);
    fs::write(&path, [io::gzip(one.as_bytes()).unwrap(), io::gzip(two.as_bytes()).unwrap()].concat()).unwrap();
    assert_eq!(corf_ok(&["bench", "table", text(&packed)]), table);
    let gzip = |text: String| io::gzip(text.as_bytes()).unwrap();
    let bad: [(&str, Vec<u8>, &str); 9] = [
        ("rubbish behind", [&whole[..], b"rubbish"].concat(), "line 5"),
        ("half a member behind", [&whole[..], &whole[..whole.len() / 2]].concat(), "records.jsonl.gz"),
        ("cut short", whole[..whole.len() - 1].to_vec(), "gzip text"),
        ("nothing", Vec::new(), "records.jsonl.gz"),
        ("no lines", gzip(String::new()), "holds no records"),
        ("plain text", lines.clone().into_bytes(), "gzip text"),
        ("one long line", gzip("x".repeat(1 << 27)), "line 1"),
        ("many values", gzip(format!("{{\"config\":[{}0]}}", "0,".repeat(1 << 21))), "more than 524288"),
        ("many lines", gzip(lines.clone() + &"\n".repeat(1 << 27)), "line 5"),
    ];
    for (name, bytes, words) in bad {
        fs::write(&path, bytes).unwrap();
        let place = ["bench", "table", text(&packed)];
        corf_refuses(&place, &[words]);
        // As far as a limit on memory can be set: half a gibibyte holds the program and a line.
        #[cfg(target_os = "linux")]
        {
            let limited = "ulimit -v 1572864; exec \"$0\" --threads 1 bench table \"$1\"";
            let program = command(&[]).get_program().to_owned();
            let ended = std::process::Command::new("sh").args(["-c", limited]).arg(program).arg(&packed).output().unwrap();
            assert_eq!(ended.status.code(), Some(2), "{name}: {}", String::from_utf8_lossy(&ended.stderr));
        }
    }
    // Records and runs of other people have bounds as well.
    let record = cell(&out, "nearest-seed1");
    fs::write(&record, format!("{{\"config\":[{}0]}}", "0,".repeat(1 << 21))).unwrap();
    corf_refuses(&["bench", "table", text(&out)], &["nearest-seed1.json", "more than 524288"]);
    let run = folder.path().join("run");
    fs::create_dir(&run).unwrap();
    fs::write(run.join("run.json"), format!("[{}0]", "0,".repeat(1 << 23))).unwrap();
    corf_refuses(&["evaluate", text(&run)], &["run.json", "more than 8388608"]);
    fs::write(run.join("run.json"), "{\"curve\": [{\"seconds\": -3}]}").unwrap();
    corf_refuses(&["evaluate", text(&run)], &["run.json", "curve[0].seconds is -3"]);
}

#[test]
fn rows_of_several_devices_are_not_averaged_and_every_notation_names_them() {
    let folder = tempfile::tempdir().unwrap();
    let out = comparison(folder.path());
    let path = cell(&out, "blend-seed2");
    let mut record = json(&path);
    record["device"] = "gpu (X)".into();
    fs::write(&path, record.to_string()).unwrap();
    for format in ["markdown", "latex", "plain", "csv"] {
        let table = corf_ok(&["bench", "table", text(&out), "--format", format]);
        assert!(table.contains("gpu (X)"), "{format}: {table}");
        if format != "csv" {
            assert!(table.contains("blend, on cpu (") && table.contains("blend, on gpu (X)"), "{format}: {table}");
            assert!(table.contains("Ran on gpu (X): blend"), "{format}: {table}");
        }
    }
    corf_ok(&["bench", "report", text(&out)]);
    assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("blend, on gpu (X)"));
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn archives_that_were_put_together_wrongly_are_refused() {
    let said = [
        ("gz-multimember", None, "nearest keyframe"),
        ("records-empty", Some("records.jsonl.gz"), ""),
        ("records-mixed/r-empty file", Some("records.jsonl.gz"), ""),
        ("records-mixed/r-means edited", Some("means.azimuth_spread_error_deg is 99"), ""),
        ("records-mixed/r-means null", Some("means.azimuth_spread_error_deg is null"), ""),
        ("records-mixed/r-other config same row", Some("iterations_per_keyframe is 9999 and 75"), ""),
        ("records-mixed/r-other device", None, "CORF-GS, on gpu X"),
        ("records-mixed/r-other split", Some("split segment"), ""),
        ("records-mixed/r-schema 999", Some("corf-x/999"), ""),
    ];
    for (name, refused, shown) in said {
        let Some(folder) = shared(&format!("faults3/{name}")) else { return };
        match refused {
            Some(words) => corf_refuses(&["bench", "table", text(&folder)], &[words, "help: "]),
            None => assert!(corf_ok(&["bench", "table", text(&folder)]).contains(shown), "{name}"),
        }
    }
}

/// A Slurm that runs every task at once: `sbatch`, `scontrol` and `scancel` that note how they were called.
#[cfg(unix)]
struct Cluster {
    folder: tempfile::TempDir,
}

#[cfg(unix)]
impl Cluster {
    const SBATCH: &str = r#"#!/bin/sh
n=$(($(cat "$CALLS/count" 2>/dev/null || echo 100) + 1))
echo "$n" >"$CALLS/count"
for word; do printf '%s|' "$word"; done >>"$CALLS/sbatch"
echo >>"$CALLS/sbatch"
if [ "$n" = "$REFUSED" ]; then echo "sbatch: error: no more jobs" >&2; exit 1; fi
script='' argument='' tasks=''
for word; do
    case $word in
        *.sh) script=$word logs=$(dirname "$(dirname "$word")")/logs ;;
        --array=*) tasks=${word#--array=0-} tasks=${tasks%\%*} ;;
        --*) ;;
        *) argument=$word ;;
    esac
done
if [ -n "$tasks" ]; then
    for i in $(seq 0 "$tasks"); do
        SLURM_ARRAY_TASK_ID=$i sh "$script" $argument >>"$logs/${n}_$i.log" 2>&1 || echo "task $i failed" >>"$CALLS/failed"
    done
else
    sh "$script" >>"$logs/collect.log" 2>&1 || echo "collecting failed" >>"$CALLS/failed"
fi
echo "$n;local"
"#;

    /// A cluster whose arrays have no more than four tasks.
    fn new() -> Self {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("calls")).unwrap();
        let scancel = "#!/bin/sh\necho \"$@\" >>\"$CALLS/scancel\"\n";
        let scontrol = "#!/bin/sh\necho 'MaxArraySize            = 4'\n";
        for (name, script) in [("sbatch", Self::SBATCH), ("scancel", scancel), ("scontrol", scontrol)] {
            let path = folder.path().join(name);
            fs::write(&path, script).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        }
        Self { folder }
    }

    /// Submits, with the call of this number refused.
    fn submit(&self, out: &Path, more: &[&str], refused: &str) -> std::process::Output {
        let path = format!("{}:{}", text(self.folder.path()), std::env::var("PATH").unwrap());
        let mut submit = command(&["bench", "submit", "--slurm", "--device", "cpu"]);
        submit
            .env("PATH", path)
            .env("CALLS", self.folder.path().join("calls"))
            .env("REFUSED", refused)
            .env("SBATCH_ARRAY_INX", "0-1");
        submit.args(more).arg("--").arg(out.file_name().unwrap()).current_dir(out.parent().unwrap()).output().unwrap()
    }

    fn said(&self, name: &str) -> String {
        fs::read_to_string(self.folder.path().join("calls").join(name)).unwrap_or_default()
    }
}

/// A plan of six cells, listed in a folder.
#[cfg(unix)]
fn six_cells(folder: &Path, out: &Path) {
    let plan = folder.join("plan.toml");
    let rows = "[[row]]\nlabel = \"a\"\nmethod = \"nearest\"\n[[row]]\nlabel = \"b\"\nmethod = \"inverse-distance\"\n";
    fs::write(&plan, format!("name = \"x\"\ndataset = {:?}\nseeds = [1, 2, 3]\n{rows}", tiny_dataset())).unwrap();
    corf_ok(&["bench", "plan", text(&plan), &format!("--out={}", text(out))]);
}

#[cfg(unix)]
#[test]
fn long_sweeps_are_several_arrays_and_any_folder_will_do() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().canonicalize().unwrap();
    for name in ["plain", "a b #1 it's \"q\" 50% %A $HOME `x` ;*? größer", "-x --array=7"] {
        let (cluster, out) = (Cluster::new(), place.join(name));
        six_cells(&place, &out);
        let answer = cluster.submit(&out, &["--sbatch=--comment=two words", "--sbatch=--nice 7", "--at-once=2"], "");
        let (said, reported) = (String::from_utf8_lossy(&answer.stdout), String::from_utf8_lossy(&answer.stderr));
        assert_eq!(answer.status.code(), Some(0), "{name}: {reported}");
        assert!(said.contains("job arrays 101, 102 of 6 cells, and job 103"), "{name}: {said}");
        let script = |job: &str| text(&out.join("slurm").join(job)).to_owned();
        let expected = format!(
            "--parsable|{log}%A_%a.log|--comment=two words|--nice|7|--array=0-3%2|{array}|0|\n\
             --parsable|{log}%A_%a.log|--comment=two words|--nice|7|--array=0-1%2|--dependency=afterany:101|{array}|4|\n\
             --parsable|{log}collect.log|--dependency=afterany:101:102|{collect}|\n",
            log = format!("--output={}/logs/", text(&out).replace('%', "%%")),
            array = script("array.sh"),
            collect = script("collect.sh"),
        );
        assert_eq!(cluster.said("sbatch"), expected, "{name}");
        assert_eq!(cluster.said("failed"), "", "{name}");
        for cell in ["a-seed1", "a-seed2", "a-seed3", "b-seed1", "b-seed2", "b-seed3"] {
            assert!(out.join("cells").join(format!("{cell}.json")).exists(), "{name}: {cell}");
        }
        assert!(out.join("report.html").exists() && out.join("logs/102_1.log").exists(), "{name}");
        let scripts = fs::read_to_string(out.join("slurm/array.sh")).unwrap();
        assert!(scripts.contains("#SBATCH --open-mode=append\n") && scripts.contains("#SBATCH --requeue\n"));
        // All are finished: nothing is submitted.
        let again = cluster.submit(&out, &[], "");
        assert!(again.status.success() && String::from_utf8_lossy(&again.stderr).contains("nothing was submitted"));
        assert_eq!(cluster.said("count").trim(), "103");
    }
    // The same folders do for several processes on this machine.
    let out = folder.path().join("-y it's");
    six_cells(folder.path(), &out);
    let name = out.file_name().unwrap().to_str().unwrap();
    let local =
        command(&["bench", "submit", "--local", "2", "--device", "cpu", "--", name]).current_dir(folder.path()).output().unwrap();
    assert!(local.status.success(), "{}", String::from_utf8_lossy(&local.stderr));
}

#[cfg(unix)]
#[test]
fn what_cannot_be_submitted_leaves_nothing_in_the_queue() {
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("a\nb");
    six_cells(folder.path(), &broken);
    let refuses = |cluster: &Cluster, out: &Path, more: &[&str], refused: &str, words: &str| {
        let answer = cluster.submit(out, more, refused);
        let reported = String::from_utf8_lossy(&answer.stderr).into_owned();
        assert!(answer.status.code() == Some(2) && reported.contains(words), "{words}: {reported}");
        assert!(answer.stdout.is_empty());
        reported
    };
    let cluster = Cluster::new();
    refuses(&cluster, &broken, &[], "", "'\\n'");
    let escaped = folder.path().join("a\\b");
    six_cells(folder.path(), &escaped);
    refuses(&cluster, &escaped, &[], "", "without backslashes");
    let out = folder.path().join("out");
    six_cells(folder.path(), &out);
    for bad in ["--array=0-1", "--arr=0-1", "--test-only", "partition=x"] {
        refuses(&cluster, &out, &[&format!("--sbatch={bad}")], "", bad);
    }
    assert_eq!(cluster.said("sbatch"), "", "nothing was asked of sbatch");
    // The second array, and then the collecting job, are refused.
    let reported = refuses(&cluster, &out, &[], "102", "no more jobs");
    assert!(reported.contains("job 101, submitted before that: cancelled again"), "{reported}");
    assert_eq!(cluster.said("scancel"), "101\n");
    let cluster = Cluster::new();
    fs::remove_dir_all(out.join("cells")).unwrap();
    fs::create_dir(out.join("cells")).unwrap();
    let reported = refuses(&cluster, &out, &[], "103", "no more jobs");
    assert!(reported.contains("jobs 101, 102, submitted before that: cancelled again"), "{reported}");
    assert_eq!(cluster.said("scancel"), "101 102\n");
}
