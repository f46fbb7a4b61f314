//! A live reconstruction's side of the folder: numbers keyframes as a data set does, holds some out, and keeps record.

use super::earlier::Earlier;
use super::inbox::{Arrival, Inbox};
use super::log::{LiveRecord, Log, Trained};
use super::outcome::WhenBehind;
use super::recorder::{Entry, Recorder, Recording};
use crate::note;
use crate::split::{Protocol, Role};
use crate::terminal::interrupt;
use anyhow::{Result, bail};
use corf::KeyframeTiming;
use corf_scene::dataset::{Dataset, Extras, KeyframeContent, grown_frame};
use corf_scene::live::{LiveDescription, LiveFrame};
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Keyframe, Rigid3, far};
use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Folder of the data set of what was taken, in the run folder.
pub const DATASET: &str = "dataset";
/// Longest time without a look at whether somebody interrupts.
const LOOK: Duration = Duration::from_millis(50);

/// Longest time without a look at whether a keyframe has been prepared.
const BRIEFLY: Duration = Duration::from_millis(2);

/// What a session needs to know.
pub struct SessionOptions<'a> {
    /// The live folder.
    pub folder: &'a Path,
    /// The run folder.
    pub run: &'a Path,
    /// Its `capture.toml`.
    pub description: &'a LiveDescription,
    /// Which keyframes are held out.
    pub protocol: Protocol,
    /// What happens to keyframes that come too fast.
    pub when_behind: WhenBehind,
    /// Whether a refused keyframe ends the run.
    pub strict: bool,
    /// Number of first keyframes that are collected before any is expanded.
    pub collected: usize,
}

/// Keyframes from a live folder.
pub struct Session {
    folder: PathBuf,
    description: LiveDescription,
    protocol: Protocol,
    /// Every so many keyframes one is for tests.
    test_every: usize,
    when_behind: WhenBehind,
    strict: bool,
    collected: usize,
    inbox: Inbox,
    log: Log,
    recorder: Recorder,
    /// The data set of what is taken.
    dataset: PathBuf,
    /// What an earlier session has recorded and this one has not taken yet: numbers, names and poses.
    recorded: VecDeque<(u64, String, TrajectoryPose)>,
    /// Index of the next keyframe.
    next: usize,
    /// Those accepted whose training has not ended.
    open: BTreeMap<usize, Open>,
    timings: Vec<KeyframeTiming>,
    /// Whether a keyframe too far from the origin was told.
    far: bool,
    /// Whether it was said that poses are rounded, and that images have transparent pixels.
    said: [bool; 2],
}

/// A keyframe that was accepted and is not trained yet.
struct Open {
    number: u64,
    arrived: Instant,
    depth: &'static str,
    resumed: bool,
}

/// A keyframe to train with.
pub struct Taken {
    /// It.
    pub keyframe: Keyframe,
    /// When it landed.
    pub arrived: Instant,
    /// What [`Session::accept`] or [`Session::refuse`] must be given.
    pub receipt: Receipt,
}

/// A keyframe's other half, until it is known whether it was accepted.
pub struct Receipt {
    number: u64,
    arrived: Instant,
    entry: Entry,
    /// Whether it is on record already.
    resumed: bool,
}

impl Receipt {
    /// Whether a depth file came with it.
    pub fn has_depth(&self) -> bool {
        self.entry.frame.light.as_ref().is_some_and(|light| light.depth_m.is_some())
    }
}

impl Session {
    /// Says what keeps a session from being opened that is known in advance.
    ///
    /// # Errors
    /// A protocol that needs the whole trajectory.
    pub fn check(description: &LiveDescription, protocol: Protocol) -> Result<()> {
        if protocol.spacing.get() > 1 {
            bail!(
                "the protocol {protocol} chooses training keyframes by all places of a trajectory, and those of a live one are not \
                 known\n  help: leave spacing out"
            );
        }
        if protocol.role(0, description.header().split.test_every).is_none() {
            bail!(
                "the {} protocol holds out what lies in the middle of a trajectory, and the end of a live one is not known\n  help: choose \
                 --protocol test, validation or all",
                protocol.name()
            );
        }
        Ok(())
    }

