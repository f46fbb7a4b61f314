//! Build script of the packages whose tests need what is not in the repository: such a test is `ignored`, with its reason, where that is not there.
//!
//! `cfg(reference_data)`: the folder of reference files is there (`CORF_SHARED`, relative to the workspace's root; `../shared` by default), or
//! `CORF_REQUIRE_SHARED=1` says that it has to be. `cfg(gpu_tests)`: `CORF_REQUIRE_GPU=1` says that there is an adapter.

#![allow(clippy::print_stdout)]

use std::path::Path;

fn is_set(variable: &str) -> bool {
    println!("cargo::rerun-if-env-changed={variable}");
    std::env::var(variable).is_ok_and(|value| value == "1")
}

fn main() {
    println!("cargo::rerun-if-env-changed=CORF_SHARED");
    println!("cargo::rustc-check-cfg=cfg(reference_data, gpu_tests)");
    let package = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let folder = std::env::var("CORF_SHARED").unwrap_or_else(|_| "../shared".to_owned());
    let root = Path::new(&package).ancestors().find(|folder| folder.join("Cargo.lock").is_file());
    let is_there = root.is_some_and(|root| root.join(folder).is_dir());
    if is_set("CORF_REQUIRE_SHARED") || is_there {
        println!("cargo::rustc-cfg=reference_data");
    }
    if is_set("CORF_REQUIRE_GPU") {
        println!("cargo::rustc-cfg=gpu_tests");
    }
}
