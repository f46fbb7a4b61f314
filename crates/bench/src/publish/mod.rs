//! A data set in the forms in which data sets are published: Parquet shards, a card, Croissant metadata, licence, citation, a contact sheet.
//!
//! ```text
//! PUB/README.md            Hugging Face's card, whose head names the shards
//! PUB/croissant.json       Croissant 1.1 with the minimal Responsible-AI fields
//! PUB/CITATION.cff  LICENSE
//! PUB/contact-sheet.png    images and spectra along the way
//! PUB/data/*.parquet       a row a keyframe, by split
//! PUB/dataset/             the data set itself, file by file: depth and other rasters, and what `corf` opens
//! ```

mod card;
mod contact_sheet;
mod croissant;
mod licence;
mod shards;

use corf_scene::words::counted;
pub use licence::Licence;

use crate::split::{Protocol, Split};
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::Result;
use corf_scene::Error;
use corf_scene::dataset::Dataset;
use corf_scene::io::{read, sha256_hex, write_atomic};
use std::path::Path;

/// What the author of a publication says of it.
#[derive(Clone, Debug)]
pub struct PublicationStatement {
    /// Name, in one line.
    pub title: String,
    /// Who made the data, one at least.
    pub authors: Vec<Author>,
    /// Licence of the data.
    pub licence: Licence,
    /// Where it will be found.
    pub url: Option<String>,
    /// Day of publication, `YYYY-MM-DD`.
    pub date: Option<String>,
    /// Version of the data, three numbers.
    pub version: String,
    /// What it is, in a paragraph.
    pub description: Option<String>,
    /// Answers to what only its maker knows; a generated data set has them of its own.
    pub answers: Answers,
}

/// What a reader has to know before use, in words.
#[derive(Clone, Debug, Default)]
pub struct Answers {
    /// How the data came to be.
    pub collection: Option<String>,
    /// What it tells of persons.
    pub sensitive: Option<String>,
    /// What it is not fit for.
    pub limitations: Option<String>,
    /// What it has too much or too little of.
    pub biases: Option<String>,
    /// What it is meant for.
    pub uses: Option<String>,
    /// What its use may do.
    pub impact: Option<String>,
    /// Whether any of it is simulated.
    pub synthetic: Option<bool>,
}

/// A person or an institution.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Author {
    /// A person.
    Person {
        /// Family name.
        family: String,
        /// Given names.
        given: String,
    },
    /// An institution, or whoever has one name.
    Entity(String),
}

impl Author {
    /// Of `Family, Given`, or one name.
    fn of(text: &str) -> Option<Self> {
        let text = text.trim();
        match text.split_once(',').map(|(family, given)| (family.trim(), given.trim())) {
            Some((family, given)) if !family.is_empty() && !given.is_empty() => {
                Some(Self::Person { family: family.to_owned(), given: given.to_owned() })
            }
            None if !text.is_empty() => Some(Self::Entity(text.to_owned())),
            _ => None,
        }
    }

    /// As it is spoken.
    fn name(&self) -> String {
        match self {
            Self::Person { family, given } => format!("{given} {family}"),
            Self::Entity(name) => name.clone(),
        }
    }
}

impl std::str::FromStr for Author {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::of(text).ok_or_else(|| format!("\"{text}\" is no author: give \"Family, Given\", or the name of an institution"))
    }
}

/// A data set about to be published.
pub struct Publication<'d> {
    dataset: &'d Dataset,
    statement: PublicationStatement,
    splits: Vec<NamedSplit>,
    validation: Vec<usize>,
}

/// A split under the name that readers know it by.
struct NamedSplit {
    name: &'static str,
    /// Indices from 0, rising.
    keyframes: Vec<usize>,
}

/// A file of a publication.
struct Published {
    /// Below its folder, with forward slashes.
    path: String,
    bytes: u64,
    sha256: String,
}

impl<'d> Publication<'d> {
    /// Prepares it.
    ///
    /// # Errors
    /// An imported capture without the answers that only its maker knows; values of which the data set has none.
    pub fn new(dataset: &'d Dataset, statement: PublicationStatement) -> Result<Self> {
        let missing: Vec<&str> = [
            ("--collection", statement.answers.collection.is_none()),
            ("--sensitive", statement.answers.sensitive.is_none()),
            ("--synthetic", statement.answers.synthetic.is_none()),
        ]
        .into_iter()
        .filter_map(|(flag, missing)| missing.then_some(flag))
        .collect();
        if dataset.header().imported.is_some() && !missing.is_empty() {
            let what = "it was imported, and only its maker knows how it came to be, what it tells of persons, and whether it is simulated";
            return Err(
                Error::invalid(dataset.dir().display().to_string(), what, format!("say so with {}", missing.join(", "))).into()
            );
        }
        let (train, test) = (dataset.train_indices().to_vec(), dataset.test_indices().to_vec());
        let rest = (0..dataset.len()).filter(|i| !train.contains(i) && !test.contains(i)).collect();
        let splits = [("train", train), ("test", test), ("unused", rest)];
        let splits = splits.into_iter().filter(|(_, keyframes)| !keyframes.is_empty());
        let splits = splits.map(|(name, keyframes)| NamedSplit { name, keyframes }).collect();
        // A data set too short for the protocol has no such keyframes.
        let validation = Split::of(dataset, Protocol::VALIDATION).map(|split| split.held_out).unwrap_or_default();
        Ok(Self { dataset, statement, splits, validation })
    }

