//! Mutated input for every parser of the workspace.
//!
//! A target is a parser and a corpus of small files. Input number `i` of a seed is a corpus file, changed a few times; the same seed and number
//! give the same bytes. A parser must answer each with a value or an error: no panic, no abort, no more than [`alloc::LIMIT`] bytes at once, and
//! within [`run::INPUT_LIMIT`].

// A driver for developers: its findings are lines on standard output.
#![allow(clippy::print_stdout, clippy::print_stderr)]

pub mod alloc;
mod capture;
mod files;
pub mod mutate;
pub mod run;
pub mod target;
