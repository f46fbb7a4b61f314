//! Plans: which rows, which seeds, on which dataset. A plan is data; the cells it names are run one by one and can be resumed.

use crate::split::Protocol;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A plan file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Name of the comparison.
    pub name: String,
    /// A paragraph on what the comparison is for and how to read it.
    #[serde(default)]
    pub analysis: String,
    /// Dataset folder, relative to the plan file.
    pub dataset: PathBuf,
    /// Evaluation protocol, which gives the training and the held-out split: `validation`, `test` or `segment`.
    #[serde(default)]
    pub protocol: Protocol,
    /// Whether every cell is run once more with the contiguous segment held out, into the folder `segment`. Default: no.
    #[serde(default)]
    pub segment: bool,
    /// Seeds; every row is run with each.
    pub seeds: Vec<u64>,
    /// Rows of the table, in order. Differences are taken to the first.
    #[serde(rename = "row")]
    pub rows: Vec<PlanRow>,
}

/// A row of a plan.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanRow {
    /// Label in the table.
    pub label: String,
    /// Method id.
    pub method: String,
    /// Overrides of the method's configuration.
    #[serde(default)]
    pub config: toml::Table,
}

/// One cell of a plan.
#[derive(Clone, Copy, Debug)]
pub struct Cell<'a> {
    /// Its row.
    pub row: &'a PlanRow,
    /// Its seed.
    pub seed: u64,
}

impl Plan {
    /// Reads and checks a plan; the dataset's path becomes relative to the working directory.
    ///
    /// # Errors
    /// A file that cannot be read or parsed (line and key are named), no seeds, no rows, a label used twice, an unknown method or key.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read plan {}", path.display()))?;
        let mut plan = Self::parse(&text).with_context(|| format!("in plan {}", path.display()))?;
        if let Some(folder) = path.parent() {
            plan.dataset = folder.join(&plan.dataset);
        }
        Ok(plan)
    }

    /// Parses and checks a plan's text.
    ///
    /// # Errors
    /// Those of [`Self::load`].
    pub fn parse(text: &str) -> Result<Self> {
        let plan: Self = toml::from_str(text)?;
        if plan.seeds.is_empty() || plan.rows.is_empty() {
            bail!("a plan needs at least one seed and one [[row]]");
        }
        if plan.segment && plan.protocol != Protocol::Test {
            bail!("segment = true belongs to protocol = \"test\": the segment's keyframes are test keyframes too");
        }
        if let Some(seed) = plan.seeds.iter().enumerate().find_map(|(i, s)| plan.seeds[..i].contains(s).then_some(s)) {
            bail!("seed {seed} is listed twice\n  help: a seed run twice is one value, not two");
        }
        for (i, row) in plan.rows.iter().enumerate() {
            if slug(&row.label).is_empty() || row.label.contains(['|', '\n']) {
                bail!("the label \"{}\" cannot name files and table rows\n  help: use letters or digits, and no |", row.label);
            }
            if plan.rows[..i].iter().any(|r| slug(&r.label) == slug(&row.label)) {
                bail!("two rows have the label \"{}\"\n  help: labels name files and must differ", row.label);
            }
            crate::methods::create(&row.method, &row.config, &crate::device::Backend::Cpu)
                .with_context(|| format!("row \"{}\"", row.label))?;
        }
        Ok(plan)
    }

    /// All cells, row by row.
    pub fn cells(&self) -> impl Iterator<Item = Cell<'_>> {
        self.rows.iter().flat_map(|row| self.seeds.iter().map(move |&seed| Cell { row, seed }))
    }
}

impl Cell<'_> {
    /// The cell's file stem.
    pub fn stem(&self) -> String {
        format!("{}-seed{}", slug(&self.row.label), self.seed)
    }
}

/// A label as a file name: lower case letters, digits and hyphens.
pub fn slug(label: &str) -> String {
    let mut slug = String::new();
    for c in label.chars() {
        if c.is_ascii_alphanumeric() {
            slug.push(c.to_ascii_lowercase());
        } else if !slug.ends_with('-') && !slug.is_empty() {
            slug.push('-');
        }
    }
    slug.trim_end_matches('-').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_typo_is_named() {
        let text =
            "name='x'\ndataset='d'\nseeds=[1]\n[[row]]\nlabel='a'\nmethod='corf-gs'\n[row.config]\niterations_per_keyframes=3\n";
        let error = format!("{:#}", Plan::parse(text).unwrap_err());
        assert!(error.contains("iterations_per_keyframes"), "{error}");
        let error = format!("{:#}", Plan::parse("name='x'\ndatasett='d'\nseeds=[1]\nrow=[]").unwrap_err());
        assert!(error.contains("datasett"), "{error}");
    }

    #[test]
    fn labels_become_file_names() {
        assert_eq!(slug("CORF-GS (w/o prior, dB)"), "corf-gs-w-o-prior-db");
    }
}
