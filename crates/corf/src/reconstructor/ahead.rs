//! Keyframes on their way from arrival to expansion. Where the device trains on the host they are prepared one by one, when asked; else
//! several at once, on threads of their own, in the background. What comes out is the same.

use super::prepare::{Looked, Past, Prepared, Preparer};
use crate::Result;
use corf_scene::Keyframe;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Keyframes between arrival and expansion, in the order of their arrival.
pub(super) struct Ahead {
    shared: Arc<Shared>,
    /// Keyframes that nobody has looked at; none where threads prepare what arrives.
    arrivals: VecDeque<Keyframe>,
    received: usize,
    taken: usize,
}

/// Threads of a lane.
const LANE: usize = 4;

/// Threads that prepare keyframes.
struct Threads {
    /// In turn: in one pool for all, a thread that waits for a part of its keyframe begins with another in between, and some keyframes take
    /// three times as long as most.
    lanes: Vec<ThreadPool>,
    /// One after the other, what all later ones wait for.
    in_order: ThreadPool,
}

impl Threads {
    /// About `count` of them, at least one; none where the system has none to give.
    fn new(count: usize) -> Option<Self> {
        let pool = |name: &'static str| {
            ThreadPoolBuilder::new().num_threads(LANE.min(count)).thread_name(move |i| format!("{name} {i}")).build().ok()
        };
        let lanes = (0..count.div_ceil(LANE)).map(|_| pool("prepare")).collect::<Option<_>>()?;
        Some(Self { lanes, in_order: pool("place")? })
    }

    fn lane(&self, place: usize) -> &ThreadPool {
        &self.lanes[place % self.lanes.len()]
    }
}

/// What the threads that prepare keyframes have in common.
struct Shared {
    preparer: Preparer,
    /// Without, everything happens when it is asked for.
    threads: Option<Threads>,
    state: Mutex<State>,
    changed: Condvar,
}

/// Keyframes by their place in the order of arrival.
struct State {
    /// Those known that all have to be met before the first is placed, once that is decided.
    first: Option<usize>,
    /// Missing while a keyframe is being placed.
    past: Option<Past>,
    /// How many have been met, and placed.
    met: usize,
    placed: usize,
    looked: BTreeMap<usize, Result<Looked>>,
    ready: BTreeMap<usize, Result<Prepared>>,
}

impl Ahead {
    /// Nothing has arrived yet. `background` is the number of threads to prepare with; without, everything happens when it is asked for.
    pub fn new(preparer: Preparer, past: Past, background: Option<usize>) -> Self {
        let state = State { first: None, past: Some(past), met: 0, placed: 0, looked: BTreeMap::new(), ready: BTreeMap::new() };
        let threads = background.and_then(Threads::new);
        let shared = Arc::new(Shared { preparer, threads, state: Mutex::new(state), changed: Condvar::new() });
        Self { shared, arrivals: VecDeque::new(), received: 0, taken: 0 }
    }

    pub fn preparer(&self) -> &Preparer {
        &self.shared.preparer
    }

    /// What keyframes hand on to each other, before any is placed.
    pub fn with_past(&mut self, change: impl FnOnce(&mut Past)) {
        if let Some(past) = &mut self.shared.lock().past {
            change(past);
        }
    }

    /// How many keyframes have arrived and not been taken.
    pub fn waiting(&self) -> usize {
        self.received - self.taken
    }

    pub fn receive(&mut self, keyframe: Keyframe) {
        let place = self.received;
        self.received += 1;
        let Some(threads) = &self.shared.threads else { return self.arrivals.push_back(keyframe) };
        let shared = self.shared.clone();
        threads.lane(place).spawn_fifo(move || {
            let looked = shared.preparer.look(&keyframe);
            drop(keyframe);
            shared.lock().looked.insert(place, looked);
            shared.advance();
        });
    }

    /// Says that the first keyframes are complete: `count` of them, if so many have arrived, know each other before any is placed.
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
        let place = state.placed;
        // As many as have to be met.
        let last = state.first.unwrap_or(0).max(place + 1);
        for at in (place + state.looked.len()..last).take(self.arrivals.len()) {
            if let Some(keyframe) = self.arrivals.pop_front() {
                state.looked.insert(at, self.shared.preparer.look(&keyframe));
            }
        }
        drop(state);
        if let Some((place, placed)) = self.shared.place_next() {
            let prepared = placed.and_then(|placed| self.shared.preparer.complete(placed));
            self.shared.lock().ready.insert(place, prepared);
        }
    }

    /// Takes the earliest keyframe, once it is prepared; `None` where none waits.
    ///
    /// # Errors
    /// What its preparation met.
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
    fn place_next(&self) -> Option<(usize, Result<super::prepare::Placed>)> {
        let mut state = self.lock();
        let place = state.placed;
        let to_meet = state.first?.max(place + 1);
        if !(state.met.max(place)..to_meet).all(|at| state.looked.contains_key(&at)) {
            return None;
        }
        let mut past = state.past.take()?;
        for at in state.met..to_meet {
            if let Some(Ok(looked)) = state.looked.get(&at) {
                past.meet(&looked.view);
            }
        }
        state.met = to_meet;
        let looked = state.looked.remove(&place);
        drop(state);
        let placed = looked.map(|looked| looked.map(|looked| self.preparer.place(&mut past, looked)));
        let mut state = self.lock();
        state.past = Some(past);
        state.placed += 1;
        placed.map(|placed| (place, placed))
    }

    /// Has what can be placed placed, and then completed, where threads do that.
    fn advance(self: &Arc<Self>) {
        let Some(threads) = &self.threads else { return };
        let shared = self.clone();
        threads.in_order.spawn_fifo(move || {
            while let Some((place, placed)) = shared.place_next() {
                let Some(threads) = &shared.threads else { return };
                let own = shared.clone();
                threads.lane(place).spawn_fifo(move || {
                    let prepared = placed.and_then(|placed| own.preparer.complete(placed));
                    own.lock().ready.insert(place, prepared);
                    own.changed.notify_all();
                });
            }
        });
    }
}
