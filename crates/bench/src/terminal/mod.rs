//! What people see while a command runs: messages, progress, and how Ctrl-C ends it.

pub mod interrupt;
pub mod messages;
pub mod progress;
pub mod shell;

pub use corf_scene::config::{help_with_name, nearest};

use std::io::IsTerminal;

/// Width of the terminal that standard output is, characters; none where it is a file or a pipe.
pub fn width() -> Option<usize> {
    let columns = || terminal_size::terminal_size().map(|(width, _)| usize::from(width.0)).filter(|width| *width > 0);
    std::io::stdout().is_terminal().then(columns).flatten()
}
