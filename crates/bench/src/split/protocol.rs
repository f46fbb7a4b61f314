//! Names of protocols: what is held out, and how dense what is left is.
//!
//! ```text
//! validation | test | segment | all
//! trajectory:parts=5,gap_keyframes=4[,fold=2]          contiguous segments of the trajectory
//! along-x | along-y | along-z:parts=5,gap_m=0.1        slabs of equally many keyframes along an axis
//! k-means:parts=10,gap_m=0.05,seed=0                   clusters of positions
//! …,evaluated=validation                               the block behind the held-out one instead, which is then left out
//! …,spacing=4                                          training keyframes at one remainder by four alone
//! ```

use crate::split::blocks::{Blocks, By, Gap};
use anyhow::{Context, Result, bail, ensure};
use corf_scene::words::nearest;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;

/// Part of the keyframes that an evaluation may look at, and what trains. Constants are chosen on validation keyframes; what is published is under
/// `test`, `segment` and blocks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Protocol {
    /// What is evaluated.
    pub holdout: Holdout,
    /// Of so many neighbouring keyframes one trains, as far from the held-out ones as that allows (`test:spacing=4`).
    pub spacing: NonZeroUsize,
}

/// What is evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Holdout {
    /// Every `test_every`-th keyframe is left out altogether; of the rest, those half-way between two of them are evaluated and the others train.
    Validation,
    /// Every `test_every`-th keyframe is evaluated, all others train.
    Test,
    /// A contiguous segment of the trajectory is evaluated, all others train: what extrapolation costs.
    Segment,
    /// All keyframes train, and none is left to evaluate.
    All,
    /// One block after the other is evaluated, in a fold each.
    Blocks(Blocks),
}

/// Names without settings, …
const NAMED: [(&str, Holdout); 4] =
    [("validation", Holdout::Validation), ("test", Holdout::Test), ("segment", Holdout::Segment), ("all", Holdout::All)];
/// … and those of blocks.
const BLOCKS: [(&str, By); 5] = [
    ("trajectory", By::Trajectory),
    ("along-x", By::Axis(0)),
    ("along-y", By::Axis(1)),
    ("along-z", By::Axis(2)),
    ("k-means", By::KMeans { seed: 0 }),
];

impl Protocol {
    /// Every `test_every`-th keyframe evaluated.
    pub const TEST: Self = Self::of(Holdout::Test);
    /// Validation keyframes evaluated, test keyframes left out.
    pub const VALIDATION: Self = Self::of(Holdout::Validation);
    /// A contiguous segment evaluated.
    pub const SEGMENT: Self = Self::of(Holdout::Segment);
    /// Nothing evaluated.
    pub const ALL: Self = Self::of(Holdout::All);

    const fn of(holdout: Holdout) -> Self {
        Self { holdout, spacing: NonZeroUsize::MIN }
    }

    /// The protocol's name in plans and records, with its settings.
    pub fn name(self) -> String {
        self.to_string()
    }

    /// The same as part of a file's name.
    pub fn file_name(self) -> String {
        self.name().replace([':', ',', '='], "-")
    }

    /// The blocks, where there are some.
    pub fn blocks(self) -> Option<Blocks> {
        match self.holdout {
            Holdout::Blocks(blocks) => Some(blocks),
            _ => None,
        }
    }

    /// The protocols of its folds; itself where it has none or names one.
    pub fn folds(self) -> Vec<Self> {
        match self.holdout {
            Holdout::Blocks(blocks @ Blocks { fold: None, parts, .. }) => {
                let fold = |n| Self { holdout: Holdout::Blocks(Blocks { fold: Some(n), ..blocks }), ..self };
                (1..=parts).map(fold).collect()
            }
            _ => vec![self],
        }
    }

    /// The protocol of all folds of which it is one; itself where it is none.
    pub fn of_all_folds(self) -> Self {
        match self.holdout {
            Holdout::Blocks(blocks) => Self { holdout: Holdout::Blocks(Blocks { fold: None, ..blocks }), ..self },
            _ => self,
        }
    }

