//! Renders one view of a scene to a PNG, to look at it.
//!
//! ```text
//! cargo run --release -p corf-raytrace --example render_view -- scenes/lobby.glb --eye 2,2,1.6 --look 8,6,1.2 \
//!     --size 384x216 --spp 32 --fov 90 --exposure 0 out.png
//! ```
//! `room` instead of a file is the built-in test room. `--path` traces every pixel by itself instead of caching light;
//! `--what albedo|normal|depth` shows an auxiliary image instead.

#![allow(clippy::print_stdout, clippy::print_stderr)]

#[path = "../benches/test_room.rs"]
mod test_room;

use corf_raytrace::{Bvh, CacheSettings, LightCache, LightSettings, LightTracer, ViewSettings, develop, develop_frame};
use corf_scene::{Error, Pinhole, Raster, Result, Rigid3, import, io};
use glam::DVec3;
use std::time::Instant;

struct Options {
    scene: String,
    out: String,
    eye: DVec3,
    look: DVec3,
    size: (usize, usize),
    fov_deg: f64,
    exposure_ev: f32,
    path: bool,
    what: String,
    settings: LightSettings,
}

fn numbers(flag: &str, text: &str, separator: char, count: usize) -> Result<Vec<f64>> {
    let parsed: Option<Vec<f64>> = text.split(separator).map(|t| t.trim().parse().ok()).collect();
    parsed.filter(|n| n.len() == count).ok_or_else(|| {
        Error::invalid(flag, format!("`{text}` is not {count} numbers"), format!("separate them by `{separator}`"))
    })
}

fn options() -> Result<Options> {
    let mut o = Options {
        scene: String::new(),
        out: "view.png".into(),
        eye: DVec3::new(1.0, 1.0, 1.6),
        look: DVec3::new(6.0, 6.0, 1.2),
        size: (384, 216),
        fov_deg: 90.0,
        exposure_ev: 0.0,
        path: false,
        what: "image".into(),
        settings: LightSettings::default(),
    };
    let mut positional = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--path" {
            o.path = true;
            continue;
        }
        if !argument.starts_with("--") {
            positional.push(argument);
            continue;
        }
        let value = arguments.next().ok_or_else(|| Error::invalid(&argument, "no value follows", "give one"))?;
        let scalar = |text: &str| numbers(&argument, text, ',', 1).map(|n| n[0]);
        match argument.as_str() {
            "--eye" => o.eye = DVec3::from_slice(&numbers(&argument, &value, ',', 3)?),
            "--look" => o.look = DVec3::from_slice(&numbers(&argument, &value, ',', 3)?),
            "--size" => {
                let n = numbers(&argument, &value, 'x', 2)?;
                o.size = (n[0] as usize, n[1] as usize);
            }
            "--spp" => o.settings.samples_per_pixel = scalar(&value)? as u32,
            "--bounces" => o.settings.max_bounces = scalar(&value)? as u32,
            "--seed" => o.settings.seed = scalar(&value)? as u64,
            "--background" => o.settings.background = [scalar(&value)? as f32; 3],
            "--fov" => o.fov_deg = scalar(&value)?,
            "--exposure" => o.exposure_ev = scalar(&value)? as f32,
            "--what" => o.what = value,
            _ => return Err(Error::invalid(&argument, "no such option", "see the top of render_view.rs")),
        }
    }
    let mut positional = positional.into_iter();
    o.scene = positional.next().ok_or_else(|| Error::invalid("arguments", "no scene", "give a .glb file or `room`"))?;
    o.out = positional.next().unwrap_or(o.out);
    Ok(o)
}

fn run() -> Result<()> {
    let o = options()?;
    let scene = if o.scene == "room" { test_room::test_room() } else { import::load(&o.scene)? };
    let start = Instant::now();
    let bvh = Bvh::build(&scene);
    let built = start.elapsed();
    let tracer = LightTracer::new(&scene, &bvh);
    let prepared = start.elapsed() - built;
    let camera = Pinhole::from_horizontal_fov(o.size.0, o.size.1, o.fov_deg);
    let pose = Rigid3::looking_at(o.eye, o.look, DVec3::Z);
    let start = Instant::now();
    let frame = if o.path {
        tracer.render(&camera, &pose, &o.settings, 0)
    } else {
        let n = o.settings.samples_per_pixel;
        let view =
            ViewSettings { samples_per_pixel: n, most_samples: 16 * n, exposure_ev: o.exposure_ev, ..ViewSettings::default() };
        let cache = LightCache::new(&tracer, &CacheSettings::default(), &|_, _| true);
        let cache = cache.ok_or_else(|| Error::invalid("light", "it was not solved", "this is a defect"))?;
        cache.render(&camera, &pose, &view, 0)
    };
    let rendered = start.elapsed();
    let picture = match o.what.as_str() {
        "image" => develop_frame(&frame, o.exposure_ev),
        "albedo" => develop(&frame.albedo, 0.0),
        "normal" => frame.normal.map(|n| n.map(|c| (127.5 * (c + 1.0)) as u8)),
        "depth" => Raster::from_fn(o.size.0, o.size.1, |x, y| [(255.0 / (1.0 + frame.depth_m[(x, y)])) as u8; 3]),
        other => {
            return Err(Error::invalid("--what", format!("`{other}` is unknown"), "image, albedo, normal or depth"));
        }
    };
    io::write_png(&o.out, &picture)?;
    let rays = frame.rays.camera + frame.rays.bounce + frame.rays.shadow;
    println!(
        "{} triangles; bvh {built:.2?}, emitters {prepared:.2?}, render {rendered:.2?} ({:.1} µs a pixel, {:.2} Mrays/s: {} camera, \
         {} bounce, {} shadow) → {}",
        scene.triangles.len(),
        rendered.as_secs_f64() * 1e6 / (o.size.0 * o.size.1) as f64,
        rays as f64 / rendered.as_secs_f64() * 1e-6,
        frame.rays.camera,
        frame.rays.bounce,
        frame.rays.shadow,
        o.out
    );
    Ok(())
}

fn main() -> std::process::ExitCode {
    match run() {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            std::process::ExitCode::from(2)
        }
    }
}
