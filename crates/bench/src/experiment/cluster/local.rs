//! Cells on this machine, several processes at once, on a GPU each where there are several.

use super::Planned;
use crate::device::{DeviceChoice, gpu_count};
use crate::note;
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::{Context, Result};
use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Interval between looks at the processes.
const POLL: Duration = Duration::from_millis(50);

/// A process that runs a cell.
struct Running {
    id: String,
    worker: usize,
    process: Child,
}

/// Whether each of `at_once` workers has an adapter of its own: the device of worker `k`.
fn device_of(device: DeviceChoice, worker: usize, gpus: usize) -> DeviceChoice {
    match device {
        DeviceChoice::Auto | DeviceChoice::Gpu(0) if gpus > 1 => DeviceChoice::Gpu(worker % gpus),
        other => other,
    }
}

/// Runs every unfinished cell, `at_once` processes at a time, each with the threads that were asked for, but no more than its share of the cores;
/// their messages go to `OUT/logs/ID.log`. After the time `stop_after` none begins and those at work are ended, which is nothing bad. Returns how
/// many ended badly.
///
/// # Errors
/// A process that cannot be started, or an interrupt, after which all processes have ended and finished cells stay.
pub fn run(
    planned: &Planned,
    at_once: usize,
    device: DeviceChoice,
    no_verify: bool,
    stop_after: Option<Duration>,
) -> Result<usize> {
    // A name that begins like an option is none behind its folder.
    let out = std::path::absolute(&planned.out)?;
    let logs = out.join("logs");
    std::fs::create_dir_all(&logs).with_context(|| format!("cannot create {}", logs.display()))?;
    let cells = planned.unfinished()?;
    let total = cells.len();
    let mut waiting = cells.into_iter().map(|cell| cell.id.clone());
    let gpus = gpu_count();
    let share = std::thread::available_parallelism().map_or(1, usize::from) / at_once;
    let threads = share.min(rayon::current_num_threads()).max(1);
    let mut free: Vec<usize> = (0..at_once).rev().collect();
    let mut running: Vec<Running> = Vec::new();
    let (mut done, mut failed) = (0, 0);
    let begun = Instant::now();
    let mut progress = Progress::start("cells", total, "cells");
    loop {
        if let Err(interrupted) = interrupt::check() {
            running.iter_mut().for_each(|cell| end(&mut cell.process));
            return Err(interrupted);
        }
        if stop_after.is_some_and(|limit| begun.elapsed() >= limit) {
            running.iter_mut().for_each(|cell| end(&mut cell.process));
            break;
        }
        while let Some(worker) = free.pop() {
            let Some(id) = waiting.next() else { break };
            let process = start(&out, &id, device_of(device, worker, gpus), threads, no_verify, &logs)
                .inspect_err(|_| running.iter_mut().for_each(|cell| end(&mut cell.process)))?;
            running.push(Running { id, worker, process });
        }
        if running.is_empty() {
            break;
        }
        let mut still = Vec::new();
        for mut cell in running {
            match cell.process.try_wait().context("cannot wait for a cell's process")? {
                None => still.push(cell),
                Some(status) => {
                    done += 1;
                    free.push(cell.worker);
                    if !status.success() {
                        failed += 1;
                        note!("cell {} ended with {status}: see {}", cell.id, logs.join(format!("{}.log", cell.id)).display());
                    }
                    progress.set(done, total);
                }
            }
        }
        running = still;
        std::thread::sleep(POLL);
    }
    progress.finish();
    Ok(failed)
}

fn start(out: &Path, id: &str, device: DeviceChoice, threads: usize, no_verify: bool, logs: &Path) -> Result<Child> {
    let path = logs.join(format!("{id}.log"));
    // What was said before stays, as of an array's tasks.
    let log =
        File::options().append(true).create(true).open(&path).with_context(|| format!("cannot write {}", path.display()))?;
    let mut command = Command::new(std::env::current_exe().context("the path of this program is not known")?);
    command.args(["--threads", &threads.to_string(), "bench", "cell"]).arg(out).arg(id);
    command.args(["--device", &device.to_string()]).args(no_verify.then_some("--no-verify"));
    command.stdin(Stdio::null()).stdout(log.try_clone()?).stderr(log);
    command.spawn().context("cannot start a process for a cell")
}

/// Asks a process to stop and waits until it has.
fn end(process: &mut Child) {
    #[cfg(unix)]
    // SAFETY: sends a signal to a child that has not been waited for, whose number is therefore its own.
    unsafe {
        libc::kill(process.id() as libc::pid_t, libc::SIGTERM);
    }
    #[cfg(not(unix))]
    let _ = process.kill();
    let _ = process.wait();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workers_share_the_adapters_unless_one_is_named() {
        assert_eq!(device_of(DeviceChoice::Auto, 5, 4), DeviceChoice::Gpu(1));
        assert_eq!(device_of(DeviceChoice::Gpu(0), 3, 4), DeviceChoice::Gpu(3));
        assert_eq!(device_of(DeviceChoice::Gpu(2), 3, 4), DeviceChoice::Gpu(2));
        assert_eq!(device_of(DeviceChoice::Auto, 1, 1), DeviceChoice::Auto);
        assert_eq!(device_of(DeviceChoice::Cpu, 1, 4), DeviceChoice::Cpu);
    }
}