    /// The fold, counted from 1, where it names one.
    pub fn fold(self) -> Option<usize> {
        self.blocks()?.fold
    }

    /// The same with one of so many neighbouring keyframes.
    pub fn thinned(self, spacing: NonZeroUsize) -> Self {
        Self { spacing, ..self }
    }

    /// What has to be said of it under a table, a sentence that stands behind others; nothing of the usual protocol.
    pub fn note(self) -> String {
        let mut note = match self.holdout {
            Holdout::Validation => "Validation keyframes; test keyframes were neither trained with nor looked at.".to_owned(),
            Holdout::Segment => "A contiguous segment of the trajectory was held out.".to_owned(),
            Holdout::Test | Holdout::All => String::new(),
            Holdout::Blocks(blocks) => blocks.note(),
        };
        if self.spacing.get() > 1 {
            let space = if note.is_empty() { "" } else { " " };
            note += &format!("{space}Of every {} neighbouring keyframes one trained.", self.spacing);
        }
        note
    }

    /// The same as an object of "of": `its test keyframes held out`.
    pub fn held_out(self) -> String {
        let what = match self.holdout {
            Holdout::Test => "its test keyframes held out".to_owned(),
            Holdout::Validation => "its validation keyframes held out".to_owned(),
            Holdout::Segment => "a contiguous segment held out".to_owned(),
            Holdout::All => "no keyframe held out".to_owned(),
            Holdout::Blocks(blocks) => format!("blocks held out one after the other ({blocks})"),
        };
        if self.spacing.get() > 1 { format!("{what}, of every {} neighbours one trained", self.spacing) } else { what }
    }
}

impl Default for Protocol {
    fn default() -> Self {
        Self::TEST
    }
}

impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |holdout: &Holdout| NAMED.iter().find(|(_, named)| named == holdout).map_or("", |(name, _)| name);
        let settings = match &self.holdout {
            Holdout::Blocks(blocks) => {
                write!(f, "{blocks}")?;
                true
            }
            holdout => {
                f.write_str(name(holdout))?;
                false
            }
        };
        if self.spacing.get() > 1 {
            write!(f, "{}spacing={}", if settings { "," } else { ":" }, self.spacing)?;
        }
        Ok(())
    }
}

impl fmt::Display for Blocks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let by = match self.by {
            By::KMeans { .. } => By::KMeans { seed: 0 },
            by => by,
        };
        let name = BLOCKS.iter().find(|(_, known)| *known == by).map_or("", |(name, _)| name);
        write!(f, "{name}:parts={}", self.parts)?;
        match self.gap {
            Gap::Keyframes(n) => write!(f, ",gap_keyframes={n}")?,
            Gap::Metres(m) => write!(f, ",gap_m={m}")?,
        }
        if let By::KMeans { seed } = self.by {
            write!(f, ",seed={seed}")?;
        }
        if let Some(fold) = self.fold {
            write!(f, ",fold={fold}")?;
        }
        if self.validation {
            f.write_str(",evaluated=validation")?;
        }
        Ok(())
    }
}

/// Keys of a name, each to be taken once.
struct Keys<'t>(Vec<(&'t str, &'t str)>);

impl<'t> Keys<'t> {
    fn of(text: &'t str) -> Result<Self> {
        let mut keys: Vec<(&str, &str)> = Vec::new();
        for pair in text.split(',').map(str::trim).filter(|pair| !pair.is_empty()) {
            let (key, value) = pair.split_once('=').with_context(|| format!("\"{pair}\" is no key=value"))?;
            let (key, value) = (key.trim(), value.trim());
            ensure!(keys.iter().all(|(known, _)| *known != key), "{key} is there twice");
            keys.push((key, value));
        }
        Ok(Self(keys))
    }

