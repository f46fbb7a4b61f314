//! What a reconstruction at work and the server of its page tell each other: how far it is, and the field where a page has asked for it.

use super::splats::{self, FieldLayout};
use crate::methods::interface::Advance;
use corf::{Field, RasterConfig};
use corf_scene::keyframe::Modalities;
use serde::Serialize;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Somebody is looking who has asked within this time. A page asks twice a second, but where the processor draws it, every few.
const PRESENCE: Duration = Duration::from_secs(10);

/// Times that the reconstruction works for as long as a reading of its field takes, before the next: whatever pages ask, that is less than a
/// tenth of the time.
const WORK_PER_READING: u32 = 10;

/// Most versions of the field that clients are sent at once: who is slow with an old one does not keep more of them in memory.
const VERSIONS_SENT: usize = 2;

/// How the Gaussians of a reconstruction are drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drawing {
    /// The rasteriser's settings.
    pub raster: RasterConfig,
    /// Whether RF colours are spectra.
    pub radio: bool,
    /// What the reconstruction learns from.
    pub modalities: Modalities,
}

/// How far a reconstruction is, and its latest snapshot. What stands behind the lock is read and written in moments: neither the field nor a
/// client is ever waited for within.
pub(super) struct Growth {
    drawing: Drawing,
    /// What progress is counted in.
    unit: &'static str,
    state: Mutex<State>,
    fetched: Condvar,
}

#[derive(Default)]
struct State {
    done: usize,
    total: usize,
    gaussians: Option<usize>,
    finished: bool,
    /// Whether a page has asked for a snapshot since the last.
    asked: bool,
    /// Until when no field is read, whoever asks.
    rests: Option<Instant>,
    /// When a page was last there.
    seen: Option<Instant>,
    snapshot: Option<Snapshot>,
    /// Whether a page was told of the end, and the version that was last fetched.
    told_end: bool,
    fetched: u64,
    /// Bytes of versions that somebody is being sent, oldest first.
    sent: Vec<(u64, Weak<Vec<u8>>)>,
}

/// The field as it stood after `done` units of work.
#[derive(Clone)]
struct Snapshot {
    /// 1 for the first.
    version: u64,
    done: usize,
    field: Arc<Field>,
}

/// What a page is told of the growth.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct GrowthDocument {
    /// What `done` and `total` count: `keyframes` (with later rounds over all of them counted on), or `steps`.
    unit: &'static str,
    done: usize,
    total: usize,
    gaussians: Option<usize>,
    /// Whether the reconstruction has ended and its result is written.
    finished: bool,
    /// Of the latest snapshot: its number, 0 where there is none, the units of work before it, and its layout.
    version: u64,
    snapshot_done: usize,
    field: Option<FieldLayout>,
}

