//! Cells as Slurm job arrays, and a job that collects them once all have ended.
//!
//! Slurm decides what runs where and when, and runs a job again whose node died (`--requeue`); a cell that is finished answers at
//! once. Arrays are no longer than the site allows. No path stands where Slurm would read it its own way: those of logs are
//! options of `sbatch` and no lines of a script.

use super::Planned;
use crate::device::DeviceChoice;
use crate::experiment::plan::slug;
use crate::note;
use crate::terminal::interrupt;
use crate::terminal::shell::quoted;
use anyhow::{Context, Result, bail, ensure};
use corf_scene::io::{sha256_hex, write_atomic};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Options of the jobs.
pub struct SubmitOptions<'a> {
    /// Largest number of cells that run at once; as many as the cluster gives if not given.
    pub at_once: Option<usize>,
    /// Device of every cell.
    pub device: DeviceChoice,
    /// Whether cells leave the dataset's files unchecked.
    pub no_verify: bool,
    /// Further options of `sbatch` for the arrays: `--partition=gpu`.
    pub sbatch: &'a [String],
}

/// Submitted jobs.
pub struct Submitted {
    /// Numbers of the job arrays.
    pub arrays: Vec<String>,
    /// Number of the collecting job.
    pub collect: String,
    /// Cells in all arrays.
    pub cells: usize,
}

/// Slurm's own bound on an array where the site says nothing: indices below it.
const MAX_ARRAY_SIZE: usize = 1001;

/// Options of `sbatch` that decide what is submitted, and so are not the user's.
const RESERVED: [&str; 8] = ["array", "parsable", "test-only", "wait", "wrap", "help", "usage", "version"];
/// Options that the collecting job takes over: on whose account, and on which cluster.
const SHARED: [&str; 2] = ["account", "clusters"];

/// A path as it stands in a job script.
fn path_text(path: &Path) -> Result<String> {
    let text =
        path.to_str().with_context(|| format!("{} cannot stand in a job script\n  help: it is no UTF-8", path.display()))?;
    if let Some(control) = text.chars().find(|c| c.is_control()) {
        bail!(
            "{text:?} cannot stand in a job script: it holds {control:?}\n  help: choose a path without line breaks and \
             control characters"
        );
    }
    Ok(text.to_owned())
}

/// The option for a log in a comparison's folder: in the folder's own name % stands for itself.
///
/// # Errors
/// A folder with a backslash, behind which Slurm replaces nothing in a log's name.
fn log_option(out: &str, name: &str) -> Result<OsString> {
    ensure!(
        !out.contains('\\'),
        "{out:?} cannot be the folder of a Slurm job's log: it holds '\\', which Slurm reads its own way\n  help: choose a path \
         without backslashes"
    );
    Ok(format!("--output={}/logs/{name}", out.replace('%', "%%")).into())
}

/// The name of an option of `sbatch` and the words that it is on a command line: `--name`, `--name=value` or `--name value`.
fn option_words(option: &str) -> Result<(&str, Vec<&str>)> {
    let end = option.find(|c: char| c == '=' || c.is_whitespace()).unwrap_or(option.len());
    let (word, rest) = option.split_at(end);
    let Some(name) = word.strip_prefix("--").filter(|name| !name.is_empty() && !option.contains(char::is_control)) else {
        bail!("--sbatch {option:?} is no option of sbatch\n  help: write it as in --sbatch=--partition=gpu");
    };
    // sbatch takes the beginning of a name for it.
    if let Some(reserved) = RESERVED.iter().find(|reserved| reserved.starts_with(name)) {
        bail!("--sbatch {option:?}: --{reserved} decides what is submitted\n  help: leave it out; `corf bench submit` sets it");
    }
    Ok((name, if rest.starts_with('=') || rest.is_empty() { vec![option] } else { vec![word, rest.trim()] }))
}

