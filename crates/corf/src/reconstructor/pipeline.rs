//! Keyframes on their way from arrival to expansion. Where the device trains on the host they are prepared one by one, when asked; else
//! several at once, on threads of their own, in the background. What comes out is the same.

use super::prepare::{Extracted, Past, Prepared, Preparer};
use crate::Result;
use corf_scene::Keyframe;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Keyframes between arrival and expansion, in the order of their arrival.
pub(super) struct KeyframePipeline {
    shared: Arc<Shared>,
    /// Keyframes from which nothing has been extracted yet; none where threads prepare what arrives.
    arrivals: VecDeque<Keyframe>,
    received: usize,
    taken: usize,
}

/// Threads of a lane, at most.
const LANE: usize = 4;
/// Lanes that there are before any has more than one thread.
const LANES: usize = 4;

/// Threads that prepare keyframes.
struct Threads {
    /// Pools that take keyframes in turn: in one pool for all, a thread that waits for a part of its keyframe begins with another in between, and
    /// some keyframes take three times as long as most. All later ones wait for these: beside an H200 every tenth keyframe waited for 0.3 s in one
    /// pool of four threads.
    lanes: Vec<ThreadPool>,
    /// One after the other, what all later ones wait for.
    in_order: ThreadPool,
}

impl Threads {
    /// About `count` of them, at least one; none where the system has none to give.
    fn new(count: usize) -> Option<Self> {
        let (lanes, threads) = lanes(count);
        let pool = |name: &'static str| {
            ThreadPoolBuilder::new().num_threads(threads).thread_name(move |i| format!("{name} {i}")).build().ok()
        };
        let lanes = (0..lanes).map(|_| pool("prepare")).collect::<Option<_>>()?;
        Some(Self { lanes, in_order: pool("place")? })
    }

    fn lane(&self, place: usize) -> &ThreadPool {
        &self.lanes[place % self.lanes.len()]
    }
}

/// How many lanes so many threads make, and how many threads each has: where there are few, a keyframe has one.
fn lanes(count: usize) -> (usize, usize) {
    let threads = (count / LANES).clamp(1, LANE);
    (count.div_ceil(threads).max(1), threads)
}

/// State shared by the threads that prepare keyframes.
struct Shared {
    preparer: Preparer,
    /// Without, everything happens when it is asked for.
    threads: Option<Threads>,
    state: Mutex<State>,
    changed: Condvar,
}

/// Keyframes by their place in the order of arrival.
struct State {
    /// Those known that all have to be met before the first is associated, once that is decided.
    first: Option<usize>,
    /// Missing while a keyframe is being associated.
    past: Option<Past>,
    /// Number of keyframes known to matching, and of those associated with their neighbours.
    met: usize,
    associated: usize,
    extracted: BTreeMap<usize, Result<Extracted>>,
    ready: BTreeMap<usize, Result<Prepared>>,
}

impl KeyframePipeline {
    /// Nothing has arrived yet. `background` is the number of threads to prepare with; without, everything happens when it is asked for.
    pub fn new(preparer: Preparer, past: Past, background: Option<usize>) -> Self {
        let state =
            State { first: None, past: Some(past), met: 0, associated: 0, extracted: BTreeMap::new(), ready: BTreeMap::new() };
        let threads = background.and_then(Threads::new);
        let shared = Arc::new(Shared { preparer, threads, state: Mutex::new(state), changed: Condvar::new() });
        Self { shared, arrivals: VecDeque::new(), received: 0, taken: 0 }
    }

    pub fn preparer(&self) -> &Preparer {
        &self.shared.preparer
    }

    /// Changes the state that keyframes hand on to each other, before any is associated.
    pub fn with_past(&mut self, change: impl FnOnce(&mut Past)) {
        if let Some(past) = &mut self.shared.lock().past {
            change(past);
        }
    }

    /// Number of keyframes that have arrived and not been taken.
    pub fn waiting(&self) -> usize {
        self.received - self.taken
    }

