//! `corf-fuzz`: mutated input for every parser; see README.md.

// A driver for developers: its findings are lines on standard output.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use anyhow::{Context, Result};
use clap::Parser;
use corf_fuzz::alloc::Counting;
use corf_fuzz::run::{self, Plan};
use corf_fuzz::target::{SELF_CHECK, TARGETS, Target};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Give parsers changed files; exit 1 where one panics, aborts, takes more than a gibibyte or does not end.
#[derive(Parser)]
struct Arguments {
    /// A target by name, or all.
    #[arg(long, default_value = "all")]
    target: String,
    /// Inputs a target.
    #[arg(long, default_value_t = 20_000)]
    inputs: u64,
    /// What inputs are made from: the same seed gives the same inputs.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// When a target stops, seconds.
    #[arg(long, default_value_t = 1e6)]
    seconds_per_target: f64,
    /// Run this one file on the target instead, and print what the parser says.
    #[arg(long)]
    replay: Option<PathBuf>,
    /// Where findings' bytes go.
    #[arg(long, default_value = "fuzz-findings")]
    findings: PathBuf,
    /// Targets run at once.
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    #[arg(long, hide = true)]
    child: bool,
    #[arg(long, hide = true, default_value_t = 0)]
    start: u64,
    #[arg(long, hide = true)]
    progress: Option<PathBuf>,
}

fn main() -> Result<ExitCode> {
    let arguments = Arguments::parse();
    let asked = |t: &&Target| arguments.target == t.name || (arguments.target == "all" && t.name != SELF_CHECK.name);
    let targets: Vec<&Target> = TARGETS.iter().chain([&SELF_CHECK]).filter(asked).collect();
    let Some(first) = targets.first() else {
        let names: Vec<&str> = TARGETS.iter().map(|t| t.name).collect();
        anyhow::bail!("there is no target \"{}\"\n  help: use all, or one of: {}", arguments.target, names.join(", "));
    };
    let time = Duration::try_from_secs_f64(arguments.seconds_per_target).context("--seconds-per-target is no time")?;
    let plan = Plan { inputs: arguments.inputs, seed: arguments.seed, time };
    if let Some(path) = &arguments.replay {
        anyhow::ensure!(targets.len() == 1, "--replay needs one --target");
        run::replay(first, path)?;
        return Ok(ExitCode::SUCCESS);
    }
    if let (true, Some(progress)) = (arguments.child, &arguments.progress) {
        run::child(first, plan, arguments.start, progress)?;
        return Ok(ExitCode::SUCCESS);
    }
    let program = std::env::current_exe().context("cannot find this program")?;
    let next = std::sync::atomic::AtomicUsize::new(0);
    let found = std::sync::atomic::AtomicUsize::new(0);
    let work = || -> Result<()> {
        while let Some(target) = targets.get(next.fetch_add(1, std::sync::atomic::Ordering::Relaxed)) {
            let outcome = run::target(target, plan, &program, &arguments.findings)?;
            let (share, peak) = (100.0 * outcome.read as f64 / outcome.inputs.max(1) as f64, outcome.peak_bytes as f64 / 1e6);
            let count = outcome.findings.len();
            let mut text = format!(
                "{:<14} {:>9} inputs, {share:>5.1} % of them read, at most {peak:.1} MB: {count} findings",
                target.name, outcome.inputs
            );
            for (what, path) in &outcome.findings {
                let path = path.display();
                text += &format!("\n  {what}\n    corf-fuzz --target {} --replay {path}", target.name);
            }
            println!("{text}");
            found.fetch_add(count, std::sync::atomic::Ordering::Relaxed);
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..arguments.jobs.max(1)).map(|_| scope.spawn(work)).collect();
        workers.into_iter().try_for_each(|w| w.join().map_err(|_| anyhow::anyhow!("a worker panicked"))?)
    })?;
    Ok(if found.into_inner() == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
