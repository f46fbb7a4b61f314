//! The corf command.
fn main() {}
