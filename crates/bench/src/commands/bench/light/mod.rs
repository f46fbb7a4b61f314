//! `corf bench light`: how far a dataset's images are from the converged ones, and what they cost.

mod text;

use super::super::assignments::DatasetKeys;
use super::super::{Verdict, show};
use crate::device::{Backend, DeviceChoice};
use crate::files::output::FreshFolder;
use crate::metrics::image::psnr;
use crate::run::claim_fresh;
use crate::scenes::generate;
use crate::scenes::in_use;
use crate::scenes::oidn::Oidn;
use crate::terminal::interrupt;
use crate::terminal::messages;
use crate::terminal::progress::Progress;
use anyhow::Result;
use clap::Args;
use corf_raytrace::bvh::{Bvh, Ray};
use corf_raytrace::light::{self, LightFrame, LightSettings, LightTracer, Spent};
use corf_raytrace::sensor::LightSensor;
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Pinhole, Raster, Rigid3, Rng, Scene, io, radio_check};
use glam::DVec3;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// `corf bench light`.
#[derive(Args)]
pub struct Light {
    /// Dataset configuration (TOML), e.g. scenes/lobby-mini.toml.
    config: PathBuf,
    #[command(flatten)]
    keys: DatasetKeys,
    /// Views, evenly along the trajectory.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    views: u32,
    /// Paths a pixel of each half of the reference.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(2..=65_536))]
    reference_samples: u32,
    /// Pixels of a view that the reference is worked out at, drawn evenly over it; a view with no more has them all.
    #[arg(long, default_value_t = 8192, value_parser = clap::value_parser!(u32).range(16..=100_000_000))]
    reference_pixels: u32,
    /// Device that traces: auto, cpu, gpu, or gpu:N for the N-th adapter. The reference is the processor's.
    #[arg(long, default_value = "cpu")]
    device: DeviceChoice,
    /// Do not render the views on the processor as well, to compare a GPU with it.
    #[arg(long)]
    alone: bool,
    /// Folder for pictures: each view, and where it is off.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

/// Stages of [`Rng::keyed`].
const STAGE_PIXELS: u64 = 0xbe_0001;
/// Key of a second rendering.
const AGAIN: u64 = 1 << 39;
/// Keys of the two halves of the reference.
const HALVES: [u64; 2] = [1 << 40, 1 << 41];
/// Surfaces of at least this roughness, and no metal, count as diffuse where one point is looked at from two keyframes.
const DIFFUSE_ROUGHNESS: f32 = 0.7;
/// Reflectance varies by no more than this share around a flat point.
const FLAT: f32 = 0.01;
/// A point seen from two places is the same where the depths agree to this share.
const SAME_DEPTH: f64 = 0.005;

/// Half a mean squared error, dB of PSNR.
const HALF_DB: f64 = 10.0 * std::f64::consts::LOG10_2;
/// Errors are shown so many times enlarged.
const ERROR_GAIN: f64 = 8.0;

/// Report of the command.
#[derive(Debug, Serialize)]
struct Report {
    dataset: String,
    method: corf_scene::config::LightMethod,
    width: usize,
    height: usize,
    samples_per_pixel: u32,
    reference_samples: u32,
    threads: usize,
    device: String,
    /// Before the first view: emitters, and the solution of cached light.
    prepare_seconds: f64,
    exposure_ev: f32,
    views: Vec<View>,
    /// Over all views.
    psnr_db: f64,
    /// Standard error of that: of how many pixels the reference has, and of its own noise.
    psnr_error_db: f64,
    radiance_ratio: f64,
    two_views_difference: Option<f64>,
    seconds_a_view: f64,
    /// Views handed over to a GPU at once and developed there, as for a data set.
    together: Option<Together>,
    /// Where a GPU's time went, all of the command's.
    spent: Vec<Spent>,
    /// A GPU against the processor, over all views.
    against_processor: Option<Against>,
}

/// Views that a GPU renders together.
#[derive(Clone, Copy, Debug, Serialize)]
struct Together {
    views: usize,
    /// Seconds of each, and of each when all are rendered again.
    seconds_a_view: f64,
    seconds_a_view_again: f64,
}

/// A view on a GPU against the same view on the processor, which draws the same random numbers.
#[derive(Clone, Copy, Debug, Serialize)]
struct Against {
    /// PSNR of one 8-bit image against the other.
    psnr_db: f64,
    /// Mean radiance (luminance) over the processor's.
    radiance_ratio: f64,
    /// The processor's seconds, and those of a second rendering.
    seconds: f64,
    seconds_again: f64,
    /// The processor's seconds over the GPU's, both of a second rendering: once the cached light that a view needs is there.
    times_faster: f64,
    #[serde(skip)]
    squared_error: f64,
}

/// One view.
#[derive(Debug, Serialize)]
struct View {
    keyframe: usize,
    seconds: f64,
    /// Rendered again, with other random numbers: what it takes once the cached light that it needs is there.
    seconds_again: f64,
    /// PSNR of the noise of one rendering: half the mean squared difference of the two.
    noise_psnr_db: f64,
    /// PSNR of the 8-bit sRGB image against the converged one, the reference's noise cancelled, and the standard error of that.
    psnr_db: f64,
    psnr_error_db: f64,
    /// PSNR of the mean of both halves of the reference.
    reference_psnr_db: f64,
    /// Mean scattered radiance over the reference's (luminance).
    radiance_ratio: f64,
    /// Standard error of that.
    radiance_ratio_error: f64,
    /// Median relative difference of the radiance of flat diffuse points from that in the next keyframe.
    two_views_difference: Option<f64>,
    camera_rays_a_pixel: f64,
    rays_a_pixel: f64,
    against_processor: Option<Against>,
    #[serde(skip)]
    squared_error: f64,
    /// Standard error of that.
    #[serde(skip)]
    squared_error_error: f64,
}

impl Light {
    /// Runs the command.
    ///
    /// # Errors
    /// A bad configuration or scene, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let device = self.device.resolve()?;
        let config = self.keys.load(&self.config)?;
        let scene_config = config.load_scene_config()?;
        let scene = in_use::load(&scene_config)?;
        let denoiser = Oidn::asked_for(&config)?;
        messages::findings(radio_check::far_finding(&scene));
        let pictures = self.pictures.as_deref().map(claim_fresh).transpose()?;
        let poses = config.poses(&scene_config)?;
        let bvh = Bvh::build(&scene);
        let start = Instant::now();
        let tracer = LightTracer::new(&scene, &bvh);
        let mut sensor = generate::camera(&config, &tracer, &device, denoiser)?;
        let prepare_seconds = start.elapsed().as_secs_f64();
        let mut processor = if device == Backend::Cpu || self.alone {
            None
        } else {
            Some(generate::camera(&config, &tracer, &Backend::Cpu, Oidn::asked_for(&config)?)?)
        };
        let exposure_ev = match config.light.exposure_ev {
            Some(ev) => ev as f32,
            None => sensor.meter(&poses)?,
        };
        sensor.expose(exposure_ev);
        processor.iter_mut().for_each(|sensor| sensor.expose(exposure_ev));

