//! The `corf` command. Exit codes: 0 done, 1 a check failed, 2 the input was bad, 130 interrupted.

use clap::error::{ContextKind, ContextValue};
use corf_bench::commands::{Arguments, Verdict};
use corf_bench::note;
use corf_bench::terminal::{help_with_name, interrupt, nearest};
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

/// Keyframe after keyframe takes and frees tens of megabytes on many threads: from the system they cost a fault a page, each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// The allocator's option that says after how many milliseconds freed memory goes back to the system, which its bindings do not name.
const PURGE_DELAY: libmimalloc_sys::mi_option_t = 15;

/// Freed memory stays with the process: what one stage frees the next one takes, and getting it from the system again is 7 % of a dataset's
/// radio half. The most that it ever holds grows by a tenth.
fn keep_freed_memory() {
    // SAFETY: any value of any option may be set at any time; another number than this option's would change another option. What the
    // environment says (MIMALLOC_PURGE_DELAY) stays.
    unsafe { libmimalloc_sys::mi_option_set_default(PURGE_DELAY, -1) };
}

fn main() -> ExitCode {
    keep_freed_memory();
    interrupt::outlive_file_size_limit();
    let arguments = match Arguments::of(std::env::args_os()) {
        Ok(arguments) => arguments,
        Err(answer) => return report(with_suggestion(answer)),
    };
    match run(arguments) {
        Ok(Verdict::Done) => ExitCode::SUCCESS,
        Ok(Verdict::CheckFailed) => ExitCode::from(1),
        Err(error) if error.is::<interrupt::Interrupted>() => {
            note!("{error}");
            ExitCode::from(interrupt::EXIT_CODE)
        }
        Err(error) => {
            note!("error: {}", message(&error));
            ExitCode::from(2)
        }
    }
}

/// An error about a choice with the choice that was meant, by the rule of keys and columns instead of clap's own.
fn with_suggestion(mut answer: clap::Error) -> clap::Error {
    let (given, known) = (answer.get(ContextKind::InvalidValue), answer.get(ContextKind::ValidValue));
    let near = match (given, known) {
        (Some(ContextValue::String(given)), Some(ContextValue::Strings(known))) => {
            nearest(given, known.iter().map(String::as_str)).map(str::to_owned)
        }
        _ => return answer,
    };
    answer.insert(ContextKind::SuggestedValue, near.map_or(ContextValue::None, ContextValue::String));
    answer
}

/// Prints help, version, or what is wrong with the arguments.
fn report(answer: clap::Error) -> ExitCode {
    let code = u8::try_from(answer.exit_code()).unwrap_or(2);
    match answer.print().and_then(|()| std::io::stdout().flush()) {
        Err(error) if !answer.use_stderr() && error.kind() != ErrorKind::BrokenPipe => {
            note!("error: cannot write to standard output: {error}");
            ExitCode::from(2)
        }
        _ => ExitCode::from(code),
    }
}

fn run(arguments: Arguments) -> anyhow::Result<Verdict> {
    interrupt::listen()?;
    if let Some(threads) = arguments.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global()?;
    }
    arguments.command.run(arguments.json)
}

/// The error with its causes, each said once: some errors quote theirs.
fn message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    let help = help_with_room(error).map(str::to_owned).or_else(|| help_with_name(&text));
    if let Some(help) = help.filter(|_| !text.contains("\n  help: ")) {
        // The names that there are stand in the help.
        if let Some(at) = text.find(", expected ").filter(|_| help.starts_with("use one of: ")) {
            let end = text[at..].find('\n').map_or(text.len(), |length| at + length);
            text.replace_range(at..end, "");
        }
        text = format!("{}\n  help: {help}", text.trim_end());
    }
    text
}

