//! Plans: which rows, which seeds, on which dataset. A plan is data; the cells it names are run one by one and can be resumed.

use crate::files::json::read_text;
use crate::methods::corf_array::ORACLE_SCENE;
use crate::split::Protocol;
use anyhow::{Context, Result, bail};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A plan file.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Name of the comparison.
    pub name: String,
    /// A paragraph on what the comparison is for and how to read it.
    #[serde(default)]
    pub analysis: String,
    /// Dataset folder, relative to the plan file.
    pub dataset: PathBuf,
    /// Machine that the plan is meant for, in words: what the rows' `seconds` are of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<String>,
    /// Evaluation protocol, which gives the training and the held-out split: `validation`, `test`, `segment`, or blocks, of which every fold is
    /// run: `trajectory:parts=5,gap_keyframes=4`, `along-y:parts=5,gap_m=0.1`, `k-means:parts=10,gap_m=0.05,seed=0`.
    #[serde(default)]
    pub protocol: Protocol,
    /// Whether every cell is run once more with the contiguous segment held out, into the folder `segment`. Default: no.
    #[serde(default)]
    pub segment: bool,
    /// Columns of the tables, every word that `corf bench table --help` lists: keys of metrics, `short`, `radio`, `all`, `delta`, `-time` … Default:
    /// `short`. Differences are those of the metric that is named first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub columns: Vec<String>,
    /// Evaluate fields at work on the held-out keyframes after every so many keyframes (steps of methods that work in steps), for the report's
    /// curves of quality over time; rows of methods without such a field have none. The evaluations are none of the seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evaluate_every: Option<std::num::NonZeroUsize>,
    /// Seeds; every row is run with each, unless it says how many.
    pub seeds: Vec<u64>,
    /// Rows of the table, in order. Differences are taken to the first.
    #[serde(rename = "row")]
    pub rows: Vec<PlanRow>,
}

/// A row of a plan.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanRow {
    /// Label in the table.
    pub label: String,
    /// Where the row's numbers come from.
    #[serde(default, skip_serializing_if = "RowKind::is_method")]
    pub kind: RowKind,
    /// Method id, of a row of the kind `method`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub method: String,
    /// Folder of predictions, of a row of the kind `predictions`: relative to the plan file. `{seed}` in it stands for the seed (without it the
    /// row has one cell, that of the first seed), `{protocol}` for the protocol, `{fold}` for the fold of blocks, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dir: Option<String>,
    /// Number of seeds that the row is run with, the first of the plan's: for a row that is too slow for all of them. Default: all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seeds: Option<usize>,
    /// Seconds that a cell of this row is reconstructed in on the plan's `machine`, as records have them; `corf bench plan` adds them up. Evaluation
    /// comes on top.
    /// Default: not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Whether the run folder of the row's first seed is kept, as `models/ROW`, for `corf view`, `corf render` and `corf evaluate`. Default: no.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keep_model: bool,
    /// Overrides of the method's configuration.
    #[serde(default)]
    #[schemars(with = "serde_json::Map<String, serde_json::Value>")]
    pub config: toml::Table,
}

/// Where the numbers of a row come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RowKind {
    /// A method of this program, which is run.
    #[default]
    Method,
    /// Another program's predictions, which are scored.
    Predictions,
}

impl RowKind {
    fn is_method(&self) -> bool {
        *self == Self::Method
    }
}

/// What stands for the seed in [`PlanRow::dir`], …
const SEED: &str = "{seed}";
/// … what for the protocol, …
const PROTOCOL: &str = "{protocol}";
/// … and what for the fold.
const FOLD: &str = "{fold}";

/// Longest time of a cell that is believed, seconds: a month.
const MOST_SECONDS: f64 = 31.0 * 86_400.0;

/// Word in the label of every row that knows the true scene.
const ORACLE: &str = "oracle";

impl PlanRow {
    /// Paths of the row, of predictions and of an oracle's scene, each put through `change`.
    fn change_paths(&mut self, change: impl Fn(&Path) -> Result<PathBuf>) -> Result<()> {
        if let Some(dir) = &mut self.dir {
            *dir = text_of(&change(Path::new(dir))?)?;
        }
        if let Some(toml::Value::String(scene)) = self.config.get_mut(ORACLE_SCENE) {
            *scene = text_of(&change(Path::new(scene))?)?;
        }
        Ok(())
    }

