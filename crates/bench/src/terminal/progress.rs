//! Progress on stderr: a bar with rate and time left on a terminal, a line every five seconds otherwise; stages that cannot count what they do
//! say how long they have lasted.

use crate::note;
use crate::terminal::messages::{make_room_by, sanitized};
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::{Arc, Condvar, LazyLock, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval between plain lines of progress when standard error is no terminal, and time after which a stage says that it is at work.
const PLAIN_INTERVAL: Duration = Duration::from_secs(5);
/// Interval at which a bar is drawn anew.
const BAR_INTERVAL: Duration = Duration::from_millis(250);
/// Columns of a label at most, beside which bar, counts and pace fit 80.
const LABEL_COLUMNS: usize = 24;
/// Columns of a rate at most.
const RATE_COLUMNS: usize = 20;

/// All bars of the terminal: tasks may run side by side.
static BARS: LazyLock<MultiProgress> = LazyLock::new(|| {
    make_room_by(|write| BARS.suspend(write));
    MultiProgress::new()
});

/// One running task that counts its units.
pub struct Progress {
    clock: Clock,
}

/// A stage that does not know how much there is to do. It is silent unless it lasts; it ends where it is dropped.
pub struct Stage {
    clock: Clock,
}

/// What is told of a task, and the thread that tells it.
struct Clock {
    task: Arc<Task>,
    bar: Option<ProgressBar>,
    teller: Option<JoinHandle<()>>,
}

struct Task {
    label: String,
    unit: String,
    start: Instant,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Clone, Copy)]
struct State {
    /// Units that were done when the task began.
    before: usize,
    done: usize,
    /// 0 of a stage that does not count.
    total: usize,
    ended: bool,
    /// Whether a line was said.
    spoken: bool,
}

impl Progress {
    /// Starts a task of `total` units of this name, in the plural.
    pub fn start(label: impl Into<String>, total: usize, unit: &str) -> Self {
        Self { clock: Clock::start(label.into(), total.max(1), unit) }
    }

    /// The same of a task so many units of which were done earlier, and tell nothing of its rate.
    pub fn begun_at(self, done: usize) -> Self {
        self.clock.task.change(|state| (state.before, state.done) = (done, done));
        self
    }

    /// Tells how much is done, of how much.
    pub fn set(&mut self, done: usize, total: usize) {
        self.clock.task.change(|state| (state.done, state.total) = (done, total.max(1)));
    }

    /// Ends the task with a line of its own.
    pub fn finish(mut self) {
        let State { done, total, .. } = self.clock.end();
        let task = &self.clock.task;
        note!("{}: {done}/{total}, {:.1} s", task.label, task.start.elapsed().as_secs_f64());
    }
}

impl Stage {
    /// Starts a stage.
    pub fn start(label: impl Into<String>) -> Self {
        Self { clock: Clock::start(label.into(), 0, "") }
    }

    /// What `work` returns, done as a stage of this name.
    pub fn of<T>(label: impl Into<String>, work: impl FnOnce() -> T) -> T {
        let _stage = Self::start(label);
        work()
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        let lasted = self.clock.task.start.elapsed();
        if self.clock.end().spoken || lasted >= PLAIN_INTERVAL {
            note!("{}: {:.1} s", self.clock.task.label, lasted.as_secs_f64());
        }
    }
}

impl Clock {
    fn start(label: String, total: usize, unit: &str) -> Self {
        let task = Arc::new(Task {
            label: sanitized(&label).replace('\n', " "),
            unit: unit.to_owned(),
            start: Instant::now(),
            state: Mutex::new(State { before: 0, done: 0, total, ended: false, spoken: false }),
            changed: Condvar::new(),
        });
        let bar = std::io::stderr().is_terminal().then(|| bar(&task.label, total));
        let (told, drawn) = (task.clone(), bar.clone());
        // Without a thread to spare, the work goes on untold.
        let teller = std::thread::Builder::new().name("progress".into()).spawn(move || told.tell(drawn)).ok();
        Self { task, bar, teller }
    }