        let count = (self.views as usize).min(poses.len());
        let mut views = Vec::new();
        let mut progress = Progress::start(format!("views of {}", config.name), count, "views");
        for k in 0..count {
            interrupt::check()?;
            let at = (2 * k + 1) * poses.len() / (2 * count);
            let folder = pictures.as_ref().map(FreshFolder::path);
            views.push(self.view(&scene, &bvh, &tracer, &sensor, processor.as_ref(), &poses, at, folder)?);
            progress.set(k + 1, count);
        }
        progress.finish();
        let together = Together::of(&sensor, &poses)?;
        let mean = |value: &dyn Fn(&View) -> f64| views.iter().map(value).sum::<f64>() / views.len() as f64;
        let squared_error_error = (mean(&|v| v.squared_error_error.powi(2)) / views.len() as f64).sqrt();
        let differences: Vec<f64> = views.iter().filter_map(|v| v.two_views_difference).collect();
        let report = Report {
            dataset: config.name.clone(),
            method: config.light.method,
            width: config.light.width,
            height: config.light.height,
            samples_per_pixel: config.light.samples(),
            reference_samples: self.reference_samples,
            threads: rayon::current_num_threads(),
            device: device.name(),
            prepare_seconds,
            exposure_ev,
            psnr_db: psnr_db(mean(&|v| v.squared_error)),
            psnr_error_db: in_db(squared_error_error, mean(&|v| v.squared_error)),
            radiance_ratio: mean(&|v| v.radiance_ratio),
            two_views_difference: (!differences.is_empty()).then(|| median(differences)),
            seconds_a_view: mean(&|v| v.seconds),
            together,
            spent: sensor.spent(),
            against_processor: Against::mean(&views),
            views,
        };
        pictures.map_or(Ok(()), FreshFolder::finish)?;
        show(json, &report, &text::text(&report))?;
        Ok(Verdict::Done)
    }

