//! `corf reconstruct --follow`: a live folder to a field on disk.

use crate::device::Backend;
use crate::files::json::{read_json, write_json};
use crate::live::{DATASET, Session, SessionOptions, WhenBehind};
use crate::methods;
use crate::methods::corf_gs::{CorfGs, live_overrides};
use crate::methods::interface::Method as _;
use crate::note;
use crate::run::harness;
use crate::run::{RunInfo, claim_begun, write_config, write_info};
use crate::split::Protocol;
use crate::terminal::interrupt;
use anyhow::{Context, Result, ensure};
use corf_scene::dataset::forget_progress;
use corf_scene::live::{DESCRIPTION, LiveDescription};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Pause between looks for a description that has not landed.
const POLL: Duration = Duration::from_millis(50);

/// File in the run folder of a live run that is not finished.
const UNFINISHED: &str = "unfinished.json";
/// Version of [`UNFINISHED`].
const UNFINISHED_SCHEMA: &str = "corf-live-run/1";

/// `unfinished.json`: what a live run was begun with. Where it is there, the same command goes on with what was recorded.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Begun {
    schema: String,
    /// The live folder, absolute.
    folder: PathBuf,
    method: String,
    /// Resolved configuration.
    config: serde_json::Value,
    seed: u64,
    protocol: Protocol,
    /// `capture.toml`.
    description: LiveDescription,
}

/// A live run to be done.
pub(in crate::commands) struct Follow<'a> {
    pub folder: &'a Path,
    pub out: &'a Path,
    pub method: &'a str,
    pub overrides: toml::Table,
    pub seed: u64,
    pub protocol: Protocol,
    pub when_behind: WhenBehind,
    pub strict: bool,
    pub backend: Backend,
}

impl Follow<'_> {
    /// Follows the folder to its end, and writes the run.
    ///
    /// # Errors
    /// A method that does not take keyframes one by one, an occupied output folder, or one with an unfinished run of another command; a description
    /// or a choice that cannot be used, a refused keyframe of a strict run, too few keyframes.
    pub fn run(self) -> Result<RunInfo> {
        let Self { folder, out, .. } = self;
        ensure!(
            methods::abilities(self.method).follows,
            "{} trains on all keyframes at once, and a live folder brings one after the other\n  help: choose {}; or \
             follow first and train on RUN/dataset then",
            self.method,
            methods::registry::that(|can| can.follows)
        );
        ensure!(
            !self.overrides.contains_key("initial_gaussians"),
            "--follow begins with nothing, and --from names Gaussians\n  help: follow first, and reconstruct RUN/dataset with --from then"
        );
        // A key that does not exist, and a folder that is occupied, are known before anybody waits.
        methods::create(self.method, &self.overrides, &self.backend)?;
        ensure!(
            folder.is_dir() || folder.symlink_metadata().is_err(),
            "{} is no folder, or a link that leads to none\n  help: name the live folder, which may be made later",
            folder.display()
        );
        let _held = claim_begun(out, UNFINISHED)?;
        let begun_path = out.join(UNFINISHED);
        let before: Option<Begun> = begun_path.is_file().then(|| read_json(&begun_path)).transpose()?;
        let description = match &before {
            // What was recorded is worth as much where the live folder is gone.
            Some(before) if folder.join(DESCRIPTION).symlink_metadata().is_err() => before.description.clone(),
            _ => described(folder)?,
        };
        Session::check(&description, self.protocol)?;
        let overrides = live_overrides(&self.overrides, &description)?;
        let method = CorfGs::new(self.method, &methods::registry::settings(self.method, &overrides)?, &self.backend)?;
        methods::registry::check_given(&method, &self.overrides, None)?;
        method.check_description(&description)?;
        // A device that cannot be opened is known before the first file.
        let device = method.open_device()?;
        let begun = Begun {
            schema: UNFINISHED_SCHEMA.to_owned(),
            folder: std::path::absolute(folder)?,
            method: self.method.to_owned(),
            config: method.config(),
            seed: self.seed,
            protocol: self.protocol,
            description: description.clone(),
        };
        match &before {
            None => write_json(&begun_path, &begun)?,
            Some(before) => ensure!(
                *before == begun,
                "{} holds an unfinished run of another live folder, capture.toml, method, configuration, seed or protocol\n  help: give the command \
                 that began it, or choose another --out",
                out.display()
            ),
        }
        let info_path = out.join("run.json");
        if info_path.exists() {
            // Killed between its last file and the end.
            let info: RunInfo = read_json(&info_path)?;
            forget_begun(out)?;
            note!("{} is finished already", out.display());
            return Ok(info);
        }
        if before.is_some() {
            note!("going on with the unfinished run in {}", out.display());
        }
        let mut session = Session::open(SessionOptions {
            folder,
            run: out,
            description: &description,
            protocol: self.protocol,
            when_behind: self.when_behind,
            strict: self.strict,
            collected: method.collected(),
        })?;
        write_config(out, &method.config())?;
        interrupt::print_what_is_kept("the keyframes that were recorded are kept; the same command goes on behind them");
        interrupt::let_first_end_input(true);
        note!("following {}: {} on {}", folder.display(), self.method, method.device());
        session.wait_for_first()?;
        let work = harness::clocked(
            |advance| method.follow(device, &mut session, self.seed, advance),
            &|| Duration::ZERO,
            None,
            &mut |_| interrupt::check(),
        );
        interrupt::let_first_end_input(false);
        let result = work?;
        // First: what is reconstructed stays, whatever becomes of the data set.
        result.predictor.save(out)?;
        let (dataset, live) = session.finish()?;
        // Each file was written, and its hash taken, from what was trained on.
        let source = (&dataset, true);
        let trained = (self.protocol, result.keyframes.len());
        let info = RunInfo { live: Some(live), ..RunInfo::of(&method, &overrides, self.seed, source, trained, &result)? };
        write_info(out, &info)?;
        interrupt::kept(|| format!("{} is finished", out.display()));
        forget_begun(out)?;
        Ok(info)
    }
}

/// Removes what an unfinished run is gone on with: it is finished.
fn forget_begun(out: &Path) -> Result<()> {
    forget_progress(&out.join(DATASET))?;
    let path = out.join(UNFINISHED);
    std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))
}

/// The description of a live folder, waited for if it has not landed.
fn described(folder: &Path) -> Result<LiveDescription> {
    let path = folder.join(DESCRIPTION);
    // A link that leads nowhere is there, and would be waited for without end.
    let has_landed = || path.symlink_metadata().is_ok();
    if !has_landed() {
        note!("waiting for {}", path.display());
    }
    while !has_landed() {
        interrupt::check()?;
        std::thread::sleep(POLL);
    }
    ensure!(
        path.exists(),
        "{} is a symbolic link that leads nowhere\n  help: put the file itself there: write it under another name, and rename it",
        path.display()
    );
    Ok(LiveDescription::read(folder)?)
}
