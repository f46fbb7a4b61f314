//! `corf reconstruct --follow`: a live folder to a field on disk.

use crate::device::Backend;
use crate::harness;
use crate::live::{Session, SessionOptions, WhenBehind};
use crate::method::Method as _;
use crate::methods::corf_gs::{CorfGs, live_overrides};
use crate::run::{RunInfo, claim_fresh, write_config, write_info};
use crate::split::Protocol;
use crate::{interrupt, note};
use anyhow::{Result, ensure};
use corf_scene::live::{DESCRIPTION, LiveDescription};
use std::path::Path;
use std::time::Duration;

/// Pause between looks for a description that has not landed.
const POLL: Duration = Duration::from_millis(50);

/// A live run to be done.
pub(super) struct Follow<'a> {
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
    /// A method that does not take keyframes one by one, an occupied output folder, a description or a choice that cannot be used, a refused
    /// keyframe of a strict run, too few keyframes.
    pub fn run(self) -> Result<RunInfo> {
        let Self { folder, out, .. } = self;
        ensure!(
            self.method.starts_with("corf-gs"),
            "{} trains on all keyframes at once, and a live folder brings one after the other\n  help: choose corf-gs, or another method whose name \
             begins so; or follow first and train on RUN/dataset then",
            self.method
        );
        ensure!(
            !self.overrides.contains_key("initial_gaussians"),
            "--follow begins with nothing, and --from names Gaussians\n  help: follow first, and reconstruct RUN/dataset with --from then"
        );
        // A key that does not exist, and a folder that is occupied, are known before anybody waits.
        CorfGs::new(self.method, &self.overrides, &self.backend)?;
        let _held = claim_fresh(out)?;
        let description = described(folder)?;
        let overrides = live_overrides(&self.overrides, &description)?;
        let method = CorfGs::new(self.method, &overrides, &self.backend)?;
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
        interrupt::say_what_is_kept("nothing is kept of it to go on from; the live folder has what landed there");
        interrupt::let_first_end_input(true);
        note!("following {}: {} on {}", folder.display(), self.method, method.device());
        session.wait_for_first()?;
        let work = harness::clocked(|advance| method.follow(&mut session, self.seed, advance), &|| Duration::ZERO, &mut |_| {
            interrupt::check()
        });
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
        Ok(info)
    }
}

/// The description of a live folder, waited for if it has not landed.
fn described(folder: &Path) -> Result<LiveDescription> {
    let path = folder.join(DESCRIPTION);
    if !path.exists() {
        note!("waiting for {}", path.display());
    }
    while !path.exists() {
        interrupt::check()?;
        std::thread::sleep(POLL);
    }
    Ok(LiveDescription::read(folder)?)
}
