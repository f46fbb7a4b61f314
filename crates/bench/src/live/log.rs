//! A line for everything that happens to a keyframe, on standard error and in `live.jsonl`, and the record of the whole.

use super::earlier::{Earlier, FILE};
use super::inbox::{Notice, Tally};
use super::outcome::{EndedBy, WhenBehind};
use crate::charts::{self, KeyframeLatency};
use crate::note;
use anyhow::{Context, Result};
use corf::{KeyframeTiming, LatencySummary, Percentiles};
use corf_scene::io::write_atomic;
use corf_scene::words::{counted, verb};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// The figure of what keyframes waited for, in the run's folder.
const FIGURE: &str = "latency.svg";

/// Waiting keyframes from which on it is said that the device is behind; said again at every doubling.
const BEHIND: usize = 4;

/// Where the depths of the keyframes came from: number of keyframes of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DepthSources {
    /// The depth file that came with the keyframe.
    pub files: usize,
    /// A network, from the image alone.
    pub network: usize,
    /// Matching with earlier keyframes alone.
    pub matching: usize,
}

/// A live run as `run.json` has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LiveRecord {
    /// The live folder.
    pub folder: PathBuf,
    /// What happened to keyframes that came too fast.
    pub when_behind: WhenBehind,
    /// Why it ended.
    pub ended_by: EndedBy,
    /// Keyframes that were announced, if any were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub announced: Option<usize>,
    /// Keyframes that landed, whatever became of them.
    pub arrived: usize,
    /// Of these, keyframes that an earlier, unfinished session of the run had recorded: they trained again, and no rate or latency counts them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub resumed: usize,
    /// Keyframes that trained.
    pub trained: usize,
    /// Keyframes that were held out by the protocol.
    pub held_out: usize,
    /// Numbers of keyframes that were left out because the device was behind.
    pub dropped: Vec<u64>,
    /// Pose files that were refused, with the reason.
    pub refused: Vec<[String; 2]>,
    /// The most keyframes that waited at once, those included that are collected at the beginning.
    pub longest_queue: usize,
    /// Keyframes that landed per second between the first and the last, where these were seen at different times.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arrivals_per_second: Option<f64>,
    /// Keyframes per second of expansion and training alone. Preparation (decoding, depth) runs beside them, and may be slower.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capacity_per_second: Option<f64>,
    /// Keyframes whose training ended per second between the first and the last: what was taken in fact. Where the device kept up, it could have
    /// taken more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub taken_per_second: Option<f64>,
    /// Time from arrival to the end of a keyframe's training.
    pub latency: Percentiles,
    /// The part of it in which keyframes before it were expanded and trained with.
    #[serde(default)]
    pub waited_for_others: Percentiles,
    /// The part of it in which nothing was: it was read and prepared, or the first ones were collected.
    #[serde(default)]
    pub waited_for_preparation: Percentiles,
    /// Whether keyframes were dropped, or more than `bootstrap_keyframes` waited at once.
    pub fell_behind: bool,
    /// Where depths came from.
    pub depth: DepthSources,
}