    /// Begins to look into a live folder. What an earlier, unfinished session of the run has recorded comes first.
    ///
    /// # Errors
    /// Those of [`Session::check`]; a run folder that cannot be read or written.
    pub fn open(options: SessionOptions<'_>) -> Result<Self> {
        let SessionOptions { folder, run, description, protocol, when_behind, strict, collected } = options;
        Self::check(description, protocol)?;
        let header = description.header();
        let test_every = header.split.test_every;
        let dataset = run.join(DATASET);
        let (recorder, recording) = Recorder::start(&dataset, header)?;
        let earlier = Earlier::read(run, &recording)?;
        let log = Log::open(run, description.keyframes, &earlier)?;
        let Recording { names, poses } = recording;
        let recorded = earlier.taken.iter().copied().zip(names).zip(poses).map(|((number, name), pose)| (number, name, pose));
        Ok(Self {
            dataset,
            recorded: recorded.collect(),
            folder: folder.to_owned(),
            description: description.clone(),
            protocol,
            test_every,
            when_behind,
            strict,
            collected,
            log,
            recorder,
            inbox: Inbox::open(folder, description, when_behind, collected, earlier)?,
            next: 0,
            far: false,
            open: BTreeMap::new(),
            timings: Vec::new(),
            said: [false; 2],
        })
    }

    /// The description of the capture.
    pub fn description(&self) -> &LiveDescription {
        &self.description
    }

    /// Whether only the latest keyframe waits.
    pub fn drops(&self) -> bool {
        self.when_behind == WhenBehind::Drop
    }

    /// The next keyframe to train with, if one is there.
    ///
    /// # Errors
    /// An interrupt; a refused keyframe of a strict session; a file that cannot be written.
    pub fn take(&mut self) -> Result<Option<Taken>> {
        loop {
            interrupt::check()?;
            if interrupt::input_ended() {
                self.inbox.stop();
            }
            self.report_notices()?;
            self.log.watch(self.inbox.queue())?;
            let resumed = !self.recorded.is_empty();
            let Some(Arrival { stem, frame, arrived }) = self.next_arrival()? else { return Ok(None) };
            let index = self.next;
            let LiveFrame { number, time_s, world_from_camera, rounded, light, radio, sources } = frame;
            self.report_far(&world_from_camera);
            self.report_once(&stem, rounded, light.mask.is_some());
            let pose = TrajectoryPose { index, time_s: time_s.unwrap_or(index as f64), world_from_camera };
            let kept = KeyframeContent { light: Some(light.clone()), radio: Some(radio.clone()), extras: Extras::default() };
            let receipt = Receipt { number, arrived, entry: Entry { name: stem, sources, pose, frame: kept }, resumed };
            if self.protocol.role(index, self.test_every) != Some(Role::Trains) {
                self.log.held_out(number, index, arrived)?;
                self.keep(receipt)?;
                continue;
            }
            let time_s = pose.time_s;
            let keyframe = Keyframe { index, time_s, world_from_camera, light: Some(light), radio: Some(radio) };
            return Ok(Some(Taken { keyframe, arrived, receipt }));
        }
    }

    /// Says of the first keyframe, and of no other, that its pose is rounded or that pixels of its image do not count.
    fn report_once(&mut self, stem: &str, rounded: Option<f64>, masked: bool) {
        if let Some(off) = rounded.filter(|_| !std::mem::replace(&mut self.said[0], true)) {
            note!(
                "poses/{stem}.json: its rotation is {off:.1e} off one, as numbers of few decimals are; the nearest is taken, here and in what follows"
            );
        }
        if masked && !std::mem::replace(&mut self.said[1], true) {
            note!("images/{stem}: transparent pixels are neither learnt from nor compared, here and in what follows");
        }
    }

    /// The next keyframe on record, or the next that has come.
    fn next_arrival(&mut self) -> Result<Option<Arrival>> {
        let Some((number, stem, pose)) = self.recorded.pop_front() else { return Ok(self.inbox.take()) };
        let arrived = Instant::now();
        let content = grown_frame(&self.dataset, pose.index)?;
        let (Some(light), Some(radio)) = (content.light, content.radio) else {
            bail!("{}: keyframe {} has no image or no spectrum", self.dataset.display(), pose.index)
        };
        let TrajectoryPose { time_s, world_from_camera, .. } = pose;
        let frame =
            LiveFrame { number, time_s: Some(time_s), world_from_camera, rounded: None, light, radio, sources: BTreeMap::new() };
        Ok(Some(Arrival { stem, frame, arrived }))
    }