    fn take<T: FromStr>(&mut self, key: &str, what: &str) -> Result<Option<T>> {
        let Some(at) = self.0.iter().position(|(known, _)| *known == key) else { return Ok(None) };
        let (_, value) = self.0.remove(at);
        value.parse().map(Some).map_err(|_| anyhow::anyhow!("{key}={value}: {what} is expected"))
    }
}

const HELP: &str = "write validation, test, segment, all, or blocks: trajectory:parts=5,gap_keyframes=4, along-y:parts=5,gap_m=0.1 (x, y or z), or \
                    k-means:parts=10,gap_m=0.05,seed=0";

impl FromStr for Protocol {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        parse(text).with_context(|| format!("protocol \"{text}\"")).map_err(|error| anyhow::anyhow!("{error:#}\n  help: {HELP}"))
    }
}

fn parse(text: &str) -> Result<Protocol> {
    let (name, settings) = text.split_once(':').unwrap_or((text, ""));
    let mut keys = Keys::of(settings)?;
    let spacing = keys.take("spacing", "a whole number from 1")?.unwrap_or(NonZeroUsize::MIN);
    let holdout = if let Some((_, holdout)) = NAMED.iter().find(|(known, _)| *known == name) {
        *holdout
    } else if let Some((_, by)) = BLOCKS.iter().find(|(known, _)| *known == name) {
        Holdout::Blocks(blocks(*by, &mut keys)?)
    } else {
        let known = NAMED.iter().map(|(name, _)| *name).chain(BLOCKS.iter().map(|(name, _)| *name));
        match nearest(name, known) {
            Some(meant) => bail!("it is none that is known; did you mean {meant}?"),
            None => bail!("it is none that is known"),
        }
    };
    if let Some((key, _)) = keys.0.first() {
        bail!("it has no key {key}");
    }
    ensure!(holdout != Holdout::All || spacing.get() == 1, "where all train, none is left out: it has no key spacing");
    Ok(Protocol { holdout, spacing })
}

fn blocks(by: By, keys: &mut Keys<'_>) -> Result<Blocks> {
    let parts = keys.take("parts", "a whole number")?.context("it needs parts, the number of blocks")?;
    ensure!((2..=1000).contains(&parts), "parts={parts}: 2 to 1000 blocks can be made");
    let keyframes: Option<usize> = keys.take("gap_keyframes", "a whole number")?;
    let metres: Option<f64> = keys.take("gap_m", "a number of metres")?;
    let gap = match (keyframes, metres) {
        (Some(_), Some(_)) => bail!("gap_keyframes and gap_m say one thing twice: give one of them"),
        (Some(_), None) if by != By::Trajectory => bail!("keyframes have an order along the trajectory alone: give gap_m"),
        (Some(n), None) => Gap::Keyframes(n),
        (None, Some(m)) if m >= 0.0 && m.is_finite() => Gap::Metres(m),
        (None, Some(m)) => bail!("gap_m={m}: a number of metres from 0 is expected"),
        (None, None) => bail!(
            "it needs a gap, within which keyframes neither train nor are evaluated: gap_m, or along the trajectory gap_keyframes; 0 for none"
        ),
    };
    let by = match by {
        By::KMeans { .. } => By::KMeans { seed: keys.take("seed", "a whole number")?.unwrap_or(0) },
        by => by,
    };
    let fold: Option<usize> = keys.take("fold", "a whole number from 1")?;
    ensure!(fold.is_none_or(|n| (1..=parts).contains(&n)), "fold={}: there are folds 1 to {parts}", fold.unwrap_or(0));
    let evaluated: Option<String> = keys.take("evaluated", "test or validation")?;
    let validation = match evaluated.as_deref() {
        None | Some("test") => false,
        Some("validation") => true,
        Some(other) => bail!("evaluated={other}: test or validation is expected"),
    };
    ensure!(
        !validation || parts > 2,
        "a block for tests, one for validation and one to train with are three: give parts=3 or more"
    );
    Ok(Blocks { by, parts, gap, fold, validation })
}

