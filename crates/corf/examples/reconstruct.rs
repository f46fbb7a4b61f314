//! Keyframe after keyframe into a field, and the field at a pose that was not among them.
//!
//! ```text
//! cargo run --release -- dataset generate scenes/room-tiny.toml --out data/tiny
//! cargo run --release -p corf --example reconstruct -- data/tiny
//! ```

#![allow(clippy::print_stdout)]

use corf::{CpuDevice, OptimizerConfig, RasterConfig, ReconstructionConfig, Reconstructor};
use corf_scene::dataset::Dataset;
use std::ops::ControlFlow;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("give a data set's folder")?;
    let dataset = Dataset::open(folder)?;
    let config = ReconstructionConfig { iterations_per_keyframe: 30, ..ReconstructionConfig::default() };
    let device = CpuDevice::new(OptimizerConfig::default(), RasterConfig::default(), &config.empty_field())?;
    let range = dataset.db_range().ok_or("give a data set with spectra")?;
    let (light, radio) = (dataset.light_camera(), dataset.radio_camera());
    let mut reconstructor = Reconstructor::new(Box::new(device), config, light, radio, range, 1)?;

    let held_out = 8;
    for index in (0..dataset.len()).filter(|index| *index != held_out) {
        let report = reconstructor.push(&dataset.keyframe(index)?)?;
        println!("keyframe {index}: {} Gaussians", report.gaussians);
    }
    reconstructor.finish(&mut |_, _| ControlFlow::Continue(()))?;

    let truth = dataset.keyframe(held_out)?;
    let image = truth.light.ok_or("give a data set with images")?.image;
    let seen = reconstructor.render(truth.world_from_camera)?;
    let errors = seen.image.pixels().iter().flatten().zip(image.pixels().iter().flatten());
    let square: f64 = errors.map(|(a, b)| f64::from(a.clamp(0.0, 1.0) - f32::from(*b) / 255.0).powi(2)).sum();
    let psnr_db = -10.0 * (square / (3 * seen.image.pixels().len()) as f64).log10();
    println!("keyframe {held_out}, held out: light {psnr_db:.1} dB");
    Ok(())
}
