//! Keyframes from a live folder through a reconstructor, each as soon as it is there.

use super::{CorfGs, Relay};
use crate::live::{Receipt, Session, Taken};
use crate::methods::interface::{Advance, FieldReader, Predictor, shown};
use crate::terminal::interrupt;
use anyhow::{Result, bail};
use corf::config::DepthPriorKind;
use corf::{Device, Reconstructor};
use corf_scene::live::LiveDescription;
use std::cell::RefCell;

/// The overrides of a live run: the user's, and what follows from nothing being known in advance. A prior that is not chosen is the
/// keyframes' own depth, where the description announces some, and matching alone elsewhere. No steps are left for the next
/// keyframe's expansion, since nobody knows when it comes.
///
/// # Errors
/// A choice that needs what is not there: maps in a folder, depth that is not announced, overlapped steps.
pub fn live_overrides(overrides: &toml::Table, description: &LiveDescription) -> Result<toml::Table> {
    let mut table = overrides.clone();
    let depth = table.entry("depth").or_insert_with(|| toml::Value::Table(toml::Table::new()));
    let Some(depth) = depth.as_table_mut() else { bail!("the key depth is a table, e.g. --set depth.prior=none") };
    let prior = depth.get("prior").and_then(|p| p.as_str()).map(str::to_owned);
    match prior.as_deref() {
        None if !depth.contains_key("prior") => {
            let prior = if description.depth { "measured" } else { "none" };
            depth.insert("prior".to_owned(), toml::Value::String(prior.to_owned()));
        }
        Some("folder") => bail!(
            "depth.prior = \"folder\" reads maps named by the keyframes of a data set, which do not exist yet\n  help: put metric depth into the \
             live folder's depth/ and say depth = true in capture.toml, or choose \"depth-anything\" or \"none\""
        ),
        Some(prior @ ("simulated" | "exact" | "measured")) if !description.depth => bail!(
            "depth.prior = \"{prior}\" needs the depth of keyframes, and capture.toml announces none\n  help: put depth maps into depth/ and say \
             depth = true there, or leave the key out"
        ),
        _ => {}
    }
    match table.get("overlapped_iterations").and_then(toml::Value::as_integer) {
        Some(steps) if steps > 0 => bail!(
            "overlapped_iterations = {steps} leaves steps until the next keyframe comes, and of a live one nobody knows when\n  help: leave the key \
             out"
        ),
        _ => table.insert("overlapped_iterations".to_owned(), toml::Value::Integer(0)),
    };
    Ok(table)
}

impl CorfGs {
    /// Checks that keyframes as a description has them can be reconstructed.
    ///
    /// # Errors
    /// Those of [`Reconstructor::check_cameras`].
    pub fn check_description(&self, description: &LiveDescription) -> Result<()> {
        let LiveDescription { light_camera, radio_camera, .. } = description;
        Ok(Reconstructor::check_cameras(&self.config.reconstruction, light_camera, radio_camera)?)
    }

    /// Number of first keyframes that are collected before any is expanded.
    pub fn collected(&self) -> usize {
        self.config.reconstruction.bootstrap_keyframes
    }

    /// The device that such a run begins with.
    ///
    /// # Errors
    /// It cannot be opened.
    pub fn open_device(&self) -> Result<Box<dyn Device>> {
        self.config.device(&self.backend)
    }

    /// Reconstructs from a live folder until it ends. What is known of a keyframe is what came before it and the description.
    ///
    /// # Errors
    /// A device that gives up, a session that ends with an error, too few keyframes, or what `advance` answers.
    pub fn follow(
        &self,
        device: Box<dyn Device>,
        session: &mut Session,
        seed: u64,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>> {
        let description = session.description();
        let (light, radio, range) = (description.light_camera, description.radio_camera, description.db_range);
        let mut live = Live {
            reconstructor: Reconstructor::new(device, self.config.reconstruction.clone(), light, radio, range, seed)?,
            prior: self.config.reconstruction.depth.prior,
            announced: description.keyframes.unwrap_or(0),
            reported: 0,
            received: 0,
        };
        loop {
            live.receive(session)?;
            // While a keyframe is prepared, those that land can be as well.
            let has_room = live.reconstructor.waiting() < live.worth_receiving(session);
            if live.reconstructor.waiting() > 0 && has_room && !session.is_over() && !live.reconstructor.is_ready() {
                session.wait_briefly()?;
                continue;
            }
            if live.reconstructor.waiting() > 0 {
                session.begin();
            }
            if live.reconstructor.process()?.is_some() {
                live.report(session, advance)?;
            } else if session.is_over() {
                break;
            } else {
                session.wait()?;
            }
        }
        interrupt::let_first_end_input(false);
        anyhow::ensure!(
            live.received >= 2,
            "only {} came before the end to train with, and at least 2 are needed\n  help: live.jsonl in the run folder says what became of each",
            ["no keyframe", "1 keyframe"][live.received]
        );
        // Fewer than are collected at the beginning wait until the end; the rest has ended.
        if live.reported < live.received {
            let mut relay = Relay { advance, failure: None };
            let ended = live.reconstructor.finish(&mut |done, of| relay.report(done, of));
            relay.settle(ended)?;
            live.report(session, advance)?;
        }
        let Live { reconstructor, reported, received, .. } = live;
        self.conclude(reconstructor, received, reported, &|error| error, advance)
    }
}

/// A live reconstruction.
struct Live {
    reconstructor: Reconstructor,
    prior: DepthPriorKind,
    /// Keyframes that were announced, 0 if nobody did.
    announced: usize,
    /// Keyframes of which session and harness have been told.
    reported: usize,
    received: usize,
}

impl Live {
    /// Most keyframes that wait here: where later ones take the place of those that wait, one alone.
    fn worth_receiving(&self, session: &Session) -> usize {
        if session.drops() { 1 } else { self.reconstructor.worth_receiving() }
    }

