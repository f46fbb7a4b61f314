#!/usr/bin/env bash
# Guess: an option with allow_negative_numbers(true) and value_delimiter(',') takes `--range-db -70,-10` as it takes `--range-db -70`: each value of the list is a negative number.
# Behaviour: the delimiter splits values after the command line has been cut into flags and values, and for that cut the whole argument has to be one number. `-70` passes, `-70,-10` is
#   an unexpected argument `-7`. `--range-db=-70,-10` passes; with allow_hyphen_values(true) the list passes as well, and so does a misspelt flag in a value's place.
# Versions: clap 4.6.7 (crates.io).
# Source: Arg::allow_negative_numbers, https://docs.rs/clap/4.6.7/clap/struct.Arg.html#method.allow_negative_numbers, which speaks of negative numbers only.
# Output seen:
#   numbers -70       [-70.0]
#   numbers -70,-10   error: unexpected argument '-7' found
#   numbers =-70,-10  [-70.0, -10.0]
#   hyphens -70,-10   [-70.0, -10.0]
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
unset CARGO_TARGET_DIR
mkdir src
cat > Cargo.toml <<'TOML'
[package]
name = "negative-lists"
version = "0.0.0"
edition = "2021"

[dependencies]
clap = { version = "=4.6.7", default-features = false, features = ["std", "error-context"] }
TOML
cat > src/main.rs <<'RUST'
use clap::{Arg, Command, value_parser};

fn taken(hyphens: bool, arguments: &[&str]) -> String {
    let range = Arg::new("range").long("range-db").value_delimiter(',').value_parser(value_parser!(f64));
    let range = if hyphens { range.allow_hyphen_values(true) } else { range.allow_negative_numbers(true) };
    let parsed = Command::new("tool").arg(range).try_get_matches_from([&["tool"], arguments].concat());
    match parsed {
        Ok(matches) => format!("{:?}", matches.get_many::<f64>("range").unwrap().collect::<Vec<_>>()),
        Err(error) => error.to_string().lines().next().unwrap_or_default().to_owned(),
    }
}

fn main() {
    println!("numbers -70       {}", taken(false, &["--range-db", "-70"]));
    println!("numbers -70,-10   {}", taken(false, &["--range-db", "-70,-10"]));
    println!("numbers =-70,-10  {}", taken(false, &["--range-db=-70,-10"]));
    println!("hyphens -70,-10   {}", taken(true, &["--range-db", "-70,-10"]));
}
RUST
cargo run --quiet >seen.txt
cat seen.txt
diff seen.txt - <<'SEEN'
numbers -70       [-70.0]
numbers -70,-10   error: unexpected argument '-7' found
numbers =-70,-10  [-70.0, -10.0]
hyphens -70,-10   [-70.0, -10.0]
SEEN
