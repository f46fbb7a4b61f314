//! Light: an unbiased path tracer, a cache of diffuse light that all views of a scene share ([`cache`]), and a developer.
//!
//! Camera paths with next-event estimation at every vertex, combined with reflection sampling by the power heuristic (Veach 1997).
//! Emitters are chosen per cell of space ([`emitter`]), reflection is GGX over Lambert ([`bsdf`]), sample points are Owen-scrambled
//! Sobol' ([`sampler`]). Radiance is linear, in the scene's own unit; every surface is seen from both sides, emission follows the
//! material's `double_sided`.
//!
//! Glass (`transmission > 0`) is a thin pane without refraction: light is reflected with the pane's Fresnel reflectance, otherwise
//! passes straight through, tinted. Straight passage is not a scattering event: shadow rays and multiple importance sampling look
//! through panes, and so do depth, surface ids and the auxiliary images.
//!
//! Alpha is coverage (`over` compositing): of a blended surface the share alpha is there, and through the rest light passes as if there
//! were none, unweakened and untinted, for camera, bounce and shadow rays alike. Depth and surface ids are those of surfaces of which
//! at least half is there.

mod bsdf;
mod cache;
mod develop;
mod emitter;
#[cfg(feature = "gpu")]
mod gpu;
mod path;
#[cfg(feature = "gpu")]
mod records;
mod renderer;
mod sampler;
mod stages;
mod surface;
mod texture;
mod triangle;

#[cfg(test)]
mod tests;

pub use cache::{CacheSettings, LightCache, ViewSettings};
pub use develop::{develop, develop_frame, develop_pixel};
#[cfg(feature = "gpu")]
pub use gpu::GpuLight;
pub use renderer::{Developed, LightSampling, LightView, Processor, Renderer};
pub use stages::{Spent, Stages};

use crate::bvh::{Bvh, Ray};
use corf_scene::model::Texture;
use corf_scene::{Pinhole, Raster, Rigid3, Scene};
use emitter::Emitters;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use sampler::Sampler;
use surface::{Cover, covers};

/// Settings of the path tracer for light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSettings {
    /// Camera paths per pixel; powers of two are stratified best.
    pub samples_per_pixel: u32,
    /// Scattering events of a path at most; 0 shows emitters only, 1 direct light.
    pub max_bounces: u32,
    /// Paths may end at random (Russian roulette, unbiased) after this many scattering events.
    pub roulette_after: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Radiance of everything beyond the scene.
    pub background: [f32; 3],
    /// Emitters are sampled at every vertex; without, light is found by chance alone (slow, the reference of the tests).
    pub next_event_estimation: bool,
}

impl Default for LightSettings {
    fn default() -> Self {
        Self {
            samples_per_pixel: 32,
            max_bounces: 8,
            roulette_after: 3,
            seed: 0,
            background: [0.0; 3],
            next_event_estimation: true,
        }
    }
}

/// Rays shot for a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// Rays from the camera, depth rays included.
    pub camera: u64,
    /// Continuing a path.
    pub bounce: u64,
    /// Towards emitters.
    pub shadow: u64,
}

/// A rendered view: radiance and what a denoiser or a reconstruction wants to know beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct LightFrame {
    /// The camera that saw it.
    pub camera: Pinhole,
    /// Pose of the camera in the world.
    pub world_from_camera: Rigid3,
    /// Linear radiance, mean over the pixel's area (box filter).
    pub radiance: Raster<[f32; 3]>,
    /// z-depth of the pixel centre in metres, by one exact ray (through holes and panes); infinite where nothing was hit.
    pub depth_m: Raster<f32>,
    /// Object index at the pixel centre, `u32::MAX` where nothing was hit.
    pub surface: Raster<u32>,
    /// Mean total reflectance of what the pixel sees first.
    pub albedo: Raster<[f32; 3]>,
    /// Mean shading normal (world frame) of what the pixel sees first; shorter than 1 across edges, 0 where nothing was hit.
    pub normal: Raster<[f32; 3]>,
    /// Contribution of the paths that see an emitter or the background directly, also through panes: their part of `radiance`, and their
    /// share of the pixel's paths. They are developed apart from the others, so that a lamp's edge is smooth though the lamp is white.
    pub lamp: Raster<[f32; 4]>,
    /// Rays shot.
    pub rays: RayCounts,
}

/// An image worked out row by row on all threads, with the rays that took.
fn in_rows<T: Send>(
    width: usize,
    height: usize,
    pixel: impl Fn(usize, usize, &mut RayCounts) -> T + Sync,
) -> (Raster<T>, RayCounts) {
    let rows: Vec<(Vec<T>, RayCounts)> = (0..height)
        .into_par_iter()
        .map(|y| {
            let mut counts = RayCounts::default();
            let row = (0..width).map(|x| pixel(x, y, &mut counts)).collect();
            (row, counts)
        })
        .collect();
    let counts = rows.iter().fold(RayCounts::default(), |sum, (_, counts)| sum.and(counts));
    (Raster::from_vec(width, height, rows.into_iter().flat_map(|(row, _)| row).collect()), counts)
}

/// The ray of a pixel's film at `[dx, dy]` within it.
fn camera_ray(camera: &Pinhole, world_from_camera: &Rigid3, x: usize, y: usize, [dx, dy]: [f32; 2]) -> Ray {
    let toward = camera.unproject(x as f64 + f64::from(dx), y as f64 + f64::from(dy));
    let direction = world_from_camera.transform_vector(toward.normalize()).as_vec3();
    Ray::new(world_from_camera.translation.as_vec3(), direction)
}

impl RayCounts {
    fn and(&self, other: &Self) -> Self {
        Self { camera: self.camera + other.camera, bounce: self.bounce + other.bounce, shadow: self.shadow + other.shadow }
    }
}

