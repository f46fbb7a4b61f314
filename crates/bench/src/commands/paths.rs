//! `corf paths`: propagation paths between two points.

use super::{Verdict, print};
use crate::generate;
use anyhow::Result;
use clap::Args;
use corf_raytrace::bvh::Bvh;
use corf_raytrace::radio::{RadioSettings, RadioTracer, Search, json};
use corf_scene::config::SceneConfig;
use glam::DVec3;
use std::path::PathBuf;
use std::str::FromStr;

/// `corf paths`.
#[derive(Args)]
pub struct Paths {
    /// Scene file (.toml).
    scene: PathBuf,
    /// Transmitter, world metres `x,y,z`; without it the scene's own.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    tx: Option<Point>,
    /// Receiver, world metres `x,y,z`.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    rx: Point,
    /// Largest number of interactions on a path.
    #[arg(long, default_value_t = 3)]
    depth: usize,
    /// Rays that look for chains of faces where there are too many to try them all.
    #[arg(long, default_value_t = 200_000)]
    rays: usize,
    /// Leave out transmission through slabs.
    #[arg(long)]
    no_transmission: bool,
}

/// A point on the command line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point(pub(super) DVec3);

impl FromStr for Point {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text.split(',').filter_map(|p| p.trim().parse().ok()).filter(|v: &f64| v.is_finite()).collect();
        match (numbers.as_slice(), text.matches(',').count()) {
            ([x, y, z], 2) => Ok(Self(DVec3::new(*x, *y, *z))),
            _ => Err(format!("\"{text}\" is not three numbers x,y,z")),
        }
    }
}

impl Paths {
    /// Runs the command.
    ///
    /// # Errors
    /// A scene that cannot be read or traced, a transmitter at the receiver.
    pub fn run(self) -> Result<Verdict> {
        let config = SceneConfig::load(&self.scene)?;
        let scene = config.load_scene()?;
        config.check_radio(&scene)?;
        let tx = self.tx.map_or(DVec3::from_array(config.transmitter.position_m), |p| p.0);
        let bvh = Bvh::build(&scene);
        let settings = RadioSettings {
            max_depth: self.depth,
            transmission: !self.no_transmission,
            search: Search::Auto { rays: self.rays },
            ..generate::radio_settings(&config)
        };
        let tracer = RadioTracer::new(&scene, &bvh, settings)?;
        let paths = tracer.paths(tx, self.rx.0)?;
        print(&serde_json::to_string_pretty(&json::paths_to_json(&scene, config.radio.frequency_hz, tx, self.rx.0, &paths))?)?;
        Ok(Verdict::Done)
    }
}
