//! The optical half of a keyframe: light at a pose, developed.

use crate::light::{self, CacheSettings, LightCache, LightFrame, LightSettings, LightTracer, ViewSettings};
use corf_scene::config::{DatasetConfig, LightMethod, OpticalConfig};
use corf_scene::dataset::FrameData;
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Error, Pinhole, Result, Rigid3, bounds};

/// Poses along the trajectory at which the exposure is metered, and the size and samples of each.
const METERED_POSES: usize = 8;
const METERED_WIDTH: usize = 64;
const MAX_METERED_HEIGHT: usize = 512;
const METERED_SAMPLES: u32 = 16;
/// Exposure target: share of full scale to which the geometric mean of the metered radiance is mapped. Photography's middle grey, a little
/// up for a room whose walls are light.
const MIDDLE_GREY: f32 = 0.24;
/// Pixels whose paths disagree get this many times the paths of the others, at most.
const MOST_EFFORT: u32 = 16;

/// Images of no more pixels are small.
const SMALL_IMAGE: usize = 320 * 180;

/// A noise filter for frames.
pub trait Denoise: Send + Sync {
    /// Takes the noise out of a frame's radiance.
    ///
    /// # Errors
    /// A failure of the filter.
    fn denoise(&self, frame: &mut LightFrame) -> Result<()>;
}

/// The camera of a dataset in its scene.
pub struct OpticalSensor<'a> {
    tracer: &'a LightTracer<'a>,
    /// Light worked out for all views, where the dataset asks for it.
    cache: Option<LightCache<'a>>,
    intrinsics: Pinhole,
    path: LightSettings,
    view: ViewSettings,
    denoiser: Option<Box<dyn Denoise>>,
    writes: OpticalConfig,
}

impl<'a> OpticalSensor<'a> {
    /// Makes a dataset's camera ready: with cached light this solves the scene's. `tell` is told how many of how many tiles are done and
    /// answers whether to go on; `None` where it said no.
    pub fn new(
        config: &DatasetConfig,
        tracer: &'a LightTracer<'a>,
        denoiser: Option<Box<dyn Denoise>>,
        tell: &(dyn Fn(usize, usize) -> bool + Sync),
    ) -> Option<Self> {
        let optical = &config.optical;
        let path = LightSettings {
            samples_per_pixel: optical.samples(),
            max_bounces: optical.max_bounces,
            seed: config.seed,
            ..LightSettings::default()
        };
        let cache = match optical.method {
            LightMethod::Path => None,
            LightMethod::Cached => Some(solve(config, tracer, tell)?),
        };
        let exposure_ev = optical.exposure_ev.unwrap_or(0.0) as f32;
        let samples_per_pixel = optical.samples();
        let view = ViewSettings {
            seed: config.seed,
            samples_per_pixel,
            most_samples: samples_per_pixel.saturating_mul(MOST_EFFORT),
            exposure_ev,
            ..ViewSettings::default()
        };
        Some(Self { tracer, cache, intrinsics: config.optical_camera(), path, view, denoiser, writes: *optical })
    }

    /// The camera's image size and focal lengths.
    pub fn intrinsics(&self) -> &Pinhole {
        &self.intrinsics
    }

    /// The exposure in force, EV.
    pub fn exposure_ev(&self) -> f32 {
        self.view.exposure_ev
    }

    /// Sets the exposure, EV.
    pub fn expose(&mut self, exposure_ev: f32) {
        self.view.exposure_ev = exposure_ev;
    }

    /// Radiance, depth and the rest at a pose, as a dataset's settings say. `key` (the keyframe's index) makes frames independent.
    ///
    /// # Errors
    /// Light that is not a finite number; a denoiser without memory.
    pub fn look(&self, world_from_camera: &Rigid3, key: u64) -> Result<LightFrame> {
        let mut frame = match &self.cache {
            Some(cache) => cache.render(&self.intrinsics, world_from_camera, &self.view, key),
            None => self.tracer.render(&self.intrinsics, world_from_camera, &self.path, key),
        };
        let finite = |frame: &LightFrame| match frame.radiance.pixels().iter().flatten().all(|v| v.is_finite()) {
            true => Ok(()),
            false => Err(not_finite(&format!("keyframe {key}: the radiance of a pixel"))),
        };
        finite(&frame)?;
        if let Some(denoiser) = &self.denoiser {
            denoiser.denoise(&mut frame)?;
            finite(&frame)?;
        }
        Ok(frame)
    }