/// What to do where there was no room for a file.
fn help_with_room(error: &anyhow::Error) -> Option<&'static str> {
    let kind = error.chain().find_map(|cause| cause.downcast_ref::<std::io::Error>())?.kind();
    match kind {
        ErrorKind::StorageFull => {
            Some("free some space on that disk, or choose a place on another one, and give the command again")
        }
        ErrorKind::QuotaExceeded => {
            Some("your quota is used up: free some of it, or choose another place, and give the command again")
        }
        ErrorKind::FileTooLarge => Some(
            "the file outgrows what this process or that file system allows: raise the limit (`ulimit -f unlimited`), or choose another place",
        ),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_there_is_no_room_it_says_what_to_do() {
        for (kind, word) in [
            (ErrorKind::StorageFull, "free some space"),
            (ErrorKind::QuotaExceeded, "quota"),
            (ErrorKind::FileTooLarge, "ulimit -f"),
        ] {
            let source = std::io::Error::new(kind, "no");
            let error = anyhow::Error::from(source).context("cannot write a.ply");
            let text = message(&error);
            assert!(text.starts_with("cannot write a.ply") && text.contains(word) && text.contains("\n  help: "), "{text}");
        }
        let other = anyhow::Error::from(std::io::Error::from(ErrorKind::NotFound)).context("cannot read a.ply");
        assert!(!message(&other).contains("help"));
    }

    #[test]
    fn a_misspelt_key_or_choice_is_answered_with_the_one_that_was_meant() {
        let error =
            anyhow::anyhow!("unknown field `stepss`, expected one of `rays`, `steps`\n").context("in the configuration of nerf2");
        let text = message(&error);
        assert!(text.ends_with("`steps`\n  help: did you mean `steps`?"), "{text}");
        let other = anyhow::anyhow!("unknown field `q`, expected one of `rays`, `steps`\nin `t`");
        assert_eq!(message(&other), "unknown field `q`\nin `t`\n  help: use one of: rays, steps");
        let said = |arguments: &[&str]| {
            let Err(answer) = Arguments::of(arguments) else { panic!("{arguments:?}") };
            with_suggestion(answer).to_string()
        };
        for (arguments, meant) in [
            (&["corf", "spectrum", "s.toml", "--kind", "mcp"][..], "'mpc'"),
            (&["corf", "paths", "s.toml", "--format", "jsn"], "'json'"),
            (&["corf", "reconstruct", "d", "--out", "o", "--method", "corfgs"], "'corf-gs'"),
            (&["corf", "pths"], "'paths'"),
            (&["corf", "paths", "s.toml", "--rxfile", "a"], "'--rx-file'"),
        ] {
            assert!(said(arguments).contains(meant), "{}", said(arguments));
        }
        assert!(!said(&["corf", "paths", "s.toml", "--format", "qqqqqq"]).contains("similar"));
    }

    #[test]
    fn a_negative_number_is_a_value_and_no_flag() {
        let said = |arguments: &[&str]| Arguments::of(arguments).err().map(|answer| with_suggestion(answer).to_string());
        for (arguments, flag) in [
            (&["corf", "reconstruct", "d", "--out", "o", "--seed", "-5"][..], "'--seed <SEED>'"),
            (&["corf", "paths", "s.toml", "--rx-trajectory", "-3"], "'--rx-trajectory <N>'"),
            (&["corf", "--threads", "-2", "doctor"], "'--threads <N>'"),
            (&["corf", "bench", "step", "--steps", "-1"], "'--steps "),
        ] {
            let said = said(arguments).unwrap();
            assert!(said.contains("invalid value '-") && said.contains(flag) && !said.contains("-- -"), "{said}");
        }
        // Where a number may be negative it is taken, one in exponents and several as well.
        for arguments in [
            &["corf", "scene", "new", "m.obj", "--height", "-1.5"][..],
            &["corf", "coverage", "s.toml", "--out", "o", "--height", "-1e-1", "--tx-power-dbm", "-3"],
            &["corf", "dataset", "import", "c", "--from", "colmap", "--out", "o", "--rf-db", "-70,-10"],
        ] {
            assert_eq!(said(arguments), None);
        }
    }

    #[test]
    fn the_purge_delay_is_the_option_of_that_number() {
        if std::env::var_os("MIMALLOC_PURGE_DELAY").is_some() {
            return;
        }
        // A second unless told otherwise, which no option beside it has.
        // SAFETY: reads a number.
        let get = || unsafe { libmimalloc_sys::mi_option_get(PURGE_DELAY) };
        assert_eq!(get(), 1000);
        keep_freed_memory();
        assert_eq!(get(), -1);
    }
}
