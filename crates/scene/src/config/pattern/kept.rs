//! What a process reads of files and keeps as long as it runs: antennas are small values that are copied everywhere, and what is equal is kept once.

use std::sync::{Mutex, PoisonError};

/// The value that is kept for all that equal it.
pub(super) fn once<T: PartialEq>(kept: &Mutex<Vec<&'static T>>, value: T) -> &'static T {
    let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = kept.iter().find(|known| ***known == value) {
        return known;
    }
    let new: &'static T = Box::leak(Box::new(value));
    kept.push(new);
    new
}