    /// One exposure for the whole trajectory, EV: brings the geometric mean of what the platform sees to middle grey.
    ///
    /// # Errors
    /// Light that is not a finite number.
    pub fn meter(&self, poses: &[TrajectoryPose]) -> Result<f32> {
        let (full_width, full_height) = (self.intrinsics.width as f64, self.intrinsics.height as f64);
        let shrink = METERED_WIDTH as f64 / full_width;
        // Images much higher than wide are metered at so many rows, with as few columns as that leaves.
        let (width, height) = if full_height * shrink > MAX_METERED_HEIGHT as f64 {
            ((full_width * MAX_METERED_HEIGHT as f64 / full_height).round().max(1.0) as usize, MAX_METERED_HEIGHT)
        } else {
            (METERED_WIDTH, ((full_height * shrink) as usize).max(1))
        };
        let fov_deg = 2.0 * (0.5 * self.intrinsics.width as f64 / self.intrinsics.fx).atan().to_degrees();
        let small = Pinhole::from_horizontal_fov(width, height, fov_deg);
        let path = LightSettings { samples_per_pixel: METERED_SAMPLES, ..self.path };
        let view = ViewSettings { samples_per_pixel: METERED_SAMPLES, most_samples: METERED_SAMPLES, ..self.view };
        let (mut sum, mut n) = (0.0_f64, 0usize);
        for pose in poses.iter().step_by((poses.len() / METERED_POSES).max(1)) {
            let key = frame_key(pose);
            let frame = match &self.cache {
                Some(cache) => cache.render(&small, &pose.world_from_camera, &view, key),
                None => self.tracer.render(&small, &pose.world_from_camera, &path, key),
            };
            for &rgb in frame.radiance.pixels() {
                sum += f64::from(light::luminance(rgb.into()).max(1e-4).ln());
                n += 1;
            }
        }
        let mean = (sum / n.max(1) as f64).exp() as f32;
        // Hundredths of a stop are finer than anybody sees and read well in dataset.json.
        let exposure_ev = ((MIDDLE_GREY / mean).log2() * 100.0).round() / 100.0;
        if !bounds::EXPOSURE_EV.contains(&f64::from(exposure_ev)) {
            return Err(not_finite("the metered radiance"));
        }
        Ok(exposure_ev)
    }

    /// A keyframe without its spectrum.
    ///
    /// # Errors
    /// Light that is not a finite number.
    pub fn see(&self, pose: &TrajectoryPose) -> Result<FrameData> {
        let frame = self.look(&pose.world_from_camera, frame_key(pose))?;
        Ok(FrameData {
            image: Some(light::develop_frame(&frame, self.exposure_ev())),
            linear: self.writes.write_linear.then_some(frame.radiance),
            albedo: self.writes.write_albedo.then_some(frame.albedo),
            normals: self.writes.write_normals.then_some(frame.normal),
            depth_m: Some(frame.depth_m),
            surface: Some(frame.surface),
            mask: None,
            spectrum: None,
            sphere: None,
            share_in_frame: None,
            paths_jsonl: None,
        })
    }
}

/// Solves a scene's light, telling how far it is.
fn solve<'a>(
    config: &DatasetConfig,
    tracer: &'a LightTracer<'a>,
    tell: &(dyn Fn(usize, usize) -> bool + Sync),
) -> Option<LightCache<'a>> {
    let is_small = config.optical.width * config.optical.height <= SMALL_IMAGE;
    let fineness = if is_small { CacheSettings::for_small_images() } else { CacheSettings::default() };
    LightCache::new(tracer, &CacheSettings { seed: config.seed, max_passes: config.optical.max_bounces, ..fineness }, tell)
}

fn not_finite(what: &str) -> Error {
    Error::invalid("light", format!("{what} is not a finite number"), "check what the scene's materials and lights emit")
}

fn frame_key(pose: &TrajectoryPose) -> u64 {
    pose.index as u64
}