impl LiveRecord {
    /// It in a few lines.
    pub fn summary(&self) -> String {
        let [median, p90, p99] = [self.latency.median_s, self.latency.p90_s, self.latency.p99_s].map(|s| 1e3 * s);
        let mut text = format!(
            "live: {} arrived, {} trained, {} held out, {} dropped, {} refused; ended by {}\nlatency from arrival to trained: median \
             {median:.0} ms, P90 {p90:.0} ms, P99 {p99:.0} ms; longest queue {}",
            counted(self.arrived, "keyframe"),
            self.trained,
            self.held_out,
            self.dropped.len(),
            self.refused.len(),
            self.ended_by.words(),
            self.longest_queue,
        );
        let rate = |rate: Option<f64>| rate.map_or("–".to_owned(), |r| format!("{r:.2}"));
        text += &format!(
            "\nkeyframes came at {}/s and were taken at {}/s (expansion and training alone: {}/s): it {}",
            rate(self.arrivals_per_second),
            rate(self.taken_per_second),
            rate(self.capacity_per_second),
            if self.fell_behind { "FELL BEHIND" } else { "kept up" }
        );
        let ms = |p: Percentiles| [1e3 * p.median_s, 1e3 * p.p99_s];
        let ([others, others_p99], [own, own_p99]) = (ms(self.waited_for_others), ms(self.waited_for_preparation));
        text += &format!(
            "\nof it, median and P99, they waited {others:.0} and {others_p99:.0} ms for keyframes before them, {own:.0} and {own_p99:.0} ms for \
             being read and prepared"
        );
        if self.fell_behind {
            text += match others > own {
                true => ": expansion and training are too slow",
                false => ": reading and preparation are too slow",
            };
        }
        let DepthSources { files, network, matching } = self.depth;
        text += &format!(
            "\ndepth of {} from files, of {network} from a network, of {matching} from matching alone",
            counted(files, "keyframe")
        );
        if self.resumed > 0 {
            text += &format!(
                "\n{} of the keyframes came from an earlier session, whose recording they were trained from again",
                self.resumed
            );
        }
        if let Some(missing) = self.announced.and_then(|n| n.checked_sub(self.arrived)).filter(|m| *m > 0) {
            text += &format!("\n{missing} of the announced keyframes did not come");
        }
        text
    }
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Writes the lines and counts.
pub(super) struct Log {
    file: File,
    path: PathBuf,
    start: Instant,
    announced: Option<usize>,
    resumed: usize,
    trained: usize,
    held_out: usize,
    dropped: Vec<u64>,
    refused: Vec<[String; 2]>,
    /// Of the keyframes of this session.
    latencies: Vec<KeyframeLatency>,
    /// When the training of the latest keyframe ended, after the start.
    latest_s: f64,
    /// When the training of the first and of the latest keyframe ended, after the start.
    done_s: Option<[f64; 2]>,
    depth: DepthSources,
    warned_at: usize,
}

/// A trained keyframe, to be told of.
pub(super) struct Trained<'a> {
    pub number: u64,
    pub arrived: Instant,
    pub timing: &'a KeyframeTiming,
    pub gaussians: usize,
    pub queue: usize,
    pub depth: &'static str,
    /// Whether it came from an earlier session's recording.
    pub resumed: bool,
}

impl Log {
    /// Opens the file of the lines, behind those of an earlier session.
    pub fn open(run: &Path, announced: Option<usize>, earlier: &Earlier) -> Result<Self> {
        let path = run.join(FILE);
        let open = File::options().create(true).append(true).open(&path);
        let file = open.with_context(|| format!("cannot create {}", path.display()))?;
        // A line that was being written when the session was killed is none.
        file.set_len(earlier.whole_bytes).with_context(|| format!("cannot write {}", path.display()))?;
        let mut log = Self {
            file,
            path,
            start: Instant::now(),
            announced,
            resumed: earlier.taken.len(),
            trained: 0,
            held_out: 0,
            dropped: earlier.dropped.clone(),
            refused: earlier.refused.clone(),
            latencies: Vec::new(),
            latest_s: 0.0,
            done_s: None,
            depth: DepthSources::default(),
            warned_at: BEHIND,
        };
        let unix_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
        let mut begin = json!({ "event": "begin", "unix_s": unix_s, "announced": announced });
        if log.resumed > 0 {
            begin["resumed"] = json!(log.resumed);
        }
        log.line(&begin)?;
        Ok(log)
    }

    fn line(&mut self, value: &serde_json::Value) -> Result<()> {
        writeln!(self.file, "{value}").with_context(|| format!("cannot write {}", self.path.display()))
    }

    fn since_start(&self, at: Instant) -> f64 {
        at.saturating_duration_since(self.start).as_secs_f64()
    }

