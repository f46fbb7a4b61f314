//! Which columns a table has: words that name them, and what each is.

use crate::metrics::{COLUMNS, Column, RADIO};
use anyhow::{Result, bail, ensure};
use corf_scene::words::nearest;
use std::borrow::Cow;
use std::fmt::Write;

/// Columns of a table: metrics, and behind them what else there is of a row.
#[derive(Clone, Debug)]
pub struct Columns {
    /// Metrics, in their order.
    pub metrics: Vec<&'static Column>,
    /// What stands behind them; `None` where nobody asked, and each notation has what it usually has.
    pub(super) extras: Option<Vec<Extra>>,
    /// The metric that was named first, by its own key, and leads the table.
    first: Option<&'static Column>,
}

/// A column that is no metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Extra {
    /// Difference to the first row, paired by seed.
    Difference,
    Gaussians,
    /// Time of the reconstruction.
    Seconds,
    Seeds,
    /// Peak of the GPU's memory.
    DeviceMemory,
}

impl Extra {
    /// All of them by the words that name them.
    const ALL: [(&'static str, Self); 5] = [
        ("delta", Self::Difference),
        ("gaussians", Self::Gaussians),
        ("time", Self::Seconds),
        ("seeds", Self::Seeds),
        ("device_memory", Self::DeviceMemory),
    ];

    /// The heading; differences are those of `leading`.
    pub fn heading(self, leading: &Column) -> Cow<'static, str> {
        match self {
            Self::Difference => Cow::Owned(format!("Δ {} to first row", leading.heading.trim_end_matches([' ', '↑', '↓']))),
            Self::Gaussians => Cow::Borrowed("Gaussians"),
            Self::Seconds => Cow::Borrowed("time, s"),
            Self::Seeds => Cow::Borrowed("seeds"),
            Self::DeviceMemory => Cow::Borrowed("peak device memory, MB"),
        }
    }

    /// What it is, for the help.
    fn meaning(self) -> &'static str {
        match self {
            Self::Difference => "Δ to the first row, paired by seed",
            Self::Gaussians => "Gaussians of the field",
            Self::Seconds => "time of the reconstruction, s",
            Self::Seeds => "finished seeds",
            Self::DeviceMemory => "the most that buffers took on the GPU, MB of 10^6 bytes; empty on the processor",
        }
    }

    fn of(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|(name, _)| *name == word).map(|(_, extra)| *extra)
    }
}

impl Columns {
    /// No column of metrics.
    pub fn none() -> Self {
        Self { metrics: Vec::new(), extras: None, first: None }
    }

    /// What stands behind the metrics in a notation that usually has `usual` there.
    pub(super) fn extras(&self, usual: &[Extra]) -> Vec<Extra> {
        self.extras.clone().unwrap_or_else(|| usual.to_vec())
    }

    /// The metric that differences are taken of: the one that was named first and leads the table. Where a group leads it, PSNR of spectra in
    /// decibels, or else the PSNR of spectra which comes first; where there is none, the first.
    pub(super) fn leading(&self) -> &'static Column {
        let first = self.first.filter(|first| self.metrics.iter().any(|c| c.key == first.key));
        let of = |is: fn(&Column) -> bool| self.metrics.iter().find(|c| is(c)).copied();
        let of_spectra = || of(|c| c.key == DIFFERENCE_KEY).or_else(|| of(|c| c.key.starts_with("psnr_rf")));
        let known = || column(DIFFERENCE_KEY).expect("it is one of the columns");
        first.or_else(of_spectra).or_else(|| self.metrics.first().copied()).unwrap_or_else(known)
    }
}

/// The columns of the short table (terminal, README): what a radio is served by, then what the literature prints.
pub(super) const SHORT: &[&str] = &[
    "psnr_rf_scalar",
    "rmse_db_30",
    "codebook_loss_db",
    "peak_error_deg",
    "psp_similarity",
    "psnr_rf_jet",
    "ssim_rf_jet",
    "psnr_opt",
    "ssim_opt",
];

/// Columns that a reader knows without a definition below the table.
pub(super) const KNOWN: &[&str] =
    &["psnr_opt", "ssim_opt", "psnr_rf_jet", "ssim_rf_jet", "psnr_rf_scalar", "rmse_db_30", "psp_similarity", "peak_error_deg"];

/// What usually stands behind the metrics; text and LaTeX have no differences unless asked.
pub(super) const USUAL: &[Extra] = &[Extra::Difference, Extra::Gaussians, Extra::Seconds];

/// The metric that the paper's differences are taken of.
pub(super) const PAPER_KEY: &str = "psnr_rf_jet";

/// The metric that differences are taken of where no other is named.
const DIFFERENCE_KEY: &str = "psnr_rf_scalar";

pub(super) fn column(key: &str) -> Option<&'static Column> {
    COLUMNS.iter().find(|c| c.key == key)
}

/// The columns of the short table.
pub fn short_columns() -> Columns {
    Columns { metrics: of_short(), extras: None, first: None }
}

fn of_short() -> Vec<&'static Column> {
    SHORT.iter().filter_map(|key| column(key)).collect()
}

