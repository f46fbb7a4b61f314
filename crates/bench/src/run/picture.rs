//! The figure of one held-out keyframe beside its prediction, which a command is asked for by `--figure`.

use crate::charts::{self, ColourMap, Sensors};
use crate::files::separation::{Reads, keep_apart};
use crate::metrics::Halves;
use crate::split::Split;
use anyhow::{Context, Result, ensure};
use corf_scene::Keyframe;
use corf_scene::dataset::Dataset;
use corf_scene::io::write_atomic;
use std::path::{Path, PathBuf};

/// Ending of the file.
const ENDING: &str = "svg";

/// The figure, asked for, chosen, and then drawn.
pub struct Picture {
    file: PathBuf,
    keyframe: Option<usize>,
    map: ColourMap,
    chosen: Option<Chosen>,
    svg: Option<String>,
}

/// What is drawn.
struct Chosen {
    index: usize,
    title: String,
    sensors: Sensors,
}

impl Picture {
    /// The figure of a keyframe in a file; `None` where no file is named.
    ///
    /// # Errors
    /// A file that cannot be an SVG.
    pub fn plan(file: Option<&Path>, keyframe: Option<usize>, map: ColourMap) -> Result<Option<Self>> {
        let Some(file) = file else { return Ok(None) };
        ensure!(
            file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(ENDING)),
            "--figure {}: figures are SVG\n  help: give a file that ends in .{ENDING}",
            file.display()
        );
        ensure!(!file.is_dir(), "--figure {}: it is a folder\n  help: name a file in it", file.display());
        Ok(Some(Self { file: file.to_owned(), keyframe, map, chosen: None, svg: None }))
    }

    /// Chooses the keyframe: the one that was asked for, or the held-out one that receives the most, of images alone the first. `of` says whose
    /// prediction it is.
    ///
    /// # Errors
    /// A keyframe that is not held out, one that cannot be read, a file within the data set.
    pub fn choose(&mut self, of: &str, dataset: &Dataset, split: &Split) -> Result<()> {
        keep_apart("--figure", &self.file, &[Reads::Folder(dataset.dir())])?;
        ensure!(
            dataset.fixed_array().is_none(),
            "--figure: a figure shows what a camera saw, and in {} an array stands still and sees a half-sphere\n  help: leave it out",
            dataset.dir().display()
        );
        split.check_held_out()?;
        let index = match self.keyframe {
            Some(index) => {
                ensure!(
                    split.held_out.contains(&index),
                    "--figure-keyframe {index}: it is not held out\n  help: held out are {}",
                    split.held_out.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")
                );
                index
            }
            None => strongest(dataset, split)?,
        };
        let title = format!("{of}: held-out keyframe {} (index {index}) of {}", index + 1, dataset.header().name);
        self.chosen = Some(Chosen { index, title, sensors: Sensors::of(dataset) });
        Ok(())
    }

    /// Index of the chosen keyframe.
    pub fn index(&self) -> Option<usize> {
        self.chosen.as_ref().map(|chosen| chosen.index)
    }

    /// Draws the keyframe, where it is the chosen one.
    ///
    /// # Errors
    /// Nothing that was both observed and predicted; levels that no axis holds.
    pub fn look(&mut self, truth: &Keyframe, predicted: Halves<'_>) -> Result<()> {
        let Some(chosen) = self.chosen.as_ref().filter(|chosen| chosen.index == truth.index) else { return Ok(()) };
        let svg = charts::keyframe(&chosen.title, truth, predicted, &chosen.sensors, self.map);
        self.svg = Some(svg.with_context(|| format!("--figure {}", self.file.display()))?);
        Ok(())
    }

    /// Writes it.
    ///
    /// # Errors
    /// A file that cannot be written, or a keyframe that nobody has shown it.
    pub fn write(&self) -> Result<()> {
        let svg =
            self.svg.as_ref().with_context(|| format!("--figure {}: its keyframe was not evaluated", self.file.display()))?;
        Ok(write_atomic(&self.file, svg.as_bytes())?)
    }
}

/// The held-out keyframe whose spectrum has the most power: there is the most to get wrong.
fn strongest(dataset: &Dataset, split: &Split) -> Result<usize> {
    let first = split.held_out.first().copied().context("no keyframe is held out")?;
    if !dataset.modalities().radio {
        return Ok(first);
    }
    let mut best = (first, f64::NEG_INFINITY);
    for &index in &split.held_out {
        let keyframe = dataset.keyframe(index)?;
        let power: f64 = keyframe.radio.iter().flat_map(|radio| radio.spectrum.pixels()).map(|&s| f64::from(s)).sum();
        if power > best.1 {
            best = (index, power);
        }
    }
    Ok(best.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_is_a_file_of_svg() {
        let plan = |file: &str| Picture::plan(Some(Path::new(file)), None, ColourMap::Jet);
        assert!(plan("a/b.SVG").unwrap().is_some() && Picture::plan(None, None, ColourMap::Jet).unwrap().is_none());
        for file in ["a.png", "a", "a.svg.gz"] {
            let error = plan(file).err().unwrap().to_string();
            assert!(error.contains("ends in .svg"), "{error}");
        }
        let undecided = plan("a.svg").unwrap().unwrap();
        assert!(undecided.index().is_none() && undecided.write().is_err(), "nothing empty is written");
    }
}