    pub fn trained(&mut self, t: &Trained<'_>) -> Result<()> {
        let KeyframeTiming { index, wait_s, prepare_s, match_s, match_device_s, expand_s, train_s, late_s, .. } = *t.timing;
        let (arrived_s, latency_s) = (self.since_start(t.arrived), t.timing.total_s());
        self.trained += 1;
        let done_s = arrived_s + latency_s;
        let others_s = (self.latest_s - arrived_s).clamp(0.0, wait_s);
        self.latest_s = done_s;
        if !t.resumed {
            self.latencies.push(KeyframeLatency { index, parts_s: [others_s, wait_s - others_s, expand_s, train_s + late_s] });
            self.done_s = Some([self.done_s.map_or(done_s, |d| d[0]), done_s]);
        }
        match t.depth {
            "file" => self.depth.files += 1,
            "network" => self.depth.network += 1,
            _ => self.depth.matching += 1,
        }
        let of = self.announced.map_or(String::new(), |n| format!("/{n}"));
        note!(
            "keyframe {} ({}{of}): {:.0} ms from arrival (waited {:.0} for others, {:.0} for preparation, expanded {:.0}, trained {:.0}), queue {}, \
             {} Gaussians, depth: {}",
            t.number,
            index + 1,
            1e3 * latency_s,
            1e3 * others_s,
            1e3 * (wait_s - others_s),
            1e3 * expand_s,
            1e3 * (train_s + late_s),
            t.queue,
            t.gaussians,
            t.depth
        );
        self.line(&json!({
            "event": "trained",
            "number": t.number,
            "index": index,
            "arrived_s": arrived_s,
            "began_s": arrived_s + wait_s,
            "done_s": done_s,
            "latency_ms": 1e3 * latency_s,
            "waited_for_others_ms": 1e3 * others_s,
            "prepare_ms": 1e3 * prepare_s,
            "match_ms": 1e3 * match_s,
            "match_device_ms": 1e3 * match_device_s,
            "expand_ms": 1e3 * expand_s,
            "train_ms": 1e3 * (train_s + late_s),
            "queue": t.queue,
            "gaussians": t.gaussians,
            "depth": t.depth,
            "resumed": t.resumed,
        }))
    }

    /// Says that something keeps keyframes from coming, or no longer does.
    pub fn trouble(&mut self, what: &str, at: Instant) -> Result<()> {
        let at_s = self.since_start(at);
        note!("{what}");
        self.line(&json!({ "event": "trouble", "what": what, "at_s": at_s }))
    }

    pub fn held_out(&mut self, number: u64, index: usize, arrived: Instant) -> Result<()> {
        self.held_out += 1;
        let arrived_s = self.since_start(arrived);
        note!("keyframe {number} ({}): held out", index + 1);
        self.line(&json!({ "event": "held-out", "number": number, "index": index, "arrived_s": arrived_s }))
    }

    pub fn refused(&mut self, file: &str, number: Option<u64>, reason: &str, at: Instant) -> Result<()> {
        self.refused.push([file.to_owned(), reason.to_owned()]);
        let at_s = self.since_start(at);
        note!("REFUSED {file}: {reason}");
        self.line(&json!({ "event": "refused", "file": file, "number": number, "reason": reason, "at_s": at_s }))
    }

    /// Tells of a notice; returns the reason of a refusal.
    pub fn notice(&mut self, notice: &Notice) -> Result<Option<String>> {
        match notice {
            Notice::Refused { file, number, reason, at } => {
                self.refused(file, *number, reason, *at)?;
                Ok(Some(format!("{file}: {reason}")))
            }
            Notice::Trouble { what, at } => {
                self.trouble(what, *at)?;
                Ok(None)
            }
            Notice::Dropped { number, arrived } => {
                self.dropped.push(*number);
                let arrived_s = self.since_start(*arrived);
                note!("DROPPED keyframe {number}: a later one came before its turn");
                self.line(&json!({ "event": "dropped", "number": number, "arrived_s": arrived_s }))?;
                Ok(None)
            }
        }
    }