impl Growth {
    pub(super) fn new(drawing: Drawing, unit: &'static str, total: usize) -> Self {
        let state = State { total, ..State::default() };
        Self { drawing, unit, state: Mutex::new(state), fetched: Condvar::new() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A thread that panicked has left numbers that are right, each by itself.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes note of progress, and a snapshot if a page has asked for one since the last and that is not just gone: where nobody looks, no field
    /// is read.
    pub(super) fn report(&self, advance: &Advance<'_>) {
        let mut state = self.state();
        (state.done, state.total) = (advance.done, advance.total);
        state.gaussians = advance.gaussians.or(state.gaussians);
        let start = Instant::now();
        let may = state.asked && state.rests.is_none_or(|until| start >= until);
        let Some(reader) = advance.field.filter(|_| may) else { return };
        state.asked = false;
        drop(state);
        let field = reader.read();
        let end = Instant::now();
        self.state().rests = Some(end + (end - start) * WORK_PER_READING);
        if let Some(field) = field {
            self.put(advance.done, field);
        }
    }

    fn put(&self, done: usize, mut field: Field) {
        field.meta.modalities = self.drawing.modalities;
        let mut state = self.state();
        let version = state.snapshot.as_ref().map_or(0, |s| s.version) + 1;
        let before = state.snapshot.replace(Snapshot { version, done, field: Arc::new(field) });
        drop(state);
        drop(before);
    }

    /// What there is to say; `asks` says whether it asks for a snapshot.
    pub(super) fn document(&self, asks: bool) -> GrowthDocument {
        let mut state = self.state();
        state.asked |= asks;
        state.seen = Some(Instant::now());
        state.told_end |= state.finished;
        self.fetched.notify_all();
        let snapshot = state.snapshot.clone();
        let document = GrowthDocument {
            unit: self.unit,
            done: state.done,
            total: state.total,
            gaussians: state.gaussians,
            finished: state.finished,
            version: snapshot.as_ref().map_or(0, |s| s.version),
            snapshot_done: snapshot.as_ref().map_or(0, |s| s.done),
            field: None,
        };
        drop(state);
        GrowthDocument { field: snapshot.map(|s| self.layout(&s.field)), ..document }
    }

    fn layout(&self, field: &Field) -> FieldLayout {
        splats::layout(field, &self.drawing.raster, self.drawing.radio)
    }

    /// Version and bytes of the latest snapshot; version 0 without bytes where there is none. Where [`VERSIONS_SENT`] older ones are still being
    /// sent, the latest of these.
    pub(super) fn bytes(&self) -> (u64, Arc<Vec<u8>>) {
        let mut state = self.state();
        let Some(Snapshot { version, field, .. }) = state.snapshot.clone() else { return (0, Arc::default()) };
        state.sent.retain(|(_, bytes)| bytes.strong_count() > 0);
        let latest = state.sent.last().and_then(|(version, bytes)| Some((*version, bytes.upgrade()?)));
        let many = state.sent.len() >= VERSIONS_SENT;
        drop(state);
        let (version, bytes) = match latest.filter(|(sent, _)| many || *sent == version) {
            Some(latest) => latest,
            None => {
                let bytes = Arc::new(splats::bytes(&field, &self.layout(&field)));
                self.state().sent.push((version, Arc::downgrade(&bytes)));
                (version, bytes)
            }
        };
        let mut state = self.state();
        state.fetched = state.fetched.max(version);
        self.fetched.notify_all();
        (version, bytes)
    }

    /// The reconstruction has ended. Where somebody is looking, `field` gives what it ended with, and this waits until a page knows of the
    /// end and has fetched it, but no longer than `until`.
    pub(super) fn finish(&self, until: Instant, field: impl FnOnce() -> Option<Field>) {
        let present = self.state().seen.is_some_and(|seen| seen.elapsed() < PRESENCE);
        if !present {
            return;
        }
        let (done, field) = (self.state().total, field());
        if let Some(field) = field {
            self.put(done, field);
        }
        let mut state = self.state();
        (state.done, state.finished) = (state.total, true);
        let waits = |s: &mut State| !s.told_end || s.snapshot.as_ref().is_some_and(|snapshot| s.fetched < snapshot.version);
        let longest = until.saturating_duration_since(Instant::now());
        let _ = self.fetched.wait_timeout_while(state, longest, waits);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::interface::FieldReader;
    use crate::viewer::splats::tests::field;
    use std::cell::Cell;

    fn growth() -> Growth {
        let drawing = Drawing { raster: RasterConfig::default(), radio: true, modalities: Modalities::BOTH };
        Growth::new(drawing, "keyframes", 4)
    }

    #[test]
    fn the_field_is_read_only_where_a_page_has_asked_since_the_last_time() {
        let (growth, reads) = (growth(), Cell::new(0));
        let read = || {
            reads.set(reads.get() + 1);
            Some(field())
        };
        let report = |done| growth.report(&Advance { field: Some(FieldReader::new(&read)), ..Advance::of(done, 4) });
        report(1);
        assert_eq!(reads.get(), 0, "nobody has asked");
        let reported = growth.document(false);
        assert_eq!((reported.done, reported.total, reported.version, reported.field), (1, 4, 0, None));
        report(2);
        assert_eq!(reads.get(), 0, "a page that nobody sees asks for nothing");
        growth.document(true);
        growth.document(true);
        // A report between keyframes has no field to give, and leaves the wish open.
        growth.report(&Advance::of(2, 4));
        report(3);
        report(4);
        assert_eq!(reads.get(), 1, "asked twice before one boundary is one snapshot");
        let reported = growth.document(false);
        assert_eq!((reported.done, reported.version, reported.snapshot_done), (4, 1, 3));
        let (version, bytes) = growth.bytes();
        assert_eq!((version, &*bytes), (1, &splats::bytes(&field(), &reported.field.unwrap())));
    }

    #[test]
    fn a_modality_that_is_not_learnt_is_not_shown() {
        let drawing = Drawing { modalities: Modalities { light: true, radio: false }, ..growth().drawing };
        let growth = Growth::new(drawing, "keyframes", 1);
        growth.document(true);
        growth.report(&Advance { field: Some(FieldReader::new(&|| Some(field()))), ..Advance::of(1, 1) });
        let layout = growth.document(false).field.unwrap();
        assert!(layout.light.is_some() && layout.radio.is_none());
    }

    #[test]
    fn reading_takes_a_tenth_of_the_time_at_most_however_often_pages_ask() {
        const READING: Duration = Duration::from_millis(20);
        let (growth, reads, start) = (growth(), Cell::new(0), Instant::now());
        let read = || {
            reads.set(reads.get() + 1);
            std::thread::sleep(READING);
            Some(field())
        };
        let mut units = 0;
        while start.elapsed() < 25 * READING {
            growth.document(true);
            growth.report(&Advance { field: Some(FieldReader::new(&read)), ..Advance::of(1, 4) });
            units += 1;
            std::thread::sleep(READING / 20);
        }
        // One every eleven readings' time; the last may have come just before the end.
        let most = 1 + start.elapsed().as_millis() / (11 * READING.as_millis());
        assert!(units > 10 && reads.get() >= 2 && reads.get() <= most, "{} of {most} in {units} units", reads.get());
    }

    #[test]
    fn clients_that_are_slow_share_the_bytes_of_two_versions() {
        let growth = growth();
        let grow = || {
            growth.put(1, field());
            growth.bytes()
        };
        let first = grow();
        assert!(first.0 == 1 && Arc::ptr_eq(&first.1, &growth.bytes().1), "two clients, one body");
        let second = grow();
        let third = grow();
        assert!(second.0 == 2 && third.0 == 2 && Arc::ptr_eq(&second.1, &third.1), "two versions are being sent");
        drop(first);
        let fourth = growth.bytes();
        assert_eq!((fourth.0, growth.state().sent.len()), (3, 2), "one has been sent, and the latest takes its place");
        drop((second, third, fourth));
        growth.put(1, field());
        assert_eq!((growth.bytes().0, growth.state().sent.len()), (4, 1));
    }

    #[test]
    fn the_end_waits_for_those_who_look_and_for_nobody_else() {
        const LONGEST_WAIT: Duration = Duration::from_secs(20);
        let growth = growth();
        let start = Instant::now();
        let until = start + LONGEST_WAIT;
        growth.finish(until, || panic!("nobody looks"));
        assert!(start.elapsed() < LONGEST_WAIT);
        growth.document(true);
        std::thread::scope(|scope| {
            let end = scope.spawn(|| growth.finish(until, || Some(field())));
            let finished = || growth.document(false).finished;
            while !finished() {
                std::thread::yield_now();
            }
            assert!(!end.is_finished(), "what it ended with has not been fetched");
            assert_eq!(growth.bytes().0, 1);
        });
        assert!(start.elapsed() < LONGEST_WAIT, "it was fetched, so nobody waits any more");
        // A page that looks and fetches nothing is waited for no longer than was said.
        growth.document(true);
        let start = Instant::now();
        growth.finish(start + Duration::from_millis(50), || Some(field()));
        assert!(start.elapsed() >= Duration::from_millis(50) && start.elapsed() < LONGEST_WAIT);
    }
}