    fn view(
        &self,
        scene: &Scene,
        bvh: &Bvh,
        tracer: &LightTracer<'_>,
        sensor: &LightSensor<'_>,
        processor: Option<&LightSensor<'_>>,
        poses: &[TrajectoryPose],
        at: usize,
        pictures: Option<&Path>,
    ) -> Result<View> {
        let camera = *sensor.intrinsics();
        let pose = &poses[at];
        let start = Instant::now();
        let frame = sensor.look(&pose.world_from_camera, pose.index as u64)?;
        let seconds = start.elapsed().as_secs_f64();

        let start = Instant::now();
        let again = sensor.look(&pose.world_from_camera, AGAIN + pose.index as u64)?;
        let seconds_again = start.elapsed().as_secs_f64();

        let against_processor = match processor {
            Some(processor) => {
                Some(Against::of(processor, pose, [&frame, &again], [seconds, seconds_again], sensor.exposure_ev())?)
            }
            None => None,
        };

        let pixels = spread(camera.width, camera.height, self.reference_pixels as usize, pose.index as u64);
        let settings = LightSettings {
            samples_per_pixel: self.reference_samples,
            max_bounces: 64,
            roulette_after: 4,
            ..LightSettings::default()
        };
        let halves =
            HALVES.map(|key| tracer.render_pixels(&camera, &pose.world_from_camera, &settings, key + pose.index as u64, &pixels));
        let ev = sensor.exposure_ev();
        let image = light::develop_frame(&frame, ev);
        let compared = Comparison::of(&frame, &image, &pixels, &halves, ev);
        if let Some(folder) = pictures {
            save(folder, pose.index, &image, &pixels, &compared.errors)?;
        }
        let two_views_difference = match poses.get(at + 1) {
            Some(next) => {
                let other = sensor.look(&next.world_from_camera, next.index as u64)?;
                two_views(scene, bvh, &camera, [&pose.world_from_camera, &next.world_from_camera], [&frame, &other])
            }
            None => None,
        };
        let rays = frame.rays;
        let area = (camera.width * camera.height) as f64;
        Ok(View {
            keyframe: pose.index,
            seconds,
            seconds_again,
            noise_psnr_db: psnr(&image, &light::develop_frame(&again, ev), None) + HALF_DB,
            psnr_db: psnr_db(compared.squared_error),
            psnr_error_db: in_db(compared.squared_error_error, compared.squared_error),
            reference_psnr_db: psnr_db(compared.reference_error),
            radiance_ratio: compared.ratio,
            radiance_ratio_error: compared.ratio_error,
            two_views_difference,
            camera_rays_a_pixel: rays.camera as f64 / area,
            rays_a_pixel: (rays.camera + rays.bounce + rays.shadow) as f64 / area,
            against_processor,
            squared_error: compared.squared_error,
            squared_error_error: compared.squared_error_error,
        })
    }
}

