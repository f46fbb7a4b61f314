//! Compute devices (CPU, GPU) of the rasteriser and the optimiser. A device stores keyframe pyramids and Gaussians, renders, and runs
//! training steps. The online policy (which keyframe, which level, when to expand or prune, random numbers) is above this interface, once.

pub mod cpu;
mod dense;
#[cfg(feature = "gpu")]
pub mod gpu;
mod mask;
mod packed;
mod state;
mod survey;
mod times;

pub use crate::images::Planes;
pub use dense::{DenseStep, Duplicate, ScreenGradient};
pub use packed::{PackedView, Packer};
pub use state::{DeviceState, Outline};
#[cfg(test)]
pub(crate) use survey::judge;
pub use survey::{PruneDecision, PruneRule, Shown, Survey, SurveyRequest};
pub use times::{FrameTimes, TrainingTimes};

use crate::{AppearanceRates, Error, Gaussians, Result, depth::Matcher};
use corf_scene::{Pinhole, Raster, Rigid3};
use std::sync::Arc;

/// Camera of a rendering: intrinsics and pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Intrinsics of the image to render.
    pub camera: Pinhole,
    /// Pose (OpenCV camera axes, metres).
    pub world_from_camera: Rigid3,
}

/// One keyframe as a training target. Both modalities share the pose and keep their own camera and resolution.
#[derive(Clone, Debug)]
pub struct TrainingView {
    /// The pose of both sensors.
    pub world_from_camera: Rigid3,
    /// Intrinsics of the optical image.
    pub light_camera: Pinhole,
    /// Optical target: 3 channels, sRGB-encoded `[0, 1]`.
    pub light: Planes,
    /// Intrinsics of the RF image.
    pub radio_camera: Pinhole,
    /// RF target: 3 channels (Jet) or 1 (scalar dB), `[0, 1]`.
    pub radio: Planes,
    /// Aligned inverse depth (1/m, z-depth) with a confidence in `[0, 1]` per optical pixel; a confidence of 0 leaves a pixel out.
    pub inverse_depth: Option<InverseDepth>,
    /// Whether a pixel of the optical image counts, of its size; the others are not learnt from, whatever the image and the depth hold there.
    /// `None`: all count.
    pub mask: Option<Raster<bool>>,
}

/// An inverse-depth map with confidences, of the optical image's size.
#[derive(Clone, Debug)]
pub struct InverseDepth {
    /// 1/z, 1/m.
    pub value: Raster<f32>,
    /// Weight in `[0, 1]`.
    pub confidence: Raster<f32>,
}

/// One of a field's two modalities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Modality {
    /// What a camera sees: RGB.
    Light,
    /// What an array receives at 60 GHz: Jet colours or one number a direction.
    Radio,
}

impl Modality {
    /// Its place where both stand in an array.
    pub fn index(self) -> usize {
        match self {
            Self::Light => 0,
            Self::Radio => 1,
        }
    }
}

/// Names an uploaded [`TrainingView`] on the device it was uploaded to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ViewId(pub usize);

/// One optimisation step: render both modalities of one keyframe, each at a pyramid level, compare, differentiate, update.
///
/// Loss = optical_weight·L_opt + rf_weight·L_rf + depth_weight·L_d with L = 0.8·L1 + 0.2·(1 − SSIM) (paper Eqs. (19)–(21)).
/// A modality of weight 0 is not rendered, and its opacity and colour are not touched.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// The keyframe that is rendered and compared.
    pub view: ViewId,
    /// Pyramid levels of the optical and the RF target: averaged over 2^level blocks.
    pub levels: [u32; 2],
    /// Weight of the optical loss (1 in the paper, 0 in the RF stage of a two-stage method).
    pub light_weight: f32,
    /// λ_rf.
    pub radio_weight: f32,
    /// η, the weight of the inverse-depth L1 term.
    pub depth_weight: f32,
    /// Whether position, rotation and scale are updated.
    pub train_geometry: bool,
    /// Background colour of the optical image in this step.
    pub light_background: [f32; 3],
    /// Background colour of the RF image (the first C_rf channels are used): that of the dB range's floor.
    pub radio_background: [f32; 3],
}