    /// A row of a method.
    pub fn of_method(label: String, method: String, config: toml::Table) -> Self {
        Self { label, kind: RowKind::Method, method, dir: None, seeds: None, seconds: None, keep_model: false, config }
    }

    /// The folder of predictions of a seed under a protocol; `None` for a method's row.
    pub fn folder(&self, seed: u64, protocol: Protocol) -> Option<PathBuf> {
        let dir = self.dir.as_ref()?;
        let fold = protocol.fold().map_or(String::new(), |fold| fold.to_string());
        Some(
            dir.replace(SEED, &seed.to_string())
                .replace(PROTOCOL, &protocol.of_all_folds().file_name())
                .replace(FOLD, &fold)
                .into(),
        )
    }

    /// Whether it has one cell, however many seeds the plan has.
    pub fn is_single(&self) -> bool {
        self.dir.as_ref().is_some_and(|dir| !dir.contains(SEED))
    }

    /// The seeds that it is run with, of a plan's.
    fn seeds<'p>(&self, of_plan: &'p [u64]) -> &'p [u64] {
        let wanted = if self.is_single() { 1 } else { self.seeds.unwrap_or(of_plan.len()) };
        &of_plan[..wanted.min(of_plan.len())]
    }

    /// Checks what the row's kind asks for.
    fn check(&self, protocol: Protocol, segment: bool, seeds: usize) -> Result<()> {
        if let Some(wanted) = self.seeds.filter(|wanted| !(1..=seeds).contains(wanted)) {
            bail!(
                "seeds = {wanted}, and the plan has {seeds}\n  help: a row is run with the first of the plan's seeds, one at least"
            );
        }
        if let Some(seconds) = self.seconds.filter(|seconds| !(*seconds > 0.0 && *seconds <= MOST_SECONDS)) {
            bail!(
                "seconds = {seconds} is no time that a cell takes\n  help: give seconds above 0, up to {MOST_SECONDS}, or leave it out"
            );
        }
        match (self.kind, &self.dir) {
            (RowKind::Method, None) => {
                let method = crate::methods::create(&self.method, &self.config, &crate::device::Backend::Cpu)?;
                if method.uses_scene() && !self.label.to_lowercase().contains(ORACLE) {
                    bail!(
                        "it knows the true scene, and its label does not say so\n  help: put the word \"{ORACLE}\" into the label"
                    );
                }
            }
            (RowKind::Method, Some(_)) => {
                bail!("dir belongs to rows of kind = \"predictions\"\n  help: add the kind, or leave dir out")
            }
            (RowKind::Predictions, None) => {
                bail!("a row of kind = \"predictions\" needs dir\n  help: name the folder of predictions")
            }
            (RowKind::Predictions, Some(_)) if !self.method.is_empty() || !self.config.is_empty() || self.keep_model => {
                bail!(
                    "predictions are scored as they are: method, config and keep_model have no meaning here\n  help: leave them out"
                )
            }
            (RowKind::Predictions, Some(dir)) if segment && !dir.contains(PROTOCOL) => bail!(
                "segment = true needs predictions of the segment as well, by a model that has not seen it\n  help: put {PROTOCOL} into dir; it \
                 stands for test and for segment"
            ),
            (RowKind::Predictions, Some(dir)) if protocol.folds().len() > 1 && !dir.contains(FOLD) => bail!(
                "every fold needs predictions by a model that has not seen its block\n  help: put {FOLD} into dir; it stands for the fold's number, \
                 from 1"
            ),
            (RowKind::Predictions, Some(dir))
                if protocol.fold().is_none() && protocol.folds().len() == 1 && dir.contains(FOLD) =>
            {
                bail!("the protocol {protocol} has no folds\n  help: leave {FOLD} out of dir")
            }
            (RowKind::Predictions, Some(_)) => {}
        }
        Ok(())
    }
}

/// One cell of a plan.
#[derive(Clone, Copy, Debug)]
pub struct Cell<'a> {
    /// Its row.
    pub row: &'a PlanRow,
    /// Its seed.
    pub seed: u64,
    /// Its protocol: the plan's, with a fold where the plan has folds.
    pub split: Protocol,
}