    /// Writes all of it below `folder`.
    ///
    /// # Errors
    /// A file that cannot be read or written, an interrupt.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let put = |path: &str, bytes: &[u8]| -> Result<Published> {
            write_atomic(folder.join(path), bytes)?;
            Ok(Published { path: path.to_owned(), bytes: bytes.len() as u64, sha256: sha256_hex(bytes) })
        };
        let own: Vec<&str> = self.dataset.listed_files().map(|(path, ..)| path).chain(["dataset.json"]).collect();
        let shards = self.shards()?;
        let total = own.len() + shards.len();
        let mut progress = Progress::start(format!("publication of {}", self.dataset.header().name), total, "files");
        let mut published = Vec::new();
        for (i, shard) in shards.iter().enumerate() {
            interrupt::check()?;
            published.push(put(&shard.path, &self.encode(shard)?)?);
            progress.set(i + 1, total);
        }
        for (i, path) in own.iter().enumerate() {
            interrupt::check()?;
            let bytes = read(self.dataset.own_file(path)?)?;
            let file = put(&format!("dataset/{path}"), &bytes)?;
            if !path.contains('/') {
                published.push(file);
            }
            progress.set(shards.len() + i + 1, total);
        }
        progress.finish();
        published.push(put("contact-sheet.png", &self.contact_sheet()?)?);
        put("croissant.json", &serde_json::to_vec_pretty(&self.croissant(&published))?)?;
        put("README.md", self.card().as_bytes())?;
        put("CITATION.cff", self.citation().as_bytes())?;
        put("LICENSE", self.statement.licence.text().as_bytes())?;
        Ok(())
    }

    /// Keyframes, shards and splits, in words.
    pub fn summary(&self) -> String {
        let splits: Vec<String> = self.splits.iter().map(|s| format!("{} {}", s.keyframes.len(), s.name)).collect();
        format!("{} ({})", counted(self.dataset.len(), "keyframe"), splits.join(", "))
    }

    /// Flags without which a venue misses something, that were not given.
    pub fn missing(&self) -> Vec<&'static str> {
        let given = [("--date", self.statement.date.is_some()), ("--url", self.statement.url.is_some())];
        given.into_iter().filter_map(|(flag, given)| (!given).then_some(flag)).collect()
    }

    fn role(&self, index: usize) -> &'static str {
        self.splits.iter().find(|split| split.keyframes.contains(&index)).map_or("unused", |split| split.name)
    }

    /// How the data came to be, and what a reader has to know: the author's answers, of a generated data set its own where none was given.
    fn answers(&self) -> Answers {
        let header = self.dataset.header();
        let given = self.statement.answers.clone();
        if header.imported.is_some() {
            return given;
        }
        let carrier = header.frequency_hz.map_or("radio".to_owned(), |f| format!("{} GHz", f / 1e9));
        let own = |text: &str| Some(text.to_owned());
        Answers {
            collection: given.collection.or(Some(format!(
                "Simulated by {} at the poses of a trajectory through a three-dimensional scene: images by tracing light, angular power spectra at \
                 {carrier} by tracing radio. No sensor took part. Scene, materials, settings, seed and conventions are in dataset/dataset.json.",
                self.dataset.generator()
            ))),
            sensitive: given.sensitive.or(own(
                "None by way of a sensor: a scene of meshes and materials was traced, and no person took part. Textures of the scene are shown as they are.",
            )),
            limitations: given.limitations.or(own(
                "One static scene and one trajectory; materials have one set of constants each; no noise, no interference, nothing that moves, no \
                 impairments of a receiver. Results on it say nothing of measured channels by themselves. Depth and surfaces, where they are \
                 given, are the ray tracer's ground truth, and a method that reads them has used it.",
            )),
            biases: given.biases.or(own("One way through one scene: places and directions that it passes often are seen more than others.")),
            uses: given.uses.or(own(
                "Reconstruction of radiance fields of light and radio, prediction of angular spectra, beams and rates at a camera's pose, and \
                 comparison of such methods on the held-out keyframes of the given split.",
            )),
            impact: given.impact.or(own(
                "Methods can be compared without recording rooms that people live in. Methods that see with radio could be used to watch people; \
                 nothing in these data shows how.",
            )),
            synthetic: given.synthetic.or(Some(true)),
        }
    }

    /// What it is, in a paragraph.
    fn description(&self) -> String {
        if let Some(text) = &self.statement.description {
            return text.clone();
        }
        let (header, has) = (self.dataset.header(), self.dataset.modalities());
        let (light, radio) = (self.dataset.light_camera(), self.dataset.radio_camera());
        let mut parts = Vec::new();
        if has.light {
            parts.push(format!("an image of {} x {} pixels", light.width, light.height));
        }
        if has.radio {
            let carrier = header.frequency_hz.map(|f| format!(" at {} GHz", f / 1e9)).unwrap_or_default();
            parts.push(format!("an angular power spectrum{carrier} of {} x {} directions", radio.width, radio.height));
        }
        // Of a capture nobody here knows what it went through.
        let along = if header.imported.is_some() { "of a capture" } else { "along a way through a room" };
        let keyframes = counted(self.dataset.len(), "keyframe");
        format!("{keyframes} {along}, each with {} and its pose.", parts.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn authors_are_persons_or_have_one_name() {
        let person = Author::Person { family: "van Doe".into(), given: "Jane Q.".into() };
        assert_eq!("van Doe, Jane Q.".parse(), Ok(person.clone()));
        assert_eq!((person.name(), "The Lab".parse()), ("Jane Q. van Doe".into(), Ok(Author::Entity("The Lab".into()))));
        for bad in ["", "  ", "Doe,", ", Jane"] {
            assert!(bad.parse::<Author>().is_err(), "{bad:?}");
        }
    }
}
