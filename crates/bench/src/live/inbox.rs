//! Arrivals: a thread that looks into the live folder, stamps what has landed, and reads it.

use super::earlier::Earlier;
use super::order::Order;
use super::outcome::{EndedBy, WhenBehind};
use corf_scene::live::{DEPTH, END, IMAGES, LiveDescription, LiveFrame, POSES, SPECTRA, number_of};
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
/// Pause between looks at whether the folders are there.
const WATCH: Duration = Duration::from_millis(200);
/// Time that the files of a keyframe which cannot be read have to become whole, after its pose was seen: some are written in their place.
const SETTLE: Duration = Duration::from_millis(500);
/// Pause between attempts meanwhile.
const RETRY: Duration = Duration::from_millis(50);
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
    /// Something keeps keyframes from coming, or no longer does.
    Trouble { what: String, at: Instant },
}

/// Counts of what has landed.
#[derive(Clone, Copy, Default)]
pub(super) struct Tally {
    /// Keyframes that were complete, whatever became of them, in earlier sessions as well.
    pub arrived: usize,
    /// Those that this session saw.
    pub seen_now: usize,
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
    /// Begins to look into `dir` for what `earlier` sessions have not dealt with; `collected` is the number of first keyframes that are never left
    /// out.
    pub fn open(
        dir: &Path,
        description: &LiveDescription,
        policy: WhenBehind,
        collected: usize,
        earlier: Earlier,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            dir: dir.to_owned(),
            description: description.clone(),
            policy,
            collected: collected.saturating_sub(earlier.taken.len()),
            stop: AtomicBool::new(false),
            abandoned: AtomicBool::new(false),
            state: Mutex::new(State { tally: Tally { arrived: earlier.arrived(), ..Tally::default() }, ..State::default() }),
            changed: Condvar::new(),
        });
        let own = shared.clone();
        let thread =
            std::thread::Builder::new().name("live folder".to_owned()).spawn(move || Receiver::new(&own, earlier).run())?;
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
    /// What earlier sessions have dealt with.
    earlier: Earlier,
    /// Length and time of change of every pose file that was seen.
    seen: BTreeMap<String, (u64, Option<SystemTime>)>,
    /// Folders of the live folder that were there at the last look, and whether one of them is missing now that was.
    folders: Folders,
    watched: Option<Instant>,
    revisited: Instant,
    unread: VecDeque<Landed>,
    order: Order,
}

impl<'a> Receiver<'a> {
    fn new(shared: &'a Shared, earlier: Earlier) -> Self {
        let mut order = Order::default();
        earlier.taken.iter().for_each(|number| order.take(*number));
        Self {
            shared,
            earlier,
            seen: BTreeMap::new(),
            folders: Folders::new(&shared.description),
            watched: None,
            revisited: Instant::now(),
            unread: VecDeque::new(),
            order,
        }
    }

