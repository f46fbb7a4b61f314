//! `corf reconstruct`: a dataset's training keyframes to a field on disk.

mod follow;
mod geometry;

use self::follow::Follow;
use super::config::of_method;
use super::{Verdict, assignments, show};
use crate::charts::{self, ColourMap};
use crate::device::{Backend, DeviceChoice};
use crate::files::json::{read_numbers, read_text};
use crate::files::separation::{Reads, keep_apart};
use crate::live::WhenBehind;
use crate::methods;
use crate::methods::corf_gs::GeometryConfig;
use crate::methods::interface::{Advance, Checkpoints, TrainingSet};
use crate::metrics::input::Verify;
use crate::note;
use crate::record::{METRICS, Record};
use crate::run::harness;
use crate::run::picture::Picture;
use crate::run::quality::QualityWatch;
use crate::run::{CONFIG, RunInfo, claim_output, initial_hash, write_config, write_finished};
use crate::split::{Protocol, Split};
use crate::table;
use crate::terminal;
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use crate::terminal::shell;
use crate::viewer::{Port, Watching};
use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use corf::Field;
use corf_scene::io::write_atomic;
use corf_scene::words::counted;
use std::path::{Path, PathBuf};

/// What means nothing beside --follow; clap asks for it also at the flags that require it.
const NOT_WITH_FOLLOW: [&str; 4] = ["dataset", "resume", "checkpoint_every", "no_verify"];

/// `corf reconstruct`.
#[derive(Args)]
pub struct Reconstruct {
    /// Dataset folder.
    #[arg(required_unless_present = "follow")]
    dataset: Option<PathBuf>,
    /// Take keyframes from this live folder as they land (docs/live.md), instead of a dataset, until it says `end` or Ctrl-C; corf-gs methods. The
    /// same command goes on with a run that did not come to its end.
    #[arg(long, value_name = "DIR", conflicts_with_all = NOT_WITH_FOLLOW)]
    follow: Option<PathBuf>,
    /// What happens to keyframes of --follow that come faster than they are taken: all wait, or the latest takes the place of those that wait.
    #[arg(long, value_enum, default_value_t, requires = "follow", conflicts_with_all = NOT_WITH_FOLLOW)]
    when_behind: WhenBehind,
    /// End a run of --follow at the first keyframe that cannot be used, with exit code 2, instead of leaving it out.
    #[arg(long, requires = "follow", conflicts_with_all = NOT_WITH_FOLLOW)]
    strict: bool,
    /// Output folder of the run.
    #[arg(long)]
    out: PathBuf,
    /// Method that reconstructs.
    #[arg(long, default_value = "corf-gs", value_parser = methods::names())]
    method: String,
    /// TOML file with keys of the method's configuration.
    #[arg(long)]
    config: Option<PathBuf>,
    /// One key of the configuration, `key=value` in TOML notation; may be repeated and wins over --config.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Begin with Gaussians of light that another program trained on this data set: a PLY as INRIA's 3DGS, gsplat, nerfstudio or `corf field export`
    /// write it, in the data set's own frame (metres, z up). corf-gs and its variants go on from them in light and radio; rf-3dgs takes them for its
    /// optical stage.
    #[arg(long, value_name = "FILE.ply")]
    from: Option<PathBuf>,
    /// Keep light and geometry of this finished run of corf-gs, byte for byte, and learn radio alone: for the same room with another transmitter or
    /// carrier (`corf dataset generate --light-from`). Frame, camera and scene or poses must be those of the run's data set, and no keyframe that is
    /// held out may have trained it. --set geometry.epochs=N says how long.
    #[arg(
        long,
        value_name = "RUN",
        conflicts_with_all = ["follow", "from", "fine_tune", "fine_tune_s", "budget_ms", "checkpoint_every", "view"]
    )]
    geometry: Option<PathBuf>,
    /// Seed of everything drawn at random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Protocol: the keyframes that train, and those that `corf evaluate` then looks at (default: test; with --follow: all).
    #[arg(long, value_name = "PROTOCOL")]
    protocol: Option<Protocol>,
    /// Epochs of offline fine-tuning over all training keyframes after the last one.
    #[arg(long, value_name = "EPOCHS")]
    fine_tune: Option<usize>,
    /// Time of fine-tuning instead, seconds: epochs while there is time. Two runs are then not the same.
    #[arg(long, value_name = "SECONDS", conflicts_with = "fine_tune")]
    fine_tune_s: Option<f64>,
    /// Time of a keyframe, milliseconds, instead of a number of steps: expansion takes what it takes, and steps fill the rest. Two runs are then
    /// not the same.
    #[arg(long, value_name = "MS")]
    budget_ms: Option<f64>,
    /// Go on with an unfinished run behind its last checkpoint; the result is that of a run without interruption, byte for byte on the
    /// processor. A finished run of the same command is left as it is.
    #[arg(long)]
    resume: bool,
    /// Keep a checkpoint in the output folder after every N keyframes (rf-3dgs, nerf2, wrf-gs-plus: steps); 0 keeps none. Without it one is kept
    /// every half a minute, and on an interrupt where the keyframe or steps at hand end within two seconds.
    #[arg(long, value_name = "N")]
    checkpoint_every: Option<usize>,
    /// Show the field in a browser while it grows: serves a page on 127.0.0.1 until the reconstruction ends, at this port or at one that is free.
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "0", value_parser = view_port)]
    view: Option<u16>,
    /// Evaluate the field on the held-out keyframes after every N training keyframes (steps of methods that work in steps) and at the end, for a curve of quality over
    /// time in run.json and quality.svg. The evaluations are none of the run's seconds, and the field is that of a run without them, byte for byte.
    #[arg(long, value_name = "N", conflicts_with = "follow")]
    evaluate_every: Option<usize>,
    /// Draw the held-out keyframe that receives the most into this file (.svg): observed, predicted and the error of image and spectrum, with axes in
    /// degrees, peaks and a colour bar for each scale.
    #[arg(long, value_name = "FILE.svg", conflicts_with = "follow")]
    figure: Option<PathBuf>,
    /// Colours of spectra in the figure.
    #[arg(long, value_enum, default_value_t, requires = "figure", conflicts_with = "follow")]
    colours: ColourMap,
    #[command(flatten)]
    verify: Verify,
    /// Device that reconstructs: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
    /// GPU: time each kernel of the training steps by the GPU's own clock, and say in run.json and at the end where the time went; corf-gs methods.
    /// It costs the steps a little.
    #[arg(long)]
    time_kernels: bool,
}

