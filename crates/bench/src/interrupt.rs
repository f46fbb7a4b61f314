//! Ctrl-C: the work stops at the next unit, what is finished stays, and the message says how to go on.

use anyhow::Result;
use std::sync::atomic::{AtomicBool, Ordering};

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// The user asked to stop.
#[derive(Debug, thiserror::Error)]
#[error("interrupted; finished keyframes, cells and views are kept: run the same command with --resume to go on")]
pub struct Interrupted;

/// Exit code after an interrupt (128 + SIGINT), as shells expect.
pub const EXIT_CODE: u8 = 130;

/// Listens for Ctrl-C and termination; a second one ends the process at once.
///
/// # Errors
/// When a handler is installed already.
pub fn listen() -> Result<()> {
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            std::process::exit(i32::from(EXIT_CODE));
        }
        eprintln!("\nstopping after the unit at hand (again to stop at once)");
    })?;
    Ok(())
}

/// Whether to stop; called between units of work.
///
/// # Errors
/// [`Interrupted`] after Ctrl-C.
pub fn check() -> Result<()> {
    if INTERRUPTED.load(Ordering::SeqCst) { Err(Interrupted.into()) } else { Ok(()) }
}