/// Script of a job array: task i runs the cell in line i + 1, or as many lines further down as the script's argument says.
fn array_script(name: &str, program: &str, out: &str, ids: &str, options: &SubmitOptions<'_>) -> String {
    let no_verify = if options.no_verify { " --no-verify" } else { "" };
    let (program, folder) = (quoted(program), quoted(out));
    format!(
        "#!/bin/sh\n#SBATCH --job-name=corf-{name}\n#SBATCH --open-mode=append\n#SBATCH --requeue\n\
         exec {program} bench cell {folder} \"$(sed -n \"$((SLURM_ARRAY_TASK_ID + ${{1:-0}} + 1))p\" {folder}/slurm/{ids})\" \
         --device {}{no_verify}\n",
        options.device
    )
}

/// Script of the job that writes tables and report.
fn collect_script(name: &str, program: &str, out: &str, options: &SubmitOptions<'_>) -> String {
    let no_verify = if options.no_verify { " --no-verify" } else { "" };
    format!(
        "#!/bin/sh\n#SBATCH --job-name=corf-{name}-collect\n#SBATCH --open-mode=append\n\
         exec {} bench collect {}{no_verify}\n",
        quoted(program),
        quoted(out)
    )
}

/// Job scripts in the folder of a comparison.
struct Scripts {
    /// The array's, and the option for its logs.
    array: (PathBuf, OsString),
    /// The collecting job's, and the option for its log.
    collect: (PathBuf, OsString),
    /// Cells in the list that the array's script reads.
    cells: usize,
}

impl Scripts {
    /// Writes the job scripts of all unfinished cells; `None` where all are finished.
    fn write(planned: &Planned, options: &SubmitOptions<'_>) -> Result<Option<Self>> {
        let cells = planned.unfinished()?;
        if cells.is_empty() {
            return Ok(None);
        }
        let out = std::path::absolute(&planned.out)?;
        let program = std::env::current_exe().context("the path of this program is not known")?;
        ensure!(
            program.is_file(),
            "{} is not there any more\n  help: this program was replaced while it ran: start it again",
            program.display()
        );
        let (out_text, program) = (path_text(&out)?, path_text(&program)?);
        let logs = [log_option(&out_text, "%A_%a.log")?, log_option(&out_text, "collect.log")?];
        let folder = out.join("slurm");
        for folder in [&folder, &out.join("logs")] {
            std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
        }
        let name = slug(planned.name());
        let list: String = cells.iter().map(|cell| format!("{}\n", cell.id)).collect();
        // Arrays that were submitted before go on with the list that they were submitted with.
        let ids = format!("ids-{:.16}", sha256_hex(list.as_bytes()));
        write_atomic(folder.join(&ids), list.as_bytes())?;
        let (array, collect) = (folder.join("array.sh"), folder.join("collect.sh"));
        write_atomic(&array, array_script(&name, &program, &out_text, &ids, options).as_bytes())?;
        write_atomic(&collect, collect_script(&name, &program, &out_text, options).as_bytes())?;
        let [of_array, of_collect] = logs;
        Ok(Some(Self { array: (array, of_array), collect: (collect, of_collect), cells: cells.len() }))
    }
}

/// Submits a script with the option for its log, further options and an argument; its job's number.
fn sbatch((script, log): &(PathBuf, OsString), options: &[OsString], argument: Option<usize>) -> Result<String> {
    let mut command = Command::new("sbatch");
    // Variables stand in for options that are not given.
    command.env_remove("SBATCH_ARRAY_INX").env_remove("SBATCH_WAIT");
    let answer = command
        .arg("--parsable")
        .arg(log)
        .args(options)
        .arg(script)
        .args(argument.map(|number| number.to_string()))
        .output()
        .context("cannot run sbatch\n  help: submit from a machine of the cluster, or run the cells here with --local N")?;
    if !answer.status.success() {
        bail!("sbatch refused the job: {}", String::from_utf8_lossy(&answer.stderr).trim());
    }
    // The job's number; behind a semicolon the cluster's name.
    let text = String::from_utf8_lossy(&answer.stdout);
    let number = text.trim().lines().next_back().and_then(|line| line.split(';').next()).unwrap_or_default().trim();
    if number.is_empty() || !number.bytes().all(|b| b.is_ascii_digit()) {
        bail!("sbatch answered {:?}, which is no job's number\n  help: look with squeue for what it has submitted", text.trim());
    }
    Ok(number.to_owned())
}

