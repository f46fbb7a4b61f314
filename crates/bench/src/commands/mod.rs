//! One file a sub-command: arguments in, library calls, a verdict out.

mod assignments;
mod bench;
mod check;
mod completions;
mod config;
mod coverage;
mod dataset;
mod demo;
mod diffuse;
mod docs;
mod doctor;
mod evaluate;
mod export_light;
mod field;
mod open_flags;
mod paths;
mod query;
mod reconstruct;
mod render;
mod scene;
mod scene_new;
mod spectrum;
mod uncertainty;
mod view;

use crate::bounds;
use crate::record::{Outcome, Record};
use crate::terminal::messages;
use anyhow::{Context, Result};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use corf_scene::Severity;
use serde::Serialize;
use std::ffi::OsString;

/// Outcome of a command that ended well enough to have one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Exit code 0.
    Done,
    /// Exit code 1: the command worked, and what it checked is not so.
    CheckFailed,
}

impl Verdict {
    /// A finished comparison is done when no cell failed.
    fn of(records: &[Record]) -> Self {
        let failed = records.iter().any(|r| matches!(r.outcome, Outcome::Failed { .. }));
        if failed { Self::CheckFailed } else { Self::Done }
    }
}

/// Reconstruct what a room looks like to a radio at 60 GHz, from keyframes of a camera and an 8×8 array.
#[derive(Parser)]
#[command(name = "corf", version, arg_required_else_help = true)]
pub struct Arguments {
    /// Print results as JSON on standard output (progress stays on standard error).
    #[arg(long, global = true)]
    pub json: bool,
    /// Worker threads (default: one per core).
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=bounds::MAX_THREADS))]
    pub threads: Option<u64>,
    /// What is to be done.
    #[command(subcommand)]
    pub command: Command,
}

impl Arguments {
    /// The arguments of a command line, the program's name first. A negative number is a value of the flag before it wherever one is taken, so that
    /// what is wrong with it is said of it.
    ///
    /// # Errors
    /// What clap has to say, help and version included.
    pub fn of<I: IntoIterator<Item = T>, T: Into<OsString> + Clone>(line: I) -> Result<Self, clap::Error> {
        fn with_negative_numbers(command: clap::Command) -> clap::Command {
            command.allow_negative_numbers(true).mut_subcommands(with_negative_numbers)
        }
        Self::from_arg_matches(&with_negative_numbers(Self::command()).try_get_matches_from(line)?)
    }
}

/// The sub-commands of `corf`.
#[derive(Subcommand)]
pub enum Command {
    /// The small lobby end to end: keyframes, all ablations, table and report (a couple of minutes on 2 cores).
    Demo(demo::Demo),
    /// Begin, build, describe, check or export a scene.
    #[command(subcommand)]
    Scene(scene::Scene),
    /// Generate or check a keyframe dataset.
    #[command(subcommand)]
    Dataset(dataset::DatasetCommand),
    /// Trace the propagation paths between points: JSON with Sionna's field names, link statistics, Sionna and DeepMIMO arrays.
    Paths(paths::Paths),
    /// Trace what surfaces scatter towards receivers, and which of them; JSON.
    Diffuse(diffuse::Diffuse),
    /// Map what a transmitter reaches on a plane: EXR, PNG, JSON.
    Coverage(coverage::Coverage),
    /// Angular spectra at one pose: linear and dB as EXR, Jet as PNG.
    Spectrum(Box<spectrum::Spectrum>),
    /// Compare with references.
    #[command(subcommand)]
    Check(check::Check),
    /// Reconstruct a field from a dataset's training keyframes.
    Reconstruct(reconstruct::Reconstruct),
    /// Write a reconstructed field for other programs.
    #[command(subcommand)]
    Field(field::FieldCommand),
    /// Render a reconstructed field at any poses: image, spectrum, depth.
    Render(render::Render),
    /// Ask a reconstructed field what arrives at any poses: power, strongest direction, best beam, spread, outage; CSV or NPZ.
    Query(query::Query),
    /// Evaluate a reconstructed field, or predictions of another program, on the held-out keyframes.
    Evaluate(evaluate::Evaluate),
    /// How far predicted decibels may be off, and where to measure next.
    #[command(subcommand)]
    Uncertainty(uncertainty::Uncertainty),
    /// Look at a field, or at a dataset, in a browser: serves a page on this machine, or writes it.
    View(view::View),
    /// Run plans, write tables and reports.
    #[command(subcommand)]
    Bench(bench::Bench),
    /// What this program and this machine can do, and why not the rest: devices, memory, optional libraries.
    Doctor(doctor::Doctor),
    /// Explain every key of a scene file, a data-set configuration, a plan or a method.
    Config(config::Config),
    /// Completions of commands and flags for a shell, on standard output.
    Completions(completions::Completions),
    /// Write tables and help into documents, for those who change this program.
    #[command(hide = true)]
    Docs(docs::Docs),
}

impl Command {
    /// Runs the command; `json` asks for machine-readable results.
    ///
    /// # Errors
    /// Bad input, an interrupt, or a device that gives up.
    pub fn run(self, json: bool) -> Result<Verdict> {
        match self {
            Self::Demo(c) => c.run(json),
            Self::Scene(c) => c.run(json),
            Self::Dataset(c) => c.run(json),
            Self::Paths(c) => c.run(),
            Self::Diffuse(c) => c.run(),
            Self::Coverage(c) => c.run(json),
            Self::Spectrum(c) => c.run(json),
            Self::Check(c) => c.run(json),
            Self::Reconstruct(c) => c.run(json),
            Self::Field(c) => c.run(json),
            Self::Render(c) => c.run(json),
            Self::Query(c) => c.run(json),
            Self::Evaluate(c) => c.run(json),
            Self::Uncertainty(c) => c.run(json),
            Self::View(c) => c.run(json),
            Self::Bench(c) => c.run(json),
            Self::Doctor(c) => c.run(json),
            Self::Config(c) => c.run(json),
            Self::Completions(c) => c.run(),
            Self::Docs(c) => c.run(),
        }
    }
}

/// Writes a result to standard output; a reader that has gone away is no error.
///
/// # Errors
/// When standard output cannot be written for another reason.
pub(crate) fn print(text: &str) -> Result<()> {
    messages::to_stdout(text).context("cannot write to standard output")
}

/// Prints a value as JSON or as text.
///
/// # Errors
/// As [`print()`].
pub(crate) fn show(json: bool, value: &impl Serialize, text: &str) -> Result<()> {
    if json { print(&serde_json::to_string_pretty(value)?) } else { print(text) }
}

/// Prints findings; the verdict is that of the gravest.
///
/// # Errors
/// As [`print()`].
pub(crate) fn findings(json: bool, findings: &[corf_scene::Finding]) -> Result<Verdict> {
    let text: Vec<String> = findings.iter().map(ToString::to_string).collect();
    let failed = findings.iter().any(|f| f.severity == Severity::Error);
    let verdict = if failed { "failed" } else { "passed" };
    show(json, &findings, &[text.join("\n"), verdict.to_owned()].join("\n"))?;
    Ok(if failed { Verdict::CheckFailed } else { Verdict::Done })
}

#[cfg(test)]
mod tests;