    fn run(mut self) {
        loop {
            // First whether there is an end: what landed before it is seen by the look that follows.
            let end = if self.shared.stop.load(Ordering::SeqCst) {
                Some(EndedBy::Interrupt)
            } else if self.shared.dir.join(END).symlink_metadata().is_ok() {
                Some(EndedBy::Marker)
            } else if !self.shared.dir.is_dir() {
                Some(EndedBy::FolderGone)
            } else {
                None
            };
            if end.is_none() && self.watched.is_none_or(|last| last.elapsed() >= WATCH) {
                self.watched = Some(Instant::now());
                for what in self.folders.watch(&self.shared.dir) {
                    self.shared.lock().notices.push(Notice::Trouble { what, at: Instant::now() });
                    self.shared.changed.notify_all();
                }
            }
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
            let now = signature(&metadata);
            let before = self.seen.insert(name.clone(), now);
            if before != Some(now) && (before.is_some() || !self.earlier.knows(&name, number_of(&name))) {
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
        state.tally.seen_now += arrived;
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
            None => match LiveFrame::read(&self.shared.dir, &stem, &self.shared.description) {
                Err(_) if at.elapsed() < SETTLE => {
                    self.unread.push_front(Landed { name, number, at });
                    std::thread::sleep(RETRY);
                    return;
                }
                read => read.map_err(|e| e.to_string()),
            },
        };
        // What it has become until now is what was read.
        if let Ok(metadata) = self.shared.dir.join(POSES).join(&name).symlink_metadata() {
            self.seen.insert(name.clone(), signature(&metadata));
        }
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

/// Length and time of change of a pose file.
fn signature(metadata: &std::fs::Metadata) -> (u64, Option<SystemTime>) {
    (metadata.len(), metadata.modified().ok())
}

/// The folders that keyframes come in.
struct Folders {
    /// Name, and what it was at the last look; none before it was there.
    known: Vec<(&'static str, Option<Presence>)>,
}

/// What a folder of the live folder is found to be.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Presence {
    /// A folder that can be read.
    Readable,
    /// Nothing.
    Gone,
    /// Something else, or a folder that cannot be read.
    Unusable,
}

impl Presence {
    fn of(path: &Path) -> Self {
        match std::fs::read_dir(path) {
            Ok(_) => Self::Readable,
            // A link that leads nowhere is there.
            Err(e) if e.kind() == std::io::ErrorKind::NotFound && path.symlink_metadata().is_err() => Self::Gone,
            Err(_) => Self::Unusable,
        }
    }
}

impl Folders {
    fn new(description: &LiveDescription) -> Self {
        let names = [POSES, IMAGES, SPECTRA].into_iter().chain(description.depth.then_some(DEPTH));
        Self { known: names.map(|name| (name, None)).collect() }
    }

    /// Looks at all of them; what is to be said of those that have changed.
    fn watch(&mut self, dir: &Path) -> Vec<String> {
        let mut said = Vec::new();
        for (name, before) in &mut self.known {
            let path = dir.join(*name);
            let now = Presence::of(&path);
            let shown = path.display();
            // One that is not there yet is waited for as all of a live folder is.
            if now == before.unwrap_or(Presence::Gone) {
                continue;
            }
            match (now, *before) {
                (Presence::Readable, None) => {}
                (Presence::Readable, Some(_)) => said.push(format!("{shown} is there again")),
                (Presence::Gone, _) => said.push(format!(
                    "{shown} IS GONE: no keyframe can come until it is there again; the file `end`, or Ctrl-C, ends the run with those that have come"
                )),
                (Presence::Unusable, _) => said.push(format!(
                    "{shown} is no folder that can be read: no keyframe can come until it is; the file `end`, or Ctrl-C, ends the run with those that have come"
                )),
            }
            *before = Some(now);
        }
        said
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
    use corf_scene::{Light, Radio, Raster, Rigid3};

    #[test]
    fn a_folder_that_goes_is_told_of_once_and_one_that_is_not_there_yet_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let mut folders = Folders { known: vec![(POSES, None), (IMAGES, None)] };
        assert!(folders.watch(dir.path()).is_empty());
        let poses = dir.path().join(POSES);
        std::fs::create_dir(&poses).unwrap();
        assert!(folders.watch(dir.path()).is_empty());
        std::fs::remove_dir(&poses).unwrap();
        let said = folders.watch(dir.path());
        assert!(said.len() == 1 && said[0].contains("poses IS GONE"), "{said:?}");
        assert!(folders.watch(dir.path()).is_empty());
        std::fs::write(&poses, "a file").unwrap();
        assert!(folders.watch(dir.path())[0].contains("no folder"));
        std::fs::remove_file(&poses).unwrap();
        std::fs::create_dir(&poses).unwrap();
        folders.watch(dir.path());
        assert!(folders.watch(dir.path()).is_empty());
        // And one that never was a folder is told of as well.
        std::fs::write(dir.path().join(IMAGES), "a file").unwrap();
        assert!(folders.watch(dir.path())[0].contains("images is no folder"));
        #[cfg(unix)]
        {
            let mut folders = Folders { known: vec![(SPECTRA, None)] };
            std::os::unix::fs::symlink("nowhere", dir.path().join(SPECTRA)).unwrap();
            assert!(folders.watch(dir.path())[0].contains("spectra is no folder"));
        }
    }

    fn arrival(number: u64) -> Arrival {
        let frame = LiveFrame {
            number,
            time_s: None,
            world_from_camera: Rigid3::IDENTITY,
            rounded: None,
            light: Light::of_image(Raster::filled(1, 1, [0; 3])),
            radio: Radio { spectrum: Raster::filled(1, 1, 0.0) },
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
                Notice::Refused { .. } | Notice::Trouble { .. } => None,
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
