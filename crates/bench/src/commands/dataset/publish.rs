//! `corf dataset publish`: a data set in the forms in which data sets are published.

use super::super::{Verdict, show};
use crate::files::separation::{Reads, keep_apart};
use crate::metrics::input::{Input, Verify};
use crate::note;
use crate::publish::{Answers, Author, Licence, Publication, PublicationStatement};
use crate::run::claim_fresh;
use anyhow::Result;
use clap::Args;
use corf_scene::Error;
use std::path::PathBuf;

/// `corf dataset publish`.
#[derive(Args)]
pub struct Publish {
    /// Dataset folder.
    folder: PathBuf,
    /// Output folder.
    #[arg(long)]
    out: PathBuf,
    /// Licence of the data: cc-by-4.0, cc-by-sa-4.0, cc-by-nc-4.0, cc-by-nc-sa-4.0, cc0-1.0, odc-by, odbl, pddl or cdla-permissive-2.0.
    #[arg(long, visible_alias = "license", value_name = "ID")]
    licence: Licence,
    /// Who made the data, "Family, Given" or the name of an institution; may be repeated.
    #[arg(long, value_name = "NAME", required = true)]
    author: Vec<Author>,
    /// Name of the publication (default: the data set's).
    #[arg(long, value_parser = line)]
    title: Option<String>,
    /// Where it will be found.
    #[arg(long, value_parser = address)]
    url: Option<String>,
    /// Day of publication.
    #[arg(long, value_name = "YYYY-MM-DD", value_parser = day)]
    date: Option<String>,
    /// Version of the data.
    #[arg(long, value_name = "X.Y.Z", default_value = "1.0.0", value_parser = version)]
    data_version: String,
    /// What the data are, in a sentence or two. This and what follows has a default for generated data.
    #[arg(long, value_name = "TEXT", value_parser = line)]
    description: Option<String>,
    /// How the data came to be; needed of an imported capture.
    #[arg(long, value_name = "TEXT", value_parser = line)]
    collection: Option<String>,
    /// What the data tell of persons; needed of an imported capture.
    #[arg(long, value_name = "TEXT", value_parser = line)]
    sensitive: Option<String>,
    /// Whether any of the data is simulated; needed of an imported capture.
    #[arg(long, value_name = "true|false")]
    synthetic: Option<bool>,
    /// What the data are not fit for.
    #[arg(long, value_name = "TEXT", value_parser = line)]
    limitations: Option<String>,
    /// What the data have too much or too little of.
    #[arg(long, value_name = "TEXT", value_parser = line)]
    biases: Option<String>,
    /// What the data are meant for.
    #[arg(long, value_name = "TEXT", value_parser = line)]
    uses: Option<String>,
    /// What their use may do.
    #[arg(long, value_name = "TEXT", value_parser = line)]
    impact: Option<String>,
    #[command(flatten)]
    verify: Verify,
}

/// A line of text.
fn line(text: &str) -> Result<String, String> {
    let text = text.trim();
    if text.is_empty() || text.chars().any(char::is_control) {
        return Err("give one line of text".to_owned());
    }
    Ok(text.to_owned())
}

fn address(text: &str) -> Result<String, String> {
    let text = line(text)?;
    let host = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    if host.is_none_or(str::is_empty) || text.contains(|c: char| c.is_whitespace() || "\"<>{}\\".contains(c)) {
        return Err("give an address that begins with https://".to_owned());
    }
    Ok(text)
}

/// A day of the calendar.
fn day(text: &str) -> Result<String, String> {
    let help = || "give a day as YYYY-MM-DD".to_owned();
    let parts: Vec<&str> = text.split('-').collect();
    let [year, month, day] = parts.as_slice() else { return Err(help()) };
    let number = |part: &str, digits: usize| -> Option<u32> {
        (part.len() == digits && part.bytes().all(|b| b.is_ascii_digit())).then(|| part.parse().ok()).flatten()
    };
    let (Some(year), Some(month), Some(day)) = (number(year, 4), number(month, 2), number(day, 2)) else { return Err(help()) };
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let days = match month {
        2 if leap => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => 0,
    };
    if year == 0 || day == 0 || day > days { Err(help()) } else { Ok(text.to_owned()) }
}

fn version(text: &str) -> Result<String, String> {
    let parts: Vec<&str> = text.split('.').collect();
    let is_number = |part: &&str| !part.is_empty() && part.len() < 10 && part.bytes().all(|b| b.is_ascii_digit());
    if parts.len() == 3 && parts.iter().all(is_number) {
        Ok(text.to_owned())
    } else {
        Err("give three numbers, e.g. 1.0.0".to_owned())
    }
}

impl Publish {
    /// Runs the command.
    ///
    /// # Errors
    /// A data set that cannot be read, answers that are missing, an occupied output folder, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        keep_apart("--out", &self.out, &[Reads::Folder(&self.folder)])?;
        let Input { dataset, verified, .. } = self.verify.open(&self.folder)?;
        if !verified {
            let what = "hashes are published, and would not be known to be the data's";
            return Err(Error::invalid("--no-verify", what, "leave it out").into());
        }
        let statement = PublicationStatement {
            title: self.title.unwrap_or_else(|| dataset.header().name.clone()),
            authors: self.author,
            licence: self.licence,
            url: self.url,
            date: self.date,
            version: self.data_version,
            description: self.description,
            answers: Answers {
                collection: self.collection,
                sensitive: self.sensitive,
                limitations: self.limitations,
                biases: self.biases,
                uses: self.uses,
                impact: self.impact,
                synthetic: self.synthetic,
            },
        };
        let publication = Publication::new(&dataset, statement)?;
        let folder = claim_fresh(&self.out)?;
        publication.write(folder.path())?;
        folder.finish()?;
        let missing = publication.missing();
        if !missing.is_empty() {
            note!("croissant.json and CITATION.cff lack what venues ask for: give {} once it is known", missing.join(" and "));
        }
        let text = format!("{} in {}", publication.summary(), self.out.display());
        show(json, &serde_json::json!({ "keyframes": dataset.len(), "hash": dataset.hash(), "out": self.out }), &text)?;
        Ok(Verdict::Done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_versions_and_addresses_are_checked() {
        for good in ["2026-11-29", "2024-02-29", "2000-02-29"] {
            assert!(day(good).is_ok(), "{good}");
        }
        for bad in [
            "2026-02-29",
            "1900-02-29",
            "2026-13-01",
            "2026-1-1",
            "2026-04-31",
            "26-01-01",
            "2026-00-10",
            "2026-01-00",
            "0000-01-01",
            "",
        ] {
            assert!(day(bad).is_err(), "{bad}");
        }
        assert!(version("1.0.0").is_ok() && ["1.0", "1..0", "v1.0.0", "1.0.0.0"].iter().all(|bad| version(bad).is_err()));
        assert!(
            address("https://example.org/a").is_ok()
                && ["example.org", "https://", "https://a b"].iter().all(|bad| address(bad).is_err())
        );
    }
}