/// The port of `--view`; a word behind it that was meant for something else is told so.
fn view_port(text: &str) -> Result<u16, String> {
    text.parse().map_err(|_| {
        format!("a port is a number from 1 to 65535, or 0 for one that is free; if {text} is the dataset, name it before --view")
    })
}

impl Reconstruct {
    /// Reconstructs from a live folder.
    fn follow(self, folder: &Path, json: bool) -> Result<Verdict> {
        keep_apart("--out", &self.out, &[Reads::Folder(folder)])?;
        let overrides = self.overrides()?;
        let live = Follow {
            folder,
            out: &self.out,
            method: &self.method,
            overrides,
            seed: self.seed,
            protocol: self.protocol.unwrap_or(Protocol::ALL),
            when_behind: self.when_behind,
            strict: self.strict,
            backend: self.backend()?,
        };
        let info = live.run()?;
        self.say_untimed(&info);
        let text = info.live.as_ref().map_or(String::new(), |live| format!("\n{}", live.summary()));
        show(json, &info, &(summary(&info) + &text + &ending(&self.out, &info, true)))?;
        Ok(Verdict::Done)
    }

    /// The device, told to time its kernels if that is wanted.
    fn backend(&self) -> Result<Backend> {
        let backend = self.device.resolve()?;
        if !self.time_kernels {
            return Ok(backend);
        }
        ensure!(
            methods::abilities(&self.method).follows,
            "{}: --time-kernels times the steps of corf-gs\n  help: choose {}, or leave it out",
            self.method,
            methods::registry::that(|can| can.follows)
        );
        backend.timing_kernels()
    }

    /// Says where times were asked for and there are none.
    fn say_untimed(&self, info: &RunInfo) {
        if self.time_kernels && info.training_times.is_none() {
            note!("--time-kernels: {} took no times: its adapter has no timestamps, or its steps are not corf-gs's", info.method);
        }
    }

