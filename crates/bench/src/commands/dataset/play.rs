//! `corf dataset play`: a data set as if it were being captured.

use super::super::{Verdict, show};
use crate::files::output::is_leftover;
use crate::files::separation::{Reads, keep_apart};
use crate::note;
use crate::run::claim_shared;
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use corf_scene::dataset::{Dataset, stem};
use corf_scene::io::{encode_cut_out, read, read_png, write_atomic};
use corf_scene::live::{DEPTH, DESCRIPTION, END, IMAGES, LiveDescription, POSES, SPECTRA, pose_text};
use corf_scene::words::counted;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Longest sleep without a look at whether somebody interrupts.
const LOOK: Duration = Duration::from_millis(50);
/// Lateness from which on it is said that the rate was not kept, seconds.
const LATE_S: f64 = 0.1;

/// `corf dataset play`.
#[derive(Args)]
pub struct Play {
    /// Dataset folder, with images and spectra.
    dataset: PathBuf,
    /// Live folder to write into: new or empty, or one in which the same command has not come to its end; it goes on there.
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    /// Keyframes per second.
    #[arg(long, default_value_t = 10.0)]
    rate: f64,
    /// Keyframes to play, from the first; all if not given.
    #[arg(long, value_name = "N")]
    keyframes: Option<usize>,
    /// Play the depth of the keyframes as well, as a depth sensor would give it; it is the ray tracer's in a generated dataset.
    #[arg(long)]
    depth: bool,
}

impl Play {
    /// Runs the command.
    ///
    /// # Errors
    /// A dataset that cannot be read or lacks what is to be played, an occupied folder, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        ensure!(
            (1e-3..=1e4).contains(&self.rate),
            "--rate {} is no rate\n  help: give keyframes per second, 0.001 to 10000",
            self.rate
        );
        keep_apart("--to", &self.to, &[Reads::Folder(&self.dataset)])?;
        let dataset = Dataset::open(&self.dataset)?;
        ensure!(!self.depth || dataset.has_depth(), "{} has no depth to play\n  help: leave --depth out", self.dataset.display());
        let count = self.keyframes.unwrap_or(dataset.len());
        ensure!(
            (1..=dataset.len()).contains(&count),
            "--keyframes {count}: the dataset has {}\n  help: give a number from 1 to that",
            dataset.len()
        );
        let description = LiveDescription { keyframes: Some(count), ..LiveDescription::of(&dataset, self.depth)? };
        let _held = claim_shared(&self.to)?;
        let description = description.to_toml()?;
        let done = self.played(&dataset, &description, count)?;
        if done > 0 {
            note!("{done} of {count} keyframes are there; going on behind them");
        }
        if dataset.has_masks() {
            note!("what masks leave out is played as transparent pixels");
        }
        for folder in [POSES, IMAGES, SPECTRA].into_iter().chain(self.depth.then_some(DEPTH)) {
            let path = self.to.join(folder);
            std::fs::create_dir_all(&path).with_context(|| format!("cannot create {}", path.display()))?;
        }
        write_atomic(self.to.join(DESCRIPTION), description.as_bytes())?;
        let mut progress = Progress::start(format!("playing {}", self.dataset.display()), count, "keyframes");
        let (begin, mut latest_s) = (Instant::now(), 0.0_f64);
        for index in done..count {
            let due = Duration::from_secs_f64((index - done) as f64 / self.rate);
            while let Some(left) = due.checked_sub(begin.elapsed()).filter(|d| !d.is_zero()) {
                interrupt::check()?;
                std::thread::sleep(left.min(LOOK));
            }
            interrupt::check()?;
            self.put(&dataset, index)?;
            latest_s = latest_s.max((begin.elapsed().saturating_sub(due)).as_secs_f64());
            progress.set(index + 1, count);
        }
        write_atomic(self.to.join(END), b"")?;
        progress.finish();
        if latest_s > LATE_S {
            note!("the rate was not kept: a keyframe landed {latest_s:.2} s late");
        }
        let seconds = begin.elapsed().as_secs_f64();
        show(
            json,
            &serde_json::json!({ "keyframes": count, "seconds": seconds, "latest_s": latest_s, "to": self.to }),
            &format!("{} in {seconds:.1} s into {}", counted(count, "keyframe"), self.to.display()),
        )?;
        Ok(Verdict::Done)
    }

    /// Keyframes that are there already, of a playing of the same that did not come to its end: nothing else may be there.
    fn played(&self, dataset: &Dataset, description: &str, count: usize) -> Result<usize> {
        let names = |folder: &str| -> Vec<String> {
            let entries = std::fs::read_dir(self.to.join(folder)).into_iter().flatten().flatten();
            let names = entries.map(|entry| entry.file_name()).filter(|name| !is_leftover(name));
            names.map(|name| name.to_string_lossy().into_owned()).collect()
        };
        let occupied = || -> Result<usize> {
            bail!(
                "output folder {} exists and is not empty\n  help: choose another --to; the command that began to play there goes on with it",
                self.to.display()
            )
        };
        let known = [DESCRIPTION, POSES, IMAGES, SPECTRA, DEPTH];
        let there = names("");
        if there.iter().any(|name| !known.contains(&name.as_str())) {
            return occupied();
        }
        let begun = there.iter().any(|name| name == DESCRIPTION);
        if begun && !read(self.to.join(DESCRIPTION)).is_ok_and(|bytes| bytes == description.as_bytes()) {
            return occupied();
        }
        let mut done = 0;
        while done < count
            && read(self.pose_file(done)).is_ok_and(|bytes| pose_of(dataset, done).is_ok_and(|text| bytes == text.as_bytes()))
        {
            done += 1;
        }
        // The files of the next one may be there, in part.
        let most = if begun { done + 1 } else { 0 };
        let stems: Vec<String> = (0..most.min(count)).map(stem).collect();
        for folder in [POSES, IMAGES, SPECTRA, DEPTH] {
            let is_ours = |name: &String| name.split_once('.').is_some_and(|(of, _)| stems.iter().any(|stem| stem == of));
            let names = names(folder);
            if !names.iter().all(is_ours) || folder == POSES && names.len() != done {
                return occupied();
            }
        }
        Ok(done)
    }

    fn pose_file(&self, index: usize) -> PathBuf {
        self.to.join(POSES).join(format!("{}.json", stem(index)))
    }

    /// One keyframe: the pose last.
    fn put(&self, dataset: &Dataset, index: usize) -> Result<()> {
        let stem = stem(index);
        let [image, spectrum, depth] = dataset.files_of(index)?;
        for (folder, source, wanted) in [(IMAGES, image, true), (SPECTRA, spectrum, true), (DEPTH, depth, self.depth)] {
            let Some(source) = source.filter(|_| wanted) else { continue };
            let ending = source.extension().and_then(|e| e.to_str()).unwrap_or("");
            let bytes = match dataset.mask_of(index)?.filter(|_| folder == IMAGES) {
                Some(mask) => encode_cut_out(&read_png(&source)?, &mask)?,
                None => read(&source)?,
            };
            write_atomic(self.to.join(folder).join(format!("{stem}.{ending}")), &bytes)?;
        }
        Ok(write_atomic(self.pose_file(index), pose_of(dataset, index)?.as_bytes())?)
    }
}

/// The pose file of a keyframe.
fn pose_of(dataset: &Dataset, index: usize) -> Result<String> {
    let pose = &dataset.poses()[index];
    Ok(pose_text(&pose.world_from_camera, Some(pose.time_s))?)
}
