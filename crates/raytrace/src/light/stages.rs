//! Where the time of a work goes.

use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Time that a stage of the work took, of all the times that it was done.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spent {
    /// The stage; `gpu: …` where the device itself says so, else by the wall.
    pub what: &'static str,
    /// Seconds.
    pub seconds: f64,
    /// How often.
    pub times: u64,
}

/// Seconds that threads spend on the stages of a work.
#[derive(Debug, Default)]
pub struct Stages(Mutex<Vec<Spent>>);

impl Stages {
    /// Adds seconds to a stage's.
    pub fn add(&self, what: &'static str, seconds: f64) {
        let mut stages = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match stages.iter_mut().find(|s| s.what == what) {
            Some(of) => (of.seconds, of.times) = (of.seconds + seconds, of.times + 1),
            None => stages.push(Spent { what, seconds, times: 1 }),
        }
    }

    /// Does something and adds the time that it takes to a stage's.
    pub fn time<T>(&self, what: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let done = work();
        self.add(what, start.elapsed().as_secs_f64());
        done
    }

    /// The stages so far, in the order in which each was first done.
    pub fn spent(&self) -> Vec<Spent> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