    /// The overrides of file and command line as one table.
    fn overrides(&self) -> Result<toml::Table> {
        let mut table = match &self.config {
            None => toml::Table::new(),
            Some(path) => {
                let text = read_text(path)?;
                text.parse().with_context(|| format!("{} is no TOML", path.display()))?
            }
        };
        let given = assignments::table(&self.overrides)?;
        if let Ok(keys) = of_method(&self.method) {
            assignments::check_tables(&given, &keys)?;
        }
        methods::merge(&mut table, given);
        if let Some(epochs) = self.fine_tune {
            table.insert("fine_tune_epochs".to_owned(), toml::Value::Integer(i64::try_from(epochs)?));
        }
        for (key, time) in [("fine_tune_s", self.fine_tune_s), ("keyframe_budget_ms", self.budget_ms)] {
            if let Some(time) = time {
                table.insert(key.to_owned(), toml::Value::Float(time));
            }
        }
        if let Some(file) = &self.from {
            ensure!(
                methods::abilities(&self.method).begins_with_gaussians,
                "{}: --from gives Gaussians to begin with, which this method has no place for\n  help: choose {}",
                self.method,
                methods::registry::that(|can| can.begins_with_gaussians)
            );
            let file = std::path::absolute(file)?.display().to_string();
            table.insert("initial_gaussians".to_owned(), toml::Value::String(file));
        }
        if let Some(run) = &self.geometry {
            let geometry = geometry::table(run, table.get("geometry"))?;
            table.insert("geometry".to_owned(), toml::Value::Table(geometry));
        }
        Ok(table)
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Bad input, an occupied output folder, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        if let Some(folder) = self.follow.clone() {
            ensure!(
                self.view.is_none(),
                "--view shows keyframes that a dataset names in advance, and those of --follow come one by one\n  help: leave --view out, and look \
                 at the run with `corf view` once it has ended"
            );
            return self.follow(&folder, json);
        }
        let Some(dataset_folder) = &self.dataset else { bail!("no dataset is named\n  help: name its folder, or --follow DIR") };
        keep_apart("--out", &self.out, &[Reads::Folder(dataset_folder)])?;
        if let Some(run) = &self.geometry {
            keep_apart("--out", &self.out, &[Reads::Folder(run)])?;
        }
        // A port that cannot be had is known before any work.
        let port = self.view.map(|port| Port::hold(port, "--view")).transpose()?;
        let (protocol, overrides) = (self.protocol.unwrap_or_default(), self.overrides()?);
        let mut picture = Picture::plan(self.figure.as_deref(), None, self.colours)?;
        let backend = self.backend()?;
        let mut method = methods::create(&self.method, &overrides, &backend)?;
        if port.is_some() {
            Watching::check(method.as_ref())?;
        }
        let input = self.verify.open_any(dataset_folder)?;
        let dataset = &input.dataset;
        let split = Split::of(dataset, protocol)?;
        harness::check_training(method.as_ref(), dataset, &split)?;
        methods::registry::check_data_set(method.as_mut(), &overrides, &TrainingSet::new(dataset, &split))?;
        let every = self.evaluate_every;
        let mut quality = every.map(|n| QualityWatch::new(n, method.as_ref(), &input, &split, &backend)).transpose()?;
        if let Some(picture) = &mut picture {
            picture.choose(method.id(), dataset, &split)?;
        }
        let initial = initial_hash(&overrides)?;
        let _held = claim_output(&self.out, self.resume)?;
        let info_path = self.out.join("run.json");
        if self.resume && info_path.exists() {
            let info: RunInfo = read_numbers(&info_path)?;
            ensure!(
                info.method == self.method
                    && info.seed == self.seed
                    && info.protocol == protocol
                    && methods::without_retired(&info.config) == method.config()
                    && info.initial_gaussians_sha256 == initial
                    && info.dataset_hash == dataset.hash(),
                "{} holds a finished run of another method, configuration, seed, protocol, dataset or other first Gaussians\n  help: choose another --out",
                self.out.display()
            );
            note!("{} is finished already", self.out.display());
            if let Some(file) = &self.figure {
                note!(
                    "--figure: nothing is drawn of it; `corf evaluate {} --figure {}` does",
                    self.out.display(),
                    file.display()
                );
            }
            if every.is_some() && info.curve.iter().all(|point| point.held_out.is_none()) {
                note!(
                    "--evaluate-every: it was reconstructed without evaluations, and has no curve of quality: choose another --out for one"
                );
            }
            show(json, &info, &(summary(&info) + &ending(&self.out, &info, dataset.fixed_array().is_none())))?;
            return Ok(Verdict::Done);
        }
        let checkpoint = self.out.join(CHECKPOINT);
        method.keep_checkpoints(Checkpoints {
            path: checkpoint.clone(),
            every: self.checkpoint_every,
            resume: self.resume,
            tag: format!("{} {} {}{}", dataset.hash(), protocol.name(), method.config(), initial.as_deref().unwrap_or("")),
            device: method.device(),
        });
        interrupt::print_what_is_kept(match self.checkpoint_every {
            Some(0) => "nothing is kept of it (--checkpoint-every 0): with --resume it begins anew",
            _ => "nothing is kept of it yet: with --resume it begins anew",
        });
        let begun = Begun::write(&self.out, &method.config())?;
        let watching = port.map(|port| Watching::start(port, method.as_ref(), self.seed, dataset, &split)).transpose()?;
        let mut progress =
            Progress::start(format!("{} on {}", self.method, dataset.header().name), split.train.len(), method.unit());
        let mut watch = |advance: Advance<'_>| {
            progress.set(advance.done, advance.total);
            if let Some(watching) = &watching {
                watching.report(&advance);
            }
            interrupt::check()
        };
        let mut result = harness::reconstruct(method.as_ref(), dataset, &split, self.seed, quality.as_mut(), &mut watch)?;
        progress.finish();
        begun.keep();
        let info = RunInfo {
            initial_gaussians_sha256: initial,
            ..RunInfo::of(
                method.as_ref(),
                &overrides,
                self.seed,
                (dataset, input.verified),
                (protocol, split.train.len()),
                &result,
            )?
        };
        if let Some(svg) = charts::quality(&format!("{} on {}", info.method, dataset.header().name), &info.curve)? {
            write_atomic(self.out.join(QUALITY), svg.as_bytes())?;
        }
        write_finished(&self.out, &info, &result)?;
        interrupt::kept(|| format!("{} is finished", self.out.display()));
        // What it was kept for is there.
        let _ = std::fs::remove_file(&checkpoint);
        if let Some((picture, index)) = picture.as_mut().and_then(|picture| picture.index().map(|index| (picture, index))) {
            let truth = dataset.keyframe(index)?;
            let predicted = result.predictor.render(&truth.world_from_camera)?.within(truth.modalities());
            picture.look(&truth, predicted.halves())?;
            picture.write()?;
        }
        self.say_untimed(&info);
        show(json, &info, &(summary(&info) + &ending(&self.out, &info, dataset.fixed_array().is_none())))?;
        if let Some(watching) = watching {
            // What is shown at the end is what was written.
            watching.finish(|| Field::read(&self.out).inspect_err(|error| note!("{error}")).ok());
        }
        Ok(Verdict::Done)
    }
}

