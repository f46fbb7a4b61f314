//! Where the arithmetic runs. The online policy (which keyframe, which level, when to expand or prune, random numbers) lives above
//! this seam, once; a device stores keyframe pyramids and Gaussians, renders, and runs training steps.

pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;

use crate::{Gaussians, Result};
use corf_scene::{Pinhole, Raster, Rigid3};

/// Where a picture is taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Intrinsics of the image to render.
    pub camera: Pinhole,
    /// Pose (OpenCV camera axes, metres).
    pub world_from_camera: Rigid3,
}

/// A `height × width × channels` f32 image, row-major, channels innermost.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Channels.
    pub channels: usize,
    /// `pixels[(y·width + x)·channels + c]`.
    pub pixels: Vec<f32>,
}

/// One keyframe as a training target. Both modalities share the pose and keep their own camera and resolution.
#[derive(Clone, Debug)]
pub struct TrainingView {
    /// The pose of both sensors.
    pub world_from_camera: Rigid3,
    /// Intrinsics of the optical image.
    pub optical_camera: Pinhole,
    /// Optical target: 3 channels, sRGB-encoded `[0, 1]`.
    pub optical: Planes,
    /// Intrinsics of the RF image.
    pub rf_camera: Pinhole,
    /// RF target: 3 channels (Jet) or 1 (scalar dB), `[0, 1]`.
    pub rf: Planes,
    /// Aligned inverse depth (1/m, z-depth) with a confidence in `[0, 1]` per optical pixel; a confidence of 0 leaves a pixel out.
    pub inverse_depth: Option<InverseDepth>,
}

/// An inverse-depth map with confidences, of the optical image's size.
#[derive(Clone, Debug)]
pub struct InverseDepth {
    /// 1/z, 1/m.
    pub value: Raster<f32>,
    /// Weight in `[0, 1]`.
    pub confidence: Raster<f32>,
}

/// Names an uploaded [`TrainingView`] on the device it was uploaded to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ViewId(pub usize);

/// One optimisation step: render both modalities of one keyframe at one pyramid level, compare, differentiate, update.
///
/// Loss = optical_weight·L_opt + rf_weight·L_rf + depth_weight·L_d with L = 0.8·L1 + 0.2·(1 − SSIM) (paper Eqs. (19)–(21)).
/// A modality of weight 0 is not rendered, and its opacity and colour are not touched.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// The keyframe.
    pub view: ViewId,
    /// Pyramid level: both targets averaged over 2^level blocks.
    pub level: u32,
    /// Weight of the optical loss (1 in the paper, 0 in the RF stage of a two-stage method).
    pub optical_weight: f32,
    /// λ_rf.
    pub rf_weight: f32,
    /// η, the weight of the inverse-depth L1 term.
    pub depth_weight: f32,
    /// Whether position, rotation and scale are updated.
    pub train_geometry: bool,
    /// What lies behind the optical field in this step.
    pub optical_background: [f32; 3],
    /// What lies behind the RF field (the first C_rf channels are used): the floor colour.
    pub rf_background: [f32; 3],
}

/// What a step found (losses before the update).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Unweighted optical loss.
    pub optical_loss: f32,
    /// Unweighted RF loss.
    pub rf_loss: f32,
    /// Unweighted depth loss, 1/m.
    pub depth_loss: f32,
    /// Gaussians visible in either modality.
    pub visible: usize,
}

/// What to render.
#[derive(Clone, Copy, Debug, Default)]
pub struct RenderRequest {
    /// Optical view and background, if light is wanted.
    pub optical: Option<(View, [f32; 3])>,
    /// RF view and background, if radio is wanted.
    pub rf: Option<(View, [f32; 3])>,
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
    /// What remains behind the last Gaussian, T_N.
    pub transmittance: Raster<f32>,
}

/// The answer to a [`RenderRequest`].
#[derive(Clone, Debug, Default)]
pub struct Rendering {
    /// Light.
    pub optical: Option<Layer>,
    /// Radio.
    pub rf: Option<Layer>,
    /// Index of the Gaussian of the largest α·T per optical pixel; `u32::MAX` where none contributes.
    pub main_contributor: Option<Raster<u32>>,
}

/// A place to run: `cpu` (rayon + SIMD, the embedded default) or `gpu`.
pub trait Device: Send {
    /// For records: "cpu (2 threads)", an adapter's name.
    fn name(&self) -> String;

    /// Stores a training view and builds its pyramid of `levels` levels (level l averages 2^l blocks).
    ///
    /// # Errors
    /// When the device has no memory for it.
    fn upload(&mut self, view: &TrainingView, levels: u32) -> Result<ViewId>;

    /// How many Gaussians are held.
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
    fn retain(&mut self, keep: &[bool]);

    /// Replaces the RF appearance of all Gaussians and resets its optimiser state: the start of a second stage.
    fn reset_rf(&mut self, rf: &crate::Appearance);

    /// Sets the rate of positions in metres per step (see [`OptimizerConfig`](crate::OptimizerConfig)).
    fn set_position_rate_m(&mut self, rate_m: f32);

    /// Renders a view of the current field.
    ///
    /// # Errors
    /// A camera without pixels, or a main contributor asked for without an optical view.
    fn render(&mut self, request: &RenderRequest) -> Result<Rendering>;

    /// Runs training steps in order and reports the last. Steps name views uploaded to this device.
    fn train(&mut self, steps: &[Step]) -> Result<StepReport>;

    /// Reads the Gaussians back.
    fn gaussians(&mut self) -> Gaussians;
}