impl Together {
    /// Renders and develops as many poses along a trajectory as a GPU is best given at once, twice; nothing where the processor traces.
    fn of(sensor: &LightSensor<'_>, poses: &[TrajectoryPose]) -> Result<Option<Self>> {
        if sensor.adapter().is_none() {
            return Ok(None);
        }
        let views = sensor.together().min(poses.len());
        let chosen: Vec<&TrajectoryPose> =
            (0..views).filter_map(|k| poses.get((2 * k + 1) * poses.len() / (2 * views))).collect();
        let seconds = || -> Result<f64> {
            interrupt::check()?;
            let start = Instant::now();
            sensor.see_all(&chosen)?;
            Ok(start.elapsed().as_secs_f64() / views as f64)
        };
        Ok(Some(Self { views, seconds_a_view: seconds()?, seconds_a_view_again: seconds()? }))
    }
}

impl Against {
    /// Renders a view that a GPU has rendered, and again, on the processor.
    fn of(
        processor: &LightSensor<'_>,
        pose: &TrajectoryPose,
        frames: [&LightFrame; 2],
        gpu_seconds: [f64; 2],
        ev: f32,
    ) -> Result<Self> {
        let (mut squared_error, mut light, mut seconds) = (0.0, [0.0f64; 2], [0.0; 2]);
        for (k, frame) in frames.into_iter().enumerate() {
            interrupt::check()?;
            let start = Instant::now();
            let own = processor.look(&pose.world_from_camera, [0, AGAIN][k] + pose.index as u64)?;
            seconds[k] = start.elapsed().as_secs_f64();
            squared_error += 0.5 * mean_square(&light::develop_frame(frame, ev), &light::develop_frame(&own, ev));
            for (sum, frame) in light.iter_mut().zip([frame, &own]) {
                *sum += frame.radiance.pixels().iter().map(|p| f64::from(light::luminance((*p).into()))).sum::<f64>();
            }
        }
        Ok(Self {
            psnr_db: psnr_db(squared_error),
            radiance_ratio: light[0] / light[1],
            seconds: seconds[0],
            seconds_again: seconds[1],
            times_faster: seconds[1] / gpu_seconds[1],
            squared_error,
        })
    }

    /// Over all views: ratios of sums of seconds, means of the rest.
    fn mean(views: &[View]) -> Option<Self> {
        let all: Vec<(&View, Self)> = views.iter().filter_map(|v| Some((v, v.against_processor?))).collect();
        let mean = |value: &dyn Fn(&Self) -> f64| all.iter().map(|(_, a)| value(a)).sum::<f64>() / all.len() as f64;
        let squared_error = mean(&|a| a.squared_error);
        (!all.is_empty()).then(|| Self {
            psnr_db: psnr_db(squared_error),
            radiance_ratio: mean(&|a| a.radiance_ratio),
            seconds: mean(&|a| a.seconds),
            seconds_again: mean(&|a| a.seconds_again),
            times_faster: mean(&|a| a.seconds_again) * all.len() as f64 / all.iter().map(|(v, _)| v.seconds_again).sum::<f64>(),
            squared_error,
        })
    }
}

/// Mean squared difference of two images, of values from 0 to 1.
fn mean_square(a: &Raster<[u8; 3]>, b: &Raster<[u8; 3]>) -> f64 {
    let squares =
        a.pixels().iter().flatten().zip(b.pixels().iter().flatten()).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    squares.sum::<f64>() / (3 * a.pixels().len()) as f64 / (255.0 * 255.0)
}

/// A pixel's radiance and lamp, as the tracer gives them.
type Traced = ([f32; 3], [f32; 4]);

/// A view beside the two halves of its reference, over the reference's pixels.
struct Comparison {
    /// Per pixel and channel, of sRGB values from 0 to 1.
    errors: Vec<[f64; 3]>,
    /// Mean squared error, the reference's noise cancelled, and that of the reference's mean.
    squared_error: f64,
    reference_error: f64,
    /// Standard error of the first.
    squared_error_error: f64,
    /// Ratio of mean scattered radiance (luminance), and its standard error.
    ratio: f64,
    ratio_error: f64,
}