/// The figure of quality over time, in the run's folder.
const QUALITY: &str = "quality.svg";

/// The state of an unfinished run, in its folder.
const CHECKPOINT: &str = "checkpoint";

/// A run folder that tells of a configuration: where the run ends before it has kept anything, it tells of none, and takes another command.
struct Begun {
    config: Option<PathBuf>,
    checkpoint: PathBuf,
}

impl Begun {
    fn write(folder: &Path, config: &serde_json::Value) -> Result<Self> {
        let path = folder.join(CONFIG);
        let is_new = !path.exists();
        write_config(folder, config)?;
        Ok(Self { config: is_new.then_some(path), checkpoint: folder.join(CHECKPOINT) })
    }

    /// The run has come to its end.
    fn keep(mut self) {
        self.config = None;
    }
}

impl Drop for Begun {
    fn drop(&mut self) {
        if let Some(config) = self.config.as_ref().filter(|_| !self.checkpoint.exists()) {
            // Without it nothing is wrong but that the folder is not empty.
            let _ = std::fs::remove_file(config);
        }
    }
}

fn summary(info: &RunInfo) -> String {
    let gaussians = info.gaussians.map_or(String::new(), |g| format!(", {}", counted(g, "Gaussian")));
    let mut text = format!("{} in {:.2} s on {}{gaussians}", info.method, info.seconds, info.device);
    if info.resumed_keyframes > 0 {
        text += &format!("; {} came from a checkpoint", counted(info.resumed_keyframes, "keyframe"));
    }
    if info.resumed_steps > 0 {
        text += &format!("; {} came from a checkpoint", counted(info.resumed_steps, "step"));
    }
    if let Some(processor_s) = info.processor_s {
        text += &format!("; {processor_s:.1} s of processor time");
    }
    if let Some(geometry) = GeometryConfig::of_config(&info.config) {
        text += &format!("\n{}", geometry.words());
    }
    for stage in &info.stages {
        text += &format!("\n  {:<10} {:>10.2} s", stage.name, stage.seconds);
    }
    if let Some(times) = &info.training_times {
        text += &format!("\n{}", times.table());
    }
    if let Some(d) = &info.depth {
        text += "\nrelative error of new Gaussians' depths    share   median      p90";
        for (name, e) in
            [("all", d.all), ("  accurate matches", d.accurate), ("  prior alone", d.prior), ("  corners", d.triangulated)]
        {
            text += &format!("\n{name:<38} {:>6.1} % {:>6.2} % {:>6.2} %", 100.0 * e.share, 100.0 * e.median, 100.0 * e.p90);
        }
        text += &format!("\n{:.1} % of the sampled pixels found no depth", 100.0 * d.dropped_without_depth);
    }
    if let Some(l) = &info.latency {
        let rate = l.keyframes_per_second;
        text += &format!(
            "\nexpansion and training alone: {rate:.2} keyframes/s\n{:<48}   median      p90      p99",
            "latency of a keyframe, ms"
        );
        for (name, p) in [
            ("arrival to optimised", l.total),
            ("  wait", l.wait),
            ("    of it preparation", l.prepare),
            ("      matching", l.matching),
            ("      matching, by the GPU's clock", l.match_device),
            ("  expand", l.expand),
            ("  train", l.train),
            ("  late steps", l.late),
        ] {
            // What this run has none of: a GPU's clock, steps that are taken late.
            if p.p99_s == 0.0 {
                continue;
            }
            let [a, b, c] = [p.median_s, p.p90_s, p.p99_s].map(|s| 1e3 * s);
            text += &format!("\n{name:<48} {a:>8.1} {b:>8.1} {c:>8.1}");
        }
    }
    text
}