impl LightFrame {
    /// Whether the radiance of every pixel is a finite number.
    pub fn is_finite(&self) -> bool {
        self.radiance.pixels().iter().flatten().all(|v| v.is_finite())
    }

    fn of(camera: &Pinhole, world_from_camera: &Rigid3, pixels: &Raster<Pixel>, rays: RayCounts) -> Self {
        Self {
            camera: *camera,
            world_from_camera: *world_from_camera,
            radiance: pixels.map(|p| p.radiance.to_array()),
            depth_m: pixels.map(|p| p.depth_m),
            surface: pixels.map(|p| p.surface),
            albedo: pixels.map(|p| p.albedo.to_array()),
            normal: pixels.map(|p| p.normal.to_array()),
            lamp: pixels.map(|p| p.lamp.to_array()),
            rays,
        }
    }
}

/// A scene made ready for rendering.
#[derive(Debug)]
pub struct LightTracer<'a> {
    scene: &'a Scene,
    bvh: &'a Bvh,
    emitters: Emitters,
    covers: Vec<Cover>,
    /// The scene's textures at low resolution.
    coarse: Vec<Texture>,
    all_opaque: bool,
}

/// One pixel's results.
#[derive(Clone, Copy, Default)]
struct Pixel {
    radiance: Vec3,
    albedo: Vec3,
    normal: Vec3,
    lamp: Vec4,
    depth_m: f32,
    surface: u32,
}

impl<'a> LightTracer<'a> {
    /// Finds the emitters and estimates what each part of the scene sees of them (tenths of a second for a furnished room).
    ///
    /// # Panics
    /// If a triangle, material or texture index of the scene is out of range; importers make none such.
    pub fn new(scene: &'a Scene, bvh: &'a Bvh) -> Self {
        let covers = covers(scene);
        let all_opaque = covers.iter().all(|c| *c == Cover::OPAQUE);
        Self {
            scene,
            bvh,
            emitters: Emitters::new(scene, bvh, &covers),
            covers,
            coarse: texture::coarse(&scene.textures),
            all_opaque,
        }
    }

    /// Renders the view of a camera. `frame_key` (the keyframe's index) makes frames independent of each other; the same scene,
    /// settings and key give the same bytes on any number of threads.
    pub fn render(&self, camera: &Pinhole, world_from_camera: &Rigid3, settings: &LightSettings, frame_key: u64) -> LightFrame {
        let (width, height) = (camera.width, camera.height);
        let (pixels, rays) =
            in_rows(width, height, |x, y, counts| self.pixel(camera, world_from_camera, settings, frame_key, x, y, counts));
        LightFrame::of(camera, world_from_camera, &pixels, rays)
    }

    /// Renders some pixels `[x, y]` of the view alone: radiance and lamp of each, as in [`LightFrame`].
    pub fn render_pixels(
        &self,
        camera: &Pinhole,
        world_from_camera: &Rigid3,
        settings: &LightSettings,
        frame_key: u64,
        pixels: &[[usize; 2]],
    ) -> Vec<([f32; 3], [f32; 4])> {
        let at = |&[x, y]: &[usize; 2]| {
            let pixel = self.pixel(camera, world_from_camera, settings, frame_key, x, y, &mut RayCounts::default());
            (pixel.radiance.to_array(), pixel.lamp.to_array())
        };
        pixels.par_iter().map(at).collect()
    }

    fn pixel(
        &self,
        camera: &Pinhole,
        world_from_camera: &Rigid3,
        settings: &LightSettings,
        frame_key: u64,
        x: usize,
        y: usize,
        counts: &mut RayCounts,
    ) -> Pixel {
        let mut sampler = Sampler::new(settings.seed, frame_key, (y * camera.width + x) as u64);
        let mut pixel = Pixel::default();
        let n = settings.samples_per_pixel.max(1);
        for i in 0..n {
            sampler.start(i);
            let ray = camera_ray(camera, world_from_camera, x, y, sampler.pair(path::FILM));
            let path = self.trace(ray, &sampler, settings, counts);
            let radiance = path.emitted + path.scattered;
            pixel.radiance += radiance;
            if path.emitted != Vec3::ZERO {
                pixel.lamp += radiance.extend(1.0);
            }
            pixel.albedo += path.albedo;
            pixel.normal += path.normal;
        }
        let share = 1.0 / n as f32;
        pixel.radiance *= share;
        pixel.lamp *= share;
        pixel.albedo *= share;
        pixel.normal *= share;
        (pixel.depth_m, pixel.surface) = self.centre(camera, world_from_camera, x, y, counts);
        pixel
    }

    /// z-depth and object index at a pixel's centre.
    fn centre(&self, camera: &Pinhole, world_from_camera: &Rigid3, x: usize, y: usize, counts: &mut RayCounts) -> (f32, u32) {
        // z = 1 in the camera frame, so t is the z-depth.
        let toward = camera.unproject(x as f64 + 0.5, y as f64 + 0.5);
        let direction = world_from_camera.transform_vector(toward);
        let ray = Ray::new(world_from_camera.translation.as_vec3(), direction.as_vec3());
        counts.camera += 1;
        match self.closest_where(&ray, BARELY_HALF, |cover| !cover.pane) {
            Some(hit) => (hit.t, self.scene.triangles[hit.triangle as usize].object),
            None => (f32::INFINITY, u32::MAX),
        }
    }
}

/// Depth and surface ids look through surfaces of which no more than this is there: just under a half, which counts as there.
const BARELY_HALF: f32 = 0.499_999;

/// Luminance of linear sRGB (Rec. 709 weights).
pub fn luminance(c: Vec3) -> f32 {
    c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}
