//! Prints the contents of a scene file: triangles, materials with and without radio properties, and its platform's trajectory.
//!
//! ```text
//! cargo run --release -p corf-scene --example scene_contents -- scenes/room.toml
//! ```

#![allow(clippy::print_stdout, clippy::print_stderr)]

use corf_scene::config::SceneConfig;
use corf_scene::{Result, trajectory};

fn main() -> Result<()> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "scenes/room.toml".into());
    let config = SceneConfig::load(&path)?;
    // Reads the mesh and gives its materials what the scene file says of them at radio frequencies.
    let (scene, left_out) = config.load_scene()?;
    left_out.iter().for_each(|finding| eprintln!("{finding}"));
    println!("{}: {} triangles of {} objects", scene.name, scene.triangles.len(), scene.objects.len());
    for material in &scene.materials {
        match &material.radio {
            Some(radio) => println!(
                "  {}: {:.1} mm thick, scatters {:.2}",
                material.name,
                1e3 * radio.thickness_m,
                radio.scattering.coefficient
            ),
            None => println!("  {}: no radio properties", material.name),
        }
    }
    println!("transmitter at {} m, carrier {:.1} GHz", config.transmitter.position(), config.radio.frequency_hz / 1e9);
    if let Some(way) = &config.trajectory {
        // World frame: right-handed, z up, metres. Poses are those of the camera: x right, y down, z forward.
        for pose in trajectory::generate(way, 4)? {
            let forward = pose.world_from_camera.rotation.z_axis;
            println!("  at {:.1} s: {:.2}, looking along {:.2}", pose.time_s, pose.world_from_camera.translation, forward);
        }
    }
    Ok(())
}
