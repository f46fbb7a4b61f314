//! Ctrl-C: the work stops at the next unit, what is finished stays, and the message says how to go on. A unit that lasts longer than a
//! person waits is not waited for: files are written whole or not at all, so it may end anywhere.

use crate::note;
use anyhow::Result;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

static INTERRUPTED: AtomicBool = AtomicBool::new(false);
/// Whether the next interrupt ends the input alone.
static ENDS_INPUT: AtomicBool = AtomicBool::new(false);
/// Whether an interrupt has ended the input.
static INPUT_ENDED: AtomicBool = AtomicBool::new(false);

/// Whether the result is whole, and what is left is to show it.
static WHOLE: AtomicBool = AtomicBool::new(false);

/// Time that the current unit of work has to end after an interrupt.
const GRACE: Duration = Duration::from_secs(2);

/// Time limit for writing the final message.
const LAST_WORDS: Duration = Duration::from_millis(50);

/// What is on disk to go on from, of a command that says it itself.
static KEPT: Mutex<Option<String>> = Mutex::new(None);

/// The user asked to stop.
#[derive(Debug, thiserror::Error)]
#[error("interrupted; {}", last_words())]
pub struct Interrupted;

/// What is left after an interrupt.
fn last_words() -> String {
    let kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner).clone();
    kept.unwrap_or_else(|| {
        "what was finished is kept: where the command has --resume, the same command with it goes on from there".to_owned()
    })
}

/// Says from now on what an interrupt leaves, in the place of what is true of most commands; [`kept`] changes it.
pub fn print_what_is_kept(text: impl Into<String>) {
    *KEPT.lock().unwrap_or_else(PoisonError::into_inner) = Some(text.into());
}

/// Takes note of what has been written to go on from, where the command says what that is.
pub fn kept(text: impl FnOnce() -> String) {
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(said) = kept.as_mut() {
        *said = text();
    }
}

/// Exit code after an interrupt (128 + SIGINT), as shells expect.
pub const EXIT_CODE: u8 = 130;

/// Listens for Ctrl-C and termination; a second one ends the process at once, as does a unit of work that does not end in time.
///
/// # Errors
/// When a handler is installed already.
pub fn listen() -> Result<()> {
    ctrlc::set_handler(|| {
        if WHOLE.load(Ordering::SeqCst) {
            // The process ends by itself, at once, and with the exit code of work that is done.
            return;
        }
        if ENDS_INPUT.swap(false, Ordering::SeqCst) {
            INPUT_ENDED.store(true, Ordering::SeqCst);
            note!(
                "\nno further input is taken; what has arrived is worked off, then the result is finished (again to stop without one)"
            );
            return;
        }
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            end_now();
        }
        std::thread::spawn(|| {
            std::thread::sleep(GRACE);
            if WHOLE.load(Ordering::SeqCst) {
                return;
            }
            // On a thread of its own: a reader that does not read must not keep the process.
            std::thread::spawn(|| note!("{Interrupted}"));
            std::thread::sleep(LAST_WORDS);
            end_now();
        });
        note!("\nstopping after the unit at hand, in two seconds at most (again to stop at once)");
    })?;
    Ok(())
}

/// Makes a file that outgrows the process's limit (`ulimit -f`) an error of the write, as a full disk is, and not the end of the process. A
/// handler that does nothing does that, and other than a signal that is ignored it is not handed on to programs that are started.
pub fn outlive_file_size_limit() {
    #[cfg(unix)]
    {
        extern "C" fn nothing(_: libc::c_int) {}
        let handler: extern "C" fn(libc::c_int) = nothing;
        // SAFETY: the handler does nothing, so it may run at any point of any thread.
        unsafe { libc::signal(libc::SIGXFSZ, handler as libc::sighandler_t) };
    }
}

/// Ends the process whatever its threads do: nothing that runs at a usual exit could wait for one of them.
fn end_now() -> ! {
    #[cfg(unix)]
    // SAFETY: takes a number and never returns; nothing of this process is looked at afterwards.
    unsafe {
        libc::_exit(i32::from(EXIT_CODE))
    }
    #[cfg(not(unix))]
    std::process::exit(i32::from(EXIT_CODE))
}

/// Says that the result is whole: an interrupt stops nothing any more, and what it had begun to stop is not taken for stopped.
///
/// # Errors
/// [`Interrupted`] where one came before.
pub fn settle() -> Result<()> {
    WHOLE.store(true, Ordering::SeqCst);
    let interrupted = check();
    if interrupted.is_err() {
        WHOLE.store(false, Ordering::SeqCst);
    }
    interrupted
}

/// Says whether the next Ctrl-C is to end the input of a command that takes some without end, and not the command.
pub fn let_first_end_input(yes: bool) {
    ENDS_INPUT.store(yes, Ordering::SeqCst);
}

/// Whether Ctrl-C has ended the input.
pub fn input_ended() -> bool {
    INPUT_ENDED.load(Ordering::SeqCst)
}

/// Whether to stop; called between units of work.
///
/// # Errors
/// [`Interrupted`] after Ctrl-C.
pub fn check() -> Result<()> {
    if INTERRUPTED.load(Ordering::SeqCst) { Err(Interrupted.into()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_an_interrupt_leaves_is_what_was_last_written() {
        kept(|| "a checkpoint of a command that says nothing of its own".to_owned());
        assert!(Interrupted.to_string().contains("what was finished is kept"), "{Interrupted}");
        print_what_is_kept("nothing is kept yet");
        assert_eq!(Interrupted.to_string(), "interrupted; nothing is kept yet");
        kept(|| "run/checkpoint holds 12 keyframes".to_owned());
        assert_eq!(Interrupted.to_string(), "interrupted; run/checkpoint holds 12 keyframes");
        *KEPT.lock().unwrap() = None;
    }
}
