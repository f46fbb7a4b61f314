//! Jet spectra along a dataset's trajectory, to look at them and to measure what the settings cost and whether they are converged.
//!
//! ```text
//! cargo run --release -p corf-raytrace --example render_spectrum -- scenes/lobby-mini.toml --out spectra --every 4
//! ```
//! `--kind mpc|bartlett|bartlett-coherent|mvdr`, `--directions N`, `--patch M`, `--lobe DEG`, `--range DB`, `--min-face M2`, `--mirror SR`, `--after
//! 0|1`, `--size WxH`; `--converge` gathers everything a second time on other patches and directions and prints the scalar PSNR between the two.

#![allow(clippy::print_stdout, clippy::print_stderr)]

use corf_raytrace::Bvh;
use corf_raytrace::radio::{Antenna, Arrival, DiffuseField, DiffuseSettings, RadioSettings, RadioTracer, WorldExtent};
use corf_raytrace::spectrum::{self, SpectrumSettings};
use corf_scene::config::{DatasetConfig, SpectrumKind};
use corf_scene::keyframe::DbRange;
use corf_scene::{Error, Pinhole, Raster, Result, Rigid3, io, trajectory};
use glam::DVec3;
use std::path::PathBuf;
use std::time::Instant;

struct Options {
    config: PathBuf,
    out: PathBuf,
    every: usize,
    kind: SpectrumKind,
    converge: bool,
    range_db: Option<f64>,
    lobe_deg: Option<f64>,
    size: Option<(usize, usize)>,
    min_face_m2: Option<f64>,
    diffuse: DiffuseSettings,
    patch_m: Option<f64>,
}