    /// Takes what is there, as far as it is worth it.
    fn receive(&mut self, session: &mut Session) -> Result<()> {
        let most = self.worth_receiving(session);
        while self.reconstructor.waiting() < most {
            let Some(Taken { keyframe, arrived, receipt }) = session.take()? else { break };
            match self.reconstructor.receive_at(keyframe, arrived) {
                Ok(()) => {
                    let depth = self.depth_source(&receipt);
                    session.accept(receipt, depth)?;
                    self.received += 1;
                }
                Err(error) => session.refuse(&receipt, &error.to_string())?,
            }
        }
        Ok(())
    }

    /// Where the depths of a keyframe come from.
    fn depth_source(&self, receipt: &Receipt) -> &'static str {
        match self.prior {
            DepthPriorKind::DepthAnything => "network",
            DepthPriorKind::Simulated | DepthPriorKind::Exact | DepthPriorKind::Measured if receipt.has_depth() => "file",
            _ => "matching",
        }
    }

    /// Tells of all keyframes whose training has ended.
    fn report(&mut self, session: &mut Session, advance: &mut dyn FnMut(Advance<'_>) -> Result<()>) -> Result<()> {
        let gaussians = self.reconstructor.gaussian_count();
        while let Some(timing) = self.reconstructor.timings().get(self.reported).copied() {
            self.reported += 1;
            session.trained(&timing, gaussians)?;
            let total = self.announced.max(self.received);
            let reconstructor = RefCell::new(&mut self.reconstructor);
            let read = || shown(reconstructor.borrow_mut().field());
            let field = Some(FieldReader::new(&read));
            advance(Advance { gaussians: Some(gaussians), keyframe: Some(&timing), field, ..Advance::of(self.reported, total) })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn described(depth: bool) -> LiveDescription {
        let text = format!(
            "schema = \"corf-live/1\"\nname = \"t\"\ndepth = {depth}\ndb_range = {{ min_db = -90.0, max_db = -20.0 }}\n\
             optical_camera = {{ width = 64, height = 48, fx = 32.0, fy = 32.0, cx = 32.0, cy = 24.0 }}\n\
             rf_camera = {{ width = 64, height = 48, fx = 32.0, fy = 32.0, cx = 32.0, cy = 24.0 }}\n"
        );
        toml::from_str(&text).unwrap()
    }

    #[test]
    fn what_cannot_be_known_in_advance_is_settled_or_refused() {
        let of = |text: &str, depth: bool| live_overrides(&text.parse().unwrap(), &described(depth));
        let prior = |table: toml::Table| table["depth"]["prior"].as_str().map(str::to_owned).unwrap();
        let table = of("rf_weight = 0.2", false).unwrap();
        assert_eq!((table["overlapped_iterations"].as_integer(), table["rf_weight"].as_float()), (Some(0), Some(0.2)));
        assert_eq!(prior(table), "none");
        assert_eq!(prior(of("depth.corners = 300", true).unwrap()), "measured");
        assert_eq!(prior(of("depth.prior = \"simulated\"", true).unwrap()), "simulated");
        for (text, word) in [
            ("depth.prior = \"simulated\"", "capture.toml announces none"),
            ("depth.prior = \"folder\"\ndepth.folder = \"maps\"", "do not exist yet"),
            ("overlapped_iterations = 40", "nobody knows"),
            ("depth = 3", "is a table"),
        ] {
            let error = of(text, false).unwrap_err().to_string();
            assert!(error.contains(word) && (error.contains("help") || text == "depth = 3"), "{text}: {error}");
        }
    }
}
