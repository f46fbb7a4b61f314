//! A method of one's own beside those that are there, on the same clock and with the same metrics: here the first training keyframe, whatever is
//! asked.
//!
//! ```text
//! cargo run --release -- dataset generate scenes/room-tiny.toml --out data/tiny
//! cargo run --release -p corf-bench --example add_method -- data/tiny
//! ```

#![allow(clippy::print_stdout)]

use anyhow::{Context, Result};
use corf_bench::methods::interface::{Advance, Method, Predictor, TrainingSet};
use corf_bench::metrics::input::Verify;
use corf_bench::metrics::{Prediction, RadioPrediction};
use corf_bench::run::harness;
use corf_bench::split::{Protocol, Split};
use corf_bench::table;
use corf_scene::Rigid3;
use std::path::Path;

struct FirstKeyframe;

struct Shown(Prediction);

impl Predictor for Shown {
    fn render(&mut self, _world_from_camera: &Rigid3) -> Result<Prediction> {
        Ok(self.0.clone())
    }

    fn save(&self, _run: &Path) -> Result<()> {
        Ok(())
    }
}

impl Method for FirstKeyframe {
    fn id(&self) -> &str {
        "first-keyframe"
    }

    fn config(&self) -> serde_json::Value {
        serde_json::json!({})
    }

    fn reconstruct(
        &self,
        training: &TrainingSet<'_>,
        _seed: u64,
        advance: &mut dyn FnMut(Advance<'_>) -> Result<()>,
    ) -> Result<Box<dyn Predictor>> {
        let (keyframe, range) = (training.keyframe(0)?, training.db_range());
        let image = keyframe.light.map(|light| light.image.map(|pixel| pixel.map(|v| f32::from(v) / 255.0)));
        let scalar = keyframe.radio.zip(range).map(|(radio, range)| radio.spectrum.map(|power| range.scalar(*power)));
        advance(Advance::of(1, 1))?;
        Ok(Box::new(Shown(Prediction { image, radio: scalar.map(RadioPrediction::from_scalar), depth_m: None })))
    }
}

fn main() -> Result<()> {
    let folder = std::env::args().nth(1).context("give a data set's folder")?;
    let input = Verify::default().open(Path::new(&folder))?;
    let split = Split::of(&input.dataset, Protocol::VALIDATION)?;
    let record =
        harness::run_cell("first keyframe", &FirstKeyframe, &input, &split, 1, None, &mut |_| Ok(()), |_, _| Ok(()), |_| Ok(()))?;
    println!("{}", table::plain(&table::rows(&[record]), &table::short_columns(), None));
    Ok(())
}