    /// Says that the device is behind, where it is.
    pub fn watch(&mut self, queue: usize) -> Result<()> {
        if queue < self.warned_at {
            return Ok(());
        }
        self.warned_at = 2 * queue;
        note!(
            "BEHIND: {} {}; they come faster than this device takes them",
            counted(queue, "keyframe"),
            verb(queue, "waits", "wait")
        );
        self.line(&json!({ "event": "behind", "queue": queue, "at_s": self.start.elapsed().as_secs_f64() }))
    }

    /// Ends the lines, sums them up and draws them.
    pub fn finish(
        mut self,
        folder: &Path,
        policy: WhenBehind,
        ended_by: EndedBy,
        tally: &Tally,
        collected: usize,
        timings: &[KeyframeTiming],
    ) -> Result<LiveRecord> {
        self.line(&json!({ "event": "end", "by": ended_by, "at_s": self.start.elapsed().as_secs_f64() }))?;
        let rate = |(first, last): (Instant, Instant)| {
            let seconds = last.saturating_duration_since(first).as_secs_f64();
            (seconds > 0.0).then(|| (tally.seen_now - 1) as f64 / seconds)
        };
        let name = folder.file_name().map_or_else(|| folder.display().to_string(), |name| name.display().to_string());
        if let Some(svg) = charts::latency(&format!("latency of the keyframes of {name}"), &self.latencies)? {
            write_atomic(self.path.with_file_name(FIGURE), svg.as_bytes())?;
        }
        let of = |part: fn(&KeyframeLatency) -> f64| Percentiles::of(self.latencies.iter().map(part));
        Ok(LiveRecord {
            folder: std::path::absolute(folder)?,
            when_behind: policy,
            ended_by,
            announced: self.announced,
            arrived: tally.arrived,
            resumed: self.resumed,
            trained: self.trained,
            held_out: self.held_out,
            fell_behind: !self.dropped.is_empty() || tally.longest_queue > collected,
            dropped: self.dropped,
            refused: self.refused,
            longest_queue: tally.longest_queue,
            arrivals_per_second: tally.first_and_last.and_then(rate),
            taken_per_second: self.done_s.filter(|d| d[1] > d[0]).map(|d| (self.latencies.len() - 1) as f64 / (d[1] - d[0])),
            capacity_per_second: LatencySummary::of(timings).map(|l| l.keyframes_per_second),
            latency: of(KeyframeLatency::total_s),
            waited_for_others: of(|keyframe| keyframe.parts_s[0]),
            waited_for_preparation: of(|keyframe| keyframe.parts_s[1]),
            depth: self.depth,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_fell_behind_says_what_was_too_slow() {
        let summary = |fell_behind: bool, others_s: f64, preparation_s: f64| {
            let waits = |s: f64| json!({ "median_s": s, "p90_s": s, "p99_s": 2.0 * s });
            let record: LiveRecord = serde_json::from_value(json!({
                "folder": "live", "when_behind": "queue", "ended_by": "marker", "arrived": 5, "trained": 5, "held_out": 0,
                "dropped": [], "refused": [], "longest_queue": 5, "latency": waits(0.5), "waited_for_others": waits(others_s),
                "waited_for_preparation": waits(preparation_s), "fell_behind": fell_behind,
                "depth": { "files": 0, "network": 0, "matching": 5 },
            }))
            .unwrap();
            record.summary()
        };
        let (training, preparation) = ("expansion and training are too slow", "reading and preparation are too slow");
        let text = summary(true, 0.25, 0.125);
        assert!(text.contains("median 500 ms, P90 500 ms, P99 1000 ms") && text.contains(training), "{text}");
        assert!(text.contains("waited 250 and 500 ms for keyframes before them, 125 and 250 ms for being read"), "{text}");
        assert!(summary(true, 0.1, 0.2).contains(preparation));
        let kept_up = summary(false, 0.25, 0.125);
        assert!(!kept_up.contains(training) && !kept_up.contains(preparation), "{kept_up}");
    }
}
