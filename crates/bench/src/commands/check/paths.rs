//! `corf check paths`: chains of points of another program among the paths of this one.

use super::super::{Verdict, show};
use crate::files::escape::plain;
use crate::note;
use crate::radio_link::chains::{Chains, LinkOutcome, Tolerances, WhyMissing, compare};
use crate::radio_link::{LinkArgs, LinkSetup, PathArgs, ScatteringArgs};
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::Result;
use clap::Args;
use corf_raytrace::radio::DiffuseSettings;
use corf_scene::{Error, bounds};
use glam::DVec3;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Missing chains that the table names one by one.
const NAMED: usize = 20;

/// `corf check paths`.
#[derive(Args)]
pub struct Paths {
    /// Chains of points by link (JSON, schema corf-chains/1).
    file: PathBuf,
    /// Scene file (.toml); without it the one that FILE names.
    #[arg(long, value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
    /// Points no further apart than this are the same, metres.
    #[arg(long, value_name = "METRES", default_value_t = 1e-3)]
    tolerance: f64,
    /// A path within this of a chain, point by point, is that chain displaced, metres; what is further off is missing.
    #[arg(long, value_name = "METRES", default_value_t = 0.1)]
    displaced_within: f64,
    #[command(flatten)]
    paths: PathArgs,
}

/// The outcome over all links.
#[derive(Serialize)]
struct Report {
    schema: &'static str,
    scene: String,
    tolerances: Tolerances,
    chains: usize,
    found: usize,
    repeated: usize,
    displaced: usize,
    missing: usize,
    only_here: usize,
    worst_m: f64,
    passed: bool,
    links: Vec<LinkOutcome>,
}

impl Paths {
    /// Runs the command.
    ///
    /// # Errors
    /// A file that is no list of chains, a scene that cannot be traced, an end that is in a body.
    pub fn run(self, json: bool) -> Result<Verdict> {
        bounds::number("--tolerance", self.tolerance, &(1e-9..=1.0), "metres")?;
        bounds::number(
            "--displaced-within",
            self.displaced_within,
            &(self.tolerance..=10.0),
            "metres, not less than --tolerance",
        )?;
        let chains = Chains::read(&self.file)?;
        let own = chains.scene.as_ref().map(|scene| self.file.parent().unwrap_or_else(|| "".as_ref()).join(scene));
        let scene = self.scene.clone().or(own).ok_or_else(|| {
            Error::invalid(
                self.file.display().to_string(),
                "it names no scene",
                "give one with --scene SCENE.toml, or as its key `scene`",
            )
        })?;
        let arguments = LinkArgs {
            config: None,
            transmitter: vec![],
            paths: self.paths,
            diffuse: false,
            scattering: ScatteringArgs::default(),
            tx_power_dbm: None,
            seed: None,
        };
        let mut setup = LinkSetup::load(&scene, &arguments, None, None)?;
        let stated = |point: [f64; 3]| DVec3::from_array(point);
        let mut ends: Vec<DVec3> = Vec::new();
        for link in &chains.links {
            let tx = stated(link.tx);
            if !ends.contains(&tx) {
                ends.push(tx);
            }
        }
        setup.place_transmitter(ends.iter().copied())?;
        let mut receivers: Vec<DVec3> = chains.links.iter().map(|link| stated(link.rx)).collect();
        setup.mount(&mut receivers)?;
        let tolerances = Tolerances { found_m: self.tolerance, displaced_m: self.displaced_within };
        let reasons = WhyMissing {
            scene: &setup.scene,
            max_interactions: setup.link.max_interactions,
            transmission: setup.link.transmission,
        };
        let mut outcomes: Vec<(usize, LinkOutcome)> = Vec::new();
        let mut progress = Progress::start("links", chains.links.len(), "links");
        setup.each_transmitter(&DiffuseSettings::default(), |t, transmitter, _| {
            for (i, link) in chains.links.iter().enumerate().filter(|(_, link)| stated(link.tx) == ends[t]) {
                interrupt::check()?;
                setup.check_link(transmitter.position(), receivers[i])?;
                let paths = transmitter.paths(receivers[i])?;
                outcomes.push((i, compare(link, &paths, tolerances, &reasons)));
                progress.set(outcomes.len(), chains.links.len());
            }
            Ok(())
        })?;
        progress.finish();
        outcomes.sort_by_key(|(i, _)| *i);
        let report = Report::of(setup.scene.name.clone(), tolerances, outcomes.into_iter().map(|(_, outcome)| outcome).collect());
        if report.only_here > 0 {
            note!("{} paths are here alone: of what FILE does not list it cannot be said whether it is wrong", report.only_here);
        }
        let passed = report.passed;
        show(json, &report, &report.text())?;
        Ok(if passed { Verdict::Done } else { Verdict::CheckFailed })
    }
}

impl Report {
    fn of(scene: String, tolerances: Tolerances, links: Vec<LinkOutcome>) -> Self {
        let sum = |of: fn(&LinkOutcome) -> usize| links.iter().map(of).sum::<usize>();
        let (found, repeated) = (sum(|l| l.found), sum(|l| l.repeated));
        let (displaced, missing, only_here) = (sum(|l| l.displaced.len()), sum(|l| l.missing.len()), sum(|l| l.only_here.len()));
        Self {
            schema: "corf-chains-check/1",
            scene,
            tolerances,
            chains: found + repeated + displaced + missing,
            found,
            repeated,
            displaced,
            missing,
            only_here,
            worst_m: links.iter().map(|l| l.worst_m).fold(0.0, f64::max),
            passed: displaced + missing == 0,
            links,
        }
    }

    fn text(&self) -> String {
        let mut text = format!(
            "{}: {}\n  {:>8} {:>8} {:>9} {:>8} {:>8} {:>10} {:>10}\n  {:>8} {:>8} {:>9} {:>8} {:>8} {:>10} {:>10.1e}\n",
            plain(&self.scene),
            if self.passed { "pass" } else { "FAIL" },
            "chains",
            "found",
            "displaced",
            "missing",
            "repeats",
            "only here",
            "worst, m",
            self.chains,
            self.found,
            self.displaced,
            self.missing,
            self.repeated,
            self.only_here,
            self.worst_m
        );
        let named = |l: usize, link: &LinkOutcome| {
            let displaced =
                link.displaced.iter().map(move |d| format!("  link {l}, chain {}: displaced by {:.4} m", d.chain, d.by_m));
            let missing = link.missing.iter().map(move |m| format!("  link {l}, chain {}: missing: {}", m.chain, plain(&m.why)));
            displaced.chain(missing).collect::<Vec<_>>()
        };
        let lines: Vec<String> = self.links.iter().enumerate().flat_map(|(l, link)| named(l, link)).collect();
        for line in lines.iter().take(NAMED) {
            let _ = writeln!(text, "{line}");
        }
        if lines.len() > NAMED {
            let _ = writeln!(text, "  and {} more: --json has them all", lines.len() - NAMED);
        }
        text.trim_end().to_owned()
    }
}