/// Losses of a step, before its update, and the number of visible Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Unweighted optical loss.
    pub light_loss: f32,
    /// Unweighted RF loss.
    pub radio_loss: f32,
    /// Unweighted depth loss, 1/m.
    pub depth_loss: f32,
    /// Gaussians visible in either modality.
    pub visible: usize,
}

/// Request for a rendering: the modalities wanted, with their views and backgrounds.
#[derive(Clone, Copy, Debug, Default)]
pub struct RenderRequest {
    /// Optical view and background, if light is wanted.
    pub light: Option<(View, [f32; 3])>,
    /// RF view and background, if radio is wanted.
    pub radio: Option<(View, [f32; 3])>,
    /// Also find, per optical pixel, the Gaussian of the largest blending weight α·T.
    pub main_contributor: bool,
}

/// A rendered modality.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Composited colour.
    pub color: Planes,
    /// Composited inverse depth Σ α T / z, 1/m (not divided by coverage).
    pub inverse_depth: Raster<f32>,
    /// Transmittance behind the last Gaussian, T_N.
    pub transmittance: Raster<f32>,
}

/// The answer to a [`RenderRequest`].
#[derive(Clone, Debug, Default)]
pub struct Rendering {
    /// The image over the pixels of its view, if it was asked for.
    pub light: Option<Layer>,
    /// The radio field over the pixels of its view, if it was asked for.
    pub radio: Option<Layer>,
    /// Index of the Gaussian of the largest α·T per optical pixel; `u32::MAX` where none contributes.
    pub main_contributor: Option<Raster<u32>>,
}

/// Refuses a training view whose images have other channels than the Gaussians.
pub(crate) fn check_channels(view: &TrainingView, channels: [usize; 2]) -> Result<()> {
    for (name, image, held) in [("optical", &view.light, channels[0]), ("rf", &view.radio, channels[1])] {
        if image.channels != held {
            let what = format!("{} channels against {held} of the Gaussians", image.channels);
            let help = "light has 3 channels; RF has 3 (Jet) or 1 (dB)";
            return Err(Error::invalid(format!("training view, {name}"), what, help));
        }
    }
    Ok(())
}

/// Images that a device without a way of its own hands over together: enough for all threads of the processor.
const IMAGES_AT_ONCE: usize = 16;

/// Refuses a camera without pixels.
pub(crate) fn check_camera(camera: &Pinhole) -> Result<()> {
    if camera.width == 0 || camera.height == 0 {
        let what = format!("a camera of {}x{} pixels", camera.width, camera.height);
        return Err(Error::invalid("render request", what, "give a camera with pixels"));
    }
    Ok(())
}

/// A place to run: `cpu` (rayon + SIMD, the embedded default) or `gpu`.
pub trait Device: Send {
    /// Name for records: "cpu (2 threads)", an adapter's name.
    fn name(&self) -> String;

    /// Stores a training view and builds its pyramid of `levels` levels (level l averages 2^l blocks).
    ///
    /// # Errors
    /// When the device has no memory for it.
    fn upload(&mut self, view: &TrainingView, levels: u32) -> Result<ViewId>;

    /// A function that prepares training views for [`Self::upload_packed`], on any thread: the work that [`Self::upload`] does when it is
    /// called. `None` from a device that has nothing to prepare.
    fn packer(&self) -> Option<Packer> {
        None
    }

    /// [`Self::upload`] of what this device's own [`Self::packer`] has built.
    ///
    /// # Errors
    /// Those of [`Self::upload`]; another device's view.
    fn upload_packed(&mut self, _view: PackedView) -> Result<ViewId> {
        Err(self.lacks("packed views", "give it the view itself, with Device::upload"))
    }

