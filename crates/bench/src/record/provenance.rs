//! Provenance of results: source, machine, memory.

use corf_scene::io::sha256_hex;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The source a record was made with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of this crate.
    pub version: String,
    /// Git commit the binary was built from, or `unknown`.
    pub commit: String,
    /// Whether tracked files differed from that commit.
    pub dirty: bool,
    /// SHA-256 of Cargo.lock.
    pub lockfile_sha256: String,
    /// Processor's name, as the operating system gives it.
    pub processor: String,
    /// Worker threads.
    pub threads: usize,
}

/// The lock file this binary was built with.
const LOCKFILE: &[u8] = include_bytes!("../../../../Cargo.lock");

impl Provenance {
    /// The provenance of results of this binary on this machine.
    pub fn here() -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: env!("CORF_COMMIT").to_owned(),
            dirty: env!("CORF_DIRTY") == "true",
            lockfile_sha256: sha256_hex(LOCKFILE),
            processor: processor_name().unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            threads: rayon::current_num_threads(),
        }
    }
}

fn processor_name() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|l| l.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// The largest resident set of this process so far, bytes; `None` where the system does not tell.
pub fn peak_memory_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}

/// Processor time that all threads of this process have taken so far, seconds; `None` where the system does not tell.
pub fn processor_s() -> Option<f64> {
    /// Ticks a second in which Linux tells times, whatever its own clock is (proc(5)).
    const TICKS: f64 = 100.0;
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The program's name may hold anything but ends at the last parenthesis; times in user and in system mode are fields 14 and 15.
    let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |field: usize| fields.get(field - 3)?.parse::<u64>().ok();
    Some((ticks(14)? + ticks(15)?) as f64 / TICKS)
}

/// Forgets the peak so far, so that the next [`peak_memory_bytes`] speaks of what follows; does nothing where the system cannot.
pub fn reset_peak_memory() {
    // Writing 5 to clear_refs resets VmHWM (Linux, proc(5)); failing to only makes the figure an upper bound.
    let _ = std::fs::write(Path::new("/proc/self/clear_refs"), "5");
}
