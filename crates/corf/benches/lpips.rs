//! Time of LPIPS for one pair of images and one input, by backbone: `CORF_LPIPS_WEIGHTS=FOLDER cargo bench -p corf --bench lpips`.
//!
//! FOLDER, relative to the workspace, is one that tools/fetch_weights.py wrote. A single pass each: the largest takes most of a minute on two cores.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

use corf::image_networks::lpips::{Backbone, Lpips, LpipsInput};
use corf_scene::Raster;
use std::path::Path;
use std::time::Instant;

fn main() {
    let Some(folder) = std::env::var_os("CORF_LPIPS_WEIGHTS") else {
        println!("nothing measured: CORF_LPIPS_WEIGHTS names no folder of weights");
        return;
    };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(folder);
    println!("{} threads", rayon::current_num_threads());
    for backbone in Backbone::ALL {
        let file = folder.join(backbone.file());
        if !file.exists() {
            println!("{}: no {}", backbone.name(), file.display());
            continue;
        }
        let lpips = Lpips::read(&file, backbone).unwrap();
        for (width, height) in [(300, 200), (640, 480), (1600, 900)] {
            let image = |k: usize| Raster::from_fn(width, height, |x, y| [x, y, k * x * y].map(|v| (v % 256) as u8));
            let (a, b) = (image(1), image(3));
            let start = Instant::now();
            let distance = lpips.distance(&a, &b, LpipsInput::Signed);
            println!("{} {width}x{height}: {:.2} s (distance {distance:.4})", backbone.name(), start.elapsed().as_secs_f64());
        }
    }
}