    /// What matches keyframes on this device, on any thread and beside training; `None` from a device that is the processor.
    ///
    /// # Errors
    /// When the device cannot be opened once more.
    fn matcher(&self) -> Result<Option<Arc<dyn Matcher>>> {
        Ok(None)
    }

    /// Whether training keeps this machine's processor busy, so that work done ahead on the chance of being needed costs time.
    fn trains_on_the_host(&self) -> bool {
        true
    }

    /// Memory that the device has taken at present, bytes, where it has memory of its own and counts it.
    fn memory_bytes(&self) -> Option<u64> {
        None
    }

    /// Where the time of training went since the device was made or this was last asked; `None` from a device that was not told to time itself.
    ///
    /// # Errors
    /// When the device fails.
    fn take_training_times(&mut self) -> Result<Option<TrainingTimes>> {
        Ok(None)
    }

    /// Number of Gaussians held.
    fn len(&self) -> usize;

    /// Whether no Gaussian is held.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Adds Gaussians behind those held, with fresh optimiser state.
    ///
    /// # Errors
    /// When the device has no memory for them.
    fn append(&mut self, new: &Gaussians) -> Result<()>;

    /// Keeps the Gaussians whose flag is true, in order, with their optimiser state. `keep.len() == self.len()`.
    ///
    /// # Errors
    /// When the device fails.
    fn retain(&mut self, keep: &[bool]) -> Result<()>;

    /// Replaces the RF appearance of all Gaussians and resets its optimiser state: the start of a second stage.
    ///
    /// # Errors
    /// An appearance of another number of Gaussians, other channels or another degree; when the device fails.
    fn reset_radio(&mut self, radio: &crate::Appearance) -> Result<()>;

    /// Sets the rate of positions in metres per step (see [`OptimizerConfig`](crate::OptimizerConfig)).
    fn set_position_rate_m(&mut self, rate_m: f32);

    /// Sets the rates of opacity and colour at 60 GHz for the steps that follow.
    ///
    /// # Errors
    /// A device whose rates are fixed.
    fn set_radio_rates(&mut self, _rates: AppearanceRates) -> Result<()> {
        Err(self.lacks("rates that could be set", "train with the rates that it was made with"))
    }

    /// Renders a view of the current field.
    ///
    /// # Errors
    /// A camera without pixels, or a main contributor asked for without an optical view.
    fn render(&mut self, request: &RenderRequest) -> Result<Rendering>;

    /// Renders the radio field alone at poses of one camera, and hands the images to `take` in the order of the poses, some at a time. A device with
    /// a processor of its own draws the next meanwhile.
    ///
    /// # Errors
    /// Those of [`Self::render`]; that of `take`, which ends the work.
    fn render_radio(
        &mut self,
        camera: &Pinhole,
        poses: &[Rigid3],
        background: [f32; 3],
        take: &mut dyn FnMut(Vec<Planes>) -> Result<()>,
    ) -> Result<()> {
        for some in poses.chunks(IMAGES_AT_ONCE) {
            let image = |pose: &Rigid3| {
                let radio = Some((View { camera: *camera, world_from_camera: *pose }, background));
                let rendering = self.render(&RenderRequest { radio, ..RenderRequest::default() })?;
                Ok(rendering.radio.ok_or_else(|| self.left_out())?.color)
            };
            take(some.iter().map(image).collect::<Result<_>>()?)?;
        }
        Ok(())
    }

    /// Surveys the field for an expansion: the rendered values at some pixels of a view, and the pruning decision of each Gaussian.
    ///
    /// # Errors
    /// Those of [`Self::render`]; when the device fails.
    fn survey(&mut self, request: &SurveyRequest<'_>) -> Result<Survey> {
        let wanted = RenderRequest { light: Some((request.view, [0.0; 3])), radio: None, main_contributor: true };
        let rendering = self.render(&wanted)?;
        Ok(Survey::of(&rendering, &self.outlines()?, request))
    }

    /// Runs training steps in order and reports the last. Steps name views uploaded to this device.
    fn train(&mut self, steps: &[Step]) -> Result<StepReport>;