/// The largest number of tasks of an array on this cluster.
///
/// # Errors
/// A site that has no job arrays.
fn most_tasks(clusters: &[OsString]) -> Result<usize> {
    // Without an answer sbatch itself says what is wrong.
    let answer = Command::new("scontrol").args(clusters).args(["show", "config"]).output();
    let text = answer.ok().filter(|answer| answer.status.success()).map(|answer| answer.stdout).unwrap_or_default();
    let tasks = tasks_of(&String::from_utf8_lossy(&text));
    ensure!(
        tasks > 0,
        "this cluster has no job arrays (MaxArraySize is 0 in `scontrol show config`)\n  help: run the cells on a machine of it \
         with --local N"
    );
    Ok(tasks)
}

/// The largest number of tasks of an array by the text of `scontrol show config`: indices stay below `MaxArraySize`, and a site may
/// set fewer tasks.
fn tasks_of(config: &str) -> usize {
    let value = |key: &str| {
        let of = |line: &str| Some(line.split_once('=').filter(|(name, _)| name.trim() == key)?.1.trim().to_owned());
        config.lines().find_map(of)
    };
    let size = value("MaxArraySize").and_then(|size| size.parse().ok()).unwrap_or(MAX_ARRAY_SIZE);
    let parameters = value("SchedulerParameters").unwrap_or_default();
    let tasks = parameters.split(',').find_map(|p| p.trim().strip_prefix("max_array_tasks=")?.parse().ok());
    tasks.map_or(size, |tasks: usize| tasks.min(size))
}

/// Submits job arrays over the unfinished cells, and a job that collects them whatever became of them; `None` where all are
/// finished.
///
/// # Errors
/// A folder whose name a job script cannot hold, an option that is none, no `sbatch` on this machine, or its own message; nothing
/// stays in the queue then.
pub fn submit(planned: &Planned, options: &SubmitOptions<'_>) -> Result<Option<Submitted>> {
    let mut given: Vec<(&str, Vec<OsString>)> = Vec::new();
    for option in options.sbatch {
        let (name, words) = option_words(option)?;
        given.push((name, words.into_iter().map(OsString::from).collect()));
    }
    let Some(scripts) = Scripts::write(planned, options)? else { return Ok(None) };
    let of = |names: &[&str]| -> Vec<OsString> {
        given.iter().filter(|(name, _)| names.contains(name)).flat_map(|(_, words)| words.clone()).collect()
    };
    let (clusters, shared) = (of(&["clusters"]), of(&SHARED));
    let most = most_tasks(&clusters)?;
    let mut arrays: Vec<String> = Vec::new();
    let mut submit = || -> Result<String> {
        for first in (0..scripts.cells).step_by(most) {
            interrupt::check()?;
            let tasks = most.min(scripts.cells - first);
            let limit = options.at_once.map_or(String::new(), |n| format!("%{n}"));
            let mut words: Vec<OsString> = given.iter().flat_map(|(_, words)| words.clone()).collect();
            words.push(format!("--array=0-{}{limit}", tasks - 1).into());
            // A limit holds within an array: the next one waits for all of it.
            if let Some(before) = arrays.last().filter(|_| options.at_once.is_some()) {
                words.push(format!("--dependency=afterany:{before}").into());
            }
            arrays.push(sbatch(&scripts.array, &words, Some(first))?);
        }
        let mut words = shared.clone();
        words.push(format!("--dependency=afterany:{}", arrays.join(":")).into());
        sbatch(&scripts.collect, &words, None)
    };
    match submit() {
        Ok(collect) => Ok(Some(Submitted { arrays, collect, cells: scripts.cells })),
        Err(error) => {
            cancel(&arrays, &clusters);
            Err(error)
        }
    }
}

