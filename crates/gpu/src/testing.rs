//! Helpers of the tests of whatever computes on a GPU.

use crate::adapter::{AdapterOptions, adapter_name};
use crate::context::Context;

/// Any adapter, subgroups if it has them, working memory full of NaN.
pub const OPTIONS: AdapterOptions =
    AdapterOptions { number: 0, software: true, subgroups: true, timestamps: false, half: false, poison: Some(0xffc0_ffee) };

/// An adapter, or `None` and a line that says so.
///
/// # Panics
/// Under `CORF_REQUIRE_GPU=1` where there is none, and where there is one that cannot be opened.
#[expect(clippy::print_stdout, clippy::expect_used, reason = "for tests alone")]
pub fn context(options: &AdapterOptions) -> Option<Context> {
    if adapter_name(options).is_some() {
        return Some(Context::open(options).expect("the adapter opens"));
    }
    let required = std::env::var_os("CORF_REQUIRE_GPU").is_some_and(|v| v == "1");
    assert!(!required, "no adapter");
    println!("skipped: no adapter");
    None
}