    pub fn receive(&mut self, keyframe: Keyframe) {
        let place = self.received;
        self.received += 1;
        let Some(threads) = &self.shared.threads else { return self.arrivals.push_back(keyframe) };
        let shared = self.shared.clone();
        threads.lane(place).spawn_fifo(move || {
            let extracted = shared.preparer.extract(&keyframe);
            drop(keyframe);
            shared.lock().extracted.insert(place, extracted);
            shared.advance();
        });
    }

    /// Says that the first keyframes are complete: `count` of them, if so many have arrived, know each other before any is associated.
    pub fn begin(&mut self, count: usize) {
        let count = count.min(self.received);
        let mut state = self.shared.lock();
        if state.first.is_none() {
            state.first = Some(count);
            drop(state);
            self.shared.advance();
        }
    }

    /// Prepares the earliest keyframe that is not, where nobody does so in the background.
    pub fn prepare_one(&mut self) {
        if self.shared.threads.is_some() {
            return;
        }
        let mut state = self.shared.lock();
        let place = state.associated;
        // As many as have to be met.
        let last = state.first.unwrap_or(0).max(place + 1);
        for at in (place + state.extracted.len()..last).take(self.arrivals.len()) {
            if let Some(keyframe) = self.arrivals.pop_front() {
                state.extracted.insert(at, self.shared.preparer.extract(&keyframe));
            }
        }
        drop(state);
        if let Some((place, associated)) = self.shared.associate_next() {
            let prepared = associated.and_then(|associated| self.shared.preparer.finalise(associated));
            self.shared.lock().ready.insert(place, prepared);
        }
    }

    /// Whether the earliest keyframe that waits can be taken without waiting for others' work on it.
    pub fn is_ready(&self) -> bool {
        self.waiting() > 0 && (self.shared.threads.is_none() || self.shared.lock().ready.contains_key(&self.taken))
    }

    /// Takes the earliest keyframe, once it is prepared; `None` where none waits.
    ///
    /// # Errors
    /// The error of its preparation.
    pub fn take(&mut self) -> Result<Option<Prepared>> {
        if self.waiting() == 0 {
            return Ok(None);
        }
        let place = self.taken;
        if !self.shared.lock().ready.contains_key(&place) {
            self.prepare_one();
        }
        let mut state = self.shared.lock();
        loop {
            if let Some(prepared) = state.ready.remove(&place) {
                self.taken += 1;
                return prepared.map(Some);
            }
            state = self.shared.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Places the next keyframe, if it and those it has to know are there and nobody else is placing one.
    fn associate_next(&self) -> Option<(usize, Result<super::prepare::Associated>)> {
        let mut state = self.lock();
        let place = state.associated;
        let to_meet = state.first?.max(place + 1);
        if !(state.met.max(place)..to_meet).all(|at| state.extracted.contains_key(&at)) {
            return None;
        }
        let mut past = state.past.take()?;
        for at in state.met..to_meet {
            if let Some(Ok(extracted)) = state.extracted.get(&at) {
                past.meet(&extracted.view);
            }
        }
        state.met = to_meet;
        let extracted = state.extracted.remove(&place);
        drop(state);
        let associated = extracted.map(|extracted| extracted.and_then(|extracted| self.preparer.associate(&mut past, extracted)));
        let mut state = self.lock();
        state.past = Some(past);
        state.associated += 1;
        associated.map(|associated| (place, associated))
    }

    /// Associates the keyframes that can be, and has them finalised, where threads do that.
    fn advance(self: &Arc<Self>) {
        let Some(threads) = &self.threads else { return };
        let shared = self.clone();
        threads.in_order.spawn_fifo(move || {
            while let Some((place, associated)) = shared.associate_next() {
                let Some(threads) = &shared.threads else { return };
                let own = shared.clone();
                threads.lane(place).spawn_fifo(move || {
                    let prepared = associated.and_then(|associated| own.preparer.finalise(associated));
                    own.lock().ready.insert(place, prepared);
                    own.changed.notify_all();
                });
            }
        });
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn few_threads_have_a_keyframe_each_and_many_share_one() {
        for (count, expected) in
            [(1, (1, 1)), (2, (2, 1)), (4, (4, 1)), (7, (7, 1)), (8, (4, 2)), (12, (4, 3)), (16, (4, 4)), (64, (16, 4))]
        {
            assert_eq!(super::lanes(count), expected, "{count} threads");
        }
    }
}