impl Plan {
    /// Reads and checks a plan; its paths become relative to the working directory.
    ///
    /// # Errors
    /// A file that cannot be read or parsed (line and key are named), no seeds, no rows, a label used twice, an unknown method or key.
    pub fn load(path: &Path) -> Result<Self> {
        let text = read_text(path).context("cannot read the plan")?;
        let mut plan = Self::parse(&text).with_context(|| format!("in plan {}", path.display()))?;
        if let Some(folder) = path.parent() {
            plan.dataset = folder.join(&plan.dataset);
            plan.rows.iter_mut().try_for_each(|row| row.change_paths(|path| Ok(folder.join(path))))?;
        }
        Ok(plan)
    }

    /// Makes the plan's paths absolute, so that it can be kept elsewhere.
    ///
    /// # Errors
    /// When there is no working directory.
    pub fn make_absolute(&mut self) -> Result<()> {
        self.dataset = std::path::absolute(&self.dataset)?;
        self.rows.iter_mut().try_for_each(|row| row.change_paths(|path| Ok(std::path::absolute(path)?)))
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
        if plan.protocol == Protocol::ALL {
            bail!(
                "protocol = \"all\" leaves no keyframe to evaluate\n  help: choose \"test\", \"validation\", \"segment\" or blocks"
            );
        }
        if plan.segment && plan.protocol != Protocol::TEST {
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
            row.check(plan.protocol, plan.segment, plan.seeds.len()).with_context(|| format!("row \"{}\"", row.label))?;
        }
        crate::table::columns(&plan.columns).context("columns")?;
        Ok(plan)
    }

    /// All cells, row by row, seed by seed, fold by fold; predictions of one run have one cell, for a value told several times is one value.
    pub fn cells(&self) -> impl Iterator<Item = Cell<'_>> {
        let folds = self.protocol.folds();
        let of_seed = move |row, seed| folds.clone().into_iter().map(move |split| Cell { row, seed, split });
        self.rows.iter().flat_map(move |row| {
            let of_seed = of_seed.clone();
            row.seeds(&self.seeds).iter().flat_map(move |&seed| of_seed(row, seed))
        })
    }

    /// Seconds that some cells, each named by the label of its row, take on the plan's machine, and how many of them are in rows that do not say.
    pub fn expected_s<'l>(&self, labels: impl Iterator<Item = &'l str>) -> (f64, usize) {
        labels.fold((0.0, 0), |(seconds, unknown), label| {
            match self.rows.iter().find(|row| row.label == label).and_then(|row| row.seconds) {
                Some(more) => (seconds + more, unknown),
                None => (seconds, unknown + 1),
            }
        })
    }

    /// All cells with their places in [`Self::cells`], in the order in which they are run: every row with the first seed, then every row with
    /// the second, so that a machine that slows down slows all rows down.
    pub fn interleaved(&self) -> Vec<(usize, Cell<'_>)> {
        let mut order: Vec<(usize, Cell<'_>)> = self.cells().enumerate().collect();
        order.sort_by_key(|(_, cell)| (self.seeds.iter().position(|seed| *seed == cell.seed), cell.split.fold()));
        order
    }
}

/// A path as text of a plan.
fn text_of(path: &Path) -> Result<String> {
    path.to_str()
        .map(str::to_owned)
        .with_context(|| format!("{} cannot be written into a plan\n  help: it is no UTF-8", path.display()))
}

impl Cell<'_> {
    /// What it is of beside its row, for messages: `seed 1`, `seed 1, fold 2`.
    pub fn which(&self) -> String {
        let fold = self.split.fold().map_or(String::new(), |fold| format!(", fold {fold}"));
        format!("seed {}{fold}", self.seed)
    }

    /// The cell's file stem.
    pub fn stem(&self) -> String {
        stem(&slug(&self.row.label), self.seed, self.split)
    }
}

