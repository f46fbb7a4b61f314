//! Cells as a Slurm job array, and a job that collects them once all have ended.
//!
//! Slurm decides what runs where and when, and runs a job again whose node died (`--requeue`); a cell that is finished answers at once.

use super::Planned;
use crate::device::DeviceChoice;
use crate::plan::slug;
use anyhow::{Context, Result, bail};
use corf_scene::io::write_atomic;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Options of the jobs.
pub struct Options<'a> {
    /// Largest number of cells that run at once; as many as the cluster gives if not given.
    pub at_once: Option<usize>,
    /// Device of every cell.
    pub device: DeviceChoice,
    /// Whether cells leave the dataset's files unchecked.
    pub no_verify: bool,
    /// Further options of `sbatch`, a line each: `--partition=gpu`.
    pub sbatch: &'a [String],
}

/// Submitted jobs.
pub struct Submitted {
    /// Number of the job array.
    pub array: String,
    /// Number of the collecting job.
    pub collect: String,
    /// Cells in the array.
    pub cells: usize,
}

/// Text as one word of a shell script.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

fn path_text(path: &Path) -> Result<String> {
    let text =
        path.to_str().with_context(|| format!("{} cannot stand in a job script\n  help: it is no UTF-8", path.display()))?;
    if text.contains(['\n', '%']) {
        bail!(
            "{text:?} cannot stand in a job script\n  help: choose a path without line breaks and without %, which Slurm replaces"
        );
    }
    Ok(text.to_owned())
}

/// Script of the job array: task i runs the cell in line i + 1 of the list of ids.
fn array_script(name: &str, program: &str, out: &str, cells: usize, options: &Options<'_>) -> String {
    let limit = options.at_once.map_or(String::new(), |n| format!("%{n}"));
    let more: String = options.sbatch.iter().map(|option| format!("#SBATCH {option}\n")).collect();
    let no_verify = if options.no_verify { " --no-verify" } else { "" };
    let (program, folder) = (quoted(program), quoted(out));
    format!(
        "#!/bin/sh\n#SBATCH --job-name=corf-{name}\n#SBATCH --array=0-{}{limit}\n#SBATCH --output={out}/logs/%A_%a.log\n#SBATCH --requeue\n\
         {more}exec {program} bench cell {folder} \"$(sed -n \"$((SLURM_ARRAY_TASK_ID + 1))p\" {folder}/slurm/ids)\" --device {}{no_verify}\n",
        cells - 1,
        options.device
    )
}

/// Script of the job that writes tables and report.
fn collect_script(name: &str, program: &str, out: &str, options: &Options<'_>) -> String {
    let no_verify = if options.no_verify { " --no-verify" } else { "" };
    format!(
        "#!/bin/sh\n#SBATCH --job-name=corf-{name}-collect\n#SBATCH --output={out}/logs/collect.log\nexec {} bench collect {}{no_verify}\n",
        quoted(program),
        quoted(out)
    )
}

/// Writes the job scripts of all unfinished cells; `None` where all are finished.
fn write_scripts(planned: &Planned, options: &Options<'_>) -> Result<Option<(PathBuf, PathBuf, usize)>> {
    let cells = planned.unfinished()?;
    if cells.is_empty() {
        return Ok(None);
    }
    if let Some(bad) = options.sbatch.iter().find(|option| !option.starts_with("--") || option.contains('\n')) {
        bail!("--sbatch {bad:?} is no option of sbatch\n  help: write it as in --sbatch=--partition=gpu");
    }
    let out = path_text(&std::path::absolute(&planned.out)?)?;
    let program = path_text(&std::env::current_exe().context("the path of this program is not known")?)?;
    let folder = planned.out.join("slurm");
    for folder in [&folder, &planned.out.join("logs")] {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    }
    let name = slug(planned.name());
    let ids: String = cells.iter().map(|cell| format!("{}\n", cell.id)).collect();
    write_atomic(folder.join("ids"), ids.as_bytes())?;
    let (array, collect) = (folder.join("array.sh"), folder.join("collect.sh"));
    write_atomic(&array, array_script(&name, &program, &out, cells.len(), options).as_bytes())?;
    write_atomic(&collect, collect_script(&name, &program, &out, options).as_bytes())?;
    Ok(Some((array, collect, cells.len())))
}

/// Submits a job array over the unfinished cells and a job that collects them whatever became of them; `None` where all are finished.
///
/// # Errors
/// No `sbatch` on this machine, or its own message.
pub fn submit(planned: &Planned, options: &Options<'_>) -> Result<Option<Submitted>> {
    let Some((array, collect, cells)) = write_scripts(planned, options)? else { return Ok(None) };
    let array = sbatch(&[&array])?;
    let dependency = PathBuf::from(format!("--dependency=afterany:{array}"));
    let collect = sbatch(&[&dependency, &collect])?;
    Ok(Some(Submitted { array, collect, cells }))
}

/// Submits a script; its job's number.
fn sbatch(arguments: &[&PathBuf]) -> Result<String> {
    let answer = Command::new("sbatch")
        .arg("--parsable")
        .args(arguments)
        .output()
        .context("cannot run sbatch\n  help: submit from a machine of the cluster, or run the cells here with --local N")?;
    if !answer.status.success() {
        bail!("sbatch refused the job: {}", String::from_utf8_lossy(&answer.stderr).trim());
    }
    // The job's number; behind a semicolon the cluster's name.
    let text = String::from_utf8_lossy(&answer.stdout);
    Ok(text.trim().split(';').next().unwrap_or_default().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_names_its_cells_by_line_and_quotes_paths() {
        let sbatch = ["--partition=gpu".to_owned(), "--gpus-per-task=1".to_owned()];
        let options = Options { at_once: Some(4), device: DeviceChoice::Gpu(0), no_verify: false, sbatch: &sbatch };
        let script = array_script("lobby", "/opt/corf it's", "/data/my out", 8, &options);
        assert!(script.contains("#SBATCH --array=0-7%4\n"), "{script}");
        assert!(script.contains("#SBATCH --gpus-per-task=1\nexec '/opt/corf it'\\''s' bench cell '/data/my out' "), "{script}");
        assert!(script.ends_with("--device gpu:0\n"), "{script}");
        // Options come before the first command, or sbatch does not read them.
        let last_option = script.rfind("#SBATCH").unwrap();
        assert!(last_option < script.find("exec").unwrap());
    }
}
