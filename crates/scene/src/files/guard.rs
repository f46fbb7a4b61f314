//! Decoders of other people's formats, guarded so that one that panics on damaged bytes gives an error instead.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

thread_local! {
    /// Whether this thread runs a decoder whose panic is turned into an error and need not be printed.
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Restores what was before, however the decoder ends.
struct Guarding(bool);

impl Drop for Guarding {
    fn drop(&mut self) {
        GUARDED.set(self.0);
    }
}

/// Runs `decode` and turns a panic inside it into an error. Such a panic is not printed; panics of other threads, and all others, are
/// reported as usual. All that `decode` owns is dropped with it, so no half-made value is seen.
///
/// # Errors
/// The panic's message.
pub(crate) fn guarded<T>(decode: impl FnOnce() -> T) -> Result<T, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let report = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            // A thread that is ending has no flag any more, and reports.
            if !GUARDED.try_with(Cell::get).unwrap_or(false) {
                report(panic);
            }
        }));
    });
    let guarding = Guarding(GUARDED.replace(true));
    let result = catch_unwind(AssertUnwindSafe(decode));
    drop(guarding);
    result.map_err(|payload| {
        let words =
            payload.downcast_ref::<&str>().map(|s| (*s).to_string()).or_else(|| payload.downcast_ref::<String>().cloned());
        format!("the decoder gave up on it ({})", words.unwrap_or_else(|| "for no stated reason".into()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_its_words_and_a_value_stays_itself() {
        assert_eq!(guarded(|| 3), Ok(3));
        let bytes: &[u8] = &[];
        let index = std::hint::black_box(5);
        let error = guarded(|| bytes[index]).unwrap_err();
        assert!(error.contains("gave up") && error.contains("index is 5"), "{error}");
        assert!(!GUARDED.get());
    }
}