impl Comparison {
    fn of(frame: &LightFrame, image: &Raster<[u8; 3]>, pixels: &[[usize; 2]], halves: &[Vec<Traced>; 2], ev: f32) -> Self {
        let n = pixels.len() as f64;
        let (mut squared_error, mut reference_error, mut squares) = (0.0f64, 0.0f64, 0.0f64);
        let mut errors = vec![[0.0f64; 3]; pixels.len()];
        let mut scattered = Vec::with_capacity(pixels.len());
        for (i, &[x, y]) in pixels.iter().enumerate() {
            let [a, b] = [0, 1].map(|h| light::develop_pixel(halves[h][i].0, halves[h][i].1, ev).map(f64::from));
            let c = image[(x, y)].map(|v| f64::from(v) / 255.0);
            let of_pixel = (0..3).map(|k| (c[k] - a[k]) * (c[k] - b[k]) / 3.0).sum::<f64>();
            squared_error += of_pixel;
            squares += of_pixel * of_pixel;
            for k in 0..3 {
                errors[i][k] = c[k] - 0.5 * (a[k] + b[k]);
                reference_error += (a[k] - b[k]) * (a[k] - b[k]) / 12.0;
            }
            let of = |(radiance, lamp): Traced| {
                f64::from(light::luminance(std::array::from_fn::<f32, 3, _>(|k| radiance[k] - lamp[k]).into()))
            };
            let found = of((frame.radiance[(x, y)], frame.lamp[(x, y)]));
            scattered.push((found, 0.5 * (of(halves[0][i]) + of(halves[1][i]))));
        }
        let [own, its] = scattered.iter().fold([0.0; 2], |[own, its], (f, r)| [own + f, its + r]);
        let ratio = own / its;
        // Of a ratio of means: the spread of found − ratio · reference.
        let spread = scattered.iter().map(|(f, r)| (f - ratio * r).powi(2)).sum::<f64>() / n;
        Self {
            errors,
            squared_error: squared_error / n,
            squared_error_error: ((squares / n - (squared_error / n).powi(2)).max(0.0) / n).sqrt(),
            reference_error: reference_error / n,
            ratio,
            ratio_error: (spread / n).sqrt() / (its / n),
        }
    }
}

/// The view, and its errors where the reference was worked out, enlarged: grey where it is right, brighter where it is too
/// bright.
fn save(folder: &Path, keyframe: usize, image: &Raster<[u8; 3]>, pixels: &[[usize; 2]], errors: &[[f64; 3]]) -> Result<()> {
    io::write_png(folder.join(format!("{keyframe:05}.png")), image)?;
    // The reference's pixels lie row by row, one in each part of the view.
    let columns = pixels.windows(2).take_while(|w| w[0][0] < w[1][0]).count() + 1;
    let of = |e: &[f64; 3]| e.map(|e| (127.5 + ERROR_GAIN * 255.0 * e).clamp(0.0, 255.0) as u8);
    let error = Raster::from_vec(columns, pixels.len() / columns, errors.iter().map(of).collect());
    io::write_png(folder.join(format!("{keyframe:05}-error.png")), &error)?;
    Ok(())
}

/// `count` pixels of an image, one in each of as many equal parts; all where it has no more.
fn spread(width: usize, height: usize, count: usize, key: u64) -> Vec<[usize; 2]> {
    let all = width * height;
    if count >= all {
        return (0..all).map(|i| [i % width, i / width]).collect();
    }
    // Parts of equal area, about square.
    let rows = ((count * height) as f64 / width as f64).sqrt().round().max(1.0) as usize;
    let columns = (count / rows).max(1);
    let mut rng = Rng::keyed(0, STAGE_PIXELS, key);
    let mut within = |part: usize, parts: usize, size: usize| {
        let (low, high) = (part * size / parts, ((part + 1) * size / parts).max(part * size / parts + 1));
        (low + rng.below(high - low)).min(size - 1)
    };
    let mut pixels = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        for column in 0..columns {
            pixels.push([within(column, columns, width), within(row, rows, height)]);
        }
    }
    pixels
}

