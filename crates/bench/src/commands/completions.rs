//! `corf completions`: a shell's completions of commands and flags.

use super::{Arguments, Verdict, print};
use anyhow::Result;
use clap::{Args, CommandFactory};
use clap_complete::{Shell, generate};

/// `corf completions`.
#[derive(Args)]
pub struct Completions {
    /// Shell: bash, zsh, fish, powershell or elvish.
    shell: Shell,
}

impl Completions {
    /// Runs the command.
    ///
    /// # Errors
    /// When standard output cannot be written.
    pub fn run(self) -> Result<Verdict> {
        let mut script = Vec::new();
        generate(self.shell, &mut Arguments::command(), "corf", &mut script);
        print(&String::from_utf8(script)?)?;
        Ok(Verdict::Done)
    }
}