    /// [`Self::train`], but a device with a processor of its own returns while it works, and has nothing to report yet. What is asked of it
    /// next waits, and has its errors.
    ///
    /// # Errors
    /// Those of [`Self::train`].
    fn begin_training(&mut self, steps: &[Step]) -> Result<Option<StepReport>> {
        self.train(steps).map(Some)
    }

    /// Waits for what was begun and reports its last step; `None` where nothing is under way.
    ///
    /// # Errors
    /// Those of [`Self::train`].
    fn end_training(&mut self) -> Result<Option<StepReport>> {
        Ok(None)
    }

    /// Runs steps of dense Adam in order and reports the last.
    ///
    /// # Errors
    /// Those of [`Self::train`]; a step that trains both modalities or none; a device without dense Adam.
    fn train_dense(&mut self, _steps: &[DenseStep]) -> Result<StepReport> {
        Err(self.lacks("dense Adam", "train with Device::train on this device"))
    }

    /// Reads the positional gradients on the screen that [`Self::train_dense`] has summed; zeros where no step has since the Gaussians held last
    /// changed: adding, removing or restoring any forgets them.
    ///
    /// # Errors
    /// When the device fails, or sums none.
    fn screen_gradients(&mut self) -> Result<Vec<ScreenGradient>> {
        Err(self.lacks("screen-space gradients", "do without density control on this device"))
    }

    /// Replaces those sums, so that a resumed reconstruction goes on with those it had; one per Gaussian.
    ///
    /// # Errors
    /// Another number than that of Gaussians; when the device fails, or sums none.
    fn set_screen_gradients(&mut self, _gradients: &[ScreenGradient]) -> Result<()> {
        Err(self.lacks("screen-space gradients", "do without density control on this device"))
    }

    /// Adds copies of Gaussians behind those held, in order, with fresh optimiser state.
    ///
    /// # Errors
    /// A source that is not held; when the device has no memory for them or cannot copy.
    fn duplicate(&mut self, _duplicates: &[Duplicate]) -> Result<()> {
        Err(self.lacks("copies of Gaussians", "do without density control on this device"))
    }

    /// Lowers a modality's opacities above `most` to it, and resets the optimiser state of all its opacities.
    ///
    /// # Errors
    /// When the device fails, or cannot.
    fn cap_opacity(&mut self, _modality: Modality, _most: f32) -> Result<()> {
        Err(self.lacks("opacity resets", "do without density control on this device"))
    }

    /// Reads the Gaussians back.
    ///
    /// # Errors
    /// When the device fails: there is no field then, not an empty one.
    fn gaussians(&mut self) -> Result<Gaussians>;

    /// Reads back what decides whether a Gaussian is pruned, and no more.
    ///
    /// # Errors
    /// When the device fails.
    fn outlines(&mut self) -> Result<Vec<Outline>> {
        Ok(Outline::of(&self.gaussians()?))
    }

    /// Reads the Gaussians back with the state of their optimiser.
    ///
    /// # Errors
    /// When the device fails, or keeps no such state.
    fn state(&mut self) -> Result<DeviceState> {
        Err(self.lacks("checkpoints", "run without them on this device"))
    }

    /// Makes a device that holds no Gaussians hold those of a [`Self::state`], optimiser and all.
    ///
    /// # Errors
    /// When Gaussians are held already, or the state is incomplete or of other channels and degrees; when there is no memory for it.
    fn restore(&mut self, _state: &DeviceState) -> Result<()> {
        Err(self.lacks("checkpoints", "run without them on this device"))
    }

    /// The error of a device that has not rendered what it was asked for.
    fn left_out(&self) -> Error {
        Error::invalid(self.name(), "the device left out a modality that was asked for", "this is a defect of the device")
    }

    /// The error of a device without something.
    fn lacks(&self, what: &str, help: &str) -> Error {
        Error::invalid(self.name(), format!("this device has no {what}"), help)
    }
}
