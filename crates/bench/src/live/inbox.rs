//! Arrivals: a thread that looks into the live folder, stamps what has landed, and reads it.

use super::order::Order;
use super::outcome::{EndedBy, WhenBehind};
use corf_scene::live::{END, LiveDescription, LiveFrame, POSES, number_of};
use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

/// Pause between looks into the folder: arrivals are stamped this late at most, plus what reading a keyframe takes.
const POLL: Duration = Duration::from_millis(8);
/// Pause between looks at pose files that have been seen, which somebody may have written again.
const REVISIT: Duration = Duration::from_secs(1);
/// Keyframes that are read ahead of their turn; more would only take memory.
const READ_AHEAD: usize = 8;

/// A keyframe that has been read.
pub(super) struct Arrival {
    pub stem: String,
    pub frame: LiveFrame,
    pub arrived: Instant,
}

/// Something that happened to a keyframe which is not passed on.
pub(super) enum Notice {
    /// It cannot be used.
    Refused { file: String, number: Option<u64>, reason: String, at: Instant },
    /// A later one took its place.
    Dropped { number: u64, arrived: Instant },
}

/// Counts of what has landed.
#[derive(Clone, Copy, Default)]
pub(super) struct Tally {
    /// Keyframes that were complete, whatever became of them.
    pub arrived: usize,
    /// The most that waited at once.
    pub longest_queue: usize,
    /// When the first and the latest came.
    pub first_and_last: Option<(Instant, Instant)>,
}

#[derive(Default)]
struct State {
    ready: VecDeque<Arrival>,
    /// Landed and not read yet.
    unread: usize,
    notices: Vec<Notice>,
    /// Passed on.
    delivered: usize,
    /// Passed on and waiting there for their turn.
    in_hand: usize,
    tally: Tally,
    ended: Option<EndedBy>,
}

impl State {
    fn queue(&self) -> usize {
        self.unread + self.ready.len() + self.in_hand
    }
}

struct Shared {
    dir: PathBuf,
    description: LiveDescription,
    policy: WhenBehind,
    /// The first so many are never left out.
    collected: usize,
    /// Nothing more is wanted than what has landed.
    stop: AtomicBool,
    /// Nobody takes what is read.
    abandoned: AtomicBool,
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The receiving end.
pub(super) struct Inbox {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Inbox {
    /// Begins to look into `dir`; `collected` is the number of first keyframes that are never left out.
    pub fn open(dir: &Path, description: &LiveDescription, policy: WhenBehind, collected: usize) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            dir: dir.to_owned(),
            description: description.clone(),
            policy,
            collected,
            stop: AtomicBool::new(false),
            abandoned: AtomicBool::new(false),
            state: Mutex::default(),
            changed: Condvar::new(),
        });
        let own = shared.clone();
        let thread = std::thread::Builder::new().name("live folder".to_owned()).spawn(move || Receiver::new(&own).run())?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Takes the next keyframe, if one is there.
    pub fn take(&self) -> Option<Arrival> {
        let mut state = self.shared.lock();
        let arrival = state.ready.pop_front()?;
        state.delivered += 1;
        Some(arrival)
    }

    /// Says how many of those taken wait for their turn, so that queues are counted whole.
    pub fn set_in_hand(&self, count: usize) {
        let mut state = self.shared.lock();
        state.in_hand = count;
    }

    /// Takes what has been noticed.
    pub fn notices(&self) -> Vec<Notice> {
        std::mem::take(&mut self.shared.lock().notices)
    }

    /// Number of keyframes that wait.
    pub fn queue(&self) -> usize {
        self.shared.lock().queue()
    }

    /// Counts so far.
    pub fn tally(&self) -> Tally {
        self.shared.lock().tally
    }

    /// Why nothing comes any more, once all that came has been taken.
    pub fn ended(&self) -> Option<EndedBy> {
        let state = self.shared.lock();
        if state.ready.is_empty() && state.notices.is_empty() { state.ended } else { None }
    }

    /// Takes nothing more than what has landed by now.
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::SeqCst);
    }

    /// Waits until something has come, or a while.
    ///
    /// # Errors
    /// The thread that looks is gone.
    pub fn wait(&self, at_most: Duration) -> anyhow::Result<()> {
        let state = self.shared.lock();
        if !state.ready.is_empty() || !state.notices.is_empty() || state.ended.is_some() {
            return Ok(());
        }
        anyhow::ensure!(
            self.thread.as_ref().is_some_and(|t| !t.is_finished()),
            "the thread that looks into {} has ended",
            self.shared.dir.display()
        );
        drop(self.shared.changed.wait_timeout(state, at_most));
        Ok(())
    }
}

impl Drop for Inbox {
    fn drop(&mut self) {
        self.shared.abandoned.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A pose file that has landed.
struct Landed {
    name: String,
    number: u64,
    at: Instant,
}

/// The thread that looks.
struct Receiver<'a> {
    shared: &'a Shared,
    /// Length and time of change of every pose file that was seen.
    seen: BTreeMap<String, (u64, Option<SystemTime>)>,
    revisited: Instant,
    unread: VecDeque<Landed>,
    order: Order,
}

impl<'a> Receiver<'a> {
    fn new(shared: &'a Shared) -> Self {
        Self { shared, seen: BTreeMap::new(), revisited: Instant::now(), unread: VecDeque::new(), order: Order::default() }
    }

