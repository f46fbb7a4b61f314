//! Running targets: each in a process of its own, so that an abort or an endless loop is seen and laid to its input.

use crate::alloc::{Counting, LIMIT};
use crate::mutate;
use crate::target::{Target, corpus};
use anyhow::{Context, Result};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// How long a parser may take for one input on a busy machine.
pub const INPUT_LIMIT: Duration = Duration::from_secs(20);

/// How many inputs of which seed, and for how long.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Inputs of each target.
    pub inputs: u64,
    /// What they are made from.
    pub seed: u64,
    /// When a target stops, whatever is left.
    pub time: Duration,
}

/// What a target's run came to.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Inputs run.
    pub inputs: u64,
    /// Inputs that the parser read.
    pub read: u64,
    /// Most bytes held at once for an input.
    pub peak_bytes: u64,
    /// Findings: what happened, and the file with the input's bytes.
    pub findings: Vec<(String, PathBuf)>,
}

thread_local! {
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Keeps a panic's message and place instead of printing them.
fn listen() {
    std::panic::set_hook(Box::new(|panic| PANIC.with(|last| *last.borrow_mut() = panic.to_string())));
}

/// Runs one input in this process: whether it was read, or what went wrong.
fn one(target: &Target, bytes: &[u8], folder: &Path) -> std::result::Result<bool, String> {
    let began = Instant::now();
    Counting::reset_peak();
    let result = catch_unwind(AssertUnwindSafe(|| (target.read)(bytes, folder).is_ok()));
    let (took, peak) = (began.elapsed(), Counting::peak());
    match result {
        Err(_) => Err(PANIC.with(|last| last.borrow().replace('\n', " "))),
        Ok(_) if took > INPUT_LIMIT => Err(format!("took {:.1} s", took.as_secs_f64())),
        Ok(_) if peak > LIMIT => Err(format!("held {peak} bytes")),
        Ok(read) => Ok(read),
    }
}

/// A folder that is gone with its value, in memory where the system has a place for that: some targets write files for every input.
fn scratch() -> Result<tempfile::TempDir> {
    let memory = Path::new("/dev/shm");
    if memory.is_dir()
        && let Ok(folder) = tempfile::tempdir_in(memory)
    {
        return Ok(folder);
    }
    Ok(tempfile::tempdir()?)
}

/// The bytes of an input; three in four have their checksums made right.
fn bytes(target: &Target, corpus: &[Vec<u8>], seed: u64, number: u64) -> Vec<u8> {
    let mut bytes = mutate::input(target.name, corpus, seed, number);
    if number >= corpus.len() as u64 && !number.is_multiple_of(4) {
        (target.mend)(&mut bytes);
    }
    bytes
}

/// Runs the file at `path` on a target in this process, with everything it prints.
///
/// # Errors
/// The file cannot be read, or the parser panicked.
pub fn replay(target: &Target, path: &Path) -> Result<bool> {
    let folder = scratch()?;
    let input = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    listen();
    let began = Instant::now();
    let read = one(target, &input, folder.path()).map_err(|what| anyhow::anyhow!("{what}"))?;
    let answer = (target.read)(&input, folder.path()).err().map_or("it is read".to_string(), |e| format!("refused: {e:#}"));
    println!("{answer}\n{} bytes held at most, {:.3} s", Counting::peak(), began.elapsed().as_secs_f64());
    Ok(read)
}

/// The child's part: runs inputs from `start` on, keeping in `progress` which one is under way, and writes a line a finding.
///
/// # Errors
/// A file of its own that cannot be written.
pub fn child(target: &Target, plan: Plan, start: u64, progress: &Path) -> Result<()> {
    listen();
    let corpus = corpus(target.name)?;
    let folder = scratch()?;
    std::env::set_current_dir(folder.path())?;
    let mut under_way = std::fs::OpenOptions::new().write(true).create(true).truncate(false).open(progress)?;
    let (began, mut read, mut peak) = (Instant::now(), 0u64, 0u64);
    let mut places: BTreeMap<String, usize> = BTreeMap::new();
    let mut number = start;
    while number < plan.inputs && began.elapsed() < plan.time {
        under_way.seek(SeekFrom::Start(0))?;
        under_way.write_all(&[number, read, peak].map(u64::to_le_bytes).concat())?;
        match one(target, &bytes(target, &corpus, plan.seed, number), folder.path()) {
            Ok(was_read) => read += u64::from(was_read),
            Err(what) => {
                // The first words are the place; a few inputs for each say enough.
                let place: String = what.split_whitespace().take(3).collect();
                let times = places.entry(place).or_insert(0);
                *times += 1;
                if *times <= 3 && places.len() <= 20 {
                    println!("{number}\t{what}");
                }
            }
        }
        peak = peak.max(Counting::peak() as u64);
        number += 1;
    }
    under_way.seek(SeekFrom::Start(0))?;
    under_way.write_all(&[number, read, peak].map(u64::to_le_bytes).concat())?;
    Ok(())
}

/// The three numbers a child keeps: the input under way, inputs read, most bytes held.
fn state(progress: &Path) -> [u64; 3] {
    let mut bytes = [0; 24];
    let read = std::fs::File::open(progress).and_then(|mut file| file.read_exact(&mut bytes));
    let word = |k: usize| bytes[8 * k..8 * k + 8].iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
    if read.is_ok() { [word(0), word(1), word(2)] } else { [0; 3] }
}

/// Runs a target in child processes of `program`; every finding's bytes go to `findings`.
///
/// # Errors
/// A process that cannot be started, a folder that cannot be written.
pub fn target(target: &Target, plan: Plan, program: &Path, findings: &Path) -> Result<Outcome> {
    let folder = scratch()?;
    let (progress, said) = (folder.path().join("progress"), folder.path().join("said"));
    let corpus = corpus(target.name)?;
    let (began, mut start, mut outcome) = (Instant::now(), 0, Outcome::default());
    let note = |outcome: &mut Outcome, number: u64, what: String| -> Result<()> {
        std::fs::create_dir_all(findings)?;
        let path = findings.join(format!("{}-{}-{number}.bin", target.name, plan.seed));
        std::fs::write(&path, bytes(target, &corpus, plan.seed, number))?;
        outcome.findings.push((what, path));
        Ok(())
    };
    // A target that fails over and over has been heard.
    while start < plan.inputs && began.elapsed() < plan.time && outcome.findings.len() < 50 {
        std::fs::write(&progress, start.to_le_bytes())?;
        let seconds = plan.time.saturating_sub(began.elapsed()).as_secs_f64();
        let mut child = Command::new(program)
            .args(["--child", "--target", target.name, "--inputs", &plan.inputs.to_string(), "--seed", &plan.seed.to_string()])
            .args(["--start", &start.to_string(), "--seconds-per-target", &seconds.to_string(), "--progress"])
            .arg(&progress)
            .stdout(std::fs::File::create(&said)?)
            .stderr(Stdio::null())
            .spawn()
            .context("cannot start a process")?;
        let (mut last, mut since) = (state(&progress)[0], Instant::now());
        let mut hung = false;
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break status;
            }
            std::thread::sleep(Duration::from_millis(20));
            let now = state(&progress)[0];
            if now != last {
                (last, since) = (now, Instant::now());
            } else if since.elapsed() > INPUT_LIMIT + Duration::from_secs(5) {
                hung = true;
                child.kill()?;
            }
        };
        for line in std::fs::read_to_string(&said)?.lines() {
            if let Some((number, what)) = line.split_once('\t') {
                note(&mut outcome, number.parse()?, what.to_string())?;
            }
        }
        let [number, read, peak] = state(&progress);
        outcome.read += read;
        outcome.peak_bytes = outcome.peak_bytes.max(peak);
        if status.success() {
            outcome.inputs = number;
            return Ok(outcome);
        }
        let what = if hung { format!("no answer within {INPUT_LIMIT:?}") } else { format!("the process ended: {status}") };
        note(&mut outcome, number, what)?;
        start = number + 1;
        outcome.inputs = start;
    }
    Ok(outcome)
}