/// Median relative difference, in linear radiance, of flat diffuse points that two views see.
fn two_views(
    scene: &Scene,
    bvh: &Bvh,
    camera: &Pinhole,
    world_from_camera: [&Rigid3; 2],
    frames: [&LightFrame; 2],
) -> Option<f64> {
    let other_from_world = world_from_camera[1].inverse();
    let mut differences = Vec::new();
    for y in 1..camera.height - 1 {
        for x in 1..camera.width - 1 {
            if !is_flat(frames[0], x, y) {
                continue;
            }
            let depth = f64::from(frames[0].depth_m[(x, y)]);
            let world = world_from_camera[0].transform_point(camera.unproject(x as f64 + 0.5, y as f64 + 0.5) * depth);
            let there = other_from_world.transform_point(world);
            let Some(pixel) = camera.project(there).filter(|_| there.z > 0.0) else { continue };
            let (u, v) = (pixel.x - 0.5, pixel.y - 0.5);
            if !(1.0..(camera.width - 2) as f64).contains(&u) || !(1.0..(camera.height - 2) as f64).contains(&v) {
                continue;
            }
            let (i, j) = (u as usize, v as usize);
            let same = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)].iter().all(|&(i, j)| {
                is_flat(frames[1], i, j)
                    && (f64::from(frames[1].depth_m[(i, j)]) - there.z).abs() < SAME_DEPTH * there.z.max(1.0)
                    && frames[1].surface[(i, j)] == frames[0].surface[(x, y)]
            });
            if !same || !is_diffuse(scene, bvh, world_from_camera[0].translation, world) {
                continue;
            }
            let at = |x: usize, y: usize| f64::from(light::luminance(frames[1].radiance[(x, y)].into()));
            let (fx, fy) = (u - i as f64, v - j as f64);
            let found = (at(i, j) * (1.0 - fx) + at(i + 1, j) * fx) * (1.0 - fy)
                + (at(i, j + 1) * (1.0 - fx) + at(i + 1, j + 1) * fx) * fy;
            let here = f64::from(light::luminance(frames[0].radiance[(x, y)].into()));
            if here + found > 0.0 {
                differences.push(2.0 * (here - found).abs() / (here + found));
            }
        }
    }
    (differences.len() > 30).then(|| median(differences))
}

/// Whether a pixel and its neighbours see one surface of one reflectance, and no lamp.
fn is_flat(frame: &LightFrame, x: usize, y: usize) -> bool {
    let albedo = |x: usize, y: usize| light::luminance(frame.albedo[(x, y)].into());
    let here = albedo(x, y);
    here > 0.02
        && (y - 1..y + 2).all(|j| {
            (x - 1..x + 2).all(|i| {
                (albedo(i, j) - here).abs() <= FLAT * here
                    && frame.lamp[(i, j)][3] == 0.0
                    && frame.surface[(i, j)] == frame.surface[(x, y)]
            })
        })
}

/// Whether the surface at a point is rough and no metal.
fn is_diffuse(scene: &Scene, bvh: &Bvh, from: DVec3, point: DVec3) -> bool {
    bvh.intersect(&Ray::new(from.as_vec3(), (point - from).as_vec3())).is_some_and(|hit| {
        let material = &scene.materials[scene.triangles[hit.triangle as usize].material as usize].light;
        material.roughness >= DIFFUSE_ROUGHNESS && material.metallic == 0.0 && material.transmission == 0.0
    })
}

fn psnr_db(squared_error: f64) -> f64 {
    -10.0 * squared_error.max(1e-10).log10()
}

/// An error of a squared error, in dB of its PSNR.
fn in_db(error: f64, squared_error: f64) -> f64 {
    10.0 * std::f64::consts::LOG10_E * error / squared_error.max(1e-10)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