    /// The keyframe was received; `depth` says where its depths come from: `file`, `network` or `matching`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn accept(&mut self, receipt: Receipt, depth: &'static str) -> Result<()> {
        let open = Open { number: receipt.number, arrived: receipt.arrived, depth, resumed: receipt.resumed };
        self.open.insert(self.next, open);
        self.inbox.set_in_hand(self.open.len());
        self.keep(receipt)
    }

    fn keep(&mut self, receipt: Receipt) -> Result<()> {
        self.next += 1;
        if receipt.resumed { Ok(()) } else { self.recorder.put(receipt.entry) }
    }

    /// The keyframe cannot be used after all; its index goes to the next one.
    ///
    /// # Errors
    /// The reason, in a strict session.
    pub fn refuse(&mut self, receipt: &Receipt, reason: &str) -> Result<()> {
        if receipt.resumed {
            bail!(
                "keyframe {} was taken by an earlier session and cannot be now: {reason}\n  help: choose another --out",
                receipt.number
            );
        }
        let file = format!("poses/{}.json", receipt.entry.name);
        self.log.refused(&file, Some(receipt.number), reason, Instant::now())?;
        self.refuse_strictly(Some(format!("{file}: {reason}")))
    }

    fn refuse_strictly(&self, reason: Option<String>) -> Result<()> {
        match reason.filter(|_| self.strict) {
            Some(reason) => bail!("{reason}\n  help: without --strict a keyframe is refused and the run goes on"),
            None => Ok(()),
        }
    }

    /// Warns once of a keyframe that was taken too far from the origin.
    fn report_far(&mut self, world_from_camera: &Rigid3) {
        let largest_m = far::largest_m(std::iter::once(world_from_camera.translation));
        let help = "let the capture program take a constant off all positions";
        let finding = far::finding(&self.folder.display().to_string(), "a keyframe was taken", largest_m, help);
        if let Some(finding) = finding.filter(|_| !std::mem::replace(&mut self.far, true)) {
            note!("{finding}");
        }
    }

    fn report_notices(&mut self) -> Result<()> {
        for notice in self.inbox.notices() {
            let refusal = self.log.notice(&notice)?;
            self.refuse_strictly(refusal)?;
        }
        Ok(())
    }

    /// The earliest of those accepted is worked on from now on.
    pub fn begin(&self) {
        self.inbox.set_in_hand(self.open.len().saturating_sub(1));
    }

    /// A keyframe's training has ended. It is told of once it and those before it are on the disk: what is said to be trained is gone on with
    /// after a kill.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn trained(&mut self, timing: &KeyframeTiming, gaussians: usize) -> Result<()> {
        self.timings.push(*timing);
        let Some(Open { number, arrived, depth, resumed }) = self.open.remove(&timing.index) else { return Ok(()) };
        self.inbox.set_in_hand(self.open.len());
        let queue = self.inbox.queue();
        self.recorder.wait_for(timing.index + 1)?;
        self.log.trained(&Trained { number, arrived, timing, gaussians, queue, depth, resumed })
    }

    /// Waits for the first keyframe, or for the end.
    ///
    /// # Errors
    /// An interrupt; the thread that looks into the folder is gone.
    pub fn wait_for_first(&mut self) -> Result<()> {
        while self.recorded.is_empty() && self.inbox.queue() == 0 && !self.is_over() {
            interrupt::check()?;
            if interrupt::input_ended() {
                self.inbox.stop();
            }
            self.report_notices()?;
            self.wait()?;
        }
        Ok(())
    }

    /// Whether nothing comes any more and all that came was taken.
    pub fn is_over(&self) -> bool {
        self.recorded.is_empty() && self.inbox.ended().is_some()
    }

    /// Waits a moment for a keyframe.
    ///
    /// # Errors
    /// The thread that looks into the folder is gone.
    pub fn wait(&self) -> Result<()> {
        self.inbox.wait(LOOK)
    }

    /// Waits for a keyframe no longer than somebody is kept from one that is prepared meanwhile.
    ///
    /// # Errors
    /// The thread that looks into the folder is gone.
    pub fn wait_briefly(&self) -> Result<()> {
        self.inbox.wait(BRIEFLY)
    }

    /// Finishes the data set of what was taken, and the record.
    ///
    /// # Errors
    /// The session is not over; no keyframe was taken; the data set cannot be finished.
    pub fn finish(mut self) -> Result<(Dataset, LiveRecord)> {
        self.report_notices()?;
        let Some(ended_by) = self.inbox.ended() else { bail!("the live folder has not ended") };
        let tally = self.inbox.tally();
        let record = self.log.finish(&self.folder, self.when_behind, ended_by, &tally, self.collected, &self.timings)?;
        Ok((self.recorder.finish()?, record))
    }
}