/// Takes jobs out of the queue again, and says so.
fn cancel(arrays: &[String], clusters: &[OsString]) {
    if arrays.is_empty() {
        return;
    }
    let cancelled = Command::new("scancel").args(clusters).args(arrays).output().is_ok_and(|answer| answer.status.success());
    let said = if cancelled { "cancelled again" } else { "still in the queue: cancel them with scancel" };
    note!("{} {}, submitted before that: {said}", if arrays.len() == 1 { "job" } else { "jobs" }, arrays.join(", "));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_names_its_cells_by_line_and_quotes_paths() {
        let options = SubmitOptions { at_once: Some(4), device: DeviceChoice::Gpu(0), no_verify: false, sbatch: &[] };
        let script = array_script("lobby", "/opt/corf it's", "/data/my #1 %A", "ids-1", &options);
        assert!(script.contains("\nexec '/opt/corf it'\\''s' bench cell '/data/my #1 %A' "), "{script}");
        assert!(script.ends_with("'/data/my #1 %A'/slurm/ids-1)\" --device gpu:0\n"), "{script}");
        // What Slurm reads holds nothing of the folder; and it is read up to the first command alone.
        let (options, commands) = script.split_at(script.find("exec").unwrap());
        assert!(!options.contains("data") && options.contains("--open-mode=append") && !commands.contains("#SBATCH"), "{script}");
    }

    #[test]
    fn a_path_that_a_script_cannot_hold_is_refused_with_the_character() {
        for name in ["my out", "a#b", "it's", "a\"b", "a\\b", "50%", "$HOME", "`x`", "-x", "größer", "a*b", "a;b"] {
            assert_eq!(path_text(Path::new(name)).unwrap(), name);
        }
        for name in ["a\nb", "a\rb", "a\u{1b}b", "a\tb"] {
            let error = path_text(Path::new(name)).unwrap_err().to_string();
            assert!(error.contains(&format!("{:?}", name.chars().nth(1).unwrap())), "{error}");
        }
        assert_eq!(log_option("/a/50% %A", "%A_%a.log").unwrap(), "--output=/a/50%% %%A/logs/%A_%a.log");
        assert!(log_option("/a\\b", "collect.log").unwrap_err().to_string().contains("without backslashes"));
    }

    #[test]
    fn arrays_are_as_long_as_the_site_allows() {
        let config = |size: &str, parameters: &str| {
            format!(
                "Configuration data as of 2026-11-28\nMaxArraySize            = {size}\nSchedulerParameters     = {parameters}\n"
            )
        };
        assert_eq!(tasks_of(&config("1001", "(null)")), 1001);
        assert_eq!(tasks_of(&config("40000", "defer,max_array_tasks=5000,batch_sched_delay=3")), 5000);
        assert_eq!(tasks_of(&config("100", "max_array_tasks=5000")), 100);
        assert_eq!(tasks_of(&config("0", "(null)")), 0);
        assert_eq!(tasks_of(""), MAX_ARRAY_SIZE);
    }

    #[test]
    fn options_of_sbatch_are_words_and_those_that_decide_what_is_submitted_are_not_the_users() {
        let words = |option: &'static str| option_words(option).unwrap();
        assert_eq!(words("--partition=gpu"), ("partition", vec!["--partition=gpu"]));
        assert_eq!(words("--comment=two words, #3"), ("comment", vec!["--comment=two words, #3"]));
        assert_eq!(words("--constraint a=b"), ("constraint", vec!["--constraint", "a=b"]));
        assert_eq!(words("--exclusive"), ("exclusive", vec!["--exclusive"]));
        for bad in ["partition=x", "-p x", "--", "--a\nb", "", "--array=0-3", "--arr 0-3", "--test-only", "--wrap=ls"] {
            assert!(option_words(bad).unwrap_err().to_string().contains("help: "), "{bad}");
        }
    }
}
