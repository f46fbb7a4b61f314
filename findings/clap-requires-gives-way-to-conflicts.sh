#!/usr/bin/env bash
# Guess: an option that requires another (`requires`) is never accepted without it: `--radius 3` is an error where the `--orbit` that it requires is not given.
# Behaviour: it is accepted, and does nothing, where anything is given that the required option conflicts with. The check of required arguments leaves out those that conflict with an argument
#   that is present, and so takes the conflict as an excuse for whoever required them. `--radius 3` alone is refused; `--poses p --radius 3` passes, for --orbit and --poses exclude each other.
#   Stating the conflict once more at the dependent option (`conflicts_with`) refuses it.
# Versions: clap 4.6.7 (crates.io).
# Source: Arg::requires, https://docs.rs/clap/4.6.7/clap/struct.Arg.html#method.requires, which says that the other argument is required, and nothing of this.
# Output seen:
#   --radius 3                       error: the following required arguments were not provided:
#   --poses p --radius 3             taken
#   --poses p --radius 3, stated     error: the argument '--poses <poses>' cannot be used with '--radius <radius>'
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
unset CARGO_TARGET_DIR
mkdir src
cat > Cargo.toml <<'TOML'
[package]
name = "requires-and-conflicts"
version = "0.0.0"
edition = "2021"

[dependencies]
clap = { version = "=4.6.7", default-features = false, features = ["std", "error-context"] }
TOML
cat > src/main.rs <<'RUST'
use clap::{Arg, Command};

fn taken(stated: bool, arguments: &[&str]) -> String {
    let option = |name: &'static str| Arg::new(name).long(name);
    let radius = option("radius").requires("orbit");
    let radius = if stated { radius.conflicts_with("poses") } else { radius };
    let command = Command::new("tool").arg(option("poses")).arg(option("orbit").conflicts_with("poses")).arg(radius);
    match command.try_get_matches_from([&["tool"], arguments].concat()) {
        Ok(matches) => {
            assert!(!matches.contains_id("orbit") && matches.contains_id("radius"));
            "taken".to_owned()
        }
        Err(error) => error.to_string().lines().next().unwrap_or_default().to_owned(),
    }
}

fn main() {
    println!("--radius 3                       {}", taken(false, &["--radius", "3"]));
    println!("--poses p --radius 3             {}", taken(false, &["--poses", "p", "--radius", "3"]));
    println!("--poses p --radius 3, stated     {}", taken(true, &["--poses", "p", "--radius", "3"]));
}
RUST
cargo run --quiet >seen.txt
cat seen.txt
diff seen.txt - <<'SEEN'
--radius 3                       error: the following required arguments were not provided:
--poses p --radius 3             taken
--poses p --radius 3, stated     error: the argument '--poses <poses>' cannot be used with '--radius <radius>'
SEEN
