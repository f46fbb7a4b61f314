//! What holds of all commands and flags together.

#![allow(clippy::unwrap_used)]

use super::Arguments;
use clap::{Arg, Command, CommandFactory};

/// Ids of the flags that a flag requires: clap says them nowhere but in its debug text.
fn required_by(arg: &Arg) -> Vec<String> {
    let text = format!("{arg:?}");
    let list = text.split("requires: [").nth(1).unwrap().split(']').next().unwrap().to_owned();
    list.split('"').skip(1).step_by(2).map(str::to_owned).collect()
}

/// Calls `look` for a command and all below it.
fn walk(command: &Command, look: &mut impl FnMut(&Command)) {
    look(command);
    command.get_subcommands().for_each(|c| walk(c, look));
}

/// clap asks for no flag that something given conflicts with, so that what requires it would be taken and do nothing.
#[test]
fn what_requires_a_flag_conflicts_with_all_that_the_flag_conflicts_with() {
    let (mut seen, mut faults) = (0, Vec::new());
    let mut root = Arguments::command();
    root.build();
    walk(&root, &mut |command| {
        for arg in command.get_arguments() {
            for required in required_by(arg) {
                let Some(flag) = command.get_arguments().find(|a| a.get_id() == required.as_str()) else { continue };
                seen += 1;
                let own = command.get_arg_conflicts_with(arg);
                for other in command.get_arg_conflicts_with(flag) {
                    if other.get_id() != arg.get_id() && !own.iter().any(|o| o.get_id() == other.get_id()) {
                        faults.push(format!("{}: {} with {}", command.get_name(), arg.get_id(), other.get_id()));
                    }
                }
            }
        }
    });
    assert!(seen > 15, "{seen} flags require another");
    assert!(faults.is_empty(), "{faults:#?}");
}
