//! The optical half of a keyframe: light at a pose, developed.

use crate::light::{
    self, CacheSettings, LightCache, LightFrame, LightSampling, LightSettings, LightTracer, LightView, Processor, Renderer,
    Spent, ViewSettings,
};
use corf_scene::config::{DatasetConfig, LightConfig, LightMethod};
use corf_scene::dataset::Extras;
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Error, Light, Pinhole, Result, Rigid3, bounds};

/// Poses along the trajectory at which the exposure is metered, and the size and samples of each.
const METERED_POSES: usize = 8;
const METERED_WIDTH: usize = 64;
const MAX_METERED_HEIGHT: usize = 512;
const METERED_SAMPLES: u32 = 16;
/// Exposure target: share of full scale to which the geometric mean of the metered radiance is mapped. Photography's middle grey,
/// a little up for a room whose walls are light.
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

/// Where light is traced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightDevice {
    /// On the processor.
    #[default]
    Processor,
    /// On a GPU.
    #[cfg(feature = "gpu")]
    Gpu(corf_gpu::AdapterOptions),
}

/// The camera of a dataset in its scene.
pub struct LightSensor<'a> {
    renderer: Box<dyn Renderer + 'a>,
    intrinsics: Pinhole,
    sampling: LightSampling,
    exposure_ev: f32,
    denoiser: Option<Box<dyn Denoise>>,
    writes: LightConfig,
}

impl<'a> LightSensor<'a> {
    /// Makes a dataset's camera ready on a device: with cached light this solves the scene's. `tell` is told how many of how many
    /// tiles are done and
    /// answers whether to go on; `None` where it said no.
    ///
    /// # Errors
    /// The device's.
    pub fn new(
        config: &DatasetConfig,
        tracer: &'a LightTracer<'a>,
        device: &LightDevice,
        denoiser: Option<Box<dyn Denoise>>,
        report: &(dyn Fn(usize, usize) -> bool + Sync),
    ) -> Result<Option<Self>> {
        let light = &config.light;
        let effort = light.effort.unwrap_or(1);
        // Powers of two are stratified best.
        let samples_per_pixel = light.samples().saturating_mul(if effort > 1 { effort.next_power_of_two() } else { 1 });
        let exposure_ev = light.exposure_ev.unwrap_or(0.0) as f32;
        let cache = match light.method {
            LightMethod::Path => None,
            LightMethod::Cached => Some(cache_settings(config)),
        };
        let sampling = match light.method {
            LightMethod::Path => LightSampling::Path(LightSettings {
                samples_per_pixel,
                max_bounces: light.max_bounces,
                seed: config.seed,
                ..LightSettings::default()
            }),
            LightMethod::Cached => LightSampling::Cached(ViewSettings {
                seed: config.seed,
                samples_per_pixel,
                most_samples: samples_per_pixel.saturating_mul(MOST_EFFORT),
                error: ViewSettings::default().error / (effort as f32).sqrt(),
                exposure_ev,
            }),
        };
        if let Some(settings) = &cache {
            LightCache::check_size(tracer, settings)?;
        }
        let renderer: Option<Box<dyn Renderer + 'a>> = match device {
            LightDevice::Processor => processor(tracer, cache.as_ref(), report),
            #[cfg(feature = "gpu")]
            LightDevice::Gpu(options) => {
                let gpu = light::GpuLight::new(tracer, cache.as_ref(), options, report)?;
                gpu.map(|gpu| Box::new(gpu) as Box<dyn Renderer + 'a>)
            }
        };
        let Some(renderer) = renderer else { return Ok(None) };
        let intrinsics = config.light_camera();
        Ok(Some(Self { renderer, intrinsics, sampling, exposure_ev, denoiser, writes: *light }))
    }

    /// The adapter that traces; `None` where the processor does.
    pub fn adapter(&self) -> Option<&str> {
        self.renderer.adapter()
    }

    /// Poses that [`Self::see_all`] is best given at once.
    pub fn together(&self) -> usize {
        if self.keeps_frames() { 1 } else { self.renderer.together(&self.intrinsics) }
    }

    /// Takes the memory of views beforehand.
    ///
    /// # Errors
    /// The device's: there is not enough.
    pub fn reserve(&self) -> Result<()> {
        self.renderer.reserve(&self.intrinsics)
    }

    /// Where a GPU's time went so far; empty where the processor traces.
    pub fn spent(&self) -> Vec<Spent> {
        self.renderer.spent()
    }

    /// Whether more of a view is wanted than its developed image.
    fn keeps_frames(&self) -> bool {
        let writes = &self.writes;
        self.denoiser.is_some() || writes.write_linear || writes.write_albedo || writes.write_normals
    }

    /// The camera's image size and focal lengths.
    pub fn intrinsics(&self) -> &Pinhole {
        &self.intrinsics
    }

    /// The exposure in force, EV.
    pub fn exposure_ev(&self) -> f32 {
        self.exposure_ev
    }

    /// Sets the exposure, EV.
    pub fn expose(&mut self, exposure_ev: f32) {
        self.exposure_ev = exposure_ev;
        if let LightSampling::Cached(view) = &mut self.sampling {
            view.exposure_ev = exposure_ev;
        }
    }

