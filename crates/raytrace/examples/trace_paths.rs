//! Multipath components between two points of a scene, and the spectrum that an 8×8 array makes of them.
//!
//! ```text
//! cargo run --release -p corf-raytrace --example trace_paths -- scenes/room.toml
//! ```

#![allow(clippy::print_stdout, clippy::print_stderr)]

use corf_raytrace::Bvh;
use corf_raytrace::radio::RadioTracer;
use corf_raytrace::sensor::{Extent, RadioSensor, SensorPlan};
use corf_scene::config::{SceneConfig, SpectrumConfig, SpectrumKind, from_toml};
use corf_scene::{Pinhole, Result, Rigid3};
use glam::DVec3;

fn main() -> Result<()> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "scenes/room.toml".into());
    let config = SceneConfig::load(&path)?;
    let (scene, left_out) = config.load_scene()?;
    left_out.iter().for_each(|finding| eprintln!("{finding}"));
    let radio =
        SpectrumConfig { spectrum: SpectrumKind::Bartlett, diffuse: false, ..from_toml("width = 96\nheight = 64", "example")? };
    let plan = SensorPlan::from_parts(&radio, 1, &config.transmitter, &config);
    let bvh = Bvh::build(&scene);
    let tracer = RadioTracer::new(&scene, &bvh, plan.tracing)?;

    let (tx, rx) = (config.transmitter.position(), DVec3::new(1.2, 1.4, 1.5));
    for path in tracer.paths(tx, rx)? {
        // |a|² is the power received for 1 W sent between isotropic antennas of one polarisation each.
        let power_db = 10.0 * path.power().log10();
        println!("{:>4}  {:6.2} m  {:6.2} ns  {power_db:7.1} dB", path.types(), path.length_m, 1e9 * path.delay_s);
    }

    let sensor = RadioSensor::new(&plan, &scene, &tracer)?;
    let camera = Pinhole::from_horizontal_fov(radio.width, radio.height, 90.0);
    let pose = Rigid3::looking_at(rx, tx, DVec3::Z);
    let received = sensor.receive(&pose, Extent::View(camera))?;
    let spectrum = sensor.settings().form(&received.port_pairs, &camera, &pose);
    let peak = spectrum.pixels().iter().copied().fold(0.0, f32::max);
    println!("{}x{} spectrum, peak {:.1} dB", spectrum.width(), spectrum.height(), 10.0 * peak.log10());
    Ok(())
}
