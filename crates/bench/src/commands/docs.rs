//! `corf docs`: writes tables and help into documents, or checks that they are there.

use super::{Command, Verdict, print};
use crate::documents::splice::spliced;
use anyhow::{Context, Result};
use clap::{Args, Subcommand};
use corf_scene::io::{read_text, write_atomic};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// `corf docs`.
#[derive(Args)]
pub struct Docs {
    /// Markdown files with marked places: `<!-- corf docs: table FOLDER -->`, `<!-- corf docs: paper FOLDER I -->`, `<!-- corf docs: help -->` …, to
    /// `<!-- corf docs: end -->`.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Change nothing; exit 1 if a file would change.
    #[arg(long)]
    check: bool,
}

impl Docs {
    /// Writes every marked place anew.
    ///
    /// # Errors
    /// A file that cannot be read or written, or a marker that is not understood.
    pub fn run(self) -> Result<Verdict> {
        let help = help();
        let (mut stale, mut said) = (false, String::new());
        for path in &self.files {
            let old = read_text(path)?;
            let folder = path.parent().unwrap_or(Path::new("."));
            let new = spliced(&old, folder, &help).with_context(|| format!("in {}", path.display()))?;
            let change = new != old;
            stale |= change;
            if change && !self.check {
                write_atomic(path, new.as_bytes())?;
            }
            let state = if !change { "up to date" } else { ["written", "stale: run `corf docs` on it"][usize::from(self.check)] };
            let _ = writeln!(said, "{}: {state}", path.display());
        }
        print(said.trim_end())?;
        Ok(if self.check && stale { Verdict::CheckFailed } else { Verdict::Done })
    }
}

/// The help of every command, as Markdown.
fn help() -> String {
    let root = Command::augment_subcommands(clap::Command::new("corf").disable_help_subcommand(true));
    let mut out = String::new();
    describe(&root, "corf", &mut out);
    out
}

fn describe(command: &clap::Command, name: &str, out: &mut String) {
    for sub in command.get_subcommands().filter(|sub| !sub.is_hide_set() && sub.get_name() != "help") {
        let name = format!("{name} {}", sub.get_name());
        if sub.has_subcommands() {
            describe(sub, &name, out);
            continue;
        }
        let mut shown = sub.clone().bin_name(&name).term_width(110);
        let text = shown.render_long_help().to_string();
        let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
        let _ = writeln!(out, "## `{name}`\n\n```text\n{}\n```\n", lines.join("\n").trim_end());
    }
}
