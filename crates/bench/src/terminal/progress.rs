//! Progress on stderr: a bar with rate and ETA on a terminal, plain lines otherwise.

use crate::note;
use crate::terminal::messages::sanitized;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Interval between plain lines of progress when standard error is no terminal.
const PLAIN_INTERVAL: Duration = Duration::from_secs(5);

/// One running task.
pub struct Progress {
    label: String,
    bar: Option<ProgressBar>,
    start: Instant,
    last_line: Instant,
    done: usize,
    total: usize,
}

impl Progress {
    /// Starts a task of `total` units; `unit` is written behind the rate.
    pub fn start(label: impl Into<String>, total: usize, unit: &str) -> Self {
        let label: String = label.into();
        let label = sanitized(&label).replace('\n', " ");
        let now = Instant::now();
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
            let template = format!("{{msg:<34}} {{bar:28}} {{pos:>5}}/{{len}}  {{per_sec:>8}} {unit}  ETA {{eta}}");
            if let Ok(style) = ProgressStyle::with_template(&template) {
                bar.set_style(style);
            }
            bar.set_message(label.clone());
            bar
        });
        Self { label, bar, start: now, last_line: now, done: 0, total }
    }

    /// Tells how much is done, of how much.
    pub fn set(&mut self, done: usize, total: usize) {
        (self.done, self.total) = (done, total);
        if let Some(bar) = &self.bar {
            bar.set_length(total as u64);
            bar.set_position(done as u64);
        } else if self.last_line.elapsed() >= PLAIN_INTERVAL {
            self.last_line = Instant::now();
            let seconds = self.start.elapsed().as_secs_f64();
            let left = seconds * (total.saturating_sub(done)) as f64 / done.max(1) as f64;
            note!("{}: {done}/{total}, {seconds:.0} s, about {left:.0} s left", self.label);
        }
    }

    /// Ends the task with a line of its own.
    pub fn finish(self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        note!("{}: {}/{}, {:.1} s", self.label, self.done, self.total, self.start.elapsed().as_secs_f64());
    }
}