/// The columns that these words name, each once: keys of metrics, `short` (the columns of a table that asks for none), `radio` (those that
/// tell how a spectrum serves a radio), `lpips` (those of VGG-16), `all`; `delta` (the difference to the first row in the metric that leads),
/// `gaussians`, `time`, `seeds` and `device_memory`, which stand behind the metrics and are there as usual where none of them is named. A word with a minus before
/// it leaves its column out. Without a metric those of `short`.
///
/// # Errors
/// A word that is empty or none of them; no metric that is left.
pub fn columns<S: AsRef<str>>(words: &[S]) -> Result<Columns> {
    let words: Vec<&str> = words.iter().map(|word| word.as_ref().trim()).collect();
    if let Some(at) = words.iter().position(|word| word.trim_start_matches('-').is_empty()) {
        bail!("columns: word {} is empty\n  help: give keys with one comma between two, as psnr_opt,time", at + 1);
    }
    let (left_out, wanted): (Vec<&str>, Vec<&str>) = words.iter().partition(|word| word.starts_with('-'));
    let mut extras: Vec<Extra> = wanted.iter().filter_map(|word| Extra::of(word)).collect();
    let metrics: Vec<&str> = wanted.into_iter().filter(|word| Extra::of(word).is_none()).collect();
    let is_in = |word: &&str| !left_out.iter().any(|out| out[1..] == **word);
    let first = metrics.iter().copied().find(is_in).and_then(column);
    let mut metrics = if metrics.is_empty() { of_short() } else { metrics_of(&metrics)? };
    let mut chosen = !extras.is_empty();
    for word in left_out.iter().map(|word| &word[1..]) {
        match Extra::of(word) {
            Some(extra) => {
                if !chosen {
                    extras = USUAL.to_vec();
                }
                chosen = true;
                extras.retain(|other| *other != extra);
            }
            None => {
                let out = metrics_of(&[word])?;
                metrics.retain(|c| out.iter().all(|other| other.key != c.key));
            }
        }
    }
    ensure!(!metrics.is_empty(), "columns: no metric is left of {}\n  help: name one that stays, as psnr_opt", words.join(","));
    Ok(Columns { metrics, extras: chosen.then_some(extras), first })
}

/// The metrics that these words name, each once.
fn metrics_of(words: &[&str]) -> Result<Vec<&'static Column>> {
    let mut out: Vec<&'static Column> = Vec::new();
    for word in words {
        let named: Vec<&'static Column> = match *word {
            "short" => of_short(),
            "radio" => RADIO.iter().filter_map(|key| column(key)).collect(),
            "all" => COLUMNS.iter().collect(),
            "lpips" => COLUMNS.iter().filter(|c| c.backbone() == Some("vgg")).collect(),
            key => match column(key) {
                Some(one) => vec![one],
                None => {
                    let keys: Vec<&str> = COLUMNS.iter().map(|c| c.key).collect();
                    let others: Vec<&str> = GROUPS.iter().map(|g| g.0).chain(Extra::ALL.iter().map(|e| e.0)).collect();
                    let meant = nearest(key, keys.iter().chain(&others).copied())
                        .map_or(String::new(), |near| format!("; did you mean {near}?"));
                    bail!("no column is called {key}{meant}\n  help: give {}, or keys of {}", others.join(", "), keys.join(", "))
                }
            },
        };
        for one in named {
            if out.iter().all(|c| c.key != one.key) {
                out.push(one);
            }
        }
    }
    Ok(out)
}

/// Groups of metrics by the words that name them.
const GROUPS: [(&str, &str); 4] = [
    ("short", "those of a table that asks for none"),
    ("radio", "those that tell how a spectrum serves a radio"),
    ("lpips", "those of VGG-16"),
    ("all", "every metric"),
];

/// What can be said with `--columns`: every word with what it stands for, as the help of the commands has it.
pub fn help_of_keys() -> String {
    let width = COLUMNS.iter().map(|c| c.key.len()).max().unwrap_or(0);
    let mut out = String::from(
        "Columns, with commas between: keys of metrics, groups of them, and what stands behind the metrics; a minus before a word leaves its column \
         out. Δ is of the metric that is named first.",
    );
    let mut list = |heading: &str, words: &mut dyn Iterator<Item = (&str, &str)>| {
        let _ = write!(out, "\n\n{heading}:");
        words.for_each(|(word, what)| {
            let _ = write!(out, "\n  {word:width$}  {what}");
        });
    };
    list("Groups", &mut GROUPS.into_iter());
    list("Behind the metrics", &mut Extra::ALL.into_iter().map(|(word, extra)| (word, extra.meaning())));
    list("Metrics (docs/METHODOLOGY.md defines them)", &mut COLUMNS.iter().map(|c| (c.key, c.heading)));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_names_every_word_that_is_taken() {
        let help = help_of_keys();
        let words: Vec<&str> = help.lines().filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next()).collect();
        assert_eq!(words.len(), COLUMNS.len() + GROUPS.len() + Extra::ALL.len(), "{words:?}");
        for word in words {
            assert!(columns(&[word]).is_ok(), "{word}");
        }
    }

    #[test]
    fn the_difference_is_of_the_metric_that_leads() {
        let leads = |words: &[&str]| columns(words).unwrap().leading().key;
        assert_eq!(leads(&["rmse_db_30", "psnr_rf_jet"]), "rmse_db_30");
        assert_eq!(leads(&["psnr_rf_jet", "delta", "short"]), "psnr_rf_jet");
        assert_eq!(leads(&["-psnr_opt", "psnr_opt", "ssim_opt"]), "ssim_opt", "what is left out leads nothing");
        // A group has no column of its own that leads: differences are those of the spectrum in decibels.
        assert_eq!([leads(&[]), leads(&["short", "rmse_db"]), leads(&["all"])], [DIFFERENCE_KEY; 3]);
        assert_eq!(leads(&["radio"]), RADIO[0]);
        assert_eq!(leads(&["short", "-psnr_rf_scalar"]), "psnr_rf_jet");
    }
}