    /// Radiance, depth and the rest at a pose, as a dataset's settings say. `key` (the keyframe's index) makes frames
    /// independent.
    ///
    /// # Errors
    /// Light that is not a finite number; a denoiser without memory; the device's.
    pub fn look(&self, world_from_camera: &Rigid3, key: u64) -> Result<LightFrame> {
        let mut frame =
            self.render(&self.intrinsics, LightView { world_from_camera: *world_from_camera, key }, &self.sampling)?;
        let finite = |frame: &LightFrame| if frame.is_finite() { Ok(()) } else { Err(not_a_number(key)) };
        finite(&frame)?;
        if let Some(denoiser) = &self.denoiser {
            denoiser.denoise(&mut frame)?;
            finite(&frame)?;
        }
        Ok(frame)
    }

    /// One view.
    fn render(&self, camera: &Pinhole, view: LightView, sampling: &LightSampling) -> Result<LightFrame> {
        self.renderer.render(camera, &[view], sampling)?.pop().ok_or_else(lost)
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
        let sampling = match self.sampling {
            LightSampling::Path(path) => LightSampling::Path(LightSettings { samples_per_pixel: METERED_SAMPLES, ..path }),
            LightSampling::Cached(view) => {
                LightSampling::Cached(ViewSettings { samples_per_pixel: METERED_SAMPLES, most_samples: METERED_SAMPLES, ..view })
            }
        };
        let (mut sum, mut n) = (0.0_f64, 0usize);
        let views: Vec<LightView> = poses.iter().step_by((poses.len() / METERED_POSES).max(1)).map(view_of).collect();
        for frame in self.renderer.render(&small, &views, &sampling)? {
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

    /// What the camera sees at a pose, and the float images that are to be kept with it.
    ///
    /// # Errors
    /// Light that is not a finite number; the device's.
    pub fn see(&self, pose: &TrajectoryPose) -> Result<(Light, Extras)> {
        self.see_all(&[pose])?.pop().ok_or_else(lost)
    }

    /// [`Self::see`] at several poses, which a GPU renders faster together.
    ///
    /// # Errors
    /// Those of [`Self::see`].
    pub fn see_all(&self, poses: &[&TrajectoryPose]) -> Result<Vec<(Light, Extras)>> {
        let seen = |image, depth_m, surface| Light { image, depth_m: Some(depth_m), surface: Some(surface), mask: None };
        if !self.keeps_frames() {
            let views: Vec<LightView> = poses.iter().map(|pose| view_of(pose)).collect();
            let developed = self.renderer.develop(&self.intrinsics, &views, &self.sampling, self.exposure_ev)?;
            if developed.len() != views.len() {
                return Err(lost());
            }
            let checked = |(light::Developed { image, depth_m, surface, finite }, view): (light::Developed, &LightView)| {
                if finite { Ok((seen(image, depth_m, surface), Extras::default())) } else { Err(not_a_number(view.key)) }
            };
            return developed.into_iter().zip(&views).map(checked).collect();
        }
        let writes = &self.writes;
        let one = |pose: &&TrajectoryPose| {
            let frame = self.look(&pose.world_from_camera, pose.index as u64)?;
            let image = light::develop_frame(&frame, self.exposure_ev());
            let extras = Extras {
                linear: writes.write_linear.then_some(frame.radiance),
                albedo: writes.write_albedo.then_some(frame.albedo),
                normals: writes.write_normals.then_some(frame.normal),
                ..Extras::default()
            };
            Ok((seen(image, frame.depth_m, frame.surface), extras))
        };
        poses.iter().map(one).collect()
    }
}

/// The processor as a renderer; `None` where `tell` said no.
fn processor<'a>(
    tracer: &'a LightTracer<'a>,
    cache: Option<&CacheSettings>,
    report: &(dyn Fn(usize, usize) -> bool + Sync),
) -> Option<Box<dyn Renderer + 'a>> {
    let cache = match cache {
        Some(settings) => Some(LightCache::new(tracer, settings, report)?),
        None => None,
    };
    Some(Box::new(Processor { tracer, cache }))
}

/// Resolution and sampling of a dataset's light cache.
fn cache_settings(config: &DatasetConfig) -> CacheSettings {
    let is_small = config.light.width * config.light.height <= SMALL_IMAGE;
    let fineness = if is_small { CacheSettings::for_small_images() } else { CacheSettings::default() };
    let effort = config.light.effort.unwrap_or(1);
    CacheSettings {
        seed: config.seed,
        max_passes: config.light.max_bounces,
        // The coarse lattice is averaged over all walks of a point.
        direct_rays: fineness.direct_rays.saturating_mul(effort),
        gather_walks: fineness.gather_walks.saturating_mul(effort),
        ..fineness
    }
}

fn not_finite(what: &str) -> Error {
    Error::invalid("light", format!("{what} is not a finite number"), "check what the scene's materials and lights emit")
}

fn not_a_number(key: u64) -> Error {
    not_finite(&format!("keyframe {key}: the radiance of a pixel"))
}

/// That a device answered with fewer views than it was asked for.
fn lost() -> Error {
    Error::invalid("light", "a view was lost", "this is a defect of the device")
}

fn view_of(pose: &TrajectoryPose) -> LightView {
    LightView { world_from_camera: pose.world_from_camera, key: pose.index as u64 }
}
