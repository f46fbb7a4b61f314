//! Where every test of the workspace finds reference data that is not in the repository: included by `#[path]`, so that there is one rule.

#![allow(clippy::print_stdout)]

use std::path::{Path, PathBuf};

/// A file of the shared folder (`CORF_SHARED`, relative to the workspace root; `../shared` by default).
///
/// Missing: says so and returns `None`, or panics where `CORF_REQUIRE_SHARED=1`.
pub fn shared(path: &str) -> Option<PathBuf> {
    let folder = std::env::var("CORF_SHARED").unwrap_or_else(|_| "../shared".into());
    // A member crate is one or two folders below the root, which has the lock file.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().find(|folder| folder.join("Cargo.lock").is_file());
    let file = root.expect("the workspace's root has a Cargo.lock").join(folder).join(path);
    if file.exists() {
        return Some(file);
    }
    assert!(std::env::var("CORF_REQUIRE_SHARED").as_deref() != Ok("1"), "{} is required and missing", file.display());
    println!("skipped: {} is not there", file.display());
    None
}
