//! Where the tests find reference data.

use std::path::PathBuf;

/// A file of the shared folder (`CORF_SHARED`, relative to the workspace root; `../shared` by default).
///
/// Missing: says so and returns `None`, or panics where `CORF_REQUIRE_SHARED=1`.
pub fn shared(path: &str) -> Option<PathBuf> {
    let root = std::env::var("CORF_SHARED").unwrap_or_else(|_| "../shared".into());
    let file = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..").join(root).join(path);
    if file.exists() {
        return Some(file);
    }
    assert!(std::env::var("CORF_REQUIRE_SHARED").as_deref() != Ok("1"), "{} is required and missing", file.display());
    println!("skipped: {} is not there", file.display());
    None
}