/// Where the run is, what it is worth on the held-out keyframes where it was evaluated, by `corf evaluate` or at its end, and the commands to type next;
/// `viewable`: whether `corf view` takes its data set.
fn ending(out: &Path, info: &RunInfo, viewable: bool) -> String {
    let folder = shell::word(&out.display().to_string());
    let mut text = format!("\nrun:  {}", out.display());
    let record = out.join(METRICS).is_file().then(|| Record::read(&out.join(METRICS)).ok()).flatten();
    if let (Some(record), Ok(columns)) = (&record, table::columns(&["short".to_owned()])) {
        text += &format!(
            "\nheld-out keyframes:\n{}",
            table::plain(&table::rows(std::slice::from_ref(record)), &columns, terminal::width()).trim_end()
        );
    }
    if let Some(quality) = info.curve.last().and_then(|point| point.held_out).filter(|_| record.is_none()) {
        text += &format!("\nheld-out keyframes: {}", quality.text());
    }
    let evaluates = record.is_none() && info.protocol != Protocol::ALL;
    let next = [
        evaluates.then(|| format!("corf evaluate {folder}    (quality on the held-out keyframes)")),
        viewable.then(|| format!("corf view {folder}    (look at it)")),
    ];
    let next: Vec<String> = next.into_iter().flatten().collect();
    if next.is_empty() { text } else { text + &format!("\nnext: {}", next.join("\n      ")) }
}