impl TryFrom<String> for Protocol {
    type Error = anyhow::Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

impl From<Protocol> for String {
    fn from(protocol: Protocol) -> Self {
        protocol.to_string()
    }
}

impl JsonSchema for Protocol {
    fn schema_name() -> Cow<'static, str> {
        "Protocol".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "type": "string",
            "description": "Part of the keyframes that an evaluation may look at: `validation`, `test`, `segment`, `all`, or blocks, of which one \
                            after the other is held out: `trajectory:parts=5,gap_keyframes=4`, `along-y:parts=5,gap_m=0.1`, \
                            `k-means:parts=10,gap_m=0.05,seed=0`, each with `fold=2` for one of the folds. With `spacing=4` one of four \
                            neighbouring keyframes trains.",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_comes_back_as_it_was_written() {
        for text in [
            "validation",
            "test",
            "segment",
            "all",
            "test:spacing=4",
            "trajectory:parts=5,gap_keyframes=4",
            "trajectory:parts=5,gap_m=0.25,fold=5,spacing=2",
            "along-y:parts=5,gap_m=0.1,fold=2",
            "k-means:parts=10,gap_m=0,seed=7,fold=1,evaluated=validation",
        ] {
            let protocol: Protocol = text.parse().unwrap();
            assert_eq!(protocol.name(), text);
            let json = serde_json::to_string(&protocol).unwrap();
            assert_eq!(json, format!("\"{text}\""));
            assert_eq!(serde_json::from_str::<Protocol>(&json).unwrap(), protocol);
            assert!(protocol.file_name().chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '.' || c == '_'));
        }
        // The seed of clusters is always written.
        assert_eq!("k-means:parts=3,gap_m=0".parse::<Protocol>().unwrap().name(), "k-means:parts=3,gap_m=0,seed=0");
    }

    #[test]
    fn what_is_no_protocol_is_told_so() {
        for (text, said) in [
            ("tests", "did you mean test?"),
            ("along-y:parts=5", "needs a gap"),
            ("along-y:gap_m=0", "needs parts"),
            ("along-y:parts=1,gap_m=0", "2 to 1000"),
            ("along-y:parts=5,gap_keyframes=2", "give gap_m"),
            ("trajectory:parts=5,gap_keyframes=2,gap_m=1", "one thing twice"),
            ("trajectory:parts=5,gap_m=-1", "metres from 0"),
            ("trajectory:parts=5,gap_m=nan", "metres from 0"),
            ("trajectory:parts=5,gap_keyframes=2,fold=6", "folds 1 to 5"),
            ("trajectory:parts=5,gap_keyframes=2,fold=0", "folds 1 to 5"),
            ("trajectory:parts=5,gap_keyframes=2,parts=6", "there twice"),
            ("along-x:parts=5,gap_m=0,seed=1", "no key seed"),
            ("trajectory:parts=2,gap_m=0,evaluated=validation", "parts=3"),
            ("test:spacing=0", "from 1"),
            ("all:spacing=2", "no key spacing"),
        ] {
            let error = text.parse::<Protocol>().unwrap_err().to_string();
            assert!(error.contains(said) && error.contains("help: ") && error.contains(text), "{text}: {error}");
        }
    }

    #[test]
    fn folds_are_those_of_one_protocol() {
        let whole: Protocol = "along-z:parts=3,gap_m=0.5,spacing=2".parse().unwrap();
        let folds = whole.folds();
        assert_eq!(folds.iter().map(|p| p.fold().unwrap()).collect::<Vec<_>>(), [1, 2, 3]);
        assert!(folds.iter().all(|fold| fold.of_all_folds() == whole && fold.folds() == [*fold]));
        assert_eq!((Protocol::TEST.folds(), Protocol::TEST.of_all_folds()), (vec![Protocol::TEST], Protocol::TEST));
    }
}
