//! What people see while a command runs: messages, progress, and how Ctrl-C ends it.

pub mod interrupt;
pub mod messages;
pub mod progress;

pub use corf_scene::config::{help_with_name, nearest};
