//! The seam between a camera and the device that traces for it.

use super::{LightCache, LightFrame, LightSettings, LightTracer, Spent, ViewSettings, develop_frame};
use corf_scene::{Pinhole, Raster, Result, Rigid3};

/// A place to look from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightView {
    /// Pose of the camera in the world.
    pub world_from_camera: Rigid3,
    /// Makes frames independent of each other: the keyframe's index.
    pub key: u64,
}

/// Method of rendering, with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightSampling {
    /// Every pixel by itself.
    Path(LightSettings),
    /// From light worked out for all views.
    Cached(ViewSettings),
}

/// A view as a dataset keeps it: 8-bit sRGB, z-depth in metres (infinite where nothing was hit), object index (`u32::MAX`
/// likewise).
#[derive(Clone, Debug, PartialEq)]
pub struct Developed {
    /// Image after exposure and tone curve.
    pub image: Raster<[u8; 3]>,
    /// Depth at pixel centres.
    pub depth_m: Raster<f32>,
    /// Object at pixel centres.
    pub surface: Raster<u32>,
    /// Whether the radiance of every pixel is a finite number.
    pub finite: bool,
}

/// A device that renders views of one scene. The same device, scene, settings and key give the same bytes, whatever was rendered
/// before.
pub trait Renderer: Send + Sync {
    /// Renders views one after the other.
    ///
    /// # Errors
    /// The device's: it was lost, or its memory does not suffice.
    fn render(&self, camera: &Pinhole, views: &[LightView], sampling: &LightSampling) -> Result<Vec<LightFrame>>;

    /// Renders and develops views ([`develop_frame`]).
    ///
    /// # Errors
    /// Those of [`Self::render`].
    fn develop(
        &self,
        camera: &Pinhole,
        views: &[LightView],
        sampling: &LightSampling,
        exposure_ev: f32,
    ) -> Result<Vec<Developed>> {
        let developed = |frame: LightFrame| Developed {
            image: develop_frame(&frame, exposure_ev),
            finite: frame.is_finite(),
            depth_m: frame.depth_m,
            surface: frame.surface,
        };
        Ok(self.render(camera, views, sampling)?.into_iter().map(developed).collect())
    }

    /// Views of a camera that are best handed over at once.
    fn together(&self, _camera: &Pinhole) -> usize {
        1
    }

    /// Takes the memory of a camera's views, so that whoever writes files knows before the first whether there is enough.
    ///
    /// # Errors
    /// The device's: there is not even enough for one.
    fn reserve(&self, _camera: &Pinhole) -> Result<()> {
        Ok(())
    }

    /// Where the time went so far.
    fn spent(&self) -> Vec<Spent> {
        Vec::new()
    }

    /// The adapter's name; `None` where the processor computes.
    fn adapter(&self) -> Option<&str> {
        None
    }
}

/// The processor: a tracer and, for [`LightSampling::Cached`], its light.
pub struct Processor<'a> {
    /// The scene.
    pub tracer: &'a LightTracer<'a>,
    /// Light worked out for all views.
    pub cache: Option<LightCache<'a>>,
}

impl Renderer for Processor<'_> {
    fn render(&self, camera: &Pinhole, views: &[LightView], sampling: &LightSampling) -> Result<Vec<LightFrame>> {
        let one = |view: &LightView| match (sampling, &self.cache) {
            (LightSampling::Path(settings), _) => Ok(self.tracer.render(camera, &view.world_from_camera, settings, view.key)),
            (LightSampling::Cached(settings), Some(cache)) => {
                Ok(cache.render(camera, &view.world_from_camera, settings, view.key))
            }
            (LightSampling::Cached(_), None) => Err(no_cache()),
        };
        views.iter().map(one).collect()
    }
}

/// That cached light is asked for where none was solved.
pub(super) fn no_cache() -> corf_scene::Error {
    corf_scene::Error::invalid("light", "cached light was not solved", "this is a defect of the caller")
}