/// File stem of a row's cell; `row` is the slug of its label.
pub fn stem(row: &str, seed: u64, split: Protocol) -> String {
    let fold = split.fold().map_or(String::new(), |fold| format!("-fold{fold}"));
    format!("{row}-seed{seed}{fold}")
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
    fn rows_of_predictions_have_a_folder_and_a_cell_for_each_that_is_there() {
        let head = "name='x'\ndataset='d'\nseeds=[3, 5]\n";
        let row = |more: &str| format!("[[row]]\nlabel='theirs'\nkind='predictions'\n{more}\n");
        let plan = Plan::parse(&format!("{head}{}", row("dir='them/{seed}/{protocol}'"))).unwrap();
        let folders: Vec<_> = plan.cells().map(|c| c.row.folder(c.seed, Protocol::SEGMENT).unwrap()).collect();
        assert_eq!(folders, [PathBuf::from("them/3/segment"), PathBuf::from("them/5/segment")]);
        let plan = Plan::parse(&format!("{head}{}", row("dir='them'"))).unwrap();
        assert_eq!(plan.cells().map(|c| c.seed).collect::<Vec<_>>(), [3], "one run is one value");
        let kept = Plan::parse(&toml::to_string(&plan).unwrap()).unwrap();
        assert_eq!(kept.rows[0].dir.as_deref(), Some("them"));
        for (text, said) in [
            (format!("{head}{}", row("")), "needs dir"),
            (format!("{head}{}", row("dir='a'\nmethod='nearest'")), "no meaning"),
            (format!("{head}{}", row("dir='a'\n[row.config]\nx=1")), "no meaning"),
            (format!("{head}segment=true\n{}", row("dir='a'")), "{protocol}"),
            (format!("{head}[[row]]\nlabel='a'\nmethod='nearest'\ndir='b'\n"), "kind"),
            (format!("{head}columns=['psnr']\n{}", row("dir='a'")), "psnr_opt"),
        ] {
            let error = format!("{:#}", Plan::parse(&text).unwrap_err());
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn a_row_that_knows_the_scene_says_that_it_is_an_oracle_and_finds_the_scene_beside_the_plan() {
        let plan = |label: &str| {
            let row = format!("label='{label}'\nmethod='corf-array'\nconfig={{ oracle_scene = 'lobby.toml' }}\n");
            format!("name='x'\ndataset='d'\nseeds=[1]\n[[row]]\n{row}")
        };
        let error = format!("{:#}", Plan::parse(&plan("CORF-Array, true images")).unwrap_err());
        assert!(error.contains("row \"CORF-Array, true images\"") && error.contains("the word \"oracle\""), "{error}");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("plan.toml");
        std::fs::write(&file, plan("CORF-Array, true images (Oracle)")).unwrap();
        let plan = Plan::load(&file).unwrap();
        assert_eq!(plan.rows[0].config["oracle_scene"].as_str(), folder.path().join("lobby.toml").to_str());
    }

    #[test]
    fn rows_take_turns_seed_by_seed() {
        let rows = "[[row]]\nlabel='a'\nmethod='nearest'\n[[row]]\nlabel='b'\nkind='predictions'\ndir='x'\n[[row]]\nlabel='c'\nmethod='nearest'\n";
        let plan = Plan::parse(&format!("name='x'\ndataset='d'\nseeds=[5, 3]\n{rows}")).unwrap();
        let order: Vec<_> = plan.interleaved().iter().map(|(at, c)| (*at, c.row.label.as_str(), c.seed)).collect();
        assert_eq!(order, [(0, "a", 5), (2, "b", 5), (3, "c", 5), (1, "a", 3), (4, "c", 3)]);
    }

    #[test]
    fn a_slow_row_is_run_with_the_first_seeds_alone() {
        let plan = |n: usize| {
            let rows = format!("[[row]]\nlabel='a'\nmethod='nearest'\n[[row]]\nlabel='slow'\nmethod='nearest'\nseeds={n}\n");
            Plan::parse(&format!("name='x'\ndataset='d'\nseeds=[5, 3, 8]\n{rows}"))
        };
        let cells: Vec<_> = plan(2).unwrap().cells().map(|c| (c.row.label.clone(), c.seed)).collect();
        let expected = [("a", 5), ("a", 3), ("a", 8), ("slow", 5), ("slow", 3)].map(|(label, seed)| (label.to_owned(), seed));
        assert_eq!(cells, expected);
        for wrong in [0, 4] {
            assert!(format!("{:#}", plan(wrong).unwrap_err()).contains("the plan has 3"));
        }
    }

    #[test]
    fn labels_become_file_names() {
        assert_eq!(slug("CORF-GS (w/o prior, dB)"), "corf-gs-w-o-prior-db");
    }
}