    /// Has the teller end, and clears the bar; what the task came to.
    fn end(&mut self) -> State {
        self.task.change(|state| state.ended = true);
        if let Some(teller) = self.teller.take() {
            // It panics nowhere, and if it did nothing would be lost.
            let _ = teller.join();
        }
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
        *self.task.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Clock {
    fn drop(&mut self) {
        self.end();
    }
}

/// The bar of a task, or the mark of a stage, in a line that fits 80 columns and any wider terminal.
fn bar(label: &str, total: usize) -> ProgressBar {
    let (bar, template) = match total {
        0 => (ProgressBar::new_spinner(), "{spinner} {prefix} {wide_msg}"),
        _ => (ProgressBar::new(total as u64), "{prefix} {wide_bar} {pos}/{len} {msg}"),
    };
    let bar = BARS.add(bar);
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_prefix(shortened(label, LABEL_COLUMNS));
    bar
}

impl Task {
    fn change(&self, change: impl FnOnce(&mut State)) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut state);
        if state.ended {
            self.changed.notify_all();
        }
    }

    /// Draws the bar, or says lines, until the task ends.
    fn tell(&self, bar: Option<ProgressBar>) {
        let interval = if bar.is_some() { BAR_INTERVAL } else { PLAIN_INTERVAL };
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        while !state.ended {
            let (guard, waited) = self.changed.wait_timeout(state, interval).unwrap_or_else(PoisonError::into_inner);
            state = guard;
            if state.ended || !waited.timed_out() {
                continue;
            }
            state.spoken |= bar.is_none();
            let (now, seconds) = (*state, self.start.elapsed().as_secs_f64());
            // Nobody waits for a terminal.
            drop(state);
            match &bar {
                Some(bar) => {
                    bar.set_length(now.total as u64);
                    bar.set_position(now.done as u64);
                    bar.set_message(if now.total == 0 { duration(seconds) } else { pace(&now, seconds, &self.unit) });
                    bar.tick();
                }
                None => note!("{}", line(&self.label, &now, seconds)),
            }
            state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// A plain line.
fn line(label: &str, state: &State, seconds: f64) -> String {
    match (state.total, left_s(state, seconds)) {
        (0, _) => format!("{label}: {} so far", duration(seconds)),
        (total, None) => format!("{label}: {}/{total}, {}", state.done, duration(seconds)),
        (total, Some(left)) => format!("{label}: {}/{total}, {}, about {} left", state.done, duration(seconds), duration(left)),
    }
}

/// Rate and time left, as behind a bar.
fn pace(state: &State, seconds: f64, unit: &str) -> String {
    let Some(left) = left_s(state, seconds) else { return duration(seconds) };
    let rate = (state.done - state.before) as f64 / seconds;
    let rate = match rate {
        r if r >= 99.5 => format!("{r:.0} {unit}/s"),
        r if r >= 9.95 => format!("{r:.1} {unit}/s"),
        r if r >= 1.0 => format!("{r:.2} {unit}/s"),
        r => format!("{} each", duration(1.0 / r)),
    };
    format!("{}, {} left", shortened(&rate, RATE_COLUMNS), duration(left))
}

/// Seconds that the rest takes at the mean rate so far; `None` before there is one. The mean changes slowly: what is left never jumps.
fn left_s(state: &State, seconds: f64) -> Option<f64> {
    let done = state.done.saturating_sub(state.before);
    (done > 0 && seconds > 0.0).then(|| seconds * state.total.saturating_sub(state.done) as f64 / done as f64)
}

/// A span of time as people say it: `8 s`, `4 min`, `1 h 20 min`.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 9.95 => format!("{s:.1} s"),
        s if s < 119.5 => format!("{s:.0} s"),
        s if s < 119.5 * 60.0 => format!("{:.0} min", s / 60.0),
        s => {
            let minutes = (s / 60.0).round();
            format!("{:.0} h {:.0} min", (minutes / 60.0).floor(), minutes % 60.0)
        }
    }
}

/// A text of so many characters at most.
fn shortened(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        None => text.to_owned(),
        Some(_) => text.chars().take(most - 1).chain(['…']).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(before: usize, done: usize, total: usize) -> State {
        State { before, done, total, ended: false, spoken: false }
    }

    #[test]
    fn spans_of_time_and_rates_have_the_digits_that_people_read() {
        let spans = [
            (0.04, "0.0 s"),
            (8.25, "8.2 s"),
            (9.97, "10 s"),
            (95.4, "95 s"),
            (121.0, "2 min"),
            (5400.0, "90 min"),
            (9000.0, "2 h 30 min"),
        ];
        for (seconds, text) in spans {
            assert_eq!(duration(seconds), text);
        }
        assert_eq!(pace(&state(0, 2000, 8000), 10.0, "tiles"), "200 tiles/s, 30 s left");
        assert_eq!(pace(&state(0, 15, 30), 10.0, "views"), "1.50 views/s, 10 s left");
        assert_eq!(pace(&state(0, 1, 3), 600.0, "views"), "10 min each, 20 min left");
        // What was done earlier took none of this time; before anything is done no rate is known.
        assert_eq!(pace(&state(90, 95, 100), 10.0, "views"), "2.0 s each, 10 s left");
        assert_eq!(pace(&state(90, 90, 100), 10.0, "views"), "10 s");
        assert_eq!(line("keyframes", &state(0, 0, 40), 5.0), "keyframes: 0/40, 5.0 s");
        assert_eq!(line("photons", &state(0, 0, 0), 65.0), "photons: 65 s so far");
    }

    #[test]
    fn the_time_left_does_not_jump() {
        // Units of a second with a pause of ten in the middle, as where a file is waited for.
        let mut last: Option<f64> = None;
        let mut seconds = 0.0;
        for done in 1..=100 {
            seconds += if done == 50 { 10.0 } else { 1.0 };
            let left = left_s(&state(0, done, 100), seconds).unwrap();
            if let Some(before) = last {
                assert!((left - before).abs() < 11.0 && left < 120.0, "{done}: {before} then {left}");
            }
            last = Some(left);
        }
        assert_eq!(last, Some(0.0));
    }

    #[test]
    fn no_line_of_a_bar_is_wider_than_80_columns() {
        // Prefix, a bar of one column at least, counts, pace, with the blanks between them.
        for (now, seconds) in
            [(state(0, 98_765, 98_766), 0.11), (state(0, 12, 40), 12.0 * 7140.0), (state(0, 99_999_999, 99_999_999), 7e4)]
        {
            let counts = format!("{}/{}", now.done, now.total);
            let wide =
                LABEL_COLUMNS + 1 + 1 + 1 + counts.len() + 1 + pace(&now, seconds, "keyframes of a long name").chars().count();
            assert!(wide <= 80, "{wide}");
        }
        assert_eq!(shortened("keyframes of a room of many words", 10), "keyframes…");
        assert_eq!(shortened("ten wörter", 10), "ten wörter");
    }

    #[test]
    fn a_stage_that_is_over_soon_is_silent_and_its_thread_ends() {
        let result = Stage::of("soon", || 3);
        assert_eq!(result, 3);
        let mut stage = Stage::start("seen");
        stage.clock.task.change(|state| state.spoken = false);
        let ended = stage.clock.end();
        assert!(ended.ended && !ended.spoken && stage.clock.teller.is_none());
        let mut progress = Progress::start("few", 3, "units").begun_at(1);
        progress.set(2, 3);
        let State { before, done, total, .. } = progress.clock.end();
        assert_eq!((before, done, total), (1, 2, 3));
    }
}