fn options() -> Result<Options> {
    let mut o = Options {
        config: PathBuf::from("scenes/lobby-mini.toml"),
        out: PathBuf::from("spectra"),
        every: 1,
        kind: SpectrumKind::Mpc,
        converge: false,
        range_db: None,
        lobe_deg: None,
        size: None,
        min_face_m2: None,
        diffuse: DiffuseSettings::default(),
        patch_m: None,
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(flag) = arguments.next() {
        if flag == "--converge" {
            o.converge = true;
            continue;
        }
        if !flag.starts_with("--") {
            o.config = flag.into();
            continue;
        }
        let value = arguments.next().unwrap_or_default();
        let wrong = || Error::invalid(&flag, format!("`{value}`"), "see the first lines of this example's source");
        let number = || value.parse::<f64>().map_err(|_| wrong());
        match flag.as_str() {
            "--out" => o.out = value.clone().into(),
            "--every" => o.every = (number()? as usize).max(1),
            "--kind" => {
                o.kind = match value.as_str() {
                    "mpc" => SpectrumKind::Mpc,
                    "bartlett" => SpectrumKind::Bartlett,
                    "bartlett-coherent" => SpectrumKind::BartlettCoherent,
                    "mvdr" => SpectrumKind::Mvdr,
                    _ => return Err(wrong()),
                }
            }
            "--directions" => o.diffuse.directions = number()? as usize,
            "--patch" => o.patch_m = Some(number()?),
            "--mirror" => o.diffuse.min_mirror_sr = number()?,
            "--after" => o.diffuse.after = number()? as usize,
            "--lobe" => o.lobe_deg = Some(number()?),
            "--range" => o.range_db = Some(number()?),
            "--min-face" => o.min_face_m2 = Some(number()?),
            "--size" => {
                let (w, h) = value.split_once('x').ok_or_else(wrong)?;
                o.size = Some((w.parse().map_err(|_| wrong())?, h.parse().map_err(|_| wrong())?));
            }
            _ => return Err(wrong()),
        }
    }
    Ok(o)
}

fn scalar_psnr(a: &Raster<f32>, b: &Raster<f32>, range: &DbRange) -> f64 {
    let squares: f64 =
        a.pixels().iter().zip(b.pixels()).map(|(a, b)| f64::from(range.scalar(*a) - range.scalar(*b)).powi(2)).sum();
    -10.0 * (squares / a.pixels().len() as f64).log10()
}

/// All images side by side, three to a row, enlarged fourfold.
fn contact_sheet(images: &[Raster<[u8; 3]>]) -> Raster<[u8; 3]> {
    const SCALE: usize = 4;
    const COLUMNS: usize = 3;
    let (w, h) = (images[0].width() * SCALE, images[0].height() * SCALE);
    Raster::from_fn(w * COLUMNS, h * images.len().div_ceil(COLUMNS), |x, y| {
        images.get(y / h * COLUMNS + x / w).map_or([0; 3], |image| image[(x % w / SCALE, y % h / SCALE)])
    })
}

fn percentile(sorted: &[f32], share: f64) -> f64 {
    10.0 * f64::from(sorted[((sorted.len() - 1) as f64 * share) as usize]).max(1e-30).log10()
}

fn main() -> Result<()> {
    let o = options()?;
    let config = DatasetConfig::load(&o.config)?;
    let scene_config = config.load_scene_config()?;
    let (scene, left_out) = scene_config.load_scene()?;
    left_out.iter().for_each(|finding| eprintln!("{finding}"));
    let Some(loop_config) = &scene_config.trajectory else {
        return Err(Error::invalid(config.scene_path().display().to_string(), "no [trajectory]", "give one"));
    };
    let poses = trajectory::generate_between(loop_config, config.keyframes, config.way)?;
    let camera = match o.size {
        Some((w, h)) => Pinhole::from_horizontal_fov(w, h, config.radio.horizontal_fov_deg),
        None => config.radio_camera(),
    };
    let lobe_deg = o.lobe_deg.unwrap_or(config.radio.lobe_width_deg);
    let settings = RadioSettings {
        frequency_hz: scene_config.radio.frequency_hz,
        max_interactions: config.radio.max_interactions,
        transmission: config.radio.transmission,
        min_face_area_m2: o.min_face_m2.unwrap_or(RadioSettings::default().min_face_area_m2),
        tx_antenna: Antenna::from(&scene_config.transmitter),
        rx_antenna: Antenna {
            pattern: scene_config.receiver.pattern,
            polarization: scene_config.receiver.polarization,
            ..Antenna::default()
        },
        ..RadioSettings::default()
    };
    let diffuse = DiffuseSettings { patch_size_m: o.patch_m.unwrap_or(config.radio.patch_size_m), ..o.diffuse };
    let tx: DVec3 = scene_config.transmitter.position();

    let clock = Instant::now();
    let bvh = Bvh::build(&scene);
    let tracer = RadioTracer::new(&scene, &bvh, settings)?;
    println!(
        "{} triangles in {} faces, {:.2} s",
        scene.triangles.len(),
        tracer.geometry().faces.len(),
        clock.elapsed().as_secs_f64()
    );
    let clock = Instant::now();
    let transmitter = tracer.transmitter(tx)?;
    println!("{} candidate chains, {:.2} s", transmitter.candidate_count(), clock.elapsed().as_secs_f64());
    let clock = Instant::now();
    let field = DiffuseField::new(&tracer, tx, &diffuse)?;
    println!("{} patches, {} sources, {:.2} s", field.patch_count(), field.source_count(), clock.elapsed().as_secs_f64());

    let spectrum_settings = SpectrumSettings {
        kind: o.kind,
        lobe_width_deg: lobe_deg,
        ..SpectrumSettings::new(&config.radio, &scene_config.receiver, config.seed)
    };
    let form = |arrivals: &[Arrival], pose: &Rigid3| spectrum_settings.form(&[arrivals.to_vec()], &camera, pose);
    let chosen: Vec<_> = poses.iter().step_by(o.every).collect();
    let mut frames = Vec::new();
    let (mut paths_s, mut diffuse_s, mut spectrum_s) = (0.0, 0.0, 0.0);
    for pose in &chosen {
        let rx = pose.world_from_camera.translation;
        let clock = Instant::now();
        let paths = transmitter.paths(rx)?;
        paths_s += clock.elapsed().as_secs_f64();
        let specular: Vec<Arrival> = paths.iter().map(|p| Arrival::from_path(p, 60e9)).collect();
        let clock = Instant::now();
        let scattered = field.gather(
            pose.world_from_camera.translation,
            field.antenna(),
            &WorldExtent::View { camera, world_from_camera: pose.world_from_camera },
        )?;
        diffuse_s += clock.elapsed().as_secs_f64();
        let db = |arrivals: &[Arrival]| 10.0 * arrivals.iter().map(|a| a.power).sum::<f64>().log10();
        let line_of_sight = paths.first().is_some_and(|p| p.interactions.is_empty());
        let mut arrivals = specular.clone();
        arrivals.extend(&scattered);
        let clock = Instant::now();
        let image = form(&arrivals, &pose.world_from_camera);
        spectrum_s += clock.elapsed().as_secs_f64();
        let mut sorted = image.pixels().to_vec();
        sorted.sort_by(f32::total_cmp);
        println!(
            "{:>3} ({:5.2} {:5.2}) {} {:>3} paths {:7.2} dB, diffuse {:7.2} dB; in frame {:4.1} %; dB/sr peak {:6.1} median {:6.1} 5 % {:6.1} lowest {:6.1}",
            pose.index,
            rx.x,
            rx.y,
            if line_of_sight { "LOS " } else { "NLOS" },
            paths.len(),
            db(&specular),
            db(&scattered),
            100.0 * spectrum::share_in_frame(&arrivals, &camera, &pose.world_from_camera),
            percentile(&sorted, 1.0),
            percentile(&sorted, 0.5),
            percentile(&sorted, 0.05),
            percentile(&sorted, 0.0),
        );
        frames.push((pose, specular, image));
    }
    let count = chosen.len() as f64;
    println!(
        "per position: paths {:.1} ms, diffuse {:.1} ms, spectrum {:.1} ms",
        1e3 * paths_s / count,
        1e3 * diffuse_s / count,
        1e3 * spectrum_s / count
    );
    let peak = frames.iter().flat_map(|f| f.2.pixels()).fold(0f32, |m, v| m.max(*v));
    let max_db = (10.0 * f64::from(peak).log10()).ceil();
    let range = DbRange { min_db: max_db - o.range_db.unwrap_or(config.radio.dynamic_range_db), max_db };
    let mut images = Vec::new();
    for (pose, _, image) in &frames {
        images.push(range.jet_image(image));
        io::write_png(o.out.join(format!("{:05}.png", pose.index + 1)), &images[images.len() - 1])?;
    }
    io::write_png(o.out.join("sheet.png"), &contact_sheet(&images))?;
    println!("range {:.0} to {:.0} dB; wrote {} images to {}", range.min_db, range.max_db, frames.len(), o.out.display());
    if o.converge {
        let other = DiffuseField::new(&tracer, tx, &DiffuseSettings { phase: 1, ..diffuse })?;
        let (mut sum, mut worst) = (0.0, f64::INFINITY);
        for (pose, specular, image) in &frames {
            let mut arrivals = specular.clone();
            arrivals.extend(other.gather(
                pose.world_from_camera.translation,
                other.antenna(),
                &WorldExtent::View { camera, world_from_camera: pose.world_from_camera },
            )?);
            let psnr = scalar_psnr(image, &form(&arrivals, &pose.world_from_camera), &range);
            sum += psnr;
            worst = f64::min(worst, psnr);
        }
        println!("scalar PSNR between two samplings: mean {:.1} dB, worst {worst:.1} dB", sum / count);
    }
    Ok(())
}