    fn run(mut self) {
        loop {
            // First whether there is an end: what landed before it is seen by the look that follows.
            let end = if self.shared.stop.load(Ordering::SeqCst) {
                Some(EndedBy::Interrupt)
            } else if self.shared.dir.join(END).exists() {
                Some(EndedBy::Marker)
            } else if !self.shared.dir.is_dir() {
                Some(EndedBy::FolderGone)
            } else {
                None
            };
            // And the last look is a thorough one.
            self.look(end.is_some());
            if self.shared.abandoned.load(Ordering::SeqCst) {
                return;
            }
            let room = self.shared.policy == WhenBehind::Drop || self.shared.lock().ready.len() < READ_AHEAD;
            match if room { self.unread.pop_front() } else { None } {
                Some(landed) => self.read(landed),
                None if end.is_some() && self.unread.is_empty() => {
                    self.shared.lock().ended = end;
                    self.shared.changed.notify_all();
                    return;
                }
                None => std::thread::sleep(POLL),
            }
        }
    }

    /// Finds pose files that are new and, now and then or where `thorough`, that were written again.
    fn look(&mut self, thorough: bool) {
        let folder = self.shared.dir.join(POSES);
        // It may not be there yet.
        let Ok(entries) = std::fs::read_dir(&folder) else { return };
        let revisit = thorough || self.revisited.elapsed() >= REVISIT;
        if revisit {
            self.revisited = Instant::now();
        }
        let mut found = Vec::new();
        for entry in entries.flatten() {
            let Some(name) = entry.file_name().to_str().map(str::to_owned) else { continue };
            if name.starts_with('.') || !name.ends_with(".json") || self.seen.contains_key(&name) && !revisit {
                continue;
            }
            let Ok(metadata) = entry.metadata() else { continue };
            let signature = (metadata.len(), metadata.modified().ok());
            if self.seen.insert(name.clone(), signature) != Some(signature) {
                found.push(name);
            }
        }
        if found.is_empty() {
            return;
        }
        let at = Instant::now();
        let mut numbered = Vec::new();
        for name in found {
            match number_of(&name) {
                Some(number) => numbered.push(Landed { name, number, at }),
                None => self.refuse(format!("{POSES}/{name}"), None, "its name is no number".to_owned()),
            }
        }
        // Those that came between two looks are taken for in order.
        numbered.sort_by(|a, b| a.number.cmp(&b.number).then_with(|| a.name.cmp(&b.name)));
        let arrived = numbered.len();
        self.unread.extend(numbered);
        let mut state = self.shared.lock();
        state.unread = self.unread.len();
        state.tally.arrived += arrived;
        if arrived > 0 {
            state.tally.first_and_last = Some((state.tally.first_and_last.map_or(at, |(first, _)| first), at));
        }
        state.tally.longest_queue = state.tally.longest_queue.max(state.queue());
    }

    fn read(&mut self, landed: Landed) {
        let Landed { name, number, at } = landed;
        let stem = name.strip_suffix(".json").unwrap_or(&name).to_owned();
        let frame = match self.order.fault(number) {
            Some(fault) => Err(fault),
            None => LiveFrame::read(&self.shared.dir, &stem, &self.shared.description).map_err(|e| e.to_string()),
        };
        match frame {
            Ok(frame) => {
                self.order.take(number);
                let mut state = self.shared.lock();
                state.unread = self.unread.len();
                state.ready.push_back(Arrival { stem, frame, arrived: at });
                if self.shared.policy == WhenBehind::Drop {
                    leave_out(&mut state, self.shared.collected);
                }
            }
            Err(reason) => {
                self.refuse(format!("{POSES}/{name}"), Some(number), reason);
                self.shared.lock().unread = self.unread.len();
            }
        }
        self.shared.changed.notify_all();
    }

    fn refuse(&self, file: String, number: Option<u64>, reason: String) {
        self.shared.lock().notices.push(Notice::Refused { file, number, reason, at: Instant::now() });
        self.shared.changed.notify_all();
    }
}

/// Leaves out those that wait before the latest, but for the first `collected` of all.
fn leave_out(state: &mut State, collected: usize) {
    let kept = collected.saturating_sub(state.delivered);
    while state.ready.len() > kept + 1 {
        if let Some(Arrival { frame, arrived, .. }) = state.ready.remove(kept) {
            state.notices.push(Notice::Dropped { number: frame.number, arrived });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::{Raster, Rigid3};

    fn arrival(number: u64) -> Arrival {
        let frame = LiveFrame {
            number,
            time_s: None,
            world_from_camera: Rigid3::IDENTITY,
            rounded: None,
            image: Raster::filled(1, 1, [0; 3]),
            mask: None,
            spectrum: Raster::filled(1, 1, 0.0),
            depth_m: None,
            sources: BTreeMap::new(),
        };
        Arrival { stem: number.to_string(), frame, arrived: Instant::now() }
    }

    #[test]
    fn the_first_ones_are_never_left_out_and_then_the_latest_waits() {
        let mut state = State::default();
        for number in 0..6 {
            state.ready.push_back(arrival(number));
            leave_out(&mut state, 3);
        }
        let waiting = |state: &State| state.ready.iter().map(|a| a.frame.number).collect::<Vec<_>>();
        assert_eq!(waiting(&state), [0, 1, 2, 5]);
        let dropped: Vec<u64> = state
            .notices
            .iter()
            .filter_map(|n| match n {
                Notice::Dropped { number, .. } => Some(*number),
                Notice::Refused { .. } => None,
            })
            .collect();
        assert_eq!(dropped, [3, 4]);
        // Once they have been passed on, one waits.
        state.ready.drain(..3);
        state.delivered = 3;
        state.ready.push_back(arrival(6));
        leave_out(&mut state, 3);
        assert_eq!(waiting(&state), [6]);
    }
}
