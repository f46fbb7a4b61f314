//! Output of the command to standard error and standard output, in one place: names from files are sanitised so that they cannot send
//! control sequences to a terminal, and a standard error that cannot be written to ends no work.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fmt::{Arguments, Display, Write as _};
use std::io::{ErrorKind, Write};
use std::sync::{Mutex, OnceLock, PoisonError};

/// Folder in an output folder in which files are written out of sight ([`crate::files::output`]); messages name the places that they will have.
pub const UNFINISHED: &str = ".corf-unfinished";

/// Says a line on standard error, as `eprintln!` would; where that cannot be written, nothing happens.
#[macro_export]
macro_rules! note {
    ($($words:tt)*) => {
        $crate::terminal::messages::to_stderr(format_args!($($words)*))
    };
}

/// What lines are written in the midst of, where bars are drawn on the same terminal.
static AROUND: OnceLock<fn(&mut dyn FnMut())> = OnceLock::new();

/// Says what makes room for every line from now on, and restores what it moved; the first to say so counts.
pub fn make_room_by(around: fn(&mut dyn FnMut())) {
    let _ = AROUND.set(around);
}

/// Writes a line to standard error, or not.
pub fn to_stderr(words: Arguments<'_>) {
    let text = in_sight(&words.to_string());
    let line = format!("{}\n", sanitized(&text));
    let mut write = || {
        // The work goes on where nobody can be told of it.
        let _ = std::io::stderr().write_all(line.as_bytes());
    };
    match AROUND.get() {
        Some(around) => around(&mut write),
        None => write(),
    }
}

/// A text in which files that are written out of sight are where they will be.
fn in_sight(text: &str) -> String {
    text.replace(&format!("{}{UNFINISHED}", std::path::MAIN_SEPARATOR), "")
}

/// Says findings on standard error, a line each.
pub fn findings<F: Display>(findings: impl IntoIterator<Item = F>) {
    findings.into_iter().for_each(|finding| to_stderr(format_args!("{finding}")));
}

/// Says findings on standard error, each text once in the life of the process.
pub fn once<F: Display>(findings: impl IntoIterator<Item = F>) {
    static SAID: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let mut said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
    self::findings(findings.into_iter().map(|finding| finding.to_string()).filter(|text| said.insert(text.clone())));
}

/// Writes a result and a line's end to standard output; a reader that has gone away is no error.
///
/// # Errors
/// When standard output cannot be written for another reason.
pub fn to_stdout(text: &str) -> std::io::Result<()> {
    let line = format!("{}\n", sanitized(text.trim_end()));
    let mut out = std::io::stdout().lock();
    match out.write_all(line.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error),
        _ => Ok(()),
    }
}

/// A text without what a terminal would obey: control characters but line ends and tabs, and those that turn the direction of writing,
/// become their escapes (`\u001b`), which JSON reads back.
pub fn sanitized(text: &str) -> Cow<'_, str> {
    let obeyed =
        |c: char| c.is_control() && !matches!(c, '\n' | '\t') || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    if !text.contains(obeyed) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if obeyed(c) {
            // Writing to a String cannot fail; all of these are below 0x10000.
            let _ = write!(out, "\\u{:04x}", c as u32);
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_out_of_sight_is_named_as_it_will_be() {
        let place = ["out", UNFINISHED, "images", "1.png"].iter().collect::<std::path::PathBuf>();
        let seen = ["out", "images", "1.png"].iter().collect::<std::path::PathBuf>();
        assert_eq!(in_sight(&format!("cannot write {}: no", place.display())), format!("cannot write {}: no", seen.display()));
    }

    #[test]
    fn a_name_cannot_steer_the_terminal() {
        assert_eq!(sanitized("wall\x1b[2J\x07 \u{9b}31m\r"), "wall\\u001b[2J\\u0007 \\u009b31m\\u000d");
        assert_eq!(sanitized("a\u{202e}b"), "a\\u202eb");
        assert!(matches!(sanitized("zwei Zeilen:\n\tΔ ± 0.3 dB – 中文"), Cow::Borrowed(_)));
        // What JSON holds stays what it is.
        let json = sanitized("{\"name\": \"a\u{9b}b\"}").into_owned();
        assert_eq!(serde_json::from_str::<serde_json::Value>(&json).unwrap()["name"], "a\u{9b}b");
    }
}
